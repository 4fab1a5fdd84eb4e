//! What is asked of a calibration: which parameters in which ranges, to reach what.

use super::quasi_random::MOST_DIMENSIONS;
use crate::sweep::plan::{Plan, Setting};
use crate::sweep::{SweepError, read_table};
use graintrain_io::scene;
use graintrain_io::scene::quantity::{Dimension, Quantity};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Most points of a curve that are compared one by one; a longer one is averaged over neighbours.
const CURVE_POINTS: usize = 40;

/// A parameter or key of the scene, and where its value is looked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// The key, as after `--set`.
    pub key: String,
    /// Smallest value, SI.
    pub low: f64,
    /// Largest value, SI.
    pub high: f64,
    /// Whether values of all magnitudes are alike likely beforehand, instead of all values.
    pub logarithmic: bool,
}

/// A point of a measured curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Abscissa, SI.
    pub x: f64,
    /// Ordinate, SI.
    pub y: f64,
    /// Standard error of the ordinate, SI; 0 where there is none.
    pub error: f64,
}

/// What is to be reached.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Target {
    /// A number.
    Value {
        /// The observable, as in sweeps.
        observable: String,
        /// Its value, SI.
        value: f64,
        /// Standard error, SI; 0 where there is none.
        error: f64,
    },
    /// A curve.
    Curve {
        /// The observable, as in sweeps.
        observable: String,
        /// Name of the abscissa: a column of the same measurement, or a key of the scene.
        abscissa: String,
        /// Where it came from.
        file: PathBuf,
        /// The points.
        points: Vec<CurvePoint>,
    },
}

/// A question.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Question {
    /// Scene, settings and runs per point; it has no points of its own.
    pub plan: Plan,
    /// What is looked for.
    pub parameters: Vec<Parameter>,
    /// What is to be reached.
    pub targets: Vec<Target>,
    /// Means in time begin here, s.
    pub from: Option<f64>,
    /// Points per round after the first.
    pub batch: usize,
    /// Most points.
    pub most_points: usize,
}

fn wrong(problem: impl Into<String>) -> SweepError {
    SweepError::Plan(problem.into())
}

fn quantity(text: &str) -> Result<Quantity, String> {
    let found = scene::quantity(text.trim())?;
    if found.value.is_finite() { Ok(found) } else { Err("not a finite number".into()) }
}

fn number(text: &str) -> Result<f64, String> {
    quantity(text).map(|found| found.value)
}

/// Whether two keys are the same parameter of the scene: `mu` is `parameters.mu`.
pub(super) fn is_same_key(one: &str, other: &str) -> bool {
    let plain = |key: &str| key.strip_prefix("parameters.").unwrap_or(key).to_string();
    plain(one) == plain(other)
}

impl Parameter {
    /// From `KEY=LOW..HIGH` or `KEY=log:LOW..HIGH`, as after `--fit`; values may have units.
    ///
    /// # Errors
    /// [`SweepError::Plan`].
    pub fn parse(text: &str) -> Result<Self, SweepError> {
        let wrong = |why: &str| {
            wrong(format!("`{text}` is not of the form KEY=LOW..HIGH (or KEY=log:LOW..HIGH): {why}"))
        };
        let (key, range) = text.split_once('=').ok_or_else(|| wrong("there is no `=`"))?;
        let (logarithmic, range) = match range.trim().strip_prefix("log:") {
            Some(range) => (true, range),
            None => (false, range),
        };
        let (low, high) = range.split_once("..").ok_or_else(|| wrong("there is no `..`"))?;
        let [low, high] = [low, high].map(number);
        let (low, high) = (low.map_err(|why| wrong(&why))?, high.map_err(|why| wrong(&why))?);
        if key.trim().is_empty() {
            return Err(wrong("the key is empty"));
        }
        if low >= high {
            return Err(wrong("the lower end is not below the upper one"));
        }
        if logarithmic && low <= 0.0 {
            return Err(wrong("a logarithmic range is positive"));
        }
        Ok(Self { key: key.trim().to_string(), low, high, logarithmic })
    }

    /// The value at a coordinate from 0 to 1.
    pub fn value(&self, coordinate: f64) -> f64 {
        if self.logarithmic {
            self.low * (self.high / self.low).powf(coordinate)
        } else {
            self.low + coordinate * (self.high - self.low)
        }
    }

    /// The coordinate of a value.
    pub fn coordinate(&self, value: f64) -> f64 {
        if self.logarithmic {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    /// The value at a coordinate to five digits of the range: names of folders stay short.
    fn rounded(&self, coordinate: f64) -> f64 {
        let value = self.value(coordinate);
        let digits = |x: f64, unit: f64| {
            let place = 10_f64.powf(unit.abs().log10().floor() - 4.0);
            let text = format!("{:.*e}", 15, (x / place).round() * place);
            // To the nearest number with few digits.
            let short = format!("{:.9e}", text.parse::<f64>().unwrap_or(x));
            short.parse::<f64>().unwrap_or(x)
        };
        let value = if self.logarithmic { digits(value, value) } else { digits(value, self.high - self.low) };
        value.clamp(self.low, self.high)
    }
}

/// A number with its error after the last `+-` or `±`; the error may be a share in percent.
fn with_error(text: &str) -> Result<(f64, f64), String> {
    let parts = text.rsplit_once("+-").or_else(|| text.rsplit_once('±'));
    let Some((value, error)) = parts else { return Ok((number(text)?, 0.0)) };
    let value = quantity(value)?;
    Ok((value.value, error_of(value, error)?))
}

/// The error of a value: of its dimension, or a share in percent.
fn error_of(value: Quantity, text: &str) -> Result<f64, String> {
    let error = match text.trim().strip_suffix('%') {
        Some(share) => {
            let share = number(share)?;
            if share > 0.0 && value.value == 0.0 {
                return Err("a share of zero would make it exact: give the error as a number".into());
            }
            share / 100.0 * value.value.abs()
        }
        None => {
            let error = quantity(text)?;
            let is_zero = error.value == 0.0 && error.dimension == Dimension::NONE;
            if error.dimension != value.dimension && !is_zero {
                return Err(format!(
                    "the value is {}, its error {}: give both with their units",
                    value.dimension, error.dimension
                ));
            }
            error.value
        }
    };
    if error < 0.0 { Err("the error is negative".into()) } else { Ok(error) }
}

impl Target {
    /// From `OBSERVABLE=VALUE+-ERROR` or `OBSERVABLE=FILE.csv+-ERROR`, as after `--to`. A file has a header
    /// of the abscissa's name (a column of the same measurement, or a key of the scene), a name for the
    /// ordinate, and perhaps one for its standard error; names may have a unit in brackets, as in
    /// `displacement (mm)`.
    ///
    /// # Errors
    /// [`SweepError::Plan`], [`SweepError::Read`].
    pub fn parse(text: &str) -> Result<Self, SweepError> {
        let form = "is not of the form OBSERVABLE=VALUE+-ERROR or OBSERVABLE=FILE.csv";
        let bad = |why: &str| wrong(format!("`{text}` {form}: {why}"));
        let (observable, right) = text.split_once('=').ok_or_else(|| bad("there is no `=`"))?;
        let observable = observable.trim().to_string();
        if observable.is_empty() {
            return Err(bad("the observable is empty"));
        }
        let (file, common) = match right.split_once(".csv") {
            Some((stem, rest)) => (Some(format!("{}.csv", stem.trim())), rest.trim()),
            None => (None, right),
        };
        let Some(file) = file.map(PathBuf::from) else {
            let (value, error) = with_error(right).map_err(|why| bad(&why))?;
            return Ok(Self::Value { observable, value, error });
        };
        let common = match common.strip_prefix("+-").or_else(|| common.strip_prefix('±')) {
            Some(error) => Some(error.trim()),
            None if common.is_empty() => None,
            None => return Err(bad("something else than an error follows the file")),
        };
        let (abscissa, points) = read_curve(&file, common)?;
        Ok(Self::Curve { observable, abscissa, file, points })
    }

    /// The observable.
    pub fn observable(&self) -> &str {
        match self {
            Self::Value { observable, .. } | Self::Curve { observable, .. } => observable,
        }
    }
}

/// A heading like `displacement (mm)`: the name, and the unit of the numbers below it.
fn heading(text: &str) -> Result<(String, Quantity), String> {
    let text = text.trim();
    let found = [('(', ')'), ('[', ']')]
        .into_iter()
        .find_map(|(open, close)| text.strip_suffix(close)?.split_once(open));
    match found {
        Some((name, unit)) => Ok((name.trim().to_string(), quantity(&format!("1 {unit}"))?)),
        None => Ok((text.to_string(), Quantity::number(1.0))),
    }
}

/// The abscissa's name and the points of a file, in order of the abscissa.
fn read_curve(path: &Path, common: Option<&str>) -> Result<(String, Vec<CurvePoint>), SweepError> {
    let unreadable = |reason: String| SweepError::Read { path: path.to_path_buf(), reason };
    let table = read_table(path)?;
    if table.odd_lines > 0 {
        let problem =
            format!("{} of its lines have another number of cells than its header", table.odd_lines);
        return Err(unreadable(problem));
    }
    let [x, y, rest @ ..] = table.names() else {
        return Err(unreadable("a curve needs a header of two or three names and a line per point".into()));
    };
    if rest.len() > 1 {
        return Err(unreadable("it has more than three columns: abscissa, ordinate, error".into()));
    }
    let column = |name: &String| -> Result<(String, Dimension, Vec<f64>), SweepError> {
        let (plain, unit) = heading(name).map_err(|why| unreadable(format!("heading `{name}`: {why}")))?;
        let texts = table.texts(name).unwrap_or_default();
        let values = texts.iter().enumerate().map(|(k, text)| {
            number(text)
                .map(|x| x * unit.value)
                .map_err(|why| unreadable(format!("line {}, `{text}`: {why}", k + 2)))
        });
        Ok((plain, unit.dimension, values.collect::<Result<_, _>>()?))
    };
    let (abscissa, _, xs) = column(x)?;
    let (_, dimension, ys) = column(y)?;
    let errors = match (rest.first(), common) {
        (Some(_), Some(_)) => {
            return Err(unreadable("it has a column of errors, and `+-` gives another".into()));
        }
        (Some(name), None) => {
            let (_, own, errors) = column(name)?;
            if own != dimension {
                return Err(unreadable(format!(
                    "`{y}` is {dimension}, its error `{name}` {own}: give both with their units"
                )));
            }
            errors
        }
        (None, Some(text)) => {
            let of = |(x, y): (&f64, &f64)| {
                error_of(Quantity { value: *y, dimension }, text).map_err(|why| {
                    wrong(format!("{}, `+-{text}` at {abscissa} = {x}: {why}", path.display()))
                })
            };
            xs.iter().zip(&ys).map(of).collect::<Result<_, _>>()?
        }
        (None, None) => vec![0.0; ys.len()],
    };
    if xs.is_empty() || errors.iter().any(|error| *error < 0.0) {
        return Err(unreadable("it has no point, or a negative error".into()));
    }
    let mut points: Vec<CurvePoint> = xs
        .iter()
        .zip(&ys)
        .zip(&errors)
        .map(|((x, y), error)| CurvePoint { x: *x, y: *y, error: *error })
        .collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    if let Some(pair) = points.windows(2).find(|pair| pair[0].x == pair[1].x) {
        return Err(unreadable(format!("the abscissa {} stands twice", pair[0].x)));
    }
    Ok((abscissa, points))
}

/// At most so many points: neighbours are averaged, with the mean of their errors, for it is not known
/// whether they err together.
pub(super) fn thinned(points: &[CurvePoint]) -> Vec<CurvePoint> {
    let length = points.len().div_ceil(CURVE_POINTS).max(1);
    let mean = |part: &[CurvePoint], of: fn(&CurvePoint) -> f64| {
        part.iter().map(of).sum::<f64>() / part.len() as f64
    };
    let together = |part: &[CurvePoint]| CurvePoint {
        x: mean(part, |p| p.x),
        y: mean(part, |p| p.y),
        error: mean(part, |p| p.error),
    };
    points.chunks(length).map(together).collect()
}

impl Question {
    /// Looks at what does not need the scene.
    ///
    /// # Errors
    /// [`SweepError::Plan`] without parameters or targets, with too many parameters, one that is given twice
    /// or set, or too few points.
    pub fn validate(&self) -> Result<(), SweepError> {
        if self.parameters.is_empty() || self.targets.is_empty() {
            return Err(wrong("a calibration needs a parameter (--fit) and something to reach (--to)"));
        }
        if self.parameters.len() > MOST_DIMENSIONS {
            return Err(wrong(format!("at most {MOST_DIMENSIONS} parameters can be fitted at a time")));
        }
        for (k, parameter) in self.parameters.iter().enumerate() {
            if self.parameters[..k].iter().any(|other| is_same_key(&other.key, &parameter.key)) {
                return Err(wrong(format!("the parameter {} stands twice", parameter.key)));
            }
            if self.plan.settings.iter().any(|(key, _)| is_same_key(key, &parameter.key)) {
                let problem =
                    format!("{0} is both fitted and set: leave out --set {0} or --fit {0}", parameter.key);
                return Err(wrong(problem));
            }
        }
        if self.most_points < self.first_points() {
            let problem = format!(
                "{} points are too few: {} parameters need {} before the first round",
                self.most_points,
                self.parameters.len(),
                self.first_points()
            );
            return Err(wrong(problem));
        }
        Ok(())
    }

    /// Points before anything is known.
    pub fn first_points(&self) -> usize {
        4 + 2 * self.parameters.len()
    }

    /// A point of the unit cube whose values have few digits.
    pub fn rounded(&self, point: &[f64]) -> Vec<f64> {
        let coordinate = |(parameter, u): (&Parameter, &f64)| parameter.coordinate(parameter.rounded(*u));
        self.parameters.iter().zip(point).map(coordinate).collect()
    }

    /// The values of a point.
    pub fn values(&self, point: &[f64]) -> Vec<f64> {
        self.parameters.iter().zip(point).map(|(parameter, u)| parameter.value(*u)).collect()
    }

    /// The settings of a point.
    pub fn settings(&self, point: &[f64]) -> Vec<Setting> {
        let setting = |(parameter, u): (&Parameter, &f64)| {
            (parameter.key.clone(), format!("{:?}", parameter.rounded(*u)))
        };
        self.parameters.iter().zip(point).map(setting).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges() {
        let mu = Parameter::parse("mu=0.1..0.8").unwrap();
        assert_eq!((mu.key.as_str(), mu.low, mu.high, mu.logarithmic), ("mu", 0.1, 0.8, false));
        assert!((mu.coordinate(mu.value(0.3)) - 0.3).abs() < 1e-15);
        let load = Parameter::parse("load = log:1 kPa..1 MPa").unwrap();
        assert!((load.value(1.0 / 3.0) / 1e4 - 1.0).abs() < 1e-12 && load.logarithmic);
        assert_eq!(format!("{:?}", mu.rounded(1.0 / 3.0)), "0.33333");
        assert_eq!(format!("{:?}", load.rounded(0.5)), "31623.0");
        let rounded = mu.rounded(1.0 / 3.0);
        assert_eq!(mu.rounded(mu.coordinate(rounded)), rounded);
        for bad in ["mu", "mu=1", "mu=1..", "mu=2..1", "mu=log:0..1", "=0..1", "mu=a..b", "mu=0..inf"] {
            assert!(Parameter::parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn values_and_curves() {
        let value = |text: &str| match Target::parse(text).unwrap() {
            Target::Value { value, error, .. } => (value, error),
            Target::Curve { .. } => panic!("{text}"),
        };
        assert_eq!(value("heap.repose_angle:last=20+-0.5"), (20.0, 0.5));
        assert_eq!(value("a.b=-2e3±5%"), (-2e3, 100.0));
        let (angle, error) = value("a.b=20.3 deg+-0.5 deg");
        assert!((angle.to_degrees() - 20.3).abs() < 1e-12 && (error.to_degrees() - 0.5).abs() < 1e-12);
        assert_eq!(value("a.b=7"), (7.0, 0.0));
        assert_eq!(value("a.b=0+-0.1"), (0.0, 0.1));
        assert_eq!(value("a.b=7 kg+-0"), (7.0, 0.0));
        for (text, expected) in [
            ("a.b=0.17 kg+-0.003 s", "a mass (kg), its error a time (s)"),
            ("a.b=20.3+-0.5 deg", "a number without unit, its error an angle"),
            ("a.b=20.3 deg+-0.5", "an angle"),
            ("a.b=0+-5%", "a share of zero"),
        ] {
            let error = Target::parse(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
        for bad in ["a.b", "a.b=", "=1", "a.b=1+-", "a.b=1+--2", "a.b=none.csv", "a.b=x.csv7"] {
            assert!(Target::parse(bad).is_err(), "{bad}");
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("shear.csv");
        let curve = |text: &str, more: &str| {
            std::fs::write(&path, text).unwrap();
            match Target::parse(&format!("box.tau={}{more}", path.display())) {
                Ok(Target::Curve { abscissa, points, .. }) => Ok((abscissa, points)),
                Ok(Target::Value { .. }) => panic!("{text}"),
                Err(error) => Err(error.to_string()),
            }
        };
        let (abscissa, points) =
            curve("displacement (mm),tau [kPa],error [kPa]\n2,3,0.1\n1, 2,0.2\n", "").unwrap();
        assert_eq!(abscissa, "displacement");
        assert_eq!(points[0], CurvePoint { x: 1e-3, y: 2e3, error: 200.0 });
        let (_, points) = curve("x,y\n1,2\n", "+-10%").unwrap();
        assert!((points[0].error - 0.2).abs() < 1e-15);
        for (text, expected) in [
            ("x\n1\n", "two or three"),
            ("x,y\n1\n", "another number of cells"),
            ("x,y\n1,two\n", "line 2"),
            ("x,y\n1,2\n1,3\n", "twice"),
            ("x (qq),y\n1,2\n", "heading"),
            ("x,y\n", "no point"),
            ("x,y (mm),e (s)\n1,2,3\n", "a time"),
            ("x,y (mm),e\n1,2,3\n", "without unit"),
        ] {
            let error = curve(text, "").unwrap_err();
            assert!(error.contains(expected), "{text}: {error}");
        }
        for (more, expected) in
            [("+-5%", "at x = 0: a share of zero"), ("+-0.5 deg", "an angle"), ("+--1", "negative")]
        {
            let error = curve("x,y\n0,0\n1,2\n", more).unwrap_err();
            assert!(error.contains(expected), "{more}: {error}");
        }
        let (_, points) = curve("x,y (cm)\n1,2\n", "+-1 mm").unwrap();
        assert!((points[0].error - 1e-3).abs() < 1e-15);
        let many: Vec<CurvePoint> =
            (0..100).map(|k| CurvePoint { x: f64::from(k), y: 2.0 * f64::from(k), error: 0.5 }).collect();
        let few = thinned(&many);
        assert_eq!((few.len(), few[0]), (34, CurvePoint { x: 1.0, y: 2.0, error: 0.5 }));
    }
}
