//! Krylov methods: conjugate gradients, flexible conjugate gradients, BiCGSTAB.
//!
//! Operators and preconditioners are closures `(input, output)`; work vectors live in [`KrylovWork`], so that
//! no iteration allocates. The inner products are those of [`crate::parallel`]: the same bits for any number
//! of threads.

mod bicgstab;
mod cg;

pub use bicgstab::bicgstab;
pub use cg::{Measure, conjugate_gradient, conjugate_gradient_measured, flexible_conjugate_gradient};

use crate::patience::Patience;

/// A linear map: writes A x to its second argument.
pub type Operator<'a> = dyn FnMut(&[f64], &mut [f64]) + 'a;

/// When an iteration stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KrylovSettings {
    /// Stop when |b - A x| <= this times |b|.
    pub relative_tolerance: f64,
    /// Stop after this many iterations.
    pub max_iterations: usize,
}

/// Why an iteration stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KrylovOutcome {
    /// The relative tolerance was reached.
    Converged,
    /// The iteration limit was reached.
    IterationLimit,
    /// [`KrylovWork::patience`] ended.
    Stopped,
    /// A quantity that must not vanish (or change sign) did: the operator or the preconditioner is singular,
    /// indefinite, or the attainable accuracy is exhausted.
    Breakdown,
}

/// What a solve did. The solution is the best iterate, converged or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KrylovReport {
    /// Iterations made.
    pub iterations: usize,
    /// |b - A x| / |b| of the returned x, by the recurrence of the method.
    pub residual: f64,
    /// Why it stopped.
    pub outcome: KrylovOutcome,
}

impl KrylovReport {
    /// Whether the tolerance was reached.
    pub fn converged(&self) -> bool {
        self.outcome == KrylovOutcome::Converged
    }
}

/// Work vectors, allocated once and reused.
#[derive(Clone, Debug, Default)]
pub struct KrylovWork {
    vectors: [Vec<f64>; 9],
    /// Relative residual after each iteration of the last solve, beginning with that of the start.
    pub history: Vec<f64>,
    /// Asked before every iteration.
    pub patience: Patience,
}

/// Iterations whose residuals there is room for from the beginning.
const HISTORY: usize = 5002;

impl KrylovWork {
    /// The work vectors at the wanted length.
    fn vectors(&mut self, length: usize) -> &mut [Vec<f64>; 9] {
        for vector in &mut self.vectors {
            vector.resize(length, 0.0);
        }
        self.history.clear();
        // Solvers of contact problems stop after at most 5000 iterations; whoever makes more pays for a
        // longer list.
        self.history.reserve(HISTORY);
        &mut self.vectors
    }
}

/// y <- x + a y.
fn xpay(x: &[f64], a: f64, y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y = x + a * *y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::norm;

    /// The 1D Laplacian plus a shift that grows along the diagonal: positive definite, condition number about
    /// 4e3.
    fn apply(x: &[f64], y: &mut [f64]) {
        let n = x.len();
        for i in 0..n {
            let left = if i > 0 { x[i - 1] } else { 0.0 };
            let right = if i + 1 < n { x[i + 1] } else { 0.0 };
            y[i] = (2.0 + 0.01 * i as f64) * x[i] - left - right;
        }
    }

    fn jacobi(x: &[f64], y: &mut [f64]) {
        for i in 0..x.len() {
            y[i] = x[i] / (2.0 + 0.01 * i as f64);
        }
    }

    type Method = fn(
        &mut Operator<'_>,
        &mut Operator<'_>,
        &[f64],
        &mut [f64],
        KrylovSettings,
        &mut KrylovWork,
    ) -> KrylovReport;
    const METHODS: [Method; 3] = [conjugate_gradient, flexible_conjugate_gradient, bicgstab];

    #[test]
    fn every_method_reaches_the_tolerance_it_reports() {
        let n = 500;
        let b: Vec<f64> = (0..n).map(|i| f64::sin(3.0 * i as f64) + 0.1).collect();
        let settings = KrylovSettings { relative_tolerance: 1e-11, max_iterations: 2000 };
        let mut work = KrylovWork::default();
        for method in METHODS {
            let mut x = vec![0.0; n];
            let report = method(&mut apply, &mut jacobi, &b, &mut x, settings, &mut work);
            assert_eq!(report.outcome, KrylovOutcome::Converged);
            let mut ax = vec![0.0; n];
            apply(&x, &mut ax);
            let residual: Vec<f64> = b.iter().zip(&ax).map(|(b, ax)| b - ax).collect();
            assert!(norm(&residual) < 3e-11 * norm(&b));
            assert_eq!(work.history.len(), report.iterations + 1);
            // Solving again from the solution takes no iteration.
            let again = method(
                &mut apply,
                &mut jacobi,
                &b,
                &mut x,
                KrylovSettings { relative_tolerance: 1e-9, ..settings },
                &mut work,
            );
            assert_eq!(again.iterations, 0);
        }
    }

    /// With the Euclidean norm as measure the iterates are those of flexible conjugate gradients; it is
    /// looked at rarely.
    #[test]
    fn a_measure_of_ones_own_decides() {
        let n = 500;
        let b: Vec<f64> = (0..n).map(|i| f64::sin(3.0 * i as f64) + 0.1).collect();
        let settings = KrylovSettings { relative_tolerance: 1e-8, max_iterations: 2000 };
        let mut work = KrylovWork::default();
        let mut x = vec![0.0; n];
        let plain = flexible_conjugate_gradient(&mut apply, &mut jacobi, &b, &mut x, settings, &mut work);
        let size = norm(&b);
        let mut measured = |tolerance: f64, max_iterations: usize| {
            let settings = KrylovSettings { relative_tolerance: tolerance, max_iterations };
            let mut x = vec![0.0; n];
            let mut calls = 0;
            let report = conjugate_gradient_measured(
                &mut apply,
                &mut jacobi,
                &b,
                &mut x,
                settings,
                &mut work,
                Measure {
                    norm: &mut |r| {
                        calls += 1;
                        norm(r) / size
                    },
                    flexible: true,
                },
            );
            assert_eq!(work.history.len(), calls);
            (report, calls)
        };
        let (report, calls) = measured(1e-8, 2000);
        assert!(report.converged() && report.residual <= 1e-8);
        assert!(report.iterations >= plain.iterations && report.iterations <= plain.iterations * 11 / 10 + 5);
        assert!(4 * calls < report.iterations);
        // The last word is a value of the measure, also where the iteration ends between two looks at it.
        let (report, _) = measured(0.0, plain.iterations);
        assert!((report.residual - plain.residual).abs() < 1e-14, "{report:?}");
    }

    #[test]
    fn an_iteration_without_patience_stops_and_says_so() {
        let b = vec![1.0; 50];
        let mut work = KrylovWork {
            patience: Patience::new(Some(std::time::Instant::now()), None),
            ..KrylovWork::default()
        };
        let settings = KrylovSettings { relative_tolerance: 1e-10, max_iterations: 1000 };
        for method in METHODS {
            let mut x = vec![0.0; 50];
            let report = method(&mut apply, &mut jacobi, &b, &mut x, settings, &mut work);
            assert_eq!((report.outcome, report.iterations), (KrylovOutcome::Stopped, 0));
            assert!(x.iter().all(|&x| x == 0.0));
        }
    }

    #[test]
    fn limits_and_indefinite_operators_are_reported() {
        let b = vec![1.0; 50];
        let mut work = KrylovWork::default();
        for method in METHODS {
            let mut x = vec![0.0; 50];
            let settings = KrylovSettings { relative_tolerance: 1e-14, max_iterations: 3 };
            let report = method(&mut apply, &mut jacobi, &b, &mut x, settings, &mut work);
            assert_eq!(report.outcome, KrylovOutcome::IterationLimit);
            assert!(report.residual < 1.0);
        }
        let mut negative = |x: &[f64], y: &mut [f64]| {
            apply(x, y);
            y.iter_mut().for_each(|y| *y = -*y);
        };
        let settings = KrylovSettings { relative_tolerance: 1e-10, max_iterations: 100 };
        for method in &METHODS[..2] {
            let mut x = vec![0.0; 50];
            let report = method(&mut negative, &mut jacobi, &b, &mut x, settings, &mut work);
            assert_eq!(report.outcome, KrylovOutcome::Breakdown);
        }
    }
}
