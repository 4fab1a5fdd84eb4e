//! The discrete Fourier transform of quantized trains and convolutions by it or by borrows.
//!
//! y_m = 2^(-d/2) sum_j x_j exp(-2 pi i j m / 2^d) by radix 2 from the coarse digit down (S. Dolgov, B.
//! Khoromskij, D. Savostyanov, J. Fourier Anal. Appl. 18, 2012): a butterfly on the coarsest digit still in
//! the time domain, then twiddle factors exp(-2 pi i j' / 2^(s+1)) of the finer digits j' where the new digit
//! is 1, which are a product over the digits. The coarsest digit of the time becomes the finest of the
//! frequency, so the train is reversed at the end.
//!
//! A complex train is a real one with one more mode of size 2, real and imaginary part, before the finest
//! digit; i is [0 -1; 1 0] there. So each of the d steps is a real TT-matrix of ranks 3, and the steps are
//! orthogonal: their rounding errors add up and nothing enlarges them.

use crate::vector::Core;
use crate::{Truncation, TruncationReport, TtError, TtMatrix, TtVector};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Which transform.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Direction {
    /// exp(-2 pi i j m / 2^d).
    Forward,
    /// exp(+2 pi i j m / 2^d): the inverse of the other.
    Backward,
}

/// Step s of the transform over d digits: butterfly on digit s, twiddle factors on the finer ones.
fn step(d: usize, s: usize, sign: f64) -> Result<TtMatrix, TtError> {
    // Bond 0: no factor; bonds 1 and 2: real and imaginary part of the factor.
    let identity = |b: usize| f64::from(b == 0 || b == 3);
    let turn = [0.0, 1.0, -1.0, 0.0];
    let mut cores = vec![Core::from_fn(1, 4, 3, |_, b, bond| if bond == 2 { turn[b] } else { identity(b) })];
    for k in 0..d {
        cores.push(match k.cmp(&s) {
            std::cmp::Ordering::Less => {
                let angle = sign * TAU * ((k as f64) - (s as f64) - 1.0).exp2();
                Core::from_fn(3, 4, 3, |alpha, b, beta| {
                    let (sin, cos) = if b == 3 { angle.sin_cos() } else { (0.0, 1.0) };
                    identity(b)
                        * match (alpha, beta) {
                            (0, 0) => 1.0,
                            (1, 1) | (2, 2) => cos,
                            (1, 2) => -sin,
                            (2, 1) => sin,
                            _ => 0.0,
                        }
                })
            }
            std::cmp::Ordering::Equal => Core::from_fn(3, 4, 1, |alpha, b, _| {
                let (new, old) = (b % 2, b / 2);
                match alpha == new {
                    true if new == 1 && old == 1 => -FRAC_1_SQRT_2,
                    true => FRAC_1_SQRT_2,
                    false => 0.0,
                }
            }),
            std::cmp::Ordering::Greater => Core::from_fn(1, 4, 1, |_, b, _| identity(b)),
        });
    }
    TtMatrix::from_cores(cores, &vec![2; d + 1], &vec![2; d + 1])
}

/// The unitary discrete Fourier transform of x = real + i imaginary over 2^d numbers, d binary digits: real
/// and imaginary part of y_m = 2^(-d/2) sum_j x_j exp(-+ 2 pi i j m / 2^d). O(d^2 r^3) for ranks r.
///
/// The report's error is the sum over the d steps, a bound of the relative error of y; each step may make an
/// equal part of the tolerance. Whether the ranks stay small depends on x: those of a sum of s waves and of
/// functions with few scales do.
///
/// # Errors
/// [`TtError::Shape`] unless all modes are 2 and both parts have the same number of them, else as for
/// [`TtVector::round`].
///
/// ```
/// use graintrain_tt::{Truncation, fourier::{Direction, fourier}, qtt};
/// // A wave of 2^40 points with frequency 5: two entries of the transform, at 5 and at 2^40 - 5.
/// let x = qtt::sine(40, 5.0 * std::f64::consts::TAU * 2f64.powi(-40), 0.0)?;
/// let (_, imaginary, report) = fourier(&x, None, Direction::Forward, &Truncation::to(1e-10))?;
/// let mut five = vec![0; 40];
/// (five[0], five[2]) = (1, 1);
/// assert!((imaginary.entry(&five)? + 2f64.powi(19)).abs() < 1e-3 && report.error <= 1e-10);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn fourier(
    real: &TtVector,
    imaginary: Option<&TtVector>,
    direction: Direction,
    truncation: &Truncation,
) -> Result<(TtVector, TtVector, TruncationReport), TtError> {
    truncation.check()?;
    let modes = real.modes();
    let d = modes.len();
    if modes.iter().any(|&n| n != 2) {
        return Err(TtError::Shape {
            what: "modes of a Fourier transform",
            expected: vec![2; d],
            got: modes,
        });
    }
    let part = |which: usize, x: &TtVector| -> Result<TtVector, TtError> {
        Ok(TtVector::unit(&[2], &[which])?.kronecker(x))
    };
    let mut z = part(0, real)?;
    if let Some(imaginary) = imaginary {
        real.check_same_modes(imaginary)?;
        z = z.add(&part(1, imaginary)?)?;
    }
    let sign = if direction == Direction::Forward { -1.0 } else { 1.0 };
    let each = Truncation { tolerance: truncation.tolerance / (d + 1) as f64, ..*truncation };
    let (mut error, mut capped);
    let first;
    (z, first) = z.round(&each)?;
    (error, capped) = (first.error, first.capped);
    for s in (0..d).rev() {
        let report;
        (z, report) = step(d, s, sign)?.times_vector_rounded(&z, &each)?;
        error += report.error;
        capped |= report.capped;
    }
    let taken = |which: usize| -> Result<TtVector, TtError> {
        let mut ranges = vec![0..2; d + 1];
        ranges[0] = which..which + 1;
        let half = z.sub_tensor(&ranges)?;
        // The mode of size one goes into the digit beside it; digits are of size two.
        Ok(half.squeeze().reverse())
    };
    let report = TruncationReport { error, floor: first.floor * (d + 1) as f64, norm: first.norm, capped };
    Ok((taken(0)?, taken(1)?, report))
}

/// The convolution z_k = sum_j x_j y_(k - j), k = 0, ..., 2^(d+1) - 1, of two vectors of 2^d numbers: d + 1
/// digits, the last entry 0. By the circulant matrix of the vector with zeros appended, within the
/// truncation; O(d r^2 R (r + R)) and more for the rounding.
///
/// # Errors
/// [`TtError::Shape`] unless all modes are 2 and both have the same number of them, else as for
/// [`TtVector::round`].
///
/// ```
/// use graintrain_tt::{Truncation, TtVector, fourier::convolution};
/// let x = TtVector::from_full(&[1.0, 2.0, 3.0, 4.0], &[2, 2], &Truncation::to(1e-14))?.0;
/// let one = TtVector::constant(&[2, 2], 1.0)?;
/// let (z, _) = convolution(&x, &one, &Truncation::to(1e-13))?;
/// let expected = [1.0, 3.0, 6.0, 10.0, 9.0, 7.0, 4.0, 0.0];
/// assert!(z.to_full()?.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-11));
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn convolution(
    x: &TtVector,
    y: &TtVector,
    truncation: &Truncation,
) -> Result<(TtVector, TruncationReport), TtError> {
    x.check_same_modes(y)?;
    let first = TtVector::unit(&[2], &[0])?;
    crate::qtt::circulant(&x.kronecker(&first))?.times_vector_rounded(&y.kronecker(&first), truncation)
}
