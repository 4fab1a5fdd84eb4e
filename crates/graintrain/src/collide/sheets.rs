//! The sides of a surface of triangles.
//!
//! A body is on one side of a surface, not on the side of each triangle on which its centre is: beyond a
//! ridge it is below the plane of the slope behind it, and still above the ground. So triangles that share an
//! edge, no third one with them, are one sheet, and turned alike: what is above one of them at their edge is
//! above the other. A body is on the side of a sheet that its centre looks at where the sheet is nearest; beside
//! its border it is on none.

use super::triangle::{TriangleFeature, nearest_on_triangle};
use crate::math::Vec3;
use std::collections::HashMap;

/// Sine of an angle, or a fraction of a length, that is none.
pub(super) const LEVEL: f64 = 1e-6;

/// The sheets of a mesh; one entry per triangle.
pub(super) struct Sheets {
    number: Vec<u32>,
    /// 1, or -1 where its corners run the other way round than those of the sheet's first triangle.
    turn: Vec<f64>,
    border: Vec<Border>,
}

/// What of a triangle lies on the border of its sheet.
#[derive(Clone, Copy, Default)]
struct Border {
    corners: [bool; 3],
    edges: [bool; 3],
}

/// The triangle of a sheet that is nearest to a point.
struct Nearest {
    distance: f64,
    /// How far the point is above its face, turned as the sheet is.
    height: f64,
    /// Whether it is nearest on the border of the sheet.
    is_border: bool,
}

/// The triangles at an edge, each with whether it runs through it from the lower number to the higher.
type AtEdge = HashMap<[u32; 2], Vec<(u32, bool)>>;

fn edges([a, b, c]: [u32; 3]) -> [([u32; 2], bool); 3] {
    [(a, b), (b, c), (c, a)].map(|(from, to)| ([from.min(to), from.max(to)], from < to))
}

impl Sheets {
    /// Of triangles of these corner numbers. A closed surface, outward, is one sheet, whatever its parts.
    pub(super) fn new(triangles: &[[u32; 3]], is_closed: bool) -> Self {
        let count = triangles.len();
        let border = vec![Border::default(); count];
        if is_closed {
            return Self { number: vec![0; count], turn: vec![1.0; count], border };
        }
        let mut at_edge = AtEdge::new();
        for (triangle, &corners) in (0..).zip(triangles) {
            for (edge, is_upward) in edges(corners) {
                at_edge.entry(edge).or_default().push((triangle, is_upward));
            }
        }
        let mut sheets = Self { number: vec![u32::MAX; count], turn: vec![1.0; count], border };
        for first in 0..count as u32 {
            if sheets.number[first as usize] == u32::MAX {
                sheets.spread(first, triangles, &at_edge);
            }
        }
        let ends = at_edge.iter().filter(|(_, at)| at.len() != 2).flat_map(|(edge, _)| *edge);
        let mut is_on_border = vec![false; triangles.iter().flatten().max().map_or(0, |&n| n as usize + 1)];
        ends.for_each(|corner| is_on_border[corner as usize] = true);
        let border = |&triangle: &[u32; 3]| Border {
            corners: triangle.map(|corner| is_on_border[corner as usize]),
            edges: edges(triangle).map(|(edge, _)| at_edge[&edge].len() != 2),
        };
        sheets.border = triangles.iter().map(border).collect();
        sheets
    }

    /// Gives the sheet of a triangle its number.
    fn spread(&mut self, first: u32, triangles: &[[u32; 3]], at_edge: &AtEdge) {
        let mut next = vec![first];
        self.number[first as usize] = first;
        while let Some(triangle) = next.pop() {
            for (edge, is_upward) in edges(triangles[triangle as usize]) {
                let [one, two] = at_edge[&edge][..] else { continue };
                let (other, also_upward) = if one.0 == triangle { two } else { one };
                if self.number[other as usize] == u32::MAX {
                    self.number[other as usize] = first;
                    let turn = self.turn[triangle as usize];
                    self.turn[other as usize] = if is_upward == also_upward { -turn } else { turn };
                    next.push(other);
                }
            }
        }
    }

    /// Which corners of a triangle lie on a border.
    pub(super) fn border(&self, triangle: u32) -> [bool; 3] {
        self.border[triangle as usize].corners
    }

    /// Whether a feature of a triangle lies on a border.
    pub(super) fn is_border(&self, triangle: u32, feature: TriangleFeature) -> bool {
        let border = self.border[triangle as usize];
        match feature {
            TriangleFeature::Face => false,
            TriangleFeature::Edge(k) => border.edges[k],
            TriangleFeature::Vertex(k) => border.corners[k],
        }
    }

    /// The sides of these triangles on which a point is, 1 where the normal of the face looks and -1 behind
    /// it: for each sheet that of its nearest triangle; of several as near, of the one that looks at the point
    /// most. None where that is nearest with the border of its sheet. `corners` are those of all triangles.
    pub(super) fn sides(
        &self,
        near: &[u32],
        point: Vec3,
        corners: &[[Vec3; 3]],
        face: impl Fn(u32) -> Vec3,
    ) -> Vec<Option<f64>> {
        let mut sheets: Vec<(u32, Nearest)> = Vec::new();
        for &triangle in near {
            let (foot, feature) = nearest_on_triangle(point, corners[triangle as usize]);
            let (distance, away) = ((point - foot).length(), point - foot);
            let height = self.turn[triangle as usize] * face(triangle).dot(away);
            let next = Nearest { distance, height, is_border: self.is_border(triangle, feature) };
            let sheet = self.number[triangle as usize];
            let Some((_, best)) = sheets.iter_mut().find(|best| best.0 == sheet) else {
                sheets.push((sheet, next));
                continue;
            };
            let is_as_near = (distance - best.distance).abs() <= LEVEL * best.distance;
            if is_as_near && height.abs() > best.height.abs() || !is_as_near && distance < best.distance {
                *best = next;
            }
        }
        let side = |&triangle: &u32| {
            let (sheet, turn) = (self.number[triangle as usize], self.turn[triangle as usize]);
            let (_, nearest) = sheets.iter().find(|best| best.0 == sheet)?;
            (!nearest.is_border).then(|| turn * 1.0_f64.copysign(nearest.height))
        };
        near.iter().map(side).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ridge of two slopes whose triangles run every way round: one sheet with two sides. Beyond the ridge
    /// a point is below the plane of one slope, and above the surface.
    #[test]
    fn a_ridge_has_two_sides() {
        let ridge = [Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.0, 1.0, 1.0)];
        let feet = [-1.0, 1.0].map(|x| [Vec3::new(x, 0.0, 0.0), Vec3::new(x, 1.0, 0.0)]);
        let places = [ridge[0], ridge[1], feet[0][0], feet[0][1], feet[1][0], feet[1][1]];
        let numbers = [[0, 1, 2], [1, 2, 3], [0, 4, 1], [4, 1, 5]];
        let corners = numbers.map(|t: [u32; 3]| t.map(|n| places[n as usize]));
        let sheets = Sheets::new(&numbers, false);
        assert_eq!(sheets.number, [0; 4]);
        assert_eq!(sheets.border(0), [true; 3]);
        let face = |t: u32| {
            let [a, b, c] = corners[t as usize];
            (b - a).cross(c - a).normalize()
        };
        let sides = |x: f64, z: f64| {
            let sides = sheets.sides(&[0, 1, 2, 3], Vec3::new(x, 0.5, z), &corners, face);
            (0..).zip(sides).map(|(t, side)| Some(side? * face(t).z)).collect::<Vec<_>>()
        };
        for (x, z, above) in [(0.6, 0.6, true), (-0.3, 1.0, true), (0.0, 2.0, true), (0.1, 0.5, false)] {
            assert!(sides(x, z).iter().all(|height| height.is_some_and(|z| (z > 0.0) == above)), "{x} {z}");
        }
        // Beside its border.
        assert_eq!(sides(1.2, -0.2), [None; 4]);
    }

    /// Corners inside a sheet are not on its border; an edge of three triangles is one; what is closed has
    /// none.
    #[test]
    fn borders_are_where_sheets_end() {
        let fan: Vec<[u32; 3]> = (1..=5).map(|k| [0, k, k % 5 + 1]).collect();
        let sheets = Sheets::new(&fan, false);
        assert!((0..5).all(|t| sheets.border(t) == [false, true, true]));
        let fin: Vec<[u32; 3]> = fan.iter().copied().chain([[0, 1, 6]]).collect();
        let sheets = Sheets::new(&fin, false);
        assert!(sheets.border(2)[0] && sheets.number[5] == 5 && sheets.number[..5] == [0; 5]);
        assert_eq!(Sheets::new(&fan, true).border(0), [false; 3]);
    }
}
