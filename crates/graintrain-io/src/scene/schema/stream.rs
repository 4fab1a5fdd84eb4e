//! Keys of streams and outlets.

use super::Kind::{self, Count, Flag, Quantity, QuantityOr, Tables, Text, Vector};
use super::body::{PART, SHAPE};
use super::packing::RADIUS;
use super::{D, Range, Table, key};

use crate::scene::region::REGION;

pub(super) static STREAM: Table = Table {
    heading: "`[stream.NAME]`",
    alternatives: &[&["radius", "shape", "parts"], &["rate", "mass_rate"]],
    keys: &[
        key(
            "region",
            Kind::Table(&REGION),
            "required",
            "{ cylinder = { base = [0, 0, 1], radius = 0.1, height = 0.1 } }",
            "Bodies enter completely inside, at random positions without overlap; if there is none, the insertion is delayed",
        ),
        key(
            "radius",
            QuantityOr(D::LENGTH, &RADIUS),
            "one of radius, shape, parts",
            "\"5 mm\"",
            "Radius of spheres: one value, or a distribution",
        )
        .within(Range::Positive),
        key(
            "shape",
            Kind::Table(&SHAPE),
            "one of radius, shape, parts",
            "{ box = { size = [0.01, 0.01, 0.02] } }",
            "Shape of the bodies",
        ),
        key(
            "parts",
            Tables(&PART),
            "one of radius, shape, parts",
            "[{ shape = { sphere = { radius = 1 } } }, { shape = { sphere = { radius = 1 } }, position = [1, 0, 0] }]",
            "Several shapes in each body (clumps)",
        ),
        key("random_rotation", Flag, "false", "true", "Random orientations"),
        key("material", Text, "the only material", "\"glass\"", "Material"),
        key("velocity", Vector(D::SPEED), "[0, 0, 0]", "[0, 0, \"-1 m/s\"]", "Initial velocity"),
        key("lock_rotation", Flag, "false", "true", "Bodies keep their orientation"),
        key(
            "rate",
            Quantity(D::RATE),
            "as many as fit",
            "\"200/s\"",
            "Bodies per second; delayed bodies enter later",
        )
        .within(Range::Positive),
        key(
            "mass_rate",
            Quantity(D::MASS_RATE),
            "as many as fit",
            "\"0.5 kg/s\"",
            "Mass per second, instead of `rate`",
        )
        .within(Range::Positive),
        key("count", Count, "no limit", "500", "Maximum number of bodies"),
        key("mass", Quantity(D::MASS), "no limit", "\"2 kg\"", "Maximum total mass").within(Range::Positive),
        key(
            "start",
            Quantity(D::TIME),
            "0",
            "\"0.1 s\"",
            "When it begins; with `stage` relative to the beginning of that stage",
        )
        .within(Range::NotNegative),
        key("end", Quantity(D::TIME), "no limit", "\"2 s\"", "When it ends, likewise")
            .within(Range::Positive),
        key("stage", Text, "all stages", "\"fill\"", "Active only in the stage of this name"),
        key("seed", Count, "seed of the scene + number of the stream + 1000", "7", "Seed of this stream"),
    ],
};

pub(super) static OUTLET: Table = Table {
    heading: "`[outlet.NAME]`",
    alternatives: &[&["behind", "outside", "inside"]],
    keys: &[
        key(
            "behind",
            Kind::Table(&BEHIND),
            "one of behind, outside, inside",
            "{ point = [0, 0, -0.1], normal = [0, 0, -1] }",
            "Bodies of packings and streams leave when their centre of mass is on the side of the plane to which its normal points",
        ),
        key(
            "outside",
            Kind::Table(&REGION),
            "one of behind, outside, inside",
            "{ box = { min = [-1, -1, -1], max = [1, 1, 1] } }",
            "They leave when it is outside the region",
        ),
        key(
            "inside",
            Kind::Table(&REGION),
            "one of behind, outside, inside",
            "{ box = { min = [-1, -1, -1], max = [1, 1, 0] } }",
            "They leave when it is inside the region",
        ),
    ],
};

static BEHIND: Table = Table {
    heading: "`outlet.NAME.behind`",
    alternatives: &[],
    keys: &[
        key("point", Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"-10 cm\"]", "A point of the plane"),
        key("normal", Vector(D::NONE), "[0, 0, -1]", "[1, 0, 0]", "Its normal, of any length"),
    ],
};
