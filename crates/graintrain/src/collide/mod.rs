//! Collision detection: all contacts with gap up to the envelope, in an order that does not depend on
//! threads.
//!
//! | module | holds |
//! |---|---|
//! | `grid` | cell list for the many bodies of similar size |
//! | `candidates` | candidate pairs: the cell list, a tree over large bodies, planes |
//! | `broad`, `search` | the loop over bodies that makes the list of contacts; which touches count |
//! | `renewal` | the same where bodies were moved since the last search |
//! | `passing` | pairs along their way: whether they meet or pass each other |
//! | `overlaps` | what an initial state should be checked for |
//! | `narrow` | contacts of two bodies, shape by shape |
//! | `triangle`, `plane`, `capsule` | closed-form kernels |
//! | `mesh` | triangle meshes, without contacts that only the cut into triangles makes |
//! | `sheets` | the sides of a mesh |
//! | `polyhedra` | boxes, convex hulls and triangles with each other, in closed form |
//! | `manifold` | cylinders and cones with each other and with those, through the collision library |
//! | `corners`, `edges` | points of corners and edges that both leave out |
//! | `polish` | the exact normal of a contact of a cylinder or cone, from the library's, which is nearly exact, or lost |
//! | `reduce` | the contacts that a patch needs: four, up to eight where four do not hold the others |
//! | `separation` | planes between convex bodies |
//! | `sweep` | when fast bodies meet within a step, and the contact that lets them arrive |
//! | `union` | what overlapping parts of a compound have in common |
//! | [`places`] | whether there is room for another body |
//! | `encoding` | contacts as they travel between processes |
//! | `identity` | the same number for the same contact from step to step |

mod broad;
mod candidates;
mod capsule;
mod corners;
mod edges;
mod encoding;
mod grid;
pub(crate) mod identity;
mod manifold;
mod mesh;
mod narrow;
mod overlaps;
mod passing;
pub mod places;
mod plane;
mod polish;
mod polyhedra;
mod reduce;
mod renewal;
#[cfg(test)]
mod sampled_motions;
mod search;
mod separation;
mod sheets;
pub(crate) mod sweep;
pub(crate) mod triangle;
pub(crate) mod union;

pub use broad::Collider;
pub use overlaps::{Overlap, deepest_overlap, meshes_that_meet};
pub(crate) use passing::Course;
