//! Compression and inversion of a sparse matrix in tensor-train form, with hot starts from the last matrix.
//! (Corona et al. 2019, Algorithm 2 and the re-use of section 3.3.)

use graintrain_linalg::patience::Patience;
use graintrain_tt::apply::{ApplyWork, FullOperator};
use graintrain_tt::cross::{CrossSettings, cross_sparse_within};
use graintrain_tt::inverse::{InverseForm, inverse_within};
use graintrain_tt::solve::SolveSettings;
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
    operator: Option<FullOperator>,
    work: ApplyWork,
    padded: Vec<f64>,
    image: Vec<f64>,
    figures: BTreeMap<String, f64>,
}

/// Sweeps of the inversion at most: the accuracy asked for is low, and a hot start needs one or two.
const SWEEPS: usize = 4;

/// Nonzeros that are held against the cross's train to measure its error: about this many.
const PROBES: usize = 20_000;

fn mean_rank(matrix: &TtMatrix) -> f64 {
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
            work: ApplyWork::default(),
            padded: Vec::new(),
            image: Vec::new(),
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
                    cross_sparse_within(matrix, self.matrix.as_ref(), stride, &settings, &self.patience)?;
                self.figures.insert("compression_error".to_string(), report.error().unwrap_or(f64::NAN));
                self.figures.insert("cross_evaluations".to_string(), report.evaluations as f64);
                train
            }
        };
        self.figures.insert("compression_seconds".to_string(), start.elapsed().as_secs_f64());
        self.figures.insert("rank_matrix".to_string(), mean_rank(&train));

        let start = Instant::now();
        let settings = SolveSettings { tolerance, max_rank, max_sweeps: SWEEPS, ..SolveSettings::default() };
        let (x, report) = inverse_within(&train, form, self.inverse.as_ref(), &settings, &self.patience)?;
        self.figures.insert("inversion_seconds".to_string(), start.elapsed().as_secs_f64());
        self.figures.insert("inversion_residual".to_string(), report.residual);
        self.figures.insert("inversion_sweeps".to_string(), report.sweeps as f64);
        self.figures.insert("rank_inverse".to_string(), mean_rank(&x));

        let operator = FullOperator::new(&x)?;
        self.padded.resize(operator.num_columns(), 0.0);
        self.image.resize(operator.num_rows(), 0.0);
        self.operator = Some(operator);
        self.matrix = Some(train);
        self.inverse = Some(x);
        Ok(())
    }

    /// Figures of the last refresh: mean ranks, compression error on the nonzeros, seconds.
    pub fn figures(&self) -> &BTreeMap<String, f64> {
        &self.figures
    }

    /// Floating-point operations of one application.
    pub fn flops(&self) -> f64 {
        self.operator.as_ref().map_or(0.0, FullOperator::flops)
    }

    /// z <- P^T X P r, where P puts the `block` unknowns of unit u at `block * place[u]` of the padded vector. Leaves z
    /// as it is where nothing was compressed yet.
    pub fn apply(&mut self, block: usize, place: &[usize], r: &[f64], z: &mut [f64]) {
        let Some(operator) = &self.operator else { return };
        self.padded.fill(0.0);
        for (r, &p) in r.chunks_exact(block).zip(place) {
            self.padded[block * p..block * (p + 1)].copy_from_slice(r);
        }
        // The sizes were fixed in `refresh`, so the product cannot fail.
        if operator.apply(&self.padded, &mut self.image, &mut self.work).is_ok() {
            for (z, &p) in z.chunks_exact_mut(block).zip(place) {
                z.copy_from_slice(&self.image[block * p..block * (p + 1)]);
            }
        }
    }
}
