//! Nesterov's momentum: extrapolation, and how long it lasts in iterations that have no objective.

use super::lanes::{Batch, Numbers, add_scaled, sub};

/// How long a momentum lasts: y+ = x+ + beta (x+ - x) with
///
/// ```text
/// theta+ = (1 + sqrt(1 + 4 theta^2)) / 2,   beta = (theta - 1) / theta+,   theta = 1 at first
/// ```
///
/// starts again from theta = 1 where the step points against the motion, and where theta, about half the
/// iterations since the last restart, exceeds a limit. The limit grows as long as steps are shorter than at
/// the last restart, else it shrinks: with too long a one the iterates circle, with too short a one they
/// creep.
#[derive(Clone, Debug)]
pub struct Memory {
    /// The first limit of theta.
    pub first: f64,
    /// Factor on the limit where the iterates get on.
    pub longer: f64,
    /// Factor on the limit where they do not.
    pub shorter: f64,
    /// Least and greatest limit.
    pub range: [f64; 2],
    /// A momentum whose theta is below this says nothing about the limit.
    pub young: f64,
}

/// The momentum of a solve.
pub(super) struct Momentum<'a> {
    memory: &'a Memory,
    theta: f64,
    /// The limit of theta now.
    pub limit: f64,
    last_length: f64,
}

impl<'a> Momentum<'a> {
    /// None so far; with the limit that an earlier solve ended with, where there was one.
    pub fn new(memory: &'a Memory, found: Option<f64>) -> Self {
        Self { memory, theta: 1.0, limit: found.unwrap_or(memory.first), last_length: f64::INFINITY }
    }

    /// beta of the next point x+ + beta (x+ - x), after a step from y to x+ of this length, and with d^T (x+
    /// - x) of its d = x+ - y.
    pub fn next(&mut self, length: f64, along: f64) -> f64 {
        if along < 0.0 || self.theta > self.limit {
            if self.theta > self.memory.young {
                let gets_on = length < self.last_length;
                let factor = if gets_on { self.memory.longer } else { self.memory.shorter };
                let [least, greatest] = self.memory.range;
                self.limit = (factor * self.limit).clamp(least, greatest);
                self.last_length = length;
            }
            self.theta = 1.0;
            return 0.0;
        }
        let (next, beta) = nesterov(self.theta);
        self.theta = next;
        beta
    }
}

/// theta+ = (1 + sqrt(1 + 4 theta^2)) / 2 and beta = (theta - 1) / theta+.
pub(super) fn nesterov(theta: f64) -> (f64, f64) {
    let next = 0.5 * (1.0 + (1.0 + 4.0 * theta * theta).sqrt());
    (next, (theta - 1.0) / next)
}

/// x + beta (x - previous).
#[inline(always)]
pub(super) fn extrapolated<V: Numbers>(x: &Batch<V>, previous: &Batch<V>, beta: f64) -> Batch<V> {
    add_scaled(x, beta, &sub(x, previous))
}

/// image <- image + beta (image - previous), previous <- image.
#[inline(always)]
pub(super) fn extrapolate<V: Numbers>(image: &mut [V], previous: &mut [V], beta: f64) {
    let beta = V::splat(beta);
    for (image, previous) in image.iter_mut().zip(previous) {
        let now = *image;
        *image = now + beta * (now - *previous);
        *previous = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MEMORY: Memory = Memory { first: 10.0, longer: 2.0, shorter: 0.5, range: [4.0, 30.0], young: 3.0 };

    /// Steps of this length until the momentum restarts.
    fn until_restart(momentum: &mut Momentum<'_>, length: f64) -> usize {
        (1..1000).find(|_| momentum.next(length, 1.0) == 0.0 && momentum.theta == 1.0).expect("it restarts")
    }

    #[test]
    fn the_limit_grows_while_steps_get_shorter_and_shrinks_where_they_do_not() {
        let mut momentum = Momentum::new(&MEMORY, None);
        // theta is about half of the iterations.
        let first = until_restart(&mut momentum, 1.0);
        assert!((15..25).contains(&first), "{first}");
        assert_eq!(momentum.limit, 20.0);
        until_restart(&mut momentum, 0.5);
        assert_eq!(momentum.limit, 30.0, "no longer than the range allows");
        for limit in [15.0, 7.5, 4.0, 4.0] {
            until_restart(&mut momentum, 2.0);
            assert_eq!(momentum.limit, limit);
        }
    }

    #[test]
    fn a_young_momentum_says_nothing_of_the_limit() {
        let mut momentum = Momentum::new(&MEMORY, Some(12.0));
        for _ in 0..3 {
            momentum.next(1.0, 1.0);
        }
        assert_eq!((momentum.next(1.0, -1.0), momentum.limit), (0.0, 12.0));
        // What is no number neither restarts nor breaks it.
        assert!(momentum.next(f64::NAN, f64::NAN).is_finite());
    }
}
