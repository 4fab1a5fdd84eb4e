//! The approximate inverse of one TT-matrix as a preconditioner for another: conjugate gradients on full
//! vectors for -div(k grad u) = 1 in a square of 2^7 x 2^7 points, k between 1 and 5 and without a low rank,
//! with the inverse of the Laplacian to several tolerances. A truncated inverse may be indefinite, and then
//! it is of no use: see the second one.
//!
//! `cargo run --release -p graintrain-tt --example preconditioner`

use graintrain_tt::apply::{ApplyWork, FullOperator};
use graintrain_tt::inverse::{InverseForm, inverse};
use graintrain_tt::qtt::{self, DigitOrder};
use graintrain_tt::solve::SolveSettings;
use graintrain_tt::{Truncation, TtError};

/// The five-point operator with coefficients on the edges; values beyond the border are zero.
struct Diffusion {
    n: usize,
}

impl Diffusion {
    /// The coefficient of the edge from point (i, j), either to the next i or to the next j.
    fn coefficient(&self, i: usize, j: usize, along: usize) -> f64 {
        3.0 + 2.0 * ((i * i * 31 + j * j * 17 + i * j * 7 + along) as f64).sin()
    }

    fn apply(&self, u: &[f64], out: &mut [f64]) {
        let n = self.n;
        let value = |i: usize, j: usize| if i < n && j < n { u[i + n * j] } else { 0.0 };
        for j in 0..n {
            for i in 0..n {
                let here = u[i + n * j];
                // (The neighbour before 0 wraps to a number beyond n: zero.)
                let flux = self.coefficient(i + 1, j, 0) * (here - value(i + 1, j))
                    + self.coefficient(i, j, 0) * (here - value(i.wrapping_sub(1), j))
                    + self.coefficient(i, j + 1, 1) * (here - value(i, j + 1))
                    + self.coefficient(i, j, 1) * (here - value(i, j.wrapping_sub(1)));
                out[i + n * j] = flux;
            }
        }
    }
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// Iterations until the residual has fallen by 1e-8; none if the preconditioner is not positive or 2000 do
/// not suffice.
fn conjugate_gradients(a: &Diffusion, mut precondition: impl FnMut(&[f64], &mut [f64])) -> Option<usize> {
    let size = a.n * a.n;
    let (mut u, mut r) = (vec![0.0; size], vec![1.0; size]);
    let (mut z, mut image) = (vec![0.0; size], vec![0.0; size]);
    let target = 1e-8 * dot(&r, &r).sqrt();
    precondition(&r, &mut z);
    let mut p = z.clone();
    let mut weight = dot(&r, &z);
    for iteration in 1..2000 {
        a.apply(&p, &mut image);
        let step = weight / dot(&p, &image);
        u.iter_mut().zip(&p).for_each(|(u, p)| *u += step * p);
        r.iter_mut().zip(&image).for_each(|(r, q)| *r -= step * q);
        if dot(&r, &r).sqrt() <= target {
            return Some(iteration);
        }
        precondition(&r, &mut z);
        let next = dot(&r, &z);
        if next <= 0.0 {
            return None;
        }
        p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + next / weight * *p);
        weight = next;
    }
    None
}

fn main() -> Result<(), TtError> {
    let digits = 7;
    let line = qtt::laplacian(digits)?;
    let laplacian = qtt::kronecker_sum(&[line.clone(), line], DigitOrder::Separated)?;
    let a = Diffusion { n: 1 << digits };
    let plain = conjugate_gradients(&a, |r, z| z.copy_from_slice(r));
    println!("no preconditioner: {} iterations", plain.unwrap_or(2000));
    for tolerance in [3e-1, 1e-1, 1e-2, 1e-4] {
        let settings = SolveSettings { tolerance, ..Default::default() };
        let (x, report) = inverse(&laplacian, InverseForm::Energy, None, &settings)?;
        // Symmetric, or conjugate gradients would not be.
        let x = x.symmetric_part()?.round(&Truncation::to(0.1 * tolerance.min(1e-2)))?.0;
        let operator = FullOperator::new(&x)?;
        let mut work = ApplyWork::default();
        let mut failed = None;
        let iterations =
            conjugate_gradients(&a, |r, z| failed = operator.apply(r, z, &mut work).err().or(failed.take()));
        if let Some(error) = failed {
            return Err(error);
        }
        println!(
            "inverse of the Laplacian to {tolerance:.0e} (residual {:.1e}, rank {}): {}",
            report.residual,
            x.max_rank(),
            match iterations {
                Some(count) => format!("{count} iterations"),
                None => "not positive definite, of no use".to_string(),
            }
        );
    }
    Ok(())
}
