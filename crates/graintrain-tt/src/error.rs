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
        source: DenseError,
    },
    /// The caller's [`Patience`](graintrain_linalg::patience::Patience) ended before the work did.
    #[error("stopped: the time given is over, or a stop was requested")]
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

/// Puts the core number on a dense failure.
pub(crate) fn at_core(core: usize) -> impl Fn(DenseError) -> TtError {
    move |source| TtError::Dense { core, source }
}
