//! Many worlds side by side.

use crate::error::OrRaise;
use crate::report::StepReport;
use crate::world::{Advance, World, interruptible};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Worlds that are stepped side by side over the cores, each on its own: with the same bits as alone.
#[pyclass(module = "graintrain", frozen)]
pub struct Batch {
    worlds: Vec<Py<World>>,
}

#[pymethods]
impl Batch {
    /// Of these worlds; each may be there once.
    #[new]
    fn new(worlds: Vec<Py<World>>) -> PyResult<Self> {
        let mut places: Vec<usize> = worlds.iter().map(|world| world.as_ptr() as usize).collect();
        places.sort_unstable();
        if places.windows(2).any(|pair| pair[0] == pair[1]) {
            return Err(PyValueError::new_err("a world is in the batch twice; take world.copy()"));
        }
        Ok(Self { worlds })
    }

    /// The worlds.
    #[getter]
    fn worlds(&self, py: Python<'_>) -> Vec<Py<World>> {
        self.worlds.iter().map(|world| world.clone_ref(py)).collect()
    }

    fn __len__(&self) -> usize {
        self.worlds.len()
    }

    /// Steps every world until a time, for a number of steps, or to its scene's end, as World.run does, and
    /// returns the reports of their last steps. Where worlds fail, the others are stepped all the same; then
    /// the error of the first one is raised, with a note that names its place. Ctrl-C leaves every world
    /// after its last complete step.
    #[pyo3(signature = (until=None, *, steps=None, strict=false))]
    fn run(
        &self,
        py: Python<'_>,
        until: Option<&Bound<'_, PyAny>>,
        steps: Option<u64>,
        strict: bool,
    ) -> PyResult<Vec<Option<StepReport>>> {
        let mut held =
            self.worlds.iter().map(|world| world.try_borrow_mut(py)).collect::<Result<Vec<_>, _>>()?;
        let stops: Vec<_> = held.iter().map(|world| world.stop()).collect();
        let mut tasks = Vec::with_capacity(held.len());
        for world in &mut held {
            let target = world.target(until, steps)?;
            tasks.push((world.begin()?, target));
        }
        let step = |(advance, target): &mut (Advance<'_>, u64)| advance.to(*target, strict);
        let outcomes = interruptible(py, &stops, || tasks.par_iter_mut().map(step).collect::<Vec<_>>())?;
        for (index, outcome) in outcomes.into_iter().enumerate() {
            if let Err(error) = outcome.or_raise() {
                error.value(py).call_method1("add_note", (format!("in worlds[{index}]"),)).ok();
                return Err(error);
            }
        }
        Ok(held.iter().map(|world| world.report()).collect())
    }

    fn __repr__(&self) -> String {
        format!("<graintrain.Batch: {} worlds>", self.worlds.len())
    }
}
