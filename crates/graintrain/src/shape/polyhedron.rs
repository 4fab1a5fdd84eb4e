//! Convex polyhedra.

use super::library::{Convex, ScaledHull};
use super::{Distance, Form, Shape, Surface};
use crate::error::ModelError;
use crate::hull::{Hull, HullFace, MOST_CORNERS};
use crate::math::{Mat3, Vec3};

/// Faces of the largest hull: those of a triangulation of its corners.
const MOST_FACES: usize = 2 * MOST_CORNERS;

impl Form for Hull {
    fn validate(&self) -> Result<(), ModelError> {
        Self::validate(self)
    }

    fn scaled(&self, factor: f64) -> Shape {
        Shape::Hull(Self::scaled(self, factor))
    }

    fn volume(&self) -> f64 {
        Self::volume(self)
    }

    fn unit_inertia(&self) -> Mat3 {
        Self::unit_inertia(self)
    }

    fn half_thickness(&self) -> f64 {
        Self::half_thickness(self)
    }

    fn inscribed_radius(&self) -> f64 {
        Self::inscribed_radius(self)
    }

    fn bounding_radius(&self) -> f64 {
        Self::bounding_radius(self)
    }

    fn reach(&self, direction: Vec3) -> f64 {
        self.corners().iter().map(|p| direction.dot(*p)).fold(f64::NEG_INFINITY, f64::max)
    }

    fn surface(&self) -> Option<Surface> {
        Some(Surface { vertices: self.corners().to_vec(), triangles: self.triangles() })
    }

    /// A nearest point in the inside of a face lies on the face of largest height; otherwise it lies on an
    /// edge of a face that the point is above: the way from there is a sum of the normals of both faces of
    /// the edge, and positive along one of them.
    fn signed_distance(&self, c: Vec3) -> Distance {
        let (highest, height) = highest_face(c, self);
        let face = &self.faces()[highest];
        let over = || {
            let (foot, corners) = (c - height * face.normal, &face.corners);
            corners.iter().zip(corners.iter().cycle().skip(1)).all(|(&a, &b)| {
                let [a, b] = [a, b].map(|k| self.corners()[k as usize]);
                face.normal.cross(b - a).dot(foot - a) >= 0.0
            })
        };
        if height <= 0.0 || over() {
            return Distance { value: height, normal: face.normal };
        }
        let above = FaceSet::above(self, [c]);
        let feet = self.edges().iter().filter(|edge| above.holds_one_of(edge.faces)).map(|edge| {
            let [a, b] = edge.corners.map(|k| self.corners()[k as usize]);
            let (along, from) = (b - a, c - a);
            from - (from.dot(along) / along.length_squared()).clamp(0.0, 1.0) * along
        });
        let away = feet.fold(Vec3::INFINITY, |best, next| {
            if next.length_squared() < best.length_squared() { next } else { best }
        });
        let value = away.length();
        if value > 0.0 {
            Distance { value, normal: away / value }
        } else {
            Distance { value, normal: face.normal }
        }
    }

    /// For every side of every face the t at which the line goes over that side: infinite where it does not.
    fn crossings(&self, centre: Vec3, half_axis: Vec3) -> Vec<f64> {
        let crossing = |face: &HullFace, a: u32, b: u32| {
            let [a, b] = [a, b].map(|k| self.corners()[k as usize]);
            let across = face.normal.cross(b - a);
            let t = across.dot(a - centre) / across.dot(half_axis);
            let p = centre + t * half_axis;
            let along = (b - a).dot(p - a) / (b - a).length_squared();
            let is_over = t.abs() < 1.0 && (0.0..=1.0).contains(&along) && face.normal.dot(p) >= face.offset;
            if is_over { t } else { f64::INFINITY }
        };
        let above = FaceSet::above(self, [centre - half_axis, centre + half_axis]);
        let mut found = Vec::with_capacity(2 * self.edges().len());
        for (number, face) in self.faces().iter().enumerate() {
            let corners = &face.corners;
            if above.holds(number) {
                let sides = corners.iter().zip(corners.iter().cycle().skip(1));
                found.extend(sides.map(|(&a, &b)| crossing(face, a, b)));
            } else {
                found.extend(corners.iter().map(|_| f64::INFINITY));
            }
        }
        found
    }

    /// Every corner: those that are not needed are taken out later.
    fn lowest_points(&self, _down: Vec3, each: &mut dyn FnMut(Vec3, f64, u64)) {
        for (feature, corner) in (0..).zip(self.corners()) {
            each(*corner, 0.0, feature);
        }
    }

    fn inside_face(&self, p: Vec3) -> f64 {
        let (highest, height) = highest_face(p, self);
        let face = &self.faces()[highest];
        inside_polygon(self, face, p - height * face.normal)
    }

    fn height_over_face(&self, p: Vec3, outward: Vec3, beside: f64) -> Option<f64> {
        let face = self.faces().iter().find(|face| face.normal.dot(outward) >= 1.0 - 1e-9)?;
        let height = face.normal.dot(p) - face.offset;
        (inside_polygon(self, face, p - height * face.normal) >= -beside).then_some(height)
    }

    fn in_library(&self, unit: f64) -> Option<Convex<'_>> {
        Some(Convex::Hull(ScaledHull { hull: self, unit }))
    }
}

/// The face whose plane the point is highest above (least deep below), and that height, m.
fn highest_face(c: Vec3, hull: &Hull) -> (usize, f64) {
    let heights = hull.faces().iter().map(|face| face.normal.dot(c) - face.offset);
    heights.enumerate().fold((0, f64::NEG_INFINITY), |best, next| if next.1 > best.1 { next } else { best })
}

/// How far a point of the plane of a face lies inside it, m.
fn inside_polygon(hull: &Hull, face: &HullFace, p: Vec3) -> f64 {
    let sides = face.corners.iter().zip(face.corners.iter().cycle().skip(1));
    let inside = sides.map(|(&a, &b)| {
        let [a, b] = [a, b].map(|k| hull.corners()[k as usize]);
        face.normal.cross((b - a).normalize_or_zero()).dot(p - a)
    });
    inside.fold(f64::INFINITY, f64::min)
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
