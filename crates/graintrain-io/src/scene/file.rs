//! From the tree of a scene file to a [`Scene`] in which every value is resolved.

use super::Scene;
use super::error::{SceneError, SceneErrorKind};
use super::joint::{self, JointSpec};
use super::measure;
use super::model::*;
use super::names::{self, Names};
use super::parameters::Parameters;
use super::periodic;
use super::radius::radius;
use super::reader::{Context, Reader};
use super::region::region;
use super::robot;
use super::solver;
use super::stage::{self, StageSpec};
use super::stream;
use super::table::Spec;
use super::tree::Node;
use crate::files::is_file_name;
use graintrain::math::{Quat, Vec3};
use std::path::PathBuf;

/// Seeds of streams begin so far behind that of the scene: packings have the first ones.
const STREAM_SEEDS: u64 = 1000;

/// Largest number of steps of a run.
const MOST_STEPS: f64 = 1e12;

/// The seed so far behind that of the scene: after the largest whole number of TOML comes 0, so that every
/// seed can be written out.
fn seed_behind(seed: u64, places: u64) -> u64 {
    seed.wrapping_add(places) & i64::MAX as u64
}

/// Reads a scene from its tree. Relative paths start at `folder`.
pub(crate) fn read(name: &str, root: &Node, folder: PathBuf) -> Result<Scene, SceneError> {
    let parameters = Parameters::new(root.get("parameters"), &folder)?;
    let mut context = Context { parameters, folder, names: Names::default(), time: TimeSpec::default() };
    context.names = Names::of(&Reader::of_scene(&context, root)?)?;
    let scene = Reader::of_scene(&context, root)?;
    let time = time(&scene.required_child("time")?)?;
    let seed: u64 = scene.field("seed")?;
    let mut materials: Vec<(String, MaterialSpec)> = scene.field("material")?;
    if materials.is_empty() {
        materials.push((names::DEFAULT_MATERIAL.to_string(), scene.defaults()?));
    }
    let pairs = pairs(&scene)?;
    let mut bodies: Vec<(String, BodySpec)> = Vec::new();
    for (name, reader) in scene.named("body")? {
        let spec = body(&reader, &bodies)?;
        bodies.push((name, spec));
    }
    let mut joints: Vec<(String, JointSpec)> = Vec::new();
    for (name, reader) in scene.named("robot")? {
        let robot = robot::read(&name, &reader)?;
        let is_known = |(new, _): &&(String, BodySpec)| bodies.iter().any(|(name, _)| name == new);
        if let Some((twice, _)) = robot.bodies.iter().find(is_known) {
            let problem = format!("there are two bodies `{twice}`: call the robot or the body otherwise");
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
        }
        bodies.extend(robot.bodies);
        joints.extend(robot.joints);
    }
    context.time = time.clone();
    context.names.bodies = bodies.iter().map(|(name, _)| name.clone()).collect();
    let scene = Reader::of_scene(&context, root)?;
    let packings = scene
        .named("packing")?
        .into_iter()
        .enumerate()
        .map(|(index, (name, reader))| Ok((name, packing(&reader, seed_behind(seed, index as u64))?)))
        .collect::<Result<Vec<_>, SceneError>>()?;
    let loads = scene.field("load")?;
    for (name, reader) in scene.named("joint")? {
        if joints.iter().any(|(known, _)| *known == name) {
            let problem = format!("there are two joints `{name}`, one of a robot: call this one otherwise");
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
        }
        let spec = joint::read(&reader, &joints)?;
        joints.push((name, spec));
    }
    let periodic = scene.child("periodic")?.map(|reader| periodic::read(&reader)).transpose()?;
    let stages = stage::read(&scene)?;
    let drives = |stage: &&StageSpec| stage.periodic.is_some() && periodic.is_none();
    if let Some(stage) = stages.iter().find(drives) {
        let problem =
            format!("the stage `{}` drives a periodic cell, but there is none: add `[periodic]`", stage.name);
        return Err(SceneError::at(SceneErrorKind::Contradiction(problem), &stage.location));
    }
    context.names.stages = stages.iter().map(|stage: &StageSpec| stage.name.clone()).collect();
    let scene = Reader::of_scene(&context, root)?;
    let streams = scene
        .named("stream")?
        .into_iter()
        .enumerate()
        .map(|(index, (name, reader))| {
            let seed = seed_behind(seed, STREAM_SEEDS + index as u64);
            Ok((name, stream::read(&reader, seed)?))
        })
        .collect::<Result<Vec<_>, SceneError>>()?;
    let outlets = scene
        .named("outlet")?
        .into_iter()
        .map(|(name, reader)| Ok((name, stream::read_outlet(&reader)?)))
        .collect::<Result<Vec<_>, SceneError>>()?;
    let measures = scene
        .named("measure")?
        .into_iter()
        .map(|(name, reader)| {
            // The name is that of a file.
            if !is_file_name(&name) {
                let requirement = "a name of letters, digits, `-`, `_` and `.`, which is that of a file";
                return Err(scene.out_of_range("measure", requirement, format!("`{name}`")));
            }
            Ok((name, measure::read(&reader)?))
        })
        .collect::<Result<Vec<_>, SceneError>>()?;
    stage::check_ends(&stages, &streams, &measures)?;
    Ok(Scene {
        name: name.to_string(),
        title: scene.text("title")?.unwrap_or_else(|| name.to_string()),
        seed,
        gravity: scene.field("gravity")?,
        parameters: context.parameters.listing(),
        contact: scene.field_or_defaults("contact")?,
        periodic,
        solver: solver::read(scene.child("solver")?)?,
        output: scene.field_or_defaults("output")?,
        time,
        materials,
        pairs,
        bodies,
        packings,
        streams,
        outlets,
        loads,
        joints,
        stages,
        measures,
    })
}

fn time(reader: &Reader) -> Result<TimeSpec, SceneError> {
    let step: f64 = reader.field("step")?;
    let steps = match reader.which()? {
        "steps" => reader.field("steps")?,
        _ => {
            let end: f64 = reader.field("end")?;
            let ratio = end / step;
            if ratio > MOST_STEPS {
                return Err(reader.out_of_range("end", "at most 1e12 steps", format!("{ratio:.3e} steps")));
            }
            // Whole steps up to round-off: 2 s in steps of 0.1 s are 20, not 21.
            ((ratio * (1.0 - 1e-12)).ceil() as u64).max(1)
        }
    };
    Ok(TimeSpec { step, steps })
}

fn pairs(scene: &Reader) -> Result<Vec<PairSpec>, SceneError> {
    let mut pairs: Vec<PairSpec> = Vec::new();
    for reader in scene.tables("pair")? {
        let pair = PairSpec::read(&reader)?;
        let [first, second] = &pair.materials;
        let swapped = [second.clone(), first.clone()];
        if pairs.iter().any(|known| known.materials == pair.materials || known.materials == swapped) {
            let problem = format!("the pair {first} and {second} is given twice");
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
        }
        pairs.push(pair);
    }
    Ok(pairs)
}

/// Reads a body; `known` are those above it.
fn body(reader: &Reader, known: &[(String, BodySpec)]) -> Result<BodySpec, SceneError> {
    let parts = match reader.which()? {
        "shape" => vec![PartSpec {
            shape: reader.field("shape")?,
            position: Vec3::ZERO,
            rotation: RotationSpec(Quat::IDENTITY),
        }],
        _ => reader.field("parts")?,
    };
    reader.check_alternatives()?;
    let position = reader.field("position")?;
    let inertia = reader.vector("inertia")?;
    if inertia.is_some() && reader.get("mass").is_none() {
        return Err(reader.missing("mass"));
    }
    let [products, centre] = [reader.vector("products")?, reader.vector("centre")?];
    if inertia.is_none() && (parts.is_empty() || products.or(centre).is_some()) {
        return Err(reader.missing("inertia"));
    }
    let boundary = parts.iter().any(|part| part.shape.is_boundary());
    let motion = MotionSpec::of_body(reader, boundary)?;
    let above: Vec<&str> = known.iter().map(|(name, _)| name.as_str()).collect();
    if boundary && inertia.is_none() && motion.free != [false; 6] {
        let problem = format!(
            "`{}` has no mass (planes, and meshes that are not `solid`, are boundaries): it cannot be free unless mass and inertia are given",
            reader.path
        );
        return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
    }
    Ok(BodySpec {
        parts,
        material: names::material(reader)?,
        position,
        rotation: reader.field("rotation")?,
        velocity: reader.field("velocity")?,
        angular_velocity: reader.field("angular_velocity")?,
        mass: reader.quantity("mass")?,
        inertia,
        products,
        centre,
        density: reader.quantity("density")?,
        motion,
        ignores: names::list(reader, "ignores", "body above this one", &above)?,
        location: reader.location().clone(),
    })
}

fn packing(reader: &Reader, default_seed: u64) -> Result<PackingSpec, SceneError> {
    let (form, inner) = reader.form()?;
    let source = match form {
        "lattice" => PackingSource::Lattice(LatticeSpec::read(&inner)?),
        "drop" => {
            let region = region(&inner)?;
            PackingSource::Drop(DropSpec { count: inner.field("count")?, region })
        }
        "poisson" => {
            let distance = inner.field("distance")?;
            PackingSource::Poisson(PoissonSpec { distance, region: region(&inner)? })
        }
        _ => PackingSource::File(FileSpec::read(&inner)?),
    };
    let form = reader.at_most_one_of(&["shape", "parts"])?;
    if let (PackingSource::File(_), Some(form)) = (&source, form) {
        let problem = format!("a packing from a file holds spheres: it takes no `{form}`");
        return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
    }
    let grains = match source {
        PackingSource::File(_) => grains_of(reader)?,
        _ => grains(reader)?,
    };
    let seed = reader.count("seed")?.unwrap_or(default_seed);
    Ok(PackingSpec { source, grains, seed, location: reader.location().clone() })
}

/// The bodies of a packing or a stream, whose size the scene has to name.
pub(super) fn grains(reader: &Reader) -> Result<GrainSpec, SceneError> {
    match reader.at_most_one_of(&["radius", "shape", "parts"])? {
        Some(_) => grains_of(reader),
        None => Err(reader.missing("radius")),
    }
}

/// The same where a file may have the sizes.
fn grains_of(reader: &Reader) -> Result<GrainSpec, SceneError> {
    let size = reader.at_most_one_of(&["radius", "shape", "parts"])?;
    let shape: Option<ShapeSpec> = reader.field("shape")?;
    let parts: Vec<PartSpec> = reader.field("parts")?;
    for (key, shape) in
        shape.iter().map(|shape| ("shape", shape)).chain(parts.iter().map(|part| ("parts", &part.shape)))
    {
        // Meshes do not touch each other.
        if matches!(shape, ShapeSpec::Plane { .. } | ShapeSpec::Mesh(_)) {
            return Err(reader.out_of_range(key, "a shape with volume", "a plane or mesh"));
        }
    }
    if size == Some("parts") && parts.is_empty() {
        return Err(reader.out_of_range("parts", "at least one part", "none"));
    }
    Ok(GrainSpec {
        radius: radius(reader)?,
        shape,
        parts,
        random_rotation: reader.field("random_rotation")?,
        material: names::material(reader)?,
        velocity: reader.field("velocity")?,
        lock_rotation: reader.field("lock_rotation")?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn a_scene_with_the_largest_seed_is_read_again_as_written_out() {
        let region = "region = { box = { min = [0, 0, 9], max = [1, 1, 10] } }";
        let text = format!(
            "seed = 9223372036854775807\n[time]\nstep = 1\nsteps = 1\n[packing.a]\nradius = 0.1\nlattice = {{ counts = [1, 1, 1], pitch = 1 \
             }}\n[packing.b]\nradius = 0.1\nlattice = {{ counts = [1, 1, 1], pitch = 1 }}\n[stream.c]\nradius = 0.1\ncount = 1\n{region}\n"
        );
        let parse = |text: &str| Scene::parse("a", "a.toml", text, Path::new(""), &[]).unwrap();
        let scene = parse(&text);
        let again = parse(&scene.to_toml().unwrap());
        let seeds = |scene: &Scene| (scene.packings[1].1.seed, scene.streams[0].1.seed);
        assert_eq!((seeds(&again), seeds(&scene)), ((0, 999), (0, 999)));
    }
}
