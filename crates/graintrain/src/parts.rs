//! Connected parts of the contact graph, each a contact problem of its own.
//!
//! Contacts that share no chain of movable bodies do not know of each other: N is block diagonal over the
//! parts. Solved apart, no part's convergence, scale or rounding reaches another one.

use crate::assemble::{of_each, scale_under};
use graintrain_ccp::{
    BodyInverseMass, Ccp, CoupledBodies, Delassus, FIXED, RigidContact, RigidDelassus, TurningFriction,
    TurningRows,
};
use std::sync::Arc;

/// Contacts and movable bodies that hang together.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Part {
    /// Indices of contacts, ascending.
    pub contacts: Vec<u32>,
    /// Indices of bodies, ascending.
    pub bodies: Vec<u32>,
}

/// Root of a body's tree, halving paths on the way.
fn root(parent: &mut [u32], mut body: u32) -> u32 {
    while parent[body as usize] != body {
        let above = parent[parent[body as usize] as usize];
        parent[body as usize] = above;
        body = above;
    }
    body
}

/// The parts that `chosen` contacts (ascending) make, in the order of their first contacts. Bodies that no
/// impulse can move do not connect, coupled ones do. Cost: nearly linear in bodies and contacts (union by
/// index, path halving).
pub(crate) fn parts(
    rows: &[RigidContact],
    chosen: impl Iterator<Item = u32> + Clone,
    bodies: usize,
    coupled: &[CoupledBodies],
) -> Vec<Part> {
    let mut parent: Vec<u32> = (0..bodies as u32).collect();
    for group in coupled {
        for pair in group.bodies.windows(2) {
            let (a, b) = (root(&mut parent, pair[0]), root(&mut parent, pair[1]));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    for contact in chosen.clone() {
        let RigidContact { body_a, body_b, .. } = rows[contact as usize];
        if body_a != FIXED && body_b != FIXED {
            let (a, b) = (root(&mut parent, body_a), root(&mut parent, body_b));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut number = vec![u32::MAX; bodies];
    let mut parts: Vec<Part> = Vec::new();
    for contact in chosen {
        let RigidContact { body_a, body_b, .. } = rows[contact as usize];
        let body = if body_a == FIXED { body_b } else { body_a };
        if body == FIXED {
            parts.push(Part { contacts: vec![contact], bodies: Vec::new() });
            continue;
        }
        let slot = &mut number[root(&mut parent, body) as usize];
        if *slot == u32::MAX {
            *slot = parts.len() as u32;
            parts.push(Part { contacts: Vec::new(), bodies: Vec::new() });
        }
        parts[*slot as usize].contacts.push(contact);
    }
    for body in 0..bodies as u32 {
        let slot = number[root(&mut parent, body) as usize];
        if slot != u32::MAX {
            parts[slot as usize].bodies.push(body);
        }
    }
    parts
}

impl Part {
    /// One part of all of these.
    pub(crate) fn of_all(parts: Vec<Self>) -> Self {
        let (mut contacts, mut bodies) = (Vec::new(), Vec::new());
        for part in parts {
            contacts.extend(part.contacts);
            bodies.extend(part.bodies);
        }
        contacts.sort_unstable();
        bodies.sort_unstable();
        Self { contacts, bodies }
    }

    /// N of the part alone, its bodies numbered in the order of [`Self::bodies`].
    pub(crate) fn delassus(
        &self,
        rows: &[RigidContact],
        inverse_mass: &[BodyInverseMass],
        coupled: &[CoupledBodies],
    ) -> RigidDelassus {
        // The bodies ascend, so that the search finds them and a part made of everything keeps its numbers. A
        // table of all bodies is for parts that have many of them.
        let mut table = Vec::new();
        if self.bodies.len() >= inverse_mass.len() / 16 {
            table = vec![FIXED; inverse_mass.len()];
            for (index, &body) in (0..).zip(&self.bodies) {
                table[body as usize] = index;
            }
        }
        let local = |body: u32| {
            if !table.is_empty() {
                return table.get(body as usize).copied().unwrap_or(FIXED);
            }
            self.bodies.binary_search(&body).map_or(FIXED, |index| index as u32)
        };
        let contacts = of_each(&self.contacts, |&i| {
            let row = rows[i as usize];
            RigidContact { body_a: local(row.body_a), body_b: local(row.body_b), ..row }
        });
        // A group is in one part as a whole.
        let own = coupled.iter().filter(|group| group.bodies.iter().any(|&body| local(body) != FIXED));
        let own = own.map(|group| CoupledBodies {
            bodies: group.bodies.iter().map(|&body| local(body)).collect(),
            ..group.clone()
        });
        let own = own.collect();
        let inverse_mass = of_each(&self.bodies, |&b| inverse_mass[b as usize]);
        RigidDelassus::new(contacts, inverse_mass).with_coupled(own)
    }

    /// The contacts of the part that resist turning, of those of the whole problem (rows and coefficients,
    /// contact ascending), numbered as in the part; and their places among those of the whole.
    pub(crate) fn turning(
        &self,
        rows: &[TurningRows],
        friction: &[TurningFriction],
    ) -> (Vec<TurningRows>, Vec<TurningFriction>, Vec<usize>) {
        let mut found = (Vec::new(), Vec::new(), Vec::new());
        if rows.is_empty() {
            return found;
        }
        for (contact, i) in (0..).zip(&self.contacts) {
            if let Ok(k) = rows.binary_search_by_key(i, |rows| rows.contact) {
                found.0.push(TurningRows { contact, ..rows[k] });
                found.1.push(TurningFriction { contact, ..friction[k] });
                found.2.push(k);
            }
        }
        found
    }

    /// The contacts of the part, posed as a problem of their own under this gravity (m/s^2) for this step
    /// (s); and the places of those that resist turning among those of the whole.
    pub(crate) fn problem(
        &self,
        whole: &Ccp,
        rigid: &RigidDelassus,
        (gravity, step): (f64, f64),
    ) -> (Ccp, Vec<usize>) {
        let (rows, turning, places) = self.turning(rigid.turning(), &whole.turning);
        let matrix = self.delassus(rigid.contacts(), rigid.inverse_mass(), rigid.coupled());
        let compliance = rigid.compliance();
        let compliance = if compliance.is_empty() { Vec::new() } else { self.gather::<1, f64>(compliance) };
        let mut r = self.gather::<3, f64>(&whole.r);
        let first = 3 * whole.num_contacts();
        r.extend(places.iter().flat_map(|k| whole.r[first + 3 * k..first + 3 * k + 3].iter()));
        let friction = self.gather::<1, f64>(&whole.friction);
        let own = Ccp {
            velocity_scale: scale_under(gravity, step, &r, &friction),
            delassus: Arc::new(Delassus::Rigid(matrix.with_turning(rows).with_compliance(compliance))),
            r,
            friction,
            turning,
            points: self.gather::<1, [f64; 3]>(&whole.points),
            identity: self.gather::<1, u64>(&whole.identity),
        };
        (own, places)
    }

    /// The entries of a list with `N` numbers per contact that belong to the part.
    pub(crate) fn gather<const N: usize, T: Copy + Send + Sync>(&self, all: &[T]) -> Vec<T> {
        let (all, _) = all.as_chunks::<N>();
        of_each(&self.contacts, |&i| all[i as usize]).into_flattened()
    }

    /// Writes three numbers per contact of the part to their places.
    pub(crate) fn scatter(&self, own: &[f64], all: &mut [f64]) {
        for (&i, own) in self.contacts.iter().zip(own.chunks_exact(3)) {
            all[3 * i as usize..3 * (i as usize + 1)].copy_from_slice(own);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn row(body_a: u32, body_b: u32) -> RigidContact {
        let frame = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        RigidContact { body_a, body_b, frame, arm_a: [0.1, 0.2, 0.3], arm_b: [0.0, 0.5, 0.0] }
    }

    #[test]
    fn fixed_bodies_do_not_connect() {
        let rows = [row(0, FIXED), row(4, 1), row(FIXED, 2), row(1, FIXED), row(3, 0)];
        let found = parts(&rows, 0..5, 6, &[]);
        let expected = [(vec![0, 4], vec![0, 3]), (vec![1, 3], vec![1, 4]), (vec![2], vec![2])];
        let expected = expected.map(|(contacts, bodies)| Part { contacts, bodies });
        assert_eq!(found, expected);
        assert_eq!(parts(&rows, [1, 2].into_iter(), 6, &[]).len(), 2);
        let coupled = CoupledBodies { bodies: vec![1, 2], degrees: 0, factor: Vec::new() };
        assert_eq!(parts(&rows, [1, 2].into_iter(), 6, &[coupled]).len(), 1);
    }

    proptest! {
        /// N of the parts is N of the whole, and there is nothing between parts.
        #[test]
        fn parts_make_up_the_whole(pairs in prop::collection::vec((0..12_u32, 0..14_u32), 1..20)) {
            let rows: Vec<RigidContact> = pairs
                .iter()
                .filter(|(a, b)| a != b)
                .map(|&(a, b)| row(a, if b < 12 { b } else { FIXED }))
                .collect();
            let inverse_mass: Vec<BodyInverseMass> = (0..12)
                .map(|b| BodyInverseMass { linear: [1.0 + f64::from(b); 3], angular: [0.5; 9] })
                .collect();
            let whole = RigidDelassus::new(rows.clone(), inverse_mass.clone());
            let g: Vec<f64> = (0..3 * rows.len()).map(|k| (k as f64).sin()).collect();
            let product = |n: &RigidDelassus, g: &[f64]| {
                let (mut force, mut dv, mut u) = (vec![0.0; g.len()], vec![0.0; 6 * n.num_bodies()], vec![0.0; g.len()]);
                n.world_impulse(g, &mut force);
                n.velocity_change(&force, &mut dv);
                n.relative_velocity(&dv, &mut u);
                u
            };
            let mut found = vec![f64::NAN; g.len()];
            for part in parts(&rows, 0..rows.len() as u32, 12, &[]) {
                let own = product(&part.delassus(&rows, &inverse_mass, &[]), &part.gather::<3, f64>(&g));
                part.scatter(&own, &mut found);
            }
            prop_assert_eq!(found, product(&whole, &g));
        }
    }
}
