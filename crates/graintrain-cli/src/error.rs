//! How commands fail: what is printed and with which exit code.

use crate::terminal::tell;
use std::process::ExitCode;

/// Why a command could not do its work.
#[derive(Debug)]
pub enum Failure {
    /// The input is wrong (a file, an option): exit code 2.
    Input(miette::Report),
    /// The input is fine, but the work failed: exit code 1.
    Work(miette::Report),
    /// Another process has failed and reported why, with this exit code.
    Reported(u8),
}

impl Failure {
    /// Bad input, reported by an ordinary error and what the user can do about it.
    pub fn input_error(
        error: impl std::error::Error + Send + Sync + 'static,
        remedy: impl Into<String>,
    ) -> Self {
        Self::Input(with_remedy(error, remedy))
    }

    /// Failed work, reported by an ordinary error and what the user can do about it.
    pub fn work_error(
        error: impl std::error::Error + Send + Sync + 'static,
        remedy: impl Into<String>,
    ) -> Self {
        Self::Work(with_remedy(error, remedy))
    }

    /// Prints the failure on stderr and gives the exit code.
    pub fn report(&self) -> ExitCode {
        match self {
            Self::Input(report) | Self::Work(report) => tell!("{report:?}"),
            Self::Reported(_) => {}
        }
        ExitCode::from(self.code())
    }

    /// The exit code.
    pub fn code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Work(_) => 1,
            Self::Reported(code) => *code,
        }
    }
}

/// An ordinary error and a remedy, as a diagnostic.
#[derive(Debug)]
struct Remedied {
    error: Box<dyn std::error::Error + Send + Sync>,
    remedy: String,
}

fn with_remedy(
    error: impl std::error::Error + Send + Sync + 'static,
    remedy: impl Into<String>,
) -> miette::Report {
    miette::Report::new(Remedied { error: Box::new(error), remedy: remedy.into() })
}

impl std::fmt::Display for Remedied {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.error.fmt(f)
    }
}

impl std::error::Error for Remedied {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.error.source()
    }
}

impl miette::Diagnostic for Remedied {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        (!self.remedy.is_empty()).then(|| Box::new(&self.remedy) as Box<dyn std::fmt::Display>)
    }
}
