//! `graintrain verify`: the program against exact answers.

use crate::error::Failure;
use crate::signal::Stop;
use crate::terminal::{say, tell};
use graintrain::ccp::FrictionModel;
use graintrain_io::files::{OutputError, make_folder, write_atomically};
use graintrain_lab::verify::report::{Head, csv, html, markdown, table};
use graintrain_lab::verify::{Case, Definition, Sampling, held, measure, tier_a, tier_b};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Hold this program against exact answers and print measured and expected numbers
///
/// Tier a: flight, impacts, sliding, rolling, rest, shapes and small assemblies against closed forms (two
/// minutes). Tier b: granular samples against published figures, and what must not depend on time step and
/// tolerance (two hours; small samples first). Rows are made with the solver and tolerance of scenes, in both
/// friction models. Exit code 1 if a case fails.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain verify --out verification\n  graintrain verify --only A7,A25\n  graintrain verify --tier b --out verification"
)]
pub struct Arguments {
    /// Which cases
    #[arg(long, value_parser = ["a", "b"], default_value = "a")]
    tier: String,
    /// Only the cases of these numbers, e.g. A3,A7
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',')]
    only: Vec<String>,
    /// Size parameter of the sheared and drafted samples of tier b
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(2..=32))]
    n: u32,
    /// Friction models of the samples of tier b that have friction (tier a has rows of both where both
    /// differ)
    #[arg(long, value_parser = ["relaxed", "coulomb", "both"], default_value = "both")]
    friction: String,
    /// Folder for the report (verify.html, verify.md, verify.csv), written anew after every case
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

fn output(error: OutputError) -> Failure {
    let remedy = error.remedy();
    Failure::work_error(error, remedy)
}

/// No case has one of the numbers asked for.
#[derive(Debug, thiserror::Error)]
#[error("tier {tier} has no case {number}")]
struct NoCase {
    tier: String,
    number: String,
}

/// Makes the checks, prints and writes the table.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let all: Vec<&'static Definition> =
        if arguments.tier == "a" { tier_a().collect() } else { tier_b().collect() };
    for number in &arguments.only {
        if !all.iter().any(|case| case.id.eq_ignore_ascii_case(number)) {
            let ids: Vec<&str> = all.iter().map(|case| case.id).collect();
            let error = NoCase { tier: arguments.tier.clone(), number: number.clone() };
            return Err(Failure::input_error(error, format!("There are {}", ids.join(", "))));
        }
    }
    let wanted = |case: &&Definition| {
        arguments.only.is_empty() || arguments.only.iter().any(|number| case.id.eq_ignore_ascii_case(number))
    };
    let chosen: Vec<&'static Definition> = all.into_iter().filter(|case| wanted(case)).collect();
    let stop = Stop::listen()?;
    let scratch = arguments.out.clone().unwrap_or_else(|| PathBuf::from("out/verify")).join("states");
    if arguments.tier == "b" {
        make_folder(&scratch).map_err(output)?;
    }
    if let Some(folder) = &arguments.out {
        make_folder(folder).map_err(output)?;
    }
    let head = Head::now(command_line(), chosen.len());
    let write = |cases: &[Case]| -> Result<(), OutputError> {
        let Some(folder) = &arguments.out else { return Ok(()) };
        write_atomically(&folder.join("verify.md"), markdown(&head, cases).as_bytes())?;
        write_atomically(&folder.join("verify.csv"), csv(cases).as_bytes())?;
        write_atomically(&folder.join("verify.html"), html(&head, cases).as_bytes())
    };
    let mut reported = |name: &str| tell!("{name} ...");
    let named = |(name, _): &&(&str, _)| arguments.friction == "both" || arguments.friction == *name;
    let models = FrictionModel::NAMES.iter().filter(named).map(|(_, model)| *model).collect();
    let mut sampling = Sampling {
        n: arguments.n as usize,
        models,
        scratch,
        stop: stop.requested.clone(),
        progress: &mut reported,
    };
    let mut written = Ok(());
    let cases = measure(chosen.iter().copied(), &mut sampling, |cases| {
        if written.is_ok() {
            written = write(cases);
        }
    });
    written.map_err(output)?;
    say!("{}", table(&cases));
    if let Some(folder) = &arguments.out {
        tell!("{}", folder.join("verify.html").display());
    }
    Ok(if held(&cases, chosen.len()) { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// The command as it was given, without the folder of the program.
fn command_line() -> String {
    let mut words = std::env::args();
    let program = words.next().unwrap_or_default();
    let name = Path::new(&program).file_name().map_or(program.clone(), |name| name.to_string_lossy().into());
    let quoted = |word: String| if word.contains([' ', '"']) { format!("{word:?}") } else { word };
    std::iter::once(name).chain(words.map(quoted)).collect::<Vec<_>>().join(" ")
}
