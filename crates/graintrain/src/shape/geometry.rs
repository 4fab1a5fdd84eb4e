//! Geometries made of one or more shapes, with volume and inertia.

use super::{Capsule, Cone, Cuboid, Cylinder, HalfSpace, Mesh, Shape, Sphere};
use crate::collide::union::counted_twice;
use crate::error::{ModelError, place};
use crate::hull::Hull;
use crate::math::{Mat3, Quat, Vec3, parallel_axis};
use crate::moments::Moments;
use crate::solid_mesh::moments;
use serde::{Deserialize, Serialize};

/// A shape placed in a body's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// The shape.
    pub shape: Shape,
    /// Origin of the shape in the body's frame, m.
    pub position: Vec3,
    /// Rotation from the shape's frame to the body's frame.
    pub orientation: Quat,
}

/// Rigid union of parts; shared by all bodies of the same form. Parts may overlap.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geometry {
    /// The parts, in a frame whose origin is the centre of mass of the body (geometries without volume: any
    /// origin). None: a body that touches nothing.
    pub parts: Vec<Part>,
    /// Volume, m^3; zero for boundaries.
    pub volume: f64,
    /// Inertia about that origin per unit density, body axes, m^5.
    pub unit_inertia: Mat3,
}

impl Part {
    /// Lower and upper corner of the box around it along the axes of the frame in which its body is placed,
    /// m; infinite for a plane.
    pub(crate) fn bounds(&self, position: Vec3, orientation: Quat) -> [Vec3; 2] {
        let centre = position + orientation * self.position;
        let inverse = (orientation * self.orientation).conjugate();
        let reach = |axis: Vec3| self.shape.form().reach(inverse * axis);
        [-1.0, 1.0].map(|sign| centre + Vec3::from_array(Vec3::AXES.map(|axis| sign * reach(sign * axis))))
    }
}

/// Sine of the angle between a normal and the axis of what is round from which on a contact is beside it.
const UPRIGHT: f64 = 0.5;

impl Geometry {
    /// A single shape whose origin is its centre of mass; a solid mesh is moved so that it is.
    ///
    /// # Errors
    /// As [`Shape::validate`].
    pub fn single(shape: Shape) -> Result<Self, ModelError> {
        shape.validate()?;
        if let Shape::Mesh(Mesh { solid: true, .. }) = shape {
            let part = Part { shape, position: Vec3::ZERO, orientation: Quat::IDENTITY };
            return Ok(Self::compound(vec![part])?.0);
        }
        let (volume, unit_inertia) = (shape.volume(), shape.unit_inertia());
        let part = Part { shape, position: Vec3::ZERO, orientation: Quat::IDENTITY };
        Ok(Self { parts: vec![part], volume, unit_inertia })
    }

    /// No form: of a body that touches nothing, whose mass has to be given.
    pub fn formless() -> Self {
        Self { parts: Vec::new(), volume: 0.0, unit_inertia: Mat3::ZERO }
    }

    /// The same form, made about its centre of mass, with its origin at this point (m) of its frame: for a
    /// body whose given centre of mass is another one. J <- J + V (|c|^2 - c c^T) is about the new origin c.
    pub fn about(self, origin: Vec3) -> Self {
        let parts = self.parts.into_iter().map(|part| Part { position: part.position - origin, ..part });
        let unit_inertia = self.unit_inertia + self.volume * parallel_axis(origin);
        Self { parts: parts.collect(), volume: self.volume, unit_inertia }
    }

    /// The same form with all lengths multiplied by a factor: volumes by its cube, inertias by its fifth
    /// power.
    ///
    /// # Errors
    /// As [`Shape::validate`], for a factor that makes lengths zero, negative or infinite.
    pub fn scaled(&self, factor: f64) -> Result<Self, ModelError> {
        let parts = self.parts.iter().map(|part| {
            let shape = part.shape.form().scaled(factor);
            shape.validate()?;
            Ok(Part { shape, position: factor * part.position, orientation: part.orientation })
        });
        Ok(Self {
            parts: parts.collect::<Result<_, ModelError>>()?,
            volume: factor.powi(3) * self.volume,
            unit_inertia: factor.powi(5) * self.unit_inertia,
        })
    }

    /// Ball of the given radius, m.
    ///
    /// # Errors
    /// [`ModelError::Value`] unless the radius is positive.
    pub fn sphere(radius: f64) -> Result<Self, ModelError> {
        Self::single(Shape::Sphere(Sphere { radius }))
    }

    /// Box of the given half edge lengths, m.
    ///
    /// # Errors
    /// [`ModelError::Value`] unless they are positive.
    pub fn cuboid(half: Vec3) -> Result<Self, ModelError> {
        Self::single(Shape::Box(Cuboid { half }))
    }

    /// Half-space below the plane z = 0 of the body's frame.
    pub fn plane() -> Self {
        let part = Part { shape: Shape::Plane(HalfSpace), position: Vec3::ZERO, orientation: Quat::IDENTITY };
        Self { parts: vec![part], volume: 0.0, unit_inertia: Mat3::ZERO }
    }

    /// Capsule about the z axis, m.
    ///
    /// # Errors
    /// [`ModelError::Value`] unless both lengths are positive.
    pub fn capsule(half_length: f64, radius: f64) -> Result<Self, ModelError> {
        Self::single(Shape::Capsule(Capsule { half_length, radius }))
    }

    /// Cylinder about the z axis, m.
    ///
    /// # Errors
    /// [`ModelError::Value`] unless both lengths are positive.
    pub fn cylinder(half_length: f64, radius: f64) -> Result<Self, ModelError> {
        Self::single(Shape::Cylinder(Cylinder { half_length, radius }))
    }

    /// Cone about the z axis with its tip upwards, or frustum, m, about its centre of mass.
    ///
    /// # Errors
    /// [`ModelError::Value`] unless the height and the radius of the base are positive, and that of the top
    /// is not negative.
    pub fn cone(height: f64, radius: f64, top_radius: f64) -> Result<Self, ModelError> {
        Self::single(Shape::Cone(Cone { height, radius, top_radius }))
    }

    /// Convex hull of points, m. Returns the geometry, whose origin is the centre of mass, and that centre in
    /// the frame of the points.
    ///
    /// # Errors
    /// As [`Hull::new`].
    pub fn hull(points: &[Vec3]) -> Result<(Self, Vec3), ModelError> {
        let (hull, centre) = Hull::new(points)?;
        Ok((Self::single(Shape::Hull(hull))?, centre))
    }

    /// Surface of triangles, m.
    ///
    /// # Errors
    /// [`ModelError`] for an empty mesh, a vertex index out of range, or a triangle without area.
    pub fn mesh(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<Self, ModelError> {
        Self::single(Shape::Mesh(Mesh { vertices, triangles, solid: false }))
    }

    /// Solid bounded by triangles (counter-clockwise seen from outside), m, with volume, centre and inertia
    /// by exact integration. Returns the geometry, whose origin is the centre of mass, and that centre in the
    /// frame of the vertices. Several closed shells add up: what lies in two of them counts twice, and a
    /// shell turned inside out is subtracted.
    ///
    /// # Errors
    /// As [`Geometry::mesh`]; [`ModelError::MeshOpen`], [`ModelError::MeshTurned`] or
    /// [`ModelError::MeshInsideOut`] for a surface that does not bound a solid.
    pub fn solid_mesh(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<(Self, Vec3), ModelError> {
        let shape = Shape::Mesh(Mesh { vertices, triangles, solid: true });
        Self::compound(vec![Part { shape, position: Vec3::ZERO, orientation: Quat::IDENTITY }])
    }

    /// A solid mesh, placed, with its moments about a point `middle` of its frame.
    fn solid(part: Part, boundaries: Vec<Part>, moments: &Moments, middle: Vec3) -> (Self, Vec3) {
        let Moments { volume, first, .. } = *moments;
        let (rotation, from_middle) = (Mat3::from_quat(part.orientation), first / volume);
        let centre = part.position + part.orientation * (middle + from_middle);
        let unit_inertia = rotation * moments.inertia(from_middle) * rotation.transpose();
        let parts = std::iter::once(part).chain(boundaries);
        let parts = parts.map(|part| Part { position: part.position - centre, ..part }).collect();
        (Self { parts, volume, unit_inertia }, centre)
    }

    /// Rigid union of parts given in any frame. Returns the geometry, whose origin is the centre of mass, and
    /// that centre in the frame of the parts (zero where nothing has volume). Parallel axes: with part i of
    /// volume V_i, rotation R_i and diagonal inertia J_i at distance d_i from the centre,
    /// `J = sum_i R_i J_i R_i^T + V_i (|d_i|^2 - d_i d_i^T)`.
    ///
    /// Parts that overlap (by more than 1e-9 of the smaller one) count once: what the sums count more often
    /// is taken off, in closed form for two spheres, otherwise by cells and samples with an error of the
    /// common volume and of its moments below 1e-3 (`collide::union`).
    ///
    /// # Errors
    /// [`ModelError`] for an empty list, a defect of a part, a quaternion that is not normalised, or a solid
    /// mesh beside other parts with a mass.
    pub fn compound(parts: Vec<Part>) -> Result<(Self, Vec3), ModelError> {
        if parts.is_empty() {
            return Err(ModelError::Empty { what: "the list of parts of a compound" });
        }
        for part in &parts {
            part.shape.validate()?;
            place("a coordinate of a part's position", &part.position.to_array())?;
            unit_quaternion("the orientation of a part", part.orientation)?;
        }
        if let Some(index) =
            parts.iter().position(|part| matches!(part.shape, Shape::Mesh(Mesh { solid: true, .. })))
        {
            let mut boundaries = parts;
            let part = boundaries.remove(index);
            let Shape::Mesh(Mesh { vertices, triangles, .. }) = &part.shape else {
                return Err(ModelError::MeshJoined);
            };
            let (moments, middle) = moments(vertices, triangles);
            if boundaries.iter().any(|part| part.shape.volume() > 0.0) {
                return Err(ModelError::MeshJoined);
            }
            return Ok(Self::solid(part, boundaries, &moments, middle));
        }
        let mut volume: f64 = parts.iter().map(|part| part.shape.volume()).sum();
        let mut moment: Vec3 = parts.iter().map(|part| part.shape.volume() * part.position).sum();
        let excess = counted_twice(&parts);
        if let Some(excess) = &excess {
            volume -= excess.volume;
            moment -= excess.first;
        }
        let centre = if volume > 0.0 { moment / volume } else { Vec3::ZERO };
        let mut unit_inertia = Mat3::ZERO;
        let parts: Vec<Part> =
            parts.into_iter().map(|part| Part { position: part.position - centre, ..part }).collect();
        for part in &parts {
            let rotation = Mat3::from_quat(part.orientation);
            let own = rotation * part.shape.unit_inertia() * rotation.transpose();
            unit_inertia += own + part.shape.volume() * parallel_axis(part.position);
        }
        if let Some(excess) = &excess {
            unit_inertia -= excess.inertia(centre);
        }
        Ok((Self { parts, volume, unit_inertia }, centre))
    }

    /// The axis through the body's origin about which it is round, unit; of bodies of one part.
    pub(crate) fn axis_of_revolution(&self) -> Option<Vec3> {
        match self.parts.as_slice() {
            [part] if part.position == Vec3::ZERO && part.shape.form().is_of_revolution() => {
                Some(part.orientation * Vec3::Z)
            }
            _ => None,
        }
    }

    /// The arm of a contact that bodies have later in a step, for the start of it where they have this
    /// orientation. The normal of what is round leads through its axis, n . (a x r) = 0: where the body turns
    /// till then, the arm of then does not have that, and spin about the axis a would seem to part the
    /// bodies.
    pub(crate) fn arm_before(&self, orientation: Quat, arm: Vec3, normal: Vec3) -> Vec3 {
        let Some(axis) = self.axis_of_revolution() else { return arm };
        let axis = orientation * axis;
        let (out, radial) = (normal.reject_from_normalized(axis), arm.reject_from_normalized(axis));
        if out.length() <= UPRIGHT {
            return arm;
        }
        arm - radial + radial.dot(out).signum() * radial.length() * out.normalize()
    }

    /// Radius, m, of a geometry that is one ball about the body's origin.
    pub(crate) fn ball(&self) -> Option<f64> {
        match self.parts.as_slice() {
            [Part { shape: Shape::Sphere(ball), position: Vec3::ZERO, .. }] => Some(ball.radius),
            _ => None,
        }
    }

    /// Radius of a ball about the body's origin that holds the geometry, m; infinite if a part is a plane.
    pub fn bounding_radius(&self) -> f64 {
        self.parts
            .iter()
            .map(|part| match &part.shape {
                Shape::Mesh(Mesh { vertices, .. }) => vertices
                    .iter()
                    .map(|&v| (part.position + part.orientation * v).length())
                    .fold(0.0, f64::max),
                shape => part.position.length() + shape.bounding_radius(),
            })
            .fold(0.0, f64::max)
    }
}

/// `Err` unless the quaternion has length 1 to 1e-9.
pub(crate) fn unit_quaternion(what: &str, q: Quat) -> Result<(), ModelError> {
    let length = q.length();
    if (length - 1.0).abs() <= 1e-9 {
        return Ok(());
    }
    Err(ModelError::Value { what: format!("the length of {what}"), value: length, expected: "1" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Volume and second moments by summing cells over a grid: independent of the closed forms.
    fn quadrature(inside: impl Fn(Vec3) -> bool, half: Vec3, cells: usize) -> (f64, Vec3) {
        let size = 2.0 * half / cells as f64;
        let cell = size.x * size.y * size.z;
        let (mut volume, mut inertia) = (0.0, Vec3::ZERO);
        for i in 0..cells {
            for j in 0..cells {
                for k in 0..cells {
                    let p = -half + size * (Vec3::new(i as f64, j as f64, k as f64) + 0.5);
                    if inside(p) {
                        let s = p * p;
                        volume += cell;
                        inertia += cell * Vec3::new(s.y + s.z, s.z + s.x, s.x + s.y);
                    }
                }
            }
        }
        (volume, inertia)
    }

    #[test]
    fn volume_and_inertia_agree_with_quadrature() {
        let (half_length, radius) = (0.7, 0.4);
        let half = Vec3::new(0.3, 0.5, 0.7);
        let in_cylinder = |p: Vec3| p.x.hypot(p.y) <= radius && p.z.abs() <= half_length;
        let in_capsule = |p: Vec3| {
            let beyond = (p.z.abs() - half_length).max(0.0);
            p.x * p.x + p.y * p.y + beyond * beyond <= radius * radius
        };
        let grid = 120;
        let cases = [
            (
                Shape::Sphere(Sphere { radius }),
                quadrature(|p| p.length() <= radius, Vec3::splat(radius), grid),
            ),
            (Shape::Box(Cuboid { half }), quadrature(|_| true, half, grid)),
            (
                Shape::Cylinder(Cylinder { half_length, radius }),
                quadrature(in_cylinder, Vec3::new(radius, radius, half_length), grid),
            ),
            (
                Shape::Capsule(Capsule { half_length, radius }),
                quadrature(in_capsule, Vec3::new(radius, radius, half_length + radius), grid),
            ),
        ];
        // Its ends, at -0.44 and 0.68, lie between cells.
        let in_cone = |p: Vec3| {
            let up = p.z + 0.44;
            (0.0..=1.12).contains(&up) && p.x.hypot(p.y) <= 0.5 - 0.25 * up / 1.12
        };
        let cone = Shape::Cone(Cone { height: 1.12, radius: 0.5, top_radius: 0.25 });
        let cases = cases.into_iter().chain([(cone, quadrature(in_cone, Vec3::new(0.5, 0.5, 1.12), 224))]);
        for (shape, (volume, inertia)) in cases {
            assert!((shape.volume() / volume - 1.0).abs() < 2e-3, "{shape:?}");
            let own = shape.unit_inertia();
            let ratio = Vec3::new(own.x_axis.x, own.y_axis.y, own.z_axis.z) / inertia;
            assert!((ratio - Vec3::ONE).abs().max_element() < 3e-3, "{shape:?} {ratio}");
        }
    }

    #[test]
    fn a_box_cut_in_two_boxes_has_the_mass_properties_of_the_whole() {
        let whole = Geometry::cuboid(Vec3::new(1.0, 2.0, 3.0)).unwrap();
        let turn = Quat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let part = |x: f64, orientation: Quat, half: Vec3| Part {
            shape: Shape::Box(Cuboid { half }),
            position: Vec3::new(5.0 + x, -1.0, 2.0),
            orientation,
        };
        let (cut, centre) = Geometry::compound(vec![
            part(-0.6, Quat::IDENTITY, Vec3::new(0.4, 2.0, 3.0)),
            part(0.4, turn, Vec3::new(2.0, 0.6, 3.0)),
        ])
        .unwrap();
        assert!((centre - Vec3::new(5.0, -1.0, 2.0)).length() < 1e-14);
        assert!((cut.volume - whole.volume).abs() < 1e-12);
        let difference = cut.unit_inertia - whole.unit_inertia;
        assert!(difference.to_cols_array().iter().all(|d| d.abs() < 1e-11));
    }

    fn at(shape: Shape, position: Vec3, orientation: Quat) -> Part {
        Part { shape, position, orientation }
    }

    /// Largest difference of two inertias, as a fraction of the second's largest entry.
    fn inertia_error(a: Mat3, b: Mat3) -> f64 {
        let largest = |m: Mat3| m.to_cols_array().iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        largest(a - b) / largest(b)
    }

    #[test]
    fn two_spheres_that_overlap_by_a_radius_count_their_lens_once() {
        let ball = Shape::Sphere(Sphere { radius: 1.0 });
        let place = Vec3::new(3.0, -1.0, 2.0);
        let way = Vec3::new(1.0, 2.0, 2.0) / 3.0;
        let parts = vec![at(ball.clone(), place, Quat::IDENTITY), at(ball, place + way, Quat::IDENTITY)];
        let (pair, centre) = Geometry::compound(parts).unwrap();
        // The lens of two unit balls with centres d = 1 apart: pi (4 + d) (2 - d)^2 / 12 = 5 pi / 12.
        let expected = 8.0 / 3.0 * PI - 5.0 / 12.0 * PI;
        assert!((pair.volume - expected).abs() < 1e-13);
        assert!((centre - place - 0.5 * way).length() < 1e-14);
        // Along the axis of a union of discs: the inertia by a fine sum over them.
        let (cells, size) = (100_000, 3.0 / 100_000.0);
        let (mut along, mut across) = (0.0, 0.0);
        for k in 0..cells {
            let z: f64 = -1.5 + size * (f64::from(k) + 0.5);
            let square = 1.0 - (z.abs() - 0.5).powi(2);
            along += size * 0.5 * PI * square * square;
            across += size * PI * (0.25 * square * square + square * z * z);
        }
        let outer = Mat3::from_cols(way * way.x, way * way.y, way * way.z);
        let expected = Mat3::from_diagonal(Vec3::splat(across)) + (along - across) * outer;
        assert!(inertia_error(pair.unit_inertia, expected) < 1e-8);
    }

    #[test]
    fn overlapping_boxes_and_parts_inside_others_have_the_mass_of_the_whole() {
        let whole = Geometry::cuboid(Vec3::new(1.0, 0.5, 0.4)).unwrap();
        let half = |x: f64| Shape::Box(Cuboid { half: Vec3::new(x, 0.5, 0.4) });
        let turns = [Quat::IDENTITY, Quat::from_axis_angle(Vec3::new(1.0, -2.0, 0.5).normalize(), 0.7)];
        for turn in turns {
            let place = |x: f64| Vec3::new(4.0, -2.0, 1.0) + turn * Vec3::new(x, 0.0, 0.0);
            let rotation = Mat3::from_quat(turn);
            let expected = rotation * whole.unit_inertia * rotation.transpose();
            let cases = [
                // [-1, 0.3] and [-0.2, 1].
                vec![at(half(0.65), place(-0.35), turn), at(half(0.6), place(0.4), turn)],
                // Three at once: [-1, 0.3], [-0.2, 1], [-0.5, 0.5].
                vec![
                    at(half(0.65), place(-0.35), turn),
                    at(half(0.6), place(0.4), turn),
                    at(half(0.5), place(0.0), turn),
                ],
                vec![
                    at(half(1.0), place(0.0), turn),
                    at(Shape::Sphere(Sphere { radius: 0.3 }), place(0.5), turn),
                ],
                vec![
                    at(half(1.0), place(0.0), turn),
                    at(Shape::Cylinder(Cylinder { half_length: 0.2, radius: 0.3 }), place(-0.2), turn),
                ],
                vec![
                    at(half(1.0), place(0.0), turn),
                    at(Shape::Capsule(Capsule { half_length: 0.1, radius: 0.2 }), place(0.3), turn),
                ],
            ];
            for parts in cases {
                let (union, centre) = Geometry::compound(parts.clone()).unwrap();
                println!(
                    "volume {:.1e}, centre {:.1e}, inertia {:.1e}",
                    union.volume / whole.volume - 1.0,
                    (centre - place(0.0)).length(),
                    inertia_error(union.unit_inertia, expected)
                );
                assert!((union.volume / whole.volume - 1.0).abs() < 1e-3, "{parts:?}");
                assert!((centre - place(0.0)).length() < 1e-3, "{parts:?}");
                assert!(inertia_error(union.unit_inertia, expected) < 1e-3, "{parts:?}");
            }
        }
    }

    #[test]
    fn parts_that_only_touch_keep_their_sums_bit_for_bit() {
        let block = Shape::Box(Cuboid { half: Vec3::new(0.5, 0.4, 0.3) });
        let rod = Shape::Cylinder(Cylinder { half_length: 0.2, radius: 0.1 });
        for gap in [0.0, -1e-11, 1e-11] {
            let parts = vec![
                at(block.clone(), Vec3::ZERO, Quat::IDENTITY),
                at(block.clone(), Vec3::new(1.0 + gap, 0.0, 0.0), Quat::IDENTITY),
                at(Shape::Sphere(Sphere { radius: 0.2 }), Vec3::new(0.0, 0.0, 0.5 + gap), Quat::IDENTITY),
                at(rod.clone(), Vec3::new(0.9, 0.0, -0.5 - gap), Quat::IDENTITY),
            ];
            let sum: f64 = parts.iter().map(|part| part.shape.volume()).sum();
            assert_eq!(Geometry::compound(parts).unwrap().0.volume, sum);
        }
    }

    #[test]
    fn bad_sizes_and_meshes_are_refused() {
        assert!(Geometry::sphere(-1.0).is_err());
        assert!(Geometry::sphere(f64::NAN).is_err());
        assert!(Geometry::cuboid(Vec3::new(1.0, 0.0, 1.0)).is_err());
        assert!(Geometry::cylinder(1.0, f64::INFINITY).is_err());
        assert!(Geometry::mesh(vec![Vec3::ZERO], vec![]).is_err());
        let corners = vec![Vec3::ZERO, Vec3::X, 2.0 * Vec3::X];
        assert_eq!(
            Geometry::mesh(corners.clone(), vec![[0, 1, 2]]),
            Err(ModelError::MeshArea { triangle: 0 })
        );
        assert!(matches!(Geometry::mesh(corners, vec![[0, 1, 3]]), Err(ModelError::MeshVertex { .. })));
        assert!(Geometry::compound(vec![]).is_err());
    }
}
