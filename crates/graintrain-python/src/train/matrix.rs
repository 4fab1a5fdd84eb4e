//! Matrices as trains.

use super::{
    Cores, TrainVector, array, column_major, core_array, cores_of, detached, maybe_with_report, ranges,
    truncation, with_report,
};
use crate::arrays::{indices, numbers, owned, shaped};
use crate::error::OrRaise;
use graintrain_tt::apply::FullOperator;
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{FullMatrix, TtMatrix};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// A matrix as a tensor train: row and column numbers are written in digits, the first one the lowest; core k
/// holds the pairs of row and column digit k.
#[pyclass(frozen, module = "graintrain")]
pub struct TrainMatrix {
    pub(super) train: TtMatrix,
}

impl From<TtMatrix> for TrainMatrix {
    fn from(train: TtMatrix) -> Self {
        Self { train }
    }
}

/// Cores, row digits, column digits.
type Parts<'py> = (Cores<'py>, Vec<usize>, Vec<usize>);

/// Binary digits of a size.
fn binary(what: &str, size: usize) -> PyResult<Vec<usize>> {
    if size.is_power_of_two() && size > 1 {
        return Ok(vec![2; size.trailing_zeros() as usize]);
    }
    Err(PyValueError::new_err(format!(
        "{what} is {size}, no power of two: give its digits, whose product it is"
    )))
}

/// A full matrix from an array (m, n).
pub(super) fn full_matrix(what: &str, object: &Bound<'_, PyAny>) -> PyResult<FullMatrix> {
    let (_, shape) = numbers(what, object)?;
    let given = shaped(what, object, &[None, None])?;
    FullMatrix::new(shape[0], shape[1], column_major(&given, &shape)).or_raise()
}

/// Rows, columns, row numbers, column numbers and values of a matrix of SciPy or an array.
pub(super) type Coordinates = (usize, usize, Vec<usize>, Vec<usize>, Vec<f64>);

/// See `graintrain._arrays.coordinates`.
pub(super) fn coordinates(matrix: &Bound<'_, PyAny>) -> PyResult<Coordinates> {
    let arrays = matrix.py().import("graintrain._arrays")?;
    arrays.call_method1("coordinates", ("matrix", matrix))?.extract()
}

/// The quadtree of a square sparse matrix of SciPy, of leaves of this size.
pub(super) fn quadtree(matrix: &Bound<'_, PyAny>, leaf: usize) -> PyResult<QuadtreeMatrix> {
    let (rows, columns, row, column, value) = coordinates(matrix)?;
    if rows != columns {
        return Err(PyValueError::new_err(format!(
            "the matrix is {rows} x {columns}, expected a square one"
        )));
    }
    let levels = rows.div_ceil(leaf.max(1)).next_power_of_two().trailing_zeros() as usize;
    let entries = row.into_iter().zip(column).zip(value).map(|((row, column), value)| (row, column, value));
    matrix.py().detach(|| QuadtreeMatrix::from_entries(leaf, levels, entries)).or_raise()
}

super::shared::shared!(TrainMatrix(TtMatrix));

/// Making and reading.
#[pymethods]
impl TrainMatrix {
    /// TT-SVD of a full matrix to a relative error; rows and columns are the digits of both sizes, binary
    /// unless given. With return_report=True also a dict.
    #[staticmethod]
    #[pyo3(signature = (array, tolerance=1e-10, *, max_rank=None, rows=None, columns=None, return_report=false))]
    fn from_numpy<'py>(
        array: &Bound<'py, PyAny>,
        tolerance: f64,
        max_rank: Option<usize>,
        rows: Option<Vec<usize>>,
        columns: Option<Vec<usize>>,
        return_report: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = array.py();
        let full = full_matrix("array", array)?;
        let rows = rows.map_or_else(|| binary("the number of rows", full.rows()), Ok)?;
        let columns = columns.map_or_else(|| binary("the number of columns", full.columns()), Ok)?;
        let limits = truncation(tolerance, max_rank);
        let found = detached(py, || TtMatrix::from_full(&full, &rows, &columns, &limits))?;
        maybe_with_report::<_, Self>(py, found, return_report)
    }

    /// The train of a square sparse matrix of SciPy, by one exact pass over its entries that never forms it.
    /// Its size becomes leaf * 2**levels: rows beyond those of the matrix are zero. tolerance: relative error
    /// in the Frobenius norm. With return_report=True also a dict. (QuadtreeMatrix has more.)
    #[staticmethod]
    #[pyo3(signature = (matrix, tolerance=1e-10, *, max_rank=None, leaf=4, return_report=false))]
    fn from_sparse<'py>(
        matrix: &Bound<'py, PyAny>,
        tolerance: f64,
        max_rank: Option<usize>,
        leaf: usize,
        return_report: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (py, quadtree) = (matrix.py(), quadtree(matrix, leaf)?);
        let found = detached(py, || quadtree.to_train(&truncation(tolerance, max_rank)))?;
        maybe_with_report::<_, Self>(py, found, return_report)
    }

    /// The matrix of a train whose modes are rows[k] * columns[k], the row digit the fastest.
    #[staticmethod]
    fn from_vector(train: &TrainVector, rows: Vec<usize>, columns: Vec<usize>) -> PyResult<Self> {
        Ok(TtMatrix::from_vector(train.train.clone(), &rows, &columns).or_raise()?.into())
    }

    /// From cores, arrays (left rank, rows[k] * columns[k], right rank), the row digit the fastest.
    #[staticmethod]
    fn from_cores(cores: Vec<Bound<'_, PyAny>>, rows: Vec<usize>, columns: Vec<usize>) -> PyResult<Self> {
        Ok(TtMatrix::from_cores(cores_of(&cores)?, &rows, &columns).or_raise()?.into())
    }

    /// The Kronecker product of small matrices, the first one on the lowest digits: ranks 1.
    #[staticmethod]
    fn rank_one(factors: Vec<Bound<'_, PyAny>>) -> PyResult<Self> {
        let factor = |(k, a): (usize, &Bound<'_, PyAny>)| full_matrix(&format!("factors[{k}]"), a);
        let factors = factors.iter().enumerate().map(factor).collect::<PyResult<Vec<_>>>()?;
        let rows: Vec<usize> = factors.iter().map(FullMatrix::rows).collect();
        let columns: Vec<usize> = factors.iter().map(FullMatrix::columns).collect();
        let factors: Vec<Vec<f64>> = factors.into_iter().map(FullMatrix::into_vec).collect();
        Ok(TtMatrix::rank_one(&factors, &rows, &columns).or_raise()?.into())
    }

    /// The identity: ranks 1.
    #[staticmethod]
    fn identity(modes: Vec<usize>) -> PyResult<Self> {
        Ok(TtMatrix::identity(&modes).or_raise()?.into())
    }

    /// diag(x), with the ranks of x.
    #[staticmethod]
    fn from_diagonal(x: &TrainVector) -> Self {
        TtMatrix::from_diagonal(&x.train).into()
    }

    /// Cores of these ranks with entries uniform in [-1, 1], from a seed.
    #[staticmethod]
    #[pyo3(signature = (rows, columns, rank, seed=1))]
    fn random(rows: Vec<usize>, columns: Vec<usize>, rank: usize, seed: u64) -> PyResult<Self> {
        Ok(TtMatrix::random(&rows, &columns, rank, seed).or_raise()?.into())
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

    /// Rows of the full matrix.
    #[getter]
    fn num_rows(&self) -> PyResult<usize> {
        self.train.num_rows().or_raise()
    }

    /// Columns of the full matrix.
    #[getter]
    fn num_columns(&self) -> PyResult<usize> {
        self.train.num_columns().or_raise()
    }

    /// The train over paired digits, row digit the fastest.
    fn as_vector(&self) -> TrainVector {
        self.train.as_vector().clone().into()
    }

    /// The full matrix.
    fn to_numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let full = detached(py, || self.train.to_full())?;
        let shape = [full.rows(), full.columns()];
        array(py, full.into_vec(), &shape)
    }

    /// The entry at the digits of a row and of a column.
    fn entry(&self, row: Vec<usize>, column: Vec<usize>) -> PyResult<f64> {
        self.train.entry(&row, &column).or_raise()
    }

    /// Entries at (row, column) numbers of the full matrix, an integer array (n, 2): n numbers.
    fn entries<'py>(&self, py: Python<'py>, positions: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let rows = indices("positions", positions, 2)?;
        let positions: Vec<(usize, usize)> = rows.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
        let values = detached(py, || self.train.entries(&positions))?;
        Ok(owned(py, values, &[positions.len()])?.into_any())
    }

    /// The block whose row and column digits lie in these ranges, slices or numbers, one per digit.
    fn sub_matrix(&self, rows: Vec<Bound<'_, PyAny>>, columns: Vec<Bound<'_, PyAny>>) -> PyResult<Self> {
        let rows = ranges("rows", &rows, self.train.row_modes())?;
        let columns = ranges("columns", &columns, self.train.column_modes())?;
        Ok(self.train.sub_matrix(&rows, &columns).or_raise()?.into())
    }

    /// Pickles by the cores.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Parts<'py>)> {
        Ok((py.get_type::<Self>().getattr("from_cores")?, (self.cores(py)?, self.rows(), self.columns())))
    }

    fn __repr__(&self) -> String {
        let (rows, columns) = (self.train.row_modes(), self.train.column_modes());
        format!(
            "<graintrain.TrainMatrix: rows {rows:?}, columns {columns:?}, ranks {:?}>",
            self.train.ranks()
        )
    }
}

/// Algebra and rounding.
#[pymethods]
impl TrainMatrix {
    /// The diagonal of a square matrix.
    fn diagonal(&self) -> PyResult<TrainVector> {
        Ok(self.train.diagonal().or_raise()?.into())
    }

    /// Sum of the diagonal.
    fn trace(&self) -> PyResult<f64> {
        self.train.trace().or_raise()
    }

    /// The product with a TrainVector (a train whose ranks are the products), with another TrainMatrix, or
    /// with a full vector (an array).
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
        let image = detached(py, || FullOperator::new(&self.train)?.multiply(&full))?;
        let rows = image.len();
        Ok(owned(py, image, &[rows])?.into_any())
    }

    fn __matmul__<'py>(&self, py: Python<'py>, x: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.apply(py, x)
    }

    /// A x within a relative error, without its cores of full rank, and a report.
    #[pyo3(signature = (x, tolerance=1e-10, *, max_rank=None))]
    fn times_vector_rounded<'py>(
        &self,
        py: Python<'py>,
        x: &TrainVector,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
        let limits = truncation(tolerance, max_rank);
        with_report(py, detached(py, || self.train.times_vector_rounded(&x.train, &limits))?)
    }

    /// A B within a relative error, without its cores of full rank, and a report.
    #[pyo3(signature = (other, tolerance=1e-10, *, max_rank=None))]
    fn times_matrix_rounded<'py>(
        &self,
        py: Python<'py>,
        other: &Self,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        let limits = truncation(tolerance, max_rank);
        with_report(py, detached(py, || self.train.times_matrix_rounded(&other.train, &limits))?)
    }

    /// The Kronecker product other (x) self: the digits of the other matrix after (above) those of this one.
    fn kronecker(&self, other: &Self) -> Self {
        self.train.kronecker(&other.train).into()
    }

    /// (A + A^T) / 2.
    fn symmetric_part(&self) -> PyResult<Self> {
        Ok(self.train.symmetric_part().or_raise()?.into())
    }

    /// The transposed matrix.
    #[getter]
    #[allow(non_snake_case)]
    fn T(&self) -> Self {
        self.train.transpose().into()
    }
}
