//! Measurements of a scene with the bodies that they name.

use super::{Builder, Scene, SceneError, SceneErrorKind};
use crate::measure::{Measure, Quantity, ShearBox, Wheel};
use crate::scene::measure::{MeasureSpec, PlaneSpec, ProfileSpec, ShearBoxSpec};
use graintrain::load::Region;
use graintrain::measure::flow::Plane;
use graintrain::measure::profile::{Along, Bins};

impl Builder {
    /// A measurement of the scene, after all bodies are there.
    pub(super) fn measure(
        &self,
        name: &str,
        spec: &MeasureSpec,
        scene: &Scene,
    ) -> Result<Measure, SceneError> {
        let bodies = self.members(&spec.bodies, &spec.packings, &spec.streams);
        let named = |names: &[String]| self.bodies_named(names, &[]).unwrap_or_default();
        let one = |name: &str| named(&[name.to_string()])[0];
        let plane = |plane: &PlaneSpec| {
            Quantity::Plane(Plane { point: plane.point, normal: plane.normal, region: spec.region.clone() })
        };
        let shear_box = |shear: &ShearBoxSpec| {
            Quantity::ShearBox(ShearBox {
                sheared: one(&shear.sheared),
                pressing: one(&shear.pressing),
                direction: shear.direction,
                normal: shear.normal,
                area: shear.area,
                plane: shear.plane,
            })
        };
        let profile = |profile: &ProfileSpec| -> Result<Quantity, SceneError> {
            let along = profile.along.from(profile.centre);
            let sideways = matches!(along, Along::Axis(0 | 1));
            if sideways && matches!(spec.region, Some(Region::Cylinder { .. })) {
                let problem = format!(
                    "bins of `measure.{name}` along x or y in a cylinder have no volume: take a box, or the radius"
                );
                return Err(SceneError::at(SceneErrorKind::Contradiction(problem), &spec.location));
            }
            let (from, to, count) = (profile.from, profile.to, profile.bins as usize);
            Ok(Quantity::Profile(Bins { along, from, to, count }))
        };
        if spec.cell && scene.periodic.is_none() {
            let problem =
                format!("`measure.{name}` asks for the periodic cell, but there is none: add `[periodic]`");
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), &spec.location));
        }
        let flags = [
            (spec.stress, Quantity::Stress),
            (spec.coordination, Quantity::Coordination(spec.rattlers_below as usize)),
            (spec.fabric, Quantity::Fabric),
            (spec.porosity, Quantity::Porosity),
            (spec.forces, Quantity::Forces),
            (spec.cell, Quantity::Cell),
            (spec.energy, Quantity::Energy),
            (spec.motion, Quantity::Motion),
            (spec.exchange, Quantity::Exchange),
        ];
        let mut quantities: Vec<Quantity> =
            flags.into_iter().filter(|(wanted, _)| *wanted).map(|(_, quantity)| quantity).collect();
        let tables = [
            spec.force.as_ref().map(|force| Quantity::ForceOn(named(&force.bodies), force.point)),
            spec.plane.as_ref().map(plane),
            spec.mixing.as_ref().map(|mixing| {
                let first = self.members(&[], &mixing.packings, &mixing.streams).unwrap_or_default();
                Quantity::Mixing(first, mixing.cell)
            }),
            spec.shear_box.as_ref().map(shear_box),
            spec.wheel.as_ref().map(|wheel| {
                Quantity::Wheel(Wheel { body: one(&wheel.body), radius: wheel.radius, axis: wheel.axis })
            }),
            spec.repose
                .as_ref()
                .map(|repose| Quantity::Repose(repose.along.from(repose.centre), repose.width)),
            spec.profile.as_ref().map(profile).transpose()?,
            spec.histogram
                .as_ref()
                .map(|histogram| Quantity::Histogram(histogram.bins as usize, histogram.most)),
        ];
        quantities.extend(tables.into_iter().flatten());
        let whole_steps = |time: f64| (time / scene.time.step).round() as u64;
        let numbered = |name: &String| scene.stages.iter().position(|stage| stage.name == *name);
        Ok(Measure {
            name: name.to_string(),
            bodies,
            region: spec.region.clone(),
            stage: spec.stage.as_ref().and_then(numbered),
            start: whole_steps(spec.start),
            every: whole_steps(spec.every).max(1),
            quantities,
        })
    }
}
