//! Ranks without rounding: dependent rows and columns of cores are left out whatever the size of the others.
//!
//! Rounding measures what it leaves out by the norm of the tensor, so a term of 1e-15 beside one of 1 is
//! lost. Here a row of a right unfolding goes only where it is a combination of the rows kept to 16 eps of
//! its OWN length, and the rows kept stay as they are: an interpolative decomposition G = C G(S, :), C into
//! the next core (Cheng, Gimbutas, Martinsson, Rokhlin, SIAM J. Sci. Comput. 26, 2005).

use crate::factor::interpolative_rows;
use crate::vector::Core;
use crate::{TtMatrix, TtVector};
use graintrain_linalg::dense::Matrix;

impl TtVector {
    /// The same tensor with the dependent rows and columns of its cores left out, from the right and from the
    /// left: the true ranks of sums of explicit constructions, to the last digit of every term. Cores whose
    /// rows depend on ill-conditioned ones stay as they are. O(d n r^3).
    ///
    /// ```
    /// use graintrain_tt::qtt;
    /// // Twice a line and 1e-15 of a shift: rounding would drop the shift.
    /// let (line, shift) = (qtt::laplacian(6)?, qtt::shift(6)?.scale(1e-15));
    /// let sum = line.add(&line)?.add(&shift)?.without_dependent_ranks();
    /// assert_eq!(sum.max_rank(), 3);
    /// assert_eq!(sum.entries(&[(9, 8)])?[0], -2.0 + 1e-15);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn without_dependent_ranks(&self) -> Self {
        self.without_dependent_rows().reverse().without_dependent_rows().reverse()
    }

    /// One sweep from the right to the left.
    fn without_dependent_rows(&self) -> Self {
        let mut cores = self.cores.clone();
        for k in (1..cores.len()).rev() {
            let (left, mode, right) = (cores[k].left, cores[k].mode, cores[k].right);
            let rows = Matrix::from_vec(left, mode * right, cores[k].data.clone());
            let Some((kept, combinations)) = interpolative_rows(&rows) else { continue };
            cores[k] =
                Core::from_fn(kept.len(), mode, right, |alpha, i, beta| rows[(kept[alpha], i + mode * beta)]);
            cores[k - 1] = cores[k - 1].multiply_right(combinations.view());
        }
        Self { cores }
    }
}

impl TtMatrix {
    /// See [`TtVector::without_dependent_ranks`].
    pub fn without_dependent_ranks(&self) -> Self {
        self.map(TtVector::without_dependent_ranks)
    }
}
