//! The problem scaled contact by contact, so that trace(N_ii) = 3 and r has unit size.

use crate::delassus::{Delassus, DelassusIdentity, RigidContact, RigidDelassus};
use crate::problem::Ccp;
use crate::residual::ResidualScale;
use graintrain_linalg::block3::BlockMatrix3;
use std::sync::Arc;

/// A scaled problem: g_i = `impulse_unit`_i x_i and u_i = `velocity_unit`_i y_i. One positive factor per
/// contact leaves every cone as it is.
pub(crate) struct Scaled {
    pub problem: Ccp,
    pub impulse_unit: Vec<f64>,
    pub velocity_unit: Vec<f64>,
}

/// The scaled N of a problem, kept so that problems that share N share it, too.
pub(crate) struct ScaledMatrix {
    source: DelassusIdentity,
    scaled: Arc<Delassus>,
}

/// diag(f) N diag(f) with one factor per contact.
fn scale_matrix(delassus: &Delassus, factor: &[f64]) -> Delassus {
    match delassus {
        Delassus::Rigid(rigid) => {
            let scale = |c: &RigidContact, f: f64| RigidContact {
                frame: c.frame.map(|row| row.map(|x| f * x)),
                ..*c
            };
            let contacts = rigid.contacts().iter().zip(factor).map(|(c, &f)| scale(c, f)).collect();
            Delassus::Rigid(RigidDelassus::new(contacts, rigid.inverse_mass().to_vec()))
        }
        Delassus::Sparse(matrix) => {
            let mut scaled: BlockMatrix3 = matrix.clone();
            for i in 0..factor.len() {
                for k in matrix.row_starts()[i]..matrix.row_starts()[i + 1] {
                    let f = factor[i] * factor[matrix.columns()[k] as usize];
                    scaled.blocks_mut()[k] = matrix.blocks()[k].map(|x| f * x);
                }
            }
            Delassus::Sparse(scaled)
        }
    }
}

impl Scaled {
    /// Scales a problem; `last` is the scaled N of the problem before, which is used again where both share
    /// N.
    pub fn new(problem: &Ccp, residual: &ResidualScale, last: &mut Option<ScaledMatrix>) -> Self {
        let factor: Vec<f64> = residual.eta.iter().map(|eta| 1.0 / eta.sqrt()).collect();
        let contacts = factor.len();
        let square: f64 = (0..contacts)
            .map(|i| (0..3).map(|k| (factor[i] * problem.r[3 * i + k]).powi(2)).sum::<f64>())
            .sum();
        let size = (square / contacts.max(1) as f64).sqrt();
        let size = if size > 0.0 { size } else { 1.0 };
        let kept = last.take().filter(|last| last.source.is(&problem.delassus));
        let matrix = last.insert(kept.unwrap_or_else(|| ScaledMatrix {
            source: DelassusIdentity::of(&problem.delassus),
            scaled: Arc::new(scale_matrix(&problem.delassus, &factor)),
        }));
        let r = (0..3 * contacts).map(|k| factor[k / 3] * problem.r[k] / size).collect();
        let problem = Ccp {
            points: problem.points.clone(),
            identity: problem.identity.clone(),
            ..Ccp::bare(Arc::clone(&matrix.scaled), r, problem.friction.clone())
        };
        Self {
            problem,
            impulse_unit: factor.iter().map(|f| size * f).collect(),
            velocity_unit: factor.iter().map(|f| size / f).collect(),
        }
    }
}
