//! Keys of joints.

use super::Kind::{self, Flag, Function, Quantity, Rows, Text, Texts, Vector};
use super::function::{ANGLE, ANGULAR_SPEED, FORCE, LENGTH, SPEED, TORQUE};
use super::{D, Range, Table, key, names};
use crate::scene::joint::{ALONG, KINDS};

/// N m/rad
const TORSION: D = D::new(2, 1, -2, -1);

pub(super) static JOINT: Table = Table {
    heading: "`[joint.NAME]`",
    alternatives: &[],
    keys: &[
        key(
            "kind",
            Text,
            "required",
            "\"revolute\"",
            "fixed, revolute, prismatic, cylindrical, spherical, distance or gear",
        ).one_of(|| names(KINDS)),
        key(
            "bodies",
            Texts,
            "required unless a gear",
            "[\"arm\", \"bucket\"]",
            "Bodies A and B by name; a single one is B, connected to the world",
        ),
        key(
            "point",
            Vector(D::LENGTH),
            "required unless a distance or gear",
            "[0, 0, \"5 cm\"]",
            "Position of the joint in the world at time 0",
        ),
        key(
            "axis",
            Vector(D::NONE),
            "required of revolute, prismatic, cylindrical",
            "[0, 1, 0]",
            "Direction of its axis in the world at time 0; any length",
        ),
        key(
            "ends",
            Rows,
            "required of a distance",
            "[[0, 0, 1], [0.5, 0, 1]]",
            "End points on A and on B, in the world at time 0",
        ),
        key(
            "joints",
            Texts,
            "required of a gear",
            "[\"pinion\", \"wheel\"]",
            "The two joints coupled by a gear, defined above it",
        ),
        key(
            "ratio",
            Quantity(D::NONE),
            "required of a gear",
            "-0.25",
            "Velocity of the second joint over that of the first (rad/s or m/s), negative for opposite rotation",
        ),
        key(
            "along",
            Text,
            "\"turn\"",
            "\"slide\"",
            "For a cylindrical joint: turn (keys `motor`, `torsion_spring`, `angles`) or slide (keys `actuator`, `spring`, `travel`)",
        ).one_of(|| names(ALONG)),
        key(
            "motor",
            Kind::Table(&MOTOR),
            "none",
            "{ speed = \"20 rpm\", torque = \"50 N m\" }",
            "Drives an angle: at a speed with a maximum torque, or with a torque",
        ),
        key(
            "actuator",
            Kind::Table(&ACTUATOR),
            "none",
            "{ speed = \"5 cm/s\", force = \"2 kN\" }",
            "Drives a displacement or distance: at a speed with a maximum force, or with a force",
        ),
        key(
            "torsion_spring",
            Kind::Table(&TORSION_SPRING),
            "none",
            "{ stiffness = \"30 N m/rad\" }",
            "Spring and damper for an angle",
        ),
        key(
            "spring",
            Kind::Table(&SPRING),
            "none",
            "{ stiffness = \"10 kN/m\", damping = \"200 N s/m\" }",
            "Spring and damper for a displacement or distance",
        ),
        key(
            "angles",
            Kind::Table(&ANGLES),
            "none",
            "{ lower = \"-30 deg\" }",
            "Limits of an angle, which is zero at time 0",
        ),
        key(
            "travel",
            Kind::Table(&TRAVEL),
            "none",
            "{ upper = \"12 cm\" }",
            "Limits of a displacement, which is zero at time 0, or of a distance: with `upper` only a rope",
        ),
        key("collide", Flag, "false", "true", "Whether the two bodies collide with each other"),
    ],
};

pub(super) static MOTOR: Table = Table {
    heading: "`motor`",
    alternatives: &[],
    keys: &[
        key(
            "speed",
            Function(D::ANGULAR_SPEED, &ANGULAR_SPEED),
            "none: the torque itself",
            "\"20 rpm\"",
            "Angular speed of B relative to A, a function of time",
        ),
        key(
            "torque",
            Function(D::ENERGY, &TORQUE),
            "no limit",
            "\"50 N m\"",
            "Largest torque; without `speed` the torque on B, a function of time",
        ),
    ],
};

pub(super) static ACTUATOR: Table = Table {
    heading: "`actuator`",
    alternatives: &[],
    keys: &[
        key(
            "speed",
            Function(D::SPEED, &SPEED),
            "none: the force itself",
            "\"5 cm/s\"",
            "Velocity of the displacement or distance, a function of time",
        ),
        key(
            "force",
            Function(D::FORCE, &FORCE),
            "no limit",
            "\"2 kN\"",
            "Largest force; without `speed` the force on B, a function of time",
        ),
    ],
};

pub(super) static TORSION_SPRING: Table = Table {
    heading: "`torsion_spring`",
    alternatives: &[],
    keys: &[
        key("stiffness", Quantity(TORSION), "0", "\"30 N m/rad\"", "Torque per angle")
            .within(Range::NotNegative),
        key("damping", Quantity(D::new(2, 1, -1, -1)), "0", "\"2 N m s/rad\"", "Torque per angular speed")
            .within(Range::NotNegative),
        key(
            "rest",
            Function(D::ANGLE, &ANGLE),
            "0",
            "\"15 deg\"",
            "Angle without torque, a function of time",
        ),
    ],
};

pub(super) static SPRING: Table = Table {
    heading: "`spring`",
    alternatives: &[],
    keys: &[
        key("stiffness", Quantity(D::new(0, 1, -2, 0)), "0", "\"10 kN/m\"", "Force per length")
            .within(Range::NotNegative),
        key("damping", Quantity(D::new(0, 1, -1, 0)), "0", "\"200 N s/m\"", "Force per speed")
            .within(Range::NotNegative),
        key(
            "rest",
            Function(D::LENGTH, &LENGTH),
            "its value at time 0",
            "\"20 cm\"",
            "Displacement or distance without force, a function of time",
        ),
    ],
};

pub(super) static ANGLES: Table = Table {
    heading: "`angles`",
    alternatives: &[],
    keys: &[
        key("lower", Quantity(D::ANGLE), "none", "\"-30 deg\"", "Smallest angle"),
        key("upper", Quantity(D::ANGLE), "none", "\"1 rad\"", "Largest angle"),
    ],
};

pub(super) static TRAVEL: Table = Table {
    heading: "`travel`",
    alternatives: &[],
    keys: &[
        key("lower", Quantity(D::LENGTH), "none", "\"-5 cm\"", "Smallest displacement or distance"),
        key("upper", Quantity(D::LENGTH), "none", "\"12 cm\"", "Largest displacement or distance"),
    ],
};
