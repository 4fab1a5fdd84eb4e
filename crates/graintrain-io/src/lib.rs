//! The files of graintrain: scenes in, outputs out, runs between them.
//!
//! | module | holds |
//! |---|---|
//! | [`scene`] | scene files with units, built-in scenes, packings |
//! | `random` | the source of random numbers |
//! | [`settings`] | what a run writes |
//! | [`body_numbers`], [`stream`], [`growth`], [`open_boundaries`] | bodies that enter, leave and grow while a run goes |
//! | [`stage`] | stages of a run, what changes from one to the next |
//! | [`measure`], [`mod@column`] | measurements of a run, and what the columns of tables mean |
//! | [`quantity`] | the numbers of a step and of a run, declared once |
//! | [`run`] | steps one after another, watched by observers |
//! | [`checkpoint`] | going on later |
//! | [`output`] | frames, tables, summary |
//! | [`problem_file`] | contact problems in files: FCLIB, Siconos, the program's own dumps |
//! | [`files`], [`mark`], [`process`] | writing so that what was computed stays readable; whether it still is; what the process has used |
//!
//! Each may use those above it (and `files`, `mark` and `process`), never one below: `output` watches a run,
//! writes checkpoints and dumps problems, and nothing here knows `output`.
//!
//! Feature `fclib`: problem files in HDF5, which dumps are as well.

// The C library has other bits on other machines: `graintrain_linalg::real`.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]
#![warn(clippy::too_many_lines)]

#[doc = include_str!("../README.md")]
#[cfg(doctest)]
struct Readme;

pub mod body_numbers;
pub mod checkpoint;
pub mod column;
pub mod files;
pub mod growth;
pub mod mark;
pub mod measure;
pub mod open_boundaries;
pub mod output;
mod packed;
pub mod problem_file;
pub mod process;
pub mod quantity;
mod random;
pub mod run;
pub mod scene;
pub mod settings;
pub mod stage;
pub mod stream;
