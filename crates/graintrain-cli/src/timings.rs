//! What the phases of steps cost, and how much of each of them one thread does alone: `--timings`.

use graintrain::stepper::{PhaseSeconds, ProcessorSeconds};
use graintrain_io::files::OutputError;
use graintrain_io::run::{Observer, StepView};
use std::fmt::Write as _;

/// Seconds by phase of the steps made by this process.
#[derive(Default)]
pub struct Timings {
    wall: PhaseSeconds,
    all: PhaseSeconds,
    leading: PhaseSeconds,
    /// Whether the system tells processor time.
    is_reported: bool,
}

fn add(sum: &mut PhaseSeconds, phases: &PhaseSeconds) {
    sum.collide += phases.collide;
    sum.assemble += phases.assemble;
    sum.solve += phases.solve;
    sum.integrate += phases.integrate;
}

impl Observer for Timings {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        add(&mut self.wall, &step.report.phases);
        if let Some(ProcessorSeconds { all, leading }) = &step.report.processor {
            add(&mut self.all, all);
            add(&mut self.leading, leading);
            self.is_reported = true;
        }
        Ok(())
    }
}

/// The fraction s of the work of `all` threads that the `leading` one does alone: `leading = s all + (1 - s)
/// all / threads`, all in processor seconds. Waiting for a processor that others use does not count.
fn serial_fraction(all: f64, leading: f64, threads: usize) -> f64 {
    let share = 1.0 / threads as f64;
    ((leading / all - share) / (1.0 - share)).clamp(0.0, 1.0)
}

/// The seconds of a phase.
type Seconds = fn(&PhaseSeconds) -> f64;

impl Timings {
    /// The table; `output_seconds` is what observers took between the steps.
    pub fn table(&self, threads: usize, output_seconds: f64) -> String {
        let phases: [(&str, Seconds); 5] = [
            ("collide", |phases| phases.collide),
            ("assemble", |phases| phases.assemble),
            ("solve", |phases| phases.solve),
            ("integrate", |phases| phases.integrate),
            ("steps", |phases| phases.collide + phases.assemble + phases.solve + phases.integrate),
        ];
        let several = threads > 1 && self.is_reported;
        let mut text = format!("\n  {:<12} {:>10} {:>14}", "phase", "wall, s", "processors, s");
        if several {
            let _ = write!(text, " {:>8} {:>26}", "serial", format!("at most with {threads} threads"));
        }
        for (name, of) in phases {
            let _ = write!(text, "\n  {name:<12} {:>10.3}", of(&self.wall));
            if !self.is_reported {
                let _ = write!(text, " {:>14}", "not reported");
                continue;
            }
            let _ = write!(text, " {:>14.3}", of(&self.all));
            if several && of(&self.all) > 0.0 {
                let serial = serial_fraction(of(&self.all), of(&self.leading), threads);
                let faster = 1.0 / (serial + (1.0 - serial) / threads as f64);
                let _ = write!(text, " {:>6.1} % {:>20.2} times", 100.0 * serial, faster);
            }
        }
        let _ = writeln!(text, "\n  {:<12} {output_seconds:>10.3}", "output");
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 3 s of which 1 s is serial: the leading one of two threads works 2 s, of four 1.5 s.
    #[test]
    fn the_serial_fraction_is_that_of_amdahl() {
        assert!((serial_fraction(3.0, 2.0, 2) - 1.0 / 3.0).abs() < 1e-15);
        assert!((serial_fraction(3.0, 1.5, 4) - 1.0 / 3.0).abs() < 1e-15);
        assert_eq!(serial_fraction(3.0, 3.0, 2), 1.0);
        // The others may have worked more than the leading one.
        assert_eq!(serial_fraction(3.0, 1.0, 2), 0.0);
    }

    #[test]
    fn the_table_names_every_phase_and_tells_serial_parts_of_several_threads_alone() {
        let seconds = PhaseSeconds { collide: 1.0, assemble: 0.5, solve: 4.0, integrate: 2.0 };
        let timings = Timings { wall: seconds, all: seconds, leading: seconds, is_reported: true };
        let (one, two) = (timings.table(1, 0.25), timings.table(2, 0.25));
        for phase in ["collide", "assemble", "solve", "integrate", "steps", "output"] {
            assert!(one.contains(phase) && two.contains(phase), "{one}{two}");
        }
        assert!(!one.contains("serial") && two.contains("100.0 %") && two.contains("1.00 times"), "{two}");
        assert!(Timings { is_reported: false, ..timings }.table(2, 0.25).contains("not reported"));
    }
}
