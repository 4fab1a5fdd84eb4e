//! The program as a user and a script meet it.

mod book;
mod calibrations;
mod films;
mod hostile_files;
mod interruptions;
mod kills;
mod oracle;
mod runs;
mod schema;
#[cfg(unix)]
mod slide;
mod solve_compare;
mod sweeps;
mod verify;
