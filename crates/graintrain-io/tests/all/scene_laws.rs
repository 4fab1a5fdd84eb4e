//! Stiffness, damping and cohesion in scenes: pairs, what is refused, and the same bits after a checkpoint.

use graintrain::material::Elasticity;
use graintrain::stepper::Stepper;
use graintrain_io::checkpoint;
use graintrain_io::run::{RunSettings, RunTotals};
use graintrain_io::scene::{Scene, Simulation};
use std::path::Path;

const SCENE: &str = "
[time]
step = \"1 ms\"
steps = 60
[material.clay]
stiffness = \"20 kN/m\"
damping = \"4 N s/m\"
cohesion = \"3 mN\"
[material.rubber]
stiffness = \"20 kN/m\"
[material.steel]
[[pair]]
materials = [\"rubber\", \"steel\"]
stiffness = \"7 kN/m\"
damping = \"1 N s/m\"
cohesion = \"1 mN\"
[body.floor]
shape = { plane = {} }
material = \"steel\"
[packing.grains]
radius = \"5 mm\"
material = \"clay\"
lattice = { counts = [2, 2, 3], pitch = \"10 mm\" }
[packing.stones]
shape = { hull = { points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], scale = 0.01 } }
material = \"rubber\"
lattice = { counts = [2, 1, 1], pitch = \"3 cm\", origin = [\"4 cm\", 0, 0] }
";

fn build(text: &str) -> Result<Simulation, String> {
    let scene = Scene::parse("laws", "laws.toml", text, Path::new("."), &[]).map_err(|e| e.to_string())?;
    scene.build().map_err(|error| error.to_string())
}

#[test]
fn pairs_have_their_own_laws_or_those_of_both_materials() {
    let check = |text: &str| {
        let materials = build(text).unwrap().world.materials;
        let at = |name: &str| materials.names.iter().position(|known| known == name).unwrap();
        let of = |a: &str, b: &str| materials.pair_elasticity(at(a), at(b));
        let close = |found: Elasticity, stiffness: f64, damping: f64| {
            assert!((found.stiffness - stiffness).abs() <= 1e-9 * stiffness, "{found:?}");
            assert!((found.damping - damping).abs() <= 1e-9 * damping, "{found:?}");
        };
        close(of("clay", "clay"), 2e4, 4.0);
        close(of("clay", "steel"), 4e4, 8.0);
        close(of("steel", "rubber"), 7e3, 1.0);
        close(of("clay", "rubber"), 2e4, 2.0);
        assert!(of("steel", "steel").is_rigid());
        let pull = |a: &str, b: &str| materials.pair_cohesion(at(a), at(b));
        assert_eq!([pull("clay", "clay"), pull("clay", "steel"), pull("steel", "rubber")], [3e-3, 0.0, 1e-3]);
    };
    check(SCENE);
    // What a run's folder keeps says the same.
    let scene = Scene::parse("laws", "laws.toml", SCENE, Path::new("."), &[]).unwrap();
    check(&scene.to_toml().unwrap());
}

#[test]
fn wrong_laws_are_reported_where_they_stand() {
    for (from, to, expected) in [
        ("stiffness = \"7 kN/m\"", "stiffness = \"7 kN\"", "stiffness"),
        ("cohesion = \"3 mN\"", "cohesion = -1", "cohesion"),
        (
            "cohesion = \"1 mN\"",
            "cohesion = 1e308",
            "laws.toml:16:12: `pair.0.cohesion` must be at most 1e30 N, got 1e308",
        ),
        ("[material.steel]", "[material.steel]\ndamping = 3", "without a `stiffness`"),
        ("[material.rubber]", "[material.rubber]\nrestitution = 0.5", "give it `damping`"),
        ("stiffness = \"7 kN/m\"", "stiffness = 0", "without a `stiffness`"),
    ] {
        let error = build(&SCENE.replace(from, to)).err().unwrap_or_else(|| panic!("{to} was accepted"));
        assert!(error.contains(expected), "{to}: {error}");
    }
    // What a pair and its materials give together is placed at the pair, or at the stage that changes a
    // material.
    let rigid = SCENE.replace("stiffness = \"20 kN/m\"", "").replace("damping = \"4 N s/m\"", "");
    let error = build(&rigid.replace("stiffness = \"7 kN/m\"", "")).err().unwrap();
    assert!(error.starts_with("laws.toml:12:"), "{error}");
    assert!(
        error.contains("the damping between materials 'rubber' and 'steel', without a stiffness, is 1"),
        "{error}"
    );
    let stage = "[[stage]]\nname = \"hard\"\ntime = \"3 ms\"\n[stage.material.rubber]\nrestitution = 0.5\n";
    let text = format!("{SCENE}{stage}");
    let line = text.lines().position(|line| line == "[[stage]]").unwrap() + 1;
    let error = build(&text).err().unwrap();
    assert!(error.starts_with(&format!("laws.toml:{line}:")), "{error}");
    assert!(error.contains("give it damping"), "{error}");
}

/// Elastic contacts may overlap at the start by more than rigid ones.
#[test]
fn a_resting_elastic_overlap_is_no_mistake() {
    let scene = "[time]\nstep = \"1 ms\"\nsteps = 5\n[contact]\nrelax = true\n[material.soft]\nSTIFFNESS\n[body.floor]\nshape = { plane = {} }
[body.ball]\nshape = { sphere = { radius = 0.1 } }\nposition = [0, 0, 0.08]\n";
    let soft = scene.replace("STIFFNESS", "stiffness = 1e4");
    let simulation = build(&soft).unwrap();
    assert_eq!(simulation.world.bodies.position[1].z, 0.08);
    let rigid = scene.replace("STIFFNESS", "");
    assert!(build(&rigid).unwrap().world.bodies.position[1].z > 0.098);
    let error = build(&rigid.replace("relax = true", "")).err().unwrap();
    assert!(error.contains("overlap at the start"), "{error}");
}

/// Where there is no room for a packing, as after a typing error in a radius, its bodies are not moved apart
/// for minutes.
#[test]
fn a_packing_without_room_is_refused_soon() {
    let scene = "[time]\nstep = \"1 ms\"\nsteps = 5\n[contact]\nrelax = true\n[material.soft]\nstiffness = 1e5\n[material.hard]
[[pair]]\nmaterials = [\"soft\", \"hard\"]\nstiffness = 1e5\n[body.floor]\nshape = { plane = {} }\nmaterial = \"hard\"
[packing.small]\nmaterial = \"soft\"\nradius = 0.05\nlattice = { counts = [4, 4, 4], pitch = 0.11, origin = [0, 0, 0.1] }
[packing.large]\nmaterial = \"hard\"\nradius = 1e5\nlattice = { counts = [1, 1, 1], pitch = 0.2, origin = [3, 0, 0] }
[body.lid]\nshape = { plane = {} }\nmaterial = \"hard\"\nposition = [0, 0, 2]\nrotation = { axis = [1, 0, 0], angle = \"180 deg\" }\n";
    let error = build(scene).err().unwrap();
    assert!(error.contains("overlap at the start"), "{error}");
}

/// Elastic, cohesive and hull-shaped bodies go on from a checkpoint with the same bits.
#[test]
fn a_checkpoint_goes_on_with_the_same_bits() {
    let simulation = build(SCENE).unwrap();
    let settings = RunSettings::new(&simulation, None);
    let mut world = simulation.world;
    let stepper = || Stepper::new(settings.stepping.clone()).unwrap();
    let mut first = stepper();
    for _ in 0..40 {
        let report = first.step(&mut world).unwrap();
        assert!(report.solve.converged(), "{:?}", report.solve);
    }
    let bytes = checkpoint::to_bytes(&settings, &RunTotals::default(), &world).unwrap();
    let mut other = checkpoint::from_bytes(&bytes, "a").unwrap().world;
    assert_eq!(other, world);
    let mut second = stepper();
    for _ in 0..20 {
        first.step(&mut world).unwrap();
        second.step(&mut other).unwrap();
    }
    assert_eq!(other.state_hash(), world.state_hash());
}
