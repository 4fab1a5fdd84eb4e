//! Which of the contacts that close are met: what passes is no impact, what is touched elsewhere none there,
//! and what a body would meet after another one waits for the next pass.

use super::{ImpactSolver, Motion, SAME_TIME};
use crate::collide::Course;
use crate::contact::Contact;
use crate::math::Vec3;
use crate::world::World;
use graintrain_ccp::CoupledBodies;
use hashbrown::HashSet;

impl ImpactSolver<'_> {
    /// Those of these contacts whose bodies do not pass each other over a gap, overlapping on their way by no
    /// more than a fifth of what Phi + dt u_n says: the plane of an edge bars a way that leads past it, as
    /// that of the next tile does for a ball that rolls. As they move now, for a floor carries what rolls;
    /// where that brings them nowhere near, as they fall.
    pub(super) fn meeting(
        &self,
        world: &World,
        contacts: &[Contact],
        motion: &Motion,
        mut of: Vec<u32>,
        step: f64,
    ) -> Vec<u32> {
        // Ways to look at: the pair, whether it falls, and the overlap that its contacts allow.
        let mut ways: Vec<([u32; 2], bool, f64, u32)> = Vec::new();
        for &index in &of {
            let contact = &contacts[index as usize];
            let pair = contact.unordered();
            let balls = pair.iter().filter(|&&body| self.collider.is_ball(world, body as usize)).count();
            if contact.gap <= 0.0 || balls == 2 || self.met.contains_key(&contact.identity) {
                continue;
            }
            let [now, later] = motion.normal(index as usize).map(|u| contact.gap + step * u);
            let (foreseen, falls) = if now < 0.0 { (now, false) } else { (later, true) };
            let size = self.collider.contact_size(world, contact);
            ways.push((pair, falls, (-self.spurious * foreseen).min(self.unseen * size), index));
        }
        ways.sort_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)));
        let mut passing = HashSet::new();
        for way in ways.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (pair, falls, ..) = way[0];
            let velocities = pair.map(|body| {
                let of = if falls { &motion.free } else { &motion.driven };
                [0, 3].map(|k| Vec3::from_slice(&of[6 * body as usize + k..]))
            });
            let allowed: Vec<f64> = way.iter().map(|(_, _, allowed, _)| *allowed).collect();
            let pass =
                self.collider.pass_freely(world, pair, velocities.map(Course::straight), step, &allowed, 0.0);
            passing.extend(way.iter().zip(pass).filter(|(_, pass)| *pass).map(|((.., index), _)| *index));
        }
        of.retain(|index| !passing.contains(index));
        of
    }

    /// Of the contacts of two convex bodies those whose normals part them when they touch first; along others
    /// they meet nowhere, or are deflected by then.
    pub(super) fn along_normals_of_touch(
        &self,
        world: &World,
        contacts: &[Contact],
        motion: &Motion,
        mut of: Vec<u32>,
        step: f64,
    ) -> Vec<u32> {
        let pair = |i: u32| contacts[i as usize].unordered();
        let mut sorted = of.clone();
        sorted.sort_by_key(|&i| (pair(i), i));
        let mut aside = HashSet::new();
        for group in sorted.chunk_by(|&i, &j| pair(i) == pair(j)) {
            let contact = |i: &u32| &contacts[*i as usize];
            if group.len() == 1 {
                continue;
            }
            let pair = pair(group[0]);
            let time = |i: &u32| contact(i).gap.max(0.0) / -motion.now[3 * *i as usize];
            let first = group.iter().map(time).fold(step, f64::min);
            let normal = |c: &Contact| if c.body_a == pair[0] { c.normal } else { -c.normal };
            let normals: Vec<Vec3> = group.iter().map(|i| normal(contact(i))).collect();
            let velocities = pair
                .map(|body| [0, 3].map(|k| Vec3::from_slice(&motion.driven[6 * body as usize + k..][..3])));
            let Some(apart) = self.collider.separations(world, pair, velocities, first, &normals) else {
                continue;
            };
            let best = apart.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let seen = self.unseen * self.collider.contact_size(world, contact(&group[0]));
            let parts = group.iter().zip(apart).filter(|(_, apart)| *apart < best - seen);
            aside.extend(parts.map(|(i, _)| *i));
        }
        of.retain(|i| !aside.contains(i));
        of
    }
}

/// Those of the closing contacts before which none of their two bodies touches anything else: what a body
/// would meet later, it meets deflected, if at all. Contacts that touch at the same time stay together, and
/// those of bodies that joints couple: what touches one of them deflects all.
pub(super) fn first_of_bodies(
    world: &World,
    contacts: &[Contact],
    coupled: &[CoupledBodies],
    closing: &[u32],
    (now, step): (&[f64], f64),
) -> Vec<u32> {
    let mut is_single: Vec<bool> = (0..world.bodies.len()).map(|body| !world.is_prescribed(body)).collect();
    for &body in coupled.iter().flat_map(|mechanism| &mechanism.bodies) {
        is_single[body as usize] = false;
    }
    let time = |i: u32| contacts[i as usize].gap.max(0.0) / -now[3 * i as usize];
    let bodies = |i: u32| [contacts[i as usize].body_a as usize, contacts[i as usize].body_b as usize];
    let mut first = vec![f64::INFINITY; world.bodies.len()];
    for &i in closing {
        for body in bodies(i) {
            first[body] = first[body].min(time(i));
        }
    }
    let is_first = |&i: &u32| {
        bodies(i).iter().all(|&body| !is_single[body] || time(i) <= first[body] + SAME_TIME * step)
    };
    closing.iter().copied().filter(is_first).collect()
}
