//! What is written into the folder of a run, and when: frames, tables, checkpoints, summary.

use super::bodies::particles;
use super::contacts::lines;
use super::exchange::PeriodicBox;
use super::folder::RunFolder;
use super::pvd::FrameList;
use super::summary::{RankSummary, RunStatus, Summary};
use super::surfaces::{Show, surfaces};
use super::tables::Tables;
use super::vtm::Blocks;
use super::vtp::PolyData;
use crate::body_numbers::BodyNumbers;
use crate::checkpoint;
use crate::files::{OutputError, make_folder, write_atomically};
use crate::mark::{Loss, Marks};
use crate::problem_file::{self, ProblemFileError};
use crate::run::{Observer, RunSettings, RunTotals, StepView};
use graintrain::world::World;
use graintrain_ccp::Ccp;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A checkpoint is also due after this wall-clock time: no more than that is lost when a run of long steps is
/// killed.
const LONGEST_WITHOUT_CHECKPOINT: Duration = Duration::from_secs(300);

/// Writes everything that a run leaves in its folder.
#[derive(Debug)]
pub struct Recorder {
    folder: RunFolder,
    settings: RunSettings,
    tables: Tables,
    all: FrameList,
    bodies: FrameList,
    surfaces: FrameList,
    contacts: FrameList,
    last_checkpoint: Instant,
    /// Set from outside to ask for a checkpoint after the step under way.
    pub checkpoint_wanted: Arc<AtomicBool>,
    /// What is reported of the processes of this session, where there are several.
    pub ranks: Option<RankSummary>,
}

impl Recorder {
    /// Begins the outputs of a new run in its folder: the resolved scene, the frame and a checkpoint of the
    /// initial state (a run killed early can go on, too).
    ///
    /// # Errors
    /// Where a file cannot be written.
    pub fn begin(
        folder: RunFolder,
        settings: &RunSettings,
        world: &World,
        resolved_scene: &str,
    ) -> Result<Self, OutputError> {
        let path = folder.path();
        write_atomically(&path.join("scene.toml"), resolved_scene.as_bytes())?;
        let mut recorder = Self {
            settings: settings.clone(),
            tables: Tables::create(path, &settings.measures)?,
            all: FrameList::new(path.join("all.pvd")),
            bodies: FrameList::new(path.join("bodies.pvd")),
            surfaces: FrameList::new(path.join("surfaces.pvd")),
            contacts: FrameList::new(path.join("contacts.pvd")),
            last_checkpoint: Instant::now(),
            checkpoint_wanted: Arc::default(),
            ranks: None,
            folder,
        };
        recorder.frame(world, &BodyNumbers::default())?;
        recorder.checkpoint(world, &RunTotals::default(), RunStatus::Running)?;
        Ok(recorder)
    }

    /// Goes on with the outputs in a folder from the state of a checkpoint, when they held what `marks` say:
    /// whatever was written after it is dropped.
    ///
    /// # Errors
    /// Where a file cannot be read or written.
    pub fn resume(
        folder: RunFolder,
        settings: &RunSettings,
        world: &World,
        marks: &Marks,
    ) -> Result<Self, OutputError> {
        let path = folder.path();
        let list = |name: &str| FrameList::reopen(path.join(name), world.time, marks.get(name).copied());
        Ok(Self {
            settings: settings.clone(),
            tables: Tables::reopen(path, &settings.measures, world.step, marks)?,
            all: list("all.pvd")?,
            bodies: list("bodies.pvd")?,
            surfaces: list("surfaces.pvd")?,
            contacts: list("contacts.pvd")?,
            last_checkpoint: Instant::now(),
            checkpoint_wanted: Arc::default(),
            ranks: None,
            folder,
        })
    }

    /// Folder of the run.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Tables and lists of frames that were missing or damaged when this run was resumed: nothing of them is
    /// erased.
    pub fn losses(&self) -> Vec<Loss> {
        let lists = self.lists().into_iter().filter_map(|(_, list)| list.loss());
        self.tables.losses().chain(lists).cloned().collect()
    }

    fn lists(&self) -> [(&'static str, &FrameList); 4] {
        [
            ("all.pvd", &self.all),
            ("bodies.pvd", &self.bodies),
            ("surfaces.pvd", &self.surfaces),
            ("contacts.pvd", &self.contacts),
        ]
    }

    /// Writes a checkpoint and the summary so far; tables are on the disk before it is.
    ///
    /// # Errors
    /// Where a file cannot be written.
    pub fn checkpoint(
        &mut self,
        world: &World,
        totals: &RunTotals,
        status: RunStatus,
    ) -> Result<Summary, OutputError> {
        if matches!(status, RunStatus::Finished) && world.step < self.settings.steps {
            // The last stage ended before the time was over.
            self.settings.steps = world.step;
            self.frame(world, &totals.open_boundaries.numbers)?;
        }
        self.tables.sync()?;
        for list in [&mut self.all, &mut self.bodies, &mut self.surfaces, &mut self.contacts] {
            list.write()?;
        }
        let mut marks = self.tables.marks();
        let lists = self.lists();
        marks.extend(lists.iter().filter_map(|(name, list)| Some((name.to_string(), list.mark()?))));
        checkpoint::write_marked(
            &self.folder.path().join("checkpoints"),
            &self.settings,
            totals,
            world,
            &marks,
        )?;
        self.last_checkpoint = Instant::now();
        let summary = Summary { ranks: self.ranks, ..Summary::new(world, &self.settings, totals, status) };
        summary.write(self.folder.path())?;
        Ok(summary)
    }

    /// Leaves the last good state of a run that failed: its frame, a checkpoint, the summary.
    ///
    /// # Errors
    /// Where a file cannot be written.
    pub fn fail(&mut self, world: &World, totals: &RunTotals) -> Result<Summary, OutputError> {
        self.frame(world, &totals.open_boundaries.numbers)?;
        self.checkpoint(world, totals, RunStatus::Failed)
    }

    /// Writes the frames of the bodies, surfaces and contacts.
    fn frame(&mut self, world: &World, numbers: &BodyNumbers) -> Result<(), OutputError> {
        let (output, step) = (&self.settings.output, self.settings.stepping.step);
        if !(output.bodies || output.contacts) {
            return Ok(());
        }
        let frames = self.folder.path().join("frames");
        make_folder(&frames)?;
        let in_folder =
            |names: &[String]| names.iter().map(|name| format!("frames/{name}")).collect::<Vec<_>>();
        let cell = world.cell().map(PeriodicBox::of);
        let write = |name: String, data: &PolyData| -> Result<String, OutputError> {
            let path = frames.join(&name);
            let mut bytes = Vec::new();
            data.write(&mut bytes, world.time, cell.as_ref(), output.precision)
                .map_err(|error| OutputError::new("write", &path, error))?;
            write_atomically(&path, &bytes)?;
            Ok(name)
        };
        // Frames of such runs name the forms of bodies from the first one on.
        let is_first = self.settings.open_boundaries.changes_bodies() && !numbers.has_changed();
        let numbers = &if is_first { BodyNumbers::of_scene(world.bodies.len()) } else { numbers.clone() };
        let number = format!("{:08}", world.step);
        let mut blocks = Blocks::default();
        if output.bodies {
            let file = write(format!("bodies_{number}.vtp"), &particles(world, numbers, step))?;
            self.bodies.push(world.time, &in_folder(std::slice::from_ref(&file)))?;
            blocks.particles = Some(file);
            let fixed = surfaces(world, numbers, &self.settings.stages, Show::Fixed);
            if !fixed.cells.is_empty() {
                // Written once: what never moves is the same in every frame.
                let name = "surfaces_fixed.vtp".to_string();
                let is_first = self.surfaces.is_empty();
                blocks.meshes.push(("fixed", if is_first { write(name, &fixed)? } else { name }));
            }
            let moving = surfaces(world, numbers, &self.settings.stages, Show::Moving);
            if !moving.cells.is_empty() {
                blocks.meshes.push(("moving", write(format!("surfaces_{number}.vtp"), &moving)?));
            }
            let files: Vec<String> = blocks.meshes.iter().map(|(_, file)| file.clone()).collect();
            if !files.is_empty() {
                self.surfaces.push(world.time, &in_folder(&files))?;
            }
        }
        if output.contacts {
            let contacts = lines(world, numbers, step);
            let file = write(format!("contacts_{number}.vtp"), &contacts)?;
            self.contacts.push(world.time, &in_folder(std::slice::from_ref(&file)))?;
            blocks.contacts = (!contacts.cells.is_empty()).then_some(file);
        }
        let name = format!("all_{number}.vtm");
        write_atomically(&frames.join(&name), blocks.text().as_bytes())?;
        self.all.push(world.time, &in_folder(&[name]))
    }
}

/// The part of [`Recorder`] for `--dump-problem`.
impl Recorder {
    fn dump(&self, world: &World, problem: &Ccp) -> Result<(), OutputError> {
        let folder = self.folder.path().join("problems");
        make_folder(&folder)?;
        let path = folder.join(format!("step_{:08}.hdf5", world.step));
        let title = format!("{}, step {}, time {} s", self.settings.scene, world.step, world.time);
        problem_file::write(&path, problem, &title).map_err(|error| {
            let source = match error {
                ProblemFileError::Io { source, .. } => source,
                other => std::io::Error::other(other),
            };
            OutputError::new("write", &path, source)
        })
    }
}

impl Observer for Recorder {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        let StepView { world, report, totals, measured, problem } = step;
        self.tables.append(world, report, totals.last_output_seconds)?;
        self.tables.append_measured(measured)?;
        let is_last = world.step == self.settings.steps;
        if world.step.is_multiple_of(self.settings.output.every.max(1)) || is_last {
            self.frame(world, &totals.open_boundaries.numbers)?;
        }
        let dump_every = self.settings.dump_problem_every.filter(|&every| every > 0);
        if let (Some(every), Some((problem, _))) = (dump_every, problem)
            && world.step.is_multiple_of(every)
        {
            self.dump(world, problem)?;
        }
        Ok(())
    }

    fn keep(&mut self, world: &World, totals: &RunTotals) -> Result<(), OutputError> {
        let checkpoint_every = self.settings.output.checkpoint_every.max(1);
        let is_due = world.step.is_multiple_of(checkpoint_every)
            || self.last_checkpoint.elapsed() >= LONGEST_WITHOUT_CHECKPOINT
            || self.checkpoint_wanted.swap(false, Ordering::Relaxed);
        // The last one is written by whoever ends the run, since it knows how the run ended.
        if is_due && world.step != self.settings.steps {
            self.checkpoint(world, totals, RunStatus::Running)?;
        }
        Ok(())
    }
}
