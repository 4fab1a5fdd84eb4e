//! What the first-order methods share: the scaled problem, the iterate with its image, stopping.

use super::driver::{Best, Limits, Progress, check_start};
use super::history::History;
use super::interface::{Capabilities, CcpSolver, Cost, ExactState, ITERATION_LIMIT};
use super::lanes::{Batch, Lanes, Numbers};
use super::ranks::Ranks;
use super::report::{SolveReport, Status};
use super::scaling::{Image, PassWork, ScaledProblem};
use super::settings::SolveSettings;
use super::single::{self, SingleIterate, SingleProblem};
use super::start::sampled_residual;
use crate::delassus::{Delassus, DelassusIdentity};
use crate::problem::{Ccp, CcpError, TurningFriction};
use crate::residual::{FrictionModel, Residual, ResidualScale, velocity_scale};
use rayon::prelude::*;
use std::sync::Arc;

/// A method that works on the scaled problem with passes.
pub trait FirstOrderMethod: Send {
    /// Name on the command line.
    const NAME: &'static str;
    /// Whether the method treats exact Coulomb friction itself, by
    /// [`ContactBatch::allowed`](super::scaling::ContactBatch::allowed).
    const EXACT: bool = false;
    /// Whether the method takes contacts that resist turning.
    const TURNING: bool = false;

    /// Whether the method can begin in single precision.
    const SINGLE: bool = false;

    /// Whether the method makes [sweeps](ScaledProblem::sweep).
    const SWEEPS: bool = false;
    /// Whether the method does nothing but passes, of which each of several ranks can do a part.
    const SHARED: bool = false;

    /// Takes up how long its momentum was last allowed to be ([`ExactState::memory`]).
    fn remember(&mut self, _memory: Option<f64>) {}

    /// How long that is now.
    fn memory(&self) -> Option<f64> {
        None
    }

    /// Improves the iterate until it says to stop.
    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>);

    /// The same in single precision, for a method that can.
    fn run_single(&mut self, _it: &mut SingleIterate<'_>) {}
}

/// Iterations between two evaluations of the residual, each of which costs about as much as an iteration.
const CHECK: usize = 10;
/// Iterations between two evaluations of the image of x from x itself, a multiple of `CHECK`: two per cent of
/// the work.
const REFRESH: usize = 100;
/// A start may miss the tolerance by this factor on a few contacts and still be looked at on all
/// (docs/solvers.md, "Early exit").
pub(super) const NEAR: f64 = 1.5;
/// Iterations without which a further stage is not worth the packing.
const LEAST_ITERATIONS: usize = 100;

/// Makes a [`CcpSolver`] of a first-order method. The scaled problem is kept between solves and used again
/// while N, mu and V stay. Methods that can begin large problems in single precision.
pub struct FirstOrder<M> {
    method: M,
    patience: usize,
    prepared: Option<Prepared<ScaledProblem>>,
    single: Option<Prepared<SingleProblem>>,
}

/// The packed problem of the last solve, and what it was made of.
struct Prepared<P> {
    delassus: DelassusIdentity,
    friction: Vec<f64>,
    turning: Vec<TurningFriction>,
    velocity: f64,
    ranks: Option<Arc<Ranks>>,
    packed: P,
}

impl<P> Prepared<P> {
    /// The last one with another r, put in by `set_r`, where nothing else differs (its order
    /// stays that of the impulses that the first solve started from), or a new one, where `make` can.
    fn of(
        problem: &Ccp,
        ranks: Option<&Arc<Ranks>>,
        last: Option<Self>,
        make: impl FnOnce(&ResidualScale) -> Option<P>,
        set_r: impl FnOnce(&mut P, &[f64]),
    ) -> Option<Self> {
        if let Some(mut last) = last {
            let fits = last.delassus.is(&problem.delassus)
                && last.velocity == velocity_scale(problem)
                && last.ranks.as_ref().map(Arc::as_ptr) == ranks.map(Arc::as_ptr)
                && last.friction == problem.friction
                && last.turning == problem.turning;
            if fits {
                set_r(&mut last.packed, &problem.r);
                return Some(last);
            }
        }
        let residual = ResidualScale::new(problem);
        Some(Self {
            delassus: DelassusIdentity::of(&problem.delassus),
            friction: problem.friction.clone(),
            turning: problem.turning.clone(),
            velocity: residual.velocity,
            ranks: ranks.map(Arc::clone),
            packed: make(&residual)?,
        })
    }
}

/// What was done in single precision.
#[derive(Default)]
struct Begun {
    iterations: usize,
    products: usize,
    history: History,
    curvature: Option<f64>,
}

impl<M> FirstOrder<M> {
    /// The solver that goes by this method.
    pub fn new(method: M) -> Self {
        Self::with_patience(method, usize::MAX)
    }

    /// The same that ends a relaxed solve as [`Status::Stalled`] after so many checks of the residual without
    /// a tenth off the least one.
    pub fn with_patience(method: M, patience: usize) -> Self {
        Self { method, patience, prepared: None, single: None }
    }
}

impl<M: FirstOrderMethod> FirstOrder<M> {
    /// From `impulse`, which becomes the best iterate, or, where there is one, from `last`, which becomes the
    /// last iterate.
    fn improve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        mut last: Option<&mut [f64]>,
        settings: &SolveSettings,
        model: FrictionModel,
    ) -> Result<SolveReport, CcpError> {
        self.capabilities().require(M::NAME, problem)?;
        let limits = Limits::start(settings, ITERATION_LIMIT);
        check_start(problem, impulse)?;
        if let Some(last) = &mut last {
            check_start(problem, last)?;
        }
        let mut begun = Begun::default();
        if M::SINGLE && single::suits(problem, settings) {
            if last.is_none()
                && model == settings.friction
                && let Some(report) = good_enough::<M>(problem, impulse, &limits, model)
            {
                return Ok(report);
            }
            let ended = self.begin(problem, impulse, last.as_deref_mut(), &limits, model, &mut begun);
            if let Some(report) = ended {
                return Ok(report);
            }
        }
        let start = impulse.to_vec();
        let ranks = limits.ranks().filter(|_| M::SHARED);
        let make = |residual: &ResidualScale| {
            let mut scaled = ScaledProblem::new(problem, residual);
            scaled.share_among(ranks);
            Some(scaled)
        };
        let set_r = ScaledProblem::set_free_velocity;
        let prepared = Prepared::of(problem, ranks, self.prepared.take(), make, set_r);
        let mut prepared = prepared.expect("every problem can be packed in double precision");
        let scaled = &mut prepared.packed;
        scaled.set_friction_model(model);
        let mut it = Iterate::new(scaled, limits, last.as_deref().unwrap_or(impulse));
        (it.iterations, it.history) = (begun.iterations, begun.history);
        if model == FrictionModel::Relaxed {
            it.progress = Progress::new(self.patience);
        }
        self.method.run(scaled, &mut it);
        if let Some(last) = last {
            scaled.complete(&mut it.x);
            scaled.unpack(&it.x, last);
        }
        let (status, iterations) = (it.status, it.iterations);
        let products = begun.products + it.work.products();
        it.best.restore(&mut it.x);
        scaled.complete(&mut it.x);
        scaled.unpack(&it.x, impulse);
        // Steps along the boundary leave the cones by more than rounding (kucera: 1e-9 of an impulse).
        problem.project(impulse);
        self.prepared = Some(prepared);
        let report = it.limits.report(M::NAME, problem, impulse, status, iterations, 0);
        let report = better_of(problem, &it.limits, &start, impulse, report);
        let curvature = it.curvature.or(begun.curvature);
        Ok(SolveReport { products, curvature, history: it.history.into_samples(), ..report })
    }

    /// The iterations in single precision, with the meaning of the arguments of [`Self::improve`]. The
    /// report, where they have ended the solve.
    fn begin(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        last: Option<&mut [f64]>,
        limits: &Limits<'_>,
        model: FrictionModel,
        begun: &mut Begun,
    ) -> Option<SolveReport> {
        let ranks = limits.ranks().filter(|_| M::SHARED);
        let sweeps = M::SWEEPS.then_some(last.as_deref().unwrap_or(impulse));
        let make = |residual: &ResidualScale| SingleProblem::new(problem, residual, sweeps, ranks);
        let set_r = SingleProblem::set_free_velocity;
        let mut prepared = Prepared::of(problem, ranks, self.single.take(), make, set_r)?;
        prepared.packed.set_friction_model(model);
        let start = impulse.to_vec();
        let mut it = SingleIterate::new(&prepared.packed, limits, last.as_deref().unwrap_or(impulse));
        self.method.run_single(&mut it);
        it.unpack(impulse, last);
        problem.project(impulse);
        let (iterations, products) = (it.iterations, it.products);
        let (ended, curvature) = (it.status, it.curvature);
        *begun = Begun { iterations, products, curvature, history: it.history };
        self.single = Some(prepared);
        let status = ended.unwrap_or(Status::Stalled);
        let report = limits.report(M::NAME, problem, impulse, status, iterations, 0);
        let report = better_of(problem, limits, &start, impulse, report);
        let over = matches!(report.status, Status::Converged | Status::Stopped | Status::IterationLimit);
        over.then(|| {
            let history = std::mem::take(&mut begun.history).into_samples();
            SolveReport { products, curvature, history, ..report }
        })
    }
}

/// The report on impulses that solve the problem as they are.
fn good_enough<M: FirstOrderMethod>(
    problem: &Ccp,
    impulse: &[f64],
    limits: &Limits<'_>,
    model: FrictionModel,
) -> Option<SolveReport> {
    let Delassus::Rigid(rigid) = &*problem.delassus else { return None };
    // Where one contact moves bodies far away, no few contacts tell what a start is worth.
    if rigid.is_plain() {
        let scale = ResidualScale::new(problem);
        let few = limits.measured(sampled_residual(problem, rigid, &scale, impulse, model));
        if few.is_nan() || few > NEAR * limits.tolerance() {
            return None;
        }
    }
    let report = limits.report(M::NAME, problem, impulse, Status::Stalled, 0, 0);
    report.converged().then(|| {
        let mut history = History::default();
        history.record(0, limits.seconds(), report.residual);
        SolveReport { curvature: limits.curvature(), history: history.into_samples(), ..report }
    })
}

/// The report on the impulses, or where they are worse than those of the start, which they then become, on
/// these: where impulses grow without limit (a contact between immovable bodies) the last projection may move
/// them by more than they are worth.
fn better_of(
    problem: &Ccp,
    limits: &Limits<'_>,
    start: &[f64],
    impulse: &mut [f64],
    report: SolveReport,
) -> SolveReport {
    if report.converged() {
        return report;
    }
    let of_start = limits.report(&report.solver, problem, start, report.status, report.iterations, 0);
    let (before, after) = (limits.measured(of_start.residual), limits.measured(report.residual));
    if before < after || after.is_nan() {
        impulse.copy_from_slice(start);
        return of_start;
    }
    report
}

impl<M: FirstOrderMethod> CcpSolver for FirstOrder<M> {
    fn name(&self) -> String {
        M::NAME.to_string()
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            turning: M::TURNING,
            // One contact of a stress-controlled cell moves all bodies: sweeps go through the rows of N.
            cell: M::TURNING && !M::SWEEPS,
            coupling: M::TURNING,
            exact: M::EXACT,
        }
    }

    fn cost(&mut self, _: &Ccp) -> Cost {
        Cost { least: LEAST_ITERATIONS, ..Cost::default() }
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        self.method.remember(None);
        self.improve(problem, impulse, None, settings, FrictionModel::Relaxed)
    }

    fn solve_exact(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        state: &mut ExactState,
        settings: &SolveSettings,
    ) -> Result<Option<SolveReport>, CcpError> {
        if !M::EXACT {
            return Ok(None);
        }
        self.method.remember(state.memory);
        let last = Some(&mut state.last[..]);
        let report = self.improve(problem, impulse, last, settings, FrictionModel::Coulomb)?;
        state.memory = self.method.memory();
        Ok(Some(report))
    }
}

/// Entries of an image per parallel task of a linear combination.
pub(super) const IMAGE_CHUNK: usize = 1024;

/// The current iterate with its image, and when to stop.
pub struct Iterate<'a> {
    /// x.
    pub x: Vec<Batch>,
    /// Image of x; where the method keeps the gradient, that of the x of the last [`Self::refresh`].
    pub image: Image,
    /// N' x + r' contact by contact, if the method keeps that up to date rather than the image; else empty.
    pub gradient: Vec<Batch>,
    /// Scratch of passes.
    pub work: PassWork,
    limits: Limits<'a>,
    iterations: usize,
    history: History,
    best: Best<Batch>,
    progress: Progress,
    status: Status,
    refreshed: bool,
    /// Largest curvature met along a step.
    curvature: Option<f64>,
}

impl<'a> Iterate<'a> {
    fn new(scaled: &ScaledProblem, limits: Limits<'a>, impulse: &[f64]) -> Self {
        let mut it = Self {
            x: scaled.zeros(),
            image: scaled.zero_image(),
            gradient: Vec::new(),
            work: scaled.work(),
            limits,
            iterations: 0,
            history: History::default(),
            best: Best::default(),
            progress: Progress::new(usize::MAX),
            status: Status::Stalled,
            refreshed: false,
            curvature: None,
        };
        scaled.pack(impulse, &mut it.x);
        it.refresh(scaled);
        it
    }

    /// Recomputes the image of x, and the gradient where that is kept: updates let them drift by rounding.
    pub fn refresh(&mut self, scaled: &ScaledProblem) {
        scaled.image_of(&mut self.x, &mut self.image, &mut self.work);
        if !self.gradient.is_empty() {
            scaled.gradient(&self.image, &mut self.gradient, &mut self.work);
        }
        self.refreshed = true;
    }

    /// The method keeps the gradient from now on.
    pub fn keep_gradient(&mut self, scaled: &ScaledProblem) {
        self.gradient = scaled.zeros();
        scaled.gradient(&self.image, &mut self.gradient, &mut self.work);
    }

    fn residual(&mut self, scaled: &ScaledProblem) -> Residual {
        if self.gradient.is_empty() {
            scaled.residual(&mut self.x, &self.image, &mut self.work)
        } else {
            scaled.residual_given(&mut self.x, &mut self.gradient, &mut self.work)
        }
    }

    /// Whether the image of x was recomputed since this was last asked. A method that keeps images of other
    /// vectors has to recompute them, too: differences between a fresh image and a drifted one can grow
    /// without limit.
    pub fn was_refreshed(&mut self) -> bool {
        std::mem::take(&mut self.refreshed)
    }

    /// Counts an iteration and says whether to do it. The residual of x is evaluated, from its image or
    /// gradient, at every tenth.
    pub fn proceed(&mut self, scaled: &ScaledProblem) -> bool {
        let go = !self.checks_next() || self.check(scaled);
        self.iterations += usize::from(go);
        go
    }

    /// Whether the next [`Self::proceed`] evaluates the residual.
    pub fn checks_next(&self) -> bool {
        self.iterations.is_multiple_of(CHECK) || self.limits.iterations_left(self.iterations) == 0
    }

    /// Counts an iteration without a look at the residual; false where none is left.
    pub fn count(&mut self) -> bool {
        let go = self.limits.iterations_left(self.iterations) > 0;
        self.iterations += usize::from(go);
        go
    }

    /// Evaluates the residual of x now, keeps x if it is the best, and says whether to go on.
    pub fn check(&mut self, scaled: &ScaledProblem) -> bool {
        if self.iterations.is_multiple_of(REFRESH) {
            self.refresh(scaled);
        }
        let mut found = self.residual(scaled);
        if self.limits.measured(found) <= self.limits.tolerance() {
            // The image drifts from N' x by rounding: hold the claim against a fresh one.
            self.refresh(scaled);
            found = self.residual(scaled);
        }
        self.history.record(self.iterations, self.limits.seconds(), found);
        let residual = self.limits.measured(found);
        self.best.offer(&self.x, residual);
        match self.limits.status(self.iterations, residual) {
            Some(status) => {
                self.status = status;
                false
            }
            // The status is [`Status::Stalled`] until another one is known.
            None => !self.progress.has_ended(residual),
        }
    }

    /// Image of x <- image of x + factor * image.
    pub fn add_image(&mut self, factor: f64, image: &[Lanes]) {
        add_image(&mut self.image, factor, image);
    }

    /// The largest curvature of the last solve, where the settings name it.
    pub fn known_curvature(&self) -> Option<f64> {
        self.limits.curvature()
    }

    /// Keeps the largest curvature met along a step, for the next solve.
    pub fn met_curvature(&mut self, steepest: f64) {
        self.curvature = self.limits.next_curvature(steepest);
    }

    /// Largest eigenvalue of N', from below; see [`ScaledProblem::largest_curvature`].
    pub fn largest_curvature(&mut self, scaled: &ScaledProblem) -> f64 {
        let (mut x, mut image) = (scaled.zeros(), scaled.zero_image());
        scaled.largest_curvature(&mut x, &mut image, &mut self.work)
    }
}

/// to <- to + factor * image.
pub fn add_image(to: &mut [Lanes], factor: f64, image: &[Lanes]) {
    let factor = Lanes::splat(factor);
    to.par_chunks_mut(IMAGE_CHUNK).zip(image.par_chunks(IMAGE_CHUNK)).for_each(|(to, image)| {
        for (to, image) in to.iter_mut().zip(image) {
            *to += factor * *image;
        }
    });
}

#[cfg(test)]
mod tests {
    use crate::delassus::Delassus;
    use crate::problem::Ccp;
    use crate::registry::{Method, SolverSpec};
    use crate::solver::settings::SolveSettings;
    use graintrain_linalg::block3::BlockMatrix3;

    /// Beside an ordinary contact one between immovable bodies that should part: no impulse helps, and none
    /// may make it worse.
    #[test]
    fn impulses_that_run_away_are_not_handed_back() {
        let free = [2.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 3.0];
        let matrix = BlockMatrix3::from_rows(vec![0, 1, 2], vec![0, 1], vec![free, [0.0; 9]]);
        let r = vec![-1.0, 0.3, 0.0, -1.0, 0.0, 0.2];
        let problem = Ccp::new(Delassus::Sparse(matrix), r, vec![0.3, 0.5]).unwrap();
        let first_order = |method: &Method| !method.has_linear_solver() && *method != Method::Auto;
        for name in Method::available().filter(first_order) {
            let mut solver = SolverSpec::from(name).build().unwrap();
            let mut residual_after = |iterations| {
                let settings = SolveSettings { max_iterations: Some(iterations), ..SolveSettings::default() };
                let mut impulse = vec![0.0; 6];
                let report = solver.solve(&problem, &mut impulse, &settings).unwrap();
                assert!(!report.converged(), "{name}");
                report.residual.max
            };
            let start = residual_after(0);
            for iterations in [100, 10_000] {
                let end = residual_after(iterations);
                assert!(end <= start, "{name} after {iterations}: {end:e}, at the start {start:e}");
            }
        }
    }
}
