//! Tries altered inputs for a while: `cargo run -p graintrain-fuzz -- --help`.

use cap::Cap;
use clap::Parser;
use graintrain_fuzz::alter::{Draw, altered};
use graintrain_fuzz::{TARGETS, Target};
use std::alloc::System;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, abort};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Most bytes that an input may take.
const MOST_BYTES: usize = 512 << 20;
/// Longest time that it may take.
const MOST_TIME: Duration = Duration::from_secs(5);

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, MOST_BYTES);

/// Try altered files on everything that graintrain reads. Ends with an error at the first panic, at an input
/// that takes over 5 s, and at one that takes over 512 MB: it is then in target/fuzz/TARGET/last
#[derive(Parser)]
struct Arguments {
    /// What is to read: scene, problem, packing, mesh, checkpoint, frame, robot; all where none is named
    #[arg(value_name = "TARGET", value_parser = target)]
    targets: Vec<&'static Target>,
    /// Time for each target
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0)]
    seconds: f64,
    /// Other inputs for other seeds
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Number of the first input: to go on behind one that was found
    #[arg(long, value_name = "N", default_value_t = 0)]
    first: u64,
    /// Try this file alone, on the one target that is named
    #[arg(long, value_name = "FILE")]
    input: Option<PathBuf>,
    /// Write the seeds into fuzz/corpus/TARGET, for `cargo fuzz`
    #[arg(long)]
    write_seeds: bool,
    /// Try the target that is named in this process, which whoever started it watches
    #[arg(long, hide = true)]
    here: bool,
}

fn target(name: &str) -> Result<&'static Target, String> {
    let names: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
    TARGETS.iter().find(|target| target.name == name).ok_or_else(|| format!("known are {}", names.join(", ")))
}

fn main() -> std::io::Result<ExitCode> {
    let arguments = Arguments::parse();
    let targets =
        if arguments.targets.is_empty() { TARGETS.iter().collect() } else { arguments.targets.clone() };
    if arguments.write_seeds {
        targets.into_iter().try_for_each(write_seeds)?;
        return Ok(ExitCode::SUCCESS);
    }
    match (targets.as_slice(), &arguments.input) {
        ([target], Some(input)) => try_file(target, input)?,
        (_, Some(_)) => {
            eprintln!("--input needs the name of one target");
            return Ok(ExitCode::from(2));
        }
        ([target], None) if arguments.here => try_inputs(target, &arguments)?,
        _ => {
            // A process each: one that ends badly keeps none from its turn.
            let outcomes: Vec<bool> =
                targets.into_iter().map(|target| supervised(target, &arguments)).collect::<Result<_, _>>()?;
            return Ok(if outcomes.contains(&false) { ExitCode::FAILURE } else { ExitCode::SUCCESS });
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The folder of what is written about a target.
fn folder(target: &Target) -> PathBuf {
    let default = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../target");
    let folder = std::env::var_os("CARGO_TARGET_DIR").map_or_else(default, PathBuf::from);
    folder.join("fuzz").join(target.name)
}

fn write_seeds(target: &Target) -> std::io::Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target.name);
    std::fs::create_dir_all(&folder)?;
    (target.seeds)()
        .iter()
        .enumerate()
        .try_for_each(|(number, seed)| std::fs::write(folder.join(number.to_string()), seed))
}

/// Tries a target in a process of its own; whether that ended well.
fn supervised(target: &Target, arguments: &Arguments) -> std::io::Result<bool> {
    let numbers = [arguments.seconds.to_string(), arguments.seed.to_string(), arguments.first.to_string()];
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["--here", target.name]);
    for (name, number) in ["--seconds", "--seed", "--first"].iter().zip(numbers) {
        command.args([name.to_string(), number]);
    }
    let status = command.status()?;
    if !status.success() {
        let (folder, name) = (folder(target), target.name);
        let number = std::fs::read_to_string(folder.join("number"))?;
        println!("{name}: {status} at input {number}, which is in {}", folder.join("last").display());
    }
    Ok(status.success())
}

/// Ends the process where an input takes too long; a panic ends it, whoever would catch it.
struct Watch {
    begin: Instant,
    /// Milliseconds since then at which the input was begun.
    since: Arc<AtomicU64>,
}

impl Watch {
    fn begin() -> Self {
        let (begin, since) = (Instant::now(), Arc::new(AtomicU64::new(0)));
        let reported = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            reported(info);
            abort();
        }));
        let watched = Arc::clone(&since);
        std::thread::spawn(move || {
            loop {
                std::thread::sleep(Duration::from_millis(50));
                let since = Duration::from_millis(watched.load(Ordering::Relaxed));
                if begin.elapsed().saturating_sub(since) > MOST_TIME {
                    eprintln!("an input takes over {MOST_TIME:?}");
                    abort();
                }
            }
        });
        Self { begin, since }
    }

    fn next(&self) {
        self.since.store(self.begin.elapsed().as_millis() as u64, Ordering::Relaxed);
    }
}

fn try_file(target: &Target, path: &Path) -> std::io::Result<()> {
    let input = std::fs::read(path)?;
    // What a target makes once is none of the input's time.
    (target.seeds)();
    Watch::begin();
    let start = Instant::now();
    let accepted = (target.run)(&input);
    println!("{} in {:.3} s", if accepted { "accepted" } else { "refused" }, start.elapsed().as_secs_f64());
    Ok(())
}

fn try_inputs(target: &Target, arguments: &Arguments) -> std::io::Result<()> {
    let folder = folder(target);
    std::fs::create_dir_all(&folder)?;
    let (seeds, words, last) = ((target.seeds)(), (target.words)(), folder.join("last"));
    let watch = Watch::begin();
    let (mut accepted, mut number) = (0_u64, arguments.first);
    let (start, mut slowest, mut peak) = (Instant::now(), Duration::ZERO, MEMORY.max_allocated());
    while start.elapsed().as_secs_f64() < arguments.seconds {
        // The seeds themselves come first.
        let input = match seeds.get(number as usize) {
            Some(seed) => seed.clone(),
            None => altered(&seeds, &words, &mut Draw::new(arguments.seed, number)),
        };
        std::fs::write(&last, &input)?;
        std::fs::write(folder.join("number"), number.to_string())?;
        watch.next();
        let begin = Instant::now();
        accepted += u64::from((target.run)(&input));
        if begin.elapsed() > slowest {
            slowest = begin.elapsed();
            std::fs::write(folder.join("slowest"), &input)?;
        }
        if MEMORY.max_allocated() > peak {
            peak = MEMORY.max_allocated();
            std::fs::write(folder.join("largest"), &input)?;
        }
        number += 1;
    }
    println!(
        "{}: {} inputs, {accepted} accepted, slowest {:.3} s, peak {} MB",
        target.name,
        number - arguments.first,
        slowest.as_secs_f64(),
        MEMORY.max_allocated().div_ceil(1 << 20)
    );
    Ok(())
}
