//! What `Converged` is worth: functions with everything that defeats a sample (kinks, steps, balls, needles),
//! held against all of their entries.

use graintrain_tt::cross::{
    CrossReport, CrossSettings, CrossStatus, Function, cross, ends_of_modes, sub_grid,
};

type Entry = fn(&[usize]) -> f64;

/// A function on a grid that is small enough to be looked at entry by entry.
struct Case {
    name: &'static str,
    modes: Vec<usize>,
    entry: Entry,
    /// Needles on less than one entry in a thousand: no sample of this size has to see them.
    invisible: bool,
}

fn total(index: &[usize]) -> f64 {
    index.iter().sum::<usize>() as f64
}

/// The number with these binary digits, fine to coarse.
fn number(index: &[usize]) -> f64 {
    index.iter().enumerate().map(|(k, i)| (i << k) as f64).sum()
}

/// Squared distance from a centre with coordinates c.
fn radius(index: &[usize], c: f64) -> f64 {
    index.iter().map(|&i| (i as f64 - c).powi(2)).sum()
}

/// A number without pattern.
fn hash(index: &[usize]) -> u64 {
    let n = index
        .iter()
        .fold(0x5851_F42Du64, |n, &i| (n ^ i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(23));
    n ^ (n >> 29)
}

fn one_if(yes: bool) -> f64 {
    f64::from(yes)
}

fn cases() -> Vec<Case> {
    let visible = |name, modes: Vec<usize>, entry| Case { name, modes, entry, invisible: false };
    let hidden = |name, modes: Vec<usize>, entry| Case { name, modes, entry, invisible: true };
    vec![
        // Smooth.
        visible("reciprocal 16^4", vec![16; 4], |i| 1.0 / (1.0 + total(i))),
        visible("reciprocal 7^6", vec![7; 6], |i| 1.0 / (1.0 + total(i))),
        visible("gaussian 10^5", vec![10; 5], |i| (-radius(i, 4.3) / 20.0).exp()),
        visible("coupled gaussian 12^4", vec![12; 4], |i| (-(total(i) - 20.0).powi(2) / 50.0).exp()),
        visible("root 16^4", vec![16; 4], |i| (1.0 + radius(i, 0.0)).sqrt()),
        visible("newton 12^4", vec![12; 4], |i| 1.0 / (0.3 + radius(i, 5.5)).sqrt()),
        visible("logarithm 2^16", vec![2; 16], |i| (2.0 + number(i)).ln()),
        visible("runge 2^16", vec![2; 16], |i| 1.0 / (1.0 + 25.0 * (number(i) / 32768.0 - 1.0).powi(2))),
        visible("chirp 2^15", vec![2; 15], |i| (number(i) * number(i) * 1e-7).cos()),
        visible("root at zero 2^16", vec![2; 16], |i| number(i).sqrt()),
        visible("cosine of product 9^4", vec![9; 4], |i| {
            i.iter().map(|&i| 1.0 + 0.1 * i as f64).product::<f64>().cos()
        }),
        visible("rosenbrock 13^5", vec![13; 5], |i| {
            let x = |k: usize| i[k] as f64 / 3.0 - 2.0;
            (0..4).map(|k| 100.0 * (x(k + 1) - x(k) * x(k)).powi(2) + (1.0 - x(k)).powi(2)).sum()
        }),
        // Kinks.
        visible("abs 8^6", vec![8; 6], |i| (total(i) - 20.3).abs()),
        visible("abs 16^4", vec![16; 4], |i| (total(i) - 27.7).abs()),
        visible("abs 2^16", vec![2; 16], |i| (number(i) - 20000.3).abs()),
        visible("abs off centre 8^6", vec![8; 6], |i| (total(i) - 9.5).abs()),
        visible("ramp 10^5", vec![10; 5], |i| (total(i) - 30.5).max(0.0)),
        visible("maximum 12^4", vec![12; 4], |i| i.iter().copied().max().unwrap_or(0) as f64),
        visible("minimum 8^5", vec![8; 5], |i| i.iter().copied().min().unwrap_or(0) as f64),
        visible("distance 15^4", vec![15; 4], |i| {
            (i[0] as f64 - i[2] as f64).abs() + (i[1] as f64 - i[3] as f64).abs()
        }),
        visible("cone 10^5", vec![10; 5], |i| radius(i, 4.0).sqrt()),
        visible("abs of sine 2^16", vec![2; 16], |i| (number(i) * 3e-4).sin().abs()),
        // Steps.
        visible("step 16^4", vec![16; 4], |i| one_if(total(i) > 30.5)),
        visible("step 8^6", vec![8; 6], |i| one_if(total(i) > 21.5)),
        visible("early step 16^4", vec![16; 4], |i| one_if(total(i) > 12.5)),
        visible("step in one index 16^4", vec![16; 4], |i| one_if(i[1] > 6)),
        visible("step 2^16", vec![2; 16], |i| one_if(number(i) > 23456.5)),
        visible("slanted step 16^4", vec![16; 4], |i| {
            one_if(i[0] as f64 + 2.3 * i[1] as f64 - 1.7 * i[2] as f64 + 0.6 * i[3] as f64 > 16.0)
        }),
        visible("step times smooth 16^4", vec![16; 4], |i| one_if(total(i) > 25.5) / (1.0 + radius(i, 3.0))),
        visible("stairs 16^4", vec![16; 4], |i| (total(i) / 7.0).floor()),
        visible("sign of a wave 2^14", vec![2; 14], |i| (number(i) * 2e-3).sin().signum()),
        visible("small step on smooth 10^5", vec![10; 5], |i| {
            1.0 / (1.0 + total(i)) + 1e-3 * one_if(total(i) > 20.5)
        }),
        // Balls.
        visible("ball 12^6", vec![12; 6], |i| one_if(radius(i, 5.5) < 40.0)),
        visible("ball 16^4", vec![16; 4], |i| one_if(radius(i, 7.3) < 50.0)),
        visible("small ball 16^4", vec![16; 4], |i| one_if(radius(i, 7.3) < 12.0)),
        visible("ball 32^3", vec![32; 3], |i| one_if(radius(i, 15.0) < 140.0)),
        visible("ball in a corner 10^5", vec![10; 5], |i| one_if(radius(i, 0.0) < 60.0)),
        visible("shell 14^4", vec![14; 4], |i| one_if((radius(i, 6.5) - 40.0).abs() < 15.0)),
        visible("ellipsoid 12^5", vec![12; 5], |i| {
            one_if(
                i.iter().enumerate().map(|(k, &i)| (k + 1) as f64 * (i as f64 - 5.0).powi(2)).sum::<f64>()
                    < 90.0,
            )
        }),
        visible("smooth ball 12^5", vec![12; 5], |i| 1.0 / (1.0 + ((radius(i, 5.5) - 30.0) / 2.0).exp())),
        // Needles.
        hidden("one needle 16^4", vec![16; 4], |i| 1.0 + 1e3 * one_if(i == [3, 7, 1, 12])),
        hidden("one needle 8^6", vec![8; 6], |i| {
            1.0 / (1.0 + total(i)) + 10.0 * one_if(i == [3, 7, 1, 2, 0, 5])
        }),
        hidden("one needle 2^16", vec![2; 16], |i| 1.0 + 100.0 * one_if(number(i) == 12345.0)),
        hidden("needles, 1 in 20000, 8^6", vec![8; 6], |i| {
            1.0 + 30.0 * one_if(hash(i).is_multiple_of(20000))
        }),
        hidden("needles, 1 in 4000, 8^6", vec![8; 6], |i| 1.0 + 30.0 * one_if(hash(i).is_multiple_of(4000))),
        visible("needles, 1 in 800, 10^5", vec![10; 5], |i| 1.0 + 10.0 * one_if(hash(i).is_multiple_of(800))),
        visible("needles, 1 in 200, 8^6", vec![8; 6], |i| 1.0 + 10.0 * one_if(hash(i).is_multiple_of(200))),
        visible("line of needles 16^4", vec![16; 4], |i| 1.0 + 10.0 * one_if(i[0] == 3 && i[2] == 5)),
    ]
}

/// All entries, first index fastest.
fn all_entries(case: &Case) -> Vec<f64> {
    let mut index = vec![0; case.modes.len()];
    (0..case.modes.iter().product())
        .map(|_| {
            let value = (case.entry)(&index);
            for (digit, &n) in index.iter_mut().zip(&case.modes) {
                *digit += 1;
                if *digit < n {
                    break;
                }
                *digit = 0;
            }
            value
        })
        .collect()
}

/// Relative l2 error over all entries.
fn distance(full: &[f64], exact: &[f64]) -> f64 {
    let (mut difference, mut size) = (0.0, 0.0);
    for (a, b) in full.iter().zip(exact) {
        difference += (a - b).powi(2);
        size += b * b;
    }
    (difference / size).sqrt()
}

/// What one run claimed, and what is true.
struct Run {
    name: &'static str,
    tolerance: f64,
    seed: u64,
    invisible: bool,
    truth: f64,
    report: CrossReport,
}

impl Run {
    fn is_false(&self) -> bool {
        self.report.status == CrossStatus::Converged && self.truth > 3.0 * self.tolerance
    }
}

impl std::fmt::Display for Run {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let report = &self.report;
        write!(
            f,
            "{:<28} {:e} {} {:?} true {:.1e} ",
            self.name, self.tolerance, self.seed, report.status, self.truth
        )?;
        let (error, bound) = (report.error().unwrap_or(f64::NAN), report.upper_bound.unwrap_or(f64::NAN));
        write!(f, "measured {error:.1e} bound {bound:.1e} points {} ", report.points)?;
        let rank = report.ranks.iter().max().copied().unwrap_or(0);
        write!(f, "rank {rank} sweeps {} evaluations {}", report.sweeps, report.evaluations)
    }
}

/// Every case with these tolerances and seeds.
fn survey(settings: &[(f64, u64)]) -> Vec<Run> {
    let mut runs = Vec::new();
    for case in cases() {
        let exact = all_entries(&case);
        for &(tolerance, seed) in settings {
            let source = Function::new(&case.modes, case.entry);
            let settings = CrossSettings { tolerance, seed, ..Default::default() };
            let (train, report) = cross(&source, None, &[], &settings).unwrap();
            let truth = distance(&train.to_full().unwrap(), &exact);
            let Case { name, invisible, .. } = case;
            let run = Run { name, tolerance, seed, invisible, truth, report };
            println!("{run}");
            runs.push(run);
        }
    }
    runs
}

fn all_pairs(tolerances: &[f64], seeds: &[u64]) -> Vec<(f64, u64)> {
    tolerances.iter().flat_map(|&tolerance| seeds.iter().map(move |&seed| (tolerance, seed))).collect()
}

/// Every tolerance with a seed of its own: a third of all pairs, which take the time of all other tests of
/// the crate together.
#[test]
fn nothing_visible_is_claimed_that_is_not_so() {
    hold(&survey(&[(1e-3, 1), (1e-6, 2), (1e-9, 3)]));
}

#[test]
#[ignore = "a minute: the same cases with all seeds"]
fn nor_with_every_seed() {
    hold(&survey(&all_pairs(&[1e-3, 1e-6, 1e-9], &[1, 2, 3])));
}

/// No visible error is claimed away, words are what the numbers say, and bounds hold, at no more than so many
/// evaluations.
fn hold(runs: &[Run]) {
    let count = runs.len() as f64;
    let visible = || runs.iter().filter(|run| !run.invisible);
    let false_claims: Vec<String> = visible().filter(|run| run.is_false()).map(Run::to_string).collect();
    assert!(false_claims.is_empty(), "{false_claims:#?}");
    for run in runs {
        // The status is what the measured error and its bound say, both ways.
        let report = &run.report;
        let met = report.error().is_some_and(|error| error <= run.tolerance);
        let bounded = report.upper_bound.is_some_and(|bound| bound < 1.0) && report.nonzeros >= 10;
        assert_eq!(report.status == CrossStatus::Converged, met && (report.complete || bounded), "{run}");
        if run.report.complete {
            let measured = run.report.sampled_error.unwrap();
            assert!((measured - run.truth).abs() <= 1e-6 * run.truth + 1e-13, "{run}");
            assert_eq!(run.report.upper_bound, run.report.sampled_error, "{run}");
        }
    }
    // The bound holds in 95 of 100 runs (needles beyond the size of any entry read are not covered by it).
    let bounded = visible().filter(|run| run.report.upper_bound.is_some()).count();
    let held = visible()
        .filter(|run| {
            run.report.upper_bound.is_some_and(|bound| run.truth <= bound + run.report.floor + 1e-14)
        })
        .count();
    println!("bound held in {held} of {bounded}");
    assert!(bounded as f64 > 0.88 * count && held as f64 >= 0.98 * bounded as f64, "{held} of {bounded}");
    let claimed = runs.iter().filter(|run| run.report.status == CrossStatus::Converged).count();
    let invisible = runs.iter().filter(|run| run.is_false()).count();
    let evaluations: usize = runs.iter().map(|run| run.report.evaluations).sum();
    println!("{claimed} of {} converged, {invisible} false (needles), {evaluations} evaluations", runs.len());
    assert!(claimed as f64 >= 0.85 * count, "{claimed}");
    // Sample and guide drawn once for all sweeps read 30 578 074 entries in 432 runs (and claimed 31 visible
    // errors away).
    assert!((evaluations as f64) < 1.5 * 30_578_074.0 / 432.0 * count, "{evaluations}");
}

/// A bound that does not exclude an error of everything, or hardly a nonzero among the points, is no
/// convergence: the first of these once was called converged with a bound of 3.5e5 and a true error of 0.985.
#[test]
fn a_bound_of_one_or_more_is_no_convergence() {
    let sparse: Entry = |i| one_if(hash(i).is_multiple_of(1000)) * (1.0 + (hash(i) >> 40) as f64);
    let ball: Entry = |i| one_if(radius(i, 1.4) < 2.2);
    let spike: Entry = |i| 1e-4 + one_if(i.iter().sum::<usize>() == 30);
    let cases: [(&str, &[usize], Entry); 3] =
        [("sparse", &[3; 10], sparse), ("ball off centre", &[3; 10], ball), ("spike", &[16; 4], spike)];
    let mut unverified = 0;
    for (name, modes, entry) in cases {
        for seed in 1..6 {
            for samples in [40, 400, 4000] {
                let settings = CrossSettings { seed, samples, ..Default::default() };
                let (_, report) = cross(&Function::new(modes, entry), None, &[], &settings).unwrap();
                let loose = report.upper_bound.is_none_or(|bound| bound >= 1.0) || report.nonzeros < 10;
                println!("{name} {seed} {samples}: {report:?}");
                unverified += usize::from(report.status == CrossStatus::Unverified);
                assert!(report.status != CrossStatus::Converged || report.complete || !loose, "{report:?}");
                // "Every entry read is zero" is said only where it is so.
                assert!(report.status != CrossStatus::ZeroSampled || report.nonzeros == 0, "{report:?}");
            }
        }
    }
    assert!(unverified > 5, "{unverified}");
    // What few points cannot tell, more of them can.
    let corner = Function::new(&[16; 6], |i: &[usize]| 1.0 / (1.0 + total(i)));
    let report = cross(&corner, None, &[], &CrossSettings::default()).unwrap().1;
    assert_eq!(report.status, CrossStatus::Converged, "{report:?}");
}

#[test]
#[ignore = "half a minute: other seeds"]
fn nor_with_other_seeds() {
    let runs = survey(&all_pairs(&[1e-2, 1e-4, 1e-7], &[11, 12, 13, 14, 15, 16]));
    let false_claims: Vec<String> =
        runs.iter().filter(|run| run.is_false() && !run.invisible).map(Run::to_string).collect();
    println!("{} of {} false", false_claims.len(), runs.len());
    assert!(false_claims.len() * 200 <= runs.len(), "{false_claims:#?}");
}

#[test]
fn probes_on_sub_grids_and_ends_find_what_no_random_point_does() {
    // A jump on one corner block of 40^8: one entry in 4e8 is different.
    let modes = [40; 8];
    let corner = |i: &[usize]| 1.0 + 100.0 * one_if(i.iter().all(|&i| i < 3));
    let source = Function::new(&modes, corner);
    let settings = CrossSettings { samples: 200, ..Default::default() };
    let probes = [sub_grid(&modes, 1000).unwrap(), ends_of_modes(&modes).unwrap()].concat();
    let (train, report) = cross(&source, None, &probes, &settings).unwrap();
    // (Without error on all of them; that more entries of this size are elsewhere 200 points do not exclude.)
    assert_eq!(report.status, CrossStatus::Unverified, "{report:?}");
    assert!(report.error().unwrap() < 1e-12 && report.upper_bound.unwrap() >= 1.0, "{report:?}");
    for (point, value) in [([0; 8], 101.0), ([2; 8], 101.0), ([3; 8], 1.0), ([17; 8], 1.0)] {
        assert!((train.entry(&point).unwrap() - value).abs() < 1e-9, "{point:?}");
    }
    // A jump that no pivot sees keeps the claim away as long as a probe sees it.
    let hidden = Function::new(&[2; 30], |i: &[usize]| 1.0 + 1e9 * one_if(number(i) == 123_456_789.0));
    let at: Vec<usize> = (0..30).map(|k| 123_456_789 >> k & 1).collect();
    let settings = CrossSettings { max_rank: 1, ..Default::default() };
    let (_, report) = cross(&hidden, None, &at, &settings).unwrap();
    assert_ne!(report.status, CrossStatus::Converged, "{report:?}");
    assert!(sub_grid(&[], 10).is_err() && sub_grid(&[3, 0], 10).is_err() && ends_of_modes(&[0]).is_err());
    assert_eq!(sub_grid(&[7, 9], 1).unwrap(), [3, 4]);
    assert_eq!(sub_grid(&[3, 2], usize::MAX).unwrap().len(), 12);
}
