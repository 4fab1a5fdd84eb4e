//! Streams and outlets of a scene.

use super::{Builder, Scene, SceneError, SceneErrorKind, form, half_thickness, model_error};
use crate::body_numbers::Members;
use crate::open_boundaries::OpenBoundaries;
use crate::scene::model::RadiusSpec;
use crate::scene::radius::RadiusDistribution;
use crate::scene::{OutletSpec, StreamSpec};
use crate::stream::{Exit, Grain, Outlet, Rate, Stream};
use graintrain::load::Region;
use graintrain::world::FREE;

impl Builder {
    /// The streams and outlets of the scene.
    pub(super) fn open_boundaries(&mut self, scene: &Scene) -> Result<OpenBoundaries, SceneError> {
        let streams = scene.streams.iter().map(|(name, spec)| self.stream(name, spec, scene));
        let streams = streams.collect::<Result<_, SceneError>>()?;
        self.streams = scene.streams.iter().map(|(name, _)| name.clone()).collect();
        let outlets = scene.outlets.iter().map(|(name, spec)| Outlet {
            name: name.clone(),
            exit: match spec {
                OutletSpec::Behind(plane) => Exit::Behind { point: plane.point, normal: plane.normal },
                OutletSpec::Outside(region) => Exit::Outside(region.clone()),
                OutletSpec::Inside(region) => Exit::Inside(region.clone()),
            },
        });
        Ok(OpenBoundaries { streams, outlets: outlets.collect() })
    }

    fn stream(&mut self, name: &str, spec: &StreamSpec, scene: &Scene) -> Result<Stream, SceneError> {
        let geometry = form(spec.grains.shape.as_ref(), &spec.grains.parts, &spec.location)?;
        let (grain, size, reach) = match (geometry, &spec.grains.radius) {
            (Some(geometry), _) => {
                let (size, reach) = (half_thickness(&geometry), geometry.bounding_radius());
                (Grain::Form(geometry), size, reach)
            }
            (None, Some(RadiusSpec::Single(radius))) => {
                (Grain::Sphere(RadiusDistribution::single(*radius)), *radius, *radius)
            }
            (None, Some(RadiusSpec::Distribution(radii))) => {
                let [small, large] = radii.range();
                (Grain::Sphere(radii.clone()), small, large)
            }
            (None, None) => (Grain::Sphere(RadiusDistribution::single(f64::NAN)), f64::NAN, f64::NAN),
        };
        let room = match spec.region {
            Region::Box { min, max } => 0.5 * (max - min).min_element(),
            Region::Cylinder { radius, height, .. } => radius.min(0.5 * height),
        };
        if reach > room {
            let problem = format!(
                "the region of stream `{name}` has room for bodies of a radius of {room:.3e} m, but they have up to {reach:.3e} m: none \
                 would ever enter"
            );
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), &spec.location));
        }
        let half = self.world.cell().map_or(f64::INFINITY, |cell| 0.5 * cell.smallest_edge());
        if 2.0 * reach >= half {
            let problem = format!(
                "bodies of stream `{name}` fit into balls of up to {:.4} m across, which has to be less than half of the smallest edge of the \
                 periodic cell, {half:.4} m: enlarge the cell, or make them smaller",
                2.0 * reach
            );
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), &spec.location));
        }
        self.smallest_radius = self.smallest_radius.min(size);
        let motion = if spec.grains.lock_rotation {
            self.locked_rotation().map_err(|error| model_error(error, &spec.location))?
        } else {
            FREE
        };
        let rate = match (spec.rate, spec.mass_rate) {
            (Some(rate), _) => Rate::Number(rate),
            (None, Some(rate)) => Rate::Mass(rate),
            (None, None) => Rate::Free,
        };
        Ok(Stream {
            name: name.to_string(),
            region: spec.region.clone(),
            grain,
            random_rotation: spec.grains.random_rotation,
            material: self.material(&spec.grains.material),
            motion,
            velocity: spec.grains.velocity,
            rate,
            start: spec.start,
            end: spec.end,
            count: spec.count,
            mass: spec.mass,
            stage: spec
                .stage
                .as_ref()
                .and_then(|name| scene.stages.iter().position(|stage| stage.name == *name)),
            seed: spec.seed,
        })
    }

    /// The members of these names; `None` where there are no names: all.
    pub(super) fn members(
        &self,
        bodies: &[String],
        packings: &[String],
        streams: &[String],
    ) -> Option<Members> {
        let named = self.bodies_named(bodies, packings);
        if named.is_none() && streams.is_empty() {
            return None;
        }
        let number = |name: &String| self.streams.iter().position(|known| known == name);
        let streams = streams.iter().filter_map(number).map(|number| number as u32).collect();
        Some(Members { bodies: named.unwrap_or_default(), streams })
    }

    /// All bodies of packings and streams, or those of these names.
    pub(super) fn grains(&self, packings: &[String], streams: &[String]) -> Members {
        self.members(&[], packings, streams).unwrap_or_else(|| {
            let all: Vec<String> = self
                .origins
                .iter()
                .filter(|origin| origin.is_packing)
                .map(|origin| origin.label.clone())
                .collect();
            self.members(&[], &all, &self.streams).unwrap_or_default()
        })
    }
}
