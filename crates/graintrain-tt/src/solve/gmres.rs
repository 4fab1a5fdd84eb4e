//! GMRES with all vectors as trains (S. Dolgov, TT-GMRES, Russian J. Numer. Anal. Math. Modelling 28, 2013;
//! arXiv 1206.5512).
//!
//! Vectors of the Krylov space are rounded, ever more coarsely as the residual falls: an error of delta in
//! step j is weighed by the part of the residual that is left there (V. Simoncini, D. Szyld, SIAM J. Sci.
//! Comput. 25, 2003). Rounded vectors are not orthogonal to the last digit and the small least-squares
//! problem knows nothing of it, so what it says of the residual ends a cycle and nothing else: each cycle
//! begins with y - A x from the trains, and so does the report.

use super::{Best, SolveStatus, measured_residual};
use crate::scale::share_power;
use crate::{Measured, Stop, Truncation, TruncationReport, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::Matrix;
use serde::{Deserialize, Serialize};

/// Vectors of a cycle at most: their small least-squares problem is a full matrix.
const LONGEST_CYCLE: usize = 4096;
/// Part of the tolerance that the roundings of one step may make.
const STEP_SHARE: f64 = 0.1;
/// No vector is rounded more coarsely than this.
const COARSEST: f64 = 0.1;
/// A cycle that leaves more than this part of the residual has stagnated.
const LEAST_GAIN: f64 = 0.9;
/// What is left of a vector after those before it is nothing below this part of it.
const NOTHING: f64 = 1e-13;
/// The iterate is rounded as finely as it takes for its rounding not to show in the residual, but not more
/// finely than this.
const FINEST: f64 = 1e-15;

/// Settings of [`gmres`].
///
/// ```
/// let settings = graintrain_tt::solve::GmresSettings::default();
/// assert_eq!((settings.tolerance, settings.max_rank, settings.restart, settings.max_iterations), (1e-6, usize::MAX, 30, 300));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GmresSettings {
    /// Relative residual ||A x - y|| / ||y|| aimed at.
    pub tolerance: f64,
    /// No rank of a vector above this.
    pub max_rank: usize,
    /// Vectors of one cycle.
    pub restart: usize,
    /// Most products with A in all cycles.
    pub max_iterations: usize,
}

impl Default for GmresSettings {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_rank: usize::MAX, restart: 30, max_iterations: 300 }
    }
}

/// What [`gmres`] did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GmresReport {
    /// Why it ended.
    pub status: SolveStatus,
    /// ||A x - y|| / ||y|| of what is returned, from the trains.
    pub residual: f64,
    /// What rounding leaves uncertain about the residual.
    pub floor: f64,
    /// Products with A within the cycles.
    pub iterations: usize,
    /// The residual from the trains at the start of every cycle, and at the end.
    pub history: Vec<f64>,
    /// The largest rank of a vector of the Krylov space.
    pub largest_rank: usize,
    /// Ranks of the result.
    pub ranks: Vec<usize>,
}

/// Solves A x = y for any square A by restarted GMRES, from `start` (or zero), with a right preconditioner P:
/// A P u = y, x = P u.
///
/// Iterations are those of GMRES, so without a preconditioner an ill-conditioned A takes as many as its
/// condition asks for, and the ranks of the vectors grow with them: [`solve`](super::solve) is the method for
/// such systems, this one for well-conditioned or preconditioned ones, and a second opinion. O(j R r) ranks
/// before and O(d n (j r)^3) operations for the rounding in step j, r the ranks of the vectors, R those of A.
///
/// # Errors
/// [`TtError::Shape`] if the sizes do not fit, [`TtError::Setting`] for a bad setting, [`TtError::Dense`] for
/// entries that are not finite. Not converging is not an error: see [`GmresReport::status`]; the iterate with
/// the smallest residual is returned.
///
/// ```
/// use graintrain_tt::{TtMatrix, TtVector, qtt, solve::{GmresSettings, SolveStatus, gmres}};
/// // (1 - S / 2) x = 1 with the shift S: not symmetric; x_j = 2 - 2^-j.
/// let a = TtMatrix::identity(&[2; 10])?.subtract(&qtt::shift(10)?.scale(0.5))?;
/// let y = TtVector::constant(&[2; 10], 1.0)?;
/// let settings = GmresSettings { tolerance: 1e-8, ..Default::default() };
/// let (x, report) = gmres(&a, &y, None, None, &settings)?;
/// assert_eq!(report.status, SolveStatus::Converged);
/// assert!((x.entry(&[0, 1, 0, 0, 0, 0, 0, 0, 0, 0])? - 1.75).abs() < 1e-5);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn gmres(
    a: &TtMatrix,
    y: &TtVector,
    start: Option<&TtVector>,
    preconditioner: Option<&TtMatrix>,
    settings: &GmresSettings,
) -> Result<(TtVector, GmresReport), TtError> {
    gmres_within(a, y, start, preconditioner, settings, &|| false)
}

/// As [`gmres`], as long as `stop` is false: it is asked before every product with A.
///
/// # Errors
/// As for [`gmres`], and [`TtError::Stopped`].
pub fn gmres_within(
    a: &TtMatrix,
    y: &TtVector,
    start: Option<&TtVector>,
    preconditioner: Option<&TtMatrix>,
    settings: &GmresSettings,
    stop: Stop<'_>,
) -> Result<(TtVector, GmresReport), TtError> {
    a.check_square()?;
    Truncation::capped(settings.tolerance, settings.max_rank).check()?;
    if !(1..=LONGEST_CYCLE).contains(&settings.restart) {
        let got = settings.restart as f64;
        return Err(TtError::Setting { what: "restart", need: "in 1..=4096", got });
    }
    if settings.max_iterations == 0 {
        return Err(TtError::Setting { what: "max_iterations", need: "at least 1", got: 0.0 });
    }
    a.check_columns(y)?;
    if let Some(preconditioner) = preconditioner {
        a.check_same_sizes(preconditioner)?;
    }
    let spectators = vec![1; a.num_cores()];
    // Powers of two that bring y to norm 1 and A to the norm of an identity: no square overflows on the way.
    // A' = 2^p A, y' = 2^q y, x' = 2^(q - p) x.
    let power = |log: f64| if log.is_finite() { -(log / std::f64::consts::LN_2).round() } else { 0.0 };
    let unknowns: f64 = a.rows.iter().map(|&n| n as f64).product();
    let (p, q) = (power(a.train.log_norm() - 0.5 * unknowns.ln()), power(y.log_norm()));
    let a = &a.map(|train| shared(train, p));
    let y = &shared(y, q);
    let mut x = match start {
        Some(start) => {
            y.check_same_modes(start)?;
            shared(start, q - p)
        }
        None => y.scale(0.0).round(&Truncation::default())?.0,
    };
    let mut best = Best::new(a, y, &spectators);
    best.offer(x.clone())?;
    best.offer_zero();
    x.clone_from(&best.x);
    let mut state =
        Krylov { a, preconditioner, settings, stop, iterations: 0, largest_rank: 1, capped: false };
    let mut history = vec![best.residual];
    let mut status = SolveStatus::SweepLimit;
    let size = y.norm();
    while best.residual > settings.tolerance && state.iterations < settings.max_iterations {
        let before = best.residual;
        let goal = 0.5 * settings.tolerance / before;
        let rounding = Truncation::capped((STEP_SHARE * goal).min(COARSEST), settings.max_rank);
        let image = a.times_vector(&best.x)?;
        let (residual, report) = TtVector::sum_rounded(&[(1.0, y), (-1.0, &image)], &rounding)?;
        state.capped |= report.capped;
        let terms = state.cycle(&residual, goal)?;
        if terms.is_empty() {
            status = SolveStatus::Stagnated;
            break;
        }
        let mut sum: Vec<(f64, &TtVector)> = vec![(1.0, &best.x)];
        sum.extend(terms.iter().map(|(weight, term)| (*weight, term)));
        let (next, report) = rounded(&sum, settings, |x| Ok(measured_residual(a, x, y, &spectators)?.value))?;
        state.capped |= report.capped;
        best.offer(next)?;
        history.push(best.residual);
        if best.residual > LEAST_GAIN * before {
            status = if state.capped { SolveStatus::RankCapped } else { SolveStatus::Stagnated };
            break;
        }
    }
    let x = best.x;
    let Measured { value, floor } = if size > 0.0 {
        measured_residual(a, &x, y, &spectators)?
    } else {
        Measured { value: 0.0, floor: 0.0 }
    };
    if value <= settings.tolerance {
        status = SolveStatus::Converged;
    }
    let x = shared(&x, p - q);
    let (iterations, largest_rank, ranks) = (state.iterations, state.largest_rank, x.ranks());
    Ok((x, GmresReport { status, residual: value, floor, iterations, history, largest_rank, ranks }))
}

/// A sum, rounded as finely as its residual asks for.
fn rounded(
    sum: &[(f64, &TtVector)],
    settings: &GmresSettings,
    residual: impl Fn(&TtVector) -> Result<f64, TtError>,
) -> Result<(TtVector, TruncationReport), TtError> {
    let mut fine = STEP_SHARE * settings.tolerance;
    let mut next = TtVector::sum_rounded(sum, &Truncation::capped(fine, settings.max_rank))?;
    loop {
        let found = residual(&next.0)?;
        // (The roundings of x are seen through A: a tenfold finer one tells whether they matter.)
        if found <= settings.tolerance || fine <= FINEST || next.1.capped {
            return Ok(next);
        }
        fine = (0.1 * fine).max(FINEST);
        let finer = TtVector::sum_rounded(sum, &Truncation::capped(fine, settings.max_rank))?;
        let gained = residual(&finer.0)?;
        let pays = gained < 0.9 * found;
        if gained < found {
            next = finer;
        }
        if !pays {
            return Ok(next);
        }
    }
}

/// 2^power x.
fn shared(x: &TtVector, power: f64) -> TtVector {
    let mut x = x.clone();
    share_power(&mut x.cores, power as i64);
    x
}

/// What the cycles share.
struct Krylov<'a> {
    a: &'a TtMatrix,
    preconditioner: Option<&'a TtMatrix>,
    settings: &'a GmresSettings,
    stop: Stop<'a>,
    iterations: usize,
    largest_rank: usize,
    capped: bool,
}

impl Krylov<'_> {
    fn rounded(&mut self, product: (TtVector, crate::TruncationReport)) -> TtVector {
        self.capped |= product.1.capped;
        self.largest_rank = self.largest_rank.max(product.0.max_rank());
        product.0
    }

    /// One cycle for A e = r, until the small problem has less than `goal` of r: the terms of e with their
    /// weights.
    fn cycle(&mut self, residual: &TtVector, goal: f64) -> Result<Vec<(f64, TtVector)>, TtError> {
        let beta = residual.norm();
        if beta == 0.0 || !beta.is_finite() {
            return Ok(Vec::new());
        }
        let steps = self.settings.restart.min(self.settings.max_iterations - self.iterations);
        let mut basis = vec![residual.scale(1.0 / beta)];
        let mut directions = Vec::with_capacity(steps);
        let mut small = SmallProblem::new(steps);
        for k in 0..steps {
            crate::go_on(self.stop)?;
            let relaxed = (STEP_SHARE * goal / small.residual()).min(COARSEST);
            let truncation = Truncation::capped(relaxed, self.settings.max_rank);
            let direction = match self.preconditioner {
                Some(preconditioner) => {
                    let product = preconditioner.times_vector_rounded(&basis[k], &truncation)?;
                    self.rounded(product)
                }
                None => basis[k].clone(),
            };
            let product = self.a.times_vector_rounded(&direction, &truncation)?;
            let image = self.rounded(product);
            self.iterations += 1;
            directions.push(direction);
            // Twice: once is not enough for vectors that are orthogonal only as far as they were rounded.
            let mut column = vec![0.0; k + 2];
            let mut next = image;
            for _ in 0..2 {
                let weights: Vec<f64> = basis.iter().map(|v| v.dot(&next)).collect::<Result<_, _>>()?;
                let mut terms = vec![(1.0, &next)];
                terms.extend(weights.iter().zip(&basis).map(|(weight, v)| (-weight, v)));
                let sum = TtVector::sum_rounded(&terms, &truncation)?;
                weights.iter().zip(&mut column).for_each(|(weight, h)| *h += weight);
                next = self.rounded(sum);
            }
            let image_length = column.iter().map(|h| h * h).sum::<f64>().sqrt();
            let length = Some(next.norm()).filter(|&length| length > NOTHING * image_length).unwrap_or(0.0);
            column[k + 1] = length;
            if !small.push(&column) {
                directions.pop();
                break;
            }
            if small.residual() <= goal || length == 0.0 {
                break;
            }
            basis.push(next.scale(1.0 / length));
        }
        Ok(small.weights().iter().map(|weight| weight * beta).zip(directions).collect())
    }
}

/// min ||e_1 - H z|| for a Hessenberg H that grows by columns, by rotations.
struct SmallProblem {
    triangle: Matrix,
    rotations: Vec<(f64, f64)>,
    rest: Vec<f64>,
}

impl SmallProblem {
    fn new(steps: usize) -> Self {
        Self { triangle: Matrix::zeros(steps, steps), rotations: Vec::new(), rest: vec![1.0] }
    }

    /// What is left of e_1.
    fn residual(&self) -> f64 {
        self.rest[self.rotations.len()].abs()
    }

    /// Appends a column; false (and nothing changed) if the ones before hold all of it: the matrix is
    /// singular on what they span.
    fn push(&mut self, column: &[f64]) -> bool {
        let k = self.rotations.len();
        let size = column.iter().map(|h| h * h).sum::<f64>().sqrt();
        let mut column = column.to_vec();
        for (i, &(c, s)) in self.rotations.iter().enumerate() {
            let (x, y) = (column[i], column[i + 1]);
            column[i] = c * x + s * y;
            column[i + 1] = c * y - s * x;
        }
        let radius = column[k].hypot(column[k + 1]);
        if radius <= NOTHING * size || !radius.is_finite() {
            return false;
        }
        let (c, s) = (column[k] / radius, column[k + 1] / radius);
        column[k] = radius;
        (0..=k).for_each(|i| self.triangle[(i, k)] = column[i]);
        self.rest.push(-s * self.rest[k]);
        self.rest[k] *= c;
        self.rotations.push((c, s));
        true
    }

    /// z, by substitution.
    fn weights(&self) -> Vec<f64> {
        let n = self.rotations.len();
        let mut z = self.rest[..n].to_vec();
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|j| self.triangle[(i, j)] * z[j]).sum();
            z[i] = (z[i] - known) / self.triangle[(i, i)];
        }
        z
    }
}
