//! `tt`: a tensor train in body space where that pays, incomplete Cholesky in contact space where it does not.
//!
//! [`TrainCorrection`](super::train_body::TrainCorrection) decides: by size, by a probe of compressibility once per
//! problem, and by a race for every matrix that passes it. Without a train, conjugate gradients in body space are the poorer choice
//! late in an interior-point run, when the weights H^-1 spread, so that matrices without a train go to conjugate gradients on
//! S~ with block IC(0). A problem that is small, fails the probe, or loses two races in a row is not compressed again.

use super::body::BodyCg;
use super::krylov::SchurKrylov;
use super::train_body::TrainCorrection;
use super::{LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use crate::delassus::Delassus;
use std::collections::BTreeMap;

/// The two solvers and which of them holds the current matrix.
pub struct TensorTrain {
    body: BodyCg,
    local: SchurKrylov,
    with_train: bool,
}

impl Default for TensorTrain {
    fn default() -> Self {
        Self::with(TrainCorrection::default())
    }
}

impl TensorTrain {
    /// Tries a train on problems of any size, also where the attempt takes longer than the solve.
    pub fn at_any_size() -> Self {
        Self::with(TrainCorrection::at_any_size())
    }

    fn with(correction: TrainCorrection) -> Self {
        let body = BodyCg::tensor_train(correction);
        Self { body, local: SchurKrylov::incomplete_cholesky(), with_train: false }
    }
}

impl NewtonSolver for TensorTrain {
    fn name(&self) -> &'static str {
        "tt"
    }

    fn needs_matrix(&self) -> bool {
        true
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        let bodies = matches!(system.problem.delassus, Delassus::Rigid(_));
        self.with_train = false;
        if bodies && (system.new_delassus || self.body.train_may_pay()) {
            self.body.refresh(system)?;
            self.with_train = self.body.train_is_active();
        }
        if self.with_train { Ok(()) } else { self.local.refresh(system) }
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        if self.with_train {
            self.body.solve(system, b, z, relative_tolerance)
        } else {
            self.local.solve(system, b, z, relative_tolerance)
        }
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        self.body.figures(figures);
        figures.insert("train_active".to_string(), f64::from(u8::from(self.with_train)));
    }
}
