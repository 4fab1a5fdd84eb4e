//! The minimum of a function of a few variables, without derivatives.

/// A local minimum from `start`, with first steps of length `step`, after at most `evaluations` values: where
/// it is and what it is. Values that are not numbers count as infinite.
///
/// Source: J. A. Nelder, R. Mead, "A simplex method for function minimization", The Computer Journal 7, 1965,
/// with their coefficients (reflection 1, expansion 2, contraction and shrinkage 1/2).
pub fn nelder_mead(
    function: &dyn Fn(&[f64]) -> f64,
    start: &[f64],
    step: f64,
    evaluations: usize,
) -> (Vec<f64>, f64) {
    let n = start.len();
    let value = |x: &[f64]| Some(function(x)).filter(|value| !value.is_nan()).unwrap_or(f64::INFINITY);
    let mut simplex: Vec<(Vec<f64>, f64)> = (0..=n)
        .map(|k| {
            let x: Vec<f64> = (0..n).map(|i| start[i] + if i + 1 == k { step } else { 0.0 }).collect();
            let y = value(&x);
            (x, y)
        })
        .collect();
    let mut used = n + 1;
    loop {
        simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
        let spread = simplex[n].1 - simplex[0].1;
        if used >= evaluations || spread <= 1e-9 * (1.0 + simplex[0].1.abs()) {
            return simplex.swap_remove(0);
        }
        let middle: Vec<f64> =
            (0..n).map(|i| simplex[..n].iter().map(|(x, _)| x[i]).sum::<f64>() / n as f64).collect();
        // The worst corner moved along its line through the middle of the others.
        let along = |worst: &[f64], t: f64| -> (Vec<f64>, f64) {
            let x: Vec<f64> = middle.iter().zip(worst).map(|(m, w)| m + t * (m - w)).collect();
            let y = value(&x);
            (x, y)
        };
        let worst = simplex[n].0.clone();
        let reflected = along(&worst, 1.0);
        used += 1;
        if reflected.1 < simplex[0].1 {
            let expanded = along(&worst, 2.0);
            used += 1;
            simplex[n] = if expanded.1 < reflected.1 { expanded } else { reflected };
        } else if reflected.1 < simplex[n - 1].1 {
            simplex[n] = reflected;
        } else {
            let contracted = along(&worst, if reflected.1 < simplex[n].1 { 0.5 } else { -0.5 });
            used += 1;
            if contracted.1 < simplex[n].1.min(reflected.1) {
                simplex[n] = contracted;
            } else {
                let best = simplex[0].0.clone();
                for corner in &mut simplex[1..] {
                    corner.0 = best.iter().zip(&corner.0).map(|(b, x)| 0.5 * (b + x)).collect();
                    corner.1 = value(&corner.0);
                }
                used += n;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::nelder_mead;

    #[test]
    fn minima_that_are_known() {
        let rosenbrock = |x: &[f64]| 100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2);
        let (x, y) = nelder_mead(&rosenbrock, &[-1.2, 1.0], 0.5, 1000);
        assert!((x[0] - 1.0).abs() < 1e-3 && (x[1] - 1.0).abs() < 1e-3 && y < 1e-6, "{x:?} {y}");
        let walled = |x: &[f64]| if x[0] < 0.0 { f64::NAN } else { (x[0] - 0.3).abs() };
        let (x, _) = nelder_mead(&walled, &[2.0], 1.0, 300);
        assert!((x[0] - 0.3).abs() < 1e-6, "{x:?}");
    }
}
