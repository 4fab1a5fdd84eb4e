//! Every first-order method against hand-made problems and against Clarabel.

use crate::common::{clarabel, lattice_packing, random_problem, sparse_form};
use graintrain_ccp::registry::Method;
use graintrain_ccp::residual::{FrictionModel, ResidualScale};
use graintrain_ccp::{BodyInverseMass, Ccp, Delassus, FIXED, RigidContact, RigidDelassus};
use graintrain_ccp::{CcpSolver, SolveReport, SolveSettings, SolverSpec};

const FIRST_ORDER: &[&str] = &["pj", "pgs", "apgs", "apgd", "bb", "kucera", "spg", "gpminres", "auto"];

fn solve(name: &str, problem: &Ccp, start: Option<&[f64]>, tolerance: f64) -> (Vec<f64>, SolveReport) {
    let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
    let mut g = start.map_or_else(|| vec![0.0; 3 * problem.num_contacts()], <[f64]>::to_vec);
    let settings = SolveSettings { tolerance, max_iterations: Some(20_000), ..SolveSettings::default() };
    let report = solver.solve(problem, &mut g, &settings).unwrap();
    (g, report)
}

/// A ball of mass m on a fixed floor, free velocity (u_1, 0, -u_n), arm of length zero: N = I / m.
fn sliding_point(mass: f64, mu: f64, tangential: f64, normal: f64) -> Ccp {
    let contact = RigidContact {
        body_a: 0,
        body_b: FIXED,
        frame: crate::common::frame([0.0, 0.0, 1.0]),
        arm_a: [0.0; 3],
        arm_b: [0.0; 3],
    };
    let rigid = RigidDelassus::new(vec![contact], vec![crate::common::ball(mass, 1.0)]);
    Ccp::new(Delassus::Rigid(rigid), vec![-normal, tangential, 0.0], vec![mu]).unwrap()
}

/// One contact with N = I/m: g = P(-m r). Sticking for mu u_n >= u_t, else sliding.
#[test]
fn one_contact_has_the_projected_impulse() {
    for name in FIRST_ORDER {
        for (mu, tangential) in [(0.5, 0.2), (0.5, 3.0), (0.0, 1.0), (2.0, 1.0)] {
            let problem = sliding_point(2.0, mu, tangential, 1.0);
            for form in [problem.clone(), sparse_form(&problem)] {
                let (g, report) = solve(name, &form, None, 1e-12);
                assert!(report.converged(), "{name}: {report:?}");
                let expected = problem.cone(0).project([2.0, -2.0 * tangential, 0.0]);
                for k in 0..3 {
                    assert!((g[k] - expected[k]).abs() < 1e-10, "{name}: {g:?} instead of {expected:?}");
                }
            }
        }
    }
}

#[test]
fn no_contacts_and_separating_contacts_are_solved_at_once() {
    for name in FIRST_ORDER {
        let none = Ccp::new(Delassus::Rigid(RigidDelassus::new(vec![], vec![])), vec![], vec![]).unwrap();
        let (_, report) = solve(name, &none, None, 1e-10);
        assert!(report.converged() && report.iterations == 0, "{name}: {report:?}");
        let separating = sliding_point(1.0, 0.3, 0.0, -1.0);
        let (g, report) = solve(name, &separating, None, 1e-10);
        // `auto` takes an interior point at this tolerance, which ends just inside the cone.
        let separated = g.iter().all(|g| g.abs() <= if *name == "auto" { 1e-10 } else { 0.0 });
        assert!(report.converged() && separated, "{name}: {report:?}");
    }
}

/// g projected on the cones, and u = N g + r there.
fn feasible(problem: &Ccp, g: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let g: Vec<f64> = (0..problem.num_contacts())
        .flat_map(|i| problem.cone(i).project(std::array::from_fn(|k| g[3 * i + k])))
        .collect();
    let mut u = vec![0.0; g.len()];
    problem.delassus.multiply(&g, &mut u, &mut problem.delassus.work());
    for (u, r) in u.iter_mut().zip(&problem.r) {
        *u += r;
    }
    (g, u)
}

/// How far the objective of g can be above that of any other y in the cones, if every eta_i |d_i| with d_i =
/// g_i - p_i and p_i = P_i(g_i - u_i / eta_i) is at most `largest`, m/s: the objective is convex and p a
/// projection, so that
///
/// ```text
/// f(g) - f(y) <= u^T (g - y) <= sum_i |d_i| (|u_i| + eta_i |p_i - y_i|)
/// ```
fn gap_bound(problem: &Ccp, scale: &ResidualScale, g: &[f64], u: &[f64], y: &[f64], largest: f64) -> f64 {
    let norm = |x: [f64; 3]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    (0..problem.num_contacts())
        .map(|i| {
            let eta = scale.eta[i];
            let p = problem.cone(i).project(std::array::from_fn(|k| g[3 * i + k] - u[3 * i + k] / eta));
            let away = norm(std::array::from_fn(|k| p[k] - y[3 * i + k]));
            largest / eta * (norm([u[3 * i], u[3 * i + 1], u[3 * i + 2]]) + eta * away)
        })
        .sum()
}

/// What every answer must satisfy: the report tells the truth about the residual, and the objective is that
/// of the oracle up to what the residuals of both allow, on both sides.
fn check_against_oracle(
    name: &str,
    seed: u64,
    problem: &Ccp,
    oracle: &crate::common::Oracle,
    tolerance: f64,
) -> bool {
    let (g, report) = solve(name, problem, None, tolerance);
    let scale = ResidualScale::new(problem);
    for i in 0..problem.num_contacts() {
        let excess = g[3 * i + 1].hypot(g[3 * i + 2]) - problem.friction[i] * g[3 * i];
        let size = (scale.velocity / scale.eta[i]).max(g[3 * i].abs());
        assert!(excess <= 1e-9 * size, "{name}, seed {seed}: outside the cone");
    }
    let mut u = vec![0.0; g.len()];
    problem.delassus.multiply(&g, &mut u, &mut problem.delassus.work());
    for (u, r) in u.iter_mut().zip(&problem.r) {
        *u += r;
    }
    let truth = scale.residual(problem, &g, &u, FrictionModel::Relaxed);
    assert_eq!(truth, report.residual, "{name}, seed {seed}");
    assert_eq!(report.converged(), report.residual.max <= tolerance, "{name}, seed {seed}");

    // Rounding may leave g a hair outside the cones.
    let (g, u) = feasible(problem, &g);
    let (best, best_u) = feasible(problem, &oracle.impulse);
    let (objective, optimum) = (problem.objective(&g, &u), problem.objective(&best, &best_u));
    let oracle_residual = scale.residual(problem, &best, &best_u, FrictionModel::Relaxed).max;
    // Rounding of the objectives themselves.
    let terms = g.iter().chain(&best).zip(problem.r.iter().chain(&problem.r));
    let size = 1e-13 * terms.map(|(g, r)| (g * r).abs()).sum::<f64>();
    let below = gap_bound(problem, &scale, &best, &best_u, &g, oracle_residual * scale.velocity) + size;
    assert!(
        objective >= optimum - below,
        "{name}, seed {seed}: objective {objective} more than {below:e} below the optimum {optimum}"
    );
    if report.converged() {
        // With the residual that was asked for: the claim, not what the evaluation above found.
        let above = gap_bound(problem, &scale, &g, &u, &best, 1.001 * tolerance * scale.velocity) + size;
        assert!(
            objective <= optimum + above,
            "{name}, seed {seed}: objective {objective} more than {above:e} above the optimum {optimum}, {report:?}"
        );
    }
    report.converged()
}

fn check_seeds(seeds: std::ops::Range<u64>, tolerance: f64) {
    let mut converged = vec![0; FIRST_ORDER.len()];
    let (total, mut failed_oracles) = (seeds.end - seeds.start, 0);
    for seed in seeds {
        let problem = random_problem(seed);
        let oracle = clarabel(&problem);
        if oracle.residual(&problem) > tolerance {
            // Its answer still bounds the optimum from above.
            println!("seed {seed}: Clarabel itself stops at {:.1e}", oracle.residual(&problem));
            failed_oracles += 1;
        }
        for (name, converged) in FIRST_ORDER.iter().zip(&mut converged) {
            let form = if seed % 2 == 0 { problem.clone() } else { sparse_form(&problem) };
            *converged += usize::from(check_against_oracle(name, seed, &form, &oracle, tolerance));
        }
    }
    assert!(20 * failed_oracles <= total, "the oracle failed on {failed_oracles} of {total}");
    for (name, converged) in FIRST_ORDER.iter().zip(converged) {
        println!("{name}: {converged} of {total} converged to {tolerance:e}");
        assert!(converged > 0, "{name} converged nowhere");
    }
}

#[test]
fn random_problems_agree_with_clarabel() {
    check_seeds(0..40, 1e-6);
}

#[test]
#[ignore = "the full set of 1000 problems takes minutes"]
fn a_thousand_random_problems_agree_with_clarabel() {
    check_seeds(0..1000, 1e-6);
}

#[test]
fn warm_start_saves_iterations() {
    let mut problem = lattice_packing(8, 6, 0.3, 1);
    for name in FIRST_ORDER {
        let (g, _) = solve(name, &problem, None, 1e-3);
        let before = problem.r.clone();
        for (k, r) in problem.r.iter_mut().enumerate() {
            *r += 1e-4 * (k as f64).sin();
        }
        let (_, again) = solve(name, &problem, None, 1e-3);
        let (_, warm) = solve(name, &problem, Some(&g), 1e-3);
        println!("{name}: {} iterations cold, {} warm", again.iterations, warm.iterations);
        assert!(warm.converged() && warm.iterations < again.iterations, "{name}: {again:?} {warm:?}");
        problem.r = before;
    }
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let large = lattice_packing(12, 8, 0.3, 2);
    let small = lattice_packing(10, 5, 0.3, 2);
    assert!(3 * small.num_contacts() > graintrain_linalg::parallel::CHUNK);
    for name in FIRST_ORDER {
        // At tolerance 0 `auto` takes the interior point, whose factorisations of the large one take minutes.
        let (problem, iterations) = if *name == "auto" { (&small, 3) } else { (&large, 40) };
        for form in [problem.clone(), sparse_form(problem)] {
            let with = |threads| {
                let settings = SolveSettings {
                    max_iterations: Some(iterations),
                    tolerance: 0.0,
                    ..SolveSettings::default()
                };
                let mut g = vec![0.0; 3 * form.num_contacts()];
                let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| solver.solve(&form, &mut g, &settings)).unwrap();
                g
            };
            let one = with(1);
            assert!(one.iter().any(|&g| g != 0.0));
            assert!(one == with(2) && one == with(3), "{name}");
        }
    }
}

/// Asked for more than rounding allows, a method must end near what it can reach: images kept by updates
/// drift.
#[test]
fn an_unreachable_tolerance_does_not_drive_the_iterates_away() {
    let problem = lattice_packing(6, 5, 0.3, 3);
    for name in ["apgd", "bb"] {
        for tolerance in [1e-13, 3e-14, 1e-14, 1e-15] {
            let (_, report) = solve(name, &problem, None, tolerance);
            println!("{name}, {tolerance:e}: {:.1e}", report.residual.max);
            assert!(report.residual.max < 1e-12, "{name}, {tolerance:e}: {report:?}");
        }
    }
}

/// One contact with N = I/m, approaching with (u_n, u_t): Coulomb's law stops the normal approach exactly,
/// g_n = m u_n, and the tangential impulse is m u_t if the cone allows it, mu g_n against the slip otherwise.
#[test]
fn exact_coulomb_friction_of_one_contact() {
    for name in FIRST_ORDER {
        for (mu, tangential) in [(0.5, 0.2), (0.5, 3.0), (0.0, 1.0), (2.0, 1.0), (0.3, 10.0)] {
            let problem = sliding_point(2.0, mu, tangential, 1.0);
            let mut g = vec![0.0; 3];
            let settings = SolveSettings {
                tolerance: 1e-10,
                friction: FrictionModel::Coulomb,
                ..SolveSettings::default()
            };
            let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
            let report = solver.solve(&problem, &mut g, &settings).unwrap();
            assert!(report.converged(), "{name}, mu {mu}: {report:?}");
            assert_eq!(report.residual, report.residual_coulomb);
            let expected = [2.0, -f64::min(2.0 * tangential, mu * 2.0), 0.0];
            for k in 0..3 {
                assert!((g[k] - expected[k]).abs() < 1e-8, "{name}, mu {mu}: {g:?} instead of {expected:?}");
            }
        }
    }
}

/// A sheared packing: the exact problem is solved, differs from the relaxed one, and the outer iteration is
/// short.
#[test]
fn exact_coulomb_friction_of_a_packing() {
    let problem = lattice_packing(6, 5, 0.3, 3);
    for name in ["apgd", "bb", "auto"] {
        for form in [problem.clone(), sparse_form(&problem)] {
            let mut g = vec![0.0; 3 * problem.num_contacts()];
            let settings = SolveSettings {
                tolerance: 1e-6,
                friction: FrictionModel::Coulomb,
                ..SolveSettings::default()
            };
            let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
            let report = solver.solve(&form, &mut g, &settings).unwrap();
            println!("{name}: {report:?}");
            assert!(report.converged(), "{name}: {report:?}");
            assert!(report.residual_relaxed.max > 1e-3, "{name}: {report:?}");
        }
    }
}

/// eta |g - P(g - u~/eta)| / V at its largest, u~ = u + mu |u_t| n, evaluated here from the entries of N
/// alone.
fn exact_residual(problem: &Ccp, g: &[f64]) -> f64 {
    let n = sparse_form(problem);
    let scale = ResidualScale::new(problem);
    let mut u = vec![0.0; g.len()];
    n.delassus.multiply(g, &mut u, &mut n.delassus.work());
    let mut largest = 0.0_f64;
    for i in 0..problem.num_contacts() {
        let mu = problem.friction[i];
        let [un, ut, us] = [0, 1, 2].map(|k| u[3 * i + k] + problem.r[3 * i + k]);
        let z = [un + mu * ut.hypot(us), ut, us];
        let z: [f64; 3] = std::array::from_fn(|k| g[3 * i + k] - z[k] / scale.eta[i]);
        let slip = z[1].hypot(z[2]);
        let image = if mu * slip <= -z[0] {
            [0.0; 3]
        } else if slip <= mu * z[0] {
            z
        } else {
            let normal = (z[0] + mu * slip) / (1.0 + mu * mu);
            [normal, mu * normal * z[1] / slip, mu * normal * z[2] / slip]
        };
        let square: f64 = (0..3).map(|k| (g[3 * i + k] - image[k]).powi(2)).sum();
        largest = largest.max(scale.eta[i] * square.sqrt() / scale.velocity);
    }
    largest
}

/// Not every problem need have a solution with exact friction, but nearly all are solved, and no claim is
/// false.
#[test]
fn a_thousand_random_problems_with_exact_friction() {
    let settings =
        SolveSettings { tolerance: 1e-6, friction: FrictionModel::Coulomb, ..SolveSettings::default() };
    let mut unsolved = Vec::new();
    for seed in 1000..2000 {
        let problem = random_problem(seed);
        let mut solver = "auto".parse::<SolverSpec>().unwrap().build().unwrap();
        let mut g = vec![0.0; 3 * problem.num_contacts()];
        let report = solver.solve(&problem, &mut g, &settings).unwrap();
        if report.converged() {
            let residual = exact_residual(&problem, &g);
            assert!(residual <= 1.01e-6, "seed {seed}: {residual:e}, reported {:e}", report.residual.max);
        } else {
            unsolved.push((seed, report.residual.max));
        }
    }
    println!("unsolved: {unsolved:?}");
    assert!(unsolved.len() <= 10, "{unsolved:?}");
}

/// A solve that its limit ends far from a solution is finished from below: impulses in their cones that take
/// energy, contacts that do not approach, and an answer that says that it is not the exact one.
#[test]
fn a_solve_that_ran_out_is_finished_without_approach() {
    let (mut eligible, mut finished) = (0, 0);
    for seed in 1000..1300 {
        let problem = random_problem(seed);
        let mut settings = SolveSettings {
            tolerance: 1e-6,
            friction: FrictionModel::Coulomb,
            max_iterations: Some(5),
            ..SolveSettings::default()
        };
        let mut solve = || {
            let mut g = vec![0.0; 3 * problem.num_contacts()];
            let mut solver = "auto".parse::<SolverSpec>().unwrap().build().unwrap();
            let report = solver.solve(&problem, &mut g, &settings).unwrap();
            settings.finish = 90_000;
            (g, report)
        };
        let [(_, before), (g, after)] = [solve(), solve()];
        let is_finished = after.solver.contains("ipm");
        let is_far = before.residual.max > 0.03;
        eligible += usize::from(is_far);
        assert!(!is_finished || before.residual.max > 0.03, "seed {seed}: {before:?}");
        if !is_finished {
            continue;
        }
        finished += 1;
        let residual = exact_residual(&problem, &g);
        assert!((residual - after.residual.max).abs() <= 1e-6 * residual + 1e-9, "seed {seed}: {residual:e}");
        assert_eq!(after.converged(), residual <= 1e-6, "seed {seed}: {after:?}");
        let mut u = vec![0.0; g.len()];
        problem.velocity(&g, &mut u, &mut problem.delassus.work());
        let scale = ResidualScale::new(&problem);
        let mut power = 0.0;
        for (i, (g, u)) in g.chunks_exact(3).zip(u.chunks_exact(3)).enumerate() {
            assert!(u[0] >= -0.11 * scale.velocity, "seed {seed}: contact {i} approaches by {}", -u[0]);
            assert!(g[1].hypot(g[2]) <= problem.friction[i] * g[0] * (1.0 + 1e-9) + 1e-12);
            power += (0..3).map(|k| g[k] * u[k]).sum::<f64>();
        }
        let size = scale.velocity * g.iter().map(|g| g.abs()).sum::<f64>();
        assert!(power <= 1e-3 * size, "seed {seed}: impulses make energy, {power:e} of {size:e}");
    }
    println!("{finished} of {eligible} were finished");
    assert!(10 * finished >= 9 * eligible && eligible > 50);
}

/// What a solver was given before changes nothing: a resumed run has the bits of an uninterrupted one.
#[test]
fn solvers_remember_nothing_of_other_problems() {
    let (before, problem) = (lattice_packing(5, 4, 0.3, 1), lattice_packing(5, 4, 0.5, 2));
    for method in Method::available() {
        let spec = SolverSpec::from(method);
        if spec.keeps_between_steps() {
            continue;
        }
        for friction in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
            let settings = SolveSettings {
                friction,
                tolerance: 1e-5,
                max_iterations: Some(300),
                ..SolveSettings::default()
            };
            let solve = |solver: &mut dyn CcpSolver, problem: &Ccp| {
                let mut g = vec![0.0; problem.r.len()];
                solver.solve(problem, &mut g, &settings).unwrap();
                g.iter().map(|g| g.to_bits()).collect::<Vec<_>>()
            };
            let mut used = spec.build().unwrap();
            solve(&mut *used, &before);
            let fresh = solve(&mut *spec.build().unwrap(), &problem);
            assert!(solve(&mut *used, &problem) == fresh, "{method} {friction:?}");
        }
    }
}

/// Exact friction begins with sweeps, but with gradients where most contacts are further ones of the same
/// bodies, as in a tower of boxes.
#[test]
fn exact_friction_begins_with_sweeps_or_gradients() {
    let first = |problem: &Ccp| {
        let settings =
            SolveSettings { friction: FrictionModel::Coulomb, tolerance: 1e-6, ..SolveSettings::default() };
        let mut solver = "auto".parse::<SolverSpec>().unwrap().build().unwrap();
        let report = solver.solve(problem, &mut vec![0.0; problem.r.len()], &settings).unwrap();
        assert!(report.converged(), "{report:?}");
        report.stages[0].solver.clone()
    };
    assert_eq!(first(&lattice_packing(4, 3, 0.3, 1)), "apgs");
    let corner = |level: u32, k: usize| {
        let [x, y] = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]][k].map(|s: f64| 0.1 * s);
        RigidContact {
            body_a: level,
            body_b: if level == 0 { FIXED } else { level - 1 },
            frame: [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            arm_a: [x, y, -0.1],
            arm_b: [x, y, 0.1],
        }
    };
    let contacts: Vec<_> = (0..10).flat_map(|level| (0..4).map(move |k| corner(level, k))).collect();
    let mass =
        BodyInverseMass { linear: [0.125; 3], angular: [18.75, 0.0, 0.0, 0.0, 18.75, 0.0, 0.0, 0.0, 18.75] };
    let falling = contacts.iter().flat_map(|_| [-0.05, 0.0, 0.0]);
    let r = falling.zip(0..).map(|(r, k)| if k < 12 { r } else { 0.0 }).collect();
    let friction = vec![0.5; contacts.len()];
    let tower = Ccp::new(Delassus::Rigid(RigidDelassus::new(contacts, vec![mass; 10])), r, friction).unwrap();
    assert_eq!(first(&tower), "apgd");
}
