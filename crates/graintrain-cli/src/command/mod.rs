//! The commands, one file each. A new command is a module, a variant and a line in [`Command::execute`].

mod calibrate;
mod check;
mod compare;
mod completions;
mod dt_study;
mod export;
mod fit;
mod man;
mod plot;
mod render;
mod reproduce;
mod resume;
mod run;
mod scenes;
mod schema;
mod solve;
mod solvers;
mod sweep;
mod tolerance_study;
mod verify;
mod view;

use crate::crew::Crew;
use crate::error::Failure;
use std::process::ExitCode;

/// What the user asked for.
#[derive(clap::Subcommand)]
pub enum Command {
    Run(run::Arguments),
    Resume(resume::Arguments),
    Check(check::Arguments),
    Scenes(scenes::Arguments),
    Schema(schema::Arguments),
    View(view::Arguments),
    Export(export::Arguments),
    Fit(fit::Arguments),
    Plot(plot::Arguments),
    Render(render::Arguments),
    Sweep(sweep::Arguments),
    Calibrate(calibrate::Arguments),
    DtStudy(dt_study::Arguments),
    ToleranceStudy(tolerance_study::Arguments),
    Reproduce(reproduce::Arguments),
    Verify(verify::Arguments),
    Solve(solve::Arguments),
    Compare(compare::Arguments),
    Solvers(solvers::Arguments),
    Completions(completions::Arguments),
    Man(man::Arguments),
}

/// What several processes can do together.
#[derive(clap::Subcommand)]
pub enum RankCommand {
    Run(run::Arguments),
    Resume(resume::Arguments),
}

impl RankCommand {
    /// Carries the command out.
    pub fn execute(self, crew: &Crew) -> Result<ExitCode, Failure> {
        match self {
            Self::Run(arguments) => run::execute(&arguments, crew),
            Self::Resume(arguments) => resume::execute(&arguments, crew),
        }
    }
}

impl Command {
    /// Carries the command out; `program` is the whole command line, for those that describe it.
    pub fn execute(self, program: fn() -> clap::Command) -> Result<ExitCode, Failure> {
        match self {
            Self::Run(arguments) => run::execute(&arguments, &Crew::alone()?),
            Self::Resume(arguments) => resume::execute(&arguments, &Crew::alone()?),
            Self::Check(arguments) => check::execute(&arguments),
            Self::Scenes(arguments) => scenes::execute(&arguments),
            Self::Schema(arguments) => schema::execute(&arguments),
            Self::View(arguments) => view::execute(&arguments),
            Self::Export(arguments) => export::execute(&arguments),
            Self::Fit(arguments) => fit::execute(&arguments),
            Self::Plot(arguments) => plot::execute(&arguments),
            Self::Render(arguments) => render::execute(&arguments),
            Self::Sweep(arguments) => sweep::execute(&arguments),
            Self::Calibrate(arguments) => calibrate::execute(&arguments),
            Self::DtStudy(arguments) => dt_study::execute(&arguments),
            Self::ToleranceStudy(arguments) => tolerance_study::execute(&arguments),
            Self::Reproduce(arguments) => reproduce::execute(&arguments),
            Self::Verify(arguments) => verify::execute(&arguments),
            Self::Solve(arguments) => solve::execute(&arguments),
            Self::Compare(arguments) => compare::execute(&arguments),
            Self::Solvers(arguments) => solvers::execute(&arguments),
            Self::Completions(arguments) => completions::execute(&arguments, program()),
            Self::Man(arguments) => man::execute(&arguments, program()),
        }
    }
}
