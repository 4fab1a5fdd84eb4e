//! Loads: forces and torques on bodies besides gravity and contact, as functions of time and place.
//!
//! In every step loads are summed into [`Bodies::force`](crate::world::Bodies::force) and `torque`, on top of
//! what a program has set there, before contacts are looked for; after the step the program's own values are
//! back. Functions of time enter with their mean over the step, so that the impulse of a load is exact; what
//! depends on position or orientation is taken at the start of the step. Drag acts on the velocity after the
//! step, contacts and all ([`Action::Drag`]). Where forces change from step to step, contacts are looked for
//! twice per step: those found at its end do not hold for the next.

use crate::cell::Cell;
use crate::error::{ModelError, finite, not_below_zero, positive};
use crate::handle::BodyId;
use crate::math::Vec3;
use crate::motion::{Axes, Profile};
use crate::world::World;
use graintrain_linalg::real;
use serde::{Deserialize, Serialize};

/// A region of space, m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Region {
    /// Box along the axes.
    Box {
        /// Lower corner.
        min: Vec3,
        /// Upper corner.
        max: Vec3,
    },
    /// Upright cylinder.
    Cylinder {
        /// Centre of the lower end.
        base: Vec3,
        /// Radius.
        radius: f64,
        /// Height.
        height: f64,
    },
}

impl Region {
    /// Whether a point lies inside or on the surface.
    pub fn contains(&self, point: Vec3) -> bool {
        match *self {
            Self::Box { min, max } => point.cmpge(min).all() && point.cmple(max).all(),
            Self::Cylinder { base, radius, height } => {
                let d = point - base;
                real::hypot(d.x, d.y) <= radius && (0.0..=height).contains(&d.z)
            }
        }
    }
}

/// What acts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Action {
    /// The force sum_i direction_i f_i(t), N, at a point of the body.
    Force {
        /// Directions (any vectors, not normalised) with the function of time that each is multiplied by.
        terms: Vec<(Vec3, Profile)>,
        /// Axes of the directions.
        axes: Axes,
        /// Where it acts, from the centre of mass in body axes, m.
        point: Vec3,
    },
    /// The torque sum_i direction_i f_i(t), N m.
    Torque {
        /// Directions with the function of time that each is multiplied by.
        terms: Vec<(Vec3, Profile)>,
        /// Axes of the directions.
        axes: Axes,
    },
    /// A uniform field, m/s^2: the force m a(t) at the centre of mass.
    Uniform {
        /// Components of the acceleration in world axes.
        acceleration: [Profile; 3],
    },
    /// A central field: at the distance r from the centre the acceleration strength (r / distance)^power
    /// toward it, and none at the centre itself.
    Central {
        /// m
        centre: Vec3,
        /// Acceleration at the given distance, m/s^2; negative: away from the centre.
        strength: f64,
        /// m
        distance: f64,
        /// -2 for gravity outside a planet, 1 for a spring.
        power: f64,
    },
    /// Drag of a medium against the velocity u relative to it, and against turning,
    ///
    /// ```text
    /// F = -(linear + quadratic |u|) u,   T = -angular w
    /// ```
    ///
    /// by an implicit step, m (u+ - u) = dt (F - (linear + quadratic |u|) u+) + contact impulses, which no
    /// step length makes unstable: drag never turns a body back relative to the medium, what falls reaches
    /// the velocity at which drag carries it, and what a wall holds feels the whole wind. The torque
    /// likewise.
    Drag {
        /// N s/m
        linear: f64,
        /// N s^2/m^2: 1/2 density c_d area.
        quadratic: f64,
        /// N m s
        angular: f64,
        /// Velocity of the medium, m/s.
        medium: Vec3,
    },
}

/// A load on some bodies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Load {
    /// The bodies; `None`: all.
    pub bodies: Option<Vec<BodyId>>,
    /// Acts only on bodies whose centre of mass is in the region at the start of a step.
    pub region: Option<Region>,
    /// What acts.
    pub action: Action,
}

impl Load {
    /// On one body.
    pub fn on(body: BodyId, action: Action) -> Self {
        Self { bodies: Some(vec![body]), region: None, action }
    }

    /// On all bodies.
    pub fn on_all(action: Action) -> Self {
        Self { bodies: None, region: None, action }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// [`ModelError`] for the first defect.
    pub fn validate(&self) -> Result<(), ModelError> {
        match self.region {
            Some(Region::Box { min, max }) => {
                finite("a corner of a region", &[min.to_array(), max.to_array()].concat())?;
                (max - min)
                    .to_array()
                    .into_iter()
                    .try_for_each(|edge| positive("an edge of a region", edge))?;
            }
            Some(Region::Cylinder { base, radius, height }) => {
                finite("the base of a region", &base.to_array())?;
                positive("the radius of a region", radius)?;
                positive("the height of a region", height)?;
            }
            None => {}
        }
        match &self.action {
            Action::Force { terms, point, .. } => {
                finite("the point of a load", &point.to_array())?;
                validate_terms(terms)
            }
            Action::Torque { terms, .. } => validate_terms(terms),
            Action::Uniform { acceleration } => acceleration.iter().try_for_each(Profile::validate),
            Action::Central { centre, strength, distance, power } => {
                finite("the centre of a field", &centre.to_array())?;
                finite("the strength or power of a field", &[*strength, *power])?;
                positive("the distance at which a field has its strength", *distance)
            }
            Action::Drag { linear, quadratic, angular, medium } => {
                finite("the velocity of a medium", &medium.to_array())?;
                let all = [*linear, *quadratic, *angular];
                all.into_iter().try_for_each(|value| not_below_zero("a coefficient of drag", value))
            }
        }
    }
}

fn validate_terms(terms: &[(Vec3, Profile)]) -> Result<(), ModelError> {
    terms.iter().try_for_each(|(direction, profile)| {
        finite("a direction of a load", &direction.to_array())?;
        profile.validate()
    })
}

/// The mean of sum_i direction_i f_i over a step.
fn mean_of(terms: &[(Vec3, Profile)], time: f64, step: f64) -> Vec3 {
    terms.iter().map(|(direction, profile)| *direction * profile.mean(time, step)).sum()
}

/// What loads change of a world for the time of a step.
pub(crate) struct Unloaded {
    gravity: Vec3,
    force: Vec<Vec3>,
    torque: Vec<Vec3>,
}

/// Sums the loads of the step that begins now into the bodies' forces and torques, and sets gravity to its
/// mean over the step where it depends on time. Returned is what was there; `None` where there is nothing to
/// do.
pub(crate) fn apply(world: &mut World, step: f64) -> Option<Unloaded> {
    if world.loads.is_empty() && world.gravity_of_time.is_none() {
        return None;
    }
    let before = Unloaded {
        gravity: world.gravity,
        force: world.bodies.force.clone(),
        torque: world.bodies.torque.clone(),
    };
    let time = world.time;
    if let Some(gravity) = &world.gravity_of_time {
        world.gravity = Vec3::from_array(gravity.each_ref().map(|profile| profile.mean(time, step)));
    }
    let loads = std::mem::take(&mut world.loads);
    if loads.iter().any(|load| matches!(load.action, Action::Drag { .. })) {
        world.drag = vec![Drag::default(); world.bodies.len()];
    }
    for load in &loads {
        load.apply(world, step);
    }
    world.loads = loads;
    let bodies = &world.bodies;
    for ((drag, mass), u) in world.drag.iter_mut().zip(&bodies.mass).zip(&bodies.velocity) {
        drag.alone = (drag.pull - drag.linear * *u) / (1.0 + step * drag.linear / mass);
    }
    Some(before)
}

/// Takes the loads away again: what a program had set is left, and where the step was not made, the gravity
/// of before. The lists stay where they are in memory, since a program may look at them in place.
pub(crate) fn remove(world: &mut World, before: Unloaded, was_made: bool) {
    world.bodies.force.copy_from_slice(&before.force);
    world.bodies.torque.copy_from_slice(&before.torque);
    world.drag = Vec::new();
    if !was_made {
        world.gravity = before.gravity;
    }
}

/// Whether each body flies where no contact acts: nothing does but gravity and forces that depend on time
/// alone, no joint holds it, nothing of it is prescribed, and no periodic cell that deforms takes it along.
pub(crate) fn flies(world: &World, step: f64) -> Vec<bool> {
    let (bodies, pushed) = (world.bodies.len(), pushed(world, step));
    if world.cell().is_some_and(Cell::deforms) {
        return vec![false; bodies];
    }
    let is_pushed = |body: usize| pushed.get(body).copied().unwrap_or(false);
    let mut flies: Vec<bool> = (0..bodies).map(|body| world.is_free(body) && !is_pushed(body)).collect();
    for body in world.joints().iter().flat_map(|placed| placed.joint.bodies.iter().flatten()) {
        flies[body.index()] = false;
    }
    flies
}

/// The bodies on which more acts in the step from now than gravity and forces that depend on time alone: a
/// torque, drag, a force that depends on place or orientation, or one that a program has set; none: empty.
fn pushed(world: &World, step: f64) -> Vec<bool> {
    let bodies = &world.bodies;
    let acts = |force: &Vec3| *force != Vec3::ZERO;
    if world.drag.is_empty() && !bodies.force.iter().any(acts) && !bodies.torque.iter().any(acts) {
        return Vec::new();
    }
    let mut steady = vec![Vec3::ZERO; bodies.len()];
    for load in world.loads.iter().filter(|load| load.is_steady()) {
        let mean = load.action.mean(world.time, step);
        let mut add = |body: usize| {
            if !world.is_prescribed(body) {
                steady[body] += load.action.on(world, body, mean).0;
            }
        };
        match &load.bodies {
            Some(bodies) => bodies.iter().for_each(|body| add(body.index())),
            None => (0..bodies.len()).for_each(add),
        }
    }
    let is_pushed = |body: usize| {
        let is_dragged = world.drag.get(body).is_some_and(|drag| drag.linear > 0.0 || drag.angular > 0.0);
        is_dragged || acts(&bodies.torque[body]) || bodies.force[body] != steady[body]
    };
    (0..bodies.len()).map(is_pushed).collect()
}

impl Load {
    /// Whether its force depends on time alone.
    fn is_steady(&self) -> bool {
        let of_time = match &self.action {
            Action::Force { axes, .. } => *axes == Axes::World,
            Action::Uniform { .. } => true,
            Action::Torque { .. } | Action::Central { .. } | Action::Drag { .. } => false,
        };
        of_time && self.region.is_none()
    }

    /// Adds the load to the bodies' forces and torques, or to their drag.
    fn apply(&self, world: &mut World, step: f64) {
        let mean = self.action.mean(world.time, step);
        match &self.bodies {
            Some(bodies) => {
                bodies.iter().for_each(|body| self.apply_to(world, body.index(), mean));
            }
            None => (0..world.bodies.len()).for_each(|body| self.apply_to(world, body, mean)),
        }
    }

    fn apply_to(&self, world: &mut World, body: usize, mean: Vec3) {
        let inside = self.region.as_ref().is_none_or(|region| region.contains(world.bodies.position[body]));
        if inside && !world.is_prescribed(body) {
            let (force, torque) = match &self.action {
                Action::Drag { linear, quadratic, angular, medium } => {
                    let coefficient = linear + quadratic * (world.bodies.velocity[body] - *medium).length();
                    let drag = &mut world.drag[body];
                    drag.linear += coefficient;
                    drag.pull += coefficient * *medium;
                    drag.angular += angular;
                    return;
                }
                action => action.on(world, body, mean),
            };
            world.bodies.force[body] += force;
            world.bodies.torque[body] += torque;
        }
    }
}

impl Action {
    /// Means over the step of what is a function of time, the same for all bodies.
    fn mean(&self, time: f64, step: f64) -> Vec3 {
        match self {
            Self::Force { terms, .. } | Self::Torque { terms, .. } => mean_of(terms, time, step),
            Self::Uniform { acceleration } => {
                Vec3::from_array(acceleration.each_ref().map(|profile| profile.mean(time, step)))
            }
            Self::Central { .. } | Self::Drag { .. } => Vec3::ZERO,
        }
    }

    /// Force and torque about the centre of mass, world axes, on a body with a mass; none for drag, which has
    /// a step of its own.
    fn on(&self, world: &World, body: usize, mean: Vec3) -> (Vec3, Vec3) {
        let bodies = &world.bodies;
        let (mass, orientation) = (bodies.mass[body], bodies.orientation[body]);
        let turned = |axes: Axes| match axes {
            Axes::World => mean,
            Axes::Body => orientation * mean,
        };
        match self {
            Self::Force { axes, point, .. } => {
                let force = turned(*axes);
                (force, (orientation * *point).cross(force))
            }
            Self::Torque { axes, .. } => (Vec3::ZERO, turned(*axes)),
            Self::Uniform { .. } => (mass * mean, Vec3::ZERO),
            Self::Central { centre, strength, distance, power } => {
                let toward = *centre - bodies.position[body];
                let r = toward.length();
                if r == 0.0 {
                    return (Vec3::ZERO, Vec3::ZERO);
                }
                (mass * strength * real::powf(r / distance, *power) / r * toward, Vec3::ZERO)
            }
            Self::Drag { .. } => (Vec3::ZERO, Vec3::ZERO),
        }
    }
}

/// Drag on a body in a step: the force `pull - linear u+` and the torque `-angular w+` with the velocities
/// after the step. So the body moves as one of mass m + dt linear and inertia I + dt angular.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Drag {
    /// N s/m
    pub linear: f64,
    /// N m s
    pub angular: f64,
    /// The coefficient times the velocity of the medium, N.
    pub pull: Vec3,
    /// What it would be in the step without other forces, N.
    pub alone: Vec3,
}

/// Adds what drag was with these velocities after the step (six numbers per body) to the forces and torques.
pub(crate) fn add_drag(world: &mut World, after: &[f64]) {
    let bodies = &mut world.bodies;
    for (body, drag) in world.drag.iter().enumerate() {
        let [u, w] = [0, 3].map(|part| Vec3::from_slice(&after[6 * body + part..6 * body + part + 3]));
        bodies.force[body] += drag.pull - drag.linear * u;
        bodies.torque[body] -= drag.angular * w;
    }
}

/// Work of the external forces and torques over a step from the velocities `before` it to those `after` its
/// impulses (six numbers per body), J: `dt (F . (u + u+) / 2 + T . (w + w+) / 2)` over the dynamic degrees of
/// freedom, which is exactly what they add to the kinetic energy of the step.
pub(crate) fn work(world: &World, before: &[f64], after: &[f64], step: f64) -> f64 {
    let bodies = &world.bodies;
    let mut work = 0.0;
    for (body, (force, torque)) in bodies.force.iter().zip(&bodies.torque).enumerate() {
        if *force == Vec3::ZERO && *torque == Vec3::ZERO {
            continue;
        }
        let generalised = force.to_array().into_iter().chain(torque.to_array());
        for (k, (free, f)) in world.free_degrees(body).into_iter().zip(generalised).enumerate() {
            if free {
                work += 0.5 * step * f * (before[6 * body + k] + after[6 * body + k]);
            }
        }
    }
    work
}
