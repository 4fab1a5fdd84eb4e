//! The lowest eigenpairs of a symmetric matrix by two-site sweeps (DMRG; White, Phys. Rev. Lett. 69, 1992), one after the other.
//!
//! Two neighbouring cores at a time minimise the Rayleigh quotient, all others being orthogonal; the rank between them follows from an SVD. Vectors already
//! found are moved to the other end of the spectrum: A + s sum v v^T. Nothing is claimed from the sweeps: the residual ||A v - mu v|| of what is
//! returned comes from the trains, and for a symmetric matrix some eigenvalue lies within it of mu.

use super::interface::{
    BlockCore, Interface, LocalOperator, OperatorCore, local_right_hand_side, push_right_hand_side,
};
use crate::cores::Sum;
use crate::error::at_core;
use crate::product::Product;
use crate::random::Random;
use crate::round::{norm_and_rounding, scaled_rows};
use crate::vector::Core;
use crate::{Truncation, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{DenseError, Matrix, Svd, product, symmetric_eigen, thin_qr, thin_svd};
use serde::{Deserialize, Serialize};

/// Local problems up to this size are solved densely.
const DENSE: usize = 300;
/// Random directions per bond in the first sweeps, and the number of these (even).
const KICK: usize = 3;
const KICKS: usize = 6;
/// Steps of one Lanczos run, and runs per local problem.
const LANCZOS: (usize, usize) = (40, 3);

/// Settings of [`lowest_eigenpairs`].
///
/// ```
/// let settings = graintrain_tt::solve::EigenSettings::default();
/// assert_eq!((settings.tolerance, settings.max_rank, settings.max_sweeps, settings.seed), (1e-8, 200, 30, 1));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EigenSettings {
    /// Residual ||A v - mu v|| aimed at for ||v|| = 1, relative to the largest eigenvalue that the sweeps met.
    pub tolerance: f64,
    /// No rank above this.
    pub max_rank: usize,
    /// Most sweeps per vector (in one direction each; at least 8, of which the first 6 are given random directions).
    pub max_sweeps: usize,
    /// Seed of the starts.
    pub seed: u64,
}

impl Default for EigenSettings {
    fn default() -> Self {
        Self { tolerance: 1e-8, max_rank: 200, max_sweeps: 30, seed: 1 }
    }
}

/// A vector of norm 1 and what is known about it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Eigenpair {
    /// The Rayleigh quotient v^T A v.
    pub value: f64,
    /// v.
    pub vector: TtVector,
    /// ||A v - value v||, from the trains: an eigenvalue lies within it of `value`.
    pub residual: f64,
    /// What rounding leaves uncertain about the residual.
    pub floor: f64,
    /// Whether the residual is at most the tolerance times the largest eigenvalue met.
    pub converged: bool,
    /// Sweeps made.
    pub sweeps: usize,
}

/// The `count` lowest eigenvalues of a symmetric matrix with their vectors, in ascending order of what was found. That no lower one was missed is not
/// certified: a sweep may end in a vector that is not the lowest.
///
/// O(sweeps d (n^2 r^3 R + n^3 r^2 R^2)) per vector and Lanczos step.
///
/// # Errors
/// [`TtError::Shape`] if A is not square, [`TtError::Setting`] if it is not symmetric (to 1e-10) or for a bad setting, [`TtError::Dense`] for entries that
/// are not finite.
///
/// ```
/// use graintrain_tt::{qtt, solve};
/// let pairs = solve::lowest_eigenpairs(&qtt::laplacian(8)?, 2, &Default::default())?;
/// for (k, pair) in pairs.iter().enumerate() {
///     let exact = 4.0 * (std::f64::consts::PI * (k + 1) as f64 / (2.0 * 257.0)).sin().powi(2);
///     assert!((pair.value - exact).abs() < 1e-10 && pair.converged);
/// }
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn lowest_eigenpairs(
    a: &TtMatrix,
    count: usize,
    settings: &EigenSettings,
) -> Result<Vec<Eigenpair>, TtError> {
    a.check_square()?;
    Truncation::capped(settings.tolerance, settings.max_rank).check()?;
    if a.relative_distance(&a.transpose())? > 1e-10 {
        return Err(TtError::Setting {
            what: "||A - A^T|| / ||A||",
            need: "at most 1e-10",
            got: a.relative_distance(&a.transpose())?,
        });
    }
    let size: f64 = a.rows.iter().map(|&n| n as f64).product();
    let mut found: Vec<Eigenpair> = Vec::new();
    let mut largest = f64::NEG_INFINITY;
    while found.len() < count && (found.len() as f64) < size {
        let pair = next_pair(a, &found, &mut largest, settings)?;
        found.push(pair);
    }
    found.sort_by(|x, y| x.value.total_cmp(&y.value));
    Ok(found)
}

/// The state of the sweeps for one vector; always from the first core to the last, trains are turned afterwards.
struct Sweeps {
    a: Vec<OperatorCore>,
    turned_a: Vec<OperatorCore>,
    x: Vec<BlockCore>,
    /// Vectors to be orthogonal to, in both directions.
    known: Vec<(Vec<BlockCore>, Vec<BlockCore>)>,
    right: Vec<Sides>,
    /// Sweeps that still get random directions.
    kicks: usize,
    random: Random,
}

/// One side of a site: of the operator, and with every known vector.
#[derive(Clone)]
struct Sides {
    operator: Interface,
    known: Vec<Matrix>,
}

impl Sides {
    fn one(known: usize) -> Self {
        Self { operator: Interface::one(), known: vec![Matrix::identity(1); known] }
    }

    fn push<'a>(&self, a: &OperatorCore, x: &BlockCore, known: impl Iterator<Item = &'a BlockCore>) -> Self {
        let known = self.known.iter().zip(known).map(|(phi, v)| push_right_hand_side(phi, x, v)).collect();
        Self { operator: self.operator.push(x, a, x), known }
    }
}

fn blocks(train: &TtVector) -> Vec<BlockCore> {
    let block = |core: &Core| BlockCore {
        left: core.left,
        n: core.mode,
        s: 1,
        right: core.right,
        data: core.data.clone(),
    };
    train.cores.iter().map(block).collect()
}

impl Sweeps {
    fn new(a: &TtMatrix, x: &TtVector, known: &[Eigenpair], seed: u64) -> Self {
        let d = a.num_cores();
        let core = |k: usize| {
            let core = &a.cores()[k];
            OperatorCore::new(core.left, a.rows[k], core.right, &core.data)
        };
        let operators: Vec<OperatorCore> = (0..d).map(core).collect();
        let turned_a: Vec<OperatorCore> = operators.iter().rev().map(OperatorCore::reversed).collect();
        let known: Vec<(Vec<BlockCore>, Vec<BlockCore>)> =
            known.iter().map(|pair| (blocks(&pair.vector), blocks(&pair.vector.reverse()))).collect();
        let mut x = x.clone();
        x.orthogonalise_right();
        let x = blocks(&x);
        let mut right = vec![Sides::one(known.len()); d];
        for k in (1..d).rev() {
            let turned = known.iter().map(|(_, turned)| &turned[d - 1 - k]);
            right[k - 1] = right[k].push(&turned_a[d - 1 - k], &x[k].reversed(), turned);
        }
        Self { a: operators, turned_a, x, known, right, kicks: KICKS, random: Random::new(seed) }
    }

    /// One sweep; the lowest and the largest local eigenvalue met, the lowest of the last site. `shift` moves the known vectors away.
    fn sweep(&mut self, shift: f64, settings: &EigenSettings, largest: &mut f64) -> Result<f64, TtError> {
        let d = self.x.len();
        let mut left = vec![Sides::one(self.known.len())];
        let mut lowest = 0.0;
        for k in 0..d - 1 {
            let (core, right) = (self.a[k].merge(&self.a[k + 1]), &self.right[k + 1]);
            let operator = LocalOperator { left: &left[k].operator, core: &core, right: &right.operator };
            let pair = self.x[k].merge(&self.x[k + 1]);
            let away: Vec<Vec<f64>> = (0..self.known.len())
                .map(|v| {
                    let known = &self.known[v].0;
                    local_right_hand_side(&left[k].known[v], &known[k].merge(&known[k + 1]), &right.known[v])
                })
                .collect();
            let local = lowest_of(&operator, &away, shift, &pair.spectator_last()).map_err(at_core(k))?;
            (lowest, *largest) = (local.lowest, largest.max(local.largest));
            let block = BlockCore::from_spectator_last(pair.left, pair.n, 1, pair.right, &local.vector);
            let (first, second) = (self.x[k].clone(), self.x[k + 1].clone());
            let Svd { mut u, s, v } = thin_svd(block.split(&first, &second).view()).map_err(at_core(k))?;
            let share = (0.1 * settings.tolerance).powi(2) / d as f64;
            let (mut rank, mut tail) = (s.len(), 0.0);
            while rank > 1 && (tail + s[rank - 1].powi(2) <= share || rank > settings.max_rank) {
                tail += s[rank - 1].powi(2);
                rank -= 1;
            }
            u.truncate_columns(rank);
            let mut carry = scaled_rows(&s, &v, rank);
            if self.kicks > 0 {
                (u, carry) = self.kicked(u, &carry);
            }
            let rank = u.columns();
            self.x[k] = BlockCore { right: rank, data: u.into_vec(), ..first };
            self.x[k + 1] = BlockCore { left: rank, data: carry.into_vec(), ..second };
            let next = left[k].push(&self.a[k], &self.x[k], self.known.iter().map(|known| &known.0[k]));
            left.push(next);
        }
        self.x = self.x.iter().rev().map(BlockCore::reversed).collect();
        std::mem::swap(&mut self.a, &mut self.turned_a);
        self.known.iter_mut().for_each(|(one, other)| std::mem::swap(one, other));
        self.kicks = self.kicks.saturating_sub(1);
        // Sides of the turned trains: what was left of core k is right of it.
        self.right = left.into_iter().rev().collect();
        Ok(lowest)
    }

    /// The frame with random columns beside it, which weigh nothing: a vector whose factors are eigenvectors themselves is stationary for sweeps that see
    /// nothing else, however high its eigenvalue.
    fn kicked(&mut self, frame: Matrix, weights: &Matrix) -> (Matrix, Matrix) {
        let (rows, rank) = (frame.rows(), frame.columns());
        let more = KICK.min(rows - rank);
        let mut joined = frame.into_vec();
        joined.extend((0..rows * more).map(|_| self.random.symmetric()));
        let (q, r) = thin_qr(Matrix::from_vec(rows, rank + more, joined));
        let first = Matrix::from_fn(r.rows(), rank, |i, j| r[(i, j)]);
        (q, product(first.view(), weights.view()))
    }

    fn vector(&self) -> TtVector {
        let core = |x: &BlockCore| Core { left: x.left, mode: x.n, right: x.right, data: x.data.clone() };
        TtVector { cores: self.x.iter().map(core).collect() }
    }
}

/// The next vector above those found.
fn next_pair(
    a: &TtMatrix,
    found: &[Eigenpair],
    largest: &mut f64,
    settings: &EigenSettings,
) -> Result<Eigenpair, TtError> {
    let start = TtVector::random(&a.rows, 2, settings.seed.wrapping_add(found.len() as u64))?;
    if a.num_cores() == 1 {
        return single_core(a, found.len(), settings);
    }
    let start = start.scale(1.0 / start.norm());
    let mut sweeps = Sweeps::new(a, &start, found, settings.seed);
    let lowest_found = found.iter().map(|pair| pair.value).fold(f64::INFINITY, f64::min);
    let (mut made, mut best): (usize, Option<Eigenpair>) = (0, None);
    let mut last = f64::INFINITY;
    while made < settings.max_sweeps.max(KICKS + 2) {
        let shift =
            if found.is_empty() { 0.0 } else { 2.0 * (*largest - lowest_found).max(f64::MIN_POSITIVE) };
        let value = sweeps.sweep(shift, settings, largest)?;
        made += 1;
        let moved = (value - last).abs();
        last = value;
        // Two sweeps bring the train back into its own order.
        if made % 2 == 1
            || made <= KICKS
            || (moved > 1e-3 * settings.tolerance * largest.abs() && made + 1 < settings.max_sweeps)
        {
            continue;
        }
        let pair = measure(a, sweeps.vector(), *largest, made, settings)?;
        let stuck = best.as_ref().is_some_and(|best| pair.residual > 0.5 * best.residual);
        let converged = pair.converged;
        if best.as_ref().is_none_or(|best| pair.residual < best.residual) {
            best = Some(pair);
        }
        if converged || stuck {
            break;
        }
    }
    match best {
        Some(best) => Ok(Eigenpair { sweeps: made, ..best }),
        None => measure(a, sweeps.vector(), *largest, made, settings),
    }
}

/// The pair that belongs to a vector.
fn measure(
    a: &TtMatrix,
    vector: TtVector,
    largest: f64,
    sweeps: usize,
    settings: &EigenSettings,
) -> Result<Eigenpair, TtError> {
    let vector = vector.scale(1.0 / vector.norm());
    let value = vector.dot(&a.times_vector(&vector)?)?;
    let spectators = vec![1; a.num_cores()];
    let image = Product { a, x: &vector, spectators: &spectators };
    let (residual, rounding, power) =
        norm_and_rounding(&Sum { terms: vec![(1.0, &image), (-value, &vector)] })?;
    let unit = (power as f64).exp2();
    let (residual, floor) = (residual * unit, rounding * unit);
    let converged = residual <= settings.tolerance * largest.abs().max(value.abs());
    Ok(Eigenpair { value, vector, residual, floor, converged, sweeps })
}

/// A matrix of one core has no neighbours: its eigenvectors are those of its numbers.
fn single_core(a: &TtMatrix, nth: usize, settings: &EigenSettings) -> Result<Eigenpair, TtError> {
    let (values, vectors) = symmetric_eigen(a.to_full()?.into_matrix().view()).map_err(at_core(0))?;
    let vector = TtVector::rank_one(&[vectors.column(nth).to_vec()])?;
    measure(a, vector, values[values.len() - 1], 0, settings)
}

/// The lowest eigenvector of a local problem, its value and the largest one met.
struct Local {
    vector: Vec<f64>,
    lowest: f64,
    largest: f64,
}

/// Of B + shift sum b b^T, from the current vector.
fn lowest_of(
    operator: &LocalOperator<'_>,
    away: &[Vec<f64>],
    shift: f64,
    start: &[f64],
) -> Result<Local, DenseError> {
    let n = operator.size();
    if n <= DENSE {
        let mut matrix = operator.to_matrix();
        // The largest eigenvalue of A itself, before known vectors are moved beyond it.
        let largest = if away.is_empty() {
            f64::NEG_INFINITY
        } else {
            (0..n).map(|i| matrix[(i, i)]).fold(f64::NEG_INFINITY, f64::max)
        };
        for b in away {
            for j in 0..n {
                for i in 0..n {
                    matrix[(i, j)] += shift * b[i] * b[j];
                }
            }
        }
        let (values, vectors) = symmetric_eigen(matrix.view())?;
        let largest = if away.is_empty() { values[n - 1] } else { largest };
        return Ok(Local { vector: vectors.column(0).to_vec(), lowest: values[0], largest });
    }
    let apply = |u: &[f64]| {
        let mut result = vec![0.0; n];
        operator.apply(u, &mut result);
        for b in away {
            let weight = shift * dot(b, u);
            result.iter_mut().zip(b).for_each(|(r, b)| *r += weight * b);
        }
        result
    };
    let mut current = Local { vector: start.to_vec(), lowest: f64::INFINITY, largest: f64::NEG_INFINITY };
    let mut random = Random::new(n as u64);
    for _ in 0..LANCZOS.1 {
        let before = current.lowest;
        let length = dot(&current.vector, &current.vector).sqrt();
        let first = if length > 0.0 {
            current.vector.iter().map(|x| x / length).collect()
        } else {
            let noise: Vec<f64> = (0..n).map(|_| random.symmetric()).collect();
            let length = dot(&noise, &noise).sqrt();
            noise.iter().map(|x| x / length).collect()
        };
        let mut basis: Vec<Vec<f64>> = vec![first];
        let mut projected = Matrix::zeros(LANCZOS.0, LANCZOS.0);
        let mut steps = 0;
        while steps < LANCZOS.0 {
            let mut next = apply(&basis[steps]);
            // Against all before, twice: short runs, and ghosts would be costly.
            for _ in 0..2 {
                for (i, v) in basis.iter().enumerate() {
                    let weight = dot(v, &next);
                    next.iter_mut().zip(v).for_each(|(x, v)| *x -= weight * v);
                    if i < LANCZOS.0 {
                        projected[(i, steps)] += weight;
                    }
                }
            }
            steps += 1;
            let length = dot(&next, &next).sqrt();
            let size = projected[(steps - 1, steps - 1)].abs().max(f64::MIN_POSITIVE);
            if length <= 1e-14 * size || steps == LANCZOS.0 {
                break;
            }
            basis.push(next.iter().map(|x| x / length).collect());
        }
        let small = Matrix::from_fn(steps, steps, |i, j| projected[(i.min(j), i.max(j))]);
        let (values, vectors) = symmetric_eigen(small.view())?;
        let mut vector = vec![0.0; n];
        for (weight, v) in vectors.column(0).iter().zip(&basis) {
            vector.iter_mut().zip(v).for_each(|(x, v)| *x += weight * v);
        }
        let largest = if away.is_empty() { values[steps - 1] } else { current.largest };
        current = Local { vector, lowest: values[0], largest };
        if (before - values[0]).abs() <= 1e-14 * values[0].abs().max(largest.abs()) {
            break;
        }
    }
    Ok(current)
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
