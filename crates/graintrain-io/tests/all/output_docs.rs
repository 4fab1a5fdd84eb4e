//! The tables of columns in `docs/output.md`, and the attributes of Python's `StepReport`, are those of the
//! program: `GRAINTRAIN_WRITE_DOCS=1` writes them.

use graintrain_io::column::Column;
use graintrain_io::output::columns::{JOINTS, NEWTON, WRENCH, steps};
use graintrain_io::quantity::{FIGURES, QUANTITIES, Value};
use std::fmt::Write;

fn table(columns: &[Column]) -> String {
    let mut text = String::from("| column | unit | meaning |\n|---|---|---|\n");
    for (k, Column { name, unit, meaning }) in columns.iter().enumerate() {
        assert!(columns[..k].iter().all(|other| other.name != *name), "{name} twice");
        let unit = if *unit == "1" { "" } else { unit };
        writeln!(text, "| `{name}` | {unit} | {meaning} |").unwrap();
    }
    text
}

/// The attributes of a step's report as Python's type checkers read them.
fn stub() -> String {
    let report = graintrain::stepper::Stepper::new(Default::default()).unwrap();
    let report = { report }.step(&mut Default::default()).unwrap();
    let mut text = String::new();
    for quantity in QUANTITIES {
        let kind = match (quantity.value)(&report) {
            Value::Count(_) => "int",
            Value::Real(_) => "float",
            Value::Text(_) => "str",
            Value::Absent => "float | None",
        };
        write!(text, "    @property\n    def {}(self) -> {kind}: ...\n", quantity.column.name).unwrap();
    }
    text
}

/// Holds the part of a file between two lines against `text`, or writes it there.
fn check(path: &str, begin: &str, end: &str, text: &str) {
    let path = format!("{}/../../{path}", env!("CARGO_MANIFEST_DIR"));
    // The packed crate comes without the pages of the repository.
    let Ok(page) = std::fs::read_to_string(&path) else { return eprintln!("skipped: no {path}") };
    let start = page.find(begin).unwrap_or_else(|| panic!("{path} has no line {begin}")) + begin.len();
    let stop = start + page[start..].find(end).unwrap_or_else(|| panic!("{path} has no line {end}"));
    if std::env::var_os("GRAINTRAIN_WRITE_DOCS").is_some() {
        std::fs::write(&path, format!("{}{text}{}", &page[..start], &page[stop..])).unwrap();
        return;
    }
    assert!(page[start..stop] == *text, "{path} is out of date: run with GRAINTRAIN_WRITE_DOCS=1");
}

#[test]
fn pages_and_stubs_have_the_columns_of_the_program() {
    let tables = [
        ("steps.csv", table(&steps())),
        ("newton.csv", table(NEWTON)),
        ("wrench.csv", table(WRENCH)),
        ("joints.csv", table(JOINTS)),
        ("summary.json", table(FIGURES).replace("| column |", "| key |")),
    ];
    for (name, table) in tables {
        let begin =
            format!("<!-- {name}: written by the test output_docs with GRAINTRAIN_WRITE_DOCS=1 -->\n");
        check("docs/output.md", &begin, "<!-- end -->\n", &table);
    }
    let begin = "    # steps.csv: written by the test output_docs with GRAINTRAIN_WRITE_DOCS=1\n";
    let path = "crates/graintrain-python/python/graintrain/_graintrain.pyi";
    check(path, begin, "    # other\n", &stub());
}
