//! The drop: states of one sedimentation in free fall, falling and settled, and the contact problems of steps
//! from there.

use crate::reproduce::ReproduceError;
use crate::reproduce::solves::Problems;
use graintrain::stepper::Stepper;
use graintrain_ccp::delassus::BodyInverseMass;
use graintrain_ccp::{Ccp, Delassus, RigidDelassus};
use graintrain_io::checkpoint;
use graintrain_io::run::{RunSettings, RunTotals};
use graintrain_io::scene::Scene;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A stage of the drop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Before any grain has met the floor: all contacts of the envelope are open.
    FreeFall,
    /// The lowest layers are stopped, the upper ones fall.
    Falling,
    /// At rest but for the mixer.
    Settled,
}

impl Phase {
    /// All of them, in their order.
    pub const ALL: [Self; 3] = [Self::FreeFall, Self::Falling, Self::Settled];

    /// Name in tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::FreeFall => "free-fall",
            Self::Falling => "falling",
            Self::Settled => "settled",
        }
    }

    /// Steps of 25 ms before the one that is studied.
    fn steps(self) -> u64 {
        match self {
            Self::FreeFall => 2,
            Self::Falling => 12,
            Self::Settled => 119,
        }
    }
}

/// Density of the drop, kg/m^3. See [`of_density`] for others.
const DENSITY: f64 = 1000.0;

/// One sedimentation of (2n + 1)^3 spheres; states are kept in a folder.
#[derive(Clone, Debug)]
pub struct Drop {
    n: usize,
    folder: PathBuf,
}

impl Drop {
    /// Of size n, with its states in this folder.
    pub fn new(n: usize, folder: &Path) -> Self {
        Self { n, folder: folder.to_path_buf() }
    }

    fn state(&self, phase: Phase) -> PathBuf {
        self.folder.join(format!("drop-n{}-{}", self.n, phase.name()))
    }

    /// Simulates up to a phase where its state is not there yet, and stores the states on the way. `progress`
    /// gets the step and the number of steps.
    ///
    /// # Errors
    /// [`ReproduceError`] for a step or file that fails, or a stop request.
    pub fn prepare(
        &self,
        phase: Phase,
        stop: &Arc<AtomicBool>,
        mut progress: impl FnMut(u64, u64),
    ) -> Result<(), ReproduceError> {
        if checkpoint::latest(&self.state(phase)).is_ok() {
            return Ok(());
        }
        let set = |key: &str, value: &str| (key.to_string(), value.to_string());
        let settings = [
            set("n", &self.n.to_string()),
            set("density", &format!("{DENSITY} kg/m^3")),
            set("contact.overlap", "velocity"),
            set("solver.friction", "relaxed"),
        ];
        let simulation = Scene::load("sedimentation", &settings)?.build()?;
        let run = RunSettings::new(&simulation, None);
        let earlier = Phase::ALL.into_iter().filter(|before| before.steps() < phase.steps()).rev();
        let known = earlier.filter_map(|before| checkpoint::latest(&self.state(before)).ok()).next();
        let mut world = known.map_or(simulation.world, |(checkpoint, _)| checkpoint.world);
        let mut stepper = Stepper::new(simulation.settings)?;
        stepper.stop_on(Arc::clone(stop));
        loop {
            if let Some(reached) = Phase::ALL.into_iter().find(|reached| reached.steps() == world.step) {
                checkpoint::write(&self.state(reached), &run, &RunTotals::default(), &world)?;
                if reached == phase {
                    return Ok(());
                }
            }
            progress(world.step, phase.steps());
            stepper.step(&mut world)?;
        }
    }

    /// The contact problem of the step after a phase's state, with another envelope (m) and density (kg/m^3);
    /// `None` without contacts.
    ///
    /// # Errors
    /// [`ReproduceError`] where the state is missing or damaged, or the step fails.
    pub fn problem(
        &self,
        phase: Phase,
        envelope: f64,
        density: f64,
        stop: &Arc<AtomicBool>,
    ) -> Result<Option<Ccp>, ReproduceError> {
        let problem = Problems::open_with_envelope(&self.state(phase), envelope, stop)?.advance()?;
        Ok(problem.map(|(_, problem)| of_density(&problem, density / DENSITY)))
    }
}

/// The same state of grains that are `ratio` times as heavy: N is divided by the ratio. Among prescribed
/// walls and grains of one density nothing else changes: velocities, and so r and the next states, do not
/// depend on the density.
pub(super) fn of_density(problem: &Ccp, ratio: f64) -> Ccp {
    let delassus = match &*problem.delassus {
        Delassus::Rigid(rigid) => {
            let lighter = rigid.inverse_mass().iter().map(|body| BodyInverseMass {
                linear: body.linear.map(|x| x / ratio),
                angular: body.angular.map(|x| x / ratio),
            });
            Delassus::Rigid(RigidDelassus::new(rigid.contacts().to_vec(), lighter.collect()))
        }
        Delassus::Sparse(matrix) => {
            let mut lighter = matrix.clone();
            for block in lighter.blocks_mut() {
                *block = block.map(|x| x / ratio);
            }
            Delassus::Sparse(lighter)
        }
    };
    Ccp { delassus: Arc::new(delassus), ..problem.clone() }
}
