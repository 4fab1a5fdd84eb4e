//! Contacts of solids: of polyhedra (boxes, hulls, triangles) with each other by `polyhedra`; of cylinders
//! and cones with each other and with those through the collision library's manifolds (GJK, then clipping of
//! the touching faces); and for both the points within the envelope that these leave out (`corners`).

use super::corners::{Known, add_corners, foremost};
use super::polish::polish;
use super::polyhedra::{Polyhedron, polyhedron_contacts};
use super::reduce::Touch;
use crate::math::{Mat3, Pose, Quat, Vec3};
use crate::shape::library::Convex;
use crate::shape::{Distance, Shape};
use parry3d_f64::query::ContactManifold;
use parry3d_f64::query::details::contact_manifold_pfm_pfm;
use parry3d_f64::shape::Triangle;

/// One of the two touching things.
#[derive(Clone, Copy)]
pub(crate) enum Solid<'a> {
    /// A box, hull or solid of revolution placed in the world.
    Placed { shape: &'a Shape, position: Vec3, orientation: Quat },
    /// A triangle in world coordinates, counter-clockwise from its front, and the corners over which what
    /// overlaps it may leave it toward its back.
    Triangle { corners: [Vec3; 3], open: [bool; 3] },
}

impl<'a> Solid<'a> {
    /// In the frame whose origin is at `origin`.
    pub(super) fn seen_from(self, origin: Vec3) -> Self {
        match self {
            Self::Placed { shape, position, orientation } => {
                Self::Placed { shape, position: position - origin, orientation }
            }
            Self::Triangle { corners, open } => Self::Triangle { corners: corners.map(|p| p - origin), open },
        }
    }

    pub(super) fn scaled(self, unit: f64) -> (Convex<'a>, Pose) {
        match self {
            Self::Placed { shape, position, orientation } => {
                let pose = Pose::from_parts(position / unit, orientation);
                (shape.form().in_library(unit).expect("a solid with a kernel of its own"), pose)
            }
            Self::Triangle { corners, .. } => {
                let [a, b, c] = corners.map(|p| p / unit);
                (Convex::Triangle(Triangle::new(a, b, c)), Pose::IDENTITY)
            }
        }
    }
}

/// Contacts of two solids with gap up to the envelope, in world coordinates, normals from B to A. `unit` is
/// the size of the smaller one and `origin` a point nearby.
pub(crate) fn manifold_contacts(
    a: Solid<'_>,
    b: Solid<'_>,
    unit: f64,
    origin: Vec3,
    envelope: f64,
    touches: &mut Vec<Touch>,
) {
    let solids = [a, b].map(|solid| solid.seen_from(origin));
    let polyhedra = solids.map(Polyhedron::new);
    let mut found = Vec::new();
    let (mut nearest, mut known) = (None, Known::Nothing);
    if let [Some(one), Some(other)] = &polyhedra {
        match polyhedron_contacts(one, other, unit, envelope, &mut found) {
            Some(true) if !found.is_empty() => known = Known::Distance,
            Some(_) => {}
            None => return,
        }
    } else {
        nearest = library_contacts(solids, unit, envelope, &mut found);
        known = nearest.map_or(Known::Nothing, |touch: Touch| Known::Normal(-touch.normal));
    }
    add_corners(solids, known, polyhedra.each_ref().map(Option::as_ref), (unit, envelope), &mut found);
    // Where the rims and mantles of round solids have no point as near.
    let is_lost = |nearest: &Touch| found.iter().all(|touch| touch.gap > nearest.gap + SAME * unit);
    found.extend(nearest.filter(is_lost));
    touches.extend(found.into_iter().map(|touch| Touch { point: origin + touch.point, ..touch }));
}

/// Adds the contacts that the library finds of two solids near the origin; returned is the one that turns
/// mantles least about their axes, added or not.
fn library_contacts(
    [a, b]: [Solid<'_>; 2],
    unit: f64,
    envelope: f64,
    touches: &mut Vec<Touch>,
) -> Option<Touch> {
    let ((shape_a, pose_a), (shape_b, pose_b)) = (a.scaled(unit), b.scaled(unit));
    let mut pose = pose_a.inv_mul(&pose_b);
    let prediction = envelope / unit;
    let mut manifold = library_manifold(&shape_a, &shape_b, &pose, prediction);
    if manifold.local_n1 != Vec3::ZERO && are_parallel(&pose) {
        // Where faces cover each other to the last digits the library clips them to nothing, or to places far
        // off. Beside each other by a little more they are clipped well; along the faces that moves no gap.
        let aside = manifold.local_n1.any_orthonormal_vector();
        let further = manifold.local_n1.cross(aside);
        let moved = ASIDE * (aside + 0.7 * further);
        pose.translation += moved;
        manifold = library_manifold(&shape_a, &shape_b, &pose, prediction);
        // Not along the faces, where the first normal was another one.
        let along = moved.dot(manifold.local_n1);
        manifold.points.iter_mut().for_each(|point| point.dist -= along);
    }
    // The library's normal points from A to B.
    let toward = pose_a.rotation * manifold.local_n1;
    // Edges of triangles are told by these points alone.
    let is_flat = [&shape_a, &shape_b].iter().any(|shape| matches!(shape, Convex::Triangle(_)));
    let mut nearest: Option<(f64, Touch)> = None;
    for point in &manifold.points {
        let gap = unit * point.dist;
        if !(gap <= envelope && toward.is_finite()) {
            continue;
        }
        let middle = 0.5 * (pose_a * point.local_p1 + pose_b * point.local_p2);
        let lever = [(&shape_a, &pose_a), (&shape_b, &pose_b)]
            .map(|(shape, pose)| shape.lever(pose, middle, toward))
            .into_iter()
            .fold(0.0, f64::max);
        let feature = u64::from(point.fid1.0) << 32 | u64::from(point.fid2.0);
        let touch = Touch { point: unit * middle, normal: -toward, gap, feature };
        if is_flat || lever <= BESIDE {
            touches.push(touch);
        } else if let Some(moved) = on_mantle([a, b], touch)
            && moved.gap <= envelope
        {
            touches.push(moved);
        }
        if nearest.is_none_or(|(least, _)| lever < least) {
            nearest = Some((lever, touch));
        }
    }
    nearest.map(|(_, touch)| touch)
}

/// The contact of a mantle at the height of this one, where a force spins it not: of A, or of B.
fn on_mantle([a, b]: [Solid<'_>; 2], touch: Touch) -> Option<Touch> {
    [(a, b, 1.0), (b, a, -1.0)].into_iter().find_map(|(own, other, sign)| {
        let point = foremost(own, other, touch.point)?;
        let Solid::Placed { shape, position, orientation } = other else { return None };
        let Distance { value: gap, normal } =
            shape.form().signed_distance(orientation.conjugate() * (point - position));
        let normal = orientation * normal;
        Some(Touch { point: point - 0.5 * gap * normal, normal: sign * normal, gap, ..touch })
    })
}

/// By this fraction of the smaller size a contact may be farther away than another one that counts for it.
const SAME: f64 = 1e-3;

/// Points at which a force along the normal would turn a mantle about its axis with a larger arm than this,
/// over its radius, are moved: lines that cross are no faces that look at each other.
const BESIDE: f64 = 1e-4;

/// By how much faces that cover each other exactly are moved aside, in sizes of the smaller solid.
const ASIDE: f64 = 1e-9;

/// Whether an axis of one solid is parallel to one of the other.
fn are_parallel(pose: &Pose) -> bool {
    let axes = Mat3::from_quat(pose.rotation);
    axes.to_cols_array().iter().any(|cosine| cosine.abs() > 1.0 - PARALLEL)
}

/// 1 less the cosine of axes that count as parallel: an angle of 1e-5.
const PARALLEL: f64 = 5e-11;

/// The library's manifold of two solids in its form, for gaps up to `prediction`.
fn library_manifold(
    shape_a: &Convex<'_>,
    shape_b: &Convex<'_>,
    pose: &Pose,
    prediction: f64,
) -> ContactManifold<(), ()> {
    let mut manifold = ContactManifold::<(), ()>::new();
    let [a, b] = [shape_a, shape_b].map(Convex::feature_map);
    contact_manifold_pfm_pfm(pose, a, 0.0, None, b, 0.0, None, prediction, &mut manifold);
    polish(shape_a, shape_b, pose, &mut manifold);
    manifold
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::collide::reduce::reduce;
    use crate::hull::Hull;
    use crate::math::rotation_exponential;
    use crate::shape::Cuboid;
    use proptest::prelude::*;

    /// Boxes on each other whose faces cover each other but for the last digits: four corners, whatever these
    /// digits are.
    #[test]
    fn faces_that_cover_each_other_touch_at_four_corners() {
        let shape = Shape::Box(Cuboid { half: Vec3::splat(0.1) });
        let mut state = 1_u64;
        let mut draw = |size: f64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            size * ((state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
        };
        for k in 0..20_000 {
            let size = 10_f64.powi(-(k % 6) - 13);
            let mut solid = |z: f64| {
                let shift = 0.1 * Vec3::new(draw(size), draw(size), draw(size));
                let turn = Vec3::new(draw(size), draw(size), draw(size));
                let orientation = Quat::from_scaled_axis(turn);
                Solid::Placed { shape: &shape, position: Vec3::new(0.0, 0.0, z) + shift, orientation }
            };
            let (a, b) = (solid(0.1), solid(0.3));
            let mut touches = Vec::new();
            manifold_contacts(a, b, 0.1, Vec3::new(0.0, 0.0, 0.2), 0.01, &mut touches);
            reduce(&mut touches);
            let (near, far): (Vec<_>, Vec<_>) = touches.iter().partition(|touch| touch.gap.abs() < 1e-12);
            assert!(near.len() == 4, "{k}: {size:e} {}", near.len());
            for Touch { point, normal, .. } in near {
                assert!(normal.z < -0.999 && (point.x.abs() - 0.1).abs() < 1e-8, "{k} {point}");
                assert!((point.y.abs() - 0.1).abs() < 1e-8, "{k} {point}");
            }
            assert!(far.iter().all(|touch| touch.gap > 0.0), "{k}");
        }
    }

    /// Boxes that lie on each other and tilt by hairs: the numbers of their contacts stay, whichever of the
    /// corners and edges that lie over one another rounding takes, or half of a warm start is lost.
    #[test]
    fn contacts_keep_their_numbers_while_bodies_tilt() {
        let shape = Shape::Box(Cuboid { half: Vec3::splat(0.5) });
        let beam = Shape::Box(Cuboid { half: Vec3::new(2.0, 0.1, 0.1) });
        let numbers = |(upper, place): (&Shape, Vec3), turn: f64, tilt: Vec3| {
            let orientation = Quat::from_scaled_axis(tilt) * Quat::from_rotation_z(turn);
            let a = Solid::Placed { shape: upper, position: place, orientation };
            let b = Solid::Placed { shape: &shape, position: Vec3::ZERO, orientation: Quat::IDENTITY };
            let mut touches = Vec::new();
            manifold_contacts(a, b, 0.866, Vec3::ZERO, 1e-3, &mut touches);
            reduce(&mut touches);
            touches.iter().map(|touch| touch.feature).collect::<Vec<_>>()
        };
        let half_over = (&shape, Vec3::new(0.5, 0.0, 1.0 - 1e-6));
        let beside = (&shape, Vec3::new(1.0 - 1e-6, 0.0, 0.0));
        let across = (&beam, Vec3::new(0.1, 0.2, 0.6 - 1e-6));
        for (case, turn) in [(half_over, 0.0), (beside, 0.0), (across, 0.0), (across, 0.4)] {
            let first = numbers(case, turn, Vec3::ZERO);
            assert_eq!(first.len(), 4);
            for k in 0..200 {
                let number = |i: usize| 1e-7 * (1.234 * (k * k + i * 37) as f64).sin();
                let tilt = Vec3::new(number(0), number(1), number(2));
                assert_eq!(numbers(case, turn, tilt), first, "{k}");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// Where the least distance is known, no contact is lost with the points of edges that are not looked
        /// at for it.
        #[test]
        fn a_known_distance_leaves_out_no_contact(
            place in prop::array::uniform3(-1.0..1.0_f64),
            turns in prop::array::uniform2(prop::array::uniform3(-3.0..3.0_f64)),
            (distance, tilt) in (0.2..1.0_f64, 0..3_i32),
        ) {
            let point = |k: u32| {
                let (a, b) = (1.7 * f64::from(k), 2.9 * f64::from(k));
                Vec3::new(0.5 * a.sin(), 0.4 * b.cos(), 0.3 * (a + b).sin())
            };
            let hull = Shape::Hull(Hull::new(&(0..20).map(point).collect::<Vec<_>>()).unwrap().0);
            let block = Shape::Box(Cuboid { half: Vec3::new(0.5, 0.3, 0.2) });
            // Boxes nearly face to face, or hulls and boxes anyhow.
            let small = [1.0, 1e-2, 1e-4][tilt as usize];
            let position = distance * Vec3::from_array(place).normalize_or(Vec3::Z);
            let turns = turns.map(|turn| rotation_exponential(small * Vec3::from_array(turn)));
            let one = if tilt == 0 { &hull } else { &block };
            let solids = [(one, Vec3::ZERO, turns[0]), (&block, position, turns[1])]
                .map(|(shape, position, orientation)| Solid::Placed { shape, position, orientation });
            let polyhedra = solids.map(|solid| Polyhedron::new(solid).unwrap());
            let (unit, envelope) = (0.5, 0.05);
            let mut found = Vec::new();
            if polyhedron_contacts(&polyhedra[0], &polyhedra[1], unit, envelope, &mut found) == Some(true) {
                let [with, without] = [Known::Distance, Known::Nothing].map(|known| {
                    let mut touches = found.clone();
                    let polyhedra = polyhedra.each_ref().map(Some);
                    add_corners(solids, known, polyhedra, (unit, envelope), &mut touches);
                    touches.iter().map(|touch| (touch.feature, touch.gap)).collect::<Vec<_>>()
                });
                prop_assert_eq!(with, without);
            }
        }
    }
}
