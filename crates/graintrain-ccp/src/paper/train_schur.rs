//! Tensor-train solvers in contact space: the matrix compressed, inverted, and used as preconditioner of
//! BiCGSTAB.
//!
//! `tt-cross` is the recipe of Corona et al. 2019: uniform tree of contacts, identity on the dummies,
//! AMEn-cross on S, AMEn inversion of A X = I, accuracy 1e-2 and ranks up to 10, hot starts, slots kept
//! across steps. It is kept for the record: on random packings the cross does not see the matrix
//! (`compression_error` in its figures tells). Where the paper is silent or this is kinder:
//! * up to 20 000 nonzeros are shown to the cross, and those with the largest errors become pivots;
//! * leaves hold 4 contacts, and the capacity grows where a tree would need more than 8 times as many slots
//!   as contacts;
//! * axes along which the contacts do not extend are not halved;
//! * the inversion makes at most 4 sweeps;
//! * an inverse that is worse than the multiple of the identity it could have started from is replaced by
//!   that, and is no hot start.
//!
//! `tt-schur` mends what can be mended in the same space: S~, symmetric 3x3 block-Jacobi scaling first, exact
//! compression from the nonzero blocks, hardly any dummies, and the residual form of the inverse.

use super::tensor_train::inverse::{Compression, TrainInverse, TrainSettings};
use super::tensor_train::place::contact_points;
use super::tensor_train::placement::Placement;
use super::tensor_train::tree::Split;
use crate::newton::{Form, LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use graintrain_linalg::block3::BlockMatrix3;
use graintrain_linalg::krylov::{KrylovSettings, KrylovWork, bicgstab};
use graintrain_linalg::precond::{BlockJacobi, Preconditioner};
use graintrain_tt::inverse::InverseForm;
use graintrain_tt::sparse::QuadtreeMatrix;
use std::collections::BTreeMap;

/// Contacts per leaf of the paper's tree; the paper does not give its number.
const LEAF_CONTACTS: usize = 4;

/// Contacts per leaf that can be borne: the first mode of the train is the square of three times this.
const LARGEST_LEAF: usize = 100;

/// Accuracy and rank cap of the paper's best preconditioner.
const PAPER: (f64, usize) = (1e-2, 10);

/// Cap on iterations of BiCGSTAB, as for the paper's unpreconditioned baseline.
const LIMIT: usize = 1000;

/// BiCGSTAB, preconditioned by a compressed inverse.
pub struct TrainSchur {
    name: &'static str,
    placement: Placement,
    /// Present where the matrix is scaled before it is compressed.
    scaling: Option<BlockJacobi>,
    scaled: Option<BlockMatrix3>,
    inverse: TrainInverse,
    krylov: KrylovWork,
    buffer: Vec<f64>,
}

impl TrainSchur {
    /// The paper's recipe at its accuracy and rank cap.
    pub fn literal() -> Self {
        Self::literal_at(PAPER.0, PAPER.1)
    }

    /// The paper's recipe at another accuracy and rank cap (its tables 3 and 4).
    pub fn literal_at(tolerance: f64, max_rank: usize) -> Self {
        let settings =
            TrainSettings { compression: Compression::Cross, form: InverseForm::Energy, tolerance, max_rank };
        Self::new("tt-cross", Placement::new(LEAF_CONTACTS, Split::Uniform), None, settings)
    }

    /// Scaled, compressed exactly.
    pub fn scaled() -> Self {
        let settings = TrainSettings {
            compression: Compression::Exact,
            form: InverseForm::Residual,
            tolerance: PAPER.0,
            max_rank: PAPER.1,
        };
        let scaling = Some(BlockJacobi::new(3));
        Self::new("tt-schur", Placement::new(1, Split::Balanced), scaling, settings)
    }

    fn new(
        name: &'static str,
        placement: Placement,
        scaling: Option<BlockJacobi>,
        settings: TrainSettings,
    ) -> Self {
        Self {
            name,
            placement,
            scaling,
            scaled: None,
            inverse: TrainInverse::new(settings),
            krylov: KrylovWork::default(),
            buffer: Vec::new(),
        }
    }

    fn breakdown(&self, error: &dyn std::fmt::Display) -> NewtonError {
        NewtonError::Breakdown { solver: self.name, reason: error.to_string() }
    }
}

impl NewtonSolver for TrainSchur {
    fn name(&self) -> &'static str {
        self.name
    }

    fn full_name(&self) -> String {
        let TrainSettings { tolerance, max_rank, .. } = *self.inverse.settings();
        if (tolerance, max_rank) == PAPER {
            self.name.to_string()
        } else {
            format!("{}@{tolerance:e}:{max_rank}", self.name)
        }
    }

    fn form(&self) -> Form {
        if self.scaling.is_some() { Form::Scaled } else { Form::Plain }
    }

    fn needs_matrix(&self) -> bool {
        true
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        let Some(schur) = system.matrix else { return Ok(()) };
        if schur.num_rows() == 0 {
            return Ok(());
        }
        if system.new_delassus || self.placement.positions().len() != schur.num_rows() {
            let points = contact_points(system.problem);
            if !self.placement.update(&points, &system.problem.identity) {
                self.inverse.forget();
            }
            self.scaled = None;
        }
        let matrix = match &mut self.scaling {
            None => schur,
            Some(scaling) => {
                if let Err(error) = scaling.refresh(schur) {
                    return Err(self.breakdown(&error));
                }
                let scaled = self.scaled.get_or_insert_with(|| schur.clone());
                scaling.scale_matrix(schur, scaled);
                scaled
            }
        };
        let (capacity, depth) = self.placement.shape();
        if capacity > LARGEST_LEAF {
            return Err(self.breakdown(&format!(
                "{capacity} contacts share a leaf of the tree, more than {LARGEST_LEAF}: they lie too close together to be \
                 distinguished by halving space"
            )));
        }
        self.inverse.set_patience(system.patience.clone());
        QuadtreeMatrix::from_blocks(matrix.iter(), self.placement.positions(), capacity, depth, 1.0)
            .and_then(|quadtree| self.inverse.refresh(&quadtree))
            .map_err(|error| self.breakdown(&error))
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        z.fill(0.0);
        let Some(schur) = system.matrix else { return LinearReport { residual: 1.0, ..Default::default() } };
        let settings = KrylovSettings { relative_tolerance, max_iterations: LIMIT };
        let Self { placement, scaling, inverse, krylov, buffer, .. } = self;
        krylov.patience = system.patience.clone();
        let place = placement.positions();
        let report = bicgstab(
            &mut |x, y| schur.multiply(x, y),
            &mut |r, z| match scaling {
                None => inverse.apply(3, place, r, z),
                Some(scaling) => {
                    buffer.resize(r.len(), 0.0);
                    buffer.copy_from_slice(r);
                    scaling.solve_lower(buffer);
                    inverse.apply(3, place, buffer, z);
                    scaling.solve_upper(z);
                }
            },
            b,
            z,
            settings,
            krylov,
        );
        report.into()
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        figures.extend(self.inverse.figures().clone());
        self.placement.figures(figures);
    }
}
