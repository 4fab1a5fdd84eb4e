//! Wedged bodies: contacts that the relaxation of friction locks, taken with exact friction.
//!
//! Where a contact slides, the relaxed law opens it, u_n = mu |u_t|. A grain between two walls that slide past each other would have to
//! push them apart by mu times their slip; where they cannot give way, no velocities do that and the relaxed problem of the step has no
//! solution, though with exact friction, which opens nothing, the grain just slides or rolls. One such grain among thousands keeps every
//! solver from its tolerance.
//!
//! **Found** by the lemma of Farkas ([`graintrain_ccp::solver::infeasible`]): impulses g in the cones with D g = 0 and r . g < 0. They live on a few contacts, and a
//! proof for the contacts among a few bodies holds for the whole. So where a solve does not arrive, the bodies around its worst contact
//! are looked at by themselves, a layer of neighbours at a time.
//!
//! **Solved** as a mixture: the contacts on which the proof lives get De Saxce's term, r_n + s with s = mu |u_t|, all others stay
//! relaxed. s is found by fixed point, from the exact solution among the few bodies, and the residual is that of the mixture with the
//! s of the velocities found. Source of the fixed point: F. Cadoux, "Analyse convexe et optimisation pour la dynamique non-reguliere", thesis,
//! Grenoble 2009.

use crate::assemble::scale_under;
use crate::part_solver::solve_without_gain;
use crate::parts::Part;
use graintrain_ccp::residual::ResidualScale;
use graintrain_ccp::solver::infeasible::{self, Certificate};
use graintrain_ccp::{
    Ccp, CcpError, CcpSolver, Delassus, FIXED, FrictionModel, Residual, RigidDelassus, SolveReport,
    SolveSettings, Status,
};
use std::sync::Arc;

/// Iterations after which a solve that has not arrived is looked at. Settled packings need hundreds.
pub(crate) const PATIENCE: usize = 4000;

/// Layers of neighbours around the worst contact that are looked at.
const LAYERS: usize = 3;

/// Of the worst contacts so many are looked around.
const PLACES: usize = 4;

/// Contacts among the bodies around one at most: the search factorises some dozen matrices of this size.
const CONTACTS: usize = 2000;

/// Contacts with more than this part of the proof's largest impulse take part in it.
const SHARE: f64 = 1e-3;

/// Rounds of the fixed point over all wedges.
const ROUNDS: usize = 60;

/// Iterations of a round. An s that is a little too small locks the contact again, and a solve to the end would follow that; for the same
/// reason s falls by half of the way only.
const BURST: usize = 200;

/// s is taken larger by this part of what the worst contact may be off by, so that the contacts stay unlocked.
const MARGIN: f64 = 0.3;

/// Rounds without taking a tenth off the residual after which another wedge is looked for.
const STUCK: usize = 6;

/// The problem among a few bodies of a larger one.
#[derive(Debug)]
pub(crate) struct Excerpt {
    pub part: Part,
    pub problem: Ccp,
}

impl Excerpt {
    /// The contacts among the bodies of `part`, posed as a problem of their own under this gravity (m/s^2) for this step (s).
    pub(crate) fn new(part: Part, problem: &Ccp, rigid: &RigidDelassus, (gravity, step): (f64, f64)) -> Self {
        let (rows, turning, places) = part.turning(rigid.turning(), &problem.turning);
        let matrix = part.delassus(rigid.contacts(), rigid.inverse_mass(), rigid.coupled());
        let compliance = rigid.compliance();
        let compliance = if compliance.is_empty() { Vec::new() } else { part.gather::<1, f64>(compliance) };
        let mut r = part.gather::<3, f64>(&problem.r);
        let first = 3 * problem.num_contacts();
        r.extend(places.iter().flat_map(|k| problem.r[first + 3 * k..first + 3 * k + 3].iter()));
        let own = Ccp {
            delassus: Arc::new(Delassus::Rigid(matrix.with_turning(rows).with_compliance(compliance))),
            r,
            friction: part.gather::<1, f64>(&problem.friction),
            turning,
            velocity_scale: None,
            impulse_scale: problem.impulse_scale,
            points: part.gather::<1, [f64; 3]>(&problem.points),
            identity: part.gather::<1, u64>(&problem.identity),
        };
        let velocity_scale = scale_under(gravity, step, &own.r, &own.friction);
        Self { part, problem: Ccp { velocity_scale, ..own } }
    }

    /// Of the bodies of a contact and `layers` of their neighbours.
    fn around(
        contact: usize,
        layers: usize,
        problem: &Ccp,
        rigid: &RigidDelassus,
        under: (f64, f64),
    ) -> Self {
        let ends = |i: usize| {
            let row = &rigid.contacts()[i];
            [row.body_a, row.body_b].into_iter().filter(|&body| body != FIXED)
        };
        let mut bodies: Vec<u32> = ends(contact).collect();
        for _ in 0..layers {
            let sides = bodies.iter().flat_map(|&body| rigid.sides(body as usize));
            let mut more: Vec<u32> = sides.flat_map(|side| ends(side.contact as usize)).collect();
            more.append(&mut bodies);
            more.sort_unstable();
            more.dedup();
            bodies = more;
        }
        bodies.sort_unstable();
        let sides = bodies.iter().flat_map(|&body| rigid.sides(body as usize)).map(|side| side.contact);
        let mut contacts: Vec<u32> =
            sides.filter(|&i| ends(i as usize).all(|body| bodies.binary_search(&body).is_ok())).collect();
        contacts.sort_unstable();
        contacts.dedup();
        Self::new(Part { contacts, bodies }, problem, rigid, under)
    }
}

/// Said where a wedge is locked with exact friction, too.
const LOCKED_TOO: &str = "bodies are wedged in: relaxed friction has no solution, which was proved, and exact friction at their contacts did \
                          not take the step to its tolerance either. The impulses are the best that were found; a gap, less friction or another \
                          motion lets them go";

/// The best impulses so far.
#[derive(Default)]
struct BestMixture {
    judged: f64,
    residual: Residual,
    impulse: Vec<f64>,
}

/// A contact of a wedge in the exact solution among the bodies around.
struct WedgedContact {
    contact: usize,
    impulse: [f64; 3],
    /// s, m/s.
    opening: f64,
}

/// A problem whose relaxed solve did not arrive, on the way to its mixture.
pub(crate) struct Wedges<'a> {
    pub solver: &'a mut dyn CcpSolver,
    pub settings: &'a SolveSettings,
    /// |gravity|, m/s^2, and dt, s.
    pub under: (f64, f64),
}

impl Wedges<'_> {
    /// Solves the mixture from impulses `g` that a relaxed solve ended with; the report, whose residuals are those of the mixture, and the
    /// contacts with exact friction. Where the mixture was not solved either, the best impulses come back with
    /// [`Status::Infeasible`]: that the relaxed problem has none is proved. `None`, and `g` as it was, where no wedge was found.
    ///
    /// # Errors
    /// Those of the solver.
    pub(crate) fn solve(
        &mut self,
        problem: &Ccp,
        g: &mut [f64],
    ) -> Result<Option<(SolveReport, Vec<usize>)>, CcpError> {
        let Delassus::Rigid(rigid) = &*problem.delassus else { return Ok(None) };
        let scale = ResidualScale::new(problem);
        let mut velocity = vec![0.0; g.len()];
        let mut work = problem.delassus.work();
        let mut product = |g: &[f64], u: &mut [f64]| {
            problem.delassus.multiply(g, u, &mut work);
            u.iter_mut().zip(&problem.r).for_each(|(u, r)| *u += r);
        };
        let mut mixture = problem.clone();
        let mut impulse = g.to_vec();
        let mut exact: Vec<usize> = Vec::new();
        let mut told: Option<SolveReport> = None;
        let contacts = problem.num_contacts() as f64;
        // The root mean square, too, has to leave room for it.
        let margin = |exact: &[usize]| {
            let Self { settings: SolveSettings { tolerance, judge, .. }, .. } = self;
            let share = (contacts / exact.len().max(1) as f64).sqrt();
            MARGIN * scale.velocity * judge.maximum(*tolerance).min(share * tolerance)
        };
        let (mut least, mut since) = (f64::INFINITY, STUCK);
        let mut best = BestMixture { judged: f64::INFINITY, ..BestMixture::default() };
        for round in 0..=ROUNDS {
            let margin = margin(&exact);
            product(&impulse, &mut velocity);
            let mut shifted = velocity.clone();
            for &i in &exact {
                let s = opening(problem, &velocity, i);
                let (wanted, given) = (s + margin, mixture.r[3 * i] - problem.r[3 * i]);
                mixture.r[3 * i] =
                    problem.r[3 * i] + if wanted < given { 0.5 * (wanted + given) } else { wanted };
                shifted[3 * i] += s;
            }
            let found = scale.residual(&mixture, &impulse, &shifted, FrictionModel::Relaxed);
            let judged = found.judged(self.settings.judge);
            if told.is_some() && judged < best.judged {
                best = BestMixture { judged, residual: found, impulse: impulse.clone() };
                if judged <= self.settings.tolerance {
                    break;
                }
            }
            (least, since) = if judged < 0.9 * least { (judged, 0) } else { (least, since + 1) };
            if exact.is_empty() || since >= STUCK {
                let measured =
                    |i: usize| scale.of_contact(&mixture, &impulse, &shifted, FrictionModel::Relaxed, i);
                let mut worst: Vec<(usize, f64)> =
                    (0..problem.num_contacts()).map(|i| (i, measured(i))).collect();
                worst.sort_by(|a, b| b.1.total_cmp(&a.1));
                let wedge = self.find(&exact, worst.iter().map(|&(i, _)| i), &mixture, rigid)?;
                let Some(wedge) = wedge else { break };
                for WedgedContact { contact: i, impulse: own, opening } in wedge {
                    impulse[3 * i..3 * i + 3].copy_from_slice(&own);
                    if !exact.contains(&i) {
                        mixture.r[3 * i] += opening + margin;
                        exact.push(i);
                    }
                }
                (least, since) = (f64::INFINITY, 0);
            }
            if round == ROUNDS {
                break;
            }
            // What s changes after the solve comes on top of what the solve leaves.
            let settings = SolveSettings {
                tolerance: 0.5 * self.settings.tolerance,
                max_iterations: Some(BURST),
                ..self.settings.clone()
            };
            let report = solve_without_gain(self.solver, &mixture, &mut impulse, &settings)?;
            if report.status == Status::Stopped {
                return Ok(Some((report, exact)));
            }
            told = Some(match &told {
                Some(earlier) => report.after(earlier),
                None => report,
            });
        }
        let converged = best.judged <= self.settings.tolerance;
        let Some(told) = told else { return Ok(None) };
        g.copy_from_slice(&best.impulse);
        product(g, &mut velocity);
        let found = scale.evaluate(problem, g, &velocity);
        let report = SolveReport {
            status: if converged { Status::Converged } else { Status::Infeasible },
            residual: best.residual,
            residual_relaxed: found.relaxed,
            residual_coulomb: found.coulomb,
            residual_paper: found.paper_relaxed,
            objective: problem.objective(g, &velocity),
            remark: (!converged).then(|| LOCKED_TOO.to_string()),
            ..told
        };
        Ok(Some((report, exact)))
    }

    /// The wedge around the first of these contacts that has one, but for those whose contacts are `known`.
    fn find(
        &mut self,
        known: &[usize],
        contacts: impl Iterator<Item = usize>,
        problem: &Ccp,
        rigid: &RigidDelassus,
    ) -> Result<Option<Vec<WedgedContact>>, CcpError> {
        let mut seen: Vec<u32> = Vec::new();
        let mut places = 0;
        for contact in contacts {
            if seen.contains(&(contact as u32)) {
                continue;
            }
            for layers in 1..=LAYERS {
                let excerpt = Excerpt::around(contact, layers, problem, rigid, self.under);
                if excerpt.problem.num_contacts() > CONTACTS {
                    break;
                }
                let proof = infeasible::certificate_within(&excerpt.problem, self.settings)?;
                seen.extend(&excerpt.part.contacts);
                if proof.needed_velocity >= infeasible::PROBABLE {
                    let is_new = |k: usize| !known.contains(&(excerpt.part.contacts[k] as usize));
                    if taking_part(&proof).any(is_new) {
                        return self.wedge(&excerpt, &proof);
                    }
                    break;
                }
            }
            places += 1;
            if places == PLACES {
                break;
            }
        }
        Ok(None)
    }

    /// The contacts of the proof, with the exact solution among the bodies around; `None` where there is none without friction either.
    fn wedge(
        &mut self,
        excerpt: &Excerpt,
        proof: &Certificate,
    ) -> Result<Option<Vec<WedgedContact>>, CcpError> {
        let own = &excerpt.problem;
        let mut impulse = vec![0.0; own.r.len()];
        let settings = SolveSettings {
            friction: FrictionModel::Coulomb,
            max_iterations: Some(PATIENCE),
            curvature: None,
            ..self.settings.clone()
        };
        // Without friction, too, there may be no room; where exact friction stalls, its best answer is a start all the same.
        let exact = self.solver.solve(own, &mut impulse, &settings)?;
        if matches!(exact.status, Status::Infeasible | Status::Stopped) {
            return Ok(None);
        }
        let mut velocity = vec![0.0; own.r.len()];
        own.delassus.multiply(&impulse, &mut velocity, &mut own.delassus.work());
        velocity.iter_mut().zip(&own.r).for_each(|(u, r)| *u += r);
        let of = |k: usize| WedgedContact {
            contact: excerpt.part.contacts[k] as usize,
            impulse: [impulse[3 * k], impulse[3 * k + 1], impulse[3 * k + 2]],
            opening: opening(own, &velocity, k),
        };
        Ok(Some(taking_part(proof).map(of).collect()))
    }
}

/// The contacts on which a proof lives.
fn taking_part(proof: &Certificate) -> impl Iterator<Item = usize> {
    let largest = proof.ray.iter().step_by(3).fold(0.0_f64, |m, &g| m.max(g));
    (0..proof.ray.len() / 3).filter(move |k| proof.ray[3 * k] > SHARE * largest)
}

/// s = mu |u_t| of a contact, m/s.
fn opening(problem: &Ccp, velocity: &[f64], i: usize) -> f64 {
    problem.friction[i] * velocity[3 * i + 1].hypot(velocity[3 * i + 2])
}
