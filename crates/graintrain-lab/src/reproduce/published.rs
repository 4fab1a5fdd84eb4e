//! What the paper prints: Corona, Gorsich, Jayakumar, Veerapaneni, Appl. Mech. Rev. 71(5), 2019 (arXiv
//! 1808.02558), sections 4.1 and 4.2, all for spheres with R = 0.1, mu = 0.25, dt = 0.025 s, PDIP tolerance
//! 1e-4, BICGSTAB, one core.

/// Accuracies of the rows of tables 3 and 4.
pub const ACCURACIES: [f64; 3] = [1e-2, 1e-3, 1e-4];

/// Rank caps of the columns of tables 3 and 4.
pub const RANK_CAPS: [usize; 3] = [10, 100, 1000];

/// Table 3: mean ranks of the trains of S and S^-1, rows [`ACCURACIES`], columns [`RANK_CAPS`].
pub const RANKS: [[[f64; 2]; 3]; 3] = [
    [[4.6, 4.4], [10.5, 6.7], [10.5, 6.7]],
    [[8.7, 8.5], [59.3, 45.2], [65.2, 46.4]],
    [[9.1, 9.0], [68.6, 58.1], [113.3, 91.2]],
];

/// Table 4: seconds of compression and inversion, laid out like [`RANKS`].
pub const SECONDS: [[f64; 3]; 3] = [[10.0, 25.0, 25.0], [16.0, 1244.0, 1317.0], [16.0, 2740.0, 8157.0]];

/// Figure 8: factor by which re-use makes the precomputation of a whole step cheaper.
pub const REUSE_FACTOR: [f64; 2] = [10.0, 15.0];

/// Figure 10: contacts from which the tensor train beats ILU, and by what factor at the largest sizes.
pub const CROSSOVER_CONTACTS: f64 = 20_000.0;

/// Figure 10: factor between ILU and the tensor train at the end of the larger experiments.
pub const FINAL_SPEEDUP: f64 = 10.0;

/// Figure 15: the same factor in drafting and direct shear.
pub const FINAL_SPEEDUP_OTHERS: [f64; 2] = [5.0, 10.0];

/// Figure 11: seconds of tensor-train precomputation per step.
pub const PRECOMPUTE_SECONDS: [f64; 2] = [5.0, 15.0];

/// Section 4.2.1: factorisations, that is Newton iterations, per step.
pub const FACTORISATIONS: [f64; 2] = [50.0, 100.0];

/// Figure 12: BICGSTAB iterations with ILU over those with the tensor train, at most.
pub const ITERATION_RATIO: f64 = 8.0;

/// Figure 12: iterations at which the unpreconditioned solver was stopped.
pub const ITERATION_CAP: f64 = 1000.0;

/// Section 3.3: part of the contacts that persists from step to step, once settled.
pub const PERSISTENCE: f64 = 0.9;
