//! Bodies that joints hold together: their inverse mass is not block diagonal.

use super::{RigidContact, RigidDelassus, cross};
use graintrain_linalg::block3::Block;
use std::sync::OnceLock;

/// Bodies whose common inverse mass is `W = Y Y^T` (6k x 6k over the k bodies, linear before angular, world
/// axes): what is left of M^-1 once bilateral rows J are eliminated,
/// `W = M^-1 - M^-1 J^T (J M^-1 J^T)^-1 J M^-1`. Columns of Y are the motions that J leaves free.
#[derive(Clone, Debug, PartialEq)]
pub struct CoupledBodies {
    /// Indices of the bodies, ascending.
    pub bodies: Vec<u32>,
    /// Number of columns of Y.
    pub degrees: usize,
    /// Y by rows, six per body, 1/sqrt(kg) and 1/(m sqrt(kg)).
    pub factor: Vec<f64>,
}

impl CoupledBodies {
    /// Row of Y: degree of freedom `axis` (0 to 5) of the body at `place` among these.
    fn row(&self, place: usize, axis: usize) -> &[f64] {
        let first = (6 * place + axis) * self.degrees;
        &self.factor[first..first + self.degrees]
    }

    /// Y^T f of impulses on all bodies, six per body of `impulse_of`.
    fn gather(&self, impulse_of: impl Fn(usize) -> [f64; 6]) -> Vec<f64> {
        let mut sum = vec![0.0; self.degrees];
        for (place, &body) in self.bodies.iter().enumerate() {
            for (axis, f) in impulse_of(body as usize).into_iter().enumerate() {
                for (sum, y) in sum.iter_mut().zip(self.row(place, axis)) {
                    *sum += f * y;
                }
            }
        }
        sum
    }

    /// Y a of one body.
    fn velocity(&self, place: usize, a: &[f64]) -> [f64; 6] {
        std::array::from_fn(|axis| self.row(place, axis).iter().zip(a).map(|(y, a)| y * a).sum())
    }
}

impl RigidDelassus {
    /// N where these groups of bodies (no body in two of them) have a common inverse mass in the place of
    /// their own. First-order methods take it as it is; others get N as a matrix ([`Self::assemble`]) from
    /// their [cascade](crate::solver::cascade).
    ///
    /// # Panics
    /// If a group names a body that does not exist or a body is in two of them.
    #[must_use]
    pub fn with_coupled(mut self, coupled: Vec<CoupledBodies>) -> Self {
        if coupled.is_empty() {
            return self;
        }
        self.group_of = vec![(u32::MAX, 0); self.num_bodies()];
        for (group, bodies) in (0..).zip(&coupled) {
            for (place, &body) in (0..).zip(&bodies.bodies) {
                let known = &mut self.group_of[body as usize];
                assert!(known.0 == u32::MAX, "body {body} is in two groups of coupled bodies");
                *known = (group, place);
            }
        }
        self.coupled = coupled;
        self.diagonal = OnceLock::new();
        self
    }

    /// The groups of bodies with a common inverse mass.
    pub fn coupled(&self) -> &[CoupledBodies] {
        &self.coupled
    }

    /// Velocity change of each of two bodies by an impulse on both (force, then moment about its centre),
    /// through their groups where they have one.
    pub fn response(&self, impulses: [(u32, [f64; 6]); 2]) -> [[f64; 6]; 2] {
        impulses.map(|(body, own)| match self.group_of(body) {
            Some((group, place)) => {
                let group = &self.coupled[group];
                let on = |other: usize| {
                    let mut sum = [0.0; 6];
                    for (_, impulse) in impulses.iter().filter(|(on, _)| *on as usize == other) {
                        sum.iter_mut().zip(impulse).for_each(|(sum, f)| *sum += f);
                    }
                    sum
                };
                group.velocity(place, &group.gather(on))
            }
            None => match self.inverse_mass().get(body as usize) {
                Some(mass) => {
                    let turn =
                        |row: usize| (0..3).map(|k| mass.angular[3 * row + k] * own[3 + k]).sum::<f64>();
                    let push = |k: usize| mass.linear[k] * own[k];
                    [push(0), push(1), push(2), turn(0), turn(1), turn(2)]
                }
                None => [0.0; 6],
            },
        })
    }

    /// Group and place in it of a body.
    pub(super) fn group_of(&self, body: u32) -> Option<(usize, usize)> {
        let (group, place) = *self.group_of.get(body as usize)?;
        (group != u32::MAX).then_some((group as usize, place as usize))
    }

    /// The bodies that impulses on `body` move: itself, or its group.
    pub(super) fn moved_with(&self, body: u32) -> &[u32] {
        match self.group_of(body) {
            Some((group, _)) => &self.coupled[group].bodies,
            None => &[],
        }
    }

    /// Sets the velocity changes (six per body) of coupled bodies, from world impulses.
    pub(super) fn change_coupled(&self, world_impulse: &[f64], dv: &mut [f64]) {
        for group in &self.coupled {
            let a = group.gather(|body| self.body_impulse(world_impulse, body));
            for (place, &body) in group.bodies.iter().enumerate() {
                dv[6 * body as usize..6 * body as usize + 6].copy_from_slice(&group.velocity(place, &a));
            }
        }
    }

    /// The mechanisms that a block row pushes, of its body A and of its body B where that is another one.
    fn groups_of(&self, block: usize) -> [Option<usize>; 2] {
        let contact = self.contact_of(block);
        let [of_a, of_b] = [contact.body_a, contact.body_b].map(|body| self.group_of(body).map(|own| own.0));
        [of_a, of_b.filter(|_| of_a != of_b)]
    }

    fn contact_of(&self, block: usize) -> &RigidContact {
        let turning = block.checked_sub(self.num_contacts());
        &self.contacts[turning.map_or(block, |k| self.turning[k].contact as usize)]
    }

    /// Rows of a block of D^T Y of one group, one after the other.
    fn rows_in(&self, group: usize, block: usize) -> Vec<f64> {
        let of = &self.coupled[group];
        let mut rows = vec![0.0; 3 * of.degrees];
        let contact = self.contact_of(block);
        let turning = block.checked_sub(self.num_contacts()).map(|k| self.turning_frame(k));
        for (body, sign, arm) in [(contact.body_a, 1.0, contact.arm_a), (contact.body_b, -1.0, contact.arm_b)]
        {
            let Some((_, place)) = self.group_of(body).filter(|(own, _)| *own == group) else { continue };
            for (k, row) in rows.chunks_exact_mut(of.degrees.max(1)).enumerate() {
                let [force, moment] = match &turning {
                    None => [contact.frame[k], cross(arm, contact.frame[k])],
                    Some(frame) => [[0.0; 3], frame[k]],
                };
                for (axis, f) in force.into_iter().chain(moment).enumerate() {
                    row.iter_mut().zip(of.row(place, axis)).for_each(|(sum, y)| *sum += sign * f * y);
                }
            }
        }
        rows
    }

    /// The rows of a block of D^T Y.
    pub(super) fn coupled_rows(&self, block: usize) -> CoupledRows {
        if self.coupled.is_empty() {
            return CoupledRows::default();
        }
        CoupledRows(self.groups_of(block).map(|group| Some((group?, self.rows_in(group?, block)))))
    }
}

/// Rows of a block of D^T Y: of the groups of both of its bodies, or of the one that has both.
#[derive(Clone, Debug, Default)]
pub(super) struct CoupledRows([Option<(usize, Vec<f64>)>; 2]);

impl CoupledRows {
    /// What coupled bodies add to the block of N in these rows and those columns.
    pub(super) fn times(&self, columns: &Self) -> Block {
        let mut block = [0.0; 9];
        for (group, own) in self.0.iter().flatten() {
            for (_, other) in columns.0.iter().flatten().filter(|(of, _)| of == group) {
                let degrees = own.len() / 3;
                for (k, entry) in block.iter_mut().enumerate() {
                    let [row, column] = [&own[k / 3 * degrees..], &other[k % 3 * degrees..]];
                    *entry += row[..degrees].iter().zip(column).map(|(a, b)| a * b).sum::<f64>();
                }
            }
        }
        block
    }
}
