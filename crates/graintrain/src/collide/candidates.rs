//! Candidate pairs: bodies by how their neighbours are found, in a cell list, in a tree, or beside planes.

use super::broad::{Collider, TASK};
use super::grid::Grid;
use super::mesh::turned_bounds;
use super::narrow::Placed;
use crate::math::{Mat3, Vec3};
use crate::shape::{Part, Shape};
use crate::world::World;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use rayon::prelude::*;

/// Bodies up to this multiple of the median bounding radius go into the cell list.
const SIMILAR: f64 = 2.5;

/// Bodies by how their neighbours are found.
pub(super) struct Sorted {
    pub(super) grid: Grid,
    /// The largest travel of the bodies in it, m.
    farthest: Travel,
    /// How far the surface of each body may travel within the step, m: at rest, and in the frame that moves
    /// with the mean velocity.
    pub(super) travel: Vec<Travel>,
    /// Whether the world is a periodic cell, whose deformation moves distant bodies relative to each other.
    deforms: bool,
    /// Which bodies are in the grid.
    pub(super) in_grid: Vec<bool>,
    /// Bounding radius of the largest body in the grid, m: how far the travel of a body is looked ahead in
    /// case that the other one comes to rest.
    pub(super) largest: f64,
    /// Finite bodies too large or too fast for the grid, ascending, with the tree over their bounds.
    pub(super) large: Vec<u32>,
    pub(super) tree: Bvh,
    /// Bodies with a plane, ascending.
    pub(super) unbounded: Vec<Unbounded>,
    /// Pairs that do not collide, lower index first, ascending.
    ignored: Vec<[u32; 2]>,
}

/// How far the surface of a body may travel within the step, m.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Travel {
    /// step (|u| + |w| R).
    pub(super) own: f64,
    /// step (|u - mean u| + |w| R): two bodies come nearer to each other by at most the sum of theirs.
    pub(super) relative: f64,
}

impl Sorted {
    /// Whether two bodies do not collide.
    pub(super) fn is_ignored(&self, [a, b]: [u32; 2]) -> bool {
        !self.ignored.is_empty() && self.ignored.binary_search(&[a.min(b), a.max(b)]).is_ok()
    }

    /// How much nearer the two bodies may come within the step, m.
    pub(super) fn approach(&self, pair: [u32; 2]) -> f64 {
        let [a, b] = pair.map(|body| self.travel[body as usize]);
        (a.relative + b.relative).max(self.approach_at_rest(pair, false))
    }

    /// How much nearer they may come if one of them came to rest, unless one is held; beyond the size of the
    /// largest body that does not count, m.
    pub(super) fn approach_at_rest(&self, pair: [u32; 2], is_held: bool) -> f64 {
        let [a, b] = pair.map(|body| self.travel[body as usize]);
        let one = a.own.max(b.own);
        let approach = if is_held { one.max(a.relative + b.relative) } else { one };
        approach.min(self.largest)
    }

    /// How much nearer this body and any one of the grid may come within the step, m.
    pub(super) fn approach_of_any(&self, body: usize) -> f64 {
        let (own, any) = (self.travel[body], self.farthest);
        (own.relative + any.relative).max(own.own.max(any.own).min(self.largest))
    }

    /// Whether the two bodies may move by more than `far`, m, relative to each other within the step: `false`
    /// where bounds that are at hand say so, for most pairs.
    pub(super) fn may_travel(&self, pair: [u32; 2], far: f64) -> bool {
        let [a, b] = pair.map(|body| self.travel[body as usize].relative);
        // The bounds round, and know of the deformation of a cell only along the radii.
        self.deforms || a + b > (1.0 - 1e-9) * far
    }
}

/// A body with a plane.
pub(super) struct Unbounded {
    pub(super) body: u32,
    /// Its origin, m.
    origin: Vec3,
    /// Its parts, where it is nothing but half-spaces (a floor, a box of walls): most bodies are seen to be
    /// far from all of them without looking at their shapes.
    half_spaces: Option<Vec<HalfSpace>>,
}

/// What lies behind a plane.
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
            }
        };
        (0..bodies.len()).into_par_iter().with_min_len(TASK).map(of).collect()
    }

    pub(super) fn sort(&self, world: &World, envelope: f64, step: f64) -> Sorted {
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
        let mut farthest = Travel::default();
        for body in 0..bodies {
            let radius = radius(body);
            if in_grid[body] {
                balls.push((body as u32, world.bodies.position[body], radius));
                farthest.own = farthest.own.max(travel[body].own);
                farthest.relative = farthest.relative.max(travel[body].relative);
            } else if radius.is_finite() {
                large.push(body as u32);
            } else {
                unbounded.push(self.unbounded(world, body, step));
            }
        }
        // Slightly larger than needed, so that rounding in the cell coordinates cannot lose a pair.
        let fall = world.largest_acceleration() * step * step;
        let ahead = (2.0 * farthest.relative).max(farthest.own.min(largest)) + envelope.max(fall);
        let size = (2.0 * largest + ahead) * (1.0 + 1e-9);
        if let Some(cell) = world.cell() {
            let own = balls.len();
            for k in 0..own {
                let (body, centre, radius) = balls[k];
                balls.extend(cell.images(centre, size).map(|(_, image)| (body, image, radius)));
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
                for (_, image) in cell.images(centre, reach + size + largest) {
                    let way = image - centre;
                    large.push(large[k]);
                    bounds.push(Aabb::new(bounds_of.mins + way, bounds_of.maxs + way));
                }
            }
        }
        let reach = if size > 0.0 { size } else { 1.0 };
        Sorted {
            travel,
            deforms: world.cell().is_some(),
            grid: Grid::new(&balls, reach),
            farthest,
            in_grid,
            largest,
            large,
            tree: Bvh::from_leaves(BvhBuildStrategy::default(), &bounds),
            unbounded,
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
