//! Vectors, quaternions and 3x3 matrices in f64, from one place (they come with the collision library).

pub use parry3d_f64::glamx::{DMat3 as Mat3, DQuat as Quat, DVec3 as Vec3};
pub use parry3d_f64::math::Pose;
