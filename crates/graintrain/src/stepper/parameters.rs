//! What the methods of a step are tuned by, each beside its method.

pub use super::repetition::Parameters as RepetitionParameters;
pub use crate::impact::Parameters as ImpactParameters;
pub use crate::overlap::Parameters as OverlapParameters;
pub use crate::part_solver::{FewParameters, Parameters as PartParameters};
pub use crate::wedge::Parameters as WedgeParameters;

/// The tuned numbers of a step. They are no part of checkpoints: a run that goes on has the defaults.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// When a step is made again.
    pub repetition: RepetitionParameters,
    /// Of impacts.
    pub impacts: ImpactParameters,
    /// Of the contact problem, part by part, with the search for wedged bodies.
    pub parts: PartParameters,
    /// Of the displacements that remove overlap.
    pub overlap: OverlapParameters,
    /// Iterations that a [comparison with exact friction](super::Stepper::compare_with_exact) is given, in multiples of those of the
    /// relaxed solve, and at least so many.
    pub comparison: (usize, usize),
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            repetition: RepetitionParameters::default(),
            impacts: ImpactParameters::default(),
            parts: PartParameters::default(),
            overlap: OverlapParameters::default(),
            comparison: (5, 100),
        }
    }
}
