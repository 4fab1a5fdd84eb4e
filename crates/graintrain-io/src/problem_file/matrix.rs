//! Sparse matrices as they come out of problem files.

use super::error::{Defect, WRITE_AGAIN};

/// A sparse matrix: entries sorted by (row, column), each position once, zeros left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Matrix {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) entries: Vec<Entry>,
}

/// One entry of a matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Entry {
    pub(super) row: usize,
    pub(super) column: usize,
    pub(super) value: f64,
}

impl Matrix {
    /// From entries in any order; entries at the same position are added (the convention of triplet storage).
    pub(super) fn new(
        place: &str,
        rows: usize,
        columns: usize,
        mut entries: Vec<Entry>,
    ) -> Result<Self, Defect> {
        for entry in &entries {
            if entry.row >= rows || entry.column >= columns {
                let what = format!(
                    "entry (row {}, column {}) lies outside a {rows} x {columns} matrix",
                    entry.row, entry.column
                );
                return Err(Defect::damaged(place, what, WRITE_AGAIN));
            }
            if !entry.value.is_finite() {
                let what = format!("entry (row {}, column {}) is {}", entry.row, entry.column, entry.value);
                return Err(Defect::damaged(place, what, WRITE_AGAIN));
            }
        }
        entries.sort_by_key(|entry| (entry.row, entry.column));
        entries.dedup_by(|next, kept| {
            let same = (next.row, next.column) == (kept.row, kept.column);
            if same {
                kept.value += next.value;
            }
            same
        });
        entries.retain(|entry| entry.value != 0.0);
        Ok(Self { rows, columns, entries })
    }

    /// Mirrors the entries at the diagonal where all others lie on one side of it, as files have it that
    /// store one triangle of a symmetric matrix; says whether that was so.
    pub(super) fn mirror_triangle(&mut self) -> bool {
        let above = self.entries.iter().any(|entry| entry.row < entry.column);
        let below = self.entries.iter().any(|entry| entry.row > entry.column);
        if above == below {
            return false;
        }
        let off_diagonal = self.entries.iter().filter(|entry| entry.row != entry.column);
        let mirrored: Vec<Entry> = off_diagonal
            .map(|entry| Entry { row: entry.column, column: entry.row, value: entry.value })
            .collect();
        self.entries.extend(mirrored);
        self.entries.sort_by_key(|entry| (entry.row, entry.column));
        true
    }

    /// The transposed matrix: its rows are the columns of this one.
    pub(super) fn transposed(&self) -> Self {
        let mut entries: Vec<Entry> = self
            .entries
            .iter()
            .map(|entry| Entry { row: entry.column, column: entry.row, value: entry.value })
            .collect();
        entries.sort_by_key(|entry| (entry.row, entry.column));
        Self { rows: self.columns, columns: self.rows, entries }
    }

    /// The entries of rows `range`.
    pub(super) fn rows_in(&self, range: std::ops::Range<usize>) -> &[Entry] {
        let start = self.entries.partition_point(|entry| entry.row < range.start);
        let end = self.entries.partition_point(|entry| entry.row < range.end);
        &self.entries[start..end]
    }

    /// max |A - A^T| / max |A|.
    pub(super) fn asymmetry(&self) -> f64 {
        let largest = self.entries.iter().fold(0.0_f64, |m, entry| m.max(entry.value.abs()));
        let difference = self
            .entries
            .iter()
            .fold(0.0_f64, |m, entry| m.max((entry.value - self.get(entry.column, entry.row)).abs()));
        if largest > 0.0 { difference / largest } else { 0.0 }
    }

    /// Entry (i, j), zero where it is not stored.
    pub(super) fn get(&self, row: usize, column: usize) -> f64 {
        self.entries
            .binary_search_by_key(&(row, column), |entry| (entry.row, entry.column))
            .map_or(0.0, |k| self.entries[k].value)
    }
}
