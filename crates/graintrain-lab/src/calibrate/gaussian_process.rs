//! The surrogate: a smooth function through noisy values at few points, with its own uncertainty.

use super::minimize::nelder_mead;
use graintrain_linalg::dense::{Cholesky, Matrix};

/// Lengths over which functions change, relative to the range of a parameter, are expected around here...
const LENGTH: f64 = 0.8;
/// ...within a factor of about exp of this.
const LENGTH_SPREAD: f64 = 0.8;
/// Bounds of ln(noise / rest): below the first, matrices are singular in double precision; above the second
/// all is noise.
const NOISE_BOUNDS: [f64; 2] = [-18.0, 9.0];
/// Most values of the likelihood per start of the search.
const EVALUATIONS: usize = 400;
/// Relative to the largest value: what rounding leaves of a value.
const ROUNDING: f64 = 1e-9;

/// A Gaussian process with a linear trend through values y_i = f(u_i) + noise of unknown strength:
///
/// f(u) = b_0 + b^T u + z(u), cov(z(u), z(u')) = s^2 (1 + h + h^2/3) exp(-h), h^2 = 5 sum_k ((u_k - u'_k) /
/// l_k)^2,
///
/// where the trend has no prior, and lengths l, variance s^2 and noise are the likeliest ones (restricted
/// likelihood, a wide prior on l).
///
/// Source: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", MIT Press 2006,
/// sections 2.7 and 5.4; leaving one out: O. Dubrule, "Cross validation of kriging in a unique neighborhood",
/// Mathematical Geology 15, 1983.
#[derive(Clone, Debug)]
pub struct GaussianProcess {
    points: Vec<Vec<f64>>,
    /// Values less `shift`, over `scale`.
    values: Vec<f64>,
    shift: f64,
    scale: f64,
    hyper: Hyper,
    system: System,
}

/// What the likelihood chooses.
#[derive(Clone, Debug, PartialEq)]
struct Hyper {
    /// Lengths, in units of the parameters' ranges.
    length: Vec<f64>,
    /// Share of the noise in the variance of a value.
    noise: f64,
}

/// Factorized equations of a set of points.
#[derive(Clone, Debug)]
struct System {
    /// Of K = (1 - noise) R + noise I, n x n.
    correlation: Cholesky,
    /// Trend X, n x p.
    trend: Matrix,
    /// K^-1 X.
    solved_trend: Matrix,
    /// Of X^T K^-1 X.
    trend_system: Cholesky,
    /// Coefficients of the trend.
    coefficients: Vec<f64>,
    /// K^-1 (y - X b).
    solved_residual: Vec<f64>,
    /// (y - X b)^T K^-1 (y - X b) / (n - p): s^2 and noise together.
    variance: f64,
    /// -2 ln of the restricted likelihood, less a constant.
    deviance: f64,
}

/// A value that the process predicts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Mean.
    pub value: f64,
    /// Standard deviation.
    pub error: f64,
}

/// (1 + h + h^2/3) exp(-h).
fn correlation(a: &[f64], b: &[f64], length: &[f64]) -> f64 {
    let square: f64 = a.iter().zip(b).zip(length).map(|((a, b), l)| ((a - b) / l).powi(2)).sum();
    let h = (5.0 * square).sqrt();
    (1.0 + h + h * h / 3.0) * (-h).exp()
}

/// The row of the trend at a point: 1 and, where there are enough values, the coordinates.
fn trend_row(point: &[f64], terms: usize) -> impl Iterator<Item = f64> {
    std::iter::once(1.0).chain(point.iter().copied()).take(terms)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl System {
    /// `None` where matrices are singular.
    fn new(points: &[Vec<f64>], values: &[f64], hyper: &Hyper, terms: usize) -> Option<Self> {
        let n = points.len();
        let share = 1.0 - hyper.noise;
        let entry = |i: usize, j: usize| {
            if i == j { 1.0 } else { share * correlation(&points[i], &points[j], &hyper.length) }
        };
        let factor = Cholesky::new(Matrix::from_fn(n, n, entry)).ok()?;
        let rows: Vec<Vec<f64>> = points.iter().map(|point| trend_row(point, terms).collect()).collect();
        let trend = Matrix::from_fn(n, terms, |i, j| rows[i][j]);
        let mut solved_trend = trend.clone();
        factor.solve_in_place(solved_trend.view_mut());
        let normal = Matrix::from_fn(terms, terms, |i, j| dot(trend.column(i), solved_trend.column(j)));
        let trend_system = Cholesky::new(normal).ok()?;
        let mut coefficients = Matrix::from_fn(terms, 1, |i, _| dot(solved_trend.column(i), values));
        trend_system.solve_in_place(coefficients.view_mut());
        let coefficients = coefficients.into_vec();
        let residual: Vec<f64> =
            values.iter().zip(&rows).map(|(y, row)| y - dot(row, &coefficients)).collect();
        let mut solved = Matrix::from_vec(n, 1, residual.clone());
        factor.solve_in_place(solved.view_mut());
        let solved_residual = solved.into_vec();
        let free = (n - terms) as f64;
        let variance = (dot(&residual, &solved_residual) / free).max(ROUNDING * ROUNDING);
        let logarithm = |factor: &Cholesky, size: usize| -> f64 {
            (0..size).map(|i| 2.0 * factor.lower()[(i, i)].ln()).sum()
        };
        let deviance = free * variance.ln() + logarithm(&factor, n) + logarithm(&trend_system, terms);
        deviance.is_finite().then_some(Self {
            correlation: factor,
            trend,
            solved_trend,
            trend_system,
            coefficients,
            solved_residual,
            variance,
            deviance,
        })
    }
}

impl GaussianProcess {
    /// Through values at points of the unit cube; points may coincide. `None` for fewer than four values, or
    /// values that are not finite.
    pub fn new(points: Vec<Vec<f64>>, values: &[f64]) -> Option<Self> {
        let n = values.len();
        if n < 4 || points.len() != n || values.iter().any(|y| !y.is_finite()) {
            return None;
        }
        let dimension = points[0].len();
        let largest = values.iter().fold(0.0_f64, |most, y| most.max(y.abs()));
        let shift = values.iter().sum::<f64>() / n as f64;
        let scatter = (values.iter().map(|y| (y - shift).powi(2)).sum::<f64>() / n as f64).sqrt();
        let scale = scatter.max(ROUNDING * largest).max(f64::MIN_POSITIVE);
        let values: Vec<f64> = values.iter().map(|y| (y - shift) / scale).collect();
        // A slope needs points that are apart.
        let terms = if n >= 2 * (dimension + 1) + 2 { dimension + 1 } else { 1 };
        let first = Hyper { length: vec![LENGTH; dimension], noise: 0.1 };
        let terms = if System::new(&points, &values, &first, terms).is_some() { terms } else { 1 };
        let hyper_of = |x: &[f64]| Hyper {
            length: x[..dimension].iter().map(|l| l.exp()).collect(),
            noise: 1.0 / (1.0 + (-x[dimension].clamp(NOISE_BOUNDS[0], NOISE_BOUNDS[1])).exp()),
        };
        let unlikely = |x: &[f64]| {
            let lengths: f64 =
                x[..dimension].iter().map(|l| ((l - LENGTH.ln()) / LENGTH_SPREAD).powi(2)).sum();
            let [low, high] = NOISE_BOUNDS;
            let beyond = (x[dimension] - x[dimension].clamp(low, high)).powi(2);
            match System::new(&points, &values, &hyper_of(x), terms) {
                Some(system) => system.deviance + lengths + beyond,
                None => f64::INFINITY,
            }
        };
        // The likelihood may have one top with much noise and a long length, and one with little noise and a
        // short one.
        let starts = [-9.0, -3.0, 1.0].into_iter().flat_map(|noise| [0.25, LENGTH, 2.0].map(|l| (l, noise)));
        let best = starts
            .map(|(length, noise)| {
                let start: Vec<f64> =
                    std::iter::repeat_n(f64::ln(length), dimension).chain([noise]).collect();
                nelder_mead(&unlikely, &start, 0.7, EVALUATIONS)
            })
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        let hyper = hyper_of(&best.0);
        let system = System::new(&points, &values, &hyper, terms)?;
        Some(Self { points, values, shift, scale, hyper, system })
    }

    /// The process after one more value, equal to what it predicts, with the same lengths and noise: only its
    /// uncertainty changes.
    #[must_use]
    pub fn with_point(&self, point: &[f64]) -> Self {
        let predicted = (self.predict(&[point.to_vec()])[0].value - self.shift) / self.scale;
        let points = self.points.iter().cloned().chain([point.to_vec()]).collect::<Vec<_>>();
        let values: Vec<f64> = self.values.iter().copied().chain([predicted]).collect();
        match System::new(&points, &values, &self.hyper, self.system.trend.columns()) {
            Some(mut system) => {
                system.variance = self.system.variance;
                Self { points, values, system, ..self.clone() }
            }
            None => self.clone(),
        }
    }

    /// Degrees of freedom n - p; the variance of a t distribution with so many is larger by d / (d - 2).
    fn widening(&self) -> f64 {
        let free = (self.values.len() - self.system.trend.columns()) as f64;
        free / (free - 2.0).max(1.0)
    }

    /// Predictions of f, the function without the noise, at points.
    pub fn predict(&self, at: &[Vec<f64>]) -> Vec<Prediction> {
        let (n, system) = (self.points.len(), &self.system);
        let share = 1.0 - self.hyper.noise;
        let cross = Matrix::from_fn(n, at.len(), |i, j| {
            share * correlation(&self.points[i], &at[j], &self.hyper.length)
        });
        let mut solved = cross.clone();
        system.correlation.solve_in_place(solved.view_mut());
        let terms = system.trend.columns();
        let mut lacking = Matrix::zeros(terms, 1);
        (0..at.len())
            .map(|j| {
                let row: Vec<f64> = trend_row(&at[j], terms).collect();
                let (r, solved_r) = (cross.column(j), solved.column(j));
                let value = dot(&row, &system.coefficients) + dot(r, &system.solved_residual);
                // x - X^T K^-1 r: what of the trend the values nearby do not tell.
                let left: Vec<f64> =
                    (0..terms).map(|k| row[k] - dot(system.solved_trend.column(k), r)).collect();
                lacking.data_mut().copy_from_slice(&left);
                system.trend_system.solve_in_place(lacking.view_mut());
                let variance = share - dot(r, solved_r) + dot(&left, lacking.data());
                let variance = (variance.max(0.0) * system.variance * self.widening()).max(ROUNDING.powi(2));
                Prediction { value: self.shift + self.scale * value, error: self.scale * variance.sqrt() }
            })
            .collect()
    }

    /// Standard deviation of the noise of a value.
    pub fn noise(&self) -> f64 {
        self.scale * (self.hyper.noise * self.system.variance).sqrt()
    }

    /// For every value its distance from what the others predict for it, and the standard deviation of that
    /// distance (noise included).
    pub fn leave_one_out(&self) -> Vec<(f64, f64)> {
        let (n, terms, system) = (self.points.len(), self.system.trend.columns(), &self.system);
        let mut inverse = Matrix::identity(n);
        system.correlation.solve_in_place(inverse.view_mut());
        (0..n)
            .map(|i| {
                let mut row = Matrix::from_fn(terms, 1, |k, _| system.solved_trend[(i, k)]);
                let own = row.clone();
                system.trend_system.solve_in_place(row.view_mut());
                // Diagonal of Q = K^-1 - K^-1 X (X^T K^-1 X)^-1 X^T K^-1.
                let q = inverse[(i, i)] - dot(own.data(), row.data());
                let q = q.max(ROUNDING);
                (self.scale * system.solved_residual[i] / q, self.scale * (system.variance / q).sqrt())
            })
            .collect()
    }

    /// Share of the scatter of the values that the others predict, from -infinity to 1; 0 where they are all
    /// the same.
    pub fn predicted_share(&self) -> f64 {
        let all: f64 = self.values.iter().map(|y| y * y).sum();
        // The scale is the scatter, unless that is rounding: there is nothing to predict then.
        if all < 0.5 * self.values.len() as f64 {
            return 0.0;
        }
        let left: f64 =
            self.leave_one_out().iter().map(|(distance, _)| (distance / self.scale).powi(2)).sum();
        1.0 - left / all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain_linalg::dense::Lu;
    use rand::RngExt;
    use rand_pcg::Pcg64;

    fn sample(count: usize, noise: f64, seed: u128) -> (Vec<Vec<f64>>, Vec<f64>) {
        let mut random = Pcg64::new(seed, 1);
        let points: Vec<Vec<f64>> =
            (0..count).map(|_| vec![random.random::<f64>(), random.random::<f64>()]).collect();
        let mut value = |p: &Vec<f64>| {
            let jitter: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            3.0 + (3.0 * p[0]).sin() + 0.5 * p[1] * p[1] + noise * jitter
        };
        let values = points.iter().map(&mut value).collect();
        (points, values)
    }

    /// The same by another way: a trend without prior is one with a prior of immense variance, added to the
    /// covariance; then mean = k^T C^-1 y, variance = c - k^T C^-1 k.
    #[test]
    fn predictions_are_those_of_one_large_covariance() {
        let (points, values) = sample(14, 0.05, 3);
        let process = GaussianProcess::new(points.clone(), &values).unwrap();
        let (hyper, immense, n) = (&process.hyper, 1e6, points.len());
        let covariance = |a: &[f64], b: &[f64]| {
            let trend: f64 = trend_row(a, 3).zip(trend_row(b, 3)).map(|(a, b)| a * b).sum();
            (1.0 - hyper.noise) * correlation(a, b, &hyper.length) + immense * trend
        };
        let noise = |i: usize, j: usize| if i == j { hyper.noise } else { 0.0 };
        let whole = Matrix::from_fn(n, n, |i, j| covariance(&points[i], &points[j]) + noise(i, j));
        let factor = Lu::new(whole).unwrap();
        for at in [[0.1, 0.9], [0.5, 0.5], [1.0, 0.0]] {
            let k = Matrix::from_fn(n, 1, |i, _| covariance(&points[i], &at));
            let mut solved = k.clone();
            factor.solve_in_place(solved.view_mut());
            let value = process.shift + process.scale * dot(solved.data(), &process.values);
            let variance = covariance(&at, &at) - dot(solved.data(), k.data());
            let error = process.scale * (variance * process.system.variance * process.widening()).sqrt();
            let found = process.predict(&[at.to_vec()])[0];
            assert!((found.value - value).abs() < 1e-5, "{found:?} {value}");
            assert!((found.error / error - 1.0).abs() < 1e-3, "{found:?} {error}");
        }
    }

    /// Leaving one out at a blow is leaving it out indeed.
    #[test]
    fn leaving_one_out() {
        let (points, values) = sample(12, 0.05, 5);
        let process = GaussianProcess::new(points.clone(), &values).unwrap();
        for (i, (distance, error)) in process.leave_one_out().into_iter().enumerate() {
            let without = |list: &[f64]| -> Vec<f64> {
                list.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, y)| *y).collect()
            };
            let rest: Vec<Vec<f64>> =
                points.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, p)| p.clone()).collect();
            let fewer = without(&process.values);
            let mut system = System::new(&rest, &fewer, &process.hyper, 3).unwrap();
            system.variance = process.system.variance;
            let smaller = GaussianProcess { points: rest, values: fewer, system, ..process.clone() };
            let found = smaller.predict(&[points[i].clone()])[0];
            assert!((values[i] - found.value - distance).abs() < 1e-9, "{i}");
            let variance = found.error.powi(2) / smaller.widening() + process.noise().powi(2);
            assert!((variance.sqrt() / error - 1.0).abs() < 1e-6, "{i}");
        }
    }

    /// Errors as large as they say, and noise as large as it is.
    #[test]
    fn errors_are_honest() {
        let truth = |p: &[f64]| 3.0 + (3.0 * p[0]).sin() + 0.5 * p[1] * p[1];
        let (mut inside, mut all, mut noise) = (0, 0, Vec::new());
        for seed in 0..20 {
            let (points, values) = sample(30, 0.1, 100 + seed);
            let process = GaussianProcess::new(points, &values).unwrap();
            noise.push(process.noise());
            for k in 0..9 {
                let at = vec![0.1 + 0.4 * f64::from(k % 3), 0.1 + 0.4 * f64::from(k / 3)];
                let found = process.predict(std::slice::from_ref(&at))[0];
                inside += usize::from((found.value - truth(&at)).abs() < 2.0 * found.error);
                all += 1;
            }
        }
        let share = inside as f64 / f64::from(all);
        assert!(share > 0.88, "{share}");
        noise.sort_by(f64::total_cmp);
        assert!((0.08..0.12).contains(&noise[10]), "{noise:?}");
    }

    #[test]
    fn odd_values() {
        let points: Vec<Vec<f64>> = (0..8).map(|k| vec![f64::from(k) / 7.0]).collect();
        let constant = GaussianProcess::new(points.clone(), &[5.0; 8]).unwrap();
        let found = constant.predict(&[vec![0.3]])[0];
        assert!((found.value - 5.0).abs() < 1e-6 && found.error < 1e-6, "{found:?}");
        for value in [5.0, 0.0, 0.1, 1e9 / 3.0] {
            let constant = GaussianProcess::new(points.clone(), &[value; 8]).unwrap();
            assert_eq!(constant.predicted_share(), 0.0, "{value}");
        }
        let line: Vec<f64> = points.iter().map(|p| 1e9 * (2.0 - p[0])).collect();
        let line = GaussianProcess::new(points.clone(), &line).unwrap();
        assert!(line.predicted_share() > 0.99);
        let found = line.predict(&[vec![0.55]])[0];
        assert!((found.value / 1.45e9 - 1.0).abs() < 1e-6, "{found:?}");
        assert!(GaussianProcess::new(points.clone(), &[f64::NAN; 8]).is_none());
        assert!(GaussianProcess::new(points[..3].to_vec(), &[1.0, 2.0, 3.0]).is_none());
        // The same point again and again.
        let same = vec![vec![0.5]; 8];
        let noisy: Vec<f64> = (0..8).map(|k| f64::from(k % 2)).collect();
        let found = GaussianProcess::new(same, &noisy).unwrap_or_else(|| panic!("no process"));
        assert!((found.predict(&[vec![0.5]])[0].value - 0.5).abs() < 1e-6);
    }
}
