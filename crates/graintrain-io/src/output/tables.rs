//! The tables of a run: `steps.csv`, one record per step, `wrench.csv`, one record per step and driven or held body, and
//! `newton.csv`, one record per Newton iteration.

use super::newton::{NewtonTable, STEP_COLUMNS, step_cells};
use crate::files::{OutputError, Table};
use graintrain::stepper::StepReport;
use graintrain::world::World;
use std::path::Path;

/// The last column of `steps.csv`.
const LAST: &str = "residual_paper";

/// Columns of `steps.csv` before those of Newton methods. SI units; the pages of the documentation name them.
const STEPS: &str = "step,time,contacts,contacts_with_force,solver,status,iterations,linear_iterations,\
    residual,residual_rms,residual_relaxed,residual_coulomb,penetration_max,kinetic_energy,\
    seconds_collide,seconds_assemble,seconds_solve,seconds_integrate,seconds_output";

/// All columns of `steps.csv`.
fn steps_header() -> String {
    format!("{STEPS},{STEP_COLUMNS},{LAST}")
}

/// Columns of `wrench.csv`.
const WRENCH: &str = "step,time,body,name,force_x,force_y,force_z,torque_x,torque_y,torque_z,\
    x,y,z,velocity_x,velocity_y,velocity_z";

/// The tables.
#[derive(Debug)]
pub struct Tables {
    steps: Table,
    wrench: Table,
    newton: NewtonTable,
}

impl Tables {
    /// New tables in the folder.
    ///
    /// # Errors
    /// Where they cannot be written.
    pub fn create(folder: &Path) -> Result<Self, OutputError> {
        Ok(Self {
            steps: Table::create(folder.join("steps.csv"), &steps_header())?,
            wrench: Table::create(folder.join("wrench.csv"), WRENCH)?,
            newton: NewtonTable::create(folder),
        })
    }

    /// Goes on with the tables in the folder after step `last_step`.
    ///
    /// # Errors
    /// Where they cannot be read or written.
    pub fn reopen(folder: &Path, last_step: u64) -> Result<Self, OutputError> {
        Ok(Self {
            steps: Table::reopen(folder.join("steps.csv"), &steps_header(), last_step)?,
            wrench: Table::reopen(folder.join("wrench.csv"), WRENCH, last_step)?,
            newton: NewtonTable::reopen(folder, last_step)?,
        })
    }

    /// Appends the records of a step; `output_seconds` is what the outputs of the step before took.
    ///
    /// # Errors
    /// Where they cannot be written.
    pub fn append(
        &mut self,
        world: &World,
        report: &StepReport,
        output_seconds: f64,
    ) -> Result<(), OutputError> {
        self.steps.append(&step_record(world, report, output_seconds))?;
        self.newton.append(world.step, &report.solve.newton)?;
        for wrench in &report.wrenches {
            let body = wrench.body as usize;
            if has_wrench_record(world, body) {
                let vectors =
                    [wrench.force, wrench.torque, world.bodies.position[body], world.bodies.velocity[body]];
                let numbers: Vec<String> =
                    vectors.iter().flat_map(|v| v.to_array()).map(|x| format!("{x:?}")).collect();
                let name = world.bodies.name.get(body).map_or("", String::as_str);
                self.wrench.append(&format!(
                    "{},{:?},{body},{},{}",
                    world.step,
                    world.time,
                    quoted(name),
                    numbers.join(",")
                ))?;
            }
        }
        Ok(())
    }
}

/// Whether the table of wrenches follows the body: it is not free, and it has a name or cannot translate freely. Grains
/// of which only the rotation is held are left out: there may be thousands of them.
fn has_wrench_record(world: &World, body: usize) -> bool {
    let named = world.bodies.name.get(body).is_some_and(|name| !name.is_empty());
    !world.is_free(body) && (named || world.free_degrees(body)[..3] != [true; 3])
}

fn step_record(world: &World, report: &StepReport, output_seconds: f64) -> String {
    let solve = &report.solve;
    // The name of a status is the one that it has in every other file.
    let status = serde_json::to_string(&solve.status).unwrap_or_default();
    format!(
        "{},{:?},{},{},{},{},{},{},{:?},{:?},{:?},{:?},{:?},{:?},{:?},{:?},{:?},{:?},{:?},{},{:?}",
        world.step,
        world.time,
        report.contacts,
        report.contacts_with_force,
        quoted(&solve.solver),
        status.trim_matches('"'),
        solve.iterations,
        solve.linear_iterations,
        solve.residual.max,
        solve.residual.rms,
        solve.residual_relaxed.max,
        solve.residual_coulomb.max,
        report.penetration_max,
        report.kinetic_energy,
        report.phases.collide,
        report.phases.assemble,
        report.phases.solve,
        report.phases.integrate,
        output_seconds,
        step_cells(&solve.newton),
        solve.residual_paper,
    )
}

/// A text as a CSV field: in quotes where it holds a comma, quote or line break.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_string()
    }
}
