//! How one body turns in a step: free rotation, and the torques that begin it.

use crate::math::{Mat3, Quat, Vec3, rotation_exponential};
use crate::world::World;
use graintrain_linalg::real;

/// Angle, rad, up to which a body may turn in one sub-step of a free rotation; Newton's method then needs
/// three or four iterations.
const TURN_PER_SUBSTEP: f64 = 0.25;

/// More sub-steps than this are not made; a body that turns by more than 250 rad per step is not resolved
/// anyway.
const MAX_SUBSTEPS: f64 = 1000.0;

/// Angle, rad, by which a body on which torques act may turn in a step as [`Rotor::turn`] says.
const FAST: f64 = 1.0;

/// Angle, rad, up to which a step resolves the turn of a body in joints.
pub(crate) const RESOLVED: f64 = 0.5;

/// Rounding of an angular velocity over itself.
const ROUNDING: f64 = 1e-14;

/// Differences by which derivatives are taken, over the value (at least rad per step).
const DIFFERENCE: f64 = 1e-3;

/// Number of the sub-steps of [`Rotor::coast`].
fn spin_substeps(w: Vec3, step: f64) -> usize {
    (step * w.length() / TURN_PER_SUBSTEP).ceil().clamp(1.0, MAX_SUBSTEPS) as usize
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
    /// The axis about which it is the same in all directions as far as its inertia tells, in the world.
    axis: Option<Vec3>,
}

/// A turn without torque, in world axes.
pub(crate) struct Coasting {
    /// Where it leads to.
    pub orientation: Quat,
    /// Angular velocity at its end.
    pub spin: Vec3,
    /// Mean of the angular velocity; beyond [`FAST`] that of the end, in the axes of the start, or tilted
    /// back with the axis.
    pub mean: Vec3,
}

impl Coasting {
    /// The turn that it is, from this angular velocity on.
    fn from(&self, kicked: Vec3) -> Turn {
        Turn { kicked, orientation: self.orientation, spin: self.spin, lost: 0.0 }
    }
}

/// The turn of a step, in world axes.
pub(crate) struct Turn {
    /// Angular velocity at the start once the torques have acted.
    pub kicked: Vec3,
    /// Where the turn leads to.
    pub orientation: Quat,
    /// Angular velocity at its end.
    pub spin: Vec3,
    /// Change of the angular momentum that no torque made, over the angular momentum: of a body beyond
    /// [`FAST`] on which contacts or joints act.
    pub lost: f64,
}

impl Rotor {
    /// With the tensor of inertia about its own axes, kg m^2, and these dynamic degrees of freedom.
    pub(crate) fn new(inertia: Mat3, orientation: Quat, free: [bool; 6]) -> Self {
        let is_steady = is_isotropic(inertia) || free[3..] != [true; 3];
        let [x, y, z] = [inertia.x_axis.x, inertia.y_axis.y, inertia.z_axis.z];
        let is_round = x == y && inertia == Mat3::from_diagonal(Vec3::new(x, y, z));
        Self { inertia, orientation, is_steady, axis: is_round.then(|| orientation * Vec3::Z) }
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
            // Spins of rounding alone may have no square.
            orientation = turned(orientation, angle * across.normalize_or_zero());
        }
        let end = orientation * spin;
        let mean = match self.axis {
            _ if !is_fast(w, step) => sum / substeps as f64,
            // Spin about its own axis turns nothing else.
            Some(axis) => Quat::from_rotation_arc(orientation * Vec3::Z, axis) * end,
            None => start * spin,
        };
        Coasting { orientation, spin: end, mean }
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
    /// torques act turns about m, or tilts its axis as m says, with its energy from before and what they do.
    pub(crate) fn turn(&self, spins: [Vec3; 2], step: f64, gives_back: bool) -> Turn {
        self.turn_beside(&self.coast(spins[0], step), spins, step, gives_back)
    }

    /// The turn of a step in which loads alone act, with the spins (rad/s) as in [`Self::turn`]: from w + d
    /// on, d = m - m* = dt J^-1 T, the body coasts, and L changes by dt T. No contact and no joint asks for a
    /// turn by m, so that this holds however fast the body spins.
    pub(crate) fn pushed(&self, [before, mean]: [Vec3; 2], step: f64) -> Turn {
        let coasting = self.coast(before, step);
        let change = mean - coasting.mean;
        if change.length() <= ROUNDING * mean.length() {
            return coasting.from(before);
        }
        let kicked = before + change;
        self.coast(kicked, step).from(kicked)
    }

    /// [`Self::turn`] where it is known how the body coasts without torques.
    pub(crate) fn turn_beside(
        &self,
        coasting: &Coasting,
        [before, mean]: [Vec3; 2],
        step: f64,
        gives_back: bool,
    ) -> Turn {
        let about =
            |w: Vec3| Turn { kicked: w, orientation: turned(self.orientation, step * w), spin: w, lost: 0.0 };
        if self.is_steady {
            return about(mean);
        }
        let change = mean - coasting.mean;
        if change.length() <= ROUNDING * mean.length() {
            return coasting.from(before);
        }
        let fast = match self.axis {
            Some(axis) if is_fast(before, step) || is_fast(mean, step) => Some(self.tilted(axis, mean, step)),
            None if is_fast(before, step) => Some(about(mean)),
            _ => None,
        };
        if let Some(turn) = fast {
            let asked = self.momentum(before) + self.momentum(change);
            let made = Self { orientation: turn.orientation, ..*self }.momentum(turn.spin);
            let largest =
                [self.momentum(before), made, asked].map(Vec3::length).into_iter().fold(0.0, f64::max);
            let lost = if largest > 0.0 { (made - asked).length() / largest } else { 0.0 };
            return Turn { lost, ..turn };
        }
        let mut kicked = before + change;
        if gives_back {
            let inertia = self.momentum(change);
            let [begin, square, taken] = [before, change, mean].map(|w| inertia.dot(w));
            if begin + 0.5 * square > taken {
                kicked = before + least_change([begin, square, taken]) * change;
            }
        }
        self.coast(kicked, step).from(kicked)
    }

    /// Angular momentum with this angular velocity, world axes.
    fn momentum(&self, w: Vec3) -> Vec3 {
        self.orientation * (self.inertia * (self.orientation.conjugate() * w))
    }

    /// The turn with a constant spin about the axis, which the rest of w tilts: so far that contacts know,
    /// which are linearised for a surface that turns in itself.
    fn tilted(&self, axis: Vec3, w: Vec3, step: f64) -> Turn {
        let own = w.project_onto(axis);
        let across = w - own;
        let orientation = turned(turned(self.orientation, step * own), step * across);
        let spin = across + rotation_exponential(step * across) * own;
        Turn { kicked: w, orientation, spin, lost: 0.0 }
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
pub(crate) fn skew(a: Vec3) -> Mat3 {
    Mat3::from_cols(Vec3::new(0.0, a.z, -a.y), Vec3::new(-a.z, 0.0, a.x), Vec3::new(a.y, -a.x, 0.0))
}

pub(crate) fn is_isotropic(inertia: Mat3) -> bool {
    inertia == Mat3::from_diagonal(Vec3::splat(inertia.x_axis.x))
}

/// R I R^T.
pub(crate) fn world_inertia(inertia: Mat3, orientation: Quat) -> Mat3 {
    let rotation = Mat3::from_quat(orientation);
    rotation * inertia * rotation.transpose()
}

/// exp(rotation) Q, renormalised.
pub(crate) fn turned(orientation: Quat, rotation: Vec3) -> Quat {
    if rotation == Vec3::ZERO {
        return orientation;
    }
    (rotation_exponential(rotation) * orientation).normalize()
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
        for size in [1e-12, 1e-48, 1e-170, 1e-310] {
            let end = rotor.coast(size * Vec3::new(0.0, 1.0, 0.3), 0.01);
            assert!(end.spin.is_finite() && end.orientation.is_finite() && end.mean.is_finite(), "{size}");
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
}
