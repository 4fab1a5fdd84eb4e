//! Contact identity: the same number for the same contact from step to step, and warm starts through it.

use crate::contact::{Contact, ContactSet};
use crate::math::{Vec3, mix, unmix};
use rayon::prelude::*;

/// Identity of the contact between two bodies at a feature of the pair: a scrambled 64-bit number, the same
/// whichever body is called A. Two of n contacts clash with probability about n^2 / 2^65 (3e-8 for a million
/// contacts).
#[inline]
pub(crate) fn identity(body_a: u32, body_b: u32, feature: u64) -> u64 {
    let (low, high) = (body_a.min(body_b), body_a.max(body_b));
    let pair = u64::from(low) << 32 | u64::from(high);
    mix(mix(pair).wrapping_add(feature))
}

/// The identity that a contact gets when its bodies get other indices: the feature is what the identity holds
/// besides the pair.
pub(crate) fn renamed(identity: u64, before: [u32; 2], after: [u32; 2]) -> u64 {
    let pair = |[a, b]: [u32; 2]| mix(u64::from(a.min(b)) << 32 | u64::from(a.max(b)));
    mix(pair(after).wrapping_add(unmix(identity).wrapping_sub(pair(before))))
}

/// Last step's contacts, arranged by their body A.
pub(crate) struct PreviousContacts<'a> {
    set: &'a ContactSet,
    /// Contacts whose body A is b are `order[start[b]..start[b + 1]]`.
    start: Vec<u32>,
    order: Vec<u32>,
}

impl<'a> PreviousContacts<'a> {
    /// Arranges the contacts of a set over `bodies` bodies. Cost: linear.
    pub(crate) fn new(set: &'a ContactSet, bodies: usize) -> Self {
        let usable = set.impulse.len() == set.contacts.len()
            && set.contacts.par_iter().all(|c| (c.body_a as usize) < bodies && (c.body_b as usize) < bodies);
        let contacts: &[Contact] = if usable { &set.contacts } else { &[] };
        let mut start = vec![0_u32; bodies + 1];
        for contact in contacts {
            start[contact.body_a as usize + 1] += 1;
        }
        for b in 0..bodies {
            start[b + 1] += start[b];
        }
        let mut next = start.clone();
        let mut order = vec![0_u32; contacts.len()];
        for (i, contact) in contacts.iter().enumerate() {
            let slot = &mut next[contact.body_a as usize];
            order[*slot as usize] = i as u32;
            *slot += 1;
        }
        Self { set, start, order }
    }

    /// The impulse that the contact had on its body A, N s, world axes; zero for a new contact.
    pub(crate) fn impulse(&self, contact: &Contact) -> Vec3 {
        self.find(contact).map_or(Vec3::ZERO, |(i, sign)| sign * self.set.impulse[i])
    }

    /// The moment impulse of rolling and spinning friction that the contact had on its body A, N m s, world
    /// axes.
    pub(crate) fn moment(&self, contact: &Contact) -> Vec3 {
        let found = self.find(contact).and_then(|(i, sign)| Some(sign * *self.set.moment.get(i)?));
        found.unwrap_or(Vec3::ZERO)
    }

    /// Where the contact stands in the set, and -1 if its bodies A and B have changed names.
    fn find(&self, contact: &Contact) -> Option<(usize, f64)> {
        // The collision phase may have called the bodies A and B the other way round.
        for (body, sign) in [(contact.body_a, 1.0), (contact.body_b, -1.0)] {
            let range = self.start[body as usize] as usize..self.start[body as usize + 1] as usize;
            for &i in &self.order[range] {
                if self.set.contacts[i as usize].identity == contact.identity {
                    return Some((i as usize, sign));
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn renamed_bodies_keep_their_feature() {
        for feature in [0, 5, u64::MAX, mix(9)] {
            assert_eq!(renamed(identity(7, 3, feature), [3, 7], [2, 6]), identity(6, 2, feature));
        }
    }

    #[test]
    fn impulses_are_found_from_either_side() {
        let contact = |body_a, body_b, feature| Contact {
            body_a,
            body_b,
            identity: identity(body_a, body_b, feature),
            point: Vec3::ZERO,
            normal: Vec3::Z,
            gap: 0.0,
            lead: Vec3::ZERO,
            image: [0; 3],
        };
        let set = ContactSet {
            contacts: vec![contact(2, 1, 0), contact(0, 1, 5), contact(0, 1, 6)],
            impulse: vec![Vec3::X, Vec3::Y, Vec3::Z],
            friction: vec![0.0; 3],
            moment: vec![Vec3::X, Vec3::Y, Vec3::Z],
            bounced: Vec::new(),
            curvature: None,
        };
        let previous = PreviousContacts::new(&set, 3);
        assert_eq!(previous.impulse(&contact(2, 1, 0)), Vec3::X);
        assert_eq!(previous.impulse(&contact(1, 2, 0)), -Vec3::X);
        assert_eq!(previous.impulse(&contact(0, 1, 6)), Vec3::Z);
        assert_eq!(previous.impulse(&contact(0, 1, 7)), Vec3::ZERO);
        assert_eq!(previous.impulse(&contact(0, 2, 0)), Vec3::ZERO);
        assert_eq!(previous.moment(&contact(1, 0, 5)), -Vec3::Y);
        assert_eq!(previous.moment(&contact(0, 1, 7)), Vec3::ZERO);
    }
}
