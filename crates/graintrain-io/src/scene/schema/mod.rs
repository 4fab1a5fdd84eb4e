//! Every key of a scene: its kind, range, choices, default and meaning. The reader checks keys and values
//! against these tables, `--set` finds alternatives in them, `graintrain schema` prints them as a JSON
//! Schema, and a test holds `docs/scenes.md` against them.

mod body;
pub(super) mod function;
mod packing;
pub(super) mod periodic;
mod robot;
mod stream;

use super::file::{OVERLAP, PRECISIONS};
use super::joint::JointSpec;
use super::measure::MEASURE;
use super::model::{LoadSpec, PairRule};
use super::quantity::Dimension;
use super::stage::STAGE;
use super::table::Spec;
use body::BODY;
pub(super) use body::SHAPE_NAMES;
use function::ACCELERATION;
use graintrain_ccp::FrictionModel;
use packing::PACKING;
use periodic::PERIODIC;
use robot::ROBOT;
use stream::{OUTLET, STREAM};

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
    /// The same key whose numbers lie in this range.
    const fn within(self, range: Range) -> Self {
        Self { range, ..self }
    }

    /// The same key whose text is one of these.
    const fn one_of(self, choices: fn() -> Vec<&'static str>) -> Self {
        Self { choices, ..self }
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

const fn key(
    name: &'static str,
    kind: Kind,
    default: &'static str,
    example: &'static str,
    about: &'static str,
) -> Key {
    Key { name, kind, range: Range::Any, choices: Vec::new, default, example, about }
}

use Kind::{Count, Flag, Free, Named, Quantity, RatioOrLength, Tables, Text, Texts};
pub(super) type D = Dimension;

/// Top level of a scene.
pub static SCENE: Table = Table {
    heading: "Top level",
    alternatives: &[],
    keys: &[
        key("title", Text, "the scene's name", "\"Balls in a box\"", "Title of the scene"),
        key("seed", Count, "1", "42", "Seed of all random numbers; packing number k (from 0) uses seed + k"),
        key(
            "gravity",
            Kind::Functions(D::ACCELERATION, &ACCELERATION),
            "[0, 0, -9.81]",
            "[0, 0, \"-1.62 m/s^2\"]",
            "Gravity; each component may be a function of time",
        ),
        key(
            "parameters",
            Free,
            "none",
            "{ n = 4, pitch = \"0.23 m\" }",
            "Named values for expressions, set with `--set n=8`; names of units, functions and pi are reserved",
        ),
        key(
            "time",
            Kind::Table(&TIME),
            "required",
            "{ step = \"1 ms\", end = \"2 s\" }",
            "Time step and end",
        ),
        key(
            "contact",
            Kind::Table(&CONTACT),
            "its keys' defaults",
            "{ envelope = \"1 mm\" }",
            "Contact detection, overlap",
        ),
        key(
            "periodic",
            Kind::Table(&PERIODIC),
            "unbounded space",
            "{ min = [0, 0, 0], max = [1, 1, 1], rate = { xy = \"0.1/s\" } }",
            "Periodic cell, of constant form, deformed, or under a stress",
        ),
        key("solver", Kind::Table(&SOLVER), "its keys' defaults", "{ tolerance = 1e-5 }", "Contact solver"),
        key("output", Kind::Table(&OUTPUT), "its keys' defaults", "{ every = \"0.1 s\" }", "What is written"),
        key(
            "material",
            Named(&MATERIAL),
            "one material `default`",
            "{ glass = { density = 2500 } }",
            "Materials by name",
        ),
        key(
            "pair",
            Tables(&PAIR),
            "none",
            "[{ materials = [\"glass\", \"steel\"], friction = 0.2 }]",
            "Properties of pairs of materials",
        ),
        key(
            "body",
            Named(&BODY),
            "none",
            "{ ball = { shape = { sphere = { radius = 1 } } } }",
            "Single bodies by name",
        ),
        key(
            "robot",
            Named(&ROBOT),
            "none",
            "{ arm = { file = \"arm.urdf\", fixed = true } }",
            "Robots from URDF files, by name: bodies and joints",
        ),
        key(
            "packing",
            Named(&PACKING),
            "none",
            "{ grains = { radius = 0.1, file = { path = \"a.csv\" } } }",
            "Many bodies at once, by name",
        ),
        key(
            "stream",
            Named(&STREAM),
            "none",
            "{ rain = { radius = 0.01, rate = 100, region = { box = { min = [0, 0, 1], max = [1, 1, 1.1] } } } }",
            "Bodies that enter during the run, by name",
        ),
        key(
            "outlet",
            Named(&OUTLET),
            "none",
            "{ bottom = { behind = { point = [0, 0, -1] } } }",
            "Where bodies leave, by name; a body leaves through the first outlet that applies",
        ),
        key(
            "load",
            Named(LoadSpec::TABLE),
            "none",
            "{ push = { bodies = [\"wheel\"], force = [0, 0, \"-2 kN\"] } }",
            "Forces, torques and fields by name",
        ),
        key(
            "joint",
            Named(JointSpec::TABLE),
            "none",
            "{ hinge = { kind = \"revolute\", bodies = [\"door\"], point = [0, 0, 1], axis = [0, 0, 1] } }",
            "Joints between bodies, or a body and the world, by name",
        ),
        key(
            "stage",
            Tables(&STAGE),
            "one stage without end",
            "[{ name = \"settle\", kinetic_energy = \"1e-9 J\" }, { name = \"shear\" }]",
            "Stages, run one after the other, with the changes at the beginning of each",
        ),
        key(
            "measure",
            Named(&MEASURE),
            "none",
            "{ sample = { stress = true, coordination = true } }",
            "Measurements by name; each writes a table `measures/NAME.csv`",
        ),
    ],
};

static TIME: Table = Table {
    heading: "`[time]`",
    alternatives: &[&["end", "steps"]],
    keys: &[
        key("step", Quantity(D::TIME), "required", "\"25 ms\"", "Time step").within(Range::Positive),
        key(
            "end",
            Quantity(D::TIME),
            "one of end, steps",
            "\"2 s\"",
            "Simulated time; rounded up to whole steps",
        )
        .within(Range::Positive),
        key("steps", Count, "one of end, steps", "120", "Number of steps").within(Range::Positive),
    ],
};

static CONTACT: Table = Table {
    heading: "`[contact]`",
    alternatives: &[],
    keys: &[
        key(
            "envelope",
            Quantity(D::LENGTH),
            "0.05 x the smallest radius",
            "\"3 cm\"",
            "Pairs closer than this become contacts",
        ).within(Range::Positive),
        key(
            "allowed_overlap",
            Quantity(D::LENGTH),
            "0.01 x the smallest radius",
            "\"0.1 mm\"",
            "Largest initial overlap of rigid contacts",
        ).within(Range::NotNegative),
        key(
            "relax",
            Flag,
            "false",
            "true",
            "Larger initial overlap is removed by displacements before the run, instead of being an error: for packings of programs \
             with soft contacts",
        ),
        key(
            "overlap",
            Text,
            "\"position\"",
            "\"velocity\"",
            "How overlap is removed: position (by displacements, without kinetic energy) or velocity (bodies separate with \
             the velocity -gap / step and keep it: the paper's scheme)",
        ).one_of(|| names(OVERLAP)),
        key(
            "friction_rule",
            Text,
            "\"minimum\"",
            "\"geometric-mean\"",
            "Friction (sliding, rolling, spinning) of a pair without a `pair` table, from both materials: minimum, maximum, mean, \
             geometric-mean",
        ).one_of(|| names(PairRule::NAMES)),
        key("restitution_rule", Text, "\"minimum\"", "\"mean\"", "Restitution of such a pair").one_of(|| names(PairRule::NAMES)),
    ],
};

static SOLVER: Table = Table {
    heading: "`[solver]`",
    alternatives: &[],
    keys: &[
        key("name", Text, "\"auto\"", "\"apgd\"", "Solver, optionally with its linear solver after a `+`"),
        key(
            "tolerance",
            Quantity(D::NONE),
            "1e-4",
            "1e-5",
            "Residual at which it stops: its root mean square, with 20 times that for the worst contact. 1e-4: the root mean square velocity \
             error at contacts is 1e-4 of gravity times step. A value above 1e-2 has no effect",
        ).within(Range::Positive),
        key("strict_max", Flag, "false", "true", "Whether the tolerance applies to the worst contact"),
        key(
            "max_iterations",
            Count,
            "6000, more for few contacts",
            "2000",
            "Limit of iterations of a connected part of the contacts in a step, in iterations of projected gradients (default below 1 024 contacts: up to \
             five times as many). If the limit is reached, the step uses the best impulses and counts as not converged. \
             If these are far from a solution and no limit is given, convex problems are solved in addition, so that no bodies approach. Relaxed solves, and methods that count other iterations, have their own limits",
        ).within(Range::Positive),
        key(
            "friction",
            Text,
            "\"coulomb\"",
            "\"relaxed\"",
            "coulomb (exact) or relaxed (cone complementarity, the paper's model: a sliding contact separates by mu times its slip)",
        ).one_of(|| names(FrictionModel::NAMES)),
    ],
};

static OUTPUT: Table = Table {
    heading: "`[output]`",
    alternatives: &[],
    keys: &[
        key(
            "every",
            Quantity(D::TIME),
            "end / 100, at least a step",
            "\"0.1 s\"",
            "Simulated time between frames; rounded to whole steps",
        )
        .within(Range::Positive),
        key("bodies", Flag, "true", "false", "Write the bodies of each frame"),
        key("contacts", Flag, "true", "false", "Write the contacts of each frame"),
        key(
            "precision",
            Text,
            "\"single\"",
            "\"double\"",
            "Floating-point numbers of the frames: single (for pictures) or double",
        )
        .one_of(|| names(PRECISIONS)),
        key(
            "checkpoint_every",
            Quantity(D::TIME),
            "end / 10, at least a step",
            "\"1 s\"",
            "Simulated time between checkpoints",
        )
        .within(Range::Positive),
    ],
};

/// Force per length, and force per speed.
const STIFFNESS: D = D::new(0, 1, -2, 0);
const DAMPING: D = D::new(0, 1, -1, 0);

static MATERIAL: Table = Table {
    heading: "`[material.NAME]`",
    alternatives: &[],
    keys: &[
        key("density", Quantity(D::DENSITY), "1000", "\"2500 kg/m^3\"", "Density").within(Range::Positive),
        key("friction", Quantity(D::NONE), "0.25", "0.5", "Coefficient of friction with itself").within(Range::NotNegative),
        key(
            "restitution",
            Quantity(D::NONE),
            "0",
            "0.6",
            "Newton's coefficient of restitution with itself, 0 to 1",
        ).within(Range::ZeroToOne),
        key(
            "rolling_friction",
            RatioOrLength,
            "0",
            "0.1",
            "Rolling friction with itself: the largest tangential moment over the normal force, a length; a number is a multiple of the \
             effective radius R_A R_B / (R_A + R_B)",
        ).within(Range::NotNegative),
        key(
            "spinning_friction",
            RatioOrLength,
            "0",
            "\"0.2 mm\"",
            "Spinning friction with itself: the same for the moment about the normal",
        ).within(Range::NotNegative),
        key(
            "stiffness",
            Quantity(STIFFNESS),
            "0: rigid",
            "\"100 kN/m\"",
            "Normal stiffness of every contact with itself; not with restitution",
        ).within(Range::NotNegative),
        key(
            "damping",
            Quantity(DAMPING),
            "0",
            "\"20 N s/m\"",
            "Normal damping of every contact with itself; only with a stiffness",
        ).within(Range::NotNegative),
        key(
            "cohesion",
            Quantity(D::FORCE),
            "0",
            "\"2 mN\"",
            "Attraction of two bodies of this material while they touch",
        ).within(Range::NotNegative),
    ],
};

static PAIR: Table = Table {
    heading: "`[[pair]]`",
    alternatives: &[],
    keys: &[
        key("materials", Texts, "required", "[\"glass\", \"steel\"]", "The two materials"),
        key(
            "friction",
            Quantity(D::NONE),
            "contact.friction_rule",
            "0.2",
            "Coefficient of friction between them",
        )
        .within(Range::NotNegative),
        key(
            "restitution",
            Quantity(D::NONE),
            "contact.restitution_rule",
            "0.4",
            "Coefficient of restitution between them",
        )
        .within(Range::ZeroToOne),
        key(
            "rolling_friction",
            RatioOrLength,
            "contact.friction_rule",
            "0.05",
            "Rolling friction between them, a multiple of the effective radius or a length",
        )
        .within(Range::NotNegative),
        key(
            "spinning_friction",
            RatioOrLength,
            "contact.friction_rule",
            "0.02",
            "Spinning friction between them, a multiple of the effective radius or a length",
        )
        .within(Range::NotNegative),
        key(
            "stiffness",
            Quantity(STIFFNESS),
            "both in series",
            "\"50 kN/m\"",
            "Normal stiffness of every contact between them; 0: rigid",
        )
        .within(Range::NotNegative),
        key(
            "damping",
            Quantity(DAMPING),
            "both in series",
            "\"10 N s/m\"",
            "Normal damping of every contact between them",
        )
        .within(Range::NotNegative),
        key(
            "cohesion",
            Quantity(D::FORCE),
            "the smaller of both",
            "\"1 mN\"",
            "Attraction of two such bodies while they touch",
        )
        .within(Range::NotNegative),
    ],
};
