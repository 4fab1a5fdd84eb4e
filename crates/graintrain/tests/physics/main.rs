//! Physics against exact answers: the tests A1 to A20 of docs/mechanics.md.

mod by_default;
mod cells;
mod chains;
mod collisions;
mod confined;
mod drives;
mod elasticity;
mod energy;
mod flight;
mod forces;
mod friction;
mod gradients;
mod impacts;
mod invariants;
mod joints;
mod loads;
mod meshes;
mod motors;
mod packings;
mod pages;
mod repetition;
mod rotation;
mod statics;
mod support;
mod trust;
mod turning;
