//! Arrays of the crate `ndarray` as trains and back: axis k of an array is mode k of a train (the fastest
//! first, however the array lies in memory).

use crate::{FullMatrix, Truncation, TruncationReport, TtError, TtVector};
use ndarray::{Array2, ArrayBase, ArrayD, ArrayView2, Data, Dimension, IxDyn, ShapeBuilder};

impl TtVector {
    /// TT-SVD of an array: [`TtVector::from_full`] with the axes of the array as modes. An array in
    /// column-major order is not copied.
    ///
    /// # Errors
    /// As for [`TtVector::from_full`]; [`TtError::Shape`] for an array without axes or entries.
    ///
    /// ```
    /// use graintrain_tt::{Truncation, TtVector};
    /// use ndarray::Array3;
    /// let array = Array3::from_shape_fn((4, 5, 6), |(i, j, k)| (i + 2 * j) as f64 + 0.5 * k as f64);
    /// let (train, report) = TtVector::from_array(&array, &Truncation::to(1e-12))?;
    /// assert_eq!((train.modes(), train.ranks()), (vec![4, 5, 6], vec![1, 2, 2, 1]));
    /// assert!(train.to_array()?.iter().zip(&array).all(|(a, b)| (a - b).abs() < 1e-11));
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn from_array<S: Data<Elem = f64>, D: Dimension>(
        array: &ArrayBase<S, D>,
        truncation: &Truncation,
    ) -> Result<(Self, TruncationReport), TtError> {
        // (The transpose of a column-major array lies in memory as ndarray's standard order wants it.)
        let turned = array.t();
        match turned.as_slice() {
            Some(full) => Self::from_full(full, array.shape(), truncation),
            None => Self::from_full(&turned.iter().copied().collect::<Vec<_>>(), array.shape(), truncation),
        }
    }

    /// The full tensor as an array whose axes are the modes, in column-major order.
    ///
    /// # Errors
    /// [`TtError::TooLarge`] above 2^31 entries.
    pub fn to_array(&self) -> Result<ArrayD<f64>, TtError> {
        let modes = self.modes();
        let full = self.to_full()?;
        let got = vec![full.len()];
        ArrayD::from_shape_vec(IxDyn(&modes).f(), full).map_err(|_| TtError::Shape {
            what: "axes of an array",
            expected: modes,
            got,
        })
    }
}

impl FullMatrix {
    /// From a two-dimensional array.
    ///
    /// ```
    /// use graintrain_tt::{FullMatrix, Truncation, TtMatrix};
    /// use ndarray::Array2;
    /// let array = Array2::from_shape_fn((4, 6), |(i, j)| (i * j) as f64);
    /// let (train, _) = TtMatrix::from_full(&FullMatrix::from_array(array.view()), &[2, 2], &[3, 2], &Truncation::to(1e-12))?;
    /// assert!((train.to_full()?.to_array() - array).iter().all(|x| x.abs() < 1e-12));
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn from_array(array: ArrayView2<'_, f64>) -> Self {
        let (rows, columns) = array.dim();
        Self { rows, columns, data: array.t().iter().copied().collect() }
    }

    /// As a two-dimensional array.
    pub fn to_array(&self) -> Array2<f64> {
        Array2::from_shape_fn((self.rows, self.columns), |(i, j)| self[(i, j)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array, Array0, Array3, s};

    #[test]
    fn any_layout_gives_the_same_train() {
        let entry = |(i, j, k): (usize, usize, usize)| (1 + i + 10 * j * k) as f64;
        let rows = Array3::from_shape_fn((3, 2, 4), entry);
        let columns = Array::from_shape_fn((3, 2, 4).f(), entry);
        let wide = Array3::from_shape_fn((3, 4, 4), |(i, j, k)| entry((i, j / 2, k)));
        let exact = Truncation::to(1e-14);
        let first = TtVector::from_array(&rows, &exact).unwrap().0;
        assert_eq!(first, TtVector::from_array(&columns, &exact).unwrap().0);
        assert_eq!(first, TtVector::from_array(&wide.slice(s![.., ..;2, ..]), &exact).unwrap().0);
        let back = first.to_array().unwrap();
        assert_eq!(back.shape(), [3, 2, 4]);
        for ((i, j, k), x) in rows.indexed_iter() {
            assert!(
                (back[[i, j, k]] - x).abs() < 1e-12 && (first.entry(&[i, j, k]).unwrap() - x).abs() < 1e-12
            );
        }
        assert!(TtVector::from_array(&Array0::from_elem((), 1.0), &exact).is_err());
        assert!(TtVector::from_array(&Array3::<f64>::zeros((2, 0, 2)), &exact).is_err());
    }
}
