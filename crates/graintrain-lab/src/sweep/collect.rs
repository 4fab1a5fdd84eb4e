//! What the runs of a sweep measured: observables, their means and errors.

use super::execute::{run_folder, write};
use super::plan::{Cell, Plan};
use super::{SweepError, read_table};
use graintrain::measure::statistics::{mean, steady_from};
use graintrain_io::column::Column;
use graintrain_io::files::within;
use graintrain_io::measure::{Measure, Quantity};
use graintrain_io::quantity::FIGURES;
use graintrain_view::view::tables::Table;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// Figures of `summary.json` that are observables beside those of steps.
const SUMMARY: &[Column] = &[
    Column { name: "bodies", unit: "1", meaning: "bodies of the world at the end" },
    Column { name: "simulated_seconds", unit: "s", meaning: "simulated time" },
    Column { name: "wall_seconds", unit: "s", meaning: "wall clock of the run" },
    Column { name: "cpu_seconds", unit: "s", meaning: "processor time of all threads" },
    Column {
        name: "contacts_apart_share",
        unit: "1",
        meaning: "share of the contacts with force whose bodies were apart in the whole step",
    },
    Column { name: "kinetic_energy", unit: "J", meaning: "at the end" },
];

/// All of them.
fn figures() -> impl Iterator<Item = &'static Column> {
    SUMMARY.iter().chain(FIGURES)
}

/// An observable: a number that a run has.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Observable {
    /// `MEASURE.COLUMN` for its mean in time, with `:max`, `:min` or `:last`; or a figure of `summary.json`.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// One line.
    pub meaning: String,
}

/// The number of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Its value.
    pub value: f64,
    /// Standard error within the run, of a mean in time; NaN otherwise.
    pub error: f64,
}

/// What one run measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sample {
    /// By the names of observables.
    pub found: BTreeMap<String, Found>,
    /// Measurements whose means are over a part that is not known to be steady.
    pub unsteady: Vec<String>,
    /// Stages that had not begun at the end.
    pub stages_left: Vec<String>,
}

/// What one point of a sweep came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Mean over the seeds.
    pub value: f64,
    /// Its standard error: from the scatter over seeds, or within the run where there is one seed only.
    pub error: f64,
    /// Seeds.
    pub count: usize,
}

/// All that a sweep came to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Collected {
    /// Observables that all runs together have, in the order of the tables.
    pub observables: Vec<Observable>,
    /// One per cell; `None` where the run has no result yet.
    pub samples: Vec<Option<Sample>>,
}

fn unreadable(path: &Path, reason: impl ToString) -> SweepError {
    SweepError::Read { path: path.to_path_buf(), reason: reason.to_string() }
}

fn json(path: &Path) -> Result<serde_json::Value, SweepError> {
    let text = std::fs::read_to_string(path).map_err(|error| unreadable(path, error))?;
    serde_json::from_str(&text).map_err(|error| unreadable(path, error))
}

/// Endings of the observables of a column, besides the mean in time.
const ENDINGS: [&str; 3] = [":max", ":min", ":last"];

/// The observables that a run with these measurements will have.
pub(super) fn observables_of(measures: &[Measure]) -> Vec<String> {
    let mut names: Vec<String> = figures().map(|figure| figure.name.to_string()).collect();
    // Records of bins are no series in time.
    for measure in measures.iter().filter(|measure| !measure.quantities.iter().any(Quantity::has_bins)) {
        for column in measure.columns().iter().skip(2) {
            let name = format!("{}.{}", measure.name, column.name);
            names.extend(ENDINGS.iter().map(|ending| format!("{name}{ending}")));
            names.push(name);
        }
    }
    names
}

/// The error for the first of these observables that is not among those known, if there is one.
///
/// # Errors
/// [`SweepError::Observable`].
pub fn check_names(asked: &[String], known: &[String]) -> Result<(), SweepError> {
    match asked.iter().find(|name| !known.contains(name)) {
        None => Ok(()),
        Some(name) => {
            let plain = known.iter().map(String::as_str).filter(|name| !name.contains(':'));
            Err(SweepError::Observable { name: name.clone(), known: plain.collect::<Vec<_>>().join(", ") })
        }
    }
}

/// Reads what finished runs left. Means in time are over records from `from` (s) on; without it over the part
/// that looks steady, or over the second half where none does (which is noted).
///
/// # Errors
/// [`SweepError::Read`] for files of a finished run that cannot be read.
pub fn collect(folder: &Path, cells: &[Cell], from: Option<f64>) -> Result<Collected, SweepError> {
    let mut collected = Collected::default();
    let mut samples = Vec::new();
    for cell in cells {
        let run = run_folder(folder, cell);
        let summary = run.join("summary.json");
        let summary = if summary.exists() { json(&summary)? } else { serde_json::Value::Null };
        if summary["status"] != "finished" {
            samples.push(None);
            continue;
        }
        let names = summary["stages_left"].as_array().into_iter().flatten();
        let stages_left = names.filter_map(|name| name.as_str().map(str::to_string)).collect();
        let mut sample = Sample { stages_left, ..Sample::default() };
        for Column { name, unit, meaning } in figures() {
            if let Some(value) = summary[*name].as_f64() {
                sample.found.insert(name.to_string(), Found { value, error: f64::NAN });
                let [name, unit, meaning] = [name, unit, meaning].map(|text| text.to_string());
                collected.note(Observable { name, unit, meaning });
            }
        }
        let columns = json(&run.join("columns.json"))?;
        for (file, columns) in columns.as_object().into_iter().flatten() {
            let measure = file.strip_prefix("measures/").and_then(|name| name.strip_suffix(".csv"));
            let columns = texts(columns);
            // Records of bins are no series in time.
            if let Some(measure) = measure.filter(|_| !columns.iter().any(|[name, ..]| name == "bin")) {
                let table = table(&run, file, &columns)?;
                collected.add(measure, &table, &columns, from, &mut sample);
            }
        }
        samples.push(Some(sample));
    }
    collected.samples = samples;
    Ok(collected)
}

/// Name, unit and meaning of the columns of a table of `columns.json`.
fn texts(columns: &serde_json::Value) -> Vec<[String; 3]> {
    let text = |column: &serde_json::Value, key: &str| column[key].as_str().unwrap_or_default().to_string();
    let columns = columns.as_array().into_iter().flatten();
    columns.map(|column| ["name", "unit", "meaning"].map(|key| text(column, key))).collect()
}

/// A table of a run with these columns.
fn table(run: &Path, file: &str, columns: &[[String; 3]]) -> Result<Table, SweepError> {
    let path = within(run, file)
        .ok_or_else(|| unreadable(&run.join("columns.json"), format!("it names {file:?}")))?;
    let table = read_table(&path)?;
    if table.odd_lines > 0 || columns.iter().any(|[name, ..]| table.column(name).is_none()) {
        let what = format!(
            "it is damaged: {} lines do not fit its header, or columns are missing; remove {} to make the run again",
            table.odd_lines,
            run.display()
        );
        return Err(unreadable(&path, what));
    }
    Ok(table)
}

impl Collected {
    /// An observable, once.
    fn note(&mut self, observable: Observable) {
        if !self.observables.iter().any(|known| known.name == observable.name) {
            self.observables.push(observable);
        }
    }

    /// What the columns of a measurement come to in a run.
    fn add(
        &mut self,
        measure: &str,
        table: &Table,
        columns: &[[String; 3]],
        from: Option<f64>,
        sample: &mut Sample,
    ) {
        let times = table.numbers("time").unwrap_or_default();
        for [column, unit, meaning] in columns.iter().skip(2) {
            let whole = table.numbers(column).unwrap_or_default();
            let (series, steady) = part(&times, &whole, from);
            let name = format!("{measure}.{column}");
            if !steady {
                sample.unsteady.push(name.clone());
            }
            let average = mean(&series);
            let pick =
                |best: fn(f64, f64) -> f64| whole.iter().copied().filter(|x| x.is_finite()).reduce(best);
            let last = whole.iter().copied().rev().find(|x| x.is_finite());
            let single = |value: Option<f64>| Found { value: value.unwrap_or(f64::NAN), error: f64::NAN };
            let all = [
                ("", "mean in time: ", Found { value: average.value, error: average.error }),
                (ENDINGS[0], "largest: ", single(pick(f64::max))),
                (ENDINGS[1], "smallest: ", single(pick(f64::min))),
                (ENDINGS[2], "last: ", single(last)),
            ];
            for (ending, what, found) in all {
                let name = format!("{name}{ending}");
                sample.found.insert(name.clone(), found);
                self.note(Observable { name, unit: unit.clone(), meaning: format!("{what}{meaning}") });
            }
        }
    }
}

/// The finite records of the part of a series that means are over, and whether it is steady (or was chosen).
fn part(times: &[f64], series: &[f64], from: Option<f64>) -> (Vec<f64>, bool) {
    let finite: Vec<(f64, f64)> =
        times.iter().copied().zip(series.iter().copied()).filter(|(_, x)| x.is_finite()).collect();
    if let Some(from) = from {
        return (
            finite.into_iter().filter(|(time, _)| *time >= from * (1.0 - 1e-12)).map(|(_, x)| x).collect(),
            true,
        );
    }
    let values: Vec<f64> = finite.into_iter().map(|(_, x)| x).collect();
    match steady_from(&values) {
        Some(begin) => (values[begin..].to_vec(), true),
        None => (values[values.len() / 2..].to_vec(), false),
    }
}

impl Collected {
    /// The observable of this name.
    ///
    /// # Errors
    /// [`SweepError::Observable`] where no run has it.
    pub fn observable(&self, name: &str) -> Result<&Observable, SweepError> {
        self.observables.iter().find(|observable| observable.name == name).ok_or_else(|| {
            let plain = self
                .observables
                .iter()
                .map(|observable| observable.name.as_str())
                .filter(|name| !name.contains(':'));
            SweepError::Observable { name: name.to_string(), known: plain.collect::<Vec<_>>().join(", ") }
        })
    }

    /// Mean and error of an observable over the seeds of a point; `None` where no run of it has the number.
    pub fn estimate(&self, cells: &[Cell], point: usize, name: &str) -> Option<Estimate> {
        let mine = cells.iter().zip(&self.samples).filter(|(cell, _)| cell.point == point);
        let found: Vec<Found> = mine
            .filter_map(|(_, sample)| sample.as_ref()?.found.get(name).copied())
            .filter(|found| found.value.is_finite())
            .collect();
        let n = found.len() as f64;
        match found.as_slice() {
            [] => None,
            [one] => Some(Estimate { value: one.value, error: one.error, count: 1 }),
            many => {
                let value = many.iter().map(|found| found.value).sum::<f64>() / n;
                let squares: f64 = many.iter().map(|found| (found.value - value).powi(2)).sum();
                Some(Estimate { value, error: (squares / (n - 1.0) / n).sqrt(), count: many.len() })
            }
        }
    }

    /// Writes `sweep.csv` (a record per point: keys, number of runs, and for every observable its mean and
    /// standard error), `runs.csv` (a record per run) and `columns.json`.
    ///
    /// # Errors
    /// [`SweepError::Output`].
    pub fn write(&self, folder: &Path, plan: &Plan, cells: &[Cell]) -> Result<(), SweepError> {
        let cell_text = |value: f64| if value.is_finite() { format!("{value:?}") } else { String::new() };
        let quoted = |text: &str| {
            if text.contains([',', '"', '\n']) {
                format!("\"{}\"", text.replace('"', "\"\""))
            } else {
                text.to_string()
            }
        };
        let keys: Vec<String> = plan.keys().iter().map(|key| quoted(key)).collect();
        let values =
            |point: usize| plan.points[point].iter().map(|(_, value)| quoted(value)).collect::<Vec<_>>();
        let names: Vec<&str> = self.observables.iter().map(|observable| observable.name.as_str()).collect();

        let both = names.iter().flat_map(|name| [name.to_string(), format!("{name}_error")]);
        let header = keys.iter().cloned().chain(["runs".to_string()]).chain(both).collect::<Vec<_>>();
        let mut points = header.join(",") + "\n";
        for point in 0..plan.points.len() {
            let done = cells
                .iter()
                .zip(&self.samples)
                .filter(|(cell, sample)| cell.point == point && sample.is_some());
            let mut record = values(point);
            record.push(done.count().to_string());
            for name in &names {
                let estimate = self.estimate(cells, point, name);
                record.push(estimate.map_or(String::new(), |estimate| cell_text(estimate.value)));
                record.push(estimate.map_or(String::new(), |estimate| cell_text(estimate.error)));
            }
            let _ = writeln!(points, "{}", record.join(","));
        }
        write(&folder.join("sweep.csv"), &points)?;

        let begin = ["run", "seed", "finished", "unsteady"].map(str::to_string);
        let header: Vec<String> =
            begin.into_iter().chain(keys).chain(names.iter().map(|name| name.to_string())).collect();
        let mut runs = header.join(",") + "\n";
        for (cell, sample) in cells.iter().zip(&self.samples) {
            let unsteady = sample.as_ref().map_or(0, |sample| sample.unsteady.len());
            let mut record = vec![
                quoted(&cell.name),
                cell.seed.to_string(),
                u8::from(sample.is_some()).to_string(),
                unsteady.to_string(),
            ];
            record.extend(values(cell.point));
            for name in &names {
                let found = sample.as_ref().and_then(|sample| sample.found.get(*name));
                record.push(found.map_or(String::new(), |found| cell_text(found.value)));
            }
            let _ = writeln!(runs, "{}", record.join(","));
        }
        write(&folder.join("runs.csv"), &runs)?;

        let text =
            serde_json::to_string_pretty(&self.observables).map_err(|error| unreadable(folder, error))?;
        write(&folder.join("columns.json"), &(text + "\n"))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_series() {
        let times: Vec<f64> = (0..100).map(f64::from).collect();
        let rising = times.clone();
        assert_eq!(part(&times, &rising, Some(97.0)), (vec![97.0, 98.0, 99.0], true));
        assert_eq!(part(&times, &rising, None).0.len(), 50);
        assert!(!part(&times, &rising, None).1 && part(&times, &[1.0; 100], None).1);
    }

    /// Seeds 1, 2, 6: mean 3, standard error sqrt(7/3).
    #[test]
    fn means_over_seeds() {
        let cell = |seed| Cell { point: 0, seed, name: String::new(), settings: Vec::new() };
        let sample = |value: f64| {
            let found = BTreeMap::from([("a".to_string(), Found { value, error: 0.5 })]);
            Some(Sample { found, ..Sample::default() })
        };
        let cells = [cell(0), cell(1), cell(2), cell(3)];
        let samples = vec![sample(1.0), sample(2.0), sample(6.0), None];
        let collected = Collected { observables: Vec::new(), samples };
        let found = collected.estimate(&cells, 0, "a").unwrap();
        assert_eq!((found.value, found.count), (3.0, 3));
        assert!((found.error - (7.0_f64 / 3.0).sqrt()).abs() < 1e-15);
        assert_eq!(collected.estimate(&cells[..1], 0, "a").unwrap().error, 0.5);
        assert!(collected.estimate(&cells, 1, "a").is_none() && collected.observable("a").is_err());
    }
}
