//! Sums of products of local operators as TT-matrices of the smallest ranks: Hamiltonians of chains, master
//! equations, stencils.
//!
//! H = sum_t w_t O_{t,1} (x) ... (x) O_{t,d}: a term has operators at some sites and the identity at all
//! others. At the bond after site k its unfolding is sum over (l, r) gamma(l, r) L_l R_r with the different
//! strings L_l of operators left of the bond and R_r right of it. Strings of linearly independent operators
//! are linearly independent, so the rank of H at the bond is that of the small matrix gamma (C. Hubig, I.
//! McCulloch, U. Schollwoeck, Phys. Rev. B 95, 2017; J. Ren, W. Li, T. Jiang, Z. Shuai, J. Chem. Phys. 153,
//! 2020).
//!
//! Site by site from the left, the rows of gamma are (state so far, operator here) and its columns the
//! strings that are left to come. Rows that depend on others to 16 eps of their own length become
//! combinations of them; where that is ill-conditioned (long couplings by a power of the distance) singular
//! vectors of the rows, brought to length one, take their place. So a weight of 1e-15 beside one of 1 is not
//! lost. Local operators that depend on each other (Sx beside S+ and S-) are found by a last pass over the
//! cores.

use crate::error::at_core;
use crate::factor::interpolative_rows;
use crate::round::scaled_rows;
use crate::scale::largest_finite;
use crate::vector::{Core, LARGEST_CORE};
use crate::{FullMatrix, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{DenseError, Matrix, Svd, thin_svd};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};

/// Operators of a site that have names: spins s = (n - 1) / 2 with the state of the largest Sz first, and
/// oscillators with at most n - 1 quanta, the empty state first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LocalOperator {
    /// 1.
    Identity,
    /// S+ = Sx + i Sy, sqrt(s (s + 1) - m (m + 1)) from m to m + 1.
    #[serde(alias = "S+")]
    SPlus,
    /// S- = Sx - i Sy.
    #[serde(alias = "S-")]
    SMinus,
    /// Sx = (S+ + S-) / 2.
    Sx,
    /// i Sy = (S+ - S-) / 2, which is real: Sy Sy = -(i Sy)(i Sy).
    ISy,
    /// Sz, diagonal: s, s - 1, ..., -s.
    Sz,
    /// a, sqrt(i) from i quanta to i - 1.
    #[serde(alias = "A")]
    Annihilate,
    /// The transpose of a.
    #[serde(alias = "A+")]
    Create,
    /// The number of quanta, diagonal: 0, 1, ..., n - 1.
    #[serde(alias = "N")]
    Number,
}

impl LocalOperator {
    /// The n x n matrix.
    ///
    /// # Errors
    /// [`TtError::Setting`] for n = 0, [`TtError::TooLarge`] for more than 2^28 numbers.
    ///
    /// ```
    /// use graintrain_tt::operator_sum::LocalOperator;
    /// assert_eq!(LocalOperator::SPlus.matrix(2)?.data(), [0.0, 0.0, 1.0, 0.0]); // from down (1) to up (0)
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn matrix(self, n: usize) -> Result<FullMatrix, TtError> {
        if n == 0 {
            return Err(TtError::Setting { what: "size of a site", need: "at least 1", got: 0.0 });
        }
        if n.saturating_mul(n) > LARGEST_CORE {
            return Err(TtError::TooLarge { entries: (n as f64).powi(2) });
        }
        let spin = 0.5 * (n - 1) as f64;
        let projection = |i: usize| spin - i as f64;
        let raising = |i: usize, j: usize| {
            let m = projection(j);
            if i + 1 == j { (spin * (spin + 1.0) - m * (m + 1.0)).sqrt() } else { 0.0 }
        };
        let lowering_quanta = |i: usize, j: usize| if i + 1 == j { (j as f64).sqrt() } else { 0.0 };
        let entry = |i: usize, j: usize| match self {
            Self::Identity => f64::from(i == j),
            Self::SPlus => raising(i, j),
            Self::SMinus => raising(j, i),
            Self::Sx => 0.5 * (raising(i, j) + raising(j, i)),
            Self::ISy => 0.5 * (raising(i, j) - raising(j, i)),
            Self::Sz if i == j => projection(i),
            Self::Number if i == j => i as f64,
            Self::Sz | Self::Number => 0.0,
            Self::Annihilate => lowering_quanta(i, j),
            Self::Create => lowering_quanta(j, i),
        };
        FullMatrix::new(n, n, (0..n * n).map(|e| entry(e % n, e / n)).collect())
    }
}

/// Sites that are not the identity, ascending, with the number of their operator.
type Factors = Vec<(usize, usize)>;

/// A sum of products of local operators that is still symbolic.
///
/// ```
/// use graintrain_tt::operator_sum::{LocalOperator, OperatorSum};
/// // The Heisenberg chain sum_k S_k . S_{k+1} of 100 spins 1/2: ranks 5.
/// let [plus, minus, z] = [LocalOperator::SPlus.matrix(2)?, LocalOperator::SMinus.matrix(2)?, LocalOperator::Sz.matrix(2)?];
/// let mut chain = OperatorSum::new(&[2; 100])?;
/// chain.add_translates(0.5, &[&plus, &minus])?.add_translates(0.5, &[&minus, &plus])?.add_translates(1.0, &[&z, &z])?;
/// let h = chain.to_matrix()?;
/// assert_eq!(h.max_rank(), 5);
/// assert_eq!(h.entry(&[0; 100], &[0; 100])?, 99.0 / 4.0); // all spins up
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug)]
pub struct OperatorSum {
    modes: Vec<usize>,
    operators: Vec<FullMatrix>,
    /// Number of an operator by its size and the bits of its entries.
    known: HashMap<(usize, Vec<u64>), usize>,
    terms: Vec<(f64, Factors)>,
}

impl OperatorSum {
    /// The empty sum over sites of these sizes.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no site or one is empty, [`TtError::TooLarge`] for a site above 2^14.
    pub fn new(modes: &[usize]) -> Result<Self, TtError> {
        if modes.is_empty() || modes.contains(&0) {
            let got = modes.to_vec();
            return Err(TtError::Shape { what: "sizes of sites", expected: vec![1], got });
        }
        if let Some(&n) = modes.iter().find(|&&n| n.saturating_mul(n) > LARGEST_CORE) {
            return Err(TtError::TooLarge { entries: (n as f64).powi(2) });
        }
        let (operators, known, terms) = (Vec::new(), HashMap::new(), Vec::new());
        Ok(Self { modes: modes.to_vec(), operators, known, terms })
    }

    /// Sizes of the sites.
    pub fn modes(&self) -> &[usize] {
        &self.modes
    }

    /// Terms added so far.
    pub fn num_terms(&self) -> usize {
        self.terms.len()
    }

    /// Adds `weight` times the product of operators at sites, in any order; several at one site are
    /// multiplied as they are written, no factor at all is the identity.
    ///
    /// # Errors
    /// [`TtError::Index`] for a site that does not exist, [`TtError::Shape`] for an operator of another size
    /// than its site, [`TtError::Setting`] or [`TtError::Dense`] for numbers that are not finite; the sum is
    /// then as before.
    pub fn add(&mut self, weight: f64, factors: &[(usize, &FullMatrix)]) -> Result<&mut Self, TtError> {
        if !weight.is_finite() {
            return Err(TtError::Setting { what: "weight of a term", need: "finite", got: weight });
        }
        let mut at_sites: BTreeMap<usize, FullMatrix> = BTreeMap::new();
        for &(site, operator) in factors {
            let Some(&n) = self.modes.get(site) else {
                return Err(TtError::Index { mode: 0, index: site, size: self.modes.len() });
            };
            if (operator.rows(), operator.columns()) != (n, n) {
                let got = vec![operator.rows(), operator.columns()];
                return Err(TtError::Shape { what: "operator at a site", expected: vec![n, n], got });
            }
            largest_finite(operator.data()).map_err(at_core(site))?;
            let product = match at_sites.remove(&site) {
                Some(before) => times(&before, operator)?,
                None => operator.clone(),
            };
            at_sites.insert(site, product);
        }
        let mut term = Factors::new();
        for (site, operator) in at_sites {
            if operator != LocalOperator::Identity.matrix(self.modes[site])? {
                term.push((site, self.number(operator)));
            }
        }
        self.terms.push((weight, term));
        Ok(self)
    }

    /// Adds `weight` times the product of operators at neighbouring sites k, k + 1, ..., for every k where
    /// they fit.
    ///
    /// # Errors
    /// As for [`OperatorSum::add`], and [`TtError::Shape`] for no operator or more of them than sites.
    pub fn add_translates(&mut self, weight: f64, factors: &[&FullMatrix]) -> Result<&mut Self, TtError> {
        let (length, sites) = (factors.len(), self.modes.len());
        if length == 0 || length > sites {
            let (what, expected) = ("operators at neighbouring sites, at most", vec![sites]);
            return Err(TtError::Shape { what, expected, got: vec![length] });
        }
        let before = self.terms.len();
        for first in 0..=sites - length {
            let placed: Vec<_> = factors.iter().enumerate().map(|(k, &factor)| (first + k, factor)).collect();
            if let Err(error) = self.add(weight, &placed).map(|_| ()) {
                self.terms.truncate(before);
                return Err(error);
            }
        }
        Ok(self)
    }

    /// The number of an operator, a new one if it was not met before.
    fn number(&mut self, operator: FullMatrix) -> usize {
        // (0.0 and -0.0 are the same number.)
        let bits = operator.data().iter().map(|x| (x + 0.0).to_bits()).collect();
        let next = self.operators.len();
        let number = *self.known.entry((operator.rows(), bits)).or_insert(next);
        if number == next {
            self.operators.push(operator);
        }
        number
    }

    /// The TT-matrix, site 1 the finest digit, with the smallest ranks the sum allows. Exact: nothing is
    /// rounded away, so sums whose ranks are small only to a tolerance (power laws) are to be rounded
    /// afterwards. O(sum over bonds of (r m)^2 t) for ranks r, m different operators at a site and t terms.
    ///
    /// # Errors
    /// [`TtError::TooLarge`] if (rank x operators) x terms of a bond exceeds 2^28.
    pub fn to_matrix(&self) -> Result<TtMatrix, TtError> {
        let mut merged: BTreeMap<&[(usize, usize)], f64> = BTreeMap::new();
        self.terms.iter().for_each(|(weight, term)| *merged.entry(term).or_default() += weight);
        merged.retain(|_, weight| *weight != 0.0);
        if merged.is_empty() {
            return Ok(TtMatrix::identity(&self.modes)?.scale(0.0));
        }
        let mut coming: Vec<&[(usize, usize)]> = merged.keys().copied().collect();
        let total: Vec<f64> = merged.values().copied().collect();
        let mut weights = Matrix::from_vec(1, total.len(), total);
        let mut cores = Vec::with_capacity(self.modes.len());
        for (site, &n) in self.modes.iter().enumerate() {
            let bond = Bond::after(site, &coming, &weights)?;
            let last = site + 1 == self.modes.len();
            let (states, next) = if last {
                (bond.gamma, Matrix::identity(1))
            } else {
                bond.states().map_err(at_core(site))?
            };
            let operator = |number: Option<usize>, i: usize, j: usize| {
                number.map_or(f64::from(i == j), |number| self.operators[number][(i, j)])
            };
            let left = weights.rows();
            cores.push(Core::from_fn(left, n * n, states.columns(), |alpha, b, beta| {
                let sum = |(o, &number): (usize, &Option<usize>)| {
                    let weight = states[(alpha + left * o, beta)];
                    // (Most are zero, and an infinite product of large ones is not to become NaN beside
                    // them.)
                    if weight == 0.0 { 0.0 } else { weight * operator(number, b % n, b / n) }
                };
                bond.operators.iter().enumerate().map(sum).sum()
            }));
            coming = bond.coming;
            weights = next;
        }
        let train = TtVector::from_cores(cores)?.without_dependent_ranks();
        TtMatrix::from_vector(train, &self.modes, &self.modes)
    }
}

/// A B.
fn times(a: &FullMatrix, b: &FullMatrix) -> Result<FullMatrix, TtError> {
    let n = a.rows();
    let entry = |e: usize| (0..n).map(|k| a[(e % n, k)] * b[(k, e / n)]).sum();
    FullMatrix::new(n, n, (0..n * n).map(entry).collect())
}

/// What passes from the sites up to one to those after it.
struct Bond<'a> {
    /// Operators at the site, none for the identity.
    operators: Vec<Option<usize>>,
    /// The different strings after the site.
    coming: Vec<&'a [(usize, usize)]>,
    /// (state before the site, operator) x string after it, the state fastest.
    gamma: Matrix,
}

impl<'a> Bond<'a> {
    /// From the strings `coming` at and after the site and their `weights` (state x string).
    fn after(site: usize, coming: &[&'a [(usize, usize)]], weights: &Matrix) -> Result<Self, TtError> {
        let mut operators: Vec<Option<usize>> = Vec::new();
        let mut place: HashMap<&[(usize, usize)], usize> = HashMap::new();
        let mut after: Vec<&'a [(usize, usize)]> = Vec::new();
        let mut moves = Vec::with_capacity(coming.len());
        for &string in coming {
            let (number, rest) = match string.split_first() {
                Some((&(at, number), rest)) if at == site => (Some(number), rest),
                _ => (None, string),
            };
            let row = operators.iter().position(|&known| known == number).unwrap_or_else(|| {
                operators.push(number);
                operators.len() - 1
            });
            let column = *place.entry(rest).or_insert_with(|| {
                after.push(rest);
                after.len() - 1
            });
            moves.push((row, column));
        }
        let (states, rows) = (weights.rows(), weights.rows() * operators.len());
        if rows.saturating_mul(after.len()) > LARGEST_CORE {
            return Err(TtError::TooLarge { entries: rows as f64 * after.len() as f64 });
        }
        let mut gamma = Matrix::zeros(rows, after.len());
        for (string, &(row, column)) in moves.iter().enumerate() {
            (0..states).for_each(|state| gamma[(state + states * row, column)] += weights[(state, string)]);
        }
        Ok(Self { operators, coming: after, gamma })
    }

    /// gamma = C R: the rows (state before, operator) as combinations of the states after the site, and what
    /// these have to come. Block by block, so that no weight is measured by one it has nothing to do with.
    fn states(&self) -> Result<(Matrix, Matrix), DenseError> {
        let (rows, columns) = (self.gamma.rows(), self.gamma.columns());
        let blocks = self.blocks();
        let factors: Vec<(Matrix, Matrix)> = blocks
            .iter()
            .map(|(of_rows, of_columns)| {
                factors(&Matrix::from_fn(of_rows.len(), of_columns.len(), |i, j| {
                    self.gamma[(of_rows[i], of_columns[j])]
                }))
            })
            .collect::<Result<_, _>>()?;
        let states = factors.iter().map(|(_, rest)| rest.rows()).sum();
        let (mut combinations, mut rest) = (Matrix::zeros(rows, states), Matrix::zeros(states, columns));
        let mut first = 0;
        for ((of_rows, of_columns), (c, r)) in blocks.iter().zip(&factors) {
            for state in 0..r.rows() {
                of_rows
                    .iter()
                    .enumerate()
                    .for_each(|(i, &row)| combinations[(row, first + state)] = c[(i, state)]);
                of_columns
                    .iter()
                    .enumerate()
                    .for_each(|(j, &column)| rest[(first + state, column)] = r[(state, j)]);
            }
            first += r.rows();
        }
        Ok((combinations, rest))
    }

    /// Rows and columns of gamma that are joined by nonzeros, each set ascending and in the order of its
    /// first row.
    fn blocks(&self) -> Vec<(Vec<usize>, Vec<usize>)> {
        let (rows, columns) = (self.gamma.rows(), self.gamma.columns());
        let (mut row_is_new, mut column_is_new) = (vec![true; rows], vec![true; columns]);
        let mut blocks = Vec::new();
        for start in 0..rows {
            let (mut of_rows, mut of_columns) = (Vec::new(), Vec::new());
            let mut open = if row_is_new[start] { vec![start] } else { Vec::new() };
            row_is_new[start] = false;
            while let Some(row) = open.pop() {
                of_rows.push(row);
                for column in 0..columns {
                    if self.gamma[(row, column)] != 0.0
                        && std::mem::replace(&mut column_is_new[column], false)
                    {
                        of_columns.push(column);
                        open.extend((0..rows).filter(|&other| {
                            self.gamma[(other, column)] != 0.0
                                && std::mem::replace(&mut row_is_new[other], false)
                        }));
                    }
                }
            }
            // (A row of zeros is no state.)
            if !of_columns.is_empty() {
                of_rows.sort_unstable();
                of_columns.sort_unstable();
                blocks.push((of_rows, of_columns));
            }
        }
        blocks
    }
}

/// C and R with A = C R and as few rows of R as A has ranks: rows of A themselves where they are well enough
/// conditioned, else its right singular vectors.
fn factors(a: &Matrix) -> Result<(Matrix, Matrix), DenseError> {
    let (m, n) = (a.rows(), a.columns());
    if let Some((kept, combinations)) = interpolative_rows(a) {
        return Ok((combinations, Matrix::from_fn(kept.len(), n, |state, j| a[(kept[state], j)])));
    }
    // Rows brought to length one: a small weight is no small rank. No row is zero.
    let length = |i: usize| (0..n).fold(0.0_f64, |length, j| length.hypot(a[(i, j)]));
    let lengths: Vec<f64> = (0..m).map(length).collect();
    let Svd { u, s, v } = thin_svd(Matrix::from_fn(m, n, |i, j| a[(i, j)] / lengths[i]).view())?;
    let rank = s.iter().filter(|&&x| x > f64::EPSILON * m.max(n) as f64 * s[0]).count();
    Ok(if rank == m {
        (Matrix::identity(m), a.clone())
    } else if rank == n {
        (a.clone(), Matrix::identity(n))
    } else {
        (Matrix::from_fn(m, rank, |i, state| lengths[i] * u[(i, state)]), scaled_rows(&s, &v, rank))
    })
}
