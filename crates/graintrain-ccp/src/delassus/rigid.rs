//! N over rigid bodies, applied without being formed.

use super::coupled::CoupledRows;
use super::{CellModes, CoupledBodies, FIXED, TurningRows};
use graintrain_linalg::block3::{Block, BlockMatrix3};
use rayon::prelude::*;
use std::sync::OnceLock;

/// Contacts or bodies per parallel task.
const TASK: usize = 2048;

/// One contact between rigid bodies A and B. Its block D_i of the contact Jacobian is defined by
/// `D_i^T v = F (u_A + w_A x r_A - u_B - w_B x r_B)`, rows of F being n, t1, t2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidContact {
    /// Index of body A, or [`FIXED`].
    pub body_a: u32,
    /// Index of body B, or [`FIXED`].
    pub body_b: u32,
    /// Orthonormal rows n, t1, t2 in world axes; n points from B to A.
    pub frame: [[f64; 3]; 3],
    /// r_A: contact point minus centre of mass of A, world axes, m.
    pub arm_a: [f64; 3],
    /// r_B: contact point minus centre of mass of B, world axes, m.
    pub arm_b: [f64; 3],
}

/// Inverse mass matrix of one body, in world axes. Degrees of freedom that are prescribed have zero rows and
/// columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyInverseMass {
    /// Diagonal of the inverse of m I_3, 1/kg; zero along prescribed axes.
    pub linear: [f64; 3],
    /// Inverse inertia (R I R^T)^-1, symmetric 3x3, row-major, 1/(kg m^2).
    pub angular: Block,
}

/// N over rigid bodies, applied without being formed.
///
/// A product N g costs about 110 flops and 250 bytes of traffic per contact: contacts turn impulses into
/// world forces, every body gathers the forces of its own contacts, every contact reads the velocities of its
/// two bodies. Bodies gather in a fixed order, so that the bits do not depend on the number of threads.
#[derive(Clone, Debug)]
pub struct RigidDelassus {
    pub(super) contacts: Vec<RigidContact>,
    pub(super) inverse_mass: Vec<BodyInverseMass>,
    /// Body b's contact sides are `sides[side_start[b]..side_start[b + 1]]`, contact ascending.
    pub(super) side_start: Vec<u32>,
    pub(super) sides: Vec<Side>,
    /// Block row N_c + k of N is that of entry k.
    pub(super) turning: Vec<TurningRows>,
    /// Body b's sides of turning rows are `turning_sides[turning_start[b]..turning_start[b + 1]]`: entry of
    /// `turning` and sign. Both are empty where nothing resists turning.
    pub(super) turning_start: Vec<u32>,
    pub(super) turning_sides: Vec<(u32, f64)>,
    /// Groups of bodies with a common inverse mass, and for every body its group and place there (`u32::MAX`:
    /// none); both are empty where there are no groups.
    pub(super) coupled: Vec<CoupledBodies>,
    pub(super) group_of: Vec<(u32, u32)>,
    /// Compliances of the normal rows, 1/kg; empty where all contacts are rigid.
    pub(super) compliance: Vec<f64>,
    /// A stress-controlled periodic cell.
    pub(super) cell: Option<CellModes>,
    /// Diagonals of the blocks N_ii, made when first asked for.
    pub(super) diagonal: OnceLock<Vec<[f64; 3]>>,
}

/// One side of a contact, seen from its body.
#[derive(Clone, Copy, Debug)]
pub struct Side {
    /// Index of the contact.
    pub contact: u32,
    /// +1 where the body is A, -1 where it is B: the sign of the impulse on this body.
    pub sign: f64,
    /// Arm of the contact point on this body, m.
    pub arm: [f64; 3],
}

#[inline]
pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline]
pub(super) fn dot3(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
pub(super) fn times3(m: &Block, x: [f64; 3]) -> [f64; 3] {
    [
        m[0] * x[0] + m[1] * x[1] + m[2] * x[2],
        m[3] * x[0] + m[4] * x[1] + m[5] * x[2],
        m[6] * x[0] + m[7] * x[1] + m[8] * x[2],
    ]
}

impl RigidDelassus {
    /// N of these contacts over these bodies.
    ///
    /// # Panics
    /// If a contact names a body that does not exist.
    pub fn new(contacts: Vec<RigidContact>, inverse_mass: Vec<BodyInverseMass>) -> Self {
        let mut side_start = vec![0_u32; inverse_mass.len() + 1];
        for contact in &contacts {
            for body in [contact.body_a, contact.body_b] {
                if body != FIXED {
                    assert!(
                        (body as usize) < inverse_mass.len(),
                        "contact names body {body}, which does not exist"
                    );
                    side_start[body as usize + 1] += 1;
                }
            }
        }
        for b in 0..inverse_mass.len() {
            side_start[b + 1] += side_start[b];
        }
        let mut next = side_start.clone();
        // Contact and side of every entry first: the entries themselves are ten times as long, and threads
        // share the work on them.
        let mut entries = vec![[0_u32; 2]; *side_start.last().unwrap_or(&0) as usize];
        for (i, contact) in (0..).zip(&contacts) {
            for (side, body) in [contact.body_a, contact.body_b].into_iter().enumerate() {
                if body != FIXED {
                    entries[next[body as usize] as usize] = [i, side as u32];
                    next[body as usize] += 1;
                }
            }
        }
        let side = |&[i, side]: &[u32; 2]| {
            let contact = &contacts[i as usize];
            let (sign, arm) = if side == 0 { (1.0, contact.arm_a) } else { (-1.0, contact.arm_b) };
            Side { contact: i, sign, arm }
        };
        let sides = entries.par_iter().with_min_len(TASK).map(side).collect();
        Self {
            contacts,
            inverse_mass,
            side_start,
            sides,
            turning: Vec::new(),
            turning_start: Vec::new(),
            turning_sides: Vec::new(),
            coupled: Vec::new(),
            group_of: Vec::new(),
            compliance: Vec::new(),
            cell: None,
            diagonal: OnceLock::new(),
        }
    }

    /// Number of contacts N_c.
    pub fn num_contacts(&self) -> usize {
        self.contacts.len()
    }

    /// Number of bodies.
    pub fn num_bodies(&self) -> usize {
        self.inverse_mass.len()
    }

    /// The contacts.
    pub fn contacts(&self) -> &[RigidContact] {
        &self.contacts
    }

    /// The inverse mass matrices, one per body.
    pub fn inverse_mass(&self) -> &[BodyInverseMass] {
        &self.inverse_mass
    }

    /// The contact sides of one body, contact ascending.
    pub fn sides(&self, body: usize) -> &[Side] {
        &self.sides[self.side_start[body] as usize..self.side_start[body + 1] as usize]
    }

    /// force <- F^T g of every contact: impulses in world axes, N s; length 3 N_c. Then for every entry of
    /// [`Self::turning`] the moment on body A in world axes, N m s.
    pub fn world_impulse(&self, g: &[f64], force: &mut [f64]) {
        let (force, moment) = force.split_at_mut(3 * self.num_contacts());
        let h = &g[3 * self.num_contacts()..];
        for (k, (moment, h)) in moment.chunks_exact_mut(3).zip(h.chunks_exact(3)).enumerate() {
            let [n, t1, t2] = self.turning_frame(k);
            for axis in 0..3 {
                moment[axis] = n[axis] * h[0] + t1[axis] * h[1] + t2[axis] * h[2];
            }
        }
        force.par_chunks_mut(3 * TASK).enumerate().for_each(|(task, force)| {
            let first = task * TASK;
            for (offset, force) in force.chunks_exact_mut(3).enumerate() {
                let i = first + offset;
                let [n, t1, t2] = &self.contacts[i].frame;
                let g = &g[3 * i..3 * i + 3];
                for axis in 0..3 {
                    force[axis] = n[axis] * g[0] + t1[axis] * g[1] + t2[axis] * g[2];
                }
            }
        });
    }

    /// dv <- M^-1 D g from world impulses: velocity changes (u, w) of every body, length 6 bodies, m/s and
    /// rad/s.
    pub fn velocity_change(&self, world_impulse: &[f64], dv: &mut [f64]) {
        dv.par_chunks_mut(6 * TASK).enumerate().for_each(|(task, dv)| {
            let first = task * TASK;
            for (offset, dv) in dv.chunks_exact_mut(6).enumerate() {
                dv.copy_from_slice(&self.body_velocity_change(world_impulse, first + offset));
            }
        });
        self.change_coupled(world_impulse, dv);
    }

    /// M^-1 D g of one body that is not coupled with others, from world impulses, m/s and rad/s.
    #[inline]
    pub(crate) fn body_velocity_change(&self, world_impulse: &[f64], body: usize) -> [f64; 6] {
        let [x, y, z, mx, my, mz] = self.body_impulse(world_impulse, body);
        let BodyInverseMass { linear, angular } = &self.inverse_mass[body];
        let w = times3(angular, [mx, my, mz]);
        [linear[0] * x, linear[1] * y, linear[2] * z, w[0], w[1], w[2]]
    }

    /// Sum of the world impulses on one body and of their moments about its centre, N s and N m s.
    #[inline]
    pub fn body_impulse(&self, world_impulse: &[f64], body: usize) -> [f64; 6] {
        let (mut impulse, mut moment) = ([0.0; 3], [0.0; 3]);
        for side in self.sides(body) {
            let k = 3 * side.contact as usize;
            let p = [
                side.sign * world_impulse[k],
                side.sign * world_impulse[k + 1],
                side.sign * world_impulse[k + 2],
            ];
            let m = cross(side.arm, p);
            for axis in 0..3 {
                impulse[axis] += p[axis];
                moment[axis] += m[axis];
            }
        }
        for &(k, sign) in self.turning_sides(body) {
            let first = 3 * (self.num_contacts() + k as usize);
            for axis in 0..3 {
                moment[axis] += sign * world_impulse[first + axis];
            }
        }
        [impulse[0], impulse[1], impulse[2], moment[0], moment[1], moment[2]]
    }

    /// u <- D^T v: relative velocities at the contacts, length 3 N_c, m/s, of body velocities v = (u, w) per
    /// body; then those of turning, three per entry of [`Self::turning`].
    pub fn relative_velocity(&self, v: &[f64], u: &mut [f64]) {
        let (u, turning) = u.split_at_mut(3 * self.num_contacts());
        for (k, turning) in turning.chunks_exact_mut(3).enumerate() {
            turning.copy_from_slice(&self.turning_velocity(k, v));
        }
        u.par_chunks_mut(3 * TASK).enumerate().for_each(|(task, u)| {
            let first = task * TASK;
            for (offset, u) in u.chunks_exact_mut(3).enumerate() {
                u.copy_from_slice(&self.contact_velocity(first + offset, v));
            }
        });
    }

    /// D_i^T v of one contact.
    #[inline]
    pub fn contact_velocity(&self, i: usize, v: &[f64]) -> [f64; 3] {
        let contact = &self.contacts[i];
        let mut relative = [0.0; 3];
        for (body, sign, arm) in [(contact.body_a, 1.0, contact.arm_a), (contact.body_b, -1.0, contact.arm_b)]
        {
            if body != FIXED {
                let v = &v[6 * body as usize..6 * body as usize + 6];
                let spin = cross([v[3], v[4], v[5]], arm);
                for axis in 0..3 {
                    relative[axis] += sign * (v[axis] + spin[axis]);
                }
            }
        }
        [dot3(contact.frame[0], relative), dot3(contact.frame[1], relative), dot3(contact.frame[2], relative)]
    }

    /// Block (i, j) of N: the sum over the bodies that contacts i and j share of
    /// `s_i s_j F_i (M_lin^-1 + [r_i]x^T J^-1 [r_j]x ...) F_j^T`, built column by column from unit impulses.
    pub(crate) fn block(&self, i: usize, j: usize) -> Block {
        let rows = self.coupled_rows(i);
        let block = if i == j { rows.times(&rows) } else { rows.times(&self.coupled_rows(j)) };
        self.with_block_of_others(block, i, j)
    }

    /// The same, given what coupled bodies add to it.
    fn with_block_of_others(&self, mut block: Block, i: usize, j: usize) -> Block {
        if i == j {
            block[0] += self.compliance_of(i);
        }
        if let Some(of_cell) = self.block_of_cell(i, j) {
            block.iter_mut().zip(of_cell).for_each(|(block, of_cell)| *block += of_cell);
        }
        if i.max(j) >= self.num_contacts() {
            let turning = self.block_of_turning(i, j);
            block.iter_mut().zip(turning).for_each(|(block, turning)| *block += turning);
            return block;
        }
        let (ci, cj) = (&self.contacts[i], &self.contacts[j]);
        for (body_i, sign_i, arm_i) in [(ci.body_a, 1.0, ci.arm_a), (ci.body_b, -1.0, ci.arm_b)] {
            for (body_j, sign_j, arm_j) in [(cj.body_a, 1.0, cj.arm_a), (cj.body_b, -1.0, cj.arm_b)] {
                if body_i != body_j || body_i == FIXED || self.group_of(body_i).is_some() {
                    continue;
                }
                let inverse = &self.inverse_mass[body_i as usize];
                for (column, axis_j) in cj.frame.iter().enumerate() {
                    let w = times3(&inverse.angular, cross(arm_j, *axis_j));
                    let spin = cross(w, arm_i);
                    let velocity: [f64; 3] = std::array::from_fn(|k| inverse.linear[k] * axis_j[k] + spin[k]);
                    for (row, axis_i) in ci.frame.iter().enumerate() {
                        block[3 * row + column] += sign_i * sign_j * dot3(*axis_i, velocity);
                    }
                }
            }
        }
        block
    }

    /// Diagonals (nn, 11, 22) of the blocks N_ii of all contacts and of those that resist turning once more,
    /// 1/kg; computed once.
    pub fn diagonal(&self) -> &[[f64; 3]] {
        self.diagonal.get_or_init(|| {
            let of_block = |i: usize| {
                let block = self.block(i, i);
                [block[0], block[4], block[8]]
            };
            let contacts = self.contacts.par_iter().enumerate().with_min_len(TASK);
            let of_contact = |(i, contact): (usize, &RigidContact)| {
                let moves = |body: u32| self.group_of(body).is_some();
                let coupled = moves(contact.body_a) || moves(contact.body_b);
                if coupled || self.compliance_of(i) > 0.0 { of_block(i) } else { self.diagonal_of(contact) }
            };
            let mut diagonal: Vec<[f64; 3]> = contacts.map(of_contact).collect();
            for &(contact, _) in self.cell.iter().flat_map(|cell| &cell.ways) {
                diagonal[contact as usize] = of_block(contact as usize);
            }
            diagonal.extend((self.num_contacts()..self.num_blocks()).map(of_block));
            diagonal
        })
    }

    /// The diagonal of [`Self::block`] of a contact with itself, in the same arithmetic.
    fn diagonal_of(&self, contact: &RigidContact) -> [f64; 3] {
        let sides = [(contact.body_a, 1.0, contact.arm_a), (contact.body_b, -1.0, contact.arm_b)];
        let mut diagonal = [0.0; 3];
        for (body_i, sign_i, arm_i) in sides {
            for (body_j, sign_j, arm_j) in sides {
                if body_i != body_j || body_i == FIXED {
                    continue;
                }
                let inverse = &self.inverse_mass[body_i as usize];
                for (axis, entry) in contact.frame.iter().zip(&mut diagonal) {
                    let w = times3(&inverse.angular, cross(arm_j, *axis));
                    let spin = cross(w, arm_i);
                    let velocity: [f64; 3] = std::array::from_fn(|k| inverse.linear[k] * axis[k] + spin[k]);
                    *entry += sign_i * sign_j * dot3(*axis, velocity);
                }
            }
        }
        diagonal
    }

    /// N as a sparse matrix: block (i, j) is stored where contacts i and j share a body that is not fixed, or
    /// a group of coupled ones.
    pub fn assemble(&self) -> BlockMatrix3 {
        let contacts = self.num_contacts();
        let rows: Vec<Vec<u32>> = (0..self.num_blocks())
            .into_par_iter()
            .map(|row| {
                let contact = row.checked_sub(contacts).map_or(row, |k| self.turning[k].contact as usize);
                let contact = &self.contacts[contact];
                let turning = |body: u32| {
                    self.turning_sides(body as usize).iter().map(move |(k, _)| contacts as u32 + k)
                };
                let mut columns: Vec<u32> = [contact.body_a, contact.body_b]
                    .into_iter()
                    .filter(|&body| body != FIXED)
                    .flat_map(|body| self.moved_with(body).iter().copied().chain([body]))
                    .flat_map(|body| {
                        self.sides(body as usize).iter().map(|side| side.contact).chain(turning(body))
                    })
                    .chain([row as u32])
                    .collect();
                columns.extend(self.coupled_by_cell(row));
                columns.sort_unstable();
                columns.dedup();
                columns
            })
            .collect();
        let mut row_start = Vec::with_capacity(rows.len() + 1);
        row_start.push(0);
        let mut total = 0;
        for row in &rows {
            total += row.len();
            row_start.push(total);
        }
        let coupled: Vec<CoupledRows> =
            (0..self.num_blocks()).into_par_iter().map(|i| self.coupled_rows(i)).collect();
        let block = |i: usize, j: usize| self.with_block_of_others(coupled[i].times(&coupled[j]), i, j);
        let blocks: Vec<Vec<Block>> = rows
            .par_iter()
            .enumerate()
            .map(|(i, columns)| columns.iter().map(|&j| block(i, j as usize)).collect())
            .collect();
        BlockMatrix3::from_rows(row_start, rows.concat(), blocks.concat())
    }
}
