//! `calibrate` as a user meets it: known answers, curves, kills, mistakes.
#![cfg(unix)]

use crate::slide::SLIDE;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn graintrain(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_graintrain"));
    command.current_dir(folder).args(["calibrate", "slide.toml"]).args(arguments);
    command
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("slide.toml"), SLIDE).unwrap();
    folder
}

/// What it printed, after it ended with this code; reports without their breaks of lines.
fn ended(folder: &Path, arguments: &[&str], code: i32) -> (String, String) {
    let output = graintrain(folder, arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{out}\n{err}");
    (out, err.replace("\n  │ ", " "))
}

fn answer(folder: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join("calibration.json")).unwrap()).unwrap()
}

/// A way of v^2 / (2 * 0.3 g) is that of mu = 0.3, within the error that the way's own error makes: 2 %.
#[test]
fn friction_from_a_way() {
    let folder = folder();
    let way = 1.0 / (2.0 * 0.3 * 9.81);
    let to = format!("block.centre_x:last={way}+-2%");
    let (out, _) = ended(folder.path(), &["--fit", "mu=0.1..0.8", "--to", &to, "--out", "c"], 0);
    assert!(
        out.contains("mu") && out.contains("95 %") && out.contains("graintrain run slide.toml --set mu=0."),
        "{out}"
    );
    let found = answer(&folder.path().join("c"));
    let mu = &found["parameters"][0];
    let (value, error) = (mu["value"].as_f64().unwrap(), mu["error"].as_f64().unwrap());
    // Steps of 2 ms shorten the way by v dt / 2: 0.6 %.
    assert!((value - 0.3).abs() < 0.01 && (0.7..1.5).contains(&(error / 0.006)), "{value} {error}");
    let page = std::fs::read_to_string(folder.path().join("c/calibration.html")).unwrap();
    assert!(page.contains("surrogate") && page.matches("</h2><svg").count() == 2, "{}", page.len());
    let ledger = std::fs::read_to_string(folder.path().join("c/ledger.csv")).unwrap();
    assert!(ledger.starts_with("point,round,mu\n0,0,0.45\n"), "{ledger}");
}

/// Both parameters from the way at two speeds (a run each), and from the path in time, whose ordinate is in
/// centimetres.
#[test]
fn parameters_from_curves() {
    let folder = folder();
    let ways: String =
        [0.5, 0.75, 1.0].map(|v: f64| format!("{v},{}\n", v * v / (2.0 * 0.25 * 9.81))).concat();
    std::fs::write(folder.path().join("ways.csv"), format!("speed,way\n{ways}")).unwrap();
    let to = "block.centre_x:last=ways.csv+-0.001";
    ended(folder.path(), &["--fit", "mu=0.1..0.8", "--to", to, "--out", "ways", "--quiet"], 0);
    let mu = answer(&folder.path().join("ways"))["parameters"][0]["value"].as_f64().unwrap();
    assert!((mu - 0.25).abs() < 0.005, "{mu}");
    let path: String = (1..8)
        .map(|k| 0.02 * f64::from(k))
        .map(|t| format!("{t},{},0.1\n", 100.0 * (0.8 * t - 0.5 * 0.4 * 9.81 * t * t)))
        .collect();
    std::fs::write(folder.path().join("path.csv"), format!("time,x (cm),error (cm)\n{path}")).unwrap();
    let arguments = ["--fit", "mu=0.1..0.8", "--fit", "speed=log:0.3..3", "--to", "block.centre_x=path.csv"];
    ended(folder.path(), &[arguments.as_slice(), &["--out", "path", "--quiet"]].concat(), 0);
    let found = answer(&folder.path().join("path"));
    for (k, truth) in [0.4, 0.8].into_iter().enumerate() {
        let of = |key: &str| found["parameters"][k][key].as_f64().unwrap();
        assert!((of("low")..=of("high")).contains(&truth), "{k}: {found}");
    }
    // A faster block with more friction comes nearly as far.
    assert!(found["correlation"][0][1].as_f64().unwrap() > 0.5, "{found}");
}

/// Runs with much friction never come as far as the abscissa: where they have no number is no answer.
#[test]
fn no_answer_stands_on_no_run() {
    let folder = folder();
    std::fs::write(folder.path().join("x.csv"), "centre_x,v\n0.25,-0.4\n").unwrap();
    let to = "block.velocity_x=x.csv+-0.05";
    let (_, err) = ended(folder.path(), &["--fit", "mu=0.1..0.3", "--to", to, "--out", "x"], 1);
    assert!(err.contains("no run has a number for `block.velocity_x at centre_x = 0.25`"), "{err}");
    assert!(!err.contains("more runs would narrow"), "{err}");
    // A point of a curve at which no run has a record: where the records are is reported, and what the runs
    // said is there.
    std::fs::write(folder.path().join("t.csv"), "time,x\n0.1,0.08\n2.5,0.17\n").unwrap();
    let late = ["--fit", "mu=0.1..0.8", "--to", "block.centre_x=t.csv+-0.001", "--out", "t"];
    let (_, err) = ended(folder.path(), &late, 2);
    assert!(err.contains("at time = 2.5") && err.contains("to 0.8"), "{err}");
    assert!(folder.path().join("t/observed.csv").exists());
}

/// What was set is in the command that it prints, in quotes where a shell would split it.
#[test]
fn the_printed_command_has_all_settings() {
    let folder = folder();
    let way = "block.centre_x:last=0.17+-0.01";
    let arguments =
        ["--set", "speed=0.9 m/s", "--fit", "mu=0.1..0.8", "--to", way, "--points", "6", "--out", "s"];
    let (out, _) = ended(folder.path(), &arguments, 0);
    assert!(out.contains("graintrain run slide.toml --set 'speed=0.9 m/s' --set mu=0."), "{out}");
}

/// A scene that cannot be built in the middle of the ranges is reported before the first run, with its place.
#[test]
fn scenes_that_cannot_be_built() {
    let folder = folder();
    let whole = SLIDE.replace("mu = 0.3", "mu = 0.3\nn = 3").replace(
        "[measure.block]",
        "[packing.p]\nradius = 0.01\nlattice = { counts = [\"n\", 1, 1], pitch = 0.03, origin = [2, 0, 0.01] }\n[measure.block]\nbodies = [\"block\"]",
    );
    std::fs::write(folder.path().join("slide.toml"), whole).unwrap();
    let to = "block.centre_x:last=0.17+-0.01";
    let (_, err) = ended(folder.path(), &["--fit", "n=2..9", "--to", to, "--out", "n"], 2);
    assert!(err.contains("at n=5.5") && err.contains("must be a whole number"), "{err}");
    assert_eq!(std::fs::read_dir(folder.path().join("n/runs")).unwrap().count(), 0);
}

/// Killed and gone on with: the same answer, to the last bit.
#[test]
fn a_killed_calibration_goes_on() {
    let folder = folder();
    let arguments = |out: &'static str| {
        [
            "--fit",
            "mu=0.1..0.8",
            "--to",
            "block.centre_x:last=0.17+-0.001",
            "--points",
            "14",
            "--out",
            out,
            "--quiet",
        ]
    };
    ended(folder.path(), &arguments("whole"), 0);
    let mut child = graintrain(folder.path(), &arguments("cut")).stderr(Stdio::null()).spawn().unwrap();
    let begin = Instant::now();
    let runs = folder.path().join("cut/runs");
    while std::fs::read_dir(&runs).map_or(0, Iterator::count) < 4 {
        assert!(begin.elapsed() < Duration::from_secs(60), "no runs are made");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    ended(folder.path(), &arguments("cut"), 0);
    for file in ["calibration.json", "ledger.csv", "observed.csv"] {
        let read = |out: &str| std::fs::read_to_string(folder.path().join(out).join(file)).unwrap();
        assert_eq!(read("whole"), read("cut"), "{file}");
    }
    // Another question in the same place is refused.
    let other = ["--fit", "mu=0.2..0.8", "--to", "block.centre_x:last=0.17+-0.001", "--out", "cut"];
    let (_, err) = ended(folder.path(), &other, 2);
    assert!(err.contains("other parameters") && err.contains("--out"), "{err}");
}

#[test]
fn what_cannot_be_reached_is_said() {
    let folder = folder();
    let far = ["--fit", "mu=0.1..0.8", "--to", "block.centre_x:last=3+-0.01", "--out", "far"];
    let (_, err) = ended(folder.path(), &far, 1);
    assert!(err.contains("no values in these ranges") && err.contains("end of its range"), "{err}");
}

#[test]
fn mistakes_are_reported_before_the_first_run() {
    let folder = folder();
    std::fs::write(folder.path().join("bad.csv"), "time,x\n1\n").unwrap();
    std::fs::write(folder.path().join("mus.csv"), "mu,x\n0.2,0.25\n0.3,0.17\n").unwrap();
    let way = "block.centre_x:last=0.17+-0.01";
    for (arguments, expected) in [
        (vec!["--fit", "mu", "--to", way], "KEY=LOW..HIGH"),
        (vec!["--fit", "mu=0.8..0.1", "--to", way], "lower end"),
        (vec!["--fit", "mu=-1..0.5", "--to", way], "friction"),
        (vec!["--fit", "nu=0.1..0.5", "--to", way], "nu"),
        (vec!["--fit", "mu=0.1..0.5", "--fit", "mu=0.1..0.4", "--to", way], "twice"),
        (vec!["--fit", "mu=0.1..0.5", "--to", "block.center_x=1"], "block.centre_x"),
        (vec!["--fit", "mu=0.1..0.5", "--to", "block.centre_x"], "OBSERVABLE=VALUE"),
        (vec!["--fit", "mu=0.1..0.5", "--to", "block.centre_x=none.csv"], "none.csv"),
        (vec!["--fit", "mu=0.1..0.5", "--to", "block.centre_x=bad.csv"], "bad.csv"),
        (vec!["--fit", "mu=0.1..0.5", "--to", way, "--points", "3"], "too few"),
        (vec!["--fit", "mu=0.1..0.5", "--to", way, "--set", "parameters.mu=0.2"], "both fitted and set"),
        (vec!["--fit", "mu=0.1..0.5", "--to", "block.centre_x:last=mus.csv"], "nothing would be varied"),
        (vec!["--fit", "mu=0.1..0.5", "--to", "block.centre_x:last=0+-5%"], "share of zero"),
    ] {
        let all = [arguments.as_slice(), &["--out", "bad"]].concat();
        let (_, err) = ended(folder.path(), &all, 2);
        assert!(err.contains(expected), "{arguments:?}: {err}");
        assert!(!folder.path().join("bad/runs").exists(), "{arguments:?}");
    }
}

/// mu = 0.35 from six angles of repose, each the mean of 16 runs with seeds of their own: within the 95 %
/// interval in five of six.
#[test]
#[ignore = "228 runs of 220 grains: two minutes"]
fn friction_from_an_angle_of_repose() {
    let folder = folder();
    let at = folder.path();
    std::fs::write(at.join("heap.toml"), include_str!("heap.toml")).unwrap();
    let program = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_graintrain"));
        let status = command.current_dir(at).args(arguments).args(["--from", "1.85 s", "--quiet"]).status();
        assert!(status.unwrap().success(), "{arguments:?}");
    };
    let observable = "heap.repose_angle";
    program(&[
        "sweep",
        "heap.toml",
        "--set",
        "mu=0.35",
        "--set",
        "seed=900000",
        "--seeds",
        "96",
        "--observe",
        observable,
        "--out",
        "truth",
    ]);
    let table = std::fs::read_to_string(at.join("truth/runs.csv")).unwrap();
    let column = table.lines().next().unwrap().split(',').position(|name| name == observable).unwrap();
    let angles: Vec<f64> =
        table.lines().skip(1).map(|line| line.split(',').nth(column).unwrap().parse().unwrap()).collect();
    let mut inside = 0;
    for (seed, angles) in angles.chunks_exact(16).enumerate() {
        let mean = angles.iter().sum::<f64>() / 16.0;
        let error = (angles.iter().map(|angle| (angle - mean).powi(2)).sum::<f64>() / (15.0 * 16.0)).sqrt();
        let (out, to) = (format!("c{seed}"), format!("{observable}={mean}+-{error}"));
        let seed = format!("seed={}", 1_000_003 * (seed + 1));
        program(&[
            "calibrate",
            "heap.toml",
            "--set",
            &seed,
            "--fit",
            "mu=0.1..0.8",
            "--to",
            &to,
            "--out",
            &out,
        ]);
        let found = answer(&at.join(out));
        let of = |key: &str| found["parameters"][0][key].as_f64().unwrap();
        println!("{} +- {} ({} to {})", of("value"), of("error"), of("low"), of("high"));
        inside += usize::from((of("low")..=of("high")).contains(&0.35));
    }
    assert!(inside >= 5, "{inside} of 6");
}
