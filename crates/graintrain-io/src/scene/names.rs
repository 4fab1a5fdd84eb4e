//! What a scene has names for, and keys that name it.

use super::error::SceneError;
use super::reader::Reader;

/// Names of what a scene has.
#[derive(Default)]
pub(crate) struct Names {
    pub bodies: Vec<String>,
}

/// The list of names that a key holds, each of which has to be known; empty where it is not given.
pub(super) fn list(
    reader: &Reader,
    key: &str,
    what: &str,
    known: &[impl AsRef<str>],
) -> Result<Vec<String>, SceneError> {
    let Some(names) = reader.texts(key)? else { return Ok(Vec::new()) };
    if names.is_empty() {
        // Left out, the key means everything: a list that somebody's program left empty does not.
        return Err(reader.missing(key));
    }
    names.iter().try_for_each(|name| check(reader, key, what, name, known))?;
    Ok(names)
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

/// Names of single bodies.
pub(super) fn bodies(reader: &Reader, key: &str) -> Result<Vec<String>, SceneError> {
    list(reader, key, "body", &reader.context.names.bodies)
}
