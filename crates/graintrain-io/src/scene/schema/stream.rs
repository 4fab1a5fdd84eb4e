//! Keys of streams and outlets.

use super::Kind::{self, Count, Flag, Quantity, QuantityOr, Tables, Text, Vector};
use super::body::{PART, SHAPE};
use super::load::REGION;
use super::packing::RADIUS;
use super::{D, Range, Table, key};

pub(super) static STREAM: Table = Table {
    heading: "`[stream.NAME]`",
    alternatives: &[&["radius", "shape", "parts"], &["rate", "mass_rate"]],
    keys: &[
        key(
            "region",
            Kind::Table(&REGION),
            "required",
            "{ cylinder = { base = [0, 0, 1], radius = 0.1, height = 0.1 } }",
            "Bodies enter wholly inside, at random places that are free; a body that finds none waits",
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
        key("random_rotation", Flag, "false", "true", "Bodies are turned at random"),
        key("material", Text, "the only material", "\"glass\"", "Material"),
        key(
            "velocity",
            Vector(D::SPEED),
            "[0, 0, 0]",
            "[0, 0, \"-1 m/s\"]",
            "Velocity with which they enter",
        ),
        key("lock_rotation", Flag, "false", "true", "Bodies keep their orientation"),
        key(
            "rate",
            Quantity(D::RATE),
            "as many as find a place",
            "\"200/s\"",
            "Bodies per second; those that had to wait come later",
        )
        .within(Range::Positive),
        key(
            "mass_rate",
            Quantity(D::MASS_RATE),
            "as many as find a place",
            "\"0.5 kg/s\"",
            "Mass per second, in the place of `rate`",
        )
        .within(Range::Positive),
        key("count", Count, "no limit", "500", "The stream ends after so many bodies"),
        key("mass", Quantity(D::MASS), "no limit", "\"2 kg\"", "It ends before it has given more than this")
            .within(Range::Positive),
        key(
            "start",
            Quantity(D::TIME),
            "0",
            "\"0.1 s\"",
            "When it begins; from the beginning of `stage`, where one is named",
        )
        .within(Range::NotNegative),
        key("end", Quantity(D::TIME), "no limit", "\"2 s\"", "When it ends, likewise")
            .within(Range::Positive),
        key("stage", Text, "all stages", "\"fill\"", "It flows only in the stage of this name"),
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
            "They leave when it is outside of the region",
        ),
        key(
            "inside",
            Kind::Table(&REGION),
            "one of behind, outside, inside",
            "{ box = { min = [-1, -1, -1], max = [1, 1, 0] } }",
            "They leave when it is inside of the region",
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
