//! Contacts of a half-space with the other shapes: every point given is a point of the shape's surface, and
//! its gap is its height.

use super::reduce::Touch;
use crate::math::{Mat3, Vec3};
use crate::shape::Shape;

/// Contacts of a shape at `position`, turned by `rotation`, both in the frame of the half-space z <= 0.
/// Normals are +z.
pub(crate) fn plane_contacts(
    shape: &Shape,
    position: Vec3,
    rotation: Mat3,
    envelope: f64,
    touches: &mut Vec<Touch>,
) {
    let down = -Vec3::new(rotation.x_axis.z, rotation.y_axis.z, rotation.z_axis.z);
    shape.form().lowest_points(down, &mut |own, radius, feature| {
        let surface = position + rotation * own - radius * Vec3::Z;
        if surface.z <= envelope {
            let point = surface - Vec3::new(0.0, 0.0, 0.5 * surface.z);
            touches.push(Touch { point, normal: Vec3::Z, gap: surface.z, feature });
        }
    });
}
