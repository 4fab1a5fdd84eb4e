//! One solve in a process of its own.

use crate::Failure;
use crate::assemblies::ASSEMBLIES;
use graintrain::ccp::{Ccp, SolveReport, SolveSettings, SolverSpec, Status};
use graintrain_io::problem_file;
use graintrain_io::process::{cpu_seconds, peak_memory_bytes};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The paper's tolerance.
pub const TOLERANCE: f64 = 1e-4;

/// What a solve took.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Measured {
    pub problem: String,
    pub contacts: usize,
    pub solver: String,
    /// `None` where the process was killed.
    pub status: Option<Status>,
    /// Outer iterations; inner iterations of all of them.
    pub iterations: usize,
    pub inner: usize,
    /// Processor seconds.
    pub precompute: f64,
    pub apply: f64,
    pub seconds: f64,
    /// Peak memory beyond that of the problem, MiB.
    pub memory: f64,
    pub residual: f64,
    /// Largest condition estimate of a Newton matrix.
    pub condition: f64,
    /// Figures of the linear solver, averaged over the Newton iterations.
    pub figures: BTreeMap<String, f64>,
}

impl Measured {
    pub fn converged(&self) -> bool {
        self.status == Some(Status::Converged)
    }

    /// A report in processor time.
    pub fn new(problem: &str, contacts: usize, report: &SolveReport, seconds: f64, memory: f64) -> Self {
        let records = &report.newton;
        let scale = seconds / report.seconds.max(1e-9);
        let mut figures: BTreeMap<String, (f64, f64)> = BTreeMap::new();
        for (name, value) in records.iter().flat_map(|record| &record.figures) {
            let (sum, count) = figures.entry(name.clone()).or_default();
            *sum += value;
            *count += 1.0;
        }
        Self {
            problem: problem.to_string(),
            contacts,
            solver: report.solver.clone(),
            status: Some(report.status),
            iterations: report.iterations,
            inner: report.linear_iterations,
            precompute: scale * records.iter().map(|record| record.precompute_seconds).sum::<f64>(),
            apply: scale * records.iter().map(|record| record.apply_seconds).sum::<f64>(),
            seconds,
            memory,
            residual: report.residual.max,
            condition: records.iter().map(|record| record.condition).fold(0.0, f64::max),
            figures: figures.into_iter().map(|(name, (sum, count))| (name, sum / count)).collect(),
        }
    }
}

/// The problem of a file or of an assembly.
pub fn problem(name: &str) -> Result<Ccp, Failure> {
    let mut parts = name.split(':');
    let assembly = parts.next().and_then(|first| ASSEMBLIES.iter().find(|(name, _)| *name == first));
    let Some((_, assembly)) = assembly else { return Ok(problem_file::read(Path::new(name))?.problem) };
    let bodies: usize = parts.next().ok_or("an assembly needs its number of bodies")?.parse()?;
    let disorder: f64 = parts.next().map_or(Ok(0.0), str::parse)?;
    let seed: u64 = parts.next().map_or(Ok(1), str::parse)?;
    Ok(assembly.problem(bodies, disorder, seed))
}

/// Processor seconds so far, wall-clock ones where the system does not tell.
pub fn clock(start: Instant) -> f64 {
    cpu_seconds().unwrap_or_else(|| start.elapsed().as_secs_f64())
}

/// Settings of every solve. The limit is one of processor time: a thread of its own watches the clock and
/// asks to stop.
pub fn settings(limit: f64) -> SolveSettings {
    let stop = Arc::new(AtomicBool::new(false));
    let watched = Arc::downgrade(&stop);
    std::thread::spawn(move || {
        let start = Instant::now();
        let begun = clock(start);
        while let Some(stop) = watched.upgrade() {
            if clock(start) - begun > limit {
                stop.store(true, Ordering::Relaxed);
                return;
            }
            drop(stop);
            std::thread::sleep(Duration::from_millis(20));
        }
    });
    SolveSettings { tolerance: TOLERANCE, stop: Some(stop), ..SolveSettings::default() }
}

/// Solves and prints the figures as JSON.
pub fn child(name: &str, solver: &str, limit: f64) -> Result<(), Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| {
        let problem = problem(name)?;
        let memory = || peak_memory_bytes().unwrap_or(0) as f64 / f64::powi(2.0, 20);
        let mut impulse = vec![0.0; 3 * problem.num_contacts()];
        let mut method = solver.parse::<SolverSpec>()?.build()?;
        let (before, start) = (memory(), Instant::now());
        let begun = clock(start);
        let report = method.solve(&problem, &mut impulse, &settings(limit))?;
        let seconds = clock(start) - begun;
        let measured = Measured::new(name, problem.num_contacts(), &report, seconds, memory() - before);
        println!("{}", serde_json::to_string(&Measured { solver: solver.to_string(), ..measured })?);
        Ok(())
    })
}

/// Wall-clock seconds, per processor second of the limit, after which a process is killed; a linear solve
/// cannot be interrupted.
const PATIENCE: f64 = 12.0;

/// Solves in a process of its own.
pub fn measure(name: &str, solver: &str, limit: f64) -> Result<Measured, Failure> {
    let mut process = Command::new(std::env::current_exe()?)
        .args(["one", &limit.to_string(), solver, name])
        .stdout(Stdio::piped())
        .spawn()?;
    let start = Instant::now();
    while process.try_wait()?.is_none() {
        if start.elapsed().as_secs_f64() > PATIENCE * limit + 60.0 {
            process.kill()?;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let output = process.wait_with_output()?;
    let text = String::from_utf8_lossy(&output.stdout);
    if output.status.success() {
        return Ok(serde_json::from_str(text.trim())?);
    }
    Ok(Measured {
        problem: name.to_string(),
        contacts: 0,
        solver: solver.to_string(),
        status: None,
        iterations: 0,
        inner: 0,
        precompute: f64::NAN,
        apply: f64::NAN,
        seconds: limit,
        memory: f64::NAN,
        residual: f64::NAN,
        condition: f64::NAN,
        figures: BTreeMap::new(),
    })
}
