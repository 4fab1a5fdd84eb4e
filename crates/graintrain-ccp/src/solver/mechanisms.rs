//! Mechanisms among the bodies that passes see.
//!
//! Bodies that joints hold together have the common inverse mass W = Y Y^T ([`CoupledBodies`]). With the
//! impulses f on all of them their velocities are
//!
//! ```text
//! v = Y q,   q = Y^T f
//! ```
//!
//! q, one number per motion that the joints leave free, lies in an image behind the velocities of bodies, so
//! that linear combinations of images of impulses hold for it as well. A pass over contacts sees the
//! velocities v like those of any bodies. A sweep changes q at every contact of a mechanism and makes the v
//! of a body from it when a contact looks at that: 24 flops per motion (of which there are a multiple of
//! eight) and side, whatever the number of bodies.

use super::body_operator::BodyPair;
use super::cell_images::Motion;
use super::combination::Combination;
use super::dispatch::vectorised;
use super::lanes::{TaskWork, Vector};
use super::octet::{EIGHT, InSingle, Octet, SingleVector, SingleWork};
use super::packing::Packing;
use super::slots::SlotTable;
use crate::delassus::{CoupledBodies, RigidDelassus};
use std::ops::Range;

/// Eight numbers of an image while they are computed with.
pub(super) trait Register<M>: Copy + Default {
    /// From memory.
    fn load(memory: M) -> Self;

    /// To memory.
    fn store(self) -> M;

    /// self + s other.
    fn plus_scaled(self, s: f64, other: Self) -> Self;
}

impl<V: Vector> Register<BodyPair> for BodyPair<V> {
    #[inline(always)]
    fn load(memory: BodyPair) -> Self {
        [V::of(memory[0]), V::of(memory[1])]
    }

    #[inline(always)]
    fn store(self) -> BodyPair {
        [self[0].lanes(), self[1].lanes()]
    }

    #[inline(always)]
    fn plus_scaled(self, s: f64, other: Self) -> Self {
        let s = V::splat(s);
        [self[0] + s * other[0], self[1] + s * other[1]]
    }
}

impl<V: SingleVector> Register<Octet> for V {
    #[inline(always)]
    fn load(memory: Octet) -> Self {
        V::of(memory)
    }

    #[inline(always)]
    fn store(self) -> Octet {
        self.octet()
    }

    #[inline(always)]
    fn plus_scaled(self, s: f64, other: Self) -> Self {
        self + V::splat(s) * other
    }
}

/// Where the force and the moment are in a [`Motion`].
const AXES: [usize; 6] = [0, 1, 2, 4, 5, 6];

/// Y of one body for eight numbers of q: their velocities and spins, and for every axis of [`AXES`] what it
/// has to do with them.
#[derive(Clone, Copy, Debug)]
struct Factor<M> {
    columns: [M; EIGHT],
    rows: [M; AXES.len()],
}

#[derive(Clone, Debug)]
struct Mechanism<M> {
    /// Places of the bodies that have contacts.
    bodies: Vec<u32>,
    /// Places of q in an image, eight numbers each.
    place: Range<usize>,
    /// Body by body, as many each as q has places.
    factor: Vec<Factor<M>>,
}

impl<M: Motion> Mechanism<M> {
    /// q begins at this place of an image.
    fn new(
        group: &CoupledBodies,
        (rigid, packing): (&RigidDelassus, &Packing),
        [mobility, length]: [f64; 2],
        first: usize,
    ) -> Self {
        let places = group.degrees.div_ceil(EIGHT);
        let (mut bodies, mut factor) = (Vec::new(), Vec::new());
        for (rows, &body) in group.factor.chunks_exact((6 * group.degrees).max(1)).zip(&group.bodies) {
            if rigid.sides(body as usize).is_empty() {
                continue;
            }
            bodies.push(packing.bodies[body as usize]);
            let unit = mobility.sqrt();
            let entry = |axis: usize, degree: usize| match degree < group.degrees {
                true => rows[axis * group.degrees + degree] * if axis < 3 { 1.0 } else { length } / unit,
                false => 0.0,
            };
            factor.extend((0..places).map(|place| Factor {
                columns: std::array::from_fn(|k| {
                    let mut column = [0.0; EIGHT];
                    for (axis, &at) in AXES.iter().enumerate() {
                        column[at] = entry(axis, EIGHT * place + k);
                    }
                    M::of_numbers(column)
                }),
                rows: std::array::from_fn(|axis| {
                    M::of_numbers(std::array::from_fn(|k| entry(axis, EIGHT * place + k)))
                }),
            }));
        }
        Self { bodies, place: first..first + places, factor }
    }

    #[inline(always)]
    fn factor(&self, body: usize) -> &[Factor<M>] {
        let count = self.place.len();
        &self.factor[count * body..count * (body + 1)]
    }

    /// Y q of one body.
    #[inline(always)]
    fn velocity<R: Register<M>>(&self, body: usize, q: &[M]) -> M {
        let mut velocity = R::default();
        for (factor, q) in self.factor(body).iter().zip(q) {
            for k in 0..EIGHT {
                velocity = velocity.plus_scaled(q.number(k), R::load(factor.columns[k]));
            }
        }
        velocity.store()
    }

    /// q <- q + Y^T f of an impulse and its moment on one body.
    #[inline(always)]
    fn push<R: Register<M>>(&self, body: usize, impulse: M, q: &mut [M]) {
        for (factor, q) in self.factor(body).iter().zip(q) {
            let mut sum = R::load(*q);
            for (row, axis) in factor.rows.iter().zip(AXES) {
                sum = sum.plus_scaled(impulse.number(axis), R::load(*row));
            }
            *q = sum.store();
        }
    }

    /// See [`PackedMechanisms::room`].
    fn room(&self) -> usize {
        self.place.len() + self.bodies.len()
    }

    /// q = Y^T f of the impulses in the slots, then the velocities Y q of the bodies.
    #[inline(always)]
    fn make<R: Register<M>>(&self, (slots, table): (&[M], &SlotTable), room: &mut [M]) {
        let (q, velocities) = room.split_at_mut(self.place.len());
        q.fill(R::default().store());
        for (body, &place) in self.bodies.iter().enumerate() {
            let mut sum = R::default();
            for &slot in table.of_body(place as usize) {
                sum = sum.plus_scaled(1.0, R::load(slots[slot as usize]));
            }
            self.push::<R>(body, sum.store(), q);
        }
        for (body, velocity) in velocities.iter_mut().enumerate() {
            *velocity = self.velocity::<R>(body, q);
        }
    }
}

/// Of a place whose body is in no mechanism.
const NONE: u32 = u32::MAX;

/// The mechanisms of a problem.
#[derive(Clone, Debug)]
pub(super) struct PackedMechanisms<M> {
    /// Number of the mechanism and of the body in it of every place; [`NONE`] where the body is alone.
    member_of: Vec<[u32; 2]>,
    all: Vec<Mechanism<M>>,
}

impl<M: Motion> PackedMechanisms<M> {
    /// With lengths in units of `length` (m) and mobilities in units of `mobility` (1/kg), and q from this
    /// place of an image on; `None` where no joint couples bodies.
    pub(super) fn new(
        rigid: &RigidDelassus,
        packing: &Packing,
        units: [f64; 2],
        first: usize,
    ) -> Option<Self> {
        if rigid.coupled().is_empty() {
            return None;
        }
        let mut all: Vec<Mechanism<M>> = Vec::new();
        let mut member_of = vec![[NONE; 2]; packing.num_places() + 1];
        for (group, number) in rigid.coupled().iter().zip(0..) {
            let first = all.last().map_or(first, |last| last.place.end);
            let mechanism = Mechanism::new(group, (rigid, packing), units, first);
            for (&place, body) in mechanism.bodies.iter().zip(0..) {
                member_of[place as usize] = [number, body];
            }
            all.push(mechanism);
        }
        Some(Self { member_of, all })
    }

    /// Whether no number has left the range of the precision.
    pub(super) fn is_finite(&self) -> bool {
        let factors = self.all.iter().flat_map(|mechanism| &mechanism.factor);
        let mut motions = factors.flat_map(|factor| &factor.columns);
        motions.all(|motion| (0..EIGHT).all(|k| motion.number(k).is_finite()))
    }

    /// Number of places that q takes in an image.
    pub(super) fn len(&self) -> usize {
        self.all.iter().map(|mechanism| mechanism.place.len()).sum()
    }

    /// Whether the body at a place is one of these.
    pub(super) fn has(&self, place: u32) -> bool {
        self.member_of[place as usize][0] != NONE
    }

    #[inline(always)]
    fn at(&self, place: u32) -> Option<(&Mechanism<M>, usize)> {
        let [number, body] = self.member_of[place as usize];
        (number != NONE).then(|| (&self.all[number as usize], body as usize))
    }

    /// Makes the velocities of the bodies at some places what q says.
    #[inline(always)]
    pub(super) fn bring<R: Register<M>>(&self, places: &[u32], image: &mut [M]) {
        for &place in places {
            if let Some((mechanism, body)) = self.at(place) {
                image[place as usize] = mechanism.velocity::<R>(body, &image[mechanism.place.clone()]);
            }
        }
    }

    /// The same of all bodies.
    #[inline(always)]
    pub(super) fn bring_all<R: Register<M>>(&self, image: &mut [M]) {
        for mechanism in &self.all {
            self.bring::<R>(&mechanism.bodies, image);
        }
    }

    /// Adds an impulse with its moment on the body at a place to q.
    #[inline(always)]
    pub(super) fn push<R: Register<M>>(&self, place: u32, impulse: M, image: &mut [M]) {
        if let Some((mechanism, body)) = self.at(place) {
            mechanism.push::<R>(body, impulse, &mut image[mechanism.place.clone()]);
        }
    }

    /// Room for what a pass makes of the q and of the velocities of all bodies.
    pub(super) fn room(&self) -> Vec<M> {
        vec![M::of_numbers([0.0; EIGHT]); self.all.iter().map(Mechanism::room).sum()]
    }

    /// Lets the mechanisms in image vectors follow what [`Mechanism::make`] has made; their part of the
    /// quadratic form, |q|^2.
    fn combine<const K: usize>(
        &self,
        room: &[M],
        mut images: [&mut [M]; K],
        combination: &impl Combination<K>,
    ) -> f64 {
        let (mut quadratic, mut first) = (0.0, 0);
        for mechanism in &self.all {
            let (q, velocities) = room[first..first + mechanism.room()].split_at(mechanism.place.len());
            first += mechanism.room();
            quadratic += q.iter().flat_map(|q| q.pair()).map(|q| (q * q).sum()).sum::<f64>();
            let bodies = mechanism.bodies.iter().map(|&place| place as usize).zip(velocities);
            for (place, fresh) in mechanism.place.clone().zip(q).chain(bodies) {
                let fresh = fresh.pair();
                let known = images.each_ref().map(|image| image[place].pair());
                let new = [0, 1].map(|half| combination.of(fresh[half], known.map(|pair| pair[half])));
                for (k, image) in images.iter_mut().enumerate() {
                    image[place] = M::of_pair([new[0][k], new[1][k]]);
                }
            }
        }
        quadratic
    }
}

/// What some mechanisms make of the impulses in the slots.
struct Making<'a, M> {
    all: &'a [Mechanism<M>],
    from: (&'a [M], &'a SlotTable),
    room: &'a mut [M],
}

/// Mechanisms that a thread takes at least.
const TASK: usize = 16;

impl<'a, M: Motion + Send + Sync> Making<'a, M> {
    /// In halves over the threads of rayon, each with what `work` does; nothing is allocated.
    fn over(self, work: &(impl Fn(Making<'_, M>) + Sync)) {
        let Self { all, from, room } = self;
        if all.len() < 2 * TASK {
            return work(Making { all, from, room });
        }
        let (low, high) = all.split_at(all.len() / 2);
        let (room, more_room) = room.split_at_mut(low.iter().map(Mechanism::room).sum());
        let [low, high] = [Making { all: low, from, room }, Making { all: high, from, room: more_room }];
        rayon::join(|| low.over(work), || high.over(work));
    }

    #[inline(always)]
    fn make<R: Register<M>>(self) {
        let mut room = self.room;
        for mechanism in self.all {
            let (own, rest) = room.split_at_mut(mechanism.room());
            mechanism.make::<R>(self.from, own);
            room = rest;
        }
    }
}

impl TaskWork for Making<'_, BodyPair> {
    #[inline(always)]
    fn run<V: Vector>(self) {
        self.make::<BodyPair<V>>();
    }
}

impl SingleWork for Making<'_, Octet> {
    #[inline(always)]
    fn run<V: SingleVector>(self) {
        self.make::<V>();
    }
}

impl PackedMechanisms<BodyPair> {
    /// Lets the mechanisms in image vectors follow the impulses in the slots; their part of the quadratic
    /// form, |q|^2.
    pub(super) fn follow<const K: usize>(
        &self,
        from: (&[BodyPair], &SlotTable),
        room: &mut [BodyPair],
        images: [&mut [BodyPair]; K],
        combination: &impl Combination<K>,
    ) -> f64 {
        Making { all: &self.all, from, room }.over(&|part| vectorised(part));
        self.combine(room, images, combination)
    }
}

impl PackedMechanisms<Octet> {
    /// The same in single precision.
    pub(super) fn follow<const K: usize>(
        &self,
        from: (&[Octet], &SlotTable),
        room: &mut [Octet],
        images: [&mut [Octet]; K],
        combination: &impl Combination<K>,
    ) -> f64 {
        Making { all: &self.all, from, room }.over(&|part| vectorised(InSingle(part)));
        self.combine(room, images, combination)
    }
}

#[cfg(test)]
mod tests {
    use super::super::cell_images::tests::{relative_velocities, solvable};
    use super::super::first_order::{FirstOrder, FirstOrderMethod};
    use super::super::settings::SolveSettings;
    use super::super::{AcceleratedSweeps, Apgd, GaussSeidel};
    use super::*;
    use crate::delassus::tests::{random_rigid, uniform};
    use crate::problem::Ccp;
    use crate::residual::FrictionModel;
    use crate::solver::Status;

    /// Random contacts, of which two in three may be compliant, over bodies of which every fourth is in one
    /// of three mechanisms.
    fn problem(bodies: usize, contacts: usize, is_compliant: bool) -> Ccp {
        let mut random = uniform(5);
        let of = |(first, degrees): (u32, usize)| {
            let own: Vec<u32> = (first..bodies as u32).step_by(12).collect();
            let factor = (0..6 * own.len() * degrees).map(|_| random() - 0.5).collect();
            CoupledBodies { bodies: own, degrees, factor }
        };
        let coupled = [(0, 2), (4, 8), (8, 13)].map(of).to_vec();
        let compliance = if is_compliant { contacts } else { 0 };
        let compliance = (0..compliance).map(|i| f64::from((i % 3) as u32)).collect();
        solvable(random_rigid(bodies, contacts, 7).with_coupled(coupled).with_compliance(compliance))
    }

    fn agree<S: FirstOrderMethod>(method: impl Fn() -> S) {
        for (bodies, contacts, is_compliant) in
            [(30, 40, false), (600, 900, false), (30, 40, true), (600, 900, true)]
        {
            let over_bodies = problem(bodies, contacts, is_compliant);
            let over_rows = over_bodies.as_matrix_if(|_| true, &mut None).unwrap();
            for (tolerance, allowed) in [(1e-9, 1e-6), (2e-3, 0.3)] {
                let settings = SolveSettings { tolerance, ..SolveSettings::default() };
                let expected = relative_velocities(&over_rows, &mut FirstOrder::new(method()), &settings);
                let found = relative_velocities(&over_bodies, &mut FirstOrder::new(method()), &settings);
                let largest = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(largest < allowed, "{contacts} contacts to {tolerance:e}: {largest:e}");
            }
        }
    }

    /// The velocities that impulses make are unique: over mechanisms and compliant contacts they are those
    /// over the rows of N, in double and begun in single precision.
    #[test]
    fn mechanisms_do_what_the_matrix_does() {
        agree(Apgd::default);
        agree(AcceleratedSweeps::default);
        agree(GaussSeidel::default);
    }

    /// A solver by name takes them, with exact friction; methods of second order do by the rows of N.
    #[test]
    fn solvers_by_name_take_mechanisms() {
        let problem = problem(60, 80, true);
        for name in ["auto", "apgd", "apgs", "pgs", "ipm"] {
            let mut solver = name.parse::<crate::SolverSpec>().unwrap().build().unwrap();
            let settings = SolveSettings {
                friction: FrictionModel::Coulomb,
                tolerance: 1e-6,
                ..SolveSettings::default()
            };
            let mut g = vec![0.0; problem.r.len()];
            let report = solver.solve(&problem, &mut g, &settings).unwrap();
            assert_eq!(report.status, Status::Converged, "{name}");
        }
    }
}
