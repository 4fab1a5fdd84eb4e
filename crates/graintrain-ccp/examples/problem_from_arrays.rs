//! A contact problem from arrays: a ball on the ground and at a wall, as the entries of a matrix, solved in
//! both models.
//!
//! `cargo run --release -p graintrain-ccp --example problem_from_arrays`

use graintrain_ccp::{Ccp, FrictionModel, SolveSettings, SolverSpec};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // N, rows and columns (normal, tangent 1, tangent 2) of the ground (z, x, y) and of the wall (-x, z, y).
    // The ball is solid, of 1 kg: along a tangent it moves and turns, 1 + 5/2.
    let n = [
        [1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        [0.0, 3.5, 0.0, -1.0, 2.5, 0.0],
        [0.0, 0.0, 3.5, 0.0, 0.0, 1.0],
        [0.0, -1.0, 0.0, 1.0, 0.0, 0.0],
        [1.0, 2.5, 0.0, 0.0, 3.5, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 3.5],
    ];
    let entries: Vec<_> = (0..36).map(|k| (k / 6, k % 6, n[k / 6][k % 6])).collect();
    // Relative velocities without contact, m/s: the ball falls, and moves into the wall.
    let r = vec![-0.1, 0.2, 0.05, -0.2, -0.1, 0.05];
    let problem = Ccp::from_triplets(&entries, r, vec![0.3, 0.3])?;
    let mut solver = "ipm".parse::<SolverSpec>()?.build()?;
    for friction in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
        let mut impulse = vec![0.0; 6];
        let settings = SolveSettings { tolerance: 1e-8, friction, ..SolveSettings::default() };
        let report = solver.solve(&problem, &mut impulse, &settings)?;
        println!("{friction:?}: {:?}, residual {:.1e}", report.status, report.residual.max);
        for g in impulse.chunks(3) {
            println!("  normal {:.6} N s, friction {:.6} N s", g[0], g[1].hypot(g[2]));
        }
    }
    Ok(())
}
