//! The contact problem of a step, solved part by part with impulses that make no energy.

use crate::parts::parts;
use graintrain_ccp::residual::ResidualScale;
use graintrain_ccp::{Ccp, CcpError, CcpSolver, Delassus, FrictionModel, SolveReport, SolveSettings, Status};
use graintrain_linalg::real;

/// What the solution part by part is tuned by.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Of parts of few contacts.
    pub few: FewParameters,
    /// Parts of fewer contacts than this neither remember the curvature of a solve nor are begun with one: it
    /// is that of a bed. Nor do ranks share them.
    pub bed: usize,
    /// Iterations of projected gradients that a part of many contacts may cost in a step with exact friction,
    /// where the settings name no limit.
    pub iterations: usize,
    /// And that one of few may cost: iterations times contacts are what they are for `many` contacts, with
    /// `most_iterations` at the most.
    pub many: usize,
    /// See `many`.
    pub most_iterations: usize,
    /// What the finish of a part may cost on top ([`SolveSettings::finish`]), where it has `many` contacts or
    /// fewer; iterations times contacts of larger ones are the same, which is too little from about 7 000
    /// contacts on.
    pub finish: usize,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            few: FewParameters::default(),
            bed: 1000,
            iterations: 12_000,
            many: 1024,
            most_iterations: 30_000,
            finish: 90_000,
        }
    }
}

impl Parameters {
    /// Iterations that a part of so many contacts may cost, and those of its finish, after so many attempts
    /// at the step that did not converge: the k-th attempt has a k-th of the first, and 30 cost what four do.
    fn iterations(&self, contacts: usize, unsolved: usize) -> [usize; 2] {
        let own =
            (self.iterations * self.many / contacts.max(1)).clamp(self.iterations, self.most_iterations);
        [own, self.finish * self.many / contacts.max(self.many)].map(|most| most / (1 + unsolved))
    }
}

/// How much finer than asked for small parts are solved. Few contacts cost next to nothing, and what a solve
/// leaves over is the same in every step of a body at rest, which starts from the impulses of the last: a
/// block on a slope would creep by it for ever (docs/mechanics.md, "Validation": A2, A10).
#[derive(Clone, Debug)]
pub struct FewParameters {
    /// Contacts of a small part at most.
    pub contacts: usize,
    /// Its tolerance over that of the settings.
    pub tolerance: f64,
    /// Iterations spent on that: where a heavy body stands on a light one, it may be out of reach.
    pub iterations: usize,
}

impl Default for FewParameters {
    fn default() -> Self {
        Self { contacts: 32, tolerance: 1e-3, iterations: 300 }
    }
}

/// Solves the connected parts of a problem apart.
pub(crate) struct PartSolver<'a> {
    pub solver: &'a mut dyn CcpSolver,
    pub settings: SolveSettings,
    pub parameters: &'a Parameters,
    /// Whether the solver has to see the whole problem.
    pub whole: bool,
    /// |gravity|, m/s^2.
    pub gravity: f64,
    /// dt, s.
    pub step: f64,
    /// Attempts at this step so far that did not converge.
    pub unsolved: usize,
}

impl PartSolver<'_> {
    /// Solves the problem part by part.
    ///
    /// # Errors
    /// Those of the solver.
    pub(crate) fn solve(&mut self, problem: &Ccp, impulse: &mut [f64]) -> Result<Solved, CcpError> {
        let Delassus::Rigid(rigid) = &*problem.delassus else {
            let report = self.solver.solve(problem, impulse, &self.settings)?;
            return Ok(Solved { report, parts: 1 });
        };
        if rigid.cell().is_some() {
            // A stress-controlled cell is one part.
            let settings = self.bounded(problem);
            let report = self.solver.solve(problem, impulse, &settings)?;
            return Ok(Solved { report, parts: 1 });
        }
        let contacts = problem.num_contacts();
        let parts = parts(rigid.contacts(), 0..contacts as u32, rigid.num_bodies(), rigid.coupled());
        if parts.len() == 1 || (contacts > 0 && self.whole) {
            let report = self.solve_one(problem, impulse)?;
            return Ok(Solved { report, parts: 1 });
        }
        let count = parts.len();
        let mut merged = SolveReport { solver: self.solver.name(), ..SolveReport::default() };
        let mut largest = 0;
        for part in parts {
            let (own, places) = part.problem(problem, rigid, (self.gravity, self.step));
            let mut g = part.gather::<3, f64>(impulse);
            let moments = &impulse[3 * contacts..];
            g.extend(places.iter().flat_map(|k| &moments[3 * k..3 * k + 3]));
            if parts_freely(&own) {
                g.fill(0.0);
            } else {
                let report = self.solve_one(&own, &mut g)?;
                merge(&mut merged, report, part.contacts.len() > largest);
                largest = largest.max(part.contacts.len());
            }
            part.scatter(&g[..3 * part.contacts.len()], impulse);
            for (k, h) in places.iter().zip(g[3 * part.contacts.len()..].chunks_exact(3)) {
                impulse[3 * (contacts + k)..3 * (contacts + k) + 3].copy_from_slice(h);
            }
        }
        Ok(Solved { report: merged, parts: count })
    }

    /// What is asked of the solve of a part.
    fn bounded(&self, problem: &Ccp) -> SolveSettings {
        let settings = self.settings.clone();
        // Relaxed problems (those without friction are), and methods that count iterations of their own, have
        // their limits.
        let is_exact = settings.friction == FrictionModel::Coulomb
            && problem.has_friction()
            && self.solver.capabilities().exact;
        if settings.max_iterations.is_some() || !is_exact {
            return settings;
        }
        let [iterations, finish] = self.parameters.iterations(problem.num_contacts(), self.unsolved);
        SolveSettings { max_iterations: Some(iterations), finish, ..settings }
    }

    /// Solves a part.
    fn solve_one(&mut self, problem: &Ccp, g: &mut [f64]) -> Result<SolveReport, CcpError> {
        let is_bed = problem.num_contacts() >= self.parameters.bed;
        let curvature = self.settings.curvature.filter(|_| is_bed);
        // Of a few contacts there is nothing to share: ranks would only wait for each other.
        let ranks = self.settings.ranks.clone().filter(|_| is_bed);
        let settings = SolveSettings { curvature, ranks, ..self.bounded(problem) };
        let mut report = solve_without_gain(self.solver, &self.parameters.few, problem, g, &settings)?;
        report.curvature = report.curvature.filter(|_| is_bed);
        Ok(report)
    }
}

/// What became of the problem of a step.
pub(crate) struct Solved {
    /// Merged over the parts.
    pub report: SolveReport,
    /// Connected parts with a problem to solve.
    pub parts: usize,
}

/// Friction nearer than this to all that a contact can have slides.
const EDGE: f64 = 1e-9;

/// A solver and what is left of its iterations.
struct Budget<'a> {
    solver: &'a mut dyn CcpSolver,
    problem: &'a Ccp,
    settings: &'a SolveSettings,
    /// Iterations left, where they are bounded.
    left: Option<usize>,
}

impl Budget<'_> {
    /// Goes on from g to this tolerance, with no more iterations than `most`. Converged is what meets the
    /// tolerance of the settings.
    fn solve(&mut self, g: &mut [f64], tolerance: f64, most: Option<usize>) -> Result<SolveReport, CcpError> {
        let max_iterations = self.left.into_iter().chain(most).min();
        // A part of the budget is no end, and a finish reaches no tighter tolerance.
        let is_whole = most.is_none() && tolerance >= self.settings.tolerance;
        let finish = if is_whole { self.settings.finish } else { 0 };
        let settings = SolveSettings { tolerance, max_iterations, finish, ..self.settings.clone() };
        let mut report = self.solver.solve(self.problem, g, &settings)?;
        self.left = self.left.map(|left| left.saturating_sub(report.iterations));
        if report.status != Status::Stopped && self.is_good(&report) {
            (report.status, report.remark) = (Status::Converged, None);
        } else if report.status == Status::Converged {
            report.status = Status::Stalled;
        }
        Ok(report)
    }

    fn is_good(&self, report: &SolveReport) -> bool {
        report.residual.measured(self.settings.criterion) <= self.settings.tolerance
    }

    /// Whether there is something left to do and to do it with.
    fn goes_on(&self, report: &SolveReport) -> bool {
        matches!(report.status, Status::Stalled | Status::IterationLimit) && self.left != Some(0)
    }
}

/// Solves a problem with impulses that make no energy. Exact ones have g . (N g + r) = 0 (negative where
/// friction is exact); those of an iteration miss it within their residual, and g . D^T v+ > 0 is energy from
/// nowhere. On the ray of g the objective is least at s = -g . r / (g . N g), where the product vanishes, and
/// s < 1 stays in the cones. Where that lifts the residual above the tolerance, the solver goes on from there
/// to a tighter one; where that does not help either, the impulses stay as they were found.
pub(crate) fn solve_without_gain(
    solver: &mut dyn CcpSolver,
    few: &FewParameters,
    problem: &Ccp,
    g: &mut [f64],
    settings: &SolveSettings,
) -> Result<SolveReport, CcpError> {
    let mut budget = Budget { solver, problem, settings, left: settings.max_iterations };
    let mut first = solve_finely_if_few(&mut budget, few, g)?;
    let measured = first.residual.measured(settings.criterion);
    if first.status == Status::Stalled && measured <= 2.0 * settings.tolerance && budget.goes_on(&first) {
        // With a heavy body on a light one the iteration and the report differ by rounding: it has to aim a
        // little lower.
        first = budget.solve(g, 0.5 * settings.tolerance, None)?.after(&first);
    }
    let mut report = first.clone();
    let mut kept = Vec::new();
    for tighter in [Some(0.3), Some(0.1), None] {
        let along: f64 = g.iter().zip(&problem.r).map(|(g, r)| g * r).sum();
        // The objective is 1/2 g . N g + g . r.
        let (gain, square) = (2.0 * report.objective - along, 2.0 * (report.objective - along));
        if gain.is_nan() || gain <= 0.0 || report.status == Status::Stopped {
            return Ok(report);
        }
        if kept.is_empty() {
            kept = g.to_vec();
        }
        // Impulses left over from a contact that opens have their optimum below zero.
        let scale = if square > gain { 1.0 - gain / square } else { 0.0 };
        g.iter_mut().for_each(|g| *g *= scale);
        evaluate(problem, g, settings.friction, &mut report);
        if report.status != Status::Converged || budget.is_good(&report) {
            return Ok(report);
        }
        let Some(tighter) = tighter.filter(|_| budget.left != Some(0)) else { break };
        report = budget.solve(g, tighter * settings.tolerance, None)?.after(&report);
        if !report.converged() && report.status != Status::Stopped {
            break;
        }
    }
    if report.status == Status::Stopped {
        return Ok(report);
    }
    g.copy_from_slice(&kept);
    let SolveReport { iterations, linear_iterations, products, seconds, stages, .. } = report;
    Ok(SolveReport { iterations, linear_iterations, products, seconds, stages, ..first })
}

/// Solves to the tolerance, and small problems beyond it: see [`FewParameters`].
fn solve_finely_if_few(
    budget: &mut Budget<'_>,
    few: &FewParameters,
    g: &mut [f64],
) -> Result<SolveReport, CcpError> {
    let tolerance = budget.settings.tolerance;
    if budget.problem.num_contacts() > few.contacts {
        return budget.solve(g, tolerance, None);
    }
    let tried = solve_as_if_nothing_slid(budget, few, g)?;
    if let Some(report) = &tried {
        let is_fine = report.residual.measured(budget.settings.criterion) <= few.tolerance * tolerance;
        if is_fine || report.status == Status::Stopped || budget.left == Some(0) {
            return Ok(report.clone());
        }
    }
    let mut finer = budget.solve(g, few.tolerance * tolerance, Some(few.iterations))?;
    if let Some(tried) = tried {
        finer = finer.after(&tried);
    }
    if !budget.goes_on(&finer) {
        return Ok(finer);
    }
    Ok(budget.solve(g, tolerance, None)?.after(&finer))
}

/// Exact friction has several solutions where bodies are held by friction alone (a box between two jaws: at
/// rest, or let go by one edge after the other), and which one an iteration finds depends on the way. That
/// where nothing slides solves the relaxed problem, too: g becomes the solution of that if it is exact, and
/// goes on from there if it is not found finely. The report tells how it went; `None`: it was not tried,
/// since g holds, or something slid in it and the bodies move one by one (with joints the rounds of a step
/// start from one another's solutions).
fn solve_as_if_nothing_slid(
    budget: &mut Budget<'_>,
    few: &FewParameters,
    g: &mut [f64],
) -> Result<Option<SolveReport>, CcpError> {
    let SolveSettings { friction, criterion, tolerance, .. } = *budget.settings;
    let is_plain = matches!(&*budget.problem.delassus, Delassus::Rigid(rigid) if rigid.is_plain());
    let slid = is_plain && slides(budget.problem, g);
    if friction == FrictionModel::Relaxed || !budget.problem.has_friction() || slid {
        return Ok(None);
    }
    let enough = few.tolerance * tolerance;
    let mut report = SolveReport::default();
    evaluate(budget.problem, g, friction, &mut report);
    if report.residual.measured(criterion) <= enough {
        return Ok(None);
    }
    let settings = SolveSettings {
        friction: FrictionModel::Relaxed,
        tolerance: enough,
        max_iterations: budget.left.into_iter().chain([few.iterations]).min(),
        finish: 0,
        ..budget.settings.clone()
    };
    let mut relaxed = g.to_vec();
    let mut report = budget.solver.solve(budget.problem, &mut relaxed, &settings)?;
    budget.left = budget.left.map(|left| left.saturating_sub(report.iterations));
    evaluate(budget.problem, &relaxed, friction, &mut report);
    if budget.is_good(&report) {
        g.copy_from_slice(&relaxed);
    } else {
        evaluate(budget.problem, g, friction, &mut report);
    }
    if report.status != Status::Stopped {
        report.status = if budget.is_good(&report) { Status::Converged } else { Status::IterationLimit };
        report.remark = None;
    }
    Ok(Some(report))
}

/// Whether a contact presses and has all the friction that it can have.
fn slides(problem: &Ccp, g: &[f64]) -> bool {
    let mut contacts = g.chunks_exact(3).zip(&problem.friction);
    contacts.any(|(g, mu)| g[0] > 0.0 && *mu > 0.0 && real::hypot(g[1], g[2]) >= (1.0 - EDGE) * mu * g[0])
}

/// Residuals and objective of these impulses.
fn evaluate(problem: &Ccp, g: &[f64], friction: FrictionModel, report: &mut SolveReport) {
    let scale = ResidualScale::new(problem);
    let mut u = vec![0.0; g.len()];
    problem.velocity(g, &mut u, &mut problem.delassus.work());
    let evaluation = scale.evaluate(problem, g, &u);
    (report.residual_relaxed, report.residual_coulomb) = (evaluation.relaxed, evaluation.coulomb);
    report.residual = evaluation.residual(friction);
    report.objective = problem.objective(g, &u);
}

/// Whether bodies part at every contact by themselves, r_i in Y_i^*, so that g = 0 solves the problem,
/// relaxed and exact.
fn parts_freely(problem: &Ccp) -> bool {
    let friction = problem.friction.iter();
    let turning = |i: usize| {
        let Some(k) = problem.turning_of(i) else { return 0.0 };
        let (own, w) = (problem.turning[k], &problem.r[3 * (problem.num_contacts() + k)..]);
        own.rolling * real::hypot(w[1], w[2]) + own.spinning * w[0].abs()
    };
    let mut contacts = problem.r.chunks_exact(3).zip(friction).enumerate();
    contacts.all(|(i, (r, mu))| r[0] >= mu * real::hypot(r[1], r[2]) + turning(i))
}

/// Adds the report of a part; the largest part gives the name and the history.
fn merge(all: &mut SolveReport, part: SolveReport, names: bool) {
    let rank = |status: Status| match status {
        Status::Converged => 0,
        Status::IterationLimit => 1,
        Status::Stalled => 2,
        Status::Infeasible => 3,
        Status::Stopped => 4,
    };
    if rank(part.status) > rank(all.status) {
        (all.status, all.remark) = (part.status, part.remark);
    }
    if names {
        (all.solver, all.history) = (part.solver, part.history);
    }
    all.iterations = all.iterations.max(part.iterations);
    all.linear_iterations += part.linear_iterations;
    all.products += part.products;
    all.curvature = all.curvature.into_iter().chain(part.curvature).reduce(f64::max);
    all.residual = all.residual.worse(part.residual);
    all.residual_relaxed = all.residual_relaxed.worse(part.residual_relaxed);
    all.residual_coulomb = all.residual_coulomb.worse(part.residual_coulomb);
    all.objective += part.objective;
    all.seconds += part.seconds;
    all.newton.extend(part.newton);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stalls just above the tolerance, and is stopped within it when it is asked for less.
    struct Stopped;

    impl CcpSolver for Stopped {
        fn name(&self) -> String {
            "stopped".into()
        }

        fn solve(
            &mut self,
            problem: &Ccp,
            g: &mut [f64],
            settings: &SolveSettings,
        ) -> Result<SolveReport, CcpError> {
            let asked_for_less = settings.tolerance == 0.5e-4;
            let mut report = SolveReport { solver: self.name(), ..SolveReport::default() };
            g[0] = if asked_for_less { 1.0 + 0.2e-4 } else { 1.0 + 1.5e-4 };
            evaluate(problem, g, settings.friction, &mut report);
            report.status = if asked_for_less { Status::Stopped } else { Status::Stalled };
            Ok(report)
        }
    }

    #[test]
    fn a_solve_that_was_stopped_never_counts_as_converged() {
        let entries = [(0, 0, 1.0), (1, 1, 1.0), (2, 2, 1.0)];
        let problem = Ccp::from_triplets(&entries, vec![-1.0, 0.0, 0.0], vec![0.3]).unwrap();
        let settings = SolveSettings { tolerance: 1e-4, ..SolveSettings::default() };
        let mut g = vec![0.0; 3];
        let report =
            solve_without_gain(&mut Stopped, &FewParameters::default(), &problem, &mut g, &settings).unwrap();
        assert!(report.residual.max < 1e-4, "{:?}", report.residual);
        assert_eq!(report.status, Status::Stopped);
    }
}
