//! A train through scattered data: values at some multi-indices, by alternating least squares with
//! validation.
//!
//! One core at a time minimises sum_p (x(i_p) - y_p)^2 + w ||G - G_before||^2: for each digit a small
//! least-squares problem whose rows are the Kronecker products of what lies left and right of the core (L.
//! Grasedyck, M. Kluge, S. Kraemer, SIAM J. Sci. Comput. 37, 2015). The ranks grow by one, by a train of rank
//! one through what is left over, while points that are held out are met better; a second set, which decides
//! nothing, gives the error that is reported. Alternating least squares can end far from the best train of
//! its rank: where the growth ends above the tolerance, the fit begins again from a random train of the rank
//! reached, and the best of all is the result, at the smallest rank that meets the validation points as well.
//!
//! Points know nothing of entries whose digits they hardly hold, whether they were fitted or held out. So
//! where the test points are met, the train is shaken, fitted again, and compared with itself over ALL
//! entries: what the points do not determine stays where the shaking put it.

use crate::confidence::farthest_mean;
use crate::error::at_core;
use crate::random::Random;
use crate::vector::{Core, check_index};
use crate::{Stop, Truncation, TtError, TtVector};
use graintrain_linalg::dense::{Cholesky, Matrix, ViewMut};
use graintrain_linalg::triangles::gram;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};

/// Weight of the core as it was, relative to the mean diagonal of the Gram matrix: what keeps digits with few
/// points in place.
const PROXIMITY: f64 = 1e-8;
/// Sweeps of the train of rank one through the residual that a higher rank begins with.
const DIRECTION_SWEEPS: usize = 4;
/// So many sweeps that together gain less than a part of the error end a rank.
const WINDOW: usize = 5;
/// That part.
const LEAST_GAIN: f64 = 2e-2;
/// The ranks stop to grow at this part of the tolerance, since the bound that decides lies above the error.
const TARGET: f64 = 0.2;
/// Fits from shaken cores, and the size of the noise in them relative to the root mean square of the core.
const SHAKES: (usize, f64) = (2, 0.3);
/// The bound fails with this probability.
const RISK: f64 = 0.05;
/// Fewer different points are not divided into three sets.
const LEAST_POINTS: usize = 10;
/// Ranks without a better validation error before the growth ends.
const PATIENCE: usize = 2;

/// Settings of [`fit`].
///
/// ```
/// let settings = graintrain_tt::fit::FitSettings::default();
/// assert_eq!((settings.tolerance, settings.max_rank, settings.max_sweeps, settings.restarts), (1e-6, 20, 100, 4));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitSettings {
    /// Relative error aimed at: the ranks stop to grow where the validation points are met to a fifth of it.
    pub tolerance: f64,
    /// No rank above this.
    pub max_rank: usize,
    /// Most sweeps per rank.
    pub max_sweeps: usize,
    /// Most new beginnings from random trains where the growth of the ranks ended above the tolerance.
    pub restarts: usize,
    /// Part of the points for validation, and the same part again for the test.
    pub held_out: f64,
    /// Seed of the partition and of the new directions.
    pub seed: u64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_rank: 20, max_sweeps: 100, restarts: 4, held_out: 0.1, seed: 1 }
    }
}

/// What [`fit`] found; errors are sqrt(sum (x(i_p) - y_p)^2 / sum y_p^2) over their points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Whether `error_estimate` is at most the tolerance.
    pub converged: bool,
    /// On the points that were fitted.
    pub training_error: f64,
    /// On the points that chose the rank: the best of several, so a little too good.
    pub validation_error: f64,
    /// On points that decided nothing, at indices of their own (several values at one index are kept
    /// together).
    pub test_error: f64,
    /// The larger of two estimates from above of the error over all entries. One is what the test points
    /// exclude with 95 % confidence, given that they are drawn evenly from all entries and that no entry is
    /// farther off than on the worst point. The other, made where the first meets the tolerance, is twice the
    /// largest distance over all entries to fits from shaken cores. Neither knows of a peak that no point
    /// hits.
    pub error_estimate: f64,
    /// Points of the three sets.
    pub points: [usize; 3],
    /// Validation error of every rank that was tried, all beginnings one after the other.
    pub history: Vec<f64>,
    /// New beginnings that were made.
    pub restarts: usize,
    /// Ranks of the result.
    pub ranks: Vec<usize>,
}

/// Points of one set: d digits each and a value.
#[derive(Default)]
struct Points {
    indices: Vec<usize>,
    values: Vec<f64>,
}

impl Points {
    /// The values less those of the train.
    fn residual(&self, train: &TtVector) -> Result<Vec<f64>, TtError> {
        let found = train.entries(&self.indices)?;
        Ok(self.values.iter().zip(found).map(|(y, x)| y - x).collect())
    }

    fn error(&self, train: &TtVector) -> Result<f64, TtError> {
        let (difference, size) = (squares(&self.residual(train)?), squares(&self.values));
        Ok(if difference == 0.0 { 0.0 } else { (difference / size.max(f64::MIN_POSITIVE)).sqrt() })
    }
}

fn squares(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

fn largest_square(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most: f64, x| most.max(x * x))
}

/// The train of these modes through values at indices (d digits per value, one point after the other).
/// O(sweeps d points r^4).
///
/// How many points a tensor needs nobody knows beforehand: at least as many as the train has numbers, several
/// times as many if they are random. The report's `test_error` is what the fit is worth, at points drawn like
/// the others; `error_estimate` is what this says of all entries.
///
/// # Errors
/// [`TtError::Shape`] or [`TtError::Index`] for points that do not fit, fewer than 10 different ones or an
/// empty mode; [`TtError::Setting`] for a bad setting; [`TtError::Dense`] for values that are not finite.
///
/// ```
/// use graintrain_tt::fit::{FitSettings, fit};
/// // 1 / (20 + i + j + k + l) on 10^4 entries from 3000 of them.
/// let f = |index: &[usize]| 1.0 / (20 + index.iter().sum::<usize>()) as f64;
/// let points: Vec<usize> = (0..3000).map(|p| p * 7919 % 10_007 % 10_000).collect();
/// let indices: Vec<usize> = points.iter().flat_map(|p| [p % 10, p / 10 % 10, p / 100 % 10, p / 1000]).collect();
/// let values: Vec<f64> = indices.chunks_exact(4).map(f).collect();
/// let settings = FitSettings { tolerance: 1e-2, ..Default::default() };
/// let (x, report) = fit(&[10; 4], &indices, &values, &settings)?;
/// assert!(report.converged, "{report:?}");
/// assert!((x.entry(&[3, 1, 4, 1])? - 1.0 / 29.0).abs() < 1e-3);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn fit(
    modes: &[usize],
    indices: &[usize],
    values: &[f64],
    settings: &FitSettings,
) -> Result<(TtVector, FitReport), TtError> {
    fit_within(modes, indices, values, settings, &|| false)
}

/// As [`fit`], as long as `stop` is false: it is asked before every sweep.
///
/// # Errors
/// As for [`fit`], and [`TtError::Stopped`].
pub fn fit_within(
    modes: &[usize],
    indices: &[usize],
    values: &[f64],
    settings: &FitSettings,
    stop: Stop<'_>,
) -> Result<(TtVector, FitReport), TtError> {
    Truncation::capped(settings.tolerance, settings.max_rank).check()?;
    if !(settings.held_out > 0.0 && settings.held_out <= 0.4) {
        return Err(TtError::Setting { what: "held_out", need: "in (0, 0.4]", got: settings.held_out });
    }
    let d = modes.len();
    if d == 0 || values.len() < LEAST_POINTS || values.len().checked_mul(d) != Some(indices.len()) {
        let got = vec![indices.len(), values.len()];
        return Err(TtError::Shape {
            what: "indices and at least 10 values",
            expected: vec![d, LEAST_POINTS],
            got,
        });
    }
    indices.chunks_exact(d).try_for_each(|index| check_index(modes, index))?;
    let different = indices.chunks_exact(d).collect::<HashSet<_>>().len();
    if different < LEAST_POINTS {
        return Err(TtError::Shape {
            what: "different indices",
            expected: vec![LEAST_POINTS],
            got: vec![different],
        });
    }
    let exponent = crate::scale::largest_finite(values).map_err(at_core(0))?;
    let unit = if exponent > 0.0 { exponent } else { 1.0 };
    let sets = partition(d, indices, values, unit, settings);
    let mut growth = Growth {
        training: &sets[0],
        validation: &sets[1],
        settings,
        stop,
        random: Random::new(settings.seed),
        best: (f64::INFINITY, TtVector::constant(modes, 0.0)?),
        history: Vec::new(),
    };
    let mean = squares(&sets[0].values) / sets[0].values.len() as f64;
    let size = mean.sqrt().max(f64::MIN_POSITIVE);
    growth.from(TtVector::constant(modes, size)?, 1)?;
    let mut restarts = 0;
    while restarts < settings.restarts && growth.best.0 > settings.tolerance {
        restarts += 1;
        // One rank less than the best so far, for what was too much for the points, and as much for what was
        // not.
        let rank = growth.best.1.max_rank().saturating_sub(restarts % 2).max(1);
        let start = TtVector::random(modes, rank, growth.random.next())?;
        let entries: f64 = modes.iter().map(|&n| n as f64).product();
        growth.from(start.scale(size * entries.sqrt() / start.norm()), rank)?;
    }
    growth.shorten()?;
    let (validation_error, x) = growth.best.clone();
    let mut error_estimate = error_estimate(&x, &sets)?;
    if error_estimate <= settings.tolerance {
        error_estimate = error_estimate.max(2.0 * growth.spread(&sets)?);
    }
    let history = growth.history;
    let report = FitReport {
        converged: false,
        training_error: sets[0].error(&x)?,
        validation_error,
        test_error: sets[2].error(&x)?,
        error_estimate,
        points: [0, 1, 2].map(|set: usize| sets[set].values.len()),
        history,
        restarts,
        ranks: x.ranks(),
    };
    let converged = error_estimate <= settings.tolerance;
    Ok((x.scale(unit), FitReport { converged, ..report }))
}

/// Trains of growing rank, and the one that meets the validation points best.
struct Growth<'a> {
    training: &'a Points,
    validation: &'a Points,
    settings: &'a FitSettings,
    stop: Stop<'a>,
    random: Random,
    best: (f64, TtVector),
    history: Vec<f64>,
}

impl Growth<'_> {
    /// Sweeps x, then lets its ranks grow, until the validation points are met or are met no better.
    fn from(&mut self, mut x: TtVector, first: usize) -> Result<(), TtError> {
        let Self { training, validation, settings, stop, .. } = *self;
        let (mut least, mut since) = (f64::INFINITY, 0);
        for rank in first..=settings.max_rank {
            if rank > first {
                let longer = x.add(&self.direction(&x)?)?;
                x = longer.round(&Truncation::to(1e-12))?.0;
            }
            x = swept(x, training, settings, stop)?;
            let error = validation.error(&x)?;
            self.history.push(error);
            if error < self.best.0 {
                self.best = (error, x.clone());
            }
            (least, since) = if error < least { (error, 0) } else { (least, since + 1) };
            if least <= TARGET * settings.tolerance || since >= PATIENCE || x.max_rank() < rank {
                break;
            }
        }
        Ok(())
    }

    /// Replaces the best train by one of smaller rank that meets the validation points as well: what is too
    /// much for the tensor is left to the noise of the points, and to nothing where there are none.
    fn shorten(&mut self) -> Result<(), TtError> {
        while self.best.1.max_rank() > 1 {
            let truncation = Truncation::capped(0.0, self.best.1.max_rank() - 1);
            let x = swept(self.best.1.round(&truncation)?.0, self.training, self.settings, self.stop)?;
            let error = self.validation.error(&x)?;
            if error > self.best.0.max(TARGET * self.settings.tolerance) {
                break;
            }
            self.best = (error, x);
        }
        Ok(())
    }

    /// The largest distance, relative and over all entries, of the best train from fits that begin with its
    /// cores and noise and see all points.
    fn spread(&mut self, sets: &[Points; 3]) -> Result<f64, TtError> {
        let all = Points {
            indices: sets.iter().flat_map(|set| set.indices.iter().copied()).collect(),
            values: sets.iter().flat_map(|set| set.values.iter().copied()).collect(),
        };
        let (x, mut largest) = (self.best.1.clone(), 0.0_f64);
        for _ in 0..SHAKES.0 {
            let mut shaken = x.clone();
            for core in &mut shaken.cores {
                let size = SHAKES.1 * (squares(&core.data) / core.data.len() as f64).sqrt();
                core.data.iter_mut().for_each(|entry| *entry += size * self.random.normal());
            }
            largest = largest.max(swept(shaken, &all, self.settings, self.stop)?.relative_distance(&x)?);
        }
        Ok(largest)
    }

    /// A train of rank one through what x leaves over.
    fn direction(&mut self, x: &TtVector) -> Result<TtVector, TtError> {
        let residual = Points { indices: self.training.indices.clone(), values: self.training.residual(x)? };
        let size = (squares(&residual.values) / residual.values.len() as f64).sqrt();
        let factor = |n: usize| (0..n).map(|_| self.random.normal()).collect::<Vec<_>>();
        let start = TtVector::rank_one(&x.modes().into_iter().map(factor).collect::<Vec<_>>())?;
        let mut direction = start.scale(size.max(f64::MIN_POSITIVE));
        for _ in 0..DIRECTION_SWEEPS {
            direction = sweep(&direction, &residual);
        }
        Ok(direction)
    }
}

/// See [`FitReport::error_estimate`].
fn error_estimate(x: &TtVector, sets: &[Points; 3]) -> Result<f64, TtError> {
    let (mut most, mut most_value, mut sum, mut count) = (0.0_f64, 0.0_f64, 0.0, 0);
    for set in sets {
        most = most.max(largest_square(&set.residual(x)?));
        most_value = most_value.max(largest_square(&set.values));
        sum += squares(&set.values);
        count += set.values.len();
    }
    let test = &sets[2];
    if most == 0.0 || test.values.is_empty() || most_value == 0.0 {
        return Ok(if most == 0.0 { 0.0 } else { f64::INFINITY });
    }
    let points = test.values.len();
    let error = squares(&test.residual(x)?) / points as f64;
    let worst = farthest_mean(error / most, 1.0, points, 0.5 * RISK) * most;
    let least = farthest_mean(sum / count as f64 / most_value, 0.0, count, 0.5 * RISK) * most_value;
    Ok(if least > 0.0 { (worst / least).sqrt() } else { f64::INFINITY })
}

/// The points for the fit, the validation and the test, values divided by `unit`; all values at one index go
/// to the same set, or the test would know its answers.
fn partition(d: usize, indices: &[usize], values: &[f64], unit: f64, settings: &FitSettings) -> [Points; 3] {
    let count = values.len();
    let mut order: Vec<usize> = (0..count).collect();
    let mut random = Random::new(settings.seed ^ 0xF17);
    (1..count).rev().for_each(|i| order.swap(i, random.below(i + 1)));
    let index = |p: usize| &indices[p * d..(p + 1) * d];
    let mut places = HashMap::new();
    for &p in &order {
        let next = places.len();
        places.entry(index(p)).or_insert(next);
    }
    let held = ((settings.held_out * places.len() as f64) as usize).max(1);
    let mut sets = [Points::default(), Points::default(), Points::default()];
    for &p in &order {
        let place = places[index(p)];
        let set = &mut sets[if place < held { 1 } else { 2 * usize::from(place < 2 * held) }];
        set.indices.extend_from_slice(index(p));
        set.values.push(values[p] / unit);
    }
    sets
}

/// Sweeps until they gain little.
fn swept(
    mut x: TtVector,
    points: &Points,
    settings: &FitSettings,
    stop: Stop<'_>,
) -> Result<TtVector, TtError> {
    let mut errors = Vec::new();
    for _ in 0..settings.max_sweeps {
        crate::go_on(stop)?;
        x = sweep(&x, points);
        let error = points.error(&x)?;
        let before = errors.len().checked_sub(WINDOW).map_or(f64::INFINITY, |k| errors[k]);
        errors.push(error);
        if error > (1.0 - LEAST_GAIN) * before || error <= 0.1 * TARGET * settings.tolerance {
            break;
        }
    }
    Ok(x)
}

/// One sweep over all cores, the centre moving along.
fn sweep(x: &TtVector, points: &Points) -> TtVector {
    let d = x.num_cores();
    let mut train = x.clone();
    train.orthogonalise_right();
    // What lies right of every core at every point.
    let mut right: Vec<Vec<f64>> = vec![vec![1.0; points.values.len()]; d];
    for k in (1..d).rev() {
        right[k - 1] = carried(&train.cores[k], &right[k], points, d, k, false);
    }
    let mut left = vec![1.0; points.values.len()];
    for k in 0..d {
        improve(&mut train.cores[k], &left, &right[k], points, d, k);
        if k + 1 < d {
            train.shift_right(k);
            left = carried(&train.cores[k], &left, points, d, k, true);
        }
    }
    train
}

/// The rows (or columns) of all points one core further: r numbers per point.
fn carried(core: &Core, rows: &[f64], points: &Points, d: usize, k: usize, forward: bool) -> Vec<f64> {
    let (from, to) = if forward { (core.left, core.right) } else { (core.right, core.left) };
    let mut next = Vec::with_capacity(points.values.len() * to);
    for (p, row) in rows.chunks_exact(from).enumerate() {
        let i = points.indices[p * d + k];
        let slice = core.slice(i);
        let entry = |a: usize, b: usize| if forward { slice.get(a, b) } else { slice.get(b, a) };
        next.extend((0..to).map(|b| row.iter().enumerate().map(|(a, x)| x * entry(a, b)).sum::<f64>()));
    }
    next
}

/// The core that meets the points best, near the one it was.
fn improve(core: &mut Core, left: &[f64], right: &[f64], points: &Points, d: usize, k: usize) {
    let (rl, rr, n) = (core.left, core.right, core.mode);
    let size = rl * rr;
    let mut of_digit: Vec<Vec<usize>> = vec![Vec::new(); n];
    (0..points.values.len()).for_each(|p| of_digit[points.indices[p * d + k]].push(p));
    for (i, list) in of_digit.iter().enumerate().filter(|(_, list)| !list.is_empty()) {
        let rows = Matrix::from_fn(size, list.len(), |e, column| {
            let p = list[column];
            left[p * rl + e % rl] * right[p * rr + e / rl]
        });
        let mut squares = gram(rows.t());
        let mean = (0..size).map(|e| squares[(e, e)]).sum::<f64>() / size as f64;
        let weight = PROXIMITY * mean;
        let place = |e: usize| e % rl + rl * (i + n * (e / rl));
        // In the change of the core, so that nothing is lost where it is small.
        let old: Vec<f64> = (0..size).map(|e| core.data[place(e)]).collect();
        let mut change = vec![0.0; size];
        for (column, &p) in list.iter().enumerate() {
            let row = rows.column(column);
            let rest = points.values[p] - row.iter().zip(&old).map(|(r, g)| r * g).sum::<f64>();
            change.iter_mut().zip(row).for_each(|(c, r)| *c += r * rest);
        }
        (0..size).for_each(|e| squares[(e, e)] += weight);
        // (All rows zero: these points say nothing about the core.)
        if let Ok(factor) = Cholesky::new(squares) {
            factor.solve_in_place(ViewMut::new(&mut change, size, 1));
            (0..size).for_each(|e| core.data[place(e)] = old[e] + change[e]);
        }
    }
}
