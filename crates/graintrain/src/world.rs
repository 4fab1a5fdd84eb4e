//! The state of a simulation: bodies in structure-of-arrays form, materials, gravity, time.

use crate::contact::ContactSet;
use crate::material::Materials;
use crate::math::{Mat3, Quat, Vec3};
use crate::motion::Motion;
use crate::shape::Geometry;
use serde::{Deserialize, Serialize};

/// All bodies, one entry per body in every list. Positions are centres of mass in the world frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Bodies {
    /// Names; empty for the many bodies made by a packing.
    pub name: Vec<String>,
    /// Index into [`World::geometries`].
    pub geometry: Vec<u32>,
    /// Index into [`Materials`].
    pub material: Vec<u32>,
    /// Index into [`World::motions`], or [`FREE`].
    pub motion: Vec<u32>,
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
}

/// Motion index of a body whose six degrees of freedom are all dynamic.
pub const FREE: u32 = u32::MAX;

/// The complete state: what a checkpoint holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct World {
    /// Simulated time, s.
    pub time: f64,
    /// Steps done.
    pub step: u64,
    /// Gravitational acceleration, m/s^2.
    pub gravity: Vec3,
    /// Geometries shared by bodies.
    pub geometries: Vec<Geometry>,
    /// Materials.
    pub materials: Materials,
    /// Prescribed motions shared by bodies.
    pub motions: Vec<Motion>,
    /// The bodies.
    pub bodies: Bodies,
    /// Contacts of the last step with their impulses (warm start, output).
    pub contacts: ContactSet,
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
}

impl World {
    /// Whether all six degrees of freedom of the body are dynamic.
    pub fn is_free(&self, body: usize) -> bool {
        self.bodies.motion[body] == FREE
    }

    /// Which degrees of freedom of the body are dynamic.
    pub fn free_degrees(&self, body: usize) -> [bool; 6] {
        match self.bodies.motion[body] {
            FREE => [true; 6],
            motion => self.motions[motion as usize].free,
        }
    }
}
