//! Solids of revolution with straight sides: what cylinders and cones have in common.

use super::library::Convex;
use super::{Corners, Distance, Surface, at_plane};
use crate::math::Vec3;
use graintrain_linalg::real;
use parry3d_f64::shape::{PackedFeatureId, PolygonalFeature, PolygonalFeatureMap, SupportMap};
use std::f64::consts::FRAC_1_SQRT_2;

/// Cosine of the angle to a mantle's normal, 30 degrees, up to which a direction belongs to the mantle.
const MANTLE: f64 = 0.866_025_403_784_438_6;

/// Cosine of an angle to the axis, 6 degrees, up to which a normal may be that of an end.
pub(super) const UPRIGHT: f64 = 0.995;

/// Sine of the taper up to which a frustum has the borders of a cylinder: those of cones are lost in
/// rounding.
const LEVEL: f64 = 1e-6;

/// Circular frustum about the z axis: discs from the radius `r[0]` at the height `z[0]` to `r[1]` at `z[1]`,
/// m. One radius may be zero.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frustum {
    z: [f64; 2],
    r: [f64; 2],
    /// Components of the mantle's outward normal away from the axis and along it.
    out: f64,
    up: f64,
    /// Length of the side.
    side: f64,
}

/// The faces of a frustum.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Face {
    /// The disc at an end.
    End(usize),
    Mantle,
}

/// A vector's distance from the axis, and the direction in which it lies from there (`None` on the axis).
fn radial(p: Vec3) -> (f64, Option<Vec3>) {
    let rho = p.truncate().length();
    (rho, (rho > 0.0).then(|| Vec3::new(p.x / rho, p.y / rho, 0.0)))
}

impl Frustum {
    pub(crate) fn new(z: [f64; 2], r: [f64; 2]) -> Self {
        let (taper, height) = (r[0] - r[1], z[1] - z[0]);
        let side = (taper * taper + height * height).sqrt();
        Self { z, r, out: height / side, up: taper / side, side }
    }

    /// With sides along the axis.
    pub(crate) fn cylinder(half_length: f64, radius: f64) -> Self {
        Self { z: [-half_length, half_length], r: [radius; 2], out: 1.0, up: 0.0, side: 2.0 * half_length }
    }

    fn radius_at(&self, z: f64) -> f64 {
        self.r[0] - self.up / self.out * (z - self.z[0])
    }

    pub(super) fn largest_radius(&self) -> f64 {
        self.r[0].max(self.r[1])
    }

    /// The mantle's outward normal: its components away from the axis and along it.
    pub(crate) fn mantle_normal(&self) -> (f64, f64) {
        (self.out, self.up)
    }

    /// Of a point at the distance `rho` from the axis: heights over the bottom, the top and the mantle, m,
    /// and how far up the side its foot lies, m.
    fn heights(&self, rho: f64, z: f64) -> ([f64; 2], f64, f64) {
        let (beyond, above) = (rho - self.r[0], z - self.z[0]);
        let over_mantle = beyond * self.out + above * self.up;
        ([-above, z - self.z[1]], over_mantle, above * self.out - beyond * self.up)
    }

    pub(crate) fn surface(&self) -> Surface {
        let ends = [0, 1].map(|end| (self.r[end], self.z[end]));
        let [bottom, top] = self.z.map(|z| (0.0, z));
        let rims = ends.into_iter().filter(|(radius, _)| *radius > 0.0);
        Surface::of_revolution(&[bottom].into_iter().chain(rims).chain([top]).collect::<Vec<_>>())
    }

    pub(crate) fn reach(&self, direction: Vec3) -> f64 {
        let across = direction.truncate().length();
        let end = |k: usize| self.r[k] * across + self.z[k] * direction.z;
        end(0).max(end(1))
    }

    pub(crate) fn bounding_radius(&self) -> f64 {
        real::hypot(self.r[0], self.z[0]).max(real::hypot(self.r[1], self.z[1]))
    }

    pub(crate) fn signed_distance(&self, c: Vec3) -> Distance {
        let (rho, away) = radial(c);
        let away = away.unwrap_or(Vec3::X);
        let (over_end, over_mantle, along) = self.heights(rho, c.z);
        let end_normal = |k: usize| if k == 0 { -Vec3::Z } else { Vec3::Z };
        let mantle_normal = || self.out * away + self.up * Vec3::Z;
        let highest = if over_end[0] > over_end[1] { 0 } else { 1 };
        if over_end[highest].max(over_mantle) <= 0.0 {
            return if over_mantle > over_end[highest] {
                Distance { value: over_mantle, normal: mantle_normal() }
            } else {
                Distance { value: over_end[highest], normal: end_normal(highest) }
            };
        }
        if over_end[highest] > 0.0 && rho <= self.r[highest] {
            return Distance { value: over_end[highest], normal: end_normal(highest) };
        }
        if over_mantle > 0.0 && (0.0..=self.side).contains(&along) {
            return Distance { value: over_mantle, normal: mantle_normal() };
        }
        // Nearest to a rim: where the point is above the mantle, the one beyond which its foot lies.
        let rim = if over_mantle > 0.0 { usize::from(along > 0.0) } else { highest };
        let (across, up) = (rho - self.r[rim], c.z - self.z[rim]);
        let value = (across * across + up * up).sqrt();
        Distance { value, normal: (across * away + up * Vec3::Z) / value }
    }

    /// Borders of the spaces over its faces: of the mantle (planes, or cones through the rims), of the ends
    /// (cylinders through the rims).
    pub(crate) fn crossings(&self, centre: Vec3, half_axis: Vec3) -> Vec<f64> {
        let mut found = Vec::with_capacity(8);
        for (k, z) in self.z.into_iter().enumerate() {
            if self.up.abs() <= LEVEL {
                found.push(at_plane(z, centre.z, half_axis.z));
            } else {
                // rho = r + (z - z_rim) out / up: a cone about the axis.
                let slope = self.out / self.up;
                let at_centre = self.r[k] + (centre.z - z) * slope;
                found.extend(roots(centre, half_axis, at_centre, slope * half_axis.z));
            }
        }
        found.extend(roots(centre, half_axis, self.r[0], 0.0));
        if self.up.abs() > LEVEL {
            found.extend(roots(centre, half_axis, self.r[1], 0.0));
        }
        found
    }

    /// At the end that looks down more eight points of the rim, the first of them the lowest; at the other
    /// end the lowest one. Of an end that is a point, that point. A level end stands on an octagon until it
    /// tilts: its support is short by 8 % at most.
    pub(crate) fn lowest_points(&self, down: Vec3, each: &mut dyn FnMut(Vec3, f64, u64)) {
        // Where the ends are level any direction of the frustum's own.
        let (across, steepest) = radial(down);
        let steepest = steepest.filter(|_| across > 1e-9).unwrap_or(Vec3::X);
        let level = Vec3::Z.cross(steepest);
        let low = usize::from(down.z > 0.0);
        let point = |end: usize, way: Vec3| self.r[end] * way + self.z[end] * Vec3::Z;
        let [between, behind] = [level, -level].map(|level| FRAC_1_SQRT_2 * (steepest + level));
        let around = [steepest, between, level, -behind, -steepest, -between, -level, behind];
        let count = if self.r[low] > 0.0 { around.len() } else { 1 };
        for (feature, way) in (0..).zip(around).take(count) {
            each(point(low, way), 0.0, feature);
        }
        each(point(1 - low, steepest), 0.0, around.len() as u64);
    }

    /// Per end four points of the rim, of which the first looks at the other solid, or its only point.
    pub(crate) fn corners(&self, toward: Vec3) -> Corners {
        let (across, way) = radial(toward);
        let way = way.filter(|_| across > 1e-9 * toward.length()).unwrap_or(Vec3::X);
        let side = Vec3::Z.cross(way);
        let mut corners = Corners::default();
        let mut first = [0; 2];
        for end in 0..2 {
            first[end] = corners.points.len();
            let around = [way, side, -way, -side].map(|way| self.r[end] * way + self.z[end] * Vec3::Z);
            let count = if self.r[end] > 0.0 { around.len() } else { 1 };
            corners.points.extend(&around[..count]);
            let start = first[end];
            corners
                .edges
                .extend((0..count).filter(|_| count > 1).map(|k| [start + k, start + (k + 1) % count]));
        }
        corners.edges.insert(0, first);
        corners
    }

    pub(crate) fn inside_face(&self, p: Vec3) -> f64 {
        let (rho, _) = radial(p);
        let (over_end, over_mantle, along) = self.heights(rho, p.z);
        let highest = if over_end[0] > over_end[1] { 0 } else { 1 };
        if over_mantle > over_end[highest] { along.min(self.side - along) } else { self.r[highest] - rho }
    }

    /// The point of the surface at the same height in the direction in which a plane with this normal lies;
    /// `None` for what stands on an end.
    pub(crate) fn foremost_around(&self, point: Vec3, normal: Vec3) -> Option<Vec3> {
        let away = radial(normal).1.filter(|_| normal.z.abs() < UPRIGHT)?;
        let z = point.z.clamp(self.z[0], self.z[1]);
        Some(z * Vec3::Z - self.radius_at(z) * away)
    }

    pub(crate) fn in_library(&self, unit: f64) -> Convex<'static> {
        let lengths = |pair: [f64; 2]| pair.map(|length| length / unit);
        Convex::Round(Self { z: lengths(self.z), r: lengths(self.r), side: self.side / unit, ..*self })
    }

    fn face_toward(&self, direction: Vec3) -> Face {
        let end = usize::from(direction.z >= 0.0);
        let of_mantle = self.out * direction.truncate().length() + self.up * direction.z;
        let is_near = of_mantle > MANTLE * direction.length() && of_mantle > direction.z.abs();
        if is_near || self.r[end] == 0.0 { Face::Mantle } else { Face::End(end) }
    }

    /// The point of the mantle beside this point of it, where its outward normal is such a one.
    pub(crate) fn on_mantle(&self, point: Vec3, outward: Vec3) -> Option<Vec3> {
        let (_, away) = radial(outward);
        match (self.face_toward(outward), away) {
            (Face::Mantle, Some(away)) => {
                let z = point.z.clamp(self.z[0], self.z[1]);
                Some(self.radius_at(z) * away + z * Vec3::Z)
            }
            _ => None,
        }
    }
}

/// Both t at which the line `centre + t * half_axis` has the distance `at_centre + t * growth` from the z
/// axis, or less that distance.
fn roots(centre: Vec3, half_axis: Vec3, at_centre: f64, growth: f64) -> [f64; 2] {
    let (c, a) = (centre.truncate(), half_axis.truncate());
    let square = a.length_squared() - growth * growth;
    let linear = a.dot(c) - growth * at_centre;
    let constant = c.length_squared() - at_centre * at_centre;
    let discriminant = linear * linear - square * constant;
    if square == 0.0 {
        return [at_plane(0.0, constant, 2.0 * linear), f64::INFINITY];
    }
    if discriminant <= 0.0 {
        return [f64::INFINITY; 2];
    }
    let root = discriminant.sqrt();
    [(-linear - root) / square, (-linear + root) / square]
}

impl SupportMap for Frustum {
    fn local_support_point(&self, direction: Vec3) -> Vec3 {
        let (across, away) = radial(direction);
        let value = |k: usize| self.r[k] * across + self.z[k] * direction.z;
        let end = usize::from(value(1) > value(0));
        self.r[end] * away.unwrap_or(Vec3::ZERO) + self.z[end] * Vec3::Z
    }
}

impl PolygonalFeatureMap for Frustum {
    fn local_support_feature(&self, direction: Vec3, feature: &mut PolygonalFeature) {
        self.local_support_feature_toward(direction, direction, feature);
    }

    /// The line of the mantle, or four points of the rim of an end, in the direction of `hint`: near the
    /// contact they then have all of the face.
    fn local_support_feature_toward(&self, direction: Vec3, hint: Vec3, feature: &mut PolygonalFeature) {
        let away = radial(hint).1.or(radial(direction).1).unwrap_or(Vec3::X);
        let rim = |end: usize, way: Vec3| self.r[end] * way + self.z[end] * Vec3::Z;
        match self.face_toward(direction) {
            Face::Mantle => {
                feature.vertices[..2].copy_from_slice(&[rim(0, away), rim(1, away)]);
                feature.vids = [1, 11, 11, 11].map(PackedFeatureId::vertex);
                feature.eids = [PackedFeatureId::edge(0); 4];
                feature.fid = PackedFeatureId::face(0);
                feature.num_vertices = 2;
            }
            Face::End(end) => {
                let side = Vec3::Z.cross(away);
                feature.vertices = [away, side, -away, -side].map(|way| rim(end, way));
                let first = 10 * end as u32;
                feature.vids = [1, 3, 5, 7].map(|id| PackedFeatureId::vertex(first + id));
                feature.eids = [2, 4, 6, 8].map(|id| PackedFeatureId::edge(first + id));
                feature.fid = PackedFeatureId::face(first + 9);
                feature.num_vertices = 4;
            }
        }
    }
}

/// The methods of a `Form` that its frustum answers.
macro_rules! of_frustum {
    () => {
        fn bounding_radius(&self) -> f64 {
            self.frustum().bounding_radius()
        }

        fn reach(&self, direction: Vec3) -> f64 {
            self.frustum().reach(direction)
        }

        fn surface(&self) -> Option<Surface> {
            Some(self.frustum().surface())
        }

        fn signed_distance(&self, c: Vec3) -> Distance {
            self.frustum().signed_distance(c)
        }

        fn crossings(&self, centre: Vec3, half_axis: Vec3) -> Vec<f64> {
            self.frustum().crossings(centre, half_axis)
        }

        fn is_of_revolution(&self) -> bool {
            true
        }

        fn lowest_points(&self, down: Vec3, each: &mut dyn FnMut(Vec3, f64, u64)) {
            self.frustum().lowest_points(down, each);
        }

        fn corners(&self, toward: Vec3) -> Corners {
            self.frustum().corners(toward)
        }

        fn inside_face(&self, p: Vec3) -> f64 {
            self.frustum().inside_face(p)
        }

        fn in_library(&self, unit: f64) -> Option<Convex<'_>> {
            Some(self.frustum().in_library(unit))
        }

        fn foremost_around(&self, point: Vec3, normal: Vec3) -> Option<Vec3> {
            self.frustum().foremost_around(point, normal)
        }
    };
}

pub(super) use of_frustum;
