//! Newton systems of interior-point methods in tensor-train form: indices, compression, inverse, re-use.

pub mod tree;
