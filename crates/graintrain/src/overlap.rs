//! Overlap is removed by displacements, not by velocities.
//!
//! After the velocities of a step are known, contact i will have the gap `Phi_i + dt D_i,n^T v+`. Where that
//! lies below what is allowed, bodies are displaced by the least (in the norm of the mass matrix) that mends
//! it and makes no new overlap,
//!
//! ```text
//! min 1/2 dq^T M dq   subject to   Phi_i + dt D_i,n^T v+ + D_i,n^T dq >= target_i
//! ```
//!
//! whose optimality conditions are a contact problem without friction with the same N, joints included but
//! for stops and motors with a limit (solved to few digits, with a little softness, by `projection`; where
//! bodies hang on joints, by a contact solver). The displacement leaves no velocity, so a state that came
//! with overlaps gets no kinetic energy from them, whatever the step; what it does against gravity is
//! reported.
//!
//! What a step adds to an overlap because bodies that turn are not where the linearised gap says (a disc that
//! wobbles nearly flat changes the place where it stands by a tenth of a radian of its rim in a step) is
//! removed in the same way at the end of that step, with the contacts that are then.
//!
//! Source: C. W. Gear, B. Leimkuhler, G. K. Gupta, "Automatic integration of Euler-Lagrange equations with
//! constraints", J. Comput. Appl. Math. 12-13:77-90, 1985 (a multiplier of its own for positions); as a
//! projection after each step: V. Acary, "Projected event-capturing time-stepping schemes for nonsmooth
//! mechanical systems with unilateral contact and Coulomb's friction", Comput. Methods Appl. Mech. Engrg.
//! 256:224-250, 2013.

use crate::math::Vec3;
use crate::parts::{Part, parts};
use crate::projection::project;
use graintrain_ccp::{
    BodyInverseMass, Ccp, CcpSolver, CoupledBodies, Delassus, FIXED, RigidContact, SolveSettings, Status,
};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A contact moves nothing where joints leave less than this of what it could move without them.
const RIGID: f64 = 1e-10;

/// What corrections are tuned by. Values: docs/mechanics.md, "Overlap"; held by `tests/physics/trust.rs`.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// An overlap above this fraction of the smaller body's size starts a correction of its part.
    pub trigger: f64,
    /// The same per tolerance of the solve, where that is more: whoever asks for 1e-2 lets every step add
    /// overlap, and a correction of all contacts in every step costs as much as the solve (a tenth of the
    /// common drop at 1e-2).
    pub trigger_per_tolerance: f64,
    /// A correction leaves this overlap, as a fraction of the size: contacts that just touch would part and
    /// meet again with every rounding.
    pub kept: f64,
    /// At most this fraction of |gravity| dt^2 of overlap is removed per step and contact, so that contacts
    /// that carry weight do not open by more than the step closes again.
    pub per_step: f64,
    /// Overlap beyond this fraction of the size is an accident.
    pub accident: f64,
    /// This fraction of an accident is removed per step, however short that is.
    pub accident_share: f64,
    /// A correction moves the bodies of the contacts that need it and those up to so many contacts away; the
    /// others hold still.
    pub rings: usize,
    /// Sweeps of a correction at least; what is left is for the next step.
    pub sweeps: usize,
    /// Sweeps carry a correction from contact to contact, and one cut short pushes overlap from here to
    /// there: a tall column of few contacts gets as many as so many visits to contacts allow.
    pub visits: usize,
    /// Softness of a contact per sweep fewer: what so many sweeps do not carry on is given up, so that what
    /// is jammed has a solution.
    pub softness: f64,
    /// Corrections of what a step did not foresee, one after the other: a displacement turns bodies, too.
    pub rounds: usize,
    /// After three of them, the deepest overlap has to fall by this factor below the least so far.
    pub progress: f64,
    /// Accuracy of a correction, relative to the largest displacement that its contacts ask for.
    pub tolerance: f64,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            trigger: 5e-4,
            trigger_per_tolerance: 0.4,
            kept: 1e-4,
            per_step: 0.2,
            accident: 1e-2,
            accident_share: 0.2,
            rings: 2,
            sweeps: 20,
            visits: 100_000,
            softness: 0.4,
            rounds: 10,
            progress: 0.9,
            tolerance: 0.1,
        }
    }
}

impl Parameters {
    /// The overlap over size that starts a correction.
    pub(crate) fn trigger(&self, tolerance: f64) -> f64 {
        self.trigger.max(self.trigger_per_tolerance * tolerance)
    }
}

/// What the correction of a step did.
#[derive(Clone, Debug, Default)]
pub(crate) struct Correction {
    /// Translation (m) and turn (rad) of every body, six numbers each; `None` where nothing had to be moved.
    pub displacement: Option<Vec<f64>>,
    /// Largest overlap that was above what starts a correction, m.
    pub overlap_max: f64,
    /// The same over the size of its smaller body.
    pub overlap_max_over_size: f64,
}

impl Correction {
    /// What the displacements do against gravity, J, with the masses of the bodies.
    pub(crate) fn work(&self, mass: &[f64], gravity: Vec3) -> f64 {
        let of_body = |(d, mass): (&[f64], &f64)| -mass * gravity.dot(Vec3::from_slice(&d[..3]));
        self.displacement.as_ref().map_or(0.0, |all| all.chunks_exact(6).zip(mass).map(of_body).sum())
    }

    /// Counts a displacement (six numbers per body) that came after it.
    pub(crate) fn add(&mut self, displacement: Option<Vec<f64>>) {
        match (&mut self.displacement, displacement) {
            (Some(own), Some(more)) => own.iter_mut().zip(more).for_each(|(own, more)| *own += more),
            (own @ None, more) => *own = more,
            _ => {}
        }
    }
}

/// How much of its overlap a contact loses in a correction.
#[derive(Clone, Copy)]
pub(crate) enum Share<'a> {
    /// As [`Parameters`] say, with |gravity| dt^2, m.
    Slow(f64),
    /// What the linearised gap did not foresee of every contact, m.
    Unforeseen(&'a [f64]),
}

/// What a correction has to know of the contacts.
pub(crate) struct Gaps<'a> {
    pub rows: &'a [RigidContact],
    pub inverse_mass: &'a [BodyInverseMass],
    /// Gap at the end of the step, m.
    pub gap: &'a [f64],
    /// Size of the smaller body, m.
    pub size: &'a [f64],
    /// How much of the overlap is removed.
    pub share: Share<'a>,
    /// Tolerance of the step's solve.
    pub tolerance: f64,
    pub parameters: &'a Parameters,
    pub stop: Option<Arc<AtomicBool>>,
}

impl Gaps<'_> {
    fn trigger(&self) -> f64 {
        self.parameters.trigger(self.tolerance)
    }

    fn overlap_over_size(&self, i: u32) -> f64 {
        -self.gap[i as usize] / self.size[i as usize]
    }

    /// How far contact i may close, negative: how far it has to open, m.
    fn room(&self, i: u32) -> f64 {
        let (gap, size) = (self.gap[i as usize], self.size[i as usize]);
        let p = self.parameters;
        let room = gap + p.kept * size;
        if room >= 0.0 {
            return room;
        }
        let limit = match self.share {
            Share::Unforeseen(error) => error[i as usize].max(0.0),
            Share::Slow(fall) => {
                let accident = p.accident_share * (-gap - p.accident * size).max(0.0);
                accident.max(if fall > 0.0 { p.per_step * fall } else { p.accident_share * -room })
            }
        };
        -(-room).min(limit)
    }

    /// The correction; the groups of bodies that joints couple, where one is needed, and what solves contacts
    /// with them.
    pub(crate) fn correct(
        &self,
        coupled: impl FnOnce() -> Vec<CoupledBodies>,
        solver: &mut dyn CcpSolver,
    ) -> Correction {
        let mut correction = Correction::default();
        let trigger = self.trigger();
        let worst = (0..self.gap.len() as u32)
            .map(|i| self.overlap_over_size(i))
            .enumerate()
            .fold((0, trigger), |worst, next| if next.1 > worst.1 { next } else { worst });
        if worst.1 <= trigger {
            return correction;
        }
        (correction.overlap_max, correction.overlap_max_over_size) = (-self.gap[worst.0], worst.1);
        let mut displacement = vec![0.0; 6 * self.inverse_mass.len()];
        let coupled = coupled();
        let moving = self.neighbourhood(&coupled);
        let held = |body: u32| if body != FIXED && moving[body as usize] { body } else { FIXED };
        let (mut chosen, mut rows) = (Vec::new(), Vec::new());
        for (i, row) in (0..).zip(self.rows) {
            let [body_a, body_b] = [held(row.body_a), held(row.body_b)];
            if [body_a, body_b] != [FIXED; 2] {
                chosen.push(i);
                rows.push(RigidContact { body_a, body_b, ..*row });
            }
        }
        let room: Vec<f64> = chosen.into_iter().map(|i| self.room(i)).collect();
        for part in parts(&rows, 0..rows.len() as u32, moving.len(), &coupled) {
            let has = |group: &CoupledBodies| part.bodies.binary_search(&group.bodies[0]).is_ok();
            if coupled.iter().any(has) {
                self.correct_coupled(part, (&rows, &room), &coupled, solver, &mut displacement);
            } else {
                let own = part.contacts.iter().map(|&k| (&rows[k as usize], room[k as usize]));
                self.correct_part(&own.collect::<Vec<_>>(), &mut displacement);
            }
        }
        correction.displacement = Some(displacement);
        correction
    }

    /// Which bodies a correction may move; of those that joints couple all.
    fn neighbourhood(&self, coupled: &[CoupledBodies]) -> Vec<bool> {
        let mut moving = vec![false; self.inverse_mass.len()];
        for ring in 0..=self.parameters.rings {
            let before = moving.clone();
            let reached = |body: u32| body != FIXED && before[body as usize];
            for (i, row) in self.rows.iter().enumerate() {
                let starts = ring == 0 && self.overlap_over_size(i as u32) > 0.5 * self.trigger();
                if starts || reached(row.body_a) || reached(row.body_b) {
                    for body in [row.body_a, row.body_b].into_iter().filter(|&body| body != FIXED) {
                        moving[body as usize] = true;
                    }
                }
            }
            for CoupledBodies { bodies, .. } in coupled {
                let any = bodies.iter().any(|&body| moving[body as usize]);
                bodies.iter().for_each(|&body| moving[body as usize] |= any);
            }
        }
        moving
    }

    /// The displacements of the bodies of these contacts, each with how far it may close, m.
    fn correct_part(&self, contacts: &[(&RigidContact, f64)], displacement: &mut [f64]) {
        let largest = contacts.iter().map(|(_, room)| -room).fold(0.0, f64::max);
        let &Parameters { sweeps, visits, softness, tolerance, .. } = self.parameters;
        let sweeps = sweeps.max(visits / contacts.len().max(1));
        let softness = softness / sweeps as f64;
        project(contacts, self.inverse_mass, displacement, (tolerance * largest, sweeps), softness);
    }

    /// The same of a part with bodies that joints couple: contacts that can hardly move anything are left
    /// out. What the solver finds is taken as it is: what it leaves is for the next correction.
    fn correct_coupled(
        &self,
        mut part: Part,
        (rows, room): (&[RigidContact], &[f64]),
        coupled: &[CoupledBodies],
        solver: &mut dyn CcpSolver,
        displacement: &mut [f64],
    ) {
        let &Parameters { sweeps, visits, softness, tolerance, .. } = self.parameters;
        let mut delassus = part.delassus(rows, self.inverse_mass, coupled);
        let alone = |body: u32| {
            self.inverse_mass
                .get(body as usize)
                .map_or(0.0, |inverse| Vec3::from_array(inverse.linear).max_element())
        };
        let moves = |(k, diagonal): (usize, &[f64; 3])| {
            let contact = part.contacts[k];
            let row = &rows[contact as usize];
            (diagonal[0] > RIGID * (alone(row.body_a) + alone(row.body_b))).then_some(contact)
        };
        let kept: Vec<u32> = delassus.diagonal().iter().enumerate().filter_map(moves).collect();
        if kept.len() < part.contacts.len() {
            part.contacts = kept;
            delassus = part.delassus(rows, self.inverse_mass, coupled);
        }
        let room = part.gather::<1, f64>(room);
        let largest = room.iter().map(|room| -room).fold(0.0, f64::max);
        if largest == 0.0 {
            return;
        }
        let soft = softness / sweeps as f64;
        let compliance = delassus.diagonal().iter().map(|diagonal| soft * diagonal[0]).collect();
        let delassus = Delassus::Rigid(delassus.with_compliance(compliance));
        let r = room.iter().flat_map(|&room| [room, 0.0, 0.0]).collect();
        let problem = Ccp { velocity_scale: Some(largest), ..Ccp::bare(delassus, r, vec![0.0; room.len()]) };
        let settings = SolveSettings {
            tolerance,
            max_iterations: Some(sweeps.max(visits / room.len())),
            stop: self.stop.clone(),
            ..SolveSettings::default()
        };
        let mut multiplier = vec![0.0; problem.r.len()];
        let solved = solver.solve(&problem, &mut multiplier, &settings);
        if solved.is_ok_and(|report| report.status != Status::Stopped) {
            let mut work = problem.delassus.work();
            problem.delassus.multiply(&multiplier, &mut vec![0.0; multiplier.len()], &mut work);
            for (&body, q) in part.bodies.iter().zip(work.body_velocity().chunks_exact(6)) {
                displacement[6 * body as usize..6 * body as usize + 6].copy_from_slice(q);
            }
        }
    }
}
