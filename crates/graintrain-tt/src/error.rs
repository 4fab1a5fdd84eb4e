//! Errors of the crate.

use graintrain_linalg::dense::DenseError;

/// What can be wrong with a request. A solver that does not converge is not an error: see its report.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TtError {
    /// Two trains, or a train and a vector, do not have the sizes the operation needs.
    #[error("{what}: expected {expected:?}, got {got:?}")]
    Shape {
        /// Which sizes are compared.
        what: &'static str,
        /// Sizes needed.
        expected: Vec<usize>,
        /// Sizes given.
        got: Vec<usize>,
    },
    /// An index lies outside its mode.
    #[error("index {index} of mode {mode} is outside 0..{size}")]
    Index {
        /// Zero-based mode.
        mode: usize,
        /// The index.
        index: usize,
        /// The size of the mode.
        size: usize,
    },
    /// A setting has no meaning.
    #[error("{what} must be {need}, got {got}")]
    Setting {
        /// Name of the setting.
        what: &'static str,
        /// What is allowed.
        need: &'static str,
        /// What was given.
        got: f64,
    },
    /// A source of entries gave a number that is not finite.
    #[error(
        "entry {index:?} is {value}: a train holds finite numbers only; bound the function there or move the grid off its pole"
    )]
    Entry {
        /// Zero-based index of the entry.
        index: Vec<usize>,
        /// What the source gave.
        value: f64,
    },
    /// An axis of a grid has no meaning, or there is none of that name.
    #[error("axis {name:?}: {what}")]
    Axis {
        /// The name.
        name: String,
        /// What is wrong and what was expected.
        what: String,
    },
    /// A full tensor would not fit in memory or in an index.
    #[error("a full tensor with {entries:.3e} entries does not fit; keep it as a train")]
    TooLarge {
        /// Number of entries asked for.
        entries: f64,
    },
    /// A dense factorization failed.
    #[error("core {core}: {source}")]
    Dense {
        /// Zero-based core where it happened.
        core: usize,
        /// What happened.
        source: DenseFailure,
    },
    /// The caller's [`Stop`](crate::Stop) said so before the work was done.
    #[error("stopped before the work was done, as the caller asked")]
    Stopped,
    /// A saved train cannot be read.
    #[error("{file}: byte {offset}: {what}")]
    Format {
        /// The file, or "stream".
        file: String,
        /// Position of the fault.
        offset: u64,
        /// What is wrong and what was expected.
        what: String,
    },
    /// Reading or writing failed.
    #[error("{file}: {source}")]
    File {
        /// The file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
}

/// Why a dense factorization of one core failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DenseFailure {
    /// An entry is infinite or not a number.
    #[error("an entry is infinite or not a number")]
    NotFinite,
    /// A pivot of a Cholesky factorization is not positive.
    #[error("not positive definite: pivot {index} is not positive")]
    NotPositiveDefinite {
        /// Zero-based index of the pivot.
        index: usize,
    },
    /// A pivot of an LU factorization is zero or not finite.
    #[error("singular: pivot {index} is zero or not finite")]
    Singular {
        /// Zero-based index of the pivot.
        index: usize,
    },
}

impl DenseFailure {
    /// Not a `From`, which would be public.
    pub(crate) fn of(error: DenseError) -> Self {
        match error {
            DenseError::NotPositiveDefinite { index } => Self::NotPositiveDefinite { index },
            DenseError::Singular { index } => Self::Singular { index },
            _ => Self::NotFinite,
        }
    }
}

/// Puts the core number on a dense failure.
pub(crate) fn at_core(core: usize) -> impl Fn(DenseError) -> TtError {
    move |source| TtError::Dense { core, source: DenseFailure::of(source) }
}
