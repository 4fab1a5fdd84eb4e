//! Read results: runs a small built-in scene, then reads its table of steps and its summary as any program
//! can.
//!
//! `cargo run --release -p graintrain-io --example read_results`

use graintrain_io::output::folder::RunFolder;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::RunStatus;
use graintrain_io::run::{Run, RunSettings, RunTotals};
use graintrain_io::scene::{Scene, setting};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::temp_dir().join("graintrain-read-results");
    let simulation = Scene::load("stack", &[setting("n=3")?, setting("time.steps=50")?])?.build()?;
    let settings = RunSettings::new(&simulation, None);
    let resolved = simulation.resolved.to_toml()?;
    let results = RunFolder::create(&folder, true)?;
    let mut recorder = Recorder::begin(results, &settings, &simulation.world, &resolved)?;
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), Default::default())?;
    run.advance(&mut [&mut recorder])?;
    recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished)?;

    // The tables have one line of names; `columns.json` says what each means.
    let table = std::fs::read_to_string(folder.join("steps.csv"))?;
    let mut lines = table.lines();
    let names: Vec<&str> = lines.next().unwrap_or("").split(',').collect();
    let column = |name: &str| names.iter().position(|n| *n == name).ok_or(format!("no column {name}"));
    let (time, contacts, rms) = (column("time")?, column("contacts")?, column("residual_rms")?);
    for line in lines.step_by(10) {
        let cells: Vec<&str> = line.split(',').collect();
        let (time, rms): (f64, f64) = (cells[time].parse()?, cells[rms].parse()?);
        println!("{time:.2} s: {} contacts, residual {rms:.1e}", cells[contacts]);
    }
    let summary: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("summary.json"))?)?;
    println!("{}: state hash {}", summary["status"], summary["state_hash"]);
    Ok(())
}
