//! Linear systems A x = y with all three in tensor-train form.
//!
//! One core of x is improved at a time. With all other cores orthogonal the local system is a Galerkin
//! projection of A x = y onto the span of the other cores; for a symmetric positive definite A every local
//! solve lowers the energy x^T A x / 2 - y^T x. Methods differ in how ranks grow:
//!
//! * [`Method::Amen`] (Dolgov and Savostyanov, SIAM J. Sci. Comput. 36, 2014): after each local solve the
//!   frame is enriched by a low-rank approximation of the residual, kept in a second train that is swept in
//!   tandem;
//! * [`Method::Als`]: ranks never exceed those of the start;
//! * [`Method::Dmrg`]: two neighbouring cores at once, the rank between them from an SVD.
//!
//! A matrix unknown X (A X = Y) has a spectator digit in every core: the local matrix is the same for all its
//! values, so it is factored once and solved for all of them.
//!
//! [`gmres`] keeps whole trains instead: for well-conditioned or preconditioned systems, and as a second
//! opinion.
//!
//! [`evolve`] follows x' = A x (TDVP), [`lowest_eigenpairs`] finds eigenvectors, both by the same sweeps.
//!
//! A local residual says little about the whole: the report's residual is computed afresh from the trains.

mod amen;
mod breakdown;
mod davidson;
mod eigen;
mod evolution;
mod gmres;
mod interface;
mod local;

use crate::cores::Sum;
use crate::product::Product;
use crate::round::{measured, relative_norm};
use crate::scale::{largest_finite, scale_by_power, share_power};
use crate::{Measured, Stop, Truncation, TtError, TtMatrix, TtVector};
pub(crate) use amen::Sweeper;
pub use eigen::{EigenMethod, EigenSettings, Eigenpair, lowest_eigenpairs, lowest_eigenpairs_within};
pub use evolution::{EvolutionReport, EvolutionSettings, Sites, evolve, evolve_within};
pub use gmres::{GmresReport, GmresSettings, gmres, gmres_within};
pub(crate) use interface::{BlockCore, OperatorCore};
use serde::{Deserialize, Serialize};

/// How ranks grow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// One core at a time, enriched by the residual.
    Amen,
    /// One core at a time, ranks of the start.
    Als,
    /// Two cores at a time.
    Dmrg,
}

/// Settings of [`solve`] and of the inverse.
///
/// ```
/// let settings = graintrain_tt::solve::SolveSettings::default();
/// assert_eq!((settings.tolerance, settings.max_sweeps, settings.kick_rank), (1e-6, 40, 4));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SolveSettings {
    /// Relative residual ||A x - y|| / ||y|| aimed at.
    pub tolerance: f64,
    /// No rank of the result above this.
    pub max_rank: usize,
    /// Most sweeps (in one direction each).
    pub max_sweeps: usize,
    /// Residual directions added per bond and sweep.
    pub kick_rank: usize,
    /// How ranks grow.
    pub method: Method,
    /// Largest local system (rank * mode * rank) that is factored densely; larger ones are iterated.
    pub direct_limit: usize,
    /// Most iterations per local system.
    pub local_iterations: usize,
    /// Seed of the start of the residual train.
    pub seed: u64,
}

impl Default for SolveSettings {
    fn default() -> Self {
        Self {
            tolerance: 1e-6,
            max_rank: usize::MAX,
            max_sweeps: 40,
            kick_rank: 4,
            method: Method::Amen,
            direct_limit: 1000,
            local_iterations: 120,
            seed: 1,
        }
    }
}

impl SolveSettings {
    pub(crate) fn check(&self) -> Result<(), TtError> {
        Truncation::capped(self.tolerance, self.max_rank).check()?;
        if self.max_sweeps == 0 {
            return Err(TtError::Setting { what: "max_sweeps", need: "at least 1", got: 0.0 });
        }
        Ok(())
    }
}

/// The local tolerance is never tightened below this part of the tolerance asked for.
pub(crate) const MOST_TIGHTENING: f64 = 0.01;

/// Sweeps with local residuals above 1 after which it is asked whether rounding hides the tolerance.
const HOPE: usize = 4;
/// The rounding floor of a residual is a bound; true residuals came out up to 200 times smaller.
const FLOOR_OVER_ROUNDING: f64 = 1000.0;

/// Why the sweeps ended. Only the first says that the tolerance is met.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SolveStatus {
    /// The residual of what is returned, computed afresh from the trains, is at most the tolerance.
    Converged,
    /// The cap on the ranks keeps the residual above the tolerance.
    RankCapped,
    /// Sweeps no longer lower the residual.
    Stagnated,
    /// Out of sweeps.
    SweepLimit,
}

/// What [`solve`] did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SolveReport {
    /// Why it ended.
    pub status: SolveStatus,
    /// ||A x - y|| / ||y|| of what is returned, computed from the trains (see [`measured_residual`]).
    pub residual: f64,
    /// What rounding leaves uncertain about the residual: no solver can promise less.
    pub floor: f64,
    /// Sweeps made.
    pub sweeps: usize,
    /// Largest relative local residual of every sweep, before its sites were solved.
    pub history: Vec<f64>,
    /// Ranks of the result.
    pub ranks: Vec<usize>,
}

/// Solves A x = y; `start` defaults to y. Where A is not symmetric and its projections break down (a residual
/// above 0.1 at the end) a random start and, for A of rank up to 8, the normal equations are tried as well;
/// what leaves the smallest residual is returned.
///
/// # Errors
/// [`TtError::Shape`] if the sizes do not fit, [`TtError::Setting`] for a bad setting or a zero operator,
/// [`TtError::Dense`] for entries that are not finite. Not converging is not an error: see
/// [`SolveReport::status`].
///
/// ```
/// use graintrain_tt::{TtVector, qtt, solve};
/// // -u'' = 1 on 2^20 interior points: rank 3.
/// let a = qtt::laplacian(20)?;
/// let one = TtVector::constant(&[2; 20], 1.0)?;
/// let settings = solve::SolveSettings { tolerance: 1e-5, ..Default::default() };
/// let (x, report) = solve::solve(&a, &one, None, &settings)?;
/// assert!(x.max_rank() <= 8);
/// let middle = 2f64.powi(39) / 4.0; // j (n + 1 - j) / 2 at j = 2^19
/// let digits: Vec<usize> = (0..20).map(|k| usize::from(k == 19)).collect();
/// assert!((x.entry(&digits)? / middle - 1.0).abs() < 1e-3);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn solve(
    a: &TtMatrix,
    y: &TtVector,
    start: Option<&TtVector>,
    settings: &SolveSettings,
) -> Result<(TtVector, SolveReport), TtError> {
    solve_within(a, y, start, settings, &|| false)
}

/// As [`solve`], as long as `stop` is false: it is asked at every site.
///
/// # Errors
/// As for [`solve`], and [`TtError::Stopped`].
pub fn solve_within(
    a: &TtMatrix,
    y: &TtVector,
    start: Option<&TtVector>,
    settings: &SolveSettings,
    stop: Stop<'_>,
) -> Result<(TtVector, SolveReport), TtError> {
    a.check_square()?;
    let spectators = vec![1; a.num_cores()];
    let swept = solve_block(a, y, &spectators, start.unwrap_or(y), settings, stop)?;
    breakdown::mended(a, y, swept, settings, stop)
}

/// Solves A X = Y for a matrix X; `start` defaults to Y.
///
/// # Errors
/// As for [`solve`].
pub fn solve_matrix(
    a: &TtMatrix,
    y: &TtMatrix,
    start: Option<&TtMatrix>,
    settings: &SolveSettings,
) -> Result<(TtMatrix, SolveReport), TtError> {
    solve_matrix_within(a, y, start, settings, &|| false)
}

/// As [`solve_matrix`], as long as `stop` is false: it is asked at every site and for every right-hand side
/// that is iterated.
///
/// # Errors
/// As for [`solve`], and [`TtError::Stopped`].
pub fn solve_matrix_within(
    a: &TtMatrix,
    y: &TtMatrix,
    start: Option<&TtMatrix>,
    settings: &SolveSettings,
    stop: Stop<'_>,
) -> Result<(TtMatrix, SolveReport), TtError> {
    a.check_square()?;
    if y.rows != a.rows {
        return Err(TtError::Shape {
            what: "rows of Y in A X = Y",
            expected: a.rows.clone(),
            got: y.rows.clone(),
        });
    }
    let start = start.unwrap_or(y);
    y.check_same_sizes(start)?;
    let (train, report) = solve_block(a, &y.train, &y.columns, &start.train, settings, stop)?;
    Ok((y.map(|_| train), report))
}

/// A x = y with modes n_k s_k of x and y, the operator acting on n_k.
fn solve_block(
    a: &TtMatrix,
    y: &TtVector,
    spectators: &[usize],
    start: &TtVector,
    settings: &SolveSettings,
    stop: Stop<'_>,
) -> Result<(TtVector, SolveReport), TtError> {
    settings.check()?;
    let expected: Vec<usize> = a.rows.iter().zip(spectators).map(|(n, s)| n * s).collect();
    for train in [y, start] {
        if train.modes() != expected {
            return Err(TtError::Shape {
                what: "modes of a right-hand side or start",
                expected,
                got: train.modes(),
            });
        }
    }
    // Sizes are taken out as powers of two, exactly: 2^p A' 2^(q - p) x' = 2^q y' with A', y' of moderate
    // size.
    let Some((balanced_y, y_exponent)) = balanced(y, spectators)? else {
        // A x = 0
        let zero = y.scale(0.0).round(&Truncation::default())?.0;
        let ranks = zero.ranks();
        let report = SolveReport {
            status: SolveStatus::Converged,
            residual: 0.0,
            floor: 0.0,
            sweeps: 0,
            history: Vec::new(),
            ranks,
        };
        return Ok((zero, report));
    };
    let Some((balanced_a, a_exponent)) = balanced(&a.train, &a.rows)? else {
        return Err(TtError::Setting { what: "norm of the operator", need: "positive", got: 0.0 });
    };
    let (y, a, exponent) = (&balanced_y, &a.map(|_| balanced_a), y_exponent - a_exponent);
    let start = match start.balanced()? {
        // (A zero start has no direction: the right-hand side takes its place.)
        None => y.clone(),
        Some((mut start, start_exponent)) => {
            share_power(&mut start.cores, start_exponent - exponent);
            start
        }
    };
    let operators = (0..a.num_cores())
        .map(|k| {
            let core = &a.cores()[k];
            OperatorCore::new(core.left, a.rows[k], core.right, &core.data)
        })
        .collect();
    let symmetric = a.relative_distance(&a.transpose())? < 1e-10;
    let start = if start.max_rank() > settings.max_rank {
        start.round(&Truncation::capped(0.0, settings.max_rank))?.0
    } else {
        start
    };
    let mut sweeper = Sweeper::new(
        operators,
        blocks(y, (&a.rows, spectators)),
        blocks(&start, (&a.rows, spectators)),
        symmetric,
        settings,
    );
    let mut best = Best::new(a, y, spectators);
    let (ended, history) = sweeps(&mut sweeper, &mut best, settings, stop)?;
    if best.residual > settings.tolerance {
        // What the sweeps began with may be better than what they made of it; so may nothing at all.
        best.offer(start)?;
        best.offer_zero();
    }
    let Best { mut x, .. } = best;
    let Measured { value: residual, floor } = measured_residual(a, &x, y, spectators)?;
    share_power(&mut x.cores, exponent);
    let status = if residual <= settings.tolerance {
        SolveStatus::Converged
    } else if ended == SolveStatus::Converged {
        SolveStatus::Stagnated
    } else {
        ended
    };
    let ranks = x.ranks();
    Ok((x, SolveReport { status, residual, floor, sweeps: history.len(), history, ranks }))
}

/// The cores with their modes split into those of the rows of A and those that it does not act on.
fn blocks(train: &TtVector, (rows, spectators): (&[usize], &[usize])) -> Vec<BlockCore> {
    let cores = train.cores.iter().zip(rows).zip(spectators);
    cores
        .map(|((core, &n), &s)| BlockCore {
            left: core.left,
            n,
            s,
            right: core.right,
            data: core.data.clone(),
        })
        .collect()
}

/// Sweeps until the residual itself reaches the tolerance, or nothing gets better: how they ended and their
/// local residuals.
fn sweeps(
    sweeper: &mut Sweeper,
    best: &mut Best<'_>,
    settings: &SolveSettings,
    stop: Stop<'_>,
) -> Result<(SolveStatus, Vec<f64>), TtError> {
    let mut history = Vec::new();
    let mut ended;
    let mut inner = *settings;
    // Local residuals promise more than they keep: where the true one does not reach the tolerance the sweeps
    // go on, tighter.
    loop {
        ended = SolveStatus::SweepLimit;
        while history.len() + 1 < settings.max_sweeps {
            let outcome = sweeper.sweep(&inner, true, stop)?;
            history.push(outcome.residual);
            if outcome.residual < inner.tolerance || outcome.change == 0.0 {
                ended = SolveStatus::Converged;
                break;
            }
            if history.len() >= HOPE
                && outcome.residual > 1.0
                && best.rounding_hides(&sweeper.solution(), settings.tolerance)?
            {
                ended = SolveStatus::Stagnated;
                break;
            }
            if stagnates(&history, outcome.capped) {
                ended = if outcome.capped { SolveStatus::RankCapped } else { SolveStatus::Stagnated };
                break;
            }
        }
        // A last sweep without enrichment brings the ranks down to what the tolerance needs.
        let outcome = sweeper.sweep(&inner, false, stop)?;
        history.push(outcome.residual);
        if outcome.capped && ended != SolveStatus::Converged {
            ended = SolveStatus::RankCapped;
        }
        best.offer(sweeper.solution())?;
        let floor = settings.tolerance * MOST_TIGHTENING;
        // (Two-site sweeps without enrichment also stagnate because they truncate too much.)
        let tighter_may_help = ended == SolveStatus::Converged
            || (ended == SolveStatus::Stagnated && settings.method == Method::Dmrg);
        if best.residual <= settings.tolerance
            || !tighter_may_help
            || inner.tolerance <= floor
            || history.len() + 2 >= settings.max_sweeps
        {
            break;
        }
        inner.tolerance *= 0.2;
    }
    Ok((ended, history))
}

/// The iterate with the smallest residual so far.
struct Best<'a> {
    a: &'a TtMatrix,
    y: &'a TtVector,
    spectators: &'a [usize],
    x: TtVector,
    residual: f64,
}

impl<'a> Best<'a> {
    fn new(a: &'a TtMatrix, y: &'a TtVector, spectators: &'a [usize]) -> Self {
        Self { a, y, spectators, x: y.clone(), residual: f64::INFINITY }
    }

    /// Takes x if its residual is smaller; one with numbers that are not finite is never better.
    fn offer(&mut self, x: TtVector) -> Result<(), TtError> {
        if x.cores.iter().any(|core| largest_finite(&core.data).is_err()) {
            return Ok(());
        }
        // (The right-hand side of a matrix equation has other column digits than A has.)
        let residual = relative_residual(self.a, &x, self.y, self.spectators)?;
        if residual < self.residual {
            (self.x, self.residual) = (x, residual);
        }
        Ok(())
    }

    /// Whether the residual of x cannot be known, and so not be lowered, to the tolerance: the condition of
    /// the system is beyond the numbers, and all that further sweeps would add is rank.
    fn rounding_hides(&self, x: &TtVector, tolerance: f64) -> Result<bool, TtError> {
        if x.cores.iter().any(|core| largest_finite(&core.data).is_err()) {
            return Ok(true);
        }
        let floor = measured_residual(self.a, x, self.y, self.spectators)?.floor;
        Ok(floor > FLOOR_OVER_ROUNDING * tolerance)
    }

    /// x = 0 leaves all of y: a residual of 1.
    fn offer_zero(&mut self) {
        if self.residual > 1.0 || self.residual.is_nan() {
            let zero = |core: &crate::Core| crate::Core::from_fn(1, core.mode, 1, |_, _, _| 0.0);
            self.x = TtVector { cores: self.y.cores.iter().map(zero).collect() };
            self.residual = 1.0;
        }
    }
}

/// The train with every part right of a bond of a size near sqrt(product of its `sizes`), as for entries of
/// size one on a diagonal, and the exponent taken out; none for zero.
fn balanced(train: &TtVector, sizes: &[usize]) -> Result<Option<(TtVector, i64)>, TtError> {
    let Some((mut balanced, exponent)) = train.balanced()? else { return Ok(None) };
    let (mut grown, mut put_back) = (0.0, 0);
    for (core, &n) in balanced.cores.iter_mut().zip(sizes).rev() {
        grown += 0.5 * (n as f64).log2();
        let power = grown as i64 - put_back;
        scale_by_power(&mut core.data, power as i32);
        put_back += power;
    }
    Ok(Some((balanced, exponent - put_back)))
}

/// Whether sweeps have stopped paying: the best residual of the last sweeps is hardly better than the best
/// before. Residuals of ill-conditioned systems go up and down, so the window is wide unless the cap holds
/// the ranks.
fn stagnates(history: &[f64], capped: bool) -> bool {
    let (window, factor) = if capped { (2, 0.7) } else { (8, 0.9) };
    if history.len() <= window {
        return false;
    }
    let (before, last) = history.split_at(history.len() - window);
    let best = |list: &[f64]| list.iter().copied().fold(f64::INFINITY, f64::min);
    best(last) > factor * best(before)
}

/// ||A X - Y|| / ||Y|| from the trains, independent of any interface of the sweeps; see [`measured_residual`].
///
/// # Errors
/// As for [`measured_residual`].
pub fn relative_residual(
    a: &TtMatrix,
    x: &TtVector,
    y: &TtVector,
    spectators: &[usize],
) -> Result<f64, TtError> {
    let product = checked_product(a, x, y, spectators)?;
    relative_norm(&Sum { terms: vec![(1.0, &product), (-1.0, y)] }, y)
}

/// ||A X - Y|| / ||Y|| with its rounding floor, for X of modes n_k s_k with spectators s_k (all 1 for a vector).
///
/// The norm of A X - Y comes from triangles of the parts of this train, never from a difference of squares,
/// at any rank: it is right to the floor. The cores of A X are not formed. O(d (n R^3 r^3)) for the ranks R
/// of A and r of X.
///
/// # Errors
/// [`TtError::Shape`] if the sizes do not fit, [`TtError::Dense`] for entries that are not finite.
pub fn measured_residual(
    a: &TtMatrix,
    x: &TtVector,
    y: &TtVector,
    spectators: &[usize],
) -> Result<Measured, TtError> {
    let product = checked_product(a, x, y, spectators)?;
    measured(&Sum { terms: vec![(1.0, &product), (-1.0, y)] }, y)
}

/// A X, if its sizes are those of Y.
fn checked_product<'a>(
    a: &'a TtMatrix,
    x: &'a TtVector,
    y: &TtVector,
    spectators: &'a [usize],
) -> Result<Product<'a>, TtError> {
    let sizes = |modes: &[usize]| modes.iter().zip(spectators).map(|(n, s)| n.saturating_mul(*s)).collect();
    let (columns, rows): (Vec<usize>, Vec<usize>) = (sizes(&a.columns), sizes(&a.rows));
    for (what, train, expected) in [("modes of X in A X", x, columns), ("modes of Y", y, rows)] {
        if spectators.len() != a.num_cores() || train.modes() != expected {
            return Err(TtError::Shape { what, expected, got: train.modes() });
        }
    }
    Ok(Product { a, x, spectators })
}
