//! `graintrain schema`: the JSON Schema of scene files.

use crate::error::Failure;
use crate::terminal::answer;
use graintrain_io::scene::json_schema;
use std::process::ExitCode;

/// Print the JSON Schema of scene files, with which editors complete and check them
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  graintrain schema > graintrain.schema.json\n\nA scene whose first line is\n  #:schema ./graintrain.schema.json\nis then completed and checked by taplo and by VS Code with Even Better TOML."
)]
pub struct Arguments {}

pub fn execute(_: &Arguments) -> Result<ExitCode, Failure> {
    answer(format!("{:#}\n", json_schema()))?;
    Ok(ExitCode::SUCCESS)
}
