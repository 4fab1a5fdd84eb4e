//! The program as a user and a script meet it.

mod book;
mod calibrations;
mod oracle;
mod runs;
mod solve_compare;
mod sweeps;
mod verify;
