//! `graintrain verify`: the program against exact answers.

use crate::error::Failure;
use crate::signal::Stop;
use crate::terminal::{say, tell};
use graintrain_io::files::{make_folder, write_atomically};
use graintrain_lab::verify::{Outcome, VerifyError, earth_pressure, granular, table, tier_a};
use std::path::PathBuf;
use std::process::ExitCode;

/// Hold this program against exact answers and print measured and expected numbers
///
/// Tier a: flight, impacts, sliding, rolling, rest against closed forms (seconds). Tier b: passive earth
/// pressure against Rankine, and sheared and drafted samples, whose forces must not depend on time step and tolerance (tens of
/// minutes). Exit code 1 if a check fails.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  graintrain verify\n  graintrain verify --tier b --out verification")]
pub struct Arguments {
    /// Which checks
    #[arg(long, value_parser = ["a", "b"], default_value = "a")]
    tier: String,
    /// Size parameter of the samples of tier b
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(2..=32))]
    n: u32,
    /// Folder for the report (verification.md)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Makes the checks, prints and writes the table.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let stop = Stop::listen()?;
    let told = |name: &str| tell!("{name} ...");
    let failed = |error: VerifyError| Failure::work_error(error, "");
    let output = |error: graintrain_io::files::OutputError| {
        let remedy = error.remedy();
        Failure::work_error(error, remedy)
    };
    let checks = if arguments.tier == "a" {
        tier_a(told).map_err(failed)?
    } else {
        let scratch = arguments.out.clone().unwrap_or_else(|| PathBuf::from("out/verify")).join("states");
        make_folder(&scratch).map_err(output)?;
        let mut checks = earth_pressure::checks(&stop.requested, told).map_err(failed)?;
        checks
            .extend(granular::checks(arguments.n as usize, &scratch, &stop.requested, told).map_err(failed)?);
        checks
    };
    let text = table(&checks);
    say!("{text}");
    if let Some(folder) = &arguments.out {
        make_folder(folder).map_err(output)?;
        write_atomically(&folder.join("verification.md"), text.as_bytes()).map_err(output)?;
    }
    let failed = checks.iter().any(|check| check.outcome() == Outcome::Failed);
    Ok(if failed { ExitCode::from(1) } else { ExitCode::SUCCESS })
}
