//! Tier B: passive earth pressure on a smooth wall (Rankine 1857), and the friction angle that it tells.
//!
//! In a yielding bed under its own weight sigma_x = K sigma_z with K = tan^2(45 degrees + phi/2). With
//! integral sigma_z dz = g sum m z / area, taken over the grains before the wall, K needs neither the height
//! nor the bulk density: K = (force / width) / (g sum m z / (length width)).

use super::bench::{Accuracy, G};
use super::source::{CHIALVO, PEYNEAU_ROUX, RANKINE, Source};
use super::{Definition, Measure, Row, Sampling, VerifyError};
use crate::reproduce::physics::Steady;
use crate::reproduce::{ReproduceError, SEEDS};
use graintrain::stepper::Stepper;
use graintrain_ccp::FrictionModel;
use graintrain_io::scene::{Scene, Simulation};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Width of the bed, m: the scene's lattice across the way.
const SPHERES_ACROSS: f64 = 8.0;
const PITCH: f64 = 0.23;
/// Grains up to here before the wall carry the stress, m: about the height, less than the length of the
/// yielding wedge.
const LENGTH: f64 = 1.5;
/// K is averaged while the wall's way is this part of the height: the bed yields, the heap before the wall is
/// small.
const WINDOW: std::ops::Range<f64> = 0.10..0.15;

/// A friction of the grains and the friction angle of their assembly in degrees.
struct Known {
    friction: f64,
    angle: f64,
    /// Of K, relative.
    tolerance: f64,
}

const KNOWN: [Known; 2] = [
    // 0.6 degrees are 2.1 % of K.
    Known { friction: 0.0, angle: 5.76, tolerance: 0.021 },
    Known { friction: 0.25, angle: 18.65, tolerance: 0.15 },
];

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "C9a",
        title: "Passive earth pressure without friction",
        setup: "A smooth wall is pushed into a bed of 2 816 spheres without friction, four perturbed lattices.",
        sources: &[
            PEYNEAU_ROUX,
            RANKINE,
            Source::Algebra(
                "K = tan^2(45 degrees + phi/2) at phi = 5.76 degrees; 0.6 degrees are 2.1 % of K",
            ),
        ],
        measure: Measure::Sample(|sampling| checks(&KNOWN[0], sampling, FrictionModel::Relaxed)),
    },
    Definition {
        id: "C9",
        title: "Passive earth pressure with friction",
        setup: "A smooth wall is pushed into a bed of 2 816 spheres with mu = 0.25, four perturbed lattices.",
        sources: &[
            RANKINE,
            CHIALVO,
            Source::Algebra(
                "mu* = 0.3375 between those of mu = 0.1 (0.27) and mu = 0.3 (0.36), that is 18.65 degrees",
            ),
        ],
        measure: Measure::SampleWithFriction(|sampling, model| checks(&KNOWN[1], sampling, model)),
    },
];

/// K, averaged over perturbed lattices.
fn checks(known: &Known, sampling: &mut Sampling<'_>, model: FrictionModel) -> Result<Vec<Row>, VerifyError> {
    let mut pressures = Vec::new();
    for seed in 1..=SEEDS {
        (sampling.progress)(&format!("passive wall, friction {}, seed {seed}", known.friction));
        pressures.push(pressure(known.friction, seed, model, &sampling.stop)?);
    }
    let settings = simulation(known.friction, 1, model)?.settings;
    let single = pressures.into_iter().map(|mean| Steady { mean, error: f64::NAN });
    let steady = Steady::over(single).unwrap_or(Steady { mean: f64::NAN, error: f64::NAN });
    let expected = (45.0_f64 + known.angle / 2.0).to_radians().tan().powi(2);
    let angle = ((steady.mean - 1.0) / (steady.mean + 1.0)).asin().to_degrees();
    Ok(vec![Row {
        what: format!("K (1; that is {angle:.2} degrees)"),
        friction: Some(settings.solver.friction),
        solver: settings.solver.name.to_string(),
        step: settings.step,
        accuracy: Accuracy { tolerance: settings.solver.tolerance, criterion: settings.solver.criterion },
        measured: steady.mean,
        expected,
        allowed: known.tolerance * expected,
        error: steady.error,
        steps: 0,
        unsolved: 0,
    }])
}

/// The scene at a friction, one perturbed lattice.
fn simulation(friction: f64, seed: u64, model: FrictionModel) -> Result<Simulation, ReproduceError> {
    let set = |key: &str, value: String| (key.to_string(), value);
    let settings = [
        set("friction", friction.to_string()),
        set("seed", seed.to_string()),
        set("solver.friction", model.to_string()),
        set("across", SPHERES_ACROSS.to_string()),
        set("pitch", format!("{PITCH} m")),
    ];
    Ok(Scene::load("passive-wall", &settings)?.build()?)
}

/// Mean of K over [`WINDOW`].
fn pressure(
    friction: f64,
    seed: u64,
    model: FrictionModel,
    stop: &Arc<AtomicBool>,
) -> Result<f64, ReproduceError> {
    let simulation = simulation(friction, seed, model)?;
    let mut world = simulation.world;
    let mut stepper = Stepper::new(simulation.settings)?;
    stepper.stop_on(Arc::clone(stop));
    let wall = world.bodies.name.iter().position(|name| name == "wall").unwrap_or(0);
    let start = world.bodies.position[wall].x;
    let (mut sum, mut count) = (0.0, 0.0);
    for _ in 0..simulation.steps {
        let report = stepper.step(&mut world)?;
        let way = world.bodies.position[wall].x - start;
        let before = |body: &usize| (way..way + LENGTH).contains(&world.bodies.position[*body].x);
        let grains = (0..world.bodies.len()).filter(|&body| world.is_free(body)).filter(before);
        let (mut mass, mut moment) = (0.0, 0.0);
        for body in grains {
            mass += world.bodies.mass[body];
            moment += world.bodies.mass[body] * world.bodies.position[body].z;
        }
        let height = 2.0 * moment / mass;
        if WINDOW.contains(&(way / height)) {
            let wrench = report.wrenches.iter().find(|wrench| wrench.body.index() == wall);
            let force = wrench.map_or(0.0, |wrench| -wrench.force.x);
            sum += force / (SPHERES_ACROSS * PITCH) / (G * moment / (LENGTH * SPHERES_ACROSS * PITCH));
            count += 1.0;
        }
    }
    Ok(sum / count)
}
