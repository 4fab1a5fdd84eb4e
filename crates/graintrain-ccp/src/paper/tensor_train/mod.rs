//! What tensor trains need to know of contacts: places in space, the index tree, compressed inverses and
//! their re-use.

pub mod inverse;
pub mod padded;
pub mod place;
pub mod placement;
pub mod tree;
