//! The built-in scenes: they build, with the right number of bodies, and survive being written and read again.

use graintrain::scene::{Scene, Simulation, builtin};
use std::path::Path;

fn settings(list: &[(&str, &str)]) -> Vec<(String, String)> {
    list.iter().map(|(key, value)| (key.to_string(), value.to_string())).collect()
}

fn build(name: &str, list: &[(&str, &str)]) -> Simulation {
    let scene = Scene::load(name, &settings(list)).unwrap_or_else(|error| panic!("{name}: {error}"));
    scene.build().unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The resolved scene gives the same world, bit for bit, and writes itself the same way.
fn assert_resolves(simulation: &Simulation) {
    let text = simulation.resolved.to_toml().unwrap();
    let again = Scene::parse(&simulation.resolved.name, "resolved.toml", &text, Path::new("/elsewhere"), &[])
        .unwrap_or_else(|error| panic!("{error}\n{text}"));
    let rebuilt = again.build().unwrap();
    assert_eq!(rebuilt.world, simulation.world);
    assert_eq!(rebuilt.steps, simulation.steps);
    assert_eq!(rebuilt.output, simulation.output);
    assert_eq!(format!("{:?}", rebuilt.settings), format!("{:?}", simulation.settings));
    let without_comments =
        |text: String| text.lines().filter(|line| !line.starts_with('#')).collect::<Vec<_>>().join("\n");
    assert_eq!(without_comments(rebuilt.resolved.to_toml().unwrap()), without_comments(text));
}

#[test]
fn sedimentation_has_the_papers_number_of_bodies() {
    for (n, bodies) in [("1", 29), ("4", 731), ("8", 4915)] {
        let simulation = build("sedimentation", &[("n", n)]);
        assert_eq!(simulation.world.bodies.len(), bodies);
        assert_eq!(simulation.settings.step, 0.025);
        if n == "4" {
            assert_resolves(&simulation);
        }
    }
}

#[test]
fn names_are_unique() {
    let mut names: Vec<_> = builtin::SCENES.iter().map(|scene| scene.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), builtin::SCENES.len());
}
