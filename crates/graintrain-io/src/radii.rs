//! Distributions of radii.

use crate::random::Random;
use serde::{Deserialize, Serialize};

/// Distribution of radii, m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RadiusDistribution {
    /// Uniform between two radii.
    Uniform {
        /// Smallest.
        min: f64,
        /// Largest.
        max: f64,
    },
    /// Normal, cut off.
    Normal {
        /// Before the cut.
        mean: f64,
        /// Standard deviation before the cut.
        deviation: f64,
        /// Smallest.
        min: f64,
        /// Largest.
        max: f64,
    },
    /// Log-normal, cut off.
    Lognormal {
        /// Before the cut.
        median: f64,
        /// Standard deviation of the logarithm.
        deviation: f64,
        /// Smallest.
        min: f64,
        /// Largest.
        max: f64,
    },
    /// One of several.
    Choice {
        /// The radii.
        radii: Vec<f64>,
        /// How often each is drawn.
        weights: Vec<f64>,
    },
}

impl RadiusDistribution {
    /// The same radius always.
    pub fn single(radius: f64) -> Self {
        Self::Choice { radii: vec![radius], weights: vec![1.0] }
    }

    /// Smallest and largest radius, m.
    pub fn range(&self) -> [f64; 2] {
        match self {
            Self::Uniform { min, max } | Self::Normal { min, max, .. } | Self::Lognormal { min, max, .. } => {
                [*min, *max]
            }
            Self::Choice { radii, weights } => {
                let drawn = radii.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
                drawn.fold([f64::INFINITY, 0.0], |[low, high], (radius, _)| {
                    [low.min(*radius), high.max(*radius)]
                })
            }
        }
    }
}

/// Draws before a value outside of the cut is clamped to it; half of all draws at least fall inside on one side, so
/// this is reached only by cuts that leave next to nothing of the distribution.
const MOST_DRAWS: usize = 1_000;

/// Radii drawn from a distribution.
pub(crate) fn draw(distribution: &RadiusDistribution, count: usize, random: &mut Random) -> Vec<f64> {
    (0..count).map(|_| one(distribution, random)).collect()
}

/// A radius drawn from a distribution.
pub(crate) fn one(distribution: &RadiusDistribution, random: &mut Random) -> f64 {
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
