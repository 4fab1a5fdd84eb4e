//! Tier B in small: granular samples that take less than a minute each.

use super::Definition;

/// The cases.
pub const CASES: &[Definition] = &[];
