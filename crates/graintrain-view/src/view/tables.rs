//! Curves from a run's tables.

use super::{ViewError, read_text};
use serde::Serialize;
use std::collections::HashSet;
use std::path::Path;

/// Most points of a curve; longer ones are thinned evenly.
const POINTS: usize = 1500;
/// Most bodies whose forces are plotted.
const BODIES: usize = 4;

/// A column of a table and its name in the legend.
type Column<'a> = (&'a str, &'a str);

/// Curves over time with a common ordinate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plot {
    /// Ordinate with unit.
    pub title: String,
    /// Whether the ordinate is logarithmic.
    pub log: bool,
    /// Times, s.
    pub x: Vec<f64>,
    /// The curves.
    pub series: Vec<Curve>,
}

/// A curve.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// Name in the legend.
    pub label: String,
    /// One value per time of the plot; what is not a number becomes null.
    pub y: Vec<f64>,
}

/// A table with a header line, comma-separated, fields in quotes where needed.
pub struct Table {
    names: Vec<String>,
    rows: Vec<Vec<String>>,
    /// Lines that do not fit the header, which are left out.
    pub odd_lines: usize,
}

impl Table {
    /// Reads a table; incomplete last lines (of a run that was killed) are left out.
    ///
    /// # Errors
    /// [`ViewError::Read`].
    pub fn read(path: &Path) -> Result<Self, ViewError> {
        let text = read_text(path)?;
        let mut lines = text.lines().map(fields);
        let names = lines.next().unwrap_or_default();
        let (rows, odd): (Vec<_>, Vec<_>) = lines.partition(|row| row.len() == names.len());
        Ok(Self { names, rows, odd_lines: odd.len() })
    }

    /// Index of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }

    /// Names of the columns.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// A column's fields.
    pub fn texts(&self, name: &str) -> Option<Vec<&str>> {
        let column = self.column(name)?;
        Some(self.rows.iter().map(|row| row[column].as_str()).collect())
    }

    /// A column's numbers, NaN where a field is none.
    pub fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        let column = self.column(name)?;
        Some(self.rows.iter().map(|row| row[column].parse().unwrap_or(f64::NAN)).collect())
    }

    /// The rows whose field in a column is the given text.
    pub fn with(&self, name: &str, value: &str) -> Self {
        let column = self.column(name);
        let rows = self.rows.iter().filter(|row| column.is_some_and(|column| row[column] == value));
        Self { names: self.names.clone(), rows: rows.cloned().collect(), odd_lines: self.odd_lines }
    }

    /// The different texts of a column, in order of appearance.
    pub fn distinct(&self, name: &str) -> Vec<String> {
        let mut found: Vec<String> = Vec::new();
        let mut seen = HashSet::new();
        if let Some(column) = self.column(name) {
            for row in &self.rows {
                if seen.insert(row[column].as_str()) {
                    found.push(row[column].clone());
                }
            }
        }
        found
    }
}

/// The fields of a line.
fn fields(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(c) = characters.next() {
        match c {
            '"' if quoted && characters.peek() == Some(&'"') => {
                characters.next();
                fields.last_mut().expect("starts with one field").push('"');
            }
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(String::new()),
            c => fields.last_mut().expect("starts with one field").push(c),
        }
    }
    fields
}

/// Curves of `steps.csv` and `wrench.csv` in a run's folder; those whose columns are missing are left out.
///
/// # Errors
/// [`ViewError::Read`] where a table exists and cannot be read.
pub fn plots(folder: &Path) -> Result<Vec<Plot>, ViewError> {
    const STEPS: [(&str, bool, &[Column]); 5] = [
        ("contacts (1)", false, &[("contacts", "in the envelope"), ("contacts_with_force", "with force")]),
        ("residual (1)", true, &[("residual", "residual")]),
        ("kinetic energy (J)", false, &[("kinetic_energy", "kinetic energy")]),
        ("largest penetration (m)", false, &[("penetration_max", "penetration")]),
        (
            "time per step (s)",
            false,
            &[("seconds_solve", "solve"), ("seconds_collide", "collide"), ("seconds_assemble", "assemble")],
        ),
    ];
    let mut plots = Vec::new();
    let path = folder.join("steps.csv");
    if path.exists() {
        let table = Table::read(&path)?;
        plots.extend(STEPS.iter().filter_map(|(title, log, columns)| plot(&table, title, *log, columns)));
    }
    let path = folder.join("wrench.csv");
    if path.exists() {
        let table = Table::read(&path)?;
        for name in table.distinct("name").into_iter().filter(|name| !name.is_empty()).take(BODIES) {
            let rows = table.with("name", &name);
            let force = [("force_x", "x"), ("force_y", "y"), ("force_z", "z")];
            let torque = [("torque_x", "x"), ("torque_y", "y"), ("torque_z", "z")];
            plots.extend(plot(&rows, &format!("force on {name} (N)"), false, &force));
            plots.extend(plot(&rows, &format!("torque on {name} (N m)"), false, &torque));
        }
    }
    Ok(plots)
}

fn plot(table: &Table, title: &str, log: bool, columns: &[Column]) -> Option<Plot> {
    let time = table.numbers("time")?;
    let stride = time.len().div_ceil(POINTS).max(1);
    let thin = |values: Vec<f64>| values.into_iter().step_by(stride).collect::<Vec<f64>>();
    let series: Vec<Curve> = columns
        .iter()
        .filter_map(|(column, label)| Some(Curve { label: (*label).into(), y: thin(table.numbers(column)?) }))
        .collect();
    (!series.is_empty() && !time.is_empty()).then(|| Plot { title: title.into(), log, x: thin(time), series })
}
