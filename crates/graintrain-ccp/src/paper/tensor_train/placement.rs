//! Slots of contacts or bodies in an index tree, carried from one time step to the next.

use super::tree::{PointTree, Reindexed, Split};
use std::collections::BTreeMap;

/// A tree that lives as long as it fits.
pub struct Placement {
    capacity: usize,
    split: Split,
    tree: Option<PointTree>,
    identities: Vec<u64>,
    last: Reindexed,
}

impl Placement {
    /// Nothing is placed yet; leaves will hold up to `capacity` points.
    pub fn new(capacity: usize, split: Split) -> Self {
        Self { capacity, split, tree: None, identities: Vec::new(), last: Reindexed::default() }
    }

    /// Places the points of a new problem. Points whose identity persists keep their slots where the tree
    /// still fits; else, and where there are no identities, a new tree is built. True where slots were
    /// carried over.
    pub fn update(&mut self, points: &[[f64; 3]], identities: &[u64]) -> bool {
        let known = !identities.is_empty() && !self.identities.is_empty();
        let carried = match &mut self.tree {
            Some(tree) if known => tree.reindex(&self.identities, identities, points),
            _ => None,
        };
        self.identities = identities.to_vec();
        if let Some(report) = carried {
            self.last = report;
            return true;
        }
        self.tree = Some(PointTree::build(points, self.capacity, self.split));
        self.last = Reindexed { inserted: points.len(), ..Reindexed::default() };
        false
    }

    /// Slot of every point; empty before the first update.
    pub fn positions(&self) -> &[usize] {
        self.tree.as_ref().map_or(&[], PointTree::positions)
    }

    /// (points per leaf, halvings) of the tree.
    pub fn shape(&self) -> (usize, usize) {
        self.tree.as_ref().map_or((self.capacity, 0), |tree| (tree.capacity(), tree.depth()))
    }

    /// Named figures of the last update.
    pub fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        let (capacity, depth) = self.shape();
        figures.insert("slots".to_string(), (capacity << depth) as f64);
        figures.insert("slots_kept".to_string(), self.last.kept as f64);
        figures.insert("slots_moved".to_string(), self.last.moved as f64);
        figures.insert("slots_inserted".to_string(), self.last.inserted as f64);
    }
}
