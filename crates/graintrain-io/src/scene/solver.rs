//! The table `[solver]`: how scenes write the choice of a solver.

use super::error::SceneError;
use super::reader::Reader;
use super::table::table;
use graintrain::stepper::SolverChoice;
use graintrain_ccp::{CcpError, Criterion, FrictionModel, SolverSpec};
use serde::{Serialize, Serializer};

table! {
    pub(super) static SOLVER: "`[solver]`" {
        /// Solver, optionally with its linear solver after a `+`
        name = Text, "\"auto\"", "\"apgd\"";
        /// Residual at which it stops: its root mean square, with 20 times that for the worst contact. 1e-4:
        /// the root mean square velocity error at contacts is 1e-4 of gravity times step. A value above 1e-2
        /// has no effect
        tolerance = Quantity(D::NONE), "1e-4", "1e-5", Positive;
        /// Whether the tolerance applies to the worst contact
        strict_max = Flag, "false", "true";
        /// Limit of iterations of a connected part of the contacts in a step, in iterations of projected
        /// gradients (default below 1 024 contacts: up to five times as many). If the limit is reached, the
        /// step uses the best impulses and counts as not converged. If these are far from a solution and no
        /// limit is given, convex problems are solved in addition, so that no bodies approach. Relaxed
        /// solves, and methods that count other iterations, have their own limits
        max_iterations = Count, "6000, more for few contacts", "2000", Positive;
        /// coulomb (exact) or relaxed (cone complementarity, the paper's model: a sliding contact separates
        /// by mu times its slip)
        friction = Text, "\"coulomb\"", "\"relaxed\"" in FrictionModel::NAMES;
    }
}

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
