//! Trains from functions and from data.

use super::sparse::QuadtreeMatrix;
use super::{TrainMatrix, TrainVector, detached, index_rows, settings, stoppable, with_report};
use crate::arrays::{indices, owned, shaped};
use crate::error::OrRaise;
use graintrain_tt::cross::{self as crosses, CrossReport, CrossSettings, EntrySource};
use graintrain_tt::{TtError, TtVector, fit as fits};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::sync::{Mutex, PoisonError};

/// Values that a Python function gives for many points at once: its first exception ends the method.
pub(super) struct Called {
    modes: Vec<usize>,
    function: Py<PyAny>,
    raised: Mutex<Option<PyErr>>,
}

impl Called {
    pub(super) fn new(modes: Vec<usize>, function: Py<PyAny>) -> Self {
        Self { modes, function, raised: Mutex::default() }
    }

    /// Calls the function with what `arguments` makes; Ctrl-C ends it like an exception of its own.
    pub(super) fn fill<'a>(
        &self,
        values: &mut [f64],
        arguments: impl for<'py> FnOnce(Python<'py>) -> PyResult<Bound<'py, PyTuple>> + 'a,
    ) {
        let mut raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
        if raised.is_none() {
            let call = |values: &mut [f64]| {
                Python::attach(|py| {
                    let result = self.function.bind(py).call1(arguments(py)?)?;
                    let found = shaped("what the function returned", &result, &[Some(values.len())])?;
                    values.copy_from_slice(&found);
                    py.check_signals()
                })
            };
            *raised = call(values).err();
        }
        if raised.is_some() {
            // No train has such an entry: the method ends.
            values.fill(f64::NAN);
        }
    }

    /// What the method found, or what the function raised.
    pub(super) fn outcome<T>(self, found: Result<T, TtError>) -> PyResult<T> {
        match self.raised.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(raised) => Err(raised),
            None => found.or_raise(),
        }
    }
}

impl EntrySource for Called {
    fn modes(&self) -> Vec<usize> {
        self.modes.clone()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        self.fill(values, |py| PyTuple::new(py, [index_rows(py, indices, self.modes.len())?]));
    }
}

/// Points (n, d) of indices, or none.
fn points(what: &str, given: Option<&Bound<'_, PyAny>>, width: usize) -> PyResult<Vec<usize>> {
    given.map_or(Ok(Vec::new()), |given| indices(what, given, width))
}

/// Cross interpolation: the train of a tensor from some of its entries, and a report (a dict).
/// function(indices) gets an integer array (n, d) and returns n values. probes: (n, d), points to confirm the
/// train at. What the method cannot see it does not claim: see status, sampled_error and upper_bound.
/// Settings: max_rank, max_sweeps (30), kick_rank (4), samples (4000), seed.
#[pyfunction]
#[pyo3(signature = (function, modes, tolerance=1e-6, *, start=None, probes=None, **settings))]
pub fn cross<'py>(
    py: Python<'py>,
    function: Py<PyAny>,
    modes: Vec<usize>,
    tolerance: f64,
    start: Option<&TrainVector>,
    probes: Option<&Bound<'py, PyAny>>,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
    let probes = points("probes", probes, modes.len())?;
    let settings: CrossSettings = settings::settings(tolerance, settings)?;
    let source = Called::new(modes, function);
    let start = start.map(|start| &start.train);
    let found = py.detach(|| crosses::cross(&source, start, &probes, &settings));
    with_report(py, source.outcome(found)?)
}

/// Cross interpolation of a sparse matrix with every `stride`-th nonzero as a probe, and a report with the
/// error over all entries. A method to compare with: QuadtreeMatrix.to_train is better in every respect.
#[pyfunction]
#[pyo3(signature = (matrix, tolerance=1e-6, *, start=None, stride=1, **settings))]
pub fn cross_sparse<'py>(
    py: Python<'py>,
    matrix: &QuadtreeMatrix,
    tolerance: f64,
    start: Option<&TrainMatrix>,
    stride: usize,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<(TrainMatrix, Bound<'py, PyAny>)> {
    let settings = settings::settings(tolerance, settings)?;
    let start = start.map(|start| &start.train);
    let found =
        stoppable(py, |stop| crosses::cross_sparse_within(&matrix.matrix, start, stride, &settings, stop))?;
    with_report(py, found)
}

/// An equidistant sub-grid of at most so many points with both ends of every mode, for use as probes: an
/// integer array (n, d).
#[pyfunction]
pub fn sub_grid(py: Python<'_>, modes: Vec<usize>, most: usize) -> PyResult<Bound<'_, PyAny>> {
    index_rows(py, &detached(py, || crosses::sub_grid(&modes, most))?, modes.len())
}

/// The fibres through the corners of the tensor, where functions of a sum of coordinates keep what cross
/// misses last, for use as probes: (n, d).
#[pyfunction]
pub fn ends_of_modes(py: Python<'_>, modes: Vec<usize>) -> PyResult<Bound<'_, PyAny>> {
    index_rows(py, &detached(py, || crosses::ends_of_modes(&modes))?, modes.len())
}

/// The train with entries function(x_1[i], x_2[i], ...) for trains x_1, x_2, ... of the same modes, by cross,
/// and its report. The function gets an array of n entries per train and returns n values. Settings as in
/// cross.
#[pyfunction]
#[pyo3(signature = (function, trains, tolerance=1e-6, **settings))]
pub fn map<'py>(
    py: Python<'py>,
    function: Py<PyAny>,
    trains: Vec<PyRef<'py, TrainVector>>,
    tolerance: f64,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
    let settings: CrossSettings = settings::settings(tolerance, settings)?;
    let trains: Vec<&TtVector> = trains.iter().map(|train| &train.train).collect();
    let source = EntriesCalled { called: Called::new(Vec::new(), function), trains: &trains };
    let found = py.detach(|| source.cross(&settings));
    with_report(py, source.called.outcome(found)?)
}

/// A Python function of the entries of trains.
struct EntriesCalled<'a> {
    called: Called,
    trains: &'a [&'a TtVector],
}

impl EntriesCalled<'_> {
    fn cross(&self, settings: &CrossSettings) -> Result<(TtVector, CrossReport), TtError> {
        // (The crate's own map checks that there is a train and that all have the same modes.)
        if self.trains.windows(2).any(|pair| pair[0].modes() != pair[1].modes()) || self.trains.is_empty() {
            return TtVector::map(self.trains, |_| 0.0, settings);
        }
        crosses::cross(self, None, &[], settings)
    }
}

impl EntrySource for EntriesCalled<'_> {
    fn modes(&self) -> Vec<usize> {
        self.trains[0].modes()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        let columns: Vec<Vec<f64>> =
            self.trains.iter().map(|train| train.entries(indices).unwrap_or_default()).collect();
        self.called.fill(values, |py| {
            let column = |x: Vec<f64>| {
                let count = x.len();
                owned(py, x, &[count])
            };
            PyTuple::new(py, columns.into_iter().map(column).collect::<PyResult<Vec<_>>>()?)
        });
    }
}

/// The train of these modes through values (n) at indices (n, d), and a report: converged, training_error,
/// validation_error, test_error, error_estimate, upper_bound, points, history, restarts, ranks. Settings:
/// max_rank (20), max_sweeps (300), restarts (4), held_out (0.1), seed. O(sweeps d n r^4).
#[pyfunction]
#[pyo3(signature = (modes, index, values, tolerance=1e-6, **settings))]
pub fn fit<'py>(
    py: Python<'py>,
    modes: Vec<usize>,
    index: &Bound<'py, PyAny>,
    values: &Bound<'py, PyAny>,
    tolerance: f64,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
    let index = indices("index", index, modes.len())?;
    let values = shaped("values", values, &[None])?;
    let settings = settings::settings(tolerance, settings)?;
    with_report(py, stoppable(py, |stop| fits::fit_within(&modes, &index, &values, &settings, stop))?)
}
