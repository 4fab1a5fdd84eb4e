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

mod sample;
mod source;
mod sweep;

use crate::random::Random;
use crate::scale::{binary_exponent, share_power};
use crate::sparse::QuadtreeMatrix;
use crate::vector::check_index;
use crate::{TtError, TtMatrix, TtVector};
use graintrain_linalg::patience::Patience;
use sample::Sample;
use serde::{Deserialize, Serialize};
pub use source::{EntrySource, Function};
use sweep::State;

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
    cross_within(source, start, probes, settings, &Patience::default())
}

/// As [`cross`], as long as the patience lasts: it is asked at every site.
fn cross_within(
    source: &dyn EntrySource,
    start: Option<&TtVector>,
    probes: &[usize],
    settings: &CrossSettings,
    patience: &Patience,
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
        let outcome = state.sweep(settings, enrich, patience)?;
        history.push(outcome.change);
        capped = outcome.capped;
        if state.largest == 0.0 && [&guide, &sample, &probe].iter().all(|points| points.norm == 0.0) {
            status = CrossStatus::ZeroSampled;
            break;
        }
        let train = state.train();
        let worst = |points: &Sample| points.error(&train, settings.kick_rank.max(1));
        let (probed, sampled) = (worst(&probe)?, sample.error(&train, 0)?.0);
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
        state.add_pivots(&[worst(&guide)?.1, probed.1].concat());
    }
    if status != CrossStatus::ZeroSampled && state.enriched {
        capped |= state.sweep(settings, false, patience)?.capped;
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
    cross_sparse_within(matrix, start, stride, settings, &Patience::default())
}

/// As [`cross_sparse`], as long as the patience lasts: it is asked at every site.
///
/// # Errors
/// As for [`cross`], and [`TtError::Stopped`].
pub fn cross_sparse_within(
    matrix: &QuadtreeMatrix,
    start: Option<&TtMatrix>,
    stride: usize,
    settings: &CrossSettings,
    patience: &Patience,
) -> Result<(TtMatrix, CrossReport), TtError> {
    let sizes = matrix.modes();
    let identity = TtMatrix::identity(&sizes)?;
    let mut probes = Vec::new();
    for (row, column, _) in matrix.entries().step_by(stride.max(1)) {
        identity.push_pair_index(row, column, &mut probes)?;
    }
    let start = start.unwrap_or(&identity);
    identity.check_same_sizes(start)?;
    let (train, mut report) = cross_within(matrix, Some(start.as_vector()), &probes, settings, patience)?;
    let train = TtMatrix::from_vector(train, &sizes, &sizes)?;
    // Random points of a sparse matrix hit its zeros, and what a train puts there is very uneven: a few thousand of them
    // tell its norm only within a factor of some units. The nonzeros and the norm of the train tell it exactly.
    report.exact_error = Some(matrix.relative_error(&train)?).filter(|&error| error >= RESOLVED_ERROR);
    if report.status == CrossStatus::Converged && report.exact_error.is_some_and(|e| e > settings.tolerance) {
        report.status = CrossStatus::Stagnated;
    }
    Ok((train, report))
}
