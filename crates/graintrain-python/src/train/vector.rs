//! Tensors as trains.

use super::{
    Cores, array, column_major, core_array, cores_of, detached, index_rows, maybe_with_report, settings,
    stoppable, truncation, value_and_floor, with_report,
};
use crate::arrays::{indices, numbers, owned, shaped};
use crate::error::OrRaise;
use crate::plain::plain;
use graintrain_tt::TtVector;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// A tensor as a tensor train, A[i_1, ..., i_d] = G_1[i_1] ... G_d[i_d] with matrices G_k[i_k] of ranks
/// r_{k-1} x r_k. Indices run as in NumPy; the first one is the fastest in flat vectors of numbers split into
/// digits (order "F").
#[pyclass(frozen, module = "graintrain")]
pub struct TrainVector {
    pub(super) train: TtVector,
}

impl From<TtVector> for TrainVector {
    fn from(train: TtVector) -> Self {
        Self { train }
    }
}

super::shared::shared!(TrainVector(TtVector));

/// Making and reading.
#[pymethods]
impl TrainVector {
    /// TT-SVD of an array to a relative error in the Frobenius norm (Oseledets 2011); `modes` splits a flat
    /// one. With return_report=True also a dict: error, floor, norm, capped.
    #[staticmethod]
    #[pyo3(signature = (array, tolerance=1e-10, *, max_rank=None, modes=None, return_report=false))]
    fn from_numpy<'py>(
        array: &Bound<'py, PyAny>,
        tolerance: f64,
        max_rank: Option<usize>,
        modes: Option<Vec<usize>>,
        return_report: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = array.py();
        let (given, shape) = numbers("array", array)?;
        let full = if modes.is_some() && shape.len() == 1 { given } else { column_major(&given, &shape) };
        let modes = modes.unwrap_or(shape);
        let found = detached(py, || TtVector::from_full(&full, &modes, &truncation(tolerance, max_rank)))?;
        maybe_with_report::<_, Self>(py, found, return_report)
    }

    /// From cores, arrays (left rank, mode, right rank) with outer ranks 1.
    #[staticmethod]
    fn from_cores(cores: Vec<Bound<'_, PyAny>>) -> PyResult<Self> {
        Ok(TtVector::from_cores(cores_of(&cores)?).or_raise()?.into())
    }

    /// The outer product of vectors, x_1[i_1] ... x_d[i_d]: ranks 1.
    #[staticmethod]
    fn rank_one(factors: Vec<Bound<'_, PyAny>>) -> PyResult<Self> {
        let factor = |(k, x): (usize, &Bound<'_, PyAny>)| shaped(&format!("factors[{k}]"), x, &[None]);
        let factors = factors.iter().enumerate().map(factor).collect::<PyResult<Vec<_>>>()?;
        Ok(TtVector::rank_one(&factors).or_raise()?.into())
    }

    /// All entries the same: ranks 1.
    #[staticmethod]
    fn constant(modes: Vec<usize>, value: f64) -> PyResult<Self> {
        Ok(TtVector::constant(&modes, value).or_raise()?.into())
    }

    /// One entry 1, all others 0: ranks 1.
    #[staticmethod]
    fn unit(modes: Vec<usize>, index: Vec<usize>) -> PyResult<Self> {
        Ok(TtVector::unit(&modes, &index).or_raise()?.into())
    }

    /// Cores of these ranks (less where the tensor does not allow them) with entries uniform in [-1, 1], from
    /// a seed.
    #[staticmethod]
    #[pyo3(signature = (modes, rank, seed=1))]
    fn random(modes: Vec<usize>, rank: usize, seed: u64) -> PyResult<Self> {
        Ok(TtVector::random(&modes, rank, seed).or_raise()?.into())
    }

    /// Sizes of the modes.
    #[getter]
    fn modes(&self) -> Vec<usize> {
        self.train.modes()
    }

    /// Numbers stored.
    #[getter]
    fn num_parameters(&self) -> usize {
        self.train.num_parameters()
    }

    /// Entries of the full tensor (a float: they may exceed any integer).
    #[getter]
    fn num_entries(&self) -> f64 {
        self.train.num_entries()
    }

    /// The full tensor.
    fn to_numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array(py, detached(py, || self.train.to_full())?, &self.train.modes())
    }

    fn __getitem__(&self, index: Vec<usize>) -> PyResult<f64> {
        self.train.entry(&index).or_raise()
    }

    /// Entries at the rows of an integer array (n, d): n numbers. O(n d r^2).
    fn entries<'py>(&self, py: Python<'py>, index: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let rows = indices("index", index, self.train.num_cores())?;
        let values = detached(py, || self.train.entries(&rows))?;
        let count = values.len();
        Ok(owned(py, values, &[count])?.into_any())
    }

    /// The entries whose index k lies in ranges[k], a slice or one number (a mode of size 1: see squeeze).
    /// Ranks stay: round afterwards.
    fn sub_tensor(&self, ranges: Vec<Bound<'_, PyAny>>) -> PyResult<Self> {
        let ranges = super::ranges("ranges", &ranges, &self.train.modes())?;
        Ok(self.train.sub_tensor(&ranges).or_raise()?.into())
    }

    /// Without the modes of size one.
    fn squeeze(&self) -> Self {
        self.train.squeeze().into()
    }

    /// Pickles by the cores.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Cores<'py>,))> {
        Ok((py.get_type::<Self>().getattr("from_cores")?, (self.cores(py)?,)))
    }

    fn __repr__(&self) -> String {
        format!("<graintrain.TrainVector: modes {:?}, ranks {:?}>", self.train.modes(), self.train.ranks())
    }
}

/// Algebra and rounding.
#[pymethods]
impl TrainVector {
    /// Inner product. O(d n r^3).
    fn dot(&self, py: Python<'_>, other: &Self) -> PyResult<f64> {
        detached(py, || self.train.dot(&other.train))
    }

    /// Natural logarithm of the norm: does not overflow.
    fn log_norm(&self, py: Python<'_>) -> f64 {
        py.detach(|| self.train.log_norm())
    }

    /// What the relative error of rounding the cores to doubles does not exceed: no error is known below it.
    fn rounding_floor(&self, py: Python<'_>) -> PyResult<f64> {
        detached(py, || self.train.rounding_floor())
    }

    /// Singular values of all d - 1 unfoldings, descending: the ranks that any tolerance needs.
    fn singular_values<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let values = detached(py, || self.train.singular_values())?;
        let list = values.into_iter().map(|s| {
            let count = s.len();
            Ok(owned(py, s, &[count])?.into_any())
        });
        list.collect()
    }

    /// The relative distance and its rounding floor.
    fn measured_distance(&self, py: Python<'_>, other: &Self) -> PyResult<(f64, f64)> {
        Ok(value_and_floor(detached(py, || self.train.measured_distance(&other.train))?))
    }

    /// The same tensor with orthogonal cores but for the last one.
    fn orthogonalise_left(&self, py: Python<'_>) -> Self {
        let mut train = self.train.clone();
        py.detach(|| train.orthogonalise_left());
        train.into()
    }

    /// The same tensor with orthogonal cores but for the first one.
    fn orthogonalise_right(&self, py: Python<'_>) -> Self {
        let mut train = self.train.clone();
        py.detach(|| train.orthogonalise_right());
        train.into()
    }

    /// The outer product: the modes of the other train after those of this one.
    fn kronecker(&self, other: &Self) -> Self {
        self.train.kronecker(&other.train).into()
    }

    /// The modes in reverse order.
    fn reverse(&self) -> Self {
        self.train.reverse().into()
    }

    /// Every entry to a power of at least 1, rounded after every product, and a report.
    #[pyo3(signature = (power, tolerance=1e-10, *, max_rank=None))]
    fn entrywise_power<'py>(
        &self,
        py: Python<'py>,
        power: u32,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        let limits = truncation(tolerance, max_rank);
        with_report(py, detached(py, || self.train.entrywise_power(power, &limits))?)
    }

    /// sum_i weight_i train_i of a list of (weight, train), within a relative error, and a report; dependent
    /// terms cost nothing.
    #[staticmethod]
    #[pyo3(signature = (terms, tolerance=1e-10, *, max_rank=None))]
    fn sum_rounded<'py>(
        py: Python<'py>,
        terms: Vec<(f64, PyRef<'py, Self>)>,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        let terms: Vec<(f64, &TtVector)> = terms.iter().map(|(weight, x)| (*weight, &x.train)).collect();
        let limits = truncation(tolerance, max_rank);
        with_report(py, detached(py, || TtVector::sum_rounded(&terms, &limits))?)
    }

    /// As sum_rounded for very many terms, by random sketches: the report's error is an estimate.
    #[staticmethod]
    #[pyo3(signature = (terms, tolerance=1e-10, *, max_rank=None, seed=1))]
    fn sum_sketched<'py>(
        py: Python<'py>,
        terms: Vec<(f64, PyRef<'py, Self>)>,
        tolerance: f64,
        max_rank: Option<usize>,
        seed: u64,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        let terms: Vec<(f64, &TtVector)> = terms.iter().map(|(weight, x)| (*weight, &x.train)).collect();
        let limits = truncation(tolerance, max_rank);
        with_report(py, detached(py, || TtVector::sum_sketched(&terms, &limits, seed))?)
    }
}

/// Modes.
#[pymethods]
impl TrainVector {
    /// Sum of all entries.
    fn sum(&self) -> f64 {
        self.train.sum()
    }

    /// Sums over the modes where `over` is true.
    fn sum_over(&self, over: Vec<bool>) -> PyResult<Self> {
        Ok(self.train.sum_over(&over).or_raise()?.into())
    }

    /// Groups of so many neighbouring modes as one mode each, the first index of a group the fastest.
    fn merge_modes(&self, py: Python<'_>, sizes: Vec<usize>) -> PyResult<Self> {
        Ok(detached(py, || self.train.merge_modes(&sizes))?.into())
    }

    /// sum_j matrix[i, j] A[..., j, ...] along mode k.
    fn mode_product(&self, py: Python<'_>, k: usize, matrix: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (_, shape) = numbers("matrix", matrix)?;
        let full = column_major(&shaped("matrix", matrix, &[None, None])?, &shape);
        Ok(detached(py, || self.train.mode_product(k, &full, shape[0]))?.into())
    }

    /// The entries of `other` after those of this train along mode k.
    fn concatenate(&self, other: &Self, k: usize) -> PyResult<Self> {
        Ok(self.train.concatenate(&other.train, k).or_raise()?.into())
    }

    /// Mode k of the result is mode order[k] of this train; also a report, whose error is a bound. O(n^3 r^3)
    /// per pair of neighbours that is exchanged.
    #[pyo3(signature = (order, tolerance=1e-10, *, max_rank=None))]
    fn permute<'py>(
        &self,
        py: Python<'py>,
        order: Vec<usize>,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        let limits = truncation(tolerance, max_rank);
        with_report(py, detached(py, || self.train.permute(&order, &limits))?)
    }
}

/// Functions of entries, extremes, samples.
#[pymethods]
impl TrainVector {
    /// y with x y = 1 entry by entry, by AMEn, and a report; its residual holds for ALL entries. Settings as
    /// in TrainMatrix.solve.
    #[pyo3(signature = (tolerance=1e-6, **settings))]
    fn reciprocal<'py>(
        &self,
        py: Python<'py>,
        tolerance: f64,
        settings: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        let settings = settings::settings(tolerance, settings)?;
        with_report(py, stoppable(py, |stop| self.train.reciprocal_within(&settings, stop))?)
    }

    /// y >= 0 with y y = x entry by entry for x >= 0, by cross and Newton's iteration, and a report; its
    /// residual holds for ALL entries. Settings as in cross.
    #[pyo3(signature = (tolerance=1e-6, **settings))]
    fn square_root<'py>(
        &self,
        py: Python<'py>,
        tolerance: f64,
        settings: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        let settings = settings::settings(tolerance, settings)?;
        with_report(py, stoppable(py, |stop| self.train.square_root_within(&settings, stop))?)
    }

    /// The largest and the smallest entry by branch and bound over at most so many nodes: a dict with index,
    /// value, bound and proven for each.
    #[pyo3(signature = (nodes=100_000))]
    fn extremes<'py>(&self, py: Python<'py>, nodes: usize) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &detached(py, || self.train.extremes(nodes))?)
    }

    /// `count` independent samples of the density "Squares" (of the entries) or "Entries" (not negative): an
    /// integer array (count, d). Exact, digit by digit.
    #[pyo3(signature = (count, density="Squares", *, seed=1))]
    fn sample<'py>(
        &self,
        py: Python<'py>,
        count: usize,
        density: &str,
        seed: u64,
    ) -> PyResult<Bound<'py, PyAny>> {
        let density = settings::choice("density", density)?;
        let samples = detached(py, || self.train.sample(density, count, seed))?;
        index_rows(py, &samples, self.train.num_cores())
    }
}
