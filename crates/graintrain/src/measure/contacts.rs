//! Contacts that carry force: how many per body, how many slide, where they point, how forces are
//! distributed.

use crate::contact::Contact;
use crate::math::{Mat3, Vec3};
use crate::moments::outer;
use crate::shape::Shape;
use crate::world::World;
use std::collections::HashSet;

/// Contacts count as loaded above this fraction of the mean normal impulse.
const LOADED: f64 = 1e-6;

/// Part of the largest admissible tangential force above which a contact counts as sliding: the solver
/// reaches the surface of the cone only to its tolerance.
const SLIDING: f64 = 0.999;

/// Both bodies of a contact, where the force acts on each, and the force on each, given that on A.
pub(crate) fn ends(contact: &Contact, force: Vec3) -> [(usize, Vec3, Vec3); 2] {
    let [on_a, on_b] = contact.surface_points();
    [(contact.body_a as usize, on_a, force), (contact.body_b as usize, on_b, -force)]
}

/// Per contact whether it carries force: a normal impulse above a millionth of the mean.
pub fn loaded(world: &World) -> Vec<bool> {
    let set = &world.contacts;
    let normal: Vec<f64> = set.contacts.iter().zip(&set.impulse).map(|(c, g)| c.normal.dot(*g)).collect();
    let threshold = LOADED * normal.iter().sum::<f64>() / normal.len().max(1) as f64;
    normal.into_iter().map(|g| g > threshold.max(0.0)).collect()
}

/// Whether a force with this normal and tangential part uses up the friction.
pub fn is_sliding(normal: f64, tangential: f64, friction: f64) -> bool {
    normal > 0.0 && tangential >= SLIDING * friction * normal
}

/// Normal and tangential part of an impulse at a contact.
pub fn normal_and_tangential(contact: &Contact, impulse: Vec3) -> (f64, f64) {
    let normal = contact.normal.dot(impulse);
    (normal, (impulse - normal * contact.normal).length())
}

/// Loaded contacts of the bodies that are meant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coordination {
    /// Bodies that are meant.
    pub bodies: usize,
    /// Loaded contacts of which at least one body is meant.
    pub contacts: usize,
    /// Neighbours per body: pairs in loaded contact, however many points they touch in.
    pub mean: f64,
    /// Bodies that are held by fewer than the least number of others, and those that this leaves so.
    pub rattlers: usize,
    /// Neighbours per body that is no rattler, counted among such bodies and walls.
    pub mean_without_rattlers: f64,
    /// Share of the loaded contacts whose friction is used up.
    pub sliding: f64,
    /// Components of loaded contact forces less equations of motion of the bodies that are no rattlers (a
    /// sliding contact has one component, others three; balls without friction have three equations; moments
    /// of rolling friction are not counted): above zero forces are not unique. In a part of a packing
    /// contacts with what is outside count whole.
    pub hyperstaticity: i64,
}

/// Coordination of the bodies that are meant. A rattler has fewer than `least` neighbours that hold it (4
/// where there is no friction, 2 with it: one contact holds nothing), found again until nothing changes.
pub fn coordination(world: &World, selected: &[bool], least: usize) -> Coordination {
    let set = &world.contacts;
    let loaded = loaded(world);
    let count = world.bodies.len();
    let mut pairs: HashSet<[usize; 2]> = HashSet::new();
    let mut neighbours: Vec<Vec<usize>> = vec![Vec::new(); count];
    let of = |c: &Contact| [c.body_a as usize, c.body_b as usize];
    for (contact, _) in set.contacts.iter().zip(&loaded).filter(|(_, loaded)| **loaded) {
        let [a, b] = of(contact);
        if pairs.insert([a.min(b), a.max(b)]) {
            neighbours[a].push(b);
            neighbours[b].push(a);
        }
    }
    // All bodies that can move may be rattlers, also those next to the ones that are meant.
    let movable: Vec<bool> = (0..count).map(|body| !world.is_prescribed(body)).collect();
    let mut held = vec![true; count];
    let mut degree: Vec<usize> = neighbours.iter().map(Vec::len).collect();
    let mut queue: Vec<usize> = (0..count).filter(|&b| movable[b] && degree[b] < least).collect();
    queue.iter().for_each(|&b| held[b] = false);
    while let Some(body) = queue.pop() {
        for &other in &neighbours[body] {
            degree[other] -= 1;
            if movable[other] && held[other] && degree[other] < least {
                held[other] = false;
                queue.push(other);
            }
        }
    }
    let bodies = selected.iter().filter(|meant| **meant).count();
    let (mut contacts, mut sliding, mut unknowns) = (0, 0, 0_i64);
    // Normal forces alone turn no ball: without friction its equations of rotation say nothing.
    let is_ball = |body: usize| {
        let parts = &world.geometries[world.bodies.geometry[body].index()].parts;
        matches!(parts.as_slice(), [part] if matches!(part.shape, Shape::Sphere(_)))
    };
    let mut turns: Vec<bool> = (0..count).map(|body| !is_ball(body)).collect();
    for (i, contact) in set.contacts.iter().enumerate().filter(|(i, _)| loaded[*i]) {
        let [a, b] = of(contact);
        if selected[a] || selected[b] {
            let (normal, tangential) = normal_and_tangential(contact, set.impulse[i]);
            let slides = set.friction[i] == 0.0 || is_sliding(normal, tangential, set.friction[i]);
            contacts += 1;
            sliding += usize::from(slides);
            if set.friction[i] > 0.0 {
                (turns[a], turns[b]) = (true, true);
            }
            if held[a] && held[b] {
                unknowns += if slides { 1 } else { 3 };
            }
        }
    }
    let mean = |sum: usize, of: usize| if of == 0 { 0.0 } else { sum as f64 / of as f64 };
    let kept: Vec<usize> = (0..count).filter(|&b| selected[b] && held[b]).collect();
    let equation = |&body: &usize| {
        let counted = if turns[body] { 6 } else { 3 };
        world.free_degrees(body)[..counted].iter().filter(|free| **free).count() as i64
    };
    Coordination {
        bodies,
        contacts,
        mean: mean((0..count).filter(|&b| selected[b]).map(|b| neighbours[b].len()).sum(), bodies),
        rattlers: bodies - kept.len(),
        mean_without_rattlers: mean(kept.iter().map(|&b| degree[b]).sum(), kept.len()),
        sliding: mean(sliding, contacts),
        hyperstaticity: unknowns - kept.iter().map(equation).sum::<i64>(),
    }
}

/// The fabric tensor: the mean of n n^T over the loaded contacts of the bodies that are meant; NaN where
/// there are none.
pub fn fabric(world: &World, selected: &[bool]) -> Mat3 {
    let loaded = loaded(world);
    let chosen = |c: &Contact| selected[c.body_a as usize] || selected[c.body_b as usize];
    let meant = world.contacts.contacts.iter().zip(&loaded).filter(|(c, loaded)| **loaded && chosen(c));
    let (sum, count) =
        meant.fold((Mat3::ZERO, 0_u32), |(sum, count), (c, _)| (sum + outer(c.normal, c.normal), count + 1));
    // 0 * inf: the mean of nothing is none.
    sum * (1.0 / f64::from(count))
}

/// The invariant sqrt(3/2 A:A) of A = 15/2 (F - 1/3): amplitude of the second-order distribution of contact
/// normals (Kanatani 1984); zero where they point everywhere alike.
pub fn anisotropy(fabric: &Mat3) -> f64 {
    let a = (*fabric - Mat3::from_diagonal(Vec3::splat(1.0 / 3.0))) * 7.5;
    (1.5 * a.to_cols_array().iter().map(|x| x * x).sum::<f64>()).sqrt()
}

/// Normal forces of the loaded contacts of the bodies that are meant, N, in the order of the contacts.
pub fn normal_forces(world: &World, step: f64, selected: &[bool]) -> Vec<f64> {
    let set = &world.contacts;
    let loaded = loaded(world);
    let all = set.contacts.iter().zip(&set.impulse).zip(loaded);
    let meant = all
        .filter(|((c, _), loaded)| *loaded && (selected[c.body_a as usize] || selected[c.body_b as usize]));
    meant.map(|((c, g), _)| c.normal.dot(*g) / step).collect()
}

/// How forces are distributed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceStatistics {
    /// How many.
    pub count: usize,
    /// N
    pub mean: f64,
    /// Standard deviation, N.
    pub deviation: f64,
    /// N
    pub max: f64,
    /// Share of the contacts with more than the mean: the strong network.
    pub strong: f64,
    /// (sum f)^2 / (n sum f^2): 1 where all forces are equal, 1/n where one carries all.
    pub participation: f64,
}

/// How these forces are distributed; zeros where there are none.
pub fn force_statistics(forces: &[f64]) -> ForceStatistics {
    let count = forces.len();
    if count == 0 {
        return ForceStatistics::default();
    }
    let n = count as f64;
    let (sum, squares) = forces.iter().fold((0.0, 0.0), |(s, q), f| (s + f, q + f * f));
    let mean = sum / n;
    ForceStatistics {
        count,
        mean,
        deviation: (forces.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / n).sqrt(),
        max: forces.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        strong: forces.iter().filter(|f| **f > mean).count() as f64 / n,
        participation: sum * sum / (n * squares),
    }
}

/// Probability density of f / mean(f) in equal bins from 0 to `most`; what lies above is left out, so that
/// the densities times the width sum to the share below.
pub fn force_histogram(forces: &[f64], bins: usize, most: f64) -> Vec<f64> {
    let mean = force_statistics(forces).mean;
    let (mut density, width) = (vec![0.0; bins], most / bins as f64);
    for f in forces {
        let bin = (f / mean / width) as usize;
        if let Some(entry) = density.get_mut(bin) {
            *entry += 1.0 / (forces.len() as f64 * width);
        }
    }
    density
}

#[cfg(test)]
mod tests {
    use super::super::samples::{chain, row_of_columns};
    use super::super::space::selected;
    use super::*;

    /// Three balls between two plates: every ball has two neighbours; with four asked for all are rattlers.
    #[test]
    fn coordination_of_a_chain() {
        let (world, _) = chain(3, 2.0);
        let all = selected(&world, None, None);
        let found = coordination(&world, &all, 2);
        assert_eq!((found.bodies, found.contacts, found.rattlers), (3, 4, 0));
        assert_eq!((found.mean, found.mean_without_rattlers, found.sliding), (2.0, 2.0, 0.0));
        // Four sticking contacts hold three components each; three balls have six equations each.
        assert_eq!(found.hyperstaticity, 12 - 18);
        // Without friction four normal forces, and three equations each.
        let mut smooth = world.clone();
        smooth.contacts.friction = vec![0.0; 4];
        assert_eq!(coordination(&smooth, &all, 2).hyperstaticity, 4 - 9);
        let none = coordination(&world, &all, 4);
        assert_eq!((none.rattlers, none.mean_without_rattlers), (3, 0.0));
    }

    /// The top ball of a column on a floor has one neighbour: without it the next one has one, and so on.
    #[test]
    fn rattlers_are_found_again_and_again() {
        let (world, _) = row_of_columns(4, 3);
        let all = selected(&world, None, None);
        let found = coordination(&world, &all, 2);
        assert_eq!((found.bodies, found.contacts, found.rattlers), (12, 12, 12));
        assert_eq!(found.mean, (2.0 + 2.0 + 1.0) / 3.0);
        assert_eq!(coordination(&world, &all, 1).rattlers, 0);
        let fabric = fabric(&world, &all);
        assert!((fabric - Mat3::from_diagonal(Vec3::Z)).to_cols_array().iter().all(|x| x.abs() < 1e-12));
        assert!((anisotropy(&fabric) - 7.5).abs() < 1e-9);
        assert_eq!(anisotropy(&Mat3::from_diagonal(Vec3::splat(1.0 / 3.0))), 0.0);
    }

    #[test]
    fn sliding_contacts_are_at_the_cone() {
        let (mut world, step) = chain(1, 2.0);
        world.contacts.friction = vec![0.5, 0.5];
        world.contacts.impulse[0] =
            step * Vec3::new(2.0, 1.0, 0.0).abs() * world.contacts.contacts[0].normal.x.signum();
        let all = selected(&world, None, None);
        assert_eq!(coordination(&world, &all, 2).sliding, 0.5);
    }

    /// Forces 1, 2, 3, 6: mean 3, one above it, (12)^2 / (4 x 50).
    #[test]
    fn distribution_of_four_forces() {
        let found = force_statistics(&[1.0, 2.0, 3.0, 6.0]);
        assert_eq!((found.count, found.mean, found.max, found.strong), (4, 3.0, 6.0, 0.25));
        assert!((found.participation - 144.0 / 200.0).abs() < 1e-15);
        assert!((found.deviation - 3.5_f64.sqrt()).abs() < 1e-15);
        assert_eq!(force_histogram(&[1.0, 2.0, 3.0, 6.0], 2, 2.0), [0.5, 0.25]);
        assert_eq!(force_statistics(&[]), ForceStatistics::default());
    }
}
