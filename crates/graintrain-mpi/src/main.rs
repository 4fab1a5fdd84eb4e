//! The program `graintrain-mpi`: `mpirun -n 4 graintrain-mpi run SCENE` is `graintrain run SCENE` by four
//! processes.

mod transport;

use ferrompi::{Mpi, ThreadLevel};
use std::process::ExitCode;
use std::sync::Arc;
use transport::MpiTransport;

fn main() -> ExitCode {
    // One thread at a time talks, but not always the same one: steps are made in a pool of threads.
    let mpi = match Mpi::init_thread(ThreadLevel::Serialized) {
        Ok(mpi) => mpi,
        Err(error) => return refuse(&format!("MPI does not start: {error}")),
    };
    if mpi.thread_level() < ThreadLevel::Serialized {
        return refuse(
            "this MPI lets only the first thread of a process talk; graintrain needs MPI_THREAD_SERIALIZED",
        );
    }
    let world = Arc::new(mpi.world());
    end_together_on_panic(&world);
    let transport = MpiTransport::new(Arc::clone(&world));
    graintrain_cli::run_on_ranks(std::env::args_os(), Box::new(transport))
}

fn refuse(why: &str) -> ExitCode {
    eprintln!("error: {why}");
    ExitCode::from(2)
}

/// The others would wait for ever for a rank that has panicked.
fn end_together_on_panic(world: &Arc<ferrompi::Communicator>) {
    let (world, usual) = (Arc::clone(world), std::panic::take_hook());
    std::panic::set_hook(Box::new(move |panic| {
        eprintln!("rank {} of {} panicked; all ranks end:", world.rank(), world.size());
        usual(panic);
        world.abort(101);
    }));
}
