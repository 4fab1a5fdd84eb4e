//! Reads keys of one table: checks names against the schema, evaluates quantities, checks dimensions and
//! ranges.

use super::error::{Location, SceneError, SceneErrorKind, Source, closest};
use super::model::{FunctionSpec, TimeSpec};
use super::names::Names;
use super::parameters::Parameters;
use super::quantity::Dimension;
use super::schema::{self, Key, Kind, REQUIRED, Range, Table};
use super::table::{Field, Spec};
use super::tree::{self, Node, Value};
use graintrain::formula::Formula;
use graintrain::material::TurningResistance;
use graintrain::math::Vec3;
use graintrain::motion::Profile;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest count accepted: whatever is counted, more could not be held in memory.
const LARGEST_COUNT: f64 = 1e12;

/// What all readers of one scene share.
pub(crate) struct Context {
    pub parameters: Parameters,
    /// Folder that paths in the scene are relative to.
    pub folder: PathBuf,
    pub names: Names,
    /// Once they are read.
    pub time: TimeSpec,
    pub seed: u64,
}

/// A table of the scene with the keys that it may have.
#[derive(Clone)]
pub(crate) struct Reader<'a> {
    pub context: &'a Context,
    pub node: &'a Node,
    /// Dotted path of the table; empty for the scene.
    pub path: String,
    pub table: &'static Table,
}

impl<'a> Reader<'a> {
    /// A reader of the whole scene or of a table in it; unknown keys are errors.
    pub fn new(
        context: &'a Context,
        node: &'a Node,
        path: String,
        table: &'static Table,
    ) -> Result<Self, SceneError> {
        let reader = Self { context, node, path, table };
        let Some(entries) = node.entries() else {
            return Err(reader.wrong_type(&reader.path, "a table", node));
        };
        let unknown = entries.iter().filter(|entry| table.key(&entry.key).is_none());
        if let Some(entry) = unknown.min_by_key(|entry| entry.key_location.span.start) {
            let known = table.names();
            return Err(SceneError::at(
                SceneErrorKind::UnknownKey {
                    key: entry.key.clone(),
                    table: reader.label(),
                    closest: closest(&entry.key, known.iter().copied()),
                    known: known.join(", "),
                },
                &entry.key_location,
            ));
        }
        Ok(reader)
    }

    /// A reader of the whole scene.
    pub fn of_scene(context: &'a Context, root: &'a Node) -> Result<Self, SceneError> {
        Self::new(context, root, String::new(), &schema::SCENE)
    }

    /// Where the table is written.
    pub fn location(&self) -> &'a Location {
        &self.node.location
    }

    /// Where the first of these keys is written that is given, otherwise where the table is.
    pub fn location_of(&self, keys: &[&str]) -> &'a Location {
        keys.iter().find_map(|key| self.get(key)).map_or(self.location(), |node| &node.location)
    }

    /// The table's name for people.
    fn label(&self) -> String {
        if self.path.is_empty() { "the scene".into() } else { format!("`{}`", self.path) }
    }

    /// Dotted path of a key.
    pub fn full(&self, key: &str) -> String {
        if self.path.is_empty() { key.into() } else { format!("{}.{key}", self.path) }
    }

    /// The schema's entry. Every key that is asked for is in the schema; a reader that asked for another
    /// would find nothing, and the test of the documentation would not know it.
    fn key(&self, key: &str) -> &'static Key {
        self.table.key(key).unwrap_or_else(|| unreachable!("{} has no key {key}", self.table.heading))
    }

    /// What the key holds.
    pub fn kind(&self, key: &str) -> Kind {
        self.key(key).kind
    }

    /// The value of a key; where it is not given, that of its default.
    pub fn field<T: Field>(&self, key: &str) -> Result<T, SceneError> {
        if let Some(value) = T::given(self, key)? {
            return Ok(value);
        }
        let default = self.key(key).default;
        if default == REQUIRED {
            return Err(self.missing(key));
        }
        // What follows a colon explains the value.
        let text = format!("{key} = {}", default.split(": ").next().unwrap_or(default));
        let node = tree::parse(Arc::new(Source { name: String::new(), text }))
            .unwrap_or_else(|_| unreachable!("{key} of {}: {default} is no value", self.table.heading));
        let reader =
            Reader { context: self.context, node: &node, path: self.path.clone(), table: self.table };
        T::given(&reader, key)?.ok_or_else(|| self.missing(key))
    }

    /// What the table under a key says, or without one the defaults of its keys.
    pub fn field_or_defaults<T: Spec>(&self, key: &str) -> Result<T, SceneError> {
        self.child(key)?.map_or_else(|| self.defaults(), |inner| T::read(&inner))
    }

    /// What a table without keys says.
    pub fn defaults<T: Spec>(&self) -> Result<T, SceneError> {
        let node = Node { value: Value::Table(Vec::new()), location: self.location().clone() };
        T::read(&Reader { context: self.context, node: &node, path: self.path.clone(), table: T::TABLE })
    }

    /// The value of a key, if given.
    pub fn get(&self, key: &str) -> Option<&'a Node> {
        debug_assert!(self.table.key(key).is_some(), "{} has no key {key}", self.table.heading);
        self.node.get(key)
    }

    fn wrong_type(&self, path: &str, expected: &str, node: &Node) -> SceneError {
        SceneError::at(
            SceneErrorKind::WrongType { key: path.into(), expected: expected.into(), found: node.describe() },
            &node.location,
        )
    }

    /// What the key must hold, with its example.
    fn expectation(&self, key: &str) -> String {
        let key = self.key(key);
        let what = match key.kind {
            Kind::Quantity(dimension) | Kind::QuantityOr(dimension, _) => dimension.to_string(),
            Kind::Vector(Dimension::NONE) | Kind::Direction => "three numbers".into(),
            Kind::Vector(dimension) => format!("three times {dimension}"),
            Kind::VectorOrQuantity(dimension) => format!("{dimension}, or three times {dimension}"),
            Kind::List(Dimension::NONE) => "a list of numbers".into(),
            Kind::List(dimension) => format!("a list, each {dimension}"),
            Kind::RatioOrLength => "a number (of effective radii) or a length".into(),
            Kind::Count => "a whole number".into(),
            Kind::Counts => "three whole numbers".into(),
            Kind::Text => "a text".into(),
            Kind::Function(dimension, _) => format!("{dimension}, a text with the time t, or a table"),
            Kind::Functions(dimension, _) => {
                format!("three times {dimension}, a text with the time t, or a table")
            }
            Kind::TextOr(_) => "a text or a table".into(),
            Kind::Texts => "a list of texts".into(),
            Kind::Flag => "true or false".into(),
            Kind::Table(_) | Kind::Named(_) | Kind::Free => "a table".into(),
            Kind::Tables(_) => "a list of tables".into(),
            Kind::Rows => "a list of rows of three numbers".into(),
        };
        format!("{what}, e.g. {}", key.example)
    }

    /// The error for a key that must be there and is not.
    pub fn missing(&self, key: &str) -> SceneError {
        SceneError::at(
            SceneErrorKind::MissingKey {
                key: key.into(),
                table: self.label(),
                expected: self.expectation(key),
            },
            self.location(),
        )
    }

    /// The error for a value outside of what is allowed.
    pub fn out_of_range(&self, key: &str, requirement: &str, found: impl ToString) -> SceneError {
        let location = self.node.get(key).map_or(self.location(), |node| &node.location);
        SceneError::at(
            SceneErrorKind::OutOfRange {
                key: self.full(key),
                requirement: requirement.into(),
                found: found.to_string(),
            },
            location,
        )
    }

    /// The error for keys that contradict each other, or what other tables say.
    pub fn refuse(&self, problem: impl Into<String>) -> SceneError {
        SceneError::at(SceneErrorKind::Contradiction(problem.into()), self.location())
    }

    /// At least one of the keys; the first one where there is none.
    pub fn any_of(&self, keys: &[&str]) -> Result<(), SceneError> {
        if keys.iter().any(|key| self.get(key).is_some()) { Ok(()) } else { Err(self.missing(keys[0])) }
    }

    /// Exactly one of the keys.
    pub fn one_of(&self, keys: &[&'static str]) -> Result<&'static str, SceneError> {
        let found: Vec<&'static str> = keys.iter().copied().filter(|key| self.get(key).is_some()).collect();
        match found.as_slice() {
            [one] => Ok(one),
            _ => Err(SceneError::at(
                SceneErrorKind::OneOf {
                    table: self.label(),
                    keys: keys.join(", "),
                    found: if found.is_empty() { "none".into() } else { found.join(" and ") },
                },
                self.location(),
            )),
        }
    }

    /// The one key that is given of the table's first group of alternatives.
    pub fn which(&self) -> Result<&'static str, SceneError> {
        self.one_of(self.table.alternatives[0])
    }

    /// The same with the table that it leads into.
    pub fn form(&self) -> Result<(&'static str, Self), SceneError> {
        let form = self.which()?;
        Ok((form, self.required_child(form)?))
    }

    /// At most one key of each group of alternatives.
    pub fn check_alternatives(&self) -> Result<(), SceneError> {
        self.table.alternatives.iter().try_for_each(|group| self.at_most_one_of(group).map(|_| ()))
    }

    /// At most one of the keys.
    pub fn at_most_one_of(&self, keys: &[&'static str]) -> Result<Option<&'static str>, SceneError> {
        if keys.iter().any(|key| self.get(key).is_some()) { self.one_of(keys).map(Some) } else { Ok(None) }
    }

    /// The parameters that a value names, for people.
    fn parameters_of(&self, node: &Node) -> String {
        if let Value::Text(text) = &node.value {
            self.context.parameters.named_in(text)
        } else {
            String::new()
        }
    }

    /// What was found must have the dimension, or none.
    fn check_dimension(
        &self,
        path: &str,
        node: &Node,
        found: Dimension,
        expected: Dimension,
    ) -> Result<(), SceneError> {
        if found == expected || found == Dimension::NONE {
            return Ok(());
        }
        let kind = SceneErrorKind::WrongUnit {
            key: path.into(),
            expected: expected.to_string(),
            unit: expected.unit(),
            found: format!("{found}{}", self.parameters_of(node)),
        };
        Err(SceneError::at(kind, &node.location))
    }

    /// Evaluates a node to a number of the dimension, in SI units.
    fn number(&self, path: &str, node: &Node, key: &str, dimension: Dimension) -> Result<f64, SceneError> {
        let value = match &node.value {
            Value::Integer(number) => *number as f64,
            Value::Float(number) => *number,
            Value::Text(text) => {
                let quantity = self.context.parameters.evaluate(text, &node.location)?;
                self.check_dimension(path, node, quantity.dimension, dimension)?;
                quantity.value
            }
            _ => return Err(self.wrong_type(path, &self.expectation(key), node)),
        };
        if value.is_finite() {
            return Ok(value);
        }
        Err(SceneError::at(
            SceneErrorKind::OutOfRange {
                key: path.into(),
                requirement: "finite".into(),
                found: value.to_string(),
            },
            &node.location,
        ))
    }

    fn ranged(&self, path: &str, node: &Node, key: &str, dimension: Dimension) -> Result<f64, SceneError> {
        let value = self.number(path, node, key, dimension)?;
        let range = self.key(key).range;
        if range.contains(value) {
            return Ok(value);
        }
        Err(SceneError::at(
            SceneErrorKind::OutOfRange {
                key: path.into(),
                requirement: range.requirement().into(),
                found: format!("{value} {}", dimension.unit()).trim_end().to_string()
                    + &self.parameters_of(node),
            },
            &node.location,
        ))
    }

    fn dimension(&self, key: &str) -> Dimension {
        match self.key(key).kind {
            Kind::Quantity(dimension)
            | Kind::QuantityOr(dimension, _)
            | Kind::Vector(dimension)
            | Kind::VectorOrQuantity(dimension)
            | Kind::Function(dimension, _)
            | Kind::Functions(dimension, _)
            | Kind::List(dimension) => dimension,
            _ => Dimension::NONE,
        }
    }

    /// A quantity in SI units, if given.
    pub fn quantity(&self, key: &str) -> Result<Option<f64>, SceneError> {
        let Some(node) = self.get(key) else { return Ok(None) };
        self.ranged(&self.full(key), node, key, self.dimension(key)).map(Some)
    }

    /// A resistance to turning, if given: a number of effective radii, or a length.
    pub fn resistance(&self, key: &str) -> Result<Option<TurningResistance>, SceneError> {
        let Some(node) = self.get(key) else { return Ok(None) };
        let is_length = match &node.value {
            Value::Text(text) => {
                let quantity = self.context.parameters.evaluate(text, &node.location)?;
                quantity.dimension == Dimension::LENGTH
            }
            _ => false,
        };
        let dimension = if is_length { Dimension::LENGTH } else { Dimension::NONE };
        let value = self.ranged(&self.full(key), node, key, dimension)?;
        Ok(Some(if is_length { TurningResistance::Length(value) } else { TurningResistance::Ratio(value) }))
    }

    /// The items of a list, if the key is given.
    fn items(&self, key: &str) -> Result<Option<&'a [Node]>, SceneError> {
        match self.get(key) {
            None => Ok(None),
            Some(Node { value: Value::Array(items), .. }) => Ok(Some(items)),
            Some(node) => Err(self.wrong_type(&self.full(key), &self.expectation(key), node)),
        }
    }

    /// A list of quantities, if given.
    pub fn list(&self, key: &str) -> Result<Option<Vec<f64>>, SceneError> {
        let Some(items) = self.items(key)? else { return Ok(None) };
        let dimension = self.dimension(key);
        let numbers = items
            .iter()
            .enumerate()
            .map(|(index, item)| self.ranged(&format!("{}.{index}", self.full(key)), item, key, dimension));
        numbers.collect::<Result<_, _>>().map(Some)
    }

    /// Three quantities, if given.
    pub fn vector(&self, key: &str) -> Result<Option<Vec3>, SceneError> {
        match self.list(key)?.as_deref() {
            None => Ok(None),
            Some(&[x, y, z]) => Ok(Some(Vec3::new(x, y, z))),
            Some(_) => Err(self.wrong_type(
                &self.full(key),
                &self.expectation(key),
                self.get(key).unwrap_or(self.node),
            )),
        }
    }

    /// Three quantities, or one that stands for all three, if given.
    pub fn vector_or_quantity(&self, key: &str) -> Result<Option<Vec3>, SceneError> {
        match self.get(key) {
            Some(Node { value: Value::Array(_), .. }) => self.vector(key),
            _ => self.quantity(key).map(|length| length.map(Vec3::splat)),
        }
    }

    /// A direction of length one, if given.
    pub fn direction(&self, key: &str) -> Result<Option<Vec3>, SceneError> {
        let Some(vector) = self.vector(key)? else { return Ok(None) };
        // One written by `to_toml` must come back unchanged.
        if (vector.length() - 1.0).abs() < 1e-14 {
            return Ok(Some(vector));
        }
        let largest = vector.abs().max_element();
        match (vector / largest).try_normalize() {
            Some(unit) if largest > 0.0 => Ok(Some(unit)),
            _ => Err(self.out_of_range(key, "a direction of any length but zero", vector)),
        }
    }

    /// A function of time, if given.
    pub fn function(&self, key: &str) -> Result<Option<FunctionSpec>, SceneError> {
        self.get(key).map(|node| self.function_of(&self.full(key), node, key)).transpose()
    }

    /// Three functions of time, if given.
    pub fn functions(&self, key: &str) -> Result<Option<[FunctionSpec; 3]>, SceneError> {
        let Some(items) = self.items(key)? else { return Ok(None) };
        let functions = items
            .iter()
            .enumerate()
            .map(|(index, item)| self.function_of(&format!("{}.{index}", self.full(key)), item, key));
        let functions: Vec<FunctionSpec> = functions.collect::<Result<_, _>>()?;
        let wrong =
            |_| self.wrong_type(&self.full(key), &self.expectation(key), self.get(key).unwrap_or(self.node));
        functions.try_into().map(Some).map_err(wrong)
    }

    fn function_of(&self, path: &str, node: &'a Node, key: &str) -> Result<FunctionSpec, SceneError> {
        let dimension = self.dimension(key);
        match (&node.value, self.key(key).kind) {
            (Value::Table(_), Kind::Function(_, table) | Kind::Functions(_, table)) => {
                Self::new(self.context, node, path.to_string(), table)?.sampled_function(dimension)
            }
            (Value::Text(text), _) => {
                let term = self.context.parameters.compile(text, &node.location)?;
                if term.constant().is_some() {
                    return self.number(path, node, key, dimension).map(FunctionSpec::constant);
                }
                self.check_dimension(path, node, term.dimension, dimension)?;
                let formula = Formula::new(term.operations).map_err(|error| {
                    SceneError::at(SceneErrorKind::Contradiction(error.to_string()), &node.location)
                })?;
                Ok(FunctionSpec::Profile(Profile::Formula(formula)))
            }
            _ => self.number(path, node, key, dimension).map(FunctionSpec::constant),
        }
    }

    /// The function of time that this table says.
    fn sampled_function(&self, dimension: Dimension) -> Result<FunctionSpec, SceneError> {
        let (form, inner) = self.form()?;
        match form {
            "sinusoidal" => Ok(FunctionSpec::Profile(Profile::Sinusoidal {
                amplitude: inner.field("amplitude")?,
                period: inner.field("period")?,
                phase: inner.field("phase")?,
            })),
            "table" => {
                let times: Vec<f64> = inner.field("times")?;
                let values: Vec<f64> = inner.field("values")?;
                if times.is_empty() || times.windows(2).any(|pair| pair[1] <= pair[0]) {
                    return Err(inner.out_of_range(
                        "times",
                        "at least one time, each later than the one before",
                        format!("{times:?}"),
                    ));
                }
                if times.len() != values.len() {
                    let requirement = format!("as many as the {} times", times.len());
                    return Err(inner.out_of_range("values", &requirement, values.len()));
                }
                Ok(FunctionSpec::Profile(Profile::Table { times, values }))
            }
            _ => Ok(FunctionSpec::File { file: self.field("file")?, dimension }),
        }
    }

    /// Rows of three numbers, if given.
    pub fn rows(&self, key: &str) -> Result<Option<Vec<[f64; 3]>>, SceneError> {
        let Some(items) = self.items(key)? else { return Ok(None) };
        let rows = items.iter().enumerate().map(|(index, item)| {
            let path = format!("{}.{index}", self.full(key));
            let Value::Array(numbers) = &item.value else {
                return Err(self.wrong_type(&path, "three numbers", item));
            };
            let [x, y, z] = numbers.as_slice() else {
                return Err(self.wrong_type(&path, "three numbers", item));
            };
            let number = |node| self.number(&path, node, key, Dimension::LENGTH);
            Ok([number(x)?, number(y)?, number(z)?])
        });
        rows.collect::<Result<_, _>>().map(Some)
    }

    fn whole(&self, path: &str, node: &Node, key: &str) -> Result<u64, SceneError> {
        let value = match &node.value {
            Value::Integer(number) if *number >= 0 => return Ok(*number as u64),
            _ => self.number(path, node, key, Dimension::NONE)?,
        };
        let rounded = value.round();
        if (value - rounded).abs() <= 1e-9 * rounded.max(1.0) && (0.0..=LARGEST_COUNT).contains(&rounded) {
            return Ok(rounded as u64);
        }
        Err(SceneError::at(
            SceneErrorKind::OutOfRange {
                key: path.into(),
                requirement: "a whole number, zero or positive".into(),
                found: value.to_string(),
            },
            &node.location,
        ))
    }

    /// A whole number, if given.
    pub fn count(&self, key: &str) -> Result<Option<u64>, SceneError> {
        let Some(node) = self.get(key) else { return Ok(None) };
        match self.whole(&self.full(key), node, key)? {
            0 if self.key(key).range == Range::Positive => Err(self.out_of_range(key, "at least 1", 0)),
            count => Ok(Some(count)),
        }
    }

    /// Three whole numbers from 1, if given.
    pub fn counts(&self, key: &str) -> Result<Option<[u64; 3]>, SceneError> {
        let Some(items) = self.items(key)? else { return Ok(None) };
        let path = self.full(key);
        let counts: Vec<u64> =
            items.iter().map(|item| self.whole(&path, item, key)).collect::<Result<_, _>>()?;
        match counts.as_slice() {
            &[x, y, z] if x.min(y).min(z) > 0 => Ok(Some([x, y, z])),
            [_, _, _] => Err(self.out_of_range(key, "at least 1 each", format!("{counts:?}"))),
            _ => Err(self.wrong_type(&path, &self.expectation(key), self.get(key).unwrap_or(self.node))),
        }
    }

    /// A text with its `${parameter}`s replaced, if given.
    pub fn text(&self, key: &str) -> Result<Option<String>, SceneError> {
        let Some(node) = self.get(key) else { return Ok(None) };
        let Value::Text(text) = &node.value else {
            return Err(self.wrong_type(&self.full(key), &self.expectation(key), node));
        };
        self.context.parameters.interpolate(text, &node.location).map(|text| Some(text.value))
    }

    /// A list of texts, if given.
    pub fn texts(&self, key: &str) -> Result<Option<Vec<String>>, SceneError> {
        let Some(items) = self.items(key)? else { return Ok(None) };
        let texts = items.iter().enumerate().map(|(index, item)| match &item.value {
            Value::Text(text) => {
                self.context.parameters.interpolate(text, &item.location).map(|text| text.value)
            }
            _ => Err(self.wrong_type(&format!("{}.{index}", self.full(key)), "a text", item)),
        });
        texts.collect::<Result<_, _>>().map(Some)
    }

    /// A path, if given: relative to the scene's folder, or to the current folder where it comes from
    /// `--set`.
    pub fn path(&self, key: &str) -> Result<Option<PathBuf>, SceneError> {
        let Some(node) = self.get(key) else { return Ok(None) };
        let Value::Text(text) = &node.value else {
            return Err(self.wrong_type(&self.full(key), &self.expectation(key), node));
        };
        let text = self.context.parameters.interpolate(text, &node.location)?;
        let folder = if text.from_command_line { Path::new("") } else { &self.context.folder };
        Ok(Some(folder.join(text.value)))
    }

    /// `true` or `false`, if given.
    pub fn flag(&self, key: &str) -> Result<Option<bool>, SceneError> {
        match self.get(key) {
            None => Ok(None),
            Some(Node { value: Value::Boolean(flag), .. }) => Ok(Some(*flag)),
            Some(node) => Err(self.wrong_type(&self.full(key), &self.expectation(key), node)),
        }
    }

    /// One of a few words, those that the schema names, if given.
    pub fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Result<Option<T>, SceneError> {
        debug_assert!(
            choices.iter().map(|(name, _)| *name).eq((self.key(key).choices)()),
            "choices of {key}"
        );
        let Some(word) = self.text(key)? else { return Ok(None) };
        match choices.iter().find(|(name, _)| *name == word) {
            Some((_, value)) => Ok(Some(*value)),
            None => Err(self.unknown_name(key, "choice", &word, choices.iter().map(|(name, _)| *name))),
        }
    }

    /// The error for a name that refers to nothing.
    pub fn unknown_name<'b>(
        &self,
        key: &str,
        what: &str,
        name: &str,
        known: impl Iterator<Item = &'b str> + Clone,
    ) -> SceneError {
        let location = self.node.get(key).map_or(self.location(), |node| &node.location);
        SceneError::at(
            SceneErrorKind::UnknownName {
                key: self.full(key),
                what: what.into(),
                name: name.into(),
                closest: closest(name, known.clone()),
                known: known.collect::<Vec<_>>().join(", "),
            },
            location,
        )
    }

    /// The table that the key leads into, if given.
    pub fn child(&self, key: &str) -> Result<Option<Self>, SceneError> {
        let table = match self.key(key).kind {
            Kind::Table(table) | Kind::QuantityOr(_, table) | Kind::TextOr(table) => table,
            _ => unreachable!("{key} does not lead into a table"),
        };
        self.get(key).map(|node| Self::new(self.context, node, self.full(key), table)).transpose()
    }

    /// The table that the key leads into, which must be given.
    pub fn required_child(&self, key: &str) -> Result<Self, SceneError> {
        self.child(key)?.ok_or_else(|| self.missing(key))
    }

    /// The tables of a table of named tables, with their names, in the order of the text.
    pub fn named(&self, key: &str) -> Result<Vec<(String, Self)>, SceneError> {
        let Kind::Named(table) = self.key(key).kind else { unreachable!("{key} holds no named tables") };
        let Some(node) = self.get(key) else { return Ok(Vec::new()) };
        let entries = node
            .entries()
            .ok_or_else(|| self.wrong_type(&self.full(key), "a table of named tables", node))?;
        let readers = entries.iter().map(|entry| {
            let path = format!("{}.{}", self.full(key), entry.key);
            Ok((entry.key.clone(), Self::new(self.context, &entry.node, path, table)?))
        });
        readers.collect()
    }

    /// The tables of a list.
    pub fn tables(&self, key: &str) -> Result<Vec<Self>, SceneError> {
        let Kind::Tables(table) = self.key(key).kind else { unreachable!("{key} holds no tables") };
        let readers =
            self.items(key)?.unwrap_or_default().iter().enumerate().map(|(index, item)| {
                Self::new(self.context, item, format!("{}.{index}", self.full(key)), table)
            });
        readers.collect()
    }
}
