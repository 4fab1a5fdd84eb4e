//! The tensor-train correction of `tt` ([`super::train`]): in body space, and only where it pays.
//!
//! Conjugate gradients on K = I + A A^T with 6x6 block Jacobi are conjugate gradients on K_s = L^-1 K L^-T, L
//! the Cholesky factors of the diagonal blocks. A train X that approximates K_s^-1 makes the preconditioner
//! L^-T X L^-1.
//!
//! Whether it pays is decided in three stages that do not depend on clocks:
//! 1. *Compressibility probe*: the share of the off-diagonal energy of K_s that a train of the largest rank
//!    allowed captures. It is small on random packings and near one on assemblies that repeat under
//!    translation.
//! 2. *Prediction*: floating-point operations of the inversion, from the ranks found by the probe, against
//!    those of a whole solve by the baseline.
//! 3. *Race*: a few iterations with X. It is used where it lowers the residual by more per operation than the
//!    baseline.

use super::tensor_train::inverse::{Compression, TrainInverse, TrainSettings};
use super::tensor_train::place::body_centres;
use super::tensor_train::placement::Placement;
use super::tensor_train::tree::Split;
use crate::delassus::Delassus;
use crate::newton::body::BodyCorrection;
use crate::newton::body_matrix::BodyMatrix;
use crate::newton::convergence::{ASKED, ConvergenceRate, SAMPLE, few_iterations, product_flops};
use crate::newton::{NewtonError, NewtonSystem};
use graintrain_linalg::krylov::KrylovWork;
use graintrain_linalg::precond::{BlockJacobi, Preconditioner};
use graintrain_tt::inverse::InverseForm;
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtError};
use std::collections::BTreeMap;

/// Unknowns per body.
const BODY: usize = 6;

/// Name of the linear solver.
pub(super) const NAME: &str = "tt";

/// Accuracy and rank cap of the train: the paper's best preconditioner.
const SETTINGS: TrainSettings = TrainSettings {
    compression: Compression::Exact,
    form: InverseForm::Residual,
    tolerance: 1e-2,
    max_rank: 10,
};

/// Share of the off-diagonal energy below which a train is not tried.
const CAPTURED: f64 = 0.5;

/// The correction and what is known of its worth.
pub struct TrainCorrection {
    placement: Placement,
    inverse: TrainInverse,
    /// Whether a train is made whatever its inversion costs.
    at_any_price: bool,
    active: bool,
    paid: bool,
    krylov: KrylovWork,
    buffer: Vec<f64>,
    figures: BTreeMap<String, f64>,
}

impl Default for TrainCorrection {
    fn default() -> Self {
        Self {
            placement: Placement::new(1, Split::Balanced),
            inverse: TrainInverse::new(SETTINGS),
            at_any_price: false,
            active: false,
            paid: false,
            krylov: KrylovWork::default(),
            buffer: Vec::new(),
            figures: BTreeMap::new(),
        }
    }
}

impl TrainCorrection {
    /// Inverts whatever passes the probe, also where that takes longer than a solve.
    pub fn at_any_price() -> Self {
        Self { at_any_price: true, ..Self::default() }
    }

    /// Probe, prediction, train and race.
    fn build(
        &mut self,
        matrix: &BodyMatrix,
        scaling: &BlockJacobi,
        system: &NewtonSystem<'_>,
        baseline: Option<ConvergenceRate>,
    ) -> Result<(), TtError> {
        let mut note = |name: &str, value: f64| self.figures.insert(name.to_string(), value);
        let (capacity, depth) = self.placement.shape();
        let place = self.placement.positions();
        let mut entries = scaled_entries(matrix, scaling, place);
        let off_diagonal = QuadtreeMatrix::from_entries(BODY * capacity, depth, entries.iter().copied())?;
        let truncation = Truncation::capped(SETTINGS.tolerance, SETTINGS.max_rank);
        let (train, report) = off_diagonal.to_train(&truncation)?;
        let captured = if report.norm > 0.0 { 1.0 - report.error.powi(2) } else { 0.0 };
        note("train_captured_energy", captured);
        let price = self.inverse.predicted_flops(&train);
        note("train_predicted_flops", price);
        let bearable = self.at_any_price || baseline.is_none_or(|baseline| price <= baseline.solve_flops());
        if captured < CAPTURED || !bearable {
            return Ok(());
        }
        // The diagonal blocks of K_s are identities, and so are the dummies.
        entries.extend((0..BODY * (capacity << depth)).map(|k| (k, k, 1.0)));
        self.inverse.set_patience(system.patience.clone());
        let full = QuadtreeMatrix::from_entries(BODY * capacity, depth, entries)?;
        self.inverse.refresh(&full)?;
        self.figures.extend(self.inverse.figures().clone());
        // Of what has to be compressed, not of the unit diagonal, which is there for nothing.
        if let Some(error) = self.figures.get_mut("compression_error") {
            *error *= full.norm() / off_diagonal.norm().max(f64::MIN_POSITIVE);
        }
        let with = self.measure(matrix, scaling);
        let (baseline, price) = match baseline {
            Some(baseline) => (baseline, price),
            None => (self.measure_alone(matrix, scaling), 0.0),
        };
        let gain = baseline.solve_flops() / with.solve_flops();
        self.figures.insert("train_race_gain".to_string(), gain);
        self.active = gain > 1.0;
        self.paid = self.active && price + with.solve_flops() <= baseline.solve_flops();
        Ok(())
    }

    /// Iterations with the train.
    fn measure(&mut self, matrix: &BodyMatrix, scaling: &BlockJacobi) -> ConvergenceRate {
        let mut krylov = std::mem::take(&mut self.krylov);
        let (iterations, residual) =
            few_iterations(matrix, &mut |r, z| self.apply(scaling, r, z), &mut krylov);
        self.krylov = krylov;
        // Where the train does not act as a positive definite matrix the iteration breaks down.
        let residual = if iterations < SAMPLE && residual > ASKED { 1.0 } else { residual };
        ConvergenceRate::new(iterations, residual, product_flops(matrix) + self.inverse.flops())
    }

    /// Iterations with block Jacobi alone.
    fn measure_alone(&mut self, matrix: &BodyMatrix, scaling: &BlockJacobi) -> ConvergenceRate {
        let (iterations, residual) =
            few_iterations(matrix, &mut |r, z| scaling.apply(r, z), &mut self.krylov);
        ConvergenceRate::new(iterations, residual, product_flops(matrix))
    }
}

impl BodyCorrection for TrainCorrection {
    fn refresh(
        &mut self,
        matrix: &BodyMatrix,
        jacobi: &BlockJacobi,
        system: &NewtonSystem<'_>,
        baseline: Option<ConvergenceRate>,
    ) -> Result<(), NewtonError> {
        (self.active, self.paid) = (false, false);
        self.figures.clear();
        let Delassus::Rigid(rigid) = &*system.problem.delassus else { return Ok(()) };
        if matrix.num_bodies() < 2 {
            return Ok(());
        }
        if system.new_delassus || self.placement.positions().len() != matrix.num_bodies() {
            let centres = body_centres(system.problem, rigid);
            let identities: Vec<u64> = (0..matrix.num_bodies() as u64).collect();
            if !self.placement.update(&centres, &identities) {
                self.inverse.forget();
            }
            self.placement.figures(&mut self.figures);
        }
        // Where a dense kernel of the tensor-train algorithms fails, or the patience ends, the next train
        // starts cold.
        self.build(matrix, jacobi, system, baseline).map_err(|error| {
            self.inverse.forget();
            NewtonError::Breakdown { solver: NAME, reason: error.to_string() }
        })
    }

    fn is_active(&self) -> bool {
        self.active
    }

    fn has_paid(&self) -> bool {
        self.paid
    }

    fn give_up(&mut self) {
        (self.active, self.paid) = (false, false);
    }

    /// z <- L^-T X L^-1 r.
    fn apply(&mut self, jacobi: &BlockJacobi, r: &[f64], z: &mut [f64]) {
        self.buffer.resize(r.len(), 0.0);
        self.buffer.copy_from_slice(r);
        jacobi.solve_lower(&mut self.buffer);
        self.inverse.apply(BODY, self.placement.positions(), &self.buffer, z);
        jacobi.solve_upper(z);
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        figures.extend(self.figures.clone());
        figures.insert("train_active".to_string(), f64::from(u8::from(self.active)));
    }
}

/// The off-diagonal entries of K_s at the places of the tree.
fn scaled_entries(matrix: &BodyMatrix, scaling: &BlockJacobi, place: &[usize]) -> Vec<(usize, usize, f64)> {
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
