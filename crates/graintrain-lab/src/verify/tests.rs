use super::bench::{Accuracy, Bench};
use super::report::{Head, csv, html, markdown, table};
use super::source::Source;
use super::*;
use graintrain_ccp::Criterion;
use graintrain_ccp::FrictionModel::{Coulomb, Relaxed};

fn sampled(ids: &[&str]) -> Vec<Case> {
    let mut reported = |_: &str| {};
    let stop = Arc::new(AtomicBool::new(false));
    let mut sampling =
        Sampling { n: 2, models: vec![Relaxed], scratch: PathBuf::new(), stop, progress: &mut reported };
    measure(tier_a().filter(|case| ids.is_empty() || ids.contains(&case.id)), &mut sampling, |_| {})
}

fn failures(cases: &[Case]) -> Vec<String> {
    let rows = cases.iter().flat_map(|case| {
        let failed = case.rows.iter().filter(|row| row.outcome() != Outcome::Passed);
        let rows = failed.map(|row| format!("{} {row:?}", case.definition.id));
        rows.chain(case.trouble.iter().map(|trouble| format!("{} {trouble}", case.definition.id)))
    });
    rows.collect()
}

#[test]
fn the_quick_cases_of_tier_a_pass() {
    let quick = ["A1", "A3", "A7", "A8", "A9", "A12", "A13", "A20", "A29"];
    let cases = sampled(&quick);
    assert_eq!(cases.len(), quick.len());
    assert_eq!(failures(&cases), Vec::<String>::new());
}

#[test]
#[ignore = "all of tier A takes about a minute"]
fn tier_a_passes() {
    let cases = sampled(&[]);
    println!("{}", table(&cases));
    assert_eq!(failures(&cases), Vec::<String>::new());
}

#[test]
fn every_case_has_a_setup_and_a_source_in_full() {
    let all: Vec<_> = tier_a().chain(tier_b()).collect();
    for case in &all {
        assert!(case.setup.ends_with('.') && !case.title.is_empty(), "{}", case.id);
        assert!(!case.sources.is_empty(), "{}", case.id);
        for source in case.sources {
            match source {
                Source::Algebra(how) => assert!(how.len() > 10, "{}: {how}", case.id),
                Source::Published { authors, title, journal, year } => {
                    let words = [authors, title, journal].iter().all(|word| word.len() > 5);
                    assert!(words && (1600..2100).contains(year), "{}: {source}", case.id);
                }
            }
        }
    }
    for k in 1..=29 {
        assert!(all.iter().any(|case| case.id == format!("A{k}")), "A{k}");
    }
    let mut ids: Vec<_> = all.iter().map(|case| case.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), all.len());
}

#[test]
fn rows_are_made_as_a_scene_that_asks_for_nothing_would() {
    let text = "[time]\nstep = \"1 ms\"\nsteps = 1\n[packing.grains]\nradius = \"1 cm\"\n\
                lattice = { counts = [1, 1, 1], pitch = \"3 cm\" }\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plain.toml");
    std::fs::write(&path, text).unwrap();
    let scene = graintrain_io::scene::Scene::load(path.to_str().unwrap(), &[]).unwrap();
    let settings = scene.build().unwrap().settings;
    assert_eq!(
        Accuracy::SCENES,
        Accuracy { tolerance: settings.solver.tolerance, criterion: settings.solver.criterion }
    );
    let row = Bench::new(1e-3, 0.0, Accuracy::SCENES, Coulomb).unwrap().row("nothing", 0.0, 0.0, 0.0);
    assert_eq!(row.solver, settings.solver.name.to_string());
    assert_eq!(Some(settings.solver.friction), row.friction);
}

const INVENTED: Definition = Definition {
    id: "A0",
    title: "Invented",
    setup: "Nothing is < done.",
    sources: &[Source::Algebra("one is one")],
    measure: Measure::LeftOut("invented"),
};

fn row(measured: f64, error: f64) -> Row {
    Row {
        what: "a | number".into(),
        friction: Some(Relaxed),
        solver: "auto".into(),
        step: 1e-3,
        accuracy: Accuracy { tolerance: 1e-4, criterion: Criterion::Mixed },
        measured,
        expected: 1.0,
        allowed: 0.1,
        error,
        steps: 10,
        unsolved: 0,
    }
}

#[test]
fn a_wrong_or_missing_number_fails() {
    assert_eq!(row(1.05, 0.0).outcome(), Outcome::Passed);
    assert_eq!(row(1.2, 0.0).outcome(), Outcome::Failed);
    assert_eq!(row(f64::NAN, 0.0).outcome(), Outcome::Failed);
    assert_eq!(Row { unsolved: 1, ..row(1.0, 0.0) }.outcome(), Outcome::Failed);
    // An error larger than what is allowed never passes, and fails only what it does not explain.
    assert_eq!(row(1.0, 0.2).outcome(), Outcome::Undecided);
    assert_eq!(row(1.2, 0.08).outcome(), Outcome::Undecided);
    assert_eq!(row(1.6, 0.2).outcome(), Outcome::Failed);
}

#[test]
fn the_report_renders() {
    static MEASURED: Definition =
        Definition { measure: Measure::Small(|| Ok(vec![row(1.05, 0.0), row(f64::NAN, 0.0)])), ..INVENTED };
    static TROUBLED: Definition =
        Definition { measure: Measure::Small(|| Ok(vec![Row { unsolved: 3, ..row(1.0, 0.0) }])), ..INVENTED };
    static LEFT_OUT: Definition = INVENTED;
    let mut reported = |_: &str| {};
    let stop = Arc::new(AtomicBool::new(false));
    let mut sampling =
        Sampling { n: 2, models: vec![Relaxed], scratch: PathBuf::new(), stop, progress: &mut reported };
    let mut seen = Vec::new();
    let cases = measure([&MEASURED, &TROUBLED, &LEFT_OUT].into_iter(), &mut sampling, |cases| {
        seen.push(cases.len());
    });
    // A report can be written after each case.
    assert_eq!(seen, [1, 2, 3]);
    let outcomes: Vec<_> = cases.iter().map(Case::outcome).collect();
    assert_eq!(outcomes, [Outcome::Failed, Outcome::Failed, Outcome::LeftOut]);
    assert!(!held(&cases, 3) && held(&cases[2..], 1) && !held(&cases[2..], 2), "exit code");
    let head = Head::now("graintrain verify".into(), 4);
    for text in [table(&cases), markdown(&head, &cases), html(&head, &cases)] {
        assert!(text.contains("3 cases, 2 failed, 1 left out; 3 rows, 2 failed"), "{text}");
        assert!(
            text.contains("3 of 10 solves did not reach their tolerance")
                && text.contains("left out: invented")
        );
    }
    let page = html(&head, &cases);
    assert!(page.contains("Nothing is &lt; done.") && page.contains("algebra: one is one"));
    assert!(page.contains("graintrain verify") && page.contains("3 of 4 cases measured so far"));
    assert!(!page.contains("http") && !page.contains("src="), "the page needs nothing else");
    roxmltree::Document::parse(page.trim_start_matches("<!DOCTYPE html>")).unwrap();
    assert!(markdown(&head, &cases).contains("a \\| number"));
    let rows = csv(&cases);
    let rows: Vec<Vec<&str>> = rows.lines().map(|line| line.split(',').collect()).collect();
    assert!(rows.iter().all(|row| row.len() == rows[0].len()), "{rows:?}");
    let verdicts: Vec<&str> = rows.iter().map(|row| row[row.len() - 1]).collect();
    assert_eq!(verdicts, ["verdict", "passed", "FAILED", "FAILED", "left out: invented"]);
}

/// `docs/verification.csv` has the columns and the cases of this program, all passed. (Packed crates have no
/// `docs`.)
#[test]
fn the_table_of_the_notebook_is_that_of_tier_a() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/verification.csv");
    let Ok(text) = std::fs::read_to_string(path) else { return };
    assert_eq!(text.lines().next(), csv(&[]).lines().next());
    let mut ids: Vec<&str> = text.lines().skip(1).filter_map(|line| line.split(',').next()).collect();
    let mut expected: Vec<&str> = tier_a().map(|case| case.id).collect();
    // Cases of one number follow each other.
    ids.dedup();
    expected.dedup();
    assert_eq!(ids, expected);
    assert!(text.lines().skip(1).all(|line| line.ends_with(",passed")));
}

#[test]
fn a_stop_leaves_out_the_case_under_way() {
    static STOPPED: Definition = INVENTED;
    let mut reported = |_: &str| {};
    let stop = Arc::new(AtomicBool::new(true));
    let mut sampling =
        Sampling { n: 2, models: vec![Relaxed], scratch: PathBuf::new(), stop, progress: &mut reported };
    assert!(measure([&STOPPED].into_iter(), &mut sampling, |_| {}).is_empty());
}
