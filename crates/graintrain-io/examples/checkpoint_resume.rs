//! Checkpoint and resume: a run is stopped half way, written, read again and finished, to the bits of an
//! uninterrupted one.
//!
//! `cargo run --release -p graintrain-io --example checkpoint_resume`

use graintrain_io::checkpoint;
use graintrain_io::run::{Run, RunSettings, RunTotals};
use graintrain_io::scene::{Scene, setting};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::temp_dir().join("graintrain-checkpoint");
    let load = || Scene::load("sedimentation", &[setting("n=1")?, setting("time.steps=60")?])?.build();
    let run = |simulation: graintrain_io::scene::Simulation, steps| {
        let settings = RunSettings { steps, ..RunSettings::new(&simulation, None) };
        Run::new(simulation.world, settings, RunTotals::default(), Default::default())
    };
    let mut whole = run(load()?, 60)?;
    whole.advance(&mut [])?;

    let mut half = run(load()?, 30)?;
    half.advance(&mut [])?;
    let path = checkpoint::write(&folder, &half.settings, &half.totals, &half.world)?;
    println!("step {} is in {}", half.world.step, path.display());

    let (kept, _damaged) = checkpoint::latest(&folder)?;
    let settings = RunSettings { steps: 60, ..kept.settings };
    let mut rest = Run::new(kept.world, settings, kept.totals, Default::default())?;
    rest.advance(&mut [])?;
    println!("uninterrupted {:016x}", whole.world.state_hash());
    println!("resumed       {:016x}", rest.world.state_hash());
    assert_eq!(whole.world.state_hash(), rest.world.state_hash());
    Ok(())
}
