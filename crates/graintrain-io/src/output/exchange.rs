//! Frames of spheres in the formats of other programs.
//!
//! | format | source |
//! |---|---|
//! | LAMMPS dump, text | docs.lammps.org/dump.html; OVITO and many scripts read it |
//! | extended XYZ | github.com/libAtoms/extxyz, with the names of properties that OVITO knows |
//! | YADE's text | `yade.export.text`: x, y, z, radius |

use graintrain::cell::Cell;
use graintrain::math::Vec3;
use std::io::{self, Write};

/// A frame: points with arrays over them, as [`bodies`](super::bodies) makes them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// s
    pub time: f64,
    /// Number of the step.
    pub step: u64,
    /// Centres, m.
    pub position: Vec<Vec3>,
    /// Arrays over the points.
    pub arrays: Vec<Array>,
    /// The periodic cell, where there is one.
    pub cell: Option<PeriodicBox>,
}

/// A periodic cell as other programs know it: a corner and three edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeriodicBox {
    /// Lower corner, m.
    pub origin: Vec3,
    /// Edges, m: the first along x, the second in the plane of x and y; zero along axes that do not repeat.
    pub vectors: [Vec3; 3],
    /// Along which axes space repeats.
    pub periodic: [bool; 3],
}

impl PeriodicBox {
    /// That of a world.
    pub fn of(cell: &Cell) -> Self {
        let (size, [xy, xz, yz]) = (cell.size, cell.tilt);
        let edges = [Vec3::new(size.x, 0.0, 0.0), Vec3::new(xy, size.y, 0.0), Vec3::new(xz, yz, size.z)];
        let repeats = |axis: usize| if cell.periodic[axis] { edges[axis] } else { Vec3::ZERO };
        Self { origin: cell.lower, vectors: [0, 1, 2].map(repeats), periodic: cell.periodic }
    }
}

/// A named array over points.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Its name.
    pub name: &'static str,
    /// Numbers per point.
    pub components: usize,
    /// Whether they are whole.
    pub is_whole: bool,
    /// Point by point.
    pub values: Vec<f64>,
}

/// Arrays of the frames of bodies: name, numbers per point, whether they are whole.
pub const ARRAYS: [(&str, usize, bool); 12] = [
    ("id", 1, true),
    ("body", 1, true),
    ("type", 1, true),
    ("shapetype", 1, true),
    ("contacts", 1, true),
    ("radius", 1, false),
    ("mass", 1, false),
    ("v", 3, false),
    ("omega", 3, false),
    ("quat", 4, false),
    ("f", 3, false),
    ("tq", 3, false),
];

/// A column of a text format: its name there, the array and component that it comes from.
type TextColumn = (&'static str, &'static str, usize);

const LAMMPS: [TextColumn; 20] = [
    ("vx", "v", 0),
    ("vy", "v", 1),
    ("vz", "v", 2),
    ("omegax", "omega", 0),
    ("omegay", "omega", 1),
    ("omegaz", "omega", 2),
    ("fx", "f", 0),
    ("fy", "f", 1),
    ("fz", "f", 2),
    ("tqx", "tq", 0),
    ("tqy", "tq", 1),
    ("tqz", "tq", 2),
    ("radius", "radius", 0),
    ("mass", "mass", 0),
    ("quati", "quat", 0),
    ("quatj", "quat", 1),
    ("quatk", "quat", 2),
    ("quatw", "quat", 3),
    ("ncontact", "contacts", 0),
    ("body", "body", 0),
];

/// Properties of extended XYZ with the array that they come from.
const XYZ: [(&str, &str); 9] = [
    ("body", "body"),
    ("velo", "v"),
    ("omega", "omega"),
    ("radius", "radius"),
    ("mass", "mass"),
    ("orientation", "quat"),
    ("force", "f"),
    ("torque", "tq"),
    ("n_contacts", "contacts"),
];

impl Snapshot {
    /// An array by its name.
    pub fn array(&self, name: &str) -> Option<&Array> {
        self.arrays.iter().find(|array| array.name == name)
    }

    /// Lower and upper corner of the box around all points with their radii, m; of a unit box where there are
    /// none.
    fn bounds(&self) -> [Vec3; 2] {
        let radius = self.array("radius");
        let reach = |k: usize| radius.map_or(0.0, |array| array.values[k]);
        let around = self
            .position
            .iter()
            .enumerate()
            .fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], (k, &p)| {
                [low.min(p - reach(k)), high.max(p + reach(k))]
            });
        if self.position.is_empty() { [Vec3::ZERO, Vec3::ONE] } else { around }
    }

    /// The box that the frame is in: the periodic cell, closed around the points along axes that do not
    /// repeat.
    fn closed_box(&self) -> PeriodicBox {
        let [low, high] = self.bounds();
        let edge = high - low;
        let mut closed = PeriodicBox {
            origin: low,
            vectors: [Vec3::X * edge.x, Vec3::Y * edge.y, Vec3::Z * edge.z],
            periodic: [false; 3],
        };
        if let Some(cell) = &self.cell {
            for axis in (0..3).filter(|axis| cell.periodic[*axis]) {
                closed.origin[axis] = cell.origin[axis];
                closed.vectors[axis] = cell.vectors[axis];
                closed.periodic[axis] = true;
            }
        }
        closed
    }

    fn whole(&self, name: &str, k: usize) -> i64 {
        self.array(name).map_or(k as i64, |array| array.values[k] as i64)
    }

    /// Writes it as a frame of a LAMMPS dump. Identities and types count from 1 there.
    ///
    /// # Errors
    /// Of the writer.
    pub fn write_lammps(&self, out: &mut impl Write) -> io::Result<()> {
        let columns: Vec<(&TextColumn, &Array)> =
            LAMMPS.iter().filter_map(|column| Some((column, self.array(column.1)?))).collect();
        writeln!(out, "ITEM: TIME\n{:?}\nITEM: TIMESTEP\n{}", self.time, self.step)?;
        writeln!(out, "ITEM: NUMBER OF ATOMS\n{}", self.position.len())?;
        let PeriodicBox { origin, vectors: [a, b, c], periodic } = self.closed_box();
        let (low, high, [xy, xz, yz]) = (origin, origin + Vec3::new(a.x, b.y, c.z), [b.x, c.x, c.y]);
        let tags = periodic.map(|repeats| if repeats { "pp" } else { "ff" }).join(" ");
        if [xy, xz, yz] == [0.0; 3] {
            writeln!(out, "ITEM: BOX BOUNDS {tags}")?;
            for axis in 0..3 {
                writeln!(out, "{:?} {:?}", low[axis], high[axis])?;
            }
        } else {
            // A tilted box is given by the extents of all its corners.
            writeln!(out, "ITEM: BOX BOUNDS xy xz yz {tags}")?;
            let along_x = [0.0, xy, xz, xy + xz];
            let least = along_x.into_iter().fold(0.0, f64::min);
            let most = along_x.into_iter().fold(0.0, f64::max);
            writeln!(out, "{:?} {:?} {xy:?}", low.x + least, high.x + most)?;
            writeln!(out, "{:?} {:?} {xz:?}", low.y + yz.min(0.0), high.y + yz.max(0.0))?;
            writeln!(out, "{:?} {:?} {yz:?}", low.z, high.z)?;
        }
        write!(out, "ITEM: ATOMS id type x y z")?;
        for ((name, ..), _) in &columns {
            write!(out, " {name}")?;
        }
        writeln!(out)?;
        for (k, p) in self.position.iter().enumerate() {
            write!(
                out,
                "{} {} {:?} {:?} {:?}",
                self.whole("id", k) + 1,
                self.whole("type", k) + 1,
                p.x,
                p.y,
                p.z
            )?;
            for ((_, _, component), array) in &columns {
                let value = array.values[array.components * k + component];
                if array.is_whole { write!(out, " {}", value as i64)? } else { write!(out, " {value:?}")? }
            }
            writeln!(out)?;
        }
        Ok(())
    }

    /// Writes it as a frame of extended XYZ.
    ///
    /// # Errors
    /// Of the writer.
    pub fn write_xyz(&self, out: &mut impl Write) -> io::Result<()> {
        let arrays: Vec<(&str, &Array)> =
            XYZ.iter().filter_map(|(name, array)| Some((*name, self.array(array)?))).collect();
        let PeriodicBox { origin, vectors, periodic } = self.closed_box();
        let numbers = |list: &[Vec3]| -> String {
            let all: Vec<String> = list.iter().flat_map(|v| v.to_array()).map(|x| format!("{x:?}")).collect();
            all.join(" ")
        };
        write!(
            out,
            "{}\nLattice=\"{}\" Origin=\"{}\" pbc=\"{}\" Time={:?} Step={} Properties=id:I:1:species:S:1:pos:R:3",
            self.position.len(),
            numbers(&vectors),
            numbers(&[origin]),
            periodic.map(|repeats| if repeats { "T" } else { "F" }).join(" "),
            self.time,
            self.step
        )?;
        for (name, array) in &arrays {
            write!(out, ":{name}:{}:{}", if array.is_whole { 'I' } else { 'R' }, array.components)?;
        }
        writeln!(out)?;
        for (k, p) in self.position.iter().enumerate() {
            write!(
                out,
                "{} T{} {:?} {:?} {:?}",
                self.whole("id", k),
                self.whole("type", k) + 1,
                p.x,
                p.y,
                p.z
            )?;
            for (_, array) in &arrays {
                for value in &array.values[array.components * k..array.components * (k + 1)] {
                    if array.is_whole {
                        write!(out, " {}", *value as i64)?
                    } else {
                        write!(out, " {value:?}")?
                    }
                }
            }
            writeln!(out)?;
        }
        Ok(())
    }

    /// Writes it as YADE's text.
    ///
    /// # Errors
    /// Of the writer.
    pub fn write_yade(&self, out: &mut impl Write) -> io::Result<()> {
        writeln!(out, "#format x_y_z_r")?;
        let radius = self.array("radius");
        for (k, p) in self.position.iter().enumerate() {
            let radius = radius.map_or(0.0, |array| array.values[k]);
            writeln!(out, "{:?}\t{:?}\t{:?}\t{radius:?}", p.x, p.y, p.z)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tilted() -> Snapshot {
        let vectors = [Vec3::new(2.0, 0.0, 0.0), Vec3::new(-0.5, 1.0, 0.0), Vec3::new(0.25, 0.125, 4.0)];
        let cell = PeriodicBox { origin: Vec3::new(-1.0, 0.0, 0.5), vectors, periodic: [true; 3] };
        Snapshot { position: vec![Vec3::new(0.5, 0.5, 0.5)], cell: Some(cell), ..Snapshot::default() }
    }

    fn text(write: impl Fn(&mut Vec<u8>) -> io::Result<()>) -> String {
        let mut out = Vec::new();
        write(&mut out).unwrap();
        String::from_utf8(out).unwrap()
    }

    /// The extents of the eight corners, as LAMMPS defines them, and the lattice row by row.
    #[test]
    fn periodic_cells_are_written() {
        let dump = text(|out| tilted().write_lammps(out));
        let begin = dump.find("ITEM: BOX").unwrap();
        let lines: Vec<&str> = dump[begin..].lines().take(4).collect();
        assert_eq!(lines[0], "ITEM: BOX BOUNDS xy xz yz pp pp pp");
        assert_eq!(lines[1..], ["-1.5 1.25 -0.5", "0.0 1.125 0.25", "0.5 4.5 0.125"]);
        let xyz = text(|out| tilted().write_xyz(out));
        assert!(
            xyz.contains(
                "Lattice=\"2.0 0.0 0.0 -0.5 1.0 0.0 0.25 0.125 4.0\" Origin=\"-1.0 0.0 0.5\" pbc=\"T T T\""
            ),
            "{xyz}"
        );
    }

    /// Periodic along x alone: the other edges go around the points.
    #[test]
    fn cells_are_closed_around_the_points() {
        let mut snapshot = tilted();
        let cell = snapshot.cell.as_mut().unwrap();
        (cell.periodic, cell.vectors[1], cell.vectors[2]) = ([true, false, false], Vec3::ZERO, Vec3::ZERO);
        snapshot.position.push(Vec3::new(0.0, 3.0, 1.0));
        let dump = text(|out| snapshot.write_lammps(out));
        assert!(dump.contains("BOX BOUNDS pp ff ff\n-1.0 1.0\n0.5 3.0\n0.5 1.0\n"), "{dump}");
    }
}
