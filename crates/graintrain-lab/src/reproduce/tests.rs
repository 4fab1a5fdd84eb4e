use super::claims::{Verdict, power_law, verdicts};
use super::ledger::Ledger;
use super::physics::Steady;
use super::report::reproduce;
use super::trajectory::Row;
use super::*;

fn small(target: Target, out: &std::path::Path) -> Settings {
    Settings { target, n: 1, steps: Some(24), out: out.to_path_buf(), max_seconds: Some(0.1) }
}

/// A result without its seconds, which differ from run to run.
fn without_seconds(results: &Results) -> String {
    let mut text = String::new();
    for (cell, trajectory) in &results.trajectories {
        let rows: Vec<_> =
            trajectory.rows.iter().map(|row| (row.time, row.contacts, row.force, row.residual)).collect();
        text += &format!("{} {:?} {rows:?}\n", cell.key(), trajectory.samples);
    }
    // Only the method that ends long before the time limit: where it stops a solve, the iterate is a matter
    // of time.
    for solve in results.solves.iter().filter(|solve| solve.method == "ipm") {
        text += &format!("{} {} {} {:?}\n", solve.method, solve.contacts, solve.iterations, solve.residual);
    }
    text
}

#[test]
fn a_killed_reproduction_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    let run = |out: &std::path::Path, stop: &Arc<AtomicBool>, limit: usize| {
        let mut labels = Vec::new();
        let result = measure(&small(Target::Fig10, out), stop, &mut |progress| {
            labels.push(progress.label.clone());
            if progress.done >= limit {
                stop.store(true, Ordering::Relaxed);
            }
        });
        (result, labels)
    };
    make_folder(&whole).unwrap();
    make_folder(&broken).unwrap();
    let never = Arc::new(AtomicBool::new(false));
    let expected = run(&whole, &never, usize::MAX).0.unwrap();
    assert!(!expected.solves.is_empty());

    let stop = Arc::new(AtomicBool::new(false));
    assert!(matches!(run(&broken, &stop, 3).0, Err(ReproduceError::Stopped)));
    let ledger = broken.join("cells.jsonl");
    let before = std::fs::read_to_string(&ledger).unwrap();
    assert!(before.lines().count() >= 2, "{before}");
    // A kill in the middle of a write.
    std::fs::write(&ledger, format!("{before}[\"solve/half a li")).unwrap();
    let (resumed, _) = run(&broken, &Arc::new(AtomicBool::new(false)), usize::MAX);
    assert_eq!(without_seconds(&resumed.unwrap()), without_seconds(&expected));
    let after = std::fs::read_to_string(&ledger).unwrap();
    assert!(after.starts_with(&before), "finished cells are kept to the byte");
    // Once more: nothing is left to do.
    let (again, labels) = run(&broken, &Arc::new(AtomicBool::new(false)), usize::MAX);
    assert_eq!(without_seconds(&again.unwrap()), without_seconds(&expected));
    assert!(!labels.iter().any(|label| label.contains(", step ")), "no step is made again");
    assert_eq!(std::fs::read_to_string(&ledger).unwrap(), after);
}

#[test]
fn a_simulation_that_was_stopped_goes_on_with_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    let simulate = Simulate {
        experiment: Experiment::DirectShear,
        n: 1,
        steps: Some(30),
        variant: Variant::HalfStep,
        seed: 2,
    };
    let seconds =
        |trajectory: &mut Trajectory| trajectory.rows.iter_mut().for_each(|row| row.solve_seconds = 0.0);
    let mut expected = simulate.run(2, &whole, &Arc::default(), |_, _| {}).unwrap();
    assert_eq!(expected.rows.len(), 60, "twice as many steps of half the length");
    let stop: Arc<AtomicBool> = Arc::default();
    let stopped = simulate.run(2, &broken, &stop, |step, _| stop.store(step == 40, Ordering::Relaxed));
    assert!(matches!(stopped, Err(ReproduceError::Stopped)));
    // Another simulation does not take it for its own, whose states are then gone.
    let other = Simulate { seed: 3, steps: Some(2), ..simulate };
    assert_eq!(other.run(0, &broken, &Arc::default(), |_, _| {}).unwrap().rows.len(), 4);
    stop.store(false, Ordering::Relaxed);
    let again = simulate.run(2, &broken, &stop, |step, _| stop.store(step == 40, Ordering::Relaxed));
    assert!(matches!(again, Err(ReproduceError::Stopped)));
    let mut steps = Vec::new();
    let mut found = simulate.run(2, &broken, &Arc::default(), |step, _| steps.push(step)).unwrap();
    assert_eq!(steps, (40..60).collect::<Vec<u64>>());
    seconds(&mut expected);
    seconds(&mut found);
    assert_eq!(found, expected);
    assert!(!broken.join("under-way").exists());
}

#[test]
fn the_report_holds_tables_plots_and_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let settings = small(Target::Fig15, folder.path());
    let report = reproduce(&settings, &Arc::new(AtomicBool::new(false)), &mut |_| {}).unwrap();
    let page = std::fs::read_to_string(&report.page).unwrap();
    for text in
        ["Claims", "Table 3", "Fig. 15", "pdip+ilu", "data:image/png;base64,", "contacts (1)", "time (s)"]
    {
        assert!(page.contains(text), "{text}");
    }
    assert!(!page.contains("src=\"http"), "the page needs no network");
    let words: String = page.split('"').filter(|part| !part.starts_with("data:image")).collect();
    assert!(!words.contains("NaN") && !words.contains("inf "));
    for file in [
        "solves.csv",
        "fig15.svg",
        "direct-shear-n1-relaxed.csv",
        "drafting-n1-speeds.png",
        "drafting-n1-forces.png",
    ] {
        assert!(folder.path().join(file).exists(), "{file}");
    }
    let svg = std::fs::read_to_string(folder.path().join("fig15.svg")).unwrap();
    roxmltree::Document::parse(&svg).unwrap();
    let table = std::fs::read_to_string(folder.path().join("solves.csv")).unwrap();
    let columns = table.lines().next().unwrap().split(',').count();
    assert!(table.lines().count() > 1 && table.lines().all(|line| line.split(',').count() == columns));
}

fn solve(method: &str, contacts: usize, seconds: f64, converged: bool) -> Solve {
    Solve {
        experiment: "sedimentation".into(),
        n: 8,
        step: contacts as u64,
        contacts,
        method: method.into(),
        status: if converged { graintrain_ccp::Status::Converged } else { graintrain_ccp::Status::Stopped },
        iterations: 60,
        residual: Some(1e-4),
        seconds,
        precompute_seconds: 0.3 * seconds,
        apply_seconds: 0.7 * seconds,
        inner_mean: 10.0,
        unconverged: 0.0,
        figures: [("rank_matrix", 4.6), ("rank_inverse", 4.4), ("compression_error", 0.7)]
            .map(|(name, value)| (name.to_string(), value))
            .into(),
    }
}

fn verdict(results: &Results, place: &str, word: &str) -> (Verdict, String) {
    let claims = verdicts(results);
    let claim = claims
        .iter()
        .find(|claim| claim.place == place && claim.statement.contains(word))
        .expect("the claim");
    (claim.verdict, claim.evidence.clone())
}

#[test]
fn verdicts_follow_the_numbers() {
    let mut results = Results::default();
    let word = "(pdip+tt-cross) a solve";
    assert_eq!(verdict(&results, "Table 3", "").0, Verdict::Open);
    // The literal recipe is 20 times faster at 40 000 contacts.
    for contacts in [5_000, 10_000, 40_000] {
        results.solves.push(solve("pdip+ilu", contacts, 1e-3 * contacts as f64, true));
        results.solves.push(solve("pdip+tt-cross", contacts, 5e-5 * contacts as f64, true));
    }
    assert_eq!(verdict(&results, "Fig. 10", word).0, Verdict::Holds);
    // Small ranks with a large error do not make the matrix compressible.
    let (ranks, evidence) = verdict(&results, "Table 3", "");
    assert_eq!(ranks, Verdict::Fails);
    assert!(evidence.contains("0.7"), "{evidence}");
    for solve in &mut results.solves {
        solve.figures.insert("compression_error".into(), 0.009);
    }
    assert_eq!(verdict(&results, "Table 3", "").0, Verdict::Holds);
    // It grows in proportion to the contacts here: not independent of them.
    let (growth, evidence) = verdict(&results, "Fig. 11", "");
    assert_eq!(growth, Verdict::Fails);
    assert!(evidence.contains("power 1 "), "{evidence}");
    // Slower than ILU.
    results.solves.iter_mut().filter(|s| s.method == "pdip+tt-cross").for_each(|s| s.seconds *= 100.0);
    assert_eq!(verdict(&results, "Fig. 10", word).0, Verdict::Fails);
    // Never converged.
    results
        .solves
        .iter_mut()
        .filter(|s| s.method == "pdip+tt-cross")
        .for_each(|s| s.status = graintrain_ccp::Status::Stalled);
    let (none, evidence) = verdict(&results, "Fig. 10", word);
    assert_eq!(none, Verdict::Fails);
    assert!(evidence.contains("on 0 of its 3 problems"), "{evidence}");
    // Too small to tell.
    results.solves = vec![solve("pdip+ilu", 2_000, 1.0, true), solve("pdip+tt-cross", 2_000, 0.1, true)];
    assert_eq!(verdict(&results, "Fig. 10", word).0, Verdict::Open);
}

#[test]
fn a_solve_that_did_not_converge_bounds_the_ratio() {
    let results = Results {
        solves: vec![solve("pdip+ilu", 30_000, 50.0, false), solve("ipm", 30_000, 1.0, true)],
        ..Results::default()
    };
    let (verdict, evidence) = verdict(&results, "this project", "fastest");
    assert_eq!(verdict, Verdict::Holds);
    assert!(evidence.contains("at least 50"), "{evidence}");
}

#[test]
fn a_lower_bound_below_the_goal_decides_nothing() {
    let results = Results {
        solves: vec![solve("pdip+ilu", 30_000, 5.0, false), solve("ipm", 30_000, 1.0, true)],
        ..Results::default()
    };
    assert_eq!(verdict(&results, "this project", "fastest").0, Verdict::Open);
}

#[test]
fn a_fall_back_is_not_credited_to_trains() {
    let mut results = Results {
        solves: vec![solve("pdip+ilu", 30_000, 50.0, true), solve("pdip+tt", 30_000, 1.0, true)],
        ..Results::default()
    };
    let word = "(pdip+tt) a solve";
    results.solves[1].figures.insert("train_active".into(), 1.0);
    assert_eq!(verdict(&results, "Fig. 10", word).0, Verdict::Holds);
    results.solves[1].figures.insert("train_active".into(), 0.0);
    let (idle, evidence) = verdict(&results, "Fig. 10", word);
    assert!(idle == Verdict::Fails && evidence.contains("fall-back"), "{evidence}");
    // A larger problem on which it fails is not forgotten.
    results.solves[1].figures.insert("train_active".into(), 1.0);
    results.solves.push(solve("pdip+ilu", 60_000, 50.0, true));
    results.solves.push(solve("pdip+tt", 60_000, 100.0, false));
    assert_eq!(verdict(&results, "Fig. 10", word).0, Verdict::Fails);
}

#[test]
fn iterations_are_compared_on_the_same_problem() {
    let mut results = Results::default();
    results.solves.push(solve("pdip+ilu", 40_000, 1.0, true));
    results.solves.push(solve("pdip+tt-cross", 30_000, 1.0, true));
    assert_eq!(verdict(&results, "Fig. 12", "").0, Verdict::Open);
    results.solves.push(solve("pdip+ilu", 30_000, 1.0, true));
    // As many as the train needs: ten each.
    assert_eq!(verdict(&results, "Fig. 12", "").0, Verdict::Fails);
    results.solves.last_mut().unwrap().inner_mean = 70.0;
    assert_eq!(verdict(&results, "Fig. 12", "").0, Verdict::Holds);
    results.solves[1].unconverged = 0.6;
    assert_eq!(verdict(&results, "Fig. 12", "").0, Verdict::Fails);
    // Few iterations without a train are not the train's.
    results.solves[1].unconverged = 0.0;
    results.solves[1].figures.insert("inversion_diverged".into(), 0.75);
    let (replaced, evidence) = verdict(&results, "Fig. 12", "");
    assert!(replaced == Verdict::Fails && evidence.contains("In 75 % of"), "{evidence}");
}

#[test]
fn reuse_is_compared_with_precomputation_from_nothing() {
    let row = ReuseRow {
        step: 1,
        contacts: 5_000,
        first: [0.1, 12.0],
        total: [1.0, 4.0],
        iterations: [20, 20],
        error: [Some(0.02), Some(0.01)],
        active: [None, None],
    };
    let measured = |row: ReuseRow| {
        let rows = vec![row.clone(), row];
        let results = Results { reuse: vec![("pdip+tt-cross".into(), rows)], ..Results::default() };
        verdict(&results, "Fig. 8", "pdip+tt-cross")
    };
    let (twelve, evidence) = measured(row.clone());
    assert!(twelve == Verdict::Holds && evidence.contains("12 times"), "{evidence}");
    assert_eq!(measured(ReuseRow { total: [4.0, 4.0], ..row.clone() }).0, Verdict::Fails);
    assert_eq!(measured(ReuseRow { iterations: [1, 1], ..row.clone() }).0, Verdict::Open);
    assert_eq!(measured(ReuseRow { active: [Some(0.0), None], ..row }).0, Verdict::Open);
}

/// A simulation in which the tool moves a metre at constant speed under a given force.
fn pushed(
    experiment: Experiment,
    variant: Variant,
    seed: u64,
    force: impl Fn(usize) -> f64,
) -> (Simulate, Trajectory) {
    let rows = (0..60).map(|k| Row {
        time: 0.1 * k as f64,
        contacts: 10,
        loaded: 10,
        persistent: 1.0,
        residual: 1e-4,
        solve_seconds: 0.1,
        penetration: 0.0,
        kinetic_energy: 1.0,
        force: [-force(k), 0.0, -1000.0],
        torque: [0.0; 3],
        place: [k as f64 / 59.0, 0.0, 0.0],
        velocity: [0.17, 0.0, 0.0],
        press: None,
        weight_below: Some(200.0),
        momentum_error: 0.0,
    });
    let trajectory = Trajectory { bodies: 10, step: 0.1, samples: vec![], rows: rows.collect() };
    (Simulate { experiment, n: 4, steps: None, variant, seed }, trajectory)
}

#[test]
fn forces_are_steady_only_where_their_errors_allow_it() {
    let shear = Experiment::DirectShear;
    let measured = |changes: [f64; 3]| {
        let mut results = Results::default();
        for (seed, change) in (1..).zip(changes) {
            // The first third is mobilisation and does not count.
            let force = move |k: usize| if k < 20 { 0.0 } else { 320.0 + seed as f64 };
            results.trajectories.push(pushed(shear, Variant::Paper, seed, force));
            results.trajectories.push(pushed(shear, Variant::HalfStep, seed, move |k| change * force(k)));
        }
        (
            verdict(&results, "this project", "half the time step"),
            verdict(&results, "this project", "friction angle"),
        )
    };
    let ((steady, evidence), (angle, angle_evidence)) = measured([1.01, 1.02, 1.0]);
    assert!(steady == Verdict::Holds && evidence.contains("1 +- 0.577 %"), "{evidence}");
    // 322 N over 1000 N less the 200 N that lie below the plane.
    assert!(angle == Verdict::Holds && angle_evidence.contains("21.9 degrees"), "{angle_evidence}");
    assert_eq!(measured([1.10, 1.11, 1.09]).0.0, Verdict::Fails);
    assert_eq!(measured([1.3, 0.7, 1.0]).0.0, Verdict::Open);
    assert_eq!(measured([1.06, 1.10, 1.02]).0.0, Verdict::Open);
}

#[test]
fn power_laws_and_block_errors_are_found() {
    let points: Vec<[f64; 2]> = [1.0, 10.0, 100.0].iter().map(|&x: &f64| [x, 3.0 * x.powf(1.4)]).collect();
    let [factor, exponent] = power_law(&points).unwrap();
    assert!((factor - 3.0).abs() < 1e-9 && (exponent - 1.4).abs() < 1e-9);
    assert!(power_law(&points[..2]).is_none());
    assert!(Steady::of(&[1.0; 7]).is_none());
    let constant = Steady::of(&[2.0; 16]).unwrap();
    assert_eq!((constant.mean, constant.error), (2.0, 0.0));
    // Eight blocks of 0 and 1 alternating: mean 1/2, variance of the blocks 2/7.
    let blocks: Vec<f64> = (0..64).map(|k| f64::from(k / 8 % 2)).collect();
    let steady = Steady::of(&blocks).unwrap();
    assert!((steady.mean - 0.5).abs() < 1e-12 && (steady.error - (2.0 / 7.0_f64 / 8.0).sqrt()).abs() < 1e-12);
    // Over lattices the spread among them counts, whatever each says of itself: (1, 2, 3) has 2 +- 1 /
    // sqrt(3).
    let of = |mean| Steady { mean, error: 7.0 };
    assert!(Steady::over(std::iter::empty()).is_none());
    assert_eq!(Steady::over([of(1.0)].into_iter()), Some(of(1.0)));
    let three = Steady::over([1.0, 2.0, 3.0].into_iter().map(of)).unwrap();
    assert!((three.mean - 2.0).abs() < 1e-12 && (three.error - (1.0 / 3.0_f64).sqrt()).abs() < 1e-12);
}

#[test]
fn the_ledger_keeps_whole_lines_only() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cells.jsonl");
    let mut ledger = Ledger::open(&path).unwrap();
    ledger.put("a", &1.5).unwrap();
    ledger.put("b", &vec![0.1, 1e-300]).unwrap();
    drop(ledger);
    let text = std::fs::read_to_string(&path).unwrap();
    // A line that cannot be read costs itself alone.
    std::fs::write(&path, format!("[\"a\", nonsense\n{text}")).unwrap();
    let ledger = Ledger::open(&path).unwrap();
    assert_eq!((ledger.damaged, ledger.get::<f64>("a")), (1, Some(1.5)));
    assert!(matches!(Ledger::open(&path), Err(ReproduceError::Busy { .. })), "one process at a time");
    drop(ledger);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
    assert!(std::fs::read_to_string(folder.path().join("cells.jsonl.damaged")).unwrap().contains("nonsense"));
    for cut in 0..=text.len() {
        std::fs::write(&path, &text[..cut]).unwrap();
        let mut ledger = Ledger::open(&path).unwrap();
        let first = text.find('\n').unwrap() + 1;
        assert_eq!(ledger.get::<f64>("a"), (cut >= first).then_some(1.5));
        assert_eq!(ledger.get::<Vec<f64>>("b"), (cut == text.len()).then(|| vec![0.1, 1e-300]));
        ledger.put("c", &"later").unwrap();
        drop(ledger);
        assert_eq!(Ledger::open(&path).unwrap().get::<String>("c").as_deref(), Some("later"));
    }
}

#[test]
fn every_setting_of_the_literal_recipe_exists() {
    for (row, column) in (0..9).map(|k| (k / 3, k % 3)) {
        assert!(solves::exists(&literal_method(row, column)));
    }
    for name in ["pdip+tt-cross@2,10", "pdip+tt-cross@1e-2", "pdip+tt-cross@1e-2,0", "pdip+tt@1e-2,10"] {
        assert!(!solves::exists(name), "{name}");
    }
}
