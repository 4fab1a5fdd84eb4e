//! x' = A x in the format: the time-dependent variational principle with one or two sites (J. Haegeman, C.
//! Lubich, I. Oseledets, B. Vandereycken, F. Verstraete, Phys. Rev. B 94, 2016), a symmetric splitting of
//! second order.
//!
//! With the other cores orthogonal, a core (or two neighbours) follows exp(h B), B the projection of A; what
//! is carried to the next core goes back by exp(-h K), because both sides counted it. One site keeps the
//! ranks of the start, two sites let them follow the truncation.
//!
//! Three errors are made and all are reported, as absolute norms at the end of the run. Projection: x'
//! follows P A x, and ||(I - P) A x|| is measured at every step. Truncation: what the SVDs of two sites leave
//! out. Both are carried to the end by e^(mu (T - t)), mu the largest eigenvalue of (A + A^T) / 2 (the
//! logarithmic norm), which no error outgrows. Splitting: from the distance of the result from that of half
//! as many steps (one site: and of a quarter), so what becomes of it on the way is in it. That is half (three
//! quarters) of the price of a run.
//!
//! (I - P) A x is made of orthogonal parts: A x in the coordinates of the frames leaves the space of the left
//! frames first at site k and that of the right frames last at site l, and P misses k < l (one site) or k + 1
//! < l (two). Each part is found by subtracting a projection, twice, where it arises, so that a projection
//! that misses nothing is known to be one to 1e-15; a difference of squares would end at 1e-8.

use super::eigen::{EigenSettings, lowest_eigenpairs_within};
use super::interface::{BlockCore, Interface, LocalOperator, OperatorCore};
use crate::error::at_core;
use crate::scale::share_power;
use crate::symmetric::SymmetricTrain;
use crate::vector::Core;
use crate::{Stop, Truncation, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{DenseError, Matrix, View, multiply_add, product, thin_qr, thin_svd};
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

/// Residual of the logarithmic norm relative to A, and the largest rank of its vector: what they leave open
/// is added to it.
const GROWTH_TOLERANCE: f64 = 1e-4;
const GROWTH_RANK: usize = 30;
/// What is laid upon the splitting found: orders are not settled in few steps.
const SAFETY: f64 = 2.0;
/// Steps at most: the report has a rank for each.
const MOST_STEPS: usize = 1 << 24;
/// Orders of the splitting in the length of the steps that are believed, and the one where it is not known.
const ORDERS: (f64, f64) = (0.3, 2.0);
const UNKNOWN_ORDER: f64 = 0.5;
/// A run of fewer steps says nothing of orders.
const ENOUGH_STEPS: usize = 4;
/// Units of rounding in ||(I - P) A x||, relative to ||A x||.
const EPSILONS: f64 = 20.0;

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
    /// The integral of e^(mu (T - t)) ||(I - P) A x||, what the directions that the cores cannot take would
    /// have done: by the trapezoidal rule for one site, from the ends of the steps for two.
    pub projection: f64,
    /// Sum of what the truncations left out, each carried to the end by e^(mu (T - t)).
    pub truncation: f64,
    /// Twice what steps of finite length leave, by the distance of the result from that of half as many steps
    /// (one site: and of a quarter).
    pub splitting: f64,
    /// Rounding and the tolerance of the local exponentials: no error is known below this.
    pub floor: f64,
    /// mu times the time: no error grows or shrinks by more than e to this. Largest eigenvalue of (A + A^T) /
    /// 2 found, with its residual; a larger one that was missed is not excluded.
    pub growth: f64,
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
            truncation: 0.0,
            splitting: 0.0,
            floor: 0.0,
            growth: 0.0,
            capped: false,
            ranks: vec![1; steps],
        }
    }

    /// The sum of the three errors and the floor: what ||x - exact|| is expected not to exceed.
    pub fn error(&self) -> f64 {
        self.projection + self.truncation + self.splitting + self.floor
    }
}

/// exp(time A) x for any square A, symmetric or not. (i A of a real symmetric A is the real matrix
/// [0 -A; A 0] on one more digit.)
///
/// For stiff A (time / steps times the norm of A much above 10, diffusion on fine grids) the backward parts
/// of the sweep grow and the step is refused: take implicit steps by [`solve`](super::solve) there. O(steps d
/// (n^2 r^3 R + n^3 r^2 R^2)) per Krylov vector.
///
/// # Errors
/// [`TtError::Shape`] if the sizes do not fit, [`TtError::Setting`] for a bad setting or a time step that is
/// too long, [`TtError::Dense`] for entries that are not finite.
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
    evolve_within(a, x, time, settings, &|| false)
}

/// As [`evolve`], as long as `stop` is false: it is asked at every site.
///
/// # Errors
/// As for [`evolve`], and [`TtError::Stopped`].
pub fn evolve_within(
    a: &TtMatrix,
    x: &TtVector,
    time: f64,
    settings: &EvolutionSettings,
    stop: Stop<'_>,
) -> Result<(TtVector, EvolutionReport), TtError> {
    a.check_square()?;
    a.check_columns(x)?;
    Truncation::capped(settings.tolerance, settings.max_rank).check()?;
    if !(1..=MOST_STEPS).contains(&settings.steps) {
        let got = settings.steps as f64;
        return Err(TtError::Setting { what: "steps", need: "in 1..=2^24", got });
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
    let mu = logarithmic_norm(a, time.signum(), stop)?;
    let with_steps = |steps: usize| -> Result<TtVector, TtError> {
        let mut other = Evolution::new(a, &start, settings, share, stop);
        for _ in 0..steps {
            other.step(time / steps as f64)?;
        }
        Ok(other.vector())
    };
    let mut state = Evolution::new(a, &start, settings, share, stop);
    let h = time / settings.steps as f64;
    let mut report = EvolutionReport::still(0);
    report.growth = mu * time.abs();
    let mut before = state.outside(a)?;
    for step in 0..settings.steps {
        let truncated = state.left_out;
        state.step(h)?;
        let after = state.outside(a)?;
        // What is made in this step is carried over it and all that follow (what is made at its end over
        // those alone).
        let remaining = |end: usize| report.growth * (settings.steps - end) as f64 / settings.steps as f64;
        let (begin, end) = (remaining(step).exp(), remaining(step + 1).exp());
        let carry = begin.max(end);
        // (Two sites take up directions within a step: what is outside at its beginning and no longer at its
        // end shows as splitting.)
        let first = if settings.sites == Sites::Two { end * after.outside } else { begin * before.outside };
        report.projection += 0.5 * h.abs() * (first + end * after.outside);
        report.truncation += carry * (state.left_out - truncated);
        let made = 2.0 * EPSILONS * f64::EPSILON * h.abs() * before.all.max(after.all)
            + 4.0 * a.num_cores() as f64 * LOCAL * before.size.max(after.size);
        report.floor += carry * made;
        before = after;
        report.ranks.push(state.x.iter().map(|core| core.right).max().unwrap_or(1));
    }
    report.splitting = splitting(&state.vector(), settings.steps, settings.sites, with_steps)?;
    report.capped = state.capped;
    let unit = (exponent as f64).exp2();
    for error in [&mut report.projection, &mut report.floor, &mut report.truncation, &mut report.splitting] {
        *error *= unit;
    }
    let mut result = state.vector();
    share_power(&mut result.cores, exponent);
    Ok((result, report))
}

/// The error that is left by steps of finite length, from the distance to a run of half the steps. For one
/// site a run of a quarter of them says how it shrinks with the steps, like h^p; two sites take up new
/// directions in their first steps at an order that no later one shows, so for them p is taken to be 1/2.
/// (Where half as many are too few: twice as many.)
fn splitting(
    x: &TtVector,
    steps: usize,
    sites: Sites,
    with_steps: impl Fn(usize) -> Result<TtVector, TtError>,
) -> Result<f64, TtError> {
    let half = steps / 2;
    let coarser = if half > 0 { with_steps(half).ok() } else { None };
    let Some(coarser) = coarser else {
        let finer = with_steps(2 * steps)?;
        return Ok(SAFETY * x.subtract(&finer)?.norm() / (1.0 - (-UNKNOWN_ORDER).exp2()));
    };
    let distance = x.subtract(&coarser)?.norm();
    let ratio = |other: usize| steps as f64 / other as f64;
    let quarter = steps / 4;
    let mut order = UNKNOWN_ORDER;
    if sites == Sites::One
        && quarter >= ENOUGH_STEPS
        && let Ok(coarsest) = with_steps(quarter)
    {
        let further = x.subtract(&coarsest)?.norm();
        // (r_4^p - 1) / (r_2^p - 1) grows with p.
        let (mut low, mut high) = ORDERS;
        for _ in 0..30 {
            order = 0.5 * (low + high);
            let grows =
                (ratio(quarter).powf(order) - 1.0) * distance > (ratio(half).powf(order) - 1.0) * further;
            (low, high) = if grows { (low, order) } else { (order, high) };
        }
    }
    Ok(SAFETY * distance / (ratio(half).powf(order) - 1.0))
}

/// The largest eigenvalue of sign (A + A^T) / 2, plus its residual: exp(t A) lets nothing grow faster (G.
/// Dahlquist 1958).
fn logarithmic_norm(a: &TtMatrix, sign: f64, stop: Stop<'_>) -> Result<f64, TtError> {
    let symmetric = SymmetricTrain::symmetric_part(a)?.to_matrix();
    // (A skew matrix leaves rounding; powers of two have been taken out of A.)
    if symmetric.norm() <= 1e-14 * a.norm() {
        return Ok(0.0);
    }
    let (symmetric, report) = symmetric.round(&Truncation::to(1e-14))?;
    let symmetric = SymmetricTrain::symmetric_part(&symmetric)?.to_matrix();
    let settings = EigenSettings { tolerance: GROWTH_TOLERANCE, max_rank: GROWTH_RANK, ..Default::default() };
    let lowest = lowest_eigenpairs_within(&symmetric.scale(-sign), 1, &settings, stop)?;
    let rounded = (report.error + report.floor) * report.norm;
    Ok(lowest.first().map_or(0.0, |pair| pair.residual + rounded - pair.value))
}

/// (I - P) A x and the numbers beside it.
struct Outside {
    /// ||(I - P) A x||.
    outside: f64,
    /// ||A x||.
    all: f64,
    /// ||x||.
    size: f64,
}

/// The trains, always swept from the first core (where the centre is) to the last.
struct Evolution<'a> {
    a: Vec<OperatorCore>,
    turned_a: Vec<OperatorCore>,
    x: Vec<BlockCore>,
    right: Vec<Interface>,
    settings: &'a EvolutionSettings,
    stop: Stop<'a>,
    /// What one truncation may leave out.
    share: f64,
    left_out: f64,
    capped: bool,
}

impl<'a> Evolution<'a> {
    fn new(a: &TtMatrix, x: &TtVector, settings: &'a EvolutionSettings, share: f64, stop: Stop<'a>) -> Self {
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
        Self { a: operators, turned_a, x, right, settings, stop, share, left_out: 0.0, capped: false }
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
                crate::go_on(self.stop)?;
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
                crate::go_on(self.stop)?;
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

    /// ||(I - P) A x||. The trains are in their own order here, the centre in the first core. O(d n (R r)^3).
    fn outside(&self, a: &TtMatrix) -> Result<Outside, TtError> {
        let d = self.x.len();
        let image = a.times_vector(&self.vector())?;
        let pairs = self.settings.sites == Sites::Two && d > 1;
        // From the right: `inside`, the coordinates in the right frame, and `leaving`, a triangle of what
        // lies outside it, of the part of A x right of a bond.
        let mut leaving = vec![Matrix::zeros(1, 0); d];
        let mut later = vec![Matrix::zeros(1, 0); d];
        let mut inside = Matrix::identity(1);
        for k in (1..d).rev() {
            let (core, frame) = (&image.cores[k], &self.x[k]);
            let wide = core.multiply_right(inside.view());
            let frame = Matrix::from_vec(frame.left, frame.n * frame.right, frame.data.clone());
            let (coordinates, rest) =
                apart(&Matrix::from_vec(wide.left, wide.mode * wide.right, wide.data), &frame);
            let carried = core.multiply_right(leaving[k].view());
            later[k - 1] =
                triangle_of(Matrix::from_vec(carried.left, carried.mode * carried.right, carried.data));
            leaving[k - 1] = triangle_of(beside(&later[k - 1], &rest));
            inside = coordinates;
        }
        // From the left: what leaves the left frames at site k, times what leaves the right ones later.
        let (mut squares, mut coordinates) = (0.0_f64, Matrix::identity(1));
        let mut centre = self.x[0].clone();
        for k in 0..d - 1 {
            let (q, r) = thin_qr(Matrix::from_vec(centre.left * centre.n, centre.right, centre.data));
            let here = image.cores[k].multiply_left(coordinates.view());
            let here = Matrix::from_vec(here.left * here.mode, here.right, here.data);
            let (transposed, rest) = apart(&here.transposed(), &q.transposed());
            let missed = if pairs { &later[k] } else { &leaving[k] };
            if missed.columns() > 0 {
                let part = product(rest.transposed().view(), missed.view());
                squares += part.data().iter().map(|x| x * x).sum::<f64>();
            }
            coordinates = transposed.transposed();
            centre = self.x[k + 1].multiply_left(r.view());
        }
        Ok(Outside { outside: squares.sqrt(), all: image.norm(), size: norm(&centre.data) })
    }
}

/// M = C F + rest for orthonormal rows of F: C and the rest, projected twice.
fn apart(m: &Matrix, frame: &Matrix) -> (Matrix, Matrix) {
    let coordinates = product(m.view(), frame.t());
    let mut rest = m.clone();
    let mut subtract = |c: &Matrix| {
        multiply_add(-1.0, c.view(), frame.view(), rest.view_mut());
        product(rest.view(), frame.t())
    };
    let again = subtract(&coordinates);
    subtract(&again);
    (coordinates, rest)
}

/// L with L L^T = M M^T, no wider than high.
fn triangle_of(m: Matrix) -> Matrix {
    if m.columns() <= m.rows() { m } else { thin_qr(m.transposed()).1.transposed() }
}

/// [A B].
fn beside(a: &Matrix, b: &Matrix) -> Matrix {
    Matrix::from_vec(a.rows(), a.columns() + b.columns(), [a.data(), b.data()].concat())
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

/// exp(h B) v from a Krylov space (Y. Saad, SIAM J. Numer. Anal. 29, 1992); none if the space is too small
/// for the step.
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
