//! Text dumps of LAMMPS (`dump custom`) and LIGGGHTS, frame after frame.
//!
//! Source: docs.lammps.org/dump.html; the columns are named in the line `ITEM: ATOMS`.

use super::text::{Columns, count, ended_text, number, row, vector};
use super::{FileContent, FileProblem};
use graintrain::math::Vec3;

/// Reads a frame, counted from 0; the last one where it is `None`. Every frame is looked through, so that a
/// file that was cut short is reported wherever that was.
pub(super) fn read(bytes: &[u8], frame: Option<u64>) -> Result<FileContent, FileProblem> {
    let mut lines = (1..).zip(ended_text(bytes)?.lines());
    let mut found = None;
    let (mut frames, mut atoms) = (0_u64, None);
    // Corner and edges of the box, where it is a plain one.
    let mut bounds: Option<(Vec3, Vec3)> = None;
    while let Some((line, text)) = lines.next() {
        let Some(item) = text.trim().strip_prefix("ITEM:").map(str::trim) else {
            if text.trim().is_empty() {
                continue;
            }
            return Err(FileProblem::at(line, "expected a line that begins with `ITEM:`"));
        };
        let mut next = |what: &str| {
            lines.next().ok_or_else(|| FileProblem::at(line, format!("it ends where {what} is expected")))
        };
        if item.starts_with("NUMBER OF ATOMS") {
            let (line, text) = next("the number of atoms")?;
            atoms = Some(count(text.split_whitespace().next(), line)?);
        } else if let Some(tags) = item.strip_prefix("BOX BOUNDS") {
            let mut corners = [[0.0; 2]; 3];
            for corner in &mut corners {
                let (line, text) = next("the box")?;
                let words = row(text, 2, line)?;
                *corner = [number(words[0], line)?, number(words[1], line)?];
            }
            let at = |k: usize| Vec3::new(corners[0][k], corners[1][k], corners[2][k]);
            bounds = (!tags.contains("xy") && !tags.contains("abc")).then(|| (at(0), at(1) - at(0)));
        } else if let Some(names) = item.strip_prefix("ATOMS") {
            let columns = Columns(names.split_whitespace().collect());
            let atoms = atoms
                .take()
                .ok_or_else(|| FileProblem::at(line, "no `ITEM: NUMBER OF ATOMS` comes before"))?;
            let is_wanted = frame.is_none_or(|frame| frame == frames);
            let content = read_atoms(&mut lines, &columns, atoms, line, bounds, is_wanted)?;
            if is_wanted {
                found = Some(content);
            }
            frames += 1;
        } else if item.starts_with("TIMESTEP") || item.starts_with("TIME") || item.starts_with("UNITS") {
            next("a value")?;
        } else {
            return Err(FileProblem::at(
                line,
                format!("unknown item `{}`", super::table_file::shorten(item)),
            ));
        }
    }
    let without = "it holds no line `ITEM: ATOMS`: it is no dump of LAMMPS or LIGGGHTS";
    found.ok_or_else(|| FileProblem::no_frame(frame, frames, without))
}

/// The atoms of a frame; only looked through where they are not wanted.
fn read_atoms<'a>(
    lines: &mut impl Iterator<Item = (usize, &'a str)>,
    columns: &Columns<'_>,
    atoms: usize,
    header: usize,
    bounds: Option<(Vec3, Vec3)>,
    is_wanted: bool,
) -> Result<FileContent, FileProblem> {
    let plain = columns.vector(&[["xu", "yu", "zu"], ["x", "y", "z"]]);
    let scaled = columns.vector(&[["xs", "ys", "zs"]]);
    let [place, velocity] = [plain.or(scaled), columns.vector(&[["vx", "vy", "vz"]])];
    let place = place.ok_or_else(|| columns.missing("columns x y z (or xu yu zu, xs ys zs)", header))?;
    let radius = columns.find(&["radius", "c_radius"]).map(|k| (k, 1.0));
    let radius = radius.or_else(|| columns.find(&["diameter", "c_diameter"]).map(|k| (k, 0.5)));
    let mut content = FileContent::default();
    let (mut radii, mut velocities) = (Vec::new(), Vec::new());
    for made in 0..atoms {
        let Some((line, text)) = lines.next() else {
            return Err(FileProblem::at(header, format!("it ends after {made} of {atoms} atoms")));
        };
        if text.starts_with("ITEM:") {
            return Err(FileProblem::at(line, format!("a new item after {made} of {atoms} atoms")));
        }
        if !is_wanted {
            continue;
        }
        let words = row(text, columns.0.len(), line)?;
        let mut position = vector(&words, place, line)?;
        if plain.is_none() {
            let Some((corner, edges)) = bounds else {
                let problem =
                    "scaled coordinates (xs ys zs) need a box with right angles: dump x y z instead";
                return Err(FileProblem::at(header, problem));
            };
            position = corner + edges * position;
        }
        content.position.push(position);
        if let Some((k, factor)) = radius {
            radii.push(factor * number(words[k], line)?);
        }
        if let Some(columns) = velocity {
            velocities.push(vector(&words, columns, line)?);
        }
    }
    content.radius = radius.map(|_| radii);
    content.velocity = velocity.map(|_| velocities);
    Ok(content)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DUMP: &str = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS ff ff ff\n0 1\n0 2\n0 4\nITEM: ATOMS id type x y z \
                        radius\n1 1 0.1 0.2 0.3 0.05\nITEM: UNITS\nsi\nITEM: TIME\n0.5\nITEM: TIMESTEP\n9\nITEM: NUMBER OF \
                        ATOMS\n2\nITEM: BOX BOUNDS pp ff ff\n1 2\n0 2\n0 4\nITEM: ATOMS id xs ys zs vx vy vz diameter\n2 0.5 0.25 \
                        0.5 1 2 3 0.4\n7 0 0 0 0 0 0 0.2\n";

    #[test]
    fn frames_units_and_scaled_coordinates() {
        let last = read(DUMP.as_bytes(), None).unwrap();
        assert_eq!(last.position, [Vec3::new(1.5, 0.5, 2.0), Vec3::new(1.0, 0.0, 0.0)]);
        assert_eq!(last.radius.unwrap(), [0.2, 0.1]);
        assert_eq!(last.velocity.unwrap()[0], Vec3::new(1.0, 2.0, 3.0));
        let first = read(DUMP.as_bytes(), Some(0)).unwrap();
        assert_eq!((first.radius.unwrap(), first.velocity), (vec![0.05], None));
    }

    #[test]
    fn defects_name_the_line() {
        let problem = |text: &str, frame| {
            let error = read(text.as_bytes(), frame).unwrap_err();
            (error.line, error.problem)
        };
        assert!(problem(DUMP, Some(2)).1.contains("no frame 2"));
        let short = format!("{}\n", &DUMP[..DUMP.len() - 25]);
        assert_eq!(problem(&short, None).0, Some(24));
        assert_eq!(
            problem(&DUMP.replace("0.2 0.3", "0.2 z"), Some(0)),
            (Some(10), "`z` is not a number".into())
        );
        // Cut within the last number, which is a number still.
        let cut = problem(&DUMP.replace("0 0.2\n", "0 0.2345\n")[..DUMP.len() + 1], None);
        assert!(cut.0 == Some(25) && cut.1.contains("cut short"), "{cut:?}");
        assert!(problem("x y z\n1 2 3\n", None).1.contains("ITEM:"));
        assert!(
            problem(&DUMP.replace("\n2\nITEM", "\n99999999999\nITEM"), None).1.contains("2 of 99999999999")
        );
        assert!(problem("ITEM: TIMESTEP\n1\n", None).1.contains("no dump"));
    }
}
