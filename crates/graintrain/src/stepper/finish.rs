//! What is left of a step once it is solved: the overlap removed, the report made, what the next step starts from kept.

use super::Stepper;
use super::attempt::{Attempt, chosen_of};
use super::placement::{Placement, taken_along};
use crate::assemble::{OverlapCorrection, of_each, pair_property, relative_velocities};
use crate::cell;
use crate::clock::{Clock, Laps};
use crate::contact::{Contact, ContactSet};
use crate::load;
use crate::math::Vec3;
use crate::measure::energy;
use crate::overlap::{Correction, Gaps};
use crate::step_report::{PhysicalErrors, StepReport, wrenches};
use crate::turning::{turning_velocities, world_moment};
use crate::world::World;
use graintrain_ccp::{Delassus, RigidContact, Status};
use rayon::prelude::*;

impl Stepper {
    /// Displacements that remove overlap at the end of the step.
    pub(super) fn correct(
        &self,
        world: &World,
        contacts: &[Contact],
        attempt: &Attempt,
        size: &[f64],
    ) -> Correction {
        if self.settings.overlap == OverlapCorrection::Velocity {
            return Correction::default();
        }
        let Delassus::Rigid(rigid) = &*attempt.problem.delassus else { return Correction::default() };
        let step = self.settings.step;
        // What an elastic contact overlaps is its own affair.
        let compliance = rigid.compliance();
        let is_rigid = |k: &usize| compliance.get(*k).is_none_or(|&c| c == 0.0);
        let kept: Vec<usize> = (0..attempt.active.len()).filter(is_rigid).collect();
        let active: Vec<u32> = kept.iter().map(|&k| attempt.active[k]).collect();
        let all: Vec<RigidContact>;
        let rows = if kept.len() == rigid.num_contacts() {
            rigid.contacts()
        } else {
            all = of_each(&kept, |&k| rigid.contacts()[k]);
            &all
        };
        let chosen = chosen_of(contacts, &active);
        let u = relative_velocities(attempt.cell.as_ref(), &chosen, rows, &attempt.velocity);
        let gap: Vec<f64> = chosen.iter().zip(u.chunks_exact(3)).map(|(c, u)| c.gap + step * u[0]).collect();
        let size: Vec<f64> = active.iter().map(|&i| size[i as usize]).collect();
        let bend = |body: usize, point: Vec3| {
            let spin = Vec3::from_slice(&attempt.velocity[6 * body + 3..6 * body + 6]);
            0.5 * step * step * spin.length_squared() * (point - world.bodies.position[body]).length()
        };
        let both = |contact: &Contact| {
            let [(a, on_a), (b, on_b)] = cell::ends(world.cell(), &Contact { lead: Vec3::ZERO, ..*contact });
            bend(a, on_a) + bend(b, on_b)
        };
        let turn = of_each(&chosen, both);
        let gaps = Gaps {
            rows,
            inverse_mass: rigid.inverse_mass(),
            gap: &gap,
            size: &size,
            fall: world.gravity.length() * step * step,
            turn: &turn,
            tolerance: self.settings.solver.tolerance,
            parameters: &self.parameters.overlap,
        };
        let correction = gaps.correct();
        let finite = correction.displacement.iter().flatten().all(|x| x.is_finite());
        if finite { correction } else { Correction { displacement: None, ..correction } }
    }

    /// What is left to do once the world is where the step takes it.
    pub(super) fn finish(
        &mut self,
        world: &mut World,
        start: &Placement,
        contacts: Vec<Contact>,
        attempt: Attempt,
        size: &[f64],
        correction: &Correction,
        ahead: Vec<Contact>,
        mut laps: Laps,
    ) -> StepReport {
        let begin = Clock::now();
        let step = self.settings.step;
        let Attempt {
            problem,
            posed,
            cell,
            impulse,
            active,
            pulls,
            joints,
            impacts,
            velocity,
            mut solve,
            parts,
            ..
        } = attempt;
        let left = impacts.residual.judged(self.settings.solver.judge);
        if left > self.settings.solver.tolerance.max(self.parameters.impacts.tolerance)
            && solve.status == Status::Converged
        {
            solve.status = Status::IterationLimit;
            solve.remark = Some(format!("impacts were left at residual {left:.1e}"));
        }
        let normal_sum: f64 = impulse[..3 * active.len()].iter().step_by(3).sum();
        let threshold = 1e-6 * normal_sum / active.len().max(1) as f64;
        let mut with_force: Vec<bool> = impacts.impulse.iter().map(|g| *g != Vec3::ZERO).collect();
        with_force.resize(contacts.len(), false);
        let mut world_impulse = impacts.impulse;
        world_impulse.resize(contacts.len(), Vec3::ZERO);
        let resists = world.materials.resist_turning();
        let mut moment = if resists { vec![Vec3::ZERO; contacts.len()] } else { Vec::new() };
        if let Delassus::Rigid(rigid) = &*problem.delassus {
            for ((&i, row), g) in active.iter().zip(rigid.contacts()).zip(impulse.chunks_exact(3)) {
                let [n, t1, t2] = row.frame.map(Vec3::from_array);
                world_impulse[i as usize] += g[0] * n + g[1] * t1 + g[2] * t2;
                with_force[i as usize] |= g[0] > threshold;
            }
            for (rows, h) in rigid.turning().iter().zip(impulse[3 * active.len()..].chunks_exact(3)) {
                let row = &rigid.contacts()[rows.contact as usize];
                moment[active[rows.contact as usize] as usize] = world_moment(row, rows.length, h);
            }
        }
        for ((impulse, contact), pull) in world_impulse.iter_mut().zip(&contacts).zip(&pulls) {
            *impulse -= *pull * contact.normal;
        }
        let friction = pair_property(world, &contacts, |a, b| world.materials.pair_friction(a, b));
        let chosen = chosen_of(&contacts, &active);
        let chosen_size: Vec<f64> = active.iter().map(|&i| size[i as usize]).collect();
        let mut u = Vec::new();
        if let Delassus::Rigid(rigid) = &*problem.delassus {
            u = relative_velocities(cell.as_ref(), &chosen, rigid.contacts(), &velocity);
            u.extend(turning_velocities(&chosen, rigid.contacts(), rigid.turning(), &velocity));
        }
        let accuracy = (step, self.settings.solver.tolerance);
        let errors = PhysicalErrors::of(&chosen, &chosen_size, (&problem, &impulse), &u, accuracy);
        drop(chosen);
        let curvature = solve.curvature.or(world.contacts.curvature);
        let set = ContactSet { contacts, impulse: world_impulse, friction, moment, curvature };
        let wrenches = wrenches(&start.position, cell.as_ref(), world, &set, step);
        let (before, kinetic_energy) = (start.velocities(), world.kinetic_energy());
        let change = kinetic_energy + taken_along(world, &velocity) - start.kinetic_energy;
        let forces = (&set, joints.impulses.as_slice());
        let places = (start.position.as_slice(), cell.as_ref());
        load::add_drag(world, &velocity);
        let ledger = energy::ledger(world, forces, places, [&before, &velocity], step, change);
        let collider = &self.collider;
        let overlap = |contact: &Contact| {
            let depth = (-contact.gap).max(0.0);
            [depth, if depth > 0.0 { depth / collider.contact_size(world, contact) } else { 0.0 }]
        };
        let deeper = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].max(b[1])];
        let [deepest, over_size] = ahead.par_iter().map(overlap).reduce(|| [0.0; 2], deeper);
        let work = correction.displacement.as_ref().map_or(0.0, |displacement| {
            let against = |(b, d): (usize, &[f64])| {
                -world.bodies.mass[b] * world.gravity.dot(Vec3::from_slice(&d[..3]))
            };
            displacement.chunks_exact(6).enumerate().map(against).sum()
        });
        world.record_joints(&joints.states, step);
        world.contacts = set;
        world.time += step;
        world.step += 1;
        self.ahead = Some((world.fingerprint(), ahead));
        laps.add(|phases| &mut phases.integrate, begin.lap());
        let (phases, processor) = laps.seconds();
        let report = StepReport {
            contacts: world.contacts.contacts.len(),
            contacts_with_force: with_force.iter().filter(|&&force| force).count(),
            parts,
            solve,
            penetration_max: deepest,
            penetration_max_over_size: over_size,
            kinetic_energy,
            ledger,
            errors,
            impacts: impacts.count,
            impact_residual: impacts.residual,
            restitution_lowered: impacts.lowered,
            contacts_added: 0,
            contacts_missed: 0,
            overlap_corrected_max: correction.overlap_max,
            correction_energy: work,
            phases,
            processor,
            wrenches,
        };
        self.last = Some((posed.unwrap_or(problem), impulse));
        report
    }
}
