//! The loop over bodies that makes the contact list of candidate pairs.

use super::candidates::{Others, Pairs, Sorted};
use super::encoding::{decoded, encoded};
use super::identity::identity;
use super::manifold::Solid;
use super::narrow::{Collidable, Placed, body_contacts};
use super::reduce::Touch;
use super::search::{Search, surface_speeds};
use super::sweep::{arrivals, time_of_impact};
use crate::contact::Contact;
use crate::math::Vec3;
use crate::shape::Part;
use crate::world::World;
use graintrain_ccp::Ranks;
use parry3d_f64::bounding_volume::Aabb;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Bodies per parallel task. Fixed, so that tasks and their order do not depend on threads.
pub(super) const TASK: usize = 256;

/// Contacts per body for which room is made at once.
pub(super) const USUAL: usize = 5;

/// Finds contacts; keeps what it derives from geometries between steps.
#[derive(Default)]
pub struct Collider {
    forms: Vec<Collidable>,
    ranks: Option<Arc<Ranks>>,
    stop: Option<Arc<AtomicBool>>,
}

impl Collider {
    /// Looks for contacts together with other processes, each of which has the same world and asks for the
    /// same: each looks around the bodies of its part, and all get all contacts.
    pub fn share_among(&mut self, ranks: Arc<Ranks>) {
        self.ranks = Some(ranks).filter(|ranks| ranks.count() > 1);
    }

    /// Ends a search under way as soon as the flag is set: what was found is then incomplete, and whoever set
    /// the flag has no use for it.
    pub(crate) fn stop_on(&mut self, stop: Arc<AtomicBool>) {
        self.stop = Some(stop);
    }

    /// All contacts with gap up to the envelope, m, and those further apart that would close within `step`
    /// seconds at the present velocities and under gravity, or if one of both came to rest (else fast bodies
    /// would be found deep inside each other: of two grains that fall together, the lower lands first);
    /// except between bodies that are both fully prescribed, and those that joints keep from colliding. In
    /// case that one comes to rest the travel of the other is looked ahead up to the radius of the largest
    /// grain.
    ///
    /// In the order of body A, then of its neighbours (of similar size first, ascending), then of features. A
    /// is the body of similar size and speed to most others, or the one with the lower index where both or
    /// neither are: a grain on a wall is A.
    pub fn contacts(&mut self, world: &World, envelope: f64, step: f64) -> Vec<Contact> {
        let search = Search::all(world, envelope, step);
        self.update_forms(world);
        let sorted = self.sort(world, search);
        let all = world.bodies.len().div_ceil(TASK);
        let own = self.ranks.as_ref().map_or(0..all, |ranks| ranks.part_of(all));
        let mut pairs = self.pairs(world, &sorted, search, own.clone());
        if let Some(ranks) = &self.ranks {
            let words: Vec<u64> =
                pairs.iter().flatten().map(|&[a, b]| u64::from(a) << 32 | u64::from(b)).collect();
            pairs =
                vec![ranks.join(&words).into_iter().map(|word| [(word >> 32) as u32, word as u32]).collect()];
        }
        let pairs = Pairs::new(world.bodies.len(), &pairs);
        let of_task = |task: usize| {
            let own = bodies_of(world, task);
            let mut found = Found { contacts: Vec::with_capacity(USUAL * own.len()), ..Found::default() };
            for body in own.take_while(|_| !self.is_stopped()) {
                self.contacts_of(world, (&sorted, &pairs, &sorted.others), body, search, &mut found);
            }
            found.contacts
        };
        let tasks: Vec<Vec<Contact>> = own.into_par_iter().map(of_task).collect();
        let mut contacts = tasks.concat();
        if let Some(ranks) = &self.ranks {
            contacts = decoded(&ranks.join(&encoded(&contacts)));
        }
        contacts
    }

    /// [`Self::pairs_of`] the bodies of these tasks, task by task.
    fn pairs(
        &self,
        world: &World,
        sorted: &Sorted,
        search: Search,
        tasks: Range<usize>,
    ) -> Vec<Vec<[u32; 2]>> {
        let of_task = |task: usize| self.pairs_of(world, sorted, bodies_of(world, task), search.margin());
        tasks.into_par_iter().map(of_task).collect()
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed))
    }

    /// The contact with the least gap among those with none or overlap that `counts`; no others are kept:
    /// where all bodies overlap, every pair would be one.
    pub(super) fn deepest(
        &mut self,
        world: &World,
        counts: impl Fn(&Contact) -> bool + Sync,
    ) -> Option<Contact> {
        self.update_forms(world);
        let search = Search { envelope: 0.0, step: 0.0, fall: 0.0, meeting: false };
        let sorted = self.sort(world, search);
        let deeper = |a: &Contact, b: &Contact| a.gap.total_cmp(&b.gap);
        let of_task = |task: usize| {
            let mut found = Found::default();
            let of_body = |body: usize| {
                found.contacts.clear();
                for pair in self.pairs_of(world, &sorted, body..body + 1, search.margin()) {
                    self.contacts_of_two(world, &sorted, pair, search, &mut found);
                }
                self.others_of(world, (&sorted, &sorted.others), body, search, &mut found);
                self.contacts_of_partners(world, &sorted, body, search, &mut found);
                found.contacts.iter().filter(|c| counts(c)).copied().min_by(deeper)
            };
            bodies_of(world, task).filter_map(of_body).min_by(deeper)
        };
        let tasks = 0..world.bodies.len().div_ceil(TASK);
        let of_tasks: Vec<_> = tasks.into_par_iter().map(of_task).collect();
        of_tasks.into_iter().flatten().min_by(deeper)
    }

    /// Every contact of two bodies that could close within the step if they moved with these velocities (six
    /// numbers per body), or twice as fast. Forms are those of the last call of [`Self::contacts`].
    pub(crate) fn contacts_of_pair(
        &self,
        world: &World,
        pair: [u32; 2],
        velocity: &[f64],
        step: f64,
    ) -> Vec<Contact> {
        let ([a, b], image) = self.placed_pair(world, pair);
        let travel = |body: u32| {
            let v = &velocity[6 * body as usize..6 * body as usize + 6];
            let radius = self.form(world, body as usize).bounding_radius;
            let spin = if radius.is_finite() { Vec3::from_slice(&v[3..]).length() * radius } else { 0.0 };
            step * (Vec3::from_slice(&v[..3]).length() + spin)
        };
        let fall =
            pair.map(|body| world.acceleration(body as usize)).into_iter().fold(0.0, f64::max) * step * step;
        let ahead = 2.0 * (travel(pair[0]) + travel(pair[1])) + fall;
        let mut touches = Vec::new();
        body_contacts(a, b, ahead, &mut touches);
        touches.iter().map(|touch| Contact { image, ..contact(pair, touch) }).collect()
    }

    /// Size of a body, m: the radius of spheres, capsules and cylinders, half the thickness of boxes. A body
    /// without a size of its own (planes, meshes) has an infinite one. Forms are those of the last call of
    /// [`Self::contacts`].
    pub(crate) fn body_size(&self, world: &World, body: usize) -> f64 {
        self.form(world, body).size
    }

    /// The size of a body, that from its centre to where it ends where it has none, and how far a turn moves
    /// its surface at most, over the angle, m: not that of a ball.
    pub(crate) fn sizes(&self, world: &World, body: usize) -> [f64; 2] {
        let Collidable { size, bounding_radius, ball, .. } = self.form(world, body);
        [size.min(*bounding_radius), if ball.is_some() { 0.0 } else { *bounding_radius }]
    }

    /// Whether a body is one sphere about its own origin.
    pub(crate) fn is_ball(&self, world: &World, body: usize) -> bool {
        self.form(world, body).ball.is_some()
    }

    /// Whether a body turns in a step by more than the fraction `unseen` of its size; a ball's turn moves no
    /// contact.
    pub(crate) fn turns(&self, world: &World, body: usize, step: f64, unseen: f64) -> bool {
        let [size, reach] = self.sizes(world, body);
        let way = step * world.bodies.angular_velocity[body].length() * reach;
        way > unseen * size && !self.is_ball(world, body)
    }

    /// How far a body reaches from its centre along a unit vector, and along any, m; infinite for planes.
    pub(crate) fn reach(&self, world: &World, body: usize, direction: Vec3) -> (f64, f64) {
        let Placed { form, orientation, .. } = self.placed(world, body);
        let of_part = |part: &Part| {
            let (position, orientation) = (orientation * part.position, orientation * part.orientation);
            Solid::Placed { shape: &part.shape, position, orientation }.reach(direction)
        };
        let reach = form.geometry.parts.iter().map(of_part).fold(f64::NEG_INFINITY, f64::max);
        (reach, form.bounding_radius)
    }

    /// Size of the smaller body of a contact, m.
    pub(crate) fn contact_size(&self, world: &World, contact: &Contact) -> f64 {
        let [a, b] = [contact.body_a, contact.body_b].map(|body| self.body_size(world, body as usize));
        let size = a.min(b);
        if size.is_finite() {
            return size;
        }
        let [a, b] =
            [contact.body_a, contact.body_b].map(|body| self.form(world, body as usize).bounding_radius);
        let radius = a.min(b);
        if radius.is_finite() { radius } else { 1.0 }
    }

    /// How far this spin, rad/s, moves the surface of a body within the step, m, where that bends its way:
    /// nothing for balls, for bodies without bounds, and for those that turn by less than [`TURN`].
    pub(crate) fn spin_travel(&self, world: &World, body: usize, spin: f64, step: f64) -> f64 {
        let form = self.form(world, body);
        let bends = form.ball.is_none() && form.bounding_radius.is_finite() && step * spin > TURN;
        if bends { step * spin * form.bounding_radius } else { 0.0 }
    }

    /// Follows the geometries of the world; whether any of them is new or another one than before.
    pub(crate) fn update_forms(&mut self, world: &World) -> bool {
        let mut changed = self.forms.len() != world.geometries.len();
        self.forms.truncate(world.geometries.len());
        for (index, geometry) in world.geometries.iter().enumerate() {
            match self.forms.get_mut(index) {
                Some(form) if Arc::ptr_eq(&form.geometry, geometry) => continue,
                Some(form) if form.geometry == *geometry => {
                    form.geometry = Arc::clone(geometry);
                    continue;
                }
                Some(form) => *form = Collidable::new(Arc::clone(geometry)),
                None => self.forms.push(Collidable::new(Arc::clone(geometry))),
            }
            changed = true;
        }
        changed
    }

    pub(super) fn form(&self, world: &World, body: usize) -> &Collidable {
        &self.forms[world.bodies.geometry[body].index()]
    }

    pub(super) fn placed(&self, world: &World, body: usize) -> Placed<'_> {
        Placed {
            form: self.form(world, body),
            position: world.bodies.position[body],
            orientation: world.bodies.orientation[body],
        }
    }

    /// Both bodies of a pair, the second as its image beside the first, and by how many edges of a periodic
    /// cell that is away from it.
    pub(super) fn placed_pair(&self, world: &World, pair: [u32; 2]) -> ([Placed<'_>; 2], [i32; 3]) {
        let [a, mut b] = pair.map(|body| self.placed(world, body as usize));
        let image = world.image_beside(pair);
        if let Some(cell) = world.cell().filter(|_| image != [0; 3]) {
            b.position += cell.shift(image);
        }
        ([a, b], image)
    }

    /// Contacts of which `body` is A: those with bodies of the grid, then all others.
    pub(super) fn contacts_of(
        &self,
        world: &World,
        (sorted, pairs, others): (&Sorted, &Pairs, &Others),
        body: usize,
        search: Search,
        found: &mut Found,
    ) {
        found.partners.clear();
        found.partners.extend_from_slice(pairs.of(body));
        found.partners.sort_unstable();
        if world.cell().is_some() {
            found.partners.dedup();
        }
        self.contacts_of_partners(world, sorted, body, search, found);
        self.others_of(world, (sorted, others), body, search, found);
        self.contacts_of_partners(world, sorted, body, search, found);
    }

    /// Makes the partners of `body` as A these that are not of the grid.
    fn others_of(
        &self,
        world: &World,
        (sorted, among): (&Sorted, &Others),
        body: usize,
        search: Search,
        found: &mut Found,
    ) {
        let me = self.placed(world, body);
        let margin = search.margin();
        let radius = me.form.bounding_radius;
        let similar = sorted.in_grid[body];
        let others = &mut found.partners;
        others.clear();
        if radius.is_finite() {
            let around = if similar {
                Aabb::new(me.position - radius, me.position + radius)
            } else {
                self.bounds(world, body)
            };
            // The leaves hold the relative travel of their own bodies.
            let by = margin + sorted.travel[body].relative + sorted.largest;
            let around = Aabb::new(around.mins - by, around.maxs + by);
            others.extend(
                among
                    .tree
                    .intersect_aabb(&around)
                    .map(|leaf| among.large[leaf as usize])
                    .filter(|&other| similar || other as usize > body),
            );
            let near = among.unbounded.iter().filter(|other| {
                other.may_touch(me.position, radius + margin + sorted.approach([body as u32, other.body]))
            });
            others.extend(near.map(|other| other.body));
        } else {
            let later = among.unbounded.iter().filter(|other| other.body as usize > body);
            others.extend(later.map(|other| other.body));
        }
        others.sort_unstable();
        if world.cell().is_some() {
            others.dedup();
        }
    }

    /// Contacts of a body as A with each of the partners found.
    fn contacts_of_partners(
        &self,
        world: &World,
        sorted: &Sorted,
        body: usize,
        search: Search,
        found: &mut Found,
    ) {
        let partners = std::mem::take(&mut found.partners);
        for &other in &partners {
            self.contacts_of_two(world, sorted, [body as u32, other], search, found);
        }
        found.partners = partners;
    }

    /// Contacts of two bodies.
    fn contacts_of_two(
        &self,
        world: &World,
        sorted: &Sorted,
        pair: [u32; 2],
        search: Search,
        found: &mut Found,
    ) {
        let prescribed = pair.map(|body| world.is_prescribed(body as usize));
        if prescribed == [true; 2] || sorted.is_ignored(pair) {
            return;
        }
        let Found { touches, contacts, .. } = found;
        touches.clear();
        let ([me, them], image) = self.placed_pair(world, pair);
        let far = FAST * me.form.size.min(them.form.size);
        let is_fast = sorted.may_travel(pair, far) && self.relative_travel(world, pair, search.step) > far;
        let is_held = prescribed != [false; 2];
        // What fast ones meet on their way is found apart.
        let approach = if is_fast { sorted.approach_at_rest(pair, is_held) } else { sorted.approach(pair) };
        let ahead = search.margin() + approach;
        match (me.form.ball, them.form.ball) {
            (Some(r_a), Some(r_b)) => {
                if search.meeting {
                    let [[u_a, _], [u_b, _]] = world.pair_velocities(pair);
                    let gap = (me.position - them.position).length() - r_a - r_b;
                    if search.step * (u_a - u_b).length() <= gap {
                        return;
                    }
                }
                ball_contact(me.position, r_a, them.position, r_b, ahead, touches);
            }
            _ => body_contacts(me, them, ahead, touches),
        }
        let first = contacts.len();
        if is_fast {
            self.arrivals(world, pair, sorted.largest, search, touches, contacts);
        } else {
            let closes = |touch: &&Touch| search.closes(world, pair, sorted.largest, touch);
            contacts.extend(touches.iter().filter(closes).map(|touch| contact(pair, touch)));
        }
        contacts[first..].iter_mut().for_each(|contact| contact.image = image);
    }

    /// dt |u_A - u_B| and what spin adds to it, m.
    fn relative_travel(&self, world: &World, pair: [u32; 2], step: f64) -> f64 {
        let [a, b] = pair.map(|body| body as usize);
        let spin =
            |body: usize| self.spin_travel(world, body, world.bodies.angular_velocity[body].length(), step);
        let [[u_a, _], [u_b, _]] = world.pair_velocities(pair);
        step * (u_a - u_b).length() + spin(a) + spin(b)
    }

    /// Contacts of two bodies that move past each other by about their size or more within the step: where
    /// they meet, if they do, rather than where they are nearest now. Touches within the envelope, and those
    /// that close in case that one of both comes to rest, stay what they are.
    fn arrivals(
        &self,
        world: &World,
        pair: [u32; 2],
        largest: f64,
        search: Search,
        touches: &[Touch],
        contacts: &mut Vec<Contact>,
    ) {
        let ([a, b], _) = self.placed_pair(world, pair);
        let [v_a, v_b] = world.pair_velocities(pair);
        let first = contacts.len();
        // The end that meets first stops, and the other one swings down in the rest of the step.
        let across = 2.0 * a.form.bounding_radius.min(b.form.bounding_radius);
        let around = if a.form.ball.is_some() && b.form.ball.is_some() { 0.0 } else { across };
        let envelope = search.envelope.max(around);
        if let Some(impact) = time_of_impact(a, b, v_a, v_b, search.step, envelope).filter(|i| i.time > 0.0) {
            for arrival in arrivals(&impact, a, b, v_a, v_b) {
                let [on_a, on_b] = [(a, arrival.on_a), (b, arrival.on_b)].map(|(body, point)| {
                    let (geometry, arm) = (&body.form.geometry, point - body.position);
                    body.position + geometry.arm_before(body.orientation, arm, arrival.touch.normal)
                });
                let (point, lead) = (0.5 * (on_a + on_b), 0.5 * (on_a - on_b));
                contacts.push(Contact { point, lead, ..contact(pair, &arrival.touch) });
            }
        }
        let met = contacts.len() - first;
        for touch in touches {
            let near = touch.gap <= search.envelope || {
                let (fall, away) = (search.fall_of(world, pair), surface_speeds(world, pair, touch));
                search.closes_at_rest(world, pair, fall, largest, touch, away)
            };
            let new = contact(pair, touch);
            if near && contacts[first..first + met].iter().all(|c| c.identity != new.identity) {
                contacts.push(new);
            }
        }
        contacts[first..].sort_by_key(|c| c.identity);
    }
}

/// Bodies whose surfaces move by more than this fraction of the smaller one's size relative to each other
/// within a step are looked at along their way: up to there the error of a fixed normal is a thirtieth of the
/// size.
const FAST: f64 = 0.5;

/// Turn of a body within a step, rad, up to which a fixed normal does.
const TURN: f64 = 0.3;

/// The bodies of a task.
pub(super) fn bodies_of(world: &World, task: usize) -> Range<usize> {
    task * TASK..((task + 1) * TASK).min(world.bodies.len())
}

pub(super) fn contact([body_a, body_b]: [u32; 2], touch: &Touch) -> Contact {
    Contact {
        body_a,
        body_b,
        identity: identity(body_a, body_b, touch.feature),
        point: touch.point,
        normal: touch.normal,
        gap: touch.gap,
        lead: Vec3::ZERO,
        image: [0; 3],
    }
}

/// Contacts of one task, with scratch.
#[derive(Default)]
pub(super) struct Found {
    /// Bodies that may touch the one that is looked at.
    partners: Vec<u32>,
    touches: Vec<Touch>,
    pub(super) contacts: Vec<Contact>,
}

#[inline]
fn ball_contact(a: Vec3, r_a: f64, b: Vec3, r_b: f64, envelope: f64, touches: &mut Vec<Touch>) {
    let d = a - b;
    let length = d.length();
    let gap = length - r_a - r_b;
    if gap <= envelope {
        // Concentric balls have no normal: any direction separates them.
        let normal = if length > 0.0 { d / length } else { Vec3::X };
        touches.push(Touch { point: b + (r_b + 0.5 * gap) * normal, normal, gap, feature: 0 });
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::handle::{GeometryId, MaterialId};
    use crate::material::Materials;
    use crate::math::rotation_exponential;
    use crate::motion::Motion;
    use crate::shape::Geometry;
    use crate::world::Body;
    use proptest::prelude::*;

    /// Spheres of two sizes, a capsule, a box, a plane and a mesh.
    pub(in crate::collide) fn add_forms(world: &mut World) -> [GeometryId; 6] {
        let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        [
            Geometry::sphere(0.1).unwrap(),
            Geometry::sphere(0.14).unwrap(),
            Geometry::capsule(0.1, 0.05).unwrap(),
            Geometry::cuboid(Vec3::new(0.6, 0.5, 0.1)).unwrap(),
            Geometry::plane(),
            Geometry::mesh(corners, vec![[0, 1, 2]]).unwrap(),
        ]
        .map(|form| world.add_geometry(form))
    }

    /// Every pair through the narrow phase.
    fn brute_force(world: &World, envelope: f64) -> Vec<u64> {
        let mut collider = Collider::default();
        collider.update_forms(world);
        let mut found = Vec::new();
        for a in 0..world.bodies.len() {
            for b in a + 1..world.bodies.len() {
                if world.is_prescribed(a) && world.is_prescribed(b) {
                    continue;
                }
                let mut touches = Vec::new();
                body_contacts(collider.placed(world, a), collider.placed(world, b), envelope, &mut touches);
                found.extend(touches.iter().map(|t| identity(a as u32, b as u32, t.feature)));
            }
        }
        found.sort_unstable();
        found
    }

    proptest! {
        /// Balls that move by up to twice their size: what the whole search finds and closes within the step
        /// is among the meetings, as it is.
        #[test]
        fn meetings_have_every_contact_that_closes(
            balls in prop::collection::vec(
                (prop::array::uniform3(-0.6..0.6_f64), prop::array::uniform3(-40.0..40.0_f64), any::<bool>(), 0..3_u32),
                2..40,
            ),
        ) {
            let step = 0.01;
            let materials = Materials::single("stuff", 1.0, 0.0, 0.0).unwrap();
            let mut world = World::new(Vec3::new(0.0, 0.0, -10.0), materials).unwrap();
            let sizes = [0.1, 0.2].map(|radius| world.add_geometry(Geometry::sphere(radius).unwrap()));
            let floor = world.add_geometry(Geometry::plane());
            let fixed = world.add_motion(Motion::fixed()).unwrap();
            let place = Vec3::new(0.0, 0.0, -0.5);
            world.add_body(Body { motion: fixed, ..Body::new(floor, MaterialId::default(), place) }).unwrap();
            for (position, velocity, is_large, slowness) in balls {
                let geometry = sizes[usize::from(is_large)];
                let velocity = Vec3::from_array(velocity) * 0.03_f64.powi(slowness as i32);
                let body = Body::new(geometry, MaterialId::default(), Vec3::from_array(position));
                world.add_body(Body { velocity, ..body }).unwrap();
            }
            let mut collider = Collider::default();
            let meetings = collider.meetings_of(&world, &vec![true; world.bodies.len()], step);
            let closing = |c: &Contact| {
                let u = c.normal.dot(world.bodies.velocity[c.body_a as usize] - world.bodies.velocity[c.body_b as usize]);
                c.gap.max(0.0) + step * u < -1e-9
            };
            let all = collider.contacts(&world, 0.0, step);
            let closing_of = |found: &[Contact]| found.iter().filter(|c| closing(c)).copied().collect::<Vec<_>>();
            prop_assert!(meetings.len() <= all.len());
            prop_assert_eq!(closing_of(&meetings), closing_of(&all));
        }
    }

    proptest! {
        /// Spheres of two sizes, capsules, one large box, a plane and a mesh, free and fixed.
        #[test]
        fn contacts_are_those_of_all_pairs(
            bodies in prop::collection::vec(
                (0..6_usize, prop::array::uniform3(-1.0..1.0_f64), prop::array::uniform3(-2.0..2.0_f64), any::<bool>()),
                2..60,
            ),
            envelope in 0.0..0.05_f64,
        ) {
            let materials = Materials::single("stuff", 1.0, 0.0, 0.0).unwrap();
            let mut world = World::new(Vec3::ZERO, materials).unwrap();
            let fixed = world.add_motion(Motion::fixed()).unwrap();
            let forms = add_forms(&mut world);
            for (kind, position, turn, free) in bodies {
                let motion = if free && kind < 4 { crate::world::FREE } else { fixed };
                let orientation = rotation_exponential(Vec3::from_array(turn));
                let body = Body::new(forms[kind], MaterialId::default(), Vec3::from_array(position));
                world.add_body(Body { motion, orientation, ..body }).unwrap();
            }
            let contacts = Collider::default().contacts(&world, envelope, 0.0);
            let mut found: Vec<u64> = contacts.iter().map(|contact| contact.identity).collect();
            found.sort_unstable();
            prop_assert_eq!(found, brute_force(&world, envelope));
        }
    }
}
