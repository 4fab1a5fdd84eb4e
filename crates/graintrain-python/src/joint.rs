//! Joints of worlds built in code.

use crate::arrays::vector;
use crate::error::OrRaise;
use crate::model::profile;
use crate::world::World;
use graintrain::handle::{BodyId, JointId};
use graintrain::joint::{Coordinate, Joint, JointKind, Limits, Motor, Pair, Spring};
use graintrain::math::Vec3;
use pyo3::exceptions::{PyIndexError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

fn needed<T>(kind: &str, what: &str, given: Option<T>) -> PyResult<T> {
    given.ok_or_else(|| PyTypeError::new_err(format!("a {kind} joint needs {what}")))
}

#[pymethods]
impl World {
    /// Adds a joint and returns its index. kind: fixed, revolute, prismatic, cylindrical, planar, spherical
    /// (point; axis), distance (ends: a point of `other` and one of `body`), gear (joints: two indices;
    /// ratio). It holds `body` (index or name) to `other`, or to the world, where they are now; points and
    /// axes are in the world.
    ///
    /// The coordinate (angle, slide or distance of `body` relative to `other`; of cylindrical joints "turn"
    /// or "slide") may have a motor (speed with a limit of force, or force; numbers or Functions), a spring
    /// (stiffness, damping, rest) and stops (lower, upper).
    #[pyo3(signature = (kind, body=None, other=None, *, point=None, axis=None, ends=None, joints=None, ratio=None, coordinate="turn",
                        speed=None, limit=None, force=None, stiffness=None, damping=None, rest=None, lower=None, upper=None,
                        collide=false, name=""))]
    fn add_joint(
        &mut self,
        kind: &str,
        body: Option<&Bound<'_, PyAny>>,
        other: Option<&Bound<'_, PyAny>>,
        point: Option<&Bound<'_, PyAny>>,
        axis: Option<&Bound<'_, PyAny>>,
        ends: Option<[Bound<'_, PyAny>; 2]>,
        joints: Option<[usize; 2]>,
        ratio: Option<f64>,
        coordinate: &str,
        speed: Option<&Bound<'_, PyAny>>,
        limit: Option<&Bound<'_, PyAny>>,
        force: Option<&Bound<'_, PyAny>>,
        stiffness: Option<f64>,
        damping: Option<f64>,
        rest: Option<&Bound<'_, PyAny>>,
        lower: Option<f64>,
        upper: Option<f64>,
        collide: bool,
        name: &str,
    ) -> PyResult<usize> {
        let coordinate = match coordinate {
            "turn" => Coordinate::Turn,
            "slide" => Coordinate::Slide,
            unknown => {
                return Err(PyValueError::new_err(format!(
                    "coordinate is {unknown:?}, expected turn or slide"
                )));
            }
        };
        let joint_kind = match kind {
            "distance" => {
                let [from, to] = needed(kind, "two ends", ends)?;
                JointKind::Distance { ends: [vector("ends[0]", &from)?, vector("ends[1]", &to)?] }
            }
            "gear" => {
                let pair = needed(kind, "two joints", joints)?;
                let count = self.state().joints().len();
                if let Some(unknown) = pair.into_iter().find(|&joint| joint >= count) {
                    return Err(PyIndexError::new_err(format!(
                        "there is no joint {unknown}; the world has {count}"
                    )));
                }
                JointKind::Gear {
                    joints: pair.map(JointId::from_index),
                    ratio: needed(kind, "a ratio", ratio)?,
                }
            }
            _ => {
                let pairs = Pair::ALL.iter().copied();
                let Some(pair) = pairs.clone().find(|pair| pair.name() == kind) else {
                    let known: Vec<&str> = pairs.map(Pair::name).chain(["distance", "gear"]).collect();
                    let known = known.join(", ");
                    return Err(PyValueError::new_err(format!("kind is {kind:?}, expected one of {known}")));
                };
                let along =
                    if pair.has_axis() { vector("axis", needed(kind, "an axis", axis)?)? } else { Vec3::Z };
                let point = match point {
                    None if pair == Pair::Fixed => Vec3::ZERO,
                    point => vector("point", needed(kind, "a point", point)?)?,
                };
                JointKind::Pair { pair, point, axis: along, coordinate }
            }
        };
        let is_gear = matches!(joint_kind, JointKind::Gear { .. });
        let bodies = if is_gear {
            if body.is_some() || other.is_some() {
                return Err(PyTypeError::new_err("a gear joint has the bodies of its joints, not its own"));
            }
            [None, None]
        } else {
            let body = needed(kind, "a body", body)?;
            let other = other.map(|other| self.index_of(other)).transpose()?.map(BodyId::from_index);
            [other, Some(BodyId::from_index(self.index_of(body)?))]
        };
        let motor = match (speed, limit, force) {
            (None, None, None) => None,
            (Some(speed), limit, None) => Some(Motor::Speed {
                speed: profile("speed", speed)?,
                limit: limit.map(|limit| profile("limit", limit)).transpose()?,
            }),
            (None, None, Some(force)) => Some(Motor::Force(profile("force", force)?)),
            _ => return Err(PyTypeError::new_err("a motor has a speed (and a limit), or a force")),
        };
        let spring = if stiffness.is_some() || damping.is_some() {
            let rest = rest.map(|rest| profile("rest", rest)).transpose()?;
            let [stiffness, damping] = [stiffness, damping].map(Option::unwrap_or_default);
            Some(Spring { stiffness, damping, rest })
        } else if rest.is_some() {
            return Err(PyTypeError::new_err("rest is that of a spring: give a stiffness"));
        } else {
            None
        };
        let limits = (lower.is_some() || upper.is_some()).then_some(Limits { lower, upper });
        let joint =
            Joint { name: name.to_string(), bodies, kind: joint_kind, motor, spring, limits, collide };
        Ok(self.state().add_joint(joint).or_raise()?.index())
    }

    /// What the joints did in the last step, one dictionary each: name, coordinate (m or rad, angles count
    /// whole turns), rate, force and torque on the body (N, N m, world axes), drive (force of motor, spring
    /// and stops along the coordinate), opening (m, how far it is open, or its motor
    /// held up).
    #[getter]
    fn joints<'py>(&mut self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let describe = |placed: &graintrain::joint::PlacedJoint| {
            let (state, about) = (&placed.state, PyDict::new(py));
            about.set_item("name", &placed.joint.name)?;
            about.set_item("coordinate", state.coordinate)?;
            about.set_item("rate", state.rate)?;
            about.set_item("force", state.force.to_array())?;
            about.set_item("torque", state.torque.to_array())?;
            about.set_item("drive", state.drive)?;
            about.set_item("opening", state.opening)?;
            Ok(about)
        };
        self.state().joints().iter().map(describe).collect()
    }
}
