//! Which of the contacts that close are met: what passes is no impact, what is touched elsewhere none there,
//! and what a body would meet after another one waits for the next pass.

use super::{ImpactSolver, Motion, SAME_TIME};
use crate::collide::Course;
use crate::contact::Contact;
use crate::math::Vec3;
use crate::world::World;
use graintrain_ccp::CoupledBodies;
use hashbrown::{HashMap, HashSet};

impl ImpactSolver<'_> {
    /// Those of these contacts whose bodies do not pass each other over a gap, overlapping on their way by no
    /// more than a fifth of what Phi + dt u_n says: the plane of an edge bars a way that leads past it, as
    /// that of the next tile does for a ball that rolls. What flies goes its way through the step; other
    /// bodies as they move now, for a floor carries what rolls, and where that brings them nowhere near, as
    /// they fall.
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
            let flies = pair.iter().any(|&body| motion.flies[body as usize]);
            let (foreseen, falls) = match (flies, now < 0.0) {
                (true, _) => (0.0, false),
                (false, true) => (now, false),
                (false, false) => (later, true),
            };
            let size = self.collider.contact_size(world, contact);
            ways.push((pair, falls, (-self.spurious * foreseen).min(self.unseen * size), index));
        }
        ways.sort_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)));
        let mut passing = HashSet::new();
        for way in ways.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (pair, falls, ..) = way[0];
            let velocities = pair.map(|body| motion.way(body, falls));
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
            let best = (0..apart.len()).max_by(|&i, &j| apart[i].total_cmp(&apart[j])).unwrap_or_default();
            let seen = self.unseen * self.collider.contact_size(world, contact(&group[0]));
            // Normals that lead apart by no more than goes unseen over a size are one.
            let is_other = |k: &usize| {
                apart[*k] < apart[best] - seen && (normals[*k] - normals[best]).length() > self.unseen
            };
            aside.extend((0..apart.len()).filter(is_other).map(|k| group[k]));
        }
        of.retain(|i| !aside.contains(i));
        of
    }
}

/// Contacts between the same two bodies, or of one body with driven ones.
struct Group<'a> {
    /// Those that close, and others that approach: the flag, and the contact.
    contacts: &'a [([u32; 2], bool, u32)],
    /// When the first of them touches, s.
    time: f64,
}

impl ImpactSolver<'_> {
    /// Those of the closing contacts before which none of their two bodies touches anything else: what a body
    /// would meet later, it meets deflected, if at all. Contacts of two bodies that are together then stay
    /// together, up to what may overlap unseen: an edge that touches before another one by rounding would
    /// turn the body. So do others that approach, but by rounding would touch in the next step. Those of
    /// bodies that joints couple stay together, too: what touches one of them deflects all.
    pub(super) fn first_of_bodies(
        &self,
        world: &World,
        contacts: &[Contact],
        coupled: &[CoupledBodies],
        [closing, approaching]: [&[u32]; 2],
        (motion, step): (&Motion, f64),
    ) -> Vec<u32> {
        let mut is_single: Vec<bool> =
            (0..world.bodies.len()).map(|body| !world.is_prescribed(body)).collect();
        for &body in coupled.iter().flat_map(|mechanism| &mechanism.bodies) {
            is_single[body as usize] = false;
        }
        let held = |body: u32| if world.is_prescribed(body as usize) { u32::MAX } else { body };
        let key = |i: u32| {
            let mut pair = contacts[i as usize].unordered().map(held);
            pair.sort_unstable();
            pair
        };
        let all = [(closing, false), (approaching, true)].into_iter();
        let all = all.flat_map(|(of, approaches)| of.iter().map(move |&i| (approaches, i)));
        let mut sorted: Vec<([u32; 2], bool, u32)> = all.map(|(other, i)| (key(i), other, i)).collect();
        sorted.sort_unstable();
        let time = |i: u32| motion.gap[i as usize].max(0.0) / -motion.now[3 * i as usize];
        let closing_of = |group: &'_ [([u32; 2], bool, u32)]| group.partition_point(|(_, other, _)| !other);
        let groups: Vec<Group<'_>> = sorted
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|group| closing_of(group) > 0)
            .map(|contacts| {
                let closing = contacts[..closing_of(contacts)].iter();
                Group { contacts, time: closing.map(|&(.., i)| time(i)).fold(step, f64::min) }
            })
            .collect();
        let bodies = |i: u32| contacts[i as usize].unordered().map(|body| body as usize);
        let mut first = vec![f64::INFINITY; world.bodies.len()];
        for group in &groups {
            let closing = group.contacts[..closing_of(group.contacts)].iter();
            for body in closing.flat_map(|&(.., i)| bodies(i)) {
                first[body] = first[body].min(group.time);
            }
        }
        let is_first = |i: u32, time: f64| {
            bodies(i).iter().all(|&body| !is_single[body] || time <= first[body] + SAME_TIME * step)
        };
        let mut found = Vec::new();
        for Group { contacts: all, time } in groups {
            let of: Vec<u32> = all.iter().map(|&(.., i)| i).collect();
            for (&(_, other, i), apart) in all.iter().zip(self.apart_at(world, contacts, motion, &of, time)) {
                let is_alone = bodies(i).iter().any(|&body| is_single[body]);
                let near = self.unseen * self.collider.contact_size(world, &contacts[i as usize]);
                if (apart <= near || !is_alone && !other) && is_first(i, time) {
                    found.push(i);
                }
            }
        }
        found.sort_unstable();
        found
    }

    /// How far apart these contacts are after this time, more than the first of them, m: where their bodies
    /// are then, if these turn.
    fn apart_at(
        &self,
        world: &World,
        contacts: &[Contact],
        motion: &Motion,
        of: &[u32],
        time: f64,
    ) -> Vec<f64> {
        if of.len() == 1 {
            return vec![0.0];
        }
        let linear = |&i: &u32| motion.gap[i as usize] + time * motion.now[3 * i as usize];
        let mut apart: Vec<f64> = of.iter().map(linear).collect();
        let has_gone_on = of.iter().any(|&i| motion.gap[i as usize] != contacts[i as usize].gap);
        let (mut pairs, mut there) = (HashSet::new(), HashMap::new());
        for contact in of.iter().map(|&i| &contacts[i as usize]).filter(|_| !has_gone_on) {
            let pair = [contact.body_a, contact.body_b];
            if !pairs.insert(pair) {
                continue;
            }
            let velocities = pair
                .map(|body| [0, 3].map(|k| Vec3::from_slice(&motion.driven[6 * body as usize + k..][..3])));
            let near = self.unseen * self.collider.contact_size(world, contact);
            let turns = [0, 1].into_iter().any(|k| {
                let reach = self.collider.sizes(world, pair[k] as usize)[1];
                time * velocities[k][1].length() * reach > near
            });
            if turns {
                there.extend(self.collider.gaps_after(world, pair, velocities, time));
            }
        }
        for (&i, apart) in of.iter().zip(&mut apart) {
            *apart = there.get(&contacts[i as usize].identity).copied().unwrap_or(*apart);
        }
        let least = apart.iter().copied().fold(f64::INFINITY, f64::min);
        apart.iter().map(|apart| apart - least).collect()
    }
}
