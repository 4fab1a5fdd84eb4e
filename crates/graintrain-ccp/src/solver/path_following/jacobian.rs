//! The Jacobian of the smoothed problem, J = N' A + B, and the solution of systems with it, over bodies or
//! over contacts.

use super::smoothing::{ContactBlocks, SmoothedProblem};
use crate::delassus::{Delassus, FIXED, RigidDelassus};
use crate::newton::body_matrix::{Side, add_product, gather, scaled_sides, times_block};
use crate::newton::direct::in_body_space;
use crate::problem::Ccp;
use graintrain_linalg::block_ops::{apply3, multiply3};
use graintrain_linalg::block3::{Block, BlockMatrix3};
use graintrain_linalg::lu::{LuError, SparseLu};
use graintrain_linalg::ordering::Ordering;

/// Steps of iterative refinement at most.
const REFINEMENTS: usize = 3;
/// Relative residual of a linear system that is good enough.
const ACCURATE: f64 = 1e-12;

/// A B^-1 and J in one of two forms:
///
/// ```text
/// K = I + D~ A B^-1 D~^T  over bodies,   N' = D~^T D~:   dw = B^-1 (b - D~^T K^-1 D~ A B^-1 b)
/// J = N' A + B            over contacts:                 dw = J^-1 b
/// ```
///
/// det J = det B det K with det B > 0: both have the same sign.
pub(super) struct Jacobian {
    space: Space,
    lu: SparseLu,
    values: Vec<f64>,
    blocks: Vec<ContactBlocks>,
    /// One number per row of K; empty over contacts.
    body_right: Vec<f64>,
    right: Vec<f64>,
    residual: Vec<f64>,
    image: Vec<f64>,
}

enum Space {
    Bodies(Bodies),
    Contacts(Contacts),
}

/// D~ with the pattern of K.
struct Bodies {
    pair: Vec<[u32; 2]>,
    sides: Vec<[Side; 2]>,
    /// Where the four products of the sides of a contact go; `u32::MAX` where a side is fixed.
    place: Vec<[u32; 4]>,
    /// Where the diagonal blocks are.
    diagonal: Vec<u32>,
    /// Number of blocks of K.
    num_blocks: usize,
}

/// N' with its diagonal.
struct Contacts {
    matrix: BlockMatrix3,
}

impl Jacobian {
    /// Pattern and symbolic factorisation of a problem.
    pub fn new(problem: &Ccp, smoothed: &SmoothedProblem<'_>) -> Self {
        let unit = &smoothed.normal_unit;
        let (space, lu) = match &*problem.delassus {
            Delassus::Rigid(rigid) if in_body_space(rigid) => {
                let (bodies, lu) = Bodies::new(rigid, unit);
                (Space::Bodies(bodies), lu)
            }
            Delassus::Rigid(rigid) => over_contacts(&rigid.assemble(), unit),
            Delassus::Sparse(matrix) => over_contacts(matrix, unit),
        };
        let zeros = vec![0.0; 3 * problem.num_contacts()];
        let body_right =
            if matches!(space, Space::Bodies(_)) { vec![0.0; lu.dimension()] } else { Vec::new() };
        Self {
            space,
            lu,
            values: Vec::new(),
            blocks: Vec::new(),
            body_right,
            right: zeros.clone(),
            residual: zeros.clone(),
            image: zeros,
        }
    }

    /// Floating point operations of one factorisation.
    pub fn flops(&self) -> f64 {
        self.lu.cost().flops
    }

    /// Factorises J from the blocks that `fill` makes. The sign of its determinant.
    ///
    /// # Errors
    /// [`LuError`] where a pivot vanishes.
    pub fn refresh(&mut self, fill: impl FnOnce(&mut Vec<ContactBlocks>)) -> Result<f64, LuError> {
        fill(&mut self.blocks);
        self.values.clear();
        match &self.space {
            Space::Bodies(bodies) => bodies.assemble(&self.blocks, &mut self.values),
            Space::Contacts(contacts) => contacts.assemble(&self.blocks, &mut self.values),
        }
        self.lu.factorize(&self.values)?;
        Ok(self.lu.determinant_sign())
    }

    /// dw with J dw = b, refined with the products of the problem. The relative residual reached.
    pub fn solve(&mut self, smoothed: &mut SmoothedProblem<'_>, b: &[f64], dw: &mut [f64]) -> f64 {
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let size = norm(b);
        dw.fill(0.0);
        if size == 0.0 {
            return 0.0;
        }
        self.residual.copy_from_slice(b);
        let mut reached = 1.0;
        let mut correction = vec![0.0; b.len()];
        for _ in 0..=REFINEMENTS {
            self.apply_inverse(&mut correction);
            for (dw, correction) in dw.iter_mut().zip(&correction) {
                *dw += correction;
            }
            self.update_residual(smoothed, b, dw);
            let now = norm(&self.residual) / size;
            if now.is_nan() || now >= 0.5 * reached {
                // A step that does not help is taken back.
                if now.is_nan() || (now >= reached && reached < 1.0) {
                    for (dw, correction) in dw.iter_mut().zip(&correction) {
                        *dw -= correction;
                    }
                }
                return now.min(reached);
            }
            reached = now;
            if reached <= ACCURATE {
                break;
            }
        }
        reached
    }

    /// residual <- b - N' A dw - B dw.
    fn update_residual(&mut self, smoothed: &mut SmoothedProblem<'_>, b: &[f64], dw: &[f64]) {
        for (i, blocks) in self.blocks.iter().enumerate() {
            let k = 3 * i;
            let own = [dw[k], dw[k + 1], dw[k + 2]];
            self.right[k..k + 3].copy_from_slice(&apply3(&blocks.derivative, own));
            let own = apply3(&blocks.defect, own);
            for c in 0..3 {
                self.residual[k + c] = b[k + c] - own[c];
            }
        }
        smoothed.multiply(&self.right, &mut self.image);
        for (residual, image) in self.residual.iter_mut().zip(&self.image) {
            *residual -= image;
        }
    }

    /// dw <- J^-1 residual, as far as the factors are right.
    fn apply_inverse(&mut self, dw: &mut [f64]) {
        match &self.space {
            Space::Bodies(bodies) => {
                dw.copy_from_slice(&self.residual);
                for (i, blocks) in self.blocks.iter().enumerate() {
                    let k = 3 * i;
                    let product = apply3(&blocks.weight, [dw[k], dw[k + 1], dw[k + 2]]);
                    dw[k..k + 3].copy_from_slice(&product);
                }
                gather(&bodies.pair, &bodies.sides, dw, &mut self.body_right);
                self.lu.solve(&mut self.body_right);
                dw.copy_from_slice(&self.residual);
                bodies.scatter(&self.body_right, dw);
                for (i, blocks) in self.blocks.iter().enumerate() {
                    let k = 3 * i;
                    let product = apply3(&blocks.defect_inverse, [dw[k], dw[k + 1], dw[k + 2]]);
                    dw[k..k + 3].copy_from_slice(&product);
                }
            }
            Space::Contacts(_) => {
                dw.copy_from_slice(&self.residual);
                self.lu.solve(dw);
            }
        }
    }
}

impl Bodies {
    fn new(rigid: &RigidDelassus, normal_unit: &[f64]) -> (Self, SparseLu) {
        let pair: Vec<[u32; 2]> = rigid.contacts().iter().map(|c| [c.body_a, c.body_b]).collect();
        let mut sides = scaled_sides(rigid);
        for (sides, unit) in sides.iter_mut().zip(normal_unit) {
            for side in sides {
                side.iter_mut().step_by(3).for_each(|x| *x *= unit);
            }
        }
        let bodies = rigid.num_bodies();
        let mut list: Vec<(u32, u32)> = (0..bodies as u32).map(|body| (body, body)).collect();
        for &[a, b] in &pair {
            if a != FIXED && b != FIXED {
                list.extend([(a, b), (b, a)]);
            }
        }
        list.sort_unstable();
        list.dedup();
        let mut row_start = vec![0; bodies + 1];
        for &(row, _) in &list {
            row_start[row as usize + 1] += 1;
        }
        for body in 0..bodies {
            row_start[body + 1] += row_start[body];
        }
        let column: Vec<u32> = list.iter().map(|&(_, column)| column).collect();
        let find = |row: u32, column: u32| match list.binary_search(&(row, column)) {
            Ok(place) if row != FIXED && column != FIXED => place as u32,
            _ => u32::MAX,
        };
        let place = pair.iter().map(|&[a, b]| [find(a, a), find(a, b), find(b, a), find(b, b)]).collect();
        let lu = SparseLu::new(6, &row_start, &column, Ordering::NestedDissection);
        let diagonal = (0..bodies as u32).map(|body| find(body, body)).collect();
        (Self { pair, sides, place, diagonal, num_blocks: list.len() }, lu)
    }

    /// Blocks of K, row-major, one after the other.
    fn assemble(&self, blocks: &[ContactBlocks], values: &mut Vec<f64>) {
        values.resize(36 * self.num_blocks, 0.0);
        for &place in &self.diagonal {
            for d in 0..6 {
                values[36 * place as usize + 7 * d] = 1.0;
            }
        }
        for ((sides, place), blocks) in self.sides.iter().zip(&self.place).zip(blocks) {
            for (p, row) in sides.iter().enumerate() {
                let weighted = times_block(row, &blocks.weight);
                for (q, column) in sides.iter().enumerate() {
                    let place = place[2 * p + q];
                    if place != FIXED {
                        let block = &mut values[36 * place as usize..36 * (place as usize + 1)];
                        add_product(block, &weighted, column);
                    }
                }
            }
        }
    }

    /// z <- z - D~^T y.
    fn scatter(&self, y: &[f64], z: &mut [f64]) {
        for (i, (pair, sides)) in self.pair.iter().zip(&self.sides).enumerate() {
            for (&body, side) in pair.iter().zip(sides) {
                if body != FIXED {
                    let y = &y[6 * body as usize..6 * body as usize + 6];
                    for (y, row) in y.iter().zip(side.chunks_exact(3)) {
                        for c in 0..3 {
                            z[3 * i + c] -= row[c] * y;
                        }
                    }
                }
            }
        }
    }
}

/// N' with all its diagonal blocks, and the symbolic factorisation of its pattern.
fn over_contacts(matrix: &BlockMatrix3, normal_unit: &[f64]) -> (Space, SparseLu) {
    let (mut row_start, mut columns, mut blocks) = (vec![0], Vec::new(), Vec::new());
    for i in 0..matrix.num_rows() {
        let (own, given) = matrix.row(i);
        let missing = own.binary_search(&(i as u32)).is_err();
        let before = own.partition_point(|&j| (j as usize) < i);
        let mut add = |j: u32, block: &Block| {
            let (row, column) = ([normal_unit[i], 1.0, 1.0], [normal_unit[j as usize], 1.0, 1.0]);
            columns.push(j);
            blocks.push(std::array::from_fn(|e| row[e / 3] * block[e] * column[e % 3]));
        };
        (0..before).for_each(|k| add(own[k], &given[k]));
        if missing {
            add(i as u32, &[0.0; 9]);
        }
        (before..own.len()).for_each(|k| add(own[k], &given[k]));
        row_start.push(columns.len());
    }
    let matrix = BlockMatrix3::from_rows(row_start, columns, blocks);
    let lu = SparseLu::new(3, matrix.row_starts(), matrix.columns(), Ordering::NestedDissection);
    (Space::Contacts(Contacts { matrix }), lu)
}

impl Contacts {
    /// Blocks of J, row-major, one after the other.
    fn assemble(&self, blocks: &[ContactBlocks], values: &mut Vec<f64>) {
        for (i, own) in blocks.iter().enumerate() {
            let (columns, given) = self.matrix.row(i);
            for (&j, block) in columns.iter().zip(given) {
                let mut product = multiply3(block, &blocks[j as usize].derivative);
                if j as usize == i {
                    product.iter_mut().zip(&own.defect).for_each(|(product, own)| *product += own);
                }
                values.extend_from_slice(&product);
            }
        }
    }
}
