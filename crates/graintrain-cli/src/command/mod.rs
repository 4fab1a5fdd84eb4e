//! The commands, one file each. A new command is a module, a variant and a line in [`Command::execute`].

mod solvers;

use crate::error::Failure;
use std::process::ExitCode;

/// What the user asked for.
#[derive(clap::Subcommand)]
pub enum Command {
    Solvers(solvers::Arguments),
}

impl Command {
    /// Carries the command out.
    pub fn execute(self) -> Result<ExitCode, Failure> {
        match self {
            Self::Solvers(arguments) => solvers::execute(&arguments),
        }
    }
}
