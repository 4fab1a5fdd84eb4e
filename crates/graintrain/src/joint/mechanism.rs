//! Bodies that joints hold together, solved directly.
//!
//! Joints of a step are the bilateral rows of
//!
//! ```text
//! v+ = v* + M^-1 (D g + J^T lambda),      (Phi(q (+) dt v+) - Phi(q)) / dt = w
//! ```
//!
//! with the velocities v* of free bodies, contact impulses g, positions q moved by v+ as the step moves them
//! (q (+) dt v), and rates w that are zero but for motors and stops. The difference of positions rather than
//! `J v+ = w` keeps bodies on their path to second order, and in a conservative mechanism the energy (SHAKE);
//! it is reached by Newton's method on the right-hand side of `J v+ = w + beta`. Where a chain of light links
//! goes slack or taut within the step there may be no such path: forces along the rows of its start cannot
//! close it at its end. Then `J v+ = w`, which never adds energy. What is left open, or was before, is
//! removed by displacements ([`super::drift`]) and never by velocities.
//!
//! First-order methods need as many iterations as a chain has links, and more where light bodies carry heavy
//! ones. So the rows are eliminated (see [`super::elimination`]): contacts see the mechanism's common inverse
//! mass `W = M^-1 - M^-1 J^T (J M^-1 J^T)^-1 J M^-1` ([`graintrain_ccp::CoupledBodies`]), and any contact
//! solver solves contacts alone, with joints exact in every iterate.
//!
//! Motors with a limit and stops are one-sided: each is either a row or a known impulse, and changes from one
//! to the other until all agree with their impulses and rates (active sets); mostly they are what they were
//! in the last step. Springs and dampers are rows with a compliance, `ds/dt + C g = c_0`, each with a column
//! of its own.
//!
//! Source: J.-P. Ryckaert, G. Ciccotti, H. J. C. Berendsen, "Numerical integration of the Cartesian equations
//! of motion of a system with constraints", Journal of Computational Physics 23:327-341, 1977; B. Leimkuhler,
//! R. Skeel, "Symplectic numerical integrators in constrained Hamiltonian systems", Journal of Computational
//! Physics 112:117-125, 1994.

mod bounds;
mod reactions;
mod switching;
#[cfg(test)]
mod tests;
mod vibration;

pub(crate) use reactions::JointReactions;
use switching::CLEAR;
use vibration::spring_shares;

use super::elimination::Elimination;
use super::kinematics::{Placed, Row, coordinate, held, last};
use super::rows::{Root, connected, length_of, made_unit, row_over};
use super::stiffening::{Stiffening, stiffness};
use super::{JointKind, JointState, Motor};
use crate::integrate::{SLOWEST, inverse_mass, inverse_mass_in_step};
use crate::math::{Mat3, Quat, Vec3, rotation_exponential};
use crate::motion::Profile;
use crate::rotation::{Coasting, Rotor, Turn, world_inertia};
use crate::world::World;
use graintrain_ccp::{BodyInverseMass, CoupledBodies};
use std::borrow::Cow;

/// Roundings in the difference of two positions.
const ROUNDING: f64 = 16.0;

/// Largest mobility of a spring, 1/kg: softer ones do nothing, and its square has to stay finite.
const SOFTEST: f64 = 1e100;

/// What a row is for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Role {
    /// The one of this number that the joint holds.
    Held(usize),
    Motor,
    Stop,
    Spring,
    /// Across a taut rod, of this number: its ends are held by its tension as by a spring
    /// ([`super::stiffening`]).
    Taut(usize),
}

/// A row of a joint in a step.
#[derive(Clone, Debug)]
struct ActiveRow {
    joint: usize,
    role: Role,
    row: Row,
    /// Rate that the difference of positions shall have; of a spring the right-hand side itself.
    wanted: f64,
    /// Right-hand side: `wanted` with what the curvature of the path asks for.
    target: f64,
    /// C.
    compliance: f64,
    /// Length of the row of B before it was made one.
    norm: f64,
    /// The derivative at v*.
    free_rate: f64,
    /// Rate at which it seems to open by the rounding of positions alone, m/s.
    noise: f64,
}

/// A correction of the right-hand sides.
struct Correction {
    /// m/s, per row.
    changes: Vec<f64>,
    /// The sum of the squares of how fast rows opened before it.
    open: f64,
}

/// Bodies that hang together by joints.
#[derive(Default)]
struct Mechanism {
    /// Those that can move, ascending.
    bodies: Vec<u32>,
    /// How each of them turns, and coasts without torques.
    turning: Vec<(Rotor, Coasting)>,
    roots: Vec<Root>,
    /// Roots and angular velocities of v* without kappa.
    bare: Vec<(Root, Vec3)>,
    /// kappa of each, kg m^2 (see [`super::stiffening`]).
    swings: Vec<Mat3>,
    joints: Vec<usize>,
    /// kappa of the rods that are taut, kg, by joint.
    taut: Vec<(usize, f64)>,
    /// The forces of the joints, N, that K is of.
    forces: Vec<Vec3>,
    /// They are those of the last step.
    is_foreseen: bool,
    rows: Vec<ActiveRow>,
    /// Known impulses of motors: joint, row of the coordinate, impulse.
    pushed: Vec<(usize, Row, f64)>,
    elimination: Elimination,
    springs: usize,
    stiffening: Option<Stiffening>,
    /// Bounds of (w dt)^2 of its springs, by joint.
    vibrations: Vec<(usize, f64)>,
    corrected: Option<Correction>,
    /// It moves as its rows say at the start of the step, since no path from there keeps it closed.
    is_straight: bool,
    /// Rounds did not come to an end: what motors and stops do, or the path, was not found.
    is_undecided: bool,
}

/// Velocities and multipliers of a mechanism.
struct Solution {
    /// Six per body of the mechanism.
    velocity: Vec<f64>,
    /// N s (N m s for angles), per row.
    impulse: Vec<f64>,
    /// What the damping of swings took, six per body, in the coordinates of the elimination.
    held: Vec<f64>,
}

/// Share of the velocities themselves below which changes of them are none to measure by.
const FAINT: f64 = 1e-6;

/// All joints of a step.
pub(crate) struct Mechanisms<'a> {
    world: &'a World,
    step: f64,
    /// v*, six per body; of bodies that swing with what their stiffness makes of it.
    free: Vec<f64>,
    /// Velocities before the step, six per body.
    before: Vec<f64>,
    /// Velocities that corrections of rates are measured by, m/s.
    scale: f64,
    /// Velocities that openings of joints are measured by, m/s.
    yardstick: f64,
    states: Vec<JointState>,
    /// Length by which rates of angles of a joint become velocities, m.
    lengths: Vec<f64>,
    mechanisms: Vec<Mechanism>,
}

impl<'a> Mechanisms<'a> {
    /// The joints of a step from the velocities `before` it, with those that bodies would have without joints
    /// and contacts (six per body). `masses` are those of the bodies by themselves, with drag.
    pub(crate) fn new(
        world: &'a World,
        masses: &[BodyInverseMass],
        before: &[f64],
        free: Vec<f64>,
        step: f64,
    ) -> Self {
        Self::build(world, masses, (before, free), step, |joint| world.joints[joint].state.force)
    }

    /// The same with swings as these forces of the joints (N, on B) stiffen them.
    fn build(
        world: &'a World,
        masses: &[BodyInverseMass],
        (before, free): (&[f64], Vec<f64>),
        step: f64,
        force: impl Fn(usize) -> Vec3,
    ) -> Self {
        let mut own = Self {
            world,
            step,
            free,
            before: before.to_vec(),
            scale: 0.0,
            yardstick: 0.0,
            states: world.joints.iter().map(|placed| placed.state).collect(),
            lengths: Vec::new(),
            mechanisms: Vec::new(),
        };
        if world.joints.is_empty() {
            return own;
        }
        let poses = |body: usize| world.pose(body);
        let (mut speed, mut noise) = (0.0_f64, 0.0_f64);
        for index in 0..world.joints.len() {
            let length = length_of(world, index);
            own.lengths.push(length);
            for row in held(&world.joints, index, &poses, &last(&world.joints)) {
                noise = noise.max(own.noise(index, &row));
                let rate = row.rate(&own.free) - row.rate(&own.before);
                speed = speed.max(rate.abs() * if row.angular { length } else { 1.0 });
            }
        }
        let fall = world.gravity.length() * step;
        let scale = [fall, speed].into_iter().find(|&v| v > SLOWEST).unwrap_or(1.0);
        // A clear difference is none that rounding makes.
        own.scale = scale.max(noise / CLEAR);
        // What turns steadily about its axis changes by rounding alone.
        let motion = own.before.iter().chain(&own.free).fold(0.0_f64, |most, v| most.max(v.abs()));
        own.yardstick = own.scale.max(FAINT * motion);
        for (bodies, joints) in connected(world) {
            let forces = joints.iter().map(|&joint| force(joint)).collect();
            let turn = |body: usize| Vec3::from_slice(&own.free[6 * body + 3..6 * body + 6]);
            let bare = |&body: &u32| (Root::of(&masses[body as usize]), turn(body as usize));
            let bare = bodies.iter().map(bare).collect();
            let coasting = |&body: &u32| {
                let (rotor, first) = (Rotor::of(world, body as usize), 6 * body as usize + 3);
                (rotor, rotor.coast(Vec3::from_slice(&own.before[first..first + 3]), step))
            };
            let turning = bodies.iter().map(coasting).collect();
            let mut mechanism = Mechanism {
                bodies,
                turning,
                bare,
                joints,
                forces,
                is_foreseen: true,
                ..Mechanism::default()
            };
            own.stiffen(&mut mechanism);
            mechanism.vibrations = own.vibrations(&mechanism);
            own.arrange(&mut mechanism);
            own.mechanisms.push(mechanism);
        }
        own
    }

    /// Velocities before the step, six per body.
    pub(crate) fn before(&self) -> &[f64] {
        &self.before
    }

    /// Whether no joint holds anything that can move.
    pub(crate) fn is_empty(&self) -> bool {
        self.mechanisms.is_empty()
    }

    fn mean(&self, profile: &Profile) -> f64 {
        profile.mean(self.world.time, self.step)
    }

    /// What rounding makes of the rate of a row, m/s.
    fn noise(&self, joint: usize, row: &Row) -> f64 {
        let place = |(body, _): &(usize, [Vec3; 2])| self.world.bodies.position[*body].length();
        let far = row.ends.iter().map(place).fold(self.lengths[joint], f64::max);
        let mut turned = 1.0 + self.states[joint].coordinate.abs();
        if let JointKind::Gear { joints, ratio } = self.world.joints[joint].joint.kind {
            let [first, second] = joints.map(|other| self.states[other.index()].coordinate.abs());
            turned += ratio.abs() * first + second;
        }
        let size = if row.angular { self.lengths[joint] * turned } else { far };
        ROUNDING * f64::EPSILON * size / self.step
    }

    /// Makes the rows of a mechanism with motors and stops as the states say, and eliminates them. Where the
    /// step resolves the swings that it leaves free, held by what does not let go (not by stops and motors
    /// with a limit, which would hold light links against all that pulls at them), it is not stiff: stiffness
    /// that comes and goes with the forces makes energy.
    fn arrange(&mut self, mechanism: &mut Mechanism) {
        self.make_rows(mechanism);
        if mechanism.is_stiff() {
            let rows = mechanism.rows.clone();
            mechanism.factorise(|row| match row.role {
                Role::Stop => false,
                Role::Motor => self.world.joints[row.joint].joint.is_driven(),
                Role::Held(_) | Role::Spring | Role::Taut(_) => true,
            });
            mechanism.stiffening = mechanism.stiffening();
            let is_resolved = mechanism.stiffening.is_none();
            if !is_resolved && mechanism.rows.len() == rows.len() {
                return;
            }
            mechanism.rows = rows;
            if is_resolved {
                let none = vec![Mat3::ZERO; mechanism.bodies.len()];
                self.stiffen_by(mechanism, none, Vec::new());
                self.make_rows(mechanism);
            }
        }
        mechanism.factorise(|_| true);
        mechanism.stiffening = mechanism.stiffening();
    }

    /// The rows of a mechanism, not eliminated; how paths bent stays with those that there were.
    fn make_rows(&self, mechanism: &mut Mechanism) {
        let (world, step) = (self.world, self.step);
        let poses = |body: usize| world.pose(body);
        let known = std::mem::take(&mut mechanism.rows);
        let bent = |joint: usize, role: Role| {
            let own = &known[known.partition_point(|row| row.joint < joint)..];
            let same = own.iter().take_while(|row| row.joint == joint).find(|row| row.role == role);
            same.map_or(0.0, |row| row.target - row.wanted)
        };
        (mechanism.pushed, mechanism.corrected) = (Vec::new(), None);
        for &joint in &mechanism.joints {
            let mut add = |role: Role, row: Row, wanted: f64, compliance: f64| {
                let free_rate = row.rate(&self.free);
                let (target, noise) = (wanted + bent(joint, role), self.noise(joint, &row));
                let row =
                    ActiveRow { joint, role, row, wanted, target, compliance, norm: 1.0, free_rate, noise };
                mechanism.rows.push(row);
            };
            for (k, row) in held(&world.joints, joint, &poses, &last(&world.joints)).into_iter().enumerate() {
                add(Role::Held(k), row, 0.0, 0.0);
            }
            if let Some((_, kappa)) = mechanism.taut.iter().find(|(taut, _)| *taut == joint) {
                let (_, rows) = Placed::of(&world.joints[joint], &poses).across();
                for (k, row) in rows.into_iter().enumerate() {
                    let before = row.rate(&self.before);
                    add(Role::Taut(k), row, before, (1.0 / kappa).min(SOFTEST));
                }
            }
            let own = &world.joints[joint].joint;
            if own.motor.is_none() && own.spring.is_none() && own.limits.is_none() {
                continue;
            }
            let Some(along) = coordinate(&world.joints, joint, &poses, &last(&world.joints)) else {
                continue;
            };
            if let Some(spring) = &own.spring {
                let rest = spring.rest.as_ref().map_or(world.joints[joint].start, |rest| self.mean(rest));
                let (k, c) = (spring.stiffness, spring.damping);
                let square = mechanism
                    .vibrations
                    .iter()
                    .find(|(own, _)| *own == joint)
                    .map_or(0.0, |(_, square)| *square);
                let [before_part, after_part] = spring_shares(square).map(|share| share * step * step * k);
                let mobility = (1.0 / (after_part + step * c)).min(SOFTEST);
                let before = along.rate(&self.before);
                let right = mobility * (before_part * before - step * k * (along.value - rest));
                add(Role::Spring, along.clone(), right, mobility);
            }
            let side = self.states[joint].stopped;
            if side != 0 {
                let room = self.room(joint, side, along.value);
                add(Role::Stop, along.clone(), f64::from(side) * room / step, 0.0);
            }
            match &own.motor {
                Some(Motor::Force(force)) => {
                    let impulse = step * self.mean(force);
                    mechanism.pushed.push((joint, along, impulse));
                }
                Some(Motor::Speed { speed, limit }) => match (self.states[joint].saturated, limit) {
                    (side, Some(limit)) if side != 0 => {
                        let impulse = f64::from(side) * step * self.mean(limit).max(0.0);
                        mechanism.pushed.push((joint, along, impulse));
                    }
                    _ => add(Role::Motor, along, self.mean(speed), 0.0),
                },
                None => {}
            }
        }
    }

    /// Makes the rows of the mechanism of this number anew.
    fn rearrange(&mut self, index: usize) {
        let mut mechanism = std::mem::take(&mut self.mechanisms[index]);
        self.arrange(&mut mechanism);
        self.mechanisms[index] = mechanism;
    }

    /// How far a coordinate of this value is from the stop on this side of it; none where it was run over.
    fn room(&self, joint: usize, side: i8, value: f64) -> f64 {
        let limits = self.world.joints[joint].joint.limits.unwrap_or_default();
        let at = if side < 0 { limits.lower } else { limits.upper };
        at.map_or(0.0, |at| f64::from(side) * (at - value)).max(0.0)
    }

    /// Takes the stiffness of the bodies of a mechanism from the forces of its joints.
    fn stiffen(&mut self, mechanism: &mut Mechanism) {
        let bare: Vec<Root> = mechanism.bare.iter().map(|(root, _)| *root).collect();
        let held = (mechanism.joints.as_slice(), mechanism.forces.as_slice());
        let bodies = (mechanism.bodies.as_slice(), bare.as_slice());
        let (swings, taut) = stiffness(self.world, bodies, held, 0.25 * self.step * self.step);
        self.stiffen_by(mechanism, swings, taut);
    }

    /// Makes the bodies and rods of a mechanism as stiff as that ([`stiffness`]).
    fn stiffen_by(&mut self, mechanism: &mut Mechanism, swings: Vec<Mat3>, taut: Vec<(usize, f64)>) {
        mechanism.roots = mechanism.bare.iter().map(|(root, _)| *root).collect();
        mechanism.taut = taut;
        let bodies = mechanism.bodies.iter().zip(&mechanism.bare).zip(&swings);
        for (((&body, &(_, mut turn)), &swing), root) in bodies.zip(&mut mechanism.roots) {
            let angular = 6 * body as usize + 3..6 * body as usize + 6;
            if swing != Mat3::ZERO {
                *root = root.with(swing);
                turn -= root.turned_by(swing * (turn - Vec3::from_slice(&self.before[angular.clone()])));
            }
            self.free[angular].copy_from_slice(&turn.to_array());
        }
        mechanism.swings = swings;
    }

    /// Forces of the joints of a mechanism on B under these multipliers, N.
    fn forces(&self, mechanism: &Mechanism, impulse: &[f64]) -> Vec<Vec3> {
        let poses = |body: usize| self.world.pose(body);
        let mut forces = vec![Vec3::ZERO; mechanism.joints.len()];
        for (joint, row, impulse, _) in mechanism.exerted(impulse) {
            let own = &self.world.joints[joint];
            if !matches!(own.joint.kind, JointKind::Gear { .. })
                && let Ok(k) = mechanism.joints.binary_search(&joint)
            {
                forces[k] += impulse / self.step * Placed::of(own, &poses).wrench(row)[0];
            }
        }
        forces
    }

    /// M times these velocities (six) of a body, M with drag.
    fn momentum(&self, body: usize, v: [Vec3; 2]) -> [Vec3; 2] {
        let bodies = &self.world.bodies;
        let inertia = world_inertia(bodies.inertia[body], bodies.orientation[body]);
        let drag = self.world.drag.get(body).copied().unwrap_or_default();
        let mass = bodies.mass[body] + self.step * drag.linear;
        [mass * v[0], inertia * v[1] + self.step * drag.angular * v[1]]
    }

    /// The velocities that z makes of v*, six per body.
    fn velocities_of(&self, mechanism: &Mechanism, z: &[f64]) -> Vec<f64> {
        let of = |(k, &body): (usize, &u32)| {
            let [u, w] = mechanism.roots[k].times(&z[6 * k..]);
            let change = [u.x, u.y, u.z, w.x, w.y, w.z];
            std::array::from_fn::<f64, 6, _>(|axis| self.free[6 * body as usize + axis] + change[axis])
        };
        mechanism.bodies.iter().enumerate().flat_map(of).collect()
    }

    /// Y^T kappa (3 v + v-), v the velocities that z makes of v*.
    fn spins(&self, mechanism: &Mechanism, stiffening: &Stiffening, z: &[f64]) -> Vec<f64> {
        let velocity = self.velocities_of(mechanism, z);
        let moment = |(k, swing): (usize, &Mat3)| {
            let turn = Vec3::from_slice(&velocity[6 * k + 3..6 * k + 6]);
            let before = Vec3::from_slice(&self.before[6 * mechanism.bodies[k] as usize + 3..]);
            *swing * (3.0 * turn + before)
        };
        let moments: Vec<Vec3> = mechanism.swings.iter().enumerate().map(moment).collect();
        let rod = |(place, row): (usize, &ActiveRow)| {
            let rate = row.row.rate_of(|body| self.velocity_of(mechanism, &velocity, body));
            (place, -(3.0 * rate + row.wanted) / row.compliance.sqrt())
        };
        let rods = mechanism.springs().filter(|(_, row)| matches!(row.role, Role::Taut(_)));
        let rods: Vec<(usize, f64)> = rods.map(rod).collect();
        let along = |(turns, motion): (&Vec<Vec3>, &Vec<f64>)| {
            let spins: f64 = turns.iter().zip(&moments).map(|(turn, m)| turn.dot(*m)).sum();
            spins + rods.iter().map(|(place, rate)| motion[*place] * rate).sum::<f64>()
        };
        stiffening.turns.iter().zip(&stiffening.motions).map(along).collect()
    }

    /// Velocities and multipliers of a mechanism under these impulses on all bodies (six per body).
    fn solve(&self, mechanism: &Mechanism, impulse: &[f64]) -> Solution {
        let mut start = vec![0.0; 6 * mechanism.bodies.len() + mechanism.springs];
        let parts = |f: &[f64]| [Vec3::from_slice(&f[..3]), Vec3::from_slice(&f[3..6])];
        for (k, &body) in mechanism.bodies.iter().enumerate() {
            let body = body as usize;
            let mut sum = if impulse.is_empty() { [Vec3::ZERO; 2] } else { parts(&impulse[6 * body..]) };
            for (_, row, pushed) in &mechanism.pushed {
                for (_, [f, m]) in row.ends.iter().filter(|(end, _)| *end == body) {
                    sum = [sum[0] + *pushed * *f, sum[1] + *pushed * *m];
                }
            }
            let [z, w] = mechanism.roots[k].transposed_times(sum);
            start[6 * k..6 * k + 3].copy_from_slice(&z.to_array());
            start[6 * k + 3..6 * k + 6].copy_from_slice(&w.to_array());
        }
        let right: Vec<f64> =
            mechanism.rows.iter().map(|row| (row.target - row.free_rate) / row.norm).collect();
        let mut z = start.clone();
        mechanism.elimination.project(&mut z, &right);
        let mut held = Vec::new();
        if let Some(stiffening) = &mechanism.stiffening {
            let spins = self.spins(mechanism, stiffening, &z);
            held = vec![0.0; z.len()];
            for (change, motion) in stiffening.damped(&spins).iter().zip(&stiffening.motions) {
                held.iter_mut().zip(motion).for_each(|(held, m)| *held += change * m);
            }
            z.iter_mut().zip(&held).for_each(|(z, held)| *z += held);
        }
        let way: Vec<f64> = z.iter().zip(&start).map(|(z, start)| z - start).collect();
        let mut impulses = mechanism.elimination.multipliers(&way);
        impulses.iter_mut().zip(&mechanism.rows).for_each(|(impulse, row)| *impulse /= row.norm);
        let velocity = self.velocities_of(mechanism, &z);
        Solution { velocity, impulse: impulses, held }
    }

    /// The rows where bodies are after the step with these velocities of the mechanism; `None` for those that
    /// are not of positions.
    fn rows_after(&self, mechanism: &Mechanism, velocity: &[f64]) -> Vec<Option<Row>> {
        let joints = &self.world.joints;
        let (moved, near) = (self.moved(mechanism, velocity), self.near(mechanism, velocity));
        let mut known: Option<(usize, Vec<Row>)> = None;
        let after = |row: &ActiveRow| match row.role {
            Role::Held(k) => {
                if known.as_ref().is_none_or(|(joint, _)| *joint != row.joint) {
                    known = Some((row.joint, held(joints, row.joint, &moved, &near)));
                }
                known.as_ref().map(|(_, rows)| rows[k].clone())
            }
            Role::Motor | Role::Stop => coordinate(joints, row.joint, &moved, &near),
            Role::Spring | Role::Taut(_) => None,
        };
        mechanism.rows.iter().map(after).collect()
    }

    /// Rates of the rows, as differences of positions, with these velocities of the mechanism.
    fn rates(&self, mechanism: &Mechanism, velocity: &[f64]) -> Vec<f64> {
        self.rates_of(mechanism, &self.rows_after(mechanism, velocity), velocity)
    }

    /// The same where the rows after the step are known.
    fn rates_of(&self, mechanism: &Mechanism, after: &[Option<Row>], velocity: &[f64]) -> Vec<f64> {
        let rate = |(row, after): (&ActiveRow, &Option<Row>)| match after {
            Some(after) => self.rate_of(mechanism, &row.row, Some(after), velocity),
            None => row.wanted,
        };
        mechanism.rows.iter().zip(after).map(rate).collect()
    }

    /// The rate of a row in the step with these velocities: that of the positions, or of the velocities where
    /// the mechanism moves straight or the row is none after the step.
    fn rate_of(&self, mechanism: &Mechanism, before: &Row, after: Option<&Row>, velocity: &[f64]) -> f64 {
        match after {
            Some(after) if !mechanism.is_straight => (after.value - before.value) / self.step,
            _ => before.rate_of(|body| self.velocity_of(mechanism, velocity, body)),
        }
    }

    /// Velocities of a body, six, with these of the mechanism.
    fn velocity_of<'b>(&'b self, mechanism: &'b Mechanism, velocity: &'b [f64], body: usize) -> &'b [f64] {
        match mechanism.bodies.binary_search(&(body as u32)) {
            Ok(k) => &velocity[6 * k..6 * k + 6],
            Err(_) => &self.free[6 * body..6 * body + 6],
        }
    }

    /// Where bodies are after the step with these velocities of the mechanism.
    fn moved<'b>(
        &'b self,
        mechanism: &'b Mechanism,
        velocity: &'b [f64],
    ) -> impl Fn(usize) -> (Vec3, Quat) + 'b {
        let pose = |(k, &body): (usize, &u32)| {
            let (body, v) = (body as usize, &velocity[6 * k..6 * k + 6]);
            let (u, w) = (Vec3::from_slice(&v[..3]), Vec3::from_slice(&v[3..]));
            let before = Vec3::from_slice(&self.before[6 * body + 3..6 * body + 6]);
            let (rotor, coasting) = &mechanism.turning[k];
            let Turn { orientation, .. } = rotor.turn_beside(coasting, [before, w], self.step, false);
            (self.world.bodies.position[body] + self.step * u, orientation)
        };
        // Many rows ask for the same bodies.
        let known: Vec<(Vec3, Quat)> = mechanism.bodies.iter().enumerate().map(pose).collect();
        move |body| match mechanism.bodies.binary_search(&(body as u32)) {
            Ok(k) => known[k],
            Err(_) => self.driven(body),
        }
    }

    /// Where a body that joints do not move is after the step.
    fn driven(&self, body: usize) -> (Vec3, Quat) {
        let (position, orientation) = self.world.pose(body);
        let part = |first: usize| Vec3::from_slice(&self.free[6 * body + first..6 * body + first + 3]);
        let turn = rotation_exponential(self.step * part(3));
        (position + self.step * part(0), (turn * orientation).normalize())
    }

    /// About what coordinates joints have then.
    fn near<'b>(&'b self, mechanism: &'b Mechanism, velocity: &'b [f64]) -> impl Fn(usize) -> f64 + 'b {
        let joints = &self.world.joints;
        move |joint| {
            let along = coordinate(joints, joint, &|body| self.world.pose(body), &last(joints));
            let of = |body: usize| self.velocity_of(mechanism, velocity, body);
            along.map_or(0.0, |along| along.value + self.step * along.rate_of(of))
        }
    }

    /// How fast a row of the joint opens, m/s.
    fn opening(&self, row: &ActiveRow, rate: f64) -> f64 {
        (rate - row.wanted).abs() * if row.row.angular { self.lengths[row.joint] } else { 1.0 }
    }

    /// Velocities of all bodies under these contact impulses (six per body; empty: none).
    pub(crate) fn velocities(&self, impulse: &[f64], velocity: &mut [f64]) {
        for mechanism in &self.mechanisms {
            let solution = self.solve(mechanism, impulse);
            for (k, &body) in mechanism.bodies.iter().enumerate() {
                velocity[6 * body as usize..6 * body as usize + 6]
                    .copy_from_slice(&solution.velocity[6 * k..6 * k + 6]);
            }
        }
    }

    /// The bodies that joints hold.
    pub(crate) fn bodies(&self) -> impl Iterator<Item = u32> {
        self.mechanisms.iter().flat_map(|mechanism| mechanism.bodies.iter().copied())
    }

    /// Velocities of all bodies without contacts, with joints that nothing else pulls at, six per body.
    pub(crate) fn unmet(&self) -> Vec<f64> {
        let mut velocity = self.free.clone();
        self.velocities(&[], &mut velocity);
        velocity
    }

    /// The common inverse masses of the mechanisms.
    pub(crate) fn coupled(&self) -> Vec<CoupledBodies> {
        self.mechanisms.iter().map(Mechanism::coupled).collect()
    }
}

impl Mechanism {
    /// Whether the step does not resolve the swings of its bodies.
    fn is_stiff(&self) -> bool {
        !self.taut.is_empty() || self.swings.iter().any(|swing| *swing != Mat3::ZERO)
    }

    /// What damps the swings that the step does not resolve.
    fn stiffening(&self) -> Option<Stiffening> {
        if !self.is_stiff() {
            return None;
        }
        let motions = self.elimination.free_motions();
        let turn = |motion: &Vec<f64>| -> Vec<Vec3> {
            self.roots.iter().enumerate().map(|(k, root)| root.times(&motion[6 * k..])[1]).collect()
        };
        let turns: Vec<Vec<Vec3>> = motions.iter().map(turn).collect();
        let rods: Vec<usize> = self
            .springs()
            .filter(|(_, row)| matches!(row.role, Role::Taut(_)))
            .map(|(place, _)| place)
            .collect();
        Stiffening::new(motions, turns, &self.swings, &rods)
    }

    /// What acts under these multipliers: joint, row, impulse, and whether the joint holds by it; known
    /// impulses of motors after the rows.
    fn exerted(&self, impulse: &[f64]) -> impl Iterator<Item = (usize, &Row, f64, bool)> {
        let holds = |role: Role| matches!(role, Role::Held(_) | Role::Taut(_));
        let rows = self.rows.iter().zip(impulse);
        let rows = rows.map(move |(row, &impulse)| (row.joint, &row.row, impulse, holds(row.role)));
        rows.chain(self.pushed.iter().map(|(joint, row, impulse)| (*joint, row, *impulse, false)))
    }

    /// Rows with a compliance, with the places of their coordinates in the elimination.
    fn springs(&self) -> impl Iterator<Item = (usize, &ActiveRow)> {
        (6 * self.bodies.len()..).zip(self.rows.iter().filter(|row| row.compliance > 0.0))
    }

    /// Eliminates the rows that are chosen.
    fn factorise(&mut self, chosen: impl Fn(&ActiveRow) -> bool) {
        self.rows.retain(chosen);
        self.springs = self.rows.iter().filter(|row| row.compliance > 0.0).count();
        let length = 6 * self.bodies.len() + self.springs;
        let mut spring = 6 * self.bodies.len();
        let mut rows = Vec::with_capacity(self.rows.len());
        for own in &mut self.rows {
            let mut row = row_over(&own.row, &self.bodies, &self.roots);
            if own.compliance > 0.0 {
                row.push((spring, own.compliance.sqrt()));
                spring += 1;
            }
            own.norm = made_unit(&mut row);
            rows.push(row);
        }
        self.elimination = Elimination::new(self.bodies.len(), length, &rows);
    }

    /// The changes of right-hand sides that change rates by what is `missing`, where changes of velocities
    /// are seen by other rows (`None`: by those that there are).
    fn changes(&self, seen: &[Option<Row>], missing: &[f64]) -> Vec<f64> {
        let mut springs = self.springs();
        let row = |(own, seen): (&ActiveRow, &Option<Row>)| {
            let row = seen.as_ref().unwrap_or(&own.row);
            let mut row = row_over(row, &self.bodies, &self.roots);
            if own.compliance > 0.0
                && let Some((place, _)) = springs.next()
            {
                row.push((place, own.compliance.sqrt()));
            }
            row.iter_mut().for_each(|(_, x)| *x /= own.norm);
            row
        };
        let rows = self.rows.iter().zip(seen).map(row).collect();
        let missing: Vec<f64> = self.rows.iter().zip(missing).map(|(own, rate)| rate / own.norm).collect();
        let mut changes = self.elimination.changes(rows, &missing);
        changes.iter_mut().zip(&self.rows).for_each(|(change, own)| *change *= own.norm);
        changes
    }

    /// W = Y Y^T with Y = S (motions that the rows leave free), and what damps swings.
    fn coupled(&self) -> CoupledBodies {
        let known = self.stiffening.as_ref().map(|stiffening| stiffening.motions.as_slice());
        let motions = known.map_or_else(|| self.elimination.free_motions().into(), Cow::Borrowed);
        let degrees = motions.len();
        let mut factor = vec![0.0; 6 * self.bodies.len() * degrees];
        for (column, motion) in motions.iter().enumerate() {
            for (k, root) in self.roots.iter().enumerate() {
                let [u, w] = root.times(&motion[6 * k..]);
                for (axis, y) in [u.x, u.y, u.z, w.x, w.y, w.z].into_iter().enumerate() {
                    factor[(6 * k + axis) * degrees + column] = y;
                }
            }
        }
        if let Some(stiffening) = &self.stiffening {
            // Y L^-T: every row is L^-1 of itself.
            factor.chunks_exact_mut(degrees).for_each(|row| stiffening.forward(row));
        }
        CoupledBodies { bodies: self.bodies.clone(), degrees, factor }
    }
}

/// The common inverse masses in an impact: forces that are finite have no time to act, joints and motors
/// without limit hold. `velocity` becomes what these let the bodies have: that of the middle of the last step
/// does not lie along them where they are now.
pub(crate) fn coupled_in_impacts(world: &World, velocity: &mut [f64], step: f64) -> Vec<CoupledBodies> {
    let masses = inverse_mass(world);
    let mut all = Mechanisms::build(world, &masses, (&*velocity, velocity.to_vec()), step, |_| Vec3::ZERO);
    for mechanism in &mut all.mechanisms {
        mechanism.pushed.clear();
        mechanism.factorise(|row| match row.role {
            Role::Held(_) => true,
            Role::Motor => world.joints[row.joint].joint.is_driven(),
            Role::Stop | Role::Spring | Role::Taut(_) => false,
        });
    }
    all.velocities(&[], velocity);
    all.coupled()
}

/// The velocities after a step without contacts, six numbers per body, of bodies that joints hold in the
/// places where they are, and that motors and springs drive, from those `before` it and those that they would
/// have without joints (`free`): what stops do, and how joints turn on the way, is none of it; a motor with a
/// limit has none.
pub(crate) fn driven_in_place(world: &World, before: &[f64], free: Vec<f64>, step: f64) -> Vec<f64> {
    let masses = inverse_mass_in_step(world, step);
    let mut all = Mechanisms::build(world, &masses, (before, free), step, |_| Vec3::ZERO);
    for mechanism in &mut all.mechanisms {
        mechanism.factorise(|row| matches!(row.role, Role::Held(_) | Role::Motor | Role::Spring));
    }
    all.unmet()
}
