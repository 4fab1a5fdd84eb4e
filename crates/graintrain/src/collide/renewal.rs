//! A search made again where few bodies are otherwise than in the last one: the contacts of all other pairs
//! are those that it found.
//!
//! A pair's contacts depend on nothing but the pair, the search and the mean velocity by which bodies are
//! sorted ([`Sorted::mean`], which is rounded so that it seldom changes): what is found is, bit by bit and in
//! order, what a whole search would find.

use super::broad::{Collider, Found, TASK, bodies_of};
use super::candidates::{Others, Pairs, Sorted};
use super::search::Search;
use crate::cell::Cell;
use crate::contact::Contact;
use crate::math::Vec3;
use crate::world::World;
use parry3d_f64::bounding_volume::Aabb;
use rayon::prelude::*;

/// Where more than one of so many bodies is otherwise, everything is looked at anew.
const FEW: usize = 4;

/// A search, and what it found.
pub(super) struct Known {
    search: Search,
    mean: Vec3,
    cell: Option<Cell>,
    states: Vec<State>,
    contacts: Vec<Contact>,
}

/// Bits of position, orientation, velocity and spin of a body.
type State = [u64; 13];

fn state(world: &World, body: usize) -> State {
    let bodies = &world.bodies;
    let [p, u, w] = [bodies.position[body], bodies.velocity[body], bodies.angular_velocity[body]];
    let q = bodies.orientation[body];
    [p.x, p.y, p.z, u.x, u.y, u.z, w.x, w.y, w.z, q.x, q.y, q.z, q.w].map(f64::to_bits)
}

impl Known {
    pub(super) fn new(world: &World, sorted: &Sorted, search: Search, contacts: &[Contact]) -> Self {
        let states =
            (0..world.bodies.len()).into_par_iter().with_min_len(TASK).map(|body| state(world, body));
        Self {
            search,
            mean: sorted.mean,
            cell: world.cell().cloned(),
            states: states.collect(),
            contacts: contacts.to_vec(),
        }
    }

    /// Which bodies are otherwise now, if those are few and what else counts is as it was.
    fn changed(&self, world: &World, sorted: &Sorted, search: Search) -> Option<Vec<bool>> {
        let bodies = world.bodies.len();
        let is_same = self.states.len() == bodies
            && self.search == search
            && self.mean == sorted.mean
            && self.cell.as_ref() == world.cell();
        if !is_same {
            return None;
        }
        let states = self.states.par_iter().with_min_len(TASK).enumerate();
        let changed: Vec<bool> = states.map(|(body, before)| state(world, body) != *before).collect();
        let few = FEW * changed.iter().filter(|&&changed| changed).count() <= bodies;
        few.then_some(changed)
    }

    /// The contacts that were found for a body as A.
    fn of(&self, body: usize) -> &[Contact] {
        let first = self.contacts.partition_point(|c| (c.body_a as usize) < body);
        let count = self.contacts[first..].partition_point(|c| c.body_a as usize == body);
        &self.contacts[first..first + count]
    }
}

impl Collider {
    /// What the search finds now, made from what it found before, if few bodies are otherwise since then.
    pub(super) fn found_again(
        &self,
        world: &World,
        sorted: &Sorted,
        search: Search,
        known: &Known,
    ) -> Option<Vec<Contact>> {
        let changed = known.changed(world, sorted, search)?;
        let moved: Vec<u32> = (0..).zip(&changed).filter(|(_, changed)| **changed).map(|(k, _)| k).collect();
        if moved.is_empty() {
            return Some(known.contacts.clone());
        }
        let beside =
            moved.par_chunks(TASK).map(|own| self.pairs_beside(world, sorted, own, &changed, search));
        let pairs = Pairs::new(world.bodies.len(), &beside.collect::<Vec<_>>());
        let others = sorted.others.only(|body| changed[body as usize]);
        let of_task = |task: usize| {
            let mut found = Found::default();
            let mut all = Vec::new();
            for body in bodies_of(world, task).take_while(|_| !self.is_stopped()) {
                found.contacts.clear();
                let others = if changed[body] { &sorted.others } else { &others };
                self.contacts_of(world, (sorted, &pairs, others), body, search, &mut found);
                let stays = |c: &&Contact| !changed[body] && !changed[c.body_b as usize];
                let kept = known.of(body).iter().filter(stays);
                merge(kept, &found.contacts, |c| (!sorted.are_in_grid(c), c.body_b), &mut all);
            }
            all
        };
        let tasks: Vec<Vec<Contact>> =
            (0..world.bodies.len().div_ceil(TASK)).into_par_iter().map(of_task).collect();
        Some(tasks.concat())
    }

    /// The pairs of the grid that these bodies form, lower index first, those of two that `changed` once.
    fn pairs_beside(
        &self,
        world: &World,
        sorted: &Sorted,
        bodies: &[u32],
        changed: &[bool],
        search: Search,
    ) -> Vec<[u32; 2]> {
        let Sorted { grid, largest, .. } = sorted;
        let mut pairs = Vec::new();
        for &me in bodies.iter().filter(|&&body| sorted.in_grid[body as usize]) {
            let body = me as usize;
            let (centre, radius) = (world.bodies.position[body], self.form(world, body).bounding_radius);
            // Bodies of the grid travel by their own size at most.
            let farthest = radius + 3.0 * largest + search.margin();
            grid.around(centre, farthest * (1.0 + 1e-9), |range| {
                for slot in range {
                    let other = grid.body[slot];
                    let reach = radius + grid.radius[slot] + search.margin() + sorted.approach([me, other]);
                    let is_near = (centre - grid.centre[slot]).length_squared() <= reach * reach;
                    if other != me && is_near && (!changed[other as usize] || me < other) {
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
    use super::*;
    use crate::handle::MaterialId;
    use crate::material::Materials;
    use crate::math::rotation_exponential;
    use crate::motion::Motion;
    use crate::shape::Geometry;
    use crate::world::Body;
    use proptest::prelude::*;

    type Given = (usize, [f64; 3], [f64; 3], [f64; 3], u32);

    fn body() -> impl Strategy<Value = Given> {
        let vector = |far: f64| prop::array::uniform3(-far..far);
        (0..6_usize, vector(1.0), vector(2.0), vector(30.0), 0..4_u32)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        /// Spheres of two sizes, capsules, boxes, planes and a mesh, slow and fast, of which a few are then
        /// elsewhere or faster; in a periodic cell without planes.
        #[test]
        fn what_is_found_again_is_what_a_whole_search_finds(
            bodies in prop::collection::vec(body(), 8..60),
            changes in prop::collection::vec((any::<prop::sample::Index>(), body(), any::<bool>()), 0..6),
            is_cell in any::<bool>(),
        ) {
            let step = 0.01;
            let materials = Materials::single("stuff", 1.0, 0.0, 0.0).unwrap();
            let mut world = World::new(Vec3::new(0.0, 0.0, -10.0), materials).unwrap();
            let fixed = world.add_motion(Motion::fixed()).unwrap();
            let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
            let forms = [
                Geometry::sphere(0.1).unwrap(),
                Geometry::sphere(0.14).unwrap(),
                Geometry::capsule(0.1, 0.05).unwrap(),
                Geometry::cuboid(Vec3::new(0.6, 0.5, 0.1)).unwrap(),
                Geometry::plane(),
                Geometry::mesh(corners, vec![[0, 1, 2]]).unwrap(),
            ]
            .map(|form| world.add_geometry(form));
            if is_cell {
                let mut cell = Cell::new(Vec3::splat(-2.0), Vec3::splat(4.0), [true; 3]).unwrap();
                cell.tilt[0] = 0.3;
                world.set_cell(Some(cell)).unwrap();
            }
            for (kind, position, turn, velocity, slowness) in bodies {
                let kind = if is_cell { kind % 4 } else { kind };
                let motion = if kind < 4 { crate::world::FREE } else { fixed };
                let velocity = if kind < 4 { Vec3::from_array(velocity) * 0.05_f64.powi(slowness as i32) } else { Vec3::ZERO };
                let orientation = rotation_exponential(Vec3::from_array(turn));
                let body = Body::new(forms[kind], MaterialId::default(), Vec3::from_array(position));
                world.add_body(Body { motion, orientation, velocity, ..body }).unwrap();
            }
            let mut collider = Collider::default();
            collider.contacts(&world, 0.01, step);
            collider.meetings(&world, step);
            for (which, (_, position, turn, velocity, slowness), is_moved) in changes {
                let body = which.index(world.bodies.len());
                if is_moved {
                    world.bodies.position[body] = Vec3::from_array(position);
                    world.bodies.orientation[body] = rotation_exponential(Vec3::from_array(turn));
                } else if !world.is_prescribed(body) {
                    world.bodies.velocity[body] = Vec3::from_array(velocity) * 0.05_f64.powi(slowness as i32);
                }
            }
            let found = [collider.contacts_again(&world, 0.01, step), collider.meetings(&world, step)];
            let mut fresh = Collider::default();
            prop_assert_eq!(&found[0], &fresh.contacts(&world, 0.01, step));
            prop_assert_eq!(&found[1], &fresh.meetings(&world, step));
        }
    }
}
