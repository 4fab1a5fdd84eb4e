//! Quantized trains (modes of size 2) with known ranks, from explicit formulas.
//!
//! Kazeev and Khoromskij (SIAM J. Matrix Anal. Appl. 33, 2012) write a train as a strong Kronecker product
//! F_1 >< F_2 >< ... >< F_d of matrices of 2x2 blocks, coarsest digit first: blocks are multiplied as a
//! matrix product whose scalar product is the Kronecker product. Cores here are numbered from the finest
//! digit, so core k is F_{d+1-k} with its rank indices exchanged.

use crate::vector::Core;
use crate::{Truncation, TtError, TtMatrix, TtVector};
use serde::{Deserialize, Serialize};

/// A 2x2 block, column-major.
type Block = [f64; 4];

const ZERO: Block = [0.0; 4];
/// The identity I.
const EYE: Block = [1.0, 0.0, 0.0, 1.0];
/// J = [[0, 1], [0, 0]]: the superdiagonal.
const UPPER: Block = [0.0, 0.0, 1.0, 0.0];
/// J^T: the subdiagonal.
const LOWER: Block = [0.0, 1.0, 0.0, 0.0];
/// E: all ones.
const ONES: Block = [1.0; 4];

fn scaled(block: Block, a: f64) -> Block {
    block.map(|x| a * x)
}

fn sum(blocks: &[Block]) -> Block {
    let mut total = ZERO;
    blocks.iter().for_each(|block| total.iter_mut().zip(block).for_each(|(t, x)| *t += x));
    total
}

/// first >< middle^(d - 2) >< last, coarsest first; each factor is given by rows of blocks. For d = 1 the sum
/// over the rank index of the products of `first` and `last` does not exist, so d >= 2.
fn strong_kronecker(
    d: usize,
    first: &[&[Block]],
    middle: &[&[Block]],
    last: &[&[Block]],
) -> Result<TtMatrix, TtError> {
    if d < 2 {
        return Err(TtError::Setting { what: "number of digits", need: "at least 2", got: d as f64 });
    }
    let core = |factor: &[&[Block]]| {
        Core::from_fn(factor[0].len(), 4, factor.len(), |alpha, b, beta| factor[beta][alpha][b])
    };
    let mut cores = vec![core(last)];
    cores.extend((0..d - 2).map(|_| core(middle)));
    cores.push(core(first));
    TtMatrix::from_cores(cores, &vec![2; d], &vec![2; d])
}

/// The 2^d x 2^d tridiagonal Toeplitz matrix with `sub`, `diagonal` and `superdiagonal`; ranks 3.
///
/// [I J' J] >< [I J' J; 0 J 0; 0 0 J']^(d-2) >< [a I + b J' + c J; b J; c J'] (Kazeev and Khoromskij 2012).
///
/// # Errors
/// [`TtError::Setting`] for d < 2.
pub fn tridiagonal(d: usize, sub: f64, diagonal: f64, superdiagonal: f64) -> Result<TtMatrix, TtError> {
    let corner = sum(&[scaled(EYE, diagonal), scaled(LOWER, sub), scaled(UPPER, superdiagonal)]);
    strong_kronecker(
        d,
        &[&[EYE, LOWER, UPPER]],
        &[&[EYE, LOWER, UPPER], &[ZERO, UPPER, ZERO], &[ZERO, ZERO, LOWER]],
        &[&[corner], &[scaled(UPPER, sub)], &[scaled(LOWER, superdiagonal)]],
    )
}

/// The digits of an index, fine to coarse: index = i_1 + n_1 i_2 + n_1 n_2 i_3 + ...; none if it lies
/// outside.
///
/// ```
/// use graintrain_tt::qtt;
/// assert_eq!(qtt::digits(11, &[3, 2, 2]), Some(vec![2, 1, 1]));
/// assert_eq!(qtt::index(&[2, 1, 1], &[3, 2, 2]), Some(11));
/// assert_eq!(qtt::digits(12, &[3, 2, 2]), None);
/// ```
pub fn digits(mut index: usize, modes: &[usize]) -> Option<Vec<usize>> {
    let mut digits = Vec::with_capacity(modes.len());
    for &n in modes {
        digits.push(index.checked_rem(n)?);
        index /= n;
    }
    (index == 0).then_some(digits)
}

/// The index of digits, fine to coarse: the inverse of [`digits`]; none if a digit is outside its mode or the
/// index overflows.
pub fn index(digits: &[usize], modes: &[usize]) -> Option<usize> {
    let mut index = 0usize;
    for (&i, &n) in digits.iter().zip(modes).rev() {
        index = index.checked_mul(n)?.checked_add(i)?;
        if i >= n {
            return None;
        }
    }
    (digits.len() == modes.len()).then_some(index)
}

/// The place of a point of 2^levels x 2^levels x ... in Morton order: the bits of the coordinates
/// interleaved, those of axis 1 lowest, as [`DigitOrder::Morton`] orders the digits; none if a coordinate has
/// more bits or the place overflows.
///
/// ```
/// use graintrain_tt::qtt;
/// assert_eq!(qtt::morton(&[0b01, 0b11], 2), Some(0b1011));
/// assert_eq!(qtt::morton_coordinates(0b1011, 2, 2), Some(vec![0b01, 0b11]));
/// ```
pub fn morton(coordinates: &[usize], levels: usize) -> Option<usize> {
    let axes = coordinates.len();
    let fits = levels.checked_mul(axes)? <= usize::BITS as usize
        && coordinates.iter().all(|x| levels >= usize::BITS as usize || x >> levels == 0);
    let bits = || (0..levels).flat_map(|level| (0..axes).map(move |axis| (level, axis)));
    fits.then(|| bits().map(|(level, axis)| (coordinates[axis] >> level & 1) << (axis + axes * level)).sum())
}

/// The coordinates of a place in Morton order: the inverse of [`morton`]; none if the place lies outside.
pub fn morton_coordinates(place: usize, axes: usize, levels: usize) -> Option<Vec<usize>> {
    let bits = levels.checked_mul(axes).filter(|&bits| bits <= usize::BITS as usize)?;
    if bits < usize::BITS as usize && place >> bits != 0 {
        return None;
    }
    let coordinate =
        |axis: usize| (0..levels).map(|level| (place >> (axis + axes * level) & 1) << level).sum();
    Some((0..axes).map(coordinate).collect())
}

/// The negative second difference tridiag(-1, 2, -1) with zero values beyond both ends; ranks 3.
///
/// # Errors
/// [`TtError::Setting`] for d < 2.
pub fn laplacian(d: usize) -> Result<TtMatrix, TtError> {
    tridiagonal(d, -1.0, 2.0, -1.0)
}

/// What holds beyond one end of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Boundary {
    /// The value is zero: diagonal entry 2.
    Dirichlet,
    /// The difference is zero: diagonal entry 1.
    Neumann,
}

/// The second difference with a choice at each end; ranks 3 and one more per Neumann end. (No rounding: it
/// would lose the ends of long lines, where one entry is nothing beside the norm.)
///
/// # Errors
/// [`TtError::Setting`] for d < 2.
pub fn laplacian_with(d: usize, first: Boundary, last: Boundary) -> Result<TtMatrix, TtError> {
    let mut a = laplacian(d)?;
    for (boundary, digit) in [(first, 0), (last, 1)] {
        if boundary == Boundary::Neumann {
            let end = TtVector::unit(&vec![2; d], &vec![digit; d])?;
            a = a.subtract(&TtMatrix::from_diagonal(&end))?;
        }
    }
    Ok(a)
}

/// Ones on the first subdiagonal; ranks 2.
///
/// # Errors
/// [`TtError::Setting`] for d < 2.
pub fn shift(d: usize) -> Result<TtMatrix, TtError> {
    strong_kronecker(d, &[&[EYE, LOWER]], &[&[EYE, LOWER], &[ZERO, UPPER]], &[&[LOWER], &[UPPER]])
}

/// Ones on the first subdiagonal and in the upper right corner (a cyclic permutation); ranks 2.
///
/// # Errors
/// [`TtError::Setting`] for d < 2.
pub fn periodic_shift(d: usize) -> Result<TtMatrix, TtError> {
    let both = sum(&[LOWER, UPPER]);
    strong_kronecker(d, &[&[EYE, both]], &[&[EYE, LOWER], &[ZERO, UPPER]], &[&[LOWER], &[UPPER]])
}

/// The lower triangle of ones (cumulative sum); ranks 2.
///
/// # Errors
/// [`TtError::Setting`] for d < 2.
pub fn cumulative_sum(d: usize) -> Result<TtMatrix, TtError> {
    let diagonal = sum(&[EYE, LOWER]);
    strong_kronecker(d, &[&[EYE, LOWER]], &[&[EYE, LOWER], &[ZERO, ONES]], &[&[diagonal], &[ONES]])
}

/// The Kronecker product of one operator per axis with the digits of the axes interleaved (Morton order):
/// level by level, axis 1 first. Ranks are the products of the ranks of all axes at that level.
///
/// # Errors
/// [`TtError::Shape`] if there is no axis or the axes have different numbers of digits.
pub fn interleave(axes: &[TtMatrix]) -> Result<TtMatrix, TtError> {
    let levels = axes.first().map_or(0, TtMatrix::num_cores);
    let got: Vec<usize> = axes.iter().map(TtMatrix::num_cores).collect();
    if levels == 0 || got.iter().any(|&d| d != levels) {
        return Err(TtError::Shape {
            what: "digits per axis",
            expected: vec![levels; axes.len().max(1)],
            got,
        });
    }
    let (mut cores, mut rows, mut columns) = (Vec::new(), Vec::new(), Vec::new());
    for level in 0..levels {
        for (axis, operator) in axes.iter().enumerate() {
            // Ranks of the axes that already passed this level are right ranks, of the others left ranks.
            let rank = |other: usize| {
                let core = &axes[other].cores()[level];
                if other < axis { core.right() } else { core.left() }
            };
            let before: usize = (0..axis).map(rank).product();
            let after: usize = (axis + 1..axes.len()).map(rank).product();
            let core = &operator.cores()[level];
            let entry = |alpha: usize, b: usize, beta: usize| {
                let (front, front_out) = (alpha % before, beta % before);
                let (own, own_out) = ((alpha / before) % core.left(), (beta / before) % core.right());
                let (back, back_out) = (alpha / (before * core.left()), beta / (before * core.right()));
                if front == front_out && back == back_out { core.get(own, b, own_out) } else { 0.0 }
            };
            cores.push(Core::from_fn(
                before * core.left() * after,
                core.mode(),
                before * core.right() * after,
                entry,
            ));
            rows.push(operator.row_modes()[level]);
            columns.push(operator.column_modes()[level]);
        }
    }
    TtMatrix::from_cores(cores, &rows, &columns)
}

/// How the digits of several axes are arranged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DigitOrder {
    /// All digits of the first axis, then all of the second, ...
    Separated,
    /// One digit of each axis per level: Morton (Z) order.
    Morton,
}

/// sum_a I (x) ... L_a ... (x) I for one operator per axis, rounded to rounding level.
///
/// With `laplacian(d)` on each axis this is the Laplacian of a 2^d x ... x 2^d grid.
///
/// # Errors
/// [`TtError::Shape`] if there is no axis, or in Morton order the axes have different numbers of digits.
///
/// ```
/// use graintrain_tt::qtt::{DigitOrder, kronecker_sum, laplacian};
/// let line = laplacian(3)?;
/// let cube = kronecker_sum(&[line.clone(), line.clone(), line], DigitOrder::Morton)?;
/// assert_eq!(cube.max_rank(), 7);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn kronecker_sum(axes: &[TtMatrix], order: DigitOrder) -> Result<TtMatrix, TtError> {
    let mut total: Option<TtMatrix> = None;
    for active in 0..axes.len() {
        let mut factors = Vec::with_capacity(axes.len());
        for (axis, operator) in axes.iter().enumerate() {
            operator.check_square()?;
            factors.push(if axis == active {
                operator.clone()
            } else {
                TtMatrix::identity(operator.row_modes())?
            });
        }
        let term = match order {
            DigitOrder::Morton => interleave(&factors)?,
            DigitOrder::Separated => {
                factors.iter().skip(1).fold(factors[0].clone(), |product, factor| product.kronecker(factor))
            }
        };
        total = Some(match total {
            None => term,
            // Not rounded: an axis whose operator is 1e-15 of another's would be lost.
            Some(sum) => sum.add(&term)?.without_dependent_ranks(),
        });
    }
    total.ok_or(TtError::Shape { what: "number of axes", expected: vec![1], got: vec![0] })
}

/// exp(a j + b), j = 0, ..., 2^d - 1; rank 1.
///
/// # Errors
/// [`TtError::Shape`] for d = 0.
pub fn exponential(d: usize, a: f64, b: f64) -> Result<TtVector, TtError> {
    let factor = |k: usize| {
        let step = a * (k as f64).exp2();
        if k == 0 { vec![b.exp(), (b + step).exp()] } else { vec![1.0, step.exp()] }
    };
    TtVector::rank_one(&(0..d).map(factor).collect::<Vec<_>>())
}

/// sin(a j + b), j = 0, ..., 2^d - 1; ranks 2, each core a rotation by the angle of its digit.
///
/// # Errors
/// [`TtError::Setting`] for d < 2.
pub fn sine(d: usize, a: f64, b: f64) -> Result<TtVector, TtError> {
    if d < 2 {
        return Err(TtError::Setting { what: "number of digits", need: "at least 2", got: d as f64 });
    }
    let angle = |k: usize, i: usize| a * (k as f64).exp2() * i as f64 + if k == 0 { b } else { 0.0 };
    // The row (cos, sin) of the running angle times [cos t, sin t; -sin t, cos t] is (cos, sin) of the sum.
    let core = |k: usize| {
        let (left, right) = (if k == 0 { 1 } else { 2 }, if k + 1 == d { 1 } else { 2 });
        Core::from_fn(left, 2, right, |alpha, i, beta| {
            let (sin, cos) = angle(k, i).sin_cos();
            // The last core keeps only the sine column.
            match (alpha, if right == 1 { 1 } else { beta }) {
                (0, 0) | (1, 1) => cos,
                (0, 1) => sin,
                _ => -sin,
            }
        })
    };
    TtVector::from_cores((0..d).map(core).collect())
}

/// sum_p c_p x_j^p at x_j = origin + step j, j = 0, ..., 2^d - 1; ranks at most degree + 1.
///
/// The row of powers (x^q / q!) of the running sum is carried by (x + t)^q / q! = sum_p x^p / p! t^(q-p) /
/// (q-p)!
///
/// # Errors
/// [`TtError::Setting`] for d < 2 or no coefficient.
pub fn polynomial(d: usize, coefficients: &[f64], origin: f64, step: f64) -> Result<TtVector, TtError> {
    if d < 2 || coefficients.is_empty() {
        let got = d.min(coefficients.len()) as f64;
        return Err(TtError::Setting { what: "digits and coefficients", need: "at least 2 and 1", got });
    }
    let terms = coefficients.len();
    let mut factorial = vec![1.0; terms];
    for p in 1..terms {
        factorial[p] = factorial[p - 1] * p as f64;
    }
    let power =
        |t: f64, p: usize, q: usize| if q >= p { t.powi((q - p) as i32) / factorial[q - p] } else { 0.0 };
    let core = |k: usize| {
        let left = if k == 0 { 1 } else { terms };
        let last = k + 1 == d;
        Core::from_fn(left, 2, if last { 1 } else { terms }, |alpha, i, beta| {
            let t = step * (k as f64).exp2() * i as f64 + if k == 0 { origin } else { 0.0 };
            if last {
                (0..terms).map(|q| coefficients[q] * factorial[q] * power(t, alpha, q)).sum()
            } else {
                power(t, alpha, beta)
            }
        })
    };
    TtVector::from_cores((0..d).map(core).collect())
}

/// 1 / (offset + i_1 + ... + i_D) over 0-based indices of the given modes, to a relative accuracy `tolerance`
/// in the Frobenius norm: a sum of exponentials that has this accuracy in every entry, 1 / x = integral of
/// exp(-x t), by the trapezoidal rule in t = ln(1 + e^u) (Hackbusch and Braess), each term of rank 1, then
/// rounded to a thousandth of the tolerance. (So entries a thousand times smaller than the largest ones may
/// lose relative accuracy.)
///
/// With modes (n, n) and offset 1 it is the Hilbert matrix.
///
/// # Errors
/// [`TtError::Setting`] unless offset > 0 and tolerance in (0, 1); [`TtError::Shape`] for an empty mode.
pub fn hilbert(modes: &[usize], offset: f64, tolerance: f64) -> Result<TtVector, TtError> {
    let largest = offset + modes.iter().map(|&n| n.saturating_sub(1) as f64).sum::<f64>();
    let weights: Vec<f64> = vec![1.0; modes.len()];
    reciprocal_of_sum(modes, &weights, offset, largest, tolerance)
}

/// The 2^d x 2^d Hilbert matrix 1 / (i + j + 1) in quantized form, to a relative accuracy in the Frobenius
/// norm.
///
/// # Errors
/// [`TtError::Setting`] unless tolerance is in (0, 1), [`TtError::Shape`] for d = 0.
pub fn hilbert_matrix(d: usize, tolerance: f64) -> Result<TtMatrix, TtError> {
    // The paired digit (i, j) contributes 2^k (i + j): exponentials factor over i and j.
    let terms = exponential_sum(1.0, ((d + 1) as f64).exp2(), tolerance)?;
    let mut total: Option<TtVector> = None;
    for (weight, rate) in terms {
        let factor = |k: usize| {
            let e = |digits: usize| (-rate * (digits as f64 * (k as f64).exp2() + f64::from(k == 0))).exp();
            let scale = if k == 0 { weight } else { 1.0 };
            vec![scale * e(0), scale * e(1), scale * e(1), scale * e(2)]
        };
        let term = TtVector::rank_one(&(0..d).map(factor).collect::<Vec<_>>())?;
        total = Some(accumulate(total, term, tolerance)?);
    }
    let train = total.ok_or(TtError::Shape { what: "number of digits", expected: vec![1], got: vec![d] })?;
    TtMatrix::from_vector(train, &vec![2; d], &vec![2; d])
}

fn reciprocal_of_sum(
    modes: &[usize],
    weights: &[f64],
    offset: f64,
    largest: f64,
    tolerance: f64,
) -> Result<TtVector, TtError> {
    let mut total: Option<TtVector> = None;
    for (weight, rate) in exponential_sum(offset, largest, tolerance)? {
        let factor = |k: usize| {
            let constant = if k == 0 { offset } else { 0.0 };
            let scale = if k == 0 { weight } else { 1.0 };
            (0..modes[k]).map(|i| scale * (-rate * (weights[k] * i as f64 + constant)).exp()).collect()
        };
        let term = TtVector::rank_one(&(0..modes.len()).map(factor).collect::<Vec<_>>())?;
        total = Some(accumulate(total, term, tolerance)?);
    }
    total.ok_or(TtError::Shape { what: "number of modes", expected: vec![1], got: vec![0] })
}

/// sum + term, rounded far below the tolerance.
fn accumulate(sum: Option<TtVector>, term: TtVector, tolerance: f64) -> Result<TtVector, TtError> {
    match sum {
        None => Ok(term),
        Some(sum) => Ok(sum.add(&term)?.round(&Truncation::to((tolerance * 1e-3).max(1e-15)))?.0),
    }
}

/// Weights and rates with |1/x - sum w exp(-rate x)| <= tolerance / x on [smallest, largest].
///
/// 1 / x = integral over u of exp(-x e^u + u); the integrand is analytic in |Im u| < pi / 2, so the
/// trapezoidal rule with step h errs by about exp(-pi^2 / h); the range of u is cut where the rest is below
/// the tolerance.
fn exponential_sum(smallest: f64, largest: f64, tolerance: f64) -> Result<Vec<(f64, f64)>, TtError> {
    if !(smallest > 0.0 && largest.is_finite()) {
        return Err(TtError::Setting { what: "offset", need: "positive", got: smallest });
    }
    if !(tolerance > 0.0 && tolerance < 1.0) {
        return Err(TtError::Setting { what: "tolerance", need: "in (0, 1)", got: tolerance });
    }
    let log = -tolerance.ln() + 3.0;
    let step = std::f64::consts::PI.powi(2) / log * 0.5;
    // From e^u < tolerance / largest (the rest of the integral is e^u) to exp(-smallest e^u) < tolerance.
    let (low, high) = (-log - largest.ln(), (log / smallest).ln() + 1.0);
    let count = ((high - low) / step).ceil() as usize;
    Ok((0..=count)
        .map(|k| {
            let u = low + step * k as f64;
            (step * u.exp(), u.exp())
        })
        .collect())
}

/// The numbers origin + step j, j = 0, ..., 2^d - 1; rank 2.
///
/// # Errors
/// [`TtError::Setting`] for d < 2.
pub fn ramp(d: usize, origin: f64, step: f64) -> Result<TtVector, TtError> {
    polynomial(d, &[0.0, 1.0], origin, step)
}

/// 1 from j = first on, 0 before, j = 0, ..., 2^d - 1; rank 2.
///
/// The rank index, from the fine digits to the coarse ones, tells whether the digits so far make a number of
/// at least those of `first`.
///
/// # Errors
/// [`TtError::Setting`] for d = 0 or d > 63, [`TtError::Index`] for first > 2^d.
///
/// ```
/// use graintrain_tt::qtt;
/// assert_eq!(qtt::step(3, 5)?.to_full()?, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn step(d: usize, first: usize) -> Result<TtVector, TtError> {
    if d == 0 || d > 63 {
        return Err(TtError::Setting { what: "number of digits", need: "in 1..=63", got: d as f64 });
    }
    let size = 1usize << d;
    if first > size {
        return Err(TtError::Index { mode: 0, index: first, size: size + 1 });
    }
    if first == size {
        return TtVector::constant(&vec![2; d], 0.0);
    }
    let core = |k: usize| {
        let bound = first >> k & 1;
        // State 1: the digits below are at least those of `first` (so they are before the first digit).
        let next = |at_least: usize, i: usize| usize::from(i > bound || (i == bound && at_least == 1));
        let (left, right) = (if k == 0 { 1 } else { 2 }, if k + 1 == d { 1 } else { 2 });
        Core::from_fn(left, 2, right, |alpha, i, beta| {
            let state = next(if k == 0 { 1 } else { alpha }, i);
            f64::from(state == if right == 1 { 1 } else { beta })
        })
    };
    TtVector::from_cores((0..d).map(core).collect())
}

/// Which entries of a difference of indices a matrix reads.
#[derive(Clone, Copy, PartialEq)]
enum Difference {
    /// i - j modulo 2^d.
    Cyclic,
    /// i - j modulo 2^(d + 1).
    Signed,
}

/// x(i - j): the digits of the difference follow from those of i and j and a borrow, which doubles the ranks
/// (Kazeev, Khoromskij, Tyrtyshnikov, SIAM J. Sci. Comput. 35, 2013).
fn of_difference(x: &TtVector, kind: Difference) -> Result<TtMatrix, TtError> {
    let last = x.num_cores() - usize::from(kind == Difference::Signed);
    if x.modes().iter().any(|&n| n != 2) || last == 0 {
        return Err(TtError::Shape {
            what: "modes of a vector of differences",
            expected: vec![2],
            got: x.modes(),
        });
    }
    let core = |k: usize| {
        let digits = &x.cores[k];
        let borrows = |first: bool| if first { 1 } else { 2 };
        let (before, after) = (borrows(k == 0), borrows(k + 1 == last));
        let right = if k + 1 == last { 1 } else { digits.right };
        Core::from_fn(digits.left * before, 4, right * after, |alpha, b, beta| {
            let (i, j, borrow) = (b % 2, b / 2, alpha / digits.left);
            let digit = (i + 4 - j - borrow) % 2;
            let borrowed = usize::from(i < j + borrow);
            let alpha = alpha % digits.left;
            match (k + 1 == last, kind) {
                (false, _) if borrowed == beta / right => digits.get(alpha, digit, beta % right),
                (false, _) => 0.0,
                (true, Difference::Cyclic) => digits.get(alpha, digit, 0),
                // The digit beyond the last: 1 for a negative difference.
                (true, Difference::Signed) => {
                    let sign = &x.cores[last];
                    (0..digits.right)
                        .map(|beta| digits.get(alpha, digit, beta) * sign.get(beta, borrowed, 0))
                        .sum()
                }
            }
        })
    };
    TtMatrix::from_cores((0..last).map(core).collect(), &vec![2; last], &vec![2; last])
}

/// The 2^d x 2^d circulant matrix with entries x((i - j) mod 2^d): its product with y is the cyclic
/// convolution. Ranks 2 r.
///
/// # Errors
/// [`TtError::Shape`] unless all modes of x are 2.
///
/// ```
/// use graintrain_tt::{TtVector, qtt};
/// let x = TtVector::from_full(&[1.0, 2.0, 3.0, 4.0], &[2, 2], &Default::default())?.0;
/// let first_row: Vec<f64> = (0..4).map(|j| qtt::circulant(&x).unwrap().entries(&[(0, j)]).unwrap()[0]).collect();
/// assert!(first_row.iter().zip([1.0, 4.0, 3.0, 2.0]).all(|(a, b)| (a - b).abs() < 1e-14));
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn circulant(x: &TtVector) -> Result<TtMatrix, TtError> {
    of_difference(x, Difference::Cyclic)
}

/// The 2^d x 2^d Toeplitz matrix with entries x((i - j) mod 2^(d + 1)) from a vector of 2^(d + 1) numbers:
/// first those of the first column, then (from place 2^d + 1 on) those of the first row from its end. Its
/// product with y is the convolution cut to 2^d numbers. Ranks 2 r.
///
/// # Errors
/// [`TtError::Shape`] unless x has at least two modes, all of size 2.
pub fn toeplitz(x: &TtVector) -> Result<TtMatrix, TtError> {
    of_difference(x, Difference::Signed)
}
