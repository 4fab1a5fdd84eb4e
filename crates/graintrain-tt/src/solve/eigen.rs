//! The lowest eigenpairs of a symmetric matrix, all at once, in one train: block DMRG (White, Phys. Rev.
//! Lett. 69, 1992; Dolgov, Khoromskij, Oseledets, Savostyanov, Comput. Phys. Commun. 185, 2014) and block
//! AMEn.
//!
//! All vectors share the frames of a block train; the core that is being improved carries their number as one
//! more index, which moves along with the sweep. The sum of the Rayleigh quotients is minimised over two
//! neighbouring cores ([`EigenMethod::Dmrg`], the rank between them from an SVD) or over one
//! ([`EigenMethod::Amen`], frames enriched by residuals, which are kept in a small train of their own).
//! Eigenvalues that lie close together, or on each other, come out as a block.
//!
//! Nothing is claimed from the sweeps: the residual ||A v - mu v|| of what is returned comes from the trains,
//! and for a symmetric matrix some eigenvalue lies within it of mu.

use super::davidson::{Lowest, lowest_of};
use super::interface::{
    BlockCore, Interface, LocalOperator, OperatorCore, local_right_hand_side, push_right_hand_side,
};
use crate::cores::Sum;
use crate::error::at_core;
use crate::product::Product;
use crate::random::Random;
use crate::round::{norm_and_rounding, scaled_rows};
use crate::vector::Core;
use crate::{Stop, Truncation, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{Matrix, Svd, View, product, symmetric_eigen, thin_qr, thin_svd};
use serde::{Deserialize, Serialize};

/// Vectors at most: a block carries all of them in one core.
const MOST_VECTORS: usize = 4096;
/// Directions per bond that a sweep adds: random ones in the first sweeps of DMRG, residuals in all but the
/// last of AMEn.
const KICK: usize = 4;
/// Sweeps of DMRG that get random directions (even).
const KICKS: usize = 6;

/// How the ranks of the eigenvectors grow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum EigenMethod {
    /// Two cores at a time.
    Dmrg,
    /// One core at a time, enriched by the residuals: cheaper where modes are large.
    Amen,
}

/// Settings of [`lowest_eigenpairs`].
///
/// ```
/// let settings = graintrain_tt::solve::EigenSettings::default();
/// assert_eq!((settings.tolerance, settings.max_rank, settings.max_sweeps, settings.seed), (1e-8, 200, 40, 1));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EigenSettings {
    /// Residual ||A v - mu v|| aimed at for ||v|| = 1, relative to the largest eigenvalue that the sweeps
    /// met.
    pub tolerance: f64,
    /// No rank of the block above this (nor of a vector).
    pub max_rank: usize,
    /// Most sweeps (in one direction each; at least 8, of which the first 6 of DMRG are given random
    /// directions).
    pub max_sweeps: usize,
    /// How ranks grow.
    pub method: EigenMethod,
    /// Seed of the starts.
    pub seed: u64,
}

impl Default for EigenSettings {
    fn default() -> Self {
        Self { tolerance: 1e-8, max_rank: 200, max_sweeps: 40, method: EigenMethod::Dmrg, seed: 1 }
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

/// The `count` lowest eigenvalues of a symmetric matrix with their vectors (fewer if it is smaller), in
/// ascending order. That no lower one was missed is not certified: sweeps may end in vectors that are not the
/// lowest.
///
/// O(sweeps d (n^2 r^3 R + n^3 r^2 R^2)) per vector and step of the local iteration, r the rank of the block.
///
/// # Errors
/// [`TtError::Shape`] if A is not square, [`TtError::Setting`] if it is not symmetric (to 1e-10) or for a bad
/// setting, [`TtError::Dense`] for entries that are not finite.
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
    lowest_eigenpairs_within(a, count, settings, &|| false)
}

/// As [`lowest_eigenpairs`], as long as `stop` is false: it is asked at every site.
///
/// # Errors
/// As for [`lowest_eigenpairs`], and [`TtError::Stopped`].
pub fn lowest_eigenpairs_within(
    a: &TtMatrix,
    count: usize,
    settings: &EigenSettings,
    stop: Stop<'_>,
) -> Result<Vec<Eigenpair>, TtError> {
    a.check_square()?;
    Truncation::capped(settings.tolerance, settings.max_rank).check()?;
    let size: f64 = a.rows.iter().map(|&n| n as f64).product();
    let count = if size < count as f64 { size as usize } else { count };
    if count == 0 {
        return Ok(Vec::new());
    }
    if count > MOST_VECTORS {
        return Err(TtError::Setting {
            what: "number of eigenpairs",
            need: "at most 4096",
            got: count as f64,
        });
    }
    if a.as_vector().balanced()?.is_none() {
        return of_zero(a, count, settings);
    }
    let asymmetry = a.relative_distance(&a.transpose())?;
    if asymmetry > 1e-10 {
        return Err(TtError::Setting { what: "||A - A^T|| / ||A||", need: "at most 1e-10", got: asymmetry });
    }
    let mut found =
        if a.num_cores() == 1 { single_core(a, count, settings)? } else { block(a, count, settings, stop)? };
    found.sort_by(|x, y| x.value.total_cmp(&y.value));
    Ok(found)
}

/// Sweeps until all vectors have converged, or no longer come nearer; the best block of all sweeps.
fn block(
    a: &TtMatrix,
    count: usize,
    settings: &EigenSettings,
    stop: Stop<'_>,
) -> Result<Vec<Eigenpair>, TtError> {
    let mut sweeps = Sweeps::new(a, count, settings)?;
    let (mut made, mut best): (usize, Option<Vec<Eigenpair>>) = (0, None);
    let (mut last, mut worse) = (f64::INFINITY, 0);
    let worst = |pairs: &[Eigenpair]| pairs.iter().map(|pair| pair.residual).fold(0.0, f64::max);
    let most = settings.max_sweeps.max(KICKS + 2);
    while made < most {
        // Vectors are measured after sweeps without enrichment, in their own order: every second one once the
        // values stand still.
        let measured = made % 2 == 1 && made > KICKS;
        let still = made + 2 >= most || settings.method == EigenMethod::Dmrg;
        let values = sweeps.sweep(!(measured && still), settings, stop)?;
        made += 1;
        let moved = (values - last).abs();
        last = values;
        let quiet = moved <= 1e-3 * settings.tolerance * count as f64 * sweeps.largest.abs();
        if !measured || !(still || quiet) || (!quiet && made + 1 < most) {
            continue;
        }
        let pairs = sweeps.measured(a, made, settings)?;
        let done = pairs.iter().all(|pair| pair.converged);
        match &best {
            Some(before) if worst(&pairs) > 0.5 * worst(before) => worse += 1,
            _ => worse = 0,
        }
        if best.as_ref().is_none_or(|before| worst(&pairs) < worst(before)) {
            best = Some(pairs);
        }
        if done || worse == 2 {
            break;
        }
    }
    let best = match best {
        Some(best) => best,
        None => sweeps.measured(a, made, settings)?,
    };
    Ok(best.into_iter().map(|pair| Eigenpair { sweeps: made, ..pair }).collect())
}

/// The state of the sweeps; always from the first core to the last, trains are turned afterwards.
struct Sweeps {
    a: Vec<OperatorCore>,
    turned_a: Vec<OperatorCore>,
    /// The block train; the core at which a sweep begins carries the number of the vector as its spectator.
    x: Vec<BlockCore>,
    /// The train of the residuals (AMEn), one for all vectors.
    z: Vec<BlockCore>,
    right: Vec<Sides>,
    reversed: bool,
    /// Largest local eigenvalue met.
    largest: f64,
    random: Random,
    made: usize,
}

/// One side of a site: A between x and x and between z and x, and z times x.
#[derive(Clone)]
struct Sides {
    xx: Interface,
    zx: Interface,
    overlap: Matrix,
}

impl Sides {
    fn one() -> Self {
        Self { xx: Interface::one(), zx: Interface::one(), overlap: Matrix::identity(1) }
    }

    fn push(&self, a: &OperatorCore, x: &BlockCore, z: &BlockCore) -> Self {
        Self {
            xx: self.xx.push(x, a, x),
            zx: self.zx.push(z, a, x),
            overlap: push_right_hand_side(&self.overlap, z, x),
        }
    }
}

impl Sweeps {
    fn new(a: &TtMatrix, count: usize, settings: &EigenSettings) -> Result<Self, TtError> {
        let d = a.num_cores();
        let core = |k: usize| {
            let core = &a.cores()[k];
            OperatorCore::new(core.left, a.rows[k], core.right, &core.data)
        };
        let operators: Vec<OperatorCore> = (0..d).map(core).collect();
        let turned_a: Vec<OperatorCore> = operators.iter().rev().map(OperatorCore::reversed).collect();
        let mut random = Random::new(settings.seed);
        let train = |rank: usize, seed: u64| -> Result<Vec<BlockCore>, TtError> {
            let mut train = TtVector::random(&a.rows, rank, settings.seed.wrapping_add(seed))?;
            train.orthogonalise_right();
            let block = |core: &Core| {
                let Core { left, mode, right, data } = core.clone();
                BlockCore { left, n: mode, s: 1, right, data }
            };
            Ok(train.cores.iter().map(block).collect())
        };
        // Ranks in which as many vectors can differ.
        let mut x = train((count + 1).clamp(2, settings.max_rank.max(2)), 0)?;
        let z = train(KICK, 1)?;
        let (n, right) = (x[0].n, x[0].right);
        x[0] = BlockCore {
            left: 1,
            n,
            s: count,
            right,
            data: (0..n * count * right).map(|_| random.symmetric()).collect(),
        };
        let mut sides = vec![Sides::one(); d];
        for k in (1..d).rev() {
            sides[k - 1] = sides[k].push(&turned_a[d - 1 - k], &x[k].reversed(), &z[k].reversed());
        }
        let (reversed, largest, made) = (false, f64::NEG_INFINITY, 0);
        Ok(Self { a: operators, turned_a, x, z, right: sides, reversed, largest, random, made })
    }

    /// One sweep; the sum of the lowest local eigenvalues of its last site. `enrich` adds directions.
    fn sweep(&mut self, enrich: bool, settings: &EigenSettings, stop: Stop<'_>) -> Result<f64, TtError> {
        let d = self.x.len();
        let mut left = vec![Sides::one()];
        let mut sum = 0.0;
        let sites = if settings.method == EigenMethod::Dmrg { d - 1 } else { d };
        for k in 0..sites {
            crate::go_on(stop)?;
            sum = match settings.method {
                EigenMethod::Dmrg => self.pair(k, &left[k], enrich && self.made < KICKS, settings),
                EigenMethod::Amen => self.site(k, &left[k], enrich, settings),
            }?;
            if k + 1 < d {
                left.push(left[k].push(&self.a[k], &self.x[k], &self.z[k]));
            }
        }
        self.x = self.x.iter().rev().map(BlockCore::reversed).collect();
        self.z = self.z.iter().rev().map(BlockCore::reversed).collect();
        std::mem::swap(&mut self.a, &mut self.turned_a);
        // Sides of the turned trains: what was left of core k is right of it.
        self.right = left.into_iter().rev().collect();
        self.reversed = !self.reversed;
        self.made += 1;
        Ok(sum)
    }

    /// The lowest vectors of one local problem in place of `block`, and the sum of their values; zeros where
    /// it is too small for all.
    fn improved(
        &mut self,
        operator: &LocalOperator<'_>,
        block: &BlockCore,
        settings: &EigenSettings,
    ) -> Result<(BlockCore, Vec<f64>), graintrain_linalg::dense::DenseError> {
        let before = block.spectator_last();
        let starts: Vec<&[f64]> = before.chunks_exact(operator.size()).collect();
        let Lowest { vectors, mut values, largest } =
            lowest_of(operator, &starts, 0.05 * settings.tolerance)?;
        self.largest = self.largest.max(largest);
        let mut solved = vectors.concat();
        solved.resize(before.len(), 0.0);
        values.resize(block.s, 0.0);
        Ok((BlockCore::from_spectator_last(block.left, block.n, block.s, block.right, &solved), values))
    }

    /// Two cores at once.
    fn pair(&mut self, k: usize, left: &Sides, kick: bool, settings: &EigenSettings) -> Result<f64, TtError> {
        let (core, right) = (self.a[k].merge(&self.a[k + 1]), self.right[k + 1].clone());
        let operator = LocalOperator { left: &left.xx, core: &core, right: &right.xx };
        let (first, second) = (self.x[k].clone(), self.x[k + 1].clone());
        let (block, values) =
            self.improved(&operator, &first.merge(&second), settings).map_err(at_core(k))?;
        let (first, second) = (BlockCore { s: 1, ..first }, BlockCore { s: block.s, ..second });
        let (mut frame, mut weights) =
            truncated(&block.split(&first, &second), self.x.len(), block.s, settings).map_err(at_core(k))?;
        if kick {
            let more = KICK.min(frame.rows() - frame.columns());
            let random = Matrix::from_fn(frame.rows(), more, |_, _| self.random.symmetric());
            (frame, weights) = joined(frame, random.view(), &weights);
        }
        let rank = frame.columns();
        self.x[k] = BlockCore { right: rank, data: frame.into_vec(), ..first };
        self.x[k + 1] = BlockCore { left: rank, data: weights.into_vec(), ..second };
        Ok(values.iter().sum())
    }

    /// One core, its frame enriched by what the residuals of all vectors are in the frame of z.
    fn site(
        &mut self,
        k: usize,
        left: &Sides,
        enrich: bool,
        settings: &EigenSettings,
    ) -> Result<f64, TtError> {
        let right = self.right[k].clone();
        let core = self.a[k].clone();
        let operator = LocalOperator { left: &left.xx, core: &core, right: &right.xx };
        let current = self.x[k].clone();
        let (block, values) = self.improved(&operator, &current, settings).map_err(at_core(k))?;
        let sum = values.iter().sum();
        let BlockCore { left: rank_left, n, s, right: rank_right, .. } = block;
        if k + 1 == self.x.len() {
            self.x[k] = block;
            return Ok(sum);
        }
        // The number of the vector goes right with the right rank: it lies between mode and right rank in
        // memory.
        let unfolding = Matrix::from_vec(rank_left * n, s * rank_right, block.data.clone());
        let (mut frame, mut weights) =
            truncated(&unfolding, self.x.len(), s, settings).map_err(at_core(k))?;
        if enrich {
            let kept = product(frame.view(), weights.view()).into_vec();
            let kept = BlockCore { left: rank_left, n, s, right: rank_right, data: kept };
            let residual = |side: &Interface, one: &Matrix| {
                let mixed = LocalOperator { left: side, core: &core, right: &right.zx };
                let mut image = vec![0.0; mixed.result_size() * s];
                mixed.apply(&kept.spectator_last(), &mut image);
                let itself = local_right_hand_side(one, &kept, &right.overlap);
                let size = mixed.result_size();
                for (j, value) in values.iter().enumerate() {
                    let range = size * j..size * (j + 1);
                    image[range.clone()].iter_mut().zip(&itself[range]).for_each(|(r, x)| *r -= value * x);
                }
                Matrix::from_vec(side.test * n, right.zx.test * s, image)
            };
            let of_z = residual(&left.zx, &left.overlap);
            let leading = |matrix: Matrix, most: usize| -> Result<Matrix, TtError> {
                let Svd { mut u, .. } = thin_svd(matrix.view()).map_err(at_core(k))?;
                u.truncate_columns(most.min(u.columns()));
                Ok(u)
            };
            let q = leading(of_z, KICK)?;
            self.replace_z(k, q);
            let most = KICK.min(frame.rows() - frame.columns());
            let more = leading(residual(&left.xx, &Matrix::identity(rank_left)), most)?;
            (frame, weights) = joined(frame, more.view(), &weights);
        } else {
            let z = &self.z[k];
            let (rows, data) = (z.left * z.n, z.data.clone());
            let (q, _) = thin_qr(Matrix::from_vec(rows, z.right, data));
            self.replace_z(k, q);
        }
        let rank = frame.columns();
        self.x[k] = BlockCore { left: rank_left, n, s: 1, right: rank, data: frame.into_vec() };
        // Weights (rank x (s, beta)) times the next core, one vector after the other.
        let next = self.x[k + 1].clone();
        let parts: Vec<BlockCore> = (0..s)
            .map(|j| {
                next.multiply_left(View::with_stride(&weights.data()[rank * j..], rank, rank_right, rank * s))
            })
            .collect();
        let mut data = Vec::with_capacity(rank * next.n * s * next.right);
        for beta in 0..next.right {
            let range = rank * next.n * beta..rank * next.n * (beta + 1);
            parts.iter().for_each(|part| data.extend_from_slice(&part.data[range.clone()]));
        }
        self.x[k + 1] = BlockCore { left: rank, s, data, ..next };
        Ok(sum)
    }

    /// Core k of the residual train; the next one keeps its numbers, cut or filled to the new rank.
    fn replace_z(&mut self, k: usize, frame: Matrix) {
        let rank = frame.columns();
        self.z[k] = BlockCore { right: rank, data: frame.into_vec(), ..self.z[k] };
        let next = &self.z[k + 1];
        let random = &mut self.random;
        let data = (0..rank * next.n * next.right).map(|_| random.symmetric()).collect();
        self.z[k + 1] = BlockCore { left: rank, data, ..*next };
    }

    /// What is known about every vector of the block, in the order of the problem.
    fn measured(
        &self,
        a: &TtMatrix,
        made: usize,
        settings: &EigenSettings,
    ) -> Result<Vec<Eigenpair>, TtError> {
        let count = self.x[0].s;
        let first = self.x[0].spectator_last();
        let size = first.len() / count;
        let mut pairs = Vec::with_capacity(count);
        for vector in first.chunks_exact(size) {
            let mut cores: Vec<Core> = Vec::with_capacity(self.x.len());
            for (k, x) in self.x.iter().enumerate() {
                let data = if k == 0 { vector.to_vec() } else { x.data.clone() };
                cores.push(Core { left: x.left, mode: x.n, right: x.right, data });
            }
            let train = TtVector { cores };
            let train = if self.reversed { train.reverse() } else { train };
            let (train, _) =
                train.round(&Truncation::capped(0.02 * settings.tolerance, settings.max_rank))?;
            pairs.push(measure(a, train, self.largest, made, settings)?);
        }
        Ok(pairs)
    }
}

/// Leading left singular vectors of a block of `count` vectors of length one, and their weights.
fn truncated(
    unfolding: &Matrix,
    d: usize,
    count: usize,
    settings: &EigenSettings,
) -> Result<(Matrix, Matrix), graintrain_linalg::dense::DenseError> {
    let Svd { mut u, s, v } = thin_svd(unfolding.view())?;
    let share = (0.05 * settings.tolerance).powi(2) / d as f64;
    let (mut rank, mut tail) = (s.len(), 0.0);
    // (A vector of the block must not lose more than one alone would.)
    while rank > 1 && (tail + s[rank - 1].powi(2) <= share || rank > settings.max_rank.max(count.min(2))) {
        tail += s[rank - 1].powi(2);
        rank -= 1;
    }
    u.truncate_columns(rank);
    Ok((u, scaled_rows(&s, &v, rank)))
}

/// The frame with more columns beside it, which weigh nothing: a vector whose factors are eigenvectors
/// themselves is stationary for sweeps that see nothing else, however high its eigenvalue.
fn joined(frame: Matrix, more: View<'_>, weights: &Matrix) -> (Matrix, Matrix) {
    let (rows, rank) = (frame.rows(), frame.columns());
    let mut columns = frame.into_vec();
    columns.extend((0..more.columns()).flat_map(|j| (0..rows).map(move |i| more.get(i, j))));
    let (q, r) = thin_qr(Matrix::from_vec(rows, rank + more.columns(), columns));
    let first = Matrix::from_fn(r.rows(), rank, |i, j| r[(i, j)]);
    (q, product(first.view(), weights.view()))
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
fn single_core(a: &TtMatrix, count: usize, settings: &EigenSettings) -> Result<Vec<Eigenpair>, TtError> {
    let (values, vectors) = symmetric_eigen(a.to_full()?.into_matrix().view()).map_err(at_core(0))?;
    let pair = |nth: usize| {
        let vector = TtVector::rank_one(&[vectors.column(nth).to_vec()])?;
        measure(a, vector, values[values.len() - 1], 0, settings)
    };
    (0..count).map(pair).collect()
}

/// Every vector is an eigenvector of zero: the first unit vectors.
fn of_zero(a: &TtMatrix, count: usize, settings: &EigenSettings) -> Result<Vec<Eigenpair>, TtError> {
    let pair = |nth: usize| {
        let mut rest = nth;
        let digit = |&n: &usize| {
            let digit = rest % n;
            rest /= n;
            digit
        };
        let index: Vec<usize> = a.rows.iter().map(digit).collect();
        measure(a, TtVector::unit(&a.rows, &index)?, 0.0, 0, settings)
    };
    (0..count).map(pair).collect()
}
