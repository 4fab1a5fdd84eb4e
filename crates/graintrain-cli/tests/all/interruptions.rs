//! Runs that are ended from outside, as a user and a job script meet them.
#![cfg(unix)]

use crate::runs::{ended, folder, graintrain, hash, read};
use std::path::Path;
use std::time::{Duration, Instant};

fn summary(folder: &Path) -> serde_json::Value {
    serde_json::from_str(&read(&folder.join("summary.json"))).unwrap()
}

/// The end of the time is reported by a code of its own, and what was computed goes on to the bits of a run
/// without a limit.
#[test]
fn a_run_whose_time_is_up_tells_it_by_its_exit_code() {
    let folder = folder();
    let limited = ["run", "balls.toml", "--out", "cut", "--steps", "100000000", "--max-seconds", "0.5"];
    let (out, err) = ended(graintrain(folder.path(), &limited), 3);
    assert!(out.contains("was stopped") && out.contains("graintrain resume cut"), "{out}");
    assert_eq!(err, "");
    let steps = summary(&folder.path().join("cut"))["steps"].as_u64().unwrap();
    let end = (steps + 20).to_string();
    let on = ["resume", "cut", "--steps", &end, "--max-seconds", "1e9", "--quiet"];
    ended(graintrain(folder.path(), &on), 0);
    let whole = ["run", "balls.toml", "--out", "whole", "--steps", &end, "--quiet"];
    ended(graintrain(folder.path(), &whole), 0);
    assert_eq!(hash(&folder.path().join("cut")), hash(&folder.path().join("whole")));
}

/// A step may take longer than the time that is left: it is dropped. Nothing reaches a residual of 1e-300 but
/// the iterations end at 1e9.
#[test]
fn the_time_ends_a_step_under_way() {
    let folder = folder();
    let run = ["run", "balls.toml", "--out", "cut", "--steps", "40", "--quiet"];
    ended(graintrain(folder.path(), &run), 0);
    let before = hash(&folder.path().join("cut"));
    let start = Instant::now();
    let text = read(&folder.path().join("balls.toml"))
        .replace("tolerance = 1e-5", "tolerance = 1e-300\nmax_iterations = 1000000000");
    std::fs::write(folder.path().join("endless.toml"), text).unwrap();
    let endless = ["run", "endless.toml", "--out", "endless", "--steps", "40", "--max-seconds", "1"];
    let (out, _) = ended(graintrain(folder.path(), &endless), 3);
    assert!(start.elapsed() < Duration::from_secs(20) && out.contains("was stopped"), "{out}");
    let start = Instant::now();
    let later = ["resume", "cut", "--steps", "41", "--tolerance", "1e-300", "--max-seconds", "1e-9"];
    let (_, err) = ended(graintrain(folder.path(), &later), 3);
    assert!(start.elapsed() < Duration::from_secs(20));
    assert!(err.contains("no step was finished in the time"), "{err}");
    assert_eq!(hash(&folder.path().join("cut")), before);
}

/// A folder in which a run was killed before its first checkpoint has no results: it can be taken without
/// --force, and `resume` says how.
#[test]
fn a_run_that_had_not_begun_stands_in_nobodys_way() {
    let folder = folder();
    let run = ["run", "balls.toml", "--out", "cut", "--steps", "3", "--quiet"];
    ended(graintrain(folder.path(), &run), 0);
    let (_, err) = ended(graintrain(folder.path(), &run), 2);
    assert!(err.contains("is not empty"), "{err}");
    // What a kill leaves: tables without records, a frame, the part of a checkpoint.
    let cut = folder.path().join("cut");
    std::fs::remove_file(cut.join("summary.json")).unwrap();
    for table in ["steps.csv", "wrench.csv", "joints.csv"] {
        let header = read(&cut.join(table)).lines().next().unwrap().to_string();
        std::fs::write(cut.join(table), header + "\n").unwrap();
    }
    for entry in std::fs::read_dir(cut.join("checkpoints")).unwrap() {
        let path = entry.unwrap().path();
        std::fs::rename(&path, path.with_extension("ckpt.part")).unwrap();
    }
    let (_, err) = ended(graintrain(folder.path(), &["resume", "cut"]), 2);
    assert!(err.contains("graintrain run cut/scene.toml --out cut"), "{err}");
    ended(graintrain(folder.path(), &["run", "cut/scene.toml", "--out", "cut", "--quiet"]), 0);
    assert_eq!(summary(&cut)["status"], "finished");
}

/// Tables that are cut or missing are reported, and what is left of them is kept.
#[test]
fn resume_tells_what_is_lost() {
    let folder = folder();
    let run = ["run", "balls.toml", "--out", "cut", "--steps", "40", "--quiet"];
    ended(graintrain(folder.path(), &run), 0);
    let cut = folder.path().join("cut");
    let wrench = read(&cut.join("wrench.csv"));
    std::fs::write(cut.join("wrench.csv"), &wrench[..300]).unwrap();
    std::fs::remove_file(cut.join("joints.csv")).unwrap();
    std::fs::remove_file(cut.join("contacts.pvd")).unwrap();
    let (_, err) = ended(graintrain(folder.path(), &["resume", "cut", "--steps", "41", "--quiet"]), 0);
    for reported in ["cut/wrench.csv.bad", "cut/joints.csv is missing", "cut/contacts.pvd is missing"] {
        assert!(err.contains(reported), "{reported}: {err}");
    }
    assert_eq!(read(&cut.join("wrench.csv.bad")), wrench[..300]);
    let (_, err) = ended(graintrain(folder.path(), &["resume", "cut", "--steps", "42", "--quiet"]), 0);
    assert_eq!(err, "");
}
