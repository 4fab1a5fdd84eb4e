//! In which order contacts and bodies lie in memory.

use super::body_operator::TOGETHER;
use super::cell_images::Images;
use super::lanes::LANES;
use super::tasks::CHUNK;
use crate::delassus::{FIXED, RigidDelassus};
use rayon::prelude::*;
use std::ops::Range;

/// In which order contacts and bodies lie in memory.
pub(super) struct Packing {
    /// Contact at each place; after [`with_turning`] block row of N, or [`EMPTY`].
    pub contacts: Vec<u32>,
    /// Place of each body.
    pub bodies: Vec<u32>,
    /// Images of bodies across the boundary of a stress-controlled cell; their places come after those of
    /// bodies.
    pub images: Images,
    /// The place of the first body of its mechanism for every body that joints couple, else [`ALONE`]; empty
    /// where they couple none.
    movers: Vec<u32>,
}

/// Of a body that no joint couples.
const ALONE: u32 = u32::MAX;

/// See [`Packing::movers`], of bodies at these places.
fn movers(rigid: &RigidDelassus, places: &[u32]) -> Vec<u32> {
    if rigid.coupled().is_empty() {
        return Vec::new();
    }
    let mut movers = vec![ALONE; places.len()];
    for group in rigid.coupled() {
        for &body in &group.bodies {
            movers[places[body as usize] as usize] = places[group.bodies[0] as usize];
        }
    }
    movers
}

/// What an impulse on the body at a place moves, by one of its places.
#[inline]
fn mover(movers: &[u32], place: u32) -> u32 {
    movers.get(place as usize).copied().filter(|&mover| mover != ALONE).unwrap_or(place)
}

impl Packing {
    /// What an impulse on the body at a place moves, by one of its places: the body, or its mechanism.
    pub fn mover(&self, place: u32) -> u32 {
        mover(&self.movers, place)
    }

    /// Whether joints couple the body at a place with others.
    pub fn is_coupled(&self, place: u32) -> bool {
        self.movers.get(place as usize).is_some_and(|&mover| mover != ALONE)
    }

    /// Number of places of bodies and images; that after the last one stands for [`FIXED`].
    pub fn num_places(&self) -> usize {
        self.bodies.len() + self.images.all.len()
    }

    /// Places of the bodies A and B of a contact, or of the image of B that it reaches.
    pub fn places_of(&self, rigid: &RigidDelassus, contact: u32) -> [u32; 2] {
        let row = &rigid.contacts()[contact as usize];
        let place = |body: u32| {
            if body == FIXED { self.num_places() as u32 } else { self.bodies[body as usize] }
        };
        let image = self.images.of_contact(contact);
        [place(row.body_a), image.map_or_else(|| place(row.body_b), |image| self.bodies.len() as u32 + image)]
    }
}

/// A place without a block row.
pub(super) const EMPTY: u32 = u32::MAX;

/// Puts behind every batch of contacts that has any the batch of their turning rows, block row N_c + k for
/// entry k of the list of contacts that resist turning (ascending): both in one chunk, lane by lane.
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

/// A contact and the places of its bodies; [`FIXED`] is the highest.
#[derive(Clone, Copy)]
struct Pair {
    lower: u32,
    higher: u32,
    contact: u32,
}

/// Bodies whose contacts a parallel task sorts.
const BODIES: usize = 2048;

/// The contacts sorted by their lower, then their higher body, then their index; `number` is the place of
/// each body.
fn sorted_by_bodies(rigid: &RigidDelassus, number: &[u32]) -> Vec<Pair> {
    let place = |body: u32| if body == FIXED { FIXED } else { number[body as usize] };
    let pairs = rigid.contacts().iter().zip(0..).map(|(row, contact)| {
        let (a, b) = (place(row.body_a), place(row.body_b));
        Pair { lower: a.min(b), higher: a.max(b), contact }
    });
    // A body has few contacts: counting sorts by the lower one, and what is left is short. Contacts without a
    // body come last.
    let bucket = |pair: &Pair| (pair.lower as usize).min(number.len());
    let mut start = vec![0_u32; number.len() + 2];
    for pair in pairs.clone() {
        start[bucket(&pair) + 1] += 1;
    }
    for b in 0..=number.len() {
        start[b + 1] += start[b];
    }
    let mut next = start.clone();
    let mut sorted = vec![Pair { lower: 0, higher: 0, contact: 0 }; rigid.num_contacts()];
    for pair in pairs {
        let place = &mut next[bucket(&pair)];
        sorted[*place as usize] = pair;
        *place += 1;
    }
    let mut rest = &mut sorted[..];
    let mut tasks = Vec::with_capacity(number.len() / BODIES + 1);
    for first in (0..start.len() - 1).step_by(BODIES) {
        let end = start[(first + BODIES).min(start.len() - 1)];
        let (own, later) = rest.split_at_mut((end - start[first]) as usize);
        tasks.push(own);
        rest = later;
    }
    tasks.into_par_iter().for_each(|own| {
        own.chunk_by_mut(|a, b| bucket(a) == bucket(b))
            .for_each(|own| own.sort_unstable_by_key(|pair| (pair.higher, pair.contact)));
    });
    sorted
}

/// Contacts among which those of the next [`TOGETHER`] batches are looked for.
const POOL: usize = 256;

/// Neighbours together: bodies numbered breadth first over the contact graph, contacts sorted by their lower,
/// then their higher body. Within a chunk they are dealt out again so that [`TOGETHER`] batches share no body
/// wherever possible. (The same helps a pass: sums on one body would otherwise wait for one another.)
pub(super) fn pack(rigid: &RigidDelassus) -> Packing {
    let bodies = numbered(rigid);
    let movers = movers(rigid, &bodies);
    let mut contacts = sorted_by_bodies(rigid, &bodies);
    let chunks = contacts.par_chunks_mut(CHUNK * LANES);
    let deal = |dealer: &mut Dealer<'_>, chunk: &mut [Pair]| dealer.deal(chunk, |_| false);
    chunks.for_each_init(|| Dealer::new(bodies.len(), &movers), deal);
    Packing::of(rigid, contacts, bodies, movers)
}

impl Packing {
    fn of(rigid: &RigidDelassus, contacts: Vec<Pair>, bodies: Vec<u32>, movers: Vec<u32>) -> Self {
        let contacts = contacts.into_iter().map(|pair| pair.contact).collect();
        let images = Images::new(rigid, |body| bodies.get(body as usize).copied());
        Self { contacts, bodies, images, movers }
    }
}

/// The place of each body: breadth first over the contact graph.
fn numbered(rigid: &RigidDelassus) -> Vec<u32> {
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
    number
}

/// So many contacts there are per range of bodies, about.
pub(super) const PER_RANGE: usize = 1024;

/// Contacts whose bodies lie in one range of places.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// Places of contacts.
    pub contacts: Range<usize>,
    /// Places of bodies.
    pub bodies: Range<usize>,
}

/// A packing for sweeps that threads share: see [`pack_in_blocks`].
pub(super) struct PackedBlocks {
    pub packing: Packing,
    /// Lists of blocks, one list after the other; those of one list share no body.
    pub lists: Vec<Vec<Block>>,
}

/// As [`pack`], with the contacts in blocks whose lengths are multiples of `multiple`. With ranges of r
/// places of bodies, a contact belongs to the first of these that has both of its bodies (what is fixed
/// counts for neither):
///
/// ```text
/// [k r, (k + 1) r),   k = 0, 1, ...;      [(k - 1/2) r, (k + 1/2) r),   k = 1, 2, ...;      all places
/// ```
///
/// Blocks of one of the three lists share no body. r depends on the contacts alone, never on threads; small
/// problems have one range. Of every chunk, contacts that are idle come last, so that there are batches of
/// nothing else. Cost: a sort of the contacts, as of [`pack`].
pub(super) fn pack_in_blocks(
    rigid: &RigidDelassus,
    multiple: usize,
    is_idle: impl Fn(u32) -> bool + Sync,
) -> PackedBlocks {
    let bodies = numbered(rigid);
    let movers = movers(rigid, &bodies);
    let mut sorted = sorted_by_bodies(rigid, &bodies);
    let way = |pair: &Pair| if pair.higher == FIXED { 0 } else { u64::from(pair.higher - pair.lower) };
    let mean_way = sorted.iter().map(way).sum::<u64>() as usize / sorted.len().max(1);
    let most = (sorted.len() / PER_RANGE).max(1);
    // Seams that are wider than half a range would be left over.
    let range = bodies.len().div_ceil(most).max(4 * mean_way).max(1);
    let count = bodies.len().div_ceil(range).max(1);
    let last = 2 * count;
    let class = |pair: &Pair| {
        let (low, high) =
            (pair.lower as usize, if pair.higher == FIXED { pair.lower } else { pair.higher } as usize);
        let is_coupled = |place: usize| movers.get(place).is_some_and(|&mover| mover != ALONE);
        if pair.lower == FIXED || is_coupled(low) || is_coupled(high) {
            last
        } else if low / range == high / range {
            low / range
        } else {
            let shifted = [low, high].map(|place| (place + range / 2) / range);
            if shifted[0] == shifted[1] { count + shifted[0] } else { last }
        }
    };
    let mut classes: Vec<Vec<Pair>> = vec![Vec::new(); last + 1];
    sorted.iter().for_each(|pair| classes[class(pair)].push(*pair));
    let mut left = std::mem::take(&mut classes[last]);
    sorted.clear();
    let mut blocks = Vec::new();
    for (class, own) in classes.iter().enumerate() {
        let full = own.len() / multiple * multiple;
        left.extend(&own[full..]);
        let first = class % count * range;
        let shift = if class < count { 0 } else { range / 2 };
        let ends = [first.saturating_sub(shift), (first + range).saturating_sub(shift)];
        let [first, end] = ends.map(|place| place.min(bodies.len()));
        blocks.push(Block { contacts: sorted.len()..sorted.len() + full, bodies: first..end });
        sorted.extend(&own[..full]);
    }
    blocks.push(Block { contacts: sorted.len()..sorted.len() + left.len(), bodies: 0..bodies.len() });
    sorted.extend(left);
    let mut rest = &mut sorted[..];
    let mut chunks = Vec::new();
    for block in &blocks {
        let (own, later) = rest.split_at_mut(block.contacts.len());
        chunks.extend(own.chunks_mut(CHUNK * LANES));
        rest = later;
    }
    let deal = |dealer: &mut Dealer<'_>, chunk: &mut [Pair]| dealer.deal(chunk, &is_idle);
    chunks.into_par_iter().for_each_init(|| Dealer::new(bodies.len(), &movers), deal);
    let mut lists = vec![blocks[..count].to_vec(), blocks[count..last].to_vec(), blocks[last..].to_vec()];
    lists.iter_mut().for_each(|list| list.retain(|block| !block.contacts.is_empty()));
    PackedBlocks { packing: Packing::of(rigid, sorted, bodies, movers), lists }
}

/// Deals the contacts of a chunk out to groups.
struct Dealer<'a> {
    /// See [`Packing::movers`].
    movers: &'a [u32],
    /// The last group that each body (or the first of its mechanism) was dealt to; groups of other chunks do
    /// not count.
    group_of: Vec<u32>,
    group: u32,
    dealt: Vec<Pair>,
    pool: Vec<Pair>,
}

impl<'a> Dealer<'a> {
    fn new(bodies: usize, movers: &'a [u32]) -> Self {
        let dealt = Vec::with_capacity(CHUNK * LANES);
        Self { movers, group_of: vec![u32::MAX; bodies], group: 0, dealt, pool: Vec::with_capacity(POOL) }
    }

    /// Deals those out first that are not idle.
    fn deal(&mut self, chunk: &mut [Pair], is_idle: impl Fn(u32) -> bool) {
        let Self { movers, group_of, group, dealt, pool } = self;
        let is_idle = &is_idle;
        let of = |idle: bool| chunk.iter().filter(move |pair| is_idle(pair.contact) == idle).copied();
        let mut rest = of(false).chain(of(true));
        dealt.clear();
        while dealt.len() < chunk.len() {
            pool.extend(rest.by_ref().take(POOL - pool.len()));
            let first = dealt.len();
            let (mut seen, mut kept) = (0, 0);
            while seen < pool.len() && dealt.len() - first < TOGETHER * LANES {
                let pair = pool[seen];
                seen += 1;
                let moved = [pair.lower, pair.higher].map(|body| mover(movers, body));
                let free = |body: &u32| *body == FIXED || group_of[*body as usize] != *group;
                if moved.iter().all(free) {
                    for body in moved {
                        if body != FIXED {
                            group_of[body as usize] = *group;
                        }
                    }
                    dealt.push(pair);
                } else {
                    pool[kept] = pair;
                    kept += 1;
                }
            }
            pool.drain(kept..seen);
            *group += 1;
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
        chunk.copy_from_slice(dealt);
    }
}
