//! URDF files: links and joints as written, checked to be one tree.
//!
//! Source: the URDF specification, wiki.ros.org/urdf/XML. Lengths are m, angles rad, masses kg.

use crate::scene::packing::FileProblem;
use graintrain::joint::Pair;
use graintrain::math::{Mat3, Pose, Quat, Vec3};
use graintrain::shape::{Lengths, Shape};
use roxmltree::{Document, Node};
use std::str::FromStr;

/// Links that are read at most: joints of more bodies would be solved together for hours.
const MOST_LINKS: usize = 1000;

/// Mass and what belongs to it, in the frame of a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Inertial {
    pub mass: f64,
    pub centre: Vec3,
    /// About the centre of mass.
    pub tensor: Mat3,
}

/// The shape of a collision or a visual.
#[derive(Clone, Debug)]
pub(super) enum Form {
    Box {
        size: Vec3,
    },
    /// A shape of lengths alone, which have the names that scenes give them.
    Lengths(&'static Lengths, Vec<f64>),
    Mesh {
        file: String,
        scale: Vec3,
        line: usize,
    },
}

#[derive(Clone, Debug)]
pub(super) struct Link {
    pub name: String,
    /// `None` also for a mass of zero.
    pub inertial: Option<Inertial>,
    /// Placed in the frame of the link.
    pub shapes: Vec<(Pose, Form)>,
}

#[derive(Clone, Debug)]
pub(super) struct Joint {
    pub name: String,
    /// `None` of what is `floating`.
    pub pair: Option<Pair>,
    /// Numbers of links.
    pub parent: usize,
    pub child: usize,
    /// The child in the frame of the parent where the coordinate is zero.
    pub pose: Pose,
    /// Unit direction in the frame of the child.
    pub axis: Vec3,
    /// Stops.
    pub lower: Option<f64>,
    pub upper: Option<f64>,
    /// Largest force or torque, where it is above zero.
    pub effort: Option<f64>,
    pub damping: f64,
    pub friction: f64,
    /// Name of the joint that it follows, multiplier, offset.
    pub mimic: Option<(String, f64, f64)>,
    pub line: usize,
}

impl Joint {
    /// Whether the file gives it a coordinate: an angle or a slide.
    pub(super) fn moves(&self) -> bool {
        matches!(self.pair, Some(Pair::Revolute | Pair::Prismatic))
    }
}

#[derive(Clone, Debug)]
pub(super) struct Robot {
    pub links: Vec<Link>,
    /// A parent's joint is before those of its child.
    pub joints: Vec<Joint>,
    /// Number of the link that is nobody's child.
    pub root: usize,
}

/// Reads a URDF file; `shapes` are the elements that have the shapes, `collision` or `visual`.
pub(super) fn read(bytes: &[u8], shapes: &'static str) -> Result<Robot, FileProblem> {
    let text = std::str::from_utf8(bytes)
        .map_err(|_| FileProblem::new("it is not a text file: save it as UTF-8"))?;
    let document = Document::parse(text).map_err(|error| {
        FileProblem::at(error.pos().row as usize, format!("it is not valid XML: {error}"))
    })?;
    let root = document.root_element();
    let is_xacro = |node: &Node| node.tag_name().namespace().is_some_and(|space| space.contains("xacro"));
    if let Some(node) = root.descendants().find(is_xacro) {
        let problem = "it is a xacro file: expand it first, `xacro FILE > robot.urdf`";
        return Err(FileProblem::at(line(node), problem));
    }
    if !root.has_tag_name("robot") {
        let found = root.tag_name().name();
        return Err(FileProblem::at(
            line(root),
            format!("it is no URDF file: <robot> expected, not <{found}>"),
        ));
    }
    let most = of_name(root, "link").count().max(of_name(root, "joint").count());
    if most > MOST_LINKS {
        return Err(FileProblem::new(format!(
            "it has {most} links or joints: at most {MOST_LINKS} are read"
        )));
    }
    let links = of_name(root, "link").map(|node| link(node, shapes)).collect::<Result<Vec<_>, _>>()?;
    if let Some(k) = (1..links.len()).find(|&k| links[..k].iter().any(|link| link.name == links[k].name)) {
        return Err(FileProblem::new(format!("it has two links `{}`", links[k].name)));
    }
    let joints = of_name(root, "joint").map(|node| joint(node, &links)).collect::<Result<Vec<_>, _>>()?;
    in_order(links, joints)
}

/// The joints from the root outwards, each link with one parent at most.
fn in_order(links: Vec<Link>, mut joints: Vec<Joint>) -> Result<Robot, FileProblem> {
    for (k, joint) in joints.iter().enumerate() {
        if joints[..k].iter().any(|other| other.name == joint.name) {
            return Err(FileProblem::at(joint.line, format!("it has two joints `{}`", joint.name)));
        }
        if joints[..k].iter().any(|other| other.child == joint.child) {
            let child = &links[joint.child].name;
            return Err(FileProblem::at(
                joint.line,
                format!("the link `{child}` is the child of two joints"),
            ));
        }
    }
    let mut roots = (0..links.len()).filter(|&link| joints.iter().all(|joint| joint.child != link));
    let root = match (roots.next(), roots.next()) {
        (Some(root), None) => root,
        (Some(a), Some(b)) => {
            let [a, b] = [a, b].map(|link| &links[link].name);
            return Err(FileProblem::new(format!(
                "its links are no single tree: neither `{a}` nor `{b}` has a parent"
            )));
        }
        _ if links.is_empty() => return Err(FileProblem::new("it has no links")),
        _ => return Err(FileProblem::new("it has no link that is not the child of a joint")),
    };
    let mut sorted: Vec<Joint> = Vec::with_capacity(joints.len());
    let mut known = vec![false; links.len()];
    known[root] = true;
    while !joints.is_empty() {
        let (next, rest): (Vec<_>, Vec<_>) = joints.into_iter().partition(|joint| known[joint.parent]);
        if let (true, Some(joint)) = (next.is_empty(), rest.first()) {
            return Err(FileProblem::at(
                joint.line,
                format!("the joint `{}` is part of a loop of parents", joint.name),
            ));
        }
        next.iter().for_each(|joint| known[joint.child] = true);
        sorted.extend(next);
        joints = rest;
    }
    Ok(Robot { links, joints: sorted, root })
}

fn line(node: Node) -> usize {
    node.document().text_pos_at(node.range().start).row as usize
}

fn of_name<'a>(node: Node<'a, 'a>, name: &'a str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |child| child.has_tag_name(name))
}

fn child<'a>(node: Node<'a, 'a>, name: &'a str) -> Option<Node<'a, 'a>> {
    of_name(node, name).next()
}

fn needed<'a>(node: Node<'a, 'a>, attribute: &str) -> Result<&'a str, FileProblem> {
    node.attribute(attribute).map(str::trim).ok_or_else(|| {
        FileProblem::at(line(node), format!("<{}> lacks `{attribute}`", node.tag_name().name()))
    })
}

/// So many numbers, if the attribute is there.
fn numbers<const N: usize>(node: Node, attribute: &str) -> Result<Option<[f64; N]>, FileProblem> {
    let Some(text) = node.attribute(attribute) else { return Ok(None) };
    let words = text.split_ascii_whitespace().map(f64::from_str);
    let found: Option<Vec<f64>> = words.map(|word| word.ok().filter(|x| x.is_finite())).collect();
    match found.map(<[f64; N]>::try_from) {
        Some(Ok(numbers)) => Ok(Some(numbers)),
        _ => {
            let what = if N == 1 { "a number".to_string() } else { format!("{N} numbers") };
            Err(FileProblem::at(line(node), format!("`{attribute}` must be {what}, got `{text:.40}`")))
        }
    }
}

fn number(node: Node, attribute: &str) -> Result<Option<f64>, FileProblem> {
    Ok(numbers::<1>(node, attribute)?.map(|[x]| x))
}

/// A number above zero that must be there.
fn length(node: Node, attribute: &str) -> Result<f64, FileProblem> {
    needed(node, attribute)?;
    match number(node, attribute)? {
        Some(length) if length > 0.0 => Ok(length),
        _ => Err(FileProblem::at(line(node), format!("`{attribute}` must be above zero"))),
    }
}

/// The `origin` of an element: xyz, and roll, pitch, yaw about fixed axes.
fn pose(node: Node) -> Result<Pose, FileProblem> {
    let Some(origin) = child(node, "origin") else { return Ok(Pose::IDENTITY) };
    let position = numbers(origin, "xyz")?.map_or(Vec3::ZERO, Vec3::from_array);
    let [roll, pitch, yaw] = numbers(origin, "rpy")?.unwrap_or([0.0; 3]);
    let rotation = Quat::from_rotation_z(yaw) * Quat::from_rotation_y(pitch) * Quat::from_rotation_x(roll);
    Ok(Pose::from_parts(position, rotation))
}

fn link(node: Node, shapes: &'static str) -> Result<Link, FileProblem> {
    let inertial = child(node, "inertial").map(inertial).transpose()?;
    let mut placed = Vec::new();
    for element in of_name(node, shapes) {
        let geometry = child(element, "geometry");
        let geometry = geometry
            .ok_or_else(|| FileProblem::at(line(element), format!("<{shapes}> lacks a <geometry>")))?;
        if let Some(form) = form(geometry)? {
            placed.push((pose(element)?, form));
        }
    }
    Ok(Link {
        name: needed(node, "name")?.to_string(),
        inertial: inertial.filter(|inertial| inertial.mass > 0.0),
        shapes: placed,
    })
}

fn inertial(node: Node) -> Result<Inertial, FileProblem> {
    let Pose { translation: centre, rotation } = pose(node)?;
    let mass = match child(node, "mass") {
        Some(mass) => number(mass, "value")?.unwrap_or(0.0),
        None => 0.0,
    };
    if mass < 0.0 {
        return Err(FileProblem::at(line(node), format!("a mass must not be negative, got {mass}")));
    }
    let entry = |name| match child(node, "inertia") {
        Some(inertia) => Ok(number(inertia, name)?.unwrap_or(0.0)),
        None => Ok(0.0),
    };
    let [xx, yy, zz] = [entry("ixx")?, entry("iyy")?, entry("izz")?];
    let [xy, xz, yz] = [entry("ixy")?, entry("ixz")?, entry("iyz")?];
    let own = Mat3::from_cols_array_2d(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
    let turn = Mat3::from_quat(rotation);
    Ok(Inertial { mass, centre, tensor: turn * own * turn.transpose() })
}

/// The shape, unless the element is empty.
fn form(geometry: Node) -> Result<Option<Form>, FileProblem> {
    let Some(node) = geometry.children().find(Node::is_element) else { return Ok(None) };
    let form = match node.tag_name().name() {
        "box" => {
            needed(node, "size")?;
            let size = numbers(node, "size")?.map_or(Vec3::ZERO, Vec3::from_array);
            if size.min_element() <= 0.0 {
                return Err(FileProblem::at(line(node), "the sizes of a box must be above zero"));
            }
            Form::Box { size }
        }
        "mesh" => {
            let scale = numbers(node, "scale")?.map_or(Vec3::ONE, Vec3::from_array);
            if scale.to_array().contains(&0.0) {
                return Err(FileProblem::at(line(node), "no factor of a `scale` may be zero"));
            }
            Form::Mesh { file: needed(node, "filename")?.to_string(), scale, line: line(node) }
        }
        other => {
            let known = ["sphere", "cylinder", "capsule"].contains(&other);
            let form = Shape::BY_LENGTHS.iter().find(|form| known && form.name == other);
            let form = form.ok_or_else(|| {
                let problem = format!("<{other}> is no shape: sphere, box, cylinder, capsule or mesh");
                FileProblem::at(line(node), problem)
            })?;
            let lengths = form.lengths.iter().map(|one| length(node, one.name));
            Form::Lengths(form, lengths.collect::<Result<_, _>>()?)
        }
    };
    Ok(Some(form))
}

fn joint(node: Node, links: &[Link]) -> Result<Joint, FileProblem> {
    let (name, line) = (needed(node, "name")?.to_string(), line(node));
    let end = |which: &str| {
        let element = child(node, which)
            .ok_or_else(|| FileProblem::at(line, format!("the joint `{name}` lacks a <{which}>")))?;
        let link = needed(element, "link")?;
        links.iter().position(|known| known.name == link).ok_or_else(|| {
            FileProblem::at(line, format!("the joint `{name}` names the link `{link}`, which is not there"))
        })
    };
    let written = needed(node, "type")?;
    let pair = match written {
        "fixed" => Some(Pair::Fixed),
        "revolute" | "continuous" => Some(Pair::Revolute),
        "prismatic" => Some(Pair::Prismatic),
        "planar" => Some(Pair::Planar),
        "floating" => None,
        other => {
            let known = "fixed, revolute, continuous, prismatic, planar, floating";
            let problem = format!("the joint `{name}` is {other}, which is not supported: only {known} are");
            return Err(FileProblem::at(line, problem));
        }
    };
    let axis = child(node, "axis").map(|axis| numbers(axis, "xyz")).transpose()?.flatten();
    let axis = axis.map_or(Vec3::X, Vec3::from_array);
    let moves = matches!(pair, Some(Pair::Revolute | Pair::Prismatic));
    let axis = match axis.try_normalize() {
        Some(axis) => axis,
        None if pair.is_some_and(Pair::has_axis) => {
            return Err(FileProblem::at(line, format!("the axis of the joint `{name}` has no direction")));
        }
        None => Vec3::X,
    };
    let of = |element: &'static str, attribute: &'static str| match child(node, element) {
        Some(element) => number(element, attribute),
        None => Ok(None),
    };
    let stops = moves && written != "continuous";
    let mimic = match child(node, "mimic").filter(|_| moves) {
        None => None,
        Some(mimic) => Some((
            needed(mimic, "joint")?.to_string(),
            number(mimic, "multiplier")?.unwrap_or(1.0),
            number(mimic, "offset")?.unwrap_or(0.0),
        )),
    };
    Ok(Joint {
        pair,
        parent: end("parent")?,
        child: end("child")?,
        pose: pose(node)?,
        axis,
        lower: of("limit", "lower")?.filter(|_| stops),
        upper: of("limit", "upper")?.filter(|_| stops),
        effort: of("limit", "effort")?.filter(|&effort| effort > 0.0),
        damping: of("dynamics", "damping")?.unwrap_or(0.0),
        friction: of("dynamics", "friction")?.unwrap_or(0.0),
        mimic,
        name,
        line,
    })
}
