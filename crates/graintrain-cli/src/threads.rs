//! `--threads`: a pool of our own, so that the library never touches the global one.

use crate::error::Failure;

/// More than this many threads per processor is a slip of the keyboard...
const PER_PROCESSOR: usize = 4;
/// ... unless there are no more than these.
const ALWAYS_ALLOWED: usize = 256;

/// The threads of one piece of work. A program of WebAssembly starts none: its own does everything.
pub struct Pool(#[cfg(not(target_family = "wasm"))] rayon::ThreadPool);

impl Pool {
    /// Does the work on these threads.
    pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        #[cfg(not(target_family = "wasm"))]
        return self.0.install(work);
        #[cfg(target_family = "wasm")]
        work()
    }

    /// How many they are.
    pub fn count(&self) -> usize {
        self.install(rayon::current_num_threads)
    }
}

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
pub fn pool(threads: Option<std::num::NonZeroUsize>) -> Result<Pool, Failure> {
    let processors = std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get);
    let most = ALWAYS_ALLOWED.max(PER_PROCESSOR * processors);
    if let Some(asked) = threads.filter(|asked| asked.get() > most) {
        let what =
            format!("--threads {asked}: more than {most} threads help nobody on {processors} processors");
        let remedy = "leave --threads out to use all processors";
        return Err(Failure::input_error(std::io::Error::other(what), remedy));
    }
    #[cfg(not(target_family = "wasm"))]
    return rayon::ThreadPoolBuilder::new()
        .num_threads(threads.map_or(0, std::num::NonZeroUsize::get))
        .build()
        .map(Pool)
        .map_err(|error| Failure::work_error(error, "ask for fewer --threads"));
    #[cfg(target_family = "wasm")]
    Ok(Pool())
}
