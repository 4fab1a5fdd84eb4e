//! What `run` and `resume` share: making the steps, leaving things in order, telling how it went.

use crate::closing::{self, counted};
use crate::crew::Crew;
use crate::error::Failure;
use crate::progress::{Progress, passed};
use crate::terminal::{say, tell};
use crate::threads::Pool;
use crate::timings::Timings;
use graintrain_io::files::OutputError;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::{RankSummary, RunStatus, Summary};
use graintrain_io::run::{Ending, Observer, Run, RunError};
use graintrain_io::scene;
use graintrain_view::view::live::Live;
use std::num::NonZeroUsize;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

/// Options of `run` and `resume` alike.
#[derive(clap::Args)]
pub struct SteppingOptions {
    /// Number of threads; all processors where it is not given (one for each of several ranks). The results
    /// do not depend on it
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Print nothing but warnings and errors
    #[arg(long)]
    pub quiet: bool,
    /// End with exit code 1 at the first step whose solve does not reach its tolerance
    #[arg(long)]
    pub strict: bool,
    /// Stop after so many seconds of wall clock, with exit code 3: the step under way is
    /// dropped, a checkpoint is written, `graintrain resume DIR` goes on
    #[arg(long, value_name = "SECONDS", value_parser = scene::seconds, allow_hyphen_values = true)]
    pub max_seconds: Option<f64>,
    /// Show the run in a browser while it computes: serves its page, with pause, step and stop, at
    /// http://127.0.0.1:PORT/ (any free port where none is given), for this machine alone
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "0")]
    pub live: Option<u16>,
    /// Print at the end the numbers of `summary.json`: residuals, errors, stages, streams, phases
    #[arg(long)]
    pub details: bool,
    /// Print at the end what the phases of the steps took: wall clock, processor time and, with several
    /// threads, how much of it one of them spent alone
    #[arg(long)]
    pub timings: bool,
}

/// A run that is ready to go on.
pub struct Begun {
    pub run: Run,
    /// Writes it down; `None` on ranks that do not.
    pub recorder: Option<Recorder>,
    pub threads: Pool,
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
        stop.after(limit)?;
    }
    let quiet = options.quiet || !crew.writes();
    let live = options.live.filter(|_| crew.writes());
    let live = live.map(|port| serve(&run, recorder.as_ref(), port, crew)).transpose();
    let mut live = crew.agree(live)?;
    let (ending, summary) = threads.install(|| {
        let mut progress = Progress::new(run.world.step, run.settings.steps, quiet);
        let mut observers: Vec<&mut dyn Observer> = Vec::new();
        observers.extend(recorder.as_mut().map(|recorder| recorder as &mut dyn Observer));
        observers.extend(live.as_mut().map(|live| live as &mut dyn Observer));
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
    if let Some(live) = &live {
        live.end(match &ending {
            Ok(Ending::Finished) => "The run is done.",
            Ok(Ending::Stopped) => "The run was stopped.",
            Err(_) => "The run has failed.",
        });
    }
    let outcome = match (ending, recorder.as_ref().map(Recorder::folder).zip(summary)) {
        // The other ranks make the next step.
        (Err(RunError::Output(error)), _) => return Err(crew.abandon(output_failure(error))),
        // The error that ended the run is reported even where its checkpoint could not be written either.
        (Err(error), Some((folder, summary))) => {
            let remedy = remedy(&error, folder, summary.is_ok());
            Err(Failure::work_error(error, remedy))
        }
        (Err(error), None) => Err(Failure::work_error(error, "")),
        (Ok(ending), Some((folder, summary))) => summary.map_err(output_failure).map(|summary| {
            warn(&summary);
            if ending == Ending::Stopped && run.world.step == first_step && options.max_seconds.is_some() {
                tell!("warning: no step was finished in the time given by --max-seconds: a longer one");
            }
            if !options.quiet {
                say!("{}", closing::lines(&summary, folder));
            }
            if options.details {
                say!("{}", closing::details(&summary));
            }
            if options.timings {
                say!("{}", timings.table(threads.count(), run.totals.output_seconds - output_before));
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

/// The page of the run, and where it is.
fn serve(run: &Run, recorder: Option<&Recorder>, port: u16, crew: &Crew) -> Result<Live, Failure> {
    let (settings, folder) = (&run.settings, recorder.map(|recorder| recorder.folder().to_path_buf()));
    let step = settings.stepping.step;
    let live =
        Live::serve(&run.world, &settings.scene, step, settings.steps, folder, port, crew.stop.asker());
    let live = live.map_err(|error| {
        Failure::input_error(error, "choose another port for --live, or none for any that is free")
    })?;
    say!("  {} shows the run\n", live.url());
    Ok(live)
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
        RunError::NotConverged { .. } => format!(
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
fn warn(summary: &Summary) {
    warn_of_unconverged_steps(summary);
    warn_of_bodies_that_passed(summary);
    if summary.status == RunStatus::Finished {
        warn_of_what_is_missing(summary);
    }
}

fn warn_of_unconverged_steps(summary: &Summary) {
    if summary.figures.unconverged_steps > 0 {
        tell!(
            "warning: {} of {} steps did not reach the tolerance {:.0e}, the worst residual is {:.1e} (rms {:.1e}; {:.1e} in impacts): see \
             the columns status, residual, residual_rms and impact_residual of steps.csv",
            summary.figures.unconverged_steps,
            summary.steps,
            summary.tolerance,
            summary.figures.residual_max,
            summary.figures.residual_rms_max,
            summary.figures.impact_residual_max
        );
    }
}

fn warn_of_bodies_that_passed(summary: &Summary) {
    if summary.figures.contacts_missed > 0 {
        let first = summary
            .figures
            .contacts_missed_first_step
            .map_or(String::new(), |step| format!(", first in step {step}"));
        tell!(
            "warning: {}{first}: no contact was found that keeps them apart. Use a shorter step, e.g. --set time.step='{} s'; the \
             column contacts_missed of steps.csv has the steps",
            passed(summary.figures.contacts_missed),
            0.5 * summary.step
        );
    }
}

/// Stages that the time did not suffice for, and streams that found no place.
fn warn_of_what_is_missing(summary: &Summary) {
    if !summary.stages_left.is_empty() {
        let never: Vec<String> = summary.stages_left.iter().map(|name| format!("`{name}`")).collect();
        let open = summary.stages.last().map_or("", |stage| stage.name.as_str());
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
