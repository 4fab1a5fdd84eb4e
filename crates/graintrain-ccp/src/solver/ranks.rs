//! Ranks: processes that each hold the whole problem and share the work on it, with the bits of one process.
//!
//! What they do together is of three kinds: forces on bodies that contacts of several ranks touch are
//! [exchanged](Transport::exchange), sums per chunk of contacts are [gathered](Transport::gather) and added
//! by everybody in the order of the chunks, and whoever was asked to stop [tells](Ranks::agree_to_stop) the
//! others. How words travel is the business of a [`Transport`]: MPI's in a crate of its own, [threads] for
//! tests.

pub mod threads;

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

/// How words of 64 bits travel from rank to rank. Every rank makes the same calls in the same order.
///
/// A transport that fails has nobody to tell it to: it ends the program on all ranks.
pub trait Transport: std::fmt::Debug + Send + Sync {
    /// Number of this rank, below [`Self::count`].
    fn rank(&self) -> usize;

    /// Number of ranks.
    fn count(&self) -> usize;

    /// A message to every rank and one from every rank, and [`Self::gather`] of `shared` at the same time. A
    /// message without words is not sent.
    fn exchange(&self, messages: Messages<'_>, shared: &mut [u64], shared_counts: &[usize]);

    /// Everybody's words to everybody: `words` holds those of rank 0, 1 and so on behind one another, with so
    /// many each. On entry every rank has filled in its own.
    fn gather(&self, words: &mut [u64], counts: &[usize]);

    /// Ends the program on all ranks at once, wherever they are.
    fn abort(&self, code: i32) -> !;
}

/// Messages of one rank to the others and of the others to it.
#[derive(Debug)]
pub struct Messages<'a> {
    /// Those to rank 0, 1 and so on behind one another.
    pub send: &'a [u64],
    /// Words of each.
    pub send_counts: &'a [usize],
    /// Takes those of rank 0, 1 and so on.
    pub receive: &'a mut [u64],
    /// Words of each.
    pub receive_counts: &'a [usize],
}

/// The ranks that work together, as one of them sees them.
#[derive(Debug)]
pub struct Ranks {
    transport: Box<dyn Transport>,
    /// Set on this rank alone: it was asked to stop.
    asked: Arc<AtomicBool>,
    /// Set on all ranks in the same place of their work.
    agreed: Arc<AtomicBool>,
    words: AtomicU64,
    nanoseconds: AtomicU64,
    contacts: AtomicU64,
}

/// What ranks have spent on each other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spent {
    /// Bytes that this rank has sent: of messages to every other rank, and of its own part of what is
    /// gathered once.
    pub bytes: u64,
    /// Seconds of wall clock in communication, with waiting for ranks that come later.
    pub seconds: f64,
    /// Contacts that this rank has passed over, summed over the passes of distributed solves.
    pub contacts: u64,
}

impl Ranks {
    /// Ranks over a transport. `asked` is what signals to this process set.
    pub fn new(transport: Box<dyn Transport>, asked: Arc<AtomicBool>) -> Self {
        Self {
            transport,
            asked,
            agreed: Arc::default(),
            words: AtomicU64::new(0),
            nanoseconds: AtomicU64::new(0),
            contacts: AtomicU64::new(0),
        }
    }

    /// Number of this rank.
    pub fn rank(&self) -> usize {
        self.transport.rank()
    }

    /// Number of ranks.
    pub fn count(&self) -> usize {
        self.transport.count()
    }

    /// The flag by which this rank is asked to stop, the one given to [`Self::new`].
    pub fn asked(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.asked)
    }

    /// The flag that says on all ranks alike that it is time to stop: whatever runs on all ranks looks at
    /// this one.
    pub fn stop(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.agreed)
    }

    /// Sets [`Self::stop`] on all ranks where one of them was asked to stop.
    pub fn agree_to_stop(&self) {
        let asked = self.asked.load(Ordering::Relaxed);
        if self.numbers(u64::from(asked)).into_iter().any(|asked| asked != 0) {
            self.agreed.store(true, Ordering::Relaxed);
        }
    }

    /// A number of every rank.
    pub fn numbers(&self, mine: u64) -> Vec<u64> {
        let mut numbers = vec![0; self.count()];
        numbers[self.rank()] = mine;
        self.gather(&mut numbers, &vec![1; self.count()]);
        numbers
    }

    /// [`Transport::gather`].
    pub fn gather(&self, words: &mut [u64], counts: &[usize]) {
        let start = Instant::now();
        self.transport.gather(words, counts);
        self.note(counts[self.rank()], start);
    }

    /// The words of all ranks behind one another; each gives as many as it has.
    pub fn join(&self, mine: &[u64]) -> Vec<u64> {
        let counts: Vec<usize> =
            self.numbers(mine.len() as u64).into_iter().map(|count| count as usize).collect();
        let first: usize = counts[..self.rank()].iter().sum();
        let mut words = vec![0; counts.iter().sum()];
        words[first..first + mine.len()].copy_from_slice(mine);
        self.gather(&mut words, &counts);
        words
    }

    /// The part of this rank of so many things, all parts about alike.
    pub fn part_of(&self, things: usize) -> Range<usize> {
        let bound = |rank: usize| things * rank / self.count();
        bound(self.rank())..bound(self.rank() + 1)
    }

    /// [`Transport::exchange`].
    pub fn exchange(&self, messages: Messages<'_>, shared: &mut [u64], shared_counts: &[usize]) {
        let start = Instant::now();
        let words = messages.send.len() + shared_counts[self.rank()];
        self.transport.exchange(messages, shared, shared_counts);
        self.note(words, start);
    }

    /// [`Transport::abort`].
    pub fn abort(&self, code: i32) -> ! {
        self.transport.abort(code)
    }

    /// What was spent so far.
    pub fn spent(&self) -> Spent {
        Spent {
            bytes: 8 * self.words.load(Ordering::Relaxed),
            seconds: 1e-9 * self.nanoseconds.load(Ordering::Relaxed) as f64,
            contacts: self.contacts.load(Ordering::Relaxed),
        }
    }

    /// Counts contacts that this rank has passed over.
    pub(super) fn passed(&self, contacts: usize) {
        self.contacts.fetch_add(contacts as u64, Ordering::Relaxed);
    }

    fn note(&self, words: usize, start: Instant) {
        self.words.fetch_add(words as u64, Ordering::Relaxed);
        self.nanoseconds.fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }
}

/// What can travel as words.
pub(super) trait Words: Copy {
    /// Words of one.
    const COUNT: usize;

    /// Writes it into so many words.
    fn write(&self, words: &mut [u64]);

    /// Reads it from so many words.
    fn read(words: &[u64]) -> Self;
}

impl<T: Words, const N: usize> Words for [T; N] {
    const COUNT: usize = N * T::COUNT;

    fn write(&self, words: &mut [u64]) {
        for (item, words) in self.iter().zip(words.chunks_exact_mut(T::COUNT)) {
            item.write(words);
        }
    }

    fn read(words: &[u64]) -> Self {
        std::array::from_fn(|k| T::read(&words[k * T::COUNT..(k + 1) * T::COUNT]))
    }
}

impl Words for super::lanes::Lanes {
    const COUNT: usize = super::lanes::LANES;

    fn write(&self, words: &mut [u64]) {
        for (word, number) in words.iter_mut().zip(self.0) {
            *word = number.to_bits();
        }
    }

    fn read(words: &[u64]) -> Self {
        Self(std::array::from_fn(|k| f64::from_bits(words[k])))
    }
}

impl Words for super::octet::Octet {
    const COUNT: usize = super::octet::EIGHT / 2;

    fn write(&self, words: &mut [u64]) {
        for (word, [low, high]) in words.iter_mut().zip(self.0.as_chunks::<2>().0) {
            *word = u64::from(low.to_bits()) | u64::from(high.to_bits()) << 32;
        }
    }

    fn read(words: &[u64]) -> Self {
        Self(std::array::from_fn(|k| f32::from_bits((words[k / 2] >> (32 * (k % 2))) as u32)))
    }
}
