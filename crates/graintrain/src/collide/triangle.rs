//! The point of a triangle that is nearest to a point.

use crate::math::Vec3;

/// Point of the triangle nearest to `p`, and which of its features that point lies in the interior of
/// (Ericson, Real-Time Collision Detection, 2005, section 5.1.5).
pub(crate) fn nearest_on_triangle(p: Vec3, [a, b, c]: [Vec3; 3]) -> (Vec3, TriangleFeature) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (a, TriangleFeature::Vertex(0));
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return (b, TriangleFeature::Vertex(1));
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (a + d1 / (d1 - d3) * ab, TriangleFeature::Edge(0));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return (c, TriangleFeature::Vertex(2));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (a + d2 / (d2 - d6) * ac, TriangleFeature::Edge(2));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return (b + w * (c - b), TriangleFeature::Edge(1));
    }
    let total = va + vb + vc;
    (a + (vb / total) * ab + (vc / total) * ac, TriangleFeature::Face)
}

/// Feature of a triangle with corners 0, 1, 2; edge k runs from corner k to corner k + 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TriangleFeature {
    /// A corner.
    Vertex(usize),
    /// An edge.
    Edge(usize),
    /// The interior.
    Face,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// No point of a fine sampling of the triangle is nearer.
        #[test]
        fn nearest_on_triangle_is_nearest(
            p in prop::array::uniform3(-2.0..2.0_f64),
            corners in prop::array::uniform3(prop::array::uniform3(-1.0..1.0_f64)),
        ) {
            let (p, corners) = (Vec3::from_array(p), corners.map(Vec3::from_array));
            let [a, b, c] = corners;
            prop_assume!((b - a).cross(c - a).length() > 0.05);
            let (foot, _) = nearest_on_triangle(p, corners);
            let best = (p - foot).length();
            let n = 60;
            for i in 0..=n {
                for j in 0..=n - i {
                    let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                    let q = a + u * (b - a) + v * (c - a);
                    prop_assert!((p - q).length() >= best - 1e-12);
                }
            }
        }
    }
}
