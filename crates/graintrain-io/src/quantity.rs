//! The numbers of a step: one table from which everything else that has them is made.
//!
//! An entry is a column of `steps.csv` (name, unit, meaning, its value in a [`StepReport`]) and the figures
//! that a run makes of it, each with the way it is reduced over the steps. Of it are made [`QUANTITIES`]
//! (columns of `steps.csv`, attributes of `StepReport` in Python, docs/output.md) and [`Figures`] (totals of
//! a run, keys of `summary.json`, observables of a sweep, docs/output.md). A new quantity is one entry.

use crate::column::{Column, column};
use graintrain::stepper::StepReport;
use graintrain_ccp::newton::NewtonRecord;
use graintrain_ccp::solver::Status;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A number of a step.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// How many.
    Count(u64),
    /// How much, SI.
    Real(f64),
    /// A name.
    Text(String),
    /// Not there in this step.
    Absent,
}

/// As a field of a CSV table: names in quotes where they hold a comma, quote or line break.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(count) => write!(f, "{count}"),
            Self::Real(real) => write!(f, "{real:?}"),
            Self::Text(text) if text.contains([',', '"', '\n', '\r']) => {
                write!(f, "\"{}\"", text.replace('"', "\"\""))
            }
            Self::Text(text) => f.write_str(text),
            Self::Absent => Ok(()),
        }
    }
}

impl From<u64> for Value {
    fn from(count: u64) -> Self {
        Self::Count(count)
    }
}

impl From<f64> for Value {
    fn from(real: f64) -> Self {
        Self::Real(real)
    }
}

impl From<Option<f64>> for Value {
    fn from(real: Option<f64>) -> Self {
        real.map_or(Self::Absent, Self::Real)
    }
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Text(text.to_string())
    }
}

impl From<Status> for Value {
    fn from(status: Status) -> Self {
        Self::Text(status.name().to_string())
    }
}

/// A number that steps report.
pub struct Quantity {
    /// Name, unit, meaning.
    pub column: Column,
    /// Its value in a step.
    pub value: fn(&StepReport) -> Value,
}

/// What figures are, before the meaning of the quantity that they are made of.
macro_rules! reduced {
    (mean) => {
        "mean over the steps: "
    };
    (max) => {
        "largest of the steps: "
    };
    (last) => {
        "last step: "
    };
    (sum) => {
        "sum over the steps: "
    };
    (first) => {
        "first step, from 1, where it is not zero: "
    };
}

macro_rules! figure_meaning {
    (unconverged, $meaning:literal) => {
        "steps whose solve did not reach the tolerance"
    };
    ($how:ident, $meaning:literal) => {
        concat!(reduced!($how), $meaning)
    };
}

macro_rules! quantities {
    ($($name:ident: $unit:literal, $meaning:literal, |$report:ident| $value:expr;
       $($figure:ident: $type:ty = $how:ident),*;)*) => {
        /// All quantities, in the order of `steps.csv`.
        pub const QUANTITIES: &[Quantity] = &[$(Quantity {
            column: column(stringify!($name), $unit, $meaning),
            value: |$report| Value::from($value),
        }),*];

        /// Name, unit and meaning of the [`Figures`], in their order.
        pub const FIGURES: &[Column] = &[$($(
            column(stringify!($figure), figure_unit!($how, $unit), figure_meaning!($how, $meaning)),
        )*)*];

        /// What the steps of a run come to, in figures.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        pub struct Figures {
            $($(#[doc = concat!(figure_meaning!($how, $meaning), " (", figure_unit!($how, $unit), ")")]
            pub $figure: $type,)*)*
        }

        impl Figures {
            /// Adds a step, the `step`th of the run.
            pub fn add(&mut self, step: u64, report: &StepReport) {
                $($({
                    let $report = report;
                    $how(&mut self.$figure, $value, step);
                })*)*
            }
        }
    };
}

/// Counts of steps have no unit.
macro_rules! figure_unit {
    (first, $unit:literal) => {
        "1"
    };
    (unconverged, $unit:literal) => {
        "1"
    };
    ($how:ident, $unit:literal) => {
        $unit
    };
}

quantities! {
    contacts: "1", "contacts within the envelope, or closing within the step", |r| r.contacts as u64;
        contacts_mean: f64 = mean, contacts_max: u64 = max, contacts_final: u64 = last;
    contacts_with_force: "1", "contacts whose normal impulse exceeds a millionth of the mean", |r| r.contacts_with_force as u64;
        contacts_with_force_sum: u64 = sum;
    parts: "1", "connected parts of the contact graph, each solved by itself", |r| r.parts as u64;
        parts_max: u64 = max;
    solver: "", "what solved the contact problem", |r| r.solve.solver.as_str(); ;
    status: "", "converged, stalled, iteration-limit or infeasible", |r| r.solve.status;
        unconverged_steps: u64 = unconverged;
    iterations: "1", "iterations of the solver", |r| r.solve.iterations as u64; ;
    linear_iterations: "1", "iterations of the solver's linear solver", |r| r.solve.linear_iterations as u64; ;
    residual: "1", "residual of the worst contact in the friction model asked for", |r| r.solve.residual.max;
        residual_max: f64 = max, residual_final: f64 = last;
    residual_rms: "1", "root mean square of the residual over the contacts", |r| r.solve.residual.rms;
        residual_rms_max: f64 = max;
    residual_relaxed: "1", "residual of the worst contact, relaxed friction", |r| r.solve.residual_relaxed.max; ;
    residual_coulomb: "1", "residual of the worst contact, exact friction", |r| r.solve.residual_coulomb.max; ;
    approach_max: "m/s", "largest velocity at which a contact still closes faster than its gap allows", |r| r.errors.approach_max;
        velocity_error_max: f64 = max;
    overlap_per_step: "1", "overlap that such an approach makes within the step, over the size of the smaller body, at the worst contact", |r| r.errors.overlap_per_step_max_over_size;
        overlap_per_step_max_over_radius: f64 = max;
    cone_excess: "1", "largest excess of friction over mu times the normal force, relative to that contact's force", |r| r.errors.cone_excess_max;
        friction_error_max: f64 = max;
    slip_angle: "rad", "largest angle between friction and the direction against the slip, where contacts slide faster than the tolerance resolves", |r| r.errors.slip_angle_max;
        slip_angle_max: f64 = max;
    impacts: "1", "contacts that closed in an impact", |r| r.impacts as u64;
        impacts: u64 = sum;
    impact_residual: "1", "worst residual of a solve of impacts; above the tolerance the step counts as not converged", |r| r.impact_residual.max;
        impact_residual_max: f64 = max;
    restitution_lowered: "1", "connected parts whose restitution was lowered, because it would have made energy, and contacts that still closed after the last pass", |r| r.restitution_lowered as u64;
        restitution_lowered: u64 = sum;
    contacts_added: "1", "contacts that joined the problem after a solve, or were linearised again", |r| r.contacts_added as u64;
        contacts_added_after_solve: u64 = sum;
    contacts_missed: "1", "pairs of bodies that passed into or through each other without a contact", |r| r.contacts_missed as u64;
        contacts_missed: u64 = sum, contacts_missed_first_step: Option<u64> = first;
    contacts_apart: "1", "contacts with force, impacts aside, whose bodies stayed a twentieth of the smaller size apart", |r| r.contacts_apart as u64;
        contacts_apart: u64 = sum;
    impulse_apart: "N s", "largest impulse of a contact apart", |r| r.impulse_apart_max;
        impulse_apart_max: f64 = max;
    penetration_max: "m", "deepest overlap at the end of the step", |r| r.penetration_max; ;
    penetration_over_size: "1", "deepest overlap at the end of the step over the size of the smaller body", |r| r.penetration_max_over_size;
        penetration_max_over_radius: f64 = max, penetration_final_over_radius: f64 = last;
    overlap_corrected: "m", "largest overlap that displacements worked on", |r| r.overlap_corrected_max;
        overlap_corrected_max: f64 = max;
    joint_opening: "m", "largest opening of a joint, or way that its motor missed", |r| r.errors.joint_opening_max;
        joint_opening_max: f64 = max;
    momentum_lost: "1", "largest share of its angular momentum that a body beyond 1 rad per step changed by without a torque", |r| r.errors.momentum_lost_max;
        momentum_lost: f64 = sum;
    correction_energy: "J", "energy that displacements against overlap gave to bodies against gravity", |r| r.correction_energy;
        correction_energy: f64 = sum;
    load_work: "J", "work of external forces and torques besides gravity, dt f (u + u+) / 2", |r| r.ledger.loads;
        load_work: f64 = sum;
    joint_work: "J", "work of the motors, springs, dampers and stops of joints", |r| r.ledger.joints;
        joint_work: f64 = sum;
    kinetic_energy: "J", "of the bodies that forces can move, at the end of the step", |r| r.kinetic_energy; ;
    seconds_collide: "s", "wall clock: finding contacts", |r| r.phases.collide; ;
    seconds_assemble: "s", "wall clock: building the contact problem", |r| r.phases.assemble; ;
    seconds_solve: "s", "wall clock: solving the contact problem, and the impacts before it", |r| r.phases.solve; ;
    seconds_integrate: "s", "wall clock: moving the bodies, removing overlap", |r| r.phases.integrate; ;
    newton_precompute_seconds: "s", "of an interior point: factorisations, preconditioners, trains; summed over the step", |r| newton_sum(r, |record| record.precompute_seconds); ;
    newton_apply_seconds: "s", "of an interior point: linear solves, summed over the step", |r| newton_sum(r, |record| record.apply_seconds); ;
    newton_condition: "1", "largest estimate of the condition number of the Newton matrix in the step", |r| newton(r).map(|records| records.iter().map(|record| record.condition).fold(0.0, f64::max)); ;
    rank_matrix: "1", "mean rank of the trains of the matrix, mean over the step", |r| newton_mean(r, "rank_matrix"); ;
    rank_inverse: "1", "mean rank of the trains of the inverse, mean over the step", |r| newton_mean(r, "rank_inverse"); ;
    compression_error: "1", "relative error of the train of the matrix, mean over the step", |r| newton_mean(r, "compression_error"); ;
}

/// The Newton iterations of a step, where a Newton method was at work.
fn newton(report: &StepReport) -> Option<&[NewtonRecord]> {
    Some(report.solve.newton.as_slice()).filter(|records| !records.is_empty())
}

fn newton_sum(report: &StepReport, of: fn(&NewtonRecord) -> f64) -> Option<f64> {
    newton(report).map(|records| records.iter().map(of).sum())
}

/// Mean of a figure of linear solvers over the iterations that have it.
fn newton_mean(report: &StepReport, name: &str) -> Option<f64> {
    let values: Vec<f64> =
        report.solve.newton.iter().filter_map(|record| record.figures.get(name).copied()).collect();
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn mean(so_far: &mut f64, value: u64, step: u64) {
    *so_far += (value as f64 - *so_far) / step.max(1) as f64;
}

fn max<T: PartialOrd>(so_far: &mut T, value: T, _: u64) {
    if value > *so_far {
        *so_far = value;
    }
}

fn last<T>(so_far: &mut T, value: T, _: u64) {
    *so_far = value;
}

fn sum<T: std::ops::AddAssign>(so_far: &mut T, value: T, _: u64) {
    *so_far += value;
}

fn first(so_far: &mut Option<u64>, value: u64, step: u64) {
    if value > 0 {
        so_far.get_or_insert(step);
    }
}

fn unconverged(so_far: &mut u64, status: Status, _: u64) {
    *so_far += u64::from(status != Status::Converged);
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain::stepper::{StepSettings, Stepper};
    use graintrain::world::World;

    fn report() -> StepReport {
        Stepper::new(StepSettings::default()).unwrap().step(&mut World::default()).unwrap()
    }

    fn shown(name: &str, report: &StepReport) -> String {
        let quantity = QUANTITIES.iter().find(|quantity| quantity.column.name == name).unwrap();
        (quantity.value)(report).to_string()
    }

    #[test]
    fn figures_are_reduced_over_steps() {
        let (mut figures, mut report) = (Figures::default(), report());
        for (step, contacts, missed, status) in
            [(1, 4, 0, Status::Converged), (2, 9, 2, Status::Stalled), (3, 2, 1, Status::Converged)]
        {
            (report.contacts, report.contacts_missed, report.solve.status) = (contacts, missed, status);
            report.kinetic_energy = f64::NAN;
            report.errors.cone_excess_max = 0.1 * contacts as f64;
            figures.add(step, &report);
        }
        assert_eq!((figures.contacts_mean, figures.contacts_max, figures.contacts_final), (5.0, 9, 2));
        assert_eq!((figures.contacts_missed, figures.contacts_missed_first_step), (3, Some(2)));
        assert_eq!((figures.unconverged_steps, figures.friction_error_max), (1, 0.9));
        let json = serde_json::to_value(&figures).unwrap();
        let keys: Vec<&String> = json.as_object().unwrap().keys().collect();
        let mut names: Vec<&str> = FIGURES.iter().map(|figure| figure.name).collect();
        names.sort_unstable();
        assert_eq!(keys, names);
    }

    #[test]
    fn figures_of_linear_solvers_are_means_over_the_iterations_that_have_them() {
        let mut report = report();
        assert_eq!(shown("newton_condition", &report), "");
        let mut record = NewtonRecord { precompute_seconds: 0.5, condition: 7.0, ..NewtonRecord::default() };
        record.figures.insert("rank_matrix".to_string(), 4.0);
        let mut other = record.clone();
        other.figures.insert("rank_matrix".to_string(), 8.0);
        report.solve.newton = vec![record, other];
        let names = ["newton_precompute_seconds", "newton_condition", "rank_matrix", "rank_inverse"];
        assert_eq!(names.map(|name| shown(name, &report)), ["1.0", "7.0", "6.0", ""]);
    }

    #[test]
    fn names_are_fields_of_a_table() {
        assert_eq!(Value::from("a,\"b\"").to_string(), "\"a,\"\"b\"\"\"");
        assert_eq!(shown("status", &report()), "converged");
    }
}
