//! Normal displacements by projected Gauss-Seidel: what removes overlap asks for few digits and often.
//!
//! ```text
//! find lambda_i >= 0 perpendicular to room_i + D_i,n^T q >= 0,     q = M^-1 D_n lambda
//! ```
//!
//! contact after contact, `lambda_i <- max(0, lambda_i - (room_i + D_i,n^T q) / N_ii)`, there and back in turn. One scalar per contact, no
//! matrix and no preparation. Cost of a sweep: linear in the contacts.
//!
//! Source: J. J. Moreau, "Unilateral contact and dry friction in finite freedom dynamics", 1988; for positions M. Müller, B. Heidelberger,
//! M. Hennix, J. Ratcliff, "Position based dynamics", J. Visual Communication and Image Representation 18:109-118, 2007.

use crate::math::{Mat3, Vec3};
use graintrain_ccp::{BodyInverseMass, FIXED, RigidContact};

/// The side of a contact on one body.
#[derive(Clone, Copy)]
struct Side {
    body: usize,
    /// +1 on A, -1 on B.
    sign: f64,
    /// r x n, m; `None` where the normal goes through the centre of mass, as it does on spheres.
    spin: Option<Vec3>,
}

/// A contact as the sweeps see it.
struct Row {
    normal: Vec3,
    sides: [Option<Side>; 2],
    /// How far it may close, m.
    room: f64,
    /// D_n^T M^-1 D_n, 1/kg.
    diagonal: f64,
    multiplier: f64,
}

/// Arms shorter than this fraction of their length across the normal turn nothing.
const THROUGH_CENTRE: f64 = 1e-12;

/// What a unit of this force and moment moves a body by: M^-1 (f, m).
fn response(inverse: &BodyInverseMass, force: Vec3, moment: Option<Vec3>) -> (Vec3, Option<Vec3>) {
    // The inverse inertia is symmetric: rows are columns.
    let turn = moment.map(|moment| Mat3::from_cols_array(&inverse.angular) * moment);
    (Vec3::from_array(inverse.linear) * force, turn)
}

impl Row {
    fn new(contact: &RigidContact, room: f64, inverse_mass: &[BodyInverseMass]) -> Self {
        let normal = Vec3::from_array(contact.frame[0]);
        let side = |body: u32, sign: f64, arm: [f64; 3]| {
            let arm = Vec3::from_array(arm);
            let spin = arm.cross(normal);
            let turns = spin.length_squared() > THROUGH_CENTRE * THROUGH_CENTRE * arm.length_squared();
            (body != FIXED).then_some(Side { body: body as usize, sign, spin: turns.then_some(spin) })
        };
        let sides = [side(contact.body_a, 1.0, contact.arm_a), side(contact.body_b, -1.0, contact.arm_b)];
        let mobility = |side: &Side| {
            let (way, turn) = response(&inverse_mass[side.body], normal, side.spin);
            normal.dot(way) + side.spin.zip(turn).map_or(0.0, |(spin, turn)| spin.dot(turn))
        };
        let diagonal = sides.iter().flatten().map(mobility).sum();
        Self { normal, sides, room, diagonal, multiplier: 0.0 }
    }

    /// One relaxation; the change of what the contact has been opened by, m.
    fn relax(&mut self, inverse_mass: &[BodyInverseMass], displacement: &mut [f64]) -> f64 {
        if self.diagonal <= 0.0 {
            return 0.0;
        }
        let mut closing = self.room;
        for side in self.sides.iter().flatten() {
            let q = &displacement[6 * side.body..6 * side.body + 6];
            let turned = side.spin.map_or(0.0, |spin| spin.dot(Vec3::from_slice(&q[3..])));
            closing += side.sign * (self.normal.dot(Vec3::from_slice(&q[..3])) + turned);
        }
        let multiplier = (self.multiplier - closing / self.diagonal).max(0.0);
        let change = multiplier - self.multiplier;
        self.multiplier = multiplier;
        if change != 0.0 {
            for side in self.sides.iter().flatten() {
                let (way, turn) = response(&inverse_mass[side.body], self.normal, side.spin);
                let q = &mut displacement[6 * side.body..6 * side.body + 6];
                for axis in 0..3 {
                    q[axis] += side.sign * change * way[axis];
                    q[3 + axis] += side.sign * change * turn.map_or(0.0, |turn| turn[axis]);
                }
            }
        }
        change.abs() * self.diagonal
    }
}

/// Adds the displacements that open these contacts to `displacement` (translation in m and turn in rad of every body). Ends after the sweep
/// in which no contact changed by more than `tolerance` (m), or after `sweeps`.
pub(crate) fn project<'a>(
    contacts: impl Iterator<Item = (&'a RigidContact, f64)>,
    inverse_mass: &[BodyInverseMass],
    displacement: &mut [f64],
    (tolerance, sweeps): (f64, usize),
) {
    let mut rows: Vec<Row> = contacts.map(|(contact, room)| Row::new(contact, room, inverse_mass)).collect();
    for sweep in 0..sweeps {
        let mut largest = 0.0_f64;
        let mut relax = |row: &mut Row| largest = largest.max(row.relax(inverse_mass, displacement));
        if sweep.is_multiple_of(2) {
            rows.iter_mut().for_each(&mut relax);
        } else {
            rows.iter_mut().rev().for_each(&mut relax);
        }
        if largest <= tolerance {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain_ccp::{Ccp, Delassus, RigidDelassus, SolveSettings, SolverSpec};
    use rand::{RngExt, SeedableRng};

    /// Random bodies with random contacts, some of them with the world.
    fn random(contacts: usize, seed: u64) -> (Vec<RigidContact>, Vec<BodyInverseMass>, Vec<f64>) {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let bodies = contacts as u32 / 2 + 1;
        let mut vector =
            |scale: f64| -> [f64; 3] { std::array::from_fn(|_| scale * random.random_range(-1.0..1.0)) };
        let masses = (0..bodies).map(|body| {
            let light = 10.0_f64.powi(body as i32 % 3);
            let spin = vector(1.0);
            // Positive definite: 1 + a a^T.
            let entry = |k: usize| f64::from(u8::from(k.is_multiple_of(4))) + spin[k / 3] * spin[k % 3];
            BodyInverseMass { linear: [light; 3], angular: std::array::from_fn(|k| light * entry(k)) }
        });
        let masses = masses.collect();
        let rows = (0..contacts as u32).map(|i| {
            let [a, b] = [vector(1.0), vector(1.0)].map(Vec3::from_array);
            let c = vector(0.5);
            let unit = Vec3::normalize;
            let n = unit(a);
            let t1 = unit(n.cross(b));
            let body_b = if i % 5 == 0 { FIXED } else { (i / 2 + 1 + i % 3) % bodies };
            RigidContact {
                body_a: i / 2,
                body_b,
                frame: [n, t1, n.cross(t1)].map(|axis| axis.to_array()),
                arm_a: c,
                arm_b: vector(0.5),
            }
        });
        let rows: Vec<_> = rows.filter(|row| row.body_a != row.body_b).collect();
        let room = rows.iter().map(|_| vector(1e-3)[0]).collect();
        (rows, masses, room)
    }

    /// Against a contact solver on the same problem without friction.
    #[test]
    fn displacements_are_those_of_a_contact_solver() {
        for (contacts, seed) in [(1, 1), (7, 2), (40, 3)] {
            let (rows, masses, room) = random(contacts, seed);
            let mut found = vec![0.0; 6 * masses.len()];
            project(rows.iter().zip(room.iter().copied()), &masses, &mut found, (1e-13, 100_000));
            let rigid = RigidDelassus::new(rows.clone(), masses);
            let r = room.iter().flat_map(|&room| [room, 0.0, 0.0]).collect();
            let problem = Ccp::new(Delassus::Rigid(rigid), r, vec![0.0; rows.len()]).unwrap();
            let problem = Ccp { velocity_scale: Some(1e-3), ..problem };
            let mut multiplier = vec![0.0; 3 * rows.len()];
            let settings = SolveSettings { tolerance: 1e-9, ..SolveSettings::default() };
            let mut solver = SolverSpec::default().build().unwrap();
            assert!(solver.solve(&problem, &mut multiplier, &settings).unwrap().converged());
            let mut work = problem.delassus.work();
            problem.delassus.multiply(&multiplier, &mut vec![0.0; 3 * rows.len()], &mut work);
            for (found, expected) in found.iter().zip(work.body_velocity()) {
                assert!((found - expected).abs() < 1e-10, "{contacts}: {found} {expected}");
            }
        }
    }

    #[test]
    fn contacts_with_room_move_nothing() {
        let (rows, masses, room) = random(10, 4);
        let mut found = vec![0.0; 6 * masses.len()];
        let open = room.iter().map(|room| room.abs());
        project(rows.iter().zip(open), &masses, &mut found, (1e-13, 10));
        assert!(found.iter().all(|&q| q == 0.0));
    }
}
