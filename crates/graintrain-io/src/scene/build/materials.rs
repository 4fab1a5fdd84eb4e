//! The materials of a scene and their pairs.

use crate::scene::Scene;
use crate::scene::error::{SceneError, SceneErrorKind};
use crate::scene::model::MaterialSpec;
use graintrain::error::ModelError;
use graintrain::handle::MaterialId;
use graintrain::material::{Materials, TurningResistance};
use std::collections::HashMap;

/// Materials with the values of this list, and the pairs and rules of the scene.
pub(super) fn materials(
    scene: &Scene,
    list: &[(String, MaterialSpec)],
) -> Result<(Materials, HashMap<String, MaterialId>), SceneError> {
    let unplaced =
        |error: ModelError| SceneError::new(SceneErrorKind::Contradiction(error.to_string()), None);
    let mut materials = Materials::default();
    let mut index = HashMap::new();
    for (name, material) in list {
        index.insert(name.clone(), materials.add(name, material.density).map_err(unplaced)?);
    }
    for (i, (first_name, first)) in list.iter().enumerate() {
        for (j, (second_name, second)) in list.iter().enumerate().skip(i) {
            let pair = scene.pairs.iter().find(|pair| {
                let [a, b] = &pair.materials;
                (a == first_name && b == second_name) || (a == second_name && b == first_name)
            });
            let friction = pair.and_then(|pair| pair.friction).unwrap_or_else(|| {
                if i == j {
                    first.friction
                } else {
                    scene.contact.friction_rule.combine(first.friction, second.friction)
                }
            });
            let restitution = pair.and_then(|pair| pair.restitution).unwrap_or_else(|| {
                if i == j {
                    first.restitution
                } else {
                    scene.contact.restitution_rule.combine(first.restitution, second.restitution)
                }
            });
            let turning = |what: &str, of_pair: Option<TurningResistance>, [a, b]: [TurningResistance; 2]| {
                if let Some(resistance) = of_pair {
                    return Ok(resistance);
                }
                scene.contact.friction_rule.combine_turning(a, b).ok_or_else(|| {
                    let problem = format!(
                        "the {what} friction of material '{first_name}' and that of '{second_name}' are a number and a length: \
                         give that of both in a [[pair]]"
                    );
                    SceneError::new(SceneErrorKind::Contradiction(problem), None)
                })
            };
            let rolling = turning(
                "rolling",
                pair.and_then(|pair| pair.rolling_friction),
                [first.rolling_friction, second.rolling_friction],
            )?;
            let spinning = turning(
                "spinning",
                pair.and_then(|pair| pair.spinning_friction),
                [first.spinning_friction, second.spinning_friction],
            )?;
            materials
                .set_pair_turning(index[first_name], index[second_name], rolling, spinning)
                .map_err(unplaced)?;
            materials
                .set_pair(index[first_name], index[second_name], friction, restitution)
                .map_err(unplaced)?;
        }
    }
    Ok((materials, index))
}
