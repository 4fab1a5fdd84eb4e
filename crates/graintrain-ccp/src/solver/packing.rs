//! In which order contacts and bodies lie in memory.

use super::body_operator::TOGETHER;
use super::lanes::LANES;
use super::tasks::CHUNK;
use crate::delassus::{FIXED, RigidDelassus};

/// In which order contacts and bodies lie in memory.
pub(super) struct Packing {
    /// Contact at each place; after [`with_turning`] block row of N, or [`EMPTY`].
    pub contacts: Vec<u32>,
    /// Place of each body.
    pub bodies: Vec<u32>,
}

/// A place without a block row.
pub(super) const EMPTY: u32 = u32::MAX;

/// Puts behind every batch of contacts that has any the batch of their turning rows, block row N_c + k for entry k of the list of
/// contacts that resist turning (ascending): both in one chunk, lane by lane.
pub(super) fn with_turning(order: &mut Vec<u32>, contacts: usize, turning: impl Iterator<Item = u32>) {
    let mut block = vec![EMPTY; contacts];
    for (k, contact) in turning.enumerate() {
        block[contact as usize] = (contacts + k) as u32;
    }
    let plain = std::mem::take(order);
    for batch in plain.chunks(LANES) {
        let own = |lane: usize| batch.get(lane).map_or(EMPTY, |&i| block[i as usize]);
        let turning: [u32; LANES] = std::array::from_fn(own);
        let turns = turning.iter().any(|&block| block != EMPTY);
        if turns && (order.len() / LANES) % CHUNK == CHUNK - 1 {
            order.extend([EMPTY; LANES]);
        }
        order.extend((0..LANES).map(|lane| batch.get(lane).copied().unwrap_or(EMPTY)));
        if turns {
            order.extend(turning);
        }
    }
}

/// Which batches of an order by [`with_turning`] hold turning rows; empty where none do.
pub(super) fn turning_batches(order: &[u32], contacts: usize) -> Vec<bool> {
    let turns = |block: &u32| *block != EMPTY && *block as usize >= contacts;
    if !order.iter().any(turns) {
        return Vec::new();
    }
    order.chunks(LANES).map(|batch| batch.iter().any(turns)).collect()
}

/// Contacts among which those of the next [`TOGETHER`] batches are looked for.
const POOL: usize = 256;

/// Neighbours together: bodies numbered breadth first over the contact graph, contacts sorted by their lower, then their
/// higher body. Within a chunk they are dealt out again so that [`TOGETHER`] batches share no body wherever possible. (The same helps
/// a pass: sums on one body would otherwise wait for one another.)
pub(super) fn pack(rigid: &RigidDelassus) -> Packing {
    let bodies = rigid.num_bodies();
    let mut number = vec![u32::MAX; bodies];
    let mut queue = Vec::with_capacity(bodies);
    for seed in 0..bodies {
        if number[seed] != u32::MAX {
            continue;
        }
        number[seed] = queue.len() as u32;
        let mut next = queue.len();
        queue.push(seed);
        while next < queue.len() {
            for side in rigid.sides(queue[next]) {
                let contact = &rigid.contacts()[side.contact as usize];
                for body in [contact.body_a, contact.body_b] {
                    if body != FIXED && number[body as usize] == u32::MAX {
                        number[body as usize] = queue.len() as u32;
                        queue.push(body as usize);
                    }
                }
            }
            next += 1;
        }
    }
    let place = |body: u32| if body == FIXED { FIXED } else { number[body as usize] };
    let pair = |i: u32| {
        let contact = &rigid.contacts()[i as usize];
        (place(contact.body_a), place(contact.body_b))
    };
    let mut contacts: Vec<u32> = (0..rigid.num_contacts() as u32).collect();
    contacts.sort_unstable_by_key(|&i| {
        let (a, b) = pair(i);
        (a.min(b), a.max(b), i)
    });
    // The last group that each body was dealt to.
    let mut group_of = vec![u32::MAX; bodies];
    let mut group = 0;
    let mut dealt = Vec::with_capacity(CHUNK * LANES);
    let mut pool: Vec<u32> = Vec::with_capacity(POOL);
    for chunk in contacts.chunks_mut(CHUNK * LANES) {
        let mut rest = chunk.iter().copied();
        dealt.clear();
        while dealt.len() < chunk.len() {
            pool.extend(rest.by_ref().take(POOL - pool.len()));
            let first = dealt.len();
            pool.retain(|&i| {
                let (a, b) = pair(i);
                let free = |body: u32| body == FIXED || group_of[body as usize] != group;
                if dealt.len() - first == TOGETHER * LANES || !free(a) || !free(b) {
                    return true;
                }
                for body in [a, b] {
                    if body != FIXED {
                        group_of[body as usize] = group;
                    }
                }
                dealt.push(i);
                false
            });
            group += 1;
            let found = dealt.len() - first;
            if found >= LANES {
                // What does not fill a batch waits for the next group.
                pool.splice(0..0, dealt.drain(first + found / LANES * LANES..));
            } else {
                // A batch that cannot be filled takes what comes next: places must not stay empty.
                let missing = (LANES - found).min(pool.len());
                dealt.extend(pool.drain(..missing));
            }
        }
        chunk.copy_from_slice(&dealt);
    }
    Packing { contacts, bodies: number }
}
