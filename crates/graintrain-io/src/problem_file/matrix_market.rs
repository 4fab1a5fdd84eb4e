//! Problems as MatrixMarket files side by side: `W.mtx`, `q.mtx` and `mu.mtx` (u = W r + q), or `M.mtx`,
//! `H.mtx`, `f.mtx`, `w.mtx` and `mu.mtx` (M v = H r + f, u = H^T v + w), each with the same text around the
//! letter: `pile_W.mtx`, `pile_q.mtx`.
//!
//! Source: math.nist.gov/MatrixMarket/formats.html.

use super::error::{Defect, WRITE_AGAIN};
use super::matrix::{Entry, Matrix};
use super::raw::{GlobalForm, LocalForm, RawProblem};
use std::path::Path;

/// Whether these are the bytes of such a file.
pub(super) fn is_matrix_market(bytes: &[u8]) -> bool {
    bytes.starts_with(b"%%MatrixMarket")
}

/// Reads the problem of which `path` is a matrix.
pub(super) fn parse(path: &Path) -> Result<RawProblem, Defect> {
    let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    let Some((before, letter)) =
        ["W", "M", "H"].iter().find_map(|letter| Some((stem.strip_suffix(letter)?, *letter)))
    else {
        return Err(Defect::unsupported(
            format!(
                "a MatrixMarket file named `{stem}`: it holds one matrix, and a problem has several parts"
            ),
            "name its files W.mtx, q.mtx and mu.mtx (or M, H, f, w and mu) and give the one of W or M",
        ));
    };
    let file = |part: &str| path.with_file_name(format!("{before}{part}.mtx"));
    let whole = |part: &str| whole(&file(part));
    let vector = |part: &str, length: usize| vector(&file(part), length);
    Ok(match letter {
        "W" => {
            let w = whole("W")?;
            let (q, friction) = (vector("q", w.columns)?, vector("mu", w.columns / 3)?);
            RawProblem::Local(LocalForm { w, q, friction, rolling: None, equalities: None })
        }
        _ => {
            let (m, h) = (whole("M")?, whole("H")?);
            let (f, w) = (vector("f", m.columns)?, vector("w", h.columns)?);
            let friction = vector("mu", h.columns / 3)?;
            RawProblem::Global(GlobalForm { m, h, f, w, friction, rolling: None, equalities: None })
        }
    })
}

/// A matrix that has something in each of its columns, so that its file bounds their number.
fn whole(path: &Path) -> Result<Matrix, Defect> {
    let (name, text) = read(path)?;
    let matrix = matrix(&name, &text)?;
    if matrix.columns > text.len() {
        let what = format!("{} columns do not fit into {} bytes", matrix.columns, text.len());
        return Err(Defect::damaged(name, what, WRITE_AGAIN));
    }
    Ok(matrix)
}

/// A matrix of one column or row that has to have so many numbers.
fn vector(path: &Path, length: usize) -> Result<Vec<f64>, Defect> {
    let (name, text) = read(path)?;
    let matrix = matrix(&name, &text)?;
    let found = matrix.rows.max(matrix.columns);
    if found != length {
        return Err(Defect::damaged(name, format!("{found} numbers, expected {length}"), WRITE_AGAIN));
    }
    let mut values = vec![0.0; length];
    matrix.entries.iter().for_each(|entry| values[entry.row.max(entry.column)] = entry.value);
    Ok(values)
}

/// Name and bytes of a file.
fn read(path: &Path) -> Result<(String, Vec<u8>), Defect> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let text = std::fs::read(path).map_err(|error| Defect::damaged(&name, error.to_string(), WRITE_AGAIN))?;
    Ok((name, text))
}

/// Most rows, columns and entries; a header may claim any number.
const MOST: usize = 1 << 26;

fn matrix(name: &str, bytes: &[u8]) -> Result<Matrix, Defect> {
    let at = |line: usize, what: String| Defect::damaged(format!("{name}, line {line}"), what, WRITE_AGAIN);
    let text = std::str::from_utf8(bytes).map_err(|_| at(1, "it is not a text".into()))?;
    let mut lines = (1..).zip(text.lines());
    let banner = lines.next().map_or("", |(_, line)| line).to_lowercase();
    let words: Vec<&str> = banner.split_whitespace().collect();
    let (is_array, is_symmetric) = match words.as_slice() {
        [
            "%%matrixmarket",
            "matrix",
            form @ ("coordinate" | "array"),
            "real" | "integer" | "double",
            symmetry,
        ] => match *symmetry {
            "general" | "symmetric" => (*form == "array", *symmetry == "symmetric"),
            other => {
                let what = format!("{name} is {other}");
                return Err(Defect::unsupported(what, "write it as general or symmetric"));
            }
        },
        _ => {
            let what = format!("{name} begins with `{}`", banner.chars().take(60).collect::<String>());
            return Err(Defect::unsupported(
                what,
                "expected %%MatrixMarket matrix coordinate|array real ...",
            ));
        }
    };
    let mut rows = lines.filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('%'));
    let (line, sizes) = rows.next().ok_or_else(|| at(1, "it has no sizes".into()))?;
    let sizes: Option<Vec<usize>> = sizes.split_whitespace().map(|word| word.parse().ok()).collect();
    let (m, n, count) = match (sizes.as_deref(), is_array) {
        (Some(&[m, n]), true) if !is_symmetric => (m, n, m.checked_mul(n)),
        (Some(&[m, n]), true) if m == n => {
            (m, n, m.checked_add(1).and_then(|next| m.checked_mul(next)).map(|twice| twice / 2))
        }
        (Some(&[m, n, count]), false) => (m, n, Some(count)),
        _ => return Err(at(line, "its sizes do not fit its first line".into())),
    };
    let count = count
        .filter(|count| *count <= MOST && m.max(n) <= MOST)
        .ok_or_else(|| at(line, "it claims to be too large".into()))?;
    let mut entries = Vec::new();
    let (mut row, mut column) = (0, 0);
    for made in 0..count {
        let (number, text) =
            rows.next().ok_or_else(|| at(line, format!("it ends after {made} of {count} entries")))?;
        let words: Vec<&str> = text.split_whitespace().collect();
        let value = words.last().and_then(|word| word.parse::<f64>().ok());
        let value = value.ok_or_else(|| {
            at(number, format!("`{}` is no entry", text.chars().take(40).collect::<String>()))
        })?;
        let (i, j) = if is_array {
            let place = (row, column);
            row += 1;
            if row == m {
                column += 1;
                row = if is_symmetric { column } else { 0 };
            }
            place
        } else {
            let index = |k: usize| words.get(k).and_then(|word| word.parse::<usize>().ok()?.checked_sub(1));
            match (index(0), index(1)) {
                (Some(i), Some(j)) if words.len() == 3 && i < m && j < n => (i, j),
                _ => return Err(at(number, format!("it is no entry of a {m} x {n} matrix"))),
            }
        };
        entries.push(Entry { row: i, column: j, value });
        if is_symmetric && i != j {
            entries.push(Entry { row: j, column: i, value });
        }
    }
    Matrix::new(name, m, n, entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claims_of_any_size_are_refused_before_memory_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let all = "18446744073709551615";
        let cases = [
            (format!("array real symmetric\n{all} {all}\n"), "too large"),
            (format!("coordinate real general\n{all} {all} 0\n"), "too large"),
            (
                "coordinate real general\n67108864 67108864 0\n".to_string(),
                "67108864 columns do not fit into",
            ),
        ];
        for (text, expected) in cases {
            let path = folder.path().join("W.mtx");
            std::fs::write(&path, format!("%%MatrixMarket matrix {text}")).unwrap();
            let error = parse(&path).unwrap_err().in_file(&path).to_string();
            assert!(error.contains(expected), "{error}");
        }
        let path = folder.path().join("q.mtx");
        std::fs::write(&path, "%%MatrixMarket matrix coordinate real general\n67108864 1 0\n").unwrap();
        let error = vector(&path, 3).unwrap_err().in_file(&path).to_string();
        assert!(error.contains("67108864 numbers, expected 3"), "{error}");
    }
}
