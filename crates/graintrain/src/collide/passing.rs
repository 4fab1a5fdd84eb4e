//! Pairs of bodies along their way through a step: whether they meet or pass each other, and where planes lie
//! that those which pass are to have.

use super::Collider;
use super::broad::contact;
use super::manifold::Solid;
use super::narrow::{Collidable, Placed, PlacedPart, body_contacts};
use super::reduce::Touch;
use super::sweep::{advanced, arrivals, comes_within, time_of_impact};
use crate::assemble::of_each;
use crate::contact::Contact;
use crate::math::{Quat, Vec3};
use crate::shape::{Geometry, Shape};
use crate::world::World;
use rayon::prelude::*;

/// Poses of a pair looked at to see whether it passes.
const POSES: f64 = 512.0;

/// The features of the contacts of the cores of both bodies of a pair.
const CORES: [u64; 2] = [u64::MAX, u64::MAX - 1];

/// Radius of a core over the depth of the centre.
const CORE_SHARE: f64 = 0.9;

/// A gap over the smaller one's size that rounding does not close and nobody sees.
const HAIR: f64 = 1e-6;

/// How a body goes through a step of dt: x(t) = x + t (u - (1 - t / dt) c / 2), which ends at x + dt u.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Course {
    /// u, m/s.
    pub velocity: Vec3,
    /// w, rad/s.
    pub spin: Vec3,
    /// c, by how much what turns it aside (joints) changes its velocity on the way, m/s.
    pub bend: Vec3,
}

impl Course {
    /// Straight on with these velocities (u, w).
    pub(crate) fn straight([velocity, spin]: [Vec3; 2]) -> Self {
        Self { velocity, spin, bend: Vec3::ZERO }
    }
}

/// Points looked at for one that lies inside both bodies of a pair.
const LOOKS: usize = 6;

impl Collider {
    /// Whether two bodies of the world that go these courses, as a step moves them, nowhere overlap by more
    /// than `allowed` and what they fell till then, `fall` by the end of the step, m: for each of these
    /// `allowed`, ascending. Looked at in so many poses that a face no more curved than the smaller body's
    /// size is not missed; where that would take more than [`POSES`], whether they nowhere touch.
    pub(crate) fn pass_freely(
        &self,
        world: &World,
        pair: [u32; 2],
        mut courses: [Course; 2],
        step: f64,
        allowed: &[f64],
        fall: f64,
    ) -> Vec<bool> {
        let ([a, b], image) = self.placed_pair(world, pair);
        if let Some(cell) = world.cell().filter(|_| image != [0; 3]) {
            courses[1].velocity += cell.image_velocity(image);
        }
        let velocities = courses.each_ref().map(|course| [course.velocity, course.spin]);
        let turn = |k: usize, form: &Collidable| {
            let spin = courses[k].spin.length();
            if spin == 0.0 || form.ball.is_some() { 0.0 } else { spin * form.bounding_radius }
        };
        let way = step * ((velocities[0][0] - velocities[1][0]).length() + turn(0, a.form) + turn(1, b.form));
        // A chord of c leaves a circle of radius R by c^2 / 8 R.
        let poses = |allowed: f64| way / (8.0 * allowed * a.form.size.min(b.form.size)).sqrt();
        let most = allowed.iter().copied().fold(0.0, f64::max);
        // The deepest overlap, beyond what they fell, of a walk of so many poses: finer than the next asks
        // for.
        let mut overlap: Option<f64> = None;
        let mut touch: Option<bool> = None;
        let passes = |&allowed: &f64| {
            if allowed < 0.0 {
                return false;
            }
            let poses = if allowed == 0.0 { f64::INFINITY } else { poses(allowed) };
            if poses > POSES {
                // A touch is looked for straight on; the course leaves that by c dt / 8.
                if courses.iter().any(|course| course.bend.length() * step > 8.0 * allowed) {
                    return false;
                }
                let meet = || time_of_impact(a, b, velocities[0], velocities[1], step, 0.0).is_some();
                return !*touch.get_or_insert_with(meet);
            }
            let walk = || overlap_on_way([a, b], courses, step, poses.ceil().max(1.0) as u32, [most, fall]);
            *overlap.get_or_insert_with(walk) <= allowed
        };
        allowed.iter().map(passes).collect()
    }

    /// Whether two bodies that start at these places (m; orientations) and move with these velocities (m/s,
    /// rad/s) come as near to each other as `reach`, m, within `step` seconds. Forms are those of the last
    /// call of [`Self::contacts`]. Cost: that of [`time_of_impact`].
    pub(crate) fn come_within(
        &self,
        world: &World,
        pair: [u32; 2],
        places: [(Vec3, Quat); 2],
        velocities: [[Vec3; 2]; 2],
        step: f64,
        reach: f64,
    ) -> bool {
        let placed = [0, 1].map(|k| {
            let (position, orientation) = places[k];
            Placed { form: self.form(world, pair[k] as usize), position, orientation }
        });
        comes_within(placed, velocities, step, reach)
    }

    /// How far planes of these normals (from B to A) part two convex bodies, as they are after this time of
    /// moving with these velocities, m; `None` for other bodies.
    pub(crate) fn separations(
        &self,
        world: &World,
        pair: [u32; 2],
        velocities: [[Vec3; 2]; 2],
        time: f64,
        normals: &[Vec3],
    ) -> Option<Vec<f64>> {
        let [a, b] = self.pair_after(world, pair, velocities, time);
        let is_convex = |placed: &Placed<'_>| {
            let parts = &placed.form.geometry.parts;
            parts.len() == 1 && !matches!(parts[0].shape, Shape::Plane(_) | Shape::Mesh(_))
        };
        let reach = |placed: &Placed<'_>, direction: Vec3| {
            let PlacedPart { shape, position, orientation, .. } = placed.part(0);
            Solid::Placed { shape, position, orientation }.reach(direction)
        };
        let part = |&normal: &Vec3| -reach(&a, -normal) - reach(&b, normal);
        (is_convex(&a) && is_convex(&b)).then(|| normals.iter().map(part).collect())
    }

    /// The identities of the contacts of two bodies as they are after this time of moving with these
    /// velocities, and their gaps, m: of all that are nearer than the smaller one's size.
    pub(crate) fn gaps_after(
        &self,
        world: &World,
        pair: [u32; 2],
        velocities: [[Vec3; 2]; 2],
        time: f64,
    ) -> Vec<(u64, f64)> {
        let [a, b] = self.pair_after(world, pair, velocities, time);
        let mut touches = Vec::new();
        body_contacts(a, b, a.form.size.min(b.form.size), &mut touches);
        touches.iter().map(|touch| (contact(pair, touch).identity, touch.gap)).collect()
    }

    /// Two bodies as they are after this time of moving with these velocities.
    fn pair_after(
        &self,
        world: &World,
        pair: [u32; 2],
        velocities: [[Vec3; 2]; 2],
        time: f64,
    ) -> [Placed<'_>; 2] {
        let ([a, mut b], image) = self.placed_pair(world, pair);
        if let Some(cell) = world.cell().filter(|_| image != [0; 3]) {
            b.position += time * cell.image_velocity(image);
        }
        [advanced(a, velocities[0], time), advanced(b, velocities[1], time)]
    }

    /// The contact of two balls that are apart and touch within the step as they move now: with the normal
    /// and the arms of that moment. `None` for other bodies, and for balls that do not touch in it.
    pub(crate) fn arrival_of_balls(&self, world: &World, apart: &Contact, step: f64) -> Option<Contact> {
        let pair = [apart.body_a, apart.body_b];
        if !pair.iter().all(|&body| self.is_ball(world, body as usize)) {
            return None;
        }
        let ([a, b], image) = self.placed_pair(world, pair);
        let [v_a, v_b] = world.pair_velocities(pair);
        let impact =
            time_of_impact(a, b, v_a, v_b, step, 0.0).filter(|i| i.time > 0.0 && image == apart.image)?;
        let arrival = *arrivals(&impact, a, b, v_a, v_b).first()?;
        let lead = 0.5 * (arrival.on_a - arrival.on_b);
        Some(Contact { lead, image, identity: apart.identity, ..contact(pair, &arrival.touch) })
    }

    /// Where the cores of two bodies that move as the world has them come to the other body within the step:
    /// a core is a ball about the centre, nearly as large as the body holds there. A body is never where its
    /// core is stopped, however it turns, unless it passed the other one.
    pub(crate) fn arrivals_of_cores(&self, world: &World, pair: [u32; 2], step: f64) -> Vec<Contact> {
        let (placed, image) = self.placed_pair(world, pair);
        let velocities = world.pair_velocities(pair);
        let of_side = |side: usize| {
            let (own, other) = (placed[side], placed[1 - side]);
            let radius = CORE_SHARE * depth_at_centre(own);
            if world.is_prescribed(pair[side] as usize) || own.form.ball.is_some() || radius <= 0.0 {
                return None;
            }
            let form = Collidable::new(Geometry::sphere(radius).ok()?);
            let core = Placed { form: &form, ..own };
            let (own, others) = ([velocities[side][0], Vec3::ZERO], velocities[1 - side]);
            let impact = time_of_impact(core, other, own, others, step, 0.0).filter(|i| i.time > 0.0)?;
            let arrival = *arrivals(&impact, core, other, own, others).first()?;
            let touch = Touch { feature: CORES[side], ..arrival.touch };
            let lead = 0.5 * (arrival.on_a - arrival.on_b);
            let image = if side == 0 { image } else { image.map(|k| -k) };
            Some(Contact { lead, image, ..contact([pair[side], pair[1 - side]], &touch) })
        };
        (0..2).filter_map(of_side).collect()
    }

    /// What becomes of the contacts of bodies that move with these velocities, six numbers each, where they
    /// pass each other though planes have them overlap at the end of the step by more than `seen` of the
    /// smaller one's size, Phi + dt u_n < 0 (`u`: three numbers per contact), and they overlap on their way
    /// by no more than the fraction `allowed` of that: the plane is further off, so that it pushes only what
    /// is deflected across it. Phi + dt u_n is a hair then, lest rounding presses, and for balls, along the
    /// line of centres, so that angular momentum stays, how near they come. `bends`: the [`Course::bend`] of
    /// every body; empty: none.
    pub(crate) fn flown_past(
        &self,
        world: &World,
        contacts: &[Contact],
        ((velocity, u), bends): ((&[f64], &[f64]), &[Vec3]),
        step: f64,
        [seen, allowed]: [f64; 2],
    ) -> Vec<Contact> {
        let bend = |body: u32| bends.get(body as usize).copied().unwrap_or(Vec3::ZERO);
        let pair = |contact: &Contact| [contact.body_a, contact.body_b];
        let velocities = |contact: &Contact| {
            pair(contact)
                .map(|body| [0, 3].map(|k| Vec3::from_slice(&velocity[6 * body as usize + k..][..3])))
        };
        let are_balls = |c: &Contact| {
            pair(c).into_iter().all(|body| self.is_ball(world, body as usize) && bend(body) == Vec3::ZERO)
        };
        let past = |c: &Contact| {
            if are_balls(c) { self.balls_past(world, c, velocities(c), step) } else { *c }
        };
        let mut moved = of_each(contacts, past);
        // Other pairs have several contacts, one behind the other.
        let others: Vec<usize> =
            (0..contacts.len()).into_par_iter().filter(|&i| !are_balls(&contacts[i])).collect();
        let is_one = |i: &usize, j: &usize| pair(&contacts[*i]) == pair(&contacts[*j]);
        let gaps = others.par_chunk_by(is_one).flat_map_iter(|group| {
            let first = &contacts[group[0]];
            let size = self.contact_size(world, first);
            let closed = |i: usize| -step * u[3 * i];
            let closes = |i: usize| contacts[i].gap > 0.0 && closed(i) > contacts[i].gap + seen * size;
            let closing = group.iter().copied().filter(|&i| closes(i));
            let least = closing.clone().map(|i| closed(i) - contacts[i].gap).reduce(f64::min);
            let passes = least.is_some_and(|least| {
                let allowed = (allowed * least).min(seen * size);
                let [a, b] = velocities(first).map(Course::straight);
                let courses =
                    [Course { bend: bend(first.body_a), ..a }, Course { bend: bend(first.body_b), ..b }];
                self.pass_freely(world, pair(first), courses, step, &[allowed], 0.0)[0]
            });
            closing.filter(|_| passes).map(|i| (i, closed(i) + HAIR * size)).collect::<Vec<_>>()
        });
        for (i, gap) in gaps.collect::<Vec<_>>() {
            moved[i].gap = gap;
        }
        moved
    }

    /// [`Self::flown_past`] of two balls:
    ///
    /// ```text
    /// |x + t u| > r_A + r_B   for 0 <= t <= dt      (x, u: place and velocity of A relative to B).
    /// ```
    pub(crate) fn balls_past(
        &self,
        world: &World,
        contact: &Contact,
        velocities: [[Vec3; 2]; 2],
        step: f64,
    ) -> Contact {
        if contact.gap <= 0.0 {
            return *contact;
        }
        let ([a, b], image) = self.placed_pair(world, [contact.body_a, contact.body_b]);
        let mut approach = velocities[0][0] - velocities[1][0];
        if let Some(cell) = world.cell().filter(|_| image != [0; 3]) {
            approach -= cell.image_velocity(image);
        }
        let closed = -step * contact.normal.dot(approach);
        if contact.gap >= closed {
            return *contact;
        }
        let apart = a.position - b.position;
        let nearest =
            Self::nearest_of_balls(apart, approach, [a, b].map(|ball| ball.form.bounding_radius), step);
        if nearest > 0.0 { Contact { gap: closed + nearest, ..*contact } } else { *contact }
    }

    /// How near two balls of these radii come within `step` seconds, m, negative where they overlap:
    ///
    /// ```text
    /// min |x + t u| - r_A - r_B  for 0 <= t <= dt      (x, u: place and velocity of A relative to B)
    /// ```
    pub(crate) fn nearest_of_balls(apart: Vec3, approach: Vec3, radii: [f64; 2], step: f64) -> f64 {
        let time = (-apart.dot(approach) / approach.length_squared()).min(step).max(0.0);
        (apart + time * approach).length() - radii[0] - radii[1]
    }
}

/// The deepest overlap of two bodies in so many poses of their way, beyond what they fell till then
/// (`fall` by the end of the step), m; infinite as soon as it is above `most`.
fn overlap_on_way(
    [a, b]: [Placed<'_>; 2],
    courses: [Course; 2],
    step: f64,
    poses: u32,
    [most, fall]: [f64; 2],
) -> f64 {
    let (mut deepest, mut touches) = (f64::NEG_INFINITY, Vec::new());
    for k in 1..=poses {
        let share = f64::from(k) / f64::from(poses);
        let [a, b] = [(a, courses[0]), (b, courses[1])].map(|(body, course)| {
            let mean = course.velocity - 0.5 * (1.0 - share) * course.bend;
            advanced(body, [mean, course.spin], share * step)
        });
        if certain_overlap(a, b, most + fall * share) > most + fall * share {
            return f64::INFINITY;
        }
        touches.clear();
        body_contacts(a, b, 0.0, &mut touches);
        let overlaps = touches.iter().map(|touch| -touch.gap - fall * share);
        deepest = overlaps.fold(deepest, f64::max);
        if deepest > most {
            return f64::INFINITY;
        }
    }
    deepest
}

/// A bound from below of how deep two bodies overlap, m, as soon as it is above `enough`: twice the radius of
/// a ball about a point between their origins that lies inside both: along any normal they overlap by as
/// much. Negative where none is found, or they are no convex solids. Cost: at most [`LOOKS`]
/// distances of each.
fn certain_overlap(a: Placed<'_>, b: Placed<'_>, enough: f64) -> f64 {
    let [Some(depth_a), Some(depth_b)] = [a, b].map(depth_inside) else { return f64::NEG_INFINITY };
    let way = b.position - a.position;
    // Where both are as deep: on the way A's depth falls, and B's rises.
    let (mut near, mut far) = (0.0, 1.0);
    let mut deepest = f64::NEG_INFINITY;
    for _ in 0..LOOKS {
        let at = 0.5 * (near + far);
        let point = a.position + at * way;
        let [in_a, in_b] = [depth_a(point), depth_b(point)];
        deepest = deepest.max(2.0 * in_a.min(in_b));
        if deepest > enough {
            break;
        }
        if in_a > in_b {
            near = at;
        } else {
            far = at;
        }
    }
    deepest
}

/// How deep the centre of a body lies inside one of its convex parts, m; negative where it does in none.
fn depth_at_centre(placed: Placed<'_>) -> f64 {
    let depth = |k: usize| {
        let PlacedPart { shape, position, orientation, .. } = placed.part(k);
        let is_solid = !matches!(shape, Shape::Mesh(_) | Shape::Plane(_));
        let inside =
            || -shape.form().signed_distance(orientation.conjugate() * (placed.position - position)).value;
        if is_solid { inside() } else { f64::NEG_INFINITY }
    };
    (0..placed.form.geometry.parts.len()).map(depth).fold(f64::NEG_INFINITY, f64::max)
}

/// How deep a point of the world lies inside a body that is one convex solid, m.
fn depth_inside(placed: Placed<'_>) -> Option<impl Fn(Vec3) -> f64> {
    let [part] = &placed.form.geometry.parts[..] else { return None };
    if matches!(part.shape, Shape::Mesh(_) | Shape::Plane(_)) {
        return None;
    }
    let part = placed.part(0);
    let inverse = part.orientation.conjugate();
    Some(move |p: Vec3| -part.shape.form().signed_distance(inverse * (p - part.position)).value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::Hull;
    use crate::math::rotation_exponential;
    use crate::shape::{Cuboid, Sphere};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        /// What surely overlaps has a contact as deep.
        #[test]
        fn certain_overlaps_are_no_deeper_than_contacts(
            place in prop::array::uniform3(-0.5..0.5_f64),
            turns in prop::array::uniform2(prop::array::uniform3(-3.0..3.0_f64)),
            kinds in prop::array::uniform2(0..3_usize),
        ) {
            let point = |k: u32| {
                let (a, b) = (1.7 * f64::from(k), 2.9 * f64::from(k));
                Vec3::new(0.5 * a.sin(), 0.4 * b.cos(), 0.3 * (a + b).sin())
            };
            let shapes = [
                Shape::Hull(Hull::new(&(0..20).map(point).collect::<Vec<_>>()).unwrap().0),
                Shape::Box(Cuboid { half: Vec3::new(0.4, 0.3, 0.1) }),
                Shape::Sphere(Sphere { radius: 0.3 }),
            ];
            let forms = kinds.map(|kind| Collidable::new(Geometry::single(shapes[kind].clone()).unwrap()));
            let turns = turns.map(|turn| rotation_exponential(Vec3::from_array(turn)));
            let placed = |k: usize, position: Vec3| Placed { form: &forms[k], position, orientation: turns[k] };
            let [a, b] = [placed(0, Vec3::ZERO), placed(1, Vec3::from_array(place))];
            let mut touches = Vec::new();
            body_contacts(a, b, 0.0, &mut touches);
            let deepest = touches.iter().map(|touch| -touch.gap).fold(0.0, f64::max);
            let certain = certain_overlap(a, b, f64::INFINITY);
            prop_assert!(certain <= deepest + 1e-9, "{certain} {deepest}");
            // Of equal balls it is all of it.
            prop_assert!(kinds != [2, 2] || deepest == 0.0 || certain >= deepest - 1e-9, "{certain} {deepest}");
        }
    }
}
