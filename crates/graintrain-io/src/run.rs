//! The run: steps one after another, watched by observers, until the end or until somebody asks to stop.

use crate::files::OutputError;
use crate::measure::{Measure, MeasureState, Measured};
use crate::open_boundaries::{OpenBoundaries, OpenBoundaryState};
use crate::process::cpu_seconds;
use crate::quantity::Figures;
use crate::scene::Simulation;
use crate::settings::OutputSettings;
use crate::stage::{Progress, Stage, StageRecord};
use crate::stream::Moment;
use graintrain::collide::Collider;
use graintrain::math::Vec3;
use graintrain::measure::energy::Ledger;
use graintrain::stepper::{PhaseSeconds, StepError, StepReport, StepSettings, Stepper};
use graintrain::world::World;
use graintrain_ccp::{Ccp, Criterion, Ranks};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Everything about a run but the state: what `resume` needs to go on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunSettings {
    /// Name of the scene.
    pub scene: String,
    /// How steps are made.
    pub stepping: StepSettings,
    /// Number of the last step.
    pub steps: u64,
    /// What is written.
    pub output: OutputSettings,
    /// The stages; none is one without end.
    pub stages: Vec<Stage>,
    /// What is measured.
    pub measures: Vec<Measure>,
    /// Ways in and out for bodies.
    pub open_boundaries: OpenBoundaries,
    /// Steps from one dumped contact problem to the next; `None` dumps none.
    pub dump_problem_every: Option<u64>,
}

impl RunSettings {
    /// The settings of a scene's simulation.
    pub fn new(simulation: &Simulation, dump_problem_every: Option<u64>) -> Self {
        Self {
            scene: simulation.resolved.name.clone(),
            stepping: simulation.settings.clone(),
            steps: simulation.steps,
            output: simulation.output.clone(),
            stages: simulation.stages.clone(),
            measures: simulation.measures.clone(),
            open_boundaries: simulation.open_boundaries.clone(),
            dump_problem_every,
        }
    }
}

/// Sums and extremes over the steps of a run, those before an interruption included.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunTotals {
    /// Wall-clock seconds.
    pub wall_seconds: f64,
    /// Processor seconds of all threads; `None` where the system does not tell.
    pub cpu_seconds: Option<f64>,
    /// Seconds per phase.
    pub phases: PhaseSeconds,
    /// Seconds in observers.
    pub output_seconds: f64,
    /// Seconds in observers after the last step.
    pub last_output_seconds: f64,
    /// What the steps come to, in figures.
    pub figures: Figures,
    /// What changed the kinetic energy, summed; work of loads included.
    pub ledger: Ledger,
    /// The stages that have begun.
    pub stages: Vec<StageRecord>,
    /// What measurements remember, in their order.
    pub measured: Vec<MeasureState>,
    /// The latest records of what is to be steady in the stage under way.
    pub latest: Vec<f64>,
    /// Bodies that came and went.
    pub open_boundaries: OpenBoundaryState,
}

impl RunTotals {
    /// Adds a step, which had this number.
    fn add(&mut self, step: u64, report: &StepReport) {
        let phases = &report.phases;
        self.phases.collide += phases.collide;
        self.phases.assemble += phases.assemble;
        self.phases.solve += phases.solve;
        self.phases.integrate += phases.integrate;
        self.figures.add(step, report);
        self.ledger.add(&report.ledger);
    }
}

/// What observers see after a step.
#[derive(Clone, Copy)]
pub struct StepView<'a> {
    /// The state after the step.
    pub world: &'a World,
    /// What the step did.
    pub report: &'a StepReport,
    /// The run so far, this step included.
    pub totals: &'a RunTotals,
    /// Records of the measurements that were due, with the numbers of those: the rows of their columns.
    pub measured: &'a [(usize, Vec<Vec<f64>>)],
    /// The step's contact problem and the impulses found.
    pub problem: Option<(&'a Ccp, &'a [f64])>,
}

/// Watches a run: writes files, shows progress.
pub trait Observer {
    /// Called after every step.
    ///
    /// # Errors
    /// An output that cannot be written ends the run.
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError>;

    /// Called once everybody has seen the step and all that belongs to it is counted: the state is now one to
    /// go on from.
    ///
    /// # Errors
    /// A state that cannot be kept ends the run.
    fn keep(&mut self, world: &World, totals: &RunTotals) -> Result<(), OutputError> {
        let _ = (world, totals);
        Ok(())
    }
}

/// How [`Run::advance`] ended without an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All steps are done.
    Finished,
    /// The stop flag was set.
    Stopped,
}

/// Why a run ended early. Its state is that after the last complete step.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// A step could not be made.
    #[error(transparent)]
    Step(#[from] StepError),
    /// A solve did not reach its tolerance, which [`Run::strict`] forbids.
    #[error(
        "step {step}: {solver} stopped above the tolerance {tolerance:.2e} {}, at residual {residual:.2e}, rms {residual_rms:.2e}",
        tolerance_rule(*criterion)
    )]
    NotConverged {
        /// Number of the step.
        step: u64,
        /// Solver.
        solver: String,
        /// Residual reached, of the worst contact.
        residual: f64,
        /// Its root mean square over the contacts.
        residual_rms: f64,
        /// Residual asked for.
        tolerance: f64,
        /// Which of the two was held against it.
        criterion: Criterion,
    },
    /// An output could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Processes that make the same steps have not the same state: they read different files, or run
    /// different programs.
    #[error("after step {step} rank {rank} has another state than rank 0")]
    RanksDisagree {
        /// Number of the last step made.
        step: u64,
        /// The first rank whose state is not that of rank 0.
        rank: usize,
    },
}

/// What a tolerance is of, in words.
pub fn tolerance_rule(criterion: Criterion) -> &'static str {
    match criterion {
        Criterion::Maximum => "of the worst contact",
        Criterion::Mixed => "of the rms (20 times that for the worst contact)",
    }
}

/// A simulation under way.
pub struct Run {
    /// The state.
    pub world: World,
    /// What was asked for.
    pub settings: RunSettings,
    /// The run so far.
    pub totals: RunTotals,
    /// Whether a solve that does not reach its tolerance ends the run.
    pub strict: bool,
    stepper: Stepper,
    /// Looks for free places.
    collider: Collider,
    stop: Arc<AtomicBool>,
    ranks: Option<Arc<Ranks>>,
}

impl Run {
    /// A run from this state. It ends early, with a state from which it can go on, once `stop` is set.
    ///
    /// # Errors
    /// [`StepError`] for settings out of range or an unknown solver.
    pub fn new(
        world: World,
        settings: RunSettings,
        totals: RunTotals,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, StepError> {
        let mut stepper = Stepper::new(settings.stepping.clone())?;
        stepper.stop_on(Arc::clone(&stop));
        let collider = Collider::default();
        Ok(Self { world, settings, totals, strict: false, stepper, collider, stop, ranks: None })
    }

    /// Makes the steps together with other processes, each of which runs the same from the same state. All of
    /// them end where one is asked to stop.
    pub fn share_among(&mut self, ranks: Arc<Ranks>) {
        self.stop = ranks.stop();
        self.stepper.share_among(Arc::clone(&ranks));
        self.ranks = Some(ranks);
    }

    /// The contact problem of the last step and the impulses found (length 3 N_c, contact frames, N s).
    pub fn last_problem(&self) -> Option<(&Ccp, &[f64])> {
        self.stepper.last_problem()
    }

    /// Makes the remaining steps, showing each to the observers in turn.
    ///
    /// # Errors
    /// [`RunError`]; the state is then that after the last complete step.
    pub fn advance(&mut self, observers: &mut [&mut dyn Observer]) -> Result<Ending, RunError> {
        let clocks = Clocks::begin(&self.totals);
        let ending = self.steps(observers, &clocks);
        clocks.count(&mut self.totals);
        ending
    }

    fn steps(&mut self, observers: &mut [&mut dyn Observer], clocks: &Clocks) -> Result<Ending, RunError> {
        while self.world.step < self.settings.steps {
            self.meet_ranks()?;
            if self.stop.load(Ordering::Relaxed) {
                return Ok(Ending::Stopped);
            }
            if !self.begin_stage()? {
                return Ok(Ending::Finished);
            }
            self.exchange_bodies()?;
            let velocity = self.compares_velocities().then(|| {
                (0..self.world.bodies.len()).map(|body| self.world.fluctuation(body)).collect::<Vec<_>>()
            });
            let before = self.follows_bodies().then(|| self.world.bodies.position.clone());
            let report = match self.stepper.step(&mut self.world) {
                Err(StepError::Stopped) => return Ok(Ending::Stopped),
                result => result?,
            };
            self.totals.add(self.world.step, &report);
            let measured = self.measure(before.as_deref());
            self.note_latest(&measured);
            self.end_stage(velocity.as_deref());
            clocks.count(&mut self.totals);
            let begin = Instant::now();
            for observer in &mut *observers {
                observer.observe(StepView {
                    world: &self.world,
                    report: &report,
                    totals: &self.totals,
                    measured: &measured,
                    problem: self.stepper.last_problem(),
                })?;
            }
            self.totals.last_output_seconds = begin.elapsed().as_secs_f64();
            self.totals.output_seconds += self.totals.last_output_seconds;
            for observer in &mut *observers {
                observer.keep(&self.world, &self.totals)?;
            }
            if self.strict && !report.solve.converged() {
                // Contacts within the tolerance: then it was the impacts.
                let residual = report.solve.residual.worse(report.impact_residual);
                return Err(RunError::NotConverged {
                    step: self.world.step,
                    solver: report.solve.solver,
                    residual: residual.max,
                    residual_rms: residual.rms,
                    tolerance: self.settings.stepping.solver.step_tolerance(),
                    criterion: self.settings.stepping.solver.criterion,
                });
            }
        }
        self.meet_ranks()?;
        Ok(Ending::Finished)
    }

    /// Agrees with the other ranks on whether to stop, and makes sure that they are where this one is.
    fn meet_ranks(&self) -> Result<(), RunError> {
        let Some(ranks) = &self.ranks else { return Ok(()) };
        ranks.agree_to_stop();
        let hashes = ranks.numbers(self.world.state_hash());
        match hashes.iter().position(|hash| *hash != hashes[0]) {
            Some(rank) => Err(RunError::RanksDisagree { step: self.world.step, rank }),
            None => Ok(()),
        }
    }
}

impl Run {
    /// The stage under way, with its record.
    fn stage(&self) -> Option<(&Stage, &StageRecord)> {
        let record = self.totals.stages.last().filter(|record| record.end.is_none())?;
        Some((self.settings.stages.get(self.totals.stages.len() - 1)?, record))
    }

    /// Begins the next stage where none is under way; `false` where the last one has ended.
    fn begin_stage(&mut self) -> Result<bool, RunError> {
        if self.settings.stages.is_empty() || self.stage().is_some() {
            return Ok(true);
        }
        let Some(next) = self.settings.stages.get(self.totals.stages.len()) else { return Ok(false) };
        next.begin(&mut self.world, &self.totals.open_boundaries.numbers).map_err(StepError::Settings)?;
        self.totals.latest.clear();
        let (name, first_step) = (next.name.clone(), self.world.step);
        self.totals.stages.push(StageRecord { name, first_step, last_step: None, end: None });
        Ok(true)
    }

    /// Whether the next step begins a stage, which may change gravity, materials, motions and loads.
    pub fn begins_a_stage(&self) -> bool {
        self.stage().is_none() && self.settings.stages.len() > self.totals.stages.len()
    }

    fn compares_velocities(&self) -> bool {
        self.stage().is_some_and(|(stage, _)| stage.compares_velocities())
    }

    /// Ends the stage under way if its condition holds after a step from these velocities.
    fn end_stage(&mut self, before: Option<&[Vec3]>) {
        let Some((stage, record)) = self.stage() else { return };
        let number = self.world.step;
        let open_boundaries = &self.settings.open_boundaries;
        let end = stage.end(Progress {
            world: &self.world,
            made: number - record.first_step,
            step: self.settings.stepping.step,
            before,
            is_filled: open_boundaries.is_filled(self.totals.stages.len() - 1, &self.totals.open_boundaries),
            latest: &self.totals.latest,
        });
        if let (Some(_), Some(record)) = (end, self.totals.stages.last_mut()) {
            (record.last_step, record.end) = (Some(number), end);
        }
    }
}

/// The part of [`Run`] by which bodies enter, leave and grow.
impl Run {
    /// Whether steps may change the number of bodies.
    pub fn changes_bodies(&self) -> bool {
        self.settings.open_boundaries.changes_bodies()
    }

    /// Lets bodies enter, leave and grow for the next step.
    fn exchange_bodies(&mut self) -> Result<(), RunError> {
        let step = self.settings.stepping.step;
        let record = self.totals.stages.last();
        let now = Moment {
            stage: self.totals.stages.len().saturating_sub(1),
            stage_time: record.map_or(0.0, |record| record.first_step as f64 * step),
            step,
        };
        let number = self.totals.stages.len().wrapping_sub(1);
        let growth = self.settings.stages.get(number).and_then(|stage| stage.growth.as_ref());
        let overlap = self.totals.figures.penetration_final_over_radius;
        let (state, collider) = (&mut self.totals.open_boundaries, &mut self.collider);
        let prepared =
            self.settings.open_boundaries.prepare(&mut self.world, collider, state, growth, now, overlap);
        Ok(prepared.map_err(StepError::Settings)?)
    }
}

/// The part of [`Run`] that measures.
impl Run {
    /// Takes note of the records of what is to be steady.
    fn note_latest(&mut self, measured: &[(usize, Vec<Vec<f64>>)]) {
        let Some(steady) = self.stage().and_then(|(stage, _)| stage.steady.clone()) else { return };
        for (_, rows) in measured.iter().filter(|(number, _)| *number == steady.measure) {
            let value = rows.first().and_then(|row| row.get(steady.column));
            steady.note(value.copied().unwrap_or(f64::NAN), &mut self.totals.latest);
        }
    }

    fn follows_bodies(&self) -> bool {
        self.settings.measures.iter().any(Measure::follows_bodies)
    }

    /// Makes the records that are due after a step from these places of the bodies.
    fn measure(&mut self, before: Option<&[Vec3]>) -> Vec<(usize, Vec<Vec<f64>>)> {
        let (measures, mut states) = (&self.settings.measures, std::mem::take(&mut self.totals.measured));
        states.resize(measures.len(), MeasureState::default());
        let now = Measured {
            world: &self.world,
            step: self.settings.stepping.step,
            stage: self.totals.stages.len().saturating_sub(1),
            ledger: &self.totals.ledger,
            correction_energy: self.totals.figures.correction_energy,
            open_boundaries: &self.totals.open_boundaries,
        };
        let mut records = Vec::new();
        for (number, (measure, state)) in measures.iter().zip(&mut states).enumerate() {
            if let Some(before) = before {
                measure.follow(now, before, state);
            }
            records.extend(measure.record(now, state).map(|rows| (number, rows)));
        }
        self.totals.measured = states;
        records
    }
}

/// Seconds of wall and processor since the run was begun or resumed, on top of what came before.
struct Clocks {
    start: Instant,
    wall_before: f64,
    cpu_start: Option<f64>,
    cpu_before: Option<f64>,
}

impl Clocks {
    fn begin(totals: &RunTotals) -> Self {
        Self {
            start: Instant::now(),
            wall_before: totals.wall_seconds,
            cpu_start: cpu_seconds(),
            cpu_before: totals.cpu_seconds,
        }
    }

    fn count(&self, totals: &mut RunTotals) {
        totals.wall_seconds = self.wall_before + self.start.elapsed().as_secs_f64();
        totals.cpu_seconds = match (self.cpu_start, cpu_seconds()) {
            (Some(start), Some(now)) => Some(self.cpu_before.unwrap_or(0.0) + now - start),
            _ => self.cpu_before,
        };
    }
}
