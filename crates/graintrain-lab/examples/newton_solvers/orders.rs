//! How much of a Newton matrix trains could hold in other orders and with more bases, and what a train is
//! worth as coarse correction under an incomplete factorisation: what the docs say about ideas that are not
//! in the product.
//!
//! The matrix is S~ with its 3x3 diagonal blocks scaled to the identity; shares are those of the squared
//! entries off these blocks.

use crate::Failure;
use crate::solve::{TOLERANCE, clock, problem};
use crate::table::short;
use graintrain::ccp::newton::{Form, LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use graintrain::ccp::paper::pdip::{Pdip, Rule};
use graintrain::ccp::paper::tensor_train::inverse::{Compression, TrainInverse, TrainSettings};
use graintrain::ccp::paper::tensor_train::place::contact_points;
use graintrain::ccp::paper::tensor_train::tree::{PointTree, Split};
use graintrain::ccp::registry::LinearMethod;
use graintrain::ccp::{CcpSolver, SolveSettings};
use graintrain_linalg::block3::BlockMatrix3;
use graintrain_linalg::dense::{Matrix, product, symmetric_eigen};
use graintrain_linalg::krylov::{KrylovSettings, KrylovWork, flexible_conjugate_gradient};
use graintrain_linalg::ordering::{Graph, nested_dissection};
use graintrain_linalg::precond::{BlockJacobi, IncompleteCholesky, Preconditioner};
use graintrain_tt::inverse::InverseForm;
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtError};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Ranks of the trains.
const RANKS: [usize; 2] = [10, 30];
/// Contacts per leaf.
const LEAVES: [usize; 2] = [1, 8];
/// Contacts per node with a basis of its own, and the ranks of these bases.
const NODES: [usize; 2] = [32, 128];
/// Relative residual of the linear solves: that of the interior point.
const LINEAR_TOLERANCE: f64 = 1e-2;
/// Iterations after which a linear solve is given up.
const LIMIT: usize = 3000;

/// A place for every contact: slots per leaf, levels, positions.
struct Order {
    name: String,
    slots: usize,
    levels: usize,
    place: Vec<usize>,
}

impl Order {
    /// Spreads a sequence of contacts evenly over leaves of about `leaf` contacts.
    fn of_sequence(name: &str, sequence: &[usize], leaf: usize) -> Self {
        let count = sequence.len();
        let mut levels = 0;
        while leaf << levels < count {
            levels += 1;
        }
        let slots = count.div_ceil(1 << levels);
        let mut place = vec![0; count];
        for (rank, &contact) in sequence.iter().enumerate() {
            let number = (rank << levels) / count;
            let first = (number * count).div_ceil(1 << levels);
            place[contact] = slots * number + rank - first;
        }
        Self { name: name.to_string(), slots, levels, place }
    }

    fn of_tree(name: &str, tree: &PointTree) -> Self {
        let place = tree.positions().to_vec();
        Self { name: name.to_string(), slots: tree.capacity(), levels: tree.depth(), place }
    }
}

/// Every order with this many contacts per leaf.
fn orders(points: &[[f64; 3]], matrix: &BlockMatrix3, leaf: usize) -> Vec<Order> {
    let hilbert = {
        let keys = hilbert_keys(points);
        let mut sequence: Vec<usize> = (0..points.len()).collect();
        sequence.sort_by_key(|&i| keys[i]);
        sequence
    };
    let graph = Graph::from_rows(matrix.row_starts(), matrix.columns());
    let dissection: Vec<usize> = nested_dissection(&graph).iter().map(|&i| i as usize).collect();
    let mut halves: Vec<usize> = (0..points.len()).collect();
    halve_graph(&graph, &mut halves, leaf);
    vec![
        Order::of_tree("halving of the contacts", &PointTree::build(points, leaf, Split::Balanced)),
        Order::of_tree("halving of space (Morton)", &PointTree::build(points, leaf, Split::Uniform)),
        Order::of_sequence("Hilbert curve", &hilbert, leaf),
        Order::of_sequence("halving of the graph", &halves, leaf),
        Order::of_sequence("nested dissection", &dissection, leaf),
        Order::of_sequence("as numbered", &(0..points.len()).collect::<Vec<_>>(), leaf),
    ]
}

/// Place of each point on Hilbert's curve through 2^60 cells (J. Skilling, Programming the Hilbert curve,
/// 2004).
fn hilbert_keys(points: &[[f64; 3]]) -> Vec<u64> {
    const BITS: u32 = 20;
    let bound =
        |k: usize, start: f64, choose: fn(f64, f64) -> f64| points.iter().map(|p| p[k]).fold(start, choose);
    let lower: [f64; 3] = std::array::from_fn(|k| bound(k, f64::INFINITY, f64::min));
    let upper: [f64; 3] = std::array::from_fn(|k| bound(k, f64::NEG_INFINITY, f64::max));
    let extent = (0..3).map(|k| upper[k] - lower[k]).fold(f64::MIN_POSITIVE, f64::max);
    let largest = f64::from((1_u32 << BITS) - 1);
    points
        .iter()
        .map(|point| {
            let mut x: [u32; 3] = std::array::from_fn(|k| ((point[k] - lower[k]) / extent * largest) as u32);
            let mut bit = 1_u32 << (BITS - 1);
            while bit > 1 {
                let low = bit - 1;
                for k in 0..3 {
                    if x[k] & bit != 0 {
                        x[0] ^= low;
                    } else {
                        let swap = (x[0] ^ x[k]) & low;
                        x[0] ^= swap;
                        x[k] ^= swap;
                    }
                }
                bit >>= 1;
            }
            x[1] ^= x[0];
            x[2] ^= x[1];
            let mut turn = 0;
            let mut bit = 1_u32 << (BITS - 1);
            while bit > 1 {
                if x[2] & bit != 0 {
                    turn ^= bit - 1;
                }
                bit >>= 1;
            }
            let x = x.map(|x| x ^ turn);
            (0..BITS)
                .rev()
                .fold(0, |key, bit| x.iter().fold(key, |key, x| key << 1 | u64::from(x >> bit & 1)))
        })
        .collect()
}

/// Halves the contacts again and again by their distance in the graph from a contact at the rim.
fn halve_graph(graph: &Graph, members: &mut [usize], leaf: usize) {
    if members.len() <= leaf.max(1) {
        return;
    }
    let inside: BTreeMap<usize, usize> = members.iter().enumerate().map(|(k, &v)| (v, k)).collect();
    let walk = |root: usize| {
        let mut sequence = Vec::with_capacity(members.len());
        let mut known = vec![false; members.len()];
        let mut queue = VecDeque::new();
        for start in std::iter::once(root).chain(0..members.len()) {
            if std::mem::replace(&mut known[start], true) {
                continue;
            }
            queue.push_back(start);
            while let Some(k) = queue.pop_front() {
                sequence.push(k);
                for next in graph.neighbours(members[k]).iter().filter_map(|v| inside.get(&(*v as usize))) {
                    if !std::mem::replace(&mut known[*next], true) {
                        queue.push_back(*next);
                    }
                }
            }
        }
        sequence
    };
    let mut root = 0;
    for _ in 0..3 {
        root = walk(root).last().copied().unwrap_or(root);
    }
    let sorted: Vec<usize> = walk(root).into_iter().map(|k| members[k]).collect();
    members.copy_from_slice(&sorted);
    let (low, high) = members.split_at_mut(members.len().div_ceil(2));
    halve_graph(graph, low, leaf);
    halve_graph(graph, high, leaf);
}

/// S~ with identities as diagonal blocks.
fn scaled(matrix: &BlockMatrix3, scaling: &BlockJacobi) -> BlockMatrix3 {
    let mut result = matrix.clone();
    for i in 0..matrix.num_rows() {
        for k in matrix.row_starts()[i]..matrix.row_starts()[i + 1] {
            scaling.scale(i, matrix.columns()[k] as usize, &mut result.blocks_mut()[k]);
        }
    }
    result
}

/// The blocks off the diagonal: rows, columns, values.
fn off_diagonal(matrix: &BlockMatrix3) -> impl Iterator<Item = (usize, usize, &[f64; 9])> {
    (0..matrix.num_rows()).flat_map(move |i| {
        let (columns, blocks) = matrix.row(i);
        columns
            .iter()
            .map(|&j| j as usize)
            .zip(blocks)
            .filter(move |&(j, _)| j != i)
            .map(move |(j, b)| (i, j, b))
    })
}

fn energy(matrix: &BlockMatrix3) -> f64 {
    off_diagonal(matrix).map(|(_, _, block)| block.iter().map(|x| x * x).sum::<f64>()).sum()
}

/// Share of the energy in the best train of a rank.
fn captured(matrix: &BlockMatrix3, order: &Order, rank: usize) -> Result<f64, TtError> {
    let entries = off_diagonal(matrix).flat_map(|(i, j, block)| {
        let (row, column) = (3 * order.place[i], 3 * order.place[j]);
        (0..9).map(move |e| (row + e / 3, column + e % 3, block[e]))
    });
    let quadtree = QuadtreeMatrix::from_entries(3 * order.slots, order.levels, entries)?;
    let (_, report) = quadtree.to_train(&Truncation::capped(1e-6, rank))?;
    Ok(1.0 - report.error.powi(2))
}

/// Shares of the energy (inside nodes of about `size` contacts; in a basis of rank `rank` per node; in a
/// train of rank 10 over what the bases leave of the blocks between nodes). The first is exact, the second
/// adds to it, the third is part of the second.
fn per_node(
    matrix: &BlockMatrix3,
    points: &[[f64; 3]],
    size: usize,
    rank: usize,
) -> Result<[f64; 3], Failure> {
    let tree = PointTree::build(points, size, Split::Balanced);
    let node = |contact: usize| tree.positions()[contact] / tree.capacity();
    let slot = |contact: usize| 3 * (tree.positions()[contact] % tree.capacity());
    let (nodes, width) = (1 << tree.depth(), 3 * tree.capacity());
    let total = energy(matrix);
    let mut inside = 0.0;
    let mut coupling: BTreeMap<(usize, usize), Matrix> = BTreeMap::new();
    for (i, j, block) in off_diagonal(matrix) {
        let pair = (node(i), node(j));
        if pair.0 == pair.1 {
            inside += block.iter().map(|x| x * x).sum::<f64>();
            continue;
        }
        let dense = coupling.entry(pair).or_insert_with(|| Matrix::zeros(width, width));
        for e in 0..9 {
            dense.data_mut()[slot(i) + e / 3 + width * (slot(j) + e % 3)] += block[e];
        }
    }
    let mut grams: Vec<Matrix> = (0..nodes).map(|_| Matrix::zeros(width, width)).collect();
    for (&(a, _), block) in &coupling {
        for (sum, x) in grams[a].data_mut().iter_mut().zip(product(block.view(), block.t()).data()) {
            *sum += x;
        }
    }
    let bases = grams
        .iter()
        .map(|gram| {
            let (_, vectors) = symmetric_eigen(gram.view())?;
            let kept = rank.min(width);
            Ok(Matrix::from_fn(width, kept, |i, j| vectors.data()[i + width * (width - 1 - j)]))
        })
        .collect::<Result<Vec<Matrix>, Failure>>()?;
    let mut kept = 0.0;
    let mut entries = Vec::new();
    let kept_rank = rank.min(width);
    for (&(a, b), block) in &coupling {
        let core = product(product(bases[a].t(), block.view()).view(), bases[b].view());
        for (e, &x) in core.data().iter().enumerate() {
            kept += x * x;
            entries.push((kept_rank * a + e % kept_rank, kept_rank * b + e / kept_rank, x));
        }
    }
    let (_, report) = QuadtreeMatrix::from_entries(kept_rank, tree.depth(), entries)?
        .to_train(&Truncation::capped(1e-6, RANKS[0]))?;
    Ok([inside / total, kept / total, kept * (1.0 - report.error.powi(2)) / total])
}

/// Iterations and processor seconds of conjugate gradients with a preconditioner.
fn iterations(
    matrix: &BlockMatrix3,
    b: &[f64],
    precondition: &mut dyn FnMut(&[f64], &mut [f64]),
) -> (usize, f64, f64) {
    let start = Instant::now();
    let begun = clock(start);
    let mut z = vec![0.0; b.len()];
    let settings = KrylovSettings { relative_tolerance: LINEAR_TOLERANCE, max_iterations: LIMIT };
    let mut product = |x: &[f64], y: &mut [f64]| matrix.multiply(x, y);
    let mut work = KrylovWork::default();
    let report = flexible_conjugate_gradient(&mut product, precondition, b, &mut z, settings, &mut work);
    (report.iterations, report.residual, clock(start) - begun)
}

/// Prints what the train adds to an incomplete Cholesky factorisation as coarse correction.
fn coarse_correction(matrix: &BlockMatrix3, points: &[[f64; 3]], b: &[f64]) -> Result<(), Failure> {
    let mut scaling = BlockJacobi::new(3);
    scaling.refresh(matrix)?;
    let mut smoother = IncompleteCholesky::<3, 9>::default();
    smoother.refresh(matrix)?;
    let tree = PointTree::build(points, 1, Split::Balanced);
    let unit = scaled(matrix, &scaling);
    let quadtree =
        QuadtreeMatrix::from_blocks(unit.iter(), tree.positions(), tree.capacity(), tree.depth(), 1.0)?;
    let mut train = TrainInverse::new(TrainSettings {
        compression: Compression::Exact,
        form: InverseForm::Residual,
        tolerance: 1e-2,
        max_rank: 10,
    });
    train.refresh(&quadtree)?;
    let mut buffer = vec![0.0; b.len()];
    let mut coarse = |r: &[f64], z: &mut [f64]| {
        buffer.copy_from_slice(r);
        scaling.solve_lower(&mut buffer);
        train.apply(3, tree.positions(), &buffer, z);
        scaling.solve_upper(z);
    };
    let tell = |name: &str, precondition: &mut dyn FnMut(&[f64], &mut [f64])| {
        let (count, residual, seconds) = iterations(matrix, b, precondition);
        println!("|  | {name} | {count} iterations, {} s, residual {residual:.1e} |  |  |", short(seconds));
    };
    tell("block Jacobi", &mut |r, z| scaling.apply(r, z));
    tell("incomplete Cholesky", &mut |r, z| smoother.apply(r, z));
    tell("train", &mut coarse);
    let (mut rest, mut image, mut step) = (vec![0.0; b.len()], vec![0.0; b.len()], vec![0.0; b.len()]);
    tell("incomplete Cholesky + train (sum)", &mut |r, z| {
        smoother.apply(r, z);
        coarse(r, &mut step);
        z.iter_mut().zip(&step).for_each(|(z, s)| *z += s);
    });
    tell("incomplete Cholesky, train, incomplete Cholesky (product)", &mut |r, z| {
        smoother.apply(r, z);
        for stage in 0..2 {
            matrix.multiply(z, &mut image);
            rest.iter_mut().zip(r.iter().zip(&image)).for_each(|(rest, (r, image))| *rest = r - image);
            if stage == 0 {
                coarse(&rest, &mut step)
            } else {
                smoother.apply(&rest, &mut step)
            }
            z.iter_mut().zip(&step).for_each(|(z, s)| *z += s);
        }
    });
    Ok(())
}

/// Conjugate gradients with block IC(0), and the study of some of its matrices.
struct Studied {
    guide: Box<dyn NewtonSolver>,
    iterations: Vec<usize>,
    stop: Arc<AtomicBool>,
}

impl Studied {
    fn study(&self, system: &NewtonSystem<'_>, b: &[f64]) -> Result<(), Failure> {
        let Some(matrix) = system.matrix else { return Ok(()) };
        let points = contact_points(system.problem);
        let mut scaling = BlockJacobi::new(3);
        scaling.refresh(matrix)?;
        let unit = scaled(matrix, &scaling);
        println!(
            "| {} | energy off the diagonal blocks over that on them | {} |  |  |",
            system.iteration,
            short(energy(&unit) / (3.0 * unit.num_rows() as f64))
        );
        for leaf in LEAVES {
            for order in orders(&points, matrix, leaf) {
                let shares = RANKS
                    .iter()
                    .map(|&rank| Ok(format!("{:.3}", captured(&unit, &order, rank)?)))
                    .collect::<Result<Vec<String>, TtError>>()?;
                println!("|  | {}, {} per leaf | {} |  |", order.name, order.slots, shares.join(" | "));
            }
        }
        for size in NODES {
            for rank in RANKS {
                let [inside, kept, shared] = per_node(&unit, &points, size, rank)?;
                println!(
                    "|  | nodes of {size}, bases of rank {rank} each | inside {inside:.3} | bases {kept:.3} | train over them {shared:.3} |"
                );
            }
        }
        coarse_correction(matrix, &points, b)
    }
}

impl NewtonSolver for Studied {
    fn name(&self) -> &'static str {
        self.guide.name()
    }

    fn form(&self) -> Form {
        self.guide.form()
    }

    fn needs_matrix(&self) -> bool {
        true
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        self.guide.refresh(system)
    }

    fn solve(&mut self, system: &NewtonSystem<'_>, b: &[f64], z: &mut [f64], tolerance: f64) -> LinearReport {
        if self.iterations.contains(&system.iteration) {
            if let Err(error) = self.study(system, b) {
                println!("|  | {error} |");
            }
            if self.iterations.last() == Some(&system.iteration) {
                self.stop.store(true, Ordering::Relaxed);
            }
        }
        self.guide.solve(system, b, z, tolerance)
    }
}

/// Studies the matrices of these Newton iterations, ascending.
pub fn orders_of(name: &str, iterations: &[usize]) -> Result<(), Failure> {
    let problem = problem(name)?;
    println!(
        "| iteration | {} contacts | rank {} | rank {} |  |\n|---|---|---|---|---|",
        problem.num_contacts(),
        RANKS[0],
        RANKS[1]
    );
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let stop = Arc::new(AtomicBool::new(false));
    let studied = Studied {
        guide: LinearMethod::IncompleteCholesky.build()?,
        iterations: iterations.to_vec(),
        stop: stop.clone(),
    };
    let settings = SolveSettings { tolerance: TOLERANCE, stop: Some(stop), ..SolveSettings::default() };
    let mut impulse = vec![0.0; 3 * problem.num_contacts()];
    pool.install(|| {
        Pdip::with_solver(Rule::Central, Box::new(studied)).solve(&problem, &mut impulse, &settings)
    })?;
    Ok(())
}
