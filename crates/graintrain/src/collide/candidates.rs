//! Candidate pairs: bodies by how their neighbours are found, in a cell list, in a tree, or beside planes.

use super::broad::{Collider, TASK, USUAL};
use super::grid::Grid;
use super::mesh::turned_bounds;
use super::narrow::Placed;
use super::search::Search;
use crate::contact::Contact;
use crate::math::{Mat3, Vec3};
use crate::shape::{Part, Shape};
use crate::world::World;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use rayon::prelude::*;
use std::ops::Range;

/// Bodies up to this multiple of the median bounding radius go into the cell list.
const SIMILAR: f64 = 2.5;

/// Bodies by how their neighbours are found.
pub(super) struct Sorted {
    pub(super) grid: Grid,
    /// [`Travel::approach_to_slower`] in the order of the grid, m.
    approach_of_slot: Vec<f64>,
    /// How far the surface of each body may travel within the step, m: at rest, and in the frame that moves
    /// with the mean velocity.
    pub(super) travel: Vec<Travel>,
    /// The largest [`Travel::relative`] of bodies in the grid, m.
    fastest: f64,
    /// Whether the world is a periodic cell, whose deformation moves distant bodies relative to each other.
    deforms: bool,
    /// Which bodies are in the grid.
    pub(super) in_grid: Vec<bool>,
    /// Bounding radius of the largest body in the grid, m: how far the travel of a body is looked ahead in
    /// case that the other one comes to rest.
    pub(super) largest: f64,
    /// Bodies that are not in the grid.
    pub(super) others: Others,
    /// Pairs that do not collide, lower index first, ascending.
    ignored: Vec<[u32; 2]>,
}

/// Bodies that are not in the grid.
pub(super) struct Others {
    /// Finite bodies too large or too fast for it, ascending but for images, with their bounds and the tree
    /// over those.
    pub(super) large: Vec<u32>,
    pub(super) bounds: Vec<Aabb>,
    pub(super) tree: Bvh,
    /// Bodies with a plane, ascending.
    pub(super) unbounded: Vec<Unbounded>,
}

impl Others {
    pub(super) fn new(large: Vec<u32>, bounds: Vec<Aabb>, unbounded: Vec<Unbounded>) -> Self {
        let tree = Bvh::from_leaves(BvhBuildStrategy::default(), &bounds);
        Self { large, bounds, tree, unbounded }
    }
}

/// How far the surface of a body may travel within the step, m.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Travel {
    /// step (|u| + |w| R).
    pub(super) own: f64,
    /// step (|u - mean u| + |w| R): two bodies come nearer to each other by at most the sum of theirs.
    pub(super) relative: f64,
    /// step u, m.
    way: Vec3,
    /// step |w| R, m.
    spin: f64,
}

impl Travel {
    /// How much nearer the body may come, within the step, to one for which this is no more, m: see
    /// [`Sorted::approach`].
    fn approach_to_slower(self, largest: f64) -> f64 {
        (2.0 * self.relative).max(self.own.min(largest))
    }
}

impl Sorted {
    /// Whether the bodies of a contact are both in the grid.
    pub(super) fn are_in_grid(&self, contact: &Contact) -> bool {
        [contact.body_a, contact.body_b].iter().all(|&body| self.in_grid[body as usize])
    }

    /// Whether two bodies do not collide.
    pub(super) fn is_ignored(&self, [a, b]: [u32; 2]) -> bool {
        !self.ignored.is_empty() && self.ignored.binary_search(&[a.min(b), a.max(b)]).is_ok()
    }

    /// How near another body of the grid has to be for the two to come within `margin` in the step, m.
    pub(super) fn farthest(&self, body: usize, radius: f64, margin: f64) -> f64 {
        let approach = (self.travel[body].relative + self.fastest).max(self.largest);
        (radius + self.largest + margin + approach) * (1.0 + 1e-9)
    }

    /// How much nearer the two bodies may come within the step, m.
    pub(super) fn approach(&self, pair: [u32; 2]) -> f64 {
        self.relative(pair).max(self.approach_at_rest(pair, false))
    }

    /// A bound of how far the surfaces of two bodies move relative to each other within the step, m.
    fn relative(&self, pair: [u32; 2]) -> f64 {
        let [a, b] = pair.map(|body| self.travel[body as usize]);
        // A few parts in 1e16 for what rounds.
        ((a.way - b.way).length() + a.spin + b.spin) * (1.0 + 1e-12)
    }

    /// How much nearer they may come if one of them came to rest, unless one is held; beyond the size of the
    /// largest body that does not count, m.
    pub(super) fn approach_at_rest(&self, pair: [u32; 2], is_held: bool) -> f64 {
        let [a, b] = pair.map(|body| self.travel[body as usize]);
        let one = a.own.max(b.own);
        let approach = if is_held { one.max(self.relative(pair)) } else { one };
        approach.min(self.largest)
    }

    /// Whether the two bodies may move by more than `far`, m, relative to each other within the step: `false`
    /// where bounds that are at hand say so, for most pairs.
    pub(super) fn may_travel(&self, pair: [u32; 2], far: f64) -> bool {
        // The bound knows of the deformation of a cell only along the radii.
        self.deforms || self.relative(pair) > far
    }
}

/// Pairs by their first bodies.
pub(super) struct Pairs {
    /// The second bodies of the pairs that body A begins are `second[start[A]..start[A + 1]]`.
    start: Vec<usize>,
    second: Vec<u32>,
}

impl Pairs {
    /// Of so many bodies.
    pub(super) fn new(bodies: usize, pairs: &[Vec<[u32; 2]>]) -> Self {
        let mut start = vec![0; bodies + 1];
        let all = || pairs.iter().flatten();
        for [a, _] in all() {
            start[*a as usize + 1] += 1;
        }
        for body in 0..bodies {
            start[body + 1] += start[body];
        }
        let (mut next, mut second) = (start.clone(), vec![0; start[bodies]]);
        for [a, b] in all() {
            let place = &mut next[*a as usize];
            second[*place] = *b;
            *place += 1;
        }
        Self { start, second }
    }

    /// The second bodies of pairs that this body begins, in no order.
    pub(super) fn of(&self, body: usize) -> &[u32] {
        &self.second[self.start[body]..self.start[body + 1]]
    }
}

/// A body with a plane.
#[derive(Clone)]
pub(super) struct Unbounded {
    pub(super) body: u32,
    /// Its origin, m.
    origin: Vec3,
    /// Its parts, where it is nothing but half-spaces (a floor, a box of walls): most bodies are seen to be
    /// far from all of them without looking at their shapes.
    half_spaces: Option<Vec<HalfSpace>>,
}

/// What lies behind a plane.
#[derive(Clone)]
pub(super) struct HalfSpace {
    /// Outward unit normal.
    normal: Vec3,
    /// A point of the plane, m.
    point: Vec3,
    /// How much nearer it comes to a point within the step by turning, per distance of the point from the
    /// body's origin.
    turn: f64,
}

impl Unbounded {
    pub(super) fn may_touch(&self, centre: Vec3, reach: f64) -> bool {
        let arm = (centre - self.origin).length() + reach;
        let near = |half: &HalfSpace| half.normal.dot(centre - half.point) <= reach + half.turn * arm;
        self.half_spaces.as_ref().is_none_or(|all| all.iter().any(near))
    }
}

impl Collider {
    /// Bounds of how far the surfaces of bodies travel; of bodies without bounds only their centre.
    fn travel(&self, world: &World, step: f64) -> Vec<Travel> {
        let bodies = &world.bodies;
        let moving = (0..bodies.len()).filter(|&body| !world.is_prescribed(body));
        let count = moving.clone().count().max(1) as f64;
        let mean: Vec3 = moving.map(|body| world.fluctuation(body)).sum::<Vec3>() / count;
        // What the deformation of a periodic cell makes of the distance of two centres, at most twice the
        // radii.
        let strain =
            world.cell().map_or(0.0, |cell| 2.0 * cell.rate.iter().map(|rate| rate.abs()).sum::<f64>());
        let of = |body: usize| {
            let radius = self.form(world, body).bounding_radius;
            let spin = if radius.is_finite() {
                (bodies.angular_velocity[body].length() + strain) * radius
            } else {
                0.0
            };
            let velocity = world.fluctuation(body);
            Travel {
                own: step * (velocity.length() + spin),
                relative: step * ((velocity - mean).length() + spin),
                way: step * velocity,
                spin: step * spin,
            }
        };
        (0..bodies.len()).into_par_iter().with_min_len(TASK).map(of).collect()
    }

    /// Pairs of the grid, lower index first, that may come as near within the step as `margin`, m: those that
    /// these bodies form with others for which [`Travel::approach_to_slower`] is less, or as much and the
    /// index lower, so that a few fast ones make no one else look far. In no order; across the boundary of a
    /// periodic cell some twice.
    pub(super) fn pairs_of(
        &self,
        world: &World,
        sorted: &Sorted,
        bodies: Range<usize>,
        margin: f64,
    ) -> Vec<[u32; 2]> {
        let Sorted { grid, approach_of_slot, largest, .. } = sorted;
        let (mut pairs, mut near) = (Vec::with_capacity(USUAL * bodies.len()), Vec::new());
        for body in bodies.filter(|&body| sorted.in_grid[body]).take_while(|_| !self.is_stopped()) {
            let (centre, radius) = (world.bodies.position[body], self.form(world, body).bounding_radius);
            let (me, approach) = (body as u32, sorted.travel[body].approach_to_slower(*largest));
            let farthest = radius + largest + margin + approach;
            let square = farthest * farthest * (1.0 + 1e-9);
            let mut count = 0;
            grid.around(centre, farthest, |range| {
                if near.len() < count + range.len() {
                    near.resize(count + range.len(), 0);
                }
                // Without a branch: whether one of them is near is anybody's guess.
                let slots = grid.centre[range.clone()].iter().zip(&approach_of_slot[range.clone()]);
                for (slot, (other, of_other)) in range.zip(slots) {
                    near[count] = slot as u32;
                    let is_near = (centre - *other).length_squared() <= square;
                    count += usize::from(is_near & (*of_other <= approach));
                }
            });
            for slot in near[..count].iter().map(|&slot| slot as usize) {
                let other = grid.body[slot];
                let reach = radius + grid.radius[slot] + margin + sorted.approach([me, other]);
                let is_near = (centre - grid.centre[slot]).length_squared() <= reach * reach;
                if is_near && (approach_of_slot[slot] < approach || other < me) {
                    pairs.push([me.min(other), me.max(other)]);
                }
            }
        }
        pairs
    }

    pub(super) fn sort(&self, world: &World, search: Search) -> Sorted {
        let step = search.step;
        let bodies = world.bodies.len();
        let radius = |body: usize| self.form(world, body).bounding_radius;
        let mut finite: Vec<f64> = (0..bodies).map(radius).filter(|&r| r.is_finite() && r > 0.0).collect();
        let limit = if finite.is_empty() {
            0.0
        } else {
            let middle = finite.len() / 2;
            SIMILAR * *finite.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let travel = self.travel(world, step);
        let largest = (0..bodies).map(radius).filter(|&r| r <= limit).fold(0.0, f64::max);
        // A single fast grain must not make the cells of all others huge.
        let in_grid: Vec<bool> =
            (0..bodies).map(|body| radius(body) <= limit && travel[body].relative <= largest).collect();
        let (mut balls, mut large, mut unbounded) = (Vec::with_capacity(bodies), Vec::new(), Vec::new());
        let mut approaches = Vec::with_capacity(bodies);
        for body in 0..bodies {
            let radius = radius(body);
            if in_grid[body] {
                balls.push((body as u32, world.bodies.position[body], radius));
                approaches.push(travel[body].approach_to_slower(largest));
            } else if radius.is_finite() {
                large.push(body as u32);
            } else {
                unbounded.push(self.unbounded(world, body, step));
            }
        }
        let margin = 2.0 * largest + search.margin();
        let farthest = (margin + approaches.iter().copied().fold(0.0, f64::max)) * (1.0 + 1e-9);
        let middle = approaches.len() / 2;
        let usual = if approaches.is_empty() {
            0.0
        } else {
            *approaches.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        if let Some(cell) = world.cell() {
            let own = balls.len();
            for k in 0..own {
                let (body, centre, radius) = balls[k];
                balls.extend(cell.images(centre, farthest).map(|(_, image)| (body, image, radius)));
            }
        }
        let wider = |body: &u32| {
            let bounds = self.bounds(world, *body as usize);
            let by = travel[*body as usize].relative;
            Aabb::new(bounds.mins - by, bounds.maxs + by)
        };
        let mut bounds: Vec<Aabb> = large.iter().map(wider).collect();
        if let Some(cell) = world.cell() {
            let own = large.len();
            for k in 0..own {
                let bounds_of = bounds[k];
                let (centre, reach) = (bounds_of.center(), bounds_of.half_extents().length());
                // The largest may also be as fast as that.
                for (_, image) in cell.images(centre, reach + farthest + largest) {
                    let way = image - centre;
                    large.push(large[k]);
                    bounds.push(Aabb::new(bounds_of.mins + way, bounds_of.maxs + way));
                }
            }
        }
        let size = margin + usual;
        let grid = Grid::new(&balls, if size > 0.0 { size } else { 1.0 });
        let of_slot = |body: &u32| travel[*body as usize].approach_to_slower(largest);
        let of_grid = grid.body.iter().map(|body| travel[*body as usize].relative);
        Sorted {
            approach_of_slot: grid.body.iter().map(of_slot).collect(),
            fastest: of_grid.fold(0.0, f64::max),
            travel,
            deforms: world.cell().is_some(),
            grid,
            in_grid,
            largest,
            others: Others::new(large, bounds, unbounded),
            ignored: world.ignored_pairs(),
        }
    }

    fn unbounded(&self, world: &World, body: usize, step: f64) -> Unbounded {
        let Placed { form, position, orientation } = self.placed(world, body);
        let half_space = |part: &Part| {
            let normal = orientation * (part.orientation * Vec3::Z);
            let turn = step * world.bodies.angular_velocity[body].cross(normal).length();
            let point = position + orientation * part.position;
            matches!(part.shape, Shape::Plane(_)).then_some(HalfSpace { normal, point, turn })
        };
        let half_spaces = form.geometry.parts.iter().map(half_space).collect();
        Unbounded { body: body as u32, origin: position, half_spaces }
    }

    /// Box in world axes that holds a body without planes.
    pub(super) fn bounds(&self, world: &World, body: usize) -> Aabb {
        let Placed { form, position, orientation } = self.placed(world, body);
        let boxes = form.geometry.parts.iter().zip(&form.part_bounds).map(|(part, own)| {
            let rotation = Mat3::from_quat(orientation * part.orientation);
            turned_bounds(own, position + orientation * part.position, rotation)
        });
        boxes
            .reduce(|a, b| Aabb::new(a.mins.min(b.mins), a.maxs.max(b.maxs)))
            .unwrap_or(Aabb::new(position, position))
    }
}
