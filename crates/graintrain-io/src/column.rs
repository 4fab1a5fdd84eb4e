//! What a column of a table means.

use serde::Serialize;

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Column {
    /// As in the header.
    pub name: &'static str,
    /// SI unit, `1` for ratios and counts, empty for names.
    pub unit: &'static str,
    /// One line.
    pub meaning: &'static str,
}

/// A column of this name, unit and meaning.
pub(crate) const fn column(name: &'static str, unit: &'static str, meaning: &'static str) -> Column {
    Column { name, unit, meaning }
}
