//! The `[parameters]` of a scene: numbers, quantities and texts that expressions and `${name}` refer to.

use super::error::{Location, SceneError, SceneErrorKind, closest};
use super::expression::{ExpressionError, Names, Term, compile, evaluate, is_name, is_reserved};
use super::mesh_file;
use super::quantity::Quantity;
use super::tree::{Entry, Node, Value};
use graintrain::math::Vec3;
use std::cell::RefCell;
use std::path::{Path, PathBuf};

/// Parameters that refer to each other in longer chains than this are refused.
const LONGEST_CHAIN: usize = 32;

/// Name of the source of values from the command line.
pub(crate) const COMMAND_LINE: &str = "--set";

/// All parameters of a scene, evaluated.
pub(crate) struct Parameters {
    entries: Vec<Entry>,
    /// Where relative paths start.
    folder: PathBuf,
    /// One per entry; an error for texts that are no expression, reported only where an expression uses them.
    values: Vec<Result<Quantity, SceneError>>,
}

/// A text after `${name}` were replaced.
pub(crate) struct Interpolated {
    pub value: String,
    /// Whether its beginning was typed on the command line.
    pub from_command_line: bool,
}

impl Parameters {
    /// Evaluates the table of parameters (absent: there are none). Relative paths start at `folder`, those of
    /// the command line where the program runs.
    pub fn new(table: Option<&Node>, folder: &Path) -> Result<Self, SceneError> {
        let entries = match table {
            None => Vec::new(),
            Some(node) => node.entries().map(<[Entry]>::to_vec).ok_or_else(|| {
                SceneError::at(
                    SceneErrorKind::WrongType {
                        key: "parameters".into(),
                        expected: "a table".into(),
                        found: node.describe(),
                    },
                    &node.location,
                )
            })?,
        };
        for entry in &entries {
            let problem = if !is_name(&entry.key) {
                "is not a name: letters, digits and `_` only"
            } else if is_reserved(&entry.key) {
                "already means a unit, a function or a constant: choose another name"
            } else if matches!(entry.node.value, Value::Table(_) | Value::Array(_) | Value::Boolean(_)) {
                "must hold a number or a text"
            } else {
                continue;
            };
            let problem = format!("the parameter `{}` {problem}", entry.key);
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), &entry.key_location));
        }
        let evaluation = Evaluation {
            entries: &entries,
            folder,
            state: RefCell::new(vec![State::Untouched; entries.len()]),
            depth: RefCell::new(0),
        };
        let values = (0..entries.len()).map(|index| evaluation.resolve(index)).collect();
        Ok(Self { entries, folder: folder.to_path_buf(), values })
    }

    /// Names and values as written, for people.
    pub fn listing(&self) -> Vec<(String, String)> {
        let texts = self.entries.iter().map(|entry| (entry.key.clone(), as_text(&entry.node)));
        texts.collect()
    }

    /// The parameters that an expression names, as written: ", with `r` = 5 kg"; nothing without any.
    pub fn named_in(&self, text: &str) -> String {
        let words: Vec<&str> = text.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
        let named = self.entries.iter().filter(|entry| words.contains(&entry.key.as_str()));
        named.map(|entry| format!(", with `{}` = {}", entry.key, as_text(&entry.node))).collect()
    }

    /// Evaluates an expression written at `location`.
    pub fn evaluate(&self, text: &str, location: &Location) -> Result<Quantity, SceneError> {
        let lookup = Lookup { parameters: self, failed: RefCell::new(None) };
        evaluate(text, &lookup).map_err(|error| {
            lookup.failed.into_inner().unwrap_or_else(|| expression_error(text, error, location))
        })
    }

    /// Compiles a function of time written at `location`.
    pub fn compile(&self, text: &str, location: &Location) -> Result<Term, SceneError> {
        let lookup = Lookup { parameters: self, failed: RefCell::new(None) };
        compile(text, &lookup).map_err(|error| {
            lookup.failed.into_inner().unwrap_or_else(|| expression_error(text, error, location))
        })
    }

    /// Replaces `${name}` by the text of the parameter.
    pub fn interpolate(&self, text: &str, location: &Location) -> Result<Interpolated, SceneError> {
        let mut from_command_line = location.source.name == COMMAND_LINE;
        let mut value = String::new();
        let mut rest = text;
        while let Some(start) = rest.find("${") {
            let fail = |problem: String| {
                let kind = SceneErrorKind::Expression { text: text.into(), problem };
                SceneError::at(kind, location)
            };
            value.push_str(&rest[..start]);
            let after = &rest[start + 2..];
            let end = after.find('}').ok_or_else(|| fail("`${` is not closed by `}`".into()))?;
            let name = &after[..end];
            let entry = self.entries.iter().find(|entry| entry.key == name).ok_or_else(|| {
                match closest(name, self.entries.iter().map(|entry| entry.key.as_str())) {
                    Some(closest) => fail(format!("no parameter `{name}`; did you mean `{closest}`?")),
                    None => fail(format!("no parameter `{name}`")),
                }
            })?;
            if value.is_empty() {
                from_command_line |= entry.node.location.source.name == COMMAND_LINE;
            }
            value.push_str(&as_text(&entry.node));
            rest = &after[end + 1..];
        }
        value.push_str(rest);
        Ok(Interpolated { value, from_command_line })
    }
}

/// Least and greatest coordinates in the file of triangles that a parameter names.
fn corners(entries: &[Entry], folder: &Path, name: &str) -> Option<Result<[Vec3; 2], String>> {
    let node = &entries.iter().find(|entry| entry.key == name)?.node;
    let Value::Text(text) = &node.value else { return Some(Err(format!("`{name}` names no file"))) };
    let path = match node.location.source.name == COMMAND_LINE {
        true => PathBuf::from(text),
        false => folder.join(text),
    };
    let problem = |problem: String| {
        format!("{}: {problem}; name another file of triangles with --set {name}=FILE", path.display())
    };
    let read = std::fs::read(&path).map_err(|error| problem(error.to_string()));
    let read = read.and_then(|bytes| mesh_file::read(&path, &bytes).map_err(|error| problem(error.problem)));
    Some(read.map(|mesh| {
        mesh.vertices.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], &corner| {
            [low.min(corner), high.max(corner)]
        })
    }))
}

fn as_text(node: &Node) -> String {
    match &node.value {
        Value::Text(text) => text.clone(),
        _ => node.describe(),
    }
}

/// The error with its place inside the quoted text where that can be reported.
fn expression_error(text: &str, error: ExpressionError, location: &Location) -> SceneError {
    let written = location.source.text.get(location.span.clone()).unwrap_or("");
    let span = match written.find(text).filter(|_| !text.is_empty()) {
        Some(offset) => {
            let start = location.span.start + offset;
            start + error.span.start..start + error.span.end
        }
        None => location.span.clone(),
    };
    let kind = SceneErrorKind::Expression { text: text.into(), problem: error.problem };
    SceneError::at(kind, &Location { source: location.source.clone(), span })
}

/// Finished parameters as the names of an expression.
struct Lookup<'a> {
    parameters: &'a Parameters,
    /// The error of a parameter that could not be used, which is to blame rather than the expression.
    failed: RefCell<Option<SceneError>>,
}

impl Names for Lookup<'_> {
    fn value(&self, name: &str) -> Option<Result<Quantity, String>> {
        let index = self.parameters.entries.iter().position(|entry| entry.key == name)?;
        Some(self.parameters.values[index].clone().map_err(|error| {
            let problem = error.kind.to_string();
            self.failed.replace(Some(error));
            problem
        }))
    }

    fn corners(&self, name: &str) -> Option<Result<[Vec3; 2], String>> {
        corners(&self.parameters.entries, &self.parameters.folder, name)
    }

    fn names(&self) -> Vec<&str> {
        self.parameters.entries.iter().map(|entry| entry.key.as_str()).collect()
    }
}

#[derive(Clone)]
enum State {
    Untouched,
    /// Being evaluated: meeting it again is a cycle.
    Open,
    Done(Result<Quantity, SceneError>),
}

/// Evaluation of parameters in terms of each other, in any order.
struct Evaluation<'a> {
    entries: &'a [Entry],
    folder: &'a Path,
    state: RefCell<Vec<State>>,
    depth: RefCell<usize>,
}

impl Evaluation<'_> {
    fn resolve(&self, index: usize) -> Result<Quantity, SceneError> {
        let entry = &self.entries[index];
        let fail = |problem: &str| {
            let kind = SceneErrorKind::Expression { text: as_text(&entry.node), problem: problem.into() };
            Err(SceneError::at(kind, &entry.node.location))
        };
        let state = self.state.borrow()[index].clone();
        match state {
            State::Done(result) => return result,
            State::Open => return fail("the parameter is defined by itself"),
            State::Untouched => {}
        }
        if *self.depth.borrow() >= LONGEST_CHAIN {
            return fail("parameters refer to each other in too long a chain");
        }
        self.state.borrow_mut()[index] = State::Open;
        *self.depth.borrow_mut() += 1;
        let result = match &entry.node.value {
            Value::Integer(number) => Ok(Quantity::number(*number as f64)),
            Value::Float(number) => Ok(Quantity::number(*number)),
            Value::Text(text) => {
                evaluate(text, self).map_err(|error| expression_error(text, error, &entry.node.location))
            }
            _ => fail("it must hold a number or a text"),
        };
        *self.depth.borrow_mut() -= 1;
        self.state.borrow_mut()[index] = State::Done(result.clone());
        result
    }
}

impl Names for Evaluation<'_> {
    fn value(&self, name: &str) -> Option<Result<Quantity, String>> {
        let index = self.entries.iter().position(|entry| entry.key == name)?;
        Some(self.resolve(index).map_err(|error| error.kind.to_string()))
    }

    fn corners(&self, name: &str) -> Option<Result<[Vec3; 2], String>> {
        corners(self.entries, self.folder, name)
    }

    fn names(&self) -> Vec<&str> {
        self.entries.iter().map(|entry| entry.key.as_str()).collect()
    }
}
