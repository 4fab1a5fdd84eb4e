//! `tt`: a tensor train in body space where that pays, incomplete Cholesky ([`crate::newton::incomplete`])
//! where it does not.
//!
//! Conjugate gradients with block IC(0) are the baseline: ten iterations of theirs tell what a solve costs. A
//! train is made only where its prediction is cheaper than that, and used where it then wins
//! ([`TrainCorrection`]). After a loss, or a train that breaks down, the next try waits, four times longer
//! after every loss in a row, also from one problem to the next.

use super::train_body::{NAME, TrainCorrection};
use crate::delassus::Delassus;
use crate::newton::body::{BodyCg, BodyCorrection};
use crate::newton::incomplete::IncompleteCholeskyCg;
use crate::newton::{ConvergenceRate, LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use std::collections::BTreeMap;

/// Matrices to pass after the first loss.
const WAIT: u32 = 8;
/// Factor on the wait after every further loss.
const BACK_OFF: u32 = 4;
/// Longest wait.
const LONGEST_WAIT: u32 = 4096;

/// The two solvers and which of them holds the current matrix.
pub struct TensorTrain {
    body: BodyCg,
    local: IncompleteCholeskyCg,
    with_train: bool,
    /// Whether this matrix was a try.
    tried: bool,
    /// Whether the train has not been given the present N yet.
    unseen: bool,
    losses: u32,
    wait: u32,
    /// Whether to wait after a loss.
    patient: bool,
}

impl Default for TensorTrain {
    fn default() -> Self {
        Self::with(TrainCorrection::default())
    }
}

impl TensorTrain {
    /// Tries a train on every matrix, also where the attempt takes longer than the solve.
    pub fn at_any_size() -> Self {
        Self { patient: false, ..Self::with(TrainCorrection::at_any_price()) }
    }

    fn with(correction: TrainCorrection) -> Self {
        Self {
            body: BodyCg::corrected(NAME, Box::new(correction)),
            local: IncompleteCholeskyCg::default(),
            with_train: false,
            tried: false,
            unseen: true,
            losses: 0,
            wait: 0,
            patient: true,
        }
    }

    /// The next try waits.
    fn lose(&mut self) {
        if !self.patient {
            return;
        }
        self.wait = WAIT.saturating_mul(BACK_OFF.saturating_pow(self.losses)).min(LONGEST_WAIT);
        self.losses = self.losses.saturating_add(1);
    }

    /// Tries a train on this matrix; whether it paid.
    fn try_train(&mut self, system: &NewtonSystem<'_>, baseline: ConvergenceRate) -> bool {
        let system = NewtonSystem { new_delassus: self.unseen, ..*system };
        self.tried = true;
        // A train that breaks down has lost: the baseline is there.
        match self.body.refresh_against(&system, Some(baseline)) {
            Ok(()) => {
                self.unseen = false;
                self.with_train = self.body.correction().is_some_and(BodyCorrection::is_active);
                self.body.correction().is_some_and(BodyCorrection::has_paid)
            }
            Err(_) => {
                self.unseen = true;
                false
            }
        }
    }
}

impl NewtonSolver for TensorTrain {
    fn name(&self) -> &'static str {
        NAME
    }

    fn needs_matrix(&self) -> bool {
        false
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        (self.with_train, self.tried) = (false, false);
        self.unseen |= system.new_delassus;
        self.local.refresh(system)?;
        if !matches!(*system.problem.delassus, Delassus::Rigid(_)) {
            return Ok(());
        }
        if self.wait > 0 {
            self.wait -= 1;
            return Ok(());
        }
        let Some(baseline) = self.local.measure(system) else { return Ok(()) };
        if self.try_train(system, baseline) {
            self.losses = 0;
        } else {
            self.lose();
        }
        Ok(())
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        let mut spent = 0;
        if self.with_train {
            let report = self.body.solve(system, b, z, relative_tolerance);
            if report.converged {
                return report;
            }
            spent = report.iterations;
            self.with_train = false;
            self.lose();
        }
        let report = self.local.solve(system, b, z, relative_tolerance);
        LinearReport { iterations: report.iterations + spent, ..report }
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        if self.tried {
            self.body.figures(figures);
        }
        if !self.with_train {
            self.local.figures(figures);
        }
        figures.insert("train_active".to_string(), f64::from(u8::from(self.with_train)));
    }
}
