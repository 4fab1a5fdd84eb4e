//! Extended XYZ: a count, a comment line with `Properties=name:type:columns:...`, and a line per particle,
//! frame after frame.
//!
//! Source: libatoms' specification of extended XYZ (github.com/libAtoms/extxyz). Names of properties as OVITO
//! writes them.

use super::text::{Columns, count, ended_text, number, row, vector};
use super::{FileContent, FileProblem};

/// Reads a frame, counted from 0; the last one where it is `None`.
pub(super) fn read(bytes: &[u8], frame: Option<u64>) -> Result<FileContent, FileProblem> {
    let mut lines = (1..).zip(ended_text(bytes)?.lines()).peekable();
    let mut found = None;
    let mut frames = 0_u64;
    while let Some((line, first)) = lines.next() {
        if first.trim().is_empty() {
            continue;
        }
        let particles = count(Some(first.trim()), line)?;
        let Some((comment_line, comment)) = lines.next() else {
            return Err(FileProblem::at(line, "it ends where the comment line is expected"));
        };
        let names = columns(comment, comment_line)?;
        let columns = Columns(names.iter().map(String::as_str).collect());
        let coordinates = |name: &str| [0, 1, 2].map(|k| format!("{name}:{k}"));
        let triple = |name: &str| {
            let [x, y, z] = coordinates(name);
            columns.vector(&[[&x, &y, &z]])
        };
        let place = triple("pos").ok_or_else(|| columns.missing("property `pos:R:3`", comment_line))?;
        let velocity = ["velo", "vel", "velocity", "velocities"].into_iter().find_map(triple);
        let radius = columns.find(&["radius:0"]).map(|k| (k, 1.0));
        let radius = radius.or_else(|| columns.find(&["diameter:0"]).map(|k| (k, 0.5)));
        let is_wanted = frame.is_none_or(|frame| frame == frames);
        let mut content = FileContent::default();
        let (mut radii, mut velocities) = (Vec::new(), Vec::new());
        for made in 0..particles {
            let Some((line, text)) = lines.next() else {
                return Err(FileProblem::at(line, format!("it ends after {made} of {particles} particles")));
            };
            if !is_wanted {
                continue;
            }
            let words = row(text, columns.0.len(), line)?;
            content.position.push(vector(&words, place, line)?);
            if let Some((k, factor)) = radius {
                radii.push(factor * number(words[k], line)?);
            }
            if let Some(columns) = velocity {
                velocities.push(vector(&words, columns, line)?);
            }
        }
        content.radius = radius.map(|_| radii);
        content.velocity = velocity.map(|_| velocities);
        if is_wanted {
            found = Some(content);
        }
        frames += 1;
    }
    found.ok_or_else(|| FileProblem::no_frame(frame, frames, "it is empty"))
}

/// Most columns of a property; more are a slip.
const MOST_COLUMNS: usize = 1_000;

/// Names of the columns, `pos:0`, `pos:1` and so on; those of plain XYZ where the comment names none.
fn columns(comment: &str, line: usize) -> Result<Vec<String>, FileProblem> {
    let key = comment.split_whitespace().find_map(|word| word.strip_prefix("Properties="));
    let Some(properties) = key else {
        return Ok(["species:0", "pos:0", "pos:1", "pos:2"].map(str::to_string).to_vec());
    };
    let words: Vec<&str> = properties.trim_matches('"').split(':').collect();
    let mut names = Vec::new();
    for triple in words.chunks(3) {
        let columns = triple.get(2).and_then(|word| word.parse::<usize>().ok());
        match columns.filter(|columns| *columns <= MOST_COLUMNS && names.len() <= MOST_COLUMNS) {
            Some(columns) => names.extend((0..columns).map(|k| format!("{}:{k}", triple[0]))),
            None => {
                let problem = format!(
                    "`Properties` has to name columns as name:type:number, not `{}`",
                    super::table_file::shorten(&triple.join(":"))
                );
                return Err(FileProblem::at(line, problem));
            }
        }
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain::math::Vec3;

    #[test]
    fn properties_choose_the_columns() {
        let text = "1\nplain\nC 1 2 3\n2\nLattice=\"1 0 0 0 1 0 0 0 1\" Properties=id:I:1:radius:R:1:pos:R:3:velo:R:3 Time=0.5\n\
                    1 0.5 1 2 3 4 5 6\n2 0.25 0 0 0 1 0 0\n";
        let last = read(text.as_bytes(), None).unwrap();
        assert_eq!(last.position[0], Vec3::new(1.0, 2.0, 3.0));
        assert_eq!(last.radius.unwrap(), [0.5, 0.25]);
        assert_eq!(last.velocity.unwrap()[1], Vec3::X);
        let first = read(text.as_bytes(), Some(0)).unwrap();
        assert_eq!((first.position, first.radius), (vec![Vec3::new(1.0, 2.0, 3.0)], None));
        let problem = |text: &str| {
            let error = read(text.as_bytes(), None).unwrap_err();
            (error.line, error.problem)
        };
        assert_eq!(problem(&format!("{}\n", &text[..text.len() - 12])).0, Some(7));
        assert!(problem(&text[..text.len() - 1]).1.contains("cut short"));
        assert_eq!(problem(&text.replace("velo:R:3", "velo:R")).0, Some(5));
        assert_eq!(problem(&text.replace("pos:R:3", "pot:R:3")).0, Some(5));
        assert_eq!(problem("many\n\n").0, Some(1));
        assert!(problem("").1.contains("empty"));
    }
}
