//! One contact problem, one method: what it took. And consecutive problems with and without re-use.

use super::ReproduceError;
use graintrain::assemble::OverlapCorrection;
use graintrain::stepper::{StepSettings, Stepper};
use graintrain::world::World;
use graintrain_ccp::{Ccp, CcpSolver, FrictionModel, SolveReport, SolveSettings, SolverSpec, Status};
use graintrain_io::checkpoint::{self, Checkpoint};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

/// The paper's tolerance of the contact problem.
pub const TOLERANCE: f64 = 1e-4;

/// What one solve took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Solve {
    /// Name of the experiment's scene.
    pub experiment: String,
    /// Size parameter.
    pub n: usize,
    /// Number of the step.
    pub step: u64,
    /// Contacts.
    pub contacts: usize,
    /// Method.
    pub method: String,
    /// How it ended, as in the solver's report.
    pub status: Status,
    /// Outer (Newton) iterations.
    pub iterations: usize,
    /// Residual reached; `None` where the solver never came back.
    pub residual: Option<f64>,
    /// Seconds of the whole solve.
    pub seconds: f64,
    /// Seconds in factorisations, preconditioners or trains.
    pub precompute_seconds: f64,
    /// Seconds in linear solves.
    pub apply_seconds: f64,
    /// Inner iterations per Newton iteration.
    pub inner_mean: f64,
    /// Part of the Newton iterations whose linear solve did not reach its tolerance.
    pub unconverged: f64,
    /// Figures of the linear solver, averaged over Newton iterations.
    pub figures: BTreeMap<String, f64>,
}

impl Solve {
    fn new(
        experiment: &str,
        n: usize,
        step: u64,
        contacts: usize,
        method: &str,
        report: &SolveReport,
    ) -> Self {
        let newton = &report.newton;
        let count = newton.len().max(1) as f64;
        let mut figures: BTreeMap<String, (f64, f64)> = BTreeMap::new();
        for (name, value) in
            newton.iter().flat_map(|record| &record.figures).filter(|(_, value)| value.is_finite())
        {
            let entry = figures.entry(name.clone()).or_default();
            *entry = (entry.0 + value, entry.1 + 1.0);
        }
        let inner: usize = newton.iter().map(|record| record.inner_iterations).sum();
        Self {
            experiment: experiment.into(),
            n,
            step,
            contacts,
            method: method.into(),
            status: report.status,
            iterations: report.iterations,
            residual: Some(report.residual.max).filter(|residual| residual.is_finite()),
            seconds: report.seconds,
            precompute_seconds: newton.iter().fold(0.0, |sum, record| sum + record.precompute_seconds),
            apply_seconds: newton.iter().fold(0.0, |sum, record| sum + record.apply_seconds),
            inner_mean: inner as f64 / count,
            unconverged: newton.iter().filter(|record| !record.linear_converged).count() as f64 / count,
            figures: figures.into_iter().map(|(name, (sum, count))| (name, sum / count)).collect(),
        }
    }

    /// Whether the tolerance was reached.
    pub fn converged(&self) -> bool {
        self.status == Status::Converged
    }

    /// Seconds of precomputation and linear solves, which is what the paper plots; of the whole solve for
    /// methods without linear systems.
    pub fn linear_seconds(&self) -> f64 {
        let linear = self.precompute_seconds + self.apply_seconds;
        if linear > 0.0 { linear } else { self.seconds }
    }
}

/// Whether a method (with its linear solver) exists in this build.
pub fn exists(method: &str) -> bool {
    method.parse::<SolverSpec>().is_ok()
}

/// A state and the steps that follow from it, each with its contact problem.
pub struct Problems {
    world: World,
    stepper: Stepper,
}

impl Problems {
    /// From a stored state. The steps are made by the fastest solver.
    ///
    /// # Errors
    /// [`ReproduceError`] for a damaged state or a stop request.
    pub fn open(folder: &Path, stop: &Arc<AtomicBool>) -> Result<Self, ReproduceError> {
        Self::begin(checkpoint::latest(folder)?.0, None, stop)
    }

    /// As [`Self::open`] with another contact envelope, m.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_with_envelope(
        folder: &Path,
        envelope: f64,
        stop: &Arc<AtomicBool>,
    ) -> Result<Self, ReproduceError> {
        Self::begin(checkpoint::latest(folder)?.0, Some(envelope), stop)
    }

    fn begin(
        checkpoint: Checkpoint,
        envelope: Option<f64>,
        stop: &Arc<AtomicBool>,
    ) -> Result<Self, ReproduceError> {
        let stepping = checkpoint.settings.stepping;
        let envelope = envelope.unwrap_or(stepping.envelope);
        let mut settings = StepSettings { overlap: OverlapCorrection::Velocity, envelope, ..stepping };
        settings.solver.friction = FrictionModel::Relaxed;
        let mut stepper = Stepper::new(settings)?;
        stepper.stop_on(Arc::clone(stop));
        Ok(Self { world: checkpoint.world, stepper })
    }

    /// The state as it is.
    pub fn into_world(self) -> World {
        self.world
    }

    /// Makes a step and returns its number and contact problem; `None` without contacts.
    ///
    /// # Errors
    /// [`ReproduceError`] where the step fails.
    pub fn advance(&mut self) -> Result<Option<(u64, Arc<Ccp>)>, ReproduceError> {
        let step = self.world.step;
        let report = self.stepper.step(&mut self.world)?;
        let problem = self.stepper.last_problem().filter(|_| report.contacts > 0);
        Ok(problem.map(|(problem, _)| (step, Arc::new(problem.clone()))))
    }
}

/// Settings of a measured solve: the paper's tolerance, relaxed friction, a time limit.
fn settings(limit: Duration, stop: &Arc<AtomicBool>) -> SolveSettings {
    SolveSettings {
        tolerance: TOLERANCE,
        max_time: Some(limit),
        stop: Some(Arc::clone(stop)),
        ..SolveSettings::default()
    }
}

/// Runs work on a thread of its own, with one worker, for at most a while. Solvers look at their time limit
/// between Newton iterations; a single tensor-train inversion may take longer than anybody waits. `None`
/// where it did not come back: the thread is then left alone until the process ends.
///
/// # Errors
/// [`ReproduceError::Stopped`] within a tenth of a second of the stop flag.
fn watched<T: Send + 'static>(
    patience: Duration,
    stop: &Arc<AtomicBool>,
    work: impl FnOnce() -> Result<T, ReproduceError> + Send + 'static,
) -> Result<Option<T>, ReproduceError> {
    const GLANCE: Duration = Duration::from_millis(100);
    let (send, receive) = mpsc::channel();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    std::thread::spawn(move || {
        // The receiver is gone when nobody waits any more.
        let _ = send.send(pool.install(work));
    });
    let begin = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        match receive.recv_timeout(GLANCE.min(patience.saturating_sub(begin.elapsed()))) {
            Ok(result) => return result.map(Some),
            Err(mpsc::RecvTimeoutError::Timeout) if begin.elapsed() < patience => {}
            Err(_) => return Ok(None),
        }
    }
    Err(ReproduceError::Stopped)
}

/// How long a solve with this time limit is waited for.
fn patience(limit: Duration) -> Duration {
    limit.saturating_mul(4).saturating_add(Duration::from_secs(5))
}

/// Solves a problem from zero impulses on one thread, as every method starts alike. `residual` is `None` in
/// the answer where the solver did not come back.
///
/// # Errors
/// [`ReproduceError`] for an unknown method or a problem it cannot take.
pub fn measure(
    problem: &Arc<Ccp>,
    method: &str,
    limit: Duration,
    stop: &Arc<AtomicBool>,
    (experiment, n, step): (&str, usize, u64),
) -> Result<Solve, ReproduceError> {
    let mut solver = method.parse::<SolverSpec>()?.build()?;
    let contacts = problem.num_contacts();
    let report = watched(patience(limit), stop, {
        let (problem, settings) = (Arc::clone(problem), settings(limit, stop));
        move || Ok(solver.solve(&problem, &mut vec![0.0; 3 * contacts], &settings)?)
    })?;
    Ok(match report {
        Some(report) => Solve::new(experiment, n, step, contacts, method, &report),
        None => Solve {
            experiment: experiment.into(),
            n,
            step,
            contacts,
            method: method.into(),
            status: Status::Stopped,
            iterations: 0,
            residual: None,
            seconds: patience(limit).as_secs_f64(),
            precompute_seconds: 0.0,
            apply_seconds: 0.0,
            inner_mean: 0.0,
            unconverged: 0.0,
            figures: BTreeMap::new(),
        },
    })
}

/// Precomputation of one of several consecutive steps; pairs are of a solver that keeps what the steps before
/// left, and of a new one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReuseRow {
    /// Number of the step.
    pub step: u64,
    /// Contacts.
    pub contacts: usize,
    /// Seconds of the first Newton iteration's precomputation. A new solver has nothing at all to re-use
    /// there.
    pub first: [f64; 2],
    /// Seconds of precomputation per Newton iteration, mean over the step.
    pub total: [f64; 2],
    /// Newton iterations made within the time limit.
    pub iterations: [usize; 2],
    /// Compression error, where the linear solver tells.
    pub error: [Option<f64>; 2],
    /// Part of the Newton iterations in which a train was in use, where the linear solver has something to
    /// fall back on.
    pub active: [Option<f64>; 2],
}

/// Solves consecutive problems with one solver that keeps what it learned, and with a new one each time.
/// Empty where a solver did not come back.
///
/// # Errors
/// [`ReproduceError`] for an unknown method or a step that fails.
pub fn reuse(
    mut problems: Problems,
    steps: usize,
    method: &str,
    limit: Duration,
    stop: &Arc<AtomicBool>,
) -> Result<Vec<ReuseRow>, ReproduceError> {
    let spec = method.parse::<SolverSpec>()?;
    let settings = settings(limit, stop);
    let rows = watched(patience(limit).saturating_mul(2 * steps as u32), stop, move || {
        let mut keeping = spec.build()?;
        let mut rows = Vec::new();
        for _ in 0..steps {
            let Some((step, problem)) = problems.advance()? else { continue };
            let contacts = problem.num_contacts();
            let mut fresh = spec.build()?;
            let solve = |solver: &mut dyn CcpSolver| -> Result<Precomputation, ReproduceError> {
                let report = solver.solve(&problem, &mut vec![0.0; 3 * contacts], &settings)?;
                Ok(Precomputation::of(&report))
            };
            let [kept, fresh] = [solve(keeping.as_mut())?, solve(fresh.as_mut())?];
            rows.push(ReuseRow {
                step,
                contacts,
                first: [kept.first, fresh.first],
                total: [kept.mean, fresh.mean],
                iterations: [kept.iterations, fresh.iterations],
                error: [kept.error, fresh.error],
                active: [kept.active, fresh.active],
            });
        }
        Ok(rows)
    })?;
    Ok(rows.unwrap_or_default())
}

/// What one solve says of its precomputation; see [`ReuseRow`].
struct Precomputation {
    first: f64,
    mean: f64,
    iterations: usize,
    error: Option<f64>,
    active: Option<f64>,
}

impl Precomputation {
    fn of(report: &SolveReport) -> Self {
        let newton = &report.newton;
        let solve = Solve::new("", 0, 0, 0, "", report);
        let figure = |name: &str| solve.figures.get(name).copied();
        Self {
            first: newton.first().map_or(0.0, |record| record.precompute_seconds),
            mean: solve.precompute_seconds / newton.len().max(1) as f64,
            iterations: newton.len(),
            error: figure("compression_error"),
            active: figure("train_active"),
        }
    }
}
