//! Newton systems that are not contact: a sparse quadratic program over second-order cones.
//!
//! The quadratic program `min 1/2 x^T A x - b^T x, x_i in { |(x_1, x_2)| <= x_0 }` with a sparse positive
//! definite A that has nothing to do with bodies uses the same interior point, and every linear solver of the
//! Newton layer.
//!
//! `cargo run --example conic_qp`

use graintrain_ccp::{Ccp, Delassus, SolveSettings, SolverSpec};
use graintrain_linalg::block3::BlockMatrix3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A: a chain of 3-vectors, each coupled to its neighbours like a discrete Laplacian.
    let nodes = 200;
    let (mut start, mut column, mut blocks) = (vec![0], Vec::new(), Vec::new());
    for i in 0_usize..nodes {
        for j in i.saturating_sub(1)..(i + 2).min(nodes) {
            column.push(j as u32);
            let value = if i == j { 2.01 } else { -1.0 };
            blocks.push([value, 0.0, 0.0, 0.0, value, 0.0, 0.0, 0.0, value]);
        }
        start.push(column.len());
    }
    let matrix = BlockMatrix3::try_from_rows(start, column, blocks)?;
    let b: Vec<f64> = (0..3 * nodes).map(|k| f64::sin(0.11 * k as f64)).collect();
    let problem = Ccp::new(Delassus::Sparse(matrix), b.iter().map(|b| -b).collect(), vec![1.0; nodes])?;

    for name in ["ipm+cholesky", "ipm+ic", "ipm+block-jacobi", "pdip+cholesky", "pdip+ilu", "pdip+tt"] {
        let mut x = vec![0.0; 3 * nodes];
        let settings = SolveSettings { tolerance: 1e-6, ..SolveSettings::default() };
        let report = name.parse::<SolverSpec>()?.build()?.solve(&problem, &mut x, &settings)?;
        println!(
            "{name}: {:?} after {} Newton steps and {} inner iterations, objective {:.9}",
            report.status, report.iterations, report.linear_iterations, report.objective
        );
    }
    Ok(())
}
