//! The cascade: which methods a solver by name tries, one after the other, within one budget.
//!
//! A [`Cascade`] is a list of members and, for relaxed and for exact friction, a table of stages. The driver
//! alone owns the budget, the best impulses with their residual, the history and the status; a stage says who
//! works, from what, and how much it may cost. All is decided by counts of operations and by residuals, never
//! by the clock.
//!
//! **Budget.** [`SolveSettings::max_iterations`] bounds the whole. It counts iterations of projected
//! gradients; other methods say what theirs cost in these ([`Cost`]). A stage gets half of what is left at
//! most, the last one all of it; one that could not do anything with its share is left out. So a solve with a
//! limit ends with a method that makes a small residual a little smaller rather than in the midst of one that
//! swings.
//!
//! **Finish.** Where masses differ by many orders, first-order methods end a solve with a limit before they
//! have found which bodies carry which, and bodies pass through each other. [`SolveSettings::finish`] allows
//! some relaxed problems by a second-order method on top, with De Saxce's shift held [from
//! below](fixed_point::from_below): what they leave over lets bodies part, and next to none approach.
//! Before them comes the search for a proof that there is no solution, for as much again at most: of what is
//! jammed nothing else is to be said.
//!
//! **Exact friction.** `apgs`, `pgs` and `apgd` treat it in their iterations ([`CcpSolver::solve_exact`]).
//! The problem has no objective, and any of them may circle where another gets on, those with a momentum
//! most. So they hold a race: a turn of each, from where the one before ended, the same from none, then it is
//! the turn of the one that gained most per iteration in its last. Where their systems are small, a piece of
//! the [path](super::path_following) comes between. Where nobody gains any more come the search for a proof
//! that the problem without friction has no solution (then this one has none), the whole path from large tau,
//! and last the [fixed point](super::fixed_point) on the convex problem with the shift held.

use super::accelerated_sweeps::AcceleratedSweeps;
use super::apgd::Apgd;
use super::driver::{Best, Limits, check_start};
use super::first_order::FirstOrder;
use super::fixed_point;
use super::gauss_seidel::GaussSeidel;
use super::history::History;
use super::infeasible;
use super::interface::{Capabilities, CcpSolver, Cost, ExactState};
use super::ipm::Ipm;
use super::path_following::PathFollowing;
use super::report::{SolveReport, StageRecord, Status};
use super::settings::SolveSettings;
use super::single;
use crate::delassus::{Delassus, RigidContact};
use crate::newton::NewtonRecord;
use crate::problem::{Ccp, CcpError, KnownMatrix};
use crate::residual::{FrictionModel, Residual};
use graintrain_linalg::real;

/// Below this tolerance the interior point goes first where friction is relaxed: an iteration of `apgd` costs
/// nanoseconds per contact and it profits from a warm start, `ipm` needs factorisations but few iterations
/// whatever the tolerance.
const TIGHT: f64 = 1e-6;

/// Checks (one in ten iterations) that the first relaxed stage of `auto` may go without taking a tenth off
/// its least residual. Settled packings creep for hundreds of iterations, jammed ones for ever.
const PATIENCE: usize = 500;

/// Iterations of a turn of a race over those that there are for it, and the least and the most of them.
pub(super) const TURN: (f64, [usize; 2]) = (1.0 / 12.0, [500, 2500]);
/// First turn of the first runner in such turns; far from a solution twice as many as its turn from no
/// impulses has: most problems are solved in one of them.
const FIRST: usize = 4;
/// Contacts from which on gradients run first, where single precision serves and where it does not: ranks
/// share them, and threads without limit. Threads share sweeps in single precision, which gain little
/// with so many contacts.
pub(super) const GRADIENTS_FIRST: [usize; 2] = [65_536, 8_192];
/// The next turn of a runner is twice as long. One that gained nothing in a turn of so many has given up.
pub(super) const LONGEST: usize = 40_000;
/// The finish is made where the residual is above this (and the tolerance): below, errors of the impulses are
/// those of single contacts.
pub(super) const ABOVE: f64 = 0.03;
/// Below [`ABOVE`] the path gets one part in so many of what a limit leaves.
const NEAR_PART: usize = 8;

/// Contacts up to which methods of second order lead to a solution for what 300 + 100 n iterations cost:
/// first-order methods get as much before them.
const SMALL: usize = 16;

/// Iterations of a turn where there are so many for the race.
fn turn(share: usize) -> usize {
    let (part, [least, most]) = TURN;
    ((share as f64 * part) as usize).clamp(least, most)
}

/// The runners of a race in their order: places among the three members.
fn runners(problem: &Ccp, settings: &SolveSettings) -> &'static [usize] {
    let [in_single, in_double] = GRADIENTS_FIRST;
    let is_large =
        problem.num_contacts() >= if single::suits(problem, settings) { in_single } else { in_double };
    if problem.contacts_across() > 0 {
        // Over the rows of a cell sweeps would cost many times what gradients do over its bodies.
        &[0]
    } else if is_large || touches_at_faces(problem) {
        &[0, 1, 2]
    } else {
        &[1, 2, 0]
    }
}

/// Whether most contacts are further ones of two bodies, as those of boxes on boxes are. There gradients need
/// fewer iterations than sweeps, and what they leave over makes a straight tower lean by a tenth as much
/// (`graintrain verify`, A10).
fn touches_at_faces(problem: &Ccp) -> bool {
    let Delassus::Rigid(rigid) = &*problem.delassus else { return false };
    let further =
        |pair: &&[RigidContact]| (pair[0].body_a, pair[0].body_b) == (pair[1].body_a, pair[1].body_b);
    2 * rigid.contacts().windows(2).filter(further).count() > rigid.num_contacts()
}

/// What a member does in a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Task {
    /// Solves the problem as it is: [`CcpSolver::solve`].
    Solve,
    /// Treats exact friction in its own iterations: [`CcpSolver::solve_exact`].
    Exact,
    /// The same by this and the next two members ([`runners`]), a turn of each.
    Round,
    /// The same from no impulses: those of another time may be the worst start of all. Far from a solution a
    /// turn of the first of them.
    Afresh,
    /// The same in turns, until nobody gains.
    Race,
    /// Searches for a proof that there is no solution: [`infeasible`].
    Proof,
    /// Solves relaxed problems with De Saxce's shift held: [`fixed_point`].
    FixedPoint,
    /// The same from below, as the answer whatever the residual: [`fixed_point::from_below`].
    Finish,
}

/// The impulses that a stage starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Start {
    /// The best so far.
    Best,
    /// Where the last [`Task::Exact`] ended: on the way to a solution residuals have to rise now and then.
    Last,
    /// None.
    Zero,
}

/// Who works, how, from what, and for how much.
#[derive(Clone, Copy, Debug)]
struct Stage {
    member: usize,
    task: Task,
    start: Start,
    /// What it may cost, in iterations of projected gradients.
    most: usize,
}

impl Stage {
    const fn new(member: usize, task: Task, start: Start, most: usize) -> Self {
        Self { member, task, start, most }
    }
}

/// A solver by name, for relaxed and exact friction: see the [module](self).
pub struct Cascade {
    name: String,
    members: Vec<Box<dyn CcpSolver>>,
    /// Tables for loose and tight tolerances where friction is relaxed, and for exact friction.
    relaxed: [Vec<Stage>; 2],
    exact: Vec<Stage>,
    /// N as a matrix of the last problem for which a member needed it.
    matrix: KnownMatrix,
}

/// The runners of a race, gradients, sweeps with a momentum and sweeps without, and the path. Over-relaxed by
/// 1.3, sweeps without momentum need 0.7 of the iterations among grains that roll.
fn exact_members() -> [Box<dyn CcpSolver>; 4] {
    [
        Box::new(FirstOrder::new(Apgd::default())),
        Box::new(FirstOrder::new(AcceleratedSweeps::default())),
        Box::new(FirstOrder::new(GaussSeidel { relaxation: 1.3 })),
        Box::new(PathFollowing::default()),
    ]
}

/// A method that takes part in a race.
struct Runner {
    member: usize,
    /// Iterations of its next turn.
    length: usize,
    /// ln(residual before / after) of its last turn per iteration; none before its first.
    rate: Option<f64>,
    /// It would reach the tolerance in another turn as long, as it got on in the later half of that one.
    arrives: bool,
}

/// The search for a proof, by what the systems of a member cost.
const fn proof(member: usize) -> Stage {
    Stage::new(member, Task::Proof, Start::Best, 60_000)
}

/// Exact friction with the members of [`exact_members`] from number `first` on, and relaxed ones for the
/// fixed point, of which the last, of second order, makes the finish.
fn exact_table(first: usize, relaxed: &[usize]) -> Vec<Stage> {
    let path = first + 3;
    let mut table = vec![
        Stage::new(first, Task::Round, Start::Last, 30_000),
        Stage::new(first, Task::Afresh, Start::Zero, 30_000),
        // Where its systems are small, the path soon leads on.
        Stage::new(path, Task::Solve, Start::Best, 30_000),
        Stage::new(first, Task::Race, Start::Last, usize::MAX),
        proof(relaxed[relaxed.len() - 1]),
        Stage::new(path, Task::Solve, Start::Zero, 1_000_000),
    ];
    table.extend(relaxed.iter().map(|&member| Stage::new(member, Task::FixedPoint, Start::Best, 300_000)));
    table.extend(relaxed.last().map(|&member| Stage::new(member, Task::Finish, Start::Zero, usize::MAX)));
    table
}

impl Cascade {
    /// `auto`: the solver that is likely to reach the tolerance first, and others where it does not.
    pub fn auto() -> Self {
        let [first, ipm, patient, exact] = [0, 1, 2, 3];
        let mut members: Vec<Box<dyn CcpSolver>> = vec![
            Box::new(FirstOrder::with_patience(Apgd::default(), PATIENCE)),
            Box::new(Ipm::new()),
            Box::new(FirstOrder::new(Apgd::default())),
        ];
        members.extend(exact_members());
        let solve = |member, most| Stage::new(member, Task::Solve, Start::Best, most);
        Self {
            name: "auto".to_string(),
            members,
            // About ten times what a settled packing needs for 1e-4 from a cold start.
            relaxed: [
                vec![solve(first, 30_000), solve(ipm, usize::MAX), solve(patient, 30_000), proof(ipm)],
                vec![solve(ipm, usize::MAX), solve(patient, 100_000), proof(ipm)],
            ],
            exact: exact_table(exact, &[exact + 1, exact, ipm]),
            matrix: None,
        }
    }

    /// `ipm`, with the exact stages of [`Self::auto`]: near a solution of the exact problem Newton's method
    /// on the projection was six times slower than gradients and sweeps are, and away from one it circles
    /// like them.
    pub fn interior_point() -> Self {
        let mut cascade = Self::of(Box::new(Ipm::new()));
        cascade.members.extend(exact_members());
        cascade.exact = exact_table(1, &[0]);
        cascade
    }

    /// A method alone: its relaxed solve; for exact friction its own iterations, where it has any, and the
    /// fixed point.
    pub fn of(member: Box<dyn CcpSolver>) -> Self {
        let limit = member.iteration_limit();
        let alone = vec![Stage::new(0, Task::Solve, Start::Best, usize::MAX)];
        let mut exact = Vec::new();
        if member.capabilities().exact {
            let own = |start| Stage::new(0, Task::Exact, start, 90_000);
            exact = vec![own(Start::Last), own(Start::Zero)];
        }
        exact.push(Stage::new(0, Task::FixedPoint, Start::Best, limit.saturating_mul(10)));
        Self {
            name: member.name(),
            members: vec![member],
            relaxed: [alone.clone(), alone],
            exact,
            matrix: None,
        }
    }

    /// A method that treats exact friction itself, alone.
    pub fn of_exact(member: Box<dyn CcpSolver>) -> Self {
        let alone = vec![Stage::new(0, Task::Solve, Start::Best, usize::MAX)];
        Self { exact: alone, ..Self::of(member) }
    }

    fn table(&self, settings: &SolveSettings) -> &[Stage] {
        match settings.friction {
            FrictionModel::Coulomb => &self.exact,
            FrictionModel::Relaxed => &self.relaxed[usize::from(settings.tolerance < TIGHT)],
        }
    }
}

impl CcpSolver for Cascade {
    fn name(&self) -> String {
        self.name.clone()
    }

    /// Those of its first member; N is made a matrix for who needs it.
    fn capabilities(&self) -> Capabilities {
        Capabilities { cell: true, coupling: true, ..self.members[0].capabilities() }
    }

    fn iteration_limit(&self) -> usize {
        self.members[0].iteration_limit()
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        // Without friction anywhere s = mu |u_t| = 0, and the exact problem is the relaxed one.
        let friction = if problem.has_friction() { settings.friction } else { FrictionModel::Relaxed };
        let settings = &SolveSettings { friction, ..settings.clone() };
        if !problem.turning.is_empty() && !self.capabilities().turning {
            return self.members[0].solve(problem, impulse, settings);
        }
        let fits = |stage: &&Stage| {
            let of_member = self.members[stage.member].capabilities();
            match stage.task {
                Task::Finish if settings.finish == 0 => false,
                // Where friction is relaxed `ipm` has searched, if it takes the problem.
                Task::Proof if friction == FrictionModel::Relaxed && of_member.fit(problem) => false,
                Task::Proof => Capabilities { turning: true, ..of_member }.fit(problem),
                _ => of_member.fit(problem),
            }
        };
        let mut table: Vec<Stage> = self.table(settings).iter().filter(fits).copied().collect();
        if table.is_empty() {
            // What was asked for is done, whatever a matrix costs.
            table = self.table(settings)[..1].to_vec();
        }
        check_start(problem, impulse)?;
        self.matrix = self.matrix.take().filter(|(of, _)| of.is(&problem.delassus));
        let limits = Limits::start(settings, usize::MAX);
        let is_exact = friction == FrictionModel::Coulomb;
        let mut course = Course::new(impulse, self.members.len(), table.len());
        let contacts = problem.num_contacts();
        let is_small = contacts <= SMALL && self.members.len() > 1;
        let last = table.iter().rposition(|stage| !matches!(stage.task, Task::Finish | Task::Proof));
        for (place, stage) in table.iter().enumerate() {
            let gets_all = Some(place) == last || stage.most == usize::MAX;
            let residual = course.best.residual();
            let is_near = residual <= ABOVE.max(settings.tolerance);
            let is_limited = limits.iterations_left(0) != usize::MAX;
            let share = match stage.task {
                Task::Finish if is_near => 0,
                Task::Finish => settings.finish,
                Task::Proof if residual <= infeasible::GOOD_ENOUGH || is_limited && is_near => 0,
                Task::Proof => course.left(&limits).max(settings.finish),
                _ if gets_all => course.left(&limits),
                _ if is_small && (place == 0 || stage.task == Task::Afresh) => {
                    (300 + 100 * contacts).min(course.left(&limits).div_ceil(2))
                }
                // A factorisation costs what hundreds of iterations do, of which few are missing.
                Task::Solve if is_exact && is_limited && is_near && !is_small => {
                    course.left(&limits) / NEAR_PART
                }
                _ => course.left(&limits).div_ceil(2),
            };
            let share = share.min(stage.most);
            if place > 0 && share == 0 {
                continue;
            }
            let ended = match stage.task {
                Task::Round | Task::Race => {
                    self.race(stage, share, problem, settings, &limits, &mut course)?
                }
                Task::Afresh => self.afresh(stage, share, problem, settings, &limits, &mut course)?,
                _ => self.make(stage, share, problem, settings, &limits, &mut course)?,
            };
            if ended {
                break;
            }
        }
        course.best.restore(impulse);
        Ok(course.report(self, problem, impulse, &limits))
    }
}

/// The first of the runners that gain most, those before their first turn before all; of those that gain
/// nothing, the one with the shortest turn.
fn next_of(runners: &[Runner]) -> usize {
    let rate = |k: usize| runners[k].rate.unwrap_or(f64::INFINITY);
    let better = |a: usize, b: usize| {
        let is_shorter = rate(b) <= 0.0 && runners[b].length < runners[a].length;
        if rate(b) > rate(a) || rate(b) == rate(a) && is_shorter { b } else { a }
    };
    (0..runners.len()).reduce(better).unwrap_or_default()
}

impl Cascade {
    /// Members take turns, each from where the one before ended; after a first turn of each it is that of the
    /// one whose last turn gained most per iteration. Ends where nobody gains; whether it ends the solve.
    fn race(
        &mut self,
        stage: &Stage,
        share: usize,
        problem: &Ccp,
        settings: &SolveSettings,
        limits: &Limits<'_>,
        course: &mut Course,
    ) -> Result<bool, CcpError> {
        let turn = turn(share);
        let is_round = stage.task == Task::Round;
        let order = runners(problem, settings);
        let runner = |(place, k): (usize, &usize)| {
            let length = if place == 0 && is_round { FIRST * turn } else { turn };
            Runner { member: stage.member + k, length, rate: None, arrives: false }
        };
        let mut runners: Vec<Runner> = order.iter().enumerate().map(runner).collect();
        let (begun, mut start, mut last) = (course.spent, stage.start, 0);
        loop {
            let left = share - ((course.spent - begun) as usize).min(share);
            if !runners[last].arrives {
                last = next_of(&runners);
                let Runner { length, rate, .. } = runners[last];
                if (rate == Some(0.0) && length > LONGEST) || (is_round && rate.is_some()) {
                    return Ok(false);
                }
            }
            if left == 0 {
                return Ok(false);
            }
            let next = &mut runners[last];
            let before = course.best.residual();
            let spent = course.spent;
            let own = Stage { member: next.member, task: Task::Exact, start, ..*stage };
            if self.make(&own, next.length.min(left), problem, settings, limits, course)? {
                return Ok(true);
            }
            let cost = course.spent - spent;
            if cost == 0.0 {
                return Ok(false);
            }
            start = Start::Last;
            let gain = before.min(course.first) / course.best.residual();
            let rate = if gain > 1.0 { real::ln(gain) / cost } else { 0.0 };
            next.rate = Some(rate);
            next.arrives = course.late_gain > course.best.residual() / settings.tolerance;
            next.length *= 2;
        }
    }

    /// The runners of a race take their first turns from no impulses, where the residual is above [`ABOVE`]
    /// the first of them alone. Where that leads nowhere, what follows goes on as if it had not been; whether
    /// it ends the solve.
    fn afresh(
        &mut self,
        stage: &Stage,
        share: usize,
        problem: &Ccp,
        settings: &SolveSettings,
        limits: &Limits<'_>,
        course: &mut Course,
    ) -> Result<bool, CcpError> {
        if course.given.iter().all(|&g| g == 0.0) {
            return Ok(false);
        }
        let (before, last, memory) = (course.best.residual(), course.last.clone(), course.memory.clone());
        let ended = if before <= ABOVE.max(settings.tolerance) {
            let round = Stage { task: Task::Round, ..*stage };
            self.race(&round, share, problem, settings, limits, course)?
        } else {
            let member = stage.member + runners(problem, settings)[0];
            let own = Stage { member, task: Task::Exact, ..*stage };
            let turn = FIRST / 2 * turn(share);
            self.make(&own, turn.min(share), problem, settings, limits, course)?
        };
        if course.best.residual() >= before {
            (course.last, course.memory) = (last, memory);
        }
        Ok(ended)
    }

    /// Makes a stage that may cost so much; whether it ends the solve.
    fn make(
        &mut self,
        stage: &Stage,
        share: usize,
        problem: &Ccp,
        settings: &SolveSettings,
        limits: &Limits<'_>,
        course: &mut Course,
    ) -> Result<bool, CcpError> {
        let is_only = self.members.len() == 1 && stage.task == Task::Solve;
        let member = self.members[stage.member].as_mut();
        let capabilities = member.capabilities();
        let matrix = problem.as_matrix_if(|rigid| !capabilities.take(rigid), &mut self.matrix);
        let problem = matrix.as_ref().unwrap_or(problem);
        // A single method counts in its own iterations.
        let cost = if is_only { Cost::default() } else { member.cost(problem) };
        let allowed = ((share as f64 - cost.start).max(0.0) / cost.iteration) as usize;
        let is_limited = limits.iterations_left(0) != usize::MAX;
        let is_optional = is_limited || stage.task == Task::Proof;
        if allowed < cost.least && is_optional && !course.stages.is_empty() {
            return Ok(false);
        }
        let bounded = share != usize::MAX;
        let settings = SolveSettings {
            max_iterations: bounded.then_some(allowed),
            max_time: limits.time_left(),
            curvature: settings.curvature.or(course.curvature),
            ..settings.clone()
        };
        let begun = limits.seconds();
        let mut g = course.start(stage.start);
        let report = match stage.task {
            Task::Solve => member.solve(problem, &mut g, &settings),
            Task::Exact | Task::Round | Task::Afresh | Task::Race => {
                let mut state = ExactState {
                    last: std::mem::take(&mut course.last),
                    memory: course.memory[stage.member],
                };
                if stage.start == Start::Zero {
                    state.last.fill(0.0);
                    state.memory = None;
                }
                let exact = member.solve_exact(problem, &mut g, &mut state, &settings);
                (course.last, course.memory[stage.member]) = (state.last, state.memory);
                exact.map(|report| report.expect("the member is capable of exact friction"))
            }
            Task::Proof => infeasible::verdict(problem, &g, course.status, &settings),
            Task::FixedPoint => fixed_point::solve(member, problem, &mut g, &settings),
            Task::Finish => {
                let report = fixed_point::from_below(member, problem, &mut g, &settings);
                let is_whole = report.as_ref().is_ok_and(|report| report.status != Status::Stopped);
                if is_whole && g.iter().any(|&g| g != 0.0) {
                    course.best = Best::default();
                }
                report
            }
        };
        match report {
            Ok(report) => Ok(course.add(report, &g, stage.start, cost, begun, limits)),
            // Another member may be able to treat it.
            Err(_) if course.has_others => Ok(false),
            Err(error) => Err(error),
        }
    }
}

/// What the stages have come to.
struct Course {
    best: Best<f64>,
    last: Vec<f64>,
    /// [`ExactState::memory`] of every member.
    memory: Vec<Option<f64>>,
    given: Vec<f64>,
    /// What was spent, in iterations of projected gradients.
    spent: f64,
    status: Status,
    /// Report of the stage that ended the solve, on the best impulses.
    ended: Option<SolveReport>,
    sums: [usize; 3],
    curvature: Option<f64>,
    newton: Vec<NewtonRecord>,
    history: History,
    remark: Option<String>,
    stages: Vec<StageRecord>,
    /// First residual known.
    first: f64,
    /// Least residual of the first half of the last stage over that of the second one, squared: what as many
    /// iterations more would gain.
    late_gain: f64,
    /// Whether others may be able to do what one cannot.
    has_others: bool,
}

impl Course {
    fn new(impulse: &[f64], members: usize, stages: usize) -> Self {
        Self {
            best: Best::default(),
            last: impulse.to_vec(),
            memory: vec![None; members],
            given: impulse.to_vec(),
            spent: 0.0,
            status: Status::Stalled,
            ended: None,
            sums: [0; 3],
            curvature: None,
            newton: Vec::new(),
            history: History::default(),
            remark: None,
            stages: Vec::new(),
            first: f64::INFINITY,
            late_gain: 0.0,
            has_others: stages > 1,
        }
    }

    fn left(&self, limits: &Limits<'_>) -> usize {
        limits.iterations_left(self.spent as usize)
    }

    fn start(&self, start: Start) -> Vec<f64> {
        match start {
            Start::Zero => vec![0.0; self.given.len()],
            Start::Last if self.stages.is_empty() => self.given.clone(),
            Start::Best | Start::Last => {
                let mut g = self.given.clone();
                self.best.restore(&mut g);
                g
            }
        }
    }

    fn count(&mut self, report: &SolveReport, start: Start, cost: Cost) {
        self.spent += cost.start + cost.iteration * report.iterations as f64;
        let of_stage = [report.iterations, report.linear_iterations, report.products];
        self.sums.iter_mut().zip(of_stage).for_each(|(sum, own)| *sum += own);
        self.stages.push(StageRecord {
            solver: report.solver.clone(),
            start: format!("{start:?}").to_lowercase(),
            iterations: report.iterations,
            residual: report.residual,
            status: report.status,
        });
    }

    /// Takes what a stage came to; whether it ends the solve.
    fn add(
        &mut self,
        mut report: SolveReport,
        g: &[f64],
        start: Start,
        cost: Cost,
        begun: f64,
        limits: &Limits<'_>,
    ) -> bool {
        if let (None, Some(sample)) = (self.stages.first(), report.history.first()) {
            self.first = limits.measured(Residual { max: sample.max, rms: sample.rms });
        }
        let least = |is_late: bool| {
            let own = report.history.iter().filter(|s| (2 * s.iteration > report.iterations) == is_late);
            let measured = own.map(|s| limits.measured(Residual { max: s.max, rms: s.rms }));
            measured.fold(f64::INFINITY, f64::min)
        };
        let gain = (least(false) / least(true)).powi(2);
        self.late_gain = if gain.is_finite() { gain } else { 0.0 };
        self.history.append(&report.history, self.sums[0], begun);
        self.count(&report, start, cost);
        self.newton.append(&mut report.newton);
        self.curvature = report.curvature.or(self.curvature);
        self.status = report.status;
        if report.remark.is_some() {
            self.remark.clone_from(&report.remark);
        }
        self.best.offer(g, limits.measured(report.residual));
        let ends = matches!(report.status, Status::Converged | Status::Stopped | Status::Infeasible);
        if ends && report.converged() {
            self.ended = Some(report);
        }
        ends
    }

    /// The report on the best impulses.
    fn report(self, cascade: &Cascade, problem: &Ccp, impulse: &[f64], limits: &Limits<'_>) -> SolveReport {
        let [iterations, linear_iterations, products] = self.sums;
        let Self { status, curvature, newton, stages, remark, .. } = self;
        let solver = cascade.reported(&stages);
        let report = match self.ended {
            Some(report) => report,
            None => {
                let report = limits.report(&solver, problem, impulse, status, iterations, linear_iterations);
                let remark = report.remark.clone().or(remark);
                SolveReport { remark, ..report }
            }
        };
        let (seconds, history) = (limits.seconds(), self.history.into_samples());
        SolveReport {
            solver,
            iterations,
            linear_iterations,
            products,
            curvature,
            seconds,
            newton,
            history,
            stages,
            ..report
        }
    }
}

impl Cascade {
    /// The name with those of the members that worked.
    fn reported(&self, stages: &[StageRecord]) -> String {
        let mut names: Vec<&str> = stages.iter().map(|stage| stage.solver.as_str()).collect();
        names.dedup();
        names.truncate(4);
        match names.as_slice() {
            [] => self.name.clone(),
            [only] if *only == self.name => self.name.clone(),
            // No commas: it is a field of tables.
            _ => format!("{} ({})", self.name, names.join(" > ")),
        }
    }
}
