//! Rolling and spinning friction in scenes: numbers, lengths, pairs, errors, output.

use graintrain::material::TurningResistance::{self, Length, Ratio};
use graintrain::stepper::Stepper;
use graintrain_io::output::contacts::lines;
use graintrain_io::scene::{Scene, Simulation};
use std::path::Path;

const SCENE: &str = r#"
[time]
step = "1 ms"
end = "0.1 s"
[material.gravel]
density = 2600
friction = 0.5
rolling_friction = 0.1
spinning_friction = "0.2 mm"
[material.steel]
rolling_friction = 0.3
[material.rubber]
rolling_friction = "4 mm"
[[pair]]
materials = ["gravel", "rubber"]
rolling_friction = "1 cm"
spinning_friction = 0.05
[[pair]]
materials = ["steel", "rubber"]
rolling_friction = 0
[body.ground]
shape = { plane = {} }
material = "steel"
[body.ball]
shape = { sphere = { radius = 0.1 } }
material = "gravel"
position = [0, 0, 0.1]
velocity = [1, 0, 0]
angular_velocity = [0, 10, 0]
"#;

fn build(text: &str) -> Result<(Scene, Simulation), String> {
    let scene =
        Scene::parse("test", "test.toml", text, Path::new("."), &[]).map_err(|error| error.to_string())?;
    let simulation = scene.build().map_err(|error| error.to_string())?;
    Ok((scene, simulation))
}

#[test]
fn numbers_count_effective_radii_and_lengths_are_lengths() {
    let (_, simulation) = build(SCENE).unwrap();
    // Written out with its defaults and read again it is the same scene.
    let (_, again) = build(&simulation.resolved.to_toml().unwrap()).unwrap();
    assert_eq!(again.world.materials, simulation.world.materials);
    let materials = &simulation.world.materials;
    let place = |name: &str| materials.names.iter().position(|known| known == name).unwrap();
    let (gravel, steel, rubber) = (place("gravel"), place("steel"), place("rubber"));
    let pair = |a, b| (materials.pair_rolling(a, b), materials.pair_spinning(a, b));
    assert_eq!(pair(gravel, gravel), (Ratio(0.1), Length(2e-4)));
    // The rule of friction, minimum: what steel does not resist no pair with it does.
    assert_eq!(pair(gravel, steel), (Ratio(0.1), TurningResistance::NONE));
    assert_eq!(pair(rubber, gravel), (Length(1e-2), Ratio(0.05)));
    assert_eq!(pair(rubber, steel), (TurningResistance::NONE, TurningResistance::NONE));
    assert_eq!(pair(rubber, rubber), (Length(4e-3), TurningResistance::NONE));
}

#[test]
fn a_ball_of_a_scene_is_slowed_and_its_moment_is_in_the_frame() {
    let (_, mut simulation) = build(SCENE).unwrap();
    let mut stepper = Stepper::new(simulation.settings.clone()).unwrap();
    for _ in 0..100 {
        stepper.step(&mut simulation.world).unwrap();
    }
    let world = &simulation.world;
    let ball = world.bodies.name.iter().position(|name| name == "ball").unwrap();
    let expected = 1.0 - 5.0 / 7.0 * 9.81 * 0.1 * world.time;
    assert!((world.bodies.velocity[ball].x - expected).abs() < 0.01, "{}", world.bodies.velocity[ball].x);
    let frame = lines(world, &Default::default(), simulation.settings.step);
    assert!(frame.cell_data.iter().any(|array| array.name == "moment"));
    let (_, plain) = build(&SCENE.replace("rolling", "# rolling").replace("spinning", "# spinning")).unwrap();
    let frame = lines(&plain.world, &Default::default(), 1e-3);
    assert!(!frame.cell_data.iter().any(|array| array.name == "moment"));
}

#[test]
fn what_is_no_resistance_is_refused_with_its_place() {
    for (from, to, expected) in [
        ("[time]", "[solver]\nname = \"ipm\"\n[time]", "solver ipm cannot treat the rolling"),
        ("rolling_friction = 0.1", "rolling_friction = -0.1", "material.gravel.rolling_friction"),
        ("\"0.2 mm\"", "\"0.2 kg\"", "material.gravel.spinning_friction"),
        ("\"0.2 mm\"", "true", "a number (of effective radii) or a length"),
        ("rolling_friction = 0.3", "roling_friction = 0.3", "unknown key `roling_friction`"),
        (
            "materials = [\"steel\", \"rubber\"]\nrolling_friction = 0",
            "materials = [\"steel\", \"rubber\"]",
            "[[pair]]",
        ),
    ] {
        let text = SCENE.replace(from, to);
        assert_ne!(text, SCENE, "{from}");
        let error = build(&text).map(|_| ()).unwrap_err();
        assert!(error.contains(expected), "{to}: {error}");
    }
}
