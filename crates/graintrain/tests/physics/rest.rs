//! What a step costs in which nothing moves.

use crate::support::*;
use graintrain::ccp::{Judge, SolveSettings, SolverSpec};
use graintrain::handle::MaterialId;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{StepSettings, Stepper};
use graintrain::world::{Body, World};
use std::time::Instant;

const TOLERANCE: f64 = 1e-2;
const STEP: f64 = 0.01;

/// A bed of edge^3 spheres that has come to rest between four walls, with the stepper that brought it there.
fn settled(edge: usize) -> (World, Stepper) {
    let radius = 0.05;
    let mut world = world(0.3, 0.0);
    add_ground(&mut world, 0.0);
    let pitch = 2.1 * radius;
    let side = pitch * edge as f64;
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    for (normal, place) in
        [(Vec3::X, Vec3::ZERO), (-Vec3::X, side * Vec3::X), (Vec3::Y, Vec3::ZERO), (-Vec3::Y, side * Vec3::Y)]
    {
        let orientation = Quat::from_rotation_arc(Vec3::Z, normal);
        world
            .add_body(Body { motion: fixed, orientation, ..Body::new(plane, MaterialId::default(), place) })
            .unwrap();
    }
    let ball = world.add_geometry(Geometry::sphere(radius).unwrap());
    for k in 0..edge * edge * edge {
        let jitter = |turn: f64| 0.02 * radius * (turn * k as f64).sin();
        let at = [k % edge, k / edge % edge, k / (edge * edge)].map(|i| pitch * (i as f64 + 0.5));
        let place = Vec3::from_array(at) + Vec3::new(jitter(1.3), jitter(2.1), 0.0);
        world.add_body(Body::new(ball, MaterialId::default(), place)).unwrap();
    }
    let settings = StepSettings { step: STEP, tolerance: TOLERANCE, ..StepSettings::default() };
    let mut stepper = Stepper::new(settings).unwrap();
    run(&mut stepper, &mut world, 150);
    (world, stepper)
}

/// Seconds of this thread's best of a few times.
fn least_seconds(mut work: impl FnMut()) -> f64 {
    let time = |_| {
        let begin = Instant::now();
        work();
        begin.elapsed().as_secs_f64()
    };
    (0..7).map(time).fold(f64::INFINITY, f64::min)
}

/// Iterations of a cold solve of the last step's problem, and its seconds.
fn cold(stepper: &Stepper) -> (usize, f64) {
    let (problem, _) = stepper.last_problem().unwrap();
    let settings = SolveSettings { tolerance: TOLERANCE, judge: Judge::Mixed, ..SolveSettings::default() };
    let mut iterations = 0;
    let seconds = least_seconds(|| {
        let mut solver = SolverSpec::default().build().unwrap();
        let report = solver.solve(problem, &mut vec![0.0; problem.r.len()], &settings).unwrap();
        assert!(report.converged());
        iterations = report.iterations;
    });
    (iterations, seconds)
}

/// The impulses of the last step are those of this one: no iteration.
#[test]
fn a_bed_at_rest_is_not_solved_again() {
    let (mut world, mut stepper) = settled(8);
    let mut iterations = Vec::new();
    for _ in 0..20 {
        let report = solved_step(&mut stepper, &mut world);
        assert!(report.contacts >= 256);
        iterations.push(report.solve.iterations);
    }
    let idle = iterations.iter().filter(|&&count| count == 0).count();
    assert!(idle >= 18, "{iterations:?}");
    assert!(cold(&stepper).0 >= 30, "{}", cold(&stepper).0);
}

/// The whole step, collision and report included, against a cold solve alone.
#[test]
#[ignore = "a ratio of times: of a machine without other work"]
fn a_step_in_which_nothing_moves_costs_a_fraction_of_a_cold_solve() {
    let (mut world, mut stepper) = settled(20);
    let step = least_seconds(|| {
        assert_eq!(stepper.step(&mut world).unwrap().solve.iterations, 0);
    });
    let (iterations, cold) = cold(&stepper);
    println!(
        "step {:.2} ms, cold solve {:.2} ms, {iterations} iterations: {:.3}",
        1e3 * step,
        1e3 * cold,
        step / cold
    );
    assert!(step < 0.15 * cold, "{:.3}", step / cold);
}
