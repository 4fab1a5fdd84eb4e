//! A TOML document as a tree in which every key and value knows where it is written, edited by
//! `--set KEY=VALUE`.

use super::error::{Location, SceneError, SceneErrorKind, Source, closest};
use super::schema;
use std::ops::Range;
use std::sync::Arc;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A value and where it is written.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub value: Value,
    pub location: Location,
}

/// A TOML value. Tables keep the order of the text.
#[derive(Clone, Debug)]
pub(crate) enum Value {
    Table(Vec<Entry>),
    Array(Vec<Node>),
    Text(String),
    Integer(i64),
    Float(f64),
    Boolean(bool),
}

/// A key of a table with its value.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub key: String,
    pub key_location: Location,
    pub node: Node,
}

impl Node {
    /// For messages: "the text \"abc\"", "a table".
    pub fn describe(&self) -> String {
        match &self.value {
            Value::Table(_) => "a table".into(),
            Value::Array(items) => format!("a list of {}", items.len()),
            Value::Text(text) => format!("the text \"{text}\""),
            Value::Integer(number) => format!("{number}"),
            Value::Float(number) => format!("{number}"),
            Value::Boolean(flag) => format!("{flag}"),
        }
    }

    /// The entries, if this is a table.
    pub fn entries(&self) -> Option<&[Entry]> {
        match &self.value {
            Value::Table(entries) => Some(entries),
            _ => None,
        }
    }

    /// The value of a key, if this is a table that has it.
    pub fn get(&self, key: &str) -> Option<&Node> {
        self.entries()?.iter().find(|entry| entry.key == key).map(|entry| &entry.node)
    }
}

/// Parses a whole file.
pub(crate) fn parse(source: Arc<Source>) -> Result<Node, SceneError> {
    let document = DeTable::parse(&source.text).map_err(|error| syntax_error(&error, &source, 0))?;
    let converter = Converter { source: &source, offset: 0 };
    let span = document.span();
    converter.table(document.into_inner(), span)
}

fn syntax_error(error: &toml::de::Error, source: &Arc<Source>, offset: usize) -> SceneError {
    let span = error.span().map_or(0..0, |span| span.start + offset..span.end + offset);
    SceneError::at(
        SceneErrorKind::Syntax(error.message().trim().replace('\n', ", ")),
        &Location { source: source.clone(), span },
    )
}

struct Converter<'a> {
    source: &'a Arc<Source>,
    /// Where the parsed text starts in the source.
    offset: usize,
}

impl Converter<'_> {
    fn location(&self, span: Range<usize>) -> Location {
        Location { source: self.source.clone(), span: span.start + self.offset..span.end + self.offset }
    }

    fn table(&self, table: DeTable<'_>, span: Range<usize>) -> Result<Node, SceneError> {
        let mut entries = table
            .into_iter()
            .map(|(key, value)| {
                Ok(Entry {
                    key_location: self.location(key.span()),
                    key: key.into_inner().into_owned(),
                    node: self.value(value)?,
                })
            })
            .collect::<Result<Vec<_>, SceneError>>()?;
        entries.sort_by_key(|entry| entry.key_location.span.start);
        Ok(Node { value: Value::Table(entries), location: self.location(span) })
    }

    fn value(&self, value: Spanned<DeValue<'_>>) -> Result<Node, SceneError> {
        let span = value.span();
        let location = self.location(span.clone());
        let value = match value.into_inner() {
            DeValue::Table(table) => return self.table(table, span),
            DeValue::Array(items) => {
                Value::Array(items.into_iter().map(|item| self.value(item)).collect::<Result<_, _>>()?)
            }
            DeValue::String(text) => Value::Text(text.into_owned()),
            DeValue::Boolean(flag) => Value::Boolean(flag),
            DeValue::Integer(number) => {
                Value::Integer(i64::from_str_radix(number.as_str(), number.radix()).map_err(|_| {
                    let problem = format!("the number {} is too large", number.as_str());
                    SceneError::at(SceneErrorKind::Syntax(problem), &location)
                })?)
            }
            DeValue::Float(number) => Value::Float(number.as_str().parse().map_err(|_| {
                let problem = format!("`{}` is not a number", number.as_str());
                SceneError::at(SceneErrorKind::Syntax(problem), &location)
            })?),
            DeValue::Datetime(_) => {
                let problem = "a scene holds no dates".to_string();
                return Err(SceneError::at(SceneErrorKind::Syntax(problem), &location));
            }
        };
        Ok(Node { value, location })
    }
}

/// Applies one `--set KEY=VALUE` to the tree.
///
/// A key without dots that names a declared parameter sets that parameter. The value is read as TOML; what is
/// not valid TOML is a text, so that quotes are not needed: `--set time.step=25 ms`.
pub(crate) fn set(root: &mut Node, key: &str, value: &str) -> Result<(), SceneError> {
    let source = Arc::new(Source { name: "--set".into(), text: format!("{key}={value}") });
    let location = |span| Location { source: source.clone(), span };
    let fail = |problem: String, span| SceneError::at(SceneErrorKind::Override(problem), &location(span));
    let parts = split_key(key);
    if parts.iter().any(|(part, _)| part.is_empty()) {
        return Err(fail(format!("`{key}` is not a dotted key such as `time.step`"), 0..key.len()));
    }
    let parameters: Vec<&str> = root
        .get("parameters")
        .and_then(Node::entries)
        .map(|entries| entries.iter().map(|entry| entry.key.as_str()).collect())
        .unwrap_or_default();
    let mut path: Vec<(String, Range<usize>)> = parts;
    let top_level = schema::SCENE.names();
    let names_parameter = match path.as_slice() {
        [(only, span)] if parameters.contains(&only.as_str()) => Some((only.clone(), span.clone())),
        [(only, span)] if !top_level.contains(&only.as_str()) => {
            let known = parameters.iter().copied().chain(top_level.iter().copied());
            return Err(SceneError::at(
                SceneErrorKind::UnknownKey {
                    key: only.clone(),
                    table: "the scene and its parameters".into(),
                    closest: path_to(root, only).or_else(|| closest(only, known.clone())),
                    known: known.collect::<Vec<_>>().join(", "),
                },
                &location(span.clone()),
            ));
        }
        [(first, _), (name, span)] if first == "parameters" && !parameters.contains(&name.as_str()) => {
            return Err(SceneError::at(
                SceneErrorKind::UnknownKey {
                    key: name.clone(),
                    table: "`parameters`".into(),
                    closest: closest(name, parameters.iter().copied()),
                    known: parameters.join(", "),
                },
                &location(span.clone()),
            ));
        }
        _ => None,
    };
    if let Some(name) = names_parameter {
        path = vec![("parameters".into(), 0..0), name];
    }
    let value = value_node(&source, key.len() + 1)?;
    insert(root, &path, &source, value).map_err(|(problem, span)| fail(problem, span))
}

/// The dotted path of the first table in the scene that has the key, where no list has to be entered for it.
fn path_to(node: &Node, key: &str) -> Option<String> {
    node.entries()?.iter().find_map(|entry| {
        if entry.key == key {
            return Some(key.to_string());
        }
        path_to(&entry.node, key).map(|rest| format!("{}.{rest}", entry.key))
    })
}

/// The dotted key's parts with their spans.
fn split_key(key: &str) -> Vec<(String, Range<usize>)> {
    let mut start = 0;
    key.split('.')
        .map(|part| {
            let span = start..start + part.len();
            start = span.end + 1;
            (part.trim().to_string(), span)
        })
        .collect()
}

fn value_node(source: &Arc<Source>, offset: usize) -> Result<Node, SceneError> {
    let text = &source.text[offset..];
    let converter = Converter { source, offset };
    if let Ok(value) = DeValue::parse(text)
        && !value.get_ref().is_datetime()
    {
        return converter.value(value);
    }
    Ok(Node { value: Value::Text(text.trim().to_string()), location: converter.location(0..text.len()) })
}

fn insert(
    root: &mut Node,
    path: &[(String, Range<usize>)],
    source: &Arc<Source>,
    value: Node,
) -> Result<(), (String, Range<usize>)> {
    let mut node = root;
    let mut walked: Vec<&str> = Vec::new();
    for (index, (part, span)) in path.iter().enumerate() {
        let is_last = index + 1 == path.len();
        let parent = walked.join(".");
        walked.push(part);
        let location = Location { source: source.clone(), span: span.clone() };
        node = match &mut node.value {
            Value::Table(entries) => {
                let is_new = entries.iter().all(|entry| entry.key != *part);
                if is_last || is_new {
                    let alternatives = schema::alternatives(&parent, part);
                    entries.retain(|entry| !alternatives.contains(&entry.key.as_str()));
                }
                let position = entries.iter().position(|entry| entry.key == *part);
                let position = position.unwrap_or_else(|| {
                    entries.push(Entry {
                        key: part.clone(),
                        key_location: location.clone(),
                        node: Node { value: Value::Table(Vec::new()), location: location.clone() },
                    });
                    entries.len() - 1
                });
                if is_last {
                    entries[position].key_location = location;
                }
                &mut entries[position].node
            }
            Value::Array(items) => {
                let count = items.len();
                part.parse().ok().and_then(|item: usize| items.get_mut(item)).ok_or_else(|| {
                    (
                        format!("`{parent}` is a list of {count}: `{part}` is not one of its items"),
                        span.clone(),
                    )
                })?
            }
            _ => return Err((format!("`{parent}` holds a value, not a table"), span.clone())),
        };
    }
    *node = value;
    Ok(())
}
