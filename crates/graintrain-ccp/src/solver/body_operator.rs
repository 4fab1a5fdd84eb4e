//! N over rigid bodies, packed for the first-order methods: contacts in batches of four, each pass over the
//! contacts both reads the velocities of the last impulses and adds up the forces of the new ones.

use super::body_pass::{BODIES, num_body_tasks, over_bodies};
use super::cell_images::PackedCell;
use super::combination::Combination;
use super::compliance::PackedCompliance;
use super::dispatch::vectorised;
use super::lanes::{Batch, LANES, Lanes, TaskWork, Vector, ZERO, add, cross, dot, load, scale, sub, zero};
use super::mechanisms::{PackedMechanisms, Register};
use super::packing::{EMPTY, Packing, turning_batches};
use super::ranks::Ranks;
use super::share::{Buffers, Share};
use super::slots::SlotTable;
use super::tasks::{CHUNK, Tally};
use crate::delassus::{BodyInverseMass, RigidDelassus};
use graintrain_linalg::block3::Block;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

/// Geometry of four contacts. The rows of the frame are scaled, the normal one and the tangential ones each
/// by their factor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Geometry {
    /// Rows n, t1, t2, each with its world components.
    frame: [Batch; 3],
    arm_a: Batch,
    arm_b: Batch,
    /// Places of bodies A and B; the last one stands for a fixed one, whose velocity is zero.
    body_a: [u32; LANES],
    body_b: [u32; LANES],
    /// Where the forces on A and B go: slot in the chunk's own sums; slot 0 is for fixed bodies.
    slot_a: [u32; LANES],
    slot_b: [u32; LANES],
}

/// Two vectors of a body, each followed by a zero: its velocity u and spin w, or the force and moment on it.
pub(super) type BodyPair<V = Lanes> = [V; 2];

/// Impulses in world axes and their moments about bodies A and B, contact by contact.
type WorldImpulses<V> = [[V; LANES]; 3];

impl Geometry {
    /// D^T v of these contacts.
    #[inline(always)]
    pub(super) fn relative_velocity<V: Vector>(&self, image: &[BodyPair]) -> Batch<V> {
        let of = |bodies: [u32; LANES]| bodies.map(|body| &image[body as usize]);
        let (a, b) = (of(self.body_a), of(self.body_b));
        let difference = |l: usize| V::of(a[l][0]) - V::of(b[l][0]);
        let relative = V::components([difference(0), difference(1), difference(2), difference(3)]);
        let spins = |of: [&BodyPair; LANES]| V::components(of.map(|pair| V::of(pair[1])));
        let relative = add(&relative, &cross(&spins(a), &load(&self.arm_a)));
        let relative = sub(&relative, &cross(&spins(b), &load(&self.arm_b)));
        [
            dot(&load(&self.frame[0]), &relative),
            dot(&load(&self.frame[1]), &relative),
            dot(&load(&self.frame[2]), &relative),
        ]
    }

    /// x_1 n + x_2 t1 + x_3 t2, world axes.
    #[inline(always)]
    fn along_frame<V: Vector>(&self, x: &Batch<V>) -> Batch<V> {
        // No closures: they need not be compiled for the processor's vector instructions.
        let [n, t1, t2] = [&self.frame[0], &self.frame[1], &self.frame[2]];
        add(&add(&scale(x[0], &load(n)), &scale(x[1], &load(t1))), &scale(x[2], &load(t2)))
    }

    /// Impulses in world axes of these contacts and their moments about bodies A and B.
    #[inline(always)]
    fn world_impulses<V: Vector>(&self, x: &Batch<V>) -> WorldImpulses<V> {
        let p = self.along_frame(x);
        let (moment_a, moment_b) = (cross(&load(&self.arm_a), &p), cross(&load(&self.arm_b), &p));
        [V::records(&p), V::records(&moment_a), V::records(&moment_b)]
    }

    /// Turning velocities of these rows, w_A - w_B in their frames: for batches of turning rows.
    #[inline(always)]
    pub(super) fn relative_spin<V: Vector>(&self, image: &[BodyPair]) -> Batch<V> {
        let difference =
            |l: usize| V::of(image[self.body_a[l] as usize][1]) - V::of(image[self.body_b[l] as usize][1]);
        let relative = V::components([difference(0), difference(1), difference(2), difference(3)]);
        [
            dot(&load(&self.frame[0]), &relative),
            dot(&load(&self.frame[1]), &relative),
            dot(&load(&self.frame[2]), &relative),
        ]
    }

    /// Impulses of turning rows: no force, and one moment on both bodies.
    #[inline(always)]
    fn world_moments<V: Vector>(&self, x: &Batch<V>) -> WorldImpulses<V> {
        let moment = V::records(&self.along_frame(x));
        [[V::default(); LANES], moment, moment]
    }

    /// As [`Self::scatter`] of turning rows.
    #[inline(always)]
    pub(super) fn scatter_turning<V: Vector>(&self, x: &Batch<V>, slots: &mut [BodyPair]) {
        self.add_to_slots(&self.world_moments(x), slots);
    }

    /// Adds the impulses of these contacts and their moments to the slots of their chunk.
    #[inline(always)]
    pub(super) fn scatter<V: Vector>(&self, x: &Batch<V>, slots: &mut [BodyPair]) {
        self.add_to_slots(&self.world_impulses(x), slots);
    }

    #[inline(always)]
    fn add_to_slots<V: Vector>(&self, [p, moment_a, moment_b]: &WorldImpulses<V>, slots: &mut [BodyPair]) {
        for lane in 0..LANES {
            let [force, moment] = &mut slots[self.slot_a[lane] as usize];
            *force = (V::of(*force) + p[lane]).lanes();
            *moment = (V::of(*moment) + moment_a[lane]).lanes();
            let [force, moment] = &mut slots[self.slot_b[lane] as usize];
            *force = (V::of(*force) - p[lane]).lanes();
            *moment = (V::of(*moment) - moment_b[lane]).lanes();
        }
    }

    /// Adds M^-1 of the impulses of one contact to the velocities of its bodies.
    #[inline(always)]
    fn push<V: Vector>(
        &self,
        lane: usize,
        [p, moment_a, moment_b]: &WorldImpulses<V>,
        inverse_mass: &[InverseMass],
        image: &mut [BodyPair],
    ) {
        let (a, b) = (self.body_a[lane] as usize, self.body_b[lane] as usize);
        let [du, dw] = inverse_mass[a].times([p[lane], moment_a[lane]]);
        let [u, w] = &mut image[a];
        *u = (V::of(*u) + du).lanes();
        *w = (V::of(*w) + dw).lanes();
        let [du, dw] = inverse_mass[b].times([p[lane], moment_b[lane]]);
        let [u, w] = &mut image[b];
        *u = (V::of(*u) - du).lanes();
        *w = (V::of(*w) - dw).lanes();
    }
}

/// What a sweep of Gauss-Seidel does at four contacts.
pub(super) trait Update<V> {
    /// Changes the impulses of a batch, given its D^T v, where `moves` is 1, and returns the change.
    fn at(&mut self, batch: usize, velocity: &Batch<V>, moves: V) -> Batch<V>;

    /// As [`Self::at`] of a batch of contacts and the batch of their turning rows, which follows it.
    fn at_turning(&mut self, batch: usize, velocity: [Batch<V>; 2], moves: V) -> [Batch<V>; 2];
}

/// Inverse mass matrix of a body, each vector followed by a zero.
#[derive(Clone, Copy, Debug, Default)]
struct InverseMass {
    linear: Lanes,
    /// Columns of the inverse inertia.
    angular: [Lanes; 3],
}

impl InverseMass {
    fn new(inverse: &BodyInverseMass) -> Self {
        let (l, a) = (inverse.linear, inverse.angular);
        Self {
            linear: Lanes([l[0], l[1], l[2], 0.0]),
            angular: std::array::from_fn(|k| Lanes([a[k], a[3 + k], a[6 + k], 0.0])),
        }
    }

    /// Velocity and spin of a force and a moment.
    #[inline(always)]
    fn times<V: Vector>(&self, [force, moment]: BodyPair<V>) -> BodyPair<V> {
        let [x, y, z] = load::<V>(&self.angular);
        let spin = x * moment.broadcast::<0>() + y * moment.broadcast::<1>() + z * moment.broadcast::<2>();
        [V::of(self.linear) * force, spin]
    }
}

/// N = D^T M^-1 D with scaled D. A chunk of contacts sums the forces on its bodies in slots of its own, then
/// every body adds its slots in a fixed order: no two threads write to one place and the bits do not depend
/// on their number.
#[derive(Clone, Debug)]
pub(super) struct BodyOperator {
    geometry: Vec<Geometry>,
    /// Which batches hold the turning rows of the contacts of the batch before them; empty where nothing
    /// resists turning.
    turning: Vec<bool>,
    runs: Vec<Run>,
    /// In the order of the packing, like everything per body; that of the fixed body, zero, comes last.
    inverse_mass: Vec<InverseMass>,
    num_bodies: usize,
    /// Number of places of bodies and of images; that after the last one is the fixed body's.
    num_places: usize,
    slots: SlotTable,
    /// A stress-controlled periodic cell.
    cell: Option<Box<PackedCell>>,
    /// Bodies that joints couple: their inverse masses are zero here.
    mechanisms: Option<Box<PackedMechanisms<BodyPair>>>,
    /// Compliant contacts.
    compliance: PackedCompliance<Lanes>,
    /// N'_ii at the places of contacts with coupled bodies.
    coupled_blocks: HashMap<usize, Block>,
    /// What this rank does of a pass, where there are several.
    share: Option<Box<Share>>,
}

/// Batches whose contacts share no body if that can be arranged: a sweep of Gauss-Seidel computes them
/// together.
pub(super) const TOGETHER: usize = 4;
/// Consecutive batches of contacts (with their turning rows) that a sweep of Gauss-Seidel treats alike.
#[derive(Clone, Copy, Debug)]
struct Run {
    first: usize,
    count: usize,
    /// Whether their contacts share no body. Else it is one batch.
    apart: bool,
    /// Whether a body of theirs is one of a mechanism.
    coupled: bool,
}

/// Divides the batches of contacts into the longest runs of at most [`TOGETHER`] whose contacts share nothing
/// that moves; those of turning rows go with the batches before them.
fn runs(geometry: &[Geometry], turning: &[bool], packing: &Packing) -> Vec<Run> {
    let fixed = packing.num_places() as u32;
    let mut runs: Vec<Run> = Vec::new();
    // For every body the run, then the batch, that moved it last.
    let mut moved_by = vec![(usize::MAX, usize::MAX); fixed as usize];
    let is_of_contacts = |(batch, _): &(usize, &Geometry)| turning.get(*batch) != Some(&true);
    for (batch, g) in geometry.iter().enumerate().filter(is_of_contacts) {
        let (mut free, mut apart) = (true, true);
        let current = runs.len().wrapping_sub(1);
        for lane in 0..LANES {
            // A contact of a body with itself is nobody's neighbour.
            let [a, b] = [g.body_a[lane], g.body_b[lane]].map(|body| packing.mover(body));
            for body in if a == b { [a, fixed] } else { [a, b] } {
                let Some((run, by)) = moved_by.get_mut(body as usize) else { continue };
                free &= *run != current;
                apart &= *by != batch;
                *by = batch;
            }
        }
        match runs.last_mut() {
            Some(run) if run.apart && apart && free && run.count < TOGETHER => run.count += 1,
            _ => runs.push(Run { first: batch, count: 1, apart, coupled: false }),
        }
        let current = runs.len() - 1;
        for body in g.body_a.into_iter().chain(g.body_b).filter(|&body| body != fixed) {
            runs[current].coupled |= packing.is_coupled(body);
            moved_by[packing.mover(body) as usize].0 = current;
        }
    }
    runs
}

/// N'_ii at the places of rows of contacts with coupled bodies.
fn coupled_blocks(rigid: &RigidDelassus, packing: &Packing, scaling: &[[f64; 2]]) -> HashMap<usize, Block> {
    let is_coupled = |(_, i): &(usize, u32)| {
        let contact =
            (*i as usize).checked_sub(rigid.num_contacts()).map_or(*i, |k| rigid.turning()[k].contact);
        packing.places_of(rigid, contact).into_iter().any(|place| packing.is_coupled(place))
    };
    let scaled = |(place, i): (usize, u32)| {
        let mut block = rigid.block(i as usize, i as usize);
        let factors = &scaling[i as usize];
        for (entry, value) in block.iter_mut().enumerate() {
            *value *= factors[(entry / 3).min(1)] * factors[(entry % 3).min(1)];
        }
        (place, block)
    };
    if rigid.coupled().is_empty() {
        return HashMap::new();
    }
    let filled = packing.contacts.iter().copied().enumerate().filter(|&(_, i)| i != EMPTY);
    filled.filter(is_coupled).map(scaled).collect()
}

impl BodyOperator {
    /// Packs N; `scaling` has the factors of the normal and of the tangents per contact.
    pub(super) fn new(rigid: &RigidDelassus, packing: &Packing, scaling: &[[f64; 2]]) -> Self {
        let order = &packing.contacts;
        let (bodies, num_places) = (rigid.num_bodies(), packing.num_places());
        let fixed = num_places as u32;
        let batches = order.len().div_ceil(LANES);
        let empty = Geometry {
            frame: [ZERO; 3],
            arm_a: ZERO,
            arm_b: ZERO,
            body_a: [fixed; LANES],
            body_b: [fixed; LANES],
            slot_a: [0; LANES],
            slot_b: [0; LANES],
        };
        let mut geometry = vec![empty; batches];
        let behind = PackedCompliance::<Lanes>::per_chunk(rigid, CHUNK);
        let slots = SlotTable::new(rigid, packing, CHUNK * LANES, behind);
        for (place, &i) in order.iter().enumerate().filter(|&(_, &i)| i != EMPTY) {
            let turning = (i as usize).checked_sub(rigid.num_contacts()).map(|k| &rigid.turning()[k]);
            let index = turning.map_or(i, |rows| rows.contact);
            let contact = &rigid.contacts()[index as usize];
            let length = turning.map_or(1.0, |rows| rows.length);
            let g = &mut geometry[place / LANES];
            let lane = place % LANES;
            for row in 0..3 {
                for axis in 0..3 {
                    g.frame[row][axis].0[lane] =
                        scaling[i as usize][row.min(1)] * (length * contact.frame[row][axis]);
                }
            }
            for axis in 0..3 {
                g.arm_a[axis].0[lane] = contact.arm_a[axis];
                g.arm_b[axis].0[lane] = contact.arm_b[axis];
            }
            [g.body_a[lane], g.body_b[lane]] = packing.places_of(rigid, index);
            [g.slot_a[lane], g.slot_b[lane]] = slots.of_place(place);
        }
        let mut inverse_mass = vec![InverseMass::default(); num_places + 1];
        for (&place, inverse) in packing.bodies.iter().zip(rigid.inverse_mass()) {
            if !packing.is_coupled(place) {
                inverse_mass[place as usize] = InverseMass::new(inverse);
            }
        }
        let turning = turning_batches(order, rigid.num_contacts());
        let runs = runs(&geometry, &turning, packing);
        let cell = PackedCell::new(rigid, &packing.images, [1.0; 2]).map(Box::new);
        let first = num_places + 1 + usize::from(cell.is_some());
        let mechanisms = PackedMechanisms::new(rigid, packing, [1.0; 2], first).map(Box::new);
        let first = 2 * (first + mechanisms.as_ref().map_or(0, |mechanisms| mechanisms.len()));
        Self {
            geometry,
            turning,
            runs,
            inverse_mass,
            num_bodies: bodies,
            num_places,
            slots: slots.without_places(),
            cell,
            mechanisms,
            compliance: PackedCompliance::new(rigid, order, scaling, (first, CHUNK)),
            coupled_blocks: coupled_blocks(rigid, packing, scaling),
            share: None,
        }
    }

    /// The ranks that do the passes together; `None` does all of them here. Not where the cell is
    /// stress-controlled or contacts are compliant.
    pub(super) fn share_among(&mut self, ranks: Option<&Arc<Ranks>>) {
        let is_shared = self.cell.is_none() && self.compliance.len() == 0;
        let mechanisms = self.mechanisms.as_deref();
        let is_coupled = |place: u32| mechanisms.is_some_and(|mechanisms| mechanisms.has(place));
        self.share = self.slots.share(ranks.filter(|_| is_shared), BODIES, is_coupled);
    }

    /// What this rank does of a pass, where there are several.
    pub(super) fn share(&self) -> Option<&Share> {
        self.share.as_deref()
    }

    /// Vectors in an image: the [`BodyPair`] of every body, of the images, of the fixed one, of a cell's L,
    /// the q of mechanisms, and C x.
    pub(super) fn image_len(&self) -> usize {
        let mechanisms = self.mechanisms.as_ref().map_or(0, |mechanisms| mechanisms.len());
        let pairs = self.num_places + 1 + usize::from(self.cell.is_some()) + mechanisms;
        2 * pairs + self.compliance.len().next_multiple_of(2)
    }

    /// Compliant contacts.
    pub(super) fn compliance(&self) -> &PackedCompliance<Lanes> {
        &self.compliance
    }

    /// Number of slots of all chunks.
    pub(super) fn num_slots(&self) -> usize {
        self.slots.len()
    }

    /// Room for what mechanisms make in a pass.
    pub(super) fn room(&self) -> Vec<BodyPair> {
        self.mechanisms.as_ref().map_or_else(Vec::new, |mechanisms| mechanisms.room())
    }

    /// Slots of a range of chunks.
    pub(super) fn slot_range(&self, chunks: Range<usize>) -> Range<usize> {
        self.slots.of_chunks(chunks)
    }

    /// Bytes of one pass: the geometry, and half of what goes through slots, inverse masses and velocities.
    pub(super) fn pass_bytes(&self) -> usize {
        size_of_val(&self.geometry[..])
            + (2 * size_of::<BodyPair>() * self.num_slots()
                + (size_of::<InverseMass>() + 2 * size_of::<BodyPair>()) * self.num_bodies)
                / 2
    }

    /// The geometry of the batches.
    pub(super) fn geometry(&self) -> &[Geometry] {
        &self.geometry
    }

    /// Combines M^-1 (sums of the slots of each body) with images; returns the quadratic form, force dot
    /// velocity.
    pub(super) fn velocities<const K: usize>(
        &self,
        (slots, room): (&[BodyPair], &mut [BodyPair]),
        images: [&mut [Lanes]; K],
        tallies: &mut [Tally],
        buffers: &mut Buffers,
        combination: &impl Combination<K>,
    ) -> f64 {
        let mut all = images.map(|image| image.as_chunks_mut::<2>().0);
        let images = all.each_mut().map(|image| &mut image[..self.num_bodies]);
        let work = |first: usize, images: [&mut [BodyPair]; K], tally: &mut Tally| {
            vectorised(BodyTask { operator: self, first, slots, images, tally, combination });
        };
        let mut sum = over_bodies(self.share(), images, tallies, buffers, &work);
        if let Some(mechanisms) = &self.mechanisms {
            let all = all.each_mut().map(|image| &mut **image);
            sum += mechanisms.follow((slots, &self.slots), room, all, combination);
        }
        let flat = all.each_mut().map(|image| image.as_flattened_mut());
        sum += self.compliance.follow((slots.as_flattened(), &self.slots), flat, tallies, combination);
        match &self.cell {
            Some(cell) => sum + cell.follow((slots, &self.slots), all, combination),
            None => sum,
        }
    }

    /// Makes the velocities of coupled bodies of some contacts what those of their mechanisms are.
    #[inline(always)]
    fn bring<V: Vector>(&self, geometry: &Geometry, lanes: Range<usize>, image: &mut [BodyPair]) {
        if let Some(mechanisms) = &self.mechanisms {
            mechanisms.bring::<BodyPair<V>>(&geometry.body_a[lanes.clone()], image);
            mechanisms.bring::<BodyPair<V>>(&geometry.body_b[lanes], image);
        }
    }

    /// Lets the bodies of one contact, of which some may be coupled, follow its impulses.
    #[inline(always)]
    fn push<V: Vector>(
        &self,
        (geometry, coupled): (&Geometry, bool),
        lane: usize,
        world: &WorldImpulses<V>,
        image: &mut [BodyPair],
    ) {
        geometry.push(lane, world, &self.inverse_mass, image);
        if let Some(mechanisms) = self.mechanisms.as_ref().filter(|_| coupled) {
            let [p, moment_a, moment_b] = world.map(|of| of[lane]);
            let [on_a, on_b] = [[p, moment_a], [-p, -moment_b]].map(Register::store);
            mechanisms.push::<BodyPair<V>>(geometry.body_a[lane], on_a, image);
            mechanisms.push::<BodyPair<V>>(geometry.body_b[lane], on_b, image);
        }
    }

    /// Gauss-Seidel over all contacts: `contacts` get the velocities D^T v of a batch and change its
    /// impulses; the velocities of the bodies follow at once, of coupled ones when they are looked at.
    /// Batches of a [`Run`] that share nothing that moves are computed side by side, others contact by
    /// contact: the result is that of one contact after the other in the order of the packing. Not for a
    /// stress-controlled cell, which one contact would move for all.
    #[inline(always)]
    pub(super) fn sweep<V: Vector>(&self, image: &mut [Lanes], contacts: &mut impl Update<V>) {
        assert!(self.cell.is_none(), "sweeps over a cell go through the rows of N");
        let image = image.as_chunks_mut::<2>().0;
        if self.turning.is_empty() {
            self.sweep_runs::<V, false>(image, contacts);
        } else {
            self.sweep_runs::<V, true>(image, contacts);
        }
        if let Some(mechanisms) = &self.mechanisms {
            mechanisms.bring_all::<BodyPair<V>>(image);
        }
    }

    /// The same; `TURNING`: some batches have turning rows.
    #[inline(always)]
    fn sweep_runs<V: Vector, const TURNING: bool>(
        &self,
        image: &mut [BodyPair],
        contacts: &mut impl Update<V>,
    ) {
        let turns = |batch: usize| TURNING && self.turning.get(batch + 1) == Some(&true);
        for run in &self.runs {
            if !run.apart {
                self.sweep_one_by_one::<V>((run, turns(run.first)), image, contacts);
                continue;
            }
            let mut batches = [run.first; TOGETHER];
            for k in 1..run.count {
                batches[k] = batches[k - 1] + 1 + usize::from(turns(batches[k - 1]));
            }
            let batches = &batches[..run.count];
            for &batch in batches.iter().filter(|_| run.coupled) {
                self.bring::<V>(&self.geometry[batch], 0..LANES, image);
            }
            // Short loops, as in a pass.
            let (mut u, mut w) = ([zero::<V>(); TOGETHER], [zero::<V>(); TOGETHER]);
            for ((&batch, u), w) in batches.iter().zip(&mut u).zip(&mut w) {
                *u = self.geometry[batch].relative_velocity(image);
                if turns(batch) {
                    *w = self.geometry[batch + 1].relative_spin(image);
                }
            }
            for ((&batch, u), w) in batches.iter().zip(&mut u).zip(&mut w) {
                if turns(batch) {
                    [*u, *w] = contacts.at_turning(batch, [*u, *w], V::splat(1.0));
                } else {
                    *u = contacts.at(batch, u, V::splat(1.0));
                }
            }
            for ((&batch, u), w) in batches.iter().zip(&u).zip(&w) {
                let world = self.geometry[batch].world_impulses(u);
                for lane in 0..LANES {
                    self.push((&self.geometry[batch], run.coupled), lane, &world, image);
                }
                if turns(batch) {
                    let moments = self.geometry[batch + 1].world_moments(w);
                    for lane in 0..LANES {
                        self.push((&self.geometry[batch + 1], run.coupled), lane, &moments, image);
                    }
                }
            }
        }
    }

    /// The same at a batch, contact after contact.
    #[inline(always)]
    fn sweep_one_by_one<V: Vector>(
        &self,
        (run, turns): (&Run, bool),
        image: &mut [BodyPair],
        contacts: &mut impl Update<V>,
    ) {
        let geometry = &self.geometry[run.first];
        for lane in 0..LANES {
            if run.coupled {
                self.bring::<V>(geometry, lane..lane + 1, image);
            }
            let u = geometry.relative_velocity(image);
            let mut moves = Lanes::default();
            moves.0[lane] = 1.0;
            if turns {
                let turning = &self.geometry[run.first + 1];
                let velocity = [u, turning.relative_spin(image)];
                let [change, turn] = contacts.at_turning(run.first, velocity, V::of(moves));
                self.push((geometry, run.coupled), lane, &geometry.world_impulses(&change), image);
                self.push((turning, run.coupled), lane, &turning.world_moments(&turn), image);
            } else {
                let change = contacts.at(run.first, &u, V::of(moves));
                self.push((geometry, run.coupled), lane, &geometry.world_impulses(&change), image);
            }
        }
    }

    /// Block N_ii of one contact, rows scaled as the frame is.
    pub(super) fn diagonal_block(&self, batch: usize, lane: usize) -> Block {
        if let Some(block) = self.coupled_blocks.get(&(LANES * batch + lane)) {
            return *block;
        }
        let g = &self.geometry[batch];
        let turns = self.turning.get(batch) == Some(&true);
        let of_lane = |v: &Batch| [v[0].0[lane], v[1].0[lane], v[2].0[lane]];
        let frame = [of_lane(&g.frame[0]), of_lane(&g.frame[1]), of_lane(&g.frame[2])];
        let (arm_a, arm_b) = (of_lane(&g.arm_a), of_lane(&g.arm_b));
        let dot3 = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let mut block = [0.0; 9];
        let mut add_side = |body: u32, linear: f64, arm: [f64; 3]| {
            let InverseMass { linear: inverse, angular } = &self.inverse_mass[body as usize];
            let lever = frame.map(|f| {
                if turns {
                    return f;
                }
                [arm[1] * f[2] - arm[2] * f[1], arm[2] * f[0] - arm[0] * f[2], arm[0] * f[1] - arm[1] * f[0]]
            });
            for column in 0..3 {
                let f = frame[column];
                let v = std::array::from_fn(|k| linear * inverse.0[k] * f[k]);
                let [x, y, z] = lever[column];
                let w =
                    std::array::from_fn(|k| angular[0].0[k] * x + angular[1].0[k] * y + angular[2].0[k] * z);
                for row in 0..3 {
                    block[3 * row + column] += dot3(frame[row], v) + dot3(lever[row], w);
                }
            }
        };
        let (a, b) = (g.body_a[lane], g.body_b[lane]);
        if turns {
            if a != b {
                add_side(a, 0.0, arm_a);
                add_side(b, 0.0, arm_b);
            }
        } else if a == b {
            add_side(a, 0.0, std::array::from_fn(|k| arm_a[k] - arm_b[k]));
        } else {
            add_side(a, 1.0, arm_a);
            add_side(b, 1.0, arm_b);
        }
        if let Some(compliance) = self.compliance.of(0..self.compliance.len()).get(batch) {
            block[0] += compliance.0[lane];
        }
        block
    }

    /// Number of parallel tasks of [`Self::velocities`].
    pub(super) fn num_body_tasks(&self) -> usize {
        num_body_tasks(self.num_bodies)
    }
}

/// Velocities of some bodies from the slots.
struct BodyTask<'a, const K: usize, C> {
    operator: &'a BodyOperator,
    first: usize,
    slots: &'a [BodyPair],
    images: [&'a mut [BodyPair]; K],
    tally: &'a mut Tally,
    combination: &'a C,
}

impl<const K: usize, C: Combination<K>> TaskWork for BodyTask<'_, K, C> {
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { operator, first, slots, mut images, tally, combination } = self;
        let mut quadratic = V::default();
        let mechanisms = operator.mechanisms.as_deref();
        for offset in 0..images[0].len() {
            let body = first + offset;
            if mechanisms.is_some_and(|mechanisms| mechanisms.has(body as u32)) {
                continue;
            }
            let (mut force, mut moment) = (V::default(), V::default());
            for &slot in operator.slots.of_body(body) {
                let [f, m] = slots[slot as usize];
                force += V::of(f);
                moment += V::of(m);
            }
            let [u, w] = operator.inverse_mass[body].times([force, moment]);
            quadratic += force * u + moment * w;
            for (k, fresh) in [u, w].into_iter().enumerate() {
                // Loops, because closures need not be compiled for the processor's vector instructions.
                let mut known = [V::default(); K];
                for (known, image) in known.iter_mut().zip(&images) {
                    *known = V::of(image[offset][k]);
                }
                for (image, new) in images.iter_mut().zip(combination.of(fresh, known)) {
                    image[offset][k] = new.lanes();
                }
            }
        }
        tally.sum[0] = quadratic.lanes();
    }
}
