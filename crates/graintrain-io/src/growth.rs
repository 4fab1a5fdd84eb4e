//! Bodies that grow until a sample has the porosity that is asked for: without friction it becomes dense,
//! with friction loose.
//!
//! All lengths of the bodies are multiplied by the same factor from step to step; centres and velocities
//! stay. What then overlaps is displaced by the step (gravity is better off meanwhile). A sample that cannot
//! become denser would only overlap more and more: growth waits while a body overlaps another by more than a
//! hundredth of its size, and no step brings more than that.

use crate::body_numbers::{BodyNumbers, Members};
use crate::stream::Amount;
use graintrain::error::ModelError;
use graintrain::handle::GeometryId;
use graintrain::load::Region;
use graintrain::measure::space::porosity;
use graintrain::world::World;
use graintrain_linalg::real;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// Growth waits above this overlap over the size of the smaller body.
const WAITS: f64 = 0.01;

/// Growth of some bodies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Growth {
    /// What grows.
    pub members: Members,
    /// Relative growth of all lengths, 1/s.
    pub rate: f64,
    /// Porosity at which it ends.
    pub porosity: f64,
    /// Where porosity is taken.
    pub region: Region,
}

impl Growth {
    /// Gives the bodies that grow geometries that no other body has.
    ///
    /// # Errors
    /// [`ModelError::Index`] for a body that is none.
    pub fn begin(&self, world: &mut World, numbers: &BodyNumbers) -> Result<(), ModelError> {
        let members: Vec<usize> = numbers.members(&self.members).iter().map(|body| body.index()).collect();
        let len = world.bodies.len();
        if let Some(&index) = members.iter().find(|&&index| index >= len) {
            return Err(ModelError::Index { what: "body", index, len });
        }
        let mut grows = vec![false; len];
        members.iter().for_each(|&index| grows[index] = true);
        let others: HashSet<GeometryId> =
            (0..len).filter(|&body| !grows[body]).map(|body| world.bodies.geometry[body]).collect();
        let mut own: HashMap<GeometryId, GeometryId> = HashMap::new();
        for index in members {
            let former = world.bodies.geometry[index];
            if !others.contains(&former) {
                continue;
            }
            let geometry = match own.get(&former) {
                Some(geometry) => *geometry,
                None => {
                    let copy = Arc::clone(&world.geometries[former.index()]);
                    *own.entry(former).or_insert_with(|| world.add_geometry(copy))
                }
            };
            world.bodies.geometry[index] = geometry;
        }
        Ok(())
    }

    /// Whether the porosity is reached.
    pub fn is_reached(&self, world: &World) -> bool {
        porosity(world, &self.region) <= self.porosity * (1.0 + 1e-9)
    }

    /// Lets bodies grow by what a step of this length (s) brings, unless the last step left a deeper overlap
    /// over size than growth waits for. Returned is the mass and kinetic energy that this adds.
    ///
    /// # Errors
    /// [`ModelError`] where a body becomes larger than numbers are, or half an edge of a periodic cell;
    /// bodies have not grown then.
    pub fn grow(
        &self,
        world: &mut World,
        numbers: &BodyNumbers,
        step: f64,
        overlap: f64,
    ) -> Result<Amount, ModelError> {
        let mut added = Amount::default();
        let solid = 1.0 - porosity(world, &self.region);
        if overlap > WAITS || solid >= 1.0 - self.porosity {
            return Ok(added);
        }
        // Bodies that entered since may share a geometry with those that do not grow.
        self.begin(world, numbers)?;
        let full = 1.0 + (self.rate * step).min(WAITS);
        let needed = real::cbrt((1.0 - self.porosity) / solid);
        let factor = if needed.is_finite() { full.min(needed) } else { full };
        let members = numbers.members(&self.members);
        let geometries: std::collections::BTreeSet<usize> =
            members.iter().map(|body| world.bodies.geometry[body.index()].index()).collect();
        let mut former = Vec::new();
        for geometry in geometries {
            let larger = Arc::new(world.geometries[geometry].scaled(factor)?);
            former.push((geometry, std::mem::replace(&mut world.geometries[geometry], larger)));
        }
        if let Err(error) = world.fits_cell() {
            former.into_iter().for_each(|(place, geometry)| world.geometries[place] = geometry);
            return Err(error);
        }
        let before = world.kinetic_energy();
        for body in members.iter().map(|body| body.index()) {
            let more = (factor.powi(3) - 1.0) * world.bodies.mass[body];
            added.mass += more;
            world.bodies.mass[body] += more;
            world.bodies.inertia[body] *= factor.powi(5);
        }
        added.kinetic = world.kinetic_energy() - before;
        Ok(added)
    }

    /// Whether it is one of a world with so many numbers given.
    pub(crate) fn fits(&self, given: u64) -> bool {
        self.members.bodies.iter().all(|body| (body.index() as u64) < given)
            && self.rate.is_finite()
            && self.rate > 0.0
            && self.porosity > 0.0
            && self.porosity < 1.0
    }
}
