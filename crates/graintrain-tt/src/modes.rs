//! Modes merged, summed over, multiplied by matrices, joined and put into another order; powers by entries.

use crate::error::at_core;
use crate::factor::leading_columns;
use crate::round::Budget;
use crate::scale::share_power;
use crate::vector::{Core, LARGEST_CORE};
use crate::{Truncation, TruncationReport, TtError, TtVector};
use graintrain_linalg::dense::{Matrix, View, ViewMut, multiply, product};

impl TtVector {
    /// Groups of neighbouring modes as one mode each, the first index of a group fastest: the inverse of
    /// splitting a mode into digits. `sizes` are the numbers of modes per group. O(d n r^2 N) for merged
    /// modes of size N.
    ///
    /// # Errors
    /// [`TtError::Shape`] unless the groups are not empty and hold d modes; [`TtError::TooLarge`] for a core
    /// of more than 2^28 numbers.
    ///
    /// ```
    /// use graintrain_tt::qtt;
    /// let x = qtt::sine(6, 0.1, 0.0)?.merge_modes(&[2, 4])?;
    /// assert_eq!(x.modes(), [4, 16]);
    /// assert!((x.entry(&[3, 5])? - (0.1 * 23.0_f64).sin()).abs() < 1e-14);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn merge_modes(&self, sizes: &[usize]) -> Result<Self, TtError> {
        let d = self.num_cores();
        if sizes.contains(&0) || sizes.iter().try_fold(0usize, |sum, &n| sum.checked_add(n)) != Some(d) {
            return Err(TtError::Shape { what: "modes per group", expected: vec![d], got: sizes.to_vec() });
        }
        let mut cores: Vec<Core> = Vec::with_capacity(sizes.len());
        let mut rest = self.cores.iter();
        for &size in sizes {
            let mut merged: Option<Core> = None;
            for core in rest.by_ref().take(size) {
                let next = match merged {
                    None => core.clone(),
                    Some(before) => {
                        let entries =
                            before.left as f64 * before.mode as f64 * core.mode as f64 * core.right as f64;
                        if entries > LARGEST_CORE as f64 {
                            return Err(TtError::TooLarge { entries });
                        }
                        let joined = product(before.left_unfolding(), core.right_unfolding());
                        Core {
                            left: before.left,
                            mode: before.mode * core.mode,
                            right: core.right,
                            data: joined.into_vec(),
                        }
                    }
                };
                merged = Some(next);
            }
            cores.extend(merged);
        }
        Self::from_cores(cores)
    }

    /// Sums over the modes where `over` is true; the other modes stay, in their order (a single mode of size
    /// 1 if none does). O(d n r^2).
    ///
    /// # Errors
    /// [`TtError::Shape`] unless there is one answer per mode.
    ///
    /// ```
    /// use graintrain_tt::TtVector;
    /// let x = TtVector::rank_one(&[vec![1.0, 2.0], vec![3.0, 4.0, 5.0]])?;
    /// assert_eq!(x.sum_over(&[false, true])?.to_full()?, [12.0, 24.0]);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn sum_over(&self, over: &[bool]) -> Result<Self, TtError> {
        if over.len() != self.num_cores() {
            return Err(TtError::Shape {
                what: "modes to sum over",
                expected: vec![self.num_cores()],
                got: vec![over.len()],
            });
        }
        let mut summed = self.clone();
        for (k, _) in over.iter().enumerate().filter(|(_, sum)| **sum) {
            summed = summed.mode_product(k, &vec![1.0; self.cores[k].mode], 1)?;
        }
        // (Modes of size one that stay are not summed over: only the others are multiplied into their
        // neighbours.)
        let mut cores: Vec<Core> = Vec::new();
        let mut before = Matrix::identity(1);
        for (core, &sum) in summed.cores.iter().zip(over) {
            if sum {
                before = product(before.view(), View::new(&core.data, core.left, core.right));
            } else {
                cores.push(core.multiply_left(before.view()));
                before = Matrix::identity(core.right);
            }
        }
        match cores.last_mut() {
            Some(last) => *last = last.multiply_right(before.view()),
            None => cores.push(Core { left: 1, mode: 1, right: 1, data: before.into_vec() }),
        }
        Self::from_cores(cores)
    }

    /// Mode k multiplied by a matrix of `rows` rows (column-major, n_k columns): sum_j M(i, j) A(..., j,
    /// ...). O(rows n r^2).
    ///
    /// # Errors
    /// [`TtError::Index`] if there is no mode k, [`TtError::Shape`] unless the matrix has rows n_k numbers
    /// and a row.
    pub fn mode_product(&self, k: usize, matrix: &[f64], rows: usize) -> Result<Self, TtError> {
        let Some(core) = self.cores.get(k) else {
            return Err(TtError::Index { mode: k, index: k, size: self.num_cores() });
        };
        let n = core.mode;
        if rows == 0 || rows.checked_mul(n) != Some(matrix.len()) {
            let (expected, got) = (vec![rows.max(1), n], vec![matrix.len()]);
            return Err(TtError::Shape { what: "matrix of a mode product", expected, got });
        }
        let mut data = vec![0.0; core.left * rows * core.right];
        let blocks = core.data.chunks_exact(core.left * n).zip(data.chunks_exact_mut(core.left * rows));
        for (from, to) in blocks {
            multiply(
                1.0,
                View::new(from, core.left, n),
                View::new(matrix, rows, n).t(),
                ViewMut::new(to, core.left, rows),
            );
        }
        let mut cores = self.cores.clone();
        cores[k] = Core { left: core.left, mode: rows, right: core.right, data };
        Ok(Self { cores })
    }

    /// The entries of `other` after those of `self` along mode k, all other modes being the same; ranks add.
    ///
    /// # Errors
    /// [`TtError::Index`] if there is no mode k, [`TtError::Shape`] if another mode differs.
    ///
    /// ```
    /// use graintrain_tt::TtVector;
    /// let (x, y) = (TtVector::constant(&[2, 2], 1.0)?, TtVector::constant(&[1, 2], 5.0)?);
    /// assert_eq!(x.concatenate(&y, 0)?.to_full()?, [1.0, 1.0, 5.0, 1.0, 1.0, 5.0]);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn concatenate(&self, other: &Self, k: usize) -> Result<Self, TtError> {
        let (Some(mine), Some(theirs)) = (self.cores.get(k), other.cores.get(k)) else {
            return Err(TtError::Index { mode: k, index: k, size: self.num_cores().min(other.num_cores()) });
        };
        let total = mine.mode + theirs.mode;
        // Rows of an identity: each train is put into its part of the longer mode.
        let place = |n: usize, first: usize| -> Vec<f64> {
            (0..n * total).map(|e| f64::from(e % total == first + e / total)).collect()
        };
        let first = self.mode_product(k, &place(mine.mode, 0), total)?;
        first.add(&other.mode_product(k, &place(theirs.mode, mine.mode), total)?)
    }

    /// Every entry to the power p >= 1, by repeated squaring with rounding after every product. The report's
    /// error is a bound of what the roundings made, relative to the norm of the result only as far as no
    /// entry dominates: measure it where that matters.
    ///
    /// # Errors
    /// [`TtError::Setting`] for p = 0, else as for [`TtVector::round`].
    pub fn entrywise_power(
        &self,
        p: u32,
        truncation: &Truncation,
    ) -> Result<(Self, TruncationReport), TtError> {
        if p == 0 {
            return Err(TtError::Setting { what: "power", need: "at least 1", got: 0.0 });
        }
        let (mut power, mut last) = self.round(truncation)?;
        for bit in (0..p.ilog2()).rev() {
            let mut factors = vec![power.clone()];
            if p >> bit & 1 == 1 {
                factors.push(self.clone());
            }
            for factor in factors {
                let (next, report) = power.hadamard(&factor)?.round(truncation)?;
                last = TruncationReport {
                    error: last.error + report.error,
                    capped: last.capped || report.capped,
                    ..report
                };
                power = next;
            }
        }
        Ok((power, last))
    }

    /// The modes in another order: mode k of the result is mode `order[k]` of this train. Neighbours are
    /// exchanged one pair at a time (as many pairs as are out of order) by an SVD at the orthogonality
    /// centre, so the error of each exchange is known; ranks may grow up to those the tensor has in the new
    /// order. O(n^3 r^3) per exchange.
    ///
    /// The report's error is the SUM over the exchanges, a bound of the relative error; each may make an
    /// equal part of the tolerance.
    ///
    /// # Errors
    /// [`TtError::Shape`] unless `order` holds every mode once; [`TtError::TooLarge`] if two cores together
    /// have more than 2^28 numbers; else as for [`TtVector::round`].
    ///
    /// ```
    /// use graintrain_tt::{Truncation, TtVector};
    /// let x = TtVector::random(&[2, 3, 4], 2, 1)?;
    /// let (y, _) = x.permute(&[2, 0, 1], &Truncation::to(1e-13))?;
    /// assert_eq!(y.modes(), [4, 2, 3]);
    /// assert!((y.entry(&[3, 1, 2])? - x.entry(&[1, 2, 3])?).abs() < 1e-13);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn permute(
        &self,
        order: &[usize],
        truncation: &Truncation,
    ) -> Result<(Self, TruncationReport), TtError> {
        truncation.check()?;
        let d = self.num_cores();
        let mut place = vec![usize::MAX; d];
        order.iter().enumerate().filter(|(_, k)| **k < d).for_each(|(to, &k)| place[k] = to);
        if order.len() != d || place.contains(&usize::MAX) {
            let expected = (0..d).collect();
            return Err(TtError::Shape { what: "order of modes", expected, got: order.to_vec() });
        }
        let Some((mut train, exponent)) = self.balanced()? else {
            let modes: Vec<usize> = order.iter().map(|&k| self.cores[k].mode).collect();
            return Ok((Self::constant(&modes, 0.0)?, TruncationReport::zero()));
        };
        let pairs = |place: &[usize]| -> usize {
            (0..d).map(|k| place[k + 1..].iter().filter(|&&later| later < place[k]).count()).sum()
        };
        let exchanges = pairs(&place);
        let each = truncation.tolerance / exchanges.max(1) as f64;
        train.orthogonalise_right();
        let norm = train.cores[0].data.iter().map(|x| x * x).sum::<f64>().sqrt();
        let (mut error, mut capped, mut centre) = (0.0, false, 0);
        while let Some(k) = (0..d - 1).find(|&k| place[k] > place[k + 1]) {
            while centre < k {
                train.shift_right(centre);
                centre += 1;
            }
            while centre > k {
                train.shift_left(centre);
                centre -= 1;
            }
            let (first, second) = (&train.cores[k], &train.cores[k + 1]);
            let (left, m, n, right) = (first.left, first.mode, second.mode, second.right);
            let entries = (left * m) as f64 * (n * right) as f64;
            if entries > LARGEST_CORE as f64 {
                return Err(TtError::TooLarge { entries });
            }
            let pair = product(first.left_unfolding(), second.right_unfolding());
            // [(alpha, i), (j, beta)] to [(alpha, j), (i, beta)]
            let turned = Matrix::from_fn(left * n, m * right, |row, column| {
                let (alpha, j, i, beta) = (row % left, row / left, column % m, column / m);
                pair[(alpha + left * i, j + n * beta)]
            });
            let mut budget = Budget::new(&Truncation { tolerance: each, ..*truncation }, norm * norm, 1);
            let frame = leading_columns(&turned, &mut budget).map_err(at_core(k))?;
            let report = budget.report(norm * norm, 0.0);
            error += report.error;
            capped |= report.capped;
            let carry = product(frame.t(), turned.view());
            train.cores[k] = Core::from_left_unfolding(left, n, frame);
            train.cores[k + 1] = Core::from_right_unfolding(m, right, carry);
            centre = k + 1;
            place.swap(k, k + 1);
        }
        share_power(&mut train.cores, exponent);
        let floor = self.rounding_floor()?;
        Ok((train, TruncationReport { error, floor, norm: self.norm(), capped }))
    }
}
