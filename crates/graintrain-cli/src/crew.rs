//! The processes that carry a command out: this one, or several ranks, of which the first one speaks and
//! writes.

use crate::error::Failure;
use crate::signal::Stop;
use crate::terminal;
use graintrain::world::World;
use graintrain_ccp::Ranks;
use graintrain_ccp::solver::ranks::Transport;
use graintrain_io::checkpoint;
use graintrain_io::run::{RunSettings, RunTotals};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::num::NonZeroUsize;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The processes that carry a command out, as one of them sees them.
pub struct Crew {
    /// What signals to this process ask for.
    pub stop: Stop,
    ranks: Option<Arc<Ranks>>,
}

impl Crew {
    /// This process alone.
    ///
    /// # Errors
    /// Where signals cannot be handled.
    pub fn alone() -> Result<Self, Failure> {
        Ok(Self { stop: Stop::listen()?, ranks: None })
    }

    /// One of several ranks; all but the first one are silent from now on.
    ///
    /// # Errors
    /// Where signals cannot be handled.
    pub fn of_ranks(transport: Box<dyn Transport>) -> Result<Self, Failure> {
        if transport.rank() > 0 {
            terminal::keep_silent(true);
        }
        let stop = Stop::listen()?;
        let ranks = Ranks::new(transport, Arc::clone(&stop.requested));
        Ok(Self { stop, ranks: Some(Arc::new(ranks)) })
    }

    /// The ranks, where there are several processes.
    pub fn ranks(&self) -> Option<&Arc<Ranks>> {
        self.ranks.as_ref()
    }

    /// Whether this process is the one that writes.
    pub fn writes(&self) -> bool {
        self.ranks.as_ref().is_none_or(|ranks| ranks.rank() == 0)
    }

    /// The flag that ends a run: on all ranks at once.
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        self.ranks.as_ref().map_or_else(|| Arc::clone(&self.stop.requested), |ranks| ranks.stop())
    }

    /// Threads of each process where nobody says how many: all processors for one process, one for each of
    /// several.
    pub fn threads(&self, asked: Option<NonZeroUsize>) -> Option<NonZeroUsize> {
        asked.or(self.ranks.as_ref().map(|_| NonZeroUsize::MIN))
    }

    /// What has become of all ranks: where one of them has failed, all have. The first that failed tells why.
    ///
    /// # Errors
    /// The failure of this rank, or that of another one ([`Failure::Reported`]).
    pub fn agree<T>(&self, own: Result<T, Failure>) -> Result<T, Failure> {
        let Some(ranks) = &self.ranks else { return own };
        let codes = ranks.numbers(own.as_ref().err().map_or(0, |failure| u64::from(failure.code())));
        let Some(first) = codes.iter().position(|code| *code != 0) else { return own };
        match own {
            Err(failure) if first == ranks.rank() => {
                terminal::keep_silent(false);
                if first > 0 {
                    terminal::tell!("rank {first} of {}:", ranks.count());
                }
                Err(failure)
            }
            _ => Err(Failure::Reported(codes[first] as u8)),
        }
    }

    /// That all ranks are to make the same steps from the same state: else they would wait for each other in
    /// different places.
    ///
    /// # Errors
    /// Where one is not.
    pub fn agree_on(&self, settings: &RunSettings, world: &World) -> Result<(), Failure> {
        let Some(ranks) = &self.ranks else { return Ok(()) };
        let described = checkpoint::to_bytes(settings, &RunTotals::default(), world);
        let bytes = self.agree(described.map_err(|error| Failure::work_error(error, "")))?;
        let mut hasher = DefaultHasher::new();
        (env!("CARGO_PKG_VERSION"), bytes).hash(&mut hasher);
        let all = ranks.numbers(hasher.finish());
        let other = all.iter().position(|hash| *hash != all[0]);
        self.agree(other.map_or(Ok(()), |rank| {
            let what = format!("rank {rank} of {} was asked for another run than rank 0", ranks.count());
            let remedy = "give every rank the same program, the same files and the same options";
            Err(Failure::input_error(std::io::Error::other(what), remedy))
        }))
    }

    /// Exit code of a run that was stopped: where one rank was asked to, all tell.
    pub fn stopped(&self) -> ExitCode {
        let own = self.stop.code();
        let all = self.ranks.as_ref().map(|ranks| ranks.numbers(u64::from(own)));
        ExitCode::from(all.into_iter().flatten().max().map_or(own, |code| code as u8))
    }

    /// A failure that other ranks do not know of, since they are in the middle of a step: it is reported, and
    /// all of them end.
    pub fn abandon(&self, failure: Failure) -> Failure {
        let Some(ranks) = &self.ranks else { return failure };
        terminal::keep_silent(false);
        failure.report();
        ranks.abort(i32::from(failure.code()))
    }
}
