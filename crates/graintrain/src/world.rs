//! The state of a simulation: bodies in structure-of-arrays form, materials, gravity, time.

use crate::cell::Cell;
use crate::collide::identity::renamed;
use crate::contact::{Contact, ContactSet};
use crate::error::{ModelError, finite, index, positive};
use crate::handle::{BodyId, GeometryId, MaterialId, MotionId};
use crate::joint::PlacedJoint;
use crate::load::{Drag, Load};
use crate::material::Materials;
use crate::math::{Mat3, Quat, Vec3};
use crate::motion::{Motion, Profile};
use crate::shape::{Geometry, unit_quaternion};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

mod hash;

/// Which degrees of freedom are dynamic with one of these motions (see [`World::free_degrees`]).
pub(crate) fn free_degrees(motions: &[Motion], motion: MotionId) -> [bool; 6] {
    if motion == FREE { [true; 6] } else { motions[motion.index()].free }
}

/// All bodies, one entry per body in every list. Positions are centres of mass in the world frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Bodies {
    /// Names; empty for the many bodies made by a packing.
    pub name: Vec<String>,
    /// Index into [`World::geometries`].
    pub geometry: Vec<GeometryId>,
    /// Index into [`Materials`].
    pub material: Vec<MaterialId>,
    /// Index into [`World::motions`], or [`FREE`].
    pub motion: Vec<MotionId>,
    /// Centre of mass, m.
    pub position: Vec<Vec3>,
    /// Unit quaternion: rotation from body axes to world axes.
    pub orientation: Vec<Quat>,
    /// Velocity of the centre of mass, m/s.
    pub velocity: Vec<Vec3>,
    /// Angular velocity in world axes, rad/s.
    pub angular_velocity: Vec<Vec3>,
    /// Mass, kg; 0 for bodies without volume (they must be fully prescribed).
    pub mass: Vec<f64>,
    /// Inertia about the centre of mass in body axes, kg m^2.
    pub inertia: Vec<Mat3>,
    /// External force on the centre of mass in world axes, N, besides gravity: acts in every step until it is
    /// set anew. Degrees of freedom that are prescribed do not feel it.
    pub force: Vec<Vec3>,
    /// External torque about the centre of mass in world axes, N m; as `force`.
    pub torque: Vec<Vec3>,
}

/// Motion of a body whose six degrees of freedom are all dynamic.
pub const FREE: MotionId = MotionId::from_index(u32::MAX as usize);

/// The complete state: what a checkpoint holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct World {
    /// Simulated time, s.
    pub time: f64,
    /// Steps done.
    pub step: u64,
    /// Gravitational acceleration, m/s^2; of the step that was made last where it depends on time.
    pub gravity: Vec3,
    /// Gravity as a function of time, m/s^2, where it is one: see [`World::set_gravity_of_time`].
    pub gravity_of_time: Option<[Profile; 3]>,
    /// Loads on bodies, in the order in which they are summed.
    pub(crate) loads: Vec<Load>,
    /// Joints between bodies.
    pub(crate) joints: Vec<PlacedJoint>,
    /// Pairs of bodies that do not collide: see [`World::ignore_collisions`].
    pub(crate) ignored: Vec<[BodyId; 2]>,
    /// The cell in which space repeats, if it does: see [`World::set_cell`].
    pub(crate) cell: Option<Cell>,
    /// Geometries, shared by bodies and by what collision derives from them.
    pub geometries: Vec<Arc<Geometry>>,
    /// Materials.
    pub materials: Materials,
    /// Prescribed motions shared by bodies.
    pub motions: Vec<Motion>,
    /// The bodies.
    pub bodies: Bodies,
    /// Contacts of the last step with their impulses (warm start, output).
    pub contacts: ContactSet,
    /// Drag in the step that is being made, per body; empty where there is none, and between steps.
    #[serde(skip)]
    pub(crate) drag: Vec<Drag>,
}

/// A body to be added to a world; mass and inertia follow from geometry and density.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Name; may be empty.
    pub name: String,
    /// Its geometry.
    pub geometry: GeometryId,
    /// Its material.
    pub material: MaterialId,
    /// Its motion, or [`FREE`].
    pub motion: MotionId,
    /// Centre of mass, m.
    pub position: Vec3,
    /// Rotation from body axes to world axes.
    pub orientation: Quat,
    /// Velocity of the centre of mass, m/s.
    pub velocity: Vec3,
    /// Angular velocity in world axes, rad/s.
    pub angular_velocity: Vec3,
    /// Mass and inertia, where they do not follow from geometry and density.
    pub mass: Option<MassProperties>,
}

/// Mass and inertia of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassProperties {
    /// kg
    pub mass: f64,
    /// About the body's origin, which is taken for the centre of mass, in body axes, kg m^2.
    pub inertia: Mat3,
}

impl Body {
    /// A free body at rest, not rotated.
    pub fn new(geometry: GeometryId, material: MaterialId, position: Vec3) -> Self {
        Self {
            name: String::new(),
            geometry,
            material,
            motion: FREE,
            position,
            orientation: Quat::IDENTITY,
            velocity: Vec3::ZERO,
            angular_velocity: Vec3::ZERO,
            mass: None,
        }
    }
}

/// By which share of the trace a principal moment may exceed the sum of the others: given numbers are
/// rounded.
const ROUNDED: f64 = 1e-3;

impl MassProperties {
    /// Whether a body, for messages `label`, can have them.
    ///
    /// # Errors
    /// [`ModelError::Value`] for a mass that is not positive or a number that is not finite,
    /// [`ModelError::Inertia`] for a tensor that is not symmetric and positive definite, or has a principal
    /// moment above the sum of the others.
    pub fn validate(&self, label: &str) -> Result<(), ModelError> {
        positive(format!("the mass of body {label}"), self.mass)?;
        let columns = self.inertia.to_cols_array();
        finite(&format!("the inertia of body {label}"), &columns)?;
        // The leading minors of a symmetric matrix tell whether it is positive definite.
        let minor = columns[0] * columns[4] - columns[1] * columns[3];
        let symmetric = (self.inertia - self.inertia.transpose()).to_cols_array();
        if symmetric.iter().any(|x| x.abs() > 1e-9 * columns[0].abs()) {
            return Err(ModelError::Inertia { body: label.to_string() });
        }
        for leading in [columns[0], minor, self.inertia.determinant()] {
            if leading <= 0.0 {
                return Err(ModelError::Inertia { body: label.to_string() });
            }
        }
        // No principal moment of a distribution of mass exceeds the sum of the others: its second moments,
        // tr(I) / 2 - I, are not negative.
        let trace = columns[0] + columns[4] + columns[8];
        let moments =
            (Mat3::from_diagonal(Vec3::splat((0.5 + ROUNDED) * trace)) - self.inertia).to_cols_array_2d();
        let minor = moments[0][0] * moments[1][1] - moments[0][1] * moments[1][0];
        for leading in [moments[0][0], minor, Mat3::from_cols_array_2d(&moments).determinant()] {
            if leading < 0.0 {
                return Err(ModelError::Inertia { body: label.to_string() });
            }
        }
        Ok(())
    }
}

impl Default for World {
    /// An empty world at time 0 under the gravity of the Earth, 9.81 m/s^2 along -z, with one material
    /// `default` of 1000 kg/m^3, friction 0.25 and no restitution: what a scene has that says nothing.
    fn default() -> Self {
        let materials = Materials {
            names: vec!["default".to_string()],
            density: vec![1000.0],
            friction: vec![0.25],
            restitution: vec![0.0],
            ..Materials::default()
        };
        Self {
            time: 0.0,
            step: 0,
            gravity: Vec3::new(0.0, 0.0, -9.81),
            gravity_of_time: None,
            drag: Vec::new(),
            loads: Vec::new(),
            joints: Vec::new(),
            ignored: Vec::new(),
            cell: None,
            geometries: Vec::new(),
            materials,
            motions: Vec::new(),
            bodies: Bodies::default(),
            contacts: ContactSet::default(),
        }
    }
}

impl Bodies {
    /// Number of bodies.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// How messages call a body: its name, or its index where it has none.
    pub fn label(&self, body: usize) -> String {
        match self.name.get(body) {
            Some(name) if !name.is_empty() => format!("'{name}' (index {body})"),
            _ => format!("{body}"),
        }
    }
}

impl World {
    /// An empty world at time 0.
    ///
    /// # Errors
    /// [`ModelError::Value`] unless gravity is finite.
    pub fn new(gravity: Vec3, materials: Materials) -> Result<Self, ModelError> {
        finite("a component of gravity", &gravity.to_array())?;
        Ok(Self { gravity, materials, ..Self::default() })
    }

    /// Adds a geometry and returns its handle.
    pub fn add_geometry(&mut self, geometry: impl Into<Arc<Geometry>>) -> GeometryId {
        self.geometries.push(geometry.into());
        GeometryId::from_index(self.geometries.len() - 1)
    }

    /// Adds a motion and returns its handle.
    ///
    /// # Errors
    /// As [`Motion::validate`].
    pub fn add_motion(&mut self, motion: Motion) -> Result<MotionId, ModelError> {
        motion.validate()?;
        self.motions.push(motion);
        Ok(MotionId::from_index(self.motions.len() - 1))
    }

    /// Adds a body and returns its handle. Mass and inertia are density times those of the geometry, unless
    /// they are given.
    ///
    /// # Errors
    /// [`ModelError`] for an index that names nothing, a number that is not finite, a quaternion that is not
    /// normalised, a given inertia that is not positive definite, or a body without mass that is not fully
    /// prescribed.
    pub fn add_body(&mut self, body: Body) -> Result<BodyId, ModelError> {
        index("geometry", body.geometry.index(), self.geometries.len())?;
        index("material", body.material.index(), self.materials.len())?;
        if body.motion != FREE {
            index("motion", body.motion.index(), self.motions.len())?;
        }
        let label = if body.name.is_empty() {
            self.bodies.len().to_string()
        } else {
            format!("'{}' (index {})", body.name, self.bodies.len())
        };
        finite(&format!("a coordinate of body {label}"), &body.position.to_array())?;
        finite(&format!("a velocity of body {label}"), &body.velocity.to_array())?;
        finite(&format!("an angular velocity of body {label}"), &body.angular_velocity.to_array())?;
        unit_quaternion(&format!("the orientation of body {label}"), body.orientation)?;
        let geometry = &self.geometries[body.geometry.index()];
        let density = self.materials.density[body.material.index()];
        let MassProperties { mass, inertia } = match body.mass {
            None => {
                MassProperties { mass: density * geometry.volume, inertia: density * geometry.unit_inertia }
            }
            Some(given) => {
                given.validate(&label)?;
                given
            }
        };
        let prescribed = body.motion != FREE && self.motions[body.motion.index()].is_prescribed();
        if mass == 0.0 && !prescribed {
            return Err(ModelError::Massless { body: label });
        }
        let bodies = &mut self.bodies;
        bodies.mass.push(mass);
        bodies.inertia.push(inertia);
        bodies.name.push(body.name);
        bodies.geometry.push(body.geometry);
        bodies.material.push(body.material);
        bodies.motion.push(body.motion);
        bodies.position.push(body.position);
        bodies.orientation.push(body.orientation.normalize());
        bodies.velocity.push(body.velocity);
        bodies.angular_velocity.push(body.angular_velocity);
        bodies.force.push(Vec3::ZERO);
        bodies.torque.push(Vec3::ZERO);
        Ok(BodyId::from_index(bodies.len() - 1))
    }

    /// Adds an external force (N, world axes) that acts at a point (m, world frame) to those on a body: the
    /// same force on its centre of mass and the torque `(point - centre) x force`.
    ///
    /// # Errors
    /// [`ModelError::Index`] for a body that is none, [`ModelError::Value`] for a component that is not
    /// finite.
    pub fn add_force_at(&mut self, body: BodyId, force: Vec3, point: Vec3) -> Result<(), ModelError> {
        let body = body.index();
        index("body", body, self.bodies.len())?;
        finite("a component of a force", &force.to_array())?;
        finite("a coordinate of the point where a force acts", &point.to_array())?;
        self.bodies.force[body] += force;
        self.bodies.torque[body] += (point - self.bodies.position[body]).cross(force);
        Ok(())
    }

    /// Adds a load, which acts from the next step on.
    ///
    /// # Errors
    /// As [`Load::validate`], and [`ModelError::Index`] for a body that is none.
    pub fn add_load(&mut self, load: Load) -> Result<(), ModelError> {
        load.validate()?;
        let mut bodies = load.bodies.iter().flatten();
        bodies.try_for_each(|body| index("body", body.index(), self.bodies.len()))?;
        self.loads.push(load);
        Ok(())
    }

    /// From now on two bodies pass through each other: links of a robot whose shapes overlap where they meet.
    /// Bodies that a joint connects do so without it ([`Joint::collide`](crate::joint::Joint::collide)).
    ///
    /// # Errors
    /// [`ModelError::Index`] for a body that is none.
    pub fn ignore_collisions(&mut self, a: BodyId, b: BodyId) -> Result<(), ModelError> {
        [a, b].into_iter().try_for_each(|body| index("body", body.index(), self.bodies.len()))?;
        self.ignored.push([a, b]);
        Ok(())
    }

    /// Pairs of bodies that do not collide, by a joint or by themselves, lower index first, ascending.
    pub(crate) fn ignored_pairs(&self) -> Vec<[u32; 2]> {
        let of_joints = self.joints.iter().filter(|placed| !placed.joint.collide);
        let of_joints = of_joints.filter_map(|placed| match placed.joint.bodies {
            [Some(a), Some(b)] => Some([a, b]),
            _ => None,
        });
        let in_order = |[a, b]: [BodyId; 2]| {
            let (a, b) = (a.index() as u32, b.index() as u32);
            [a.min(b), a.max(b)]
        };
        let mut pairs: Vec<[u32; 2]> = of_joints.chain(self.ignored.iter().copied()).map(in_order).collect();
        pairs.sort_unstable();
        pairs
    }

    /// Puts these loads in the place of all that there are.
    ///
    /// # Errors
    /// As [`Self::add_load`]; the loads are then as they were.
    pub fn set_loads(&mut self, loads: Vec<Load>) -> Result<(), ModelError> {
        let before = std::mem::take(&mut self.loads);
        let added = loads.into_iter().try_for_each(|load| self.add_load(load));
        if added.is_err() {
            self.loads = before;
        }
        added
    }

    /// The loads, in the order in which they are summed.
    pub fn loads(&self) -> &[Load] {
        &self.loads
    }

    /// Makes gravity a function of time, m/s^2 in world axes: every step takes its mean.
    ///
    /// # Errors
    /// As [`Profile::validate`].
    pub fn set_gravity_of_time(&mut self, gravity: [Profile; 3]) -> Result<(), ModelError> {
        gravity.iter().try_for_each(Profile::validate)?;
        self.gravity_of_time = Some(gravity);
        Ok(())
    }

    /// Sets the external forces and torques on all bodies to zero; loads stay.
    pub fn clear_forces(&mut self) {
        self.bodies.force.fill(Vec3::ZERO);
        self.bodies.torque.fill(Vec3::ZERO);
    }

    /// Removes the bodies for which `remove` (called once for each index, ascending) is true, with their
    /// contacts and joints, and from the lists of loads. The others keep their order and move up: returned is
    /// the new handle of every former body, `None` for those that are gone. Impulses between those that stay
    /// start the next solve. Cost: linear.
    pub fn remove_bodies(&mut self, mut remove: impl FnMut(usize) -> bool) -> Vec<Option<BodyId>> {
        let mut next = 0;
        let new_index: Vec<Option<BodyId>> = (0..self.bodies.len())
            .map(|body| {
                let index = (!remove(body)).then(|| BodyId::from_index(next));
                next += usize::from(index.is_some());
                index
            })
            .collect();
        let Bodies {
            name,
            geometry,
            material,
            motion,
            position,
            orientation,
            velocity,
            angular_velocity,
            mass,
            inertia,
            force,
            torque,
        } = &mut self.bodies;
        keep(name, &new_index);
        keep(geometry, &new_index);
        keep(material, &new_index);
        keep(motion, &new_index);
        for vectors in [position, velocity, angular_velocity, force, torque] {
            keep(vectors, &new_index);
        }
        keep(orientation, &new_index);
        keep(mass, &new_index);
        keep(inertia, &new_index);
        for bodies in self.loads.iter_mut().filter_map(|load| load.bodies.as_mut()) {
            *bodies = bodies.iter().filter_map(|body| new_index[body.index()]).collect();
        }
        self.keep_joints(&new_index);
        let ignored = std::mem::take(&mut self.ignored).into_iter();
        self.ignored =
            ignored.filter_map(|[a, b]| Some([new_index[a.index()]?, new_index[b.index()]?])).collect();
        let set = std::mem::take(&mut self.contacts);
        self.contacts.curvature = set.curvature;
        let friction = set.friction.into_iter().map(Some).chain(std::iter::repeat(None));
        let moment = set.moment.into_iter().map(Some).chain(std::iter::repeat(None));
        let bounced = set.bounced.into_iter().map(Some).chain(std::iter::repeat(None));
        let impulses = set.impulse.into_iter().zip(moment.zip(bounced));
        for ((mut contact, (impulse, (moment, bounced))), friction) in
            set.contacts.into_iter().zip(impulses).zip(friction)
        {
            let [a, b] =
                [contact.body_a, contact.body_b].map(|body| Some(new_index[body as usize]?.index() as u32));
            if let (Some(a), Some(b)) = (a, b) {
                if [a, b] != [contact.body_a, contact.body_b] {
                    // Identities are made of indices.
                    contact.identity = renamed(contact.identity, [contact.body_a, contact.body_b], [a, b]);
                }
                (contact.body_a, contact.body_b) = (a, b);
                self.contacts.contacts.push(contact);
                self.contacts.impulse.push(impulse);
                self.contacts.friction.extend(friction);
                self.contacts.moment.extend(moment);
                self.contacts.bounced.extend(bounced);
            }
        }
        new_index
    }

    /// Largest acceleration, m/s^2, that gravity alone or with its external force gives a body: how far it
    /// may fall beyond its velocity within a step.
    pub(crate) fn acceleration(&self, body: usize) -> f64 {
        let gravity = self.gravity.length();
        let mut force = self.bodies.force[body];
        if let Some(drag) = self.drag.get(body) {
            force += drag.alone;
        }
        if force == Vec3::ZERO || self.is_prescribed(body) {
            return gravity;
        }
        gravity.max((self.gravity + force / self.bodies.mass[body]).length())
    }

    /// The largest of [`Self::acceleration`] over all bodies.
    pub(crate) fn largest_acceleration(&self) -> f64 {
        (0..self.bodies.len()).map(|body| self.acceleration(body)).fold(self.gravity.length(), f64::max)
    }

    /// Whether all six degrees of freedom of the body are dynamic.
    pub fn is_free(&self, body: usize) -> bool {
        self.bodies.motion[body] == FREE
    }

    /// Indices of the materials of both bodies of a contact.
    pub(crate) fn materials_of(&self, contact: &Contact) -> [usize; 2] {
        [contact.body_a, contact.body_b].map(|body| self.bodies.material[body as usize].index())
    }

    /// Whether no degree of freedom of the body is dynamic.
    pub fn is_prescribed(&self, body: usize) -> bool {
        match self.bodies.motion[body] {
            FREE => false,
            motion => self.motions[motion.index()].is_prescribed(),
        }
    }

    /// Which degrees of freedom of the body are dynamic.
    pub fn free_degrees(&self, body: usize) -> [bool; 6] {
        free_degrees(&self.motions, self.bodies.motion[body])
    }

    /// Kinetic energy of the bodies with a dynamic degree of freedom, 1/2 m |u|^2 + 1/2 w . I w, J; in a
    /// periodic cell with u relative to its deformation ([`World::fluctuation`]).
    pub fn kinetic_energy(&self) -> f64 {
        let bodies = &self.bodies;
        (0..bodies.len())
            .filter(|&b| !self.is_prescribed(b))
            .map(|b| {
                let w = bodies.orientation[b].inverse() * bodies.angular_velocity[b];
                0.5 * (bodies.mass[b] * self.fluctuation(b).length_squared() + w.dot(bodies.inertia[b] * w))
            })
            // The sum of nothing is -0.
            .fold(0.0, |sum, energy| sum + energy)
    }

    /// The cell in which space repeats, if it does.
    pub fn cell(&self) -> Option<&Cell> {
        self.cell.as_ref()
    }
}

/// Drops the entries of bodies that are gone.
fn keep<T>(list: &mut Vec<T>, new_index: &[Option<BodyId>]) {
    let mut kept = new_index.iter().map(Option::is_some);
    list.retain(|_| kept.next().unwrap_or(true));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn world() -> World {
        let materials = Materials::single("glass", 2500.0, 0.3, 0.0).unwrap();
        World::new(Vec3::new(0.0, 0.0, -9.81), materials).unwrap()
    }

    /// A rod has one moment of zero and a plate one that is the sum of the others; no body has one above
    /// that.
    #[test]
    fn moments_of_inertia_are_those_of_a_body() {
        let turned = |moments: [f64; 3]| {
            let turn = Mat3::from_quat(Quat::from_rotation_x(0.7) * Quat::from_rotation_y(1.1));
            let inertia = turn * Mat3::from_diagonal(moments.into()) * turn.transpose();
            MassProperties { mass: 1.0, inertia: 0.5 * (inertia + inertia.transpose()) }.validate("stone")
        };
        assert!(
            turned([1.0, 1.0, 2.0]).is_ok()
                && turned([1.0, 1.0, 1e-9]).is_ok()
                && turned([2.0, 3.0, 4.0]).is_ok()
        );
        for moments in [[1.0, 1.0, 5.0], [1.0, 2.1, 1.0], [3.0, 1.0, 1.9], [1.0, -1.0, 1.0]] {
            let said = turned(moments).unwrap_err().to_string();
            assert!(said.contains("stone") && said.contains("sum of the others"), "{said}");
        }
    }

    #[test]
    fn mass_follows_from_density() {
        let mut world = world();
        let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
        let body = world.add_body(Body::new(ball, MaterialId::default(), Vec3::ZERO)).unwrap().index();
        let mass = 2500.0 * 4.0 / 3.0 * std::f64::consts::PI * 1e-3;
        assert!((world.bodies.mass[body] - mass).abs() < 1e-12);
        assert!((world.bodies.inertia[body].x_axis.x - 0.4 * mass * 0.01).abs() < 1e-14);
    }

    #[test]
    fn bad_bodies_are_refused() {
        let mut world = world();
        let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
        let plane = world.add_geometry(Geometry::plane());
        let along_x = Motion::translating(Vec3::X, Profile::Constant(1.0));
        let half_free =
            world.add_motion(along_x.with_free([false, false, true, false, false, false])).unwrap();
        let good = Body::new(ball, MaterialId::default(), Vec3::ZERO);
        let bad = [
            Body { geometry: GeometryId::from_index(7), ..good.clone() },
            Body { material: MaterialId::from_index(1), ..good.clone() },
            Body { motion: MotionId::from_index(3), ..good.clone() },
            Body { position: Vec3::new(f64::NAN, 0.0, 0.0), ..good.clone() },
            Body { velocity: Vec3::new(f64::INFINITY, 0.0, 0.0), ..good.clone() },
            Body { orientation: Quat::from_xyzw(0.0, 0.0, 0.0, 2.0), ..good.clone() },
            Body { geometry: plane, ..good.clone() },
            Body { geometry: plane, motion: half_free, ..good.clone() },
        ];
        for body in bad {
            assert!(world.add_body(body.clone()).is_err(), "{body:?}");
        }
        assert!(world.bodies.is_empty());
        assert!(world.add_body(good).is_ok());
    }
}
