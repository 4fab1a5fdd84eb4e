//! What is known of every key of a scene: its kind, range, choices, default and meaning. The reader checks
//! keys and values against the tables below [`SCENE`], `--set` finds alternatives in them, `graintrain
//! schema` prints them as a JSON Schema, and a test holds `docs/scenes.md` against them. Each table is
//! declared, by the macro `table!`, where it is read.

pub(super) mod function;

use super::joint::JointSpec;
use super::measure::MEASURE;
use super::model::{
    BodySpec, ContactSpec, LoadSpec, MaterialSpec, OutputSpec, PackingSpec, PairSpec, TimeSpec,
};
use super::periodic::PeriodicSpec;
use super::quantity::Dimension;
use super::robot::RobotSpec;
use super::solver::SolverKeys;
use super::stage::STAGE;
use super::stream::{OutletSpec, StreamSpec};
use super::table::{Spec, table};

/// What a key holds.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A number, or a text that evaluates to a quantity of this dimension.
    Quantity(Dimension),
    /// A number, or a length.
    RatioOrLength,
    /// Three of them.
    Vector(Dimension),
    /// Three of them, or one for all three.
    VectorOrQuantity(Dimension),
    /// Any number of them.
    List(Dimension),
    /// Three numbers: a direction, of any length but zero.
    Direction,
    /// A whole number that is not negative, or a text that evaluates to one.
    Count,
    /// Three of them.
    Counts,
    /// A text.
    Text,
    /// A list of texts.
    Texts,
    /// `true` or `false`.
    Flag,
    /// A table.
    Table(&'static Table),
    /// A table of tables with names of the user's choice.
    Named(&'static Table),
    /// A list of tables.
    Tables(&'static Table),
    /// A quantity, or a table that says more.
    QuantityOr(Dimension, &'static Table),
    /// A quantity, a text with the time `t`, or a table that says more: a function of time.
    Function(Dimension, &'static Table),
    /// Three of them.
    Functions(Dimension, &'static Table),
    /// A text, or a table that says more.
    TextOr(&'static Table),
    /// Names and values of the user's choice.
    Free,
    /// A list of lists of numbers or lengths.
    Rows,
}

impl Kind {
    /// The SI unit of its numbers; empty for pure numbers and for what holds none.
    pub fn unit(self) -> String {
        match self {
            Self::Quantity(dimension)
            | Self::Vector(dimension)
            | Self::VectorOrQuantity(dimension)
            | Self::List(dimension)
            | Self::QuantityOr(dimension, _)
            | Self::Function(dimension, _)
            | Self::Functions(dimension, _) => dimension.unit(),
            _ => String::new(),
        }
    }

    /// The table that the key leads into.
    fn table(self) -> Option<&'static Table> {
        match self {
            Self::Table(table)
            | Self::Named(table)
            | Self::Tables(table)
            | Self::QuantityOr(_, table)
            | Self::Function(_, table)
            | Self::Functions(_, table)
            | Self::TextOr(table) => Some(table),
            _ => None,
        }
    }
}

/// What a number must satisfy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Range {
    /// Finite.
    Any,
    /// Above zero; of whole numbers from 1.
    Positive,
    /// Zero or above.
    NotNegative,
    /// From 0 to 1.
    ZeroToOne,
}

impl Range {
    pub(crate) fn contains(self, value: f64) -> bool {
        match self {
            Self::Any => true,
            Self::Positive => value > 0.0,
            Self::NotNegative => value >= 0.0,
            Self::ZeroToOne => (0.0..=1.0).contains(&value),
        }
    }

    pub(crate) fn requirement(self) -> &'static str {
        match self {
            Self::Any => "finite",
            Self::Positive => "positive",
            Self::NotNegative => "zero or positive",
            Self::ZeroToOne => "between 0 and 1",
        }
    }
}

/// A default that says that the key has to be given.
pub(super) const REQUIRED: &str = "required";

/// A key of a table.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Name.
    pub name: &'static str,
    /// What it holds.
    pub kind: Kind,
    /// What its numbers must satisfy.
    pub range: Range,
    /// The texts that it may hold; empty where any will do.
    pub choices: fn() -> Vec<&'static str>,
    /// Default, in TOML or words; `required` or `one of` where there is none.
    pub default: &'static str,
    /// An example, as written in a scene.
    pub example: &'static str,
    /// What it means.
    pub about: &'static str,
}

impl Key {
    /// What it means; where that ends with a colon, with the texts that it may hold.
    pub fn meaning(&self) -> String {
        match ((self.choices)().as_slice(), self.about.ends_with(':')) {
            ([others @ .., last], true) => format!("{} {} or {last}", self.about, others.join(", ")),
            _ => self.about.to_string(),
        }
    }
}

/// The first of each pair: the names among which [`Reader::choice`](super::reader::Reader::choice) chooses a
/// value.
pub(super) fn names<T>(choices: &[(&'static str, T)]) -> Vec<&'static str> {
    choices.iter().map(|(name, _)| *name).collect()
}

/// The keys of one kind of table.
#[derive(Debug)]
pub struct Table {
    /// Heading in the documentation.
    pub heading: &'static str,
    /// The keys.
    pub keys: &'static [Key],
    /// Groups of keys of which at most one may be given.
    pub alternatives: &'static [&'static [&'static str]],
}

impl Table {
    /// Names of all keys.
    pub fn names(&self) -> Vec<&'static str> {
        self.keys.iter().map(|key| key.name).collect()
    }

    /// The key of this name.
    pub fn key(&self, name: &str) -> Option<&'static Key> {
        self.keys.iter().find(|key| key.name == name)
    }

    /// This table and all below it, each once, in the order of the documentation.
    pub fn all(&'static self) -> Vec<&'static Table> {
        let mut found: Vec<&'static Table> = vec![self];
        let mut next = 0;
        while next < found.len() {
            for key in found[next].keys {
                if let Some(table) = key.kind.table()
                    && !found.iter().any(|known| std::ptr::eq(*known, table))
                {
                    found.push(table);
                }
            }
            next += 1;
        }
        found
    }
}

/// Keys in another order, by their numbers.
pub(super) const fn in_order<const N: usize>(keys: &[Key], numbers: [usize; N]) -> [Key; N] {
    assert!(keys.len() == N, "every key once");
    let mut sorted = [keys[0]; N];
    let mut place = 0;
    while place < N {
        sorted[place] = keys[numbers[place]];
        place += 1;
    }
    sorted
}

/// Number of keys of several lists together.
pub(super) const fn count(lists: &[&[Key]]) -> usize {
    let (mut keys, mut list) = (0, 0);
    while list < lists.len() {
        keys += lists[list].len();
        list += 1;
    }
    keys
}

/// The keys of several lists, one after the other.
pub(super) const fn joined<const N: usize>(lists: &[&[Key]]) -> [Key; N] {
    let mut all = [lists[0][0]; N];
    let (mut place, mut list) = (0, 0);
    while list < lists.len() {
        let mut key = 0;
        while key < lists[list].len() {
            all[place] = lists[list][key];
            (place, key) = (place + 1, key + 1);
        }
        list += 1;
    }
    all
}

/// Keys that exclude `key` in the table with this dotted path: setting one of them unsets the others.
pub(crate) fn alternatives(path: &str, key: &str) -> Vec<&'static str> {
    let mut table = &SCENE;
    let mut parts = path.split('.').filter(|part| !part.is_empty());
    while let Some(part) = parts.next() {
        let Some(found) = table.key(part) else { return Vec::new() };
        if matches!(found.kind, Kind::Named(_) | Kind::Tables(_) | Kind::Functions(..)) {
            parts.next();
        }
        match found.kind.table() {
            Some(next) => table = next,
            None => return Vec::new(),
        }
    }
    let groups = table.alternatives.iter().filter(|group| group.contains(&key));
    groups.flat_map(|group| group.iter().copied()).filter(|other| *other != key).collect()
}

pub(super) type D = Dimension;

table! {
    /// Top level of a scene.
    pub static SCENE: "Top level" {
        /// Title of the scene
        title = Text, "the scene's name", "\"Balls in a box\"";
        /// Seed of all random numbers; packing number k (from 0) uses seed + k
        seed = Count, "1", "42";
        /// Gravity; each component may be a function of time
        gravity = Functions(D::ACCELERATION, &ACCELERATION), "[0, 0, -9.81]", "[0, 0, \"-1.62 m/s^2\"]";
        /// Named values for expressions, set with `--set n=8`; names of units, functions and pi are reserved
        parameters = Free, "none", "{ n = 4, pitch = \"0.23 m\" }";
        /// Time step and end
        time = Table(TimeSpec::TABLE), "required", "{ step = \"1 ms\", end = \"2 s\" }";
        /// Contact detection, overlap
        contact = Table(ContactSpec::TABLE), "its keys' defaults", "{ envelope = \"1 mm\" }";
        /// Periodic cell, of constant form, deformed, or under a stress
        periodic = Table(PeriodicSpec::TABLE), "unbounded space",
            "{ min = [0, 0, 0], max = [1, 1, 1], rate = { xy = \"0.1/s\" } }";
        /// Contact solver
        solver = Table(SolverKeys::TABLE), "its keys' defaults", "{ tolerance = 1e-5 }";
        /// What is written
        output = Table(OutputSpec::TABLE), "its keys' defaults", "{ every = \"0.1 s\" }";
        /// Materials by name
        material = Named(MaterialSpec::TABLE), "one material `default`", "{ glass = { density = 2500 } }";
        /// Properties of pairs of materials
        pair = Tables(PairSpec::TABLE), "none", "[{ materials = [\"glass\", \"steel\"], friction = 0.2 }]";
        /// Single bodies by name
        body = Named(BodySpec::TABLE), "none", "{ ball = { shape = { sphere = { radius = 1 } } } }";
        /// Robots from URDF files, by name: bodies and joints
        robot = Named(RobotSpec::TABLE), "none", "{ arm = { file = \"arm.urdf\", fixed = true } }";
        /// Many bodies at once, by name
        packing = Named(PackingSpec::TABLE), "none", "{ grains = { radius = 0.1, file = { path = \"a.csv\" } } }";
        /// Bodies that enter during the run, by name
        stream = Named(StreamSpec::TABLE),
            "none",
            "{ rain = { radius = 0.01, rate = 100, region = { box = { min = [0, 0, 1], max = [1, 1, 1.1] } } } }";
        /// Where bodies leave, by name; a body leaves through the first outlet that applies
        outlet = Named(OutletSpec::TABLE), "none", "{ bottom = { behind = { point = [0, 0, -1] } } }";
        /// Forces, torques and fields by name
        load = Named(LoadSpec::TABLE), "none",
            "{ push = { bodies = [\"wheel\"], force = [0, 0, \"-2 kN\"] } }";
        /// Joints between bodies, or a body and the world, by name
        joint = Named(JointSpec::TABLE), "none",
            "{ hinge = { kind = \"revolute\", bodies = [\"door\"], point = [0, 0, 1], axis = [0, 0, 1] } }";
        /// Stages, run one after the other, with the changes at the beginning of each
        stage = Tables(&STAGE), "one stage without end",
            "[{ name = \"settle\", kinetic_energy = \"1e-9 J\" }, { name = \"shear\" }]";
        /// Measurements by name; each writes a table `measures/NAME.csv`
        measure = Named(&MEASURE), "none", "{ sample = { stress = true, coordination = true } }";
    }
}
