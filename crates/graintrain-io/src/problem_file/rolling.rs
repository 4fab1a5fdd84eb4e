//! Problems with rolling friction: from five rows per contact to the block rows of a
//! [`Ccp`](graintrain_ccp::Ccp).
//!
//! FCLIB (`fclib_local_rolling`, `fclib_global_rolling`) and Siconos give a contact the rows (normal, tangent
//! 1, tangent 2, turning 1, turning 2): two turning velocities in rad/s with moments in N m s, |moment| <=
//! mu_r g_n with mu_r a length, and no spinning friction. Here turning rows are block rows of their own, of
//! three rows (spinning, turning 1, turning 2) of which the first is empty, and velocities times a length.

use super::error::{Defect, WRITE_AGAIN};
#[cfg(feature = "fclib")]
use super::matrix::Entry;
use super::matrix::Matrix;
#[cfg(feature = "fclib")]
use graintrain_ccp::Ccp;
use graintrain_ccp::{Delassus, TurningFriction};
use graintrain_linalg::block3::BlockMatrix3;

/// Rows per contact in a file with rolling friction.
pub(super) const ROWS: usize = 5;

/// Where row `k` of a file of so many contacts stands among the block rows: contacts first, then turning
/// rows.
fn place(k: usize, contacts: usize) -> usize {
    let (contact, row) = (k / ROWS, k % ROWS);
    if row < 3 { 3 * contact + row } else { 3 * (contacts + contact) + row - 2 }
}

/// Number of contacts of so many rows of five.
fn contacts(rows: usize) -> usize {
    rows / ROWS
}

/// The vector in block rows; what the file does not have is zero.
pub(super) fn spread_vector(vector: &[f64]) -> Vec<f64> {
    let contacts = contacts(vector.len());
    let mut spread = vec![0.0; 6 * contacts];
    for (k, &value) in vector.iter().enumerate() {
        spread[place(k, contacts)] = value;
    }
    spread
}

/// The matrix with its rows, its columns or both in block rows.
pub(super) fn spread_matrix(matrix: Matrix, rows: bool, columns: bool) -> Result<Matrix, Defect> {
    let of_rows = contacts(matrix.rows);
    let of_columns = contacts(matrix.columns);
    let mut entries = matrix.entries;
    for entry in &mut entries {
        if rows {
            entry.row = place(entry.row, of_rows);
        }
        if columns {
            entry.column = place(entry.column, of_columns);
        }
    }
    let rows = if rows { 6 * of_rows } else { matrix.rows };
    let columns = if columns { 6 * of_columns } else { matrix.columns };
    Matrix::new("a matrix with rolling friction", rows, columns, entries)
}

/// Turning rows times lengths that make them as mobile as the tangents of their contacts, and the
/// coefficients over these lengths: the natural length of a ball is its radius, whatever the file's units
/// are.
pub(super) struct Scaled {
    pub(super) delassus: Delassus,
    pub(super) as_filed: Option<Delassus>,
    pub(super) r: Vec<f64>,
    pub(super) turning: Vec<TurningFriction>,
    /// Length of each contact's turning rows, m.
    pub(super) length: Vec<f64>,
}

/// Scales r, N, which gives the lengths, and N as it is in the file, where that is another matrix.
pub(super) fn scale(
    delassus: &Delassus,
    as_filed: Option<&Delassus>,
    mut r: Vec<f64>,
    rolling: &[f64],
) -> Result<Scaled, Defect> {
    let contacts = rolling.len();
    let length: Vec<f64> = (0..contacts)
        .map(|i| {
            let [contact, turning] = [i, contacts + i].map(|block| delassus.diagonal_block(block));
            let length = ((contact[4] + contact[8]) / (turning[4] + turning[8])).sqrt();
            if length.is_finite() && length > 0.0 { length } else { 1.0 }
        })
        .collect();
    let factor = |block: usize| block.checked_sub(contacts).map_or(1.0, |k| length[k]);
    for (k, r) in r.iter_mut().enumerate() {
        *r *= factor(k / 3);
    }
    let scaled = |matrix: &Delassus| {
        let matrix = matrix.assemble();
        let mut blocks = matrix.blocks().to_vec();
        for i in 0..matrix.num_rows() {
            for k in matrix.row_starts()[i]..matrix.row_starts()[i + 1] {
                let both = factor(i) * factor(matrix.columns()[k] as usize);
                blocks[k].iter_mut().for_each(|entry| *entry *= both);
            }
        }
        let (starts, columns) = (matrix.row_starts().to_vec(), matrix.columns().to_vec());
        BlockMatrix3::try_from_rows(starts, columns, blocks)
            .map(Delassus::Sparse)
            .map_err(|error| Defect::damaged("the contact problem", error.to_string(), WRITE_AGAIN))
    };
    let turning = rolling
        .iter()
        .zip(&length)
        .zip(0..)
        .map(|((mu, length), contact)| TurningFriction { contact, rolling: mu / length, spinning: 0.0 })
        .collect();
    Ok(Scaled {
        delassus: scaled(delassus)?,
        as_filed: as_filed.map(scaled).transpose()?,
        r,
        turning,
        length,
    })
}

/// A problem in the local form of five rows per contact.
#[cfg(feature = "fclib")]
pub(super) struct Gathered {
    pub(super) w: Matrix,
    pub(super) q: Vec<f64>,
    pub(super) mu_r: Vec<f64>,
}

/// From block rows to five rows per contact: turning rows in rad/s and N m s, empty ones for contacts that do
/// not resist turning.
#[cfg(feature = "fclib")]
pub(super) fn gather(problem: &Ccp) -> Result<Gathered, Defect> {
    let contacts = problem.num_contacts();
    if let Some(own) = problem.turning.iter().find(|own| own.spinning > 0.0) {
        return Err(Defect::unsupported(
            format!("spinning friction (contact {}), for which FCLIB has no place", own.contact),
            "take spinning_friction out of the scene to write its problems",
        ));
    }
    let length = |k: usize| match &*problem.delassus {
        Delassus::Rigid(rigid) => rigid.turning()[k].length,
        Delassus::Sparse(_) => 1.0,
    };
    // Where row k of a block row goes, and what it is multiplied by.
    let place = |row: usize| {
        let (block, component) = (row / 3, row % 3);
        match block.checked_sub(contacts) {
            None => Some((ROWS * block + component, 1.0)),
            Some(_) if component == 0 => None,
            Some(k) => Some((ROWS * problem.turning[k].contact as usize + 2 + component, 1.0 / length(k))),
        }
    };
    let n = problem.delassus.assemble();
    let mut entries = Vec::with_capacity(9 * n.num_blocks());
    for i in 0..n.num_rows() {
        let (columns, blocks) = n.row(i);
        for (&j, block) in columns.iter().zip(blocks) {
            for (e, value) in block.iter().enumerate() {
                if let (Some(row), Some(column)) = (place(3 * i + e / 3), place(3 * j as usize + e % 3)) {
                    entries.push(Entry { row: row.0, column: column.0, value: value * row.1 * column.1 });
                }
            }
        }
    }
    let size = ROWS * contacts;
    let (mut q, mut mu_r) = (vec![0.0; size], vec![0.0; contacts]);
    for (row, r) in problem.r.iter().enumerate() {
        if let Some((place, factor)) = place(row) {
            q[place] = factor * r;
        }
    }
    for (k, own) in problem.turning.iter().enumerate() {
        mu_r[own.contact as usize] = own.rolling * length(k);
    }
    Ok(Gathered { w: Matrix::new("W", size, size, entries)?, q, mu_r })
}
