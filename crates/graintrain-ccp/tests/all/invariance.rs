//! `ipm` on variations of problems: other units, masses of all sizes, every contact three times, two problems
//! as one.

use crate::common::{Random, lattice_packing, random_problem, sparse_form};
use graintrain_ccp::{BodyInverseMass, Ccp, Delassus, FIXED, RigidContact, RigidDelassus};
use graintrain_ccp::{SolveReport, SolveSettings, SolverSpec, Status};
use std::sync::Arc;

fn solve(problem: &Ccp) -> SolveReport {
    let mut solver = "ipm".parse::<SolverSpec>().unwrap().build().unwrap();
    let settings = SolveSettings { tolerance: 1e-8, ..SolveSettings::default() };
    solver.solve(problem, &mut vec![0.0; problem.r.len()], &settings).unwrap()
}

fn bodies(problem: &Ccp) -> &RigidDelassus {
    match &*problem.delassus {
        Delassus::Rigid(rigid) => rigid,
        Delassus::Sparse(_) => unreachable!("the generators make bodies"),
    }
}

fn with_bodies(problem: &Ccp, contacts: Vec<RigidContact>, masses: Vec<BodyInverseMass>) -> Ccp {
    Ccp { delassus: Arc::new(Delassus::Rigid(RigidDelassus::new(contacts, masses))), ..problem.clone() }
}

/// The problem in units that are so many times smaller.
fn in_units(problem: &Ccp, mass: f64, length: f64, time: f64) -> Ccp {
    let contacts = bodies(problem).contacts().iter().map(|c| RigidContact {
        arm_a: c.arm_a.map(|x| x * length),
        arm_b: c.arm_b.map(|x| x * length),
        ..*c
    });
    let masses = bodies(problem).inverse_mass().iter().map(|m| BodyInverseMass {
        linear: m.linear.map(|x| x / mass),
        angular: m.angular.map(|x| x / (mass * length * length)),
    });
    let r = problem.r.iter().map(|r| r * length / time).collect();
    let velocity_scale = problem.velocity_scale.map(|v| v * length / time);
    Ccp { r, velocity_scale, points: vec![], ..with_bodies(problem, contacts.collect(), masses.collect()) }
}

fn assert_close(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!(
        (found - expected).abs() <= tolerance * expected.abs(),
        "{what}: {found:e}, expected {expected:e}"
    );
}

fn problems() -> Vec<Ccp> {
    let mut all: Vec<Ccp> = (0..8).map(random_problem).collect();
    all.push(lattice_packing(4, 3, 0.3, 2));
    all
}

#[test]
fn units_do_not_matter() {
    for (k, problem) in problems().iter().enumerate() {
        let base = solve(problem);
        assert_eq!(base.status, Status::Converged, "{k}");
        for (mass, length, time) in [
            (1.0, 1e3, 1.0),
            (1.0, 1e-3, 1.0),
            (1e-3, 1.0, 1.0),
            (1e9, 1.0, 1.0),
            (1.0, 1.0, 1e-3),
            (1e-9, 1e3, 10.0),
        ] {
            let other = solve(&in_units(problem, mass, length, time));
            assert_eq!(other.status, base.status, "{k}");
            let energy = mass * length * length / (time * time);
            assert_close(
                other.objective / energy,
                base.objective,
                1e-6,
                &format!("{k}, {mass} {length} {time}"),
            );
        }
    }
}

#[test]
fn copies_of_contacts_share_their_impulses() {
    for (k, problem) in problems().iter().enumerate() {
        let three = |v: &[f64]| [v, v, v].concat();
        let contacts = bodies(problem).contacts();
        let copies = [contacts, contacts, contacts].concat();
        let other = Ccp {
            r: three(&problem.r),
            friction: three(&problem.friction),
            points: vec![],
            ..with_bodies(problem, copies, bodies(problem).inverse_mass().to_vec())
        };
        let (base, other) = (solve(problem), solve(&other));
        assert_eq!(other.status, base.status, "{k}");
        assert_close(other.objective, base.objective, 1e-6, &format!("{k}"));
    }
}

#[test]
fn two_problems_as_one_have_the_sum_of_their_objectives() {
    let all = problems();
    for (k, pair) in all.windows(2).enumerate() {
        let [first, second] = pair else { unreachable!("windows of two") };
        let shift = bodies(first).num_bodies() as u32;
        let moved = |body: u32| if body == FIXED { FIXED } else { body + shift };
        let contacts = bodies(second).contacts().iter().map(|c| RigidContact {
            body_a: moved(c.body_a),
            body_b: moved(c.body_b),
            ..*c
        });
        let masses = [bodies(first).inverse_mass(), bodies(second).inverse_mass()].concat();
        let united = Ccp {
            r: [&first.r[..], &second.r[..]].concat(),
            friction: [&first.friction[..], &second.friction[..]].concat(),
            points: vec![],
            velocity_scale: None,
            ..with_bodies(first, bodies(first).contacts().iter().copied().chain(contacts).collect(), masses)
        };
        for form in [united.clone(), sparse_form(&united)] {
            let found = solve(&form);
            assert_eq!(found.status, Status::Converged, "{k}");
            assert_close(
                found.objective,
                solve(first).objective + solve(second).objective,
                1e-6,
                &format!("{k}"),
            );
        }
    }
}

#[test]
fn packings_of_masses_from_a_gram_to_a_ton() {
    for seed in 0..6 {
        let packing = lattice_packing(5, 4, 0.3, seed);
        let mut random = Random::new(seed);
        let masses = bodies(&packing)
            .inverse_mass()
            .iter()
            .map(|m| {
                let factor = 10.0_f64.powf(3.0 * random.signed());
                BodyInverseMass {
                    linear: m.linear.map(|x| x / factor),
                    angular: m.angular.map(|x| x / factor),
                }
            })
            .collect();
        let problem = Ccp {
            velocity_scale: None,
            ..with_bodies(&packing, bodies(&packing).contacts().to_vec(), masses)
        };
        let report = solve(&problem);
        println!("{seed}: {:?} {:.1e} after {}", report.status, report.residual.max, report.iterations);
        assert_eq!(report.status, Status::Converged, "{seed}");
    }
}
