//! x' = A x in the format: the time-dependent variational principle with one or two sites (J. Haegeman, C. Lubich, I. Oseledets, B. Vandereycken,
//! F. Verstraete, Phys. Rev. B 94, 2016), a symmetric splitting of second order.
//!
//! With the other cores orthogonal, a core (or two neighbours) follows exp(h B), B the projection of A; what is carried to the next core goes back
//! by exp(-h K), because both sides counted it. One site keeps the ranks of the start, two sites let them follow the truncation.
//!
//! Three errors are made and all are reported, as absolute norms. Projection: x' follows P A x, and ||(I - P) A x|| is measured at every step, since
//! P is a sum of projections whose images are at hand. Truncation: what the SVDs of two sites leave out. Splitting: the first step against two of half
//! the length. Where A does not make anything grow (x^T A x <= 0) their sum bounds the error as far as the estimates of projection and splitting hold for
//! the times between.

use super::interface::{BlockCore, Interface, LocalOperator, OperatorCore};
use crate::error::at_core;
use crate::scale::share_power;
use crate::vector::Core;
use crate::{Truncation, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{DenseError, Matrix, View, product, thin_qr, thin_svd};
use serde::{Deserialize, Serialize};

/// Local problems up to this size are exponentiated as matrices.
const DENSE: usize = 60;
/// Vectors of one Krylov space.
const KRYLOV: usize = 30;
/// Error of a local exponential, relative to its vector.
const LOCAL: f64 = 1e-13;
/// Halvings of a local time step, and growth of a local vector, beyond which the step is too long.
const HALVINGS: u32 = 12;
const GROWTH: f64 = 1e4;

/// Neighbouring cores that move at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Sites {
    /// One: the ranks stay those of the start.
    One,
    /// Two: the ranks follow the tolerance.
    Two,
}

/// Settings of [`evolve`].
///
/// ```
/// use graintrain_tt::solve::{EvolutionSettings, Sites};
/// let settings = EvolutionSettings::default();
/// assert_eq!((settings.sites, settings.steps, settings.tolerance, settings.max_rank), (Sites::Two, 10, 1e-8, 200));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvolutionSettings {
    /// Cores that move at a time.
    pub sites: Sites,
    /// Time steps of equal length.
    pub steps: usize,
    /// What all truncations of the run together may leave out, relative to the norm of the start.
    pub tolerance: f64,
    /// No rank above this.
    pub max_rank: usize,
}

impl Default for EvolutionSettings {
    fn default() -> Self {
        Self { sites: Sites::Two, steps: 10, tolerance: 1e-8, max_rank: 200 }
    }
}

/// What [`evolve`] did; all errors are Frobenius norms, to be held against that of the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvolutionReport {
    /// Sum over the steps of h ||(I - P) A x|| at their ends (trapezoidal rule): what the directions that the cores cannot take would have done.
    pub projection: f64,
    /// Below this `projection` says nothing: it is the root of a difference of squares.
    pub projection_floor: f64,
    /// Sum of what the truncations left out.
    pub truncation: f64,
    /// Splitting error of all steps, from the first one: 4/3 of its distance from two steps of half the length, times their number.
    pub splitting: f64,
    /// Whether the cap on the ranks made a truncation leave out more than the tolerance allows.
    pub capped: bool,
    /// Largest rank after every step.
    pub ranks: Vec<usize>,
}

impl EvolutionReport {
    /// Nothing moved.
    fn still(steps: usize) -> Self {
        Self {
            projection: 0.0,
            projection_floor: 0.0,
            truncation: 0.0,
            splitting: 0.0,
            capped: false,
            ranks: vec![1; steps],
        }
    }

    /// The sum of the three errors: what ||x - exact|| is expected not to exceed where x^T A x <= 0 for all x.
    pub fn error(&self) -> f64 {
        self.projection + self.truncation + self.splitting
    }
}

/// exp(time A) x for any square A, symmetric or not. (i A of a real symmetric A is the real matrix [0 -A; A 0] on one more digit.)
///
/// For stiff A (time / steps times the norm of A much above 10, diffusion on fine grids) the backward parts of the sweep grow and the step is refused:
/// take implicit steps by [`solve`](super::solve) there. O(steps d (n^2 r^3 R + n^3 r^2 R^2)) per Krylov vector.
///
/// # Errors
/// [`TtError::Shape`] if the sizes do not fit, [`TtError::Setting`] for a bad setting or a time step that is too long, [`TtError::Dense`] for entries that are
/// not finite.
///
/// ```
/// use graintrain_tt::{TtMatrix, TtVector, qtt, solve::{EvolutionSettings, evolve}};
/// // exp(-t D) of a diagonal D = 1, 2, ..., 2^10 scaled to 2^-10 ... 1: known entry by entry.
/// let d = TtMatrix::from_diagonal(&qtt::ramp(10, -2f64.powi(-10), -2f64.powi(-10))?);
/// let x = TtVector::constant(&[2; 10], 1.0)?;
/// let (y, report) = evolve(&d, &x, 2.0, &EvolutionSettings::default())?;
/// assert!((y.entry(&[1; 10])? - (-2.0f64).exp()).abs() < 1e-6 && report.error() < 1e-3);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn evolve(
    a: &TtMatrix,
    x: &TtVector,
    time: f64,
    settings: &EvolutionSettings,
) -> Result<(TtVector, EvolutionReport), TtError> {
    a.check_square()?;
    a.check_columns(x)?;
    Truncation::capped(settings.tolerance, settings.max_rank).check()?;
    if settings.steps == 0 {
        return Err(TtError::Setting { what: "steps", need: "at least 1", got: 0.0 });
    }
    if !time.is_finite() {
        return Err(TtError::Setting { what: "time", need: "finite", got: time });
    }
    // (Refuses numbers that are not finite; dependent rows would be no directions at all.)
    let start = x.round(&Truncation::capped(0.0, settings.max_rank))?.0;
    let Some((start, exponent)) = start.balanced()? else {
        return Ok((start, EvolutionReport::still(settings.steps)));
    };
    let Some((balanced, a_exponent)) = a.train.balanced()? else {
        return Ok((x.clone(), EvolutionReport::still(settings.steps)));
    };
    // Powers of two are taken out of both, so that no square overflows: exp(t A) = exp((2^p t) 2^-p A).
    let (mut a, mut power) = (a.map(|_| balanced), a_exponent);
    let unit = (0.5 * a.rows.iter().map(|&n| n as f64).product::<f64>().log2()).round() as i64;
    share_power(&mut a.train.cores, unit);
    power -= unit;
    let (a, time) = (&a, time * (power as f64).exp2());
    if !time.is_finite() {
        return Err(too_long());
    }
    let norm = start.norm();
    let bonds = 2 * settings.steps * a.num_cores().saturating_sub(1).max(1);
    let share = settings.tolerance * norm / bonds as f64;
    let mut state = Evolution::new(a, &start, settings, share);
    let h = time / settings.steps as f64;
    let mut report = EvolutionReport::still(0);
    let mut half = Evolution::new(a, &start, settings, share);
    half.step(0.5 * h)?;
    half.step(0.5 * h)?;
    let mut before = state.outside(a)?;
    for step in 0..settings.steps {
        state.step(h)?;
        if step == 0 {
            let distance = state.vector().subtract(&half.vector())?.norm();
            report.splitting = 4.0 / 3.0 * distance * settings.steps as f64;
        }
        let after = state.outside(a)?;
        report.projection += 0.5 * h.abs() * (before.0 + after.0);
        report.projection_floor += 0.5 * h.abs() * (before.1 + after.1);
        before = after;
        report.ranks.push(state.x.iter().map(|core| core.right).max().unwrap_or(1));
    }
    (report.truncation, report.capped) = (state.left_out, state.capped);
    let unit = (exponent as f64).exp2();
    for error in
        [&mut report.projection, &mut report.projection_floor, &mut report.truncation, &mut report.splitting]
    {
        *error *= unit;
    }
    let mut result = state.vector();
    share_power(&mut result.cores, exponent);
    Ok((result, report))
}

/// The trains, always swept from the first core (where the centre is) to the last.
struct Evolution<'a> {
    a: Vec<OperatorCore>,
    turned_a: Vec<OperatorCore>,
    x: Vec<BlockCore>,
    right: Vec<Interface>,
    settings: &'a EvolutionSettings,
    /// What one truncation may leave out.
    share: f64,
    left_out: f64,
    capped: bool,
}

impl<'a> Evolution<'a> {
    fn new(a: &TtMatrix, x: &TtVector, settings: &'a EvolutionSettings, share: f64) -> Self {
        let d = a.num_cores();
        let core = |k: usize| {
            OperatorCore::new(a.cores()[k].left, a.rows[k], a.cores()[k].right, &a.cores()[k].data)
        };
        let operators: Vec<OperatorCore> = (0..d).map(core).collect();
        let turned_a: Vec<OperatorCore> = operators.iter().rev().map(OperatorCore::reversed).collect();
        let mut x = x.clone();
        x.orthogonalise_right();
        let block = |core: &Core| BlockCore {
            left: core.left,
            n: core.mode,
            s: 1,
            right: core.right,
            data: core.data.clone(),
        };
        let x: Vec<BlockCore> = x.cores.iter().map(block).collect();
        let mut right = vec![Interface::one(); d];
        for k in (1..d).rev() {
            let turned = x[k].reversed();
            right[k - 1] = right[k].push(&turned, &turned_a[d - 1 - k], &turned);
        }
        Self { a: operators, turned_a, x, right, settings, share, left_out: 0.0, capped: false }
    }

    fn vector(&self) -> TtVector {
        let core = |x: &BlockCore| Core { left: x.left, mode: x.n, right: x.right, data: x.data.clone() };
        TtVector { cores: self.x.iter().map(core).collect() }
    }

    /// One symmetric step: half of it there, half of it back.
    fn step(&mut self, h: f64) -> Result<(), TtError> {
        self.sweep(0.5 * h)?;
        self.sweep(0.5 * h)
    }

    fn sweep(&mut self, h: f64) -> Result<(), TtError> {
        let d = self.x.len();
        let mut left = vec![Interface::one()];
        if self.settings.sites == Sites::Two && d > 1 {
            for k in 0..d - 1 {
                let core = self.a[k].merge(&self.a[k + 1]);
                let pair = self.x[k].merge(&self.x[k + 1]);
                let operator = LocalOperator { left: &left[k], core: &core, right: &self.right[k + 1] };
                let data = exponential(&operator, h, &pair.data).ok_or_else(too_long)?;
                let moved = BlockCore { data, ..pair };
                self.split(k, &moved).map_err(at_core(k))?;
                self.push(k, &mut left);
                if k + 2 < d {
                    let operator =
                        LocalOperator { left: &left[k + 1], core: &self.a[k + 1], right: &self.right[k + 1] };
                    self.x[k + 1].data =
                        exponential(&operator, -h, &self.x[k + 1].data).ok_or_else(too_long)?;
                }
            }
        } else {
            for k in 0..d {
                let operator = LocalOperator { left: &left[k], core: &self.a[k], right: &self.right[k] };
                self.x[k].data = exponential(&operator, h, &self.x[k].data).ok_or_else(too_long)?;
                if k + 1 == d {
                    break;
                }
                let core = &self.x[k];
                let (q, r) = thin_qr(Matrix::from_vec(core.left * core.n, core.right, core.data.clone()));
                self.x[k].right = q.columns();
                self.x[k].data = q.into_vec();
                self.push(k, &mut left);
                let bond = identity_core(self.a[k].right);
                let operator = LocalOperator { left: &left[k + 1], core: &bond, right: &self.right[k] };
                let back = exponential(&operator, -h, r.data()).ok_or_else(too_long)?;
                let carry = Matrix::from_vec(r.rows(), r.columns(), back);
                self.x[k + 1] = self.x[k + 1].multiply_left(carry.view());
            }
        }
        self.turn(left);
        Ok(())
    }

    /// Two cores of one by an SVD, the centre in the second.
    fn split(&mut self, k: usize, pair: &BlockCore) -> Result<(), DenseError> {
        let (first, second) = (self.x[k].clone(), self.x[k + 1].clone());
        let svd = thin_svd(pair.split(&first, &second).view())?;
        let (mut u, s, v) = (svd.u, svd.s, svd.v);
        let (mut rank, mut tail) = (s.len(), 0.0);
        while rank > 1 {
            let more = tail + s[rank - 1].powi(2);
            let fits = more <= self.share * self.share;
            if !fits && rank <= self.settings.max_rank {
                break;
            }
            self.capped |= !fits;
            tail = more;
            rank -= 1;
        }
        self.left_out += tail.sqrt();
        u.truncate_columns(rank);
        let carry = crate::round::scaled_rows(&s, &v, rank);
        self.x[k] = BlockCore { right: rank, data: u.into_vec(), ..first };
        self.x[k + 1] = BlockCore { left: rank, data: carry.into_vec(), ..second };
        Ok(())
    }

    fn push(&self, k: usize, left: &mut Vec<Interface>) {
        let next = left[k].push(&self.x[k], &self.a[k], &self.x[k]);
        left.push(next);
    }

    /// Reverses all trains: what was left of a site is now right of it.
    fn turn(&mut self, left: Vec<Interface>) {
        self.x = self.x.iter().rev().map(BlockCore::reversed).collect();
        std::mem::swap(&mut self.a, &mut self.turned_a);
        self.right = left.into_iter().rev().collect();
    }

    /// ||(I - P) A x|| and what rounding leaves uncertain about it: P A x is a sum over sites (pairs of sites) less one over the bonds (sites) between, of
    /// orthogonal parts, so ||P A x||^2 is the same sum of squares. The trains are in their own order here.
    fn outside(&self, a: &TtMatrix) -> Result<(f64, f64), TtError> {
        let d = self.x.len();
        let image = |operator: &LocalOperator<'_>, u: &[f64]| -> f64 {
            let mut result = vec![0.0; operator.result_size()];
            operator.apply(u, &mut result);
            result.iter().map(|x| x * x).sum()
        };
        let pairs = self.settings.sites == Sites::Two && d > 1;
        let (mut inside, mut left) = (0.0, Interface::one());
        let mut centre = self.x[0].clone();
        for k in 0..d {
            if pairs && k + 1 < d {
                let (core, pair) = (self.a[k].merge(&self.a[k + 1]), centre.merge(&self.x[k + 1]));
                inside +=
                    image(&LocalOperator { left: &left, core: &core, right: &self.right[k + 1] }, &pair.data);
            }
            if !pairs || (k > 0 && k + 1 < d) {
                let site = image(
                    &LocalOperator { left: &left, core: &self.a[k], right: &self.right[k] },
                    &centre.data,
                );
                inside += if pairs { -site } else { site };
            }
            if k + 1 == d {
                break;
            }
            let (q, r) = thin_qr(Matrix::from_vec(centre.left * centre.n, centre.right, centre.data));
            let frame =
                BlockCore { left: centre.left, n: centre.n, s: 1, right: q.columns(), data: q.into_vec() };
            left = left.push(&frame, &self.a[k], &frame);
            if !pairs {
                let bond = identity_core(self.a[k].right);
                inside -= image(&LocalOperator { left: &left, core: &bond, right: &self.right[k] }, r.data());
            }
            centre = self.x[k + 1].multiply_left(r.view());
        }
        let all = a.times_vector(&self.vector())?.norm().powi(2);
        // (Squares right to some 1e-15 per core.)
        let floor = (1e-15 * d as f64 * all).sqrt();
        Ok(((all - inside).max(0.0).sqrt(), floor))
    }
}

fn too_long() -> TtError {
    TtError::Setting {
        what: "time step",
        need: "shorter (local exponentials do not converge, or grow)",
        got: f64::NAN,
    }
}

/// The core that leaves a bond as it is.
fn identity_core(rank: usize) -> OperatorCore {
    OperatorCore { left: rank, n: 1, right: rank, matrix: Matrix::identity(rank) }
}

/// exp(h B) v; none where the step is too long for it.
fn exponential(operator: &LocalOperator<'_>, h: f64, v: &[f64]) -> Option<Vec<f64>> {
    let size = norm(v);
    if size == 0.0 {
        return Some(v.to_vec());
    }
    let moved = if v.len() <= DENSE {
        let mut matrix = operator.to_matrix();
        matrix.data_mut().iter_mut().for_each(|x| *x *= h);
        product(matrix_exponential(&matrix).view(), View::new(v, v.len(), 1)).into_vec()
    } else {
        let (mut left, mut step, mut halvings, mut u) = (h, h, 0, v.to_vec());
        while left != 0.0 {
            match krylov(operator, step, &u) {
                Some(next) => {
                    u = next;
                    left -= step;
                    step = if left.abs() < step.abs() { left } else { step };
                }
                None if halvings == HALVINGS => return None,
                None => {
                    halvings += 1;
                    step *= 0.5;
                }
            }
        }
        u
    };
    // (False for what is not a number.)
    (norm(&moved) <= GROWTH * size).then_some(moved)
}

/// exp(h B) v from a Krylov space (Y. Saad, SIAM J. Numer. Anal. 29, 1992); none if the space is too small for the step.
fn krylov(operator: &LocalOperator<'_>, h: f64, v: &[f64]) -> Option<Vec<f64>> {
    let n = v.len();
    let beta = norm(v);
    let mut basis = vec![v.iter().map(|x| x / beta).collect::<Vec<f64>>()];
    let mut projected = Matrix::zeros(KRYLOV + 1, KRYLOV);
    for k in 0..KRYLOV.min(n) {
        let mut next = vec![0.0; n];
        operator.apply(&basis[k], &mut next);
        let before = norm(&next);
        for _ in 0..2 {
            for (i, q) in basis.iter().enumerate() {
                let weight: f64 = q.iter().zip(&next).map(|(q, x)| q * x).sum();
                projected[(i, k)] += weight;
                next.iter_mut().zip(q).for_each(|(x, q)| *x -= weight * q);
            }
        }
        let length = norm(&next);
        projected[(k + 1, k)] = length;
        let m = k + 1;
        let done = length <= 1e-14 * before || m == n;
        // (Small spaces are asked seldom: their exponential costs more than it may save.)
        if done || m == KRYLOV || m % 5 == 0 {
            let small = matrix_exponential(&Matrix::from_fn(m, m, |i, j| h * projected[(i, j)]));
            let missing = (h * length * small[(m - 1, 0)]).abs();
            if done || missing <= LOCAL {
                let mut result = vec![0.0; n];
                for (i, q) in basis.iter().enumerate() {
                    let weight = beta * small[(i, 0)];
                    result.iter_mut().zip(q).for_each(|(x, q)| *x += weight * q);
                }
                return Some(result);
            }
        }
        basis.push(next.iter().map(|x| x / length).collect());
    }
    None
}

/// exp(M) by its series, scaled to a norm of at most 1/2 and squared again.
fn matrix_exponential(matrix: &Matrix) -> Matrix {
    let n = matrix.rows();
    let largest = (0..n).map(|j| matrix.column(j).iter().map(|x| x.abs()).sum()).fold(0.0_f64, f64::max);
    let squarings = if largest > 0.5 { (2.0 * largest).log2().ceil().min(60.0) as i32 } else { 0 };
    let scale = f64::from(-squarings).exp2();
    let scaled = Matrix::from_fn(n, n, |i, j| scale * matrix[(i, j)]);
    let (mut sum, mut term) = (Matrix::identity(n), Matrix::identity(n));
    // 2^-17 / 17! is 2e-20.
    for k in 1..=16 {
        term = product(term.view(), scaled.view());
        term.data_mut().iter_mut().for_each(|x| *x /= f64::from(k));
        sum.data_mut().iter_mut().zip(term.data()).for_each(|(s, t)| *s += t);
    }
    for _ in 0..squarings {
        sum = product(sum.view(), sum.view());
    }
    sum
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}
