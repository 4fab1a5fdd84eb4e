//! `graintrain completions`: what the Tab key offers.

use crate::error::Failure;
use crate::terminal::answer;
use clap_complete::Shell;
use std::process::ExitCode;

/// Print a script that completes commands and options in a shell
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
    graintrain completions bash > ~/.local/share/bash-completion/completions/graintrain\n  \
    graintrain completions fish > ~/.config/fish/completions/graintrain.fish")]
pub struct Arguments {
    /// The shell
    shell: Shell,
}

pub fn execute(arguments: &Arguments, mut program: clap::Command) -> Result<ExitCode, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut program, "graintrain", &mut script);
    answer(script)?;
    Ok(ExitCode::SUCCESS)
}
