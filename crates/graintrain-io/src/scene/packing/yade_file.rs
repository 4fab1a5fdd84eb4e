//! Spheres as YADE's `export.text`, `export.textExt` write them: blanks between x, y, z, radius and more, a
//! line `#format` that names the columns.
//!
//! Source: yade-dem.org, module `yade.export`.

use super::text::{Columns, number, row, text, vector};
use super::{FileContent, FileProblem};

/// Reads the spheres.
pub(super) fn read(bytes: &[u8]) -> Result<FileContent, FileProblem> {
    let mut columns = Columns(vec!["x", "y", "z", "r"]);
    let mut content = FileContent::default();
    let mut radii = Vec::new();
    for (line, text) in (1..).zip(text(bytes)?.lines().map(str::trim)) {
        if let Some(comment) = text.strip_prefix('#') {
            if let Some(format) = comment.trim().strip_prefix("format") {
                columns = Columns(format.trim().split('_').collect());
            }
            continue;
        }
        if text.is_empty() {
            continue;
        }
        let place =
            columns.vector(&[["x", "y", "z"]]).ok_or_else(|| columns.missing("columns x, y, z", line))?;
        let words = row(text, place.into_iter().max().unwrap_or(0) + 1, line)?;
        content.position.push(vector(&words, place, line)?);
        if let Some(k) = columns.find(&["r"]) {
            let words = row(text, k + 1, line)?;
            radii.push(number(words[k], line)?);
        }
    }
    if content.position.is_empty() {
        return Err(FileProblem::new("it holds no spheres"));
    }
    content.radius = (radii.len() == content.position.len()).then_some(radii);
    Ok(content)
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain::math::Vec3;

    #[test]
    fn the_format_line_names_the_columns() {
        let content = read(b"#format x_y_z_r\n# text\n1\t2\t3\t0.5\n\n4 5 6 0.25\n").unwrap();
        assert_eq!(content.position[1], Vec3::new(4.0, 5.0, 6.0));
        assert_eq!(content.radius.unwrap(), [0.5, 0.25]);
        let named = read(b"#format id_x_y_z_matId_r\n7 1 2 3 0 0.5\n").unwrap();
        assert_eq!((named.position[0], named.radius.unwrap()[0]), (Vec3::new(1.0, 2.0, 3.0), 0.5));
        assert_eq!(read(b"1 2 3 0.5\n1 2\n").unwrap_err().line, Some(2));
        assert_eq!(read(b"1 2 3 x\n").unwrap_err().line, Some(1));
        assert!(read(b"#format x_y_z_r\n").unwrap_err().problem.contains("no spheres"));
    }
}
