//! Contacts as words of 64 bits, in which they travel from rank to rank.

use crate::contact::Contact;
use crate::math::Vec3;

/// Words of a contact.
const WORDS: usize = 14;

/// The words of contacts, one contact after the other.
pub(super) fn encoded(contacts: &[Contact]) -> Vec<u64> {
    let mut words = Vec::with_capacity(WORDS * contacts.len());
    for contact in contacts {
        let Contact { body_a, body_b, identity, point, normal, gap, lead, image } = contact;
        let pair = |low: u32, high: u32| u64::from(low) | u64::from(high) << 32;
        let [x, y, z] = image.map(i32::cast_unsigned);
        words.extend([pair(*body_a, *body_b), *identity, pair(x, y), u64::from(z), gap.to_bits()]);
        words.extend([point, normal, lead].into_iter().flat_map(Vec3::to_array).map(f64::to_bits));
    }
    words
}

/// The contacts that these words are of.
pub(super) fn decoded(words: &[u64]) -> Vec<Contact> {
    let contact = |words: &[u64; WORDS]| {
        let halves = |word: u64| [word as u32, (word >> 32) as u32];
        let vector =
            |first: usize| Vec3::from_array(std::array::from_fn(|k| f64::from_bits(words[first + k])));
        let ([body_a, body_b], [x, y], [z, _]) = (halves(words[0]), halves(words[2]), halves(words[3]));
        Contact {
            body_a,
            body_b,
            identity: words[1],
            point: vector(5),
            normal: vector(8),
            gap: f64::from_bits(words[4]),
            lead: vector(11),
            image: [x, y, z].map(u32::cast_signed),
        }
    };
    words.as_chunks::<WORDS>().0.iter().map(contact).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contacts_come_back_as_they_went() {
        let contact = |k: u32| Contact {
            body_a: k,
            body_b: u32::MAX - k,
            identity: u64::MAX / u64::from(k + 1),
            point: Vec3::new(0.1, -0.0, f64::from(k)),
            normal: Vec3::new(1e-300, -1.0, 0.5),
            gap: -1e-3 * f64::from(k),
            lead: Vec3::new(f64::INFINITY, 2.0, 3.0),
            image: [-1, k as i32, i32::MIN],
        };
        let contacts: Vec<Contact> = (0..5).map(contact).collect();
        assert_eq!(decoded(&encoded(&contacts)), contacts);
        assert!(decoded(&[]).is_empty());
    }
}
