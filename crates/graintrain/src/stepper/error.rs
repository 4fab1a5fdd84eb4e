//! Why a step could not be made, and the checks of the state before and after a solve.

use crate::collide::meshes_that_meet;
use crate::error::{ModelError, finite};
use crate::joint::Motor;
use crate::world::World;
use graintrain_ccp::CcpError;

/// Why a step could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// A setting out of its range.
    #[error(transparent)]
    Settings(#[from] ModelError),
    /// The solver cannot treat the problem, or is not known.
    #[error(transparent)]
    Solver(#[from] CcpError),
    /// A body's state is NaN or infinite. The world is left as it was before the step.
    #[error(
        "step {step} (time {time} s): the {what} of body {body} is {value}; the state before this step was kept. \
         A shorter time step or a deeper look at initial overlaps may help"
    )]
    NotFinite {
        /// Name or index of the body.
        body: String,
        /// Which part of its state.
        what: &'static str,
        /// The offending number.
        value: f64,
        /// Number of the step, from 0.
        step: u64,
        /// Time at its start, s.
        time: f64,
    },
    /// Two meshes came near each other. The world is left as it was before the step.
    #[error(
        "bodies {first} and {second} are meshes and came near each other, but contacts between two meshes are not computed; make one of \
         them of other shapes"
    )]
    Meshes {
        /// Name or index of a body.
        first: String,
        /// Name or index of the other.
        second: String,
    },
    /// The periodic cell cannot be what the step makes of it. The world is left as it was before the step.
    #[error("step {step} (time {time} s): {error}")]
    Cell {
        /// Which component, or which body and edge, and the remedy.
        error: ModelError,
        /// Number of the step, from 0.
        step: u64,
        /// Time at its start, s.
        time: f64,
    },
    /// The stop flag was set during the solve. The world is left as it was before the step, since a solve cut
    /// short depends on when that was.
    #[error("stopped before the end of a step")]
    Stopped,
}

fn not_finite(world: &World, body: usize, what: &'static str, value: f64) -> StepError {
    let (step, time) = (world.step, world.time);
    StepError::NotFinite { body: world.bodies.label(body), what, value, step, time }
}

pub(super) fn cell_error(world: &World, error: ModelError) -> StepError {
    StepError::Cell { error, step: world.step, time: world.time }
}

/// Every number is one, and no two meshes meet: they have no contacts with each other.
pub(super) fn check_state(world: &World) -> Result<(), StepError> {
    let bodies = &world.bodies;
    let lists = [
        ("position", &bodies.position),
        ("velocity", &bodies.velocity),
        ("angular velocity", &bodies.angular_velocity),
        ("external force", &bodies.force),
        ("external torque", &bodies.torque),
    ];
    finite("a component of gravity", &world.gravity.to_array())?;
    for (what, list) in lists {
        if let Some(body) = list.iter().position(|v| !v.is_finite()) {
            let value = list[body].to_array().into_iter().find(|x| !x.is_finite()).unwrap_or(f64::NAN);
            return Err(not_finite(world, body, what, value));
        }
    }
    if let Some(body) = bodies.orientation.iter().position(|q| !q.is_finite()) {
        return Err(not_finite(world, body, "orientation", f64::NAN));
    }
    match meshes_that_meet(world) {
        Some(meshes) => {
            let [first, second] = meshes.map(|body| world.bodies.label(body));
            Err(StepError::Meshes { first, second })
        }
        None => Ok(()),
    }
}

/// What drives joints in a step (s) is a number: speeds, forces and their limits, lengths of springs at rest.
pub(super) fn check_drives(world: &World, step: f64) -> Result<(), StepError> {
    for (index, placed) in world.joints().iter().enumerate() {
        let joint = &placed.joint;
        let [first, second] = match &joint.motor {
            Some(Motor::Speed { speed, limit }) => [Some(speed), limit.as_ref()],
            Some(Motor::Force(force)) => [Some(force), None],
            None => [None; 2],
        };
        let rest = joint.spring.as_ref().and_then(|spring| spring.rest.as_ref());
        let drives = [
            ("speed or force of the motor", first),
            ("limit of the motor", second),
            ("rest of the spring", rest),
        ];
        for (what, profile) in drives.into_iter().filter_map(|(what, profile)| Some((what, profile?))) {
            let (time, value) = (world.time, profile.mean(world.time, step));
            // A limit without bounds is none.
            let is_none = what.starts_with("limit") && value == f64::INFINITY;
            if !value.is_finite() && !is_none {
                let of = world.joint_label(index);
                let what = format!("the {what} of {of} in the step from {time} s on");
                return Err(ModelError::Value { what, value, expected: "finite" }.into());
            }
        }
    }
    Ok(())
}

/// No body moves as fast, m/s and rad/s: energies have to be numbers.
const FASTEST: f64 = 1e145;

pub(super) fn check_velocity(world: &World, velocity: &[f64]) -> Result<(), StepError> {
    // Nor are those whose energy is no number.
    match velocity.iter().position(|v| v.is_nan() || v.abs() >= FASTEST) {
        Some(k) => {
            let what = if k % 6 < 3 { "velocity" } else { "angular velocity" };
            Err(not_finite(world, k / 6, what, velocity[k]))
        }
        None => Ok(()),
    }
}
