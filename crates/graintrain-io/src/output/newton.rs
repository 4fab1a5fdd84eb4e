//! What the linear solver of a Newton method did: one record per iteration in `newton.csv`.

use super::columns::{self, header, newton_figures};
use crate::files::{OutputError, Table};
use crate::mark::Mark;
use graintrain_ccp::newton::NewtonRecord;
use std::path::{Path, PathBuf};

/// Name of the table.
pub(super) const NEWTON: &str = "newton.csv";

/// The table `newton.csv`, which appears with the first record.
#[derive(Debug)]
pub struct NewtonTable {
    path: PathBuf,
    table: Option<Table>,
}

/// A figure as a CSV field, empty where there is none.
fn cell(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| format!("{value:?}"))
}

impl NewtonTable {
    /// Nothing is written before the first record.
    pub fn create(folder: &Path) -> Self {
        Self { path: folder.join(NEWTON), table: None }
    }

    /// Goes on with the table in the folder after step `last_step`, when it held `mark`; without a mark it
    /// had not begun by then.
    ///
    /// # Errors
    /// Where it cannot be read or written.
    pub fn reopen(folder: &Path, last_step: u64, mark: Option<Mark>) -> Result<Self, OutputError> {
        let mut newton = Self::create(folder);
        if mark.is_some() || newton.path.exists() {
            newton.table =
                Some(Table::reopen(newton.path.clone(), &header(columns::NEWTON), last_step, mark)?);
        }
        Ok(newton)
    }

    /// The table, where it has begun.
    pub(super) fn table(&self) -> Option<&Table> {
        self.table.as_ref()
    }

    /// Appends the iterations of a step.
    ///
    /// # Errors
    /// Where they cannot be written.
    pub fn append(&mut self, step: u64, records: &[NewtonRecord]) -> Result<(), OutputError> {
        for record in records {
            let figures: Vec<String> = newton_figures()
                .iter()
                .map(|column| cell(record.figures.get(column.name).copied()))
                .collect();
            let line = format!(
                "{step},{},{},{:?},{:?},{:?},{},{:?},{:?},{:?},{}",
                record.iteration,
                record.inner_iterations,
                record.residual,
                record.step,
                record.linear_residual,
                record.linear_converged,
                record.condition,
                record.precompute_seconds,
                record.apply_seconds,
                figures.join(",")
            );
            let table = match &mut self.table {
                Some(table) => table,
                none => none.insert(Table::create(self.path.clone(), &header(columns::NEWTON))?),
            };
            table.append(&line)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mark::Loss;

    #[test]
    fn records_have_as_many_cells_as_columns() {
        let mut record = NewtonRecord { precompute_seconds: 0.5, condition: 7.0, ..NewtonRecord::default() };
        record.figures.insert("rank_matrix".to_string(), 4.0);
        let mut other = record.clone();
        other.figures.insert("rank_matrix".to_string(), 8.0);
        let records = [record, other];
        let folder = tempfile::tempdir().unwrap();
        let mut table = NewtonTable::create(folder.path());
        table.append(1, &[]).unwrap();
        let path = folder.path().join("newton.csv");
        assert!(!path.exists());
        table.append(2, &records).unwrap();
        let mark = table.table().map(Table::mark);
        table.append(3, &records).unwrap();
        drop(table);
        // A run that goes on from step 2 writes step 3 again.
        NewtonTable::reopen(folder.path(), 2, mark).unwrap().append(3, &records[..1]).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 4);
        let columns = lines[0].split(',').count();
        assert!(lines.iter().all(|line| line.split(',').count() == columns));
        assert_eq!(lines[3].split(',').next(), Some("3"));
        // What it held is missed like any other table.
        std::fs::remove_file(&path).unwrap();
        let table = NewtonTable::reopen(folder.path(), 2, mark).unwrap();
        assert_eq!(table.table().unwrap().loss(), Some(&Loss::Missing(path)));
    }
}
