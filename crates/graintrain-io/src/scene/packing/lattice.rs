//! Perturbed cubic lattice.

use crate::random::Random;
use crate::scene::model::LatticeSpec;
use graintrain::math::Vec3;

/// Centres origin + (i + 1/2) pitch + jitter, z fastest; each coordinate's jitter is uniform in
/// [-jitter, jitter].
pub(crate) fn positions(lattice: &LatticeSpec, random: &mut Random) -> Vec<Vec3> {
    let [nx, ny, nz] = lattice.counts;
    let mut positions = Vec::with_capacity((nx * ny * nz) as usize);
    for x in 0..nx {
        for y in 0..ny {
            for z in 0..nz {
                let cell = Vec3::new(x as f64, y as f64, z as f64) + 0.5;
                let mut position = lattice.origin + cell * lattice.pitch;
                if lattice.jitter > 0.0 {
                    let [dx, dy, dz] = [(); 3].map(|()| random.between(-lattice.jitter, lattice.jitter));
                    position += Vec3::new(dx, dy, dz);
                }
                positions.push(position);
            }
        }
    }
    positions
}
