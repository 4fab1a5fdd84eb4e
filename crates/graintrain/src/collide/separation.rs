//! Planes between convex bodies that are apart.

use super::manifold::Solid;
use crate::math::{Pose, Vec3};
use crate::shape::library::Convex;
use crate::shape::{Capsule, HalfSpace, Shape, Sphere};
use parry3d_f64::query::gjk::{CsoPoint, GJKResult, VoronoiSimplex, closest_points};
use parry3d_f64::shape::SupportMap;

/// A direction n from B to A along which two convex solids are apart, and how far they are along it,
/// `min over A of n . x - max over B of n . x > 0`: no more than their distance, and but for what GJK cannot
/// solve that to a part in 1e7, or more than `far`. None where no such direction is found: where they touch.
/// `unit` is the size of the smaller one and `origin` a point nearby. Cost: that of GJK, some support points
/// of each.
pub(super) fn separation(solids: [Solid<'_>; 2], unit: f64, origin: Vec3, far: f64) -> Option<(f64, Vec3)> {
    let [a, b] = solids.map(|solid| solid.seen_from(origin));
    let (gap, normal) = match [a, b].map(half_space) {
        [_, Some((normal, offset))] => (-a.reach(-normal) - offset, normal),
        [Some((normal, offset)), _] => (-b.reach(-normal) - offset, -normal),
        [None, None] => {
            let [one, other] = [a, b].map(|solid| Core::of(solid, unit));
            let mut simplex = VoronoiSimplex::new();
            let toward = (b.centre() - a.centre()).normalize_or(Vec3::X);
            simplex.reset(CsoPoint::from_shapes(&Pose::IDENTITY, &one, &other, toward));
            let far = far / unit + one.radius + other.radius;
            let found = closest_points(&Pose::IDENTITY, &one, &other, far, true, &mut simplex);
            // It may run out of iterations.
            let ways = match found {
                GJKResult::ClosestPoints(p, q, way) => [way, q - p, toward],
                GJKResult::NoIntersection(way) => [way, toward, toward],
                _ => return None,
            };
            let along = |way: Vec3| {
                let way = way.normalize_or(toward);
                (-b.reach(-way) - a.reach(way), -way)
            };
            ways.into_iter().map(along).find(|(gap, _)| *gap > 0.0)?
        }
    };
    (gap > 0.0).then_some((gap, normal))
}

/// Outward normal and offset along it of a half space.
fn half_space(solid: Solid<'_>) -> Option<(Vec3, f64)> {
    match solid {
        Solid::Placed { shape: Shape::Plane(HalfSpace), position, orientation } => {
            let normal = orientation * Vec3::Z;
            Some((normal, normal.dot(position)))
        }
        _ => None,
    }
}

/// A solid without the radius of what is round all over: a point of a ball, the axis of a capsule. Lengths in
/// units of the smaller solid.
struct Core<'a> {
    form: CoreForm<'a>,
    radius: f64,
}

enum CoreForm<'a> {
    Line([Vec3; 2]),
    Solid(Convex<'a>, Pose),
}

impl<'a> Core<'a> {
    fn of(solid: Solid<'a>, unit: f64) -> Self {
        let line = |from: Vec3, to: Vec3, radius: f64| Self {
            form: CoreForm::Line([from / unit, to / unit]),
            radius: radius / unit,
        };
        match solid {
            Solid::Placed { shape: &Shape::Sphere(Sphere { radius }), position, .. } => {
                line(position, position, radius)
            }
            Solid::Placed {
                shape: &Shape::Capsule(Capsule { half_length, radius }),
                position,
                orientation,
            } => {
                let half = orientation * (half_length * Vec3::Z);
                line(position - half, position + half, radius)
            }
            _ => {
                let (convex, pose) = solid.scaled(unit);
                Self { form: CoreForm::Solid(convex, pose), radius: 0.0 }
            }
        }
    }
}

impl SupportMap for Core<'_> {
    fn local_support_point(&self, direction: Vec3) -> Vec3 {
        match &self.form {
            CoreForm::Line([from, to]) => {
                if direction.dot(*to - *from) > 0.0 {
                    *to
                } else {
                    *from
                }
            }
            CoreForm::Solid(convex, pose) => {
                *pose * convex.support_map().local_support_point(pose.rotation.inverse() * direction)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::collide::narrow::{Collidable, Placed, body_contacts};
    use crate::math::rotation_exponential;
    use crate::shape::Geometry;
    use proptest::prelude::*;

    fn forms() -> Vec<Collidable> {
        let stone: Vec<Vec3> = (0..12_u32)
            .map(|k| {
                let (a, b) = (1.7 * f64::from(k), 2.9 * f64::from(k));
                Vec3::new(0.4 * a.sin(), 0.3 * b.cos(), 0.25 * (a + b).sin())
            })
            .collect();
        let all = [
            Geometry::sphere(0.3),
            Geometry::capsule(0.4, 0.1),
            Geometry::cuboid(Vec3::new(0.4, 0.3, 0.02)),
            Geometry::cylinder(0.05, 0.3),
            Geometry::hull(&stone).map(|(hull, _)| hull),
            Geometry::cone(0.4, 0.3, 0.1),
            Ok(Geometry::plane()),
        ];
        all.map(|geometry| Collidable::new(geometry.unwrap())).into_iter().collect()
    }

    proptest! {
        /// The nearest contact, which is found in other ways, is as far as the plane leaves them apart; what
        /// overlaps has no plane.
        #[test]
        fn bodies_are_as_far_apart_as_their_nearest_contact(
            which in (0..7_usize, 0..6_usize),
            place in prop::array::uniform3(-1.0..1.0_f64),
            turns in prop::array::uniform2(prop::array::uniform3(-2.0..2.0_f64)),
        ) {
            let forms = forms();
            let orientation = turns.map(|turn| rotation_exponential(Vec3::from_array(turn)));
            let a = Placed { form: &forms[which.0], position: Vec3::ZERO, orientation: orientation[0] };
            let position = Vec3::from_array(place);
            let b = Placed { form: &forms[which.1], position, orientation: orientation[1] };
            let mut touches = Vec::new();
            body_contacts(a, b, 3.0, &mut touches);
            let nearest = touches.iter().map(|touch| touch.gap).fold(f64::INFINITY, f64::min);
            let [one, other] = [a, b].map(|body| body.part(0).solid());
            match separation([one, other], 0.3, position, 3.0) {
                Some((gap, normal)) => {
                    prop_assert!((gap - nearest).abs() < 1e-6, "{gap} {nearest}");
                    let along = -one.reach(-normal) - other.reach(normal);
                    prop_assert!(which.0 == 6 || (along - gap).abs() < 1e-12, "{along} {gap}");
                    let far = separation([one, other], 0.3, position, 0.1 * gap);
                    prop_assert!(far.is_some_and(|(along, _)| along >= 0.1 * gap && along <= gap + 1e-9));
                }
                None => prop_assert!(nearest < 1e-9, "{nearest}"),
            }
        }
    }
}
