//! Where a pass over the contacts leaves the forces on bodies.

use super::packing::{EMPTY, Packing};
use super::ranks::Ranks;
use super::share::Share;
use crate::delassus::RigidDelassus;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Slots: a chunk of contacts sums the forces on its bodies in slots of its own, then every body adds its
/// slots in a fixed order. No two threads write to one place, and the bits do not depend on their number.
/// Slot 0 of a chunk takes what acts on fixed bodies. Images of bodies ([`super::cell_images`]) have slots
/// like bodies, which their bodies add, too.
#[derive(Clone, Debug)]
pub(super) struct SlotTable {
    /// Slots of bodies A and B at every place, counted from the first slot of the chunk.
    places: Vec<[u32; 2]>,
    /// Slots of chunk c are `chunk_start[c]..chunk_start[c + 1]`.
    chunk_start: Vec<usize>,
    /// Slots at the end of each chunk that are nobody's.
    behind: usize,
    /// Slots of the body at place b are `slots[slot_start[b]..slot_start[b + 1]]`, chunk ascending.
    slot_start: Vec<u32>,
    slots: Vec<u32>,
}

impl SlotTable {
    /// For chunks of so many places, with so much room behind the slots of each.
    pub(super) fn new(rigid: &RigidDelassus, packing: &Packing, chunk_len: usize, behind: usize) -> Self {
        let bodies = packing.num_places();
        let fixed = bodies as u32;
        let mut places = vec![[0; 2]; packing.contacts.len()];
        let chunks = packing.contacts.par_chunks(chunk_len).zip(places.par_chunks_mut(chunk_len));
        // The last chunk that each body was met in, and its slot there.
        let none_met = || vec![(usize::MAX, 0_u32); bodies];
        let owners_of =
            |met: &mut Vec<(usize, u32)>, (chunk, (contacts, places)): (usize, (&[u32], &mut [[u32; 2]]))| {
                let mut owners = vec![fixed];
                for (&i, place) in contacts.iter().zip(places).filter(|(i, _)| **i != EMPTY) {
                    let turning = (i as usize).checked_sub(rigid.num_contacts());
                    let contact = turning.map_or(i, |k| rigid.turning()[k].contact);
                    for (slot, body) in place.iter_mut().zip(packing.places_of(rigid, contact)) {
                        let Some(known) = met.get_mut(body as usize) else { continue };
                        if known.0 != chunk {
                            *known = (chunk, owners.len() as u32);
                            owners.push(body);
                        }
                        *slot = known.1;
                    }
                }
                owners.resize(owners.len() + behind, fixed);
                owners
            };
        let owners: Vec<Vec<u32>> = chunks.enumerate().map_init(none_met, owners_of).collect();
        let mut chunk_start = vec![0];
        for own in &owners {
            chunk_start.push(chunk_start[chunk_start.len() - 1] + own.len());
        }
        let owner = owners.concat();
        // What acts on an image acts on its body, too.
        let first_image = rigid.num_bodies();
        let bodies_of = |owner: u32| {
            let image = (owner as usize).checked_sub(first_image).and_then(|k| packing.images.all.get(k));
            [(owner != fixed).then_some(owner), image.and_then(|image| image.of)].into_iter().flatten()
        };
        let mut slot_start = vec![0_u32; bodies + 1];
        for body in owner.iter().flat_map(|&owner| bodies_of(owner)) {
            slot_start[body as usize + 1] += 1;
        }
        for b in 0..bodies {
            slot_start[b + 1] += slot_start[b];
        }
        let mut next = slot_start.clone();
        let mut slots = vec![0; slot_start[bodies] as usize];
        for (slot, &owner) in owner.iter().enumerate() {
            for body in bodies_of(owner) {
                slots[next[body as usize] as usize] = slot as u32;
                next[body as usize] += 1;
            }
        }
        Self { places, chunk_start, behind, slot_start, slots }
    }

    /// The same without what [`Self::of_place`] tells, once that is known elsewhere.
    pub(super) fn without_places(self) -> Self {
        Self { places: Vec::new(), ..self }
    }

    /// Slots of bodies A and B of the contact at a place, counted from the first slot of its chunk.
    pub(super) fn of_place(&self, place: usize) -> [u32; 2] {
        self.places[place]
    }

    /// Where the room behind the slots of a chunk begins.
    pub(super) fn behind(&self, chunk: usize) -> usize {
        self.chunk_start[chunk + 1] - self.behind
    }

    /// Number of slots of all chunks.
    pub(super) fn len(&self) -> usize {
        self.chunk_start.last().copied().unwrap_or_default()
    }

    /// Slots of a range of chunks.
    pub(super) fn of_chunks(&self, chunks: Range<usize>) -> Range<usize> {
        self.chunk_start[chunks.start]..self.chunk_start[chunks.end]
    }

    /// The share of a rank in passes over these chunks and over tasks of so many bodies; coupled ones are
    /// moved by contacts of all ranks.
    pub(super) fn share(
        &self,
        ranks: Option<&Arc<Ranks>>,
        task_len: usize,
        is_coupled: impl Fn(u32) -> bool,
    ) -> Option<Box<Share>> {
        let bodies = (self.slot_start.len() - 1, task_len);
        let for_all = |body: usize| is_coupled(body as u32);
        let share = Share::new(ranks?, &self.chunk_start, bodies, |body| self.of_body(body), for_all);
        share.map(Box::new)
    }

    /// Slots of the body at a place.
    #[inline(always)]
    pub(super) fn of_body(&self, body: usize) -> &[u32] {
        &self.slots[self.slot_start[body] as usize..self.slot_start[body + 1] as usize]
    }
}
