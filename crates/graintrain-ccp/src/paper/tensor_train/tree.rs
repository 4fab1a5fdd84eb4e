//! The binary tree that turns contacts (or bodies) in space into tensor indices.
//!
//! A tree of depth L halves space L times, all nodes of a level along the same axis. A point gets the
//! multi-index (slot in its leaf, L bits), local index first, coarsest halving last, so that its position in
//! the augmented vector is `slot + capacity * leaf` with the coarsest halving as the most significant bit of
//! `leaf`. Slots that hold no point are dummies. (Corona et al. 2019, Algorithm 2 and section 3.3.2.)

use std::collections::HashMap;

/// How the planes of the tree are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Halve the bounding box along x, y, z in turn: leaf numbers are a Morton order. The paper's tree. Empty
    /// space costs dummies. (Axes along which the cloud is flat are left out until the cells are as flat.)
    Uniform,
    /// Halve the number of points of every node, along the axis in which the whole cloud is then longest: at
    /// most one point of difference between leaves, hardly any dummies.
    Balanced,
}

/// A tree, and the slot of every point.
#[derive(Clone, Debug)]
pub struct PointTree {
    depth: usize,
    capacity: usize,
    /// Axis halved at each level, coarsest first.
    axis: Vec<usize>,
    /// Plane of each inner node in heap order: node k has children 2k + 1 (below) and 2k + 2 (above).
    plane: Vec<f64>,
    lower: [f64; 3],
    upper: [f64; 3],
    /// A point may sit this many leaves from its own: balanced leaves have no room for newcomers.
    reach: usize,
    /// Position `slot + capacity * leaf` of each point.
    position: Vec<usize>,
}

/// What [`PointTree::reindex`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reindexed {
    /// Points that kept their slot.
    pub kept: usize,
    /// Persistent points that had to move: they left their leaf.
    pub moved: usize,
    /// New points.
    pub inserted: usize,
    /// Points that are gone; their slots became dummies.
    pub vanished: usize,
}

/// No tree is deeper than this many halvings.
const DEEPEST: usize = 40;

/// A uniform tree's augmented vector is at most this multiple of the number of points: where more halvings
/// would exceed it, the leaves' capacity grows instead. Points that coincide could not be separated by any
/// number of halvings.
const LARGEST_PADDING: usize = 8;

/// A uniform tree does not halve an axis whose extent is less than this part of the longest edge of the
/// cells: points in a plane or on a line would end in one half.
const FLAT: f64 = 0.125;

/// In a balanced tree a newcomer may sit up to this part of all leaves from its own.
const REACH: f64 = 0.25;

/// Points have left the box of a tree where they lie outside by more than this part of its longest edge.
const OUTSIDE: f64 = 0.5;

impl PointTree {
    /// Halves space until every leaf holds at most `capacity` points. Where that takes too many dummies
    /// (points that coincide, much empty space) the tree stops earlier and the leaves' capacity grows to what
    /// they hold.
    ///
    /// # Panics
    /// If there are no points, a coordinate is not finite, or `capacity` is zero.
    pub fn build(points: &[[f64; 3]], capacity: usize, split: Split) -> Self {
        assert!(!points.is_empty() && capacity > 0, "a tree needs points and a capacity");
        assert!(points.iter().flatten().all(|x| x.is_finite()), "points must be finite");
        let mut lower = [f64::INFINITY; 3];
        let mut upper = [f64::NEG_INFINITY; 3];
        for point in points {
            for k in 0..3 {
                lower[k] = lower[k].min(point[k]);
                upper[k] = upper[k].max(point[k]);
            }
        }
        let mut tree = Self {
            depth: 0,
            capacity,
            axis: Vec::new(),
            plane: Vec::new(),
            lower,
            upper,
            reach: 0,
            position: Vec::new(),
        };
        match split {
            Split::Uniform => tree.halve_space(points),
            Split::Balanced => tree.halve_points(points),
        }
        tree
    }

    fn halve_space(&mut self, points: &[[f64; 3]]) {
        let mut leaf = vec![0_usize; points.len()];
        let mut cells = vec![(self.lower, self.upper)];
        // The deepest tree whose padding is bearable, and the capacity that it needs.
        let (mut depth, mut capacity) = (0, points.len());
        loop {
            let mut held = vec![0_usize; cells.len()];
            for &l in &leaf {
                held[l] += 1;
            }
            let fullest = held.iter().copied().max().unwrap_or(0).max(self.capacity);
            if fullest * cells.len() <= LARGEST_PADDING * points.len() {
                (depth, capacity) = (self.depth, fullest);
            }
            let hopeless = cells.len() * self.capacity > LARGEST_PADDING * points.len();
            if fullest == self.capacity || hopeless || self.depth == DEEPEST {
                break;
            }
            let axis = self.next_axis();
            self.axis.push(axis);
            self.depth += 1;
            let mut children = Vec::with_capacity(2 * cells.len());
            for &(low, high) in &cells {
                let plane = 0.5 * (low[axis] + high[axis]);
                self.plane.push(plane);
                let (mut below, mut above) = (high, low);
                below[axis] = plane;
                above[axis] = plane;
                children.extend([(low, below), (above, high)]);
            }
            for (l, point) in leaf.iter_mut().zip(points) {
                let plane = children[2 * *l].1[axis];
                *l = 2 * *l + usize::from(point[axis] >= plane);
            }
            cells = children;
        }
        for l in &mut leaf {
            *l >>= self.depth - depth;
        }
        self.axis.truncate(depth);
        self.plane.truncate((1 << depth) - 1);
        (self.depth, self.capacity) = (depth, capacity);
        self.fill_slots(&leaf);
    }

    /// The axis after the last one, in turn, along which the cloud is not flat; with its edge of the cells
    /// halved at every turn.
    fn next_axis(&self) -> usize {
        let extent: [f64; 3] = std::array::from_fn(|k| self.upper[k] - self.lower[k]);
        let halvings = |k: usize| self.axis.iter().filter(|&&axis| axis == k).count() as i32;
        let longest = (0..3).map(|k| extent[k] * 0.5_f64.powi(halvings(k))).fold(0.0, f64::max);
        let after = self.axis.last().map_or(0, |axis| axis + 1);
        (0..3).map(|k| (after + k) % 3).find(|&k| extent[k] >= FLAT * longest).unwrap_or(after % 3)
    }

    fn halve_points(&mut self, points: &[[f64; 3]]) {
        while points.len() > self.capacity << self.depth && self.depth < DEEPEST {
            self.depth += 1;
        }
        let mut extent: [f64; 3] = std::array::from_fn(|k| self.upper[k] - self.lower[k]);
        let mut members: Vec<usize> = (0..points.len()).collect();
        let mut nodes: Vec<std::ops::Range<usize>> = std::iter::once(0..points.len()).collect();
        for _ in 0..self.depth {
            let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
            extent[axis] *= 0.5;
            self.axis.push(axis);
            let mut children = Vec::with_capacity(2 * nodes.len());
            for node in nodes {
                let half = node.start + node.len().div_ceil(2);
                let slice = &mut members[node.clone()];
                // Ties in a coordinate are settled by the index, so that the tree depends on the points
                // alone.
                slice.sort_unstable_by(|&a, &b| points[a][axis].total_cmp(&points[b][axis]).then(a.cmp(&b)));
                let above = members.get(half).filter(|_| half < node.end).map(|&i| points[i][axis]);
                self.plane.push(above.unwrap_or(f64::INFINITY));
                children.extend([node.start..half, half..node.end]);
            }
            nodes = children;
        }
        self.capacity = nodes.iter().map(ExactSizeIterator::len).max().unwrap_or(1);
        self.reach = (REACH * nodes.len() as f64).ceil() as usize;
        let mut leaf = vec![0; points.len()];
        for (number, node) in nodes.into_iter().enumerate() {
            for &i in &members[node] {
                leaf[i] = number;
            }
        }
        self.fill_slots(&leaf);
    }

    /// Gives the points of each leaf its slots in order of their index.
    fn fill_slots(&mut self, leaf: &[usize]) {
        let mut next = vec![0; 1 << self.depth];
        self.position = leaf
            .iter()
            .map(|&l| {
                next[l] += 1;
                next[l] - 1 + self.capacity * l
            })
            .collect();
    }

    /// Number of halvings L.
    pub fn depth(&self) -> usize {
        self.depth
    }

    /// Points per leaf m.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Length of the augmented vector of slots, m 2^L.
    pub fn num_slots(&self) -> usize {
        self.capacity << self.depth
    }

    /// Position `slot + m leaf` of each point in the augmented vector.
    pub fn positions(&self) -> &[usize] {
        &self.position
    }

    /// Leaf in whose cell the point lies.
    fn leaf_of(&self, point: [f64; 3]) -> usize {
        let mut node = 0;
        for &axis in &self.axis {
            node = 2 * node + 1 + usize::from(point[axis] >= self.plane[node]);
        }
        node + 1 - (1 << self.depth)
    }

    /// Whether the point lies in the leaf's cell widened on each side by a quarter of the mean cell width.
    fn is_near_leaf(&self, point: [f64; 3], leaf: usize) -> bool {
        let mut margin = [0.0; 3];
        for k in 0..3 {
            let halvings = self.axis.iter().filter(|&&axis| axis == k).count();
            margin[k] = 0.25 * (self.upper[k] - self.lower[k]) / f64::powi(2.0, halvings as i32);
        }
        let mut node = 0;
        for (level, &axis) in self.axis.iter().enumerate() {
            let above = leaf >> (self.depth - 1 - level) & 1;
            let distance = point[axis] - self.plane[node];
            let outside = if above == 1 { -distance } else { distance };
            if outside > margin[axis] {
                return false;
            }
            node = 2 * node + 1 + above;
        }
        true
    }

    /// Whether the point may stay in a slot of this leaf: near its cell, or as near in the order of leaves as
    /// a newcomer.
    fn may_sit_in(&self, point: [f64; 3], leaf: usize) -> bool {
        self.is_near_leaf(point, leaf) || self.leaf_of(point).abs_diff(leaf) <= self.reach
    }

    /// The free slot nearest to a leaf in the order of leaves, if there is one within reach; the lower one of
    /// two.
    fn free_slot(&self, leaf: usize, taken: &[bool]) -> Option<usize> {
        (0..=self.reach).find_map(|distance| {
            let near =
                [leaf.checked_sub(distance), Some(leaf + distance).filter(|&leaf| leaf >> self.depth == 0)];
            near.into_iter().flatten().find_map(|leaf| {
                (leaf * self.capacity..(leaf + 1) * self.capacity).find(|&slot| !taken[slot])
            })
        })
    }

    /// Whether the point lies in the box of the tree or not far outside.
    fn is_near_box(&self, point: [f64; 3]) -> bool {
        let longest = (0..3).map(|k| self.upper[k] - self.lower[k]).fold(0.0, f64::max);
        let margin = OUTSIDE * longest;
        (0..3).all(|k| (self.lower[k] - margin..=self.upper[k] + margin).contains(&point[k]))
    }

    /// Carries the slots over to the next time step's points: a point whose identity persists keeps its slot
    /// unless it has left its leaf (beyond a margin of a quarter cell); the others get a free slot of the
    /// leaf they lie in. `previous` are the identities that belong to the present positions.
    ///
    /// In a balanced tree, whose leaves are full, the free slot may be that of a leaf up to a quarter of all
    /// leaves away in their order, which is that of space.
    ///
    /// Returns `None`, and leaves the tree unchanged, where no slot is free or points have left the box by
    /// more than half of its longest edge: then the tree no longer fits and has to be built anew.
    ///
    /// # Panics
    /// If `previous` is not one identity per present position or `identities` not one per point.
    pub fn reindex(
        &mut self,
        previous: &[u64],
        identities: &[u64],
        points: &[[f64; 3]],
    ) -> Option<Reindexed> {
        assert_eq!(previous.len(), self.position.len(), "one identity per position");
        assert_eq!(identities.len(), points.len(), "one identity per point");
        let old: HashMap<u64, usize> = previous.iter().copied().zip(self.position.iter().copied()).collect();
        if points.iter().any(|&point| !self.is_near_box(point)) {
            return None;
        }
        let mut taken = vec![false; self.num_slots()];
        let mut position = vec![usize::MAX; points.len()];
        let mut report = Reindexed::default();
        let mut homeless = Vec::new();
        for (i, (identity, &point)) in identities.iter().zip(points).enumerate() {
            match old.get(identity) {
                Some(&slot) if !taken[slot] && self.may_sit_in(point, slot / self.capacity) => {
                    taken[slot] = true;
                    position[i] = slot;
                    report.kept += 1;
                }
                known => {
                    if known.is_some() {
                        report.moved += 1;
                    } else {
                        report.inserted += 1;
                    }
                    homeless.push(i);
                }
            }
        }
        for i in homeless {
            let slot = self.free_slot(self.leaf_of(points[i]), &taken)?;
            taken[slot] = true;
            position[i] = slot;
        }
        report.vanished = previous.len() - (report.kept + report.moved).min(previous.len());
        self.position = position;
        Some(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delassus::tests::uniform;
    use std::collections::HashSet;

    fn cloud(count: usize, seed: u8) -> Vec<[f64; 3]> {
        let mut random = uniform(seed);
        (0..count).map(|_| [random(), 2.0 * random(), 0.5 * random()]).collect()
    }

    #[test]
    fn every_point_has_its_own_slot_in_both_trees() {
        let points = cloud(1000, 1);
        for split in [Split::Uniform, Split::Balanced] {
            let tree = PointTree::build(&points, 8, split);
            let slots: HashSet<usize> = tree.positions().iter().copied().collect();
            assert_eq!(slots.len(), points.len());
            assert!(slots.iter().all(|&slot| slot < tree.num_slots()));
        }
    }

    #[test]
    fn uniform_leaf_numbers_are_morton_codes_of_the_cell() {
        let points = cloud(500, 2);
        let tree = PointTree::build(&points, 8, Split::Uniform);
        for (point, &position) in points.iter().zip(tree.positions()) {
            let mut leaf = 0;
            let (mut low, mut high) = (tree.lower, tree.upper);
            for level in 0..tree.depth() {
                let middle = 0.5 * (low[level % 3] + high[level % 3]);
                let above = point[level % 3] >= middle;
                if above {
                    low[level % 3] = middle
                } else {
                    high[level % 3] = middle
                }
                leaf = 2 * leaf + usize::from(above);
            }
            assert_eq!(position / tree.capacity(), leaf);
        }
    }

    #[test]
    fn the_balanced_tree_needs_hardly_any_dummies() {
        let points = cloud(1000, 3);
        let tree = PointTree::build(&points, 8, Split::Balanced);
        assert_eq!(tree.depth(), 7);
        assert_eq!(tree.num_slots(), 1024);
    }

    #[test]
    fn coinciding_points_share_a_leaf_of_larger_capacity() {
        let points = vec![[0.25, 0.5, 0.5]; 20];
        for split in [Split::Uniform, Split::Balanced] {
            let tree = PointTree::build(&points, 4, split);
            let slots: HashSet<usize> = tree.positions().iter().copied().collect();
            assert_eq!(slots.len(), 20);
            assert!(tree.num_slots() <= LARGEST_PADDING * 20);
        }
    }

    #[test]
    fn reindexing_keeps_slots_that_persist_and_moves_only_what_left_its_leaf() {
        let mut points = cloud(400, 4);
        let mut tree = PointTree::build(&points, 16, Split::Uniform);
        let previous: Vec<u64> = (0..400).collect();
        let before = tree.positions().to_vec();
        // Points 0..10 vanish, ten new ones come, point 20 travels to the opposite corner, the rest jitter a
        // little.
        for point in &mut points {
            point[0] += 1e-4;
        }
        points[20] = [1.0 - points[20][0], 2.0 - points[20][1], 0.5 - points[20][2]];
        let mut next: Vec<[f64; 3]> = points[10..].to_vec();
        next.extend(cloud(10, 5));
        let identities: Vec<u64> = (10..410).collect();
        let report = tree.reindex(&previous, &identities, &next).expect("the tree still fits");
        assert_eq!(report, Reindexed { kept: 389, moved: 1, inserted: 10, vanished: 10 });
        for i in 0..390 {
            assert_eq!(tree.positions()[i] == before[i + 10], i != 10, "point {i}");
        }
        let slots: HashSet<usize> = tree.positions().iter().copied().collect();
        assert_eq!(slots.len(), 400);
    }

    #[test]
    fn a_tree_does_not_halve_where_there_is_nothing_to_halve() {
        let line: Vec<[f64; 3]> = (0..1000).map(|i| [0.3, 0.01 * f64::from(i), -2.0]).collect();
        let plane: Vec<[f64; 3]> = (0..1024).map(|i| [f64::from(i % 32), 7.0, f64::from(i / 32)]).collect();
        for points in [line, plane] {
            let tree = PointTree::build(&points, 4, Split::Uniform);
            assert_eq!(tree.capacity(), 4);
            assert!(tree.num_slots() <= 2 * points.len(), "{} slots", tree.num_slots());
        }
    }

    #[test]
    fn newcomers_to_a_full_leaf_of_a_balanced_tree_sit_nearby() {
        let mut points = cloud(1000, 7);
        let mut tree = PointTree::build(&points, 1, Split::Balanced);
        let mut previous: Vec<u64> = (0..1000).collect();
        // Every step a tenth of the points is replaced by others nearby; those that stay keep their slots.
        for step in 0..5_u64 {
            let fresh = cloud(100, 8 + step as u8);
            let mut identities = previous.clone();
            for (k, point) in fresh.into_iter().enumerate() {
                let at = (7 * k + step as usize) % 1000;
                points[at] = std::array::from_fn(|d| 0.95 * points[at][d] + 0.05 * point[d]);
                identities[at] = 10_000 * (step + 1) + k as u64;
            }
            let report = tree.reindex(&previous, &identities, &points).expect("there are free slots");
            assert_eq!(report, Reindexed { kept: 900, moved: 0, inserted: 100, vanished: 100 });
            let slots: HashSet<usize> = tree.positions().iter().copied().collect();
            assert_eq!(slots.len(), 1000);
            previous = identities;
        }
        for (point, slot) in points.iter().zip(tree.positions()) {
            assert!(tree.may_sit_in(*point, *slot), "slot {slot}");
        }
    }

    #[test]
    fn points_that_have_left_the_box_ask_for_a_new_tree() {
        let points = cloud(64, 9);
        let identities: Vec<u64> = (0..64).collect();
        let mut tree = PointTree::build(&points, 4, Split::Uniform);
        let shifted = |by: f64| points.iter().map(|p| [p[0], p[1] + by, p[2]]).collect::<Vec<_>>();
        assert!(tree.reindex(&identities, &identities, &shifted(0.01)).is_some());
        assert_eq!(tree.reindex(&identities, &identities, &shifted(3.0)), None);
    }

    #[test]
    fn an_overflowing_leaf_asks_for_a_new_tree() {
        let points = cloud(64, 6);
        let mut tree = PointTree::build(&points, 4, Split::Balanced);
        let previous: Vec<u64> = (0..64).collect();
        let crowd = vec![points[0]; 64];
        let identities: Vec<u64> = (100..164).collect();
        let before = tree.positions().to_vec();
        assert_eq!(tree.reindex(&previous, &identities, &crowd), None);
        assert_eq!(tree.positions(), before);
    }
}
