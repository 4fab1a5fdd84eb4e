//! Small dense symmetric positive definite blocks stored row-major in slices.

use crate::block3::Block;

/// Inverse of a symmetric positive definite 3x3 block by cofactors; `None` where it is not positive definite.
pub fn invert3(a: &Block) -> Option<Block> {
    let minor = |i: usize, j: usize, k: usize, l: usize| a[i] * a[j] - a[k] * a[l];
    let c00 = minor(4, 8, 5, 7);
    let c01 = minor(5, 6, 3, 8);
    let c02 = minor(3, 7, 4, 6);
    let determinant = a[0] * c00 + a[1] * c01 + a[2] * c02;
    if !(determinant > 0.0 && a[0] > 0.0 && c00 > 0.0) {
        return None;
    }
    let d = 1.0 / determinant;
    let symmetric = |x: f64, y: f64| 0.5 * d * (x + y);
    let b01 = symmetric(c01, minor(2, 7, 1, 8));
    let b02 = symmetric(c02, minor(1, 5, 2, 4));
    let b12 = symmetric(minor(2, 3, 0, 5), minor(1, 6, 0, 7));
    Some([d * c00, b01, b02, b01, d * minor(0, 8, 2, 6), b12, b02, b12, d * minor(0, 4, 1, 3)])
}

/// a b.
#[inline]
pub fn multiply3(a: &Block, b: &Block) -> Block {
    let mut c = [0.0; 9];
    for i in 0..3 {
        for k in 0..3 {
            let x = a[3 * i + k];
            for j in 0..3 {
                c[3 * i + j] += x * b[3 * k + j];
            }
        }
    }
    c
}

/// a b^T.
#[inline]
pub fn multiply3_transposed(a: &Block, b: &Block) -> Block {
    let mut c = [0.0; 9];
    for i in 0..3 {
        for j in 0..3 {
            c[3 * i + j] = a[3 * i] * b[3 * j] + a[3 * i + 1] * b[3 * j + 1] + a[3 * i + 2] * b[3 * j + 2];
        }
    }
    c
}

/// a x.
#[inline]
pub fn apply3(a: &Block, x: [f64; 3]) -> [f64; 3] {
    [
        a[0] * x[0] + a[1] * x[1] + a[2] * x[2],
        a[3] * x[0] + a[4] * x[1] + a[5] * x[2],
        a[6] * x[0] + a[7] * x[1] + a[8] * x[2],
    ]
}

/// General inverse of a 3x3 block; `None` where its determinant vanishes or is not finite.
pub fn invert3_general(a: &Block) -> Option<Block> {
    let c = [
        a[4] * a[8] - a[5] * a[7],
        a[2] * a[7] - a[1] * a[8],
        a[1] * a[5] - a[2] * a[4],
        a[5] * a[6] - a[3] * a[8],
        a[0] * a[8] - a[2] * a[6],
        a[2] * a[3] - a[0] * a[5],
        a[3] * a[7] - a[4] * a[6],
        a[1] * a[6] - a[0] * a[7],
        a[0] * a[4] - a[1] * a[3],
    ];
    let determinant = a[0] * c[0] + a[1] * c[3] + a[2] * c[6];
    if !determinant.is_finite() || determinant == 0.0 {
        return None;
    }
    Some(c.map(|x| x / determinant))
}

/// Cholesky factor of a symmetric positive definite b x b block in place (lower triangle); false where it is
/// not.
pub fn factor_in_place(a: &mut [f64], b: usize) -> bool {
    for j in 0..b {
        let pivot = a[j * b + j] - (0..j).map(|k| a[j * b + k] * a[j * b + k]).sum::<f64>();
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        let root = pivot.sqrt();
        a[j * b + j] = root;
        for i in j + 1..b {
            let sum: f64 = (0..j).map(|k| a[i * b + k] * a[j * b + k]).sum();
            a[i * b + j] = (a[i * b + j] - sum) / root;
        }
    }
    true
}

/// L^-1 of a lower triangular B x B block with SQUARE = B^2 entries; entries above the diagonal are zero.
pub fn invert_lower<const B: usize, const SQUARE: usize>(l: &[f64; SQUARE]) -> [f64; SQUARE] {
    let mut inverse = [0.0; SQUARE];
    for column in 0..B {
        for row in column..B {
            let unit = if row == column { 1.0 } else { 0.0 };
            let sum: f64 = (column..row).map(|k| l[B * row + k] * inverse[B * k + column]).sum();
            inverse[B * row + column] = (unit - sum) / l[B * row + row];
        }
    }
    inverse
}

/// x <- (L L^T)^-1 x with a factor of [`factor_in_place`].
#[inline]
pub fn solve_in_place(l: &[f64], b: usize, x: &mut [f64]) {
    solve_lower_in_place(l, b, x);
    solve_upper_in_place(l, b, x);
}

/// x <- L^-1 x with a factor of [`factor_in_place`].
#[inline]
pub fn solve_lower_in_place(l: &[f64], b: usize, x: &mut [f64]) {
    for i in 0..b {
        let sum: f64 = (0..i).map(|k| l[i * b + k] * x[k]).sum();
        x[i] = (x[i] - sum) / l[i * b + i];
    }
}

/// x <- L^-T x with a factor of [`factor_in_place`].
#[inline]
pub fn solve_upper_in_place(l: &[f64], b: usize, x: &mut [f64]) {
    for i in (0..b).rev() {
        let sum: f64 = (i + 1..b).map(|k| l[k * b + i] * x[k]).sum();
        x[i] = (x[i] - sum) / l[i * b + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inverses_and_factors_invert(l in prop::array::uniform9(-1.0..1.0_f64), x in prop::array::uniform3(-1.0..1.0_f64)) {
            let mut a = multiply3_transposed(&l, &l);
            for k in 0..3 {
                a[4 * k] += 0.1;
            }
            let ax = apply3(&a, x);
            let mut by_factor = ax;
            let mut factor = a;
            prop_assert!(factor_in_place(&mut factor, 3));
            solve_in_place(&factor, 3, &mut by_factor);
            for solution in [apply3(&invert3(&a).unwrap(), ax), apply3(&invert3_general(&a).unwrap(), ax), by_factor] {
                for k in 0..3 {
                    prop_assert!((solution[k] - x[k]).abs() < 1e-11);
                }
            }
        }
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        let indefinite = [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0];
        assert!(invert3(&indefinite).is_none());
        assert!(!factor_in_place(&mut indefinite.clone(), 3));
        assert!(invert3_general(&[0.0; 9]).is_none());
    }
}
