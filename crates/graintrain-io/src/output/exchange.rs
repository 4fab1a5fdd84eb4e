//! Frames of spheres in the formats of other programs.
//!
//! | format | source |
//! |---|---|
//! | LAMMPS dump, text | docs.lammps.org/dump.html; OVITO and many scripts read it |
//! | extended XYZ | github.com/libAtoms/extxyz, with the names of properties that OVITO knows |
//! | YADE's text | `yade.export.text`: x, y, z, radius |

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

    /// Lower and upper corner of the box around all points with their radii, m; of a unit box where there are none.
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
        writeln!(out, "ITEM: NUMBER OF ATOMS\n{}\nITEM: BOX BOUNDS ff ff ff", self.position.len())?;
        let [low, high] = self.bounds();
        for axis in 0..3 {
            writeln!(out, "{:?} {:?}", low[axis], high[axis])?;
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
        let [low, high] = self.bounds();
        let edge = high - low;
        write!(
            out,
            "{}\nLattice=\"{:?} 0 0 0 {:?} 0 0 0 {:?}\" Origin=\"{:?} {:?} {:?}\" pbc=\"F F F\" Time={:?} Step={} \
             Properties=id:I:1:species:S:1:pos:R:3",
            self.position.len(),
            edge.x,
            edge.y,
            edge.z,
            low.x,
            low.y,
            low.z,
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
