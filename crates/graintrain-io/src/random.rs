//! The source of everything random in scenes and runs: the same numbers on every machine and in every
//! version.

use graintrain::load::Region;
use graintrain::math::{Quat, Vec3, mix};
use graintrain_linalg::real;
use rand::Rng;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// A stream of random numbers fixed by its seed.
pub(crate) struct Random(Pcg64);

/// Stream constant of PCG's reference implementation.
const STREAM: u128 = 0x0a02_bdbf_7bb3_c0a7_ac28_fa16_a64a_bf96;

/// Increment of splitmix64: 2^64 / golden ratio.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

impl Random {
    /// Seeds differ in all bits of the state even where the given numbers differ in one.
    pub fn new(seed: u64) -> Self {
        let low = mix(seed.wrapping_add(GOLDEN));
        let high = mix(low.wrapping_add(GOLDEN));
        Self(Pcg64::new((u128::from(high) << 64) | u128::from(low), STREAM))
    }

    /// Uniform in [0, 1), a multiple of 2^-53.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Uniform in [low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Uniform over all rotations (K. Shoemake, "Uniform random rotations", Graphics Gems III, 1992).
    pub fn rotation(&mut self) -> Quat {
        let share = self.uniform();
        let [a, b] = [self.between(0.0, TAU), self.between(0.0, TAU)];
        let (low, high) = ((1.0 - share).sqrt(), share.sqrt());
        Quat::from_xyzw(low * real::sin(a), low * real::cos(a), high * real::sin(b), high * real::cos(b))
            .normalize()
    }

    /// A uniformly random centre of a ball wholly inside a region; `None` if the ball is too large for it.
    pub fn place(&mut self, region: &Region, radius: f64) -> Option<Vec3> {
        match *region {
            Region::Box { min, max } => {
                let (low, high) = (min + radius, max - radius);
                let [x, y, z] = [0, 1, 2].map(|axis| self.between(low[axis], high[axis]));
                low.cmple(high).all().then_some(Vec3::new(x, y, z))
            }
            Region::Cylinder { base, radius: outer, height } => {
                let reach = outer - radius;
                if reach < 0.0 || height < 2.0 * radius {
                    return None;
                }
                // Uniform over the disc: the area within a distance grows with its square.
                let distance = reach * self.uniform().sqrt();
                let angle = self.between(0.0, TAU);
                let z = self.between(radius, height - radius);
                Some(base + Vec3::new(distance * real::cos(angle), distance * real::sin(angle), z))
            }
        }
    }

    /// Standard normal (polar method of Marsaglia).
    pub fn normal(&mut self) -> f64 {
        loop {
            let (x, y) = (self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            let square = x * x + y * y;
            if square > 0.0 && square < 1.0 {
                return x * (-2.0 * real::ln(square) / square).sqrt();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_distributions() {
        let mut random = Random::new(1);
        let count = 200_000;
        let uniform: Vec<f64> = (0..count).map(|_| random.uniform()).collect();
        let normal: Vec<f64> = (0..count).map(|_| random.normal()).collect();
        let mean = |list: &[f64]| list.iter().sum::<f64>() / f64::from(count);
        let square = |list: &[f64]| list.iter().map(|x| x * x).sum::<f64>() / f64::from(count);
        assert!((mean(&uniform) - 0.5).abs() < 3e-3);
        assert!((square(&uniform) - 1.0 / 3.0).abs() < 3e-3);
        assert!(mean(&normal).abs() < 1e-2);
        assert!((square(&normal) - 1.0).abs() < 2e-2);
        assert!(uniform.iter().all(|x| (0.0..1.0).contains(x)));
    }

    #[test]
    fn neighbouring_seeds_are_unrelated() {
        let first: Vec<f64> = (0..1000).map(|seed| Random::new(seed).uniform() - 0.5).collect();
        let correlation: f64 = first.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / 999.0 * 12.0;
        assert!(correlation.abs() < 0.1, "{correlation}");
    }
}
