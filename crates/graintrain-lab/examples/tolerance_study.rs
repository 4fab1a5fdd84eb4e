//! What a tolerance means: seven small scenes, one step and twenty at tolerances from 1e-1 to 1e-5, beside
//! solves at least 1e4 times tighter. The columns of OUT.csv are named by the functions that fill them;
//! OUT.md has those that a user asks for.
//!
//! `cargo run --release -p graintrain-lab --example tolerance_study -- OUT.csv OUT.md [relaxed|exact]`, both
//! friction models unless one is named.

use graintrain::ccp::{Ccp, Criterion, Delassus, FrictionModel, SolveSettings, SolverSpec, Status};
use graintrain::contact::{Contact, ContactSet};
use graintrain::handle::MaterialId;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};
use graintrain_io::scene::Scene as SceneFile;
use graintrain_lab::verify::bench::{G, add_ground, add_sphere, add_walls, random, world};
use std::error::Error;
use std::fmt::Write as _;
use std::sync::Mutex;
use std::time::Instant;

type Failure = Box<dyn Error + Send + Sync>;

/// Time step, s: |g| dt is 0.098 m/s, |g| dt^2 0.98 mm.
const STEP: f64 = 0.01;

const TOLERANCES: [f64; 5] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5];

/// Those that the page shows: what built-in scenes ask for, and the default.
const SHOWN: [f64; 2] = [1e-3, 1e-4];

/// Of what the others are compared with.
const REFERENCE: f64 = 1e-9;

/// Iterations of a solve with exact friction.
const LIMIT: usize = 30_000;

/// Steps of a run.
const RUN: usize = 20;

/// A scene; the floor is body 0.
struct Scene {
    name: &'static str,
    world: World,
    press: Option<usize>,
    smallest: f64,
    steps: usize,
}

/// Adds `count` bodies on a lattice of `pitch` from height `base` on, with jitter of a twentieth of the
/// pitch.
fn lattice(
    world: &mut World,
    count: [usize; 3],
    pitch: f64,
    base: f64,
    mut add: impl FnMut(&mut World, Vec3, usize) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let mut next = random(5);
    for k in 0..count[0] * count[1] * count[2] {
        let [i, j, l] = [k % count[0], k / count[0] % count[1], k / (count[0] * count[1])];
        let middle = |i: usize, n: usize| (i as f64 - 0.5 * (n - 1) as f64) * pitch;
        let place = Vec3::new(middle(i, count[0]), middle(j, count[1]), base + pitch * l as f64);
        add(world, place + 0.05 * pitch * Vec3::new(next(), next(), next()), k)?;
    }
    Ok(())
}

fn container(friction: f64, half: f64) -> Result<World, Failure> {
    let mut world = world(friction, 0.0)?;
    add_ground(&mut world, 0.0)?;
    add_walls(&mut world, half)?;
    Ok(world)
}

fn scale_mass(world: &mut World, body: usize, factor: f64) {
    world.bodies.mass[body] *= factor;
    world.bodies.inertia[body] *= factor;
}

fn equal() -> Result<Scene, Failure> {
    let radius = 0.05;
    let mut world = container(0.3, 0.27)?;
    lattice(&mut world, [4, 4, 9], 2.5 * radius, 0.07, |world, place, _| {
        add_sphere(world, radius, place)?;
        Ok(())
    })?;
    Ok(Scene { name: "equal spheres", world, press: None, smallest: radius, steps: 400 })
}

/// The common drop, its mixer at rest.
fn drop() -> Result<Scene, Failure> {
    let set = [("n", "4"), ("tip_speed", "0 m/s")].map(|(key, value)| (key.to_string(), value.to_string()));
    let world = SceneFile::load("sedimentation", &set)?.build()?.world;
    Ok(Scene { name: "settled drop", world, press: None, smallest: 0.1, steps: 300 })
}

fn masses() -> Result<Scene, Failure> {
    let radius = 0.05;
    let mut world = container(0.3, 0.27)?;
    let mut next = random(8);
    lattice(&mut world, [4, 4, 5], 2.5 * radius, 0.07, |world, place, _| {
        let body = add_sphere(world, radius, place)?;
        scale_mass(world, body, 10.0_f64.powf(3.0 + 3.0 * next()));
        Ok(())
    })?;
    Ok(Scene { name: "masses 1 to 1e6", world, press: None, smallest: radius, steps: 400 })
}

fn sizes() -> Result<Scene, Failure> {
    let small = 0.01;
    let mut world = world(0.3, 0.0)?;
    add_ground(&mut world, 0.0)?;
    let fixed = world.add_motion(Motion::fixed())?;
    // A tray, so that the largest sphere stands on the small ones and not on walls.
    for (along, place) in [(0, Vec3::X), (0, -Vec3::X), (1, Vec3::Y), (1, -Vec3::Y)] {
        let half = if along == 0 { Vec3::new(0.02, 0.2, 0.02) } else { Vec3::new(0.2, 0.02, 0.02) };
        let wall = world.add_geometry(Geometry::cuboid(half)?);
        world.add_body(Body {
            motion: fixed,
            ..Body::new(wall, MaterialId::default(), 0.17 * place + Vec3::new(0.0, 0.0, 0.02))
        })?;
    }
    lattice(&mut world, [12, 12, 1], 2.4 * small, 0.012, |world, place, _| {
        add_sphere(world, small, place)?;
        Ok(())
    })?;
    add_sphere(&mut world, 0.3, Vec3::new(0.0, 0.0, 0.37))?;
    for (x, y) in [(0.1, 0.1), (-0.1, 0.1), (0.1, -0.1), (-0.1, -0.1)] {
        add_sphere(&mut world, 0.03, Vec3::new(x, y, 0.07))?;
    }
    Ok(Scene { name: "radii 1 to 30", world, press: None, smallest: small, steps: 400 })
}

fn column() -> Result<Scene, Failure> {
    let radius = 0.05;
    let mut world = world(0.3, 0.0)?;
    add_ground(&mut world, 0.0)?;
    for k in 0..50 {
        add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, radius * f64::from(2 * k + 1)))?;
    }
    Ok(Scene { name: "column of 50", world, press: None, smallest: radius, steps: 30 })
}

fn pressed() -> Result<Scene, Failure> {
    let radius: f64 = 0.03;
    let mut world = container(0.3, 0.16)?;
    lattice(&mut world, [4, 4, 6], 2.5 * radius, 0.04, |world, place, _| {
        let body = add_sphere(world, radius, place)?;
        let factor = 0.1 / world.bodies.mass[body];
        scale_mass(world, body, factor);
        Ok(())
    })?;
    let plate = world.add_geometry(Geometry::cuboid(Vec3::new(0.15, 0.15, 0.02))?);
    let sinking = world.add_motion(Motion::fixed().with_free([false, false, true, false, false, false]))?;
    let body = Body { motion: sinking, ..Body::new(plate, MaterialId::default(), Vec3::new(0.0, 0.0, 0.7)) };
    let press = world.add_body(body)?.index();
    let factor = 50.0 / world.bodies.mass[press];
    scale_mass(&mut world, press, factor);
    Ok(Scene { name: "50 kg on 0.1 kg", world, press: Some(press), smallest: radius, steps: 400 })
}

fn shapes() -> Result<Scene, Failure> {
    let mut world = container(0.3, 0.27)?;
    let kinds = [
        Geometry::cuboid(Vec3::new(0.05, 0.04, 0.03))?,
        Geometry::capsule(0.03, 0.03)?,
        Geometry::cylinder(0.04, 0.04)?,
        Geometry::sphere(0.045)?,
    ]
    .map(|geometry| world.add_geometry(geometry));
    let mut next = random(12);
    lattice(&mut world, [4, 4, 5], 0.132, 0.08, |world, place, k| {
        let turn = Vec3::new(next(), next(), next()) * 3.0;
        let orientation = Quat::from_scaled_axis(turn);
        world.add_body(Body {
            orientation,
            ..Body::new(kinds[(k + k / 16) % 4], MaterialId::default(), place)
        })?;
        Ok(())
    })?;
    Ok(Scene { name: "mixed shapes", world, press: None, smallest: 0.03, steps: 400 })
}

fn stepper(scene: &Scene, tolerance: f64, friction: FrictionModel) -> Result<Stepper, Failure> {
    Ok(Stepper::new(StepSettings {
        step: STEP,
        envelope: 0.3 * scene.smallest,
        solver: SolverChoice {
            tolerance,
            criterion: Criterion::Mixed,
            friction,
            max_iterations: (friction == FrictionModel::Coulomb).then_some(LIMIT),
            ..SolverChoice::default()
        },
        ..StepSettings::default()
    })?)
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn rms_and_largest(values: &[f64]) -> [f64; 2] {
    [norm(values) / (values.len().max(1) as f64).sqrt(), values.iter().copied().fold(0.0, f64::max)]
}

/// Over |g| dt, of every body that moves: the speed whose kinetic energy is that of the difference `dv` (6
/// numbers per body).
fn velocity_errors(world: &World, dv: &[f64]) -> Vec<f64> {
    let moves = (0..world.bodies.len()).filter(|&body| !world.is_prescribed(body));
    moves
        .map(|body| {
            let [u, w] = [0, 3].map(|k| Vec3::from_slice(&dv[6 * body + k..6 * body + k + 3]));
            let w = world.bodies.orientation[body].inverse() * w;
            let turning = w.dot(world.bodies.inertia[body] * w) / world.bodies.mass[body];
            (u.length_squared() + turning).sqrt() / (G * STEP)
        })
        .collect()
}

/// Impulses in world axes, and the velocities that they make.
fn impulses_and_velocities(problem: &Ccp, g: &[f64]) -> Result<(Vec<Vec3>, Vec<f64>), Failure> {
    let Delassus::Rigid(rigid) = &*problem.delassus else { return Err("not a rigid problem".into()) };
    let mut impulse = vec![0.0; g.len()];
    rigid.world_impulse(g, &mut impulse);
    let mut velocity = vec![0.0; 6 * rigid.num_bodies()];
    rigid.velocity_change(&impulse, &mut velocity);
    Ok((impulse.chunks_exact(3).map(Vec3::from_slice).collect(), velocity))
}

/// Force on a body, N.
fn force_on(set: &ContactSet, impulse: &[Vec3], body: usize) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for (contact, &g) in set.contacts.iter().zip(impulse) {
        if contact.body_a as usize == body {
            sum += g;
        } else if contact.body_b as usize == body {
            sum -= g;
        }
    }
    sum / STEP
}

/// Vertical force on all that is fixed, N.
fn carried(world: &World, impulse: &[Vec3]) -> f64 {
    let fixed = (0..world.bodies.len()).filter(|&body| world.is_prescribed(body));
    fixed.map(|body| force_on(&world.contacts, impulse, body).z).sum()
}

/// Distance of the sums of force times branch over all contacts, relative to the right one: the error of the
/// mean stress of the sample. Branches go from centre to centre, or to the contact on what is fixed.
fn stress_error(world: &World, contacts: &[Contact], found: &[Vec3], right: &[Vec3]) -> f64 {
    let stress = |impulse: &[Vec3]| {
        let mut sum = [Vec3::ZERO; 3];
        for (contact, &g) in contacts.iter().zip(impulse) {
            let [a, b] = [contact.body_a, contact.body_b].map(|body| match body as usize {
                body if world.is_prescribed(body) => contact.point,
                body => world.bodies.position[body],
            });
            let branch = (b - a).to_array();
            sum.iter_mut().zip(branch).for_each(|(row, x)| *row += x * g);
        }
        sum.map(|row| row.to_array()).concat()
    };
    let (found, right) = (stress(found), stress(right));
    let difference: Vec<f64> = found.iter().zip(&right).map(|(a, b)| a - b).collect();
    norm(&difference) / norm(&right)
}

/// Relative differences of the forces of contacts with more than a thousandth of the mean force: root of the
/// sum of squares over that of `right`, and the median of the differences over the contact's own force.
fn force_errors(found: &[Vec3], right: &[Vec3]) -> [f64; 2] {
    let mean = right.iter().map(|g| g.length()).sum::<f64>() / right.len().max(1) as f64;
    let pairs = found.iter().zip(right).filter(|(_, right)| right.length() > 1e-3 * mean);
    let pairs: Vec<[f64; 2]> = pairs.map(|(a, b)| [(*a - *b).length(), b.length()]).collect();
    let [wrong, all] = [0, 1].map(|k| norm(&pairs.iter().map(|pair| pair[k]).collect::<Vec<_>>()));
    let mut own: Vec<f64> = pairs.iter().map(|[difference, force]| difference / force).collect();
    own.sort_by(f64::total_cmp);
    [wrong / all, own.get(own.len() / 2).copied().unwrap_or(0.0)]
}

/// What the table says of a scene, a friction model and a tolerance.
#[derive(Default)]
struct Row {
    scene: &'static str,
    model: &'static str,
    tolerance: f64,
    bodies: usize,
    contacts: usize,
    status: &'static str,
    residual: [f64; 2],
    /// Residual of the solve that it is compared with.
    reference: f64,
    iterations: usize,
    velocity: [f64; 2],
    overlap: f64,
    /// Relative errors of vertical forces.
    floor: f64,
    press: Option<f64>,
    /// Vertical force on everything that is fixed.
    carried: f64,
    /// Relative error of the mean stress.
    stress: f64,
    forces: [f64; 2],
    /// Forces and velocities of the tight solve from here against those of a tight solve by `auto` from zero.
    other_forces: f64,
    other_floor: f64,
    other_velocity: f64,
    run_iterations: f64,
    run_unsolved: usize,
    run_velocity: [f64; 2],
    run_overlap: f64,
    run_deepest: f64,
    run_floor: f64,
    run_carried: f64,
    run_press: Option<f64>,
    run_forces: f64,
    run_moved: f64,
}

/// A step of a run.
struct Moment {
    floor: f64,
    carried: f64,
    press: f64,
    overlap: f64,
    /// Deepest overlap over the smaller body's size.
    deepest: f64,
    iterations: usize,
    solved: bool,
}

/// Steps from a state whose impulses are forgotten.
fn run(scene: &Scene, tolerance: f64, friction: FrictionModel) -> Result<(World, Vec<Moment>), Failure> {
    let mut world = scene.world.clone();
    world.contacts = ContactSet::default();
    let mut stepper = stepper(scene, tolerance, friction)?;
    let mut moments = Vec::new();
    for _ in 0..RUN {
        let report = stepper.step(&mut world)?;
        let on = |body: usize| force_on(&world.contacts, &world.contacts.impulse, body).z;
        moments.push(Moment {
            floor: on(0),
            carried: carried(&world, &world.contacts.impulse),
            press: scene.press.map_or(0.0, on),
            overlap: report.errors.overlap_per_step_max_over_size,
            deepest: report.penetration_max_over_size,
            iterations: report.solve.iterations,
            solved: report.solve.residual.measured(Criterion::Mixed) <= 1.1 * tolerance,
        });
    }
    Ok((world, moments))
}

fn compare_runs(
    scene: &Scene,
    row: &mut Row,
    friction: FrictionModel,
    right: &(World, Vec<Moment>),
) -> Result<(), Failure> {
    let (world, moments) = run(scene, row.tolerance, friction)?;
    let largest = |of: &dyn Fn(&Moment, &Moment) -> f64| {
        moments.iter().zip(&right.1).map(|(a, b)| of(a, b)).fold(0.0, f64::max)
    };
    row.run_iterations = moments.iter().map(|m| m.iterations).sum::<usize>() as f64 / RUN as f64;
    row.run_unsolved = moments.iter().filter(|m| !m.solved).count();
    row.run_overlap = largest(&|a, _| a.overlap);
    row.run_deepest = largest(&|a, _| a.deepest);
    row.run_floor = largest(&|a, b| (a.floor / b.floor - 1.0).abs());
    row.run_carried = largest(&|a, b| (a.carried / b.carried - 1.0).abs());
    row.run_press = scene.press.map(|_| largest(&|a, b| (a.press / b.press - 1.0).abs()));
    let both = |k: usize| {
        let [a, b] = [&world.bodies, &right.0.bodies];
        [a.velocity[k] - b.velocity[k], a.angular_velocity[k] - b.angular_velocity[k]]
    };
    let dv: Vec<f64> = (0..world.bodies.len()).flat_map(both).flat_map(|v| v.to_array()).collect();
    row.run_velocity = rms_and_largest(&velocity_errors(&world, &dv));
    let paths = world.bodies.position.iter().zip(&right.0.bodies.position);
    row.run_moved = paths.map(|(a, b)| (*a - *b).length()).fold(0.0, f64::max) / scene.smallest;
    // Contacts that both runs have in their last step.
    let known = &right.0.contacts;
    let same = world.contacts.contacts.iter().zip(&world.contacts.impulse).filter_map(|(contact, &g)| {
        let k = known.contacts.iter().position(|other| other.identity == contact.identity)?;
        Some((g, known.impulse[k]))
    });
    let (found, right): (Vec<Vec3>, Vec<Vec3>) = same.unzip();
    row.run_forces = force_errors(&found, &right)[0];
    Ok(())
}

fn settle(scene: &mut Scene) -> Result<(), Failure> {
    let begin = Instant::now();
    for (tolerance, steps) in [(1e-4, scene.steps), (1e-6, 40)] {
        let mut stepper = stepper(scene, tolerance, FrictionModel::Relaxed)?;
        for _ in 0..steps {
            stepper.step(&mut scene.world)?;
        }
    }
    let fastest = scene.world.bodies.velocity.iter().map(|u| u.length()).fold(0.0, f64::max);
    let (name, contacts) = (scene.name, scene.world.contacts.contacts.len());
    let seconds = begin.elapsed().as_secs_f64();
    eprintln!("{name}: settled in {seconds:.1} s, {contacts} contacts, fastest {fastest:.1e} m/s");
    Ok(())
}

fn study(scene: &mut Scene, friction: FrictionModel, model: &'static str) -> Result<Vec<Row>, Failure> {
    let begin = Instant::now();
    let mut settle = stepper(scene, 1e-7, friction)?;
    let mut world = scene.world.clone();
    for _ in 0..20 {
        settle.step(&mut world)?;
    }
    scene.world = world;
    let mut rows = Vec::new();
    let mut solutions = Vec::new();
    let mut another = (Vec::new(), Vec::new());
    let mut last = World::clone(&scene.world);
    for tolerance in TOLERANCES {
        let mut world = scene.world.clone();
        world.contacts = ContactSet::default();
        let mut stepper = stepper(scene, tolerance, friction)?;
        let report = stepper.step(&mut world)?;
        let (problem, found) = stepper.last_problem().ok_or("no problem")?;
        let mut right = found.to_vec();
        let settings = SolveSettings {
            tolerance: REFERENCE,
            criterion: Criterion::Mixed,
            friction,
            max_iterations: Some(if friction == FrictionModel::Coulomb { LIMIT } else { 5 * LIMIT }),
            ..SolveSettings::default()
        };
        // Gradients from where the solve ended; `auto` would begin with another method.
        let tight = "apgd".parse::<SolverSpec>()?.build()?.solve(problem, &mut right, &settings)?;
        if solutions.is_empty() {
            let mut other = vec![0.0; right.len()];
            SolverSpec::default().build()?.solve(problem, &mut other, &settings)?;
            another = impulses_and_velocities(problem, &other)?;
        }
        let (found, velocity) = impulses_and_velocities(problem, found)?;
        let (right, right_velocity) = impulses_and_velocities(problem, &right)?;
        if found.len() != world.contacts.contacts.len() {
            return Err("contacts of the problem are not those of the step".into());
        }
        let dv: Vec<f64> = velocity.iter().zip(&right_velocity).map(|(a, b)| a - b).collect();
        let on = |body: usize| {
            let [a, b] = [&found, &right].map(|g| force_on(&world.contacts, g, body));
            (a.z / b.z - 1.0).abs()
        };
        rows.push(Row {
            scene: scene.name,
            model,
            tolerance,
            bodies: (0..world.bodies.len()).filter(|&body| !world.is_prescribed(body)).count(),
            contacts: found.len(),
            status: if report.solve.status == Status::Converged { "converged" } else { "unconverged" },
            residual: [report.solve.residual.rms, report.solve.residual.max],
            reference: tight.residual.measured(Criterion::Mixed),
            iterations: report.solve.iterations,
            velocity: rms_and_largest(&velocity_errors(&world, &dv)),
            overlap: report.errors.overlap_per_step_max_over_size.max(0.0),
            floor: on(0),
            press: scene.press.map(on),
            carried: {
                let [a, b] = [&found, &right].map(|g| carried(&world, g));
                (a / b - 1.0).abs()
            },
            stress: stress_error(&scene.world, &world.contacts.contacts, &found, &right),
            forces: force_errors(&found, &right),
            ..Row::default()
        });
        solutions.push((right, right_velocity));
        last = world;
    }
    let (forces, velocity) = &another;
    for (row, (other, other_velocity)) in rows.iter_mut().zip(&solutions) {
        row.other_forces = force_errors(other, forces)[0];
        let floors = [other, forces].map(|g| force_on(&last.contacts, g, 0));
        row.other_floor = (floors[0].z / floors[1].z - 1.0).abs();
        let dv: Vec<f64> = other_velocity.iter().zip(velocity).map(|(a, b)| a - b).collect();
        row.other_velocity = rms_and_largest(&velocity_errors(&scene.world, &dv))[0];
    }
    eprintln!("{} {model}: single steps after {:.1} s", scene.name, begin.elapsed().as_secs_f64());
    let right = run(scene, REFERENCE, friction)?;
    let unconverged = right.1.iter().filter(|moment| !moment.solved).count();
    eprintln!(
        "{} {model}: tight run after {:.1} s, {unconverged} unconverged",
        scene.name,
        begin.elapsed().as_secs_f64()
    );
    for row in &mut rows {
        compare_runs(scene, row, friction, &right)?;
    }
    eprintln!("{} {model}: done after {:.1} s", scene.name, begin.elapsed().as_secs_f64());
    Ok(rows)
}

fn csv(rows: &[(usize, Row)]) -> String {
    let mut text = String::from(
        "scene,friction,tolerance,bodies,contacts,status,residual_rms,residual_max,reference_residual,iterations,velocity_rms,\
         velocity_max,overlap_per_step_over_size,floor_force,carried_force,press_force,stress,contact_forces_rms,contact_forces_median,\
         other_solution_forces,other_solution_floor,other_solution_velocity,run_iterations_per_step,run_unsolved,run_velocity_rms,run_velocity_max,\
         run_overlap_per_step_over_size,run_deepest_over_size,run_floor_force,run_carried_force,run_press_force,run_contact_forces_rms,run_moved_over_smallest\n",
    );
    for (_, row) in rows {
        let _ = write!(
            text,
            "{},{},{:e},{},{},{}",
            row.scene, row.model, row.tolerance, row.bodies, row.contacts, row.status
        );
        let _ = write!(
            text,
            ",{:.3e},{:.3e},{:.1e},{}",
            row.residual[0], row.residual[1], row.reference, row.iterations
        );
        let number = |x: f64| format!("{x:.3e}");
        let optional = |x: Option<f64>| x.map_or(String::new(), number);
        let columns = [
            number(row.velocity[0]),
            number(row.velocity[1]),
            number(row.overlap),
            number(row.floor),
            number(row.carried),
            optional(row.press),
            number(row.stress),
            number(row.forces[0]),
            number(row.forces[1]),
            number(row.other_forces),
            number(row.other_floor),
            number(row.other_velocity),
            format!("{:.1}", row.run_iterations),
            row.run_unsolved.to_string(),
            number(row.run_velocity[0]),
            number(row.run_velocity[1]),
            number(row.run_overlap.max(0.0)),
            number(row.run_deepest),
            number(row.run_floor),
            number(row.run_carried),
            optional(row.run_press),
            number(row.run_forces),
            number(row.run_moved),
        ];
        let _ = writeln!(text, ",{}", columns.join(","));
    }
    text
}

fn markdown(rows: &[(usize, Row)]) -> String {
    let mut text = String::from(
        "| scene | friction | tolerance | overlap / R | kinetic noise | weight carried | floor | press | mean stress | contact forces | two solutions: floor | contact forces | iterations |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    let share = |x: f64| match 100.0 * x {
        x if x < 1e-3 => "< 0.001 %".to_string(),
        x if x < 0.1 => format!("{x:.3} %"),
        x if x < 10.0 => format!("{x:.2} %"),
        x => format!("{x:.0} %"),
    };
    for (_, row) in rows.iter().filter(|(_, row)| SHOWN.contains(&row.tolerance)) {
        let mark = if row.status == "converged" { "" } else { " (unconverged)" };
        let _ = writeln!(
            text,
            "| {} | {} | {:.0e}{mark} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            row.scene,
            row.model,
            row.tolerance,
            share(row.run_deepest),
            share(row.velocity[0]),
            share(row.carried),
            share(row.floor),
            row.press.map_or("-".to_string(), share),
            share(row.stress),
            share(row.forces[0]),
            share(row.other_floor),
            share(row.other_forces),
            row.iterations,
        );
    }
    text
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let models = [(FrictionModel::Relaxed, "relaxed"), (FrictionModel::Coulomb, "exact")];
    let (table, page, only) = match arguments.as_slice() {
        [table, page] => (table, page, None),
        [table, page, only] if models.iter().any(|(_, name)| name == only) => {
            (table, page, Some(only.as_str()))
        }
        _ => return Err("usage: tolerance_study OUT.csv OUT.md [relaxed|exact]".into()),
    };
    let done = Mutex::new(Vec::new());
    let scenes = [drop, equal, masses, sizes, column, pressed, shapes];
    std::thread::scope(|scope| -> Result<(), Failure> {
        let done = &done;
        let write = move |order: usize, rows: Vec<Row>| -> Result<(), Failure> {
            let mut done = done.lock().map_err(|_| "another scene failed")?;
            done.extend(rows.into_iter().map(|row| (order, row)));
            done.sort_by_key(|(order, _)| *order);
            std::fs::write(table, csv(&done))?;
            Ok(std::fs::write(page, markdown(&done))?)
        };
        let threads: Vec<_> = (scenes.iter().enumerate())
            .map(|(k, make)| {
                scope.spawn(move || -> Result<(), Failure> {
                    let mut scene = make()?;
                    settle(&mut scene)?;
                    let settled = scene.world.clone();
                    for (j, (friction, name)) in models.into_iter().enumerate() {
                        if only.is_none_or(|only| only == name) {
                            scene.world = settled.clone();
                            write(2 * k + j, study(&mut scene, friction, name)?)?;
                        }
                    }
                    Ok(())
                })
            })
            .collect();
        threads.into_iter().try_for_each(|thread| thread.join().map_err(|_| "a scene panicked")?)
    })
}
