//! What `run` and `resume` share: making the steps, leaving things in order, telling how it went.

use crate::crew::Crew;
use crate::error::Failure;
use crate::progress::{Progress, passed};
use crate::terminal::{say, tell};
use crate::timings::Timings;
use graintrain_ccp::FrictionModel;
use graintrain_ccp::residual::MIXED_MAXIMUM;
use graintrain_io::files::OutputError;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::{RankSummary, RunStatus, Summary};
use graintrain_io::run::{Ending, Observer, Run, RunError};
use graintrain_io::scene;
use rayon::ThreadPool;
use std::fmt::Write as _;
use std::num::NonZeroUsize;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

/// Options of `run` and `resume` alike.
#[derive(clap::Args)]
pub struct SteppingOptions {
    /// Number of threads; all processors where it is not given (one for each of several ranks). The results do not depend on it
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Print nothing but warnings and errors
    #[arg(long)]
    pub quiet: bool,
    /// End with exit code 1 at the first step whose solve misses its tolerance
    #[arg(long)]
    pub strict: bool,
    /// Stop in good order after so many seconds of wall clock, with exit code 3: the step under way is dropped, a checkpoint is written,
    /// `graintrain resume DIR` goes on
    #[arg(long, value_name = "SECONDS", value_parser = scene::seconds)]
    pub max_seconds: Option<f64>,
    /// Tell at the end what the phases of the steps took: wall clock, processor time and, with several threads, how much of it one of them
    /// spent alone
    #[arg(long)]
    pub timings: bool,
}

/// A run that is ready to go on.
pub struct Begun {
    pub run: Run,
    /// Writes it down; `None` on ranks that do not.
    pub recorder: Option<Recorder>,
    pub threads: ThreadPool,
}

/// Makes the remaining steps, writes the last checkpoint and the summary, and tells how it went.
pub fn make_steps(
    Begun { mut run, mut recorder, threads }: Begun,
    options: &SteppingOptions,
    crew: &Crew,
) -> Result<ExitCode, Failure> {
    let stop = &crew.stop;
    run.strict = options.strict;
    if let Some(ranks) = crew.ranks() {
        run.share_among(Arc::clone(ranks));
    }
    if let Some(recorder) = &mut recorder {
        recorder.checkpoint_wanted = Arc::clone(&stop.checkpoint_wanted);
    }
    let (mut timings, output_before) = (Timings::default(), run.totals.output_seconds);
    let first_step = run.world.step;
    if let Some(limit) = options.max_seconds {
        stop.after(limit);
    }
    let quiet = options.quiet || !crew.writes();
    let (ending, summary) = threads.install(|| {
        let mut progress = Progress::new(run.world.step, run.settings.steps, quiet);
        let mut observers: Vec<&mut dyn Observer> = Vec::new();
        observers.extend(recorder.as_mut().map(|recorder| recorder as &mut dyn Observer));
        observers.extend([&mut progress as &mut dyn Observer, &mut timings]);
        let ending = run.advance(&mut observers);
        drop(progress);
        let shared = !matches!(ending, Err(RunError::Output(_)));
        let ranks = crew.ranks().filter(|_| shared).map(|ranks| RankSummary::of(ranks));
        let summary = recorder.as_mut().map(|recorder| {
            recorder.ranks = ranks;
            conclude(&run, recorder, &ending)
        });
        (ending, summary)
    });
    let outcome = match (ending, recorder.as_ref().map(Recorder::folder).zip(summary)) {
        // The other ranks make the next step.
        (Err(RunError::Output(error)), _) => return Err(crew.abandon(output_failure(error))),
        // The error that ended the run is told even where its checkpoint could not be written either.
        (Err(error), Some((folder, summary))) => {
            let remedy = remedy(&error, folder, summary.is_ok());
            Err(Failure::work_error(error, remedy))
        }
        (Err(error), None) => Err(Failure::work_error(error, "")),
        (Ok(ending), Some((folder, summary))) => summary.map_err(output_failure).map(|summary| {
            warn(&run, &summary);
            if ending == Ending::Stopped && run.world.step == first_step && options.max_seconds.is_some() {
                tell!("warning: no step was finished in the time given by --max-seconds: a longer one");
            }
            if !options.quiet {
                say!("{}", describe(&summary, folder));
            }
            if options.timings {
                say!(
                    "{}",
                    timings.table(threads.current_num_threads(), run.totals.output_seconds - output_before)
                );
            }
            ending
        }),
        (Ok(ending), None) => Ok(ending),
    };
    match crew.agree(outcome)? {
        Ending::Stopped => Ok(crew.stopped()),
        Ending::Finished => Ok(ExitCode::SUCCESS),
    }
}

fn conclude(
    run: &Run,
    recorder: &mut Recorder,
    ending: &Result<Ending, RunError>,
) -> Result<Summary, OutputError> {
    match ending {
        Ok(Ending::Finished) => recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished),
        Ok(Ending::Stopped) => recorder.checkpoint(&run.world, &run.totals, RunStatus::Stopped),
        Err(RunError::Output(_)) => recorder.checkpoint(&run.world, &run.totals, RunStatus::Failed),
        Err(_) => recorder.fail(&run.world, &run.totals),
    }
}

fn remedy(error: &RunError, folder: &Path, is_saved: bool) -> String {
    let shown = folder.display();
    match error {
        RunError::Output(error) => error.remedy().to_string(),
        RunError::RanksDisagree { .. } => "give every rank the same program and the same files".to_string(),
        _ if !is_saved => format!("the state could not be written to {shown} either"),
        RunError::ToleranceMissed { .. } => format!(
            "try another --solver or a larger --tolerance; the state is saved in {shown}, \
             and `graintrain resume {shown}` goes on without --strict"
        ),
        _ => format!(
            "the last good state is saved in {shown}: look at its last frame, and try a shorter time step"
        ),
    }
}

/// A failure of an output, as the user sees it.
pub fn output_failure(error: OutputError) -> Failure {
    let remedy = error.remedy();
    Failure::work_error(error, remedy)
}

/// Warns of what was not as it was asked for.
fn warn(run: &Run, summary: &Summary) {
    warn_of_missed_tolerance(summary);
    warn_of_missed_contacts(summary);
    if summary.status == RunStatus::Finished {
        let stages: Vec<&str> = run.settings.stages.iter().map(|stage| stage.name.as_str()).collect();
        warn_of_what_is_missing(summary, &stages);
    }
}

fn warn_of_missed_tolerance(summary: &Summary) {
    if summary.unconverged_steps > 0 {
        tell!(
            "warning: {} of {} steps missed the tolerance {:.0e}, the worst residual is {:.1e} (rms {:.1e}; {:.1e} in impacts): see \
             the columns status, residual, residual_rms and impact_residual of steps.csv",
            summary.unconverged_steps,
            summary.steps,
            summary.tolerance,
            summary.residual_max,
            summary.residual_rms_max,
            summary.impact_residual_max
        );
    }
}

fn warn_of_missed_contacts(summary: &Summary) {
    if summary.contacts_missed > 0 {
        let first = summary
            .contacts_missed_first_step
            .map_or(String::new(), |step| format!(", first in step {step}"));
        tell!(
            "warning: {}{first}: no contact was found that keeps them apart. Use a shorter step, e.g. --set time.step='{} s'; the \
             column contacts_missed of steps.csv has the steps",
            passed(summary.contacts_missed),
            0.5 * summary.step
        );
    }
}

/// Stages that the time did not suffice for, and streams that found no place.
fn warn_of_what_is_missing(summary: &Summary, stages: &[&str]) {
    let begun = summary.stages.len();
    if begun < stages.len() {
        let never: Vec<String> = stages[begun..].iter().map(|name| format!("`{name}`")).collect();
        let open = stages.get(begun.wrapping_sub(1)).copied().unwrap_or_default();
        tell!(
            "warning: stage `{open}` had not ended when the time of the run was over, so {} never began. A longer `time.end`, or a \
             `time` for that stage",
            never.join(", ")
        );
    }
    for stream in summary.streams.iter().filter(|stream| stream.steps_waited > 0 && !stream.is_done) {
        tell!(
            "warning: stream `{}` gave {} and had not given all at the end: in {} a body found no free place. A larger region, or a \
             velocity that leads away from it",
            stream.name,
            counted(stream.bodies, "body", "bodies"),
            counted(stream.steps_waited, "step", "steps")
        );
    }
}

fn counted(number: u64, one: &str, many: &str) -> String {
    format!("{number} {}", if number == 1 { one } else { many })
}

/// The run in a few lines for people.
fn describe(summary: &Summary, folder: &Path) -> String {
    let mut text = String::new();
    let verdict = match summary.status {
        RunStatus::Finished => "is done",
        RunStatus::Stopped => "was stopped",
        RunStatus::Running | RunStatus::Failed => "ended early",
    };
    let folder = folder.display();
    let _ = writeln!(
        text,
        "\n{} {verdict}: {} steps, {:.4} s simulated in {}\n",
        summary.scene,
        summary.steps,
        summary.simulated_seconds,
        duration(summary.wall_seconds)
    );
    let mut line = |name: &str, value: String| {
        let _ = writeln!(text, "  {name:<12} {value}");
    };
    line("bodies", summary.bodies.to_string());
    line(
        "contacts",
        format!(
            "{} in the last step, {:.0} on average, {} at most",
            summary.contacts_final, summary.contacts_mean, summary.contacts_max
        ),
    );
    let what = match summary.strict_max {
        true => format!("maximum {:.0e}", summary.tolerance),
        false => {
            format!("rms {:.0e} and maximum {:.0e}", summary.tolerance, MIXED_MAXIMUM * summary.tolerance)
        }
    };
    let converged = match summary.unconverged_steps {
        0 => format!("every step within {what}"),
        missed => format!("{missed} steps above {what}"),
    };
    line(
        "residual",
        format!(
            "{:.1e} at the worst contact, rms {:.1e} in the worst step ({converged}, {})",
            summary.residual_max, summary.residual_rms_max, summary.solver
        ),
    );
    line(
        "penetration",
        format!(
            "{:.2} % of the smaller body's radius in the last step, {:.2} % at most",
            100.0 * summary.penetration_final_over_radius,
            100.0 * summary.penetration_max_over_radius
        ),
    );
    line(
        "errors",
        format!(
            "contacts still close at {:.1e} m/s at most ({:.1e} % of the smaller body's radius per step), friction is {:.1e} of the \
             contact's force outside of its cone and {:.1e} rad off the slip",
            summary.velocity_error_max,
            100.0 * summary.overlap_per_step_max_over_radius,
            summary.friction_error_max,
            summary.slip_angle_max
        ),
    );
    if let Some(told) = relaxation(summary) {
        line("relaxation", told);
    }
    if summary.wedged_steps > 0 {
        let contacts = counted(summary.contacts_wedged, "contact", "contacts");
        let steps = counted(summary.wedged_steps, "step", "steps");
        line(
            "wedged",
            format!(
                "{contacts} in {steps} taken with exact friction: bodies are wedged in, and the relaxation has no solution or throws them away"
            ),
        );
    }
    for stage in &summary.stages {
        let last = stage.last_step.map_or("the end".to_string(), |last| last.to_string());
        line("stage", format!("`{}`: steps {} to {last}", stage.name, stage.first_step + 1));
    }
    for stream in &summary.streams {
        let waited = match stream.steps_waited {
            0 => String::new(),
            steps => format!("; in {} a body found no free place", counted(steps, "step", "steps")),
        };
        let bodies = counted(stream.bodies, "body", "bodies");
        line("stream", format!("`{}`: {bodies}, {:.3e} kg{waited}", stream.name, stream.mass));
    }
    for outlet in &summary.outlets {
        let bodies = counted(outlet.bodies, "body", "bodies");
        line("outlet", format!("`{}`: {bodies}, {:.3e} kg", outlet.name, outlet.mass));
    }
    line("energy", format!("{:.3e} J kinetic at the end", summary.kinetic_energy));
    if let Some(bytes) = summary.peak_memory_bytes {
        line("memory", format!("{:.0} MB at most", bytes as f64 / 1e6));
    }
    let phases = &summary.phases;
    let named = [
        ("collide", phases.collide),
        ("assemble", phases.assemble),
        ("solve", phases.solve),
        ("integrate", phases.integrate),
        ("output", phases.output),
    ];
    let total: f64 = named.iter().map(|(_, seconds)| seconds).sum();
    let _ = writeln!(text);
    for (name, seconds) in named {
        let share = if total > 0.0 { seconds / total } else { 0.0 };
        let bar = "#".repeat((30.0 * share).round() as usize);
        let _ = writeln!(text, "  {name:<12} {:>9}  {bar}", duration(seconds));
    }
    let _ = writeln!(text, "\n  {folder}: all.pvd (ParaView, OVITO), steps.csv, wrench.csv, summary.json");
    let next = match summary.status {
        RunStatus::Finished => format!("graintrain view {folder}"),
        _ => format!("graintrain resume {folder}"),
    };
    let _ = writeln!(text, "  next: {next}");
    text
}

/// Above this relative difference of the velocities exact friction is worth its price.
const WORTH_EXACT_FRICTION: f64 = 0.01;

/// What relaxed friction did to the run, and whether exact friction is advised.
fn relaxation(summary: &Summary) -> Option<String> {
    if summary.friction != FrictionModel::Relaxed {
        return None;
    }
    let opened = format!(
        "sliding contacts open by {:.1e} % of the smaller body's radius per step at most, {:.2} % of the contacts with force by more than 0.1 %",
        100.0 * summary.relaxation_opening_max_over_radius,
        100.0 * summary.relaxation_opened_share
    );
    if summary.relaxation_steps_compared == summary.relaxation_steps_undecided {
        return Some(opened);
    }
    let (steps, relative) = (summary.relaxation_steps_compared, summary.relaxation_relative_difference_max);
    let undecided = match summary.relaxation_steps_undecided {
        0 => String::new(),
        steps => format!(" ({steps} of them undecided)"),
    };
    let advice = if relative > WORTH_EXACT_FRICTION {
        "exact friction is worth it here: --friction coulomb"
    } else {
        "relaxed friction is good enough here"
    };
    Some(format!(
        "{opened}; in {steps} steps compared{undecided} exact friction gives velocities that differ by {:.2} % of their rms: {advice}",
        100.0 * relative
    ))
}

/// Seconds for people: 12.3 ms, 4.56 s, 3 min 20 s, 2 h 5 min.
fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        _ if seconds < 1.0 => format!("{:.1} ms", 1e3 * seconds),
        0..120 => format!("{seconds:.2} s"),
        120..7200 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::duration;

    #[test]
    fn durations_are_told_in_the_unit_that_fits() {
        assert_eq!(duration(0.0123), "12.3 ms");
        assert_eq!(duration(4.561), "4.56 s");
        assert_eq!(duration(200.0), "3 min 20 s");
        assert_eq!(duration(7500.0), "2 h 5 min");
    }
}
