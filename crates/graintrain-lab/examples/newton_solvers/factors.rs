//! Sparse Cholesky factorisations of Newton matrices in body space (K = I + A A^T, 6x6 blocks): the product's
//! in two orders of bodies, and faer's in its own order of scalars, on the same matrices and right-hand
//! sides.

use crate::Failure;
use crate::solve::{TOLERANCE, clock, problem};
use crate::table::short;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{SymmetricOrdering, factorize_symbolic_cholesky};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Par, Side, Spec};
use graintrain::ccp::newton::body_matrix::BodyMatrix;
use graintrain::ccp::newton::{Form, LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use graintrain::ccp::paper::pdip::{Pdip, Rule};
use graintrain::ccp::registry::LinearMethod;
use graintrain::ccp::{CcpSolver, Delassus, SolveSettings};
use graintrain_linalg::cholesky::SparseCholesky;
use graintrain_linalg::ordering::Ordering;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering as Access};
use std::time::Instant;

/// Factorisations and solves of which the fastest counts, and processor seconds after which there are no more
/// of them.
const REPEATS: (usize, f64) = (3, 5.0);

/// What a factorisation of one matrix took, processor seconds.
struct Taken {
    analysis: f64,
    factor: f64,
    solve: f64,
    /// Entries of the factor.
    entries: usize,
    /// |b - K x| / |b|.
    residual: f64,
}

impl Taken {
    fn line(&self, name: &str) -> String {
        let [analysis, factor, solve] = [self.analysis, self.factor, self.solve].map(short);
        format!("{name} | {analysis} | {factor} | {solve} | {} | {:.0e}", self.entries, self.residual)
    }
}

/// Processor seconds of the fastest of several runs.
fn fastest(mut work: impl FnMut() -> Result<(), Failure>) -> Result<f64, Failure> {
    let mut best = f64::INFINITY;
    let start = Instant::now();
    let first = clock(start);
    for _ in 0..REPEATS.0 {
        let begun = clock(start);
        work()?;
        best = best.min(clock(start) - begun);
        if clock(start) - first > REPEATS.1 {
            break;
        }
    }
    Ok(best)
}

fn residual(matrix: &BodyMatrix, b: &[f64], x: &[f64]) -> f64 {
    let mut image = vec![0.0; b.len()];
    matrix.multiply(x, &mut image);
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
    norm(&mut b.iter().zip(&image).map(|(b, image)| b - image)) / norm(&mut b.iter().copied())
}

fn of_blocks(matrix: &BodyMatrix, ordering: Ordering, b: &[f64]) -> Result<Taken, Failure> {
    let start = Instant::now();
    let begun = clock(start);
    let mut cholesky = SparseCholesky::new(6, matrix.row_starts(), matrix.columns(), ordering);
    let analysis = clock(start) - begun;
    let factor = fastest(|| Ok(cholesky.factorize(matrix.blocks().as_flattened())?))?;
    let mut x = Vec::new();
    let solve = fastest(|| {
        x = b.to_vec();
        cholesky.solve(&mut x);
        Ok(())
    })?;
    let entries = cholesky.entries();
    Ok(Taken { analysis, factor, solve, entries, residual: residual(matrix, b, &x) })
}

/// The lower triangle by columns. Of mirrored blocks only the lower one is read.
fn scalar(matrix: &BodyMatrix) -> Result<SparseColMat<usize, f64>, Failure> {
    let mut entries = Vec::new();
    for i in 0..matrix.num_bodies() {
        for k in matrix.row_starts()[i]..matrix.row_starts()[i + 1] {
            let j = matrix.columns()[k] as usize;
            for (e, &value) in matrix.blocks()[k].iter().enumerate() {
                let (row, column) = (6 * i + e / 6, 6 * j + e % 6);
                if row >= column {
                    entries.push(Triplet::new(row, column, value));
                }
            }
        }
    }
    let n = 6 * matrix.num_bodies();
    Ok(SparseColMat::try_new_from_triplets(n, n, &entries).map_err(|error| format!("{error:?}"))?)
}

/// faer's factorisation with its minimum degree order.
fn of_scalars(matrix: &BodyMatrix, b: &[f64]) -> Result<Taken, Failure> {
    let by_columns = scalar(matrix)?;
    let start = Instant::now();
    let begun = clock(start);
    let symbolic = factorize_symbolic_cholesky(
        by_columns.symbolic(),
        Side::Lower,
        SymmetricOrdering::Amd,
        Default::default(),
    )
    .map_err(|error| format!("{error:?}"))?;
    let analysis = clock(start) - begun;
    let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
    let mut memory = MemBuffer::new(scratch);
    let mut values = vec![0.0; symbolic.len_val()];
    let regularization = LltRegularization::default();
    let factor = fastest(|| {
        let stack = MemStack::new(&mut memory);
        let parameters = Spec::default();
        symbolic
            .factorize_numeric_llt(
                &mut values,
                by_columns.as_ref(),
                Side::Lower,
                regularization,
                Par::Seq,
                stack,
                parameters,
            )
            .map(|_| ())
            .map_err(|error| format!("{error:?}").into())
    })?;
    let factorised = faer::sparse::linalg::cholesky::LltRef::new(&symbolic, &values);
    let mut memory = MemBuffer::new(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
    let mut x = Vec::new();
    let solve = fastest(|| {
        x = b.to_vec();
        let right = MatMut::from_column_major_slice_mut(&mut x, b.len(), 1);
        factorised.solve_in_place_with_conj(Conj::No, right, Par::Seq, MemStack::new(&mut memory));
        Ok(())
    })?;
    Ok(Taken { analysis, factor, solve, entries: symbolic.len_val(), residual: residual(matrix, b, &x) })
}

/// Solves by its guide and factorises some of its matrices.
struct Factored {
    guide: Box<dyn NewtonSolver>,
    iterations: Vec<usize>,
    stop: Arc<AtomicBool>,
    head: String,
}

impl Factored {
    fn study(&self, system: &NewtonSystem<'_>) -> Result<(), Failure> {
        let Delassus::Rigid(rigid) = &*system.problem.delassus else {
            return Err("not a rigid problem".into());
        };
        let mut matrix = BodyMatrix::new(rigid);
        matrix.assemble(system.blocks.factor);
        let b: Vec<f64> = (0..6 * matrix.num_bodies()).map(|k| f64::sin(k as f64)).collect();
        let tell = |taken: Taken, name: &str| {
            println!("| {}{} | {} |", self.head, system.iteration, taken.line(name));
        };
        tell(of_blocks(&matrix, Ordering::NestedDissection, &b)?, "nested dissection of bodies");
        tell(of_blocks(&matrix, Ordering::MinimumDegree, &b)?, "minimum degree of bodies");
        tell(of_scalars(&matrix, &b)?, "minimum degree of scalars (faer)");
        Ok(())
    }
}

impl NewtonSolver for Factored {
    fn name(&self) -> &'static str {
        self.guide.name()
    }

    fn form(&self) -> Form {
        self.guide.form()
    }

    fn prepare(&mut self, system: &NewtonSystem<'_>) {
        self.guide.prepare(system);
    }

    fn needs_matrix(&self) -> bool {
        self.guide.needs_matrix()
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        if self.iterations.contains(&system.iteration) {
            if let Err(error) = self.study(system) {
                println!("| {}{} | {error} |", self.head, system.iteration);
            }
            if self.iterations.last() == Some(&system.iteration) {
                self.stop.store(true, Access::Relaxed);
            }
        }
        self.guide.refresh(system)
    }

    fn solve(&mut self, system: &NewtonSystem<'_>, b: &[f64], z: &mut [f64], tolerance: f64) -> LinearReport {
        self.guide.solve(system, b, z, tolerance)
    }
}

/// Factorises the matrices of these Newton iterations, ascending, of every problem.
pub fn factors(iterations: &[usize], names: &[&str]) -> Result<(), Failure> {
    println!(
        "| bodies, contacts, iteration | order | analysis, s | factor, s | solve, s | entries | residual |\n\
         |---|---|---|---|---|---|---|"
    );
    for name in names {
        let problem = problem(name)?;
        let Delassus::Rigid(rigid) = &*problem.delassus else { return Err("not a rigid problem".into()) };
        let stop = Arc::new(AtomicBool::new(false));
        let factored = Factored {
            guide: LinearMethod::IncompleteCholesky.build()?,
            iterations: iterations.to_vec(),
            stop: stop.clone(),
            head: format!("{}, {}, ", rigid.num_bodies(), problem.num_contacts()),
        };
        let settings = SolveSettings { tolerance: TOLERANCE, stop: Some(stop), ..SolveSettings::default() };
        let mut impulse = vec![0.0; 3 * problem.num_contacts()];
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
        pool.install(|| {
            Pdip::with_solver(Rule::Central, Box::new(factored)).solve(&problem, &mut impulse, &settings)
        })?;
    }
    Ok(())
}
