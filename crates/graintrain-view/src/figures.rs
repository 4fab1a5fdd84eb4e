//! The standard figures of a run: what its tables hold, as charts of a replay and as SVG files.

use crate::plot::{Axis, Chart, Series};
use crate::view::ViewError;
use crate::view::tables::Table;
use graintrain_io::files::within;
use std::path::Path;

/// Most points of a curve in a figure; longer ones are thinned evenly.
const POINTS: usize = 2000;
/// Most profiles of a table of bins: the first, the last, and evenly between.
const PROFILES: usize = 6;
/// Most bodies whose forces are drawn.
const BODIES: usize = 12;
/// Charts beside each other in a figure of several.
const COLUMNS: usize = 2;

/// A column and its name in the legend.
type Curve = (&'static str, &'static str);

/// Names and units of the columns of a table.
type Columns = Vec<[String; 2]>;

/// A figure of `steps.csv`: name of the file, title, ordinate, whether logarithmic, curves.
type Standard = (&'static str, &'static str, &'static str, bool, &'static [Curve]);

const STEPS: &[Standard] = &[
    ("energies", "Kinetic energy", "energy (J)", false, &[("kinetic_energy", "")]),
    (
        "work",
        "Work in a step",
        "energy (J)",
        false,
        &[("load_work", "of loads"), ("correction_energy", "against gravity, by removal of overlap")],
    ),
    (
        "contacts",
        "Contacts",
        "contacts (1)",
        false,
        &[("contacts", "in the envelope"), ("contacts_with_force", "with force")],
    ),
    (
        "residual",
        "Residual of the contact problem",
        "residual (1)",
        true,
        &[("residual", "worst contact"), ("residual_rms", "root mean square")],
    ),
    ("iterations", "Iterations of the solver", "iterations (1)", false, &[("iterations", "")]),
    (
        "penetration",
        "Deepest overlap",
        "overlap / size (1)",
        false,
        &[("penetration_over_size", "at the end of the step")],
    ),
    (
        "seconds",
        "Wall clock of a step",
        "time (s)",
        false,
        &[
            ("seconds_solve", "solve"),
            ("seconds_collide", "collide"),
            ("seconds_assemble", "assemble"),
            ("seconds_integrate", "integrate"),
        ],
    ),
];

/// Which moments a chart shows.
#[derive(Clone, Debug, PartialEq)]
pub enum Moments {
    /// One per point of each series, s.
    OfPoints(Vec<f64>),
    /// One per series, s.
    OfSeries(Vec<f64>),
}

/// A chart of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct RunChart {
    /// What is drawn.
    pub chart: Chart,
    /// When it was so.
    pub moments: Moments,
}

/// Charts that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Name of its file, without ending.
    pub name: String,
    /// Its charts, one at least.
    pub charts: Vec<RunChart>,
}

/// The standard figures of the run in this folder as names of files (without ending) and SVG texts.
///
/// # Errors
/// As [`charts`].
pub fn figures(folder: &Path) -> Result<Vec<(String, String)>, ViewError> {
    let drawn = |figure: Figure| {
        let charts: Vec<Chart> = figure.charts.into_iter().map(|chart| chart.chart).collect();
        (figure.name, crate::plot::figure(&charts, COLUMNS))
    };
    Ok(charts(folder, POINTS)?.into_iter().map(drawn).collect())
}

/// The standard figures of the run in this folder, with at most so many points per curve. Those whose tables
/// or columns are missing are left out.
///
/// # Errors
/// [`ViewError::Read`] where a table exists and cannot be read, [`ViewError::Malformed`] for a `columns.json`
/// that is none.
pub fn charts(folder: &Path, points: usize) -> Result<Vec<Figure>, ViewError> {
    let mut figures = Vec::new();
    let path = folder.join("steps.csv");
    if path.exists() {
        let table = Table::read(&path)?;
        for (name, title, y, log, curves) in STEPS {
            let curves: Vec<(String, String)> =
                curves.iter().map(|(column, label)| (column.to_string(), label.to_string())).collect();
            let y = if *log { Axis::log(*y) } else { Axis::linear(*y) };
            if let Some(chart) = over_time(&table, "time", title, y, &curves, points) {
                figures.push(Figure { name: name.to_string(), charts: vec![chart] });
            }
        }
    }
    let path = folder.join("wrench.csv");
    if path.exists() {
        let table = Table::read(&path)?;
        let mut charts = Vec::new();
        for body in table.distinct("name").into_iter().filter(|name| !name.is_empty()).take(BODIES) {
            let rows = table.with("name", &body);
            for (what, unit) in [("force", "N"), ("torque", "N m")] {
                let curves: Vec<(String, String)> =
                    ["x", "y", "z"].iter().map(|axis| (format!("{what}_{axis}"), axis.to_string())).collect();
                let y = Axis::linear(format!("{what} ({unit})"));
                charts.extend(over_time(&rows, "time", &format!("{what} on {body}"), y, &curves, points));
            }
        }
        if !charts.is_empty() {
            figures.push(Figure { name: "forces".into(), charts });
        }
    }
    for (file, columns) in columns(folder)? {
        let Some(name) = file.strip_prefix("measures/").and_then(|name| name.strip_suffix(".csv")) else {
            continue;
        };
        let Some(path) = within(folder, &file) else {
            let what = format!("it names {file:?}, which is no file of the run");
            return Err(ViewError::Malformed { path: folder.join("columns.json"), what });
        };
        if !path.exists() {
            continue;
        }
        let charts = measured(&Table::read(&path)?, name, &columns, points);
        if !charts.is_empty() {
            figures.push(Figure { name: format!("measure_{name}"), charts });
        }
    }
    Ok(figures)
}

/// Names and units of the columns of every table.
fn columns(folder: &Path) -> Result<Vec<(String, Columns)>, ViewError> {
    let path = folder.join("columns.json");
    let Ok(text) = std::fs::read_to_string(&path) else { return Ok(Vec::new()) };
    let malformed = |what: String| ViewError::Malformed { path: path.clone(), what };
    let json: serde_json::Value =
        serde_json::from_str(&text).map_err(|error| malformed(error.to_string()))?;
    let tables = json.as_object().ok_or_else(|| malformed("it is no object".into()))?;
    let pair = |column: &serde_json::Value| {
        ["name", "unit"].map(|key| column[key].as_str().unwrap_or("").to_string())
    };
    let list = |columns: &serde_json::Value| columns.as_array().into_iter().flatten().map(pair).collect();
    Ok(tables.iter().map(|(file, columns)| (file.clone(), list(columns))).collect())
}

/// Columns over an abscissa, thinned; `None` where there is nothing to draw.
fn over_time(
    table: &Table,
    x: &str,
    title: &str,
    y: Axis,
    curves: &[(String, String)],
    points: usize,
) -> Option<RunChart> {
    let (abscissa, time) = (table.numbers(x)?, table.numbers("time")?);
    let stride = abscissa.len().div_ceil(points).max(1);
    let label = if x == "displacement" { "displacement (m)" } else { "time (s)" };
    let mut chart = Chart::new(title, Axis::linear(label), y);
    for (column, name) in curves {
        let Some(values) = table.numbers(column) else { continue };
        let points: Vec<[f64; 2]> =
            abscissa.iter().zip(&values).step_by(stride).map(|(x, y)| [*x, *y]).collect();
        if points.iter().any(|[_, y]| y.is_finite()) {
            chart = chart.with(Series::line(name, points));
        }
    }
    let moments = Moments::OfPoints(time.into_iter().step_by(stride).collect());
    (!chart.series.is_empty()).then_some(RunChart { chart, moments })
}

/// The charts of a measurement: components of a tensor or vector together, other columns alone; of bins one
/// chart per column.
fn measured(table: &Table, name: &str, columns: &[[String; 2]], points: usize) -> Vec<RunChart> {
    let rest = columns.get(2..).unwrap_or_default();
    if rest.first().is_some_and(|[column, _]| column == "bin") {
        return bins(table, name, rest);
    }
    // A shear box is looked at over its displacement.
    let x = if table.column("displacement").is_some() { "displacement" } else { "time" };
    let mut charts = Vec::new();
    let mut next = 0;
    while next < rest.len() {
        let [column, unit] = &rest[next];
        let stem = component(column).map(|(stem, _)| stem);
        let same = |other: &[String; 2]| {
            other[1] == *unit && stem.is_some() && component(&other[0]).map(|(stem, _)| stem) == stem
        };
        let count = rest[next..].iter().take_while(|other| same(other)).count().max(1);
        let group = &rest[next..next + count];
        next += count;
        if group.iter().any(|[column, _]| column == x) {
            continue;
        }
        let (title, curves): (&str, Vec<(String, String)>) = match stem.filter(|_| count > 1) {
            Some(stem) => {
                let label =
                    |column: &str| component(column).map_or(String::new(), |(_, axes)| axes.to_string());
                (stem, group.iter().map(|[column, _]| (column.clone(), label(column))).collect())
            }
            None => (column, vec![(column.clone(), String::new())]),
        };
        let y = Axis::linear(format!("{title} ({unit})"));
        charts.extend(over_time(table, x, &format!("{name}: {title}"), y, &curves, points));
    }
    charts
}

/// `force_x` is the component x of force, `stress_xy` the component xy of stress.
fn component(column: &str) -> Option<(&str, &str)> {
    let (stem, axes) = column.rsplit_once('_')?;
    (!axes.is_empty() && axes.len() <= 2 && axes.chars().all(|axis| "xyz".contains(axis)))
        .then_some((stem, axes))
}

/// Profiles at some times, the later the farther along in the palette.
fn bins(table: &Table, name: &str, columns: &[[String; 2]]) -> Vec<RunChart> {
    let Some([middle, unit]) = columns.get(1) else { return Vec::new() };
    let times = table.distinct("time");
    let last = times.len().saturating_sub(1);
    let mut chosen: Vec<usize> = (0..PROFILES).map(|k| k * last / (PROFILES - 1)).collect();
    chosen.dedup();
    let rows: Vec<(f64, Table)> = chosen
        .iter()
        .filter_map(|&k| times.get(k))
        .map(|time| (time.parse().unwrap_or(f64::NAN), table.with("time", time)))
        .collect();
    let chart = |[column, of]: &[String; 2]| {
        let x = Axis::linear(format!("{middle} ({unit})"));
        let mut chart = Chart::new(format!("{name}: {column}"), x, Axis::linear(format!("{column} ({of})")));
        let mut moments = Vec::new();
        for (time, rows) in &rows {
            let (Some(x), Some(y)) = (rows.numbers(middle), rows.numbers(column)) else { continue };
            let points: Vec<[f64; 2]> = x.into_iter().zip(y).map(|(x, y)| [x, y]).collect();
            if points.iter().any(|[_, y]| y.is_finite()) {
                let shown = format!("{time:.4}");
                let label = format!("{} s", shown.trim_end_matches('0').trim_end_matches('.'));
                chart = chart.with(Series::line(label, points).with_markers());
                moments.push(*time);
            }
        }
        (!chart.series.is_empty()).then_some(RunChart { chart, moments: Moments::OfSeries(moments) })
    };
    columns.iter().skip(2).filter_map(chart).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_a_folder_with_tables() {
        let folder = tempfile::tempdir().unwrap();
        let write = |file: &str, text: &str| {
            let path = folder.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        assert!(figures(folder.path()).unwrap().is_empty());
        write("steps.csv", "step,time,kinetic_energy,contacts,residual\n1,0.1,2,5,1e-5\n2,0.2,1,6,1e-4\n");
        write(
            "wrench.csv",
            "step,time,body,name,force_x,force_y,force_z\n1,0.1,0,floor,0,0,1\n2,0.2,0,floor,0,0,2\n",
        );
        write("measures/a.csv", "step,time,stress_xx,stress_yy,pressure\n1,0.1,2,4,3\n2,0.2,2,5,3.5\n");
        write(
            "measures/b.csv",
            "step,time,bin,middle,density\n1,0.1,0,0.5,3\n1,0.1,1,1.5,4\n2,0.2,0,0.5,1\n2,0.2,1,1.5,2\n",
        );
        let column =
            |name: &str, unit: &str| format!("{{\"name\":\"{name}\",\"unit\":\"{unit}\",\"meaning\":\"\"}}");
        let list = |names: &[&str]| names.iter().map(|name| column(name, "Pa")).collect::<Vec<_>>().join(",");
        let tables = format!(
            "{{\"measures/a.csv\":[{}],\"measures/b.csv\":[{}]}}",
            list(&["step", "time", "stress_xx", "stress_yy", "pressure"]),
            list(&["step", "time", "bin", "middle", "density"])
        );
        write("columns.json", &tables);
        let found = figures(folder.path()).unwrap();
        let names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["energies", "contacts", "residual", "forces", "measure_a", "measure_b"]);
        let svg = |name: &str| &found.iter().find(|(known, _)| known == name).unwrap().1;
        assert!(svg("measure_a").contains("a: stress") && svg("measure_a").contains("a: pressure"));
        assert!(svg("measure_b").contains("b: density") && svg("measure_b").contains("0.2 s"));
        assert!(svg("forces").contains("force on floor"));
        write("columns.json", "[1]");
        assert!(figures(folder.path()).is_err());
    }
}
