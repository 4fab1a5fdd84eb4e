//! The problem as the first-order methods see it: scaled contact by contact, packed, with one fused pass for
//! "velocity, update, force".
//!
//! With e_n = (N_ii)_nn, e_t = ((N_ii)_11 + (N_ii)_22)/2, the velocity V of the residual and c = V sqrt(mean
//! 1/eta):
//!
//! ```text
//! g_n = c x_n / sqrt(e_n),   g_t = c x_t / sqrt(e_t),   mu' = mu sqrt(e_t / e_n)
//! N'  = E^-1/2 N E^-1/2,     r' = E^-1/2 r / c,         trace(N'_ii) = 3
//! ```
//!
//! One factor for the normal and one for both tangents turns a friction cone into a friction cone of another
//! mu, so that the scaled problem is again a CCP; its diagonal is one, also for balls, whose tangential
//! mobility is 3.5 times the normal one. The rows of contacts that resist turning are scaled alike, spinning
//! by one factor and rolling by another, so that mu_r' = mu_r sqrt(e_r / e_n) and mu_s' = mu_s sqrt(e_s /
//! e_n); their batch follows that of their contacts. Only the residual has to be taken in the original
//! metric, where |d_i| is measured: in units of V / eta_i, the impulse by which the contact's own effective
//! mass changes its velocity by V.

mod contacts;
mod kernel;
mod passes;
#[cfg(test)]
mod tests;

use super::body_operator::{BodyOperator, BodyPair};
use super::combination::{Combination, Replace};
use super::dispatch::vectorised;
use super::lanes::{Batch, LANES, Lanes, ZERO, project};
use super::momentum::extrapolated;
use super::packing::{EMPTY, pack, turning_batches, with_turning};
use super::ranks::Ranks;
use super::row_operator::RowOperator;
use super::share::{Buffers, Share, part_of};
use super::tasks::{CHUNK, Tally, Totals, for_each_task};
use crate::delassus::Delassus;
use crate::problem::Ccp;
use crate::residual::{FrictionModel, Residual, ResidualScale};
use contacts::ContactArrays;
use graintrain_linalg::block3::Block;
use graintrain_linalg::real;
use kernel::{Identity, NaturalMap, PowerStep, Store};
use passes::{BodyPass, BodySweep, RowPass};
use rayon::prelude::*;
use std::sync::Arc;

pub use contacts::{ContactBatch, Metric, TurningBatch};
pub use kernel::{Kernel, KernelInput, Relaxation};

/// Power iterations for the first step size. With fewer, problems over large ratios of masses are solved less
/// often.
pub(super) const POWER_ITERATIONS: usize = 12;

/// Blocks per parallel task of what is made once per problem.
const BLOCKS: usize = 4096;

/// N' in one of its two forms.
#[derive(Clone, Debug)]
enum Operator {
    Bodies(Box<BodyOperator>),
    Rows(RowOperator),
}

/// The scaled problem, packed in batches of four contacts; unused lanes of the last batch stay zero.
#[derive(Clone, Debug)]
pub struct ScaledProblem {
    operator: Operator,
    /// Block row of N at each packed place: a contact, turning rows, or [`EMPTY`].
    order: Vec<u32>,
    /// Number of contacts.
    contacts: usize,
    /// Which batches hold the turning rows of the contacts of the batch before; empty where nothing resists
    /// turning.
    turning: Vec<bool>,
    /// mu_s' and mu_s of batches of turning rows, zero elsewhere; empty where nothing resists turning.
    spinning: Vec<[Lanes; 2]>,
    /// c / sqrt(e_n) and c / sqrt(e_t) of each block row, N s per unit of x.
    unit: Vec<[f64; 2]>,
    /// c, the size of impulses in the problem's own metric.
    size: f64,
    r: Vec<Batch>,
    /// mu', or mu_r' of turning rows.
    friction: Vec<Lanes>,
    metric: Vec<Metric>,
    friction_model: FrictionModel,
}

/// An image of x under N', in the form the operator keeps it: velocities of bodies, or N' x contact by
/// contact. It is linear in x: combinations of images are images of combinations.
pub type Image = Vec<Lanes>;

/// Scratch of passes, allocated once per solve.
#[derive(Clone, Debug)]
pub struct PassWork {
    slots: Vec<BodyPair>,
    /// See [`BodyOperator::room`].
    room: Vec<BodyPair>,
    scattered: Vec<Batch>,
    tallies: Vec<Tally>,
    buffers: Buffers,
    products: usize,
}

impl PassWork {
    /// Tallies of the chunks, for [`for_each_batch`](super::tasks::for_each_batch).
    pub fn tallies(&mut self) -> &mut [Tally] {
        &mut self.tallies
    }

    /// Products with N' that methods have made so far: one per pass, one per scatter pass and look. Residuals
    /// and fresh images of old iterates do not count.
    pub fn products(&self) -> usize {
        self.products
    }

    /// Counts a product made of a scatter pass and a look.
    pub fn count_product(&mut self) {
        self.products += 1;
    }
}

/// Batches, of so many, in some chunks.
fn part_len(chunks: &std::ops::Range<usize>, batches: usize) -> usize {
    (chunks.end * CHUNK).min(batches) - (chunks.start * CHUNK).min(batches)
}

/// The contact that a block row of N belongs to.
fn owner(problem: &Ccp, block: usize) -> usize {
    let contacts = problem.num_contacts();
    if block < contacts { block } else { problem.turning[block - contacts].contact as usize }
}

/// 1 / sqrt(e_n) and 1 / sqrt(e_t) of each block row of N.
pub(super) fn block_scaling(problem: &Ccp, residual: &ResidualScale) -> Vec<[f64; 2]> {
    let of_block = |(block, &[nn, t1, t2]): (usize, &[f64; 3])| {
        // A degree of freedom that impulses do not move gets a little of eta.
        let factor = |mobility: f64| 1.0 / mobility.max(0.05 * residual.eta[owner(problem, block)]).sqrt();
        [factor(nn), factor(0.5 * (t1 + t2))]
    };
    problem.delassus.diagonals().par_iter().enumerate().with_min_len(BLOCKS).map(of_block).collect()
}

/// Where the power iteration starts at a place: any vector without symmetry will do.
pub(super) fn start_of_power(place: usize) -> [f64; 3] {
    let s = 1.0 + 0.7 * real::sin(1.7 * place as f64);
    [s, s - 0.9, 0.8 - s]
}

impl ScaledProblem {
    /// Scales and packs a problem. Costs a few products with N.
    pub fn new(problem: &Ccp, residual: &ResidualScale) -> Self {
        let contacts = problem.num_contacts();
        let owner = |block: usize| owner(problem, block);
        let c = residual.size();
        let scaling = block_scaling(problem, residual);
        let add_turning = |order: &mut Vec<u32>| {
            if !problem.turning.is_empty() {
                with_turning(order, contacts, problem.turning.iter().map(|turning| turning.contact));
            }
        };
        let (operator, order) = match &*problem.delassus {
            Delassus::Rigid(rigid) => {
                let mut packing = pack(rigid);
                add_turning(&mut packing.contacts);
                (Operator::Bodies(Box::new(BodyOperator::new(rigid, &packing, &scaling))), packing.contacts)
            }
            Delassus::Sparse(matrix) => {
                let mut order: Vec<u32> = (0..contacts as u32).collect();
                add_turning(&mut order);
                (Operator::Rows(RowOperator::new(matrix, &scaling, &order)), order)
            }
        };
        let batches = order.len().div_ceil(LANES);
        let turning = turning_batches(&order, contacts);
        let mut scaled = Self {
            operator,
            unit: scaling.iter().map(|s| s.map(|s| c * s)).collect(),
            r: vec![ZERO; batches],
            friction: vec![Lanes::default(); batches],
            metric: vec![Metric::default(); batches],
            friction_model: FrictionModel::Relaxed,
            size: c,
            contacts,
            spinning: vec![Default::default(); turning.len()],
            turning,
            order,
        };
        let order = std::mem::take(&mut scaled.order);
        for (place, i) in Self::places_of(&order) {
            let (batch, lane) = (place / LANES, place % LANES);
            let [normal, tangential] = scaled.unit[i];
            let (eta, along_normal) = (residual.eta[owner(i)], scaled.unit[owner(i)][0]);
            let mu = match i.checked_sub(contacts).map(|k| problem.turning[k]) {
                Some(turning) => {
                    let own = &mut scaled.spinning[batch];
                    own[0].0[lane] = turning.spinning * along_normal / normal;
                    own[1].0[lane] = turning.spinning;
                    turning.rolling
                }
                None => problem.friction[i],
            };
            scaled.friction[batch].0[lane] = mu * along_normal / tangential;
            let own = Metric::of(c, [normal, tangential], eta, residual.velocity, mu);
            scaled.metric[batch].set(lane, &own);
        }
        scaled.order = order;
        scaled.set_free_velocity(&problem.r);
        scaled
    }

    /// Places with their block rows, where they have one.
    fn places_of(order: &[u32]) -> impl Iterator<Item = (usize, usize)> + '_ {
        let filled = order.iter().enumerate().filter(|&(_, &i)| i != EMPTY);
        filled.map(|(place, &i)| (place, i as usize))
    }

    /// Replaces r, for another problem with the same N and mu.
    pub fn set_free_velocity(&mut self, r: &[f64]) {
        for (place, i) in Self::places_of(&self.order) {
            for k in 0..3 {
                let factor = self.unit[i][k.min(1)] / (self.size * self.size);
                self.r[place / LANES][k].0[place % LANES] = factor * r[3 * i + k];
            }
        }
    }

    /// The problem that the residual, [`ContactBatch::drive`] and [`ContactBatch::allowed`] are of; relaxed
    /// at first.
    pub fn set_friction_model(&mut self, model: FrictionModel) {
        self.friction_model = model;
    }

    /// The problem that the residual, [`ContactBatch::drive`] and [`ContactBatch::allowed`] are of.
    pub fn friction_model(&self) -> FrictionModel {
        self.friction_model
    }

    /// The ranks that do the passes together; `None` does all of them here. Over rows of N each does all of
    /// them.
    pub fn share_among(&mut self, ranks: Option<&Arc<Ranks>>) {
        if let Operator::Bodies(bodies) = &mut self.operator {
            bodies.share_among(ranks);
        }
    }

    /// A vector of which each rank has its part, complete on all ranks.
    pub fn complete(&self, x: &mut [Batch]) {
        if let Operator::Bodies(bodies) = &self.operator
            && let Some(share) = bodies.share()
        {
            share.complete(x, CHUNK);
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
            Operator::Bodies(bodies) => vec![Lanes::default(); bodies.image_len()],
            Operator::Rows(_) => vec![Lanes::default(); 3 * self.num_batches()],
        }
    }

    /// Scratch for passes.
    pub fn work(&self) -> PassWork {
        let chunks = self.num_batches().div_ceil(CHUNK);
        match &self.operator {
            Operator::Bodies(bodies) => PassWork {
                slots: vec![BodyPair::default(); bodies.num_slots()],
                room: bodies.room(),
                scattered: Vec::new(),
                tallies: vec![Tally::default(); chunks.max(bodies.num_body_tasks())],
                buffers: Buffers::default(),
                products: 0,
            },
            Operator::Rows(_) => PassWork {
                slots: Vec::new(),
                room: Vec::new(),
                scattered: self.zeros(),
                tallies: vec![Tally::default(); chunks],
                buffers: Buffers::default(),
                products: 0,
            },
        }
    }

    /// x of impulses g, projected on the cones.
    pub fn pack(&self, g: &[f64], x: &mut [Batch]) {
        for (place, i) in Self::places_of(&self.order) {
            for k in 0..3 {
                x[place / LANES][k].0[place % LANES] = g[3 * i + k] / self.unit[i][k.min(1)];
            }
        }
        let contacts = self.contacts(0..x.len());
        let mut batch = 0;
        while batch < x.len() {
            if let Some(turning) = contacts.turning_at::<Lanes>(batch) {
                let mu = self.friction[batch];
                let [g, h] = turning.project(mu, [&x[batch], &x[batch + 1]]);
                (x[batch], x[batch + 1]) = (g, h);
                batch += 2;
            } else {
                x[batch] = project(self.friction[batch], &x[batch]);
                batch += 1;
            }
        }
    }

    /// Impulses g of x.
    pub fn unpack(&self, x: &[Batch], g: &mut [f64]) {
        for (place, i) in Self::places_of(&self.order) {
            for k in 0..3 {
                g[3 * i + k] = self.unit[i][k.min(1)] * x[place / LANES][k].0[place % LANES];
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
        image: &[Lanes],
        vectors: [&mut [Batch]; M],
        out: &mut [Lanes],
        work: &mut PassWork,
        kernel: &impl Kernel<M>,
    ) -> (Totals, f64) {
        work.products += 1;
        let totals = self.contact_pass::<M, true, true>(image, vectors, work, kernel);
        (totals, self.collect([out], work, &Replace))
    }

    /// As [`Self::pass`] where the fresh image, of s, is wanted only in combination with others: `images`
    /// starts with that of y, and all of them become what `combine` says once the kernel's tallies are known.
    pub fn pass_onto<const M: usize, const K: usize, C: Combination<K>>(
        &self,
        images: [&mut [Lanes]; K],
        vectors: [&mut [Batch]; M],
        work: &mut PassWork,
        kernel: &impl Kernel<M>,
        combine: impl FnOnce(&Totals) -> C,
    ) -> (Totals, f64) {
        work.products += 1;
        let totals = self.contact_pass::<M, true, true>(images[0], vectors, work, kernel);
        let quadratic = self.collect(images, work, &combine(&totals));
        (totals, quadratic)
    }

    /// The second half of a pass: combines the image of the impulses that the contacts have handed over with
    /// others; their quadratic form.
    fn collect<const K: usize>(
        &self,
        images: [&mut [Lanes]; K],
        work: &mut PassWork,
        combination: &impl Combination<K>,
    ) -> f64 {
        match &self.operator {
            Operator::Bodies(bodies) => {
                let PassWork { slots, room, tallies, buffers, .. } = work;
                bodies.velocities((slots, room), images, tallies, buffers, combination)
            }
            Operator::Rows(rows) => rows.multiply(&work.scattered, images, &mut work.tallies, combination),
        }
    }

    /// As [`Self::pass`] without new impulses: a look at u = N' y + r'.
    pub fn look<const M: usize>(
        &self,
        image: &[Lanes],
        vectors: [&mut [Batch]; M],
        work: &mut PassWork,
        kernel: &impl Kernel<M>,
    ) -> Totals {
        self.contact_pass::<M, true, false>(image, vectors, work, kernel)
    }

    #[inline(always)]
    fn contact_pass<const M: usize, const GATHER: bool, const SCATTER: bool>(
        &self,
        image: &[Lanes],
        vectors: [&mut [Batch]; M],
        work: &mut PassWork,
        kernel: &impl Kernel<M>,
    ) -> Totals {
        let batches = self.num_batches();
        let chunks = batches.div_ceil(CHUNK);
        let range = |chunk: usize| chunk * CHUNK..((chunk + 1) * CHUNK).min(batches);
        let PassWork { slots, scattered, tallies, buffers, .. } = work;
        let tallies = &mut tallies[..chunks];
        match &self.operator {
            Operator::Bodies(bodies) => {
                let velocity = image.as_chunks::<2>().0;
                let len = |chunks| bodies.slot_range(chunks).len();
                let own = bodies.share().map_or(0..chunks, Share::chunks);
                for_each_task(
                    own.clone(),
                    CHUNK,
                    part_of(vectors, &own, CHUNK),
                    &mut slots[bodies.slot_range(own.clone())],
                    &len,
                    &mut tallies[own],
                    &|chunk, vectors, slots, tally| {
                        let batches = range(chunk);
                        vectorised(BodyPass::<M, GATHER, SCATTER, _> {
                            contacts: self.contacts(batches.clone()),
                            bodies,
                            velocity,
                            compression: bodies.compliance().within(image, batches.clone()),
                            batches,
                            vectors,
                            slots,
                            tally,
                            kernel,
                        });
                    },
                );
                if let Some(share) = bodies.share() {
                    share.passed(LANES * part_len(&share.chunks(), batches));
                    return share.end_pass(SCATTER.then_some(&mut slots[..]), tallies, buffers);
                }
            }
            Operator::Rows(_) => {
                let product = image.as_chunks::<3>().0;
                let len = |chunks: std::ops::Range<usize>| part_len(&chunks, batches);
                for_each_task(
                    0..chunks,
                    CHUNK,
                    vectors,
                    scattered,
                    &len,
                    tallies,
                    &|chunk, vectors, scattered, tally| {
                        let batches = range(chunk);
                        vectorised(RowPass::<M, GATHER, _> {
                            contacts: self.contacts(batches.clone()),
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

    /// out <- image of x; returns x^T N' x. Velocities are not looked at, which saves half of a pass over
    /// bodies.
    pub fn image_of(&self, x: &mut [Batch], out: &mut [Lanes], work: &mut PassWork) -> f64 {
        let (_, quadratic) = self.scatter_pass([x], out, work, &Identity);
        quadratic
    }

    /// As [`Self::pass`] for a kernel that does not look at u: a product's first half.
    pub fn scatter_pass<const M: usize>(
        &self,
        vectors: [&mut [Batch]; M],
        out: &mut [Lanes],
        work: &mut PassWork,
        kernel: &impl Kernel<M>,
    ) -> (Totals, f64) {
        let totals = self.contact_pass::<M, false, true>(&[], vectors, work, kernel);
        (totals, self.collect([out], work, &Replace))
    }

    /// u <- N' x as a product of its own: a pass for the image and a look at it. Methods avoid it by fusing.
    pub fn multiply(&self, x: &mut [Batch], u: &mut [Batch], image: &mut [Lanes], work: &mut PassWork) {
        self.image_of(x, image, work);
        self.look(image, [u], work, &Store::<false>);
    }

    /// Bytes that [`Self::multiply`] has to move at the least, each datum once per pass over it.
    pub fn product_bytes(&self) -> usize {
        let vector = size_of::<Batch>() * self.num_batches();
        match &self.operator {
            Operator::Bodies(bodies) => 2 * bodies.pass_bytes() + 2 * vector,
            Operator::Rows(rows) => rows.pass_bytes() + 4 * vector,
        }
    }

    /// Largest eigenvalue of N' from below, to some per cent: the largest quotient met in a few power
    /// iterations from a fixed vector; at least 1 because trace(N'_ii) = 3. `x` and `image` are overwritten.
    pub fn largest_curvature(&self, x: &mut [Batch], image: &mut [Lanes], work: &mut PassWork) -> f64 {
        for (batch, x) in x.iter_mut().enumerate() {
            for lane in 0..LANES {
                for (k, start) in start_of_power(LANES * batch + lane).into_iter().enumerate() {
                    x[k].0[lane] = start;
                }
            }
        }
        let mut next = image.to_vec();
        let mut largest = 1.0_f64;
        self.image_of(x, &mut next, work);
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

    /// Block N'_ii of the contact at a place.
    pub fn diagonal_block(&self, place: usize) -> Block {
        match &self.operator {
            Operator::Bodies(bodies) => bodies.diagonal_block(place / LANES, place % LANES),
            Operator::Rows(rows) => rows.diagonal_block(place),
        }
    }

    /// Number of contacts.
    pub fn num_contacts(&self) -> usize {
        self.contacts
    }

    /// Number of places: those of the contacts, and where contacts resist turning those of their turning rows
    /// and empty ones.
    pub fn num_places(&self) -> usize {
        self.order.len()
    }

    /// Whether a batch holds the turning rows of the contacts of the batch before it.
    pub fn is_turning(&self, batch: usize) -> bool {
        self.turning.get(batch) == Some(&true)
    }

    /// One sweep of Gauss-Seidel from y = x + beta (x - previous), contact after contact on one thread: the
    /// kernel gets the newest u = N' y + r' at a batch and the batch of y to change, and its change takes
    /// effect before other contacts are looked at; where not every contact of a batch may move at once only
    /// one is let. x becomes the end of the sweep, `previous` the x before. Returns |d|^2 and d^T (x+ - x)
    /// with d = x+ - y, and whether the images of x and of `previous` have followed: over bodies they have,
    /// over rows they are left as they were.
    pub fn sweep(
        &self,
        vectors: [&mut [Batch]; 2],
        images: [&mut [Lanes]; 2],
        beta: f64,
        work: &mut PassWork,
        kernel: &impl Relaxation,
    ) -> ([f64; 2], bool) {
        work.products += 1;
        match &self.operator {
            Operator::Bodies(bodies) => {
                let contacts = self.contacts(0..vectors[0].len());
                let mut tally = Tally::default();
                vectorised(BodySweep { contacts, bodies, vectors, images, beta, kernel, tally: &mut tally });
                let [length, along, ..] = tally.totals().sum;
                ([length, along], true)
            }
            Operator::Rows(rows) => (self.sweep_rows(rows, vectors, beta, kernel), false),
        }
    }

    /// The same over the rows of N.
    fn sweep_rows(
        &self,
        rows: &RowOperator,
        [x, previous]: [&mut [Batch]; 2],
        beta: f64,
        kernel: &impl Relaxation,
    ) -> [f64; 2] {
        let contacts = self.contacts(0..self.num_batches());
        for (x, previous) in x.iter_mut().zip(previous.iter_mut()) {
            let y = extrapolated(x, previous, beta);
            *previous = std::mem::replace(x, y);
        }
        let mut sums = [0.0; 2];
        let mut take = |y: &mut Batch, new: &Batch, x: &Batch, lane: usize| {
            for k in 0..3 {
                let [y, new, x] = [&mut y[k].0[lane], &mut { new[k].0[lane] }, &mut { x[k].0[lane] }];
                sums[0] += (*new - *y) * (*new - *y);
                sums[1] += (*new - *y) * (*new - *x);
                *y = *new;
            }
        };
        for (i, block) in Self::places_of(&self.order) {
            let (batch, lane) = (i / LANES, i % LANES);
            let at = |place: usize, batch: usize, x: &[Batch]| {
                let mut u = self.r[batch];
                for (u, product) in u.iter_mut().zip(rows.row_times(place, x)) {
                    u.0[lane] += product;
                }
                u
            };
            if let Some(turning) = contacts.turning_at(batch) {
                let u = [at(i, batch, x), at(i + LANES, batch + 1, x)];
                let both = [&x[batch], &x[batch + 1]];
                let new = kernel.relaxed_turning(batch, contacts.at(batch), turning, &u, both);
                for k in 0..2 {
                    take(&mut x[batch + k], &new[k], &previous[batch + k], lane);
                }
            } else if block < self.contacts {
                let u = at(i, batch, x);
                let new = kernel.relaxed(batch, contacts.at(batch), &u, &x[batch]);
                take(&mut x[batch], &new, &previous[batch], lane);
            }
        }
        sums
    }

    /// Residual of x, given its image: the natural map in the original metric.
    pub fn residual(&self, x: &mut [Batch], image: &[Lanes], work: &mut PassWork) -> Residual {
        let totals = self.look(image, [x], work, &NaturalMap);
        self.residual_of(&totals)
    }

    /// As [`Self::residual`], given u = N' x + r' contact by contact.
    pub fn residual_given(&self, x: &mut [Batch], u: &mut [Batch], work: &mut PassWork) -> Residual {
        let totals = self.contact_pass::<2, false, false>(&[], [x, u], work, &NaturalMap);
        self.residual_of(&totals)
    }

    /// The residual that [`NaturalMap`] has tallied.
    fn residual_of(&self, totals: &Totals) -> Residual {
        // A lane may lose a NaN in its maximum, never in its sum.
        let square = if totals.sum[0].is_nan() { f64::NAN } else { totals.max };
        let mean = totals.sum[0] / self.num_contacts().max(1) as f64;
        Residual { max: square.sqrt(), rms: mean.sqrt() }
    }

    /// out <- N' x + r', given the image of x.
    pub fn gradient(&self, image: &[Lanes], out: &mut [Batch], work: &mut PassWork) {
        self.look(image, [out], work, &Store::<true>);
    }

    /// What is known about some batches.
    #[inline(always)]
    fn contacts(&self, batches: std::ops::Range<usize>) -> ContactArrays<'_> {
        let compliance = match &self.operator {
            Operator::Bodies(bodies) => bodies.compliance().of(batches.clone()),
            Operator::Rows(_) => &[],
        };
        ContactArrays {
            compliance,
            friction: &self.friction[batches.clone()],
            metric: &self.metric[batches.clone()],
            r: &self.r[batches.clone()],
            turning: if self.turning.is_empty() { &[] } else { &self.turning[batches.clone()] },
            spinning: if self.turning.is_empty() { &[] } else { &self.spinning[batches] },
            exact: self.friction_model == FrictionModel::Coulomb,
        }
    }
}
