//! Derivatives of a step.

use crate::arrays::{owned, shaped};
use crate::error::{Raise, exception};
use crate::world::World;
use graintrain::gradient::{self, GradientError};
use graintrain_ccp::sensitivity::ContactState;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Mutex, PoisonError};

/// The step that would follow a world's state, and its derivatives.
#[pyclass(frozen, module = "graintrain")]
pub struct StepGradient {
    /// Behind a lock because the adjoint system has work memory.
    gradient: Mutex<gradient::StepGradient>,
    materials: Vec<String>,
}

impl Raise for GradientError {
    fn raise(self) -> PyErr {
        match self {
            Self::Step(error) => error.raise(),
            error => exception::NotDifferentiable::new_err(error.to_string()),
        }
    }
}

impl StepGradient {
    fn with<T>(&self, of: impl FnOnce(&mut gradient::StepGradient) -> T) -> T {
        of(&mut self.gradient.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Interleaved rows (velocity, angular velocity) of two arrays (n, 3).
fn interleave(first: &[f64], second: &[f64]) -> Vec<f64> {
    first.chunks_exact(3).zip(second.chunks_exact(3)).flat_map(|(a, b)| [a, b].concat()).collect()
}

/// The two halves of rows of six numbers.
fn halves<'py>(py: Python<'py>, rows: &[f64]) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let half = |start: usize| {
        let numbers: Vec<f64> = rows.chunks_exact(6).flat_map(|row| row[start..start + 3].to_vec()).collect();
        let shape = [rows.len() / 6, 3];
        Ok::<_, PyErr>(owned(py, numbers, &shape)?.into_any())
    };
    Ok((half(0)?, half(3)?))
}

#[pymethods]
impl StepGradient {
    /// Velocities after the step, (n, 3), m/s.
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let rows: Vec<f64> =
            self.with(|g| g.after.bodies.velocity.iter().flat_map(|v| v.to_array()).collect());
        let shape = [rows.len() / 3, 3];
        Ok(owned(py, rows, &shape)?.into_any())
    }

    /// Angular velocities after the step, (n, 3), rad/s.
    #[getter]
    fn angular_velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let rows: Vec<f64> =
            self.with(|g| g.after.bodies.angular_velocity.iter().flat_map(|v| v.to_array()).collect());
        let shape = [rows.len() / 3, 3];
        Ok(owned(py, rows, &shape)?.into_any())
    }

    /// The states of the step's contacts: "apart", "sticking" or "sliding".
    #[getter]
    fn states(&self) -> Vec<&'static str> {
        let name = |state| match state {
            ContactState::Apart => "apart",
            ContactState::Sticking => "sticking",
            ContactState::Sliding => "sliding",
        };
        self.with(|gradient| gradient.states().map(name).collect())
    }

    /// The bodies of the step's contacts, (m, 2).
    #[getter]
    fn bodies<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let pairs: Vec<u32> =
            self.with(|g| g.contacts().iter().flat_map(|contact| [contact.body_a, contact.body_b]).collect());
        let shape = [pairs.len() / 2, 2];
        Ok(owned(py, pairs, &shape)?.into_any())
    }

    /// Vector-Jacobian product. Of a number L with the derivatives `velocities` and `angular_velocities` (n,
    /// 3; None: zero) by the velocities after the step, a dict of its derivatives by what goes into the step:
    /// velocities, angular_velocities (before it), forces, torques, each (n, 3); friction, one per contact of
    /// the step (nan where one has no friction and does not slip); pairs, the sums of these over pairs of
    /// materials, as a dict {(first, second): derivative}.
    #[pyo3(signature = (velocities=None, angular_velocities=None))]
    fn vjp<'py>(
        &self,
        py: Python<'py>,
        velocities: Option<&Bound<'py, PyAny>>,
        angular_velocities: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let count = self.with(|gradient| gradient.after.bodies.len());
        let rows = |what: &str, given: Option<&Bound<'py, PyAny>>| match given {
            Some(given) => shaped(what, given, &[Some(count), Some(3)]),
            None => Ok(vec![0.0; 3 * count]),
        };
        let linear = rows("velocities", velocities)?;
        let cotangent = interleave(&linear, &rows("angular_velocities", angular_velocities)?);
        let pulled = py.detach(|| {
            self.with(|gradient| {
                let pulled = gradient.pull_back(&cotangent)?;
                let pairs = gradient.by_materials(&pulled.friction);
                Ok::<_, GradientError>((pulled, pairs))
            })
        });
        let (pulled, pairs) = pulled.map_err(Raise::raise)?;
        let dict = PyDict::new(py);
        let (velocity, spin) = halves(py, &pulled.velocity)?;
        let (force, torque) = halves(py, &pulled.force)?;
        dict.set_item("velocities", velocity)?;
        dict.set_item("angular_velocities", spin)?;
        dict.set_item("forces", force)?;
        dict.set_item("torques", torque)?;
        let contacts = pulled.friction.len();
        dict.set_item("friction", owned(py, pulled.friction, &[contacts])?)?;
        let by_pair = PyDict::new(py);
        for (k, &sum) in pairs.iter().enumerate() {
            let (i, j) = (k / self.materials.len(), k % self.materials.len());
            if i <= j {
                by_pair.set_item((&self.materials[i], &self.materials[j]), sum)?;
            }
        }
        dict.set_item("pairs", by_pair)?;
        Ok(dict)
    }

    fn __repr__(&self) -> PyResult<String> {
        Ok(format!("<graintrain.StepGradient: {} contacts>", self.with(|gradient| gradient.contacts().len())))
    }
}

#[pymethods]
impl World {
    /// Derivatives of the step that would follow now, which is made on a copy: the world stays as it is.
    /// Raises NotDifferentiable at a kink, that is where a contact is about to slide, stick or part.
    fn gradient(&mut self, py: Python<'_>) -> PyResult<StepGradient> {
        // Looks at what was written into arrays, too.
        self.begin()?;
        let run = self.run();
        if run.begins_a_stage() {
            let what = "a stage of the scene begins with it; make the first step of the stage before";
            return Err(exception::NotDifferentiable::new_err(format!(
                "this step has no derivative: {what}"
            )));
        }
        if run.changes_bodies() {
            let what = "bodies may enter or leave with it (streams, outlets)";
            return Err(exception::NotDifferentiable::new_err(format!(
                "this step has no derivative: {what}"
            )));
        }
        let (state, stepping) = (&run.world, &run.settings.stepping);
        let gradient = py.detach(|| gradient::StepGradient::new(state, stepping)).map_err(Raise::raise)?;
        let materials = state.materials.names.clone();
        Ok(StepGradient { gradient: Mutex::new(gradient), materials })
    }
}
