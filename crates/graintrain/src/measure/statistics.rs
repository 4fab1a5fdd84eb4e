//! Series in time: where they become steady, their mean, and its error where neighbours resemble each other.

/// Fewer blocks than this tell nothing of their own scatter.
const FEWEST_BLOCKS: usize = 8;

/// Records that are averaged before the search for the steady part (White's MSER-5).
const BATCH: usize = 5;

/// The mean of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// The mean.
    pub value: f64,
    /// Its standard error; NaN where the series is too short to tell.
    pub error: f64,
}

/// The mean of a steady series with its standard error by blocking (Flyvbjerg and Petersen, J. Chem. Phys.
/// 91, 1989): neighbours are averaged again and again, and the largest error over all lengths of blocks that
/// leave at least eight is taken. NaN for an empty series.
pub fn mean(series: &[f64]) -> Mean {
    let value = series.iter().sum::<f64>() / series.len() as f64;
    let mut blocks = series.to_vec();
    let mut error = f64::NAN;
    while blocks.len() >= FEWEST_BLOCKS {
        let n = blocks.len() as f64;
        let middle = blocks.iter().sum::<f64>() / n;
        let variance = blocks.iter().map(|x| (x - middle).powi(2)).sum::<f64>() / (n - 1.0);
        error = error.max((variance / n).sqrt());
        blocks = blocks.chunks_exact(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
    }
    Mean { value, error }
}

/// Index from which a series is steady: what has to be cut off its beginning to make the marginal standard
/// error smallest (MSER-5, K. P. White, 1997). `None` where that would be more than half of it: then it is
/// not known to be steady, or it is too short.
pub fn steady_from(series: &[f64]) -> Option<usize> {
    let batches: Vec<f64> =
        series.chunks_exact(BATCH).map(|batch| batch.iter().sum::<f64>() / BATCH as f64).collect();
    if batches.len() < FEWEST_BLOCKS {
        return None;
    }
    // From the end, sums of x and x^2 about the last value, so that little cancels.
    let origin = *batches.last()?;
    let (mut sum, mut squares, mut best) = (0.0, 0.0, (f64::INFINITY, 0));
    for (k, x) in batches.iter().enumerate().rev() {
        sum += x - origin;
        squares += (x - origin).powi(2);
        let n = (batches.len() - k) as f64;
        let marginal = (squares - sum * sum / n).max(0.0) / (n * n);
        if n >= 2.0 && marginal <= best.0 {
            best = (marginal, k);
        }
    }
    (best.1 <= batches.len() / 2).then_some(best.1 * BATCH)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers in [-1, 1] by a linear congruence.
    fn noise(count: usize) -> Vec<f64> {
        let mut state = 1_u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        (0..count).map(|_| draw()).collect()
    }

    /// Independent numbers: error s / sqrt(n). With x_k = a x_(k-1) + e_k: error s sqrt((1 + a) / (1 - a)) /
    /// sqrt(n).
    #[test]
    fn errors_of_independent_and_of_correlated_numbers() {
        let independent = noise(1 << 14);
        let found = mean(&independent);
        let expected = (1.0_f64 / 3.0).sqrt() / 128.0;
        assert!((found.error / expected - 1.0).abs() < 0.5, "{found:?} {expected}");
        let a: f64 = 0.9;
        let mut last = 0.0;
        let correlated: Vec<f64> = independent
            .iter()
            .map(|e| {
                last = a * last + e;
                last
            })
            .collect();
        let found = mean(&correlated);
        let expected = (1.0_f64 / 3.0).sqrt() / (1.0 - a) / 128.0;
        assert!((found.error / expected - 1.0).abs() < 0.5, "{found:?} {expected}");
        assert!(mean(&[1.0; 3]).error.is_nan() && mean(&[]).value.is_nan());
    }

    #[test]
    fn the_steady_part_is_found() {
        let series: Vec<f64> =
            noise(1000).iter().enumerate().map(|(k, e)| 5.0 * (-(k as f64) / 40.0).exp() + 0.3 * e).collect();
        let from = steady_from(&series).unwrap();
        assert!((50..400).contains(&from), "{from}");
        let rising: Vec<f64> = (0..1000).map(f64::from).collect();
        assert_eq!(steady_from(&rising), None);
        assert_eq!(steady_from(&series[..30]), None);
        assert_eq!(steady_from(&[2.0; 100]), Some(0));
    }
}
