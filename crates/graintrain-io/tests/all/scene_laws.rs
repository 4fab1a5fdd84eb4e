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
fn wrong_laws_are_told_where_they_stand() {
    for (from, to, expected) in [
        ("stiffness = \"7 kN/m\"", "stiffness = \"7 kN\"", "stiffness"),
        ("cohesion = \"3 mN\"", "cohesion = -1", "cohesion"),
        ("[material.steel]", "[material.steel]\ndamping = 3", "without a `stiffness`"),
        ("[material.rubber]", "[material.rubber]\nrestitution = 0.5", "give it `damping`"),
        ("stiffness = \"7 kN/m\"", "stiffness = 0", "without a `stiffness`"),
    ] {
        let error = build(&SCENE.replace(from, to)).err().unwrap_or_else(|| panic!("{to} was accepted"));
        assert!(error.contains(expected), "{to}: {error}");
    }
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
