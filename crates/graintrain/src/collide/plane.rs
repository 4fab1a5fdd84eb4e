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
    let mut touch = |surface: Vec3, feature: u64| {
        if surface.z <= envelope {
            let point = surface - Vec3::new(0.0, 0.0, 0.5 * surface.z);
            touches.push(Touch { point, normal: Vec3::Z, gap: surface.z, feature });
        }
    };
    match *shape {
        Shape::Sphere { radius } => touch(position - radius * Vec3::Z, 0),
        Shape::Capsule { half_length, radius } => {
            for (end, feature) in [(-half_length, 0), (half_length, 1)] {
                touch(position + end * rotation.z_axis - radius * Vec3::Z, feature);
            }
        }
        Shape::Box { half } => {
            // The four corners of the face that looks down most.
            let down = Vec3::new(rotation.x_axis.z, rotation.y_axis.z, rotation.z_axis.z);
            let axis = largest_axis(down.abs());
            let sign = -1.0_f64.copysign(down[axis]);
            for corner in 0..4 {
                let mut p = half;
                p[axis] *= sign;
                for (bit, other) in [(axis + 1) % 3, (axis + 2) % 3].into_iter().enumerate() {
                    if corner >> bit & 1 == 1 {
                        p[other] = -p[other];
                    }
                }
                let feature = (0..3).map(|k| u64::from(p[k] < 0.0) << k).sum();
                touch(position + rotation * p, feature);
            }
        }
        Shape::Cylinder { half_length, radius } => {
            // Steepest way down within an end face; where the face is level any direction of the cylinder's
            // own.
            let axis = rotation.z_axis;
            let steepest = axis.z * axis - Vec3::Z;
            let down = if steepest.length() > 1e-9 { steepest.normalize() } else { rotation.x_axis };
            let level = axis.cross(down);
            let low_end = if axis.z > 0.0 { -1.0 } else { 1.0 };
            let centre = |end: f64| position + end * half_length * axis;
            for (feature, direction) in [(0, down), (1, level), (2, -down), (3, -level)] {
                touch(centre(low_end) + radius * direction, feature);
            }
            touch(centre(-low_end) + radius * down, 4);
        }
        // Every corner: those that are not needed are taken out later.
        Shape::Hull(ref hull) => {
            for (feature, corner) in (0..).zip(hull.corners()) {
                touch(position + rotation * *corner, feature);
            }
        }
        Shape::Mesh { ref vertices, .. } => {
            for (feature, vertex) in (0..).zip(vertices) {
                touch(position + rotation * *vertex, feature);
            }
        }
        // Two half-spaces never meet.
        Shape::Plane => {}
    }
}

fn largest_axis(v: Vec3) -> usize {
    if v.x >= v.y && v.x >= v.z {
        0
    } else if v.y >= v.z {
        1
    } else {
        2
    }
}
