//! Sizes of bodies, by which penetrations are measured.

use graintrain::shape::Shape;
use graintrain::world::World;

/// Radius of the largest ball about the shape's origin inside it, m; of a solid mesh half its smallest
/// extent; 0 for surfaces and half-spaces.
pub fn inscribed_radius(shape: &Shape) -> f64 {
    match *shape {
        Shape::Sphere { radius } | Shape::Capsule { radius, .. } => radius,
        Shape::Box { half } => half.min_element(),
        Shape::Cylinder { half_length, radius } => half_length.min(radius),
        Shape::Hull(ref hull) => hull.inscribed_radius(),
        Shape::Mesh { solid: true, .. } => shape.half_thickness(),
        Shape::Plane | Shape::Mesh { solid: false, .. } => 0.0,
    }
}

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
        .map(|part| inscribed_radius(&part.shape))
        .filter(|&radius| radius > 0.0)
        .reduce(f64::min)
}
