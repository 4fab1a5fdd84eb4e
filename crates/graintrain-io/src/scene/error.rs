//! What can be wrong with a scene, and where.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

/// A text that a scene was read from: the scene file itself or one `--set KEY=VALUE`.
#[derive(Debug, PartialEq, Eq)]
pub struct Source {
    /// File name, `sedimentation (built in)`, or `--set`.
    pub name: String,
    /// The whole text.
    pub text: String,
}

/// A stretch of a [`Source`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Location {
    /// The text.
    pub source: Arc<Source>,
    /// Byte range in it.
    pub span: Range<usize>,
}

impl Location {
    /// Line and column of the first character, both counted from 1; columns count characters.
    pub fn line_column(&self) -> (usize, usize) {
        let text = &self.source.text;
        let mut end = self.span.start.min(text.len());
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let before = &text[..end];
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().unwrap_or("").chars().count() + 1;
        (line, column)
    }
}

/// A scene that cannot be used: what is wrong, where it is written, and (by [`SceneError::help`]) what to do.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneError {
    /// What is wrong.
    pub kind: Box<SceneErrorKind>,
    /// Where it is written; `None` where nothing in a file is to blame.
    pub location: Option<Location>,
}

/// What is wrong with a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneErrorKind {
    /// Neither a file nor a built-in scene.
    #[error("no scene file and no built-in scene is called `{name}`")]
    UnknownScene {
        /// What was asked for.
        name: String,
        /// Built-in scene with the most similar name.
        closest: Option<String>,
    },
    /// A file cannot be read.
    #[error("cannot read `{path}`: {reason}")]
    UnreadableFile {
        /// Path as resolved.
        path: String,
        /// The system's reason.
        reason: String,
    },
    /// A file that the scene names (packing, mesh) is damaged or of another form than expected.
    #[error("`{path}`{}: {problem}", line.map(|line| format!(" line {line}")).unwrap_or_default())]
    MalformedFile {
        /// Path as resolved.
        path: String,
        /// Line, counted from 1, where known.
        line: Option<usize>,
        /// What is wrong.
        problem: String,
    },
    /// Not TOML.
    #[error("not valid TOML: {0}")]
    Syntax(String),
    /// `--set` without `=`, or one whose key leads nowhere.
    #[error("{0}")]
    Override(String),
    /// A key that no scene has.
    #[error("unknown key `{key}` in {table}")]
    UnknownKey {
        /// The key as written.
        key: String,
        /// Where it stands, for people: "the scene", "`time`".
        table: String,
        /// Most similar known key.
        closest: Option<String>,
        /// All known keys.
        known: String,
    },
    /// A key that must be there is not.
    #[error("{table} lacks `{key}`")]
    MissingKey {
        /// The key.
        key: String,
        /// Where it belongs.
        table: String,
        /// What it must hold.
        expected: String,
    },
    /// Two keys that exclude each other, or none of several that are needed.
    #[error("{table} needs exactly one of {keys}, got {found}")]
    OneOf {
        /// Where they belong.
        table: String,
        /// The choices.
        keys: String,
        /// What was found.
        found: String,
    },
    /// Another kind of value than expected.
    #[error("`{key}` must be {expected}, got {found}")]
    WrongType {
        /// Full dotted key.
        key: String,
        /// What was expected, with unit and example.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A quantity of another dimension than expected.
    #[error("`{key}` must be {expected}, got {found}")]
    WrongUnit {
        /// Full dotted key.
        key: String,
        /// Expected dimension and SI unit.
        expected: String,
        /// The SI unit; empty where none is expected.
        unit: String,
        /// Found dimension and SI unit.
        found: String,
    },
    /// A value that cannot be computed.
    #[error("cannot evaluate `{text}`: {problem}")]
    Expression {
        /// The expression.
        text: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A value outside of what is allowed.
    #[error("`{key}` must be {requirement}, got {found}")]
    OutOfRange {
        /// Full dotted key.
        key: String,
        /// What is allowed.
        requirement: String,
        /// What was found.
        found: String,
    },
    /// A name that refers to nothing.
    #[error("`{key}` names the {what} `{name}`, which does not exist")]
    UnknownName {
        /// Full dotted key.
        key: String,
        /// "material", "solver".
        what: String,
        /// The name.
        name: String,
        /// Most similar known name.
        closest: Option<String>,
        /// All known names.
        known: String,
    },
    /// Settings that contradict each other.
    #[error("{0}")]
    Contradiction(String),
    /// Random placement did not find room.
    #[error("packing `{packing}`: only {placed} of {wanted} bodies fit into the region without overlap")]
    NoRoom {
        /// Name of the packing.
        packing: String,
        /// Bodies placed.
        placed: usize,
        /// Bodies asked for.
        wanted: usize,
    },
    /// Bodies overlap at the start.
    #[error(
        "bodies overlap at the start: deepest pair {first} and {second}, by {depth:.3e} m, \
         more than the allowed {allowed:.3e} m"
    )]
    Overlap {
        /// One body.
        first: String,
        /// The other.
        second: String,
        /// Depth, m.
        depth: f64,
        /// Allowed depth, m.
        allowed: f64,
    },
    /// No bodies at all.
    #[error("the scene has no bodies")]
    NoBodies,
    /// Bodies, but none that can move freely.
    #[error("no body of the scene is free to move: nothing would happen")]
    NothingMoves,
}

impl SceneError {
    pub(crate) fn new(kind: SceneErrorKind, location: Option<Location>) -> Self {
        Self { kind: Box::new(kind), location }
    }

    pub(crate) fn at(kind: SceneErrorKind, location: &Location) -> Self {
        Self::new(kind, Some(location.clone()))
    }

    /// The error for a name that is no scene.
    pub fn unknown_scene(name: &str) -> Self {
        let names = super::builtin::SCENES.iter().map(|scene| scene.name);
        let kind = SceneErrorKind::UnknownScene { name: name.into(), closest: closest(name, names) };
        Self::new(kind, None)
    }

    /// What to do about it, where that can be said.
    pub fn help(&self) -> Option<String> {
        match &*self.kind {
            SceneErrorKind::UnknownScene { closest, .. } => Some(match closest {
                Some(closest) => {
                    format!("did you mean `{closest}`? `graintrain scenes` lists the built-in scenes")
                }
                None => "`graintrain scenes` lists the built-in scenes".to_string(),
            }),
            SceneErrorKind::UnreadableFile { .. } => {
                Some("give the path of a file, not of a folder, that is there and can be read".to_string())
            }
            SceneErrorKind::UnknownKey { closest, known, .. } => Some(match closest {
                Some(closest) => format!("did you mean `{closest}`? Known here: {known}"),
                None => format!("known here: {known}"),
            }),
            SceneErrorKind::UnknownName { closest, known, .. } => Some(match closest {
                Some(closest) => format!("did you mean `{closest}`? Known: {known}"),
                None => format!("known: {known}"),
            }),
            SceneErrorKind::MissingKey { key, expected, .. } => Some(format!("add `{key} = ...`: {expected}")),
            SceneErrorKind::WrongUnit { unit, .. } if unit.is_empty() => {
                Some("write a plain number".to_string())
            }
            SceneErrorKind::WrongUnit { unit, .. } => Some(format!(
                "write such a unit after the number, \"3 {unit}\"; plain numbers are SI: m, kg, s, rad"
            )),
            SceneErrorKind::NoRoom { .. } => {
                Some("enlarge the region, or ask for fewer or smaller bodies (random placement fills about a third)".to_string())
            }
            SceneErrorKind::Overlap { depth, .. } => Some(format!(
                "move the bodies apart; `contact.relax = true` moves those of packings, `contact.allowed_overlap = \"{:.2e} m\"` allows it",
                depth * 1.01
            )),
            SceneErrorKind::NoBodies => Some("add a [body.NAME] or a [packing.NAME]".to_string()),
            SceneErrorKind::NothingMoves => Some(
                "give a body a shape with volume and `motion = \"free\"`, or add a [packing.NAME]".to_string(),
            ),
            _ => None,
        }
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(location) = &self.location {
            let (line, column) = location.line_column();
            write!(f, "{}:{line}:{column}: ", location.source.name)?;
        }
        write!(f, "{}", self.kind)
    }
}

impl std::error::Error for SceneError {}

/// The candidate most similar to `word`, if it is similar enough to be a likely slip of the fingers.
pub fn closest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let longest_edit = (word.chars().count() / 3).max(1) + usize::from(word.chars().count() > 3);
    candidates
        .into_iter()
        .map(|candidate| (edit_distance(&word.to_lowercase(), &candidate.to_lowercase()), candidate))
        .filter(|(distance, _)| *distance <= longest_edit)
        .min()
        .map(|(_, candidate)| candidate.to_string())
}

/// Insertions, deletions, substitutions and swaps of neighbours that lead from one word to the other
/// (optimal string alignment distance).
fn edit_distance(first: &str, second: &str) -> usize {
    let a: Vec<char> = first.chars().collect();
    let b: Vec<char> = second.chars().collect();
    let mut before_last: Vec<usize> = vec![0; b.len() + 1];
    let mut last: Vec<usize> = (0..=b.len()).collect();
    for i in 1..=a.len() {
        let mut row = vec![i; b.len() + 1];
        for j in 1..=b.len() {
            let substitution = last[j - 1] + usize::from(a[i - 1] != b[j - 1]);
            row[j] = substitution.min(last[j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                row[j] = row[j].min(before_last[j - 2] + 1);
            }
        }
        before_last = last;
        last = row;
    }
    last[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edit_distance_counts_each_kind_of_edit() {
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("radius", "raduis"), 1);
        assert_eq!(edit_distance("stp", "step"), 1);
        assert_eq!(edit_distance("steps", "step"), 1);
        assert_eq!(edit_distance("kitten", "sitting"), 3);
    }

    #[test]
    fn closest_prefers_the_most_similar_and_refuses_the_unlike() {
        assert_eq!(closest("stp", ["end", "step", "steps"]).as_deref(), Some("step"));
        assert_eq!(closest("tolerence", ["tolerance", "name"]).as_deref(), Some("tolerance"));
        assert_eq!(closest("banana", ["step", "end"]), None);
    }

    #[test]
    fn lines_and_columns_count_from_one() {
        let source = Arc::new(Source { name: "a.toml".into(), text: "x = 1\nµ = 2\n".into() });
        let at = |start| Location { source: source.clone(), span: start..start + 1 }.line_column();
        assert_eq!(at(0), (1, 1));
        assert_eq!(at(6), (2, 1));
        assert_eq!(at(7), (2, 1), "inside a character counts as that character");
        assert_eq!(at(8), (2, 2));
        assert_eq!(at(1000), (3, 1));
    }
}
