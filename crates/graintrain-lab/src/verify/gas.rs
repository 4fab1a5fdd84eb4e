//! Momentum and energy of many spheres: A17, A18, A28.

use super::bench::{Accuracy, Bench, add_ground, add_plane, add_sphere, add_walls, random, world};
use super::source::{MOREAU, Source};
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::math::Vec3;
use graintrain::world::World;

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A17",
        title: "Ledger of momentum and energy",
        setup: "27 spheres with mu = 0.4 and e = 0.3 fall into a box, 400 steps of 2 ms.",
        sources: &[Source::Algebra(
            "m (v+ - v-) = h f + D g body by body, and the kinetic energy changes by (v+ + v-) / 2 . (h f + D g)",
        )],
        measure: Measure::Small(ledger),
    },
    Definition {
        id: "A18",
        title: "Inelastic gas",
        setup: "64 spheres without friction and with e = 0 fly towards each other without gravity, 600 steps of 1 ms.",
        sources: &[Source::Algebra("energy never rises, momentum and angular momentum stay"), MOREAU],
        measure: Measure::Small(inelastic),
    },
    Definition {
        id: "A28",
        title: "Elastic gas",
        setup: "27 spheres without friction and with e = 1 fly at about 1 m/s in a closed box without gravity, 2000 steps of 1 ms.",
        sources: &[Source::Algebra("impacts with e = 1 keep the energy"), MOREAU],
        measure: Measure::Small(elastic),
    },
];

/// A cube of spheres of radius 0.1 about a point, each moved by up to `jitter`.
fn cube(
    world: &mut World,
    side: i32,
    pitch: f64,
    centre: Vec3,
    mut jitter: impl FnMut() -> Vec3,
) -> Result<Vec<usize>, VerifyError> {
    let mut balls = Vec::new();
    let middle = 0.5 * f64::from(side - 1);
    for k in 0..side.pow(3) {
        let place = [k % side, k / side % side, k / (side * side)].map(|i| f64::from(i) - middle);
        balls.push(add_sphere(world, 0.1, centre + pitch * Vec3::from_array(place) + jitter())?);
    }
    Ok(balls)
}

fn ledger() -> Result<Vec<Row>, VerifyError> {
    let step = 2e-3;
    let mut rows = Vec::new();
    for model in MODELS {
        let mut world = world(0.4, 0.3)?;
        add_ground(&mut world, 0.0)?;
        add_walls(&mut world, 0.4)?;
        let mut next = random(5);
        let balls =
            cube(&mut world, 3, 0.24, Vec3::new(0.0, 0.0, 0.5), || 0.01 * Vec3::new(next(), next(), next()))?;
        let mut bench = Bench::new(step, 5e-3, Accuracy::SCENES, model)?;
        let (mut worst_momentum, mut worst_energy): (f64, f64) = (0.0, 0.0);
        for _ in 0..400 {
            let before = world.bodies.clone();
            bench.step(&mut world)?;
            let n = world.bodies.len();
            let (mut impulse, mut moment) = (vec![Vec3::ZERO; n], vec![Vec3::ZERO; n]);
            for (contact, &g) in world.contacts.contacts.iter().zip(&world.contacts.impulse) {
                let [on_a, on_b] = contact.surface_points();
                for (body, sign, point) in
                    [(contact.body_a as usize, 1.0, on_a), (contact.body_b as usize, -1.0, on_b)]
                {
                    impulse[body] += sign * g;
                    moment[body] += (point - before.position[body]).cross(sign * g);
                }
            }
            let (mut change, mut work) = (0.0, 0.0);
            for &body in &balls {
                let (m, i) = (before.mass[body], before.inertia[body].x_axis.x);
                let (u0, w0) = (before.velocity[body], before.angular_velocity[body]);
                let (u, w) = (world.bodies.velocity[body], world.bodies.angular_velocity[body]);
                let pushed = m * step * world.gravity + impulse[body];
                let size = m * (u0.length() + u.length()) + impulse[body].length();
                worst_momentum = worst_momentum.max((m * (u - u0) - pushed).length() / size);
                change += 0.5 * m * (u.length_squared() - u0.length_squared());
                change += 0.5 * i * (w.length_squared() - w0.length_squared());
                work += 0.5 * (u + u0).dot(pushed) + 0.5 * (w + w0).dot(moment[body]);
            }
            // Against the energy of the fall through one radius.
            let scale = world.kinetic_energy() + 27.0 * before.mass[balls[0]] * 0.1 * world.gravity.length();
            worst_energy = worst_energy.max((change - work).abs() / scale);
        }
        rows.push(bench.row("largest defect of a body's momentum, relative (1)", worst_momentum, 0.0, 1e-12));
        rows.push(bench.row("largest defect of the energy, relative (1)", worst_energy, 0.0, 1e-12));
    }
    Ok(rows)
}

/// Momentum and angular momentum.
fn total(world: &World) -> (Vec3, Vec3) {
    let b = &world.bodies;
    (0..b.len()).fold((Vec3::ZERO, Vec3::ZERO), |(p, l), i| {
        let spin = b.inertia[i] * b.angular_velocity[i];
        (p + b.mass[i] * b.velocity[i], l + b.mass[i] * b.position[i].cross(b.velocity[i]) + spin)
    })
}

fn inelastic() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for (model, accuracy) in MODELS.into_iter().flat_map(|m| Accuracy::both(1e-10).map(|a| (m, a))) {
        let mut world = world(0.0, 0.0)?;
        world.gravity = Vec3::ZERO;
        let mut next = random(2);
        let balls = cube(&mut world, 4, 0.3, Vec3::ZERO, || Vec3::ZERO)?;
        for &ball in &balls {
            // Towards the middle, so that the cloud collides many times.
            let place = world.bodies.position[ball] / 0.3;
            world.bodies.velocity[ball] = -place + 0.3 * Vec3::new(next(), next(), next());
        }
        let (momentum, angular) = total(&world);
        let scale = momentum.length() + 64.0 * world.bodies.mass[0];
        let first = world.kinetic_energy();
        let (mut energy, mut rise) = (first, 0.0_f64);
        let mut bench = Bench::new(1e-3, 0.02, accuracy, model)?;
        for _ in 0..600 {
            bench.step(&mut world)?;
            let now = world.kinetic_energy();
            rise = rise.max((now - energy) / first);
            energy = now;
        }
        let (p, l) = total(&world);
        let left = energy / first;
        let what =
            format!("largest rise of the energy in a step over the first energy (1; {left:.3} is left)");
        rows.push(bench.row(what, rise, 0.0, 1e-12));
        rows.push(bench.row("change of momentum, relative (1)", (p - momentum).length() / scale, 0.0, 1e-12));
        let what = "change of angular momentum, relative (1)";
        rows.push(bench.row(what, (l - angular).length() / scale, 0.0, 1e-11));
    }
    Ok(rows)
}

fn elastic() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        let mut world = world(0.0, 1.0)?;
        world.gravity = Vec3::ZERO;
        add_walls(&mut world, 0.6)?;
        add_plane(&mut world, Vec3::new(0.0, 0.0, -0.6), Vec3::Z)?;
        add_plane(&mut world, Vec3::new(0.0, 0.0, 0.6), -Vec3::Z)?;
        let mut next = random(7);
        for ball in cube(&mut world, 3, 0.35, Vec3::ZERO, || Vec3::ZERO)? {
            world.bodies.velocity[ball] = Vec3::new(next(), next(), next());
        }
        let first = world.kinetic_energy();
        let mut bench = Bench::new(1e-3, 0.01, Accuracy::SCENES, model)?;
        let (mut worst, mut impacts, mut lowered, mut overlap) = (0.0_f64, 0, 0, 0.0_f64);
        for _ in 0..2000 {
            let report = bench.step(&mut world)?;
            impacts += report.impacts;
            lowered += report.restitution_lowered;
            overlap = overlap.max(report.penetration_max / 0.1);
            worst = worst.max((world.kinetic_energy() / first - 1.0).abs());
        }
        let what =
            format!("largest change of the energy, relative (1; {impacts} impacts, {lowered} lowered)");
        rows.push(bench.row(what, worst, 0.0, 1e-6));
        rows.push(bench.row("deepest overlap over R (1)", overlap, 0.0, 0.02));
    }
    Ok(rows)
}
