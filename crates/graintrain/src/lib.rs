//! Granular and multibody dynamics with hard contact.
//!
//! | module | holds |
//! |---|---|
//! | [`shape`], [`material`], [`motion`] | what bodies are made of and how they are driven |
//! | [`world`] | the state |
//! | [`contact`] | contacts and their impulses |
//! | [`collide`] | finding contacts |
//! | [`assemble`] | the contact problem of a step |
//! | [`integrate`] | velocities without contact, positions, rotations |
//! | [`impact`], [`overlap`], [`parts`] | restitution, overlap without energy, parts that do not touch |
//! | [`stepper`] | the time step |
//! | [`run`], [`output`], [`checkpoint`] | many steps, what they leave behind, going on later |
//! | [`render`], [`plot`], [`view`] | pictures, charts, replays |
//! | [`reproduce`] | the paper's experiments run again, and a report |
//! | [`verify`] | the program against exact answers |
//! | [`error`] | what can be wrong with a world |
//! | [`scene`] | scene files with units, built-in scenes, packings |
//! | [`problem_file`] | contact problems in files: FCLIB, Siconos, the program's own dumps |

pub mod assemble;
pub mod checkpoint;
pub mod collide;
pub mod contact;
pub mod error;
pub mod impact;
pub mod integrate;
pub mod material;
pub mod math;
pub mod motion;
pub mod output;
pub mod overlap;
pub mod parts;
pub mod plot;
pub mod problem_file;
pub mod render;
pub mod reproduce;
pub mod run;
pub mod scene;
pub mod shape;
pub mod stepper;
pub mod verify;
pub mod view;
pub mod world;

pub use graintrain_ccp as ccp;
