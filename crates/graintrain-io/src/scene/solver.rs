//! The table `[solver]`: how scenes write the choice of a solver.

use super::error::SceneError;
use super::reader::Reader;
use graintrain::stepper::SolverChoice;
use graintrain_ccp::{CcpError, Criterion, FrictionModel, SolverSpec};
use serde::{Serialize, Serializer};

/// Reads the table; what it does not name is the default of [`SolverChoice`].
pub(super) fn read(reader: Option<Reader>) -> Result<SolverChoice, SceneError> {
    let mut choice = SolverChoice::default();
    if let Some(reader) = reader {
        if let Some(name) = reader.text("name")? {
            choice.name = name.parse().map_err(|error| unknown(&reader, &name, error))?;
        }
        choice.tolerance = reader.quantity("tolerance")?.unwrap_or(choice.tolerance);
        choice.criterion = match reader.flag("strict_max")? {
            Some(true) => Criterion::Maximum,
            Some(false) => Criterion::Mixed,
            None => choice.criterion,
        };
        choice.max_iterations = reader.count("max_iterations")?.map(|count| count as usize);
        choice.friction = reader.choice("friction", FrictionModel::NAMES)?.unwrap_or(choice.friction);
    }
    Ok(choice)
}

fn unknown(reader: &Reader, name: &str, error: CcpError) -> SceneError {
    match error {
        CcpError::UnknownSolver { known, .. } => {
            reader.unknown_name("name", "solver", name, known.split(", "))
        }
        other => reader.out_of_range("name", "a solver", other),
    }
}

/// The choice with the keys of the table.
pub(super) fn as_written<S: Serializer>(choice: &SolverChoice, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Form {
        name: SolverSpec,
        tolerance: f64,
        strict_max: bool,
        #[serde(skip_serializing_if = "Option::is_none")]
        max_iterations: Option<usize>,
        friction: FrictionModel,
    }
    let SolverChoice { name, tolerance, criterion, max_iterations, friction } = *choice;
    Form { name, tolerance, strict_max: criterion == Criterion::Maximum, max_iterations, friction }
        .serialize(serializer)
}
