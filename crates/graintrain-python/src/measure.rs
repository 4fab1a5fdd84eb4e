//! Numbers of a sample: what the last step's contacts and the state tell.

use crate::arrays::{owned, vector};
use crate::world::World;
use graintrain::load::Region;
use graintrain::measure::{contacts, space};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The box between two corners, or none.
fn region(low: Option<&Bound<'_, PyAny>>, high: Option<&Bound<'_, PyAny>>) -> PyResult<Option<Region>> {
    let (low, high) = match (low, high) {
        (None, None) => return Ok(None),
        (Some(low), Some(high)) => (low, high),
        _ => return Err(PyValueError::new_err("give both low and high, or neither")),
    };
    let (min, max) = (vector("low", low)?, vector("high", high)?);
    if !max.cmpgt(min).all() {
        return Err(PyValueError::new_err(format!("the box from {min} to {max} is empty")));
    }
    Ok(Some(Region::Box { min, max }))
}

#[pymethods]
impl World {
    /// Coordination of the bodies whose centres lie in the box (all, without one), as a dict: bodies,
    /// contacts, mean, rattlers, mean_without_rattlers, sliding (share of the loaded contacts),
    /// hyperstaticity. Rattlers have fewer neighbours than `rattlers_below`.
    #[pyo3(signature = (low=None, high=None, *, rattlers_below=2))]
    fn coordination<'py>(
        &mut self,
        py: Python<'py>,
        low: Option<&Bound<'py, PyAny>>,
        high: Option<&Bound<'py, PyAny>>,
        rattlers_below: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let region = region(low, high)?;
        let world = self.state();
        let found =
            contacts::coordination(world, &space::selected(world, None, region.as_ref()), rattlers_below);
        let dict = PyDict::new(py);
        dict.set_item("bodies", found.bodies)?;
        dict.set_item("contacts", found.contacts)?;
        dict.set_item("mean", found.mean)?;
        dict.set_item("rattlers", found.rattlers)?;
        dict.set_item("mean_without_rattlers", found.mean_without_rattlers)?;
        dict.set_item("sliding", found.sliding)?;
        dict.set_item("hyperstaticity", found.hyperstaticity)?;
        Ok(dict.into_any())
    }

    /// The fabric tensor (3, 3): mean of n n^T over the loaded contacts of the bodies in the box; nan where
    /// there are none.
    #[pyo3(signature = (low=None, high=None))]
    fn fabric<'py>(
        &mut self,
        py: Python<'py>,
        low: Option<&Bound<'py, PyAny>>,
        high: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let region = region(low, high)?;
        let world = self.state();
        let found = contacts::fabric(world, &space::selected(world, None, region.as_ref()));
        Ok(owned(py, found.transpose().to_cols_array().to_vec(), &[3, 3])?.into_any())
    }

    /// Normal forces of the loaded contacts of the bodies in the box, N, in the order of the contacts.
    #[pyo3(signature = (low=None, high=None))]
    fn normal_forces<'py>(
        &mut self,
        py: Python<'py>,
        low: Option<&Bound<'py, PyAny>>,
        high: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let region = region(low, high)?;
        let step = self.run().settings.stepping.step;
        let world = self.state();
        let found = contacts::normal_forces(world, step, &space::selected(world, None, region.as_ref()));
        let count = found.len();
        Ok(owned(py, found, &[count])?.into_any())
    }

    /// Share of a box that no body which can move fills.
    fn porosity(&mut self, low: &Bound<'_, PyAny>, high: &Bound<'_, PyAny>) -> PyResult<f64> {
        let region = region(Some(low), Some(high))?;
        Ok(region.map_or(f64::NAN, |region| space::porosity(self.state(), &region)))
    }
}
