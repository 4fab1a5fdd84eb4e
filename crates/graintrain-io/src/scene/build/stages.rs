//! Stages of a scene with the bodies, materials and loads that they change.

use super::{Builder, Scene, SceneError, SceneErrorKind, function, materials, model_error, motion_of};
use crate::stage::Stage;
use std::collections::HashMap;

impl Builder {
    /// The stages of the scene, after all bodies and loads are there.
    pub(super) fn stages(&self, scene: &Scene) -> Result<Vec<Stage>, SceneError> {
        let whole_steps = |time: f64| (time / scene.time.step).round() as u64;
        let mut list = scene.materials.clone();
        let mut stages = Vec::new();
        for spec in &scene.stages {
            let fail =
                |problem: String| SceneError::at(SceneErrorKind::Contradiction(problem), &spec.location);
            for (name, change) in &spec.materials {
                for (_, material) in list.iter_mut().filter(|(known, _)| known == name) {
                    material.friction = change.friction.unwrap_or(material.friction);
                    material.restitution = change.restitution.unwrap_or(material.restitution);
                }
            }
            let mut motions = Vec::new();
            for (name, body) in &spec.bodies {
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
            let loads = match &spec.loads {
                None => None,
                Some(names) => {
                    // A builder with the same bodies and these loads alone.
                    let mut other = self.without_loads();
                    for (name, load) in scene.loads.iter().filter(|(name, _)| names.contains(name)) {
                        other.add_load(name, load)?;
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
                gravity,
                materials: if spec.materials.is_empty() { None } else { Some(materials(scene, &list)?.0) },
                motions,
                loads,
            });
        }
        Ok(stages)
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
        }
    }
}
