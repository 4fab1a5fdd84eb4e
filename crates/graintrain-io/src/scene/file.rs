//! From the tree of a scene file to a [`Scene`] in which every value is resolved.

use super::error::{SceneError, SceneErrorKind};
use super::joint::{self, JointSpec};
use super::measure::{self, MeasureSpec};
use super::model::*;
use super::names::{self, Names};
use super::parameters::Parameters;
use super::reader::{Context, Reader};
use super::robot;
use super::solver::SolverKeys;
use super::stage::{self, StageSpec};
use super::table::Spec;
use super::tree::Node;
use super::{PeriodicSpec, Scene, StreamSpec};
use crate::files::is_file_name;
use std::path::PathBuf;

/// Reads a scene from its tree. Relative paths start at `folder`.
pub(crate) fn read(name: &str, root: &Node, folder: PathBuf) -> Result<Scene, SceneError> {
    let parameters = Parameters::new(root.get("parameters"), &folder)?;
    let (names, time) = (Names::default(), TimeSpec::default());
    let mut context = Context { parameters, folder, names, time, seed: 0 };
    context.names = Names::of(&Reader::of_scene(&context, root)?)?;
    let scene = Reader::of_scene(&context, root)?;
    let time: TimeSpec = scene.field("time")?;
    let seed: u64 = scene.field("seed")?;
    let mut materials: Vec<(String, MaterialSpec)> = scene.field("material")?;
    if materials.is_empty() {
        materials.push((names::DEFAULT_MATERIAL.to_string(), scene.defaults()?));
    }
    let pairs = pairs(&scene)?;
    let mut bodies: Vec<(String, BodySpec)> = Vec::new();
    for (name, reader) in scene.named("body")? {
        let spec = BodySpec::read(&reader)?;
        let above: Vec<&str> = bodies.iter().map(|(name, _)| name.as_str()).collect();
        names::list(&reader, "ignores", "body above this one", &above)?;
        bodies.push((name, spec));
    }
    let mut joints = robots(&scene, &mut bodies)?;
    (context.time, context.seed) = (time.clone(), seed);
    context.names.bodies = bodies.iter().map(|(name, _)| name.clone()).collect();
    let scene = Reader::of_scene(&context, root)?;
    let packings = scene.field("packing")?;
    let loads = scene.field("load")?;
    for (name, reader) in scene.named("joint")? {
        if joints.iter().any(|(known, _)| *known == name) {
            let problem = format!("there are two joints `{name}`, one of a robot: call this one otherwise");
            return Err(reader.refuse(problem));
        }
        let spec = joint::read(&reader, &joints)?;
        joints.push((name, spec));
    }
    let periodic: Option<PeriodicSpec> = scene.field("periodic")?;
    let stages = stage::read(&scene)?;
    let drives = |stage: &&StageSpec| stage.periodic.is_some() && periodic.is_none();
    if let Some(stage) = stages.iter().find(drives) {
        let problem =
            format!("the stage `{}` drives a periodic cell, but there is none: add `[periodic]`", stage.name);
        return Err(SceneError::at(SceneErrorKind::Contradiction(problem), &stage.location));
    }
    context.names.stages = stages.iter().map(|stage: &StageSpec| stage.name.clone()).collect();
    let scene = Reader::of_scene(&context, root)?;
    let streams: Vec<(String, StreamSpec)> = scene.field("stream")?;
    let outlets = scene.field("outlet")?;
    let measures = measures(&scene)?;
    stage::check_ends(&stages, &streams, &measures)?;
    Ok(Scene {
        name: name.to_string(),
        title: scene.text("title")?.unwrap_or_else(|| name.to_string()),
        seed,
        gravity: scene.field("gravity")?,
        parameters: context.parameters.listing(),
        contact: scene.field_or_defaults("contact")?,
        periodic,
        solver: scene.field_or_defaults::<SolverKeys>("solver")?.into(),
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

/// Adds the bodies of robots; returned are their joints.
fn robots(
    scene: &Reader,
    bodies: &mut Vec<(String, BodySpec)>,
) -> Result<Vec<(String, JointSpec)>, SceneError> {
    let mut joints = Vec::new();
    for (name, reader) in scene.named("robot")? {
        let robot = robot::read(&name, &reader)?;
        let is_known = |(new, _): &&(String, BodySpec)| bodies.iter().any(|(name, _)| name == new);
        if let Some((twice, _)) = robot.bodies.iter().find(is_known) {
            let problem = format!("there are two bodies `{twice}`: call the robot or the body otherwise");
            return Err(reader.refuse(problem));
        }
        bodies.extend(robot.bodies);
        joints.extend(robot.joints);
    }
    Ok(joints)
}

fn measures(scene: &Reader) -> Result<Vec<(String, MeasureSpec)>, SceneError> {
    let one = |(name, reader): (String, Reader)| {
        // The name is that of a file.
        if !is_file_name(&name) {
            let requirement = "a name of letters, digits, `-`, `_` and `.`, which is that of a file";
            return Err(scene.out_of_range("measure", requirement, format!("`{name}`")));
        }
        Ok((name, measure::read(&reader)?))
    };
    scene.named("measure")?.into_iter().map(one).collect()
}

fn pairs(scene: &Reader) -> Result<Vec<PairSpec>, SceneError> {
    let mut pairs: Vec<PairSpec> = Vec::new();
    for reader in scene.tables("pair")? {
        let pair = PairSpec::read(&reader)?;
        let [first, second] = &pair.materials;
        let swapped = [second.clone(), first.clone()];
        if pairs.iter().any(|known| known.materials == pair.materials || known.materials == swapped) {
            return Err(reader.refuse(format!("the pair {first} and {second} is given twice")));
        }
        pairs.push(pair);
    }
    Ok(pairs)
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
