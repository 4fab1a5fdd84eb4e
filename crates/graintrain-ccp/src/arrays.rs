//! Contact problems from plain arrays, checked.

use crate::delassus::Delassus;
use crate::problem::{Ccp, CcpError};
use graintrain_linalg::block3::{Block, BlockMatrix3};

/// Relative to sqrt(n_ii n_jj), the size that an entry n_ij can have: below this, differences are rounding.
const ROUNDING: f64 = 1e-9;

impl Ccp {
    /// A bare problem whose N is given by its nonzero entries (row, column, value), both triangles, in any
    /// order; entries that are given more than once are added up. Contact i has the rows 3 i (normal), 3 i +
    /// 1 and 3 i + 2 (tangents). `r` is of length 3 N_c, `friction` of length N_c, which is the number of
    /// contacts.
    ///
    /// ```
    /// use graintrain_ccp::{Ccp, SolveSettings, SolverSpec};
    /// // One ball of 2 kg on a floor, thrown down at 1 m/s and along it at 0.1 m/s: N = diag(1, 3.5, 3.5) / 2 kg.
    /// let entries = [(0, 0, 0.5), (1, 1, 1.75), (2, 2, 1.75)];
    /// let problem = Ccp::from_triplets(&entries, vec![-1.0, 0.1, 0.0], vec![0.3])?;
    /// let mut impulse = vec![0.0; 3];
    /// let report = SolverSpec::default().build()?.solve(&problem, &mut impulse, &SolveSettings::default())?;
    /// assert!(report.converged() && (impulse[0] - 2.0).abs() < 1e-3);
    /// # Ok::<(), graintrain_ccp::CcpError>(())
    /// ```
    ///
    /// # Errors
    /// [`CcpError::Index`] for an entry beyond row or column 3 N_c - 1. [`CcpError::Entry`] where N is not
    /// finite, not symmetric, or cannot be positive semi-definite as far as pairs of rows tell: n_ii >= 0
    /// and |n_ij| <= sqrt(n_ii n_jj). Otherwise those of [`Ccp::validate`].
    pub fn from_triplets(
        entries: &[(usize, usize, f64)],
        r: Vec<f64>,
        friction: Vec<f64>,
    ) -> Result<Self, CcpError> {
        let size = 3 * friction.len();
        for &(row, column, value) in entries {
            for (what, index) in [("row", row), ("column", column)] {
                if index >= size {
                    return Err(CcpError::Index { what, index, bound: size });
                }
            }
            if !value.is_finite() {
                return Err(CcpError::Entry { row, column, value, expected: "it must be finite" });
            }
        }
        let matrix = blocks(entries, friction.len())?;
        check(&matrix)?;
        Self::new(Delassus::Sparse(matrix), r, friction)
    }

    /// As [`Ccp::from_triplets`] with N in compressed columns: the entries of column j are
    /// `row[start[j]..start[j + 1]]` with the `value`s at the same places; `start` has 3 N_c + 1 entries.
    /// Rows need not ascend.
    ///
    /// ```
    /// use graintrain_ccp::Ccp;
    /// let (start, row, value) = ([0, 1, 2, 3], [0, 1, 2], [0.5, 1.75, 1.75]);
    /// let problem = Ccp::from_csc(&start, &row, &value, vec![-1.0, 0.1, 0.0], vec![0.3])?;
    /// assert_eq!(problem.num_contacts(), 1);
    /// assert!(Ccp::from_csc(&start, &[0, 1, 3], &value, vec![-1.0, 0.1, 0.0], vec![0.3]).is_err());
    /// # Ok::<(), graintrain_ccp::CcpError>(())
    /// ```
    ///
    /// # Errors
    /// [`CcpError::Size`] or [`CcpError::Index`] where the arrays do not fit together; otherwise as
    /// [`Ccp::from_triplets`].
    pub fn from_csc(
        start: &[usize],
        row: &[usize],
        value: &[f64],
        r: Vec<f64>,
        friction: Vec<f64>,
    ) -> Result<Self, CcpError> {
        let columns = 3 * friction.len();
        let fits = |what, got, expected| {
            if got == expected { Ok(()) } else { Err(CcpError::Size { what, got, expected }) }
        };
        fits("the list of column starts", start.len(), columns + 1)?;
        fits("the list of values", value.len(), row.len())?;
        fits("what comes before the first column", start[0], 0)?;
        fits("the list of rows", row.len(), start[columns])?;
        let mut entries = Vec::with_capacity(row.len());
        for column in 0..columns {
            let range = start[column]..start[column + 1];
            let bound = row.len() + 1;
            let (row, value) = row.get(range.clone()).zip(value.get(range)).ok_or(CcpError::Index {
                what: "column start",
                index: start[column + 1],
                bound,
            })?;
            entries.extend(row.iter().zip(value).map(|(&row, &value)| (row, column, value)));
        }
        Self::from_triplets(&entries, r, friction)
    }
}

/// The matrix of entries that are in range. The two triangles of what is symmetric but for rounding become
/// equal in [`crate::newton::SchurComplement`], not here.
pub(crate) fn blocks(entries: &[(usize, usize, f64)], contacts: usize) -> Result<BlockMatrix3, CcpError> {
    let mut sorted: Vec<(usize, usize, f64)> = entries.to_vec();
    // Stable, so that entries given more than once add up in the order given.
    sorted.sort_by_key(|&(row, column, _)| (row / 3, column / 3));
    let mut row_start = vec![0; contacts + 1];
    let (mut columns, mut blocks): (Vec<u32>, Vec<Block>) = Default::default();
    let mut last = None;
    for (row, column, value) in sorted {
        let place = (row / 3, column / 3);
        if last != Some(place) {
            last = Some(place);
            columns.push(place.1 as u32);
            blocks.push([0.0; 9]);
            row_start[place.0 + 1] += 1;
        }
        if let Some(block) = blocks.last_mut() {
            block[3 * (row % 3) + column % 3] += value;
        }
    }
    for i in 0..contacts {
        row_start[i + 1] += row_start[i];
    }
    Ok(BlockMatrix3::try_from_rows(row_start, columns, blocks)?)
}

/// Symmetry, and what every pair of rows of a positive semi-definite matrix has.
fn check(matrix: &BlockMatrix3) -> Result<(), CcpError> {
    let diagonal: Vec<f64> = (0..matrix.num_rows())
        .flat_map(|i| {
            let block = matrix.get(i, i);
            [block[0], block[4], block[8]]
        })
        .collect();
    for (k, &value) in diagonal.iter().enumerate() {
        if !(value.is_finite() && value >= 0.0) {
            let expected = "the diagonal of a positive semi-definite matrix is finite and not negative";
            return Err(CcpError::Entry { row: k, column: k, value, expected });
        }
    }
    for i in 0..matrix.num_rows() {
        let (columns, blocks) = matrix.row(i);
        for (&j, block) in columns.iter().zip(blocks) {
            let mirror = matrix.get(j as usize, i);
            for (e, &value) in block.iter().enumerate() {
                let (row, column) = (3 * i + e / 3, 3 * j as usize + e % 3);
                // Not the root of the product, which may leave the range of the floats.
                let bound = diagonal[row].sqrt() * diagonal[column].sqrt();
                if !(value - mirror[3 * (e % 3) + e / 3]).abs().le(&(ROUNDING * bound)) {
                    let expected = "N must be symmetric, with both triangles given";
                    return Err(CcpError::Entry { row, column, value, expected });
                }
                if !value.abs().le(&((1.0 + ROUNDING) * bound)) {
                    let expected = "in a positive semi-definite matrix it is at most the root of the product of both diagonal entries";
                    return Err(CcpError::Entry { row, column, value, expected });
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delassus::tests::random_rigid;
    use proptest::prelude::*;

    fn entries(matrix: &BlockMatrix3) -> Vec<(usize, usize, f64)> {
        let mut entries = Vec::new();
        for i in 0..matrix.num_rows() {
            let (columns, blocks) = matrix.row(i);
            for (&j, block) in columns.iter().zip(blocks) {
                for (e, &value) in block.iter().enumerate() {
                    entries.push((3 * i + e / 3, 3 * j as usize + e % 3, value));
                }
            }
        }
        entries
    }

    #[test]
    fn entries_and_compressed_columns_make_the_matrix_they_were_taken_from() {
        let matrix = random_rigid(6, 15, 4).assemble();
        let (r, friction) = (vec![0.1; 45], vec![0.4; 15]);
        let mut list = entries(&matrix);
        let by_entries = Ccp::from_triplets(&list, r.clone(), friction.clone()).unwrap();
        list.sort_by_key(|&(row, column, _)| (column, std::cmp::Reverse(row)));
        let mut start = vec![0; 46];
        for &(_, column, _) in &list {
            start[column + 1] += 1;
        }
        for k in 0..45 {
            start[k + 1] += start[k];
        }
        let (row, value): (Vec<usize>, Vec<f64>) = list.iter().map(|&(row, _, value)| (row, value)).unzip();
        let by_columns = Ccp::from_csc(&start, &row, &value, r, friction).unwrap();
        for problem in [by_entries, by_columns] {
            assert!(matches!(&*problem.delassus, Delassus::Sparse(found) if *found == matrix));
        }
    }

    #[test]
    fn what_is_not_a_delassus_matrix_is_refused() {
        let good = [(0, 0, 1.0), (1, 1, 1.0), (2, 2, 1.0), (0, 1, 0.5), (1, 0, 0.5)];
        let of = |entries: &[(usize, usize, f64)]| Ccp::from_triplets(entries, vec![0.0; 3], vec![0.5]);
        assert!(of(&good).is_ok());
        for (bad, named) in [
            ((3, 0, 1.0), "row 3"),
            ((0, 9, 1.0), "column 9"),
            ((0, 2, f64::NAN), "NaN"),
            ((0, 0, -2.0), "not negative"),
            ((0, 2, 0.5), "symmetric"),
            ((0, 0, -0.9), "root of the product"),
        ] {
            let error = of(&[&good[..], &[bad]].concat()).unwrap_err().to_string();
            assert!(error.contains(named), "{bad:?}: {error}");
        }
        assert!(matches!(Ccp::from_triplets(&good, vec![0.0; 4], vec![0.5]), Err(CcpError::Size { .. })));
        assert!(matches!(Ccp::from_triplets(&good, vec![0.0; 3], vec![-0.5]), Err(CcpError::Value { .. })));
        assert!(Ccp::from_triplets(&[], Vec::new(), Vec::new()).is_ok());
    }

    proptest! {
        /// Whatever the arrays are, there is a problem or an error.
        #[test]
        fn compressed_columns_never_panic(
            start in prop::collection::vec(0..6_usize, 0..9),
            row in prop::collection::vec(0..8_usize, 0..6),
            value in prop::collection::vec(prop::num::f64::ANY, 0..6),
            contacts in 0..3_usize,
        ) {
            let _ = Ccp::from_csc(&start, &row, &value, vec![0.0; 3 * contacts], vec![0.5; contacts]);
        }
    }
}
