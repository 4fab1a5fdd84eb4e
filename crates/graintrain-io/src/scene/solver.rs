//! The table `[solver]`: how scenes write the choice of a solver.

use super::error::SceneError;
use super::reader::Reader;
use super::table::{Choice, table};
use graintrain::stepper::SolverChoice;
use graintrain_ccp::{CcpError, Criterion, FrictionModel, SolverSpec};
use serde::{Serialize, Serializer};

table! {
    /// The keys of a [`SolverChoice`].
    pub(super) struct SolverKeys: "`[solver]`" {
        /// Solver, optionally with its linear solver after a `+`
        name: SolverSpec = Text, "\"auto\"", "\"apgd\"" => name;
        /// Residual at which it stops: its root mean square, with 20 times that for the worst contact. 1e-4:
        /// the root mean square velocity error at contacts is 1e-4 of gravity times step. A value above 1e-2
        /// has no effect
        tolerance: f64 = Quantity(D::NONE), "1e-4", "1e-5", Positive;
        /// Whether the tolerance applies to the worst contact
        strict_max: bool = Flag, "false", "true";
        /// Limit of iterations of a connected part of the contacts in a step, in iterations of projected
        /// gradients (default below 1 024 contacts: up to 30 000). If the limit is reached, the
        /// step uses the best impulses and counts as not converged. If these are far from a solution and no
        /// limit is given, convex problems are solved in addition, so that no bodies approach. Relaxed
        /// solves, and methods that count other iterations, have their own limits
        max_iterations: Option<usize> = Count, "12000, more for few contacts", "2000", Positive;
        /// coulomb (exact) or relaxed (cone complementarity, the paper's model: a sliding contact separates
        /// by mu times its slip)
        friction: FrictionModel = Text, "\"coulomb\"", "\"relaxed\"";
    }
}

impl Choice for FrictionModel {
    const NAMES: &'static [(&'static str, Self)] = FrictionModel::NAMES;
}

fn name(reader: &Reader, key: &str) -> Result<SolverSpec, SceneError> {
    let name: String = reader.field(key)?;
    name.parse().map_err(|error| match error {
        CcpError::UnknownSolver { known, .. } => reader.unknown_name(key, "solver", &name, known.split(", ")),
        other => reader.out_of_range(key, "a solver", other),
    })
}

impl From<SolverKeys> for SolverChoice {
    fn from(SolverKeys { name, tolerance, strict_max, max_iterations, friction }: SolverKeys) -> Self {
        let criterion = if strict_max { Criterion::Maximum } else { Criterion::Mixed };
        Self { name, tolerance, criterion, max_iterations, friction }
    }
}

/// The choice with the keys of the table.
pub(super) fn as_written<S: Serializer>(choice: &SolverChoice, serializer: S) -> Result<S::Ok, S::Error> {
    let SolverChoice { name, tolerance, criterion, max_iterations, friction } = *choice;
    let strict_max = criterion == Criterion::Maximum;
    SolverKeys { name, tolerance, strict_max, max_iterations, friction }.serialize(serializer)
}
