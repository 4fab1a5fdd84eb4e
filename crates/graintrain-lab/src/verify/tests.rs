use super::*;

#[test]
fn tier_a_passes() {
    let checks = tier_a(|_| {}).unwrap();
    let failed: Vec<&Check> = checks.iter().filter(|check| check.outcome() != Outcome::Passed).collect();
    assert!(failed.is_empty(), "{failed:#?}");
    for id in ["A1", "A2", "A3", "A4", "A5", "A6", "A7", "A8", "A9", "A10", "A12", "A13", "A15", "A20"] {
        assert!(checks.iter().any(|check| check.id == id), "{id}");
    }
}

#[test]
fn a_wrong_or_missing_number_fails() {
    let uncertain = |measured, error| Check {
        id: "A1",
        what: "a number".into(),
        measured,
        expected: 1.0,
        tolerance: 0.1,
        source: "nowhere",
        error,
    };
    let check = |measured| uncertain(measured, 0.0);
    assert_eq!(check(1.05).outcome(), Outcome::Passed);
    assert_eq!(check(1.2).outcome(), Outcome::Failed);
    assert_eq!(check(f64::NAN).outcome(), Outcome::Failed);
    // An error larger than what is allowed never passes, and fails only what it does not explain.
    assert_eq!(uncertain(1.0, 0.2).outcome(), Outcome::Undecided);
    assert_eq!(uncertain(1.2, 0.08).outcome(), Outcome::Undecided);
    assert_eq!(uncertain(1.6, 0.2).outcome(), Outcome::Failed);
    let text = table(&[check(1.05), check(f64::NAN)]);
    assert!(text.contains("2 checks, 1 failed") && text.matches("FAILED").count() == 1);
}

#[test]
#[ignore = "eight simulations of 2 816 spheres: minutes"]
fn earth_pressure_is_that_of_rankine() {
    let checks = earth_pressure::checks(&Default::default(), |_| {}).unwrap();
    println!("{}", table(&checks));
    assert!(checks.len() == 2 && checks.iter().all(|check| check.outcome() != Outcome::Failed));
}
