//! Signed distance from a point to a shape, in closed form, in the shape's own frame.
//!
//! A ball of radius r about c touches a shape where the signed distance s(c) equals r, along the gradient of
//! s. The signed distance of a convex shape is a convex function, which makes capsules (balls along a
//! segment) easy too.

use crate::hull::{Hull, HullFace, MOST_CORNERS};
use crate::math::Vec3;
use crate::shape::Shape;
use graintrain_linalg::real;

/// Faces of the largest hull: those of a triangulation of its corners.
const MOST_FACES: usize = 2 * MOST_CORNERS;

/// Signed distance from a point to a surface and the direction in which it grows fastest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Distance {
    /// Positive outside, m.
    pub value: f64,
    /// Unit gradient: the outward normal of the surface at the nearest point.
    pub normal: Vec3,
}

/// Signed distance from `c` to a shape without a mesh.
///
/// # Panics
/// For a mesh, which has no inside (see [`super::mesh`]).
pub(crate) fn signed_distance(shape: &Shape, c: Vec3) -> Distance {
    match *shape {
        Shape::Sphere { radius } => to_point(c, Vec3::ZERO, radius),
        Shape::Box { half } => to_box(c, half),
        Shape::Plane => Distance { value: c.z, normal: Vec3::Z },
        Shape::Capsule { half_length, radius } => {
            to_point(c, Vec3::new(0.0, 0.0, c.z.clamp(-half_length, half_length)), radius)
        }
        Shape::Cylinder { half_length, radius } => to_cylinder(c, half_length, radius),
        Shape::Hull(ref hull) => to_hull(c, hull),
        Shape::Mesh { .. } => unreachable!("a mesh is treated triangle by triangle"),
    }
}

/// Distance to the ball of the given radius about `centre`; at the centre itself the normal is +x.
fn to_point(c: Vec3, centre: Vec3, radius: f64) -> Distance {
    let d = c - centre;
    let length = d.length();
    let normal = if length > 0.0 { d / length } else { Vec3::X };
    Distance { value: length - radius, normal }
}

fn to_box(c: Vec3, half: Vec3) -> Distance {
    // Per axis: how far beyond the face (negative: how far inside).
    let beyond = c.abs() - half;
    let outside = beyond.max(Vec3::ZERO);
    let sign = Vec3::new(1.0_f64.copysign(c.x), 1.0_f64.copysign(c.y), 1.0_f64.copysign(c.z));
    let length = outside.length();
    if length > 0.0 {
        return Distance { value: length, normal: sign * outside / length };
    }
    let value = beyond.max_element();
    let normal = if beyond.x == value {
        Vec3::X
    } else if beyond.y == value {
        Vec3::Y
    } else {
        Vec3::Z
    };
    Distance { value, normal: sign * normal }
}

fn to_cylinder(c: Vec3, half_length: f64, radius: f64) -> Distance {
    let rho = real::hypot(c.x, c.y);
    let radial = if rho > 0.0 { Vec3::new(c.x / rho, c.y / rho, 0.0) } else { Vec3::X };
    let axial = Vec3::new(0.0, 0.0, 1.0_f64.copysign(c.z));
    let (across, along) = (rho - radius, c.z.abs() - half_length);
    if across > 0.0 && along > 0.0 {
        let value = real::hypot(across, along);
        return Distance { value, normal: (across * radial + along * axial) / value };
    }
    if across > along {
        Distance { value: across, normal: radial }
    } else {
        Distance { value: along, normal: axial }
    }
}

/// The face whose plane the point is highest above (least deep below), and that height, m.
pub(crate) fn highest_face(c: Vec3, hull: &Hull) -> (usize, f64) {
    let heights = hull.faces().iter().map(|face| face.normal.dot(c) - face.offset);
    heights.enumerate().fold((0, f64::NEG_INFINITY), |best, next| if next.1 > best.1 { next } else { best })
}

/// A nearest point in the inside of a face lies on the face of largest height; otherwise it lies on an edge
/// of a face that the point is above: the way from there is a sum of the normals of both faces of the edge,
/// and positive along one of them.
fn to_hull(c: Vec3, hull: &Hull) -> Distance {
    let (highest, height) = highest_face(c, hull);
    let face = &hull.faces()[highest];
    let over = || {
        let (foot, corners) = (c - height * face.normal, &face.corners);
        corners.iter().zip(corners.iter().cycle().skip(1)).all(|(&a, &b)| {
            let [a, b] = [a, b].map(|k| hull.corners()[k as usize]);
            face.normal.cross(b - a).dot(foot - a) >= 0.0
        })
    };
    if height <= 0.0 || over() {
        return Distance { value: height, normal: face.normal };
    }
    let above = FaceSet::above(hull, [c]);
    let feet = hull.edges().iter().filter(|edge| above.holds_one_of(edge.faces)).map(|edge| {
        let [a, b] = edge.corners.map(|k| hull.corners()[k as usize]);
        let (along, from) = (b - a, c - a);
        from - (from.dot(along) / along.length_squared()).clamp(0.0, 1.0) * along
    });
    let away =
        feet.fold(
            Vec3::INFINITY,
            |best, next| {
                if next.length_squared() < best.length_squared() { next } else { best }
            },
        );
    let value = away.length();
    if value > 0.0 {
        Distance { value, normal: away / value }
    } else {
        Distance { value, normal: face.normal }
    }
}

/// Some faces of a hull.
pub(crate) struct FaceSet([u64; MOST_FACES.div_ceil(64)]);

impl FaceSet {
    /// The faces above whose planes one of the points lies.
    pub(crate) fn above<const N: usize>(hull: &Hull, points: [Vec3; N]) -> Self {
        let is_above = |face: &HullFace| points.iter().any(|p| face.normal.dot(*p) > face.offset);
        Self::of(hull.faces().iter().map(is_above))
    }

    /// From whether each face belongs to it.
    pub(crate) fn of(faces: impl Iterator<Item = bool>) -> Self {
        let mut set = [0_u64; MOST_FACES.div_ceil(64)];
        for (number, is_in) in faces.enumerate() {
            set[number / 64] |= u64::from(is_in) << (number % 64);
        }
        Self(set)
    }

    pub(crate) fn holds(&self, face: usize) -> bool {
        self.0[face / 64] >> (face % 64) & 1 == 1
    }

    pub(crate) fn holds_one_of(&self, faces: [u32; 2]) -> bool {
        faces.iter().any(|&face| self.holds(face as usize))
    }

    pub(crate) fn has_common(&self, other: &Self) -> bool {
        self.0.iter().zip(&other.0).any(|(one, other)| one & other != 0)
    }
}

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

    fn stone() -> Vec<Vec3> {
        let point = |k: u32| {
            let (a, b) = (1.7 * f64::from(k), 2.9 * f64::from(k));
            Vec3::new(0.8 * a.sin(), 0.6 * b.cos(), 0.5 * (a + b).sin())
        };
        (0..14).map(point).collect()
    }

    fn shapes() -> Vec<Shape> {
        vec![
            Shape::Sphere { radius: 0.7 },
            Shape::Box { half: Vec3::new(0.3, 0.9, 0.5) },
            Shape::Plane,
            Shape::Capsule { half_length: 0.8, radius: 0.3 },
            Shape::Cylinder { half_length: 0.6, radius: 0.5 },
            Shape::Hull(Hull::new(&stone()).unwrap().0),
        ]
    }

    proptest! {
        /// The gradient is a unit vector, agrees with finite differences, and leads back to the surface.
        #[test]
        fn gradient_agrees_with_finite_differences(p in prop::array::uniform3(-1.5..1.5_f64), which in 0..6_usize) {
            let (shape, p) = (&shapes()[which], Vec3::from_array(p));
            let distance = signed_distance(shape, p);
            prop_assert!((distance.normal.length() - 1.0).abs() < 1e-14);
            let h = 1e-6;
            let slope = Vec3::from_array([Vec3::X, Vec3::Y, Vec3::Z].map(|e| {
                (signed_distance(shape, p + h * e).value - signed_distance(shape, p - h * e).value) / (2.0 * h)
            }));
            // On the medial axis inside the shape the distance has a kink.
            let kink = (slope - distance.normal).length() > 1e-3 && distance.value < 0.0;
            prop_assume!(!kink);
            prop_assert!((slope - distance.normal).length() < 1e-5, "{:?} {slope}", distance);
            let foot = p - distance.value * distance.normal;
            prop_assert!(signed_distance(shape, foot).value.abs() < 1e-12);
        }

        /// Outside of a hull the distance is that to the nearest of the triangles of its surface.
        #[test]
        fn the_distance_to_a_hull_is_that_to_its_surface(p in prop::array::uniform3(-2.0..2.0_f64)) {
            let (hull, p) = (Hull::new(&stone()).unwrap().0, Vec3::from_array(p));
            let corners = |triangle: &[u32; 3]| triangle.map(|k| hull.corners()[k as usize]);
            let feet = hull.triangles().iter().map(|t| nearest_on_triangle(p, corners(t)).0).collect::<Vec<_>>();
            let least = feet.iter().map(|foot| (p - foot).length()).fold(f64::INFINITY, f64::min);
            let distance = signed_distance(&Shape::Hull(hull), p);
            prop_assert!((distance.value.abs() - least).abs() < 1e-12 || distance.value < 0.0);
        }

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
