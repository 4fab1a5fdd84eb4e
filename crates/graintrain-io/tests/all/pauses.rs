//! Runs that are stopped and taken up again.

use graintrain_io::checkpoint;
use graintrain_io::files::OutputError;
use graintrain_io::output::folder::RunFolder;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::RunStatus;
use graintrain_io::run::{Ending, Observer, Run, RunSettings, RunTotals, StepView};
use graintrain_io::scene::Scene;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Sets the stop flag after the step of this number.
pub struct StopAfter(pub u64, pub Arc<AtomicBool>);

impl Observer for StopAfter {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        self.1.store(step.world.step >= self.0, Ordering::Relaxed);
        Ok(())
    }
}

/// Runs a scene in a folder, stopped and taken up again after these steps.
pub fn run_with_pauses(scene: &Scene, folder: &Path, pauses: &[u64]) -> Run {
    let simulation = scene.build().unwrap();
    let settings = RunSettings::new(&simulation, None);
    let taken = RunFolder::create(folder, false).unwrap();
    let mut recorder = Recorder::begin(taken, &settings, &simulation.world, "").unwrap();
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), Default::default()).unwrap();
    for &pause in pauses {
        let stop: Arc<AtomicBool> = Arc::default();
        run = Run::new(run.world, run.settings, run.totals, stop.clone()).unwrap();
        assert_eq!(run.advance(&mut [&mut recorder, &mut StopAfter(pause, stop)]).unwrap(), Ending::Stopped);
        recorder.checkpoint(&run.world, &run.totals, RunStatus::Stopped).unwrap();
        drop(recorder);
        let (saved, _) = checkpoint::latest(&folder.join("checkpoints")).unwrap();
        recorder =
            Recorder::resume(RunFolder::open(folder).unwrap(), &saved.settings, &saved.world, &saved.marks)
                .unwrap();
        run = Run::new(saved.world, saved.settings, saved.totals, Default::default()).unwrap();
    }
    assert_eq!(run.advance(&mut [&mut recorder]).unwrap(), Ending::Finished);
    recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished).unwrap();
    run
}
