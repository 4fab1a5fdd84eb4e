//! What steps and solves report.

use crate::arrays::owned;
use crate::plain::plain;
use graintrain::stepper;
use graintrain_io::quantity::{QUANTITIES, Value};
use pyo3::IntoPyObjectExt as _;
use pyo3::exceptions::PyAttributeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// What a solve of a contact problem did.
#[pyclass(frozen, module = "graintrain")]
pub struct SolveReport {
    report: graintrain_ccp::SolveReport,
}

impl SolveReport {
    /// The report for Python.
    pub fn new(report: graintrain_ccp::SolveReport) -> Self {
        Self { report }
    }
}

fn pair(residual: graintrain_ccp::Residual) -> (f64, f64) {
    (residual.max, residual.rms)
}

#[pymethods]
impl SolveReport {
    /// Name of the solver.
    #[getter]
    fn solver(&self) -> &str {
        &self.report.solver
    }

    /// "converged", "stalled", "iteration-limit", "stopped" or "infeasible".
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.report.status)
    }

    /// Whether the tolerance was reached.
    #[getter]
    fn converged(&self) -> bool {
        self.report.converged()
    }

    /// Iterations of the outer method.
    #[getter]
    fn iterations(&self) -> usize {
        self.report.iterations
    }

    /// Iterations of linear solvers, summed.
    #[getter]
    fn linear_iterations(&self) -> usize {
        self.report.linear_iterations
    }

    /// Products with N of first-order methods.
    #[getter]
    fn products(&self) -> usize {
        self.report.products
    }

    /// Residual of the impulses in the friction model asked for: (worst contact, root mean square),
    /// dimensionless.
    #[getter]
    fn residual(&self) -> (f64, f64) {
        pair(self.report.residual)
    }

    /// Residual as the relaxed problem: (worst contact, root mean square).
    #[getter]
    fn residual_relaxed(&self) -> (f64, f64) {
        pair(self.report.residual_relaxed)
    }

    /// Residual with exact Coulomb friction: (worst contact, root mean square).
    #[getter]
    fn residual_coulomb(&self) -> (f64, f64) {
        pair(self.report.residual_coulomb)
    }

    /// 1/2 g.N g + r.g, J.
    #[getter]
    fn objective(&self) -> f64 {
        self.report.objective
    }

    /// Wall-clock seconds.
    #[getter]
    fn seconds(&self) -> f64 {
        self.report.seconds
    }

    /// What is to be said beside the status, or None.
    #[getter]
    fn remark(&self) -> Option<&str> {
        self.report.remark.as_deref()
    }

    /// The residual on the way, shape (n, 4): iteration, seconds, root mean square, worst contact. At most
    /// 257 rows.
    #[getter]
    fn history<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let history = &self.report.history;
        let rows = history.iter().flat_map(|s| [s.iteration as f64, s.seconds, s.rms, s.max]);
        Ok(owned(py, rows.collect(), &[history.len(), 4])?.into_any())
    }

    /// All of it as a dict.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.report)
    }

    fn __repr__(&self) -> String {
        let report = &self.report;
        format!(
            "<graintrain.SolveReport: {} {:?} after {} iterations, residual {:.2e}>",
            report.solver, report.status, report.iterations, report.residual.max
        )
    }
}

/// What a step did.
#[pyclass(frozen, module = "graintrain")]
pub struct StepReport {
    report: stepper::StepReport,
}

impl StepReport {
    /// The report for Python.
    pub fn new(report: stepper::StepReport) -> Self {
        Self { report }
    }
}

fn value(py: Python<'_>, value: Value) -> PyResult<Bound<'_, PyAny>> {
    match value {
        Value::Count(count) => count.into_bound_py_any(py),
        Value::Real(real) => real.into_bound_py_any(py),
        Value::Text(text) => text.into_bound_py_any(py),
        Value::Absent => Ok(py.None().into_bound(py)),
    }
}

#[pymethods]
impl StepReport {
    /// Every column of `steps.csv` that a step has, by its name: `report.contacts`, `report.cone_excess`, ...
    /// (docs/output.md). `None` where a step has none.
    fn __getattr__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let quantity = QUANTITIES.iter().find(|quantity| quantity.column.name == name);
        let Some(quantity) = quantity else {
            return Err(PyAttributeError::new_err(format!("a step report has no {name}: see dir(report)")));
        };
        value(py, (quantity.value)(&self.report))
    }

    /// All names.
    fn __dir__(slf: &Bound<'_, Self>) -> PyResult<Vec<String>> {
        let own = slf.get_type().getattr("__dict__")?.call_method0("keys")?;
        let own = own.try_iter()?.map(|name| name?.extract::<String>()).collect::<PyResult<Vec<_>>>()?;
        Ok(own
            .into_iter()
            .chain(QUANTITIES.iter().map(|quantity| quantity.column.name.to_string()))
            .collect())
    }

    /// The columns of `steps.csv` that a step has, as a dict.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for quantity in QUANTITIES {
            dict.set_item(quantity.column.name, value(py, (quantity.value)(&self.report))?)?;
        }
        Ok(dict)
    }

    /// What the solver did.
    #[getter]
    fn solve(&self) -> SolveReport {
        SolveReport::new(self.report.solve.clone())
    }

    /// What changed the kinetic energy in the step, J, as a dict: gravity, loads, drives, friction, normal,
    /// rest.
    #[getter]
    fn ledger<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.report.ledger)
    }

    /// What is left of the contact problem in physical units, as a dict: approach_max (m/s),
    /// overlap_per_step_max_over_size, cone_excess_max, slip_angle_max (rad), joint_opening_max (m),
    /// momentum_lost_max.
    #[getter]
    fn errors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.report.errors)
    }

    /// Seconds per phase: collide, assemble, solve, integrate.
    #[getter]
    fn phases<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.report.phases)
    }

    /// What contacts exert on bodies that are not free, averaged over the step: three arrays with one row
    /// each, the indices of the bodies, forces (N) and torques about their centres (N m).
    #[getter]
    fn wrenches<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let wrenches = &self.report.wrenches;
        let bodies = wrenches.iter().map(|wrench| wrench.body.index()).collect();
        let rows = |of: fn(&stepper::Wrench) -> [f64; 3]| wrenches.iter().flat_map(of).collect::<Vec<f64>>();
        let shape = [wrenches.len(), 3];
        Ok((
            owned::<usize>(py, bodies, &shape[..1])?.into_any(),
            owned(py, rows(|wrench| wrench.force.to_array()), &shape)?.into_any(),
            owned(py, rows(|wrench| wrench.torque.to_array()), &shape)?.into_any(),
        ))
    }

    fn __repr__(&self) -> String {
        let report = &self.report;
        format!(
            "<graintrain.StepReport: {} contacts, {} {:?} at residual {:.2e}>",
            report.contacts, report.solve.solver, report.solve.status, report.solve.residual.max
        )
    }
}
