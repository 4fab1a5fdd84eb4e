//! `graintrain man`: manual pages.

use crate::error::Failure;
use crate::terminal::answer;
use graintrain_io::files::make_folder;
use std::path::PathBuf;
use std::process::ExitCode;

/// Print the manual page, or write those of all commands into a folder
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  graintrain man | man -l -\n  graintrain man ~/.local/share/man/man1")]
pub struct Arguments {
    /// Folder for a page per command
    folder: Option<PathBuf>,
}

pub fn execute(arguments: &Arguments, program: clap::Command) -> Result<ExitCode, Failure> {
    let failed = |error: std::io::Error| Failure::work_error(error, "");
    match &arguments.folder {
        None => {
            let mut page = Vec::new();
            clap_mangen::Man::new(program).render(&mut page).map_err(failed)?;
            answer(page)?;
        }
        Some(folder) => {
            make_folder(folder).map_err(|error| Failure::input_error(error, "choose another folder"))?;
            clap_mangen::generate_to(program, folder).map_err(failed)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}
