//! The program `graintrain`.

use std::process::ExitCode;

fn main() -> ExitCode {
    graintrain_cli::run(std::env::args_os())
}
