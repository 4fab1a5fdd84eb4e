//! The peak memory of a TT-SVD (alone in its process: the peak is that of the process).

use graintrain_tt::{Truncation, TtVector};

/// Peak resident memory of this process in bytes; none where the system does not tell.
fn peak() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<f64>().ok().map(|kilobytes| kilobytes * 1024.0)
}

#[test]
fn a_tt_svd_needs_a_fifth_of_its_input_beside_it() {
    // sum over k of cos(a_k j) with 10 frequencies: rank 20, made in place.
    let full: Vec<f64> =
        (0..1usize << 24).map(|j| (1..=10).map(|k| (j as f64 * 1e-6 * k as f64).cos()).sum()).collect();
    let input = 8.0 * full.len() as f64;
    let Some(before) = peak() else { return };
    let (found, report) = TtVector::from_full(&full, &[2; 24], &Truncation::to(1e-6)).unwrap();
    let more = peak().unwrap() - before;
    println!("peak {:.2} of the input before, {:.3} more for the TT-SVD", before / input, more / input);
    assert!(found.max_rank() <= 20 && report.error < 1e-6);
    assert!(before + more <= 1.25 * input && more <= 0.2 * input, "{} {}", before / input, more / input);
}
