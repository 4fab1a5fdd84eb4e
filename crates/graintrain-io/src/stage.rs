//! Stages of a run: settle, then press, then shear.

use crate::body_numbers::BodyNumbers;
use crate::growth::Growth;
use graintrain::cell::{Cell, Drive};
use graintrain::error::ModelError;
use graintrain::handle::BodyId;
use graintrain::load::Load;
use graintrain::material::Materials;
use graintrain::math::Vec3;
use graintrain::motion::{Motion, Profile};
use graintrain::world::{FREE, World};
use serde::{Deserialize, Serialize};

/// A stage: what changes when it begins, and when it ends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// Its name.
    pub name: String,
    /// Steps after which it ends, whatever the other conditions; `None`: with the run.
    pub most: Option<u64>,
    /// Steps before which no other condition ends it.
    pub least: u64,
    /// It ends when the kinetic energy per body that can move is below this, J.
    pub kinetic_energy: Option<f64>,
    /// It ends when the mean net force is below this share of the mean contact force.
    pub unbalanced_force: Option<f64>,
    /// It ends when all streams that flow in it have given all.
    pub filled: bool,
    /// It ends when a measured quantity is steady.
    pub steady: Option<Steady>,
    /// Bodies that grow; it ends when the porosity is reached.
    pub growth: Option<Growth>,
    /// m/s^2
    pub gravity: Option<[Profile; 3]>,
    /// All materials, where some change.
    pub materials: Option<Materials>,
    /// New motions of bodies, `None` for free ones; their times count from the beginning of the stage.
    pub motions: Vec<(BodyId, Option<Motion>)>,
    /// What drives the periodic cell; times count from the beginning of the stage.
    pub cell: Option<CellDrive>,
    /// All loads, where they change; their bodies by numbers.
    pub loads: Option<Vec<Load>>,
}

/// What drives a periodic cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellDrive {
    /// By component.
    pub drive: [Drive; 6],
    /// Largest rate of components whose stress is imposed, 1/s.
    pub fastest: f64,
}

impl CellDrive {
    /// A cell so driven, with times from `now` (s).
    pub(crate) fn of(&self, cell: Cell, now: f64) -> Cell {
        let drive = self.drive.clone().map(|drive| match drive {
            Drive::Rate(profile) => Drive::Rate(from_now(&profile, now)),
            Drive::Stress(profile) => Drive::Stress(from_now(&profile, now)),
        });
        Cell { drive, fastest: self.fastest, ..cell }
    }
}

/// When a measured quantity counts as steady: over the latest records, the mean of the first half and that of
/// the second differ by no more than is allowed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Steady {
    /// Number of the measurement.
    pub measure: usize,
    /// Number of the column in its table.
    pub column: usize,
    /// How many records are looked at, at least 4.
    pub records: usize,
    /// Largest difference relative to the mean.
    pub change: f64,
    /// Largest difference, in the unit of the column, whatever the mean.
    pub within: f64,
}

impl Steady {
    /// Takes note of a record.
    pub fn note(&self, value: f64, latest: &mut Vec<f64>) {
        latest.push(value);
        latest.drain(..latest.len().saturating_sub(self.records));
    }

    /// Whether the latest records are steady.
    pub fn holds(&self, latest: &[f64]) -> bool {
        if latest.len() < self.records || latest.len() < 2 {
            return false;
        }
        let mean = |list: &[f64]| list.iter().sum::<f64>() / list.len() as f64;
        let (first, second) = latest.split_at(latest.len() / 2);
        let allowed = self.within.max(self.change * mean(latest).abs());
        // False where a record is no number.
        (mean(first) - mean(second)).abs() <= allowed
    }
}

/// What ended a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StageEnd {
    /// Its time was over.
    Time,
    /// Kinetic energy.
    KineticEnergy,
    /// Unbalanced force.
    UnbalancedForce,
    /// All streams had given all.
    Filled,
    /// The porosity that bodies grow to.
    Porosity,
    /// A measured quantity was steady.
    Steady,
}

/// A stage that has begun.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageRecord {
    /// Its name.
    pub name: String,
    /// Number of steps that were made before it.
    pub first_step: u64,
    /// Number of its last step, once it has ended.
    pub last_step: Option<u64>,
    /// What ended it.
    pub end: Option<StageEnd>,
}

/// What the end of a stage may depend on.
#[derive(Clone, Copy)]
pub struct Progress<'a> {
    /// The state after a step.
    pub world: &'a World,
    /// The step's number in the stage, from 1.
    pub made: u64,
    /// Its length, s.
    pub step: f64,
    /// Velocities before it (m/s), where the stage compares them.
    pub before: Option<&'a [Vec3]>,
    /// Whether all streams of the stage have given all.
    pub is_filled: bool,
    /// The latest records of what is to be steady.
    pub latest: &'a [f64],
}

/// The profile with its time counted from now.
fn from_now(profile: &Profile, now: f64) -> Profile {
    match profile {
        Profile::Constant(_) => profile.clone(),
        other => Profile::Delayed { start: now, profile: Box::new(other.clone()) },
    }
}

impl Stage {
    /// Whether it needs the velocities of bodies before a step.
    pub fn compares_velocities(&self) -> bool {
        self.unbalanced_force.is_some()
    }

    /// Makes its changes to the bodies of these numbers.
    ///
    /// # Errors
    /// [`ModelError`] for changes that do not fit the world, which those of a scene do.
    pub fn begin(&self, world: &mut World, numbers: &BodyNumbers) -> Result<(), ModelError> {
        let now = world.time;
        if let Some(growth) = &self.growth {
            growth.begin(world, numbers)?;
        }
        if let Some(gravity) = &self.gravity {
            match gravity {
                [Profile::Constant(x), Profile::Constant(y), Profile::Constant(z)] => {
                    (world.gravity, world.gravity_of_time) = (Vec3::new(*x, *y, *z), None);
                }
                functions => world.set_gravity_of_time(functions.clone())?,
            }
        }
        if let Some(materials) = &self.materials {
            world.materials = materials.clone();
        }
        for (body, motion) in &self.motions {
            let id = match motion {
                None => FREE,
                Some(motion) => {
                    let mut motion = motion.clone();
                    motion.translation.iter_mut().for_each(|(_, profile)| *profile = from_now(profile, now));
                    motion.rotation.iter_mut().for_each(|turn| turn.profile = from_now(&turn.profile, now));
                    world.add_motion(motion)?
                }
            };
            let index = body.index();
            if index >= world.bodies.len() {
                return Err(ModelError::Index { what: "body", index, len: world.bodies.len() });
            }
            world.bodies.motion[index] = id;
        }
        if let Some(cell) = world.cell().cloned() {
            let cell = match &self.cell {
                Some(driven) => driven.of(cell, now),
                None => cell,
            };
            // Motions have to fit a cell that goes on as it was, too.
            if self.cell.is_some() || !self.motions.is_empty() {
                world.set_cell(Some(cell))?;
            }
        }
        match &self.loads {
            Some(loads) => {
                let there = |load: &Load| {
                    let bodies = load.bodies.as_ref().map(|bodies| numbers.present(bodies));
                    Load { bodies, ..load.clone() }
                };
                world.set_loads(loads.iter().map(there).collect())
            }
            None => Ok(()),
        }
    }

    /// What ends it after a step.
    pub fn end(&self, now: Progress<'_>) -> Option<StageEnd> {
        let Progress { world, made, step, before, is_filled, latest } = now;
        if made >= self.least.max(1) {
            let movable = (0..world.bodies.len()).filter(|&body| !world.is_prescribed(body));
            let bodies = movable.count().max(1) as f64;
            if self.kinetic_energy.is_some_and(|limit| world.kinetic_energy() / bodies < limit) {
                return Some(StageEnd::KineticEnergy);
            }
            let balanced = |limit: f64| before.is_some_and(|before| unbalanced(world, step, before) < limit);
            if self.unbalanced_force.is_some_and(balanced) {
                return Some(StageEnd::UnbalancedForce);
            }
            if self.filled && is_filled {
                return Some(StageEnd::Filled);
            }
            if self.growth.as_ref().is_some_and(|growth| growth.is_reached(world)) {
                return Some(StageEnd::Porosity);
            }
            if self.steady.as_ref().is_some_and(|steady| steady.holds(latest)) {
                return Some(StageEnd::Steady);
            }
        }
        self.most.is_some_and(|most| made >= most).then_some(StageEnd::Time)
    }
}

/// Mean net force (mass times change of velocity over the step; relative to the deformation of a periodic
/// cell) on the bodies that are free, over the mean contact force; infinite without contact forces.
fn unbalanced(world: &World, step: f64, before: &[Vec3]) -> f64 {
    let free: Vec<usize> = (0..world.bodies.len()).filter(|&body| world.is_free(body)).collect();
    let net = |&body: &usize| world.bodies.mass[body] * (world.fluctuation(body) - before[body]).length();
    let impulses: Vec<f64> =
        world.contacts.impulse.iter().map(|g| g.length()).filter(|length| *length > 0.0).collect();
    if impulses.is_empty() {
        return f64::INFINITY;
    }
    let force = impulses.iter().sum::<f64>() / impulses.len() as f64 / step;
    free.iter().map(net).sum::<f64>() / step / free.len().max(1) as f64 / force
}
