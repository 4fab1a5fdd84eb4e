//! Cross interpolation: the train of a function of 12 variables from some of its values, and its integral.
//! 24^12 values could not even be counted one by one. What the method cannot see it does not claim: a needle
//! is missed, and a start at the needle is believed only with a probe.
//!
//! `cargo run --release -p graintrain-tt --example cross_function`

use graintrain_tt::cross::{CrossSettings, Function, cross};
use graintrain_tt::{TtError, TtVector};

fn main() -> Result<(), TtError> {
    let (dimension, points) = (12, 24);
    // exp(-|x|^2 / 2) cos(x_1 + ... + x_12) on [-6, 6]^12; the integral is (2 pi)^6 exp(-6).
    let step = 12.0 / points as f64;
    let coordinate = move |i: usize| -6.0 + step * (i as f64 + 0.5);
    let function = Function::new(&vec![points; dimension], move |index| {
        let (mut squares, mut sum) = (0.0, 0.0);
        for &i in index {
            squares += coordinate(i).powi(2);
            sum += coordinate(i);
        }
        (-0.5 * squares).exp() * sum.cos()
    });
    let settings = CrossSettings { tolerance: 1e-8, ..Default::default() };
    let (train, report) = cross(&function, None, &[], &settings)?;
    println!(
        "{:?} after {} sweeps, {} of {:.1e} values",
        report.status,
        report.sweeps,
        report.evaluations,
        train.num_entries()
    );
    println!(
        "ranks {:?}, error on points it did not choose {:.1e}",
        report.ranks,
        report.error().unwrap_or(f64::NAN)
    );
    let integral = train.sum() * step.powi(dimension as i32);
    let exact = std::f64::consts::TAU.powi(6) * (-6.0_f64).exp();
    println!("integral {integral:.8}, exact {exact:.8}");

    // One value of 1 among 2^20 zeros.
    let needle = [1, 0, 1, 1, 0, 1, 0, 0, 1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 1, 0];
    let haystack = Function::new(&[2; 20], move |index| f64::from(index == needle));
    let start = TtVector::unit(&[2; 20], &needle)?;
    let cases = [
        ("without help", None, &[][..]),
        ("started there", Some(&start), &[]),
        ("probed there", None, &needle),
    ];
    for (name, start, probes) in cases {
        let (train, report) = cross(&haystack, start, probes, &CrossSettings::default())?;
        println!("needle, {name}: {:?}, value found there {}", report.status, train.entry(&needle)?);
    }
    Ok(())
}
