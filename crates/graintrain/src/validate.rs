//! Whether a world read from somewhere is one that a step can be made from.

use crate::error::{ModelError, finite, index, not_below_zero, positive};
use crate::math::Vec3;
use crate::shape::unit_quaternion;
use crate::world::{FREE, World};

fn same_length(what: &'static str, found: usize, expected: usize) -> Result<(), ModelError> {
    if found == expected {
        return Ok(());
    }
    Err(ModelError::Length { what, found, expected })
}

fn vectors(what: &str, list: &[Vec3]) -> Result<(), ModelError> {
    list.iter().try_for_each(|vector| finite(what, &vector.to_array()))
}

impl World {
    /// Checks everything that the functions which make a world check one by one: lists of equal length,
    /// indices that name something, numbers in their ranges. Worlds made by this library pass; one that was
    /// put together by other means (a file) may not. Cost: linear.
    ///
    /// # Errors
    /// [`ModelError`] for the first defect.
    pub fn validate(&self) -> Result<(), ModelError> {
        finite("the time", &[self.time])?;
        finite("a component of gravity", &self.gravity.to_array())?;
        self.gravity_of_time.iter().flatten().try_for_each(|profile| profile.validate())?;
        self.validate_materials()?;
        for geometry in &self.geometries {
            if geometry.parts.is_empty() && geometry.volume != 0.0 {
                return Err(ModelError::Empty { what: "a geometry with a volume" });
            }
            for part in &geometry.parts {
                part.shape.validate()?;
                finite("the place of a part", &part.position.to_array())?;
                unit_quaternion("the orientation of a part", part.orientation)?;
            }
            finite("the volume of a geometry", &[geometry.volume])?;
            finite("the inertia of a geometry", &geometry.unit_inertia.to_cols_array())?;
        }
        self.motions.iter().try_for_each(|motion| motion.validate())?;
        self.validate_bodies()?;
        for load in &self.loads {
            load.validate()?;
            let bodies = load.bodies.iter().flatten();
            bodies.into_iter().try_for_each(|body| index("body", body.index(), self.bodies.len()))?;
        }
        self.validate_joints()?;
        self.ignored.iter().flatten().try_for_each(|body| index("body", body.index(), self.bodies.len()))?;
        self.validate_cell()?;
        self.validate_contacts()
    }

    fn validate_materials(&self) -> Result<(), ModelError> {
        let materials = &self.materials;
        let count = materials.len();
        same_length("densities of materials", materials.density.len(), count)?;
        same_length("coefficients of friction", materials.friction.len(), count * count)?;
        same_length("coefficients of restitution", materials.restitution.len(), count * count)?;
        let turning = [&materials.rolling, &materials.spinning];
        if turning.iter().any(|table| !table.is_empty()) {
            for table in turning {
                same_length("resistances to turning", table.len(), count * count)?;
            }
        }
        for resistance in turning.into_iter().flatten() {
            not_below_zero("a resistance to turning", resistance.value())?;
        }
        materials.density.iter().try_for_each(|&density| positive("the density of a material", density))?;
        materials.friction.iter().try_for_each(|&mu| not_below_zero("a coefficient of friction", mu))?;
        for &value in &materials.restitution {
            if !(0.0..=1.0).contains(&value) {
                let what = "a coefficient of restitution".to_string();
                return Err(ModelError::Value { what, value, expected: "in [0, 1]" });
            }
        }
        Ok(())
    }

    fn validate_bodies(&self) -> Result<(), ModelError> {
        let bodies = &self.bodies;
        let count = bodies.len();
        for (what, found) in [
            ("names of bodies", bodies.name.len()),
            ("geometries of bodies", bodies.geometry.len()),
            ("materials of bodies", bodies.material.len()),
            ("motions of bodies", bodies.motion.len()),
            ("orientations of bodies", bodies.orientation.len()),
            ("velocities of bodies", bodies.velocity.len()),
            ("angular velocities of bodies", bodies.angular_velocity.len()),
            ("masses of bodies", bodies.mass.len()),
            ("inertias of bodies", bodies.inertia.len()),
            ("forces on bodies", bodies.force.len()),
            ("torques on bodies", bodies.torque.len()),
        ] {
            same_length(what, found, count)?;
        }
        vectors("a coordinate of a body", &bodies.position)?;
        vectors("a velocity of a body", &bodies.velocity)?;
        vectors("an angular velocity of a body", &bodies.angular_velocity)?;
        vectors("an external force on a body", &bodies.force)?;
        vectors("an external torque on a body", &bodies.torque)?;
        for body in 0..count {
            index("geometry", bodies.geometry[body].index(), self.geometries.len())?;
            index("material", bodies.material[body].index(), self.materials.len())?;
            if bodies.motion[body] != FREE {
                index("motion", bodies.motion[body].index(), self.motions.len())?;
            }
            unit_quaternion("the orientation of a body", bodies.orientation[body])?;
            let (mass, inertia) = (bodies.mass[body], bodies.inertia[body]);
            finite("the inertia of a body", &inertia.to_cols_array())?;
            if !self.is_prescribed(body) {
                positive("the mass of a body", mass)?;
                // Its inverse is what a step takes.
                if inertia.determinant() <= 0.0 {
                    return Err(ModelError::Inertia { body: bodies.label(body) });
                }
            } else {
                not_below_zero("the mass of a body", mass)?;
            }
        }
        Ok(())
    }

    fn validate_contacts(&self) -> Result<(), ModelError> {
        let set = &self.contacts;
        same_length("impulses of contacts", set.impulse.len(), set.contacts.len())?;
        same_length("coefficients of friction of contacts", set.friction.len(), set.contacts.len())?;
        if !set.moment.is_empty() {
            same_length("moments of contacts", set.moment.len(), set.contacts.len())?;
        }
        if !set.bounced.is_empty() {
            same_length("marks of contacts that bounced", set.bounced.len(), set.contacts.len())?;
        }
        vectors("an impulse", &set.impulse)?;
        vectors("a moment", &set.moment)?;
        finite("the friction of a contact", &set.friction)?;
        for contact in &set.contacts {
            index("body", contact.body_a as usize, self.bodies.len())?;
            index("body", contact.body_b as usize, self.bodies.len())?;
            vectors("a place of a contact", &[contact.point, contact.normal, contact.lead])?;
            finite("the gap of a contact", &[contact.gap])?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::Contact;
    use crate::handle::{BodyId, GeometryId, MaterialId, MotionId};
    use crate::material::TurningResistance;
    use crate::shape::Geometry;
    use crate::world::Body;
    use std::sync::Arc;

    fn world() -> World {
        let mut world = World::default();
        let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
        world.add_body(Body::new(ball, MaterialId::default(), Vec3::ZERO)).unwrap();
        world.add_body(Body::new(ball, MaterialId::default(), Vec3::X)).unwrap();
        world
    }

    /// Every list and number of which a step would make a panic or nonsense.
    #[test]
    fn worlds_that_no_step_can_be_made_from_are_refused() {
        assert_eq!(world().validate(), Ok(()));
        let damages: [fn(&mut World); 21] = [
            |w| w.time = f64::NAN,
            |w| w.gravity.z = f64::INFINITY,
            |w| w.materials.density.clear(),
            |w| w.materials.friction[0] = -0.1,
            |w| w.materials.restitution.push(0.0),
            |w| w.materials.rolling.push(TurningResistance::NONE),
            |w| {
                w.materials.rolling.push(TurningResistance::Length(-1.0));
                w.materials.spinning.push(TurningResistance::NONE);
            },
            |w| w.contacts.moment.push(Vec3::ZERO),
            |w| w.contacts.bounced.push(true),
            |w| Arc::make_mut(&mut w.geometries[0]).parts.clear(),
            |w| w.ignored.push([1, 2].map(BodyId::from_index)),
            |w| Arc::make_mut(&mut w.geometries[0]).parts[0].position.x = f64::NAN,
            |w| w.bodies.name.truncate(1),
            |w| w.bodies.velocity.push(Vec3::ZERO),
            |w| w.bodies.geometry[1] = GeometryId::from_index(1),
            |w| w.bodies.motion[1] = MotionId::from_index(0),
            |w| w.bodies.mass[0] = 0.0,
            |w| w.bodies.inertia[0] *= -1.0,
            |w| w.bodies.orientation[0].w = 2.0,
            |w| w.contacts.impulse.push(Vec3::ZERO),
            |w| {
                let contact = Contact {
                    body_a: 0,
                    body_b: 7,
                    identity: 1,
                    point: Vec3::ZERO,
                    normal: Vec3::X,
                    gap: 0.0,
                    lead: Vec3::ZERO,
                    image: [0; 3],
                };
                w.contacts.contacts.push(contact);
                w.contacts.impulse.push(Vec3::ZERO);
                w.contacts.friction.push(0.3);
            },
        ];
        for (number, damage) in damages.into_iter().enumerate() {
            let mut damaged = world();
            damage(&mut damaged);
            assert!(damaged.validate().is_err(), "damage {number}");
        }
    }
}
