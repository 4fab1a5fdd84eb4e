//! The solve of a step: impacts, the contact problem with joints and periodic cell, velocities; nothing is
//! moved.

use super::bend::bends;
use super::error::check_velocity;
use super::flight::unreached;
use super::mobility;
use super::repetition::Rounds;
use super::{StepError, Stepper};
use crate::assemble::{
    OverlapCorrection, assemble, contact_rows, of_each, relative_velocities, scale_under, warm_start,
};
use crate::cell::{Cell, moved_mass};
use crate::cell_problem::CellRows;
use crate::clock::Clock;
use crate::contact::Contact;
use crate::elasticity;
use crate::frame_turn::turned_slip;
use crate::impact::{ImpactSolver, Impacts, Rows, flying, mean_in_flight};
use crate::integrate::{free_velocity, inverse_mass, inverse_mass_in_step};
use crate::joint::mechanism::{JointReactions, Mechanisms};
use crate::math::Vec3;
use crate::part_solver::{PartSolver, Solved};
use crate::world::World;
use graintrain_ccp::{
    BodyInverseMass, Ccp, CcpError, Delassus, RigidContact, SolveReport, SolveSettings, Status,
};
use graintrain_linalg::parallel::axpy;
use hashbrown::{HashMap, HashSet};
use std::borrow::Cow;

/// What parts of few contacts are solved to, over the tolerance, where motors and stops are bounds.
const ROUGH: f64 = 1e-2;

/// Further solves of the contacts in which components of a periodic cell that are held at their largest rates
/// may be released; after that what is held stays so, which ends.
const CELL_ROUNDS: usize = 6;

/// A component that would be slower than its largest rate by more than this share must not be held there.
const CELL_AGREES: f64 = 1e-2;

/// A solved contact problem with what a periodic cell does.
struct WithCell {
    solved: Solved,
    /// The problem as it was solved, where the cell takes part.
    posed: Option<Ccp>,
    /// The cell of the start with the rates after the step.
    cell: Option<Cell>,
}

/// A solved step before it is made.
pub(super) struct Attempt {
    pub(super) problem: Ccp,
    /// The problem as it was solved, where a periodic cell takes part.
    pub(super) posed: Option<Ccp>,
    /// The periodic cell at the start of the step with the rates after it.
    pub(super) cell: Option<Cell>,
    /// The contacts of the step with planes moved out of the way of bodies that part, after impacts.
    pub(super) moved: Option<Vec<Contact>>,
    /// Impulses of the contact problem, contact frames.
    pub(super) impulse: Vec<f64>,
    /// Contacts of the problem as indices into those of the step.
    pub(super) active: Vec<u32>,
    /// Of the contacts of the problem ([`turned_slip`]).
    pub(super) turned: Vec<f64>,
    /// Contacts of the step that are none of the problem because nothing can move along their normals.
    pub(super) immobile: Vec<u32>,
    /// Impulses with which the contacts of the step pull, N s; empty where none do.
    pub(super) pulls: Vec<f64>,
    pub(super) joints: JointReactions,
    pub(super) impacts: Impacts,
    /// Without contacts.
    pub(super) free: Vec<f64>,
    pub(super) velocity: Vec<f64>,
    pub(super) solve: SolveReport,
    pub(super) parts: usize,
}

impl Attempt {
    /// The contacts of the step as the problem was posed with them.
    pub(super) fn posed_with<'a>(&'a self, contacts: &'a [Contact]) -> &'a [Contact] {
        self.moved.as_deref().unwrap_or(contacts)
    }

    /// What the contact at this place among those of the step gives body A, impacts included, N s.
    pub(super) fn push(&self, place: usize) -> Vec3 {
        let mut push = self.impacts.impulse.get(place).copied().unwrap_or(Vec3::ZERO);
        if let (Delassus::Rigid(rigid), Ok(k)) =
            (&*self.problem.delassus, self.active.binary_search(&(place as u32)))
        {
            let axes = rigid.contacts()[k].frame.map(Vec3::from_array);
            push += axes.into_iter().zip(&self.impulse[3 * k..]).map(|(axis, g)| *g * axis).sum::<Vec3>();
        }
        push
    }

    /// The changes of velocity (u, w) that contacts of two bodies (places among those of the step,
    /// themselves, and rows) give them, in the order of [`Contact::unordered`].
    pub(super) fn response(
        &self,
        places: &[usize],
        contacts: &[Contact],
        rows: &[RigidContact],
    ) -> [[Vec3; 2]; 2] {
        let Delassus::Rigid(rigid) = &*self.problem.delassus else { return Default::default() };
        let bodies = contacts[0].unordered();
        let mut impulses = bodies.map(|body| (body, [0.0; 6]));
        for ((&place, contact), row) in places.iter().zip(contacts).zip(rows) {
            let push = self.push(place);
            for (body, arm, push) in [(contact.body_a, row.arm_a, push), (contact.body_b, row.arm_b, -push)] {
                let moment = Vec3::from_array(arm).cross(push);
                let both = push.to_array().into_iter().chain(moment.to_array());
                let (_, sum) = &mut impulses[usize::from(body != bodies[0])];
                sum.iter_mut().zip(both).for_each(|(sum, part)| *sum += part);
            }
        }
        rigid.response(impulses).map(|change| [0, 3].map(|first| Vec3::from_slice(&change[first..first + 3])))
    }
}

/// The contact problem of a step, posed again where joints have to be other than foreseen.
struct Posing<'a> {
    world: &'a World,
    /// dt, s, and what becomes of overlap.
    how: (f64, OverlapCorrection),
    mechanisms: Mechanisms<'a>,
    /// Contacts of the problem, and their places among those of the step.
    chosen: Cow<'a, [Contact]>,
    active: Vec<u32>,
    problem: Ccp,
    /// Velocities without contacts: with joints that nothing else pulls at.
    free: Vec<f64>,
    /// Of its contacts ([`turned_slip`]).
    turned: Vec<f64>,
    /// Attempts at this step so far that did not converge.
    unsolved: usize,
}

impl<'a> Posing<'a> {
    fn new(
        world: &'a World,
        how: (f64, OverlapCorrection),
        contacts: &'a [Contact],
        (rows, masses): (Vec<RigidContact>, Vec<BodyInverseMass>),
        mechanisms: Mechanisms<'a>,
    ) -> Self {
        let (problem, free, turned) = pose(world, how, &mechanisms, contacts, (rows, masses));
        let active = (0..contacts.len() as u32).collect();
        Self { world, how, mechanisms, chosen: contacts.into(), active, problem, free, turned, unsolved: 0 }
    }

    /// Poses the problem anew, as the joints now are.
    fn again(&mut self) {
        let stays: Vec<usize> = (0..self.active.len()).collect();
        self.keep(&stays);
    }

    /// Poses the problem anew with these of its contacts.
    fn keep(&mut self, stays: &[usize]) {
        let Delassus::Rigid(rigid) = &*self.problem.delassus else { return };
        let rows = of_each(stays, |&k| rigid.contacts()[k]);
        let masses = rigid.inverse_mass().to_vec();
        if stays.len() < self.active.len() {
            self.active = of_each(stays, |&k| self.active[k]);
            self.chosen = of_each(stays, |&k| self.chosen[k]).into();
        }
        (self.problem, self.free, self.turned) =
            pose(self.world, self.how, &self.mechanisms, &self.chosen, (rows, masses));
    }

    /// Leaves out the contacts along whose normals nothing can move, but for those that bodies are driven
    /// into; returned are their places among those of the step.
    fn leave_immobile_out(&mut self, driven: &HashSet<u64>) -> Vec<u32> {
        let mut immobile = mobility::immobile(self.world, &self.problem, self.how.0);
        immobile.retain(|&k| !driven.contains(&self.chosen[k].identity));
        let left_out = of_each(&immobile, |&k| self.active[k]);
        if !immobile.is_empty() {
            let stays: Vec<usize> =
                (0..self.active.len()).filter(|k| immobile.binary_search(k).is_err()).collect();
            self.keep(&stays);
        }
        left_out
    }

    /// The impulses to start from: those of the last attempt or of the last step. `pulls` are those of the
    /// contacts of the step.
    fn start(&self, pulls: &[f64], last: Option<&Attempt>) -> Vec<f64> {
        let world = self.world;
        let own: Vec<f64> = self.active.iter().filter_map(|&i| pulls.get(i as usize).copied()).collect();
        let mut impulse = warm_start(&self.problem, &self.chosen, &own, &world.contacts, world.bodies.len());
        if let Some(last) = last {
            start_from(last, &self.problem, &mut impulse);
        }
        impulse
    }
}

/// The problem of these contacts with joints that nothing else pulls at, the velocities without contacts, and
/// what frames that turn make of the slip.
fn pose(
    world: &World,
    (step, overlap): (f64, OverlapCorrection),
    mechanisms: &Mechanisms<'_>,
    contacts: &[Contact],
    (rows, masses): (Vec<RigidContact>, Vec<BodyInverseMass>),
) -> (Ccp, Vec<f64>, Vec<f64>) {
    let free = mechanisms.unmet();
    let masses = (masses, mechanisms.coupled());
    let turned = turned_slip(world, contacts, &rows, [mechanisms.before(), &free], step);
    let problem = assemble(world, contacts, rows, masses, (&free, &turned), step, overlap);
    (problem, free, turned)
}

impl Stepper {
    /// Solves the step from the state of the world without moving anything.
    pub(super) fn attempt(
        &mut self,
        world: &World,
        rounds: &mut Rounds,
        last: Option<Attempt>,
    ) -> Result<Attempt, StepError> {
        self.go_on()?;
        let begin = Clock::now();
        let (step, contacts) = (self.settings.step, &rounds.contacts);
        let rows = contact_rows(world, contacts);
        let masses = inverse_mass(world);
        let impacting = Clock::now();
        let impacts =
            self.resolve_impacts(world, Rows { contacts, rows: &rows, inverse_mass: &masses }, &rounds.met)?;
        let impact_lap = impacting.lap();
        let mut free = free_velocity(world, &impacts.velocity, step);
        // In impacts drag has no time to act.
        let masses = if world.drag.is_empty() { masses } else { inverse_mass_in_step(world, step) };
        let pulls = elasticity::pulls(world, contacts, |c| self.collider.contact_size(world, c), step);
        elasticity::apply_pulls(&rows, &pulls, &masses, &mut free);
        let mut mechanisms = Mechanisms::new(world, &masses, &impacts.velocity, free, step);
        mechanisms.predict(&[]);
        let moved = self.parted(world, rounds, &impacts, (&rows, &mechanisms));
        let contacts = moved.as_deref().unwrap_or(contacts);
        let how = (step, self.settings.overlap);
        let mut posing = Posing::new(world, how, contacts, (rows, masses), mechanisms);
        posing.unsolved = rounds.unsolved;
        let immobile = posing.leave_immobile_out(&rounds.driven);
        let mut impulse = posing.start(&pulls, last.as_ref());
        let mut bounded = None;
        let solving = Clock::now();
        let is_loaded = !posing.mechanisms.is_empty() && !posing.chosen.is_empty();
        if is_loaded {
            posing.mechanisms.predict(&body_impulses(&posing.problem, &impulse));
        }
        if is_loaded || posing.mechanisms.are_undecided() {
            bounded = self.bound(&mut posing, &mut impulse)?;
            posing.again();
        }
        let WithCell { mut solved, posed, cell } =
            self.solve_with_cell(&mut posing, &impacts, &pulls, &mut impulse)?;
        if let Some(earlier) = bounded {
            solved.report = solved.report.after(&earlier);
        }
        let (on_bodies, agrees) = self.agree(&mut posing, &mut impulse, &mut solved)?;
        let Posing { mechanisms, active, problem, free, turned, .. } = posing;
        let Solved { report: mut solve, parts } = solved;
        let mut velocity = velocity_after(&problem, &impulse, free.clone());
        mechanisms.velocities(&on_bodies, &mut velocity);
        check_velocity(world, &velocity)?;
        let joints = mechanisms.reactions(&on_bodies);
        check_joints(world, &joints, &self.solve_settings(), &mut solve);
        if !agrees && solve.status == Status::Converged {
            solve.status = Status::IterationLimit;
            let rounds = self.parameters.repetition.joint_rounds;
            solve.remark =
                Some(format!("motors, stops, swings and contacts did not agree in {rounds} rounds"));
        }
        rounds.iterations += solve.iterations;
        rounds.unsolved += usize::from(!solve.converged());
        rounds.laps.add(|phases| &mut phases.assemble, solving - begin);
        rounds.laps.subtract(|phases| &mut phases.assemble, impact_lap);
        rounds.laps.add(|phases| &mut phases.solve, impact_lap);
        rounds.laps.add(|phases| &mut phases.solve, solving.lap());
        Ok(Attempt {
            moved,
            problem,
            posed,
            cell,
            impulse,
            turned,
            active,
            immobile,
            pulls,
            joints,
            impacts,
            free,
            velocity,
            solve,
            parts,
        })
    }

    /// The contacts of a step after its impacts, with the planes of what passes, as it moves where joints
    /// alone hold it, moved out of its way: also those of where bodies came from that part now, but for what
    /// was seen to be met; of bodies that impacts deflect, for what was seen to be met again after that.
    /// `None` where all are as they were. Balls that no impact deflects were looked at before.
    fn parted(
        &self,
        world: &World,
        rounds: &Rounds,
        impacts: &Impacts,
        (rows, mechanisms): (&[RigidContact], &Mechanisms<'_>),
    ) -> Option<Vec<Contact>> {
        let is_ball = |body: u32| self.collider.is_ball(world, body as usize);
        let of_balls = |c: &Contact| is_ball(c.body_a) && is_ball(c.body_b);
        let free = mechanisms.unmet();
        let motions = [&impacts.velocity, free.as_slice()];
        if impacts.count == 0 && rounds.contacts.iter().all(of_balls) {
            let unreached = self.unreached(world, rounds, (&rounds.contacts, rows), motions);
            return (!unreached.is_empty()).then(|| raised(rounds.contacts.clone(), unreached));
        }
        // With the spin of now, unless joints turn it: its mean in the step, with which the problem is posed,
        // is that of a body that turns on the way. What flies goes by the means of both velocities; but balls
        // are looked at as impacts left them, as their planes are.
        let flies = flying(world, self.settings.step);
        let mut velocity = free.clone();
        let both = velocity.chunks_exact_mut(6).zip(impacts.velocity.chunks_exact(6));
        for (body, (own, after)) in both.enumerate() {
            if flies[body] && !is_ball(body as u32) {
                let mean = mean_in_flight([&impacts.velocity, &free], body);
                own.chunks_exact_mut(3).zip(mean).for_each(|(own, of)| own.copy_from_slice(&of.to_array()));
            } else {
                own[3..].copy_from_slice(&after[3..]);
            }
        }
        for spin in mechanisms.bodies().map(|body| 6 * body as usize + 3..6 * body as usize + 6) {
            velocity[spin.clone()].copy_from_slice(&free[spin]);
        }
        let posed = relative_velocities(world.cell(), &rounds.contacts, rows, &free);
        let mut moved = self.flown_past(world, &rounds.contacts, (&velocity, &posed), &bends(world, &free));
        // Where bodies meet more others than that, planes gather, or they would take turns for ever.
        let is_early = 2 * rounds.round < self.parameters.repetition.rounds;
        let mut deflected = HashSet::new();
        for (before, impulse) in rounds.contacts.iter().zip(&impacts.impulse) {
            if impulse.length_squared() > 0.0 {
                let pair = [before.body_a, before.body_b];
                deflected.extend(pair.into_iter().filter(|&body| !world.is_prescribed(body as usize)));
            }
        }
        for (now, before) in moved.iter_mut().zip(&rounds.contacts) {
            let is_deflected = [before.body_a, before.body_b].iter().any(|body| deflected.contains(body));
            if rounds.times_met(before) > usize::from(is_deflected && is_early) {
                *now = *before;
            }
        }
        let gone_on = impacts.gone_on(&rounds.contacts);
        let mut touched = Vec::new();
        for (i, before) in rounds.contacts.iter().enumerate().filter(|(i, c)| gone_on[*i].gap != c.gap) {
            moved[i] = gone_on[i];
            if impacts.impulse.get(i).is_some_and(|g| *g != Vec3::ZERO) {
                touched.push((i, before.gap));
            }
        }
        let unreached = self.unreached(world, rounds, (&moved, rows), motions);
        // What has touched parts from no nearer than it was.
        touched.extend(unreached);
        Some(raised(moved, touched))
    }

    /// See [`unreached`]: of contacts that spring back, and that were not seen to be met.
    fn unreached(
        &self,
        world: &World,
        rounds: &Rounds,
        of: (&[Contact], &[RigidContact]),
        motions: [&[f64]; 2],
    ) -> Vec<(usize, f64)> {
        // What does not spring back may as well land: the next step would take its velocity.
        let material = |body: u32| world.bodies.material[body as usize].index();
        let springs =
            |c: &Contact| world.materials.pair_restitution(material(c.body_a), material(c.body_b)) > 0.0;
        let seen = (&self.collider, self.unseen());
        let mut unreached = unreached(world, of, seen, motions, self.settings.step, springs);
        unreached.retain(|&(i, _)| rounds.times_met(&rounds.contacts[i]) == 0);
        unreached
    }

    /// The impacts before the step.
    fn resolve_impacts(
        &mut self,
        world: &World,
        of: Rows<'_>,
        met: &HashMap<u64, usize>,
    ) -> Result<Impacts, StepError> {
        let unseen = self.unseen();
        let mut impacts = ImpactSolver {
            solver: self.impacts.as_mut(),
            collider: &self.collider,
            spurious: self.parameters.repetition.spurious,
            unseen,
            parameters: &self.parameters.impacts,
            friction: self.settings.solver.friction,
            met,
            stop: self.stop.clone(),
        };
        impacts.resolve(world, of, self.settings.step)?.ok_or(StepError::Stopped)
    }

    /// Finds what motors with a limit and stops do, in one problem with the contacts, where one of the motors
    /// is not at its limit or nothing else finds it. What was done for that is returned.
    fn bound(
        &mut self,
        posing: &mut Posing<'_>,
        impulse: &mut [f64],
    ) -> Result<Option<SolveReport>, StepError> {
        let bounds = posing.mechanisms.loosen(&body_impulses(&posing.problem, impulse));
        if bounds.is_empty() {
            return Ok(None);
        }
        posing.again();
        let Some((problem, start)) = posing.mechanisms.bounded(&posing.problem, &posing.free, &bounds) else {
            return Ok(None);
        };
        let at = 3 * posing.active.len();
        let mut all = [&impulse[..at], &start, &impulse[at..]].concat();
        // Which of them act is all that is asked for.
        let tolerance = std::mem::replace(&mut self.parameters.parts.few.tolerance, ROUGH);
        let solved = self.solve(posing.world, &problem, &mut all, posing.unsolved);
        self.parameters.parts.few.tolerance = tolerance;
        let report = solved?.report;
        posing.mechanisms.hold(&bounds, (&problem, at / 3), &all);
        all.drain(at..at + start.len());
        if report.converged() {
            impulse.copy_from_slice(&all);
        }
        posing.mechanisms.predict(&body_impulses(&posing.problem, impulse));
        Ok(Some(report))
    }

    /// Solves again until motors, stops and swings are what the contacts were solved for, and tells whether
    /// they are. Returned with that are the impulses of contacts on every body, six numbers each; none
    /// without joints.
    fn agree(
        &mut self,
        posing: &mut Posing<'_>,
        impulse: &mut [f64],
        solved: &mut Solved,
    ) -> Result<(Vec<f64>, bool), StepError> {
        let tolerance = self.settings.solver.tolerance;
        let (mut on_bodies, mut agrees) = (Vec::new(), posing.mechanisms.is_empty());
        if !agrees {
            on_bodies = body_impulses(&posing.problem, impulse);
        }
        for _ in 0..self.parameters.repetition.joint_rounds {
            agrees = agrees || posing.mechanisms.agree(&on_bodies, tolerance);
            if agrees || solved.report.status == Status::Stopped {
                break;
            }
            posing.mechanisms.predict(&on_bodies);
            posing.again();
            let again = self.solve(posing.world, &posing.problem, impulse, posing.unsolved)?;
            *solved = Solved { report: again.report.after(&solved.report), ..again };
            on_bodies = body_impulses(&posing.problem, impulse);
        }
        if solved.report.status == Status::Stopped {
            Err(StepError::Stopped)
        } else {
            Ok((on_bodies, agrees))
        }
    }

    /// Solves the problem together with the rates of a periodic cell whose stress is imposed. A component
    /// that comes beyond its largest rate is held there, as by a press that can go no faster, as long as its
    /// stress and the contacts together would make it faster: below, the whole stress acts on it. r follows
    /// the rates.
    fn solve_with_cell(
        &mut self,
        posing: &mut Posing<'_>,
        impacts: &Impacts,
        pulls: &[f64],
        impulse: &mut [f64],
    ) -> Result<WithCell, CcpError> {
        let Posing { world, chosen, active, problem, unsolved, .. } = posing;
        let mut cell = world.cell().cloned();
        let (time, step) = (world.time, self.settings.step);
        let mass = moved_mass(world);
        let rows = match (&cell, &*problem.delassus) {
            (Some(cell), Delassus::Rigid(rigid)) if cell.has_stress() => {
                Some(CellRows::new(cell, chosen, rigid.contacts(), |k| cell.inertia(k, mass, time, step)))
            }
            _ => None,
        };
        let (Some(loose), Some(cell_now)) = (rows, &mut cell) else {
            let solved = self.solve(world, problem, impulse, *unsolved)?;
            return Ok(WithCell { solved, posed: None, cell });
        };
        let pulls: Vec<f64> = active.iter().filter_map(|&i| pulls.get(i as usize).copied()).collect();
        let by_pulls = loose.change_by_pulls(&pulls);
        let change: [f64; 6] = std::array::from_fn(|k| impacts.rate[k] + by_pulls[k]);
        let free: [f64; 6] = std::array::from_fn(|k| cell_now.rate[k] + change[k]);
        loose.shift(&change, &mut problem.r);
        let mut held: [Option<f64>; 6] = [None; 6];
        let (mut last, mut rounds): (Option<SolveReport>, usize) = (None, 0);
        loop {
            rescale(problem, world.gravity.length(), step);
            let mut rows = loose.clone();
            rows.hold(|k| held[k].is_some());
            let posed = (!rows.is_empty()).then(|| rows.posed(problem));
            let mut solved = self.solve(world, posed.as_ref().unwrap_or(problem), impulse, *unsolved)?;
            if let Some(last) = &last {
                solved.report = solved.report.after(last);
            }
            let by_contacts = loose.rate_change(impulse);
            let unheld: [f64; 6] = std::array::from_fn(|k| free[k] + by_contacts[k]);
            cell_now.rate = unheld;
            let beyond = cell_now.beyond(time, step);
            let next: [Option<f64>; 6] =
                std::array::from_fn(|k| held[k].filter(|_| rounds >= CELL_ROUNDS).or(beyond[k]));
            cell_now.rate = std::array::from_fn(|k| held[k].unwrap_or(unheld[k]));
            if next == held || solved.report.status == Status::Stopped {
                check_cell(cell_now, time, step, &mut solved.report);
                let is_slower = |k: usize| held[k].is_some_and(|at| unheld[k] / at < 1.0 - CELL_AGREES);
                if (0..6).any(is_slower) && solved.report.status == Status::Converged {
                    solved.report.status = Status::IterationLimit;
                    solved.report.remark =
                        Some("the largest rates of the periodic cell and its contacts did not agree".into());
                }
                return Ok(WithCell { solved, posed, cell });
            }
            let rate = |limit: [Option<f64>; 6], k: usize| limit[k].unwrap_or(free[k]);
            loose.shift(&std::array::from_fn(|k| rate(next, k) - rate(held, k)), &mut problem.r);
            (held, last, rounds) = (next, Some(solved.report), rounds + 1);
        }
    }

    /// Solves the problem part by part.
    fn solve(
        &mut self,
        world: &World,
        problem: &Ccp,
        impulse: &mut [f64],
        unsolved: usize,
    ) -> Result<Solved, CcpError> {
        let settings = SolveSettings { curvature: world.contacts.curvature, ..self.solve_settings() };
        // A method that keeps something from step to step has to see the same problem again.
        let whole = self.settings.solver.name.keeps_between_steps();
        let (gravity, step) = (world.gravity.length(), self.settings.step);
        let parameters = &self.parameters.parts;
        PartSolver { solver: self.solver.as_mut(), settings, parameters, whole, gravity, step, unsolved }
            .solve(problem, impulse)
    }
}

/// Contacts with larger gaps at some places.
fn raised(mut contacts: Vec<Contact>, gaps: Vec<(usize, f64)>) -> Vec<Contact> {
    for (i, gap) in gaps {
        contacts[i].gap = contacts[i].gap.max(gap);
    }
    contacts
}

/// The contacts at these places, ascending: all of them as they are, in most steps.
pub(super) fn chosen_of<'a>(contacts: &'a [Contact], active: &[u32]) -> Cow<'a, [Contact]> {
    if active.len() == contacts.len() {
        return contacts.into();
    }
    of_each(active, |&i| contacts[i as usize]).into()
}

/// Impulses of an earlier attempt at the contacts that it had in its problem.
fn start_from(last: &Attempt, problem: &Ccp, impulse: &mut [f64]) {
    let places: HashMap<u64, usize> =
        last.problem.identity.iter().enumerate().map(|(k, &identity)| (identity, k)).collect();
    for (identity, g) in problem.identity.iter().zip(impulse.chunks_exact_mut(3)) {
        if let Some(k) = places.get(identity) {
            g.copy_from_slice(&last.impulse[3 * k..3 * k + 3]);
        }
    }
    for (k, own) in problem.turning.iter().enumerate() {
        let place = places.get(&problem.identity[own.contact as usize]);
        if let Some(known) = place.and_then(|&place| last.problem.turning_of(place)) {
            let [from, to] = [(&last.problem, known), (problem, k)].map(|(p, k)| 3 * (p.num_contacts() + k));
            impulse[to..to + 3].copy_from_slice(&last.impulse[from..from + 3]);
        }
    }
}

/// Impulses of contacts on every body and their moments about its centre, six numbers each.
fn body_impulses(problem: &Ccp, impulse: &[f64]) -> Vec<f64> {
    let Delassus::Rigid(rigid) = &*problem.delassus else { return Vec::new() };
    let mut world_impulse = vec![0.0; impulse.len()];
    rigid.world_impulse(impulse, &mut world_impulse);
    (0..rigid.num_bodies()).flat_map(|body| rigid.body_impulse(&world_impulse, body)).collect()
}

/// V of a problem whose r has changed, under gravity (m/s^2) in a step (s).
fn rescale(problem: &mut Ccp, gravity: f64, step: f64) {
    let contacts = 3 * problem.num_contacts();
    problem.velocity_scale = scale_under(gravity, step, &problem.r[..contacts], &problem.friction);
}

/// Joints that open count in the residual, and a solve that leaves them open has not converged.
fn check_joints(world: &World, joints: &JointReactions, settings: &SolveSettings, solve: &mut SolveReport) {
    if joints.states.is_empty() {
        return;
    }
    for residual in [&mut solve.residual, &mut solve.residual_relaxed, &mut solve.residual_coulomb] {
        *residual = residual.worse(joints.residual);
    }
    let measured = joints.residual.measured(settings.criterion);
    if (measured.is_nan() || measured > settings.tolerance) && solve.status == Status::Converged {
        solve.status = Status::IterationLimit;
        let name = world.joint_label(joints.worst);
        if joints.is_lost {
            solve.remark = Some(format!(
                "{name} would hold by forces beyond all bounds: its motor, or another one, drives it against joints, stops or driven bodies; a largest torque or force helps"
            ));
            return;
        }
        solve.remark = Some(format!(
            "{name} opens at {:.1e} m/s: joints, stops or driven bodies contradict each other, or bodies turn too far in a step",
            joints.opening
        ));
    }
    if let Some((joint, energy)) = joints.gained
        && solve.status == Status::Converged
    {
        let name = world.joint_label(joint);
        solve.status = Status::IterationLimit;
        solve.remark = Some(format!("{name} and those about it gave {energy:.1e} J where they only hold"));
    }
}

/// A cell that opens against its stress as fast as a step can follow has not found the rates that its
/// contacts bear.
fn check_cell(cell: &Cell, time: f64, step: f64, solve: &mut SolveReport) {
    if let Some(name) = cell.thrown_open(time, step)
        && solve.status == Status::Converged
    {
        solve.status = Status::IterationLimit;
        solve.remark = Some(format!(
            "the periodic cell opens along {name} against its stress as fast as a step can follow: the stress is too large for a step of {step} s"
        ));
    }
}

/// v+ = free + M^-1 D g, six numbers per body.
fn velocity_after(problem: &Ccp, impulse: &[f64], free: Vec<f64>) -> Vec<f64> {
    let mut velocity = free;
    if let Delassus::Rigid(rigid) = &*problem.delassus {
        // Impulses, and after them the moments of contacts that resist turning.
        let mut world_impulse = vec![0.0; impulse.len()];
        rigid.world_impulse(impulse, &mut world_impulse);
        let mut change = vec![0.0; velocity.len()];
        rigid.velocity_change(&world_impulse, &mut change);
        axpy(1.0, &change, &mut velocity);
    }
    velocity
}
