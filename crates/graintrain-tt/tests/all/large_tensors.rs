//! TT-SVD of tensors that are large enough for sketches: the same promises as for small ones, by entries,
//! whatever the matrix in the middle looks like; memory and bits.

use graintrain_tt::{Truncation, TtError, TtVector};

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn distance(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt() / norm(y)
}

/// Numbers in [-1, 1) of a fixed sequence.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// A train of this rank as full vector of norm 1, with noise of the given size.
fn low_rank(modes: &[usize], rank: usize, noise: f64, seed: u64) -> Vec<f64> {
    let train = TtVector::random(modes, rank, seed).unwrap();
    let mut full = train.scale(1.0 / train.norm()).to_full().unwrap();
    let (mut source, size) = (Noise(seed), noise * (3.0 / full.len() as f64).sqrt());
    full.iter_mut().for_each(|x| *x += size * source.next());
    full
}

fn check(full: &[f64], modes: &[usize], tolerance: f64, most: usize) {
    let (train, report) = TtVector::from_full(full, modes, &Truncation::to(tolerance)).unwrap();
    let truth = distance(&train.to_full().unwrap(), full);
    assert!(truth <= tolerance + report.floor, "{truth:e} > {tolerance:e}: {report:?}");
    assert!(report.error >= truth - 0.01 * tolerance - report.floor, "{truth:e}: {report:?}");
    assert!(
        report.error <= tolerance * 1.000001 + report.floor
            && report.error <= truth + 0.01 * tolerance + 4e-8,
        "{truth:e}: {report:?}"
    );
    assert!(train.max_rank() <= most, "{:?}, {most} expected at {tolerance:e}", train.ranks());
    assert!((report.norm / norm(full) - 1.0).abs() < 1e-12);
}

#[test]
fn errors_and_ranks_are_those_of_small_tensors() {
    for modes in
        [vec![2; 18], vec![2; 20], vec![3; 12], vec![64; 3], vec![7, 90, 2, 11, 30, 3], vec![600, 500]]
    {
        for rank in [1, 5, 31, 60] {
            let full = low_rank(&modes, rank, 1e-10, rank as u64);
            for tolerance in [1e-2, 1e-5, 1e-6, 1e-8] {
                check(&full, &modes, tolerance, rank);
            }
        }
    }
    // Full rank, and tolerances that cut it.
    let mut noise = Noise(3);
    let full: Vec<f64> = (0..1 << 18).map(|_| noise.next()).collect();
    check(&full, &[2; 18], 0.3, 512);
    check(&full, &[64, 64, 64], 1e-7, 64);
    // Singular values that fall slowly past every size of a sketch.
    let mut full = vec![0.0; 1 << 18];
    for k in 0..12u64 {
        let part = low_rank(&[2; 18], 1 << (k / 2), 0.0, k + 1);
        full.iter_mut().zip(&part).for_each(|(sum, x)| *sum += 0.1f64.powi(k as i32) * x);
    }
    for tolerance in [1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 0.0] {
        check(&full, &[2; 18], tolerance, 512);
    }
}

#[test]
fn columns_that_share_a_bucket_are_not_lost() {
    // Nonzeros in few columns of the unfolding in the middle, and in few rows: a sketch may put two of them
    // together.
    for (count, seed) in [(1, 1), (3, 2), (20, 3), (60, 4), (300, 5)] {
        let mut noise = Noise(seed);
        let mut full = vec![0.0; 1 << 20];
        for k in 0..count {
            let column = (((noise.next() + 1.0) * 512.0) as usize).min(1023);
            for i in 0..1024 {
                full[i + 1024 * column] = noise.next() * if k == 0 { 1.0 } else { 1e-3 };
            }
        }
        for tolerance in [1e-2, 1e-6] {
            check(&full, &[2; 20], tolerance, 1024);
        }
        let turned: Vec<f64> = (0..1 << 20).map(|p: usize| full[p / 1024 + 1024 * (p % 1024)]).collect();
        check(&turned, &[2; 20], 1e-6, 1024);
    }
    let mut needle = vec![0.0; 1 << 19];
    needle[123_456] = -3.0;
    check(&needle, &[2; 19], 1e-6, 1);
}

#[test]
fn sizes_of_numbers_do_not_matter_and_what_is_not_finite_is_an_error() {
    let full = low_rank(&[2; 18], 6, 1e-9, 5);
    for scale in [1e-300, 1e-160, 1e160, 1e300] {
        let scaled: Vec<f64> = full.iter().map(|x| x * scale).collect();
        let (train, report) = TtVector::from_full(&scaled, &[2; 18], &Truncation::to(1e-6)).unwrap();
        let back: Vec<f64> = train.to_full().unwrap().iter().map(|x| x / scale).collect();
        assert!(distance(&back, &full) <= 1e-6 && train.max_rank() == 6, "{scale:e} {report:?}");
    }
    let (zero, report) = TtVector::from_full(&vec![0.0; 1 << 18], &[2; 18], &Truncation::to(1e-6)).unwrap();
    assert_eq!((zero.norm(), report.error, zero.max_rank()), (0.0, 0.0, 1));
    for bad in [f64::NAN, f64::INFINITY] {
        let mut full = full.clone();
        full[200_000] = bad;
        let result = TtVector::from_full(&full, &[2; 18], &Truncation::to(1e-6));
        assert!(matches!(result, Err(TtError::Dense { .. })));
    }
    // A cap that binds: the error is reported as it is.
    let (train, report) = TtVector::from_full(&full, &[2; 18], &Truncation::capped(1e-6, 3)).unwrap();
    let truth = distance(&train.to_full().unwrap(), &full);
    assert!(
        train.max_rank() <= 3 && report.capped && (report.error / truth - 1.0).abs() < 1e-3,
        "{truth} {report:?}"
    );
}

#[test]
fn threads_do_not_change_a_bit() {
    let full = low_rank(&[2; 20], 12, 1e-4, 9);
    for tolerance in [1e-2, 1e-6] {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| TtVector::from_full(&full, &[2; 20], &Truncation::to(tolerance)).unwrap().0)
        };
        assert_eq!(with(1), with(3));
    }
}

/// Eigenvectors of A A^T were taken for A with more rows than columns, too: 19 s for 64^3 without low rank.
#[test]
fn full_ranks_cost_no_more_than_their_svd() {
    let (mut source, start) = (Noise(5), std::time::Instant::now());
    let full: Vec<f64> = (0..64usize.pow(3)).map(|_| source.next()).collect();
    check(&full, &[64; 3], 1e-6, 64);
    assert!(start.elapsed().as_secs() < 6, "{:?}", start.elapsed());
}
