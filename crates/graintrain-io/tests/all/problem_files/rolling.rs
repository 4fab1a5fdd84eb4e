//! Problems with rolling friction, measured in the units and by the numbers of their files, read again here.

use super::by_hand::{dot, solve};
use super::data;
use graintrain_ccp::{FrictionModel, SolveSettings, SolverSpec};
use graintrain_io::problem_file::{self, Form, ProblemFile};
use std::path::Path;

/// Velocities of impulses, with the matrix as it is in the file or, where friction is relaxed, its symmetric
/// part.
type VelocityOf = dyn Fn(&[f64], FrictionModel) -> Vec<f64>;

/// Five rows per contact: velocities of given impulses, and the coefficients.
struct AsFiled {
    velocity: Box<VelocityOf>,
    mu: Vec<f64>,
    mu_r: Vec<f64>,
    /// Root mean square of the free velocities of the contacts, and largest inverse mass in W.
    velocity_scale: f64,
    inverse_mass: f64,
}

impl AsFiled {
    fn new(velocity: Box<VelocityOf>, mu: Vec<f64>, mu_r: Vec<f64>) -> Self {
        let size = 5 * mu.len();
        let velocity_of = |r: &[f64]| velocity(r, FrictionModel::Coulomb);
        let free = velocity_of(&vec![0.0; size]);
        let mut inverse_mass = 0.0_f64;
        for k in (0..size).filter(|k| k % 5 < 3) {
            let mut unit = vec![0.0; size];
            unit[k] = 1.0;
            inverse_mass = inverse_mass.max(velocity_of(&unit)[k] - free[k]);
        }
        let square: f64 = free.chunks_exact(5).map(|u| dot(&u[..3], &u[..3])).sum();
        let velocity_scale = (square / mu.len() as f64).sqrt();
        Self { velocity, mu, mu_r, velocity_scale, inverse_mass }
    }

    /// How far impulses and moments are from the laws, relative to the scales: in their discs, contacts part,
    /// and both leave nothing over: r . u + (mu |u_t| + mu_r |w|) r_n = 0 where friction is exact.
    fn violation(&self, r: &[f64], friction: FrictionModel) -> f64 {
        let u = (self.velocity)(r, friction);
        let mut worst = 0.0_f64;
        for (i, (r, u)) in r.chunks_exact(5).zip(u.chunks_exact(5)).enumerate() {
            let (sliding, rolling) = (self.mu[i] * u[1].hypot(u[2]), self.mu_r[i] * u[3].hypot(u[4]));
            let impulse = |excess: f64| excess * self.inverse_mass / self.velocity_scale;
            worst = worst.max(impulse(r[1].hypot(r[2]) - self.mu[i] * r[0]));
            worst = worst.max(impulse((r[3].hypot(r[4]) - self.mu_r[i] * r[0]) / self.mu_r[i]));
            let exact = friction == FrictionModel::Coulomb;
            let normal = u[0] + if exact { sliding + rolling } else { 0.0 };
            worst = worst.max((sliding + rolling - normal) / self.velocity_scale);
            let left: f64 = normal * r[0] + dot(&r[1..], &u[1..]);
            worst = worst.max(impulse(left.abs() / self.velocity_scale));
        }
        worst
    }
}

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace().map(|word| word.parse().unwrap()).collect()
}

/// The text of Siconos with a dense W.
fn read_text(path: &Path) -> AsFiled {
    let all = numbers(&std::fs::read_to_string(path).unwrap());
    let (contacts, size) = (all[1] as usize, 5 * all[1] as usize);
    let rest = &all[7..];
    let w: Vec<f64> = rest[..size * size].to_vec();
    let q = rest[size * size..][..size].to_vec();
    let coefficients = &rest[size * size + size..];
    let velocity = move |r: &[f64], _: FrictionModel| {
        // Column by column, and symmetric.
        (0..size).map(|i| q[i] + (0..size).map(|j| w[j * size + i] * r[j]).sum::<f64>()).collect()
    };
    AsFiled::new(
        Box::new(velocity),
        coefficients[..contacts].to_vec(),
        coefficients[contacts..2 * contacts].to_vec(),
    )
}

/// The global form of FCLIB in triplets, W by elimination.
fn read_hdf5(path: &Path) -> AsFiled {
    let file = hdf5_pure::File::from_bytes(std::fs::read(path).unwrap()).unwrap();
    let read =
        |name: &str| file.dataset(&format!("fclib_global_rolling/{name}")).unwrap().read_f64().unwrap();
    let dense = |name: &str| {
        let [m, n, i, p, x] = ["m", "n", "i", "p", "x"].map(|part| read(&format!("{name}/{part}")));
        let mut matrix = vec![vec![0.0; n[0] as usize]; m[0] as usize];
        for ((i, p), x) in i.iter().zip(&p).zip(&x) {
            matrix[*i as usize][*p as usize] += x;
        }
        matrix
    };
    let (m, h) = (dense("M"), dense("H"));
    let [f, w, mu, mu_r] = ["f", "w", "mu", "mu_r"].map(|name| read(&format!("vectors/{name}")));
    let size = w.len();
    let column = |k: usize| h.iter().map(|row| row[k]).collect::<Vec<f64>>();
    let columns: Vec<Vec<f64>> = (0..size).map(column).collect();
    let moved: Vec<Vec<f64>> = columns.iter().chain([&f]).map(|b| solve(&m, b)).collect();
    let velocity = move |r: &[f64], friction: FrictionModel| {
        let along = |j: usize| w[j] + dot(&columns[j], &moved[size]);
        // M of the chute is symmetric to 1e-6 of its largest entry only, which is 0.2 % of W.
        let entry = |j: usize, k: usize| match (dot(&columns[j], &moved[k]), friction) {
            (filed, FrictionModel::Coulomb) => filed,
            (filed, FrictionModel::Relaxed) => 0.5 * (filed + dot(&columns[k], &moved[j])),
        };
        let product = |j: usize| (0..size).map(|k| r[k] * entry(j, k)).sum::<f64>();
        (0..size).map(|j| along(j) + product(j)).collect()
    };
    AsFiled::new(Box::new(velocity), mu, mu_r)
}

/// Five rows per contact of impulses in block rows.
fn five_rows(file: &ProblemFile, g: &[f64]) -> Vec<f64> {
    let contacts = file.problem.num_contacts();
    (0..contacts)
        .flat_map(|i| {
            let (h, length) = (&g[3 * (contacts + i)..], file.turning_length[i]);
            [g[3 * i], g[3 * i + 1], g[3 * i + 2], h[1] * length, h[2] * length]
        })
        .collect()
}

#[test]
fn public_problems_with_rolling_friction_are_solved() {
    let Some(data) = data() else { return };
    for (name, contacts, form) in [
        ("RFC3D_sphere_1.dat", 1, Form::Local),
        ("RFC3D_cube_1.dat", 2, Form::Local),
        ("Chute-ndof-768-nc-4-3.hdf5", 4, Form::Condensed),
    ] {
        let path = data.join("fclib").join(name);
        let file = problem_file::read(&path).unwrap();
        assert_eq!(
            (file.problem.num_contacts(), file.problem.turning.len(), file.form),
            (contacts, contacts, form)
        );
        let filed = if form == Form::Local { read_text(&path) } else { read_hdf5(&path) };
        for friction in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
            for solver in ["auto", "apgd", "apgs", "pgs"] {
                let problem = file.posed(friction);
                let mut g = vec![0.0; problem.r.len()];
                let settings = SolveSettings { tolerance: 1e-8, friction, ..SolveSettings::default() };
                let mut by = solver.parse::<SolverSpec>().unwrap().build().unwrap();
                let report = by.solve(problem, &mut g, &settings).unwrap();
                let found = filed.violation(&five_rows(&file, &g), friction);
                println!(
                    "{name}, {solver}, {friction}: {} iterations, violation {found:.1e}",
                    report.iterations
                );
                assert!(report.converged(), "{name} {solver} {friction}: {report:?}");
                assert!(found < 1e-6, "{name} {solver} {friction}: {found:e}");
                let rolls = five_rows(&file, &g).chunks_exact(5).any(|r| r[3] != 0.0 || r[4] != 0.0);
                assert!(rolls || g.iter().all(|&g| g == 0.0), "{name} has no moment");
            }
        }
    }
}

/// Two balls on the ground and on each other, thrown and turning.
fn rolling_step(spinning: f64) -> graintrain::stepper::Stepper {
    use graintrain::handle::MaterialId;
    use graintrain::material::{Materials, TurningResistance};
    use graintrain::math::Vec3;
    use graintrain::motion::Motion;
    use graintrain::shape::Geometry;
    use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
    use graintrain::world::{Body, World};
    let stuff = MaterialId::default();
    let mut materials = Materials::single("stuff", 1000.0, 0.5, 0.0).unwrap();
    let turning = [0.1, spinning].map(TurningResistance::Ratio);
    materials.set_pair_turning(stuff, stuff, turning[0], turning[1]).unwrap();
    let mut world = World::new(Vec3::new(0.0, 0.0, -9.81), materials).unwrap();
    let [plane, ball] = [Geometry::plane(), Geometry::sphere(0.1).unwrap()].map(|g| world.add_geometry(g));
    let motion = world.add_motion(Motion::fixed()).unwrap();
    world.add_body(Body { motion, ..Body::new(plane, stuff, Vec3::ZERO) }).unwrap();
    for x in [0.0, 0.2] {
        let body = Body {
            velocity: Vec3::new(1.0 - x, 0.5, 0.0),
            angular_velocity: Vec3::new(-5.0, 10.0, 3.0),
            ..Body::new(ball, stuff, Vec3::new(x, 0.0, 0.1))
        };
        world.add_body(body).unwrap();
    }
    let settings = StepSettings {
        solver: SolverChoice { tolerance: 1e-9, ..SolverChoice::default() },
        ..StepSettings::default()
    };
    let mut stepper = Stepper::new(settings).unwrap();
    stepper.step(&mut world).unwrap();
    stepper
}

/// A dump with rolling friction is the same problem with other rows: the same velocities solve it.
#[test]
fn dumps_with_rolling_friction_are_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("step.hdf5");
    let stepper = rolling_step(0.0);
    let (problem, g) = stepper.last_problem().unwrap();
    assert!(problem.turning.len() == 3 && g.iter().any(|&g| g != 0.0));
    problem_file::write(&path, problem, "rolling").unwrap();
    let file = problem_file::read(&path).unwrap();
    file.problem.validate().unwrap();
    assert_eq!((file.problem.num_contacts(), file.problem.turning.len()), (3, 3));
    assert_eq!(file.problem.velocity_scale, problem.velocity_scale);
    let settings = SolveSettings { tolerance: 1e-9, ..SolveSettings::default() };
    let solve = |problem: &graintrain_ccp::Ccp| {
        let mut g = vec![0.0; problem.r.len()];
        "apgd"
            .parse::<SolverSpec>()
            .unwrap()
            .build()
            .unwrap()
            .solve(problem, &mut g, &settings)
            .unwrap()
            .objective
    };
    let (expected, found) = (solve(problem), solve(&file.problem));
    assert!((found - expected).abs() < 1e-7 * expected.abs(), "{found:e} {expected:e}");
}

#[test]
fn spinning_friction_has_no_place_in_these_files() {
    let folder = tempfile::tempdir().unwrap();
    let stepper = rolling_step(0.1);
    let (problem, _) = stepper.last_problem().unwrap();
    let error =
        problem_file::write(&folder.path().join("step.hdf5"), problem, "spinning").unwrap_err().to_string();
    assert!(error.contains("spinning"), "{error}");
}
