//! What the tests share.

use graintrain::ccp::{Criterion, FrictionModel, Status};
use graintrain::handle::{BodyId, MaterialId};
use graintrain::material::Materials;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepReport, StepSettings, Stepper};
use graintrain::world::{Body, World};

pub const G: f64 = 9.81;

/// A world under gravity along -z with one material.
pub fn world(friction: f64, restitution: f64) -> World {
    let materials = Materials::single("stuff", 1000.0, friction, restitution).unwrap();
    World::new(Vec3::new(0.0, 0.0, -G), materials).unwrap()
}

/// Adds the fixed half-space z <= 0, tilted about y so that the way down is +x.
pub fn add_ground(world: &mut World, tilt: f64) -> BodyId {
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    let orientation = Quat::from_rotation_y(tilt);
    world
        .add_body(Body { motion: fixed, orientation, ..Body::new(plane, MaterialId::default(), Vec3::ZERO) })
        .unwrap()
}

pub fn add_sphere(world: &mut World, radius: f64, position: Vec3) -> usize {
    let ball = world.add_geometry(Geometry::sphere(radius).unwrap());
    world.add_body(Body::new(ball, MaterialId::default(), position)).unwrap().index()
}

/// As a scene that says nothing but its step.
pub fn default_stepper(step: f64) -> Stepper {
    Stepper::new(StepSettings { step, ..StepSettings::default() }).unwrap()
}

pub fn stepper(step: f64, envelope: f64, tolerance: f64, friction: FrictionModel) -> Stepper {
    Stepper::new(StepSettings {
        step,
        envelope,
        solver: SolverChoice {
            name: "apgd".parse().unwrap(),
            tolerance,
            criterion: Criterion::Maximum,
            max_iterations: Some(200_000),
            friction,
        },
        ..StepSettings::default()
    })
    .unwrap()
}

/// One step, which has to reach its tolerance.
pub fn solved_step(stepper: &mut Stepper, world: &mut World) -> StepReport {
    let report = stepper.step(world).unwrap();
    assert_eq!(report.solve.status, Status::Converged, "{:?}", report.solve);
    report
}

pub fn run(stepper: &mut Stepper, world: &mut World, steps: usize) {
    for _ in 0..steps {
        solved_step(stepper, world);
    }
}

pub fn assert_close(got: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((got - expected).abs() <= tolerance, "{what}: {got}, expected {expected} +- {tolerance}");
}

pub const BOTH: [FrictionModel; 2] = [FrictionModel::Relaxed, FrictionModel::Coulomb];

/// A number in [0, 1) of a sequence without order.
pub fn scattered(k: u32, salt: f64) -> f64 {
    (0.618_033_988_749_894_9 * f64::from(k) + salt).fract()
}
