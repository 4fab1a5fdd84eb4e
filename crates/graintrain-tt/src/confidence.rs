//! What a sample excludes.

/// The mean closest to `limit` (0 or 1) of a distribution on \[0, 1\] of which `count` independent values can
/// have the mean `seen` with a probability of `risk`: count kl(seen, mean) = ln(1 / risk) with the
/// Kullback-Leibler divergence of coins (Hoeffding, J. Amer. Statist. Assoc. 58, 1963, theorem 1). For seen =
/// 0 and risk = 5 % it is 3 / count.
pub(crate) fn farthest_mean(seen: f64, limit: f64, count: usize, risk: f64) -> f64 {
    let seen = seen.clamp(0.0, 1.0);
    let term = |p: f64, q: f64| if p > 0.0 { p * (p / q).ln() } else { 0.0 };
    let divergence = |mean: f64| term(seen, mean) + term(1.0 - seen, 1.0 - mean);
    let allowed = -risk.ln() / count.max(1) as f64;
    let (mut near, mut far) = (seen, limit);
    for _ in 0..200 {
        let middle = 0.5 * (near + far);
        if divergence(middle) <= allowed { near = middle } else { far = middle }
    }
    near
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_that_of_three_misses() {
        assert!((farthest_mean(0.0, 1.0, 1000, 0.05) * 1000.0 - 3.0).abs() < 0.02);
        assert!(farthest_mean(1.0, 0.0, 1000, 0.05) > 0.996);
    }
}
