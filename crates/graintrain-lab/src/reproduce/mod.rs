//! The paper's experiments, run again: tables 3 and 4, figures 8, 10, 11, 12 and 15, physical outputs, one
//! report.
//!
//! Every experiment is simulated once with the fastest solver; the contact problems of evenly spread steps
//! are then solved by every method from zero impulses, on one thread, to the paper's tolerance, within a time
//! limit. Methods that this build lacks are reported as missing. Each finished piece of work (cell) is a line
//! of `cells.jsonl`, so that a killed reproduction goes on where it was and loses no more than a minute of a
//! simulation or the solve under way; apart from seconds, and from iterates at which a time limit ended a
//! solve, results do not depend on interruptions or threads.
//!
//! | module | holds |
//! |---|---|
//! | [`published`] | the paper's numbers |
//! | [`trajectory`] | simulations, physical outputs, stored states |
//! | [`solves`] | one problem, one method; consecutive problems with and without re-use |
//! | [`ledger`] | finished cells on disk |
//! | [`physics`] | steady forces, friction angle, dilation, sensitivity |
//! | [`claims`] | verdicts on the paper's claims, by the figures measured here |
//! | [`compressibility`] | what low rank means for the Newton matrices of a drop, an experiment of its own |
//! | [`charts`], [`report`] | plots, CSV, the HTML report |

pub mod charts;
pub mod claims;
pub mod compressibility;
pub mod ledger;
pub mod physics;
pub mod published;
pub mod report;
pub mod solves;
pub mod trajectory;

use graintrain::stepper::StepError;
use graintrain_ccp::CcpError;
use graintrain_io::checkpoint::CheckpointError;
use graintrain_io::files::{OutputError, make_folder};
use graintrain_io::scene::SceneError;
use graintrain_tt::TtError;
use graintrain_view::render::RenderError;
use ledger::Ledger;
use solves::{Problems, ReuseRow, Solve};
use std::collections::HashSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use trajectory::{Experiment, Simulate, Trajectory, Variant};

/// Methods that are compared, in the order of the legends: the paper's three, the best tensor train, the
/// fastest.
pub const METHODS: [&str; 6] = ["pdip+none", "pdip+ilu", "pdip+tt-cross", "pdip+tt", "ipm", "auto"];

/// Methods whose re-use is measured (figure 8).
pub const TRAIN_METHODS: [&str; 3] = ["pdip+tt-cross", "pdip+tt-schur", "pdip+tt"];

/// The literal recipe. Its linear solves take so long that it is measured on the last state of a simulation
/// only.
const LITERAL: &str = "pdip+tt-cross";

/// States per simulation at which methods are compared.
const SAMPLES: usize = 3;
/// Perturbations of the lattice over which steady forces are averaged.
pub const SEEDS: u64 = 4;
/// Consecutive steps over which re-use is measured.
const REUSE_STEPS: usize = 4;

/// What to reproduce.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Everything.
    All,
    /// Mean ranks.
    Table3,
    /// Seconds of compression and inversion.
    Table4,
    /// Re-use.
    Fig8,
    /// Solve and precomputation time, sedimentation.
    Fig10,
    /// Precomputation time.
    Fig11,
    /// Inner iterations.
    Fig12,
    /// Solve and precomputation time, drafting and direct shear.
    Fig15,
    /// Forces and torques: both friction models, half the step, a tenth of the tolerance.
    Physics,
}

impl Target {
    /// Names on the command line.
    pub const NAMES: [(&'static str, Self); 9] = [
        ("all", Self::All),
        ("table3", Self::Table3),
        ("table4", Self::Table4),
        ("fig8", Self::Fig8),
        ("fig10", Self::Fig10),
        ("fig11", Self::Fig11),
        ("fig12", Self::Fig12),
        ("fig15", Self::Fig15),
        ("physics", Self::Physics),
    ];

    fn experiments(self) -> &'static [Experiment] {
        match self {
            Self::All | Self::Physics => &Experiment::ALL,
            Self::Fig15 => &[Experiment::Drafting, Experiment::DirectShear],
            _ => &[Experiment::Sedimentation],
        }
    }

    fn includes(self, other: Self) -> bool {
        self == Self::All || self == other
    }

    fn compares_methods(self) -> bool {
        !matches!(self, Self::Table3 | Self::Table4 | Self::Fig8 | Self::Physics)
    }
}

/// What to reproduce, how large, and where to.
#[derive(Clone, Debug)]
pub struct Settings {
    /// What.
    pub target: Target,
    /// The paper's size parameter n.
    pub n: usize,
    /// Steps of each simulation; `None` takes the experiments' own lengths.
    pub steps: Option<u64>,
    /// Folder of the results.
    pub out: PathBuf,
    /// Time limit of one solve; `None` takes 4 s (n/4)^3, at least 4 s.
    pub max_seconds: Option<f64>,
}

impl Settings {
    fn limit(&self) -> Duration {
        let standard = 4.0 * (self.n as f64 / 4.0).powi(3).max(1.0);
        Duration::try_from_secs_f64(self.max_seconds.unwrap_or(standard)).unwrap_or(Duration::MAX)
    }
}

/// Why a reproduction ended early. Finished cells are kept.
#[derive(Debug, thiserror::Error)]
pub enum ReproduceError {
    /// A scene cannot be built.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A step failed.
    #[error(transparent)]
    Step(StepError),
    /// A solver refused.
    #[error(transparent)]
    Solver(#[from] CcpError),
    /// A stored state is damaged.
    #[error(transparent)]
    State(#[from] CheckpointError),
    /// An output cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A picture cannot be made.
    #[error(transparent)]
    Picture(#[from] RenderError),
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Another process works in the folder.
    #[error("{}: another reproduction works in this folder; wait for it, or name another folder with --out", path.display())]
    Busy {
        /// The ledger.
        path: PathBuf,
    },
    /// A matrix cannot be factored.
    #[error("a Newton matrix cannot be factored: {0}")]
    Linear(String),
    /// A tensor train cannot be made.
    #[error(transparent)]
    Train(#[from] TtError),
    /// No threads can be started.
    #[error("no threads for the measurements: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The stop flag was set.
    #[error("stopped; the same command goes on from here")]
    Stopped,
}

impl From<StepError> for ReproduceError {
    fn from(error: StepError) -> Self {
        match error {
            StepError::Stopped => Self::Stopped,
            error => Self::Step(error),
        }
    }
}

/// Everything that was measured.
#[derive(Debug, Default)]
pub struct Results {
    /// Simulations.
    pub trajectories: Vec<(Simulate, Trajectory)>,
    /// Solves of single problems.
    pub solves: Vec<Solve>,
    /// Consecutive steps, by method.
    pub reuse: Vec<(String, Vec<ReuseRow>)>,
    /// Tables 3 and 4: rows of accuracies, columns of rank caps.
    pub ranks: [[Option<Solve>; 3]; 3],
    /// Methods that this build lacks.
    pub missing: Vec<String>,
    /// Lines of `cells.jsonl` that could not be read; their cells were measured again.
    pub damaged: usize,
}

impl Results {
    /// The simulation of an experiment at the largest size measured.
    pub fn trajectory(&self, experiment: Experiment, variant: Variant) -> Option<&Trajectory> {
        self.trajectories
            .iter()
            .filter(|(cell, _)| (cell.experiment, cell.variant, cell.seed) == (experiment, variant, 1))
            .max_by_key(|(cell, _)| cell.n)
            .map(|(_, trajectory)| trajectory)
    }

    /// The simulations of an experiment at the largest size measured, with the seeds of their lattices.
    pub fn seeds(&self, experiment: Experiment, variant: Variant) -> Vec<(u64, &Trajectory)> {
        let alike = |cell: &Simulate| cell.experiment == experiment && cell.variant == variant;
        let largest = self.trajectories.iter().filter(|(cell, _)| alike(cell)).map(|(cell, _)| cell.n).max();
        let wanted = |cell: &Simulate| alike(cell) && Some(cell.n) == largest;
        let found = self.trajectories.iter().filter(|(cell, _)| wanted(cell));
        found.map(|(cell, trajectory)| (cell.seed, trajectory)).collect()
    }
}

/// How far the work is.
#[derive(Clone, Debug)]
pub struct Progress {
    /// Finished cells, those of earlier sessions included.
    pub done: usize,
    /// All cells.
    pub total: usize,
    /// What is being done.
    pub label: String,
}

/// A piece of work.
enum Cell {
    Simulate(Simulate),
    Solve { state: Simulate, sample: usize, method: String },
    Reuse { state: Simulate, method: String },
    Rank { state: Simulate, row: usize, column: usize, method: String },
}

/// Name of the literal recipe at an accuracy and rank cap; the recipe's own setting has the plain name.
fn literal_method(row: usize, column: usize) -> String {
    match (row, column) {
        (0, 0) => LITERAL.to_string(),
        _ => format!("{LITERAL}@{:e},{}", published::ACCURACIES[row], published::RANK_CAPS[column]),
    }
}

fn cells(settings: &Settings, missing: &mut Vec<String>) -> Vec<Cell> {
    let Settings { target, n, steps, .. } = *settings;
    let simulate = |experiment, n, variant| Simulate { experiment, n, steps, variant, seed: 1 };
    let mut available = |method: &str| {
        let exists = solves::exists(method);
        if !exists && !missing.iter().any(|known| known == method) {
            missing.push(method.to_string());
        }
        exists
    };
    let mut cells = Vec::new();
    for &experiment in target.experiments() {
        // The paper's abscissa is the number of contacts: a smaller size of the sedimentation shows the
        // growth.
        let sizes = if experiment == Experiment::Sedimentation && target.compares_methods() {
            // Below n = 2 a few grains are wedged between mixer and walls.
            vec![n / 2, n]
        } else {
            vec![n]
        };
        for size in sizes.into_iter().filter(|&size| size >= 2.min(n)) {
            let state = simulate(experiment, size, Variant::Paper);
            cells.push(Cell::Simulate(state));
            if target.compares_methods() {
                for sample in 0..SAMPLES {
                    let last = sample == SAMPLES - 1;
                    let methods =
                        METHODS.iter().filter(|method| available(method) && (last || **method != LITERAL));
                    cells.extend(methods.map(|method| Cell::Solve {
                        state,
                        sample,
                        method: (*method).into(),
                    }));
                }
            }
        }
    }
    let state = simulate(Experiment::Sedimentation, n, Variant::Paper);
    if target.includes(Target::Fig8) {
        let methods = TRAIN_METHODS.iter().filter(|method| available(method));
        cells.extend(methods.map(|method| Cell::Reuse { state, method: (*method).into() }));
    }
    if target.includes(Target::Table3) || target.includes(Target::Table4) {
        for (row, column) in (0..9).map(|k| (k / 3, k % 3)) {
            // Larger caps take minutes each: they are measured where the tables themselves are asked for.
            if target == Target::All && column > 0 {
                continue;
            }
            let method = literal_method(row, column);
            if available(&method) {
                cells.push(Cell::Rank { state, row, column, method });
            }
        }
    }
    if target.includes(Target::Physics) {
        for experiment in [Experiment::Drafting, Experiment::DirectShear] {
            // A steady force is a mean over few force chains: its sensitivity needs several packings.
            let seeds = if target == Target::Physics { SEEDS } else { 1 };
            for seed in 1..=seeds {
                let variants = [Variant::Paper, Variant::HalfStep, Variant::TenthTolerance];
                let fresh = variants.into_iter().filter(|&variant| seed > 1 || variant != Variant::Paper);
                cells
                    .extend(fresh.map(|variant| {
                        Cell::Simulate(Simulate { seed, ..simulate(experiment, n, variant) })
                    }));
            }
        }
        // The slowest come last.
        cells.extend(
            Experiment::ALL.map(|experiment| Cell::Simulate(simulate(experiment, n, Variant::Coulomb))),
        );
    }
    cells
}

impl Cell {
    fn key(&self, limit: Duration) -> String {
        let limit = limit.as_secs_f64();
        match self {
            Self::Simulate(simulate) => simulate.key(),
            Self::Solve { state, sample, method } => {
                format!("solve/{}/sample={sample}/limit={limit}/{method}", state.key())
            }
            Self::Reuse { state, method } => format!("reuse/{}/limit={limit}/{method}", state.key()),
            Self::Rank { state, method, .. } => format!("rank/{}/limit={limit}/{method}", state.key()),
        }
    }

    fn label(&self) -> String {
        let size = |simulate: &Simulate| format!("{} n = {}", simulate.experiment.scene(), simulate.n);
        match self {
            Self::Simulate(simulate) => format!("simulate {}, {}", size(simulate), simulate.variant.name()),
            Self::Solve { state, sample, method } => {
                format!("{method} on {}, state {}", size(state), sample + 1)
            }
            Self::Reuse { state, method } => format!("re-use of {method} on {}", size(state)),
            Self::Rank { state, method, .. } => format!("ranks of {method} on {}", size(state)),
        }
    }
}

/// Does what is not yet done and gathers everything.
///
/// # Errors
/// [`ReproduceError`]; what was finished stays in the ledger.
pub fn measure(
    settings: &Settings,
    stop: &Arc<AtomicBool>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Results, ReproduceError> {
    let states = settings.out.join("states");
    make_folder(&states)?;
    let ledger = Ledger::open(&settings.out.join("cells.jsonl"))?;
    let mut results = Results::default();
    let cells = cells(settings, &mut results.missing);
    results.damaged = ledger.damaged;
    let mut session = Session {
        limit: settings.limit(),
        states,
        ledger,
        results,
        lost: HashSet::new(),
        problem: None,
        stop,
    };
    let total = cells.len();
    for (done, cell) in cells.iter().enumerate() {
        session.go_on()?;
        progress(&Progress { done, total, label: cell.label() });
        let key = cell.key(session.limit);
        match cell {
            Cell::Simulate(simulate) => session.simulate(simulate, &key, |step, steps| {
                let label = format!("{}, step {step} of {steps}", cell.label());
                progress(&Progress { done, total, label });
            })?,
            Cell::Solve { state, sample, method } => {
                if let Some(solve) = session.solve(state, *sample, method, &key)? {
                    session.results.solves.push(solve);
                }
            }
            Cell::Rank { state, method, row, column } => {
                if let Some(solve) = session.solve(state, SAMPLES - 1, method, &key)? {
                    session.results.ranks[*row][*column] = Some(solve);
                }
            }
            Cell::Reuse { state, method } => session.reuse(state, method, &key)?,
        }
    }
    progress(&Progress { done: total, total, label: "report".into() });
    Ok(session.results)
}

/// What is measured, cell by cell.
struct Session<'a> {
    limit: Duration,
    states: PathBuf,
    ledger: Ledger,
    results: Results,
    /// Methods that did not come back are not asked again: their threads still work, and an interruption
    /// changes nothing.
    lost: HashSet<String>,
    /// The problem of the last state, so that it is made once for all methods.
    problem: Option<(PathBuf, u64, Arc<graintrain_ccp::Ccp>)>,
    stop: &'a Arc<AtomicBool>,
}

impl Session<'_> {
    fn go_on(&self) -> Result<(), ReproduceError> {
        if self.stop.load(Ordering::Relaxed) { Err(ReproduceError::Stopped) } else { Ok(()) }
    }

    fn simulate(
        &mut self,
        simulate: &Simulate,
        key: &str,
        progress: impl FnMut(u64, u64),
    ) -> Result<(), ReproduceError> {
        // States that somebody removed are made again, since what follows needs them.
        let whole = |trajectory: &Trajectory| simulate.has_states(&self.states, trajectory);
        let trajectory = match self.ledger.get::<Trajectory>(key).filter(whole) {
            Some(trajectory) => trajectory,
            None => {
                let compared = simulate.seed == 1 && simulate.variant == Variant::Paper;
                let samples = if compared { SAMPLES } else { 0 };
                let trajectory = simulate.run(samples, &self.states, self.stop, progress)?;
                self.ledger.put(key, &trajectory)?;
                trajectory
            }
        };
        self.results.trajectories.push((*simulate, trajectory));
        Ok(())
    }

    /// What a method made of a sampled state; `None` of methods that are lost, and where there is no problem.
    fn solve(
        &mut self,
        state: &Simulate,
        sample: usize,
        method: &str,
        key: &str,
    ) -> Result<Option<Solve>, ReproduceError> {
        let solve = match self.ledger.get::<Solve>(key) {
            Some(solve) => solve,
            None if self.lost.contains(method) => return Ok(None),
            None => {
                let folder = state_folder(&self.results, state, sample, &self.states);
                if self.problem.as_ref().is_none_or(|(at, ..)| *at != folder) {
                    let posed = Problems::open(&folder, self.stop)?.advance()?;
                    self.problem = posed.map(|(step, ccp)| (folder, step, ccp));
                }
                let Some((_, step, ccp)) = &self.problem else { return Ok(None) };
                let place = (state.experiment.scene(), state.n, *step);
                let solve = solves::measure(ccp, method, self.limit, self.stop, place)?;
                self.go_on()?;
                self.ledger.put(key, &solve)?;
                solve
            }
        };
        if solve.residual.is_none() {
            self.lost.insert(method.to_string());
        }
        Ok(Some(solve))
    }

    fn reuse(&mut self, state: &Simulate, method: &str, key: &str) -> Result<(), ReproduceError> {
        let rows = match self.ledger.get::<Vec<ReuseRow>>(key) {
            Some(rows) => rows,
            None if self.lost.contains(method) => return Ok(()),
            None => {
                let folder = state_folder(&self.results, state, SAMPLES - 1, &self.states);
                let problems = Problems::open(&folder, self.stop)?;
                let rows = solves::reuse(problems, REUSE_STEPS, method, self.limit, self.stop)?;
                self.go_on()?;
                self.ledger.put(key, &rows)?;
                rows
            }
        };
        if rows.is_empty() {
            self.lost.insert(method.to_string());
        }
        self.results.reuse.push((method.to_string(), rows));
        Ok(())
    }
}

fn state_folder(results: &Results, state: &Simulate, sample: usize, states: &std::path::Path) -> PathBuf {
    let known = results.trajectories.iter().find(|(cell, _)| cell.key() == state.key());
    let step = known.and_then(|(_, trajectory)| trajectory.samples.get(sample)).copied().unwrap_or(0);
    state.state_folder(states, step)
}

#[cfg(test)]
mod tests;
