//! Times solvers of this program and Clarabel on problem files, one after the other in one process on one
//! thread. The crate of Clarabel factorises with QDLDL: for large problems see
//! `benches/peers/against_clarabel.py`, which takes its faster Python package.
//!
//! ```text
//! cargo run --release -p graintrain-lab --example against_clarabel -- TOLERANCE SOLVERS PROBLEM...
//! cargo run --release -p graintrain-lab --example against_clarabel -- 1e-8 ipm,apgd sed729.dat sed4913.dat
//! ```
//!
//! Clarabel gets the problem as a second-order cone program in its best form here: where the bodies are
//! known, over the body velocities, `min 1/2 (v - v_free)^T M (v - v_free)` subject to `D^T v + b` in the
//! dual cones, in variables scaled to unit mass; else over the impulses, scaled by `1 / sqrt(eta)`. Its
//! settings are its defaults with all tolerances set to TOLERANCE and one thread. All answers are measured by
//! the residual of this program, relaxed. The time is from the problem in memory to the answer, set-up
//! included.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
use graintrain::ccp::residual::ResidualScale;
use graintrain::ccp::{Ccp, Delassus, FrictionModel, RigidDelassus, SolveSettings, SolverSpec};
use graintrain_io::problem_file;
use std::path::Path;
use std::time::Instant;

/// Repetitions: the fastest of them counts for small problems, large ones run once.
const REPEAT: usize = 5;
const LARGE: usize = 1000;

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let usage = "usage: against_clarabel TOLERANCE SOLVER[,SOLVER...] PROBLEM...";
    let tolerance: f64 = arguments.next().ok_or(usage)?.parse()?;
    let solvers = arguments.next().ok_or(usage)?;
    let specs = solvers.split(',').map(str::parse::<SolverSpec>).collect::<Result<Vec<_>, _>>()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    for path in arguments {
        let file = problem_file::read(Path::new(&path))?;
        pool.install(|| compare(&path, &file.problem, &specs, tolerance))?;
    }
    Ok(())
}

/// Runs everything on one problem and prints a line per solver.
fn compare(name: &str, problem: &Ccp, specs: &[SolverSpec], tolerance: f64) -> Result<(), Failure> {
    let repeat = if problem.num_contacts() > LARGE { 1 } else { REPEAT };
    println!("{name}: {} contacts, tolerance {tolerance:e}", problem.num_contacts());
    // Clarabel last: its factorisation may take minutes, and every line is printed as soon as it is known.
    for spec in specs {
        report(&spec.to_string(), problem, repeat, || {
            let settings = SolveSettings { tolerance, ..SolveSettings::default() };
            let mut impulse = vec![0.0; 3 * problem.num_contacts()];
            let report = spec.build()?.solve(problem, &mut impulse, &settings)?;
            Ok((impulse, report.iterations, format!("{:?}", report.status)))
        })?;
    }
    report("clarabel", problem, repeat, || by_clarabel(problem, tolerance))
}

/// Prints the fastest of a few runs of one solver.
fn report(
    name: &str,
    problem: &Ccp,
    repeat: usize,
    mut run: impl FnMut() -> Result<Answer, Failure>,
) -> Result<(), Failure> {
    let mut best: Option<(f64, Answer)> = None;
    for _ in 0..repeat {
        let start = Instant::now();
        let answer = run()?;
        let seconds = start.elapsed().as_secs_f64();
        if best.as_ref().is_none_or(|best| seconds < best.0) {
            best = Some((seconds, answer));
        }
    }
    if let Some((seconds, (impulse, iterations, status))) = best {
        let (residual, objective) = measure(problem, &impulse);
        println!(
            "  {name:16} {status:14} {iterations:7} it {seconds:10.4} s  residual {residual:.1e}  objective {objective:.12e}"
        );
    }
    Ok(())
}

/// Relaxed residual and objective.
fn measure(problem: &Ccp, impulse: &[f64]) -> (f64, f64) {
    let mut u = vec![0.0; impulse.len()];
    problem.delassus.multiply(impulse, &mut u, &mut problem.delassus.work());
    u.iter_mut().zip(&problem.r).for_each(|(u, r)| *u += r);
    let residual = ResidualScale::new(problem).residual(problem, impulse, &u, FrictionModel::Relaxed);
    (residual.max, problem.objective(impulse, &u))
}

/// Impulses, iterations and status.
type Answer = (Vec<f64>, usize, String);
type Failure = Box<dyn std::error::Error + Send + Sync>;

fn by_clarabel(problem: &Ccp, tolerance: f64) -> Result<Answer, Failure> {
    match &*problem.delassus {
        Delassus::Rigid(rigid) => over_velocities(problem, rigid, tolerance),
        Delassus::Sparse(_) => over_impulses(problem, tolerance),
    }
}

/// Columns of a sparse matrix, filled one after the other.
#[derive(Default)]
struct Columns {
    start: Vec<usize>,
    row: Vec<usize>,
    value: Vec<f64>,
}

impl Columns {
    fn finish(mut self, rows: usize) -> CscMatrix<f64> {
        self.start.push(self.row.len());
        CscMatrix::new(rows, self.start.len() - 1, self.start, self.row, self.value)
    }
}

fn solve(
    p: &CscMatrix<f64>,
    q: &[f64],
    a: &CscMatrix<f64>,
    b: &[f64],
    cones: &[SupportedConeT<f64>],
    tolerance: f64,
) -> Result<DefaultSolver<f64>, Failure> {
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .tol_gap_abs(tolerance)
        .tol_gap_rel(tolerance)
        .tol_feas(tolerance)
        .max_threads(1)
        .build()?;
    let mut solver = DefaultSolver::new(p, q, a, b, cones, settings)?;
    solver.solve();
    Ok(solver)
}

/// Cones of (u_n, mu u_1, mu u_2), or of (mu g_n, g_1, g_2); without friction u_n >= 0 alone, or g_n >= 0 and
/// g_t = 0.
fn cones(problem: &Ccp) -> Vec<SupportedConeT<f64>> {
    let mut cones = Vec::new();
    for &mu in &problem.friction {
        if mu > 0.0 {
            cones.push(SupportedConeT::SecondOrderConeT(3));
        } else {
            cones.push(SupportedConeT::NonnegativeConeT(1));
            // Over velocities these rows are zero.
            cones.push(SupportedConeT::ZeroConeT(2));
        }
    }
    cones
}

/// min 1/2 x^T x subject to E (D^T L x + r) in the cones, with M^-1 = L L^T, v - v_free = L x; the
/// multipliers are g.
fn over_velocities(problem: &Ccp, rigid: &RigidDelassus, tolerance: f64) -> Result<Answer, Failure> {
    let size = problem.r.len();
    let scale = problem.r.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-300);
    let weight = |k: usize| if k.is_multiple_of(3) { 1.0 } else { problem.friction[k / 3] };
    let mut a = Columns::default();
    for body in 0..rigid.num_bodies() {
        for column in lower_factor(&rigid.inverse_mass()[body]) {
            a.start.push(a.row.len());
            for side in rigid.sides(body) {
                let contact = &rigid.contacts()[side.contact as usize];
                let [u, w] = [[column[0], column[1], column[2]], [column[3], column[4], column[5]]];
                let r = side.arm;
                let velocity = [
                    u[0] + w[1] * r[2] - w[2] * r[1],
                    u[1] + w[2] * r[0] - w[0] * r[2],
                    u[2] + w[0] * r[1] - w[1] * r[0],
                ];
                for (k, axis) in contact.frame.iter().enumerate() {
                    let row = 3 * side.contact as usize + k;
                    let value: f64 = (0..3).map(|l| axis[l] * velocity[l]).sum();
                    a.row.push(row);
                    a.value.push(-weight(row) * side.sign * value);
                }
            }
        }
    }
    let freedoms = a.start.len();
    let a = a.finish(size);
    let b: Vec<f64> = (0..size).map(|k| weight(k) * problem.r[k] / scale).collect();
    let identity = CscMatrix::identity(freedoms);
    let solver = solve(&identity, &vec![0.0; freedoms], &a, &b, &cones(problem), tolerance)?;
    let impulse = (0..size).map(|k| scale * weight(k) * solver.solution.z[k]).collect();
    Ok((impulse, solver.solution.iterations as usize, format!("{:?}", solver.solution.status)))
}

/// Columns of L with M^-1 = L L^T, in the order (u, w).
fn lower_factor(inverse: &graintrain::ccp::BodyInverseMass) -> [[f64; 6]; 6] {
    let mut columns = [[0.0; 6]; 6];
    let mut l = [[0.0_f64; 3]; 3];
    for j in 0..3 {
        for i in j..3 {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            let rest = inverse.angular[3 * i + j] - sum;
            l[i][j] = if i == j {
                rest.max(0.0).sqrt()
            } else if l[j][j] > 0.0 {
                rest / l[j][j]
            } else {
                0.0
            };
        }
    }
    for k in 0..3 {
        columns[k][k] = inverse.linear[k].sqrt();
        for i in 0..3 {
            columns[3 + k][3 + i] = l[i][k];
        }
    }
    columns
}

/// min 1/2 x^T S N S x + (S r)^T x over the cones of impulses g = S x, S = 1 / sqrt(eta).
fn over_impulses(problem: &Ccp, tolerance: f64) -> Result<Answer, Failure> {
    let size = problem.r.len();
    let eta = problem.diagonal_scale();
    let s = |k: usize| 1.0 / eta[k / 3].sqrt();
    let r: Vec<f64> = (0..size).map(|k| s(k) * problem.r[k]).collect();
    let scale = r.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-300);
    let matrix = problem.delassus.assemble();
    let mut upper = Columns::default();
    for column in 0..size {
        upper.start.push(upper.row.len());
        let (blocks, entries) = matrix.row(column / 3);
        for (&j, block) in blocks.iter().zip(entries) {
            for row in (3 * j as usize..3 * j as usize + 3).filter(|&row| row <= column) {
                upper.row.push(row);
                upper.value.push(s(row) * s(column) * block[3 * (column % 3) + row % 3]);
            }
        }
    }
    let p = upper.finish(size);
    let diagonal = (0..size)
        .map(|k| {
            if k.is_multiple_of(3) && problem.friction[k / 3] > 0.0 { -problem.friction[k / 3] } else { -1.0 }
        })
        .collect();
    let a = CscMatrix::new(size, size, (0..=size).collect(), (0..size).collect(), diagonal);
    let q: Vec<f64> = r.iter().map(|x| x / scale).collect();
    let solver = solve(&p, &q, &a, &vec![0.0; size], &cones(problem), tolerance)?;
    let impulse = (0..size).map(|k| s(k) * scale * solver.solution.x[k]).collect();
    Ok((impulse, solver.solution.iterations as usize, format!("{:?}", solver.solution.status)))
}
