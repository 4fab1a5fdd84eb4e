//! A problem with eight parameters: heat through a wall of eight layers, each of conductivity 0.5 to 2. The
//! temperature in the middle as a train over all 16^8 combinations from some of them, then its mean, its
//! spread and the worst case, without solving again.
//!
//! `cargo run --release -p graintrain-tt --example parametric`

use graintrain_tt::cross::{CrossSettings, CrossStatus, Function, cross};
use graintrain_tt::{TtError, TtVector};

const LAYERS: usize = 8;
const VALUES: usize = 16;
/// Cells per layer.
const CELLS: usize = 8;

fn conductivity(i: usize) -> f64 {
    0.5 * 4f64.powf((i as f64 + 0.5) / VALUES as f64)
}

/// -(k u')' = 1 with u = 0 at both ends by finite volumes: one tridiagonal solve per combination; u in the
/// middle.
fn middle(index: &[usize]) -> f64 {
    let n = LAYERS * CELLS;
    let h = 1.0 / n as f64;
    let k = |cell: usize| conductivity(index[cell / CELLS]);
    // Between cells the harmonic mean; half a cell to the ends.
    let face = |left: usize| 2.0 * k(left) * k(left + 1) / (k(left) + k(left + 1)) / (h * h);
    let (mut upper, mut rest) = (vec![0.0; n], vec![0.0; n]);
    for i in 0..n {
        let left = if i > 0 { face(i - 1) } else { 2.0 * k(0) / (h * h) };
        let right = if i + 1 < n { face(i) } else { 2.0 * k(n - 1) / (h * h) };
        let (before, known) = if i > 0 { (upper[i - 1], rest[i - 1]) } else { (0.0, 0.0) };
        let pivot = left + right - if i > 0 { left * before } else { 0.0 };
        upper[i] = right / pivot;
        rest[i] = (1.0 + if i > 0 { left * known } else { 0.0 }) / pivot;
    }
    for i in (0..n - 1).rev() {
        rest[i] += upper[i] * rest[i + 1];
    }
    0.5 * (rest[n / 2 - 1] + rest[n / 2])
}

fn main() -> Result<(), TtError> {
    let modes = [VALUES; LAYERS];
    let settings = CrossSettings { tolerance: 1e-6, ..Default::default() };
    let (u, report) = cross(&Function::new(&modes, middle), None, &[], &settings)?;
    println!("{u}");
    println!(
        "{:?} after {} of {:.1e} solves, error at fresh points {:.1e}",
        report.status,
        report.evaluations,
        u.num_entries(),
        report.sampled_error.unwrap_or(f64::NAN)
    );
    assert_eq!(report.status, CrossStatus::Converged);

    let weight = u.num_entries();
    let mean = u.sum() / weight;
    let spread = (u.dot(&u)? / weight - mean * mean).sqrt();
    // Against plain sampling of the problem itself, which knows the mean to spread / sqrt(count).
    let uniform =
        TtVector::constant(&modes, 1.0)?.sample(graintrain_tt::extremes::Density::Entries, 20_000, 1)?;
    let sampled = uniform.chunks_exact(LAYERS).map(middle).sum::<f64>() / 20_000.0;
    println!("mean {mean:.6} (20000 samples: {sampled:.6}), spread {spread:.6}");
    assert!((mean - sampled).abs() < 5.0 * spread / 20_000f64.sqrt());

    let extremes = u.extremes(20_000)?;
    let (worst, best) = (&extremes.largest, &extremes.smallest);
    println!(
        "warmest {:.6} at {:?} (none above {:.6}), coldest {:.6} at {:?}",
        worst.value, worst.index, worst.bound, best.value, best.index
    );
    // All layers as bad as they can be, and as good.
    assert!(
        (worst.value - middle(&[0; LAYERS])).abs() < 1e-4
            && (best.value - middle(&[VALUES - 1; LAYERS])).abs() < 1e-4
    );
    Ok(())
}
