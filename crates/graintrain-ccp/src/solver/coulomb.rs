//! Exact Coulomb friction by a sequence of relaxed problems, for every solver.
//!
//! Source: G. De Saxce, Z.-Q. Feng, "The bipotential method", Mathematical and Computer Modelling 28:225-245, 1998;
//! V. Acary, F. Cadoux, C. Lemarechal, J. Malick, "A formulation of the linear discrete Coulomb friction problem via
//! convex optimization", ZAMM 91(2):155-175, 2011.

use super::driver::{Best, Limits, check_start};
use super::history::History;
use super::interface::{CELL_CONTACTS, CcpSolver};
use super::report::{SolveReport, Status};
use super::settings::SolveSettings;
use crate::newton::NewtonRecord;
use crate::problem::{Ccp, CcpError};
use crate::residual::{FrictionModel, ResidualScale};

/// Gives a solver of the relaxed problem the exact one: with s_i = mu_i |(u_t)_i|,
///
/// ```text
/// solve the CCP with r_n + s for g;   s <- mu |u_t(g)|
/// ```
///
/// (with what rolling and spinning add where contacts resist turning, [`FrictionModel::Coulomb`]) until the residual of the exact problem is small. N and mu stay, and solvers keep what they prepared for them; every solve starts from the last impulses and is asked for a fraction of the exact
/// residual still there. Where the fixed point converges slowly or swings, s is extrapolated from its last two changes
/// (Irons and Tuck 1969, vector Aitken), kept at or above zero. Where the residual does not fall, the fraction is lowered and s
/// no longer extrapolated, only damped: in settled packings the map has slow modes (factors of 0.98) beside modes that swing (-1.1), and
/// errors of the solves hide the first.
///
/// A solver that treats exact friction in iterations of its own ([`CcpSolver::solve_exact`]) is tried first. Where its first round ends
/// without a solution and it has a [path to fall back on](CcpSolver::path_following), that is followed from the best impulses; then come
/// more rounds, from where the first one ended and from zero; then, unless that path came to its own end, the problem without friction
/// (where it has no solution, this one has none) and the whole path from large tau. All that is decided by counts of operations and by
/// residuals, never by the clock. The fixed point goes on from the best iterate where nothing of that converged. Relaxed solves pass straight through, and
/// so do problems without friction.
///
/// A limit of iterations holds for these two stages one by one, because they need not count the same: in the first one `ipm`
/// makes gradient steps and factorisations, in the second Newton systems. The report has their sum. Without a limit the second stage ends after ten
/// times the iterations that the solver allows itself for one relaxed solve ([`Status::IterationLimit`]).
pub struct CoulombIteration {
    relaxed: Box<dyn CcpSolver>,
    /// The tuned constants.
    pub parameters: Parameters,
}

/// What [`CoulombIteration`] is tuned by.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Outer iterations allowed; the sequence needs 5 to 30 where it converges easily, some hundreds in settled packings.
    pub outer_limit: usize,
    /// Iterations of a round of a solver that treats exact friction itself.
    pub round: usize,
    /// The path that the solver falls back on may take as much work as so many iterations.
    pub path_work: f64,
    /// And so many where it is followed from zero, after the rounds have come to nothing: they have taken some 2e5 iterations by then.
    pub last_path_work: f64,
    /// With more contacts across the boundary of a cell that gives way the path is not followed: its systems have a block for each two of them.
    pub cell_contacts: usize,
    /// Rounds go on while one of the last ones has lowered the least residual to this fraction.
    pub round_gain: f64,
    /// Rounds that may go by without that.
    pub round_patience: usize,
    /// Where the settings name no limit, all relaxed solves together may take so many times the iterations of one.
    pub nested_limit: usize,
    /// A relaxed solve is asked for this fraction of the exact residual: at first, and at the least.
    pub inner_fraction: [f64; 2],
    /// Outer iterations without a better residual before the fraction is lowered to a third.
    pub slow: usize,
    /// Outer iterations without a better residual before giving up.
    pub patience: usize,
    /// Least and largest factor of the extrapolation; the largest is 1 as soon as the residual was slow to fall.
    pub factor_range: [f64; 2],
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            outer_limit: 1000,
            round: 30_000,
            path_work: 30_000.0,
            last_path_work: 1e6,
            cell_contacts: CELL_CONTACTS,
            round_gain: 0.5,
            round_patience: 2,
            nested_limit: 10,
            inner_fraction: [0.3, 0.03],
            slow: 15,
            patience: 100,
            factor_range: [0.3, 2.0],
        }
    }
}

impl CoulombIteration {
    /// Wraps a solver of the relaxed problem.
    pub fn new(relaxed: Box<dyn CcpSolver>) -> Self {
        Self { relaxed, parameters: Parameters::default() }
    }
}

impl CcpSolver for CoulombIteration {
    fn name(&self) -> String {
        self.relaxed.name()
    }

    fn iteration_limit(&self) -> usize {
        self.relaxed.iteration_limit()
    }

    fn takes_cells(&self) -> bool {
        self.relaxed.takes_cells()
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        match effective(problem, settings) {
            Some(relaxed) => self.relaxed.solve(problem, impulse, &relaxed),
            None => self.exact(problem, impulse, settings),
        }
    }
}

/// The settings of a relaxed solve where that is what is asked for: without friction anywhere, s = mu |u_t| = 0 and the exact
/// problem is the relaxed one.
fn effective(problem: &Ccp, settings: &SolveSettings) -> Option<SolveSettings> {
    let is_relaxed = settings.friction == FrictionModel::Relaxed || !problem.has_friction();
    is_relaxed.then(|| SolveSettings { friction: FrictionModel::Relaxed, ..settings.clone() })
}

impl CoulombIteration {
    /// One round of the relaxed solver's own treatment of exact friction, then the path from the best impulses, for solvers that fall back
    /// on it. How long the path may be is decided by operations: a factorisation against an iteration.
    fn first_round(
        &mut self,
        problem: &Ccp,
        last: &mut [f64],
        settings: &SolveSettings,
        limits: &Limits<'_>,
        found: &mut Found,
    ) -> Result<Option<Status>, CcpError> {
        if self.relaxed.path_following().is_none() {
            return Ok(None);
        }
        let mut impulse = last.to_vec();
        let length = self.parameters.round;
        let ended = self.round(problem, &mut impulse, last, settings, length, limits, found)?;
        if ended.is_some() {
            return Ok(ended);
        }
        found.best.restore(&mut impulse);
        self.follow(problem, &mut impulse, self.parameters.path_work, settings, limits, found)
    }

    /// The path from these impulses, for solvers that fall back on it, with as many factorisations as cost so much. The status where it ends
    /// the solve.
    fn follow(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        work: f64,
        settings: &SolveSettings,
        limits: &Limits<'_>,
        found: &mut Found,
    ) -> Result<Option<Status>, CcpError> {
        let is_wide = problem.contacts_across() > self.parameters.cell_contacts;
        let takes_path = problem.turning.is_empty() && !is_wide;
        let Some(path) = self.relaxed.path_following().filter(|_| takes_path) else {
            return Ok(None);
        };
        let matrix = problem.with_cell_as_matrix();
        let problem = matrix.as_ref().unwrap_or(problem);
        let systems = (work / path.iterations_per_system(problem)) as usize;
        let left = settings.max_iterations.map_or(usize::MAX, |limit| limit.saturating_sub(found.steps));
        if left.min(systems) == 0 {
            return Ok(None);
        }
        let path_settings = SolveSettings {
            max_iterations: Some(left.min(systems)),
            max_time: limits.time_left(),
            ..settings.clone()
        };
        let begun = limits.seconds();
        let report = path.solve(problem, impulse, &path_settings)?;
        found.history.append(&report.history, found.steps, begun);
        found.steps += report.iterations;
        found.best.offer(impulse, limits.judged(report.residual));
        found.path_ended |= report.status == Status::Stalled;
        if report.remark.is_some() {
            found.remark = report.remark;
        }
        if report.status == Status::Converged {
            let before = found.solver.take().unwrap_or_default();
            found.solver = Some(format!("{before}, {}", report.solver));
        }
        found.newton.extend(report.newton);
        let over = matches!(report.status, Status::Converged | Status::Stopped);
        Ok(over.then_some(report.status))
    }

    /// Rounds of the relaxed solver's own treatment of exact friction, from `last`. The status that ends the solve, or `None` where
    /// the rounds no longer gain, or the solver has no such treatment.
    fn rounds(
        &mut self,
        problem: &Ccp,
        last: &mut [f64],
        settings: &SolveSettings,
        limits: &Limits<'_>,
        found: &mut Found,
    ) -> Result<Option<Status>, CcpError> {
        let mut impulse = last.to_vec();
        let (mut reference, mut since) = (f64::INFINITY, 0);
        while since < self.parameters.round_patience {
            let (before, length) = (found.steps, self.parameters.round);
            let ended = self.round(problem, &mut impulse, last, settings, length, limits, found)?;
            if ended.is_some() {
                return Ok(ended);
            }
            let residual = found.last_residual;
            let out_of_steps = settings.max_iterations.is_some_and(|limit| found.steps >= limit);
            if found.steps == before || out_of_steps || !residual.is_finite() {
                break;
            }
            since += 1;
            if residual <= self.parameters.round_gain * reference {
                (reference, since) = (residual, 0);
            }
        }
        Ok(None)
    }

    /// One round, of at most so many iterations. The status where it ends the solve; no iterations where the solver has no such treatment.
    fn round(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        last: &mut [f64],
        settings: &SolveSettings,
        length: usize,
        limits: &Limits<'_>,
        found: &mut Found,
    ) -> Result<Option<Status>, CcpError> {
        let left = settings.max_iterations.map_or(usize::MAX, |limit| limit.saturating_sub(found.steps));
        let round = SolveSettings {
            max_iterations: Some(left.min(length)),
            max_time: limits.time_left(),
            ..settings.clone()
        };
        let begun = limits.seconds();
        let Some(report) = self.relaxed.solve_exact(problem, impulse, last, &round)? else {
            return Ok(None);
        };
        found.history.append(&report.history, found.steps, begun);
        found.steps += report.iterations;
        found.products += report.products;
        found.last_residual = limits.judged(report.residual);
        found.best.offer(impulse, found.last_residual);
        found.solver = Some(report.solver);
        if report.remark.is_some() {
            found.remark = report.remark;
        }
        found.newton.extend(report.newton);
        let over = matches!(report.status, Status::Converged | Status::Stopped);
        Ok(over.then_some(report.status))
    }

    /// The problem without friction: where not even that has a solution, the exact one has none. Impulses that keep the bodies
    /// apart exist there, or nowhere; that a relaxed problem with friction has no solution proves nothing about the exact one.
    /// `iterations` of the limit are used up.
    fn without_friction(
        &mut self,
        problem: &Ccp,
        settings: &SolveSettings,
        limits: &Limits<'_>,
        iterations: usize,
    ) -> Result<SolveReport, CcpError> {
        let mut frictionless = Ccp { friction: vec![0.0; problem.num_contacts()], ..problem.clone() };
        for turning in &mut frictionless.turning {
            (turning.rolling, turning.spinning) = (0.0, 0.0);
        }
        let settings = SolveSettings {
            friction: FrictionModel::Relaxed,
            max_iterations: Some(limits.iterations_left(iterations).min(self.relaxed.iteration_limit())),
            max_time: limits.time_left(),
            ..settings.clone()
        };
        self.relaxed.solve(&frictionless, &mut vec![0.0; problem.r.len()], &settings)
    }

    /// The exact problem.
    fn exact(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        let limits = Limits::start(
            settings,
            self.parameters.nested_limit.saturating_mul(self.relaxed.iteration_limit()),
        );
        check_start(problem, impulse)?;
        let contacts = problem.num_contacts();
        let scale = ResidualScale::new(problem);
        // The relaxed solver must measure with the V of this problem, not of the shifted one. Both share N.
        let mut shifted = Ccp { velocity_scale: Some(scale.velocity), ..problem.clone() };
        let mut work = problem.delassus.work();
        let mut u = vec![0.0; problem.r.len()];
        let mut shift = Shift::new(contacts, self.parameters.factor_range);
        let mut found = Found::default();
        let mut last = impulse.to_vec();
        let mut ended = self.first_round(problem, &mut last, settings, &limits, &mut found)?;
        if ended.is_none() {
            ended = self.rounds(problem, &mut last, settings, &limits, &mut found)?;
        }
        if ended.is_none() && found.solver.is_some() && impulse.iter().any(|&g| g != 0.0) {
            // These iterations are chaotic: a start that leads nowhere need not be nearer to a solution than none.
            last.fill(0.0);
            ended = self.rounds(problem, &mut last, settings, &limits, &mut found)?;
        }
        let mut asked_without_friction = false;
        // (A path that came to its own end would come to it again.)
        let follows = self.relaxed.path_following().is_some() && problem.turning.is_empty();
        if ended.is_none() && follows && !found.path_ended {
            asked_without_friction = true;
            let report = self.without_friction(problem, settings, &limits, found.steps)?;
            found.steps += report.iterations;
            ended = matches!(report.status, Status::Infeasible | Status::Stopped).then_some(report.status);
        }
        if ended.is_none() && asked_without_friction {
            // The start that nothing was found from is left behind: all the way from large tau.
            last.fill(0.0);
            let work = self.parameters.last_path_work;
            ended = self.follow(problem, &mut last, work, settings, &limits, &mut found)?;
        }
        found.best.restore(impulse);
        if let Some(status) = ended {
            let name = found.solver.unwrap_or_else(|| self.name());
            let report = limits.report(&name, problem, impulse, status, found.steps, 0);
            let history = found.history.into_samples();
            let Found { products, newton, .. } = found;
            return Ok(SolveReport { products, history, newton, ..report });
        }
        let Found { mut best, steps, mut products, mut history, newton, remark, .. } = found;
        let (mut iterations, mut linear_iterations, mut since_best) = (0, 0, 0);
        let mut fraction = self.parameters.inner_fraction[0];
        let mut best_residual = f64::INFINITY;
        let mut last_inner = None;
        let mut status = Status::IterationLimit;
        for outer in 0..=self.parameters.outer_limit {
            problem.velocity(impulse, &mut u, &mut work);
            let exact = scale.residual(problem, impulse, &u, FrictionModel::Coulomb);
            history.record(steps + iterations, limits.seconds(), exact);
            let residual = limits.judged(exact);
            best.offer(impulse, residual);
            since_best += 1;
            if residual < 0.9 * best_residual {
                since_best = 0;
            }
            best_residual = residual.min(best_residual);
            if let Some(stop) = limits.status(iterations, residual) {
                status = stop;
                break;
            }
            if since_best > self.parameters.patience {
                // The relaxed solver's own verdict tells more than "stalled" where it has one.
                status = match last_inner {
                    Some(Status::IterationLimit) => Status::IterationLimit,
                    _ => Status::Stalled,
                };
                break;
            }
            if outer == self.parameters.outer_limit {
                break;
            }
            if since_best > 0 && since_best.is_multiple_of(self.parameters.slow) {
                fraction = (fraction / 3.0).max(self.parameters.inner_fraction[1]);
                shift.factor_range[1] = 1.0;
            }
            if outer > 0 || impulse.iter().any(|&g| g != 0.0) {
                shift.update((0..contacts).map(|i| problem.de_saxce(&u, i)));
            }
            for i in 0..contacts {
                shifted.r[3 * i] = problem.r[3 * i] + shift.value[i];
            }
            let inner = SolveSettings {
                tolerance: (fraction * residual).min(0.1).max(fraction * settings.tolerance),
                max_iterations: Some(limits.iterations_left(iterations).min(self.relaxed.iteration_limit())),
                max_time: limits.time_left(),
                friction: FrictionModel::Relaxed,
                ..settings.clone()
            };
            let report = self.relaxed.solve(&shifted, impulse, &inner)?;
            iterations += report.iterations;
            linear_iterations += report.linear_iterations;
            products += report.products;
            last_inner = Some(report.status);
            if report.status == Status::Infeasible && !asked_without_friction {
                asked_without_friction = true;
                let report = self.without_friction(problem, settings, &limits, iterations)?;
                iterations += report.iterations;
                if report.status == Status::Infeasible {
                    status = Status::Infeasible;
                    break;
                }
            }
        }
        best.restore(impulse);
        let report =
            limits.report(&self.name(), problem, impulse, status, steps + iterations, linear_iterations);
        // What the path came to tells most about exact friction, but not where there is no solution at all.
        let remark = report.remark.clone().or(remark.filter(|_| !report.converged()));
        Ok(SolveReport { products, history: history.into_samples(), newton, remark, ..report })
    }
}

/// What the rounds of a solver's own treatment of exact friction have come to.
#[derive(Default)]
struct Found {
    best: Best<f64>,
    steps: usize,
    products: usize,
    history: History,
    /// Residual of the last round.
    last_residual: f64,
    /// One per factorisation; these are among the steps.
    newton: Vec<NewtonRecord>,
    /// What the path had to say.
    remark: Option<String>,
    /// Whether the path came to its own end, not to that of its work.
    path_ended: bool,
    /// Who made the last round; `None` where there was none.
    solver: Option<String>,
}

/// The shift s of r_n and its fixed-point acceleration.
struct Shift {
    value: Vec<f64>,
    /// The last two changes that were asked for, the newer one first.
    changes: [Vec<f64>; 2],
    updates: usize,
    factor: f64,
    factor_range: [f64; 2],
}

impl Shift {
    fn new(contacts: usize, factor_range: [f64; 2]) -> Self {
        let zeros = || vec![0.0; contacts];
        let changes = [zeros(), zeros()];
        Self { value: zeros(), changes, updates: 0, factor: 1.0, factor_range }
    }

    /// s <- max(0, s + factor (image - s)), the factor after Aitken from the last two changes, within its bounds.
    fn update(&mut self, image: impl Iterator<Item = f64>) {
        self.changes.swap(0, 1);
        let [change, last] = &mut self.changes;
        for ((change, value), image) in change.iter_mut().zip(&self.value).zip(image) {
            *change = image - value;
        }
        if self.updates > 0 {
            let (mut across, mut square) = (0.0, 0.0);
            for (new, old) in change.iter().zip(&*last) {
                across += old * (new - old);
                square += (new - old) * (new - old);
            }
            if square > 0.0 {
                self.factor =
                    (-self.factor * across / square).clamp(self.factor_range[0], self.factor_range[1]);
            }
        }
        for (value, change) in self.value.iter_mut().zip(&*change) {
            *value = (*value + self.factor * change).max(0.0);
        }
        self.updates += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::super::driver::Limits;
    use super::{CoulombIteration, Parameters};
    use crate::delassus::Delassus;
    use crate::problem::{Ccp, CcpError};
    use crate::registry::{Method, SolverSpec};
    use crate::residual::FrictionModel;
    use crate::solver::interface::CcpSolver;
    use crate::solver::report::{SolveReport, Status};
    use crate::solver::settings::SolveSettings;
    use graintrain_linalg::block3::BlockMatrix3;

    /// Two coupled contacts.
    fn two_contacts(mu: f64) -> Ccp {
        let diagonal = [2.0, 0.1, 0.0, 0.1, 3.0, 0.0, 0.0, 0.0, 3.0];
        let coupling = [1.0, 0.0, 0.2, 0.0, 1.0, 0.0, 0.2, 0.0, 1.0];
        let matrix = BlockMatrix3::from_rows(
            vec![0, 2, 4],
            vec![0, 1, 0, 1],
            vec![diagonal, coupling, coupling, diagonal],
        );
        let r = vec![-1.0, 0.3, 0.0, -0.2, 0.0, 0.2];
        Ccp::new(Delassus::Sparse(matrix), r, vec![mu; 2]).unwrap()
    }

    #[test]
    fn without_friction_the_exact_problem_is_solved_as_the_relaxed_one() {
        let problem = two_contacts(0.0);
        for method in Method::available() {
            let solve = |friction| {
                let settings = SolveSettings { tolerance: 1e-7, friction, ..SolveSettings::default() };
                let mut impulse = vec![0.0; 6];
                let mut solver = SolverSpec::from(method).build().unwrap();
                let report = solver.solve(&problem, &mut impulse, &settings).unwrap();
                (report.status, report.iterations, impulse)
            };
            assert_eq!(solve(FrictionModel::Coulomb), solve(FrictionModel::Relaxed), "{method}");
        }
    }

    /// Treats exact friction in rounds whose answers and statuses are given.
    struct Scripted(Vec<(Vec<f64>, Status)>);

    impl CcpSolver for Scripted {
        fn name(&self) -> String {
            "scripted".to_string()
        }

        fn solve(
            &mut self,
            problem: &Ccp,
            impulse: &mut [f64],
            settings: &SolveSettings,
        ) -> Result<SolveReport, CcpError> {
            Ok(Limits::start(settings, 1).report("scripted", problem, impulse, Status::Stalled, 1, 0))
        }

        fn solve_exact(
            &mut self,
            problem: &Ccp,
            impulse: &mut [f64],
            last: &mut [f64],
            settings: &SolveSettings,
        ) -> Result<Option<SolveReport>, CcpError> {
            let (answer, status) = self.0.remove(0);
            impulse.copy_from_slice(&answer);
            last.copy_from_slice(&answer);
            let report = Limits::start(settings, 1).report(
                "scripted",
                problem,
                impulse,
                status,
                Parameters::default().round,
                0,
            );
            Ok(Some(SolveReport { products: 7, ..report }))
        }
    }

    #[test]
    fn a_round_that_is_stopped_does_not_lose_what_the_one_before_found() {
        let problem = two_contacts(0.5);
        let mut near = vec![0.0; 6];
        let friction = FrictionModel::Coulomb;
        let loose = SolveSettings { tolerance: 1e-3, friction, ..SolveSettings::default() };
        let mut apgd = "apgd".parse::<SolverSpec>().unwrap().build().unwrap();
        let expected = apgd.solve(&problem, &mut near, &loose).unwrap();
        let rounds = vec![(near.clone(), Status::IterationLimit), (vec![0.0; 6], Status::Stopped)];
        let mut solver = CoulombIteration::new(Box::new(Scripted(rounds)));
        let mut impulse = vec![0.0; 6];
        let settings = SolveSettings { tolerance: 0.0, friction, ..SolveSettings::default() };
        let report = solver.solve(&problem, &mut impulse, &settings).unwrap();
        assert_eq!((impulse, report.residual), (near, expected.residual));
        assert_eq!(report.status, Status::Stopped);
        assert_eq!((report.iterations, report.products), (2 * Parameters::default().round, 14));
    }
}
