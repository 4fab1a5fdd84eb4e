//! One walk along the smoothed path: down in tau while that goes, by pseudo-arclength around folds.

use super::jacobian::Jacobian;
use super::smoothing::{Point, SmoothedProblem};
use crate::delassus::DelassusWork;
use crate::newton::NewtonRecord;
use crate::problem::Ccp;
use crate::residual::{FrictionModel, ResidualScale};
use crate::solver::driver::{Best, Limits};
use crate::solver::history::History;
use crate::solver::report::Status;
use graintrain_linalg::real;

/// How one walk goes about it.
#[derive(Clone, Copy, Debug)]
struct Walk {
    /// rms |G| / V over tau up to which a place counts as near the path.
    near: f64,
    /// kappa: delta_i of |y_t|_delta relative to eta_i tau_i.
    rounding: f64,
    /// Factorisations allowed.
    systems: usize,
}

const fn walk(near: f64, rounding: f64, systems: usize) -> Walk {
    Walk { near, rounding, systems }
}

/// Walks from `FIRST_TAU` down, one after the other until one of them converges.
const WALKS: [Walk; 6] = [
    walk(1.0, 1e-2, 200),
    walk(3.0, 1e-2, 200),
    walk(0.3, 3e-2, 400),
    walk(0.3, 1e-2, 400),
    walk(0.3, 1.0, 400),
    walk(3.0, 0.3, 400),
];
/// tau of the start, in units of V / eta_i.
const FIRST_TAU: f64 = 1e3;
/// Walks from the best impulses so far, at `WARM_TAU` times their residual, tried in turn.
const WARM_WALKS: [Walk; 3] = [walk(1.0, 1e-2, 60), walk(3.0, 1e-1, 60), walk(0.3, 1e-2, 100)];
/// See `WARM_WALKS`.
const WARM_TAU: f64 = 3.0;
/// Impulses of at most this residual are worth a warm walk.
const WARM_RESIDUAL: f64 = 1e-2;
/// Rounds of warm walks go on while the residual falls to this fraction.
const WARM_GAIN: f64 = 0.5;
/// First factor of tau per step, and the least.
const REDUCTION: [f64; 2] = [0.3, 1e-4];
/// rms |G| / V over tau up to which the arclength takes a place for one on the path.
const CENTRED: f64 = 1e-2;
/// Steps in a row without a fall of tau that end a descent.
const HARD: usize = 30;
/// Steps without a tenth off the least residual that end a descent below `LEAST_TAU`.
const PATIENCE: usize = 10;
/// tau over tolerance below which nothing is to be gained.
const LEAST_TAU: f64 = 1e-4;
/// Places near the path that are remembered.
const ANCHORS: usize = 10;
/// Newton steps of a correction.
const CORRECTIONS: usize = 12;
/// Growth of |G| that ends a correction.
const GROWTH: f64 = 2.0;
/// Change of w, relative to the size of x, that counts as much as a change of ln tau by 1.
const SPREAD: f64 = 0.3;
/// First, largest and least step of the arclength.
const STEP: [f64; 3] = [0.5, 4.0, 1e-6];
/// d ln tau / ds below minus this is free fall; so many steps of it end the arclength.
const FREE: (f64, usize) = (0.5, 3);

/// Factorisations of all walks together, where each round of warm walks is made once.
pub(super) fn systems() -> usize {
    let sum = |walks: &[Walk]| walks.iter().map(|walk| walk.systems).sum::<usize>();
    sum(&WALKS) + (1 + WALKS.len()) * sum(&WARM_WALKS)
}

/// How a part of the walk ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Leg {
    /// The solve is over.
    Over(Status),
    /// tau does not fall any more.
    Blocked,
    /// Beyond the folds tau falls freely again.
    Free,
    /// No step is possible, or none is left.
    Stuck,
}

/// A place on the path.
#[derive(Clone, Debug)]
struct Place {
    w: Vec<f64>,
    log_tau: f64,
}

impl Place {
    /// A step in the direction (w, ln tau).
    fn along(&self, w: &[f64], log_tau: f64, step: f64) -> Self {
        Self {
            w: self.w.iter().zip(w).map(|(own, w)| own + step * w).collect(),
            log_tau: self.log_tau + step * log_tau,
        }
    }
}

/// Directions at a place: Newton's at fixed tau, and dw / d ln tau along the path.
struct Directions {
    newton: Vec<f64>,
    tangent: Vec<f64>,
    sign: f64,
}

/// What all walks together have come to.
#[derive(Clone, Debug)]
pub(super) struct Story {
    /// Walks begun.
    pub walks: usize,
    /// Factorisations.
    pub systems: usize,
    /// Times that tau turned.
    pub folds: usize,
    /// Least tau reached, in units of V / eta_i.
    pub least_tau: f64,
    pub history: History,
    /// One per factorisation.
    pub records: Vec<NewtonRecord>,
}

impl Default for Story {
    fn default() -> Self {
        let (history, records) = Default::default();
        Self { walks: 0, systems: 0, folds: 0, least_tau: f64::INFINITY, history, records }
    }
}

/// The walks of one solve.
pub(super) struct Follower<'a> {
    problem: &'a Ccp,
    scale: &'a ResidualScale,
    limits: &'a Limits<'a>,
    model: FrictionModel,
    smoothed: SmoothedProblem<'a>,
    jacobian: &'a mut Jacobian,
    place: Place,
    point: Point,
    /// The last places near the path, the newest one last.
    anchors: Vec<Place>,
    /// Sign of the determinant where the path begins.
    first_sign: Option<f64>,
    /// How near the path this walk stays, and the factorisation that it ends with.
    walk: Walk,
    last_system: usize,
    pub best: Best<f64>,
    pub story: Story,
    impulse: Vec<f64>,
    velocity: Vec<f64>,
    work: DelassusWork,
}

impl<'a> Follower<'a> {
    pub fn new(
        problem: &'a Ccp,
        scale: &'a ResidualScale,
        limits: &'a Limits<'a>,
        model: FrictionModel,
        smoothed: SmoothedProblem<'a>,
        jacobian: &'a mut Jacobian,
    ) -> Self {
        let zeros = vec![0.0; 3 * problem.num_contacts()];
        Self {
            problem,
            scale,
            limits,
            model,
            smoothed,
            jacobian,
            place: Place { w: zeros.clone(), log_tau: 0.0 },
            point: Point::default(),
            anchors: Vec::new(),
            first_sign: None,
            walk: walk(1.0, 0.0, 0),
            last_system: 0,
            best: Best::default(),
            story: Story::default(),
            impulse: zeros.clone(),
            velocity: zeros,
            work: problem.delassus.work(),
        }
    }

    /// All walks, until one of them converges: from impulses g where these are near a solution, then from
    /// large tau.
    pub fn run(&mut self, g: &[f64]) -> Status {
        self.impulse.copy_from_slice(g);
        self.update_velocity();
        let found = self.scale.residual(self.problem, g, &self.velocity, self.model);
        let residual = self.limits.measured(found);
        self.best.offer(g, residual);
        if residual <= self.limits.tolerance() {
            return Status::Converged;
        }
        if let Some(status) = self.refine() {
            return status;
        }
        let cold = vec![0.0; g.len()];
        for walk in WALKS {
            self.begin(&cold, FIRST_TAU, walk);
            if let Some(status) = self.walk() {
                return status;
            }
            if let Some(status) = self.refine() {
                return status;
            }
        }
        Status::Stalled
    }

    /// Warm walks from the best impulses, as long as they gain.
    fn refine(&mut self) -> Option<Status> {
        let mut g = vec![0.0; self.impulse.len()];
        loop {
            let before = self.best.residual();
            if before.is_nan() || before > WARM_RESIDUAL {
                return None;
            }
            for walk in WARM_WALKS {
                self.best.restore(&mut g);
                self.begin(&g, WARM_TAU * self.best.residual(), walk);
                if let Some(status) = self.walk() {
                    return Some(status);
                }
            }
            if self.best.residual() > WARM_GAIN * before {
                return None;
            }
        }
    }

    /// A walk from impulses g at this tau.
    fn begin(&mut self, g: &[f64], tau: f64, walk: Walk) {
        self.impulse.copy_from_slice(g);
        self.update_velocity();
        self.smoothed.rounding = walk.rounding;
        self.smoothed.point_of(g, &self.velocity, &mut self.place.w);
        self.place.log_tau = real::ln(tau);
        self.anchors.clear();
        self.first_sign = None;
        self.walk = walk;
        self.last_system = self.story.systems + walk.systems;
        self.story.walks += 1;
    }

    /// Down, around folds, down again, until there is an end; the status where it is that of the solve.
    fn walk(&mut self) -> Option<Status> {
        loop {
            match self.descend() {
                Leg::Over(status) => return Some(status),
                Leg::Blocked => {}
                _ => return None,
            }
            match self.turn() {
                Leg::Over(status) => return Some(status),
                Leg::Free => {}
                _ => return None,
            }
        }
    }

    /// u = N g + r.
    fn update_velocity(&mut self) {
        self.problem.velocity(&self.impulse, &mut self.velocity, &mut self.work);
    }

    /// Why the solve ends with the impulses at the place reached, if it does; the best ones are kept.
    fn ended(&mut self) -> Option<Status> {
        self.smoothed.impulse(&self.point.x, &mut self.impulse);
        self.update_velocity();
        let found = self.scale.residual(self.problem, &self.impulse, &self.velocity, self.model);
        self.story.history.record(self.story.systems, self.limits.seconds(), found);
        let residual = self.limits.measured(found);
        self.best.offer(&self.impulse, residual);
        if let Some(record) = self.story.records.last_mut() {
            record.residual = residual;
        }
        self.story.least_tau = self.story.least_tau.min(real::exp(self.place.log_tau));
        match self.limits.status(self.story.systems, residual) {
            // Impulses that are not finite end a leg, not the solve.
            Some(Status::Stalled) | None => None,
            status => status,
        }
    }

    /// G at a place.
    fn evaluate(&mut self, place: &Place) -> f64 {
        let mut point = std::mem::take(&mut self.point);
        self.smoothed.evaluate(&place.w, real::exp(place.log_tau), &mut point);
        let size = self.smoothed.size_of(&point.defect);
        self.point = point;
        size
    }

    /// Factorises at the place whose [`Point`] was evaluated last. `None` where that fails.
    fn directions(&mut self, place: &Place) -> Option<Directions> {
        let tau = real::exp(place.log_tau);
        let begun = self.limits.seconds();
        let (smoothed, point) = (&self.smoothed, &self.point);
        let factorised = self.jacobian.refresh(|blocks| smoothed.blocks(&place.w, tau, point, blocks));
        self.story.systems += 1;
        let mut record = NewtonRecord {
            iteration: self.story.records.len(),
            precompute_seconds: self.limits.seconds() - begun,
            ..NewtonRecord::default()
        };
        let sign = factorised.unwrap_or(0.0);
        record.figures.insert("log10_tau".to_string(), place.log_tau / std::f64::consts::LN_10);
        record.figures.insert("determinant_sign".to_string(), sign);
        record.figures.insert("folds".to_string(), self.story.folds as f64);
        self.story.records.push(record);
        if sign == 0.0 {
            return None;
        }
        let zeros = vec![0.0; place.w.len()];
        let (mut rate, mut newton, mut tangent) = (zeros.clone(), zeros.clone(), zeros);
        self.smoothed.rate(tau, &self.point, &mut rate);
        let first = self.jacobian.solve(&mut self.smoothed, &self.point.defect, &mut newton);
        let second = self.jacobian.solve(&mut self.smoothed, &rate, &mut tangent);
        if let Some(record) = self.story.records.last_mut() {
            record.linear_residual = first.max(second);
            record.linear_converged = record.linear_residual < 1e-6;
        }
        newton.iter_mut().chain(&mut tangent).for_each(|x| *x = -*x);
        let finite = newton.iter().chain(&tangent).all(|x| x.is_finite());
        finite.then_some(Directions { newton, tangent, sign })
    }

    fn moved(&self, directions: &Directions, length: f64, log_change: f64) -> Place {
        let w = self.place.w.iter().zip(&directions.newton).zip(&directions.tangent);
        Place {
            w: w.map(|((w, newton), tangent)| w + length * (newton + log_change * tangent)).collect(),
            log_tau: self.place.log_tau + log_change,
        }
    }

    /// Newton steps that lower tau as far as they stay near the path: the largest of three reductions after
    /// which G is still small, else a damped step at this tau, else back up.
    fn descend(&mut self) -> Leg {
        let [mut reduction, least_reduction] = REDUCTION;
        let mut hard = 0;
        let (mut least, mut since_better) = (f64::INFINITY, 0);
        let place = self.place.clone();
        let mut size = self.evaluate(&place);
        loop {
            if self.story.systems >= self.last_system {
                return Leg::Stuck;
            }
            if let Some(status) = self.limits.status(self.story.systems, f64::MAX) {
                return Leg::Over(status);
            }
            let place = self.place.clone();
            let tau = real::exp(place.log_tau);
            let Some(directions) = self.directions(&place) else { return Leg::Blocked };
            self.first_sign.get_or_insert(directions.sign);
            if size <= self.walk.near * tau {
                self.anchors.push(place);
                if self.anchors.len() > ANCHORS {
                    self.anchors.remove(0);
                }
            }
            let near = size <= self.walk.near * tau;
            let (next, next_size, factor, length) = self.next(&directions, size, near, reduction);
            if !next_size.is_finite() {
                return Leg::Blocked;
            }
            (self.place, size) = (next, next_size);
            if let Some(status) = self.ended() {
                return Leg::Over(status);
            }
            // Newton's way to the path from afar counts for no failure while its steps are long.
            let eased = factor >= 0.5 || (factor == 0.0 && !near && length > 0.3);
            hard = if eased { 0 } else { hard + 1 };
            if factor == 1.0 {
                reduction = real::powf(reduction, 1.7).max(least_reduction);
            } else if factor != 0.0 || near {
                reduction = real::powf(reduction, 0.6).min(0.9);
            }
            since_better += 1;
            if self.best.residual() < 0.9 * least {
                (least, since_better) = (self.best.residual(), 0);
            }
            let tau = real::exp(self.place.log_tau);
            if hard >= HARD {
                return if tau < LEAST_TAU * self.limits.tolerance() { Leg::Stuck } else { Leg::Blocked };
            }
            if since_better > PATIENCE && tau < LEAST_TAU * self.limits.tolerance() {
                return Leg::Stuck;
            }
        }
    }

    /// The next place: along the path with tau reduced as far as the nearness to it allows, else Newton's
    /// step at this tau, else back up along the path. With it the defect there, the part of the reduction
    /// that was made (-1 for back) and the length of Newton's step.
    fn next(
        &mut self,
        directions: &Directions,
        size: f64,
        near: bool,
        reduction: f64,
    ) -> (Place, f64, f64, f64) {
        let factors: &[f64] = if near { &[1.0, 0.5, 0.25] } else { &[] };
        for factor in factors {
            let next = self.moved(directions, 1.0, factor * real::ln(reduction));
            let next_size = self.evaluate(&next);
            if next_size <= self.walk.near * real::exp(next.log_tau) {
                return (next, next_size, *factor, 1.0);
            }
        }
        let mut length = 1.0;
        while length > 1e-4 {
            let next = self.moved(directions, length, 0.0);
            let next_size = self.evaluate(&next);
            if next_size <= (1.0 - 0.01 * length) * size {
                return (next, next_size, 0.0, length);
            }
            length *= 0.5;
        }
        let next = self.place.along(&directions.tangent, 1.0, std::f64::consts::LN_2);
        let next_size = self.evaluate(&next);
        (next, next_size, -1.0, 0.0)
    }

    /// Newton's method at fixed tau.
    fn correct(&mut self, place: &mut Place) -> bool {
        for _ in 0..CORRECTIONS {
            let tau = real::exp(place.log_tau);
            let size = self.evaluate(place);
            if size <= CENTRED * tau {
                return true;
            }
            let Some(directions) = self.directions(place) else { return false };
            self.place = place.clone();
            let mut length = 1.0;
            loop {
                let next = self.moved(&directions, length, 0.0);
                if self.evaluate(&next) <= (1.0 - 0.1 * length) * size {
                    *place = next;
                    break;
                }
                length *= 0.5;
                if length < 1e-3 {
                    return false;
                }
            }
        }
        false
    }

    /// Pseudo-arclength from the last place near the path.
    fn turn(&mut self) -> Leg {
        let mut found = None;
        while let Some(mut anchor) = self.anchors.pop() {
            if self.correct(&mut anchor) {
                found = Some(anchor);
                break;
            }
            if self.story.systems >= self.last_system {
                break;
            }
        }
        let Some(mut place) = found else { return Leg::Stuck };
        let [mut step, largest_step, least_step] = STEP;
        let mut falling = -1.0;
        let mut free = 0;
        self.evaluate(&place);
        loop {
            if self.story.systems >= self.last_system {
                return Leg::Stuck;
            }
            if let Some(status) = self.limits.status(self.story.systems, f64::MAX) {
                return Leg::Over(status);
            }
            let Some(directions) = self.directions(&place) else { return Leg::Stuck };
            let first_sign = *self.first_sign.get_or_insert(directions.sign);
            let sense = if directions.sign == first_sign { -1.0 } else { 1.0 };
            let metric = self.metric();
            let length = (1.0 + weighted(&metric, &directions.tangent, &directions.tangent)).sqrt();
            let along: Vec<f64> = directions.tangent.iter().map(|t| sense * t / length).collect();
            let log_along = sense / length;
            if falling * log_along < 0.0 {
                self.story.folds += 1;
            }
            falling = log_along;
            let (next, corrections) = loop {
                let mut next = place.along(&along, log_along, step);
                if let Some(corrections) = self.correct_along(&mut next, &metric, &along, log_along) {
                    break (next, corrections);
                }
                step *= 0.5;
                if step < least_step || self.story.systems >= self.last_system {
                    return Leg::Stuck;
                }
            };
            place = next;
            self.place = place.clone();
            if let Some(status) = self.ended() {
                return Leg::Over(status);
            }
            if corrections <= 4 {
                step = (1.6 * step).min(largest_step);
            } else if corrections >= 8 {
                step *= 0.7;
            }
            free = if log_along < -FREE.0 && step >= STEP[0] { free + 1 } else { 0 };
            if free >= FREE.1 {
                return Leg::Free;
            }
        }
    }

    /// Squares of what a contact's part of w is measured in, times the number of unknowns.
    fn metric(&self) -> Vec<f64> {
        let units = &self.smoothed.tau_unit;
        let square: f64 = self.point.x.iter().enumerate().map(|(k, x)| (x / units[k / 3]).powi(2)).sum();
        let size = SPREAD.powi(2) * (square + 1e-30);
        (0..self.point.x.len()).map(|k| 1.0 / (size * units[k / 3].powi(2))).collect()
    }

    /// Newton's method on the path across the direction of the last step. How many factorisations it took.
    fn correct_along(
        &mut self,
        place: &mut Place,
        metric: &[f64],
        along: &[f64],
        log_along: f64,
    ) -> Option<usize> {
        let mut last = f64::INFINITY;
        for correction in 0..CORRECTIONS {
            let size = self.evaluate(place);
            if size <= CENTRED * real::exp(place.log_tau) {
                return Some(correction);
            }
            if size.is_nan() || size > GROWTH * last || self.story.systems >= self.last_system {
                return None;
            }
            last = size;
            let directions = self.directions(place)?;
            let change = -weighted(metric, along, &directions.newton)
                / (weighted(metric, along, &directions.tangent) + log_along);
            let change = change.clamp(-2.0, 2.0);
            self.place = place.clone();
            *place = self.moved(&directions, 1.0, change);
        }
        None
    }
}

/// sum_k m_k a_k b_k.
fn weighted(metric: &[f64], a: &[f64], b: &[f64]) -> f64 {
    metric.iter().zip(a).zip(b).map(|((m, a), b)| m * a * b).sum()
}
