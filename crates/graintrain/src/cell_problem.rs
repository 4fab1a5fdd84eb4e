//! The contact problem of a step in a periodic cell whose stress is imposed: its deformation is one more
//! thing that impulses change.
//!
//! Contacts across the boundary have the relative velocity `D_i^T v - F_i L b_i` (F: rows n, t1, t2; b = H n
//! the way to the image of body B). With the components of L that are free and their inertias W,
//!
//! ```text
//! N = D^T M^-1 D + sum over components c of   beta_c beta_c^T / W_c,     beta_c,i = -F_i e_row(c) (b_i)_column(c)
//! ```
//!
//! which couples every contact across the boundary with every other one. Solvers whose products go through
//! bodies take the cell as one more body ([`CellModes`]); others need N as a matrix, whose size grows with
//! the square of the number of such contacts, about 2 N^(2/3) for N grains.

use crate::cell::{Cell, Drive};
use crate::contact::Contact;
use graintrain_ccp::{Ccp, CellModes, Delassus, RigidContact, RigidDelassus};
use std::sync::Arc;

/// The free components of L as contacts see them.
#[derive(Clone)]
pub(crate) struct CellRows {
    modes: CellModes,
    /// Frames of the contacts across the boundary.
    frames: Vec<[[f64; 3]; 3]>,
}

impl CellRows {
    /// Those of the contacts of a problem, with the inertias of the components, kg m^2.
    pub(crate) fn new(
        cell: &Cell,
        contacts: &[Contact],
        rows: &[RigidContact],
        inertia: impl Fn(usize) -> f64,
    ) -> Self {
        let mobility = std::array::from_fn(|k| match cell.drive[k] {
            Drive::Stress(_) if inertia(k) > 0.0 => 1.0 / inertia(k),
            _ => 0.0,
        });
        let numbered = (0..).zip(contacts.iter().zip(rows));
        let across = numbered.filter(|(_, (contact, _))| contact.image != [0; 3]);
        let way = |contact: &Contact| cell.shift(contact.image).to_array();
        let (ways, frames) = across.map(|(i, (contact, row))| ((i, way(contact)), row.frame)).unzip();
        Self { modes: CellModes { ways, mobility }, frames }
    }

    /// Whether no contact reaches across the boundary.
    pub(crate) fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Holds components as they are, whatever impulses do.
    pub(crate) fn hold(&mut self, component: impl Fn(usize) -> bool) {
        (0..6).filter(|&k| component(k)).for_each(|k| self.modes.mobility[k] = 0.0);
    }

    /// The problem with the cell in N.
    pub(crate) fn posed(&self, problem: &Ccp) -> Ccp {
        let Delassus::Rigid(rigid) = &*problem.delassus else { return problem.clone() };
        Ccp { delassus: Arc::new(Delassus::Rigid(self.put_into(rigid.clone()))), ..problem.clone() }
    }

    /// N with the cell.
    pub(crate) fn put_into(&self, rigid: RigidDelassus) -> RigidDelassus {
        rigid.with_cell(self.modes.clone())
    }

    /// Adds to r what a change of L (1/s) does to relative velocities.
    pub(crate) fn shift(&self, change: &[f64; 6], r: &mut [f64]) {
        for (&(contact, way), frame) in self.modes.ways.iter().zip(&self.frames) {
            let velocity = CellModes::image_velocity(change, way);
            for (r, axis) in r[3 * contact as usize..].iter_mut().zip(frame) {
                *r -= axis.iter().zip(velocity).map(|(axis, v)| axis * v).sum::<f64>();
            }
        }
    }

    /// What the pulls of contacts (one each, N s; none: empty) change of L, 1/s.
    pub(crate) fn change_by_pulls(&self, pulls: &[f64]) -> [f64; 6] {
        if pulls.is_empty() {
            return [0.0; 6];
        }
        self.modes.rate_change(|k, contact| self.frames[k][0].map(|n| -pulls[contact] * n))
    }

    /// What impulses (contact frames, N s) change of L, 1/s.
    pub(crate) fn rate_change(&self, impulse: &[f64]) -> [f64; 6] {
        self.modes.rate_change(|k, contact| {
            let g = &impulse[3 * contact..3 * contact + 3];
            let frame = &self.frames[k];
            std::array::from_fn(|axis| (0..3).map(|row| frame[row][axis] * g[row]).sum())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::motion::Profile;
    use graintrain_ccp::BodyInverseMass;

    /// N g with the cell is N g without it and the relative velocities that its own change of rate makes.
    #[test]
    fn the_matrix_is_what_impulses_do() {
        let mut cell = Cell::new(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), [true; 3]).unwrap();
        cell.tilt = [0.1, -0.2, 0.4];
        cell.drive = [0, 1, 2, 3, 4, 5].map(|k| match k {
            1 => Drive::HELD,
            _ => Drive::Stress(Profile::Constant(1.0)),
        });
        let images = [[0, 0, 0], [1, 0, 0], [0, -1, 1], [0, 0, 0], [1, 1, 1]];
        let contacts: Vec<Contact> = images
            .into_iter()
            .enumerate()
            .map(|(k, image)| {
                let normal = Vec3::new(1.0, k as f64, -0.5).normalize();
                let (body_a, body_b) = (k as u32, (k as u32 + 1) % 5);
                let zero = Vec3::ZERO;
                Contact {
                    body_a,
                    body_b,
                    identity: k as u64,
                    point: zero,
                    normal,
                    gap: 0.0,
                    lead: zero,
                    image,
                }
            })
            .collect();
        let rows: Vec<RigidContact> = contacts
            .iter()
            .map(|c| {
                let (t1, t2) = crate::math::tangents(c.normal);
                let frame = [c.normal, t1, t2].map(|axis| axis.to_array());
                let [arm_a, arm_b] = [[0.1, 0.0, 0.2], [0.0, -0.1, 0.1]];
                RigidContact { body_a: c.body_a, body_b: c.body_b, frame, arm_a, arm_b }
            })
            .collect();
        let across = CellRows::new(&cell, &contacts, &rows, |k| cell.inertia(k, 7.0, 0.0, 1e-3));
        let mass = |b: u32| BodyInverseMass {
            linear: [1.0 + f64::from(b); 3],
            angular: [2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0],
        };
        let rigid = RigidDelassus::new(rows, (0..5).map(mass).collect());
        let problem = Ccp::new(Delassus::Rigid(rigid), vec![0.0; 15], vec![0.3; 5]).unwrap();
        let g: Vec<f64> = (0..15).map(|k| f64::from(k).sin()).collect();
        let product = |problem: &Ccp| {
            let mut u = vec![0.0; 15];
            problem.delassus.multiply(&g, &mut u, &mut problem.delassus.work());
            u
        };
        let mut expected = product(&problem);
        let change = across.rate_change(&g);
        assert!(change[1] == 0.0 && change[0] != 0.0 && change[5] != 0.0);
        across.shift(&change, &mut expected);
        for (found, expected) in product(&across.posed(&problem)).iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-13, "{found} {expected}");
        }
        // Against L H n itself: contact 2 in world axes.
        let rate = Cell { rate: change, ..cell.clone() };
        let jump = rate.image_velocity(images[2]);
        let mut only = vec![0.0; 15];
        across.shift(&change, &mut only);
        let n = contacts[2].normal;
        assert!((only[6] + n.dot(jump)).abs() < 1e-13);
        // A push apart of a contact across x stretches the cell along x.
        let mut push = vec![0.0; 15];
        push[3] = -contacts[1].normal.x.signum();
        assert!(across.rate_change(&push)[0] > 0.0);
    }
}
