//! Velocities that bodies would have without contact, and the update of positions and rotations.

use crate::math::{Mat3, Vec3, rotation_exponential};
use crate::rotation::{RESOLVED, Rotor, is_isotropic, skew, turned, world_inertia};
use crate::world::{FREE, World, free_degrees};
use graintrain_ccp::BodyInverseMass;
use rayon::prelude::*;

/// What is slower rests, m/s: numbers near the smallest there are measure nothing.
pub(crate) const SLOWEST: f64 = 1e-100;

/// Bodies per parallel task.
const TASK: usize = 1024;

/// Velocities (u, w) after the step if no contact acted, six numbers per body, m/s and rad/s, from the
/// velocities `before` it.
///
/// Dynamic degrees of freedom: `v + M^-1 dt f` with gravity and external forces f, and the mean spin of the
/// step without torque (`Rotor::coast`) for the angular velocity. Prescribed ones: the mean over the step
/// of the prescribed velocity. Where only some rotations of a body are dynamic (set S, the rest P; J = R I
/// R^T): `w_S + J_SS^-1 (dt (T - w x J w)_S - J_SP (w_P+ - w_P))`, torque T.
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
        let spin = Rotor::of(world, body).coast(w, step).mean;
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

/// Velocity and angular velocity of a body with its prescribed degrees of freedom as they are, in the mean,
/// in a step from `time` on that begins where it is now.
pub(crate) fn driven_velocity(world: &World, body: usize, time: f64, step: f64) -> [Vec3; 2] {
    let bodies = &world.bodies;
    let motion = &world.motions[bodies.motion[body].index()];
    let (u, w) = motion.mean_velocity(bodies.position[body], bodies.orientation[body], time, step);
    let [x, y, z, rx, ry, rz] = motion.free;
    [select([x, y, z], bodies.velocity[body], u), select([rx, ry, rz], bodies.angular_velocity[body], w)]
}

/// Velocities (six numbers per body) with those of prescribed degrees of freedom as they are in this step.
pub(crate) fn with_driven(world: &World, before: &[f64], step: f64) -> Vec<f64> {
    let mut velocity = before.to_vec();
    for body in (0..world.bodies.len()).filter(|&body| !world.is_free(body)) {
        let driven = driven_velocity(world, body, world.time, step);
        let driven = driven.iter().flat_map(|part| part.to_array());
        let own = velocity[6 * body..6 * body + 6].iter_mut().zip(driven).zip(world.free_degrees(body));
        own.filter(|(_, is_free)| !is_free).for_each(|((own, driven), _)| *own = driven);
    }
    velocity
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
            (linear, Rotor::of(world, body).derivative(w, step, |turn| turn.mean), by_torque)
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

fn select(first: [bool; 3], a: Vec3, b: Vec3) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|k| if first[k] { a[k] } else { b[k] }))
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

/// How a body goes through a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Course {
    /// Nothing acts on it but gravity and forces that depend on time alone.
    Flies,
    /// Other loads act on it as well, and nothing else.
    Pushed,
    /// Contacts press on it, and no joint holds it.
    Touched,
    /// Joints or motions lead it.
    Held,
}

/// Moves all bodies by the mean velocities of the step, `x + dt u` and as [`Rotor::turn`] says, and sets
/// the velocities after it; both the velocities before it (after impacts) and the mean ones are six numbers
/// per body. Returned are the velocities at the start once all impulses have acted, from where bodies only
/// coast, and the largest [`Turn::lost`](crate::rotation::Turn) of a body.
///
/// u is the velocity after the step, too, with which contacts are linearised. What flies moves by
/// x + dt (u0 + u) / 2, which under gravity is the exact parabola and keeps the energy.
pub(crate) fn advance(
    world: &mut World,
    [before, mean]: [&[f64]; 2],
    courses: &[Course],
    step: f64,
) -> (Vec<f64>, f64) {
    let World { bodies, motions, .. } = world;
    let mut kicked = mean.to_vec();
    let places = bodies.position.par_iter_mut().zip(&mut bodies.orientation);
    let moving = bodies.velocity.par_iter_mut().zip(&mut bodies.angular_velocity);
    let constant = bodies.inertia.par_iter().zip(&bodies.motion).zip(courses);
    let given = kicked.par_chunks_exact_mut(6).zip(before.par_chunks_exact(6));
    let lost = places.zip(moving).zip(constant).zip(given).with_min_len(TASK).map(
        |((((position, orientation), (linear, angular)), ((&inertia, &motion), &course)), (v, before))| {
            let of = |v: &[f64]| [0, 3].map(|part| Vec3::from_slice(&v[part..part + 3]));
            let ([u0, w0], [u, w]) = (of(before), of(v));
            *linear = u;
            *position += if course == Course::Flies { 0.5 * step * (u0 + u) } else { step * u };
            let rotor = Rotor::new(inertia, *orientation, free_degrees(motions, motion));
            let is_resolved = step * w0.length() <= RESOLVED;
            let gives_back = course == Course::Touched || !is_resolved;
            let turn = match course {
                Course::Pushed => rotor.pushed([w0, w], step),
                _ => rotor.turn([w0, w], step, gives_back),
            };
            v[3..].copy_from_slice(&turn.kicked.to_array());
            (*orientation, *angular) = (turn.orientation, turn.spin);
            turn.lost
        },
    );
    let lost = lost.reduce(|| 0.0, f64::max);
    (kicked, lost)
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
        *orientation = turned(*orientation, rotation);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

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
