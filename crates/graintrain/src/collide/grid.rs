//! Uniform cell list: which bodies of similar size are near a point.

use crate::math::Vec3;
use std::ops::Range;

/// Cells per body, at most: bounds the memory where bodies are far apart.
const CELLS_PER_BODY: usize = 4;

/// Bodies sorted into cubic cells. Cell coordinates are taken modulo the grid's dimensions, so that a body
/// that flew far away costs a few idle tests instead of an enormous grid.
pub(crate) struct Grid {
    origin: Vec3,
    inverse_size: f64,
    /// Cells along each axis: powers of two.
    dimensions: [usize; 3],
    /// Cell c holds the entries `start[c]..start[c + 1]`.
    start: Vec<u32>,
    /// Index of the body in the caller's numbering, ascending within a cell.
    pub body: Vec<u32>,
    /// Centres, in the order of `body`.
    pub centre: Vec<Vec3>,
    /// Radii, in the order of `body`.
    pub radius: Vec<f64>,
}

/// Cells that are told apart along an axis at most: more are beyond any limit on all of them.
const ALONG_AXIS: f64 = 1_048_576.0;

/// By how much of itself, and of the distance from the origin, a way is taken longer, so that rounding in
/// cell coordinates loses no pair.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

impl Grid {
    /// Sorts balls, given as (index, centre, radius), into cells of edge `size`. Cost: linear.
    pub(crate) fn new(balls: &[(u32, Vec3, f64)], size: f64) -> Self {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &(_, centre, _) in balls {
            low = low.min(centre);
            high = high.max(centre);
        }
        if balls.is_empty() {
            (low, high) = (Vec3::ZERO, Vec3::ZERO);
        }
        let extent = (high - low) / size;
        let limit = (CELLS_PER_BODY * balls.len()).max(64);
        let mut dimensions =
            extent.to_array().map(|cells| (cells.clamp(0.0, ALONG_AXIS) as usize + 1).next_power_of_two());
        while dimensions.iter().product::<usize>() > limit {
            let largest = (0..3).max_by_key(|&k| dimensions[k]).unwrap_or(0);
            dimensions[largest] /= 2;
        }
        let mut grid = Self {
            origin: low,
            inverse_size: 1.0 / size,
            dimensions,
            start: vec![0; dimensions.iter().product::<usize>() + 1],
            body: vec![0; balls.len()],
            centre: vec![Vec3::ZERO; balls.len()],
            radius: vec![0.0; balls.len()],
        };
        let cells: Vec<u32> = balls.iter().map(|ball| grid.cell(ball.1) as u32).collect();
        for &cell in &cells {
            grid.start[cell as usize + 1] += 1;
        }
        for cell in 1..grid.start.len() {
            grid.start[cell] += grid.start[cell - 1];
        }
        let mut next = grid.start.clone();
        for (&cell, &(body, centre, radius)) in cells.iter().zip(balls) {
            let slot = next[cell as usize] as usize;
            next[cell as usize] += 1;
            grid.body[slot] = body;
            grid.centre[slot] = centre;
            grid.radius[slot] = radius;
        }
        grid
    }

    /// The cell of a point. The cast saturates; two's complement makes the mask a true modulus of negative
    /// numbers too.
    fn cell(&self, p: Vec3) -> usize {
        let scaled = ((p - self.origin) * self.inverse_size).floor().to_array();
        let [x, y, z] = std::array::from_fn(|k| scaled[k] as i64 as usize & (self.dimensions[k] - 1));
        (z * self.dimensions[1] + y) * self.dimensions[0] + x
    }

    /// Calls `visit` with ranges of entries that together hold every ball whose centre is at most `reach`
    /// from `p`, each entry once.
    #[inline]
    pub(crate) fn around(&self, p: Vec3, reach: f64, mut visit: impl FnMut(Range<usize>)) {
        let scaled = (p - self.origin) * self.inverse_size;
        let way = (1.0 + ROUNDING) * (reach * self.inverse_size) + ROUNDING * scaled.abs();
        let (low, high) = ((scaled - way).floor().to_array(), (scaled + way).floor().to_array());
        // The first coordinate along each axis and how many follow, all of them at most.
        let [(x, count_x), (y, count_y), (z, count_z)] = std::array::from_fn(|k| {
            let (low, high, cells) = (low[k] as i64, high[k] as i64, self.dimensions[k]);
            let count = (high.saturating_sub(low) as usize).saturating_add(1).min(cells);
            (low as usize & (cells - 1), count)
        });
        let [nx, ny, nz] = self.dimensions;
        for dz in 0..count_z {
            for dy in 0..count_y {
                let row = nx * (((z + dz) & (nz - 1)) * ny + ((y + dy) & (ny - 1)));
                // The cells of a row are consecutive, those beyond its end are the first.
                let end = (x + count_x).min(nx);
                visit(self.start[row + x] as usize..self.start[row + end] as usize);
                if x + count_x > nx {
                    visit(self.start[row] as usize..self.start[row + x + count_x - nx] as usize);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Against all pairs, with bodies spread unevenly and a few flown far away.
        #[test]
        fn finds_every_near_pair_once(
            points in prop::collection::vec((prop::array::uniform3(-3.0..3.0_f64), 0..40_u32), 1..120),
            size in 0.1..1.5_f64,
            reach in 0.1..1.5_f64,
        ) {
            let balls: Vec<(u32, Vec3, f64)> = points
                .iter()
                .enumerate()
                .map(|(i, (p, far))| {
                    let flown = if *far == 0 { Vec3::new(1e7, -3e5, 2e9) } else { Vec3::ZERO };
                    (i as u32, Vec3::from_array(*p) + flown, 0.1)
                })
                .collect();
            let grid = Grid::new(&balls, size);
            for &(_, p, _) in &balls {
                let mut seen = Vec::new();
                grid.around(p, reach, |range| seen.extend(range.map(|slot| grid.body[slot])));
                let visited = seen.len();
                seen.sort_unstable();
                seen.dedup();
                prop_assert_eq!(visited, seen.len());
                for &(other, q, _) in &balls {
                    if (p - q).length() <= reach {
                        prop_assert!(seen.contains(&other));
                    }
                }
            }
        }
    }
}
