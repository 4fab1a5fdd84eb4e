//! Prescribed motions.

use super::super::error::SceneError;
use super::super::reader::Reader;
use super::super::table::{Field, table};
use super::super::tree::{Node, Value};
use super::FunctionSpec;
use graintrain::math::Vec3;
use serde::Serializer;

table! {
    /// How a body moves.
    pub struct MotionSpec: "`motion`" {
        /// Degrees of freedom that stay dynamic: x, y, z, rx, ry, rz; all others follow the prescribed
        /// velocity, zero by default
        #[serde(serialize_with = "degree_names")]
        free: [bool; 6] = Texts, "[]", "[\"z\"]";
        /// Start of the motion, at rest before; `t` in speeds is the time since then
        start: f64 = Quantity(D::TIME), "0", "\"0.5 s\"", NotNegative;
        /// Prescribed velocities, summed
        #[serde(skip_serializing_if = "Vec::is_empty")]
        translation: Vec<TranslationSpec> = Tables(TranslationSpec::TABLE), "[]",
            "[{ direction = [1, 0, 0], speed = \"1 cm/s\" }]";
        /// Prescribed rotation about an axis that moves with the body, or through a point fixed in the world
        rotation: Option<SpinSpec> = Table(SpinSpec::TABLE), "none",
            "{ axis = [0, 0, 1], speed = \"12 rpm\" }";
    }
}

table! {
    /// A prescribed translation.
    pub struct TranslationSpec: "`motion.translation`" {
        /// Direction; any length
        direction: Vec3 = Direction, "required", "[1, 0, 0]";
        /// Speed: constant, or a function of time such as "1 m/s * sin(2*pi*t/4 s)"
        speed: FunctionSpec = Function(D::SPEED, &SPEED), "required", "\"10 cm/s\"";
    }
}

table! {
    /// A prescribed rotation.
    pub struct SpinSpec: "`motion.rotation`" {
        /// A point of an axis that is fixed in the world
        point: Option<Vec3> = Vector(D::LENGTH), "the origin of the body's frame, moving with it",
            "[0, 0, 0]";
        /// Direction of the axis; any length
        axis: Vec3 = Direction, "[0, 0, 1]", "[1, 0, 0]";
        /// Angular speed: constant, or a function of time
        speed: FunctionSpec = Function(D::ANGULAR_SPEED, &ANGULAR_SPEED), "required", "\"12 rpm\"";
    }
}

/// Motions without a table, and whether the body is fixed.
pub(crate) const MOTIONS: &[(&str, bool)] = &[("free", false), ("fixed", true)];

/// Names of the degrees of freedom, in the order of [`graintrain::motion::Motion::free`].
pub(crate) const DEGREES: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

fn degree_names<S: Serializer>(free: &[bool; 6], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(DEGREES.iter().zip(free).filter(|(_, free)| **free).map(|(name, _)| name))
}

impl MotionSpec {
    /// All degrees of freedom dynamic.
    pub const FREE: Self = Self { free: [true; 6], start: 0.0, translation: Vec::new(), rotation: None };
    /// At rest.
    pub const FIXED: Self = Self { free: [false; 6], start: 0.0, translation: Vec::new(), rotation: None };

    /// The `motion` of a body, or what it is without one: free, or fixed where it is a boundary.
    pub(crate) fn of_body(body: &Reader, boundary: bool) -> Result<Self, SceneError> {
        let fixed = match body.get("motion") {
            None => boundary,
            Some(Node { value: Value::Table(_), .. }) => return body.field("motion"),
            Some(_) => body.choice("motion", MOTIONS)?.unwrap_or(false),
        };
        Ok(if fixed { Self::FIXED } else { Self::FREE })
    }
}

/// Names of [`DEGREES`].
impl Field for [bool; 6] {
    fn choices() -> Vec<&'static str> {
        DEGREES.to_vec()
    }

    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        let mut free = [false; 6];
        for name in reader.texts(key)?.unwrap_or_default() {
            let degree = DEGREES.iter().position(|degree| *degree == name);
            let degree = degree
                .ok_or_else(|| reader.unknown_name(key, "degree of freedom", &name, DEGREES.into_iter()))?;
            free[degree] = true;
        }
        Ok(Some(free))
    }
}
