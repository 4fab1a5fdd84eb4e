//! Small worlds of one material, stepped with the defaults of scenes, or to more digits where a closed form
//! is compared.

use super::{Row, VerifyError};
use graintrain::handle::{BodyId, MaterialId};
use graintrain::material::Materials;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepReport, StepSettings, Stepper};
use graintrain::world::{Body, World};
use graintrain_ccp::{Criterion, FrictionModel, SolverSpec};

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
pub fn add_ground(world: &mut World, tilt: f64) -> Result<BodyId, VerifyError> {
    add_plane(world, Vec3::ZERO, Quat::from_rotation_y(tilt) * Vec3::Z)
}

/// Adds the fixed half-space below a point, with this normal out of it.
///
/// # Errors
/// None in practice.
pub fn add_plane(world: &mut World, point: Vec3, normal: Vec3) -> Result<BodyId, VerifyError> {
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed())?;
    let orientation = Quat::from_rotation_arc(Vec3::Z, normal);
    Ok(world.add_body(Body {
        motion: fixed,
        orientation,
        ..Body::new(plane, MaterialId::default(), point)
    })?)
}

/// Adds four fixed walls at x, y = +-`half`.
///
/// # Errors
/// None in practice.
pub fn add_walls(world: &mut World, half: f64) -> Result<(), VerifyError> {
    for normal in [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y] {
        add_plane(world, -half * normal, normal)?;
    }
    Ok(())
}

/// Adds a free sphere.
///
/// # Errors
/// [`VerifyError::Model`] for a radius that is not positive.
pub fn add_sphere(world: &mut World, radius: f64, position: Vec3) -> Result<usize, VerifyError> {
    let ball = world.add_geometry(Geometry::sphere(radius)?);
    Ok(world.add_body(Body::new(ball, MaterialId::default(), position))?.index())
}

/// Numbers in [-1, 1) from a fixed linear congruence: the same on every machine.
pub fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// To what contact problems are solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    /// Residual at which the solver stops.
    pub tolerance: f64,
    /// Which number of the residual that is.
    pub criterion: Criterion,
}

impl Accuracy {
    /// Of a scene that asks for nothing.
    pub const SCENES: Self = Self { tolerance: 1e-4, criterion: Criterion::Mixed };

    /// Of the worst contact, for closed forms to many digits.
    pub const fn fine(tolerance: f64) -> Self {
        Self { tolerance, criterion: Criterion::Maximum }
    }

    /// That of scenes, then one for many digits.
    pub const fn both(tolerance: f64) -> [Self; 2] {
        [Self::SCENES, Self::fine(tolerance)]
    }

    /// What it promises of the worst contact, relative: its velocity is off by at most this times |g| dt (or
    /// the root mean square of the approaches where there is no gravity), its force by at most this times the
    /// weight of its effective mass.
    pub fn promise(&self) -> f64 {
        self.criterion.maximum(self.tolerance)
    }

    /// `fine` at an accuracy for many digits; at that of scenes what it promises times `scale`, where that is
    /// more.
    pub fn allowed(&self, fine: f64, scale: f64) -> f64 {
        if self.criterion == Criterion::Maximum { fine } else { fine.max(self.promise() * scale) }
    }
}

/// Steps a world and counts the steps whose solve did not reach its tolerance.
pub struct Bench {
    stepper: Stepper,
    accuracy: Accuracy,
    friction: FrictionModel,
    steps: usize,
    unsolved: usize,
}

impl Bench {
    /// With time step and envelope, accuracy and friction model, and the solver of scenes.
    ///
    /// # Errors
    /// [`VerifyError::Step`] for settings out of range.
    pub fn new(
        step: f64,
        envelope: f64,
        accuracy: Accuracy,
        friction: FrictionModel,
    ) -> Result<Self, VerifyError> {
        let Accuracy { tolerance, criterion } = accuracy;
        let solver = SolverSpec::default();
        let settings = StepSettings {
            step,
            envelope,
            solver: SolverChoice { name: solver, tolerance, criterion, friction, ..SolverChoice::default() },
            ..StepSettings::default()
        };
        Ok(Self { stepper: Stepper::new(settings)?, accuracy, friction, steps: 0, unsolved: 0 })
    }

    /// One step.
    ///
    /// # Errors
    /// [`VerifyError::Step`].
    pub fn step(&mut self, world: &mut World) -> Result<StepReport, VerifyError> {
        let report = self.stepper.step(world)?;
        self.steps += 1;
        // A stalled solve within a tenth of the tolerance is round-off.
        let residual = report.solve.residual.measured(self.accuracy.criterion);
        // Impacts have a tolerance of their own, tighter than most; a step that did not reach it says so by
        // its status alone.
        let impacts = report.impact_residual.measured(self.accuracy.criterion);
        let unconverged = |residual: f64, tolerance: f64| residual.is_nan() || residual > 1.1 * tolerance;
        self.unsolved += usize::from(
            unconverged(residual, self.accuracy.tolerance)
                || unconverged(impacts, self.accuracy.tolerance.max(1e-9)),
        );
        Ok(report)
    }

    /// Several steps.
    ///
    /// # Errors
    /// Those of [`Self::step`].
    pub fn steps(&mut self, world: &mut World, count: usize) -> Result<(), VerifyError> {
        (0..count).try_for_each(|_| self.step(world).map(drop))
    }

    /// Counts the steps of another bench as this one's.
    pub fn count(&mut self, other: &Self) {
        self.steps += other.steps;
        self.unsolved += other.unsolved;
    }

    /// With the steps of another bench of the same settings.
    pub fn and(mut self, other: &Self) -> Self {
        self.count(other);
        self
    }

    /// A row of what was measured with the steps so far.
    pub fn row(&self, what: impl Into<String>, measured: f64, expected: f64, allowed: f64) -> Row {
        Row {
            what: what.into(),
            friction: Some(self.friction),
            solver: self.stepper.settings().solver.name.to_string(),
            step: self.stepper.settings().step,
            accuracy: self.accuracy,
            measured,
            expected,
            allowed,
            error: 0.0,
            steps: self.steps,
            unsolved: self.unsolved,
        }
    }
}
