//! Linear systems, inverses, eigenpairs, evolution.

use super::{
    TrainMatrix, TrainVector, detached, settings, stoppable, truncation, value_and_floor, with_report,
};
use crate::plain::plain;
use graintrain_tt::inverse::{self as inverses};
use graintrain_tt::solve;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::json;

#[pymethods]
impl TrainMatrix {
    /// Solves A x = y by AMEn to a relative residual and returns (x, report): a dict with status, residual,
    /// floor, sweeps, history, ranks. Not reaching the tolerance is no error: see status. Settings: max_rank,
    /// max_sweeps (40), kick_rank (4), method ("Amen", "Als", "Dmrg"), direct_limit (1000), local_iterations
    /// (120), seed. (Dolgov and Savostyanov 2014.)
    #[pyo3(signature = (y, tolerance=1e-6, *, start=None, **settings))]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        y: &TrainVector,
        tolerance: f64,
        start: Option<&TrainVector>,
        settings: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
        let settings = settings::settings(tolerance, settings)?;
        let start = start.map(|start| &start.train);
        with_report(
            py,
            stoppable(py, |stop| solve::solve_within(&self.train, &y.train, start, &settings, stop))?,
        )
    }
}

/// Solves A X = Y for a matrix X by AMEn and returns (X, report); settings as in TrainMatrix.solve. The local
/// matrix is factored once for all columns.
#[pyfunction]
#[pyo3(signature = (a, y, tolerance=1e-6, *, start=None, **settings))]
pub fn solve_matrix<'py>(
    py: Python<'py>,
    a: &TrainMatrix,
    y: &TrainMatrix,
    tolerance: f64,
    start: Option<&TrainMatrix>,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<(TrainMatrix, Bound<'py, PyAny>)> {
    let settings = settings::settings(tolerance, settings)?;
    let start = start.map(|start| &start.train);
    with_report(
        py,
        stoppable(py, |stop| solve::solve_matrix_within(&a.train, &y.train, start, &settings, stop))?,
    )
}

/// Solves A x = y by restarted GMRES with rounded vectors, right-preconditioned (A P u = y, x = P u), and
/// returns (x, report): status, residual, floor, iterations, history, largest_rank, ranks. Settings:
/// max_rank, restart (30), max_iterations (300). (Dolgov 2013.)
#[pyfunction]
#[pyo3(signature = (a, y, tolerance=1e-6, *, start=None, preconditioner=None, **settings))]
pub fn gmres<'py>(
    py: Python<'py>,
    a: &TrainMatrix,
    y: &TrainVector,
    tolerance: f64,
    start: Option<&TrainVector>,
    preconditioner: Option<&TrainMatrix>,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
    let settings = settings::settings(tolerance, settings)?;
    let (start, preconditioner) = (start.map(|start| &start.train), preconditioner.map(|p| &p.train));
    let found = stoppable(py, |stop| {
        solve::gmres_within(&a.train, &y.train, start, preconditioner, &settings, stop)
    })?;
    with_report(py, found)
}

/// ||A x - y|| / ||y|| from the trains, and what rounding leaves uncertain about it.
#[pyfunction]
pub fn measured_residual(
    py: Python<'_>,
    a: &TrainMatrix,
    x: &TrainVector,
    y: &TrainVector,
) -> PyResult<(f64, f64)> {
    let spectators = vec![1; a.train.num_cores()];
    let measured = detached(py, || solve::measured_residual(&a.train, &x.train, &y.train, &spectators))?;
    Ok(value_and_floor(measured))
}

/// The inverse X of A by AMEn and a report with ||A X - I||_F / ||I||_F. form: "Energy" (symmetric positive
/// definite A), "Residual" (A^T A X = A^T), "Galerkin" (any regular A) or "Symmetric" (A X + X A = 2 I).
/// Settings as in TrainMatrix.solve.
#[pyfunction]
#[pyo3(signature = (a, form="Energy", tolerance=1e-6, *, start=None, **settings))]
pub fn inverse<'py>(
    py: Python<'py>,
    a: &TrainMatrix,
    form: &str,
    tolerance: f64,
    start: Option<&TrainMatrix>,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<(TrainMatrix, Bound<'py, PyAny>)> {
    let form = settings::choice("form", form)?;
    let settings = settings::settings(tolerance, settings)?;
    let start = start.map(|start| &start.train);
    with_report(py, stoppable(py, |stop| inverses::inverse_within(&a.train, form, start, &settings, stop))?)
}

/// ||A X - I||_F / ||I||_F from the trains.
#[pyfunction]
pub fn inverse_residual(py: Python<'_>, a: &TrainMatrix, x: &TrainMatrix) -> PyResult<f64> {
    detached(py, || inverses::inverse_residual(&a.train, &x.train))
}

/// X <- 2 X - X A X with rounding after every product, until ||I - A X||_F (absolute) is at most `stop`; the
/// best X and a report: converged, floor, history.
#[pyfunction]
#[pyo3(signature = (a, start, tolerance=1e-10, *, max_rank=None, stop=1e-6, max_steps=50))]
pub fn newton_schulz<'py>(
    py: Python<'py>,
    a: &TrainMatrix,
    start: &TrainMatrix,
    tolerance: f64,
    max_rank: Option<usize>,
    stop: f64,
    max_steps: usize,
) -> PyResult<(TrainMatrix, Bound<'py, PyAny>)> {
    let limits = truncation(tolerance, max_rank);
    let found = stoppable(py, |interrupt| {
        inverses::newton_schulz_within(&a.train, &start.train, &limits, stop, max_steps, interrupt)
    })?;
    with_report(py, found)
}

/// The lowest eigenvalues of a symmetric matrix with their vectors of norm 1, ascending: a list of (value,
/// vector, report) with residual, floor, converged and sweeps. An eigenvalue lies within the residual of each
/// value; that no lower one was missed is not certified. Settings: max_rank (200), max_sweeps (40), method
/// ("Dmrg", "Amen"), seed.
#[pyfunction]
#[pyo3(signature = (a, count=1, tolerance=1e-8, **settings))]
pub fn lowest_eigenpairs<'py>(
    py: Python<'py>,
    a: &TrainMatrix,
    count: usize,
    tolerance: f64,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<Vec<(f64, TrainVector, Bound<'py, PyAny>)>> {
    let settings = settings::settings(tolerance, settings)?;
    let pairs = stoppable(py, |stop| solve::lowest_eigenpairs_within(&a.train, count, &settings, stop))?;
    let entry = |pair: solve::Eigenpair| {
        let report = json!({
            "residual": pair.residual, "floor": pair.floor, "converged": pair.converged, "sweeps": pair.sweeps
        });
        Ok((pair.value, pair.vector.into(), plain(py, &report)?))
    };
    pairs.into_iter().map(entry).collect()
}

/// exp(time A) x for any square A by TDVP, and a report: projection, truncation, splitting, floor, growth,
/// capped, ranks; `error` is the sum of the first four, a Frobenius norm. Settings: sites ("Two", "One"),
/// steps (10), max_rank (200). For stiff A take implicit steps by solve.
#[pyfunction]
#[pyo3(signature = (a, x, time, tolerance=1e-8, **settings))]
pub fn evolve<'py>(
    py: Python<'py>,
    a: &TrainMatrix,
    x: &TrainVector,
    time: f64,
    tolerance: f64,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
    let settings = settings::settings(tolerance, settings)?;
    let (train, report) =
        stoppable(py, |stop| solve::evolve_within(&a.train, &x.train, time, &settings, stop))?;
    let dict = plain(py, &report)?;
    dict.set_item("error", report.error())?;
    Ok((train.into(), dict))
}
