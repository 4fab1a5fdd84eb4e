//! Prescribed motion: velocities as functions of time, and which degrees of freedom they hold.

use crate::math::Vec3;
use serde::{Deserialize, Serialize};

/// A scalar velocity (m/s or rad/s) as a function of time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Profile {
    /// The same at all times.
    Constant(f64),
    /// amplitude sin(2 pi t / period + phase).
    Sinusoidal {
        /// Largest velocity.
        amplitude: f64,
        /// s.
        period: f64,
        /// rad.
        phase: f64,
    },
    /// Linear between samples, constant before the first and after the last.
    Table {
        /// Strictly ascending times, s.
        times: Vec<f64>,
        /// Velocity at each time.
        values: Vec<f64>,
    },
}

/// How a body moves: each of its six degrees of freedom (translation along and rotation about the world axes) is
/// either dynamic or follows a prescribed velocity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Which degrees of freedom are dynamic: x, y, z, then rotation about x, y, z.
    pub free: [bool; 6],
    /// Prescribed translation: velocity along each direction (any vector, not normalised), summed. Only components
    /// along degrees of freedom that are not free act.
    pub translation: Vec<(Vec3, Profile)>,
    /// Prescribed rotation about an axis fixed in space.
    pub rotation: Option<Rotation>,
}

/// Rotation with a prescribed angular velocity about an axis fixed in space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rotation {
    /// A point of the axis, m.
    pub point: Vec3,
    /// Unit direction of the axis.
    pub axis: Vec3,
    /// Angular velocity, rad/s.
    pub profile: Profile,
}
