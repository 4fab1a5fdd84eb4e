//! Keys of stages.

use super::Kind::{Functions, Named, Quantity, Text, TextOr, Texts};
use super::body::MOTION;
use super::function::ACCELERATION;
use super::{D, Table, key};

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
            "Longest duration of the stage",
        ),
        key(
            "at_least",
            Quantity(D::TIME),
            "0",
            "\"50 ms\"",
            "Duration before which the conditions below end nothing",
        ),
        key(
            "kinetic_energy",
            Quantity(D::ENERGY),
            "none",
            "\"1e-9 J\"",
            "The stage ends when the kinetic energy per body that can move is below this",
        ),
        key(
            "unbalanced_force",
            Quantity(D::NONE),
            "none",
            "0.01",
            "The stage ends when the mean net force on bodies is below this share of the mean contact force",
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
            "Properties of materials from this stage on; pairs with values of their own keep them",
        ),
        key(
            "body",
            Named(&STAGE_BODY),
            "unchanged",
            "{ lower = { motion = \"fixed\" } }",
            "Motions of bodies from this stage on",
        ),
        key(
            "loads",
            Texts,
            "unchanged",
            "[\"press\"]",
            "The loads that act from this stage on; all others do not",
        ),
    ],
};

static STAGE_MATERIAL: Table = Table {
    heading: "`stage.material.NAME`",
    alternatives: &[],
    keys: &[
        key("friction", Quantity(D::NONE), "unchanged", "0.5", "Coefficient of friction with itself"),
        key(
            "restitution",
            Quantity(D::NONE),
            "unchanged",
            "0",
            "Coefficient of restitution with itself, 0 to 1",
        ),
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
        "free, fixed, or a table as of bodies; its times count from the beginning of the stage",
    )],
};
