//! Small vertex separators of a graph by the multilevel method.
//!
//! Coarsen by heavy-edge matching, split the coarsest graph by growing a region from several seeds, and carry
//! the separator back, improved at every level by moves of single vertices (Fiduccia and Mattheyses 1982, in
//! the vertex separator form of Hendrickson and Rothberg 1998).

use crate::ordering::Graph;
use std::collections::BinaryHeap;

/// Label of separator vertices; 0 and 1 are the two sides.
const SEPARATOR: u8 = 2;
/// Coarsening stops at this many vertices.
const COARSEST: usize = 80;
/// Seeds tried on the coarsest graph.
const SEEDS: usize = 10;
/// A side may hold at most this fraction of the vertices.
const LARGEST_SIDE: f64 = 0.58;
/// Moves in a row without improvement that end a pass.
const PATIENCE: usize = 150;
/// Improvement passes per level.
const PASSES: usize = 6;
/// Independent multilevel runs on a graph of at most [`REPEAT_BELOW`] vertices; the smallest separator wins.
const RUNS: usize = 3;
/// See [`RUNS`].
const REPEAT_BELOW: usize = 20_000;

/// Graph with weights: the number of original vertices and edges merged into each.
struct Level {
    start: Vec<usize>,
    neighbour: Vec<u32>,
    edge_weight: Vec<u32>,
    vertex_weight: Vec<u32>,
    /// Vertex of the next coarser level that each vertex became part of.
    coarse: Vec<u32>,
}

impl Level {
    fn len(&self) -> usize {
        self.vertex_weight.len()
    }

    fn neighbours(&self, v: usize) -> &[u32] {
        &self.neighbour[self.start[v]..self.start[v + 1]]
    }

    fn total(&self) -> u32 {
        self.vertex_weight.iter().sum()
    }
}

/// Small deterministic generator (xorshift64*): orders must be reproducible.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        ((u128::from(self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)) * bound as u128) >> 64) as usize
    }

    fn shuffled(&mut self, len: usize) -> Vec<u32> {
        let mut order: Vec<u32> = (0..len as u32).collect();
        for k in (1..len).rev() {
            order.swap(k, self.below(k + 1));
        }
        order
    }
}

/// Splits a graph: 0 and 1 for the two sides, 2 for the vertices of the separator. No edge joins the two
/// sides, and where the graph allows it no side holds more than 58 % of the vertices.
pub fn separate(graph: &Graph) -> Vec<u8> {
    let runs = if graph.len() <= REPEAT_BELOW { RUNS } else { 1 };
    let mut best: Option<(f64, Vec<u8>)> = None;
    for run in 0..runs {
        let side = multilevel(graph, &mut Random(0x9E37_79B9_7F4A_7C15 + run as u64));
        let count = |wanted: u8| side.iter().filter(|&&s| s == wanted).count() as u32;
        let cost = cost(count(SEPARATOR), count(0), count(1));
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, side));
        }
    }
    best.map(|(_, side)| side).unwrap_or_default()
}

/// What a split is measured by: the separator's weight, raised for unequal sides.
fn cost(separator: u32, left: u32, right: u32) -> f64 {
    let total = f64::from(separator + left + right).max(1.0);
    let unequal = (f64::from(left) - f64::from(right)).abs() / total;
    (f64::from(separator) + 1.0) * (1.0 + unequal * unequal)
}

fn multilevel(graph: &Graph, random: &mut Random) -> Vec<u8> {
    let mut levels = vec![finest(graph)];
    loop {
        let last = levels.len() - 1;
        if levels[last].len() <= COARSEST {
            break;
        }
        let coarser = coarsen(&mut levels[last], random);
        // A star or a graph without edges no longer shrinks by matching.
        if coarser.len() as f64 > 0.95 * levels[last].len() as f64 {
            break;
        }
        levels.push(coarser);
    }
    let mut levels = levels.into_iter().rev();
    let Some(coarsest) = levels.next() else { return Vec::new() };
    let mut side = split_coarsest(&coarsest, random);
    for level in levels {
        side = level.coarse.iter().map(|&c| side[c as usize]).collect();
        improve(&level, &mut side, random);
    }
    side
}

fn finest(graph: &Graph) -> Level {
    let (mut start, mut neighbour) = (vec![0], Vec::new());
    for v in 0..graph.len() {
        neighbour.extend_from_slice(graph.neighbours(v));
        start.push(neighbour.len());
    }
    Level {
        start,
        edge_weight: vec![1; neighbour.len()],
        neighbour,
        vertex_weight: vec![1; graph.len()],
        coarse: Vec::new(),
    }
}

/// Merges matched pairs: every vertex, in random order, with its free neighbour over the heaviest edge.
fn coarsen(level: &mut Level, random: &mut Random) -> Level {
    let n = level.len();
    let free = u32::MAX;
    let heaviest = 1 + 3 * level.total() / (2 * COARSEST as u32);
    let mut coarse = vec![free; n];
    let mut members: Vec<[u32; 2]> = Vec::with_capacity(n / 2 + 1);
    for v in random.shuffled(n) {
        if coarse[v as usize] != free {
            continue;
        }
        let range = level.start[v as usize]..level.start[v as usize + 1];
        let mut partner = (0, v);
        for (&u, &weight) in level.neighbour[range.clone()].iter().zip(&level.edge_weight[range]) {
            let light = level.vertex_weight[u as usize] + level.vertex_weight[v as usize] <= heaviest;
            if coarse[u as usize] == free && u != v && weight > partner.0 && light {
                partner = (weight, u);
            }
        }
        coarse[v as usize] = members.len() as u32;
        coarse[partner.1 as usize] = members.len() as u32;
        members.push([v, partner.1]);
    }
    let (mut start, mut neighbour, mut edge_weight) = (vec![0], Vec::new(), Vec::new());
    let mut vertex_weight = Vec::with_capacity(members.len());
    let mut position = vec![usize::MAX; members.len()];
    for (c, &[a, b]) in members.iter().enumerate() {
        let first: usize = neighbour.len();
        let pair = [a, b];
        let members = if a == b { &pair[..1] } else { &pair[..] };
        for &v in members {
            for k in level.start[v as usize]..level.start[v as usize + 1] {
                let target = coarse[level.neighbour[k] as usize];
                if target as usize == c {
                    continue;
                }
                let at = &mut position[target as usize];
                if *at == usize::MAX || *at < first {
                    *at = neighbour.len();
                    neighbour.push(target);
                    edge_weight.push(0);
                }
                edge_weight[*at] += level.edge_weight[k];
            }
        }
        vertex_weight.push(members.iter().map(|&v| level.vertex_weight[v as usize]).sum());
        for &u in &neighbour[first..] {
            position[u as usize] = usize::MAX;
        }
        start.push(neighbour.len());
    }
    level.coarse = coarse;
    Level { start, neighbour, edge_weight, vertex_weight, coarse: Vec::new() }
}

/// Best of several splits, each grown breadth first from a random seed to half of the weight, then improved.
fn split_coarsest(level: &Level, random: &mut Random) -> Vec<u8> {
    let n = level.len();
    let total = level.total();
    let mut best: Option<(f64, Vec<u8>)> = None;
    for _ in 0..SEEDS {
        let mut side = vec![1_u8; n];
        let mut grown = 0;
        let mut queue = std::collections::VecDeque::new();
        let mut reached = vec![false; n];
        let mut seeds = random.shuffled(n).into_iter();
        while 2 * grown < total {
            let v = match queue.pop_front() {
                Some(v) => v,
                // The region is a whole component: go on in another one.
                None => match seeds.find(|&v| !reached[v as usize]) {
                    Some(v) => v,
                    None => break,
                },
            };
            reached[v as usize] = true;
            side[v as usize] = 0;
            grown += level.vertex_weight[v as usize];
            for &u in level.neighbours(v as usize) {
                if !reached[u as usize] {
                    reached[u as usize] = true;
                    queue.push_back(u);
                }
            }
        }
        // The separator starts as the vertices of side 1 that touch side 0.
        for v in 0..n {
            if side[v] == 1 && level.neighbours(v).iter().any(|&u| side[u as usize] == 0) {
                side[v] = SEPARATOR;
            }
        }
        improve(level, &mut side, random);
        let weight = |wanted: u8| -> u32 {
            (0..n).filter(|&v| side[v] == wanted).map(|v| level.vertex_weight[v]).sum()
        };
        let cost = cost(weight(SEPARATOR), weight(0), weight(1));
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, side));
        }
    }
    best.map(|(_, side)| side).unwrap_or_default()
}

/// What the separator would lose in weight by moving v to a side.
fn gain(level: &Level, side: &[u8], v: usize, to: u8) -> i64 {
    let weight_of = |v: u32| i64::from(level.vertex_weight[v as usize]);
    let pulled = level.neighbours(v).iter().filter(|&&u| side[u as usize] == 1 - to);
    weight_of(v as u32) - pulled.map(|&u| weight_of(u)).sum::<i64>()
}

/// Moves separator vertices to a side (pulling their neighbours on the other side into the separator) as long
/// as passes lower the cost. Each pass accepts losses for a while and returns to the best state it saw.
fn improve(level: &Level, side: &mut [u8], random: &mut Random) {
    let n = level.len();
    let total = level.total();
    let largest_side = (LARGEST_SIDE * f64::from(total)).ceil() as u32;
    let weight_of = |v: usize| level.vertex_weight[v];
    let mut weight = [0_u32; 3];
    for v in 0..n {
        weight[side[v] as usize] += weight_of(v);
    }
    let gain = |side: &[u8], v: usize, to: u8| gain(level, side, v, to);
    let mut locked = vec![u32::MAX; n];
    let mut changes: Vec<(u32, u8)> = Vec::new();
    for pass in 0..PASSES as u32 {
        let mut heap = BinaryHeap::new();
        for v in 0..n {
            if side[v] == SEPARATOR {
                for to in [0, 1] {
                    heap.push((gain(side, v, to), random.below(1 << 16), v as u32, to));
                }
            }
        }
        changes.clear();
        let start = cost(weight[2], weight[0], weight[1]);
        let (mut least, mut kept, mut since) = (start, 0, 0);
        while let Some((claimed, _, v, to)) = heap.pop() {
            let vertex = v as usize;
            if side[vertex] != SEPARATOR || locked[vertex] == pass {
                continue;
            }
            let actual = gain(side, vertex, to);
            if actual != claimed {
                // Neighbours have moved since: reconsider at the true gain.
                heap.push((actual, random.below(1 << 16), v, to));
                continue;
            }
            let grows = weight[to as usize] + weight_of(vertex);
            if grows > largest_side && grows > weight[1 - to as usize] {
                continue;
            }
            locked[vertex] = pass;
            changes.push((v, SEPARATOR));
            side[vertex] = to;
            weight[to as usize] += weight_of(vertex);
            weight[2] -= weight_of(vertex);
            for &u in level.neighbours(vertex) {
                if side[u as usize] == 1 - to {
                    changes.push((u, 1 - to));
                    side[u as usize] = SEPARATOR;
                    weight[1 - to as usize] -= weight_of(u as usize);
                    weight[2] += weight_of(u as usize);
                    for to in [0, 1] {
                        heap.push((gain(side, u as usize, to), random.below(1 << 16), u, to));
                    }
                }
            }
            let now = cost(weight[2], weight[0], weight[1]);
            if now < least {
                (least, kept, since) = (now, changes.len(), 0);
            } else {
                since += 1;
                if since > PATIENCE {
                    break;
                }
            }
        }
        for &(v, old) in changes[kept..].iter().rev() {
            let now = side[v as usize];
            weight[now as usize] -= weight_of(v as usize);
            weight[old as usize] += weight_of(v as usize);
            side[v as usize] = old;
        }
        if least >= start {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two cliques of 60 vertices joined by a path of one vertex: that vertex is the smallest separator.
    #[test]
    fn the_bridge_between_two_cliques_is_found() {
        let clique = 60_u32;
        let bridge = 2 * clique;
        let mut rows: Vec<Vec<u32>> = (0..=bridge).map(|_| Vec::new()).collect();
        for part in 0..2 {
            for a in 0..clique {
                for b in 0..clique {
                    rows[(part * clique + a) as usize].push(part * clique + b);
                }
            }
        }
        for end in [0, clique] {
            rows[end as usize].push(bridge);
            rows[bridge as usize].push(end);
        }
        let mut start = vec![0];
        for row in &rows {
            start.push(start.last().unwrap() + row.len());
        }
        let graph = Graph::from_rows(&start, &rows.concat());
        let side = separate(&graph);
        assert_eq!(side.iter().filter(|&&s| s == SEPARATOR).count(), 1);
        for v in 0..graph.len() {
            for &u in graph.neighbours(v) {
                assert!(side[v] == SEPARATOR || side[u as usize] == SEPARATOR || side[v] == side[u as usize]);
            }
        }
    }
}
