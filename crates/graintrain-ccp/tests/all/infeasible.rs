//! Problems without a solution: the certificate by itself, against Clarabel, and in the solvers that look for
//! it.

use crate::common::{Random, ball, cross, frame, random_problem, sparse_form, with_turning};
use clarabel::solver::SolverStatus;
use graintrain_ccp::solver::infeasible::{CERTAIN, PROBABLE, certificate, needed_velocity};
use graintrain_ccp::{
    Ccp, Delassus, FIXED, FrictionModel, RigidContact, RigidDelassus, SolveReport, SolveSettings, SolverSpec,
    Status, TurningFriction, TurningRows,
};
use graintrain_linalg::block3::BlockMatrix3;
use std::sync::Arc;

fn solve(name: &str, problem: &Ccp, tolerance: f64) -> (Vec<f64>, SolveReport) {
    let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
    let mut g = vec![0.0; problem.r.len()];
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

/// The longest arm of a body's contacts or length of its turning rows.
fn longest_arm(rigid: &RigidDelassus, body: usize) -> f64 {
    let of = |contact: usize| [rigid.contacts()[contact].body_a, rigid.contacts()[contact].body_b];
    let turns = rigid.turning().iter().filter(|rows| of(rows.contact as usize).contains(&(body as u32)));
    let arms = rigid.sides(body).iter().map(|side| norm(&side.arm));
    arms.chain(turns.map(|rows| rows.length)).fold(0.0, f64::max)
}

/// V of a ray written out from its meaning: asserts that it is in the cones, part by part, and adds up what
/// it does to every body, contact by contact.
fn proved(problem: &Ccp, ray: &[f64]) -> f64 {
    let (rigid, contacts) = (rigid(problem), problem.num_contacts());
    let mut on_bodies = vec![[0.0; 6]; rigid.num_bodies()];
    let mut add = |body: u32, sign: f64, force: [f64; 3], moment: [f64; 3]| {
        if body != FIXED {
            let sum = &mut on_bodies[body as usize];
            (0..3).for_each(|k| {
                (sum[k], sum[3 + k]) = (sum[k] + sign * force[k], sum[3 + k] + sign * moment[k])
            });
        }
    };
    let in_world = |frame: [[f64; 3]; 3], g: &[f64]| -> [f64; 3] {
        std::array::from_fn(|axis| (0..3).map(|k| frame[k][axis] * g[k]).sum())
    };
    for (i, contact) in rigid.contacts().iter().enumerate() {
        let g = &ray[3 * i..3 * i + 3];
        assert!(g[1].hypot(g[2]) <= problem.friction[i] * g[0], "contact {i}: {g:?}");
        let force = in_world(contact.frame, g);
        add(contact.body_a, 1.0, force, cross(contact.arm_a, force));
        add(contact.body_b, -1.0, force, cross(contact.arm_b, force));
    }
    for (k, (law, rows)) in problem.turning.iter().zip(rigid.turning()).enumerate() {
        let (normal, first) = (ray[3 * law.contact as usize], 3 * (contacts + k));
        let h = &ray[first..first + 3];
        assert!(h[1].hypot(h[2]) <= law.rolling * normal && h[0].abs() <= law.spinning * normal, "{h:?}");
        let contact = &rigid.contacts()[rows.contact as usize];
        let moment = in_world(contact.frame, h).map(|x| x * rows.length);
        add(contact.body_a, 1.0, [0.0; 3], moment);
        add(contact.body_b, -1.0, [0.0; 3], moment);
    }
    let moved =
        |(body, sum): (usize, &[f64; 6])| norm(&sum[..3]) + norm(&sum[3..]) / longest_arm(rigid, body);
    let moved: f64 = on_bodies.iter().enumerate().filter(|(_, sum)| norm(*sum) > 0.0).map(moved).sum();
    let asked = -ray.iter().zip(&problem.r).map(|(g, r)| g * r).sum::<f64>();
    asked / moved / problem.r.chunks_exact(3).map(norm).fold(0.0, f64::max)
}

/// Largest change of velocity, spin times longest arm, that impulses give to a body, over the largest |r_i|.
fn velocity_change(problem: &Ccp, g: &[f64]) -> f64 {
    let rigid = rigid(problem);
    let (mut force, mut v) = (vec![0.0; g.len()], vec![0.0; 6 * rigid.num_bodies()]);
    rigid.world_impulse(g, &mut force);
    rigid.velocity_change(&force, &mut v);
    let fastest = (0..rigid.num_bodies())
        .map(|b| {
            let arm = longest_arm(rigid, b);
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

/// [`jammed_problem`] with contacts that resist turning, at random turning velocities.
fn closing_walls(seed: u64) -> Ccp {
    let plain = jammed_problem(seed);
    let mut problem = with_turning(&plain, seed);
    problem.r[..plain.r.len()].copy_from_slice(&plain.r);
    problem
}

/// A random problem with a ball between two walls that neither close nor part, but turn each in its own way:
/// relaxed friction parts every contact that rolls, and here both would have to.
fn turning_walls(seed: u64) -> Ccp {
    let mut random = Random::new(seed ^ 0x7011);
    let base = random_problem(seed);
    let (mut contacts, mut masses) = (rigid(&base).contacts().to_vec(), rigid(&base).inverse_mass().to_vec());
    let (mut r, mut friction) = (base.r.clone(), base.friction.clone());
    masses.push(ball(10.0_f64.powf(4.0 * random.unit() - 2.0), 1.0));
    let (body_a, first, n) = (masses.len() as u32 - 1, contacts.len() as u32, random.direction());
    for n in [n, n.map(|x| -x)] {
        let frame = frame(n);
        contacts.push(RigidContact { body_a, body_b: FIXED, frame, arm_a: n.map(|x| -x), arm_b: [0.0; 3] });
        r.extend([0.0; 3]);
        friction.push(random.unit());
    }
    let rows = |contact| TurningRows { contact, length: 0.3 + 0.1 * f64::from(contact - first) };
    let delassus = RigidDelassus::new(contacts, masses).with_turning([first, first + 1].map(rows).to_vec());
    let turning = [first, first + 1].map(|contact| TurningFriction {
        contact,
        rolling: 0.05 + 0.4 * random.unit(),
        spinning: if random.below(3) == 0 { 0.0 } else { 0.5 * random.unit() },
    });
    r.extend((0..6).map(|_| random.signed()));
    Ccp::with_turning(Delassus::Rigid(delassus), r, friction, turning.to_vec()).unwrap()
}

fn clarabel_says_infeasible(problem: &Ccp) -> bool {
    matches!(clarabel_status(problem), SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible)
}

/// min 1/2 |v|^2 with D^T v + r in the dual cones, by Clarabel: what it says about such a v. Of a contact
/// that turns u_n = a + b + c with (a, mu u_t), (b, rolling w_t) and (c, spinning w_n) in second-order cones,
/// b and c unknowns of their own.
fn clarabel_status(problem: &Ccp) -> SolverStatus {
    use clarabel::algebra::CscMatrix;
    use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
    let (rigid, contacts) = (rigid(problem), problem.num_contacts());
    let (bodies, turning) = (6 * rigid.num_bodies(), problem.turning.len());
    let (rows, columns) = (3 * contacts + 5 * turning, bodies + 2 * turning);
    let (mut dense, mut b) = (vec![vec![0.0; columns]; rows], vec![0.0; rows]);
    // Line of every row of D^T, and its coefficient.
    let place = |k: usize| match (k / 3).checked_sub(contacts) {
        None => (k, if k.is_multiple_of(3) { 1.0 } else { problem.friction[k / 3] }),
        Some(entry) => {
            let (first, law) = (3 * contacts + 5 * entry, problem.turning[entry]);
            [(first + 4, law.spinning), (first + 1, law.rolling), (first + 2, law.rolling)][k % 3]
        }
    };
    let (mut unit, mut image) = (vec![0.0; bodies], vec![0.0; problem.r.len()]);
    for column in 0..bodies {
        unit[column] = 1.0;
        rigid.relative_velocity(&unit, &mut image);
        unit[column] = 0.0;
        for (k, image) in image.iter().enumerate() {
            let (line, coefficient) = place(k);
            dense[line][column] = -coefficient * image;
        }
    }
    for (k, r) in problem.r.iter().enumerate() {
        let (line, coefficient) = place(k);
        b[line] = coefficient * r;
    }
    for (entry, law) in problem.turning.iter().enumerate() {
        for part in 0..2 {
            let column = bodies + 2 * entry + part;
            dense[3 * law.contact as usize][column] = 1.0;
            dense[3 * contacts + 5 * entry + 3 * part][column] = -1.0;
        }
    }
    let a = CscMatrix::from(&dense);
    let diagonal = (0..columns).map(|k| if k < bodies { 1.0 } else { 0.0 }).collect();
    let p = CscMatrix::new(columns, columns, (0..=columns).collect(), (0..columns).collect(), diagonal);
    let settings = DefaultSettingsBuilder::default().verbose(false).build().unwrap();
    let mut cones = vec![SupportedConeT::SecondOrderConeT(3); contacts];
    let of_turning = [SupportedConeT::SecondOrderConeT(3), SupportedConeT::SecondOrderConeT(2)];
    cones.extend(std::iter::repeat_n(of_turning, turning).flatten());
    let mut solver = DefaultSolver::new(&p, &vec![0.0; columns], &a, &b, &cones, settings).unwrap();
    solver.solve();
    solver.solution.status
}

/// The bound itself, from the definition: no impulses whatever ask for more than a solution has, over bodies
/// and over the rows of N.
#[test]
fn no_ray_asks_for_more_than_the_solution_gives() {
    let mut checked = 0;
    for seed in 0..100 {
        let plain = random_problem(seed);
        for (problem, name) in [(with_turning(&plain, seed), "auto"), (plain, "ipm")] {
            let (g, report) = solve(name, &problem, 1e-10);
            if report.residual.max > 1e-9 {
                continue;
            }
            let mut u = vec![0.0; g.len()];
            problem.delassus.multiply(&g, &mut u, &mut problem.delassus.work());
            let eta = problem.diagonal_scale();
            let owner = |block: usize| match block.checked_sub(problem.num_contacts()) {
                Some(entry) => problem.turning[entry].contact as usize,
                None => block,
            };
            let largest = |x: &[f64]| x.chunks_exact(3).map(norm).fold(0.0, f64::max);
            let impulse = g.chunks_exact(3).enumerate().map(|(block, g)| eta[owner(block)] * norm(g));
            let of_rows = largest(&u).max(1e-6 * impulse.fold(0.0, f64::max)) / largest(&problem.r);
            let given = [velocity_change(&problem, &g), of_rows];
            let mut random = Random::new(seed);
            let mut candidates = vec![g.clone(), certificate(&problem).unwrap().ray];
            for _ in 0..20 {
                candidates.push(g.iter().map(|g| g * (1.0 + 0.1 * random.signed())).collect());
                candidates.push(g.iter().map(|_| random.signed()).collect());
            }
            for (form, given) in [problem.clone(), sparse_form(&problem)].iter().zip(given) {
                for candidate in &candidates {
                    let needed = needed_velocity(form, candidate).unwrap();
                    assert!(needed <= given * (1.0 + 1e-6) + 1e-12, "{seed}: {needed:e} of {given:e}");
                }
            }
            checked += 1;
        }
    }
    println!("{checked} of 200");
    assert!(checked > 150, "{checked}");
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
        let plain = random_problem(seed);
        let plain_solvers = ["ipm+cholesky", "scip", "pdip"];
        // Stalls take 100 000 iterations each.
        let rolling_solvers: &[&str] = if seed.is_multiple_of(15) { &["auto"] } else { &[] };
        for (problem, names) in [(with_turning(&plain, seed), rolling_solvers), (plain, &plain_solvers)] {
            for form in [problem.clone(), sparse_form(&problem)] {
                for asked in [&form, &frictionless(&form)] {
                    let found = certificate(asked).unwrap().needed_velocity;
                    assert!(found < 0.1 * PROBABLE, "{seed}: {found:e}");
                    largest = largest.max(found);
                }
                for name in names {
                    // Asked for more than they reach, so that all of them stall.
                    let (_, report) = solve(name, &form, 1e-15);
                    assert_ne!(report.status, Status::Infeasible, "{name}, {seed}");
                }
            }
        }
    }
    println!("the largest velocity that was asked for: {largest:.1e}");
}

/// Exact friction has no solution where this problem has none: contacts must not close.
fn frictionless(problem: &Ccp) -> Ccp {
    let law = |law: &TurningFriction| TurningFriction { rolling: 0.0, spinning: 0.0, ..*law };
    let turning = problem.turning.iter().map(law).collect();
    Ccp { friction: vec![0.0; problem.num_contacts()], turning, ..problem.clone() }
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

/// Relaxed and exact friction of problems whose contacts roll: what is proved, against the ray written out
/// and against Clarabel; nothing is said of exact friction that has a solution.
fn claims_on_rolling_problems(seeds: std::ops::Range<u64>) {
    let (mut infeasible, mut confirmed, mut solved) = (0, 0, 0);
    let (mut proved_over, mut said) = ([0; 2], [0; 2]);
    for seed in seeds {
        for (problem, is_closing) in [(closing_walls(seed), true), (turning_walls(seed), false)] {
            infeasible += 1;
            let exact = certificate(&frictionless(&problem)).unwrap().needed_velocity;
            assert_eq!(exact >= PROBABLE, is_closing, "{seed}: {exact:e}");
            for (form, proved_over) in [problem.clone(), sparse_form(&problem)].iter().zip(&mut proved_over) {
                let found = certificate(form).unwrap();
                let mut ray = found.ray.clone();
                problem.project(&mut ray);
                // Rounding of the projection must not leave it outside.
                ray.iter_mut().enumerate().for_each(|(k, g)| {
                    *g *= if k % 3 == 0 && k < 3 * problem.num_contacts() { 1.0 } else { 1.0 - 1e-15 }
                });
                if found.needed_velocity >= PROBABLE {
                    *proved_over += 1;
                    assert!(proved(&problem, &ray) > 0.1 * PROBABLE, "{seed}");
                }
            }
            let laws =
                [(&problem, FrictionModel::Relaxed), (&frictionless(&problem), FrictionModel::Coulomb)];
            // The race of exact friction may go on for minutes before there is a search.
            for (asked, friction) in laws.into_iter().take(if seed < 12 { 2 } else { 1 }) {
                let is_exact = friction == FrictionModel::Coulomb;
                let mut g = vec![0.0; problem.r.len()];
                // Where exact friction has a solution it need not be found.
                let (tolerance, max_iterations) = (1e-6, (is_exact && !is_closing).then_some(300_000));
                let settings =
                    SolveSettings { tolerance, max_iterations, friction, ..SolveSettings::default() };
                let mut solver = "auto".parse::<SolverSpec>().unwrap().build().unwrap();
                let report = solver.solve(&problem, &mut g, &settings).unwrap();
                if report.status == Status::Infeasible {
                    assert!(report.remark.is_some_and(|remark| remark.contains("proved")));
                    assert!(is_closing || !is_exact, "{seed}: exact friction has a solution");
                    // Clarabel may fail to say so, but must not have found a solution.
                    let oracle = clarabel_status(asked);
                    assert!(
                        !matches!(oracle, SolverStatus::Solved | SolverStatus::AlmostSolved),
                        "{seed} {friction}"
                    );
                    confirmed += usize::from(oracle == SolverStatus::PrimalInfeasible);
                    said[usize::from(is_exact)] += 1;
                } else {
                    assert!(is_exact && !is_closing, "{seed} {friction}: {report:?}");
                    solved += usize::from(report.converged());
                }
            }
        }
    }
    println!(
        "{infeasible} without a solution: proved {proved_over:?} over bodies and rows, said {said:?}, \
         {confirmed} of these by Clarabel, {solved} solved with exact friction"
    );
    assert!(solved >= 11, "{solved}");
    assert!(confirmed * 10 >= said.iter().sum::<usize>() * 8, "{confirmed}");
    assert_eq!((proved_over[0], said), (infeasible, [infeasible, 12]));
    assert!(proved_over[1] * 10 >= infeasible * 9, "{proved_over:?}");
}

#[test]
fn rolling_problems_without_a_solution_are_proved() {
    claims_on_rolling_problems(0..12);
}

#[test]
#[ignore = "200 problems take a minute"]
fn two_hundred_rolling_problems() {
    claims_on_rolling_problems(0..100);
}

/// A ball between closing walls that give, however little, has a solution.
#[test]
fn compliant_walls_keep_a_wedged_ball_apart() {
    for seed in 0..10 {
        let problem = closing_walls(seed);
        let rigid = rigid(&problem).clone().with_compliance(vec![1.0; problem.num_contacts()]);
        let compliant = Ccp { delassus: Arc::new(Delassus::Rigid(rigid)), ..problem.clone() };
        let found = certificate(&problem).unwrap();
        assert!(found.needed_velocity >= PROBABLE);
        assert!(needed_velocity(&compliant, &found.ray).unwrap() < PROBABLE);
        assert!(certificate(&compliant).unwrap().needed_velocity < PROBABLE);
    }
}

/// A heavy ball on a light one has a solution of large impulses: as a matrix as well as over bodies that is
/// none of the kind that no ball could have.
#[test]
fn a_heavy_body_on_a_light_one_is_not_called_infeasible() {
    for decades in 0..=10 {
        let on = |body_a: u32, body_b: u32| {
            let n = [0.0, 0.0, 1.0];
            RigidContact { body_a, body_b, frame: frame(n), arm_a: n.map(|x| -x), arm_b: n }
        };
        let balls = vec![ball(1.0, 1.0), ball(10.0_f64.powi(decades), 1.0)];
        let rigid = RigidDelassus::new(vec![on(0, FIXED), on(1, 0)], balls);
        let r = vec![0.0, 0.1, 0.0, -1.0, 0.1, 0.0];
        let plain = Ccp::new(Delassus::Rigid(rigid), r.clone(), vec![0.3; 2]).unwrap();
        let mut rolling = with_turning(&plain, 1);
        rolling.r[..6].copy_from_slice(&r);
        for (problem, name) in [(plain, "ipm"), (rolling, "auto")] {
            for form in [problem.clone(), sparse_form(&problem)] {
                let found = certificate(&form).unwrap().needed_velocity;
                assert!(found < PROBABLE, "{name}, 1e{decades}: {found:e}");
                assert_ne!(solve(name, &form, 1e-12).1.status, Status::Infeasible, "{name}, 1e{decades}");
            }
        }
    }
}

/// Of a matrix that is not symmetric impulses that change nothing are those of the transpose: g^T W = 0.
#[test]
fn a_ray_of_an_asymmetric_matrix_is_one_of_its_rows() {
    let entries = |a: f64, b: f64| {
        let block = |x: f64| [x, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let rows = vec![block(1.0), block(a), block(b), block(a * b)];
        Delassus::Sparse(BlockMatrix3::from_rows(vec![0, 2, 4], vec![0, 1, 0, 1], rows))
    };
    let ray = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    for (a, b, proves) in [(-1.0, -1.0, true), (-2.0, -1.0, true), (-1.0, -2.0, false)] {
        let r = vec![-1.0, 0.0, 0.0, -1.0, 0.0, 0.0];
        let problem = Ccp::new(entries(a, b), r, vec![0.0; 2]).unwrap();
        let needed = needed_velocity(&problem, &ray).unwrap();
        assert_eq!(needed >= PROBABLE, proves, "{a} {b}: {needed:e}");
    }
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
