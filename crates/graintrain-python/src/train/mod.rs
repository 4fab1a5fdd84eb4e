//! Tensor trains.

use crate::arrays::{numbers, owned, shaped};
use crate::error::OrRaise;
use crate::plain::plain;
use graintrain_tt::apply::FullOperator;
use graintrain_tt::cross::{CrossSettings, EntrySource};
use graintrain_tt::solve::SolveSettings;
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{FullMatrix, Truncation, TtMatrix, TtVector};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// A tensor as a tensor train. Indices run as in NumPy; the first one is the fastest in `modes` of flat vectors (order "F").
#[pyclass(frozen, module = "graintrain")]
pub struct TrainVector {
    train: TtVector,
}

/// A matrix as a tensor train: row and column numbers are written in digits, the first one the lowest.
#[pyclass(frozen, module = "graintrain")]
pub struct TrainMatrix {
    train: TtMatrix,
}

fn truncation(tolerance: f64, max_rank: Option<usize>) -> Truncation {
    Truncation::capped(tolerance, max_rank.unwrap_or(usize::MAX))
}

/// Numbers in C order as numbers in F order.
fn column_major(numbers: &[f64], shape: &[usize]) -> Vec<f64> {
    let mut turned = vec![0.0; numbers.len()];
    let strides: Vec<usize> = shape
        .iter()
        .scan(1, |product, n| {
            let stride = *product;
            *product *= n;
            Some(stride)
        })
        .collect();
    for (k, &number) in numbers.iter().enumerate() {
        let (mut rest, mut place) = (k, 0);
        for (n, stride) in shape.iter().zip(&strides).rev() {
            place += rest % n * stride;
            rest /= n;
        }
        turned[place] = number;
    }
    turned
}

/// Numbers in F order as an array.
fn array<'py>(py: Python<'py>, full: Vec<f64>, shape: &[usize]) -> PyResult<Bound<'py, PyAny>> {
    let turned: Vec<usize> = shape.iter().rev().copied().collect();
    owned(py, full, &turned)?.into_any().getattr("T")
}

/// Binary digits of a size.
fn binary(what: &str, size: usize) -> PyResult<Vec<usize>> {
    if size.is_power_of_two() && size > 1 {
        return Ok(vec![2; size.trailing_zeros() as usize]);
    }
    Err(PyValueError::new_err(format!(
        "{what} is {size}, no power of two: give its digits, whose product it is"
    )))
}

#[pymethods]
impl TrainVector {
    /// TT-SVD of an array to a relative error; `modes` splits a flat one.
    #[staticmethod]
    #[pyo3(signature = (array, tolerance=1e-10, *, max_rank=None, modes=None))]
    fn from_numpy(
        py: Python<'_>,
        array: &Bound<'_, PyAny>,
        tolerance: f64,
        max_rank: Option<usize>,
        modes: Option<Vec<usize>>,
    ) -> PyResult<Self> {
        let (given, shape) = numbers("array", array)?;
        let full = if modes.is_some() && shape.len() == 1 { given } else { column_major(&given, &shape) };
        let modes = modes.unwrap_or(shape);
        let make = || TtVector::from_full(&full, &modes, &truncation(tolerance, max_rank));
        Ok(Self { train: py.detach(make).or_raise()?.0 })
    }

    /// All entries the same.
    #[staticmethod]
    fn constant(modes: Vec<usize>, value: f64) -> PyResult<Self> {
        Ok(Self { train: TtVector::constant(&modes, value).or_raise()? })
    }

    /// Sizes of the modes.
    #[getter]
    fn modes(&self) -> Vec<usize> {
        self.train.modes()
    }

    /// Ranks, the ones at both ends included.
    #[getter]
    fn ranks(&self) -> Vec<usize> {
        self.train.ranks()
    }

    /// Numbers stored.
    #[getter]
    fn num_parameters(&self) -> usize {
        self.train.num_parameters()
    }

    /// The cores, (left rank, mode, right rank) each. Copies.
    #[getter]
    fn cores<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let cores = self.train.cores().iter();
        let entry = |core: &graintrain_tt::Core| {
            let shape = [core.left(), core.mode(), core.right()];
            let indices = (0..shape[0])
                .flat_map(move |a| (0..shape[1]).flat_map(move |i| (0..shape[2]).map(move |b| (a, i, b))));
            let numbers = indices.map(|(a, i, b)| core.get(a, i, b)).collect();
            Ok(owned(py, numbers, &shape)?.into_any())
        };
        cores.map(entry).collect()
    }

    /// The full tensor.
    fn to_numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array(py, py.detach(|| self.train.to_full()).or_raise()?, &self.train.modes())
    }

    fn __getitem__(&self, index: Vec<usize>) -> PyResult<f64> {
        self.train.entry(&index).or_raise()
    }

    /// A train of smaller ranks within a relative error.
    #[pyo3(signature = (tolerance=1e-10, *, max_rank=None))]
    fn round(&self, py: Python<'_>, tolerance: f64, max_rank: Option<usize>) -> PyResult<Self> {
        let rounded = py.detach(|| self.train.round(&truncation(tolerance, max_rank))).or_raise()?;
        Ok(Self { train: rounded.0 })
    }

    /// Inner product.
    fn dot(&self, other: &Self) -> PyResult<f64> {
        self.train.dot(&other.train).or_raise()
    }

    /// Frobenius norm.
    fn norm(&self) -> f64 {
        self.train.norm()
    }

    /// Sum of all entries.
    fn sum(&self) -> f64 {
        self.train.sum()
    }

    fn __add__(&self, other: &Self) -> PyResult<Self> {
        Ok(Self { train: self.train.add(&other.train).or_raise()? })
    }

    fn __sub__(&self, other: &Self) -> PyResult<Self> {
        Ok(Self { train: self.train.subtract(&other.train).or_raise()? })
    }

    fn __mul__(&self, factor: f64) -> Self {
        Self { train: self.train.scale(factor) }
    }

    fn __rmul__(&self, factor: f64) -> Self {
        self.__mul__(factor)
    }

    /// The product entry by entry.
    fn hadamard(&self, other: &Self) -> PyResult<Self> {
        Ok(Self { train: self.train.hadamard(&other.train).or_raise()? })
    }

    /// Writes the train to a file.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        self.train.save(&path).or_raise()
    }

    /// Reads what save wrote.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        Ok(Self { train: TtVector::load(&path).or_raise()? })
    }

    fn __repr__(&self) -> String {
        format!("<graintrain.TrainVector: modes {:?}, ranks {:?}>", self.train.modes(), self.train.ranks())
    }
}

#[pymethods]
impl TrainMatrix {
    /// TT-SVD of a full matrix to a relative error; rows and columns are the digits of both sizes, binary unless given.
    #[staticmethod]
    #[pyo3(signature = (array, tolerance=1e-10, *, max_rank=None, rows=None, columns=None))]
    fn from_numpy(
        py: Python<'_>,
        array: &Bound<'_, PyAny>,
        tolerance: f64,
        max_rank: Option<usize>,
        rows: Option<Vec<usize>>,
        columns: Option<Vec<usize>>,
    ) -> PyResult<Self> {
        let (_, shape) = numbers("array", array)?;
        let given = shaped("array", array, &[None, None])?;
        let rows = rows.map_or_else(|| binary("the number of rows", shape[0]), Ok)?;
        let columns = columns.map_or_else(|| binary("the number of columns", shape[1]), Ok)?;
        let full = FullMatrix::new(shape[0], shape[1], column_major(&given, &shape)).or_raise()?;
        let make = || TtMatrix::from_full(&full, &rows, &columns, &truncation(tolerance, max_rank));
        Ok(Self { train: py.detach(make).or_raise()?.0 })
    }

    /// The train of a square sparse matrix of SciPy, by one exact pass over its entries that never forms it. Its size becomes
    /// leaf * 2**levels: rows beyond those of the matrix are zero. tolerance: relative error in the Frobenius norm.
    #[staticmethod]
    #[pyo3(signature = (matrix, tolerance=1e-10, *, max_rank=None, leaf=4))]
    fn from_sparse(
        matrix: &Bound<'_, PyAny>,
        tolerance: f64,
        max_rank: Option<usize>,
        leaf: usize,
    ) -> PyResult<Self> {
        let py = matrix.py();
        let parts = py.import("graintrain._arrays")?.call_method1("coordinates", ("matrix", matrix))?;
        let (rows, columns, row, column, value): (usize, usize, Vec<usize>, Vec<usize>, Vec<f64>) =
            parts.extract()?;
        if rows != columns {
            return Err(PyValueError::new_err(format!(
                "the matrix is {rows} x {columns}, expected a square one"
            )));
        }
        let levels = rows.div_ceil(leaf.max(1)).next_power_of_two().trailing_zeros() as usize;
        let entries =
            row.into_iter().zip(column).zip(value).map(|((row, column), value)| (row, column, value));
        let make = || {
            QuadtreeMatrix::from_entries(leaf, levels, entries)?.to_train(&truncation(tolerance, max_rank))
        };
        Ok(Self { train: py.detach(make).or_raise()?.0 })
    }

    /// The identity.
    #[staticmethod]
    fn identity(modes: Vec<usize>) -> PyResult<Self> {
        Ok(Self { train: TtMatrix::identity(&modes).or_raise()? })
    }

    /// Digits of the rows.
    #[getter]
    fn rows(&self) -> Vec<usize> {
        self.train.row_modes().to_vec()
    }

    /// Digits of the columns.
    #[getter]
    fn columns(&self) -> Vec<usize> {
        self.train.column_modes().to_vec()
    }

    /// Ranks, the ones at both ends included.
    #[getter]
    fn ranks(&self) -> Vec<usize> {
        self.train.ranks()
    }

    /// The full matrix.
    fn to_numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let full = py.detach(|| self.train.to_full()).or_raise()?;
        let shape = [full.rows(), full.columns()];
        array(py, full.into_vec(), &shape)
    }

    /// A train of smaller ranks within a relative error.
    #[pyo3(signature = (tolerance=1e-10, *, max_rank=None))]
    fn round(&self, py: Python<'_>, tolerance: f64, max_rank: Option<usize>) -> PyResult<Self> {
        let rounded = py.detach(|| self.train.round(&truncation(tolerance, max_rank))).or_raise()?;
        Ok(Self { train: rounded.0 })
    }

    /// Frobenius norm.
    fn norm(&self) -> f64 {
        self.train.norm()
    }

    /// The product with a TrainVector (a train whose ranks are the products), with another TrainMatrix, or with a full vector (an array).
    fn apply<'py>(&self, py: Python<'py>, x: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        if let Ok(x) = x.cast::<TrainVector>() {
            let train = self.train.times_vector(&x.get().train).or_raise()?;
            return Ok(Bound::new(py, TrainVector { train })?.into_any());
        }
        if let Ok(other) = x.cast::<Self>() {
            let train = self.train.times_matrix(&other.get().train).or_raise()?;
            return Ok(Bound::new(py, Self { train })?.into_any());
        }
        let size = self.train.num_columns().or_raise()?;
        let full = shaped("x", x, &[Some(size)])?;
        let image =
            py.detach(|| FullOperator::new(&self.train).and_then(|a| a.multiply(&full))).or_raise()?;
        let rows = image.len();
        Ok(owned(py, image, &[rows])?.into_any())
    }

    fn __matmul__<'py>(&self, py: Python<'py>, x: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.apply(py, x)
    }

    fn __add__(&self, other: &Self) -> PyResult<Self> {
        Ok(Self { train: self.train.add(&other.train).or_raise()? })
    }

    fn __mul__(&self, factor: f64) -> Self {
        Self { train: self.train.scale(factor) }
    }

    fn __rmul__(&self, factor: f64) -> Self {
        self.__mul__(factor)
    }

    /// The transposed matrix.
    #[getter]
    #[allow(non_snake_case)]
    fn T(&self) -> Self {
        Self { train: self.train.transpose() }
    }

    /// Solves A x = y by AMEn to a relative residual and returns (x, report): a dict with status, residual, sweeps, history, ranks. Not
    /// reaching the tolerance is no error: see status.
    #[pyo3(signature = (y, tolerance=1e-6, *, max_rank=None, max_sweeps=40, start=None))]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        y: &TrainVector,
        tolerance: f64,
        max_rank: Option<usize>,
        max_sweeps: usize,
        start: Option<&TrainVector>,
    ) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
        let settings = SolveSettings {
            tolerance,
            max_rank: max_rank.unwrap_or(usize::MAX),
            max_sweeps,
            ..SolveSettings::default()
        };
        let start = start.map(|start| &start.train);
        let solve = || graintrain_tt::solve::solve(&self.train, &y.train, start, &settings);
        let (train, report) = py.detach(solve).or_raise()?;
        Ok((TrainVector { train }, plain(py, &report)?))
    }

    fn __repr__(&self) -> String {
        let (rows, columns) = (self.train.row_modes(), self.train.column_modes());
        format!(
            "<graintrain.TrainMatrix: rows {rows:?}, columns {columns:?}, ranks {:?}>",
            self.train.ranks()
        )
    }
}

/// Entries from a Python function of many indices at once.
struct Called {
    modes: Vec<usize>,
    function: Py<PyAny>,
    /// The first exception that it raised.
    raised: Mutex<Option<PyErr>>,
}

impl Called {
    fn call(&self, indices: &[usize], values: &mut [f64]) -> PyResult<()> {
        Python::attach(|py| {
            let rows: Vec<i64> = indices.iter().map(|&index| index as i64).collect();
            let rows = owned(py, rows, &[values.len(), self.modes.len()])?;
            let result = self.function.bind(py).call1((rows,))?;
            let found = shaped("what the function returned", &result, &[Some(values.len())])?;
            values.copy_from_slice(&found);
            py.check_signals()
        })
    }
}

impl EntrySource for Called {
    fn modes(&self) -> Vec<usize> {
        self.modes.clone()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        let mut raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
        let failure = if raised.is_none() { self.call(indices, values).err() } else { None };
        if failure.is_some() {
            *raised = failure;
        }
        if raised.is_some() {
            // No train has such an entry: the method ends.
            values.fill(f64::NAN);
        }
    }
}

/// Cross interpolation: the train of a tensor from some of its entries, and a report (a dict). function(indices) gets an integer array (n,
/// d) and returns n values. probes: (n, d), points to confirm the train at. What the method cannot see it does not claim: see status,
/// sampled_error and upper_bound.
#[pyfunction]
#[pyo3(signature = (function, modes, tolerance=1e-6, *, max_rank=None, max_sweeps=30, start=None, probes=None, seed=1))]
pub fn cross<'py>(
    py: Python<'py>,
    function: Py<PyAny>,
    modes: Vec<usize>,
    tolerance: f64,
    max_rank: Option<usize>,
    max_sweeps: usize,
    start: Option<&TrainVector>,
    probes: Option<Vec<Vec<usize>>>,
    seed: u64,
) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
    let probes = probes.unwrap_or_default();
    if let Some(wrong) = probes.iter().find(|probe| probe.len() != modes.len()) {
        return Err(PyValueError::new_err(format!(
            "a probe has {} indices, expected {}",
            wrong.len(),
            modes.len()
        )));
    }
    let settings = CrossSettings {
        tolerance,
        max_rank: max_rank.unwrap_or(usize::MAX),
        max_sweeps,
        seed,
        ..CrossSettings::default()
    };
    let source = Called { modes, function, raised: Mutex::default() };
    let start = start.map(|start| &start.train);
    let found = py.detach(|| graintrain_tt::cross::cross(&source, start, &probes.concat(), &settings));
    if let Some(raised) = source.raised.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(raised);
    }
    let (train, report) = found.or_raise()?;
    Ok((TrainVector { train }, plain(py, &report)?))
}
