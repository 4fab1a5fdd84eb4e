//! Symbolic part of the sparse Cholesky factorisation: elimination tree, column structures, supernodes.

use crate::ordering::{Graph, Ordering};

/// Structure of the factor of a symmetric block matrix, in blocks.
///
/// Positions number the rows in the order of elimination. Supernode s holds the columns
/// `first[s]..first[s + 1]` (positions), which share the rows `rows[s]` (positions, ascending) below them.
#[derive(Clone, Debug)]
pub(crate) struct Supernodes {
    /// The row eliminated at each position.
    pub order: Vec<u32>,
    /// Position of each row.
    pub position: Vec<u32>,
    /// First column of every supernode; one more entry than supernodes.
    pub first: Vec<u32>,
    /// Rows below the columns of each supernode.
    pub rows: Vec<Vec<u32>>,
    /// Parent in the assembly tree, `u32::MAX` for roots. Parents come after their children (postorder).
    pub parent: Vec<u32>,
}

/// Supernodes may be merged up to this many scalar columns when at most this fraction of the merged panel is
/// zero.
const MERGE: [(usize, f64); 4] = [(12, 1.0), (32, 0.3), (96, 0.12), (usize::MAX, 0.04)];

const NONE: u32 = u32::MAX;

/// Entries of a panel of n columns with m rows below, lower triangle only.
fn panel_entries(n: usize, m: usize) -> usize {
    n * (n + 1) / 2 + n * m
}

impl Supernodes {
    /// Analyses a matrix with this graph, whose entries are blocks of `block_size` rows.
    pub fn new(graph: &Graph, ordering: Ordering, block_size: usize) -> Self {
        let order = ordering.order(graph);
        let order = postordered(graph, order);
        let position = inverse(&order);
        let lower = lower_columns(graph, &order, &position);
        let parent = elimination_tree(&lower);

        // Column structures, each the union of the column of the matrix and of its children's structures.
        // Column j joins the supernode of column j - 1 where that adds no entry.
        let n = order.len();
        let mut children: Vec<Vec<u32>> = vec![Vec::new(); n];
        for (j, &p) in parent.iter().enumerate() {
            if p != NONE {
                children[p as usize].push(j as u32);
            }
        }
        let mut structure: Vec<Vec<u32>> = vec![Vec::new(); n];
        let mut mark = vec![NONE; n];
        let mut first: Vec<u32> = Vec::new();
        let mut last_of: Vec<u32> = Vec::new();
        for j in 0..n {
            let mut rows: Vec<u32> = Vec::new();
            mark[j] = j as u32;
            let below =
                lower.column(j).iter().chain(children[j].iter().flat_map(|&c| &structure[c as usize]));
            for &i in below {
                if mark[i as usize] != j as u32 {
                    mark[i as usize] = j as u32;
                    rows.push(i);
                }
            }
            rows.sort_unstable();
            let joins = j > 0 && parent[j - 1] == j as u32 && structure[j - 1].len() == rows.len() + 1;
            if joins {
                structure[j - 1] = Vec::new();
                if let Some(last) = last_of.last_mut() {
                    *last = j as u32;
                }
            } else {
                first.push(j as u32);
                last_of.push(j as u32);
            }
            structure[j] = rows;
        }
        let columns: Vec<std::ops::Range<u32>> =
            first.iter().zip(&last_of).map(|(&first, &last)| first..last + 1).collect();
        let rows: Vec<Vec<u32>> =
            last_of.iter().map(|&last| std::mem::take(&mut structure[last as usize])).collect();
        merge(&order, columns, rows, block_size)
    }

    /// Number of supernodes.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Number of columns of a supernode.
    pub fn width(&self, s: usize) -> usize {
        (self.first[s + 1] - self.first[s]) as usize
    }

    /// The supernode of every position.
    pub fn holders(&self) -> Vec<u32> {
        let mut holder = vec![0; self.order.len()];
        for s in 0..self.len() {
            holder[self.first[s] as usize..self.first[s + 1] as usize].fill(s as u32);
        }
        holder
    }

    /// Block row of a position inside the front of supernode s.
    pub fn local(&self, s: usize, position: u32) -> u32 {
        if position < self.first[s + 1] {
            position - self.first[s]
        } else {
            let below = self.rows[s].partition_point(|&row| row < position);
            self.width(s) as u32 + below as u32
        }
    }

    /// Children of every supernode, and where its rows lie in the front of its parent.
    pub fn assembly(&self) -> (Vec<Vec<u32>>, Vec<Vec<Run>>) {
        let mut children: Vec<Vec<u32>> = vec![Vec::new(); self.len()];
        let mut runs: Vec<Vec<Run>> = vec![Vec::new(); self.len()];
        for s in 0..self.len() {
            let parent = self.parent[s];
            if parent == NONE {
                continue;
            }
            children[parent as usize].push(s as u32);
            // A run must not cross from the parent's panel into its update matrix.
            let border = self.width(parent as usize) as u32;
            for (from, &row) in self.rows[s].iter().enumerate() {
                let to = self.local(parent as usize, row);
                match runs[s].last_mut() {
                    Some(run) if run.to + run.length == to && to != border => run.length += 1,
                    _ => runs[s].push(Run { from: from as u32, to, length: 1 }),
                }
            }
        }
        (children, runs)
    }
}

/// Consecutive block rows of an update matrix that stay consecutive in the parent's front.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    pub from: u32,
    pub to: u32,
    pub length: u32,
}

/// Strictly lower triangle of the permuted matrix by columns.
struct LowerColumns {
    start: Vec<usize>,
    row: Vec<u32>,
}

impl LowerColumns {
    fn column(&self, j: usize) -> &[u32] {
        &self.row[self.start[j]..self.start[j + 1]]
    }
}

fn inverse(order: &[u32]) -> Vec<u32> {
    let mut position = vec![0; order.len()];
    for (k, &v) in order.iter().enumerate() {
        position[v as usize] = k as u32;
    }
    position
}

fn lower_columns(graph: &Graph, order: &[u32], position: &[u32]) -> LowerColumns {
    let (mut start, mut row) = (vec![0], Vec::new());
    for (j, &v) in order.iter().enumerate() {
        let later = graph.neighbours(v as usize).iter().map(|&u| position[u as usize]);
        row.extend(later.filter(|&i| i as usize > j));
        start.push(row.len());
    }
    LowerColumns { start, row }
}

/// Parent of every column: the first row below the diagonal of its column of the factor (Liu 1990).
fn elimination_tree(lower: &LowerColumns) -> Vec<u32> {
    let n = lower.start.len() - 1;
    let mut upper: Vec<Vec<u32>> = vec![Vec::new(); n];
    for j in 0..n {
        for &i in lower.column(j) {
            upper[i as usize].push(j as u32);
        }
    }
    let (mut parent, mut ancestor) = (vec![NONE; n], vec![NONE; n]);
    for i in 0..n {
        for &j in &upper[i] {
            // Climb from j to its root, pointing everything on the way at i.
            let mut at = j;
            while ancestor[at as usize] != NONE && ancestor[at as usize] != i as u32 {
                let next = ancestor[at as usize];
                ancestor[at as usize] = i as u32;
                at = next;
            }
            if ancestor[at as usize] == NONE && at != i as u32 {
                ancestor[at as usize] = i as u32;
                parent[at as usize] = i as u32;
            }
        }
    }
    parent
}

/// Nodes of a forest, children before parents; `children[v]` in the order given.
fn postorder(parent: &[u32], children: &[Vec<u32>]) -> Vec<u32> {
    let mut result = Vec::with_capacity(parent.len());
    let mut stack: Vec<(u32, usize)> = Vec::new();
    for root in (0..parent.len() as u32).filter(|&v| parent[v as usize] == NONE) {
        stack.push((root, 0));
        while let Some((v, next)) = stack.last_mut() {
            if let Some(&child) = children[*v as usize].get(*next) {
                *next += 1;
                stack.push((child, 0));
            } else {
                result.push(*v);
                stack.pop();
            }
        }
    }
    result
}

/// The same elimination, renumbered so that every subtree of the elimination tree is contiguous.
fn postordered(graph: &Graph, order: Vec<u32>) -> Vec<u32> {
    let position = inverse(&order);
    let parent = elimination_tree(&lower_columns(graph, &order, &position));
    let mut children: Vec<Vec<u32>> = vec![Vec::new(); order.len()];
    for (j, &p) in parent.iter().enumerate() {
        if p != NONE {
            children[p as usize].push(j as u32);
        }
    }
    postorder(&parent, &children).into_iter().map(|j| order[j as usize]).collect()
}

/// Supernodes after some were merged into their parents.
struct Merged {
    /// Columns of each; of those that were taken in, none.
    members: Vec<Vec<u32>>,
    /// Children among those that are left.
    children: Vec<Vec<u32>>,
    absorbed: Vec<bool>,
}

/// Merges supernodes into their parents where few zeros are stored for it.
fn absorb(size: usize, columns: &[std::ops::Range<u32>], rows: &[Vec<u32>], block_size: usize) -> Merged {
    let count = columns.len();
    let mut holder = vec![0_u32; size];
    for (s, columns) in columns.iter().enumerate() {
        for j in columns.clone() {
            holder[j as usize] = s as u32;
        }
    }
    let parent: Vec<u32> =
        rows.iter().map(|rows| rows.first().map_or(NONE, |&row| holder[row as usize])).collect();
    let mut children: Vec<Vec<u32>> = vec![Vec::new(); count];
    let mut members: Vec<Vec<u32>> = columns.iter().map(|range| range.clone().collect()).collect();
    let mut nonzero: Vec<usize> =
        (0..count).map(|s| panel_entries(members[s].len(), rows[s].len())).collect();
    let mut absorbed = vec![false; count];
    for s in 0..count {
        // All children of s are final; take them in while zeros stay few, the nearest in structure first.
        let mut candidates = std::mem::take(&mut children[s]);
        candidates.sort_by_key(|&c| std::cmp::Reverse(rows[c as usize].len()));
        let mut kept = Vec::new();
        for c in candidates {
            let child = c as usize;
            let width = members[child].len() + members[s].len();
            let stored = panel_entries(width, rows[s].len());
            let zeros = 1.0 - (nonzero[child] + nonzero[s]) as f64 / stored as f64;
            if MERGE.iter().any(|&(most, fraction)| width * block_size <= most && zeros <= fraction) {
                let mut taken = std::mem::take(&mut members[child]);
                taken.append(&mut members[s]);
                members[s] = taken;
                nonzero[s] += nonzero[child];
                absorbed[child] = true;
                kept.append(&mut children[child]);
            } else {
                kept.push(c);
            }
        }
        children[s] = kept;
        if parent[s] != NONE {
            children[parent[s] as usize].push(s as u32);
        }
    }
    Merged { members, children, absorbed }
}

/// Merges supernodes and renumbers: children whose subtree needs the most memory beyond the update matrix it
/// leaves go first (Liu 1986).
fn merge(
    order: &[u32],
    columns: Vec<std::ops::Range<u32>>,
    rows: Vec<Vec<u32>>,
    block_size: usize,
) -> Supernodes {
    let count = columns.len();
    let Merged { members, mut children, absorbed } = absorb(order.len(), &columns, &rows, block_size);
    let mut parent = vec![NONE; count];
    for s in (0..count).filter(|&s| !absorbed[s]) {
        for &c in &children[s] {
            parent[c as usize] = s as u32;
        }
    }
    let mut peak = vec![0_usize; count];
    for s in (0..count).filter(|&s| !absorbed[s]) {
        let update = |s: usize| rows[s].len() * rows[s].len();
        children[s].sort_by_key(|&c| std::cmp::Reverse(peak[c as usize] - update(c as usize)));
        let (mut held, mut most) = (0, 0);
        for &c in &children[s] {
            most = most.max(held + peak[c as usize]);
            held += update(c as usize);
        }
        peak[s] = most.max(held + update(s));
    }
    let sequence: Vec<u32> =
        postorder(&parent, &children).into_iter().filter(|&s| !absorbed[s as usize]).collect();
    let renumbered = inverse_of_sparse(&sequence, count);
    let (mut new_order, mut first) = (Vec::with_capacity(order.len()), vec![0]);
    let mut new_position = vec![0_u32; order.len()];
    for &s in &sequence {
        for &j in &members[s as usize] {
            new_position[j as usize] = new_order.len() as u32;
            new_order.push(order[j as usize]);
        }
        first.push(new_order.len() as u32);
    }
    let rows = sequence
        .iter()
        .map(|&s| {
            let mut rows: Vec<u32> = rows[s as usize].iter().map(|&i| new_position[i as usize]).collect();
            rows.sort_unstable();
            rows
        })
        .collect();
    let new_number = |&s: &u32| match parent[s as usize] {
        NONE => NONE,
        p => renumbered[p as usize],
    };
    let parent = sequence.iter().map(new_number).collect();
    let position = inverse(&new_order);
    Supernodes { order: new_order, position, first, rows, parent }
}

fn inverse_of_sparse(sequence: &[u32], count: usize) -> Vec<u32> {
    let mut position = vec![NONE; count];
    for (k, &s) in sequence.iter().enumerate() {
        position[s as usize] = k as u32;
    }
    position
}
