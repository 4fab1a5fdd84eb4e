//! Columns of every table of a run, with units and meanings; `columns.json` says the same to programs.

pub use crate::column::Column;
use crate::column::column;
use crate::files::{OutputError, write_atomically};
use std::collections::BTreeMap;
use std::path::Path;

/// Columns of `steps.csv`.
pub const STEPS: &[Column] = &[
    column("step", "1", "number of the step, from 1"),
    column("time", "s", "at the end of the step"),
    column("contacts", "1", "contacts within the envelope, or closing within the step"),
    column("contacts_with_force", "1", "contacts whose normal impulse exceeds a millionth of the mean"),
    column("parts", "1", "connected parts of the contact graph, each solved by itself"),
    column("solver", "", "what solved the contact problem"),
    column("status", "", "converged, stalled, iteration-limit or infeasible"),
    column("iterations", "1", "iterations of the solver"),
    column("linear_iterations", "1", "iterations of its linear solver"),
    column("residual", "1", "residual of the worst contact in the friction model asked for"),
    column("residual_rms", "1", "its root mean square over the contacts"),
    column("residual_relaxed", "1", "residual of the worst contact, relaxed friction"),
    column("residual_coulomb", "1", "residual of the worst contact, exact friction"),
    column(
        "approach_max",
        "m/s",
        "largest velocity at which a contact still closes faster than its gap allows",
    ),
    column(
        "overlap_per_step",
        "1",
        "overlap that this makes within the step, over the size of the smaller body, at the worst contact",
    ),
    column(
        "cone_excess",
        "1",
        "largest excess of friction over mu times the normal force, relative to that contact's force",
    ),
    column("slip_angle", "rad", "largest angle between friction and the direction against the slip"),
    column("impacts", "1", "contacts that arrived with restitution"),
    column("impact_residual", "1", "the worst that a solve of theirs was left with"),
    column(
        "restitution_lowered",
        "1",
        "connected parts whose restitution was lowered, because it would have made energy",
    ),
    column("contacts_added", "1", "contacts that joined the problem after a solve"),
    column("contacts_missed", "1", "pairs of bodies that passed into or through each other in the step"),
    column("contacts_apart", "1", "contacts that pressed though their bodies were apart in the whole step"),
    column("impulse_apart", "N s", "the largest impulse of those"),
    column("penetration_max", "m", "deepest overlap at the end of the step"),
    column(
        "penetration_over_size",
        "1",
        "deepest overlap at the end of the step, each over the size of the smaller of its two bodies",
    ),
    column("overlap_corrected", "m", "largest overlap that displacements worked on in the step"),
    column("joint_opening", "m", "how far the joint that is open most is so at the end of the step"),
    column("correction_energy", "J", "energy that those displacements gave to bodies against gravity"),
    column("load_work", "J", "work of external forces and torques in the step, besides gravity"),
    column("joint_work", "J", "work of the motors, springs and dampers of joints in the step"),
    column("kinetic_energy", "J", "of the bodies that forces can move, at the end of the step"),
    column("seconds_collide", "s", "wall clock: finding contacts"),
    column("seconds_assemble", "s", "wall clock: building the contact problem"),
    column("seconds_solve", "s", "wall clock: solving it, and the impacts before it"),
    column("seconds_integrate", "s", "wall clock: moving the bodies, removing overlap"),
    column("seconds_output", "s", "wall clock: the outputs after the step before"),
    column(
        "newton_precompute_seconds",
        "s",
        "of an interior point: factorisations, preconditioners, trains; summed over the step",
    ),
    column("newton_apply_seconds", "s", "of an interior point: linear solves, summed over the step"),
    column(
        "newton_condition",
        "1",
        "largest estimate of the condition number of the Newton matrix in the step",
    ),
    column("rank_matrix", "1", "mean rank of the trains of the matrix, mean over the step"),
    column("rank_inverse", "1", "mean rank of the trains of its inverse, mean over the step"),
    column("compression_error", "1", "relative error of the train of the matrix, mean over the step"),
];

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
    let fixed =
        [("steps.csv", STEPS), ("wrench.csv", WRENCH), ("joints.csv", JOINTS), ("newton.csv", NEWTON)];
    let fixed = fixed.into_iter().map(|(name, columns)| (name.to_string(), columns.to_vec()));
    let tables: BTreeMap<String, Vec<Column>> = fixed.chain(measures.iter().cloned()).collect();
    let text = serde_json::to_string_pretty(&tables)
        .map_err(|error| OutputError::new("write", &path, error.into()))?;
    write_atomically(&path, format!("{text}\n").as_bytes())
}
