//! Collision detection: all contacts with gap up to the envelope, in an order that does not depend on threads.
//!
//! | module | holds |
//! |---|---|
//! | `grid` | cell list for the many bodies of similar size |
//! | `broad` | candidate pairs: the cell list, a tree over large bodies, planes |
//! | `narrow` | contacts of two bodies, shape by shape |
//! | `distance`, `plane`, `capsule` | closed-form kernels |
//! | `mesh` | triangle meshes, without contacts that only the cut into triangles makes |
//! | `manifold` | boxes and cylinders, through the collision library |
//! | `reduce` | at most four contacts per patch |
//! | `identity` | the same number for the same contact from step to step |

mod broad;
mod capsule;
mod distance;
mod grid;
pub(crate) mod identity;
mod manifold;
mod mesh;
mod narrow;
mod plane;
mod reduce;

pub use broad::{Collider, Overlap, deepest_overlap};
