//! The table: one line per system and method.

use super::drop::Phase;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Iterations of a linear solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Count {
    /// It reached its tolerance.
    Reached(usize),
    /// It did not.
    Unconverged,
}

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reached(count) => write!(f, "{count}"),
            Self::Unconverged => f.write_str("no"),
        }
    }
}

/// Which solve a row belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// The paper's size.
    pub n: usize,
    /// Contact envelope, radii.
    pub envelope: f64,
    /// kg/m^3.
    pub density: f64,
    /// Name of the phase of the drop.
    pub phase: String,
    /// Name of the interior point.
    pub start: String,
}

/// Which matrix and method of a solve.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Key {
    /// Newton iteration, from 0.
    pub iteration: usize,
    /// Reading of the recipe.
    pub reading: String,
    /// How the matrix is compressed, or the name of a classic preconditioner.
    pub method: String,
    /// Accuracy asked for (0: none).
    pub accuracy: f64,
    /// Cap on the ranks (0: none).
    pub cap: usize,
}

/// What was measured; absent where it was not.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Mean rank of the matrix.
    pub rank: Option<f64>,
    /// Its largest rank.
    pub largest_rank: Option<usize>,
    /// ||S^ - T|| / ||S^|| with the dummies.
    pub augmented: Option<f64>,
    /// ||S^ - T|| / ||S||.
    pub unscaled: Option<f64>,
    /// ||L^-1 (S - T) L^-T|| / ||L^-1 S L^-T||.
    pub scaled: Option<f64>,
    /// Kind of the inverse.
    pub inverse: Option<String>,
    /// Its mean rank.
    pub inverse_rank: Option<f64>,
    /// Its largest rank.
    pub inverse_largest: Option<usize>,
    /// Its error: see [`super::inverse::Approximate`].
    pub inverse_error: Option<f64>,
    /// Whether it is positive definite.
    pub definite: Option<bool>,
    /// BiCGSTAB's iterations with it.
    pub bicgstab: Option<Count>,
    /// Steps of refinement with it.
    pub refinement: Option<Count>,
    /// Wall-clock seconds of compression and inversion.
    pub seconds: Option<f64>,
}

/// How a solve went.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Solved {
    /// Contacts.
    pub contacts: usize,
    /// Newton systems of the whole solve.
    pub systems: usize,
    /// How it ended.
    pub status: String,
}

/// One line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Solve.
    pub case: Case,
    /// How that went.
    pub solved: Solved,
    /// Matrix and method.
    pub key: Key,
    /// Result.
    pub figures: Figures,
}

/// Names of the columns.
pub const COLUMNS: &str = "n,envelope,density,phase,start,contacts,systems,status,iteration,reading,method,accuracy,cap,rank,\
largest_rank,error_augmented,error_unscaled,error_scaled,inverse,inverse_rank,inverse_largest_rank,inverse_error,definite,\
bicgstab,refinement,seconds";

/// Three significant digits, or nothing.
pub fn short(value: Option<f64>) -> String {
    value.map_or(String::new(), |x| {
        if (1e-3..1e4).contains(&x.abs()) || x == 0.0 {
            let digits = if x == 0.0 { 0 } else { (2 - x.abs().log10().floor() as i32).max(0) as usize };
            format!("{x:.digits$}")
        } else {
            format!("{x:.2e}")
        }
    })
}

fn text<T: fmt::Display>(value: &Option<T>) -> String {
    value.as_ref().map_or(String::new(), T::to_string)
}

impl Row {
    /// The order of the table: by case, iteration, reading, method, from coarse accuracies and small caps to
    /// fine and large ones.
    pub fn order(&self, other: &Self) -> std::cmp::Ordering {
        let place = |phase: &str| Phase::ALL.iter().position(|known| known.name() == phase);
        let (a, b) = (&self.case, &other.case);
        let of_case =
            a.n.cmp(&b.n)
                .then(a.envelope.total_cmp(&b.envelope))
                .then(a.density.total_cmp(&b.density))
                .then_with(|| place(&a.phase).cmp(&place(&b.phase)))
                // The paper's comes first.
                .then_with(|| b.start.cmp(&a.start));
        let (a, b) = (&self.key, &other.key);
        of_case
            .then(a.iteration.cmp(&b.iteration))
            .then_with(|| a.reading.cmp(&b.reading))
            .then(b.accuracy.total_cmp(&a.accuracy))
            .then(a.cap.cmp(&b.cap))
            .then_with(|| a.method.cmp(&b.method))
    }

    /// As a line of the file.
    pub fn line(&self) -> String {
        let Self { case, solved, key, figures } = self;
        let Solved { contacts, systems, status } = solved;
        let definite = figures.definite.map_or("", |yes| if yes { "yes" } else { "no" });
        format!(
            "{},{},{},{},{},{contacts},{systems},{status},{},{},{},{:e},{},{},{},{},{},{},{},{},{},{},{definite},{},{},{}",
            case.n,
            case.envelope,
            case.density,
            case.phase,
            case.start,
            key.iteration,
            key.reading,
            key.method,
            key.accuracy,
            key.cap,
            short(figures.rank),
            text(&figures.largest_rank),
            short(figures.augmented),
            short(figures.unscaled),
            short(figures.scaled),
            text(&figures.inverse),
            short(figures.inverse_rank),
            text(&figures.inverse_largest),
            short(figures.inverse_error),
            text(&figures.bicgstab),
            text(&figures.refinement),
            short(figures.seconds),
        )
    }
}
