//! An interior point whose Newton systems go to several linear solvers.
//!
//! One of them, the guide, solves for the interior point; the others prepare themselves for the same matrices
//! and, if asked, solve for the same right-hand sides to the same tolerance. That compares solvers of which a
//! whole run would take days.

use crate::Failure;
use crate::solve::{clock, settings};
use crate::table::short;
use graintrain::ccp::newton::driver::NewtonDriver;
use graintrain::ccp::newton::{Form, LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use graintrain::ccp::paper::pdip::{Pdip, Rule};
use graintrain::ccp::paper::train::TensorTrain;
use graintrain::ccp::registry::{LinearMethod, Method};
use graintrain::ccp::{Ccp, CcpError, CcpSolver, SolveReport, SolveSettings};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Which systems are handed on, and what is done with them.
#[derive(Clone, Copy, Debug)]
pub struct Sampling {
    /// Every so many systems of a problem, from the first.
    pub every: usize,
    /// Every so many of these is solved, from the last one of the period; 0: the others only prepare
    /// themselves.
    pub solve_every: usize,
    /// Newton iterations of the interior point at most.
    pub iterations: usize,
    /// Processor seconds of one preparation or solve after which a linear solver gets no further ones.
    pub patience: f64,
}

/// How long a linear solver keeps what it learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Life {
    /// For all problems.
    Always,
    /// For one problem.
    Problem,
    /// For one system.
    System,
}

/// What a linear solver needed for the systems that it was given.
#[derive(Clone, Default)]
pub struct Tally {
    /// Systems that it prepared itself for; that it solved; whose solves did not reach their tolerance.
    pub systems: usize,
    pub solved: usize,
    pub unconverged: usize,
    /// Inner iterations of all solves.
    pub inner: usize,
    /// Processor seconds to prepare for the first system of all, with the pattern of the matrix; for each
    /// problem's first system, sum; for every system, sum.
    pub first: f64,
    pub first_of_problems: f64,
    pub precompute: f64,
    /// Of the solves, sum.
    pub apply: f64,
    /// Largest relative residual.
    pub residual: f64,
    figures: BTreeMap<String, (f64, usize)>,
    /// Why it broke down, if it did.
    pub failure: Option<String>,
}

impl Tally {
    fn add_figures(&mut self, figures: &BTreeMap<String, f64>) {
        for (name, value) in figures {
            let entry = self.figures.entry(name.clone()).or_default();
            *entry = (entry.0 + value, entry.1 + 1);
        }
    }

    fn add_solve(&mut self, seconds: f64, inner: usize, residual: f64, converged: bool) {
        self.solved += 1;
        self.unconverged += usize::from(!converged);
        self.inner += inner;
        self.apply += seconds;
        self.residual = self.residual.max(residual);
    }

    /// Mean of a figure over the systems.
    pub fn mean(&self, name: &str) -> Option<f64> {
        self.figures.get(name).map(|&(sum, count)| sum / count as f64)
    }

    /// The same in words.
    pub fn figure(&self, name: &str) -> String {
        self.mean(name).map_or("-".to_string(), short)
    }

    /// Processor seconds of a whole solve with this many systems, from the mean of those that were sampled;
    /// `None` where one failed or did not reach its tolerance.
    pub fn whole(&self, systems: usize) -> Option<f64> {
        let good = self.solved > 0 && self.unconverged == 0 && self.failure.is_none();
        let further = systems.saturating_sub(1) as f64;
        good.then(|| {
            let later = self.later().unwrap_or(self.first);
            self.first + further * later + systems as f64 * self.apply / self.solved as f64
        })
    }

    /// Seconds to prepare for a system that is not the first.
    pub fn later(&self) -> Option<f64> {
        (self.systems > 1).then(|| (self.precompute - self.first) / (self.systems - 1) as f64)
    }
}

/// Access to a tally that the interior point writes to.
pub fn lock(tally: &Mutex<Tally>) -> MutexGuard<'_, Tally> {
    tally.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Why a linear solver gets no more systems.
const TOO_SLOW: &str = "slower than it is given time";

/// Name of `tt` that tries a train on problems of any size.
pub const TRAIN_AT_ANY_SIZE: &str = "tt-any-size";

/// The linear solver of a name, also of [`TRAIN_AT_ANY_SIZE`].
fn build(name: &str) -> Result<Box<dyn NewtonSolver>, CcpError> {
    if name == TRAIN_AT_ANY_SIZE {
        return Ok(Box::new(TensorTrain::at_any_size()));
    }
    LinearMethod::of(Method::Pdip, name)?.build()
}

/// One of the others.
struct Candidate {
    linear: String,
    life: Life,
    driver: NewtonDriver,
    dropped: bool,
    tally: Arc<Mutex<Tally>>,
}

impl Candidate {
    fn prepare(
        &mut self,
        system: &NewtonSystem<'_>,
        first_of_problem: bool,
        patience: f64,
        clock: &dyn Fn() -> f64,
    ) {
        let renewed = self.life == Life::System || (self.life == Life::Problem && first_of_problem);
        if renewed && let Ok(linear) = build(&self.linear) {
            self.driver = NewtonDriver::new(linear);
        }
        let begun = clock();
        if renewed || first_of_problem {
            self.driver.begin(system.problem);
        }
        let refreshed = self.driver.refresh(system.problem, system.blocks, system.iteration, f64::NAN);
        let seconds = clock() - begun;
        let mut tally = lock(&self.tally);
        if let Err(error) = refreshed {
            self.dropped = true;
            tally.failure = Some(error.to_string());
            return;
        }
        if tally.systems == 0 {
            tally.first = seconds;
        }
        tally.first_of_problems += if first_of_problem { seconds } else { 0.0 };
        tally.precompute += seconds;
        tally.systems += 1;
        if seconds > patience {
            self.dropped = true;
            tally.failure = Some(TOO_SLOW.to_string());
        }
        eprintln!("    {} prepared in {seconds:.3} s", self.linear);
    }

    fn solve(&mut self, system: &NewtonSystem<'_>, b: &[f64], z: &mut [f64], tolerance: f64) -> LinearReport {
        self.driver.solve(system.problem, system.blocks, b, z, tolerance)
    }
}

/// Solves by its guide and hands systems on.
struct Followed {
    guide: Box<dyn NewtonSolver>,
    candidates: Vec<Candidate>,
    sampling: Sampling,
    /// Systems of this problem so far.
    system: usize,
    precompute: f64,
    tally: Arc<Mutex<Tally>>,
    scratch: Vec<f64>,
    start: Instant,
}

impl Followed {
    fn is_sampled(&self) -> bool {
        self.system.is_multiple_of(self.sampling.every)
    }

    fn is_solved(&self) -> bool {
        let period = self.sampling.solve_every;
        self.is_sampled() && period > 0 && (self.system / self.sampling.every + 1).is_multiple_of(period)
    }
}

impl NewtonSolver for Followed {
    fn name(&self) -> &'static str {
        self.guide.name()
    }

    fn form(&self) -> Form {
        self.guide.form()
    }

    fn prepare(&mut self, system: &NewtonSystem<'_>) {
        self.guide.prepare(system);
    }

    fn needs_matrix(&self) -> bool {
        self.guide.needs_matrix()
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        let start = self.start;
        let begun = clock(start);
        self.guide.refresh(system)?;
        self.precompute = clock(start) - begun;
        if system.new_delassus {
            self.system = 0;
        }
        if self.is_sampled() {
            let (first, patience) = (self.system == 0, self.sampling.patience);
            for candidate in self.candidates.iter_mut().filter(|candidate| !candidate.dropped) {
                candidate.prepare(system, first, patience, &|| clock(start));
            }
        }
        Ok(())
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        let begun = clock(self.start);
        let report = self.guide.solve(system, b, z, relative_tolerance);
        let seconds = clock(self.start) - begun;
        let mut figures = BTreeMap::new();
        self.guide.figures(&mut figures);
        {
            let mut tally = lock(&self.tally);
            if tally.systems == 0 {
                tally.first = self.precompute;
            }
            tally.systems += 1;
            tally.precompute += self.precompute;
            tally.add_solve(seconds, report.iterations, report.residual, report.converged);
            tally.add_figures(&figures);
        }
        eprintln!(
            "  system {} (iteration {}): {} {} inner iterations, {:.1} s so far",
            self.system,
            system.iteration,
            self.guide.name(),
            report.iterations,
            clock(self.start)
        );
        let (sampled, solved) = (self.is_sampled(), self.is_solved());
        self.scratch.resize(b.len(), 0.0);
        for candidate in self.candidates.iter_mut().filter(|candidate| sampled && !candidate.dropped) {
            if solved {
                let begun = clock(self.start);
                let report = candidate.solve(system, b, &mut self.scratch, relative_tolerance);
                let seconds = clock(self.start) - begun;
                eprintln!(
                    "    {} solved in {seconds:.3} s, {} inner iterations, residual {:.1e}",
                    candidate.linear, report.iterations, report.residual
                );
                let mut tally = lock(&candidate.tally);
                tally.add_solve(seconds, report.iterations, report.residual, report.converged);
                if seconds > self.sampling.patience {
                    candidate.dropped = true;
                    tally.failure = Some(TOO_SLOW.to_string());
                }
            }
            candidate.driver.end_iteration(f64::NAN);
            for record in candidate.driver.take_records() {
                lock(&candidate.tally).add_figures(&record.figures);
            }
        }
        self.system += 1;
        report
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        self.guide.figures(figures);
    }
}

/// An interior point that is followed, and what its linear solvers needed: the guide first, then the others.
pub struct Run {
    pdip: Pdip,
    sampling: Sampling,
    pub tallies: Vec<Arc<Mutex<Tally>>>,
}

impl Run {
    /// `others` with the time for which they keep what they learned.
    pub fn new(guide: &str, others: &[(&str, Life)], sampling: Sampling) -> Result<Self, Failure> {
        let tallies: Vec<Arc<Mutex<Tally>>> = (0..=others.len()).map(|_| Arc::default()).collect();
        let candidates = others
            .iter()
            .zip(&tallies[1..])
            .map(|(&(linear, life), tally)| {
                Ok(Candidate {
                    linear: linear.to_string(),
                    life,
                    driver: NewtonDriver::new(build(linear)?),
                    dropped: false,
                    tally: tally.clone(),
                })
            })
            .collect::<Result<Vec<_>, Failure>>()?;
        let followed = Followed {
            guide: build(guide)?,
            candidates,
            sampling,
            system: 0,
            precompute: 0.0,
            tally: tallies[0].clone(),
            scratch: Vec::new(),
            start: Instant::now(),
        };
        Ok(Self { pdip: Pdip::with_solver(Rule::Central, Box::new(followed)), sampling, tallies })
    }

    /// Solves a problem from no impulses, within a limit of processor seconds.
    pub fn solve(&mut self, problem: &Ccp, limit: f64) -> Result<SolveReport, Failure> {
        let settings = SolveSettings { max_iterations: Some(self.sampling.iterations), ..settings(limit) };
        let mut impulse = vec![0.0; 3 * problem.num_contacts()];
        Ok(self.pdip.solve(problem, &mut impulse, &settings)?)
    }
}
