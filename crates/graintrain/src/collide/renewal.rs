//! The search for contacts around some of the bodies: where only those were moved since the last one and
//! nothing else is otherwise, the contacts of all other pairs are those that it found.
//!
//! A pair's contacts depend on nothing but its bodies, the search and the mean velocity by which bodies are
//! sorted: what is found is, bit by bit and in order, what a whole search would find.

use super::broad::{Collider, Found, TASK, bodies_of};
use super::candidates::{Others, Pairs, Sorted};
use super::search::Search;
use crate::contact::Contact;
use crate::world::World;
use parry3d_f64::bounding_volume::Aabb;
use rayon::prelude::*;

impl Collider {
    /// [`Collider::contacts`] of a world in which those bodies that `moved` have another place, orientation
    /// or spin than when it found `known`, and nothing else is otherwise. Cost: that of their surroundings
    /// and of sorting the bodies; in a periodic cell, in which velocities depend on places, that of a whole
    /// search.
    pub(crate) fn contacts_again(
        &mut self,
        world: &World,
        (known, moved): (&[Contact], &[bool]),
        envelope: f64,
        step: f64,
    ) -> Vec<Contact> {
        if world.cell().is_some() {
            return self.contacts(world, envelope, step);
        }
        let search = Search::all(world, envelope, step);
        self.search_beside(world, moved, search, |sorted, body, found, all| {
            let stays = |c: &&Contact| !moved[body] && !moved[c.body_b as usize];
            let kept = contacts_of_body(known, body).iter().filter(stays);
            merge(kept, found, |c| (!sorted.are_in_grid(c), c.body_b), all);
        })
    }

    /// Of the contacts of these bodies, without an envelope, at least all those that close by the end of the
    /// step at the present velocities: two balls that move by less than their gap relative to each other,
    /// most of a pile, are left out before anything else is found out about them.
    pub(crate) fn meetings_of(&mut self, world: &World, of: &[bool], step: f64) -> Vec<Contact> {
        // The rates of a cell whose stress is imposed may still change.
        let meeting = world.cell().is_none();
        let search = Search { meeting, ..Search::all(world, 0.0, step) };
        self.search_beside(world, of, search, |_, _, found, all| all.extend(found))
    }

    /// The contacts of these bodies that overlap where they are now. What is near them is looked at as far as
    /// bodies fall in a step: of flat faces corners that are just apart belong to what overlaps.
    pub(crate) fn overlaps_of(&mut self, world: &World, of: &[bool], step: f64) -> Vec<Contact> {
        let search = Search { step: 0.0, ..Search::all(world, 0.0, step) };
        self.search_beside(world, of, search, |_, _, found, all| all.extend(found))
    }

    /// The contacts of which one of these bodies is one: for each body those of which it is A, put among
    /// `all`.
    fn search_beside(
        &mut self,
        world: &World,
        of: &[bool],
        search: Search,
        put: impl Fn(&Sorted, usize, &[Contact], &mut Vec<Contact>) + Sync,
    ) -> Vec<Contact> {
        self.update_forms(world);
        let sorted = &self.sort(world, search);
        let bodies: Vec<u32> = (0..).zip(of).filter(|(_, of)| **of).map(|(k, _)| k).collect();
        let beside = bodies.par_chunks(TASK).map(|own| self.pairs_beside(world, sorted, own, of, search));
        let pairs = Pairs::new(world.bodies.len(), &beside.collect::<Vec<_>>());
        let others = sorted.others.only(|body| of[body as usize]);
        let of_task = |task: usize| {
            let mut found = Found::default();
            let mut all = Vec::new();
            for body in bodies_of(world, task).take_while(|_| !self.is_stopped()) {
                found.contacts.clear();
                let others = if of[body] { &sorted.others } else { &others };
                self.contacts_of(world, (sorted, &pairs, others), body, search, &mut found);
                put(sorted, body, &found.contacts, &mut all);
            }
            all
        };
        let tasks = (0..world.bodies.len().div_ceil(TASK)).into_par_iter().map(of_task);
        tasks.collect::<Vec<Vec<Contact>>>().concat()
    }

    /// The pairs of the grid that these bodies form, lower index first, those of two of them once.
    fn pairs_beside(
        &self,
        world: &World,
        sorted: &Sorted,
        bodies: &[u32],
        of: &[bool],
        search: Search,
    ) -> Vec<[u32; 2]> {
        let grid = &sorted.grid;
        let mut pairs = Vec::new();
        for &me in bodies.iter().filter(|&&body| sorted.in_grid[body as usize]) {
            let body = me as usize;
            let (centre, radius) = (world.bodies.position[body], self.form(world, body).bounding_radius);
            grid.around(centre, sorted.farthest(body, radius, search.margin()), |range| {
                for slot in range {
                    let other = grid.body[slot];
                    let reach = radius + grid.radius[slot] + search.margin() + sorted.approach([me, other]);
                    let is_near = (centre - grid.centre[slot]).length_squared() <= reach * reach;
                    if other != me && is_near && (!of[other as usize] || me < other) {
                        pairs.push([me.min(other), me.max(other)]);
                    }
                }
            });
        }
        pairs
    }
}

impl Others {
    /// Of these, only some.
    fn only(&self, some: impl Fn(u32) -> bool) -> Self {
        let own = self.large.iter().zip(&self.bounds).filter(|(body, _)| some(**body));
        let (large, bounds): (Vec<u32>, Vec<Aabb>) = own.unzip();
        let unbounded = self.unbounded.iter().filter(|other| some(other.body)).cloned().collect();
        Self::new(large, bounds, unbounded)
    }
}

/// Those of the contacts of which this body is A.
fn contacts_of_body(contacts: &[Contact], body: usize) -> &[Contact] {
    let first = contacts.partition_point(|c| (c.body_a as usize) < body);
    let count = contacts[first..].partition_point(|c| c.body_a as usize == body);
    &contacts[first..first + count]
}

/// Appends two ascending lists as one.
fn merge<'a, K: Ord>(
    kept: impl Iterator<Item = &'a Contact>,
    new: &[Contact],
    key: impl Fn(&Contact) -> K,
    all: &mut Vec<Contact>,
) {
    let mut new = new.iter().peekable();
    for contact in kept {
        while let Some(earlier) = new.next_if(|c| key(c) < key(contact)) {
            all.push(*earlier);
        }
        all.push(*contact);
    }
    all.extend(new);
}

#[cfg(test)]
mod tests {
    use super::super::broad::tests::add_forms;
    use super::*;
    use crate::handle::MaterialId;
    use crate::material::Materials;
    use crate::math::{Vec3, rotation_exponential};
    use crate::motion::Motion;
    use crate::world::Body;
    use proptest::prelude::*;

    type Given = (usize, [f64; 3], [f64; 3], [f64; 3], u32);

    fn vector(far: f64) -> impl Strategy<Value = [f64; 3]> {
        prop::array::uniform3(-far..far)
    }

    fn body() -> impl Strategy<Value = Given> {
        (0..6_usize, vector(1.0), vector(2.0), vector(30.0), 0..4_u32)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        /// Spheres of two sizes, capsules, boxes, planes and a mesh, slow and fast, of which a few are then
        /// elsewhere.
        #[test]
        fn what_is_found_again_is_what_a_whole_search_finds(
            bodies in prop::collection::vec(body(), 8..60),
            moves in prop::collection::vec((any::<prop::sample::Index>(), vector(1.0), vector(2.0)), 0..20),
        ) {
            let step = 0.01;
            let materials = Materials::single("stuff", 1.0, 0.0, 0.0).unwrap();
            let mut world = World::new(Vec3::new(0.0, 0.0, -10.0), materials).unwrap();
            let fixed = world.add_motion(Motion::fixed()).unwrap();
            let forms = add_forms(&mut world);
            for (kind, position, turn, velocity, slowness) in bodies {
                let motion = if kind < 4 { crate::world::FREE } else { fixed };
                let velocity = if kind < 4 { Vec3::from_array(velocity) * 0.05_f64.powi(slowness as i32) } else { Vec3::ZERO };
                let orientation = rotation_exponential(Vec3::from_array(turn));
                let body = Body::new(forms[kind], MaterialId::default(), Vec3::from_array(position));
                world.add_body(Body { motion, orientation, velocity, ..body }).unwrap();
            }
            let mut collider = Collider::default();
            let known = collider.contacts(&world, 0.01, step);
            let mut moved = vec![false; world.bodies.len()];
            for (which, position, turn) in moves {
                let body = which.index(world.bodies.len());
                world.bodies.position[body] = Vec3::from_array(position);
                world.bodies.orientation[body] = rotation_exponential(Vec3::from_array(turn));
                moved[body] = true;
            }
            let found = collider.contacts_again(&world, (&known, &moved), 0.01, step);
            prop_assert_eq!(found, Collider::default().contacts(&world, 0.01, step));
        }
    }
}
