//! Contact reduction: the points that a patch of contact needs.

use crate::math::{Vec3, tangents};
use graintrain_linalg::real;
use std::collections::HashMap;

/// Where two shapes touch, as found by a kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Touch {
    /// Midway between the two surfaces, m.
    pub point: Vec3,
    /// Unit normal from B to A.
    pub normal: Vec3,
    /// Signed distance, m.
    pub gap: f64,
    /// Which features of the pair touch; the same from step to step.
    pub feature: u64,
}

/// Normals within about 18 degrees belong to one patch.
pub(crate) const SAME_PATCH: f64 = 0.95;

/// Points nearer to each other than this fraction of the patch's extent are one point.
const SAME_POINT: f64 = 1e-3;

/// By this fraction of their coordinates rounding moves points.
const ROUNDING: f64 = 1e-13;

/// Points among which each is held against each to find those that coincide.
const FEW: usize = 64;

/// Contacts with which a patch begins: enough to fix the position and tilt of a face that lies on another.
const KEPT: usize = 4;

/// Contacts kept per patch at most: the corners in which two four-sided faces overlap.
const MOST: usize = 8;

/// A point may lie this fraction of the patch's extent beyond the hull of the kept ones and be dropped.
const BEYOND: f64 = 0.02;

/// A point may be nearer than the kept ones say by this fraction of the patch's extent and be dropped.
const NEARER: f64 = 1e-4;

/// Splits the touches of one pair of parts into patches of like normals. Of each it keeps the deepest point,
/// the one farthest from it, the one farthest from the line through both, and the one farthest on the line's
/// other side; and, up to eight, those that the kept ones do not hold off, the deepest first, of equals the
/// one that lies lowest below the kept ones: with one normal n, the constraint of a point is linear in its
/// place in the patch and its gap, so a point is held off if it lies above the lower hull of the kept ones
/// over the patch. Ordered by feature; features are made unique.
pub(crate) fn reduce(touches: &mut Vec<Touch>) {
    if touches.len() > 1 {
        // Total order: the result must not depend on the order in which a kernel reports.
        touches.sort_by(|a, b| a.gap.total_cmp(&b.gap).then(a.feature.cmp(&b.feature)));
        let mut patches: Vec<Vec<Touch>> = Vec::new();
        for touch in touches.drain(..) {
            match patches.iter_mut().find(|patch| patch[0].normal.dot(touch.normal) >= SAME_PATCH) {
                Some(patch) => patch.push(touch),
                None => patches.push(vec![touch]),
            }
        }
        for patch in &mut patches {
            remove_duplicates(patch);
            keep_four(patch);
            touches.append(patch);
        }
        touches.sort_by(|a, b| a.feature.cmp(&b.feature).then(a.gap.total_cmp(&b.gap)));
        for i in 1..touches.len() {
            if touches[i].feature <= touches[i - 1].feature {
                touches[i].feature = touches[i - 1].feature.saturating_add(1);
            }
        }
    }
}

/// Of points that coincide keeps the first, which is the deepest.
fn remove_duplicates(patch: &mut Vec<Touch>) {
    let extent = patch.iter().map(|t| (t.point - patch[0].point).length()).fold(0.0, f64::max);
    let apart = (SAME_POINT * extent).max(ROUNDING * patch[0].point.abs().max_element());
    if patch.len() > FEW && apart > 0.0 {
        remove_duplicates_among_many(patch, apart);
        return;
    }
    let mut kept: Vec<Vec3> = Vec::with_capacity(patch.len());
    patch.retain(|touch| {
        let is_new = kept.iter().all(|k| (*k - touch.point).length() > apart);
        if is_new {
            kept.push(touch.point);
        }
        is_new
    });
}

/// The same for the thousands of points of a large body on a fine mesh: each is held against those kept in
/// its own cube of a grid and in the cubes around it.
fn remove_duplicates_among_many(patch: &mut Vec<Touch>, apart: f64) {
    let first = patch[0].point;
    // Slightly larger than `apart`: rounding must not carry points that coincide two cubes apart.
    let cube = |point: Vec3| ((point - first) / (1.01 * apart)).to_array().map(|x| x.floor() as i32);
    let mut kept_in: HashMap<[i32; 3], Vec<Vec3>> = HashMap::new();
    patch.retain(|touch| {
        let [x, y, z] = cube(touch.point);
        let around = (x - 1..=x + 1)
            .flat_map(|x| (y - 1..=y + 1).flat_map(move |y| (z - 1..=z + 1).map(move |z| [x, y, z])));
        let is_new = around
            .filter_map(|cube| kept_in.get(&cube))
            .flatten()
            .all(|kept| (*kept - touch.point).length() > apart);
        if is_new {
            kept_in.entry([x, y, z]).or_default().push(touch.point);
        }
        is_new
    });
}

fn keep_four(patch: &mut Vec<Touch>) {
    if patch.len() <= KEPT {
        return;
    }
    let (t1, t2) = tangents(patch[0].normal);
    let flat: Vec<[f64; 2]> =
        patch.iter().map(|t| [t1.dot(t.point - patch[0].point), t2.dot(t.point - patch[0].point)]).collect();
    // First index of the largest value: ties go to the deeper point.
    let largest = |value: &dyn Fn(usize) -> f64| {
        (0..flat.len()).fold((0, f64::NEG_INFINITY), |best, i| {
            let v = value(i);
            if v > best.1 { (i, v) } else { best }
        })
    };
    let (far, _) = largest(&|i| real::hypot(flat[i][0], flat[i][1]));
    let side = |i: usize| flat[far][0] * flat[i][1] - flat[far][1] * flat[i][0];
    let (left, left_area) = largest(&side);
    let (right, right_area) = largest(&|i| -side(i));
    let mut kept = vec![0, far];
    kept.extend([(left, left_area), (right, right_area)].iter().filter(|(_, area)| *area > 0.0).map(|p| p.0));
    let extent = real::hypot(flat[far][0], flat[far][1]);
    let place: Vec<[f64; 3]> =
        flat.iter().zip(&*patch).map(|(&[x, y], t)| [x, y, t.gap].map(|x| x / extent)).collect();
    let mut places: Vec<[f64; 3]> = Vec::with_capacity(MOST);
    let mut next = kept.clone();
    let mut simplices = Vec::new();
    // Those that are not held, in the order of their gaps, with the lower hull there.
    let mut open: Vec<(usize, f64)> = (0..patch.len()).map(|i| (i, f64::INFINITY)).collect();
    while extent > 0.0 && !next.is_empty() {
        for corner in next.drain(..) {
            places.push(place[corner]);
            Simplex::with_last(&places, &mut simplices);
            open.retain_mut(|(i, hull)| {
                let p = place[*i];
                simplices.iter().all(|simplex| {
                    *hull = hull.min(simplex.gap_at(p));
                    *hull - p[2] > NEARER
                })
            });
        }
        let Some(&(first, _)) = open.first().filter(|_| places.len() < MOST) else { break };
        // Those whose gaps differ by rounding alone are equals.
        let equals = open.iter().take_while(|(i, _)| place[*i][2] <= place[first][2] + NEARER);
        let depth = |&(i, hull): &(usize, f64)| hull - place[i][2];
        let lowest = equals.fold(&open[0], |best, one| if depth(one) > depth(best) { one } else { best }).0;
        kept.push(lowest);
        next.push(lowest);
    }
    *patch = kept.into_iter().map(|i| patch[i]).collect();
}

/// A linear function of the place in the patch: its value at the origin, its slopes.
#[derive(Clone, Copy)]
struct Linear([f64; 3]);

impl Linear {
    /// The distance along a direction from a point.
    fn along(direction: [f64; 2], from: [f64; 3]) -> Self {
        let [x, y] = direction;
        Self([-(x * from[0] + y * from[1]), x, y])
    }

    fn at(self, p: [f64; 3]) -> f64 {
        let Self([start, x, y]) = self;
        start + x * p[0] + y * p[1]
    }

    fn plus(self, factor: f64, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + factor * other.0[k]))
    }
}

/// Two or three of the kept points: the line or triangle between them holds off what lies above it. Places
/// are two coordinates in the patch and a gap, in units of the patch's extent.
struct Simplex {
    /// Distances inside its borders.
    inside: [Linear; 4],
    gap: Linear,
}

impl Simplex {
    fn line(a: [f64; 3], b: [f64; 3], length: f64) -> Self {
        let [x, y] = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
        let from_a = Linear::along([x, y], a);
        let inside =
            [from_a, Linear::along([-x, -y], b), Linear::along([-y, x], a), Linear::along([y, -x], a)];
        Self { inside, gap: Linear([a[2], 0.0, 0.0]).plus((b[2] - a[2]) / length, from_a) }
    }

    /// `sides` are the lengths of those opposite to the corners, which run counter-clockwise.
    fn triangle([a, b, c]: [[f64; 3]; 3], sides: [f64; 3]) -> Self {
        let nothing = Linear([0.0; 3]);
        let mut triangle = Self { inside: [nothing; 4], gap: nothing };
        for (k, (corner, from, to)) in [(a, b, c), (b, c, a), (c, a, b)].into_iter().enumerate() {
            let left = [(from[1] - to[1]) / sides[k], (to[0] - from[0]) / sides[k]];
            let height = Linear::along(left, from);
            triangle.inside[k] = height;
            triangle.gap = triangle.gap.plus(corner[2] / height.at(corner), height);
        }
        triangle
    }

    /// Its gap at the place of `p`, give or take [`BEYOND`]; infinite elsewhere.
    fn gap_at(&self, p: [f64; 3]) -> f64 {
        if self.inside.iter().all(|inside| inside.at(p) >= -BEYOND) { self.gap.at(p) } else { f64::INFINITY }
    }

    /// Those with the last of the kept points as a corner, but for those without extent.
    fn with_last(kept: &[[f64; 3]], simplices: &mut Vec<Self>) {
        let apart = |a: [f64; 3], b: [f64; 3]| real::hypot(a[0] - b[0], a[1] - b[1]);
        simplices.clear();
        let Some((&a, others)) = kept.split_last() else { return };
        for (j, &b) in others.iter().enumerate() {
            let length = apart(a, b);
            if length > BEYOND {
                simplices.push(Self::line(a, b, length));
            }
            for &c in &others[j + 1..] {
                let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
                let sides = [apart(b, c), apart(c, a), length];
                if area.abs() <= BEYOND * sides.into_iter().fold(0.0, f64::max) {
                    continue;
                }
                simplices.push(if area > 0.0 {
                    Self::triangle([a, b, c], sides)
                } else {
                    Self::triangle([a, c, b], [sides[0], sides[2], sides[1]])
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(x: f64, y: f64, gap: f64, feature: u64) -> Touch {
        Touch { point: Vec3::new(x, y, 0.0), normal: Vec3::Z, gap, feature }
    }

    #[test]
    fn a_square_with_inner_points_and_duplicates_keeps_its_corners() {
        let mut touches = vec![
            touch(0.0, 0.0, 0.0, 9),
            touch(1.0, 1.0, -0.01, 1),
            touch(1.0, 1.0, 0.0, 8),
            touch(-1.0, 1.0, 0.0, 2),
            touch(0.3, 0.0, 0.0, 7),
            touch(-1.0, -1.0, 0.0, 3),
            touch(1.0, -1.0, 0.0, 4),
        ];
        reduce(&mut touches);
        let features: Vec<u64> = touches.iter().map(|t| t.feature).collect();
        assert_eq!(features, [1, 2, 3, 4]);
        assert_eq!(touches[0].gap, -0.01);
    }

    #[test]
    fn the_order_of_the_input_does_not_matter() {
        let mut touches: Vec<Touch> = (0..20)
            .map(|i| {
                let angle = f64::from(i) * 0.7;
                touch(angle.cos(), angle.sin(), (f64::from(i) * 1.3).sin() * 1e-3, i as u64)
            })
            .collect();
        let mut reversed: Vec<Touch> = touches.iter().rev().copied().collect();
        reduce(&mut touches);
        reduce(&mut reversed);
        assert_eq!(touches, reversed);
        assert!(touches.len() <= MOST);
    }

    /// A roller on tiles: points of a line that touch, and above its ends those of the far side of the
    /// roller. The ends of the line stay, whatever else does.
    #[test]
    fn a_point_far_above_does_not_stand_for_one_that_touches() {
        let mut touches: Vec<Touch> =
            (0..=12).map(|i| touch(f64::from(i) / 12.0, 0.0, -1e-15 * f64::from(i), i as u64)).collect();
        touches.extend([
            touch(-1e-9, 0.0, 0.7, 20),
            touch(1.0 + 1e-9, 0.0, 0.7, 21),
            touch(0.5, 0.3, 0.4, 22),
        ]);
        reduce(&mut touches);
        let features: Vec<u64> = touches.iter().map(|t| t.feature).collect();
        assert!(features.contains(&0) && features.contains(&12) && touches.len() <= MOST, "{features:?}");
    }

    #[test]
    fn an_octagon_keeps_its_corners_and_a_fine_row_its_ends() {
        let corner =
            |i: u32| touch((f64::from(i) * 0.785).cos(), (f64::from(i) * 0.785).sin(), 0.0, i.into());
        let mut touches: Vec<Touch> = (0..8).map(corner).collect();
        touches.push(touch(0.1, 0.2, 0.0, 20));
        reduce(&mut touches);
        assert_eq!(touches.iter().map(|t| t.feature).collect::<Vec<_>>(), (0..8).collect::<Vec<_>>());
        let mut row: Vec<Touch> =
            (0..20_u32).map(|i| touch(i.into(), 0.0, 0.1 * f64::from(i), i.into())).collect();
        reduce(&mut row);
        assert_eq!(row.iter().map(|t| t.feature).collect::<Vec<_>>(), [0, 19]);
    }

    #[test]
    fn a_nearer_point_inside_the_hull_is_kept_and_a_farther_one_dropped() {
        let square = |gap: f64| {
            let mut touches: Vec<Touch> = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
                .iter()
                .zip(0..)
                .map(|(&(x, y), k)| touch(x, y, 0.5 + 0.1 * x, k))
                .collect();
            touches.push(touch(0.5, 0.1, gap, 9));
            reduce(&mut touches);
            touches.iter().any(|t| t.feature == 9)
        };
        assert!(square(0.5) && !square(0.6));
    }

    #[test]
    fn of_many_points_the_same_are_kept_as_by_comparing_all() {
        // Clusters a little wider than the distance within which points coincide, over a patch of extent
        // about 1.
        let wave = |k: f64| (k * k * 1.234_567).sin();
        let mut touches: Vec<Touch> = (0_u32..2000)
            .map(|k| {
                let (cluster, k) = (f64::from(k / 20), f64::from(k));
                touch(
                    wave(cluster) + 1.5e-3 * wave(3.0 * k),
                    wave(cluster + 0.5) + 1.5e-3 * wave(k + 7.0),
                    0.0,
                    0,
                )
            })
            .collect();
        let extent = touches.iter().map(|t| (t.point - touches[0].point).length()).fold(0.0, f64::max);
        let mut expected: Vec<Touch> = Vec::new();
        for touch in &touches {
            if expected.iter().all(|k| (k.point - touch.point).length() > SAME_POINT * extent) {
                expected.push(*touch);
            }
        }
        assert!((200..1800).contains(&expected.len()), "{} of the points are kept", expected.len());
        remove_duplicates(&mut touches);
        assert_eq!(touches, expected);
    }

    #[test]
    fn walls_of_a_corner_stay_apart() {
        let mut touches = vec![touch(0.0, 0.0, 0.0, 0), touch(0.0, 0.0, 0.0, 0)];
        touches[1].normal = Vec3::X;
        reduce(&mut touches);
        assert_eq!(touches.len(), 2);
        assert_ne!(touches[0].feature, touches[1].feature);
    }
}
