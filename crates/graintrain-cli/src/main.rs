//! The graintrain command line.
//!
//! Exit codes: 0 done; 1 the work failed (or missed its tolerance under `--strict`); 2 bad input; 130 or 143 stopped by
//! a signal after leaving things in order.

#![warn(clippy::print_stdout, clippy::print_stderr)]

mod command;
mod error;
mod evaluation;
mod profile;
mod progress;
mod scene_failure;
mod signal;
mod solving;
mod stepping;
mod studying;
mod sweeping;
mod terminal;
mod threads;

use clap::{CommandFactory, Parser};
use std::process::ExitCode;

/// Granular and multibody dynamics with hard contact.
#[derive(Parser)]
#[command(name = "graintrain", version, about, long_about = None, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    command: command::Command,
}

fn main() -> ExitCode {
    match Arguments::parse().command.execute(Arguments::command) {
        Ok(code) => code,
        Err(failure) => failure.report(),
    }
}
