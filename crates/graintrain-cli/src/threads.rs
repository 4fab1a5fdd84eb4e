//! `--threads`: a pool of our own, so that the library never touches the global one.

use crate::error::Failure;

/// More than this many threads per processor is a slip of the keyboard...
const PER_PROCESSOR: usize = 4;
/// ... unless there are no more than these.
const ALWAYS_ALLOWED: usize = 256;

/// Runs `work` with this many threads; with all processors where `threads` is `None`.
///
/// # Errors
/// As [`pool`].
pub fn with_threads<T: Send>(
    threads: Option<std::num::NonZeroUsize>,
    work: impl FnOnce() -> T + Send,
) -> Result<T, Failure> {
    Ok(pool(threads)?.install(work))
}

/// This many threads; one per processor where `threads` is `None`.
///
/// # Errors
/// For many more threads than processors, and where the operating system refuses to start the threads.
pub fn pool(threads: Option<std::num::NonZeroUsize>) -> Result<rayon::ThreadPool, Failure> {
    let processors = std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get);
    let most = ALWAYS_ALLOWED.max(PER_PROCESSOR * processors);
    if let Some(asked) = threads.filter(|asked| asked.get() > most) {
        let what =
            format!("--threads {asked}: more than {most} threads help nobody on {processors} processors");
        let remedy = "leave --threads out to use all processors";
        return Err(Failure::input_error(std::io::Error::other(what), remedy));
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.map_or(0, std::num::NonZeroUsize::get))
        .build()
        .map_err(|error| Failure::work_error(error, "ask for fewer --threads"))
}
