//! When in a step two balls touch that meet nothing else, or what does not turn touches what is driven: they
//! go on as they were until then, and as the impact leaves them from then on.
//!
//! An impulse that acts at the time t instead of at the start leaves bodies where they would be if they had
//! begun the step elsewhere, with the velocities v' after it:
//!
//! ```text
//! x + t u + (dt - t) u' = x + dt u' + t (u - u'),        turns: t (w - w')
//! ```
//!
//! which holds under gravity, too, with the velocities at the touch in the law of impact. Normal and arms of
//! balls at the touch are known ([`lead_to_surfaces`](super::lead_to_surfaces)). Other bodies have those of
//! the start, with which two of them would not keep their angular momentum, and walls would catch what
//! tumbles: of them an impulse acts at the start, but where one that does not turn meets what is driven. Such
//! a one may touch at several points, and with others in the rest of the step: these have the gaps of where
//! it would have begun the step as it goes on.

use super::{Impacts, Motion, Rows};
use crate::assemble::{contact_rows, relative_velocities};
use crate::cell::Cell;
use crate::collide::Collider;
use crate::contact::Contact;
use crate::elasticity;
use crate::integrate::{driven_velocity, velocities, with_driven};
use crate::load;
use crate::math::Vec3;
use crate::parts::Part;
use crate::rotation::{Rotor, is_isotropic, turned};
use crate::world::World;
use graintrain_ccp::RigidContact;
use hashbrown::HashMap;
use std::borrow::Cow;

/// What presses bodies together by less than this fraction of the velocity of their touch by the end of the
/// step is nothing: forces over masses are accelerations but for rounding.
const UNPRESSED: f64 = 1e-6;

/// Where a body ends the step elsewhere than with the velocities after its impacts all the way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shift {
    pub body: u32,
    /// When it touches, s after the start.
    time: f64,
    /// m
    way: Vec3,
    turn: Vec3,
}

impl Shift {
    /// That of a body which touches at this time (s), with the velocities `after`, six numbers per body.
    pub(super) fn of(world: &World, after: &[f64], (body, time): (u32, f64)) -> Self {
        let (k, bodies) = (body as usize, &world.bodies);
        let lost =
            |before: Vec3, part: usize| time * (before - Vec3::from_slice(&after[6 * k + part..][..3]));
        Self { body, time, way: lost(bodies.velocity[k], 0), turn: lost(bodies.angular_velocity[k], 3) }
    }
}

impl Impacts {
    fn shift(&self, body: u32) -> Option<&Shift> {
        self.shift.binary_search_by_key(&body, |shift| shift.body).ok().map(|k| &self.shift[k])
    }

    /// The way by which a body ends the step elsewhere, m.
    pub(crate) fn shift_of(&self, body: u32) -> Vec3 {
        self.shift(body).map_or(Vec3::ZERO, |shift| shift.way)
    }

    /// When the bodies of a contact have their velocities after the impacts, s after the start.
    pub(crate) fn last_touch(&self, contact: &Contact) -> f64 {
        let times =
            [contact.body_a, contact.body_b].map(|body| self.shift(body).map_or(0.0, |shift| shift.time));
        times[0].max(times[1])
    }

    /// Puts bodies where they end the step when they began as the world has them. Of a ball whose mass is not
    /// evenly spread the turn is left out: turned, it would have another energy. What is no ball did not turn
    /// before the touch, so that it turns by as much less.
    pub(crate) fn put_on(&self, world: &mut World, collider: &Collider) {
        for shift in &self.shift {
            let body = shift.body as usize;
            world.bodies.position[body] += shift.way;
            if is_isotropic(world.bodies.inertia[body]) {
                world.bodies.orientation[body] = turned(world.bodies.orientation[body], shift.turn);
            } else if !collider.is_ball(world, body) {
                let spin = world.bodies.angular_velocity[body];
                let back = Rotor::of(world, body).coast(spin, -shift.time);
                (world.bodies.orientation[body], world.bodies.angular_velocity[body]) =
                    (back.orientation, back.spin);
            }
        }
    }

    /// The contacts with the gaps that they have where bodies begin the step as they go on.
    pub(crate) fn gone_on<'a>(&self, contacts: &'a [Contact]) -> Cow<'a, [Contact]> {
        if self.gap_change.is_empty() {
            return contacts.into();
        }
        let gone_on = |(contact, change): (&Contact, &f64)| Contact { gap: contact.gap + change, ..*contact };
        contacts.iter().zip(&self.gap_change).map(gone_on).collect::<Vec<_>>().into()
    }

    /// Puts the points of contacts where they were when their bodies began the step as they go on.
    pub(crate) fn carry(&self, contacts: &mut [Contact]) {
        if self.shift.is_empty() {
            return;
        }
        for contact in contacts {
            let [a, b] = [contact.body_a, contact.body_b].map(|body| self.shift_of(body));
            contact.point += 0.5 * (a + b);
            contact.lead += 0.5 * (a - b);
        }
    }

    /// Makes a contact of bodies that were [put on](Self::put_on) that of where they are, along the same
    /// normal.
    pub(crate) fn carry_back(&self, contact: &mut Contact) {
        let [a, b] = [contact.body_a, contact.body_b].map(|body| self.shift_of(body));
        contact.point -= 0.5 * (a + b);
        contact.lead -= 0.5 * (a - b);
        contact.gap -= contact.normal.dot(a - b);
    }
}

impl Motion {
    /// When contact i touches, where that is known.
    pub(super) fn touch_of(
        &self,
        world: &World,
        of: Rows<'_>,
        i: usize,
        restitution: f64,
        step: f64,
    ) -> Option<Touch> {
        let contact = Contact { gap: self.gap[i], ..of.contacts[i] };
        Touch::of(world, (&contact, &of.rows[i]), (&self.now[3 * i..3 * i + 3], restitution), step)
    }

    /// When the contacts of a part touch together, and their velocities then, where its time is kept.
    pub(super) fn touch(
        &self,
        world: &World,
        of: Rows<'_>,
        part: &Part,
        restitution: &[f64],
        step: f64,
    ) -> Option<(f64, Vec<f64>)> {
        if !part.contacts.iter().all(|&i| self.is_timed(i as usize)) {
            return None;
        }
        let touch = |&i: &u32| self.touch_of(world, of, i as usize, restitution[i as usize], step);
        let time = part.contacts.iter().filter_map(touch).map(|touch| touch.time).reduce(f64::min)?;
        let velocity = |&i: &u32| {
            let i = i as usize;
            let a = acceleration(world, &of.contacts[i], &of.rows[i]);
            [0, 1, 2].map(|k| self.now[3 * i + k] + time * a[k])
        };
        Some((time, part.contacts.iter().flat_map(velocity).collect()))
    }

    /// After these bodies touched at these times (s), with the velocities of contacts `before`: they go on
    /// from elsewhere, and what they meet then is not timed.
    pub(super) fn keep_time(&mut self, contacts: &[Contact], touched: &[(u32, f64)], before: &[f64]) {
        if touched.is_empty() {
            return;
        }
        let times: HashMap<u32, f64> = touched.iter().copied().collect();
        for (i, contact) in contacts.iter().enumerate() {
            // Two bodies that touch do so at the same time.
            if let Some(time) = contact.unordered().iter().find_map(|body| times.get(body)) {
                self.gap[i] += time * (before[3 * i] - self.now[3 * i]);
                self.timed[i] = false;
            }
        }
    }
}

/// Whether each contact is an impact whose time is kept, with e > 0 as far as it is one: of balls that are
/// [`alone`] those without e, too, but only where they touch within the step and nothing presses them on, and
/// not where rolling or spinning friction resists, whose moments impacts do not transmit.
pub(super) fn timed(
    world: &World,
    collider: &Collider,
    contacts: &[Contact],
    (restitution, unseen): (&[f64], f64),
    step: f64,
) -> Vec<bool> {
    let mut all = alone(world, (collider, unseen), contacts, step);
    if !all.contains(&true) {
        return Vec::new();
    }
    let velocity = with_driven(world, &velocities(world), step);
    let material = |body: u32| world.bodies.material[body as usize].index();
    for ((is_timed, contact), e) in all.iter_mut().zip(contacts).zip(restitution) {
        if *is_timed && *e == 0.0 {
            let [a, b] = [material(contact.body_a), material(contact.body_b)];
            let turning = [world.materials.pair_rolling(a, b), world.materials.pair_spinning(a, b)];
            let row = contact_rows(world, std::slice::from_ref(contact))[0];
            let one = (std::slice::from_ref(contact), std::slice::from_ref(&row));
            let u = relative_velocities(None, one.0, one.1, &velocity);
            let touches = || Touch::of(world, (contact, &row), (&u, 0.0), step).is_some();
            let is_ball =
                |body: u32| collider.is_ball(world, body as usize) || world.is_prescribed(body as usize);
            *is_timed = turning.iter().all(|resistance| resistance.is_none())
                && is_ball(contact.body_a)
                && is_ball(contact.body_b)
                && touches();
        }
    }
    all
}

/// Whether each contact is a rigid one of bodies that fly ([`load::flies`]) or are driven, and each of them
/// is a ball that has no other one, or meets driven bodies alone and turns, as they do, by no more than goes
/// unseen (a fraction of its size); none: empty.
fn alone(world: &World, (collider, unseen): (&Collider, f64), contacts: &[Contact], step: f64) -> Vec<bool> {
    if world.cell().is_some_and(Cell::deforms) {
        return Vec::new();
    }
    let flies = load::flies(world, step);
    let mut count = vec![0_usize; world.bodies.len()];
    let mut meets_turning = vec![false; world.bodies.len()];
    for contact in contacts {
        for (body, other) in [(contact.body_a, contact.body_b), (contact.body_b, contact.body_a)] {
            count[body as usize] += 1;
            let other = other as usize;
            meets_turning[body as usize] |= !world.is_prescribed(other)
                || driven_velocity(world, other, world.time, step)[1] != Vec3::ZERO;
        }
    }
    let is_alone = |body: u32| {
        let k = body as usize;
        let is_lone = match collider.is_ball(world, k) {
            true => count[k] == 1,
            false => !meets_turning[k] && !collider.turns(world, k, step, unseen),
        };
        world.is_prescribed(k) || flies[k] && is_lone
    };
    let compliance = elasticity::compliances(world, contacts, step);
    let is_rigid = |i: usize| compliance.get(i).is_none_or(|&c| c == 0.0);
    let of = |(i, c): (usize, &Contact)| is_rigid(i) && is_alone(c.body_a) && is_alone(c.body_b);
    contacts.iter().enumerate().map(of).collect()
}

/// Of one body of a contact relative to the other where nothing else acts, in the frame of the contact,
/// m/s^2.
fn acceleration(world: &World, contact: &Contact, row: &RigidContact) -> [f64; 3] {
    let of_body = |body: u32| {
        let (body, bodies) = (body as usize, &world.bodies);
        if world.is_free(body) { world.gravity + bodies.force[body] / bodies.mass[body] } else { Vec3::ZERO }
    };
    let a = of_body(contact.body_a) - of_body(contact.body_b);
    row.frame.map(|axis| Vec3::from_array(axis).dot(a))
}

/// When two bodies that nothing else holds touch within a step and part for good in it.
pub(super) struct Touch {
    /// s after its start.
    pub time: f64,
}

impl Touch {
    /// That of a contact with a gap Phi (m) and the velocity u (m/s) under the acceleration a of
    /// its bodies (m/s^2): u_n(t)^2 = u_n^2 - 2 a_n Phi at t = 2 Phi / |u_n + u_n(t)|. `None` where the
    /// acceleration turns them back before the end of the step.
    pub(super) fn of(
        world: &World,
        (contact, row): (&Contact, &RigidContact),
        (u, restitution): (&[f64], f64),
        step: f64,
    ) -> Option<Self> {
        let a = acceleration(world, contact, row);
        let square = u[0] * u[0] - 2.0 * a[0] * contact.gap;
        if contact.gap <= 0.0 || square <= 0.0 {
            return None;
        }
        let time = 2.0 * contact.gap / (square.sqrt() - u[0]);
        let velocity = u[0] + time * a[0];
        let parts = a[0] * (step - time) >= (restitution + UNPRESSED) * velocity;
        (time < step && parts).then_some(Self { time })
    }
}
