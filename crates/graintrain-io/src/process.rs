//! What the process has used so far.

/// Processor seconds of all threads; `None` where the system does not tell.
pub fn cpu_seconds() -> Option<f64> {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        Some(time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64)
    }
    #[cfg(not(unix))]
    None
}

/// Largest resident memory so far, bytes; `None` where the system does not tell (it is read from Linux's
/// `/proc`).
pub fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(1024 * kibibytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_takes_time_and_memory() {
        let (Some(start), Some(_)) = (cpu_seconds(), peak_memory_bytes()) else { return };
        let work: Vec<f64> = (0..4_000_000).map(|i| f64::from(i).sqrt()).collect();
        assert!(work.iter().sum::<f64>() > 0.0);
        assert!(cpu_seconds().unwrap() > start);
        assert!(peak_memory_bytes().unwrap() > 32_000_000);
    }
}
