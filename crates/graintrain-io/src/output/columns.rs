//! Columns of every table of a run, with units and meanings; `columns.json` says the same to programs.

pub use crate::column::Column;
use crate::column::column;
use crate::files::{OutputError, write_atomically};
use crate::quantity::QUANTITIES;
use std::collections::BTreeMap;
use std::path::Path;

/// Columns of `steps.csv`.
pub fn steps() -> Vec<Column> {
    let of_step =
        [column("step", "1", "number of the step, from 1"), column("time", "s", "at the end of the step")];
    let output = column("seconds_output", "s", "wall clock: the outputs after the step before");
    of_step.into_iter().chain(QUANTITIES.iter().map(|quantity| quantity.column)).chain([output]).collect()
}

/// Columns of `wrench.csv`.
pub const WRENCH: &[Column] = &[
    column("step", "1", "number of the step, from 1"),
    column("time", "s", "at the end of the step"),
    column("body", "1", "number of the body, from 0"),
    column("name", "", "its name"),
    column("force_x", "N", "force by contacts on the body, mean over the step"),
    column("force_y", "N", "force by contacts on the body, mean over the step"),
    column("force_z", "N", "force by contacts on the body, mean over the step"),
    column("torque_x", "N m", "torque by contacts about the body's centre, mean over the step"),
    column("torque_y", "N m", "torque by contacts about the body's centre, mean over the step"),
    column("torque_z", "N m", "torque by contacts about the body's centre, mean over the step"),
    column("x", "m", "place of the body's centre at the end of the step"),
    column("y", "m", "place of the body's centre at the end of the step"),
    column("z", "m", "place of the body's centre at the end of the step"),
    column("velocity_x", "m/s", "velocity of the body's centre at the end of the step"),
    column("velocity_y", "m/s", "velocity of the body's centre at the end of the step"),
    column("velocity_z", "m/s", "velocity of the body's centre at the end of the step"),
];

/// Columns of `joints.csv`.
pub const JOINTS: &[Column] = &[
    column("step", "1", "number of the step, from 1"),
    column("time", "s", "at the end of the step"),
    column("joint", "1", "number of the joint, from 0"),
    column("name", "", "its name"),
    column(
        "coordinate",
        "m or rad",
        "angle, slide or distance at the end of the step; of a gear that of its second joint less ratio times the first",
    ),
    column("rate", "m/s or rad/s", "its rate in the step"),
    column(
        "drive",
        "N or N m",
        "force of motor, spring and stops along it; of a gear that on its second joint",
    ),
    column(
        "opening",
        "m",
        "how far what it holds is apart at the end of the step, angles times the joint's length",
    ),
    column("force_x", "N", "force on body B at the joint, mean over the step"),
    column("force_y", "N", "force on body B at the joint, mean over the step"),
    column("force_z", "N", "force on body B at the joint, mean over the step"),
    column("torque_x", "N m", "torque on body B about the joint's point on it, mean over the step"),
    column("torque_y", "N m", "torque on body B about the joint's point on it, mean over the step"),
    column("torque_z", "N m", "torque on body B about the joint's point on it, mean over the step"),
];

/// Columns of `newton.csv` that every linear solver has.
const NEWTON_FIXED: usize = 10;

/// Columns of `newton.csv`.
pub const NEWTON: &[Column] = &[
    column("step", "1", "number of the step, from 1"),
    column(
        "iteration",
        "1",
        "Newton iteration of the step, from 0; repeated where its linear system was solved again with a finer tolerance",
    ),
    column("inner_iterations", "1", "iterations of the linear solver"),
    column("residual", "1", "residual of the contact problem before the iteration"),
    column("step_length", "1", "share of the Newton step that was taken"),
    column("linear_residual", "1", "relative residual of the linear system"),
    column("linear_converged", "", "whether it reached its tolerance"),
    column("condition", "1", "estimate of the condition number of the Newton matrix, from below"),
    column("precompute_seconds", "s", "factorisation, preconditioner or train"),
    column("apply_seconds", "s", "linear solves"),
    column("rank_matrix", "1", "mean rank of the train of the matrix"),
    column("rank_inverse", "1", "mean rank of the train of its inverse"),
    column(
        "compression_error",
        "1",
        "relative error of the train, over all entries (exact compression) or sampled on the nonzeros (cross)",
    ),
    column("inversion_residual", "1", "relative residual of A X = I"),
    column("compression_seconds", "s", "making the train of the matrix"),
    column("inversion_seconds", "s", "making the train of its inverse"),
    column("train_captured_energy", "1", "of `tt`: result of its probe"),
    column("train_active", "", "of `tt`: 1 where a train was used"),
    column("slots", "1", "places of the index tree"),
    column("slots_kept", "1", "contacts that kept theirs from the step before"),
    column("factor_entries", "1", "entries of the Cholesky factor"),
    column(
        "in_body_space",
        "",
        "of `cholesky` and `ic`: 1 where the answer comes from body space, 0 where from contact space",
    ),
    column("barrier", "1", "of `pdip`: 1/tau"),
    column(
        "step_to_cone",
        "1",
        "of `pdip`: step at which the first impulse would leave its cone, at most 10",
    ),
];

/// Columns of `newton.csv` that a solver may leave empty.
pub fn newton_figures() -> &'static [Column] {
    &NEWTON[NEWTON_FIXED..]
}

/// The header line of a table.
pub fn header(columns: &[Column]) -> String {
    columns.iter().map(|column| column.name).collect::<Vec<_>>().join(",")
}

/// Writes `columns.json` into the folder: per table the list of its columns in order, each with `name`,
/// `unit` and `meaning`; `measures` are the names and columns of the measurements.
///
/// # Errors
/// Where the file cannot be written.
pub fn write(folder: &Path, measures: &[(String, Vec<Column>)]) -> Result<(), OutputError> {
    let path = folder.join("columns.json");
    let steps = steps();
    let fixed =
        [("steps.csv", &*steps), ("wrench.csv", WRENCH), ("joints.csv", JOINTS), ("newton.csv", NEWTON)];
    let fixed = fixed.into_iter().map(|(name, columns)| (name.to_string(), columns.to_vec()));
    let tables: BTreeMap<String, Vec<Column>> = fixed.chain(measures.iter().cloned()).collect();
    let text = serde_json::to_string_pretty(&tables)
        .map_err(|error| OutputError::new("write", &path, error.into()))?;
    write_atomically(&path, format!("{text}\n").as_bytes())
}
