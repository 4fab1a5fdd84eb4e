//! The sides of a surface of triangles.
//!
//! A body is on one side of a surface, not on the side of each triangle on which its centre is: beyond a
//! ridge it is below the plane of the slope behind it, and still above the ground. So triangles that share an
//! edge, no third one with them, are one sheet, and turned alike: what is above one of them at their edge is
//! above the other. A body is on the side of a sheet that its centre looks at where the sheet is nearest;
//! beside its border it is on none. Only what hangs together near the body is looked at: of a scroll it may
//! have one side of one turn and the other of the next.

use super::triangle::{TriangleFeature, nearest_on_triangle};
use crate::math::Vec3;
use std::collections::HashMap;

/// Sine of an angle, or a fraction of a length, that is none.
pub(super) const LEVEL: f64 = 1e-6;

/// How the triangles of a mesh hang together; one entry per triangle.
pub(super) struct Sheets {
    /// A closed surface, outward, has one side for all of its parts.
    is_closed: bool,
    beyond: Vec<Beyond>,
    border: Vec<Border>,
}

/// What of a triangle lies on the border of its sheet.
#[derive(Clone, Copy, Default)]
struct Border {
    corners: [bool; 3],
    edges: [bool; 3],
}

/// The triangle of a sheet that is nearest to a point.
#[derive(Clone, Copy)]
struct Nearest {
    distance: f64,
    /// How far the point is above its face, turned as the sheet is.
    height: f64,
    /// Whether it is nearest on the border of the sheet.
    is_border: bool,
}

/// The triangle beyond each edge of one, and whether it runs the other way round; none on a border.
type Beyond = [Option<(u32, bool)>; 3];

/// The triangles at an edge, each with whether it runs through it from the lower number to the higher.
type AtEdge = HashMap<[u32; 2], Vec<(u32, bool)>>;

fn edges([a, b, c]: [u32; 3]) -> [([u32; 2], bool); 3] {
    [(a, b), (b, c), (c, a)].map(|(from, to)| ([from.min(to), from.max(to)], from < to))
}

impl Sheets {
    /// Of triangles of these corner numbers.
    pub(super) fn new(triangles: &[[u32; 3]], is_closed: bool) -> Self {
        let count = triangles.len();
        if is_closed {
            return Self {
                is_closed,
                beyond: vec![[None; 3]; count],
                border: vec![Border::default(); count],
            };
        }
        let mut at_edge = AtEdge::new();
        for (triangle, &corners) in (0..).zip(triangles) {
            for (edge, is_upward) in edges(corners) {
                at_edge.entry(edge).or_default().push((triangle, is_upward));
            }
        }
        let beyond = |(own, &triangle): (u32, &[u32; 3])| {
            edges(triangle).map(|(edge, is_upward)| match at_edge[&edge][..] {
                [one, two] if one.0 != two.0 => {
                    let (other, also_upward) = if one.0 == own { two } else { one };
                    Some((other, is_upward == also_upward))
                }
                _ => None,
            })
        };
        let beyond: Vec<Beyond> = (0..).zip(triangles).map(beyond).collect();
        let mut is_on_border = vec![false; triangles.iter().flatten().max().map_or(0, |&n| n as usize + 1)];
        for (triangle, beyond) in triangles.iter().zip(&beyond) {
            for k in (0..3).filter(|&k| beyond[k].is_none()) {
                [k, (k + 1) % 3].into_iter().for_each(|end| is_on_border[triangle[end] as usize] = true);
            }
        }
        let border = |(triangle, beyond): (&[u32; 3], &Beyond)| Border {
            corners: triangle.map(|corner| is_on_border[corner as usize]),
            edges: beyond.map(|other| other.is_none()),
        };
        let border = triangles.iter().zip(&beyond).map(border).collect();
        Self { is_closed, beyond, border }
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

    /// The sides of these triangles, ascending, on which a point is, 1 where the normal of the face looks and
    /// -1 behind it: for those that hang together among them, that of the nearest; of several as near, of the
    /// one that looks at the point most. None where that is nearest with the border of its sheet. `corners`
    /// are those of all triangles.
    pub(super) fn sides(
        &self,
        near: &[u32],
        point: Vec3,
        corners: &[[Vec3; 3]],
        face: impl Fn(u32) -> Vec3,
    ) -> Vec<Option<f64>> {
        let mut sides = vec![None; near.len()];
        let mut turns: Vec<Option<f64>> = vec![None; near.len()];
        for first in 0..near.len() {
            if turns[first].is_some() {
                continue;
            }
            let sheet = self.sheet(near, first, &mut turns);
            let of = |&place: &usize| {
                let (triangle, turn) = (near[place], turns[place].unwrap_or(1.0));
                let (foot, feature) = nearest_on_triangle(point, corners[triangle as usize]);
                let (distance, height) = ((point - foot).length(), turn * face(triangle).dot(point - foot));
                Nearest { distance, height, is_border: self.is_border(triangle, feature) }
            };
            let nearest = sheet.iter().map(of).reduce(Nearest::or);
            let height = nearest.filter(|nearest| !nearest.is_border).map(|nearest| nearest.height);
            for place in sheet {
                sides[place] = height.map(|height| turns[place].unwrap_or(1.0) * 1.0_f64.copysign(height));
            }
        }
        sides
    }

    /// The places of those of `near` that hang together with one of them; they get their turns, -1 where
    /// their corners run the other way round.
    fn sheet(&self, near: &[u32], first: usize, turns: &mut [Option<f64>]) -> Vec<usize> {
        if self.is_closed {
            turns.fill(Some(1.0));
            return (0..near.len()).collect();
        }
        turns[first] = Some(1.0);
        let (mut sheet, mut next) = (vec![first], 0);
        while let Some(&place) = sheet.get(next) {
            next += 1;
            let own = turns[place].unwrap_or(1.0);
            for (other, is_turned) in self.beyond[near[place] as usize].into_iter().flatten() {
                if let Ok(other) = near.binary_search(&other)
                    && turns[other].is_none()
                {
                    turns[other] = Some(if is_turned { -own } else { own });
                    sheet.push(other);
                }
            }
        }
        sheet
    }
}

impl Nearest {
    fn or(self, other: Self) -> Self {
        let is_as_near = (other.distance - self.distance).abs() <= LEVEL * self.distance;
        let is_better =
            if is_as_near { other.height.abs() > self.height.abs() } else { other.distance < self.distance };
        if is_better { other } else { self }
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
        assert!(sheets.border(2)[0] && sheets.beyond[5] == [None; 3]);
        assert_eq!(Sheets::new(&fan, true).border(0), [false; 3]);
    }
}
