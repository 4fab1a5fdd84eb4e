//! A stress-controlled periodic cell: its deformation is one more body, moved by the impulses across the
//! boundary.

use super::RigidDelassus;
use graintrain_linalg::block3::Block;
use std::sync::OnceLock;

/// Rows and columns of the components xx, yy, zz, xy, xz, yz of the velocity gradient L of a cell: i is the
/// direction of the velocity, j that along which it varies.
pub const CELL_COMPONENTS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// The free components of the (upper triangular) velocity gradient L of a periodic cell, 1/s. The neighbour
/// of a contact across the boundary is the image of body B at a way b from it, which moves with u_B + L b:
///
/// ```text
/// D_i^T v = F (u_A + w_A x r_A - u_B - w_B x r_B - L b_i),     L_c = 1/W_c sum_i (-F^T g_i)_row(c) (b_i)_column(c)
/// ```
///
/// with the inertia W_c of component c, so that N = D^T M^-1 D + sum_c beta_c beta_c^T / W_c with beta_c,i
/// = -F_i e_row(c) (b_i)_column(c).
#[derive(Clone, Debug, PartialEq)]
pub struct CellModes {
    /// Contacts across the boundary, ascending, with the way b to the image of body B, m.
    pub ways: Vec<(u32, [f64; 3])>,
    /// 1 / W of every component, 1/(kg m^2); zero where impulses do not change it.
    pub mobility: [f64; 6],
}

impl CellModes {
    /// L b, m/s.
    pub fn image_velocity(rate: &[f64; 6], way: [f64; 3]) -> [f64; 3] {
        let mut velocity = [0.0; 3];
        for (rate, (row, column)) in rate.iter().zip(CELL_COMPONENTS) {
            velocity[row] += rate * way[column];
        }
        velocity
    }

    /// What a force (or impulse) on the image at a way b does to the components: f_row b_column, N m.
    pub fn push(force: [f64; 3], way: [f64; 3]) -> [f64; 6] {
        CELL_COMPONENTS.map(|(row, column)| force[row] * way[column])
    }

    /// What impulses on bodies A (world axes, N s) change of L, 1/s; they are asked for by the place of a
    /// contact among those across the boundary, and by its index.
    pub fn rate_change(&self, on_a: impl Fn(usize, usize) -> [f64; 3]) -> [f64; 6] {
        let mut sum = [0.0; 6];
        for (k, &(contact, way)) in self.ways.iter().enumerate() {
            let on_image = on_a(k, contact as usize).map(|p| -p);
            sum.iter_mut().zip(Self::push(on_image, way)).for_each(|(sum, push)| *sum += push);
        }
        std::array::from_fn(|c| self.mobility[c] * sum[c])
    }

    /// The way of a contact, where it is across the boundary.
    fn way_of(&self, contact: u32) -> Option<[f64; 3]> {
        let place = self.ways.binary_search_by_key(&contact, |(contact, _)| *contact).ok()?;
        Some(self.ways[place].1)
    }
}

impl RigidDelassus {
    /// N of contacts in a stress-controlled cell. Products go through bodies; solvers that need more take N
    /// as a matrix ([`Self::assemble`]), which couples every contact across the boundary with every other
    /// one.
    ///
    /// # Panics
    /// If contacts are not ascending or do not exist, or a way or mobility is not finite or a mobility
    /// negative.
    #[must_use]
    pub fn with_cell(mut self, cell: CellModes) -> Self {
        assert!(cell.ways.is_sorted_by(|a, b| a.0 < b.0), "contacts across the boundary ascend");
        assert!(
            cell.ways.last().is_none_or(|(contact, _)| (*contact as usize) < self.num_contacts()),
            "contacts across the boundary exist"
        );
        assert!(cell.ways.iter().flat_map(|(_, way)| way).all(|x| x.is_finite()), "ways are finite");
        assert!(
            cell.mobility.iter().all(|m| m.is_finite() && *m >= 0.0),
            "mobilities are finite and not negative"
        );
        let moves = !cell.ways.is_empty() && cell.mobility.iter().any(|m| *m > 0.0);
        self.cell = moves.then_some(cell);
        self.diagonal = OnceLock::new();
        self
    }

    /// The cell, where there is one that is stress-controlled and that contacts reach across.
    pub fn cell(&self) -> Option<&CellModes> {
        self.cell.as_ref()
    }

    /// u <- u - F L b at the contacts across the boundary, L being what the world impulses change of it.
    pub(super) fn add_cell(&self, world_impulse: &[f64], u: &mut [f64]) {
        let Some(cell) = &self.cell else { return };
        let of = |_, contact: usize| std::array::from_fn(|axis| world_impulse[3 * contact + axis]);
        let rate = cell.rate_change(of);
        for &(contact, way) in &cell.ways {
            let velocity = CellModes::image_velocity(&rate, way);
            let frame = &self.contacts()[contact as usize].frame;
            for (u, axis) in u[3 * contact as usize..].iter_mut().zip(frame) {
                *u -= axis.iter().zip(&velocity).map(|(a, v)| a * v).sum::<f64>();
            }
        }
    }

    /// Contacts that the cell couples with contact `i`.
    pub(super) fn coupled_by_cell(&self, i: usize) -> impl Iterator<Item = u32> + '_ {
        let cell =
            self.cell.as_ref().filter(|cell| i < self.num_contacts() && cell.way_of(i as u32).is_some());
        cell.into_iter().flat_map(|cell| cell.ways.iter().map(|(contact, _)| *contact))
    }

    /// What the cell adds to block (i, j) of N.
    pub(super) fn block_of_cell(&self, i: usize, j: usize) -> Option<Block> {
        let cell = self.cell.as_ref()?;
        if i.max(j) >= self.num_contacts() {
            return None;
        }
        let (way_i, way_j) = (cell.way_of(i as u32)?, cell.way_of(j as u32)?);
        let (frame_i, frame_j) = (&self.contacts()[i].frame, &self.contacts()[j].frame);
        let mut block = [0.0; 9];
        for (mobility, (row, column)) in cell.mobility.iter().zip(CELL_COMPONENTS) {
            let weight = mobility * way_i[column] * way_j[column];
            for (entry, value) in block.iter_mut().enumerate() {
                *value += weight * frame_i[entry / 3][row] * frame_j[entry % 3][row];
            }
        }
        Some(block)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::tests::{random_rigid, uniform};
    use super::super::{Delassus, RigidDelassus};
    use super::*;

    /// Random contacts over random bodies, every third one across the boundary of a cell of which two
    /// components are held.
    pub(crate) fn random_cell(bodies: usize, contacts: usize, seed: u8) -> RigidDelassus {
        let mut random = uniform(seed);
        let edges = [1.0, 1.3, 0.8];
        // (Few different ways, so that contacts share images.)
        let mut way = || edges.map(|edge| edge * ((3.0 * random()).floor() - 1.0));
        let ways = (0..contacts as u32).filter(|i| i % 3 == 1).map(|i| (i, way())).collect();
        let mobility = [0.02, 0.0, 0.03, 0.01, 0.05, 0.0];
        random_rigid(bodies, contacts, seed).with_cell(CellModes { ways, mobility })
    }

    /// N g is what the bodies do and what the cell does, from the definition; the matrix is the same.
    #[test]
    fn products_and_the_matrix_are_the_definition() {
        let rigid = random_cell(9, 40, 5);
        let plain = RigidDelassus { cell: None, diagonal: OnceLock::new(), ..rigid.clone() };
        let mut random = uniform(2);
        let g: Vec<f64> = (0..120).map(|_| random() - 0.5).collect();
        let product = |n: &Delassus| {
            let mut u = vec![0.0; 120];
            n.multiply(&g, &mut u, &mut n.work());
            u
        };
        let mut expected = product(&Delassus::Rigid(plain));
        let cell = rigid.cell().unwrap().clone();
        for ((row, column), mobility) in CELL_COMPONENTS.into_iter().zip(cell.mobility) {
            let beta = |i: u32, way: [f64; 3]| {
                rigid.contacts()[i as usize].frame.map(|axis| -axis[row] * way[column])
            };
            let rate: f64 = cell
                .ways
                .iter()
                .map(|&(i, way)| (0..3).map(|k| beta(i, way)[k] * g[3 * i as usize + k]).sum::<f64>())
                .sum();
            for &(i, way) in &cell.ways {
                for k in 0..3 {
                    expected[3 * i as usize + k] += mobility * rate * beta(i, way)[k];
                }
            }
        }
        let matrix = rigid.assemble();
        assert!(matrix.asymmetry() < 1e-14);
        for i in 0..40 {
            let block = matrix.get(i, i);
            assert_eq!(rigid.diagonal()[i], [block[0], block[4], block[8]]);
        }
        for form in [Delassus::Rigid(rigid), Delassus::Sparse(matrix)] {
            for (found, expected) in product(&form).iter().zip(&expected) {
                assert!((found - expected).abs() < 1e-12, "{found} {expected}");
            }
        }
    }

    #[test]
    fn a_cell_that_no_contact_reaches_across_or_that_is_held_is_none() {
        let plain = random_rigid(4, 6, 1).with_cell(CellModes { ways: Vec::new(), mobility: [1.0; 6] });
        assert!(plain.cell().is_none() && plain.is_plain());
        let held = CellModes { ways: vec![(2, [1.0, 0.0, 0.0])], mobility: [0.0; 6] };
        assert!(random_rigid(4, 6, 1).with_cell(held).is_plain());
        assert!(!random_cell(4, 6, 1).is_plain());
    }
}
