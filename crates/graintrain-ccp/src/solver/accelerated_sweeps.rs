//! `apgs`: projected Gauss-Seidel with Nesterov's momentum.

use super::first_order::{FirstOrderMethod, Iterate};
use super::gauss_seidel::{Steps, sweep};
use super::momentum::{Memory, Momentum};
use super::scaling::ScaledProblem;
use super::single::SingleIterate;

/// Sweeps of [`GaussSeidel`](super::GaussSeidel) from extrapolated points:
///
/// ```text
/// x+ = S(y),   y+ = x+ + beta (x+ - x),   d = x+ - y
/// ```
///
/// with the momentum of [`Memory`] and without over-relaxation. A sweep S is a projected gradient step in the
/// metric of the lower triangle of N', which is nearer to N' than a multiple of the unit matrix: among balls
/// it needs about half of the iterations of [`Apgd`](super::Apgd), among boxes on boxes five times as many.
/// Acceleration is proved for symmetric sweeps (forward and back) alone; forward ones need half as many. An
/// iteration moves as much memory as one of `Apgd`; in single precision threads share it in blocks of
/// contacts, in double precision one thread does it.
///
/// Sources: B. O'Donoghue, E. Candes, "Adaptive restart for accelerated gradient schemes", Foundations of
/// Computational Mathematics 15:715-732, 2015; a conjugate direction over sweeps: M. Silcowitz-Hansen, S.
/// Niebe, K. Erleben, "A nonsmooth nonlinear conjugate gradient method for interactive contact force
/// problems", The Visual Computer 26:893-901, 2010.
#[derive(Clone, Debug, Default)]
pub struct AcceleratedSweeps {
    /// The limit that the last iterations ended with.
    found: Option<f64>,
}

/// How long the momentum lasts.
pub(super) const MEMORY: Memory =
    Memory { first: 30.0, longer: 1.2, shorter: 0.7, range: [5.0, 3000.0], young: 3.0 };

impl FirstOrderMethod for AcceleratedSweeps {
    const NAME: &'static str = "apgs";
    const EXACT: bool = true;
    const TURNING: bool = true;
    const SINGLE: bool = true;
    const SWEEPS: bool = true;

    fn remember(&mut self, memory: Option<f64>) {
        self.found = memory;
    }

    fn memory(&self) -> Option<f64> {
        self.found
    }

    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        let steps = Steps::of(scaled, 1.0);
        let mut momentum = Momentum::new(&MEMORY, self.found);
        sweep(scaled, it, &steps, |[length, along]| momentum.next(length.sqrt(), along));
        self.found = Some(momentum.limit);
    }

    fn run_single(&mut self, it: &mut SingleIterate<'_>) {
        let mut momentum = Momentum::new(&MEMORY, self.found);
        it.sweep(1.0, |[length, along]| momentum.next(length.sqrt(), along));
        self.found = Some(momentum.limit);
    }
}
