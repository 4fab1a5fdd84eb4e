//! What the readers of other programs' text files share.

use super::FileProblem;
use super::table_file::shorten;
use graintrain::math::Vec3;

/// The text of a file.
pub(super) fn text(bytes: &[u8]) -> Result<&str, FileProblem> {
    let text = std::str::from_utf8(bytes)
        .map_err(|_| FileProblem::new("it is not a text file: save it as UTF-8"))?;
    Ok(text.trim_start_matches('\u{feff}'))
}

/// The text of a file that programs write, which end its last line, too: without that the last number may
/// have lost digits.
pub(super) fn ended_text(bytes: &[u8]) -> Result<&str, FileProblem> {
    let text = text(bytes)?;
    if text.is_empty() || text.ends_with('\n') {
        return Ok(text);
    }
    let problem = "the file ends within this line, so that its last number may be cut short: fetch it again, or end the line if it is whole";
    Err(FileProblem::at(text.lines().count(), problem))
}

/// A number at a line, counted from 1.
pub(super) fn number(word: &str, line: usize) -> Result<f64, FileProblem> {
    word.parse().map_err(|_| FileProblem::at(line, format!("`{}` is not a number", shorten(word))))
}

/// A count at a line.
pub(super) fn count(word: Option<&str>, line: usize) -> Result<usize, FileProblem> {
    let word = word.unwrap_or_default();
    word.parse()
        .map_err(|_| FileProblem::at(line, format!("`{}` is not a number of particles", shorten(word))))
}

/// Where the named columns of a table are.
pub(super) struct Columns<'a>(pub Vec<&'a str>);

impl Columns<'_> {
    /// The first of these columns that is there.
    pub fn find(&self, names: &[&str]) -> Option<usize> {
        names.iter().find_map(|name| self.0.iter().position(|known| known.eq_ignore_ascii_case(name)))
    }

    /// Three columns for the coordinates of a vector, the first triple of which all are there.
    pub fn vector(&self, triples: &[[&str; 3]]) -> Option<[usize; 3]> {
        triples.iter().find_map(|[x, y, z]| Some([self.find(&[x])?, self.find(&[y])?, self.find(&[z])?]))
    }

    /// An error that names the columns that are there.
    pub fn missing(&self, what: &str, line: usize) -> FileProblem {
        FileProblem::at(line, format!("it has no {what}; its columns are {}", shorten(&self.0.join(" "))))
    }
}

/// The words of a row, which has to have as many as there are columns.
pub(super) fn row(text: &str, columns: usize, line: usize) -> Result<Vec<&str>, FileProblem> {
    let words: Vec<&str> = text.split_whitespace().collect();
    if words.len() < columns {
        let problem = format!("{} values where there are {columns} columns", words.len());
        return Err(FileProblem::at(line, problem));
    }
    Ok(words)
}

/// The vector in three columns of a row.
pub(super) fn vector(words: &[&str], [x, y, z]: [usize; 3], line: usize) -> Result<Vec3, FileProblem> {
    Ok(Vec3::new(number(words[x], line)?, number(words[y], line)?, number(words[z], line)?))
}
