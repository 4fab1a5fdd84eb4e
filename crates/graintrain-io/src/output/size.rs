//! Sizes of bodies, by which penetrations are measured.

use graintrain::world::World;

/// Smallest inscribed radius of the parts of all bodies that forces can move, m: the R by which penetrations
/// are measured. `None` where no body can move.
pub fn smallest_radius(world: &World) -> Option<f64> {
    let mut used = vec![false; world.geometries.len()];
    for body in (0..world.bodies.len()).filter(|&body| !world.is_prescribed(body)) {
        used[world.bodies.geometry[body].index()] = true;
    }
    world
        .geometries
        .iter()
        .zip(used)
        .filter(|(_, used)| *used)
        .flat_map(|(geometry, _)| &geometry.parts)
        .map(|part| part.shape.inscribed_radius())
        .filter(|&radius| radius > 0.0)
        .reduce(f64::min)
}
