//! `graintrain fit`: constants of a model from the points of a sweep.

use crate::error::Failure;
use crate::sweeping::{sweep_failure, unreadable_input};
use crate::terminal::say;
use graintrain_io::files::write_atomically;
use graintrain_io::scene;
use graintrain_lab::sweep::fit::{chart, fit, points, with_error};
use std::path::PathBuf;
use std::process::ExitCode;

/// Fit the constants of a model to two columns of a table
///
/// Least squares through the points of sweep.csv (or any table with a header), weighed by their standard
/// errors where they have some. Prints the constants with their errors and draws points and model as a
/// figure.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain fit out/sweep-silo/sweep.csv --x silo.mass:last --y bottom.force_z:last \\\n    \
    --model 'most * (1 - exp(-9.81 * x / most))' --start most=10\n  \
    graintrain fit out/sweep-shear-box/sweep.csv --x shear.plane_sigma --y shear.plane_tau --model 'c + tan_phi * x' --start c=0,tan_phi=0.4"
)]
pub struct Arguments {
    /// The table
    table: PathBuf,
    /// Column of the abscissa, `x` in the model
    #[arg(long, value_name = "COLUMN")]
    x: String,
    /// Column of the ordinate; its errors are in the column of this name with `_error`
    #[arg(long, value_name = "COLUMN")]
    y: String,
    /// An expression of x and the constants, as in scenes
    #[arg(long, value_name = "EXPRESSION", allow_hyphen_values = true)]
    model: String,
    /// The constants, each with a value to start from
    #[arg(long, value_name = "NAME=VALUE,...", value_delimiter = ',', required = true)]
    start: Vec<String>,
    /// File of the figure; by default fit.svg beside the table
    #[arg(long, value_name = "FILE.svg")]
    out: Option<PathBuf>,
}

/// Fits, prints and draws.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let start = arguments.start.iter().map(|text| {
        let named =
            text.split_once('=').map(|(name, value)| (name.trim().to_string(), scene::value(value, &[])));
        match named {
            Some((name, Ok(value))) if name != "x" && !name.is_empty() => Ok((name, value)),
            _ => {
                let what = std::io::Error::other(format!("`{text}` is not of the form NAME=VALUE"));
                Err(Failure::input_error(what, "for example --start a=1,b=0.5"))
            }
        }
    });
    let start = start.collect::<Result<Vec<_>, Failure>>()?;
    let points = points(&arguments.table, &arguments.x, &arguments.y).map_err(unreadable_input)?;
    let found = fit(&arguments.model, &start, &points).map_err(sweep_failure)?;
    say!("{} points, {}\n", points.len(), arguments.model);
    for constant in &found.constants {
        say!("  {:<16} {}\n", constant.name, with_error(constant));
    }
    say!("  residual (rms)   {:.3e}\n", found.residual);
    if found.chi_square.is_finite() {
        say!("  chi^2 per degree {:.2}\n", found.chi_square);
    }
    let path = arguments.out.clone().unwrap_or_else(|| arguments.table.with_file_name("fit.svg"));
    let svg =
        chart(&arguments.model, &found, &points, [&arguments.x, &arguments.y]).map_err(sweep_failure)?;
    write_atomically(&path, svg.as_bytes()).map_err(|error| {
        let remedy = error.remedy();
        Failure::work_error(error, remedy)
    })?;
    say!("  {}\n", path.display());
    Ok(ExitCode::SUCCESS)
}
