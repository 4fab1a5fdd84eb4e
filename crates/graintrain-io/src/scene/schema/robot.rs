//! Keys of robots: URDF files that become bodies and joints.

use super::Kind::{self, Count, Flag, Named, Quantity, Text, Texts, Vector};
use super::body::ROTATION;
use super::{D, Range, Table, key, names};
use crate::scene::joint::{ANGLES, ActuatorSpec, MotorSpec, SpringSpec, StopsSpec, TORSION_SPRING};
use crate::scene::robot::{INERTIA, SHAPES};
use crate::scene::table::Spec;

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
        key("fixed", Flag, "true if its first link is called `world`", "true", "Whether its first link is fixed"),
        key("material", Text, "the only material", "\"steel\"", "Material of its links"),
        key(
            "self_collision",
            Flag,
            "false",
            "true",
            "Whether its links collide with each other; links connected by a joint never do",
        ),
        key(
            "inertia",
            Text,
            "\"file\"",
            "\"mended\"",
            "Treatment of moments of inertia that no body can have: file (an error) or mended (they and the centre of mass are computed from mass and shapes; for a link without shape as of a sphere)",
        )
        .one_of(|| names(INERTIA)),
        key(
            "shapes",
            Text,
            "\"collision\"",
            "\"visual\"",
            "Elements of its links used as shapes: collision or visual",
        )
        .one_of(|| names(SHAPES)),
        key(
            "solid",
            Texts,
            "none",
            "[\"bucket\"]",
            "Links whose meshes are used directly, as closed surfaces, not their hulls: buckets, wheels with grousers",
        ),
        key("corners", Count, "64", "128", "Maximum number of vertices of the hull of each mesh").within(Range::Positive),
        key(
            "packages",
            Text,
            "searched in the parent folders of the file",
            "\"../share\"",
            "Folder that holds the packages of its `package://` paths",
        ),
        key(
            "joint",
            Named(&ROBOT_JOINT),
            "as in the file",
            "{ elbow = { angle = \"-90 deg\", motor = { speed = 0 } } }",
            "Initial positions and drives of its joints, by their names in the file",
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
            "0, or the limit nearest to it",
            "\"30 deg\"",
            "Initial angle in the URDF convention",
        ),
        key(
            "slide",
            Quantity(D::LENGTH),
            "0, or the limit nearest to it",
            "\"5 cm\"",
            "Initial displacement in the URDF convention",
        ),
        key(
            "motor",
            Kind::Table(MotorSpec::TABLE),
            "none",
            "{ speed = \"20 rpm\" }",
            "As in a joint; the default of the maximum torque is the file's `effort`",
        ),
        key(
            "actuator",
            Kind::Table(ActuatorSpec::TABLE),
            "none",
            "{ speed = \"5 cm/s\" }",
            "The same for a displacement",
        ),
        key(
            "torsion_spring",
            Kind::Table(&TORSION_SPRING),
            "the file's `damping`",
            "{ stiffness = \"30 N m/rad\" }",
            "As in a joint; its angles are relative to the initial angle",
        ),
        key(
            "spring",
            Kind::Table(SpringSpec::TABLE),
            "the file's `damping`",
            "{ stiffness = \"10 kN/m\" }",
            "The same for a displacement",
        ),
        key(
            "angles",
            Kind::Table(&ANGLES),
            "the file's",
            "{ upper = \"90 deg\" }",
            "Limits of an angle in the URDF convention",
        ),
        key(
            "travel",
            Kind::Table(StopsSpec::TABLE),
            "the file's",
            "{ upper = \"12 cm\" }",
            "Limits of a displacement in the URDF convention",
        ),
    ],
};
