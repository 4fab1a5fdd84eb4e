//! Errors as Python exceptions, with the messages of the command line.

use graintrain::error::ModelError;
use graintrain::stepper::StepError;
use graintrain_ccp::CcpError;
use graintrain_io::checkpoint::CheckpointError;
use graintrain_io::files::OutputError;
use graintrain_io::problem_file::ProblemFileError;
use graintrain_io::run::RunError;
use graintrain_io::scene::SceneError;
use graintrain_tt::TtError;
use graintrain_view::render::RenderError;
use graintrain_view::view::ViewError;
use pyo3::PyErr;
use pyo3::exceptions::{PyOSError, PyValueError};

/// The package's own exceptions.
pub mod exception {
    use pyo3::create_exception;
    use pyo3::exceptions::{PyRuntimeError, PyValueError};

    create_exception!(
        graintrain,
        SceneError,
        PyValueError,
        "A scene that cannot be used; the message names the place and the remedy."
    );
    create_exception!(
        graintrain,
        ModelError,
        PyValueError,
        "A shape, material, body, motion, load or setting out of its range."
    );
    create_exception!(
        graintrain,
        StepError,
        PyRuntimeError,
        "A step that could not be made; the world is as it was before it."
    );
    create_exception!(
        graintrain,
        NotConverged,
        StepError,
        "A solve did not reach its tolerance, which strict=True forbids."
    );
    create_exception!(
        graintrain,
        ProblemError,
        PyValueError,
        "A contact problem that cannot be used, or a solver that cannot treat it."
    );
    create_exception!(
        graintrain,
        CheckpointError,
        PyValueError,
        "Bytes or a file that are no usable checkpoint."
    );
    create_exception!(graintrain, TrainError, PyValueError, "A tensor train that cannot be made.");
    create_exception!(
        graintrain,
        NotDifferentiable,
        PyValueError,
        "A step without a derivative: the message names the contact and says why."
    );
}

/// An error that has an exception.
pub trait Raise {
    /// The exception.
    fn raise(self) -> PyErr;
}

/// Results whose error is raised.
pub trait OrRaise<T> {
    /// The value, or the error as an exception.
    fn or_raise(self) -> Result<T, PyErr>;
}

impl<T, E: Raise> OrRaise<T> for Result<T, E> {
    fn or_raise(self) -> Result<T, PyErr> {
        self.map_err(Raise::raise)
    }
}

impl Raise for SceneError {
    fn raise(self) -> PyErr {
        let help = self.help().map_or(String::new(), |help| format!("; {help}"));
        exception::SceneError::new_err(format!("{self}{help}"))
    }
}

impl Raise for ModelError {
    fn raise(self) -> PyErr {
        exception::ModelError::new_err(self.to_string())
    }
}

impl Raise for StepError {
    fn raise(self) -> PyErr {
        match self {
            Self::Settings(error) => error.raise(),
            Self::Solver(error) => error.raise(),
            error => exception::StepError::new_err(error.to_string()),
        }
    }
}

impl Raise for RunError {
    fn raise(self) -> PyErr {
        match self {
            Self::Step(error) => error.raise(),
            Self::Output(error) => error.raise(),
            error => exception::NotConverged::new_err(error.to_string()),
        }
    }
}

impl Raise for CcpError {
    fn raise(self) -> PyErr {
        exception::ProblemError::new_err(self.to_string())
    }
}

impl Raise for ProblemFileError {
    fn raise(self) -> PyErr {
        let text = format!("{self}; {}", self.remedy());
        match self {
            Self::Io { .. } => PyOSError::new_err(text),
            _ => exception::ProblemError::new_err(text),
        }
    }
}

impl Raise for CheckpointError {
    fn raise(self) -> PyErr {
        match self {
            Self::Read { .. } => PyOSError::new_err(self.to_string()),
            error => exception::CheckpointError::new_err(error.to_string()),
        }
    }
}

impl Raise for OutputError {
    fn raise(self) -> PyErr {
        PyOSError::new_err(self.to_string())
    }
}

impl Raise for TtError {
    fn raise(self) -> PyErr {
        exception::TrainError::new_err(self.to_string())
    }
}

impl Raise for RenderError {
    fn raise(self) -> PyErr {
        PyValueError::new_err(self.to_string())
    }
}

impl Raise for ViewError {
    fn raise(self) -> PyErr {
        PyOSError::new_err(self.to_string())
    }
}
