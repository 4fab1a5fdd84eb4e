//! Contacts of a capsule with convex shapes and triangles.
//!
//! A capsule is a ball moved along a segment, and the distance from the points of a segment to a convex set is a convex
//! function of the point. So the nearest point is found by bisection of the derivative, and the ends of the stretch that
//! is hardly farther away than the nearest point are found by bisection of the value. Each of the three is a contact of
//! a ball with the shape, exact to round-off; together they hold a capsule that lies flat.

use super::distance::Distance;
use super::reduce::Touch;
use crate::math::Vec3;

/// Bisection halves an interval of length 2 to the last bit.
const BISECTIONS: usize = 54;

/// A stretch of the capsule counts as lying on the shape where it is at most this fraction of the radius farther away
/// than its nearest point.
const FLAT: f64 = 1e-3;

/// Contacts of the capsule with segment `centre + t * half_axis`, t in [-1, 1], against the convex shape given by its
/// signed distance, in the shape's frame. Normals point from the shape to the capsule.
pub(crate) fn capsule_contacts(
    centre: Vec3,
    half_axis: Vec3,
    radius: f64,
    distance: impl Fn(Vec3) -> Distance,
    envelope: f64,
    touches: &mut Vec<Touch>,
) {
    let at = |t: f64| distance(centre + t * half_axis);
    let nearest = minimise(|t| at(t).normal.dot(half_axis));
    let least = at(nearest).value;
    if least - radius > envelope {
        return;
    }
    let level = least + FLAT * radius;
    let ends = [-1.0, 1.0].map(|end| farthest_within(nearest, end, |t| at(t).value <= level));
    let mut taken: Vec<f64> = Vec::with_capacity(3);
    let separate = 0.05 * radius / half_axis.length();
    for (t, feature) in [(nearest, 1), (ends[0], 0), (ends[1], 2)] {
        if taken.iter().any(|other| (other - t).abs() < separate) {
            continue;
        }
        taken.push(t);
        let Distance { value, normal } = at(t);
        let gap = value - radius;
        if gap <= envelope {
            let point = centre + t * half_axis - (radius + 0.5 * gap) * normal;
            touches.push(Touch { point, normal, gap, feature });
        }
    }
}

/// Zero of an ascending function on [-1, 1], or the end nearest to it.
fn minimise(derivative: impl Fn(f64) -> f64) -> f64 {
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

/// The last t on the way from `inside` to `end` for which the predicate holds; it holds on an interval.
fn farthest_within(inside: f64, end: f64, holds: impl Fn(f64) -> bool) -> f64 {
    if holds(end) {
        return end;
    }
    let (mut within, mut beyond) = (inside, end);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (within + beyond);
        if holds(middle) { within = middle } else { beyond = middle }
    }
    within
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::collide::distance::signed_distance;
    use crate::shape::Shape;

    #[test]
    fn a_capsule_lying_across_a_box_touches_at_both_edges() {
        let block = Shape::Box { half: Vec3::new(0.5, 0.5, 0.5) };
        let mut touches = Vec::new();
        let centre = Vec3::new(0.0, 0.1, 0.5 + 0.2 + 1e-3);
        capsule_contacts(centre, 2.0 * Vec3::X, 0.2, |p| signed_distance(&block, p), 0.01, &mut touches);
        let mut x: Vec<f64> = touches.iter().map(|t| t.point.x).collect();
        x.sort_by(f64::total_cmp);
        // The ends lie where the ball is FLAT radii farther: at most sqrt(2 radius FLAT radius) beyond the edge.
        assert!(x[0] <= -0.5 + 1e-9 && x[0] > -0.52, "{x:?}");
        assert!(x[x.len() - 1] >= 0.5 - 1e-9 && x[x.len() - 1] < 0.52, "{x:?}");
        for touch in &touches {
            assert!(touch.gap >= 1e-3 - 1e-15 && touch.gap <= 1e-3 + 2.1e-4, "{touch:?}");
        }
    }

    #[test]
    fn crossed_capsules_touch_once_where_lines_are_nearest() {
        let other = Shape::Capsule { half_length: 1.0, radius: 0.3 };
        let mut touches = Vec::new();
        let centre = Vec3::new(0.2, 0.52, 0.4);
        capsule_contacts(centre, Vec3::X, 0.2, |p| signed_distance(&other, p), 0.05, &mut touches);
        assert_eq!(touches.iter().filter(|t| t.gap < 0.0201).count(), 1, "{touches:?}");
        let touch = touches.iter().min_by(|a, b| a.gap.total_cmp(&b.gap)).unwrap();
        assert!((touch.gap - 0.02).abs() < 1e-14);
        assert!((touch.normal - Vec3::Y).length() < 1e-7);
        assert!((touch.point - Vec3::new(0.0, 0.31, 0.4)).length() < 1e-7);
    }
}
