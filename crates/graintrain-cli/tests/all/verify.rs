//! `verify` as a user meets it: the report, progress, exit codes.

use std::process::Command;

fn graintrain(arguments: &[&str]) -> (Option<i32>, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_graintrain")).args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (out.status.code(), text(out.stdout), text(out.stderr))
}

#[test]
fn a_report_is_written_and_progress_reported() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("verification");
    let (code, table, progress) = graintrain(&["verify", "--only", "a1,A8", "--out", out.to_str().unwrap()]);
    assert_eq!(code, Some(0), "{table}{progress}");
    assert!(
        table.contains("2 cases, 0 failed") && progress.contains("A8 Head-on impact"),
        "{table}{progress}"
    );
    for name in ["verify.md", "verify.html"] {
        let text = std::fs::read_to_string(out.join(name)).unwrap();
        for word in [
            "2 cases, 0 failed",
            "graintrain verify --only a1,A8",
            "UTC",
            "algebra: ",
            std::env::consts::ARCH,
        ] {
            assert!(text.contains(word), "{name}: {word}");
        }
    }
}

/// The CSV has a row for each number of the table, all of one width, and the same numbers as the same command
/// makes again.
#[test]
fn rows_are_written_for_programs() {
    let folder = tempfile::tempdir().unwrap();
    let written = |name: &str| {
        let out = folder.path().join(name);
        let (code, table, _) = graintrain(&["verify", "--only", "A8", "--out", out.to_str().unwrap()]);
        assert_eq!(code, Some(0), "{table}");
        (std::fs::read_to_string(out.join("verify.csv")).unwrap(), table)
    };
    let (csv, table) = written("first");
    let mut lines = csv.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = |name: &str| header.iter().position(|column| *column == name).unwrap();
    let mut rows = 0;
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |name: &str| cells[place(name)].parse::<f64>().unwrap();
        // Texts of this case have no commas.
        assert_eq!(
            (cells.len(), cells[0], cells[place("verdict")]),
            (header.len(), "A8", "passed"),
            "{line}"
        );
        assert!((number("got") - number("expected")).abs() <= number("allowed"), "{line}");
        rows += 1;
    }
    assert_eq!(rows, table.lines().filter(|line| line.starts_with("| A8")).count());
    assert_eq!(written("second").0, csv);
}

#[test]
fn unknown_cases_are_bad_input() {
    let (code, _, message) = graintrain(&["verify", "--only", "A99"]);
    assert!(code == Some(2) && message.contains("A99") && message.contains("A1, A2"), "{message}");
}
