//! Contact reduction: at most four points per patch of contact.

use crate::math::{Vec3, tangents};

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
const SAME_PATCH: f64 = 0.95;

/// Points nearer to each other than this fraction of the patch's extent are one point.
const SAME_POINT: f64 = 1e-3;

/// Contacts kept per patch: enough to fix the position and tilt of a face that lies on another.
const KEPT: usize = 4;

/// Splits the touches of one pair of parts into patches of like normals and keeps up to four points of each: the
/// deepest, the one farthest from it, the one farthest from the line through both, and the one farthest on the line's
/// other side. Ordered by feature; features are made unique.
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
    let mut kept: Vec<Touch> = Vec::with_capacity(patch.len());
    for touch in patch.iter() {
        if kept.iter().all(|k| (k.point - touch.point).length() > SAME_POINT * extent) {
            kept.push(*touch);
        }
    }
    *patch = kept;
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
    let (far, _) = largest(&|i| flat[i][0].hypot(flat[i][1]));
    let side = |i: usize| flat[far][0] * flat[i][1] - flat[far][1] * flat[i][0];
    let (left, left_area) = largest(&side);
    let (right, right_area) = largest(&|i| -side(i));
    let mut kept = vec![patch[0], patch[far]];
    for (index, area) in [(left, left_area), (right, right_area)] {
        if area > 0.0 {
            kept.push(patch[index]);
        }
    }
    *patch = kept;
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
        assert_eq!(touches.len(), 4);
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
