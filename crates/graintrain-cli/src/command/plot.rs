//! `graintrain plot`: the standard figures of a run.

use crate::error::Failure;
use crate::terminal::say;
use graintrain_io::files::{OutputError, make_folder, refuse_link, write_atomically};
use graintrain_view::figures::figures;
use std::path::PathBuf;
use std::process::ExitCode;

/// Draw the tables of a run as SVG files
///
/// Energies, contacts, residual, iterations, overlap and seconds over time, forces on walls and tools, and
/// every measurement.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  graintrain plot out/shear-box")]
pub struct Arguments {
    /// Folder of the run
    run: PathBuf,
    /// Folder of the figures; by default `plots` in the run's folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Writes the figures.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let remedy = "give the folder of a run made by `graintrain run`";
    let figures = figures(&arguments.run).map_err(|error| Failure::input_error(error, remedy))?;
    if figures.is_empty() {
        let run = arguments.run.display();
        let what = match arguments.run.exists() {
            true => format!("{run} holds no tables"),
            false => format!("there is no file or folder `{run}`"),
        };
        return Err(Failure::input_error(std::io::Error::other(what), remedy));
    }
    let failed = |error: OutputError| {
        let remedy = error.remedy();
        Failure::work_error(error, remedy)
    };
    let folder = match &arguments.out {
        Some(folder) => folder.clone(),
        None => {
            let own = arguments.run.join("plots");
            refuse_link(&own).map_err(failed)?;
            own
        }
    };
    make_folder(&folder).map_err(failed)?;
    for (name, svg) in figures {
        let path = folder.join(format!("{name}.svg"));
        write_atomically(&path, svg.as_bytes()).map_err(failed)?;
        say!("{}\n", path.display());
    }
    Ok(ExitCode::SUCCESS)
}
