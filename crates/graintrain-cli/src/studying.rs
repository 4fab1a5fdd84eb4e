//! What both studies share: the verdict on every observable.

use crate::error::Failure;
use crate::solving::positive;
use crate::sweeping::{Made, sweep_failure};
use crate::terminal::say;
use graintrain_lab::sweep::report::{page, with_error};
use graintrain_lab::sweep::study::{Refined, convergence, estimates};
use std::fmt::Write as _;
use std::process::ExitCode;

/// Options of studies.
#[derive(clap::Args)]
pub struct StudyOptions {
    /// Largest admissible deviation from the finest value, relative to it
    #[arg(long, default_value = "0.05", value_name = "SHARE", value_parser = positive, allow_negative_numbers = true)]
    pub within: f64,
}

/// Compares every observable, writes `study.csv` and the page, prints the verdicts.
pub fn conclude(made: &Made, options: &StudyOptions, refined: Refined) -> Result<ExitCode, Failure> {
    let key = refined.key();
    let values: Vec<&str> = made.plan.points.iter().map(|point| point[0].1.as_str()).collect();
    let numbers: Vec<f64> = values.iter().map(|value| value.parse().unwrap_or(f64::NAN)).collect();
    let ratio = match numbers.as_slice() {
        [.., a, b] => a / b,
        _ => f64::NAN,
    };
    let mut csv = format!("observable,{key},value,error,deviation,deviation_error,wall_seconds\n");
    let mut verdicts = Vec::new();
    for name in &made.names {
        let Some(found) = estimates(&made.collected, &made.plan, &made.cells, name) else { continue };
        let Some(measured) = convergence(&found, options.within, ratio) else { continue };
        for (point, (estimate, deviation)) in found.iter().zip(&measured.deviation).enumerate() {
            let wall = made.collected.estimate(&made.cells, point, "wall_seconds");
            let cell = |value: f64| if value.is_finite() { format!("{value:?}") } else { String::new() };
            let cells = [
                estimate.value,
                estimate.error,
                deviation.value,
                deviation.error,
                wall.map_or(f64::NAN, |wall| wall.value),
            ];
            let _ = writeln!(csv, "{name},{},{}", values[point], cells.map(cell).join(","));
        }
        let order = match (refined, measured.order) {
            (Refined::TimeStep, Some(order)) => format!("; order {order:.1}"),
            _ => String::new(),
        };
        let share = 100.0 * options.within;
        verdicts.push(match measured.admissible {
            Some(point) => format!(
                "{name}: {key} = {} is within {share} % of the finest ({} against {}, deviation {}){order}",
                values[point],
                with_error(&found[point]),
                with_error(&found[found.len() - 1]),
                with_error(&measured.deviation[point]),
            ),
            None => format!(
                "{name}: no {key} above the finest is known to be within {share} % of it (deviations with errors: {}){order}",
                measured.deviation[..found.len() - 1].iter().map(with_error).collect::<Vec<_>>().join("; ")
            ),
        });
    }
    let path = made.folder.join("study.csv");
    graintrain_io::files::write_atomically(&path, csv.as_bytes())
        .map_err(|error| sweep_failure(error.into()))?;
    let items: String = verdicts
        .iter()
        .map(|verdict| format!("<li>{}</li>", graintrain_view::plot::svg::escape(verdict)))
        .collect();
    let more = format!("<ul>{items}</ul>");
    page(&made.folder, &made.plan, &made.cells, &made.collected, &made.names, true, &more)
        .map_err(sweep_failure)?;
    let code = made.conclude();
    if !made.is_quiet() {
        say!("\n");
        verdicts.iter().for_each(|verdict| say!("{verdict}\n"));
    }
    Ok(code)
}
