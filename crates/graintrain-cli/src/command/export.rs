//! `graintrain export`: the frames of a run for other programs.

use crate::error::Failure;
use crate::terminal::say;
use graintrain_io::files::write_atomically;
use graintrain_io::output::exchange::Snapshot;
use graintrain_io::output::vtkhdf;
use graintrain_view::view::RunFolder;
use std::io;
use std::path::PathBuf;
use std::process::ExitCode;

/// Write the frames of a run for other programs
///
/// Spheres, and centres of other bodies, with radius, mass, velocities, forces and orientation, to the
/// precision of the frames (`output.precision`).
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain export out/pile --to lammps\n  graintrain export out/pile --to yade --frame last --out pile.txt"
)]
pub struct Arguments {
    /// Folder of the run
    run: PathBuf,
    /// Format: lammps (text dump, .dump), xyz (extended XYZ), yade (text, one frame) or vtkhdf (ParaView)
    #[arg(long, value_name = "FORMAT")]
    to: Format,
    /// Frame: all, last, or its number from 0
    #[arg(long, value_name = "FRAME", default_value = "all")]
    frame: String,
    /// File to write; by default frames.dump, frames.xyz, spheres.txt or frames.vtkhdf in the run's folder
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    Lammps,
    Xyz,
    Yade,
    Vtkhdf,
}

/// Writes the file.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let remedy = "give the folder of a run made by `graintrain run`, with frames of the bodies";
    let run = RunFolder::open(&arguments.run).map_err(|error| Failure::input_error(error, remedy))?;
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
    let snapshots = chosen.iter().map(|&frame| run.snapshot(frame)).collect::<Result<Vec<_>, _>>();
    let snapshots = snapshots.map_err(|error| Failure::input_error(error, remedy))?;
    let (bytes, name) = bytes(&snapshots, arguments.to)
        .map_err(|error| Failure::work_error(error, "choose another format"))?;
    let path = arguments.out.clone().unwrap_or_else(|| arguments.run.join(name));
    write_atomically(&path, &bytes).map_err(|error| {
        let remedy = error.remedy();
        Failure::work_error(error, remedy)
    })?;
    say!("{} ({} frames, {:.1} MB)\n", path.display(), snapshots.len(), bytes.len() as f64 / 1e6);
    Ok(ExitCode::SUCCESS)
}

/// The file, and its name where the user gives none.
fn bytes(snapshots: &[Snapshot], format: Format) -> io::Result<(Vec<u8>, &'static str)> {
    let mut out = Vec::new();
    let name = match format {
        Format::Lammps => {
            snapshots.iter().try_for_each(|snapshot| snapshot.write_lammps(&mut out))?;
            "frames.dump"
        }
        Format::Xyz => {
            snapshots.iter().try_for_each(|snapshot| snapshot.write_xyz(&mut out))?;
            "frames.xyz"
        }
        Format::Yade => {
            snapshots.iter().try_for_each(|snapshot| snapshot.write_yade(&mut out))?;
            "spheres.txt"
        }
        Format::Vtkhdf => {
            out = vtkhdf::bytes(snapshots)?;
            "frames.vtkhdf"
        }
    };
    Ok((out, name))
}
