//! Cross interpolation: a train from some of the entries, AMEn-cross.
//!
//! With left index sets I_k and right index sets J_k, core k is the block A(I_{k-1}, i_k, J_k) in coordinates
//! in which the train reproduces the tensor on these fibres; rows of maximal volume (maxvol) give the next
//! index set. A second, small pair of index sets samples the residual and enriches the sets (Dolgov and
//! Savostyanov, 2014, and `amen_cross` of TT-Toolbox).
//!
//! Everything the method learns comes from the entries it reads: where the tensor vanishes on all of them it
//! cannot know. So every train is measured on entries the method did not choose, drawn AFTER it was made: a
//! guide of random points after every sweep, whose worst ones become pivots of the next, and before
//! `Converged` a larger confirmation on points of its own. Points that have served are never used again.
//! Where errors proved to sit on few points (jumps), the confirmation grows with the entries read, up to all
//! of the tensor where it is small. Half of the points are uniform, half favour the ends of modes and coarse
//! sub-grids, with weights that keep the estimate unbiased. The caller may add `probes`: points he knows to
//! matter (for a sparse matrix its nonzeros), [`sub_grid`] and [`ends_of_modes`] for functions with jumps.
//!
//! `Converged` means that the error measured on fresh points, and on the probes, is at most the tolerance.
//! The report's `upper_bound` says what this excludes with 95 % confidence, which is much less: a needle that
//! no point hits is not seen by any sampling method. Where it does not even exclude an error of one (few
//! large entries, few nonzeros), more points are drawn as long as they are few beside what the sweeps read,
//! and what then still proves nothing is `Unverified`. Where the sweeps fail and have read as many entries as
//! there are, the train is the TT-SVD of all of them. For sparse matrices prefer [`crate::sparse`]: it sees
//! every entry.

mod confirmation;
mod points;
mod sample;
mod source;
mod sweep;

use crate::random::Random;
use crate::scale::share_power;
use crate::sparse::QuadtreeMatrix;
use crate::vector::check_index;
use crate::{Stop, Truncation, TtError, TtMatrix, TtVector};
use confirmation::{Confirmation, Evidence, Verdict};
pub use points::{ends_of_modes, sub_grid};
use serde::{Deserialize, Serialize};
use source::Memory;
pub use source::{EntrySource, Function};
use sweep::State;

/// Settings of [`cross`].
///
/// ```
/// let settings = graintrain_tt::cross::CrossSettings::default();
/// assert_eq!((settings.tolerance, settings.max_sweeps, settings.kick_rank, settings.samples), (1e-6, 30, 4, 4000));
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
    /// Random entries of a confirmation: twice as many after every one that failed, and where errors sit on
    /// few points a fifth of the entries read so far (all entries of a tensor that has no more than were
    /// read). A guide takes an eighth of it, afresh after every sweep.
    pub samples: usize,
    /// Seed of the random start and of the samples.
    pub seed: u64,
}

impl Default for CrossSettings {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_rank: usize::MAX, max_sweeps: 30, kick_rank: 4, samples: 4000, seed: 1 }
    }
}

/// More samples than this do not fit in memory.
const MOST_SAMPLES: usize = 1 << 24;

/// Why the sweeps ended. Only the first says that the measured error is below the tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CrossStatus {
    /// All errors measured on fresh points and on the probes are at most the tolerance, and the bound is
    /// below one.
    Converged,
    /// No error above the tolerance was seen, but the points prove next to nothing: `upper_bound` is one or
    /// more (or absent), or fewer than ten random entries are not zero. More `samples` tell more.
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
    /// ||A - train|| / ||A|| from random entries drawn after the last sweep but one that enriched; none if A vanishes on all
    /// random entries. An estimate: half of such estimates lie below the truth.
    pub sampled_error: Option<f64>,
    /// What ||A - train|| / ||A|| does not exceed with 95 % confidence, given that no entry of A is larger
    /// than those read and no entry of the train larger than on the points (sizes times the square root of
    /// the weight that the samples give to a point, so that large entries at ends of modes, where points are
    /// dense, cost little). With n points and no error on any of them it still is about sqrt(10 / n) times
    /// the largest entry over the root mean square one: a sample knows nothing about fewer than n / 3 parts
    /// of a tensor. None where even the norm is not known.
    pub upper_bound: Option<f64>,
    /// Random entries behind `sampled_error` and `upper_bound`.
    pub points: usize,
    /// Those of them that are not zero: where they are few, so is what is known.
    pub nonzeros: usize,
    /// Whether these were ALL entries of the tensor: then `sampled_error` and `upper_bound` are the error
    /// itself.
    pub complete: bool,
    /// The same over the caller's probes; none if there are none or A vanishes on them.
    pub probe_error: Option<f64>,
    /// The same over ALL entries, relative to the norm of a sparse matrix without its dummies: known to
    /// [`cross_sparse`] alone; none below 1e-7, which it cannot resolve.
    pub exact_error: Option<f64>,
    /// Rounding level of the entries of the train (see [`TtVector::rounding_floor`]): no error is known below
    /// this.
    pub floor: f64,
    /// Entries that the source was asked for, samples included; of a tensor of at most 2^21 entries none is
    /// asked for twice.
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
/// Of `start` only the index sets survive (its rows of maximal volume), not its values; without it, random
/// rank 2. `probes` holds d indices per point.
///
/// # Errors
/// [`TtError::Shape`] or [`TtError::Index`] for a start or probes that do not fit, [`TtError::Setting`] for a
/// bad setting, [`TtError::Entry`] if an entry that is read is not finite. Not converging is not an error:
/// see [`CrossReport::status`].
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
    cross_within(source, start, probes, settings, &|| false)
}

/// As [`cross`], as long as `stop` is false: it is asked at every site.
///
/// # Errors
/// As for [`cross`], and [`TtError::Stopped`].
pub fn cross_within(
    source: &dyn EntrySource,
    start: Option<&TtVector>,
    probes: &[usize],
    settings: &CrossSettings,
    stop: Stop<'_>,
) -> Result<(TtVector, CrossReport), TtError> {
    let start = checked(&source.modes(), start, probes, settings)?;
    let source = Memory::new(source);
    let mut confirmation = Confirmation::new(&source, probes, settings)?;
    let random = Random::new(settings.seed ^ 0x5EED);
    let mut state = State::new(&source, &start, settings, random, confirmation.exponent)?;
    let Sweeps { status, mut capped, history, confirmed } =
        sweeps(&mut state, &mut confirmation, settings, stop)?;
    if status != CrossStatus::ZeroSampled && state.enriched {
        capped |= state.sweep(settings, false, stop)?.capped;
    }
    let (mut train, verdict) = measured(&mut state, &mut confirmation, settings, confirmed)?;
    let status = claim(status, &verdict, capped, settings.tolerance);
    let floor = train.rounding_floor()?;
    share_power(&mut train.cores, i64::from(confirmation.exponent));
    let report = CrossReport {
        status,
        sampled_error: verdict.sampled,
        upper_bound: verdict.bound,
        points: verdict.points,
        nonzeros: verdict.nonzeros,
        complete: verdict.complete,
        probe_error: verdict.probed,
        exact_error: None,
        floor,
        evaluations: source.evaluations(),
        sweeps: history.len(),
        history,
        ranks: train.ranks(),
    };
    Ok((train, report))
}

/// The start, once everything fits together.
fn checked(
    modes: &[usize],
    start: Option<&TtVector>,
    probes: &[usize],
    settings: &CrossSettings,
) -> Result<TtVector, TtError> {
    Truncation::capped(settings.tolerance, settings.max_rank).check()?;
    let zero = TtVector::constant(modes, 0.0)?;
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
    probes.chunks_exact(d).try_for_each(|probe| check_index(modes, probe))?;
    match start {
        Some(start) => {
            zero.check_same_modes(start)?;
            Ok(start.clone())
        }
        None => TtVector::random(modes, 2, settings.seed),
    }
}

/// How the sweeps ended.
struct Sweeps {
    status: CrossStatus,
    /// Whether the cap on the ranks cost accuracy.
    capped: bool,
    history: Vec<f64>,
    /// A train that fresh points confirmed, and what they said of it.
    confirmed: Option<(TtVector, Verdict, Evidence)>,
}

/// Sweeps until fresh points confirm a train, or nothing gets better.
fn sweeps(
    state: &mut State<'_>,
    confirmation: &mut Confirmation<'_>,
    settings: &CrossSettings,
    stop: Stop<'_>,
) -> Result<Sweeps, TtError> {
    let mut errors: Vec<f64> = Vec::new();
    let mut found =
        Sweeps { status: CrossStatus::SweepLimit, capped: false, history: Vec::new(), confirmed: None };
    while found.history.len() < settings.max_sweeps.max(2) {
        // The last sweep allowed does not enrich, so that the ranks obey the cap.
        let enrich = found.history.len() + 1 < settings.max_sweeps.max(2);
        let outcome = state.sweep(settings, enrich, stop)?;
        found.history.push(outcome.change);
        found.capped = outcome.capped;
        let train = state.train();
        if state.heaviest == 0.0 && confirmation.has_seen_zeros_only() {
            // More points before giving up; what is not zero there becomes a pivot.
            let sample = confirmation.fresh(state.evaluations, |_| Vec::new());
            let verdict = confirmation.verdict(&train, &sample, state.heaviest)?;
            if verdict.nonzeros == 0 || !enrich {
                found.status = CrossStatus::ZeroSampled;
                break;
            }
            state.add_pivots(&verdict.worst);
            continue;
        }
        let mut verdict = confirmation.guide(&train)?;
        if outcome.change <= settings.tolerance && verdict.meets(settings.tolerance) {
            // Quiet on the guide: fresh points decide.
            let mut sample = confirmation.fresh(state.evaluations, |count| state.near_pivots(count));
            verdict = confirmation.verdict(&train, &sample, state.heaviest)?;
            if verdict.meets(settings.tolerance) && verdict.proves_little() {
                let enlarged;
                (sample, enlarged) = confirmation.more(sample, &verdict, state.evaluations);
                if enlarged {
                    verdict = confirmation.verdict(&train, &sample, state.heaviest)?;
                }
            }
            if verdict.meets(settings.tolerance) {
                found.status = CrossStatus::Converged;
                found.confirmed = Some((train, verdict, sample));
                break;
            }
        }
        errors.push(verdict.error().unwrap_or(outcome.change));
        if stagnates(&errors, found.capped) {
            found.status = if found.capped { CrossStatus::RankCapped } else { CrossStatus::Stagnated };
            break;
        }
        // Points with the largest error become pivots of the residual.
        state.add_pivots(&verdict.worst);
    }
    Ok(found)
}

/// The train of the last sweep, or a better one that is known, and what fresh points say of it.
fn measured(
    state: &mut State<'_>,
    confirmation: &mut Confirmation<'_>,
    settings: &CrossSettings,
    confirmed: Option<(TtVector, Verdict, Evidence)>,
) -> Result<(TtVector, Verdict), TtError> {
    let mut train = state.train();
    let verdict = match confirmed {
        Some((longer, before, sample)) => {
            let after = confirmation.verdict(&train, &sample, state.heaviest)?;
            if !after.meets(settings.tolerance) && longer.max_rank() <= settings.max_rank {
                // Shortening cost more than the tolerance: keep the longer train.
                train = longer;
                before
            } else {
                after
            }
        }
        None => {
            let sample = confirmation.fresh(state.evaluations, |count| state.near_pivots(count));
            confirmation.verdict(&train, &sample, state.heaviest)?
        }
    };
    let missed = verdict.error().is_none_or(|error| error > settings.tolerance);
    let Some(all) = missed.then(|| confirmation.all_entries(state.evaluations)).flatten() else {
        return Ok((train, verdict));
    };
    // As many entries as there are have been read and the sweeps did not get there: all of them, then, and
    // their TT-SVD.
    let truncation = Truncation::capped(0.9 * settings.tolerance, settings.max_rank);
    let (whole, _) = TtVector::from_full(&all.random.values, &train.modes(), &truncation)?;
    let better = confirmation.verdict(&whole, &all, state.heaviest)?;
    let is_better = better.error().is_some_and(|b| verdict.error().is_none_or(|error| b < error));
    Ok(if is_better { (whole, better) } else { (train, verdict) })
}

/// What may be said: the claim is what fresh points say about the train that is returned, however the sweeps
/// ended.
fn claim(ended: CrossStatus, verdict: &Verdict, capped: bool, tolerance: f64) -> CrossStatus {
    let measured = verdict.error().is_some();
    match ended {
        CrossStatus::ZeroSampled if verdict.nonzeros == 0 => ended,
        _ if measured && verdict.meets(tolerance) && !verdict.proves_little() => CrossStatus::Converged,
        _ if measured && verdict.meets(tolerance) => CrossStatus::Unverified,
        CrossStatus::Converged if !measured => CrossStatus::Unverified,
        _ if capped => CrossStatus::RankCapped,
        CrossStatus::Converged | CrossStatus::ZeroSampled => CrossStatus::Stagnated,
        _ => ended,
    }
}

/// Whether the errors of the last three sweeps together are hardly below those of the three before: one fresh
/// sample may be lucky.
fn stagnates(errors: &[f64], capped: bool) -> bool {
    let n = errors.len();
    if n < 6 || (n <= 8 && !capped) {
        return false;
    }
    let together = |errors: &[f64]| errors.iter().map(|x| x * x).sum::<f64>();
    together(&errors[n - 3..]) > 0.5 * together(&errors[n - 6..n - 3])
}

/// [`QuadtreeMatrix::relative_error`] is a difference of squares and knows nothing below this.
const RESOLVED_ERROR: f64 = 1e-7;

/// AMEn-cross of a sparse matrix, with its nonzeros (every `stride`-th) as probes and the identity as default
/// start.
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
    cross_sparse_within(matrix, start, stride, settings, &|| false)
}

/// As [`cross_sparse`], as long as `stop` is false: it is asked at every site.
///
/// # Errors
/// As for [`cross`], and [`TtError::Stopped`].
pub fn cross_sparse_within(
    matrix: &QuadtreeMatrix,
    start: Option<&TtMatrix>,
    stride: usize,
    settings: &CrossSettings,
    stop: Stop<'_>,
) -> Result<(TtMatrix, CrossReport), TtError> {
    let sizes = matrix.modes();
    let identity = TtMatrix::identity(&sizes)?;
    let mut probes = Vec::new();
    for (row, column, _) in matrix.entries().step_by(stride.max(1)) {
        identity.push_pair_index(row, column, &mut probes)?;
    }
    let start = start.unwrap_or(&identity);
    identity.check_same_sizes(start)?;
    let (train, mut report) = cross_within(matrix, Some(start.as_vector()), &probes, settings, stop)?;
    let train = TtMatrix::from_vector(train, &sizes, &sizes)?;
    // Random points of a sparse matrix hit its zeros, and what a train puts there is very uneven: a few
    // thousand of them tell its norm only within a factor of some units. The nonzeros and the norm of the
    // train tell it exactly.
    report.exact_error = Some(matrix.relative_error(&train)?).filter(|&error| error >= RESOLVED_ERROR);
    let claimed = matches!(report.status, CrossStatus::Converged | CrossStatus::Unverified);
    report.status = match report.exact_error {
        Some(error) if claimed && error > settings.tolerance => CrossStatus::Stagnated,
        Some(_) if claimed => CrossStatus::Converged,
        // Nothing above what can be resolved.
        None if claimed && settings.tolerance >= RESOLVED_ERROR => CrossStatus::Converged,
        _ => report.status,
    };
    Ok((train, report))
}
