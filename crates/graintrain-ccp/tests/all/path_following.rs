//! `path` and the fallback on it: against brute force over all states of the contacts, on random problems, on
//! real ones.

use crate::common::{Random, random_problem, sparse_form};
use graintrain_ccp::registry::Method;
use graintrain_ccp::{
    Ccp, CcpSolver, Delassus, FrictionModel, SolveReport, SolveSettings, SolverSpec, Status,
};
use graintrain_linalg::block3::BlockMatrix3;

/// Dense N, row by row, from products with unit vectors.
fn dense(problem: &Ccp) -> Vec<Vec<f64>> {
    let size = 3 * problem.num_contacts();
    let mut columns = Vec::new();
    for k in 0..size {
        let (mut unit, mut column) = (vec![0.0; size], vec![0.0; size]);
        unit[k] = 1.0;
        problem.delassus.multiply(&unit, &mut column, &mut problem.delassus.work());
        columns.push(column);
    }
    (0..size).map(|row| (0..size).map(|k| columns[k][row]).collect()).collect()
}

/// How far impulses are from the disjunctive statement of Coulomb's law, relative to V: written out by cases,
/// without a projection. Cone: |g_t| <= mu g_n; apart: g = 0 and u_n >= 0; in contact: u_n = 0 and either u_t
/// = 0, or g_t opposite to u_t at the limit.
fn coulomb_defect(problem: &Ccp, n: &[Vec<f64>], g: &[f64]) -> f64 {
    let contacts = problem.num_contacts();
    let u: Vec<f64> = n
        .iter()
        .zip(&problem.r)
        .map(|(row, r)| row.iter().zip(g).map(|(n, g)| n * g).sum::<f64>() + r)
        .collect();
    let v = (problem.r.iter().map(|r| r * r).sum::<f64>() / contacts as f64).sqrt();
    let mut worst = 0.0_f64;
    for i in 0..contacts {
        let (g, u, mu) = (&g[3 * i..3 * i + 3], &u[3 * i..3 * i + 3], problem.friction[i]);
        let eta = ((0..3).map(|k| n[3 * i + k][3 * i + k]).sum::<f64>() / 3.0).max(1e-300);
        let (tangential, slip) = (g[1].hypot(g[2]), u[1].hypot(u[2]));
        let outside = eta * (tangential - mu * g[0]).max(0.0).max(-g[0]);
        let penetrating = (-u[0]).max(0.0);
        // min(a, b) is small where one of two alternatives holds.
        let parted = (eta * g[0].abs()).min(u[0].abs());
        // Slip goes against friction, and only where that is at its limit.
        let (along, across) = if tangential > 0.0 {
            let of = |a: f64, b: f64| (a * g[1] + b * g[2]) / tangential;
            (-of(u[1], u[2]), of(-u[2], u[1]).abs())
        } else {
            (0.0, 0.0)
        };
        let below_limit = slip.min(eta * (mu * g[0] - tangential).max(0.0));
        // An impulse of next to nothing has any direction.
        let sliding = below_limit.max(across.max(-along).min(eta * tangential));
        worst = worst.max(outside.max(penetrating).max(parted).max(sliding) / v);
    }
    worst
}

fn solve(problem: &Ccp, method: Method, tolerance: f64) -> (SolveReport, Vec<f64>) {
    let settings = SolveSettings { tolerance, friction: FrictionModel::Coulomb, ..SolveSettings::default() };
    let mut impulse = vec![0.0; 3 * problem.num_contacts()];
    let report = SolverSpec::from(method).build().unwrap().solve(problem, &mut impulse, &settings).unwrap();
    (report, impulse)
}

/// Solves the square system A x = b by elimination with row exchanges; `None` where it is singular.
fn eliminate(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Option<Vec<f64>> {
    let n = b.len();
    for k in 0..n {
        let best = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs()))?;
        if a[best][k].abs() < 1e-12 {
            return None;
        }
        a.swap(k, best);
        b.swap(k, best);
        for i in k + 1..n {
            let factor = a[i][k] / a[k][k];
            for c in k..n {
                a[i][c] -= factor * a[k][c];
            }
            b[i] -= factor * b[k];
        }
    }
    for k in (0..n).rev() {
        let sum: f64 = (k + 1..n).map(|c| a[k][c] * b[c]).sum();
        b[k] = (b[k] - sum) / a[k][k];
    }
    Some(b)
}

/// The impulses of every combination of apart, sticking and sliding in a direction alpha_i, by Newton's
/// method on the equations of that combination from several directions; those that satisfy Coulomb's law.
fn brute_force(problem: &Ccp, n: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let contacts = problem.num_contacts();
    let size = 3 * contacts;
    let mut found: Vec<Vec<f64>> = Vec::new();
    for states in 0..3_usize.pow(contacts as u32) {
        let state = |i: usize| states / 3_usize.pow(i as u32) % 3;
        let sliding: Vec<usize> = (0..contacts).filter(|&i| state(i) == 2).collect();
        let starts = 12_usize.pow(sliding.len() as u32);
        for start in 0..starts {
            let mut alpha = vec![0.0; contacts];
            for (position, &i) in sliding.iter().enumerate() {
                let step = start / 12_usize.pow(position as u32) % 12;
                alpha[i] = step as f64 * std::f64::consts::TAU / 12.0;
            }
            // Unknowns g and alpha: apart g = 0; sticking u = 0; sliding u_n = 0, g_t = -mu g_n d, u_t x d =
            // 0 with d = d(alpha).
            let mut g = vec![0.0; size];
            for _ in 0..30 {
                let unknowns = size + sliding.len();
                let mut a = vec![vec![0.0; unknowns]; unknowns];
                let mut b = vec![0.0; unknowns];
                let velocity = |k: usize, g: &[f64]| -> f64 {
                    n[k].iter().zip(g).map(|(n, g)| n * g).sum::<f64>() + problem.r[k]
                };
                for i in 0..contacts {
                    let k = 3 * i;
                    match state(i) {
                        0 => (0..3).for_each(|c| {
                            a[k + c][k + c] = 1.0;
                            b[k + c] = -g[k + c];
                        }),
                        1 => (0..3).for_each(|c| {
                            a[k + c][..size].copy_from_slice(&n[k + c]);
                            b[k + c] = -velocity(k + c, &g);
                        }),
                        _ => {
                            let position = size + sliding.iter().position(|&j| j == i).unwrap();
                            let (mu, d) = (problem.friction[i], [alpha[i].cos(), alpha[i].sin()]);
                            a[k][..size].copy_from_slice(&n[k]);
                            b[k] = -velocity(k, &g);
                            let turned = [-d[1], d[0]];
                            for c in 0..2 {
                                a[k + 1 + c][k + 1 + c] = 1.0;
                                a[k + 1 + c][k] = mu * d[c];
                                a[k + 1 + c][position] = mu * g[k] * turned[c];
                                b[k + 1 + c] = -(g[k + 1 + c] + mu * g[k] * d[c]);
                            }
                            let (u1, u2) = (velocity(k + 1, &g), velocity(k + 2, &g));
                            for column in 0..size {
                                a[position][column] = n[k + 1][column] * d[1] - n[k + 2][column] * d[0];
                            }
                            a[position][position] = u1 * turned[1] - u2 * turned[0];
                            b[position] = -(u1 * d[1] - u2 * d[0]);
                        }
                    }
                }
                let Some(step) = eliminate(a, b) else { break };
                for k in 0..size {
                    g[k] += step[k];
                }
                for (position, &i) in sliding.iter().enumerate() {
                    alpha[i] += step[size + position].clamp(-1.0, 1.0);
                }
            }
            let new = |g: &[f64], known: &Vec<f64>| {
                g.iter().zip(known).any(|(a, b)| (a - b).abs() > 1e-6 * (1.0 + a.abs()))
            };
            if coulomb_defect(problem, n, &g) < 1e-9 && found.iter().all(|known| new(&g, known)) {
                found.push(g);
            }
        }
    }
    found
}

/// A random positive definite N over a few contacts.
fn small_problem(seed: u64) -> Ccp {
    let mut random = Random::new(seed);
    let contacts = 1 + random.below(3);
    let size = 3 * contacts;
    let factor: Vec<Vec<f64>> = (0..size).map(|_| (0..size + 1).map(|_| random.signed()).collect()).collect();
    let mut entries = Vec::new();
    for i in 0..size {
        for j in 0..size {
            let product: f64 = factor[i].iter().zip(&factor[j]).map(|(a, b)| a * b).sum();
            entries.push((i, j, product + if i == j { 0.3 } else { 0.0 }));
        }
    }
    let r = (0..size).map(|_| random.signed()).collect();
    let friction = (0..contacts).map(|_| 1.5 * random.unit()).collect();
    Ccp::from_triplets(&entries, r, friction).unwrap()
}

#[test]
fn one_to_three_contacts_are_solved_as_brute_force_solves_them() {
    let mut several = 0;
    for seed in 0..60 {
        let problem = small_problem(seed);
        let n = dense(&problem);
        let all = brute_force(&problem, &n);
        let (report, g) = solve(&problem, Method::PathFollowing, 1e-11);
        assert_eq!(report.status, Status::Converged, "seed {seed}: {:?}", report.remark);
        assert!(!all.is_empty(), "seed {seed}: brute force has to find a solution");
        let distance = |known: &Vec<f64>| {
            g.iter().zip(known).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max)
        };
        let nearest = all.iter().map(distance).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-7, "seed {seed}: {nearest:e} from the nearest of {}", all.len());
        several += usize::from(all.len() > 1);
    }
    println!("{several} of 60 problems have several solutions");
}

/// Random problems with mass ratios up to 1e6, redundant contacts and contacts without friction, over bodies
/// and as a bare matrix.
#[test]
fn random_problems_are_solved_over_bodies_and_over_contacts() {
    for seed in 0..40 {
        let problem = random_problem(seed);
        for problem in [sparse_form(&problem), problem] {
            let (report, g) = solve(&problem, Method::Auto, 1e-8);
            assert!(report.converged(), "seed {seed}: {:?} {:e}", report.status, report.residual.max);
            let defect = coulomb_defect(&problem, &dense(&problem), &g);
            // Along a generator of the cone an error may be 1 / sin of its angle as large as the residual.
            assert!(defect < 1e-6, "seed {seed}: {defect:e}");
        }
    }
}

/// `cargo test --release -p graintrain-ccp --features paper --test all path_following::a_thousand -- --ignored --nocapture`
#[test]
#[ignore = "a minute: a thousand problems by two methods"]
fn a_thousand_random_problems() {
    for (name, method) in [("path", Method::PathFollowing), ("auto", Method::Auto)] {
        for tolerance in [1e-6, 1e-9] {
            let (mut solved, mut systems, mut worst) = (0, 0, 0.0_f64);
            let start = std::time::Instant::now();
            for seed in 0..1000 {
                let problem = random_problem(seed);
                let (report, g) = solve(&problem, method, tolerance);
                systems += report.newton.len();
                if report.converged() {
                    solved += 1;
                    worst = worst.max(coulomb_defect(&problem, &dense(&problem), &g) / tolerance);
                } else {
                    println!(
                        "{name} seed {seed}: {:?} {:.1e}, {} contacts, {:?}",
                        report.status,
                        report.residual.max,
                        problem.num_contacts(),
                        report.remark
                    );
                }
            }
            println!(
                "{name} at {tolerance:e}: {solved} of 1000, {systems} factorisations, {:.1} s, largest defect / tolerance {worst:.1}",
                start.elapsed().as_secs_f64()
            );
        }
    }
}

/// An explicit matrix that is not symmetric is taken as it is.
#[test]
fn an_asymmetric_matrix_is_solved_as_it_is() {
    for seed in 0..20 {
        let problem = small_problem(seed);
        let Delassus::Sparse(matrix) = &*problem.delassus else { unreachable!() };
        let mut blocks = matrix.blocks().to_vec();
        let mut random = Random::new(seed + 1000);
        blocks.iter_mut().flatten().for_each(|x| *x += 0.02 * random.signed());
        let matrix = BlockMatrix3::from_rows(matrix.row_starts().to_vec(), matrix.columns().to_vec(), blocks);
        assert!(matrix.asymmetry() > 1e-3);
        let problem =
            Ccp::new(Delassus::Sparse(matrix), problem.r.clone(), problem.friction.clone()).unwrap();
        let (report, g) = solve(&problem, Method::PathFollowing, 1e-10);
        assert!(report.converged(), "seed {seed}: {:?}", report.remark);
        assert!(coulomb_defect(&problem, &dense(&problem), &g) < 1e-9);
    }
}

#[test]
fn nothing_one_contact_and_contacts_without_friction() {
    let empty = Ccp::from_triplets(&[], Vec::new(), Vec::new()).unwrap();
    assert!(solve(&empty, Method::PathFollowing, 1e-12).0.converged());
    for mu in [0.0, 1e-3, 0.3, 1e3] {
        let entries = [(0, 0, 0.5), (1, 1, 1.75), (2, 2, 1.75)];
        let problem = Ccp::from_triplets(&entries, vec![-1.0, 0.1, 0.0], vec![mu]).unwrap();
        let mut solver = graintrain_ccp::solver::PathFollowing::default();
        let settings =
            SolveSettings { tolerance: 1e-10, friction: FrictionModel::Coulomb, ..SolveSettings::default() };
        let mut g = vec![0.0; 3];
        let report = solver.solve(&problem, &mut g, &settings).unwrap();
        assert!(report.converged(), "mu = {mu}: {:?}", report.remark);
        let friction = (mu * 2.0).min(0.1 / 1.75);
        assert!((g[0] - 2.0).abs() < 1e-8 && (g[1] + friction).abs() < 1e-8, "mu = {mu}: {g:?}");
    }
}
