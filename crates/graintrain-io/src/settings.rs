//! What a run writes: what scenes ask for, outputs obey and checkpoints remember.

use serde::{Deserialize, Serialize};

/// How floating-point arrays are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// 32 bits: enough for pictures, half the size.
    #[default]
    Single,
    /// 64 bits.
    Double,
}

/// What a run writes, and how often.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputSettings {
    /// Steps from frame to frame, at least 1.
    pub every: u64,
    /// Whether frames of the bodies and surfaces are written.
    pub bodies: bool,
    /// Whether frames of the contacts are written.
    pub contacts: bool,
    /// Precision of frames.
    pub precision: Precision,
    /// Steps from checkpoint to checkpoint, at least 1.
    pub checkpoint_every: u64,
}
