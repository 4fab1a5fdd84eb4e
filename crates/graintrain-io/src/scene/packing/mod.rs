//! Packings: the places and sizes of many bodies, made here or read from a file.

mod drop;
mod lammps_file;
mod lattice;
mod mercury_file;
mod poisson;
pub(crate) mod table_file;
mod text;
mod vtk_file;
mod xyz_file;
mod yade_file;

use super::error::{SceneError, SceneErrorKind};
use super::model::{FileSpec, PackingFormat, PackingSource, PackingSpec, RadiusSpec};
use super::radius;
use crate::random::Random;
use graintrain::math::{Quat, Vec3};
use graintrain::measure::space::volume;
use std::path::Path;

/// Tells the stream of orientations from that of places.
const TURNS: u64 = 0x7475_726e_7321_0001;

/// Tells the stream of evenly spread places from that of radii.
const PLACES: u64 = 0x7370_7265_6164_2101;

/// Most bodies of a packing; more would not fit into memory.
const MOST_BODIES: u64 = 100_000_000;

/// Places, and for spheres radii, of the bodies of a packing.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Placed {
    /// Centres, m.
    pub position: Vec<Vec3>,
    /// Radii, m; of the bounding sphere where the bodies are not spheres.
    pub radius: Vec<f64>,
    /// Velocities, m/s.
    pub velocity: Vec<Vec3>,
}

/// What a file of spheres holds, in SI units; no radii where it names none.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct FileContent {
    pub position: Vec<Vec3>,
    pub radius: Option<Vec<f64>>,
    pub velocity: Option<Vec<Vec3>>,
}

/// What is wrong with a packing or mesh file, and in which line.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FileProblem {
    pub line: Option<usize>,
    pub problem: String,
}

impl FileProblem {
    pub fn new(problem: impl Into<String>) -> Self {
        Self { line: None, problem: problem.into() }
    }

    pub fn at(line: usize, problem: impl Into<String>) -> Self {
        Self { line: Some(line), problem: problem.into() }
    }

    /// Of a file without the frame asked for, or without any.
    pub fn no_frame(frame: Option<u64>, frames: u64, without: &str) -> Self {
        Self::new(match frame {
            Some(frame) => format!("it has no frame {frame}: it holds {frames}, counted from 0"),
            None => without.into(),
        })
    }

    /// The error with the file's name and the place in the scene that names it.
    pub fn located(self, path: &Path, location: &super::error::Location) -> SceneError {
        let kind = SceneErrorKind::MalformedFile {
            path: path.display().to_string(),
            line: self.line,
            problem: self.problem,
        };
        SceneError::at(kind, location)
    }
}

/// Reads a file that a scene names.
pub(crate) fn read_file(path: &Path, location: &super::error::Location) -> Result<Vec<u8>, SceneError> {
    std::fs::read(path).map_err(|error| {
        let kind =
            SceneErrorKind::UnreadableFile { path: path.display().to_string(), reason: error.to_string() };
        SceneError::at(kind, location)
    })
}

/// Places the bodies of a packing. `bounding_radius` is that of the packing's shape where they are not
/// spheres.
pub(crate) fn place(
    name: &str,
    spec: &PackingSpec,
    bounding_radius: Option<f64>,
) -> Result<Placed, SceneError> {
    let mut random = Random::new(spec.seed);
    let mut draw_radii = |count: usize| match (&spec.grains.radius, bounding_radius) {
        (_, Some(radius)) => vec![radius; count],
        (Some(RadiusSpec::Single(radius)), _) => vec![*radius; count],
        (Some(RadiusSpec::Distribution(distribution)), _) => radius::draw(distribution, count, &mut random),
        (None, None) => Vec::new(),
    };
    let mut placed = match &spec.source {
        PackingSource::Lattice(lattice) => {
            let count = lattice.counts.iter().try_fold(1_u64, |product, &n| product.checked_mul(n));
            let count = limited(name, spec, count)?;
            let radius = draw_radii(count);
            Placed { position: lattice::positions(lattice, &mut random), radius, velocity: Vec::new() }
        }
        PackingSource::Drop(drop) => {
            let count = limited(name, spec, Some(drop.count as u64))?;
            let radius = draw_radii(count);
            let position = drop::positions(&drop.region, &radius, &mut random);
            if position.len() < count {
                let (placed, wanted) = (position.len(), count);
                let kind = SceneErrorKind::NoRoom { packing: name.into(), placed, wanted };
                return Err(SceneError::at(kind, &spec.location));
            }
            Placed { position, radius, velocity: Vec::new() }
        }
        PackingSource::Poisson(sampling) => {
            let most = volume(&sampling.region) / sampling.distance.powi(3);
            limited(name, spec, Some(most as u64))?;
            let reach = match (&spec.grains.radius, bounding_radius) {
                (_, Some(radius)) => radius,
                (Some(RadiusSpec::Single(radius)), _) => *radius,
                (Some(RadiusSpec::Distribution(distribution)), _) => distribution.range()[1],
                (None, None) => 0.0,
            };
            let mut places = Random::new(spec.seed ^ PLACES);
            let position = poisson::positions(&sampling.region, sampling.distance, reach, &mut places);
            if position.is_empty() {
                let kind = SceneErrorKind::NoRoom { packing: name.into(), placed: 0, wanted: 1 };
                return Err(SceneError::at(kind, &spec.location));
            }
            Placed { radius: draw_radii(position.len()), position, velocity: Vec::new() }
        }
        PackingSource::File(file) => {
            let content = read(file)?;
            let drawn = draw_radii(content.position.len());
            from_file(file, content, drawn)?
        }
    };
    placed.velocity.resize(placed.position.len(), Vec3::ZERO);
    placed.velocity.iter_mut().for_each(|velocity| *velocity += spec.grains.velocity);
    Ok(placed)
}

/// The orientations of a packing's bodies, one after the other; none where they are not turned, from a stream
/// of their own: places stay what they are.
pub(crate) fn orientations(spec: &PackingSpec) -> impl Iterator<Item = Quat> + use<> {
    let mut random = Random::new(spec.seed ^ TURNS);
    std::iter::repeat_with(move || random.rotation()).take(if spec.grains.random_rotation {
        usize::MAX
    } else {
        0
    })
}

fn limited(name: &str, spec: &PackingSpec, count: Option<u64>) -> Result<usize, SceneError> {
    match count {
        Some(count) if count <= MOST_BODIES => Ok(count as usize),
        _ => {
            let problem = format!("packing `{name}` asks for more than {MOST_BODIES} bodies");
            Err(SceneError::at(SceneErrorKind::Contradiction(problem), &spec.location))
        }
    }
}

fn read(file: &FileSpec) -> Result<FileContent, SceneError> {
    let bytes = read_file(&file.path, &file.location)?;
    let content = match file.format {
        PackingFormat::Vtk => vtk_file::read(&bytes),
        PackingFormat::Lammps => lammps_file::read(&bytes, file.frame),
        PackingFormat::Xyz => xyz_file::read(&bytes, file.frame),
        PackingFormat::Yade => yade_file::read(&bytes),
        PackingFormat::Mercury => mercury_file::read(&bytes, file.frame),
        PackingFormat::Csv => table_file::read_spheres(&bytes, Some(','), file.skip_last),
        PackingFormat::Table => table_file::read_spheres(&bytes, None, file.skip_last),
    };
    let mut content = content.map_err(|problem| problem.located(&file.path, &file.location))?;
    if !matches!(file.format, PackingFormat::Csv | PackingFormat::Table) {
        let kept = content.position.len().saturating_sub(file.skip_last);
        content.position.truncate(kept);
        content.radius.iter_mut().for_each(|list| list.truncate(kept));
        content.velocity.iter_mut().for_each(|list| list.truncate(kept));
    }
    Ok(content)
}

/// Checks, scales, moves and filters what a file holds. `drawn` are the radii that the scene gives, if any.
fn from_file(file: &FileSpec, content: FileContent, drawn: Vec<f64>) -> Result<Placed, SceneError> {
    let fail = |problem: String| Err(FileProblem::new(problem).located(&file.path, &file.location));
    let count = content.position.len();
    let radius = match content.radius {
        _ if drawn.len() == count && count > 0 => drawn,
        Some(radius) => radius.iter().map(|radius| radius * file.scale).collect(),
        None if count == 0 => Vec::new(),
        None => return fail("it holds no radii: give the packing a `radius`".into()),
    };
    let velocity = content.velocity.unwrap_or_else(|| vec![Vec3::ZERO; count]);
    let mut placed = Placed::default();
    for index in 0..count {
        let position = content.position[index] * file.scale + file.offset;
        let (radius, velocity) = (radius[index], velocity[index] * file.scale);
        if !(position.is_finite() && velocity.is_finite()) {
            return fail(format!("sphere {} has a coordinate that is not finite", index + 1));
        }
        if !(radius.is_finite() && radius > 0.0) {
            return fail(format!("sphere {} has the radius {radius}; radii must be positive", index + 1));
        }
        let keep = file.keep_min.is_none_or(|min| position.cmpge(min).all())
            && file.keep_max.is_none_or(|max| position.cmple(max).all())
            && radius >= file.radius_min
            && file.radius_max.is_none_or(|max| radius <= max);
        if keep {
            placed.position.push(position);
            placed.radius.push(radius);
            placed.velocity.push(velocity);
        }
    }
    if placed.position.is_empty() {
        return fail(match count {
            0 => "it holds no spheres".into(),
            _ => format!("none of its {count} spheres is kept by the filters"),
        });
    }
    Ok(placed)
}
