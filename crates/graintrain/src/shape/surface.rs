//! Surfaces of triangles, to be drawn.

use crate::math::Vec3;
use graintrain_linalg::real;
use std::f64::consts::TAU;

/// Segments of a full circle.
const SEGMENTS: u32 = 24;

/// A surface of triangles, in m.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Corner points.
    pub vertices: Vec<Vec3>,
    /// Three indices per triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Surface {
    pub(super) fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangles.push([a, b, c]);
        self.triangles.push([a, c, d]);
    }

    /// Of revolution about z, of the profile (distance from the axis, height), given from bottom to top; both
    /// ends lie on the axis.
    pub(super) fn of_revolution(profile: &[(f64, f64)]) -> Self {
        let rings = &profile[1..profile.len() - 1];
        let mut surface = Self::default();
        surface.vertices.push(Vec3::new(0.0, 0.0, profile[0].1));
        for &(distance, height) in rings {
            surface.vertices.extend((0..SEGMENTS).map(|k| {
                let (sin, cos) = real::sin_cos(TAU * f64::from(k) / f64::from(SEGMENTS));
                Vec3::new(distance * cos, distance * sin, height)
            }));
        }
        surface.vertices.push(Vec3::new(0.0, 0.0, profile[profile.len() - 1].1));
        let top = surface.vertices.len() as u32 - 1;
        let index = |ring: u32, k: u32| 1 + ring * SEGMENTS + k % SEGMENTS;
        let last = rings.len() as u32 - 1;
        for k in 0..SEGMENTS {
            surface.triangles.push([0, index(0, k + 1), index(0, k)]);
            for ring in 0..last {
                surface.quad([
                    index(ring, k),
                    index(ring, k + 1),
                    index(ring + 1, k + 1),
                    index(ring + 1, k),
                ]);
            }
            surface.triangles.push([top, index(last, k), index(last, k + 1)]);
        }
        surface
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::{Capsule, Cone, Cuboid, Cylinder, Shape};
    use std::f64::consts::PI;

    /// Volume enclosed by a closed, outward oriented surface: sum of a . (b x c) / 6.
    fn volume(surface: &Surface) -> f64 {
        let at = |k: u32| surface.vertices[k as usize];
        surface.triangles.iter().map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0).sum()
    }

    /// Every edge of a closed surface is run through once in each direction.
    fn is_closed(surface: &Surface) -> bool {
        let mut edges: Vec<(u32, u32)> =
            surface.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
        let mut reversed: Vec<(u32, u32)> = edges.iter().map(|&(a, b)| (b, a)).collect();
        edges.sort_unstable();
        reversed.sort_unstable();
        edges == reversed
    }

    #[test]
    fn surfaces_are_closed_and_enclose_the_volume_of_the_shape() {
        let half = Vec3::new(0.1, 0.2, 0.3);
        let surface = Shape::Box(Cuboid { half }).surface().unwrap();
        assert!(is_closed(&surface));
        assert!((volume(&surface) - 8.0 * 0.1 * 0.2 * 0.3).abs() < 1e-15);
        // A regular polygon of n corners has the area n/2 sin(2 pi/n) of its circle.
        let polygon = f64::from(SEGMENTS) / 2.0 * (TAU / f64::from(SEGMENTS)).sin();
        let surface = Shape::Cylinder(Cylinder { half_length: 0.5, radius: 0.2 }).surface().unwrap();
        assert!(is_closed(&surface));
        assert!((volume(&surface) - polygon * 0.04 * 1.0).abs() < 1e-12);
        let cone = Shape::Cone(Cone { height: 0.6, radius: 0.2, top_radius: 0.1 });
        let surface = cone.surface().unwrap();
        assert!(is_closed(&surface));
        assert!((volume(&surface) - polygon / PI * cone.volume()).abs() < 1e-12);
        let surface = Shape::Capsule(Capsule { half_length: 0.5, radius: 0.2 }).surface().unwrap();
        assert!(is_closed(&surface));
        let exact = PI * 0.04 * 1.0 + 4.0 / 3.0 * PI * 0.008;
        assert!((volume(&surface) / exact - 1.0).abs() < 0.02 && volume(&surface) < exact);
    }
}
