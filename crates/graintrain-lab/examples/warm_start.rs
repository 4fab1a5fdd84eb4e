//! What starting from the impulses of persistent contacts saves in a run: each step's problem solved twice.
//!
//! `cargo run --release -p graintrain-lab --example warm_start -- SCENE STEPS TOLERANCE [SOLVER...] [KEY=VALUE...]`
//!
//! Every step is made with the impulses that its contacts had in the last one; then the same problem is
//! solved again from zero impulses by every solver named, and from the same warm start. Means over blocks of
//! steps.

use graintrain::ccp::{Ccp, Delassus, SolveSettings, SolverSpec};
use graintrain::stepper::Stepper;
use graintrain_io::scene::Scene;
use std::collections::HashMap;
use std::error::Error;

/// Impulses in world axes by the identity of the contact.
fn world_impulses(problem: &Ccp, impulse: &[f64]) -> HashMap<u64, [f64; 3]> {
    let Delassus::Rigid(rigid) = &*problem.delassus else { return HashMap::new() };
    let world = |i: usize| {
        let frame = &rigid.contacts()[i].frame;
        std::array::from_fn(|axis| (0..3).map(|row| frame[row][axis] * impulse[3 * i + row]).sum())
    };
    problem.identity.iter().enumerate().map(|(i, &identity)| (identity, world(i))).collect()
}

/// Those impulses in the frames of a problem's contacts, zero at new ones: what a step of the program starts
/// from.
fn warm_start(problem: &Ccp, before: &HashMap<u64, [f64; 3]>) -> Vec<f64> {
    let Delassus::Rigid(rigid) = &*problem.delassus else { return Vec::new() };
    let contacts = problem.identity.iter().zip(rigid.contacts()).enumerate();
    contacts
        .flat_map(|(i, (identity, contact))| {
            let world = before.get(identity).copied().unwrap_or_default();
            let turned = contact.frame.map(|row| (0..3).map(|axis| row[axis] * world[axis]).sum());
            problem.cone(i).project(turned)
        })
        .collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let (settings, arguments): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|argument| argument.contains('='));
    let mut arguments = arguments.into_iter();
    let scene = arguments.next().unwrap_or("sedimentation".to_string());
    let steps: usize = arguments.next().map_or(Ok(160), |text| text.parse())?;
    let tolerance: f64 = arguments.next().map_or(Ok(1e-3), |text| text.parse())?;
    let names: Vec<String> = arguments.collect();
    let names = if names.is_empty() { vec!["apgd".to_string()] } else { names };
    let specs = names.iter().map(|name| name.parse()).collect::<Result<Vec<SolverSpec>, _>>()?;

    let mut settings =
        settings.iter().map(|text| graintrain_io::scene::setting(text)).collect::<Result<Vec<_>, _>>()?;
    settings.push(("solver.name".to_string(), "apgd".to_string()));
    settings.push(("solver.tolerance".to_string(), format!("{tolerance:e}")));
    let simulation = Scene::load(&scene, &settings)?.build()?;
    let mut world = simulation.world;
    let mut stepper = Stepper::new(simulation.settings)?;
    let block = (steps / 8).max(1);
    let mut sums = vec![[0.0; 4]; specs.len()];
    let mut start_residual = [0.0; 2];
    println!(
        "steps, contacts, persistent fraction; per solver: iterations warm / cold, of them not converged"
    );
    let (mut contacts, mut persistent) = (0, 0.0);
    for step in 0..steps {
        let before =
            stepper.last_problem().map_or_else(HashMap::new, |(last, impulse)| world_impulses(last, impulse));
        stepper.step(&mut world)?;
        let Some((problem, _)) = stepper.last_problem() else { continue };
        contacts += problem.num_contacts();
        persistent += problem.identity.iter().filter(|identity| before.contains_key(identity)).count() as f64;
        let warm = warm_start(problem, &before);
        for (sum, start) in start_residual.iter_mut().zip([&warm, &vec![0.0; warm.len()]]) {
            let look = SolveSettings { tolerance, max_iterations: Some(0), ..SolveSettings::default() };
            let report = specs[0].build()?.solve(problem, &mut start.clone(), &look)?;
            *sum += report.residual.rms;
        }
        for (spec, sums) in specs.iter().zip(&mut sums) {
            for (k, start) in [warm.clone(), vec![0.0; warm.len()]].into_iter().enumerate() {
                let mut impulse = start;
                let solve = SolveSettings { tolerance, ..SolveSettings::default() };
                let report = spec.build()?.solve(problem, &mut impulse, &solve)?;
                sums[k] += report.iterations as f64;
                sums[2 + k] += f64::from(u8::from(!report.converged()));
            }
        }
        if (step + 1) % block == 0 {
            let count = block as f64;
            print!(
                "{:4}..{:<4} {:7.0} {:5.2}",
                step + 1 - block,
                step + 1,
                contacts as f64 / count,
                persistent / contacts.max(1) as f64
            );
            for (name, sums) in names.iter().zip(&mut sums) {
                let [warm, cold, warm_failed, cold_failed] = *sums;
                print!("   {name}: {:.0} / {:.0}, {warm_failed} / {cold_failed}", warm / count, cold / count);
                *sums = [0.0; 4];
            }
            let [warm, cold] = start_residual.map(|sum| sum / count);
            print!("   rms residual of the start {warm:.1e} / {cold:.1e}");
            start_residual = [0.0; 2];
            println!();
            (contacts, persistent) = (0, 0.0);
        }
    }
    Ok(())
}
