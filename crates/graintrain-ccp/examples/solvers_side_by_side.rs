//! Solvers side by side: one problem, every solver by name, and the same residual for all.
//!
//! `cargo run --release -p graintrain-ccp --features paper --example solvers_side_by_side` (without the
//! feature: those that runs use)

use graintrain_ccp::registry::Method;
use graintrain_ccp::{BodyInverseMass, Ccp, Delassus, FIXED, RigidContact, RigidDelassus};
use graintrain_ccp::{SolveSettings, SolverSpec};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A column of 20 balls of radius 0.1 m and 1 kg each: contact k between ball k and the one below.
    let ball =
        BodyInverseMass { linear: [1.0; 3], angular: [250.0, 0.0, 0.0, 0.0, 250.0, 0.0, 0.0, 0.0, 250.0] };
    let contact = |k: u32| RigidContact {
        body_a: k,
        body_b: if k == 0 { FIXED } else { k - 1 },
        frame: [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        arm_a: [0.0, 0.0, -0.1],
        arm_b: [0.0, 0.0, if k == 0 { 0.0 } else { 0.1 }],
    };
    let delassus = Delassus::Rigid(RigidDelassus::new((0..20).map(contact).collect(), vec![ball; 20]));
    // One step of 10 ms under gravity: only the lowest ball approaches something at rest.
    let mut r = vec![0.0; 60];
    r[0] = -0.0981;
    r[1] = 0.01;
    let problem = Ccp::new(delassus, r, vec![0.3; 20])?;
    for method in Method::available() {
        let mut impulse = vec![0.0; 60];
        let settings = SolveSettings { tolerance: 1e-6, ..SolveSettings::default() };
        let report =
            method.name().parse::<SolverSpec>()?.build()?.solve(&problem, &mut impulse, &settings)?;
        let (status, iterations, residual) = (report.status, report.iterations, report.residual.max);
        println!("{:12} {status:?}: {iterations} iterations, residual {residual:.1e}", method.name());
    }
    Ok(())
}
