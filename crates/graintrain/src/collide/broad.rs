//! Broad phase, and the loop over bodies that makes the contact list.

use super::grid::Grid;
use super::identity::identity;
use super::mesh::turned_bounds;
use super::narrow::{Collidable, Placed, body_contacts};
use super::reduce::Touch;
use super::sweep::{advanced, arrivals, time_of_impact};
use super::words::{contacts_from, words_of};
use crate::contact::Contact;
use crate::math::{Mat3, Vec3};
use crate::shape::{Geometry, Part, Shape};
use crate::world::World;
use graintrain_ccp::Ranks;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use rayon::prelude::*;
use std::sync::Arc;

/// Bodies per parallel task. Fixed, so that tasks and their order do not depend on threads.
const TASK: usize = 256;

/// Contacts per body for which room is made at once.
const USUAL: usize = 5;

/// Bodies up to this multiple of the median bounding radius go into the cell list.
const SIMILAR: f64 = 2.5;

/// Finds contacts; keeps what it derives from geometries between steps.
#[derive(Default)]
pub struct Collider {
    forms: Vec<Collidable>,
    ranks: Option<Arc<Ranks>>,
}

/// Two bodies that overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Index of one body.
    pub body_a: u32,
    /// Index of the other body.
    pub body_b: u32,
    /// Depth, m, positive.
    pub depth: f64,
    /// Where, m.
    pub point: Vec3,
}

/// The deepest overlap of a world, if any two bodies overlap: what an initial state should be checked for. Pairs of
/// bodies that are both fully prescribed are not looked at, nor those whose contacts are elastic: they overlap at rest.
pub fn deepest_overlap(world: &World) -> Option<Overlap> {
    let contacts = Collider::default().contacts(world, 0.0, 0.0);
    let is_rigid = |contact: &&Contact| {
        let [a, b] = world.materials_of(contact);
        world.materials.pair_elasticity(a, b).is_rigid()
    };
    let deepest = contacts.iter().filter(is_rigid).min_by(|a, b| a.gap.total_cmp(&b.gap))?;
    (deepest.gap < 0.0).then_some(Overlap {
        body_a: deepest.body_a,
        body_b: deepest.body_b,
        depth: -deepest.gap,
        point: deepest.point,
    })
}

/// Two bodies with meshes, one of which can move, whose bounding balls overlap: contacts between two meshes are not computed.
pub fn meshes_that_meet(world: &World) -> Option<[usize; 2]> {
    let is_mesh =
        |geometry: &Geometry| geometry.parts.iter().any(|part| matches!(part.shape, Shape::Mesh { .. }));
    let meshes: Vec<bool> = world.geometries.iter().map(is_mesh).collect();
    let with_mesh = (0..world.bodies.len()).filter(|&body| meshes[world.bodies.geometry[body].index()]);
    let with_mesh: Vec<usize> = with_mesh.collect();
    let joined = world.joined_pairs();
    if with_mesh.len() < 2 || with_mesh.iter().all(|&body| world.is_prescribed(body)) {
        return None;
    }
    let radius = |body: usize| world.geometries[world.bodies.geometry[body].index()].bounding_radius();
    let balls: Vec<(usize, Vec3, f64)> =
        with_mesh.iter().map(|&body| (body, world.bodies.position[body], radius(body))).collect();
    for (k, &(a, place_a, radius_a)) in balls.iter().enumerate() {
        for &(b, place_b, radius_b) in &balls[k + 1..] {
            let both_driven = world.is_prescribed(a) && world.is_prescribed(b);
            let apart = joined.binary_search(&[a.min(b) as u32, a.max(b) as u32]).is_ok();
            let way = world.cell().map_or(place_a - place_b, |cell| cell.nearest(place_a - place_b).1);
            if !both_driven && !apart && way.length() < radius_a + radius_b {
                return Some([a, b]);
            }
        }
    }
    None
}

/// Bodies by how their neighbours are found.
struct Sorted {
    grid: Grid,
    /// Edge of its cells, m: centres of bodies that may touch are no further apart.
    reach: f64,
    /// How far the surface of each body may travel within the step, m: at rest, and in the frame that moves with the mean velocity.
    travel: Vec<Travel>,
    /// Whether the world is a periodic cell, whose deformation moves distant bodies relative to each other.
    deforms: bool,
    /// Which bodies are in the grid.
    in_grid: Vec<bool>,
    /// Bounding radius of the largest body in the grid, m: how far the travel of a body is looked ahead in case that the other one
    /// comes to rest.
    largest: f64,
    /// Finite bodies too large or too fast for the grid, ascending, with the tree over their bounds.
    large: Vec<u32>,
    tree: Bvh,
    /// Bodies with a plane, ascending.
    unbounded: Vec<Unbounded>,
}

/// How far the surface of a body may travel within the step, m.
#[derive(Clone, Copy, Debug, Default)]
struct Travel {
    /// step (|u| + |w| R).
    own: f64,
    /// step (|u - mean u| + |w| R): two bodies come nearer to each other by at most the sum of theirs.
    relative: f64,
}

impl Sorted {
    /// How much nearer the two bodies may come within the step, m.
    fn approach(&self, a: usize, b: usize) -> f64 {
        let (a, b) = (self.travel[a], self.travel[b]);
        (a.relative + b.relative).max(a.own.max(b.own).min(self.largest))
    }

    /// Whether the two bodies may move by more than `far`, m, relative to each other within the step: `false` where bounds that are
    /// at hand say so, for most pairs.
    fn may_travel(&self, pair: [u32; 2], far: f64) -> bool {
        let [a, b] = pair.map(|body| self.travel[body as usize].relative);
        // The bounds round, and know of the deformation of a cell only along the radii.
        self.deforms || a + b > (1.0 - 1e-9) * far
    }
}

/// A body with a plane.
struct Unbounded {
    body: u32,
    /// Its origin, m.
    origin: Vec3,
    /// Its parts, where it is nothing but half-spaces (a floor, a box of walls): most bodies are seen to be far from all of them
    /// without looking at their shapes.
    half_spaces: Option<Vec<HalfSpace>>,
}

/// What lies behind a plane.
struct HalfSpace {
    /// Outward unit normal.
    normal: Vec3,
    /// A point of the plane, m.
    point: Vec3,
    /// How much nearer it comes to a point within the step by turning, per distance of the point from the body's origin.
    turn: f64,
}

impl Unbounded {
    fn may_touch(&self, centre: Vec3, reach: f64) -> bool {
        let arm = (centre - self.origin).length() + reach;
        let near = |half: &HalfSpace| half.normal.dot(centre - half.point) <= reach + half.turn * arm;
        self.half_spaces.as_ref().is_none_or(|all| all.iter().any(near))
    }
}

impl Collider {
    /// Looks for contacts together with other processes, each of which has the same world and asks for the same: each looks around the
    /// bodies of its part, and all get all contacts.
    pub fn share_among(&mut self, ranks: Arc<Ranks>) {
        self.ranks = Some(ranks).filter(|ranks| ranks.count() > 1);
    }

    /// All contacts with gap up to the envelope, m, and those further apart that would close within `step` seconds at
    /// the present velocities and under gravity, or if one of both came to rest (else fast bodies would be found deep inside each
    /// other: of two grains that fall together, the lower lands first); except between bodies that are both fully prescribed, and
    /// those that joints keep from colliding.
    /// In case that one comes to rest the travel of the other is looked ahead up to the radius of the largest grain.
    ///
    /// In the order of body A, then of its neighbours (of similar size first, ascending), then of features. A is the
    /// body of similar size and speed to most others, or the one with the lower index where both or neither are: a grain on a
    /// wall is A.
    pub fn contacts(&mut self, world: &World, envelope: f64, step: f64) -> Vec<Contact> {
        let fall = world.largest_acceleration() * step * step;
        self.look_around(world, Look { envelope, step, fall, meeting: false })
    }

    /// Of [`Self::contacts`] without an envelope at least all those that close by the end of the step at the present velocities: two balls that move by less than
    /// their gap relative to each other, most of a pile, are left out before anything else is found out about them.
    pub(crate) fn meetings(&mut self, world: &World, step: f64) -> Vec<Contact> {
        let fall = world.largest_acceleration() * step * step;
        // The rates of a cell whose stress is imposed may still change.
        let meeting = world.cell().is_none();
        self.look_around(world, Look { envelope: 0.0, step, fall, meeting })
    }

    fn look_around(&mut self, world: &World, look: Look) -> Vec<Contact> {
        self.update_forms(world);
        let sorted = self.sort(world, look.envelope, look.step);
        let bodies = world.bodies.len();
        let all_tasks = bodies.div_ceil(TASK);
        let own_tasks = self.ranks.as_ref().map_or(0..all_tasks, |ranks| ranks.part_of(all_tasks));
        let tasks: Vec<Vec<Contact>> = own_tasks
            .into_par_iter()
            .map(|task| {
                let own = task * TASK..((task + 1) * TASK).min(bodies);
                let mut found = Found { contacts: Vec::with_capacity(USUAL * own.len()), ..Found::default() };
                for body in own {
                    self.contacts_of(world, &sorted, body, look, &mut found);
                }
                found.contacts
            })
            .collect();
        let mut contacts = tasks.concat();
        if let Some(ranks) = &self.ranks {
            contacts = contacts_from(&ranks.join(&words_of(&contacts)));
        }
        let joined = world.joined_pairs();
        if !joined.is_empty() {
            let pair = |c: &Contact| [c.body_a.min(c.body_b), c.body_a.max(c.body_b)];
            contacts.retain(|contact| joined.binary_search(&pair(contact)).is_err());
        }
        contacts
    }

    /// Every contact of two bodies that could close within the step if they moved with these velocities (six numbers per body), or
    /// twice as fast. Forms are those of the last call of [`Self::contacts`].
    pub(crate) fn contacts_of_pair(
        &self,
        world: &World,
        pair: [u32; 2],
        velocity: &[f64],
        step: f64,
    ) -> Vec<Contact> {
        let ([a, b], image) = self.placed_pair(world, pair);
        let travel = |body: u32| {
            let v = &velocity[6 * body as usize..6 * body as usize + 6];
            let radius = self.form(world, body as usize).bounding_radius;
            let spin = if radius.is_finite() { Vec3::from_slice(&v[3..]).length() * radius } else { 0.0 };
            step * (Vec3::from_slice(&v[..3]).length() + spin)
        };
        let fall =
            pair.map(|body| world.acceleration(body as usize)).into_iter().fold(0.0, f64::max) * step * step;
        let ahead = 2.0 * (travel(pair[0]) + travel(pair[1])) + fall;
        let mut touches = Vec::new();
        body_contacts(a, b, ahead, &mut touches);
        touches.iter().map(|touch| Contact { image, ..contact(pair, touch) }).collect()
    }

    /// Whether two bodies of the world that move with these velocities (u, w), as a step moves them, nowhere overlap by more than `allowed` and what they
    /// fell till then, `fall` by the end of the step, m. Looked at in so many poses that a face no more curved than the smaller body's size is not missed; `false` where that would take
    /// more than [`POSES`].
    pub(crate) fn pass_freely(
        &self,
        world: &World,
        pair: [u32; 2],
        mut velocities: [[Vec3; 2]; 2],
        step: f64,
        allowed: f64,
        fall: f64,
    ) -> bool {
        let ([a, b], image) = self.placed_pair(world, pair);
        if let Some(cell) = world.cell().filter(|_| image != [0; 3]) {
            velocities[1][0] += cell.image_velocity(image);
        }
        let turn = |k: usize, form: &Collidable| {
            let spin = velocities[k][1].length();
            if spin == 0.0 || form.ball.is_some() { 0.0 } else { spin * form.bounding_radius }
        };
        let way = step * ((velocities[0][0] - velocities[1][0]).length() + turn(0, a.form) + turn(1, b.form));
        // A chord of c leaves a circle of radius R by c^2 / 8 R.
        let poses = way / (8.0 * allowed * a.form.size.min(b.form.size)).sqrt();
        if poses.is_nan() || poses > POSES {
            return false;
        }
        let poses = poses.ceil().max(1.0);
        let mut touches = Vec::new();
        (1..=poses as u32).all(|k| {
            let time = step * f64::from(k) / poses;
            touches.clear();
            body_contacts(
                advanced(a, velocities[0], time),
                advanced(b, velocities[1], time),
                0.0,
                &mut touches,
            );
            let depth = allowed + fall * f64::from(k) / poses;
            touches.iter().all(|touch| touch.gap >= -depth)
        })
    }

    /// Size of a body, m: the radius of spheres, capsules and cylinders, half the thickness of boxes. A body
    /// without a size of its own (planes, meshes) has an infinite one. Forms are those of the last call of [`Self::contacts`].
    pub(crate) fn body_size(&self, world: &World, body: usize) -> f64 {
        self.form(world, body).size
    }

    /// Whether a body is one sphere about its own origin.
    pub(crate) fn is_ball(&self, world: &World, body: usize) -> bool {
        self.form(world, body).ball.is_some()
    }

    /// Size of the smaller body of a contact, m.
    pub(crate) fn contact_size(&self, world: &World, contact: &Contact) -> f64 {
        let [a, b] = [contact.body_a, contact.body_b].map(|body| self.body_size(world, body as usize));
        let size = a.min(b);
        if size.is_finite() {
            return size;
        }
        let [a, b] =
            [contact.body_a, contact.body_b].map(|body| self.form(world, body as usize).bounding_radius);
        let radius = a.min(b);
        if radius.is_finite() { radius } else { 1.0 }
    }

    /// How far this spin, rad/s, moves the surface of a body within the step, m, where that bends its way: nothing for balls, for bodies
    /// without bounds, and for those that turn by less than [`TURN`].
    pub(crate) fn spin_travel(&self, world: &World, body: usize, spin: f64, step: f64) -> f64 {
        let form = self.form(world, body);
        let bends = form.ball.is_none() && form.bounding_radius.is_finite() && step * spin > TURN;
        if bends { step * spin * form.bounding_radius } else { 0.0 }
    }

    /// Follows the geometries of the world; whether any of them is new or another one than before.
    pub(crate) fn update_forms(&mut self, world: &World) -> bool {
        let mut changed = self.forms.len() != world.geometries.len();
        self.forms.truncate(world.geometries.len());
        for (index, geometry) in world.geometries.iter().enumerate() {
            match self.forms.get_mut(index) {
                Some(form) if form.geometry == *geometry => continue,
                Some(form) => *form = Collidable::new(geometry),
                None => self.forms.push(Collidable::new(geometry)),
            }
            changed = true;
        }
        changed
    }

    fn form(&self, world: &World, body: usize) -> &Collidable {
        &self.forms[world.bodies.geometry[body].index()]
    }

    pub(super) fn placed(&self, world: &World, body: usize) -> Placed<'_> {
        Placed {
            form: self.form(world, body),
            position: world.bodies.position[body],
            orientation: world.bodies.orientation[body],
        }
    }

    /// Both bodies of a pair, the second as its image beside the first, and by how many edges of a periodic cell that is away from it.
    fn placed_pair(&self, world: &World, pair: [u32; 2]) -> ([Placed<'_>; 2], [i32; 3]) {
        let [a, mut b] = pair.map(|body| self.placed(world, body as usize));
        let image = world.image_beside(pair);
        if let Some(cell) = world.cell().filter(|_| image != [0; 3]) {
            b.position += cell.shift(image);
        }
        ([a, b], image)
    }

    /// Bounds of how far the surfaces of bodies travel; of bodies without bounds only their centre.
    fn travel(&self, world: &World, step: f64) -> Vec<Travel> {
        let bodies = &world.bodies;
        let moving = (0..bodies.len()).filter(|&body| !world.is_prescribed(body));
        let count = moving.clone().count().max(1) as f64;
        let mean: Vec3 = moving.map(|body| world.fluctuation(body)).sum::<Vec3>() / count;
        // What the deformation of a periodic cell makes of the distance of two centres, at most twice the radii.
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

    fn sort(&self, world: &World, envelope: f64, step: f64) -> Sorted {
        let bodies = world.bodies.len();
        let radius = |body: usize| self.form(world, body).bounding_radius;
        let mut finite: Vec<f64> = (0..bodies).map(radius).filter(|r| r.is_finite()).collect();
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
        let (mut farthest, mut fastest) = (0.0_f64, 0.0_f64);
        for body in 0..bodies {
            let radius = radius(body);
            fastest = fastest.max(travel[body].own);
            if in_grid[body] {
                balls.push((body as u32, world.bodies.position[body], radius));
                farthest = farthest.max(travel[body].relative);
            } else if radius.is_finite() {
                large.push(body as u32);
            } else {
                unbounded.push(self.unbounded(world, body, step));
            }
        }
        // Slightly larger than needed, so that rounding in the cell coordinates cannot lose a pair.
        let fall = world.largest_acceleration() * step * step;
        let ahead = (2.0 * farthest).max(fastest.min(largest)) + envelope.max(fall);
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
                for (_, image) in cell.images(centre, reach + size) {
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
            reach,
            in_grid,
            largest,
            large,
            tree: Bvh::from_leaves(BvhBuildStrategy::default(), &bounds),
            unbounded,
        }
    }

    fn unbounded(&self, world: &World, body: usize, step: f64) -> Unbounded {
        let Placed { form, position, orientation } = self.placed(world, body);
        let half_space = |part: &Part| {
            let normal = orientation * (part.orientation * Vec3::Z);
            let turn = step * world.bodies.angular_velocity[body].cross(normal).length();
            let point = position + orientation * part.position;
            (part.shape == Shape::Plane).then_some(HalfSpace { normal, point, turn })
        };
        let half_spaces = form.geometry.parts.iter().map(half_space).collect();
        Unbounded { body: body as u32, origin: position, half_spaces }
    }

    /// Box in world axes that holds a body without planes.
    pub(super) fn bounds(&self, world: &World, body: usize) -> Aabb {
        let Placed { form, position, orientation } = self.placed(world, body);
        let boxes = form.geometry.parts.iter().zip(&form.trees).map(|(part, tree)| {
            let own = match (&part.shape, tree) {
                (_, Some(tree)) => tree.bounds(),
                (Shape::Box { half }, _) => Aabb::new(-*half, *half),
                (Shape::Cylinder { half_length, radius }, _) => {
                    let half = Vec3::new(*radius, *radius, *half_length);
                    Aabb::new(-half, half)
                }
                (Shape::Capsule { half_length, radius }, _) => {
                    let half = Vec3::new(*radius, *radius, half_length + radius);
                    Aabb::new(-half, half)
                }
                (Shape::Hull(hull), _) => {
                    let low = hull.corners().iter().fold(Vec3::INFINITY, |low, c| low.min(*c));
                    let high = hull.corners().iter().fold(Vec3::NEG_INFINITY, |high, c| high.max(*c));
                    Aabb::new(low, high)
                }
                (shape, _) => {
                    let half = Vec3::splat(shape.bounding_radius());
                    Aabb::new(-half, half)
                }
            };
            let rotation = Mat3::from_quat(orientation * part.orientation);
            turned_bounds(&own, position + orientation * part.position, rotation)
        });
        boxes
            .reduce(|a, b| Aabb::new(a.mins.min(b.mins), a.maxs.max(b.maxs)))
            .unwrap_or(Aabb::new(position, position))
    }

    /// Contacts of which `body` is A.
    fn contacts_of(&self, world: &World, sorted: &Sorted, body: usize, look: Look, found: &mut Found) {
        let me = self.placed(world, body);
        let margin = look.envelope.max(look.fall);
        let radius = me.form.bounding_radius;
        let similar = sorted.in_grid[body];
        let prescribed = world.is_prescribed(body);
        let Found { balls, others, touches, contacts } = found;
        balls.clear();
        others.clear();
        if similar {
            let (grid, farthest) = (&sorted.grid, sorted.reach * sorted.reach);
            grid.around(me.position, |range| {
                for slot in range {
                    // Most are further than any pair may be: of those nothing else is read.
                    let apart = (me.position - grid.centre[slot]).length_squared();
                    let other = grid.body[slot];
                    if apart > farthest || other as usize <= body {
                        continue;
                    }
                    let reach = radius + grid.radius[slot] + margin + sorted.approach(body, other as usize);
                    if apart <= reach * reach {
                        balls.push(other);
                    }
                }
            });
            balls.sort_unstable();
            if world.cell().is_some() {
                balls.dedup();
            }
        }
        if radius.is_finite() {
            let around = if similar {
                Aabb::new(me.position - radius, me.position + radius)
            } else {
                self.bounds(world, body)
            };
            // The leaves hold the relative travel of their own bodies.
            let by = margin + sorted.travel[body].relative + sorted.largest;
            let around = Aabb::new(around.mins - by, around.maxs + by);
            others.extend(
                sorted
                    .tree
                    .intersect_aabb(&around)
                    .map(|leaf| sorted.large[leaf as usize])
                    .filter(|&other| similar || other as usize > body),
            );
            let near = sorted.unbounded.iter().filter(|other| {
                other.may_touch(me.position, radius + margin + sorted.approach(body, other.body as usize))
            });
            others.extend(near.map(|other| other.body));
        } else {
            let later = sorted.unbounded.iter().filter(|other| other.body as usize > body);
            others.extend(later.map(|other| other.body));
        }
        others.sort_unstable();
        if world.cell().is_some() {
            others.dedup();
        }
        for &other in balls.iter().chain(others.iter()) {
            if prescribed && world.is_prescribed(other as usize) {
                continue;
            }
            touches.clear();
            let pair = [body as u32, other];
            let ([_, them], image) = self.placed_pair(world, pair);
            let ahead = margin + sorted.approach(body, other as usize);
            match (me.form.ball, them.form.ball) {
                (Some(r_a), Some(r_b)) => {
                    if look.meeting {
                        let [[u_a, _], [u_b, _]] = world.pair_velocities(pair);
                        let gap = (me.position - them.position).length() - r_a - r_b;
                        if look.step * (u_a - u_b).length() <= gap {
                            continue;
                        }
                    }
                    ball_contact(me.position, r_a, them.position, r_b, ahead, touches);
                }
                _ => body_contacts(me, them, ahead, touches),
            }
            let first = contacts.len();
            let far = FAST * me.form.size.min(them.form.size);
            if sorted.may_travel(pair, far) && self.relative_travel(world, pair, look.step) > far {
                self.arrivals(world, pair, sorted.largest, look, touches, contacts);
            } else {
                let closes = |touch: &&Touch| look.closes(world, pair, sorted.largest, touch);
                contacts.extend(touches.iter().filter(closes).map(|touch| contact(pair, touch)));
            }
            contacts[first..].iter_mut().for_each(|contact| contact.image = image);
        }
    }

    /// dt |u_A - u_B| and what spin adds to it, m.
    fn relative_travel(&self, world: &World, pair: [u32; 2], step: f64) -> f64 {
        let [a, b] = pair.map(|body| body as usize);
        let spin =
            |body: usize| self.spin_travel(world, body, world.bodies.angular_velocity[body].length(), step);
        let [[u_a, _], [u_b, _]] = world.pair_velocities(pair);
        step * (u_a - u_b).length() + spin(a) + spin(b)
    }

    /// Contacts of two bodies that move past each other by about their size or more within the step: where they meet, if they do,
    /// rather than where they are nearest now. Touches within the envelope, and those that close in case that one of both comes to
    /// rest, stay what they are.
    fn arrivals(
        &self,
        world: &World,
        pair: [u32; 2],
        largest: f64,
        look: Look,
        touches: &[Touch],
        contacts: &mut Vec<Contact>,
    ) {
        let ([a, b], _) = self.placed_pair(world, pair);
        let [v_a, v_b] = world.pair_velocities(pair);
        let first = contacts.len();
        if let Some(impact) =
            time_of_impact(a, b, v_a, v_b, look.step, look.envelope).filter(|i| i.time > 0.0)
        {
            for arrival in arrivals(&impact, a, b, v_a, v_b) {
                let lead = 0.5 * (arrival.on_a - arrival.on_b);
                contacts.push(Contact { lead, ..contact(pair, &arrival.touch) });
            }
        }
        let met = contacts.len() - first;
        for touch in touches {
            let near = touch.gap <= look.envelope || {
                let (fall, away) = (look.fall_of(world, pair), surface_speeds(world, pair, touch));
                look.closes_at_rest(world, pair, fall, largest, touch, away)
            };
            let new = contact(pair, touch);
            if near && contacts[first..first + met].iter().all(|c| c.identity != new.identity) {
                contacts.push(new);
            }
        }
        contacts[first..].sort_by_key(|c| c.identity);
    }
}

/// Bodies whose surfaces move by more than this fraction of the smaller one's size relative to each other within a step are looked
/// at along their way: up to there the error of a fixed normal is a thirtieth of the size.
const FAST: f64 = 0.5;

/// Poses of a pair looked at to see whether it passes.
const POSES: f64 = 512.0;

/// Turn of a body within a step, rad, up to which a fixed normal does.
const TURN: f64 = 0.3;

/// How far contacts are looked for.
#[derive(Clone, Copy)]
struct Look {
    envelope: f64,
    step: f64,
    /// The largest acceleration of any body times step^2, m: pairs further apart are not looked at.
    fall: f64,
    /// Balls that do not meet within the step are left out.
    meeting: bool,
}

impl Look {
    /// Whether a touch lies within the envelope or may close within the step.
    fn closes(&self, world: &World, pair: [u32; 2], largest: f64, touch: &Touch) -> bool {
        if touch.gap <= self.envelope {
            return true;
        }
        let away = surface_speeds(world, pair, touch);
        let approach = self.step * (away[1] - away[0]);
        let fall = self.fall_of(world, pair);
        self.reaches(touch, fall, approach) || self.closes_at_rest(world, pair, fall, largest, touch, away)
    }

    /// Largest acceleration of either body times step^2, m.
    fn fall_of(&self, world: &World, pair: [u32; 2]) -> f64 {
        let [a, b] = pair.map(|body| world.acceleration(body as usize));
        a.max(b) * self.step * self.step
    }

    /// Whether a touch may close within the step if one of both bodies came to rest, unless it is held; `away` as [`surface_speeds`].
    fn closes_at_rest(
        &self,
        world: &World,
        pair: [u32; 2],
        fall: f64,
        largest: f64,
        touch: &Touch,
        [away_a, away_b]: [f64; 2],
    ) -> bool {
        let [held_a, held_b] = pair.map(|body| world.is_prescribed(body as usize));
        let stops = |parting: f64, held: bool| if held { parting } else { 0.0 };
        let rest = (-away_a + stops(away_b, held_b)).max(away_b - stops(away_a, held_a));
        self.reaches(touch, fall, (self.step * rest).min(largest))
    }

    fn reaches(&self, touch: &Touch, fall: f64, approach: f64) -> bool {
        touch.gap <= self.envelope + approach || touch.gap <= fall + approach
    }
}

/// Velocities of the bodies A and B at a touch along its normal, m/s.
fn surface_speeds(world: &World, pair: [u32; 2], touch: &Touch) -> [f64; 2] {
    let [a, b] = world.pair_velocities(pair);
    [(pair[0], a), (pair[1], b)].map(|(body, [velocity, spin])| {
        let arm = world.way_to(body as usize, touch.point);
        touch.normal.dot(velocity + spin.cross(arm))
    })
}

fn contact([body_a, body_b]: [u32; 2], touch: &Touch) -> Contact {
    Contact {
        body_a,
        body_b,
        identity: identity(body_a, body_b, touch.feature),
        point: touch.point,
        normal: touch.normal,
        gap: touch.gap,
        lead: Vec3::ZERO,
        image: [0; 3],
    }
}

/// Contacts of one task, with scratch.
#[derive(Default)]
struct Found {
    balls: Vec<u32>,
    others: Vec<u32>,
    touches: Vec<Touch>,
    contacts: Vec<Contact>,
}

#[inline]
fn ball_contact(a: Vec3, r_a: f64, b: Vec3, r_b: f64, envelope: f64, touches: &mut Vec<Touch>) {
    let d = a - b;
    let length = d.length();
    let gap = length - r_a - r_b;
    if gap <= envelope {
        // Concentric balls have no normal: any direction separates them.
        let normal = if length > 0.0 { d / length } else { Vec3::X };
        touches.push(Touch { point: b + (r_b + 0.5 * gap) * normal, normal, gap, feature: 0 });
    }
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

    /// Every pair through the narrow phase.
    fn brute_force(world: &World, envelope: f64) -> Vec<u64> {
        let mut collider = Collider::default();
        collider.update_forms(world);
        let mut found = Vec::new();
        for a in 0..world.bodies.len() {
            for b in a + 1..world.bodies.len() {
                if world.is_prescribed(a) && world.is_prescribed(b) {
                    continue;
                }
                let mut touches = Vec::new();
                body_contacts(collider.placed(world, a), collider.placed(world, b), envelope, &mut touches);
                found.extend(touches.iter().map(|t| identity(a as u32, b as u32, t.feature)));
            }
        }
        found.sort_unstable();
        found
    }

    proptest! {
        /// Balls that move by up to twice their size: what the whole search finds and closes within the step is among the meetings, as it is.
        #[test]
        fn meetings_have_every_contact_that_closes(
            balls in prop::collection::vec(
                (prop::array::uniform3(-0.6..0.6_f64), prop::array::uniform3(-40.0..40.0_f64), any::<bool>(), 0..3_u32),
                2..40,
            ),
        ) {
            let step = 0.01;
            let materials = Materials::single("stuff", 1.0, 0.0, 0.0).unwrap();
            let mut world = World::new(Vec3::new(0.0, 0.0, -10.0), materials).unwrap();
            let sizes = [0.1, 0.2].map(|radius| world.add_geometry(Geometry::sphere(radius).unwrap()));
            let floor = world.add_geometry(Geometry::plane());
            let fixed = world.add_motion(Motion::fixed()).unwrap();
            let place = Vec3::new(0.0, 0.0, -0.5);
            world.add_body(Body { motion: fixed, ..Body::new(floor, MaterialId::default(), place) }).unwrap();
            for (position, velocity, is_large, slowness) in balls {
                let geometry = sizes[usize::from(is_large)];
                let velocity = Vec3::from_array(velocity) * 0.03_f64.powi(slowness as i32);
                let body = Body::new(geometry, MaterialId::default(), Vec3::from_array(position));
                world.add_body(Body { velocity, ..body }).unwrap();
            }
            let mut collider = Collider::default();
            let meetings = collider.meetings(&world, step);
            let closing = |c: &Contact| {
                let u = c.normal.dot(world.bodies.velocity[c.body_a as usize] - world.bodies.velocity[c.body_b as usize]);
                c.gap.max(0.0) + step * u < -1e-9
            };
            let all = collider.contacts(&world, 0.0, step);
            let closing_of = |found: &[Contact]| found.iter().filter(|c| closing(c)).copied().collect::<Vec<_>>();
            prop_assert!(meetings.len() <= all.len());
            prop_assert_eq!(closing_of(&meetings), closing_of(&all));
        }
    }

    proptest! {
        /// Spheres of two sizes, capsules, one large box, a plane and a mesh, free and fixed.
        #[test]
        fn contacts_are_those_of_all_pairs(
            bodies in prop::collection::vec(
                (0..6_usize, prop::array::uniform3(-1.0..1.0_f64), prop::array::uniform3(-2.0..2.0_f64), any::<bool>()),
                2..60,
            ),
            envelope in 0.0..0.05_f64,
        ) {
            let materials = Materials::single("stuff", 1.0, 0.0, 0.0).unwrap();
            let mut world = World::new(Vec3::ZERO, materials).unwrap();
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
            for (kind, position, turn, free) in bodies {
                let motion = if free && kind < 4 { crate::world::FREE } else { fixed };
                let orientation = rotation_exponential(Vec3::from_array(turn));
                let body = Body::new(forms[kind], MaterialId::default(), Vec3::from_array(position));
                world.add_body(Body { motion, orientation, ..body }).unwrap();
            }
            let contacts = Collider::default().contacts(&world, envelope, 0.0);
            let mut found: Vec<u64> = contacts.iter().map(|contact| contact.identity).collect();
            found.sort_unstable();
            prop_assert_eq!(found, brute_force(&world, envelope));
        }
    }

    #[test]
    fn the_deepest_overlap_is_named() {
        let materials = Materials::single("stuff", 1.0, 0.0, 0.0).unwrap();
        let mut world = World::new(Vec3::ZERO, materials).unwrap();
        let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
        for x in [0.0, 0.3, 0.45, 0.64] {
            world.add_body(Body::new(ball, MaterialId::default(), Vec3::new(x, 0.0, 0.0))).unwrap();
        }
        let overlap = deepest_overlap(&world).unwrap();
        assert_eq!((overlap.body_a, overlap.body_b), (1, 2));
        assert!((overlap.depth - 0.05).abs() < 1e-15 && (overlap.point.x - 0.375).abs() < 1e-15);
        world.bodies.position[2].x = 0.52;
        world.bodies.position[3].x = 0.73;
        assert_eq!(deepest_overlap(&world), None);
    }
}
