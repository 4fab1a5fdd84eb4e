//! Bodies that joints hold together: their inverse mass is not block diagonal.

use super::{FIXED, RigidDelassus, cross};
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
    /// their own. Solvers that work in the space of bodies one by one cannot take it; N as a matrix
    /// ([`Self::assemble`]) can be given to all.
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

    /// Sides of a block row: body, and for every row the impulse on it and its moment.
    fn ends(&self, block: usize) -> [(u32, [[f64; 6]; 3]); 2] {
        let turning = block.checked_sub(self.num_contacts());
        let contact = turning.map_or(block, |k| self.turning[k].contact as usize);
        let contact = &self.contacts[contact];
        [(contact.body_a, 1.0, contact.arm_a), (contact.body_b, -1.0, contact.arm_b)].map(
            |(body, sign, arm)| {
                let rows: [[f64; 6]; 3] = match turning {
                    None => contact.frame.map(|axis| {
                        let moment = cross(arm, axis);
                        [axis[0], axis[1], axis[2], moment[0], moment[1], moment[2]]
                    }),
                    Some(k) => self.turning_frame(k).map(|m| [0.0, 0.0, 0.0, m[0], m[1], m[2]]),
                };
                (body, rows.map(|row| row.map(|x| sign * x)))
            },
        )
    }

    /// What coupled bodies add to block (i, j) of N.
    pub(super) fn block_of_coupled(&self, i: usize, j: usize) -> Block {
        let mut block = [0.0; 9];
        if self.coupled.is_empty() {
            return block;
        }
        for (body_j, rows_j) in self.ends(j) {
            let Some((group, place_j)) = self.group_of(body_j).filter(|_| body_j != FIXED) else { continue };
            let group_j = &self.coupled[group];
            for (column, impulse) in rows_j.iter().enumerate() {
                let mut a = vec![0.0; group_j.degrees];
                for (axis, f) in impulse.iter().enumerate() {
                    a.iter_mut().zip(group_j.row(place_j, axis)).for_each(|(a, y)| *a += f * y);
                }
                for (body_i, rows_i) in self.ends(i) {
                    let Some((_, place_i)) = self.group_of(body_i).filter(|(own, _)| *own == group) else {
                        continue;
                    };
                    let velocity = group_j.velocity(place_i, &a);
                    for (row, along) in rows_i.iter().enumerate() {
                        block[3 * row + column] +=
                            along.iter().zip(velocity).map(|(along, v)| along * v).sum::<f64>();
                    }
                }
            }
        }
        block
    }
}
