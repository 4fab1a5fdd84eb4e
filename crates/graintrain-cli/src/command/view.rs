//! `graintrain view`: a replay of a run.

use crate::error::Failure;
use crate::terminal::say;
use graintrain_io::files::write_atomically;
use graintrain_view::view::{RunFolder, ViewSettings, page};
use std::path::PathBuf;
use std::process::ExitCode;

/// Make one self-contained HTML replay of a run
///
/// The page works without network: time slider, orbit camera, colours by speed, force or radius, force
/// chains, and plots of the run's tables.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain view out/sedimentation\n  graintrain view out/run --out replay.html --frames 60"
)]
pub struct Arguments {
    /// Folder of the run
    run: PathBuf,
    /// File to write; by default replay.html in the run's folder
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
    /// Most frames in the page; more are thinned evenly
    #[arg(long, value_name = "N", default_value_t = ViewSettings::default().max_frames as u64, value_parser = clap::value_parser!(u64).range(1..))]
    frames: u64,
    /// Leave the contact forces out: a smaller page
    #[arg(long)]
    no_contacts: bool,
}

/// Writes the page.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let settings =
        ViewSettings { max_frames: arguments.frames as usize, force_chains: !arguments.no_contacts };
    let remedy = "give the folder of a run made by `graintrain run`";
    let html = RunFolder::open(&arguments.run)
        .and_then(|run| page(&run, &settings))
        .map_err(|error| Failure::input_error(error, remedy))?;
    let path = arguments.out.clone().unwrap_or_else(|| arguments.run.join("replay.html"));
    write_atomically(&path, html.as_bytes()).map_err(|error| {
        let remedy = error.remedy();
        Failure::work_error(error, remedy)
    })?;
    say!("{} ({:.1} MB)\n", path.display(), html.len() as f64 / 1e6);
    Ok(ExitCode::SUCCESS)
}
