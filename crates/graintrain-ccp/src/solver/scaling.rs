//! The problem as the first-order methods see it: scaled contact by contact, packed, with one fused pass for
//! "velocity, update, force".
//!
//! With eta_i = trace(N_ii)/3 and the impulse J of the residual, g_i = c x_i / sqrt(eta_i), c = J sqrt(mean eta):
//!
//! ```text
//! N'_ij = N_ij / sqrt(eta_i eta_j),   r'_i = r_i / (c sqrt(eta_i)),   trace(N'_ii) = 3
//! ```
//!
//! One positive factor per contact leaves every cone as it is, so that the scaled problem is again a CCP with the same
//! mu, and its natural map d' with unit step is the one of the original: d_i / J = w_i d'_i, w_i = c / (J sqrt(eta_i)).

use super::body_operator::{BodyOperator, contact_order};
use super::lanes::{Batch, LANES, Lanes, ZERO, add, dot, project, scale, sub};
use super::row_operator::{RowOperator, batch_of};
use super::sweep::{CHUNK, Tally, TaskWork, Totals, for_each_task, vectorised};
use crate::delassus::Delassus;
use crate::problem::Ccp;
use crate::residual::ResidualScale;

/// Power iterations for the first step size.
const POWER_ITERATIONS: usize = 12;

/// N' in one of its two forms.
#[derive(Clone, Debug)]
enum Operator {
    Bodies(BodyOperator),
    Rows(RowOperator),
}

/// The scaled problem, packed in batches of four contacts; unused lanes of the last batch stay zero.
#[derive(Clone, Debug)]
pub struct ScaledProblem {
    operator: Operator,
    /// Contact at each packed place.
    order: Vec<u32>,
    /// c / sqrt(eta_i) of each contact, N s per unit of x.
    unit: Vec<f64>,
    /// c, the size of impulses in the problem's own metric.
    size: f64,
    r: Vec<Batch>,
    friction: Vec<Lanes>,
    weight: Vec<Lanes>,
}

/// An image of x under N', in the form the operator keeps it: velocities of bodies, or N' x contact by contact.
/// It is linear in x: combinations of images are images of combinations.
pub type Image = Vec<f64>;

/// What is known about a contact inside a pass.
#[derive(Clone, Copy, Debug)]
pub struct Here {
    /// Coefficients of friction.
    pub mu: Lanes,
    /// w_i: factor from |d'_i| to |d_i| / J.
    pub weight: Lanes,
    /// r'.
    pub r: Batch,
}

/// What a method does at four contacts in a pass. A type rather than a closure, because only `#[inline(always)]`
/// functions are sure to be compiled for the processor's vector instructions.
pub trait Kernel<const M: usize>: Sync {
    /// Given u = N' y + r' and the method's vectors at this batch, updates the vectors, adds to the tally and returns the
    /// batch whose image the pass computes.
    fn at(&self, here: Here, u: &Batch, vectors: [&mut Batch; M], tally: &mut Tally) -> Batch;
}

/// Returns the vector: its image is wanted.
struct Identity;

impl Kernel<1> for Identity {
    #[inline(always)]
    fn at(&self, _: Here, _: &Batch, [x]: [&mut Batch; 1], _: &mut Tally) -> Batch {
        *x
    }
}

/// x <- factor N' x; tallies |x|^2.
struct PowerStep {
    factor: f64,
}

impl Kernel<1> for PowerStep {
    #[inline(always)]
    fn at(&self, here: Here, u: &Batch, [x]: [&mut Batch; 1], tally: &mut Tally) -> Batch {
        *x = scale(Lanes::splat(self.factor), &sub(u, &here.r));
        tally.sum[0] += dot(x, x);
        *x
    }
}

/// Tallies max (|d_i| / J)^2 of the natural map with unit step.
struct NaturalMap;

impl Kernel<1> for NaturalMap {
    #[inline(always)]
    fn at(&self, here: Here, u: &Batch, [x]: [&mut Batch; 1], tally: &mut Tally) -> Batch {
        let d = sub(x, &project(here.mu, &sub(x, u)));
        tally.max = tally.max.max(here.weight * here.weight * dot(&d, &d));
        d
    }
}

/// Scratch of passes, allocated once per solve.
#[derive(Clone, Debug)]
pub struct PassWork {
    slots: Vec<[f64; 6]>,
    scattered: Vec<Batch>,
    tallies: Vec<Tally>,
}

impl PassWork {
    /// Tallies of the chunks, for [`for_each_batch`](super::sweep::for_each_batch).
    pub fn tallies(&mut self) -> &mut [Tally] {
        &mut self.tallies
    }
}

impl ScaledProblem {
    /// Scales and packs a problem. Costs a few products with N.
    pub fn new(problem: &Ccp, residual: &ResidualScale) -> Self {
        let contacts = problem.num_contacts();
        let mean = residual.eta.iter().sum::<f64>() / contacts.max(1) as f64;
        let c = residual.impulse * mean.sqrt();
        let scaling: Vec<f64> = residual.eta.iter().map(|eta| 1.0 / eta.sqrt()).collect();
        let (operator, order) = match &problem.delassus {
            Delassus::Rigid(rigid) => {
                let order = contact_order(rigid);
                (Operator::Bodies(BodyOperator::new(rigid, &order, &scaling)), order)
            }
            Delassus::Sparse(matrix) => {
                (Operator::Rows(RowOperator::new(matrix, &scaling)), (0..contacts as u32).collect())
            }
        };
        let batches = contacts.div_ceil(LANES);
        let mut scaled = Self {
            operator,
            unit: scaling.iter().map(|s| c * s).collect(),
            r: vec![ZERO; batches],
            friction: vec![Lanes::default(); batches],
            weight: vec![Lanes::default(); batches],
            size: c,
            order,
        };
        for (place, &i) in scaled.order.iter().enumerate() {
            let (batch, lane, i) = (place / LANES, place % LANES, i as usize);
            scaled.friction[batch].0[lane] = problem.friction[i];
            scaled.weight[batch].0[lane] = scaled.unit[i] / residual.impulse;
        }
        scaled.set_free_velocity(&problem.r);
        scaled
    }

    /// Replaces r, for another problem with the same N and mu.
    pub fn set_free_velocity(&mut self, r: &[f64]) {
        for (place, &i) in self.order.iter().enumerate() {
            let i = i as usize;
            let factor = self.unit[i] / (self.size * self.size);
            for k in 0..3 {
                self.r[place / LANES][k].0[place % LANES] = factor * r[3 * i + k];
            }
        }
    }

    /// Number of batches of every vector.
    pub fn num_batches(&self) -> usize {
        self.r.len()
    }

    /// A vector of zeros.
    pub fn zeros(&self) -> Vec<Batch> {
        vec![ZERO; self.num_batches()]
    }

    /// An image of zero.
    pub fn zero_image(&self) -> Image {
        match &self.operator {
            Operator::Bodies(bodies) => vec![0.0; bodies.image_len()],
            Operator::Rows(_) => vec![0.0; 3 * LANES * self.num_batches()],
        }
    }

    /// Scratch for passes.
    pub fn work(&self) -> PassWork {
        let chunks = self.num_batches().div_ceil(CHUNK);
        match &self.operator {
            Operator::Bodies(bodies) => PassWork {
                slots: vec![[0.0; 6]; bodies.num_slots()],
                scattered: Vec::new(),
                tallies: vec![Tally::default(); chunks.max(bodies.num_body_tasks())],
            },
            Operator::Rows(_) => PassWork {
                slots: Vec::new(),
                scattered: self.zeros(),
                tallies: vec![Tally::default(); chunks],
            },
        }
    }

    /// x of impulses g, projected on the cones.
    pub fn pack(&self, g: &[f64], x: &mut [Batch]) {
        for (place, &i) in self.order.iter().enumerate() {
            let i = i as usize;
            for k in 0..3 {
                x[place / LANES][k].0[place % LANES] = g[3 * i + k] / self.unit[i];
            }
        }
        for (x, &mu) in x.iter_mut().zip(&self.friction) {
            *x = project(mu, x);
        }
    }

    /// Impulses g of x.
    pub fn unpack(&self, x: &[Batch], g: &mut [f64]) {
        for (place, &i) in self.order.iter().enumerate() {
            let i = i as usize;
            for k in 0..3 {
                g[3 * i + k] = self.unit[i] * x[place / LANES][k].0[place % LANES];
            }
        }
    }

    /// One pass over the contacts and one over the bodies (or rows):
    ///
    /// ```text
    /// u = N' y + r' from the image of y;  s = kernel(contact, u, vectors);  out <- image of s
    /// ```
    ///
    /// Returns what the kernel tallied and s^T N' s.
    pub fn pass<const M: usize>(
        &self,
        image: &[f64],
        vectors: [&mut [Batch]; M],
        out: &mut [f64],
        work: &mut PassWork,
        kernel: &impl Kernel<M>,
    ) -> (Totals, f64) {
        let totals = self.contact_pass::<M, true>(image, vectors, work, kernel);
        let quadratic = match &self.operator {
            Operator::Bodies(bodies) => bodies.velocities(&work.slots, out, &mut work.tallies),
            Operator::Rows(rows) => rows.multiply(&work.scattered, out, &mut work.tallies),
        };
        (totals, quadratic)
    }

    /// As [`Self::pass`] without new impulses: a look at u = N' y + r'.
    pub fn look<const M: usize>(
        &self,
        image: &[f64],
        vectors: [&mut [Batch]; M],
        work: &mut PassWork,
        kernel: &impl Kernel<M>,
    ) -> Totals {
        self.contact_pass::<M, false>(image, vectors, work, kernel)
    }

    #[inline(always)]
    fn contact_pass<const M: usize, const SCATTER: bool>(
        &self,
        image: &[f64],
        vectors: [&mut [Batch]; M],
        work: &mut PassWork,
        kernel: &impl Kernel<M>,
    ) -> Totals {
        let batches = self.num_batches();
        let chunks = batches.div_ceil(CHUNK);
        let range = |chunk: usize| chunk * CHUNK..((chunk + 1) * CHUNK).min(batches);
        let tallies = &mut work.tallies[..chunks];
        match &self.operator {
            Operator::Bodies(bodies) => {
                let velocity = image.as_chunks::<6>().0;
                let len = |chunks| bodies.slot_range(chunks).len();
                let slots = &mut work.slots[..];
                for_each_task(
                    0..chunks,
                    CHUNK,
                    vectors,
                    slots,
                    &len,
                    tallies,
                    &|chunk, vectors, slots, tally| {
                        let batches = range(chunk);
                        vectorised(BodyPass::<M, SCATTER, _> {
                            scaled: self,
                            bodies,
                            velocity,
                            batches,
                            vectors,
                            slots,
                            tally,
                            kernel,
                        });
                    },
                );
            }
            Operator::Rows(_) => {
                let product = image.as_chunks::<{ 3 * LANES }>().0;
                let len = |chunks: std::ops::Range<usize>| {
                    (chunks.end * CHUNK).min(batches) - (chunks.start * CHUNK).min(batches)
                };
                let scattered = &mut work.scattered[..];
                for_each_task(
                    0..chunks,
                    CHUNK,
                    vectors,
                    scattered,
                    &len,
                    tallies,
                    &|chunk, vectors, scattered, tally| {
                        let batches = range(chunk);
                        vectorised(RowPass {
                            scaled: self,
                            product,
                            batches,
                            vectors,
                            scattered,
                            tally,
                            kernel,
                        });
                    },
                );
            }
        }
        Totals::of(tallies)
    }

    /// out <- image of x; returns x^T N' x.
    pub fn image_of(&self, x: &mut [Batch], out: &mut [f64], zero: &[f64], work: &mut PassWork) -> f64 {
        self.pass(zero, [x], out, work, &Identity).1
    }

    /// Largest eigenvalue of N' from below, to some per cent: the largest quotient met in a few power iterations from a
    /// fixed vector; at least 1 because trace(N'_ii) = 3. `x` and `image` are overwritten.
    pub fn largest_curvature(&self, x: &mut [Batch], image: &mut [f64], work: &mut PassWork) -> f64 {
        for (batch, x) in x.iter_mut().enumerate() {
            // Any vector without symmetry will do.
            let s: [f64; LANES] =
                std::array::from_fn(|l| 1.0 + 0.7 * (1.7 * (LANES * batch + l) as f64).sin());
            *x = [Lanes(s), Lanes(s.map(|x| x - 0.9)), Lanes(s.map(|x| 0.8 - x))];
        }
        image.fill(0.0);
        let mut next = image.to_vec();
        let mut largest = 1.0_f64;
        self.pass(image, [&mut *x], &mut next, work, &Identity);
        for _ in 0..POWER_ITERATIONS {
            image.copy_from_slice(&next);
            let step = PowerStep { factor: 1.0 / largest };
            let (totals, quadratic) = self.pass(image, [&mut *x], &mut next, work, &step);
            let quotient = quadratic / totals.sum[0];
            if quotient > largest {
                largest = quotient;
            }
        }
        largest
    }

    /// Residual max_i |d_i| / J of x, given its image: the natural map with unit step.
    pub fn residual(&self, x: &mut [Batch], image: &[f64], work: &mut PassWork) -> f64 {
        self.look(image, [x], work, &NaturalMap).max.sqrt()
    }

    #[inline(always)]
    fn here(&self, batch: usize) -> Here {
        Here { mu: self.friction[batch], weight: self.weight[batch], r: self.r[batch] }
    }
}

/// The part of a pass over bodies that one chunk does.
struct BodyPass<'a, const M: usize, const SCATTER: bool, K> {
    scaled: &'a ScaledProblem,
    bodies: &'a BodyOperator,
    velocity: &'a [[f64; 6]],
    batches: std::ops::Range<usize>,
    vectors: [&'a mut [Batch]; M],
    slots: &'a mut [[f64; 6]],
    tally: &'a mut Tally,
    kernel: &'a K,
}

impl<const M: usize, const SCATTER: bool, K> TaskWork for BodyPass<'_, M, SCATTER, K>
where
    K: Kernel<M>,
{
    #[inline(always)]
    fn run(mut self) {
        if SCATTER {
            self.slots.fill([0.0; 6]);
        }
        let mut tally = Tally::default();
        for (offset, batch) in self.batches.enumerate() {
            let u = add(&self.bodies.relative_velocity(batch, self.velocity), &self.scaled.r[batch]);
            let mine = self.vectors.each_mut().map(|v| &mut v[offset]);
            let s = self.kernel.at(self.scaled.here(batch), &u, mine, &mut tally);
            if SCATTER {
                self.bodies.scatter(batch, &s, self.slots);
            }
        }
        *self.tally = tally;
    }
}

/// The part of a pass over rows that one chunk does before the product.
struct RowPass<'a, const M: usize, K> {
    scaled: &'a ScaledProblem,
    product: &'a [[f64; 3 * LANES]],
    batches: std::ops::Range<usize>,
    vectors: [&'a mut [Batch]; M],
    scattered: &'a mut [Batch],
    tally: &'a mut Tally,
    kernel: &'a K,
}

impl<const M: usize, K> TaskWork for RowPass<'_, M, K>
where
    K: Kernel<M>,
{
    #[inline(always)]
    fn run(mut self) {
        for (offset, batch) in self.batches.enumerate() {
            let u = add(&batch_of(&self.product[batch]), &self.scaled.r[batch]);
            let mine = self.vectors.each_mut().map(|v| &mut v[offset]);
            self.scattered[offset] = self.kernel.at(self.scaled.here(batch), &u, mine, self.tally);
        }
    }
}
