//! `summary.json`: a run in one object.

use super::size::smallest_radius;
use crate::files::{OutputError, write_atomically};
use crate::process::peak_memory_bytes;
use crate::quantity::Figures;
use crate::run::{RunSettings, RunTotals};
use crate::stage::StageRecord;
use crate::stream::{Amount, StreamState};
use graintrain::world::World;
use graintrain_ccp::Ranks;
use graintrain_ccp::solver::ranks::Spent;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Whether the run reached its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RunStatus {
    /// It goes on, or was killed.
    Running,
    /// All steps are done.
    Finished,
    /// Somebody asked it to stop.
    Stopped,
    /// A step or an output failed, or a solve did not reach its tolerance where that was forbidden.
    Failed,
}

/// Wall-clock seconds of the phases of all steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Phases {
    /// Broad and narrow phase.
    pub collide: f64,
    /// Building the contact problems.
    pub assemble: f64,
    /// Solving them.
    pub solve: f64,
    /// Velocities, positions, rotations.
    pub integrate: f64,
    /// Writing files, telling progress.
    pub output: f64,
}

/// A run in figures. SI units. Sums and extremes are over all steps, those before an interruption included.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Version of the program.
    pub version: String,
    /// Name of the scene.
    pub scene: String,
    /// How the run ended.
    pub status: RunStatus,
    /// Solver asked for.
    pub solver: String,
    /// Residual asked for.
    pub tolerance: f64,
    /// Whether it was asked of the worst contact of a step, rather than of the root mean square with a bound
    /// for the worst.
    pub strict_max: bool,
    /// Friction model.
    pub friction: graintrain_ccp::FrictionModel,
    /// What became of overlap.
    pub overlap: graintrain::assemble::OverlapCorrection,
    /// Time step, s.
    pub step: f64,
    /// Threads of the last session.
    pub threads: usize,
    /// Number of bodies.
    pub bodies: usize,
    /// Steps done.
    pub steps: u64,
    /// s.
    pub simulated_seconds: f64,
    /// s.
    pub wall_seconds: f64,
    /// Processor seconds of all threads; null where the system does not tell.
    pub cpu_seconds: Option<f64>,
    /// Wall-clock seconds per phase.
    pub phases: Phases,
    /// What the steps come to: one key each.
    #[serde(flatten)]
    pub figures: Figures,
    /// Share of the contacts with force that pressed though their bodies were apart in the whole step.
    #[serde(default)]
    pub contacts_apart_share: f64,
    /// Largest overlap that displacements worked on, over the smallest radius of the bodies that forces can
    /// move.
    pub overlap_corrected_max_over_radius: f64,
    /// The stages that have begun.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageRecord>,
    /// Names of those that had not begun.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages_left: Vec<String>,
    /// What came through streams.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub streams: Vec<StreamSummary>,
    /// What left through outlets.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outlets: Vec<OutletSummary>,
    /// Kinetic energy at the end, J.
    pub kinetic_energy: f64,
    /// Largest resident memory of the process, bytes; null where the system does not tell.
    pub peak_memory_bytes: Option<u64>,
    /// Hash of the final state's bits, hexadecimal.
    pub state_hash: String,
    /// The processes of the last session, where it had several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ranks: Option<RankSummary>,
}

/// What several processes shared, and what that cost; of the last session, up to its end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RankSummary {
    /// Number of processes.
    pub ranks: usize,
    /// Contacts that the busiest of them passed over in shared solves, over the mean; 1 where they shared
    /// none.
    pub imbalance: f64,
    /// Bytes that all of them sent.
    pub communication_bytes: u64,
    /// Seconds in communication, with waiting for those that come later; mean over the processes.
    pub communication_seconds: f64,
    /// The same of the process that spent most.
    pub communication_seconds_max: f64,
}

impl RankSummary {
    /// What the ranks have spent so far. Every rank has to ask at the same time.
    pub fn of(ranks: &Ranks) -> Self {
        let Spent { bytes, seconds, contacts } = ranks.spent();
        let [bytes, contacts] = [bytes, contacts].map(|mine| ranks.numbers(mine));
        let seconds: Vec<f64> = ranks.numbers(seconds.to_bits()).into_iter().map(f64::from_bits).collect();
        let (count, sum) = (ranks.count() as f64, contacts.iter().sum::<u64>());
        let busiest = contacts.into_iter().max().unwrap_or_default();
        Self {
            ranks: ranks.count(),
            imbalance: if sum == 0 { 1.0 } else { busiest as f64 * count / sum as f64 },
            communication_bytes: bytes.iter().sum(),
            communication_seconds: seconds.iter().sum::<f64>() / count,
            communication_seconds_max: seconds.iter().copied().fold(0.0, f64::max),
        }
    }
}

/// A stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamSummary {
    /// Its name.
    pub name: String,
    /// Bodies that it gave.
    pub bodies: u64,
    /// Their mass, kg.
    pub mass: f64,
    /// Whether it gave all.
    pub is_done: bool,
    /// Steps in which a body found no free place and waited.
    pub steps_waited: u64,
}

impl StreamSummary {
    fn of(settings: &RunSettings, totals: &RunTotals) -> Vec<Self> {
        let streams = settings.open_boundaries.streams.iter().enumerate();
        let state = |index: usize| totals.open_boundaries.streams.get(index).copied().unwrap_or_default();
        streams
            .map(|(index, stream)| {
                let StreamState { given, is_done, steps_waited, .. } = state(index);
                Self {
                    name: stream.name.clone(),
                    bodies: given.bodies,
                    mass: given.mass,
                    is_done,
                    steps_waited,
                }
            })
            .collect()
    }
}

/// An outlet.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutletSummary {
    /// Its name.
    pub name: String,
    /// Bodies that left.
    pub bodies: u64,
    /// Their mass, kg.
    pub mass: f64,
}

impl OutletSummary {
    fn of(settings: &RunSettings, totals: &RunTotals) -> Vec<Self> {
        let outlets = settings.open_boundaries.outlets.iter().enumerate();
        let gone = |index: usize| totals.open_boundaries.outlets.get(index).copied().unwrap_or_default();
        outlets
            .map(|(index, outlet)| {
                let Amount { bodies, mass, .. } = gone(index);
                Self { name: outlet.name.clone(), bodies, mass }
            })
            .collect()
    }
}

impl Summary {
    /// The figures of a run so far.
    pub fn new(world: &World, settings: &RunSettings, totals: &RunTotals, status: RunStatus) -> Self {
        let figures = &totals.figures;
        // Without a movable body there is nothing to correct.
        let radius = smallest_radius(world).filter(|&radius| radius > 0.0).unwrap_or(f64::INFINITY);
        Self {
            version: env!("CARGO_PKG_VERSION").to_string(),
            scene: settings.scene.clone(),
            status,
            solver: settings.stepping.solver.name.to_string(),
            tolerance: settings.stepping.solver.step_tolerance(),
            strict_max: settings.stepping.solver.criterion == graintrain_ccp::Criterion::Maximum,
            friction: settings.stepping.solver.friction,
            overlap: settings.stepping.overlap,
            step: settings.stepping.step,
            threads: rayon::current_num_threads(),
            bodies: world.bodies.len(),
            steps: world.step,
            simulated_seconds: world.time,
            wall_seconds: totals.wall_seconds,
            cpu_seconds: totals.cpu_seconds,
            phases: Phases {
                collide: totals.phases.collide,
                assemble: totals.phases.assemble,
                solve: totals.phases.solve,
                integrate: totals.phases.integrate,
                output: totals.output_seconds,
            },
            contacts_apart_share: figures.contacts_apart as f64
                / figures.contacts_with_force_sum.max(1) as f64,
            overlap_corrected_max_over_radius: figures.overlap_corrected_max / radius,
            figures: figures.clone(),
            stages: totals.stages.clone(),
            stages_left: settings.stages.iter().skip(totals.stages.len()).map(|s| s.name.clone()).collect(),
            streams: StreamSummary::of(settings, totals),
            outlets: OutletSummary::of(settings, totals),
            kinetic_energy: world.kinetic_energy(),
            peak_memory_bytes: peak_memory_bytes(),
            state_hash: format!("{:016x}", world.state_hash()),
            ranks: None,
        }
    }

    /// Writes it as `summary.json` into the folder.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), OutputError> {
        let path = folder.join("summary.json");
        let text = serde_json::to_string_pretty(self)
            .map_err(|error| OutputError::new("write", &path, error.into()))?;
        write_atomically(&path, format!("{text}\n").as_bytes())
    }
}
