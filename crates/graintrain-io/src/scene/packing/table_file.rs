//! Tables of numbers with a header line that names the columns, with units in brackets:
//! `Radius[m] PosX[mm] ...`.

use super::{FileContent, FileProblem};
use crate::scene::expression::{NoNames, evaluate};
use crate::scene::quantity::{Dimension, Quantity};
use graintrain::math::Vec3;

/// A table: names of the columns with their units, and rows of numbers.
pub(crate) struct NumberTable {
    /// Name without unit, lower case, and the factor to SI units where the header names a unit.
    pub columns: Vec<(String, Option<Quantity>)>,
    /// Rows as long as `columns`.
    pub rows: Vec<Vec<f64>>,
    /// Line of the header, counted from 1.
    pub header_line: usize,
}

/// Reads a table whose columns are separated by `separator`, or by blanks where it is `None`. Empty lines do
/// not count; a header may start with `#`; the last `skip_last` lines are left out.
pub(crate) fn read(
    bytes: &[u8],
    separator: Option<char>,
    skip_last: usize,
) -> Result<NumberTable, FileProblem> {
    let text = std::str::from_utf8(bytes)
        .map_err(|_| FileProblem::new("it is not a text file: save it as UTF-8"))?;
    let mut lines: Vec<(usize, &str)> = text
        .trim_start_matches('\u{feff}')
        .lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty())
        .collect();
    if lines.is_empty() {
        return Err(FileProblem::new("it is empty"));
    }
    let (header_line, header) = lines.remove(0);
    let columns = split(header.trim_start_matches('#'), separator)
        .into_iter()
        .map(|name| column(name).map_err(|problem| FileProblem::at(header_line, problem)))
        .collect::<Result<Vec<_>, _>>()?;
    lines.truncate(lines.len().saturating_sub(skip_last));
    let rows = lines
        .into_iter()
        .map(|(line, text)| {
            let words = split(text, separator);
            if words.len() != columns.len() {
                let problem = format!(
                    "{} values where the header names {} columns (leave lines at the end out with `skip_last`)",
                    words.len(),
                    columns.len()
                );
                return Err(FileProblem::at(line, problem));
            }
            words
                .into_iter()
                .map(|word| {
                    word.parse::<f64>()
                        .map_err(|_| FileProblem::at(line, format!("`{}` is not a number", shorten(word))))
                })
                .collect()
        })
        .collect::<Result<Vec<Vec<f64>>, _>>()?;
    Ok(NumberTable { columns, rows, header_line })
}

pub(super) fn shorten(word: &str) -> String {
    if word.chars().count() > 40 {
        word.chars().take(40).chain(['.', '.', '.']).collect()
    } else {
        word.into()
    }
}

fn split(line: &str, separator: Option<char>) -> Vec<&str> {
    match separator {
        Some(separator) => line.split(separator).map(|word| word.trim().trim_matches('"')).collect(),
        None => line.split_whitespace().collect(),
    }
}

/// `PosX[mm]` is the column `posx` with the factor 0.001 m.
fn column(name: &str) -> Result<(String, Option<Quantity>), String> {
    let Some((name, rest)) = name.split_once('[') else { return Ok((name.to_lowercase(), None)) };
    let unit =
        rest.strip_suffix(']').ok_or_else(|| format!("the bracket of `{name}[{rest}` is not closed"))?;
    let unit = match unit.trim() {
        "" | "-" => Quantity::number(1.0),
        unit => {
            evaluate(unit, &NoNames).map_err(|error| format!("unit of column `{name}`: {}", error.problem))?
        }
    };
    Ok((name.trim().to_lowercase(), Some(unit)))
}

impl NumberTable {
    /// The first column with one of these names, in SI units; a column without unit is taken to be SI.
    pub fn column(&self, names: &[&str], dimension: Dimension) -> Result<Option<Vec<f64>>, FileProblem> {
        let found = self.columns.iter().position(|(name, _)| names.contains(&name.as_str()));
        let Some(index) = found else { return Ok(None) };
        let (name, unit) = &self.columns[index];
        let factor = match unit {
            None => 1.0,
            Some(unit) if unit.dimension == dimension || unit.dimension == Dimension::NONE => unit.value,
            Some(unit) => {
                let problem = format!("column `{name}` must be {dimension}, its unit is {}", unit.dimension);
                return Err(FileProblem::at(self.header_line, problem));
            }
        };
        Ok(Some(self.rows.iter().map(|row| row[index] * factor).collect()))
    }
}

const X: &[&str] = &["x", "posx", "pos_x", "position_x", "points:0", "points_0", "px"];
const Y: &[&str] = &["y", "posy", "pos_y", "position_y", "points:1", "points_1", "py"];
const Z: &[&str] = &["z", "posz", "pos_z", "position_z", "points:2", "points_2", "pz"];
const RADIUS: &[&str] = &["radius", "r", "rad"];
const DIAMETER: &[&str] = &["diameter", "d"];
const VX: &[&str] = &["vx", "velx", "velocity_x", "velocity:0", "velocity_0", "v:0", "v_0"];
const VY: &[&str] = &["vy", "vely", "velocity_y", "velocity:1", "velocity_1", "v:1", "v_1"];
const VZ: &[&str] = &["vz", "velz", "velocity_z", "velocity:2", "velocity_2", "v:2", "v_2"];

/// Reads a table of spheres: columns x, y, z, and radius or diameter; velocities if there.
pub(crate) fn read_spheres(
    bytes: &[u8],
    separator: Option<char>,
    skip_last: usize,
) -> Result<FileContent, FileProblem> {
    let table = read(bytes, separator, skip_last)?;
    let vectors = |names: [&[&str]; 3], dimension| -> Result<Option<Vec<Vec3>>, FileProblem> {
        let [x, y, z] = names.map(|names| table.column(names, dimension));
        Ok(match (x?, y?, z?) {
            (Some(x), Some(y), Some(z)) => {
                Some(x.into_iter().zip(y).zip(z).map(|((x, y), z)| Vec3::new(x, y, z)).collect())
            }
            _ => None,
        })
    };
    let position = vectors([X, Y, Z], Dimension::LENGTH)?.ok_or_else(|| {
        let names: Vec<&str> = table.columns.iter().map(|(name, _)| name.as_str()).collect();
        let problem = format!(
            "the header must name the columns x, y, z and radius (or posx ..., diameter), got {}",
            shorten(&names.join(", "))
        );
        FileProblem::at(table.header_line, problem)
    })?;
    let radius = match table.column(RADIUS, Dimension::LENGTH)? {
        Some(radius) => Some(radius),
        None => table
            .column(DIAMETER, Dimension::LENGTH)?
            .map(|list| list.into_iter().map(|diameter| 0.5 * diameter).collect()),
    };
    Ok(FileContent { position, radius, velocity: vectors([VX, VY, VZ], Dimension::SPEED)? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_in_brackets_are_applied() {
        let text = "Radius[mm]\tPosX[m] PosY[cm] PosZ[m]\r\n 2 1 1 1\r\n\r\n5 0.01 0.01 0 0 0.06\r\n";
        let content = read_spheres(text.as_bytes(), None, 1).unwrap();
        assert_eq!(content.position, [Vec3::new(1.0, 0.01, 1.0)]);
        assert_eq!(content.radius.unwrap(), [0.002]);
        assert_eq!(content.velocity, None);
    }

    #[test]
    fn csv_with_diameter_and_velocity() {
        let text = "# id,X,y,z,\"Diameter\",vx,vy,vz\n7,1,2,3,4,5,6,7\n";
        let content = read_spheres(text.as_bytes(), Some(','), 0).unwrap();
        assert_eq!(content.radius.unwrap(), [2.0]);
        assert_eq!(content.velocity.unwrap(), [Vec3::new(5.0, 6.0, 7.0)]);
    }

    #[test]
    fn defects_name_the_line() {
        let problem = |text: &str| {
            let error = read_spheres(text.as_bytes(), None, 0).unwrap_err();
            (error.line, error.problem)
        };
        assert_eq!(
            problem("x y z r\n1 2 3\n"),
            (
                Some(2),
                "3 values where the header names 4 columns (leave lines at the end out with `skip_last`)"
                    .into()
            )
        );
        assert_eq!(problem("x y z r\n1 2 3 4\n1 2 zwei 4\n"), (Some(3), "`zwei` is not a number".into()));
        assert_eq!(
            problem("x[s] y z r\n1 2 3 4\n"),
            (Some(1), "column `x` must be a length (m), its unit is a time (s)".into())
        );
        assert_eq!(problem(""), (None, "it is empty".into()));
        assert_eq!(problem("x[m y z r\n").0, Some(1));
        assert_eq!(problem("1 2 3 4\n").0, Some(1));
    }
}
