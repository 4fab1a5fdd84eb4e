//! Edges of a solid against the edges of a polyhedron.
//!
//! Along an edge of the one, the distance s from the other is linear while the nearest points lie inside one
//! face, and bends where they go over the border of a face: at the *crossings*, which lie over an edge of
//! the other at the height of that face. Beyond, the nearest points lie on that edge, and s is least where
//! the two edges are nearest to each other, if the way from there leads between the normals of both faces.
//! All of these points are known in closed form. Where the nearest point is a corner of the other, that
//! corner's own distance from the first solid says the same.

use super::polyhedra::Polyhedron;
use super::reduce::SAME_PATCH;
use crate::math::Vec3;
use crate::shape::Distance;

/// Sine squared of the angle below which edges are parallel: they have no point that is nearest.
const PARALLEL: f64 = 1e-12;

/// Relative error of squares of lengths.
const ROUNDING: f64 = 1e-9;

/// An edge of a polyhedron near another solid.
struct Rim {
    number: usize,
    from: Vec3,
    along: Vec3,
    /// Of each of its faces: normal, offset, and the direction in the face that leads out of it.
    faces: [(Vec3, f64, Vec3); 2],
}

/// The edges of a polyhedron that come as near as `envelope`, m, to another solid: those with an end that
/// `is_near`.
pub(super) struct Rims {
    rims: Vec<Rim>,
    /// Lower and upper corner of the box around each, widened by the envelope.
    bounds: Vec<[Vec3; 2]>,
    around: [Vec3; 2],
    /// Unit vector of the line along which points look that count, if not all do.
    look: Option<Vec3>,
}

/// A point of an edge with its distance from the polyhedron.
pub(super) struct EdgePoint {
    pub point: Vec3,
    pub distance: Distance,
    /// Whether it is a crossing: over an edge, at the height of a face.
    pub is_crossing: bool,
    /// Its number among those of the edge: zero where edges are nearest to each other, else one of
    /// [`Rims::numbers`].
    pub number: u64,
}

/// Whether no direction across an edge is within the angle of [`SAME_PATCH`] of a line, along a unit vector.
fn is_steep(edge: Vec3, line: Vec3) -> bool {
    edge.dot(line).powi(2) > (1.0 - SAME_PATCH * SAME_PATCH) * edge.length_squared() * (1.0 + ROUNDING)
}

/// Whether a fraction lies between 0 and 1.
fn lies_inside(numerator: f64, denominator: f64) -> bool {
    let numerator = if denominator < 0.0 { -numerator } else { numerator };
    numerator > 0.0 && numerator < denominator.abs()
}

impl Rims {
    /// Edges all of whose normals are more than the angle of [`SAME_PATCH`] off the line `look`, if there is
    /// one, are left out, and of the others points whose normals are.
    pub(super) fn of(
        polyhedron: &Polyhedron<'_>,
        is_near: &[bool],
        envelope: f64,
        look: Option<Vec3>,
    ) -> Self {
        let around = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let mut found = Self { rims: Vec::new(), bounds: Vec::new(), around, look };
        for (number, edge) in polyhedron.edges().iter().enumerate() {
            if !edge.corners.iter().any(|&end| is_near[end as usize]) {
                continue;
            }
            let [from, to] = polyhedron.ends(edge);
            let along = to - from;
            // Its normals are across it.
            if look.is_some_and(|look| is_steep(along, look)) {
                continue;
            }
            let faces = edge.faces.map(|face| polyhedron.plane(face));
            let out_of = |own: usize| {
                let out = faces[own].0.cross(along);
                // Over the edge of a convex body, the one face leads out of the half-space of the other.
                if out.dot(faces[1 - own].0) < 0.0 { -out } else { out }
            };
            let faces = [0, 1].map(|k| (faces[k].0, faces[k].1, out_of(k)));
            let (low, high) = (from.min(to) - envelope, from.max(to) + envelope);
            found.rims.push(Rim { number, from, along, faces });
            found.bounds.push([low, high]);
            found.around = [found.around[0].min(low), found.around[1].max(high)];
        }
        found
    }

    /// Numbers of the points of one edge: below 1 + 2 * `edges`, for a polyhedron with so many edges.
    pub(super) fn numbers(polyhedron: &Polyhedron<'_>) -> u64 {
        1 + 2 * polyhedron.edges().len() as u64
    }

    /// Calls `each` with the points inside the edge from `p` to `q` at which the distance from the
    /// polyhedron bends or is least. Cost: one box per rim, some 50 operations for those whose boxes meet.
    pub(super) fn points(&self, [p, q]: [Vec3; 2], each: &mut dyn FnMut(EdgePoint)) {
        let (low, high) = (p.min(q), p.max(q));
        let meets = |[l, h]: &[Vec3; 2]| !(low.cmpgt(*h) | high.cmplt(*l)).any();
        if !meets(&self.around) {
            return;
        }
        let way = q - p;
        let square = way.length_squared();
        let is_beside = self.look.is_some_and(|look| is_steep(way, look));
        for rim in self.rims.iter().zip(&self.bounds).filter(|(_, bounds)| meets(bounds)).map(|(rim, _)| rim)
        {
            let &Rim { number, from, along, faces, .. } = rim;
            let start = from - p;
            let along_square = along.length_squared();
            let (mixed, of_way, of_along) = (way.dot(along), way.dot(start), along.dot(start));
            let determinant = square * along_square - mixed * mixed;
            let over_t = of_way * along_square - of_along * mixed;
            let over_s = of_way * mixed - of_along * square;
            // Divided only where it is needed: a fraction lies inside if its numerator does.
            if !is_beside
                && determinant > PARALLEL * square * along_square
                && lies_inside(over_t, determinant)
                && lies_inside(over_s, determinant)
            {
                let (t, s) = (over_t / determinant, over_s / determinant);
                let point = p + t * way;
                let away = point - (from + s * along);
                let value = away.length();
                if value > 0.0 && faces.iter().all(|(_, _, out)| out.dot(away) >= 0.0) {
                    let distance = Distance { value, normal: away / value };
                    each(EdgePoint { point, distance, is_crossing: false, number: 0 });
                }
            }
            for (side, (normal, offset, out)) in faces.into_iter().enumerate() {
                let (to_border, rate) = (out.dot(start), out.dot(way));
                let counts = self.look.is_none_or(|look| look.dot(normal).abs() >= SAME_PATCH);
                if !counts || !lies_inside(to_border, rate) {
                    continue;
                }
                let point = p + to_border / rate * way;
                let value = normal.dot(point) - offset;
                let s = along.dot(point - from) / along_square;
                if value > 0.0 && (0.0..=1.0).contains(&s) {
                    let distance = Distance { value, normal };
                    let number = 1 + 2 * number as u64 + side as u64;
                    each(EdgePoint { point, distance, is_crossing: true, number });
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::manifold::Solid;
    use super::*;
    use crate::hull::Hull;
    use crate::math::rotation_exponential;
    use crate::shape::{Cuboid, Shape};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        /// Every point has the signed distance that the shape itself gives there, and along an edge outside
        /// nothing is nearer than its ends, these points, and the corners of the other solid.
        #[test]
        fn points_have_the_distances_of_the_shape_and_the_least_is_among_them(
            turn in prop::array::uniform3(-3.0..3.0_f64),
            ends in prop::array::uniform2(prop::array::uniform3(-1.2..1.2_f64)),
            is_box in any::<bool>(),
        ) {
            let point = |k: u32| {
                let (a, b) = (1.7 * f64::from(k), 2.9 * f64::from(k));
                Vec3::new(0.5 * a.sin(), 0.4 * b.cos(), 0.3 * (a + b).sin())
            };
            let shape = if is_box {
                Shape::Box(Cuboid { half: Vec3::new(0.5, 0.3, 0.2) })
            } else {
                Shape::Hull(Hull::new(&(0..20).map(point).collect::<Vec<_>>()).unwrap().0)
            };
            let orientation = rotation_exponential(Vec3::from_array(turn));
            let polyhedron =
                Polyhedron::new(Solid::Placed { shape: &shape, position: Vec3::ZERO, orientation }).unwrap();
            let distance = |p: Vec3| shape.form().signed_distance(orientation.conjugate() * p);
            let [p, q] = ends.map(Vec3::from_array);
            let rims = Rims::of(&polyhedron, &vec![true; polyhedron.corners().len()], 10.0, None);
            let mut least = distance(p).value.min(distance(q).value);
            let mut found = Vec::new();
            rims.points([p, q], &mut |at| found.push(at));
            for EdgePoint { point, distance: own, .. } in found {
                let exact = distance(point);
                prop_assert!((own.value - exact.value).abs() < 1e-9, "{} {}", own.value, exact.value);
                // At a border the normals of both sides are those of the point.
                let turned = orientation * exact.normal;
                prop_assert!(own.value < 1e-6 || (own.normal - turned).length() < 1e-6, "{} {turned}", own.normal);
                least = least.min(own.value);
            }
            let way = q - p;
            for corner in polyhedron.corners() {
                let t = (way.dot(*corner - p) / way.length_squared()).clamp(0.0, 1.0);
                least = least.min((p + t * way - *corner).length());
            }
            let samples: Vec<f64> = (0..=200).map(|k| distance(p + f64::from(k) / 200.0 * way).value).collect();
            // Samples lie up to 0.02 apart: between these it does not dip in, either.
            if samples.iter().all(|&s| s > 0.02) {
                prop_assert!(samples.iter().all(|&s| s >= least - 1e-12), "{least}");
            }
        }
    }
}
