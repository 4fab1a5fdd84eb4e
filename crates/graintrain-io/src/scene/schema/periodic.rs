//! Keys of periodic cells.

use super::Kind::{self, Function, Quantity, Texts, Vector};
use super::function::{PRESSURE, RATE};
use super::{D, Key, Range, Table, key};
use crate::scene::periodic::DIRECTIONS;

pub(super) static PERIODIC: Table = Table {
    heading: "`[periodic]`",
    alternatives: &[&["pressure", "stress"]],
    keys: &[
        key("min", Vector(D::LENGTH), "required", "[0, 0, 0]", "Lower corner of the cell"),
        key(
            "max",
            Vector(D::LENGTH),
            "required",
            "[\"10 cm\", \"10 cm\", \"20 cm\"]",
            "Upper corner of the cell",
        ),
        key("axes", Texts, "[\"x\", \"y\", \"z\"]", "[\"x\", \"y\"]", "Along which axes space repeats")
            .one_of(|| DIRECTIONS.to_vec()),
        RATES,
        STRESSES,
        ISOTROPIC,
        FASTEST,
    ],
};

pub(super) static STAGE_PERIODIC: Table = Table {
    heading: "`stage.periodic`",
    alternatives: &[&["pressure", "stress"]],
    keys: &[RATES, STRESSES, ISOTROPIC, FASTEST],
};

const RATES: Key = key(
    "rate",
    Kind::Table(&RATE_COMPONENTS),
    "the cell keeps its form",
    "{ xx = \"-0.1/s\", xy = \"0.5/s\" }",
    "Velocity gradient by components: ij is the velocity along i per way along j; xx, yy, zz stretch where they are positive, xy, xz, yz shear",
);
const STRESSES: Key = key(
    "stress",
    Kind::Table(&STRESS_COMPONENTS),
    "none",
    "{ zz = \"10 kPa\" }",
    "Imposed mean stress by components, compression positive, where no rate is: the cell deforms until its contacts carry it",
);
const ISOTROPIC: Key = key(
    "pressure",
    Function(D::PRESSURE, &PRESSURE),
    "none",
    "\"10 kPa\"",
    "The same stress xx, yy and zz, each by itself",
);
const FASTEST: Key = key(
    "fastest",
    Quantity(D::RATE),
    "no limit",
    "\"1/s\"",
    "Largest rate at which imposed stresses deform the cell, only with `stress` or `pressure`: what is loose else closes ever faster",
).within(Range::Positive);

macro_rules! components {
    ($name:ident, $heading:literal, $dimension:expr, $table:ident, $example:literal) => {
        static $name: Table = Table {
            heading: $heading,
            alternatives: &[],
            keys: &[
                key("xx", Function($dimension, &$table), "not imposed", $example, "Component xx"),
                key("yy", Function($dimension, &$table), "not imposed", $example, "Component yy"),
                key("zz", Function($dimension, &$table), "not imposed", $example, "Component zz"),
                key("xy", Function($dimension, &$table), "not imposed", $example, "Component xy"),
                key("xz", Function($dimension, &$table), "not imposed", $example, "Component xz"),
                key("yz", Function($dimension, &$table), "not imposed", $example, "Component yz"),
            ],
        };
    };
}

components!(RATE_COMPONENTS, "`periodic.rate`", D::RATE, RATE, "\"0.1/s\"");
components!(STRESS_COMPONENTS, "`periodic.stress`", D::PRESSURE, PRESSURE, "\"10 kPa\"");
