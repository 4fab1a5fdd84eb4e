//! Keys of loads.

use super::Kind::{self, Function, Functions, Quantity, Text, Texts, Vector};
use super::function::{ACCELERATION, FORCE, PRESSURE, TORQUE};
use super::packing::{BOX_REGION, CYLINDER_REGION};
use super::{D, Range, Table, key, names};
use crate::scene::file::AXES;

pub(super) static LOAD: Table = Table {
    heading: "`[load.NAME]`",
    alternatives: &[],
    keys: &[
        key("bodies", Texts, "all bodies, or those of packings", "[\"wheel\"]", "Bodies by name"),
        key(
            "packings",
            Texts,
            "all bodies, or those of bodies",
            "[\"grains\"]",
            "All bodies of packings by name",
        ),
        key(
            "region",
            Kind::Table(&REGION),
            "everywhere",
            "{ box = { min = [0, 0, 0], max = [1, 1, 1] } }",
            "Acts only on bodies whose centre of mass is inside",
        ),
        key(
            "force",
            Functions(D::FORCE, &FORCE),
            "none",
            "[0, 0, \"2 kN * sin(2*pi*t/4 s)\"]",
            "Force on each body; components are functions of time, `t` is the time of the run",
        ),
        key(
            "point",
            Vector(D::LENGTH),
            "the centre of mass",
            "[0, 0, \"5 cm\"]",
            "Point of application in the body's frame",
        ),
        key("torque", Functions(D::ENERGY, &TORQUE), "none", "[0, \"3 N m\", 0]", "Torque on each body"),
        key(
            "axes",
            Text,
            "\"world\"",
            "\"body\"",
            "Axes of force and torque: world, or body (rotating with it)",
        )
        .one_of(|| names(AXES)),
        key(
            "pressure",
            Kind::Table(&STRESS),
            "none",
            "{ stress = \"10 kPa\", area = 0.04, direction = [0, 0, -1] }",
            "Force of a stress on an area, for a wall that is free in its direction",
        ),
        key(
            "acceleration",
            Functions(D::ACCELERATION, &ACCELERATION),
            "none",
            "[\"0.3 m/s^2 * sin(2*pi*t/1 s)\", 0, 0]",
            "Uniform field: the same acceleration for every body",
        ),
        key(
            "central",
            Kind::Table(&CENTRAL),
            "none",
            "{ point = [0, 0, 0], strength = 9.81, distance = 1 }",
            "Central field",
        ),
        key(
            "drag",
            Kind::Table(&DRAG),
            "none",
            "{ linear = \"0.2 N s/m\" }",
            "Drag of a medium, -(linear + quadratic |u|) u with the velocity u relative to it",
        ),
    ],
};

pub(super) static REGION: Table = Table {
    heading: "`region`",
    alternatives: &[&["box", "cylinder"]],
    keys: &[
        key(
            "box",
            Kind::Table(&BOX_REGION),
            "one of box, cylinder",
            "{ min = [0, 0, 0], max = [1, 1, 3] }",
            "Box",
        ),
        key(
            "cylinder",
            Kind::Table(&CYLINDER_REGION),
            "one of box, cylinder",
            "{ radius = 1, height = 3 }",
            "Upright cylinder",
        ),
    ],
};

static STRESS: Table = Table {
    heading: "`pressure`",
    alternatives: &[],
    keys: &[
        key(
            "stress",
            Function(D::PRESSURE, &PRESSURE),
            "required",
            "\"10 kPa\"",
            "Stress, a function of time",
        ),
        key("area", Quantity(D::AREA), "required", "\"400 cm^2\"", "Area on which it acts")
            .within(Range::Positive),
        key(
            "direction",
            Vector(D::NONE),
            "required",
            "[0, 0, -1]",
            "Direction of the force in the world; any length",
        ),
    ],
};

static CENTRAL: Table = Table {
    heading: "`central`",
    alternatives: &[],
    keys: &[
        key("point", Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"-1 m\"]", "The centre"),
        key(
            "strength",
            Quantity(D::ACCELERATION),
            "required",
            "9.81",
            "Acceleration towards the centre at `distance`; negative: away from it",
        ),
        key(
            "distance",
            Quantity(D::LENGTH),
            "1",
            "\"6371 km\"",
            "Distance at which the acceleration is `strength`",
        )
        .within(Range::Positive),
        key("power", Quantity(D::NONE), "-2", "1", "Exponent of the distance"),
    ],
};

static DRAG: Table = Table {
    heading: "`drag`",
    alternatives: &[],
    keys: &[
        key("linear", Quantity(D::new(0, 1, -1, 0)), "0", "\"0.2 N s/m\"", "Force over velocity")
            .within(Range::NotNegative),
        key(
            "quadratic",
            Quantity(D::new(-1, 1, 0, 0)),
            "0",
            "\"0.5 * 1.2 kg/m^3 * 0.47 * 12 cm^2\"",
            "Force over velocity squared: 1/2 density c_d area",
        )
        .within(Range::NotNegative),
        key("angular", Quantity(D::new(2, 1, -1, 0)), "0", "\"0.01 N m s\"", "Torque over angular velocity")
            .within(Range::NotNegative),
        key("medium", Vector(D::SPEED), "[0, 0, 0]", "[\"5 m/s\", 0, 0]", "Velocity of the medium"),
    ],
};
