//! Trains that are given by what their cores do to matrices: that is all that rounding, norms and residuals
//! need, so sums keep their zero blocks and products their factors.

use crate::TtVector;
use crate::scale::{binary_exponent, factor_within_product, largest_finite};
use crate::vector::Core;
use graintrain_linalg::dense::{DenseError, Matrix, View};

/// A train by what its cores do to matrices.
pub(crate) trait Cores: Sync {
    /// Mode sizes.
    fn modes(&self) -> Vec<usize>;

    /// Left and right rank of core k.
    fn ranks(&self, k: usize) -> (usize, usize);

    /// e such that 2^-e G_k is of moderate size; none if G_k is zero.
    ///
    /// # Errors
    /// [`DenseError::NotFinite`].
    fn exponent(&self, k: usize) -> Result<Option<i32>, DenseError>;

    /// 4^power sum l_alpha G_k(alpha, i, beta)^2 r_beta, or a bound of it: what rounding of the core does to
    /// the tensor if l and r hold the squared lengths of the columns and rows of the parts left and right of
    /// it. (Whatever the units of alpha and beta.)
    fn weighted_square(&self, k: usize, left: &[f64], right: &[f64], power: i32) -> f64;

    /// 2^power M G_k, in the given memory where that saves asking for new one.
    fn multiply_left(&self, k: usize, m: View<'_>, power: i32, memory: Vec<f64>) -> Core;

    /// 2^power G_k M, likewise.
    fn multiply_right(&self, k: usize, m: View<'_>, power: i32, memory: Vec<f64>) -> Core;
}

/// Sum l_alpha G(alpha, i, beta) r_beta.
pub(crate) fn weighted_sum(core: &Core, left: &[f64], right: &[f64]) -> f64 {
    weighted_sum_of(core, left, right, |x| x)
}

/// Sum l_alpha f(G(alpha, i, beta)) r_beta.
fn weighted_sum_of(core: &Core, left: &[f64], right: &[f64], f: impl Fn(f64) -> f64) -> f64 {
    const LANES: usize = 8;
    let fibre = |fibre: &[f64]| {
        let mut lanes = [0.0; LANES];
        let (parts, weights) = (fibre.chunks_exact(LANES), left.chunks_exact(LANES));
        let rest = parts.remainder().iter().zip(weights.remainder()).map(|(x, l)| f(*x) * l).sum::<f64>();
        for (part, weights) in parts.zip(weights) {
            (0..LANES).for_each(|k| lanes[k] += f(part[k]) * weights[k]);
        }
        lanes.iter().sum::<f64>() + rest
    };
    let column = |(block, r): (&[f64], &f64)| r * block.chunks_exact(core.left).map(fibre).sum::<f64>();
    core.data.chunks_exact(core.left * core.mode).zip(right).map(column).sum()
}

/// The squares of the numbers of a core times 4^power.
pub(crate) fn squared(core: &Core, power: i32) -> Core {
    let mut squared = core.scaled(power);
    squared.data.iter_mut().for_each(|x| *x *= *x);
    squared
}

/// The exponent of the largest number of a core; none if all are zero.
pub(crate) fn core_exponent(core: &Core) -> Result<Option<i32>, DenseError> {
    let largest = largest_finite(&core.data)?;
    Ok((largest > 0.0).then(|| binary_exponent(largest)))
}

impl Cores for TtVector {
    fn modes(&self) -> Vec<usize> {
        TtVector::modes(self)
    }

    fn exponent(&self, k: usize) -> Result<Option<i32>, DenseError> {
        core_exponent(&self.cores[k])
    }

    fn ranks(&self, k: usize) -> (usize, usize) {
        (self.cores[k].left, self.cores[k].right)
    }

    fn weighted_square(&self, k: usize, left: &[f64], right: &[f64], power: i32) -> f64 {
        let core = &self.cores[k];
        let Some(factor) = factor_within_product(power) else {
            return weighted_sum(&squared(core, power), left, right);
        };
        weighted_sum_of(core, left, right, |x| (factor * x).powi(2))
    }

    fn multiply_left(&self, k: usize, m: View<'_>, power: i32, memory: Vec<f64>) -> Core {
        self.cores[k].multiply_left_in(m, power, memory)
    }

    fn multiply_right(&self, k: usize, m: View<'_>, power: i32, memory: Vec<f64>) -> Core {
        self.cores[k].multiply_right_in(m, power, memory)
    }
}

/// w_1 T_1 + w_2 T_2 + ...: the cores are block diagonal (side by side at the ends of the train), and only
/// the blocks are multiplied. The terms have the same modes; there is at least one.
pub(crate) struct Sum<'a> {
    pub(crate) terms: Vec<(f64, &'a dyn Cores)>,
}

impl Sum<'_> {
    fn last(&self) -> usize {
        self.modes().len() - 1
    }

    /// The terms' parts of a bond: where each begins.
    fn offsets(&self, ranks: impl Fn(&dyn Cores) -> usize) -> Vec<usize> {
        let mut sum = 0;
        let mut offsets = vec![0];
        for (_, term) in &self.terms {
            sum += ranks(*term);
            offsets.push(sum);
        }
        offsets
    }
}

impl Cores for Sum<'_> {
    fn modes(&self) -> Vec<usize> {
        self.terms[0].1.modes()
    }

    fn ranks(&self, k: usize) -> (usize, usize) {
        let sum =
            |part: &dyn Fn((usize, usize)) -> usize| self.terms.iter().map(|t| part(t.1.ranks(k))).sum();
        let left = if k == 0 { 1 } else { sum(&|r| r.0) };
        (left, if k == self.last() { 1 } else { sum(&|r| r.1) })
    }

    fn exponent(&self, k: usize) -> Result<Option<i32>, DenseError> {
        let mut largest = None;
        for (weight, term) in &self.terms {
            let weight = if k == 0 { largest_finite(&[*weight])? } else { 1.0 };
            if let (Some(exponent), true) = (term.exponent(k)?, weight > 0.0) {
                largest = largest.max(Some(exponent + binary_exponent(weight)));
            }
        }
        Ok(largest)
    }

    fn weighted_square(&self, k: usize, left: &[f64], right: &[f64], power: i32) -> f64 {
        let (first, last) = (k == 0, k == self.last());
        let (before, after) = (self.offsets(|term| term.ranks(k).0), self.offsets(|term| term.ranks(k).1));
        let part = |(i, (weight, term)): (usize, &(f64, &dyn Cores))| {
            let left = if first { left } else { &left[before[i]..before[i + 1]] };
            let right = if last { right } else { &right[after[i]..after[i + 1]] };
            term.weighted_square(k, left, right, power) * if first { weight.powi(2) } else { 1.0 }
        };
        self.terms.iter().enumerate().map(part).sum()
    }

    fn multiply_left(&self, k: usize, m: View<'_>, power: i32, _memory: Vec<f64>) -> Core {
        let offsets = self.offsets(|term| term.ranks(k).0);
        let (last, mode) = (k == self.last(), self.modes()[k]);
        let mut joined = Core { left: m.rows(), mode, right: 0, data: Vec::new() };
        for ((weight, term), first) in self.terms.iter().zip(&offsets) {
            let mut part = if k == 0 {
                term.multiply_left(k, m, power, Vec::new())
            } else {
                let columns = Matrix::from_fn(m.rows(), term.ranks(k).0, |i, j| m.get(i, first + j));
                term.multiply_left(k, columns.view(), power, Vec::new())
            };
            if k == 0 {
                part.data.iter_mut().for_each(|x| *x *= weight);
            }
            if last && joined.right > 0 {
                joined.data.iter_mut().zip(&part.data).for_each(|(sum, x)| *sum += x);
            } else {
                // The right rank is the slowest index.
                joined.right += part.right;
                joined.data.append(&mut part.data);
            }
        }
        joined
    }

    fn multiply_right(&self, k: usize, m: View<'_>, power: i32, _memory: Vec<f64>) -> Core {
        let offsets = self.offsets(|term| term.ranks(k).1);
        let (last, mode) = (k == self.last(), self.modes()[k]);
        let parts = self.terms.iter().zip(&offsets).map(|((weight, term), first)| {
            let mut part = if last {
                term.multiply_right(k, m, power, Vec::new())
            } else {
                let rows = Matrix::from_fn(term.ranks(k).1, m.columns(), |i, j| m.get(first + i, j));
                term.multiply_right(k, rows.view(), power, Vec::new())
            };
            if k == 0 {
                part.data.iter_mut().for_each(|x| *x *= weight);
            }
            part
        });
        let parts: Vec<Core> = parts.collect();
        let (left, right) = (self.ranks(k).0, m.columns());
        let mut data = Vec::with_capacity(left * mode * right);
        if k == 0 {
            data.resize(mode * right, 0.0);
            parts.iter().for_each(|part| data.iter_mut().zip(&part.data).for_each(|(sum, x)| *sum += x));
        } else {
            for fibre in 0..mode * right {
                parts
                    .iter()
                    .for_each(|part| data.extend_from_slice(&part.data[part.left * fibre..][..part.left]));
            }
        }
        Core { left, mode, right, data }
    }
}
