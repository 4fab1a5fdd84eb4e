//! Symmetric matrices as trains whose bonds know their parity.
//!
//! Exchanging i_k and j_k in every pair maps A to A^T. On one pair of digits this exchange has the
//! eigenvalues +1 (the s = n (n + 1) / 2 symmetric n x n matrices) and -1 (the a = n (n - 1) / 2
//! antisymmetric ones). A = A^T means that a product over all digits holds an even number of antisymmetric
//! factors, so every bond splits into an even and an odd part and every core into four blocks,
//!
//! ```text
//! even -> even and odd -> odd: s matrices,   even -> odd and odd -> even: a matrices,
//! ```
//!
//! the train starting and ending even. Half of the numbers of the ungraded train are not there at all,
//! singular value decompositions split in two, and the matrix is symmetric to the last bit whatever is
//! truncated. (The grading by a finite group is that of symmetric tensor networks: Singh, Pfeifer, Vidal,
//! Phys. Rev. A 82, 050301, 2010.)

use crate::error::at_core;
use crate::factor::{all_columns, row_factor};
use crate::round::{Budget, ROUNDING, sum_of_squares};
use crate::scale::{binary_exponent, largest_finite, power_shares, scale_by_power};
use crate::vector::Core;
use crate::{Truncation, TruncationReport, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{DenseError, Matrix, View, left_svd, product};
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_1_SQRT_2;

const PARITIES: [usize; 2] = [EVEN, ODD];
const EVEN: usize = 0;
const ODD: usize = 1;

/// One core: blocks\[p\]\[q\] leads from parity p on the left to parity q on the right.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct GradedCore {
    blocks: [[Core; 2]; 2],
}

/// A symmetric matrix as a train with even and odd bonds. O(d n^2 r^2 / 2) numbers.
///
/// ```
/// use graintrain_tt::{Truncation, qtt, symmetric::SymmetricTrain};
/// let line = qtt::laplacian(8)?;
/// let (graded, _) = SymmetricTrain::symmetric_part(&line)?.round(&Truncation::to(1e-13))?;
/// assert_eq!(graded.ranks()[1..8], [(2, 1); 7]); // of the rank 3 of the Laplacian two are even
/// assert!(graded.to_matrix().relative_distance(&line)? < 1e-13);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Stored")]
pub struct SymmetricTrain {
    modes: Vec<usize>,
    cores: Vec<GradedCore>,
}

/// What serde sees; checked on the way in.
#[derive(Deserialize)]
struct Stored {
    modes: Vec<usize>,
    cores: Vec<GradedCore>,
}

impl TryFrom<Stored> for SymmetricTrain {
    type Error = TtError;

    fn try_from(Stored { modes, cores }: Stored) -> Result<Self, TtError> {
        let shape = |what, expected: Vec<usize>, got: Vec<usize>| {
            if expected == got { Ok(()) } else { Err(TtError::Shape { what, expected, got }) }
        };
        shape("cores of a symmetric train", vec![modes.len()], vec![cores.len()])?;
        let mut ranks = [1, 0];
        for (core, &n) in cores.iter().zip(&modes) {
            let right = PARITIES.map(|q| core.blocks[q][q].right);
            for p in PARITIES {
                for q in PARITIES {
                    let block = &core.blocks[p][q];
                    let size = num_pairs(n, p == q);
                    let expected = vec![ranks[p], size, right[q]];
                    shape("block of a symmetric core", expected, vec![block.left, block.mode, block.right])?;
                }
            }
            ranks = right;
        }
        shape("even and odd rank at the end of a symmetric train", vec![1, 0], ranks.to_vec())?;
        if modes.is_empty() || modes.contains(&0) {
            return Err(TtError::Shape {
                what: "digits of a symmetric train",
                expected: vec![1],
                got: modes,
            });
        }
        Ok(Self { modes, cores })
    }
}

impl SymmetricTrain {
    /// (A + A^T) / 2. With G = S + T the symmetric and antisymmetric parts of a core, the product of all S +
    /// T restricted to an even number of T: even and odd rank at every bond are the rank of A before any
    /// rounding.
    ///
    /// # Errors
    /// [`TtError::Shape`] if a core is not square.
    pub fn symmetric_part(a: &TtMatrix) -> Result<Self, TtError> {
        a.check_square()?;
        let last = a.num_cores() - 1;
        let graded = |(k, (core, &n)): (usize, (&Core, &usize))| {
            let block = |p: usize, q: usize| {
                let pairs = pairs(n, p == q);
                let left = if k == 0 && p == ODD { 0 } else { core.left };
                let right = if k == last && q == ODD { 0 } else { core.right };
                Core::from_fn(left, pairs.len(), right, |alpha, pair, beta| {
                    let (i, j) = pairs[pair];
                    if i == j {
                        return core.get(alpha, i + n * i, beta);
                    }
                    let (upper, lower) = (core.get(alpha, i + n * j, beta), core.get(alpha, j + n * i, beta));
                    FRAC_1_SQRT_2 * if p == q { upper + lower } else { upper - lower }
                })
            };
            GradedCore {
                blocks: [[block(EVEN, EVEN), block(EVEN, ODD)], [block(ODD, EVEN), block(ODD, ODD)]],
            }
        };
        let cores = a.cores().iter().zip(a.row_modes()).enumerate().map(graded).collect();
        Ok(Self { modes: a.row_modes().to_vec(), cores })
    }

    /// The same matrix as an ordinary train, ranks even + odd. Its entries (i, j) and (j, i) are equal to the
    /// last bit.
    pub fn to_matrix(&self) -> TtMatrix {
        let cores = self.cores.iter().zip(&self.modes).map(|(core, &n)| core.ungraded(n)).collect();
        TtMatrix { rows: self.modes.clone(), columns: self.modes.clone(), train: TtVector { cores } }
    }

    /// Digits n_1, ..., n_d of rows and columns.
    pub fn modes(&self) -> &[usize] {
        &self.modes
    }

    /// Even and odd rank of every bond, (1, 0) at both ends.
    pub fn ranks(&self) -> Vec<(usize, usize)> {
        let right = |core: &GradedCore| (core.blocks[EVEN][EVEN].right, core.blocks[ODD][ODD].right);
        std::iter::once((1, 0)).chain(self.cores.iter().map(right)).collect()
    }

    /// a * self, the factor going into the first core.
    pub fn scale(&self, a: f64) -> Self {
        let mut train = self.clone();
        let first = train.cores[0].blocks.iter_mut().flatten();
        first.flat_map(|block| &mut block.data).for_each(|x| *x *= a);
        train
    }

    /// self + other: even ranks add, and so do odd ones.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the digits differ.
    pub fn add(&self, other: &Self) -> Result<Self, TtError> {
        if self.modes != other.modes {
            let (expected, got) = (self.modes.clone(), other.modes.clone());
            return Err(TtError::Shape { what: "digits of two symmetric trains", expected, got });
        }
        let last = self.cores.len() - 1;
        let sum = |k: usize| {
            let block = |p: usize, q: usize| {
                let (x, y) = (&self.cores[k].blocks[p][q], &other.cores[k].blocks[p][q]);
                x.direct_sum(y, k == 0, k == last)
            };
            GradedCore { blocks: PARITIES.map(|p| PARITIES.map(|q| block(p, q))) }
        };
        Ok(Self { modes: self.modes.clone(), cores: (0..=last).map(sum).collect() })
    }

    /// A x for a train x, which has no parity: the product of [`SymmetricTrain::to_matrix`]. (For full
    /// vectors make a [`crate::apply::FullOperator`] of that.)
    ///
    /// # Errors
    /// As for [`TtMatrix::times_vector`].
    pub fn times_vector(&self, x: &TtVector) -> Result<TtVector, TtError> {
        self.to_matrix().times_vector(x)
    }

    /// Numbers stored.
    pub fn num_parameters(&self) -> usize {
        self.cores.iter().flat_map(|core| core.blocks.iter().flatten()).map(|block| block.data.len()).sum()
    }

    /// The shortest graded train within the truncation: as [`TtVector::round`], with one decomposition per
    /// parity and bond. Singular vectors of a symmetric matrix have a parity, so the error and the total
    /// ranks are those of ungraded rounding. O(d n^2 r^3 / 4).
    ///
    /// # Errors
    /// As for [`TtVector::round`].
    pub fn round(&self, truncation: &Truncation) -> Result<(Self, TruncationReport), TtError> {
        truncation.check()?;
        let d = self.cores.len();
        let mut cores = self.cores.clone();
        let mut exponent = 0i64;
        // Of the part right of bond k only the triangles count, one per parity: A_{>k} = L_k Q_k.
        let mut right = vec![[Matrix::identity(1), Matrix::zeros(0, 0)]; d];
        for k in (0..d).rev() {
            let power =
                joint_exponent(cores[k].blocks.iter().flatten().map(Core::data)).map_err(at_core(k))?;
            let Some(first) = power else { return Ok(self.zero_like()) };
            cores[k].scale_by_power(-first);
            let mut triangles = PARITIES.map(|p| {
                let after = PARITIES.map(|q| cores[k].blocks[p][q].multiply_right(right[k][q].view()));
                let columns = after.iter().map(|block| block.mode * block.right).sum();
                let unfolding: Vec<f64> = after.into_iter().flat_map(|block| block.data).collect();
                row_factor(View::new(&unfolding, cores[k].blocks[p][p].left, columns))
            });
            let second = joint_exponent(triangles.iter().map(Matrix::data)).map_err(at_core(k))?;
            let Some(second) = second else { return Ok(self.zero_like()) };
            cores[k].scale_by_power(-second);
            triangles.iter_mut().for_each(|triangle| scale_by_power(triangle.data_mut(), -second));
            exponent += i64::from(first + second);
            if k > 0 {
                right[k - 1] = triangles;
            }
        }
        let unfoldings = |core: &GradedCore, right: &[Matrix; 2]| {
            PARITIES.map(|q| product(core.left_unfolding(q).view(), right[q].view()))
        };
        let mut unfolding = unfoldings(&cores[0], &right[0]);
        let norm_squared = unfolding.iter().flat_map(|u| u.data()).map(|x| x * x).sum::<f64>();
        let mut budget = Budget::new(truncation, norm_squared, d - 1);
        // As in `round`: what rounding of one core does to the tensor.
        let moved = |k: usize, core: &GradedCore, left: f64| {
            let size: f64 = core.blocks.iter().flatten().map(|block| sum_of_squares(&block.data)).sum();
            left * size * right[k].iter().map(|factor| sum_of_squares(factor.data())).sum::<f64>()
        };
        let mut rounding = moved(0, &cores[0], 1.0);
        for k in 0..d - 1 {
            let vectors = leading_of_both(&unfolding, &mut budget).map_err(at_core(k))?;
            let carry = PARITIES.map(|q| product(vectors[q].t(), cores[k].left_unfolding(q).view()));
            cores[k].set_left_unfoldings(&vectors);
            let left = carry.iter().map(|carry| sum_of_squares(carry.data())).sum();
            rounding += moved(k + 1, &cores[k + 1], left);
            for p in PARITIES {
                for q in PARITIES {
                    let block = &mut cores[k + 1].blocks[p][q];
                    *block = block.multiply_left(carry[p].view());
                }
            }
            unfolding = unfoldings(&cores[k + 1], &right[k + 1]);
        }
        let report = budget.report(norm_squared, ROUNDING * (rounding / norm_squared).sqrt());
        for (core, share) in cores.iter_mut().zip(power_shares(exponent, d)) {
            core.scale_by_power(share);
        }
        let train = Self { modes: self.modes.clone(), cores };
        Ok((train, TruncationReport { norm: report.norm * (exponent as f64).exp2(), ..report }))
    }

    /// The zero matrix of the same size with the report of an exact truncation.
    fn zero_like(&self) -> (Self, TruncationReport) {
        let zero = |&n: &usize| {
            let block = |p: usize, q: usize| {
                let (left, right) = (usize::from(p == EVEN), usize::from(q == EVEN));
                Core::from_fn(left, pairs(n, p == q).len(), right, |_, _, _| 0.0)
            };
            GradedCore { blocks: PARITIES.map(|p| PARITIES.map(|q| block(p, q))) }
        };
        let cores = self.modes.iter().map(zero).collect();
        let report = TruncationReport::zero();
        (Self { modes: self.modes.clone(), cores }, report)
    }
}

impl GradedCore {
    /// Multiplies every number by 2^power.
    fn scale_by_power(&mut self, power: i32) {
        self.blocks.iter_mut().flatten().for_each(|block| scale_by_power(&mut block.data, power));
    }

    /// The block that reaches parity q over symmetric pairs above the one over antisymmetric pairs.
    fn left_unfolding(&self, q: usize) -> Matrix {
        let (top, bottom) = (&self.blocks[q][q], &self.blocks[1 - q][q]);
        let (upper, lower) = (top.left * top.mode, bottom.left * bottom.mode);
        let mut data = Vec::with_capacity((upper + lower) * top.right);
        for beta in 0..top.right {
            data.extend_from_slice(&top.data[upper * beta..upper * (beta + 1)]);
            data.extend_from_slice(&bottom.data[lower * beta..lower * (beta + 1)]);
        }
        Matrix::from_vec(upper + lower, top.right, data)
    }

    /// The inverse of [`GradedCore::left_unfolding`] for both parities; right ranks may be others than
    /// before.
    fn set_left_unfoldings(&mut self, unfoldings: &[Matrix; 2]) {
        for (q, unfolding) in unfoldings.iter().enumerate() {
            let mut first = 0;
            for p in [q, 1 - q] {
                let block = &mut self.blocks[p][q];
                let rows = block.left * block.mode;
                block.right = unfolding.columns();
                block.data = (0..block.right)
                    .flat_map(|beta| &unfolding.column(beta)[first..first + rows])
                    .copied()
                    .collect();
                first += rows;
            }
        }
    }

    /// The core over pairs (i, j), even indices of the bonds before odd ones.
    fn ungraded(&self, n: usize) -> Core {
        let [even, odd] = [&self.blocks[EVEN][EVEN], &self.blocks[ODD][ODD]];
        let mut core = Core::from_fn(even.left + odd.left, n * n, even.right + odd.right, |_, _, _| 0.0);
        for p in PARITIES {
            for q in PARITIES {
                let block = &self.blocks[p][q];
                let (alpha_first, beta_first) = (p * even.left, q * even.right);
                for (pair, &(i, j)) in pairs(n, p == q).iter().enumerate() {
                    for beta in 0..block.right {
                        for alpha in 0..block.left {
                            let x = block.get(alpha, pair, beta);
                            let mut set = |i: usize, j: usize, x: f64| {
                                let b = i + n * j + n * n * (beta_first + beta);
                                core.data[alpha_first + alpha + core.left * b] = x;
                            };
                            if i == j {
                                set(i, i, x);
                            } else {
                                set(i, j, FRAC_1_SQRT_2 * x);
                                set(j, i, if p == q { FRAC_1_SQRT_2 * x } else { -FRAC_1_SQRT_2 * x });
                            }
                        }
                    }
                }
            }
        }
        core
    }
}

/// Leading left singular vectors of the even and the odd unfolding of a bond within the share of the budget.
fn leading_of_both(unfoldings: &[Matrix; 2], budget: &mut Budget) -> Result<[Matrix; 2], DenseError> {
    let [even, odd] = unfoldings;
    if even.columns() + odd.columns() <= budget.max_rank()
        && let Some(even) = all_columns(even, budget.share())
        && let Some(odd) = all_columns(odd, budget.share())
    {
        budget.charge(0.0);
        return Ok([even, odd]);
    }
    let mut vectors = [Matrix::zeros(0, 0), Matrix::zeros(0, 0)];
    let mut squares: Vec<(f64, usize)> = Vec::new();
    for q in PARITIES {
        let (u, s) = left_svd(unfoldings[q].view())?;
        vectors[q] = u;
        squares.extend(s.iter().map(|s| (s * s, q)));
    }
    squares.sort_by(|a, b| b.0.total_cmp(&a.0));
    let rank = budget.rank(&squares.iter().map(|s| s.0).collect::<Vec<_>>());
    for q in PARITIES {
        vectors[q].truncate_columns(squares[..rank].iter().filter(|s| s.1 == q).count());
    }
    Ok(vectors)
}

/// The pairs (i, j), i <= j, whose basis matrices are e_i e_i^T and (e_i e_j^T + e_j e_i^T) / sqrt(2); or
/// those, i < j, of (e_i e_j^T - e_j e_i^T) / sqrt(2).
fn pairs(n: usize, symmetric: bool) -> Vec<(usize, usize)> {
    (0..n).flat_map(|j| (0..j + usize::from(symmetric)).map(move |i| (i, j))).collect()
}

/// The number of [`pairs`] (saturating: a stored size may be anything).
fn num_pairs(n: usize, symmetric: bool) -> usize {
    let both = if symmetric { n.saturating_add(1) } else { n.saturating_sub(1) };
    n.saturating_mul(both) / 2
}

/// The binary exponent of the largest number of all parts; none if all are zero.
fn joint_exponent<'a>(parts: impl Iterator<Item = &'a [f64]>) -> Result<Option<i32>, DenseError> {
    let mut largest = 0.0;
    for part in parts {
        largest = largest_finite(part)?.max(largest);
    }
    Ok((largest > 0.0).then(|| binary_exponent(largest)))
}
