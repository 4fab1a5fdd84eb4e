//! Energies, and what changes them in a step.

use crate::cell::{self, Cell};
use crate::contact::ContactSet;
use crate::load;
use crate::math::Vec3;
use crate::world::World;
use graintrain_linalg::parallel::{CHUNK, fold_chunks, sum_chunks};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Energies of the bodies that can move, J.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// 1/2 m |u|^2, u relative to the deformation of a periodic cell
    pub translational: f64,
    /// 1/2 w . I w
    pub rotational: f64,
    /// -m g . x: in the gravity of now, zero at the origin of the world.
    pub potential: f64,
}

/// Energies of the bodies that are meant.
pub fn energies(world: &World, selected: &[bool]) -> Energies {
    let bodies = &world.bodies;
    let mut sum = Energies::default();
    for b in (0..bodies.len()).filter(|&b| selected[b]) {
        let w = bodies.orientation[b].inverse() * bodies.angular_velocity[b];
        sum.translational += 0.5 * bodies.mass[b] * world.fluctuation(b).length_squared();
        sum.rotational += 0.5 * w.dot(bodies.inertia[b] * w);
        sum.potential -= bodies.mass[b] * world.gravity.dot(bodies.position[b]);
    }
    sum
}

/// What changed the kinetic energy of the bodies with a dynamic degree of freedom, J, in a step or summed
/// over many:
///
/// ```text
/// K+ - K- = gravity + loads + drives + joints - friction - normal + rest
/// ```
///
/// With the impulses g of a step, v = (v- + v+) / 2 for dynamic degrees of freedom and the prescribed
/// velocity for others, the terms are dt m g . v, dt f . v, -(D g + J^T lambda) . v over the prescribed
/// degrees, (J^T lambda) . v of joints over all, and -g_t . (D^T v)_t and -g_n (D^T v)_n over all contacts,
/// impacts included; v+ is that at which free rotations begin (`crate::rotation`). Mostly this is an
/// identity, and the rest is rounding. Else it is what spins gave back, and what the turning of bodies that
/// are driven in some degrees adds. What the inertia of a body that is driven in some degrees
/// takes, (v- + v+) / 2 . M (v+ - v-) over these, is work of the drive. In a periodic cell that deforms K is
/// that of velocities relative to the deformation, and what the deformation gives them, with and without
/// contacts, counts as work of drives. Overlap is removed by displacements, which change no velocity: the
/// energy that this gives to bodies against gravity is counted apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// Work of gravity.
    pub gravity: f64,
    /// Work of external forces and torques besides gravity.
    pub loads: f64,
    /// Work of prescribed motions.
    pub drives: f64,
    /// Work of joints: of motors, springs, dampers and stops, and nothing but rounding of what only holds.
    pub joints: f64,
    /// Taken by friction, that of rolling and spinning included.
    pub friction: f64,
    /// Taken by normal impulses: impacts, and gaps that close.
    pub normal: f64,
    /// Change of kinetic energy less all of these.
    pub rest: f64,
}

impl Ledger {
    /// Adds another step.
    pub fn add(&mut self, other: &Self) {
        self.gravity += other.gravity;
        self.loads += other.loads;
        self.drives += other.drives;
        self.joints += other.joints;
        self.friction += other.friction;
        self.normal += other.normal;
        self.rest += other.rest;
    }

    /// K+ - K-, J: what all of it comes to.
    pub fn change(&self) -> f64 {
        let Self { gravity, loads, drives, joints, friction, normal, rest } = *self;
        gravity + loads + drives + joints - friction - normal + rest
    }

    /// Sum of the magnitudes, J: what the rest is to be compared with.
    pub fn throughput(&self) -> f64 {
        let Self { gravity, loads, drives, joints, friction, normal, rest: _ } = *self;
        [gravity, loads, drives, joints, friction, normal].into_iter().map(f64::abs).sum()
    }
}

/// How a body moves in the mean over a step.
struct MeanMotion {
    /// Which degrees of freedom are dynamic.
    free: [bool; 6],
    /// (v- + v+) / 2 of these, the prescribed velocity of the others.
    mean: [f64; 6],
}

impl MeanMotion {
    fn of(world: &World, body: usize, [before, after]: [&[f64]; 2]) -> Self {
        let free = world.free_degrees(body);
        let mean = std::array::from_fn(|k| {
            let i = 6 * body + k;
            if free[k] { 0.5 * (before[i] + after[i]) } else { after[i] }
        });
        Self { free, mean }
    }

    /// `work` and what the inertia of a body takes over its prescribed degrees of freedom, (v- + v+) / 2 . M
    /// (v+ - v-), J.
    fn of_inertia(&self, world: &World, body: usize, [before, after]: [&[f64]; 2], mut work: f64) -> f64 {
        let (v0, v1) = (&before[6 * body..6 * body + 6], &after[6 * body..6 * body + 6]);
        let change = |first: usize| Vec3::from_slice(&v1[first..]) - Vec3::from_slice(&v0[first..]);
        let turn = world.bodies.orientation[body];
        let spin = turn * (world.bodies.inertia[body] * (turn.inverse() * change(3)));
        let momentum = (world.bodies.mass[body] * change(0)).to_array().into_iter().chain(spin.to_array());
        for (k, p) in momentum.enumerate().filter(|(k, _)| !self.free[*k]) {
            work += 0.5 * (v0[k] + v1[k]) * p;
        }
        work
    }
}

impl Ledger {
    /// Adds the work of contact i.
    fn add_contact(
        &mut self,
        set: &ContactSet,
        i: usize,
        (position, cell): (&[Vec3], Option<&Cell>),
        bodies: &[MeanMotion],
    ) {
        let (contact, impulse) = (&set.contacts[i], set.impulse[i]);
        let moment = set.moment.get(i).copied().unwrap_or_default();
        let (mut relative, mut turning) = (Vec3::ZERO, Vec3::ZERO);
        let jump = cell::image_velocity(cell, contact);
        let sides = cell::ends(cell, contact).into_iter().zip([impulse, -impulse]);
        for ((body, point), impulse) in sides {
            let MeanMotion { free, mean } = &bodies[body];
            let arm = point - position[body];
            let (u, w) = (Vec3::from_slice(&mean[..3]), Vec3::from_slice(&mean[3..]));
            let sign = if body == contact.body_a as usize { 1.0 } else { -1.0 };
            relative += sign * (u + w.cross(arm));
            turning += sign * w;
            if free == &[true; 6] {
                continue;
            }
            let torque = arm.cross(impulse) + sign * moment;
            let generalised = impulse.to_array().into_iter().chain(torque.to_array());
            for (k, g) in generalised.enumerate() {
                if !free[k] {
                    self.drives -= g * mean[k];
                }
            }
        }
        if contact.image != [0; 3] {
            relative -= jump;
            self.drives += impulse.dot(jump);
        }
        let normal = contact.normal.dot(impulse) * contact.normal.dot(relative);
        self.normal -= normal;
        self.friction -= impulse.dot(relative) - normal + moment.dot(turning);
    }
}

/// The ledger of a step of this length with the contacts and impulses of `set`, the impulses of joints on
/// bodies (and their moments about the centres), the centres `position` and the periodic cell at its start
/// (m; with the rates after it, whose work counts as that of drives), the velocities before it and those that
/// its impulses then give (six numbers per body; with the mean prescribed ones), and the change of kinetic
/// energy.
pub(crate) fn ledger(
    world: &World,
    (set, joints): (&ContactSet, &[(usize, [Vec3; 2])]),
    (position, cell): (&[Vec3], Option<&Cell>),
    [before, after]: [&[f64]; 2],
    step: f64,
    change: f64,
) -> Ledger {
    let mut ledger = Ledger { loads: load::work(world, before, after, step), ..Ledger::default() };
    let count = world.bodies.len();
    let bodies: Vec<MeanMotion> = (0..count)
        .into_par_iter()
        .with_min_len(CHUNK)
        .map(|body| MeanMotion::of(world, body, [before, after]))
        .collect();
    let gravity = world.gravity.to_array();
    ledger.gravity = sum_chunks(count, |range| {
        let mut work = 0.0;
        for body in range {
            let MeanMotion { free, mean } = &bodies[body];
            for (k, g) in gravity.into_iter().enumerate().filter(|(k, _)| free[*k]) {
                work += step * world.bodies.mass[body] * g * mean[k];
            }
        }
        work
    });
    ledger.drives += sum_chunks(count, |range| {
        let partly_driven = range.filter(|&body| !world.is_free(body) && !world.is_prescribed(body));
        partly_driven.fold(0.0, |work, body| bodies[body].of_inertia(world, body, [before, after], work))
    });
    let of_contacts = |range: std::ops::Range<usize>| {
        let mut ledger = Ledger::default();
        range.for_each(|i| ledger.add_contact(set, i, (position, cell), &bodies));
        ledger
    };
    ledger = fold_chunks(set.contacts.len(), ledger, of_contacts, |mut all, chunk| {
        all.add(&chunk);
        all
    });
    for (body, [force, moment]) in joints {
        for (k, g) in force.to_array().into_iter().chain(moment.to_array()).enumerate() {
            let MeanMotion { free, mean } = &bodies[*body];
            let work = g * mean[k];
            ledger.joints += work;
            if !free[k] {
                ledger.drives -= work;
            }
        }
    }
    ledger.rest = change - ledger.change();
    ledger
}
