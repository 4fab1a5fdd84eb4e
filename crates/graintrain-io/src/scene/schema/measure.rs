//! Keys of measurements.

use super::Kind::{self, Count, Flag, Quantity, Text, Texts, Vector};
use super::load::REGION;
use super::{D, Range, Table, key, names};
use crate::scene::measure::AlongSpec;

pub(super) static MEASURE: Table = Table {
    heading: "`[measure.NAME]`",
    alternatives: &[],
    keys: &[
        key("bodies", Texts, "all that can move, or those of packings", "[\"wheel\"]", "Bodies by name"),
        key(
            "packings",
            Texts,
            "all that can move, or those of bodies",
            "[\"grains\"]",
            "All bodies of packings by name",
        ),
        key(
            "streams",
            Texts,
            "all that can move, or those of bodies and packings",
            "[\"rain\"]",
            "All bodies of streams by name",
        ),
        key(
            "region",
            Kind::Table(&REGION),
            "everywhere",
            "{ box = { min = [0, 0, 0], max = [1, 1, 1] } }",
            "Only bodies whose centre of mass is inside; the volume of stress, porosity and profiles (otherwise the box around the bodies)",
        ),
        key(
            "start",
            Quantity(D::TIME),
            "0",
            "\"2 s\"",
            "Time of the first record; crossings of planes are counted from then on",
        )
        .within(Range::NotNegative),
        key("stage", Text, "all stages", "\"shear\"", "Records only in the stage of this name"),
        key(
            "every",
            Quantity(D::TIME),
            "the time step",
            "\"10 ms\"",
            "Time between records; rounded to whole steps",
        )
        .within(Range::Positive),
        key(
            "stress",
            Flag,
            "false",
            "true",
            "Stress tensor by contacts, compression positive; pressure, deviator, kinetic pressure",
        ),
        key(
            "coordination",
            Flag,
            "false",
            "true",
            "Coordination number with and without rattlers, sliding fraction, hyperstaticity",
        ),
        key(
            "rattlers_below",
            Count,
            "2",
            "4",
            "Bodies with fewer neighbours in loaded contact, without rattlers, are rattlers; use 4 without friction",
        ),
        key("fabric", Flag, "false", "true", "Fabric tensor of the loaded contacts, and its anisotropy"),
        key("porosity", Flag, "false", "true", "Porosity and solid fraction"),
        key("forces", Flag, "false", "true", "Mean, standard deviation and maximum of normal forces"),
        key("cell", Flag, "false", "true", "Edges, offsets, strain and rate of the periodic cell"),
        key(
            "energy",
            Flag,
            "false",
            "true",
            "Energies; work and losses of the whole world since the beginning",
        ),
        key("motion", Flag, "false", "true", "Mass, centre of mass and its velocity"),
        key(
            "force",
            Kind::Table(&FORCE_ON),
            "none",
            "{ bodies = [\"floor\"] }",
            "Sum of contact forces and torques on some bodies, also walls; with a region only of contacts in it",
        ),
        key(
            "plane",
            Kind::Table(&PLANE),
            "none",
            "{ point = [0, 0, 0], normal = [0, 0, -1] }",
            "Mass and bodies that cross a plane (with a region only inside it), and the force through it",
        ),
        key(
            "exchange",
            Flag,
            "false",
            "true",
            "Bodies, mass and kinetic energy that entered through all streams (and by growth) and left through all outlets",
        ),
        key(
            "mixing",
            Kind::Table(&MIXING),
            "none",
            "{ packings = [\"red\"], cell = \"3 cm\" }",
            "Lacey's mixing index",
        ),
        key(
            "shear_box",
            Kind::Table(&SHEAR_BOX),
            "none",
            "{ sheared = \"lower\", pressing = \"press\", area = 0.04 }",
            "Shear and normal stress, their ratio, displacement and dilation of a shear box",
        ),
        key(
            "wheel",
            Kind::Table(&WHEEL),
            "none",
            "{ body = \"wheel\", radius = \"10 cm\" }",
            "Slip, sinkage, drawbar pull, load and torque of a wheel; the selected bodies are the soil bed",
        ),
        key(
            "repose",
            Kind::Table(&REPOSE),
            "none",
            "{ along = \"radius\", width = \"1 cm\" }",
            "Angle of repose of a heap",
        ),
        key(
            "profile",
            Kind::Table(&PROFILE),
            "none",
            "{ along = \"z\", from = 0, to = \"20 cm\", bins = 20 }",
            "Density, velocity and temperature in bins; the only key of its table, a record per bin",
        ),
        key(
            "histogram",
            Kind::Table(&HISTOGRAM),
            "none",
            "{ bins = 20, most = 5 }",
            "Distribution of normal forces over their mean; the only key of its table, a record per bin",
        ),
    ],
};

static FORCE_ON: Table = Table {
    heading: "`measure.force`",
    alternatives: &[],
    keys: &[
        key("bodies", Texts, "required", "[\"floor\", \"wall\"]", "Bodies by name"),
        key(
            "point",
            Vector(D::LENGTH),
            "[0, 0, 0]",
            "[0, 0, 1]",
            "Reference point of the torque, in the world",
        ),
    ],
};

static PLANE: Table = Table {
    heading: "`measure.plane`",
    alternatives: &[],
    keys: &[
        key("point", Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"5 cm\"]", "A point of the plane"),
        key("normal", Vector(D::NONE), "[0, 0, 1]", "[0, 0, -1]", "Positive direction; any length"),
    ],
};

static MIXING: Table = Table {
    heading: "`measure.mixing`",
    alternatives: &[],
    keys: &[
        key(
            "packings",
            Texts,
            "one of packings, streams",
            "[\"red\"]",
            "Packings of the first kind; all other selected bodies are the second",
        ),
        key("streams", Texts, "one of packings, streams", "[\"rain\"]", "Streams of the first kind"),
        key("cell", Quantity(D::LENGTH), "required", "\"3 cm\"", "Edge of the cells: a few bodies wide")
            .within(Range::Positive),
    ],
};

static SHEAR_BOX: Table = Table {
    heading: "`measure.shear_box`",
    alternatives: &[],
    keys: &[
        key("sheared", Text, "required", "\"lower\"", "The sheared body"),
        key("pressing", Text, "required", "\"press\"", "The pressing body"),
        key("direction", Vector(D::NONE), "[1, 0, 0]", "[0, 1, 0]", "Direction of shear; any length"),
        key(
            "normal",
            Vector(D::NONE),
            "[0, 0, 1]",
            "[0, 0, 1]",
            "From the sample to the pressing body; any length",
        ),
        key("area", Quantity(D::AREA), "required", "\"0.12 m * 0.12 m\"", "Area of the sample")
            .within(Range::Positive),
        key(
            "plane",
            Vector(D::LENGTH),
            "none",
            "[0, 0, \"3 cm\"]",
            "A point of the plane between the halves: stresses there from contacts of grains only, without walls, and with the weight above",
        ),
    ],
};

static WHEEL: Table = Table {
    heading: "`measure.wheel`",
    alternatives: &[],
    keys: &[
        key("body", Text, "required", "\"wheel\"", "The wheel; its centre of mass is on its axis"),
        key("radius", Quantity(D::LENGTH), "required", "\"10 cm\"", "Radius for slip and sinkage")
            .within(Range::Positive),
        key(
            "axis",
            Vector(D::NONE),
            "[0, 1, 0]",
            "[0, 1, 0]",
            "Axle; positive rotation rolls forward, in the direction axis x up; any length",
        ),
    ],
};

static REPOSE: Table = Table {
    heading: "`measure.repose`",
    alternatives: &[],
    keys: &[
        key(
            "along",
            Text,
            "\"radius\"",
            "\"x\"",
            "Direction in which the surface descends: x, y, z or radius",
        )
        .one_of(|| names(AlongSpec::NAMES)),
        key(
            "centre",
            Vector(D::LENGTH),
            "[0, 0, 0]",
            "[\"5 cm\", 0, 0]",
            "Point of the vertical axis of the radius",
        ),
        key(
            "width",
            Quantity(D::LENGTH),
            "required",
            "\"1 cm\"",
            "Width of the columns whose tops define the surface: one or two diameters",
        )
        .within(Range::Positive),
    ],
};

static PROFILE: Table = Table {
    heading: "`measure.profile`",
    alternatives: &[],
    keys: &[
        key("along", Text, "\"z\"", "\"radius\"", "Direction of the bins: x, y, z or radius")
            .one_of(|| names(AlongSpec::NAMES)),
        key(
            "centre",
            Vector(D::LENGTH),
            "[0, 0, 0]",
            "[\"5 cm\", 0, 0]",
            "Point of the vertical axis of the radius",
        ),
        key("from", Quantity(D::LENGTH), "required", "0", "Lower edge of the first bin"),
        key("to", Quantity(D::LENGTH), "required", "\"20 cm\"", "Upper edge of the last bin"),
        key("bins", Count, "required", "20", "Number of bins"),
    ],
};

static HISTOGRAM: Table = Table {
    heading: "`measure.histogram`",
    alternatives: &[],
    keys: &[
        key("bins", Count, "20", "40", "Number of bins"),
        key("most", Quantity(D::NONE), "5", "8", "Largest ratio of a normal force to the mean")
            .within(Range::Positive),
    ],
};
