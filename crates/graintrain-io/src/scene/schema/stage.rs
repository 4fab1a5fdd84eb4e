//! Keys of stages.

use super::Kind::{self, Flag, Functions, Named, Quantity, Text, TextOr, Texts};
use super::body::MOTION;
use super::function::ACCELERATION;
use super::load::REGION;
use super::periodic::STAGE_PERIODIC;
use super::{D, Range, Table, key, names};
use crate::scene::file::MOTIONS;

pub(super) static STAGE: Table = Table {
    heading: "`[[stage]]`",
    alternatives: &[],
    keys: &[
        key("name", Text, "required", "\"settle\"", "Name"),
        key(
            "time",
            Quantity(D::TIME),
            "until `[time]` ends the run",
            "\"2 s\"",
            "Maximum duration of the stage",
        ).within(Range::Positive),
        key(
            "at_least",
            Quantity(D::TIME),
            "0",
            "\"50 ms\"",
            "Minimum duration before the conditions below apply",
        ).within(Range::NotNegative),
        key(
            "kinetic_energy",
            Quantity(D::ENERGY),
            "none",
            "\"1e-9 J\"",
            "The stage ends when the kinetic energy per body that can move is below this",
        ).within(Range::Positive),
        key(
            "unbalanced_force",
            Quantity(D::NONE),
            "none",
            "0.01",
            "The stage ends when the mean net force on bodies is below this fraction of the mean contact force. With few contacts this is true at once: give `at_least`",
        ).within(Range::Positive),
        key(
            "filled",
            Flag,
            "false",
            "true",
            "The stage ends when all streams active in it have inserted all their bodies",
        ),
        key(
            "steady",
            Kind::Table(&STEADY),
            "none",
            "{ measure = \"cell\", column = \"tau_over_sigma\", over = \"0.5 s\" }",
            "The stage ends when a measured quantity is steady",
        ),
        key(
            "growth",
            Kind::Table(&GROWTH),
            "none",
            "{ packings = [\"sand\"], rate = 0.2, porosity = 0.4, region = { box = { min = [0, 0, 0], max = [1, 1, 1] } } }",
            "Bodies grow; the stage ends when the porosity is reached",
        ),
        key(
            "gravity",
            Functions(D::ACCELERATION, &ACCELERATION),
            "unchanged",
            "[0, 0, 0]",
            "Gravity from this stage on",
        ),
        key(
            "material",
            Named(&STAGE_MATERIAL),
            "unchanged",
            "{ glass = { friction = 0 } }",
            "Properties of materials from this stage on; values of `pair` tables do not change",
        ),
        key(
            "body",
            Named(&STAGE_BODY),
            "unchanged",
            "{ lower = { motion = \"fixed\" } }",
            "Motions of bodies from this stage on",
        ),
        key(
            "periodic",
            Kind::Table(&STAGE_PERIODIC),
            "unchanged",
            "{ pressure = \"10 kPa\", rate = { xy = \"0.1/s\" } }",
            "Rates and stresses of the periodic cell from this stage on; other components have rate zero. `t` is the time since the stage began",
        ),
        key(
            "loads",
            Texts,
            "unchanged",
            "[\"press\"]",
            "The loads that act from this stage on; all others are off",
        ),
    ],
};

static STEADY: Table = Table {
    heading: "`stage.steady`",
    alternatives: &[],
    keys: &[
        key("measure", Text, "required", "\"cell\"", "Name of the measurement, one without bins"),
        key("column", Text, "required", "\"tau_over_sigma\"", "Column of its table"),
        key(
            "over",
            Quantity(D::TIME),
            "required",
            "\"0.5 s\"",
            "Time span of the latest records, divided into two halves; at least four records",
        )
        .within(Range::Positive),
        key(
            "change",
            Quantity(D::NONE),
            "0.01",
            "0.02",
            "Steady if the means of both halves differ by at most this fraction of the mean",
        )
        .within(Range::NotNegative),
        key(
            "within",
            Quantity(D::NONE),
            "0",
            "1e-3",
            "Or by at most this value, in the unit of the column (SI)",
        )
        .within(Range::NotNegative),
    ],
};

static GROWTH: Table = Table {
    heading: "`stage.growth`",
    alternatives: &[],
    keys: &[
        key("packings", Texts, "all, or those of streams", "[\"sand\"]", "Packings that grow"),
        key("streams", Texts, "all, or those of packings", "[\"rain\"]", "Streams whose bodies grow"),
        key(
            "rate",
            Quantity(D::RATE),
            "required",
            "\"0.2/s\"",
            "Relative growth rate of all lengths; growth pauses while bodies overlap by more than 1 % of their size",
        )
        .within(Range::Positive),
        key("porosity", Quantity(D::NONE), "required", "0.4", "Porosity at which growth and the stage end")
            .within(Range::Positive),
        key(
            "region",
            Kind::Table(&REGION),
            "required",
            "{ box = { min = [0, 0, 0], max = [1, 1, 1] } }",
            "Region in which the porosity is measured",
        ),
    ],
};

static STAGE_MATERIAL: Table = Table {
    heading: "`stage.material.NAME`",
    alternatives: &[],
    keys: &[
        key("friction", Quantity(D::NONE), "unchanged", "0.5", "Coefficient of friction with itself")
            .within(Range::NotNegative),
        key(
            "restitution",
            Quantity(D::NONE),
            "unchanged",
            "0",
            "Coefficient of restitution with itself, 0 to 1",
        )
        .within(Range::ZeroToOne),
    ],
};

static STAGE_BODY: Table = Table {
    heading: "`stage.body.NAME`",
    alternatives: &[],
    keys: &[key(
        "motion",
        TextOr(&MOTION),
        "required",
        "{ translation = [{ direction = [1, 0, 0], speed = 0.1 }] }",
        "free, fixed, or a table as for bodies; `t` is the time since the stage began",
    )
    .one_of(|| names(MOTIONS))],
};
