//! The stress tensor of a volume.

use super::contacts::ends;
use crate::math::{Mat3, Vec3};
use crate::moments::outer;
use crate::world::World;

/// Mean stress of a volume, Pa, compression positive (as in soil mechanics).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stress {
    /// By contacts.
    pub contact: Mat3,
    /// By the fluctuation of velocities.
    pub kinetic: Mat3,
}

/// Mean stress of the bodies that are meant, in a volume (m^3) that is theirs:
///
/// ```text
/// contact: s_ij = 1/V sum over bodies b, contacts c of b:  (x_b - p_c)_i f_j      f: force on b; x_b, p_c: at the start of the step
/// kinetic: s_ij = 1/V sum m (u - U)_i (u - U)_j                                    U: velocity of their common centre of mass
/// ```
///
/// (Love and Weber; between two bodies that are both meant the two terms of a contact add up to branch times
/// force). Compression is positive. The contact part is symmetric where bodies do not turn faster and faster.
/// In a periodic cell velocities are relative to its deformation.
pub fn stress(world: &World, step: f64, selected: &[bool], volume: f64) -> Stress {
    let mut contact = Mat3::ZERO;
    for (c, impulse) in world.contacts.contacts.iter().zip(&world.contacts.impulse) {
        for (body, on, force) in ends(c, *impulse / step) {
            if selected[body] {
                contact += outer(-world.arm_to(body, on, step), force);
            }
        }
    }
    let bodies = || (0..world.bodies.len()).filter(|&body| selected[body]);
    let mass: f64 = bodies().map(|b| world.bodies.mass[b]).sum();
    let momentum: Vec3 = bodies().map(|b| world.bodies.mass[b] * world.fluctuation(b)).sum();
    let mean = if mass > 0.0 { momentum / mass } else { Vec3::ZERO };
    let kinetic = bodies().fold(Mat3::ZERO, |sum, b| {
        let c = world.fluctuation(b) - mean;
        sum + world.bodies.mass[b] * outer(c, c)
    });
    Stress { contact: contact * (1.0 / volume), kinetic: kinetic * (1.0 / volume) }
}

/// The sum of the diagonal.
pub fn trace(tensor: &Mat3) -> f64 {
    tensor.x_axis.x + tensor.y_axis.y + tensor.z_axis.z
}

/// The pressure, a third of the trace, Pa.
pub fn pressure(tensor: &Mat3) -> f64 {
    trace(tensor) / 3.0
}

/// The deviator stress sqrt(3/2 s:s) of the symmetric part, Pa: the difference of axial and radial stress in
/// a triaxial test.
pub fn deviator(tensor: &Mat3) -> f64 {
    let s = 0.5 * (*tensor + tensor.transpose()) - Mat3::from_diagonal(Vec3::splat(pressure(tensor)));
    (1.5 * s.to_cols_array().iter().map(|x| x * x).sum::<f64>()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::samples::{chain, row_of_columns};
    use super::super::space::selected;
    use super::*;

    /// A chain of balls of radius 0.5 along x under 2 N at both ends: branch sums to 3 m, so s_xx = 3 x 2 /
    /// V.
    #[test]
    fn a_chain_under_load() {
        let (world, step) = chain(3, 2.0);
        let all = selected(&world, None, None);
        let found = stress(&world, step, &all, 1.5).contact;
        let expected = Mat3::from_diagonal(Vec3::new(4.0, 0.0, 0.0));
        assert!((found - expected).to_cols_array().iter().all(|x| x.abs() < 1e-12), "{found}");
        assert!((pressure(&found) - 4.0 / 3.0).abs() < 1e-12);
        assert!((deviator(&found) - 4.0).abs() < 1e-12);
        // The middle ball alone: one ball's branch.
        let middle = [false, true, false];
        assert!(
            (stress(&world, step, &[&middle[..], &[false, false]].concat(), 0.5).contact.x_axis.x - 4.0)
                .abs()
                < 1e-12
        );
    }

    /// A chain that moves on in the step, with contacts from its start: the same.
    #[test]
    fn a_chain_under_load_that_moves() {
        let (mut world, step) = chain(3, 2.0);
        let velocity = Vec3::new(3.0, -20.0, 7.0);
        for body in 0..world.bodies.len() {
            world.bodies.velocity[body] = velocity;
            world.bodies.position[body] += step * velocity;
        }
        let all = selected(&world, None, None);
        let found = stress(&world, step, &all, 1.5).contact;
        let expected = Mat3::from_diagonal(Vec3::new(4.0, 0.0, 0.0));
        assert!((found - expected).to_cols_array().iter().all(|x| x.abs() < 1e-12), "{found}");
    }

    /// Columns at rest on a floor: s_zz over the height is on average half the weight per area of the floor.
    #[test]
    fn weight_of_columns() {
        let (world, step) = row_of_columns(4, 3);
        let all = selected(&world, None, None);
        let mass: f64 = (0..world.bodies.len()).filter(|&b| all[b]).map(|b| world.bodies.mass[b]).sum();
        let (area, height) = (4.0, 3.0);
        let found = stress(&world, step, &all, area * height).contact.z_axis.z;
        // Balls of radius 0.5: the n-th contact from below carries n - k weights over a branch of 1, the
        // lowest over one of 0.5.
        let weight = 9.81 * mass / 12.0;
        let expected = 4.0 * weight * (3.0 * 0.5 + 2.0 + 1.0) / (area * height);
        assert!((found - expected).abs() < 1e-3 * expected, "{found} {expected}");
    }

    #[test]
    fn kinetic_stress_of_two_bodies_that_part() {
        let (mut world, step) = chain(2, 0.0);
        (world.bodies.velocity[0], world.bodies.velocity[1]) =
            (Vec3::new(3.0, 1.0, 0.0), Vec3::new(-1.0, 1.0, 0.0));
        let mass = world.bodies.mass[0];
        let found = stress(&world, step, &selected(&world, None, None), 2.0).kinetic;
        assert!((found.x_axis.x - mass * 4.0).abs() < 1e-9 * mass && found.y_axis.y == 0.0, "{found}");
    }
}
