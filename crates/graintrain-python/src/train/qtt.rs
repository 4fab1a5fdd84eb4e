//! Quantized trains with known ranks.

use super::{TrainMatrix, TrainVector, detached, settings};
use crate::error::OrRaise;
use graintrain_tt::{TtError, TtMatrix, TtVector, qtt};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Digits at most: more of them are a slip.
const MOST_DIGITS: usize = 1 << 16;

/// A number of digits that memory has room for.
fn digits_of(d: usize) -> PyResult<usize> {
    if d <= MOST_DIGITS {
        return Ok(d);
    }
    Err(PyValueError::new_err(format!("{d} digits, expected at most {MOST_DIGITS}")))
}

fn vector(d: usize, make: impl FnOnce(usize) -> Result<TtVector, TtError>) -> PyResult<TrainVector> {
    Ok(make(digits_of(d)?).or_raise()?.into())
}

fn matrix(d: usize, make: impl FnOnce(usize) -> Result<TtMatrix, TtError>) -> PyResult<TrainMatrix> {
    Ok(make(digits_of(d)?).or_raise()?.into())
}

fn operators(axes: &[PyRef<'_, TrainMatrix>]) -> Vec<TtMatrix> {
    axes.iter().map(|axis| axis.train.clone()).collect()
}

/// The 2^d x 2^d tridiagonal Toeplitz matrix with `sub`, `diagonal` and `superdiagonal`: ranks 3. (Kazeev and
/// Khoromskij 2012.)
#[pyfunction]
pub fn tridiagonal(d: usize, sub: f64, diagonal: f64, superdiagonal: f64) -> PyResult<TrainMatrix> {
    matrix(d, |d| qtt::tridiagonal(d, sub, diagonal, superdiagonal))
}

/// tridiag(-1, 2, -1), the negative second difference with zero values beyond both ends: ranks 3.
#[pyfunction]
pub fn laplacian(d: usize) -> PyResult<TrainMatrix> {
    matrix(d, qtt::laplacian)
}

/// The second difference with "Dirichlet" or "Neumann" at each end.
#[pyfunction]
pub fn laplacian_with(d: usize, first: &str, last: &str) -> PyResult<TrainMatrix> {
    let (first, last) = (settings::choice("first", first)?, settings::choice("last", last)?);
    matrix(d, |d| qtt::laplacian_with(d, first, last))
}

/// Ones on the first subdiagonal: ranks 2.
#[pyfunction]
pub fn shift(d: usize) -> PyResult<TrainMatrix> {
    matrix(d, qtt::shift)
}

/// Ones on the first subdiagonal and in the upper right corner: ranks 2.
#[pyfunction]
pub fn periodic_shift(d: usize) -> PyResult<TrainMatrix> {
    matrix(d, qtt::periodic_shift)
}

/// The lower triangle of ones: ranks 2.
#[pyfunction]
pub fn cumulative_sum(d: usize) -> PyResult<TrainMatrix> {
    matrix(d, qtt::cumulative_sum)
}

/// The 2^d x 2^d Hilbert matrix 1 / (i + j + 1) to a relative error.
#[pyfunction]
#[pyo3(signature = (d, tolerance=1e-10))]
pub fn hilbert_matrix(py: Python<'_>, d: usize, tolerance: f64) -> PyResult<TrainMatrix> {
    let d = digits_of(d)?;
    Ok(detached(py, || qtt::hilbert_matrix(d, tolerance))?.into())
}

/// The circulant matrix x[(i - j) mod 2^d]: its product is the cyclic convolution. Ranks 2 r.
#[pyfunction]
pub fn circulant(x: &TrainVector) -> PyResult<TrainMatrix> {
    Ok(qtt::circulant(&x.train).or_raise()?.into())
}

/// The Toeplitz matrix x[(i - j) mod 2^(d + 1)] of a vector of 2^(d + 1) numbers: the first column, then the
/// first row from its end. Ranks 2 r.
#[pyfunction]
pub fn toeplitz(x: &TrainVector) -> PyResult<TrainMatrix> {
    Ok(qtt::toeplitz(&x.train).or_raise()?.into())
}

/// The Kronecker product of one operator per axis with the digits of the axes interleaved, level by level,
/// axis 1 first.
#[pyfunction]
pub fn interleave(py: Python<'_>, axes: Vec<PyRef<'_, TrainMatrix>>) -> PyResult<TrainMatrix> {
    let axes = operators(&axes);
    Ok(detached(py, || qtt::interleave(&axes))?.into())
}

/// sum_a I (x) ... L_a ... (x) I for one operator per axis, digits "Separated" (axis after axis) or "Morton"
/// (level by level).
#[pyfunction]
#[pyo3(signature = (axes, order="Separated"))]
pub fn kronecker_sum(
    py: Python<'_>,
    axes: Vec<PyRef<'_, TrainMatrix>>,
    order: &str,
) -> PyResult<TrainMatrix> {
    let (axes, order) = (operators(&axes), settings::choice("order", order)?);
    Ok(detached(py, || qtt::kronecker_sum(&axes, order))?.into())
}

/// exp(a j + b), j = 0, ..., 2^d - 1: ranks 1.
#[pyfunction]
#[pyo3(signature = (d, a, b=0.0))]
pub fn exponential(d: usize, a: f64, b: f64) -> PyResult<TrainVector> {
    vector(d, |d| qtt::exponential(d, a, b))
}

/// sin(a j + b), j = 0, ..., 2^d - 1: ranks 2.
#[pyfunction]
#[pyo3(signature = (d, a, b=0.0))]
pub fn sine(d: usize, a: f64, b: f64) -> PyResult<TrainVector> {
    vector(d, |d| qtt::sine(d, a, b))
}

/// sum_p coefficients[p] x_j^p at x_j = origin + step j: ranks at most degree + 1.
#[pyfunction]
#[pyo3(signature = (d, coefficients, origin=0.0, step=1.0))]
pub fn polynomial(d: usize, coefficients: Vec<f64>, origin: f64, step: f64) -> PyResult<TrainVector> {
    vector(d, |d| qtt::polynomial(d, &coefficients, origin, step))
}

/// origin + step j, j = 0, ..., 2^d - 1: ranks 2.
#[pyfunction]
#[pyo3(signature = (d, origin=0.0, step=1.0))]
pub fn ramp(d: usize, origin: f64, step: f64) -> PyResult<TrainVector> {
    vector(d, |d| qtt::ramp(d, origin, step))
}

/// 1 from j = first on, 0 before: ranks 2.
#[pyfunction]
pub fn step(d: usize, first: usize) -> PyResult<TrainVector> {
    vector(d, |d| qtt::step(d, first))
}

/// 1 / (offset + i_1 + ... + i_D) over indices of these modes to a relative error, as a sum of exponentials.
#[pyfunction]
#[pyo3(signature = (modes, offset=1.0, tolerance=1e-10))]
pub fn hilbert(py: Python<'_>, modes: Vec<usize>, offset: f64, tolerance: f64) -> PyResult<TrainVector> {
    Ok(detached(py, || qtt::hilbert(&modes, offset, tolerance))?.into())
}

fn inside<T>(what: &str, found: Option<T>) -> PyResult<T> {
    found.ok_or_else(|| PyValueError::new_err(format!("{what} lies outside")))
}

/// The digits of an index, the lowest first: index = i_1 + n_1 i_2 + n_1 n_2 i_3 + ...
#[pyfunction]
pub fn digits(index: usize, modes: Vec<usize>) -> PyResult<Vec<usize>> {
    inside("the index", qtt::digits(index, &modes))
}

/// The index of digits: the inverse of digits().
#[pyfunction]
pub fn index(digits: Vec<usize>, modes: Vec<usize>) -> PyResult<usize> {
    inside("a digit", qtt::index(&digits, &modes))
}

/// The place of a point of 2^levels x 2^levels x ... in Morton order, the bits of axis 1 lowest.
#[pyfunction]
pub fn morton(coordinates: Vec<usize>, levels: usize) -> PyResult<usize> {
    inside("a coordinate", qtt::morton(&coordinates, levels))
}

/// The coordinates of a place in Morton order: the inverse of morton().
#[pyfunction]
pub fn morton_coordinates(place: usize, axes: usize, levels: usize) -> PyResult<Vec<usize>> {
    inside("the place", qtt::morton_coordinates(place, axes, levels))
}
