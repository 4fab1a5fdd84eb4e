//! Random places of a least distance that fill a region (Poisson-disk sampling).

use crate::random::Random;
use graintrain::load::Region;
use graintrain::math::Vec3;
use graintrain_linalg::real;
use std::collections::HashMap;

/// Places tried around a sample before it is given up.
const TRIES: usize = 30;

/// Places tried for the first sample.
const FIRST: usize = 1_000;

/// Centres at least `distance` (m) from each other, of balls of the radius `reach` (m) wholly inside the
/// region: from each sample places between one and two distances away are tried, until none takes another.
/// Expected cost proportional to their number.
///
/// Source: R. Bridson, "Fast Poisson disk sampling in arbitrary dimensions", SIGGRAPH sketches, 2007.
pub(crate) fn positions(region: &Region, distance: f64, reach: f64, random: &mut Random) -> Vec<Vec3> {
    let cell_of = |p: Vec3| (p / distance).floor().as_i64vec3().to_array();
    let mut cells: HashMap<[i64; 3], Vec<Vec3>> = HashMap::new();
    let is_apart = |place: Vec3, cells: &HashMap<[i64; 3], Vec<Vec3>>| {
        let [x, y, z] = cell_of(place);
        let around = (0..27_i64).map(|k| [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1]);
        around
            .filter_map(|[dx, dy, dz]| {
                cells.get(&[x.saturating_add(dx), y.saturating_add(dy), z.saturating_add(dz)])
            })
            .flatten()
            .all(|other| other.distance_squared(place) >= distance * distance)
    };
    let Some(first) = (0..FIRST).find_map(|_| random.place(region, reach)) else { return Vec::new() };
    let mut samples = vec![first];
    cells.entry(cell_of(first)).or_default().push(first);
    let mut active = vec![0];
    while !active.is_empty() {
        let chosen = (random.uniform() * active.len() as f64) as usize;
        let from = samples[active[chosen]];
        let found = (0..TRIES)
            .map(|_| {
                // Uniform in the shell: the volume within a radius grows with its cube.
                let radius = distance * real::cbrt(random.between(1.0, 8.0));
                from + radius * (random.rotation() * Vec3::Z)
            })
            .find(|&place| holds(region, place, reach) && is_apart(place, &cells));
        match found {
            None => {
                active.swap_remove(chosen);
            }
            Some(place) => {
                cells.entry(cell_of(place)).or_default().push(place);
                active.push(samples.len());
                samples.push(place);
            }
        }
    }
    samples
}

/// Whether a ball lies wholly inside a region.
fn holds(region: &Region, centre: Vec3, radius: f64) -> bool {
    match *region {
        Region::Box { min, max } => centre.cmpge(min + radius).all() && centre.cmple(max - radius).all(),
        Region::Cylinder { base, radius: outer, height } => {
            let d = centre - base;
            real::hypot(d.x, d.y) <= outer - radius && (radius..=height - radius).contains(&d.z)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pair is far enough apart, and no place of a fine grid is left that would take another sample
    /// with room to spare.
    #[test]
    fn samples_keep_their_distance_and_leave_no_hole() {
        for region in [
            Region::Box { min: Vec3::ZERO, max: Vec3::new(1.0, 0.8, 0.6) },
            Region::Cylinder { base: Vec3::new(1.0, 0.0, -1.0), radius: 0.5, height: 0.7 },
        ] {
            let (distance, reach) = (0.1, 0.05);
            let samples = positions(&region, distance, reach, &mut Random::new(5));
            for (k, a) in samples.iter().enumerate() {
                assert!(holds(&region, *a, reach));
                assert!(samples[..k].iter().all(|b| a.distance(*b) >= distance));
            }
            let steps = |k: usize| -1.0 + 0.05 * k as f64;
            let grid = (0..64_000).map(|k| Vec3::new(steps(k % 40), steps(k / 40 % 40), steps(k / 1600)));
            let hole = |place: &Vec3| {
                holds(&region, *place, reach) && samples.iter().all(|s| s.distance(*place) > 1.3 * distance)
            };
            assert_eq!(grid.filter(hole).count(), 0);
        }
    }
}
