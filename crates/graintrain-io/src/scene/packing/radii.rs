//! Distributions of radii.

use crate::scene::model::RadiusDistribution;
use crate::scene::random::Random;

/// Draws before a value outside of the cut is clamped to it; half of all draws at least fall inside on one side, so
/// this is reached only by cuts that leave next to nothing of the distribution.
const MOST_DRAWS: usize = 1_000;

/// Radii drawn from a distribution.
pub(crate) fn draw(distribution: &RadiusDistribution, count: usize, random: &mut Random) -> Vec<f64> {
    (0..count).map(|_| one(distribution, random)).collect()
}

fn one(distribution: &RadiusDistribution, random: &mut Random) -> f64 {
    match distribution {
        RadiusDistribution::Uniform { min, max } => random.between(*min, *max),
        RadiusDistribution::Normal { mean, deviation, min, max } => {
            within(*min, *max, || mean + deviation * random.normal())
        }
        RadiusDistribution::Lognormal { median, deviation, min, max } => {
            within(*min, *max, || median * (deviation * random.normal()).exp())
        }
        RadiusDistribution::Choice { radii, weights } => {
            let mut left = random.uniform() * weights.iter().sum::<f64>();
            let chosen = weights.iter().position(|weight| {
                left -= weight;
                left < 0.0
            });
            let last = weights.iter().rposition(|&weight| weight > 0.0).unwrap_or(0);
            radii[chosen.unwrap_or(last)]
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
