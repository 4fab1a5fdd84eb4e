//! Solids bounded by triangles: whether a surface closes, and the mass properties of what it encloses.
//!
//! With the tetrahedra from a point to every triangle, signed by the side from which the triangle is seen,
//! integrals over the solid are sums of closed forms (A. M. Messner, G. Q. Taylor, "Solid polyhedron
//! measures", ACM Transactions on Mathematical Software 6(1):121-130, 1980): exact but for rounding. Cost:
//! linear.

use crate::error::ModelError;
use crate::math::Vec3;
use crate::moments::{Moments, outer};
use std::collections::HashMap;

/// Numbers of the corners in which corners at the same place have one number.
fn joined(vertices: &[Vec3]) -> Vec<u32> {
    let mut numbers: HashMap<[u64; 3], u32> = HashMap::new();
    let number = |v: &Vec3| {
        let next = numbers.len() as u32;
        // Adding zero turns -0 into +0.
        *numbers.entry((*v + Vec3::ZERO).to_array().map(f64::to_bits)).or_insert(next)
    };
    vertices.iter().map(number).collect()
}

/// `Err` unless the triangles bound a solid: every edge belongs to two of them that go along it in opposite
/// directions, and they are counter-clockwise seen from outside.
///
/// # Errors
/// [`ModelError::MeshOpen`], [`ModelError::MeshTurned`] or [`ModelError::MeshInsideOut`].
pub(crate) fn check_closed(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), ModelError> {
    let number = joined(vertices);
    let edges = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|v| number[v as usize]);
        [[a, b], [b, c], [c, a]]
    };
    let mut owner: HashMap<[u32; 2], usize> = HashMap::new();
    for (index, triangle) in triangles.iter().enumerate() {
        for edge in edges(triangle) {
            if let Some(other) = owner.insert(edge, index) {
                return Err(ModelError::MeshTurned { triangle: index, other });
            }
        }
    }
    let mut open = 0;
    let mut first = None;
    for (index, triangle) in triangles.iter().enumerate() {
        for (k, [a, b]) in edges(triangle).into_iter().enumerate() {
            if !owner.contains_key(&[b, a]) {
                open += 1;
                first.get_or_insert((index, [k, (k + 1) % 3].map(|k| vertices[triangle[k] as usize])));
            }
        }
    }
    if let Some((triangle, [from, to])) = first {
        return Err(ModelError::MeshOpen { edges: open, triangle, from, to });
    }
    let volume = moments(vertices, triangles).0.volume;
    if volume > 0.0 { Ok(()) } else { Err(ModelError::MeshInsideOut { volume }) }
}

/// Integrals of 1, p and p p^T over what the triangles enclose, with p from a point amid the corners (so that
/// a mesh far from its origin loses no digits); and that point.
pub(crate) fn moments(vertices: &[Vec3], triangles: &[[u32; 3]]) -> (Moments, Vec3) {
    let middle = vertices.iter().sum::<Vec3>() / vertices.len().max(1) as f64;
    let mut sum = Moments::ZERO;
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| vertices[v as usize] - middle);
        let volume = a.dot(b.cross(c)) / 6.0;
        let corners = a + b + c;
        let second = outer(a, a) + outer(b, b) + outer(c, c) + outer(corners, corners);
        sum.add(&Moments { volume, first: 0.25 * volume * corners, second: volume / 20.0 * second });
    }
    (sum, middle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Mat3, Quat};
    use crate::shape::{Geometry, Mesh, Shape, Sphere};

    /// A box of half edges h about c as twelve triangles, from outside counter-clockwise.
    fn brick(h: Vec3, c: Vec3) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let corner = |k: u32| {
            let sign = |bit: u32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
            c + h * Vec3::new(sign(0), sign(1), sign(2))
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        ((0..8).map(corner).collect(), triangles)
    }

    #[test]
    fn a_box_of_triangles_has_the_mass_of_the_box() {
        let h = Vec3::new(0.3, 0.5, 0.7);
        let (vertices, triangles) = brick(h, Vec3::new(100.0, -20.0, 3.0));
        let (mesh, centre) = Geometry::solid_mesh(vertices, triangles).unwrap();
        assert!((centre - Vec3::new(100.0, -20.0, 3.0)).length() < 1e-12);
        let exact = Geometry::cuboid(h).unwrap();
        assert!((mesh.volume / exact.volume - 1.0).abs() < 1e-13);
        let difference = mesh.unit_inertia - exact.unit_inertia;
        assert!(difference.to_cols_array().iter().all(|x| x.abs() < 1e-12 * exact.volume), "{difference:?}");
    }

    /// A corner tetrahedron with legs 1: volume 1/6, centre 1/4, and about its centre J = 3/160 on and 1/480
    /// beside the diagonal (integrals of x^2 = 1/60, of x y = 1/120 over it).
    #[test]
    fn a_tetrahedron_has_its_closed_form_in_any_frame() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let turn = Quat::from_xyzw(0.1, -0.4, 0.3, 0.8).normalize();
        let shift = Vec3::new(3.0, -2.0, 1.0);
        let placed = corners.map(|v| shift + turn * v).to_vec();
        let (mesh, centre) = Geometry::solid_mesh(placed, triangles).unwrap();
        assert!((mesh.volume - 1.0 / 6.0).abs() < 1e-14);
        assert!((centre - shift - turn * Vec3::splat(0.25)).length() < 1e-14);
        let (on, beside) = (2.0 * (1.0 / 60.0 - 1.0 / 96.0), -(1.0 / 120.0 - 1.0 / 96.0));
        let own = Mat3::from_cols(
            Vec3::new(on, beside, beside),
            Vec3::new(beside, on, beside),
            Vec3::new(beside, beside, on),
        );
        let rotation = Mat3::from_quat(turn);
        let difference = mesh.unit_inertia - rotation * own * rotation.transpose();
        assert!(difference.to_cols_array().iter().all(|x| x.abs() < 1e-15), "{difference:?}");
    }

    #[test]
    fn holes_turned_triangles_and_insides_out_are_reported() {
        let (vertices, triangles) = brick(Vec3::ONE, Vec3::ZERO);
        let refused =
            |triangles: Vec<[u32; 3]>| Geometry::solid_mesh(vertices.clone(), triangles).unwrap_err();
        let hole = refused(triangles[1..].to_vec());
        assert!(matches!(hole, ModelError::MeshOpen { edges: 3, .. }), "{hole}");
        let mut turned = triangles.clone();
        turned[4].swap(0, 1);
        let turned = refused(turned);
        assert!(matches!(turned, ModelError::MeshTurned { .. }), "{turned}");
        let inside_out = refused(triangles.iter().map(|&[a, b, c]| [a, c, b]).collect());
        assert!(matches!(inside_out, ModelError::MeshInsideOut { .. }), "{inside_out}");
        // Corners given once per triangle are joined by their place.
        let loose: Vec<Vec3> = triangles.iter().flatten().map(|&v| vertices[v as usize]).collect();
        let count = triangles.len() as u32;
        let own = (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        assert!((Geometry::solid_mesh(loose, own).unwrap().0.volume - 8.0).abs() < 1e-13);
    }

    /// A mesh weighs nothing unless it says that it is solid, and does not add up with other masses.
    #[test]
    fn a_surface_is_no_solid() {
        let (vertices, triangles) = brick(Vec3::ONE, Vec3::ZERO);
        assert_eq!(Geometry::mesh(vertices.clone(), triangles.clone()).unwrap().volume, 0.0);
        let part = |shape| crate::shape::Part { shape, position: Vec3::ZERO, orientation: Quat::IDENTITY };
        let solid = Shape::Mesh(Mesh { vertices, triangles, solid: true });
        let two = vec![part(solid), part(Shape::Sphere(Sphere { radius: 0.1 }))];
        assert!(matches!(Geometry::compound(two), Err(ModelError::MeshJoined)));
    }
}
