//! Convex polyhedra: the hull of points, by incremental insertion of the farthest point (C. B. Barber, D. P. Dobkin, H. Huhdanpaa, "The
//! quickhull algorithm for convex hulls", ACM Transactions on Mathematical Software 22(4):469-483, 1996), with coplanar triangles joined
//! to polygons.

use crate::collide::union::Moments;
use crate::error::ModelError;
use crate::math::{Mat3, Vec3};
use crate::solid_mesh::{check_closed, moments};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Points that stand out by less than this fraction of the extent are left out, faces that differ by less are one: somewhat more than
/// the rounding of files in single precision.
const TOLERANCE: f64 = 1e-6;

/// Corners of a hull at most: the work of a contact grows with the product of the edges.
pub const MOST_CORNERS: usize = 256;

/// A convex polyhedron about the centre of its volume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hull {
    corners: Vec<Vec3>,
    faces: Vec<HullFace>,
    edges: Vec<HullEdge>,
}

/// A plane polygon of a hull.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HullFace {
    /// Outward unit normal.
    pub normal: Vec3,
    /// Distance of the plane from the origin along the normal, m.
    pub offset: f64,
    /// Numbers of its corners, counter-clockwise seen from outside.
    pub corners: Vec<u32>,
}

/// A side that two faces share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HullEdge {
    /// Numbers of both corners, in the order of the first face.
    pub corners: [u32; 2],
    /// Numbers of both faces.
    pub faces: [u32; 2],
}

impl Hull {
    /// The hull of points (m, in any frame and order), moved so that its centre of volume is the origin, and that centre in the frame of
    /// the points. Corners keep the order of the points; what stands out by less than 1e-6 of the extent is left out. Cost: points times
    /// faces.
    ///
    /// # Errors
    /// [`ModelError`] for a coordinate that is not finite, points in a plane, and more than [`MOST_CORNERS`] corners.
    pub fn new(points: &[Vec3]) -> Result<(Self, Vec3), ModelError> {
        for point in points {
            crate::error::finite("a coordinate of a point of a hull", &point.to_array())?;
        }
        let low = points.iter().fold(Vec3::INFINITY, |low, p| low.min(*p));
        let high = points.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(*p));
        let extent = (high - low).length();
        if points.len() < 4 || !(extent.is_finite() && extent > 0.0) {
            return Err(ModelError::HullFlat { points: points.len() });
        }
        // About the middle, so that points far from their origin lose no digits.
        let middle = 0.5 * (low + high);
        let own: Vec<Vec3> = points.iter().map(|point| *point - middle).collect();
        let tolerance = TOLERANCE * extent;
        let triangles = triangulated(&own, tolerance).ok_or(ModelError::HullFlat { points: points.len() })?;
        let (mut hull, centre) = joined(&own, &triangles, tolerance)?;
        if hull.corners.len() > MOST_CORNERS {
            return Err(ModelError::HullCorners { corners: hull.corners.len(), most: MOST_CORNERS });
        }
        for corner in &mut hull.corners {
            *corner -= centre;
        }
        for face in &mut hull.faces {
            face.offset -= face.normal.dot(centre);
        }
        Ok((hull, middle + centre))
    }

    /// The corners, m.
    pub fn corners(&self) -> &[Vec3] {
        &self.corners
    }

    /// The faces.
    pub fn faces(&self) -> &[HullFace] {
        &self.faces
    }

    /// The edges.
    pub fn edges(&self) -> &[HullEdge] {
        &self.edges
    }

    /// Its surface as triangles, three corner numbers each, counter-clockwise seen from outside.
    pub fn triangles(&self) -> Vec<[u32; 3]> {
        let fan = |face: &HullFace| {
            let first = face.corners[0];
            face.corners[1..].windows(2).map(|pair| [first, pair[0], pair[1]]).collect::<Vec<_>>()
        };
        self.faces.iter().flat_map(fan).collect()
    }

    /// The same with all lengths multiplied by a factor.
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        let face = |face: &HullFace| HullFace { offset: factor * face.offset, ..face.clone() };
        Self {
            corners: self.corners.iter().map(|corner| factor * corner).collect(),
            faces: self.faces.iter().map(face).collect(),
            edges: self.edges.clone(),
        }
    }

    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        self.moments().volume
    }

    /// Inertia about the origin per unit density, m^5.
    pub(crate) fn unit_inertia(&self) -> Mat3 {
        self.moments().inertia(Vec3::ZERO)
    }

    fn moments(&self) -> Moments {
        let (moments, middle) = moments(&self.corners, &self.triangles());
        moments.moved(middle)
    }

    /// Half the smallest distance of two parallel planes that hold it between them, of those along its faces, m.
    pub(crate) fn half_thickness(&self) -> f64 {
        let width = |face: &HullFace| {
            let lowest = self.corners.iter().map(|c| face.normal.dot(*c)).fold(f64::INFINITY, f64::min);
            face.offset - lowest
        };
        0.5 * self.faces.iter().map(width).fold(f64::INFINITY, f64::min)
    }

    /// Radius of the largest ball about the origin inside it, m.
    pub fn inscribed_radius(&self) -> f64 {
        self.faces.iter().map(|face| face.offset).fold(f64::INFINITY, f64::min)
    }

    /// Radius of the ball about the origin that holds it, m.
    pub(crate) fn bounding_radius(&self) -> f64 {
        self.corners.iter().map(|corner| corner.length()).fold(0.0, f64::max)
    }

    /// Checks a hull that comes from a file: that its numbers fit together, that it closes, and that every corner lies behind every face.
    pub(crate) fn validate(&self) -> Result<(), ModelError> {
        let wrong = |what: &str| Err(ModelError::Table { what: format!("a convex hull {what}") });
        let extent = self.bounding_radius();
        if !(extent.is_finite() && extent > 0.0) {
            return wrong("has no size");
        }
        let known = |corner: &u32| (*corner as usize) < self.corners.len();
        if self.faces.iter().any(|face| face.corners.len() < 3 || !face.corners.iter().all(known))
            || !self.edges.iter().flat_map(|edge| &edge.corners).all(known)
            || self.edges.iter().flat_map(|edge| edge.faces).any(|face| face as usize >= self.faces.len())
        {
            return wrong("names corners or faces that it does not have");
        }
        check_closed(&self.corners, &self.triangles())?;
        let outside = |face: &HullFace| {
            let height = |corner: &Vec3| face.normal.dot(*corner) - face.offset;
            !self.corners.iter().all(|corner| height(corner) <= 20.0 * TOLERANCE * extent)
        };
        if self.faces.iter().any(outside) {
            return wrong("has a corner outside of a face");
        }
        Ok(())
    }
}

/// A triangle while the hull is made, with the points that lie outside of it.
struct Triangle {
    corners: [usize; 3],
    normal: Vec3,
    outside: Vec<usize>,
    alive: bool,
}

impl Triangle {
    fn new(points: &[Vec3], corners: [usize; 3]) -> Self {
        let [a, b, c] = corners.map(|k| points[k]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        Self { corners, normal, outside: Vec::new(), alive: true }
    }

    fn height(&self, points: &[Vec3], p: usize) -> f64 {
        self.normal.dot(points[p] - points[self.corners[0]])
    }

    fn edges(&self) -> [[usize; 2]; 3] {
        let [a, b, c] = self.corners;
        [[a, b], [b, c], [c, a]]
    }
}

/// The triangles of the hull, counter-clockwise seen from outside; `None` if the points lie in a plane within the tolerance.
fn triangulated(points: &[Vec3], tolerance: f64) -> Option<Vec<[usize; 3]>> {
    let mut triangles = first_tetrahedron(points, tolerance)?;
    let give = |triangles: &mut [Triangle], from: usize, all: Vec<usize>| {
        for p in all {
            let heights = triangles[from..].iter().map(|triangle| triangle.height(points, p));
            let (best, height) = heights
                .enumerate()
                .fold((0, f64::NEG_INFINITY), |best, next| if next.1 > best.1 { next } else { best });
            if height > tolerance {
                triangles[from + best].outside.push(p);
            }
        }
    };
    give(&mut triangles, 0, (0..points.len()).collect());
    let mut at = 0;
    while at < triangles.len() {
        if !triangles[at].alive || triangles[at].outside.is_empty() {
            at += 1;
            continue;
        }
        let of = &triangles[at];
        let mut far = of.outside[0];
        for &p in &of.outside {
            if of.height(points, p) > of.height(points, far) {
                far = p;
            }
        }
        // Triangles whose plane holds the point go as well: a new one on their border could have no area.
        let seen: Vec<usize> = (0..triangles.len())
            .filter(|&k| triangles[k].alive && triangles[k].height(points, far) >= -tolerance)
            .collect();
        let mut border: HashMap<[usize; 2], usize> = HashMap::new();
        let mut sides = Vec::new();
        for &k in &seen {
            for edge in triangles[k].edges() {
                border.insert(edge, k);
                sides.push(edge);
            }
        }
        let mut left = Vec::new();
        for &k in &seen {
            triangles[k].alive = false;
            left.append(&mut triangles[k].outside);
        }
        left.retain(|&p| p != far);
        left.sort_unstable();
        let first = triangles.len();
        for [a, b] in sides {
            if !border.contains_key(&[b, a]) {
                triangles.push(Triangle::new(points, [a, b, far]));
            }
        }
        if triangles.len() == first {
            return None;
        }
        give(&mut triangles, first, left);
    }
    Some(triangles.into_iter().filter(|t| t.alive).map(|t| t.corners).collect())
}

/// Four points far apart; `None` if the points lie in a plane.
fn first_tetrahedron(points: &[Vec3], tolerance: f64) -> Option<Vec<Triangle>> {
    let farthest = |measure: &dyn Fn(Vec3) -> f64| {
        let mut best = 0;
        for k in 1..points.len() {
            if measure(points[k]) > measure(points[best]) {
                best = k;
            }
        }
        best
    };
    let a = farthest(&|p| -p.x);
    let b = farthest(&|p| (p - points[a]).length_squared());
    let along = (points[b] - points[a]).normalize_or_zero();
    let c = farthest(&|p| (p - points[a]).cross(along).length_squared());
    if (points[c] - points[a]).cross(along).length() <= tolerance {
        return None;
    }
    let normal = along.cross(points[c] - points[a]).normalize_or_zero();
    let d = farthest(&|p| normal.dot(p - points[a]).abs());
    let height = normal.dot(points[d] - points[a]);
    if height.abs() <= tolerance {
        return None;
    }
    let (b, c) = if height > 0.0 { (c, b) } else { (b, c) };
    let corners = [[a, b, c], [a, d, b], [b, d, c], [c, d, a]];
    Some(corners.into_iter().map(|corners| Triangle::new(points, corners)).collect())
}

/// The hull with triangles of one plane joined, about the origin of the points, and its centre of volume.
fn joined(points: &[Vec3], triangles: &[[usize; 3]], tolerance: f64) -> Result<(Hull, Vec3), ModelError> {
    let failed = || ModelError::HullFlat { points: points.len() };
    let mut owner: HashMap<[usize; 2], usize> = HashMap::new();
    for (k, &[a, b, c]) in triangles.iter().enumerate() {
        for edge in [[a, b], [b, c], [c, a]] {
            if owner.insert(edge, k).is_some() {
                return Err(failed());
            }
        }
    }
    // Twice the area along the normal.
    let area = |k: usize| {
        let [a, b, c] = triangles[k].map(|p| points[p]);
        (b - a).cross(c - a)
    };
    let mut group: Vec<usize> = (0..triangles.len()).collect();
    for (k, &[a, b, c]) in triangles.iter().enumerate() {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let other = *owner.get(&[to, from]).ok_or_else(failed)?;
            let (large, small) =
                if area(k).length() >= area(other).length() { (k, other) } else { (other, k) };
            let normal = area(large).normalize_or_zero();
            let height = |p: usize| normal.dot(points[p] - points[triangles[large][0]]).abs();
            if triangles[small].iter().all(|&p| height(p) <= 4.0 * tolerance) {
                let (keep, drop) = (group[k].min(group[other]), group[k].max(group[other]));
                group.iter_mut().filter(|entry| **entry == drop).for_each(|entry| *entry = keep);
            }
        }
    }
    let mut faces: Vec<(Vec3, Vec<usize>)> = Vec::new();
    for plane in (0..triangles.len()).filter(|&k| group[k] == k) {
        let members = || (0..triangles.len()).filter(|&k| group[k] == plane);
        let normal = members().map(area).sum::<Vec3>().normalize_or_zero();
        let inner = |edge: [usize; 2]| owner.get(&[edge[1], edge[0]]).is_some_and(|&k| group[k] == plane);
        let border =
            members().flat_map(|k| Triangle::new(points, triangles[k]).edges()).filter(|&edge| !inner(edge));
        let next: HashMap<usize, usize> = border.map(|[a, b]| (a, b)).collect();
        let first = *next.keys().min().ok_or_else(failed)?;
        let mut around = vec![first];
        let mut at = next[&first];
        while at != first && around.len() <= next.len() {
            around.push(at);
            at = *next.get(&at).ok_or_else(failed)?;
        }
        if around.len() != next.len() {
            return Err(failed());
        }
        faces.push((normal, around));
    }
    // A point on the border of two faces only lies in the middle of an edge.
    let mut meeting = vec![0_usize; points.len()];
    faces.iter().flat_map(|(_, around)| around).for_each(|&p| meeting[p] += 1);
    let kept: Vec<usize> = (0..points.len()).filter(|&p| meeting[p] >= 3).collect();
    let mut number = vec![u32::MAX; points.len()];
    for (&p, k) in kept.iter().zip(0..) {
        number[p] = k;
    }
    let corners: Vec<Vec3> = kept.iter().map(|&p| points[p]).collect();
    let mut hull = Hull { corners, faces: Vec::new(), edges: Vec::new() };
    for (normal, around) in faces {
        let own: Vec<u32> = around.iter().map(|&p| number[p]).filter(|&k| k != u32::MAX).collect();
        if own.len() < 3 {
            return Err(failed());
        }
        let height = |&k: &u32| normal.dot(hull.corners[k as usize]);
        let offset = own.iter().map(height).fold(f64::NEG_INFINITY, f64::max);
        hull.faces.push(HullFace { normal, offset, corners: own });
    }
    let mut sides: HashMap<[u32; 2], u32> = HashMap::new();
    for (face, k) in hull.faces.iter().zip(0..) {
        for (&a, &b) in face.corners.iter().zip(face.corners.iter().cycle().skip(1)) {
            if let Some(&other) = sides.get(&[b, a]) {
                hull.edges.push(HullEdge { corners: [b, a], faces: [other, k] });
            }
            sides.insert([a, b], k);
        }
    }
    if 2 * hull.edges.len() != sides.len() || hull.corners.len() + hull.faces.len() != hull.edges.len() + 2 {
        return Err(failed());
    }
    hull.validate()?;
    let (moments, middle) = moments(&hull.corners, &hull.triangles());
    Ok((hull, middle + moments.first / moments.volume))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Quat;
    use crate::shape::Geometry;
    use proptest::prelude::*;

    fn grid(half: Vec3, cells: u32) -> Vec<Vec3> {
        let place = |k: u32| 2.0 * f64::from(k) / f64::from(cells) - 1.0;
        let n = cells + 1;
        (0..n * n * n).map(|k| half * Vec3::new(place(k % n), place(k / n % n), place(k / n / n))).collect()
    }

    /// Points in faces and edges are no corners; moved, turned and rounded to single precision, the box stays a box.
    #[test]
    fn a_grid_of_points_has_the_box_around_it() {
        let half = Vec3::new(0.3, 0.5, 0.7);
        let turn = Quat::from_xyzw(0.1, -0.4, 0.3, 0.8).normalize();
        let shift = Vec3::new(5.0, -2.0, 1.0);
        for (round, tolerance) in [(false, 1e-13), (true, 1e-6)] {
            let place = |p: Vec3| {
                let p = shift + turn * p;
                if round { p.map(|x| f64::from(x as f32)) } else { p }
            };
            let points: Vec<Vec3> = grid(half, 5).into_iter().map(place).collect();
            let (hull, centre) = Hull::new(&points).unwrap();
            assert_eq!((hull.corners.len(), hull.faces.len(), hull.edges.len()), (8, 6, 12));
            assert!((centre - shift).length() < 10.0 * tolerance);
            let exact = Geometry::cuboid(half).unwrap();
            assert!((hull.volume() / exact.volume - 1.0).abs() < 10.0 * tolerance);
            let rotation = Mat3::from_quat(turn);
            let difference = hull.unit_inertia() - rotation * exact.unit_inertia * rotation.transpose();
            assert!(difference.to_cols_array().iter().all(|x| x.abs() < 10.0 * tolerance), "{difference:?}");
            assert!((hull.inscribed_radius() - 0.3).abs() < 10.0 * tolerance);
        }
    }

    #[test]
    fn points_of_a_plane_a_line_and_too_many_corners_are_refused() {
        let flat: Vec<Vec3> = grid(Vec3::new(1.0, 1.0, 0.0), 4);
        assert!(matches!(Hull::new(&flat), Err(ModelError::HullFlat { .. })));
        let line: Vec<Vec3> = (0..9).map(|k| f64::from(k) * Vec3::ONE).collect();
        assert!(matches!(Hull::new(&line), Err(ModelError::HullFlat { .. })));
        assert!(Hull::new(&[]).is_err());
        assert!(Hull::new(&[Vec3::NAN; 5]).is_err());
        // A spiral around a ball.
        let ball = |k: u32| {
            let (z, angle) = (2.0 * f64::from(k) / 399.0 - 1.0, 2.4 * f64::from(k));
            let across = (1.0 - z * z).sqrt();
            Vec3::new(across * angle.cos(), across * angle.sin(), z)
        };
        let many: Vec<Vec3> = (0..400).map(ball).collect();
        assert!(matches!(Hull::new(&many), Err(ModelError::HullCorners { corners: 400, .. })));
    }

    proptest! {
        /// All points lie inside, every corner is one of them, and no corner can be left out; the volume is the one by summing over
        /// corners drawn in another order.
        #[test]
        fn the_hull_of_random_points_is_the_smallest(
            points in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 8..40)
        ) {
            let points: Vec<Vec3> = points.into_iter().map(Vec3::from_array).collect();
            let (hull, centre) = Hull::new(&points).unwrap();
            for &p in &points {
                for face in hull.faces() {
                    prop_assert!(face.normal.dot(p - centre) - face.offset < 1e-5);
                }
            }
            for corner in hull.corners() {
                prop_assert!(points.iter().any(|p| (*p - centre - corner).length() < 1e-12));
                let others: Vec<Vec3> = hull.corners().iter().filter(|c| *c != corner).copied().collect();
                if others.len() > 3 && let Ok((less, _)) = Hull::new(&others) {
                    prop_assert!(less.volume() < hull.volume());
                }
            }
            let reversed: Vec<Vec3> = points.iter().rev().copied().collect();
            let (other, same) = Hull::new(&reversed).unwrap();
            prop_assert!((same - centre).length() < 1e-5);
            prop_assert!((other.volume() - hull.volume()).abs() < 1e-4);
        }
    }
}
