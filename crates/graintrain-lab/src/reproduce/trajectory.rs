//! Simulations of the paper's scenes with the fastest solver: physical outputs, and states at which solvers
//! are compared.

use super::ReproduceError;
use graintrain::math::{Mat3, Vec3};
use graintrain::shape::{Cuboid, Shape};
use graintrain::stepper::{StepError, StepReport, Stepper};
use graintrain::world::World;
use graintrain_io::checkpoint;
use graintrain_io::files::{make_folder, write_atomically};
use graintrain_io::run::{RunSettings, RunTotals};
use graintrain_io::scene::{Scene, builtin};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// One of the paper's experiments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Experiment {
    /// Spheres dropped into a box with a rotating mixer.
    Sedimentation,
    /// A blade driven through a container of spheres.
    Drafting,
    /// A split box whose lower half is driven.
    DirectShear,
}

impl Experiment {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Sedimentation, Self::Drafting, Self::DirectShear];

    /// Name of the built-in scene.
    pub fn scene(self) -> &'static str {
        match self {
            Self::Sedimentation => "sedimentation",
            Self::Drafting => "drafting",
            Self::DirectShear => "direct-shear",
        }
    }

    /// Name of the driven body whose force is the output.
    pub fn tool(self) -> &'static str {
        match self {
            Self::Sedimentation => "mixer",
            Self::Drafting => "blade",
            Self::DirectShear => "lower",
        }
    }
}

/// How a simulation differs from the paper's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// As in the paper: relaxed friction, the scene's own step.
    Paper,
    /// Exact Coulomb friction.
    Coulomb,
    /// Half the scene's time step.
    HalfStep,
    /// A tenth of the solver's tolerance.
    TenthTolerance,
}

impl Variant {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Paper, Self::Coulomb, Self::HalfStep, Self::TenthTolerance];

    /// Name in files and legends.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "relaxed",
            Self::Coulomb => "coulomb",
            Self::HalfStep => "half-step",
            Self::TenthTolerance => "tenth-tolerance",
        }
    }
}

/// One step of a simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// s.
    pub time: f64,
    /// Contacts in the envelope.
    pub contacts: usize,
    /// Contacts with force.
    pub loaded: usize,
    /// Part of the contacts that the step before had too.
    pub persistent: f64,
    /// Residual of the contact problem.
    pub residual: f64,
    /// Seconds of the solve.
    pub solve_seconds: f64,
    /// Largest overlap, m.
    pub penetration: f64,
    /// Kinetic energy, J.
    pub kinetic_energy: f64,
    /// Contact force on the tool, N.
    pub force: [f64; 3],
    /// Contact torque on the tool, N m.
    pub torque: [f64; 3],
    /// Position of the tool, m.
    pub place: [f64; 3],
    /// Velocity of the tool, m/s.
    pub velocity: [f64; 3],
    /// Height of the press, m; absent where the scene has none.
    pub press: Option<f64>,
    /// Weight of the grains whose centres lie below the plane between the halves of the shear box, N; absent
    /// elsewhere.
    #[serde(default)]
    pub weight_below: Option<f64>,
    /// Change of a free body's momentum minus the impulses of gravity and contacts, over the sum of their
    /// sizes; the worst body.
    pub momentum_error: f64,
}

/// A simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    /// Bodies.
    pub bodies: usize,
    /// Time step, s.
    pub step: f64,
    /// Steps whose states (before the step) were stored.
    pub samples: Vec<u64>,
    /// Steps.
    pub rows: Vec<Row>,
}

/// What is simulated.
#[derive(Clone, Copy, Debug)]
pub struct Simulate {
    /// Scene.
    pub experiment: Experiment,
    /// Size parameter.
    pub n: usize,
    /// Steps of the paper's length; `None` takes the default of the experiment.
    pub steps: Option<u64>,
    /// Difference from the paper.
    pub variant: Variant,
    /// Of the lattice's perturbation; 1 is the scene's own.
    pub seed: u64,
}

impl Simulate {
    /// Name of the cell. It holds a checksum (32-bit FNV-1a) of the scene, so that a changed scene is
    /// simulated anew.
    pub fn key(&self) -> String {
        let steps = self.steps.map_or("default".to_string(), |steps| steps.to_string());
        let scene = self.experiment.scene();
        let text = builtin::find(scene).map_or("", |scene| scene.text);
        let checksum =
            text.bytes().fold(0x811c_9dc5_u32, |sum, byte| (sum ^ u32::from(byte)).wrapping_mul(0x0100_0193));
        let name = format!("{scene}@{checksum:08x}/n={}/steps={steps}/{}", self.n, self.variant.name());
        format!(
            "trajectory/{name}{}",
            if self.seed == 1 { String::new() } else { format!("/seed={}", self.seed) }
        )
    }

    /// Makes the steps and stores the states before `samples` of them, evenly spread, under `states`. About
    /// once a minute, and where it is stopped, the simulation is put aside there, and a later call with the
    /// same folder goes on with it.
    ///
    /// # Errors
    /// [`ReproduceError`] for a scene, step or file that fails, or a stop request.
    pub fn run(
        &self,
        samples: usize,
        states: &Path,
        stop: &Arc<AtomicBool>,
        mut progress: impl FnMut(u64, u64),
    ) -> Result<Trajectory, ReproduceError> {
        let simulation = self.scene()?.build()?;
        let run = RunSettings::new(&simulation, None);
        let finer = if self.variant == Variant::HalfStep { 2 } else { 1 };
        let standard = match self.experiment {
            Experiment::Sedimentation => 120,
            Experiment::Drafting | Experiment::DirectShear => simulation.steps / finer,
        };
        let steps = finer * self.steps.unwrap_or(standard);
        let sampled: Vec<u64> =
            (1..=samples as u64).map(|k| (k * steps / samples as u64).max(1) - 1).collect();
        let step = simulation.settings.step;
        let aside = Aside { folder: states.join("under-way"), key: self.key() };
        let (mut world, mut rows) = aside.take().unwrap_or_else(|| {
            // States of another simulation must not be taken for this one's.
            aside.clear();
            (simulation.world, Vec::new())
        });
        let mut stepper = Stepper::new(simulation.settings)?;
        stepper.stop_on(Arc::clone(stop));
        let tool = find(&world, self.experiment.tool());
        let press = find(&world, "press");
        // The upper half of the shear box stands on the plane between the halves.
        let split = find(&world, "upper").map(|body| lowest(&world, body));
        let mut known = identities(&world);
        let mut saved = Instant::now();
        for k in world.step..steps {
            progress(k, steps);
            if sampled.contains(&k) {
                checkpoint::write(&self.state_folder(states, k), &run, &RunTotals::default(), &world)?;
            }
            if saved.elapsed() >= SAVE_EVERY {
                aside.put(&run, &world, &rows)?;
                saved = Instant::now();
            }
            let before = world.bodies.velocity.clone();
            let report = match stepper.step(&mut world) {
                Ok(report) => report,
                Err(error) => {
                    if matches!(error, StepError::Stopped) {
                        aside.put(&run, &world, &rows)?;
                    }
                    return Err(error.into());
                }
            };
            let mut row = row(&world, &report, &known, tool, press);
            row.weight_below = split.map(|height| weight_below(&world, height));
            row.momentum_error = momentum_error(&world, &before, step);
            rows.push(row);
            known = identities(&world);
        }
        aside.clear();
        Ok(Trajectory { bodies: world.bodies.len(), step, samples: sampled, rows })
    }

    /// The scene with what differs from the paper.
    fn scene(&self) -> Result<Scene, ReproduceError> {
        let set = |key: &str, value: &str| (key.to_string(), value.to_string());
        // Overlap is removed and friction relaxed as in the paper, whatever the defaults have become.
        let friction = if self.variant == Variant::Coulomb { "coulomb" } else { "relaxed" };
        let mut settings = vec![
            set("n", &self.n.to_string()),
            set("seed", &self.seed.to_string()),
            set("contact.overlap", "velocity"),
            set("solver.friction", friction),
        ];
        let name = self.experiment.scene();
        match self.variant {
            Variant::Paper | Variant::Coulomb => {}
            Variant::HalfStep => {
                let own = Scene::load(name, &settings)?.build()?.settings.step;
                settings.push(set("time.step", &format!("{} s", own / 2.0)));
            }
            Variant::TenthTolerance => settings.push(set("solver.tolerance", "1e-4")),
        }
        Ok(Scene::load(name, &settings)?)
    }

    /// Whether the states that a finished simulation stored are still there.
    pub fn has_states(&self, states: &Path, trajectory: &Trajectory) -> bool {
        trajectory.samples.iter().all(|&step| checkpoint::latest(&self.state_folder(states, step)).is_ok())
    }

    /// Folder of the state before a step.
    pub fn state_folder(&self, states: &Path, step: u64) -> PathBuf {
        states.join(format!("{}-n{}-{}-{step:06}", self.experiment.scene(), self.n, self.variant.name()))
    }
}

/// How often a simulation is put aside.
const SAVE_EVERY: Duration = Duration::from_secs(60);

/// A simulation that is under way, on disk.
struct Aside {
    folder: PathBuf,
    key: String,
}

impl Aside {
    /// Rows come before the state that belongs to them: a kill between leaves too many rows, never too few.
    fn put(&self, run: &RunSettings, world: &World, rows: &[Row]) -> Result<(), ReproduceError> {
        make_folder(&self.folder)?;
        let path = self.folder.join("rows.json");
        let failed =
            |error: serde_json::Error| ReproduceError::File { path: path.clone(), source: error.into() };
        let text = serde_json::to_vec(&(&self.key, rows)).map_err(failed)?;
        write_atomically(&path, &text)?;
        checkpoint::write(&self.folder, run, &RunTotals::default(), world)?;
        Ok(())
    }

    /// The state and the rows before it, if this very simulation was put aside whole.
    fn take(&self) -> Option<(World, Vec<Row>)> {
        let text = std::fs::read(self.folder.join("rows.json")).ok()?;
        let (key, mut rows) = serde_json::from_slice::<(String, Vec<Row>)>(&text).ok()?;
        let (checkpoint, _) = checkpoint::latest(&self.folder).ok()?;
        let steps = usize::try_from(checkpoint.world.step).ok()?;
        rows.truncate(steps);
        (key == self.key && rows.len() == steps).then_some((checkpoint.world, rows))
    }

    /// Forgets it.
    fn clear(&self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

fn identities(world: &World) -> HashSet<u64> {
    world.contacts.contacts.iter().map(|contact| contact.identity).collect()
}

fn find(world: &World, name: &str) -> Option<usize> {
    world.bodies.name.iter().position(|known| known == name)
}

fn row(
    world: &World,
    report: &StepReport,
    known: &HashSet<u64>,
    tool: Option<usize>,
    press: Option<usize>,
) -> Row {
    let contacts = &world.contacts.contacts;
    let kept = contacts.iter().filter(|contact| known.contains(&contact.identity)).count();
    let wrench = report.wrenches.iter().find(|wrench| Some(wrench.body.index()) == tool);
    let of_tool = |values: &[Vec3]| tool.map_or([0.0; 3], |body| values[body].to_array());
    Row {
        time: world.time,
        contacts: report.contacts,
        loaded: report.contacts_with_force,
        persistent: kept as f64 / contacts.len().max(1) as f64,
        residual: report.solve.residual.max,
        solve_seconds: report.phases.solve,
        penetration: report.penetration_max,
        kinetic_energy: report.kinetic_energy,
        force: wrench.map_or([0.0; 3], |wrench| wrench.force.to_array()),
        torque: wrench.map_or([0.0; 3], |wrench| wrench.torque.to_array()),
        place: of_tool(&world.bodies.position),
        velocity: of_tool(&world.bodies.velocity),
        press: press.map(|body| world.bodies.position[body].z),
        weight_below: None,
        momentum_error: 0.0,
    }
}

/// Height of the lowest point of a body of boxes, m.
fn lowest(world: &World, body: usize) -> f64 {
    let (place, turn) = (world.bodies.position[body], world.bodies.orientation[body]);
    let parts = &world.geometries[world.bodies.geometry[body].index()].parts;
    let lowest = parts.iter().filter_map(|part| {
        let Shape::Box(Cuboid { half }) = part.shape else { return None };
        let axes = Mat3::from_quat(turn * part.orientation);
        let reach = axes.row(2).abs().dot(half);
        Some((place + turn * part.position).z - reach)
    });
    lowest.fold(f64::INFINITY, f64::min)
}

/// Weight of the free bodies whose centres lie below a height, N.
fn weight_below(world: &World, height: f64) -> f64 {
    let bodies = &world.bodies;
    let below = (0..bodies.len()).filter(|&body| world.is_free(body) && bodies.position[body].z < height);
    world.gravity.length() * below.map(|body| bodies.mass[body]).sum::<f64>()
}

/// Newton's second law of every body that is free in all directions: the largest of
/// |m (u+ - u) - dt m g - sum of impulses| over m |g| dt + sum of |impulses|.
fn momentum_error(world: &World, before: &[Vec3], step: f64) -> f64 {
    let bodies = &world.bodies;
    let mut pushed = vec![Vec3::ZERO; bodies.len()];
    let mut pushed_by: Vec<f64> =
        bodies.mass.iter().map(|mass| mass * world.gravity.length() * step).collect();
    for (contact, &impulse) in world.contacts.contacts.iter().zip(&world.contacts.impulse) {
        for (body, sign) in [(contact.body_a as usize, 1.0), (contact.body_b as usize, -1.0)] {
            pushed[body] += sign * impulse;
            pushed_by[body] += impulse.length();
        }
    }
    let free = (0..bodies.len()).filter(|&body| world.is_free(body));
    free.map(|body| {
        let gained = bodies.mass[body] * (bodies.velocity[body] - before[body] - step * world.gravity);
        (gained - pushed[body]).length() / pushed_by[body].max(f64::MIN_POSITIVE)
    })
    .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plane_between_the_halves_is_where_the_scene_puts_it() {
        let simulate = Simulate {
            experiment: Experiment::DirectShear,
            n: 3,
            steps: None,
            variant: Variant::Paper,
            seed: 1,
        };
        let world = simulate.scene().unwrap().build().unwrap().world;
        let split = lowest(&world, find(&world, "upper").unwrap());
        // Half of 0.55 of the height of seven lattice pitches.
        assert!((split - 0.5 * 0.55 * 7.0 * 0.23).abs() < 1e-12, "{split}");
        // 70 grains per layer of the lattice, at 0.115 m + k 0.23 m: the jitter of 12 mm takes none across
        // the plane.
        let grain = 4.0 / 3.0 * std::f64::consts::PI * 1e-3 * 1000.0 * world.gravity.length();
        let layers = (0..7).filter(|k| 0.115 + 0.23 * f64::from(*k) < split).count();
        assert!((weight_below(&world, split) / grain / 70.0 - layers as f64).abs() < 1e-9);
    }
}
