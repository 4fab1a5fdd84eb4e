//! How bodies go through a step that no contact acts in: what flies on its parabola, what was carried on as
//! it went, all else by x + dt u+.

use crate::collide::Collider;
use crate::contact::Contact;
use crate::joint::Motor;
use crate::joint::mechanism::driven_in_place;
use crate::load;
use crate::math::Vec3;
use crate::world::World;
use graintrain_ccp::CoupledBodies;

/// Whether each body was carried by a contact in the last step.
pub(crate) fn carried(world: &World) -> Vec<bool> {
    let mut carried = vec![false; world.bodies.len()];
    let pairs = carrying(world).flat_map(|contact| [contact.body_a, contact.body_b]);
    pairs.for_each(|body| carried[body as usize] = true);
    carried
}

/// Whether each body flies ([`load::flies`]) and was not [`carried`] in the last step.
pub(crate) fn flying(world: &World, step: f64) -> Vec<bool> {
    let flies = load::flies(world, step).into_iter();
    flies.zip(carried(world)).map(|(flies, carried)| flies && !carried).collect()
}

/// u and w with which a body that flies goes through a step where no contact acts, from its velocities before
/// the step and `free` after it, m/s and rad/s, six numbers per body: the means of the velocity, and of the
/// spin of its free rotation, which `free` has.
pub(crate) fn mean_in_flight([before, free]: [&[f64]; 2], body: usize) -> [Vec3; 2] {
    let of = |v: &[f64], part: usize| Vec3::from_slice(&v[6 * body + part..][..3]);
    [0.5 * (of(before, 0) + of(free, 0)), of(free, 3)]
}

/// How bodies that fly ([`load::flies`]) go through a step if no contact acts: x + dt (u' + u+) / 2, where
/// all else goes x + dt u+. What a contact carried in the last step goes on being carried.
pub(crate) struct Flight {
    /// Whether a body flies and was not carried.
    pub flies: Vec<bool>,
    /// Those that turn by no more than goes unseen: others are off their contacts by more than they fall.
    steady: Vec<bool>,
    /// Velocities after the step, and in its mean, six numbers per body.
    pub end: Vec<f64>,
    pub mean: Vec<f64>,
}

impl Flight {
    /// Of what was [`carried`] or not, with these velocities before the step, and after it if no contact
    /// acted, m/s and rad/s, six numbers per body; what may turn unseen: [`Collider::turns`].
    pub(crate) fn of(
        world: &World,
        carried: &[bool],
        (collider, unseen): (&Collider, f64),
        [before, free]: [&[f64]; 2],
        step: f64,
    ) -> Self {
        let mut flies = load::flies(world, step);
        let is_steady = |(body, &flies): (usize, &bool)| flies && !collider.turns(world, body, step, unseen);
        let mut steady: Vec<bool> = flies.iter().enumerate().map(is_steady).collect();
        let (mut end, mut mean) = (free.to_vec(), free.to_vec());
        for body in (0..steady.len()).filter(|&body| steady[body]) {
            for k in 6 * body..6 * body + 3 {
                end[k] = if carried[body] { before[k] } else { free[k] };
                mean[k] = 0.5 * (before[k] + end[k]);
            }
        }
        for of in [&mut flies, &mut steady] {
            of.iter_mut().zip(carried).for_each(|(flies, carried)| *flies &= !carried);
        }
        Self { flies, steady, end, mean }
    }

    /// Whether a contact has a body that flies and does not turn visibly.
    pub(crate) fn has(&self, contact: &Contact) -> bool {
        self.steady[contact.body_a as usize] || self.steady[contact.body_b as usize]
    }
}

/// The contacts that carried something in the last step: not those that bounced.
pub(super) fn carrying(world: &World) -> impl Iterator<Item = &Contact> {
    let set = &world.contacts;
    let carries = |i: &usize| set.impulse[*i] != Vec3::ZERO && set.bounced.get(*i) != Some(&true);
    (0..set.contacts.len()).filter(carries).map(|i| &set.contacts[i])
}

/// What is to be added to velocities of the middle of the last step to make them those of now, dt a / 2: of
/// bodies that do not fly and that no contact carried in the last step. Of a mechanism only where nothing
/// else holds it either: no stop (a taut rope is one), and no motor with a limit. `[now, free]` are the
/// velocities before and after the step if no contact acted, six numbers per body.
pub(super) fn to_now(
    world: &World,
    coupled: &[CoupledBodies],
    [now, free]: [&[f64]; 2],
    step: f64,
) -> Vec<f64> {
    let flies = load::flies(world, step);
    let mut is_held = carried(world);
    for placed in world.joints() {
        let has_limit = matches!(placed.joint.motor, Some(Motor::Speed { limit: Some(_), .. }));
        if has_limit || placed.state.stopped != 0 {
            placed.joint.bodies.iter().flatten().for_each(|body| is_held[body.index()] = true);
        }
    }
    let mut after = free.to_vec();
    for CoupledBodies { bodies, .. } in coupled {
        let any = bodies.iter().any(|&body| is_held[body as usize]);
        bodies.iter().for_each(|&body| is_held[body as usize] = any);
    }
    if coupled.iter().any(|mechanism| mechanism.bodies.iter().any(|&body| !is_held[body as usize])) {
        after = driven_in_place(world, now, after, step);
    }
    let lags = |body: usize| !flies[body] && !is_held[body];
    (0..now.len()).map(|k| if lags(k / 6) { 0.5 * (after[k] - now[k]) } else { 0.0 }).collect()
}
