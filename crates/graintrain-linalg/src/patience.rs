//! How long a computation may still go on: a deadline, and a flag that somebody else sets (Ctrl-C).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Asked by long loops once per turn. The default never ends.
///
/// ```
/// use graintrain_linalg::patience::Patience;
/// use std::time::{Duration, Instant};
/// assert!(!Patience::default().is_over());
/// assert!(Patience::new(Some(Instant::now()), None).is_over());
/// assert!(!Patience::new(Some(Instant::now() + Duration::from_secs(3600)), None).is_over());
/// ```
#[derive(Clone, Debug, Default)]
pub struct Patience {
    deadline: Option<Instant>,
    stop: Option<Arc<AtomicBool>>,
}

impl Patience {
    /// Until the deadline, or until the flag is set.
    pub fn new(deadline: Option<Instant>, stop: Option<Arc<AtomicBool>>) -> Self {
        Self { deadline, stop }
    }

    /// Whether to stop now.
    pub fn is_over(&self) -> bool {
        self.stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed))
            || self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }
}
