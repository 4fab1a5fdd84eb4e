//! Joints that are open are closed by displacements, not by velocities.
//!
//! ```text
//! min 1/2 dq^T M dq   subject to   Phi(q + dq) = 0
//! ```
//!
//! by Newton's method; for stops that were run over likewise. A mechanism that is nearly stretched out would
//! be thrown to the other side: M is what the forces that close it stiffen bodies to ([`super::stiffening`]),
//! and of what opens joints further half is taken back.
//! The displacement leaves no velocity, so that no energy comes of it but what bodies gain against gravity,
//! which is reported ([`crate::step_report::StepReport::correction_energy`]). Bodies that overlap were moved
//! before, along the joints to first order: the rest is what opens joints by more than rounding.

use super::elimination::Elimination;
use super::kinematics::{Near, Placed, Row, coordinate, held};
use super::rows::{Root, connected, length_of, made_unit, row_over};
use super::stiffening::stiffness;
use super::{JointKind, JointState};
use crate::integrate::{displace, inverse_mass};
use crate::math::{Mat3, Vec3};
use crate::world::World;
use graintrain_ccp::BodyInverseMass;

/// Corrections of one step, of which mostly one or two are made.
const ITERATIONS: usize = 60;

/// How often bodies are made stiffer within a correction: forces that close a stretched chain make its links
/// so stiff that others are needed, up to those that move the load.
const STIFFENINGS: usize = 5;

/// Forces that differ by less than this share of the largest stiffen alike.
const SAME_FORCES: f64 = 0.1;

/// A body is moved by no more than so many times the largest opening of its mechanism: near a dead point,
/// where little opening asks for boundless motion, the rest is left to later steps.
const REACH: f64 = 100.0;

/// Openings over the joint's length that are left alone.
const CLOSED: f64 = 1e-13;

/// What a row of a joint may be off by and count as closed: rounding, and [`CLOSED`].
pub(super) fn allowed(world: &World, joint: usize, angular: bool) -> f64 {
    let place = world.joints[joint].joint.bodies.iter().flatten();
    let far = place.map(|body| world.bodies.position[body.index()].length()).fold(0.0, f64::max);
    let mut turns = world.joints[joint].state.coordinate.abs();
    if let JointKind::Gear { joints, ratio } = world.joints[joint].joint.kind {
        let [first, second] = joints.map(|other| world.joints[other.index()].state.coordinate.abs());
        turns += ratio.abs() * first + second;
    }
    let (places, length) = if angular { (1.0, 1.0) } else { (far, length_of(world, joint)) };
    16.0 * f64::EPSILON * (places + turns) + CLOSED * length
}

/// The rows of a joint that are open by more than rounding, or run over; all of those that it holds if one of
/// them is.
fn open_rows(world: &World, joint: usize, near: &Near) -> (Vec<Row>, bool) {
    let poses = |body: usize| world.pose(body);
    let mut rows = held(&world.joints, joint, &poses, near);
    let allowed = |row: &Row| allowed(world, joint, row.angular);
    let mut open = rows.iter().any(|row| row.value.abs() > allowed(row));
    if let Some(limits) = world.joints[joint].joint.limits
        && let Some(along) = coordinate(&world.joints, joint, &poses, near)
    {
        let over = |at: f64| Row { value: along.value - at, ..along.clone() };
        let below = limits.lower.map(over).filter(|row| row.value < -allowed(row));
        let above = limits.upper.map(over).filter(|row| row.value > allowed(row));
        open |= below.is_some() || above.is_some();
        rows.extend(below.into_iter().chain(above));
    }
    (rows, open)
}

/// How far a joint is open, m ([`JointState::opening`]).
pub(super) fn opening(world: &World, joint: usize, near: &Near) -> f64 {
    let length = length_of(world, joint);
    let (rows, _) = open_rows(world, joint, near);
    rows.iter().map(|row| row.value.abs() * if row.angular { length } else { 1.0 }).fold(0.0, f64::max)
}

/// A joint that is open by more than this share of its length does not hold.
const OPEN: f64 = 1e-3;

/// How far a motor without a limit is from the coordinate to which it turned its joint in the step, m: over a
/// dead point joints can only be closed against it. A tenth of its way, and what counts as closed, is none:
/// overlap is removed along joints that motors turn.
pub(super) fn strayed(world: &World, joint: usize, along: &Row, [before, expected]: [f64; 2]) -> f64 {
    if !world.joints[joint].joint.is_driven() {
        return 0.0;
    }
    let length = length_of(world, joint);
    let unit = if along.angular { length } else { 1.0 };
    let [way, off] = [before, along.value].map(|from| unit * (expected - from).abs());
    if off > (0.1 * way).max(OPEN * length) { off } else { 0.0 }
}

/// How far joints between bodies that can move are open at the most, m, and the joint that does not hold, if
/// there is one: that with the largest opening over its length.
pub(crate) fn openings(world: &World) -> (f64, Option<usize>) {
    let (mut most, mut worst) = (0.0_f64, (OPEN, None));
    for joint in connected(world).into_iter().flat_map(|(_, joints)| joints) {
        let opening = world.joints[joint].state.opening;
        most = most.max(opening);
        let share = opening / length_of(world, joint);
        if share > worst.0 {
            worst = (share, Some(joint));
        }
    }
    (most, worst.1)
}

/// The displacement of a mechanism, as its roots weigh it, that closes these rows of its joints to first
/// order, and the forces of the joints on B that made it, kg m. Taut rods are held across by their kappa.
fn closing(
    world: &World,
    (bodies, roots): (&[u32], &[Root]),
    (joints, rows): (&[usize], &[(usize, Row)]),
    taut: &[(usize, f64)],
) -> (Vec<f64>, Vec<Vec3>) {
    let length = 6 * bodies.len() + 2 * taut.len();
    let placed = |joint: usize| Placed::of(&world.joints[joint], &|body| world.pose(body));
    let (mut units, mut right, mut norms) = (Vec::new(), Vec::new(), Vec::new());
    for (_, row) in rows {
        let mut unit = row_over(row, bodies, roots);
        norms.push(made_unit(&mut unit));
        right.push(-row.value / norms[norms.len() - 1]);
        units.push(unit);
    }
    let across = taut.iter().flat_map(|&(joint, kappa)| placed(joint).across().1.map(|row| (row, kappa)));
    for (place, (row, kappa)) in (6 * bodies.len()..).zip(across) {
        let mut unit = row_over(&row, bodies, roots);
        unit.push((place, (1.0 / kappa).sqrt()));
        made_unit(&mut unit);
        right.push(0.0);
        units.push(unit);
    }
    let mut z = vec![0.0; length];
    let elimination = Elimination::new(bodies.len(), length, &units);
    elimination.project(&mut z, &right);
    let mut forces = vec![Vec3::ZERO; joints.len()];
    for (((joint, row), norm), multiplier) in rows.iter().zip(norms).zip(elimination.multipliers(&z)) {
        if !matches!(world.joints[*joint].joint.kind, JointKind::Gear { .. })
            && let Ok(k) = joints.binary_search(joint)
        {
            forces[k] += multiplier / norm * placed(*joint).wrench(row)[0];
        }
    }
    (z, forces)
}

/// The displacement that last closed the joints of a mechanism to first order.
#[derive(Clone)]
struct Closing {
    /// Six numbers per body; what is left of them where halves were taken back.
    moved: Vec<f64>,
    /// How open the joints were before: the sum of the squares of their rows, m^2.
    open: f64,
    /// How many rows these were: stops that are run over add some.
    rows: usize,
    /// How often half was taken back.
    halved: usize,
}

/// After so many halves what opens joints is rounding.
const HALVES: usize = 8;

/// Closes the joints of a world after a step in which they did this; returned is the displacement
/// (translation in m and turn in rad, six numbers per body), if there was one.
pub(crate) fn close(world: &mut World, states: &[JointState], step: f64) -> Option<Vec<f64>> {
    let mut total: Option<Vec<f64>> = None;
    let mut known: Vec<Option<Closing>> = Vec::new();
    for _ in 0..ITERATIONS {
        let mut displacement = None;
        let near = world.expected_coordinates(states, step);
        let mechanisms = connected(world);
        known.resize(mechanisms.len(), None);
        let masses = if mechanisms.is_empty() { Vec::new() } else { inverse_mass(world) };
        for ((bodies, joints), known) in mechanisms.iter().zip(&mut known) {
            let Some(moved) = closer(world, (bodies, joints), &masses, &near, known) else { continue };
            let all = displacement.get_or_insert_with(|| vec![0.0; 6 * world.bodies.len()]);
            for (&body, own) in bodies.iter().zip(moved.chunks_exact(6)) {
                all[6 * body as usize..6 * body as usize + 6].copy_from_slice(own);
            }
        }
        let Some(displacement) = displacement.filter(|all| all.iter().all(|x| x.is_finite())) else { break };
        displace(world, &displacement);
        match &mut total {
            Some(total) => total.iter_mut().zip(&displacement).for_each(|(total, more)| *total += more),
            None => total = Some(displacement),
        }
    }
    total
}

/// The displacement of the bodies of a mechanism, six numbers each, that closes its joints to first order;
/// half of the last one back where that opened them further. `None` where they are closed.
fn closer(
    world: &World,
    (bodies, joints): (&[u32], &[usize]),
    masses: &[BodyInverseMass],
    near: &Near,
    known: &mut Option<Closing>,
) -> Option<Vec<f64>> {
    let found: Vec<(Vec<Row>, bool)> = joints.iter().map(|&joint| open_rows(world, joint, near)).collect();
    if !found.iter().any(|(_, open)| *open) {
        return None;
    }
    let held = joints.iter().zip(found);
    let rows: Vec<(usize, Row)> =
        held.flat_map(|(&joint, (rows, _))| rows.into_iter().map(move |row| (joint, row))).collect();
    let length = joints.iter().map(|&joint| length_of(world, joint)).fold(0.0, f64::max);
    let in_metres = |row: &Row| row.value.abs() * if row.angular { length } else { 1.0 };
    let open: f64 = rows.iter().map(|(_, row)| in_metres(row).powi(2)).sum();
    if let Some(last) = known
        && last.rows == rows.len()
        && last.halved < HALVES
        && (open.is_nan() || open > last.open)
    {
        last.moved.iter_mut().for_each(|x| *x *= 0.5);
        last.halved += 1;
        return Some(last.moved.iter().map(|x| -x).collect());
    }
    let bare: Vec<Root> = bodies.iter().map(|&body| Root::of(&masses[body as usize])).collect();
    let mut roots = bare.clone();
    let (mut z, mut forces) = closing(world, (bodies, &roots), (joints, &rows), &[]);
    for _ in 0..STIFFENINGS {
        let (swings, taut) = stiffness(world, (bodies, &bare), (joints, &forces), 1.0);
        if taut.is_empty() && swings.iter().all(|swing| *swing == Mat3::ZERO) {
            break;
        }
        roots = bare.iter().zip(swings).map(|(bare, swing)| bare.with(swing)).collect();
        let softer = forces;
        (z, forces) = closing(world, (bodies, &roots), (joints, &rows), &taut);
        let largest = forces.iter().map(|force| force.length()).fold(0.0, f64::max);
        let same = |(a, b): (&Vec3, &Vec3)| (*a - *b).length() <= SAME_FORCES * largest;
        if forces.iter().zip(&softer).all(same) {
            break;
        }
    }
    let moved = roots.iter().enumerate().map(|(k, root)| root.times(&z[6 * k..]));
    let mut moved: Vec<f64> = moved.flat_map(|[u, w]| [u.x, u.y, u.z, w.x, w.y, w.z]).collect();
    let parts = moved.chunks_exact(6).map(|q| [Vec3::from_slice(&q[..3]), Vec3::from_slice(&q[3..])]);
    let farthest = parts.map(|[u, w]| u.length().max(length * w.length())).fold(0.0, f64::max);
    let opening = rows.iter().map(|(_, row)| in_metres(row)).fold(0.0, f64::max);
    if farthest > REACH * opening {
        moved.iter_mut().for_each(|x| *x *= REACH * opening / farthest);
    }
    *known = Some(Closing { moved: moved.clone(), open, rows: rows.len(), halved: 0 });
    Some(moved)
}
