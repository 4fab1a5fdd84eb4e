//! Scenes: what to simulate, in a TOML file with units, turned into a [`World`](graintrain::world::World) and
//! the settings of a run.
//!
//! ```text
//! text --tree--> keys and values with their places --file--> Scene (SI units) --build--> Simulation
//! ```
//!
//! | module | holds |
//! |---|---|
//! | `table` | the macro that declares a table once: its struct, its keys and what reads it |
//! | [`schema`] | what is known of every key: kind, range, choices, default and meaning |
//! | `json_schema` | the same for editors |
//! | [`mod@quantity`] | units and dimensions |
//! | `expression`, `parameters` | arithmetic with units and named values |
//! | `tree`, `reader`, `names`, `file` | from text to [`Scene`] |
//! | [`model`] | the parts of a [`Scene`] |
//! | `packing`, `mesh_file` | packings made here or read from files; meshes |
//! | `robot` | URDF files as bodies and joints |
//! | `joint`, `stage`, `measure`, `stream`, `periodic`, `region`, [`radius`], `solver` | these tables |
//! | `build` | from [`Scene`] to [`Simulation`] |
//! | [`builtin`] | the built-in scenes |
//! | [`error`] | what can be wrong, and where |
//!
//! `docs/scenes.md` is the reference for users.

mod build;
pub mod builtin;
pub mod error;
mod expression;
mod file;
mod joint;
mod json_schema;
mod measure;
mod mesh_file;
pub mod model;
mod names;
mod packing;
mod parameters;
mod periodic;
pub mod quantity;
pub mod radius;
mod reader;
mod region;
mod robot;
pub mod schema;
mod solver;
mod stage;
mod stream;
mod table;
mod tree;

pub use build::Simulation;
pub use error::{Location, SceneError, SceneErrorKind, Source, closest};
pub use json_schema::json_schema;
pub use measure::{
    AlongSpec, ForceSpec, HistogramSpec, MeasureSpec, MixingSpec, PlaneSpec, ProfileSpec, ReposeSpec,
    ShearBoxSpec, WheelSpec,
};

pub use joint::{ActuatorSpec, JointForm, JointSpec, MotorSpec, SpringSpec, StopsSpec};
pub use periodic::{DriveSpec, PeriodicSpec};
pub use stage::{GrowthSpec, StageBody, StageMaterial, StageSpec, SteadySpec};
pub use stream::{OutletSpec, StreamSpec};

use graintrain::material::TurningResistance;
use graintrain::stepper::SolverChoice;
use model::{
    BodySpec, ContactSpec, FunctionSpec, LoadSpec, MaterialSpec, OutputSpec, PackingSpec, PairSpec, TimeSpec,
};
use quantity::Dimension;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A scene with every value resolved to SI units.
#[derive(Clone, Debug, Serialize)]
pub struct Scene {
    /// Name of the file without its ending, or of the built-in scene.
    #[serde(skip)]
    pub name: String,
    /// One line for people.
    pub title: String,
    /// Seed of everything random.
    pub seed: u64,
    /// m/s^2
    pub gravity: [FunctionSpec; 3],
    /// Parameters as written, for people; their values are already in everything below.
    #[serde(skip)]
    pub parameters: Vec<(String, String)>,
    /// Time step and number of steps.
    pub time: TimeSpec,
    /// Contact detection.
    pub contact: ContactSpec,
    /// The cell in which space repeats.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub periodic: Option<PeriodicSpec>,
    /// Contact solver.
    #[serde(serialize_with = "solver::as_written")]
    pub solver: SolverChoice,
    /// What is written.
    pub output: OutputSpec,
    /// Materials by name.
    #[serde(rename = "material", serialize_with = "in_order")]
    pub materials: Vec<(String, MaterialSpec)>,
    /// Pairs of materials with properties of their own.
    #[serde(rename = "pair", skip_serializing_if = "Vec::is_empty")]
    pub pairs: Vec<PairSpec>,
    /// Single bodies by name.
    #[serde(rename = "body", serialize_with = "in_order", skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<(String, BodySpec)>,
    /// Packings by name.
    #[serde(rename = "packing", serialize_with = "in_order", skip_serializing_if = "Vec::is_empty")]
    pub packings: Vec<(String, PackingSpec)>,
    /// Streams of bodies by name.
    #[serde(rename = "stream", serialize_with = "in_order", skip_serializing_if = "Vec::is_empty")]
    pub streams: Vec<(String, StreamSpec)>,
    /// Ways out by name.
    #[serde(rename = "outlet", serialize_with = "in_order", skip_serializing_if = "Vec::is_empty")]
    pub outlets: Vec<(String, OutletSpec)>,
    /// Loads by name.
    #[serde(rename = "load", serialize_with = "in_order", skip_serializing_if = "Vec::is_empty")]
    pub loads: Vec<(String, LoadSpec)>,
    /// Joints by name.
    #[serde(rename = "joint", serialize_with = "in_order", skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<(String, JointSpec)>,
    /// Stages in their order.
    #[serde(rename = "stage", skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageSpec>,
    /// Measurements by name.
    #[serde(rename = "measure", serialize_with = "in_order", skip_serializing_if = "Vec::is_empty")]
    pub measures: Vec<(String, MeasureSpec)>,
}

/// Writes named tables in their order, which is that of the bodies in the world.
fn in_order<S: Serializer, T: Serialize>(tables: &[(String, T)], serializer: S) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(tables.len()))?;
    for (name, table) in tables {
        map.serialize_entry(name, table)?;
    }
    map.end()
}

impl Scene {
    /// Loads a scene file, or the built-in scene of that name, with `--set` settings applied in order.
    ///
    /// What contains a path separator or ends in `.toml` is a file; another word is a built-in scene if there
    /// is one.
    ///
    /// # Errors
    /// [`SceneError`] for everything that is wrong with the text. Files that the scene names are read by
    /// [`Scene::build`].
    pub fn load(scene: &str, settings: &[(String, String)]) -> Result<Self, SceneError> {
        let path = Path::new(scene);
        if let Some(builtin) = builtin::find(scene) {
            let name = format!("{scene} (built in)");
            return Self::parse(scene, &name, builtin.text, Path::new(""), settings);
        }
        let is_path = path.extension().is_some() || path.components().count() > 1 || path.exists();
        if !is_path {
            return Err(SceneError::unknown_scene(scene));
        }
        let unreadable = |reason: String| {
            SceneError::new(SceneErrorKind::UnreadableFile { path: scene.into(), reason }, None)
        };
        let bytes = std::fs::read(path).map_err(|error| unreadable(error.to_string()))?;
        let text = String::from_utf8(bytes)
            .map_err(|_| unreadable("it is not a text file: save it as UTF-8".into()))?;
        let name = path.file_stem().map_or(scene.into(), |stem| stem.to_string_lossy());
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::parse(&name, scene, &text, folder, settings)
    }

    /// Reads a scene from its text. `source` names the text in messages; relative paths in it start at
    /// `folder`.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn parse(
        name: &str,
        source: &str,
        text: &str,
        folder: &Path,
        settings: &[(String, String)],
    ) -> Result<Self, SceneError> {
        let source = Arc::new(Source { name: source.to_string(), text: text.to_string() });
        let mut root = tree::parse(source)?;
        for (key, value) in settings {
            tree::set(&mut root, key, value)?;
        }
        file::read(name, &root, PathBuf::from(folder))
    }

    /// The scene as a complete TOML text: every default explicit, every value in SI units, every path
    /// absolute. Reading it gives the same scene, bit for bit.
    ///
    /// # Errors
    /// [`SceneErrorKind::Contradiction`] where a path is not valid UTF-8 and so cannot be written.
    pub fn to_toml(&self) -> Result<String, SceneError> {
        let mut text = format!("# Scene `{}`, resolved: all defaults explicit, SI units.\n", self.name);
        for (name, value) in &self.parameters {
            text += &format!("# parameter {name} = {}\n", value.replace(['\n', '\r'], " "));
        }
        let body = toml::to_string(self)
            .map_err(|error| SceneError::new(SceneErrorKind::Contradiction(error.to_string()), None))?;
        Ok(text + "\n" + &body)
    }
}

/// The number in SI units that an expression of a scene is, where these names are numbers; not a number where
/// the expression is none.
///
/// # Errors
/// What is wrong with the text, in words.
pub fn value(text: &str, names: &[(&str, f64)]) -> Result<f64, String> {
    struct Given<'a>(&'a [(&'a str, f64)]);
    impl expression::Names for Given<'_> {
        fn value(&self, name: &str) -> Option<Result<quantity::Quantity, String>> {
            let found = self.0.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| Ok(quantity::Quantity::number(*value)))
        }

        fn names(&self) -> Vec<&str> {
            self.0.iter().map(|(name, _)| *name).collect()
        }

        fn kind(&self) -> &'static str {
            if self.0.is_empty() { "a number" } else { "one of the names that have a value here" }
        }
    }
    if let Some((name, _)) = names.iter().find(|(name, _)| expression::is_reserved(name)) {
        return Err(format!("`{name}` already means a unit, a function or a constant: choose another name"));
    }
    expression::evaluate(text, &Given(names)).map(|quantity| quantity.value).map_err(|error| error.problem)
}

/// A quantity from a text as scenes accept it: an expression with units.
///
/// # Errors
/// What is wrong with the text, in words.
pub fn quantity(text: &str) -> Result<quantity::Quantity, String> {
    expression::evaluate(text, &expression::NoNames).map_err(|error| error.problem)
}

/// A time in seconds from what scenes accept as one: a number of seconds, or an expression with units ("20
/// ms").
///
/// # Errors
/// What is wrong with the text, in words.
pub fn seconds(text: &str) -> Result<f64, String> {
    let quantity = expression::evaluate(text, &expression::NoNames).map_err(|error| error.problem)?;
    if ![Dimension::NONE, Dimension::TIME].contains(&quantity.dimension) {
        return Err(format!("expected a time, got {}", quantity.dimension));
    }
    if !(quantity.value.is_finite() && quantity.value > 0.0) {
        return Err("expected a positive time".to_string());
    }
    Ok(quantity.value)
}

/// Rolling or spinning friction from what scenes accept as one: a number of effective radii, or a length ("1
/// mm").
///
/// # Errors
/// What is wrong with the text, in words.
pub fn turning_resistance(text: &str) -> Result<TurningResistance, String> {
    let quantity = expression::evaluate(text, &expression::NoNames).map_err(|error| error.problem)?;
    match quantity.dimension {
        Dimension::NONE => Ok(TurningResistance::Ratio(quantity.value)),
        Dimension::LENGTH => Ok(TurningResistance::Length(quantity.value)),
        other => Err(format!("expected a number of effective radii or a length, got {other}")),
    }
}

/// A `KEY=VALUE` as typed after `--set`.
///
/// # Errors
/// [`SceneErrorKind::Override`] where there is no `=`.
pub fn setting(text: &str) -> Result<(String, String), SceneError> {
    match text.split_once('=') {
        Some((key, value)) => Ok((key.trim().to_string(), value.trim().to_string())),
        None => {
            let source = Source { name: parameters::COMMAND_LINE.into(), text: text.into() };
            let location = Location { source: Arc::new(source), span: 0..text.len() };
            let problem = format!("`{text}` is not of the form KEY=VALUE");
            Err(SceneError::at(SceneErrorKind::Override(problem), &location))
        }
    }
}
