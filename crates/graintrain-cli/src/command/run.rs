//! `graintrain run`: simulate a scene.

use crate::closing::counted;
use crate::crew::Crew;
use crate::error::Failure;
use crate::scene_failure::scene_failure;
use crate::stepping::{Begun, SteppingOptions, make_steps, output_failure};
use crate::terminal::say;
use crate::threads::{Pool, pool};
use graintrain::material::Materials;
use graintrain::world::World;
use graintrain_io::output::folder::{PrepareError, RunFolder};
use graintrain_io::output::recorder::Recorder;
use graintrain_io::run::{Run, RunSettings, RunTotals};
use graintrain_io::scene::{self, Scene};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Simulate a scene
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  graintrain run sedimentation --set n=4 --steps 120\n  \
    graintrain run mine.toml --out results/mine --solver apgd --tolerance 1e-5\n\n\
    Exit codes: 0 done; 1 the run failed, or a solve did not reach its tolerance under --strict; 2 bad input; 3 the time of --max-seconds \
    was up (as after a signal); 130/143/129 stopped by Ctrl-C, SIGTERM, SIGHUP (a checkpoint is written: `graintrain resume DIR` goes on; SIGUSR1 writes one and \
    goes on by itself)")]
pub struct Arguments {
    /// A scene file (TOML) or the name of a built-in scene (`graintrain scenes` lists them)
    scene: String,
    /// Folder for the results; a fresh out/NAME where it is not given
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Set a parameter of the scene or any of its keys, e.g. n=8, time.step="10 ms"; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Number of steps
    #[arg(long, value_name = "N", conflicts_with = "until")]
    steps: Option<u64>,
    /// Simulated time, in seconds or with a unit
    #[arg(long, value_name = "SECONDS")]
    until: Option<String>,
    /// Contact solver (`graintrain solvers` lists them)
    #[arg(long, value_name = "NAME")]
    solver: Option<String>,
    /// Residual at which the solver stops: its root mean square over the contacts, with 20 times that for the
    /// worst one. 1e-4: the velocities left over at contacts are, in the root mean square, 1e-4 of |gravity|
    /// times the time step
    #[arg(long, value_name = "X")]
    tolerance: Option<String>,
    /// Ask the tolerance of the worst contact
    #[arg(long)]
    strict_max: bool,
    /// Friction law; coulomb unless the scene says otherwise
    #[arg(long, value_name = "MODEL", value_parser = ["relaxed", "coulomb"])]
    friction: Option<String>,
    /// Write the contact problem of every K-th step into DIR/problems
    #[arg(long, value_name = "every=K", value_parser = every)]
    dump_problem: Option<u64>,
    /// Replace the results of an earlier run in the folder
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    stepping: SteppingOptions,
}

/// The K of `every=K`.
fn every(text: &str) -> Result<u64, String> {
    let number = text.strip_prefix("every=").and_then(|number| number.parse().ok());
    number
        .filter(|&number| number > 0)
        .ok_or_else(|| "expected every=K with a whole number K > 0".to_string())
}

impl Arguments {
    /// All settings in the order in which they act: `--set` first, then the options of their own.
    fn scene_settings(&self) -> Result<Vec<(String, String)>, Failure> {
        let mut settings: Vec<(String, String)> = self
            .settings
            .iter()
            .map(|text| scene::setting(text).map_err(scene_failure))
            .collect::<Result<_, _>>()?;
        let steps = self.steps.map(|steps| steps.to_string());
        let strict_max = self.strict_max.then(|| "true".to_string());
        let options = [
            ("time.steps", &steps),
            ("time.end", &self.until),
            ("solver.name", &self.solver),
            ("solver.tolerance", &self.tolerance),
            ("solver.strict_max", &strict_max),
            ("solver.friction", &self.friction),
        ];
        for (key, value) in options {
            settings.extend(value.as_ref().map(|value| (key.to_string(), value.clone())));
        }
        Ok(settings)
    }
}

pub fn execute(arguments: &Arguments, crew: &Crew) -> Result<ExitCode, Failure> {
    let Prepared { scene, run, resolved, threads } = crew.agree(prepare(arguments, crew))?;
    crew.agree_on(&run.settings, &run.world)?;
    // Nothing is written, or replaced, before every process has read what it needs.
    let recorder = if crew.writes() {
        record(arguments, &scene, &run.settings, &run.world, &resolved).map(Some)
    } else {
        Ok(None)
    };
    let recorder = crew.agree(recorder)?;
    make_steps(Begun { run, recorder, threads }, &arguments.stepping, crew)
}

/// A run before anything is written.
struct Prepared {
    scene: Scene,
    run: Run,
    /// The resolved scene.
    resolved: String,
    threads: Pool,
}

/// Reads the scene and builds the run.
fn prepare(arguments: &Arguments, crew: &Crew) -> Result<Prepared, Failure> {
    let scene = Scene::load(&arguments.scene, &arguments.scene_settings()?).map_err(scene_failure)?;
    let simulation = scene.build().map_err(scene_failure)?;
    let spins = |materials: &Materials| materials.spinning.iter().any(|resistance| !resistance.is_none());
    let of_stages = simulation.stages.iter().filter_map(|stage| stage.materials.as_ref());
    if arguments.dump_problem.is_some()
        && std::iter::once(&simulation.world.materials).chain(of_stages).any(spins)
    {
        return Err(Failure::input_error(
            std::io::Error::other(
                "problems with spinning friction cannot be written: FCLIB has no place for it",
            ),
            "take out --dump-problem, or spinning_friction of the scene",
        ));
    }
    let settings = RunSettings::new(&simulation, arguments.dump_problem);
    let resolved = simulation.resolved.to_toml().map_err(scene_failure)?;
    let run = Run::new(simulation.world, settings, RunTotals::default(), crew.stop_flag())
        .map_err(|error| Failure::input_error(error, ""))?;
    let threads = pool(crew.threads(arguments.stepping.threads))?;
    Ok(Prepared { scene, run, resolved, threads })
}

/// Takes the folder for the results and begins them.
fn record(
    arguments: &Arguments,
    scene: &Scene,
    settings: &RunSettings,
    world: &World,
    resolved: &str,
) -> Result<Recorder, Failure> {
    let folder = match &arguments.out {
        Some(folder) => folder.clone(),
        None => default_folder(&scene.name, arguments.force),
    };
    let taken = RunFolder::create(&folder, arguments.force).map_err(|error| {
        let remedy = match &error {
            PrepareError::Occupied(_) => "choose another --out, or replace what is there with --force",
            PrepareError::Output(error) => error.remedy(),
        };
        Failure::input_error(error, remedy)
    })?;
    if !arguments.stepping.quiet {
        say!(
            "{}: {}, {} of {} s, {} to residual {:.0e} -> {}\n",
            settings.scene,
            counted(world.bodies.len() as u64, "body", "bodies"),
            counted(settings.steps, "step", "steps"),
            settings.stepping.step,
            settings.stepping.solver.name,
            settings.stepping.solver.step_tolerance(),
            folder.display()
        );
    }
    Recorder::begin(taken, settings, world, resolved).map_err(output_failure)
}

/// `out/NAME`; where something is there, `out/NAME-2` and so on, unless it is to be replaced.
fn default_folder(name: &str, force: bool) -> PathBuf {
    let folder = Path::new("out").join(name);
    if force || !folder.exists() {
        return folder;
    }
    (2_u64..)
        .map(|number| Path::new("out").join(format!("{name}-{number}")))
        .find(|folder| !folder.exists())
        .unwrap_or(folder)
}
