//! Contacts of boxes and cylinders with each other and with triangles, through the collision library's polyhedral
//! manifolds (separating axes and GJK, then clipping of the touching faces), and the points within the envelope that the
//! library leaves out (`corners`).

use super::corners::add_corners;
use super::reduce::Touch;
use crate::math::{Pose, Quat, Vec3};
use crate::shape::Shape;
use parry3d_f64::query::ContactManifold;
use parry3d_f64::query::details::{
    contact_manifold_cuboid_cuboid, contact_manifold_cuboid_triangle, contact_manifold_pfm_pfm,
};
use parry3d_f64::shape::{Cuboid, Cylinder, PolygonalFeatureMap, Triangle};

/// A box, a cylinder or a triangle in the library's form, scaled by 1 / `unit`: the library's tolerances are absolute
/// and made for objects of size about 1.
enum Convex {
    Box(Cuboid),
    Cylinder(Cylinder),
    Triangle(Triangle),
}

/// One of the two touching things.
#[derive(Clone, Copy)]
pub(crate) enum Solid<'a> {
    /// A box or cylinder placed in the world.
    Placed { shape: &'a Shape, position: Vec3, orientation: Quat },
    /// A triangle in world coordinates.
    Triangle([Vec3; 3]),
}

impl Solid<'_> {
    fn scaled(self, unit: f64, origin: Vec3) -> (Convex, Pose) {
        match self {
            Self::Placed { shape, position, orientation } => {
                let translation = (position - origin) / unit;
                match *shape {
                    Shape::Cylinder { half_length, radius } => {
                        // The library's cylinders stand along y.
                        let along_z = Quat::from_rotation_x(std::f64::consts::FRAC_PI_2);
                        let cylinder = Cylinder::new(half_length / unit, radius / unit);
                        (Convex::Cylinder(cylinder), Pose::from_parts(translation, orientation * along_z))
                    }
                    Shape::Box { half } => {
                        (Convex::Box(Cuboid::new(half / unit)), Pose::from_parts(translation, orientation))
                    }
                    _ => unreachable!("other shapes have their own kernels"),
                }
            }
            Self::Triangle(corners) => {
                let [a, b, c] = corners.map(|p| (p - origin) / unit);
                (Convex::Triangle(Triangle::new(a, b, c)), Pose::IDENTITY)
            }
        }
    }
}

impl Convex {
    fn feature_map(&self) -> &dyn PolygonalFeatureMap {
        match self {
            Self::Box(cuboid) => cuboid,
            Self::Cylinder(cylinder) => cylinder,
            Self::Triangle(triangle) => triangle,
        }
    }
}

/// Contacts of two solids with gap up to the envelope, in world coordinates, normals from B to A. `unit` is the size of
/// the smaller one and `origin` a point nearby.
pub(crate) fn manifold_contacts(
    a: Solid<'_>,
    b: Solid<'_>,
    unit: f64,
    origin: Vec3,
    envelope: f64,
    touches: &mut Vec<Touch>,
) {
    let ((shape_a, pose_a), (shape_b, pose_b)) = (a.scaled(unit, origin), b.scaled(unit, origin));
    let pose = pose_a.inv_mul(&pose_b);
    let prediction = envelope / unit;
    let mut manifold = ContactManifold::<(), ()>::new();
    match (&shape_a, &shape_b) {
        (Convex::Box(a), Convex::Box(b)) => {
            contact_manifold_cuboid_cuboid(&pose, a, b, prediction, &mut manifold);
        }
        (Convex::Box(a), Convex::Triangle(b)) => {
            let inverse = pose.inverse();
            contact_manifold_cuboid_triangle(
                &pose,
                &inverse,
                a,
                b,
                None,
                None,
                prediction,
                &mut manifold,
                false,
            );
        }
        _ => contact_manifold_pfm_pfm(
            &pose,
            shape_a.feature_map(),
            0.0,
            None,
            shape_b.feature_map(),
            0.0,
            None,
            prediction,
            &mut manifold,
        ),
    }
    let first = touches.len();
    // The library's normal points from A to B.
    let normal = -(pose_a.rotation * manifold.local_n1);
    for point in &manifold.points {
        let gap = unit * point.dist;
        if !(gap <= envelope && normal.is_finite()) {
            continue;
        }
        let middle = 0.5 * (pose_a * point.local_p1 + pose_b * point.local_p2);
        let feature = u64::from(point.fid1.0) << 32 | u64::from(point.fid2.0);
        touches.push(Touch { point: origin + unit * middle, normal, gap, feature });
    }
    let mut found = touches.split_off(first);
    add_corners(a, b, unit, envelope, &mut found);
    touches.append(&mut found);
}
