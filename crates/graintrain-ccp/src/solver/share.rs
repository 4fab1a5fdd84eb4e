//! What one of several [ranks](Ranks) does of a problem.
//!
//! A rank owns a run of the chunks of contacts and a run of the tasks of bodies. In a pass it does its own
//! chunks, sends the slots of bodies that others need, gets those that it needs, and adds up the slots of its
//! own bodies and of those beyond that its contacts touch, in the order in which one process adds them. Sums
//! are gathered chunk by chunk and task by task and added in their order. So all bits are those of one
//! process, and what a rank does not own it never looks at.

use super::ranks::{Messages, Ranks, Words};
use super::tasks::{SUMS, Tally, Totals};
use std::ops::Range;
use std::sync::Arc;

/// The part of one rank.
#[derive(Clone, Debug)]
pub(super) struct Share {
    ranks: Arc<Ranks>,
    /// Chunks of rank p are `chunks[p]..chunks[p + 1]`.
    chunks: Vec<usize>,
    /// The same of tasks of bodies.
    tasks: Vec<usize>,
    /// Runs of bodies beyond the own tasks that own contacts touch.
    beyond: Vec<Range<usize>>,
    /// Own slots that others need, for rank 0, 1 and so on, and how many for each.
    send: Vec<u32>,
    send_counts: Vec<usize>,
    /// Slots of others that this rank needs.
    receive: Vec<u32>,
    receive_counts: Vec<usize>,
}

/// Buffers of messages, kept from pass to pass.
#[derive(Clone, Debug, Default)]
pub(super) struct Buffers {
    send: Vec<u64>,
    receive: Vec<u64>,
    shared: Vec<u64>,
}

/// Adds the first `N` sums and maxima in their order.
fn read_totals<const N: usize>(words: &[u64]) -> Totals {
    let mut totals = Totals::default();
    for words in words.chunks_exact(N + 1) {
        let mut next = Totals { max: f64::from_bits(words[N]), ..Totals::default() };
        for (sum, word) in next.sum.iter_mut().zip(&words[..N]) {
            *sum = f64::from_bits(*word);
        }
        totals.add(&next);
    }
    totals
}

/// Bounds of equal parts of so many things.
fn equal_parts(things: usize, parts: usize) -> Vec<usize> {
    (0..=parts).map(|part| things * part / parts).collect()
}

impl Share {
    /// The share of this rank in problems of so many chunks; `slots_of` gives the slots of each body,
    /// ascending, and `chunk_start` the first slot of each chunk and of the one after the last. A task is of
    /// `task_len` bodies; every rank needs the slots of those that are `for_all`. `None` where there is
    /// nothing to share.
    pub(super) fn new<'a>(
        ranks: &Arc<Ranks>,
        chunk_start: &[usize],
        (bodies, task_len): (usize, usize),
        slots_of: impl Fn(usize) -> &'a [u32],
        for_all: impl Fn(usize) -> bool,
    ) -> Option<Self> {
        let (me, count) = (ranks.rank(), ranks.count());
        let all_chunks = chunk_start.len().saturating_sub(1);
        if count < 2 || all_chunks < 2 {
            return None;
        }
        let chunks = equal_parts(all_chunks, count);
        let first_slots: Vec<usize> = chunks.iter().map(|&chunk| chunk_start[chunk]).collect();
        // Ranks without chunks have an empty range of slots: the last rank that begins at or before a slot
        // owns it.
        let rank_of = |slot: u32| first_slots[1..].partition_point(|&end| end <= slot as usize);
        // Bodies lie in the order of their first contacts: a task belongs where its middle body is first
        // touched.
        let all_tasks = bodies.div_ceil(task_len);
        let mut tasks = vec![0];
        let mut owner = 0;
        for task in 0..all_tasks {
            let middle = (task * task_len + task_len / 2).min(bodies - 1);
            let wanted = slots_of(middle).first().map_or(owner, |&slot| rank_of(slot));
            while owner < wanted {
                tasks.push(task);
                owner += 1;
            }
        }
        tasks.resize(count + 1, all_tasks);
        let own_bodies = (tasks[me] * task_len).min(bodies)..(tasks[me + 1] * task_len).min(bodies);
        let mut beyond: Vec<Range<usize>> = Vec::new();
        let (mut send, mut receive) = (vec![Vec::new(); count], vec![Vec::new(); count]);
        let mut needing: Vec<usize> = Vec::new();
        let mut keeper = 0;
        for body in 0..bodies {
            while body >= tasks[keeper + 1] * task_len {
                keeper += 1;
            }
            let slots = slots_of(body);
            needing.clear();
            if for_all(body) {
                needing.extend(0..count);
            } else {
                needing.extend(slots.iter().map(|&slot| rank_of(slot)).chain([keeper]));
            }
            needing.sort_unstable();
            needing.dedup();
            let is_needed = needing.contains(&me);
            if is_needed && !own_bodies.contains(&body) {
                match beyond.last_mut() {
                    Some(run) if run.end == body => run.end += 1,
                    _ => beyond.push(body..body + 1),
                }
            }
            if needing.len() == 1 {
                continue;
            }
            for &slot in slots {
                let from = rank_of(slot);
                if from == me {
                    needing.iter().filter(|&&to| to != me).for_each(|&to| send[to].push(slot));
                } else if is_needed {
                    receive[from].push(slot);
                }
            }
        }
        let counts = |lists: &[Vec<u32>]| lists.iter().map(Vec::len).collect();
        let (send_counts, receive_counts) = (counts(&send), counts(&receive));
        Some(Self {
            ranks: Arc::clone(ranks),
            chunks,
            tasks,
            beyond,
            send: send.concat(),
            send_counts,
            receive: receive.concat(),
            receive_counts,
        })
    }

    /// The chunks of this rank.
    pub(super) fn chunks(&self) -> Range<usize> {
        self.chunks[self.ranks.rank()]..self.chunks[self.ranks.rank() + 1]
    }

    /// The tasks of bodies of this rank.
    pub(super) fn tasks(&self) -> Range<usize> {
        self.tasks[self.ranks.rank()]..self.tasks[self.ranks.rank() + 1]
    }

    /// Runs of bodies that are not of these tasks and that contacts of this rank touch.
    pub(super) fn beyond(&self) -> &[Range<usize>] {
        &self.beyond
    }

    /// Counts contacts of a pass.
    pub(super) fn passed(&self, contacts: usize) {
        self.ranks.passed(contacts);
    }

    /// Ends a pass over the contacts: what the tallies of all chunks add up to, of which each rank has its
    /// own on entry. Where there are `slots`, those that bodies of several ranks need are sent and got.
    pub(super) fn end_pass<S: Words>(
        &self,
        slots: Option<&mut [S]>,
        tallies: &[Tally],
        buffers: &mut Buffers,
    ) -> Totals {
        let Buffers { send, receive, shared } = buffers;
        let counts = self.write_totals::<SUMS>(tallies, &self.chunks, shared);
        let Some(slots) = slots else {
            self.ranks.gather(shared, &counts);
            return read_totals::<SUMS>(shared);
        };
        send.resize(S::COUNT * self.send.len(), 0);
        receive.resize(S::COUNT * self.receive.len(), 0);
        for (&slot, words) in self.send.iter().zip(send.chunks_exact_mut(S::COUNT)) {
            slots[slot as usize].write(words);
        }
        let words = |counts: &[usize]| counts.iter().map(|count| S::COUNT * count).collect::<Vec<_>>();
        let (send_counts, receive_counts) = (&words(&self.send_counts), &words(&self.receive_counts));
        self.ranks.exchange(Messages { send, send_counts, receive, receive_counts }, shared, &counts);
        for (&slot, words) in self.receive.iter().zip(receive.chunks_exact(S::COUNT)) {
            slots[slot as usize] = S::read(words);
        }
        read_totals::<SUMS>(shared)
    }

    /// What the first sums of the tasks of bodies add up to, of which each rank has its own on entry.
    pub(super) fn total_of_tasks(&self, tallies: &[Tally], buffers: &mut Buffers) -> f64 {
        let counts = self.write_totals::<1>(tallies, &self.tasks, &mut buffers.shared);
        self.ranks.gather(&mut buffers.shared, &counts);
        read_totals::<1>(&buffers.shared).sum[0]
    }

    /// Writes the first `N` sums and the maximum of the own tallies among those of all ranks; the words of
    /// each rank.
    fn write_totals<const N: usize>(
        &self,
        tallies: &[Tally],
        bounds: &[usize],
        words: &mut Vec<u64>,
    ) -> Vec<usize> {
        let own = bounds[self.ranks.rank()]..bounds[self.ranks.rank() + 1];
        words.resize((N + 1) * bounds[bounds.len() - 1], 0);
        let place = (N + 1) * own.start..(N + 1) * own.end;
        for (tally, words) in tallies[own].iter().zip(words[place].chunks_exact_mut(N + 1)) {
            let own = tally.totals();
            for (word, sum) in words.iter_mut().zip(own.sum[..N].iter().chain([&own.max])) {
                *word = sum.to_bits();
            }
        }
        bounds.windows(2).map(|w| (N + 1) * (w[1] - w[0])).collect()
    }

    /// A vector of batches, of which each rank has those of its chunks, complete on all ranks.
    pub(super) fn complete<B: Words>(&self, batches: &mut [B], chunk_len: usize) {
        let bounds: Vec<usize> =
            self.chunks.iter().map(|&chunk| (chunk * chunk_len).min(batches.len())).collect();
        let me = self.ranks.rank();
        let mut words = vec![0; B::COUNT * batches.len()];
        let own = bounds[me]..bounds[me + 1];
        let place = B::COUNT * own.start..B::COUNT * own.end;
        for (batch, words) in batches[own].iter().zip(words[place].chunks_exact_mut(B::COUNT)) {
            batch.write(words);
        }
        let counts: Vec<usize> = bounds.windows(2).map(|w| B::COUNT * (w[1] - w[0])).collect();
        self.ranks.gather(&mut words, &counts);
        for (batch, words) in batches.iter_mut().zip(words.chunks_exact(B::COUNT)) {
            *batch = B::read(words);
        }
    }
}

/// The part of vectors that some tasks have, `unit` entries each.
pub(super) fn part_of<'a, T, const M: usize>(
    vectors: [&'a mut [T]; M],
    tasks: &Range<usize>,
    unit: usize,
) -> [&'a mut [T]; M] {
    vectors.map(|vector| {
        let end = (tasks.end * unit).min(vector.len());
        &mut vector[(tasks.start * unit).min(end)..end]
    })
}
