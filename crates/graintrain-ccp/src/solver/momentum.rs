//! Nesterov's momentum for iterations that have no objective.

/// How long a momentum lasts. It restarts where the step points against the motion, and where theta, about half the iterations since the last restart, reaches a
/// limit. The limit grows as long as the steps are shorter than at the last restart, else it shrinks: with too long a one the iterates circle, with too short a one they creep.
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

    /// beta of the next point x+ + beta (x+ - x), after a step from y to x+ of this length, and with d^T (x+ - x) of its d = x+ - y.
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
