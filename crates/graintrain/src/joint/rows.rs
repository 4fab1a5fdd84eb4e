//! Rows of joints over the bodies that they hold together, and which bodies those are.

use super::JointKind;
use super::elimination::SparseRow;
use super::kinematics::Row;
use crate::math::{Mat3, Vec3};
use crate::world::World;
use graintrain_ccp::BodyInverseMass;
use std::collections::BTreeMap;

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

/// S^T of a row's derivatives, over these bodies, six coordinates each.
pub(super) fn row_over(row: &Row, bodies: &[u32], roots: &[Root]) -> SparseRow {
    let mut all = SparseRow::new();
    for (body, parts) in &row.ends {
        let Ok(k) = bodies.binary_search(&(*body as u32)) else { continue };
        let [z, w] = roots[k].transposed_times(*parts);
        for (place, x) in (6 * k..).zip(z.to_array().into_iter().chain(w.to_array())) {
            // A gear may name a body twice.
            match all.iter_mut().find(|(known, _)| *known == place) {
                Some((_, sum)) => *sum += x,
                None => all.push((place, x)),
            }
        }
    }
    all.sort_unstable_by_key(|(place, _)| *place);
    all
}

/// Divides a row by its length, which is returned; 1 for a row of zeros.
pub(super) fn made_unit(row: &mut SparseRow) -> f64 {
    let norm = row.iter().map(|(_, x)| x * x).sum::<f64>().sqrt();
    if norm.is_nan() || norm <= 0.0 {
        return 1.0;
    }
    row.iter_mut().for_each(|(_, x)| *x /= norm);
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
    let movable = |joint: usize| -> Vec<u32> {
        let bodies = bodies_of(world, joint).into_iter().filter(|&body| !world.is_prescribed(body));
        bodies.map(|body| body as u32).collect()
    };
    let held: Vec<Vec<u32>> = (0..world.joints.len()).map(movable).collect();
    let mut bodies: Vec<u32> = held.iter().flatten().copied().collect();
    bodies.sort_unstable();
    bodies.dedup();
    // The first body with which one hangs together, as far as is known.
    let mut leaders: Vec<usize> = (0..bodies.len()).collect();
    let lead = |leaders: &[usize], mut place: usize| {
        while leaders[place] != place {
            place = leaders[place];
        }
        place
    };
    let place = |body: u32| bodies.partition_point(|&other| other < body);
    for pair in held.iter().flat_map(|held| held.windows(2)) {
        let [first, second] = [pair[0], pair[1]].map(|body| lead(&leaders, place(body)));
        leaders[first.max(second)] = first.min(second);
    }
    // None leads by way of another.
    for k in 0..leaders.len() {
        leaders[k] = leaders[leaders[k]];
    }
    let mut found: BTreeMap<usize, (Vec<u32>, Vec<usize>)> = BTreeMap::new();
    for (k, &body) in bodies.iter().enumerate() {
        found.entry(lead(&leaders, k)).or_default().0.push(body);
    }
    for (joint, held) in held.iter().enumerate() {
        if let Some(&body) = held.first() {
            found.entry(lead(&leaders, place(body))).or_default().1.push(joint);
        }
    }
    found.into_values().collect()
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
