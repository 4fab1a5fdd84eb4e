//! Loads and functions of time in scenes: read, written out again, refused.

use graintrain::math::Vec3;
use graintrain::stepper::Stepper;
use graintrain_io::scene::{Scene, Simulation};
use std::path::Path;

const SCENE: &str = r#"
gravity = [0, 0, "-9.81 m/s^2 * (1 + 0.1*sin(2*pi*t/0.5 s))"]
[parameters]
push = "2 kN"
[time]
step = "2 ms"
end = "0.2 s"
[body.ground]
shape = { plane = {} }
[body.lid]
shape = { box = { size = [1, 1, 0.1] } }
position = [0, 0, 1]
motion = { free = ["z"], translation = [{ direction = [1, 0, 0], speed = "0.1 m/s * sin(2*pi*t/1 s)" }] }
[body.arm]
parts = [{ shape = { box = { size = [0.2, 0.1, 0.1] } }, position = [0.3, 0, 0] }]
position = [0, 3, 0.5]
[packing.grains]
radius = 0.05
drop = { count = 8, box = { min = [-0.4, -0.4, 0.1], max = [0.4, 0.4, 0.6] } }
[load.press]
bodies = ["lid"]
force = [0, 0, "-push * min(t/0.1 s, 1)"]
[load.stress]
bodies = ["lid"]
pressure = { stress = { file = { path = "stress.csv", time = "t", value = "p" } }, area = "100 cm^2", direction = [0, 0, -3] }
[load.wind]
packings = ["grains"]
region = { cylinder = { base = [0, 0, 0], radius = 2, height = 3 } }
acceleration = [{ sinusoidal = { amplitude = 0.5, period = 1 } }, { table = { times = [0, 1], values = [0, 1] } }, 0]
drag = { linear = "0.2 N s/m", medium = ["1 m/s", 0, 0] }
central = { point = [0, 0, 0], strength = 0.1, power = 1 }
[load.thruster]
bodies = ["arm"]
force = [0, 0, 3]
torque = [0, "0.1 N m", 0]
point = [0.2, 0, 0]
axes = "body"
"#;

/// A folder of its own with the file that the scene reads.
fn folder(name: &str) -> std::path::PathBuf {
    let folder = std::env::temp_dir().join(format!("graintrain-loads-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("stress.csv"), "t[ms],p[kPa]\n0,0\n50,10\n400,10\n").unwrap();
    folder
}

fn build(text: &str, folder: &Path) -> Result<(Scene, Simulation), String> {
    let scene = Scene::parse("test", "test.toml", text, folder, &[]).map_err(|error| error.to_string())?;
    let simulation = scene.build().map_err(|error| error.to_string())?;
    Ok((scene, simulation))
}

/// The scene written out reads the same, and steps to the same bits.
#[test]
fn a_resolved_scene_with_loads_has_the_same_bits() {
    let folder = folder("resolved");
    let (_, simulation) = build(SCENE, &folder).unwrap();
    let text = simulation.resolved.to_toml().unwrap();
    let (_, again) = build(&text, Path::new("/")).unwrap_or_else(|error| panic!("{error}\n{text}"));
    assert_eq!(again.world, simulation.world, "{text}");
    let keys = |text: &str| text.split_once("\n\n").map(|(_, keys)| keys.to_string());
    assert_eq!(keys(&again.resolved.to_toml().unwrap()), keys(&text));
    assert_eq!(simulation.world.loads().len(), 7);
    let mut world = simulation.world;
    let mut stepper = Stepper::new(simulation.settings).unwrap();
    let mut work = 0.0;
    for _ in 0..100 {
        work += stepper.step(&mut world).unwrap().ledger.loads;
    }
    assert!(work.is_finite() && work != 0.0);
    std::fs::remove_dir_all(folder).unwrap();
}

/// The frame of `arm` has its origin 0.3 m beside the centre of mass: a lift at 0.2 m in that frame turns it
/// about +y.
#[test]
fn the_point_of_a_force_is_in_the_frame_of_the_body() {
    let folder = folder("point");
    let text = SCENE.replace("torque = [0, \"0.1 N m\", 0]\n", "");
    let (_, simulation) = build(&text, &folder).unwrap();
    let mut world = simulation.world;
    world.gravity_of_time = None;
    world.gravity = Vec3::ZERO;
    let arm = world.bodies.name.iter().position(|name| name == "arm").unwrap();
    let step = simulation.settings.step;
    Stepper::new(simulation.settings).unwrap().step(&mut world).unwrap();
    // r x F = (-0.1, 0, 0) x (0, 0, 3) = (0, 0.3, 0).
    let expected = step * 0.3 / world.bodies.inertia[arm].y_axis.y * Vec3::Y;
    assert!((world.bodies.angular_velocity[arm] - expected).length() < 1e-12 * expected.length());
    std::fs::remove_dir_all(folder).unwrap();
}

/// A load may act on a body that only a later stage lets move.
#[test]
fn loads_act_on_bodies_that_a_stage_frees() {
    let folder = folder("freed");
    let scene = r#"
[time]
step = "10 ms"
end = "1 s"
[body.piston]
shape = { box = { size = [0.1, 0.1, 0.1] } }
motion = "fixed"
[load.press]
bodies = ["piston"]
force = [0, 0, -3]
"#;
    assert!(build(scene, &folder).unwrap_err().contains("acts on nothing that can move"));
    let stage = "[[stage]]\nname = \"press\"\nbody = { piston = { motion = { free = [\"z\"] } } }\n";
    build(&format!("{scene}{stage}"), &folder).unwrap();
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn mistakes_in_loads_are_reported() {
    let folder = folder("mistakes");
    let cases = [
        ("bodies = [\"lid\"]\nforce", "bodies = [\"lit\"]\nforce", "names the body `lit`"),
        ("packings = [\"grains\"]", "packings = [\"grain\"]", "names the packing `grain`"),
        ("bodies = [\"lid\"]\nforce", "bodies = [\"ground\"]\nforce", "acts on nothing that can move"),
        ("-push * min(t/0.1 s, 1)", "-push * min(t, 1)", "`min` of"),
        ("-push * min(t/0.1 s, 1)", "push / 1 s * t^2", "must be a force"),
        ("-push * min(t/0.1 s, 1)", "2 t", "write `* t`"),
        ("[0, 0, 3]", "[0, 3]", "three times a force"),
        ("value = \"p\"", "value = \"q\"", "lacks the column `q`"),
        ("area = \"100 cm^2\", ", "", "area"),
        ("path = \"stress.csv\"", "path = \"none.csv\"", "none.csv"),
        ("linear = \"0.2 N s/m\"", "linear = -1", "zero or positive"),
        ("force = [0, 0, 3]\n", "", "force"),
        ("axes = \"body\"", "axes = \"bodies\"", "names the choice `bodies`"),
        ("0.1 m/s * sin(2*pi*t/1 s)", "0.1 m * sin(2*pi*t/1 s)", "must be a speed"),
    ];
    for (right, wrong, expected) in cases {
        assert!(SCENE.contains(right), "{right}");
        let error = build(&SCENE.replace(right, wrong), &folder).err();
        let error = error.unwrap_or_else(|| panic!("`{wrong}` was accepted"));
        assert!(error.contains(expected), "`{wrong}` gives: {error}");
    }
    let nothing = format!("{SCENE}[load.empty]\nbodies = [\"lid\"]\n");
    assert!(build(&nothing, &folder).unwrap_err().contains("force, torque, pressure"));
    // A file whose times do not ascend.
    std::fs::write(folder.join("stress.csv"), "t,p\n1,0\n1,3\n").unwrap();
    assert!(build(SCENE, &folder).unwrap_err().contains("ascend"));
    std::fs::remove_dir_all(folder).unwrap();
}

/// The axis of a prescribed rotation goes where the body goes, unless a point of the world is given; the
/// frame's origin counts, not the centre of mass.
#[test]
fn an_axis_moves_with_its_body_unless_a_point_is_given() {
    let scene = |point: &str| {
        format!(
            r#"
[time]
step = "10 ms"
end = "2 s"
[body.ball]
shape = {{ sphere = {{ radius = 0.1 }} }}
position = [9, 9, 9]
[body.crank]
parts = [{{ shape = {{ box = {{ size = [0.2, 0.1, 0.1] }} }}, position = [0.5, 0, 0] }}]
position = [1, 0, 0]
motion = {{ translation = [{{ direction = [0, 0, 1], speed = "0.3 m/s" }}], rotation = {{ axis = [0, 0, 1], speed = "0.5 rad/s" {point} }} }}
"#
        )
    };
    let turned = |x: f64, y: f64| {
        Vec3::new(x * 1.0_f64.cos() - y * 1.0_f64.sin(), x * 1.0_f64.sin() + y * 1.0_f64.cos(), 0.6)
    };
    for (point, expected) in [("", turned(0.5, 0.0) + Vec3::X), (", point = [0, 0, 0]", turned(1.5, 0.0))] {
        let (_, simulation) = build(&scene(point), Path::new("")).unwrap();
        let (_, again) = build(&simulation.resolved.to_toml().unwrap(), Path::new("")).unwrap();
        assert_eq!(again.world, simulation.world);
        let mut world = simulation.world;
        let mut stepper = Stepper::new(simulation.settings).unwrap();
        for _ in 0..200 {
            stepper.step(&mut world).unwrap();
        }
        let crank = world.bodies.name.iter().position(|name| name == "crank").unwrap();
        assert!(
            (world.bodies.position[crank] - expected).length() < 1e-10,
            "{point}: {}",
            world.bodies.position[crank]
        );
    }
}
