//! Streams of bodies into a world, and outlets out of it.
//!
//! Everything random about the k-th body of a stream follows from the seed and k, and the places that are
//! tried for it in a step from those and the number of the step: a run that was stopped goes on with the same
//! bits.

use crate::body_numbers::BodyNumbers;
use crate::random::Random;
use crate::scene::radius::{self, RadiusDistribution};
use graintrain::collide::Collider;
use graintrain::collide::places::{Newcomer, Places};
use graintrain::error::ModelError;
use graintrain::handle::{BodyId, GeometryId, MaterialId, MotionId};
use graintrain::load::Region;
use graintrain::math::{Quat, Vec3, mix};
use graintrain::shape::{Geometry, Shape};
use graintrain::world::{Body, World};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Places tried for a body per step; if none is free it waits for the next one.
const TRIES: usize = 200;

/// Most bodies that a stream gives in a step.
const MOST_PER_STEP: usize = 2_000;

/// Rates and amounts are met up to this relative round-off.
const ROUND_OFF: f64 = 1e-9;

/// How fast bodies come.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Rate {
    /// Bodies per second.
    Number(f64),
    /// kg/s
    Mass(f64),
    /// As many as find a free place.
    Free,
}

/// What comes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Grain {
    /// Spheres.
    Sphere(RadiusDistribution),
    /// Bodies of a form.
    Form(Geometry),
}

/// A stream of bodies into a region.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stream {
    /// Its name.
    pub name: String,
    /// Bodies enter wholly inside.
    pub region: Region,
    /// What comes.
    pub grain: Grain,
    /// Whether bodies are turned at random.
    pub random_rotation: bool,
    /// Their material.
    pub material: MaterialId,
    /// Their motion.
    pub motion: MotionId,
    /// m/s
    pub velocity: Vec3,
    /// How fast they come.
    pub rate: Rate,
    /// Time from which on they come, s, from the beginning of the stage if it has one.
    pub start: f64,
    /// Time at which the stream ends, s, likewise.
    pub end: Option<f64>,
    /// Bodies after which it ends.
    pub count: Option<u64>,
    /// Mass (kg) that it does not go beyond.
    pub mass: Option<f64>,
    /// Number of the stage in which it flows; `None`: in all.
    pub stage: Option<usize>,
    /// Seed.
    pub seed: u64,
}

/// Bodies that have come or gone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Amount {
    /// How many.
    pub bodies: u64,
    /// kg
    pub mass: f64,
    /// Kinetic energy that they had, J.
    pub kinetic: f64,
}

impl Amount {
    /// Adds another.
    pub fn add(&mut self, other: &Self) {
        self.bodies += other.bodies;
        self.mass += other.mass;
        self.kinetic += other.kinetic;
    }

    /// Of one body.
    fn of(world: &World, body: usize) -> Self {
        let bodies = &world.bodies;
        let w = bodies.orientation[body].inverse() * bodies.angular_velocity[body];
        let kinetic = 0.5
            * (bodies.mass[body] * world.fluctuation(body).length_squared()
                + w.dot(bodies.inertia[body] * w));
        Self { bodies: 1, mass: bodies.mass[body], kinetic }
    }
}

/// What a stream has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StreamState {
    /// What it gave.
    pub given: Amount,
    /// Whether it has given all.
    pub is_done: bool,
    /// Whether a body waits for a free place.
    pub waits: bool,
    /// Steps in which a body waited.
    pub steps_waited: u64,
}

/// When a step begins, in the terms of a stream.
#[derive(Clone, Copy)]
pub struct Moment {
    /// Number of the stage.
    pub stage: usize,
    /// Time at which that began, s.
    pub stage_time: f64,
    /// Length of the step, s.
    pub step: f64,
}

impl Stream {
    /// Radius and orientation of the k-th body, with its form.
    fn grain(&self, number: u64) -> Result<(Geometry, Quat), ModelError> {
        let mut random = Random::new(mix(self.seed).wrapping_add(number));
        let geometry = match &self.grain {
            Grain::Sphere(radii) => Geometry::sphere(radius::one(radii, &mut random))?,
            Grain::Form(geometry) => geometry.clone(),
        };
        let turn = if self.random_rotation { random.rotation() } else { Quat::IDENTITY };
        Ok((geometry, turn))
    }

    /// Whether another body of this mass (kg) is due by the end of a step, so long (s) after the beginning of
    /// the stream.
    fn is_due(&self, given: &Amount, mass: f64, elapsed: f64) -> bool {
        let elapsed = elapsed * (1.0 + ROUND_OFF);
        match self.rate {
            Rate::Number(rate) => (given.bodies + 1) as f64 <= rate * elapsed,
            Rate::Mass(rate) => given.mass + mass <= rate * elapsed,
            Rate::Free => true,
        }
    }

    /// Lets the bodies in that come with the step that begins now.
    ///
    /// # Errors
    /// [`ModelError`] for bodies that the world does not take, which streams of scenes have none of.
    pub fn flow(
        &self,
        index: u32,
        world: &mut World,
        collider: &mut Collider,
        numbers: &mut BodyNumbers,
        state: &mut StreamState,
        now: Moment,
    ) -> Result<(), ModelError> {
        let begin = if self.stage.is_some() { now.stage_time } else { 0.0 };
        let elapsed = world.time + now.step - begin - self.start;
        if state.is_done || self.stage.is_some_and(|stage| stage != now.stage) || elapsed < 0.5 * now.step {
            return Ok(());
        }
        if self.end.is_some_and(|end| world.time - begin >= end - ROUND_OFF * now.step) {
            (state.is_done, state.waits) = (true, false);
            return Ok(());
        }
        let (low, high) = bounds(&self.region);
        let (mut collider, mut places) = (Some(collider), None);
        let mut entered: Vec<(Vec3, f64)> = Vec::new();
        while entered.len() < MOST_PER_STEP {
            if self.count.is_some_and(|count| state.given.bodies >= count) {
                state.is_done = true;
                break;
            }
            let number = state.given.bodies;
            let (geometry, orientation) = self.grain(number)?;
            let mass = world.materials.density[self.material.index()] * geometry.volume;
            if self.mass.is_some_and(|most| state.given.mass + mass > most * (1.0 + ROUND_OFF)) {
                state.is_done = true;
                break;
            }
            if !self.is_due(&state.given, mass, elapsed) {
                break;
            }
            // Only once something is due: looking at all bodies is not free.
            if let Some(collider) = collider.take() {
                places = Some(Places::new(collider, world, low, high));
            }
            let newcomer = Newcomer::new(&geometry);
            let radius = newcomer.bounding_radius();
            let mut random =
                Random::new(mix(mix(self.seed ^ PLACES).wrapping_add(number)).wrapping_add(world.step));
            // A cell that was compressed has no place for bodies that it had one for.
            let has_room = world.cell().is_none_or(|cell| 4.0 * radius < cell.smallest_edge());
            let tries = if has_room { TRIES } else { 0 };
            let found = (0..tries).map_while(|_| random.place(&self.region, radius)).find(|&place| {
                let free = |places: &Places<'_>| {
                    places.is_free(world, &newcomer, (place, orientation), 0.0, &entered)
                };
                places.as_ref().is_some_and(free)
            });
            let Some(position) = found else {
                state.waits = true;
                state.steps_waited += 1;
                return self.settle(index, world, numbers, state, &entered);
            };
            entered.push((position, radius));
            state.given.bodies += 1;
            state.given.mass += mass;
        }
        state.waits = false;
        self.settle(index, world, numbers, state, &entered)
    }

    /// Puts the bodies that have found a place into the world.
    fn settle(
        &self,
        index: u32,
        world: &mut World,
        numbers: &mut BodyNumbers,
        state: &mut StreamState,
        entered: &[(Vec3, f64)],
    ) -> Result<(), ModelError> {
        let first = state.given.bodies - entered.len() as u64;
        // Equal forms are shared; balls of sizes of their own take the places of those that nobody has any
        // more, or memory would grow for as long as bodies come and leave.
        let is_common = match &self.grain {
            Grain::Form(_) => true,
            Grain::Sphere(radii) => radii.is_discrete(),
        };
        let mut unused = if is_common || entered.is_empty() { Vec::new() } else { unused_balls(world) };
        for (number, &(position, _)) in (first..).zip(entered) {
            let (geometry, orientation) = self.grain(number)?;
            // The last ones are the likeliest to be equal.
            let same = |known: &Arc<Geometry>| is_common && **known == geometry;
            let known = world.geometries.iter().rposition(same);
            let geometry = match (known, unused.pop()) {
                (Some(known), _) => GeometryId::from_index(known),
                (None, Some(place)) => {
                    world.geometries[place] = Arc::new(geometry);
                    GeometryId::from_index(place)
                }
                (None, None) => world.add_geometry(geometry),
            };
            // Relative to a cell that deforms.
            let along = world.cell().map(|cell| cell.gradient_times(position - cell.centre()));
            let body = Body {
                motion: self.motion,
                velocity: self.velocity + along.unwrap_or(Vec3::ZERO),
                orientation,
                ..Body::new(geometry, self.material, position)
            };
            numbers.enter(world.bodies.len(), index);
            let body = world.add_body(body)?;
            state.given.kinetic += Amount::of(world, body.index()).kinetic;
        }
        Ok(())
    }

    /// Whether it is one of a world with these materials and motions.
    pub(crate) fn fits(&self, world: &World) -> bool {
        let numbers = [self.start, self.end.unwrap_or(0.0), self.mass.unwrap_or(0.0)];
        let rate = match self.rate {
            Rate::Number(rate) | Rate::Mass(rate) => rate,
            Rate::Free => 1.0,
        };
        let (low, high) = bounds(&self.region);
        let sizes = match &self.grain {
            Grain::Sphere(radii) => radii.is_sound(),
            Grain::Form(geometry) => geometry.volume > 0.0 && geometry.scaled(1.0).is_ok(),
        };
        let motion = self.motion == graintrain::world::FREE || self.motion.index() < world.motions.len();
        numbers.iter().all(|number| number.is_finite())
            && rate.is_finite()
            && rate > 0.0
            && low.is_finite()
            && high.is_finite()
            && sizes
            && motion
            && self.velocity.is_finite()
            && self.material.index() < world.materials.density.len()
    }
}

/// Tells the places of bodies from their sizes.
const PLACES: u64 = 0x706c_6163_6573_2101;

/// The box around a region.
fn bounds(region: &Region) -> (Vec3, Vec3) {
    match *region {
        Region::Box { min, max } => (min, max),
        Region::Cylinder { base, radius, height } => {
            let across = Vec3::new(radius, radius, 0.0);
            (base - across, base + across + height * Vec3::Z)
        }
    }
}

/// Where bodies leave the world. Their centres of mass decide.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Exit {
    /// On the side of a plane to which its normal points.
    Behind {
        /// A point of the plane, m.
        point: Vec3,
        /// Its unit normal.
        normal: Vec3,
    },
    /// Outside of a region.
    Outside(Region),
    /// Inside of a region.
    Inside(Region),
}

/// Takes bodies out of the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outlet {
    /// Its name.
    pub name: String,
    /// Where.
    pub exit: Exit,
}

impl Outlet {
    /// Whether it takes a body. Single bodies of a scene, which have names, and prescribed ones stay.
    pub fn takes(&self, world: &World, body: usize) -> bool {
        let position = world.bodies.position[body];
        world.bodies.name[body].is_empty()
            && !world.is_prescribed(body)
            && match &self.exit {
                Exit::Behind { point, normal } => (position - *point).dot(*normal) > 0.0,
                Exit::Outside(region) => !region.contains(position),
                Exit::Inside(region) => region.contains(position),
            }
    }
}

/// Takes bodies out through the outlets, each through the first that takes it. Returned is the new index of
/// every former body; `None` where nobody leaves.
pub fn take_out(world: &mut World, outlets: &[Outlet], gone: &mut [Amount]) -> Option<Vec<Option<BodyId>>> {
    if outlets.is_empty() {
        return None;
    }
    let taken: Vec<Option<usize>> = (0..world.bodies.len())
        .map(|body| outlets.iter().position(|outlet| outlet.takes(world, body)))
        .collect();
    for (body, outlet) in taken.iter().enumerate() {
        if let Some(outlet) = outlet {
            gone[*outlet].add(&Amount::of(world, body));
        }
    }
    taken.iter().any(Option::is_some).then(|| world.remove_bodies(|body| taken[body].is_some()))
}

/// Places of single balls among the forms of a world that no body has, descending.
fn unused_balls(world: &World) -> Vec<usize> {
    let mut used = vec![false; world.geometries.len()];
    world.bodies.geometry.iter().for_each(|geometry| used[geometry.index()] = true);
    let is_ball = |geometry: &Geometry| match geometry.parts.as_slice() {
        [part] => matches!(part.shape, Shape::Sphere(_)) && part.position == Vec3::ZERO,
        _ => false,
    };
    (0..used.len()).rev().filter(|&form| !used[form] && is_ball(&world.geometries[form])).collect()
}
