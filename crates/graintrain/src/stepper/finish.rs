//! What is left of a step once it is solved: the overlap removed, the report made, what the next step starts
//! from kept.

use super::attempt::{Attempt, chosen_of};
use super::placement::{Placement, taken_along};
use super::repetition::Rounds;
use super::{Made, Stepper};
use crate::assemble::{OverlapCorrection, contact_rows, of_each, pair_property, relative_velocities};
use crate::clock::Clock;
use crate::contact::{Contact, ContactSet};
use crate::elasticity;
use crate::impact::Impacts;
use crate::integrate::{displace, inverse_mass, velocities};
use crate::joint::mechanism::coupled_in_impacts;
use crate::joint::{PlacedJoint, drift};
use crate::load;
use crate::math::Vec3;
use crate::measure::energy;
use crate::overlap::{Correction, Gaps, Share};
use crate::step_report::{PhysicalErrors, StepReport, wrenches};
use crate::turning::{turning_velocities, world_moment};
use crate::world::World;
use graintrain_ccp::{CoupledBodies, Delassus, RigidContact, SolveReport, Status};
use hashbrown::HashMap;
use rayon::prelude::*;

/// The groups of bodies that joints couple where they are.
fn coupled(world: &World, step: f64) -> Vec<CoupledBodies> {
    if world.joints().is_empty() {
        Vec::new()
    } else {
        coupled_in_impacts(world, &mut velocities(world), step)
    }
}

/// What displacements change of every body, bit by bit: place, orientation and spin.
fn poses(world: &World) -> Vec<[u64; 10]> {
    let bodies = &world.bodies;
    let pose = |body: usize| {
        let ([x, y, z], [u, v, w]) = (bodies.position[body].into(), bodies.angular_velocity[body].into());
        let [a, b, c, d] = bodies.orientation[body].into();
        [x, y, z, u, v, w, a, b, c, d].map(f64::to_bits)
    };
    (0..bodies.len()).map(pose).collect()
}

/// A correction without displacements that are no numbers.
fn finite(correction: Correction) -> Correction {
    let finite = correction.displacement.iter().flatten().all(|x| x.is_finite());
    if finite { correction } else { Correction { displacement: None, ..correction } }
}

/// Overlap over the size of the smaller body that a step must not go beyond.
const OVERLAP: f64 = 0.01;

impl Stepper {
    /// Displacements that remove overlap at the end of the step.
    pub(super) fn correct(
        &mut self,
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
        let chosen = chosen_of(attempt.posed_with(contacts), &active);
        let u = relative_velocities(attempt.cell.as_ref(), &chosen, rows, &attempt.velocity);
        let gap: Vec<f64> = chosen.iter().zip(u.chunks_exact(3)).map(|(c, u)| c.gap + step * u[0]).collect();
        let size: Vec<f64> = active.iter().map(|&i| size[i as usize]).collect();
        let gaps = Gaps {
            rows,
            inverse_mass: rigid.inverse_mass(),
            gap: &gap,
            size: &size,
            share: Share::Slow(world.gravity.length() * step * step),
            tolerance: self.settings.solver.tolerance,
            parameters: &self.parameters.overlap,
            stop: self.stop.clone(),
        };
        finite(gaps.correct(|| coupled(world, step), self.impacts.as_mut()))
    }

    /// Removes, where bodies are at the end of the step, the overlap that no contact of the step foresaw
    /// because they turned.
    pub(super) fn remove_unforeseen(
        &mut self,
        world: &mut World,
        rounds: &mut Rounds,
        start: &Placement,
        made: &mut Made,
    ) {
        if self.settings.overlap == OverlapCorrection::Velocity {
            return;
        }
        let begin = Clock::now();
        let step = self.settings.step;
        let trigger = self.parameters.overlap.trigger(self.settings.solver.tolerance);
        let mut least = f64::INFINITY;
        for round in 0..self.parameters.overlap.rounds {
            let Made { attempt, correction, ahead, .. } = made;
            let collider = &self.collider;
            let is_deep = |c: &&Contact| -c.gap > trigger * collider.contact_size(world, c);
            let deep: Vec<Contact> = ahead.par_iter().filter(is_deep).copied().collect();
            if deep.is_empty() {
                break;
            }
            let mut foreseen = self.foreseen(start, rounds, attempt, &deep.iter().collect::<Vec<_>>());
            for (identity, (gap, _)) in &mut foreseen {
                // A plane linearised anew foresees what it was made for.
                *gap = rounds.planes.allowed(*identity).unwrap_or(*gap);
            }
            let errors = self.unforeseen(world, &deep, &foreseen, correction);
            let wrong = deep.iter().filter(|c| errors.contains_key(&c.identity));
            let now = wrong.map(|c| -c.gap).fold(0.0, f64::max);
            if round >= 3 && now > self.parameters.overlap.progress * least {
                break;
            }
            least = now.min(least);
            let Some(displacement) = self.without(world, ahead, &errors, correction) else { break };
            let before = poses(world);
            displace(world, &displacement);
            correction.add(Some(displacement));
            correction.add(drift::close(world, &attempt.joints.states, step));
            let moved: Vec<bool> = poses(world).iter().zip(&before).map(|(now, old)| now != old).collect();
            let envelope = self.settings.envelope;
            *ahead = self.as_driven(world, after(world.time, step), |stepper, world| {
                stepper.collider.contacts_again(world, (ahead, &moved), envelope, step)
            });
        }
        rounds.laps.add(|phases| &mut phases.collide, begin.lap());
    }

    /// The overlap, m, that was not foreseen at those of the `deep` contacts where it counts, by identity.
    /// `foreseen` are the gaps that they were to have without the displacements before; what is not among
    /// them no contact foresaw.
    fn unforeseen(
        &self,
        world: &World,
        deep: &[Contact],
        foreseen: &HashMap<u64, (f64, Contact)>,
        correction: &Correction,
    ) -> HashMap<u64, f64> {
        let (collider, kept) = (&self.collider, self.parameters.overlap.kept);
        let moved = match &correction.displacement {
            Some(displacement) => relative_velocities(None, deep, &contact_rows(world, deep), displacement),
            None => Vec::new(),
        };
        let error = |(i, contact): (usize, &Contact)| {
            let known = foreseen.get(&contact.identity);
            // A displacement may close what is open, and no further.
            let after = |gap: f64| (gap + moved.get(3 * i).unwrap_or(&0.0)).max(gap.min(0.0));
            let end = known.map_or(0.0, |&(gap, _)| after(gap));
            let error = end - contact.gap;
            (!elasticity::gives(world, contact) && error > kept * collider.contact_size(world, contact))
                .then_some((contact.identity, error))
        };
        deep.iter().enumerate().filter_map(error).collect()
    }

    /// The displacements that remove this overlap from the contacts `ahead`, if there is any.
    fn without(
        &mut self,
        world: &World,
        ahead: &[Contact],
        errors: &HashMap<u64, f64>,
        correction: &mut Correction,
    ) -> Option<Vec<f64>> {
        if errors.is_empty() {
            return None;
        }
        let (collider, parameters) = (&self.collider, &self.parameters.overlap);
        let rows = contact_rows(world, ahead);
        let error = of_each(ahead, |c| errors.get(&c.identity).copied().unwrap_or(0.0));
        let size = of_each(ahead, |c| collider.contact_size(world, c));
        // Overlap that was foreseen is left to the correction before.
        let of_end = |(contact, &error): (&Contact, &f64)| {
            contact.gap.max(if error > 0.0 { contact.gap } else { 0.0 })
        };
        let gap: Vec<f64> = ahead.iter().zip(&error).map(of_end).collect();
        let gaps = Gaps {
            rows: &rows,
            inverse_mass: &inverse_mass(world),
            gap: &gap,
            size: &size,
            share: Share::Unforeseen(&error),
            tolerance: self.settings.solver.tolerance,
            parameters,
            stop: self.stop.clone(),
        };
        let more = finite(gaps.correct(|| coupled(world, self.settings.step), self.impacts.as_mut()));
        correction.overlap_max = correction.overlap_max.max(more.overlap_max);
        correction.overlap_max_over_size = correction.overlap_max_over_size.max(more.overlap_max_over_size);
        more.displacement
    }

    /// What is left to do once the world is where the step takes it.
    pub(super) fn finish(
        &mut self,
        world: &mut World,
        rounds: Rounds,
        start: &Placement,
        made: Made,
    ) -> StepReport {
        let begin = Clock::now();
        let Made { mut attempt, kicked, lost, size, correction, ahead } = made;
        let Rounds { contacts, overlaps, added, undetected, iterations, mut laps, .. } = rounds;
        let step = self.settings.step;
        let apart = self.apart(world, start, &contacts, &attempt, &ahead);
        laps.add(|phases| &mut phases.collide, begin.lap());
        let begin = Clock::now();
        let errors = self.left_over(&contacts, &attempt, &size);
        let deepened = self.deepened(world, &overlaps, &ahead);
        let contacts = attempt.moved.take().unwrap_or(contacts);
        let (mut set, with_force) = exerted(world, contacts, &attempt);
        let Attempt { problem, posed, cell, impulse, joints, impacts, velocity, mut solve, parts, .. } =
            attempt;
        let wrenches = wrenches(&start.position, cell.as_ref(), world, &set, step);
        let kinetic_energy = world.kinetic_energy();
        let change = kinetic_energy + taken_along(world, &velocity) - start.kinetic_energy;
        let forces = (&set, joints.impulses.as_slice());
        let places = (start.position.as_slice(), cell.as_ref());
        load::add_drag(world, &velocity);
        let ledger = energy::ledger(world, forces, places, [&start.velocities(), &kicked], step, change);
        let [penetration_max, penetration_max_over_size] = self.deepest(world, &ahead);
        let correction_energy = correction.work(&world.bodies.mass, world.gravity);
        world.record_joints(&joints.states, step);
        let joint_opening_max = self.check(world, &impacts, deepened, &mut solve);
        solve.iterations = iterations;
        impacts.carry(&mut set.contacts);
        world.contacts = set;
        world.time = after(world.time, step);
        world.step += 1;
        // A search that was stopped has found a part of them.
        let time = world.time;
        let state = self.as_driven(world, time, |_, world| world.fingerprint());
        self.ahead = self.go_on().is_ok().then_some((state, ahead));
        laps.add(|phases| &mut phases.integrate, begin.lap());
        let (phases, processor) = laps.seconds();
        self.last = Some((posed.unwrap_or(problem), impulse));
        StepReport {
            contacts: world.contacts.contacts.len(),
            contacts_with_force: with_force,
            parts,
            solve,
            penetration_max,
            penetration_max_over_size,
            kinetic_energy,
            ledger,
            errors: PhysicalErrors { joint_opening_max, momentum_lost_max: lost, ..errors },
            impacts: impacts.count,
            impact_residual: impacts.residual,
            restitution_lowered: impacts.lowered,
            contacts_added: added,
            contacts_missed: undetected,
            contacts_apart: apart.count,
            impulse_apart_max: apart.impulse_max,
            overlap_corrected_max: correction.overlap_max,
            correction_energy,
            phases,
            processor,
            wrenches,
        }
    }

    /// What the solve left of the contact problem.
    fn left_over(&self, contacts: &[Contact], attempt: &Attempt, size: &[f64]) -> PhysicalErrors {
        let Attempt { problem, cell, impulse, turned, active, velocity, .. } = attempt;
        let Delassus::Rigid(rigid) = &*problem.delassus else { return PhysicalErrors::default() };
        let chosen = chosen_of(attempt.posed_with(contacts), active);
        let size: Vec<f64> = active.iter().map(|&i| size[i as usize]).collect();
        let mut u = relative_velocities(cell.as_ref(), &chosen, rigid.contacts(), velocity);
        u.iter_mut().zip(turned).for_each(|(u, turned)| *u += turned);
        u.extend(turning_velocities(&chosen, rigid.contacts(), rigid.turning(), velocity));
        let accuracy = (self.settings.step, self.settings.solver.tolerance);
        PhysicalErrors::of(&chosen, &size, (problem, impulse), &u, accuracy)
    }

    /// The deepest overlap of these contacts, m, and the deepest over the size of the smaller body.
    fn deepest(&self, world: &World, contacts: &[Contact]) -> [f64; 2] {
        let collider = &self.collider;
        let overlap = |contact: &Contact| {
            let depth = (-contact.gap).max(0.0);
            [depth, if depth > 0.0 { depth / collider.contact_size(world, contact) } else { 0.0 }]
        };
        let deeper = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].max(b[1])];
        contacts.par_iter().map(overlap).reduce(|| [0.0; 2], deeper)
    }

    /// The deepest overlap over the size of the smaller body that the step made deeper than its tolerance
    /// allows, and its contact, of those `ahead`; `start` is by how much pairs overlapped then. Joints that
    /// can only be closed into what they were to carry end so.
    fn deepened<'c>(
        &self,
        world: &World,
        start: &[([u32; 2], f64)],
        ahead: &'c [Contact],
    ) -> Option<(f64, &'c Contact)> {
        let (collider, tolerance) = (&self.collider, self.settings.solver.tolerance);
        let share = |contact: &Contact| -contact.gap / collider.contact_size(world, contact);
        let is_deep = |contact: &&Contact| {
            // What an elastic contact overlaps is its own affair.
            share(contact) > OVERLAP.max(tolerance) && !elasticity::gives(world, contact)
        };
        let deep: Vec<&Contact> = ahead.par_iter().filter(is_deep).collect();
        if deep.is_empty() {
            return None;
        }
        let mut before: HashMap<[u32; 2], f64> = HashMap::new();
        for &(pair, overlap) in start {
            let known = before.entry(pair).or_default();
            *known = known.max(overlap);
        }
        let deepens = |contact: &&Contact| {
            let before = before.get(&contact.unordered()).copied().unwrap_or(0.0);
            -contact.gap > before + tolerance * collider.contact_size(world, contact)
        };
        let deepest = deep.into_iter().filter(deepens).max_by(|a, b| share(a).total_cmp(&share(b)))?;
        Some((share(deepest), deepest))
    }

    /// A step whose impacts were not solved, whose joints are open or that made bodies overlap has not
    /// converged. Returned is the largest opening of a joint, m.
    fn check(
        &self,
        world: &World,
        impacts: &Impacts,
        deepened: Option<(f64, &Contact)>,
        solve: &mut SolveReport,
    ) -> f64 {
        let (opening_max, open) = drift::openings(world);
        let left = impacts.residual.measured(self.settings.solver.criterion);
        let of_joint = |joint: usize| {
            let PlacedJoint { joint: own, state, .. } = &world.joints()[joint];
            let held_up = if own.is_driven() { ", or its motor held up," } else { "" };
            format!("{} is open{held_up} by {:.1e} m", world.joint_label(joint), state.opening)
        };
        let of_overlap = |(share, contact): (f64, &Contact)| {
            let [a, b] = [contact.body_a, contact.body_b].map(|body| world.bodies.label(body as usize));
            format!(
                "{a} and {b} overlap by {:.1} % of the smaller one's size, more than before",
                100.0 * share
            )
        };
        let remark = if left > self.settings.solver.tolerance.max(self.parameters.impacts.tolerance) {
            Some(format!("impacts were left at residual {left:.1e}"))
        } else {
            open.map(of_joint).or(deepened.map(of_overlap))
        };
        if remark.is_some() && solve.status == Status::Converged {
            (solve.status, solve.remark) = (Status::IterationLimit, remark);
        }
        opening_max
    }
}

/// What the contacts of a step exerted, impacts included, and how many of them did noticeably.
fn exerted(world: &World, contacts: Vec<Contact>, attempt: &Attempt) -> (ContactSet, usize) {
    let Attempt { problem, impulse: solved, active, pulls, impacts, solve, .. } = attempt;
    let normal_sum: f64 = solved[..3 * active.len()].iter().step_by(3).sum();
    let threshold = 1e-6 * normal_sum / active.len().max(1) as f64;
    let mut with_force: Vec<bool> = impacts.impulse.iter().map(|g| *g != Vec3::ZERO).collect();
    with_force.resize(contacts.len(), false);
    let mut impulse = impacts.impulse.clone();
    impulse.resize(contacts.len(), Vec3::ZERO);
    let mut bounced = if impacts.impulse.is_empty() { Vec::new() } else { with_force.clone() };
    let resists = world.materials.resist_turning();
    let mut moment = if resists { vec![Vec3::ZERO; contacts.len()] } else { Vec::new() };
    if let Delassus::Rigid(rigid) = &*problem.delassus {
        for ((&i, row), g) in active.iter().zip(rigid.contacts()).zip(solved.chunks_exact(3)) {
            let [n, t1, t2] = row.frame.map(Vec3::from_array);
            impulse[i as usize] += g[0] * n + g[1] * t1 + g[2] * t2;
            with_force[i as usize] |= g[0] > threshold;
            if let Some(bounced) = bounced.get_mut(i as usize) {
                *bounced &= g[0] == 0.0;
            }
        }
        for (rows, h) in rigid.turning().iter().zip(solved[3 * active.len()..].chunks_exact(3)) {
            let row = &rigid.contacts()[rows.contact as usize];
            moment[active[rows.contact as usize] as usize] = world_moment(row, rows.length, h);
        }
    }
    for ((impulse, contact), pull) in impulse.iter_mut().zip(&contacts).zip(pulls) {
        *impulse -= *pull * contact.normal;
    }
    let friction = pair_property(world, &contacts, |a, b| world.materials.pair_friction(a, b));
    let curvature = solve.curvature.or(world.contacts.curvature);
    let count = with_force.into_iter().filter(|&force| force).count();
    (ContactSet { contacts, impulse, friction, moment, bounced, curvature }, count)
}

/// The time a step after `time`, s: where that is a whole number of steps from zero, their product, so that
/// no sum of rounded steps drifts; where the step is 1 / n s, the quotient: 9 steps of 1 ms are 0.009 s.
pub(super) fn after(time: f64, step: f64) -> f64 {
    let sum = time + step;
    let (count, rate) = ((sum / step).round(), (1.0 / step).round());
    if (count * step - sum).abs() > 1e-6 * step {
        sum
    } else if (rate * step - 1.0).abs() < 1e-12 {
        count / rate
    } else {
        count * step
    }
}

#[cfg(test)]
mod tests {
    use super::after;

    #[test]
    fn times_are_the_numbers_nearest_to_whole_steps() {
        for (step, end) in [(1e-3, 3.0), (2.5e-2, 75.0), (1.0 / 3.0, 1e3)] {
            let mut time = 0.0;
            for _ in 0..3000 {
                time = after(time, step);
            }
            assert_eq!(time, end);
        }
        assert_eq!((0..9).fold(0.0, |time, _| after(time, 1e-3)), 0.009);
        // A run that goes on from between steps.
        assert_eq!(after(0.4e-3, 1e-3), 1.4e-3);
    }
}
