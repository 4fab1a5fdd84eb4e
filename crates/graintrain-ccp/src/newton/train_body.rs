//! The tensor-train correction of `tt` ([`super::train`]): in body space, and only where it pays.
//!
//! Conjugate gradients on K = I + A A^T with 6x6 block Jacobi are conjugate gradients on K_s = L^-1 K L^-T, L the
//! Cholesky factors of the diagonal blocks. A train X that approximates K_s^-1 makes the preconditioner L^-T X L^-1.
//!
//! Whether it pays is decided in three stages that do not depend on clocks:
//! 1. *Compressibility probe*: the share of the off-diagonal energy of K_s that a train of the largest rank allowed captures.
//!    It is small on random packings and near one on assemblies that repeat under translation.
//! 2. *Prediction*: floating-point operations of the inversion, from the ranks found by the probe, against those of a whole
//!    solve by the rival.
//! 3. *Race*: a few iterations with X. It is used where it lowers the residual by more per operation than the rival.

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

/// Iterations of the race.
pub(super) const RACE: usize = 10;

/// Reduction of the residual that a solve is taken to be asked for.
const ASKED: f64 = 1e-6;

/// A right-hand side without structure: multiples of the golden ratio modulo 1.
pub(super) fn unstructured(size: usize) -> Vec<f64> {
    (0..size).map(|k| (k as f64 * 0.618_033_988_749_894_9).fract() - 0.5).collect()
}

/// How fast an iteration is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rival {
    /// Mean decrease of the logarithm of the residual per iteration; not positive where it does not fall.
    decay: f64,
    /// Floating-point operations per iteration.
    flops: f64,
}

impl Rival {
    /// From what some iterations did to the residual, 1 at first.
    pub(super) fn new(iterations: usize, residual: f64, flops: f64) -> Self {
        let fallen = if residual.is_finite() { -residual.max(f64::MIN_POSITIVE).ln() } else { 0.0 };
        Self { decay: fallen / iterations.max(1) as f64, flops }
    }

    /// Operations of a solve.
    fn solve_flops(&self) -> f64 {
        if self.decay > 0.0 { (-ASKED.ln() / self.decay).max(1.0) * self.flops } else { f64::INFINITY }
    }
}

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

    /// Whether the train passed its race and [`Self::apply`] is to be used.
    pub fn is_active(&self) -> bool {
        self.active
    }

    /// The train proved to be of no use for this matrix.
    pub(super) fn give_up(&mut self) {
        (self.active, self.paid) = (false, false);
    }

    /// Whether the train is in use and its inversion, too, is paid for by one solve.
    pub(super) fn has_paid(&self) -> bool {
        self.paid
    }

    /// Adapts to new values of K, whose diagonal blocks `scaling` has factorised. Without a rival the train races against
    /// conjugate gradients with these blocks, and its price does not count.
    ///
    /// # Errors
    /// [`TtError`] where a dense kernel of the tensor-train algorithms fails, or the patience ends; the next train then
    /// starts cold.
    pub(super) fn refresh(
        &mut self,
        matrix: &BodyMatrix,
        scaling: &BlockJacobi,
        system: &NewtonSystem<'_>,
        rival: Option<Rival>,
    ) -> Result<(), TtError> {
        (self.active, self.paid) = (false, false);
        self.figures.clear();
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
            self.placement.figures(&mut self.figures);
        }
        let built = self.build(matrix, scaling, system, rival);
        if built.is_err() {
            self.inverse.forget();
        }
        built
    }

    /// Probe, prediction, train and race.
    fn build(
        &mut self,
        matrix: &BodyMatrix,
        scaling: &BlockJacobi,
        system: &NewtonSystem<'_>,
        rival: Option<Rival>,
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
        let bearable = self.at_any_price || rival.is_none_or(|rival| price <= rival.solve_flops());
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
        let (rival, price) = match rival {
            Some(rival) => (rival, price),
            None => (self.measure_alone(matrix, scaling), 0.0),
        };
        let gain = rival.solve_flops() / with.solve_flops();
        self.figures.insert("train_race_gain".to_string(), gain);
        self.active = gain > 1.0;
        self.paid = self.active && price + with.solve_flops() <= rival.solve_flops();
        Ok(())
    }

    /// z <- L^-T X L^-1 r.
    pub fn apply(&mut self, scaling: &BlockJacobi, r: &[f64], z: &mut [f64]) {
        self.buffer.resize(r.len(), 0.0);
        self.buffer.copy_from_slice(r);
        scaling.solve_lower(&mut self.buffer);
        self.inverse.apply(BODY, self.placement.positions(), &self.buffer, z);
        scaling.solve_upper(z);
    }

    /// Iterations with the train.
    fn measure(&mut self, matrix: &BodyMatrix, scaling: &BlockJacobi) -> Rival {
        let mut krylov = std::mem::take(&mut self.krylov);
        let (iterations, residual) =
            few_iterations(matrix, &mut |r, z| self.apply(scaling, r, z), &mut krylov);
        self.krylov = krylov;
        // Where the train does not act as a positive definite matrix the iteration breaks down.
        let residual = if iterations < RACE && residual > ASKED { 1.0 } else { residual };
        Rival::new(iterations, residual, product_flops(matrix) + self.inverse.flops())
    }

    /// Iterations with block Jacobi alone.
    fn measure_alone(&mut self, matrix: &BodyMatrix, scaling: &BlockJacobi) -> Rival {
        let (iterations, residual) =
            few_iterations(matrix, &mut |r, z| scaling.apply(r, z), &mut self.krylov);
        Rival::new(iterations, residual, product_flops(matrix))
    }

    /// Named figures of what the last refresh measured.
    pub fn figures(&self, figures: &mut BTreeMap<String, f64>) {
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

/// Operations of a product with K and with its diagonal blocks.
pub(super) fn product_flops(matrix: &BodyMatrix) -> f64 {
    let block = (2 * BODY * BODY) as f64;
    block * (2.0 * matrix.columns().len() as f64 + matrix.num_bodies() as f64)
}

/// A few conjugate gradient iterations on K: how many, and the residual they leave.
pub(super) fn few_iterations(
    matrix: &BodyMatrix,
    precondition: &mut dyn FnMut(&[f64], &mut [f64]),
    krylov: &mut KrylovWork,
) -> (usize, f64) {
    let b = unstructured(BODY * matrix.num_bodies());
    let mut x = vec![0.0; b.len()];
    let settings = KrylovSettings { relative_tolerance: 0.0, max_iterations: RACE };
    let product = &mut |x: &[f64], y: &mut [f64]| matrix.multiply(x, y);
    let report = flexible_conjugate_gradient(product, precondition, &b, &mut x, settings, krylov);
    (report.iterations, report.residual)
}
