//! Shared by the tests: random problems from a fixed seed, and Clarabel as the independent oracle.
#![allow(dead_code)] // Every test file uses its own part.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
use graintrain_ccp::newton::NewtonSolver;
use graintrain_ccp::registry::{LinearMethod, Method};
use graintrain_ccp::residual::{FrictionModel, ResidualScale};
use graintrain_ccp::{
    BodyInverseMass, Ccp, CoupledBodies, Delassus, FIXED, RigidContact, RigidDelassus, TurningFriction,
    TurningRows,
};
use std::sync::Arc;

/// SplitMix64 (Steele, Lea, Flood 2014): the same numbers on every machine.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03)
    }

    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in [-1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    pub fn below(&mut self, bound: usize) -> usize {
        (self.unit() * bound as f64) as usize
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> [f64; 3] {
        loop {
            let v = [self.signed(), self.signed(), self.signed()];
            let square: f64 = v.iter().map(|x| x * x).sum();
            if (1e-4..=1.0).contains(&square) {
                return v.map(|x| x / square.sqrt());
            }
        }
    }
}

pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Rows n, t1, t2 of a right-handed frame around a unit normal.
pub fn frame(n: [f64; 3]) -> [[f64; 3]; 3] {
    let axis = if n[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let t = cross(n, axis);
    let length = t.iter().map(|x| x * x).sum::<f64>().sqrt();
    let t1 = t.map(|x| x / length);
    [n, t1, cross(n, t1)]
}

/// Inverse mass of a uniform ball.
pub fn ball(mass: f64, radius: f64) -> BodyInverseMass {
    let inertia = 0.4 * mass * radius * radius;
    let j = 1.0 / inertia;
    BodyInverseMass { linear: [1.0 / mass; 3], angular: [j, 0.0, 0.0, 0.0, j, 0.0, 0.0, 0.0, j] }
}

/// A small random CCP that has a solution: 1 to 50 contacts between a few bodies of mass ratios up to 1e6, mu
/// in [0, 2] with one contact in eight frictionless, some sides fixed, one contact in six a copy of another
/// one (redundant, so that N is singular). r = D^T v + (gap rate >= 0), which keeps v_free = -v feasible: no
/// jamming.
pub fn random_problem(seed: u64) -> Ccp {
    let mut random = Random::new(seed);
    let num_contacts = 1 + random.below(50);
    let num_bodies = 1 + random.below(num_contacts.div_ceil(2) + 1);
    let decades = 6.0 * random.unit();
    let inverse_mass: Vec<BodyInverseMass> = (0..num_bodies)
        .map(|_| {
            let mass = 10.0_f64.powf(decades * (random.unit() - 0.5));
            ball(mass, 0.5 + random.unit())
        })
        .collect();
    let mut contacts: Vec<RigidContact> = Vec::with_capacity(num_contacts);
    let mut friction = Vec::with_capacity(num_contacts);
    for i in 0..num_contacts {
        if i > 0 && random.below(6) == 0 {
            let copy = random.below(i);
            contacts.push(contacts[copy]);
            friction.push(friction[copy]);
            continue;
        }
        let body_a = random.below(num_bodies) as u32;
        let other = random.below(num_bodies + 1) as u32;
        let body_b = if other == body_a || other as usize == num_bodies { FIXED } else { other };
        let n = random.direction();
        let spread = 0.5 * random.unit();
        let tilt = random.direction();
        let arm_a = std::array::from_fn(|k| -n[k] + spread * tilt[k]);
        contacts.push(RigidContact { body_a, body_b, frame: frame(n), arm_a, arm_b: n });
        friction.push(if random.below(8) == 0 { 0.0 } else { 2.0 * random.unit() });
    }
    let v: Vec<f64> = (0..6 * num_bodies).map(|_| random.signed()).collect();
    let rigid = RigidDelassus::new(contacts, inverse_mass);
    let mut r = vec![0.0; 3 * num_contacts];
    rigid.relative_velocity(&v, &mut r);
    for i in 0..num_contacts {
        if random.below(2) == 0 {
            r[3 * i] += 0.5 * random.unit();
        }
    }
    Ccp::new(Delassus::Rigid(rigid), r, friction).expect("the generator makes valid problems")
}

/// The same problem with N as a sparse matrix.
pub fn sparse_form(problem: &Ccp) -> Ccp {
    Ccp { delassus: Arc::new(Delassus::Sparse(problem.delassus.assemble())), ..problem.clone() }
}

/// A block of layers x side x side balls on a jittered lattice, pressed together and sliding, with gravity;
/// the bottom layer touches a fixed floor. Sparse, hyperstatic, solvable.
pub fn lattice_packing(side: usize, layers: usize, mu: f64, seed: u64) -> Ccp {
    let mut random = Random::new(seed);
    let radius = 0.1;
    let mut centre = Vec::new();
    for z in 0..layers {
        for y in 0..side {
            for x in 0..side {
                // Body-centred rows: every other layer is shifted by half a cell.
                let shift = if z % 2 == 1 { 0.5 } else { 0.0 };
                let cell = 2.0 * radius;
                let mut jitter = || 0.02 * radius * random.signed();
                centre.push([
                    cell * (x as f64 + shift) + jitter(),
                    cell * (y as f64 + shift) + jitter(),
                    radius + cell * z as f64 * 0.5_f64.sqrt() + jitter(),
                ]);
            }
        }
    }
    let index = |x: usize, y: usize, z: usize| (z * side + y) * side + x;
    let mut pairs = Vec::new();
    for z in 0..layers {
        for y in 0..side {
            for x in 0..side {
                let here = index(x, y, z);
                if x + 1 < side {
                    pairs.push((here, Some(index(x + 1, y, z))));
                }
                if y + 1 < side {
                    pairs.push((here, Some(index(x, y + 1, z))));
                }
                if z == 0 {
                    pairs.push((here, None));
                } else {
                    // The four balls of the layer below that carry this one.
                    let offsets: [usize; 2] = if z % 2 == 1 { [0, 1] } else { [0, usize::MAX] };
                    for dx in offsets {
                        for dy in offsets {
                            let (bx, by) = (x.wrapping_add(dx), y.wrapping_add(dy));
                            if bx < side && by < side {
                                pairs.push((here, Some(index(bx, by, z - 1))));
                            }
                        }
                    }
                }
            }
        }
    }
    let (step, gravity) = (0.01, 9.81);
    let mass = 1000.0 * 4.0 / 3.0 * std::f64::consts::PI * f64::powi(radius, 3);
    let mut gaps = Vec::with_capacity(pairs.len());
    let mut points = Vec::with_capacity(pairs.len());
    let contacts: Vec<RigidContact> = pairs
        .iter()
        .map(|&(a, b)| {
            let (n, distance) = match b {
                Some(b) => {
                    let d: [f64; 3] = std::array::from_fn(|k| centre[a][k] - centre[b][k]);
                    let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
                    (d.map(|x| x / length), length - 2.0 * radius)
                }
                None => ([0.0, 0.0, 1.0], centre[a][2] - radius),
            };
            gaps.push(distance.max(0.0));
            points.push(std::array::from_fn(|k| centre[a][k] - radius * n[k]));
            RigidContact {
                body_a: a as u32,
                body_b: b.map_or(FIXED, |b| b as u32),
                frame: frame(n),
                arm_a: n.map(|x| -radius * x),
                arm_b: n.map(|x| radius * x),
            }
        })
        .collect();
    let inverse_mass = vec![ball(mass, radius); centre.len()];
    let mut v = vec![0.0; 6 * centre.len()];
    for v in v.chunks_exact_mut(6) {
        v[0] = 0.05 + 0.02 * random.signed();
        v[1] = 0.02 * random.signed();
        v[2] = -gravity * step + 0.02 * random.signed();
    }
    let rigid = RigidDelassus::new(contacts, inverse_mass);
    let mut r = vec![0.0; 3 * gaps.len()];
    rigid.relative_velocity(&v, &mut r);
    for (i, gap) in gaps.iter().enumerate() {
        r[3 * i] += gap / step;
    }
    let friction = vec![mu; gaps.len()];
    Ccp {
        velocity_scale: Some(gravity * step),
        points,
        ..Ccp::new(Delassus::Rigid(rigid), r, friction).expect("the packing is a valid problem")
    }
}

/// The problem where two contacts in three resist turning, with other turning velocities than bodies have by
/// themselves; coefficients are zero now and then.
pub fn with_turning(problem: &Ccp, seed: u64) -> Ccp {
    let mut random = Random::new(seed);
    let Delassus::Rigid(rigid) = &*problem.delassus else { panic!("a problem over bodies") };
    let chosen: Vec<u32> = (0..problem.num_contacts() as u32).filter(|_| random.below(3) > 0).collect();
    let rows = chosen.iter().map(|&contact| TurningRows { contact, length: 0.3 + random.unit() }).collect();
    let mut coefficient = || if random.below(5) == 0 { 0.0 } else { 0.5 * random.unit() };
    let turning: Vec<TurningFriction> = chosen
        .iter()
        .map(|&contact| TurningFriction { contact, rolling: coefficient(), spinning: coefficient() })
        .collect();
    let rigid = rigid.clone().with_turning(rows);
    let v: Vec<f64> = (0..6 * rigid.num_bodies()).map(|_| random.signed()).collect();
    let mut u = vec![0.0; 3 * rigid.num_blocks()];
    // r = D^T v + (gap rate >= 0): the change of velocity -v keeps all contacts, so that nothing is jammed.
    rigid.relative_velocity(&v, &mut u);
    for i in 0..problem.num_contacts() {
        u[3 * i] += if random.below(2) == 0 { 0.5 * random.unit() } else { 0.0 };
    }
    let delassus = Arc::new(Delassus::Rigid(rigid));
    Ccp { r: u, turning, delassus, ..problem.clone() }
}

/// The packing with balls all over it in two mechanisms.
pub fn with_mechanisms(problem: &Ccp) -> Ccp {
    let Delassus::Rigid(rigid) = &*problem.delassus else { panic!("a problem over bodies") };
    let of = |first: u32, degrees: usize| {
        let bodies: Vec<u32> = (first..rigid.num_bodies() as u32).step_by(301).collect();
        let factor = (0..6 * bodies.len() * degrees).map(|k| (1.3 * k as f64).sin()).collect();
        CoupledBodies { bodies, degrees, factor }
    };
    let rigid = rigid.clone().with_coupled(vec![of(3, 4), of(100, 13)]);
    Ccp { delassus: Arc::new(Delassus::Rigid(rigid)), ..problem.clone() }
}

/// Solution by Clarabel.
pub struct Oracle {
    pub impulse: Vec<f64>,
    pub objective: f64,
}

impl Oracle {
    /// How far Clarabel's own answer is off: the root of sum_i eta_i |d_i|^2 over sum_i |r_i|^2 / eta_i, in
    /// the scaling in which it is asked to solve the problem and, like its tolerances, relative to sums over
    /// all contacts. It breaks down on a few; and where masses differ much it leaves the lightest contacts
    /// off by more than their own effective mass would allow.
    pub fn residual(&self, problem: &Ccp) -> f64 {
        let mut u = vec![0.0; self.impulse.len()];
        problem.delassus.multiply(&self.impulse, &mut u, &mut problem.delassus.work());
        for (u, r) in u.iter_mut().zip(&problem.r) {
            *u += r;
        }
        let scale = ResidualScale::new(problem);
        let (mut errors, mut size) = (0.0, 0.0);
        for (i, &eta) in scale.eta.iter().enumerate() {
            let error = scale.of_contact(problem, &self.impulse, &u, FrictionModel::Relaxed, i);
            errors += (error * scale.velocity).powi(2) / eta;
            size += problem.r[3 * i..3 * i + 3].iter().map(|r| r * r).sum::<f64>() / eta;
        }
        (errors / size).sqrt()
    }
}

/// Solves the CCP as a second-order cone program with Clarabel, in variables scaled by 1/sqrt(eta_i) and so
/// that r has unit size, to the accuracy it can reach.
///
/// # Panics
/// If Clarabel does not solve the problem.
pub fn clarabel(problem: &Ccp) -> Oracle {
    let contacts = problem.num_contacts();
    let size = 3 * contacts;
    let eta = problem.diagonal_scale();
    let s = |k: usize| 1.0 / eta[k / 3].sqrt();
    let r: Vec<f64> = (0..size).map(|k| s(k) * problem.r[k]).collect();
    let scale = r.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-300);
    let matrix = problem.delassus.assemble();
    // Upper triangle, column by column.
    let (mut column_start, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
    for column in 0..size {
        let (blocks, entries) = matrix.row(column / 3);
        for (&j, block) in blocks.iter().zip(entries) {
            for k in 0..3 {
                let line = 3 * j as usize + k;
                if line <= column {
                    row.push(line);
                    value.push(s(line) * s(column) * block[3 * (column % 3) + k]);
                }
            }
        }
        column_start.push(row.len());
    }
    let p = CscMatrix::new(size, size, column_start, row, value);
    // s = -A x in the cone: (mu g_n, g_1, g_2) in the second-order cone; for mu = 0, g_n >= 0 and g_t = 0.
    let mut cones = Vec::new();
    let mut diagonal = vec![-1.0; size];
    for i in 0..contacts {
        if problem.friction[i] > 0.0 {
            diagonal[3 * i] = -problem.friction[i];
            cones.push(SupportedConeT::SecondOrderConeT(3));
        } else {
            cones.push(SupportedConeT::NonnegativeConeT(1));
            cones.push(SupportedConeT::ZeroConeT(2));
        }
    }
    let a = CscMatrix::new(size, size, (0..=size).collect(), (0..size).collect(), diagonal);
    let q: Vec<f64> = r.iter().map(|x| x / scale).collect();
    // Asked for more than it can reach, Clarabel sometimes runs away from a good answer: the best of two
    // counts.
    [1e-13, 1e-9]
        .map(|accuracy| {
            let settings = DefaultSettingsBuilder::default()
                .verbose(false)
                .tol_gap_abs(accuracy)
                .tol_gap_rel(accuracy)
                .tol_feas(accuracy)
                .max_iter(200)
                .build()
                .expect("valid settings");
            let mut solver =
                DefaultSolver::new(&p, &q, &a, &vec![0.0; size], &cones, settings).expect("valid data");
            solver.solve();
            let x = &solver.solution.x;
            assert!(x.iter().all(|x| x.is_finite()), "Clarabel failed: {:?}", solver.solution.status);
            let impulse: Vec<f64> = (0..size).map(|k| s(k) * scale * x[k]).collect();
            Oracle { impulse, objective: scale * scale * solver.solution.obj_val }
        })
        .into_iter()
        .min_by(|a, b| a.residual(problem).total_cmp(&b.residual(problem)))
        .expect("there are two")
}

/// The objective by Clarabel in the dual form, over the body velocities in units of square roots of mass:
/// with D~ = M^(-1/2) D and v = v_free + M^(-1/2) x,
///
/// ```text
/// min 1/2 |x|^2   subject to   (u_n, mu u_1, mu u_2) in the second-order cone,   u = D~^T x + r
/// ```
///
/// has the optimum of the CCP with the other sign. Errors of the constraints make it too high or too low, as
/// those of the impulses do in [`clarabel`], but other ones: N does not appear. Bodies are balls.
///
/// # Panics
/// If the problem has no bodies or Clarabel does not solve it.
pub fn clarabel_over_velocities(problem: &Ccp) -> f64 {
    let Delassus::Rigid(rigid) = &*problem.delassus else { panic!("a problem over bodies") };
    let scale = problem.r.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-300);
    let mut cones = Vec::new();
    let mut first_row = vec![0];
    for &mu in &problem.friction {
        // Without friction only the normal velocity is bounded.
        let rows = if mu > 0.0 { 3 } else { 1 };
        first_row.push(first_row.last().copied().unwrap_or(0) + rows);
        cones.push(match rows {
            3 => SupportedConeT::SecondOrderConeT(3),
            _ => SupportedConeT::NonnegativeConeT(1),
        });
    }
    let rows = first_row[first_row.len() - 1];
    let weight = |i: usize, k: usize| if k == 0 { 1.0 } else { problem.friction[i] };
    let mut b = vec![0.0; rows];
    for i in 0..problem.num_contacts() {
        for k in 0..first_row[i + 1] - first_row[i] {
            b[first_row[i] + k] = weight(i, k) * problem.r[3 * i + k] / scale;
        }
    }
    let (mut column_start, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
    for body in 0..rigid.num_bodies() {
        let inverse = &rigid.inverse_mass()[body];
        for freedom in 0..6 {
            for side in rigid.sides(body) {
                let i = side.contact as usize;
                let mut axis = [0.0; 3];
                axis[freedom % 3] = 1.0;
                let (root, velocity) = if freedom < 3 {
                    (inverse.linear[freedom].sqrt(), axis)
                } else {
                    (inverse.angular[4 * (freedom - 3)].sqrt(), cross(axis, side.arm))
                };
                for (k, direction) in rigid.contacts()[i].frame.iter().enumerate() {
                    if k < first_row[i + 1] - first_row[i] {
                        let along: f64 = (0..3).map(|l| direction[l] * velocity[l]).sum();
                        row.push(first_row[i] + k);
                        value.push(-side.sign * root * weight(i, k) * along);
                    }
                }
            }
            column_start.push(row.len());
        }
    }
    let freedoms = 6 * rigid.num_bodies();
    let a = CscMatrix::new(rows, freedoms, column_start, row, value);
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .tol_gap_abs(1e-13)
        .tol_gap_rel(1e-13)
        .tol_feas(1e-13)
        .max_iter(200)
        .build()
        .expect("valid settings");
    let identity = CscMatrix::identity(freedoms);
    let mut solver =
        DefaultSolver::new(&identity, &vec![0.0; freedoms], &a, &b, &cones, settings).expect("valid data");
    solver.solve();
    let objective = solver.solution.obj_val;
    assert!(objective.is_finite(), "Clarabel failed: {:?}", solver.solution.status);
    -scale * scale * objective
}

/// A linear solver by name.
pub fn linear_solver(name: &str) -> Box<dyn NewtonSolver> {
    LinearMethod::of(Method::Ipm, name).and_then(LinearMethod::build).unwrap()
}

/// A ball wedged between two walls that close on it: no impulse stops prescribed walls.
pub fn jammed() -> Ccp {
    let wall = |n: [f64; 3]| RigidContact {
        body_a: 0,
        body_b: FIXED,
        frame: frame(n),
        arm_a: n.map(|x| -x),
        arm_b: [0.0; 3],
    };
    let contacts = vec![wall([1.0, 0.0, 0.0]), wall([-1.0, 0.0, 0.0])];
    let rigid = RigidDelassus::new(contacts, vec![ball(1.0, 1.0)]);
    let r = vec![-0.5, 0.0, 0.0, -0.5, 0.0, 0.0];
    Ccp::new(Delassus::Rigid(rigid), r, vec![0.3; 2]).unwrap()
}
