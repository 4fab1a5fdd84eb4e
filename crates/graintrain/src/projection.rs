//! Normal displacements by projected Gauss-Seidel: what removes overlap asks for few digits and often.
//!
//! ```text
//! find lambda_i >= 0 perpendicular to room_i + D_i,n^T q + a N_ii lambda_i >= 0,     q = M^-1 D_n lambda
//! ```
//!
//! contact after contact, there and back in turn,
//!
//! ```text
//! lambda_i <- max(0, lambda_i - (room_i + D_i,n^T q + a N_ii lambda_i) / ((1 + a) N_ii))
//! ```
//!
//! The softness a > 0 leaves a solution where bodies are jammed: without, a sweep after the other would throw
//! them to and fro. One scalar per contact, no matrix and no preparation. Contacts that stay open are
//! passed over in most sweeps, and looked at before it ends. Cost of a sweep: linear in the contacts. Threads
//! share a sweep over many contacts slab by slab ([`division`]), in an order that does not depend on their
//! number.
//!
//! Source: J. J. Moreau, "Unilateral contact and dry friction in finite freedom dynamics", 1988; for
//! positions M. Müller, B. Heidelberger, M. Hennix, J. Ratcliff, "Position based dynamics", J. Visual
//! Communication and Image Representation 18:109-118, 2007.

mod division;

use self::division::{Division, split};
use crate::math::{Mat3, Vec3};
use graintrain_ccp::{BodyInverseMass, FIXED, RigidContact};
use rayon::prelude::*;

/// What a contact does to the bodies that can turn through it.
#[derive(Clone, Copy)]
struct Lever {
    /// r x n of both sides, m; of B with its sign. Zero where the normal goes through the centre of mass.
    spin: [Vec3; 2],
    /// J^-1 times that, 1/(kg m).
    response: [Vec3; 2],
}

/// A contact as the sweeps see it.
#[derive(Clone, Copy)]
struct Row {
    normal: Vec3,
    /// Places of A and B among the bodies of the region; the last place of a slab stands for what does not
    /// move.
    bodies: [u32; 2],
    /// Place in the list of levers; `NONE` where the contact turns nothing, as on spheres.
    lever: u32,
    /// Sweeps that this row is passed over.
    rests: u32,
    /// How far it may close, m.
    room: f64,
    /// 1 / (D_n^T M^-1 D_n), kg; zero where nothing moves.
    mass: f64,
    multiplier: f64,
}

/// No lever.
const NONE: u32 = u32::MAX;

/// Arms shorter than this fraction of their length across the normal turn nothing.
const THROUGH_CENTRE: f64 = 1e-12;

/// Bodies that are held in some directions do not open contacts that open by less than a hundredth of the way
/// that they go: the normal of a flank may lean out of its plane by rounding alone, and a wheel that is free
/// to go up and down would be sent a million metres up.
const REACH: f64 = 100.0;

/// A contact that a sweep finds far open is passed over in so many.
const REST: u32 = 7;

/// Far open is more than so many times the tolerance: more than corrections move bodies.
const FAR: f64 = 10.0;

/// Displacement of a body and what a force moves it by.
#[derive(Clone, Copy)]
struct Body {
    way: Vec3,
    /// Diagonal of the inverse mass, 1/kg.
    inverse: Vec3,
    turn: Vec3,
}

/// All that the sweeps work on: rows and bodies in the order of a [`Division`].
struct Projection {
    division: Division,
    rows: Vec<Row>,
    levers: Vec<Lever>,
    bodies: Vec<Body>,
    /// What is further open than this may rest, m.
    far: f64,
    /// a.
    softness: f64,
}

/// One relaxation of a row; the change of what the contact has been opened by, m.
#[inline]
fn relax(row: &mut Row, bodies: &mut [Body], levers: &[Lever], [far, softness]: [f64; 2]) -> f64 {
    let [a, b] = row.bodies.map(|body| body as usize);
    let mut closing = row.room + row.normal.dot(bodies[a].way - bodies[b].way);
    let lever = levers.get(row.lever as usize);
    if let Some(lever) = lever {
        closing += lever.spin[0].dot(bodies[a].turn) + lever.spin[1].dot(bodies[b].turn);
    }
    let multiplier = ((row.multiplier - closing * row.mass) / (1.0 + softness)).max(0.0);
    let change = multiplier - row.multiplier;
    if change == 0.0 {
        // It is open, and was before.
        row.rests = if closing > far { REST } else { 0 };
        return 0.0;
    }
    row.multiplier = multiplier;
    let push = change * row.normal;
    let on_a = &mut bodies[a];
    on_a.way += on_a.inverse * push;
    let on_b = &mut bodies[b];
    on_b.way -= on_b.inverse * push;
    if let Some(lever) = lever {
        bodies[a].turn += change * lever.response[0];
        bodies[b].turn += change * lever.response[1];
    }
    (change / row.mass).abs()
}

impl Projection {
    fn new(
        contacts: &[(&RigidContact, f64)],
        inverse_mass: &[BodyInverseMass],
        displacement: &[f64],
        [far, softness]: [f64; 2],
    ) -> Self {
        let pairs: Vec<[u32; 2]> = contacts.iter().map(|(row, _)| [row.body_a, row.body_b]).collect();
        let division = Division::new(&pairs, inverse_mass.len());
        let body = |&body: &u32| match inverse_mass.get(body as usize) {
            None => Body { way: Vec3::ZERO, inverse: Vec3::ZERO, turn: Vec3::ZERO },
            Some(inverse) => {
                let q = &displacement[6 * body as usize..6 * body as usize + 6];
                let [way, turn] = [Vec3::from_slice(&q[..3]), Vec3::from_slice(&q[3..])];
                Body { way, inverse: Vec3::from_array(inverse.linear), turn }
            }
        };
        let bodies = division.bodies.iter().map(body).collect();
        let mut all = Self {
            rows: Vec::with_capacity(contacts.len()),
            levers: Vec::new(),
            bodies,
            far,
            softness,
            division,
        };
        for &(k, places) in &all.division.rows {
            let (contact, room) = contacts[k as usize];
            let normal = Vec3::from_array(contact.frame[0]);
            let (mut lever, mut mobility) = (Lever { spin: [Vec3::ZERO; 2], response: [Vec3::ZERO; 2] }, 0.0);
            // With all that is free to a body along the normal.
            let mut largest = 0.0;
            let sides = [(contact.body_a, 1.0, contact.arm_a), (contact.body_b, -1.0, contact.arm_b)];
            for (side, (body, sign, arm)) in sides.into_iter().enumerate().filter(|(_, side)| side.0 != FIXED)
            {
                let (inverse, arm) = (&inverse_mass[body as usize], Vec3::from_array(arm));
                mobility += normal.dot(Vec3::from_array(inverse.linear) * normal);
                let moves = Vec3::from_array(inverse.linear).max_element();
                let turns = inverse.angular.into_iter().step_by(4).fold(0.0, f64::max) * arm.length_squared();
                largest += if moves > 0.0 { moves } else { turns };
                let spin = arm.cross(normal);
                if spin.length_squared() > THROUGH_CENTRE * THROUGH_CENTRE * arm.length_squared() {
                    // The inverse inertia is symmetric: rows are columns.
                    let response = Mat3::from_cols_array(&inverse.angular) * spin;
                    mobility += spin.dot(response);
                    (lever.spin[side], lever.response[side]) = (sign * spin, sign * response);
                }
            }
            let turns_something = lever.spin != [Vec3::ZERO; 2];
            let place = if turns_something { all.levers.len() as u32 } else { NONE };
            all.levers.extend(turns_something.then_some(lever));
            let mass = if mobility * REACH * REACH > largest { 1.0 / mobility } else { 0.0 };
            let (bodies, lever) = (places, place);
            all.rows.push(Row { normal, bodies, lever, rests: 0, room, mass, multiplier: 0.0 });
        }
        all
    }

    /// One sweep, there or back, over the rows that do not rest, or over all of them; the largest change, m.
    fn sweep(&mut self, back: bool, all: bool) -> f64 {
        let Self { division, rows, levers, bodies, far, softness } = self;
        let of_region = |(rows, bodies): (&mut [Row], &mut [Body])| {
            let mut largest = 0.0_f64;
            let count = rows.len();
            for k in 0..count {
                let row = &mut rows[if back { count - 1 - k } else { k }];
                if row.rests > 0 && !all {
                    row.rests -= 1;
                } else {
                    largest = largest.max(relax(row, bodies, levers, [*far, *softness]));
                }
            }
            largest
        };
        let mut largest = 0.0_f64;
        let phases = division.phases.len();
        for k in 0..phases {
            let phase = &division.phases[if back { phases - 1 - k } else { k }];
            let regions = split(phase, rows, bodies);
            largest = largest.max(regions.into_par_iter().map(of_region).reduce(|| 0.0, f64::max));
        }
        largest
    }
}

/// Adds the displacements that open these contacts to `displacement` (translation in m and turn in rad of
/// every body). Ends after the sweep in which no contact changed by more than `tolerance` (m), all of them
/// looked at, or after `sweeps`; with this softness.
pub(crate) fn project(
    contacts: &[(&RigidContact, f64)],
    inverse_mass: &[BodyInverseMass],
    displacement: &mut [f64],
    (tolerance, sweeps): (f64, usize),
    softness: f64,
) {
    let mut projection = Projection::new(contacts, inverse_mass, displacement, [FAR * tolerance, softness]);
    let mut all = true;
    for sweep in 0..sweeps {
        let largest = projection.sweep(!sweep.is_multiple_of(2), all);
        if largest <= tolerance && all {
            break;
        }
        // The last two look at all, too, one each way.
        all = largest <= tolerance || sweep + 3 >= sweeps;
    }
    let found = projection.bodies.iter().zip(&projection.division.bodies);
    for (body, &index) in found.filter(|(_, index)| **index != FIXED) {
        let q = &mut displacement[6 * index as usize..6 * index as usize + 6];
        q[..3].copy_from_slice(&body.way.to_array());
        q[3..].copy_from_slice(&body.turn.to_array());
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
            let opened: Vec<_> = rows.iter().zip(room.iter().copied()).collect();
            project(&opened, &masses, &mut found, (1e-13, 100_000), 0.0);
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

    /// A bed of so many layers of balls, a little compressed, on a floor.
    fn bed(edge: u32, layers: u32) -> (Vec<RigidContact>, Vec<BodyInverseMass>, Vec<f64>) {
        let body = |x: u32, y: u32, z: u32| (z * edge + y) * edge + x;
        let frames = [[0, 1, 2], [1, 2, 0], [2, 0, 1]]
            .map(|axes| axes.map(|k| std::array::from_fn(|l| f64::from(u8::from(k == l)))));
        let mut rows = Vec::new();
        for (x, y, z) in (0..edge.pow(2) * layers).map(|k| (k % edge, k / edge % edge, k / edge / edge)) {
            let neighbours = [(x, x > 0, 1), (y, y > 0, edge), (z, true, edge * edge)];
            for (axis, (_, _, stride)) in neighbours.into_iter().enumerate().filter(|(_, n)| n.1) {
                let body_a = body(x, y, z);
                let body_b = body_a.checked_sub(stride).unwrap_or(FIXED);
                let frame = frames[axis];
                let arm = frame[0];
                rows.push(RigidContact { body_a, body_b, frame, arm_a: arm.map(|x| -x), arm_b: arm });
            }
        }
        let mass = |k: u32| BodyInverseMass { linear: [1.0 + f64::from(k % 3); 3], angular: [0.0; 9] };
        let masses = (0..edge.pow(2) * layers).map(mass).collect();
        let room = (0..rows.len()).map(|k| 1e-3 * (k as f64).sin()).collect();
        (rows, masses, room)
    }

    /// Slabs are swept in another order than one after the other, to the same displacements; and with any
    /// number of threads to the same bits.
    #[test]
    fn many_contacts_are_opened_alike_by_any_number_of_threads() {
        let (rows, masses, room) = bed(12, 16);
        let contacts: Vec<_> = rows.iter().zip(room.iter().copied()).collect();
        let none = vec![0.0; 6 * masses.len()];
        let slabs = Projection::new(&contacts, &masses, &none, [0.0; 2]).division.phases[0].len();
        assert!(slabs > 2, "{slabs}");
        let of = |threads: usize, sweeps: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut found = none.clone();
                project(&contacts, &masses, &mut found, (1e-11, sweeps), 0.0);
                found
            })
        };
        let few = of(1, 50);
        assert!(few == of(2, 50) && few == of(3, 50));
        let found = of(2, 100_000);
        let mut opened = 0;
        for (row, room) in rows.iter().zip(&room) {
            let way = |body: u32, k: usize| if body == FIXED { 0.0 } else { found[6 * body as usize + k] };
            let along: f64 =
                (0..3).map(|k| row.frame[0][k] * (way(row.body_a, k) - way(row.body_b, k))).sum();
            assert!(room + along > -1e-9, "{room} {along}");
            opened += usize::from(along > 1e-6);
        }
        assert!(opened > rows.len() / 4);
        // Complementarity: least energy, so that those of another order of the rows are the same.
        let back: Vec<_> = contacts.iter().rev().copied().collect();
        let mut other = vec![0.0; found.len()];
        project(&back, &masses, &mut other, (1e-11, 100_000), 0.0);
        assert!(found.iter().zip(&other).all(|(a, b)| (a - b).abs() < 1e-7));
    }

    /// A body that only z is free to, beside a wall whose normal leans by less than a hundredth, and one that
    /// turns about an axis that the normal nearly goes through: to open the contact, they would have to go
    /// far.
    #[test]
    fn a_contact_along_which_nearly_nothing_can_move_moves_nothing() {
        let upright = BodyInverseMass { linear: [0.0, 0.0, 1.0], angular: [0.0; 9] };
        let hinged =
            BodyInverseMass { linear: [0.0; 3], angular: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };
        for (lean, moves) in [(1e-9_f64, false), (5e-3, false), (2e-2, true)] {
            let (sine, cosine) = lean.sin_cos();
            let frame = [[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]];
            for (mass, arm) in [(upright, [0.0; 3]), (hinged, [-0.5, 0.0, 0.0])] {
                let row = RigidContact { body_a: 0, body_b: FIXED, frame, arm_a: arm, arm_b: [0.0; 3] };
                let mut found = vec![0.0; 6];
                project(&[(&row, -1e-3)], &[mass], &mut found, (1e-6, 40), 0.0);
                assert_eq!(found.iter().any(|&q| q != 0.0), moves, "{lean} {found:?}");
                assert!(found.iter().all(|q| q.abs() < 0.11), "{found:?}");
            }
        }
    }

    /// A ball between two walls that are too near to each other: without softness it would be pushed to and
    /// fro for ever, ever harder. With it, and however many sweeps, it stands in the middle: of what overlaps
    /// by 1 and 3 mm 2 mm remain on either side.
    #[test]
    fn what_is_jammed_stands_in_the_middle() {
        let mass = BodyInverseMass { linear: [2.0; 3], angular: [0.0; 9] };
        let wall = |normal: f64| RigidContact {
            body_a: 0,
            body_b: FIXED,
            frame: [[normal, 0.0, 0.0], [0.0, normal, 0.0], [0.0, 0.0, 1.0]],
            arm_a: [-normal, 0.0, 0.0],
            arm_b: [normal, 0.0, 0.0],
        };
        let (left, right) = (wall(1.0), wall(-1.0));
        let of = |sweeps: usize, softness: f64| {
            let mut found = vec![0.0; 6];
            project(&[(&left, -1e-3), (&right, -3e-3)], &[mass], &mut found, (1e-12, sweeps), softness);
            found[0]
        };
        let hard = [of(40, 0.0), of(41, 0.0)];
        assert!((hard[0] - hard[1]).abs() > 3e-3, "{hard:?}");
        for softness in [0.02, 0.2] {
            // (room + x) / a = (room' - x) / a: x = -1 mm of 2 / (2 + a).
            let middle = -2e-3 / (2.0 + softness);
            assert!((of(10_000, softness) - middle).abs() < 1e-9, "{}", of(10_000, softness));
        }
    }

    #[test]
    fn contacts_with_room_move_nothing() {
        let (rows, masses, room) = random(10, 4);
        let mut found = vec![0.0; 6 * masses.len()];
        let open = room.iter().map(|room| room.abs());
        project(&rows.iter().zip(open).collect::<Vec<_>>(), &masses, &mut found, (1e-13, 10), 0.0);
        assert!(found.iter().all(|&q| q == 0.0));
    }
}
