//! A train through scattered data: values at some multi-indices, by alternating least squares with a falling
//! threshold of the singular values, and validation.
//!
//! One core G at a time minimises
//!
//! sum_p (x(i_p) - y_p)^2 + (P / N) w^2 sum_ab (1 / s_a^2 + 1 / t_b^2) ||G(a, :, b)||^2
//!
//! with P points of N entries, s and t the singular values of the bonds on both sides and w a threshold that
//! falls from sweep to sweep (iteratively reweighted least squares with the weights of S. Kraemer,
//! "Asymptotic log-det rank minimization", 2021; the averaged steps of L. Grasedyck, S. Kraemer, "Stable ALS
//! approximation in the TT-format for rank-adaptive tensor completion", Numer. Math. 143, 2019, are of the
//! same form). If all entries were given, a singular value a would become (a + sqrt(a^2 - 4 w^2)) / 2, and
//! vanish below 2 w: what is larger than the threshold is fitted, what is smaller is left out until the
//! larger is right. So the ranks follow from the points, bond by bond: every singular value above w and
//! `MINOR` more. Without the penalty alternating least squares fit the missing entries' noise first: with
//! ranks growing by one they found 33 of 72 random trains in 3, 5 and 10 times as many points as degrees of
//! freedom (3, 9 and 21 of 24), this finds 65 (18, 23 and 24).
//!
//! Points that are held out choose the train of all sweeps and beginnings; a second set, which decides
//! nothing, gives the error that is reported. Points know nothing of entries whose digits they hardly hold,
//! whether they were fitted or held out. So the train is shaken, fitted again,
//! and compared with itself over ALL entries, and so are fits with one more rank and to either half of the
//! points: what the points do not determine differs.

use crate::confidence::farthest_mean;
use crate::error::at_core;
use crate::random::Random;
use crate::vector::{Core, admissible_ranks, check_index};
use crate::{Stop, Truncation, TtError, TtVector};
use graintrain_linalg::dense::{Cholesky, Matrix, View, ViewMut, product, thin_qr, thin_svd};
use graintrain_linalg::triangles::gram;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};

/// Weight of the core as it was, relative to the mean diagonal of the Gram matrix: what keeps digits with few
/// points in place.
const PROXIMITY: f64 = 1e-8;
/// The first threshold, relative to the norm of the tensor: above one half of it every singular value
/// vanishes.
const FIRST: f64 = 0.7;
/// The threshold falls by this factor per sweep, in every new beginning by a smaller one: what exceeds one is
/// multiplied by [`SLOWER`].
const FALL: f64 = 1.2;
/// See [`FALL`].
const SLOWER: f64 = 0.7;
/// Singular values below the threshold that every bond keeps: from them new directions grow.
const MINOR: usize = 2;
/// A beginning ends where the threshold has fallen by this factor without a better validation error ...
const GIVE_UP: f64 = 30.0;
/// ... or where the training error is below this part of the validation error: the points are fitted, the
/// tensor is not.
const OVERFITTED: f64 = 0.05;
/// So many sweeps that together gain less than a part of the error end a rank.
const WINDOW: usize = 5;
/// That part.
const LEAST_GAIN: f64 = 2e-2;
/// Fits aim at this part of the tolerance, since the bound that decides lies above the error.
const TARGET: f64 = 0.2;
/// Noise of shaken cores, relative to the root mean square of the core.
const SHAKE: f64 = 0.3;
/// The bound fails with this probability.
const RISK: f64 = 0.05;
/// Fewer different points are not divided into three sets.
const LEAST_POINTS: usize = 10;
/// Nodes of the search for the largest entry of a train.
const NODES: usize = 2000;

/// Settings of [`fit`].
///
/// ```
/// let settings = graintrain_tt::fit::FitSettings::default();
/// assert_eq!((settings.tolerance, settings.max_rank, settings.max_sweeps, settings.restarts), (1e-6, 20, 300, 4));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitSettings {
    /// Relative error aimed at: a fit ends where the validation points are met to a fifth of it.
    pub tolerance: f64,
    /// No rank above this.
    pub max_rank: usize,
    /// Most sweeps of every beginning, and of every fit at fixed ranks after it.
    pub max_sweeps: usize,
    /// Most new beginnings from other random trains where the validation error ended above the tolerance.
    pub restarts: usize,
    /// Part of the points for validation, and the same part again for the test.
    pub held_out: f64,
    /// Seed of the partition, the starts and the new directions.
    pub seed: u64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_rank: 20, max_sweeps: 300, restarts: 4, held_out: 0.1, seed: 1 }
    }
}

/// What [`fit`] found; errors are sqrt(sum (x(i_p) - y_p)^2 / sum y_p^2) over their points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Whether `error_estimate` is at most the tolerance.
    pub converged: bool,
    /// On the points that were fitted.
    pub training_error: f64,
    /// On the points that chose the train: the best of many, so a little too good.
    pub validation_error: f64,
    /// On points that decided nothing, at indices of their own (several values at one index are kept
    /// together).
    pub test_error: f64,
    /// The larger of two estimates from above of the error over all entries. One is what the test points
    /// exclude with 95 % confidence, given that they are drawn evenly from all entries and that no entry is
    /// farther off than on the worst point. The other is twice the
    /// largest distance over all entries to fits from shaken cores, with one more rank, and of half of the
    /// points. Neither knows of a peak that no point hits.
    pub error_estimate: f64,
    /// What the error over all entries does not exceed with 95 % confidence, given nothing but points drawn
    /// evenly from all entries and no entry of the tensor larger than the largest value. From n test points
    /// this is at least sqrt(15 / n) times that value over the root mean square: far above what
    /// `error_estimate` tells of tensors that behave between the points as at them. None where the points do
    /// not even tell the norm.
    pub upper_bound: Option<f64>,
    /// Points of the three sets.
    pub points: [usize; 3],
    /// Validation error after every sweep with a threshold, all beginnings one after the other.
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
    let mut search = Search {
        training: &sets[0],
        validation: &sets[1],
        settings,
        stop,
        random: Random::new(settings.seed),
        best: (f64::INFINITY, TtVector::constant(modes, 0.0)?),
        history: Vec::new(),
    };
    let mut restarts = 0;
    search.begin(modes, FALL)?;
    while restarts < settings.restarts && search.best.0 > settings.tolerance {
        restarts += 1;
        search.begin(modes, 1.0 + (FALL - 1.0) * SLOWER.powi(restarts as i32))?;
    }
    search.shorten()?;
    let (validation_error, x) = search.best.clone();
    let (from_test, upper_bound) = error_estimate(&x, &sets)?;
    let error_estimate = from_test.max(2.0 * search.spread(&sets)?);
    let history = search.history;
    let report = FitReport {
        converged: false,
        training_error: sets[0].error(&x)?,
        validation_error,
        test_error: sets[2].error(&x)?,
        error_estimate,
        upper_bound,
        points: [0, 1, 2].map(|set: usize| sets[set].values.len()),
        history,
        restarts,
        ranks: x.ranks(),
    };
    let converged = error_estimate <= settings.tolerance;
    Ok((x.scale(unit), FitReport { converged, ..report }))
}

/// Trains at falling thresholds, and the one that meets the validation points best.
struct Search<'a> {
    training: &'a Points,
    validation: &'a Points,
    settings: &'a FitSettings,
    stop: Stop<'a>,
    random: Random,
    best: (f64, TtVector),
    history: Vec<f64>,
}

impl Search<'_> {
    /// Sweeps from a train of rank one (constant in the first beginning, so that digits without points get
    /// what is likely, then random) with a threshold that falls by a factor of `fall`, and faster
    /// once the error lies below it; then, the largest singular values kept, sweeps without.
    fn begin(&mut self, modes: &[usize], fall: f64) -> Result<(), TtError> {
        let Self { training, validation, settings, stop, .. } = *self;
        let mean = squares(&training.values) / training.values.len() as f64;
        let root: f64 = modes.iter().map(|&n| (n as f64).sqrt()).product();
        let norm = mean.sqrt().max(f64::MIN_POSITIVE) * root;
        let start = match self.history.len() {
            0 => TtVector::constant(modes, 1.0)?,
            _ => TtVector::random(modes, 1, self.random.next())?,
        };
        let mut x = start.scale(norm / start.norm());
        let mut threshold =
            Threshold { size: FIRST * norm, max_rank: settings.max_rank, random: &mut self.random };
        let (mut best, mut since) = ((f64::INFINITY, x.clone()), threshold.size);
        for _ in 0..settings.max_sweeps {
            crate::go_on(stop)?;
            x = sweep(&x, training, Some(&mut threshold))?;
            let (fitted, error) = (training.error(&x)?, validation.error(&x)?);
            self.history.push(error);
            if error < best.0 {
                (best, since) = ((error, x.clone()), threshold.size);
            }
            if error <= TARGET * settings.tolerance
                || fitted < OVERFITTED * error
                || GIVE_UP * threshold.size < since
            {
                break;
            }
            threshold.size = (threshold.size / fall).min(fitted * norm);
        }
        if best.0 < self.best.0 {
            let truncation = Truncation::to((0.1 * best.0).min(0.5));
            let x = swept(best.1.round(&truncation)?.0, training, settings, stop)?;
            let error = validation.error(&x)?;
            self.best = if error < best.0 { (error, x) } else { best };
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

    /// The largest distance, relative and over all entries, of the best train from four fits that begin with
    /// it: with noise in its cores, with one more rank (what a longer train puts elsewhere, the ranks do not
    /// know), and to every other point.
    fn spread(&mut self, sets: &[Points; 3]) -> Result<f64, TtError> {
        let (x, mut largest) = (self.best.1.clone(), 0.0_f64);
        for (step, first, noise, rank) in [(1, 0, SHAKE, 0), (1, 0, 0.0, 1), (2, 0, 0.0, 0), (2, 1, 0.0, 0)] {
            let indices = sets.iter().flat_map(|set| set.indices.chunks_exact(x.num_cores()));
            let values = sets.iter().flat_map(|set| &set.values);
            let points = Points {
                indices: indices.skip(first).step_by(step).flatten().copied().collect(),
                values: values.skip(first).step_by(step).copied().collect(),
            };
            let mut other = x.clone();
            for core in &mut other.cores {
                let size = noise * (squares(&core.data) / core.data.len() as f64).sqrt();
                core.data.iter_mut().for_each(|entry| *entry += size * self.random.normal());
            }
            if rank > 0 {
                let more = TtVector::random(&x.modes(), rank, self.random.next())?;
                let size = self.best.0.max(f64::EPSILON) * x.norm() / more.norm();
                other = other.add(&more.scale(size))?;
            }
            largest = largest.max(swept(other, &points, self.settings, self.stop)?.relative_distance(&x)?);
        }
        Ok(largest)
    }
}

/// See [`FitReport::error_estimate`] (without what the spread says) and [`FitReport::upper_bound`].
fn error_estimate(x: &TtVector, sets: &[Points; 3]) -> Result<(f64, Option<f64>), TtError> {
    let (mut most, mut most_value, mut sum, mut count) = (0.0_f64, 0.0_f64, 0.0, 0);
    for set in sets {
        most = most.max(largest_square(&set.residual(x)?));
        most_value = most_value.max(largest_square(&set.values));
        sum += squares(&set.values);
        count += set.values.len();
    }
    let test = &sets[2];
    let points = test.values.len();
    let error = squares(&test.residual(x)?) / points.max(1) as f64;
    let mean = sum / count as f64;
    let least = if most_value > 0.0 {
        farthest_mean(mean / most_value, 0.0, count, 0.5 * RISK) * most_value
    } else {
        0.0
    };
    // No entry is farther off than `most`.
    let bound = |most: f64| {
        let worst = farthest_mean(error / most, 1.0, points, 0.5 * RISK) * most;
        (points > 0 && least > 0.0).then(|| (worst / least).sqrt())
    };
    let extremes = x.extremes(NODES)?;
    let reach = extremes.largest.bound.abs().max(extremes.smallest.bound.abs());
    let estimate = if most == 0.0 { Some(0.0) } else { bound(most) };
    Ok((estimate.unwrap_or(f64::INFINITY), bound((most_value.sqrt() + reach).powi(2))))
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
        x = sweep(&x, points, None)?;
        let error = points.error(&x)?;
        let before = errors.len().checked_sub(WINDOW).map_or(f64::INFINITY, |k| errors[k]);
        errors.push(error);
        if error > (1.0 - LEAST_GAIN) * before || error <= 0.1 * TARGET * settings.tolerance {
            break;
        }
    }
    Ok(x)
}

/// Singular values that are left out, and what new ones may grow from.
struct Threshold<'a> {
    size: f64,
    max_rank: usize,
    random: &'a mut Random,
}

impl Threshold<'_> {
    /// The weight of the penalty of entries between these singular values, without the factor of points per
    /// entry. (A singular value that is kept is no smaller than the threshold.)
    fn weight(&self, before: f64, after: f64) -> f64 {
        let part = |s: f64| (self.size / s.max(self.size)).powi(2);
        part(before) + part(after)
    }
}

/// One sweep over all cores, the centre moving along.
fn sweep(
    x: &TtVector,
    points: &Points,
    mut threshold: Option<&mut Threshold<'_>>,
) -> Result<TtVector, TtError> {
    let (d, count) = (x.num_cores(), points.values.len());
    let mut train = x.clone();
    train.orthogonalise_right();
    let most = threshold.as_ref().map(|threshold| admissible_ranks(&x.modes(), threshold.max_rank));
    // What lies right of every core at every point.
    let mut right: Vec<Vec<f64>> = vec![vec![1.0; count]; d];
    for k in (1..d).rev() {
        right[k - 1] = carried(&train.cores[k], &right[k], points, d, k, false);
    }
    let mut left = vec![1.0; count];
    let mut before = vec![f64::INFINITY];
    for k in 0..d {
        let mut after = vec![f64::INFINITY];
        if threshold.is_some() && k + 1 < d {
            // The basis of the bond on the right in which its singular values are seen.
            let svd = thin_svd(train.cores[k].left_unfolding()).map_err(at_core(k))?;
            train.cores[k] = train.cores[k].multiply_right(svd.v.view());
            train.cores[k + 1] = train.cores[k + 1].multiply_left(svd.v.t());
            right[k] = product(svd.v.t(), View::new(&right[k], svd.v.rows(), count)).into_vec();
            after = svd.s;
        }
        let share = count as f64 / x.num_entries();
        let penalty =
            |a: usize, b: usize| threshold.as_ref().map_or(0.0, |t| share * t.weight(before[a], after[b]));
        improve(&mut train.cores[k], &left, &right[k], points, (d, k), penalty);
        if k + 1 == d {
            break;
        }
        match (&mut threshold, &most) {
            (Some(threshold), Some(most)) => before = shift_right(&mut train, k, most[k + 1], threshold)?,
            _ => train.shift_right(k),
        }
        left = carried(&train.cores[k], &left, points, d, k, true);
    }
    Ok(train)
}

/// Moves the centre from core k to the next one, in the basis of the singular values of the bond, which are
/// returned: those above the threshold, `MINOR` more, and zeros of random directions where there are fewer.
fn shift_right(
    train: &mut TtVector,
    k: usize,
    most: usize,
    threshold: &mut Threshold<'_>,
) -> Result<Vec<f64>, TtError> {
    let core = &train.cores[k];
    let (left, mode, height) = (core.left, core.mode, core.left * core.mode);
    let mut svd = thin_svd(core.left_unfolding()).map_err(at_core(k))?;
    let major = svd.s.iter().filter(|&&s| s >= threshold.size).count();
    let rank = (major + MINOR).min(most).min(height);
    let kept = rank.min(svd.s.len());
    svd.u.truncate_columns(kept);
    let mut basis = svd.u.into_vec();
    basis.extend((kept * height..rank * height).map(|_| threshold.random.normal()));
    let (q, _) = thin_qr(Matrix::from_vec(height, rank, basis));
    let carry = product(q.t(), core.left_unfolding());
    train.cores[k] = Core::from_left_unfolding(left, mode, q);
    train.cores[k + 1] = train.cores[k + 1].multiply_left(carry.view());
    svd.s.resize(rank, 0.0);
    Ok(svd.s)
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

/// The core that meets the points best, near the one it was, with the penalty of its entries (a, :, b).
fn improve(
    core: &mut Core,
    left: &[f64],
    right: &[f64],
    points: &Points,
    (d, k): (usize, usize),
    penalty: impl Fn(usize, usize) -> f64,
) {
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
        for e in 0..size {
            let penalty = penalty(e % rl, e / rl);
            squares[(e, e)] += weight + penalty;
            change[e] -= penalty * old[e];
        }
        // (All rows zero: these points say nothing about the core.)
        if let Ok(factor) = Cholesky::new(squares) {
            factor.solve_in_place(ViewMut::new(&mut change, size, 1));
            (0..size).for_each(|e| core.data[place(e)] = old[e] + change[e]);
        }
    }
}
