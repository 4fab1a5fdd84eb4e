//! Keys of packings: radii, lattices, drops, files.

use super::Kind::{self, Count, Counts, Flag, List, Quantity, QuantityOr, Tables, Text, Vector};
use super::body::{PART, SHAPE};
use super::{D, Key, Range, Table, key, names};
use crate::scene::model::PackingFormat;
use crate::scene::radius::BY;
use crate::scene::region::{BOX_REGION, CYLINDER_REGION};

pub(super) static PACKING: Table = Table {
    heading: "`[packing.NAME]`",
    alternatives: &[&["lattice", "drop", "poisson", "file"], &["radius", "shape", "parts"]],
    keys: &[
        key(
            "lattice",
            Kind::Table(&LATTICE),
            "one of lattice, drop, poisson, file",
            "{ counts = [9, 9, 9], pitch = 0.23 }",
            "Bodies on a perturbed cubic lattice",
        ),
        key(
            "drop",
            Kind::Table(&DROP),
            "one of lattice, drop, poisson, file",
            "{ count = 500, box = { min = [0, 0, 0], max = [1, 1, 3] } }",
            "Bodies at random positions in a region, without overlap",
        ),
        key(
            "poisson",
            Kind::Table(&POISSON),
            "one of lattice, drop, poisson, file",
            "{ distance = 0.1, box = { min = [0, 0, 0], max = [1, 1, 3] } }",
            "Bodies at random positions with a minimum distance that fill a region evenly (Poisson-disk sampling)",
        ),
        key(
            "file",
            Kind::Table(&FILE),
            "one of lattice, drop, poisson, file",
            "{ path = \"pile.vtu\" }",
            "Spheres from a file",
        ),
        key(
            "radius",
            QuantityOr(D::LENGTH, &RADIUS),
            "one of radius, shape, parts; the file's",
            "\"5 mm\"",
            "Radius of the spheres: one value, or a distribution",
        )
        .within(Range::Positive),
        key(
            "shape",
            Kind::Table(&SHAPE),
            "one of radius, shape, parts",
            "{ box = { size = [1, 1, 1] } }",
            "Shape of the bodies",
        ),
        key(
            "parts",
            Tables(&PART),
            "one of radius, shape, parts",
            "[{ shape = { sphere = { radius = 1 } } }, { shape = { sphere = { radius = 1 } }, position = [1, 0, 0] }]",
            "Several shapes in each body (clumps), with the mass of their union; the body's position is that of its centre of mass",
        ),
        key("random_rotation", Flag, "false", "true", "Random orientations, uniformly distributed"),
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

pub(super) static RADIUS: Table = Table {
    heading: "`packing.NAME.radius`",
    alternatives: &[&["uniform", "normal", "lognormal", "choice", "rosin_rammler", "sieves"]],
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
        key(
            "rosin_rammler",
            Kind::Table(&ROSIN_RAMMLER),
            "one of",
            "{ size = \"5 mm\", spread = 3, min = \"2 mm\", max = \"8 mm\" }",
            "Rosin-Rammler, cut off at two radii: cumulative mass fraction 1 - exp(-(r/size)^spread) up to radius r",
        ),
        key(
            "sieves",
            Kind::Table(&SIEVES),
            "one of",
            "{ openings = [\"2 mm\", \"4 mm\", \"8 mm\"], passing = [0, 0.3, 1] }",
            "A grading curve by mass, linear in the logarithm of the opening between sieves",
        ),
        key(
            "by",
            Text,
            "\"number\"; of rosin_rammler and sieves \"mass\"",
            "\"mass\"",
            "Whether fractions, weights, medians and means are by number of spheres, or by mass",
        )
        .one_of(|| names(BY)),
    ],
};

const MIN_RADIUS: Key =
    key("min", Quantity(D::LENGTH), "required", "\"4 mm\"", "Smallest radius").within(Range::Positive);
const MAX_RADIUS: Key =
    key("max", Quantity(D::LENGTH), "required", "\"6 mm\"", "Largest radius").within(Range::Positive);

static UNIFORM: Table =
    Table { heading: "`radius.uniform`", alternatives: &[], keys: &[MIN_RADIUS, MAX_RADIUS] };

static NORMAL: Table = Table {
    heading: "`radius.normal`",
    alternatives: &[],
    keys: &[
        key("mean", Quantity(D::LENGTH), "required", "\"5 mm\"", "Mean before the cut")
            .within(Range::Positive),
        key("deviation", Quantity(D::LENGTH), "required", "\"0.5 mm\"", "Standard deviation before the cut")
            .within(Range::NotNegative),
        MIN_RADIUS,
        MAX_RADIUS,
    ],
};

static LOGNORMAL: Table = Table {
    heading: "`radius.lognormal`",
    alternatives: &[],
    keys: &[
        key("median", Quantity(D::LENGTH), "required", "\"5 mm\"", "Median before the cut")
            .within(Range::Positive),
        key(
            "deviation",
            Quantity(D::NONE),
            "required",
            "0.2",
            "Standard deviation of the logarithm before the cut",
        )
        .within(Range::NotNegative),
        MIN_RADIUS,
        MAX_RADIUS,
    ],
};

static CHOICE: Table = Table {
    heading: "`radius.choice`",
    alternatives: &[],
    keys: &[
        key("radii", List(D::LENGTH), "required", "[\"4 mm\", \"8 mm\"]", "The radii")
            .within(Range::Positive),
        key("weights", List(D::NONE), "equal", "[0.9, 0.1]", "Relative frequency of each; any sum")
            .within(Range::NotNegative),
    ],
};

static ROSIN_RAMMLER: Table = Table {
    heading: "`radius.rosin_rammler`",
    alternatives: &[],
    keys: &[
        key(
            "size",
            Quantity(D::LENGTH),
            "required",
            "\"5 mm\"",
            "Radius with a cumulative mass fraction of 63.2 % before the cut",
        )
        .within(Range::Positive),
        key("spread", Quantity(D::NONE), "required", "3", "Exponent, at most 100: the larger, the narrower")
            .within(Range::Positive),
        MIN_RADIUS,
        MAX_RADIUS,
    ],
};

static SIEVES: Table = Table {
    heading: "`radius.sieves`",
    alternatives: &[],
    keys: &[
        key(
            "openings",
            List(D::LENGTH),
            "required",
            "[\"2 mm\", \"4 mm\", \"8 mm\"]",
            "Openings, ascending: the largest *diameters* that pass",
        )
        .within(Range::Positive),
        key(
            "passing",
            List(D::NONE),
            "required",
            "[0, 0.3, 1]",
            "Mass fraction that passes each, from 0 to 1",
        )
        .within(Range::ZeroToOne),
    ],
};

static LATTICE: Table = Table {
    heading: "`packing.NAME.lattice`",
    alternatives: &[],
    keys: &[
        key("counts", Counts, "required", "[\"2*n+1\", \"2*n+1\", \"2*n+1\"]", "Bodies along x, y, z")
            .within(Range::Positive),
        key("pitch", Kind::VectorOrQuantity(D::LENGTH), "required", "\"0.23 m\"", "Distance of neighbours")
            .within(Range::Positive),
        key(
            "origin",
            Vector(D::LENGTH),
            "[0, 0, 0]",
            "[0, 0, \"5 cm\"]",
            "Lower corner of the lattice; the first body is half a pitch inside",
        ),
        key(
            "jitter",
            Quantity(D::LENGTH),
            "0",
            "\"12 mm\"",
            "Largest random displacement of each coordinate, uniformly distributed",
        )
        .within(Range::NotNegative),
    ],
};

const IN_BOX: Key = key(
    "box",
    Kind::Table(&BOX_REGION),
    "one of box, cylinder",
    "{ min = [0, 0, 0], max = [1, 1, 3] }",
    "Region: box",
);

const IN_CYLINDER: Key = key(
    "cylinder",
    Kind::Table(&CYLINDER_REGION),
    "one of box, cylinder",
    "{ radius = 1, height = 3 }",
    "Region: upright cylinder",
);

static DROP: Table = Table {
    heading: "`packing.NAME.drop`",
    alternatives: &[&["box", "cylinder"]],
    keys: &[
        key("count", Count, "required", "500", "Number of bodies").within(Range::Positive),
        IN_BOX,
        IN_CYLINDER,
    ],
};

static POISSON: Table = Table {
    heading: "`packing.NAME.poisson`",
    alternatives: &[&["box", "cylinder"]],
    keys: &[
        key("distance", Quantity(D::LENGTH), "required", "\"12 mm\"", "Minimum distance of two centres")
            .within(Range::Positive),
        IN_BOX,
        IN_CYLINDER,
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
            "VTU or VTP, CSV, a whitespace table, a dump of LAMMPS or LIGGGHTS, extended XYZ, YADE's text, data or restart files of MercuryDPM; \
             relative to the scene's folder, on the command line to the current folder",
        ),
        key(
            "format",
            Text,
            "from the file extension",
            "\"lammps\"",
            "vtk, csv, table, lammps, xyz, yade or mercury",
        )
        .one_of(|| names(PackingFormat::NAMES)),
        key(
            "frame",
            Count,
            "the last",
            "0",
            "Frame of a file with several, counted from 0: lammps, xyz, mercury",
        ),
        key("skip_last", Count, "0", "1", "Number of lines to omit at the end"),
        key(
            "scale",
            Quantity(D::NONE),
            "1",
            "0.001",
            "Factor for all lengths, after conversion of the units in the file",
        )
        .within(Range::Positive),
        key("offset", Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"1 cm\"]", "Added to all positions"),
        key(
            "keep_min",
            Vector(D::LENGTH),
            "everything",
            "[-1, -1, 0]",
            "Keep only centres above this corner, in final coordinates",
        ),
        key("keep_max", Vector(D::LENGTH), "everything", "[1, 1, 2]", "Keep only centres below this corner"),
        key("radius_min", Quantity(D::LENGTH), "0", "\"1 mm\"", "Keep only spheres of at least this radius")
            .within(Range::NotNegative),
        key(
            "radius_max",
            Quantity(D::LENGTH),
            "everything",
            "\"1 cm\"",
            "Keep only spheres of at most this radius",
        )
        .within(Range::Positive),
    ],
};
