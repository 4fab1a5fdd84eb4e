//! Who decides: fresh points after every sweep, and more of them before anything is claimed.

use super::sample::{SLACK, Sample, Tally};
use super::{CrossSettings, EntrySource};
use crate::random::Random;
use crate::scale::binary_exponent;
use crate::{TtError, TtVector};
use std::sync::Arc;

/// A guide takes this part of the samples of a confirmation.
const GUIDE: usize = 8;
/// The points near pivots that go with a confirmation: this part of its samples.
const NEAR: usize = 4;
/// Where errors proved to sit on few points, a confirmation takes this part of the entries read so far ...
const CONFIRMATION: f64 = 0.2;
/// ... and all entries where they are no more than this part.
const COMPLETE: f64 = 1.0;
/// Both are doubled where fewer random entries than one in this many are not zero: the zeros say little about
/// the rest.
const SCARCE: usize = 20;
/// Most doublings of a confirmation.
const MOST_DOUBLINGS: usize = 6;
/// All that confirmations read beyond `samples` each is at most this part of what the sweeps read.
const ALLOWANCE: f64 = 0.4;
/// With fewer random entries that are not zero nothing is known of the error.
const FEWEST_NONZEROS: usize = 10;
/// More points than the bound asks for, since the next sample may be less lucky.
const MARGIN: f64 = 1.2;
/// Most points of one confirmation, for the sake of memory.
const MOST_POINTS: usize = 1 << 21;
/// The bounds of all confirmations of a run fail together with this probability.
const RISK: f64 = 0.05;

/// The points that measure a run.
pub(super) struct Confirmation<'a> {
    source: &'a dyn EntrySource,
    entries: f64,
    samples: usize,
    pivots: usize,
    random: Random,
    probe: Sample,
    /// All entries, once they have been read.
    everything: Option<Arc<Sample>>,
    /// The guide of the first sweep, drawn before it for the sake of the scale.
    first: Option<Sample>,
    tally: Tally,
    /// Whether the error after some sweep sat on few points.
    uneven: bool,
    confirmations: usize,
    /// Entries that confirmations read.
    confirmed: usize,
    tolerance: f64,
    /// Entries are taken times 2^-exponent.
    pub(super) exponent: i32,
    pub(super) evaluations: usize,
}

/// The points of one confirmation.
pub(super) struct Evidence {
    pub(super) random: Arc<Sample>,
    /// Points near pivots, all different: there the errors of functions with jumps are. They are no random
    /// points, so all that follows from them is that the error is at least what they hold.
    near: Option<Sample>,
}

/// What the points say about one train.
#[derive(Clone)]
pub(super) struct Verdict {
    pub(super) sampled: Option<f64>,
    pub(super) probed: Option<f64>,
    pub(super) bound: Option<f64>,
    pub(super) points: usize,
    pub(super) nonzeros: usize,
    pub(super) complete: bool,
    /// The points with the largest errors.
    pub(super) worst: Vec<Vec<usize>>,
}

impl Verdict {
    /// The larger of the errors that are known.
    pub(super) fn error(&self) -> Option<f64> {
        [self.sampled, self.probed].into_iter().flatten().reduce(f64::max)
    }

    /// Whether what was measured proves next to nothing: the bound does not exclude an error of everything,
    /// or hardly any entry that was read is not zero.
    pub(super) fn proves_little(&self) -> bool {
        let loose = self.bound.is_none_or(|bound| bound >= 1.0);
        !self.complete && (loose || self.nonzeros < FEWEST_NONZEROS)
    }

    /// Whether no measured error exceeds the tolerance (so also if there is none).
    pub(super) fn meets(&self, tolerance: f64) -> bool {
        self.error().is_none_or(|error| error <= tolerance)
    }
}

impl<'a> Confirmation<'a> {
    pub(super) fn new(
        source: &'a dyn EntrySource,
        probes: &[usize],
        settings: &CrossSettings,
    ) -> Result<Self, TtError> {
        let mut random = Random::new(settings.seed ^ 0x10D6E);
        let mut first = Sample::random(source, settings.samples.div_ceil(GUIDE), &mut random);
        let mut probe = Sample::at(source, probes.to_vec());
        // All values in units of the largest one seen so far (a power of two): squares neither overflow nor
        // vanish.
        let exponent = binary_exponent(first.largest()?.max(probe.largest()?));
        first.scale(-exponent);
        probe.scale(-exponent);
        let mut tally = Tally::default();
        tally.add(&first);
        Ok(Self {
            source,
            entries: source.modes().iter().map(|&n| n as f64).product(),
            samples: settings.samples,
            pivots: settings.kick_rank.max(1),
            random,
            evaluations: first.values.len() + probe.values.len(),
            probe,
            everything: None,
            first: Some(first),
            tally,
            uneven: false,
            confirmations: 0,
            confirmed: 0,
            tolerance: settings.tolerance,
            exponent,
        })
    }

    /// Whether no random entry and no probe so far is other than zero.
    pub(super) fn has_seen_zeros_only(&self) -> bool {
        self.tally.nonzeros == 0 && self.probe.mean_square() == 0.0
    }

    /// Counts and scales a new sample.
    fn take(&mut self, mut sample: Sample) -> Sample {
        sample.scale(-self.exponent);
        self.evaluations += sample.values.len();
        self.tally.add(&sample);
        sample
    }

    /// The train after a sweep on new points, which nobody will measure by again.
    pub(super) fn guide(&mut self, train: &TtVector) -> Result<Verdict, TtError> {
        let sample = match (&self.everything, self.first.take()) {
            (Some(everything), _) => Arc::clone(everything),
            (None, Some(first)) => Arc::new(first),
            (None, None) => {
                let count = self.samples.div_ceil(GUIDE);
                let sample = Sample::random(self.source, count, &mut self.random);
                Arc::new(self.take(sample))
            }
        };
        self.measure(train, &sample, None, self.pivots, None)
    }

    /// Points for a confirmation after the sweeps read `read` entries, and others that are nowhere near
    /// random: `near` makes them from the pivots.
    pub(super) fn fresh(&mut self, read: usize, near: impl FnOnce(usize) -> Vec<usize>) -> Evidence {
        self.confirmations += 1;
        let most = self.allowance(read).max(self.samples);
        let read = (read + self.evaluations) as f64;
        let factor = if self.tally.nonzeros * SCARCE < self.tally.points { 2.0 } else { 1.0 };
        let part =
            |share: f64| if self.uneven { (factor * share * read).min(MOST_POINTS as f64) } else { 0.0 };
        if let Some(everything) = &self.everything {
            return Evidence { random: Arc::clone(everything), near: None };
        }
        if self.samples > 0 && self.entries <= part(COMPLETE).max(self.samples as f64) {
            let sample = Sample::all(self.source, self.entries as usize);
            let everything = Arc::new(self.take(sample));
            self.everything = Some(Arc::clone(&everything));
            return Evidence { random: everything, near: None };
        }
        // What a confirmation found and the sweeps then learned has companions: the next one takes twice the
        // points.
        let doubled = self.samples << (self.confirmations - 1).min(MOST_DOUBLINGS);
        let count = if self.samples == 0 { 0 } else { doubled.max(part(CONFIRMATION) as usize).min(most) };
        let random = self.confirmation(count);
        let mut near = Sample::at(self.source, near(count / NEAR));
        near.scale(-self.exponent);
        self.evaluations += near.values.len();
        self.confirmed += near.values.len();
        Evidence { random, near: Some(near) }
    }

    /// `count` fresh points.
    fn confirmation(&mut self, count: usize) -> Arc<Sample> {
        let sample = Sample::random(self.source, count, &mut self.random);
        self.confirmed += count;
        Arc::new(self.take(sample))
    }

    /// Entries that confirmations may still read after the sweeps read `read`.
    fn allowance(&self, read: usize) -> usize {
        ((ALLOWANCE * read as f64) as usize).saturating_sub(self.confirmed).min(MOST_POINTS)
    }

    /// As many fresh points as bring the bound of a verdict that proves little below one; none where that is
    /// more than the sweeps, which read `read` entries, allow.
    pub(super) fn more(&mut self, evidence: Evidence, verdict: &Verdict, read: usize) -> (Evidence, bool) {
        let scarce = (FEWEST_NONZEROS as f64 / verdict.nonzeros.max(1) as f64).max(1.0);
        let factor = verdict.bound.map_or(f64::INFINITY, |bound| bound.powi(2).max(scarce));
        let needed = MARGIN * factor * verdict.points as f64;
        let allowed = self.allowance(read);
        let everything = (0.5 * (read + self.evaluations) as f64).max(allowed as f64);
        if self.samples > 0 && self.entries <= needed.min(everything) {
            return self.all_entries(usize::MAX).map_or((evidence, false), |all| (all, true));
        }
        if needed > allowed as f64 {
            return (evidence, false);
        }
        self.confirmations += 1;
        (Evidence { random: self.confirmation(needed as usize), near: evidence.near }, true)
    }

    /// All entries, where the sweeps and all samples have read as many already.
    pub(super) fn all_entries(&mut self, read: usize) -> Option<Evidence> {
        if self.everything.is_none() {
            if self.samples == 0
                || self.entries > read.saturating_add(self.evaluations).min(MOST_POINTS) as f64
            {
                return None;
            }
            let sample = Sample::all(self.source, self.entries as usize);
            self.everything = Some(Arc::new(self.take(sample)));
        }
        let everything = self.everything.as_ref()?;
        Some(Evidence { random: Arc::clone(everything), near: None })
    }

    /// The train on the points of a confirmation; `heaviest` is the largest squared entry times its weight
    /// that the sweeps read.
    pub(super) fn verdict(
        &mut self,
        train: &TtVector,
        evidence: &Evidence,
        heaviest: f64,
    ) -> Result<Verdict, TtError> {
        let samples = [Some(&*evidence.random), evidence.near.as_ref(), Some(&self.probe)];
        for sample in samples.into_iter().flatten() {
            sample.largest()?;
        }
        let most = samples.into_iter().flatten().fold(heaviest, |most, sample| sample.heaviest(most));
        self.measure(train, &evidence.random, evidence.near.as_ref(), 4 * self.pivots, Some(SLACK * most))
    }

    fn measure(
        &mut self,
        train: &TtVector,
        sample: &Sample,
        near: Option<&Sample>,
        worst: usize,
        most: Option<f64>,
    ) -> Result<Verdict, TtError> {
        let (check, probed) = (sample.check(train, worst)?, self.probe.check(train, worst)?);
        let points = sample.values.len();
        let complete = points as f64 == self.entries;
        let relative = |error: f64, mean: f64| (mean > 0.0).then(|| (error / mean).sqrt());
        let norm = if complete { sample.mean_square() } else { self.tally.mean() };
        let mut sampled = relative(check.mean, norm).filter(|_| points > 0);
        let mut worst_points = [check.worst, probed.worst].concat();
        if let Some(near) = near {
            let held = near.check(train, worst)?;
            let share = near.values.len() as f64 / self.entries;
            if let (Some(error), true) = (&mut sampled, norm > 0.0) {
                *error = error.max((held.mean * share / norm).sqrt());
            }
            worst_points.extend(held.worst);
        }
        self.uneven |= check.uneven && sampled.is_some_and(|error| error > self.tolerance);
        let nth = self.confirmations.max(1) as f64;
        let bound = match most {
            None => None,
            Some(_) if complete => sampled,
            // The risks of all confirmations together: sum of 1 / (n (n + 1)) = 1.
            Some(most) => {
                self.tally.bound(check.mean, points, most, check.heaviest, RISK / (nth * (nth + 1.0)))
            }
        };
        Ok(Verdict {
            sampled,
            probed: relative(probed.mean, self.probe.mean_square()),
            bound,
            points,
            nonzeros: sample.values.iter().filter(|x| **x != 0.0).count(),
            complete,
            worst: worst_points,
        })
    }
}
