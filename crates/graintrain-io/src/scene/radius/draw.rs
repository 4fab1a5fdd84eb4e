//! Radii drawn from distributions.

use super::{Lognormal, Normal, OneOfSeveral, RadiusDistribution, RadiusForm, RosinRammler, Sieves, Uniform};
use crate::random::Random;
use graintrain_linalg::real;

/// Intervals in which densities that have no closed inverse are tabulated, evenly in the logarithm of the
/// radius.
const INTERVALS: usize = 512;

/// Draws before a value outside of the cut is clamped to it; half of all draws at least fall inside on one
/// side, so this is reached only by cuts that leave next to nothing of the distribution.
const MOST_DRAWS: usize = 1_000;

/// What draws radii of a distribution, one after the other; tables are made once.
type Sampler<'a> = Box<dyn Fn(&mut Random) -> f64 + 'a>;

/// Radii drawn from a distribution.
pub(crate) fn draw(distribution: &RadiusDistribution, count: usize, random: &mut Random) -> Vec<f64> {
    let draw = sampler(distribution);
    (0..count).map(|_| draw(random)).collect()
}

/// A radius drawn from a distribution.
pub(crate) fn one(distribution: &RadiusDistribution, random: &mut Random) -> f64 {
    sampler(distribution)(random)
}

fn sampler(distribution: &RadiusDistribution) -> Sampler<'_> {
    if distribution.by_mass { by_mass(&distribution.form) } else { by_number(&distribution.form) }
}

fn by_number(form: &RadiusForm) -> Sampler<'_> {
    match form {
        RadiusForm::Uniform(Uniform { min, max }) => Box::new(move |random| random.between(*min, *max)),
        RadiusForm::Normal(Normal { mean, deviation, min, max }) => {
            Box::new(move |random| within(*min, *max, || mean + deviation * random.normal()))
        }
        RadiusForm::Lognormal(Lognormal { median, deviation, min, max }) => {
            Box::new(move |random| within(*min, *max, || median * real::exp(deviation * random.normal())))
        }
        RadiusForm::Choice(OneOfSeveral { radii, weights }) => {
            Box::new(move |random| radii[chosen(weights, random)])
        }
        RadiusForm::RosinRammler(RosinRammler { size, spread, min, max }) => tabulated([*min, *max], |r| {
            real::powf(r / size, spread - 1.0) * real::exp(-real::powf(r / size, *spread))
        }),
        RadiusForm::Sieves(Sieves { openings, passing }) => {
            // Within a class mass goes with d(log r), and number with r^-4 dr.
            let class = |k: usize| {
                let (low, high) = (openings[k] / openings[0], openings[k + 1] / openings[0]);
                let mean = (low.powi(-3) - high.powi(-3)) / (3.0 * real::ln(high / low));
                (passing[k + 1] - passing[k]) * mean
            };
            let numbers: Vec<f64> = (0..openings.len() - 1).map(class).collect();
            Box::new(move |random| {
                let k = chosen(&numbers, random);
                power(-4.0, [0.5 * openings[k], 0.5 * openings[k + 1]], random)
            })
        }
    }
}

/// The first draw inside the cut.
fn within(min: f64, max: f64, mut draw: impl FnMut() -> f64) -> f64 {
    let mut value = draw();
    for _ in 1..MOST_DRAWS {
        if (min..=max).contains(&value) {
            break;
        }
        value = draw();
    }
    value.clamp(min, max)
}

/// A place of the list, each as often as its weight says.
fn chosen(weights: &[f64], random: &mut Random) -> usize {
    let mut left = random.uniform() * weights.iter().sum::<f64>();
    let chosen = weights.iter().position(|weight| {
        left -= weight;
        left < 0.0
    });
    let last = weights.iter().rposition(|&weight| weight > 0.0).unwrap_or(0);
    chosen.unwrap_or(last)
}

/// Radii of a distribution whose shares are meant by mass: the density by number goes with r^-3 times that by
/// mass.
fn by_mass(form: &RadiusForm) -> Sampler<'_> {
    match form {
        RadiusForm::Uniform(Uniform { min, max }) => {
            Box::new(move |random| power(-3.0, [*min, *max], random))
        }
        RadiusForm::Normal(Normal { mean, deviation, min, max }) if *deviation > 0.0 => {
            tabulated([*min, *max], |r| real::exp(-0.5 * ((r - mean) / deviation).powi(2)))
        }
        RadiusForm::Lognormal(Lognormal { median, deviation, min, max }) if *deviation > 0.0 => {
            tabulated([*min, *max], |r| real::exp(-0.5 * (real::ln(r / median) / deviation).powi(2)) / r)
        }
        RadiusForm::Choice(OneOfSeveral { radii, weights }) => {
            let [smallest, _] = form.range();
            let number = |(radius, weight): (&f64, &f64)| weight * (smallest / radius).powi(3);
            let numbers: Vec<f64> = radii.iter().zip(weights).map(number).collect();
            Box::new(move |random| radii[chosen(&numbers, random)])
        }
        same => by_number(same),
    }
}

/// A radius whose density by number goes with r^exponent (less than -1) between two.
fn power(exponent: f64, [min, max]: [f64; 2], random: &mut Random) -> f64 {
    let k = exponent + 1.0;
    let relative = 1.0 - random.uniform() * (1.0 - real::powf(max / min, k));
    (min * real::powf(relative, 1.0 / k)).clamp(min, max)
}

/// Radii whose density by mass (per radius, times anything) is given: number goes with that over r^3. The
/// cumulative number is summed by Simpson's rule over intervals of the logarithm and inverted by straight
/// lines.
fn tabulated<'a>([min, max]: [f64; 2], mass: impl Fn(f64) -> f64) -> Sampler<'a> {
    let width = real::ln(max / min) / INTERVALS as f64;
    // d(number) / d(log r)
    let density = |place: f64| {
        let radius = min * real::exp(place * width);
        mass(radius) * (min / radius).powi(2)
    };
    let mut sums = vec![0.0];
    for k in 0..INTERVALS {
        let place = k as f64;
        let part = density(place) + 4.0 * density(place + 0.5) + density(place + 1.0);
        sums.push(sums[k] + part);
    }
    Box::new(move |random| {
        let share = random.uniform() * sums[INTERVALS];
        let k = sums[1..INTERVALS].partition_point(|&sum| sum <= share);
        let inside = (share - sums[k]) / (sums[k + 1] - sums[k]).max(f64::MIN_POSITIVE);
        (min * real::exp((k as f64 + inside) * width)).clamp(min, max)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest difference of the shares of the mass up to each radius (Kolmogorov) from what they should be.
    fn difference(distribution: &RadiusDistribution, count: usize, expected: impl Fn(f64) -> f64) -> f64 {
        let mut radii = draw(distribution, count, &mut Random::new(3));
        radii.sort_by(f64::total_cmp);
        let [low, high] = distribution.range();
        assert!(radii[0] >= low && radii[count - 1] <= high);
        let all: f64 = radii.iter().map(|r| r.powi(3)).sum();
        let mut sum = 0.0;
        radii.iter().fold(0.0, |worst: f64, r| {
            sum += r.powi(3) / all;
            worst.max((sum - expected(*r)).abs())
        })
    }

    #[test]
    fn shares_by_mass_are_those_asked_for() {
        let count = 20_000;
        let (min, max) = (1e-3, 3e-3);
        let of = |form| RadiusDistribution { form, by_mass: true };
        let by_number = |form| RadiusDistribution { form, by_mass: false };
        let uniform = |r: f64| (r - min) / (max - min);
        assert!(difference(&of(RadiusForm::Uniform(Uniform { min, max })), count, uniform) < 0.02);
        // The same shares by number are far from that.
        assert!(difference(&by_number(RadiusForm::Uniform(Uniform { min, max })), count, uniform) > 0.2);
        let (size, spread) = (2e-3, 2.5);
        let passes = |r: f64| 1.0 - (-(r / size).powf(spread)).exp();
        let cut = |r: f64| (passes(r) - passes(min)) / (passes(max) - passes(min));
        assert!(
            difference(
                &by_number(RadiusForm::RosinRammler(RosinRammler { size, spread, min, max })),
                count,
                cut
            ) < 0.02
        );
        // By mass, a log-normal of the median m is one by number of the median m exp(-3 s^2) (Hatch and
        // Choate 1929).
        let deviation = 0.2;
        let own = of(RadiusForm::Lognormal(Lognormal { median: 2e-3, deviation, min: 5e-4, max: 6e-3 }));
        let shifted = 2e-3 * (-3.0 * deviation * deviation).exp();
        let mut radii = draw(&own, count, &mut Random::new(5));
        radii.sort_by(f64::total_cmp);
        assert!((radii[count / 2] / shifted - 1.0).abs() < 0.01, "{}", radii[count / 2]);
        assert!((radii[count / 40] / (shifted * (-1.96 * deviation).exp()) - 1.0).abs() < 0.02);
        let normal = of(RadiusForm::Normal(Normal { mean: 2e-3, deviation: 3e-4, min, max }));
        let mass = |range: &[f64]| range.iter().map(|r| r.powi(3)).sum::<f64>();
        let mut radii = draw(&normal, count, &mut Random::new(7));
        radii.sort_by(f64::total_cmp);
        let below = radii.partition_point(|r| *r < 2e-3);
        assert!((mass(&radii[..below]) / mass(&radii) - 0.5).abs() < 0.02);
    }

    #[test]
    fn sieves_and_choices_by_mass() {
        let radii = [0.25e-3, 0.5e-3, 1e-3, 2e-3];
        let openings = radii.map(|radius| 2.0 * radius).to_vec();
        let passing = vec![0.0, 0.1, 0.6, 1.0];
        let curve = |r: f64| {
            let k = radii[1..3].partition_point(|&opening| opening < r);
            passing[k] + (passing[k + 1] - passing[k]) * (r / radii[k]).ln() / (radii[k + 1] / radii[k]).ln()
        };
        let sieves = |openings: &[f64], passing: &[f64]| RadiusDistribution {
            form: RadiusForm::Sieves(Sieves { openings: openings.to_vec(), passing: passing.to_vec() }),
            by_mass: false,
        };
        assert!(difference(&sieves(&openings, &passing), 100_000, curve) < 0.02);
        let open = sieves(&openings, &[0.0, 0.0, 1.0, 1.0]);
        assert_eq!(open.range(), [0.5e-3, 1e-3]);
        assert!(draw(&open, 1000, &mut Random::new(1)).iter().all(|r| (0.5e-3..=1e-3).contains(r)));
        let form = RadiusForm::Choice(OneOfSeveral { radii: vec![1e-3, 2e-3], weights: vec![0.3, 0.7] });
        let drawn = draw(&RadiusDistribution { form, by_mass: true }, 50_000, &mut Random::new(2));
        let small = drawn.iter().filter(|r| **r < 1.5e-3).count() as f64;
        let large = drawn.len() as f64 - small;
        assert!((small / (small + 8.0 * large) - 0.3).abs() < 0.01);
    }
}
