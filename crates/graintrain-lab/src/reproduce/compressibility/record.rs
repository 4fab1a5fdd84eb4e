//! The Newton systems of a whole interior-point solve, recorded as it goes.

use crate::reproduce::ReproduceError;
use graintrain_ccp::delassus::DelassusIdentity;
use graintrain_ccp::newton::{LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use graintrain_ccp::paper::pdip::{Parameters, Pdip, Rule};
use graintrain_ccp::registry::LinearMethod;
use graintrain_ccp::residual::ResidualScale;
use graintrain_ccp::{Ccp, CcpSolver, SolveSettings, Status};
use graintrain_linalg::block3::Block;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Which interior point is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The paper's: gamma_n = 1 N s, gamma_t = 0, lambda = -1/f, its barrier and line search.
    Paper,
    /// graintrain's `pdip`: a start above the solution, a barrier that shrinks near the central path alone.
    Ours,
}

impl Start {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Paper, Self::Ours];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Ours => "ours",
        }
    }
}

/// The part of a Newton system S x = b, S = N + H, that changes from iterate to iterate.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// Newton iteration, from 0.
    pub iteration: usize,
    /// H, 1/kg.
    pub added: Vec<Block>,
    /// b, m/s.
    pub rhs: Vec<f64>,
}

/// What a recorded solve was.
#[derive(Debug)]
pub struct Path {
    /// The systems kept, in order: those of the chosen iterations and the last.
    pub systems: Vec<Recorded>,
    /// How the solve ended.
    pub status: Status,
}

/// From this many contacts on the systems are solved by incomplete Cholesky: the factor of the whole matrix
/// would take minutes each.
const DIRECT: usize = 30_000;

/// Follows one interior-point solve to a residual of 1e-4, or for `newton` iterations, and keeps the systems
/// of the iterations that `keep` chooses, and the last. Exact linear solves up to 30 000 contacts.
///
/// # Errors
/// [`ReproduceError`] where the solver refuses the problem or the stop flag is set.
pub fn follow(
    problem: &Ccp,
    start: Start,
    newton: usize,
    keep: impl Fn(usize) -> bool + Send + 'static,
    stop: &Arc<AtomicBool>,
) -> Result<Path, ReproduceError> {
    let systems = Arc::new(Mutex::new(Vec::new()));
    let linear = if problem.num_contacts() < DIRECT {
        LinearMethod::Cholesky
    } else {
        LinearMethod::IncompleteCholesky
    };
    let recorder =
        Recorder { solver: linear.build()?, systems: Arc::clone(&systems), keep: Box::new(keep), path: None };
    let rule = if start == Start::Paper { Rule::Paper } else { Rule::Central };
    let mut pdip = Pdip::with_solver(rule, Box::new(recorder));
    let mut impulse = vec![0.0; 3 * problem.num_contacts()];
    if start == Start::Paper {
        impulse.iter_mut().step_by(3).for_each(|normal| *normal = 1.0);
        let unit = ResidualScale::new(problem).size();
        pdip.parameters = Parameters {
            paper_floor: 0.0,
            central_start: f64::INFINITY,
            paper_barrier: 1.0 / (unit * unit),
            ..Parameters::default()
        };
    }
    let settings = SolveSettings {
        max_iterations: Some(newton),
        stop: Some(Arc::clone(stop)),
        ..SolveSettings::default()
    };
    let report = pdip.solve(problem, &mut impulse, &settings)?;
    if stop.load(std::sync::atomic::Ordering::Relaxed) {
        return Err(ReproduceError::Stopped);
    }
    let systems = std::mem::take(&mut *lock(&systems));
    Ok(Path { systems, status: report.status })
}

fn lock(systems: &Mutex<Vec<Recorded>>) -> MutexGuard<'_, Vec<Recorded>> {
    systems.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Solves by another solver and keeps what it was given.
struct Recorder {
    solver: Box<dyn NewtonSolver>,
    systems: Arc<Mutex<Vec<Recorded>>>,
    keep: Box<dyn Fn(usize) -> bool + Send>,
    /// N of the path. A stalled solve goes on with a search for a proof that there is no solution, whose
    /// systems are others.
    path: Option<DelassusIdentity>,
}

impl NewtonSolver for Recorder {
    fn name(&self) -> &'static str {
        self.solver.name()
    }

    fn prepare(&mut self, system: &NewtonSystem<'_>) {
        self.path.get_or_insert_with(|| DelassusIdentity::of(&system.problem.delassus));
        self.solver.prepare(system);
    }

    fn needs_matrix(&self) -> bool {
        self.solver.needs_matrix()
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        self.solver.refresh(system)
    }

    fn solve(&mut self, system: &NewtonSystem<'_>, b: &[f64], z: &mut [f64], tolerance: f64) -> LinearReport {
        let mut systems = lock(&self.systems);
        let of_path = self.path.as_ref().is_some_and(|path| path.is(&system.problem.delassus));
        // (A system that is solved again, more tightly, is known.)
        if of_path && systems.last().is_none_or(|last| last.iteration < system.iteration) {
            if systems.last().is_some_and(|last| !(self.keep)(last.iteration)) {
                systems.pop();
            }
            // The system arrives scaled, F^T S F z = F^T b.
            let inverse = system.blocks.factor_inverse;
            let rhs = b.chunks_exact(3).zip(inverse).flat_map(|(b, f)| {
                std::array::from_fn::<f64, 3, _>(|k| f[k] * b[0] + f[3 + k] * b[1] + f[6 + k] * b[2])
            });
            systems.push(Recorded {
                iteration: system.iteration,
                added: system.blocks.added.to_vec(),
                rhs: rhs.collect(),
            });
        }
        drop(systems);
        self.solver.solve(system, b, z, tolerance)
    }
}
