//! The answer of a calibration: numbers, `calibration.json`, and a page with plots.

use super::Answer;
use super::gaussian_process::Prediction;
use super::inference::NOT_REACHED;
use super::question::Target;
use crate::page::begin;
use crate::sweep::SweepError;
use crate::sweep::collect::Estimate;
use crate::sweep::execute::write;
use crate::sweep::plan::label;
use crate::sweep::report::with_error;
use graintrain_view::plot::svg::escape;
use graintrain_view::plot::{Axis, Chart, Series, figure};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::Path;

/// Share of a distribution at an end of a range from which on the end is said to cut it off.
const CUT: f64 = 0.02;
/// Width of the part of a range that counts as its end.
const END: f64 = 0.01;
/// Standard deviation over that of the whole range from which on a parameter is said not to be determined.
const WIDE: f64 = 0.8;
/// Share of a distribution beside runs without a number from which on it is no answer.
const SILENT: f64 = 0.5;
/// Bars of a histogram, points of a drawn surrogate.
const BARS: usize = 40;
/// Most charts of single aims.
const CHARTS: usize = 8;

/// What a calibration says of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fitted {
    /// Its key.
    pub key: String,
    /// Mean.
    pub value: f64,
    /// Standard deviation.
    pub error: f64,
    /// Lower end of the interval that holds 95 %.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Value at the likeliest point.
    pub likeliest: f64,
    /// Whether the distribution is cut off by an end of the range.
    pub is_cut: bool,
    /// Standard deviation over that of the whole range, in which all values are alike likely (magnitudes, for
    /// logarithmic ranges).
    pub width: f64,
}

/// An aim at the likeliest point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reached {
    /// For people.
    pub aim: String,
    /// What was to be reached.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
    /// What the surrogate says, with its error.
    pub predicted: f64,
    /// Its standard deviation.
    pub predicted_error: f64,
    /// Scatter of single runs.
    pub noise: f64,
    /// Share of the scatter of runs that the surrogate predicts from the others: near 1 where the parameters
    /// matter.
    pub predicted_share: f64,
}

impl Answer {
    /// The parameters.
    pub fn fitted(&self) -> Vec<Fitted> {
        let found = &self.distribution;
        let likeliest = self.question.values(&found.likeliest);
        let of = |(k, parameter): (usize, &super::question::Parameter)| {
            let value = |point: &[f64]| parameter.value(point[k]);
            let mean = found.mean(value);
            let middle = found.mean(|u| u[k]);
            let share =
                |low: f64, high: f64| found.mean(|u| f64::from(u8::from((low..=high).contains(&u[k]))));
            Fitted {
                key: parameter.key.clone(),
                value: mean,
                error: found.mean(|u| (value(u) - mean).powi(2)).sqrt(),
                low: found.quantile(0.025, value),
                high: found.quantile(0.975, value),
                likeliest: likeliest[k],
                width: 12_f64.sqrt() * found.mean(|u| (u[k] - middle).powi(2)).sqrt(),
                is_cut: share(0.0, END).max(share(1.0 - END, 1.0)) > CUT,
            }
        };
        self.question.parameters.iter().enumerate().map(of).collect()
    }

    /// Correlation of two parameters.
    fn correlation(&self, i: usize, k: usize) -> f64 {
        let (found, fitted) = (&self.distribution, self.fitted());
        let value = |point: &[f64], k: usize| self.question.parameters[k].value(point[k]) - fitted[k].value;
        let product = found.mean(|u| value(u, i) * value(u, k));
        let size = fitted[i].error * fitted[k].error;
        if size > 0.0 { product / size } else { 0.0 }
    }

    /// The aims at the likeliest point.
    pub fn reached(&self) -> Vec<Reached> {
        let at = std::slice::from_ref(&self.distribution.likeliest);
        let of = |(k, element): (usize, &super::observe::Element)| {
            let process = self.surrogates.process(k);
            let Prediction { value, error } = process.predict(at)[0];
            Reached {
                aim: element.label.clone(),
                value: element.aim.value,
                error: element.aim.error,
                predicted: value,
                predicted_error: error,
                noise: process.noise(),
                predicted_share: process.predicted_share(),
            }
        };
        self.aims.elements.iter().enumerate().map(of).collect()
    }

    /// Whether no values in the ranges reach what was measured.
    pub fn is_missed(&self) -> bool {
        self.distribution.is_missed
    }

    /// The aim for which most of the distribution lies where no run has a number, if there is one: such an
    /// answer stands on no run.
    pub fn silent_aim(&self) -> Option<&str> {
        let (share, aim) = self.surrogates.silent_share(&self.distribution, &self.observations);
        (share > SILENT).then(|| self.aims.elements[aim].label.as_str())
    }

    /// Whether the mean of the parameters misses what their likeliest values reach: several solutions, or a
    /// bent valley of them.
    fn is_mean_elsewhere(&self) -> bool {
        let mean: Vec<f64> = self
            .question
            .parameters
            .iter()
            .zip(self.fitted())
            .map(|(parameter, fitted)| parameter.coordinate(fitted.value))
            .collect();
        let widening = self.distribution.widened.powi(2);
        let misses = |point: &[f64]| {
            self.surrogates.chi_square(point) / widening > NOT_REACHED * self.aims.elements.len() as f64
        };
        misses(&mean) && !misses(&self.distribution.likeliest)
    }

    /// What has to be known beside the numbers, in sentences; empty where all is well.
    pub fn doubts(&self) -> Vec<String> {
        let mut doubts = Vec::new();
        let aims = self.aims.elements.len();
        if self.is_missed() {
            doubts.push(format!(
                "no values in these ranges reach what was measured: the best ones miss it by {:.1} errors (root mean square)",
                (self.distribution.chi_square / aims as f64).sqrt()
            ));
        }
        if let Some(aim) = self.silent_aim() {
            doubts.push(format!(
                "most of the answer lies where no run has a number for `{aim}` (see observed.csv): it continues what is known from elsewhere; choose ranges in which the runs have one"
            ));
        }
        if self.is_mean_elsewhere() {
            doubts.push("the mean values do not reach what was measured, the likeliest ones do: there are several solutions, or they lie along a curve (see calibration.html); narrow the ranges to one, or measure something else, too".into());
        }
        if self.distribution.widened > 1.0 && !self.is_missed() {
            doubts.push(format!(
                "all errors are widened by {:.2}, so that the best values fit",
                self.distribution.widened
            ));
        }
        for fitted in &self.fitted() {
            if fitted.width > WIDE {
                doubts.push(format!(
                    "{} is not determined: its standard deviation is {:.0} % of that of its whole range",
                    fitted.key,
                    100.0 * fitted.width
                ));
            } else if fitted.is_cut {
                doubts.push(format!(
                    "{} reaches an end of its range: widen it, or it is not determined",
                    fitted.key
                ));
            }
        }
        if self.reached().iter().all(|reached| reached.predicted_share < 0.2) {
            doubts.push("what was measured hardly depends on these parameters, as far as the scatter of the runs lets see".into());
        }
        let would_narrow = !self.is_missed() && self.silent_aim().is_none();
        if would_narrow
            && self.unknown_share > 0.5
            && self.aims.elements.iter().all(|element| element.aim.error > 0.0)
        {
            doubts.push(format!(
                "more runs would narrow the answer: up to {:.0} % of the variance is what is not known of the runs (--points)",
                100.0 * self.unknown_share
            ));
        }
        if self.failed.len() * 4 > self.observations.len() {
            doubts.push(format!("{} of the runs failed", self.failed.len()));
        }
        doubts
    }

    /// Writes `calibration.json` and `calibration.html`.
    ///
    /// # Errors
    /// [`SweepError::Output`].
    pub fn write(&self, folder: &Path) -> Result<(), SweepError> {
        let fitted = self.fitted();
        let n = fitted.len();
        let json = serde_json::json!({
            "scene": self.question.plan.scene,
            "points": self.points.len(),
            "runs": self.observations.len() * self.aims.conditions.len(),
            "failed_runs": self.failed.len(),
            "parameters": fitted,
            "correlation": (0..n).map(|i| (0..n).map(|k| self.correlation(i, k)).collect::<Vec<_>>()).collect::<Vec<_>>(),
            "targets": self.reached(),
            "chi_square": self.distribution.chi_square,
            "errors_widened_by": self.distribution.widened,
            "share_of_surrogates": self.unknown_share,
            "doubts": self.doubts(),
        });
        let text = serde_json::to_string_pretty(&json)
            .map_err(|error| SweepError::Read { path: folder.to_path_buf(), reason: error.to_string() })?;
        write(&folder.join("calibration.json"), &(text + "\n"))?;
        write(&folder.join("calibration.html"), &self.page())?;
        Ok(())
    }

    fn page(&self) -> String {
        let mut html = begin(&format!("Calibration of {}", self.question.plan.scene));
        let _ = write!(
            html,
            "<p>{} points, {} runs. Settings of all: {}. What every run said: <code>observed.csv</code>; all numbers: <code>calibration.json</code>.</p>",
            self.points.len(),
            self.observations.len() * self.aims.conditions.len(),
            if self.question.plan.settings.is_empty() {
                "none".into()
            } else {
                escape(&label(&self.question.plan.settings))
            },
        );
        for doubt in self.doubts() {
            let _ = write!(html, "<p><b>{}</b></p>", escape(&doubt));
        }
        html += "<table class=\"numbers\"><tr><th>parameter</th><th>value</th><th>95 % interval</th><th>likeliest</th></tr>";
        for fitted in self.fitted() {
            let value = with_error(&Estimate { value: fitted.value, error: fitted.error, count: 1 });
            let _ = write!(
                html,
                "<tr><td>{}</td><td>{value}</td><td>{:.4e} to {:.4e}</td><td>{:.4e}</td></tr>",
                escape(&fitted.key),
                fitted.low,
                fitted.high,
                fitted.likeliest
            );
        }
        html += "</table><table class=\"numbers\"><tr><th>target</th><th>measured</th><th>at the likeliest values</th><th>scatter of a run</th></tr>";
        for reached in self.reached() {
            let text = |value: f64, error: f64| with_error(&Estimate { value, error, count: 1 });
            let _ = write!(
                html,
                "<tr><td>{}</td><td>{}</td><td>{}</td><td>{:.2e}</td></tr>",
                escape(&reached.aim),
                text(reached.value, reached.error),
                text(reached.predicted, reached.predicted_error),
                reached.noise
            );
        }
        html += "</table>";
        let _ = write!(html, "<h2>Parameters</h2>{}", figure(&self.parameter_charts(), 2));
        let _ = writeln!(
            html,
            "<h2>What was to be reached</h2>{}</body></html>",
            figure(&self.target_charts(), 2)
        );
        html
    }

    /// A histogram per parameter; for each pair where the answer lies.
    fn parameter_charts(&self) -> Vec<Chart> {
        let (found, fitted) = (&self.distribution, self.fitted());
        let axis = |k: usize| {
            let parameter = &self.question.parameters[k];
            if parameter.logarithmic { Axis::log(&*parameter.key) } else { Axis::linear(&*parameter.key) }
        };
        let mut charts = Vec::new();
        for (k, parameter) in self.question.parameters.iter().enumerate() {
            let ends = [0.0, 1.0].map(|share| found.quantile(share, |u| u[k]));
            let width = ((ends[1] - ends[0]) / BARS as f64).max(1e-9);
            let mut bars = vec![0.0; BARS + 1];
            for (point, weight) in found.points.iter().zip(&found.weights) {
                let bar = ((point[k] - ends[0]) / width) as usize;
                bars[bar.min(BARS - 1)] += weight;
            }
            let points = bars.iter().enumerate();
            let points =
                points.map(|(bar, share)| [parameter.value(ends[0] + width * bar as f64), *share]).collect();
            let value = Estimate { value: fitted[k].value, error: fitted[k].error, count: 1 };
            charts.push(
                Chart::new(
                    format!("{} = {}", parameter.key, with_error(&value)),
                    axis(k),
                    Axis::linear("share (1)"),
                )
                .with(Series::steps("", points)),
            );
        }
        for i in 0..fitted.len() {
            for k in i + 1..fitted.len() {
                let place = |point: &Vec<f64>| {
                    let values = self.question.values(point);
                    [values[i], values[k]]
                };
                let heaviest = found.weights.iter().copied().fold(0.0, f64::max);
                let likely =
                    found.points.iter().zip(&found.weights).filter(|(_, weight)| **weight > 0.135 * heaviest);
                let likely: Vec<[f64; 2]> = likely.take(600).map(|(point, _)| place(point)).collect();
                let runs = self.points.iter().map(place).collect();
                let title = format!(
                    "{} and {}, correlation {:.2}",
                    fitted[i].key,
                    fitted[k].key,
                    self.correlation(i, k)
                );
                charts.push(
                    Chart::new(title, axis(i), axis(k))
                        .with(Series::scatter("likely", likely).in_color(5))
                        .with(Series::scatter("runs", runs).hollow().in_color(6)),
                );
            }
        }
        charts
    }

    /// Curves as measured and as predicted; numbers over each parameter, the others at their likeliest
    /// values.
    fn target_charts(&self) -> Vec<Chart> {
        let reached = self.reached();
        let mut charts = Vec::new();
        for (index, target) in self.question.targets.iter().enumerate() {
            let mine: Vec<usize> =
                (0..reached.len()).filter(|k| self.aims.elements[*k].target == index).collect();
            if let Target::Curve { observable, abscissa, .. } = target {
                let x = |k: &usize| self.aims.elements[*k].x.unwrap_or(f64::NAN);
                let measured = mine.iter().map(|k| [x(k), reached[*k].value]).collect();
                let bar = |value: f64, error: f64| [value - error, value + error];
                let bars = mine.iter().map(|k| bar(reached[*k].value, reached[*k].error)).collect();
                let predicted = mine.iter().map(|k| [x(k), reached[*k].predicted]).collect();
                let errors =
                    mine.iter().map(|k| bar(reached[*k].predicted, reached[*k].predicted_error)).collect();
                charts.push(
                    Chart::new(observable, Axis::linear(abscissa), Axis::linear(observable))
                        .with(Series::scatter("measured", measured).with_errors(bars))
                        .with(Series::line("at the likeliest values", predicted).with_errors(errors)),
                );
                continue;
            }
            for k in mine {
                for p in 0..self.question.parameters.len() {
                    if charts.len() < CHARTS {
                        charts.push(self.chart(k, p, &reached[k]));
                    }
                }
            }
        }
        charts
    }

    /// An aim over a parameter.
    fn chart(&self, k: usize, p: usize, reached: &Reached) -> Chart {
        let parameter = &self.question.parameters[p];
        let axis =
            if parameter.logarithmic { Axis::log(&*parameter.key) } else { Axis::linear(&*parameter.key) };
        let line: Vec<Vec<f64>> = (0..=BARS)
            .map(|step| {
                let mut point = self.distribution.likeliest.clone();
                point[p] = step as f64 / BARS as f64;
                point
            })
            .collect();
        let predicted = self.surrogates.process(k).predict(&line);
        let curve = |shift: f64| -> Vec<[f64; 2]> {
            let each = line.iter().zip(&predicted);
            each.map(|(point, found)| [parameter.value(point[p]), found.value + shift * found.error])
                .collect()
        };
        let runs =
            self.observations.iter().map(|run| [parameter.value(run.point[p]), run.values[k]]).collect();
        let label = if self.question.parameters.len() > 1 { "runs (others elsewhere)" } else { "runs" };
        let (low, high) = (reached.value - reached.error, reached.value + reached.error);
        Chart::new(format!("{} over {}", reached.aim, parameter.key), axis, Axis::linear(&*reached.aim))
            .with_band("measured", low, high)
            .with(Series::scatter(label, runs).hollow().in_color(6))
            .with(Series::line("surrogate", curve(0.0)).in_color(0))
            .with(Series::line("and two of its errors", curve(2.0)).dashed().in_color(0))
            .with(Series::line("", curve(-2.0)).dashed().in_color(0))
    }
}
