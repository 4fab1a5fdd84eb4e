//! Sparse and symmetric matrices, sketches, operators on full vectors.

use super::matrix::quadtree;
use super::{TrainMatrix, TrainVector, array, column_major, detached, truncation, with_report};
use crate::arrays::{indices, numbers, owned, shaped};
use crate::error::OrRaise;
use crate::plain::plain;
use graintrain_tt::apply::ApplyWork;
use graintrain_tt::{apply, definite, sketch, sparse, symmetric};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A square sparse matrix of size leaf * 2**levels, cut into leaf blocks along a quadtree: its train comes
/// from one exact pass over its nonzeros.
#[pyclass(frozen, module = "graintrain.tt")]
pub struct QuadtreeMatrix {
    pub(super) matrix: sparse::QuadtreeMatrix,
}

#[pymethods]
impl QuadtreeMatrix {
    /// From a square matrix of SciPy (or an array), padded with zeros to leaf * 2**levels.
    #[staticmethod]
    #[pyo3(signature = (matrix, leaf=4))]
    fn from_sparse(matrix: &Bound<'_, PyAny>, leaf: usize) -> PyResult<Self> {
        Ok(Self { matrix: quadtree(matrix, leaf)? })
    }

    /// From values (n) at (row, column) pairs (n, 2) in a matrix of size leaf_size * 2**levels; values at the
    /// same place are added.
    #[staticmethod]
    fn from_entries(
        leaf_size: usize,
        levels: usize,
        positions: &Bound<'_, PyAny>,
        values: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let places = indices("positions", positions, 2)?;
        let values = shaped("values", values, &[Some(places.len() / 2)])?;
        let entries = places.chunks_exact(2).zip(values).map(|(place, value)| (place[0], place[1], value));
        Ok(Self { matrix: sparse::QuadtreeMatrix::from_entries(leaf_size, levels, entries).or_raise()? })
    }

    /// From 3x3 blocks (n, 3, 3) at (block row, block column) pairs (n, 2), block row c at place[c] of
    /// slots * 2**levels; places that are free get `dummy` on their diagonal.
    #[staticmethod]
    #[pyo3(signature = (positions, blocks, place, slots, levels, dummy=0.0))]
    fn from_blocks(
        positions: &Bound<'_, PyAny>,
        blocks: &Bound<'_, PyAny>,
        place: Vec<usize>,
        slots: usize,
        levels: usize,
        dummy: f64,
    ) -> PyResult<Self> {
        let places = indices("positions", positions, 2)?;
        let given = shaped("blocks", blocks, &[Some(places.len() / 2), Some(3), Some(3)])?;
        let block = |(place, block): (&[usize], &[f64])| {
            let mut numbers = [0.0; 9];
            numbers.copy_from_slice(block);
            (place[0], place[1], numbers)
        };
        let blocks = places.chunks_exact(2).zip(given.chunks_exact(9)).map(block);
        let matrix = sparse::QuadtreeMatrix::from_blocks(blocks, &place, slots, levels, dummy);
        Ok(Self { matrix: matrix.or_raise()? })
    }

    /// Size of a leaf block.
    #[getter]
    fn leaf_size(&self) -> usize {
        self.matrix.leaf_size()
    }

    /// Levels of 2x2 blocks above the leaves.
    #[getter]
    fn levels(&self) -> usize {
        self.matrix.levels()
    }

    /// Digits of rows and columns, leaf_size, 2, ..., 2.
    #[getter]
    fn modes(&self) -> Vec<usize> {
        self.matrix.modes()
    }

    /// Numbers stored.
    #[getter]
    fn num_entries(&self) -> usize {
        self.matrix.num_entries()
    }

    /// Frobenius norm without dummies.
    fn norm(&self) -> f64 {
        self.matrix.norm()
    }

    /// Frobenius norm with dummies.
    fn augmented_norm(&self) -> f64 {
        self.matrix.augmented_norm()
    }

    /// One entry, dummies included.
    fn entry(&self, row: usize, column: usize) -> f64 {
        self.matrix.entry(row, column)
    }

    /// Stored entries: (row, column) pairs (n, 2) and values (n).
    fn entries<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (mut places, mut values) = (Vec::new(), Vec::new());
        for (row, column, value) in self.matrix.entries() {
            places.extend([row, column]);
            values.push(value);
        }
        let count = values.len();
        Ok((super::index_rows(py, &places, 2)?, owned(py, values, &[count])?.into_any()))
    }

    /// ||S - train||_F relative to the norm without dummies: over all entries; not below 1e-8.
    fn relative_error(&self, py: Python<'_>, train: &TrainMatrix) -> PyResult<f64> {
        detached(py, || self.matrix.relative_error(&train.train))
    }

    /// The train within an error relative to the norm without dummies, and a report: error, floor,
    /// augmented_error, norm, capped. O(nonzeros r^2) per level.
    #[pyo3(signature = (tolerance=1e-10, *, max_rank=None))]
    fn to_train<'py>(
        &self,
        py: Python<'py>,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(TrainMatrix, Bound<'py, PyAny>)> {
        with_report(py, detached(py, || self.matrix.to_train(&truncation(tolerance, max_rank)))?)
    }

    /// As to_train for a symmetric matrix, shifted by a multiple of the identity so that no eigenvalue (by
    /// Lanczos of so many steps) lies below floor.
    #[pyo3(signature = (floor, tolerance=1e-10, *, max_rank=None, steps=50))]
    fn to_definite_train<'py>(
        &self,
        py: Python<'py>,
        floor: f64,
        tolerance: f64,
        max_rank: Option<usize>,
        steps: usize,
    ) -> PyResult<(TrainMatrix, Bound<'py, PyAny>)> {
        let limits = truncation(tolerance, max_rank);
        with_report(py, detached(py, || self.matrix.to_definite_train(&limits, floor, steps))?)
    }
}

/// A symmetric matrix with even and odd bonds: half the numbers, symmetric to the last bit.
#[pyclass(frozen, module = "graintrain.tt")]
pub struct SymmetricTrain {
    train: symmetric::SymmetricTrain,
}

impl From<symmetric::SymmetricTrain> for SymmetricTrain {
    fn from(train: symmetric::SymmetricTrain) -> Self {
        Self { train }
    }
}

#[pymethods]
impl SymmetricTrain {
    /// (A + A^T) / 2.
    #[staticmethod]
    fn symmetric_part(matrix: &TrainMatrix) -> PyResult<Self> {
        Ok(symmetric::SymmetricTrain::symmetric_part(&matrix.train).or_raise()?.into())
    }

    /// The same matrix as an ordinary train.
    fn to_matrix(&self) -> TrainMatrix {
        self.train.to_matrix().into()
    }

    /// Digits of rows and columns.
    #[getter]
    fn modes(&self) -> Vec<usize> {
        self.train.modes().to_vec()
    }

    /// Even and odd rank of every bond.
    #[getter]
    fn ranks(&self) -> Vec<(usize, usize)> {
        self.train.ranks()
    }

    /// Numbers stored.
    #[getter]
    fn num_parameters(&self) -> usize {
        self.train.num_parameters()
    }

    /// A x.
    fn times_vector(&self, x: &TrainVector) -> PyResult<TrainVector> {
        Ok(self.train.times_vector(&x.train).or_raise()?.into())
    }

    fn __add__(&self, other: &Self) -> PyResult<Self> {
        Ok(self.train.add(&other.train).or_raise()?.into())
    }

    fn __mul__(&self, factor: f64) -> Self {
        self.train.scale(factor).into()
    }

    fn __rmul__(&self, factor: f64) -> Self {
        self.__mul__(factor)
    }

    /// The shortest graded train within a relative error, and a report.
    #[pyo3(signature = (tolerance=1e-10, *, max_rank=None))]
    fn round<'py>(
        &self,
        py: Python<'py>,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        with_report(py, detached(py, || self.train.round(&truncation(tolerance, max_rank)))?)
    }
}

/// Random sketches of a tensor that comes in parts (entries, trains, sparse matrices), and a train from them.
/// Sketches of the same modes, rank and seed can be added.
#[pyclass(module = "graintrain.tt")]
pub struct Sketch {
    sketch: sketch::Sketch,
    modes: usize,
}

#[pymethods]
impl Sketch {
    /// The sketch of zero for results of rank up to `rank`.
    #[new]
    #[pyo3(signature = (modes, rank, seed=1))]
    fn new(modes: Vec<usize>, rank: usize, seed: u64) -> PyResult<Self> {
        Ok(Self { sketch: sketch::Sketch::new(&modes, rank, seed).or_raise()?, modes: modes.len() })
    }

    /// Adds values (n) at the rows of an integer array (n, d).
    fn add_entries(&mut self, index: &Bound<'_, PyAny>, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let rows = indices("index", index, self.modes)?;
        let values = shaped("values", values, &[Some(rows.len() / self.modes)])?;
        index.py().detach(|| self.sketch.add_entries(&rows, &values)).or_raise()
    }

    /// Adds a sparse matrix over paired digits.
    fn add_sparse(&mut self, py: Python<'_>, matrix: &QuadtreeMatrix) -> PyResult<()> {
        detached(py, || self.sketch.add_sparse(&matrix.matrix))
    }

    /// Adds a train.
    fn add_train(&mut self, py: Python<'_>, train: &TrainVector) -> PyResult<()> {
        detached(py, || self.sketch.add_train(&train.train))
    }

    /// Adds another sketch.
    fn add(&mut self, other: &Self) -> PyResult<()> {
        self.sketch.add(&other.sketch).or_raise()
    }

    /// The train, and a report whose error is an estimate.
    #[pyo3(signature = (tolerance=1e-10, *, max_rank=None))]
    fn to_train<'py>(
        &self,
        py: Python<'py>,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(TrainVector, Bound<'py, PyAny>)> {
        with_report(py, detached(py, || self.sketch.to_train(&truncation(tolerance, max_rank)))?)
    }
}

/// A matrix train made ready for products with full vectors, O(r^2 N log N) each.
#[pyclass(frozen, module = "graintrain.tt")]
pub struct FullOperator {
    operator: apply::FullOperator,
}

#[pymethods]
impl FullOperator {
    /// Of this matrix.
    #[new]
    fn new(py: Python<'_>, matrix: &TrainMatrix) -> PyResult<Self> {
        Ok(Self { operator: detached(py, || apply::FullOperator::new(&matrix.train))? })
    }

    /// Rows.
    #[getter]
    fn num_rows(&self) -> usize {
        self.operator.num_rows()
    }

    /// Columns.
    #[getter]
    fn num_columns(&self) -> usize {
        self.operator.num_columns()
    }

    /// Operations of one product.
    #[getter]
    fn flops(&self) -> f64 {
        self.operator.flops()
    }

    /// Bytes that one product moves at least.
    #[getter]
    fn traffic(&self) -> f64 {
        self.operator.traffic()
    }

    /// A x for an array (n) or the columns of one (n, k), which are taken together.
    fn apply<'py>(&self, py: Python<'py>, x: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let (given, shape) = numbers("x", x)?;
        let [n, ref rest @ ..] = shape[..] else {
            return Err(PyValueError::new_err("x is a number, expected an array"));
        };
        if n != self.num_columns() || rest.len() > 1 {
            let wanted = self.num_columns();
            return Err(PyValueError::new_err(format!(
                "x has the shape {shape:?}, expected ({wanted},) or ({wanted}, k)"
            )));
        }
        let (columns, x) = (rest.first().copied().unwrap_or(1), column_major(&given, &shape));
        let mut y = vec![0.0; self.num_rows() * columns];
        if columns > 0 {
            detached(py, || self.operator.apply_many(&x, &mut y, &mut ApplyWork::default()))?;
        }
        let result: Vec<usize> = std::iter::once(self.num_rows()).chain(rest.iter().copied()).collect();
        array(py, y, &result)
    }

    /// Smallest and largest eigenvalue of a symmetric operator by Lanczos of so many steps: two dicts with
    /// value and residual.
    #[pyo3(signature = (steps=50, seed=1))]
    fn extreme_eigenvalues<'py>(
        &self,
        py: Python<'py>,
        steps: usize,
        seed: u64,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (smallest, largest) =
            detached(py, || definite::extreme_eigenvalues(&self.operator, steps, seed))?;
        Ok((plain(py, &smallest)?, plain(py, &largest)?))
    }
}
