//! Why a solved step is made again: what the contacts of its beginning, each a plane that keeps two points
//! apart, did not foresee of bodies that turn, are deflected or pass each other.
//!
//! | found | then |
//! |---|---|
//! | a contact under way to an impact is closed all the same (`closed`) | it joins the problem |
//! | a deflected body meets another on its way (`on_the_way`), or its core one that it has contacts with (`cores`) | the contact where they meet joins |
//! | bodies overlap at the end that had no contact (`undetected`) | their contacts join |
//! | a contact ends far deeper than foreseen (`departed`) | it is linearised anew where it ends ([`carried_back`]) |
//! | a contact exerts force whose bodies would pass without overlap (`unmet.rs`) | it is tried without |
//! | a contact exerts force, and its bodies keep clear of each other all the same (`apart.rs`) | its plane is moved out of their way |

use super::apart::closing;
use super::attempt::Attempt;
use super::bend::bends;
use super::covered::leave_covered_out;
use super::finish::after;
use super::mobility;
use super::placement::{Placement, Seen};
use super::{Made, StepError, StepSettings, Stepper};
use crate::assemble::{contact_rows, relative_velocities};
use crate::clock::{Clock, Laps};
use crate::contact::Contact;
use crate::math::{Vec3, mix};
use crate::world::World;
use hashbrown::{HashMap, HashSet};
use rayon::prelude::*;

/// What makes a step be made again, and how often. Values: docs/mechanics.md, "The step"; held by
/// `tests/physics/repetition.rs`.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Bodies that end inside each other without having been in contact make a new round; they have been in
    /// contact there if one of theirs lay within this fraction of the smaller one's size:
    /// of corners and edges that lie over one another, rounding makes now one contact, now another.
    pub same_place: f64,
    /// A contact that ends in overlap by more than this fraction of the smaller body's size, and by so much
    /// more than foreseen, makes a new round too.
    pub departure: f64,
    /// A contact is spurious if the bodies, without it, overlap on their way by no more than this fraction
    /// of what it foresees.
    pub spurious: f64,
    /// Where bodies fall by more than this fraction of the smaller one's size in a step, what they do without
    /// each other says nothing of their contacts.
    pub fallen: f64,
    /// Rounds of solving a step again with contacts that had not been detected; what still overlaps then is
    /// reported. Two or three do, but where bodies cross the scene in a step each round may send them on to
    /// others.
    pub rounds: usize,
    /// Solves of the contacts for joints whose motors, stops or paths turned out otherwise than foreseen;
    /// what is left then is reported.
    pub joint_rounds: usize,
}

impl Default for Parameters {
    fn default() -> Self {
        Self { same_place: 1e-2, departure: 5e-3, spurious: 0.2, fallen: 0.1, rounds: 30, joint_rounds: 12 }
    }
}

/// What single bodies of a scene are left with by a solve whose root mean square is the tolerance, over that.
const NOISE: f64 = 10.0;

/// Normals of one contact at the beginning and the end of a step: within 18 degrees.
const ALIKE: f64 = 0.95;

fn identities(contacts: &[Contact]) -> HashSet<u64> {
    contacts.iter().map(|c| c.identity).collect()
}

/// Contacts that were linearised anew in a step. The first time the new plane takes the place of the old one;
/// where a turning body bends away from that, too, planes gather, or two of them would take turns for ever.
#[derive(Default)]
pub(super) struct Planes {
    /// How often a contact was linearised anew, by identity.
    count: HashMap<u64, u64>,
    /// Identities of further planes, and the contact that they belong to.
    further: HashMap<u64, u64>,
    /// Gaps that they had at the start of the step, by identity, m.
    gap: HashMap<u64, f64>,
}

impl Planes {
    fn of(&self, contact: &Contact) -> u64 {
        self.further.get(&contact.identity).copied().unwrap_or(contact.identity)
    }

    /// The gap that a contact linearised anew is to have at the end, m: no overlap beyond that of the start.
    pub(super) fn allowed(&self, identity: u64) -> Option<f64> {
        self.gap.get(&identity).map(|gap| gap.min(0.0))
    }

    /// Whether a contact was linearised anew.
    pub(super) fn has(&self, identity: u64) -> bool {
        self.count.contains_key(&identity)
    }

    /// Puts `anew`, as [`Stepper::departed`] found them, among the contacts. Returned are the identities that
    /// they have there.
    fn put(&mut self, anew: Vec<Contact>, contacts: &mut Vec<Contact>) -> Vec<u64> {
        let mut identities = Vec::with_capacity(anew.len());
        for mut contact in anew {
            let count = self.count.entry(contact.identity).or_default();
            *count += 1;
            if *count == 1
                && let Some(old) = contacts.iter_mut().find(|c| c.identity == contact.identity)
            {
                self.gap.entry(contact.identity).or_insert(old.gap);
                *old = contact;
                identities.push(contact.identity);
                continue;
            }
            let own = mix(contact.identity.wrapping_add(*count));
            self.further.insert(own, contact.identity);
            contact.identity = own;
            identities.push(own);
            contacts.push(contact);
        }
        identities
    }
}

/// The contacts of a step through its rounds.
#[derive(Default)]
pub(super) struct Rounds {
    pub(super) contacts: Vec<Contact>,
    /// By how much pairs overlapped at the start, m.
    pub(super) overlaps: Vec<([u32; 2], f64)>,
    /// Those that were linearised anew.
    pub(super) planes: Planes,
    /// Contacts under way that bodies are driven into all the same, by identity.
    pub(super) driven: HashSet<u64>,
    /// Contacts whose planes were moved out of the way of their bodies, by identity.
    pub(super) passed: HashMap<u64, Passed>,
    /// How often bodies were seen to meet at a contact, by identity; one where they were is not spurious.
    pub(super) met: HashMap<u64, usize>,
    /// Rounds made so far.
    pub(super) round: usize,
    /// How bodies went, and where they ended, when they were last looked at.
    pub(super) seen: [Seen; 2],
    /// Contacts that bodies meet on their way, which join once it was seen where the step leaves them.
    pub(super) joining: Vec<Contact>,
    /// Contacts without which the step is tried, and the identities of all that were in one of its rounds.
    pub(super) let_go: Vec<Contact>,
    pub(super) tried: HashSet<u64>,
    /// Attempts so far that did not converge.
    pub(super) unsolved: usize,
    /// Contacts that joined after a solve.
    pub(super) added: usize,
    /// Pairs that met all the same when there were no rounds left, or overlap at the end without a contact.
    pub(super) undetected: usize,
    /// Iterations of all rounds.
    pub(super) iterations: usize,
    pub(super) laps: Laps,
}

/// A contact whose plane was moved.
pub(super) struct Passed {
    /// Its gap before, m.
    pub(super) gap: f64,
    pub(super) times: usize,
}

impl Rounds {
    pub(super) fn of(contacts: Vec<Contact>) -> Self {
        let overlapping = contacts.iter().filter(|c| c.gap < 0.0);
        let overlaps = overlapping.map(|c| (c.unordered(), -c.gap)).collect();
        Self { contacts, overlaps, ..Self::default() }
    }

    /// Notes that bodies meet at these contacts, found in one round.
    fn meet(&mut self, identities: impl IntoIterator<Item = u64>) {
        let mut all: HashSet<u64> = identities.into_iter().collect();
        let bases: Vec<u64> = all.iter().filter_map(|k| self.planes.further.get(k).copied()).collect();
        all.extend(bases);
        all.into_iter().for_each(|k| *self.met.entry(k).or_default() += 1);
    }

    /// Puts what bodies meet on their way among the contacts.
    fn join(&mut self) {
        let joining = std::mem::take(&mut self.joining);
        let before = self.contacts.len();
        self.take(joining);
        self.added += self.contacts.len() - before;
    }

    /// Moves planes out of the way of their bodies (places and new gaps), and others back where they were,
    /// for good.
    fn move_planes(&mut self, passing: &[(usize, f64)], meeting: &[usize]) {
        for &(i, gap) in passing {
            let Contact { identity, gap: own, .. } = &mut self.contacts[i];
            let passed = self.passed.entry(*identity).or_insert(Passed { gap: *own, times: 0 });
            passed.times += 1;
            *own = gap;
        }
        for &i in meeting {
            let Contact { identity, gap, .. } = &mut self.contacts[i];
            if let Some(passed) = self.passed.get_mut(identity) {
                (*gap, passed.times) = (passed.gap, usize::MAX);
            }
        }
    }

    /// Takes what was let go out, without what is among the contacts again, or joins them.
    pub(super) fn take_let_go(&mut self) -> Vec<Contact> {
        let mut let_go = std::mem::take(&mut self.let_go);
        let own = identities(&let_go);
        let all = self.contacts.iter().chain(&self.joining).filter(|_| !own.is_empty());
        let back: HashSet<u64> = all.map(|c| c.identity).filter(|k| own.contains(k)).collect();
        let_go.retain(|c| !back.contains(&c.identity));
        let_go
    }

    /// Puts contacts at which bodies meet among those of the step, where they are not yet.
    pub(super) fn take(&mut self, mut met: Vec<Contact>) {
        self.meet(met.iter().map(|c| c.identity));
        if !met.is_empty() {
            let known = identities(&self.contacts);
            met.retain(|c| !known.contains(&c.identity));
        }
        self.contacts.extend(met);
    }

    /// How often bodies were seen to meet at a contact, or at another of its planes.
    pub(super) fn times_met(&self, contact: &Contact) -> usize {
        self.met.get(&self.planes.of(contact)).copied().unwrap_or(0)
    }
}

impl Stepper {
    /// What the velocities found show before anything is moved; whether there are other contacts now, with
    /// which the step is solved again.
    ///
    /// # Errors
    /// [`StepError::Stopped`].
    pub(super) fn check_velocities(
        &mut self,
        world: &mut World,
        rounds: &mut Rounds,
        attempt: &Attempt,
    ) -> Result<bool, StepError> {
        let begin = Clock::now();
        let is_last = rounds.round >= self.parameters.repetition.rounds;
        let closed = self.closed(world, &rounds.contacts, attempt);
        if closed.is_empty() && !is_last {
            rounds.joining = self.on_the_way(world, rounds, attempt);
        }
        self.go_on()?;
        rounds.undetected =
            if is_last { closed.len() + self.not_returned(world, rounds, attempt) } else { 0 };
        let again = !is_last && (!closed.is_empty() || self.try_without(world, rounds, attempt));
        rounds.laps.add(|phases| &mut phases.collide, begin.lap());
        if !is_last {
            rounds.added += closed.len();
            rounds.driven.extend(closed);
        }
        if again {
            rounds.join();
        }
        rounds.round += usize::from(again);
        Ok(again)
    }

    /// What the bodies show where the step leaves them; whether there are other contacts now, with which it
    /// is solved again from `start`: there the bodies are then put back. In rounds after the first what ends
    /// otherwise than before is looked at first: only what shows nothing more is searched through for all
    /// contacts of the end.
    pub(super) fn check_end(
        &mut self,
        world: &mut World,
        rounds: &mut Rounds,
        start: &Placement,
        made: &mut Made,
    ) -> bool {
        let begin = Clock::now();
        let mut again = false;
        if rounds.seen[1].is_some() || !rounds.joining.is_empty() {
            let stirred = self.stirred(world, &mut rounds.seen[1]);
            let overlaps = self.collider.overlaps_of(world, &stirred, self.settings.step);
            again = self.look_again(world, rounds, start, &made.attempt, (&overlaps, false)).is_none();
        }
        if !again {
            let StepSettings { envelope, step, .. } = self.settings;
            made.ahead = self.as_driven(world, after(world.time, step), |stepper, world| {
                stepper.collider.contacts(world, envelope, step)
            });
            let left = self.look_again(world, rounds, start, &made.attempt, (&made.ahead, true));
            again = left.is_none();
            let known: HashSet<[u32; 2]> = match &left {
                Some(left) if !left.is_empty() => rounds.contacts.iter().map(Contact::unordered).collect(),
                _ => HashSet::new(),
            };
            let left = left.into_iter().flatten().map(|contact| contact.unordered());
            rounds.undetected += left.filter(|pair| !known.contains(pair)).collect::<HashSet<_>>().len();
        }
        rounds.laps.add(|phases| &mut phases.collide, begin.lap());
        again
    }

    /// What bodies may overlap by unseen, as a fraction of the smaller one's size: no more than what is left
    /// of overlap that was seen.
    pub(super) fn unseen(&self) -> f64 {
        self.parameters.overlap.trigger(self.settings.solver.tolerance)
    }

    /// Which bodies are to be looked at again: what goes another way by less than what may overlap unseen, or
    /// than a solve to the tolerance leaves open, meets nothing else.
    fn stirred(&self, world: &World, seen: &mut Seen) -> Vec<bool> {
        let (step, collider) = (self.settings.step, &self.collider);
        let least = (0..world.bodies.len()).map(|body| collider.sizes(world, body)[0]);
        let least = Some(least.fold(f64::INFINITY, f64::min)).filter(|least| least.is_finite());
        let left = NOISE * self.settings.solver.tolerance * world.gravity.length() * step * step;
        let far = left.max(self.unseen() * least.unwrap_or(0.0));
        seen.stirred(world, step, far, |body| collider.sizes(world, body)[1])
    }

    /// What these contacts of the end (whether they are all) show: `None` where the step is solved again from
    /// `start`, else those that overlap without having been a contact of the step.
    fn look_again(
        &mut self,
        world: &mut World,
        rounds: &mut Rounds,
        start: &Placement,
        attempt: &Attempt,
        (ahead, are_all): (&[Contact], bool),
    ) -> Option<Vec<Contact>> {
        let is_last = rounds.round >= self.parameters.repetition.rounds;
        let [deep, mut undetected] = self.deep(world, start, &rounds.contacts, ahead);
        let is_joined = !rounds.joining.is_empty();
        if is_joined {
            // What bodies meet at the end they may not once they meet those.
            undetected.clear();
        }
        let (mut departed, mut meeting, mut passing) = (Vec::new(), Vec::new(), Vec::new());
        if !is_last {
            meeting = self.meeting(world, start, rounds, attempt);
            departed = self.departed(world, start, rounds, attempt, &deep);
            departed.retain(|c| meeting.iter().all(|&i| rounds.contacts[i].identity != c.identity));
        }
        if are_all && !is_joined {
            passing = self.passing(world, start, rounds, attempt, ahead);
        }
        let is_known_again = is_joined || !departed.is_empty() || !meeting.is_empty() || !passing.is_empty();
        let (mut new, mut ends) = (Vec::new(), Vec::new());
        if !(undetected.is_empty() || is_last) || is_known_again {
            ends.extend(undetected.iter().map(|c| self.begun_apart(world, start, attempt, c)));
            let end = start.exchange(world);
            new = self.new_contacts(world, &rounds.contacts, &ends, &attempt.velocity);
            if new.is_empty() && !is_known_again {
                end.exchange(world);
            } else {
                rounds.seen[1] = Seen::of(end);
            }
        }
        if new.is_empty() && !is_known_again {
            return Some(undetected);
        }
        rounds.move_planes(&passing, &meeting);
        rounds.added += new.len() + departed.len();
        let departed = rounds.planes.put(departed, &mut rounds.contacts);
        rounds.meet(departed);
        // What is linearised at the end alone did not overlap at the start.
        let at_end = new.iter().filter(|c| ends.contains(c)).map(|c| (c.identity, 0.0));
        rounds.planes.gap.extend(at_end);
        rounds.meet(new.iter().map(|c| c.identity));
        rounds.contacts.extend(new);
        rounds.join();
        rounds.round += 1;
        None
    }

    /// Contacts that were left out of the problem and close with the velocities found, by identity.
    fn closed(&self, world: &World, contacts: &[Contact], attempt: &Attempt) -> Vec<u64> {
        if attempt.active.len() == contacts.len() {
            return Vec::new();
        }
        let rows = contact_rows(world, contacts);
        let u = relative_velocities(attempt.cell.as_ref(), contacts, &rows, &attempt.velocity);
        let closes = |i: &u32| {
            let contact = &contacts[*i as usize];
            let step = self.settings.step;
            let [n, t1, t2] = [0, 1, 2].map(|k| u[3 * *i as usize + k]);
            let end = contact.gap.max(0.0) + step * n;
            if attempt.immobile.binary_search(i).is_ok() {
                return mobility::approaches(&rows[*i as usize], &[end / step, t1, t2], step);
            }
            end < -self.unseen() * self.collider.contact_size(world, contact)
        };
        (0..contacts.len() as u32)
            .filter(|i| attempt.active.binary_search(i).is_err())
            .filter(closes)
            .map(|i| contacts[i as usize].identity)
            .collect()
    }

    /// Contacts that bodies would meet on their way with the velocities found, where those make a body faster
    /// than the collision phase knew: at the end of the step it may have passed another one. In rounds after
    /// the first those that go another way than when they were looked at.
    fn on_the_way(&mut self, world: &mut World, rounds: &mut Rounds, attempt: &Attempt) -> Vec<Contact> {
        let step = self.settings.step;
        let is_deflected = |body: usize| {
            let v = &attempt.velocity[6 * body..6 * body + 6];
            let (u, w) = (Vec3::from_slice(&v[..3]), Vec3::from_slice(&v[3..]));
            let way = 0.5 * self.collider.body_size(world, body);
            let spin = |w: Vec3| self.collider.spin_travel(world, body, w.length(), step);
            let change = step * (u - world.bodies.velocity[body]).length()
                + spin(w - world.bodies.angular_velocity[body]);
            !world.is_prescribed(body) && step * u.length() + spin(w) > way && change > way
        };
        if !(0..world.bodies.len()).any(is_deflected) {
            return Vec::new();
        }
        let bends = bends(world, &attempt.free);
        let before = Placement::of(world);
        for (body, v) in attempt.velocity.chunks_exact(6).enumerate() {
            world.bodies.velocity[body] = Vec3::from_slice(&v[..3]);
            world.bodies.angular_velocity[body] = Vec3::from_slice(&v[3..]);
        }
        attempt.impacts.put_on(world, &self.collider);
        let stirred = self.stirred(world, &mut rounds.seen[0]);
        let contacts = &rounds.contacts;
        let unseen = self.unseen();
        let mut ahead = self.collider.meetings_of(world, &stirred, step);
        for contact in &mut ahead {
            *contact = self.collider.arrival_of_balls(world, contact, step).unwrap_or(*contact);
        }
        let rows = contact_rows(world, &ahead);
        let u = relative_velocities(attempt.cell.as_ref(), &ahead, &rows, &attempt.velocity);
        let past = self.flown_past(world, &ahead, (&attempt.velocity, &u), &bends);
        let mut known = identities(contacts);
        // Planes that were moved out of the way of bodies that went another way then.
        for (posed, own) in attempt.posed_with(contacts).iter().zip(contacts) {
            if posed.gap > own.gap {
                known.remove(&own.identity);
            }
        }
        // What keeps the time of its touch parts then, however it lies where it would have begun the step.
        let touched = contacts.iter().zip(&attempt.impacts.impulse).filter(|(contact, impulse)| {
            **impulse != Vec3::ZERO && attempt.impacts.last_touch(contact) > 0.0
        });
        let touched: HashSet<[u32; 2]> = touched.map(|(contact, _)| contact.unordered()).collect();
        let mut cores = self.cores(world, contacts, &known);
        cores.retain(|core| !touched.contains(&core.unordered()));
        before.exchange(world);
        let meets = |((c, u), past): ((Contact, &[f64]), Contact)| {
            // A ball is on its way with its velocity of now since its touch only.
            let touch = attempt.impacts.last_touch(&c);
            if touch > 0.0 && (c.gap + touch * u[0] < 0.0 || touched.contains(&c.unordered())) {
                return None;
            }
            let size = self.collider.contact_size(world, &c);
            let is_new = past.gap == c.gap && !known.contains(&c.identity);
            (is_new && c.gap.max(0.0) + step * u[0] < -unseen * size).then_some(c)
        };
        let found = ahead.into_iter().zip(u.chunks_exact(3)).zip(past);
        let mut closed: Vec<Contact> = found.filter_map(meets).collect();
        closed.iter_mut().for_each(|contact| attempt.impacts.carry_back(contact));
        if !closed.is_empty() {
            let mut all = [&contacts[..], &closed].concat();
            leave_covered_out(world, &self.collider, step, &mut all);
            closed.retain(|c| all.contains(c));
        }
        closed.extend(cores);
        closed
    }

    /// Contacts of the cores of bodies that move by more than their size and pass what they have contacts
    /// with all the same: those hold two points apart, about which a body may turn.
    fn cores(&self, world: &World, contacts: &[Contact], known: &HashSet<u64>) -> Vec<Contact> {
        let step = self.settings.step;
        let is_fast = |pair: &[u32; 2]| {
            let [a, b] = world.pair_velocities(*pair);
            let size = pair.iter().map(|&body| self.collider.body_size(world, body as usize));
            step * (a[0] - b[0]).length() > size.fold(f64::INFINITY, f64::min)
        };
        let mut pairs: Vec<[u32; 2]> = contacts.iter().map(Contact::unordered).filter(is_fast).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let found = pairs.into_iter().flat_map(|pair| self.collider.arrivals_of_cores(world, pair, step));
        found.filter(|core| !known.contains(&core.identity)).collect()
    }

    /// Contacts that overlap at the end of the step by more than is let pass: those that it had, and those
    /// that it had not. One that lies where the pair had another is that one, and has its identity.
    fn deep(
        &self,
        world: &World,
        start: &Placement,
        contacts: &[Contact],
        ahead: &[Contact],
    ) -> [Vec<Contact>; 2] {
        let collider = &self.collider;
        let unseen = self.unseen();
        let is_deep = |c: &&Contact| -c.gap > unseen * collider.contact_size(world, c);
        let deep: Vec<Contact> = ahead.par_iter().filter(is_deep).copied().collect();
        if deep.is_empty() {
            return [deep, Vec::new()];
        }
        let identities = identities(contacts);
        let (mut known, unknown): (Vec<_>, Vec<_>) =
            deep.into_iter().partition(|c| identities.contains(&c.identity));
        let mut of_pair: HashMap<[u32; 2], Vec<&Contact>> =
            unknown.iter().map(|c| (c.unordered(), Vec::new())).collect();
        for contact in contacts.iter().filter(|_| !unknown.is_empty()) {
            if let Some(own) = of_pair.get_mut(&contact.unordered()) {
                own.push(contact);
            }
        }
        let mut new = Vec::new();
        for contact in unknown {
            let own = &of_pair[&contact.unordered()];
            match own.iter().find(|begin| self.is_same_place(world, start, &contact, begin)) {
                Some(there) => known.push(Contact { identity: there.identity, ..contact }),
                None => new.push(contact),
            }
        }
        [known, new]
    }

    /// Whether a contact of the end of the step lies on one of both bodies where a contact of its beginning
    /// did, with about its normal.
    fn is_same_place(&self, world: &World, start: &Placement, end: &Contact, begin: &Contact) -> bool {
        let near = self.parameters.repetition.same_place * self.collider.contact_size(world, end);
        let normal = if end.body_a == begin.body_a { begin.normal } else { -begin.normal };
        let moved = |body: u32| {
            let (body, bodies) = (body as usize, &world.bodies);
            let now = bodies.orientation[body].conjugate() * (end.point - bodies.position[body]);
            let before = start.orientation[body].conjugate() * (begin.point - start.position[body]);
            (now - before).length()
        };
        end.normal.dot(normal) >= ALIKE && moved(end.body_a).min(moved(end.body_b)) <= near
    }

    /// The nearest that any of the planes of a contact lets the bodies of these contacts (`ends`) come, Phi +
    /// dt u_n, and which, by identity.
    pub(super) fn foreseen(
        &self,
        start: &Placement,
        rounds: &Rounds,
        attempt: &Attempt,
        ends: &[&Contact],
    ) -> HashMap<u64, (f64, Contact)> {
        let (step, planes) = (self.settings.step, &rounds.planes);
        let wanted: HashSet<u64> = ends.iter().map(|c| c.identity).collect();
        let mut foreseen: HashMap<u64, (f64, Contact)> = HashMap::new();
        let posed = attempt.posed_with(&rounds.contacts);
        for contact in posed.iter().filter(|c| wanted.contains(&planes.of(c))) {
            let end = contact.gap + step * closing(start, attempt, contact);
            let known = foreseen.entry(planes.of(contact)).or_insert((end, *contact));
            if end < known.0 {
                *known = (end, *contact);
            }
        }
        foreseen
    }

    /// Contacts that end deep in overlap where Phi + dt u_n foresaw less, as they are to be instead: a
    /// turning face, or an edge that a fast body meets elsewhere than it was to, is not where the tangent
    /// plane at the contact says. What takes their place is the contact of the end, carried back; where that
    /// points the other way, since a thin body is passed by more than half, the one of its near side. `world`
    /// as the step leaves it, `deep` its contacts that overlap.
    fn departed(
        &self,
        world: &World,
        start: &Placement,
        rounds: &Rounds,
        attempt: &Attempt,
        deep: &[Contact],
    ) -> Vec<Contact> {
        let (step, collider) = (self.settings.step, &self.collider);
        let size = |c: &Contact| collider.contact_size(world, c);
        let departed = self.parameters.repetition.departure;
        let deep: Vec<&Contact> = deep.iter().filter(|c| -c.gap > departed * size(c)).collect();
        if deep.is_empty() {
            return Vec::new();
        }
        let foreseen = self.foreseen(start, rounds, attempt, &deep);
        let mended = |end: &Contact| {
            let (gap, contact) = foreseen.get(&end.identity)?;
            let error = gap - end.gap;
            (error > departed * size(end)).then(|| {
                let normal = if end.body_a == contact.body_a { contact.normal } else { -contact.normal };
                if end.normal.dot(normal) > 0.0 {
                    return carried_back(end, world, start, attempt, step);
                }
                let near_side =
                    self.near_side(world, end).map(|c| carried_back(&c, world, start, attempt, step));
                near_side.unwrap_or(Contact { gap: contact.gap - error, identity: end.identity, ..*contact })
            })
        };
        deep.into_iter().filter_map(mended).collect()
    }

    /// A contact of the end of two bodies that have passed each other by more than half, as that of the sides
    /// that met: the way back is the rest of both. `None` of what has no thickness.
    fn near_side(&self, world: &World, end: &Contact) -> Option<Contact> {
        let thickness = self.thickness(world, end);
        let normal = -end.normal;
        thickness.is_finite().then(|| Contact { normal, gap: -thickness - end.gap, ..*end })
    }

    /// What the two bodies of a contact measure through together, m.
    fn thickness(&self, world: &World, contact: &Contact) -> f64 {
        let size = |body: u32| 2.0 * self.collider.body_size(world, body as usize);
        size(contact.body_a) + size(contact.body_b)
    }

    /// A contact of the end that the step had not, carried back. Had its bodies overlapped at the start by
    /// more than they are thick, they have passed each other since: then it is that of their near sides.
    fn begun_apart(&self, world: &World, start: &Placement, attempt: &Attempt, end: &Contact) -> Contact {
        let carry = |c: &Contact| carried_back(c, world, start, attempt, self.settings.step);
        let begin = carry(end);
        let has_passed = begin.gap < -self.thickness(world, end);
        let near_side = has_passed.then(|| self.near_side(world, end)).flatten();
        near_side.map_or(begin, |near_side| carry(&near_side))
    }

    /// Contacts at the start of the step of pairs that would overlap at its end (`undetected`, with `ends`
    /// the same contacts carried back), where nothing covers them; `world` as it was before the step.
    fn new_contacts(
        &self,
        world: &World,
        contacts: &[Contact],
        ends: &[Contact],
        velocity: &[f64],
    ) -> Vec<Contact> {
        let known = identities(contacts);
        let mut pairs: Vec<[u32; 2]> = ends.iter().map(|c| [c.body_a, c.body_b]).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let mut found = Vec::new();
        for pair in pairs {
            let first = found.len();
            let of_pair = self.collider.contacts_of_pair(world, pair, velocity, self.settings.step);
            let new = of_pair.into_iter().filter(|c| !known.contains(&c.identity));
            let held = pair.into_iter().filter(|&body| !world.is_prescribed(body as usize));
            let held: Vec<u32> = held.collect();
            let beside = |c: &&Contact| held.contains(&c.body_a) || held.contains(&c.body_b);
            let mut all: Vec<Contact> = contacts.iter().filter(beside).copied().chain(new).collect();
            leave_covered_out(world, &self.collider, self.settings.step, &mut all);
            found.extend(all.into_iter().filter(|c| !known.contains(&c.identity)));
            if found.len() == first {
                // At the start these features do not look at each other.
                found.extend(ends.iter().filter(|c| [c.body_a, c.body_b] == pair));
            }
        }
        found
    }
}

/// The contact found at the end of a step, linearised there, for the problem of its beginning: normal n and
/// arms are those of the end, and with the velocities (u, w) of the attempt
///
/// ```text
/// Phi' = Phi_end - dt n . (u_A + w_A x r_A - u_B - w_B x r_B)      (B: the image that touches, in a periodic cell)
/// ```
///
/// so that Phi' + dt u_n+ is the gap at the end to first order in the change of velocity: Newton's method on
/// the gap of the end. What a ball ends further by because it touched late in the step (`Impacts::shift_of`)
/// is taken from `Phi_end`: with another contact it has no touch of its own.
fn carried_back(end: &Contact, world: &World, start: &Placement, attempt: &Attempt, step: f64) -> Contact {
    let half = 0.5 * end.gap * end.normal;
    let side = |body: u32, at_end: Vec3| {
        let body = body as usize;
        let geometry = &world.geometries[world.bodies.geometry[body].index()];
        let arm = geometry.arm_before(start.orientation[body], world.way_to(body, at_end), end.normal);
        let v = &attempt.velocity[6 * body..6 * body + 6];
        (start.position[body] + arm, Vec3::from_slice(&v[..3]) + Vec3::from_slice(&v[3..]).cross(arm))
    };
    let (on_a, speed_a) = side(end.body_a, end.point + half);
    let (mut on_b, mut speed_b) = side(end.body_b, end.point - half);
    let mut image = [0; 3];
    if let Some(cell) = &attempt.cell {
        // At the start, since when bodies may have left the cell on one side and come in on the other.
        image = cell.nearest(on_a - on_b).0;
        on_b += cell.shift(image);
        speed_b += cell.image_velocity(image);
    }
    let shift = attempt.impacts.shift_of(end.body_a) - attempt.impacts.shift_of(end.body_b);
    let gap = end.gap - step * end.normal.dot(speed_a - speed_b) - end.normal.dot(shift);
    Contact { point: 0.5 * (on_a + on_b), lead: 0.5 * (on_a - on_b), gap, image, ..*end }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact(identity: u64) -> Contact {
        let [point, normal, lead] = [Vec3::ZERO, Vec3::Z, Vec3::ZERO];
        Contact { body_a: 0, body_b: 1, identity, point, normal, gap: 0.1, lead, image: [0; 3] }
    }

    #[test]
    fn what_was_let_go_comes_back_once() {
        let mut rounds = Rounds::of([1, 2].map(contact).to_vec());
        rounds.joining = vec![contact(3)];
        rounds.let_go = [2, 3, 4].map(contact).to_vec();
        assert_eq!(rounds.take_let_go(), [contact(4)]);
        assert!(rounds.let_go.is_empty());
    }

    #[test]
    fn a_moved_plane_goes_back_to_where_it_first_was() {
        let mut rounds = Rounds::of([1, 2].map(contact).to_vec());
        rounds.move_planes(&[(1, 0.2)], &[]);
        rounds.move_planes(&[(1, 0.3)], &[]);
        let gaps = |rounds: &Rounds| [rounds.contacts[0].gap, rounds.contacts[1].gap];
        assert_eq!((gaps(&rounds), rounds.passed[&2].times), ([0.1, 0.3], 2));
        rounds.move_planes(&[], &[1]);
        assert_eq!((gaps(&rounds), rounds.passed[&2].times), ([0.1, 0.1], usize::MAX));
    }
}
