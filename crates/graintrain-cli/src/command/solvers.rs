//! `graintrain solvers`: the solvers by name.

use crate::error::Failure;
use crate::terminal::answer;
use graintrain_ccp::solver::METHODS;
use std::process::ExitCode;

/// List the contact solvers by name
#[derive(clap::Args)]
#[command(after_help = "Example:\n  graintrain solvers")]
pub struct Arguments {}

pub fn execute(_: &Arguments) -> Result<ExitCode, Failure> {
    let width = METHODS.iter().map(|method| method.name.len()).max().unwrap_or(0);
    let lines = METHODS.iter().map(|method| format!("{:width$}  {}\n", method.name, method.about));
    answer(lines.collect::<String>())?;
    Ok(ExitCode::SUCCESS)
}
