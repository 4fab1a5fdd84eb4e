//! Altered files for everything that graintrain reads. Whatever stands in a file, reading it makes no panic,
//! ends soon and takes no more memory than the file deserves.
//!
//! | module | holds |
//! |---|---|
//! | [`scene`], [`problem`], [`packing`], [`mesh`], [`checkpoint`], [`frame`], [`robot`] | a target each: `run` reads an input and says whether it was accepted, `seeds` are sound inputs |
//! | [`bundle`] | several files in one input |
//! | [`alter`] | inputs from seeds, the same for the same numbers |
//!
//! The program `graintrain-fuzz` alters seeds by itself; `fuzz_targets` are the same targets for
//! `cargo fuzz`. Both are in `README.md`.

pub mod alter;
pub mod bundle;
pub mod checkpoint;
pub mod frame;
pub mod mesh;
pub mod packing;
pub mod problem;
pub mod robot;
pub mod scene;

/// Something that graintrain reads.
#[derive(Clone, Copy)]
pub struct Target {
    /// Name, also that of its module.
    pub name: &'static str,
    /// Reads an input; says whether it was accepted.
    pub run: fn(&[u8]) -> bool,
    /// Sound inputs.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// What is put into inputs besides what other inputs have.
    pub words: fn() -> Vec<Vec<u8>>,
}

/// All targets.
pub const TARGETS: &[Target] = &[
    Target { name: "scene", run: scene::run, seeds: scene::seeds, words: scene::words },
    Target { name: "problem", run: problem::run, seeds: problem::seeds, words: problem::words },
    Target { name: "packing", run: packing::run, seeds: packing::seeds, words: Vec::new },
    Target { name: "mesh", run: mesh::run, seeds: mesh::seeds, words: Vec::new },
    Target { name: "checkpoint", run: checkpoint::run, seeds: checkpoint::seeds, words: Vec::new },
    Target { name: "frame", run: frame::run, seeds: frame::seeds, words: Vec::new },
    Target { name: "robot", run: robot::run, seeds: robot::seeds, words: Vec::new },
];

#[cfg(test)]
mod tests;
