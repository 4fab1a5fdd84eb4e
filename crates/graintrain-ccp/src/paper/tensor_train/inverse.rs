//! Compression and inversion of a sparse matrix in tensor-train form, with hot starts from the last matrix.
//! (Corona et al. 2019, Algorithm 2 and the re-use of section 3.3.)

use super::padded::PaddedOperator;
use graintrain_linalg::patience::Patience;
use graintrain_tt::cross::{CrossSettings, cross_sparse_within};
use graintrain_tt::inverse::{InverseForm, inverse_residual, inverse_within};
use graintrain_tt::solve::{SolveReport, SolveSettings};
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtError, TtMatrix};
use std::collections::BTreeMap;
use std::time::Instant;

/// How the train of the matrix is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// AMEn-cross: samples entries, starts from the last train. The paper's.
    Cross,
    /// One pass over the nonzero blocks: every entry is seen, the error is exact.
    Exact,
}

/// Settings of a compressed inverse.
#[derive(Clone, Copy, Debug)]
pub struct TrainSettings {
    /// How the matrix is compressed.
    pub compression: Compression,
    /// Equation that defines the inverse.
    pub form: InverseForm,
    /// Relative accuracy of compression and inversion. The paper: 1e-2.
    pub tolerance: f64,
    /// No rank above this. The paper: 10.
    pub max_rank: usize,
}

/// X, a train that approximates the inverse of the last matrix.
pub struct TrainInverse {
    settings: TrainSettings,
    patience: Patience,
    matrix: Option<TtMatrix>,
    inverse: Option<TtMatrix>,
    operator: Option<PaddedOperator>,
    figures: BTreeMap<String, f64>,
}

/// Sweeps of the inversion at most: the accuracy asked for is low, and a hot start needs one or two.
const SWEEPS: usize = 4;

/// Residuals ||A X - I|| / ||I|| from this on (X = 0 has it) are worse than that of the cold start c I, which
/// is never larger.
const DIVERGED: f64 = 1.0;

/// Nonzeros that are held against the cross's train to measure its error: about this many.
const PROBES: usize = 20_000;

/// Mean of the inner ranks r_1, ..., r_{d-1}: the figure of the paper's table 3.
pub fn mean_rank(matrix: &TtMatrix) -> f64 {
    let ranks = matrix.ranks();
    let inner = &ranks[1..ranks.len() - 1];
    inner.iter().sum::<usize>() as f64 / inner.len().max(1) as f64
}

impl TrainInverse {
    /// Nothing is compressed yet.
    pub fn new(settings: TrainSettings) -> Self {
        Self {
            settings,
            patience: Patience::default(),
            matrix: None,
            inverse: None,
            operator: None,
            figures: BTreeMap::new(),
        }
    }

    /// The settings.
    pub fn settings(&self) -> &TrainSettings {
        &self.settings
    }

    /// Compression and inversion end where this does.
    pub fn set_patience(&mut self, patience: Patience) {
        self.patience = patience;
    }

    /// Forgets the trains: the next matrix starts cold.
    pub fn forget(&mut self) {
        self.matrix = None;
        self.inverse = None;
        self.operator = None;
    }

    /// Compresses the matrix and inverts the train, each starting from the last one where the sizes agree.
    ///
    /// # Errors
    /// [`TtError`] where an entry is not finite, a dense kernel fails, or the patience ends.
    pub fn refresh(&mut self, matrix: &QuadtreeMatrix) -> Result<(), TtError> {
        let TrainSettings { compression, form, tolerance, max_rank } = self.settings;
        self.figures.clear();
        if self.matrix.as_ref().is_some_and(|old| old.row_modes() != matrix.modes()) {
            self.forget();
        }
        let patience = self.patience.clone();
        let stop = move || patience.is_over();
        let start = Instant::now();
        let train = match compression {
            Compression::Exact => {
                let (train, report) = matrix.to_train(&Truncation::capped(tolerance, max_rank))?;
                self.figures.insert("compression_error".to_string(), report.error);
                train
            }
            Compression::Cross => {
                let settings = CrossSettings { tolerance, max_rank, ..CrossSettings::default() };
                let stride = matrix.num_entries() / PROBES + 1;
                let (train, report) =
                    cross_sparse_within(matrix, self.matrix.as_ref(), stride, &settings, &stop)?;
                self.figures.insert("compression_error".to_string(), report.error().unwrap_or(f64::NAN));
                self.figures.insert("cross_evaluations".to_string(), report.evaluations as f64);
                train
            }
        };
        self.figures.insert("compression_seconds".to_string(), start.elapsed().as_secs_f64());
        self.figures.insert("rank_matrix".to_string(), mean_rank(&train));

        let start = Instant::now();
        let settings = SolveSettings { tolerance, max_rank, max_sweeps: SWEEPS, ..SolveSettings::default() };
        let invert = |start| inverse_within(&train, form, start, &settings, &stop);
        let (mut x, mut report) = invert(self.inverse.as_ref())?;
        let diverged = |report: &SolveReport| report.residual.is_nan() || report.residual >= DIVERGED;
        if self.inverse.is_some() && diverged(&report) {
            // The last inverse was no good start.
            let cold = invert(None)?;
            if report.residual.is_nan() || cold.1.residual < report.residual {
                (x, report) = cold;
            }
        }
        let diverged = diverged(&report);
        if diverged {
            // The start itself is nearer.
            x = TtMatrix::identity(train.row_modes())?.scale(train.trace()? / train.norm() / train.norm());
            report.residual = inverse_residual(&train, &x)?;
        }
        self.figures.insert("inversion_diverged".to_string(), f64::from(u8::from(diverged)));
        self.figures.insert("inversion_seconds".to_string(), start.elapsed().as_secs_f64());
        self.figures.insert("inversion_residual".to_string(), report.residual);
        self.figures.insert("inversion_sweeps".to_string(), report.sweeps as f64);
        self.figures.insert("rank_inverse".to_string(), mean_rank(&x));

        self.operator = Some(PaddedOperator::new(&x)?);
        self.matrix = Some(train);
        self.inverse = (!diverged).then_some(x);
        Ok(())
    }

    /// Figures of the last refresh: mean ranks, compression error on the nonzeros, seconds.
    pub fn figures(&self) -> &BTreeMap<String, f64> {
        &self.figures
    }

    /// Floating-point operations of an inversion, from the train of the matrix without its unit diagonal: per
    /// sweep and site a local system of size m = r n r' is formed, 2 m^2 R, and factored, m^3 / 3. R is the
    /// larger rank of the operator beside the site, squared in the residual form; r and r' the largest ranks
    /// allowed, with those of the enrichment.
    pub fn predicted_flops(&self, off_diagonal: &TtMatrix) -> f64 {
        let (modes, ranks) = (off_diagonal.row_modes(), off_diagonal.ranks());
        let power = if self.settings.form == InverseForm::Residual { 2 } else { 1 };
        // No rank exceeds the number of entries on either side of its bond.
        let entries = |modes: &[usize]| modes.iter().map(|&n| (n * n) as f64).product::<f64>();
        let bound = |bond: usize| entries(&modes[..bond]).min(entries(&modes[bond..]));
        let kick = SolveSettings::default().kick_rank;
        let unknown = |bond: usize| bound(bond).min((self.settings.max_rank.saturating_add(kick)) as f64);
        let operator = |bond: usize| bound(bond).min(((ranks[bond] + 1) as f64).powi(power));
        let site = |k: usize| {
            let size = unknown(k) * modes[k] as f64 * unknown(k + 1);
            2.0 * size * size * operator(k).max(operator(k + 1)) + size.powi(3) / 3.0
        };
        SWEEPS as f64 * (0..modes.len()).map(site).sum::<f64>()
    }

    /// Floating-point operations of one application.
    pub fn flops(&self) -> f64 {
        self.operator.as_ref().map_or(0.0, PaddedOperator::flops)
    }

    /// z <- P^T X P r; see [`PaddedOperator::apply`]. Leaves z as it is where nothing was compressed yet.
    pub fn apply(&mut self, block: usize, place: &[usize], r: &[f64], z: &mut [f64]) {
        if let Some(operator) = &mut self.operator {
            operator.apply(block, place, r, z);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delassus::tests::uniform;

    /// Symmetric matrices of changing size and structure, compressed far too much: some inversions run away
    /// from their start, hot or cold, and what is left is always better than nothing.
    #[test]
    fn a_diverged_inverse_is_neither_used_nor_a_start() {
        for seed in 0..6 {
            let mut random = uniform(seed);
            let settings = TrainSettings {
                compression: Compression::Exact,
                form: InverseForm::Energy,
                tolerance: 1e-2,
                max_rank: 3,
            };
            let mut inverse = TrainInverse::new(settings);
            for step in 0..4 {
                let size = 10.0_f64.powi(step - 1);
                let entries: Vec<(usize, usize, f64)> = (0..64)
                    .flat_map(|i| {
                        let (j, x) = ((random() * 64.0) as usize % 64, size * (random() - 0.5));
                        [(i, j, x), (j, i, x), (i, i, 1.0)]
                    })
                    .collect();
                let matrix = QuadtreeMatrix::from_entries(2, 5, entries).unwrap();
                inverse.refresh(&matrix).unwrap();
                let figures = inverse.figures();
                assert!(figures["inversion_residual"] < 1.0, "{}", figures["inversion_residual"]);
                assert_eq!(inverse.inverse.is_none(), figures["inversion_diverged"] == 1.0);
            }
        }
    }
}
