//! Problems without a solution: the certificate by itself, against Clarabel, and in the solvers that look for
//! it.

use crate::common::{Random, ball, frame, random_problem, sparse_form};
use graintrain_ccp::solver::infeasible::{CERTAIN, PROBABLE, certificate, needed_velocity};
use graintrain_ccp::{Ccp, Delassus, FIXED, RigidContact, RigidDelassus};
use graintrain_ccp::{SolveReport, SolveSettings, SolverSpec, Status};
use std::sync::Arc;

fn solve(name: &str, problem: &Ccp, tolerance: f64) -> (Vec<f64>, SolveReport) {
    let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
    let mut g = vec![0.0; 3 * problem.num_contacts()];
    let settings = SolveSettings { tolerance, ..SolveSettings::default() };
    let report = solver.solve(problem, &mut g, &settings).unwrap();
    (g, report)
}

fn rigid(problem: &Ccp) -> &RigidDelassus {
    match &*problem.delassus {
        Delassus::Rigid(rigid) => rigid,
        Delassus::Sparse(_) => unreachable!("the generators make bodies"),
    }
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Largest change of velocity, spin times longest arm, that impulses give to a body, over the largest |r_i|.
fn velocity_change(problem: &Ccp, g: &[f64]) -> f64 {
    let rigid = rigid(problem);
    let (mut force, mut v) = (vec![0.0; g.len()], vec![0.0; 6 * rigid.num_bodies()]);
    rigid.world_impulse(g, &mut force);
    rigid.velocity_change(&force, &mut v);
    let fastest = (0..rigid.num_bodies())
        .map(|b| {
            let arm = rigid.sides(b).iter().map(|side| norm(&side.arm)).fold(0.0, f64::max);
            norm(&v[6 * b..6 * b + 3]).max(arm * norm(&v[6 * b + 3..6 * b + 6]))
        })
        .fold(0.0, f64::max);
    fastest / problem.r.chunks_exact(3).map(norm).fold(0.0, f64::max)
}

/// A random problem with a ball that `walls` prescribed walls close on from all sides: three to five contacts
/// with normals that balance, each asked to open.
fn jammed_problem(seed: u64) -> Ccp {
    let mut random = Random::new(seed ^ 0x5EED);
    let base = random_problem(seed);
    let (mut contacts, mut masses) = (rigid(&base).contacts().to_vec(), rigid(&base).inverse_mass().to_vec());
    let (mut r, mut friction) = (base.r.clone(), base.friction.clone());
    // Half of the problems: the ball takes part in the rest, too.
    let body = if random.below(2) == 0 {
        masses.push(ball(10.0_f64.powf(4.0 * random.unit() - 2.0), 1.0));
        masses.len() - 1
    } else {
        random.below(masses.len())
    };
    let walls = 2 + random.below(4);
    let mut normals: Vec<[f64; 3]> = (1..walls).map(|_| random.direction()).collect();
    let sum: [f64; 3] = std::array::from_fn(|k| normals.iter().map(|n| n[k]).sum());
    let length = norm(&sum).max(1e-3);
    normals.push(sum.map(|x| -x / length));
    let closing = 10.0_f64.powf(-3.0 * random.unit());
    for n in normals {
        contacts.push(RigidContact {
            body_a: body as u32,
            body_b: FIXED,
            frame: frame(n),
            arm_a: n.map(|x| -0.7 * x),
            arm_b: [0.0; 3],
        });
        // The walls' closing speed, on top of a motion of the ball that is free to be anything.
        r.extend([-closing, 0.2 * random.signed() * closing, 0.0]);
        friction.push(random.unit());
    }
    Ccp::new(Delassus::Rigid(RigidDelassus::new(contacts, masses)), r, friction).unwrap()
}

/// min 1/2 |v|^2 with D^T v + r in the dual cones, by Clarabel: whether it says that there is no such v.
fn clarabel_says_infeasible(problem: &Ccp) -> bool {
    use clarabel::algebra::CscMatrix;
    use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
    let rigid = rigid(problem);
    let (rows, columns) = (3 * problem.num_contacts(), 6 * rigid.num_bodies());
    // Column by column: -(1, mu, mu) D^T e_j; velocities in units that make D of size one.
    let (mut entries, mut unit, mut image) = (Vec::new(), vec![0.0; columns], vec![0.0; rows]);
    let weight = |k: usize| if k.is_multiple_of(3) { 1.0 } else { problem.friction[k / 3] };
    for column in 0..columns {
        unit[column] = 1.0;
        rigid.relative_velocity(&unit, &mut image);
        unit[column] = 0.0;
        entries.push((0..rows).map(|k| -weight(k) * image[k]).collect::<Vec<f64>>());
    }
    let dense: Vec<Vec<f64>> = (0..rows).map(|k| entries.iter().map(|column| column[k]).collect()).collect();
    let a = CscMatrix::from(&dense);
    let b: Vec<f64> = (0..rows).map(|k| weight(k) * problem.r[k]).collect();
    let settings = DefaultSettingsBuilder::default().verbose(false).build().unwrap();
    let cones = vec![SupportedConeT::SecondOrderConeT(3); problem.num_contacts()];
    let mut solver =
        DefaultSolver::new(&CscMatrix::identity(columns), &vec![0.0; columns], &a, &b, &cones, settings)
            .unwrap();
    solver.solve();
    matches!(solver.solution.status, SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible)
}

/// The bound itself, from the definition: no impulses whatever ask for more than a solution has.
#[test]
fn no_ray_asks_for_more_than_the_solution_gives() {
    let mut checked = 0;
    for seed in 0..100 {
        let problem = random_problem(seed);
        let (g, report) = solve("ipm", &problem, 1e-10);
        if report.residual.max > 1e-9 {
            continue;
        }
        let given = velocity_change(&problem, &g);
        let mut random = Random::new(seed);
        let mut candidates = vec![g.clone(), certificate(&problem).unwrap().ray];
        for _ in 0..20 {
            candidates.push(g.iter().map(|g| g * (1.0 + 0.1 * random.signed())).collect());
            candidates.push(g.iter().map(|_| random.signed()).collect());
        }
        for candidate in candidates {
            let needed = needed_velocity(&problem, &candidate).unwrap();
            assert!(needed <= given * (1.0 + 1e-6) + 1e-12, "{seed}: {needed:e} of {given:e}");
        }
        checked += 1;
    }
    assert!(checked > 95, "{checked}");
}

/// Where there is no proof there is a solution, found on a way of its own.
#[test]
fn the_homogeneous_form_solves_problems_as_well() {
    use graintrain_ccp::residual::{FrictionModel, ResidualScale};
    let mut solved = 0;
    for seed in 0..100 {
        let problem = random_problem(seed);
        let g = certificate(&problem).unwrap().solution.expect("it is solvable");
        let mut u = vec![0.0; g.len()];
        problem.delassus.multiply(&g, &mut u, &mut problem.delassus.work());
        for (u, r) in u.iter_mut().zip(&problem.r) {
            *u += r;
        }
        let scale = ResidualScale::new(&problem);
        let residual = scale.residual(&problem, &g, &u, FrictionModel::Relaxed).max;
        solved += u32::from(residual < 1e-6);
    }
    println!("{solved} of 100 to 1e-6");
    assert!(solved >= 75, "{solved}");
}

fn no_claims_on_solvable_problems(seeds: std::ops::Range<u64>) {
    let mut largest = 0.0_f64;
    for seed in seeds {
        let problem = random_problem(seed);
        for form in [problem.clone(), sparse_form(&problem)] {
            let found = certificate(&form).unwrap().needed_velocity;
            assert!(found < 0.1 * PROBABLE, "{seed}: {found:e}");
            largest = largest.max(found);
            for name in ["ipm+cholesky", "scip", "pdip"] {
                // Asked for more than they reach, so that all of them stall.
                let (_, report) = solve(name, &form, 1e-15);
                assert_ne!(report.status, Status::Infeasible, "{name}, {seed}");
            }
        }
    }
    println!("the largest velocity that was asked for: {largest:.1e}");
}

#[test]
fn solvable_problems_are_never_called_infeasible() {
    no_claims_on_solvable_problems(0..30);
}

#[test]
#[ignore = "1000 problems take two minutes"]
fn a_thousand_solvable_problems_are_never_called_infeasible() {
    no_claims_on_solvable_problems(0..1000);
}

/// Returns how many problems were proved infeasible, of those that Clarabel says so of, and how often solvers
/// say it.
fn claims_on_jammed_problems(seeds: std::ops::Range<u64>) {
    let (mut infeasible, mut proved) = (0, 0);
    let names = ["ipm", "ipm+cholesky", "scip", "pdip"];
    let mut said = [0; 4];
    for seed in seeds {
        let problem = jammed_problem(seed);
        let found = certificate(&problem).unwrap();
        let oracle = clarabel_says_infeasible(&problem);
        if found.needed_velocity >= PROBABLE {
            proved += 1;
            // Clarabel may fail to say so, but must not have found a solution: then V would be its
            // velocities.
            let (asked, moved) = (
                found.ray.iter().zip(&problem.r).map(|(g, r)| g * r).sum::<f64>(),
                velocity_change(&problem, &found.ray),
            );
            assert!(asked < 0.0 && moved.is_finite(), "{seed}");
            for i in 0..problem.num_contacts() {
                let tangential = found.ray[3 * i + 1].hypot(found.ray[3 * i + 2]);
                assert!(tangential <= problem.friction[i] * found.ray[3 * i] * (1.0 + 1e-9) + 1e-300);
            }
        }
        if oracle {
            infeasible += 1;
            assert!(
                found.needed_velocity >= PROBABLE,
                "{seed}: Clarabel says infeasible, here {:.1e}",
                found.needed_velocity
            );
            for (said, name) in said.iter_mut().zip(names) {
                let (g, report) = solve(name, &problem, 1e-8);
                assert!(g.iter().all(|g| g.is_finite()));
                if report.status == Status::Infeasible {
                    *said += 1;
                } else {
                    println!("{seed}: {name} {:?} {:.1e}", report.status, report.residual.max);
                    assert_eq!(report.status, Status::IterationLimit, "{name}, {seed}");
                }
            }
        } else if found.needed_velocity >= PROBABLE {
            println!("{seed}: proved {:.1e}, not by Clarabel", found.needed_velocity);
        }
    }
    println!("infeasible by Clarabel {infeasible}, proved {proved}, said {names:?} {said:?}");
    assert!(infeasible > 0);
    for (said, name) in said.iter().zip(names) {
        // `scip` and `pdip` run into their limits of iterations now and then before they have stalled.
        let silent = if name.starts_with("ipm") { 0 } else { infeasible / 10 };
        assert!(*said >= infeasible - silent, "{name}: {said} of {infeasible}");
    }
}

#[test]
fn jammed_bodies_are_called_infeasible_where_clarabel_says_so() {
    claims_on_jammed_problems(0..25);
}

#[test]
#[ignore = "500 problems take a minute"]
fn five_hundred_jammed_problems() {
    claims_on_jammed_problems(0..500);
}

/// Nothing about the claim depends on units.
#[test]
fn the_certificate_has_no_units() {
    for seed in 0..10 {
        let problem = jammed_problem(seed);
        let ray = certificate(&problem).unwrap().ray;
        let needed = needed_velocity(&problem, &ray).unwrap();
        let (mass, length, time) = (1e-9, 1e3, 1e-2);
        let contacts = rigid(&problem).contacts().iter().map(|c| RigidContact {
            arm_a: c.arm_a.map(|x| x * length),
            arm_b: c.arm_b.map(|x| x * length),
            ..*c
        });
        let masses = rigid(&problem).inverse_mass().iter().map(|m| graintrain_ccp::BodyInverseMass {
            linear: m.linear.map(|x| x / mass),
            angular: m.angular.map(|x| x / (mass * length * length)),
        });
        let other = Ccp {
            delassus: Arc::new(Delassus::Rigid(RigidDelassus::new(contacts.collect(), masses.collect()))),
            r: problem.r.iter().map(|r| r * length / time).collect(),
            ..problem.clone()
        };
        let scaled: Vec<f64> = ray.iter().map(|g| g * mass * length / time).collect();
        let same = needed_velocity(&other, &scaled).unwrap();
        assert!((needed >= CERTAIN) == (same >= CERTAIN) || (needed - same).abs() < 0.5 * needed);
        let found = certificate(&other).unwrap().needed_velocity;
        assert_eq!(needed >= PROBABLE, found >= PROBABLE, "{seed}: {needed:e} {found:e}");
    }
}
