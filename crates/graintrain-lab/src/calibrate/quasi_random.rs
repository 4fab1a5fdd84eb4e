//! Points that fill the unit cube evenly.

/// Bases of the coordinates, as many as there may be parameters.
const PRIMES: [u64; 8] = [2, 3, 5, 7, 11, 13, 17, 19];

/// Most coordinates of a point.
pub const MOST_DIMENSIONS: usize = PRIMES.len();

/// Digits of the number k in base b mirrored at the point.
fn radical_inverse(mut k: u64, base: u64) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0 / base as f64);
    while k > 0 {
        value += (k % base) as f64 * digit;
        k /= base;
        digit /= base as f64;
    }
    value
}

/// Point number k of the sequence of Halton in (0, 1)^dimension, `dimension` up to [`MOST_DIMENSIONS`].
///
/// Source: J. H. Halton, "On the efficiency of certain quasi-random sequences of points", Numerische
/// Mathematik 2, 1960.
pub fn halton(k: u64, dimension: usize) -> Vec<f64> {
    PRIMES.iter().take(dimension).map(|base| radical_inverse(k + 1, *base)).collect()
}

#[cfg(test)]
mod tests {
    use super::halton;

    #[test]
    fn first_points_and_means() {
        assert_eq!(halton(0, 2), [0.5, 1.0 / 3.0]);
        assert_eq!(halton(2, 2)[0], 0.75);
        assert!((halton(2, 2)[1] - 1.0 / 9.0).abs() < 1e-15);
        // The mean of x y^2 over the square is 1/6, far closer than by chance.
        let mean = (0..4096).map(|k| halton(k, 2)).map(|p| p[0] * p[1] * p[1]).sum::<f64>() / 4096.0;
        assert!((mean - 1.0 / 6.0).abs() < 1e-3, "{mean}");
    }
}
