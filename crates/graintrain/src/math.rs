//! Vectors, quaternions and matrices in f64, from one place (they come with the collision library), and the
//! few operations on them that are missing there.

use graintrain_linalg::real;
pub use parry3d_f64::glamx::{DMat3 as Mat3, DMat4 as Mat4, DQuat as Quat, DVec3 as Vec3};
pub use parry3d_f64::math::Pose;

/// Two unit vectors t1, t2 that make (n, t1, t2) a right-handed orthonormal frame; a continuous function of
/// the unit vector n except at n_z = 0 (Duff et al., Building an Orthonormal Basis, Revisited, JCGT 2017).
#[inline]
pub fn tangents(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// What a mass of one at this distance (m) adds to a tensor of inertia, |d|^2 - d d^T, m^2 (parallel axes,
/// Huygens and Steiner).
#[inline]
pub fn parallel_axis(d: Vec3) -> Mat3 {
    Mat3::from_diagonal(Vec3::splat(d.length_squared())) - Mat3::from_cols(d * d.x, d * d.y, d * d.z)
}

/// Unit quaternion of the rotation by |turn| about turn: exp(turn / 2).
#[inline]
pub fn rotation_exponential(turn: Vec3) -> Quat {
    let angle = turn.length();
    let half = 0.5 * angle;
    // sin(x) / x by its series where the quotient would lose digits or divide by zero.
    let sinc = if half < 1e-4 { 1.0 - half * half / 6.0 } else { real::sin(half) / half };
    let v = 0.5 * sinc * turn;
    Quat::from_xyzw(v.x, v.y, v.z, real::cos(half))
}

/// Scrambles a 64-bit number; a bijection (the finaliser of splitmix64).
#[inline]
pub fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// The number that [`mix`] makes this one of: each of its steps has an inverse (the factors are the inverses
/// of its own modulo 2^64).
pub(crate) fn unmix(x: u64) -> u64 {
    let x = (x ^ (x >> 31) ^ (x >> 62)).wrapping_mul(0x3196_42b2_d24d_8ec3);
    let x = (x ^ (x >> 27) ^ (x >> 54)).wrapping_mul(0x96de_1b17_3f11_9089);
    x ^ (x >> 30) ^ (x >> 60)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn mixing_can_be_undone(x: u64) {
            prop_assert_eq!(unmix(mix(x)), x);
        }

        #[test]
        fn tangents_make_a_right_handed_frame(v in prop::array::uniform3(-1.0..1.0_f64)) {
            let v = Vec3::from_array(v);
            prop_assume!(v.length() > 1e-3);
            let n = v.normalize();
            let (t1, t2) = tangents(n);
            prop_assert!((n.cross(t1) - t2).length() < 1e-14);
            prop_assert!(n.dot(t1).abs() < 1e-14 && (t1.length() - 1.0).abs() < 1e-14);
        }

        #[test]
        fn exponential_agrees_with_axis_and_angle(v in prop::array::uniform3(-1.0..1.0_f64), small in 0..6) {
            let turn = Vec3::from_array(v) * 10.0_f64.powi(-2 * small);
            prop_assume!(turn.length() > 1e-14);
            let expected = Quat::from_axis_angle(turn.normalize(), turn.length());
            let got = rotation_exponential(turn);
            prop_assert!((got - expected).length() < 1e-15 + 1e-12 * turn.length());
            prop_assert!((got.length() - 1.0).abs() < 1e-15);
        }
    }
}
