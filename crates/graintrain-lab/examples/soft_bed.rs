//! A bed of equal spheres from a file by the penalty method, as an independent opinion on whether it rests:
//! Hertz-Mindlin springs with history, 0.5 us per step, no code of this project but vectors. Prints the force
//! on the box each 0.1 ms.
//!
//! ```text
//! cargo run --release --example soft_bed -- dosta_penetration_25k.txt [rolling friction] [ms] [friction]
//! ```
//!
//! Material and box of the penetration benchmark of Dosta et al., Comput. Phys. Commun. 296 (2024) 109066: E
//! = 1 GPa (walls 210), nu = 0.2, mu = 0.3 (walls 0.2), e = 0.5 (walls 0.4). That benchmark has no rolling
//! friction; with it, rolling springs of stiffness k_t R^2 hold a torque of up to mu_r R f_n (Ai, Chen,
//! Rotter, Ooi, Powder Technology 206 (2011) 269, model C).

use graintrain::math::Vec3;
use std::collections::HashMap;
use std::f64::consts::PI;

const RADIUS: f64 = 1e-3;
const DENSITY: f64 = 2500.0;
const GRAVITY: f64 = 9.81;
const STEP: f64 = 5e-7;
/// Pairs nearer than this are looked at, m; neighbours are found anew each [`NEIGHBOURS`] steps.
const REACH: f64 = 2.1e-3;
const NEIGHBOURS: usize = 400;
const HALF_LENGTH: f64 = 0.049;
const HALF_WIDTH: f64 = 0.030;
const FLOOR: f64 = -0.090_243_1;

/// Elastic springs of a contact: tangential and rolling.
#[derive(Clone, Copy, Default)]
struct History {
    slip: Vec3,
    roll: Vec3,
}

/// What a kind of pair is made of.
struct Law {
    /// Effective Young's and shear moduli, Pa; effective radius, m, and mass, kg.
    young: f64,
    shear: f64,
    radius: f64,
    mass: f64,
    /// Damping ratio of the restitution coefficient (Tsuji, Tanaka, Ishida 1992).
    damping: f64,
    friction: f64,
    rolling: f64,
}

impl Law {
    fn new([young_a, young_b]: [f64; 2], restitution: f64, friction: f64, rolling: f64, parts: f64) -> Self {
        let nu: f64 = 0.2;
        let shear = |young: f64| young / 2.0 / (1.0 + nu);
        let logarithm = restitution.ln();
        let mass = DENSITY * 4.0 / 3.0 * PI * RADIUS.powi(3);
        Self {
            young: 1.0 / ((1.0 - nu * nu) * (1.0 / young_a + 1.0 / young_b)),
            shear: 1.0 / ((2.0 - nu) * (1.0 / shear(young_a) + 1.0 / shear(young_b))),
            radius: RADIUS / parts,
            mass: mass / parts,
            damping: -logarithm / logarithm.hypot(PI),
            friction,
            rolling,
        }
    }

    /// Force on the body that the normal points into, and rolling torque on it, at this overlap, relative
    /// velocity and relative angular velocity.
    fn act(&self, history: &mut History, normal: Vec3, overlap: f64, u: Vec3, spin: Vec3) -> (Vec3, Vec3) {
        let root = (self.radius * overlap).sqrt();
        let (stiff, stiff_t) = (2.0 * self.young * root, 8.0 * self.shear * root);
        let damp =
            |stiffness: f64| 2.0 * (5.0_f64 / 6.0).sqrt() * self.damping * (stiffness * self.mass).sqrt();
        let u_n = u.dot(normal);
        let u_t = u - u_n * normal;
        let f_n = (2.0 / 3.0 * stiff * overlap - damp(stiff) * u_n).max(0.0);
        history.slip += STEP * u_t - history.slip.dot(normal) * normal;
        let mut f_t = -stiff_t * history.slip - damp(stiff_t) * u_t;
        if f_t.length() > self.friction * f_n {
            f_t *= self.friction * f_n / f_t.length();
            history.slip = -f_t / stiff_t;
        }
        let stiff_r = stiff_t * RADIUS * RADIUS;
        history.roll += STEP * spin;
        let mut torque = Vec3::ZERO;
        if self.rolling > 0.0 {
            let inertia = 0.4 * self.mass * RADIUS * RADIUS;
            torque = -stiff_r * history.roll - 0.2 * (stiff_r * inertia).sqrt() * spin;
            let most = self.rolling * RADIUS * f_n;
            if torque.length() > most {
                torque *= most / torque.length();
                history.roll = -torque / stiff_r;
            }
        }
        (f_n * normal + f_t, torque)
    }
}

/// Pairs that may touch, each with the springs that it had.
fn neighbours(position: &[Vec3], before: &[(usize, usize, History)]) -> Vec<(usize, usize, History)> {
    let old: HashMap<(usize, usize), History> =
        before.iter().map(|&(i, j, history)| ((i, j), history)).collect();
    let cell = |p: Vec3| (p / REACH).floor().as_i64vec3().to_array();
    let mut cells: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for (i, &p) in position.iter().enumerate() {
        cells.entry(cell(p)).or_default().push(i);
    }
    let mut pairs = Vec::new();
    for (i, &p) in position.iter().enumerate() {
        let [x, y, z] = cell(p);
        for k in 0..27 {
            let near = [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
            for &j in cells.get(&near).into_iter().flatten().filter(|&&j| j > i) {
                if position[j].distance(p) < REACH {
                    pairs.push((i, j, old.get(&(i, j)).copied().unwrap_or_default()));
                }
            }
        }
    }
    pairs
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some(path) = arguments.first() else {
        return Err("which file? columns radius x y z, one header line".into());
    };
    let number = |k: usize, default: f64| arguments.get(k).map_or(Ok(default), |text| text.parse::<f64>());
    let (rolling, milliseconds, friction) = (number(1, 0.0)?, number(2, 2.5)?, number(3, 0.3)?);
    let mut position = Vec::new();
    for line in std::fs::read_to_string(path)?.lines().skip(1) {
        let columns: Result<Vec<f64>, _> = line.split_whitespace().map(str::parse).collect();
        // The last line of the benchmark's file is the ball.
        if let [_, x, y, z] = columns?[..] {
            position.push(Vec3::new(x, y, z));
        }
    }
    let grains = Law::new([1e9, 1e9], 0.5, friction, rolling, 2.0);
    let walls = Law::new([1e9, 210e9], 0.4, friction.min(0.2), rolling, 1.0);
    let planes = [
        (Vec3::Z, FLOOR),
        (Vec3::X, -HALF_LENGTH),
        (-Vec3::X, -HALF_LENGTH),
        (Vec3::Y, -HALF_WIDTH),
        (-Vec3::Y, -HALF_WIDTH),
    ];
    let n = position.len();
    let mass = walls.mass;
    let inertia = 0.4 * mass * RADIUS * RADIUS;
    let (mut velocity, mut spin) = (vec![Vec3::ZERO; n], vec![Vec3::ZERO; n]);
    let mut on_walls = vec![[History::default(); 5]; n];
    let mut pairs = Vec::new();
    let (mut sum, mut count) = (0.0, 0);
    println!("time (ms)  force on the box (N), mean over 0.1 ms  weight (N)  kinetic energy (J)");
    for step in 0..(milliseconds * 1e-3 / STEP) as usize {
        if step % NEIGHBOURS == 0 {
            pairs = neighbours(&position, &pairs);
        }
        let mut force = vec![-mass * GRAVITY * Vec3::Z; n];
        let mut torque = vec![Vec3::ZERO; n];
        for (i, j, history) in &mut pairs {
            let (i, j) = (*i, *j);
            let between = position[j] - position[i];
            let overlap = 2.0 * RADIUS - between.length();
            if overlap <= 0.0 {
                *history = History::default();
                continue;
            }
            let normal = between.normalize();
            let u = velocity[j] - velocity[i] - RADIUS * (spin[i] + spin[j]).cross(normal);
            let (f, roll) = grains.act(history, normal, overlap, u, spin[j] - spin[i]);
            force[j] += f;
            force[i] -= f;
            let arm = -RADIUS * normal.cross(f);
            torque[j] += arm + roll;
            torque[i] += arm - roll;
        }
        let mut box_force = 0.0;
        for i in 0..n {
            for (history, &(normal, offset)) in on_walls[i].iter_mut().zip(&planes) {
                let overlap = RADIUS - (normal.dot(position[i]) - offset);
                if overlap <= 0.0 {
                    *history = History::default();
                    continue;
                }
                let u = velocity[i] - RADIUS * spin[i].cross(normal);
                let (f, roll) = walls.act(history, normal, overlap, u, spin[i]);
                force[i] += f;
                torque[i] += roll - RADIUS * normal.cross(f);
                box_force += f.z;
            }
            velocity[i] += STEP / mass * force[i];
            spin[i] += STEP / inertia * torque[i];
            position[i] += STEP * velocity[i];
        }
        sum += box_force;
        count += 1;
        if (step + 1) % 200 == 0 {
            let squares = |v: &[Vec3]| v.iter().map(|v| v.length_squared()).sum::<f64>();
            let kinetic = 0.5 * mass * squares(&velocity) + 0.5 * inertia * squares(&spin);
            let time = (step + 1) as f64 * STEP * 1e3;
            let mean = sum / f64::from(count);
            println!("{time:.1}  {mean:.4}  {:.4}  {kinetic:.3e}", n as f64 * mass * GRAVITY);
            (sum, count) = (0.0, 0);
        }
    }
    Ok(())
}
