//! One time step. Each concern is a file: how ([`StepSettings`]), the solve (`attempt`), what makes it be made again (`repetition`), what is
//! left once it is solved (`finish`), where bodies were (`placement`), why it could not be made ([`StepError`]). What a step reports is in
//! [`crate::step_report`].

mod attempt;
mod error;
mod finish;
mod flight;
mod mobility;
mod parameters;
mod placement;
mod repetition;
mod settings;

pub use self::error::StepError;
pub use self::parameters::{
    FewParameters, ImpactParameters, OverlapParameters, Parameters, PartParameters, RepetitionParameters,
};
pub use self::settings::{SolverChoice, StepSettings};
pub use crate::step_report::{PhaseSeconds, PhysicalErrors, ProcessorSeconds, StepReport, Wrench};

use self::error::{cell_error, check_state};
use self::flight::flying;
use self::placement::Placement;
use self::repetition::{Bends, carried_back};
use crate::assemble::of_each;
use crate::cell;
use crate::clock::{Clock, Laps};
use crate::collide::{Collider, meshes_that_meet};
use crate::contact::Contact;
use crate::error::{ModelError, positive};
use crate::impact::lead_to_surfaces;
use crate::integrate::{Flight, advance};
use crate::joint::drift;
use crate::load;
use crate::world::World;
use graintrain_ccp::{Ccp, CcpSolver, Ranks, SolveSettings, SolverSpec};
use std::collections::HashSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

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
    pub fn new(settings: StepSettings) -> Result<Self, StepError> {
        positive("the time step", settings.step)?;
        positive("the solver's tolerance", settings.solver.tolerance)?;
        if !(settings.envelope.is_finite() && settings.envelope >= 0.0) {
            let what = "the contact envelope".to_string();
            let expected = "finite and not negative";
            return Err(ModelError::Value { what, value: settings.envelope, expected }.into());
        }
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

    /// The settings.
    pub fn settings(&self) -> &StepSettings {
        &self.settings
    }

    /// Stops a step under way as soon as the flag is set, in the search for contacts or in a solve: it then ends with
    /// [`StepError::Stopped`].
    pub fn stop_on(&mut self, stop: Arc<AtomicBool>) {
        self.collider.stop_on(Arc::clone(&stop));
        self.stop = Some(stop);
    }

    fn is_stopped(&self) -> bool {
        self.stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed))
    }

    /// Makes the steps together with other processes, each of which has the same world and makes the same steps: what can be shared of
    /// the work is shared, and the world of each is that of one process alone.
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
    /// v* = v' + M^-1 (dt f + G); solve the CCP of N = D^T M^-1 D, r = b + D^T v*;  v+ = v* + M^-1 D g;
    /// x+ = x + dt u+ + dx;   Q+ = exp(dw / 2) exp(dt w+ / 2) Q   with the displacements that remove overlap (crate::overlap)
    /// ```
    ///
    /// What nothing touches flies: x+ = x + dt (u' + u+) / 2, and its angular momentum stays.
    ///
    /// Then all pairs are looked at where they are now. Where bodies overlap that were no contacts, or far more than their contact
    /// foresaw, the step is taken back and made again with what was seen, until there are none: see [`StepReport::contacts_added`] and [`StepReport::contacts_missed`].
    /// Contacts that bar a way without overlap (the seam of two tiles) are left out.
    ///
    /// Without external forces the sum of kinetic energy and work against gravity never rises in a step whose bodies are not driven, but for [`StepReport::correction_energy`]: impacts make none, and the contact problem takes
    /// `1/2 |v+ - v|_M^2 - g . (D^T v+)`, of which the second term is made not to be positive.
    ///
    /// A solve that misses its tolerance is no error: see [`StepReport::solve`].
    ///
    /// # Errors
    /// [`StepError::NotFinite`], [`StepError::Cell`], [`StepError::Solver`] or [`StepError::Stopped`]; the world is left unchanged.
    pub fn step(&mut self, world: &mut World) -> Result<StepReport, StepError> {
        if let Some(cell) = world.cell() {
            let rates = cell.validate_step(world.time, self.settings.step);
            rates.and_then(|()| world.fits_cell()).map_err(|error| cell_error(world, error))?;
        }
        let kinetic_energy = world.cell().map(|_| world.kinetic_energy());
        let undriven = cell::drive(world, self.settings.step);
        let loaded = load::apply(world, self.settings.step);
        let mut report = self.step_under(world);
        match (&report, loaded) {
            (Ok(_), Some(before)) => load::remove(world, before),
            (Err(_), Some(before)) => load::undo(world, before),
            (_, None) => {}
        }
        if let (Err(_), Some(before)) = (&report, undriven) {
            cell::undo(world, before);
        }
        if let (Ok(report), Some(before)) = (&mut report, kinetic_energy) {
            // Velocities relative to the deformation change with it, before and after the step under forces.
            report.ledger.drives += report.kinetic_energy - before - report.ledger.change();
        }
        report
    }

    /// The step under the forces that bodies now have.
    fn step_under(&mut self, world: &mut World) -> Result<StepReport, StepError> {
        let begin = Clock::now();
        check_state(world)?;
        if let Some([first, second]) = meshes_that_meet(world) {
            let [first, second] = [first, second].map(|body| world.bodies.label(body));
            return Err(StepError::Meshes { first, second });
        }
        let (step, envelope) = (self.settings.step, self.settings.envelope);
        let &RepetitionParameters { rounds, phantom_rounds, .. } = &self.parameters.repetition;
        let same_forms = !self.collider.update_forms(world);
        let found = self.ahead.take().filter(|(state, _)| same_forms && *state == world.fingerprint());
        let mut contacts = match found {
            Some((_, contacts)) => contacts,
            None => self.collider.contacts(world, envelope, step),
        };
        // What flies past meets nothing.
        let collider = &self.collider;
        let flown_past = |contact| collider.flown_past(world, contact, step);
        contacts = contacts.into_iter().filter_map(flown_past).collect();
        let mut laps = Laps::default();
        laps.add(|phases| &mut phases.collide, begin.lap());
        let start = Placement::of(world);
        let mut guess = None;
        // Contacts under way that bodies are driven into all the same, and phantoms that were none, by identity.
        let (mut driven, mut kept) = (HashSet::new(), HashSet::new());
        let mut bends = Bends::default();
        let (mut added, mut iterations) = (0, 0);
        for round in 0.. {
            if self.is_stopped() {
                return Err(StepError::Stopped);
            }
            lead_to_surfaces(world, &self.collider, step, &mut contacts);
            let begin = Clock::now();
            let attempt = self.attempt(world, &contacts, guess.take(), &driven)?;
            laps.add(|phases| &mut phases.assemble, attempt.assembled - begin);
            laps.subtract(|phases| &mut phases.assemble, attempt.impact_lap);
            laps.add(|phases| &mut phases.solve, attempt.impact_lap);
            laps.add(|phases| &mut phases.solve, attempt.assembled.lap());
            iterations += attempt.solve.iterations;
            let begin = Clock::now();
            let (mut passing, mut phantoms) = (Vec::new(), Vec::new());
            let met = self.met(world, &contacts, &attempt);
            if met.is_empty() && round < rounds {
                passing = self.passing(world, &contacts, &attempt);
            }
            if met.is_empty() && passing.is_empty() && round < phantom_rounds {
                phantoms = self.phantoms(world, &contacts, &attempt, &kept);
            }
            if self.is_stopped() {
                return Err(StepError::Stopped);
            }
            laps.add(|phases| &mut phases.collide, begin.lap());
            if !met.is_empty() && round < rounds {
                added += met.len();
                driven.extend(met);
                guess = Some(attempt);
                continue;
            }
            if !passing.is_empty() {
                added += passing.len();
                kept.extend(passing.iter().map(|c| c.identity));
                contacts.extend(passing);
                guess = Some(attempt);
                continue;
            }
            if !phantoms.is_empty() {
                let mut index = 0..;
                contacts.retain(|_| phantoms.binary_search(&index.next().unwrap_or_default()).is_err());
                guess = Some(attempt);
                continue;
            }
            let begin = Clock::now();
            let collider = &self.collider;
            let size = of_each(&contacts, |c| collider.contact_size(world, c));
            let mut correction = self.correct(world, &contacts, &attempt, &size);
            let flies = flying(world, &contacts, &attempt);
            let flight = Flight { flies: &flies, before: &attempt.impacts.velocity };
            advance(world, &attempt.velocity, correction.displacement.as_deref(), &flight, step);
            correction.add(drift::close(world, &attempt.joints.states, step));
            if let Some(cell) = &attempt.cell {
                cell::advance(world, cell.rate, step);
            }
            laps.add(|phases| &mut phases.integrate, begin.lap());
            let begin = Clock::now();
            let mut ahead = self.collider.contacts(world, envelope, step);
            let missed = self.missed(world, &contacts, &ahead);
            let (mut new, mut bent) = (Vec::new(), Vec::new());
            if round < rounds {
                bent = self.bent(world, &start, &contacts, &attempt, &ahead, &bends);
            }
            if !missed.is_empty() && round < rounds || !bent.is_empty() {
                let carry = |c: &Contact| carried_back(c, world, &start, &attempt, step);
                let ends: Vec<Contact> = missed.iter().map(carry).collect();
                let end = start.exchange(world);
                new = self.new_contacts(world, &contacts, &ends, &attempt.velocity);
                if new.is_empty() && bent.is_empty() {
                    end.exchange(world);
                }
            }
            laps.add(|phases| &mut phases.collide, begin.lap());
            if new.is_empty() && bent.is_empty() {
                if self.is_stopped() {
                    start.exchange(world);
                    return Err(StepError::Stopped);
                }
                if let Err(error) = world.fits_cell() {
                    start.exchange(world);
                    return Err(cell_error(world, error));
                }
                let made = (&start, contacts.as_slice(), &attempt, &bends);
                let begin = Clock::now();
                self.remove_unforeseen(world, made, &mut correction, &mut ahead);
                laps.add(|phases| &mut phases.collide, begin.lap());
                let pair = |c: &Contact| [c.body_a.min(c.body_b), c.body_a.max(c.body_b)];
                let mut pairs = HashSet::new();
                if !missed.is_empty() {
                    pairs.extend(contacts.iter().map(pair));
                }
                let apart = |c: &&Contact| !pairs.contains(&pair(c));
                let missed = met.len() + missed.iter().filter(apart).map(pair).collect::<HashSet<_>>().len();
                let mut report =
                    self.finish(world, &start, contacts, attempt, &size, &correction, ahead, laps);
                (report.contacts_added, report.contacts_missed) = (added, missed);
                report.solve.iterations = iterations;
                return Ok(report);
            }
            added += new.len() + bent.len();
            kept.extend(bends.put(bent, &mut contacts));
            kept.extend(new.iter().map(|c| c.identity));
            contacts.extend(new);
            guess = Some(attempt);
        }
        unreachable!("the last round finishes")
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
