//! How well two kinds of bodies are mixed.

use crate::math::Vec3;
use crate::world::World;
use std::collections::BTreeMap;

/// Lacey's index of mixing by number in cubic cells:
///
/// ```text
/// M = (s0^2 - s^2) / (s0^2 - sr^2),   s0^2 = p (1 - p),   sr^2 = p (1 - p) / n
/// ```
///
/// with the share p of the first kind, the variance s^2 of the share in cells (weighted by their numbers of
/// bodies) and the mean number n of bodies per cell (P. M. C. Lacey, J. Appl. Chem. 4, 1954). 0: apart; 1:
/// mixed at random.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixing {
    /// The index; NaN where there are not two kinds, or one body per cell.
    pub index: f64,
    /// Share of the first kind.
    pub share: f64,
    /// Cells with a body.
    pub cells: usize,
    /// Bodies per cell.
    pub bodies_per_cell: f64,
}

/// The index of the bodies that are meant; `first` says which are of the first kind. Cells of the edge `cell`
/// (m) are counted from the origin.
pub fn lacey(world: &World, selected: &[bool], first: &[bool], cell: f64) -> Mixing {
    let mut cells: BTreeMap<[i64; 3], (u64, u64)> = BTreeMap::new();
    for (body, place) in world.bodies.position.iter().enumerate().filter(|(body, _)| selected[*body]) {
        let key = (*place / cell).map(f64::floor).to_array().map(|x| x as i64);
        let entry = cells.entry(key).or_default();
        entry.0 += 1;
        entry.1 += u64::from(first[body]);
    }
    let (all, ones) = cells.values().fold((0, 0), |(a, b), (n, k)| (a + n, b + k));
    let n = all as f64;
    let share = ones as f64 / n;
    let variance: f64 = cells
        .values()
        .map(|&(count, ones)| count as f64 / n * (ones as f64 / count as f64 - share).powi(2))
        .sum();
    let bodies_per_cell = n / cells.len() as f64;
    let apart = share * (1.0 - share);
    let index = (apart - variance) / (apart - apart / bodies_per_cell);
    let index = if apart > 0.0 && bodies_per_cell > 1.0 { index } else { f64::NAN };
    Mixing { index, share, cells: cells.len(), bodies_per_cell }
}

/// Per body whether it is one of these.
pub fn among(world: &World, bodies: &[crate::handle::BodyId]) -> Vec<bool> {
    let mut list = vec![false; world.bodies.len()];
    for body in bodies {
        if let Some(entry) = list.get_mut(body.index()) {
            *entry = true;
        }
    }
    list
}

/// Mean place by mass of the bodies that are meant, m; `None` where there are none.
pub fn centre_of_mass(world: &World, selected: &[bool]) -> Option<Vec3> {
    let (mut sum, mut mass) = (Vec3::ZERO, 0.0);
    for body in (0..world.bodies.len()).filter(|&body| selected[body]) {
        sum += world.bodies.mass[body] * world.bodies.position[body];
        mass += world.bodies.mass[body];
    }
    (mass > 0.0).then(|| sum / mass)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handle::{BodyId, MaterialId};
    use crate::shape::Geometry;
    use crate::world::Body;

    /// Cells of eight bodies: all of one kind (0), half and half in each (the variance is 0, so 1 / (1 -
    /// 1/8)), and three to one by hand.
    #[test]
    fn apart_and_mixed() {
        let mut world = World::default();
        let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
        for i in 0..16 {
            let place = Vec3::new(
                0.25 + 0.5 * f64::from(i % 4),
                0.25 + 0.5 * f64::from(i / 4 % 2),
                0.25 + 0.5 * f64::from(i / 8),
            );
            world.add_body(Body::new(ball, MaterialId::default(), place)).unwrap();
        }
        let all = vec![true; 16];
        let by = |is_first: fn(f64) -> bool| -> Vec<bool> {
            world.bodies.position.iter().map(|p| is_first(p.x)).collect()
        };
        let apart = lacey(&world, &all, &by(|x| x < 1.0), 1.0);
        assert_eq!((apart.index, apart.share, apart.cells, apart.bodies_per_cell), (0.0, 0.5, 2, 8.0));
        let even = lacey(&world, &all, &by(|x| x % 1.0 < 0.5), 1.0);
        assert!((even.index - 8.0 / 7.0).abs() < 1e-12);
        // Six of eight in one cell, two of eight in the other: s^2 = 1/16, so (1/4 - 1/16) / (1/4 - 1/32).
        let first: Vec<BodyId> = [0, 1, 4, 5, 8, 9, 2, 6].map(BodyId::from_index).to_vec();
        let found = lacey(&world, &all, &among(&world, &first), 1.0);
        assert!((found.index - (0.1875 / 0.21875)).abs() < 1e-12, "{found:?}");
        assert!(lacey(&world, &all, &[true; 16], 1.0).index.is_nan());
        assert!((centre_of_mass(&world, &all).unwrap() - Vec3::new(1.0, 0.5, 0.5)).length() < 1e-12);
    }
}
