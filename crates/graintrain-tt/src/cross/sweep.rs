//! One sweep of AMEn-cross: fibres, their leading vectors, rows of maximal volume, enrichment by the sampled
//! residual.

use super::sample::heaviest;
use super::{CrossSettings, EntrySource};
use crate::error::at_core;
use crate::maxvol::dominant_rows;
use crate::random::Random;
use crate::scale::{largest_finite, scale_by_power};
use crate::vector::{Core, admissible_ranks};
use crate::{Stop, TtError, TtVector};
use graintrain_linalg::dense::{DenseError, Matrix, product, thin_qr, thin_svd};

/// About how many entries are asked for at a time.
const POINTS_AT_ONCE: usize = 1024;

/// What one sweep did.
#[derive(Clone, Copy, Default)]
pub(super) struct SweepOutcome {
    /// Largest relative change of a core.
    pub(super) change: f64,
    /// Whether the cap on the ranks cut one.
    pub(super) capped: bool,
}

/// Index sets and cores, always swept from the first mode of the current direction to the last.
///
/// `right[k]` holds the fragments (i_{k+1}, ..., i_d) of J_k, each in the order of the current direction.
pub(super) struct State<'a> {
    source: &'a dyn EntrySource,
    /// Mode sizes in the order of the source, and in that of the current direction.
    sizes: Vec<usize>,
    modes: Vec<usize>,
    reversed: bool,
    /// Core 1 in any form, cores 2..d interpolating on the right: the identity on the pivots.
    cores: Vec<Core>,
    right: Vec<Vec<Vec<usize>>>,
    /// The fragments (i_1, ..., i_k) left of mode k that the sweep before the last one chose, for points near
    /// pivots.
    left: Vec<Vec<Vec<usize>>>,
    residual_right: Vec<Vec<Vec<usize>>>,
    random: Random,
    /// Entries are taken times 2^-exponent.
    exponent: i32,
    pub(super) evaluations: usize,
    /// Largest squared entry seen times the weight that its point has for the samples (see [`heaviest`]).
    pub(super) heaviest: f64,
    pub(super) enriched: bool,
}

impl<'a> State<'a> {
    pub(super) fn new(
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
            let (rows, b) = dominant_rows(&q).map_err(at_core(k))?;
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
            sizes: modes.clone(),
            modes,
            reversed: false,
            cores,
            right,
            left: Vec::new(),
            residual_right,
            random,
            exponent,
            evaluations: 0,
            heaviest: 0.0,
            enriched: false,
        })
    }

    /// A(left, i, right) for all combinations, left fastest.
    fn block(&mut self, left: &[Vec<usize>], k: usize, right: &[Vec<usize>]) -> Result<Matrix, TtError> {
        let (d, n) = (self.modes.len(), self.modes[k]);
        let place = |digit: usize| if self.reversed { d - 1 - digit } else { digit };
        let mut values = vec![0.0; left.len() * n * right.len()];
        // The points of all left fragments for one digit and one right fragment: of the next ones only digits
        // change.
        let mut points = vec![0; left.len() * d];
        for (point, head) in points.chunks_exact_mut(d).zip(left) {
            head.iter().enumerate().for_each(|(digit, &i)| point[place(digit)] = i);
        }
        // Asked for in portions that stay in cache.
        let portion = POINTS_AT_ONCE.div_ceil(left.len()) * left.len();
        let mut asked = Vec::with_capacity(portion.min(values.len()) * d);
        let mut answers = values.chunks_mut(portion);
        for tail in right {
            for point in points.chunks_exact_mut(d) {
                tail.iter().enumerate().for_each(|(digit, &i)| point[place(k + 1 + digit)] = i);
            }
            for i in 0..n {
                points.iter_mut().skip(place(k)).step_by(d).for_each(|digit| *digit = i);
                asked.extend_from_slice(&points);
                if asked.len() == portion * d {
                    answers.next().into_iter().for_each(|answer| self.source.entries(&asked, answer));
                    asked.clear();
                }
            }
        }
        answers.next().into_iter().for_each(|answer| self.source.entries(&asked, answer));
        scale_by_power(&mut values, -self.exponent);
        self.evaluations += values.len();
        let point = |p: usize| {
            let (head, rest) = (p % left.len(), p / left.len());
            let mut index = vec![0; d];
            left[head].iter().enumerate().for_each(|(digit, &i)| index[place(digit)] = i);
            index[place(k)] = rest % n;
            let tail = right[rest / n].iter().enumerate();
            tail.for_each(|(digit, &i)| index[place(k + 1 + digit)] = i);
            index
        };
        largest_finite(&values).map_err(|_| {
            let p = values.iter().position(|x| !x.is_finite()).unwrap_or(0);
            TtError::Entry { index: point(p), value: values[p] }
        })?;
        self.heaviest = heaviest(&self.sizes, &values, self.heaviest, point);
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

    pub(super) fn sweep(
        &mut self,
        settings: &CrossSettings,
        enrich: bool,
        stop: Stop<'_>,
    ) -> Result<SweepOutcome, TtError> {
        let d = self.modes.len();
        let mut outcome = SweepOutcome::default();
        let mut left: Vec<Vec<Vec<usize>>> = vec![vec![Vec::new()]];
        let mut residual_left: Vec<Vec<Vec<usize>>> = vec![vec![Vec::new()]];
        // Values of the left part of the train at the residual's left fragments.
        let mut left_values = Matrix::identity(1);
        self.enriched = enrich && settings.kick_rank > 0;
        for k in 0..d {
            crate::go_on(stop)?;
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
        let (rows, b) = dominant_rows(&q).map_err(at_core(k))?;
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
        let (rows, _) = dominant_rows(&q).map_err(at_core(k))?;
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
    pub(super) fn add_pivots(&mut self, points: &[Vec<usize>]) {
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

    /// At most `count` different points that share most digits with pivots: a left and a right fragment of a
    /// bond, one digit of each moved to a neighbour.
    pub(super) fn near_pivots(&mut self, count: usize) -> Vec<usize> {
        let d = self.modes.len();
        let mut found = std::collections::BTreeSet::new();
        for _ in 0..count {
            let k = self.random.below(d);
            let (Some(heads), tails) = (self.left.get(k), &self.right[k]) else { break };
            let mut point = heads[self.random.below(heads.len())].clone();
            point.push(self.random.below(self.modes[k]));
            point.extend_from_slice(&tails[self.random.below(tails.len())]);
            for (first, digits) in [(0, k), (k + 1, d - k - 1)] {
                if digits > 0 {
                    let at = first + self.random.below(digits);
                    let step = self.random.below(3);
                    point[at] = (point[at] + step).saturating_sub(1).min(self.modes[at] - 1);
                }
            }
            if self.reversed {
                point.reverse();
            }
            found.insert(point);
        }
        found.into_iter().flatten().collect()
    }

    /// Reverses the direction: left sets become right sets.
    fn turn(&mut self, left: Vec<Vec<Vec<usize>>>, residual_left: Vec<Vec<Vec<usize>>>) {
        let turned = |sets: Vec<Vec<Vec<usize>>>| -> Vec<Vec<Vec<usize>>> {
            let reverse = |set: Vec<Vec<usize>>| {
                set.into_iter().map(|fragment| fragment.into_iter().rev().collect()).collect()
            };
            sets.into_iter().rev().map(reverse).collect()
        };
        self.left = turned(std::mem::replace(&mut self.right, turned(left)));
        self.residual_right = turned(residual_left);
        self.modes.reverse();
        let cores = std::mem::take(&mut self.cores);
        self.cores = TtVector { cores }.reverse().cores;
        self.reversed = !self.reversed;
    }

    /// The train in the order of the source.
    pub(super) fn train(&self) -> TtVector {
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

pub(super) fn norm(x: &[f64]) -> f64 {
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
fn leading(a: &Matrix, count: usize) -> Result<Matrix, DenseError> {
    let svd = thin_svd(a.view())?;
    let useful = svd.s.iter().take_while(|&&s| s > 1e-15 * svd.s[0] && s > 0.0).count();
    let mut u = svd.u;
    u.truncate_columns(useful.min(count));
    Ok(u)
}
