//! Fill-reducing orderings of symmetric sparse matrices: approximate minimum degree and multilevel nested
//! dissection.

use crate::bisection::separate;

/// Undirected graph of a symmetric matrix: the neighbours of every vertex, without the vertex itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Graph {
    start: Vec<usize>,
    neighbour: Vec<u32>,
}

/// How to order the rows and columns of a symmetric matrix before it is factorised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ordering {
    /// As the matrix comes.
    Natural,
    /// Approximate minimum degree (Amestoy, Davis, Duff 1996): good for small and for nearly planar graphs.
    MinimumDegree,
    /// Multilevel nested dissection (George 1973; Karypis and Kumar 1998): good for large graphs in three
    /// dimensions.
    #[default]
    NestedDissection,
}

/// Parts of at most this many vertices are ordered by minimum degree.
const LEAF: usize = 48;

impl Graph {
    /// Graph of a matrix in compressed row form whose pattern is symmetric; diagonal entries are left out.
    ///
    /// # Panics
    /// If a column index is not below the number of rows.
    pub fn from_rows(row_start: &[usize], column: &[u32]) -> Self {
        let vertices = row_start.len() - 1;
        let mut start = Vec::with_capacity(vertices + 1);
        let mut neighbour = Vec::with_capacity(column.len());
        start.push(0);
        for v in 0..vertices {
            let row = &column[row_start[v]..row_start[v + 1]];
            assert!(row.iter().all(|&u| (u as usize) < vertices), "columns are below the number of rows");
            neighbour.extend(row.iter().copied().filter(|&u| u as usize != v));
            start.push(neighbour.len());
        }
        Self { start, neighbour }
    }

    /// Graph of a symmetric matrix in compressed row form of which each pair of mirrored entries needs only
    /// the lower one (column < row); upper ones are not looked at.
    ///
    /// # Panics
    /// If the row starts do not fit the columns.
    pub fn of_lower(row_start: &[usize], column: &[u32]) -> Self {
        let rows = row_start.len() - 1;
        let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); rows];
        for i in 0..rows {
            for &j in &column[row_start[i]..row_start[i + 1]] {
                if (j as usize) < i {
                    neighbours[i].push(j);
                    neighbours[j as usize].push(i as u32);
                }
            }
        }
        let mut start = vec![0];
        for list in &mut neighbours {
            list.sort_unstable();
            start.push(start[start.len() - 1] + list.len());
        }
        Self::from_rows(&start, &neighbours.concat())
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.start.len() - 1
    }

    /// Whether the graph has no vertices.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Neighbours of vertex v.
    pub fn neighbours(&self, v: usize) -> &[u32] {
        &self.neighbour[self.start[v]..self.start[v + 1]]
    }

    /// Subgraph of the listed vertices, renumbered in the order of the list. `local` has one entry per vertex
    /// of this graph, all `u32::MAX`, and is left so.
    fn induced(&self, vertices: &[u32], local: &mut [u32]) -> Self {
        for (new, &old) in vertices.iter().enumerate() {
            local[old as usize] = new as u32;
        }
        let mut start = Vec::with_capacity(vertices.len() + 1);
        let mut neighbour = Vec::new();
        start.push(0);
        for &old in vertices {
            neighbour.extend(
                self.neighbours(old as usize).iter().map(|&u| local[u as usize]).filter(|&u| u != u32::MAX),
            );
            start.push(neighbour.len());
        }
        for &old in vertices {
            local[old as usize] = u32::MAX;
        }
        Self { start, neighbour }
    }
}

impl Ordering {
    /// The order of elimination: entry k is the vertex eliminated as the k-th.
    pub fn order(self, graph: &Graph) -> Vec<u32> {
        match self {
            Self::Natural => (0..graph.len() as u32).collect(),
            Self::MinimumDegree => minimum_degree(graph),
            Self::NestedDissection => nested_dissection(graph),
        }
    }
}

/// Approximate minimum degree order of a graph.
pub fn minimum_degree(graph: &Graph) -> Vec<u32> {
    use faer::dyn_stack::{MemBuffer, MemStack};
    use faer::sparse::SymbolicSparseColMatRef;
    use faer::sparse::linalg::amd;

    let n = graph.len();
    let column_start: Vec<usize> = graph.start.clone();
    let row: Vec<usize> = graph.neighbour.iter().map(|&u| u as usize).collect();
    let (mut forward, mut inverse) = (vec![0_usize; n], vec![0_usize; n]);
    let pattern = SymbolicSparseColMatRef::new_unsorted_checked(n, n, &column_start, None, &row);
    let mut memory = MemBuffer::new(amd::order_maybe_unsorted_scratch::<usize>(n, row.len()));
    let ordered = amd::order_maybe_unsorted(
        &mut forward,
        &mut inverse,
        pattern,
        amd::Control::default(),
        MemStack::new(&mut memory),
    );
    match ordered {
        Ok(_) => forward.into_iter().map(|v| v as u32).collect(),
        // Only an overflow of the index type ends here; any order is a correct one.
        Err(_) => (0..n as u32).collect(),
    }
}

/// Nested dissection: a small vertex separator splits the graph in two parts, which are ordered first, each
/// in the same way; the separator comes last.
///
/// Separators are found by the multilevel method of `separate`. Cost O(edges x log vertices).
pub fn nested_dissection(graph: &Graph) -> Vec<u32> {
    let mut order = vec![0_u32; graph.len()];
    let mut local = vec![u32::MAX; graph.len()];
    // Parts still to be ordered, each with the position where its order begins.
    let mut parts = vec![(0_usize, (0..graph.len() as u32).collect::<Vec<u32>>())];
    while let Some((first, vertices)) = parts.pop() {
        let part = graph.induced(&vertices, &mut local);
        if vertices.len() <= LEAF {
            for (k, v) in minimum_degree(&part).into_iter().enumerate() {
                order[first + k] = vertices[v as usize];
            }
            continue;
        }
        let side = separate(&part);
        let chosen = |wanted: u8| -> Vec<u32> {
            (0..vertices.len()).filter(|&v| side[v] == wanted).map(|v| vertices[v]).collect()
        };
        let (left, right, separator) = (chosen(0), chosen(1), chosen(2));
        if left.is_empty() && right.is_empty() || separator.len() == vertices.len() {
            order[first..first + vertices.len()].copy_from_slice(&vertices);
            continue;
        }
        let last = first + left.len() + right.len();
        order[last..last + separator.len()].copy_from_slice(&separator);
        let middle = first + left.len();
        for (first, part) in [(first, left), (middle, right)] {
            if !part.is_empty() {
                parts.push((first, part));
            }
        }
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Graph of the 7-point stencil on a cube of `side`^3 points.
    fn cube(side: usize) -> Graph {
        let (mut start, mut column) = (vec![0], Vec::new());
        for z in 0..side {
            for y in 0..side {
                for x in 0..side {
                    let mut visit = |dx: isize, dy: isize, dz: isize| {
                        let p = [x as isize + dx, y as isize + dy, z as isize + dz];
                        if p.iter().all(|&c| c >= 0 && c < side as isize) {
                            column
                                .push(((p[2] as usize * side + p[1] as usize) * side + p[0] as usize) as u32);
                        }
                    };
                    for (dx, dy, dz) in
                        [(0, 0, -1), (0, -1, 0), (-1, 0, 0), (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
                    {
                        visit(dx, dy, dz);
                    }
                    start.push(column.len());
                }
            }
        }
        Graph::from_rows(&start, &column)
    }

    fn is_permutation(order: &[u32]) -> bool {
        let mut sorted = order.to_vec();
        sorted.sort_unstable();
        sorted.iter().enumerate().all(|(k, &v)| k as u32 == v)
    }

    /// Entries of the Cholesky factor, counted by brute force elimination.
    fn fill(graph: &Graph, order: &[u32]) -> usize {
        let n = graph.len();
        let mut position = vec![0; n];
        for (k, &v) in order.iter().enumerate() {
            position[v as usize] = k;
        }
        let mut rows: Vec<std::collections::BTreeSet<usize>> = vec![Default::default(); n];
        for v in 0..n {
            for &u in graph.neighbours(v) {
                if position[u as usize] > position[v] {
                    rows[position[v]].insert(position[u as usize]);
                }
            }
        }
        let mut total = n;
        for k in 0..n {
            total += rows[k].len();
            let later: Vec<usize> = rows[k].iter().copied().collect();
            if let Some((&parent, rest)) = later.split_first() {
                rows[parent].extend(rest);
            }
        }
        total
    }

    #[test]
    fn orders_are_permutations_and_reduce_fill() {
        let graph = cube(12);
        let natural = fill(&graph, &Ordering::Natural.order(&graph));
        for ordering in [Ordering::MinimumDegree, Ordering::NestedDissection] {
            let order = ordering.order(&graph);
            assert!(is_permutation(&order));
            let filled = fill(&graph, &order);
            assert!(5 * filled < 2 * natural, "{ordering:?}: {filled} of {natural}");
        }
    }

    #[test]
    fn graphs_without_edges_and_complete_graphs_are_ordered() {
        let isolated = Graph::from_rows(&vec![0; 201], &[]);
        let complete_rows: Vec<usize> = (0..=100).map(|v| 100 * v).collect();
        let complete_columns: Vec<u32> = (0..100).flat_map(|_| 0..100).collect();
        let complete = Graph::from_rows(&complete_rows, &complete_columns);
        for graph in [isolated, complete, Graph::from_rows(&[0], &[])] {
            for ordering in [Ordering::Natural, Ordering::MinimumDegree, Ordering::NestedDissection] {
                let order = ordering.order(&graph);
                assert_eq!(order.len(), graph.len());
                assert!(is_permutation(&order));
            }
        }
    }
}
