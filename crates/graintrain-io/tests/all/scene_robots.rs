//! Robots in scenes: URDF files beside the same bodies and joints written by hand, meshes, errors.

use graintrain::joint::{JointKind, Motor, Pair};
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::stepper::Stepper;
use graintrain_io::scene::{Scene, SceneError, Simulation};
use std::path::Path;

const ROBOTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/all/robots");

const TIME: &str = "[time]\nstep = \"1 ms\"\nsteps = 200\n";

fn parsed(text: &str, folder: &Path) -> Result<Scene, SceneError> {
    Scene::parse("robots", "robots.toml", text, folder, &[])
}

fn built(text: &str, folder: &Path) -> Simulation {
    parsed(text, folder).and_then(|scene| scene.build()).unwrap()
}

fn arm(more: &str) -> Simulation {
    built(&format!("{TIME}[robot.arm]\nfile = \"arm.urdf\"\n{more}"), Path::new(ROBOTS))
}

fn body(simulation: &Simulation, name: &str) -> usize {
    let known = &simulation.world.bodies.name;
    known.iter().position(|known| known == name).unwrap_or_else(|| panic!("no {name} in {known:?}"))
}

/// After so many steps; every one has to converge.
fn run(simulation: &mut Simulation, steps: usize) {
    let mut stepper = Stepper::new(simulation.settings.clone()).unwrap();
    for _ in 0..steps {
        let report = stepper.step(&mut simulation.world).unwrap();
        assert!(report.solve.converged(), "{:?}", report.solve);
    }
}

#[test]
fn links_become_bodies_and_joints() {
    let simulation = arm("");
    let names = ["arm/base", "arm/upper", "arm/lower", "arm/left_finger", "arm/right_finger"];
    assert_eq!(simulation.world.bodies.name, names, "`world` and frames without mass are no bodies");
    let joints: Vec<&str> =
        simulation.world.joints().iter().map(|placed| placed.joint.name.as_str()).collect();
    assert_eq!(joints, ["arm/shoulder", "arm/elbow", "arm/left", "arm/right", "arm/right/mimic"]);
    let joint = |k: usize| &simulation.world.joints()[k].joint;
    let JointKind::Pair { pair: Pair::Revolute, point, axis, .. } = joint(0).kind else {
        panic!("{:?}", joint(0))
    };
    assert!((point - Vec3::new(0.0, 0.0, 0.7)).length() < 1e-15);
    assert!((axis + Vec3::X).length() < 1e-15, "turned by yaw and made of length one: {axis}");
    let limits = joint(0).limits.unwrap();
    assert_eq!((limits.lower, limits.upper), (Some(-2.0), Some(2.0)));
    assert_eq!(joint(0).spring.as_ref().map(|spring| (spring.stiffness, spring.damping)), Some((0.0, 0.5)));
    assert!(matches!(&joint(0).motor, Some(Motor::Speed { limit: Some(_), .. })), "friction is a brake");
    assert!(joint(1).motor.is_none() && joint(1).limits.is_none(), "continuous");
    // The mimicking finger starts at 2 x 0 + 0.005.
    let place = |name: &str| simulation.world.bodies.position[body(&simulation, name)];
    let palm = Quat::from_rotation_z(std::f64::consts::FRAC_PI_2) * Quat::from_rotation_x(0.3);
    let apart = palm.conjugate() * (place("arm/left_finger") - place("arm/right_finger"));
    assert!((apart - Vec3::new(0.0, 0.045, 0.0)).length() < 1e-15, "{apart}");
    assert!(matches!(joint(4).kind, JointKind::Gear { ratio: 2.0, .. }));
    // Density times volume where the file has no mass.
    let finger = simulation.world.bodies.mass[body(&simulation, "arm/left_finger")];
    assert!((finger - 1000.0 * 4.0 / 3.0 * std::f64::consts::PI * 1e-6).abs() < 1e-12);
}

/// `lower` and `palm` are one body: point by point, from the definition of the tensor.
#[test]
fn links_held_together_are_one_body() {
    let simulation = arm("");
    let lower = body(&simulation, "arm/lower");
    let turn = Mat3::from_quat(Quat::from_rotation_x(0.3));
    let palm = Vec3::new(0.2, 0.0, 0.0) + turn * Vec3::new(0.02, 0.01, 0.0);
    let own = [
        (1.0, Vec3::new(0.1, 0.0, 0.0), Mat3::from_diagonal(Vec3::new(0.002, 0.006, 0.006))),
        (0.5, palm, turn * Mat3::from_diagonal(Vec3::new(0.001, 0.002, 0.002)) * turn.transpose()),
    ];
    let centre = own.iter().map(|(m, c, _)| *m * *c).sum::<Vec3>() / 1.5;
    let mut tensor = Mat3::ZERO;
    for (mass, place, about) in own {
        let d = place - centre;
        let shift = |i: usize, j: usize| (if i == j { d.length_squared() } else { 0.0 }) - d[i] * d[j];
        for j in 0..3 {
            for i in 0..3 {
                tensor.col_mut(j)[i] += about.col(j)[i] + mass * shift(i, j);
            }
        }
    }
    let bodies = &simulation.world.bodies;
    assert!((bodies.mass[lower] - 1.5).abs() < 1e-15);
    let error = (bodies.inertia[lower] - tensor).to_cols_array().iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    assert!(error < 1e-16, "{error}");
    let frame = Vec3::new(0.0, 0.4, 0.7) + Quat::from_rotation_z(std::f64::consts::FRAC_PI_2) * centre;
    assert!((bodies.position[lower] - frame).length() < 1e-15);
}

/// A robot beside the same written as bodies and joints: the resolved scene, which has no robot any more.
#[test]
fn a_resolved_scene_is_the_robot_in_bodies_and_joints() {
    let driven = "[robot.arm.joint.shoulder]\nangle = \"30 deg\"\nmotor = { speed = \"5 rpm\" }\n\
                  [robot.arm.joint.left]\nslide = \"1 cm\"\n";
    let mut robot = arm(driven);
    let text = robot.resolved.to_toml().unwrap();
    assert!(!text.contains("[robot") && text.contains("arm/upper"), "{text}");
    let mut by_hand = built(&text, Path::new(""));
    assert_eq!(robot.world.state_hash(), by_hand.world.state_hash());
    let joint = &robot.world.joints()[0].joint;
    let limits = joint.limits.unwrap();
    let start = std::f64::consts::PI / 6.0;
    assert_eq!(limits.lower, Some(-2.0 - start), "stops count from where the joint starts");
    let Some(Motor::Speed { limit: Some(most), .. }) = &joint.motor else { panic!("{joint:?}") };
    assert_eq!(most.mean(0.0, 1.0), 60.0, "the effort of the file");
    run(&mut robot, 200);
    run(&mut by_hand, 200);
    assert_eq!(robot.world.state_hash(), by_hand.world.state_hash());
    let turned = robot.world.joints()[0].state.coordinate;
    let driven = 0.2 * 5.0 * std::f64::consts::TAU / 60.0;
    assert!((0.99..1.0).contains(&(turned / driven)), "the effort takes a moment: {turned} of {driven}");
}

/// A base that is free falls; links that overlap do so in peace unless they are to collide.
#[test]
fn robots_fall_freely_and_do_not_touch_themselves() {
    let folded = "fixed = false\nposition = [0, 0, 50]\n[robot.arm.joint.elbow]\nangle = \"180 deg\"\n";
    let mut simulation = arm(folded);
    let centre = |simulation: &Simulation| {
        let bodies = &simulation.world.bodies;
        let sum: Vec3 = bodies.mass.iter().zip(&bodies.position).map(|(m, x)| *m * *x).sum();
        sum / bodies.mass.iter().sum::<f64>()
    };
    let before = centre(&simulation);
    run(&mut simulation, 200);
    let fallen = centre(&simulation) - before;
    // Semi-implicit: g dt^2 n (n + 1) / 2.
    assert!((fallen - Vec3::new(0.0, 0.0, -9.81e-6 * 100.0 * 201.0)).length() < 1e-9, "{fallen}");
    assert!(simulation.world.contacts.contacts.is_empty());
    let text = format!("{TIME}[robot.arm]\nfile = \"arm.urdf\"\nself_collision = true\n{folded}");
    let error = parsed(&text, Path::new(ROBOTS)).unwrap().build().err().unwrap().to_string();
    assert!(error.contains("overlap"), "{error}");
}

/// A box of 2 x 4 x 6 mm as COLLADA: unit, nodes, polygons; and as a mirrored hull.
const BOX: &str = r##"<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit name="millimetre" meter="0.001"/><up_axis>Y_UP</up_axis></asset>
  <library_geometries><geometry id="box"><mesh>
    <source id="points"><float_array id="numbers" count="24">
      0 0 0  2 0 0  2 4 0  0 4 0  0 0 6  2 0 6  2 4 6  0 4 6</float_array>
      <technique_common><accessor source="#numbers" count="8" stride="3"/></technique_common></source>
    <vertices id="corners"><input semantic="POSITION" source="#points"/></vertices>
    <polylist count="6">
      <input semantic="VERTEX" source="#corners" offset="0"/><input semantic="NORMAL" source="#none" offset="1"/>
      <vcount>4 4 4 4 4 4</vcount>
      <p>0 0 3 0 2 0 1 0  4 1 5 1 6 1 7 1  0 2 1 2 5 2 4 2  1 3 2 3 6 3 5 3  2 4 3 4 7 4 6 4  3 5 0 5 4 5 7 5</p>
    </polylist></mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="scene">
    <node><translate>10 0 0</translate><rotate>0 0 1 90</rotate><scale>2 1 1</scale>
      <node><instance_geometry url="#box"/></node></node>
  </visual_scene></library_visual_scenes>
</COLLADA>"##;

#[test]
fn collada_meshes_are_read_in_their_place() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("box.dae"), BOX).unwrap();
    let scene = |shape: &str| format!("{TIME}[body.stone]\nshape = {shape}\n");
    // x of the file becomes y of the scene: 4 mm, scaled by two; y becomes -x: 4 mm, from 10 mm on.
    let solid = built(&scene("{ mesh = { file = \"box.dae\", solid = true } }"), folder.path());
    let mirrored = built(&scene("{ hull = { file = \"box.dae\", scale = [-1, 2, 1] } }"), folder.path());
    for (simulation, centre, size) in [
        (solid, Vec3::new(8e-3, 2e-3, 3e-3), Vec3::new(4e-3, 4e-3, 6e-3)),
        (mirrored, Vec3::new(-8e-3, 4e-3, 3e-3), Vec3::new(4e-3, 8e-3, 6e-3)),
    ] {
        let bodies = &simulation.world.bodies;
        assert!((bodies.position[0] - centre).length() < 1e-15, "{}", bodies.position[0]);
        let mass = 1000.0 * size.element_product();
        assert!((bodies.mass[0] - mass).abs() < 1e-9 * mass);
        let moment = mass / 12.0 * (size.x * size.x + size.y * size.y);
        assert!((bodies.inertia[0].z_axis.z - moment).abs() < 1e-9 * moment);
    }
    for (from, to, expected) in [
        ("</COLLADA>", "", "not valid XML"),
        ("4 4 4 4 4 4", "4 4 4 4 4 5", "cut short"),
        ("3 5 0 5 4 5 7 5", "3 5 0 5 4 5 8 5", "no vertex 8"),
        ("6  2 0 6", "6  2 x 6", "`x` is not a number"),
        ("url=\"#box\"", "url=\"#bax\"", "`bax`"),
        ("offset=\"0\"", "offset=\"18446744073709551615\"", "`offset` cannot be"),
        ("<instance_geometry url=\"#box\"/>", "<instance_node url=\"#scene\"/>", "nested too deeply"),
    ] {
        assert!(BOX.contains(from));
        std::fs::write(folder.path().join("box.dae"), BOX.replace(from, to)).unwrap();
        let scene = parsed(&scene("{ hull = { file = \"box.dae\" } }"), folder.path()).unwrap();
        let error = scene.build().err().unwrap().to_string();
        assert!(error.contains(expected) && error.contains("box.dae"), "{expected}: {error}");
    }
}

/// A mesh in a package: found from the file upwards, as hull with few corners, or as it is.
#[test]
fn meshes_of_packages_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let package = folder.path().join("box_robot");
    std::fs::create_dir_all(package.join("urdf")).unwrap();
    std::fs::create_dir_all(package.join("meshes")).unwrap();
    std::fs::write(package.join("meshes/box.dae"), BOX).unwrap();
    let urdf = "<robot name='b'><link name='stone'><visual><geometry>\
                <mesh filename='package://box_robot/meshes/box.dae' scale='100 100 100'/>\
                </geometry></visual></link></robot>";
    std::fs::write(package.join("urdf/b.urdf"), urdf).unwrap();
    let scene = |more: &str| format!("{TIME}[robot.b]\nfile = \"b.urdf\"\nshapes = \"visual\"\n{more}\n");
    let volume = 0.4 * 0.4 * 0.6;
    let solid = "solid = [\"stone\"]";
    for (more, expected) in
        [("", volume), ("solid = []", volume), (solid, volume), ("corners = 4", volume / 6.0)]
    {
        let simulation = built(&scene(more), &package.join("urdf"));
        let mass = simulation.world.bodies.mass[0];
        assert!((mass - 1000.0 * expected).abs() < 1e-3 * mass, "{more}: {mass}");
    }
    std::fs::rename(package.join("meshes/box.dae"), package.join("box.dae")).unwrap();
    let error = parsed(&scene(""), &package.join("urdf")).err().unwrap().to_string();
    assert!(error.contains("line 1") && error.contains("`packages`"), "{error}");
}

/// What is wrong with a file is reported with its name and line, and what to do.
#[test]
fn errors_name_file_line_and_remedy() {
    let whole = std::fs::read_to_string(Path::new(ROBOTS).join("arm.urdf")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let text = |more: &str| format!("{TIME}[robot.arm]\nfile = \"arm.urdf\"\n{more}\n");
    let error_of = |content: &str, more: &str| {
        std::fs::write(folder.path().join("arm.urdf"), content).unwrap();
        let error = parsed(&text(more), folder.path()).and_then(|scene| scene.build()).err();
        error.unwrap_or_else(|| panic!("no error: {more} {content:.200}")).to_string()
    };
    for (from, to, expected) in [
        ("</robot>", "", "not valid XML"),
        (
            "<robot name=\"arm\">",
            "<robot xmlns:xacro='http://ros.org/xacro' name='arm'><xacro:x/>",
            "xacro FILE",
        ),
        (
            "<parent link=\"upper\"/>",
            "<parent link=\"uper\"/>",
            "line 32: the joint `elbow` names the link `uper`",
        ),
        ("<parent link=\"base\"/>", "<parent link=\"lower\"/>", "loop of parents"),
        ("<link name=\"camera_frame\"/>", "<link name='camera_frame'/><link name='x'/>", "no single tree"),
        ("<child link=\"palm\"/>", "<child link=\"upper\"/>", "child of two joints"),
        (
            "name=\"elbow\" type=\"continuous\"",
            "name=\"elbow\" type=\"screw\"",
            "is screw, which is not supported",
        ),
        ("<mimic joint=\"left\"", "<mimic joint=\"light\"", "mimics `light`, which is not there"),
        ("<mimic joint=\"left\"", "<mimic joint=\"right\"", "mimics itself"),
        ("lower=\"-2\" upper=\"2\"", "lower=\"0\" upper=\"0\"", "leave it no way"),
        ("lower=\"-2\" upper=\"2\"", "lower=\"-2\" upper=\"x\"", "line 18: `upper` must be a number"),
        ("<axis xyz=\"0 2 0\"/>", "<axis xyz=\"0 0 0\"/>", "has no direction"),
        ("ixx=\"0.01\"", "ixx=\"0.1\"", "inertia = \"mended\""),
        ("radius=\"0.04\"", "radius=\"-0.04\"", "above zero"),
        ("<box size=\"0.2 0.05 0.05\"/>", "<cone/>", "<cone> is no shape"),
        ("<sphere radius=\"0.01\"/>", "<mesh filename='package://p/a.stl'/>", "`packages`"),
    ] {
        assert!(whole.contains(from), "{from}");
        let error = error_of(&whole.replace(from, to), "");
        assert!(error.contains(expected) && error.contains("arm.urdf"), "{expected}: {error}");
    }
    for (more, expected) in [
        ("[robot.arm.joint.elbo]\nangle = 1", "`elbo`"),
        ("[robot.arm.joint.elbow]\nslide = 1", "has no meaning for a joint that turns"),
        ("[robot.arm.joint.shoulder]\nangle = 3", "between its stops"),
        ("solid = [\"hand\"]", "`hand`"),
        ("shapes = \"visuals\"", "`visuals`"),
        (
            "[joint.\"arm/elbow\"]\nkind = \"spherical\"\nbodies = [\"arm/upper\"]\npoint = [0, 0, 0]",
            "two joints `arm/elbow`",
        ),
        ("[body.\"arm/upper\"]\nshape = { sphere = { radius = 1 } }", "two bodies `arm/upper`"),
    ] {
        let error = error_of(&whole, more);
        assert!(error.contains(expected), "{expected}: {error}");
    }
    let mended = whole.replace("ixx=\"0.01\"", "ixx=\"0.1\"");
    std::fs::write(folder.path().join("arm.urdf"), mended).unwrap();
    let simulation = built(&text("inertia = \"mended\""), folder.path());
    assert_eq!(simulation.world.bodies.mass[body(&simulation, "arm/upper")], 3.0);
}

/// A body without shape and one with shapes of the same mass, centre and tensor move alike.
#[test]
fn given_masses_move_as_those_of_shapes() {
    let dumbbell = "parts = [{ shape = { sphere = { radius = 0.1 } }, position = [0.3, 0.1, 0] }, \
                    { shape = { sphere = { radius = 0.05 } }, position = [-0.3, 0, 0.2] }]";
    let motion = "velocity = [1, 0, 2]\nangular_velocity = [3, -2, 5]\n";
    let by_shapes = built(&format!("{TIME}[body.a]\n{dumbbell}\n{motion}"), Path::new(""));
    let bodies = &by_shapes.world.bodies;
    let (t, c) = (bodies.inertia[0], bodies.position[0]);
    let given = format!(
        "mass = {:e}\ninertia = [{:e}, {:e}, {:e}]\nproducts = [{:e}, {:e}, {:e}]\ncentre = [{:e}, {:e}, {:e}]\n",
        bodies.mass[0], t.x_axis.x, t.y_axis.y, t.z_axis.z, t.y_axis.x, t.z_axis.x, t.z_axis.y, c.x, c.y, c.z
    );
    let mut all = vec![by_shapes];
    for form in ["parts = []", dumbbell] {
        all.push(built(&format!("{TIME}[body.a]\n{form}\n{given}{motion}"), Path::new("")));
    }
    for simulation in &mut all {
        run(simulation, 200);
    }
    let end = |k: usize| (all[k].world.bodies.position[0], all[k].world.bodies.orientation[0]);
    assert_eq!(end(0), end(1));
    assert_eq!(end(0), end(2));
    for (text, expected) in [
        ("parts = []\n", "lacks `inertia`"),
        ("parts = []\nmass = 1\n", "lacks `inertia`"),
        ("shape = { sphere = { radius = 1 } }\ncentre = [0, 0, 1]\n", "lacks `inertia`"),
        ("shape = { sphere = { radius = 1 } }\nignores = [\"b\"]\n", "`b`"),
    ] {
        let error = parsed(&format!("{TIME}[body.a]\n{text}"), Path::new("")).err().unwrap().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
}

/// Bodies that ignore each other pass through each other, also after others have left, and nobody else does.
#[test]
fn bodies_that_ignore_each_other_pass() {
    let ball = |name: &str, x: f64, v: f64, more: &str| {
        format!(
            "[body.{name}]\nshape = {{ sphere = {{ radius = 0.1 }} }}\nposition = [{x}, 0, 0]\nvelocity = [{v}, 0, 0]\n{more}\n"
        )
    };
    let text = format!(
        "gravity = [0, 0, 0]\n{TIME}{}{}{}",
        ball("gone", 5.0, 0.0, ""),
        ball("a", 0.0, 2.0, ""),
        ball("b", 0.3, -2.0, "ignores = [\"gone\", \"a\"]")
    );
    let mut simulation = built(&text, Path::new(""));
    simulation.world.remove_bodies(|body| body == 0);
    run(&mut simulation, 200);
    let velocity = &simulation.world.bodies.velocity;
    assert_eq!((velocity[0].x, velocity[1].x), (2.0, -2.0));
    let mut others = built(&text.replace("[\"gone\", \"a\"]", "[\"gone\"]"), Path::new(""));
    run(&mut others, 200);
    assert!(others.world.bodies.velocity[1].x < 1.0);
}

/// Every URDF file below the folder that `GRAINTRAIN_ROBOTS` names (a checkout of the public
/// example-robot-data, say) is read, or refused with a reason in the file; what is read hangs for 50 steps
/// with closed joints.
#[test]
#[ignore = "needs a folder of robots: GRAINTRAIN_ROBOTS"]
fn public_robots_hang_by_their_joints() {
    let mut folders = vec![std::path::PathBuf::from(std::env::var("GRAINTRAIN_ROBOTS").unwrap())];
    let (mut ran, mut refused) = (Vec::new(), Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            if path.extension().is_none_or(|ending| ending != "urdf") {
                continue;
            }
            let text = format!(
                "{TIME}[robot.r]\nfile = \"{}\"\nfixed = true\ninertia = \"mended\"\n",
                path.display()
            );
            match parsed(&text, Path::new("")).and_then(|scene| scene.build()) {
                Err(error) => refused.push((path, error.to_string())),
                Ok(mut simulation) => {
                    let mut stepper = Stepper::new(simulation.settings.clone()).unwrap();
                    for _ in 0..50 {
                        let report = stepper.step(&mut simulation.world).unwrap();
                        assert!(report.errors.joint_opening_max < 1e-6, "{}: {report:?}", path.display());
                    }
                    ran.push(path);
                }
            }
        }
    }
    refused.iter().for_each(|(path, error)| println!("{}: {error}", path.display()));
    println!("{} robots ran, {} were refused", ran.len(), refused.len());
    assert!(ran.len() > 4 * refused.len());
}

/// A planar joint of a file is one of the scene; it has no drive.
#[test]
fn planar_joints_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let file = std::fs::read_to_string(Path::new(ROBOTS).join("arm.urdf")).unwrap();
    let file = file.replace("name=\"elbow\" type=\"continuous\"", "name=\"elbow\" type=\"planar\"");
    std::fs::write(folder.path().join("arm.urdf"), file).unwrap();
    let mut simulation = built(&format!("{TIME}[robot.arm]\nfile = \"arm.urdf\"\n"), folder.path());
    let joint = simulation.world.joints().iter().find(|placed| placed.joint.name == "arm/elbow").unwrap();
    assert!(matches!(joint.joint.kind, JointKind::Pair { pair: Pair::Planar, .. }), "{joint:?}");
    run(&mut simulation, 100);
    let elbow = simulation.world.joints().iter().find(|placed| placed.joint.name == "arm/elbow").unwrap();
    assert!(elbow.state.opening < 1e-9, "{:?}", elbow.state);
}
