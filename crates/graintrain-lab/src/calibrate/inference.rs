//! What the runs so far say about the parameters, and where to run next.

use super::gaussian_process::{GaussianProcess, Prediction};
use super::quasi_random::halton;
use graintrain_linalg::dense::{Cholesky, Matrix};

/// Points of a first look at the likelihood.
const POINTS: usize = 2048;
/// Most points of a look.
const MOST_POINTS: usize = 1 << 15;
/// Looks, each in the part of the last where the likelihood is.
const LOOKS: usize = 40;
/// Points that count, at least, in the last look.
const COUNTING: f64 = 400.0;
/// ln of how much less likely than the likeliest the points are that a look leaves out.
const NEGLIGIBLE: f64 = 14.0;
/// Share of a correlation that is not believed: there are few runs to know it from.
const UNBELIEVED: f64 = 0.1;
/// Sum of squares per aim from which on the aims are said not to be reached.
pub(super) const NOT_REACHED: f64 = 9.0;
/// Runs go where the likelihood to this power times what the surrogate does not know is largest: to the
/// flanks, too, not the top alone.
const TEMPER: f64 = 0.5;

/// One number to be reached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// It.
    pub value: f64,
    /// Its standard error; 0 where it is exact.
    pub error: f64,
}

/// What one run said.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Where, in the unit cube.
    pub point: Vec<f64>,
    /// The number of each aim; NaN where the run has none.
    pub values: Vec<f64>,
}

/// Surrogates of all aims.
#[derive(Clone, Debug)]
pub struct Surrogates {
    aims: Vec<Aim>,
    processes: Vec<GaussianProcess>,
    /// Correlation of the noise of the aims, n x n.
    correlation: Matrix,
    dimension: usize,
}

/// A distribution over the parameters, by points with weights.
#[derive(Clone, Debug)]
pub struct Distribution {
    /// Points of the unit cube.
    pub points: Vec<Vec<f64>>,
    /// Their weights, of sum 1.
    pub weights: Vec<f64>,
    /// The likeliest of them.
    pub likeliest: Vec<f64>,
    /// Sum of squares of the misses over their errors, correlations respected, at the likeliest point.
    pub chi_square: f64,
    /// Errors were multiplied by this, because there is no point with misses as small as they say.
    pub widened: f64,
    /// Whether no point reaches the aims: these are then the points nearest to them.
    pub is_missed: bool,
}

/// Points at which no run has a number for an aim.
fn silent_points(observations: &[Observation], aim: usize) -> Vec<Vec<f64>> {
    let speaks =
        |point: &[f64]| observations.iter().any(|run| run.point == point && run.values[aim].is_finite());
    observations.iter().filter(|run| !speaks(&run.point)).map(|run| run.point.clone()).collect()
}

impl Surrogates {
    /// From the runs so far.
    ///
    /// # Errors
    /// The index of an aim for which fewer than four runs have a number.
    pub fn new(aims: &[Aim], observations: &[Observation], dimension: usize) -> Result<Self, usize> {
        let mut processes = Vec::new();
        for k in 0..aims.len() {
            let (points, values): (Vec<Vec<f64>>, Vec<f64>) = observations
                .iter()
                .filter(|run| run.values[k].is_finite())
                .map(|run| (run.point.clone(), run.values[k]))
                .unzip();
            processes.push(GaussianProcess::new(points, &values).ok_or(k)?);
        }
        let correlation = noise_correlation(&processes, observations);
        Ok(Self { aims: aims.to_vec(), processes, correlation, dimension })
    }

    /// The surrogate of an aim.
    pub fn process(&self, aim: usize) -> &GaussianProcess {
        &self.processes[aim]
    }

    /// Predictions of all aims at points: by aim, then by point.
    fn predict(&self, at: &[Vec<f64>]) -> Vec<Vec<Prediction>> {
        self.processes.iter().map(|process| process.predict(at)).collect()
    }

    /// -2 ln of the likelihood of the aims at each point, and the sum of squares in it; variances of the aims
    /// times `widening`. The error of each surrogate is its own at the point, or one for all points where
    /// `common` has them.
    fn deviances(&self, at: &[Vec<f64>], widening: f64, common: Option<&[f64]>) -> Vec<(f64, f64)> {
        let predicted = self.predict(at);
        let m = self.aims.len();
        let covariance = |j: usize, i: usize, k: usize| {
            let error = |a: usize| common.map_or(predicted[a][j].error, |errors| errors[a]);
            let own = if i == k { self.aims[i].error.powi(2) + 1e-4 * error(i).powi(2) } else { 0.0 };
            widening * (own + self.correlation[(i, k)] * error(i) * error(k))
        };
        (0..at.len())
            .map(|j| {
                let miss = Matrix::from_fn(m, 1, |i, _| self.aims[i].value - predicted[i][j].value);
                let Ok(factor) = Cholesky::new(Matrix::from_fn(m, m, |i, k| covariance(j, i, k))) else {
                    return (f64::INFINITY, f64::INFINITY);
                };
                let mut solved = miss.clone();
                factor.solve_in_place(solved.view_mut());
                let square: f64 = miss.data().iter().zip(solved.data()).map(|(a, b)| a * b).sum();
                let determinant: f64 = (0..m).map(|i| 2.0 * factor.lower()[(i, i)].ln()).sum();
                (square + determinant, square)
            })
            .collect()
    }

    /// The distribution of the parameters, alike likely beforehand in the whole cube. Where there are more
    /// aims than parameters, and no point reaches them within their errors, all errors are widened until the
    /// best does (as in least squares with errors that are too small).
    ///
    /// Where the aims are out of reach, misses over the surrogates' own errors are smallest where the
    /// surrogates know least, which is no answer: the points are then those of the smallest misses over
    /// errors that are the same everywhere.
    pub fn distribution(&self) -> Distribution {
        let found = self.look(1.0, None);
        let limit = NOT_REACHED * self.aims.len() as f64;
        if found.chi_square <= limit {
            return self.widened(found, None);
        }
        let errors = self.typical_errors();
        let nearest = self.widened(self.look(1.0, Some(&errors)), Some(&errors));
        let chi_square = self.chi_square(&nearest.likeliest);
        if chi_square <= limit {
            // The surrogates do not know enough there to rule it out.
            return self.widened(found, None);
        }
        Distribution { chi_square, is_missed: true, ..nearest }
    }

    /// Sum of squares of the misses over their errors at a point.
    pub fn chi_square(&self, point: &[f64]) -> f64 {
        self.deviances(&[point.to_vec()], 1.0, None)[0].1
    }

    /// What `found` becomes with errors as wide as its misses ask for.
    fn widened(&self, found: Distribution, common: Option<&[f64]>) -> Distribution {
        let free = self.aims.len() as f64 - self.dimension as f64;
        let widening = if free > 0.0 { found.chi_square / free } else { 1.0 };
        if widening <= 1.0 || !widening.is_finite() {
            return found;
        }
        let wider = self.look(widening, common);
        Distribution { chi_square: found.chi_square, widened: widening.sqrt(), ..wider }
    }

    /// Root mean square over the cube of the error of each surrogate.
    fn typical_errors(&self) -> Vec<f64> {
        let cube: Vec<Vec<f64>> = (0..POINTS as u64 / 4).map(|k| halton(k, self.dimension)).collect();
        let mean_square = |list: &Vec<Prediction>| {
            list.iter().map(|predicted| predicted.error.powi(2)).sum::<f64>() / cube.len() as f64
        };
        self.predict(&cube).iter().map(|list| mean_square(list).sqrt()).collect()
    }

    /// Share of the distribution whose nearest run has no number for an aim, and the aim for which it is
    /// largest: there the surrogate only continues what it knows from elsewhere.
    pub fn silent_share(&self, distribution: &Distribution, observations: &[Observation]) -> (f64, usize) {
        let square = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let nearest = |point: &[f64], of: &[Vec<f64>]| {
            of.iter().map(|other| square(point, other)).fold(f64::INFINITY, f64::min)
        };
        let share = |aim: usize| {
            let silent = silent_points(observations, aim);
            let speaking: Vec<Vec<f64>> = observations
                .iter()
                .filter(|run| run.values[aim].is_finite())
                .map(|run| run.point.clone())
                .collect();
            distribution.mean(|u| f64::from(u8::from(nearest(u, &silent) < nearest(u, &speaking))))
        };
        (0..self.aims.len())
            .map(|aim| (share(aim), aim))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((0.0, 0))
    }

    /// Looks at the whole cube, then again and again at the box around what is likely, until enough points of
    /// a look count.
    fn look(&self, widening: f64, common: Option<&[f64]>) -> Distribution {
        let d = self.dimension;
        let (mut low, mut high, mut count) = (vec![0.0; d], vec![1.0; d], POINTS);
        let mut best: Option<Distribution> = None;
        for _ in 0..LOOKS {
            let place = |k: u64| -> Vec<f64> {
                halton(k, d).iter().enumerate().map(|(i, x)| low[i] + x * (high[i] - low[i])).collect()
            };
            let points: Vec<Vec<f64>> = (0..count as u64).map(place).collect();
            let deviances = self.deviances(&points, widening, common);
            let least = deviances.iter().map(|found| found.0).fold(f64::INFINITY, f64::min);
            let top = deviances.iter().position(|found| found.0 == least).unwrap_or(0);
            let raw: Vec<f64> =
                deviances.iter().map(|(deviance, _)| (-0.5 * (deviance - least)).exp()).collect();
            let raw: Vec<f64> = raw.iter().map(|w| if w.is_finite() { *w } else { 0.0 }).collect();
            let sum: f64 = raw.iter().sum();
            let weights: Vec<f64> = raw.iter().map(|w| w / sum.max(f64::MIN_POSITIVE)).collect();
            let counting = 1.0 / weights.iter().map(|w| w * w).sum::<f64>().max(f64::MIN_POSITIVE);
            let likeliest = points[top].clone();
            let chi_square = widening * deviances[top].1;
            // Boxes grow by the distance of neighbours, so that no part of what is likely is cut off.
            let gap = (count as f64).powf(-1.0 / d as f64);
            let mut inner = (vec![f64::INFINITY; d], vec![f64::NEG_INFINITY; d]);
            for (point, (deviance, _)) in points.iter().zip(&deviances) {
                if 0.5 * (deviance - least) < NEGLIGIBLE {
                    for i in 0..d {
                        inner.0[i] = inner.0[i].min(point[i]);
                        inner.1[i] = inner.1[i].max(point[i]);
                    }
                }
            }
            best =
                Some(Distribution { points, weights, likeliest, chi_square, widened: 1.0, is_missed: false });
            if counting >= COUNTING || !least.is_finite() {
                break;
            }
            let (mut shrunk, before) = (1.0, (low.clone(), high.clone()));
            for i in 0..d {
                let reach = gap * (before.1[i] - before.0[i]);
                low[i] = (inner.0[i] - reach).max(before.0[i]);
                high[i] = (inner.1[i] + reach).min(before.1[i]);
                shrunk *= (high[i] - low[i]) / (before.1[i] - before.0[i]);
            }
            if shrunk > 0.7 {
                if count >= MOST_POINTS {
                    break;
                }
                count *= 2;
            }
        }
        best.expect("there is at least one look")
    }

    /// Mean over the distribution of the share of the surrogate in the variance of each aim; the largest of
    /// these. 1 for an aim without an error. Where the aims are not reached, the miss counts as variance,
    /// too: what is certain to be out of reach does not come nearer by more runs.
    pub fn unknown_share(&self, distribution: &Distribution) -> f64 {
        let predicted = self.predict(&distribution.points);
        let share = |(aim, predicted): (&Aim, &Vec<Prediction>)| {
            let squares = predicted.iter().zip(&distribution.weights).map(|(p, w)| w * p.error.powi(2));
            let square: f64 = squares.sum();
            let misses =
                predicted.iter().zip(&distribution.weights).map(|(p, w)| w * (p.value - aim.value).powi(2));
            let miss: f64 = if distribution.is_missed { misses.sum() } else { 0.0 };
            square / (square + aim.error.powi(2) + miss).max(f64::MIN_POSITIVE)
        };
        self.aims.iter().zip(&predicted).map(share).fold(0.0, f64::max)
    }

    /// Where the next runs say most: one after the other where what the surrogates do not know, times how
    /// likely the point is, is largest, each taken as made for those after it. Where runs had no number for
    /// an aim, there is nothing to be learned of it. The last one goes where the surrogates know least in the
    /// whole cube, in case they are wrong about what is likely.
    pub fn next(
        &self,
        distribution: &Distribution,
        observations: &[Observation],
        count: usize,
    ) -> Vec<Vec<f64>> {
        let mut known = self.clone();
        for (aim, process) in known.processes.iter_mut().enumerate() {
            for point in silent_points(observations, aim) {
                *process = process.with_point(&point);
            }
        }
        let typical: Vec<f64> = known
            .predict(&distribution.points)
            .iter()
            .map(|list| list.iter().zip(&distribution.weights).map(|(p, w)| w * p.error.powi(2)).sum())
            .collect();
        let heaviest = distribution.weights.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let likely: Vec<(Vec<f64>, f64)> = distribution
            .points
            .iter()
            .zip(&distribution.weights)
            .map(|(point, weight)| (point.clone(), (weight / heaviest).powf(TEMPER)))
            .filter(|(_, weight)| *weight > 1e-3)
            .collect();
        let everywhere: Vec<(Vec<f64>, f64)> =
            (0..POINTS as u64 / 4).map(|k| (halton(k, self.dimension), 1.0)).collect();
        let mut chosen = Vec::new();
        for k in 0..count {
            let candidates = if k + 1 == count && count > 1 { &everywhere } else { &likely };
            let points: Vec<Vec<f64>> = candidates.iter().map(|(point, _)| point.clone()).collect();
            let predicted = known.predict(&points);
            let gain = |j: usize| -> f64 {
                let parts = predicted.iter().enumerate().map(|(a, list)| {
                    list[j].error.powi(2) / (self.aims[a].error.powi(2) + typical[a]).max(f64::MIN_POSITIVE)
                });
                candidates[j].1 * parts.sum::<f64>()
            };
            let best = (0..points.len()).max_by(|a, b| gain(*a).total_cmp(&gain(*b)));
            let Some(best) = best.map(|best| points[best].clone()) else { break };
            known.learn(std::slice::from_ref(&best));
            chosen.push(best);
        }
        chosen
    }

    fn learn(&mut self, points: &[Vec<f64>]) {
        for point in points {
            for process in &mut self.processes {
                *process = process.with_point(point);
            }
        }
    }
}

/// Correlation of the misses of the surrogates, each run predicted from the others, over runs that have all
/// numbers: numbers of one run, as along a curve, err together.
fn noise_correlation(processes: &[GaussianProcess], observations: &[Observation]) -> Matrix {
    let m = processes.len();
    let misses: Vec<Vec<f64>> = processes
        .iter()
        .enumerate()
        .map(|(k, process)| {
            let mut list = process.leave_one_out().into_iter();
            let of_run = |run: &Observation| {
                if run.values[k].is_finite() {
                    list.next().map_or(f64::NAN, |(miss, error)| miss / error)
                } else {
                    f64::NAN
                }
            };
            observations.iter().map(of_run).collect()
        })
        .collect();
    let whole: Vec<usize> =
        (0..observations.len()).filter(|run| misses.iter().all(|list| list[*run].is_finite())).collect();
    let product = |i: usize, k: usize| whole.iter().map(|run| misses[i][*run] * misses[k][*run]).sum::<f64>();
    Matrix::from_fn(m, m, |i, k| {
        let size = (product(i, i) * product(k, k)).sqrt();
        match i == k {
            true => 1.0,
            false if size > 0.0 => (1.0 - UNBELIEVED) * product(i, k) / size,
            false => 0.0,
        }
    })
}

impl Distribution {
    /// Mean of a function of the point.
    pub fn mean(&self, function: impl Fn(&[f64]) -> f64) -> f64 {
        self.points.iter().zip(&self.weights).map(|(point, weight)| weight * function(point)).sum()
    }

    /// Value of a function of the point below which this share of the distribution lies.
    pub fn quantile(&self, share: f64, function: impl Fn(&[f64]) -> f64) -> f64 {
        let mut list: Vec<(f64, f64)> =
            self.points.iter().zip(&self.weights).map(|(point, weight)| (function(point), *weight)).collect();
        list.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut below = 0.0;
        for (value, weight) in &list {
            below += weight;
            if below >= share {
                return *value;
            }
        }
        list.last().map_or(f64::NAN, |(value, _)| *value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand_pcg::Pcg64;

    fn normal(random: &mut Pcg64) -> f64 {
        (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
    }

    /// Calibrates against an analytic function with noise: first six or so points, then rounds of four.
    fn calibrate(
        function: &dyn Fn(&[f64]) -> Vec<f64>,
        noise: f64,
        aims: &[Aim],
        dimension: usize,
        runs: usize,
        random: &mut Pcg64,
    ) -> Distribution {
        let observe = |point: Vec<f64>, random: &mut Pcg64| {
            let values = function(&point).iter().map(|y| y + noise * normal(random)).collect();
            Observation { point, values }
        };
        let mut seen: Vec<Observation> =
            (0..4 + 2 * dimension as u64).map(|k| observe(halton(k, dimension), random)).collect();
        loop {
            let surrogates = Surrogates::new(aims, &seen, dimension).unwrap();
            let found = surrogates.distribution();
            if seen.len() >= runs {
                return found;
            }
            for point in surrogates.next(&found, &seen, 4) {
                seen.push(observe(point, random));
            }
        }
    }

    /// A straight line, noise of size 1, n values: the error of the abscissa where it is y is sqrt(error of
    /// y^2 + error of the line^2) / slope.
    #[test]
    fn a_line_has_a_closed_form() {
        let mut random = Pcg64::new(1, 1);
        let seen: Vec<Observation> = (0..60)
            .map(|k| {
                let u = f64::from(k) / 59.0;
                Observation { point: vec![u], values: vec![40.0 * u + normal(&mut random)] }
            })
            .collect();
        let aim = Aim { value: 16.0, error: 2.0 };
        let found = Surrogates::new(&[aim], &seen, 1).unwrap().distribution();
        let mean = found.mean(|u| u[0]);
        let sd = found.mean(|u| (u[0] - mean).powi(2)).sqrt();
        // The line at u = 0.4 is known to sqrt(1/60 + 0.1^2/5.2), far less than 2.
        let error = (4.0_f64 + 1.0 / 60.0 + 0.01 / 5.2).sqrt() / 40.0;
        assert!((mean - 0.4).abs() < 0.012, "{mean}");
        assert!((sd / error - 1.0).abs() < 0.1, "{sd} {error}");
        assert!((found.quantile(0.975, |u| u[0]) - mean - 1.96 * error).abs() < 0.012);
    }

    /// The answer lies in its 95 % interval as often as that says, whatever the noise: sixty calibrations
    /// against a curve that saturates.
    #[test]
    fn intervals_hold_what_they_promise() {
        let curve = |u: &[f64]| vec![18.0 + 12.0 * (1.0 - (-3.0 * u[0]).exp())];
        let (mut inside, mut all) = (0, 0);
        for seed in 0..20_u64 {
            for noise in [0.05, 0.3, 1.0] {
                let mut random = Pcg64::new(u128::from(seed), 7);
                let truth = 0.2 + 0.4 * random.random::<f64>();
                let error = 0.3;
                let aim = Aim { value: curve(&[truth])[0] + error * normal(&mut random), error };
                let found = calibrate(&curve, noise, &[aim], 1, 20, &mut random);
                let [low, high] = [0.025, 0.975].map(|share| found.quantile(share, |u| u[0]));
                inside += usize::from((low..=high).contains(&truth));
                all += 1;
            }
        }
        assert!(inside * 100 >= all * 90, "{inside} of {all}");
    }

    /// Two parameters from two numbers, and what a third run of the same tells about a function of both.
    #[test]
    fn two_parameters() {
        let both = |u: &[f64]| vec![(2.0 * u[0]).exp() + u[1], u[0] * u[1] + u[1] * u[1]];
        let truth = [0.62, 0.35];
        let exact = both(&truth);
        let aims: Vec<Aim> = exact.iter().map(|value| Aim { value: *value, error: 0.01 }).collect();
        let found = calibrate(&both, 0.01, &aims, 2, 32, &mut Pcg64::new(5, 1));
        for k in 0..2 {
            let mean = found.mean(|u| u[k]);
            let sd = found.mean(|u| (u[k] - mean).powi(2)).sqrt();
            assert!((mean - truth[k]).abs() < 3.0 * sd && sd < 0.03, "{k}: {mean} {sd}");
        }
        assert_eq!(found.widened, 1.0);
    }

    /// One number cannot tell two parameters: the answer is a curve of the square, and its error says so.
    #[test]
    fn what_is_not_determined_is_wide() {
        let sum = |u: &[f64]| vec![u[0] + u[1]];
        let found = calibrate(&sum, 1e-3, &[Aim { value: 1.0, error: 0.01 }], 2, 24, &mut Pcg64::new(9, 1));
        let mean = found.mean(|u| u[0]);
        let sd = found.mean(|u| (u[0] - mean).powi(2)).sqrt();
        assert!(sd > 0.2, "{mean} {sd}");
        let together = found.mean(|u| (u[0] + u[1] - 1.0).powi(2)).sqrt();
        assert!(together < 0.015, "{together}");
    }

    /// An aim beyond reach: the likeliest point is at the edge, and the misses say that it is no answer.
    #[test]
    fn aims_out_of_reach() {
        let line = |u: &[f64]| vec![u[0], 2.0 * u[0]];
        let aims = [Aim { value: 3.0, error: 0.1 }, Aim { value: 0.5, error: 0.1 }];
        let found = calibrate(&line, 1e-3, &aims, 1, 12, &mut Pcg64::new(2, 1));
        assert!(found.chi_square > 100.0 && found.widened > 5.0, "{} {}", found.chi_square, found.widened);
    }

    /// Beyond the end of a range, with runs that leave a gap: the nearest point is the end, not the gap,
    /// where the surrogate knows least.
    #[test]
    fn the_nearest_to_what_is_out_of_reach() {
        let seen: Vec<Observation> = [0.0, 0.05, 0.1, 0.2, 0.3, 0.8, 0.9, 0.95, 1.0]
            .map(|u: f64| Observation { point: vec![u], values: vec![1.0 / (0.2 + u)] })
            .to_vec();
        for error in [0.0, 0.1] {
            let surrogates = Surrogates::new(&[Aim { value: 7.0, error }], &seen, 1).unwrap();
            let found = surrogates.distribution();
            assert!(found.is_missed && found.likeliest[0] < 0.01, "{:?}", found.likeliest);
            // It is certain: no more runs are asked for.
            assert!(surrogates.unknown_share(&found) < 0.05);
        }
        let reached = Surrogates::new(&[Aim { value: 3.0, error: 0.1 }], &seen, 1).unwrap().distribution();
        assert!(!reached.is_missed && (reached.likeliest[0] - (1.0 / 3.0 - 0.2)).abs() < 0.02);
    }

    /// Runs with numbers in the lower half only: an answer in the upper half is a continuation, and new runs
    /// do not go to where runs were silent.
    #[test]
    fn where_no_run_has_a_number() {
        let run = |k: u32| {
            let u = f64::from(k) / 10.0;
            let first = if u < 0.45 { u } else { f64::NAN };
            Observation { point: vec![u], values: vec![first, 0.5 * u] }
        };
        let seen: Vec<Observation> = (0..=10).map(run).collect();
        let share = |value: f64| {
            let aims = [Aim { value, error: 0.01 }, Aim { value: 0.5 * value, error: 0.01 }];
            let surrogates = Surrogates::new(&aims, &seen, 1).unwrap();
            let found = surrogates.distribution();
            surrogates.silent_share(&found, &seen)
        };
        let (silent, aim) = share(0.8);
        assert!(silent > 0.9 && aim == 0, "{silent} {aim}");
        assert!(share(0.2).0 < 0.1);
        // A second run of a point speaks for it.
        let again = Observation { point: vec![1.0], values: vec![1.0, 0.5] };
        let points = silent_points(&[seen.as_slice(), &[again]].concat(), 0);
        assert_eq!(points.len(), 5);
        assert!(silent_points(&seen, 1).is_empty());
    }

    /// Numbers that err together do not tell more than one of them.
    #[test]
    fn a_curve_whose_points_err_together() {
        let mut random = Pcg64::new(4, 1);
        let seen: Vec<Observation> = (0..24)
            .map(|k| {
                let (u, common) = (halton(k, 1), 0.1 * normal(&mut random));
                let values = (0..20).map(|_| u[0] + common + 1e-3 * normal(&mut random)).collect();
                Observation { point: u, values }
            })
            .collect();
        let aim = |_| Aim { value: 0.5, error: 1e-3 };
        let many = Surrogates::new(&(0..20).map(aim).collect::<Vec<_>>(), &seen, 1).unwrap().distribution();
        let sd = |found: &Distribution| {
            let mean = found.mean(|u| u[0]);
            found.mean(|u| (u[0] - mean).powi(2)).sqrt()
        };
        // One value of a line through 24 points with noise 0.1: 0.1 / sqrt(24) = 0.02; independent ones would
        // have 0.0046.
        assert!((0.01..0.04).contains(&sd(&many)), "{}", sd(&many));
    }
}
