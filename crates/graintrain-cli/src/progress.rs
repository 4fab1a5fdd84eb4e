//! A progress bar on stderr for whatever takes longer than two seconds where stderr is a terminal, a line a minute where
//! it is not; and warnings at the step where a run stops being what was asked for.

use crate::solving::status_word;
use graintrain_ccp::{FrictionModel, SolveReport, Status};
use graintrain_io::files::OutputError;
use graintrain_io::run::{Observer, StepView};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// What takes less time than this shows no bar.
const PATIENCE: Duration = Duration::from_secs(2);
/// From line to line in a log.
const LINE_EVERY: Duration = Duration::from_secs(60);

/// Shows how far a run is.
pub struct Progress {
    bar: ProgressBar,
    warnings: Warnings,
    start: Instant,
    /// Whether the bar needs no more showing: it is there, or nobody wants it.
    shown: bool,
    /// Lines for a log, where there is one.
    log: Option<Log>,
}

impl Progress {
    /// For a run at step `done` of `steps`; `quiet` draws no bar.
    pub fn new(done: u64, steps: u64, quiet: bool, warnings: Warnings) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::hidden());
        // The template is a constant; were it faulty, the plain bar would do.
        if let Ok(style) = ProgressStyle::with_template(
            "{bar:24.cyan/blue} step {pos}/{len} | {elapsed} so far, {eta} to go | {msg}",
        ) {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_position(done);
        bar.reset_eta();
        let log = (!quiet && !std::io::stderr().is_terminal()).then(|| Log::new(done, LINE_EVERY));
        Self { bar, warnings, start: Instant::now(), shown: quiet || log.is_some(), log }
    }
}

impl Observer for Progress {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        for warning in self.warnings.at(step) {
            self.bar.suspend(|| eprintln!("warning: {warning}"));
        }
        if let Some(line) = self.log.as_mut().and_then(|log| log.line(step, self.bar.length())) {
            eprintln!("{line}");
        }
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

/// Lines that tell a log now and then how far a run is.
struct Log {
    start: Instant,
    last: Instant,
    every: Duration,
    /// Steps done at the start.
    before: u64,
}

impl Log {
    fn new(before: u64, every: Duration) -> Self {
        let now = Instant::now();
        Self { start: now, last: now, every, before }
    }

    /// The line of this step, where one is due.
    fn line(&mut self, step: StepView<'_>, steps: Option<u64>) -> Option<String> {
        if self.last.elapsed() < self.every {
            return None;
        }
        self.last = Instant::now();
        Some(self.text(
            step.world.step,
            steps.unwrap_or(step.world.step),
            step.world.time,
            step.report.contacts,
            step.report.solve.residual.max,
        ))
    }

    fn text(&self, step: u64, steps: u64, time: f64, contacts: usize, residual: f64) -> String {
        let seconds = self.start.elapsed().as_secs_f64();
        let to_go =
            seconds * steps.saturating_sub(step) as f64 / step.saturating_sub(self.before).max(1) as f64;
        format!(
            "step {step}/{steps}, t = {time:.6} s, {seconds:.0} s so far, about {to_go:.0} s to go, {contacts} contacts, residual \
             {residual:.0e}"
        )
    }
}

/// Tells, each once, of the first step whose solve missed its tolerance and of the first deep overlap.
pub struct Warnings {
    friction: FrictionModel,
    /// Size of the smallest body, m; infinite where there is none.
    radius: f64,
    is_missed: bool,
    is_deep: bool,
}

/// An overlap deeper than this part of the smallest radius is no resting contact.
const DEEP: f64 = 0.5;

impl Warnings {
    /// For a run with this friction, whose smallest body has this size, m.
    pub fn new(friction: FrictionModel, radius: Option<f64>) -> Self {
        let radius = radius.filter(|&radius| radius > 0.0).unwrap_or(f64::INFINITY);
        Self { friction, radius, is_missed: false, is_deep: false }
    }

    /// What is to be said of a step for the first time.
    fn at(&mut self, step: StepView<'_>) -> Vec<String> {
        self.of(step.world.step, step.world.time, &step.report.solve, step.report.penetration_max)
    }

    fn of(&mut self, step: u64, time: f64, solve: &SolveReport, penetration: f64) -> Vec<String> {
        let place = format!("step {step} (t = {time:.6} s)");
        let mut warnings = Vec::new();
        if !solve.converged() && !self.is_missed {
            self.is_missed = true;
            let cause = match solve.status {
                Status::Infeasible => {
                    "its contact problem has no solution (jammed bodies), the impulses of slightly compliant contacts are taken. Try a shorter step"
                }
                _ => {
                    "the best impulses found are taken. Try a shorter step, another --solver (auto, ipm) or a looser --tolerance"
                }
            };
            warnings.push(format!(
                "{place}: the solve missed the tolerance (residual {:.1e}, rms {:.1e}, {}): {cause}. `--strict` ends a run here, \
                 `--dump-problem every={step}` keeps the problem",
                solve.residual.max,
                solve.residual.rms,
                status_word(Some(solve.status))
            ));
        }
        if penetration > DEEP * self.radius && !self.is_deep {
            self.is_deep = true;
            let advice = match self.friction {
                FrictionModel::Relaxed => {
                    "Relaxed friction parts sliding contacts by mu |slip| and throws wedged bodies where mu is large: try \
                     --friction coulomb, or a shorter step"
                }
                FrictionModel::Coulomb => "Try a shorter step",
            };
            warnings.push(format!(
                "{place}: bodies overlap by {:.0} % of the smallest radius; what follows is not to be trusted. {advice}",
                100.0 * penetration / self.radius
            ));
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain_ccp::Residual;

    fn report(status: Status, residual: f64) -> SolveReport {
        let residual = Residual { max: residual, rms: residual };
        SolveReport {
            solver: "apgd".to_string(),
            status,
            iterations: 1,
            linear_iterations: 0,
            products: 0,
            residual,
            residual_relaxed: residual,
            residual_coulomb: residual,
            residual_paper: 0.0,
            objective: 0.0,
            seconds: 0.0,
            newton: Vec::new(),
            remark: None,
        }
    }

    #[test]
    fn lines_for_a_log_tell_how_far_a_run_is() {
        let mut log = Log::new(100, Duration::from_secs(60));
        log.start = Instant::now().checked_sub(Duration::from_secs(50)).unwrap();
        let line = log.text(150, 200, 0.75, 321, 2.3e-5);
        assert_eq!(
            line,
            "step 150/200, t = 0.750000 s, 50 s so far, about 50 s to go, 321 contacts, residual 2e-5"
        );
    }

    #[test]
    fn each_kind_of_trouble_is_told_once_with_its_step_and_time() {
        let mut warnings = Warnings::new(FrictionModel::Relaxed, Some(0.1));
        let (good, bad) = (report(Status::Converged, 1e-5), report(Status::Stalled, 0.14));
        assert!(warnings.of(1, 0.025, &good, 0.04).is_empty());
        let deep = warnings.of(13, 0.325, &good, 0.076);
        assert_eq!(deep.len(), 1);
        assert!(deep[0].contains("step 13 (t = 0.325") && deep[0].contains("76 %"), "{deep:?}");
        assert!(deep[0].contains("--friction coulomb"), "{deep:?}");
        let missed = warnings.of(14, 0.35, &bad, 0.2);
        assert_eq!(missed.len(), 1);
        assert!(
            missed[0].contains("step 14") && missed[0].contains("1.4e-1, rms 1.4e-1, stalled"),
            "{missed:?}"
        );
        assert!(warnings.of(15, 0.375, &bad, 0.3).is_empty());
    }
}
