//! The page of a sweep: a table of its points and plots of its observables, in one file.

use super::SweepError;
use super::collect::{Collected, Estimate};
use super::execute::{run_folder, write};
use super::plan::{Cell, Plan, label};
use crate::page::begin;
use graintrain_view::plot::svg::escape;
use graintrain_view::plot::{Axis, Chart, Series, figure};
use graintrain_view::view::tables::Table;
use std::fmt::Write as _;
use std::path::Path;

/// Most observables on a page whose observables nobody chose.
const MOST: usize = 24;
/// Most curves in a chart of series in time.
const CURVES: usize = 12;
/// Most points of a curve.
const POINTS: usize = 600;

/// The number at the beginning of a value, and what follows it (a unit).
fn number(value: &str) -> Option<(f64, &str)> {
    let value = value.trim();
    let end =
        value.find(|c: char| c == ' ' || c.is_alphabetic() && c != 'e' && c != 'E').unwrap_or(value.len());
    Some((value[..end].parse().ok()?, value[end..].trim()))
}

/// Abscissae of the points: the first key whose values are all numbers of one unit.
fn abscissa(plan: &Plan) -> Option<(usize, String, Vec<f64>)> {
    plan.keys().iter().enumerate().find_map(|(k, key)| {
        let values: Vec<(f64, &str)> =
            plan.points.iter().map(|point| number(&point[k].1)).collect::<Option<_>>()?;
        let unit = values.first()?.1;
        let distinct = values.iter().any(|(value, _)| *value != values[0].0);
        let name = if unit.is_empty() { key.to_string() } else { format!("{key} ({unit})") };
        (distinct && values.iter().all(|(_, other)| *other == unit))
            .then(|| (k, name, values.iter().map(|(value, _)| *value).collect()))
    })
}

/// The names of the observables that the page shows: those chosen, or the means in time of all measurements.
///
/// # Errors
/// [`SweepError::Observable`] for a chosen one that no run has.
pub fn shown(collected: &Collected, chosen: &[String]) -> Result<Vec<String>, SweepError> {
    for name in chosen {
        collected.observable(name)?;
    }
    if !chosen.is_empty() {
        return Ok(chosen.to_vec());
    }
    let names = || collected.observables.iter().map(|observable| observable.name.clone());
    let means: Vec<String> =
        names().filter(|name| name.contains('.') && !name.contains(':')).take(MOST).collect();
    Ok(if means.is_empty() { names().collect() } else { means })
}

/// Value and error as text: as many digits as the error leaves.
pub fn with_error(estimate: &Estimate) -> String {
    let Estimate { value, error, .. } = *estimate;
    if !(error.is_finite() && error > 0.0) {
        return short(value);
    }
    let digits = (1.0 - error.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    if value.abs() >= 1e6 || value.abs() < 1e-4 && value != 0.0 {
        return format!("{value:.3e} ± {error:.1e}");
    }
    format!("{value:.digits$} ± {error:.digits$}")
}

fn short(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        format!("{value:.5}")
    } else {
        format!("{value:.4e}")
    }
}

/// Axis label of an observable.
fn axis_label(collected: &Collected, name: &str) -> String {
    let unit = collected.observable(name).map_or("", |observable| observable.unit.as_str());
    if unit.is_empty() { name.to_string() } else { format!("{name} ({unit})") }
}

/// An observable against the first key, a curve for each combination of the others.
fn chart(collected: &Collected, plan: &Plan, cells: &[Cell], name: &str, logarithmic: bool) -> Chart {
    let by_number: Vec<f64> = (1..=plan.points.len()).map(|k| k as f64).collect();
    let (key, x_label, x) = abscissa(plan)
        .map_or((usize::MAX, "point of the plan".to_string(), by_number), |(k, name, x)| (k, name, x));
    let axis = if logarithmic { Axis::log(x_label) } else { Axis::linear(x_label) };
    let mut chart = Chart::new(name, axis, Axis::linear(axis_label(collected, name)));
    let others = |point: usize| -> String {
        let rest: Vec<_> = plan.points[point]
            .iter()
            .enumerate()
            .filter(|(k, _)| *k != key)
            .map(|(_, s)| s.clone())
            .collect();
        if rest.is_empty() || key == usize::MAX { String::new() } else { label(&rest) }
    };
    let mut groups: Vec<String> = Vec::new();
    for point in 0..plan.points.len() {
        if !groups.contains(&others(point)) {
            groups.push(others(point));
        }
    }
    for group in groups {
        let mut points: Vec<([f64; 2], [f64; 2])> = (0..plan.points.len())
            .filter(|&point| others(point) == group)
            .filter_map(|point| {
                let found = collected.estimate(cells, point, name)?;
                let error = if found.error.is_finite() { found.error } else { 0.0 };
                Some(([x[point], found.value], [found.value - error, found.value + error]))
            })
            .collect();
        points.sort_by(|a, b| a.0[0].total_cmp(&b.0[0]));
        let (points, errors) = points.into_iter().unzip();
        let series = Series::line(group, points).with_markers().with_errors(errors);
        chart = chart.with(series);
    }
    chart
}

/// The series behind an observable, a curve per point (of its first seed): over time, or over the
/// displacement of a shear box.
fn history(folder: &Path, plan: &Plan, cells: &[Cell], collected: &Collected, name: &str) -> Option<Chart> {
    let plain = name.split(':').next()?;
    let (measure, column) = plain.rsplit_once('.')?;
    let mut x_label = "time (s)";
    let mut curves = Vec::new();
    let first = |cell: &&Cell| cell.seed == 0;
    for cell in cells.iter().filter(first).take(CURVES) {
        let table = run_folder(folder, cell).join("measures").join(format!("{measure}.csv"));
        let Ok(table) = Table::read(&table) else { continue };
        let abscissa = match table.numbers("displacement") {
            Some(x) if column != "displacement" => {
                x_label = "displacement (m)";
                x
            }
            _ => table.numbers("time")?,
        };
        let values = table.numbers(column)?;
        let stride = values.len().div_ceil(POINTS).max(1);
        let points = abscissa.into_iter().zip(values).step_by(stride).map(|(x, y)| [x, y]).collect();
        curves.push(Series::line(label(&plan.points[cell.point]), points));
    }
    if curves.is_empty() {
        return None;
    }
    let mut chart = Chart::new(plain, Axis::linear(x_label), Axis::linear(axis_label(collected, plain)));
    chart.series = curves;
    Some(chart)
}

/// Writes `sweep.html` with these observables. `more` is put behind the heading, as HTML.
///
/// # Errors
/// [`SweepError::Output`].
pub fn page(
    folder: &Path,
    plan: &Plan,
    cells: &[Cell],
    collected: &Collected,
    names: &[String],
    logarithmic: bool,
    more: &str,
) -> Result<(), SweepError> {
    let done = collected.samples.iter().flatten().count();
    let mut html = begin(&format!("Sweep of {}", plan.scene));
    let _ = write!(
        html,
        "<p>{} points, {} of {} runs finished. Settings of all: {}. Bars are standard errors over seeds, or in time where there is one \
         seed. All numbers: <code>sweep.csv</code>, <code>runs.csv</code>; units and meanings: <code>columns.json</code>.</p>{more}",
        plan.points.len(),
        done,
        cells.len(),
        if plan.settings.is_empty() { "none".to_string() } else { escape(&label(&plan.settings)) },
    );
    let unsteady: std::collections::BTreeSet<&str> =
        collected.samples.iter().flatten().flat_map(|sample| &sample.unsteady).map(String::as_str).collect();
    let shown_unsteady: Vec<&str> =
        names.iter().map(String::as_str).filter(|name| unsteady.contains(name)).collect();
    if !shown_unsteady.is_empty() {
        let _ = write!(
            html,
            "<p><small>Not steady in some run, so that its mean is over the second half: {}. Choose a beginning with --from.</small></p>",
            escape(&shown_unsteady.join(", "))
        );
    }
    html += "<table class=\"numbers\"><tr>";
    for key in plan.keys() {
        let _ = write!(html, "<th>{}</th>", escape(key));
    }
    html += "<th>runs</th>";
    for name in names {
        let _ = write!(html, "<th>{}</th>", escape(&axis_label(collected, name)));
    }
    html += "</tr>";
    for (point, settings) in plan.points.iter().enumerate() {
        html += "<tr>";
        for (_, value) in settings {
            let _ = write!(html, "<td>{}</td>", escape(value));
        }
        let runs = cells
            .iter()
            .zip(&collected.samples)
            .filter(|(cell, sample)| cell.point == point && sample.is_some());
        let _ = write!(html, "<td>{}</td>", runs.count());
        for name in names {
            let text =
                collected.estimate(cells, point, name).map_or(String::new(), |found| with_error(&found));
            let _ = write!(html, "<td>{text}</td>");
        }
        html += "</tr>";
    }
    html += "</table>";
    if plan.points.len() > 1 {
        let charts: Vec<Chart> =
            names.iter().map(|name| chart(collected, plan, cells, name, logarithmic)).collect();
        let _ = write!(html, "<h2>Observables</h2>{}", figure(&charts, 2));
    }
    let mut plain: Vec<&str> = Vec::new();
    for name in names {
        let name = name.split(':').next().unwrap_or(name);
        if !plain.contains(&name) {
            plain.push(name);
        }
    }
    let histories: Vec<Chart> =
        plain.iter().filter_map(|name| history(folder, plan, cells, collected, name)).collect();
    if !histories.is_empty() {
        let _ = write!(html, "<h2>In the course of the runs (first seed)</h2>{}", figure(&histories, 2));
    }
    html += "</body></html>\n";
    write(&folder.join("sweep.html"), &html)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_errors_as_text() {
        assert_eq!(number("10 ms"), Some((10.0, "ms")));
        assert_eq!(number("1e-3"), Some((1e-3, "")));
        assert_eq!(number("apgd"), None);
        let found = |value, error| with_error(&Estimate { value, error, count: 2 });
        assert_eq!(found(0.35123, 0.0041), "0.3512 ± 0.0041");
        assert_eq!(found(1234.5, 30.0), "1234 ± 30");
        assert_eq!(found(1.23456e-7, 1e-9), "1.235e-7 ± 1.0e-9");
        assert_eq!(found(2.0, f64::NAN), "2.00000");
    }
}
