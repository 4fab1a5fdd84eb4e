//! What eight contacts do to velocities and with impulses, in single precision.

use super::super::lanes::{Batch, add, cross, dot, scale, sub};
use super::super::mechanisms::PackedMechanisms;
use super::super::octet::{EIGHT, Octet, SingleVector};
use super::operator::Masses;
use std::ops::Range;

/// Places of bodies A and B of eight contacts in an image.
pub(super) type Places = [[u32; EIGHT]; 2];

/// Bodies A and B of eight contacts: places in an image and in the slots of the chunk.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bodies {
    pub(super) place: Places,
    pub(super) slot: [[u16; EIGHT]; 2],
}

/// The same bodies as places in a range of those of all; what is fixed comes after them.
pub(super) fn within(places: &Places, range: &Range<usize>) -> Places {
    let (first, len) = (range.start as u32, range.len() as u32);
    places.map(|side| side.map(|place| place.wrapping_sub(first).min(len)))
}

/// Velocities and spins of the bodies on one side.
#[inline(always)]
pub(super) fn velocities<V: SingleVector>(side: &[u32; EIGHT], image: &[Octet]) -> [Batch<V>; 2] {
    let mut records = [V::default(); EIGHT];
    for (record, &place) in records.iter_mut().zip(side) {
        *record = V::of(image[place as usize]);
    }
    V::components(records)
}

/// Adds M^-1 of impulses with their moments to the velocities of bodies A, and takes it from those of B.
#[inline(always)]
pub(super) fn push<V: SingleVector>(
    places: &Places,
    p: &Batch<V>,
    moments: [&Batch<V>; 2],
    masses: Masses<'_>,
    image: &mut [Octet],
) {
    let (on_a, on_b) = (V::records([p, moments[0]]), V::records([p, moments[1]]));
    for lane in 0..EIGHT {
        let (a, b) = (places[0][lane] as usize, places[1][lane] as usize);
        let change = masses.times(a, on_a[lane]);
        image[a] = (V::of(image[a]) + change).octet();
        let change = masses.times(b, on_b[lane]);
        image[b] = (V::of(image[b]) - change).octet();
    }
}

/// Makes the velocities of coupled bodies what those of their mechanisms are, at contacts that move.
#[inline(always)]
pub(super) fn bring<V: SingleVector>(
    places: &Places,
    moves: &Octet,
    mechanisms: &PackedMechanisms<Octet>,
    image: &mut [Octet],
) {
    for lane in (0..EIGHT).filter(|&lane| moves.0[lane] != 0.0) {
        mechanisms.bring::<V>(&[places[0][lane], places[1][lane]], image);
    }
}

/// As [`push`], for coupled bodies at contacts that move.
#[inline(always)]
pub(super) fn push_coupled<V: SingleVector>(
    (places, moves): (&Places, &Octet),
    p: &Batch<V>,
    moments: [&Batch<V>; 2],
    mechanisms: &PackedMechanisms<Octet>,
    image: &mut [Octet],
) {
    let (on_a, on_b) = (V::records([p, moments[0]]), V::records([p, moments[1]]));
    for lane in (0..EIGHT).filter(|&lane| moves.0[lane] != 0.0) {
        mechanisms.push::<V>(places[0][lane], on_a[lane].octet(), image);
        mechanisms.push::<V>(places[1][lane], (-on_b[lane]).octet(), image);
    }
}

impl Bodies {
    /// Adds impulses with their moments about A to the slots of bodies A, and takes them with their moments
    /// about B from those of B.
    #[inline(always)]
    fn add_to_slots<V: SingleVector>(&self, p: &Batch<V>, moments: [&Batch<V>; 2], slots: &mut [Octet]) {
        let (on_a, on_b) = (V::records([p, moments[0]]), V::records([p, moments[1]]));
        for lane in 0..EIGHT {
            let slot = &mut slots[self.slot[0][lane] as usize];
            *slot = (V::of(*slot) + on_a[lane]).octet();
            let slot = &mut slots[self.slot[1][lane] as usize];
            *slot = (V::of(*slot) - on_b[lane]).octet();
        }
    }
}

/// The geometry of eight contacts.
pub(super) trait Geometry: Send + Sync {
    fn bodies(&self) -> &Bodies;

    /// D^T v of the velocities and spins of bodies A and B.
    fn relative<V: SingleVector>(&self, of: [[Batch<V>; 2]; 2]) -> Batch<V>;

    /// D^T v.
    #[inline(always)]
    fn relative_velocity<V: SingleVector>(&self, image: &[Octet]) -> Batch<V> {
        let [a, b] = &self.bodies().place;
        self.relative([velocities(a, image), velocities(b, image)])
    }

    /// The impulses D x and their moments about bodies A and B.
    fn impulses<V: SingleVector>(&self, x: &Batch<V>) -> [Batch<V>; 3];

    /// Adds the impulses D x to the slots.
    #[inline(always)]
    fn scatter<V: SingleVector>(&self, x: &Batch<V>, slots: &mut [Octet]) {
        let [p, on_a, on_b] = self.impulses(x);
        self.bodies().add_to_slots(&p, [&on_a, &on_b], slots);
    }
}

/// Reads a batch.
#[inline(always)]
pub(super) fn load<V: SingleVector>(a: &Batch<Octet>) -> Batch<V> {
    [V::of(a[0]), V::of(a[1]), V::of(a[2])]
}

/// Contacts whose arms are multiples of their normals, as those of spheres are: r_A = a n, r_B = b n with t2
/// = n x t1. With W = a w_A - b w_B
///
/// ```text
/// D^T v = (n . v, t1 . v + t2 . W, t2 . v - t1 . W),   v = u_A - u_B;     n x p = x_1 t2 - x_2 t1
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Radial {
    /// Scaled rows n, t1, t2.
    pub(super) rows: [Batch<Octet>; 3],
    /// a and b.
    pub(super) arms: [Octet; 2],
    pub(super) bodies: Bodies,
}

impl Geometry for Radial {
    #[inline(always)]
    fn relative<V: SingleVector>(&self, [[u_a, w_a], [u_b, w_b]]: [[Batch<V>; 2]; 2]) -> Batch<V> {
        let v = sub(&u_a, &u_b);
        let spin = sub(&scale(V::of(self.arms[0]), &w_a), &scale(V::of(self.arms[1]), &w_b));
        let (n, t1, t2) = (load(&self.rows[0]), load(&self.rows[1]), load(&self.rows[2]));
        [dot(&n, &v), dot(&t1, &v) + dot(&t2, &spin), dot(&t2, &v) - dot(&t1, &spin)]
    }

    #[inline(always)]
    fn bodies(&self) -> &Bodies {
        &self.bodies
    }

    #[inline(always)]
    fn impulses<V: SingleVector>(&self, x: &Batch<V>) -> [Batch<V>; 3] {
        let (n, t1, t2) = (load(&self.rows[0]), load(&self.rows[1]), load(&self.rows[2]));
        let p = add(&add(&scale(x[0], &n), &scale(x[1], &t1)), &scale(x[2], &t2));
        let across = sub(&scale(x[1], &t2), &scale(x[2], &t1));
        [p, scale(V::of(self.arms[0]), &across), scale(V::of(self.arms[1]), &across)]
    }
}

/// Contacts with any arms.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct General {
    /// Scaled rows n, t1, t2.
    pub(super) rows: [Batch<Octet>; 3],
    /// r_A and r_B.
    pub(super) arms: [Batch<Octet>; 2],
    pub(super) bodies: Bodies,
}

impl Geometry for General {
    #[inline(always)]
    fn relative<V: SingleVector>(&self, [[u_a, w_a], [u_b, w_b]]: [[Batch<V>; 2]; 2]) -> Batch<V> {
        let of_a = add(&u_a, &cross(&w_a, &load(&self.arms[0])));
        let v = sub(&of_a, &add(&u_b, &cross(&w_b, &load(&self.arms[1]))));
        [dot(&load(&self.rows[0]), &v), dot(&load(&self.rows[1]), &v), dot(&load(&self.rows[2]), &v)]
    }

    #[inline(always)]
    fn bodies(&self) -> &Bodies {
        &self.bodies
    }

    #[inline(always)]
    fn impulses<V: SingleVector>(&self, x: &Batch<V>) -> [Batch<V>; 3] {
        let (n, t1, t2) = (load(&self.rows[0]), load(&self.rows[1]), load(&self.rows[2]));
        let p = add(&add(&scale(x[0], &n), &scale(x[1], &t1)), &scale(x[2], &t2));
        [p, cross(&load(&self.arms[0]), &p), cross(&load(&self.arms[1]), &p)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On contacts whose arms are along their normals both geometries do the same.
    #[test]
    fn radial_contacts_are_general_ones() {
        let mut count = 0.0_f32;
        let mut number = || {
            count += 1.0;
            (7.3 * count).sin()
        };
        let axes = [[0.6_f32, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]];
        for turn in 0..3 {
            let rows = std::array::from_fn(|row| {
                std::array::from_fn(|axis| Octet::splat(axes[(row + turn) % 3][axis]))
            });
            let lengths: [Octet; 2] = std::array::from_fn(|_| Octet(std::array::from_fn(|_| number())));
            let along = |length: Octet| std::array::from_fn(|axis| length * rows[0][axis]);
            let bodies = Bodies {
                place: [std::array::from_fn(|l| l as u32), std::array::from_fn(|l| 8 + l as u32)],
                slot: [std::array::from_fn(|l| l as u16), std::array::from_fn(|l| 8 + l as u16)],
            };
            let radial = Radial { rows, arms: lengths, bodies };
            let general = General { rows, arms: lengths.map(along), bodies };
            let record = |number: &mut dyn FnMut() -> f32| {
                Octet(std::array::from_fn(|k| if k % 4 == 3 { 0.0 } else { number() }))
            };
            let image: Vec<Octet> = (0..16).map(|_| record(&mut number)).collect();
            let x = std::array::from_fn(|_| Octet(std::array::from_fn(|_| number())));
            let near = |a: &[Octet], b: &[Octet]| {
                let pairs = a.iter().flat_map(|a| a.0).zip(b.iter().flat_map(|b| b.0));
                pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-6)
            };
            assert!(near(&radial.relative_velocity(&image), &general.relative_velocity(&image)));
            let (mut ours, mut theirs) = (vec![Octet::default(); 16], vec![Octet::default(); 16]);
            radial.scatter(&x, &mut ours);
            general.scatter(&x, &mut theirs);
            assert!(near(&ours, &theirs));
        }
    }
}
