//! Direct elimination of bilateral rows.
//!
//! For rows B (m x n, each of length one) this holds the orthogonal factorisation of their transpose,
//!
//! ```text
//! B^T P = Q [ R11 R12 ]      R11 upper triangular of the rank of B
//!           [  0   0  ]
//! ```
//!
//! with which the nearest point to a given one on { z : B z = b }, the multipliers of the rows, and a basis
//! of the motions that the rows leave free are found without forming B B^T, whose condition is the square:
//! light and heavy bodies in one chain keep their digits. Rows that repeat others (a plane linkage of hinges
//! has three of them in every loop) are found by the rank, and multipliers are the shortest ones.
//!
//! A row touches few bodies, so Q is made of small factors (multifrontal): rows over the same bodies are
//! eliminated together, those first that join the least, in a [`Front`] of the coordinates of these bodies;
//! what they leave, as many coordinates as later rows can see of them, is one body more for those. Pivots are
//! chosen within a front. A row whose part beyond those before it is short, but not so short that it repeats
//! them, waits for later fronts: misaligned by roundings, rows that repeat others must not go before those
//! that do not.
//!
//! Cost: of a tree proportional to its joints, where bodies hold few joints each; quadratic in the joints of
//! one body; of loops what their least dense order fills.
//!
//! Source: T. A. Davis, "Algorithm 915, SuiteSparseQR: multifrontal multithreaded rank-revealing sparse QR
//! factorization", ACM Transactions on Mathematical Software 38(1):8, 2011; G. H. Golub, C. F. Van Loan,
//! "Matrix Computations", 4th edition, 2013, sections 5.4 and 5.5; for mechanisms: M. Géradin, A. Cardona,
//! "Flexible Multibody Dynamics", 2001, chapter on null-space elimination.

#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};

/// Rows whose part beyond those before them is shorter than this, over the longest row, repeat them.
const DEPENDENT: f64 = 1e-9;

/// A row whose part beyond those before it is shorter than this waits.
const WAITS: f64 = 1e-5;

/// What is shorter than this is rounding.
const NOISE: f64 = 1e-14;

/// Residual of changes of right-hand sides over what is wanted: Newton's method makes up for it.
const SETTLED: f64 = 1e-5;

/// Iterations for them: they are few where the other rows are near those that are eliminated. Where bodies
/// turn so far that these do not do, the correction of the path is one among several.
const ITERATIONS: usize = 60;

/// Entries of a row, by coordinate, ascending.
pub(super) type SparseRow = Vec<(usize, f64)>;

/// The factorisation.
#[derive(Clone, Debug, Default)]
pub(crate) struct Elimination {
    /// How many blocks of six coordinates are bodies.
    bodies: usize,
    /// n.
    length: usize,
    /// m.
    count: usize,
    /// In the order in which they are eliminated.
    fronts: Vec<Front>,
    /// Orthonormal basis of the relations among rows: vectors x with B^T x = 0.
    relations: Vec<Vec<f64>>,
}

/// Rows over the same bodies that are eliminated together.
#[derive(Clone, Debug, Default)]
struct Front {
    /// Coordinates.
    slots: Vec<usize>,
    /// Which row of B a column is: first the pivots of R11, then those of the coordinates that stay for later
    /// fronts, then other later rows; last those that repeat others.
    names: Vec<usize>,
    /// By columns: above the diagonal R, from it on the reflector.
    entries: Vec<f64>,
    /// Diagonal of R, of all columns that have a reflector.
    diagonal: Vec<f64>,
    /// How many of these are of R11.
    rank: usize,
    /// How many rows repeat others.
    repeated: usize,
}

/// Coordinates that the same rows touch: of a body, or what a front leaves of several.
#[derive(Default)]
struct Cluster {
    slots: Vec<usize>,
    /// Numbers of groups of rows, ascending.
    groups: Vec<usize>,
    /// Rows of B that wait.
    waiting: Vec<usize>,
    /// Rows of B.
    names: Vec<usize>,
    /// Their entries at the slots, by rows of B.
    entries: Vec<f64>,
}

/// In eight sums, which the machine makes at once.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, rest_a), (b, rest_b)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

/// y <- y + factor x.
fn add(y: &mut [f64], factor: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += factor * x);
}

/// x <- (1 - v v^T) x.
fn reflected(v: &[f64], x: &mut [f64]) {
    let factor = dot(v, x);
    add(x, -factor, v);
}

impl Front {
    /// Of rows `own` and what later rows have at the same coordinates, with what those have after it; rows
    /// may wait unless it is the `last` one of what hangs together. `place` has a number per row of B that
    /// means nothing.
    fn new(
        own: Vec<usize>,
        merged: &[Cluster],
        (longest, last): (f64, bool),
        place: &mut [usize],
    ) -> (Self, Cluster) {
        let slots = merged.iter().flat_map(|cluster| cluster.slots.clone()).collect();
        let waiting = merged.iter().flat_map(|cluster| cluster.waiting.clone());
        let mut names: Vec<usize> = own.into_iter().chain(waiting).collect();
        let eliminated = names.len();
        let all = || merged.iter().flat_map(|cluster| &cluster.names);
        all().for_each(|&row| place[row] = usize::MAX);
        names.iter().zip(0..).for_each(|(&row, k)| place[row] = k);
        for &row in all() {
            if place[row] == usize::MAX {
                place[row] = names.len();
                names.push(row);
            }
        }
        let mut front = Self { slots, names, ..Self::default() };
        let size = front.slots.len();
        front.entries = vec![0.0; size * front.names.len()];
        let mut first = 0;
        for cluster in merged {
            let own = cluster.slots.len();
            for (&row, entries) in cluster.names.iter().zip(cluster.entries.chunks_exact(own.max(1))) {
                let start = place[row] * size + first;
                front.entries[start..start + own].copy_from_slice(entries);
            }
            first += own;
        }
        front.triangularise(eliminated, longest * if last { DEPENDENT } else { WAITS });
        front.rank = front.diagonal.len();
        // Those that wait come before those that repeat others.
        let mut waiting = front.rank;
        for j in front.rank..eliminated {
            let rest = &front.column(j)[front.rank..];
            if !last && dot(rest, rest).sqrt() > DEPENDENT * longest {
                front.exchange(j, waiting);
                waiting += 1;
            }
        }
        front.repeated = eliminated - waiting;
        front.names[waiting..].rotate_left(front.repeated);
        front.entries[waiting * size..].rotate_left(front.repeated * size);
        let waiting = front.names[front.rank..waiting].to_vec();
        let seen = front.names.len() - front.repeated;
        front.triangularise(seen, NOISE * longest);
        let (left, kept) = (front.rank..seen, front.rank..front.diagonal.len());
        let entry = |i: usize, j: usize| if i > j { 0.0 } else { front.entry(i, j) };
        let entries = left.clone().flat_map(|j| kept.clone().map(move |i| entry(i, j))).collect();
        let (slots, names) = (front.slots[kept.clone()].to_vec(), front.names[left.clone()].to_vec());
        (front, Cluster { slots, groups: Vec::new(), waiting, names, entries })
    }

    /// Exchanges two columns.
    fn exchange(&mut self, i: usize, j: usize) {
        let size = self.slots.len();
        self.names.swap(i, j);
        if i != j {
            let (head, tail) = self.entries.split_at_mut(i.max(j) * size);
            head[i.min(j) * size..][..size].swap_with_slice(&mut tail[..size]);
        }
    }

    /// Reflectors for columns below `until`, the longest first, as long as they are longer than this.
    fn triangularise(&mut self, until: usize, shortest: f64) {
        let size = self.slots.len();
        for k in self.diagonal.len()..until.min(size) {
            let rest = |column: &[f64]| dot(&column[k..], &column[k..]);
            let mut columns = self.entries.chunks_exact(size).enumerate().take(until).skip(k);
            let (mut pivot, mut most) = (k, columns.next().map_or(0.0, |(_, column)| rest(column)));
            for (j, column) in columns {
                let square = rest(column);
                if square > most {
                    (pivot, most) = (j, square);
                }
            }
            let norm = most.sqrt();
            if norm.is_nan() || norm <= shortest {
                break;
            }
            self.exchange(k, pivot);
            let (head, tail) = self.entries.split_at_mut((k + 1) * size);
            // H = 1 - v v^T with |v|^2 = 2 sends the column to -sign norm e_k.
            let reflector = &mut head[k * size + k..];
            let sign = 1.0_f64.copysign(reflector[0]);
            reflector[0] += sign * norm;
            let scale = (2.0 / dot(reflector, reflector)).sqrt();
            reflector.iter_mut().for_each(|x| *x *= scale);
            tail.chunks_exact_mut(size).for_each(|column| reflected(reflector, &mut column[k..]));
            self.diagonal.push(-sign * norm);
        }
    }

    fn column(&self, j: usize) -> &[f64] {
        &self.entries[j * self.slots.len()..(j + 1) * self.slots.len()]
    }

    /// Entry of R.
    fn entry(&self, i: usize, j: usize) -> f64 {
        if i == j && i < self.diagonal.len() { self.diagonal[i] } else { self.column(j)[i] }
    }

    /// Row of R11 and R12 right of the diagonal: rows of B with their entries.
    fn beyond(&self, i: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.entries.iter().skip(i).step_by(self.slots.len().max(1));
        self.names.iter().copied().zip(entries.copied()).skip(i + 1)
    }

    /// Applies the reflectors in this order to what is at the coordinates.
    fn apply(&self, order: impl Iterator<Item = usize>, x: &mut [f64], own: &mut Vec<f64>) {
        own.clear();
        own.extend(self.slots.iter().map(|&slot| x[slot]));
        if own.iter().all(|x| *x == 0.0) {
            return;
        }
        order.for_each(|k| reflected(&self.column(k)[k..], &mut own[k..]));
        self.slots.iter().zip(own).for_each(|(&slot, own)| x[slot] = *own);
    }
}

/// Rows over the same blocks of coordinates; rows of zeros are in none.
fn groups(rows: &[SparseRow], block: impl Fn(usize) -> usize) -> Vec<(Vec<usize>, Vec<usize>)> {
    let mut groups: BTreeMap<Vec<usize>, Vec<usize>> = BTreeMap::new();
    for (row, entries) in rows.iter().enumerate().filter(|(_, row)| row.iter().any(|(_, x)| *x != 0.0)) {
        let mut blocks: Vec<usize> = entries.iter().map(|(place, _)| block(*place)).collect();
        blocks.dedup();
        groups.entry(blocks).or_default().push(row);
    }
    groups.into_iter().collect()
}

impl Elimination {
    /// Of these rows over `bodies` bodies, six coordinates each, and further coordinates up to this length.
    /// Rows of zeros are allowed.
    pub(crate) fn new(bodies: usize, length: usize, rows: &[SparseRow]) -> Self {
        let block = |place: usize| if place < 6 * bodies { place / 6 } else { place - 5 * bodies };
        let slots = |block: usize| match block < bodies {
            true => 6 * block..6 * block + 6,
            false => block + 5 * bodies..block + 5 * bodies + 1,
        };
        let groups = groups(rows, block);
        let longest = rows.iter().map(|row| row.iter().map(|(_, x)| x * x).sum()).fold(0.0, f64::max);
        let blocks = bodies + length - 6 * bodies;
        let mut clusters: Vec<Cluster> = (0..blocks).map(|_| Cluster::default()).collect();
        for (group, (blocks, members)) in groups.iter().enumerate() {
            for &block in blocks {
                let (slots, cluster) = (slots(block), &mut clusters[block]);
                cluster.slots = slots.clone().collect();
                cluster.groups.push(group);
                for &row in members {
                    let first = cluster.entries.len();
                    cluster.names.push(row);
                    cluster.entries.resize(first + slots.len(), 0.0);
                    for (place, x) in rows[row].iter().filter(|(place, _)| slots.contains(place)) {
                        cluster.entries[first + place - slots.start] = *x;
                    }
                }
            }
        }
        let mut own = Self { bodies, length, count: rows.len(), ..Self::default() };
        own.eliminate(groups.into_iter().unzip(), clusters, f64::sqrt(longest));
        own.relate();
        own
    }

    /// Makes the fronts: those groups first that join the fewest columns.
    fn eliminate(
        &mut self,
        (mut touched, mut members): (Vec<Vec<usize>>, Vec<Vec<usize>>),
        mut clusters: Vec<Cluster>,
        longest: f64,
    ) {
        let cost = |touched: &[usize], clusters: &[Cluster]| -> usize {
            touched.iter().map(|&cluster| clusters[cluster].names.len()).sum()
        };
        let mut costs: Vec<usize> = touched.iter().map(|own| cost(own, &clusters)).collect();
        let mut queue: BTreeSet<(usize, usize)> = costs.iter().copied().zip(0..).collect();
        let mut place = vec![0; self.count];
        while let Some((_, group)) = queue.pop_first() {
            let joined = std::mem::take(&mut touched[group]);
            let merged: Vec<Cluster> = joined.iter().map(|&own| std::mem::take(&mut clusters[own])).collect();
            let own = std::mem::take(&mut members[group]);
            let mut groups: Vec<usize> =
                merged.iter().flat_map(|cluster| cluster.groups.iter().copied()).collect();
            groups.sort_unstable();
            groups.dedup();
            groups.retain(|&other| other != group);
            let (front, mut left) = Front::new(own, &merged, (longest, groups.is_empty()), &mut place);
            self.fronts.push(front);
            left.groups = groups;
            let (next, seen) = (clusters.len(), left.groups.clone());
            clusters.push(left);
            for other in seen {
                touched[other].retain(|cluster| !joined.contains(cluster));
                touched[other].push(next);
                queue.remove(&(costs[other], other));
                costs[other] = cost(&touched[other], &clusters);
                queue.insert((costs[other], other));
            }
        }
    }

    /// Finds the relations among rows.
    fn relate(&mut self) {
        let mut relations: Vec<Vec<f64>> = Vec::new();
        for front in &self.fronts {
            for &row in &front.names[front.names.len() - front.repeated..] {
                let mut relation = vec![0.0; self.count];
                relation[row] = 1.0;
                self.solve_back(&[], &mut relation);
                // Twice is enough.
                for _ in 0..2 {
                    for known in &relations {
                        let along = dot(known, &relation);
                        add(&mut relation, -along, known);
                    }
                }
                let norm = dot(&relation, &relation).sqrt();
                // Rows that are no numbers relate to nothing.
                if norm.is_finite() {
                    relation.iter_mut().for_each(|x| *x /= norm);
                    relations.push(relation);
                }
            }
        }
        self.relations = relations;
    }

    /// x <- Q^T x.
    fn reflect(&self, x: &mut [f64]) {
        let mut own = Vec::new();
        self.fronts.iter().for_each(|front| front.apply(0..front.diagonal.len(), x, &mut own));
    }

    /// x <- Q x.
    fn reflect_back(&self, x: &mut [f64]) {
        let mut own = Vec::new();
        let fronts = self.fronts.iter().rev();
        fronts.for_each(|front| front.apply((0..front.diagonal.len()).rev(), x, &mut own));
    }

    /// Coordinates of Q^T z of R11: (front, place there, coordinate).
    fn pivots(&self) -> impl DoubleEndedIterator<Item = (&Front, usize, usize)> {
        self.fronts.iter().flat_map(|front| (0..front.rank).map(move |k| (front, k, front.slots[k])))
    }

    /// z <- the nearest point to z with B z = b; of rows that repeat others the b does not count.
    pub(crate) fn project(&self, z: &mut [f64], b: &[f64]) {
        self.reflect(z);
        let mut rest = b.to_vec();
        for (front, k, slot) in self.pivots() {
            z[slot] = rest[front.names[k]] / front.diagonal[k];
            front.beyond(k).for_each(|(row, entry)| rest[row] -= entry * z[slot]);
        }
        self.reflect_back(z);
    }

    /// z <- its part in the range of B^T.
    fn along(&self, z: &mut [f64]) {
        self.reflect(z);
        let mut kept = vec![0.0; z.len()];
        self.pivots().for_each(|(.., slot)| kept[slot] = z[slot]);
        z.copy_from_slice(&kept);
        self.reflect_back(z);
    }

    /// B z of a z in the range of B^T.
    fn times(&self, z: &[f64]) -> Vec<f64> {
        let (mut z, mut product) = (z.to_vec(), vec![0.0; self.count]);
        self.reflect(&mut z);
        for (front, k, slot) in self.pivots() {
            product[front.names[k]] += front.diagonal[k] * z[slot];
            front.beyond(k).for_each(|(row, entry)| product[row] += entry * z[slot]);
        }
        product
    }

    /// The changes of b by which [`Self::project`] changes C z by `wanted`, for as many other rows C: z in
    /// the range of B^T whose part in that of C^T is the shortest vector of these C z, by conjugate
    /// gradients. The squares of the cosines between both ranges are the eigenvalues: all next to 1 where the
    /// rows are near each other, however they are conditioned. What repeats others in B does not count in C,
    /// where it may do so to second order only.
    pub(crate) fn changes(&self, mut others: Vec<SparseRow>, wanted: &[f64]) -> Vec<f64> {
        for front in &self.fronts {
            let repeated = &front.names[front.names.len() - front.repeated..];
            repeated.iter().for_each(|&row| others[row].clear());
        }
        let others = Self::new(self.bodies, self.length, &others);
        let mut rest = vec![0.0; self.length];
        others.project(&mut rest, wanted);
        self.along(&mut rest);
        let (mut z, mut way) = (vec![0.0; self.length], rest.clone());
        let mut square = dot(&rest, &rest);
        let small = SETTLED * SETTLED * square;
        for _ in 0..ITERATIONS {
            if square.is_nan() || square <= small {
                break;
            }
            let mut image = way.clone();
            others.along(&mut image);
            self.along(&mut image);
            let step = square / dot(&way, &image);
            if !step.is_finite() {
                break;
            }
            add(&mut z, step, &way);
            add(&mut rest, -step, &image);
            let before = std::mem::replace(&mut square, dot(&rest, &rest));
            way.iter_mut().zip(&rest).for_each(|(way, rest)| *way = rest + square / before * *way);
        }
        self.times(&z)
    }

    /// Solves R11 x = t - R12 x, where x is given for rows that repeat others; t at the slots of Q^T (empty:
    /// zero).
    fn solve_back(&self, t: &[f64], x: &mut [f64]) {
        for (front, k, slot) in self.pivots().rev() {
            let after: f64 = front.beyond(k).map(|(row, entry)| entry * x[row]).sum();
            x[front.names[k]] = (t.get(slot).unwrap_or(&0.0) - after) / front.diagonal[k];
        }
    }

    /// The shortest multipliers for which B^T lambda is nearest to t.
    pub(crate) fn multipliers(&self, t: &[f64]) -> Vec<f64> {
        let (mut t, mut multipliers) = (t.to_vec(), vec![0.0; self.count]);
        self.reflect(&mut t);
        self.solve_back(&t, &mut multipliers);
        for relation in &self.relations {
            let along = dot(relation, &multipliers);
            add(&mut multipliers, -along, relation);
        }
        multipliers
    }

    /// Orthonormal vectors that span what the rows leave free.
    pub(crate) fn free_motions(&self) -> Vec<Vec<f64>> {
        let mut is_free = vec![true; self.length];
        self.pivots().for_each(|(.., slot)| is_free[slot] = false);
        let unit = |slot: usize| {
            let mut x = vec![0.0; self.length];
            x[slot] = 1.0;
            self.reflect_back(&mut x);
            x
        };
        (0..self.length).filter(|&slot| is_free[slot]).map(unit).collect()
    }
}
