//! Convex polyhedra: the hull of points, by incremental insertion of the farthest point (C. B. Barber, D. P.
//! Dobkin, H. Huhdanpaa, "The quickhull algorithm for convex hulls", ACM Transactions on Mathematical
//! Software 22(4):469-483, 1996), with coplanar triangles joined to polygons.

mod join;
mod triangulate;

use crate::error::ModelError;
use crate::math::{Mat3, Vec3};
use crate::moments::Moments;
use crate::solid_mesh::{check_closed, moments};
use serde::{Deserialize, Serialize};

/// Faces that differ by less than this fraction of the extent are one: somewhat more than the rounding of
/// files in single precision.
const TOLERANCE: f64 = 1e-6;

/// Where that makes no plane polygons, it grows by steps up to this: the rounding of files with three digits.
const MOST_TOLERANCE: f64 = 1.1e-3;

/// Extents of hulls, m: their fifth powers, in the inertia, are numbers.
const EXTENTS: [f64; 2] = [1e-50, 1e50];

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
    /// The hull of points (m, in any frame and order), moved so that its centre of volume is the origin, and
    /// that centre in the frame of the points. Corners keep the order of the points. Faces that differ by
    /// less than 1e-6 of the extent are joined, and points that stand out of them by that are left out; where
    /// points are rounded more coarsely, so that this makes no plane polygons, that fraction is multiplied by
    /// four, up to 1e-3, and at last no triangles are joined. Cost: points times corners.
    ///
    /// # Errors
    /// [`ModelError`] for a coordinate that is not finite, an extent outside of 1e-50 m to 1e50 m, points in
    /// a plane, more than [`MOST_CORNERS`] corners, and faces too narrow for their normals.
    pub fn new(points: &[Vec3]) -> Result<(Self, Vec3), ModelError> {
        for point in points {
            crate::error::finite("a coordinate of a point of a hull", &point.to_array())?;
        }
        let flat = || ModelError::HullFlat { points: points.len() };
        let low = points.iter().fold(Vec3::INFINITY, |low, p| low.min(*p));
        let high = points.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(*p));
        let extent = (high - low).length();
        if points.len() < 4 || low == high {
            return Err(flat());
        }
        if !(EXTENTS[0]..=EXTENTS[1]).contains(&extent) {
            let [smallest, largest] = EXTENTS;
            return Err(ModelError::HullExtent { extent: (high - low).max_element(), smallest, largest });
        }
        // About the middle, so that points far from their origin lose no digits.
        let middle = 0.5 * (low + high);
        let own: Vec<Vec3> = points.iter().map(|point| *point - middle).collect();
        let triangles = triangulate::triangulate(&own, TOLERANCE * extent, None).ok_or_else(flat)?;
        let fractions = std::iter::successors(Some(TOLERANCE), |last| Some(4.0 * last))
            .take_while(|fraction| *fraction <= MOST_TOLERANCE);
        let mut hull = fractions
            .map(|fraction| fraction * extent)
            .find_map(|tolerance| join::join(&own, &triangles, tolerance, join::PLAY * tolerance))
            .or_else(|| join::join(&own, &triangles, 0.0, join::PLAY * TOLERANCE * extent))
            .ok_or(ModelError::HullFailed { points: points.len() })?;
        if hull.corners.len() > MOST_CORNERS {
            return Err(ModelError::HullCorners { corners: hull.corners.len(), most: MOST_CORNERS });
        }
        let (moments, about) = moments(&hull.corners, &hull.triangles());
        let centre = about + moments.first / moments.volume;
        for corner in &mut hull.corners {
            *corner -= centre;
        }
        for face in &mut hull.faces {
            face.offset -= face.normal.dot(centre);
        }
        Ok((hull, middle + centre))
    }

    /// Of points whose hull has more corners than `most` (at least 4), the corners of a hull of at most so
    /// many: quickhull that stops there, and always takes the point next that lies farthest outside. All
    /// points where they lie in a plane or are not finite. Cost: points times `most`.
    pub fn outermost(points: &[Vec3], most: usize) -> Vec<Vec3> {
        let low = points.iter().fold(Vec3::INFINITY, |low, p| low.min(*p));
        let high = points.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(*p));
        let tolerance = TOLERANCE * (high - low).length();
        let is_needed = points.len() > most && tolerance.is_finite();
        let triangles = is_needed.then(|| triangulate::triangulate(points, tolerance, Some(most))).flatten();
        let Some(triangles) = triangles else { return points.to_vec() };
        let mut corners: Vec<usize> = triangles.into_iter().flatten().collect();
        corners.sort_unstable();
        corners.dedup();
        corners.into_iter().map(|corner| points[corner]).collect()
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

    /// Half the smallest distance of two parallel planes that hold it between them, of those along its faces,
    /// m.
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

    /// Checks a hull that comes from a file: that its numbers fit together, that it closes, and that every
    /// corner lies behind every face.
    pub(crate) fn validate(&self) -> Result<(), ModelError> {
        self.validate_within(join::PLAY * MOST_TOLERANCE * self.bounding_radius())
    }

    /// [`Hull::validate`] with the height above a face that a corner may have, m.
    fn validate_within(&self, play: f64) -> Result<(), ModelError> {
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
            !self.corners.iter().all(|corner| height(corner) <= play)
        };
        if self.faces.iter().any(outside) {
            return wrong("has a corner outside of a face");
        }
        Ok(())
    }
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

    /// Points in faces and edges are no corners; moved, turned and rounded to single precision, the box stays
    /// a box.
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

    /// Every point lies in the hull within the tolerance, Euler's formula holds, and the volume is that of
    /// another sum: over pyramids from the centre to the faces, with the areas of the polygons.
    fn check(points: &[Vec3], tolerance: f64) -> Hull {
        let (hull, centre) = Hull::new(points).unwrap();
        assert_eq!(hull.corners.len() + hull.faces.len(), hull.edges.len() + 2);
        for face in hull.faces() {
            let height = |p: &Vec3| face.normal.dot(*p - centre) - face.offset;
            assert!(points.iter().all(|p| height(p) <= tolerance), "{face:?}");
            assert!(face.corners.iter().all(|&k| height(&(hull.corners[k as usize] + centre)) > -tolerance));
        }
        let pyramid = |face: &HullFace| {
            let at = |k: usize| hull.corners[face.corners[k % face.corners.len()] as usize];
            let around = (0..face.corners.len()).map(|k| at(k).cross(at(k + 1))).sum::<Vec3>();
            face.offset * 0.5 * around.dot(face.normal) / 3.0
        };
        let volume: f64 = hull.faces.iter().map(pyramid).sum();
        assert!((volume - hull.volume()).abs() < tolerance * hull.bounding_radius().powi(2) * 20.0);
        hull
    }

    /// Points of cylinders and boxes, turned and rounded as in files with few digits.
    #[test]
    fn rounded_points_make_hulls() {
        let ring = |k: u32| {
            let angle = f64::from(k % 24) * std::f64::consts::TAU / 24.0;
            Vec3::new(0.4 * angle.cos(), 0.4 * angle.sin(), if k < 24 { -0.5 } else { 0.5 })
        };
        let cylinder: Vec<Vec3> = (0..48).map(ring).collect();
        let prism = 12.0 * 0.16 * (std::f64::consts::TAU / 24.0).sin();
        let half = Vec3::new(0.3, 0.5, 0.7);
        let mut random = rand_pcg::Pcg64Mcg::new(3);
        for _ in 0..15 {
            let number = |random: &mut rand_pcg::Pcg64Mcg| rand::RngExt::random_range(random, -1.0..1.0);
            let turn = Quat::from_xyzw(
                number(&mut random),
                number(&mut random),
                number(&mut random),
                number(&mut random),
            )
            .normalize();
            for digits in [12, 9, 7, 6, 5, 4, 3] {
                let unit = 10_f64.powi(-digits);
                let rounded = |p: &Vec3| (turn * *p).map(|x| (x / unit).round() * unit);
                for (points, exact) in [(cylinder.clone(), prism), (grid(half, 5), 8.0 * 0.3 * 0.5 * 0.7)] {
                    let points: Vec<Vec3> = points.iter().map(rounded).collect();
                    let hull = check(&points, (150.0 * unit).max(1e-4));
                    assert!((hull.volume() / exact - 1.0).abs() < (20.0 * unit).max(1e-4), "{digits}");
                }
            }
        }
    }

    /// On a sphere all points are corners. The volume of the hull of n random ones is below that of the ball
    /// by some 9.5 / n.
    #[test]
    fn random_points_on_a_sphere_are_all_corners() {
        let mut random = rand_pcg::Pcg64Mcg::new(7);
        let mut on_sphere = |_| {
            let z: f64 = rand::RngExt::random_range(&mut random, -1.0..1.0);
            let angle = rand::RngExt::random_range(&mut random, 0.0..std::f64::consts::TAU);
            let across = (1.0 - z * z).sqrt();
            Vec3::new(across * angle.cos(), across * angle.sin(), z)
        };
        let points: Vec<Vec3> = (0..200).map(&mut on_sphere).collect();
        let hull = check(&points, 1e-4);
        assert!(hull.corners.len() > 195);
        let share = hull.volume() / (4.0 / 3.0 * std::f64::consts::PI);
        assert!(share > 0.93 && share < 0.97, "{share}");
        let many: Vec<Vec3> = (0..10_000).map(&mut on_sphere).collect();
        let error = Hull::new(&many).unwrap_err();
        assert!(matches!(error, ModelError::HullCorners { .. }), "{error}");
    }

    #[test]
    fn huge_and_tiny_hulls_are_hulls_or_reported() {
        let exact = Hull::new(&grid(Vec3::ONE, 3)).unwrap().0;
        for size in [1e-49, 1e-20, 1e20, 1e49] {
            let (hull, _) = Hull::new(&grid(Vec3::splat(size), 3)).unwrap();
            assert_eq!(hull.corners.len(), exact.corners.len());
            assert!((hull.volume() / (8.0 * size * size * size) - 1.0).abs() < 1e-12, "{size}");
        }
        for size in [1e-200, 1e-120, 1e100, 1e308] {
            let error = Hull::new(&grid(Vec3::splat(size), 3)).unwrap_err();
            assert!(matches!(error, ModelError::HullExtent { .. }), "{error}");
        }
    }

    /// A bound keeps corners that are points and most of the volume; a hull with fewer corners stays what it
    /// is.
    #[test]
    fn the_outermost_points_make_most_of_the_hull() {
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let on_ball = |k: u32| {
            let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 2000.0;
            let (sin, cos) = (golden * f64::from(k)).sin_cos();
            (1.0 - z * z).sqrt() * Vec3::new(cos, sin, 0.0) + z * Vec3::Z
        };
        let ball: Vec<Vec3> = (0..2000).map(on_ball).collect();
        let whole = 4.0 / 3.0 * std::f64::consts::PI;
        for (most, share) in [(4, 0.05), (16, 0.55), (64, 0.85), (256, 0.96)] {
            let kept = Hull::outermost(&ball, most);
            assert!(kept.len() <= most && kept.iter().all(|point| ball.contains(point)), "{most}");
            let (hull, _) = Hull::new(&kept).unwrap();
            assert!(hull.corners().len() == kept.len(), "{most}: every one is a corner");
            assert!(hull.volume() > share * whole, "{most}: {}", hull.volume() / whole);
        }
        let boxes = grid(Vec3::new(1.0, 2.0, 3.0), 5);
        let (hull, _) = Hull::new(&Hull::outermost(&boxes, 8)).unwrap();
        assert_eq!(hull.corners().len(), 8);
        assert!((hull.volume() - Hull::new(&boxes).unwrap().0.volume()).abs() < 1e-12);
        assert_eq!(Hull::outermost(&ball[..3], 4), ball[..3]);
    }

    proptest! {
        /// All points lie inside, every corner is one of them, and no corner can be left out; the volume is
        /// the one by summing over corners drawn in another order.
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
