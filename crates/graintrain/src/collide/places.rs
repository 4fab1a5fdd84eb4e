//! Whether there is room for another body: for bodies that enter while a run goes.

use super::broad::Collider;
use super::narrow::{Collidable, Placed, body_contacts};
use crate::math::{Quat, Vec3};
use crate::shape::{Geometry, HalfSpace, Shape};
use crate::world::World;

/// The bodies near a box, to be asked again and again.
pub struct Places<'a> {
    collider: &'a Collider,
    /// Indices of the bodies near the box, ascending.
    near: Vec<usize>,
}

/// A form that looks for a place.
pub struct Newcomer(Collidable);

impl Newcomer {
    /// Of this geometry.
    pub fn new(geometry: &Geometry) -> Self {
        Self(Collidable::new(geometry.clone()))
    }

    /// Radius of a ball about its origin that holds it, m.
    pub fn bounding_radius(&self) -> f64 {
        self.0.bounding_radius
    }
}

impl<'a> Places<'a> {
    /// The bodies of a world whose bounds meet the box from `low` to `high` (m). Cost: linear in the bodies
    /// of the world. The collider keeps what it derives from geometries for the next time.
    pub fn new(collider: &'a mut Collider, world: &World, low: Vec3, high: Vec3) -> Self {
        collider.update_forms(world);
        let collider = &*collider;
        let meets = |&body: &usize| {
            // Images may be near that are not looked for here.
            if world.cell().is_some() {
                return true;
            }
            let form = collider.placed(world, body).form;
            let centre = world.bodies.position[body];
            if let Some(radius) = form.ball {
                return (centre.clamp(low, high) - centre).length_squared() <= radius * radius;
            }
            // Planes reach everywhere.
            if form.bounding_radius.is_infinite() {
                return true;
            }
            let bounds = collider.bounds(world, body);
            bounds.mins.cmple(high).all() && bounds.maxs.cmpge(low).all()
        };
        Self { collider, near: (0..world.bodies.len()).filter(meets).collect() }
    }

    /// Whether a body of this form could stand there with a gap of more than `clearance` (m, not negative) to
    /// every body near the box and to those (centre, radius of a ball that holds it) that have just found a
    /// place.
    pub fn is_free(
        &self,
        world: &World,
        newcomer: &Newcomer,
        (position, orientation): (Vec3, Quat),
        clearance: f64,
        others: &[(Vec3, f64)],
    ) -> bool {
        let me = Placed { form: &newcomer.0, position, orientation };
        let reach = me.form.bounding_radius + clearance;
        let apart = |centre: Vec3, radius: f64| {
            let way = centre - position;
            let way = world.cell().map_or(way, |cell| cell.nearest(way).1);
            way.length_squared() > (reach + radius) * (reach + radius)
        };
        let mut touches = Vec::new();
        others.iter().all(|&(centre, radius)| apart(centre, radius))
            && self.near.iter().all(|&body| {
                let mut them = self.collider.placed(world, body);
                if let Some(cell) = world.cell().filter(|_| !world.is_unbounded(body)) {
                    them.position = position + cell.nearest(them.position - position).1;
                }
                if apart(them.position, them.form.bounding_radius) {
                    return true;
                }
                if me.form.ball.is_some() && them.form.ball.is_some() {
                    return false;
                }
                // Within a half-space there is no room, however deep.
                let behind = them.form.geometry.parts.iter().any(|part| {
                    let normal = them.orientation * (part.orientation * Vec3::Z);
                    let origin = them.position + them.orientation * part.position;
                    part.shape == Shape::Plane(HalfSpace) && (position - origin).dot(normal) < 0.0
                });
                touches.clear();
                body_contacts(me, them, clearance, &mut touches);
                !behind && touches.iter().all(|touch| touch.gap > clearance)
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handle::MaterialId;
    use crate::material::Materials;
    use crate::motion::Motion;
    use crate::world::Body;

    /// A ball, a box, a floor and a triangle; free is what is farther from each than the clearance.
    #[test]
    fn room_is_what_distances_leave() {
        let mut world = World::new(Vec3::ZERO, Materials::single("a", 1.0, 0.0, 0.0).unwrap()).unwrap();
        let fixed = world.add_motion(Motion::fixed()).unwrap();
        let forms = [
            (Geometry::sphere(0.5).unwrap(), Vec3::new(0.0, 0.0, 2.0)),
            (Geometry::cuboid(Vec3::splat(0.5)).unwrap(), Vec3::new(3.0, 0.0, 2.0)),
            (Geometry::plane(), Vec3::ZERO),
            (
                Geometry::mesh(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]).unwrap(),
                Vec3::new(0.0, 5.0, 2.0),
            ),
        ];
        for (form, place) in forms {
            let geometry = world.add_geometry(form);
            let body = Body { motion: fixed, ..Body::new(geometry, MaterialId::default(), place) };
            world.add_body(body).unwrap();
        }
        let mut collider = Collider::default();
        let ball = Newcomer::new(&Geometry::sphere(0.25).unwrap());
        let free = |collider: &mut Collider, at: Vec3, clearance: f64, others: &[(Vec3, f64)]| {
            let places = Places::new(collider, &world, at - 0.3, at + 0.3);
            places.is_free(&world, &ball, (at, Quat::IDENTITY), clearance, others)
        };
        let mut check = |at: [f64; 3], gap: f64| {
            let at = Vec3::from_array(at);
            if gap > 0.0 {
                assert!(free(&mut collider, at, 0.99 * gap, &[]), "{at}");
            }
            assert!(!free(&mut collider, at, 1.01 * gap.max(0.0) + 1e-9, &[]), "{at}");
            assert!(!free(&mut collider, at, 0.0, &[(at + Vec3::X, 0.76)]));
        };
        check([0.8, 0.0, 2.0], 0.05);
        check([2.2, 0.0, 2.0], 0.05);
        check([1.5, 1.5, 0.3], 0.05);
        check([0.2, 5.2, 2.29], 0.04);
        // Inside of the floor, and of the ball.
        check([1.5, 1.5, -7.0], 0.0);
        check([0.0, 0.1, 2.0], 0.0);
        check([3.1, 0.1, 2.0], 0.0);
    }
}
