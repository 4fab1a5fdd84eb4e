//! Functions on named grids.

use super::cross::Called;
use super::{TrainVector, array, column_major, detached, index_rows, settings, truncation, with_report};
use crate::arrays::{indices, numbers, owned, shaped};
use crate::error::OrRaise;
use graintrain_tt::cross::{CrossSettings, EntrySource};
use graintrain_tt::quantics::{self, Axis};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

/// Named variables with intervals and binary digits: {"x": (low, high, bits), ...}.
///
/// order: digits "Morton" (level by level, the coarsest last) or "Separated" (axis after axis). points:
/// "Midpoints" of 2^bits cells, both "Ends" and what lies between, or "Periodic" (low, but not high);
/// integrals are the rules of these points.
#[pyclass(frozen, module = "graintrain.tt")]
pub struct Grid {
    grid: quantics::Grid,
}

/// A function on a grid as a train. Called with one number or array per axis (or by their names) it gives its
/// values, linear between points.
#[pyclass(frozen, module = "graintrain.tt")]
pub struct GridFunction {
    function: quantics::GridFunction,
}

impl From<quantics::GridFunction> for GridFunction {
    fn from(function: quantics::GridFunction) -> Self {
        Self { function }
    }
}

/// A Python function of the coordinates, one array per axis.
struct OfCoordinates<'a> {
    grid: &'a quantics::Grid,
    called: Called,
}

impl EntrySource for OfCoordinates<'_> {
    fn modes(&self) -> Vec<usize> {
        self.grid.modes()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        let axes = self.grid.axes().len();
        // (The cross asks only for indices inside the modes.)
        let points = self.grid.points(indices).unwrap_or_default();
        self.called.fill(values, |py| {
            let column = |axis: usize| {
                let x: Vec<f64> = points.iter().skip(axis).step_by(axes).copied().collect();
                let count = x.len();
                owned(py, x, &[count])
            };
            PyTuple::new(py, (0..axes).map(column).collect::<PyResult<Vec<_>>>()?)
        });
    }
}

#[pymethods]
impl Grid {
    #[new]
    #[pyo3(signature = (axes, order="Morton", points="Midpoints"))]
    fn new(axes: &Bound<'_, PyDict>, order: &str, points: &str) -> PyResult<Self> {
        let axis = |(name, given): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
            let name: String = name.extract()?;
            let (low, high, bits): (f64, f64, usize) = given
                .extract()
                .map_err(|_| PyTypeError::new_err(format!("axis {name:?}: expected (low, high, bits)")))?;
            Axis::new(&name, low, high, bits).or_raise()
        };
        let axes = axes.iter().map(axis).collect::<PyResult<Vec<_>>>()?;
        let (order, points) = (settings::choice("order", order)?, settings::choice("points", points)?);
        Ok(Self { grid: quantics::Grid::new(axes, order, points).or_raise()? })
    }

    /// {name: (low, high, bits)}.
    #[getter]
    fn axes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let axes = PyDict::new(py);
        for axis in self.grid.axes() {
            let (low, high) = axis.interval();
            axes.set_item(axis.name(), (low, high, axis.bits()))?;
        }
        Ok(axes)
    }

    /// "Morton" or "Separated".
    #[getter]
    fn order(&self) -> String {
        format!("{:?}", self.grid.order())
    }

    /// "Midpoints", "Ends" or "Periodic".
    #[getter]
    fn kind(&self) -> String {
        format!("{:?}", self.grid.kind())
    }

    /// Modes of a train on the grid: 2 for every digit.
    #[getter]
    fn modes(&self) -> Vec<usize> {
        self.grid.modes()
    }

    /// All points of an axis.
    fn coordinates<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let points = self.grid.coordinates(name).or_raise()?;
        let count = points.len();
        Ok(owned(py, points, &[count])?.into_any())
    }

    /// Coordinates (n, axes) of entries, an integer array of all digits (n, d).
    fn points<'py>(&self, py: Python<'py>, index: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let rows = indices("index", index, self.grid.modes().len())?;
        let points = self.grid.points(&rows).or_raise()?;
        let axes = self.grid.axes().len();
        let shape = [points.len() / axes, axes];
        Ok(owned(py, points, &shape)?.into_any())
    }

    /// Digits (n, d) of the entries nearest to points (n, axes).
    fn nearest<'py>(&self, py: Python<'py>, points: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let points = shaped("points", points, &[None, Some(self.grid.axes().len())])?;
        index_rows(py, &self.grid.nearest(&points).or_raise()?, self.grid.modes().len())
    }

    /// f(x, y, ...) on the grid by cross interpolation, and its report (see cross); f gets one array per axis
    /// and returns as many values. probes: points (n, axes) that matter, such as peaks. Settings as in cross.
    #[pyo3(signature = (function, tolerance=1e-6, *, probes=None, **settings))]
    fn cross<'py>(
        &self,
        py: Python<'py>,
        function: Py<PyAny>,
        tolerance: f64,
        probes: Option<&Bound<'py, PyAny>>,
        settings: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(GridFunction, Bound<'py, PyAny>)> {
        let axes = Some(self.grid.axes().len());
        let probes = probes.map_or(Ok(Vec::new()), |given| shaped("probes", given, &[None, axes]))?;
        let settings: CrossSettings = settings::settings(tolerance, settings)?;
        let source = OfCoordinates { grid: &self.grid, called: Called::new(Vec::new(), function) };
        let found = py.detach(|| {
            quantics::GridFunction::cross_source(&self.grid, &source, &probes, &settings, &|| false)
        });
        with_report(py, source.called.outcome(found)?)
    }

    /// From all values on the grid, an array with one dimension per axis, within a relative error, and a
    /// report.
    #[pyo3(name = "from_numpy", signature = (array, tolerance=1e-10, *, max_rank=None))]
    fn compressed<'py>(
        &self,
        array: &Bound<'py, PyAny>,
        tolerance: f64,
        max_rank: Option<usize>,
    ) -> PyResult<(GridFunction, Bound<'py, PyAny>)> {
        let sides: Vec<Option<usize>> = self.grid.axes().iter().map(|axis| Some(1 << axis.bits())).collect();
        let given = shaped("array", array, &sides)?;
        let sides: Vec<usize> = sides.into_iter().flatten().collect();
        let (full, limits) = (column_major(&given, &sides), truncation(tolerance, max_rank));
        let py = array.py();
        with_report(py, detached(py, || quantics::GridFunction::from_full(&self.grid, &full, &limits))?)
    }

    /// The function of a train over the digits of the grid.
    fn function(&self, train: &TrainVector) -> PyResult<GridFunction> {
        Ok(quantics::GridFunction::new(&self.grid, train.train.clone()).or_raise()?.into())
    }

    fn __repr__(&self) -> String {
        let axes = self.grid.axes().iter().map(|axis| {
            let (low, high) = axis.interval();
            format!("{} [{low}, {high}] 2^{}", axis.name(), axis.bits())
        });
        format!("<graintrain.tt.Grid: {}>", axes.collect::<Vec<_>>().join(", "))
    }
}

#[pymethods]
impl GridFunction {
    /// The grid.
    #[getter]
    fn grid(&self) -> Grid {
        Grid { grid: self.function.grid().clone() }
    }

    /// The train, for everything that trains can do; grid.function makes it a function again.
    #[getter]
    fn train(&self) -> TrainVector {
        self.function.train().clone().into()
    }

    /// Values at points (n, axes): n numbers.
    fn values<'py>(&self, py: Python<'py>, points: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let points = shaped("points", points, &[None, Some(self.function.grid().axes().len())])?;
        let values = detached(py, || self.function.values(&points))?;
        let count = values.len();
        Ok(owned(py, values, &[count])?.into_any())
    }

    #[pyo3(signature = (*coordinates, **named))]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        coordinates: &Bound<'py, PyTuple>,
        named: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let axes = self.function.grid().axes();
        let named_count = named.map_or(0, |named| named.len());
        if coordinates.len() + named_count != axes.len() {
            let given = coordinates.len() + named_count;
            return Err(PyTypeError::new_err(format!("{given} coordinates, expected {}", axes.len())));
        }
        let mut given: Vec<Bound<'py, PyAny>> = coordinates.iter().collect();
        for axis in &axes[coordinates.len()..] {
            let found = named.map(|named| named.get_item(axis.name())).transpose()?.flatten();
            given
                .push(found.ok_or_else(|| PyTypeError::new_err(format!("no coordinate {:?}", axis.name())))?);
        }
        let numpy = py.import("numpy")?;
        let joined = numpy.call_method1("broadcast_arrays", PyTuple::new(py, given)?)?;
        let keywords = PyDict::new(py);
        keywords.set_item("axis", -1)?;
        let stacked = numpy.call_method("stack", (joined,), Some(&keywords))?;
        let (points, shape) = numbers("coordinates", &stacked)?;
        let values = detached(py, || self.function.values(&points))?;
        match shape[..shape.len() - 1] {
            [] => values.into_iter().next().map_or_else(
                || Err(PyValueError::new_err("no point")),
                |value| Ok(value.into_pyobject(py)?.into_any()),
            ),
            ref sides => Ok(owned(py, values, sides)?.into_any()),
        }
    }

    /// All values on the grid, an array with one dimension per axis.
    fn to_numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let full = detached(py, || self.function.to_full())?;
        let sides: Vec<usize> = self.function.grid().axes().iter().map(|axis| 1 << axis.bits()).collect();
        array(py, full, &sides)
    }

    /// The integral over the variables of these names as a function of the others.
    #[pyo3(signature = (*names))]
    fn integrate(&self, py: Python<'_>, names: Vec<String>) -> PyResult<Self> {
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        Ok(detached(py, || self.function.integrate(&names))?.into())
    }

    /// The integral over all variables.
    fn integral(&self, py: Python<'_>) -> PyResult<f64> {
        detached(py, || self.function.integral())
    }

    /// The function of the other variables at one value of this one.
    fn restrict(&self, py: Python<'_>, name: &str, value: f64) -> PyResult<Self> {
        Ok(detached(py, || self.function.restrict(name, value))?.into())
    }

    fn __repr__(&self) -> String {
        let names = self.function.grid().axes().iter().map(Axis::name).collect::<Vec<_>>().join(", ");
        format!("<graintrain.tt.GridFunction: of {names}, ranks {:?}>", self.function.train().ranks())
    }
}
