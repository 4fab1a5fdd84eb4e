//! Several ranks compute the bits of one process, whatever each of them does of the work.

use crate::common::{lattice_packing, with_mechanisms, with_turning};
use graintrain_ccp::solver::ranks::threads::on_ranks;
use graintrain_ccp::{
    BodyInverseMass, Ccp, Criterion, Delassus, FIXED, FrictionModel, Ranks, RigidContact, RigidDelassus,
    SolveSettings, SolverSpec, Status,
};
use std::sync::Arc;

/// Bits of the impulses, iterations and bits of the residual of a solve.
type Found = (Vec<u64>, usize, u64);

fn solve(problem: &Ccp, name: &str, settings: &SolveSettings, ranks: Option<Arc<Ranks>>) -> Found {
    let stop = ranks.as_ref().map(|ranks| ranks.stop());
    let settings = SolveSettings { ranks, stop, ..settings.clone() };
    let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
    let mut g = vec![0.0; problem.r.len()];
    let report = solver.solve(problem, &mut g, &settings).unwrap();
    assert!(g.iter().any(|&g| g != 0.0), "{name} did something");
    // Again from there with another r: what a solver keeps between solves is shared among the ranks, too.
    let again = Ccp { r: problem.r.iter().map(|r| 1.01 * r).collect(), ..problem.clone() };
    let next = solver.solve(&again, &mut g, &settings).unwrap();
    let iterations = report.iterations + next.iterations;
    (g.iter().map(|g| g.to_bits()).collect(), iterations, next.residual.max.to_bits())
}

/// Some thousands of balls on a plate that can move, which contacts all over the packing touch.
fn on_a_plate(problem: &Ccp) -> Ccp {
    let Delassus::Rigid(rigid) = &*problem.delassus else { panic!("a problem over bodies") };
    let plate = rigid.num_bodies() as u32;
    let mut contacts = rigid.contacts().to_vec();
    for (i, contact) in
        contacts.iter_mut().enumerate().filter(|(i, contact)| contact.body_b == FIXED || i % 7 == 0)
    {
        let arm_b = std::array::from_fn(|k| (0.1 * (i + k) as f64).sin());
        *contact = RigidContact { body_b: plate, arm_b, ..*contact };
    }
    let mut masses = rigid.inverse_mass().to_vec();
    masses.push(BodyInverseMass {
        linear: [1e-3; 3],
        angular: [1e-3, 0.0, 0.0, 0.0, 2e-3, 0.0, 0.0, 0.0, 1e-3],
    });
    Ccp { delassus: Arc::new(Delassus::Rigid(RigidDelassus::new(contacts, masses))), ..problem.clone() }
}

#[test]
fn ranks_compute_the_bits_of_one_process() {
    // Some ten chunks of contacts and three tasks of bodies.
    let plain = lattice_packing(14, 14, 0.3, 1);
    assert!(plain.num_contacts() > 8 * 1024);
    let problems = [
        ("plain", plain.clone()),
        ("on a plate", on_a_plate(&plain)),
        ("turning", with_turning(&plain, 1)),
        ("mechanisms", with_mechanisms(&plain)),
    ];
    // Begun and ended in single precision, begun in single precision, in double precision alone.
    let accuracies = [(1e-4, Criterion::Mixed), (2e-5, Criterion::Mixed), (1e-9, Criterion::Maximum)];
    for (what, problem) in &problems {
        for friction in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
            for (tolerance, criterion) in accuracies {
                let settings = SolveSettings {
                    tolerance,
                    criterion,
                    friction,
                    max_iterations: Some(150),
                    ..SolveSettings::default()
                };
                let alone = solve(problem, "apgd", &settings, None);
                for (count, threads) in [(1, 1), (2, 1), (3, 2), (7, 1)] {
                    let all =
                        on_ranks(count, threads, |ranks| solve(problem, "apgd", &settings, Some(ranks)));
                    for (rank, found) in all.into_iter().enumerate() {
                        let case = format!("{what}, {friction:?}, {tolerance:e}, rank {rank} of {count}");
                        assert_eq!(found.1, alone.1, "iterations: {case}");
                        assert!(found == alone, "{case}");
                    }
                }
            }
        }
    }
}

/// Methods that cannot share their work do it on all ranks.
#[test]
fn methods_that_are_not_shared_compute_the_same_bits() {
    let problem = lattice_packing(9, 8, 0.3, 2);
    let runs = [
        ("auto", FrictionModel::Relaxed),
        ("auto", FrictionModel::Coulomb),
        ("pgs", FrictionModel::Relaxed),
        ("apgs", FrictionModel::Coulomb),
        #[cfg(feature = "paper")]
        ("bb", FrictionModel::Relaxed),
        ("ipm", FrictionModel::Relaxed),
    ];
    for (name, friction) in runs {
        let settings =
            SolveSettings { tolerance: 1e-6, friction, max_iterations: Some(40), ..SolveSettings::default() };
        let alone = solve(&problem, name, &settings, None);
        for (rank, found) in
            on_ranks(3, 1, |ranks| solve(&problem, name, &settings, Some(ranks))).into_iter().enumerate()
        {
            assert!(found == alone, "{name} {friction:?} rank {rank}");
        }
    }
}

/// Each rank has its share of the contacts, and they talk.
#[test]
fn the_work_is_shared_evenly() {
    let problem = lattice_packing(14, 14, 0.3, 1);
    let settings = SolveSettings { tolerance: 1e-4, criterion: Criterion::Mixed, ..SolveSettings::default() };
    let spent = on_ranks(3, 1, |ranks| {
        solve(&problem, "apgd", &settings, Some(Arc::clone(&ranks)));
        ranks.spent()
    });
    let most = spent.iter().map(|spent| spent.contacts).max().unwrap() as f64;
    let mean = spent.iter().map(|spent| spent.contacts).sum::<u64>() as f64 / 3.0;
    assert!(mean > 0.0 && most / mean < 1.2, "{spent:?}");
    assert!(spent.iter().all(|spent| spent.bytes > 0 && spent.seconds > 0.0), "{spent:?}");
}

/// One of them is asked to stop: all of them stop at the same iteration.
#[test]
fn ranks_stop_together() {
    let problem = lattice_packing(14, 14, 0.3, 1);
    let settings = SolveSettings { tolerance: 1e-14, ..SolveSettings::default() };
    let ended = on_ranks(3, 1, |ranks| {
        if ranks.rank() == 1 {
            let asked = ranks.asked();
            std::thread::spawn(move || {
                std::thread::sleep(std::time::Duration::from_millis(50));
                asked.store(true, std::sync::atomic::Ordering::Relaxed);
            });
        }
        let settings = SolveSettings { stop: Some(ranks.stop()), ranks: Some(ranks), ..settings.clone() };
        let mut g = vec![0.0; problem.r.len()];
        let mut solver = "apgd".parse::<SolverSpec>().unwrap().build().unwrap();
        let report = solver.solve(&problem, &mut g, &settings).unwrap();
        (report.status, report.iterations, g.iter().map(|g| g.to_bits()).collect::<Vec<_>>())
    });
    assert_eq!(ended[0].0, Status::Stopped);
    assert!(ended.iter().all(|other| *other == ended[0]));
}
