//! A train over all slots of a tree, applied to vectors over the contacts that sit in some of them.

use graintrain_tt::apply::{ApplyWork, FullOperator};
use graintrain_tt::{TtError, TtMatrix};

/// P^T X P, with P from unknowns to slots: what a train over slots and dummies does to the unknowns alone.
pub struct PaddedOperator {
    operator: FullOperator,
    work: ApplyWork,
    padded: Vec<f64>,
    image: Vec<f64>,
}

impl PaddedOperator {
    /// Of this train.
    ///
    /// # Errors
    /// [`TtError::TooLarge`] if the full vectors would not fit in an index.
    pub fn new(train: &TtMatrix) -> Result<Self, TtError> {
        let operator = FullOperator::new(train)?;
        let (padded, image) = (vec![0.0; operator.num_columns()], vec![0.0; operator.num_rows()]);
        Ok(Self { operator, work: ApplyWork::default(), padded, image })
    }

    /// Floating-point operations of one application.
    pub fn flops(&self) -> f64 {
        self.operator.flops()
    }

    /// z <- P^T X P r, where P puts the `block` unknowns of unit u at `block * place[u]` of the padded
    /// vector.
    pub fn apply(&mut self, block: usize, place: &[usize], r: &[f64], z: &mut [f64]) {
        let Self { operator, work, padded, image } = self;
        padded.fill(0.0);
        for (r, &p) in r.chunks_exact(block).zip(place) {
            padded[block * p..block * (p + 1)].copy_from_slice(r);
        }
        // The sizes were fixed in `new`, so the product cannot fail.
        if operator.apply(padded, image, work).is_ok() {
            for (z, &p) in z.chunks_exact_mut(block).zip(place) {
                z.copy_from_slice(&image[block * p..block * (p + 1)]);
            }
        }
    }
}
