//! Fourier transform, convolution, files of other programs, rows of largest volume.

use super::matrix::full_matrix;
use super::{TrainMatrix, TrainVector, array, detached, settings, truncation, with_report};
use crate::error::OrRaise;
use crate::plain::plain;
use graintrain_tt::toolbox::{self, Stored};
use graintrain_tt::{fourier as transform, maxvol as volumes};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// The unitary Fourier transform y_m = 2^(-d/2) sum_j x_j exp(-2 pi i j m / 2^d) ("Forward"; + for
/// "Backward") of x = real + i imaginary over d binary digits: (real part, imaginary part, report), whose
/// error is a bound. O(d^2 r^3). (Dolgov, Khoromskij, Savostyanov 2012.)
#[pyfunction]
#[pyo3(signature = (real, imaginary=None, direction="Forward", tolerance=1e-10, *, max_rank=None))]
pub fn fourier<'py>(
    py: Python<'py>,
    real: &TrainVector,
    imaginary: Option<&TrainVector>,
    direction: &str,
    tolerance: f64,
    max_rank: Option<usize>,
) -> PyResult<(TrainVector, TrainVector, Bound<'py, PyAny>)> {
    let (direction, limits) = (settings::choice("direction", direction)?, truncation(tolerance, max_rank));
    let imaginary = imaginary.map(|x| &x.train);
    let (re, im, report) = detached(py, || transform::fourier(&real.train, imaginary, direction, &limits))?;
    Ok((re.into(), im.into(), plain(py, &report)?))
}

/// z_k = sum_j x_j y_(k - j) over d binary digits, a train of d + 1 digits, and a report.
#[pyfunction]
#[pyo3(signature = (x, y, tolerance=1e-10, *, max_rank=None))]
pub fn convolution<'py>(
    py: Python<'py>,
    x: &TrainVector,
    y: &TrainVector,
    tolerance: f64,
    max_rank: Option<usize>,
) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
    let limits = truncation(tolerance, max_rank);
    with_report(py, detached(py, || transform::convolution(&x.train, &y.train, &limits))?)
}

/// Rows of (nearly) largest volume of an array (n, r), n >= r: their numbers and the array in their
/// coordinates, A A[rows]^-1, of which no entry exceeds 1.05.
#[pyfunction]
pub fn maxvol<'py>(py: Python<'py>, matrix: &Bound<'py, PyAny>) -> PyResult<(Vec<usize>, Bound<'py, PyAny>)> {
    let full = full_matrix("matrix", matrix)?;
    let (rows, coordinates) = detached(py, || volumes::maxvol(&full))?;
    let shape = [coordinates.rows(), coordinates.columns()];
    Ok((rows, array(py, coordinates.into_vec(), &shape)?))
}

/// Reads a train from a binary file of TT-Toolbox, ttpy or tt-fort (SDV).
#[pyfunction]
pub fn read_sdv(path: PathBuf) -> PyResult<TrainVector> {
    Ok(toolbox::read_sdv(&path).or_raise()?.into())
}

/// Writes such a file.
#[pyfunction]
pub fn write_sdv(train: &TrainVector, path: PathBuf) -> PyResult<()> {
    toolbox::write_sdv(&train.train, &path).or_raise()
}

/// The trains of a MATLAB file (level 5) of TT-Toolbox: a dict of TrainVectors and TrainMatrices by their
/// names.
#[pyfunction]
pub fn read_mat(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let found = PyDict::new(py);
    for (name, stored) in toolbox::read_mat(&path).or_raise()? {
        let train = match stored {
            Stored::Vector(train) => TrainVector { train }.into_bound_py_any(py)?,
            Stored::Matrix(train) => TrainMatrix { train }.into_bound_py_any(py)?,
        };
        found.set_item(name, train)?;
    }
    Ok(found)
}
