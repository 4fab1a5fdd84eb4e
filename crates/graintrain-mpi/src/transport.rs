//! Words from rank to rank by MPI. The only place that knows the binding.

use ferrompi::{Communicator, Request};
use graintrain_ccp::solver::ranks::{Messages, Transport};
use std::sync::{Arc, Mutex, PoisonError};

/// Tag of messages of an exchange.
const EXCHANGE: i32 = 0;

/// MPI's transport. A failure of MPI ends the program by a panic, whose hook ends all ranks.
pub struct MpiTransport {
    world: Arc<Communicator>,
    /// This rank's part of what is gathered: MPI reads it from elsewhere than where it writes.
    own: Mutex<Vec<u64>>,
}

impl MpiTransport {
    /// Over all processes of the program.
    pub fn new(world: Arc<Communicator>) -> Self {
        Self { world, own: Mutex::default() }
    }
}

impl std::fmt::Debug for MpiTransport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "MPI rank {} of {}", self.world.rank(), self.world.size())
    }
}

/// Slices of so many words each, one behind another.
fn parts<'a>(mut words: &'a [u64], counts: &[usize]) -> Vec<&'a [u64]> {
    let take = |&count: &usize| words.split_off(..count).expect("as many words as are counted");
    counts.iter().map(take).collect()
}

/// The same to write to.
fn parts_mut<'a>(mut words: &'a mut [u64], counts: &[usize]) -> Vec<&'a mut [u64]> {
    let take = |&count: &usize| words.split_off_mut(..count).expect("as many words as are counted");
    counts.iter().map(take).collect()
}

/// MPI counts in 32 bits.
fn counted(count: usize) -> i32 {
    i32::try_from(count).expect("fewer than 2^31 words per message")
}

impl Transport for MpiTransport {
    fn rank(&self) -> usize {
        self.world.rank() as usize
    }

    fn count(&self) -> usize {
        self.world.size() as usize
    }

    fn exchange(&self, messages: Messages<'_>, shared: &mut [u64], shared_counts: &[usize]) {
        let Messages { send, send_counts, receive, receive_counts } = messages;
        let world = &self.world;
        let (send, receive) = (parts(send, send_counts), parts_mut(receive, receive_counts));
        let exchanged = ferrompi::scope(|scope| {
            let mut requests = Vec::with_capacity(2 * send.len());
            for (rank, words) in (0..).zip(receive).filter(|(_, words)| !words.is_empty()) {
                requests.push(world.irecv(scope, words, rank, EXCHANGE)?);
            }
            for (rank, words) in (0..).zip(send).filter(|(_, words)| !words.is_empty()) {
                requests.push(world.isend(scope, words, rank, EXCHANGE)?);
            }
            // Meanwhile the messages are under way.
            self.gather(shared, shared_counts);
            Request::wait_all(&mut requests)
        });
        exchanged.expect("MPI exchanges messages");
    }

    fn gather(&self, words: &mut [u64], counts: &[usize]) {
        let counts: Vec<i32> = counts.iter().map(|&count| counted(count)).collect();
        let mut place = 0;
        let mut places = Vec::with_capacity(counts.len());
        for &count in &counts {
            places.push(counted(place));
            place += count as usize;
        }
        let mine = places[self.rank()] as usize..(places[self.rank()] + counts[self.rank()]) as usize;
        let mut own = self.own.lock().unwrap_or_else(PoisonError::into_inner);
        own.clear();
        own.extend_from_slice(&words[mine]);
        self.world.allgatherv(&own, words, &counts, &places).expect("MPI gathers words");
    }

    fn abort(&self, code: i32) -> ! {
        self.world.abort(code)
    }
}
