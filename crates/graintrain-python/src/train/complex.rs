//! Complex trains.

use super::{
    TrainMatrix, TrainVector, array, column_major, detached, settings, stoppable, truncation, with_report,
};
use crate::arrays::complex_numbers;
use crate::error::OrRaise;
use graintrain_tt::complex;
use numpy::Complex64;
use pyo3::prelude::*;
use pyo3::types::{PyComplex, PyDict};

/// A complex tensor: a real train with one more mode of size 2, real and imaginary part, before the first
/// one.
#[pyclass(frozen, module = "graintrain.tt")]
pub struct ComplexVector {
    train: complex::ComplexVector,
}

/// A complex matrix over paired digits, as the real matrix [Re A, -Im A; Im A, Re A] of the parts.
#[pyclass(frozen, module = "graintrain.tt")]
pub struct ComplexMatrix {
    matrix: complex::ComplexMatrix,
}

impl From<complex::ComplexVector> for ComplexVector {
    fn from(train: complex::ComplexVector) -> Self {
        Self { train }
    }
}

impl From<complex::ComplexMatrix> for ComplexMatrix {
    fn from(matrix: complex::ComplexMatrix) -> Self {
        Self { matrix }
    }
}

/// What Python's complex() makes of it.
fn number(given: &Bound<'_, PyAny>) -> PyResult<Complex64> {
    let made = given.py().get_type::<PyComplex>().call1((given,))?;
    let z = made.cast::<PyComplex>()?;
    Ok(Complex64::new(z.real(), z.imag()))
}

fn python(py: Python<'_>, z: Complex64) -> Bound<'_, PyComplex> {
    PyComplex::from_doubles(py, z.re, z.im)
}

#[pymethods]
impl ComplexVector {
    /// real + i imaginary.
    #[new]
    fn new(real: &TrainVector, imaginary: &TrainVector) -> PyResult<Self> {
        Ok(complex::ComplexVector::new(&real.train, &imaginary.train).or_raise()?.into())
    }

    /// A real tensor as a complex one: the ranks stay.
    #[staticmethod]
    fn from_real(real: &TrainVector) -> PyResult<Self> {
        Ok(complex::ComplexVector::from_real(&real.train).or_raise()?.into())
    }

    /// The tensor of a real train whose first mode, of size 2, is real and imaginary part.
    #[staticmethod]
    fn from_parts(train: &TrainVector) -> PyResult<Self> {
        Ok(complex::ComplexVector::from_parts(train.train.clone()).or_raise()?.into())
    }

    /// The outer product of complex vectors: ranks 2.
    #[staticmethod]
    fn rank_one(factors: Vec<Bound<'_, PyAny>>) -> PyResult<Self> {
        let factor = |(k, x): (usize, &Bound<'_, PyAny>)| Ok(complex_numbers(&format!("factors[{k}]"), x)?.0);
        let factors = factors.iter().enumerate().map(factor).collect::<PyResult<Vec<_>>>()?;
        Ok(complex::ComplexVector::rank_one(&factors).or_raise()?.into())
    }

    /// TT-SVD of a complex array to a relative error, and a report; `modes` splits a flat one.
    #[staticmethod]
    #[pyo3(signature = (array, tolerance=1e-10, *, max_rank=None, modes=None))]
    fn from_numpy<'py>(
        array: &Bound<'py, PyAny>,
        tolerance: f64,
        max_rank: Option<usize>,
        modes: Option<Vec<usize>>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        let (py, (given, shape)) = (array.py(), complex_numbers("array", array)?);
        let full = if modes.is_some() && shape.len() == 1 { given } else { column_major(&given, &shape) };
        let (modes, limits) = (modes.unwrap_or(shape), truncation(tolerance, max_rank));
        with_report(py, detached(py, || complex::ComplexVector::from_full(&full, &modes, &limits))?)
    }

    /// The real train behind it.
    fn as_parts(&self) -> TrainVector {
        self.train.as_parts().clone().into()
    }

    /// Sizes of the modes.
    #[getter]
    fn modes(&self) -> Vec<usize> {
        self.train.modes()
    }

    /// Ranks of the real train from the bond before the first mode on.
    #[getter]
    fn ranks(&self) -> Vec<usize> {
        self.train.ranks()
    }

    /// Real part.
    #[getter]
    fn real(&self) -> TrainVector {
        self.train.real().into()
    }

    /// Imaginary part.
    #[getter]
    fn imaginary(&self) -> TrainVector {
        self.train.imaginary().into()
    }

    fn __getitem__<'py>(&self, py: Python<'py>, index: Vec<usize>) -> PyResult<Bound<'py, PyComplex>> {
        Ok(python(py, self.train.entry(&index).or_raise()?))
    }

    /// The full tensor, complex128.
    fn to_numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array(py, detached(py, || self.train.to_full())?, &self.train.modes())
    }

    /// sqrt(sum |x|^2).
    fn norm(&self, py: Python<'_>) -> f64 {
        py.detach(|| self.train.norm())
    }

    /// sum conj(x_j) y_j.
    fn dot<'py>(&self, py: Python<'py>, other: &Self) -> PyResult<Bound<'py, PyComplex>> {
        Ok(python(py, detached(py, || self.train.dot(&other.train))?))
    }

    /// The conjugate.
    fn conjugate(&self) -> Self {
        self.train.conjugate().into()
    }

    fn __add__(&self, other: &Self) -> PyResult<Self> {
        Ok(self.train.add(&other.train).or_raise()?.into())
    }

    fn __sub__(&self, other: &Self) -> PyResult<Self> {
        Ok(self.train.subtract(&other.train).or_raise()?.into())
    }

    fn __mul__(&self, factor: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(self.train.scale(number(factor)?).into())
    }

    fn __rmul__(&self, factor: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.__mul__(factor)
    }

    /// The product entry by entry: ranks multiply.
    fn hadamard(&self, other: &Self) -> PyResult<Self> {
        Ok(self.train.hadamard(&other.train).or_raise()?.into())
    }

    /// A train of smaller ranks within a relative error, and a report; see TrainVector.round.
    #[pyo3(signature = (tolerance=1e-10, *, max_rank=None))]
    fn round<'py>(
        &self,
        py: Python<'py>,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        with_report(py, detached(py, || self.train.round(&truncation(tolerance, max_rank)))?)
    }

    /// The unitary Fourier transform over 2^d numbers, "Forward" or "Backward", and a report; see fourier.
    #[pyo3(signature = (direction="Forward", tolerance=1e-10, *, max_rank=None))]
    fn fourier<'py>(
        &self,
        py: Python<'py>,
        direction: &str,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(Self, Bound<'py, PyAny>)> {
        let (direction, limits) =
            (settings::choice("direction", direction)?, truncation(tolerance, max_rank));
        with_report(py, detached(py, || self.train.fourier(direction, &limits))?)
    }

    fn __repr__(&self) -> String {
        format!(
            "<graintrain.tt.ComplexVector: modes {:?}, ranks {:?}>",
            self.train.modes(),
            self.train.ranks()
        )
    }
}

#[pymethods]
impl ComplexMatrix {
    /// real + i imaginary.
    #[new]
    fn new(real: &TrainMatrix, imaginary: &TrainMatrix) -> PyResult<Self> {
        Ok(complex::ComplexMatrix::new(&real.train, &imaginary.train).or_raise()?.into())
    }

    /// The real matrix of the parts.
    fn as_parts(&self) -> TrainMatrix {
        self.matrix.as_parts().clone().into()
    }

    /// The conjugate transpose.
    fn adjoint(&self) -> Self {
        self.matrix.adjoint().into()
    }

    /// A x: ranks multiply.
    fn times_vector(&self, x: &ComplexVector) -> PyResult<ComplexVector> {
        Ok(self.matrix.times_vector(&x.train).or_raise()?.into())
    }

    /// A B: ranks multiply.
    fn times_matrix(&self, other: &Self) -> PyResult<Self> {
        Ok(self.matrix.times_matrix(&other.matrix).or_raise()?.into())
    }

    fn __matmul__<'py>(&self, py: Python<'py>, other: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        if let Ok(x) = other.cast::<ComplexVector>() {
            return Ok(Bound::new(py, self.times_vector(x.get())?)?.into_any());
        }
        Ok(Bound::new(py, self.times_matrix(other.cast::<Self>()?.get())?)?.into_any())
    }

    /// Solves A x = y by AMEn and returns (x, report); see TrainMatrix.solve.
    #[pyo3(signature = (y, tolerance=1e-6, **settings))]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        y: &ComplexVector,
        tolerance: f64,
        settings: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(ComplexVector, Bound<'py, PyAny>)> {
        let settings = settings::settings(tolerance, settings)?;
        with_report(py, stoppable(py, |stop| self.matrix.solve_within(&y.train, &settings, stop))?)
    }

    fn __repr__(&self) -> String {
        let parts = self.matrix.as_parts();
        format!(
            "<graintrain.tt.ComplexMatrix: rows {:?}, ranks {:?}>",
            &parts.row_modes()[1..],
            &parts.ranks()[1..]
        )
    }
}
