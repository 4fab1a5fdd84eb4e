//! From the local form, u = W r + q, to a CCP over an explicit sparse matrix.

use super::NOTICEABLE_ASYMMETRY;
use super::dense;
use super::error::Defect;
use super::matrix::{Entry, Matrix};
use super::raw::{LocalEqualities, LocalForm};
use graintrain_ccp::Delassus;
use graintrain_linalg::block3::{Block, BlockMatrix3};

/// N, r and how far W was from symmetry, max |W - W^T| / max |W|.
pub(super) struct Reduced {
    pub(super) delassus: Delassus,
    /// W itself where it is noticeably asymmetric.
    pub(super) as_filed: Option<Delassus>,
    pub(super) r: Vec<f64>,
    pub(super) asymmetry: f64,
}

/// The CCP of a local problem. W is made symmetric, N = (W + W^T) / 2: the relaxed problem is a minimisation
/// only then. Exact friction needs no symmetry.
pub(super) fn reduce(local: LocalForm) -> Result<Reduced, Defect> {
    let asymmetry = local.w.asymmetry();
    let (w, r) = match &local.equalities {
        Some(equalities) => eliminate(&local, equalities)?,
        None => (local.w, local.q),
    };
    let as_filed = (asymmetry > NOTICEABLE_ASYMMETRY).then(|| as_filed(&w));
    Ok(Reduced { delassus: Delassus::Sparse(symmetric_blocks(&w)), as_filed, r, asymmetry })
}

/// (A + A^T) / 2 in 3x3 blocks; diagonal blocks are always stored.
pub(super) fn symmetric_blocks(matrix: &Matrix) -> BlockMatrix3 {
    let both = matrix.entries.iter().flat_map(|entry| {
        [(entry.row, entry.column, 0.5 * entry.value), (entry.column, entry.row, 0.5 * entry.value)]
    });
    summed_blocks(matrix.rows / 3, both.collect())
}

/// A itself in 3x3 blocks; diagonal blocks are always stored.
pub(super) fn as_filed(matrix: &Matrix) -> Delassus {
    let entries = matrix.entries.iter().map(|entry| (entry.row, entry.column, entry.value));
    Delassus::Sparse(summed_blocks(matrix.rows / 3, entries.collect()))
}

/// The matrix of these entries (row, column, value), added up where there are several.
fn summed_blocks(contacts: usize, mut entries: Vec<(usize, usize, f64)>) -> BlockMatrix3 {
    // Sorted by block, then by position; the sort is stable, so that sums have a fixed order.
    entries.sort_by_key(|&(row, column, _)| (row / 3, column / 3));
    let mut entries = entries.into_iter().peekable();
    let (mut row_start, mut columns, mut blocks) = (vec![0], Vec::new(), Vec::new());
    for i in 0..contacts {
        let mut row: Vec<(u32, Block)> = Vec::new();
        while let Some((a, b, value)) = entries.next_if(|&(row, _, _)| row / 3 == i) {
            let j = (b / 3) as u32;
            if row.last().is_none_or(|&(last, _)| last != j) {
                row.push((j, [0.0; 9]));
            }
            let last = row.len() - 1;
            row[last].1[3 * (a % 3) + b % 3] += value;
        }
        if let Err(place) = row.binary_search_by_key(&(i as u32), |&(j, _)| j) {
            row.insert(place, (i as u32, [0.0; 9]));
        }
        columns.extend(row.iter().map(|&(j, _)| j));
        blocks.extend(row.iter().map(|&(_, block)| block));
        row_start.push(columns.len());
    }
    BlockMatrix3::from_rows(row_start, columns, blocks)
}

/// Eliminates lambda = -R^-1 (V^T r + s):  W <- W - V R^-1 V^T,  q <- q - V R^-1 s.
///
/// FCLIB's convention makes R negative definite where lambda are multipliers of equality constraints; either
/// sign is taken. R singular (redundant equalities) is refused.
fn eliminate(local: &LocalForm, equalities: &LocalEqualities) -> Result<(Matrix, Vec<f64>), Defect> {
    let p = equalities.s.len();
    let mut dense_r = vec![0.0; p * p];
    for entry in &equalities.r.entries {
        dense_r[entry.row * p + entry.column] += 0.5 * entry.value;
        dense_r[entry.column * p + entry.row] += 0.5 * entry.value;
    }
    let negative: Vec<f64> = dense_r.iter().map(|value| -value).collect();
    let (factor, sign) = match (dense::cholesky(dense_r, p), dense::cholesky(negative, p)) {
        (Some(factor), _) => (factor, -1.0),
        (None, Some(factor)) => (factor, 1.0),
        (None, None) => {
            return Err(Defect::unsupported(
                "equality constraints whose matrix R is not definite (redundant constraints?)",
                "eliminate the equality constraints before writing the problem",
            ));
        }
    };
    add_low_rank(local.w.clone(), local.q.clone(), &equalities.v, &equalities.s, &factor, sign)
}

/// W + sign V (L L^T)^-1 V^T and q + sign V (L L^T)^-1 s.
pub(super) fn add_low_rank(
    mut w: Matrix,
    mut q: Vec<f64>,
    v: &Matrix,
    s: &[f64],
    factor: &[f64],
    sign: f64,
) -> Result<(Matrix, Vec<f64>), Defect> {
    let p = s.len();
    let mut y_s = s.to_vec();
    dense::solve_lower(factor, p, &mut y_s);
    // Rows of Y = V L^-T, where V has any.
    let mut rows: Vec<(usize, Vec<f64>)> = Vec::new();
    for entry in &v.entries {
        if rows.last().is_none_or(|&(row, _)| row != entry.row) {
            rows.push((entry.row, vec![0.0; p]));
        }
        let last = rows.len() - 1;
        rows[last].1[entry.column] = entry.value;
    }
    for (_, y) in &mut rows {
        dense::solve_lower(factor, p, y);
    }
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    for (row, y) in &rows {
        q[*row] += sign * dot(y, &y_s);
        for (column, z) in &rows {
            w.entries.push(Entry { row: *row, column: *column, value: sign * dot(y, z) });
        }
    }
    let sum = Matrix::new("W without the equality constraints", w.rows, w.columns, w.entries)?;
    Ok((sum, q))
}
