//! Wedged bodies: contacts that the relaxation of friction locks, taken with exact friction.
//!
//! Where a contact slides, the relaxed law opens it, u_n = mu |u_t|. A grain between two walls that slide past each other would have to
//! push them apart by mu times their slip; where they cannot give way, no velocities do that and the relaxed problem of the step has no
//! solution, though with exact friction, which opens nothing, the grain just slides or rolls. One such grain among thousands keeps every
//! solver from its tolerance.
//!
//! **Found** by the lemma of Farkas ([`graintrain_ccp::solver::infeasible`]): impulses g in the cones with D g = 0 and r . g < 0; or with so
//! small a D g that a solution would throw bodies about. They live on a few contacts, and a
//! proof for the contacts among a few bodies holds for the whole. So where a solve does not arrive, the bodies around its worst contact
//! are looked at by themselves, a layer of neighbours at a time.
//!
//! **Solved** as a mixture: the contacts on which the proof lives get De Saxce's term, r_n + s with s = mu |u_t|, all others stay
//! relaxed. s is found by fixed point, from the exact solution among the few bodies, and the residual is that of the mixture with the
//! s of the velocities found. Source of the fixed point: F. Cadoux, "Analyse convexe et optimisation pour la dynamique non-reguliere", thesis,
//! Grenoble 2009.

use crate::assemble::scale_under;
use crate::part_solver::{self, as_matrix_unless_plain, solve_without_gain};
use crate::parts::Part;
use graintrain_ccp::residual::ResidualScale;
use graintrain_ccp::solver::infeasible::{self, Certificate};
use graintrain_ccp::{
    Ccp, CcpError, CcpSolver, CoupledBodies, Delassus, FIXED, FrictionModel, Residual, RigidDelassus,
    SolveReport, SolveSettings, Status,
};
use graintrain_linalg::real;
use std::sync::Arc;

/// What the search for wedges and the solution of their mixture are tuned by. Values: docs/mechanics.md, "When a run stops being physics"
/// (`sedimentation --set friction=1.0`, `direct-shear` with n = 1 and 4, `excavator`), held by `tests/physics/wedge.rs`.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Iterations after which a solve that has not arrived is looked at. Settled packings need hundreds.
    pub patience: usize,
    /// From this V on (see [`infeasible`]) contacts are taken for wedged: a relaxed solution, if there is one, throws some body away with
    /// this many times the velocity at which they meet, and exact friction needs nothing of the kind.
    pub thrown: f64,
    /// Iterations of exact friction at all contacts, where a mixture was not solved, from each start.
    pub everywhere: usize,
    /// Layers of neighbours around the worst contact that are looked at, one after the other.
    pub layers: Vec<usize>,
    /// Of the worst contacts so many are looked around.
    pub places: usize,
    /// Contacts among the bodies around one at most: the search factorises some dozen matrices of this size.
    pub contacts: usize,
    /// Contacts with more than this part of the proof's largest impulse take part in it.
    pub share: f64,
    /// Rounds of the fixed point over all wedges.
    pub rounds: usize,
    /// Iterations of a round. An s that is a little too small locks the contact again, and a solve to the end would follow that; for the
    /// same reason s falls by half of the way only.
    pub burst: usize,
    /// s is taken larger by this part of what the worst contact may be off by, so that the contacts stay unlocked.
    pub margin: f64,
    /// Rounds without taking a tenth off the residual after which another wedge is looked for.
    pub stuck: usize,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            patience: 4000,
            thrown: 30.0,
            everywhere: 5000,
            layers: vec![1, 2, 3, 6],
            places: 4,
            contacts: 2000,
            share: 1e-3,
            rounds: 60,
            burst: 200,
            margin: 0.3,
            stuck: 6,
        }
    }
}

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

    /// Of the bodies of a contact and `layers` of their neighbours, one at least.
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
            // Bodies that joints couple move together.
            let with_some =
                |group: &&CoupledBodies| group.bodies.iter().any(|b| bodies.binary_search(b).is_ok());
            let joined: Vec<u32> = rigid
                .coupled()
                .iter()
                .filter(with_some)
                .flat_map(|group| group.bodies.iter().copied())
                .collect();
            bodies.extend(joined);
            bodies.sort_unstable();
            bodies.dedup();
        }
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
                          not take the step to its tolerance either. The impulses are the best that were found; `--friction coulomb`, a gap, \
                          less friction or another motion may let them go";

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

/// A problem of which some contacts have exact friction.
struct Mixture<'a> {
    problem: &'a Ccp,
    scale: ResidualScale,
    /// The contacts with exact friction.
    exact: Vec<usize>,
    /// The relaxed problem as solvers take it, whose r contains the s with which it is solved.
    posed: Ccp,
    /// Relative velocities of the impulses looked at, m/s.
    velocity: Vec<f64>,
    /// The same with their own s.
    shifted: Vec<f64>,
}

impl<'a> Mixture<'a> {
    fn new(problem: &'a Ccp, posed: &Ccp) -> Self {
        let velocity = vec![0.0; problem.r.len()];
        let shifted = velocity.clone();
        let scale = ResidualScale::new(problem);
        Self { problem, scale, exact: Vec::new(), posed: posed.clone(), velocity, shifted }
    }

    /// Takes the velocities of these impulses; their residual.
    fn look_at(&mut self, g: &[f64]) -> Residual {
        self.problem.velocity(g, &mut self.velocity, &mut self.problem.delassus.work());
        self.shifted.copy_from_slice(&self.velocity);
        for &i in &self.exact {
            self.shifted[3 * i] += opening(self.problem, &self.velocity, i);
        }
        self.scale.residual(self.problem, g, &self.shifted, FrictionModel::Relaxed)
    }

    /// The contacts from the one with the largest residual down, for the impulses looked at.
    fn worst_first(&self, g: &[f64]) -> Vec<usize> {
        let measured =
            |i: usize| self.scale.of_contact(self.problem, g, &self.shifted, FrictionModel::Relaxed, i);
        let mut worst: Vec<(usize, f64)> =
            (0..self.problem.num_contacts()).map(|i| (i, measured(i))).collect();
        worst.sort_by(|a, b| b.1.total_cmp(&a.1));
        worst.into_iter().map(|(i, _)| i).collect()
    }

    /// By how much s is taken larger than it is, m/s: `part` is [`Parameters::margin`]. The root mean square, too, has to leave room for it.
    fn margin(&self, settings: &SolveSettings, part: f64) -> f64 {
        let SolveSettings { tolerance, judge, .. } = settings;
        let share = (self.problem.num_contacts() as f64 / self.exact.len().max(1) as f64).sqrt();
        part * self.scale.velocity * judge.maximum(*tolerance).min(share * tolerance)
    }

    /// Poses the problem anew with the s of the impulses looked at.
    fn follow(&mut self, margin: f64) {
        for &i in &self.exact {
            let wanted = opening(self.problem, &self.velocity, i) + margin;
            let given = self.posed.r[3 * i] - self.problem.r[3 * i];
            let taken = if wanted < given { 0.5 * (wanted + given) } else { wanted };
            self.posed.r[3 * i] = self.problem.r[3 * i] + taken;
        }
    }

    /// Contacts of a wedge join.
    fn join(&mut self, wedge: Vec<WedgedContact>, impulse: &mut [f64], margin: f64) {
        for WedgedContact { contact: i, impulse: own, opening } in wedge {
            impulse[3 * i..3 * i + 3].copy_from_slice(&own);
            if !self.exact.contains(&i) {
                self.posed.r[3 * i] += opening + margin;
                self.exact.push(i);
            }
        }
    }

    /// Whether a contact touches none of the bodies that are wedged in.
    fn is_beside(&self, rigid: &RigidDelassus, contact: usize) -> bool {
        let ends = |i: usize| [rigid.contacts()[i].body_a, rigid.contacts()[i].body_b];
        let wedged = |body: u32| body != FIXED && self.exact.iter().any(|&i| ends(i).contains(&body));
        !ends(contact).into_iter().any(wedged)
    }
}

/// A problem whose relaxed solve did not arrive, on the way to its mixture.
pub(crate) struct Wedges<'a> {
    pub solver: &'a mut dyn CcpSolver,
    pub settings: &'a SolveSettings,
    pub parameters: &'a part_solver::Parameters,
    /// |gravity|, m/s^2, and dt, s.
    pub under: (f64, f64),
    /// Iterations that the relaxed solve took; they count against the limit of the settings.
    pub spent: usize,
}

/// What came of looking for wedges.
pub(crate) enum Search {
    /// None were found.
    Nothing,
    /// Some were, but neither was their mixture solved nor is it proved that the relaxed problem has no solution. What that took.
    Unsolved(SolveReport),
    /// The report, and the contacts with exact friction as places in the problem; none where the mixture was not solved.
    Ended(SolveReport, Vec<usize>),
}

impl Wedges<'_> {
    /// Solves the mixture from impulses `g` that a relaxed solve from `start` ended with (`posed`: the problem as solvers take it). Residuals
    /// of the report are those of the mixture. Where a wedge was not solved either, the best impulses come back with
    /// [`Status::Infeasible`], if that the relaxed problem has no solution is proved; `g` is as it was where it is not.
    ///
    /// # Errors
    /// Those of the solver.
    pub(crate) fn solve(
        &mut self,
        problem: &Ccp,
        posed: &Ccp,
        start: &[f64],
        g: &mut [f64],
    ) -> Result<Search, CcpError> {
        let Delassus::Rigid(rigid) = &*problem.delassus else { return Ok(Search::Nothing) };
        let &Parameters { rounds, burst, stuck, .. } = &self.parameters.wedges;
        let mut mixture = Mixture::new(problem, posed);
        let mut proved = 0.0_f64;
        let mut impulse = g.to_vec();
        let mut told: Option<SolveReport> = None;
        let (mut least, mut since) = (f64::INFINITY, stuck);
        let mut best = BestMixture { judged: f64::INFINITY, ..BestMixture::default() };
        for round in 0..=rounds {
            let margin = mixture.margin(self.settings, self.parameters.wedges.margin);
            let found = mixture.look_at(&impulse);
            mixture.follow(margin);
            let judged = found.judged(self.settings.judge);
            if told.is_some() && judged < best.judged {
                best = BestMixture { judged, residual: found, impulse: impulse.clone() };
                if judged <= self.settings.tolerance {
                    break;
                }
            }
            (least, since) = if judged < 0.9 * least { (judged, 0) } else { (least, since + 1) };
            if mixture.exact.is_empty() || since >= stuck {
                let Some((wedge, needed_velocity)) = self.find(&mixture, &impulse, rigid)? else { break };
                proved = proved.max(needed_velocity);
                mixture.join(wedge, &mut impulse, margin);
                (least, since) = (f64::INFINITY, 0);
            }
            let left = self.iterations_left(told.as_ref());
            if round == rounds || left == 0 {
                break;
            }
            // What s changes after the solve comes on top of what the solve leaves.
            let settings = SolveSettings {
                tolerance: 0.5 * self.settings.tolerance,
                max_iterations: Some(burst.min(left)),
                ..self.settings.clone()
            };
            let report = solve_without_gain(
                self.solver,
                &self.parameters.few,
                &mixture.posed,
                &mut impulse,
                &settings,
            )?;
            if report.status == Status::Stopped {
                return Ok(Search::Ended(report, Vec::new()));
            }
            told = Some(match &told {
                Some(earlier) => report.after(earlier),
                None => report,
            });
        }
        let Some(mut told) = told else { return Ok(Search::Nothing) };
        (told.status, told.remark) = (Status::Infeasible, Some(LOCKED_TOO.to_string()));
        if best.judged > self.settings.tolerance {
            told = self.everywhere(&mut mixture, start, &mut best, told)?;
        }
        // No number is larger than the tolerance, and none smaller, where all of them were NaN.
        if best.impulse.is_empty() {
            return Ok(Search::Unsolved(told));
        }
        if best.judged > self.settings.tolerance && told.status != Status::Stopped {
            told = self.beside(&mut mixture, rigid, &mut best, told)?;
        }
        if told.status == Status::Stopped {
            return Ok(Search::Ended(told, Vec::new()));
        }
        if best.judged <= self.settings.tolerance {
            (told.status, told.remark) = (Status::Converged, None);
        } else if proved < infeasible::PROBABLE {
            return Ok(Search::Unsolved(told));
        }
        g.copy_from_slice(&best.impulse);
        mixture.look_at(g);
        let found = mixture.scale.evaluate(problem, g, &mixture.velocity);
        let report = SolveReport {
            residual: best.residual,
            residual_relaxed: found.relaxed,
            residual_coulomb: found.coulomb,
            residual_paper: found.paper_relaxed,
            objective: problem.objective(g, &mixture.velocity),
            ..told
        };
        let wedged = if report.converged() { mixture.exact } else { Vec::new() };
        Ok(Search::Ended(report, wedged))
    }

    /// Iterations that the settings leave after the relaxed solve and these.
    fn iterations_left(&self, told: Option<&SolveReport>) -> usize {
        let spent = self.spent + told.map_or(0, |told| told.iterations);
        self.settings.max_iterations.map_or(usize::MAX, |most| most.saturating_sub(spent))
    }

    /// Where what is left lies in the bed beside the wedges, which had bursts of iterations only, the bed is solved as long as the settings
    /// allow, with the s of the best impulses. The report after that, which is `told` where nothing was to be done or the wedges were left behind by it.
    fn beside(
        &mut self,
        mixture: &mut Mixture<'_>,
        rigid: &RigidDelassus,
        best: &mut BestMixture,
        told: SolveReport,
    ) -> Result<SolveReport, CcpError> {
        mixture.look_at(&best.impulse);
        let worst = mixture.worst_first(&best.impulse);
        let left = self.iterations_left(Some(&told));
        if left == 0 || !worst.first().is_some_and(|&worst| mixture.is_beside(rigid, worst)) {
            return Ok(told);
        }
        mixture.follow(mixture.margin(self.settings, self.parameters.wedges.margin));
        let mut impulse = best.impulse.clone();
        let max_iterations = self.settings.max_iterations.map(|_| left);
        let settings = SolveSettings { max_iterations, ..self.settings.clone() };
        let report =
            solve_without_gain(self.solver, &self.parameters.few, &mixture.posed, &mut impulse, &settings)?;
        let (status, remark) = match report.status {
            // What it proves holds for the s that was taken alone.
            Status::Converged | Status::Infeasible => (told.status, told.remark.clone()),
            status => (status, report.remark.clone()),
        };
        let residual = mixture.look_at(&impulse);
        let judged = residual.judged(self.settings.judge);
        if judged < best.judged {
            *best = BestMixture { judged, residual, impulse };
        }
        Ok(SolveReport { status, remark, ..report.after(&told) })
    }

    /// Exact friction at all contacts, which fares better than the mixture where a wedge is a good part of the whole: from the impulses
    /// that the step began with, then from none. Those of a mixture that was not solved are of bodies that press each other without end.
    fn everywhere(
        &mut self,
        mixture: &mut Mixture<'_>,
        start: &[f64],
        best: &mut BestMixture,
        mut told: SolveReport,
    ) -> Result<SolveReport, CcpError> {
        // De Saxce's term is the solver's affair here.
        let posed = Ccp { r: mixture.problem.r.clone(), ..mixture.posed.clone() };
        let wedges = std::mem::replace(&mut mixture.exact, (0..mixture.problem.num_contacts()).collect());
        let nothing = vec![0.0; start.len()];
        let is_warm = start.iter().any(|&g| g != 0.0);
        for start in [start, &nothing].into_iter().take(1 + usize::from(is_warm)) {
            let left = self.iterations_left(Some(&told));
            let settings = SolveSettings {
                friction: FrictionModel::Coulomb,
                max_iterations: Some(self.parameters.wedges.everywhere.min(left)),
                curvature: None,
                ..self.settings.clone()
            };
            let mut impulse = start.to_vec();
            if left == 0 {
                break;
            }
            let report =
                solve_without_gain(self.solver, &self.parameters.few, &posed, &mut impulse, &settings)?;
            let status = if report.status == Status::Stopped { report.status } else { told.status };
            let (solved, remark) = (report.converged(), told.remark.clone());
            told = SolveReport { status, remark, ..report.after(&told) };
            if status == Status::Stopped {
                break;
            }
            let residual = mixture.look_at(&impulse);
            let judged = residual.judged(self.settings.judge);
            if solved && judged <= self.settings.tolerance {
                *best = BestMixture { judged, residual, impulse };
                return Ok(told);
            }
        }
        mixture.exact = wedges;
        Ok(told)
    }

    /// The wedge around the worst of the contacts that have one, for the impulses looked at, but for those whose contacts are known; and the
    /// velocity that its proof asks for, 0 where joints couple bodies.
    fn find(
        &mut self,
        mixture: &Mixture<'_>,
        impulse: &[f64],
        rigid: &RigidDelassus,
    ) -> Result<Option<(Vec<WedgedContact>, f64)>, CcpError> {
        let parameters = &self.parameters.wedges;
        let mut seen: Vec<u32> = Vec::new();
        let mut places = 0;
        for contact in mixture.worst_first(impulse) {
            if seen.contains(&(contact as u32)) {
                continue;
            }
            for &layers in &parameters.layers {
                let mut excerpt = Excerpt::around(contact, layers, &mixture.posed, rigid, self.under);
                if excerpt.problem.num_contacts() > parameters.contacts {
                    break;
                }
                // The proof for a matrix asks for impulses instead of velocities: a heavy body on a light one asks for large ones, too.
                let matrix = as_matrix_unless_plain(&excerpt.problem);
                let is_plain = matrix.is_none();
                excerpt.problem = matrix.unwrap_or(excerpt.problem);
                let proof = infeasible::certificate_within(&excerpt.problem, self.settings)?;
                seen.extend(&excerpt.part.contacts);
                if proof.needed_velocity >= parameters.thrown {
                    let is_new = |k: usize| !mixture.exact.contains(&(excerpt.part.contacts[k] as usize));
                    if taking_part(&proof, parameters.share).any(is_new) {
                        let proved = if is_plain { proof.needed_velocity } else { 0.0 };
                        return Ok(self.wedge(&excerpt, &proof)?.map(|wedge| (wedge, proved)));
                    }
                    break;
                }
            }
            places += 1;
            if places == parameters.places {
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
            max_iterations: Some(self.parameters.wedges.patience),
            curvature: None,
            ..self.settings.clone()
        };
        // Without friction, too, there may be no room; where exact friction stalls, its best answer is a start all the same.
        let exact = self.solver.solve(own, &mut impulse, &settings)?;
        if matches!(exact.status, Status::Infeasible | Status::Stopped) {
            return Ok(None);
        }
        let mut velocity = vec![0.0; own.r.len()];
        own.velocity(&impulse, &mut velocity, &mut own.delassus.work());
        let of = |k: usize| WedgedContact {
            contact: excerpt.part.contacts[k] as usize,
            impulse: [impulse[3 * k], impulse[3 * k + 1], impulse[3 * k + 2]],
            opening: opening(own, &velocity, k),
        };
        Ok(Some(taking_part(proof, self.parameters.wedges.share).map(of).collect()))
    }
}

/// The contacts on which a proof lives: those with more than this share of its largest impulse.
fn taking_part(proof: &Certificate, share: f64) -> impl Iterator<Item = usize> {
    let largest = proof.ray.iter().step_by(3).fold(0.0_f64, |m, &g| m.max(g));
    (0..proof.ray.len() / 3).filter(move |k| proof.ray[3 * k] > share * largest)
}

/// s = mu |u_t| of a contact, m/s.
fn opening(problem: &Ccp, velocity: &[f64], i: usize) -> f64 {
    problem.friction[i] * real::hypot(velocity[3 * i + 1], velocity[3 * i + 2])
}
