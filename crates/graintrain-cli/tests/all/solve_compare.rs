//! `graintrain solve` and `graintrain compare` as a user and a script meet them: exit codes, keys, files,
//! messages.

use assert_cmd::Command;
use serde_json::Value;
use std::path::PathBuf;

/// Two contacts that share a body, as a Siconos text problem with dense W.
const PROBLEM: &str = "3\n2\n0\n6\n6\n6\t6\n\
    2. 0. 0. 1. 0.2 0.  0. 3. 0. 0. 1. 0.  0. 0. 3. 0. 0. 1.\n\
    1. 0. 0. 2. 0. 0.  0.2 1. 0. 0. 3. 0.  0. 0. 1. 0. 0. 3.\n\
    -1. 0.3 0. -1. 0. 0.2\n0.3 0.5\n";

struct Folder {
    folder: tempfile::TempDir,
}

impl Folder {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("two.dat"), PROBLEM).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn graintrain(&self, arguments: &[&str]) -> std::process::Output {
        let mut command = Command::cargo_bin("graintrain").unwrap();
        command.current_dir(self.folder.path()).args(arguments).output().unwrap()
    }
}

fn json(output: &std::process::Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn solve_prints_the_keys_that_scripts_rely_on() {
    let folder = Folder::new();
    let output = folder.graintrain(&["solve", "two.dat", "--json", "--tolerance", "1e-6"]);
    assert_eq!(output.status.code(), Some(0));
    let record = json(&output);
    for key in [
        "contacts",
        "bodies",
        "iterations",
        "linear_iterations",
        "seconds",
        "residual",
        "residual_rms",
        "objective",
    ] {
        assert!(record[key].is_number(), "{key}: {record}");
    }
    assert!(record["solver"].is_string() && record["converged"] == true, "{record}");
    assert!(record["residual"].as_f64().unwrap() <= 1e-6);
    assert_eq!((record["contacts"].as_u64(), record["bodies"].as_u64()), (Some(2), Some(0)));
}

#[test]
fn solution_files_do_not_depend_on_the_number_of_threads() {
    let folder = Folder::new();
    for (threads, name) in [("1", "one.csv"), ("2", "two.csv")] {
        let arguments = ["solve", "two.dat", "--solver", "apgd", "--threads", threads, "--solution", name];
        assert_eq!(folder.graintrain(&arguments).status.code(), Some(0));
    }
    let one = std::fs::read_to_string(folder.path("one.csv")).unwrap();
    assert_eq!(one, std::fs::read_to_string(folder.path("two.csv")).unwrap());
    assert_eq!(one.lines().count(), 3);
}

#[test]
fn an_unconverged_solve_is_exit_code_1_only_when_strict() {
    let folder = Folder::new();
    let arguments = ["solve", "two.dat", "--solver", "pgs", "--tolerance", "1e-30", "--max-seconds", "0.05"];
    assert_eq!(folder.graintrain(&arguments).status.code(), Some(0));
    assert_eq!(folder.graintrain(&[&arguments[..], &["--strict"]].concat()).status.code(), Some(1));
}

#[test]
fn bad_input_is_exit_code_2_and_a_message_with_file_and_remedy() {
    let folder = Folder::new();
    std::fs::write(folder.path("short.dat"), &PROBLEM[..40]).unwrap();
    let cases: [(&[&str], &str); 8] = [
        (&["solve", "missing.dat"], "missing.dat"),
        (&["solve", "short.dat"], "truncated"),
        (&["solve", "two.dat", "--solver", "magic"], "magic"),
        (&["solve", "two.dat", "--tolerance", "-1"], "positive"),
        (&["compare", "two.dat", "missing.dat"], "missing.dat"),
        (&["compare", "short.dat"], "short.dat"),
        (&["compare", "two.dat", "--profile", "no/such/profile.svg"], "profile.svg"),
        (&["solve", "two.dat", "--solution", "no/such/folder.csv"], "folder.csv"),
    ];
    for (arguments, expected) in cases {
        let output = folder.graintrain(arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(expected), "{arguments:?}: {message}");
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn compare_prints_an_array_and_draws_a_profile() {
    let folder = Folder::new();
    std::fs::copy(folder.path("two.dat"), folder.path("again.dat")).unwrap();
    let arguments =
        ["compare", "two.dat", "again.dat", "--solvers", "apgd,pgs", "--json", "--profile", "p.svg"];
    let output = folder.graintrain(&arguments);
    assert_eq!(output.status.code(), Some(0));
    let records = json(&output);
    let pairs: Vec<(&str, &str)> = records
        .as_array()
        .unwrap()
        .iter()
        .map(|record| (record["problem"].as_str().unwrap(), record["solver"].as_str().unwrap()))
        .collect();
    let expected = [("two.dat", "apgd"), ("two.dat", "pgs"), ("again.dat", "apgd"), ("again.dat", "pgs")];
    assert_eq!(pairs, expected);
    let svg = std::fs::read_to_string(folder.path("p.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("apgd"));
}

#[test]
fn the_table_stars_the_fastest_and_counts_who_converged() {
    let folder = Folder::new();
    std::fs::copy(folder.path("two.dat"), folder.path("again.dat")).unwrap();
    let output = folder.graintrain(&["compare", "two.dat", "again.dat", "--solvers", "apgd,pgs"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.matches('*').count(), 2, "{text}");
    assert_eq!(text.matches("2/2").count(), 2, "{text}");
}

/// A folder stands for its problems; what cannot be read is reported and left out, the rest is compared.
#[test]
fn unreadable_files_are_left_out_of_a_comparison() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("problems")).unwrap();
    std::fs::copy(folder.path("two.dat"), folder.path("problems/b.dat")).unwrap();
    std::fs::copy(folder.path("two.dat"), folder.path("problems/a.dat")).unwrap();
    std::fs::write(folder.path("problems/flat.dat"), PROBLEM.replacen('3', "2", 1)).unwrap();
    std::fs::write(folder.path("problems/notes.txt"), "no problem").unwrap();
    let output = folder.graintrain(&["compare", "problems", "two.dat", "--solvers", "apgd", "--json"]);
    assert_eq!(output.status.code(), Some(2));
    let records = json(&output);
    let names: Vec<&str> =
        records.as_array().unwrap().iter().map(|record| record["problem"].as_str().unwrap()).collect();
    assert_eq!(names, ["a.dat", "b.dat", "two.dat"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.contains("flat.dat") && message.contains("two-dimensional"), "{message}");
    assert!(message.contains("1 of 4 files left out"), "{message}");
}

/// Records say how an unusual file was read.
#[test]
fn notes_about_the_file_are_part_of_the_json() {
    let folder = Folder::new();
    std::fs::write(folder.path("asymmetric.dat"), PROBLEM.replacen("0.2 0.", "0.3 0.", 1)).unwrap();
    for command in ["solve", "compare"] {
        let record = json(&folder.graintrain(&[command, "asymmetric.dat", "--json"]));
        let record = if command == "solve" { &record } else { &record[0] };
        assert!(record["notes"][0].as_str().unwrap().contains("asymmetric"), "{record}");
    }
}

/// What was done before Ctrl-C is printed; solves that were cut short or never begun are not counted against
/// anybody.
#[cfg(unix)]
#[test]
fn an_interrupted_comparison_prints_what_is_done() {
    use std::io::{BufRead as _, BufReader, Read as _};
    let folder = Folder::new();
    std::fs::create_dir(folder.path("many")).unwrap();
    for k in 0..100 {
        std::fs::copy(folder.path("two.dat"), folder.path(&format!("many/{k:03}.dat"))).unwrap();
    }
    // Slow on purpose: each takes a fifth of a second.
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("graintrain"))
        .current_dir(folder.folder.path())
        .args(["compare", "many", "--solvers", "pgs@1e-6"])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut output = BufReader::new(child.stdout.take().unwrap());
    let mut text = String::new();
    while !text.contains("pgs@") {
        assert!(output.read_line(&mut text).unwrap() > 0, "{text}");
    }
    let kill = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    output.read_to_string(&mut text).unwrap();
    let mut message = String::new();
    child.stderr.take().unwrap().read_to_string(&mut message).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{message}");
    let done = text.matches("iteration limit").count();
    assert!((1..100).contains(&done) && !text.contains("out of time"), "{text}");
    assert!(text.contains(&format!("0/{done}")), "{text}");
    assert!(message.contains(&format!("stopped after {done} of 100 solves")), "{message}");
}

/// The examples of `--help`, typed one after the other in an empty folder, do what they say.
#[test]
fn the_examples_of_the_help_run_as_printed() {
    for command in ["solve", "compare"] {
        let folder = Folder::new();
        let help = String::from_utf8(folder.graintrain(&[command, "--help"]).stdout).unwrap();
        let (_, examples) = help.split_once("Examples").unwrap();
        let examples: Vec<&str> =
            examples.lines().filter_map(|line| line.trim().strip_prefix("graintrain ")).collect();
        assert!(examples.len() > 2, "{help}");
        for example in examples {
            let output = folder.graintrain(&example.split(' ').collect::<Vec<_>>());
            let message = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(0), "{example}: {message}");
        }
    }
}

#[test]
fn every_help_has_an_example() {
    let folder = Folder::new();
    for command in ["solve", "compare", "solvers"] {
        let output = folder.graintrain(&[command, "--help"]);
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(text.contains("Example") && text.contains(&format!("graintrain {command}")), "{text}");
    }
}
