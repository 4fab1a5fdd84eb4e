//! One Newton matrix in Morton order: its trains, their errors in three norms, and what classic
//! preconditioners need.

use super::record::Recorded;
use super::table::Count;
use crate::reproduce::ReproduceError;
use graintrain_ccp::newton::{Form, ScaledBlocks, SchurComplement};
use graintrain_ccp::paper::tensor_train::padded::PaddedOperator;
use graintrain_ccp::paper::tensor_train::place::contact_points;
use graintrain_ccp::paper::tensor_train::tree::{PointTree, Split};
use graintrain_ccp::{Ccp, Delassus};
use graintrain_linalg::block_ops::{apply3, multiply3};
use graintrain_linalg::block3::{Block, BlockMatrix3};
use graintrain_linalg::krylov::{KrylovOutcome, KrylovSettings, KrylovWork, bicgstab};
use graintrain_linalg::patience::Patience;
use graintrain_linalg::precond::{BlockJacobi, IncompleteCholesky, IncompleteLu, Preconditioner};
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{TtError, TtMatrix};

/// Contacts per leaf of the paper's tree, whose number it does not give: that of `tt-cross`.
pub const LEAF: usize = 4;

/// Iterations after which a linear solve has failed: the paper's cap.
const CAP: usize = 1000;

/// Steps of refinement after which a direct solver has failed.
const REFINEMENTS: usize = 200;

/// The contacts of one problem in Morton order, and N.
pub struct Bed {
    schur: SchurComplement,
    /// Contact at each place of the order.
    order: Vec<usize>,
    /// Points in that order, m.
    points: Vec<[f64; 3]>,
    /// Rows n, t1, t2 of each contact's frame in world axes, row-major, in that order; empty where there are
    /// no bodies.
    frames: Vec<Block>,
}

/// Slots of contacts in a uniform tree.
pub struct Slots {
    /// Slot of each contact of the order.
    pub place: Vec<usize>,
    /// Slots per leaf.
    pub capacity: usize,
    /// Halvings.
    pub depth: usize,
}

impl Slots {
    /// A tree over these points with at most `leaf` contacts per leaf.
    fn new(points: &[[f64; 3]], leaf: usize, split: Split) -> Self {
        let tree = PointTree::build(points, leaf, split);
        Self { place: tree.positions().to_vec(), capacity: tree.capacity(), depth: tree.depth() }
    }

    /// Unknowns with the dummies.
    pub fn unknowns(&self) -> usize {
        3 * (self.capacity << self.depth)
    }
}

impl Bed {
    /// Of a problem with contacts.
    pub fn new(problem: &Ccp) -> Self {
        let points = contact_points(problem);
        let place = Slots::new(&points, LEAF, Split::Uniform).place;
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_unstable_by_key(|&contact| place[contact]);
        let frames = match &*problem.delassus {
            Delassus::Rigid(rigid) => order
                .iter()
                .map(|&contact| {
                    let [n, t1, t2] = rigid.contacts()[contact].frame;
                    [n[0], n[1], n[2], t1[0], t1[1], t1[2], t2[0], t2[1], t2[2]]
                })
                .collect(),
            Delassus::Sparse(_) => Vec::new(),
        };
        Self {
            schur: SchurComplement::new(problem, Form::Plain),
            points: order.iter().map(|&contact| points[contact]).collect(),
            order,
            frames,
        }
    }

    /// The tree with at most `leaf` contacts per leaf.
    pub fn slots(&self, leaf: usize, split: Split) -> Slots {
        Slots::new(&self.points, leaf, split)
    }

    /// Frames of the contacts; see the field.
    pub fn frames(&self) -> &[Block] {
        &self.frames
    }

    /// S and b of one iteration.
    ///
    /// # Errors
    /// [`ReproduceError::Linear`] for a diagonal block that is not positive definite.
    pub fn system(&mut self, recorded: &Recorded) -> Result<System, ReproduceError> {
        self.schur.update(ScaledBlocks { added: &recorded.added, ..ScaledBlocks::default() });
        let matrix = permuted(self.schur.matrix(), &self.order);
        let rhs = self.order.iter().flat_map(|&contact| recorded.rhs[3 * contact..3 * contact + 3].to_vec());
        let largest = recorded.added.iter().map(frobenius).fold(0.0, f64::max);
        System::new(matrix, rhs.collect(), largest)
    }

    /// Mean diagonal entry of N, 1/kg: the size of a contact's own compliance.
    pub fn mean_compliance(&mut self) -> f64 {
        let none = vec![[0.0; 9]; self.order.len()];
        self.schur.update(ScaledBlocks { added: &none, ..ScaledBlocks::default() });
        mean_diagonal(self.schur.matrix())
    }
}

/// Frobenius norm of a block.
fn frobenius(block: &Block) -> f64 {
    block.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Mean of the diagonal entries.
pub fn mean_diagonal(matrix: &BlockMatrix3) -> f64 {
    let rows = matrix.num_rows();
    let trace: f64 = (0..rows).map(|i| matrix.get(i, i)).map(|d| d[0] + d[4] + d[8]).sum();
    trace / (3 * rows).max(1) as f64
}

/// Block row and column k of the result are those of `order[k]`.
fn permuted(matrix: &BlockMatrix3, order: &[usize]) -> BlockMatrix3 {
    let mut rank = vec![0_u32; order.len()];
    for (k, &i) in order.iter().enumerate() {
        rank[i] = k as u32;
    }
    let (mut start, mut column, mut blocks) = (vec![0], Vec::new(), Vec::new());
    for &i in order {
        let (columns, row) = matrix.row(i);
        let mut entries: Vec<(u32, Block)> =
            columns.iter().map(|&j| rank[j as usize]).zip(row.iter().copied()).collect();
        entries.sort_unstable_by_key(|&(j, _)| j);
        for (j, block) in entries {
            column.push(j);
            blocks.push(block);
        }
        start.push(column.len());
    }
    BlockMatrix3::from_rows(start, column, blocks)
}

/// S x = b in Morton order.
pub struct System {
    /// S, 1/kg.
    pub matrix: BlockMatrix3,
    /// L^-1 S L^-T with the Cholesky factors L of the diagonal blocks.
    pub scaled: BlockMatrix3,
    /// b, m/s.
    pub rhs: Vec<f64>,
    /// Those factors.
    pub jacobi: BlockJacobi,
    /// Largest Frobenius norm of a barrier block H_i, 1/kg.
    pub largest_barrier: f64,
}

impl System {
    /// From S and b.
    ///
    /// # Errors
    /// [`ReproduceError::Linear`] for a diagonal block that is not positive definite.
    pub fn new(matrix: BlockMatrix3, rhs: Vec<f64>, largest_barrier: f64) -> Result<Self, ReproduceError> {
        let mut jacobi = BlockJacobi::new(3);
        jacobi.refresh(&matrix).map_err(|error| ReproduceError::Linear(error.to_string()))?;
        let mut scaled = matrix.clone();
        jacobi.scale_matrix(&matrix, &mut scaled);
        Ok(Self { matrix, scaled, rhs, jacobi, largest_barrier })
    }

    /// S + shift I.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn shifted(&self, shift: f64) -> Result<Self, ReproduceError> {
        let mut matrix = self.matrix.clone();
        for i in 0..matrix.num_rows() {
            if let Some(k) = matrix.position(i, i) {
                matrix.blocks_mut()[k].iter_mut().step_by(4).for_each(|x| *x += shift);
            }
        }
        Self::new(matrix, self.rhs.clone(), self.largest_barrier)
    }

    /// The system for impulses in world axes: F_i^T S_ij F_j, F_i^T b_i with the frames F.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn in_world_axes(&self, frames: &[Block]) -> Result<Self, ReproduceError> {
        let transposed: Vec<Block> =
            frames.iter().map(|f| std::array::from_fn(|e| f[3 * (e % 3) + e / 3])).collect();
        let mut matrix = self.matrix.clone();
        for i in 0..matrix.num_rows() {
            for k in matrix.row_starts()[i]..matrix.row_starts()[i + 1] {
                let j = matrix.columns()[k] as usize;
                let block = multiply3(&matrix.blocks()[k], &frames[j]);
                matrix.blocks_mut()[k] = multiply3(&transposed[i], &block);
            }
        }
        let rhs = self.rhs.chunks_exact(3).zip(&transposed).flat_map(|(b, f)| apply3(f, [b[0], b[1], b[2]]));
        Self::new(matrix, rhs.collect(), self.largest_barrier)
    }

    /// Unknowns, 3 per contact.
    pub fn unknowns(&self) -> usize {
        self.rhs.len()
    }

    /// BiCGSTAB's iterations to a relative residual with a preconditioner z = P r, at most 1000; `None` where
    /// the patience ended.
    pub fn bicgstab(
        &self,
        mut preconditioner: impl FnMut(&[f64], &mut [f64]),
        tolerance: f64,
        patience: &Patience,
    ) -> Option<Count> {
        let mut x = vec![0.0; self.unknowns()];
        let settings = KrylovSettings { relative_tolerance: tolerance, max_iterations: CAP };
        let mut work = KrylovWork::default();
        work.patience = patience.clone();
        let report = bicgstab(
            &mut |x, y| self.matrix.multiply(x, y),
            &mut |r, z| preconditioner(r, z),
            &self.rhs,
            &mut x,
            settings,
            &mut work,
        );
        match report.outcome {
            KrylovOutcome::Converged => Some(Count::Reached(report.iterations)),
            KrylovOutcome::Stopped => None,
            KrylovOutcome::IterationLimit | KrylovOutcome::Breakdown => Some(Count::Unconverged),
        }
    }

    /// Steps of x <- x + P (b - S x) from zero to a relative residual, at most 200: P as a direct solver (one
    /// step) with refinement. `None` where the patience ended.
    pub fn refinement(
        &self,
        mut solver: impl FnMut(&[f64], &mut [f64]),
        tolerance: f64,
        patience: &Patience,
    ) -> Option<Count> {
        let n = self.unknowns();
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let target = tolerance * norm(&self.rhs);
        let (mut residual, mut step, mut image) = (self.rhs.clone(), vec![0.0; n], vec![0.0; n]);
        for count in 0..=REFINEMENTS {
            let size = norm(&residual);
            if size <= target {
                return Some(Count::Reached(count));
            }
            if patience.is_over() {
                return None;
            }
            if !size.is_finite() || size > 1e6 * norm(&self.rhs) {
                break;
            }
            solver(&residual, &mut step);
            self.matrix.multiply(&step, &mut image);
            residual.iter_mut().zip(&image).for_each(|(r, y)| *r -= y);
        }
        Some(Count::Unconverged)
    }

    /// BiCGSTAB's iterations with block Jacobi, block ILU(0) without correction of pivots, block IC(0).
    pub fn classic(&self, tolerance: f64, patience: &Patience) -> [(&'static str, Option<Count>); 3] {
        let with = |mut preconditioner: Box<dyn Preconditioner>| match preconditioner.refresh(&self.matrix) {
            Ok(()) => self.bicgstab(|r, z| preconditioner.apply(r, z), tolerance, patience),
            Err(_) => Some(Count::Unconverged),
        };
        [
            ("block-jacobi", with(Box::new(BlockJacobi::new(3)))),
            ("ilu", with(Box::<IncompleteLu>::default())),
            ("ic", with(Box::<IncompleteCholesky<3, 9>>::default())),
        ]
    }

    /// The augmented matrix of S or of its scaled form, `dummy` on the diagonal of free slots.
    ///
    /// # Errors
    /// [`TtError`] for leaves that are too large.
    pub fn quadtree(&self, scaled: bool, slots: &Slots, dummy: f64) -> Result<QuadtreeMatrix, TtError> {
        let matrix = if scaled { &self.scaled } else { &self.matrix };
        QuadtreeMatrix::from_blocks(matrix.iter(), &slots.place, slots.capacity, slots.depth, dummy)
    }

    /// ||L^-1 (S - T) L^-T||_F / ||L^-1 S L^-T||_F over the unknowns, T the train (of S, or of the scaled matrix, where L falls away). Estimated as
    /// the root mean of |B z|^2 over random signs z, whose mean is ||B||_F^2 (Hutchinson 1990): a few per
    /// cent off where no few singular values carry the error. `None` where the products would take more than
    /// 5e10 operations.
    ///
    /// # Errors
    /// [`TtError`] for a train too large to apply.
    pub fn scaled_error(
        &self,
        train: &TtMatrix,
        scaled: bool,
        slots: &Slots,
    ) -> Result<Option<f64>, TtError> {
        let mut operator = PaddedOperator::new(train)?;
        let probes = (OPERATIONS / operator.flops().max(1.0)).min(MOST_PROBES as f64) as usize;
        if probes < FEWEST_PROBES {
            return Ok(None);
        }
        let n = self.unknowns();
        let (mut image, mut product) = (vec![0.0; n], vec![0.0; n]);
        let mut sum = 0.0;
        for probe in 0..probes {
            let signs = signs(n, probe as u64);
            let mut z = signs.clone();
            if !scaled {
                self.jacobi.solve_upper(&mut z);
            }
            operator.apply(3, &slots.place, &z, &mut image);
            if !scaled {
                self.jacobi.solve_lower(&mut image);
            }
            self.scaled.multiply(&signs, &mut product);
            sum += product.iter().zip(&image).map(|(s, t)| (s - t) * (s - t)).sum::<f64>();
        }
        let norm = self.scaled.blocks().iter().map(|block| frobenius(block).powi(2)).sum::<f64>();
        Ok(Some((sum / probes as f64 / norm).sqrt()))
    }
}

/// Work that an estimate may take, and numbers of probes.
const OPERATIONS: f64 = 5e10;
const MOST_PROBES: usize = 16;
const FEWEST_PROBES: usize = 2;

/// Numbers of +-1 from a seed (SplitMix64).
fn signs(n: usize, seed: u64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03;
    let mut next = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    };
    (0..n).map(|_| if next() >> 63 == 0 { 1.0 } else { -1.0 }).collect()
}
