//! Operators on references, exact in the ranks they make: `&x + &y`, `&x - &y`, `&x * &y` (entrywise for
//! vectors, the product for matrices), `&a * &x`, `2.0 * &x`, `-&x`; `&x % truncation` rounds. And how trains
//! print.
//!
//! Nothing is rounded unasked: ranks add in sums and multiply in products until `%` says how much may be
//! lost.
//!
//! ```
//! use graintrain_tt::{Truncation, qtt};
//! let (a, x) = (qtt::laplacian(8)?, qtt::sine(8, 0.1, 0.3)?);
//! let y = &(&(&a * &x) - &(2.0 * &x)) % Truncation::to(1e-12);
//! assert_eq!(format!("{y}"), "train of 8 modes 2 x 2 x ... x 2, ranks 1 2 4 4 4 4 4 2 1, 168 numbers");
//! # Ok::<(), graintrain_tt::TtError>(())
//! ```

use crate::{Truncation, TtError, TtMatrix, TtVector};
use std::fmt::{Display, Formatter};
use std::ops::{Add, Mul, Neg, Rem, Sub};

/// The value, or a panic that says which operation had trains that do not fit: operators cannot return
/// errors.
#[track_caller]
#[allow(clippy::panic)]
fn fitting<T>(operation: &str, result: Result<T, TtError>) -> T {
    result.unwrap_or_else(|error| panic!("{operation}: {error}"))
}

/// An operator on two references by a method that fails where sizes do not fit.
macro_rules! binary {
    ($operator:ident, $function:ident, $left:ty, $right:ty, $output:ty, $method:ident, $name:literal) => {
        impl $operator<&$right> for &$left {
            type Output = $output;

            #[doc = concat!("`", stringify!($method), "` of two trains.\n\n# Panics\nIf their sizes do not fit: the method of that name returns an error instead.")]
            fn $function(self, other: &$right) -> $output {
                fitting($name, self.$method(other))
            }
        }
    };
}

binary!(Add, add, TtVector, TtVector, TtVector, add, "sum of trains");
binary!(Sub, sub, TtVector, TtVector, TtVector, subtract, "difference of trains");
binary!(Mul, mul, TtVector, TtVector, TtVector, hadamard, "entrywise product of trains");
binary!(Add, add, TtMatrix, TtMatrix, TtMatrix, add, "sum of matrices");
binary!(Sub, sub, TtMatrix, TtMatrix, TtMatrix, subtract, "difference of matrices");
binary!(Mul, mul, TtMatrix, TtMatrix, TtMatrix, times_matrix, "product of matrices");
binary!(Mul, mul, TtMatrix, TtVector, TtVector, times_vector, "matrix times train");

/// What holds for vectors and matrices alike.
macro_rules! linear {
    ($train:ty) => {
        impl Mul<&$train> for f64 {
            type Output = $train;

            /// The multiple.
            fn mul(self, train: &$train) -> $train {
                train.scale(self)
            }
        }

        impl Neg for &$train {
            type Output = $train;

            /// The negative.
            fn neg(self) -> $train {
                self.scale(-1.0)
            }
        }

        impl Rem<Truncation> for &$train {
            type Output = $train;

            /// The train rounded: `round` without its report.
            ///
            /// # Panics
            /// If the truncation has no meaning or an entry is not finite: `round` returns an error instead.
            fn rem(self, truncation: Truncation) -> $train {
                fitting("rounding", self.round(&truncation)).0
            }
        }
    };
}

linear!(TtVector);
linear!(TtMatrix);

/// Up to six of a list, the middle of a longer one as dots.
fn joined(list: &[String], between: &str, most: usize) -> String {
    if list.len() <= most {
        return list.join(between);
    }
    [&list[..2], &["...".to_string()], &list[list.len() - 1..]].concat().join(between)
}

impl Display for TtVector {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let words = |numbers: Vec<usize>| numbers.iter().map(usize::to_string).collect::<Vec<_>>();
        let (modes, ranks) = (joined(&words(self.modes()), " x ", 6), joined(&words(self.ranks()), " ", 24));
        let (d, numbers) = (self.num_cores(), self.num_parameters());
        write!(f, "train of {d} modes {modes}, ranks {ranks}, {numbers} numbers")
    }
}

impl Display for TtMatrix {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let words = |numbers: &[usize]| numbers.iter().map(usize::to_string).collect::<Vec<_>>();
        let (rows, columns) = (joined(&words(&self.rows), " x ", 6), joined(&words(&self.columns), " x ", 6));
        let ranks = joined(&words(&self.ranks()), " ", 24);
        let (d, numbers) = (self.num_cores(), self.train.num_parameters());
        write!(
            f,
            "matrix train of {d} modes, rows {rows}, columns {columns}, ranks {ranks}, {numbers} numbers"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::qtt;

    #[test]
    fn operators_are_the_methods() {
        let (x, y) =
            (TtVector::random(&[2, 3, 2], 2, 1).unwrap(), TtVector::random(&[2, 3, 2], 3, 2).unwrap());
        assert_eq!(&x + &y, x.add(&y).unwrap());
        assert_eq!(&x - &y, x.subtract(&y).unwrap());
        assert_eq!(&x * &y, x.hadamard(&y).unwrap());
        assert_eq!(-&(2.0 * &x), x.scale(2.0).scale(-1.0));
        let (a, b) = (
            TtMatrix::random(&[2, 2], &[3, 2], 2, 3).unwrap(),
            TtMatrix::random(&[3, 2], &[2, 2], 2, 4).unwrap(),
        );
        assert_eq!(&a * &b, a.times_matrix(&b).unwrap());
        assert_eq!((&(&a + &a) % Truncation::to(1e-12)).ranks(), a.ranks());
        assert_eq!(
            format!("{}", &a - &a),
            "matrix train of 2 modes, rows 2 x 2, columns 3 x 2, ranks 1 4 1, 40 numbers"
        );
    }

    #[test]
    #[should_panic(expected = "sum of trains: mode sizes: expected [2, 2], got [2, 2, 2]")]
    fn sizes_that_do_not_fit_panic_with_both() {
        let _ = &qtt::sine(2, 1.0, 0.0).unwrap() + &qtt::sine(3, 1.0, 0.0).unwrap();
    }
}
