//! The tables of a run: `steps.csv`, one record per step, `wrench.csv`, one record per step and driven or
//! held body, `joints.csv`, one record per step and joint (where there are joints), `newton.csv`, one record
//! per Newton iteration, and `measures/NAME.csv`. [`columns`] names their columns.

use super::columns::{self, Column, JOINTS, WRENCH, header, steps};
use super::newton::{NEWTON, NewtonTable};
use crate::files::{OutputError, Table, make_folder};
use crate::mark::{Loss, Marks};
use crate::measure::Measure;
use crate::quantity::{QUANTITIES, Value};
use graintrain::joint::JointState;
use graintrain::stepper::StepReport;
use graintrain::world::World;
use std::path::Path;

/// The tables.
#[derive(Debug)]
pub struct Tables {
    steps: Table,
    wrench: Table,
    joints: Table,
    newton: NewtonTable,
    /// One per measurement, with their names.
    measures: Vec<(String, Table)>,
}

/// Names (relative to the folder) and columns of the tables of measurements.
fn measured(measures: &[Measure]) -> Vec<(String, Vec<Column>)> {
    measures.iter().map(|measure| (format!("measures/{}.csv", measure.name), measure.columns())).collect()
}

impl Tables {
    /// New tables in the folder.
    ///
    /// # Errors
    /// Where they cannot be written.
    pub fn create(folder: &Path, measures: &[Measure]) -> Result<Self, OutputError> {
        let create = |name: &str, header: &str| Table::create(folder.join(name), header);
        Self::open(folder, measures, create, NewtonTable::create(folder))
    }

    /// Goes on with the tables in the folder after step `last_step`, when they held what `marks` say.
    ///
    /// # Errors
    /// Where they cannot be read or written.
    pub fn reopen(
        folder: &Path,
        measures: &[Measure],
        last_step: u64,
        marks: &Marks,
    ) -> Result<Self, OutputError> {
        let reopen = |name: &str, header: &str| {
            Table::reopen(folder.join(name), header, last_step, marks.get(name).copied())
        };
        let newton = NewtonTable::reopen(folder, last_step, marks.get(NEWTON).copied())?;
        Self::open(folder, measures, reopen, newton)
    }

    fn open(
        folder: &Path,
        measures: &[Measure],
        table: impl Fn(&str, &str) -> Result<Table, OutputError>,
        newton: NewtonTable,
    ) -> Result<Self, OutputError> {
        let measured = measured(measures);
        columns::write(folder, &measured)?;
        if !measured.is_empty() {
            make_folder(&folder.join("measures"))?;
        }
        Ok(Self {
            steps: table("steps.csv", &header(&steps()))?,
            wrench: table("wrench.csv", &header(WRENCH))?,
            joints: table("joints.csv", &header(JOINTS))?,
            newton,
            measures: measured
                .into_iter()
                .map(|(name, columns)| table(&name, &header(&columns)).map(|table| (name, table)))
                .collect::<Result<_, _>>()?,
        })
    }

    /// Those that have begun, with their names.
    fn all(&self) -> impl Iterator<Item = (&str, &Table)> {
        let measures = self.measures.iter().map(|(name, table)| (name.as_str(), table));
        [("steps.csv", &self.steps), ("wrench.csv", &self.wrench), ("joints.csv", &self.joints)]
            .into_iter()
            .chain(self.newton.table().map(|table| (NEWTON, table)))
            .chain(measures)
    }

    /// Appends records of measurements: their numbers and rows. What is not a number becomes an empty cell.
    ///
    /// # Errors
    /// Where they cannot be written.
    pub fn append_measured(&mut self, records: &[(usize, Vec<Vec<f64>>)]) -> Result<(), OutputError> {
        let cell = |value: &f64| match value {
            value if value.is_nan() => String::new(),
            // Counts without a point, as in the other tables.
            value if value.fract() == 0.0 && value.abs() < 1e15 => format!("{value:.0}"),
            value => format!("{value:?}"),
        };
        for (number, rows) in records {
            let record = |row: &Vec<f64>| row.iter().map(cell).collect::<Vec<_>>().join(",");
            // All bins at once: a record that is cut short loses them together.
            let lines = rows.iter().map(record).collect::<Vec<_>>().join("\n");
            self.measures[*number].1.append(&lines)?;
        }
        Ok(())
    }

    /// What was not there any more when these were reopened.
    pub fn losses(&self) -> impl Iterator<Item = &Loss> {
        self.all().filter_map(|(_, table)| table.loss())
    }

    /// What the tables hold now.
    pub fn marks(&self) -> Marks {
        self.all().map(|(name, table)| (name.to_string(), table.mark())).collect()
    }

    /// Hands the tables to the disk.
    ///
    /// # Errors
    /// Where the system refuses.
    pub fn sync(&self) -> Result<(), OutputError> {
        self.all().try_for_each(|(_, table)| table.sync())
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
            let body = wrench.body.index();
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
                    Value::from(name),
                    numbers.join(",")
                ))?;
            }
        }
        for (number, placed) in world.joints().iter().enumerate() {
            let JointState { coordinate, rate, drive, force, torque, opening, .. } = placed.state;
            let vectors = force.to_array().into_iter().chain(torque.to_array());
            let numbers =
                [coordinate, rate, drive, opening].into_iter().chain(vectors).map(|x| format!("{x:?}"));
            self.joints.append(&format!(
                "{},{:?},{number},{},{}",
                world.step,
                world.time,
                Value::from(placed.joint.name.as_str()),
                numbers.collect::<Vec<_>>().join(",")
            ))?;
        }
        Ok(())
    }
}

/// Whether the table of wrenches follows the body: it is not free, and it has a name or cannot translate
/// freely. Grains of which only the rotation is held are left out: there may be thousands of them.
fn has_wrench_record(world: &World, body: usize) -> bool {
    let named = world.bodies.name.get(body).is_some_and(|name| !name.is_empty());
    !world.is_free(body) && (named || world.free_degrees(body)[..3] != [true; 3])
}

fn step_record(world: &World, report: &StepReport, output_seconds: f64) -> String {
    let of_step = [Value::from(world.step), Value::from(world.time)];
    let of_report = QUANTITIES.iter().map(|quantity| (quantity.value)(report));
    let cells = of_step.into_iter().chain(of_report).chain([Value::from(output_seconds)]);
    cells.map(|cell| cell.to_string()).collect::<Vec<_>>().join(",")
}
