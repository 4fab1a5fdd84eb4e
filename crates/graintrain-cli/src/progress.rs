//! A progress bar on stderr for whatever takes longer than two seconds. Nothing is drawn where stderr is no terminal.

use graintrain::output::files::OutputError;
use graintrain::run::{Observer, StepView};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::time::{Duration, Instant};

/// What takes less time than this shows no bar.
const PATIENCE: Duration = Duration::from_secs(2);

/// Shows how far a run is.
pub struct Progress {
    bar: ProgressBar,
    start: Instant,
    shown: bool,
}

impl Progress {
    /// For a run at step `done` of `steps`.
    pub fn new(done: u64, steps: u64) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::hidden());
        // The template is a constant; were it faulty, the plain bar would do.
        if let Ok(style) = ProgressStyle::with_template(
            "{bar:24.cyan/blue} step {pos}/{len} | {elapsed} so far, {eta} to go | {msg}",
        ) {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_position(done);
        bar.reset_eta();
        Self { bar, start: Instant::now(), shown: false }
    }
}

impl Observer for Progress {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        self.bar.set_position(step.world.step);
        self.bar.set_message(format!(
            "{} contacts, residual {:.0e}",
            step.report.contacts, step.report.solve.residual.max
        ));
        if !self.shown && self.start.elapsed() >= PATIENCE {
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
            self.bar.enable_steady_tick(Duration::from_millis(500));
            self.shown = true;
        }
        Ok(())
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
