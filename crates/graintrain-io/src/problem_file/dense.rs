//! Small dense symmetric positive definite matrices, for the mass blocks of problem files.

/// Lower Cholesky factor A = L L^T, row-major; `None` where A is not positive definite to rounding.
///
/// Cost n^3 / 3 flops, n^2 numbers.
pub(super) fn cholesky(mut a: Vec<f64>, n: usize) -> Option<Vec<f64>> {
    let largest = (0..n).fold(0.0_f64, |m, k| m.max(a[k * n + k].abs()));
    for j in 0..n {
        for k in 0..j {
            let factor = a[j * n + k];
            for i in j..n {
                a[i * n + j] -= a[i * n + k] * factor;
            }
        }
        let pivot = a[j * n + j];
        if pivot.is_nan() || pivot <= 1e-15 * largest {
            return None;
        }
        let root = pivot.sqrt();
        for i in j..n {
            a[i * n + j] /= root;
        }
    }
    Some(a)
}

/// x <- L^-1 x.
pub(super) fn solve_lower(l: &[f64], n: usize, x: &mut [f64]) {
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| l[i * n + k] * x[k]).sum();
        x[i] = (x[i] - sum) / l[i * n + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factor_times_its_transpose_is_the_matrix() {
        let a = vec![4.0, 2.0, -1.0, 2.0, 5.0, 3.0, -1.0, 3.0, 6.0];
        let l = cholesky(a.clone(), 3).unwrap();
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..=i.min(j)).map(|k| l[3 * i + k] * l[3 * j + k]).sum();
                assert!((product - a[3 * i + j]).abs() < 1e-14);
            }
        }
        let mut x = vec![1.0, 2.0, 3.0];
        solve_lower(&l, 3, &mut x);
        let back: Vec<f64> = (0..3).map(|i| (0..=i).map(|k| l[3 * i + k] * x[k]).sum()).collect();
        for (a, b) in back.iter().zip([1.0, 2.0, 3.0]) {
            assert!((a - b).abs() < 1e-14);
        }
        assert!(cholesky(vec![1.0, 2.0, 2.0, 1.0], 2).is_none());
    }
}
