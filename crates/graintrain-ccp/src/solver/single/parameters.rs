//! What the iterations in single precision are tuned by.

/// When iterations begin in single precision, how often they are looked at, and when double precision goes
/// on. Values: docs/solvers.md, "Single precision first", on the common drop of 4 913 spheres at tolerances
/// of 1e-2 and 1e-3.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Contacts below which the packing costs more than the iterations save.
    pub fewest_contacts: usize,
    /// Least tolerance of the root mean square: what single precision reaches on packings.
    pub least_tolerance: f64,
    /// The same of the worst contact.
    pub least_maximum: f64,
    /// Iterations between two evaluations of the residual: at least and at most. In between the length of the
    /// steps tells when it is time.
    pub checks: [usize; 2],
    /// Iterations between two evaluations of images from their vectors.
    pub refresh: usize,
    /// Double precision goes on after so many iterations without a tenth off the least residual.
    pub patience: usize,
    /// Double precision goes on where this multiple of what rounding may do to the residual reaches the
    /// tolerance.
    pub rounding: f64,
    /// Rounding does so many times as much to the worst contact as to the root mean square.
    pub worst: f64,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            fewest_contacts: 256,
            least_tolerance: 2e-5,
            least_maximum: 1e-3,
            checks: [3, 25],
            refresh: 100,
            patience: 1000,
            rounding: 8.0,
            worst: 4.0,
        }
    }
}
