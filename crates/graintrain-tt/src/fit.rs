//! A train through scattered data: values at some multi-indices, by alternating least squares with validation.
//!
//! One core at a time minimises sum_p (x(i_p) - y_p)^2 + w ||G - G_before||^2: for each digit a small least-squares problem whose rows are the Kronecker products
//! of what lies left and right of the core (L. Grasedyck, M. Kluge, S. Kraemer, SIAM J. Sci. Comput. 37, 2015). The ranks grow by one while points that
//! are held out are met better; a second set, which decides nothing, gives the error that is reported.

use crate::error::at_core;
use crate::random::Random;
use crate::vector::{Core, check_index};
use crate::{Truncation, TtError, TtVector};
use graintrain_linalg::dense::{Cholesky, Matrix, ViewMut};
use graintrain_linalg::triangles::gram;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};

/// Weight of the core as it was, relative to the mean diagonal of the Gram matrix: what keeps digits with few points in place.
const PROXIMITY: f64 = 1e-8;
/// Size of the directions that a higher rank begins with, relative to the train.
const NEW_DIRECTION: f64 = 1e-2;
/// Sweeps that gain less than this part of the error end a rank.
const LEAST_GAIN: f64 = 1e-2;
/// Fewer different points are not divided into three sets.
const LEAST_POINTS: usize = 10;
/// Ranks without a better validation error before the growth ends.
const PATIENCE: usize = 2;

/// Settings of [`fit`].
///
/// ```
/// let settings = graintrain_tt::fit::FitSettings::default();
/// assert_eq!((settings.tolerance, settings.max_rank, settings.max_sweeps, settings.held_out), (1e-6, 20, 30, 0.1));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitSettings {
    /// Relative error on the validation points at which the ranks stop to grow.
    pub tolerance: f64,
    /// No rank above this.
    pub max_rank: usize,
    /// Most sweeps per rank.
    pub max_sweeps: usize,
    /// Part of the points for validation, and the same part again for the test.
    pub held_out: f64,
    /// Seed of the partition and of the new directions.
    pub seed: u64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_rank: 20, max_sweeps: 30, held_out: 0.1, seed: 1 }
    }
}

/// What [`fit`] found; errors are sqrt(sum (x(i_p) - y_p)^2 / sum y_p^2) over their points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Whether the TEST error is at most the tolerance.
    pub converged: bool,
    /// On the points that were fitted.
    pub training_error: f64,
    /// On the points that chose the rank: the best of several, so a little too good.
    pub validation_error: f64,
    /// On points that decided nothing, at indices of their own (several values at one index are kept together).
    pub test_error: f64,
    /// Points of the three sets.
    pub points: [usize; 3],
    /// Validation error of every rank that was tried.
    pub history: Vec<f64>,
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
    fn error(&self, train: &TtVector) -> Result<f64, TtError> {
        let found = train.entries(&self.indices)?;
        let (mut difference, mut size) = (0.0, 0.0);
        for (x, y) in found.iter().zip(&self.values) {
            difference += (x - y).powi(2);
            size += y * y;
        }
        Ok(if difference == 0.0 { 0.0 } else { (difference / size.max(f64::MIN_POSITIVE)).sqrt() })
    }
}

/// The train of these modes through values at indices (d digits per value, one point after the other). O(sweeps d points r^4).
///
/// How many points a tensor needs nobody knows beforehand: at least as many as the train has numbers, several times as many if they are random. The
/// report's `test_error` is what the fit is worth, at points drawn like the others.
///
/// # Errors
/// [`TtError::Shape`] or [`TtError::Index`] for points that do not fit, fewer than 10 different ones or an empty mode; [`TtError::Setting`] for a bad setting;
/// [`TtError::Dense`] for values that are not finite.
///
/// ```
/// use graintrain_tt::fit::{FitSettings, fit};
/// // 1 / (1 + i + j + k + l) on 10^4 entries from 3000 of them.
/// let f = |index: &[usize]| 1.0 / (1 + index.iter().sum::<usize>()) as f64;
/// let points: Vec<usize> = (0..3000).map(|p| p * 7919 % 10_007 % 10_000).collect();
/// let indices: Vec<usize> = points.iter().flat_map(|p| [p % 10, p / 10 % 10, p / 100 % 10, p / 1000]).collect();
/// let values: Vec<f64> = indices.chunks_exact(4).map(f).collect();
/// let settings = FitSettings { tolerance: 1e-2, ..Default::default() };
/// let (x, report) = fit(&[10; 4], &indices, &values, &settings)?;
/// assert!(report.converged, "{report:?}");
/// assert!((x.entry(&[3, 1, 4, 1])? - 0.1).abs() < 1e-2);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn fit(
    modes: &[usize],
    indices: &[usize],
    values: &[f64],
    settings: &FitSettings,
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
    let mut x = TtVector::constant(modes, 0.0)?;
    let unit = if exponent > 0.0 { exponent } else { 1.0 };
    let [training, validation, test] = partition(d, indices, values, unit, settings);
    let mut random = Random::new(settings.seed);
    let mean = training.values.iter().map(|y| y * y).sum::<f64>() / training.values.len() as f64;
    x.cores[0].data.fill(mean.sqrt().max(f64::MIN_POSITIVE));
    let mut best = (f64::INFINITY, x.clone());
    let mut history = Vec::new();
    for rank in 1..=settings.max_rank {
        if rank > 1 {
            x = with_new_direction(&x, &mut random)?;
        }
        let mut before = f64::INFINITY;
        for _ in 0..settings.max_sweeps {
            x = sweep(&x, &training);
            let error = training.error(&x)?;
            if error > (1.0 - LEAST_GAIN) * before || error <= 0.1 * settings.tolerance {
                break;
            }
            before = error;
        }
        let error = validation.error(&x)?;
        history.push(error);
        if error < best.0 {
            best = (error, x.clone());
        }
        let since = history.len() - 1 - history.iter().position(|e| *e == best.0).unwrap_or(0);
        if best.0 <= settings.tolerance || since >= PATIENCE || x.max_rank() < rank {
            break;
        }
    }
    let (validation_error, x) = best;
    let (training_error, test_error) = (training.error(&x)?, test.error(&x)?);
    let points = [training.values.len(), validation.values.len(), test.values.len()];
    let ranks = x.ranks();
    let converged = test_error <= settings.tolerance;
    let report =
        FitReport { converged, training_error, validation_error, test_error, points, history, ranks };
    Ok((x.scale(unit), report))
}

/// The points for the fit, the validation and the test, values divided by `unit`; all values at one index go to the same set, or the test would know its answers.
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

/// x with all ranks one higher (where the modes allow it), by a small random train of rank one.
fn with_new_direction(x: &TtVector, random: &mut Random) -> Result<TtVector, TtError> {
    let modes = x.modes();
    let factor = |&n: &usize| (0..n).map(|_| random.normal()).collect::<Vec<_>>();
    let direction = TtVector::rank_one(&modes.iter().map(factor).collect::<Vec<_>>())?;
    let size = NEW_DIRECTION * x.norm() / direction.norm().max(f64::MIN_POSITIVE);
    x.add(&direction.scale(size))?.round(&Truncation::to(1e-12)).map(|(x, _)| x)
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
