//! Reads the text problems of Siconos (`.dat`): dense, sparse-block and sparse matrices, local and global
//! form.
//!
//! Local:  dimension, contacts, W, q, mu.  Global:  dimension, contacts, M, H, q, b, mu  with  M v = H r + q,
//! u = H^T v + b. With dimension 5 contacts have two rows of rolling friction more, and mu_r follows mu. A
//! matrix is a storage number, rows, columns, and
//!
//! | storage | then |
//! |---|---|
//! | 0, dense | rows, columns, the entries column by column |
//! | 1, sparse blocks | number of blocks, block rows, block columns, cumulated row and column sizes, compressed block rows, then per block its number and its entries column by column |
//! | 2, sparse | origin, then what CSparse prints: triplets `i j : x`, or per column `col j : ..` and `i : x` |
//!
//! Meanings checked against `globalFrictionContact_newFromFile`, `NM_new_from_file` and `SBM_new_from_file`
//! of Siconos.

use super::error::{COPY_AGAIN, Defect};
use super::matrix::{Entry, Matrix};
use super::raw::{GlobalForm, LocalForm, RawProblem, check_dimension};
use super::rolling::ROWS;
use std::ops::Range;

/// Reads a problem from the text of a file.
pub(super) fn parse(text: &[u8]) -> Result<RawProblem, Defect> {
    let mut words = Words { text, position: 0 };
    let dimension = words.integer("the dimension of a contact")?;
    if dimension == 2 {
        check_two_dimensional(&mut words)?;
    }
    let each = check_dimension(dimension)?;
    // mu, and mu_r with rolling friction.
    let coefficients = if each == ROWS { 2 } else { 1 };
    let contacts = words.size("the number of contacts")?;
    let size = contacts
        .checked_mul(each)
        .filter(|&size| size <= text.len())
        .ok_or_else(|| words.defect(format!("{contacts} contacts do not fit into this file"), COPY_AGAIN))?;
    let first = matrix(&mut words, "the first matrix")?;
    // A local problem goes on with q and its coefficients alone (some writers add a flag); a global one has a
    // second matrix and more numbers per contact.
    let rest = words.remaining();
    let rolling = |words: &mut Words<'_>| (each == ROWS).then(|| words.vector(contacts, "mu_r")).transpose();
    let problem = if first.rows == size && rest <= (each + coefficients) * contacts + 1 {
        let q = words.vector(size, "q")?;
        let friction = words.vector(contacts, "mu")?;
        let rolling = rolling(&mut words)?;
        RawProblem::Local(LocalForm { w: first, q, friction, rolling, equalities: None })
    } else {
        if !words.peek().is_some_and(is_integer) {
            let what = format!(
                "{} numbers and no second matrix follow a {} x {} matrix: a local problem of {contacts} contacts (line 2) has W \
                 {size} x {size}, {size} numbers q and {contacts} numbers mu",
                words.remaining(),
                first.rows,
                first.columns
            );
            return Err(words.defect(what, "correct the number of contacts, or write the problem again"));
        }
        let h = matrix(&mut words, "H")?;
        let f = words.vector(first.rows, "q")?;
        let w = words.vector(h.columns, "b")?;
        let friction = words.vector(contacts, "mu")?;
        let rolling = rolling(&mut words)?;
        RawProblem::Global(GlobalForm { m: first, h, f, w, friction, rolling, equalities: None })
    };
    if words.remaining() > 1 {
        let what = "more numbers than the problem has".to_string();
        return Err(words.defect(what, "the sizes at the top of the file do not fit its numbers"));
    }
    Ok(problem)
}

/// A file that begins with a 2 is a two-dimensional contact problem only if its matrix has two rows per
/// contact: other problems of Siconos (second-order cone complementarity, SOCLCP) begin with any number.
fn check_two_dimensional(words: &mut Words<'_>) -> Result<(), Defect> {
    let (contacts, storage) = (words.integer("the number of contacts")?, words.integer("a storage")?);
    let rows = words.integer("the number of rows")?;
    if !(0..=2).contains(&storage) || contacts.checked_mul(2) != Some(rows) {
        return Err(Defect::unsupported(
            format!(
                "not even a two-dimensional contact problem in local form (it begins with 2, {contacts}, {storage}, {rows}: a matrix of {rows} rows does not fit \
                 {contacts} contacts of 2 components); a second-order cone problem (SOCLCP)?"
            ),
            "state it as a contact problem with 3 components per contact",
        ));
    }
    Ok(())
}

fn is_integer(word: &[u8]) -> bool {
    std::str::from_utf8(word).is_ok_and(|word| word.parse::<i64>().is_ok())
}

/// Reads a matrix in any storage.
fn matrix(words: &mut Words<'_>, name: &str) -> Result<Matrix, Defect> {
    let storage = words.integer(&format!("the storage of {name}"))?;
    let rows = words.size(&format!("the number of rows of {name}"))?;
    let columns = words.size(&format!("the number of columns of {name}"))?;
    let place = words.place();
    let entries = match storage {
        0 => dense(words, rows, columns, name)?,
        1 => sparse_blocks(words, name)?,
        2 => sparse(words, rows, columns, name)?,
        other => {
            let what =
                format!("{name} has storage {other}, expected 0 (dense), 1 (sparse blocks) or 2 (sparse)");
            return Err(Defect::damaged(place, what, COPY_AGAIN));
        }
    };
    Matrix::new(&format!("{name}, from {place}"), rows, columns, entries)
}

fn dense(words: &mut Words<'_>, rows: usize, columns: usize, name: &str) -> Result<Vec<Entry>, Defect> {
    let again = (words.size("the number of rows")?, words.size("the number of columns")?);
    if again != (rows, columns) {
        let what = format!("{name} is {rows} x {columns} and then {} x {}", again.0, again.1);
        return Err(words.defect(what, COPY_AGAIN));
    }
    block(words, 0..rows, 0..columns, name)
}

/// The entries of some rows and columns, column by column.
fn block(
    words: &mut Words<'_>,
    rows: Range<usize>,
    columns: Range<usize>,
    name: &str,
) -> Result<Vec<Entry>, Defect> {
    // Counted first: where there is no row, any number of columns hold nothing.
    let count = rows.len().checked_mul(columns.len()).filter(|&count| count <= words.text.len());
    let count =
        count.ok_or_else(|| words.defect(format!("{name} does not fit into this file"), COPY_AGAIN))?;
    let place = |k: usize| (rows.start + k % rows.len(), columns.start + k / rows.len());
    (0..count)
        .map(|k| {
            let (row, column) = place(k);
            Ok(Entry { row, column, value: words.number(name)? })
        })
        .collect()
}

fn sparse_blocks(words: &mut Words<'_>, name: &str) -> Result<Vec<Entry>, Defect> {
    let blocks = words.size("the number of blocks")?;
    let block_rows = words.size("the number of block rows")?;
    let block_columns = words.size("the number of block columns")?;
    let row_ends = words.sizes(block_rows, "the cumulated row sizes")?;
    let column_ends = words.sizes(block_columns, "the cumulated column sizes")?;
    let starts = words.size("the number of block row starts")?;
    let indices = words.size("the number of block indices")?;
    let row_start = words.sizes(starts, "the block row starts")?;
    let column = words.sizes(indices, "the block columns")?;
    let consistent = row_ends.windows(2).all(|pair| pair[0] <= pair[1])
        && column_ends.windows(2).all(|pair| pair[0] <= pair[1])
        && starts == block_rows + 1
        && indices == blocks
        && row_start.first() == Some(&0)
        && row_start.last() == Some(&blocks)
        && row_start.windows(2).all(|pair| pair[0] <= pair[1])
        && column.iter().all(|&j| j < block_columns);
    if !consistent {
        let what = format!("the block structure of {name} contradicts itself");
        return Err(words.defect(what, COPY_AGAIN));
    }
    let range = |ends: &[usize], k: usize| if k == 0 { 0..ends[0] } else { ends[k - 1]..ends[k] };
    let mut entries = Vec::new();
    for i in 0..block_rows {
        for k in row_start[i]..row_start[i + 1] {
            let number = words.size("the number of the block")?;
            if number != k {
                let what = format!("{name} has block {number} where block {k} belongs");
                return Err(words.defect(what, COPY_AGAIN));
            }
            entries.extend(block(words, range(&row_ends, i), range(&column_ends, column[k]), name)?);
        }
    }
    Ok(entries)
}

fn sparse(words: &mut Words<'_>, rows: usize, columns: usize, name: &str) -> Result<Vec<Entry>, Defect> {
    words.integer("the origin of the sparse storage")?;
    words.skip_line("CSparse")?;
    let header = words.line();
    let count = header
        .split("nnz:")
        .nth(1)
        .and_then(|rest| rest.split([',', ' ']).find(|word| !word.is_empty()))
        .and_then(|word| word.parse::<usize>().ok());
    let Some(count) = count else {
        let what = format!("expected the size of {name} ('m-by-n, nzmax: .. nnz: ..'), found '{header}'");
        return Err(words.defect(what, COPY_AGAIN));
    };
    if !header.contains(&format!("{rows}-by-{columns}")) {
        let what = format!("{name} is {rows} x {columns}, but its sparse storage says '{header}'");
        return Err(words.defect(what, COPY_AGAIN));
    }
    let mut entries = Vec::new();
    if header.starts_with("triplet") {
        for _ in 0..count {
            let row = words.size(name)?;
            let column = words.size(name)?;
            words.colon(name)?;
            entries.push(Entry { row, column, value: words.number(name)? });
        }
        return Ok(entries);
    }
    // Compressed storage: "col j : locations a to b", then b - a + 1 entries "i : x" ("row" in place of "col"
    // where compressed by rows).
    while entries.len() < count {
        let Some((by_row, major)) = compressed_header(&words.line()) else {
            let what = format!("expected 'col j : locations a to b' in {name}");
            return Err(words.defect(what, COPY_AGAIN));
        };
        while let Some(word) = words.peek().filter(|_| entries.len() < count) {
            if word == b"col" || word == b"row" {
                break;
            }
            let minor = words.size(name)?;
            words.colon(name)?;
            let value = words.number(name)?;
            let (row, column) = if by_row { (major, minor) } else { (minor, major) };
            entries.push(Entry { row, column, value });
        }
        if words.peek().is_none() && entries.len() < count {
            let what = format!("the file ends inside {name}");
            return Err(words.defect(what, COPY_AGAIN));
        }
    }
    // Empty columns at the end still have their line.
    while words.peek().is_some_and(|word| word == b"col" || word == b"row") {
        words.line();
    }
    Ok(entries)
}

/// (compressed by rows, index) of a line `col j : locations a to b`.
fn compressed_header(line: &str) -> Option<(bool, usize)> {
    let mut words = line.split_whitespace();
    let by_row = match words.next()? {
        "col" => false,
        "row" => true,
        _ => return None,
    };
    Some((by_row, words.next()?.parse().ok()?))
}

/// The words of a text, with the line each stands on.
struct Words<'a> {
    text: &'a [u8],
    position: usize,
}

impl<'a> Words<'a> {
    fn place(&self) -> String {
        let read = &self.text[..self.position.min(self.text.len())];
        format!("line {}", 1 + read.iter().filter(|&&byte| byte == b'\n').count())
    }

    fn defect(&self, what: String, remedy: &'static str) -> Defect {
        Defect::damaged(self.place(), what, remedy)
    }

    fn skip_space(&mut self) {
        while self.text.get(self.position).is_some_and(u8::is_ascii_whitespace) {
            self.position += 1;
        }
    }

    /// The next word, left in place.
    fn peek(&mut self) -> Option<&'a [u8]> {
        self.skip_space();
        let rest = &self.text[self.position..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        (length > 0).then(|| &rest[..length])
    }

    /// The next word, read.
    fn word(&mut self, what: &str) -> Result<&'a str, Defect> {
        let Some(word) = self.peek() else {
            return Err(self.defect(format!("the file ends where {what} is expected"), COPY_AGAIN));
        };
        let Ok(text) = std::str::from_utf8(word) else {
            return Err(self.defect(
                format!("bytes that are no text where {what} is expected"),
                "this is neither an HDF5 file nor a text problem of Siconos",
            ));
        };
        self.position += word.len();
        Ok(text)
    }

    fn parse<T: std::str::FromStr>(&mut self, what: &str, kind: &str) -> Result<T, Defect> {
        let word = self.word(what)?;
        word.parse().map_err(|_| {
            let shown: String = word.chars().take(40).collect();
            self.defect(format!("expected {what} ({kind}), found '{shown}'"), COPY_AGAIN)
        })
    }

    fn integer(&mut self, what: &str) -> Result<i64, Defect> {
        self.parse(what, "an integer")
    }

    fn size(&mut self, what: &str) -> Result<usize, Defect> {
        self.parse(what, "an integer that is not negative")
    }

    fn number(&mut self, what: &str) -> Result<f64, Defect> {
        let value: f64 = self.parse(what, "a number")?;
        if value.is_finite() {
            return Ok(value);
        }
        Err(self.defect(format!("{what} contains {value}"), super::error::WRITE_AGAIN))
    }

    fn sizes(&mut self, count: usize, what: &str) -> Result<Vec<usize>, Defect> {
        // Not sized in advance: the count comes from the file.
        (0..count).map(|_| self.size(what)).collect()
    }

    fn vector(&mut self, count: usize, what: &str) -> Result<Vec<f64>, Defect> {
        (0..count).map(|_| self.number(what)).collect()
    }

    fn colon(&mut self, what: &str) -> Result<(), Defect> {
        match self.word(what)? {
            ":" => Ok(()),
            other => {
                let shown: String = other.chars().take(40).collect();
                Err(self.defect(format!("expected ':' in {what}, found '{shown}'"), COPY_AGAIN))
            }
        }
    }

    /// The rest of the line that holds the next word.
    fn line(&mut self) -> String {
        self.skip_space();
        let rest = &self.text[self.position..];
        let length = rest.iter().position(|&byte| byte == b'\n').unwrap_or(rest.len());
        self.position += length;
        String::from_utf8_lossy(&rest[..length]).trim_end().to_string()
    }

    /// Skips a line that must start with a word.
    fn skip_line(&mut self, start: &str) -> Result<(), Defect> {
        let line = self.line();
        if line.starts_with(start) {
            return Ok(());
        }
        let shown: String = line.chars().take(40).collect();
        Err(self.defect(format!("expected a line that starts with '{start}', found '{shown}'"), COPY_AGAIN))
    }

    /// Number of words that are left.
    fn remaining(&self) -> usize {
        let rest = &self.text[self.position.min(self.text.len())..];
        rest.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).count()
    }
}

#[cfg(test)]
mod tests {
    /// Sizes that a file claims cost no time where nothing stands behind them.
    #[test]
    fn matrices_without_rows_may_claim_any_columns() {
        let dense = "3\n0\n0\n0\n99999999999999\n0 99999999999999\n";
        let blocks = "3\n1\n1\n3\n3\n1\n1\n1\n0\n99999999999999\n2\n1\n0 1\n0\n0\n";
        let endless = "3\n1\n0\n3\n9999999999999999999\n3 9999999999999999999\n1 2\n";
        for text in [dense, blocks, endless] {
            assert!(crate::problem_file::parse(text.as_bytes().to_vec()).is_err(), "{text}");
        }
    }
}
