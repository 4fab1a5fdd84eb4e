//! Physical outputs of the simulations.

use super::Results;
use super::trajectory::{Experiment, Row, Trajectory, Variant};

/// A mean over part of a simulation with the standard error of the mean from blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steady {
    /// Mean.
    pub mean: f64,
    /// Standard error, from eight blocks of consecutive steps (their values are correlated).
    pub error: f64,
}

impl Steady {
    /// Of consecutive values; `None` for fewer than eight.
    pub fn of(values: &[f64]) -> Option<Self> {
        const BLOCKS: usize = 8;
        if values.len() < BLOCKS {
            return None;
        }
        let mean_of = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let blocks: Vec<f64> = (0..BLOCKS)
            .map(|k| mean_of(&values[k * values.len() / BLOCKS..(k + 1) * values.len() / BLOCKS]))
            .collect();
        let mean = mean_of(values);
        let spread = blocks.iter().map(|block| (block - mean).powi(2)).sum::<f64>() / (BLOCKS - 1) as f64;
        Some(Self { mean, error: (spread / BLOCKS as f64).sqrt() })
    }

    /// The mean of independent means; `None` for none. The standard error is that of the spread among them where there are
    /// three or more; two say too little of a spread, so that their own errors add in squares.
    pub fn over(independent: impl Iterator<Item = Self>) -> Option<Self> {
        let all: Vec<Self> = independent.collect();
        let count = all.len() as f64;
        let mean = all.iter().map(|steady| steady.mean).sum::<f64>() / count;
        let error = match all.len() {
            0 => return None,
            1 | 2 => all.iter().map(|steady| steady.error.powi(2)).sum::<f64>().sqrt() / count,
            _ => {
                let squares = all.iter().map(|steady| (steady.mean - mean).powi(2)).sum::<f64>();
                (squares / (count - 1.0) / count).sqrt()
            }
        };
        Some(Self { mean, error })
    }
}

/// The experiment's force, along the direction that resists the tool: drag of the blade (N), shear force on the lower half
/// (N), torque of the mixer (N m).
pub fn resistance(experiment: Experiment, row: &Row) -> f64 {
    match experiment {
        Experiment::Sedimentation => -row.torque[2],
        Experiment::Drafting | Experiment::DirectShear => -row.force[0],
    }
}

/// Rows in which the tool moves forwards with at least half its largest speed; for the mixer the second half of the
/// simulation.
pub fn steady_rows(experiment: Experiment, trajectory: &Trajectory) -> &[Row] {
    let rows = &trajectory.rows;
    if experiment == Experiment::Sedimentation {
        return &rows[rows.len() / 2..];
    }
    let fastest = rows.iter().map(|row| row.velocity[0]).fold(0.0, f64::max);
    let first =
        rows.iter().position(|row| fastest > 0.0 && row.velocity[0] >= 0.5 * fastest).unwrap_or(rows.len());
    let count = rows[first..].iter().take_while(|row| row.velocity[0] >= 0.5 * fastest).count();
    &rows[first..first + count]
}

/// Steady force of an experiment.
pub fn steady(experiment: Experiment, trajectory: &Trajectory) -> Option<Steady> {
    let rows = steady_rows(experiment, trajectory);
    Steady::of(&rows.iter().map(|row| resistance(experiment, row)).collect::<Vec<_>>())
}

/// Steady force of an experiment, averaged over the perturbations of the lattice.
pub fn steady_over_seeds(results: &Results, experiment: Experiment, variant: Variant) -> Option<Steady> {
    Steady::over(results.seeds(experiment, variant).into_iter().filter_map(|t| steady(experiment, t)))
}

/// [`friction_ratio`], averaged over the perturbations of the lattice.
pub fn friction_ratio_over_seeds(results: &Results, variant: Variant) -> Option<Steady> {
    Steady::over(results.seeds(Experiment::DirectShear, variant).into_iter().filter_map(friction_ratio))
}

/// Ratio of shear force to normal force on the lower half while it moves.
pub fn friction_ratio(trajectory: &Trajectory) -> Option<Steady> {
    let rows = steady_rows(Experiment::DirectShear, trajectory);
    Steady::of(&rows.iter().map(|row| row.force[0] / row.force[2]).collect::<Vec<_>>())
}

/// Displacement of the tool along x from its start, m.
pub fn displacement(trajectory: &Trajectory) -> Vec<f64> {
    let start = trajectory.rows.first().map_or(0.0, |row| row.place[0]);
    trajectory.rows.iter().map(|row| row.place[0] - start).collect()
}

/// Rise of the press since the tool started to move, m, by displacement of the tool.
pub fn dilation(trajectory: &Trajectory) -> Vec<[f64; 2]> {
    let moving = trajectory.rows.iter().position(|row| row.velocity[0].abs() > 0.0).unwrap_or(0);
    let displacement = displacement(trajectory);
    let start = trajectory.rows.get(moving).and_then(|row| row.press).unwrap_or(0.0);
    let rows = trajectory.rows.iter().zip(displacement).skip(moving);
    rows.filter_map(|(row, x)| row.press.map(|height| [x, height - start])).collect()
}

/// A steady force in two simulations.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensitivity {
    /// Which experiment.
    pub experiment: Experiment,
    /// What was changed.
    pub variant: Variant,
    /// As in the paper.
    pub paper: Steady,
    /// With the change.
    pub changed: Steady,
}

impl Sensitivity {
    /// Relative change.
    pub fn change(&self) -> f64 {
        self.changed.mean / self.paper.mean - 1.0
    }

    /// Standard error of the relative change.
    pub fn uncertainty(&self) -> f64 {
        (self.paper.error.powi(2) + self.changed.error.powi(2)).sqrt() / self.paper.mean.abs()
    }
}

/// All changes that were simulated.
pub fn sensitivities(results: &Results) -> Vec<Sensitivity> {
    let mut found = Vec::new();
    for experiment in Experiment::ALL {
        for variant in [Variant::HalfStep, Variant::TenthTolerance, Variant::Coulomb] {
            let force = |variant| steady_over_seeds(results, experiment, variant);
            if let (Some(paper), Some(changed)) = (force(Variant::Paper), force(variant)) {
                found.push(Sensitivity { experiment, variant, paper, changed });
            }
        }
    }
    found
}
