//! `pdip`: the primal-dual interior point of Corona, Gorsich, Jayakumar and Veerapaneni (2019), after Boyd
//! and Vandenberghe (2004), section 11.7.
//!
//! Two constraints per contact, f_1 = 1/2 (g_1^2 + g_2^2 - mu^2 g_n^2) <= 0 and f_2 = -g_n <= 0, with
//! multipliers lambda > 0, and the perturbed optimality conditions
//!
//! ```text
//! r_d = N g + r + sum_k lambda_k grad f_k = 0,      r_c = -lambda_k f_k - 1/tau = 0
//! ```
//!
//! Newton's step eliminates the multipliers:
//!
//! ```text
//! S dg = -r_d + sum_k grad f_k r_c,k / (-f_k),      dlambda_k = (-r_c,k + lambda_k grad f_k . dg) / (-f_k)
//! S = N + sum_k ( lambda_k Hess f_k + lambda_k / (-f_k) grad f_k grad f_k^T )
//! ```
//!
//! The problem is scaled first, by c = V sqrt(mean 1/eta) (see [`ResidualScale::size`]) and one factor per
//! contact that makes trace(N_ii) = 3. S = N + H is scaled from both sides with the factors of H^-1 = F F^T:
//! (I + F^T N F) z = F^T b, dg = F z (see [`crate::newton`]).
//!
//! # Two rules for the step
//! `pdip-literal` follows the paper: tau = 10 (number of constraints) / (-f^T lambda) in every iteration,
//! start at g_n = 1 (in units of c / sqrt(eta_i), for equal contacts V / eta), one step for impulses and
//! multipliers that keeps lambda > 0, then f < 0, then lowers |(r_d, r_c)|. On settled packings it stalls:
//! r_d is far from zero while 1/tau has already fallen, the linearised f_1 leaves its cone after 1e-3 of the
//! step, and no later step returns to the centre.
//!
//! `pdip` keeps the paper's equations, matrix and direction, and differs in what the paper leaves open or
//! what fails:
//! * The right-hand side of S is -grad phi, phi(g) = 1/2 g^T N g + r^T g - 1/tau sum_k log(-f_k): lambda
//!   cancels. S is positive definite, so that dg descends on phi, which is convex, from any lambda > 0. The
//!   step of g goes up to 0.9 of the way to the cones' boundary (a quadratic per contact) and is shortened
//!   until phi falls (Armijo); lambda has a step of its own.
//! * tau grows to 10 / (mean complementarity) as in the paper, but only where the last step was long and
//!   Newton's decrement dg^T S dg tau was at most 4 per contact: before that the iterate is far from the
//!   centre for the tau at hand.
//! * It starts above the solution, at g_n = 100 of these units, or at the last impulses, but at least 1 and
//!   at most 100, with 1/tau in proportion to the mean of |g| |N g + r|. From below the solution the cones
//!   are narrow and hundreds of steps are short.
//! * Where grains are clamped between walls, impulses can grow at no cost and there is no central path. A
//!   proximal term 1/2 eps (g_n - last centre)^2 restores it; it vanishes as the iterates settle.
//! * Where it stalls far from a solution, a proof that there is none is searched for ([`infeasible`]).
//! * Linear systems are solved to a relative residual of 1e-2: for descent that is enough.

mod contact;
mod iterate;
mod step;

use self::iterate::{Direction, Iterate};
pub use self::step::StepParameters;
use self::step::{Step, by_barrier, by_residual};
use crate::newton::NewtonSolver;
use crate::newton::driver::NewtonDriver;
use crate::problem::{Ccp, CcpError};
use crate::residual::{FrictionModel, ResidualScale};
use crate::solver::driver::{Best, Limits, Progress, check_start};
use crate::solver::history::History;
use crate::solver::infeasible;
use crate::solver::interface::CcpSolver;
use crate::solver::ipm::scaled::Scaled;
use crate::solver::report::{SolveReport, Status};
use crate::solver::settings::SolveSettings;
use graintrain_linalg::patience::Patience;

/// What [`Pdip`] is tuned by; lengths of steps are in [`StepParameters`].
#[derive(Clone, Debug)]
pub struct Parameters {
    /// 1/tau = (mean complementarity) / this.
    pub tau_factor: f64,
    /// Where no step is found the relative residual of the linear solves with the matrix at hand is tightened
    /// by this factor, down to the finest, before the method gives up.
    pub linear_tightening: f64,
    /// The finest relative residual of the linear solves.
    pub linear_finest: f64,
    /// Iterations allowed where the settings name no limit.
    pub iterations: usize,
    /// Normal impulse of the central start, c / sqrt(eta_i).
    pub central_start: f64,
    /// 1/tau of the start above the solution, and of one from known impulses, per third of the mean of |g| |N
    /// g + r|.
    pub central_barrier: [f64; 2],
    /// Weight of the proximal term of the central rule, relative to trace(N'_ii) / 3.
    pub proximal: f64,
    /// Smallest step after which tau may grow.
    pub long_step: f64,
    /// Largest squared Newton decrement per contact with which tau may grow. A contact whose impulse grows
    /// without limit adds 3, the parameter of its logarithms.
    pub near_centre: f64,
    /// Iterations without a better residual before `pdip` gives up.
    pub stall_iterations: usize,
    /// Smallest normal impulse of the paper's start from known impulses, c / sqrt(eta_i).
    pub paper_floor: f64,
    /// lambda_k (-f_k) of the paper's start, c^2. With 1 / c^2 and known impulses of 1 N s it is lambda
    /// = -1/f in units of newtons, metres and seconds.
    pub paper_barrier: f64,
    /// Lengths of steps.
    pub step: StepParameters,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            tau_factor: 10.0,
            linear_tightening: 1e-3,
            linear_finest: 1e-13,
            iterations: 300,
            central_start: 100.0,
            central_barrier: [0.1, 1.0],
            proximal: 1e-8,
            long_step: 0.7,
            near_centre: 4.0,
            stall_iterations: 50,
            paper_floor: 1e-2,
            paper_barrier: 1.0,
            step: StepParameters::default(),
        }
    }
}

/// How tau grows, where the iteration starts and how long its steps are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// The paper's.
    Paper,
    /// Tau grows near the central path only; steps lower the barrier function.
    Central,
}

impl Rule {
    fn name(self) -> &'static str {
        match self {
            Self::Paper => "pdip-literal",
            Self::Central => "pdip",
        }
    }

    /// Relative residual of the linear solves at first.
    fn linear_tolerance(self) -> f64 {
        match self {
            Self::Paper => 1e-6,
            Self::Central => 1e-2,
        }
    }

    /// A start inside the cones, and its 1/tau.
    fn start<'a>(
        self,
        problem: &'a Ccp,
        impulse: &[f64],
        scale: &ResidualScale,
        parameters: &Parameters,
    ) -> (Iterate<'a>, f64) {
        let known = impulse.iter().any(|&x| x != 0.0);
        let (unknown, floor, proximal) = match self {
            Self::Paper => (1.0, parameters.paper_floor, 0.0),
            Self::Central => (parameters.central_start, 1.0, parameters.proximal),
        };
        let normal = |i: usize, unit: f64| {
            if known { (impulse[3 * i] / unit).clamp(floor, parameters.central_start) } else { unknown }
        };
        let mut barrier = 0.0;
        let it = Iterate::new(problem, scale, proximal, normal, |mean| {
            barrier = match self {
                Self::Paper => parameters.paper_barrier,
                Self::Central => parameters.central_barrier[usize::from(known)] * mean / 3.0,
            };
            barrier
        });
        (it, barrier)
    }
}

/// The primal-dual interior point of the paper.
pub struct Pdip {
    newton: NewtonDriver,
    rule: Rule,
    /// The tuned constants.
    pub parameters: Parameters,
}

impl Pdip {
    /// With a linear solver of one's own.
    pub fn with_solver(rule: Rule, linear: Box<dyn NewtonSolver>) -> Self {
        Self { newton: NewtonDriver::new(linear), rule, parameters: Parameters::default() }
    }
}

/// Offers no impulses at all, and the given ones projected on their cones. The smaller of their residuals.
fn offer_starts(
    problem: &Ccp,
    impulse: &[f64],
    scale: &ResidualScale,
    limits: &Limits<'_>,
    friction: FrictionModel,
    best: &mut Best<f64>,
) -> f64 {
    let mut g = vec![0.0; impulse.len()];
    let least = limits.measured(scale.residual(problem, &g, &problem.r, friction));
    best.offer(&g, least);
    if impulse.iter().all(|&x| x == 0.0) {
        return least;
    }
    for i in 0..problem.num_contacts() {
        let given = std::array::from_fn(|k| impulse[3 * i + k]);
        g[3 * i..3 * i + 3].copy_from_slice(&problem.cone(i).project(given));
    }
    let mut u = vec![0.0; g.len()];
    problem.velocity(&g, &mut u, &mut problem.delassus.work());
    let residual = limits.measured(scale.residual(problem, &g, &u, friction));
    best.offer(&g, residual);
    least.min(residual)
}

impl Pdip {
    /// A direction and the step along it, from linear solves that are made finer until there is one.
    fn step(
        &mut self,
        it: &mut Iterate,
        direction: &mut Direction,
        barrier: f64,
        linear_tolerance: &mut f64,
        patience: &Patience,
    ) -> Step {
        let parameters = &self.parameters;
        loop {
            it.direction(&mut self.newton, barrier, *linear_tolerance, direction);
            let step = match self.rule {
                Rule::Paper => by_residual(it, direction, barrier, &parameters.step),
                Rule::Central => by_barrier(it, direction, barrier, &parameters.step),
            };
            let is_finest = *linear_tolerance <= parameters.linear_finest;
            if step.taken > 0.0 || is_finest || patience.is_over() {
                return step;
            }
            *linear_tolerance =
                (*linear_tolerance * parameters.linear_tightening).max(parameters.linear_finest);
        }
    }
}

impl CcpSolver for Pdip {
    fn name(&self) -> String {
        format!("{}+{}", self.rule.name(), self.newton.linear_name())
    }

    fn iteration_limit(&self) -> usize {
        self.parameters.iterations
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        self.capabilities().require(&self.name(), problem)?;
        let limits = Limits::start(settings, self.parameters.iterations);
        check_start(problem, impulse)?;
        let scale = ResidualScale::new(problem);
        // The path starts inside the cones, far from the solution: what is better must not be lost on the
        // way.
        let mut best = Best::default();
        let residual = offer_starts(problem, impulse, &scale, &limits, settings.friction, &mut best);
        if residual <= settings.tolerance {
            best.restore(impulse);
            return Ok(limits.report(&self.name(), problem, impulse, Status::Converged, 0, 0));
        }
        let patience = limits.patience();
        self.newton.set_patience(patience.clone());
        self.newton.begin(problem);
        let (mut it, mut barrier) = self.rule.start(problem, impulse, &scale, &self.parameters);
        let mut direction = Direction::new(it.num_contacts());
        let (mut g, mut u) = (vec![0.0; impulse.len()], vec![0.0; impulse.len()]);
        let mut iterations = 0;
        let mut history = History::default();
        let mut progress = Progress::new(self.parameters.stall_iterations);
        let mut linear_tolerance = self.rule.linear_tolerance();
        let mut centred = false;
        let mut status = loop {
            // The residual of the problem itself, in its own units.
            it.physical(&mut g, &mut u);
            let found = scale.residual(problem, &g, &u, settings.friction);
            history.record(iterations, limits.seconds(), found);
            let residual = limits.measured(found);
            best.offer(&g, residual);
            if let Some(status) = limits.status(iterations, residual) {
                break status;
            }
            if it.runs_away() || (progress.has_ended(residual) && self.rule == Rule::Central) {
                break Status::Stalled;
            }
            let wanted = it.mean_complementarity() / self.parameters.tau_factor;
            match self.rule {
                Rule::Paper => barrier = wanted,
                Rule::Central if centred => {
                    barrier = barrier.min(wanted);
                    it.move_anchor();
                }
                Rule::Central => {}
            }
            if it.refresh(&mut self.newton, barrier, iterations, residual).is_err() {
                break Status::Stalled;
            }
            let step = self.step(&mut it, &mut direction, barrier, &mut linear_tolerance, &patience);
            let decrement = direction.decrease / (barrier * it.num_contacts() as f64);
            self.newton.end_iteration_with(
                step.taken,
                &[
                    ("barrier", barrier),
                    ("step_to_cone", step.cone),
                    ("step_of_multipliers", step.multipliers),
                    ("decrement", decrement),
                ],
            );
            if step.taken == 0.0 {
                break Status::Stalled;
            }
            it.advance_impulses(step.taken, &direction);
            it.advance_multipliers(step.multipliers, &direction);
            centred = step.taken >= self.parameters.long_step && decrement <= self.parameters.near_centre;
            iterations += 1;
            if iterations % 10 == 0 {
                // Rounding in the updated velocities must not accumulate.
                it.refresh_velocity();
            }
        };
        if status == Status::Stalled && best.residual() > infeasible::GOOD_ENOUGH {
            let scaled = Scaled::new(problem, &scale, &mut None);
            self.newton.change_problem(&scaled.problem);
            let found = infeasible::search(&mut self.newton, problem, &scaled, &limits, &mut iterations);
            if found.needed_velocity >= infeasible::PROBABLE {
                status = Status::Infeasible;
            }
        }
        best.restore(impulse);
        let report =
            limits.report_with(&self.name(), problem, impulse, status, iterations, &mut self.newton)?;
        Ok(SolveReport { history: history.into_samples(), ..report })
    }
}
