//! When two moving bodies meet within a step, and the contact that lets them arrive there.
//!
//! **Time.** Conservative advancement (Mirtich 1996), part by part: at the poses of time t the parts are a
//! distance d apart, they close it at most at a known rate, so they do not touch before t + d / rate. Bodies
//! move as the step moves them: x + t u, exp(t w / 2) Q. For convex parts with nearest points along n the
//! rate is `-n . (u_A - u_B) + |w_A x n| R_A + |w_B x n| R_B`, R the distance of a part's farthest point from
//! its body's centre: the plane between them with normal n keeps the bodies apart for as long
//! ([`separation`]). A mesh is met triangle by triangle. Two balls, and a ball and a plane that does not
//! turn, have closed forms.
//!
//! **Contact.** See [`arrivals`].

use super::manifold::Solid;
use super::mesh::TriangleTree;
use super::narrow::{Placed, PlacedPart, body_contacts, unit_and_origin};
use super::reduce::Touch;
use super::separation::separation;
use crate::math::{Vec3, rotation_exponential};
use crate::shape::{HalfSpace, Shape};

/// Poses looked at per pair of parts at most. What is then left of the gap is part of the contact; the time
/// is too early.
const POSES: usize = 256;

/// Chords of a gap looked at per pose at most.
const CHORDS: usize = 6;

/// Contacts at an impact are looked for up to so many sizes away.
const FARTHEST: f64 = 64.0;

/// Parts touch at a gap of this fraction of the smaller one's size.
const TOUCHING: f64 = 1e-7;

/// Two bodies that meet.
#[derive(Clone, Debug)]
pub(crate) struct Impact {
    /// Time from the start of the step, s, in [0, step].
    pub time: f64,
    /// Contacts at the poses of that time: the one that touches, and others within the envelope.
    pub touches: Vec<Touch>,
}

/// A contact at the poses of a later time, for the problem of the step that begins now.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arrival {
    /// Contact point (midway between the two below), normal at impact, gap Phi'.
    pub touch: Touch,
    /// The point of A's surface that touches, carried back with A's centre, m.
    pub on_a: Vec3,
    /// The point of B's surface that touches, carried back with B's centre, m.
    pub on_b: Vec3,
}

/// When bodies A and B with constant velocities (u, w), m/s and rad/s in world axes, first touch within
/// `step` seconds; `None` if they do not. Bodies that overlap touch at time 0. Contacts with gap up to the
/// envelope, m, at the poses of that time come with it. Cost: one plane between them per pose, a few
/// and at most 256 per pair of parts, or part and triangle of a mesh around its way; one narrow phase where
/// they meet.
pub(crate) fn time_of_impact(
    a: Placed<'_>,
    b: Placed<'_>,
    velocity_a: [Vec3; 2],
    velocity_b: [Vec3; 2],
    step: f64,
    envelope: f64,
) -> Option<Impact> {
    let time = first_time([a, b], [velocity_a, velocity_b], step, None)?;
    let (a, b) = (advanced(a, velocity_a, time), advanced(b, velocity_b, time));
    let size = a.form.bounding_radius.min(b.form.bounding_radius);
    let mut touches = Vec::new();
    let mut reach = envelope.max(10.0 * TOUCHING * size);
    // Where the poses ran out, a gap is left.
    while touches.is_empty() && reach <= FARTHEST * size.max(envelope) {
        body_contacts(a, b, reach, &mut touches);
        reach *= 2.0;
    }
    Some(Impact { time, touches })
}

/// Whether bodies A and B with constant velocities (u, w) come as near as `reach`, m, within `step` seconds.
/// Cost as that of [`time_of_impact`].
pub(super) fn comes_within(
    bodies: [Placed<'_>; 2],
    velocities: [[Vec3; 2]; 2],
    step: f64,
    reach: f64,
) -> bool {
    first_time(bodies, velocities, step, Some(reach)).is_some()
}

/// When two bodies are first as near as `reach`, m, or touch.
fn first_time(
    [a, b]: [Placed<'_>; 2],
    mut velocities: [[Vec3; 2]; 2],
    step: f64,
    reach: Option<f64>,
) -> Option<f64> {
    if let Some(known) = closed_form(a, b, velocities, reach.unwrap_or(0.0)) {
        return known.filter(|&time| time <= step);
    }
    // A ball turns in itself.
    for (body, velocity) in [a, b].into_iter().zip(&mut velocities) {
        if body.form.ball.is_some() {
            velocity[1] = Vec3::ZERO;
        }
    }
    let mut earliest = None;
    for part_a in 0..a.form.geometry.parts.len() {
        for part_b in 0..b.form.geometry.parts.len() {
            let until = earliest.unwrap_or(step);
            let pair = Pair { bodies: [a, b], parts: [part_a, part_b], velocities, reach };
            earliest = pair.time_of_impact(until).or(earliest);
        }
    }
    earliest
}

/// Contacts at the impact, linearised from there for the step that begins now. With velocities kept, the gap
/// of a contact at time t' is g + (t' - t) u_n, where t is the time of impact, g the gap found there (zero
/// but for round-off at the touching one) and u_n = n . (u_A + w_A x r_A - u_B - w_B x r_B) < 0 with the arms
/// at impact. So
///
/// ```text
/// Phi' = g - t u_n
/// ```
///
/// and the step's constraint Phi' / dt + u_n+ >= 0 lets the bodies come as near in the whole step as they do
/// until t: they arrive and do not pass. A contact that opens (u_n >= 0) keeps Phi' = g. The points are those
/// of the surfaces at impact, carried back with the centres of the bodies but not turned back, so that the
/// arms are those of the impact and n . (relative velocity) of a [`Touch`] made of them is u_n. While the
/// bodies are apart no single point has both arms: `touch.point` lies midway, and for a pair that moves past
/// each other only `on_a` and `on_b` have the right arms.
pub(crate) fn arrivals(
    impact: &Impact,
    a: Placed<'_>,
    b: Placed<'_>,
    velocity_a: [Vec3; 2],
    velocity_b: [Vec3; 2],
) -> Vec<Arrival> {
    let time = impact.time;
    let arrival = |touch: &Touch| {
        let half = 0.5 * touch.gap * touch.normal;
        let on_a = touch.point + half - time * velocity_a[0];
        let on_b = touch.point - half - time * velocity_b[0];
        let surface = |[u, w]: [Vec3; 2], arm: Vec3| u + w.cross(arm);
        let relative = surface(velocity_a, on_a - a.position) - surface(velocity_b, on_b - b.position);
        let gap = touch.gap - time * touch.normal.dot(relative).min(0.0);
        Arrival { touch: Touch { point: 0.5 * (on_a + on_b), gap, ..*touch }, on_a, on_b }
    };
    impact.touches.iter().map(arrival).collect()
}

/// Pose after `time` seconds, as the step moves bodies.
pub(crate) fn advanced<'a>(body: Placed<'a>, [u, w]: [Vec3; 2], time: f64) -> Placed<'a> {
    let mut moved = Placed { position: body.position + time * u, ..body };
    if w != Vec3::ZERO {
        moved.orientation = (rotation_exponential(time * w) * body.orientation).normalize();
    }
    moved
}

/// Two balls, or a ball and a plane that does not turn: `Some(time)` of being as near as `reach`,
/// `Some(None)` if they never are.
fn closed_form(
    a: Placed<'_>,
    b: Placed<'_>,
    [velocity_a, velocity_b]: [[Vec3; 2]; 2],
    reach: f64,
) -> Option<Option<f64>> {
    let approach = velocity_a[0] - velocity_b[0];
    let apart = a.position - b.position;
    match (a.form.ball, b.form.ball) {
        (Some(r_a), Some(r_b)) => Some(first_touch_of_balls(apart, approach, r_a + r_b + reach)),
        (Some(radius), None) => ball_and_plane(radius + reach, apart, approach, b, velocity_b[1]),
        (None, Some(radius)) => ball_and_plane(radius + reach, -apart, -approach, a, velocity_a[1]),
        (None, None) => None,
    }
}

/// When |apart + t approach| is first the sum of the radii, t >= 0: the earlier root, without cancellation.
pub(super) fn first_touch_of_balls(apart: Vec3, approach: Vec3, radii: f64) -> Option<f64> {
    let constant = apart.length_squared() - radii * radii;
    let linear = apart.dot(approach);
    let discriminant = linear * linear - approach.length_squared() * constant;
    if constant <= 0.0 {
        Some(0.0)
    } else if linear >= 0.0 || discriminant < 0.0 {
        None
    } else {
        Some(constant / (discriminant.sqrt() - linear))
    }
}

fn ball_and_plane(
    radius: f64,
    apart: Vec3,
    approach: Vec3,
    plane: Placed<'_>,
    spin: Vec3,
) -> Option<Option<f64>> {
    let [part] = plane.form.geometry.parts.as_slice() else { return None };
    if part.shape != Shape::Plane(HalfSpace) || spin != Vec3::ZERO {
        return None;
    }
    let normal = plane.orientation * (part.orientation * Vec3::Z);
    let gap = normal.dot(apart - plane.orientation * part.position) - radius;
    let closing = -normal.dot(approach);
    Some(if gap <= 0.0 {
        Some(0.0)
    } else if closing > 0.0 {
        Some(gap / closing)
    } else {
        None
    })
}

/// One part of each body.
struct Pair<'a> {
    bodies: [Placed<'a>; 2],
    parts: [usize; 2],
    velocities: [[Vec3; 2]; 2],
    /// How near they are to come, m; to touch where there is none.
    reach: Option<f64>,
}

impl Pair<'_> {
    fn time_of_impact(&self, step: f64) -> Option<f64> {
        if !self.size().is_finite() {
            return None;
        }
        let is_bounded = |k: usize| self.bodies[k].form.part_radius[self.parts[k]].is_finite();
        match [0, 1].map(|k| self.bodies[k].form.trees[self.parts[k]].as_ref()) {
            [Some(_), Some(_)] => None,
            [Some(tree), None] if is_bounded(1) => self.meets_mesh((0, tree), step),
            [None, Some(tree)] if is_bounded(0) => self.meets_mesh((1, tree), step),
            // A plane meets the corners of a mesh.
            _ => self.advance(None, [0.0, step]),
        }
    }

    /// Triangle by triangle; of those within some sizes at a time, or all that lie around a long way would be
    /// many.
    fn meets_mesh(&self, (mesh, tree): (usize, &TriangleTree), step: f64) -> Option<f64> {
        let whole = self.rate(None, &self.placed(0.0), step) * step;
        let spans = (whole / (8.0 * self.size())).clamp(1.0, 16.0).ceil();
        (0..spans as u32).find_map(|span| {
            let [from, until] = [0, 1].map(|end| step * f64::from(span + end) / spans);
            let parts = self.placed_parts(&self.placed(from));
            let near = tree.near(&parts[1 - mesh].visitor(&parts[mesh]), whole / spans + self.touching());
            let first = |earliest: Option<f64>, corners: &[Vec3; 3]| {
                self.advance(Some((mesh, corners)), [from, earliest.unwrap_or(until)]).or(earliest)
            };
            near.iter().fold(None, first)
        })
    }

    /// When convex parts, or one and a triangle of the other, are first so near, s.
    fn advance(&self, triangle: Option<(usize, &[Vec3; 3])>, [from, until]: [f64; 2]) -> Option<f64> {
        let touching = self.touching();
        let mut time = from;
        for _ in 0..POSES {
            let bodies = self.placed(time);
            let parts = self.placed_parts(&bodies);
            let mut solids = parts.each_ref().map(PlacedPart::solid);
            if let Some((mesh, corners)) = triangle {
                let PlacedPart { position, orientation, .. } = parts[mesh];
                let corners = corners.map(|corner| position + orientation * corner);
                solids[mesh] = Solid::Triangle { corners, open: [false; 3] };
            }
            let (unit, origin) = unit_and_origin(&parts[0], &parts[1]);
            let far = self.rate(None, &bodies, until - time) * (until - time) + touching;
            let apart = separation(solids, unit, origin, far).filter(|(gap, _)| *gap > touching);
            let Some((gap, normal)) = apart else { return Some(time) };
            time += self.wait((gap, normal), (bodies, solids), until - time)?;
        }
        Some(time)
    }

    /// The bodies after some time.
    fn placed(&self, time: f64) -> [Placed<'_>; 2] {
        [0, 1].map(|k| advanced(self.bodies[k], self.velocities[k], time))
    }

    fn placed_parts<'a>(&self, bodies: &[Placed<'a>; 2]) -> [PlacedPart<'a>; 2] {
        [0, 1].map(|k| bodies[k].part(self.parts[k]))
    }

    /// Radius of the ball around the smaller part, m.
    fn size(&self) -> f64 {
        [0, 1]
            .map(|k| self.bodies[k].form.part_radius[self.parts[k]])
            .into_iter()
            .fold(f64::INFINITY, f64::min)
    }

    /// The gap at which the parts are near enough, m.
    fn touching(&self) -> f64 {
        self.reach.unwrap_or(0.0) + TOUCHING * self.size()
    }

    /// How long a plane with this normal keeps the solids as far apart as they have to be, nearly, s; `None`
    /// if in all of `rest`, s. At time tau points of A have moved along n by no less than
    /// `tau n . (u + w x r) - tau^2 |n x w| |w| R / 2`, so that the gap along n is at least
    ///
    /// ```text
    /// G(tau) = min over A of n . x + tau (n . u_A + (n x w_A) . r_A) - (max over B of the same)
    ///          - tau^2 (|n x w_A| |w_A| R_A + |n x w_B| |w_B| R_B) / 2,
    /// ```
    ///
    /// a concave function: a chord of it lies below it.
    fn wait(
        &self,
        (gap, n): (f64, Vec3),
        (bodies, solids): ([Placed<'_>; 2], [Solid<'_>; 2]),
        rest: f64,
    ) -> Option<f64> {
        let target = self.reach.unwrap_or(0.0);
        let rate = self.rate(Some(n), &bodies, rest);
        if rate * rest <= gap - target {
            return None;
        }
        let wait = (gap - target) / rate;
        let arms = self.arms();
        let turns = |k: usize| self.velocities[k][1] != Vec3::ZERO;
        if (0..2).any(|k| turns(k) && !arms[k].is_finite()) {
            return Some(wait);
        }
        // How far the foremost points of each have moved along n at least, away from the other.
        let moved = |k: usize, tau: f64| {
            let ([u, w], sign) = (self.velocities[k], [1.0, -1.0][k]);
            let turn = tau * n.cross(w);
            let turned = if turns(k) {
                let bend = 0.5 * tau * turn.length() * w.length() * arms[k];
                let farther = solids[k].reach(-sign * (n + turn)) - solids[k].reach(-sign * n);
                -farther - sign * turn.dot(bodies[k].position) - bend
            } else {
                0.0
            };
            sign * tau * n.dot(u) + turned
        };
        let above = |tau: f64| gap - target + moved(0, tau) + moved(1, tau);
        let (mut kept, mut lost) = ((wait, above(wait)), (rest, above(rest)));
        if lost.1 >= 0.0 {
            return None;
        }
        for _ in 0..CHORDS {
            if kept.1 <= 0.0 {
                break;
            }
            let chord = (lost.0 - kept.0) * kept.1 / (kept.1 - lost.1);
            for tau in [kept.0 + chord, kept.0 + 2.0 * chord] {
                if tau < lost.0 {
                    let height = above(tau);
                    *(if height >= 0.0 { &mut kept } else { &mut lost }) = (tau, height);
                }
            }
            if lost.0 - kept.0 < 0.01 * lost.0 {
                break;
            }
        }
        Some(kept.0)
    }

    /// Distance of the farthest point of each part from the centre of its body, which may lie outside it, m.
    fn arms(&self) -> [f64; 2] {
        std::array::from_fn(|k| {
            let form = self.bodies[k].form;
            form.geometry.parts[self.parts[k]].position.length() + form.part_radius[self.parts[k]]
        })
    }

    /// How fast the parts may come nearer, m/s, during the next `remaining` seconds: along a normal that
    /// separates them, or at all.
    fn rate(&self, along: Option<Vec3>, poses: &[Placed<'_>; 2], remaining: f64) -> f64 {
        let reach = self.arms();
        let [[u_a, w_a], [u_b, w_b]] = self.velocities;
        let approach = u_a - u_b;
        // A turning plane: its points near the other body, wherever that goes in the time that remains.
        for (k, other, w) in [(0, 1, w_a), (1, 0, w_b)] {
            if !reach[k].is_finite() && w != Vec3::ZERO {
                let far = (poses[0].position - poses[1].position).length() + approach.length() * remaining;
                let own = self.velocities[other][1].length() * reach[other];
                return approach.length() + own + w.length() * (far + reach[other]);
            }
        }
        let turn = |w: Vec3, reach: f64| match along {
            _ if w == Vec3::ZERO => 0.0,
            Some(normal) => w.cross(normal).length() * reach,
            None => w.length() * reach,
        };
        let straight = along.map_or(approach.length(), |normal| -normal.dot(approach));
        straight + turn(w_a, reach[0]) + turn(w_b, reach[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::collide::narrow::Collidable;
    use crate::math::Quat;
    use crate::shape::Sphere;
    use crate::shape::{Geometry, Part};
    use proptest::prelude::*;

    fn form(geometry: Geometry) -> Collidable {
        Collidable::new(geometry)
    }

    fn placed(form: &Collidable, position: Vec3) -> Placed<'_> {
        Placed { form, position, orientation: Quat::IDENTITY }
    }

    /// Time of impact, and a check that the linearised constraint lets the bodies arrive exactly: with
    /// velocities scaled to Phi' + step u_n = 0, the poses at the end are those of the impact.
    fn meet(a: Placed<'_>, b: Placed<'_>, u_a: Vec3, u_b: Vec3, step: f64) -> Option<f64> {
        let impact = time_of_impact(a, b, [u_a, Vec3::ZERO], [u_b, Vec3::ZERO], step, 0.0)?;
        let arrivals = arrivals(&impact, a, b, [u_a, Vec3::ZERO], [u_b, Vec3::ZERO]);
        assert!(!arrivals.is_empty());
        for Arrival { touch, .. } in arrivals {
            let closing = -touch.normal.dot(u_a - u_b);
            assert!((touch.gap - impact.time * closing).abs() < 1e-8, "{touch:?}");
            let slower = touch.gap / (step * closing);
            let (a, b) = (
                advanced(a, [slower * u_a, Vec3::ZERO], step),
                advanced(b, [slower * u_b, Vec3::ZERO], step),
            );
            let mut at_end = Vec::new();
            body_contacts(a, b, 1e-6, &mut at_end);
            let least = at_end.iter().map(|t| t.gap).fold(f64::INFINITY, f64::min);
            assert!(least.abs() < 1e-8, "{least}");
        }
        Some(impact.time)
    }

    #[test]
    fn small_fast_spheres_meet_head_on_and_miss_each_other() {
        let ball = form(Geometry::sphere(2e-3).unwrap());
        let (a, b) = (placed(&ball, Vec3::ZERO), placed(&ball, Vec3::new(1.0, 0.0, 0.0)));
        let fast = 50.0 * Vec3::X;
        let time = meet(a, b, fast, -fast, 0.02).unwrap();
        assert!((time - 0.996 / 100.0).abs() < 1e-15);
        assert_eq!(meet(a, b, fast, -fast, 5e-3), None);
        let beside = placed(&ball, Vec3::new(1.0, 4.001e-3, 0.0));
        assert_eq!(meet(a, beside, fast, -fast, 0.02), None);
        assert!(meet(a, placed(&ball, Vec3::new(1.0, 3.999e-3, 0.0)), fast, -fast, 0.02).is_some());
        // In overlap from the start, even if they part.
        let inside = placed(&ball, Vec3::new(3e-3, 0.0, 0.0));
        let velocities = [[-fast, Vec3::ZERO], [fast, Vec3::ZERO]];
        let impact = time_of_impact(a, inside, velocities[0], velocities[1], 0.02, 0.0).unwrap();
        let touch = arrivals(&impact, a, inside, velocities[0], velocities[1])[0].touch;
        assert!(impact.time == 0.0 && (touch.gap + 1e-3).abs() < 1e-15);
    }

    /// What ends within the reach without a touch, and what passes within it between two poses far from it.
    #[test]
    fn bodies_come_within_a_reach_that_is_no_touch() {
        let (ball, capsule) =
            (form(Geometry::sphere(0.2).unwrap()), form(Geometry::capsule(0.4, 0.2).unwrap()));
        let rest = [Vec3::ZERO; 2];
        let above = placed(&ball, Vec3::new(0.5, 0.0, 0.0));
        let near = |from: Placed<'_>, u: Vec3, step: f64, reach: f64| {
            comes_within([from, placed(&capsule, Vec3::ZERO)], [[u, Vec3::ZERO], rest], step, reach)
        };
        assert!(near(above, -Vec3::X, 0.07, 0.05));
        assert!(!near(above, -Vec3::X, 0.04, 0.05));
        let beside = placed(&ball, Vec3::new(1.5, 0.428, 0.0));
        assert!(near(beside, -Vec3::X, 3.0, 0.03));
        assert!(!near(beside, -Vec3::X, 3.0, 0.027));
    }

    #[test]
    fn a_small_fast_sphere_does_not_pass_a_plate_a_plane_or_a_mesh() {
        let ball = form(Geometry::sphere(1e-3).unwrap());
        let plate = form(Geometry::cuboid(Vec3::new(1.0, 1.0, 1e-3)).unwrap());
        let plane = form(Geometry::plane());
        let corners = vec![Vec3::ZERO, 2.0 * Vec3::X, 2.0 * Vec3::ONE.with_z(0.0), 2.0 * Vec3::Y];
        let mesh = form(Geometry::mesh(corners, vec![[0, 1, 2], [0, 2, 3]]).unwrap());
        let fast = Vec3::new(30.0, 10.0, -100.0);
        let start = Vec3::new(0.1, 0.2, 0.3);
        for (target, surface) in [(&plate, 1e-3), (&plane, 0.0), (&mesh, 0.0)] {
            let (a, b) = (placed(&ball, start), placed(target, Vec3::ZERO));
            let time = meet(a, b, fast, Vec3::ZERO, 5e-3).unwrap();
            assert!((time - (0.3 - 1e-3 - surface) / 100.0).abs() < 1e-11, "{time}");
            assert_eq!(meet(a, b, fast, Vec3::ZERO, 2.9e-3), None);
            assert_eq!(meet(a, b, fast.with_z(0.1), Vec3::ZERO, 5e-3), None);
            // The other way round.
            let turned = meet(b, a, Vec3::ZERO, fast, 5e-3).unwrap();
            assert!((turned - time).abs() < 1e-11);
        }
        let past = placed(&ball, Vec3::new(1.001 + 1e-6, 0.0, 0.3));
        assert_eq!(meet(past, placed(&plate, Vec3::ZERO), -100.0 * Vec3::Z, Vec3::ZERO, 5e-3), None);
    }

    #[test]
    fn a_mesh_meets_a_plane_with_its_lowest_corner() {
        let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        let (mesh, plane) = (
            form(Geometry::mesh(corners, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap()),
            form(Geometry::plane()),
        );
        let (above, floor) = (placed(&mesh, 2.0 * Vec3::Z), placed(&plane, Vec3::ZERO));
        let down = -100.0 * Vec3::Z;
        for time in [meet(above, floor, down, Vec3::ZERO, 0.05), meet(floor, above, Vec3::ZERO, down, 0.05)] {
            assert!((time.unwrap() - 0.02).abs() < 1e-9, "{time:?}");
        }
        assert_eq!(meet(above, floor, down, Vec3::ZERO, 0.019), None);
    }

    #[test]
    fn a_spinning_bar_hits_a_ball_that_it_sweeps_over() {
        let bar = form(Geometry::cuboid(Vec3::new(0.5, 0.02, 0.02)).unwrap());
        let ball = form(Geometry::sphere(0.05).unwrap());
        let spin = 300.0 * Vec3::Z;
        let (a, b) = (placed(&bar, Vec3::ZERO), placed(&ball, 0.3 * Vec3::Y));
        let rest = [Vec3::ZERO; 2];
        let impact = time_of_impact(a, b, [Vec3::ZERO, spin], rest, 5e-3, 0.0).unwrap();
        let expected = (0.07_f64 / 0.3).acos() / 300.0;
        assert!((impact.time - expected).abs() < 1e-9, "{} {expected}", impact.time);
        let arrival = arrivals(&impact, a, b, [Vec3::ZERO, spin], rest)[0];
        // The point of the bar that hits moves across the bar, where the ball's foot lies along it.
        let along = (0.09_f64 - 0.07 * 0.07).sqrt();
        assert!((arrival.touch.gap - impact.time * 300.0 * along).abs() < 1e-5, "{arrival:?}");
        assert!((arrival.on_a.length() - along.hypot(0.02)).abs() < 1e-6);
        // The ball's radius leads from its centre to the point, against the normal from the ball to the bar.
        assert!((arrival.on_b - b.position - 0.05 * arrival.touch.normal).length() < 1e-6);
        let far = placed(&ball, 0.56 * Vec3::Y);
        assert!(time_of_impact(a, far, [Vec3::ZERO, spin], rest, 5e-3, 0.0).is_none());
    }

    fn stone() -> Vec<Vec3> {
        let point = |k: u32| {
            let (a, b) = (1.7 * f64::from(k), 2.9 * f64::from(k));
            Vec3::new(0.4 * a.sin(), 0.3 * b.cos(), 0.25 * (a + b).sin())
        };
        (0..14).map(point).collect()
    }

    fn forms() -> Vec<Collidable> {
        let part = |x: f64| Part {
            shape: Shape::Sphere(Sphere { radius: 0.2 }),
            position: Vec3::new(x, 0.0, 0.0),
            orientation: Quat::IDENTITY,
        };
        let v = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
        let triangles = vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        [
            Geometry::sphere(0.3),
            Geometry::cuboid(Vec3::new(0.4, 0.3, 0.01)),
            Geometry::capsule(0.4, 0.1),
            Geometry::cylinder(0.3, 0.2),
            Geometry::compound(vec![part(-0.4), part(0.4)]).map(|(geometry, _)| geometry),
            Geometry::mesh(v.map(|p| 0.3 * Vec3::from_array(p)).to_vec(), triangles),
            Geometry::hull(&stone()).map(|(geometry, _)| geometry),
        ]
        .map(|geometry| form(geometry.unwrap()))
        .into_iter()
        .collect()
    }

    proptest! {
        /// Against the first of 1000 poses at which the bodies overlap.
        #[test]
        fn no_sampled_pose_overlaps_before_the_time_of_impact(
            which in prop::array::uniform2(0..7_usize),
            place in prop::array::uniform3(-1.0..1.0_f64),
            turns in prop::array::uniform2(prop::array::uniform3(-2.0..2.0_f64)),
            u in prop::array::uniform3(-1.0..1.0_f64),
            spins in prop::array::uniform2(prop::array::uniform3(-30.0..30.0_f64)),
        ) {
            prop_assume!(which != [5, 5]);
            let forms = forms();
            let orientation = turns.map(|turn| rotation_exponential(Vec3::from_array(turn)));
            let position = 1.5 * Vec3::from_array(place).normalize_or(Vec3::X);
            let a = Placed { form: &forms[which[0]], position, orientation: orientation[0] };
            let b = Placed { form: &forms[which[1]], position: Vec3::ZERO, orientation: orientation[1] };
            let velocity_a = [20.0 * (Vec3::from_array(u) - position), Vec3::from_array(spins[0])];
            let velocity_b = [Vec3::ZERO, Vec3::from_array(spins[1])];
            let step = 0.1;
            let least = |time: f64| {
                let mut touches = Vec::new();
                body_contacts(advanced(a, velocity_a, time), advanced(b, velocity_b, time), 1e-3, &mut touches);
                touches.iter().map(|t| t.gap).fold(f64::INFINITY, f64::min)
            };
            let impact = time_of_impact(a, b, velocity_a, velocity_b, step, 0.0);
            let until = impact.as_ref().map_or(step, |impact| impact.time);
            // Of a mesh, bodies may be on either side, so only its first touch tells.
            for k in 0..=1000 {
                let time = until * f64::from(k) / 1000.0;
                prop_assert!(least(time) >= -1e-5, "{:?} {} {}", impact, time, least(time));
            }
            let reach = 0.03;
            let nearest = |time: f64| {
                let mut touches = Vec::new();
                body_contacts(advanced(a, velocity_a, time), advanced(b, velocity_b, time), 2.0 * reach, &mut touches);
                touches.iter().map(|t| t.gap).fold(f64::INFINITY, f64::min)
            };
            let nearest = (0..=1000).map(|k| nearest(step * f64::from(k) / 1000.0)).fold(f64::INFINITY, f64::min);
            if comes_within([a, b], [velocity_a, velocity_b], step, reach) {
                // Between two samples points move by less.
                prop_assert!(nearest <= reach + 0.01, "{nearest}");
            } else {
                prop_assert!(nearest >= reach - 1e-5, "{nearest}");
            }
            if let Some(impact) = impact {
                prop_assert!(least(impact.time) <= 1e-6, "{:?} {}", impact, least(impact.time));
            }
        }
    }
}
