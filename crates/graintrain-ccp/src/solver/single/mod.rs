//! The scaled problem over rigid bodies in single precision: half of the bytes and twice the contacts per
//! instruction of [`scaling`].
//!
//! Masses are in units of the heaviest body and arms in units of their mean, so that no number leaves the
//! range of f32. What an iterate is worth is claimed by nobody here: the residual that counts is evaluated in
//! double precision on the exact geometry, and where rounding (of the order of 6e-8 eta_i |g_i| / V) comes
//! near the tolerance, double precision goes on.
//!
//! [`scaling`]: super::scaling

mod geometry;
mod iterate;
mod kernel;
mod operator;
mod sweep;

use super::body_pass::BODIES;
use super::cell_images::PackedCell;
use super::compliance::PackedCompliance;
use super::lanes::Batch;
use super::mechanisms::PackedMechanisms;
use super::octet::{EIGHT, Octet};
use super::packing::{self, PackedBlocks, Packing, pack, pack_in_blocks};
use super::ranks::Ranks;
use super::scaling::{Metric, block_scaling};
use super::settings::SolveSettings;
use super::slots::SlotTable;
use crate::delassus::{BodyInverseMass, Delassus, FIXED, RigidContact, RigidDelassus};
use crate::problem::Ccp;
use crate::residual::{Criterion, FrictionModel, ResidualScale};
use geometry::{Bodies, General, Radial};
use operator::{Arrangement, CHUNK, ContactNumbers, InverseMasses, SingleOperator, own_batches};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use sweep::Sweeps;

pub use iterate::SingleIterate;
#[cfg(test)]
pub(super) use iterate::{PATIENCE, ROUNDING};

/// Arms that are off the normal by more than this fraction of their length are taken as they are.
const ALONG_NORMAL: f64 = 1e-9;

/// Contacts below which the packing costs more than the iterations save. Values of this and of what follows:
/// docs/solvers.md, "Single precision first", on the common drop of 4 913 spheres at tolerances of 1e-2 and
/// 1e-3.
pub(super) const FEWEST_CONTACTS: usize = 256;
/// Least tolerance of the root mean square: what single precision reaches on packings.
pub(super) const LEAST_TOLERANCE: f64 = 2e-5;
/// The same of the worst contact.
pub(super) const LEAST_MAXIMUM: f64 = 1e-3;

/// The scaled problem in single precision.
#[derive(Clone, Debug)]
pub struct SingleProblem {
    operator: SingleOperator,
    /// Contact at each place.
    order: Vec<u32>,
    /// c / sqrt(e_n) and c / sqrt(e_t) of each contact, N s per unit of x.
    unit: Vec<[f64; 2]>,
    /// c, the size of impulses in the problem's own metric.
    size: f64,
    metric: Vec<Metric<Octet>>,
    friction_model: FrictionModel,
    /// For methods that sweep.
    sweeps: Option<Sweeps>,
}

/// Whether the solve may begin in single precision: over rigid bodies, contacts that let them turn, not too
/// few of them, not too tight a tolerance.
pub(super) fn suits(problem: &Ccp, settings: &SolveSettings) -> bool {
    if matches!(&*problem.delassus, Delassus::Sparse(_)) {
        return false;
    }
    let least = match settings.criterion {
        Criterion::Mixed => LEAST_TOLERANCE,
        Criterion::Maximum => LEAST_MAXIMUM,
    };
    problem.turning.is_empty() && problem.num_contacts() >= FEWEST_CONTACTS && settings.tolerance >= least
}

/// Units of mobility (1/kg) and length (m), in which the numbers of a problem are near one.
fn units(rigid: &RigidDelassus) -> [f64; 2] {
    let or_one = |x: f64| if x > 0.0 && x.is_finite() { x } else { 1.0 };
    let mobilities = rigid.inverse_mass().iter().flat_map(|m| m.linear).filter(|&m| m > 0.0);
    let mobility = mobilities.fold(f64::INFINITY, f64::min);
    let length = |arm: [f64; 3]| arm.iter().map(|x| x * x).sum::<f64>().sqrt();
    let arms: f64 = rigid.contacts().iter().map(|c| length(c.arm_a).max(length(c.arm_b))).sum();
    [or_one(mobility), or_one(arms / rigid.num_contacts() as f64)]
}

/// The length of an arm along the normal, where it is along it.
fn along_normal(body: u32, arm: [f64; 3], normal: [f64; 3]) -> Option<f64> {
    if body == FIXED {
        return Some(0.0);
    }
    let along: f64 = arm.iter().zip(normal).map(|(a, n)| a * n).sum();
    let off: f64 = arm.iter().zip(normal).map(|(a, n)| (a - along * n).powi(2)).sum();
    (off <= (ALONG_NORMAL * along).powi(2)).then_some(along)
}

/// The lengths of both arms of a contact along its normal, where t2 = n x t1 and both are along it.
fn radial_arms(contact: &RigidContact) -> Option<[f64; 2]> {
    let [n, t1, t2] = contact.frame;
    let across = crate::delassus::cross(n, t1);
    let is_right_handed = across.iter().zip(t2).all(|(a, b)| (a - b).abs() <= ALONG_NORMAL);
    let of_a = along_normal(contact.body_a, contact.arm_a, n).filter(|_| is_right_handed)?;
    Some([of_a, along_normal(contact.body_b, contact.arm_b, n)?])
}

/// M^-1 of the bodies in the order of the packing, in these units.
fn inverse_masses(packing: &Packing, all: &[BodyInverseMass], [mobility, length]: [f64; 2]) -> InverseMasses {
    let mut masses = InverseMasses { diagonal: vec![Octet::default(); all.len()], others: Vec::new() };
    let entry = |mass: &BodyInverseMass, row: usize, column: usize| {
        (mass.angular[3 * row + column] * (length * length / mobility)) as f32
    };
    let is_diagonal = |mass: &BodyInverseMass| {
        let largest = (0..3).map(|k| mass.angular[4 * k].abs()).fold(0.0, f64::max);
        [1, 2, 5].iter().all(|&k| mass.angular[k].abs() <= 1e-12 * largest)
    };
    if !all.iter().all(is_diagonal) {
        masses.others = vec![[Octet::default(); 2]; all.len()];
    }
    for (&place, mass) in packing.bodies.iter().zip(all).filter(|(place, _)| !packing.is_coupled(**place)) {
        let place = place as usize;
        for axis in 0..3 {
            masses.diagonal[place].0[axis] = (mass.linear[axis] / mobility) as f32;
            masses.diagonal[place].0[4 + axis] = entry(mass, axis, axis);
            if let Some(others) = masses.others.get_mut(place) {
                for (turn, other) in others.iter_mut().enumerate() {
                    other.0[4 + axis] = entry(mass, axis, (axis + 1 + turn) % 3);
                }
            }
        }
    }
    masses
}

/// Contacts in batches in this order, arms in units of this length; `batch_of` makes the rows and the bodies
/// of a batch. Only the `own` batches are filled.
fn arrangement(
    rigid: &RigidDelassus,
    order: &[u32],
    own: &Range<usize>,
    length: f64,
    batch_of: impl Fn(usize, &[u32]) -> ([[Octet; 3]; 3], Bodies) + Sync,
) -> Arrangement {
    let all_batches = order.par_chunks(EIGHT).enumerate().with_min_len(CHUNK);
    let radial: Option<Vec<[f64; 2]>> =
        rigid.contacts().par_iter().with_min_len(CHUNK * EIGHT).map(radial_arms).collect();
    if let Some(radial) = radial {
        let of = |(batch, order): (usize, &[u32])| {
            if !own.contains(&batch) {
                return Radial::default();
            }
            let (rows, bodies) = batch_of(batch, order);
            let mut arms = [Octet::default(); 2];
            for (lane, &i) in order.iter().enumerate() {
                for (arm, own) in arms.iter_mut().zip(radial[i as usize]) {
                    arm.0[lane] = (own / length) as f32;
                }
            }
            Radial { rows, arms, bodies }
        };
        return Arrangement::Radial(all_batches.map(of).collect());
    }
    let of = |(batch, order): (usize, &[u32])| {
        if !own.contains(&batch) {
            return General::default();
        }
        let (rows, bodies) = batch_of(batch, order);
        let mut arms = [[Octet::default(); 3]; 2];
        for (lane, &i) in order.iter().enumerate() {
            let contact = &rigid.contacts()[i as usize];
            for (arm, own) in arms.iter_mut().zip([contact.arm_a, contact.arm_b]) {
                for axis in 0..3 {
                    arm[axis].0[lane] = (own[axis] / length) as f32;
                }
            }
        }
        General { rows, arms, bodies }
    };
    Arrangement::General(all_batches.map(of).collect())
}

/// The packing, with lists of blocks for sweeps from these impulses.
fn packed(
    rigid: &RigidDelassus,
    r: &[f64],
    sweeps: Option<&[f64]>,
) -> (Packing, Option<Vec<Vec<packing::Block>>>) {
    let Some(start) = sweeps else { return (pack(rigid), None) };
    // What does not press at the start and would open by itself will hardly press.
    let is_idle = |i: u32| start[3 * i as usize] == 0.0 && r[3 * i as usize] > 0.0;
    let PackedBlocks { packing, lists } = pack_in_blocks(rigid, EIGHT, is_idle);
    (packing, Some(lists))
}

impl SingleProblem {
    /// Scales and packs a problem that [`suits`], for sweeps from these impulses or for none, for `ranks`
    /// that do the passes together what this one needs. `None` where a number leaves the range of single
    /// precision.
    pub(super) fn new(
        problem: &Ccp,
        residual: &ResidualScale,
        sweeps: Option<&[f64]>,
        ranks: Option<&Arc<Ranks>>,
    ) -> Option<Self> {
        let Delassus::Rigid(rigid) = &*problem.delassus else { return None };
        let (packing, blocks) = packed(rigid, &problem.r, sweeps);
        let behind = PackedCompliance::<Octet>::per_chunk(rigid, CHUNK);
        let slots = SlotTable::new(rigid, &packing, CHUNK * EIGHT, behind);
        let sharing = ranks.filter(|_| rigid.cell().is_none() && behind == 0);
        let share = slots.share(sharing, BODIES, |place| packing.is_coupled(place));
        let scaling = block_scaling(problem, residual);
        let [mobility, length] = units(rigid);
        let scale = mobility.sqrt();
        let batches = packing.contacts.len().div_ceil(EIGHT);
        let own = own_batches(share.as_deref(), batches);
        let fixed = packing.num_places() as u32;
        let bodies = Bodies { place: [[fixed; EIGHT]; 2], slot: [[0; EIGHT]; 2] };
        let batch_of = |batch: usize, order: &[u32]| {
            let (mut rows, mut own_bodies) = ([[Octet::default(); 3]; 3], bodies);
            for (lane, &i) in order.iter().enumerate() {
                let (contact, factors) = (&rigid.contacts()[i as usize], &scaling[i as usize]);
                for (row, own) in rows.iter_mut().enumerate() {
                    for axis in 0..3 {
                        own[axis].0[lane] = (scale * factors[row.min(1)] * contact.frame[row][axis]) as f32;
                    }
                }
                let sides = packing.places_of(rigid, i);
                let own_slots = slots.of_place(EIGHT * batch + lane);
                for (side, (body, slot)) in sides.into_iter().zip(own_slots).enumerate() {
                    own_bodies.place[side][lane] = body;
                    own_bodies.slot[side][lane] = slot as u16;
                }
            }
            (rows, own_bodies)
        };
        let arrangement = arrangement(rigid, &packing.contacts, &own, length, batch_of);
        let size = residual.size();
        let masses = inverse_masses(&packing, rigid.inverse_mass(), [mobility, length]);
        let cell = PackedCell::new(rigid, &packing.images, [mobility, length]);
        let first = packing.num_places() + 1 + usize::from(cell.is_some());
        let mechanisms = PackedMechanisms::new(rigid, &packing, [mobility, length], first);
        let first = first + mechanisms.as_ref().map_or(0, PackedMechanisms::len);
        let operator = SingleOperator {
            arrangement,
            contacts: vec![ContactNumbers::default(); batches],
            masses,
            slots: slots.without_places(),
            num_places: packing.num_places(),
            cell,
            mechanisms,
            compliance: PackedCompliance::new(rigid, &packing.contacts, &scaling, (first, CHUNK)),
            share,
        };
        let sweeps =
            blocks.map(|blocks| Sweeps::new(&problem.delassus, (&packing, blocks), &scaling, &operator));
        let mut single = Self {
            operator,
            sweeps,
            order: packing.contacts,
            unit: scaling.par_iter().with_min_len(CHUNK * EIGHT).map(|s| s.map(|s| size * s)).collect(),
            size,
            metric: vec![Metric::default(); batches],
            friction_model: FrictionModel::Relaxed,
        };
        let Self { operator, order, unit, metric, .. } = &mut single;
        let numbers = operator.contacts[own.clone()].par_iter_mut().zip(&mut metric[own.clone()]);
        let own = numbers.zip(order.par_chunks(EIGHT).skip(own.start).take(own.len()));
        own.with_min_len(CHUNK).for_each(|((numbers, metric), order)| {
            for (lane, &i) in order.iter().enumerate() {
                let i = i as usize;
                let (eta, mu) = (residual.eta[i], problem.friction[i]);
                let [normal, tangential] = unit[i];
                numbers.mu.0[lane] = (mu * normal / tangential) as f32;
                metric.set(lane, &Metric::of(size, [normal, tangential], eta, residual.velocity, mu));
            }
        });
        single.set_free_velocity(&problem.r);
        let finite = single.is_finite();
        let all_finite = match ranks {
            Some(ranks) => ranks.numbers(u64::from(finite)).iter().all(|&finite| finite != 0),
            None => finite,
        };
        all_finite.then_some(single)
    }

    /// Whether no number has left the range of single precision.
    fn is_finite(&self) -> bool {
        let finite = |octet: &Octet| octet.0.iter().all(|x| x.is_finite());
        let rows = match &self.operator.arrangement {
            Arrangement::Radial(all) => all.par_iter().all(|g| g.rows.as_flattened().iter().all(finite)),
            Arrangement::General(all) => all.par_iter().all(|g| g.rows.as_flattened().iter().all(finite)),
        };
        let metric = |m: &Metric<Octet>| [m.normal, m.tangential, m.along, m.across].iter().all(finite);
        rows && self.operator.contacts.par_iter().all(|c| c.r.iter().chain([&c.mu]).all(finite))
            && self.metric.par_iter().all(metric)
            && self.operator.masses.diagonal.iter().all(finite)
            && self.operator.masses.others.as_flattened().iter().all(finite)
            && self.operator.compliance.of(0..self.operator.compliance.len()).iter().all(finite)
            && self.operator.mechanisms.as_ref().is_none_or(PackedMechanisms::is_finite)
    }

    /// Replaces r, for another problem with the same N and mu.
    pub(super) fn set_free_velocity(&mut self, r: &[f64]) {
        let Self { operator, order, unit, size, .. } = self;
        let own = operator.own_batches();
        let order = order.par_chunks(EIGHT).skip(own.start).take(own.len());
        operator.contacts[own].par_iter_mut().zip(order).with_min_len(CHUNK).for_each(|(numbers, order)| {
            for (lane, &i) in order.iter().enumerate() {
                let i = i as usize;
                for k in 0..3 {
                    let factor = unit[i][k.min(1)] / (*size * *size);
                    numbers.r[k].0[lane] = (factor * r[3 * i + k]) as f32;
                }
            }
        });
    }

    /// The problem that the residual and the steps are of; relaxed at first.
    pub(super) fn set_friction_model(&mut self, model: FrictionModel) {
        self.friction_model = model;
    }

    /// A vector of which each rank has its part, complete on all ranks.
    fn complete(&self, x: &mut [Batch<Octet>]) {
        if let Some(share) = &self.operator.share {
            share.complete(x, CHUNK);
        }
    }

    /// Number of contacts.
    pub(super) fn num_contacts(&self) -> usize {
        self.order.len()
    }

    /// A vector of zeros.
    fn zeros(&self) -> Vec<Batch<Octet>> {
        vec![[Octet::default(); 3]; self.operator.contacts.len()]
    }

    /// x of impulses g, projected on the cones.
    fn pack(&self, g: &[f64], x: &mut [Batch<Octet>]) {
        let batches = self.operator.contacts.par_iter().zip(self.order.par_chunks(EIGHT)).with_min_len(CHUNK);
        x.par_iter_mut().zip(batches).for_each(|(x, (contact, order))| {
            for (lane, &i) in order.iter().enumerate() {
                let i = i as usize;
                for k in 0..3 {
                    x[k].0[lane] = (g[3 * i + k] / self.unit[i][k.min(1)]) as f32;
                }
            }
            *x = super::lanes::project(contact.mu, x);
        });
    }

    /// Impulses g of x.
    pub(super) fn unpack(&self, x: &[Batch<Octet>], g: &mut [f64]) {
        for (place, &i) in self.order.iter().enumerate() {
            let i = i as usize;
            for k in 0..3 {
                g[3 * i + k] = self.unit[i][k.min(1)] * f64::from(x[place / EIGHT][k].0[place % EIGHT]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::combination::Replace;
    use super::super::gauss_seidel::tests::{jointed, row_of_bodies};
    use super::kernel::Identity;
    use super::sweep::Sweep;
    use super::*;

    /// After sweeps with a momentum, in several blocks, the images of x and of the x before are what a pass
    /// makes of them: the velocities of all bodies, the q of mechanisms, C x.
    #[test]
    fn sweeps_keep_images_of_mechanisms_and_compliant_contacts() {
        let problem = jointed(row_of_bodies(9000));
        let start = vec![0.0; problem.r.len()];
        let single = SingleProblem::new(&problem, &ResidualScale::new(&problem), Some(&start), None).unwrap();
        let (operator, sweeps) = (&single.operator, single.sweeps.as_ref().unwrap());
        let mut vectors = [single.zeros(), single.zeros()];
        let mut images =
            [vec![Octet::default(); operator.image_len()], vec![Octet::default(); operator.image_len()]];
        let (mut scratch, mut room) = (operator.scratch(), sweeps.scratch(operator));
        for beta in [0.0, 0.4, 0.8] {
            let sweep = Sweep { beta, relaxation: 1.0, model: FrictionModel::Relaxed };
            let of = (vectors.each_mut().map(|v| &mut v[..]), images.each_mut().map(|v| &mut v[..]));
            sweeps.sweep(operator, of.0, of.1, &mut room, sweep);
            for (x, image) in vectors.iter_mut().zip(&images) {
                let mut fresh = image.clone();
                operator.contact_pass::<1, false, true>(&[], [x], &mut scratch, &Identity);
                operator.body_pass([&mut fresh], &mut scratch, &Replace);
                let size = fresh.iter().map(|octet| octet.largest()).fold(0.0, f32::max);
                // Vectors of bodies are followed by numbers without meaning.
                let counts = |place: usize, k: usize| place >= operator.num_places || k % 4 != 3;
                for (place, (fresh, kept)) in fresh.iter().zip(image).enumerate() {
                    for k in (0..EIGHT).filter(|&k| counts(place, k)) {
                        assert!(
                            (fresh.0[k] - kept.0[k]).abs() <= 3e-4 * size,
                            "place {place}: {fresh:?} {kept:?}"
                        );
                    }
                }
            }
        }
    }
}
