//! The alternating sweeps: AMEn, ALS and DMRG are one driver with different choices per site.

use super::interface::{
    BlockCore, Interface, LocalOperator, OperatorCore, local_right_hand_side, push_right_hand_side,
};
use super::local::{self, LocalSettings};
use super::{Method, SolveSettings};
use crate::error::at_core;
use crate::random::Random;
use crate::round::scaled_rows;
use crate::vector::Core;
use crate::{Stop, TtError, TtVector};
use graintrain_linalg::dense::{DenseError, Matrix, Svd, product, thin_qr, thin_svd};

/// A Krylov method that does not lower a local residual to this part has failed.
const KRYLOV_GAIN: f64 = 0.1;
/// After such a failure systems up to this many times the direct limit are factored.
const RAISED_LIMIT: usize = 3;

/// Interfaces on one side of a site: solution-solution, solution-rhs, residual-solution, residual-rhs.
#[derive(Clone)]
struct Sides {
    xx: Interface,
    xy: Matrix,
    zx: Interface,
    zy: Matrix,
}

impl Sides {
    fn one() -> Self {
        let one = Matrix::identity(1);
        Self { xx: Interface::one(), xy: one.clone(), zx: Interface::one(), zy: one }
    }

    fn push(&self, a: &OperatorCore, x: &BlockCore, y: &BlockCore, z: &BlockCore) -> Self {
        Self {
            xx: self.xx.push(x, a, x),
            xy: push_right_hand_side(&self.xy, x, y),
            zx: self.zx.push(z, a, x),
            zy: push_right_hand_side(&self.zy, z, y),
        }
    }
}

/// What one sweep saw.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SweepOutcome {
    /// Largest relative local residual before a site was solved.
    pub residual: f64,
    /// Largest relative change of a core.
    pub change: f64,
    /// A rank was cut by the cap.
    pub capped: bool,
}

/// The trains of a linear system, always swept from the first core to the last; [`Sweeper::turn`] reverses
/// them.
pub(crate) struct Sweeper {
    a: Vec<OperatorCore>,
    a_reversed: Vec<OperatorCore>,
    y: Vec<BlockCore>,
    y_reversed: Vec<BlockCore>,
    pub x: Vec<BlockCore>,
    z: Vec<BlockCore>,
    right: Vec<Sides>,
    reversed: bool,
    symmetric: bool,
    /// Largest local system that is factored densely: raised where Krylov methods prove to be of no use.
    direct_limit: usize,
}

impl Sweeper {
    /// `x` must not be empty; it is right-orthogonalised here.
    pub fn new(
        a: Vec<OperatorCore>,
        y: Vec<BlockCore>,
        mut x: Vec<BlockCore>,
        symmetric: bool,
        settings: &SolveSettings,
    ) -> Self {
        let d = x.len();
        orthogonalise_right(&mut x);
        let mut random = Random::new(settings.seed);
        let modes: Vec<usize> = x.iter().map(|core| core.n * core.s).collect();
        let ranks = crate::vector::admissible_ranks(&modes, settings.kick_rank.max(1));
        let mut z: Vec<BlockCore> = (0..d)
            .map(|k| BlockCore {
                left: ranks[k],
                right: ranks[k + 1],
                n: x[k].n,
                s: x[k].s,
                data: (0..ranks[k] * modes[k] * ranks[k + 1]).map(|_| random.symmetric()).collect(),
            })
            .collect();
        orthogonalise_right(&mut z);
        let a_reversed: Vec<OperatorCore> = a.iter().rev().map(OperatorCore::reversed).collect();
        let y_reversed: Vec<BlockCore> = y.iter().rev().map(BlockCore::reversed).collect();
        let mut right = vec![Sides::one(); d];
        for k in (1..d).rev() {
            let (a, y) = (&a_reversed[d - 1 - k], &y_reversed[d - 1 - k]);
            right[k - 1] = right[k].push(a, &x[k].reversed(), y, &z[k].reversed());
        }
        let direct_limit = settings.direct_limit;
        Self { a, a_reversed, y, y_reversed, x, z, right, reversed: false, symmetric, direct_limit }
    }

    /// One sweep over all sites; `enrich` adds residual directions (AMEn only). Afterwards the trains are
    /// turned.
    ///
    /// # Errors
    /// [`TtError::Stopped`] where `stop` says so; the sweeper then must not be used again.
    pub fn sweep(
        &mut self,
        settings: &SolveSettings,
        enrich: bool,
        stop: Stop<'_>,
    ) -> Result<SweepOutcome, TtError> {
        let d = self.x.len();
        let mut outcome = SweepOutcome::default();
        let mut left = vec![Sides::one()];
        if settings.method == Method::Dmrg && d > 1 {
            for k in 0..d - 1 {
                self.solve_pair(k, &left[k], settings, stop, &mut outcome)?;
                let next = left[k].push(&self.a[k], &self.x[k], &self.y[k], &self.z[k]);
                left.push(next);
            }
        } else {
            for k in 0..d {
                self.solve_site(k, &left[k], settings, enrich, stop, &mut outcome)?;
                if k + 1 < d {
                    let next = left[k].push(&self.a[k], &self.x[k], &self.y[k], &self.z[k]);
                    left.push(next);
                }
            }
        }
        self.turn(left);
        Ok(outcome)
    }

    /// Reverses all trains: what was left of a site is now right of it.
    fn turn(&mut self, left: Vec<Sides>) {
        self.x = self.x.iter().rev().map(BlockCore::reversed).collect();
        self.z = self.z.iter().rev().map(BlockCore::reversed).collect();
        std::mem::swap(&mut self.a, &mut self.a_reversed);
        std::mem::swap(&mut self.y, &mut self.y_reversed);
        self.right = left.into_iter().rev().collect();
        self.reversed = !self.reversed;
    }

    /// The solution in the order of the problem.
    pub fn solution(&self) -> TtVector {
        let core =
            |x: &BlockCore| Core { left: x.left, mode: x.n * x.s, right: x.right, data: x.data.clone() };
        let train = TtVector { cores: self.x.iter().map(core).collect() };
        if self.reversed { train.reverse() } else { train }
    }

    fn local_settings<'a>(&self, settings: &SolveSettings, stop: Stop<'a>) -> LocalSettings<'a> {
        LocalSettings {
            stop,
            direct_limit: self.direct_limit,
            iterations: settings.local_iterations,
            tolerance: 0.5 * settings.tolerance / (self.x.len() as f64).sqrt(),
            symmetric: self.symmetric,
        }
    }

    /// One site: solve, truncate, enrich, orthogonalise, carry the rest into the next core.
    fn solve_site(
        &mut self,
        k: usize,
        left: &Sides,
        settings: &SolveSettings,
        enrich: bool,
        stop: Stop<'_>,
        outcome: &mut SweepOutcome,
    ) -> Result<(), TtError> {
        let (d, right) = (self.x.len(), &self.right[k]);
        let (core, y) = (&self.a[k], &self.y[k]);
        let operator = LocalOperator { left: &left.xx, core, right: &right.xx };
        let b = local_right_hand_side(&left.xy, y, &right.xy);
        let BlockCore { left: rank_left, n, s, right: rank_right, .. } = self.x[k];
        let solved = improve(&operator, &b, &self.x[k], &self.local_settings(settings, stop), outcome)?;
        if solved.krylov_failed {
            self.direct_limit = self.direct_limit.max(RAISED_LIMIT * settings.direct_limit);
        }
        let block = BlockCore::from_spectator_last(rank_left, n, s, rank_right, &solved.u);
        if k + 1 == d {
            self.x[k] = block;
            return Ok(());
        }
        let target = solved.residual.max(settings.tolerance / (d as f64).sqrt());
        let (u, carry) = truncate(&operator, &b, &block, target, settings, outcome).map_err(at_core(k))?;
        let (mut frame, mut weight) = (u, carry);
        if enrich && settings.method == Method::Amen && settings.kick_rank > 0 {
            let kept = BlockCore::from_product(rank_left, n, s, &frame, &weight).spectator_last();
            // The residual train: its own core, then the directions to add to the solution.
            let projected = residual_between(&left.zx, core, &right.zx, &left.zy, y, &right.zy, &kept);
            let (zl, zr) = (left.zx.test, right.zx.test);
            let z = BlockCore::from_spectator_last(zl, n, s, zr, &projected);
            let q = thin_qr(Matrix::from_vec(zl * n * s, zr, z.data)).0;
            self.z[k] = BlockCore { left: zl, n, s, right: q.columns(), data: q.into_vec() };
            let extra = residual_between(&left.xx, core, &right.zx, &left.xy, y, &right.zy, &kept);
            let extra = BlockCore::from_spectator_last(rank_left, n, s, zr, &extra);
            let rank = frame.columns();
            let (rows, mut joined) = (frame.rows(), frame.into_vec());
            joined.extend_from_slice(&extra.data);
            let (q, r) = thin_qr(Matrix::from_vec(rows, rank + zr, joined));
            let first = Matrix::from_fn(r.rows(), rank, |i, j| r[(i, j)]);
            weight = product(first.view(), weight.view());
            frame = q;
        } else {
            // Keep the residual train orthogonal so that its interfaces stay bounded.
            self.shift_residual(k);
        }
        self.x[k] = BlockCore { left: rank_left, n, s, right: frame.columns(), data: frame.into_vec() };
        self.x[k + 1] = self.x[k + 1].multiply_left(weight.view());
        Ok(())
    }

    /// QR of residual core k without an update.
    fn shift_residual(&mut self, k: usize) {
        let z = &self.z[k];
        let (left, n, s) = (z.left, z.n, z.s);
        let (q, r) = thin_qr(Matrix::from_vec(left * n * s, z.right, z.data.clone()));
        self.z[k] = BlockCore { left, n, s, right: q.columns(), data: q.into_vec() };
        self.z[k + 1] = self.z[k + 1].multiply_left(r.view());
    }

    /// Two neighbouring cores as one unknown (DMRG): the rank between them follows from the SVD.
    fn solve_pair(
        &mut self,
        k: usize,
        left: &Sides,
        settings: &SolveSettings,
        stop: Stop<'_>,
        outcome: &mut SweepOutcome,
    ) -> Result<(), TtError> {
        let d = self.x.len();
        let right = &self.right[k + 1];
        let core = self.a[k].merge(&self.a[k + 1]);
        let y = self.y[k].merge(&self.y[k + 1]);
        let operator = LocalOperator { left: &left.xx, core: &core, right: &right.xx };
        let b = local_right_hand_side(&left.xy, &y, &right.xy);
        let pair = self.x[k].merge(&self.x[k + 1]);
        let solved = improve(&operator, &b, &pair, &self.local_settings(settings, stop), outcome)?;
        if solved.krylov_failed {
            self.direct_limit = self.direct_limit.max(RAISED_LIMIT * settings.direct_limit);
        }
        let (first, second) = (self.x[k].clone(), self.x[k + 1].clone());
        let block = BlockCore::from_spectator_last(pair.left, pair.n, pair.s, pair.right, &solved.u);
        let split = block.split(&first, &second);
        let Svd { mut u, s, v } = thin_svd(split.view()).map_err(at_core(k))?;
        // The last pair of a sweep is followed by none: all its error is one bond's.
        let share = settings.tolerance / (d as f64).sqrt() * s.iter().map(|s| s * s).sum::<f64>().sqrt();
        let rank = rank_of_tail(&s, share, settings.max_rank, outcome);
        u.truncate_columns(rank);
        let carry = scaled_rows(&s, &v, rank);
        self.x[k] = BlockCore { right: rank, data: u.into_vec(), ..first };
        self.x[k + 1] = BlockCore { left: rank, data: carry.into_vec(), ..second };
        self.shift_residual(k);
        Ok(())
    }
}

impl BlockCore {
    /// frame * weight, the frame being a left unfolding.
    fn from_product(left: usize, n: usize, s: usize, frame: &Matrix, weight: &Matrix) -> Self {
        let product = product(frame.view(), weight.view());
        Self { left, n, s, right: weight.columns(), data: product.into_vec() }
    }

    /// Two neighbouring cores as one: (alpha, (i, i'), (s, s'), beta).
    pub(super) fn merge(&self, next: &Self) -> Self {
        let product = product(self.left_unfolding(), next.right_unfolding());
        let (n, s) = (self.n * next.n, self.s * next.s);
        let mut data = Vec::with_capacity(product.data().len());
        for beta in 0..next.right {
            for s2 in 0..next.s {
                for s1 in 0..self.s {
                    for i2 in 0..next.n {
                        let row = self.left * self.n * s1;
                        let column = i2 + next.n * (s2 + next.s * beta);
                        data.extend_from_slice(&product.column(column)[row..row + self.left * self.n]);
                    }
                }
            }
        }
        Self { left: self.left, n, s, right: next.right, data }
    }

    /// The inverse of [`BlockCore::merge`] as the matrix [(alpha, i, s), (i', s', beta)].
    pub(super) fn split(&self, first: &Self, second: &Self) -> Matrix {
        let (rows, columns) = (first.left * first.n * first.s, second.n * second.s * second.right);
        Matrix::from_fn(rows, columns, |row, column| {
            let (alpha, i1, s1) =
                (row % first.left, (row / first.left) % first.n, row / (first.left * first.n));
            let (i2, s2) = (column % second.n, (column / second.n) % second.s);
            let beta = column / (second.n * second.s);
            let (i, s) = (i1 + first.n * i2, s1 + first.s * s2);
            self.data[alpha + self.left * (i + self.n * (s + self.s * beta))]
        })
    }
}

/// A solved site: unknowns with the spectator last, the relative residual they leave, and whether a Krylov
/// method hardly lowered it.
struct Solved {
    u: Vec<f64>,
    residual: f64,
    krylov_failed: bool,
}

/// Solves one local system from the current core and records what was seen.
fn improve(
    operator: &LocalOperator<'_>,
    b: &[f64],
    current: &BlockCore,
    settings: &LocalSettings<'_>,
    outcome: &mut SweepOutcome,
) -> Result<Solved, TtError> {
    crate::go_on(settings.stop)?;
    let start = current.spectator_last();
    let before = relative_residual(operator, b, &start);
    outcome.residual = outcome.residual.max(before);
    let mut u = start.clone();
    if before > settings.tolerance {
        local::solve(operator, b, &mut u, settings)?;
    }
    let mut residual = relative_residual(operator, b, &u);
    let iterated = operator.size() > settings.direct_limit;
    let krylov_failed = iterated && residual > settings.tolerance.max(KRYLOV_GAIN * before);
    if settings.symmetric && (residual > before || residual.is_nan()) {
        // A solve that made it worse (a nearly singular site) is thrown away.
        u.copy_from_slice(&start);
        residual = before;
    }
    let change: f64 = u.iter().zip(&start).map(|(a, b)| (a - b).powi(2)).sum();
    let size: f64 = u.iter().map(|x| x * x).sum();
    outcome.change = outcome.change.max((change / size.max(f64::MIN_POSITIVE)).sqrt());
    Ok(Solved { u, residual, krylov_failed })
}

/// ||B u - b|| / ||b|| over all spectators (with ||b|| = 0: ||B u||).
fn relative_residual(operator: &LocalOperator<'_>, b: &[f64], u: &[f64]) -> f64 {
    let mut r = vec![0.0; b.len()];
    operator.apply(u, &mut r);
    let (mut difference, mut size) = (0.0, 0.0);
    for (r, b) in r.iter().zip(b) {
        difference += (r - b).powi(2);
        size += b * b;
    }
    if size > 0.0 { (difference / size).sqrt() } else { difference.sqrt() }
}

/// phi Y psi - Phi A Psi u between any test interfaces, as [p, i, p', s].
fn residual_between(
    left: &Interface,
    core: &OperatorCore,
    right: &Interface,
    left_y: &Matrix,
    y: &BlockCore,
    right_y: &Matrix,
    u: &[f64],
) -> Vec<f64> {
    let operator = LocalOperator { left, core, right };
    let mut product = vec![0.0; operator.result_size() * y.s];
    operator.apply(u, &mut product);
    let b = local_right_hand_side(left_y, y, right_y);
    product.iter().zip(&b).map(|(product, b)| b - product).collect()
}

/// The shortest left frame whose local residual stays below `target`, found by bisection over the rank (the
/// residual falls with the rank), and the weights that belong to it.
fn truncate(
    operator: &LocalOperator<'_>,
    b: &[f64],
    block: &BlockCore,
    target: f64,
    settings: &SolveSettings,
    outcome: &mut SweepOutcome,
) -> Result<(Matrix, Matrix), DenseError> {
    let Svd { mut u, s, v } = thin_svd(block.left_unfolding())?;
    let full = s.iter().take_while(|&&x| x > 1e-16 * s[0]).count().max(1);
    let residual_of = |rank: usize| {
        let carry = scaled_rows(&s, &v, rank);
        let mut frame = u.clone();
        frame.truncate_columns(rank);
        let kept = BlockCore::from_product(block.left, block.n, block.s, &frame, &carry);
        relative_residual(operator, b, &kept.spectator_last())
    };
    let accepted = target * (1.0 + 1e-6) + 1e-15;
    let (mut low, mut high) = (0, full);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if residual_of(middle) <= accepted {
            high = middle;
        } else {
            low = middle;
        }
    }
    outcome.capped |= high > settings.max_rank;
    let rank = high.min(settings.max_rank);
    u.truncate_columns(rank);
    Ok((u, scaled_rows(&s, &v, rank)))
}

/// The rank whose discarded singular values stay below `share`, with the cap.
fn rank_of_tail(s: &[f64], share: f64, max_rank: usize, outcome: &mut SweepOutcome) -> usize {
    let (mut rank, mut tail) = (s.len(), 0.0);
    while rank > 1 && tail + s[rank - 1].powi(2) <= share * share {
        tail += s[rank - 1].powi(2);
        rank -= 1;
    }
    outcome.capped |= rank > max_rank;
    rank.min(max_rank)
}

/// LQ sweep: cores 2..d get orthonormal rows.
fn orthogonalise_right(x: &mut [BlockCore]) {
    for k in (1..x.len()).rev() {
        let turned = x[k].reversed();
        let (q, r) = thin_qr(Matrix::from_vec(turned.left * turned.n * turned.s, turned.right, turned.data));
        let (n, s, right) = (x[k].n, x[k].s, x[k].right);
        x[k] = BlockCore { left: right, n, s, right: q.columns(), data: q.into_vec() }.reversed();
        let previous = &x[k - 1];
        let carried = product(previous.left_unfolding(), r.t());
        x[k - 1] = BlockCore { right: r.rows(), data: carried.into_vec(), ..*previous };
    }
}
