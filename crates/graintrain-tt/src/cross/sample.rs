//! Points that the sweeps did not choose, and what they tell about the error.
//!
//! Half of the points are uniform. The other half falls where cross interpolation is weakest: on ends of
//! modes, and on grids on which all digits left or right of a bond stand at an end (in a quantized train
//! these are coarse sub-grids and the neighbourhoods of both ends of the line). A point drawn with density q
//! carries the weight u / q of the uniform density u, at most 2, so that weighted means are unbiased for
//! means over all entries, whatever the function.

use super::EntrySource;
use crate::confidence::farthest_mean;
use crate::random::Random;
use crate::scale::{largest_finite, scale_by_power};
use crate::{TtError, TtVector};

/// At least this part of the density is uniform.
const UNIFORM: f64 = 0.5;
/// Part of the density that has its digits at ends of modes, and as much on one side of a bond.
const AT_ENDS: f64 = 0.25;
/// How far below the largest squared entry times its weight an entry may lie without its weight being asked
/// for.
pub(super) const SLACK: f64 = 1.1;
/// An error is uneven if one point in this many holds most of it.
const FEW: usize = 20;
/// Share of the squared error that counts as most of it.
const MOST: f64 = 0.9;

/// Entries set aside for measuring the error.
pub(super) struct Sample {
    modes: Vec<usize>,
    /// d indices per point; empty if the sample holds all entries in their order.
    points: Vec<usize>,
    /// One per point; empty if all are 1.
    weights: Vec<f64>,
    pub(super) values: Vec<f64>,
}

/// What a sample says about a train.
#[derive(Clone, Default)]
pub(super) struct Check {
    /// Weighted mean of the squared errors.
    pub(super) mean: f64,
    /// Largest squared entry of the train on the points, times its weight.
    pub(super) heaviest: f64,
    /// Whether a few points hold most of the squared error.
    pub(super) uneven: bool,
    /// The points with the largest errors, worst first.
    pub(super) worst: Vec<Vec<usize>>,
}

impl Sample {
    /// The entries at given points, weights 1.
    pub(super) fn at(source: &dyn EntrySource, points: Vec<usize>) -> Self {
        let modes = source.modes();
        let mut values = vec![0.0; points.len() / modes.len()];
        source.entries(&points, &mut values);
        Self { modes, points, weights: Vec::new(), values }
    }

    /// `count` random points.
    pub(super) fn random(source: &dyn EntrySource, count: usize, random: &mut Random) -> Self {
        let modes = source.modes();
        let mut points = Vec::with_capacity(count * modes.len());
        (0..count).for_each(|_| push_point(&modes, random, &mut points));
        let weights = points.chunks_exact(modes.len()).map(|point| weight(&modes, point)).collect();
        Self { weights, ..Self::at(source, points) }
    }

    /// Every entry.
    pub(super) fn all(source: &dyn EntrySource, count: usize) -> Self {
        const PORTION: usize = 4096;
        let modes = source.modes();
        let mut values = vec![0.0; count];
        let mut points = Vec::with_capacity(PORTION * modes.len());
        let mut digits = vec![0; modes.len()];
        for answer in values.chunks_mut(PORTION) {
            points.clear();
            for _ in 0..answer.len() {
                points.extend_from_slice(&digits);
                for (digit, &n) in digits.iter_mut().zip(&modes) {
                    *digit += 1;
                    if *digit < n {
                        break;
                    }
                    *digit = 0;
                }
            }
            source.entries(&points, answer);
        }
        Self { modes, points: Vec::new(), weights: Vec::new(), values }
    }

    pub(super) fn largest(&self) -> Result<f64, TtError> {
        largest_finite(&self.values).map_err(|_| {
            let p = self.values.iter().position(|x| !x.is_finite()).unwrap_or(0);
            TtError::Entry { index: self.point(p), value: self.values[p] }
        })
    }

    pub(super) fn scale(&mut self, power: i32) {
        scale_by_power(&mut self.values, power);
    }

    fn weight(&self, p: usize) -> f64 {
        self.weights.get(p).copied().unwrap_or(1.0)
    }

    /// `most`, or the largest squared entry times the weight that its point has for the random samples, where
    /// that is larger (up to [`SLACK`]).
    pub(super) fn heaviest(&self, most: f64) -> f64 {
        heaviest(&self.modes, &self.values, most, |p| self.point(p))
    }

    fn point(&self, mut p: usize) -> Vec<usize> {
        let d = self.modes.len();
        if !self.points.is_empty() {
            return self.points[p * d..(p + 1) * d].to_vec();
        }
        let digit = |&n: &usize| {
            let digit = p % n;
            p /= n;
            digit
        };
        self.modes.iter().map(digit).collect()
    }

    /// Weighted mean of the squared entries; 0 for an empty sample.
    pub(super) fn mean_square(&self) -> f64 {
        let squares = self.values.iter().enumerate().map(|(p, x)| self.weight(p) * x * x);
        squares.sum::<f64>() / self.values.len().max(1) as f64
    }

    /// The error of the train on these points and the `count` worst of them.
    pub(super) fn check(&self, train: &TtVector, count: usize) -> Result<Check, TtError> {
        if self.values.is_empty() {
            return Ok(Check::default());
        }
        let approximate =
            if self.points.is_empty() { train.to_full()? } else { train.entries(&self.points)? };
        let errors: Vec<f64> = approximate.iter().zip(&self.values).map(|(a, b)| (a - b).abs()).collect();
        let mut squares: Vec<f64> = errors.iter().enumerate().map(|(p, e)| self.weight(p) * e * e).collect();
        let total: f64 = squares.iter().sum();
        let mut order: Vec<usize> = (0..errors.len()).filter(|&p| count > 0 && errors[p] > 0.0).collect();
        let largest_first = |a: &usize, b: &usize| errors[*b].total_cmp(&errors[*a]).then(a.cmp(b));
        if count > 0 && count < order.len() {
            order.select_nth_unstable_by(count, largest_first);
            order.truncate(count);
        }
        order.sort_by(largest_first);
        let few = squares.len() / FEW;
        if few > 0 {
            squares.select_nth_unstable_by(few, |a, b| b.total_cmp(a));
        }
        Ok(Check {
            mean: total / errors.len() as f64,
            heaviest: approximate
                .iter()
                .enumerate()
                .fold(0.0, |most, (p, x)| most.max(self.weight(p) * x * x)),
            uneven: squares[..few].iter().sum::<f64>() > MOST * total,
            worst: order.iter().map(|&p| self.point(p)).collect(),
        })
    }
}

/// Appends one random point.
fn push_point(modes: &[usize], random: &mut Random, points: &mut Vec<usize>) {
    let (d, start) = (modes.len(), points.len());
    points.extend(modes.iter().map(|&n| random.below(n)));
    let point = &mut points[start..];
    match random.below(4) {
        // Every digit at an end with probability one half.
        0 => {
            for (digit, &n) in point.iter_mut().zip(modes) {
                match random.below(4) {
                    0 => *digit = 0,
                    1 => *digit = n - 1,
                    _ => {}
                }
            }
        }
        // All digits on one side of a bond at the same end.
        1 if d > 1 => {
            let (bond, high, on_the_right) =
                (1 + random.below(d - 1), random.below(2) == 1, random.below(2) == 1);
            let fixed = if on_the_right { bond..d } else { 0..bond };
            fixed.for_each(|k| point[k] = if high { modes[k] - 1 } else { 0 });
        }
        _ => {}
    }
}

/// u / q of a point: the uniform density over that of [`push_point`].
fn weight(modes: &[usize], point: &[usize]) -> f64 {
    let d = modes.len();
    let at_ends: f64 = point
        .iter()
        .zip(modes)
        .map(|(&i, &n)| {
            let ends = f64::from(i == 0) + f64::from(i + 1 == n);
            0.5 + 0.25 * ends * n as f64
        })
        .product();
    let on_sides = if d == 1 {
        1.0
    } else {
        let run = |order: &mut dyn Iterator<Item = usize>, high: bool| {
            let (mut ratio, mut sum) = (1.0, 0.0);
            for k in order.take(d - 1) {
                if point[k] != if high { modes[k] - 1 } else { 0 } {
                    break;
                }
                ratio *= modes[k] as f64;
                sum += ratio;
            }
            sum
        };
        let runs: f64 =
            [false, true].map(|high| run(&mut (0..d), high) + run(&mut (0..d).rev(), high)).iter().sum();
        runs / (4 * (d - 1)) as f64
    };
    1.0 / (UNIFORM + AT_ENDS * at_ends + AT_ENDS * on_sides)
}

/// No weight exceeds this.
fn largest_weight(modes: &[usize]) -> f64 {
    // A mode of one or two digits has nothing but ends.
    let at_ends: f64 = modes.iter().map(|&n| if n > 2 { 0.5 } else { 1.0 }).product();
    1.0 / (UNIFORM + AT_ENDS * at_ends)
}

/// `most`, or the largest of the squared values times the weights of their points where that is larger: up to
/// a factor [`SLACK`], so that few weights have to be computed.
pub(super) fn heaviest(
    modes: &[usize],
    values: &[f64],
    most: f64,
    point: impl Fn(usize) -> Vec<usize>,
) -> f64 {
    let limit = largest_weight(modes);
    values.iter().enumerate().fold(most, |most, (p, x)| {
        if limit * x * x <= SLACK * most { most } else { most.max(weight(modes, &point(p)) * x * x) }
    })
}

/// Means of weighted squares over all random points so far: the norm of the tensor and how well it is known.
#[derive(Clone, Copy, Default)]
pub(super) struct Tally {
    sum: f64,
    pub(super) points: usize,
    pub(super) nonzeros: usize,
}

impl Tally {
    pub(super) fn add(&mut self, sample: &Sample) {
        self.sum += sample.mean_square() * sample.values.len() as f64;
        self.points += sample.values.len();
        self.nonzeros += sample.values.iter().filter(|x| **x != 0.0).count();
    }

    /// Mean of the squared entries.
    pub(super) fn mean(&self) -> f64 {
        self.sum / self.points.max(1) as f64
    }

    /// What the relative error does not exceed with probability 1 - `risk`, given that no squared entry of
    /// the tensor times the weight of its point exceeds `most`, and none of the train `reach`; `error` is the
    /// mean of weighted squared errors over `points` fresh points. None where the norm may be zero.
    pub(super) fn bound(&self, error: f64, points: usize, most: f64, reach: f64, risk: f64) -> Option<f64> {
        // The mean is of numbers that do not exceed `most`.
        let most = most.max(self.mean());
        let most_error = (most.sqrt() + reach.sqrt()).powi(2).max(error);
        if most == 0.0 {
            return None;
        }
        let least = farthest_mean(self.mean() / most, 0.0, self.points, 0.5 * risk) * most;
        let worst = farthest_mean(error / most_error, 1.0, points, 0.5 * risk) * most_error;
        (points > 0 && least > 0.0).then(|| (worst / least).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cross::Function;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn weights_are_the_densities_the_points_are_drawn_with(modes in prop::collection::vec(1usize..4, 1..4), seed in any::<u64>()) {
            // The weights of all points must give a probability density; frequencies must follow it.
            let total: usize = modes.iter().product();
            let all = Sample::all(&Function::new(&modes, |_| 1.0), total);
            let densities: Vec<f64> =
                (0..total).map(|p| 1.0 / (total as f64 * weight(&modes, &all.point(p)))).collect();
            prop_assert!((densities.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let most = (0..total).map(|p| weight(&modes, &all.point(p))).fold(0.0, f64::max);
            prop_assert!(most <= largest_weight(&modes));
            prop_assert!(all.heaviest(0.0) <= most && most <= SLACK * all.heaviest(0.0));
            let (count, mut random) = (20_000, Random::new(seed));
            let mut seen = vec![0.0; total];
            for _ in 0..count {
                let mut point = Vec::new();
                push_point(&modes, &mut random, &mut point);
                let place = point.iter().zip(&modes).rev().fold(0, |place, (i, n)| i + n * place);
                seen[place] += 1.0 / count as f64;
            }
            for (seen, density) in seen.iter().zip(&densities) {
                let deviation = (density / count as f64).sqrt();
                prop_assert!((seen - density).abs() < 6.0 * deviation, "{seen} {density}");
            }
        }
    }

    #[test]
    fn the_bound_holds_as_often_as_it_says() {
        // Errors on one point in 300: the bound must hold in 95 of 100 draws.
        let modes = [12; 4];
        let source = Function::new(&modes, |i: &[usize]| {
            1.0 + f64::from((i[0] * 1728 + i[1] * 144 + i[2] * 12 + i[3]) * 7919 % 301 == 7)
        });
        let train = TtVector::constant(&modes, 1.0).unwrap();
        let all = Sample::all(&source, 12usize.pow(4));
        let truth = (all.check(&train, 0).unwrap().mean / all.mean_square()).sqrt();
        let held = (0..200u64).filter(|&seed| {
            let sample = Sample::random(&source, 400, &mut Random::new(seed));
            let mut tally = Tally::default();
            tally.add(&sample);
            let check = sample.check(&train, 0).unwrap();
            let most = SLACK * all.heaviest(0.0);
            tally.bound(check.mean, 400, most, check.heaviest, 0.05).is_some_and(|bound| bound >= truth)
        });
        assert!(held.count() >= 190);
    }
}
