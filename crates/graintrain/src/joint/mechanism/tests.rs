//! What a mechanism makes of contact impulses.

use super::*;
use crate::joint::Joint;
use crate::material::Materials;
use crate::shape::Geometry;
use crate::world::Body;
use crate::world::MassProperties;
use rand::{RngExt, SeedableRng};

/// Two balls, 1 : 92, joined by a ball joint and struck by impulses that would turn them by many turns in a
/// step, one after the other, as a search for contact impulses tries them: whatever path is found, the joint
/// gives no energy beyond what roundings of a path are.
#[test]
fn no_path_gets_energy_from_what_only_holds() {
    let mut world = World::new(Vec3::ZERO, Materials::single("a", 1.0, 0.0, 0.0).unwrap()).unwrap();
    let ball = world.add_geometry(Geometry::sphere(0.028).unwrap());
    let [light, heavy] = [(-0.03, 1e-3), (0.03, 0.092)].map(|(x, mass)| {
        let body = Body::new(ball, crate::handle::MaterialId::default(), Vec3::new(x, 0.0, 0.0));
        let inertia = Mat3::from_diagonal(Vec3::splat(0.4 * mass * 0.028 * 0.028));
        world.add_body(Body { mass: Some(MassProperties { mass, inertia }), ..body }).unwrap()
    });
    world.add_joint(Joint::spherical(Some(light), heavy, Vec3::ZERO)).unwrap();
    let masses = inverse_mass(&world);
    let mut random = rand_pcg::Pcg64::seed_from_u64(5);
    for trial in 0..200 {
        let before = vec![0.0; 12];
        let mut all = Mechanisms::new(&world, &masses, &before, before.clone(), 4e-3);
        all.predict(&[]);
        for _ in 0..4 {
            let f = Vec3::from_array([0; 3].map(|_| random.random_range(-2.0..2.0)));
            let mut impulse = vec![0.0; 12];
            for (body, sign) in [(0, 1.0), (1, -1.0)] {
                let moment = Vec3::from_array([0; 3].map(|_| random.random_range(-0.02..0.02)));
                impulse[6 * body..6 * body + 6]
                    .copy_from_slice([(sign * f).to_array(), moment.to_array()].as_flattened());
            }
            all.predict(&impulse);
            let mut velocity = vec![0.0; 12];
            all.velocities(&impulse, &mut velocity);
            let energy: f64 = (0..2)
                .map(|body| {
                    let v = [0, 3].map(|k| Vec3::from_slice(&velocity[6 * body + k..6 * body + k + 3]));
                    let [p, l] = all.momentum(body, v);
                    0.5 * (p.dot(v[0]) + l.dot(v[1]))
                })
                .sum();
            let work: f64 = 0.5 * impulse.iter().zip(&velocity).map(|(f, v)| f * v).sum::<f64>();
            assert!(energy - work <= 0.25 * energy + 1e-12, "{trial}: {energy} J by {work} J");
        }
    }
}
