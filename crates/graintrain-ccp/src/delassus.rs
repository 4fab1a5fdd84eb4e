//! The Delassus matrix N = D^T M^-1 D, matrix-free over rigid bodies or as an explicit sparse matrix.

use graintrain_linalg::block3::{Block, BlockMatrix3};
use std::borrow::Cow;
use std::sync::{Arc, Weak};

mod cell;
mod compliance;
mod coupled;
mod rigid;
mod turning;

pub use cell::{CELL_COMPONENTS, CellModes};
pub use coupled::CoupledBodies;
pub(crate) use rigid::cross;
pub use rigid::{BodyInverseMass, RigidContact, RigidDelassus, Side};
use rigid::{dot3, times3};
pub use turning::TurningRows;

#[cfg(test)]
pub(crate) use cell::tests as cell_tests;

/// Body index of a contact side whose velocity the impulses cannot change: fixed or fully prescribed.
pub const FIXED: u32 = u32::MAX;

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

    /// Whether it is that of this N. Equal numbers elsewhere in memory are another N. The weak reference
    /// keeps the address from being used again.
    pub fn is(&self, delassus: &Arc<Delassus>) -> bool {
        std::ptr::eq(self.0.as_ptr(), Arc::as_ptr(delassus))
    }
}

/// Scratch vectors of a product with N, allocated once per solve.
#[derive(Clone, Debug, Default)]
pub struct DelassusWork {
    force: Vec<f64>,
    velocity: Vec<f64>,
}

impl DelassusWork {
    /// M^-1 D g of the last product: velocity changes (u, w) of every body, length 6 bodies, where the form
    /// has bodies.
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

    /// Random contacts over random bodies; the last body is mixed (two axes prescribed), some sides are
    /// fixed.
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
