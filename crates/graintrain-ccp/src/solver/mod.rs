//! Solvers of the CCP: settings, report, and the solvers by name.

mod apgd;
mod auto;
#[cfg(target_arch = "x86_64")]
mod avx2;
mod barzilai_borwein;
mod body_operator;
mod coulomb;
pub mod driver;
mod face;
pub mod first_order;
mod gauss_seidel;
mod gpminres;
pub mod infeasible;
pub mod ipm;
mod jacobi;
mod kucera;
pub mod lanes;
pub mod pdip;
mod row_operator;
pub mod scaling;
pub mod scip;
mod spectral;
mod spg;
pub mod sweep;
mod turns;

pub use apgd::Apgd;
pub use barzilai_borwein::BarzilaiBorwein;
pub use coulomb::CoulombIteration;
pub use gauss_seidel::GaussSeidel;
pub use gpminres::GpMinres;
pub use jacobi::Jacobi;
pub use kucera::Kucera;
pub use spg::SpectralProjectedGradient;

use crate::newton::NewtonRecord;
use crate::problem::{Ccp, CcpError};
use crate::residual::{FrictionModel, Judge, Residual};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// When a solver stops.
#[derive(Clone, Debug)]
pub struct SolveSettings {
    /// Stop when the residual, judged by `judge`, is at most this. Default 1e-4.
    pub tolerance: f64,
    /// Which number of the residual counts. Default [`Judge::Maximum`].
    pub judge: Judge,
    /// Stop after this many iterations; `None` is the solver's own limit. For exact friction see [`CoulombIteration`].
    pub max_iterations: Option<usize>,
    /// Stop after this time.
    pub max_time: Option<Duration>,
    /// Relaxed CCP or exact Coulomb friction.
    pub friction: FrictionModel,
    /// Stop as soon as this is set (Ctrl-C), with the best iterate.
    pub stop: Option<Arc<AtomicBool>>,
}

impl Default for SolveSettings {
    fn default() -> Self {
        Self {
            tolerance: 1e-4,
            judge: Judge::Maximum,
            max_iterations: None,
            max_time: None,
            friction: FrictionModel::Relaxed,
            stop: None,
        }
    }
}

impl SolveSettings {
    /// Whether a solve begun at `start` has to stop now because of time or a stop request.
    pub fn out_of_time(&self, start: Instant) -> bool {
        self.max_time.is_some_and(|limit| start.elapsed() >= limit)
            || self.stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed))
    }
}

/// Why a solver stopped. Not reaching the tolerance is a status, not an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The residual, as judged, is at most the tolerance.
    Converged,
    /// No further progress is possible (round-off, breakdown of a linear solve).
    Stalled,
    /// The iteration limit was reached.
    IterationLimit,
    /// The time limit was reached or a stop was requested.
    Stopped,
    /// The problem has no solution: the bodies are jammed (see the solver's documentation for what is returned).
    Infeasible,
}

/// What a solve did. The impulses returned are the best iterate found, converged or not.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct SolveReport {
    /// Name of the solver, with its linear solver where it has one.
    pub solver: String,
    /// Why it stopped.
    pub status: Status,
    /// Iterations of the outer method.
    pub iterations: usize,
    /// Iterations of linear solvers, summed.
    pub linear_iterations: usize,
    /// Products with N that a first-order method's iterations made (a sweep of Gauss-Seidel is one); 0 for other methods.
    #[serde(default)]
    pub products: usize,
    /// Residual of the returned impulses in the friction model asked for.
    pub residual: Residual,
    /// Residual of the returned impulses as a relaxed CCP.
    pub residual_relaxed: Residual,
    /// Residual of the returned impulses as exact Coulomb friction.
    pub residual_coulomb: Residual,
    /// The measure used until November 2026 in the friction model asked for; see [`crate::residual::ResidualScale::paper`].
    #[serde(default)]
    pub residual_paper: f64,
    /// 1/2 g^T N g + r^T g, J.
    pub objective: f64,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// What the linear solver of a second-order method did, one record per Newton iteration.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub newton: Vec<NewtonRecord>,
    /// Why a linear solver gave up, where that ended the solve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remark: Option<String>,
}

impl SolveReport {
    /// Whether the tolerance was reached.
    pub fn converged(&self) -> bool {
        self.status == Status::Converged
    }
}

/// A method for the CCP. A solver may keep work memory and what it learned between solves.
pub trait CcpSolver: Send {
    /// Name as given on the command line.
    fn name(&self) -> String;

    /// Iterations that a relaxed solve is allowed where its settings name no limit.
    fn iteration_limit(&self) -> usize {
        first_order::ITERATION_LIMIT
    }

    /// Improves `impulse` (length 3 N_c, N s; the start on entry, e.g. last step's impulses or zero; the best iterate
    /// on exit, also where the solver did not converge).
    ///
    /// # Errors
    /// Only for a problem that the solver cannot treat; not converging is a [`Status`].
    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError>;

    /// As [`Self::solve`], with the caller's word that N, mu and V are those of this solver's last call and only r
    /// differs, so that whatever does not depend on r can be used again.
    ///
    /// # Errors
    /// As [`Self::solve`].
    fn solve_again(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        self.solve(problem, impulse, settings)
    }

    /// [`Self::solve_again`] where `again`, else [`Self::solve`].
    ///
    /// # Errors
    /// As [`Self::solve`].
    fn solve_maybe_again(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
        again: bool,
    ) -> Result<SolveReport, CcpError> {
        if again {
            self.solve_again(problem, impulse, settings)
        } else {
            self.solve(problem, impulse, settings)
        }
    }

    /// Exact Coulomb friction without the outer iteration of [`CoulombIteration`], where the method can; `None` where it
    /// cannot. `settings.friction` is [`FrictionModel::Coulomb`]. `again` is the caller's word of [`Self::solve_again`].
    ///
    /// The iterates begin at `last` (length 3 N_c); on exit it is where they ended, and `impulse` the best of them. The next call
    /// goes on from there: on their way to a solution of the exact problem residuals have to rise now and then, and from the best
    /// iterate the way between would be gone again and again.
    ///
    /// # Errors
    /// As [`Self::solve`].
    fn solve_exact(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        last: &mut [f64],
        settings: &SolveSettings,
        again: bool,
    ) -> Result<Option<SolveReport>, CcpError> {
        let _ = (problem, impulse, last, settings, again);
        Ok(None)
    }
}

/// Makes a solver of the relaxed problem, given the name of its linear solver if one was asked for.
type Build = fn(linear: Option<&str>) -> Result<Box<dyn CcpSolver>, CcpError>;

/// A solver that can be asked for by name.
pub struct Method {
    /// Name on the command line.
    pub name: &'static str,
    /// One line for `--help`.
    pub about: &'static str,
    build: Build,
}

/// Every method, in the order of the documentation.
pub const METHODS: &[Method] = &[
    Method {
        name: "auto",
        about: "the fastest that reaches the tolerance: apgd, and the interior point where that is better",
        build: auto::build,
    },
    Method { name: "pj", about: "projected Jacobi (Tasora, Anitescu 2011)", build: jacobi::build },
    Method {
        name: "pgs",
        about: "projected Gauss-Seidel (Tasora, Anitescu 2011); pgs@1.3: with over-relaxation 1.3 (SOR)",
        build: gauss_seidel::build,
    },
    Method {
        name: "apgd",
        about: "accelerated projected gradient descent (Mazhar, Heyn, Negrut, Tasora 2015)",
        build: apgd::build,
    },
    Method {
        name: "bb",
        about: "projected Barzilai-Borwein gradient (Barzilai, Borwein 1988; Dai, Fletcher 2005)",
        build: barzilai_borwein::build,
    },
    Method {
        name: "kucera",
        about: "projected conjugate gradients with expansion and proportioning (Kucera 2008)",
        build: kucera::build,
    },
    Method {
        name: "spg",
        about: "preconditioned spectral projected gradient with fallback, P-SPG-FB (Heyn 2013)",
        build: spg::build,
    },
    Method {
        name: "gpminres",
        about: "gradient-projected minimum residual (Heyn, Anitescu, Tasora, Negrut 2013)",
        build: gpminres::build,
    },
    Method {
        name: "scip",
        about: "symmetric cone interior point (Kleinert, Simeon, Obermayr 2014); linear solver after a '+'",
        build: scip::build,
    },
    Method {
        name: "ipm",
        about: "projected gradients, Newton on the projection, interior point; ipm+LINEAR: the interior point alone",
        build: ipm::build,
    },
    Method {
        name: "pdip",
        about: "primal-dual interior point of the paper (Corona et al. 2019); linear solver after a '+'",
        build: pdip::build,
    },
    Method {
        name: "pdip-literal",
        about: "the same with the paper's own start, barrier and step rules, which stall on settled packings",
        build: pdip::build_literal,
    },
];

/// Refuses a linear solver given to a method that solves no linear systems.
fn without_linear_solver(method: &str, linear: Option<&str>) -> Result<(), CcpError> {
    match linear {
        None => Ok(()),
        Some(linear) => Err(CcpError::UnknownSolver {
            name: format!("{method}+{linear}"),
            known: format!("{method} (it solves no linear systems, so nothing follows a '+')"),
        }),
    }
}

/// A solver by name: a method, and for second-order methods its linear solver after a `+`, e.g. `pdip+ilu`; over-relaxation
/// follows `pgs` after an `@`, e.g. `pgs@1.3`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SolverSpec {
    method: String,
    /// omega of `pgs@OMEGA`.
    relaxation: Option<String>,
    linear: Option<String>,
}

impl Default for SolverSpec {
    /// `auto`.
    fn default() -> Self {
        Self { method: "auto".to_string(), relaxation: None, linear: None }
    }
}

impl SolverSpec {
    /// Whether the method re-uses what it made for one problem in the next, so that it has to be given whole steps rather than the
    /// connected parts of them: the interior points with a linear solver of their own (Algorithm 3 of the paper).
    pub fn keeps_between_steps(&self) -> bool {
        self.linear.is_some() || matches!(self.method.as_str(), "pdip" | "pdip-literal" | "scip")
    }

    /// Makes the solver.
    ///
    /// # Errors
    /// [`CcpError::UnknownSolver`] where no method or linear solver has the name.
    pub fn build(&self) -> Result<Box<dyn CcpSolver>, CcpError> {
        let method =
            METHODS.iter().find(|method| method.name == self.method).ok_or_else(|| self.unknown())?;
        let built = match &self.relaxation {
            None => (method.build)(self.linear.as_deref()),
            Some(omega) if self.method == "pgs" && self.linear.is_none() => gauss_seidel::build_with(omega)
                .ok_or_else(|| CcpError::UnknownSolver {
                    name: self.to_string(),
                    known: "pgs@OMEGA with a number OMEGA between 0 and 2".to_string(),
                }),
            Some(_) => Err(self.unknown()),
        };
        built.map(|relaxed| Box::new(CoulombIteration::new(relaxed)) as Box<dyn CcpSolver>)
    }

    fn unknown(&self) -> CcpError {
        let known: Vec<&str> = METHODS.iter().map(|method| method.name).collect();
        CcpError::UnknownSolver { name: self.to_string(), known: known.join(", ") }
    }
}

impl std::fmt::Display for SolverSpec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.method)?;
        if let Some(omega) = &self.relaxation {
            write!(f, "@{omega}")?;
        }
        self.linear.as_ref().map_or(Ok(()), |linear| write!(f, "+{linear}"))
    }
}

impl std::str::FromStr for SolverSpec {
    type Err = CcpError;

    fn from_str(name: &str) -> Result<Self, CcpError> {
        let (method, linear) = match name.split_once('+') {
            Some((method, linear)) => (method, Some(linear.to_string())),
            None => (name, None),
        };
        let (method, relaxation) = match method.split_once('@') {
            Some((method, omega)) => (method, Some(omega.to_string())),
            None => (method, None),
        };
        let spec = Self { method: method.to_string(), relaxation, linear };
        spec.build().map(|_| spec)
    }
}
