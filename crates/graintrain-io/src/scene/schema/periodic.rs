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
        key("axes", Texts, "[\"x\", \"y\", \"z\"]", "[\"x\", \"y\"]", "Periodic axes")
            .one_of(|| DIRECTIONS.to_vec()),
        RATES,
        STRESSES,
        ISOTROPIC,
        FASTEST,
    ],
};

pub(in super::super) static STAGE_PERIODIC: Table = Table {
    heading: "`stage.periodic`",
    alternatives: &[&["pressure", "stress"]],
    keys: &[RATES, STRESSES, ISOTROPIC, FASTEST],
};

const RATES: Key = key(
    "rate",
    Kind::Table(&RATE_COMPONENTS),
    "zero without a stress",
    "{ xx = \"-0.1/s\", xy = \"0.5/s\" }",
    "Velocity gradient by components, ij is du_i/dx_j: positive xx, yy, zz stretch; xy, xz, yz shear",
);
const STRESSES: Key = key(
    "stress",
    Kind::Table(&STRESS_COMPONENTS),
    "none",
    "{ zz = \"10 kPa\" }",
    "Imposed mean stress by components without a rate, compression positive: the cell deforms until the contact stress equals it",
);
const ISOTROPIC: Key = key(
    "pressure",
    Function(D::PRESSURE, &PRESSURE),
    "none",
    "\"10 kPa\"",
    "The same value for the stresses xx, yy and zz, each imposed independently",
);
const FASTEST: Key = key(
    "fastest",
    Quantity(D::RATE),
    "no limit",
    "\"1/s\"",
    "Largest deformation rate due to imposed stresses, only with `stress` or `pressure`; without this limit a loose sample contracts ever faster",
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
