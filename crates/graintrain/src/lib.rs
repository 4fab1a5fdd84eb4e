//! Granular and multibody dynamics with hard contact.
//!
//! | module | holds |
//! |---|---|
//! | [`math`] | vectors, rotations |
//! | [`handle`] | typed indices of geometries, materials, motions, bodies |
//! | [`shape`], [`material`], [`motion`] | what bodies are made of and how they are driven |
//! | [`formula`], [`load`] | functions of time, what acts on bodies besides contact |
//! | [`joint`] | joints, motors, springs and stops between bodies |
//! | [`world`] | the state |
//! | [`contact`] | contacts and their impulses |
//! | [`cell`] | periodic cells, their deformation and stress |
//! | [`collide`] | finding contacts |
//! | [`assemble`] | the contact problem of a step |
//! | [`integrate`] | velocities without contact, positions, rotations |
//! | [`turning`] | rolling and spinning friction |
//! | [`impact`], [`overlap`], [`parts`] | restitution, overlap without energy, parts that do not touch |
//! | [`stepper`], [`step_report`] | the time step, what it reports |
//! | [`gradient`] | derivatives of a step |
//! | [`measure`] | stress, coordination, profiles, flow, energies and other measurements |
//! | [`error`] | what can be wrong with a world |
//! | [`ccp`] | contact problems and their solvers |
//!
//! Scenes, outputs and runs are in `graintrain-io`, pictures in `graintrain-view`.

// The C library has other bits on other machines: `graintrain_linalg::real`.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]
#![warn(clippy::too_many_lines)]

#[doc = include_str!("../README.md")]
#[cfg(doctest)]
struct Readme;

pub mod assemble;
pub mod cell;
mod cell_limits;
mod cell_problem;
mod clock;
pub mod collide;
pub mod contact;
pub mod elasticity;
pub mod error;
pub mod formula;
mod frame_turn;
pub mod gradient;
pub mod handle;
pub mod hull;
pub mod impact;
pub mod integrate;
pub mod joint;
pub mod load;
pub mod material;
pub mod math;
pub mod measure;
mod moments;
pub mod motion;
pub mod overlap;
mod part_solver;
pub mod parts;
mod projection;
mod rotation;
pub mod shape;
mod solid_mesh;
pub mod step_report;
pub mod stepper;
pub mod turning;
mod validate;
pub mod world;

pub use graintrain_ccp as ccp;
