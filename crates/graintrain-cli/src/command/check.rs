//! `graintrain check`: validate a scene without running it.

use crate::error::Failure;
use crate::scene_failure::scene_failure;
use crate::terminal::answer;
use graintrain::assemble::OverlapCorrection;
use graintrain_io::scene::{Scene, SceneError, Simulation, setting};
use std::f64::consts::TAU;
use std::process::ExitCode;

/// Validate a scene without running it, and say what would run
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain check sedimentation --set n=4\n  graintrain check mine.toml --resolved"
)]
pub struct Arguments {
    /// Scene file, or name of a built-in scene
    scene: String,
    /// Set a parameter or any key of the scene, e.g. n=8 or solver.tolerance=1e-5
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Print the scene with all defaults made explicit, in SI units
    #[arg(long)]
    resolved: bool,
}

pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let report = check(arguments).map_err(scene_failure)?;
    answer(report)?;
    Ok(ExitCode::SUCCESS)
}

fn check(arguments: &Arguments) -> Result<String, SceneError> {
    let settings = arguments.settings.iter().map(|text| setting(text)).collect::<Result<Vec<_>, _>>()?;
    let scene = Scene::load(&arguments.scene, &settings)?;
    let simulation = scene.build()?;
    if arguments.resolved { simulation.resolved.to_toml() } else { Ok(summary(&scene, &simulation)) }
}

fn summary(scene: &Scene, simulation: &Simulation) -> String {
    let world = &simulation.world;
    let bodies = world.bodies.len();
    let free = (0..bodies).filter(|&body| world.is_free(body)).count();
    let prescribed = (0..bodies).filter(|&body| world.is_prescribed(body)).count();
    let movable = (0..bodies).filter(|&body| !world.is_prescribed(body));
    let mass = movable.fold(0.0, |sum, body| sum + world.bodies.mass[body]);
    let settings = &simulation.settings;
    let steps = simulation.steps;
    let mut text = format!("{}\n", scene.title);
    let mut line = |name: &str, value: String| text += &format!("  {name:<12}{value}\n");
    let parameters: Vec<String> =
        scene.parameters.iter().map(|(name, value)| format!("{name} = {value}")).collect();
    if !parameters.is_empty() {
        line("parameters", parameters.join(", "));
    }
    line(
        "bodies",
        format!(
            "{bodies}: {free} free, {} partly free, {prescribed} prescribed; {mass:.6} kg can move",
            bodies - free - prescribed
        ),
    );
    for (name, packing) in &scene.packings {
        line("packing", format!("{name}: {} of {}", packing.kind(), packing.grains.material));
    }
    for (name, load) in &scene.loads {
        line("load", format!("{name}: {}", load.about()));
    }
    for (name, joint) in &scene.joints {
        line("joint", format!("{name}: {}", joint.about()));
    }
    for stream in &simulation.open_boundaries.streams {
        let limits = [
            stream.count.map(|count| format!("{count} bodies")),
            stream.mass.map(|mass| format!("{mass} kg")),
            stream.end.map(|end| format!("{end} s")),
        ];
        let limits: Vec<String> = limits.into_iter().flatten().collect();
        let until = if limits.is_empty() { "the end".to_string() } else { limits.join(" or ") };
        line("stream", format!("{}: bodies that enter, until {until}", stream.name));
    }
    for outlet in &simulation.open_boundaries.outlets {
        line("outlet", outlet.name.clone());
    }
    for stage in &simulation.stages {
        line("stage", stage.name.clone());
    }
    for (name, _) in &scene.measures {
        line("measure", format!("measures/{name}.csv"));
    }
    let end = steps as f64 * settings.step;
    line("time", format!("{steps} steps of {} s, {end:.6} s in all", settings.step));
    let overlap = match settings.overlap {
        OverlapCorrection::Position => "positions (no velocity is made)",
        OverlapCorrection::Velocity => "velocities (-gap / step, as in the paper)",
    };
    line("contacts", format!("envelope {:.4e} m, overlap is removed by {overlap}", settings.envelope));
    let solver = &settings.solver;
    let limit = solver.max_iterations.map_or(String::new(), |limit| format!(", at most {limit} iterations"));
    let law = match solver.friction {
        graintrain_ccp::FrictionModel::Relaxed => "relaxed",
        graintrain_ccp::FrictionModel::Coulomb => "Coulomb",
    };
    let rule = graintrain_io::run::tolerance_rule(solver.criterion);
    line("solver", format!("{} to {:e} {rule}, {law} friction{limit}", solver.name, solver.step_tolerance()));
    // That of the start, and that of the end where it is none of the others.
    let frames = 1 + steps.div_ceil(simulation.output.every);
    line("output", format!("{frames} frames, one in {} steps", simulation.output.every));
    for doubt in doubts(simulation) {
        line("doubtful", doubt);
    }
    text
}

/// Bodies that sink far into what they stand on, and bounces that the steps do not resolve.
fn elastic_doubts(simulation: &Simulation) -> Vec<String> {
    let (world, step) = (&simulation.world, simulation.settings.step);
    let mut doubts = Vec::new();
    // Per movable body the softest and the stiffest contact that its material makes.
    let (mut deepest, mut shortest) = (0.0_f64, f64::INFINITY);
    for body in (0..world.bodies.len()).filter(|&body| !world.is_prescribed(body)) {
        let own = world.bodies.material[body].index();
        let pairs = (0..world.materials.len()).map(|other| world.materials.pair_elasticity(own, other));
        let (mass, form) = (world.bodies.mass[body], &world.geometries[world.bodies.geometry[body].index()]);
        for pair in pairs.filter(|pair| !pair.is_rigid()) {
            let sunk = mass * world.gravity.length() / pair.stiffness;
            deepest = deepest.max(sunk / form.bounding_radius());
            shortest = shortest.min(TAU * (mass / pair.stiffness).sqrt());
        }
    }
    if deepest > 0.05 {
        doubts.push(format!(
            "a body sinks by {:.0} % of its size into an elastic contact that carries its weight alone: a larger stiffness",
            100.0 * deepest
        ));
    }
    if shortest.is_finite() && step > shortest / 20.0 {
        doubts.push(format!(
            "elastic contacts swing with a period of {shortest:.1e} s, which steps of {step} s do not resolve: what falls on them comes to \
             rest without a bounce"
        ));
    }
    doubts
}

/// What is no mistake and yet seldom meant.
fn doubts(simulation: &Simulation) -> Vec<String> {
    let (world, settings) = (&simulation.world, &simulation.settings);
    let mut doubts = Vec::new();
    let materials = 0..world.materials.len();
    let rough = materials.clone().flat_map(|i| materials.clone().map(move |j| (i, j)));
    let friction = rough.map(|(i, j)| world.materials.pair_friction(i, j)).fold(0.0, f64::max);
    if friction > 1.0 && settings.solver.friction == graintrain_ccp::FrictionModel::Relaxed {
        doubts.push(format!(
            "friction {friction} with the relaxed model, which opens sliding contacts by step * friction * speed: \
             solver.friction = \"coulomb\" does not"
        ));
    }
    let radii = (0..world.bodies.len())
        .filter(|&body| !world.is_prescribed(body))
        .map(|body| world.geometries[world.bodies.geometry[body].index()].bounding_radius());
    let smallest = radii.fold(f64::INFINITY, f64::min);
    let fall = world.gravity.length() * settings.step * settings.step;
    if fall > smallest {
        doubts.push(format!(
            "a body falls by {fall:.2e} m more in each step than in the one before, and the smallest has a radius of {smallest:.2e} m: \
             a shorter time.step"
        ));
    }
    doubts.extend(elastic_doubts(simulation));
    if settings.solver.tolerance > settings.solver.step_tolerance() {
        doubts.push(format!(
            "a tolerance of {:e} saves nothing: steps are solved to {:e}",
            settings.solver.tolerance,
            settings.solver.step_tolerance()
        ));
    }
    if settings.solver.tolerance < 1e-12 {
        doubts.push(format!("a tolerance of {:e} is below what rounding allows", settings.solver.tolerance));
    }
    doubts
}
