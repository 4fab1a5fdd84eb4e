//! Bodies that joints couple, compliant contacts and contacts that resist turning, together: what solvers
//! claim over bodies holds for N as a matrix.

use crate::common::{Random, random_problem, sparse_form, with_turning};
use graintrain_ccp::residual::{FrictionModel, ResidualScale};
use graintrain_ccp::{Ccp, CoupledBodies, Delassus, SolveSettings, SolverSpec};
use std::sync::Arc;

/// Free motions of some bodies under as many random bilateral rows as leave `degrees` of them: with the
/// bodies' own masses, Y = M^-1/2 Q with Q orthonormal.
fn mechanism(problem: &Ccp, bodies: Vec<u32>, degrees: usize, random: &mut Random) -> CoupledBodies {
    let Delassus::Rigid(rigid) = &*problem.delassus else { unreachable!("random problems have bodies") };
    let size = 6 * bodies.len();
    let mut basis: Vec<Vec<f64>> = Vec::new();
    while basis.len() < degrees.min(size) {
        let mut q: Vec<f64> = (0..size).map(|_| random.signed()).collect();
        for _ in 0..2 {
            for known in &basis {
                let along: f64 = known.iter().zip(&q).map(|(a, b)| a * b).sum();
                q.iter_mut().zip(known).for_each(|(q, known)| *q -= along * known);
            }
        }
        let length = q.iter().map(|q| q * q).sum::<f64>().sqrt();
        q.iter_mut().for_each(|q| *q /= length);
        basis.push(q);
    }
    let root = |row: usize| {
        let mass = &rigid.inverse_mass()[bodies[row / 6] as usize];
        if row % 6 < 3 { mass.linear[row % 6].sqrt() } else { mass.angular[4 * (row % 6 - 3)].sqrt() }
    };
    let factor = (0..size).flat_map(|row| basis.iter().map(move |q| root(row) * q[row])).collect();
    CoupledBodies { bodies, degrees: basis.len(), factor }
}

/// A random problem with up to two mechanisms, with a solution in both friction models: contacts that open,
/// stick and, with u_n of the model, slide.
fn problem(seed: u64, model: FrictionModel) -> Ccp {
    let mut random = Random::new(seed);
    let mut problem = random_problem(seed);
    if seed.is_multiple_of(3) {
        problem = with_turning(&problem, seed);
    }
    let Delassus::Rigid(rigid) = &*problem.delassus else { unreachable!("random problems have bodies") };
    let mut sets = [Vec::new(), Vec::new()];
    for body in 0..rigid.num_bodies() as u32 {
        if let Some(set) = sets.get_mut(random.below(3)) {
            set.push(body);
        }
    }
    let sets = sets.into_iter().filter(|set| !set.is_empty());
    let coupled = sets.map(|set| {
        let degrees = 1 + random.below(6 * set.len());
        mechanism(&problem, set, degrees, &mut random)
    });
    let mut rigid = rigid.clone().with_coupled(coupled.collect());
    if seed.is_multiple_of(2) {
        let scale = problem.diagonal_scale();
        rigid = rigid.with_compliance(scale.iter().map(|eta| eta * 10.0 * random.unit().powi(4)).collect());
    }
    let delassus = Delassus::Rigid(rigid);
    let (mut g, mut u) = (vec![0.0; problem.r.len()], vec![0.0; problem.r.len()]);
    for i in 0..problem.num_contacts() {
        let (mu, angle) = (problem.friction[i], 6.0 * random.unit());
        let direction = [angle.cos(), angle.sin()];
        match random.below(3) {
            0 => u[3 * i] = random.unit(),
            1 => g[3 * i] = random.unit(),
            _ => {
                let speed = random.unit();
                g[3 * i] = random.unit();
                u[3 * i] = if model == FrictionModel::Relaxed { mu * speed } else { 0.0 };
                for k in 0..2 {
                    g[3 * i + 1 + k] = -mu * g[3 * i] * direction[k];
                    u[3 * i + 1 + k] = speed * direction[k];
                }
            }
        }
    }
    let mut r = vec![0.0; g.len()];
    delassus.multiply(&g, &mut r, &mut delassus.work());
    r.iter_mut().zip(&u).for_each(|(r, u)| *r = u - *r);
    Ccp { delassus: Arc::new(delassus), r, ..problem }
}

/// What a solver claims is true of N as a matrix, and it solves nearly all.
fn check(name: &str, model: FrictionModel, seeds: std::ops::Range<u64>, most_unsolved: usize) {
    let settings = SolveSettings {
        tolerance: 1e-6,
        friction: model,
        max_iterations: Some(30_000),
        ..SolveSettings::default()
    };
    let mut unsolved = Vec::new();
    for seed in seeds {
        let problem = problem(seed, model);
        let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
        let mut g = vec![0.0; problem.r.len()];
        let report = solver.solve(&problem, &mut g, &settings).unwrap();
        if !report.converged() {
            unsolved.push((seed, report.residual.max));
            continue;
        }
        let rows = sparse_form(&problem);
        let mut u = vec![0.0; g.len()];
        rows.velocity(&g, &mut u, &mut rows.delassus.work());
        let found = ResidualScale::new(&rows).evaluate(&rows, &g, &u);
        let residual = if model == FrictionModel::Relaxed { found.relaxed } else { found.coulomb };
        assert!(residual.max <= 1.1e-6, "{name}, {model:?}, seed {seed}: {:e}", residual.max);
    }
    assert!(unsolved.len() <= most_unsolved, "{name}, {model:?}: {unsolved:?}");
}

#[test]
fn what_is_claimed_over_mechanisms_is_true_of_the_matrix() {
    check("auto", FrictionModel::Coulomb, 0..60, 6);
    check("auto", FrictionModel::Relaxed, 0..60, 3);
}

#[test]
fn methods_by_name_take_mechanisms() {
    for name in ["apgd", "apgs", "pgs"] {
        for model in [FrictionModel::Coulomb, FrictionModel::Relaxed] {
            check(name, model, 200..230, 6);
        }
    }
}
