//! Numbers that tell one state from another.

use super::World;
use crate::math::Vec3;
use graintrain_linalg::parallel::fold_chunks;

impl World {
    /// A number made of everything that the contacts of a step depend on: whoever changes a body between two
    /// steps changes it.
    pub(crate) fn fingerprint(&self) -> u64 {
        let start = 0xcbf2_9ce4_8422_2325_u64;
        let with = |hash: u64, word: u64| (hash ^ word).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23);
        let bodies = &self.bodies;
        // Of torques contacts do not depend.
        let of_bodies = |range: std::ops::Range<usize>| {
            let mut hash = start;
            let mut add = |word: u64| hash = with(hash, word);
            for body in range {
                let vectors = [&bodies.position, &bodies.velocity, &bodies.angular_velocity, &bodies.force];
                vectors.iter().flat_map(|list| list[body].to_array()).for_each(|x| add(x.to_bits()));
                bodies.orientation[body].to_array().iter().for_each(|x| add(x.to_bits()));
                add(bodies.mass[body].to_bits());
                add(bodies.geometry[body].index() as u64);
                add(bodies.motion[body].index() as u64);
            }
            hash
        };
        let mut hash = fold_chunks(bodies.len(), start, of_bodies, with);
        let mut add = |word: u64| hash = with(hash, word);
        add(bodies.len() as u64);
        add(self.geometries.len() as u64);
        for drag in &self.drag {
            [drag.pull.x, drag.pull.y, drag.pull.z, drag.linear].iter().for_each(|x| add(x.to_bits()));
        }
        for motion in &self.motions {
            motion.free.iter().for_each(|&free| add(u64::from(free)));
        }
        self.ignored_pairs().into_iter().flatten().for_each(|body| add(u64::from(body)));
        self.gravity.to_array().iter().for_each(|x| add(x.to_bits()));
        self.cell_words().for_each(&mut add);
        crate::math::mix(hash)
    }

    /// Place, form and rate of the cell.
    fn cell_words(&self) -> impl Iterator<Item = u64> {
        let cell = self.cell.as_ref();
        cell.into_iter().flat_map(|cell| {
            let vectors = cell.lower.to_array().into_iter().chain(cell.size.to_array());
            vectors.chain(cell.tilt).chain(cell.rate).map(f64::to_bits)
        })
    }

    /// A number made of every bit of the state that later steps depend on: time, step, bodies, and the
    /// impulses that warm-start the next solve. Two runs agree bit for bit exactly if (up to a chance of
    /// 2^-64) their hashes agree. The definition is fixed: FNV-1a over 64-bit words with a final mix.
    pub fn state_hash(&self) -> u64 {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut add = |word: u64| hash = (hash ^ word).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23);
        add(self.time.to_bits());
        add(self.step);
        let bodies = &self.bodies;
        for list in [&bodies.position, &bodies.velocity, &bodies.angular_velocity] {
            list.iter().flat_map(|v| v.to_array()).for_each(|x| add(x.to_bits()));
        }
        bodies.orientation.iter().flat_map(|q| q.to_array()).for_each(|x| add(x.to_bits()));
        for (b, (force, torque)) in bodies.force.iter().zip(&bodies.torque).enumerate() {
            if *force != Vec3::ZERO || *torque != Vec3::ZERO {
                add(b as u64);
                force.to_array().into_iter().chain(torque.to_array()).for_each(|x| add(x.to_bits()));
            }
        }
        for (contact, impulse) in self.contacts.contacts.iter().zip(&self.contacts.impulse) {
            add(contact.identity);
            impulse.to_array().iter().for_each(|x| add(x.to_bits()));
        }
        // None where nothing resists turning.
        self.contacts.moment.iter().flat_map(|m| m.to_array()).for_each(|x| add(x.to_bits()));
        // Nor bounces where nothing springs back.
        let bounced =
            self.contacts.contacts.iter().zip(&self.contacts.bounced).filter(|(_, bounced)| **bounced);
        bounced.for_each(|(contact, _)| add(!contact.identity));
        // Nor joints in most worlds.
        for placed in &self.joints {
            add(placed.state.coordinate.to_bits());
            add(placed.state.switches());
        }
        self.cell_words().for_each(&mut add);
        crate::math::mix(hash)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handle::MaterialId;
    use crate::material::Materials;
    use crate::shape::Geometry;
    use crate::world::Body;

    #[test]
    fn the_hash_sees_one_bit() {
        let materials = Materials::single("stuff", 1000.0, 0.3, 0.0).unwrap();
        let mut world = World::new(Vec3::ZERO, materials).unwrap();
        let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
        world.add_body(Body::new(ball, MaterialId::default(), Vec3::ONE)).unwrap();
        let before = world.state_hash();
        world.bodies.velocity[0].y = -0.0;
        assert_ne!(before, world.state_hash());
        world.bodies.velocity[0].y = 0.0;
        assert_eq!(before, world.state_hash());
    }
}
