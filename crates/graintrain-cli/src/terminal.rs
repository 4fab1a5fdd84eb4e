//! Everything that the program prints. A reader that goes away (`| head`, a terminal that was closed) ends no
//! run and makes no panic, which `println!` would: what is said in passing is dropped, and what was asked for
//! fails only where it could have been kept (a full disk).

use crate::error::Failure;
use std::fmt::Arguments;
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether this process says nothing, because another one speaks for it.
static SILENT: AtomicBool = AtomicBool::new(false);

/// Lets this process say nothing from now on, or speak again.
pub fn keep_silent(silent: bool) {
    SILENT.store(silent, Ordering::Relaxed);
}

/// As `print!`, to whoever listens.
macro_rules! say {
    ($($text:tt)*) => {
        $crate::terminal::write_out(format_args!($($text)*))
    };
}

/// As `eprintln!`, to whoever listens.
macro_rules! tell {
    ($($text:tt)*) => {
        $crate::terminal::write_line_to_err(format_args!($($text)*))
    };
}

pub(crate) use {say, tell};

/// Prints on stdout; what cannot be written is dropped.
pub fn write_out(text: Arguments<'_>) {
    if SILENT.load(Ordering::Relaxed) {
        return;
    }
    let mut out = io::stdout().lock();
    let _ = out.write_fmt(text).and_then(|()| out.flush());
}

/// Prints a line on stderr; what cannot be written is dropped.
pub fn write_line_to_err(text: Arguments<'_>) {
    if SILENT.load(Ordering::Relaxed) {
        return;
    }
    // In one piece, so that lines of several threads do not mix.
    let _ = io::stderr().lock().write_all(format!("{text}\n").as_bytes());
}

/// Prints on stdout what a command was called for.
///
/// # Errors
/// Where it cannot be written, but for a reader that has heard enough.
pub fn answer(text: impl AsRef<[u8]>) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_ref()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            let error = io::Error::other(format!("cannot write to stdout: {error}"));
            Err(Failure::work_error(error, ""))
        }
        _ => Ok(()),
    }
}
