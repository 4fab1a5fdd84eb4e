//! Makes the runs of a sweep.

use super::SweepError;
use super::collect::observables_of;
use super::plan::{Cell, Plan, label};
use graintrain_io::checkpoint::{self, CheckpointError};
use graintrain_io::files::{OutputError, make_folder};
use graintrain_io::mark::Loss;
use graintrain_io::output::folder::{RunFolder, refuse_occupied};
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::RunStatus;
use graintrain_io::run::{Ending, Run, RunError, RunSettings, RunTotals};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// How a sweep is carried out.
#[derive(Clone, Debug)]
pub struct Execution {
    /// Its folder.
    pub folder: PathBuf,
    /// Runs at a time.
    pub jobs: usize,
    /// Threads of each; the results do not depend on it.
    pub threads: usize,
}

/// What became of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It reached its end, now or before.
    Finished,
    /// It was stopped, or had not begun.
    Stopped,
    /// It ended early.
    Failed(String),
}

/// How far a sweep is.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// Runs that ended.
    pub done: usize,
    /// All runs.
    pub total: usize,
    /// The one that ended last.
    pub last: &'a str,
    /// What of its tables was missing or damaged after an interruption: nothing of them is erased.
    pub losses: &'a [Loss],
}

/// Folder of a run.
pub fn run_folder(folder: &Path, cell: &Cell) -> PathBuf {
    folder.join("runs").join(&cell.name)
}

/// Makes the folder of a sweep, or goes on in one that has its `runs`; nothing is written into one that holds
/// something else.
///
/// # Errors
/// [`SweepError::Occupied`], [`SweepError::Output`].
pub(crate) fn make_own_folder(folder: &Path) -> Result<(), SweepError> {
    let runs = folder.join("runs");
    if folder.exists() && !runs.exists() {
        refuse_occupied(folder)?;
    }
    Ok(make_folder(&runs)?)
}

/// Looks at everything before the first run: the scene of every cell is read, that of every point built;
/// returned are the names of the observables that the runs will have.
///
/// # Errors
/// [`SweepError::Scene`] for the first wrong scene; [`SweepError::Plan`] where means that begin at `from` (s)
/// would have no record.
pub fn check(plan: &Plan, cells: &[Cell], from: Option<f64>) -> Result<Vec<String>, SweepError> {
    for cell in cells {
        plan.load(&[], &cell.settings)?;
    }
    let mut names: Vec<String> = Vec::new();
    let first_of_point = |point: usize| cells.iter().find(|cell| cell.point == point);
    for cell in (0..plan.points.len()).filter_map(first_of_point) {
        let simulation = plan.load(&[], &cell.settings)?.build().map_err(|error| wrong(plan, cell, error))?;
        let end = simulation.steps as f64 * simulation.settings.step;
        if let Some(from) = from.filter(|from| *from > end * (1.0 + 1e-9)) {
            let point = label(&plan.points[cell.point]);
            let problem = format!(
                "means would begin at {from} s, but the run ends at {end} s ({point}): no record is left"
            );
            return Err(SweepError::Plan(problem));
        }
        for name in observables_of(&simulation.measures) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
    }
    Ok(names)
}

/// Makes all runs that are not finished yet, `jobs` at a time, in the order of the cells; what becomes of
/// each. A run that fails, or whose scene cannot be built (see [`check`]), does not keep others from being
/// made. The folder belongs to this process meanwhile.
///
/// # Errors
/// [`SweepError::Occupied`], [`SweepError::Differs`], [`SweepError::Output`] and [`SweepError::Threads`] as
/// they come; [`SweepError::Stopped`] after `stop` was set.
pub fn execute(
    plan: &Plan,
    cells: &[Cell],
    how: &Execution,
    stop: &Arc<AtomicBool>,
    progress: &(dyn Fn(Progress<'_>) + Sync),
) -> Result<Vec<Outcome>, SweepError> {
    make_own_folder(&how.folder)?;
    let _held = RunFolder::open(&how.folder)?;
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let outcomes: Mutex<Vec<Outcome>> = Mutex::new(vec![Outcome::Stopped; cells.len()]);
    let error: Mutex<Option<SweepError>> = Mutex::new(None);
    let fail = |found: SweepError| {
        stop_others(&next, cells.len());
        let mut error = error.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        error.get_or_insert(found);
    };
    let work = || {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(how.threads.max(1)).build();
        let pool = match pool {
            Ok(pool) => pool,
            Err(error) => return fail(SweepError::Threads(error.to_string())),
        };
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(cell) = cells.get(index).filter(|_| !stop.load(Ordering::Relaxed)) else { return };
            let made = match pool.install(|| make(plan, cell, &how.folder, stop)) {
                // As a run that fails: the others are made all the same.
                Err(SweepError::Scene { error, .. }) => Ok((Outcome::Failed(error.to_string()), Vec::new())),
                made => made,
            };
            match made {
                Err(error) => return fail(error),
                Ok((outcome, losses)) => {
                    let mut list = outcomes.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                    list[index] = outcome;
                    drop(list);
                    let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                    progress(Progress { done, total: cells.len(), last: &cell.name, losses: &losses });
                }
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..how.jobs.max(1) {
            scope.spawn(work);
        }
    });
    if let Some(error) = error.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
        return Err(error);
    }
    let outcomes = outcomes.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    if outcomes.contains(&Outcome::Stopped) { Err(SweepError::Stopped) } else { Ok(outcomes) }
}

/// No worker takes another cell.
fn stop_others(next: &AtomicUsize, cells: usize) {
    next.store(cells, Ordering::Relaxed);
}

fn wrong(plan: &Plan, cell: &Cell, error: graintrain_io::scene::SceneError) -> SweepError {
    SweepError::Scene { point: label(&plan.points[cell.point]), error: Box::new(error) }
}

/// Makes a run, or what is left of it.
fn make(
    plan: &Plan,
    cell: &Cell,
    folder: &Path,
    stop: &Arc<AtomicBool>,
) -> Result<(Outcome, Vec<Loss>), SweepError> {
    let folder = run_folder(folder, cell);
    let simulation = plan.load(&[], &cell.settings)?.build().map_err(|error| wrong(plan, cell, error))?;
    let resolved = simulation.resolved.to_toml().map_err(|error| wrong(plan, cell, error))?;
    let checkpoints = folder.join("checkpoints");
    let begun = checkpoint::is_in(&checkpoints);
    if begun && std::fs::read_to_string(folder.join("scene.toml")).ok().as_deref() != Some(&resolved) {
        return Err(SweepError::Differs { folder });
    }
    if is_finished(&folder) {
        return Ok((Outcome::Finished, Vec::new()));
    }
    let taken = if begun { Some(RunFolder::open(&folder)?) } else { None };
    // What cannot be read is not made again in silence: it may be the work of days.
    let unusable =
        |error: CheckpointError| SweepError::Unusable { folder: folder.clone(), reason: error.to_string() };
    let saved = match checkpoint::latest(&checkpoints) {
        Ok((saved, _)) => Some(saved),
        Err(CheckpointError::None { .. }) => None,
        Err(error) if begun => return Err(unusable(error)),
        Err(_) => None,
    };
    let (run, mut recorder) = match saved.zip(taken) {
        Some((saved, taken)) => {
            let recorder = Recorder::resume(taken, &saved.settings, &saved.world, &saved.marks)?;
            (Run::new(saved.world, saved.settings, saved.totals, Arc::clone(stop)), recorder)
        }
        // Nothing there: from the beginning.
        None => {
            let taken = RunFolder::create(&folder, true)?;
            let settings = RunSettings::new(&simulation, None);
            let recorder = Recorder::begin(taken, &settings, &simulation.world, &resolved)?;
            (Run::new(simulation.world, settings, RunTotals::default(), Arc::clone(stop)), recorder)
        }
    };
    let mut run = run.map_err(|error| SweepError::Plan(format!("{}: {error}", cell.name)))?;
    let losses = recorder.losses();
    let outcome = match run.advance(&mut [&mut recorder]) {
        Ok(Ending::Finished) => {
            recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished)?;
            Outcome::Finished
        }
        Ok(Ending::Stopped) => {
            recorder.checkpoint(&run.world, &run.totals, RunStatus::Stopped)?;
            Outcome::Stopped
        }
        Err(RunError::Output(error)) => return Err(error.into()),
        Err(error) => {
            recorder.fail(&run.world, &run.totals)?;
            Outcome::Failed(error.to_string())
        }
    };
    Ok((outcome, losses))
}

/// Whether the summary of a run says that it is done.
fn is_finished(folder: &Path) -> bool {
    let text = std::fs::read_to_string(folder.join("summary.json")).unwrap_or_default();
    serde_json::from_str::<serde_json::Value>(&text).is_ok_and(|summary| summary["status"] == "finished")
}

/// Writes a file of the sweep whole.
pub(crate) fn write(path: &Path, text: &str) -> Result<(), OutputError> {
    graintrain_io::files::write_atomically(path, text.as_bytes())
}
