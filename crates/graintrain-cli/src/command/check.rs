//! `graintrain check`: validate a scene without running it.

use crate::error::Failure;
use crate::scene_failure::scene_failure;
use crate::terminal::answer;
use graintrain::assemble::OverlapCorrection;
use graintrain_io::scene::{Scene, SceneError, Simulation, setting};
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
    let mass: f64 = (0..bodies).filter(|&b| !world.is_prescribed(b)).map(|b| world.bodies.mass[b]).sum();
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
        line("packing", format!("{name}: {} of {}", packing.kind(), packing.material));
    }
    for (name, load) in &scene.loads {
        line("load", format!("{name}: {}", load.about()));
    }
    for (name, joint) in &scene.joints {
        line("joint", format!("{name}: {}", joint.about()));
    }
    let end = steps as f64 * settings.step;
    line("time", format!("{steps} steps of {} s, {end:.6} s in all", settings.step));
    let overlap = match settings.overlap {
        OverlapCorrection::Position => "positions (no velocity is made)",
        OverlapCorrection::Velocity => "velocities (-gap / step, as in the paper)",
    };
    line("contacts", format!("envelope {:.4e} m, overlap is removed by {overlap}", settings.envelope));
    let limit =
        settings.max_iterations.map_or(String::new(), |limit| format!(", at most {limit} iterations"));
    let law = match settings.friction {
        graintrain_ccp::FrictionModel::Relaxed => "relaxed",
        graintrain_ccp::FrictionModel::Coulomb => "Coulomb",
    };
    let rule = graintrain_io::run::tolerance_rule(settings.judge);
    line("solver", format!("{} to {:e} {rule}, {law} friction{limit}", settings.solver, settings.tolerance));
    let frames = steps / simulation.output.every;
    line("output", format!("{frames} frames, one in {} steps", simulation.output.every));
    text
}
