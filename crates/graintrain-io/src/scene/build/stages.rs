//! Stages of a scene with the bodies, materials and loads that they change.

use super::periodic::cell_drive;
use super::{Builder, Scene, SceneError, SceneErrorKind, function, materials, model_error, motion_of};
use crate::growth::Growth;
use crate::measure::{Measure, Quantity};
use crate::scene::SteadySpec;
use crate::stage::{CellDrive, Stage, Steady};
use graintrain::error::ModelError;
use graintrain::handle::BodyId;
use graintrain::motion::Motion;
use graintrain::world::{FREE, World};
use std::collections::HashMap;

impl Builder {
    /// The stages of the scene, after all bodies and loads are there.
    pub(super) fn stages(&self, scene: &Scene, measures: &[Measure]) -> Result<Vec<Stage>, SceneError> {
        let whole_steps = |time: f64| (time / scene.time.step).round() as u64;
        let mut list = scene.materials.clone();
        let mut stages = Vec::new();
        // Motions and drives stay until a stage changes them.
        let mut driven = self.world.clone();
        for spec in &scene.stages {
            let fail =
                |problem: String| SceneError::at(SceneErrorKind::Contradiction(problem), &spec.location);
            for (name, change) in &spec.material {
                for (_, material) in list.iter_mut().filter(|(known, _)| known == name) {
                    material.friction = change.friction.unwrap_or(material.friction);
                    material.restitution = change.restitution.unwrap_or(material.restitution);
                }
            }
            let mut motions = Vec::new();
            for (name, body) in &spec.body {
                let id = self.bodies_named(std::slice::from_ref(name), &[]).unwrap_or_default()[0];
                let centre = self.centres.get(&id.index()).copied().unwrap_or_default();
                let motion = motion_of(&body.motion, centre)?;
                let moves = motion.as_ref().is_none_or(|motion| !motion.is_prescribed());
                if moves && self.world.bodies.mass[id.index()] <= 0.0 {
                    return Err(fail(format!(
                        "`{name}` has no mass, so that the stage `{}` cannot free it: give it mass and inertia",
                        spec.name
                    )));
                }
                if let Some(motion) = &motion {
                    motion.validate().map_err(|error| model_error(error, &spec.location))?;
                }
                motions.push((id, motion));
            }
            let cell = spec.periodic.as_ref().map(cell_drive).transpose()?;
            fit(&mut driven, &motions, cell.as_ref(), scene.time.step)
                .map_err(|error| model_error(error, &spec.location))?;
            let loads = match &spec.loads {
                None => None,
                Some(names) => {
                    // A builder with the same bodies and these loads alone.
                    let mut other = self.without_loads();
                    for (name, load) in scene.loads.iter().filter(|(name, _)| names.contains(name)) {
                        other.add_load(name, load, scene)?;
                    }
                    Some(other.world.loads().to_vec())
                }
            };
            let gravity = match &spec.gravity {
                None => None,
                Some([x, y, z]) => Some([function(x)?, function(y)?, function(z)?]),
            };
            stages.push(Stage {
                name: spec.name.clone(),
                most: spec.time.map(|time| whole_steps(time).max(1)),
                least: whole_steps(spec.at_least),
                kinetic_energy: spec.kinetic_energy,
                unbalanced_force: spec.unbalanced_force,
                filled: spec.filled,
                steady: spec
                    .steady
                    .as_ref()
                    .map(|steady| found(steady, measures, scene.time.step))
                    .transpose()
                    .map_err(fail)?,
                growth: spec.growth.as_ref().map(|growth| Growth {
                    members: self.grains(&growth.packings, &growth.streams),
                    rate: growth.rate,
                    porosity: growth.porosity,
                    region: growth.region.clone(),
                }),
                gravity,
                materials: if spec.material.is_empty() {
                    None
                } else {
                    Some(materials(scene, &list, Some(&spec.location))?.0)
                },
                motions,
                cell,
                loads,
            });
        }
        Ok(stages)
    }

    /// Bodies that a stage frees, wholly or in part.
    pub(super) fn freed_by_stages(&self, scene: &Scene) -> Vec<BodyId> {
        let changed = scene.stages.iter().flat_map(|stage| &stage.body);
        changed
            .filter(|(_, body)| body.motion.free.contains(&true))
            .flat_map(|(name, _)| self.bodies_named(std::slice::from_ref(name), &[]).unwrap_or_default())
            .collect()
    }

    /// The same bodies without loads.
    fn without_loads(&self) -> Self {
        let mut world = self.world.clone();
        // An empty list fits every world.
        let _ = world.set_loads(Vec::new());
        let origins = self.origins.clone();
        Self {
            world,
            materials: self.materials.clone(),
            spheres: HashMap::new(),
            locked_rotation: None,
            smallest_radius: self.smallest_radius,
            origins,
            centres: self.centres.clone(),
            streams: self.streams.clone(),
        }
    }
}

/// Gives a world the motions of a stage and what drives its cell, so that what does not go together is seen
/// before the run gets there.
fn fit(
    world: &mut World,
    motions: &[(BodyId, Option<Motion>)],
    drive: Option<&CellDrive>,
    step: f64,
) -> Result<(), ModelError> {
    let Some(cell) = world.cell().cloned() else { return Ok(()) };
    for (body, motion) in motions {
        world.bodies.motion[body.index()] = match motion {
            Some(motion) => world.add_motion(motion.clone())?,
            None => FREE,
        };
    }
    let cell = match drive {
        Some(drive) => drive.of(cell, 0.0),
        None => cell,
    };
    cell.validate_step(0.0, step)?;
    world.set_cell(Some(cell))
}

/// What is to be steady, found among the measurements; otherwise what is wrong.
fn found(spec: &SteadySpec, measures: &[Measure], step: f64) -> Result<Steady, String> {
    let SteadySpec { measure: name, column, over, change, within } = spec;
    let position = measures.iter().position(|measure| measure.name == *name);
    let Some((number, measure)) = position.map(|number| (number, &measures[number])) else {
        return Err(format!("there is no measure `{name}`"));
    };
    if measure.quantities.iter().any(Quantity::has_bins) {
        return Err(format!("measure `{name}` has records of bins: take one of a single record"));
    }
    let columns = measure.columns();
    let Some(column) = columns.iter().position(|known| known.name == column) else {
        let names: Vec<&str> = columns.iter().map(|column| column.name).collect();
        return Err(format!("measure `{name}` has no column `{column}`; it has {}", names.join(", ")));
    };
    let records = (over / (measure.every as f64 * step)).round();
    if !(4.0..=1e6).contains(&records) {
        return Err(format!(
            "`over` ({over} s) holds {records} records of measure `{name}`: it takes 4 to a million, two in each half at least"
        ));
    }
    Ok(Steady { measure: number, column, records: records as usize, change: *change, within: *within })
}
