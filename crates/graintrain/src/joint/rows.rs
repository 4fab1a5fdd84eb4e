//! Rows of joints over the bodies that they hold together, and which bodies those are.

use super::JointKind;
use super::kinematics::Row;
use crate::math::{Mat3, Vec3};
use crate::world::World;
use graintrain_ccp::BodyInverseMass;

/// S with S S^T = M^-1 of one body: lower triangular, zero for what is prescribed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Root {
    linear: Vec3,
    angular: Mat3,
}

impl Root {
    pub(super) fn of(inverse: &BodyInverseMass) -> Self {
        let a = |i: usize, j: usize| inverse.angular[3 * i + j];
        let mut l = [[0.0; 3]; 3];
        for j in 0..3 {
            let pivot: f64 = a(j, j) - (0..j).map(|k| l[j][k] * l[j][k]).sum::<f64>();
            if pivot > 0.0 {
                l[j][j] = pivot.sqrt();
                for i in j + 1..3 {
                    let rest: f64 = a(i, j) - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
                    l[i][j] = rest / l[j][j];
                }
            }
        }
        let angular = Mat3::from_cols(
            Vec3::new(l[0][0], l[1][0], l[2][0]),
            Vec3::new(0.0, l[1][1], l[2][1]),
            Vec3::new(0.0, 0.0, l[2][2]),
        );
        Self { linear: Vec3::from_array(inverse.linear.map(f64::sqrt)), angular }
    }

    /// The root of (M + kappa)^-1 with a stiffness kappa (positive semidefinite) of rotations: S L^-T with L
    /// L^T = 1 + S^T kappa S.
    pub(super) fn with(&self, stiffness: Mat3) -> Self {
        let stiffened = Mat3::IDENTITY + self.angular.transpose() * stiffness * self.angular;
        let lower =
            Self::of(&BodyInverseMass { linear: [0.0; 3], angular: stiffened.to_cols_array() }).angular;
        Self { angular: self.angular * lower.inverse().transpose(), ..*self }
    }

    /// S S^T m.
    pub(super) fn turned_by(&self, moment: Vec3) -> Vec3 {
        self.angular * (self.angular.transpose() * moment)
    }

    /// S^T (f, m).
    pub(super) fn transposed_times(&self, [f, m]: [Vec3; 2]) -> [Vec3; 2] {
        [self.linear * f, self.angular.transpose() * m]
    }

    /// The trace of S^T K S over the rotations: above the square of the rate, 1/s^2, of any swing of the body
    /// alone.
    pub(super) fn turned(&self, stiffness: Mat3) -> f64 {
        let product = self.angular.transpose() * stiffness * self.angular;
        product.x_axis.x + product.y_axis.y + product.z_axis.z
    }

    /// S z.
    pub(super) fn times(&self, z: &[f64]) -> [Vec3; 2] {
        [self.linear * Vec3::from_slice(&z[..3]), self.angular * Vec3::from_slice(&z[3..6])]
    }
}

/// S^T of a row's derivatives, over these bodies.
pub(super) fn row_over(row: &Row, bodies: &[u32], roots: &[Root], length: usize) -> Vec<f64> {
    let mut all = vec![0.0; length];
    for (body, parts) in &row.ends {
        if let Ok(k) = bodies.binary_search(&(*body as u32)) {
            let [z, w] = roots[k].transposed_times(*parts);
            for (axis, x) in z.to_array().into_iter().chain(w.to_array()).enumerate() {
                all[6 * k + axis] += x;
            }
        }
    }
    all
}

/// Divides a row by its length, which is returned; 1 for a row of zeros.
pub(super) fn made_unit(row: &mut [f64]) -> f64 {
    let norm = row.iter().map(|x| x * x).sum::<f64>().sqrt();
    if norm.is_nan() || norm <= 0.0 {
        return 1.0;
    }
    row.iter_mut().for_each(|x| *x /= norm);
    norm
}

/// Bodies of a joint, a gear's those of its joints.
fn bodies_of(world: &World, joint: usize) -> Vec<usize> {
    let own = &world.joints[joint].joint;
    match &own.kind {
        JointKind::Gear { joints, .. } => {
            joints.iter().flat_map(|other| bodies_of(world, other.index())).collect()
        }
        _ => own.bodies.iter().flatten().map(|body| body.index()).collect(),
    }
}

/// Movable bodies and joints that hang together, each ascending.
pub(super) fn connected(world: &World) -> Vec<(Vec<u32>, Vec<usize>)> {
    let mut found: Vec<(Vec<u32>, Vec<usize>)> = Vec::new();
    for joint in 0..world.joints.len() {
        let movable = bodies_of(world, joint).into_iter().filter(|&body| !world.is_prescribed(body));
        let mut own: (Vec<u32>, Vec<usize>) = (movable.map(|body| body as u32).collect(), vec![joint]);
        if own.0.is_empty() {
            continue;
        }
        let touches = |other: &(Vec<u32>, Vec<usize>)| other.0.iter().any(|body| own.0.contains(body));
        let (joined, apart): (Vec<_>, Vec<_>) = found.into_iter().partition(touches);
        for (bodies, joints) in joined {
            own.0.extend(bodies);
            own.1.extend(joints);
        }
        own.0.sort_unstable();
        own.0.dedup();
        own.1.sort_unstable();
        found = apart;
        found.push(own);
    }
    found.sort_unstable_by_key(|(bodies, _)| bodies[0]);
    found
}

/// The longer of a joint's arms and its bodies' radii of gyration, m.
pub(super) fn length_of(world: &World, joint: usize) -> f64 {
    let own = &world.joints[joint];
    let ends =
        own.joint.bodies.iter().zip(&own.places).filter_map(|(body, place)| Some(((*body)?.index(), place)));
    let mut length = 0.0_f64;
    for (body, (point, _)) in ends {
        let (mass, inertia) = (world.bodies.mass[body], world.bodies.inertia[body]);
        let trace = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
        let gyration = if mass > 0.0 { (0.5 * trace / mass).sqrt() } else { 0.0 };
        length = length.max(point.length()).max(gyration);
    }
    if let JointKind::Gear { joints, .. } = own.joint.kind {
        length = length_of(world, joints[1].index());
    }
    if length > 0.0 { length } else { 1.0 }
}
