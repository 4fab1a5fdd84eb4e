//! The exact normal of a contact of a cylinder or cone.
//!
//! The collision library finds the normal n of least overlap (greatest distance) of a round and another
//! convex solid by iteration (GJK, EPA), to about 1e-8 where they are apart and 1e-3 where they barely touch,
//! and sometimes not at all: two wheels side by side with no gap got a normal 45 degrees off, a wheel that
//! touches a plate twelve times its size an overlap of half the plate. The gap along a direction,
//!
//! ```text
//! gap(n) = min over B of n . x - max over A of n . x,
//! ```
//!
//! is greatest at the exact normal. Most are one of a few directions with a closed form: the normal of a face
//! or cap, the common normal of a mantle and an edge, of two mantles, of a mantle and a corner. Where the
//! best of them does as well as the normal found, it is the normal. A deep overlap is held against the normal
//! of the two with the round one made a little smaller, so that they are apart: of such solids the library
//! finds it well.

use crate::hull::HullEdge;
use crate::math::{Pose, Vec3};
use crate::shape::frustum::Frustum;
use crate::shape::library::Convex;
use parry3d_f64::query::gjk::{CsoPoint, GJKResult, VoronoiSimplex, closest_points};
use parry3d_f64::query::{ContactManifold, TrackedContact};
use parry3d_f64::shape::{PackedFeatureId, PolygonalFeature, SupportMap};

/// By how much less the gap along a candidate may be, in sizes of the smaller solid: the library's tolerance.
const AS_FAR: f64 = 1e-9;

/// Edges of a hull are looked at whose ends are within this distance of its foremost corner, in sizes of the
/// smaller solid.
const FOREMOST: f64 = 0.1;

/// By what fractions of its size the round solid is made smaller, so that the two are apart.
const SMALLER: [f64; 3] = [1e-3, 3e-2, 0.3];

/// Overlap, in sizes of the smaller solid, beyond which it is held against theirs: bodies seldom have it.
const DEEP: f64 = 1e-3;

/// Replaces the normal of a manifold and its points by exact ones, where something round is among the solids
/// and a closed form is the normal. Lengths in sizes of the smaller solid, in the frame of A; the normal
/// points from A to B.
pub(super) fn polish(a: &Convex<'_>, b: &Convex<'_>, pose: &Pose, manifold: &mut ContactManifold<(), ()>) {
    let found = manifold.local_n1;
    if !(is_round(a) || is_round(b)) || !found.is_finite() || found == Vec3::ZERO {
        return;
    }
    let gap = |n: Vec3| {
        let own = a.support_map().local_support_point(n);
        let other = pose * b.support_map().local_support_point(pose.rotation.inverse() * -n);
        (other - own).dot(n)
    };
    let mut nearest = manifold.points.last().map(|point| (point.local_p1, point.local_p2));
    let exact = |found: Vec3| {
        let directions = candidates(a, b, pose, found).into_iter().filter_map(|n| n.try_normalize());
        let gaps = directions.flat_map(|n| [n, -n]).map(|n| (gap(n), n));
        let best = gaps.max_by(|(one, _), (other, _)| one.total_cmp(other));
        best.filter(|(best, _)| *best >= gap(found) - AS_FAR)
    };
    let mut best = exact(found);
    let deepest = best.map_or(gap(found), |(best, _)| best);
    if deepest < -DEEP
        && let Some((normal, points)) = apart(a, b, pose, gap)
        && gap(normal) > deepest + DEEP
    {
        best = exact(normal).or(Some((gap(normal), normal)));
        nearest = Some(points);
    }
    let Some((distance, normal)) = best else { return };
    let back = pose.rotation.inverse() * -normal;
    let (mut own, mut other) = (PolygonalFeature::default(), PolygonalFeature::default());
    let nearest = nearest.unwrap_or_else(|| {
        (a.support_map().local_support_point(normal), b.support_map().local_support_point(back))
    });
    let mantle = (a.on_mantle(nearest.0, normal), b.on_mantle(nearest.1, back));
    // The library draws the line of a mantle through these points.
    a.feature_map().local_support_feature_toward(normal, mantle.0.unwrap_or(nearest.0), &mut own);
    b.feature_map().local_support_feature_toward(back, mantle.1.unwrap_or(nearest.1), &mut other);
    manifold.clear();
    PolygonalFeature::contacts(pose, &pose.inverse(), normal, back, &own, &other, manifold, false);
    // The library's own nearest points are only needed where features that look at each other lie beside each
    // other.
    if manifold.points.iter().all(|point| point.dist > distance + AS_FAR) {
        let (p1, p2) = match mantle {
            (Some(p1), _) => (p1, pose.inverse_transform_point(p1 + distance * normal)),
            (None, Some(p2)) => (pose * p2 - distance * normal, p2),
            (None, None) => nearest,
        };
        let (one, other) = (PackedFeatureId::UNKNOWN, PackedFeatureId::UNKNOWN);
        manifold.points.push(TrackedContact::new(p1, p2, one, other, distance));
    }
    (manifold.local_n1, manifold.local_n2) = (normal, back);
}

fn is_round(solid: &Convex<'_>) -> bool {
    matches!(solid, Convex::Round(_))
}

/// A solid about its origin made smaller by a factor.
struct Smaller<'a>(&'a dyn SupportMap, f64);

impl SupportMap for Smaller<'_> {
    fn local_support_point(&self, direction: Vec3) -> Vec3 {
        self.1 * self.0.local_support_point(direction)
    }
}

/// The normal of two solids that overlap, and the nearest points of both in their own frames, from the two
/// with the round one of them (of two, A) smaller: the one with the largest `gap`.
fn apart(
    a: &Convex<'_>,
    b: &Convex<'_>,
    pose: &Pose,
    gap: impl Fn(Vec3) -> f64,
) -> Option<(Vec3, (Vec3, Vec3))> {
    let of = |smaller: f64| {
        let scale = 1.0 - smaller;
        let is_first = is_round(a);
        let [of_a, of_b] = if is_first { [scale, 1.0] } else { [1.0, scale] };
        let (one, other) = (Smaller(a.support_map(), of_a), Smaller(b.support_map(), of_b));
        let mut simplex = VoronoiSimplex::new();
        let toward = pose.translation.try_normalize().unwrap_or(Vec3::X);
        simplex.reset(CsoPoint::from_shapes(pose, &one, &other, toward));
        let found = closest_points(pose, &one, &other, f64::MAX, true, &mut simplex);
        let GJKResult::ClosestPoints(p, q, normal) = found else { return None };
        let normal = normal.try_normalize()?;
        // The point of the round solid on its own surface, and the other one's along the normal.
        let points = if is_first {
            let p = p / scale;
            (p, pose.inverse_transform_point(p + gap(normal) * normal))
        } else {
            let q = pose.inverse_transform_point(q) / scale;
            (pose * q - gap(normal) * normal, q)
        };
        Some((normal, points))
    };
    SMALLER.into_iter().filter_map(of).max_by(|(one, _), (other, _)| gap(*one).total_cmp(&gap(*other)))
}

/// Directions that may be the normal, in the frame of A, of any length and sign: the normals of faces, the
/// common normals of two lines, those of a mantle and a point.
fn candidates(a: &Convex<'_>, b: &Convex<'_>, pose: &Pose, found: Vec3) -> Vec<Vec3> {
    let turn = |v: Vec3| pose.rotation * v;
    let back = pose.rotation.inverse() * -found;
    let mut all = a.face_normals(found);
    all.extend(b.face_normals(back).into_iter().map(turn));
    // B's outward normal is the opposite one.
    let others: Vec<Line> =
        b.lines(back).into_iter().map(|line| Line { along: turn(line.along), sine: -line.sine }).collect();
    for own in a.lines(found) {
        all.extend(others.iter().flat_map(|other| common_normals(&own, other)));
    }
    // The corner of the other one that is nearest; its axis, where both are parallel.
    let axis = |solid: &Convex<'_>| is_round(solid).then_some(Vec3::ZERO);
    if let Convex::Round(own) = a {
        let points = axis(b).into_iter().chain([b.support_map().local_support_point(back)]);
        all.extend(points.filter_map(|point| mantle_normal_toward(own, pose * point)));
    }
    if let Convex::Round(own) = b {
        let points = axis(a).into_iter().chain([a.support_map().local_support_point(found)]);
        let normals = points.filter_map(|p| mantle_normal_toward(own, pose.inverse_transform_point(p)));
        all.extend(normals.map(turn));
    }
    all
}

/// Straight lines of a surface along a direction: an edge, or those of a mantle, which go round its axis.
/// Their normals n have n . along = sine.
struct Line {
    /// Of any length, but one for mantles.
    along: Vec3,
    sine: f64,
}

/// The unit vectors n with n . d = s for both lines: n = alpha d_1 + beta d_2 +- gamma d_1 x d_2.
fn common_normals(one: &Line, other: &Line) -> Vec<Vec3> {
    let [Some(d1), Some(d2)] = [one, other].map(|line| line.along.try_normalize()) else { return Vec::new() };
    let (cosine, across) = (d1.dot(d2), d1.cross(d2));
    let square = across.length_squared();
    let in_plane = ((one.sine - cosine * other.sine) * d1 + (other.sine - cosine * one.sine) * d2) / square;
    let rest = (1.0 - in_plane.length_squared()) / square;
    if !(rest > 0.0 && rest.is_finite()) {
        return Vec::new();
    }
    [1.0, -1.0].map(|sign| in_plane + sign * rest.sqrt() * across).to_vec()
}

/// The normal of the mantle beside this point of its frame.
fn mantle_normal_toward(frustum: &Frustum, point: Vec3) -> Option<Vec3> {
    let (out, up) = frustum.mantle_normal();
    Some(out * point.with_z(0.0).try_normalize()? + up * Vec3::Z)
}

impl Convex<'_> {
    /// Normals of faces (one sign of each pair of opposite ones); of a hull the one nearest to a direction.
    fn face_normals(&self, near: Vec3) -> Vec<Vec3> {
        match self {
            Self::Box(_) => vec![Vec3::X, Vec3::Y, Vec3::Z],
            Self::Round(_) => vec![Vec3::Z],
            Self::Triangle(triangle) => vec![(triangle.b - triangle.a).cross(triangle.c - triangle.a)],
            Self::Hull(scaled) => {
                let by = |sign: f64| {
                    let along = |n: &Vec3, m: &Vec3| (sign * n.dot(near)).total_cmp(&(sign * m.dot(near)));
                    scaled.hull.faces().iter().map(|face| face.normal).max_by(along)
                };
                [1.0, -1.0].into_iter().filter_map(by).collect()
            }
        }
    }

    /// Its straight edges, of a hull those that are foremost along a direction; its mantle.
    fn lines(&self, along: Vec3) -> Vec<Line> {
        let edge = |along: Vec3| Line { along, sine: 0.0 };
        match self {
            Self::Box(_) => [Vec3::X, Vec3::Y, Vec3::Z].map(edge).into(),
            Self::Round(frustum) => vec![Line { along: Vec3::Z, sine: frustum.mantle_normal().1 }],
            Self::Triangle(triangle) => {
                let [a, b, c] = [triangle.a, triangle.b, triangle.c];
                [b - a, c - b, a - c].map(edge).into()
            }
            Self::Hull(scaled) => {
                let corners = scaled.hull.corners();
                let front = along.dot(scaled.local_support_point(along)) * scaled.unit;
                let is_foremost = |k: u32| along.dot(corners[k as usize]) > front - FOREMOST * scaled.unit;
                let edges = scaled.hull.edges().iter().map(|edge: &HullEdge| edge.corners);
                let edges = edges.filter(|ends| ends.iter().all(|&k| is_foremost(k)));
                edges.map(|[from, to]| edge(corners[to as usize] - corners[from as usize])).collect()
            }
        }
    }

    /// The point of a mantle beside this point of it, where its outward normal is such a one.
    fn on_mantle(&self, point: Vec3, outward: Vec3) -> Option<Vec3> {
        match self {
            Self::Round(frustum) => frustum.on_mantle(point, outward),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::manifold::{Solid, manifold_contacts};
    use super::*;
    use crate::hull::Hull;
    use crate::math::{Quat, rotation_exponential};
    use crate::shape::{Cuboid, Cylinder, Shape};

    /// Numbers in [-1, 1) from a fixed linear congruence.
    fn random() -> impl FnMut() -> f64 {
        let mut state = 7_u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }
    }

    /// A wheel over or in the face of a box, a cap on it, a wheel on a wheel, a wheel on an edge and on a
    /// corner: gaps to rounding, normals and lever arms to a billionth, at gaps from -1e-4 to 1e-4 of the
    /// radius, whatever their common position and turn.
    #[test]
    fn closed_forms_are_met_to_rounding() {
        let wheel = Shape::Cylinder(Cylinder { half_length: 0.1, radius: 0.1 });
        let block = Shape::Box(Cuboid { half: Vec3::new(0.3, 0.4, 0.5) });
        let mut next = random();
        let lying = Quat::from_rotation_x(std::f64::consts::FRAC_PI_2);
        let edge = Quat::from_rotation_x(std::f64::consts::FRAC_PI_4);
        // Wheel A at the origin, axis z; B below it along -y, by its own distance and the gap.
        let cases = [
            ("face", Quat::IDENTITY, &block, Quat::IDENTITY, 0.1 + 0.4, Vec3::new(0.07, 0.0, 0.04)),
            ("cap", lying, &block, Quat::IDENTITY, 0.1 + 0.4, Vec3::new(0.07, 0.0, 0.04)),
            ("wheel", Quat::IDENTITY, &wheel, Quat::IDENTITY, 0.1 + 0.1, Vec3::new(0.0, 0.0, 0.05)),
            ("crossed", Quat::IDENTITY, &wheel, Quat::from_rotation_y(0.7), 0.1 + 0.1, Vec3::ZERO),
            ("edge", Quat::IDENTITY, &block, edge, 0.1 + 0.9 * 0.5_f64.sqrt(), Vec3::new(0.05, 0.0, 0.0)),
        ];
        for (what, turn_a, shape_b, turn_b, distance, aside) in cases {
            for k in 0..400 {
                let gap = [0.0, 1e-15, -1e-15, 1e-11, -1e-11, 1e-8, -1e-8, 1e-5, -1e-5][k % 9];
                let common = rotation_exponential(3.0 * Vec3::new(next(), next(), next()));
                let shift = 2.0 * Vec3::new(next(), next(), next());
                // An edge that is 0.3, 0.4 from its axis stands under the wheel.
                let under =
                    if what == "edge" { Vec3::new(0.0, 0.0, 0.1 * 0.5_f64.sqrt()) } else { Vec3::ZERO };
                let place = -(distance + gap) * Vec3::Y + aside + under;
                let placed = |shape, position: Vec3, turn: Quat| Solid::Placed {
                    shape,
                    position: shift + common * position,
                    orientation: common * turn,
                };
                let (a, b) = (placed(&wheel, Vec3::ZERO, turn_a), placed(shape_b, place, turn_b));
                let mut touches = Vec::new();
                manifold_contacts(a, b, 0.1, shift, 0.01, &mut touches);
                assert!(!touches.is_empty(), "{what} {gap}");
                for touch in &touches {
                    let normal = common.inverse() * touch.normal;
                    let lever = (common.inverse() * (touch.point - shift)).cross(normal);
                    assert!((normal - Vec3::Y).length() < 1e-9, "{what} {gap:e}: {normal}");
                    assert!((touch.gap - gap).abs() < 1e-14, "{what} {gap:e}: {:e}", touch.gap);
                    assert!(what == "cap" || lever.z.abs() < 1e-10, "{what} {gap:e}: {lever}");
                }
            }
        }
    }

    /// A wheel or rod on its rim or lying on the top of a hull up to 200 times its size, touching it to 1e-7:
    /// the library alone finds overlaps of up to half the plate in some of these poses.
    #[test]
    fn rounds_touch_large_hulls_where_they_do() {
        let mut next = random();
        for (radius, half_length) in [(0.1, 0.05), (0.03, 0.15)] {
            let round = Shape::Cylinder(Cylinder { half_length, radius });
            for k in 0..2000 {
                let half = [0.2, 1.2, 10.0][k % 3];
                let corner = |k: u32| {
                    let side = |axis: u32| if k >> axis & 1 == 1 { half } else { -half };
                    Vec3::new(side(0), side(1), if k >> 2 & 1 == 1 { 0.0 } else { -0.3 })
                };
                let (hull, shift) = Hull::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
                let plate = Shape::Hull(hull);
                // Lying, or tilted so that the rim is lowest.
                let tilt = if k % 2 == 0 { std::f64::consts::FRAC_PI_2 } else { 1.5 * next().abs() };
                let turn = rotation_exponential(3.0 * Vec3::Z * next()) * Quat::from_rotation_x(tilt);
                let turn = turn * Quat::from_rotation_z(3.0 * next());
                let gap = [0.0, 1e-9, -1e-9, 1e-7, -1e-7][k % 5];
                let height = half_length * tilt.cos() + radius * tilt.sin() + gap;
                let within = half - 0.19;
                let place = Vec3::new(within * next(), within * next(), height);
                let common = rotation_exponential(3.0 * Vec3::new(next(), next(), next()));
                let placed = |shape, position: Vec3, turn: Quat| Solid::Placed {
                    shape,
                    position: common * position,
                    orientation: common * turn,
                };
                let (a, b) = (placed(&round, place, turn), placed(&plate, shift, Quat::IDENTITY));
                let mut touches = Vec::new();
                manifold_contacts(a, b, 0.1, common * place, 0.01, &mut touches);
                let least = touches.iter().map(|touch| touch.gap).fold(f64::INFINITY, f64::min);
                assert!((least - gap).abs() < 1e-9, "{k}: {least:e} instead of {gap:e}");
                for touch in touches.iter().filter(|touch| touch.gap < 1e-6) {
                    let normal = common.inverse() * touch.normal;
                    assert!((normal - Vec3::Z).length() < 1e-6, "{k}: {normal}");
                }
            }
        }
    }
}
