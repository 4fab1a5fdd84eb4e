//! Joints of a scene.

use super::super::error::{SceneError, SceneErrorKind};
use super::super::joint::{JointSpec, SpringSpec, StopsSpec};
use super::super::model::FunctionSpec;
use super::{Builder, function, model_error};
use graintrain::handle::{BodyId, JointId};
use graintrain::joint::{Joint, Limits, Motor, Spring};
use graintrain::motion::Profile;

/// A motor with this speed and this limit, or with this force.
fn motor(speed: Option<&FunctionSpec>, force: Option<&FunctionSpec>) -> Result<Option<Motor>, SceneError> {
    let [speed, force] = [speed, force].map(|part| part.map(function).transpose());
    let (speed, force): (Option<Profile>, Option<Profile>) = (speed?, force?);
    Ok(match (speed, force) {
        (Some(speed), limit) => Some(Motor::Speed { speed, limit }),
        (None, Some(force)) => Some(Motor::Force(force)),
        (None, None) => None,
    })
}

impl Builder {
    /// Adds a joint; `all` are those of the scene, of which the ones above it are in the world.
    pub(super) fn add_joint(
        &mut self,
        name: &str,
        spec: &JointSpec,
        all: &[(String, JointSpec)],
    ) -> Result<(), SceneError> {
        let body = |label: &String| {
            let origin = self.origins.iter().find(|origin| !origin.is_packing && origin.label == *label);
            origin.map(|origin| BodyId::from_index(origin.first))
        };
        let bodies = match spec.bodies.as_slice() {
            [alone] => [None, body(alone)],
            [a, b] => [body(a), body(b)],
            _ => [None, None],
        };
        let number = |label: &str| {
            JointId::from_index(all.iter().position(|(other, _)| other == label).unwrap_or(all.len()))
        };
        let kind = spec.holds(number).ok_or_else(|| {
            let problem = format!("`joint.{name}` is incomplete");
            SceneError::at(SceneErrorKind::Contradiction(problem), &spec.location)
        })?;
        let turning = spec.motor.as_ref().map(|m| motor(m.speed.as_ref(), m.torque.as_ref()));
        let sliding = spec.actuator.as_ref().map(|m| motor(m.speed.as_ref(), m.force.as_ref()));
        let spring = spec.torsion_spring.as_ref().or(spec.spring.as_ref());
        let spring = spring.map(|SpringSpec { stiffness, damping, rest }| {
            let rest = rest.as_ref().map(function).transpose()?;
            Ok(Spring { stiffness: *stiffness, damping: *damping, rest })
        });
        let stops = spec.angles.as_ref().or(spec.travel.as_ref());
        let joint = Joint {
            name: name.to_string(),
            motor: turning.or(sliding).transpose()?.flatten(),
            spring: spring.transpose()?,
            limits: stops.map(|StopsSpec { lower, upper }| Limits { lower: *lower, upper: *upper }),
            collide: spec.collide,
            ..Joint::new(bodies, kind)
        };
        self.world.add_joint(joint).map_err(|error| model_error(error, &spec.location))?;
        Ok(())
    }
}
