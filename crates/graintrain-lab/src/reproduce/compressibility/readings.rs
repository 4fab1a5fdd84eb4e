//! Readings of the recipe: what the paper's text leaves open, each as a setting.

use super::inverse::Kind;
use super::system::{Bed, LEAF, System, mean_diagonal};
use crate::reproduce::ReproduceError;
use graintrain_ccp::paper::tensor_train::tree::Split;
use graintrain_linalg::block3::BlockMatrix3;
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtError, TtMatrix};

/// What an accuracy eps is relative to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Norm {
    /// ||S^|| with the dummies, as TT-Toolbox takes it.
    Augmented,
    /// 1: ||S^ - T||_F < eps as the paper's section 3.1 writes it.
    Absolute,
    /// The largest barrier block.
    Barrier,
    /// Every nonzero entry to eps times the largest one.
    Largest,
    /// ||S|| without the dummies.
    Unknowns,
}

/// What is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// S.
    Plain,
    /// L^-1 S L^-T, the diagonal blocks being identities.
    Scaled,
    /// S plus the mean diagonal entry of N times the identity: contacts as soft as the bodies are heavy. The
    /// system that is solved is that one, too.
    Compliant,
    /// S with every contact's impulse in world axes.
    WorldAxes,
}

/// One reading.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Name in the table.
    pub name: &'static str,
    /// What is compressed.
    pub form: Form,
    /// Largest number of contacts in a leaf.
    pub leaf: usize,
    /// How space is halved; halving the number of contacts leaves hardly any dummies.
    pub split: Split,
    /// Whether the identity on the dummies is scaled to the mean diagonal entry.
    pub matched_dummies: bool,
    /// What eps is relative to.
    pub norm: Norm,
    /// What X is; the iteration takes the place of an exact inverse that is too large.
    pub inverse: Kind,
    /// Relative residual of the linear solves.
    pub tolerance: f64,
}

/// Sweeps of the inversion in the recipe as `tt-cross` has it, and where they are not limited.
pub const SWEEPS: [usize; 2] = [4, 40];

/// The recipe as the paper's text has it.
pub const BASE: Reading = Reading {
    name: "base",
    form: Form::Plain,
    leaf: LEAF,
    split: Split::Uniform,
    matched_dummies: false,
    norm: Norm::Augmented,
    inverse: Kind::Truncated,
    tolerance: 1e-4,
};

/// The others, and last two attempts at a train that is definite by construction.
pub const READINGS: [Reading; 12] = [
    Reading { name: "absolute", norm: Norm::Absolute, ..BASE },
    Reading { name: "barrier-norm", norm: Norm::Barrier, ..BASE },
    Reading { name: "max-norm", norm: Norm::Largest, ..BASE },
    Reading { name: "leaf-1", leaf: 1, matched_dummies: true, ..BASE },
    Reading { name: "no-dummies", leaf: 1, split: Split::Balanced, norm: Norm::Unknowns, ..BASE },
    Reading { name: "sweeps", inverse: Kind::Iterated(SWEEPS[1]), ..BASE },
    Reading { name: "loose", tolerance: 1e-1, ..BASE },
    Reading { name: "world-axes", form: Form::WorldAxes, ..BASE },
    Reading { name: "compliance", form: Form::Compliant, ..BASE },
    Reading { name: "scaled", form: Form::Scaled, norm: Norm::Unknowns, ..BASE },
    Reading {
        name: "scaled-shifted",
        form: Form::Scaled,
        norm: Norm::Unknowns,
        inverse: Kind::Shifted,
        ..BASE
    },
    Reading {
        name: "scaled-factor",
        form: Form::Scaled,
        norm: Norm::Unknowns,
        inverse: Kind::Factor,
        ..BASE
    },
];

impl Reading {
    /// The reading of this name.
    pub fn find(name: &str) -> Option<&'static Self> {
        std::iter::once(&BASE).chain(&READINGS).find(|reading| reading.name == name)
    }

    /// The system in the form of this reading, where that is another one.
    ///
    /// # Errors
    /// As [`System::new`].
    pub fn system(&self, bed: &mut Bed, system: &System) -> Result<Option<System>, ReproduceError> {
        match self.form {
            Form::Plain | Form::Scaled => Ok(None),
            Form::Compliant => system.shifted(bed.mean_compliance()).map(Some),
            Form::WorldAxes => system.in_world_axes(bed.frames()).map(Some),
        }
    }

    /// What is compressed of a system.
    pub fn matrix<'a>(&self, system: &'a System) -> &'a BlockMatrix3 {
        if self.form == Form::Scaled { &system.scaled } else { &system.matrix }
    }

    /// Diagonal entry of the dummies.
    pub fn dummy(&self, system: &System) -> f64 {
        if self.matched_dummies { mean_diagonal(self.matrix(system)) } else { 1.0 }
    }

    /// The truncation for an accuracy, in the sense of [`QuadtreeMatrix::to_train`]: relative to the norm
    /// without dummies. (An error as large as the matrix allows the zero matrix; rank one is the least there
    /// is.)
    ///
    /// # Errors
    /// [`TtError`] where a train cannot be made.
    pub fn truncation(
        &self,
        quadtree: &QuadtreeMatrix,
        system: &System,
        accuracy: f64,
        cap: usize,
    ) -> Result<Truncation, TtError> {
        let norm = quadtree.norm();
        let tolerance = match self.norm {
            Norm::Unknowns => accuracy,
            Norm::Augmented => accuracy * quadtree.augmented_norm() / norm,
            Norm::Absolute => accuracy / norm,
            Norm::Barrier => accuracy * system.largest_barrier / norm,
            Norm::Largest => return loosest(quadtree, accuracy, cap),
        };
        Ok(Truncation::capped(tolerance.min(WHOLE), cap))
    }
}

/// The largest relative error that a truncation takes.
const WHOLE: f64 = 0.999;

/// Factor between the tolerances that are tried for an accuracy of every entry, and how many.
const REFINE: (f64, usize) = (0.25, 8);

/// The loosest truncation of a sequence with which every nonzero entry is met to `accuracy` times the largest
/// one. Entries that are zero are not looked at: a lower bound on the ranks.
fn loosest(quadtree: &QuadtreeMatrix, accuracy: f64, cap: usize) -> Result<Truncation, TtError> {
    let (places, values): (Vec<_>, Vec<_>) = quadtree.entries().map(|(i, j, x)| ((i, j), x)).unzip();
    let largest = values.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let mut truncation = Truncation::capped(WHOLE, cap);
    for _ in 0..REFINE.1 {
        let (train, report): (TtMatrix, _) = quadtree.to_train(&truncation)?;
        let met = train.entries(&places)?;
        let worst = met.iter().zip(&values).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
        if worst <= accuracy * largest || report.capped {
            break;
        }
        truncation.tolerance *= REFINE.0;
    }
    Ok(truncation)
}
