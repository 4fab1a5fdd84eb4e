//! An iterate in single precision, and when to stop or to go on in double precision.

use super::super::apgd::{Extrapolated, Extrapolation, Space, Step};
use super::super::combination::Replace;
use super::super::driver::{Best, Limits};
use super::super::history::History;
use super::super::lanes::Batch;
use super::super::momentum::extrapolated;
use super::super::octet::{EIGHT, Octet, SingleVector};
use super::super::report::Status;
use super::super::scaling::{POWER_ITERATIONS, start_of_power};
use super::SingleProblem;
use super::kernel::{Identity, NaturalMap, PowerStep, Seen, SingleKernel, SingleTally};
use super::operator::SingleScratch;
use super::sweep::Sweep;
use crate::residual::{Criterion, FrictionModel, Residual};

/// Iterations between two evaluations of the residual: at least and at most. In between the length of the
/// steps tells when it is time.
const CHECKS: [usize; 2] = [3, 25];
/// Iterations between two evaluations of images from their vectors.
const REFRESH: usize = 100;
/// Double precision goes on after so many iterations without a tenth off the least residual.
pub const PATIENCE: usize = 1000;
/// Double precision goes on where this multiple of what rounding may do to the residual reaches the
/// tolerance.
pub const ROUNDING: f64 = 8.0;
/// Rounding does so many times as much to the worst contact as to the root mean square.
const WORST: f64 = 4.0;

/// The current iterate of a method with what it needs from step to step.
pub struct SingleIterate<'a> {
    problem: &'a SingleProblem,
    x: Vec<Batch<Octet>>,
    previous: Vec<Batch<Octet>>,
    /// Image of x.
    image: Vec<Octet>,
    /// Image of the extrapolated point; of sweeps, that of the x before.
    image_y: Vec<Octet>,
    scratch: SingleScratch,
    limits: &'a Limits<'a>,
    /// Length of the last step over the step size, rms.
    slope: f64,
    /// Residual over slope at the last check.
    ratio: f64,
    last_check: usize,
    since_better: usize,
    /// Whether the image of x was recomputed since the image of y was.
    refreshed: bool,
    least: f64,
    pub iterations: usize,
    pub products: usize,
    pub history: History,
    best: Best<Batch<Octet>>,
    /// Why it ended; `None` where double precision is to go on.
    pub status: Option<Status>,
    /// Largest curvature met along a step.
    pub curvature: Option<f64>,
}

impl<'a> SingleIterate<'a> {
    pub fn new(problem: &'a SingleProblem, limits: &'a Limits<'a>, impulse: &[f64]) -> Self {
        let mut x = problem.zeros();
        problem.pack(impulse, &mut x);
        let image = vec![Octet::default(); problem.operator.image_len()];
        let mut it = Self {
            problem,
            previous: x.clone(),
            x,
            image_y: image.clone(),
            image,
            scratch: problem.operator.scratch(),
            limits,
            slope: f64::INFINITY,
            ratio: 0.0,
            last_check: 0,
            since_better: 0,
            refreshed: false,
            least: f64::INFINITY,
            iterations: 0,
            products: 0,
            history: History::default(),
            best: Best::default(),
            status: None,
            curvature: None,
        };
        it.refresh();
        it.image_y.copy_from_slice(&it.image);
        it.refreshed = false;
        it
    }

    /// The impulses to hand over: the best ones and, into `last`, the last ones.
    pub fn unpack(&mut self, impulse: &mut [f64], last: Option<&mut [f64]>) {
        if let Some(last) = last {
            self.problem.complete(&mut self.x);
            self.problem.unpack(&self.x, last);
        }
        self.best.restore(&mut self.x);
        self.problem.complete(&mut self.x);
        self.problem.unpack(&self.x, impulse);
    }

    /// Keeps the largest curvature met along a step.
    pub fn met_curvature(&mut self, steepest: f64) {
        self.curvature = self.limits.next_curvature(steepest);
    }

    /// The image of x from x.
    fn refresh(&mut self) {
        self.refreshed = true;
        let Self { problem, x, image, scratch, .. } = self;
        problem.operator.contact_pass::<1, false, true>(&[], [x], scratch, &Identity);
        problem.operator.body_pass([image], scratch, &Replace);
    }

    /// The residual of x, and what rounding may make of it.
    fn residual(&mut self) -> (Residual, f64) {
        let Self { problem, x, image, scratch, .. } = self;
        let exact = problem.friction_model == FrictionModel::Coulomb;
        let kernel = NaturalMap { metric: &problem.metric, exact };
        let totals = problem.operator.contact_pass::<1, true, false>(image, [x], scratch, &kernel);
        let count = problem.num_contacts() as f64;
        // A lane may lose a NaN in its maximum, never in its sum.
        let square = if totals.sum[0].is_nan() { f64::NAN } else { totals.max };
        let residual = Residual { max: square.sqrt(), rms: (totals.sum[0] / count).sqrt() };
        let worst = if self.limits.criterion() == Criterion::Mixed { 1.0 } else { WORST };
        (residual, worst * f64::from(f32::EPSILON) * (totals.sum[1] / count).sqrt())
    }

    /// Evaluates the residual of x; whether to go on.
    fn check(&mut self) -> bool {
        let (mut found, mut slack) = self.residual();
        if self.limits.measured(found) + slack <= self.limits.tolerance() && self.iterations > 0 {
            // The image drifts from N' x by rounding: hold the claim against a fresh one.
            self.refresh();
            (found, slack) = self.residual();
        }
        self.history.record(self.iterations, self.limits.seconds(), found);
        let residual = self.limits.measured(found);
        self.best.offer(&self.x, residual);
        self.ratio = (residual + slack) / self.slope;
        self.since_better += self.iterations - self.last_check;
        self.last_check = self.iterations;
        if residual < 0.9 * self.least {
            (self.least, self.since_better) = (residual, 0);
        }
        if let Some(status) = self.limits.status(self.iterations, residual + slack) {
            self.status = (status != Status::Stalled).then_some(status);
            return false;
        }
        ROUNDING * slack < self.limits.tolerance() && self.since_better <= PATIENCE
    }

    /// Counts an iteration and says whether to do it.
    fn go_on(&mut self) -> bool {
        if self.checks_now() && !self.check() {
            return false;
        }
        if self.iterations > 0 && self.iterations.is_multiple_of(REFRESH) {
            self.refresh();
        }
        self.iterations += 1;
        true
    }

    /// Sweeps with this over-relaxation, each from x + beta (x - previous) with the beta that `next` makes of
    /// |d|^2 and d^T (x+ - x) of the last one.
    pub fn sweep(&mut self, relaxation: f64, mut next: impl FnMut([f64; 2]) -> f64) {
        let Some(sweeps) = &self.problem.sweeps else { return };
        let mut scratch_of_sweeps = sweeps.scratch(&self.problem.operator);
        let model = self.problem.friction_model;
        let mut beta = 0.0;
        while self.go_on() {
            let refreshed = std::mem::take(&mut self.refreshed);
            let Self { problem, x, previous, image, image_y, scratch, .. } = self;
            let operator = &problem.operator;
            if refreshed && beta != 0.0 {
                // The extrapolation would take the difference between a fresh and a drifted image for a
                // motion.
                operator.contact_pass::<1, false, true>(&[], [previous], scratch, &Identity);
                operator.body_pass([image_y], scratch, &Replace);
            }
            let (vectors, images) = ([&mut x[..], previous], [&mut image[..], image_y]);
            let sweep = Sweep { beta, relaxation, model };
            let sums = sweeps.sweep(operator, vectors, images, &mut scratch_of_sweeps, sweep);
            beta = next(sums);
            self.slope = (sums[0] / self.problem.num_contacts() as f64).sqrt();
            self.products += 1;
        }
        self.met_curvature(0.0);
    }

    /// Whether it is time for a check.
    fn checks_now(&self) -> bool {
        let since = self.iterations - self.last_check;
        let [least, most] = CHECKS;
        self.iterations == 0
            || self.limits.iterations_left(self.iterations) == 0
            || since >= most
            || since >= least && self.slope * self.ratio <= self.limits.tolerance()
    }
}

impl Space for SingleIterate<'_> {
    fn friction_model(&self) -> FrictionModel {
        self.problem.friction_model
    }

    fn first_curvature(&mut self) -> f64 {
        if let Some(known) = self.limits.curvature() {
            return known;
        }
        let Self { problem, scratch, products, .. } = self;
        let mut x = problem.zeros();
        for (place, &contact) in problem.order.iter().enumerate() {
            let (batch, lane) = (place / EIGHT, place % EIGHT);
            for (k, start) in start_of_power(contact as usize).into_iter().enumerate() {
                x[batch][k].0[lane] = start as f32;
            }
        }
        let mut image = vec![Octet::default(); problem.operator.image_len()];
        let mut largest = 1.0_f64;
        problem.operator.contact_pass::<1, false, true>(&[], [&mut x], scratch, &Identity);
        problem.operator.body_pass([&mut image], scratch, &Replace);
        for _ in 0..POWER_ITERATIONS {
            let kernel = PowerStep { factor: 1.0 / largest, contacts: &problem.operator.contacts };
            let totals = problem.operator.contact_pass::<1, true, true>(&image, [&mut x], scratch, &kernel);
            let quadratic = problem.operator.body_pass([&mut image], scratch, &Replace);
            let quotient = quadratic / totals.sum[0];
            if quotient > largest {
                largest = quotient;
            }
            *products += 1;
        }
        largest
    }

    fn proceed(&mut self, beta: f64) -> bool {
        if !self.go_on() {
            return false;
        }
        if std::mem::take(&mut self.refreshed) {
            // The image of y must not keep the rounding errors that the image of x has just lost.
            let Self { problem, x, previous, image_y, scratch, .. } = self;
            let kernel = Extrapolated { beta };
            problem.operator.contact_pass::<2, false, true>(&[], [x, previous], scratch, &kernel);
            problem.operator.body_pass([image_y], scratch, &Replace);
        }
        true
    }

    fn step<const EXACT: bool>(
        &mut self,
        kernel: Step<EXACT>,
        next: impl FnOnce([f64; 2]) -> f64,
    ) -> [f64; 2] {
        let Self { problem, x, previous, image, image_y, scratch, .. } = self;
        let totals = problem.operator.contact_pass::<2, true, true>(image_y, [x, previous], scratch, &kernel);
        let sums = [totals.sum[0], totals.sum[1]];
        let beta = next(sums);
        let images = [&mut image_y[..], &mut image[..]];
        let quadratic = problem.operator.body_pass(images, scratch, &Extrapolation { beta });
        std::mem::swap(&mut self.x, &mut self.previous);
        self.slope = (sums[0] / self.problem.num_contacts() as f64).sqrt() / kernel.step;
        self.products += 1;
        [sums[0], quadratic]
    }
}

impl<const EXACT: bool> SingleKernel<2> for Step<EXACT> {
    #[inline(always)]
    fn point<V: SingleVector>(&self, seen: &Seen<V>, [x, previous]: [&Batch<V>; 2]) -> Batch<V> {
        self.point_from(&seen.u, x, previous)
    }

    #[inline(always)]
    fn projected<V: SingleVector>(&self, seen: &Seen<V>, point: &Batch<V>, tangential: V) -> Batch<V> {
        Self::allowed(seen.mu, point, tangential)
    }

    #[inline(always)]
    fn at<V: SingleVector>(
        &self,
        _: &Seen<V>,
        projected: Batch<V>,
        vectors: [&mut Batch<V>; 2],
        tally: &mut SingleTally<V>,
    ) -> Batch<V> {
        self.moved(projected, vectors, &mut tally.sum)
    }
}

impl SingleKernel<2> for Extrapolated {
    #[inline(always)]
    fn at<V: SingleVector>(
        &self,
        _: &Seen<V>,
        _: Batch<V>,
        [x, previous]: [&mut Batch<V>; 2],
        _: &mut SingleTally<V>,
    ) -> Batch<V> {
        extrapolated(x, previous, self.beta)
    }
}
