//! Impacts: A7, A8, A9, A20.

use crate::support::*;
use graintrain::ccp::FrictionModel;
use graintrain::ccp::FrictionModel::{Coulomb, Relaxed};
use graintrain::handle::{BodyId, MaterialId};
use graintrain::joint::{Joint, Motor};
use graintrain::load::{Action, Load};
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::world::Body;

/// A sphere that hits a plane at unit speed, `angle` from the normal, in one step without gravity: tangential
/// velocity, R omega, rebound velocity.
fn oblique(angle: f64, friction: f64, restitution: f64, model: FrictionModel) -> [f64; 3] {
    let radius = 0.1;
    let mut world = world(friction, restitution);
    world.gravity = Vec3::ZERO;
    add_ground(&mut world, 0.0);
    let ball = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, radius));
    world.bodies.velocity[ball] = Vec3::new(angle.sin(), 0.0, -angle.cos());
    solved_step(&mut stepper(1e-3, 1e-3, 1e-11, model), &mut world);
    let u = world.bodies.velocity[ball];
    [u.x, radius * world.bodies.angular_velocity[ball].y, u.z]
}

/// A7, table: e = 0 in both friction models.
#[test]
fn a07_oblique_impact_table() {
    let rows = [
        (45.0, 0.10, [0.6364, 0.1768, 0.0], [0.6320, 0.1879, 0.0444]),
        (60.0, 0.25, [0.7410, 0.3125, 0.0], [0.7190, 0.3674, 0.0879]),
        (75.0, 0.25, [0.9012, 0.1618, 0.0], [0.8633, 0.2566, 0.1517]),
        (75.0, 0.50, [0.8365, 0.3235, 0.0], [0.7681, 0.4945, 0.1368]),
    ];
    for (angle, friction, exact, relaxed) in rows {
        for (model, expected) in [(Coulomb, exact), (Relaxed, relaxed)] {
            let got = oblique(f64::to_radians(angle), friction, 0.0, model);
            for k in 0..3 {
                assert_close(
                    got[k],
                    expected[k],
                    6e-5,
                    &format!("{angle} deg, mu {friction}, {model:?}, {k}"),
                );
            }
        }
    }
}

/// A7, closed form, with restitution: sticking gives 5/7 of the tangential velocity; sliding leaves the slip
/// s' = s - 3.5 mu (1 + e) v_n, relaxed s' / (1 + 3.5 mu^2) with rebound e v_n + mu s'.
#[test]
fn a07_oblique_impact_closed_form() {
    let mut worst: f64 = 0.0;
    for angle in [10.0_f64, 30.0, 45.0, 60.0, 75.0, 85.0] {
        let angle = angle.to_radians();
        let (tangential, normal) = (angle.sin(), angle.cos());
        for friction in [0.0, 0.05, 0.25, 0.5, 1.0] {
            for restitution in [0.0, 0.3, 0.9] {
                let slip = tangential - 3.5 * friction * (1.0 + restitution) * normal;
                for model in BOTH {
                    let [u, spin, rebound] = oblique(angle, friction, restitution, model);
                    let (left, up) = if slip <= 0.0 {
                        (0.0, restitution * normal)
                    } else if model == Coulomb {
                        (slip, restitution * normal)
                    } else {
                        let left = slip / (1.0 + 3.5 * friction * friction);
                        (left, restitution * normal + friction * left)
                    };
                    worst = worst.max((u - spin - left).abs()).max((rebound - up).abs());
                    // Angular momentum about the contact point is kept: u + 2/5 R omega.
                    worst = worst.max((u + 0.4 * spin - tangential).abs());
                }
            }
        }
    }
    println!("A7: largest error {worst:.1e} m/s");
    assert!(worst < 1e-6);
}

/// Two balls that meet off their centres part along the normal of the moment at which they touch, whenever in
/// a step that is; with friction they leave with the same velocities and spins at all phases. (Relaxed
/// friction lifts what slides: when is part of its answer.)
#[test]
fn balls_that_meet_obliquely_part_the_same_at_any_phase() {
    let (radius, offset, restitution) = (0.05, 0.07, 0.8);
    // The line of centres at touch: (-sqrt(4 R^2 - offset^2), offset) / 2 R, from the second ball to the
    // first.
    let normal = Vec3::new(-f64::sqrt(4.0 * radius * radius - offset * offset), offset, 0.0) / (2.0 * radius);
    for (friction, model) in [(0.0, Relaxed), (0.0, Coulomb), (0.3, Coulomb)] {
        let mut first: Option<[Vec3; 2]> = None;
        for step in [1e-3, 5e-3, 20e-3] {
            for phase in 0..8 {
                let mut world = world(friction, restitution);
                world.gravity = Vec3::ZERO;
                let way = (1.0 + (f64::from(phase) + 0.5) / 8.0) * step;
                let start = Vec3::new(2.0 * radius * normal.x - way, offset, 0.0);
                let a = add_sphere(&mut world, radius, start);
                let b = add_sphere(&mut world, radius, Vec3::ZERO);
                world.bodies.velocity[a] = Vec3::X;
                let mut stepper = stepper(step, 1e-3 * radius, 1e-13, model);
                for _ in 0..4 {
                    solved_step(&mut stepper, &mut world);
                }
                let what = format!("{friction}, {model:?}, {step} s, phase {phase}");
                if friction == 0.0 {
                    let impulse = -0.5 * (1.0 + restitution) * normal.x * normal;
                    let error = (world.bodies.velocity[a] - Vec3::X - impulse).length();
                    assert!(error < 1e-9, "{what}: off by {error:e} m/s");
                    assert!((world.bodies.velocity[b] + impulse).length() < 1e-9, "{what}");
                }
                let now = [world.bodies.velocity[a], world.bodies.angular_velocity[a] * radius];
                let then = *first.get_or_insert(now);
                let error = (now[0] - then[0]).length() + (now[1] - then[1]).length();
                assert!(error < 1e-8, "{what}: differs by {error:e} m/s");
            }
        }
    }
}

/// A8: masses 1 : 8, several coefficients of restitution.
#[test]
fn a08_head_on_impact() {
    for restitution in [0.0, 0.5, 1.0] {
        let mut world = world(0.3, restitution);
        world.gravity = Vec3::ZERO;
        let a = add_sphere(&mut world, 0.1, Vec3::new(-0.1, 0.0, 0.0));
        let b = add_sphere(&mut world, 0.2, Vec3::new(0.2, 0.0, 0.0));
        let (m_a, m_b) = (world.bodies.mass[a], world.bodies.mass[b]);
        world.bodies.velocity[a] = Vec3::new(2.0, 0.0, 0.0);
        world.bodies.velocity[b] = Vec3::new(-1.0, 0.0, 0.0);
        let (before, momentum) = (world.kinetic_energy(), 2.0 * m_a - m_b);
        solved_step(&mut stepper(1e-3, 1e-3, 1e-13, Relaxed), &mut world);
        let (u_a, u_b) = (world.bodies.velocity[a].x, world.bodies.velocity[b].x);
        assert_close(m_a * u_a + m_b * u_b, momentum, 1e-12 * m_b, "momentum");
        assert_close(u_b - u_a, restitution * 3.0, 1e-10, "velocity of separation");
        let reduced = m_a * m_b / (m_a + m_b);
        let loss = 0.5 * reduced * 9.0 * (1.0 - restitution * restitution);
        assert_close(before - world.kinetic_energy(), loss, 1e-10 * before, "energy lost");
    }
}

/// A9: plastic simultaneous impact on a row.
#[test]
fn a09_row_of_spheres() {
    let mut world = world(0.0, 0.0);
    world.gravity = Vec3::ZERO;
    let count = 8;
    for i in 0..count {
        add_sphere(&mut world, 0.1, Vec3::new(0.2 * f64::from(i), 0.0, 0.0));
    }
    world.bodies.velocity[0] = Vec3::X;
    solved_step(&mut stepper(1e-3, 1e-3, 1e-12, Relaxed), &mut world);
    for u in &world.bodies.velocity {
        assert_close(u.x, 1.0 / f64::from(count), 1e-8, "velocity");
    }
}

/// A ball that strikes a row of touching ones at the very end of a step, where the contact problem leaves
/// velocities of the size of rounding in the row: the last one goes on alone.
#[test]
fn a_row_of_elastic_balls_passes_the_impulse_on() {
    for (step, count) in [(1e-3, 2), (1e-3, 6), (2e-3, 6), (5e-3, 4)] {
        let mut world = world(0.0, 1.0);
        world.gravity = Vec3::ZERO;
        for i in 0..count {
            add_sphere(&mut world, 0.05, Vec3::new(0.1 * f64::from(i), 0.0, 0.0));
        }
        let a = add_sphere(&mut world, 0.05, Vec3::new(-0.4, 0.0, 0.0));
        world.bodies.velocity[a].x = 3.0;
        let mut stepper = default_stepper(step);
        for _ in 0..(0.12 / step) as usize {
            stepper.step(&mut world).unwrap();
        }
        for (body, u) in world.bodies.velocity.iter().enumerate() {
            let expected = if body + 1 == a { 3.0 } else { 0.0 };
            assert_close(u.x, expected, 1e-9, &format!("{count} balls, {step} s, body {body}"));
        }
    }
}

/// A20: alumina sphere on glass (Chung and Ooi): tangential restitution in the sliding regime.
#[test]
fn a20_tangential_restitution_of_alumina() {
    let digitised =
        [(40.0, 0.781), (50.0, 0.845), (60.0, 0.893), (70.0, 0.932), (80.0, 0.966), (85.0, 0.983)];
    for (angle, measured) in digitised {
        let angle = f64::to_radians(angle);
        let [u, _, _] = oblique(angle, 0.092, 0.98, Coulomb);
        let restitution = u / angle.sin();
        assert_close(restitution, 1.0 - 0.092 * 1.98 / angle.tan(), 1e-6, "formula");
        assert_close(restitution, measured, 0.005, "digitised curve");
        let [relaxed, _, _] = oblique(angle, 0.092, 0.98, Relaxed);
        println!(
            "A20 {:.0} deg: {restitution:.4} (relaxed {:.4}, measured {measured})",
            angle.to_degrees(),
            relaxed / angle.sin()
        );
    }
}

/// Bodies that travel several envelopes, even several radii, within a step do not end up inside each other: a
/// pair that closes within the step, or would if one of both were stopped, is a contact before it touches.
#[test]
fn fast_bodies_do_not_meet_inside_each_other() {
    let radius = 0.1;
    for (speed, faster) in [(5.0, 1.5), (15.0, 1.5), (5.0, 1.0), (15.0, 1.0)] {
        let mut world = world(0.25, 0.0);
        add_ground(&mut world, 0.0);
        let low = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, 0.5));
        let high = add_sphere(&mut world, radius, Vec3::new(0.02, 0.0, 1.1));
        world.bodies.velocity[low] = Vec3::new(0.0, 0.0, -speed);
        world.bodies.velocity[high] = Vec3::new(0.0, 0.0, -faster * speed);
        let mut stepper = stepper(0.01, 0.02 * radius, 1e-8, Relaxed);
        let mut deepest: f64 = 0.0;
        for _ in 0..60 {
            deepest = deepest.max(solved_step(&mut stepper, &mut world).penetration_max);
        }
        assert!(deepest < 0.02 * radius, "at {speed} m/s: overlap {deepest:.2e} m");
        assert!(world.bodies.position[low].z > 0.98 * radius);
    }
}

/// A tilted capsule falls on a fixed box without rebound: its far end lands too, instead of being found deep
/// inside.
#[test]
fn a_tilted_capsule_lands_on_both_ends() {
    let radius = 0.01;
    for tilt in [30.0_f64, 60.0, 70.0, 80.0, 89.0] {
        for step in [1e-3, 5e-3] {
            let mut world = world(0.0, 0.0);
            let block = world.add_geometry(Geometry::cuboid(Vec3::splat(0.2)).unwrap());
            let fixed = world.add_motion(Motion::fixed()).unwrap();
            let below = Vec3::new(0.0, 0.0, -0.2);
            world.add_body(Body { motion: fixed, ..Body::new(block, MaterialId::default(), below) }).unwrap();
            let rod = world.add_geometry(Geometry::capsule(0.02, radius).unwrap());
            let orientation = Quat::from_rotation_y(tilt.to_radians());
            let body =
                Body { orientation, ..Body::new(rod, MaterialId::default(), Vec3::new(0.0, 0.0, 0.2)) };
            world.add_body(body).unwrap();
            let mut stepper = stepper(step, 0.1 * radius, 1e-10, Coulomb);
            let mut deepest: f64 = 0.0;
            while world.time < 0.6 {
                deepest = deepest.max(solved_step(&mut stepper, &mut world).penetration_max);
            }
            println!("capsule tilted {tilt} degrees, step {step}: deepest {:.4} R", deepest / radius);
            assert!(deepest < 0.1 * radius, "{tilt} degrees, {step} s: {deepest}");
        }
    }
}

/// What does not fly (held from turning, on a slide, on a spring, joined to another, pulled to a point) has
/// velocities of the middle of a step, and bounces as high as it fell, at any step; and what lies there with
/// e > 0 stays.
#[test]
fn what_does_not_fly_bounces_as_high_as_it_fell() {
    let height = 0.2;
    for (step, restitution) in [(1e-3, 1.0), (5e-3, 1.0), (1e-2, 1.0), (1e-2, 0.5)] {
        for kind in ["locked", "slide", "spring", "joined", "pulled"] {
            let mut world = world(0.3, restitution);
            add_ground(&mut world, 0.0);
            let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, 0.05 + height));
            let (body, at) = (BodyId::from_index(ball), world.bodies.position[ball]);
            let mass = world.bodies.mass[ball];
            match kind {
                "locked" => {
                    let motion = Motion::fixed().with_free([true, true, true, false, false, false]);
                    world.bodies.motion[ball] = world.add_motion(motion).unwrap();
                }
                "joined" => {
                    let other = add_sphere(&mut world, 0.05, at + 0.2 * Vec3::X);
                    let other = BodyId::from_index(other);
                    world.add_joint(Joint::fixed(Some(body), other, at)).unwrap();
                }
                "pulled" => {
                    let pull =
                        Action::Central { centre: Vec3::ZERO, strength: 4.0, distance: 1.0, power: 1.0 };
                    world.add_load(Load::on(body, pull)).unwrap();
                }
                _ => {
                    let mut slide = Joint::prismatic(None, body, at, Vec3::Z);
                    if kind == "spring" {
                        slide = slide.with_spring(40.0 * mass, 0.0);
                    }
                    world.add_joint(slide).unwrap();
                }
            }
            let mut stepper = stepper(step, 1e-3, 1e-8, Coulomb);
            // Highest places between bounces: of the first with e < 1, of the last with e = 1.
            let (mut apexes, mut highest, mut low) = (Vec::new(), 0.0_f64, false);
            for _ in 0..(4.0 / step) as usize {
                solved_step(&mut stepper, &mut world);
                let above = world.bodies.position[ball].z - 0.05;
                let was_low = std::mem::replace(&mut low, above < 0.25 * restitution * height);
                if was_low && !low {
                    apexes.push(highest);
                    highest = 0.0;
                }
                highest = highest.max(above);
            }
            let apex =
                if restitution < 1.0 { apexes.get(1).unwrap_or(&highest) } else { &apexes[apexes.len() - 1] };
            let share = apex / height;
            let expected = restitution * restitution;
            println!("{kind}, {step} s, e = {restitution}: {share:.4} of the height");
            if kind != "spring" && kind != "pulled" || restitution == 1.0 {
                assert!((share - expected).abs() < 0.01 * expected, "{kind} {step} {restitution}: {share}");
            }
            if restitution < 1.0 {
                let left = world.bodies.velocity[ball].length();
                assert!(left < 1e-3, "{kind}: still {left} m/s");
            }
        }
    }
}

/// A ball that bounces on an anvil which a stop holds, below a slab on a taut rope, and against a plate with
/// a weak motor: what holds them counts, and what they would do without it does not.
#[test]
fn what_is_held_is_struck_as_it_moves() {
    let step = 1e-2;
    for kind in ["stop", "rope", "motor"] {
        let mut world = world(0.0, 1.0);
        let up = if kind == "stop" { 1.0 } else { -1.0 };
        if kind != "stop" {
            world.gravity = Vec3::ZERO;
        }
        let anvil = world.add_geometry(Geometry::cuboid(Vec3::new(0.3, 0.3, 0.05)).unwrap());
        let anvil =
            world.add_body(Body::new(anvil, MaterialId::default(), -0.05 * up * Vec3::Z)).unwrap().index();
        (world.bodies.mass[anvil], world.bodies.inertia[anvil]) = (1000.0, 1000.0 * Mat3::IDENTITY);
        let body = BodyId::from_index(anvil);
        let at = world.bodies.position[anvil];
        let slide = Joint::prismatic(None, body, at, Vec3::Z);
        let joint = match kind {
            "stop" => slide.with_limits(Some(0.0), None),
            "rope" => {
                world.bodies.force[anvil] = -9810.0 * Vec3::Z;
                Joint::distance(None, body, [at + Vec3::Z, at]).with_limits(None, Some(1.0))
            }
            _ => slide.with_motor(Motor::Speed {
                speed: Profile::Constant(10.0),
                limit: Some(Profile::Constant(1.0)),
            }),
        };
        world.add_joint(joint).unwrap();
        let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, up * 0.25));
        if kind != "stop" {
            world.bodies.velocity[ball] = Vec3::Z;
        }
        let mut stepper = stepper(step, 1e-3, 1e-8, Coulomb);
        let (mut highest, mut fastest) = (0.0_f64, 0.0_f64);
        for k in 0..100 {
            solved_step(&mut stepper, &mut world);
            if k > 30 {
                highest = highest.max(world.bodies.position[ball].z - 0.05);
                fastest = fastest.max(world.bodies.velocity[ball].length());
            }
        }
        if kind == "stop" {
            assert_close(highest, 0.2, 2e-3, kind);
        } else {
            assert_close(fastest, 1.0, 2e-2, kind);
        }
    }
}
