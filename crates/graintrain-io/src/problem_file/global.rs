//! From the global form, M v = H r + f and u = H^T v + w, to a CCP: N = H^T M^-1 H, r = w + H^T M^-1 f.
//!
//! Where M and H are those of rigid bodies the bodies are kept ([`super::rigid`]). Otherwise N is condensed:
//! M falls apart into independent blocks (one per deformable body); with M_c = L L^T and Y = L^-1 H_c, N is
//! the sum of Y^T Y. Where M is noticeably asymmetric N = H^T M^-1 H is, too, and as W is of the local form
//! it is kept beside its symmetric part; with equality constraints M is made symmetric first.

use super::NOTICEABLE_ASYMMETRY;
use super::dense;
use super::error::{Defect, WRITE_AGAIN};
use super::local::{add_low_rank, as_filed, symmetric_blocks};
use super::matrix::{Entry, Matrix};
use super::raw::GlobalForm;
use super::rigid::{self, Bodies};
use graintrain_ccp::{Delassus, RigidDelassus};
use graintrain_linalg::dense::{Lu, Matrix as DenseMatrix, ViewMut};

/// Largest independent block of M that is factorised densely, degrees of freedom.
const LARGEST_BLOCK: usize = 4000;
/// Most contacts that equality constraints may couple with each other.
const LARGEST_COUPLING: usize = 2000;

/// N, r, and what else the matrices tell.
pub(super) struct Reduced {
    pub(super) delassus: Delassus,
    /// N itself where it is noticeably asymmetric.
    pub(super) as_filed: Option<Delassus>,
    pub(super) r: Vec<f64>,
    /// Contact points relative to each other, where bodies were recognised.
    pub(super) points: Vec<[f64; 3]>,
    pub(super) bodies: usize,
    /// max |M - M^T| / max |M|.
    pub(super) asymmetry: f64,
}

impl Reduced {
    /// The problem of bodies that are known, r = w.
    pub(super) fn from_bodies(bodies: RigidDelassus, w: Vec<f64>) -> Self {
        Self {
            bodies: bodies.num_bodies(),
            delassus: Delassus::Rigid(bodies),
            as_filed: None,
            r: w,
            points: Vec::new(),
            asymmetry: 0.0,
        }
    }
}

/// The CCP of a global problem.
pub(super) fn reduce(global: &GlobalForm, rolls: bool) -> Result<Reduced, Defect> {
    let asymmetry = global.m.asymmetry();
    let ht = global.h.transposed();
    let is_asymmetric = asymmetry > NOTICEABLE_ASYMMETRY && global.equalities.is_none();
    // Rows of rolling friction have no bodies to be recognised by: `rolls` says that there are some.
    if global.equalities.is_none()
        && !rolls
        && !is_asymmetric
        && let Some(Bodies { delassus, free_velocity }) = rigid::recognise(&global.m, &ht, &global.f)?
    {
        let r = global.w.iter().zip(free_velocity).map(|(w, u)| w + u).collect();
        let points = rigid::relative_points(&delassus);
        let bodies = delassus.num_bodies();
        let delassus = Delassus::Rigid(delassus);
        return Ok(Reduced { delassus, as_filed: None, r, points, bodies, asymmetry });
    }
    let blocks = independent_blocks(&global.m);
    let (w, r) = condense(global, &ht, &blocks, is_asymmetric)?;
    let delassus = Delassus::Sparse(symmetric_blocks(&w));
    let as_filed = is_asymmetric.then(|| as_filed(&w));
    let bodies = count_bodies(&blocks, global.m.rows);
    Ok(Reduced { delassus, as_filed, r, points: Vec::new(), bodies, asymmetry })
}

/// Degrees of freedom of each block of M that is coupled to no other, ascending.
fn independent_blocks(m: &Matrix) -> Vec<Vec<usize>> {
    let mut parent: Vec<usize> = (0..m.rows).collect();
    fn root(parent: &mut [usize], mut k: usize) -> usize {
        while parent[k] != k {
            parent[k] = parent[parent[k]];
            k = parent[k];
        }
        k
    }
    for entry in &m.entries {
        let (a, b) = (root(&mut parent, entry.row), root(&mut parent, entry.column));
        parent[a.max(b)] = a.min(b);
    }
    let mut index = vec![usize::MAX; m.rows];
    let mut blocks: Vec<Vec<usize>> = Vec::new();
    for k in 0..m.rows {
        let first = root(&mut parent, k);
        if first == k {
            index[k] = blocks.len();
            blocks.push(Vec::new());
        }
        blocks[index[first]].push(k);
    }
    blocks
}

/// Number of bodies: six degrees of freedom each where M couples no others, else one per independent block.
fn count_bodies(blocks: &[Vec<usize>], freedoms: usize) -> usize {
    let rigid = freedoms.is_multiple_of(6)
        && blocks.iter().all(|block| block.iter().all(|&freedom| freedom / 6 == block[0] / 6));
    if rigid { freedoms / 6 } else { blocks.len() }
}

/// N and r, the independent blocks of M one after the other.
fn condense(
    global: &GlobalForm,
    ht: &Matrix,
    blocks: &[Vec<usize>],
    is_asymmetric: bool,
) -> Result<(Matrix, Vec<f64>), Defect> {
    // Columns of H, of G and f of one block of M, as rows of length block size.
    let mut place = vec![(0, 0); global.m.rows];
    for (b, block) in blocks.iter().enumerate() {
        for (k, &freedom) in block.iter().enumerate() {
            place[freedom] = (b, k);
        }
    }
    let mut h_rows: Vec<Vec<(usize, Vec<f64>)>> = vec![Vec::new(); blocks.len()];
    spread(ht, &place, blocks, &mut h_rows);
    let mut g_rows: Vec<Vec<(usize, Vec<f64>)>> = vec![Vec::new(); blocks.len()];
    let constraints = global.equalities.as_ref().map_or(0, |equalities| equalities.b.len());
    if let Some(equalities) = &global.equalities {
        spread(&equalities.g.transposed(), &place, blocks, &mut g_rows);
    }

    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut r = global.w.clone();
    let mut entries = Vec::new();
    // X = H^T M^-1 G, S = G^T M^-1 G, s = b + G^T M^-1 f.
    let mut x_entries = Vec::new();
    let mut schur = vec![0.0; constraints * constraints];
    let mut s = global.equalities.as_ref().map_or(Vec::new(), |equalities| equalities.b.clone());
    for (b, block) in blocks.iter().enumerate() {
        let n = block.len();
        let (h_rows, g_rows) = (&mut h_rows[b], &mut g_rows[b]);
        if h_rows.is_empty() && g_rows.is_empty() {
            continue;
        }
        if n > LARGEST_BLOCK {
            return Err(Defect::unsupported(
                format!("a mass matrix M with {n} degrees of freedom coupled to each other"),
                "write the problem in its local form (W, q, mu) instead",
            ));
        }
        let factor = factorise(&global.m, block, &place, is_asymmetric)?;
        let mut y_f: Vec<f64> = block.iter().map(|&freedom| global.f[freedom]).collect();
        factor.solve(&mut y_f);
        // Columns of H to the left of M^-1 H, where Y is not both.
        let left = is_asymmetric.then(|| h_rows.clone());
        h_rows.iter_mut().chain(g_rows.iter_mut()).for_each(|(_, y)| factor.solve(y));
        for (row, y) in left.as_ref().unwrap_or(h_rows) {
            r[*row] += dot(y, &y_f);
            let entry =
                |(column, z): &(usize, Vec<f64>)| Entry { row: *row, column: *column, value: dot(y, z) };
            entries.extend(h_rows.iter().map(entry));
            x_entries.extend(g_rows.iter().map(entry));
        }
        for (row, y) in g_rows.iter() {
            s[*row] += dot(y, &y_f);
            for (column, z) in g_rows.iter() {
                schur[row * constraints + column] += dot(y, z);
            }
        }
    }
    let w = Matrix::new("H^T M^-1 H", r.len(), r.len(), entries)?;
    if constraints == 0 {
        return Ok((w, r));
    }
    let x = Matrix::new("H^T M^-1 G", r.len(), constraints, x_entries)?;
    let mut coupled: Vec<usize> = x.entries.iter().map(|entry| entry.row / 3).collect();
    coupled.dedup();
    if coupled.len() > LARGEST_COUPLING {
        return Err(Defect::unsupported(
            format!("equality constraints that couple {} contacts with each other", coupled.len()),
            "eliminate the equality constraints before writing the problem",
        ));
    }
    let Some(factor) = dense::cholesky(schur, constraints) else {
        return Err(Defect::unsupported(
            "redundant equality constraints (G^T M^-1 G is singular)",
            "leave the redundant constraints out before writing the problem",
        ));
    };
    add_low_rank(w, r, &x, &s, &factor, -1.0)
}

/// Distributes the rows of a matrix over the blocks of M: entry (row, freedom) goes to `rows[block]`.
fn spread(
    matrix: &Matrix,
    place: &[(usize, usize)],
    blocks: &[Vec<usize>],
    rows: &mut [Vec<(usize, Vec<f64>)>],
) {
    for entry in &matrix.entries {
        let (block, k) = place[entry.column];
        let rows = &mut rows[block];
        if rows.last().is_none_or(|&(row, _)| row != entry.row) {
            rows.push((entry.row, vec![0.0; blocks[block].len()]));
        }
        let last = rows.len() - 1;
        rows[last].1[k] = entry.value;
    }
}

/// An independent block M_c of M, to be solved with.
enum Factor {
    /// L L^T = (M_c + M_c^T) / 2, and the size.
    Lower(Vec<f64>, usize),
    /// Of M_c as it is.
    General(Lu),
}

impl Factor {
    /// y <- L^-1 y, or M_c^-1 y.
    fn solve(&self, y: &mut [f64]) {
        match self {
            Self::Lower(factor, n) => dense::solve_lower(factor, *n, y),
            Self::General(lu) => {
                let n = y.len();
                lu.solve_in_place(ViewMut::new(y, n, 1));
            }
        }
    }
}

/// Factors of M_c, whose symmetric part has to be positive definite.
fn factorise(
    m: &Matrix,
    block: &[usize],
    place: &[(usize, usize)],
    is_asymmetric: bool,
) -> Result<Factor, Defect> {
    let n = block.len();
    let entries = || {
        let of_row = |(k, &freedom)| m.rows_in(freedom..freedom + 1).iter().map(move |entry| (k, entry));
        block.iter().enumerate().flat_map(of_row).map(|(k, entry)| (k, place[entry.column].1, entry.value))
    };
    let mut a = vec![0.0; n * n];
    for (k, l, value) in entries() {
        a[k * n + l] += 0.5 * value;
        a[l * n + k] += 0.5 * value;
    }
    let damaged = |what| Defect::damaged("the mass matrix M", what, WRITE_AGAIN);
    let Some(lower) = dense::cholesky(a, n) else {
        return Err(damaged(format!("is not positive definite (block of degree of freedom {})", block[0])));
    };
    if !is_asymmetric {
        return Ok(Factor::Lower(lower, n));
    }
    let mut general = DenseMatrix::zeros(n, n);
    entries().for_each(|(k, l, value)| general[(k, l)] = value);
    Lu::new(general).map(Factor::General).map_err(|error| damaged(error.to_string()))
}
