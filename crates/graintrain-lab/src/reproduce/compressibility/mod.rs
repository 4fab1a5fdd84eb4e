//! The settling experiment: what low rank means for the Newton matrices of the paper's interior point, and
//! what it buys.
//!
//! One sedimentation is stopped in free fall, falling and settled. From each state the contact problem of the
//! next step is solved by the paper's interior point (its start and rules, and ours), and of the Newton
//! systems S x = b on the way the trains are made by the exact pass and by the cross, at the paper's
//! accuracies and caps (its table 3). For each: ranks, errors in three norms, an approximate inverse X,
//! whether X is definite, iterations of BiCGSTAB with X, and with block Jacobi, ILU(0) and IC(0) in Morton
//! order.
//!
//! | module | holds |
//! |---|---|
//! | `drop` | states and problems |
//! | [`record`] | the Newton systems of a whole solve |
//! | [`system`] | one of them: errors, solves |
//! | [`inverse`] | approximate inverses as trains |
//! | [`readings`] | what the paper's text leaves open |
//! | [`table`], [`summary`] | the CSV, its means |
//!
//! Every row is in a line of `cells.jsonl` as soon as it is measured; `compressibility.csv` and `summary.md`
//! are written from all that the folder has, so that calls with other sizes and settings and the same folder
//! add to one table.

pub mod drop;
pub mod inverse;
pub mod readings;
pub mod record;
pub mod summary;
pub mod system;
pub mod table;

use super::ledger::Ledger;
use super::{Progress, ReproduceError};
use drop::{Drop, Phase};
use graintrain_ccp::paper::tensor_train::inverse::mean_rank;
use graintrain_io::files::{make_folder, write_atomically};
use graintrain_linalg::patience::Patience;
use graintrain_tt::cross::{CrossSettings, cross_sparse_within};
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtError, TtMatrix};
use inverse::{Approximate, Exact, Kind, Wanted};
use readings::{BASE, Form, READINGS, Reading, SWEEPS};
use record::{Path as NewtonPath, Start, follow};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use system::{Bed, Slots, System};
use table::{COLUMNS, Case, Figures, Key, Row, Solved};

/// The paper's accuracies.
const ACCURACIES: [f64; 3] = [1e-2, 1e-3, 1e-4];

/// The paper's setting of its preconditioner.
pub const PAPER: (f64, usize) = (1e-2, 10);

/// Newton iterations that a solve is followed for by default; the paper needs 50 to 100.
pub const LONGEST: usize = 100;

/// Radius of the grains, m.
const RADIUS: f64 = 0.1;

/// Nonzeros that the cross is shown, about.
const PROBES: usize = 20_000;

/// Caps above which no inverse is iterated (a local system has rank^2 times mode unknowns), or truncated (a
/// product with it costs more than one with the full inverse of a small matrix).
const INVERSE_CAPS: [usize; 2] = [10, 100];

/// Readings that are measured at every system that is measured at all.
const EVERYWHERE: [&str; 2] = ["no-dummies", "scaled"];

/// What is measured, and where to.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The paper's size parameter.
    pub n: usize,
    /// Contact envelopes, radii.
    pub envelopes: Vec<f64>,
    /// Densities, kg/m^3.
    pub densities: Vec<f64>,
    /// Phases of the drop.
    pub phases: Vec<Phase>,
    /// Every so many-th Newton system is measured at the paper's setting; the first, the 10th and the last
    /// always are, at every setting.
    pub every: usize,
    /// Newton iterations after which a solve is followed no further.
    pub newton: usize,
    /// Caps on the ranks.
    pub caps: Vec<usize>,
    /// Whether the readings of the recipe are measured too: at the first, the 10th and the last system, two
    /// of them at every measured one.
    pub readings: bool,
    /// Time limit of one compression, inversion or linear solve.
    pub limit: Duration,
    /// Folder of the results.
    pub out: PathBuf,
}

/// What was measured, and where it was written.
#[derive(Debug)]
pub struct Measured {
    /// All rows that the folder has, those of earlier calls included.
    pub rows: Vec<Row>,
    /// The table.
    pub table: PathBuf,
    /// Means as Markdown.
    pub summary: String,
    /// Rows that this call measured.
    pub new: usize,
    /// Lines of `cells.jsonl` that could not be read; their rows were measured again.
    pub damaged: usize,
}

/// Measures what is not yet in the folder, and writes the table and its means.
///
/// # Errors
/// [`ReproduceError`]; finished rows are kept for the next call.
pub fn reproduce(
    settings: &Settings,
    stop: &Arc<AtomicBool>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Measured, ReproduceError> {
    make_folder(&settings.out)?;
    let ledger = Ledger::open(&settings.out.join("cells.jsonl"))?;
    let mut run = Run { settings, ledger, stop, progress, new: 0, done: 0, total: 0 };
    let cases = cases(settings);
    // Systems per solve until it is known: solves take about 50 iterations.
    run.total = cases.len() * (3 + 50 / settings.every);
    for (k, (case, phase, start)) in cases.iter().enumerate() {
        run.case(case, *phase, *start)?;
        // From here on the share of the cases that are done is known better than the number of systems.
        run.total = (run.done * cases.len()).div_ceil(k + 1).max(run.done);
    }
    let Run { new, ledger, .. } = run;
    let mut rows: Vec<Row> = ledger.all::<Vec<Row>>().flatten().collect();
    rows.sort_by(Row::order);
    let table = settings.out.join("compressibility.csv");
    let lines = std::iter::once(COLUMNS.to_string()).chain(rows.iter().map(Row::line));
    write_atomically(&table, (lines.collect::<Vec<_>>().join("\n") + "\n").as_bytes())?;
    let summary = summary::markdown(&rows);
    write_atomically(&settings.out.join("summary.md"), summary.as_bytes())?;
    Ok(Measured { rows, table, summary, new, damaged: ledger.damaged })
}

fn cases(settings: &Settings) -> Vec<(Case, Phase, Start)> {
    let mut cases = Vec::new();
    for &envelope in &settings.envelopes {
        for &density in &settings.densities {
            for &phase in &settings.phases {
                for start in Start::ALL {
                    let (phase_name, start_name) = (phase.name().to_string(), start.name().to_string());
                    let case =
                        Case { n: settings.n, envelope, density, phase: phase_name, start: start_name };
                    cases.push((case, phase, start));
                }
            }
        }
    }
    cases
}

/// The first, the 10th (the middle one of fewer) and the last of so many systems.
fn marked(systems: usize) -> [usize; 3] {
    let last = systems.saturating_sub(1);
    [0, if last > 9 { 9 } else { last / 2 }, last]
}

/// The iterations of a solve that are measured.
fn measured(every: usize, systems: usize) -> Vec<usize> {
    let marked = marked(systems);
    (0..systems).filter(|k| k % every == 0 || marked.contains(k)).collect()
}

/// What is measured at one system.
fn keys(settings: &Settings, iteration: usize, systems: usize) -> Vec<Key> {
    let key = |reading: &str, method: &str, (accuracy, cap): (f64, usize)| Key {
        iteration,
        reading: reading.into(),
        method: method.into(),
        accuracy,
        cap,
    };
    let mut keys = vec![key(BASE.name, "classic", (0.0, 0)), key(BASE.name, "exact", PAPER)];
    if settings.readings && settings.caps.contains(&PAPER.1) {
        keys.extend(EVERYWHERE.map(|reading| key(reading, "exact", PAPER)));
    }
    if !marked(systems).contains(&iteration) {
        return keys;
    }
    keys.push(key(BASE.name, "cross", PAPER));
    for accuracy in ACCURACIES {
        for &cap in &settings.caps {
            if (accuracy, cap) != PAPER {
                keys.extend(["exact", "cross"].map(|method| key(BASE.name, method, (accuracy, cap))));
            }
        }
    }
    if settings.readings {
        for reading in &READINGS {
            if reading.form == Form::Compliant || reading.tolerance != BASE.tolerance {
                keys.push(key(reading.name, "classic", (0.0, 0)));
            }
            let known = |cap: usize| cap == PAPER.1 && EVERYWHERE.contains(&reading.name);
            for &cap in settings.caps.iter().filter(|&&cap| cap <= INVERSE_CAPS[1] && !known(cap)) {
                keys.push(key(reading.name, "exact", (PAPER.0, cap)));
            }
        }
    }
    keys
}

/// A measurement under way.
struct Run<'a> {
    settings: &'a Settings,
    ledger: Ledger,
    stop: &'a Arc<AtomicBool>,
    progress: &'a mut dyn FnMut(&Progress),
    new: usize,
    done: usize,
    total: usize,
}

impl Run<'_> {
    /// Name of a case in the ledger.
    fn name(&self, case: &Case) -> String {
        let Case { n, envelope, density, phase, start } = case;
        let name = format!("n={n}/envelope={envelope}/density={density}/{phase}/{start}");
        if self.settings.newton == LONGEST { name } else { format!("{name}/newton={}", self.settings.newton) }
    }

    fn tell(&mut self, label: String) {
        (self.progress)(&Progress { done: self.done, total: self.total.max(self.done), label });
    }

    fn case(&mut self, case: &Case, phase: Phase, start: Start) -> Result<(), ReproduceError> {
        let name = self.name(case);
        let known: Option<Solved> = self.ledger.get(&name);
        let whole = known.as_ref().is_some_and(|solved| {
            let iterations = measured(self.settings.every, solved.systems);
            let mut wanted = iterations.iter().flat_map(|&k| keys(self.settings, k, solved.systems));
            wanted.all(|key| self.ledger.get::<Vec<Row>>(&cell(&name, &key)).is_some())
        });
        let path = if whole { None } else { Some(self.follow(case, phase, start)?) };
        let Some(solved) = path.as_ref().map_or(known, |(solved, _)| Some(solved.clone())) else {
            return Ok(());
        };
        self.ledger.put(&name, &solved)?;
        let mut path = path.and_then(|(_, path)| path);
        for iteration in measured(self.settings.every, solved.systems) {
            if let Some((bed, path)) = &mut path {
                self.system(case, &solved, bed, path, iteration)?;
            }
            self.done += 1;
        }
        Ok(())
    }

    /// Solves the problem of a case and keeps its systems.
    #[allow(clippy::type_complexity)]
    fn follow(
        &mut self,
        case: &Case,
        phase: Phase,
        start: Start,
    ) -> Result<(Solved, Option<(Bed, NewtonPath)>), ReproduceError> {
        let drop = Drop::new(case.n, &self.settings.out.join("states"));
        let stop = Arc::clone(self.stop);
        drop.prepare(phase, &stop, |step, steps| {
            self.tell(format!("drop n = {}, step {step} of {steps}", case.n));
        })?;
        self.tell(format!("Newton systems of {}", self.name(case)));
        let problem = drop.problem(phase, case.envelope * RADIUS, case.density, &stop)?;
        let Some(problem) = problem else {
            return Ok((Solved { contacts: 0, systems: 0, status: "no contacts".into() }, None));
        };
        let every = self.settings.every;
        let path = follow(&problem, start, self.settings.newton, move |k| k % every == 0 || k < 10, &stop)?;
        let solved = Solved {
            contacts: problem.num_contacts(),
            systems: path.systems.last().map_or(0, |last| last.iteration + 1),
            status: format!("{:?}", path.status).to_lowercase(),
        };
        Ok((solved, Some((Bed::new(&problem), path))))
    }

    /// Measures what is missing of one system.
    fn system(
        &mut self,
        case: &Case,
        solved: &Solved,
        bed: &mut Bed,
        path: &NewtonPath,
        iteration: usize,
    ) -> Result<(), ReproduceError> {
        let Some(recorded) = path.systems.iter().find(|system| system.iteration == iteration) else {
            return Ok(());
        };
        let mut missing = keys(self.settings, iteration, solved.systems);
        missing.retain(|key| self.ledger.get::<Vec<Row>>(&cell(&self.name(case), key)).is_none());
        if missing.is_empty() {
            return Ok(());
        }
        let system = bed.system(recorded)?;
        let mut exact = [Inverses::default(), Inverses::default()];
        for key in missing {
            if self.stop.load(Ordering::Relaxed) {
                return Err(ReproduceError::Stopped);
            }
            self.tell(format!("{}, iteration {iteration}: {} {}", self.name(case), key.reading, key.method));
            let reading = Reading::find(&key.reading).unwrap_or(&BASE);
            let other = reading.system(bed, &system)?;
            let [own, foreign] = &mut exact;
            let (system, inverses) = other.as_ref().map_or((&system, own), |other| {
                *foreign = Inverses::default();
                (other, foreign)
            });
            let patience = Patience::new(None, Some(Arc::clone(self.stop)));
            let study = Study { reading, system, bed, limit: self.settings.limit, stop: self.stop, patience };
            let row = |method: &str, figures| Row {
                case: case.clone(),
                solved: solved.clone(),
                key: Key { method: method.into(), ..key.clone() },
                figures,
            };
            let rows: Vec<Row> = if key.method == "classic" {
                let counts = system.classic(reading.tolerance, &study.deadline());
                counts
                    .map(|(method, bicgstab)| row(method, Figures { bicgstab, ..Figures::default() }))
                    .to_vec()
            } else {
                vec![row(&key.method, study.train(&key, inverses)?)]
            };
            if self.stop.load(Ordering::Relaxed) {
                return Err(ReproduceError::Stopped);
            }
            self.new += rows.len();
            self.ledger.put(&cell(&self.name(case), &key), &rows)?;
        }
        Ok(())
    }
}

/// Name of a measurement in the ledger.
fn cell(case: &str, key: &Key) -> String {
    let Key { iteration, reading, method, accuracy, cap } = key;
    format!("{case}/iteration={iteration}/{reading}/{method}@{accuracy:e},{cap}")
}

/// The exact inverses of a system and of its scaled form, made when they are first asked for.
#[derive(Default)]
struct Inverses {
    plain: Option<Option<Exact>>,
    scaled: Option<Option<Exact>>,
}

impl Inverses {
    fn of(&mut self, reading: &Reading, system: &System) -> Result<Option<&Exact>, ReproduceError> {
        let kept = if reading.form == Form::Scaled { &mut self.scaled } else { &mut self.plain };
        if kept.is_none() {
            *kept = Some(Exact::new(reading.matrix(system))?);
        }
        Ok(kept.as_ref().and_then(Option::as_ref))
    }
}

/// One system under one reading.
struct Study<'a> {
    reading: &'a Reading,
    system: &'a System,
    bed: &'a Bed,
    limit: Duration,
    stop: &'a Arc<AtomicBool>,
    patience: Patience,
}

impl Study<'_> {
    fn deadline(&self) -> Patience {
        Patience::new(Instant::now().checked_add(self.limit), Some(Arc::clone(self.stop)))
    }

    /// Train, errors, inverse and solves at one accuracy and cap. What takes longer than the limit, or does
    /// not fit (leaves of the exact pass), is absent.
    fn train(&self, key: &Key, inverses: &mut Inverses) -> Result<Figures, ReproduceError> {
        let Self { reading, system, .. } = self;
        let slots = self.bed.slots(reading.leaf, reading.split);
        let scaled = reading.form == Form::Scaled;
        let quadtree = system.quadtree(scaled, &slots, reading.dummy(system))?;
        let begin = Instant::now();
        let compressed = match key.method.as_str() {
            "cross" => self.cross(&quadtree, key),
            _ => reading
                .truncation(&quadtree, system, key.accuracy, key.cap)
                .and_then(|truncation| quadtree.to_train(&truncation))
                .map(|(train, report)| (train, report.error)),
        };
        let (train, error) = match compressed {
            Ok(compressed) => compressed,
            Err(TtError::Stopped | TtError::TooLarge { .. }) => return Ok(Figures::default()),
            Err(error) => return Err(error.into()),
        };
        let mut figures = Figures {
            rank: Some(mean_rank(&train)),
            largest_rank: Some(train.max_rank()),
            augmented: Some(error * quadtree.norm() / quadtree.augmented_norm()),
            unscaled: Some(error),
            scaled: system.scaled_error(&train, scaled, &slots)?,
            ..Figures::default()
        };
        let mut seconds = begin.elapsed();
        let exact = match key.method.as_str() {
            "cross" => None,
            _ => inverses.of(reading, system)?,
        };
        let kind = match reading.inverse {
            Kind::Truncated if exact.is_none() => Kind::Iterated(SWEEPS[0]),
            kind => kind,
        };
        if key.cap > INVERSE_CAPS[usize::from(!matches!(kind, Kind::Iterated(_)))] {
            return Ok(Figures { seconds: Some(seconds.as_secs_f64()), ..figures });
        }
        let deadline = self.deadline();
        let begin = Instant::now();
        // Of the inverse itself, the accuracy is relative to its own norm.
        let wanted = Wanted { kind, scaled, truncation: Truncation::capped(key.accuracy, key.cap) };
        let inverse = Approximate::new(wanted, exact, &train, &slots, &|| {
            deadline.is_over() || self.patience.is_over()
        });
        seconds += begin.elapsed();
        figures.seconds = Some(seconds.as_secs_f64());
        figures.inverse = Some(kind.name().to_string());
        let mut inverse = match inverse {
            Ok(Some(inverse)) => inverse,
            Ok(None) | Err(ReproduceError::Train(TtError::Stopped)) => return Ok(figures),
            Err(error) => return Err(error),
        };
        figures.inverse_rank = Some(inverse.ranks.0);
        figures.inverse_largest = Some(inverse.ranks.1);
        figures.inverse_error = Some(inverse.error);
        figures.definite = Some(inverse.definite);
        self.solve(&mut inverse, &slots, &mut figures);
        Ok(figures)
    }

    /// The paper's compression, within the limit.
    fn cross(&self, quadtree: &QuadtreeMatrix, key: &Key) -> Result<(TtMatrix, f64), TtError> {
        let settings =
            CrossSettings { tolerance: key.accuracy, max_rank: key.cap, ..CrossSettings::default() };
        let stride = quadtree.num_entries() / PROBES + 1;
        let deadline = self.deadline();
        let (train, report) = cross_sparse_within(quadtree, None, stride, &settings, &|| deadline.is_over())?;
        // (An error too small to be resolved as a difference of squares is none.)
        Ok((train, report.exact_error.unwrap_or(0.0)))
    }

    /// Iterations with the inverse.
    fn solve(&self, inverse: &mut Approximate, slots: &Slots, figures: &mut Figures) {
        let Self { reading, system, .. } = self;
        let mut apply = |r: &[f64], z: &mut [f64]| inverse.apply(system, slots, r, z);
        figures.bicgstab = system.bicgstab(&mut apply, reading.tolerance, &self.deadline());
        figures.refinement = system.refinement(&mut apply, reading.tolerance, &self.deadline());
    }
}

#[cfg(test)]
mod tests;
