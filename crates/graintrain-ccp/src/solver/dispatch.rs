//! The choice of the processor's vector instructions at run time.

#[cfg(target_arch = "x86_64")]
use super::avx2;
use super::lanes::{Lanes, TaskWork};

/// Runs the work with the vectors of this processor; the bits are the same with all of them.
#[inline(always)]
pub fn vectorised(work: impl TaskWork) {
    #[cfg(target_arch = "x86_64")]
    let Err(work) = avx2::run(work) else { return };
    work.run::<Lanes>();
}
