//! The extension module `graintrain._graintrain`: what Python sees of the crates. The package around it is in `python/graintrain`, its
//! documentation for users in the docstrings here and in `python/graintrain/_graintrain.pyi`.
//!
//! | module | holds |
//! |---|---|
//! | `error`, `arrays`, `plain` | exceptions; NumPy arrays, also without copying; settings and reports as dicts |
//! | `model`, `building` | shapes, motions, functions of time; bodies, materials, loads of worlds made in code |
//! | `world`, `contacts`, `report` | the world and its steps |
//! | `batch` | many worlds side by side |
//! | `problem` | contact problems and solvers |
//! | `gradient` | derivatives of a step |
//! | `measure` | coordination, fabric, porosity, forces |
//! | `picture` | pictures and replays |
//! | `train` | tensor trains |

mod arrays;
mod batch;
mod building;
mod contacts;
mod error;
mod gradient;
mod joint;
mod measure;
mod model;
mod picture;
mod plain;
mod problem;
mod report;
mod train;
mod world;

use pyo3::prelude::*;
use std::ffi::OsString;
use std::process::ExitCode;

/// Carries out a command line (the words after the program's name) and returns the exit code.
#[pyfunction]
fn command_line(py: Python<'_>, words: Vec<OsString>) -> u8 {
    let words = std::iter::once(OsString::from("graintrain")).chain(words);
    let code = py.detach(|| graintrain_cli::run(words));
    (0..=u8::MAX).find(|&number| ExitCode::from(number) == code).unwrap_or(1)
}

#[pymodule]
fn _graintrain(module: &Bound<'_, PyModule>) -> PyResult<()> {
    use error::exception as raised;
    let py = module.py();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(command_line, module)?)?;
    for (name, class) in [
        ("SceneError", py.get_type::<raised::SceneError>()),
        ("ModelError", py.get_type::<raised::ModelError>()),
        ("StepError", py.get_type::<raised::StepError>()),
        ("ToleranceMissed", py.get_type::<raised::ToleranceMissed>()),
        ("ProblemError", py.get_type::<raised::ProblemError>()),
        ("CheckpointError", py.get_type::<raised::CheckpointError>()),
        ("TrainError", py.get_type::<raised::TrainError>()),
        ("NotDifferentiable", py.get_type::<raised::NotDifferentiable>()),
    ] {
        module.add(name, class)?;
    }
    module.add_class::<world::World>()?;
    module.add_class::<model::Shape>()?;
    module.add_class::<model::Function>()?;
    module.add_class::<model::Motion>()?;
    module.add_class::<contacts::Contacts>()?;
    module.add_class::<batch::Batch>()?;
    module.add_class::<gradient::StepGradient>()?;
    module.add_class::<picture::Picture>()?;
    module.add_class::<problem::Problem>()?;
    module.add_class::<train::TrainVector>()?;
    module.add_class::<train::TrainMatrix>()?;
    module.add_function(wrap_pyfunction!(picture::replay, module)?)?;
    module.add_function(wrap_pyfunction!(problem::solvers, module)?)?;
    module.add_function(wrap_pyfunction!(train::cross, module)?)?;
    module.add_class::<report::StepReport>()?;
    module.add_class::<report::SolveReport>()?;
    Ok(())
}
