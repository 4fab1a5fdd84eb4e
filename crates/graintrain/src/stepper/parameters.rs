//! What the methods of a step are tuned by, each beside its method.

pub use super::repetition::Parameters as RepetitionParameters;
pub use crate::impact::Parameters as ImpactParameters;
pub use crate::overlap::Parameters as OverlapParameters;
pub use crate::part_solver::{FewParameters, Parameters as PartParameters};

/// The tuned numbers of a step. They are no part of checkpoints: a run that goes on has the defaults.
#[derive(Clone, Debug, Default)]
pub struct Parameters {
    /// When a step is made again.
    pub repetition: RepetitionParameters,
    /// Of impacts.
    pub impacts: ImpactParameters,
    /// Of the contact problem, part by part.
    pub parts: PartParameters,
    /// Of the displacements that remove overlap.
    pub overlap: OverlapParameters,
}
