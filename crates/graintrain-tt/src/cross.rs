//! Cross interpolation: a train from some of the entries, AMEn-cross.
//!
//! With left index sets I_k and right index sets J_k, core k is the block A(I_{k-1}, i_k, J_k) in coordinates in which
//! the train reproduces the tensor on these fibres; rows of maximal volume (maxvol) give the next index set. A second,
//! small pair of index sets samples the residual and enriches the sets (Dolgov and Savostyanov, 2014, and `amen_cross`
//! of TT-Toolbox).
//!
//! Everything the method learns comes from the entries it reads: where the tensor vanishes on all of them it cannot
//! know. So the result carries an error measured on entries the method did not choose: random ones and, where the
//! caller has them, `probes` (for a sparse matrix its nonzeros). Points with large error become pivots of the next
//! sweep. `Converged` means that the measured errors are below the tolerance, nothing else. For sparse matrices prefer
//! [`crate::sparse`]: it sees every entry.

use crate::error::at_core;
use crate::maxvol::maxvol;
use crate::random::Random;
use crate::scale::{binary_exponent, largest_finite, scale_by_power, share_power};
use crate::sparse::QuadtreeMatrix;
use crate::vector::{Core, admissible_ranks, check_index};
use crate::{TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{Matrix, product, thin_qr, thin_svd};
use serde::{Deserialize, Serialize};

/// Entries of a tensor on demand, many at a time.
pub trait EntrySource: Sync {
    /// Mode sizes.
    fn modes(&self) -> Vec<usize>;

    /// Writes the entries at `indices` (d indices per entry, one entry after the other) to `values`.
    fn entries(&self, indices: &[usize], values: &mut [f64]);
}

/// A function of one multi-index as an [`EntrySource`].
#[derive(Clone, Debug)]
pub struct Function<F> {
    modes: Vec<usize>,
    function: F,
}

impl<F: Fn(&[usize]) -> f64 + Sync> Function<F> {
    /// The tensor of these modes with entries `function(index)`.
    pub fn new(modes: &[usize], function: F) -> Self {
        Self { modes: modes.to_vec(), function }
    }
}

impl<F: Fn(&[usize]) -> f64 + Sync> EntrySource for Function<F> {
    fn modes(&self) -> Vec<usize> {
        self.modes.clone()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        for (index, value) in indices.chunks_exact(self.modes.len()).zip(values) {
            *value = (self.function)(index);
        }
    }
}

/// A sparse matrix over paired modes n_1^2, 4, ..., 4.
impl EntrySource for QuadtreeMatrix {
    fn modes(&self) -> Vec<usize> {
        QuadtreeMatrix::modes(self).iter().map(|n| n * n).collect()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        let sizes = QuadtreeMatrix::modes(self);
        for (index, value) in indices.chunks_exact(sizes.len()).zip(values) {
            let (mut row, mut column, mut step) = (0, 0, 1);
            for (b, n) in index.iter().zip(&sizes) {
                row += step * (b % n);
                column += step * (b / n);
                step *= n;
            }
            *value = self.entry(row, column);
        }
    }
}

/// Settings of [`cross`].
///
/// ```
/// let settings = graintrain_tt::cross::CrossSettings::default();
/// assert_eq!((settings.tolerance, settings.max_sweeps, settings.kick_rank, settings.samples), (1e-6, 30, 4, 2000));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CrossSettings {
    /// Relative error aimed at, in the l2 norm over the sample points.
    pub tolerance: f64,
    /// No rank of the result above this.
    pub max_rank: usize,
    /// Most sweeps (in one direction each).
    pub max_sweeps: usize,
    /// Residual directions added per bond and sweep.
    pub kick_rank: usize,
    /// Random entries for the error estimate.
    pub samples: usize,
    /// Seed of the random start and of the samples.
    pub seed: u64,
}

impl Default for CrossSettings {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_rank: usize::MAX, max_sweeps: 30, kick_rank: 4, samples: 2000, seed: 1 }
    }
}

/// More samples than this do not fit in memory.
const MOST_SAMPLES: usize = 1 << 24;

/// Why the sweeps ended. Only the first says that the measured error is below the tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CrossStatus {
    /// Increments and all measured errors are below the tolerance.
    Converged,
    /// The increments are below the tolerance, but all entries of the independent sample are zero, so nothing is known
    /// about the error: give probes.
    Unverified,
    /// The cap on the ranks keeps the error above the tolerance.
    RankCapped,
    /// More sweeps no longer lower the error.
    Stagnated,
    /// Out of sweeps.
    SweepLimit,
    /// Every entry the method read is zero: start from a train or probes where the tensor is not zero.
    ZeroSampled,
}

/// What [`cross`] did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CrossReport {
    /// Why it ended.
    pub status: CrossStatus,
    /// ||A - train|| / ||A|| over random entries that the method did not choose; none if A vanishes on all of them.
    pub sampled_error: Option<f64>,
    /// The same over the caller's probes; none if there are none or A vanishes on them.
    pub probe_error: Option<f64>,
    /// The same over ALL entries, relative to the norm of a sparse matrix without its dummies: known to [`cross_sparse`]
    /// alone; none below 1e-7, which it cannot resolve.
    pub exact_error: Option<f64>,
    /// Entries evaluated, samples included.
    pub evaluations: usize,
    /// Sweeps made.
    pub sweeps: usize,
    /// Largest relative change of a core in every sweep. Small increments alone prove nothing.
    pub history: Vec<f64>,
    /// Ranks of the result.
    pub ranks: Vec<usize>,
}

impl CrossReport {
    /// The error over all entries where it is known, else the larger of the measured ones.
    pub fn error(&self) -> Option<f64> {
        let measured = [self.sampled_error, self.probe_error].into_iter().flatten().reduce(f64::max);
        self.exact_error.or(measured)
    }
}

/// AMEn-cross from a source of entries.
///
/// Of `start` only the index sets survive (its rows of maximal volume), not its values; without it, random rank 2.
/// `probes` holds d indices per point.
///
/// # Errors
/// [`TtError::Shape`] or [`TtError::Index`] for a start or probes that do not fit, [`TtError::Setting`] for a bad
/// setting, [`TtError::Dense`] if an entry is not finite. Not converging is not an error: see [`CrossReport::status`].
///
/// ```
/// use graintrain_tt::cross::{CrossSettings, CrossStatus, Function, cross};
/// // 1 / (1 + i_1 + ... + i_6) on 16^6 points.
/// let source = Function::new(&[16; 6], |index| 1.0 / (1.0 + index.iter().sum::<usize>() as f64));
/// let settings = CrossSettings { tolerance: 1e-7, ..Default::default() };
/// let (train, report) = cross(&source, None, &[], &settings)?;
/// assert_eq!(report.status, CrossStatus::Converged);
/// assert!((train.entry(&[3, 1, 4, 1, 5, 9])? - 1.0 / 24.0).abs() < 1e-7);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn cross(
    source: &dyn EntrySource,
    start: Option<&TtVector>,
    probes: &[usize],
    settings: &CrossSettings,
) -> Result<(TtVector, CrossReport), TtError> {
    crate::Truncation::capped(settings.tolerance, settings.max_rank).check()?;
    let modes = source.modes();
    let zero = TtVector::constant(&modes, 0.0)?;
    let d = modes.len();
    for (what, value) in [("samples", settings.samples), ("kick_rank", settings.kick_rank)] {
        if value > MOST_SAMPLES {
            return Err(TtError::Setting { what, need: "at most 2^24", got: value as f64 });
        }
    }
    if !probes.len().is_multiple_of(d) {
        return Err(TtError::Shape {
            what: "indices per probe",
            expected: vec![d],
            got: vec![probes.len() % d],
        });
    }
    probes.chunks_exact(d).try_for_each(|probe| check_index(&modes, probe))?;
    let start = match start {
        Some(start) => {
            zero.check_same_modes(start)?;
            start.clone()
        }
        None => TtVector::random(&modes, 2, settings.seed)?,
    };
    let mut random = Random::new(settings.seed ^ 0x5EED);
    let mut points = || (0..settings.samples * d).map(|p| random.below(modes[p % d])).collect();
    // The worst points of the guide become pivots, so it cannot measure the error: the sample does.
    let (mut guide, mut sample) = (Sample::new(source, points()), Sample::new(source, points()));
    let mut probe = Sample::new(source, probes.to_vec());
    // All values in units of the largest one seen so far (a power of two): squares neither overflow nor vanish.
    let exponent = binary_exponent(sample.largest()?.max(probe.largest()?).max(guide.largest()?));
    for points in [&mut guide, &mut sample, &mut probe] {
        points.scale(-exponent);
    }
    let mut state = State::new(source, &start, settings, random, exponent)?;
    state.evaluations += guide.values.len() + sample.values.len() + probe.values.len();
    let mut history: Vec<f64> = Vec::new();
    let mut errors: Vec<f64> = Vec::new();
    let mut status = CrossStatus::SweepLimit;
    let mut capped = false;
    let mut before_cleaning = None;
    while history.len() < settings.max_sweeps.max(2) {
        // The last sweep allowed does not enrich, so that the ranks obey the cap.
        let enrich = history.len() + 1 < settings.max_sweeps.max(2);
        let outcome = state.sweep(settings, enrich)?;
        history.push(outcome.change);
        capped = outcome.capped;
        if state.largest == 0.0 && [&guide, &sample, &probe].iter().all(|points| points.norm == 0.0) {
            status = CrossStatus::ZeroSampled;
            break;
        }
        let train = state.train();
        let worst = |points: &Sample| points.error(&train, settings.kick_rank.max(1));
        let (guided, probed, sampled) = (worst(&guide)?, worst(&probe)?, sample.error(&train, 0)?.0);
        let error = [sampled, probed.0].into_iter().flatten().reduce(f64::max);
        errors.push(error.unwrap_or(outcome.change));
        if outcome.change <= settings.tolerance && error.is_none_or(|error| error <= settings.tolerance) {
            status = if error.is_some() { CrossStatus::Converged } else { CrossStatus::Unverified };
            before_cleaning = (train.max_rank() <= settings.max_rank).then_some(train);
            break;
        }
        let n = errors.len();
        if n > 4 && errors[n - 1] > 0.7 * errors[n - 4] && (capped || n > 8) {
            status = if capped { CrossStatus::RankCapped } else { CrossStatus::Stagnated };
            break;
        }
        // Points with the largest error become pivots of the residual.
        state.add_pivots(&[guided.1, probed.1].concat());
    }
    if status != CrossStatus::ZeroSampled && state.enriched {
        capped |= state.sweep(settings, false)?.capped;
    }
    let measure = |train: &TtVector| -> Result<_, TtError> {
        let (sampled, probed) = (sample.error(train, 0)?.0, probe.error(train, 0)?.0);
        Ok((sampled, probed, [sampled, probed].into_iter().flatten().reduce(f64::max)))
    };
    let mut train = state.train();
    let (mut sampled_error, mut probe_error, mut error) = measure(&train)?;
    if let (Some(longer), true) = (before_cleaning, error.is_some_and(|error| error > settings.tolerance)) {
        // Shortening cost more than the tolerance: keep the longer train.
        (sampled_error, probe_error, error) = measure(&longer)?;
        train = longer;
    }
    if status == CrossStatus::Converged && error.is_none_or(|error| error > settings.tolerance) {
        status = if capped { CrossStatus::RankCapped } else { CrossStatus::Stagnated };
    } else if status == CrossStatus::SweepLimit && capped {
        status = CrossStatus::RankCapped;
    }
    share_power(&mut train.cores, i64::from(exponent));
    let report = CrossReport {
        status,
        sampled_error,
        probe_error,
        exact_error: None,
        evaluations: state.evaluations,
        sweeps: history.len(),
        history,
        ranks: train.ranks(),
    };
    Ok((train, report))
}

/// [`QuadtreeMatrix::relative_error`] is a difference of squares and knows nothing below this.
const RESOLVED_ERROR: f64 = 1e-7;

/// AMEn-cross of a sparse matrix, with its nonzeros (every `stride`-th) as probes and the identity as default start.
///
/// The report holds the error over all entries, O(nnz d r^2).
///
/// A comparison method: the exact pass [`QuadtreeMatrix::to_train`] is better in every respect.
///
/// # Errors
/// As for [`cross`].
pub fn cross_sparse(
    matrix: &QuadtreeMatrix,
    start: Option<&TtMatrix>,
    stride: usize,
    settings: &CrossSettings,
) -> Result<(TtMatrix, CrossReport), TtError> {
    let sizes = matrix.modes();
    let identity = TtMatrix::identity(&sizes)?;
    let mut probes = Vec::new();
    for (row, column, _) in matrix.entries().step_by(stride.max(1)) {
        identity.push_pair_index(row, column, &mut probes)?;
    }
    let start = start.unwrap_or(&identity);
    identity.check_same_sizes(start)?;
    let (train, mut report) = cross(matrix, Some(start.as_vector()), &probes, settings)?;
    let train = TtMatrix::from_vector(train, &sizes, &sizes)?;
    // Random points of a sparse matrix hit its zeros, and what a train puts there is very uneven: a few thousand of them
    // tell its norm only within a factor of some units. The nonzeros and the norm of the train tell it exactly.
    report.exact_error = Some(matrix.relative_error(&train)?).filter(|&error| error >= RESOLVED_ERROR);
    if report.status == CrossStatus::Converged && report.exact_error.is_some_and(|e| e > settings.tolerance) {
        report.status = CrossStatus::Stagnated;
    }
    Ok((train, report))
}

/// Entries set aside for measuring the error.
struct Sample {
    points: Vec<usize>,
    values: Vec<f64>,
    norm: f64,
    modes: usize,
}

impl Sample {
    fn new(source: &dyn EntrySource, points: Vec<usize>) -> Self {
        let modes = source.modes().len();
        let mut values = vec![0.0; points.len() / modes];
        source.entries(&points, &mut values);
        Self { points, norm: norm(&values), values, modes }
    }

    fn largest(&self) -> Result<f64, TtError> {
        largest_finite(&self.values).map_err(at_core(0))
    }

    fn scale(&mut self, power: i32) {
        scale_by_power(&mut self.values, power);
        self.norm = norm(&self.values);
    }

    /// The relative error of the train and the `count` points with the largest errors.
    fn error(&self, train: &TtVector, count: usize) -> Result<(Option<f64>, Vec<Vec<usize>>), TtError> {
        if self.values.is_empty() {
            return Ok((None, Vec::new()));
        }
        let approximate = train.entries(&self.points)?;
        let errors: Vec<f64> = approximate.iter().zip(&self.values).map(|(a, b)| (a - b).abs()).collect();
        let error = errors.iter().map(|x| x * x).sum::<f64>().sqrt() / self.norm;
        let mut order: Vec<usize> = (0..errors.len()).filter(|&p| errors[p] > 0.0).collect();
        order.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]).then(a.cmp(&b)));
        order.truncate(count);
        let worst =
            order.iter().map(|&p| self.points[p * self.modes..(p + 1) * self.modes].to_vec()).collect();
        Ok(((self.norm > 0.0).then_some(error), worst))
    }
}

#[derive(Clone, Copy, Default)]
struct SweepOutcome {
    change: f64,
    capped: bool,
}

/// Index sets and cores, always swept from the first mode of the current direction to the last.
///
/// `right[k]` holds the fragments (i_{k+1}, ..., i_d) of J_k, each in the order of the current direction.
struct State<'a> {
    source: &'a dyn EntrySource,
    modes: Vec<usize>,
    reversed: bool,
    /// Core 1 in any form, cores 2..d interpolating on the right: the identity on the pivots.
    cores: Vec<Core>,
    right: Vec<Vec<Vec<usize>>>,
    residual_right: Vec<Vec<Vec<usize>>>,
    random: Random,
    /// Entries are taken times 2^-exponent.
    exponent: i32,
    evaluations: usize,
    /// Largest entry seen.
    largest: f64,
    enriched: bool,
}

impl<'a> State<'a> {
    fn new(
        source: &'a dyn EntrySource,
        start: &TtVector,
        settings: &CrossSettings,
        mut random: Random,
        exponent: i32,
    ) -> Result<Self, TtError> {
        let modes = source.modes();
        let d = modes.len();
        let mut cores = start.cores().to_vec();
        let mut right = vec![vec![Vec::new()]; d];
        for k in (1..d).rev() {
            let core = &cores[k];
            let turned =
                Matrix::from_vec(core.left(), core.mode() * core.right(), core.data().to_vec()).transposed();
            let (q, r) = thin_qr(turned);
            let (rows, b) = maxvol(&q).map_err(at_core(k))?;
            let (mode, rank) = (core.mode(), core.right());
            right[k - 1] = rows.iter().map(|&row| prepend(row % mode, &right[k][row / mode])).collect();
            let pivots = Matrix::from_fn(rows.len(), rows.len(), |i, j| q[(rows[i], j)]);
            // core^T = q r = b pivots r
            let carry = product(pivots.view(), r.view());
            cores[k] = Core::from_right_unfolding(mode, rank, b.transposed());
            cores[k - 1] = cores[k - 1].multiply_right(carry.t());
        }
        let ranks = admissible_ranks(&modes, settings.kick_rank.max(1));
        let residual_right = (0..d)
            .map(|k| {
                (0..ranks[k + 1]).map(|_| modes[k + 1..].iter().map(|&n| random.below(n)).collect()).collect()
            })
            .collect();
        // Values of the start are not entries of the tensor: only its index sets are kept.
        cores[0].data.fill(0.0);
        Ok(Self {
            source,
            modes,
            reversed: false,
            cores,
            right,
            residual_right,
            random,
            exponent,
            evaluations: 0,
            largest: 0.0,
            enriched: false,
        })
    }

    /// A(left, i, right) for all combinations, left fastest.
    fn block(&mut self, left: &[Vec<usize>], k: usize, right: &[Vec<usize>]) -> Result<Matrix, TtError> {
        let (d, n) = (self.modes.len(), self.modes[k]);
        let mut indices = Vec::with_capacity(left.len() * n * right.len() * d);
        for tail in right {
            for i in 0..n {
                for head in left {
                    let at = indices.len();
                    indices.extend_from_slice(head);
                    indices.push(i);
                    indices.extend_from_slice(tail);
                    if self.reversed {
                        indices[at..].reverse();
                    }
                }
            }
        }
        let mut values = vec![0.0; left.len() * n * right.len()];
        self.source.entries(&indices, &mut values);
        scale_by_power(&mut values, -self.exponent);
        self.evaluations += values.len();
        self.largest = self.largest.max(largest_finite(&values).map_err(at_core(k))?);
        Ok(Matrix::from_vec(left.len() * n, right.len(), values))
    }

    /// G_{k+1}(i_{k+1}) ... G_d(i_d) for every fragment: rank x fragments.
    fn evaluate_right(&self, k: usize, fragments: &[Vec<usize>]) -> Matrix {
        let mut result = Matrix::zeros(self.cores[k].right(), fragments.len());
        for (f, fragment) in fragments.iter().enumerate() {
            let mut column = vec![1.0];
            for (core, &i) in self.cores[k + 1..].iter().zip(fragment).rev() {
                let slice = core.slice(i);
                column = (0..core.left())
                    .map(|alpha| column.iter().enumerate().map(|(beta, x)| slice.get(alpha, beta) * x).sum())
                    .collect();
            }
            let rows = column.len();
            result.data_mut()[f * rows..(f + 1) * rows].copy_from_slice(&column);
        }
        result
    }

    fn sweep(&mut self, settings: &CrossSettings, enrich: bool) -> Result<SweepOutcome, TtError> {
        let d = self.modes.len();
        let mut outcome = SweepOutcome::default();
        let mut left: Vec<Vec<Vec<usize>>> = vec![vec![Vec::new()]];
        let mut residual_left: Vec<Vec<Vec<usize>>> = vec![vec![Vec::new()]];
        // Values of the left part of the train at the residual's left fragments.
        let mut left_values = Matrix::identity(1);
        self.enriched = enrich && settings.kick_rank > 0;
        for k in 0..d {
            let right = self.right[k].clone();
            let block = self.block(&left[k], k, &right)?;
            let size = norm(block.data());
            let change = distance(block.data(), self.cores[k].data());
            if size > 0.0 || change > 0.0 {
                outcome.change = outcome.change.max(change / size.max(f64::MIN_POSITIVE));
            }
            let (rank_left, mode) = (left[k].len(), self.modes[k]);
            if k + 1 == d {
                self.cores[k] = Core::from_left_unfolding(rank_left, mode, block);
                break;
            }
            let svd = thin_svd(block.view()).map_err(at_core(k))?;
            // Interpolation enlarges what a site discards: a fifth of its share leaves room for that.
            let share = 0.2 * settings.tolerance / (d as f64).sqrt() * size;
            let mut rank = tail_rank(&svd.s, share);
            outcome.capped |= rank > settings.max_rank;
            rank = rank.min(settings.max_rank);
            let weight = crate::round::scaled_rows(&svd.s, &svd.v, rank);
            let mut frame = svd.u;
            frame.truncate_columns(rank);
            if self.enriched {
                let kept = product(frame.view(), weight.view());
                let fragments = self.residual_right[k].clone();
                let right_values = self.evaluate_right(k, &fragments);
                // Residual on (I, i, J_z): directions to add.
                let mut extra = self.block(&left[k], k, &fragments)?;
                let known = product(kept.view(), right_values.view());
                subtract(&mut extra, known.data());
                // Residual on (I_z, i, J_z): the next left fragments of the residual.
                let mut own = self.block(&residual_left[k], k, &fragments)?;
                let carried = Core { left: rank_left, mode, right: fragments.len(), data: known.into_vec() }
                    .multiply_left(left_values.view());
                subtract(&mut own, carried.data());
                let (rows, next) = self.residual_rows(own, &residual_left[k], mode, settings, k)?;
                let directions = leading(&extra, settings.kick_rank).map_err(at_core(k))?;
                let columns = frame.columns() + directions.columns();
                let height = frame.rows();
                let mut joined = frame.into_vec();
                joined.extend_from_slice(directions.data());
                frame = Matrix::from_vec(height, columns, joined);
                residual_left.push(next);
                self.finish_site(k, frame, weight, rank, &mut left)?;
                // Left values at the new residual fragments.
                let core = &self.cores[k];
                let moved = core.multiply_left(left_values.view());
                let old = residual_left[k].len();
                left_values = Matrix::from_fn(rows.len(), core.right(), |row, beta| {
                    moved.get(rows[row] % old, rows[row] / old, beta)
                });
            } else {
                self.finish_site(k, frame, weight, rank, &mut left)?;
                residual_left.push(self.random_fragments(k, settings.kick_rank.max(1)));
            }
        }
        self.turn(left, residual_left);
        Ok(outcome)
    }

    /// QR, rows of maximal volume, and what is left over into the next core.
    fn finish_site(
        &mut self,
        k: usize,
        frame: Matrix,
        weight: Matrix,
        rank: usize,
        left: &mut Vec<Vec<Vec<usize>>>,
    ) -> Result<(), TtError> {
        let rank_left = left[k].len();
        let (q, r) = thin_qr(frame);
        let (rows, b) = maxvol(&q).map_err(at_core(k))?;
        let pivots = Matrix::from_fn(rows.len(), rows.len(), |i, j| q[(rows[i], j)]);
        let first = Matrix::from_fn(r.rows(), rank, |i, j| r[(i, j)]);
        let carry = product(product(pivots.view(), first.view()).view(), weight.view());
        self.cores[k] = Core::from_left_unfolding(rank_left, self.modes[k], b);
        self.cores[k + 1] = self.cores[k + 1].multiply_left(carry.view());
        let next = rows.iter().map(|&row| append(&left[k][row % rank_left], row / rank_left)).collect();
        left.push(next);
        Ok(())
    }

    /// Rows of the residual block that span it, with some random directions mixed in.
    fn residual_rows(
        &mut self,
        own: Matrix,
        left: &[Vec<usize>],
        mode: usize,
        settings: &CrossSettings,
        k: usize,
    ) -> Result<(Vec<usize>, Vec<Vec<usize>>), TtError> {
        let height = own.rows();
        let kept = leading(&own, settings.kick_rank).map_err(at_core(k))?;
        let limit = admissible_ranks(&self.modes, settings.kick_rank + settings.kick_rank.div_ceil(2))[k + 1];
        let columns = limit.min(height).max(1);
        let mut data = kept.into_vec();
        data.truncate(height * columns);
        while data.len() < height * columns {
            data.push(self.random.symmetric());
        }
        let (q, _) = thin_qr(Matrix::from_vec(height, columns, data));
        let (rows, _) = maxvol(&q).map_err(at_core(k))?;
        debug_assert_eq!(height, left.len() * mode);
        let next = rows.iter().map(|&row| append(&left[row % left.len()], row / left.len())).collect();
        Ok((rows, next))
    }

    /// Random left fragments (i_1, ..., i_{k+1}).
    fn random_fragments(&mut self, k: usize, count: usize) -> Vec<Vec<usize>> {
        let count = admissible_ranks(&self.modes, count)[k + 1];
        (0..count).map(|_| (0..=k).map(|m| self.random.below(self.modes[m])).collect()).collect()
    }

    /// Adds the fragments of full points to the right sets of the residual.
    fn add_pivots(&mut self, points: &[Vec<usize>]) {
        let d = self.modes.len();
        for point in points {
            let mut point = point.clone();
            if self.reversed {
                point.reverse();
            }
            for k in 0..d - 1 {
                let fragment = point[k + 1..].to_vec();
                if !self.residual_right[k].contains(&fragment) && !self.right[k].contains(&fragment) {
                    self.residual_right[k].push(fragment);
                }
            }
        }
    }

    /// Reverses the direction: left sets become right sets.
    fn turn(&mut self, left: Vec<Vec<Vec<usize>>>, residual_left: Vec<Vec<Vec<usize>>>) {
        let turned = |sets: Vec<Vec<Vec<usize>>>| -> Vec<Vec<Vec<usize>>> {
            let reverse = |set: Vec<Vec<usize>>| {
                set.into_iter().map(|fragment| fragment.into_iter().rev().collect()).collect()
            };
            sets.into_iter().rev().map(reverse).collect()
        };
        self.right = turned(left);
        self.residual_right = turned(residual_left);
        self.modes.reverse();
        let cores = std::mem::take(&mut self.cores);
        self.cores = TtVector { cores }.reverse().cores;
        self.reversed = !self.reversed;
    }

    /// The train in the order of the source.
    fn train(&self) -> TtVector {
        let train = TtVector { cores: self.cores.clone() };
        if self.reversed { train.reverse() } else { train }
    }
}

fn prepend(i: usize, tail: &[usize]) -> Vec<usize> {
    std::iter::once(i).chain(tail.iter().copied()).collect()
}

fn append(head: &[usize], i: usize) -> Vec<usize> {
    head.iter().copied().chain(std::iter::once(i)).collect()
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn distance(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt()
}

fn subtract(from: &mut Matrix, what: &[f64]) {
    from.data_mut().iter_mut().zip(what).for_each(|(a, b)| *a -= b);
}

/// Rank whose discarded singular values stay below `share` in the l2 norm; at least 1.
fn tail_rank(s: &[f64], share: f64) -> usize {
    let (mut rank, mut tail) = (s.len(), 0.0);
    while rank > 1 && (tail + s[rank - 1].powi(2) <= share * share || s[rank - 1] <= 1e-16 * s[0]) {
        tail += s[rank - 1].powi(2);
        rank -= 1;
    }
    rank
}

/// At most `count` leading left singular vectors that are not of rounding size.
fn leading(a: &Matrix, count: usize) -> Result<Matrix, graintrain_linalg::dense::DenseError> {
    let svd = thin_svd(a.view())?;
    let useful = svd.s.iter().take_while(|&&s| s > 1e-15 * svd.s[0] && s > 0.0).count();
    let mut u = svd.u;
    u.truncate_columns(useful.min(count));
    Ok(u)
}
