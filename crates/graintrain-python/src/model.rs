//! What worlds are made of in code: shapes, functions of time, motions.

use crate::arrays::{quaternion, shaped, vector, vectors};
use crate::error::OrRaise;
use graintrain::math::{Quat, Vec3};
use graintrain::motion;
use graintrain::shape::{Geometry, Part};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// The form of bodies, made once and shared by as many as there are. Lengths in m.
#[pyclass(frozen, module = "graintrain")]
pub struct Shape {
    pub(crate) geometry: Geometry,
    /// The centre of mass in the frame of what the shape was made of.
    center: Vec3,
    /// Tells shapes apart.
    pub(crate) number: u64,
}

static NUMBER: AtomicU64 = AtomicU64::new(0);

impl Shape {
    fn new(geometry: Geometry, center: Vec3) -> Self {
        Self { geometry, center, number: NUMBER.fetch_add(1, Ordering::Relaxed) }
    }
}

fn triangle_list(object: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 3]>> {
    let numbers = shaped("triangles", object, &[None, Some(3)])?;
    let corner = |x: f64| {
        let whole = x as u32;
        if f64::from(whole) == x {
            return Ok(whole);
        }
        Err(PyValueError::new_err(format!("triangles has the entry {x}, expected indices of vertices")))
    };
    numbers.chunks_exact(3).map(|t| Ok([corner(t[0])?, corner(t[1])?, corner(t[2])?])).collect()
}

#[pymethods]
impl Shape {
    /// Ball.
    #[staticmethod]
    pub fn sphere(radius: f64) -> PyResult<Self> {
        Ok(Self::new(Geometry::sphere(radius).or_raise()?, Vec3::ZERO))
    }

    /// Box with these half edges, along the body's axes.
    #[staticmethod]
    fn r#box(half: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self::new(Geometry::cuboid(vector("half", half)?).or_raise()?, Vec3::ZERO))
    }

    /// Half-space below z = 0 of the body's frame: a boundary without mass.
    #[staticmethod]
    pub fn plane() -> Self {
        Self::new(Geometry::plane(), Vec3::ZERO)
    }

    /// Points within `radius` of the segment from -half_length to half_length on the z axis.
    #[staticmethod]
    fn capsule(half_length: f64, radius: f64) -> PyResult<Self> {
        Ok(Self::new(Geometry::capsule(half_length, radius).or_raise()?, Vec3::ZERO))
    }

    /// Cylinder about the z axis with flat ends at -half_length and half_length.
    #[staticmethod]
    fn cylinder(half_length: f64, radius: f64) -> PyResult<Self> {
        Ok(Self::new(Geometry::cylinder(half_length, radius).or_raise()?, Vec3::ZERO))
    }

    /// Cone about the z axis with its tip upwards, or frustum with a top of its own radius; its origin is the
    /// centre of mass.
    #[staticmethod]
    #[pyo3(signature = (height, radius, top_radius=0.0))]
    fn cone(height: f64, radius: f64, top_radius: f64) -> PyResult<Self> {
        Ok(Self::new(Geometry::cone(height, radius, top_radius).or_raise()?, Vec3::ZERO))
    }

    /// Surface of triangles: vertices (n, 3), triangles (m, 3) of indices, counter-clockwise seen from
    /// outside. Without mass unless it is solid, which asks for a closed surface.
    #[staticmethod]
    #[pyo3(signature = (vertices, triangles, solid=false))]
    fn mesh(vertices: &Bound<'_, PyAny>, triangles: &Bound<'_, PyAny>, solid: bool) -> PyResult<Self> {
        let (vertices, triangles) = (vectors("vertices", vertices)?, triangle_list(triangles)?);
        if solid {
            let (geometry, center) = Geometry::solid_mesh(vertices, triangles).or_raise()?;
            return Ok(Self::new(geometry, center));
        }
        Ok(Self::new(Geometry::mesh(vertices, triangles).or_raise()?, Vec3::ZERO))
    }

    /// Convex hull of points (n, 3). Bodies are placed by the centre of mass: see `center`.
    #[staticmethod]
    fn hull(points: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (geometry, center) = Geometry::hull(&vectors("points", points)?).or_raise()?;
        Ok(Self::new(geometry, center))
    }

    /// Rigid union of parts, each (shape, position) or (shape, position, quaternion). What overlaps counts
    /// once. Bodies are placed by the centre of mass: see `center`.
    #[staticmethod]
    fn compound(parts: Vec<Bound<'_, PyAny>>) -> PyResult<Self> {
        let mut all = Vec::new();
        for (k, part) in parts.iter().enumerate() {
            let wrong = || {
                PyTypeError::new_err(format!(
                    "parts[{k}]: expected (shape, position) or (shape, position, quaternion)"
                ))
            };
            let items: Vec<Bound<'_, PyAny>> = part.extract().map_err(|_| wrong())?;
            let (of, place, turn) = match items.as_slice() {
                [of, place] => (of, place, Quat::IDENTITY),
                [of, place, turn] => (of, place, quaternion(&format!("the quaternion of parts[{k}]"), turn)?),
                _ => return Err(wrong()),
            };
            let of = of.cast::<Self>().map_err(|_| wrong())?.get();
            let place = vector(&format!("the position of parts[{k}]"), place)?;
            // The parts of a part stand relative to its centre of mass; its own frame is what is placed.
            all.extend(of.geometry.parts.iter().map(|inner| Part {
                shape: inner.shape.clone(),
                position: place + turn * (inner.position + of.center),
                orientation: turn * inner.orientation,
            }));
        }
        let (geometry, center) = Geometry::compound(all).or_raise()?;
        Ok(Self::new(geometry, center))
    }

    /// Volume, m^3; 0 for boundaries.
    #[getter]
    fn volume(&self) -> f64 {
        self.geometry.volume
    }

    /// The centre of mass in the frame of the vertices or parts, m: a body at position x has that frame's
    /// origin at x - R center.
    #[getter]
    fn center(&self) -> [f64; 3] {
        self.center.to_array()
    }

    fn __repr__(&self) -> String {
        let name = match self.geometry.parts.as_slice() {
            [Part { shape, .. }] => shape.name(),
            _ => "compound",
        };
        format!("<graintrain.Shape: {name}, {} m^3>", self.geometry.volume)
    }
}

/// A number that depends on time: a velocity, a force. Wherever one is asked for, a plain number stands for a
/// constant.
#[pyclass(frozen, module = "graintrain")]
pub struct Function {
    profile: motion::Profile,
}

impl Function {
    fn new(profile: motion::Profile) -> PyResult<Self> {
        profile.validate().or_raise()?;
        Ok(Self { profile })
    }
}

/// A function, or the constant that a number stands for.
pub(crate) fn profile(what: &str, object: &Bound<'_, PyAny>) -> PyResult<motion::Profile> {
    if let Ok(function) = object.cast::<Function>() {
        return Ok(function.get().profile.clone());
    }
    let constant = object
        .extract::<f64>()
        .map_err(|_| PyTypeError::new_err(format!("{what}: expected a number or a graintrain.Function")))?;
    Ok(Function::new(motion::Profile::Constant(constant))?.profile)
}

#[pymethods]
impl Function {
    /// amplitude sin(2 pi t / period + phase); period in s, phase in rad.
    #[staticmethod]
    #[pyo3(signature = (amplitude, period, phase=0.0))]
    fn sinusoidal(amplitude: f64, period: f64, phase: f64) -> PyResult<Self> {
        Self::new(motion::Profile::Sinusoidal { amplitude, period, phase })
    }

    /// Linear between (time, value) pairs, constant before the first and after the last; times ascend.
    #[staticmethod]
    fn table(times: &Bound<'_, PyAny>, values: &Bound<'_, PyAny>) -> PyResult<Self> {
        let times = shaped("times", times, &[None])?;
        Self::new(motion::Profile::Table { times, values: shaped("values", values, &[None])? })
    }

    /// 0 until `start` (s), then the function with its time counted from there.
    #[staticmethod]
    fn delayed(start: f64, function: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::new(motion::Profile::Delayed { start, profile: Box::new(profile("function", function)?) })
    }

    /// Its value at a time.
    fn __call__(&self, time: f64) -> f64 {
        self.profile.value(time)
    }

    fn __repr__(&self) -> String {
        format!("<graintrain.Function: {:?}>", self.profile)
    }
}

/// Motion that is prescribed. A body without one is free.
#[pyclass(frozen, module = "graintrain")]
pub struct Motion {
    pub(crate) motion: motion::Motion,
}

impl Motion {
    fn new(motion: motion::Motion) -> PyResult<Self> {
        motion.validate().or_raise()?;
        Ok(Self { motion })
    }
}

#[pymethods]
impl Motion {
    /// Never moves.
    #[staticmethod]
    fn fixed() -> PyResult<Self> {
        Self::new(motion::Motion::fixed())
    }

    /// Moves along `direction` (not normalised) with the speed `function`, m/s, and does not turn.
    #[staticmethod]
    fn translating(direction: &Bound<'_, PyAny>, function: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::new(motion::Motion::translating(
            vector("direction", direction)?,
            profile("function", function)?,
        ))
    }

    /// Turns about an axis through a point of the world with the angular velocity `function`, rad/s.
    #[staticmethod]
    fn rotating(
        point: &Bound<'_, PyAny>,
        axis: &Bound<'_, PyAny>,
        function: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (point, axis) = (vector("point", point)?, vector("axis", axis)?);
        Self::new(motion::Motion::rotating(point, axis, profile("function", function)?))
    }

    /// Turns about an axis through its own centre of mass.
    #[staticmethod]
    fn spinning(axis: &Bound<'_, PyAny>, function: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::new(motion::Motion::spinning(vector("axis", axis)?, profile("function", function)?))
    }

    /// The same with a translation besides.
    fn and_translating(&self, direction: &Bound<'_, PyAny>, function: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (direction, profile) = (vector("direction", direction)?, profile("function", function)?);
        Self::new(self.motion.clone().and_translating(direction, profile))
    }

    /// The same with degrees of freedom that forces move: six bools, x, y, z, then rotation about x, y, z.
    fn with_free(&self, free: [bool; 6]) -> PyResult<Self> {
        Self::new(self.motion.clone().with_free(free))
    }

    fn __repr__(&self) -> String {
        format!("<graintrain.Motion: {:?}>", self.motion)
    }
}
