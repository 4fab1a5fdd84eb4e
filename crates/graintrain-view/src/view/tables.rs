//! A run's tables.

use super::{ViewError, read_text};
use std::collections::HashSet;
use std::path::Path;

/// A table with a header line, comma-separated, fields in quotes where needed.
pub struct Table {
    names: Vec<String>,
    rows: Vec<Vec<String>>,
    /// Lines that do not fit the header, which are left out.
    pub odd_lines: usize,
}

impl Table {
    /// Reads a table; incomplete last lines (of a run that was killed) are left out.
    ///
    /// # Errors
    /// [`ViewError::Read`].
    pub fn read(path: &Path) -> Result<Self, ViewError> {
        let text = read_text(path)?;
        let mut lines = text.lines().map(fields);
        let names = lines.next().unwrap_or_default();
        let (rows, odd): (Vec<_>, Vec<_>) = lines.partition(|row| row.len() == names.len());
        Ok(Self { names, rows, odd_lines: odd.len() })
    }

    /// Index of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }

    /// Names of the columns.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// A column's fields.
    pub fn texts(&self, name: &str) -> Option<Vec<&str>> {
        let column = self.column(name)?;
        Some(self.rows.iter().map(|row| row[column].as_str()).collect())
    }

    /// A column's numbers, NaN where a field is none.
    pub fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        let column = self.column(name)?;
        Some(self.rows.iter().map(|row| row[column].parse().unwrap_or(f64::NAN)).collect())
    }

    /// The rows whose field in a column is the given text.
    pub fn with(&self, name: &str, value: &str) -> Self {
        let column = self.column(name);
        let rows = self.rows.iter().filter(|row| column.is_some_and(|column| row[column] == value));
        Self { names: self.names.clone(), rows: rows.cloned().collect(), odd_lines: self.odd_lines }
    }

    /// The different texts of a column, in order of appearance.
    pub fn distinct(&self, name: &str) -> Vec<String> {
        let mut found: Vec<String> = Vec::new();
        let mut seen = HashSet::new();
        if let Some(column) = self.column(name) {
            for row in &self.rows {
                if seen.insert(row[column].as_str()) {
                    found.push(row[column].clone());
                }
            }
        }
        found
    }
}

/// The fields of a line.
fn fields(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(c) = characters.next() {
        match c {
            '"' if quoted && characters.peek() == Some(&'"') => {
                characters.next();
                fields.last_mut().expect("starts with one field").push('"');
            }
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(String::new()),
            c => fields.last_mut().expect("starts with one field").push(c),
        }
    }
    fields
}
