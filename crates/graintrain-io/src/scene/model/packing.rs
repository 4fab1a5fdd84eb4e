//! Packings.

use super::super::error::Location;
use super::{PartSpec, ShapeSpec};
pub use crate::radii::RadiusDistribution;
use graintrain::load::Region;
use graintrain::math::Vec3;
use serde::{Serialize, Serializer};
use std::path::PathBuf;

/// Many bodies at once.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PackingSpec {
    /// Where they come from.
    #[serde(flatten)]
    pub source: PackingSource,
    /// The bodies.
    #[serde(flatten)]
    pub grains: GrainSpec,
    /// Seed.
    pub seed: u64,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

/// The bodies of a packing or a stream.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GrainSpec {
    /// Radius of the spheres; for a file, `None` is the file's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius: Option<RadiusSpec>,
    /// Shape, if not spheres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<ShapeSpec>,
    /// Several shapes in each body.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<PartSpec>,
    /// Whether bodies are turned at random.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub random_rotation: bool,
    /// Name of their material.
    pub material: String,
    /// Initial velocity, m/s.
    pub velocity: Vec3,
    /// Whether they keep their orientation.
    pub lock_rotation: bool,
}

/// Where the bodies of a packing come from.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PackingSource {
    /// Perturbed cubic lattice.
    Lattice(LatticeSpec),
    /// Random places.
    Drop(DropSpec),
    /// Places of a least distance.
    Poisson(PoissonSpec),
    /// A file.
    File(FileSpec),
}

/// Perturbed cubic lattice.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LatticeSpec {
    /// Bodies along x, y, z.
    pub counts: [u64; 3],
    /// Distance of neighbours, m.
    pub pitch: Vec3,
    /// Lower corner, m.
    pub origin: Vec3,
    /// Largest move of each coordinate, m.
    pub jitter: f64,
}

/// Random places.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DropSpec {
    /// Number of bodies.
    pub count: usize,
    /// Region.
    #[serde(flatten)]
    pub region: Region,
}

/// Places of a least distance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoissonSpec {
    /// Least distance of two centres, m.
    pub distance: f64,
    /// Region.
    #[serde(flatten)]
    pub region: Region,
}

/// A packing file and what to take from it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FileSpec {
    /// The file.
    pub path: PathBuf,
    /// Its form.
    pub format: PackingFormat,
    /// Frame of a file with several, from 0; `None`: the last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<u64>,
    /// Lines left out at the end.
    pub skip_last: usize,
    /// Factor on all lengths.
    pub scale: f64,
    /// Added to all positions, m.
    pub offset: Vec3,
    /// Lower corner of what is kept, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_min: Option<Vec3>,
    /// Upper corner of what is kept, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_max: Option<Vec3>,
    /// Smallest radius kept, m.
    pub radius_min: f64,
    /// Largest radius kept, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_max: Option<f64>,
    /// Where the path is written.
    #[serde(skip)]
    pub location: Location,
}

/// Form of a packing file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PackingFormat {
    /// VTU or VTP.
    Vtk,
    /// Comma-separated, with a header line.
    Csv,
    /// Separated by blanks, with a header line.
    Table,
    /// Text dumps of LAMMPS and LIGGGHTS.
    Lammps,
    /// Extended XYZ.
    Xyz,
    /// YADE's text.
    Yade,
    /// Data and restart files of MercuryDPM.
    Mercury,
}

impl PackingFormat {
    pub(crate) const NAMES: &[(&str, Self)] = &[
        ("vtk", Self::Vtk),
        ("csv", Self::Csv),
        ("table", Self::Table),
        ("lammps", Self::Lammps),
        ("xyz", Self::Xyz),
        ("yade", Self::Yade),
        ("mercury", Self::Mercury),
    ];
}

/// Radius of the spheres of a packing, m.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum RadiusSpec {
    /// The same for all.
    Single(f64),
    /// A distribution.
    #[serde(serialize_with = "radius_table")]
    Distribution(RadiusDistribution),
}

impl RadiusSpec {
    /// The smallest radius, m.
    pub fn least(&self) -> f64 {
        match self {
            Self::Single(radius) => *radius,
            Self::Distribution(distribution) => distribution.range()[0],
        }
    }
}

/// The table that a scene has for a distribution, with what its shares count beside it.
fn radius_table<S: Serializer>(distribution: &RadiusDistribution, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct RadiusTable<'a> {
        #[serde(flatten)]
        distribution: &'a RadiusDistribution,
        #[serde(skip_serializing_if = "Option::is_none")]
        by: Option<&'static str>,
    }
    let table = match distribution {
        RadiusDistribution::ByMass(inner) => RadiusTable { distribution: inner, by: Some("mass") },
        by_number => RadiusTable { distribution: by_number, by: None },
    };
    table.serialize(serializer)
}

impl PackingSpec {
    /// Where the bodies come from, for people.
    pub fn kind(&self) -> String {
        match &self.source {
            PackingSource::Lattice(lattice) => {
                let [x, y, z] = lattice.counts;
                format!("lattice of {x} x {y} x {z}")
            }
            PackingSource::Drop(drop) => format!("{} at random places", drop.count),
            PackingSource::Poisson(poisson) => format!("at random places {} m apart", poisson.distance),
            PackingSource::File(file) => format!("from {}", file.path.display()),
        }
    }
}
