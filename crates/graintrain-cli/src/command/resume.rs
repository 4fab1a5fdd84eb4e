//! `graintrain resume`: go on with a run that was stopped or killed.

use crate::closing::counted;
use crate::crew::Crew;
use crate::error::Failure;
use crate::solving;
use crate::stepping::{Begun, SteppingOptions, make_steps, output_failure};
use crate::terminal::{say, tell};
use crate::threads::{Pool, pool};
use graintrain::ccp::Criterion;
use graintrain_io::checkpoint::{self, CheckpointError};
use graintrain_io::mark::Marks;
use graintrain_io::output::folder::RunFolder;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::run::Run;
use graintrain_io::scene;
use std::path::PathBuf;
use std::process::ExitCode;

/// Continue a run that was stopped or killed, to the bits of an uninterrupted one
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  graintrain resume out/sedimentation\n  \
    graintrain resume out/sedimentation --steps 800     go further than planned\n  \
    graintrain resume out/sedimentation --until '0.2 s'\n\n\
    Exit codes as of `graintrain run`: 3 where the time of --max-seconds was up")]
pub struct Arguments {
    /// Folder of the run
    folder: PathBuf,
    /// Number of the last step, instead of the planned one
    #[arg(long, value_name = "N", conflicts_with = "until")]
    steps: Option<u64>,
    /// Simulated time at the end, in seconds or with a unit, instead of the planned one
    #[arg(long, value_name = "SECONDS", value_parser = scene::seconds, allow_hyphen_values = true)]
    until: Option<f64>,
    /// Go on with another contact solver
    #[arg(long, value_name = "NAME")]
    solver: Option<String>,
    /// Go on with another tolerance
    #[arg(long, value_name = "X")]
    tolerance: Option<f64>,
    /// Ask the tolerance of the worst contact from now on
    #[arg(long)]
    strict_max: bool,
    #[command(flatten)]
    stepping: SteppingOptions,
}

pub fn execute(arguments: &Arguments, crew: &Crew) -> Result<ExitCode, Failure> {
    let (taken, run, threads) = crew.agree(begin(arguments, crew))?;
    crew.agree_on(&run.settings, &run.world)?;
    if run.world.step >= run.settings.steps {
        say!(
            "nothing to do: the run has made {} of {} steps; --steps or --until take it further\n",
            run.world.step,
            run.settings.steps
        );
        return Ok(ExitCode::SUCCESS);
    }
    if !arguments.stepping.quiet {
        say!(
            "{}: {}, going on after step {} of {} in {}\n",
            run.settings.scene,
            counted(run.world.bodies.len() as u64, "body", "bodies"),
            run.world.step,
            run.settings.steps,
            arguments.folder.display()
        );
    }
    let recorder = crew.agree(taken.map(|(taken, marks)| record(taken, &run, &marks)).transpose())?;
    make_steps(Begun { run, recorder, threads }, &arguments.stepping, crew)
}

/// Where a run is written down, and what its files held.
type Written = (RunFolder, Marks);

/// The run where it was with its threads, and where this process is to write it down.
fn begin(arguments: &Arguments, crew: &Crew) -> Result<(Option<Written>, Run, Pool), Failure> {
    let folder = &arguments.folder;
    let checkpoints = folder.join("checkpoints");
    if !checkpoint::is_in(&checkpoints) {
        let scene = folder.join("scene.toml");
        let remedy = match scene.exists() {
            true => {
                format!("it had not begun: graintrain run {} --out {}", scene.display(), folder.display())
            }
            false => "resume takes the folder that `graintrain run` wrote".to_string(),
        };
        return Err(Failure::input_error(CheckpointError::None { folder: checkpoints }, remedy));
    }
    // Before the checkpoint is read: no other program may write a later one in between.
    let taken = if crew.writes() { Some(RunFolder::open(folder).map_err(output_failure)?) } else { None };
    let (checkpoint, defects) = checkpoint::latest(&checkpoints).map_err(|error| {
        let anew = format!("begin anew: graintrain run {0}/scene.toml --out {0} --force", folder.display());
        Failure::input_error(error, anew)
    })?;
    for defect in defects {
        tell!("warning: {defect}; an earlier checkpoint is used");
    }
    let (mut settings, world) = (checkpoint.settings, checkpoint.world);
    settings.steps = match (arguments.steps, arguments.until) {
        (Some(steps), _) => steps,
        // Whole steps up to round-off.
        (None, Some(end)) => (end / settings.stepping.step * (1.0 - 1e-12)).ceil().max(0.0) as u64,
        (None, None) => settings.steps,
    };
    if let Some(solver) = &arguments.solver {
        settings.stepping.solver.name = solving::solver_spec(solver)?;
    }
    settings.stepping.solver.tolerance = arguments.tolerance.unwrap_or(settings.stepping.solver.tolerance);
    if arguments.strict_max {
        settings.stepping.solver.criterion = Criterion::Maximum;
    }
    let run = Run::new(world, settings, checkpoint.totals, crew.stop_flag())
        .map_err(|error| Failure::input_error(error, "`graintrain solvers` lists the solvers"))?;
    let threads = pool(crew.threads(arguments.stepping.threads))?;
    Ok((taken.map(|taken| (taken, checkpoint.marks)), run, threads))
}

/// Goes on with the tables of the run.
fn record(taken: RunFolder, run: &Run, marks: &Marks) -> Result<Recorder, Failure> {
    let recorder = Recorder::resume(taken, &run.settings, &run.world, marks).map_err(output_failure)?;
    for loss in recorder.losses() {
        tell!("warning: {loss}");
    }
    Ok(recorder)
}
