//! One time step: settings and the step itself. What makes it be made again is in `repetition`, what it reports in [`crate::step_report`].

mod repetition;

use self::repetition::{Bends, carried_back};
use crate::assemble::{
    OverlapCorrection, assemble, contact_rows, of_each, pair_property, relative_velocities, warm_start,
};
use crate::cell::{self, Cell, moved_mass};
use crate::cell_problem::CellRows;
use crate::clock::{Clock, Lap, Laps};
use crate::collide::{Collider, meshes_that_meet};
use crate::contact::{Contact, ContactSet};
use crate::elasticity;
use crate::error::{ModelError, finite, positive};
use crate::impact::{self, ImpactSolver, Impacts, Rows, lead_to_surfaces};
use crate::integrate::{advance, free_velocity, inverse_mass, velocities};
use crate::joint::drift;
use crate::joint::mechanism::{JointReactions, Mechanisms};
use crate::load;
use crate::math::{Quat, Vec3};
use crate::measure::energy;
use crate::overlap::{Correction, Gaps};
use crate::part_solver::{PartSolver, Solved};
use crate::relaxation::{self, Difference, Opening};
use crate::step_report::wrenches;
pub use crate::step_report::{PhaseSeconds, PhysicalErrors, ProcessorSeconds, StepReport, Wrench};
use crate::turning::{turning_velocities, world_moment};
use crate::world::World;
use graintrain_ccp::{
    Ccp, CcpError, CcpSolver, Delassus, FrictionModel, Judge, RigidContact, SolveReport, SolveSettings,
    SolverSpec, Status,
};
use graintrain_linalg::parallel::axpy;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// How steps are made. Its fields in their order are part of the format of checkpoints.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StepSettings {
    /// Time step dt, s.
    pub step: f64,
    /// Contact envelope delta, m: pairs with a gap up to this become contacts, and so do pairs that would close within
    /// the step.
    pub envelope: f64,
    /// Solver of the contact problem.
    pub solver: SolverSpec,
    /// Residual at which it stops, as `judge` takes it.
    pub tolerance: f64,
    /// Which number of the residual is held against the tolerance; [`Judge::Mixed`] in runs unless asked otherwise.
    pub judge: Judge,
    /// Iteration limit; `None` is the solver's own.
    pub max_iterations: Option<usize>,
    /// Relaxed cone complementarity or exact Coulomb friction.
    pub friction: FrictionModel,
    /// What becomes of overlap.
    pub overlap: OverlapCorrection,
}

impl Default for StepSettings {
    /// Steps of 1 ms, no envelope beyond what closes within the step, solver `auto` to 1e-4, relaxed friction, positions corrected.
    fn default() -> Self {
        Self {
            step: 1e-3,
            envelope: 0.0,
            solver: SolverSpec::default(),
            tolerance: 1e-4,
            judge: Judge::Mixed,
            max_iterations: None,
            friction: FrictionModel::Relaxed,
            overlap: OverlapCorrection::Position,
        }
    }
}

/// Why a step could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// A setting out of its range.
    #[error(transparent)]
    Settings(#[from] ModelError),
    /// The solver cannot treat the problem, or is not known.
    #[error(transparent)]
    Solver(#[from] CcpError),
    /// A body's state is NaN or infinite. The world is left as it was before the step.
    #[error(
        "step {step} (time {time} s): the {what} of body {body} is {value}; the state before this step was kept. \
         A shorter time step or a deeper look at initial overlaps may help"
    )]
    NotFinite {
        /// Name or index of the body.
        body: String,
        /// Which part of its state.
        what: &'static str,
        /// The offending number.
        value: f64,
        /// Number of the step, from 0.
        step: u64,
        /// Time at its start, s.
        time: f64,
    },
    /// Two meshes came near each other. The world is left as it was before the step.
    #[error(
        "bodies {first} and {second} are meshes and came near each other, but contacts between two meshes are not computed; make one of \
         them of other shapes"
    )]
    Meshes {
        /// Name or index of a body.
        first: String,
        /// Name or index of the other.
        second: String,
    },
    /// The periodic cell cannot be what the step makes of it. The world is left as it was before the step.
    #[error("step {step} (time {time} s): {error}")]
    Cell {
        /// Which component, or which body and edge, and the remedy.
        error: ModelError,
        /// Number of the step, from 0.
        step: u64,
        /// Time at its start, s.
        time: f64,
    },
    /// The stop flag was set during the solve. The world is left as it was before the step, since a solve cut short
    /// depends on when that was.
    #[error("stopped before the end of a step")]
    Stopped,
}

/// Makes time steps; owns the solvers and everything that is kept between steps apart from the state.
pub struct Stepper {
    settings: StepSettings,
    solver: Box<dyn CcpSolver>,
    /// Solves impacts.
    impacts: Box<dyn CcpSolver>,
    collider: Collider,
    last: Option<Last>,
    /// Contacts found at the end of the last step, and the fingerprint of the state that they belong to.
    ahead: Option<(u64, Vec<Contact>)>,
    stop: Option<Arc<AtomicBool>>,
}

/// Rounds of solving a step again with contacts that were missed; what still overlaps then is reported.
const ROUNDS: usize = 8;

/// Rounds in which contacts may be left out.
const PHANTOM_ROUNDS: usize = 3;

/// Solves of the contacts for joints whose motors, stops or paths turned out otherwise than foreseen; what is left then is reported.
const JOINT_ROUNDS: usize = 12;

/// Iterations that a comparison with exact friction is given, in multiples of those of the relaxed solve, and at least so many.
const COMPARISON: (usize, usize) = (5, 100);

/// The contact problem of a step that was made.
struct Last {
    problem: Ccp,
    /// Impulses, contact frames.
    impulse: Vec<f64>,
    /// Gaps of its contacts at the start of the step, m.
    gap: Vec<f64>,
}

/// A solved contact problem with what a periodic cell does.
struct WithCell {
    solved: Solved,
    /// The problem as it was solved, where the cell takes part.
    posed: Option<Ccp>,
    /// The cell of the start with the rates after the step.
    cell: Option<Cell>,
}

/// A solved step before it is made.
struct Attempt {
    problem: Ccp,
    /// The problem as it was solved, where a periodic cell takes part.
    posed: Option<Ccp>,
    /// The periodic cell at the start of the step with the rates after it.
    cell: Option<Cell>,
    /// Impulses of the contact problem, contact frames.
    impulse: Vec<f64>,
    /// Contacts of the problem as indices into those of the step.
    active: Vec<u32>,
    /// Impulses with which the contacts of the step pull, N s; empty where none do.
    pulls: Vec<f64>,
    joints: JointReactions,
    impacts: Impacts,
    impact_lap: Lap,
    velocity: Vec<f64>,
    solve: SolveReport,
    parts: usize,
    /// Contacts with exact friction, because their relaxation has no solution, as places in the problem.
    wedged: Vec<usize>,
    assembled: Clock,
}

impl Stepper {
    /// A stepper with these settings.
    ///
    /// # Errors
    /// [`StepError::Settings`] unless step and tolerance are positive and the envelope is not negative;
    /// [`StepError::Solver`] for an unknown solver.
    pub fn new(settings: StepSettings) -> Result<Self, StepError> {
        positive("the time step", settings.step)?;
        positive("the solver's tolerance", settings.tolerance)?;
        if !(settings.envelope.is_finite() && settings.envelope >= 0.0) {
            let what = "the contact envelope".to_string();
            let expected = "finite and not negative";
            return Err(ModelError::Value { what, value: settings.envelope, expected }.into());
        }
        let solver = settings.solver.build()?;
        let named = |name: &str| name.parse::<SolverSpec>()?.build();
        let impacts = named("auto")?;
        let collider = Collider::default();
        Ok(Self { settings, solver, impacts, collider, last: None, ahead: None, stop: None })
    }

    /// The settings.
    pub fn settings(&self) -> &StepSettings {
        &self.settings
    }

    /// Stops a step whose solve is under way as soon as the flag is set: it then ends with [`StepError::Stopped`].
    pub fn stop_on(&mut self, stop: Arc<AtomicBool>) {
        self.stop = Some(stop);
    }

    /// The contact problem of the last step and the impulses found (length of r, contact frames, N s).
    pub fn last_problem(&self) -> Option<(&Ccp, &[f64])> {
        self.last.as_ref().map(|last| (&last.problem, last.impulse.as_slice()))
    }

    /// How far the last step, made with relaxed friction and in so many iterations, is from exact friction (see [`crate::relaxation`]);
    /// `world` as that step left it. Nothing is changed. Costs at most five times the iterations of the step's solve, or 100. `None` where friction is exact or
    /// absent, or where the stop flag was set meanwhile.
    ///
    /// # Errors
    /// As the solver's.
    pub fn compare_with_exact(
        &self,
        world: &World,
        iterations: usize,
    ) -> Result<Option<Difference>, StepError> {
        let Some(Last { problem, impulse, gap }) = &self.last else { return Ok(None) };
        let StepSettings { step, friction, .. } = self.settings;
        if friction == FrictionModel::Coulomb || !problem.has_friction() {
            return Ok(None);
        }
        let settings = SolveSettings {
            max_iterations: Some((COMPARISON.0 * iterations).max(COMPARISON.1)),
            ..self.solve_settings()
        };
        let masses = inverse_mass(world);
        let movable = world.bodies.velocity.iter().zip(&masses).filter(|(_, mass)| mass.linear != [0.0; 3]);
        let (sum, count) =
            movable.fold((0.0, 0), |(sum, count), (v, _)| (sum + v.length_squared(), count + 1));
        let speed = (sum / f64::from(count.max(1))).sqrt();
        Ok(relaxation::difference(problem, impulse, gap, (step, speed), settings)?)
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
        let same_forms = !self.collider.update_forms(world);
        let found = self.ahead.take().filter(|(state, _)| same_forms && *state == world.fingerprint());
        let mut contacts = match found {
            Some((_, contacts)) => contacts,
            None => self.collider.contacts(world, envelope, step),
        };
        let mut laps = Laps::default();
        laps.add(|phases| &mut phases.collide, begin.lap());
        let start = Placement::of(world);
        let mut guess = None;
        // Contacts under way that bodies are driven into all the same, and phantoms that were none, by identity.
        let (mut driven, mut kept) = (HashSet::new(), HashSet::new());
        let mut bends = Bends::default();
        let (mut added, mut iterations) = (0, 0);
        for round in 0.. {
            lead_to_surfaces(world, &mut contacts);
            let begin = Clock::now();
            let attempt = self.attempt(world, &contacts, guess.take(), &driven)?;
            laps.add(|phases| &mut phases.assemble, attempt.assembled - begin);
            laps.subtract(|phases| &mut phases.assemble, attempt.impact_lap);
            laps.add(|phases| &mut phases.solve, attempt.impact_lap);
            laps.add(|phases| &mut phases.solve, attempt.assembled.lap());
            iterations += attempt.solve.iterations;
            let met = self.met(world, &contacts, &attempt);
            if !met.is_empty() && round < ROUNDS {
                added += met.len();
                driven.extend(met);
                guess = Some(attempt);
                continue;
            }
            let passing = if round < ROUNDS { self.passing(world, &contacts, &attempt) } else { Vec::new() };
            if !passing.is_empty() {
                added += passing.len();
                kept.extend(passing.iter().map(|c| c.identity));
                contacts.extend(passing);
                guess = Some(attempt);
                continue;
            }
            if round < PHANTOM_ROUNDS {
                let phantoms = self.phantoms(world, &contacts, &attempt, &kept);
                if !phantoms.is_empty() {
                    let mut index = 0..;
                    contacts.retain(|_| phantoms.binary_search(&index.next().unwrap_or_default()).is_err());
                    guess = Some(attempt);
                    continue;
                }
            }
            let begin = Clock::now();
            let collider = &self.collider;
            let size = of_each(&contacts, |c| collider.contact_size(world, c));
            let mut correction = self.correct(world, &contacts, &attempt, &size);
            advance(world, &attempt.velocity, correction.displacement.as_deref(), step);
            correction.add(drift::close(world, &attempt.joints.states, step));
            if let Some(cell) = &attempt.cell {
                cell::advance(world, cell.rate, step);
            }
            laps.add(|phases| &mut phases.integrate, begin.lap());
            let begin = Clock::now();
            let ahead = self.collider.contacts(world, envelope, step);
            let missed = self.missed(world, &contacts, &ahead);
            let (mut new, mut bent) = (Vec::new(), Vec::new());
            if round < ROUNDS {
                bent = self.bent(world, &start, &contacts, &attempt, &ahead, &bends);
            }
            if !missed.is_empty() && round < ROUNDS || !bent.is_empty() {
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
                if let Err(error) = world.fits_cell() {
                    start.exchange(world);
                    return Err(cell_error(world, error));
                }
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

    /// Solves the step from the state of the world without moving anything.
    fn attempt(
        &mut self,
        world: &World,
        contacts: &[Contact],
        last: Option<Attempt>,
        driven: &HashSet<u64>,
    ) -> Result<Attempt, StepError> {
        let step = self.settings.step;
        let rows = contact_rows(world, contacts);
        let masses = inverse_mass(world);
        let mut impacts = ImpactSolver {
            solver: self.impacts.as_mut(),
            friction: self.settings.friction,
            stop: self.stop.clone(),
        };
        let of = Rows { contacts, rows: &rows, inverse_mass: &masses };
        let begin = Clock::now();
        let Some(impacts) = impacts.resolve(world, of, step)? else { return Err(StepError::Stopped) };
        let impact_lap = begin.lap();
        let pulls = elasticity::pulls(world, contacts, |c| self.collider.contact_size(world, c), step);
        let mut free = free_velocity(world, &impacts.velocity, step);
        elasticity::apply_pulls(&rows, &pulls, &masses, &mut free);
        let waits = |i: &u32| {
            self.settings.friction == FrictionModel::Relaxed
                && impacts.under_way.binary_search(i).is_ok()
                && !driven.contains(&contacts[*i as usize].identity)
        };
        let active: Vec<u32> = (0..contacts.len() as u32).filter(|i| !waits(i)).collect();
        let chosen = chosen_of(contacts, &active);
        let rows = if active.len() == rows.len() { rows } else { of_each(&active, |&i| rows[i as usize]) };
        let mut mechanisms = Mechanisms::new(world, &impacts.velocity, free, step);
        mechanisms.predict(&[]);
        // With joints the problem may have to be posed again.
        let spare = (!mechanisms.is_empty()).then(|| (rows.clone(), masses.clone()));
        let overlap = self.settings.overlap;
        let pose = |mechanisms: &Mechanisms<'_>, (rows, masses): (Vec<RigidContact>, _)| {
            let mut free = mechanisms.free().to_vec();
            mechanisms.velocities(&[], &mut free);
            let masses = (masses, mechanisms.coupled());
            (assemble(world, &chosen, rows, masses, &free, step, overlap), free)
        };
        let (mut problem, mut free) = pose(&mechanisms, (rows, masses));
        let own: Vec<f64> = active.iter().filter_map(|&i| pulls.get(i as usize).copied()).collect();
        let mut impulse = warm_start(&problem, &chosen, &own, &world.contacts, world.bodies.len());
        if let Some(last) = last {
            start_from(&last, &problem, &mut impulse);
        }
        if let Some(spare) = spare.clone().filter(|_| !chosen.is_empty()) {
            mechanisms.predict(&body_impulses(&problem, &impulse));
            (problem, free) = pose(&mechanisms, spare);
        }
        let assembled = Clock::now();
        let settings = self.solve_settings();
        let WithCell { solved, posed, cell } =
            self.solve_with_cell(world, (&chosen, &active), &impacts, &mut problem, &mut impulse)?;
        let Solved { report: mut solve, mut parts, mut wedged } = solved;
        let (mut on_bodies, mut agrees) = (Vec::new(), true);
        if let Some(spare) = spare {
            on_bodies = body_impulses(&problem, &impulse);
            agrees = false;
            for _ in 0..JOINT_ROUNDS {
                agrees = mechanisms.agree(&on_bodies, settings.tolerance);
                if solve.status == Status::Stopped || agrees {
                    break;
                }
                mechanisms.predict(&on_bodies);
                (problem, free) = pose(&mechanisms, spare.clone());
                let again = self.solve(world, &problem, &mut impulse)?;
                (solve, parts, wedged) = (again.report.after(&solve), again.parts, again.wedged);
                on_bodies = body_impulses(&problem, &impulse);
            }
        }
        if solve.status == Status::Stopped {
            return Err(StepError::Stopped);
        }
        let mut velocity = velocity_after(&problem, &impulse, free);
        mechanisms.velocities(&on_bodies, &mut velocity);
        check_velocity(world, &velocity)?;
        let joints = mechanisms.reactions(&on_bodies);
        judge_joints(world, &joints, &settings, &mut solve);
        if !agrees && solve.status == Status::Converged {
            solve.status = Status::IterationLimit;
            solve.remark = Some(format!("motors, stops and contacts did not agree in {JOINT_ROUNDS} rounds"));
        }
        Ok(Attempt {
            problem,
            posed,
            cell,
            impulse,
            active,
            pulls,
            joints,
            impacts,
            impact_lap,
            velocity,
            solve,
            parts,
            wedged,
            assembled,
        })
    }

    /// Displacements that remove overlap at the end of the step.
    fn correct(&self, world: &World, contacts: &[Contact], attempt: &Attempt, size: &[f64]) -> Correction {
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
            tolerance: self.settings.tolerance,
        };
        let correction = gaps.correct();
        let finite = correction.displacement.iter().flatten().all(|x| x.is_finite());
        if finite { correction } else { Correction { displacement: None, ..correction } }
    }

    /// What is left to do once the world is where the step takes it.
    fn finish(
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
            wedged,
            ..
        } = attempt;
        let left = impacts.residual.judged(self.settings.judge);
        if left > self.settings.tolerance.max(impact::TOLERANCE) && solve.status == Status::Converged {
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
        let accuracy = (step, self.settings.tolerance);
        let errors = PhysicalErrors::of(&chosen, &chosen_size, (&problem, &impulse), &u, accuracy);
        let opening = match self.settings.friction {
            FrictionModel::Relaxed => {
                Opening::of(&chosen_size, (&problem, &impulse, threshold), &u, (step, &wedged))
            }
            FrictionModel::Coulomb => Opening::default(),
        };
        drop(chosen);
        let curvature = solve.curvature.or(world.contacts.curvature);
        let set = ContactSet { contacts, impulse: world_impulse, friction, moment, curvature };
        let wrenches = wrenches(&start.position, cell.as_ref(), world, &set, step);
        let (before, kinetic_energy) = (start.velocities(), world.kinetic_energy());
        let change = kinetic_energy + taken_along(world, &velocity) - start.kinetic_energy;
        let forces = (&set, joints.impulses.as_slice());
        let places = (start.position.as_slice(), cell.as_ref());
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
            contacts_wedged: wedged.len(),
            solve,
            penetration_max: deepest,
            penetration_max_over_size: over_size,
            kinetic_energy,
            ledger,
            errors,
            opening,
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
        let gap = active.iter().map(|&i| world.contacts.contacts[i as usize].gap).collect();
        self.last = Some(Last { problem: posed.unwrap_or(problem), impulse, gap });
        report
    }

    /// Solves the problem of these contacts (`active`: their places among those of the step) together with the rates of a periodic cell whose stress is
    /// imposed. Components that come beyond the largest rate are held there and the others found again. r follows the rates.
    fn solve_with_cell(
        &mut self,
        world: &World,
        (chosen, active): (&[Contact], &[u32]),
        impacts: &Impacts,
        problem: &mut Ccp,
        impulse: &mut [f64],
    ) -> Result<WithCell, CcpError> {
        let mut cell = world.cell().cloned();
        let rows = match (&cell, &*problem.delassus) {
            (Some(cell), Delassus::Rigid(rigid)) if cell.has_stress() => {
                Some(CellRows::new(cell, chosen, rigid.contacts(), moved_mass(world)))
            }
            _ => None,
        };
        let (Some(mut rows), Some(cell_now)) = (rows, &mut cell) else {
            let solved = self.solve(world, problem, impulse)?;
            return Ok(WithCell { solved, posed: None, cell });
        };
        let (time, step) = (world.time, self.settings.step);
        let of_impacts = rows.impact_change(active, &impacts.impulse);
        let mut free: [f64; 6] = std::array::from_fn(|k| cell_now.rate[k] + of_impacts[k]);
        rows.shift(&of_impacts, &mut problem.r);
        let mut last: Option<SolveReport> = None;
        loop {
            let posed = (!rows.is_empty()).then(|| rows.posed(problem));
            let mut solved = self.solve(world, posed.as_ref().unwrap_or(problem), impulse)?;
            if let Some(last) = &last {
                solved.report = solved.report.after(last);
            }
            let change = rows.rate_change(impulse);
            cell_now.rate = std::array::from_fn(|k| free[k] + change[k]);
            let beyond = cell_now.beyond(time, step);
            let held: [f64; 6] = std::array::from_fn(|k| beyond[k].map_or(0.0, |limit| limit - free[k]));
            if held == [0.0; 6] || solved.report.status == Status::Stopped {
                return Ok(WithCell { solved, posed, cell });
            }
            rows.shift(&held, &mut problem.r);
            rows.hold(|k| beyond[k].is_some());
            // Not the sum with what is held back: that of a very large rate rounds.
            free = std::array::from_fn(|k| beyond[k].unwrap_or(free[k]));
            last = Some(solved.report);
        }
    }

    /// What the settings ask of a solve.
    fn solve_settings(&self) -> SolveSettings {
        SolveSettings {
            tolerance: self.settings.tolerance,
            judge: self.settings.judge,
            max_iterations: self.settings.max_iterations,
            friction: self.settings.friction,
            stop: self.stop.clone(),
            ..SolveSettings::default()
        }
    }

    /// Solves the problem part by part.
    fn solve(&mut self, world: &World, problem: &Ccp, impulse: &mut [f64]) -> Result<Solved, CcpError> {
        let settings = SolveSettings { curvature: world.contacts.curvature, ..self.solve_settings() };
        // A method that keeps something from step to step has to see the same problem again.
        let whole = self.settings.solver.keeps_between_steps();
        let (gravity, step) = (world.gravity.length(), self.settings.step);
        PartSolver { solver: self.solver.as_mut(), settings, whole, gravity, step }.solve(problem, impulse)
    }
}

/// Where bodies are and how they move: what a step changes of them.
struct Placement {
    position: Vec<Vec3>,
    orientation: Vec<Quat>,
    velocity: Vec<Vec3>,
    angular_velocity: Vec<Vec3>,
    cell: Option<Cell>,
    /// In the frame of the world, J.
    kinetic_energy: f64,
}

impl Placement {
    fn of(world: &World) -> Self {
        let bodies = &world.bodies;
        Self {
            position: bodies.position.clone(),
            orientation: bodies.orientation.clone(),
            velocity: bodies.velocity.clone(),
            angular_velocity: bodies.angular_velocity.clone(),
            cell: world.cell().cloned(),
            kinetic_energy: world.kinetic_energy() + taken_along(world, &velocities(world)),
        }
    }

    /// The velocities, six numbers per body.
    fn velocities(&self) -> Vec<f64> {
        let pairs = self.velocity.iter().zip(&self.angular_velocity);
        pairs.flat_map(|(u, w)| [u.x, u.y, u.z, w.x, w.y, w.z]).collect()
    }

    /// Puts the bodies of the world here and returns where they were.
    fn exchange(&self, world: &mut World) -> Self {
        let before = Self::of(world);
        let bodies = &mut world.bodies;
        bodies.position.copy_from_slice(&self.position);
        bodies.orientation.copy_from_slice(&self.orientation);
        bodies.velocity.copy_from_slice(&self.velocity);
        bodies.angular_velocity.copy_from_slice(&self.angular_velocity);
        world.cell.clone_from(&self.cell);
        before
    }
}

/// The contacts at these places, ascending: all of them as they are, in most steps.
fn chosen_of<'a>(contacts: &'a [Contact], active: &[u32]) -> Cow<'a, [Contact]> {
    if active.len() == contacts.len() {
        return contacts.into();
    }
    of_each(active, |&i| contacts[i as usize]).into()
}

/// Kinetic energy of these velocities (six numbers per body) beyond that of the world, in which a periodic cell takes bodies along, J.
fn taken_along(world: &World, velocity: &[f64]) -> f64 {
    if world.cell().is_none() {
        return 0.0;
    }
    let beyond = |(body, v): (usize, &[f64])| {
        let speeds = Vec3::from_slice(&v[..3]).length_squared() - world.fluctuation(body).length_squared();
        0.5 * world.bodies.mass[body] * speeds
    };
    let moving = velocity.chunks_exact(6).enumerate().filter(|(body, _)| !world.is_prescribed(*body));
    moving.map(beyond).sum()
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

/// Joints that open count in the residual, and a solve that leaves them open has not converged.
fn judge_joints(world: &World, joints: &JointReactions, settings: &SolveSettings, solve: &mut SolveReport) {
    if joints.states.is_empty() {
        return;
    }
    for residual in [&mut solve.residual, &mut solve.residual_relaxed, &mut solve.residual_coulomb] {
        *residual = residual.worse(joints.residual);
    }
    let judged = joints.residual.judged(settings.judge);
    if (judged.is_nan() || judged > settings.tolerance) && solve.status == Status::Converged {
        solve.status = Status::IterationLimit;
        let name = world.joint_label(joints.worst);
        solve.remark = Some(format!(
            "{name} opens at {:.1e} m/s: joints, stops or driven bodies may contradict each other",
            joints.opening
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

fn not_finite(world: &World, body: usize, what: &'static str, value: f64) -> StepError {
    let (step, time) = (world.step, world.time);
    StepError::NotFinite { body: world.bodies.label(body), what, value, step, time }
}

fn cell_error(world: &World, error: ModelError) -> StepError {
    StepError::Cell { error, step: world.step, time: world.time }
}

fn check_state(world: &World) -> Result<(), StepError> {
    let bodies = &world.bodies;
    let lists = [
        ("position", &bodies.position),
        ("velocity", &bodies.velocity),
        ("angular velocity", &bodies.angular_velocity),
        ("external force", &bodies.force),
        ("external torque", &bodies.torque),
    ];
    finite("a component of gravity", &world.gravity.to_array())?;
    for (what, list) in lists {
        if let Some(body) = list.iter().position(|v| !v.is_finite()) {
            let value = list[body].to_array().into_iter().find(|x| !x.is_finite()).unwrap_or(f64::NAN);
            return Err(not_finite(world, body, what, value));
        }
    }
    match bodies.orientation.iter().position(|q| !q.is_finite()) {
        Some(body) => Err(not_finite(world, body, "orientation", f64::NAN)),
        None => Ok(()),
    }
}

fn check_velocity(world: &World, velocity: &[f64]) -> Result<(), StepError> {
    match velocity.iter().position(|v| !v.is_finite()) {
        Some(k) => {
            let what = if k % 6 < 3 { "velocity" } else { "angular velocity" };
            Err(not_finite(world, k / 6, what, velocity[k]))
        }
        None => Ok(()),
    }
}
