//! Contact problems: made of arrays, read from files, solved and measured.

use crate::arrays::{owned, shaped};
use crate::error::{OrRaise, exception};
use crate::report::SolveReport;
use crate::world::{World, friction_model, interruptible};
use graintrain_ccp::registry::Method;
use graintrain_ccp::{Ccp, Criterion, SolveSettings, SolverSpec};
use graintrain_cli::evaluation::Yardstick;
use graintrain_io::problem_file::{self, Entries, Form, ProblemFile};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// A contact problem: impulses g (normal, tangent 1, tangent 2 of every contact) in friction cones, with u =
/// N g + r in the dual cones and at right angles to g.
#[pyclass(frozen, module = "graintrain")]
pub struct Problem {
    file: ProblemFile,
}

/// A matrix as the Python side hands it over: (rows, columns, row indices, column indices, values).
type Coordinates = (usize, usize, Vec<usize>, Vec<usize>, Vec<f64>);

fn entries((rows, columns, row, column, value): Coordinates) -> Entries {
    let entries = row.into_iter().zip(column).zip(value).map(|((row, column), value)| (row, column, value));
    Entries { rows, columns, entries: entries.collect() }
}

/// Block rows of three numbers: one per contact, then one per contact with rolling or spinning friction.
fn blocks(problem: &Ccp) -> usize {
    problem.r.len() / 3
}

impl Problem {
    /// The problem of a step.
    pub fn of_step(problem: &Ccp) -> Self {
        let bodies = problem.delassus.num_bodies();
        let file = ProblemFile {
            problem: problem.clone(),
            form: Form::RigidBodies,
            title: String::new(),
            bodies,
            as_filed: None,
            turning_length: Vec::new(),
            asymmetry: 0.0,
            remarks: Vec::new(),
        };
        Self { file }
    }

    /// Impulses of any shape that has three numbers per contact, and three more per contact with rolling or
    /// spinning friction.
    fn impulses(&self, what: &str, object: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
        let contacts = blocks(&self.file.problem);
        let flat = object.py().import("numpy")?.call_method1("ndim", (object,))?.extract::<usize>()? == 1;
        let shape: &[Option<usize>] = if flat { &[Some(3 * contacts)] } else { &[Some(contacts), Some(3)] };
        shaped(what, object, shape)
    }
}

/// Names of all solvers with a line about each, those of production first.
#[pyfunction]
pub fn solvers(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    for method in Method::available().filter(|method| method.is_listed()) {
        dict.set_item(method.name(), method.about())?;
    }
    Ok(dict)
}

#[pymethods]
impl Problem {
    /// Reads a file: FCLIB (HDF5), the text problems of Siconos, dumps of a run.
    #[staticmethod]
    fn from_file(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Ok(Self { file: py.detach(|| problem_file::read(&path)).or_raise()? })
    }

    /// The problem u = W g + q with coefficients of friction mu, one per contact.
    ///
    /// w: (3 n, 3 n), an array or a sparse matrix of SciPy; contact i has the rows 3 i (normal), 3 i + 1 and
    /// 3 i + 2 (tangents). q: (3 n,) or (n, 3). Where W is noticeably asymmetric, exact friction takes it as
    /// it is and the relaxation its symmetric part: see notes.
    #[staticmethod]
    fn from_matrix(w: &Bound<'_, PyAny>, q: &Bound<'_, PyAny>, mu: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = w.py();
        let parts = py.import("graintrain._arrays")?.call_method1("local_problem", (w, q, mu))?;
        let (w, q, mu): (Coordinates, Vec<f64>, Vec<f64>) = parts.extract()?;
        let read = || problem_file::from_local("arrays", entries(w), q, mu);
        Ok(Self { file: py.detach(read).or_raise()? })
    }

    /// The problem u = D^T M^-1 D g + r of bodies, with coefficients of friction mu, one per contact.
    ///
    /// d: (freedoms, 3 n), an array or a sparse matrix: generalised forces of unit impulses. inverse_mass:
    /// its diagonal (freedoms,), blocks (bodies, 6, 6), or a sparse matrix; rows of zeros belong to what does
    /// not move. r: (3 n,) or (n, 3). Rigid bodies, six rows each, are recognised and kept, so that solvers
    /// work over bodies: see form.
    #[staticmethod]
    fn from_bodies(
        d: &Bound<'_, PyAny>,
        inverse_mass: &Bound<'_, PyAny>,
        r: &Bound<'_, PyAny>,
        mu: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let py = d.py();
        let parts =
            py.import("graintrain._arrays")?.call_method1("global_problem", (d, inverse_mass, r, mu))?;
        let (m, h, r, mu): (Coordinates, Coordinates, Vec<f64>, Vec<f64>) = parts.extract()?;
        let force = vec![0.0; m.0];
        let read = || problem_file::from_global("arrays", [entries(m), entries(h)], [force, r], mu);
        Ok(Self { file: py.detach(read).or_raise()? })
    }

    /// Writes the problem as an FCLIB file.
    #[pyo3(signature = (path, title=""))]
    fn dump(&self, py: Python<'_>, path: PathBuf, title: &str) -> PyResult<()> {
        py.detach(|| problem_file::write(&path, &self.file.problem, title)).or_raise()
    }

    /// Solves the problem and returns (impulses, report): impulses (n, 3) in N s, normal first, the best
    /// found whether or not the tolerance was reached, which report.converged tells.
    ///
    /// solver: a name of graintrain.solvers(), with a linear solver after a plus sign: "ipm", "pgs",
    /// "pdip+ic". friction: "relaxed" or "coulomb" (exact). criterion: "maximum" (worst contact) or "mixed"
    /// (root mean square, as in runs). start: impulses to begin with.
    #[pyo3(signature = (solver="auto", *, tolerance=1e-4, friction="relaxed", criterion="maximum", max_iterations=None, max_seconds=None,
                        start=None))]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        solver: &str,
        tolerance: f64,
        friction: &str,
        criterion: &str,
        max_iterations: Option<usize>,
        max_seconds: Option<f64>,
        start: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyAny>, SolveReport)> {
        if !(tolerance.is_finite() && tolerance > 0.0) {
            return Err(PyValueError::new_err(format!(
                "tolerance is {tolerance}; it must be finite and positive"
            )));
        }
        let limit = |seconds: f64| {
            Duration::try_from_secs_f64(seconds).map_err(|_| {
                PyValueError::new_err(format!("max_seconds is {seconds}; it must be finite and not negative"))
            })
        };
        let criterion = match criterion {
            "maximum" => Criterion::Maximum,
            "mixed" => Criterion::Mixed,
            _ => {
                return Err(PyValueError::new_err(format!(
                    "criterion = '{criterion}': choose maximum or mixed"
                )));
            }
        };
        let friction = friction_model(friction)?;
        let problem = self.file.posed(friction);
        let mut impulse = match start {
            Some(start) => self.impulses("start", start)?,
            None => vec![0.0; problem.r.len()],
        };
        let stop = Arc::<AtomicBool>::default();
        let settings = SolveSettings {
            tolerance,
            criterion,
            max_iterations,
            max_time: max_seconds.map(limit).transpose()?,
            friction,
            stop: Some(Arc::clone(&stop)),
            ..SolveSettings::default()
        };
        let mut solver = solver.parse::<SolverSpec>().and_then(|spec| spec.build()).or_raise()?;
        let report =
            interruptible(py, &[stop], || solver.solve(problem, &mut impulse, &settings))?.or_raise()?;
        let impulse = owned(py, impulse, &[blocks(problem), 3])?;
        Ok((impulse.into_any(), SolveReport::new(report)))
    }

    /// Residual of impulses, evaluated by code that no solver uses: (worst contact, root mean square),
    /// dimensionless.
    #[pyo3(signature = (impulses, friction="relaxed"))]
    fn residual(&self, impulses: &Bound<'_, PyAny>, friction: &str) -> PyResult<(f64, f64)> {
        let (impulse, model) = (self.impulses("impulses", impulses)?, friction_model(friction)?);
        let residual = Yardstick::new(self.file.posed(model)).evaluate(&impulse).residual(model);
        Ok((residual.max, residual.rms))
    }

    /// What impulses are worth, evaluated by code that no solver uses: a dict of velocities (n, 3),
    /// residual_relaxed and residual_coulomb (worst contact, root mean square), objective (J), gap (how far
    /// it may lie above the optimum, relative), and the numbers of contacts apart, sticking and sliding.
    fn evaluate<'py>(&self, py: Python<'py>, impulses: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let impulse = self.impulses("impulses", impulses)?;
        let found = Yardstick::new(&self.file.problem).evaluate(&impulse);
        let dict = PyDict::new(py);
        dict.set_item("velocities", owned(py, found.velocity, &[blocks(&self.file.problem), 3])?)?;
        dict.set_item("residual_relaxed", (found.relaxed.max, found.relaxed.rms))?;
        dict.set_item("residual_coulomb", (found.coulomb.max, found.coulomb.rms))?;
        dict.set_item("objective", found.objective)?;
        dict.set_item("gap", found.gap)?;
        dict.set_item("apart", found.apart)?;
        dict.set_item("sticking", found.sticking)?;
        dict.set_item("sliding", found.sliding)?;
        Ok(dict)
    }

    /// N as (row indices, column indices, values), both triangles: scipy.sparse.coo_array((v, (i, j))) makes
    /// a matrix of it.
    fn matrix<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let matrix = self.file.problem.delassus.assemble();
        let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for (i, j, block) in matrix.iter() {
            for (e, value) in block.into_iter().enumerate() {
                rows.push((3 * i + e / 3) as i64);
                columns.push((3 * j + e % 3) as i64);
                values.push(value);
            }
        }
        let size = [values.len()];
        Ok((
            owned(py, rows, &size)?.into_any(),
            owned(py, columns, &size)?.into_any(),
            owned(py, values, &size)?.into_any(),
        ))
    }

    /// Free relative velocities r, (n, 3), m/s.
    #[getter]
    fn r<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(owned(py, self.file.problem.r.clone(), &[blocks(&self.file.problem), 3])?.into_any())
    }

    /// Coefficients of friction.
    #[getter]
    fn friction<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(owned(py, self.file.problem.friction.clone(), &[self.file.problem.num_contacts()])?.into_any())
    }

    /// The velocity that makes residuals dimensionless, m/s.
    #[getter]
    fn velocity_scale(&self) -> f64 {
        graintrain_ccp::residual::velocity_scale(&self.file.problem)
    }

    /// Number of bodies; 0 where they are not known.
    #[getter]
    fn bodies(&self) -> usize {
        self.file.bodies
    }

    /// "local" (an explicit matrix), "rigid-bodies" or "condensed".
    #[getter]
    fn form(&self) -> &'static str {
        match self.file.form {
            Form::Local => "local",
            Form::RigidBodies => "rigid-bodies",
            Form::Condensed => "condensed",
        }
    }

    /// The title in the file.
    #[getter]
    fn title(&self) -> &str {
        &self.file.title
    }

    /// What was taken in another way than the file or the arrays say it, one sentence each.
    #[getter]
    fn notes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        PyList::new(py, self.file.notes())
    }

    fn __len__(&self) -> usize {
        self.file.problem.num_contacts()
    }

    fn __repr__(&self) -> String {
        format!(
            "<graintrain.Problem: {} contacts, {} bodies>",
            self.file.problem.num_contacts(),
            self.file.bodies
        )
    }
}

#[pymethods]
impl World {
    /// The contact problem of the last step, with the impulses found, (n, 3) in the contacts' frames (normal,
    /// tangents); after the rows of all contacts come the moments of those with rolling or spinning friction.
    #[getter]
    fn problem<'py>(&mut self, py: Python<'py>) -> PyResult<(Problem, Bound<'py, PyAny>)> {
        let Some((problem, impulse)) = self.run().last_problem() else {
            return Err(exception::ProblemError::new_err("no step has been made since the world was made"));
        };
        let impulse = owned(py, impulse.to_vec(), &[blocks(problem), 3])?;
        Ok((Problem::of_step(problem), impulse.into_any()))
    }
}
