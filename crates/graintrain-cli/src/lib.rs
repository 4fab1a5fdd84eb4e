//! The graintrain command line as a library, for programs that bring it along; `src/main.rs` is the program
//! itself.
//!
//! Exit codes: 0 done; 1 the work failed (or did not reach its tolerance under `--strict`); 2 bad input; 3
//! the time given by `--max-seconds` was up, 130 or 143 stopped by a signal, either after leaving things in
//! order.

#![warn(clippy::print_stdout, clippy::print_stderr)]
#![warn(clippy::too_many_lines)]

mod closing;
mod command;
mod crew;
mod error;
pub mod evaluation;
mod filming;
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
mod timings;

use clap::{CommandFactory, Parser};
use graintrain_ccp::solver::ranks::Transport;
use std::ffi::OsString;
use std::process::ExitCode;

/// Granular and multibody dynamics with hard contact.
#[derive(Parser)]
#[command(name = "graintrain", version, about, long_about = None, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    command: command::Command,
}

/// What several processes can do together.
#[derive(Parser)]
#[command(
    name = "graintrain-mpi",
    version,
    about = "graintrain run and resume by several processes: mpirun -n 4 graintrain-mpi run SCENE",
    max_term_width = 110
)]
struct RankArguments {
    #[command(subcommand)]
    command: command::RankCommand,
}

/// As [`run`] for one of several processes that were started with the same words: they make the steps of a
/// run together.
pub fn run_on_ranks(words: impl IntoIterator<Item = OsString>, transport: Box<dyn Transport>) -> ExitCode {
    let writes = transport.rank() == 0;
    let command = match RankArguments::try_parse_from(words) {
        Ok(arguments) => arguments.command,
        Err(answer) => {
            if writes {
                // Nobody is left to tell that it could not be printed.
                let _ = answer.print();
            }
            return ExitCode::from(answer.exit_code() as u8);
        }
    };
    match crew::Crew::of_ranks(transport).and_then(|crew| command.execute(&crew)) {
        Ok(code) => code,
        Err(failure) => failure.report(),
    }
}

/// Parses a command line, of which the first word is the name of the program, carries the command out and
/// tells failures on stderr. Where the words are no command, or ask for help, they are answered and the
/// process ends, as clap does it.
pub fn run(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    match Arguments::parse_from(words).command.execute(Arguments::command) {
        Ok(code) => code,
        Err(failure) => failure.report(),
    }
}
