//! Ranks as threads of one process: what runs on ranks, tried without MPI.

use super::{Messages, Ranks, Transport};
use std::sync::{Arc, Barrier, Mutex, PoisonError};

/// What a rank has left for the others: words, and how many of them are for rank 0, 1 and so on.
type Letters = (Vec<u64>, Vec<usize>);

/// A rank that is a thread.
#[derive(Debug)]
struct ThreadTransport {
    rank: usize,
    letters: Arc<Vec<Mutex<Letters>>>,
    barrier: Arc<Barrier>,
}

impl ThreadTransport {
    /// Leaves these letters, and looks at those of every rank.
    fn post(&self, letters: Letters, mut look: impl FnMut(usize, &Letters)) {
        let open = |rank: usize| self.letters[rank].lock().unwrap_or_else(PoisonError::into_inner);
        *open(self.rank) = letters;
        self.barrier.wait();
        for rank in 0..self.letters.len() {
            look(rank, &open(rank));
        }
        // Nobody writes again before everybody has read.
        self.barrier.wait();
    }
}

impl Transport for ThreadTransport {
    fn rank(&self) -> usize {
        self.rank
    }

    fn count(&self) -> usize {
        self.letters.len()
    }

    fn exchange(&self, messages: Messages<'_>, shared: &mut [u64], shared_counts: &[usize]) {
        let Messages { send, send_counts, receive, receive_counts } = messages;
        let mut place = 0;
        self.post((send.to_vec(), send_counts.to_vec()), |rank, (words, counts)| {
            let first = counts[..self.rank].iter().sum::<usize>();
            assert_eq!(counts[self.rank], receive_counts[rank], "rank {rank} sends what nobody expects");
            receive[place..place + receive_counts[rank]]
                .copy_from_slice(&words[first..first + counts[self.rank]]);
            place += receive_counts[rank];
        });
        self.gather(shared, shared_counts);
    }

    fn gather(&self, words: &mut [u64], counts: &[usize]) {
        let first = |rank: usize| counts[..rank].iter().sum::<usize>();
        let mine = words[first(self.rank)..first(self.rank + 1)].to_vec();
        self.post((mine, Vec::new()), |rank, (own, _)| {
            words[first(rank)..first(rank + 1)].copy_from_slice(own);
        });
    }

    fn abort(&self, code: i32) -> ! {
        std::process::exit(code)
    }
}

/// What `work` returns on each of so many ranks, each a thread with its own pool of `threads` threads. Where
/// a rank panics while others wait for it, they wait for ever: for tests.
pub fn on_ranks<T: Send>(count: usize, threads: usize, work: impl Fn(Arc<Ranks>) -> T + Sync) -> Vec<T> {
    let letters = Arc::new((0..count).map(|_| Mutex::default()).collect::<Vec<_>>());
    let barrier = Arc::new(Barrier::new(count));
    std::thread::scope(|scope| {
        let work = &work;
        let spawn = |rank| {
            let transport =
                ThreadTransport { rank, letters: Arc::clone(&letters), barrier: Arc::clone(&barrier) };
            scope.spawn(move || {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let ranks = Arc::new(Ranks::new(Box::new(transport), Arc::default()));
                pool.expect("threads can be started").install(|| work(ranks))
            })
        };
        let running: Vec<_> = (0..count).map(spawn).collect();
        running.into_iter().map(|thread| thread.join().expect("no rank panics")).collect()
    })
}
