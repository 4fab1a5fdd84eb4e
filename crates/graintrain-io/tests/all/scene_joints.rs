//! Joints in scenes: every kind, errors, tables, checkpoints.

use graintrain::joint::{Coordinate, JointKind, Motor, Pair};
use graintrain::stepper::Stepper;
use graintrain_io::checkpoint;
use graintrain_io::run::{RunSettings, RunTotals};
use graintrain_io::scene::{Scene, Simulation};
use std::path::Path;

const SCENE: &str = r#"
[time]
step = "1 ms"
end = "0.1 s"
[body.base]
shape = { box = { size = [0.2, 0.2, 0.2] } }
motion = "fixed"
[body.arm]
shape = { box = { size = [0.5, 0.05, 0.05] } }
position = [0.3, 0, 0.5]
[body.bucket]
shape = { box = { size = [0.1, 0.1, 0.1] } }
position = [0.6, 0, 0.5]
[body.pinion]
shape = { cylinder = { radius = 0.1, length = 0.05 } }
position = [-1, 0, 0.5]
[body.rack]
shape = { box = { size = [0.1, 0.1, 0.5] } }
position = [-2, 0, 0.5]
[body.ball]
shape = { sphere = { radius = 0.05 } }
position = [3, 0, 0.5]
[body.bob]
shape = { sphere = { radius = 0.05 } }
position = [3, 0, 0.2]
[joint.hinge]
kind = "revolute"
bodies = ["base", "arm"]
point = [0.05, 0, "50 cm"]
axis = [0, 2, 0]
motor = { speed = "10 rpm * sin(2*pi*t/2 s)", torque = "200 N m" }
torsion_spring = { stiffness = "3 N m/rad", damping = "0.1 N m s/rad", rest = "5 deg" }
angles = { lower = "-30 deg", upper = "45 deg" }
[joint.weld]
kind = "fixed"
bodies = ["arm", "bucket"]
point = [0.55, 0, 0.5]
[joint.turn]
kind = "revolute"
bodies = ["pinion"]
point = [-1, 0, 0.5]
axis = [0, 1, 0]
motor = { torque = "5 N m" }
[joint.lift]
kind = "prismatic"
bodies = ["rack"]
point = [-2, 0, 0.5]
axis = [0, 0, 1]
[joint.teeth]
kind = "gear"
joints = ["turn", "lift"]
ratio = 0.1
[joint.sleeve]
kind = "cylindrical"
bodies = ["ball"]
point = [3, 0, 0.5]
axis = [1, 0, 0]
along = "slide"
actuator = { speed = "1 cm/s", force = "2 kN" }
spring = { stiffness = "1 kN/m", damping = "2 N s/m" }
travel = { upper = "10 cm" }
collide = true
[joint.socket]
kind = "spherical"
bodies = ["pinion", "rack"]
point = [-1.5, 0, 0.5]
[joint.rope]
kind = "distance"
bodies = ["ball", "bob"]
ends = [[3, 0, 0.5], [3, 0, 0.2]]
travel = { upper = "35 cm" }
"#;

fn build(text: &str) -> Result<(Scene, Simulation), String> {
    let scene =
        Scene::parse("test", "test.toml", text, Path::new("."), &[]).map_err(|error| error.to_string())?;
    let simulation = scene.build().map_err(|error| error.to_string())?;
    Ok((scene, simulation))
}

#[test]
fn every_kind_of_joint_is_read_and_written() {
    let (_, simulation) = build(SCENE).unwrap();
    let (_, again) = build(&simulation.resolved.to_toml().unwrap()).unwrap();
    assert_eq!(again.world.joints(), simulation.world.joints());
    let joints: Vec<_> = simulation.world.joints().iter().map(|placed| &placed.joint).collect();
    assert_eq!(joints.len(), 8);
    let hinge = joints[0];
    assert!(matches!(&hinge.motor, Some(Motor::Speed { limit: Some(_), .. })));
    let limits = hinge.limits.unwrap();
    assert!((limits.lower.unwrap() + 30.0_f64.to_radians()).abs() < 1e-15);
    assert_eq!(hinge.spring.as_ref().unwrap().stiffness, 3.0);
    assert!(matches!(joints[4].kind, JointKind::Gear { ratio, .. } if ratio == 0.1));
    assert!(matches!(
        joints[5].kind,
        JointKind::Pair { pair: Pair::Cylindrical, coordinate: Coordinate::Slide, .. }
    ));
    assert!(joints[5].collide && joints[2].bodies[0].is_none());
}

/// A run through a checkpoint goes on with the same bits.
#[test]
fn checkpoints_hold_joints() {
    let text = SCENE.replace(
        "[joint.socket]\nkind = \"spherical\"\nbodies = [\"pinion\", \"rack\"]\npoint = [-1.5, 0, 0.5]\n",
        "",
    );
    let (_, simulation) = build(&text).unwrap();
    let settings = RunSettings::new(&simulation, None);
    let mut world = simulation.world;
    let stepper = || Stepper::new(settings.stepping.clone()).unwrap();
    let mut first = stepper();
    for _ in 0..30 {
        let report = first.step(&mut world).unwrap();
        assert!(report.solve.converged(), "{:?}", report.solve.remark);
    }
    let bytes = checkpoint::to_bytes(&settings, &RunTotals::default(), &world).unwrap();
    let mut other = checkpoint::from_bytes(&bytes, "a").unwrap().world;
    assert_eq!(other, world);
    let mut second = stepper();
    for _ in 0..30 {
        first.step(&mut world).unwrap();
        second.step(&mut other).unwrap();
    }
    assert_eq!(other.state_hash(), world.state_hash());
    assert_eq!(other.joints(), world.joints());
}

#[test]
fn errors_name_the_key_and_the_remedy() {
    let cases = [
        ("bodies = [\"base\", \"arm\"]", "bodies = [\"base\", \"boom\"]", "boom"),
        ("kind = \"revolute\"", "kind = \"hinge\"", "hinge"),
        ("axis = [0, 2, 0]", "axis = [0, 0, 0]", "joint.hinge.axis"),
        ("axis = [0, 2, 0]\n", "", "`joint.hinge` lacks `axis`"),
        ("speed = \"10 rpm * sin(2*pi*t/2 s)\"", "speed = \"1 m/s\"", "joint.hinge.motor.speed"),
        ("along = \"slide\"\n", "", "use `motor`"),
        ("torsion_spring", "spring", "joint.hinge.spring"),
        ("lower = \"-30 deg\"", "lower = \"60 deg\"", "is not below"),
        ("joints = [\"turn\", \"lift\"]", "joints = [\"turn\", \"rope\"]", "rope"),
        ("joints = [\"turn\", \"lift\"]", "joints = [\"turn\"]", "joint.teeth.joints"),
        ("ratio = 0.1", "ratio = 0", "not zero"),
        ("ends = [[3, 0, 0.5], [3, 0, 0.2]]", "ends = [[3, 0, 0.5]]", "two points"),
        ("kind = \"fixed\"", "kind = \"fixed\"\naxis = [1, 0, 0]", "has no meaning"),
        ("bodies = [\"pinion\"]", "bodies = [\"base\"]", "can move"),
        ("bodies = [\"arm\", \"bucket\"]", "bodies = [\"arm\", \"arm\"]", "are the same"),
    ];
    for (from, to, message) in cases {
        assert!(SCENE.contains(from), "{from}");
        let error = build(&SCENE.replacen(from, to, 1)).map(|_| ()).unwrap_err();
        assert!(error.contains(message), "{to}: {error}");
        assert!(error.contains("test.toml"), "{error}");
    }
}

/// A hand on a swinging arm: two fingers, coupled by a gear, that start at their stops, pressed by gravity.
const HAND: &str = r#"
gravity = [GRAVITY, -9.81]
[time]
step = "1 ms"
steps = 400
[body.arm]
shape = { box = { size = [0.4, 0.04, 0.04] } }
position = [0.2, 0, 0]
ignores = []
[body.left]
shape = { sphere = { radius = 0.01 } }
position = [0.42, 0.02, 0]
ignores = ["arm"]
[body.right]
shape = { sphere = { radius = 0.012 } }
position = [0.42, -0.02, 0]
ignores = ["arm", "left"]
[joint.hinge]
kind = "revolute"
bodies = ["arm"]
point = [0, 0, 0]
axis = [AXIS]
[joint.a]
kind = "prismatic"
bodies = ["arm", "left"]
point = [0.42, 0.02, 0]
axis = [0, 1, 0]
travel = { lower = 0, upper = 0.04 }
spring = { damping = 10 }
[joint.b]
kind = "prismatic"
bodies = ["arm", "right"]
point = [0.42, -0.02, 0]
axis = [0, -1, 0]
travel = { lower = 0, upper = 0.04 }
spring = { damping = 10 }
[joint.gear]
kind = "gear"
joints = ["a", "b"]
ratio = 1
"#;

/// Stops count where positions are after a step, not where velocities point at its start, and the sign of
/// what a stop exerts once its row lies on its path: fingers that the swing turns by microns missed every
/// step else.
#[test]
fn coupled_fingers_rest_at_their_stops() {
    for (axis, gravity, at_stops) in
        [("0.3, 3, 0", "0, 3", 214), ("0, 3, 0.2", "0, 5", 400), ("1, 3, 1", "0, 9", 89)]
    {
        let (_, mut simulation) = build(&HAND.replace("AXIS", axis).replace("GRAVITY", gravity)).unwrap();
        let mut stepper = Stepper::new(simulation.settings.clone()).unwrap();
        let mut found = 0;
        for _ in 0..400 {
            let report = stepper.step(&mut simulation.world).unwrap();
            assert!(report.solve.converged(), "step {}: {:?}", simulation.world.step, report.solve);
            let places = [1, 2].map(|joint| simulation.world.joints()[joint].state.coordinate);
            assert!(places.iter().all(|place| (-1e-12..0.04).contains(place)), "{places:?}");
            assert!((places[0] - places[1]).abs() < 1e-12, "{places:?}");
            found += u32::from(places[0] < 1e-12);
        }
        assert_eq!(found, at_stops, "{axis}");
    }
}
