//! Keys of robots: URDF files that become bodies and joints.

use super::Kind::{self, Count, Flag, Named, Quantity, Text, Texts, Vector};
use super::body::ROTATION;
use super::joint::{ACTUATOR, ANGLES, MOTOR, SPRING, TORSION_SPRING, TRAVEL};
use super::{D, Range, Table, key, names};
use crate::scene::robot::{INERTIA, SHAPES};

pub(super) static ROBOT: Table = Table {
    heading: "`[robot.NAME]`",
    alternatives: &[],
    keys: &[
        key("file", Text, "required", "\"arm.urdf\"", "URDF file: its link L becomes the body `NAME/L`, its joint J the joint `NAME/J`"),
        key("position", Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"40 cm\"]", "Origin of its first link in the world"),
        key(
            "rotation",
            Kind::Table(&ROTATION),
            "none",
            "{ axis = [0, 0, 1], angle = \"90 deg\" }",
            "Rotation of its first link",
        ),
        key("fixed", Flag, "whether its first link is called `world`", "true", "Whether its first link is held"),
        key("material", Text, "the only material", "\"steel\"", "Material of its links"),
        key(
            "self_collision",
            Flag,
            "false",
            "true",
            "Whether its links collide with each other; those that a joint connects never do",
        ),
        key(
            "inertia",
            Text,
            "\"file\"",
            "\"mended\"",
            "Moments of inertia that no body can have: file (an error) or mended (they and the centre of mass follow from mass and shapes; of a link without shape: those of a ball)",
        )
        .one_of(|| names(INERTIA)),
        key(
            "shapes",
            Text,
            "\"collision\"",
            "\"visual\"",
            "The elements of its links that bodies touch with: collision or visual",
        )
        .one_of(|| names(SHAPES)),
        key(
            "solid",
            Texts,
            "none",
            "[\"bucket\"]",
            "Links whose meshes stay as they are, closed surfaces, instead of their hulls: buckets, wheels with grousers",
        ),
        key("corners", Count, "64", "128", "Corners at most of the hull that each mesh becomes").within(Range::Positive),
        key(
            "packages",
            Text,
            "found from the file upwards",
            "\"../share\"",
            "Folder that holds the packages of its `package://` paths",
        ),
        key(
            "joint",
            Named(&ROBOT_JOINT),
            "as in the file",
            "{ elbow = { angle = \"-90 deg\", motor = { speed = 0 } } }",
            "Where its joints start, and what drives them, by their names in the file",
        ),
    ],
};

static ROBOT_JOINT: Table = Table {
    heading: "`[robot.NAME.joint.NAME]`",
    alternatives: &[&["angle", "slide"], &["motor", "actuator"], &["torsion_spring", "spring"]],
    keys: &[
        key(
            "angle",
            Quantity(D::ANGLE),
            "0, or the stop nearest to it",
            "\"30 deg\"",
            "Angle at the start, as the file counts it",
        ),
        key(
            "slide",
            Quantity(D::LENGTH),
            "0, or the stop nearest to it",
            "\"5 cm\"",
            "Slide at the start, as the file counts it",
        ),
        key(
            "motor",
            Kind::Table(&MOTOR),
            "none",
            "{ speed = \"20 rpm\" }",
            "As in a joint; the torque is the file's `effort` at the most unless given",
        ),
        key("actuator", Kind::Table(&ACTUATOR), "none", "{ speed = \"5 cm/s\" }", "The same of a slide"),
        key(
            "torsion_spring",
            Kind::Table(&TORSION_SPRING),
            "the file's `damping`",
            "{ stiffness = \"30 N m/rad\" }",
            "As in a joint: its angles count from where the joint starts",
        ),
        key(
            "spring",
            Kind::Table(&SPRING),
            "the file's `damping`",
            "{ stiffness = \"10 kN/m\" }",
            "The same of a slide",
        ),
        key(
            "angles",
            Kind::Table(&ANGLES),
            "the file's",
            "{ upper = \"90 deg\" }",
            "Stops of an angle, as the file counts it",
        ),
        key(
            "travel",
            Kind::Table(&TRAVEL),
            "the file's",
            "{ upper = \"12 cm\" }",
            "Stops of a slide, as the file counts it",
        ),
    ],
};
