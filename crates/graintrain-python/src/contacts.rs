//! The contacts of a step.

use crate::arrays::{field, owned};
use graintrain::contact::{Contact, ContactSet};
use pyo3::prelude::*;

/// The contacts of the last step: a snapshot that later steps leave alone. Arrays have one row per contact,
/// in an order that does not depend on threads; they are read-only.
#[pyclass(frozen, module = "graintrain")]
pub struct Contacts {
    set: ContactSet,
}

impl Contacts {
    /// The snapshot of a set.
    pub fn new(set: ContactSet) -> Self {
        Self { set }
    }
}

fn points<'py>(slf: &Bound<'py, Contacts>, first: fn(&Contact) -> &f64) -> PyResult<Bound<'py, PyAny>> {
    field(slf.clone().into_any(), &slf.get().set.contacts, first, 3)
}

#[pymethods]
impl Contacts {
    fn __len__(&self) -> usize {
        self.set.contacts.len()
    }

    fn __repr__(&self) -> String {
        format!("<graintrain.Contacts: {}>", self.set.contacts.len())
    }

    /// Indices of the bodies A and B, shape (n, 2).
    #[getter]
    fn bodies<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let pairs = self.set.contacts.iter().flat_map(|contact| [contact.body_a, contact.body_b]);
        Ok(owned(py, pairs.collect(), &[self.set.contacts.len(), 2])?.into_any())
    }

    /// Contact points, midway between the surfaces, m, shape (n, 3).
    #[getter]
    fn points<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        points(slf, |contact| &contact.point.x)
    }

    /// Unit normals from B to A, shape (n, 3).
    #[getter]
    fn normals<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        points(slf, |contact| &contact.normal.x)
    }

    /// Signed distances at the start of the step, m; negative where bodies overlap.
    #[getter]
    fn gaps<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        field(slf.clone().into_any(), &slf.get().set.contacts, |contact| &contact.gap, 0)
    }

    /// Impulses on A (minus those on B) in world axes, N s, shape (n, 3); divided by the time step they are
    /// forces.
    #[getter]
    fn impulses<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        field(slf.clone().into_any(), &slf.get().set.impulse, |impulse| &impulse.x, 3)
    }

    /// Moment impulses of rolling and spinning friction on A (minus those on B) in world axes, N m s, shape
    /// (n, 3).
    #[getter]
    fn moments<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let count = self.set.contacts.len();
        let mut moments: Vec<f64> = self.set.moment.iter().flat_map(|moment| moment.to_array()).collect();
        // Where nothing resists turning there is no list.
        moments.resize(3 * count, 0.0);
        Ok(owned(py, moments, &[count, 3])?.into_any())
    }

    /// Coefficients of friction.
    #[getter]
    fn friction<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        field(slf.clone().into_any(), &slf.get().set.friction, |friction| friction, 0)
    }

    /// Numbers that stay the same from step to step while a contact lasts (uint64).
    #[getter]
    fn identities<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        field(slf.clone().into_any(), &slf.get().set.contacts, |contact| &contact.identity, 0)
    }
}
