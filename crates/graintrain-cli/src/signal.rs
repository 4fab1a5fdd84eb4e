//! Stopping in good order: the first Ctrl-C (or SIGTERM, SIGHUP) asks, or the end of the time that was given;
//! the second signal ends the process at once; SIGUSR1 asks for a checkpoint.

use crate::error::Failure;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

/// Exit code of a run whose time was up: with a checkpoint, to be resumed. None of a shell's own, nor of
/// `timeout`.
const TIME_IS_UP: u8 = 3;

/// The number of the signal that Ctrl-C sends, everywhere.
const SIGINT: usize = 2;

/// Whether the user asked to stop.
#[derive(Clone, Debug)]
pub struct Stop {
    /// Set by the first signal and when the time is up; hand it to whatever can stop early.
    pub requested: Arc<AtomicBool>,
    /// Set by SIGUSR1, where there is such a signal: a checkpoint is wanted.
    pub checkpoint_wanted: Arc<AtomicBool>,
    signal: Arc<AtomicUsize>,
    time_is_up: Arc<AtomicBool>,
}

/// Whether this process was started with the signal ignored, as `nohup` does, so that it has to stay so.
/// Linux tells; elsewhere it is taken for ignored.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_none_or(|mask| mask >> (signal - 1) & 1 == 1)
}

impl Stop {
    /// Listens for SIGINT, SIGTERM, SIGHUP and SIGUSR1 from now on.
    ///
    /// # Errors
    /// Where the operating system refuses to install the handlers.
    pub fn listen() -> Result<Self, Failure> {
        let stop = Self {
            requested: Arc::default(),
            checkpoint_wanted: Arc::default(),
            signal: Arc::default(),
            time_is_up: Arc::default(),
        };
        #[cfg(not(target_family = "wasm"))]
        stop.install().map_err(|error| Failure::work_error(error, "signals cannot be handled here"))?;
        Ok(stop)
    }

    /// The handlers; programs of WebAssembly get no signals.
    #[cfg(not(target_family = "wasm"))]
    fn install(&self) -> std::io::Result<()> {
        use signal_hook::{consts, flag};
        // Set by signals alone: after `--max-seconds` the first signal still asks.
        let asked: Arc<AtomicBool> = Arc::default();
        let install = |signal: i32| {
            // Handlers run in the order of registration: the first one ends the process only when the flag
            // was set by an earlier signal.
            flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&asked))?;
            flag::register_usize(signal, Arc::clone(&self.signal), signal as usize)?;
            flag::register(signal, Arc::clone(&self.requested))?;
            flag::register(signal, Arc::clone(&asked))
        };
        for signal in [consts::SIGINT, consts::SIGTERM] {
            install(signal)?;
        }
        #[cfg(unix)]
        {
            if !is_ignored(consts::SIGHUP) {
                install(consts::SIGHUP)?;
            }
            flag::register(consts::SIGUSR1, Arc::clone(&self.checkpoint_wanted))?;
        }
        Ok(())
    }

    /// Asks to stop after so many seconds from now on, wherever the work is then. The thread ends with the
    /// process.
    ///
    /// # Errors
    /// Where the system starts no thread.
    pub fn after(&self, seconds: f64) -> Result<(), Failure> {
        let duration = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX);
        let (requested, time_is_up) = (Arc::clone(&self.requested), Arc::clone(&self.time_is_up));
        let wait = move || {
            std::thread::sleep(duration);
            time_is_up.store(true, Ordering::Relaxed);
            requested.store(true, Ordering::Relaxed);
        };
        let started = std::thread::Builder::new().spawn(wait);
        started
            .map(drop)
            .map_err(|error| Failure::work_error(error, "leave out --max-seconds: it needs a thread"))
    }

    /// Something that asks to stop as Ctrl-C does, from another thread.
    pub fn asker(&self) -> impl Fn() + Send + Sync + 'static {
        let (requested, signal) = (Arc::clone(&self.requested), Arc::clone(&self.signal));
        move || {
            signal.store(SIGINT, Ordering::Relaxed);
            requested.store(true, Ordering::Relaxed);
        }
    }

    /// Exit code of a process that was stopped: 130, 143 or 129 by a signal, 3 when its time was up, 0 where
    /// nobody asked.
    pub fn code(&self) -> u8 {
        match self.signal.load(Ordering::Relaxed) {
            0 if self.time_is_up.load(Ordering::Relaxed) => TIME_IS_UP,
            0 => 0,
            signal => 128 + signal as u8,
        }
    }

    /// The same; `None` where nobody asked.
    pub fn exit_code(&self) -> Option<ExitCode> {
        Some(self.code()).filter(|code| *code != 0).map(ExitCode::from)
    }
}
