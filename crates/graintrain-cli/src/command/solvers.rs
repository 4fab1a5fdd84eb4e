//! `graintrain solvers`: the solvers by name.

use crate::error::Failure;
use crate::terminal::answer;
use graintrain_ccp::registry::Method;
use std::process::ExitCode;

/// List the contact solvers by name
#[derive(clap::Args)]
#[command(after_help = "Example:\n  graintrain solvers")]
pub struct Arguments {}

pub fn execute(_: &Arguments) -> Result<ExitCode, Failure> {
    let listed = || Method::available().filter(|method| method.is_listed());
    let width = listed().map(|method| method.name().len()).max().unwrap_or(0);
    let lines = listed().map(|method| format!("{method:width$}  {}\n", method.about()));
    answer(lines.collect::<String>())?;
    Ok(ExitCode::SUCCESS)
}
