//! One time step. Each concern is a file: how ([`StepSettings`]), the solve (`attempt`), what makes it be
//! made again (`repetition`), what is left once it is solved (`finish`), where bodies were (`placement`), why
//! it could not be made ([`StepError`]). What a step reports is in [`crate::step_report`].

mod apart;
mod attempt;
mod bend;
mod covered;
mod error;
mod finish;
mod flight;
mod mobility;
mod parameters;
mod placement;
mod repetition;
mod settings;
mod unmet;

pub use self::error::StepError;
pub use self::parameters::{
    FewParameters, ImpactParameters, OverlapParameters, Parameters, PartParameters, RepetitionParameters,
};
pub use self::settings::{LOOSEST, SolverChoice, StepSettings};
pub use crate::step_report::{PhaseSeconds, PhysicalErrors, ProcessorSeconds, StepReport, Wrench};

use self::attempt::Attempt;
use self::covered::leave_covered_out;
use self::error::{cell_error, check_drives, check_state};
use self::flight::courses;
use self::placement::{Driven, Placement};
use self::repetition::{Passed, Rounds};
use crate::assemble::of_each;
use crate::cell;
use crate::clock::Clock;
use crate::collide::Collider;
use crate::contact::Contact;
use crate::error::{not_below_zero, positive};
use crate::impact::lead_to_surfaces;
use crate::integrate::{advance, displace};
use crate::joint::drift;
use crate::load;
use crate::math::Vec3;
use crate::overlap::Correction;
use crate::world::World;
use graintrain_ccp::{Ccp, CcpSolver, Ranks, SolveSettings, SolverSpec};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A step as it is made: the bodies are where it leaves them.
struct Made {
    attempt: Attempt,
    /// Velocities at the start once all impulses of the step have acted, six numbers per body.
    kicked: Vec<f64>,
    /// The largest share of its angular momentum that a body lost, turning too far.
    lost: f64,
    /// The smaller body's size for each contact of the step, m.
    size: Vec<f64>,
    /// The displacements that removed overlap and closed joints.
    correction: Correction,
    /// The contacts of the end, once it was looked at.
    ahead: Vec<Contact>,
}

/// Makes time steps; owns the solvers and everything that is kept between steps apart from the state.
pub struct Stepper {
    /// What the methods of a step are tuned by.
    pub parameters: Parameters,
    settings: StepSettings,
    solver: Box<dyn CcpSolver>,
    /// Solves impacts.
    impacts: Box<dyn CcpSolver>,
    collider: Collider,
    /// The contact problem of the last step, and the impulses found.
    last: Option<(Ccp, Vec<f64>)>,
    /// Contacts found at the end of the last step, and the fingerprint of the state that they belong to.
    ahead: Option<(u64, Vec<Contact>)>,
    stop: Option<Arc<AtomicBool>>,
    ranks: Option<Arc<Ranks>>,
}

impl Stepper {
    /// A stepper with these settings.
    ///
    /// # Errors
    /// [`StepError::Settings`] unless step and tolerance are positive and the envelope is not negative;
    /// [`StepError::Solver`] for an unknown solver.
    pub fn new(mut settings: StepSettings) -> Result<Self, StepError> {
        positive("the time step", settings.step)?;
        positive("the solver's tolerance", settings.solver.tolerance)?;
        not_below_zero("the contact envelope", settings.envelope)?;
        settings.solver.tolerance = settings.solver.step_tolerance();
        let solver = settings.solver.name.build()?;
        let named = |name: &str| name.parse::<SolverSpec>()?.build();
        let impacts = named("auto")?;
        let collider = Collider::default();
        Ok(Self {
            parameters: Parameters::default(),
            settings,
            solver,
            impacts,
            collider,
            last: None,
            ahead: None,
            stop: None,
            ranks: None,
        })
    }

    /// The settings, with the tolerance that steps are solved to.
    pub fn settings(&self) -> &StepSettings {
        &self.settings
    }

    /// Stops a step under way as soon as the flag is set, in the search for contacts or in a solve: it then
    /// ends with [`StepError::Stopped`].
    pub fn stop_on(&mut self, stop: Arc<AtomicBool>) {
        self.collider.stop_on(Arc::clone(&stop));
        self.stop = Some(stop);
    }

    /// Makes the steps together with other processes, each of which has the same world and makes the same
    /// steps: what can be shared of the work is shared, and the world of each is that of one process alone.
    pub fn share_among(&mut self, ranks: Arc<Ranks>) {
        self.stop_on(ranks.stop());
        self.collider.share_among(Arc::clone(&ranks));
        self.ranks = Some(ranks);
    }

    /// The contact problem of the last step and the impulses found (length of r, contact frames, N s).
    pub fn last_problem(&self) -> Option<(&Ccp, &[f64])> {
        self.last.as_ref().map(|(problem, impulse)| (problem, impulse.as_slice()))
    }

    /// One step of semi-implicit Euler with contact:
    ///
    /// ```text
    /// loads are summed into the forces f (crate::load); contacts with gap <= envelope, or closing within the step;
    /// impacts: v' = v + M^-1 D g' with restitution (crate::impact);
    /// v* = v' + M^-1 dt f, with the mean spin of a free rotation in the place of w';
    /// solve the CCP of N = D^T M^-1 D, r = b + D^T v*;   (u+, m) = v* + M^-1 D g;
    /// x+ = x + dt u+ + dx;   Q+, w+ from a free rotation that begins with the moments of the step (crate::rotation), turned by dw;
    /// (dx, dw) remove overlap (crate::overlap)
    /// ```
    ///
    /// Angular momentum changes by the moments of impulses alone, or less where that would make energy. What
    /// nothing touches flies: x+ = x + dt (u' + u+) / 2; balls with one impact have u before its time t: x+
    /// is further by t (u - u').
    ///
    /// Then all pairs are looked at where they are now. Where bodies overlap that were no contacts, or far
    /// more than their contact foresaw, the step is taken back and made again with what was seen, until there
    /// are none: see [`StepReport::contacts_added`] and [`StepReport::contacts_missed`]. Contacts that bar a
    /// way without overlap (the seam of two tiles, a ball beneath a passing edge) are left out.
    ///
    /// Without external forces the sum of kinetic energy and work against gravity never rises in a step whose
    /// bodies are not driven, but for [`StepReport::correction_energy`]: impacts make none, and the contact
    /// problem takes `1/2 |v+ - v|_M^2 - g . (D^T v+)`, of which the second term is made not to be positive.
    ///
    /// A solve that does not reach its tolerance is no error: see [`StepReport::solve`].
    ///
    /// # Errors
    /// [`StepError::NotFinite`], [`StepError::Meshes`], [`StepError::Cell`], [`StepError::Solver`] or
    /// [`StepError::Stopped`]; the world is left unchanged.
    pub fn step(&mut self, world: &mut World) -> Result<StepReport, StepError> {
        if let Some(cell) = world.cell() {
            let rates = cell.validate_step(world.time, self.settings.step);
            rates.and_then(|()| world.fits_cell()).map_err(|error| cell_error(world, error))?;
        }
        let kinetic_energy = world.cell().map(|_| world.kinetic_energy());
        let undriven = world.cell().is_some().then(|| Placement::of(world));
        cell::drive(world, self.settings.step);
        let unloaded = load::apply(world, self.settings.step);
        let mut report = self.step_under(world);
        if let Some(before) = unloaded {
            load::remove(world, before, report.is_ok());
        }
        if let (Err(_), Some(before)) = (&report, undriven) {
            before.exchange(world);
        }
        if let (Ok(report), Some(before)) = (&mut report, kinetic_energy) {
            // Velocities relative to the deformation change with it, before and after the step under forces.
            report.ledger.drives += report.kinetic_energy - before - report.ledger.change();
        }
        report
    }

    /// The step under the forces that bodies now have, line by line as ARCHITECTURE.md has it.
    fn step_under(&mut self, world: &mut World) -> Result<StepReport, StepError> {
        let step = self.settings.step;
        let time = world.time;
        let mut rounds = self.as_driven(world, time, Self::first_round)?;
        let start = Placement::of(world);
        let mut last = None;
        loop {
            self.as_driven(world, time, |stepper, world| {
                lead_to_surfaces(world, (&stepper.collider, stepper.unseen()), step, &mut rounds.contacts);
            });
            let attempt = self.attempt(world, &mut rounds, last.take())?;
            if self.check_velocities(world, &mut rounds, &attempt)? {
                last = Some(attempt);
                continue;
            }
            let mut made = self.make(world, &mut rounds, attempt);
            if self.check_end(world, &mut rounds, &start, &mut made) {
                last = Some(made.attempt);
                continue;
            }
            if let Err(error) =
                self.go_on().and_then(|()| world.fits_cell().map_err(|e| cell_error(world, e)))
            {
                start.exchange(world);
                return Err(error);
            }
            self.remove_unforeseen(world, &mut rounds, &start, &mut made);
            return Ok(self.finish(world, rounds, &start, made));
        }
    }

    /// What is found with driven bodies as fast as they are in the step that begins at `time`.
    fn as_driven<T>(&mut self, world: &mut World, time: f64, find: impl FnOnce(&mut Self, &World) -> T) -> T {
        let mut driven = Driven::of(world, time, self.settings.step);
        driven.exchange(world);
        let found = find(self, world);
        driven.exchange(world);
        found
    }

    /// The contacts of the state that a step starts from.
    fn first_round(&mut self, world: &World) -> Result<Rounds, StepError> {
        let begin = Clock::now();
        check_state(world)?;
        let (step, envelope) = (self.settings.step, self.settings.envelope);
        check_drives(world, step)?;
        let same_forms = !self.collider.update_forms(world);
        let found = self.ahead.take().filter(|(state, _)| same_forms && *state == world.fingerprint());
        let contacts = match found {
            Some((_, contacts)) => contacts,
            None => self.collider.contacts(world, envelope, step),
        };
        // Balls that fly past each other meet nothing; deflected, they would meet elsewhere what they pass so
        // fast. Of other bodies impacts are to see the planes, too.
        let collider = &self.collider;
        let past = |before: Contact| {
            let pair = [before.body_a as usize, before.body_b as usize];
            if !pair.iter().all(|&body| collider.is_ball(world, body)) {
                return Some((before, before.gap));
            }
            let bodies = &world.bodies;
            let velocities = pair.map(|body| [bodies.velocity[body], bodies.angular_velocity[body]]);
            let after = collider.balls_past(world, &before, velocities, step);
            let is_fast = after.gap > before.gap && after.gap > 0.5 * collider.contact_size(world, &after);
            (!is_fast).then_some((after, before.gap))
        };
        let found: Vec<(Contact, f64)> = contacts.into_par_iter().filter_map(past).collect();
        let moved = found.iter().filter(|(contact, before)| contact.gap > *before);
        let passed = moved.map(|&(contact, gap)| (contact.identity, Passed { gap, times: 0 })).collect();
        let mut contacts = found.into_iter().map(|(contact, _)| contact).collect();
        leave_covered_out(world, &self.collider, step, &mut contacts);
        let mut rounds = Rounds { passed, ..Rounds::of(contacts) };
        rounds.laps.add(|phases| &mut phases.collide, begin.lap());
        Ok(rounds)
    }

    /// Contacts with the planes of bodies that pass each other moved out of their way ([`bend::bends`]).
    fn flown_past(
        &self,
        world: &World,
        contacts: &[Contact],
        motion: (&[f64], &[f64]),
        bends: &[Vec3],
    ) -> Vec<Contact> {
        let allowed = [self.unseen(), self.parameters.repetition.spurious];
        self.collider.flown_past(world, contacts, (motion, bends), self.settings.step, allowed)
    }

    /// Moves the bodies as the solve says, removes overlap that it foresaw, closes joints, and finds the
    /// contacts of the end.
    fn make(&mut self, world: &mut World, rounds: &mut Rounds, attempt: Attempt) -> Made {
        let step = self.settings.step;
        let begin = Clock::now();
        let contacts = &rounds.contacts;
        let size = of_each(contacts, |c| self.collider.contact_size(world, c));
        let mut correction = self.correct(world, contacts, &attempt, &size);
        let courses = courses(world, contacts, &attempt, step);
        let velocities = [&attempt.impacts.velocity, attempt.velocity.as_slice()];
        let (kicked, lost) = advance(world, velocities, &courses, step);
        attempt.impacts.put_on(world, &self.collider);
        if let Some(displacement) = &correction.displacement {
            displace(world, displacement);
        }
        correction.add(drift::close(world, &attempt.joints.states, step));
        if let Some(cell) = &attempt.cell {
            cell::advance(world, cell.rate, step);
        }
        rounds.laps.add(|phases| &mut phases.integrate, begin.lap());
        Made { attempt, kicked, lost, size, correction, ahead: Vec::new() }
    }

    /// # Errors
    /// [`StepError::Stopped`] where a stop was asked for.
    fn go_on(&self) -> Result<(), StepError> {
        let stopped = self.stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed));
        if stopped { Err(StepError::Stopped) } else { Ok(()) }
    }

    /// What the settings ask of a solve.
    fn solve_settings(&self) -> SolveSettings {
        SolveSettings {
            stop: self.stop.clone(),
            ranks: self.ranks.clone(),
            ..self.settings.solver.solve_settings()
        }
    }
}
