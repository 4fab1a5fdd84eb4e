//! Rows and bodies in regions that threads may sweep over at the same time.
//!
//! Bodies are layered by their distance in the contact graph from a first one, and consecutive layers make a
//! slab, so that a contact joins bodies of one slab or of two neighbours. A sweep goes over the contacts
//! within all slabs, then over those between slabs 0 and 1, 2 and 3, and so on, then over those between 1 and
//! 2, 3 and 4: within each of these three phases no two regions share a body. All that touches one large
//! movable body is one layer away from it: under a free plate there is little to share.

use graintrain_ccp::FIXED;
use std::ops::Range;

/// Fewer contacts make one slab.
const FEW: usize = 2048;

/// A slab is closed once it has so many bodies.
const SLAB: usize = 512;

/// Rows and bodies that belong together while a phase lasts.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Region {
    rows: Range<usize>,
    bodies: Range<usize>,
}

/// An order of rows and bodies, and the regions that they make.
pub(super) struct Division {
    /// The body at every place; [`FIXED`] at the last place of every slab, which stands for what does not
    /// move.
    pub bodies: Vec<u32>,
    /// The row at every place, and the places of its bodies A and B counted from the first of its region.
    pub rows: Vec<(u32, [u32; 2])>,
    /// Regions by phase, ascending in rows and bodies.
    pub phases: Vec<Vec<Region>>,
}

impl Division {
    /// Of rows between these pairs of bodies ([`FIXED`] or below `count`). Cost: linear.
    pub(super) fn new(pairs: &[[u32; 2]], count: usize) -> Self {
        let (own, known) = numbered(pairs, count);
        let local = |body: u32| if body == FIXED { None } else { Some(own[body as usize] as usize) };
        let slab_of = slabs(pairs, known.len(), local);
        let slabs = 1 + slab_of.iter().max().map_or(0, |&last| last as usize);
        // Places of bodies: slab by slab, one place more in each.
        let mut start = vec![0; slabs + 1];
        for &slab in &slab_of {
            start[slab as usize + 1] += 1;
        }
        for slab in 0..slabs {
            start[slab + 1] += start[slab] + 1;
        }
        let mut bodies = vec![FIXED; start[slabs]];
        let mut place = vec![0; known.len()];
        let mut next = start.clone();
        for (k, (&body, &slab)) in known.iter().zip(&slab_of).enumerate() {
            let slot = &mut next[slab as usize];
            (bodies[*slot], place[k]) = (body, *slot);
            *slot += 1;
        }
        // Regions: the slabs, then what is between 2 k and 2 k + 1, then between 2 k + 1 and 2 k + 2.
        let between = |slab: usize| slabs + slab / 2 + if slab.is_multiple_of(2) { 0 } else { slabs / 2 };
        let region_of = |pair: &[u32; 2]| {
            let [a, b] = pair.map(|body| local(body).map(|k| slab_of[k] as usize));
            match (a, b) {
                (Some(a), Some(b)) if a != b => (between(a.min(b)), a.min(b)),
                (a, b) => {
                    let slab = a.or(b).unwrap_or(0);
                    (slab, slab)
                }
            }
        };
        let regions = 2 * slabs - 1;
        let mut row_start = vec![0; regions + 1];
        for pair in pairs {
            row_start[region_of(pair).0 + 1] += 1;
        }
        for region in 0..regions {
            row_start[region + 1] += row_start[region];
        }
        let mut rows = vec![(0, [0; 2]); pairs.len()];
        let mut next = row_start.clone();
        for (k, pair) in (0..).zip(pairs) {
            let (region, slab) = region_of(pair);
            let places = pair.map(|body| local(body).map_or(start[slab + 1] - 1, |k| place[k]) - start[slab]);
            rows[next[region]] = (k, places.map(|place| place as u32));
            next[region] += 1;
        }
        let region = |index: usize, slabs: Range<usize>| Region {
            rows: row_start[index]..row_start[index + 1],
            bodies: start[slabs.start]..start[slabs.end],
        };
        let mut phases = vec![(0..slabs).map(|slab| region(slab, slab..slab + 1)).collect()];
        for first in 0..2 {
            let pairs = (first..slabs.saturating_sub(1)).step_by(2);
            let of_pairs: Vec<Region> = pairs.map(|slab| region(between(slab), slab..slab + 2)).collect();
            phases.extend((!of_pairs.is_empty()).then_some(of_pairs));
        }
        Self { bodies, rows, phases }
    }
}

/// Numbers of the bodies that occur, in the order of their first contacts (`u32::MAX` for others), and the
/// bodies in this order.
fn numbered(pairs: &[[u32; 2]], count: usize) -> (Vec<u32>, Vec<u32>) {
    let (mut number, mut known) = (vec![u32::MAX; count], Vec::new());
    for &body in pairs.as_flattened().iter().filter(|&&body| body != FIXED) {
        let own = &mut number[body as usize];
        if *own == u32::MAX {
            *own = known.len() as u32;
            known.push(body);
        }
    }
    (number, known)
}

/// The slab of every body.
fn slabs(pairs: &[[u32; 2]], count: usize, local: impl Fn(u32) -> Option<usize>) -> Vec<u32> {
    let mut slab_of = vec![0; count];
    if pairs.len() < FEW {
        return slab_of;
    }
    let both = |pair: &[u32; 2]| Some([local(pair[0])?, local(pair[1])?]);
    let mut start = vec![0_usize; count + 1];
    for body in pairs.iter().filter_map(both).flatten() {
        start[body + 1] += 1;
    }
    for body in 0..count {
        start[body + 1] += start[body];
    }
    let (mut neighbours, mut next) = (vec![0; start[count]], start.clone());
    for [a, b] in pairs.iter().filter_map(both) {
        for (own, other) in [(a, b), (b, a)] {
            neighbours[next[own]] = other;
            next[own] += 1;
        }
    }
    let mut is_met = vec![false; count];
    let mut queue = Vec::with_capacity(count);
    let (mut slab, mut first_of_slab, mut done) = (0, 0, 0);
    for seed in 0..count {
        if !is_met[seed] {
            is_met[seed] = true;
            queue.push(seed);
        }
        while done < queue.len() {
            let layer = done..queue.len();
            done = layer.end;
            for k in layer {
                let body = queue[k];
                slab_of[body] = slab;
                for &other in &neighbours[start[body]..start[body + 1]] {
                    if !is_met[other] {
                        is_met[other] = true;
                        queue.push(other);
                    }
                }
            }
            if done - first_of_slab >= SLAB && done < count {
                (slab, first_of_slab) = (slab + 1, done);
            }
        }
    }
    slab_of
}

/// The rows and bodies of every region of a phase.
pub(super) fn split<'a, R, B>(
    phase: &[Region],
    mut rows: &'a mut [R],
    mut bodies: &'a mut [B],
) -> Vec<(&'a mut [R], &'a mut [B])> {
    let (mut rows_before, mut bodies_before) = (0, 0);
    let mut parts = Vec::with_capacity(phase.len());
    for region in phase {
        let own_rows = &mut rows[region.rows.start - rows_before..];
        let own_bodies = &mut bodies[region.bodies.start - bodies_before..];
        let (own_rows, later_rows) = own_rows.split_at_mut(region.rows.len());
        let (own_bodies, later_bodies) = own_bodies.split_at_mut(region.bodies.len());
        parts.push((own_rows, own_bodies));
        (rows, bodies) = (later_rows, later_bodies);
        (rows_before, bodies_before) = (region.rows.end, region.bodies.end);
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Every row is there once with its own bodies, and within a phase no body is in two regions. The
        /// graph: a ribbon so long that it makes slabs, with some loose and some fixed ends.
        #[test]
        fn regions_of_a_phase_share_no_body(
            ends in prop::collection::vec((0..3000_u32, 1..40_u32, 0..20_u32), 0..6000),
        ) {
            let pairs: Vec<[u32; 2]> = ends
                .iter()
                .map(|&(a, way, kind)| [a, if kind == 0 { FIXED } else { (a + way) % 3040 }])
                .collect();
            let division = Division::new(&pairs, 3040);
            let mut seen = vec![0; pairs.len()];
            for phase in &division.phases {
                let mut end = 0;
                for region in phase {
                    prop_assert!(region.bodies.start >= end);
                    end = region.bodies.end;
                    let bodies = &division.bodies[region.bodies.clone()];
                    for &(row, places) in &division.rows[region.rows.clone()] {
                        seen[row as usize] += 1;
                        prop_assert_eq!(places.map(|place| bodies[place as usize]), pairs[row as usize]);
                    }
                }
            }
            prop_assert!(seen.iter().all(|&seen| seen == 1));
            if pairs.len() >= FEW {
                prop_assert!(division.phases[0].len() > 1);
            }
        }
    }
}
