//! Every key of a scene: its kind, default and meaning. The reader checks keys against these tables, `--set` finds
//! alternatives in them, and a test holds `docs/scenes.md` against them.

use super::quantity::Dimension;

/// What a key holds.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A number, or a text that evaluates to a quantity of this dimension.
    Quantity(Dimension),
    /// Three of them.
    Vector(Dimension),
    /// Any number of them.
    List(Dimension),
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
    /// A text, or a table that says more.
    TextOr(&'static Table),
    /// Names and values of the user's choice.
    Free,
    /// A list of lists of numbers or lengths.
    Rows,
}

impl Kind {
    /// The table that the key leads into.
    fn table(self) -> Option<&'static Table> {
        match self {
            Self::Table(table)
            | Self::Named(table)
            | Self::Tables(table)
            | Self::QuantityOr(_, table)
            | Self::TextOr(table) => Some(table),
            _ => None,
        }
    }
}

/// A key of a table.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Name.
    pub name: &'static str,
    /// What it holds.
    pub kind: Kind,
    /// Default, for people; `required` or `one of` where there is none.
    pub default: &'static str,
    /// An example, as written in a scene.
    pub example: &'static str,
    /// What it means.
    pub about: &'static str,
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

/// Keys that exclude `key` in the table with this dotted path: setting one of them unsets the others.
pub(crate) fn alternatives(path: &str, key: &str) -> Vec<&'static str> {
    let mut table = &SCENE;
    let mut parts = path.split('.').filter(|part| !part.is_empty());
    while let Some(part) = parts.next() {
        let Some(found) = table.key(part) else { return Vec::new() };
        if matches!(found.kind, Kind::Named(_) | Kind::Tables(_)) {
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
    Key { name, kind, default, example, about }
}

use Kind::{
    Count, Counts, Flag, Free, List, Named, Quantity, QuantityOr, Rows, Tables, Text, TextOr, Texts, Vector,
};
type D = Dimension;

/// Top level of a scene.
pub static SCENE: Table = Table {
    heading: "Top level",
    alternatives: &[],
    keys: &[
        key("title", Text, "the scene's name", "\"Balls in a box\"", "One line for people"),
        key("seed", Count, "1", "42", "Seed of everything random; packing number k (from 0) uses seed + k"),
        key("gravity", Vector(D::ACCELERATION), "[0, 0, -9.81]", "[0, 0, \"-1.62 m/s^2\"]", "Gravity"),
        key(
            "parameters",
            Free,
            "none",
            "{ n = 4, pitch = \"0.23 m\" }",
            "Named values for expressions, set with `--set n=8`",
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
            "Contact detection",
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
            "packing",
            Named(&PACKING),
            "none",
            "{ grains = { radius = 0.1, file = { path = \"a.csv\" } } }",
            "Many bodies at once, by name",
        ),
    ],
};

static TIME: Table = Table {
    heading: "`[time]`",
    alternatives: &[&["end", "steps"]],
    keys: &[
        key("step", Quantity(D::TIME), "required", "\"25 ms\"", "Time step"),
        key(
            "end",
            Quantity(D::TIME),
            "one of end, steps",
            "\"2 s\"",
            "Simulated time; rounded up to whole steps",
        ),
        key("steps", Count, "one of end, steps", "120", "Number of steps"),
    ],
};

static CONTACT: Table = Table {
    heading: "`[contact]`",
    alternatives: &[],
    keys: &[
        key(
            "envelope",
            Quantity(D::LENGTH),
            "0.3 x the smallest radius",
            "\"3 cm\"",
            "Pairs closer than this become contacts",
        ),
        key(
            "allowed_overlap",
            Quantity(D::LENGTH),
            "0.01 x the smallest radius",
            "\"0.1 mm\"",
            "Overlap accepted at the start",
        ),
        key(
            "friction_rule",
            Text,
            "\"minimum\"",
            "\"geometric-mean\"",
            "Friction of a pair that `pair` does not name, from both materials: minimum, maximum, mean, geometric-mean",
        ),
        key("restitution_rule", Text, "\"minimum\"", "\"mean\"", "Restitution of such a pair"),
    ],
};

static SOLVER: Table = Table {
    heading: "`[solver]`",
    alternatives: &[],
    keys: &[
        key("name", Text, "\"auto\"", "\"apgd\"", "Solver, with its linear solver after a `+`"),
        key("tolerance", Quantity(D::NONE), "1e-4", "1e-5", "Residual at which it stops"),
        key("max_iterations", Count, "the solver's own", "2000", "Iteration limit"),
        key(
            "friction",
            Text,
            "\"relaxed\"",
            "\"coulomb\"",
            "relaxed (cone complementarity) or coulomb (exact)",
        ),
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
        ),
        key("bodies", Flag, "true", "false", "Write the bodies of each frame"),
        key("contacts", Flag, "true", "false", "Write the contacts of each frame"),
        key(
            "precision",
            Text,
            "\"single\"",
            "\"double\"",
            "Floating-point numbers of the frames: single (for pictures) or double",
        ),
        key(
            "checkpoint_every",
            Quantity(D::TIME),
            "end / 10, at least a step",
            "\"1 s\"",
            "Simulated time between checkpoints",
        ),
    ],
};

static MATERIAL: Table = Table {
    heading: "`[material.NAME]`",
    alternatives: &[],
    keys: &[
        key("density", Quantity(D::DENSITY), "1000", "\"2500 kg/m^3\"", "Density"),
        key("friction", Quantity(D::NONE), "0.25", "0.5", "Coefficient of friction with itself"),
        key(
            "restitution",
            Quantity(D::NONE),
            "0",
            "0.6",
            "Newton's coefficient of restitution with itself, 0 to 1",
        ),
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
        ),
        key(
            "restitution",
            Quantity(D::NONE),
            "contact.restitution_rule",
            "0.4",
            "Coefficient of restitution between them",
        ),
    ],
};

static BODY: Table = Table {
    heading: "`[body.NAME]`",
    alternatives: &[&["shape", "parts"], &["mass", "density"]],
    keys: &[
        key(
            "shape",
            Kind::Table(&SHAPE),
            "one of shape, parts",
            "{ sphere = { radius = \"1 cm\" } }",
            "Shape",
        ),
        key(
            "parts",
            Tables(&PART),
            "one of shape, parts",
            "[{ shape = { plane = {} } }]",
            "Several shapes in one rigid body; they may not overlap where they have mass",
        ),
        key("material", Text, "the only material", "\"glass\"", "Material"),
        key(
            "position",
            Vector(D::LENGTH),
            "[0, 0, 0]",
            "[0, 0, \"5 cm\"]",
            "Origin of the body's frame in the world",
        ),
        key(
            "rotation",
            Kind::Table(&ROTATION),
            "none",
            "{ axis = [0, 1, 0], angle = \"30 deg\" }",
            "Rotation of the body's frame",
        ),
        key(
            "velocity",
            Vector(D::SPEED),
            "[0, 0, 0]",
            "[\"1 m/s\", 0, 0]",
            "Initial velocity of the centre of mass",
        ),
        key(
            "angular_velocity",
            Vector(D::ANGULAR_SPEED),
            "[0, 0, 0]",
            "[0, 0, \"12 rpm\"]",
            "Initial angular velocity",
        ),
        key("mass", Quantity(D::MASS), "density x volume", "\"3 kg\"", "Mass"),
        key("density", Quantity(D::DENSITY), "the material's", "\"7800 kg/m^3\"", "Density of this body"),
        key(
            "motion",
            TextOr(&MOTION),
            "free; fixed for planes and meshes",
            "\"fixed\"",
            "free, fixed, or a table that prescribes it",
        ),
    ],
};

static PART: Table = Table {
    heading: "Part of a body, `body.NAME.parts`",
    alternatives: &[],
    keys: &[
        key("shape", Kind::Table(&SHAPE), "required", "{ box = { size = [1, 1, 1] } }", "Shape"),
        key("position", Vector(D::LENGTH), "[0, 0, 0]", "[\"1 m\", 0, 0]", "Place in the body's frame"),
        key(
            "rotation",
            Kind::Table(&ROTATION),
            "none",
            "{ axis = [0, 0, 1], angle = \"90 deg\" }",
            "Rotation in the body's frame",
        ),
    ],
};

static ROTATION: Table = Table {
    heading: "`rotation`",
    alternatives: &[&["angle", "quaternion"], &["axis", "quaternion"]],
    keys: &[
        key("axis", Vector(D::NONE), "[0, 0, 1]", "[0, 1, 0]", "Axis; any length"),
        key("angle", Quantity(D::ANGLE), "0", "\"30 deg\"", "Angle about it"),
        key(
            "quaternion",
            List(D::NONE),
            "from axis and angle",
            "[0, 0, 0, 1]",
            "The same as a quaternion x, y, z, w",
        ),
    ],
};

static SHAPE: Table = Table {
    heading: "`shape`",
    alternatives: &[&["sphere", "box", "plane", "capsule", "cylinder", "mesh"]],
    keys: &[
        key("sphere", Kind::Table(&SPHERE), "one of", "{ radius = \"1 cm\" }", "Ball about the origin"),
        key("box", Kind::Table(&BOX), "one of", "{ size = [1, 2, 3] }", "Box about the origin"),
        key(
            "plane",
            Kind::Table(&PLANE),
            "one of",
            "{ normal = [0, 0, 1] }",
            "Half-space below the plane through the origin; a boundary without mass",
        ),
        key(
            "capsule",
            Kind::Table(&CAPSULE),
            "one of",
            "{ length = 2, radius = 1 }",
            "Cylinder with half balls at both ends, along z",
        ),
        key("cylinder", Kind::Table(&CYLINDER), "one of", "{ length = 2, radius = 1 }", "Cylinder along z"),
        key(
            "mesh",
            Kind::Table(&MESH),
            "one of",
            "{ file = \"hopper.stl\" }",
            "Surface of triangles; a boundary without mass",
        ),
    ],
};

static SPHERE: Table = Table {
    heading: "`shape.sphere`",
    alternatives: &[],
    keys: &[key("radius", Quantity(D::LENGTH), "required", "\"1 cm\"", "Radius")],
};

static BOX: Table = Table {
    heading: "`shape.box`",
    alternatives: &[],
    keys: &[key("size", Vector(D::LENGTH), "required", "[\"1 m\", \"2 m\", \"3 m\"]", "Edge lengths")],
};

static PLANE: Table = Table {
    heading: "`shape.plane`",
    alternatives: &[],
    keys: &[key("normal", Vector(D::NONE), "[0, 0, 1]", "[1, 0, 0]", "Outward normal; any length")],
};

static CAPSULE: Table = Table {
    heading: "`shape.capsule`",
    alternatives: &[],
    keys: &[
        key(
            "length",
            Quantity(D::LENGTH),
            "required",
            "\"4 cm\"",
            "Distance between the centres of the half balls",
        ),
        key("radius", Quantity(D::LENGTH), "required", "\"1 cm\"", "Radius"),
    ],
};

static CYLINDER: Table = Table {
    heading: "`shape.cylinder`",
    alternatives: &[],
    keys: &[
        key("length", Quantity(D::LENGTH), "required", "\"4 cm\"", "Height"),
        key("radius", Quantity(D::LENGTH), "required", "\"1 cm\"", "Radius"),
    ],
};

static MESH: Table = Table {
    heading: "`shape.mesh`",
    alternatives: &[&["file", "vertices"], &["file", "triangles"]],
    keys: &[
        key(
            "file",
            Text,
            "one of file, vertices",
            "\"hopper.stl\"",
            "STL, OBJ, or a table of nine coordinates per triangle",
        ),
        key("vertices", Rows, "one of file, vertices", "[[0, 0, 0], [1, 0, 0], [0, 1, 0]]", "Corner points"),
        key(
            "triangles",
            Rows,
            "required with vertices",
            "[[0, 1, 2]]",
            "Three vertex numbers (from 0) per triangle, counter-clockwise seen from outside",
        ),
        key("scale", Quantity(D::NONE), "1", "0.001", "Factor on all coordinates, e.g. for a file in mm"),
    ],
};

static MOTION: Table = Table {
    heading: "`motion`",
    alternatives: &[],
    keys: &[
        key(
            "free",
            Texts,
            "[]",
            "[\"z\"]",
            "Degrees of freedom that stay dynamic: x, y, z, rx, ry, rz; all others follow the prescribed velocity, zero by default",
        ),
        key(
            "start",
            Quantity(D::TIME),
            "0",
            "\"0.5 s\"",
            "At rest until then; speeds that depend on time count it from there",
        ),
        key(
            "translation",
            Tables(&TRANSLATION),
            "[]",
            "[{ direction = [1, 0, 0], speed = \"1 cm/s\" }]",
            "Prescribed velocities; they add up",
        ),
        key(
            "rotation",
            Kind::Table(&SPIN),
            "none",
            "{ axis = [0, 0, 1], speed = \"12 rpm\" }",
            "Prescribed rotation about a fixed axis",
        ),
    ],
};

static TRANSLATION: Table = Table {
    heading: "`motion.translation`",
    alternatives: &[],
    keys: &[
        key("direction", Vector(D::NONE), "required", "[1, 0, 0]", "Direction; any length"),
        key(
            "speed",
            QuantityOr(D::SPEED, &LINEAR_SPEED),
            "required",
            "\"10 cm/s\"",
            "Speed: constant, or a function of time",
        ),
    ],
};

static SPIN: Table = Table {
    heading: "`motion.rotation`",
    alternatives: &[],
    keys: &[
        key(
            "point",
            Vector(D::LENGTH),
            "the body's position",
            "[0, 0, 0]",
            "A point of the axis in the world",
        ),
        key("axis", Vector(D::NONE), "[0, 0, 1]", "[1, 0, 0]", "Direction of the axis; any length"),
        key(
            "speed",
            QuantityOr(D::ANGULAR_SPEED, &ANGULAR_SPEED),
            "required",
            "\"12 rpm\"",
            "Angular speed: constant, or a function of time",
        ),
    ],
};

static LINEAR_SPEED: Table = Table {
    heading: "`speed` of a translation",
    alternatives: &[&["sinusoidal", "table"]],
    keys: &[
        key(
            "sinusoidal",
            Kind::Table(&LINEAR_SINUSOID),
            "one of",
            "{ amplitude = \"1 m/s\", period = \"4 s\" }",
            "amplitude sin(2 pi t / period + phase)",
        ),
        key(
            "table",
            Kind::Table(&LINEAR_TABLE),
            "one of",
            "{ times = [0, 1], values = [0, \"1 m/s\"] }",
            "Linear between samples, constant outside",
        ),
    ],
};

static ANGULAR_SPEED: Table = Table {
    heading: "`speed` of a rotation",
    alternatives: &[&["sinusoidal", "table"]],
    keys: &[
        key(
            "sinusoidal",
            Kind::Table(&ANGULAR_SINUSOID),
            "one of",
            "{ amplitude = \"5 rpm\", period = \"4 s\" }",
            "amplitude sin(2 pi t / period + phase)",
        ),
        key(
            "table",
            Kind::Table(&ANGULAR_TABLE),
            "one of",
            "{ times = [0, 1], values = [0, \"1 rad/s\"] }",
            "Linear between samples, constant outside",
        ),
    ],
};

const PERIOD: Key = key("period", Quantity(D::TIME), "required", "\"4 s\"", "Period");
const PHASE: Key = key("phase", Quantity(D::ANGLE), "0", "\"90 deg\"", "Phase");
const TIMES: Key = key("times", List(D::TIME), "required", "[0, \"0.5 s\", \"1 s\"]", "Ascending times");

static LINEAR_SINUSOID: Table = Table {
    heading: "`speed.sinusoidal` of a translation",
    alternatives: &[],
    keys: &[key("amplitude", Quantity(D::SPEED), "required", "\"1 m/s\"", "Largest speed"), PERIOD, PHASE],
};

static ANGULAR_SINUSOID: Table = Table {
    heading: "`speed.sinusoidal` of a rotation",
    alternatives: &[],
    keys: &[
        key("amplitude", Quantity(D::ANGULAR_SPEED), "required", "\"5 rpm\"", "Largest angular speed"),
        PERIOD,
        PHASE,
    ],
};

static LINEAR_TABLE: Table = Table {
    heading: "`speed.table` of a translation",
    alternatives: &[],
    keys: &[TIMES, key("values", List(D::SPEED), "required", "[0, \"1 m/s\", 0]", "Speed at each time")],
};

static ANGULAR_TABLE: Table = Table {
    heading: "`speed.table` of a rotation",
    alternatives: &[],
    keys: &[
        TIMES,
        key("values", List(D::ANGULAR_SPEED), "required", "[0, \"5 rpm\", 0]", "Angular speed at each time"),
    ],
};

static PACKING: Table = Table {
    heading: "`[packing.NAME]`",
    alternatives: &[&["lattice", "drop", "file"], &["radius", "shape"]],
    keys: &[
        key(
            "lattice",
            Kind::Table(&LATTICE),
            "one of lattice, drop, file",
            "{ counts = [9, 9, 9], pitch = 0.23 }",
            "Bodies on a perturbed cubic lattice",
        ),
        key(
            "drop",
            Kind::Table(&DROP),
            "one of lattice, drop, file",
            "{ count = 500, box = { min = [0, 0, 0], max = [1, 1, 3] } }",
            "Bodies at random places of a region, without overlap",
        ),
        key(
            "file",
            Kind::Table(&FILE),
            "one of lattice, drop, file",
            "{ path = \"pile.vtu\" }",
            "Spheres from a file",
        ),
        key(
            "radius",
            QuantityOr(D::LENGTH, &RADIUS),
            "one of radius, shape; the file's",
            "\"5 mm\"",
            "Radius of the spheres: one value, or a distribution",
        ),
        key(
            "shape",
            Kind::Table(&SHAPE),
            "one of radius, shape",
            "{ box = { size = [1, 1, 1] } }",
            "Shape of the bodies",
        ),
        key("material", Text, "the only material", "\"glass\"", "Material"),
        key(
            "velocity",
            Vector(D::SPEED),
            "[0, 0, 0]",
            "[0, 0, \"-1 m/s\"]",
            "Initial velocity, added to that of a file",
        ),
        key("lock_rotation", Flag, "false", "true", "Bodies keep their orientation"),
        key("seed", Count, "seed of the scene + number of the packing", "7", "Seed of this packing"),
    ],
};

static RADIUS: Table = Table {
    heading: "`packing.NAME.radius`",
    alternatives: &[&["uniform", "normal", "lognormal", "choice"]],
    keys: &[
        key(
            "uniform",
            Kind::Table(&UNIFORM),
            "one of",
            "{ min = \"4 mm\", max = \"6 mm\" }",
            "Uniform between two radii",
        ),
        key(
            "normal",
            Kind::Table(&NORMAL),
            "one of",
            "{ mean = \"5 mm\", deviation = \"0.5 mm\", min = \"4 mm\", max = \"6 mm\" }",
            "Normal, cut off at two radii",
        ),
        key(
            "lognormal",
            Kind::Table(&LOGNORMAL),
            "one of",
            "{ median = \"5 mm\", deviation = 0.2, min = \"3 mm\", max = \"8 mm\" }",
            "Log-normal, cut off at two radii",
        ),
        key(
            "choice",
            Kind::Table(&CHOICE),
            "one of",
            "{ radii = [\"4 mm\", \"8 mm\"], weights = [0.9, 0.1] }",
            "One of several radii",
        ),
    ],
};

const MIN_RADIUS: Key = key("min", Quantity(D::LENGTH), "required", "\"4 mm\"", "Smallest radius");
const MAX_RADIUS: Key = key("max", Quantity(D::LENGTH), "required", "\"6 mm\"", "Largest radius");

static UNIFORM: Table =
    Table { heading: "`radius.uniform`", alternatives: &[], keys: &[MIN_RADIUS, MAX_RADIUS] };

static NORMAL: Table = Table {
    heading: "`radius.normal`",
    alternatives: &[],
    keys: &[
        key("mean", Quantity(D::LENGTH), "required", "\"5 mm\"", "Mean before the cut"),
        key("deviation", Quantity(D::LENGTH), "required", "\"0.5 mm\"", "Standard deviation before the cut"),
        MIN_RADIUS,
        MAX_RADIUS,
    ],
};

static LOGNORMAL: Table = Table {
    heading: "`radius.lognormal`",
    alternatives: &[],
    keys: &[
        key("median", Quantity(D::LENGTH), "required", "\"5 mm\"", "Median before the cut"),
        key(
            "deviation",
            Quantity(D::NONE),
            "required",
            "0.2",
            "Standard deviation of the logarithm before the cut",
        ),
        MIN_RADIUS,
        MAX_RADIUS,
    ],
};

static CHOICE: Table = Table {
    heading: "`radius.choice`",
    alternatives: &[],
    keys: &[
        key("radii", List(D::LENGTH), "required", "[\"4 mm\", \"8 mm\"]", "The radii"),
        key("weights", List(D::NONE), "equal", "[0.9, 0.1]", "How often each is drawn; any sum"),
    ],
};

static LATTICE: Table = Table {
    heading: "`packing.NAME.lattice`",
    alternatives: &[],
    keys: &[
        key("counts", Counts, "required", "[\"2*n+1\", \"2*n+1\", \"2*n+1\"]", "Bodies along x, y, z"),
        key(
            "pitch",
            Vector(D::LENGTH),
            "required",
            "\"0.23 m\"",
            "Distance of neighbours: one for all axes, or three",
        ),
        key(
            "origin",
            Vector(D::LENGTH),
            "[0, 0, 0]",
            "[0, 0, \"5 cm\"]",
            "Lower corner of the lattice: the first body sits half a pitch inside",
        ),
        key(
            "jitter",
            Quantity(D::LENGTH),
            "0",
            "\"12 mm\"",
            "Each coordinate is moved by a uniform random length of at most this",
        ),
    ],
};

static DROP: Table = Table {
    heading: "`packing.NAME.drop`",
    alternatives: &[&["box", "cylinder"]],
    keys: &[
        key("count", Count, "required", "500", "Number of bodies"),
        key(
            "box",
            Kind::Table(&BOX_REGION),
            "one of box, cylinder",
            "{ min = [0, 0, 0], max = [1, 1, 3] }",
            "Region: box",
        ),
        key(
            "cylinder",
            Kind::Table(&CYLINDER_REGION),
            "one of box, cylinder",
            "{ radius = 1, height = 3 }",
            "Region: upright cylinder",
        ),
    ],
};

static BOX_REGION: Table = Table {
    heading: "`drop.box`",
    alternatives: &[],
    keys: &[
        key("min", Vector(D::LENGTH), "required", "[0, 0, 0]", "Lower corner; bodies lie wholly inside"),
        key("max", Vector(D::LENGTH), "required", "[1, 1, 3]", "Upper corner"),
    ],
};

static CYLINDER_REGION: Table = Table {
    heading: "`drop.cylinder`",
    alternatives: &[],
    keys: &[
        key("base", Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"1 cm\"]", "Centre of the lower end"),
        key("radius", Quantity(D::LENGTH), "required", "\"10 cm\"", "Radius; bodies lie wholly inside"),
        key("height", Quantity(D::LENGTH), "required", "\"30 cm\"", "Height, along z"),
    ],
};

static FILE: Table = Table {
    heading: "`packing.NAME.file`",
    alternatives: &[],
    keys: &[
        key(
            "path",
            Text,
            "required",
            "\"pile.vtu\"",
            "VTU or VTP, CSV, or a whitespace table; relative to the scene's folder, on the command line to the current one",
        ),
        key("format", Text, "by the file's ending", "\"table\"", "vtk, csv or table"),
        key("skip_last", Count, "0", "1", "Leave out this many lines at the end"),
        key(
            "scale",
            Quantity(D::NONE),
            "1",
            "0.001",
            "Factor on all lengths, after the units that the file names",
        ),
        key("offset", Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"1 cm\"]", "Added to all positions"),
        key(
            "keep_min",
            Vector(D::LENGTH),
            "everything",
            "[-1, -1, 0]",
            "Keep only centres above this corner, in final coordinates",
        ),
        key("keep_max", Vector(D::LENGTH), "everything", "[1, 1, 2]", "Keep only centres below this corner"),
        key("radius_min", Quantity(D::LENGTH), "0", "\"1 mm\"", "Keep only spheres of at least this radius"),
        key(
            "radius_max",
            Quantity(D::LENGTH),
            "everything",
            "\"1 cm\"",
            "Keep only spheres of at most this radius",
        ),
    ],
};
