//! Contacts of a capsule with convex shapes and triangles.
//!
//! A capsule is a ball moved along a segment, and the distance s from a point to a convex set is a convex
//! function of the point. A contact of any one of the balls bounds what that ball can do: with the ball's
//! centre c moved by d, `s(c + d) >= s(c) + n . d`. The balls given are those that matter for every motion of
//! the capsule:
//!
//! * at both ends, and nearest to the shape (bisection of the derivative of s along the segment), exact to
//!   round-off;
//! * where the segment crosses from the space over one face of the shape to the space beside it
//!   (the *crossings*).
//!
//! Between two of them that lie over the same face, s is linear along the segment and so is the displacement:
//! the balls in between are held off by the two. Beside a face the nearest ball holds the segment off the
//! edge, up to terms of second order in the motion (turn times displacement).

use super::reduce::Touch;
use crate::math::Vec3;
use crate::shape::Distance;

/// Bisection halves an interval of length 2 to the last bit.
const BISECTIONS: usize = 54;

/// Balls nearer to each other than this fraction of the radius are one ball.
const SEPARATE: f64 = 0.05;

/// Feature of the ball nearest to the shape; the ends are 0 and 2.
const NEAREST: u64 = 1;

/// Feature of the first crossing.
const CROSSING: u64 = 3;

/// A ball of the capsule: where along the segment, its feature, its distance.
struct Ball {
    t: f64,
    feature: u64,
    distance: Distance,
}

/// Contacts of the capsule with segment `centre + t * half_axis`, t in [-1, 1], against the convex shape
/// given by its signed distance, in the shape's frame: all balls of the module's list with gap up to the
/// envelope, m. `crossings` holds the t of the crossings (see `Form::crossings`) in an order that persists.
/// Normals point from the shape to the capsule.
pub(crate) fn capsule_contacts(
    centre: Vec3,
    half_axis: Vec3,
    radius: f64,
    distance: impl Fn(Vec3) -> Distance,
    crossings: &[f64],
    envelope: f64,
    touches: &mut Vec<Touch>,
) {
    let at = |t: f64| distance(centre + t * half_axis);
    if least_between(&at(-1.0), &at(1.0), half_axis) > (radius + envelope) * (1.0 + 1e-9) {
        return;
    }
    let nearest = minimise(|t| at(t).normal.dot(half_axis));
    let least = at(nearest);
    if least.value - radius > envelope {
        return;
    }
    let separate = SEPARATE * radius / half_axis.length();
    // The nearest ball takes the number of an end that it is next to.
    let of_end = |t: f64| if t < 0.0 { 0 } else { 2 };
    let own = if 1.0 - nearest.abs() < separate { of_end(nearest) } else { NEAREST };
    let mut balls = vec![Ball { t: nearest, feature: own, distance: least }];
    let ends = [-1.0, 1.0].map(|t| (t, of_end(t)));
    let between = crossings.iter().zip(CROSSING..).filter(|(t, _)| t.abs() < 1.0);
    for (t, feature) in ends.into_iter().chain(between.map(|(&t, feature)| (t, feature))) {
        let distance = at(t);
        if distance.value - radius <= envelope && balls.iter().all(|other| (other.t - t).abs() >= separate) {
            balls.push(Ball { t, feature, distance });
        }
    }
    balls.sort_by(|a, b| a.t.total_cmp(&b.t));
    for (i, ball) in balls.iter().enumerate() {
        let held = i > 0 && i + 1 < balls.len() && lies_between(&balls[i - 1], ball, &balls[i + 1], radius);
        if held {
            continue;
        }
        let Distance { value, normal } = ball.distance;
        let gap = value - radius;
        let point = centre + ball.t * half_axis - (radius + 0.5 * gap) * normal;
        touches.push(Touch { point, normal, gap, feature: ball.feature });
    }
}

/// Whether a ball is held off by its neighbours: over one face, and no nearer than between them.
fn lies_between(before: &Ball, ball: &Ball, after: &Ball, radius: f64) -> bool {
    let alike = |other: &Ball| (other.distance.normal - ball.distance.normal).length() < 1e-9;
    let fraction = (ball.t - before.t) / (after.t - before.t);
    let line = before.distance.value + fraction * (after.distance.value - before.distance.value);
    alike(before) && alike(after) && ball.distance.value >= line - 1e-9 * radius
}

/// `Form::crossings` of a triangle: the planes through its edges that stand on its face.
pub(crate) fn triangle_crossings(corners: [Vec3; 3], face: Vec3, centre: Vec3, half_axis: Vec3) -> Vec<f64> {
    (0..3)
        .map(|k| {
            let across = face.cross(corners[(k + 1) % 3] - corners[k]);
            let t = across.dot(corners[k] - centre) / across.dot(half_axis);
            if t.is_finite() { t } else { f64::INFINITY }
        })
        .collect()
}

/// A bound from below of a convex distance along the segment `centre + t * half`, t in [-1, 1], from its
/// values and gradients at both ends: where the tangents cross, m.
pub(crate) fn least_between(at_p: &Distance, at_q: &Distance, half: Vec3) -> f64 {
    let (down, up) = (2.0 * at_p.normal.dot(half), 2.0 * at_q.normal.dot(half));
    if down >= 0.0 {
        return at_p.value;
    }
    if up <= 0.0 {
        return at_q.value;
    }
    // value_p + s down = value_q - (1 - s) up.
    let s = (at_q.value - up - at_p.value) / (down - up);
    at_p.value + s.clamp(0.0, 1.0) * down
}

/// Zero of an ascending function on [-1, 1], or the end nearest to it.
pub(crate) fn minimise(derivative: impl Fn(f64) -> f64) -> f64 {
    if derivative(-1.0) >= 0.0 && derivative(1.0) >= 0.0 {
        // Ascending from the start, or flat: a flat function is least everywhere, so take its middle.
        if derivative(0.0) > 0.0 || derivative(1.0) > 0.0 { return -1.0 } else { return 0.0 }
    }
    if derivative(1.0) <= 0.0 {
        return 1.0;
    }
    let (mut low, mut high) = (-1.0, 1.0);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if derivative(middle) < 0.0 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::{Capsule, Cuboid, Shape};

    fn contacts(shape: &Shape, centre: Vec3, half_axis: Vec3, radius: f64, envelope: f64) -> Vec<Touch> {
        let mut touches = Vec::new();
        let borders = shape.form().crossings(centre, half_axis);
        let distance = |p| shape.form().signed_distance(p);
        capsule_contacts(centre, half_axis, radius, distance, &borders, envelope, &mut touches);
        touches
    }

    #[test]
    fn a_capsule_lying_across_a_box_touches_at_both_edges() {
        let block = Shape::Box(Cuboid { half: Vec3::new(0.5, 0.5, 0.5) });
        let centre = Vec3::new(0.0, 0.1, 0.5 + 0.2 + 1e-3);
        let touches = contacts(&block, centre, 2.0 * Vec3::X, 0.2, 0.01);
        let mut x: Vec<f64> = touches.iter().map(|t| t.point.x).collect();
        x.sort_by(f64::total_cmp);
        assert_eq!(x.len(), 2);
        assert!((x[0] + 0.5).abs() < 1e-12 && (x[1] - 0.5).abs() < 1e-12, "{x:?}");
        for touch in &touches {
            assert!((touch.gap - 1e-3).abs() < 1e-15, "{touch:?}");
        }
    }

    #[test]
    fn crossed_capsules_touch_once_where_lines_are_nearest() {
        let other = Shape::Capsule(Capsule { half_length: 1.0, radius: 0.3 });
        let touches = contacts(&other, Vec3::new(0.2, 0.52, 0.4), Vec3::X, 0.2, 0.05);
        assert_eq!(touches.len(), 1, "{touches:?}");
        let touch = touches[0];
        assert!((touch.gap - 0.02).abs() < 1e-14);
        assert!((touch.normal - Vec3::Y).length() < 1e-7);
        assert!((touch.point - Vec3::new(0.0, 0.31, 0.4)).length() < 1e-7);
    }

    #[test]
    fn the_far_end_of_a_tilted_capsule_is_a_contact_when_the_envelope_reaches_it() {
        let block = Shape::Box(Cuboid { half: Vec3::splat(1.0) });
        let (half_length, radius) = (0.02_f64, 0.01);
        for tilt in [1.0_f64, 30.0, 60.0, 80.0].map(f64::to_radians) {
            let half_axis = half_length * Vec3::new(tilt.sin(), 0.0, tilt.cos());
            let centre = Vec3::new(0.1, 0.2, 1.0 + radius + 1e-3 + half_axis.z);
            let rise = 2.0 * half_axis.z;
            for (envelope, expected) in [(1e-3 + 1e-9, 1), (1e-3 + rise + 1e-9, 2)] {
                let touches = contacts(&block, centre, half_axis, radius, envelope);
                assert_eq!(touches.len(), expected, "{touches:?}");
            }
            let touches = contacts(&block, centre, half_axis, radius, 1.0);
            assert_eq!(touches.iter().map(|t| t.feature).collect::<Vec<_>>(), [0, 2]);
            assert!((touches[0].gap - 1e-3).abs() < 1e-15 && (touches[1].gap - 1e-3 - rise).abs() < 1e-15);
            assert!(touches.iter().all(|touch| (touch.normal - Vec3::Z).length() < 1e-14));
        }
    }

    #[test]
    fn a_capsule_over_an_edge_has_its_end_beside_the_box_and_its_ball_over_the_edge() {
        let block = Shape::Box(Cuboid { half: Vec3::splat(1.0) });
        // Low end over the face, high end 0.5 beyond the edge x = 1 and 0.5 above it.
        let touches = contacts(&block, Vec3::new(1.0, 0.0, 1.4), Vec3::new(0.5, 0.0, 0.1), 0.1, 1.0);
        let gaps: Vec<f64> = touches.iter().map(|t| t.gap).collect();
        let expected = [0.3 - 0.1, 0.4 - 0.1, 0.5_f64.hypot(0.5) - 0.1];
        assert_eq!(gaps.len(), 3, "{touches:?}");
        for (gap, expected) in gaps.iter().zip(expected) {
            assert!((gap - expected).abs() < 1e-12, "{touches:?}");
        }
        assert!((touches[2].normal - Vec3::new(0.5, 0.0, 0.5).normalize()).length() < 1e-12);
    }
}
