//! `sweep`, `dt-study` and `tolerance-study` as a user meets them: tables, errors, kills, extensions.
#![cfg(unix)]

use crate::slide::SLIDE;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Balls that fall at random places.
const RAIN: &str = r#"
[time]
step = "2 ms"
steps = 150
[body.floor]
shape = { plane = {} }
[packing.balls]
radius = "5 cm"
drop = { count = 20, box = { min = [0, 0, 0], max = [0.6, 0.6, 1] } }
[measure.all]
motion = true
coordination = true
every = "10 ms"
"#;

fn graintrain(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_graintrain"));
    command.current_dir(folder).args(arguments);
    command
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("slide.toml"), SLIDE).unwrap();
    std::fs::write(folder.path().join("rain.toml"), RAIN).unwrap();
    folder
}

fn reported(output: Output, code: i32) -> (String, String) {
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let (out, err) = (text(output.stdout), text(output.stderr));
    assert_eq!(output.status.code(), Some(code), "stdout: {out}\nstderr: {err}");
    assert!(!err.contains("panicked"), "{err}");
    (out, err)
}

fn ended(folder: &Path, arguments: &[&str], code: i32) -> (String, String) {
    reported(graintrain(folder, arguments).output().unwrap(), code)
}

/// A table by columns' names.
struct Csv(Vec<Vec<String>>);

impl Csv {
    fn read(path: &Path) -> Self {
        let text =
            std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Self(text.lines().map(|line| line.split(',').map(str::to_string).collect()).collect())
    }

    fn numbers(&self, name: &str) -> Vec<f64> {
        let index = self.0[0]
            .iter()
            .position(|column| column == name)
            .unwrap_or_else(|| panic!("{name}: {:?}", self.0[0]));
        self.0[1..].iter().map(|row| row[index].parse().unwrap_or(f64::NAN)).collect()
    }
}

/// The block's way against the closed form at four points of a grid, and the page with its plots.
#[test]
fn a_grid_of_sliding_blocks() {
    let folder = folder();
    let arguments =
        ["sweep", "slide.toml", "--over", "mu=0.3,0.5", "--over", "speed=1 m/s,0.5 m/s", "--out", "s"];
    let (out, _) =
        ended(folder.path(), &[arguments.as_slice(), &["--observe", "block.centre_x:last"]].concat(), 0);
    assert!(out.contains("4 runs (4 points, 1 seed)") && out.contains("mu=0.5, speed=0.5 m/s"), "{out}");
    let table = Csv::read(&folder.path().join("s/sweep.csv"));
    let (mu, way) = (table.numbers("mu"), table.numbers("block.centre_x:last"));
    assert_eq!(mu, [0.3, 0.3, 0.5, 0.5]);
    for (k, speed) in [1.0_f64, 0.5, 1.0, 0.5].into_iter().enumerate() {
        let exact = speed * speed / (2.0 * mu[k] * 9.81);
        // Steps of 2 ms: the way is short by half a step of the first speed.
        assert!((way[k] - exact).abs() < 0.6 * 0.002 * speed, "{} {exact}", way[k]);
    }
    let page = std::fs::read_to_string(folder.path().join("s/sweep.html")).unwrap();
    assert!(page.matches("<h2>").count() == 2 && page.contains("block.centre_x"), "{}", page.len());
    let columns = std::fs::read_to_string(folder.path().join("s/columns.json")).unwrap();
    let columns: serde_json::Value = serde_json::from_str(&columns).unwrap();
    let way =
        columns.as_array().unwrap().iter().find(|column| column["name"] == "block.centre_x:last").unwrap();
    assert_eq!(way["unit"], "m");
    // The same points from a table, and another scene in the same folder.
    std::fs::write(folder.path().join("points.csv"), "mu,speed\n0.3,1 m/s\n0.5,0.5 m/s\n").unwrap();
    ended(folder.path(), &["sweep", "slide.toml", "--table", "points.csv", "--out", "s", "--quiet"], 0);
    assert_eq!(Csv::read(&folder.path().join("s/sweep.csv")).numbers("runs"), [1.0, 1.0]);
    let other = ["sweep", "slide.toml", "--table", "points.csv", "--out", "s", "--set", "time.end=1 s"];
    let (_, err) = ended(folder.path(), &other, 2);
    assert!(err.contains("another scene"), "{err}");
}

/// Means and standard errors over seeds are those of the runs; more seeds keep the runs that are there.
#[test]
fn seeds_are_averaged_and_added() {
    let folder = folder();
    let sweep = |seeds: &str| {
        ended(
            folder.path(),
            &["sweep", "rain.toml", "--seeds", seeds, "--jobs", "2", "--out", "s", "--quiet"],
            0,
        );
        (Csv::read(&folder.path().join("s/sweep.csv")), Csv::read(&folder.path().join("s/runs.csv")))
    };
    let (_, first) = sweep("2");
    let (table, runs) = sweep("4");
    let heights = runs.numbers("all.centre_z:last");
    assert_eq!(heights[..2], first.numbers("all.centre_z:last")[..]);
    assert_eq!(runs.numbers("wall_seconds")[..2], first.numbers("wall_seconds")[..]);
    assert!(heights.len() == 4 && heights[0] != heights[1], "{heights:?}");
    let mean = heights.iter().sum::<f64>() / 4.0;
    let error = (heights.iter().map(|h| (h - mean).powi(2)).sum::<f64>() / 12.0).sqrt();
    assert!((table.numbers("all.centre_z:last")[0] - mean).abs() < 1e-12);
    assert!((table.numbers("all.centre_z:last_error")[0] - error).abs() < 1e-12);
}

/// A sweep that is killed goes on with the same command to the same numbers.
#[test]
fn a_killed_sweep_goes_on() {
    let folder = folder();
    let arguments = |out: &'static str| {
        [
            "sweep",
            "rain.toml",
            "--seeds",
            "3",
            "--set",
            "time.steps=400",
            "--out",
            out,
            "--quiet",
            "--jobs",
            "1",
        ]
    };
    ended(folder.path(), &arguments("whole"), 0);
    let table = folder.path().join("cut/runs/seed=1/steps.csv");
    let mut child = graintrain(folder.path(), &arguments("cut")).stderr(Stdio::null()).spawn().unwrap();
    let begin = Instant::now();
    while std::fs::read_to_string(&table).map_or(0, |text| text.lines().count()) < 60 {
        assert!(begin.elapsed() < Duration::from_secs(60), "no steps are recorded");
        std::thread::sleep(Duration::from_millis(3));
    }
    // A second one at the same time is refused.
    let (_, err) = ended(folder.path(), &arguments("cut"), 1);
    assert!(err.contains("another process"), "{err}");
    child.kill().unwrap();
    child.wait().unwrap();
    ended(folder.path(), &arguments("cut"), 0);
    for run in ["seed=0", "seed=1", "seed=2"] {
        let read = |sweep: &str| {
            std::fs::read_to_string(folder.path().join(sweep).join("runs").join(run).join("measures/all.csv"))
        };
        assert_eq!(read("whole").unwrap(), read("cut").unwrap(), "{run}");
    }
}

#[test]
fn studies_compare_observables() {
    let folder = folder();
    let (out, _) = ended(
        folder.path(),
        &[
            "dt-study",
            "slide.toml",
            "--set",
            "time.step=20 ms",
            "--observe",
            "block.centre_x:last",
            "--within",
            "0.05",
        ],
        0,
    );
    // Semi-implicit steps: the way errs by v dt / 2 in the first order.
    assert!(
        out.contains("time.step = 0.02 is within 5 %") || out.contains("time.step = 0.01 is within 5 %"),
        "{out}"
    );
    let table = Csv::read(&folder.path().join("out/dt-study-slide/study.csv"));
    let (step, way) = (table.numbers("time.step"), table.numbers("value"));
    assert_eq!(step, [0.02, 0.01, 0.005]);
    for (dt, way) in step.iter().zip(&way) {
        assert!((way - 1.0 / (0.6 * 9.81)).abs() < *dt, "{dt} {way}");
    }
    let (out, _) = ended(
        folder.path(),
        &[
            "tolerance-study",
            "slide.toml",
            "--tolerances",
            "1e-3,1e-6,1e-8",
            "--observe",
            "block.centre_x:last",
        ],
        0,
    );
    assert!(out.contains("solver.tolerance"), "{out}");
}

#[test]
fn mistakes_are_reported_before_the_first_run() {
    let folder = folder();
    for (arguments, expected) in [
        (vec!["--over", "mu"], "KEY=V1"),
        (vec!["--over", "mu=1,1"], "twice"),
        (vec!["--over", "nu=1,2"], "nu"),
        (vec!["--over", "mu=0.1,-1"], "friction"),
        (vec!["--table", "none.csv"], "none.csv"),
        (vec!["--over", "mu=0.1", "--set", "time.step=1 kg"], "kg"),
    ] {
        let all = [["sweep", "slide.toml", "--out", "bad"].as_slice(), &arguments].concat();
        let (_, err) = ended(folder.path(), &all, 2);
        assert!(err.contains(expected), "{arguments:?}: {err}");
        assert!(!folder.path().join("bad/runs/mu=0.1,seed=0").exists(), "{arguments:?}");
    }
    let (_, err) =
        ended(folder.path(), &["sweep", "slide.toml", "--out", "s", "--observe", "block.center"], 2);
    assert!(err.contains("block.centre_x"), "{err}");
    // Numbers that are none.
    for text in ["nan", "inf", "-1", "0"] {
        let until = format!("--until={text}");
        ended(folder.path(), &["run", "slide.toml", "--out", "r", &until], 2);
        ended(folder.path(), &["sweep", "slide.toml", "--out", "s", &format!("--from={text}")], 2);
    }
}

/// What is wrong with a sweep is reported before its first run.
#[test]
fn everything_is_looked_at_before_the_first_run() {
    let folder = folder();
    let at = folder.path();
    let refused = |arguments: &[&str], expected: &[&str]| {
        let (_, err) = ended(at, &[&["sweep", "slide.toml", "--out", "s"], arguments].concat(), 2);
        expected.iter().for_each(|text| assert!(err.contains(text), "{text}: {err}"));
        assert!(!at.join("s/runs").exists() || std::fs::read_dir(at.join("s/runs")).unwrap().count() == 0);
    };
    refused(&["--observe", "block.centre"], &["block.centre", "block.centre_x"]);
    refused(&["--from", "3 s"], &["3 s", "ends at 0.8"]);
    refused(&["--over", "mu=0.1,-1", "--observe", "block.centre_x"], &["mu=-1"]);
    let table = |text: &str| std::fs::write(at.join("points.csv"), text).unwrap();
    table("mu,speed,mu\n0.1,1,0.2\n");
    refused(&["--table", "points.csv"], &["`mu` twice"]);
    table("mu\n\"0.1\n");
    refused(&["--table", "points.csv"], &["line 2", "not closed"]);
    table("mu\n0.1\n0.2,0.3\n");
    refused(&["--table", "points.csv"], &["points.csv: line 3", "one value", "CSV file with keys"]);
    table("");
    refused(&["--table", "points.csv"], &["points.csv: the table needs", "CSV file with keys"]);
    table("mu,\"speed\"\n0.3,\"1 m/s\"\n");
    let observe = ["--table", "points.csv", "--observe", "block.centre_x:last"];
    ended(at, &[&["sweep", "slide.toml", "--out", "s"], observe.as_slice()].concat(), 0);
    // A table that somebody damaged is reported, not averaged over.
    let run = std::fs::read_dir(at.join("s/runs")).unwrap().next().unwrap().unwrap().path();
    let path = run.join("measures/block.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replacen("\n2,", "\n2,7,", 1)).unwrap();
    let (_, err) = ended(at, &[&["sweep", "slide.toml", "--out", "s"], observe.as_slice()].concat(), 1);
    assert!(err.contains("block.csv") && err.contains("damaged"), "{err}");
}

/// A folder with other results is left as it is; that of another run of the same command is gone on with.
#[test]
fn folders_of_others_are_refused() {
    let folder = folder();
    let at = folder.path();
    ended(at, &["run", "slide.toml", "--out", "o", "--steps", "1", "--quiet"], 0);
    let names = || {
        let entries = std::fs::read_dir(at.join("o")).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let before = names();
    let fit = ["--fit", "mu=0.1..0.8", "--to", "block.centre_x:last=0.17+-0.01"];
    for (command, more) in [("sweep", &[][..]), ("dt-study", &[]), ("calibrate", &fit)] {
        let (_, err) = ended(at, &[&[command, "slide.toml", "--out", "o"], more].concat(), 2);
        assert!(err.contains("o is not empty") && err.contains("with --out"), "{command}: {err}");
        assert_eq!(names(), before, "{command}");
    }
    std::fs::create_dir(at.join("empty")).unwrap();
    for _ in 0..2 {
        ended(at, &["sweep", "slide.toml", "--out", "empty", "--quiet"], 0);
    }
}

#[test]
fn a_fit_tells_which_table_it_cannot_read() {
    let folder = folder();
    std::fs::write(folder.path().join("odd.csv"), "a,b\n1\n").unwrap();
    for (table, expected) in [("missing.csv", "No such file"), ("odd.csv", "1 of its lines")] {
        let arguments = ["fit", table, "--x", "a", "--y", "b", "--model", "c*x", "--start", "c=1"];
        let (_, err) = ended(folder.path(), &arguments, 2);
        let whole = format!("cannot read {table}: {expected}");
        assert!(err.contains(&whole) && err.contains("correct the file"), "{err}");
        assert_eq!(err.matches(table).count(), 1, "{err}");
    }
}

/// Means over runs whose last stage never began are of another state: the sweep says so.
#[test]
fn a_sweep_tells_of_stages_that_never_began() {
    let folder = folder();
    let stages = "[[stage]]\nname = \"settle\"\nkinetic_energy = \"1e-30 J\"\n[[stage]]\nname = \"press\"\n";
    std::fs::write(folder.path().join("staged.toml"), format!("{RAIN}{stages}")).unwrap();
    let arguments = ["sweep", "staged.toml", "--seeds", "2", "--out", "s", "--observe", "all.coordination"];
    let (_, err) = ended(folder.path(), &arguments, 0);
    assert!(err.contains("in 2 of 2 runs the stage `press` never began"), "{err}");
}
