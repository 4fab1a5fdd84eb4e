//! The extension module `graintrain._graintrain`: what Python sees of the crates. The package around it is in
//! `python/graintrain`, its documentation for users in the docstrings here and in
//! `python/graintrain/_graintrain.pyi`.
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

// Arguments by keyword, as Python has them.
#![allow(clippy::too_many_arguments)]
#![warn(clippy::too_many_lines)]

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
        ("NotConverged", py.get_type::<raised::NotConverged>()),
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
    module.add_function(wrap_pyfunction!(picture::replay, module)?)?;
    module.add_function(wrap_pyfunction!(problem::solvers, module)?)?;
    add_trains(module)?;
    module.add_class::<report::StepReport>()?;
    module.add_class::<report::SolveReport>()?;
    Ok(())
}

/// Tensor trains.
fn add_trains(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<train::TrainVector>()?;
    module.add_class::<train::TrainMatrix>()?;
    module.add_class::<train::ComplexVector>()?;
    module.add_class::<train::ComplexMatrix>()?;
    module.add_class::<train::sparse::QuadtreeMatrix>()?;
    module.add_class::<train::sparse::SymmetricTrain>()?;
    module.add_class::<train::sparse::Sketch>()?;
    module.add_class::<train::sparse::FullOperator>()?;
    module.add_class::<train::quantics::Grid>()?;
    module.add_class::<train::quantics::GridFunction>()?;
    module.add_class::<train::operator_sum::OperatorSum>()?;
    module.add_function(wrap_pyfunction!(train::cross::cross, module)?)?;
    module.add_function(wrap_pyfunction!(train::cross::cross_sparse, module)?)?;
    module.add_function(wrap_pyfunction!(train::cross::sub_grid, module)?)?;
    module.add_function(wrap_pyfunction!(train::cross::ends_of_modes, module)?)?;
    module.add_function(wrap_pyfunction!(train::cross::map, module)?)?;
    module.add_function(wrap_pyfunction!(train::cross::fit, module)?)?;
    module.add_function(wrap_pyfunction!(train::solve::solve_matrix, module)?)?;
    module.add_function(wrap_pyfunction!(train::solve::gmres, module)?)?;
    module.add_function(wrap_pyfunction!(train::solve::measured_residual, module)?)?;
    module.add_function(wrap_pyfunction!(train::solve::inverse, module)?)?;
    module.add_function(wrap_pyfunction!(train::solve::inverse_residual, module)?)?;
    module.add_function(wrap_pyfunction!(train::solve::newton_schulz, module)?)?;
    module.add_function(wrap_pyfunction!(train::solve::lowest_eigenpairs, module)?)?;
    module.add_function(wrap_pyfunction!(train::solve::evolve, module)?)?;
    module.add_function(wrap_pyfunction!(train::fourier::fourier, module)?)?;
    module.add_function(wrap_pyfunction!(train::fourier::convolution, module)?)?;
    module.add_function(wrap_pyfunction!(train::fourier::maxvol, module)?)?;
    module.add_function(wrap_pyfunction!(train::fourier::read_sdv, module)?)?;
    module.add_function(wrap_pyfunction!(train::fourier::write_sdv, module)?)?;
    module.add_function(wrap_pyfunction!(train::fourier::read_mat, module)?)?;
    module.add_function(wrap_pyfunction!(train::operator_sum::local_operator, module)?)?;
    add_quantized(module)
}

/// Quantized trains with known ranks.
fn add_quantized(module: &Bound<'_, PyModule>) -> PyResult<()> {
    use train::qtt;
    module.add_function(wrap_pyfunction!(qtt::tridiagonal, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::laplacian, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::laplacian_with, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::shift, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::periodic_shift, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::cumulative_sum, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::hilbert_matrix, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::circulant, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::toeplitz, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::interleave, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::kronecker_sum, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::exponential, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::sine, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::polynomial, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::ramp, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::step, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::hilbert, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::digits, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::index, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::morton, module)?)?;
    module.add_function(wrap_pyfunction!(qtt::morton_coordinates, module)?)?;
    Ok(())
}
