//! Packings.

use super::super::error::SceneError;
use super::super::names;
pub use super::super::radius::RadiusDistribution;
use super::super::radius::RadiusTable;
use super::super::reader::Reader;
use super::super::region::{RegionSpec, region};
use super::super::table::{Choice, Spec, table};
use super::shape::SHAPE;
use super::{PartSpec, ShapeSpec};
use graintrain::load::Region;
use graintrain::math::Vec3;
use serde::{Serialize, Serializer};
use std::path::PathBuf;

table! {
    /// Many bodies at once.
    pub struct PackingSpec: "`[packing.NAME]`",
        at most one of ["lattice", "drop", "poisson", "file"],
        at most one of ["radius", "shape", "parts"] {
        /// Where they come from.
        #[serde(flatten)]
        source: PackingSource => Spec::read;
        keys of PackingSource::TABLE;
        /// Radius of the spheres: one value, or a distribution
        radius = QuantityOr(D::LENGTH, RadiusTable::TABLE), "one of radius, shape, parts; the file's",
            "\"5 mm\"", Positive;
        /// Shape of the bodies
        shape = Table(&SHAPE), "one of radius, shape, parts", "{ box = { size = [1, 1, 1] } }";
        /// Several shapes in each body (clumps), with the mass of their union; the body's position is that of
        /// its centre of mass
        parts = Tables(PartSpec::TABLE),
            "one of radius, shape, parts",
            "[{ shape = { sphere = { radius = 1 } } }, { shape = { sphere = { radius = 1 } }, position = [1, 0, 0] }]";
        /// Random orientations, uniformly distributed
        random_rotation = Flag, "false", "true";
        /// Material
        material = Text, "the only material", "\"glass\"";
        /// Initial velocity, added to that of a file
        velocity = Vector(D::SPEED), "[0, 0, 0]", "[0, 0, \"-1 m/s\"]";
        /// Bodies keep their orientation
        lock_rotation = Flag, "false", "true";
        /// The bodies.
        #[serde(flatten)]
        grains: GrainSpec => grains;
        /// Seed of this packing
        seed: u64 = Count, "seed of the scene + number of the packing", "7" => seed;
        location
    }
}

table! {
    /// Where the bodies of a packing come from.
    pub enum PackingSource: "`[packing.NAME]`" {
        /// Bodies on a perturbed cubic lattice
        Lattice(LatticeSpec): lattice = Table(LatticeSpec::TABLE), "{ counts = [9, 9, 9], pitch = 0.23 }";
        /// Bodies at random positions in a region, without overlap
        Drop(DropSpec): drop = Table(DropSpec::TABLE),
            "{ count = 500, box = { min = [0, 0, 0], max = [1, 1, 3] } }";
        /// Bodies at random positions with a minimum distance that fill a region evenly (Poisson-disk
        /// sampling)
        Poisson(PoissonSpec): poisson = Table(PoissonSpec::TABLE),
            "{ distance = 0.1, box = { min = [0, 0, 0], max = [1, 1, 3] } }";
        /// Spheres from a file
        File(FileSpec): file = Table(FileSpec::TABLE), "{ path = \"pile.vtu\" }";
    }
}

table! {
    /// The bodies of a packing or a stream, with the keys as a stream has them.
    pub struct GrainSpec: "`[stream.NAME]`", checked by are_bodies {
        /// Radius of spheres: one value, or a distribution
        radius: Option<RadiusSpec> = QuantityOr(D::LENGTH, RadiusTable::TABLE), "one of radius, shape, parts",
            "\"5 mm\"", Positive;
        /// Shape of the bodies
        shape: Option<ShapeSpec> = Table(&SHAPE), "one of radius, shape, parts",
            "{ box = { size = [0.01, 0.01, 0.02] } }";
        /// Several shapes in each body (clumps)
        #[serde(skip_serializing_if = "Vec::is_empty")]
        parts: Vec<PartSpec> = Tables(PartSpec::TABLE),
            "one of radius, shape, parts",
            "[{ shape = { sphere = { radius = 1 } } }, { shape = { sphere = { radius = 1 } }, position = [1, 0, 0] }]";
        /// Random orientations
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        random_rotation: bool = Flag, "false", "true";
        /// Material
        material: String = Text, "the only material", "\"glass\"" => names::material;
        /// Initial velocity, in a periodic cell relative to its deformation
        velocity: Vec3 = Vector(D::SPEED), "[0, 0, 0]", "[0, 0, \"-1 m/s\"]";
        /// Bodies keep their orientation
        lock_rotation: bool = Flag, "false", "true";
    }
}

/// What the size of bodies follows from, where no file has it.
pub(in crate::scene) const SIZES: &[&str] = &["radius", "shape", "parts"];

fn are_bodies(GrainSpec { shape, parts, .. }: &GrainSpec, reader: &Reader) -> Result<(), SceneError> {
    for (key, shape) in
        shape.iter().map(|shape| ("shape", shape)).chain(parts.iter().map(|part| ("parts", &part.shape)))
    {
        // Meshes do not touch each other.
        if matches!(shape, ShapeSpec::Plane(_) | ShapeSpec::Mesh(_)) {
            return Err(reader.out_of_range(key, "a shape with volume", "a plane or mesh"));
        }
    }
    if reader.get("parts").is_some() && parts.is_empty() {
        return Err(reader.out_of_range("parts", "at least one part", "none"));
    }
    Ok(())
}

/// The bodies of a packing: spheres where they come from a file.
fn grains(reader: &Reader) -> Result<GrainSpec, SceneError> {
    if reader.get("file").is_none() {
        reader.any_of(SIZES)?;
    } else if let Some(form) = reader.at_most_one_of(&["shape", "parts"])? {
        return Err(reader.refuse(format!("a packing from a file holds spheres: it takes no `{form}`")));
    }
    GrainSpec::read(reader)
}

fn seed(reader: &Reader, key: &str) -> Result<u64, SceneError> {
    names::seed(reader, key, &reader.context.names.packings, 0)
}

table! {
    /// Perturbed cubic lattice.
    pub struct LatticeSpec: "`packing.NAME.lattice`" {
        /// Bodies along x, y, z
        counts: [u64; 3] = Counts, "required", "[\"2*n+1\", \"2*n+1\", \"2*n+1\"]", Positive;
        /// Distance of neighbours
        pitch: Vec3 = VectorOrQuantity(D::LENGTH), "required", "\"0.23 m\"", Positive;
        /// Lower corner of the lattice; the first body is half a pitch inside
        origin: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"5 cm\"]";
        /// Largest random displacement of each coordinate, uniformly distributed
        jitter: f64 = Quantity(D::LENGTH), "0", "\"12 mm\"", NotNegative;
    }
}

table! {
    /// Random places.
    pub struct DropSpec: "`packing.NAME.drop`", at most one of ["box", "cylinder"] {
        /// Region.
        #[serde(flatten)]
        region: Region => region;
        /// Number of bodies
        count: usize = Count, "required", "500", Positive;
        keys of RegionSpec::TABLE;
    }
}

table! {
    /// Places of a least distance.
    pub struct PoissonSpec: "`packing.NAME.poisson`", at most one of ["box", "cylinder"] {
        /// Minimum distance of two centres
        distance: f64 = Quantity(D::LENGTH), "required", "\"12 mm\"", Positive;
        /// Region.
        #[serde(flatten)]
        region: Region => region;
        keys of RegionSpec::TABLE;
    }
}

table! {
    /// A packing file and what to take from it.
    pub struct FileSpec: "`packing.NAME.file`", checked by has_frames {
        /// VTU or VTP, CSV, a whitespace table, a dump of LAMMPS or LIGGGHTS, extended XYZ, YADE's text, data
        /// or restart files of MercuryDPM; relative to the scene's folder, on the command line to the current
        /// folder
        path: PathBuf = Text, "required", "\"pile.vtu\"";
        /// vtk, csv, table, lammps, xyz, yade or mercury
        format: PackingFormat = Text,
            "from the file extension", "\"lammps\"" in PackingFormat::NAMES => format;
        /// Frame of a file with several, counted from 0: lammps, xyz, mercury
        frame: Option<u64> = Count, "the last", "0";
        /// Number of lines to omit at the end
        skip_last: usize = Count, "0", "1";
        /// Factor for all lengths, after conversion of the units in the file
        scale: f64 = Quantity(D::NONE), "1", "0.001", Positive;
        /// Added to all positions
        offset: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"1 cm\"]";
        /// Keep only centres above this corner, in final coordinates
        keep_min: Option<Vec3> = Vector(D::LENGTH), "everything", "[-1, -1, 0]";
        /// Keep only centres below this corner
        keep_max: Option<Vec3> = Vector(D::LENGTH), "everything", "[1, 1, 2]";
        /// Keep only spheres of at least this radius
        radius_min: f64 = Quantity(D::LENGTH), "0", "\"1 mm\"", NotNegative;
        /// Keep only spheres of at most this radius
        radius_max: Option<f64> = Quantity(D::LENGTH), "everything", "\"1 cm\"", Positive;
        location of path
    }
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

impl Choice for PackingFormat {
    const NAMES: &'static [(&'static str, Self)] = &[
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
    distribution.table().serialize(serializer)
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

/// The form of a file, by its ending where the scene does not say it.
fn format(reader: &Reader, key: &str) -> Result<PackingFormat, SceneError> {
    let path: PathBuf = reader.field("path")?;
    let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_lowercase);
    Ok(reader.field::<Option<_>>(key)?.unwrap_or(match ending.as_deref() {
        Some("vtu" | "vtp") => PackingFormat::Vtk,
        Some("csv") => PackingFormat::Csv,
        Some("dump" | "lammpstrj" | "liggghts") => PackingFormat::Lammps,
        Some("xyz" | "extxyz") => PackingFormat::Xyz,
        Some("data" | "restart") => PackingFormat::Mercury,
        _ => PackingFormat::Table,
    }))
}

fn has_frames(file: &FileSpec, reader: &Reader) -> Result<(), SceneError> {
    let several = matches!(file.format, PackingFormat::Lammps | PackingFormat::Xyz | PackingFormat::Mercury);
    if file.frame.is_none() || several {
        return Ok(());
    }
    Err(reader
        .refuse(format!("`{}.frame` is for files with several frames: lammps, xyz and mercury", reader.path)))
}
