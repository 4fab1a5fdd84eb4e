//! Velocities that bodies would have without contact, and the update of positions and rotations.

use crate::math::{Mat3, Quat, Vec3, rotation_exponential};
use crate::world::{FREE, World, free_degrees};
use graintrain_ccp::BodyInverseMass;
use graintrain_linalg::real;
use rayon::prelude::*;

/// Bodies per parallel task.
const TASK: usize = 1024;

/// Angle, rad, up to which a body may turn in one sub-step of a free rotation; Newton's method then needs
/// three or four iterations.
const TURN_PER_SUBSTEP: f64 = 0.25;

/// More sub-steps than this are not made; a body that turns by more than 250 rad per step is not resolved
/// anyway.
const MAX_SUBSTEPS: f64 = 1000.0;

/// Angle, rad, by which a body on which torques act may turn in a step as [`Rotor::turn`] says.
const FAST: f64 = 1.0;

/// Angle, rad, up to which a step resolves the turn of a body in joints.
const RESOLVED: f64 = 0.5;

/// Rounding of an angular velocity over itself.
const ROUNDING: f64 = 1e-14;

/// Differences by which derivatives are taken, over the value (at least rad per step).
const DIFFERENCE: f64 = 1e-3;

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

/// Number of the sub-steps of [`Rotor::coast`].
fn spin_substeps(w: Vec3, step: f64) -> usize {
    (step * w.length() / TURN_PER_SUBSTEP).ceil().clamp(1.0, MAX_SUBSTEPS) as usize
}

fn select(first: [bool; 3], a: Vec3, b: Vec3) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|k| if first[k] { a[k] } else { b[k] }))
}

/// A body as it can turn.
#[derive(Clone, Copy)]
pub(crate) struct Rotor {
    /// About the body's axes, kg m^2.
    inertia: Mat3,
    orientation: Quat,
    /// Its angular velocity stays where no torque acts: that of a ball, and of a body that cannot turn about
    /// all axes.
    is_steady: bool,
}

/// A turn without torque, in world axes.
pub(crate) struct Coasting {
    /// Where it leads to.
    orientation: Quat,
    /// Angular velocity at its end.
    pub spin: Vec3,
    /// Mean of the angular velocity; beyond [`FAST`] that of the end, in the axes of the start.
    pub mean: Vec3,
}

/// The turn of a step, in world axes.
pub(crate) struct Turn {
    /// Angular velocity at the start once the torques have acted.
    kicked: Vec3,
    /// Where the turn leads to.
    pub orientation: Quat,
    /// Angular velocity at its end.
    spin: Vec3,
}

impl Rotor {
    /// With the tensor of inertia about its own axes, kg m^2, and these dynamic degrees of freedom.
    pub(crate) fn new(inertia: Mat3, orientation: Quat, free: [bool; 6]) -> Self {
        Self { inertia, orientation, is_steady: is_isotropic(inertia) || free[3..] != [true; 3] }
    }

    /// A body where it is.
    pub(crate) fn of(world: &World, body: usize) -> Self {
        let bodies = &world.bodies;
        Self::new(bodies.inertia[body], bodies.orientation[body], world.free_degrees(body))
    }

    /// Free rotation from the angular velocity `w`, which keeps energy and angular momentum L to round-off:
    /// Euler's equations in body axes by the implicit midpoint rule, `I (w1 - w0) = -h wm x I wm`,
    /// `wm = (w0 + w1) / 2`, which keeps the energy and |L|. The body turns about wm in every sub-step, and
    /// at last by the least that brings L back to where it was, `Q1 I Q1^T w1 = Q0 I Q0^T w0`.
    pub(crate) fn coast(&self, w: Vec3, step: f64) -> Coasting {
        if self.is_steady {
            return Coasting { orientation: turned(self.orientation, step * w), spin: w, mean: w };
        }
        self.coast_in(spin_substeps(w, step), w, step)
    }

    /// [`Self::coast`] in so many sub-steps.
    fn coast_in(&self, substeps: usize, w: Vec3, step: f64) -> Coasting {
        let Self { inertia, orientation: start, .. } = *self;
        let h = step / substeps as f64;
        let (mut orientation, first) = (start, start.conjugate() * w);
        let (mut spin, mut sum) = (first, Vec3::ZERO);
        for _ in 0..substeps {
            let next = midpoint_spin(inertia, spin, h);
            let middle = 0.5 * (spin + next);
            sum += orientation * middle;
            orientation *= rotation_exponential(h * middle);
            spin = next;
        }
        let [is, wanted] = [orientation * (inertia * spin), start * (inertia * first)];
        let across = is.cross(wanted);
        if across != Vec3::ZERO {
            let angle = real::atan2(across.length(), is.dot(wanted));
            orientation = turned(orientation, angle * across.normalize());
        }
        let mean = if is_fast(w, step) { start * spin } else { sum / substeps as f64 };
        Coasting { orientation, spin: orientation * spin, mean }
    }

    /// The turn of a step with these angular velocities w before it and m in its mean. Its torques act at
    /// once, and then the body coasts from w' on, so that its angular momentum changes by their impulses as
    /// it lay at the start and by nothing else. With joints this is SHAKE. With m* the mean without torques,
    /// d = m - m* and w' = w + d, the torques' work is
    ///
    /// ```text
    /// d . J (w + w') / 2 = d . J m + d . J (w - m*) - d . J d / 2
    /// ```
    ///
    /// Where contacts exert them the first term is what they take, and the rest, of third order in a step
    /// where all goes smoothly, shall give nothing: `gives_back` makes s d of d by [`least_change`]. For a
    /// body that turns by more than [`RESOLVED`] that holds wherever they come from: the leapfrog would gain
    /// energy.
    ///
    /// m - m* turns the body as far only as long as the step resolves its spin. One beyond [`FAST`] on which
    /// torques act turns about m, with its energy from before and what they do.
    pub(crate) fn turn(&self, spins: [Vec3; 2], step: f64, gives_back: bool) -> Turn {
        self.turn_beside(&self.coast(spins[0], step), spins, step, gives_back)
    }

    /// [`Self::turn`] where it is known how the body coasts without torques.
    pub(crate) fn turn_beside(
        &self,
        coasting: &Coasting,
        [before, mean]: [Vec3; 2],
        step: f64,
        gives_back: bool,
    ) -> Turn {
        let about = |w: Vec3| Turn { kicked: w, orientation: turned(self.orientation, step * w), spin: w };
        if self.is_steady {
            return about(mean);
        }
        let change = mean - coasting.mean;
        if change.length() <= ROUNDING * mean.length() {
            return Turn { kicked: before, orientation: coasting.orientation, spin: coasting.spin };
        }
        if is_fast(before, step) {
            return about(mean);
        }
        let mut kicked = before + change;
        if gives_back {
            let inertia = self.orientation * (self.inertia * (self.orientation.conjugate() * change));
            let [begin, square, taken] = [before, change, mean].map(|w| inertia.dot(w));
            if begin + 0.5 * square > taken {
                kicked = before + least_change([begin, square, taken]) * change;
            }
        }
        let Coasting { orientation, spin, .. } = self.coast(kicked, step);
        Turn { kicked, orientation, spin }
    }

    /// Derivative by w of what `of` says of a turn that starts with w, by differences of fourth order.
    pub(crate) fn derivative(&self, w: Vec3, step: f64, of: impl Fn(Coasting) -> Vec3) -> Mat3 {
        if self.is_steady {
            return Mat3::IDENTITY;
        }
        // As many for all, so that the differences are those of a smooth function.
        let substeps = spin_substeps(w, step);
        let way = DIFFERENCE * w.length().max(DIFFERENCE / step);
        let at = |change: Vec3| of(self.coast_in(substeps, w + change, step));
        let along = |axis: Vec3| {
            let [near, far] = [1.0, 2.0].map(|k| at(k * way * axis) - at(-k * way * axis));
            (8.0 * near - far) / (12.0 * way)
        };
        Mat3::from_cols(along(Vec3::X), along(Vec3::Y), along(Vec3::Z))
    }
}

/// The s in [0, 2] nearest to 1 with `s d . J w + s^2 d . J d / 2 = d . J m`, from these three products;
/// where there is none, the one with the least of the left side.
fn least_change([begin, square, taken]: [f64; 3]) -> f64 {
    let root = (begin * begin + 2.0 * square * taken).max(0.0).sqrt();
    let both = [-begin - root, -begin + root].map(|s| s / square);
    let s = if (both[0] - 1.0).abs() < (both[1] - 1.0).abs() { both[0] } else { both[1] };
    s.clamp(0.0, 2.0)
}

/// Whether a body turns so far in a step that the step does not resolve it.
pub(crate) fn is_fast(w: Vec3, step: f64) -> bool {
    step * w.length() > FAST
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

/// How a body goes through a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Course {
    /// Nothing acts on it but gravity.
    Flies,
    /// Contacts press on it, and no joint holds it.
    Touched,
    /// Joints, motions or loads lead it.
    Held,
}

/// Moves all bodies by the mean velocities of the step, `x + dt u` and as [`Rotor::turn`] says, and sets
/// the velocities after it; both the velocities before it (after impacts) and the mean ones are six numbers
/// per body. Returned are the velocities at the start once all impulses have acted: from there bodies only
/// coast.
///
/// u is the velocity after the step, too, with which contacts are linearised. What flies moves by
/// x + dt (u0 + u) / 2, which under gravity is the exact parabola and keeps the energy.
pub(crate) fn advance(
    world: &mut World,
    [before, mean]: [&[f64]; 2],
    courses: &[Course],
    step: f64,
) -> Vec<f64> {
    let World { bodies, motions, .. } = world;
    let mut kicked = mean.to_vec();
    let places = bodies.position.par_iter_mut().zip(&mut bodies.orientation);
    let moving = bodies.velocity.par_iter_mut().zip(&mut bodies.angular_velocity);
    let constant = bodies.inertia.par_iter().zip(&bodies.motion).zip(courses);
    let given = kicked.par_chunks_exact_mut(6).zip(before.par_chunks_exact(6));
    places.zip(moving).zip(constant).zip(given).with_min_len(TASK).for_each(
        |((((position, orientation), (linear, angular)), ((&inertia, &motion), &course)), (v, before))| {
            let of = |v: &[f64]| [0, 3].map(|part| Vec3::from_slice(&v[part..part + 3]));
            let ([u0, w0], [u, w]) = (of(before), of(v));
            *linear = u;
            *position += if course == Course::Flies { 0.5 * step * (u0 + u) } else { step * u };
            let rotor = Rotor::new(inertia, *orientation, free_degrees(motions, motion));
            let is_resolved = step * w0.length() <= RESOLVED;
            let gives_back = course == Course::Touched || !is_resolved;
            let turn = rotor.turn([w0, w], step, gives_back);
            v[3..].copy_from_slice(&turn.kicked.to_array());
            (*orientation, *angular) = (turn.orientation, turn.spin);
        },
    );
    kicked
}

/// exp(rotation) Q, renormalised.
fn turned(orientation: Quat, rotation: Vec3) -> Quat {
    if rotation == Vec3::ZERO {
        return orientation;
    }
    (rotation_exponential(rotation) * orientation).normalize()
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
    fn coasting_keeps_energy_and_angular_momentum() {
        let inertia = Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0));
        let orientation = Quat::from_xyzw(0.1, -0.4, 0.3, 0.8).normalize();
        let rotor = Rotor::new(inertia, orientation, [true; 6]);
        for w in [Vec3::new(0.3, 2.0, -0.1), Vec3::new(-30.0, 2.0, 50.0)] {
            let w = orientation * w;
            let end = rotor.coast(w, 0.1);
            let momentum = |at: Quat, w: Vec3| world_inertia(inertia, at) * w;
            let [before, after] = [momentum(orientation, w), momentum(end.orientation, end.spin)];
            assert!((after - before).length() < 1e-13 * before.length());
            assert!((end.spin.dot(after) / w.dot(before) - 1.0).abs() < 1e-13);
            assert!((end.spin - w).length() > 1e-3);
        }
    }

    /// The mean is that of many short turns, and torques change the angular momentum by their impulse.
    #[test]
    fn a_step_turns_by_its_mean_and_keeps_the_impulse_of_torques() {
        let inertia = Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0));
        let start = Quat::from_xyzw(0.1, -0.4, 0.3, 0.8).normalize();
        let rotor = Rotor::new(inertia, start, [true; 6]);
        let (w, step, count) = (Vec3::new(0.5, 2.0, -0.4), 0.02, 100);
        let (mut short, mut spin, mut sum) = (rotor, w, Vec3::ZERO);
        for _ in 0..count {
            let turn = short.coast(spin, step / f64::from(count));
            sum += turn.mean / f64::from(count);
            (short.orientation, spin) = (turn.orientation, turn.spin);
        }
        let mean = rotor.coast(w, step).mean;
        assert!((mean - sum).length() < 2e-2 * (mean - w).length(), "{mean} {sum} {w}");
        let impulse = Vec3::new(0.3, -0.2, 0.1);
        let end = rotor.turn([w, mean + world_inertia(inertia, start).inverse() * impulse], step, false);
        let change = world_inertia(inertia, end.orientation) * end.spin - world_inertia(inertia, start) * w;
        assert!((change - impulse).length() < 1e-13, "{change}");
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
