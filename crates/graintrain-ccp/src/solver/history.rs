//! The residual over iterations and seconds, in bounded memory.

use crate::residual::Residual;

/// One evaluation of the residual on the way.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ResidualSample {
    /// Iterations made before it, counted as [`SolveReport::iterations`](super::SolveReport::iterations).
    pub iteration: usize,
    /// Wall-clock seconds since the start of the solve.
    pub seconds: f64,
    /// Root mean square over the contacts.
    pub rms: f64,
    /// Worst contact.
    pub max: f64,
}

/// Samples kept at most, beside the last one.
const CAPACITY: usize = 256;

/// Every evaluation of the residual, or, where there are more than fit, every second one, every fourth and so
/// on, always with the last one. Its memory is allocated once.
#[derive(Clone, Debug)]
pub struct History {
    samples: Vec<ResidualSample>,
    /// Samples seen so far, and from one that is kept to the next.
    seen: usize,
    stride: usize,
    last: Option<ResidualSample>,
}

impl Default for History {
    fn default() -> Self {
        Self { samples: Vec::with_capacity(CAPACITY + 1), seen: 0, stride: 1, last: None }
    }
}

impl History {
    /// Adds a sample.
    pub fn record(&mut self, iteration: usize, seconds: f64, residual: Residual) {
        self.add(ResidualSample { iteration, seconds, rms: residual.rms, max: residual.max });
    }

    /// Adds the samples of a solver that began after so many iterations and seconds.
    pub fn append(&mut self, samples: &[ResidualSample], iterations: usize, seconds: f64) {
        for sample in samples {
            self.add(ResidualSample {
                iteration: iterations + sample.iteration,
                seconds: seconds + sample.seconds,
                ..*sample
            });
        }
    }

    fn add(&mut self, sample: ResidualSample) {
        self.last = Some(sample);
        if self.seen.is_multiple_of(self.stride) {
            if self.samples.len() == CAPACITY {
                let mut position = 0;
                self.samples.retain(|_| {
                    position += 1;
                    position % 2 == 1
                });
                self.stride *= 2;
            }
            if self.seen.is_multiple_of(self.stride) {
                self.samples.push(sample);
                self.last = None;
            }
        }
        self.seen += 1;
    }

    /// The samples in the order of their evaluation, for the report.
    pub fn into_samples(mut self) -> Vec<ResidualSample> {
        self.samples.extend(self.last);
        self.samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_history_is_thinned_evenly_and_keeps_its_ends() {
        for count in [0, 1, CAPACITY, CAPACITY + 1, 1000, 12_345] {
            let mut history = History::default();
            for k in 0..count {
                history.record(10 * k, k as f64, Residual { max: 1.0 / (k + 1) as f64, rms: 0.0 });
            }
            let samples = history.into_samples();
            assert!(samples.len() <= CAPACITY + 1 && samples.len() >= count.min(CAPACITY / 2));
            assert_eq!(samples.first().map(|s| s.iteration), (count > 0).then_some(0));
            assert_eq!(samples.last().map(|s| s.iteration), count.checked_sub(1).map(|last| 10 * last));
            let steps: Vec<usize> = samples.windows(2).map(|w| w[1].iteration - w[0].iteration).collect();
            let inner = &steps[..steps.len().saturating_sub(1)];
            assert!(inner.windows(2).all(|w| w[0] == w[1]), "{count}: {steps:?}");
        }
    }
}
