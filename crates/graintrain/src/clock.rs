//! What a piece of a step takes: wall clock, processor time of all threads, and that of the thread that leads
//! it.

use crate::step_report::{PhaseSeconds, ProcessorSeconds};
use std::ops::Sub;
use std::time::Instant;

/// A moment.
#[derive(Clone, Copy)]
pub(crate) struct Clock {
    wall: Instant,
    /// Processor seconds so far, of all threads and of this one; NaN where the system does not tell.
    processor: [f64; 2],
}

/// Seconds between two moments.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Lap {
    wall: f64,
    /// Of all threads and of the leading one.
    processor: [f64; 2],
}

/// Seconds by phase.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Laps {
    wall: PhaseSeconds,
    all: PhaseSeconds,
    leading: PhaseSeconds,
}

impl Clock {
    /// Now.
    pub(crate) fn now() -> Self {
        Self { wall: Instant::now(), processor: processor_seconds() }
    }

    /// Since then; processor time has to be asked for by the same thread.
    pub(crate) fn lap(&self) -> Lap {
        Self::now() - *self
    }
}

impl Sub for Clock {
    type Output = Lap;

    fn sub(self, earlier: Self) -> Lap {
        let [all, leading] = [0, 1].map(|k| self.processor[k] - earlier.processor[k]);
        Lap { wall: (self.wall - earlier.wall).as_secs_f64(), processor: [all, leading] }
    }
}

impl Laps {
    /// Counts a lap in a phase.
    pub(crate) fn add(&mut self, phase: impl Fn(&mut PhaseSeconds) -> &mut f64, lap: Lap) {
        *phase(&mut self.wall) += lap.wall;
        *phase(&mut self.all) += lap.processor[0];
        *phase(&mut self.leading) += lap.processor[1];
    }

    /// Counts a lap no longer.
    pub(crate) fn subtract(&mut self, phase: impl Fn(&mut PhaseSeconds) -> &mut f64, lap: Lap) {
        let [all, leading] = lap.processor.map(|seconds| -seconds);
        self.add(phase, Lap { wall: -lap.wall, processor: [all, leading] });
    }

    /// Wall-clock seconds, and those of processors where the system tells.
    pub(crate) fn seconds(&self) -> (PhaseSeconds, Option<ProcessorSeconds>) {
        let processor = ProcessorSeconds { all: self.all, leading: self.leading };
        (self.wall, (!self.all.collide.is_nan()).then_some(processor))
    }
}

#[cfg(unix)]
fn processor_seconds() -> [f64; 2] {
    use rustix::time::{ClockId, clock_gettime};
    [ClockId::ProcessCPUTime, ClockId::ThreadCPUTime].map(|clock| {
        let time = clock_gettime(clock);
        time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
    })
}

#[cfg(not(unix))]
fn processor_seconds() -> [f64; 2] {
    [f64::NAN; 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Work of this thread counts for it and for all; that of another one only for all.
    #[test]
    #[cfg(unix)]
    fn work_is_counted_by_thread() {
        let work = || (0..4_000_000).map(|i| f64::from(i).sqrt()).sum::<f64>();
        let start = Clock::now();
        assert!(work() > 0.0);
        let own = start.lap();
        assert!(own.processor[1] > 0.0 && own.processor[0] >= own.processor[1] && own.wall > 0.0);
        let start = Clock::now();
        assert!(std::thread::spawn(work).join().unwrap() > 0.0);
        let others = start.lap();
        assert!(others.processor[1] < 0.5 * others.processor[0], "{others:?}");
        let mut laps = Laps::default();
        laps.add(|phases| &mut phases.solve, own);
        laps.subtract(|phases| &mut phases.solve, own);
        assert_eq!(laps.seconds().0.solve, 0.0);
    }
}
