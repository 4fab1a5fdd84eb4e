//! Robots: URDF files as bodies and joints of a scene.
//!
//! Links that `fixed` joints hold together are one body, under the name of the first of them that has a mass
//! or a shape. Links without mass and shape that carry nothing are left out. A joint's coordinate is zero
//! where it starts, so stops are moved by that. A joint that mimics another is a gear; friction in a joint is
//! a motor at rest with that torque at the most.

mod urdf;

use super::error::SceneError;
use super::joint::{
    ANGLES, ActuatorSpec, JointForm, JointSpec, MotorSpec, SpringSpec, StopsSpec, TORSION_SPRING,
};
use super::model::{
    BodySpec, BoxSpec, FunctionSpec, HullSpec, MeshSpec, MotionSpec, PartSpec, RotationSpec, RotationTable,
    ShapeSpec,
};
use super::names;
use super::packing::{FileProblem, read_file};
use super::reader::Reader;
use super::table::{Choice, Spec, table};
use graintrain::joint::Pair;
use graintrain::math::{Mat3, Pose, Quat, Vec3, parallel_axis};
use graintrain::world::MassProperties;
use serde::Serialize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use urdf::{Form, Inertial, Joint, Robot};

table! {
    /// A robot.
    pub(super) struct RobotSpec: "`[robot.NAME]`" {
        /// URDF file: its link L becomes the body `NAME/L`, its joint J the joint `NAME/J`
        file: PathBuf = Text, "required", "\"arm.urdf\"";
        /// Origin of its first link in the world
        position: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"40 cm\"]";
        /// Rotation of its first link
        rotation: RotationSpec = Table(RotationTable::TABLE), "none",
            "{ axis = [0, 0, 1], angle = \"90 deg\" }";
        /// Whether its first link is fixed
        fixed: Option<bool> = Flag, "true if its first link is called `world`", "true";
        /// Material of its links
        material: String = Text, "the only material", "\"steel\"" => names::material;
        /// Whether its links collide with each other; links connected by a joint never do
        self_collision: bool = Flag, "false", "true";
        /// Treatment of moments of inertia that no body can have: file (an error) or mended (they and the
        /// centre of mass are computed from mass and shapes; for a link without shape as of a sphere)
        inertia: Inertia = Text, "\"file\"", "\"mended\"";
        /// Elements of its links used as shapes: collision or visual
        shapes: Element = Text, "\"collision\"", "\"visual\"";
        /// Links whose meshes are used directly, as closed surfaces, not their hulls: buckets, wheels with
        /// grousers
        solid = Texts, "none", "[\"bucket\"]";
        /// Maximum number of vertices of the hull of each mesh
        corners: u64 = Count, "64", "128", Positive;
        /// Folder that holds the packages of its `package://` paths
        packages: Option<PathBuf> = Text, "searched in the parent folders of the file", "\"../share\"";
        /// Initial positions and drives of its joints, by their names in the file
        joint = Named(RobotJoint::TABLE), "as in the file",
            "{ elbow = { angle = \"-90 deg\", motor = { speed = 0 } } }";
    }
}

table! {
    /// What the scene says of a joint.
    #[derive(Default)]
    struct RobotJoint: "`[robot.NAME.joint.NAME]`",
        at most one of ["angle", "slide"],
        at most one of ["motor", "actuator"],
        at most one of ["torsion_spring", "spring"] {
        /// Initial angle in the URDF convention
        angle: Option<f64> = Quantity(D::ANGLE), "0, or the limit nearest to it", "\"30 deg\"";
        /// Initial displacement in the URDF convention
        slide: Option<f64> = Quantity(D::LENGTH), "0, or the limit nearest to it", "\"5 cm\"";
        /// As in a joint; the default of the maximum torque is the file's `effort`
        motor: Option<MotorSpec> = Table(MotorSpec::TABLE), "none", "{ speed = \"20 rpm\" }";
        /// The same for a displacement
        actuator: Option<ActuatorSpec> = Table(ActuatorSpec::TABLE), "none", "{ speed = \"5 cm/s\" }";
        /// As in a joint; its angles are relative to the initial angle
        torsion_spring: Option<SpringSpec> = Table(&TORSION_SPRING), "the file's `damping`",
            "{ stiffness = \"30 N m/rad\" }";
        /// The same for a displacement
        spring: Option<SpringSpec> = Table(SpringSpec::TABLE), "the file's `damping`",
            "{ stiffness = \"10 kN/m\" }";
        /// Limits of an angle in the URDF convention
        angles: Option<StopsSpec> = Table(&ANGLES), "the file's", "{ upper = \"90 deg\" }";
        /// Limits of a displacement in the URDF convention
        travel: Option<StopsSpec> = Table(StopsSpec::TABLE), "the file's", "{ upper = \"12 cm\" }";
    }
}

/// What a robot becomes.
pub(super) struct Parts {
    pub bodies: Vec<(String, BodySpec)>,
    /// Gears last.
    pub joints: Vec<(String, JointSpec)>,
}

impl RobotJoint {
    /// Where it starts, as the file counts.
    fn coordinate(&self) -> Option<f64> {
        self.angle.or(self.slide)
    }

    /// The lower and the upper stop, as the file counts.
    fn stops(&self, joint: &Joint) -> [Option<f64>; 2] {
        let own = self.angles.as_ref().or(self.travel.as_ref());
        own.map_or([joint.lower, joint.upper], |stops| [stops.lower, stops.upper])
    }
}

/// Links that move as one.
#[derive(Default)]
struct Lump {
    /// Number of the first link with a mass or a shape.
    named_by: Option<usize>,
    /// In the frame of its first link.
    inertial: Option<Inertial>,
    /// Of the links of these numbers, in that frame.
    shapes: Vec<(usize, Pose, Form)>,
    /// Whether anything hangs on it that has a mass or a shape.
    is_needed: bool,
}

/// Which elements of a link have its shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(super) enum Element {
    Collision,
    Visual,
}

impl Choice for Element {
    const NAMES: &'static [(&'static str, Self)] =
        &[("collision", Self::Collision), ("visual", Self::Visual)];
}

/// What becomes of moments of inertia that no body can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(super) enum Inertia {
    /// They are an error.
    File,
    /// They are computed from mass and shapes.
    Mended,
}

impl Choice for Inertia {
    const NAMES: &'static [(&'static str, Self)] = &[("file", Self::File), ("mended", Self::Mended)];
}

/// Reads a robot of the scene and its file.
pub(super) fn read(name: &str, reader: &Reader) -> Result<Parts, SceneError> {
    let spec = RobotSpec::read(reader)?;
    let location = reader.location_of(&["file"]);
    let problem = |problem: FileProblem| problem.located(&spec.file, location);
    let element =
        Element::NAMES.iter().find(|(_, element)| *element == spec.shapes).map_or("", |(name, _)| name);
    let robot = urdf::read(&read_file(&spec.file, location)?, element).map_err(problem)?;
    let links: Vec<&str> = robot.links.iter().map(|link| link.name.as_str()).collect();
    let given = given(reader, &robot)?;
    let coordinates = coordinates(&robot, &given).map_err(problem)?;
    let import = Import {
        name,
        reader,
        spec: &spec,
        owners: owners(&robot),
        places: places(&robot, &coordinates, Pose::from_parts(spec.position, spec.rotation.0)),
        lumps: Vec::new(),
        solid: names::list(reader, "solid", "link of the file", &links)?,
        fixed: spec.fixed.unwrap_or(robot.links[robot.root].name == "world"),
        robot: &robot,
    };
    let import = Import { lumps: import.lumps(), ..import };
    let bodies = import.bodies()?;
    let joints = import.joints(given, &coordinates).map_err(problem)?;
    Ok(Parts { bodies, joints })
}

/// What the scene says of each joint of the file.
fn given(reader: &Reader, robot: &Robot) -> Result<Vec<RobotJoint>, SceneError> {
    let named = reader.named("joint")?;
    let known = robot.joints.iter().filter(|joint| joint.moves()).map(|joint| joint.name.as_str());
    if let Some((name, _)) = named.iter().find(|(name, _)| !known.clone().any(|joint| joint == name)) {
        return Err(reader.unknown_name("joint", "joint of the file", name, known));
    }
    let of = |joint: &Joint| {
        let Some((_, own)) = named.iter().find(|(name, _)| *name == joint.name) else {
            return Ok(RobotJoint::default());
        };
        let turns = joint.pair == Some(Pair::Revolute);
        let (own_keys, useless) = if turns { (TURNING, SLIDING) } else { (SLIDING, TURNING) };
        if let Some(key) = useless.into_iter().find(|key| own.get(key).is_some()) {
            let how = if turns { "turns" } else { "slides" };
            let problem = format!("`{}` has no meaning for a joint that {how}: remove it", own.full(key));
            return Err(own.refuse(problem));
        }
        let spec = RobotJoint::read(own)?;
        let (lower, upper) = range(spec.stops(joint));
        if let Some(outside) = spec.coordinate().filter(|x| !(lower..=upper).contains(x)) {
            let requirement = format!("between its stops, {lower} and {upper}");
            return Err(own.out_of_range(own_keys[0], &requirement, outside));
        }
        Ok(spec)
    };
    robot.joints.iter().map(of).collect()
}

/// Keys of joints that turn and of those that slide: where they start, spring, stops, drive.
const TURNING: [&str; 4] = ["angle", "torsion_spring", "angles", "motor"];
const SLIDING: [&str; 4] = ["slide", "spring", "travel", "actuator"];

/// From the lower to the upper stop, without end where there is none.
fn range([lower, upper]: [Option<f64>; 2]) -> (f64, f64) {
    (lower.unwrap_or(f64::NEG_INFINITY), upper.unwrap_or(f64::INFINITY))
}

/// Where the joints start, as the file counts: as given, by the joint that they mimic, or nearest to zero.
fn coordinates(robot: &Robot, given: &[RobotJoint]) -> Result<Vec<f64>, FileProblem> {
    let by_name: HashMap<&str, usize> =
        robot.joints.iter().enumerate().map(|(k, joint)| (joint.name.as_str(), k)).collect();
    let of = |start: &Joint| {
        let (mut k, mut factor, mut sum) = (by_name[start.name.as_str()], 1.0, 0.0);
        for _ in &robot.joints {
            let joint = &robot.joints[k];
            let Some((leader, multiplier, offset)) =
                joint.mimic.as_ref().filter(|_| given[k].coordinate().is_none())
            else {
                let (lower, upper) = range(given[k].stops(joint));
                return Ok(sum + factor * given[k].coordinate().unwrap_or(0.0_f64.max(lower).min(upper)));
            };
            (sum, factor) = (sum + factor * offset, factor * multiplier);
            k = *by_name.get(leader.as_str()).ok_or_else(|| {
                let problem = format!("the joint `{}` mimics `{leader}`, which is not there", joint.name);
                FileProblem::at(joint.line, problem)
            })?;
        }
        // More steps than joints are a circle.
        Err(FileProblem::at(start.line, format!("the joint `{}` mimics itself in the end", start.name)))
    };
    robot.joints.iter().map(of).collect()
}

/// The first link of the lump of each link.
fn owners(robot: &Robot) -> Vec<usize> {
    let mut owners: Vec<usize> = (0..robot.links.len()).collect();
    for joint in robot.joints.iter().filter(|joint| joint.pair == Some(Pair::Fixed)) {
        owners[joint.child] = owners[joint.parent];
    }
    owners
}

/// The frames of the links in the world.
fn places(robot: &Robot, coordinates: &[f64], root: Pose) -> Vec<Pose> {
    let mut places = vec![root; robot.links.len()];
    for (joint, &q) in robot.joints.iter().zip(coordinates) {
        let own = match joint.pair {
            Some(Pair::Revolute) => Pose::from_rotation(Quat::from_axis_angle(joint.axis, q)),
            Some(Pair::Prismatic) => Pose::from_translation(q * joint.axis),
            _ => Pose::IDENTITY,
        };
        places[joint.child] = places[joint.parent] * joint.pose * own;
    }
    places
}

/// A robot on its way into a scene.
struct Import<'a> {
    name: &'a str,
    reader: &'a Reader<'a>,
    spec: &'a RobotSpec,
    robot: &'a Robot,
    /// First links of the lumps.
    owners: Vec<usize>,
    /// Frames of the links in the world.
    places: Vec<Pose>,
    /// By the numbers of their first links.
    lumps: Vec<Lump>,
    /// Links whose meshes stay as they are.
    solid: Vec<String>,
    /// Whether the first link is held.
    fixed: bool,
}

impl Import<'_> {
    fn lumps(&self) -> Vec<Lump> {
        let robot = self.robot;
        let mut lumps: Vec<Lump> = robot.links.iter().map(|_| Lump::default()).collect();
        let in_order = std::iter::once(robot.root).chain(robot.joints.iter().map(|joint| joint.child));
        for link in in_order {
            let (own, lump) = (&robot.links[link], &mut lumps[self.owners[link]]);
            let frame = self.places[self.owners[link]].inv_mul(&self.places[link]);
            let inertial = own.inertial.map(|inertial| moved(inertial, frame));
            lump.inertial = match (lump.inertial, inertial) {
                (Some(a), Some(b)) => Some(joined(a, b)),
                (a, b) => a.or(b),
            };
            lump.shapes.extend(own.shapes.iter().map(|(pose, form)| (link, frame * *pose, form.clone())));
            if own.inertial.is_some() || !own.shapes.is_empty() {
                lump.named_by.get_or_insert(link);
                lump.is_needed = true;
            }
        }
        for joint in robot.joints.iter().rev() {
            let needed = lumps[self.owners[joint.child]].is_needed;
            lumps[self.owners[joint.parent]].is_needed |= needed;
        }
        lumps
    }

    /// Whether the lump of a link is the world: held, and without a shape.
    fn is_world(&self, owner: usize) -> bool {
        self.fixed && owner == self.owners[self.robot.root] && self.lumps[owner].shapes.is_empty()
    }

    /// The body of a lump.
    fn body_name(&self, owner: usize) -> String {
        let link = self.lumps[owner].named_by.unwrap_or(owner);
        format!("{}/{}", self.name, self.robot.links[link].name)
    }

    fn bodies(&self) -> Result<Vec<(String, BodySpec)>, SceneError> {
        let collide = self.spec.self_collision;
        let mut bodies: Vec<(String, BodySpec)> = Vec::new();
        let in_order =
            std::iter::once(self.robot.root).chain(self.robot.joints.iter().map(|joint| joint.child));
        for owner in in_order.filter(|&link| self.owners[link] == link) {
            if self.lumps[owner].is_needed && !self.is_world(owner) {
                let mut spec = self.body(owner)?;
                if !collide {
                    spec.ignores = bodies.iter().map(|(name, _)| name.clone()).collect();
                }
                bodies.push((self.body_name(owner), spec));
            }
        }
        Ok(bodies)
    }

    fn body(&self, owner: usize) -> Result<BodySpec, SceneError> {
        let lump = &self.lumps[owner];
        let part = |(link, pose, form): &(usize, Pose, Form)| {
            let rotation = RotationSpec(pose.rotation.normalize());
            Ok(PartSpec { shape: self.shape(*link, form)?, position: pose.translation, rotation })
        };
        let parts = lump.shapes.iter().map(part).collect::<Result<Vec<_>, SceneError>>()?;
        if parts.is_empty() && lump.inertial.is_none() {
            let problem = format!(
                "the link `{}` moves, but has neither a mass nor a shape: give it an <inertial>, or hold the robot with `fixed = true`",
                self.robot.links[owner].name
            );
            return Err(self.refuse(FileProblem::new(problem)));
        }
        let held = self.fixed && owner == self.robot.root;
        let inertial = lump.inertial.filter(|_| !held);
        let given = self.usable(owner, inertial, parts.is_empty())?;
        let Pose { translation: position, rotation } = self.places[owner];
        Ok(BodySpec {
            parts,
            material: self.spec.material.clone(),
            position,
            rotation: RotationSpec(rotation.normalize()),
            velocity: Vec3::ZERO,
            angular_velocity: Vec3::ZERO,
            mass: inertial.map(|inertial| inertial.mass),
            inertia: given.map(|Inertial { tensor: t, .. }| Vec3::new(t.x_axis.x, t.y_axis.y, t.z_axis.z)),
            products: given.map(|Inertial { tensor: t, .. }| Vec3::new(t.y_axis.x, t.z_axis.x, t.z_axis.y)),
            centre: given.map(|inertial| inertial.centre),
            density: None,
            motion: if held { MotionSpec::FIXED } else { MotionSpec::FREE },
            ignores: Vec::new(),
            location: self.reader.location().clone(),
        })
    }

    /// The inertia that a body is given: that of the file, or where no body can have that and it is to be
    /// mended, none (it follows from the shapes) or, of a body without shapes, that of a ball with the same
    /// sum of moments.
    fn usable(
        &self,
        owner: usize,
        inertial: Option<Inertial>,
        is_formless: bool,
    ) -> Result<Option<Inertial>, SceneError> {
        let Some(inertial) = inertial else { return Ok(None) };
        let label = format!("`{}`", self.robot.links[owner].name);
        let check = |inertial: &Inertial| {
            MassProperties { mass: inertial.mass, inertia: inertial.tensor }.validate(&label)
        };
        let Err(error) = check(&inertial) else { return Ok(Some(inertial)) };
        let Mat3 { x_axis, y_axis, z_axis } = inertial.tensor;
        let moment = (x_axis.x + y_axis.y + z_axis.z) / 3.0;
        let ball = Inertial { tensor: Mat3::from_diagonal(Vec3::splat(moment)), ..inertial };
        let is_mended = self.spec.inertia == Inertia::Mended;
        match is_formless.then_some(ball) {
            None if is_mended => Ok(None),
            Some(ball) if is_mended && check(&ball).is_ok() => Ok(Some(ball)),
            _ => {
                let or =
                    if is_mended { "" } else { ", or have such moments replaced: `inertia = \"mended\"`" };
                Err(self.refuse(FileProblem::new(format!("{error}: correct the file{or}"))))
            }
        }
    }

    fn refuse(&self, problem: FileProblem) -> SceneError {
        problem.located(&self.spec.file, self.reader.location_of(&["file"]))
    }

    /// A shape of a link of this number.
    fn shape(&self, link: usize, form: &Form) -> Result<ShapeSpec, SceneError> {
        let (file, scale, line) = match *form {
            Form::Lengths(form, ref lengths) => return Ok(ShapeSpec::of_lengths(form, lengths.clone())),
            Form::Box { size } => return Ok(ShapeSpec::Box(BoxSpec { size })),
            Form::Mesh { ref file, scale, line } => (file, scale, line),
        };
        let at = |problem: String| self.refuse(FileProblem::at(line, problem));
        let file = Some(find(file, &self.spec.file, self.spec.packages.as_deref()).map_err(at)?);
        let location = self.reader.location().clone();
        if !self.solid.contains(&self.robot.links[link].name) {
            let corners = Some(self.spec.corners);
            return Ok(ShapeSpec::Hull(HullSpec { file, points: Vec::new(), scale, corners, location }));
        }
        if scale.min_element() <= 0.0 {
            return Err(at("a solid mesh cannot be mirrored: its `scale` must be above zero".to_string()));
        }
        let (vertices, triangles) = (Vec::new(), Vec::new());
        Ok(ShapeSpec::Mesh(MeshSpec { file, vertices, triangles, scale, solid: true, location }))
    }

    fn joints(
        &self,
        given: Vec<RobotJoint>,
        starts: &[f64],
    ) -> Result<Vec<(String, JointSpec)>, FileProblem> {
        let (mut joints, mut gears) = (Vec::new(), Vec::new());
        let of_joint = |name: &str| format!("{}/{name}", self.name);
        let is_needed = |joint: &Joint| self.lumps[self.owners[joint.child]].is_needed;
        for ((joint, given), &start) in self.robot.joints.iter().zip(given).zip(starts) {
            let Some(pair) = joint.pair.filter(|pair| *pair != Pair::Fixed && is_needed(joint)) else {
                continue;
            };
            let is_driven = given.motor.is_some() || given.actuator.is_some();
            joints.push((of_joint(&joint.name), self.joint((joint, pair), given, start)?));
            let Some((leader, ratio, _)) = joint.mimic.as_ref().filter(|_| !is_driven) else { continue };
            let leads = |other: &Joint| other.name == *leader && other.moves() && is_needed(other);
            if self.robot.joints.iter().any(leads) && *ratio != 0.0 {
                let gear = JointSpec {
                    joints: vec![of_joint(leader), of_joint(&joint.name)],
                    ratio: Some(*ratio),
                    ..JointSpec::new(JointForm::Gear, self.reader.location().clone())
                };
                gears.push((of_joint(&format!("{}/mimic", joint.name)), gear));
            }
        }
        joints.extend(gears);
        Ok(joints)
    }

    /// A joint that is no fixed one, and starts at this coordinate.
    fn joint(
        &self,
        (joint, pair): (&Joint, Pair),
        given: RobotJoint,
        start: f64,
    ) -> Result<JointSpec, FileProblem> {
        let turns = pair == Pair::Revolute;
        let [parent, child] = [joint.parent, joint.child].map(|link| self.owners[link]);
        let bodies = [parent, child].into_iter().filter(|&owner| !self.is_world(owner));
        let place = self.places[joint.child];
        let stops = given.stops(joint);
        let (lower, upper) = range(stops);
        if lower >= upper {
            let problem = format!(
                "the stops of the joint `{0}`, {lower} and {upper}, leave it no way: give it others, `joint.{0}.{1} = {{ lower = -1, upper = 1 }}`, \
                 or make its type `fixed`",
                joint.name,
                if turns { "angles" } else { "travel" }
            );
            return Err(FileProblem::at(joint.line, problem));
        }
        let [lower, upper] = stops.map(|bound| bound.map(|bound| bound - start));
        let stops = lower.or(upper).map(|_| StopsSpec { lower, upper });
        let constant = FunctionSpec::constant;
        let effort = joint.effort.map(constant);
        let brake = (joint.friction > 0.0).then(|| (Some(constant(0.0)), Some(constant(joint.friction))));
        let drive = given.motor.map(|MotorSpec { speed, torque }| (speed, torque));
        let drive = drive.or(given.actuator.map(|ActuatorSpec { speed, force }| (speed, force)));
        let drive = drive.map(|(speed, most)| (speed, most.or(effort))).or(brake);
        let damper = || SpringSpec { stiffness: 0.0, damping: joint.damping, rest: None };
        let spring = given.torsion_spring.or(given.spring).or_else(|| (joint.damping > 0.0).then(damper));
        let spec = JointSpec {
            bodies: bodies.map(|owner| self.body_name(owner)).collect(),
            point: Some(place.translation),
            axis: Some((place.rotation * joint.axis).normalize()),
            ..JointSpec::new(JointForm::Pair(pair), self.reader.location().clone())
        };
        Ok(if turns {
            let motor = drive.map(|(speed, torque)| MotorSpec { speed, torque });
            JointSpec { motor, torsion_spring: spring, angles: stops, ..spec }
        } else if joint.moves() {
            let actuator = drive.map(|(speed, force)| ActuatorSpec { speed, force });
            JointSpec { actuator, spring, travel: stops, ..spec }
        } else {
            spec
        })
    }
}

/// The same in the frame that `frame` is given in.
fn moved(inertial: Inertial, frame: Pose) -> Inertial {
    let turn = Mat3::from_quat(frame.rotation);
    Inertial {
        mass: inertial.mass,
        centre: frame.transform_point(inertial.centre),
        tensor: turn * inertial.tensor * turn.transpose(),
    }
}

/// Both as one, by parallel axes.
fn joined(a: Inertial, b: Inertial) -> Inertial {
    let mass = a.mass + b.mass;
    let centre = (a.mass * a.centre + b.mass * b.centre) / mass;
    let about = |part: Inertial| part.tensor + part.mass * parallel_axis(part.centre - centre);
    Inertial { mass, centre, tensor: about(a) + about(b) }
}

/// The file of a mesh: relative to the URDF file, or in a package, which is looked for in `packages` or from
/// the URDF file upwards. The package's own folder may be called otherwise, as where it was cloned.
fn find(name: &str, urdf: &Path, packages: Option<&Path>) -> Result<PathBuf, String> {
    let folder = urdf.parent().unwrap_or(Path::new(""));
    let in_package = name.strip_prefix("package://").or(name.strip_prefix("model://"));
    let Some(rest) = in_package.map(|rest| rest.trim_start_matches('/')) else {
        return Ok(folder.join(name.strip_prefix("file://").unwrap_or(name)));
    };
    let (package, inside) = rest.split_once('/').unwrap_or((rest, ""));
    let folder = std::path::absolute(folder).unwrap_or(folder.to_path_buf());
    let places: Vec<&Path> = packages.map_or(folder.ancestors().collect(), |packages| vec![packages]);
    let found =
        places.iter().flat_map(|place| [place.join(rest), place.join(inside)]).find(|path| path.is_file());
    found.ok_or_else(|| {
        format!("`{name}` is not found: name the folder that holds the package `{package}` by `packages`")
    })
}
