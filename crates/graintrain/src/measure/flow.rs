//! What passes a plane, and forces: through a plane, on bodies.

use super::contacts::ends;
use crate::handle::BodyId;
use crate::load::Region;
use crate::math::Vec3;
use crate::world::World;
use serde::{Deserialize, Serialize};

/// A plane, or the part of it in a region.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plane {
    /// A point of it, m.
    pub point: Vec3,
    /// Unit normal: the direction that counts as positive.
    pub normal: Vec3,
    /// Only what passes here; `None`: all of the plane.
    pub region: Option<Region>,
}

/// What has passed a plane along its normal, less what came back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Passed {
    /// kg
    pub mass: f64,
    /// Bodies.
    pub bodies: i64,
}

impl Plane {
    /// Height above the plane, m.
    fn height(&self, point: Vec3) -> f64 {
        self.normal.dot(point - self.point)
    }

    /// Where the way from `a` to `b` passes the plane within the region, with +1 along the normal and -1
    /// against it; a point on the plane counts as above it, so that whatever stops there is counted once.
    fn crossing(&self, a: Vec3, b: Vec3) -> Option<f64> {
        let (low, high) = (self.height(a), self.height(b));
        if (low < 0.0) == (high < 0.0) {
            return None;
        }
        let at = a + (low / (low - high)) * (b - a);
        let inside = self.region.as_ref().is_none_or(|region| region.contains(at));
        inside.then_some(if low < 0.0 { 1.0 } else { -1.0 })
    }

    /// What passed the plane between the centres `before` (m, one per body) and those of now, among the
    /// bodies that are meant.
    pub fn passed(&self, world: &World, before: &[Vec3], selected: &[bool]) -> Passed {
        let mut passed = Passed::default();
        for (body, (&from, &to)) in before.iter().zip(&world.bodies.position).enumerate() {
            if !selected[body] {
                continue;
            }
            for sign in ways(world, from, to).into_iter().filter_map(|[from, to]| self.crossing(from, to)) {
                passed.mass += sign * world.bodies.mass[body];
                passed.bodies += sign as i64;
            }
        }
        passed
    }

    /// The force that what lies above the plane receives through it by contacts, N: of those whose bodies'
    /// centres are on either side (of bodies that cannot move the contact point stands for the centre).
    pub fn force(&self, world: &World, step: f64) -> Vec3 {
        self.force_where(world, step, |_| true)
    }

    /// The same by contacts of two bodies that can both move: what a sample carries itself, without the walls
    /// that hold it.
    pub fn force_in_sample(&self, world: &World, step: f64) -> Vec3 {
        let moves: Vec<bool> = (0..world.bodies.len()).map(|body| world.is_free(body)).collect();
        self.force_where(world, step, |[a, b]| moves[a] && moves[b])
    }

    fn force_where(&self, world: &World, step: f64, counts: impl Fn([usize; 2]) -> bool) -> Vec3 {
        let end = |body: u32, point: Vec3| {
            let body = body as usize;
            if world.is_prescribed(body) { point } else { world.bodies.position[body] }
        };
        let set = &world.contacts;
        let through = set.contacts.iter().zip(&set.impulse).filter_map(|(c, impulse)| {
            if !counts([c.body_a as usize, c.body_b as usize]) {
                return None;
            }
            let (a, b) = (end(c.body_a, c.point), end(c.body_b, c.point));
            let ways = if c.image == [0; 3] { vec![[b, a]] } else { ways(world, b, a) };
            // From B below to A above: the force on A is what goes up.
            Some(
                ways.into_iter()
                    .filter_map(|[b, a]| self.crossing(b, a))
                    .map(|sign| sign / step * *impulse)
                    .sum::<Vec3>(),
            )
        });
        through.sum()
    }
}

/// The way between two places: in a periodic cell the short one, seen from either end where it leads across
/// the boundary.
fn ways(world: &World, from: Vec3, to: Vec3) -> Vec<[Vec3; 2]> {
    let Some(cell) = world.cell() else { return vec![[from, to]] };
    let (n, way) = cell.nearest(to - from);
    if n == [0; 3] { vec![[from, to]] } else { vec![[from, from + way], [to - way, to]] }
}

/// Force (N) and torque about `point` (N m) by contacts with others on some bodies together; with a region
/// only by contacts in it.
pub fn force_on(
    world: &World,
    step: f64,
    bodies: &[BodyId],
    region: Option<&Region>,
    point: Vec3,
) -> (Vec3, Vec3) {
    let mut meant = vec![false; world.bodies.len()];
    bodies.iter().for_each(|body| meant[body.index()] = true);
    let (mut force, mut torque) = (Vec3::ZERO, Vec3::ZERO);
    for (i, (contact, impulse)) in world.contacts.contacts.iter().zip(&world.contacts.impulse).enumerate() {
        let within = meant[contact.body_a as usize] && meant[contact.body_b as usize];
        if within || region.is_some_and(|region| !region.contains(contact.point)) {
            continue;
        }
        for (_, on, f) in ends(contact, *impulse / step).into_iter().filter(|(body, ..)| meant[*body]) {
            force += f;
            torque += (on - point).cross(f);
        }
        if let Some(&moment) = world.contacts.moment.get(i) {
            let sign = if meant[contact.body_a as usize] { 1.0 } else { 0.0 }
                - if meant[contact.body_b as usize] { 1.0 } else { 0.0 };
            torque += sign / step * moment;
        }
    }
    (force, torque)
}

#[cfg(test)]
mod tests {
    use super::super::samples::{chain, row_of_columns};
    use super::super::space::selected;
    use super::*;

    #[test]
    fn bodies_pass_a_plane_and_come_back() {
        let (mut world, _) = chain(3, 0.0);
        let all = selected(&world, None, None);
        let plane = Plane { point: Vec3::new(1.0, 0.0, 0.0), normal: Vec3::X, region: None };
        let before = world.bodies.position.clone();
        let mass = world.bodies.mass[0];
        world.bodies.position[0].x = 1.0;
        world.bodies.position[2].x = 0.9;
        assert_eq!(plane.passed(&world, &before, &all), Passed::default());
        world.bodies.position[2].x = 2.5;
        assert_eq!(plane.passed(&world, &before, &all), Passed { mass, bodies: 1 });
        let back = world.bodies.position.clone();
        world.bodies.position[0].x = 0.5;
        assert_eq!(plane.passed(&world, &back, &all), Passed { mass: -mass, bodies: -1 });
        // Beside the region that is meant.
        let hole = Region::Cylinder { base: Vec3::new(1.0, 2.0, -1.0), radius: 1.0, height: 2.0 };
        let beside = Plane { region: Some(hole), ..plane };
        assert_eq!(beside.passed(&world, &back, &all), Passed::default());
    }

    /// Through every cross-section of a chain goes the same force; the plates take it.
    #[test]
    fn force_through_a_chain() {
        let (world, step) = chain(3, 2.0);
        for x in [0.2, 1.2, 2.7] {
            let plane = Plane { point: Vec3::new(x, 0.0, 0.0), normal: Vec3::X, region: None };
            assert!((plane.force(&world, step) - Vec3::new(2.0, 0.0, 0.0)).length() < 1e-12);
        }
        let plate = BodyId::from_index(3);
        let (force, torque) = force_on(&world, step, &[plate], None, Vec3::new(0.0, 1.0, 0.0));
        assert!((force + Vec3::new(2.0, 0.0, 0.0)).length() < 1e-12, "{force}");
        assert!((torque - Vec3::new(0.0, 0.0, -2.0)).length() < 1e-12, "{torque}");
        // What bodies exert on each other is not on them together.
        let balls: Vec<BodyId> = (0..3).map(BodyId::from_index).collect();
        assert!(force_on(&world, step, &balls, None, Vec3::ZERO).0.length() < 1e-12);
    }

    /// A floor carries the weight; two of four columns stand in the region.
    #[test]
    fn a_floor_carries_the_weight() {
        let (world, step) = row_of_columns(4, 3);
        let floor = [BodyId::from_index(12)];
        let weight = 12.0 * 9.81 * world.bodies.mass[0];
        let (force, _) = force_on(&world, step, &floor, None, Vec3::ZERO);
        assert!((force.z + weight).abs() < 1e-3 * weight, "{force}");
        let half = Region::Box { min: Vec3::splat(-1.0), max: Vec3::new(2.0, 1.0, 1.0) };
        let (force, _) = force_on(&world, step, &floor, Some(&half), Vec3::ZERO);
        assert!((force.z + 0.5 * weight).abs() < 1e-3 * weight, "{force}");
    }
}
