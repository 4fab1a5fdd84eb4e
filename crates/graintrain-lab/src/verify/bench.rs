//! Small worlds of one material, and stepping them with every contact problem solved.

use super::VerifyError;
use graintrain::material::Materials;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{StepError, StepReport, StepSettings, Stepper};
use graintrain::world::{Body, World};
use graintrain_ccp::{FrictionModel, Judge, SolverSpec};

/// Acceleration of gravity, m/s^2.
pub const G: f64 = 9.81;

/// A world under gravity along -z with one material of density 1000 kg/m^3.
///
/// # Errors
/// [`VerifyError::Model`] for friction or restitution out of range.
pub fn world(friction: f64, restitution: f64) -> Result<World, VerifyError> {
    let materials = Materials::single("stuff", 1000.0, friction, restitution)?;
    Ok(World::new(Vec3::new(0.0, 0.0, -G), materials)?)
}

/// Adds the fixed half-space z <= 0, tilted about y by `tilt` (rad) so that the way down is +x.
///
/// # Errors
/// None in practice.
pub fn add_ground(world: &mut World, tilt: f64) -> Result<u32, VerifyError> {
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed())?;
    let orientation = Quat::from_rotation_y(tilt);
    Ok(world.add_body(Body { motion: fixed, orientation, ..Body::new(plane, 0, Vec3::ZERO) })?)
}

/// Adds a free sphere.
///
/// # Errors
/// [`VerifyError::Model`] for a radius that is not positive.
pub fn add_sphere(world: &mut World, radius: f64, position: Vec3) -> Result<usize, VerifyError> {
    let ball = world.add_geometry(Geometry::sphere(radius)?);
    Ok(world.add_body(Body::new(ball, 0, position))? as usize)
}

/// Steps a world; a solve that misses its tolerance is an error.
pub struct Bench {
    stepper: Stepper,
    tolerance: f64,
}

impl Bench {
    /// With time step and envelope, residual and friction model.
    ///
    /// # Errors
    /// [`VerifyError::Step`] for settings out of range.
    pub fn new(
        step: f64,
        envelope: f64,
        tolerance: f64,
        friction: FrictionModel,
    ) -> Result<Self, VerifyError> {
        let solver = "apgd".parse::<SolverSpec>().map_err(StepError::from)?;
        let max_iterations = Some(200_000);
        let settings = StepSettings {
            step,
            envelope,
            solver,
            tolerance,
            judge: Judge::Maximum,
            max_iterations,
            friction,
            ..StepSettings::default()
        };
        Ok(Self { stepper: Stepper::new(settings)?, tolerance })
    }

    /// One step.
    ///
    /// # Errors
    /// [`VerifyError::Unsolved`] or [`VerifyError::Step`].
    pub fn step(&mut self, world: &mut World) -> Result<StepReport, VerifyError> {
        let report = self.stepper.step(world)?;
        let residual = report.solve.residual.max;
        // A stalled solve within a tenth of the tolerance is round-off.
        if residual > 1.1 * self.tolerance {
            return Err(VerifyError::Unsolved { residual, tolerance: self.tolerance });
        }
        Ok(report)
    }

    /// Several steps.
    ///
    /// # Errors
    /// Those of [`Self::step`].
    pub fn steps(&mut self, world: &mut World, count: usize) -> Result<(), VerifyError> {
        (0..count).try_for_each(|_| self.step(world).map(drop))
    }
}
