//! The tensor-train correction of `tt` ([`super::train`]): in body space, and only where it pays.
//!
//! Conjugate gradients on K = I + A A^T with 6x6 block Jacobi are conjugate gradients on K_s = L^-1 K L^-T, L the
//! Cholesky factors of the diagonal blocks. A train X that approximates K_s^-1 makes the preconditioner L^-T X L^-1.
//!
//! Whether it pays is decided in three stages that cost little and do not depend on clocks:
//! 1. *Size*: an inversion takes about as long for a hundred bodies as for a hundred thousand. It is only tried where a long solve by conjugate
//!    gradients takes as many operations.
//! 2. *Compressibility probe*, once per problem: the share of the off-diagonal energy of K_s that a train of the largest
//!    rank allowed captures. It is small on random packings and near one on assemblies that repeat under translation.
//! 3. *Race*, for every matrix that passes: a few iterations with and without X from the same right-hand side. X is used
//!    where it lowers the residual by more per floating-point operation.

use super::NewtonSystem;
use super::body_matrix::BodyMatrix;
use crate::delassus::Delassus;
use crate::tensor_train::inverse::{Compression, TrainInverse, TrainSettings};
use crate::tensor_train::place::body_centres;
use crate::tensor_train::placement::Placement;
use crate::tensor_train::tree::Split;
use graintrain_linalg::krylov::{KrylovSettings, KrylovWork, flexible_conjugate_gradient};
use graintrain_linalg::precond::{BlockJacobi, Preconditioner};
use graintrain_tt::inverse::InverseForm;
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtError};
use std::collections::BTreeMap;

/// Unknowns per body.
const BODY: usize = 6;

/// Accuracy and rank cap of the train: the paper's best preconditioner.
const SETTINGS: TrainSettings = TrainSettings {
    compression: Compression::Exact,
    form: InverseForm::Residual,
    tolerance: 1e-2,
    max_rank: 10,
};

/// Share of the off-diagonal energy below which a train is not tried.
const CAPTURED: f64 = 0.5;

/// Floating-point operations of an inversion at rank 10, about: one to four seconds, whatever the size.
const INVERSION_FLOPS: f64 = 1e10;

/// Iterations of a long solve by conjugate gradients with block Jacobi.
const LONG_SOLVE: f64 = 1000.0;

/// Iterations of the race.
const RACE: usize = 10;

/// Failed races in a row after which no more are run on the same problem.
const FAILURES: usize = 2;

/// Operations of one product with K and one with its diagonal blocks.
fn product_flops(matrix: &BodyMatrix) -> f64 {
    let block = (2 * BODY * BODY) as f64;
    block * (2.0 * matrix.columns().len() as f64 + matrix.num_bodies() as f64)
}

/// The correction and what is known of its worth.
pub struct TrainCorrection {
    placement: Placement,
    inverse: TrainInverse,
    /// Operations of a long solve below which no train is tried.
    least_flops: f64,
    long_enough: bool,
    captured: f64,
    gain: f64,
    failures: usize,
    active: bool,
    krylov: KrylovWork,
    buffer: Vec<f64>,
}

impl Default for TrainCorrection {
    fn default() -> Self {
        Self::from_flops(INVERSION_FLOPS)
    }
}

impl TrainCorrection {
    /// Tried on problems of any size.
    pub fn at_any_size() -> Self {
        Self::from_flops(0.0)
    }

    fn from_flops(least_flops: f64) -> Self {
        Self {
            placement: Placement::new(1, Split::Balanced),
            inverse: TrainInverse::new(SETTINGS),
            least_flops,
            long_enough: false,
            captured: 0.0,
            gain: 0.0,
            failures: 0,
            active: false,
            krylov: KrylovWork::default(),
            buffer: Vec::new(),
        }
    }

    /// Whether the train passed its race and [`Self::apply`] is to be used.
    pub fn is_active(&self) -> bool {
        self.active
    }

    /// Whether the problem is large enough, passed the probe and has not lost too many races.
    pub fn may_pay(&self) -> bool {
        self.long_enough && self.captured >= CAPTURED && self.failures < FAILURES
    }

    /// Adapts to new values of K, whose diagonal blocks `scaling` has factorised.
    ///
    /// # Errors
    /// [`TtError`] where a dense kernel of the tensor-train algorithms fails.
    pub fn refresh(
        &mut self,
        matrix: &BodyMatrix,
        scaling: &BlockJacobi,
        system: &NewtonSystem<'_>,
    ) -> Result<(), TtError> {
        self.active = false;
        let Delassus::Rigid(rigid) = &system.problem.delassus else { return Ok(()) };
        if matrix.num_bodies() < 2 {
            return Ok(());
        }
        if system.new_delassus || self.placement.positions().len() != matrix.num_bodies() {
            let centres = body_centres(system.problem, rigid);
            let identities: Vec<u64> = (0..matrix.num_bodies() as u64).collect();
            if !self.placement.update(&centres, &identities) {
                self.inverse.forget();
            }
            self.failures = 0;
            self.long_enough = LONG_SOLVE * product_flops(matrix) >= self.least_flops;
            let (capacity, depth) = self.placement.shape();
            let entries = self.scaled_entries(matrix, scaling);
            let off_diagonal = QuadtreeMatrix::from_entries(BODY * capacity, depth, entries)?;
            let truncation = Truncation::capped(SETTINGS.tolerance, SETTINGS.max_rank);
            let (_, report) = off_diagonal.to_train(&truncation)?;
            self.captured = if report.norm > 0.0 { 1.0 - report.error.powi(2) } else { 0.0 };
        }
        if !self.may_pay() {
            return Ok(());
        }
        let (capacity, depth) = self.placement.shape();
        let mut entries = self.scaled_entries(matrix, scaling);
        // The diagonal blocks of K_s are identities, and so are the dummies.
        entries.extend((0..BODY * (capacity << depth)).map(|k| (k, k, 1.0)));
        self.inverse.set_patience(system.patience.clone());
        self.inverse.refresh(&QuadtreeMatrix::from_entries(BODY * capacity, depth, entries)?)?;
        self.gain = self.race(matrix, scaling);
        self.active = self.gain > 1.0;
        self.failures = if self.active { 0 } else { self.failures + 1 };
        Ok(())
    }

    /// The off-diagonal entries of K_s at the places of the tree.
    fn scaled_entries(&self, matrix: &BodyMatrix, scaling: &BlockJacobi) -> Vec<(usize, usize, f64)> {
        let place = self.placement.positions();
        let (starts, columns) = (matrix.row_starts(), matrix.columns());
        let mut entries = Vec::with_capacity(2 * BODY * BODY * columns.len());
        for i in 0..matrix.num_bodies() {
            for k in starts[i]..starts[i + 1] {
                let j = columns[k] as usize;
                if i == j {
                    continue;
                }
                let mut block = matrix.blocks()[k];
                scaling.scale(i, j, &mut block);
                for (e, &value) in block.iter().enumerate() {
                    let (row, column) = (BODY * place[i] + e / BODY, BODY * place[j] + e % BODY);
                    entries.push((row, column, value));
                    entries.push((column, row, value));
                }
            }
        }
        entries
    }

    /// z <- L^-T X L^-1 r.
    pub fn apply(&mut self, scaling: &BlockJacobi, r: &[f64], z: &mut [f64]) {
        self.buffer.resize(r.len(), 0.0);
        self.buffer.copy_from_slice(r);
        scaling.solve_lower(&mut self.buffer);
        self.inverse.apply(BODY, self.placement.positions(), &self.buffer, z);
        scaling.solve_upper(z);
    }

    /// Reduction of log residual per floating-point operation with the train over that without; not positive where the
    /// train does not act as a positive definite matrix.
    fn race(&mut self, matrix: &BodyMatrix, scaling: &BlockJacobi) -> f64 {
        let unknowns = BODY * matrix.num_bodies();
        // Any fixed vector without structure will do: multiples of the golden ratio modulo 1.
        let b: Vec<f64> = (0..unknowns).map(|k| (k as f64 * 0.618_033_988_749_894_9).fract() - 0.5).collect();
        let settings = KrylovSettings { relative_tolerance: 0.0, max_iterations: RACE };
        let mut krylov = std::mem::take(&mut self.krylov);
        let mut x = vec![0.0; unknowns];
        let mut run = |apply: &mut dyn FnMut(&[f64], &mut [f64])| {
            x.fill(0.0);
            let product = &mut |x: &[f64], y: &mut [f64]| matrix.multiply(x, y);
            let report = flexible_conjugate_gradient(product, apply, &b, &mut x, settings, &mut krylov);
            (report.iterations, report.residual.ln())
        };
        let (_, without) = run(&mut |r, z| scaling.apply(r, z));
        let (iterations, with) = run(&mut |r, z| self.apply(scaling, r, z));
        self.krylov = krylov;
        if iterations < RACE || !with.is_finite() || with >= 0.0 {
            return 0.0;
        }
        let plain = product_flops(matrix);
        let ratio = if without < 0.0 { with / without } else { f64::INFINITY };
        ratio * plain / (plain + self.inverse.flops())
    }

    /// Named figures of the last refresh.
    pub fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        figures.insert("train_captured_energy".to_string(), self.captured);
        figures.insert("train_race_gain".to_string(), self.gain);
        figures.insert("train_active".to_string(), f64::from(u8::from(self.active)));
        if self.long_enough && self.captured >= CAPTURED {
            figures.extend(self.inverse.figures().clone());
        }
        self.placement.figures(figures);
    }
}
