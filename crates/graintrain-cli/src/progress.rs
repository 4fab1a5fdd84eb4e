//! A progress bar on stderr for whatever takes longer than two seconds where stderr is a terminal, a line a
//! minute where it is not; and warnings at the step where a run stops being what was asked for.

use crate::solving::status_word;
use crate::terminal::tell;
use graintrain_ccp::{SolveReport, Status};
use graintrain_io::files::OutputError;
use graintrain_io::run::{Observer, StepView};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// What takes less time than this shows no bar.
const PATIENCE: Duration = Duration::from_secs(2);
/// From line to line in a log.
pub const LINE_EVERY: Duration = Duration::from_secs(60);

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
    pub fn new(done: u64, steps: u64, quiet: bool) -> Self {
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
        Self { bar, warnings: Warnings::default(), start: Instant::now(), shown: quiet || log.is_some(), log }
    }
}

impl Observer for Progress {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        for warning in self.warnings.at(step) {
            self.bar.suspend(|| tell!("warning: {warning}"));
        }
        if let Some(line) = self.log.as_mut().and_then(|log| log.line(step, self.bar.length())) {
            tell!("{line}");
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

/// Tells, each once, of the first step whose solve did not reach its tolerance, of the first bodies that
/// passed into each other and of the first deep overlap.
#[derive(Default)]
pub struct Warnings {
    /// The first step whose solve did not reach its tolerance.
    unsolved: Option<u64>,
    /// The first step in which bodies passed into each other.
    passed: Option<u64>,
    is_deep: bool,
}

/// An overlap deeper than this part of the smaller body's size is no resting contact.
const DEEP: f64 = 0.1;

/// Where the velocities left over at a contact make more overlap than this in a step, relative to the smaller
/// body's size, they are a cause of deep overlap.
const CLOSING: f64 = 0.01;

impl Warnings {
    /// What is to be said of a step for the first time.
    fn at(&mut self, step: StepView<'_>) -> Vec<String> {
        let report = step.report;
        // Gaps of contacts are those at the start of the step.
        let before = step.world.contacts.contacts.iter().fold(0.0, |deepest: f64, c| deepest.max(-c.gap));
        let found = Found {
            is_new: before < 0.5 * report.penetration_max,
            contacts_missed: report.contacts_missed,
            penetration: report.penetration_max_over_size,
            closing: report.errors.overlap_per_step_max_over_size,
            is_elastic: step.world.materials.has_elastic_pairs(),
        };
        self.of(step.world.step, step.world.time, &report.solve, found)
    }

    fn of(&mut self, step: u64, time: f64, solve: &SolveReport, found: Found) -> Vec<String> {
        let place = format!("step {step} (t = {time:.6} s)");
        let mut warnings = Vec::new();
        if !solve.converged() && self.unsolved.is_none() {
            self.unsolved = Some(step);
            let cause = match solve.status {
                Status::Infeasible => {
                    "its contact problem has no solution (jammed bodies). Try a shorter step"
                }
                _ => {
                    "the step is made with the best impulses found. Try a shorter step; a looser --tolerance where loads press much harder than weight"
                }
            };
            let remark = solve.remark.as_ref().map_or(String::new(), |remark| format!(", {remark}"));
            warnings.push(format!(
                "{place} did not reach the tolerance{remark} (residual {:.1e}, rms {:.1e}, {}): {cause}. `--strict` ends a run here, \
                 `--dump-problem every={step}` keeps the problem",
                solve.residual.max,
                solve.residual.rms,
                status_word(Some(solve.status))
            ));
        }
        if found.contacts_missed > 0 && self.passed.is_none() {
            self.passed = Some(step);
            warnings.push(format!(
                "{place}: {}, since no contact was found that keeps them apart. A shorter step does (time.step)",
                passed(found.contacts_missed as u64)
            ));
        }
        if found.penetration > DEEP && !self.is_deep {
            self.is_deep = true;
            let cause = self.cause_of_overlap(step, found);
            let percent = 100.0 * found.penetration;
            let overlap =
                format!("{place}: two bodies overlap by {percent:.0} % of the smaller one's radius");
            warnings.push(if self.is_elastic_overlap(step, found) {
                format!(
                    "{overlap}: elastic contacts overlap by their load over their stiffness. A larger `stiffness` of \
                     the materials overlaps less"
                )
            } else {
                format!("{overlap}; what follows is not to be trusted. {cause}")
            });
        }
        warnings
    }

    /// Whether elastic contacts alone explain a deep overlap.
    fn is_elastic_overlap(&self, step: u64, found: Found) -> bool {
        let has_cause = self.passed.is_some() || self.unsolved.is_some() || found.closing > CLOSING;
        found.is_elastic && !has_cause && !found.is_new && step != 1
    }

    /// What a run knows of where a deep overlap comes from, and what helps against that.
    fn cause_of_overlap(&self, step: u64, found: Found) -> String {
        match (self.passed, self.unsolved) {
            (Some(step), _) => {
                format!("Bodies have passed into each other since step {step}: a shorter step (time.step) keeps them apart")
            }
            (None, Some(step)) => format!("Solves have not reached their tolerance since step {step}, see there"),
            (None, None) if found.closing > CLOSING => format!(
                "Velocities left over at contacts make {:.1} % in this step alone: a smaller --tolerance removes them",
                100.0 * found.closing
            ),
            (None, None) if found.is_new => "It arose in this step though its contacts were solved: the bodies turn or move too far within \
                a step for contacts that are taken as flat. A shorter step (time.step) helps"
                .to_string(),
            (None, None) if step == 1 => {
                "It was there at the start: see contact.allowed_overlap, and how the bodies are placed".to_string()
            }
            (None, None) => {
                "It has come about over several steps in which every solve reached its tolerance and no contact was undetected: a smaller \
                 --tolerance leaves less per step"
                    .to_string()
            }
        }
    }
}

/// What a step left behind, as far as warnings go.
#[derive(Clone, Copy, Default)]
struct Found {
    /// Pairs of bodies.
    contacts_missed: usize,
    /// Over the smaller body's size.
    penetration: f64,
    /// Whether most of it was not there before the step.
    is_new: bool,
    /// Overlap per step that remaining velocities make, over the smaller body's size.
    closing: f64,
    /// Whether some contacts are elastic.
    is_elastic: bool,
}

/// So many pairs passed into each other, in words.
pub fn passed(pairs: u64) -> String {
    match pairs {
        1 => "1 pair of bodies passed into or through each other".to_string(),
        _ => format!("{pairs} pairs of bodies passed into or through each other"),
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
            residual,
            residual_relaxed: residual,
            residual_coulomb: residual,
            ..SolveReport::default()
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
    fn each_kind_of_trouble_is_reported_once_with_its_step_and_time() {
        let mut warnings = Warnings::default();
        let (good, bad) = (report(Status::Converged, 1e-5), report(Status::Stalled, 0.14));
        let overlap = |penetration: f64| Found { penetration, ..Found::default() };
        assert!(warnings.of(1, 0.025, &good, overlap(0.09)).is_empty());
        let deep = warnings.of(13, 0.325, &good, overlap(0.11));
        assert_eq!(deep.len(), 1);
        assert!(deep[0].contains("step 13 (t = 0.325") && deep[0].contains("11 %"), "{deep:?}");
        let soft = Warnings::default().of(13, 0.325, &good, Found { is_elastic: true, ..overlap(0.11) });
        assert!(soft[0].contains("11 %") && soft[0].contains("`stiffness`"), "{soft:?}");
        let unconverged = warnings.of(14, 0.35, &bad, overlap(2.0));
        assert_eq!(unconverged.len(), 1);
        assert!(
            unconverged[0].contains("step 14") && unconverged[0].contains("1.4e-1, rms 1.4e-1, stalled"),
            "{unconverged:?}"
        );
        assert!(warnings.of(15, 0.375, &bad, overlap(3.0)).is_empty());
        let through = warnings.of(16, 0.4, &bad, Found { contacts_missed: 3, ..overlap(3.0) });
        assert_eq!(through.len(), 1);
        assert!(
            through[0].contains("step 16") && through[0].contains("3 pairs of bodies passed"),
            "{through:?}"
        );
        assert!(through[0].contains("shorter step"), "{through:?}");
        assert!(warnings.of(17, 0.425, &bad, Found { contacts_missed: 1, ..overlap(3.0) }).is_empty());
    }

    /// Neither the step nor friction is blamed for an overlap that has another cause.
    #[test]
    fn deep_overlap_is_put_down_to_what_made_it() {
        let (good, bad) = (report(Status::Converged, 1e-5), report(Status::Stalled, 0.14));
        let deep = Found { penetration: 0.9, closing: 1e-5, ..Found::default() };
        let reported = |solve: &SolveReport, found: Found| {
            Warnings::default().of(7, 0.1, solve, found).pop().expect("a warning")
        };
        let unknown = reported(&good, deep);
        assert!(!unknown.contains("friction") && !unknown.contains("shorter step"), "{unknown}");
        assert!(reported(&good, Found { is_new: true, ..deep }).contains("too far within a step"));
        assert!(
            reported(&good, Found { contacts_missed: 1, ..deep })
                .contains("passed into each other since step 7")
        );
        assert!(reported(&bad, deep).contains("have not reached their tolerance since step 7"));
        let left = reported(&good, Found { closing: 0.034, ..deep });
        assert!(left.contains("3.4 %") && left.contains("smaller --tolerance"), "{left}");
    }
}
