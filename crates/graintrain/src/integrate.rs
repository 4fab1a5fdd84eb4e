//! Velocities that bodies would have without contact, and the update of positions and rotations.

use crate::math::{Mat3, Quat, Vec3, rotation_exponential};
use crate::world::{FREE, World};
use graintrain_ccp::BodyInverseMass;
use graintrain_linalg::real;
use rayon::prelude::*;

/// Bodies per parallel task.
const TASK: usize = 1024;

/// Angle, rad, up to which a body may turn in one sub-step of the gyroscopic term; Newton's method then needs
/// three or four iterations.
const TURN_PER_SUBSTEP: f64 = 0.25;

/// More sub-steps than this are not made; a body that turns by more than 250 rad per step is not resolved
/// anyway.
const MAX_SUBSTEPS: f64 = 1000.0;

/// Velocities (u, w) after the step if no contact acted, six numbers per body, m/s and rad/s, from the
/// velocities `before` it.
///
/// Dynamic degrees of freedom: `v + M^-1 (dt f + G)` with gravity and external forces f and the gyroscopic
/// impulse G of [`free_spin`]. Prescribed ones: the mean over the step of the prescribed velocity. Where only
/// some rotations of a body are dynamic (set S, the rest P; J = R I R^T):
/// `w_S + J_SS^-1 (dt (T - w x J w)_S - J_SP (w_P+ - w_P))`, torque T.
pub fn free_velocity(world: &World, before: &[f64], step: f64) -> Vec<f64> {
    let mut free = vec![0.0; 6 * world.bodies.len()];
    free.par_chunks_mut(6 * TASK).enumerate().for_each(|(task, chunk)| {
        for (offset, v) in chunk.chunks_exact_mut(6).enumerate() {
            let (linear, angular) = body_free_velocity(world, before, task * TASK + offset, step);
            v[..3].copy_from_slice(&linear.to_array());
            v[3..].copy_from_slice(&angular.to_array());
        }
    });
    free
}

/// As [`free_velocity`] of one body.
pub(crate) fn free_velocity_of(world: &World, before: &[f64], body: usize, step: f64) -> [f64; 6] {
    let (u, w) = body_free_velocity(world, before, body, step);
    [u.x, u.y, u.z, w.x, w.y, w.z]
}

/// The velocities of all bodies, six numbers each.
pub fn velocities(world: &World) -> Vec<f64> {
    let bodies = &world.bodies;
    bodies
        .velocity
        .iter()
        .zip(&bodies.angular_velocity)
        .flat_map(|(u, w)| [u.x, u.y, u.z, w.x, w.y, w.z])
        .collect()
}

fn body_free_velocity(world: &World, before: &[f64], body: usize, step: f64) -> (Vec3, Vec3) {
    let bodies = &world.bodies;
    let [u, w] = [0, 3].map(|part| Vec3::from_slice(&before[6 * body + part..6 * body + part + 3]));
    let orientation = bodies.orientation[body];
    let (force, torque) = (bodies.force[body], bodies.torque[body]);
    let drag = world.drag.get(body).copied().unwrap_or_default();
    let mut falling = u + step * world.gravity;
    if force != Vec3::ZERO {
        falling += step / bodies.mass[body] * force;
    }
    if drag.linear > 0.0 {
        let mass = bodies.mass[body];
        falling = (mass * falling + step * drag.pull) / (mass + step * drag.linear);
    }
    let spinning = || {
        let spin = free_spin(bodies.inertia[body], orientation, w, step);
        let inertia = || world_inertia(bodies.inertia[body], orientation);
        if drag.angular > 0.0 {
            let inertia = inertia();
            return (inertia + on_axes(step * drag.angular)).inverse() * (inertia * spin + step * torque);
        }
        if torque == Vec3::ZERO {
            return spin;
        }
        spin + step * (inertia().inverse() * torque)
    };
    if bodies.motion[body] == FREE {
        return (falling, spinning());
    }
    let motion = &world.motions[bodies.motion[body].index()];
    let (driven, driven_spin) = motion.mean_velocity(bodies.position[body], orientation, world.time, step);
    let [x, y, z, rx, ry, rz] = motion.free;
    let linear = select([x, y, z], falling, driven);
    let free = [rx, ry, rz];
    let angular = match free {
        [false, false, false] => driven_spin,
        [true, true, true] => spinning(),
        _ => {
            let inertia = world_inertia(bodies.inertia[body], orientation);
            let change = select(free, Vec3::ZERO, driven_spin - w);
            let impulse = step * (torque - drag.angular * w - w.cross(inertia * w)) - inertia * change;
            let inertia = inertia + on_axes(step * drag.angular);
            select(free, w + masked_inverse(inertia, free) * impulse, driven_spin)
        }
    };
    (linear, angular)
}

/// Derivatives of the velocities of [`free_velocity`] of one body: by its velocity (a diagonal), by its
/// angular velocity, and by the external torque, N m; that by the external force is `step / mass` along the
/// dynamic axes. Zero for what is prescribed.
pub(crate) fn free_velocity_derivative(world: &World, body: usize, step: f64) -> (Vec3, Mat3, Mat3) {
    let bodies = &world.bodies;
    let (inertia, orientation, w) =
        (bodies.inertia[body], bodies.orientation[body], bodies.angular_velocity[body]);
    let free = world.free_degrees(body);
    let linear = Vec3::from_array(std::array::from_fn(|k| f64::from(free[k])));
    match [free[3], free[4], free[5]] {
        [false, false, false] => (linear, Mat3::ZERO, Mat3::ZERO),
        [true, true, true] => {
            let by_torque = step * world_inertia(inertia, orientation).inverse();
            (linear, free_spin_derivative(inertia, orientation, w, step), by_torque)
        }
        turns => {
            let world_inertia = world_inertia(inertia, orientation);
            let inverse = masked_inverse(world_inertia, turns);
            let mask =
                |kept: bool| Mat3::from_diagonal(Vec3::from_array(turns.map(|free| f64::from(free == kept))));
            let gyroscopic = skew(w) * world_inertia - skew(world_inertia * w);
            let by_spin = mask(true) + inverse * (world_inertia * mask(false) - step * gyroscopic);
            (linear, by_spin, step * inverse)
        }
    }
}

/// Derivative of [`free_spin`] by w: over every sub-step `(I + h/2 Q) dw1 = (I - h/2 Q) dw0` with
/// `Q = skew(wm) I - skew(I wm)`.
fn free_spin_derivative(inertia: Mat3, orientation: Quat, w: Vec3, step: f64) -> Mat3 {
    if is_isotropic(inertia) {
        return Mat3::IDENTITY;
    }
    let (substeps, h) = spin_substeps(w, step);
    let (mut spin, mut derivative) = (orientation.conjugate() * w, Mat3::IDENTITY);
    for _ in 0..substeps {
        let next = midpoint_spin(inertia, spin, h);
        let middle = 0.5 * (spin + next);
        let change = 0.5 * h * (skew(middle) * inertia - skew(inertia * middle));
        derivative = (inertia + change).inverse() * (inertia - change) * derivative;
        spin = next;
    }
    let rotation = Mat3::from_quat(orientation);
    rotation * derivative * rotation.transpose()
}

/// Number and length (s) of the sub-steps of [`free_spin`].
fn spin_substeps(w: Vec3, step: f64) -> (usize, f64) {
    let substeps = (step * w.length() / TURN_PER_SUBSTEP).ceil().clamp(1.0, MAX_SUBSTEPS);
    (substeps as usize, step / substeps)
}

fn select(first: [bool; 3], a: Vec3, b: Vec3) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|k| if first[k] { a[k] } else { b[k] }))
}

/// Angular velocity after a step without torque: Euler's equations in body axes by the implicit midpoint
/// rule, `I (w1 - w0) = -dt wm x I wm`, `wm = (w0 + w1) / 2`, which keeps the energy and the length of the
/// angular momentum to round-off. Because the body turns about w1 itself, w1 has the same components in the
/// body's axes before and after.
pub fn free_spin(inertia: Mat3, orientation: Quat, w: Vec3, step: f64) -> Vec3 {
    if is_isotropic(inertia) {
        return w;
    }
    let (substeps, h) = spin_substeps(w, step);
    let mut spin = orientation.conjugate() * w;
    for _ in 0..substeps {
        spin = midpoint_spin(inertia, spin, h);
    }
    orientation * spin
}

fn midpoint_spin(inertia: Mat3, w0: Vec3, h: f64) -> Vec3 {
    let mut w1 = w0;
    for _ in 0..10 {
        let middle = 0.5 * (w0 + w1);
        let residual = inertia * (w1 - w0) + h * middle.cross(inertia * middle);
        let jacobian = inertia + 0.5 * h * (skew(middle) * inertia - skew(inertia * middle));
        let change = jacobian.inverse() * residual;
        w1 -= change;
        if change.length() <= 1e-15 * w0.length() {
            break;
        }
    }
    w1
}

/// Matrix of the cross product: skew(a) b = a x b.
fn skew(a: Vec3) -> Mat3 {
    Mat3::from_cols(Vec3::new(0.0, a.z, -a.y), Vec3::new(-a.z, 0.0, a.x), Vec3::new(a.y, -a.x, 0.0))
}

fn is_isotropic(inertia: Mat3) -> bool {
    inertia == Mat3::from_diagonal(Vec3::splat(inertia.x_axis.x))
}

/// R I R^T.
pub(crate) fn world_inertia(inertia: Mat3, orientation: Quat) -> Mat3 {
    let rotation = Mat3::from_quat(orientation);
    rotation * inertia * rotation.transpose()
}

/// Inverse of the block of dynamic rotations, zero elsewhere.
fn masked_inverse(inertia: Mat3, free: [bool; 3]) -> Mat3 {
    let mut block = inertia;
    for i in 0..3 {
        for j in 0..3 {
            if !(free[i] && free[j]) {
                block.col_mut(j)[i] = if i == j { 1.0 } else { 0.0 };
            }
        }
    }
    let mut inverse = block.inverse();
    for k in (0..3).filter(|&k| !free[k]) {
        inverse.col_mut(k)[k] = 0.0;
    }
    inverse
}

/// The same moment about all axes.
fn on_axes(moment: f64) -> Mat3 {
    Mat3::from_diagonal(Vec3::splat(moment))
}

/// Inverse mass matrices in world axes; prescribed degrees of freedom have zero rows and columns.
pub fn inverse_mass(world: &World) -> Vec<BodyInverseMass> {
    inverse_mass_with(world, |_| [0.0; 2])
}

/// As [`inverse_mass`] with what drag adds in a step: of m + dt linear and I + dt angular
/// ([`crate::load::Drag`]).
pub(crate) fn inverse_mass_in_step(world: &World, step: f64) -> Vec<BodyInverseMass> {
    let added =
        |body: usize| world.drag.get(body).map_or([0.0; 2], |drag| [step * drag.linear, step * drag.angular]);
    inverse_mass_with(world, added)
}

/// With a mass (kg) and an inertia (kg m^2) added to those of every body.
fn inverse_mass_with(world: &World, added: impl Fn(usize) -> [f64; 2] + Sync) -> Vec<BodyInverseMass> {
    (0..world.bodies.len())
        .into_par_iter()
        .with_min_len(TASK)
        .map(|body| {
            let [x, y, z, rx, ry, rz] = world.free_degrees(body);
            let [mass, moment] = added(body);
            let inverse_mass = 1.0 / (world.bodies.mass[body] + mass);
            let linear = [x, y, z].map(|free| if free { inverse_mass } else { 0.0 });
            let rotations = [rx, ry, rz];
            let inertia = world.bodies.inertia[body] + on_axes(moment);
            if rotations == [false; 3] {
                return BodyInverseMass { linear, angular: [0.0; 9] };
            }
            if is_isotropic(inertia) {
                let inverse = 1.0 / inertia.x_axis.x;
                let [a, b, c] = rotations.map(|free| if free { inverse } else { 0.0 });
                return BodyInverseMass { linear, angular: [a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c] };
            }
            let full = masked_inverse(world_inertia(inertia, world.bodies.orientation[body]), rotations);
            let inverse = 0.5 * (full + full.transpose());
            // Symmetric, so columns are rows.
            BodyInverseMass { linear, angular: inverse.to_cols_array() }
        })
        .collect()
}

/// Bodies that nothing touches in a step, and the velocities from which they fly (six numbers per body, after
/// impacts).
pub(crate) struct Flight<'a> {
    pub flies: &'a [bool],
    pub before: &'a [f64],
}

/// Sets the velocities of all bodies (six numbers each) and moves them: `x + dt u`, `exp(dt w) Q`
/// renormalised; then by a displacement (translation and turn, six numbers per body) that leaves no velocity,
/// if there is one. A turn takes the angular velocity with it, so that the kinetic energy stays.
///
/// Contacts are linearised with the velocities after the step. What nothing touches moves by the mean
/// velocity, x + dt (u0 + u) / 2, which under gravity is the exact parabola and keeps the energy, and turns
/// as [`fly`] says.
pub(crate) fn advance(
    world: &mut World,
    velocity: &[f64],
    displacement: Option<&[f64]>,
    flight: &Flight<'_>,
    step: f64,
) {
    let bodies = &mut world.bodies;
    let places = bodies.position.par_iter_mut().zip(&mut bodies.orientation);
    let moving = bodies.velocity.par_iter_mut().zip(&mut bodies.angular_velocity);
    let flying = flight.flies.par_iter().zip(flight.before.par_chunks_exact(6));
    places
        .zip(moving)
        .zip(flying.zip(&bodies.inertia))
        .zip(velocity.par_chunks_exact(6))
        .with_min_len(TASK)
        .for_each(|((((position, orientation), (linear, angular)), ((&flies, before), &inertia)), v)| {
            let [u, w] = [0, 3].map(|part| Vec3::from_slice(&v[part..part + 3]));
            (*linear, *angular) = (u, w);
            if flies {
                *position += 0.5 * step * (Vec3::from_slice(&before[..3]) + u);
                (*orientation, *angular) =
                    fly(inertia, *orientation, [Vec3::from_slice(&before[3..]), w], step);
            } else {
                *position += step * u;
                turn(orientation, step * w);
            }
        });
    if let Some(displacement) = displacement {
        displace(world, displacement);
    }
}

/// Orientation and angular velocity after a flight in which the spin goes from w0 to w1, in world axes.
/// Without torque these are those of [`free_spin`], which keeps the energy and the length of the angular
/// momentum L: the body turns about the mean spin of every sub-step, and then by the least that brings L back
/// to where it was, `Q1 I Q1^T w1' = Q0 I Q0^T w0`. Where the spin is another one it turns about w1.
fn fly(inertia: Mat3, start: Quat, [w0, w1]: [Vec3; 2], step: f64) -> (Quat, Vec3) {
    let (first, last) = (start.conjugate() * w0, start.conjugate() * w1);
    let (mut end, mut spin) = (start, first);
    if !is_isotropic(inertia) {
        let (substeps, h) = spin_substeps(w0, step);
        for _ in 0..substeps {
            let next = midpoint_spin(inertia, spin, h);
            end *= rotation_exponential(0.5 * h * (spin + next));
            spin = next;
        }
        let momentum = inertia * first;
        if momentum != Vec3::ZERO && (spin - last).length() <= 1e-12 * last.length() {
            let [is, wanted] = [end * (inertia * spin), start * momentum].map(Vec3::normalize);
            let across = is.cross(wanted);
            if across != Vec3::ZERO {
                let angle = real::atan2(across.length(), is.dot(wanted));
                turn(&mut end, angle * across.normalize());
            }
            return (end, end * spin);
        }
        end = start;
    }
    turn(&mut end, step * w1);
    (end, w1)
}

/// exp(rotation) Q, renormalised.
fn turn(orientation: &mut Quat, rotation: Vec3) {
    if rotation != Vec3::ZERO {
        *orientation = (rotation_exponential(rotation) * *orientation).normalize();
    }
}

/// Moves all bodies by a displacement (translation and turn, six numbers per body) that leaves no velocity.
pub(crate) fn displace(world: &mut World, displacement: &[f64]) {
    let bodies = &mut world.bodies;
    let places = bodies.position.par_iter_mut().zip(&mut bodies.orientation);
    let all = places.zip(&mut bodies.angular_velocity).zip(displacement.par_chunks_exact(6));
    all.with_min_len(TASK).for_each(|(((position, orientation), angular), v)| {
        let [way, rotation] = [0, 3].map(|part| Vec3::from_slice(&v[part..part + 3]));
        *position += way;
        *angular = rotation_exponential(rotation) * *angular;
        turn(orientation, rotation);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_spin_keeps_energy_and_angular_momentum() {
        let inertia = Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0));
        let orientation = Quat::from_xyzw(0.1, -0.4, 0.3, 0.8).normalize();
        for w in [Vec3::new(0.3, 2.0, -0.1), Vec3::new(-30.0, 2.0, 50.0)] {
            let after = orientation.conjugate() * free_spin(inertia, orientation, orientation * w, 0.1);
            let energy = |w: Vec3| w.dot(inertia * w);
            let momentum = |w: Vec3| (inertia * w).length();
            assert!((energy(after) / energy(w) - 1.0).abs() < 1e-13);
            assert!((momentum(after) / momentum(w) - 1.0).abs() < 1e-13);
            assert!((after - w).length() > 1e-3);
        }
    }

    #[test]
    fn masked_inverse_inverts_the_dynamic_block() {
        let inertia =
            Mat3::from_cols(Vec3::new(3.0, 0.5, 0.2), Vec3::new(0.5, 2.0, -0.3), Vec3::new(0.2, -0.3, 1.5));
        let full = masked_inverse(inertia, [true; 3]) * inertia - Mat3::IDENTITY;
        assert!(full.to_cols_array().iter().all(|x| x.abs() < 1e-14));
        let one = masked_inverse(inertia, [false, true, false]);
        assert_eq!(one, Mat3::from_diagonal(Vec3::new(0.0, 0.5, 0.0)));
        let two = masked_inverse(inertia, [true, false, true]);
        let det = 3.0 * 1.5 - 0.2 * 0.2;
        assert!((two.x_axis.x - 1.5 / det).abs() < 1e-15 && (two.z_axis.x + 0.2 / det).abs() < 1e-15);
        assert_eq!(two.y_axis, Vec3::ZERO);
    }
}
