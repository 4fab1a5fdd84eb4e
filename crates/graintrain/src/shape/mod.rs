//! Shapes, one file each, and geometries made of one or more of them.
//!
//! A shape is what its `Form` says: its mass, its extent, its distance from a point, its corners, its
//! surface. All else (contacts, bounds, pictures, scene files) is made from that. A new shape is a file with
//! a `Form` and a line of `shapes!`.

mod capsule;
mod cone;
mod cuboid;
mod cylinder;
pub(crate) mod frustum;
mod geometry;
mod half_space;
mod lengths;
pub(crate) mod library;
mod mesh;
pub(crate) mod polyhedron;
mod sphere;
mod surface;

use crate::error::ModelError;
use crate::hull::Hull;
use crate::math::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

pub use capsule::Capsule;
pub use cone::Cone;
pub use cuboid::Cuboid;
pub use cylinder::Cylinder;
pub(crate) use geometry::unit_quaternion;
pub use geometry::{Geometry, Part};
pub use half_space::HalfSpace;
pub use lengths::{Length, Lengths};
pub use mesh::Mesh;
pub use sphere::Sphere;
pub use surface::Surface;

/// What a shape is, in its own frame: lengths in m, directions unit vectors unless told otherwise.
pub(crate) trait Form {
    /// Checks its sizes.
    fn validate(&self) -> Result<(), ModelError>;

    /// The same with all lengths multiplied by a factor.
    fn scaled(&self, factor: f64) -> Shape;

    /// Volume, m^3; zero for boundaries.
    fn volume(&self) -> f64;

    /// Inertia about the origin per unit density, m^5; zero for boundaries.
    fn unit_inertia(&self) -> Mat3;

    /// [`Shape::half_thickness`].
    fn half_thickness(&self) -> f64;

    /// [`Shape::inscribed_radius`].
    fn inscribed_radius(&self) -> f64 {
        self.half_thickness()
    }

    /// [`Shape::inscribed_half_axes`].
    fn inscribed_half_axes(&self) -> Option<Vec3> {
        Some(Vec3::splat(self.inscribed_radius()))
    }

    /// [`Shape::bounding_radius`].
    fn bounding_radius(&self) -> f64;

    /// The support function: the largest d . p over its points p, for a direction d of any length.
    fn reach(&self, direction: Vec3) -> f64;

    /// [`Shape::surface`].
    fn surface(&self) -> Option<Surface>;

    /// Signed distance from a point, a convex function of it. Not asked of meshes, which are treated triangle
    /// by triangle.
    fn signed_distance(&self, c: Vec3) -> Distance;

    /// Where the line `centre + t * half_axis` crosses the borders of the space over a face: the t, in an
    /// order of its own; infinite where there is no crossing.
    fn crossings(&self, _centre: Vec3, _half_axis: Vec3) -> Vec<f64> {
        Vec::new()
    }

    /// What holds it off a plane, to which `down` leads: points, each with the radius of the ball about it
    /// that touches (zero where it is a point of the surface) and its feature.
    fn lowest_points(&self, _down: Vec3, _each: &mut dyn FnMut(Vec3, f64, u64)) {}

    /// Of what is round, the corners and edges that hold it off other solids. `toward` leads to the other
    /// one.
    fn corners(&self, _toward: Vec3) -> Corners {
        Corners::default()
    }

    /// How far the nearest point of the surface to `p` lies inside a face, m; negative on edges and corners.
    fn inside_face(&self, _p: Vec3) -> f64 {
        0.0
    }

    /// Height of `p` over the flat face whose normal is `outward`, m, if it lies over it (or beside it by up
    /// to `beside`); `None` where there is no such face.
    fn height_over_face(&self, _p: Vec3, _outward: Vec3, _beside: f64) -> Option<f64> {
        None
    }

    /// In the form of the collision library, with lengths in units of `unit`: `None` for shapes that the
    /// library is not asked about.
    fn in_library(&self, _unit: f64) -> Option<library::Convex<'_>> {
        None
    }

    /// Whether it is round about the z axis.
    fn is_of_revolution(&self) -> bool {
        false
    }

    /// Of what is round about the z axis: half the length of that axis, m, zero for a ball.
    fn half_axis(&self) -> Option<f64> {
        None
    }

    /// Where the round that has this point of the surface comes nearest to a plane with this normal; `None`
    /// for what is not round there.
    fn foremost_around(&self, _point: Vec3, _normal: Vec3) -> Option<Vec3> {
        None
    }
}

/// The t at which a coordinate `start + t * rate` is that of a border; infinite where it never is.
fn at_plane(border: f64, start: f64, rate: f64) -> f64 {
    let t = (border - start) / rate;
    if t.is_finite() { t } else { f64::INFINITY }
}

/// Signed distance from a point to a surface and the direction in which it grows fastest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Distance {
    /// Positive outside, m.
    pub value: f64,
    /// Unit gradient: the outward normal of the surface at the nearest point.
    pub normal: Vec3,
}

impl Distance {
    /// To the ball of this radius about `centre`; at the centre itself the normal is +x.
    fn to_ball(c: Vec3, centre: Vec3, radius: f64) -> Self {
        let d = c - centre;
        let length = d.length();
        let normal = if length > 0.0 { d / length } else { Vec3::X };
        Self { value: length - radius, normal }
    }
}

/// Corners and edges of a solid; of what is round, points of its rims with the chords between them and the
/// line of its mantle that looks at the other solid.
#[derive(Default)]
pub(crate) struct Corners {
    pub points: Vec<Vec3>,
    /// Numbers of both ends.
    pub edges: Vec<[usize; 2]>,
}

macro_rules! shapes {
    ($($(#[$doc:meta])* $name:ident($form:ty) = $code:literal, $text:literal $(, $lengths:expr)?;)+) => {
        /// A solid or boundary shape in its own frame, lengths in m.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        pub enum Shape {
            $($(#[$doc])* $name($form),)+
        }

        impl Shape {
            /// Shapes that lengths alone describe.
            pub const BY_LENGTHS: &[&Lengths] = &[$($(&$lengths,)?)+];

            pub(crate) fn form(&self) -> &dyn Form {
                match self {
                    $(Self::$name(form) => form,)+
                }
            }

            /// What scenes and messages call it.
            pub fn name(&self) -> &'static str {
                match self {
                    $(Self::$name(_) => $text,)+
                }
            }

            /// Its number in frames; 6 stands for bodies of several shapes.
            pub fn code(&self) -> i32 {
                match self {
                    $(Self::$name(_) => $code,)+
                }
            }
        }
    };
}

// Checkpoints count the variants: new ones come last.
shapes! {
    /// Ball about the origin.
    Sphere(Sphere) = 0, "sphere", sphere::LENGTHS;
    /// Box with edges along the axes.
    Box(Cuboid) = 1, "box";
    /// Half-space below a plane. A boundary: it has no mass.
    Plane(HalfSpace) = 4, "plane";
    /// Points near a segment.
    Capsule(Capsule) = 2, "capsule", capsule::LENGTHS;
    /// Circular cylinder about the z axis with flat ends.
    Cylinder(Cylinder) = 3, "cylinder", cylinder::LENGTHS;
    /// Convex polyhedron about its centre of volume.
    Hull(Hull) = 7, "hull";
    /// Surface of triangles, or the solid that it encloses.
    Mesh(Mesh) = 5, "mesh";
    /// Circular cone or frustum about the z axis.
    Cone(Cone) = 8, "cone", cone::LENGTHS;
}

impl Shape {
    /// Volume, m^3; zero for boundaries.
    pub fn volume(&self) -> f64 {
        self.form().volume()
    }

    /// Half the smallest extent, m: the radius of balls, half the thickness of boxes; of hulls across their
    /// faces; of cones the radius of the ball about their centre of mass; of solid meshes along the axes of
    /// their file, so that a thin plate that lies askew there counts as thick; infinite for planes and
    /// surfaces.
    pub fn half_thickness(&self) -> f64 {
        self.form().half_thickness()
    }

    /// Radius of a ball inside it, m; of solid meshes half their smallest extent; 0 for surfaces and
    /// half-spaces.
    pub fn inscribed_radius(&self) -> f64 {
        self.form().inscribed_radius()
    }

    /// Half axes, m, along its own axes, of an ellipsoid that hides in it; `None` for boundaries.
    pub fn inscribed_half_axes(&self) -> Option<Vec3> {
        self.form().inscribed_half_axes()
    }

    /// Inertia about the shape's origin per unit density, the shape's axes, m^5. Zero for boundaries.
    pub fn unit_inertia(&self) -> Mat3 {
        self.form().unit_inertia()
    }

    /// Radius of a ball about the shape's origin that holds the shape, m; infinite for a plane.
    pub fn bounding_radius(&self) -> f64 {
        self.form().bounding_radius()
    }

    /// Lower and upper corner of the box along its own axes around it, m; infinite for a plane.
    pub fn bounds(&self) -> [Vec3; 2] {
        let reach =
            |sign: f64| Vec3::from_array(Vec3::AXES.map(|axis| sign * self.form().reach(sign * axis)));
        [reach(-1.0), reach(1.0)]
    }

    /// Its surface as triangles, to be drawn; `None` for balls (drawn as points) and planes (unbounded).
    pub fn surface(&self) -> Option<Surface> {
        self.form().surface()
    }

    /// Checks sizes and, for a mesh, the vertex indices; for a solid one that it closes and is not inside
    /// out.
    ///
    /// # Errors
    /// [`ModelError`] for the first defect.
    pub fn validate(&self) -> Result<(), ModelError> {
        self.form().validate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::collide::triangle::nearest_on_triangle;
    use proptest::prelude::*;

    fn stone() -> Vec<Vec3> {
        let point = |k: u32| {
            let (a, b) = (1.7 * f64::from(k), 2.9 * f64::from(k));
            Vec3::new(0.8 * a.sin(), 0.6 * b.cos(), 0.5 * (a + b).sin())
        };
        (0..14).map(point).collect()
    }

    fn shapes() -> Vec<Shape> {
        vec![
            Shape::Sphere(Sphere { radius: 0.7 }),
            Shape::Box(Cuboid { half: Vec3::new(0.3, 0.9, 0.5) }),
            Shape::Plane(HalfSpace),
            Shape::Capsule(Capsule { half_length: 0.8, radius: 0.3 }),
            Shape::Cylinder(Cylinder { half_length: 0.6, radius: 0.5 }),
            Shape::Cone(Cone { height: 1.1, radius: 0.8, top_radius: 0.0 }),
            Shape::Cone(Cone { height: 0.9, radius: 0.3, top_radius: 0.7 }),
            Shape::Hull(Hull::new(&stone()).unwrap().0),
        ]
    }

    proptest! {
        /// The gradient is a unit vector, agrees with finite differences, and leads back to the surface.
        #[test]
        fn gradient_agrees_with_finite_differences(p in prop::array::uniform3(-1.5..1.5_f64), which in 0..8_usize) {
            let (shape, p) = (&shapes()[which], Vec3::from_array(p));
            let distance = shape.form().signed_distance(p);
            prop_assert!((distance.normal.length() - 1.0).abs() < 1e-14);
            let h = 1e-6;
            let slope = Vec3::from_array([Vec3::X, Vec3::Y, Vec3::Z].map(|e| {
                (shape.form().signed_distance(p + h * e).value - shape.form().signed_distance(p - h * e).value) / (2.0 * h)
            }));
            // On the medial axis inside the shape the distance has a kink.
            let kink = (slope - distance.normal).length() > 1e-3 && distance.value < 0.0;
            prop_assume!(!kink);
            prop_assert!((slope - distance.normal).length() < 1e-5, "{:?} {slope}", distance);
            let foot = p - distance.value * distance.normal;
            prop_assert!(shape.form().signed_distance(foot).value.abs() < 1e-12);
        }

        /// Outside of a hull the distance is that to the nearest of the triangles of its surface.
        #[test]
        fn the_distance_to_a_hull_is_that_to_its_surface(p in prop::array::uniform3(-2.0..2.0_f64)) {
            let (hull, p) = (Hull::new(&stone()).unwrap().0, Vec3::from_array(p));
            let corners = |triangle: &[u32; 3]| triangle.map(|k| hull.corners()[k as usize]);
            let feet = hull.triangles().iter().map(|t| nearest_on_triangle(p, corners(t)).0).collect::<Vec<_>>();
            let least = feet.iter().map(|foot| (p - foot).length()).fold(f64::INFINITY, f64::min);
            let distance = hull.signed_distance(p);
            prop_assert!((distance.value.abs() - least).abs() < 1e-12 || distance.value < 0.0);
        }
    }
}
