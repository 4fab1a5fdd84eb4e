//! The Newton matrix in body space: K = I + A A^T, six rows per body.
//!
//! With M^-1 = L L^T (per body), D~ = L^T D, H^-1 = F F^T and A = D~ F, the scaled Newton matrix is S~ = I +
//! A^T A, and by the identity of Woodbury
//!
//! ```text
//! S~^-1 b = b - A^T y,     K y = A b.
//! ```
//!
//! K is the contact graph itself: an off-diagonal block for every pair of bodies in contact, symmetric
//! positive definite whatever N is. A degree of freedom that is prescribed (zero row of M^-1) becomes a row
//! of the identity.

use crate::delassus::{BodyInverseMass, FIXED, RigidDelassus};
use graintrain_linalg::block3::Block;
use graintrain_linalg::vectorised::{Work, run_wide};
use rayon::prelude::*;

/// A 6x6 block, row-major.
pub type BodyBlock = [f64; 36];

/// One side of a contact in D~ or A: 6x3, row-major; zero where the side is fixed.
pub(crate) type Side = [f64; 18];

const NONE: u32 = u32::MAX;

/// K over the bodies of a problem, lower triangle in compressed row form. The pattern is made once per
/// problem, the values by [`BodyMatrix::assemble`].
#[derive(Clone, Debug)]
pub struct BodyMatrix {
    bodies: Vec<[u32; 2]>,
    /// D~.
    sides: Vec<[Side; 2]>,
    /// A of the last blocks.
    scaled: Vec<[Side; 2]>,
    row_start: Vec<usize>,
    column: Vec<u32>,
    blocks: Vec<BodyBlock>,
    /// For every block the contacts that add to it: contact index, and which of its four products.
    terms: Vec<Term>,
    term_start: Vec<u32>,
}

/// One product A_p A_q^T of the sides of a contact i.
#[derive(Clone, Copy, Debug)]
struct Term {
    contact: u32,
    row_side: u8,
    column_side: u8,
}

/// Lower factor L of a symmetric positive semi-definite 3x3 matrix, L L^T = A; zero columns where A has none.
fn semidefinite_factor(a: &Block) -> Block {
    let mut l = [0.0; 9];
    let largest = a[0].max(a[4]).max(a[8]);
    for j in 0..3 {
        let pivot = a[4 * j] - (0..j).map(|k| l[3 * j + k] * l[3 * j + k]).sum::<f64>();
        if pivot <= 1e-14 * largest {
            continue;
        }
        l[4 * j] = pivot.sqrt();
        for i in j + 1..3 {
            let sum: f64 = (0..j).map(|k| l[3 * i + k] * l[3 * j + k]).sum();
            l[3 * i + j] = (a[3 * i + j] - sum) / l[4 * j];
        }
    }
    l
}

/// One body's part of D~: rows (u, w) of L^T D for frame rows n, t1, t2.
fn scaled_side(
    sign: f64,
    frame: &[[f64; 3]; 3],
    arm: [f64; 3],
    inverse: &BodyInverseMass,
    spin: &Block,
) -> Side {
    let mut side = [0.0; 18];
    for (c, axis) in frame.iter().enumerate() {
        let moment = [
            arm[1] * axis[2] - arm[2] * axis[1],
            arm[2] * axis[0] - arm[0] * axis[2],
            arm[0] * axis[1] - arm[1] * axis[0],
        ];
        for k in 0..3 {
            side[3 * k + c] = sign * inverse.linear[k].sqrt() * axis[k];
            side[3 * (3 + k) + c] = sign * (0..3).map(|l| spin[3 * l + k] * moment[l]).sum::<f64>();
        }
    }
    side
}

/// D~, both sides of every contact.
pub(crate) fn scaled_sides(rigid: &RigidDelassus) -> Vec<[Side; 2]> {
    let spins: Vec<Block> = rigid.inverse_mass().iter().map(|m| semidefinite_factor(&m.angular)).collect();
    rigid
        .contacts()
        .iter()
        .map(|contact| {
            let side = |body: u32, sign: f64, arm: [f64; 3]| {
                if body == FIXED {
                    return [0.0; 18];
                }
                let body = body as usize;
                scaled_side(sign, &contact.frame, arm, &rigid.inverse_mass()[body], &spins[body])
            };
            [side(contact.body_a, 1.0, contact.arm_a), side(contact.body_b, -1.0, contact.arm_b)]
        })
        .collect()
}

impl BodyMatrix {
    /// Pattern and D~ of a problem.
    pub fn new(rigid: &RigidDelassus) -> Self {
        let sides = scaled_sides(rigid);
        let bodies: Vec<[u32; 2]> = rigid.contacts().iter().map(|c| [c.body_a, c.body_b]).collect();
        let (row_start, column, terms, term_start) = pattern(rigid.num_bodies(), &bodies);
        let blocks = vec![[0.0; 36]; column.len()];
        let scaled = sides.clone();
        Self { bodies, sides, scaled, row_start, column, blocks, terms, term_start }
    }

    /// Whether another problem has the same bodies in contact, in the same order.
    pub fn fits(&self, rigid: &RigidDelassus) -> bool {
        self.row_start.len() == rigid.num_bodies() + 1
            && self.bodies.len() == rigid.num_contacts()
            && self.bodies.iter().zip(rigid.contacts()).all(|(pair, c)| *pair == [c.body_a, c.body_b])
    }

    /// Number of bodies.
    pub fn num_bodies(&self) -> usize {
        self.row_start.len() - 1
    }

    /// Start of each block row.
    pub fn row_starts(&self) -> &[usize] {
        &self.row_start
    }

    /// Block columns, row by row; none is above the diagonal.
    pub fn columns(&self) -> &[u32] {
        &self.column
    }

    /// Blocks, row by row.
    pub fn blocks(&self) -> &[BodyBlock] {
        &self.blocks
    }

    /// The diagonal block of a body.
    pub fn diagonal(&self, body: usize) -> &BodyBlock {
        // Columns ascend and none is above the diagonal: the diagonal is the last block of its row.
        &self.blocks[self.row_start[body + 1] - 1]
    }

    /// K <- I + A A^T with A = D~ F, one 3x3 factor F_i per contact. Cost about 900 flops per contact.
    pub fn assemble(&mut self, factor: &[Block]) {
        self.scaled.par_iter_mut().zip(&self.sides).zip(factor).with_min_len(512).for_each(
            |((scaled, sides), factor)| {
                for (scaled, side) in scaled.iter_mut().zip(sides) {
                    *scaled = times_block(side, factor);
                }
            },
        );
        let (scaled, terms, term_start) = (&self.scaled, &self.terms, &self.term_start);
        self.blocks.par_iter_mut().enumerate().with_min_len(512).for_each(|(k, block)| {
            *block = [0.0; 36];
            for term in &terms[term_start[k] as usize..term_start[k + 1] as usize] {
                let sides = &scaled[term.contact as usize];
                add_product(block, &sides[term.row_side as usize], &sides[term.column_side as usize]);
            }
        });
        // The diagonal is the last block of its row.
        for end in &self.row_start[1..] {
            for d in 0..6 {
                self.blocks[end - 1][7 * d] += 1.0;
            }
        }
    }

    /// y <- A z: length 6 bodies from length 3 contacts.
    pub fn gather(&self, z: &[f64], y: &mut [f64]) {
        gather(&self.bodies, &self.scaled, z, y);
    }

    /// z <- z + sign A^T y.
    pub fn scatter(&self, sign: f64, y: &[f64], z: &mut [f64]) {
        for (i, (bodies, sides)) in self.bodies.iter().zip(&self.scaled).enumerate() {
            let mut sum = [0.0; 3];
            for (&body, side) in bodies.iter().zip(sides) {
                if body != FIXED {
                    let y = &y[6 * body as usize..6 * body as usize + 6];
                    for (y, row) in y.iter().zip(side.chunks_exact(3)) {
                        for c in 0..3 {
                            sum[c] += row[c] * y;
                        }
                    }
                }
            }
            for c in 0..3 {
                z[3 * i + c] += sign * sum[c];
            }
        }
    }

    /// z <- K y.
    pub fn multiply(&self, y: &[f64], z: &mut [f64]) {
        run_wide(Product { matrix: self, y, z });
    }
}

/// z <- K y, compiled for the widest vectors there are.
struct Product<'a> {
    matrix: &'a BodyMatrix,
    y: &'a [f64],
    z: &'a mut [f64],
}

impl Work for Product<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { matrix, y, z } = self;
        z.fill(0.0);
        let of_body = |y: &[f64], body: usize| -> [f64; 6] { std::array::from_fn(|c| y[6 * body + c]) };
        for i in 0..matrix.num_bodies() {
            let own = of_body(y, i);
            // Products by entry: rows are summed once at the end, so that the loop has vectors only.
            let mut products = [[0.0; 6]; 6];
            for k in matrix.row_start[i]..matrix.row_start[i + 1] {
                let (j, block) = (matrix.column[k] as usize, &matrix.blocks[k]);
                let other = of_body(y, j);
                for r in 0..6 {
                    for c in 0..6 {
                        products[r][c] += block[6 * r + c] * other[c];
                    }
                }
                if j != i {
                    let mut transposed = [0.0; 6];
                    for r in 0..6 {
                        for c in 0..6 {
                            transposed[c] += block[6 * r + c] * own[r];
                        }
                    }
                    for c in 0..6 {
                        z[6 * j + c] += transposed[c];
                    }
                }
            }
            for r in 0..6 {
                z[6 * i + r] += products[r].iter().sum::<f64>();
            }
        }
    }
}

/// y <- A z, given the sides of contacts and their bodies.
pub(crate) fn gather(bodies: &[[u32; 2]], sides: &[[Side; 2]], z: &[f64], y: &mut [f64]) {
    y.fill(0.0);
    for (i, (bodies, sides)) in bodies.iter().zip(sides).enumerate() {
        let z = [z[3 * i], z[3 * i + 1], z[3 * i + 2]];
        for (&body, side) in bodies.iter().zip(sides) {
            if body != FIXED {
                let y = &mut y[6 * body as usize..6 * body as usize + 6];
                for (y, row) in y.iter_mut().zip(side.chunks_exact(3)) {
                    *y += row[0] * z[0] + row[1] * z[1] + row[2] * z[2];
                }
            }
        }
    }
}

/// A B with A of 6x3 and B of 3x3.
#[inline]
pub(crate) fn times_block(a: &Side, b: &Block) -> Side {
    let mut product = [0.0; 18];
    for (product, row) in product.chunks_exact_mut(3).zip(a.chunks_exact(3)) {
        for c in 0..3 {
            product[c] = row[0] * b[c] + row[1] * b[3 + c] + row[2] * b[6 + c];
        }
    }
    product
}

/// block += A B^T with A, B of 6x3.
#[inline]
pub(crate) fn add_product(block: &mut [f64], a: &Side, b: &Side) {
    for r in 0..6 {
        for c in 0..6 {
            block[6 * r + c] +=
                a[3 * r] * b[3 * c] + a[3 * r + 1] * b[3 * c + 1] + a[3 * r + 2] * b[3 * c + 2];
        }
    }
}

/// Lower pattern of K and the products that make up each of its blocks, contact ascending.
fn pattern(num_bodies: usize, bodies: &[[u32; 2]]) -> (Vec<usize>, Vec<u32>, Vec<Term>, Vec<u32>) {
    // (row, column, term); the empty term makes every diagonal block exist.
    let mut list: Vec<(u32, u32, Term)> = Vec::with_capacity(3 * bodies.len() + num_bodies);
    for body in 0..num_bodies as u32 {
        list.push((body, body, Term { contact: NONE, row_side: 0, column_side: 0 }));
    }
    for (i, &[a, b]) in bodies.iter().enumerate() {
        let contact = i as u32;
        for (side, body) in [(0, a), (1, b)] {
            if body != FIXED {
                list.push((body, body, Term { contact, row_side: side, column_side: side }));
            }
        }
        if a != FIXED && b != FIXED {
            let (row_side, column_side) = if a > b { (0, 1) } else { (1, 0) };
            list.push((a.max(b), a.min(b), Term { contact, row_side, column_side }));
            if a == b {
                // Both sides on one body: the mirrored product falls on the same block.
                list.push((a, a, Term { contact, row_side: column_side, column_side: row_side }));
            }
        }
    }
    list.sort_by_key(|&(row, column, _)| (row, column));
    let mut row_start = vec![0; num_bodies + 1];
    let (mut column, mut terms, mut term_start) = (Vec::new(), Vec::new(), Vec::new());
    let mut last = (NONE, NONE);
    for (r, c, term) in list {
        if (r, c) != last {
            last = (r, c);
            row_start[r as usize + 1] += 1;
            column.push(c);
            term_start.push(terms.len() as u32);
        }
        if term.contact != NONE {
            terms.push(term);
        }
    }
    term_start.push(terms.len() as u32);
    for body in 0..num_bodies {
        row_start[body + 1] += row_start[body];
    }
    (row_start, column, terms, term_start)
}
