//! What a scene has names for, and keys that name it.

use super::error::SceneError;
use super::reader::Reader;

/// Name of the material of scenes that declare none.
pub(super) const DEFAULT_MATERIAL: &str = "default";

/// Names of what a scene has.
#[derive(Default)]
pub(crate) struct Names {
    pub materials: Vec<String>,
    /// Once they are read: files of robots have bodies as well.
    pub bodies: Vec<String>,
    pub packings: Vec<String>,
    pub streams: Vec<String>,
    pub loads: Vec<String>,
    /// Once they are read.
    pub stages: Vec<String>,
    pub measures: Vec<String>,
}

impl Names {
    /// Those that a scene shows before its tables are read.
    pub fn of(scene: &Reader) -> Result<Self, SceneError> {
        let of = |key: &str| -> Result<Vec<String>, SceneError> {
            Ok(scene.named(key)?.into_iter().map(|(name, _)| name).collect())
        };
        let materials = of("material")?;
        Ok(Self {
            materials: if materials.is_empty() { vec![DEFAULT_MATERIAL.into()] } else { materials },
            bodies: Vec::new(),
            packings: of("packing")?,
            streams: of("stream")?,
            loads: of("load")?,
            stages: Vec::new(),
            measures: of("measure")?,
        })
    }
}

/// Refuses a name that is not known.
pub(super) fn check(
    reader: &Reader,
    key: &str,
    what: &str,
    name: &str,
    known: &[impl AsRef<str>],
) -> Result<(), SceneError> {
    match known.iter().any(|known| known.as_ref() == name) {
        true => Ok(()),
        false => Err(reader.unknown_name(key, what, name, known.iter().map(AsRef::as_ref))),
    }
}

/// The list of names that a key holds, each of which has to be known; empty where it is not given.
pub(super) fn list(
    reader: &Reader,
    key: &str,
    what: &str,
    known: &[impl AsRef<str>],
) -> Result<Vec<String>, SceneError> {
    let names = reader.texts(key)?.unwrap_or_default();
    names.iter().try_for_each(|name| check(reader, key, what, name, known))?;
    Ok(names)
}

/// As [`list`] for a key that chooses: one that is given chooses something.
pub(super) fn chosen(
    reader: &Reader,
    key: &str,
    what: &str,
    known: &[impl AsRef<str>],
) -> Result<Vec<String>, SceneError> {
    let names = list(reader, key, what, known)?;
    if names.is_empty() && reader.get(key).is_some() {
        // Left out, the key means everything: a list that somebody's program left empty does not.
        return Err(reader.out_of_range(key, &format!("at least one {what}, or left out"), "none"));
    }
    Ok(names)
}

pub(super) fn bodies(reader: &Reader, key: &str) -> Result<Vec<String>, SceneError> {
    chosen(reader, key, "body", &reader.context.names.bodies)
}

pub(super) fn packings(reader: &Reader, key: &str) -> Result<Vec<String>, SceneError> {
    chosen(reader, key, "packing", &reader.context.names.packings)
}

pub(super) fn streams(reader: &Reader, key: &str) -> Result<Vec<String>, SceneError> {
    chosen(reader, key, "stream", &reader.context.names.streams)
}

/// Loads, of which there may be none.
pub(super) fn loads(reader: &Reader, key: &str) -> Result<Option<Vec<String>>, SceneError> {
    let loads: Option<Vec<String>> = reader.field(key)?;
    let known = &reader.context.names.loads;
    loads.iter().flatten().try_for_each(|name| check(reader, key, "load", name, known))?;
    Ok(loads)
}

/// The seed that a key holds; without it the seed so far behind that of the scene as the table stands behind
/// the first of these `names`, and `places` more. After the largest whole number of TOML comes 0, so that
/// every seed can be written out.
pub(super) fn seed(reader: &Reader, key: &str, names: &[String], places: u64) -> Result<u64, SceneError> {
    let own = reader.path.split_once('.').map_or("", |(_, name)| name);
    let number = names.iter().position(|name| name == own).unwrap_or(0) as u64;
    let behind = reader.context.seed.wrapping_add(places + number) & i64::MAX as u64;
    Ok(reader.count(key)?.unwrap_or(behind))
}

/// A body, which has to be given.
pub(super) fn body(reader: &Reader, key: &str) -> Result<String, SceneError> {
    let name: String = reader.field(key)?;
    check(reader, key, "body", &name, &reader.context.names.bodies)?;
    Ok(name)
}

/// A measurement, which has to be given.
pub(super) fn measure(reader: &Reader, key: &str) -> Result<String, SceneError> {
    let name: String = reader.field(key)?;
    check(reader, key, "measure", &name, &reader.context.names.measures)?;
    Ok(name)
}

/// A stage, if one is named.
pub(super) fn stage(reader: &Reader, key: &str) -> Result<Option<String>, SceneError> {
    let name: Option<String> = reader.field(key)?;
    name.iter().try_for_each(|name| check(reader, key, "stage", name, &reader.context.names.stages))?;
    Ok(name)
}

/// The material of a body or packing; the only one where it names none.
pub(super) fn material(reader: &Reader, key: &str) -> Result<String, SceneError> {
    let known = &reader.context.names.materials;
    match (reader.text(key)?, known.as_slice()) {
        (None, [only]) => Ok(only.clone()),
        (None, _) => Err(reader.missing(key)),
        (Some(name), _) => {
            check(reader, key, "material", &name, known)?;
            Ok(name)
        }
    }
}
