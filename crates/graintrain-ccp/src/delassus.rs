//! The Delassus matrix N = D^T M^-1 D, matrix-free over rigid bodies or as an explicit sparse matrix.

use graintrain_linalg::block3::{Block, BlockMatrix3};
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::{Arc, OnceLock, Weak};

mod cell;
mod compliance;
mod coupled;
mod turning;

pub use cell::{CELL_COMPONENTS, CellModes};
pub use coupled::CoupledBodies;
pub use turning::TurningRows;

#[cfg(test)]
pub(crate) use cell::tests as cell_tests;

/// Body index of a contact side whose velocity the impulses cannot change: fixed or fully prescribed.
pub const FIXED: u32 = u32::MAX;

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

/// Inverse mass matrix of one body, in world axes. Degrees of freedom that are prescribed have zero rows and columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyInverseMass {
    /// Diagonal of the inverse of m I_3, 1/kg; zero along prescribed axes.
    pub linear: [f64; 3],
    /// Inverse inertia (R I R^T)^-1, symmetric 3x3, row-major, 1/(kg m^2).
    pub angular: Block,
}

/// N over rigid bodies, applied without being formed.
///
/// A product N g costs about 110 flops and 250 bytes of traffic per contact: contacts turn impulses into world forces,
/// every body gathers the forces of its own contacts, every contact reads the velocities of its two bodies. Bodies
/// gather in a fixed order, so that the bits do not depend on the number of threads.
#[derive(Clone, Debug)]
pub struct RigidDelassus {
    contacts: Vec<RigidContact>,
    inverse_mass: Vec<BodyInverseMass>,
    /// Body b's contact sides are `sides[side_start[b]..side_start[b + 1]]`, contact ascending.
    side_start: Vec<u32>,
    sides: Vec<Side>,
    /// Block row N_c + k of N is that of entry k.
    turning: Vec<TurningRows>,
    /// Body b's sides of turning rows are `turning_sides[turning_start[b]..turning_start[b + 1]]`: entry of `turning` and sign. Both are
    /// empty where nothing resists turning.
    turning_start: Vec<u32>,
    turning_sides: Vec<(u32, f64)>,
    /// Groups of bodies with a common inverse mass, and for every body its group and place there (`u32::MAX`: none); both are empty where
    /// there are no groups.
    coupled: Vec<CoupledBodies>,
    group_of: Vec<(u32, u32)>,
    /// Compliances of the normal rows, 1/kg; empty where all contacts are rigid.
    compliance: Vec<f64>,
    /// A periodic cell that gives way.
    cell: Option<CellModes>,
    /// Diagonals of the blocks N_ii, made when first asked for.
    diagonal: OnceLock<Vec<[f64; 3]>>,
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

/// The Delassus matrix in one of its two forms.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is one per problem, behind an Arc")]
pub enum Delassus {
    /// Matrix-free over rigid bodies.
    Rigid(RigidDelassus),
    /// An explicit symmetric sparse matrix (problem files without bodies).
    Sparse(BlockMatrix3),
}

/// Which N something was prepared for, without keeping it in memory.
#[derive(Clone, Debug, Default)]
pub struct DelassusIdentity(Weak<Delassus>);

impl DelassusIdentity {
    /// Of this N.
    pub fn of(delassus: &Arc<Delassus>) -> Self {
        Self(Arc::downgrade(delassus))
    }

    /// Whether it is that of this N. Equal numbers elsewhere in memory are another N. The weak reference keeps the address from
    /// being used again.
    pub fn is(&self, delassus: &Arc<Delassus>) -> bool {
        std::ptr::eq(self.0.as_ptr(), Arc::as_ptr(delassus))
    }
}

#[inline]
pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline]
fn dot3(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
fn times3(m: &Block, x: [f64; 3]) -> [f64; 3] {
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
        // Contact and side of every entry first: the entries themselves are ten times as long, and threads share the work on them.
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

    /// force <- F^T g of every contact: impulses in world axes, N s; length 3 N_c. Then for every entry of [`Self::turning`] the moment
    /// on body A in world axes, N m s.
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

    /// dv <- M^-1 D g from world impulses: velocity changes (u, w) of every body, length 6 bodies, m/s and rad/s.
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

    /// u <- D^T v: relative velocities at the contacts, length 3 N_c, m/s, of body velocities v = (u, w) per body; then those of
    /// turning, three per entry of [`Self::turning`].
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
    fn block(&self, i: usize, j: usize) -> Block {
        let mut block = self.block_of_coupled(i, j);
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

    /// Diagonals (nn, 11, 22) of the blocks N_ii of all contacts and of those that resist turning once more, 1/kg; computed once.
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

    /// N as a sparse matrix: block (i, j) is stored where contacts i and j share a body that is not fixed, or a group of
    /// coupled ones.
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
        let blocks: Vec<Vec<Block>> = rows
            .par_iter()
            .enumerate()
            .map(|(i, columns)| columns.iter().map(|&j| self.block(i, j as usize)).collect())
            .collect();
        BlockMatrix3::from_rows(row_start, rows.concat(), blocks.concat())
    }
}

/// Scratch vectors of a product with N, allocated once per solve.
#[derive(Clone, Debug, Default)]
pub struct DelassusWork {
    force: Vec<f64>,
    velocity: Vec<f64>,
}

impl DelassusWork {
    /// M^-1 D g of the last product: velocity changes (u, w) of every body, length 6 bodies, where the form has bodies.
    pub fn body_velocity(&self) -> &[f64] {
        &self.velocity
    }
}

impl Delassus {
    /// Number of block rows: contacts, and those that resist turning once more.
    pub fn num_blocks(&self) -> usize {
        match self {
            Self::Rigid(rigid) => rigid.num_blocks(),
            Self::Sparse(matrix) => matrix.num_rows(),
        }
    }

    /// Number of bodies, where the form knows them.
    pub fn num_bodies(&self) -> usize {
        match self {
            Self::Rigid(rigid) => rigid.num_bodies(),
            Self::Sparse(_) => 0,
        }
    }

    /// Scratch for [`Self::multiply`].
    pub fn work(&self) -> DelassusWork {
        match self {
            Self::Rigid(rigid) => DelassusWork {
                force: vec![0.0; 3 * rigid.num_blocks()],
                velocity: vec![0.0; 6 * rigid.num_bodies()],
            },
            Self::Sparse(_) => DelassusWork::default(),
        }
    }

    /// u <- N g; both with three numbers per block row.
    pub fn multiply(&self, g: &[f64], u: &mut [f64], work: &mut DelassusWork) {
        match self {
            Self::Rigid(rigid) => {
                rigid.world_impulse(g, &mut work.force);
                rigid.velocity_change(&work.force, &mut work.velocity);
                rigid.relative_velocity(&work.velocity, u);
                rigid.add_compliance(g, u);
                rigid.add_cell(&work.force, u);
            }
            Self::Sparse(matrix) => matrix.multiply(g, u),
        }
    }

    /// Diagonal block N_ii.
    pub fn diagonal_block(&self, i: usize) -> Block {
        match self {
            Self::Rigid(rigid) => rigid.block(i, i),
            Self::Sparse(matrix) => matrix.get(i, i),
        }
    }

    /// Diagonals (nn, 11, 22) of all blocks N_ii, 1/kg.
    pub fn diagonals(&self) -> Cow<'_, [[f64; 3]]> {
        match self {
            Self::Rigid(rigid) => rigid.diagonal().into(),
            Self::Sparse(_) => (0..self.num_blocks()).map(|i| self.diagonal(i)).collect(),
        }
    }

    /// Diagonal (nn, 11, 22) of the block N_ii, 1/kg.
    pub fn diagonal(&self, i: usize) -> [f64; 3] {
        match self {
            Self::Rigid(rigid) => rigid.diagonal()[i],
            Self::Sparse(matrix) => {
                let block = matrix.get(i, i);
                [block[0], block[4], block[8]]
            }
        }
    }

    /// N as a sparse matrix (a copy where it already is one).
    pub fn assemble(&self) -> BlockMatrix3 {
        match self {
            Self::Rigid(rigid) => rigid.assemble(),
            Self::Sparse(matrix) => matrix.clone(),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::Rng as _;
    use proptest::test_runner::{RngAlgorithm, TestRng};

    /// Uniform numbers in [0, 1) from a fixed seed.
    pub(crate) fn uniform(seed: u8) -> impl FnMut() -> f64 {
        let mut rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[seed; 32]);
        move || (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Random contacts over random bodies; the last body is mixed (two axes prescribed), some sides are fixed.
    pub(crate) fn random_rigid(bodies: usize, contacts: usize, seed: u8) -> RigidDelassus {
        let mut random = uniform(seed);
        let mut signed = move || 2.0 * random() - 1.0;
        let inverse_mass = (0..bodies)
            .map(|b| {
                let l = [signed(), 0.0, 0.0, signed(), signed(), 0.0, signed(), signed(), signed()];
                let mut angular = [0.0; 9];
                for i in 0..3 {
                    for j in 0..3 {
                        angular[3 * i + j] = (0..3).map(|k| l[3 * i + k] * l[3 * j + k]).sum::<f64>();
                    }
                }
                let m = 0.2 + signed().abs();
                let linear = if b + 1 == bodies { [m, 0.0, 0.0] } else { [m; 3] };
                BodyInverseMass { linear, angular }
            })
            .collect();
        let contacts = (0..contacts)
            .map(|_| {
                let mut unit = || {
                    let v = [signed(), signed(), signed()];
                    let length = dot3(v, v).sqrt();
                    v.map(|x| x / length)
                };
                let n = unit();
                let other = unit();
                let t1 = cross(n, other);
                let length = dot3(t1, t1).sqrt();
                let t1 = t1.map(|x| x / length);
                let (arm_a, arm_b) = (unit(), unit());
                let body = |x: f64| {
                    if x.abs() < 0.1 {
                        FIXED
                    } else {
                        ((x.abs() * bodies as f64) as u32).min(bodies as u32 - 1)
                    }
                };
                let body_a = body(signed());
                let mut body_b = body(signed());
                if body_b == body_a {
                    body_b = FIXED;
                }
                RigidContact { body_a, body_b, frame: [n, t1, cross(n, t1)], arm_a, arm_b }
            })
            .collect();
        RigidDelassus::new(contacts, inverse_mass)
    }

    /// Dense D (6 bodies x 3 block rows) straight from the definition with the cross-product matrix.
    fn dense_jacobian(rigid: &RigidDelassus) -> Vec<Vec<f64>> {
        let mut d = vec![vec![0.0; 3 * rigid.num_blocks()]; 6 * rigid.num_bodies()];
        for (k, rows) in rigid.turning().iter().enumerate() {
            let c = &rigid.contacts()[rows.contact as usize];
            for (body, sign) in [(c.body_a, 1.0), (c.body_b, -1.0)].into_iter().filter(|(b, _)| *b != FIXED) {
                for (component, axis) in c.frame.iter().enumerate() {
                    for l in 0..3 {
                        let column = 3 * (rigid.num_contacts() + k) + component;
                        d[6 * body as usize + 3 + l][column] += sign * rows.length * axis[l];
                    }
                }
            }
        }
        for (i, c) in rigid.contacts().iter().enumerate() {
            for (body, sign, r) in [(c.body_a, 1.0, c.arm_a), (c.body_b, -1.0, c.arm_b)] {
                if body == FIXED {
                    continue;
                }
                // w x r = -[r]x w; row k of -[r]x dotted with w.
                let minus_skew = [[0.0, r[2], -r[1]], [-r[2], 0.0, r[0]], [r[1], -r[0], 0.0]];
                for (component, axis) in c.frame.iter().enumerate() {
                    for k in 0..3 {
                        d[6 * body as usize + k][3 * i + component] += sign * axis[k];
                        let lever: f64 = (0..3).map(|row| axis[row] * minus_skew[row][k]).sum();
                        d[6 * body as usize + 3 + k][3 * i + component] += sign * lever;
                    }
                }
            }
        }
        d
    }

    #[test]
    fn identity_is_that_of_one_matrix_and_not_of_equal_ones() {
        let mut n = Arc::new(Delassus::Rigid(random_rigid(3, 4, 1)));
        let identity = DelassusIdentity::of(&n);
        assert!(identity.is(&n) && identity.is(&Arc::clone(&n)));
        assert!(!identity.is(&Arc::new((*n).clone())) && !DelassusIdentity::default().is(&n));
        // Nobody can change N behind the back of who remembers it.
        assert!(Arc::get_mut(&mut n).is_none());
        Arc::make_mut(&mut n);
        assert!(!identity.is(&n));
    }

    #[test]
    fn product_and_assembly_agree_with_a_dense_transpose_times_inverse_mass_times_jacobian() {
        let plain = random_rigid(7, 20, 3);
        let rows = |contact: u32| TurningRows { contact, length: 0.1 + f64::from(contact) };
        let turning = plain.clone().with_turning([0, 3, 4, 19].map(rows).to_vec());
        product_and_assembly_are_dense_ones(turning.clone());
        let mut random = uniform(4);
        let factor = |bodies: usize, degrees: usize, random: &mut dyn FnMut() -> f64| {
            (0..6 * bodies * degrees).map(|_| random() - 0.5).collect()
        };
        let coupled = vec![
            CoupledBodies { bodies: vec![0, 2, 5], degrees: 4, factor: factor(3, 4, &mut random) },
            CoupledBodies { bodies: vec![1, 6], degrees: 2, factor: factor(2, 2, &mut random) },
        ];
        responses_are_dense_ones(&plain.clone().with_coupled(coupled.clone()));
        product_and_assembly_are_dense_ones(plain.clone().with_coupled(coupled.clone()));
        let compliance = || (0..20).map(|i| f64::from(i % 3)).collect();
        product_and_assembly_are_dense_ones(plain.clone().with_compliance(compliance()));
        product_and_assembly_are_dense_ones(turning.with_coupled(coupled).with_compliance(compliance()));
        product_and_assembly_are_dense_ones(plain);
    }

    /// Velocity changes by impulses on two bodies: of one group, of two, one alone and a fixed one.
    fn responses_are_dense_ones(rigid: &RigidDelassus) {
        let inverse = dense_inverse_mass(rigid);
        let impulse = |body: u32| std::array::from_fn(|k| f64::from(body % 7) + 0.3 * k as f64 - 0.5);
        for pair in [[2, 5], [0, 6], [3, 1], [4, FIXED]] {
            let response = rigid.response(pair.map(|body| (body, impulse(body))));
            for (body, change) in pair.into_iter().zip(response) {
                for (axis, change) in change.into_iter().enumerate() {
                    let row = inverse.get(6 * body as usize + axis);
                    let of = |row: &Vec<f64>, on: u32| {
                        let of_axis =
                            |k: usize| row.get(6 * on as usize + k).unwrap_or(&0.0) * impulse(on)[k];
                        (0..6).map(of_axis).sum::<f64>()
                    };
                    let expected = row.map_or(0.0, |row| of(row, pair[0]) + of(row, pair[1]));
                    assert!((change - expected).abs() < 1e-12, "{pair:?}: {change} {expected}");
                }
            }
        }
    }

    /// M^-1 of all bodies as a dense matrix, coupled ones by the definition W = Y Y^T.
    fn dense_inverse_mass(rigid: &RigidDelassus) -> Vec<Vec<f64>> {
        let size = 6 * rigid.num_bodies();
        let mut inverse = vec![vec![0.0; size]; size];
        for (body, m) in rigid.inverse_mass().iter().enumerate() {
            if rigid.group_of(body as u32).is_some() {
                continue;
            }
            for k in 0..3 {
                inverse[6 * body + k][6 * body + k] = m.linear[k];
                for l in 0..3 {
                    inverse[6 * body + 3 + k][6 * body + 3 + l] = m.angular[3 * k + l];
                }
            }
        }
        for group in rigid.coupled() {
            let place = |k: usize| 6 * group.bodies[k / 6] as usize + k % 6;
            for a in 0..6 * group.bodies.len() {
                for b in 0..6 * group.bodies.len() {
                    let y = |row: usize, column: usize| group.factor[row * group.degrees + column];
                    inverse[place(a)][place(b)] = (0..group.degrees).map(|c| y(a, c) * y(b, c)).sum();
                }
            }
        }
        inverse
    }

    fn product_and_assembly_are_dense_ones(rigid: RigidDelassus) {
        let d = dense_jacobian(&rigid);
        let size = 3 * rigid.num_blocks();
        let mut dense = vec![vec![0.0; size]; size];
        let inverse = dense_inverse_mass(&rigid);
        for (k, inverse) in inverse.iter().enumerate() {
            for (l, inverse) in inverse.iter().enumerate().filter(|(_, x)| **x != 0.0) {
                for a in 0..size {
                    for b in 0..size {
                        dense[a][b] += d[k][a] * inverse * d[l][b];
                    }
                }
            }
        }
        for (i, c) in rigid.compliance().iter().enumerate() {
            dense[3 * i][3 * i] += c;
        }
        let assembled = rigid.assemble();
        for i in 0..rigid.num_blocks() {
            assert_eq!(rigid.diagonal()[i], [0, 4, 8].map(|k| rigid.block(i, i)[k]));
            for j in 0..rigid.num_blocks() {
                let block = assembled.get(i, j);
                for a in 0..3 {
                    for b in 0..3 {
                        assert!((block[3 * a + b] - dense[3 * i + a][3 * j + b]).abs() < 1e-12);
                    }
                }
            }
        }
        assert!(assembled.asymmetry() < 1e-14);
        let mut random = uniform(9);
        let g: Vec<f64> = (0..size).map(|_| random()).collect();
        let expected: Vec<f64> =
            dense.iter().map(|row| row.iter().zip(&g).map(|(a, b)| a * b).sum()).collect();
        for form in [Delassus::Rigid(rigid), Delassus::Sparse(assembled)] {
            let mut u = vec![0.0; size];
            form.multiply(&g, &mut u, &mut form.work());
            for (a, b) in u.iter().zip(&expected) {
                assert!((a - b).abs() < 1e-11);
            }
        }
    }
}
