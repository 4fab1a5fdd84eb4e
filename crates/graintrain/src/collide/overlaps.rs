//! What an initial state should be checked for: bodies that overlap, meshes that meet.

use super::Collider;
use crate::contact::Contact;
use crate::math::Vec3;
use crate::shape::{Geometry, Shape};
use crate::world::World;
use std::sync::Arc;

/// Two bodies that overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Index of one body.
    pub body_a: u32,
    /// Index of the other body.
    pub body_b: u32,
    /// Depth, m, positive.
    pub depth: f64,
    /// Where, m.
    pub point: Vec3,
}

/// The deepest overlap of a world, if any two bodies overlap: what an initial state should be checked for.
/// Pairs of bodies that are both fully prescribed are not looked at, nor those whose contacts are elastic:
/// they overlap at rest.
pub fn deepest_overlap(world: &World) -> Option<Overlap> {
    let is_rigid = |contact: &Contact| {
        let [a, b] = world.materials_of(contact);
        world.materials.pair_elasticity(a, b).is_rigid()
    };
    let deepest = Collider::default().deepest(world, is_rigid)?;
    (deepest.gap < 0.0).then_some(Overlap {
        body_a: deepest.body_a,
        body_b: deepest.body_b,
        depth: -deepest.gap,
        point: deepest.point,
    })
}

/// Two bodies with meshes, one of which can move, whose bounding balls overlap: contacts between two meshes
/// are not computed.
pub fn meshes_that_meet(world: &World) -> Option<[usize; 2]> {
    let is_mesh =
        |geometry: &Arc<Geometry>| geometry.parts.iter().any(|part| matches!(part.shape, Shape::Mesh(_)));
    let meshes: Vec<bool> = world.geometries.iter().map(is_mesh).collect();
    let with_mesh = (0..world.bodies.len()).filter(|&body| meshes[world.bodies.geometry[body].index()]);
    let with_mesh: Vec<usize> = with_mesh.collect();
    let ignored = world.ignored_pairs();
    if with_mesh.len() < 2 || with_mesh.iter().all(|&body| world.is_prescribed(body)) {
        return None;
    }
    let radius = |body: usize| world.geometries[world.bodies.geometry[body].index()].bounding_radius();
    let balls: Vec<(usize, Vec3, f64)> =
        with_mesh.iter().map(|&body| (body, world.bodies.position[body], radius(body))).collect();
    for (k, &(a, place_a, radius_a)) in balls.iter().enumerate() {
        for &(b, place_b, radius_b) in &balls[k + 1..] {
            let both_driven = world.is_prescribed(a) && world.is_prescribed(b);
            let apart = ignored.binary_search(&[a.min(b) as u32, a.max(b) as u32]).is_ok();
            let way = world.cell().map_or(place_a - place_b, |cell| cell.nearest(place_a - place_b).1);
            if !both_driven && !apart && way.length() < radius_a + radius_b {
                return Some([a, b]);
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handle::MaterialId;
    use crate::material::Materials;
    use crate::world::Body;

    #[test]
    fn the_deepest_overlap_is_named() {
        let materials = Materials::single("stuff", 1.0, 0.0, 0.0).unwrap();
        let mut world = World::new(Vec3::ZERO, materials).unwrap();
        let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
        for x in [0.0, 0.3, 0.45, 0.64] {
            world.add_body(Body::new(ball, MaterialId::default(), Vec3::new(x, 0.0, 0.0))).unwrap();
        }
        let overlap = deepest_overlap(&world).unwrap();
        assert_eq!((overlap.body_a, overlap.body_b), (1, 2));
        assert!((overlap.depth - 0.05).abs() < 1e-15 && (overlap.point.x - 0.375).abs() < 1e-15);
        world.bodies.position[2].x = 0.52;
        world.bodies.position[3].x = 0.73;
        assert_eq!(deepest_overlap(&world), None);
    }
}
