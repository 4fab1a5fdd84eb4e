//! The materials of a scene and their pairs.

use crate::scene::Scene;
use crate::scene::error::{Location, SceneError, SceneErrorKind};
use crate::scene::model::{MaterialSpec, PairSpec};
use graintrain::error::ModelError;
use graintrain::handle::MaterialId;
use graintrain::material::{Elasticity, Materials, TurningResistance};
use std::collections::HashMap;

/// Materials with the values of this list, and the pairs and rules of the scene. Errors are placed at the
/// location (of the stage whose values they are), otherwise at the pair that they concern.
pub(super) fn materials(
    scene: &Scene,
    list: &[(String, MaterialSpec)],
    location: Option<&Location>,
) -> Result<(Materials, HashMap<String, MaterialId>), SceneError> {
    let place = |problem: String, pair: Option<&PairSpec>| {
        let location = location.or(pair.map(|pair| &pair.location));
        SceneError::new(SceneErrorKind::Contradiction(problem), location.cloned())
    };
    let unpaired = |error: ModelError| place(error.to_string(), None);
    let mut materials = Materials::default();
    let mut index = HashMap::new();
    for (name, material) in list {
        index.insert(name.clone(), materials.add(name, material.density).map_err(unpaired)?);
    }
    for (i, (first_name, first)) in list.iter().enumerate() {
        for (j, (second_name, second)) in list.iter().enumerate().skip(i) {
            let pair = scene.pairs.iter().find(|pair| {
                let [a, b] = &pair.materials;
                (a == first_name && b == second_name) || (a == second_name && b == first_name)
            });
            let fail = |error: ModelError| place(error.to_string(), pair);
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
                    place(problem, pair)
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
            let own = [first, second].map(|m| Elasticity { stiffness: m.stiffness, damping: m.damping });
            let elasticity = elasticity_of(own, i == j, pair);
            let cohesion = pair.and_then(|pair| pair.cohesion).unwrap_or(first.cohesion.min(second.cohesion));
            materials
                .set_pair_turning(index[first_name], index[second_name], rolling, spinning)
                .map_err(fail)?;
            materials.set_pair(index[first_name], index[second_name], friction, restitution).map_err(fail)?;
            materials.set_pair_elasticity(index[first_name], index[second_name], elasticity).map_err(fail)?;
            materials.set_pair_cohesion(index[first_name], index[second_name], cohesion).map_err(fail)?;
        }
    }
    Ok((materials, index))
}

/// Stiffness and damping of a pair: those that it gives itself, otherwise both materials in series. A contact
/// of a material with itself (k, d) is two halves of (2k, 2d) each, and a rigid material has no part in it;
/// halves (K_1, D_1) and (K_2, D_2) in series are `1/K = 1/K_1 + 1/K_2` and, for oscillations slower than
/// K/D, `D/K^2 = D_1/K_1^2 + D_2/K_2^2`.
fn elasticity_of(own: [Elasticity; 2], is_same: bool, pair: Option<&PairSpec>) -> Elasticity {
    let series = if is_same { own[0] } else { in_series(own) };
    let Some(pair) = pair else { return series };
    let stiffness = pair.stiffness.unwrap_or(series.stiffness);
    let damping = pair.damping.unwrap_or(if stiffness > 0.0 { series.damping } else { 0.0 });
    Elasticity { stiffness, damping }
}

/// Two materials in series. Ratios are formed first: squares and inverses of the largest and smallest numbers
/// are none.
fn in_series(own: [Elasticity; 2]) -> Elasticity {
    let halves = || own.iter().filter(|half| half.stiffness > 0.0);
    let softest = halves().map(|half| half.stiffness).fold(f64::INFINITY, f64::min);
    if softest == f64::INFINITY {
        return Elasticity::RIGID;
    }
    let softness: f64 = halves().map(|half| softest / half.stiffness).sum();
    let share =
        |half: &Elasticity| 0.5 * half.damping * (2.0 * (softest / half.stiffness) / softness).powi(2);
    Elasticity {
        stiffness: (2.0 * (softest / softness)).min(f64::MAX),
        damping: halves().map(share).sum::<f64>().min(f64::MAX),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stiffnesses_in_series() {
        let of = |stiffness, damping| Elasticity { stiffness, damping };
        let pair = |a, b| elasticity_of([a, b], false, None);
        assert_eq!(pair(of(3.0, 1.0), Elasticity::RIGID), of(6.0, 2.0));
        let alike = pair(of(3.0, 1.0), of(3.0, 1.0));
        assert!((alike.stiffness - 3.0).abs() < 1e-15 && (alike.damping - 1.0).abs() < 1e-15);
        assert_eq!(pair(Elasticity::RIGID, Elasticity::RIGID), Elasticity::RIGID);
        // Halves of 4 and 12 N/m: 3 N/m; the dashpot on the softer one moves by 3/4 of the way.
        let mixed = pair(of(2.0, 0.5), of(6.0, 0.0));
        assert!((mixed.stiffness - 3.0).abs() < 1e-15 && (mixed.damping - 9.0 / 16.0).abs() < 1e-15);
        // The same at the ends of the numbers.
        for scale in [1e-300, 1e-200, 1e150, 1e300, 1e307] {
            let scaled = pair(of(2.0 * scale, 0.5), of(6.0 * scale, 0.0));
            assert!((scaled.stiffness / scale - 3.0).abs() < 1e-14, "{scaled:?}");
            assert!((scaled.damping - 9.0 / 16.0).abs() < 1e-15, "{scaled:?}");
        }
        assert_eq!(pair(of(f64::MAX, f64::MAX), Elasticity::RIGID), of(f64::MAX, f64::MAX));
        let apart = pair(of(1e-300, 1.0), of(1e300, 1.0));
        assert!((apart.stiffness / 2e-300 - 1.0).abs() < 1e-14 && (apart.damping - 2.0).abs() < 1e-14);
    }
}
