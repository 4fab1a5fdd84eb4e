//! Checkpoints: an input is a payload, expanded, whose file is then made so that only what it says can be
//! wrong. What is read makes a step as `graintrain resume` would.

use crate::scene;
use graintrain::world::World;
use graintrain_io::checkpoint::{self, Checkpoint};
use graintrain_io::mark::Marks;
use graintrain_io::output::folder::RunFolder;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::run::{Run, RunSettings, RunTotals};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::time::Duration;

/// A step that takes longer is asked to stop.
const PATIENCE: Duration = Duration::from_secs(1);

/// Reads a payload and makes a step from it, written down in a folder.
pub fn run(payload: &[u8]) -> bool {
    let checkpoint = match checkpoint::from_bytes(&checkpoint::with_payload(payload), "a.ckpt") {
        Ok(checkpoint) => checkpoint,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            return false;
        }
    };
    let Checkpoint { settings, totals, world, marks } = checkpoint;
    world.state_hash();
    step(world, settings, totals, &marks);
    true
}

/// Makes one step as a run would, written down in a folder; whatever comes of it, an error is reported.
pub(crate) fn step(world: World, settings: RunSettings, totals: RunTotals, marks: &Marks) {
    let settings = RunSettings { steps: world.step.saturating_add(1), ..settings };
    let stop = Arc::new(AtomicBool::new(false));
    let Ok(mut run) = Run::new(world, settings, totals, Arc::clone(&stop)) else { return };
    let folder = tempfile::tempdir().expect("temporary folders can be made");
    let taken = RunFolder::open(folder.path()).expect("temporary folders can be taken");
    let Ok(mut recorder) = Recorder::resume(taken, &run.settings, &run.world, marks) else { return };
    let patience = set_later(stop);
    let _ = run.advance(&mut [&mut recorder]);
    drop(patience);
}

/// Sets a flag once the patience is over; not where what is returned is dropped before.
fn set_later(flag: Arc<AtomicBool>) -> Sender<()> {
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        if receiver.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
            flag.store(true, Ordering::Relaxed);
        }
    });
    sender
}

/// Payloads of small runs after some steps.
pub fn seeds() -> Vec<Vec<u8>> {
    let payload = |text: &String| {
        let simulation = scene::simulation(text);
        let settings = RunSettings { steps: 4, ..RunSettings::new(&simulation, None) };
        let mut run = Run::new(simulation.world, settings, RunTotals::default(), Arc::default())
            .expect("settings are sound");
        run.advance(&mut []).expect("seeds make steps");
        // Times of the clock differ from session to session.
        let totals = RunTotals {
            wall_seconds: 1.0,
            cpu_seconds: Some(1.0),
            phases: Default::default(),
            output_seconds: 0.0,
            last_output_seconds: 0.0,
            ..run.totals
        };
        let settings = RunSettings { steps: 9, ..run.settings };
        let bytes = checkpoint::to_bytes(&settings, &totals, &run.world).expect("memory takes it");
        checkpoint::payload(&bytes, "a.ckpt").expect("it was just written")
    };
    scene::texts().iter().map(payload).collect()
}
