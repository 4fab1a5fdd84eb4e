//! Impacts: Newton's law of restitution, before the contact problem of the step.
//!
//! A contact that is going to close within the step at a noticeable velocity is an impact. Impacts are
//! resolved on the velocities before the step, in passes: those contacts that close now are solved together,
//!
//! ```text
//! v' = v + M^-1 D g,   Y_i contains g_i perpendicular to D_i^T v' + (e_i D_i,n^T v, 0, 0) in Y_i^*
//! ```
//!
//! so that each parts with e times the velocity at which it touches; then those that still close, or close
//! because of it, and so on, until none is left. A pass takes the contacts that touch first among those of
//! their bodies. Forces, and contacts that rest or only touch, are left to the contact problem,
//! which starts from v'.
//!
//! A contact with a gap Phi touches only after it, at u_t^2 = u^2 + 2 a Phi under a relative acceleration a,
//! and has lost the height Phi again when it is back where the step finds it: there it parts with
//! `u'^2 = e^2 u_t^2 - 2 a Phi`, of which `square_at_start` makes the e_i above. So a ball that falls on what
//! is held or rests reaches e^2 times its height at any step. What does not come back so far is no impact
//! yet: the contact problem lands it, and its impact is that of the next step. What nothing carries and does
//! not fly either (`x + dt u+`: bodies in joints or with prescribed motions, under forces that depend on the
//! place) has velocities of the middle of a step: there u is u + dt a / 2 (`to_now`), which comes back
//! e-fold. Balls that meet nothing else, and what falls without a turn on what is driven, keep time as well
//! (`touch`): they go on as they were until they touch, and with v' from then on. Joints hold in impacts,
//! motors with a limit and springs have no time to act, and stops neither. Rolling and spinning friction act
//! on lasting contact alone: their moments grow with the time that a contact takes, which an impact does not
//! have. A collision that runs through a row of bodies (Newton's cradle) takes one pass per contact.
//!
//! Without friction and with one e_i for all contacts a pass cannot make energy (J. J. Moreau, "Unilateral
//! contact and dry friction in finite freedom dynamics", 1988: e = 1 keeps it exactly); with friction, or
//! with several e, Newton's law can (T. R. Kane, D. A. Levinson, "Dynamics", 1985). Where it would, the
//! impulses are taken on the line from those of a plastic impact to these, as far as energy allows: both lie
//! in the cones, and so do those between. In effect e is lowered for one connected part. Passes in turn: B.
//! Smith, D. Kaufman, E. Vouga, R. Tamstorf, E. Grinspun, "Reflections on simultaneous impact", ACM
//! Transactions on Graphics 31(4):106, 2012.

mod flight;
mod meeting;
mod touch;

pub(crate) use self::flight::{Flight, carried, flying, mean_in_flight};

use self::flight::{carrying, to_now};
use self::touch::Shift;
use crate::assemble::{of_each, pair_property, relative_velocities, velocity_of};
use crate::cell::{COMPONENTS, Cell, moved_mass};
use crate::cell_problem::CellRows;
use crate::collide::Collider;
use crate::contact::Contact;
use crate::integrate::{free_velocity, free_velocity_of, velocities, with_driven};
use crate::joint::mechanism::coupled_in_impacts;
use crate::math::Vec3;
use crate::parts::{Part, parts};
use crate::world::World;
use graintrain_ccp::{
    BodyInverseMass, Ccp, CcpError, CcpSolver, CoupledBodies, Delassus, FrictionModel, Residual,
    RigidContact, SolveSettings, Status,
};
use hashbrown::HashMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What the passes over impacts are tuned by. Values: docs/mechanics.md, "Restitution"; held by
/// `tests/physics/energy.rs` and the impacts of `graintrain verify` (A7 to A9, A20, A25).
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Passes of one step; what closes after the last is left to the contact problem, as a plastic impact,
    /// and counted as lowered.
    pub passes: usize,
    /// An approach slower than this fraction of a dt, with the larger acceleration a of both bodies under
    /// gravity and external forces, or that of the edges of a cell under its stress, is no impact: a resting
    /// body arrives with what the last step's solve left over.
    pub resting: f64,
    /// Residual to which a pass is solved, in the velocities of its own contacts.
    pub tolerance: f64,
    /// Iterations of a pass.
    pub iterations: usize,
    /// Energy that an impact makes, relative to the magnitude of its terms, above which restitution is
    /// lowered; less is the error of its solve.
    pub lowered: f64,
}

impl Default for Parameters {
    fn default() -> Self {
        Self { passes: 30, resting: 0.1, tolerance: 1e-9, iterations: 3000, lowered: 1e-6 }
    }
}

/// Contacts whose touches are nearer in time than this fraction of a step touch together.
const SAME_TIME: f64 = 1e-6;

/// What touches within this fraction of the end of a step does so in the next one: contacts that touch
/// together would close in two steps by rounding alone.
pub(crate) const LAST: f64 = 1e-9;

/// Approaches below this fraction of the largest relative velocity are rounding.
const ROUNDING: f64 = 1e-12;

/// What the impacts of a step did.
#[derive(Clone, Debug, Default)]
pub(crate) struct Impacts {
    /// Velocities after the impacts, six numbers per body; those of prescribed degrees of freedom are the
    /// ones before the step.
    pub velocity: Vec<f64>,
    /// What they change of the rates of a periodic cell whose stress is imposed, 1/s.
    pub rate: [f64; 6],
    /// Impulse on body A of every contact, world axes, N s; empty where there was no impact.
    pub impulse: Vec<Vec3>,
    /// Bodies that end the step elsewhere than with `velocity` all the way, in their order.
    pub shift: Vec<Shift>,
    /// By how much contacts have another gap where their bodies begin the step as they go on, m; empty: none.
    pub gap_change: Vec<f64>,
    /// Contacts resolved, over all passes.
    pub count: usize,
    /// Parts in which restitution was lowered, because it would have made energy, and contacts that still
    /// closed after the last pass.
    pub lowered: usize,
    /// The worst residual that a solve was left with, in the velocities of its own contacts.
    pub residual: Residual,
}

/// Contacts of a step, row by row of D.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a> {
    pub contacts: &'a [Contact],
    pub rows: &'a [RigidContact],
    pub inverse_mass: &'a [BodyInverseMass],
}

/// What contacts do in impacts, one number each, and what bodies are held by.
struct Laws<'a> {
    restitution: Vec<f64>,
    friction: Vec<f64>,
    coupled: Vec<CoupledBodies>,
    pressed: Option<Pressed<'a>>,
}

/// Solves the small problems of impacts.
pub(crate) struct ImpactSolver<'a> {
    pub solver: &'a mut dyn CcpSolver,
    pub collider: &'a Collider,
    /// See [`crate::stepper::RepetitionParameters::spurious`].
    pub spurious: f64,
    /// What bodies may overlap by unseen, as a fraction of the smaller one's size.
    pub unseen: f64,
    pub parameters: &'a Parameters,
    pub friction: FrictionModel,
    /// Contacts that were seen to be met, by identity.
    pub met: &'a HashMap<u64, usize>,
    pub stop: Option<Arc<AtomicBool>>,
}

impl ImpactSolver<'_> {
    /// The impacts of a step that begins in this state; `None` as soon as a stop was asked for.
    ///
    /// # Errors
    /// Those of the solver.
    pub(crate) fn resolve(
        &mut self,
        world: &World,
        of: Rows<'_>,
        step: f64,
    ) -> Result<Option<Impacts>, CcpError> {
        let mut velocity = velocities(world);
        let restitution = pair_property(world, of.contacts, |a, b| world.materials.pair_restitution(a, b));
        let timed = touch::timed(world, self.collider, of.contacts, (&restitution, self.unseen), step);
        if restitution.iter().all(|&e| e == 0.0) && !timed.contains(&true) {
            return Ok(Some(Impacts { velocity, ..Impacts::default() }));
        }
        let friction = pair_property(world, of.contacts, |a, b| world.materials.pair_friction(a, b));
        let pressed = Pressed::of(world, step);
        let (coupled, projected) = along_joints(world, &mut velocity, step);
        let laws = Laws { restitution, friction, coupled, pressed };
        let before = Impacts { velocity, ..Impacts::default() };
        let Some(mut found) = self.passes(world, of, (&laws, timed), before, step)? else {
            return Ok(None);
        };
        for Projected { body, before, along } in projected {
            let known = before.iter().zip(&along);
            let velocity = found.velocity[6 * body..6 * body + 6].iter_mut();
            velocity.zip(known).for_each(|(v, (before, along))| *v = before + (*v - along));
        }
        Ok(Some(found))
    }

    /// All passes from these velocities, with the time of those contacts kept that are `timed`.
    fn passes(
        &mut self,
        world: &World,
        of: Rows<'_>,
        (laws, timed): (&Laws<'_>, Vec<bool>),
        mut found: Impacts,
        step: f64,
    ) -> Result<Option<Impacts>, CcpError> {
        let Laws { restitution, coupled, pressed, .. } = laws;
        let pushed = pressed.as_ref().map_or(0.0, Pressed::speed);
        let (held, seen) = ((coupled.as_slice(), pressed.as_ref()), (self.collider, self.unseen));
        let mut motion = Motion::of(world, of, held, seen, &found.velocity, step);
        motion.timed = timed;
        let relative = motion.now.chunks_exact(3).map(|u| Vec3::from_slice(u).length());
        let rounding = ROUNDING * relative.fold(0.0, f64::max);
        let slow = of_each(of.contacts, |c| {
            let [a, b] = [c.body_a, c.body_b].map(|body| world.acceleration(body as usize));
            (self.parameters.resting * (a.max(b) * step).max(pushed)).max(rounding)
        });
        for pass in 0..=self.parameters.passes {
            let [mut closing, approaching] = self.closing(world, of, (&motion, restitution, &slow), step);
            // What meets more others than that in a step meets the rest of them at once.
            if 2 * pass < self.parameters.passes {
                let both = [closing.as_slice(), &approaching];
                closing = self.first_of_bodies(world, of.contacts, coupled, both, (&motion, step));
            }
            if pass == self.parameters.passes {
                found.lowered += closing.len();
                break;
            }
            if closing.is_empty() {
                break;
            }
            found.impulse.resize(of.contacts.len(), Vec3::ZERO);
            let mut moved = vec![false; world.bodies.len()];
            let mut all = parts(of.rows, closing.iter().copied(), world.bodies.len(), coupled);
            if pressed.is_some() {
                all = joined_by_cell(all, of.contacts);
            }
            // The rest of what one meets that is no impact yet waits for it.
            let comes_back =
                |&i: &u32| motion.comes_back(world, of, i as usize, restitution[i as usize], step);
            all.retain(|part| part.contacts.iter().any(comes_back));
            if all.is_empty() {
                break;
            }
            let (before, mut touched) = (motion.now.clone(), Vec::new());
            for part in all {
                let touch = motion.touch(world, of, &part, restitution, step);
                let arriving = match &touch {
                    Some((_, velocity)) => (velocity.clone(), part.gather::<1, f64>(restitution)),
                    None => motion.arriving(&part, restitution, step),
                };
                let Some(()) = self.solve(&part, of, (laws, arriving), &mut found)? else {
                    return Ok(None);
                };
                part.bodies.iter().for_each(|&body| moved[body as usize] = true);
                if let Some((time, _)) = touch {
                    touched.extend(part.bodies.iter().map(|&body| (body, time)));
                }
            }
            motion.update(world, of, &found, step, &moved);
            motion.keep_time(of.contacts, &touched, &before);
            found.shift.extend(touched.into_iter().map(|touch| Shift::of(world, &found.velocity, touch)));
        }
        found.shift.sort_by_key(|shift| shift.body);
        if !found.shift.is_empty() {
            let change = |(gap, contact): (&f64, &Contact)| gap - contact.gap;
            found.gap_change = motion.gap.iter().zip(of.contacts).map(change).collect();
        }
        Ok(Some(found))
    }

    /// The contacts that are impacts as the bodies move now, and others that approach.
    fn closing(
        &self,
        world: &World,
        of: Rows<'_>,
        (motion, restitution, slow): (&Motion, &[f64], &[f64]),
        step: f64,
    ) -> [Vec<u32>; 2] {
        // Without restitution only what is known in time is an impact: the rest is for the contact problem.
        // What rests had no velocity in the middle of the last step either.
        let approaches = |i: &u32| {
            let i = *i as usize;
            let (u, by_now) = (motion.now[3 * i], motion.by_now[3 * i]);
            (restitution[i] > 0.0 || motion.is_timed(i)) && u.max(u - by_now) < -slow[i]
        };
        let closes = |i: &u32| {
            let i = *i as usize;
            let gap = motion.gap[i];
            // What was seen to be met has its plane as it is in the contact problem, too.
            let is_met = self.met.contains_key(&of.contacts[i].identity);
            let u = if is_met { motion.later[3 * i] } else { motion.mean(i) };
            gap <= 0.0 || gap + (1.0 - LAST) * step * u <= 0.0
        };
        let approaching = (0..of.contacts.len() as u32).filter(approaches);
        let (closing, approaching): (Vec<u32>, Vec<u32>) = approaching.partition(closes);
        // Where bodies go on from elsewhere, nothing is looked at.
        let (gone_on, closing): (Vec<u32>, Vec<u32>) =
            closing.into_iter().partition(|&i| motion.gap[i as usize] != of.contacts[i as usize].gap);
        let closing = self.meeting(world, of.contacts, motion, closing, step);
        let mut closing = self.along_normals_of_touch(world, of.contacts, motion, closing, step);
        closing.extend(gone_on);
        closing.sort_unstable();
        [closing, approaching]
    }

    /// One part of a pass; `u` and `restitution` are the velocities before it and what comes back of them.
    fn solve(
        &mut self,
        part: &Part,
        of: Rows<'_>,
        (laws, (u, restitution)): (&Laws<'_>, (Vec<f64>, Vec<f64>)),
        found: &mut Impacts,
    ) -> Result<Option<()>, CcpError> {
        let Laws { friction, coupled, pressed, .. } = laws;
        let cell = pressed.as_ref().map(|pressed| pressed.rows(part, of)).filter(|rows| !rows.is_empty());
        let mut delassus = part.delassus(of.rows, of.inverse_mass, coupled);
        if let Some(cell) = &cell {
            delassus = cell.put_into(delassus);
        }
        let plastic = Ccp::bare(Delassus::Rigid(delassus), u.clone(), part.gather::<1, f64>(friction));
        let mut elastic = plastic.clone();
        for (u, e) in elastic.r.chunks_exact_mut(3).zip(&restitution) {
            u[0] *= 1.0 + e;
        }
        let Some(mut g) = self.impulses(&elastic, found)? else { return Ok(None) };
        let mut work = plastic.delassus.work();
        let mut change = vec![0.0; g.len()];
        plastic.delassus.multiply(&g, &mut change, &mut work);
        let (gain, scale) = energy(&g, &u, &change);
        if gain > self.parameters.lowered * scale {
            found.lowered += 1;
            let Some(start) = self.impulses(&plastic, found)? else { return Ok(None) };
            lower(&plastic.delassus, &u, &start, &mut g, &change);
            plastic.delassus.multiply(&g, &mut change, &mut work);
        } else if gain > 0.0 {
            // The error of the solve: on the ray of g energy is kept where g . u + 1/2 s g . N g = 0.
            let along: f64 = g.iter().zip(&u).map(|(g, u)| g * u).sum();
            let s = -along / (gain - along);
            g.iter_mut().for_each(|g| *g *= s);
            plastic.delassus.multiply(&g, &mut change, &mut work);
        }
        for (k, &body) in part.bodies.iter().enumerate() {
            for (v, dv) in
                found.velocity[6 * body as usize..].iter_mut().zip(&work.body_velocity()[6 * k..6 * k + 6])
            {
                *v += dv;
            }
        }
        if let Some(cell) = cell {
            found.rate.iter_mut().zip(cell.rate_change(&g)).for_each(|(rate, change)| *rate += change);
        }
        for (g, &i) in g.chunks_exact(3).zip(&part.contacts) {
            let [n, t1, t2] = of.rows[i as usize].frame.map(Vec3::from_array);
            found.impulse[i as usize] += g[0] * n + g[1] * t1 + g[2] * t2;
        }
        found.count += part.contacts.len();
        Ok(Some(()))
    }

    fn impulses(&mut self, problem: &Ccp, found: &mut Impacts) -> Result<Option<Vec<f64>>, CcpError> {
        let mut g = vec![0.0; problem.r.len()];
        let settings = SolveSettings {
            tolerance: self.parameters.tolerance,
            max_iterations: Some(self.parameters.iterations),
            friction: self.friction,
            stop: self.stop.clone(),
            ..SolveSettings::default()
        };
        let report = self.solver.solve(problem, &mut g, &settings)?;
        found.residual = found.residual.worse(report.residual);
        Ok((report.status != Status::Stopped).then_some(g))
    }
}

/// Gives contacts of pairs with restitution, or whose time is kept, the arms that they have when the
/// bodies touch, where they still have a gap to close: from each centre to the own surface. With half a gap
/// more the spin that friction gives would depend on the phase of arrival. Balls that touch within the step
/// as they move now get the normal of that moment, too: that of the start of the step is off by the way
/// sideways.
pub(crate) fn lead_to_surfaces(
    world: &World,
    (collider, unseen): (&Collider, f64),
    step: f64,
    contacts: &mut [Contact],
) {
    let restitution = pair_property(world, contacts, |a, b| world.materials.pair_restitution(a, b));
    let timed = touch::timed(world, collider, contacts, (&restitution, unseen), step);
    for (i, contact) in contacts.iter_mut().enumerate() {
        let is_impact = restitution[i] > 0.0 || timed.get(i) == Some(&true);
        if is_impact && contact.gap > 0.0 && contact.lead == Vec3::ZERO {
            match collider.arrival_of_balls(world, contact, step) {
                Some(arrival) => *contact = arrival,
                None => contact.lead = 0.5 * contact.gap * contact.normal,
            }
        }
    }
}

/// The velocities of a body in joints, and those along the joints where they are now.
struct Projected {
    body: usize,
    before: [f64; 6],
    along: [f64; 6],
}

/// Makes velocities those that joints let bodies have. That of the middle of the last step is off them by
/// half the turn of a step, and so are the approaches that impacts would start from. What joints take away
/// here they take in the step itself, too, which tells their forces: afterwards only what impacts add stays.
fn along_joints(world: &World, velocity: &mut [f64], step: f64) -> (Vec<CoupledBodies>, Vec<Projected>) {
    if world.joints().is_empty() {
        return Default::default();
    }
    let mut along = with_driven(world, velocity, step);
    let coupled = coupled_in_impacts(world, &mut along, step);
    let bodies = coupled.iter().flat_map(|mechanism| &mechanism.bodies);
    let projected = bodies
        .map(|&body| {
            let body = body as usize;
            let six = |v: &[f64]| std::array::from_fn(|k| v[6 * body + k]);
            let own = Projected { body, before: six(velocity), along: six(&along) };
            velocity[6 * body..6 * body + 6].copy_from_slice(&own.along);
            own
        })
        .collect();
    (coupled, projected)
}

/// How contacts close, m/s, three numbers each.
struct Motion {
    /// Velocities of the bodies after the step if no contact acted, six numbers each.
    free: Vec<f64>,
    /// Velocities now, those of prescribed degrees of freedom as in the step.
    driven: Vec<f64>,
    /// What has been added there to velocities of the middle of the last step ([`to_now`]), six numbers per
    /// body; and what that makes of the contacts.
    to_now: Vec<f64>,
    by_now: Vec<f64>,
    /// Relative velocities of the contacts with `driven` and with `free`.
    now: Vec<f64>,
    later: Vec<f64>,
    /// By how much contacts close faster after the step because their bodies fall, one number each: as
    /// joints let them, and those that no contact carried in the last step.
    fall: Vec<f64>,
    /// By how much contacts close less fast in the mean of the step than `later` says, because their bodies
    /// fly or go on being carried, m/s.
    slower: Vec<f64>,
    /// Whether each body flies ([`Flight`]).
    flies: Vec<bool>,
    /// Their gaps, m: of those that have touched, where they would have begun the step as they go on.
    gap: Vec<f64>,
    /// Whether their time of touch is kept; empty: of none.
    timed: Vec<bool>,
    /// The periodic cell as it deforms now, and as it would after the step if no contact acted.
    cells: [Option<Cell>; 2],
    /// What impacts have changed of its rates, 1/s.
    rate: [f64; 6],
}

impl Motion {
    fn of(
        world: &World,
        of: Rows<'_>,
        (coupled, pressed): (&[CoupledBodies], Option<&Pressed<'_>>),
        seen: (&Collider, f64),
        velocity: &[f64],
        step: f64,
    ) -> Self {
        let free = free_velocity(world, velocity, step);
        let mut driven = with_driven(world, velocity, step);
        let mut falling = free.clone();
        if !coupled.is_empty() {
            coupled_in_impacts(world, &mut falling, step);
        }
        let is_carried = carrying(world).any(|contact| contact.image != [0; 3]);
        let carried = carried(world);
        let flight = Flight::of(world, &carried, seen, [&driven, &free], step);
        // A link that a contact carries does not hold the rest of its mechanism.
        let mut is_linked = vec![false; world.bodies.len()];
        let links = coupled.iter().flat_map(|mechanism| &mechanism.bodies);
        links.for_each(|&body| is_linked[body as usize] = true);
        for body in (0..carried.len()).filter(|&body| carried[body] && !is_linked[body]) {
            let six = 6 * body..6 * body + 6;
            falling[six.clone()].copy_from_slice(&driven[six]);
        }
        let after = world.cell().cloned();
        let mut before = after.clone();
        if let (Some(cell), Some(pressed)) = (&mut before, pressed) {
            cell.rate.iter_mut().zip(pressed.pushes).for_each(|(rate, push)| *rate -= push);
        }
        let cells = [before, after];
        let in_cell = |k: usize, v: &[f64]| relative_velocities(cells[k].as_ref(), of.contacts, of.rows, v);
        let (mut now, later) = (in_cell(0, &driven), in_cell(1, &free));
        let falling_of = in_cell(usize::from(!is_carried), &falling);
        let fall = now.iter().zip(&falling_of).step_by(3).map(|(now, falling)| now - falling).collect();
        let to_now = to_now(world, coupled, [&driven, &free], step);
        driven.iter_mut().zip(&to_now).for_each(|(v, more)| *v += more);
        let by_now = relative_velocities(None, of.contacts, of.rows, &to_now);
        now.iter_mut().zip(&by_now).for_each(|(now, more)| *now += more);
        let slower: Vec<f64> = flight.mean.iter().zip(&free).map(|(mean, free)| mean - free).collect();
        let slower = relative_velocities(None, of.contacts, of.rows, &slower);
        let slower = slower.into_iter().step_by(3).zip(of.contacts);
        let slower = slower.map(|(u, contact)| if flight.has(contact) { u } else { 0.0 }).collect();
        let gap = of.contacts.iter().map(|c| c.gap).collect();
        let (timed, rate) = (Vec::new(), [0.0; 6]);
        let flies = flight.flies;
        Self { free, driven, to_now, by_now, now, later, fall, slower, flies, gap, timed, cells, rate }
    }

    /// Velocities at which the contacts of a part close now, three numbers each, and the restitutions with
    /// which they part at the start of the step.
    fn arriving(&self, part: &Part, restitution: &[f64], step: f64) -> (Vec<f64>, Vec<f64>) {
        let at_start = |&i: &u32| self.square_at_start(i as usize, restitution[i as usize], step);
        let parting = part.contacts.iter().map(|i| at_start(i).clamp(0.0, 1.0).sqrt());
        (part.gather::<3, f64>(&self.now), parting.collect())
    }

    fn square_at_start(&self, i: usize, e: f64, step: f64) -> f64 {
        square_at_start(e, self.now[3 * i], self.fall[i] / step * self.gap[i].max(0.0))
    }

    fn is_timed(&self, i: usize) -> bool {
        self.timed.get(i) == Some(&true)
    }

    /// Whether a contact comes back so far that it is an impact of this step.
    fn comes_back(&self, world: &World, of: Rows<'_>, i: usize, e: f64, step: f64) -> bool {
        let is_timed = || self.is_timed(i) && self.touch_of(world, of, i, e, step).is_some();
        e > 0.0 && self.square_at_start(i, e, step) >= 0.0 || is_timed()
    }

    /// The normal velocity of a contact in the mean of the step if no contact acted.
    fn mean(&self, i: usize) -> f64 {
        self.later[3 * i] + self.slower[i]
    }

    /// How a body goes through the step if no contact acts, u and w (m/s, rad/s): as it moves now, or
    /// `falling` as after the step; what flies by [`mean_in_flight`].
    fn way(&self, body: u32, falling: bool) -> [Vec3; 2] {
        let body = body as usize;
        let [now, free] = [&self.driven, &self.free];
        match (self.flies[body], falling) {
            (true, _) => mean_in_flight([now, free], body),
            (false, true) => velocity_of(free, body),
            (false, false) => velocity_of(now, body),
        }
    }

    /// Normal velocities of a contact: now, and after the step if no contact acted.
    fn normal(&self, contact: usize) -> [f64; 2] {
        [&self.now, &self.later].map(|u| u[3 * contact])
    }

    /// After these bodies got other velocities, and the cell other rates: only what they touch has changed.
    fn update(&mut self, world: &World, of: Rows<'_>, found: &Impacts, step: f64, moved: &[bool]) {
        for body in (0..moved.len()).filter(|&body| moved[body]) {
            let six = 6 * body..6 * body + 6;
            self.free[six].copy_from_slice(&free_velocity_of(world, &found.velocity, body, step));
            for (k, dynamic) in world.free_degrees(body).into_iter().enumerate() {
                let of = if dynamic { &found.velocity } else { &self.free };
                self.driven[6 * body + k] = of[6 * body + k] + self.to_now[6 * body + k];
            }
        }
        let has_changed = found.rate != self.rate;
        for cell in self.cells.iter_mut().flatten() {
            (0..6).for_each(|k| cell.rate[k] += found.rate[k] - self.rate[k]);
        }
        self.rate = found.rate;
        for (i, contact) in of.contacts.iter().enumerate() {
            let is_across = has_changed && contact.image != [0; 3];
            if is_across || moved[contact.body_a as usize] || moved[contact.body_b as usize] {
                let one = i..i + 1;
                let (contacts, rows) = (&of.contacts[one.clone()], &of.rows[one]);
                let [now, later] = &self.cells;
                let with = [(&mut self.now, now, &self.driven), (&mut self.later, later, &self.free)];
                for (u, cell, v) in with {
                    u[3 * i..3 * i + 3].copy_from_slice(&relative_velocities(
                        cell.as_ref(),
                        contacts,
                        rows,
                        v,
                    ));
                }
            }
        }
    }
}

/// Those parts that have contacts across the boundary are one, as the cell is.
fn joined_by_cell(all: Vec<Part>, contacts: &[Contact]) -> Vec<Part> {
    let is_across = |part: &Part| part.contacts.iter().any(|&i| contacts[i as usize].image != [0; 3]);
    let (across, mut joined): (Vec<Part>, Vec<Part>) = all.into_iter().partition(is_across);
    joined.extend((!across.is_empty()).then(|| Part::of_all(across)));
    joined
}

/// A periodic cell whose stress is imposed.
struct Pressed<'a> {
    cell: &'a Cell,
    /// Of the components of L, kg m^2.
    inertia: [f64; 6],
    /// What the stress has changed of them in this step, 1/s.
    pushes: [f64; 6],
}

impl<'a> Pressed<'a> {
    fn of(world: &'a World, step: f64) -> Option<Self> {
        let cell = world.cell().filter(|cell| cell.has_stress())?;
        let (mass, time) = (moved_mass(world), world.time);
        let inertia = std::array::from_fn(|k| cell.inertia(k, mass, time, step));
        Some(Self { cell, inertia, pushes: cell.pushes(mass, time, step) })
    }

    /// Velocity that the stress gives to what is an edge apart in a step, m/s.
    fn speed(&self) -> f64 {
        let edges = self.cell.size.to_array();
        let speeds = COMPONENTS.into_iter().zip(self.pushes).map(|((_, j), push)| (push * edges[j]).abs());
        speeds.fold(0.0, f64::max)
    }

    fn rows(&self, part: &Part, of: Rows<'_>) -> CellRows {
        let contacts: Vec<Contact> = part.contacts.iter().map(|&i| of.contacts[i as usize]).collect();
        let rows: Vec<RigidContact> = part.contacts.iter().map(|&i| of.rows[i as usize]).collect();
        CellRows::new(self.cell, &contacts, &rows, |k| self.inertia[k])
    }
}

/// The square of the restitution with which a contact parts at the start of a step where it has the gap Phi
/// and closes at u < 0, so that it has e times the velocity of its touch when it has crossed the gap twice
/// under the relative acceleration a (m/s^2) of bodies that nothing carries,
///
/// ```text
/// e_start^2 = e^2 - (1 - e^2) 2 a Phi / u^2;
/// ```
///
/// negative where it does not come back as far within its bounce. `fall` is a Phi, m^2/s^2.
fn square_at_start(e: f64, u: f64, fall: f64) -> f64 {
    if fall == 0.0 {
        return e * e;
    }
    e * e - (1.0 - e * e) * 2.0 * fall / (u * u)
}

/// Kinetic energy that impulses g add where contacts had the velocities u and get u + N g, g . u + 1/2 g . N
/// g, J; and the size of what goes over, sum |g u|.
fn energy(g: &[f64], u: &[f64], change: &[f64]) -> (f64, f64) {
    let gain = g.iter().zip(u).zip(change).map(|((g, u), c)| g * (u + 0.5 * c)).sum();
    (gain, g.iter().zip(u).map(|(g, u)| (g * u).abs()).sum())
}

/// g <- start + s (g - start) with the largest s in [0, 1] at which no energy is made: the root of a
/// quadratic. `change` is N g.
fn lower(delassus: &Delassus, u: &[f64], start: &[f64], g: &mut [f64], change: &[f64]) {
    let mut at_start = vec![0.0; start.len()];
    delassus.multiply(start, &mut at_start, &mut delassus.work());
    let (mut a, mut b, mut c) = (0.0, 0.0, 0.0);
    for k in 0..g.len() {
        let (d, image) = (g[k] - start[k], change[k] - at_start[k]);
        a += 0.5 * d * image;
        b += d * (u[k] + at_start[k]);
        c += start[k] * (u[k] + 0.5 * at_start[k]);
    }
    // c <= 0 up to the error of the plastic solve, and a + b + c > 0.
    let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
    let s = if b > 0.0 { -2.0 * c / (b + root) } else { (root - b) / (2.0 * a) };
    let s = if s.is_finite() { s.clamp(0.0, 1.0) } else { 0.0 };
    for (g, start) in g.iter_mut().zip(start) {
        *g = start + s * (*g - start);
    }
}
