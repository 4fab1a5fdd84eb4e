//! `graintrain export`: the frames of a run for other programs.

use crate::error::Failure;
use crate::terminal::say;
use graintrain_io::files::write_atomically;
use graintrain_io::output::exchange::Snapshot;
use graintrain_io::output::vtkhdf;
use graintrain_view::view::{RunFolder, usd};
use std::io;
use std::path::PathBuf;
use std::process::ExitCode;

/// Write the frames of a run for other programs
///
/// Spheres, and centres of other bodies, with radius, mass, velocities, forces and orientation, to the
/// precision of the frames (`output.precision`).
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain export out/pile --to lammps\n  graintrain export out/pile --to yade --frame last --out pile.txt\n  graintrain export out/excavator --to usd"
)]
pub struct Arguments {
    /// Folder of the run
    run: PathBuf,
    /// Format: lammps (text dump, .dump), xyz (extended XYZ), yade (text, one frame), vtkhdf (ParaView), or
    /// usd (surfaces, too: Blender, Omniverse, Houdini)
    #[arg(long, value_name = "FORMAT")]
    to: Format,
    /// Frame: all, last, or its number from 0
    #[arg(long, value_name = "FRAME", default_value = "all")]
    frame: String,
    /// File to write; by default frames.dump, frames.xyz, spheres.txt, frames.vtkhdf or frames.usda in the
    /// run's folder
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    Lammps,
    Xyz,
    Yade,
    Vtkhdf,
    Usd,
}

const REMEDY: &str = "give the folder of a run made by `graintrain run`, with frames of the bodies";

/// Writes the file.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let run = RunFolder::open(&arguments.run).map_err(|error| Failure::input_error(error, REMEDY))?;
    let count = run.times().len();
    let chosen: Vec<usize> = match arguments.frame.as_str() {
        "all" if arguments.to != Format::Yade => (0..count).collect(),
        "all" | "last" => (count.saturating_sub(1)..count).collect(),
        word => match word.parse::<usize>() {
            Ok(frame) if frame < count => vec![frame],
            _ => {
                let what =
                    io::Error::other(format!("there is no frame `{word}`: the run has {count}, from 0"));
                return Err(Failure::input_error(what, "give --frame all, last or a number"));
            }
        },
    };
    if chosen.is_empty() {
        let what = io::Error::other(format!("{} holds no frames", arguments.run.display()));
        return Err(Failure::input_error(what, "run the scene with `output.bodies = true`"));
    }
    let (bytes, name) = bytes(&run, &chosen, arguments.to)?;
    let path = arguments.out.clone().unwrap_or_else(|| arguments.run.join(name));
    write_atomically(&path, &bytes).map_err(|error| {
        let remedy = error.remedy();
        Failure::work_error(error, remedy)
    })?;
    say!("{} ({} frames, {:.1} MB)\n", path.display(), chosen.len(), bytes.len() as f64 / 1e6);
    Ok(ExitCode::SUCCESS)
}

/// The file, and its name where the user gives none.
fn bytes(run: &RunFolder, frames: &[usize], format: Format) -> Result<(Vec<u8>, &'static str), Failure> {
    let damaged = |error| Failure::input_error(error, REMEDY);
    let snapshots = || frames.iter().map(|&frame| run.snapshot(frame)).collect::<Result<Vec<_>, _>>();
    let written = |write: fn(&Snapshot, &mut Vec<u8>) -> io::Result<()>| {
        let mut out = Vec::new();
        snapshots()
            .map_err(damaged)?
            .iter()
            .try_for_each(|snapshot| write(snapshot, &mut out))
            .map_err(failed)?;
        Ok(out)
    };
    Ok(match format {
        Format::Lammps => (written(|snapshot, out| snapshot.write_lammps(out))?, "frames.dump"),
        Format::Xyz => (written(|snapshot, out| snapshot.write_xyz(out))?, "frames.xyz"),
        Format::Yade => (written(|snapshot, out| snapshot.write_yade(out))?, "spheres.txt"),
        Format::Vtkhdf => (vtkhdf::bytes(&snapshots().map_err(damaged)?).map_err(failed)?, "frames.vtkhdf"),
        Format::Usd => (usd(run, frames).map_err(damaged)?.into_bytes(), "frames.usda"),
    })
}

fn failed(error: io::Error) -> Failure {
    Failure::work_error(error, "choose another format")
}
