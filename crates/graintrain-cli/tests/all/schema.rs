//! `graintrain schema` by a validator that knows nothing of scenes, Python's `jsonschema`: what the reader
//! takes the schema takes, and what the schema refuses the reader refuses. Skipped where there is no Python
//! with `jsonschema` and `tomllib`.

use assert_cmd::Command;
use graintrain_io::scene::{Scene, builtin};
use std::io::Write;
use std::path::Path;
use std::process::Stdio;

/// Reads {"schema": ..., "scenes": [TOML, ...]} and prints a line for each scene: `valid`, or the first place
/// that is not.
const VALIDATOR: &str = r#"
import json, sys, tomllib
from jsonschema import Draft7Validator
given = json.load(sys.stdin)
Draft7Validator.check_schema(given["schema"])
validator = Draft7Validator(given["schema"])
for text in given["scenes"]:
    errors = list(validator.iter_errors(tomllib.loads(text)))
    print("invalid: /" + "/".join(map(str, errors[0].absolute_path)) if errors else "valid")
"#;

/// The validator's lines; `None` where there is no validator.
fn verdicts(scenes: &[String]) -> Option<Vec<String>> {
    let found = std::process::Command::new("python3").args(["-c", "import tomllib, jsonschema"]).output();
    if !found.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: no python3 with tomllib and jsonschema");
        return None;
    }
    let schema = Command::cargo_bin("graintrain").unwrap().arg("schema").output().unwrap();
    assert!(schema.status.success());
    let schema: serde_json::Value = serde_json::from_slice(&schema.stdout).unwrap();
    let mut python = std::process::Command::new("python3")
        .args(["-c", VALIDATOR])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let given = serde_json::json!({ "schema": schema, "scenes": scenes });
    python.stdin.take().unwrap().write_all(given.to_string().as_bytes()).unwrap();
    let output = python.wait_with_output().unwrap();
    assert!(output.status.success());
    Some(String::from_utf8(output.stdout).unwrap().lines().map(String::from).collect())
}

#[test]
fn every_scene_that_is_read_is_valid() {
    let mut scenes: Vec<String> = builtin::SCENES.iter().map(|scene| scene.text.to_string()).collect();
    // With every default filled in.
    for scene in builtin::SCENES {
        let read = Scene::parse(scene.name, scene.name, scene.text, Path::new(""), &[]);
        scenes.extend(read.ok().map(|read| read.to_toml().unwrap()));
    }
    for file in [
        "../../docs/orifice.toml",
        "tests/all/heap.toml",
        "../graintrain-io/tests/all/pour.toml",
        "../graintrain-io/tests/all/measures.toml",
    ] {
        // Packed crates come without their neighbours.
        scenes.extend(std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)));
    }
    assert!(scenes.len() > 20, "{}", scenes.len());
    let Some(verdicts) = verdicts(&scenes) else { return };
    assert_eq!(verdicts.len(), scenes.len());
    for (scene, verdict) in scenes.iter().zip(verdicts) {
        assert_eq!(verdict, "valid", "{scene}");
    }
}

#[test]
fn what_is_refused_is_refused_by_both() {
    let ball = "[time]\nstep = \"1 ms\"\nend = 1\n[body.ball]\nshape = { sphere = { radius = \"1 cm\" } }\n";
    let and = |more: &str| format!("{ball}{more}");
    let cases = [
        (and("mas = 3\n"), "/body/ball"),
        (and("mass = -3\n"), "/body/ball/mass"),
        (and("position = [0, 0]\n"), "/body/ball/position"),
        (and("motion = \"frozen\"\n"), "/body/ball/motion"),
        (and("parts = []\n"), "/body/ball"),
        (and("mass = 1\ndensity = 1\n"), "/body/ball"),
        (and("[material.glass]\nrestitution = 1.5\n"), "/material/glass/restitution"),
        (and("[material.glass]\nrolling_friction = -1\n"), "/material/glass/rolling_friction"),
        (and("[contact]\noverlap = \"never\"\n"), "/contact/overlap"),
        (and("[solver]\nfriction = \"some\"\n"), "/solver/friction"),
        (and("[solver]\nmax_iterations = 0\n"), "/solver/max_iterations"),
        (and("[solver]\nstrict_max = \"yes\"\n"), "/solver/strict_max"),
        (and("[output]\nevery = 0\n"), "/output/every"),
        (and("[joint.hinge]\nbodies = [\"ball\"]\n"), "/joint/hinge"),
        (and("[body.other]\nshape = {}\n"), "/body/other/shape"),
        (
            and("[body.other]\nshape = { sphere = { radius = 1 }, box = { size = [1, 1, 1] } }\n"),
            "/body/other/shape",
        ),
        (
            and("[packing.p]\nradius = 1\nlattice = { counts = [0, 1, 1], pitch = 2 }\n"),
            "/packing/p/lattice/counts/0",
        ),
        (
            and("[packing.p]\nradius = 1\nlattice = { counts = [1, 1, 1], pitch = [2, 2] }\n"),
            "/packing/p/lattice/pitch",
        ),
        (and("[packing.p]\nradius = 1\n"), "/packing/p"),
        (and("[[stage]]\ntime = 1\n"), "/stage/0"),
        ("[time]\nend = 1\n".to_string(), "/time"),
        ("[time]\nstep = 1\n".to_string(), "/time"),
        ("[time]\nstep = 1\nend = 1\nsteps = 1\n".to_string(), "/time"),
        ("title = \"no time\"\n".to_string(), "/"),
    ];
    for (text, _) in &cases {
        assert!(Scene::parse("a", "a.toml", text, Path::new(""), &[]).is_err(), "the reader takes {text}");
    }
    let scenes: Vec<String> = cases.iter().map(|(text, _)| text.clone()).collect();
    let Some(verdicts) = verdicts(&scenes) else { return };
    for ((text, place), verdict) in cases.iter().zip(verdicts) {
        assert_eq!(verdict, format!("invalid: {place}"), "{text}");
    }
}
