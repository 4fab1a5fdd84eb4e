//! Least squares: a model with unknown constants through the points of a sweep, with their uncertainty.

use super::{SweepError, read_table};
use graintrain_io::scene;
use graintrain_view::plot::{Axis, Chart, Series};
use std::collections::BTreeMap;
use std::path::Path;

/// A point with the standard error of its ordinate; 0 where there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Abscissa.
    pub x: f64,
    /// Ordinate.
    pub y: f64,
    /// Its standard error.
    pub error: f64,
}

/// A constant of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct Constant {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its standard error; NaN where there are as many points as constants, and no errors.
    pub error: f64,
}

/// A fitted model.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The constants, in the order in which they were given.
    pub constants: Vec<Constant>,
    /// Root mean square of the residuals, in the unit of the ordinate.
    pub residual: f64,
    /// Sum of squares over degrees of freedom, of residuals over errors; NaN without errors.
    pub chi_square: f64,
}

/// Most steps of the iteration.
const STEPS: usize = 200;

/// Relative step of the differences that stand for derivatives.
const DIFFERENCE: f64 = 1e-6;

fn wrong(problem: impl Into<String>) -> SweepError {
    SweepError::Plan(problem.into())
}

/// The points of two columns of a table, with `Y_error` where it is there. Values may have units.
///
/// # Errors
/// [`SweepError::Read`] for a file that cannot be read; [`SweepError::Plan`] for columns that are not there
/// or no numbers.
pub fn points(path: &Path, x: &str, y: &str) -> Result<Vec<Point>, SweepError> {
    let table = read_table(path)?;
    if table.odd_lines > 0 {
        let reason = format!("{} of its lines have another number of cells than its header", table.odd_lines);
        return Err(SweepError::Read { path: path.to_path_buf(), reason });
    }
    let column = |name: &str| {
        table.texts(name).ok_or_else(|| {
            let meant = scene::closest(name, table.names().iter().map(String::as_str));
            let meant = meant.map_or(".".to_string(), |meant| format!("; did you mean `{meant}`?"));
            let known = table.names().join(", ");
            wrong(format!("{} has no column `{name}`{meant} It has {known}", path.display()))
        })
    };
    let number =
        |text: &str| scene::value(text, &[]).map_err(|problem| wrong(format!("`{text}`: {problem}")));
    let (xs, ys) = (column(x)?, column(y)?);
    let errors = table.texts(&format!("{y}_error"));
    let mut points = Vec::new();
    for (k, (x, y)) in xs.iter().zip(&ys).enumerate() {
        // A point without a result yet.
        if x.is_empty() || y.is_empty() {
            continue;
        }
        let error = errors.as_ref().map_or("", |errors| errors[k]);
        let error = if error.is_empty() { 0.0 } else { number(error)? };
        points.push(Point { x: number(x)?, y: number(y)?, error });
    }
    Ok(points)
}

/// The model at an abscissa.
fn evaluate(model: &str, names: &[&str], constants: &[f64], x: f64) -> Result<f64, SweepError> {
    let values: Vec<(&str, f64)> =
        names.iter().copied().zip(constants.iter().copied()).chain([("x", x)]).collect();
    scene::value(model, &values)
        .map_err(|problem| wrong(format!("the model `{model}` at x = {x}: {problem}")))
}

/// Fits the constants (with the values to start from) by the method of Levenberg and Marquardt: points weigh
/// by their errors where all have one, and alike otherwise. The error of a constant is the root of the
/// diagonal of (J^T W J)^-1, times the scatter of the residuals where there are no errors or that is more
/// than they say.
///
/// Source: J. J. More, "The Levenberg-Marquardt algorithm", Lecture Notes in Mathematics 630, 1978.
///
/// # Errors
/// [`SweepError::Plan`] for a model that is none, fewer points than constants, or constants that the points
/// do not determine.
pub fn fit(model: &str, start: &[(String, f64)], points: &[Point]) -> Result<Fit, SweepError> {
    let problem = Problem::new(model, start, points)?;
    let (constants, now) = problem.fitted(start.iter().map(|(_, value)| *value).collect())?;
    let (names, count, weighted) = (&problem.names, problem.names.len(), problem.weighted);
    let slopes = problem.slopes(&constants)?;
    if let Some(k) = (0..count).find(|k| slopes[*k].iter().all(|slope| *slope == 0.0)) {
        let name = names[k];
        return Err(wrong(format!(
            "the model does not depend on the constant `{name}` at these points: leave it out, or start elsewhere"
        )));
    }
    let free = (points.len() - count) as f64;
    let scatter = if free > 0.0 { square(&now) / free } else { f64::NAN };
    let factor = if weighted { scatter.max(1.0) } else { scatter };
    let mut fitted = Vec::new();
    for (k, name) in names.iter().enumerate() {
        let unit = (0..count).map(|j| f64::from(u8::from(j == k))).collect();
        let column = solve(normal(&slopes, 0.0), unit).ok_or_else(|| {
            wrong(format!("the points do not tell the constants apart (`{name}` among them): fix one in the model, or take points that differ more"))
        })?;
        fitted.push(Constant {
            name: name.to_string(),
            value: constants[k],
            error: (column[k] * factor).sqrt(),
        });
    }
    let plain = points.iter().zip(&now).map(|(point, r)| (r / problem.weight(point)).powi(2)).sum::<f64>();
    Ok(Fit {
        constants: fitted,
        residual: (plain / points.len() as f64).sqrt(),
        chi_square: if weighted { scatter } else { f64::NAN },
    })
}

/// What is fitted.
struct Problem<'a> {
    model: &'a str,
    names: Vec<&'a str>,
    points: &'a [Point],
    /// Whether all points have an error.
    weighted: bool,
}

impl<'a> Problem<'a> {
    fn new(model: &'a str, start: &'a [(String, f64)], points: &'a [Point]) -> Result<Self, SweepError> {
        let names: Vec<&str> = start.iter().map(|(name, _)| name.as_str()).collect();
        let count = names.len();
        if let Some(k) = (0..count).find(|k| names[..*k].contains(&names[*k])) {
            return Err(wrong(format!("the constant `{}` is given twice", names[k])));
        }
        if count == 0 {
            return Err(wrong("a model needs a constant with a value to start from"));
        }
        if points.len() < count {
            let have = points.len();
            return Err(wrong(format!(
                "{have} points with a result cannot determine {count} constants: make more runs, or fix constants in the model"
            )));
        }
        if let Some(point) = points.iter().find(|point| !(point.x.is_finite() && point.y.is_finite())) {
            return Err(wrong(format!("the point x = {}, y = {} is not finite", point.x, point.y)));
        }
        let first: Vec<f64> = start.iter().map(|(_, value)| *value).collect();
        for point in points {
            if !evaluate(model, &names, &first, point.x)?.is_finite() {
                let place =
                    format!("the model is not finite at x = {} with the constants to start from", point.x);
                return Err(wrong(format!("{place}: choose others")));
            }
        }
        let weighted = points.iter().all(|point| point.error > 0.0 && point.error.is_finite());
        Ok(Self { model, names, points, weighted })
    }

    fn weight(&self, point: &Point) -> f64 {
        if self.weighted { 1.0 / point.error } else { 1.0 }
    }

    fn residuals(&self, constants: &[f64]) -> Result<Vec<f64>, SweepError> {
        let value = |x: f64| evaluate(self.model, &self.names, constants, x);
        self.points.iter().map(|point| Ok(self.weight(point) * (point.y - value(point.x)?))).collect()
    }

    /// Derivatives of the model at the points by each constant, weighted.
    fn slopes(&self, constants: &[f64]) -> Result<Vec<Vec<f64>>, SweepError> {
        let slope = |k: usize| {
            let mut step = DIFFERENCE * constants[k].abs().max(1e-9);
            let at = |sign: f64, step: f64| {
                let mut moved = constants.to_vec();
                moved[k] += sign * step;
                self.residuals(&moved)
            };
            let (mut more, mut less) = (at(1.0, step)?, at(-1.0, step)?);
            // A constant that starts from zero says nothing about its size: a step that rounding swallows is
            // enlarged.
            let is_lost = |more: &[f64], less: &[f64]| {
                let least = DIFFERENCE * more.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
                more.iter().zip(less).all(|(a, b)| (a - b).abs() <= 1e-3 * least)
            };
            while constants[k].abs() < 1e-9 && step < 1e9 && is_lost(&more, &less) {
                step *= 10.0;
                (more, less) = (at(1.0, step)?, at(-1.0, step)?);
            }
            Ok(more.iter().zip(&less).map(|(a, b)| (b - a) / (2.0 * step)).collect())
        };
        (0..constants.len()).map(slope).collect()
    }

    /// The constants with the least squares that are found from these, and their residuals.
    fn fitted(&self, mut constants: Vec<f64>) -> Result<(Vec<f64>, Vec<f64>), SweepError> {
        let mut now = self.residuals(&constants)?;
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            let slopes = self.slopes(&constants)?;
            let right = slopes.iter().map(|slope| slope.iter().zip(&now).map(|(a, b)| a * b).sum()).collect();
            let Some(change) = solve(normal(&slopes, damping), right) else { break };
            let tried: Vec<f64> = constants.iter().zip(&change).map(|(a, b)| a + b).collect();
            let then = self.residuals(&tried)?;
            if square(&then) <= square(&now) {
                let is_done = change.iter().zip(&tried).all(|(d, c)| d.abs() <= 1e-12 * c.abs().max(1e-300));
                (constants, now) = (tried, then);
                damping *= 0.2;
                if is_done {
                    break;
                }
            } else {
                damping *= 5.0;
                if damping > 1e12 {
                    break;
                }
            }
        }
        Ok((constants, now))
    }
}

fn square(list: &[f64]) -> f64 {
    list.iter().map(|x| x * x).sum()
}

/// J^T W J of these slopes, its diagonal times 1 + damping.
fn normal(slopes: &[Vec<f64>], damping: f64) -> Vec<Vec<f64>> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let entry = |i: usize, j: usize| dot(&slopes[i], &slopes[j]) * if i == j { 1.0 + damping } else { 1.0 };
    (0..slopes.len()).map(|i| (0..slopes.len()).map(|j| entry(i, j)).collect()).collect()
}

/// A small linear system by elimination with pivots, after its rows and columns are scaled; `None` where it
/// is singular.
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Option<Vec<f64>> {
    let n = b.len();
    let scale: Vec<f64> = (0..n).map(|i| a[i][i].abs().sqrt()).collect();
    if scale.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
        return None;
    }
    for i in 0..n {
        b[i] /= scale[i];
        for j in 0..n {
            a[i][j] /= scale[i] * scale[j];
        }
    }
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs()))?;
        a.swap(k, pivot);
        b.swap(k, pivot);
        if a[k][k].abs() < 1e-13 {
            return None;
        }
        for i in k + 1..n {
            let factor = a[i][k] / a[k][k];
            for j in k..n {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    for k in (0..n).rev() {
        for j in k + 1..n {
            b[k] -= a[k][j] * b[j];
        }
        b[k] /= a[k][k];
    }
    Some(b.iter().zip(&scale).map(|(x, s)| x / s).collect())
}

/// The points with their error bars and the fitted model as a chart.
///
/// # Errors
/// As [`fit`].
pub fn chart(model: &str, fit: &Fit, points: &[Point], [x, y]: [&str; 2]) -> Result<String, SweepError> {
    let names: Vec<&str> = fit.constants.iter().map(|constant| constant.name.as_str()).collect();
    let values: Vec<f64> = fit.constants.iter().map(|constant| constant.value).collect();
    let (low, high) = points
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), point| (low.min(point.x), high.max(point.x)));
    let curve = (0..=100).map(|k| {
        let x = low + (high - low) * f64::from(k) / 100.0;
        evaluate(model, &names, &values, x).map(|y| [x, y])
    });
    let curve = curve.collect::<Result<Vec<_>, _>>()?;
    let bars = points.iter().map(|point| [point.y - point.error, point.y + point.error]).collect();
    let measured = points.iter().map(|point| [point.x, point.y]).collect();
    let constants: BTreeMap<&str, String> =
        fit.constants.iter().map(|constant| (constant.name.as_str(), with_error(constant))).collect();
    let title: Vec<String> = names.iter().map(|name| format!("{name} = {}", constants[name])).collect();
    Ok(Chart::new(title.join(", "), Axis::linear(x), Axis::linear(y))
        .with(Series::scatter("runs", measured).with_errors(bars))
        .with(Series::line(model, curve))
        .to_svg())
}

/// A constant with its error, to the digits that the error leaves.
pub fn with_error(constant: &Constant) -> String {
    let Constant { value, error, .. } = *constant;
    if !(error.is_finite() && error > 0.0) {
        return format!("{value:.6e}");
    }
    let digits = (value.abs() / error).log10().floor().clamp(0.0, 15.0) as usize + 1;
    format!("{value:.digits$e} +- {error:.1e}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn start(list: &[(&str, f64)]) -> Vec<(String, f64)> {
        list.iter().map(|(name, value)| (name.to_string(), *value)).collect()
    }

    /// A straight line has a closed form: slope 2.1, intercept 0.9, errors from the textbook.
    #[test]
    fn lines_as_in_the_textbook() {
        let points: Vec<Point> = [(0.0, 1.0), (1.0, 2.8), (2.0, 5.2), (3.0, 7.2)]
            .map(|(x, y)| Point { x, y, error: 0.0 })
            .to_vec();
        let found = fit("c + k*x", &start(&[("c", 0.0), ("k", 1.0)]), &points).unwrap();
        let n = 4.0;
        let mean = |f: &dyn Fn(&Point) -> f64| points.iter().map(f).sum::<f64>() / n;
        let (mx, my) = (mean(&|p| p.x), mean(&|p| p.y));
        let sxx = n * mean(&|p| (p.x - mx).powi(2));
        let slope = n * mean(&|p| (p.x - mx) * (p.y - my)) / sxx;
        let constant = my - slope * mx;
        assert!((found.constants[1].value - slope).abs() < 1e-9, "{found:?}");
        assert!((found.constants[0].value - constant).abs() < 1e-9);
        let variance = points.iter().map(|p| (p.y - constant - slope * p.x).powi(2)).sum::<f64>() / 2.0;
        assert!((found.constants[1].error / (variance / sxx).sqrt() - 1.0).abs() < 1e-6);
        let expected = (variance * (1.0 / n + mx * mx / sxx)).sqrt();
        assert!((found.constants[0].error / expected - 1.0).abs() < 1e-6);
        // In other units, from the same start.
        let large: Vec<Point> = points.iter().map(|p| Point { y: 1e6 * p.y, ..*p }).collect();
        let found = fit("c + k*x", &start(&[("c", 0.0), ("k", 1.0)]), &large).unwrap();
        assert!((found.constants[0].value / 1e6 - constant).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn curves_come_back_from_their_points() {
        let points: Vec<Point> = (1..=8)
            .map(|k| {
                let x = 0.5 * f64::from(k);
                Point { x, y: 3.0 * (1.0 - (-x / 1.7).exp()), error: 0.01 * x }
            })
            .collect();
        let model = "most * (1 - exp(-x / scale))";
        let found = fit(model, &start(&[("most", 1.0), ("scale", 1.0)]), &points).unwrap();
        assert!((found.constants[0].value - 3.0).abs() < 1e-7, "{found:?}");
        assert!((found.constants[1].value - 1.7).abs() < 1e-7);
        assert!(chart(model, &found, &points, ["x (m)", "y (N)"]).unwrap().contains("<svg"));
        assert!(fit("a1 + b1 + x", &start(&[("a1", 1.0), ("b1", 1.0)]), &points).is_err());
        assert!(fit(model, &start(&[("most", 1.0), ("scale", 1.0)]), &points[..1]).is_err());
        let reported =
            |model: &str, list: &[(&str, f64)]| fit(model, &start(list), &points).unwrap_err().to_string();
        for (model, list, expected) in [
            ("most * y", [("most", 1.0)].as_slice(), "neither a unit nor one of the names"),
            ("mots * x", &[("most", 1.0)], "did you mean `most`"),
            ("a1 + b1 + x", &[("a1", 1.0), ("b1", 1.0)], "apart"),
            ("a1 * x", &[("a1", 1.0), ("a1", 2.0)], "given twice"),
            ("a1 * x", &[("a1", 1.0), ("b1", 2.0)], "does not depend on the constant `b1`"),
            ("a1 / (x - 0.5)", &[("a1", 1.0)], "at x = 0.5: division by zero"),
            ("a1", &[], "needs a constant"),
        ] {
            let error = reported(model, list);
            assert!(error.contains(expected), "{model}: {error}");
        }
    }
}
