//! `--threads`: a pool of our own, so that the library never touches the global one.

use crate::error::Failure;

/// Runs `work` with this many threads; with all processors where `threads` is `None`.
///
/// # Errors
/// Where the operating system refuses to start the threads.
pub fn with_threads<T: Send>(
    threads: Option<std::num::NonZeroUsize>,
    work: impl FnOnce() -> T + Send,
) -> Result<T, Failure> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.map_or(0, std::num::NonZeroUsize::get))
        .build()
        .map_err(|error| Failure::work_error(error, "ask for fewer --threads"))?;
    Ok(pool.install(work))
}
