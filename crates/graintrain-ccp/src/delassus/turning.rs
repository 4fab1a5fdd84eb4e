//! Rows of contacts that resist turning: no force, and a moment about the axes of the contact's frame.

use super::{FIXED, RigidDelassus, cross, dot3, times3};
use graintrain_linalg::block3::Block;
use std::sync::OnceLock;

/// Rows of a contact that resists turning: `length F (w_A - w_B)`, the turning velocities about n, t1 and t2
/// of its frame as velocities. The impulses of these rows are moments over the length, N s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurningRows {
    /// Index of the contact.
    pub contact: u32,
    /// Length, m. It sets units alone; with about an arm of the contact all rows are of one size.
    pub length: f64,
}

impl RigidDelassus {
    /// N with three more rows for each of these contacts, and no others, after those of all contacts.
    ///
    /// # Panics
    /// If an entry names a contact that does not exist.
    #[must_use]
    pub fn with_turning(mut self, turning: Vec<TurningRows>) -> Self {
        let sides_of = |rows: &TurningRows| {
            let contact = &self.contacts[rows.contact as usize];
            [(contact.body_a, 1.0), (contact.body_b, -1.0)]
        };
        let mut start = vec![0_u32; self.num_bodies() + 1];
        for (body, _) in turning.iter().flat_map(sides_of).filter(|(body, _)| *body != FIXED) {
            start[body as usize + 1] += 1;
        }
        for b in 0..self.num_bodies() {
            start[b + 1] += start[b];
        }
        let mut next = start.clone();
        let mut sides = vec![(0, 0.0); *start.last().unwrap_or(&0) as usize];
        for (k, rows) in turning.iter().enumerate() {
            for (body, sign) in sides_of(rows).into_iter().filter(|(body, _)| *body != FIXED) {
                sides[next[body as usize] as usize] = (k as u32, sign);
                next[body as usize] += 1;
            }
        }
        (self.turning_start, self.turning_sides, self.turning) = (start, sides, turning);
        self.diagonal = OnceLock::new();
        self
    }

    /// The contacts that resist turning, in the order of their rows.
    pub fn turning(&self) -> &[TurningRows] {
        &self.turning
    }

    /// Number of block rows of N: contacts, and those that resist turning once more.
    pub fn num_blocks(&self) -> usize {
        self.contacts.len() + self.turning.len()
    }

    /// Rows of turning of entry k: F, times the length.
    pub(super) fn turning_frame(&self, k: usize) -> [[f64; 3]; 3] {
        let TurningRows { contact, length } = self.turning[k];
        self.contacts[contact as usize].frame.map(|axis| axis.map(|x| length * x))
    }

    /// Sides of turning rows of one body: entry of [`Self::turning`] and sign.
    pub(crate) fn turning_sides(&self, body: usize) -> &[(u32, f64)] {
        if self.turning.is_empty() {
            return &[];
        }
        &self.turning_sides[self.turning_start[body] as usize..self.turning_start[body + 1] as usize]
    }

    /// Turning velocities of entry k of [`Self::turning`], times its length, m/s.
    pub fn turning_velocity(&self, k: usize, v: &[f64]) -> [f64; 3] {
        let contact = &self.contacts[self.turning[k].contact as usize];
        let mut relative = [0.0; 3];
        for (body, sign) in [(contact.body_a, 1.0), (contact.body_b, -1.0)] {
            if body != FIXED {
                let spin = &v[6 * body as usize + 3..6 * body as usize + 6];
                for axis in 0..3 {
                    relative[axis] += sign * spin[axis];
                }
            }
        }
        self.turning_frame(k).map(|axis| dot3(axis, relative))
    }

    /// Block (i, j) of N where at least one of both has turning rows: whose impulses are no force and a
    /// moment.
    pub(super) fn block_of_turning(&self, i: usize, j: usize) -> Block {
        let contacts = self.num_contacts();
        // For every row the impulse on a side's body and its moment, but for the sign.
        let rows = |block: usize, arm: [f64; 3]| {
            if block < contacts {
                self.contacts[block].frame.map(|axis| [axis, cross(arm, axis)])
            } else {
                self.turning_frame(block - contacts).map(|axis| [[0.0; 3], axis])
            }
        };
        let sides = |block: usize| {
            let contact = block.checked_sub(contacts).map_or(block, |k| self.turning[k].contact as usize);
            let contact = &self.contacts[contact];
            [(contact.body_a, 1.0, contact.arm_a), (contact.body_b, -1.0, contact.arm_b)]
        };
        let mut block = [0.0; 9];
        for (body_i, sign_i, arm_i) in sides(i) {
            for (body_j, sign_j, arm_j) in sides(j) {
                if body_i != body_j || body_i == FIXED || self.group_of(body_i).is_some() {
                    continue;
                }
                let inverse = &self.inverse_mass[body_i as usize];
                for (column, [force, moment]) in rows(j, arm_j).into_iter().enumerate() {
                    let w = times3(&inverse.angular, moment);
                    let v: [f64; 3] = std::array::from_fn(|k| inverse.linear[k] * force[k]);
                    for (row, [along, about]) in rows(i, arm_i).into_iter().enumerate() {
                        block[3 * row + column] += sign_i * sign_j * (dot3(along, v) + dot3(about, w));
                    }
                }
            }
        }
        block
    }
}
