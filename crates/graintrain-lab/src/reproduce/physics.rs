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
    /// Mean of consecutive values; `None` for fewer than eight.
    pub fn of(values: &[f64]) -> Option<Self> {
        Self::of_blocks(values, mean)
    }

    /// Median of consecutive values, for quantities with rare peaks that would rule the mean; `None` for
    /// fewer than eight.
    pub fn median_of(values: &[f64]) -> Option<Self> {
        Self::of_blocks(values, median)
    }

    /// A statistic of consecutive samples with its standard error from eight blocks; `None` for fewer than
    /// eight samples.
    fn of_blocks<T>(samples: &[T], statistic: impl Fn(&[T]) -> f64) -> Option<Self> {
        const BLOCKS: usize = 8;
        if samples.len() < BLOCKS {
            return None;
        }
        let blocks = (0..BLOCKS)
            .map(|k| statistic(&samples[k * samples.len() / BLOCKS..(k + 1) * samples.len() / BLOCKS]));
        Some(Self { mean: statistic(samples), error: standard_error(&blocks.collect::<Vec<f64>>()) })
    }

    /// The mean of independent means; `None` for none. The standard error is that of the spread among them
    /// where there are three or more; two say too little of a spread, so that their own errors add in
    /// squares.
    pub fn over(independent: impl Iterator<Item = Self>) -> Option<Self> {
        let all: Vec<Self> = independent.collect();
        let count = all.len() as f64;
        let mean = all.iter().map(|steady| steady.mean).sum::<f64>() / count;
        let error = match all.len() {
            0 => return None,
            1 | 2 => all.iter().map(|steady| steady.error.powi(2)).sum::<f64>().sqrt() / count,
            _ => standard_error(&all.iter().map(|steady| steady.mean).collect::<Vec<f64>>()),
        };
        Some(Self { mean, error })
    }
}

/// Mean of values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Median of values, NaN for none.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = [sorted.len().saturating_sub(1) / 2, sorted.len() / 2];
    middle.iter().map(|&k| sorted.get(k).copied().unwrap_or(f64::NAN)).sum::<f64>() / 2.0
}

/// Standard error of the mean of independent values: the root of sum (x - mean)^2 / (k (k - 1)).
fn standard_error(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = mean(values);
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count * (count - 1.0))).sqrt()
}

/// The experiment's force, along the direction that resists the tool: drag of the blade (N), shear force on
/// the lower half (N), torque of the mixer (N m).
pub fn resistance(experiment: Experiment, row: &Row) -> f64 {
    match experiment {
        Experiment::Sedimentation => -row.torque[2],
        Experiment::Drafting | Experiment::DirectShear => -row.force[0],
    }
}

/// Part of its way that a tool has made before its force counts as steady.
pub const MOBILISED: f64 = 1.0 / 3.0;

/// Rows in which the tool, on its way forwards, has made a third of it and still has half its largest speed;
/// for the mixer the second half of the simulation.
pub fn steady_rows(experiment: Experiment, trajectory: &Trajectory) -> &[Row] {
    let rows = &trajectory.rows;
    if experiment == Experiment::Sedimentation {
        return &rows[rows.len() / 2..];
    }
    let fastest = rows.iter().map(|row| row.velocity[0]).fold(0.0, f64::max);
    let displacement = displacement(trajectory);
    let way = displacement.iter().copied().fold(0.0, f64::max);
    let fast = |row: &Row| fastest > 0.0 && row.velocity[0] >= 0.5 * fastest;
    let begins = |k: usize| fast(&rows[k]) && displacement[k] >= MOBILISED * way;
    let first = (0..rows.len()).find(|&k| begins(k)).unwrap_or(rows.len());
    let count = rows[first..].iter().take_while(|row| fast(row)).count();
    &rows[first..first + count]
}

/// Steady force of an experiment; of the mixer's torque the median, since a grain caught between blade and
/// wall raises it a hundredfold for a step.
pub fn steady(experiment: Experiment, trajectory: &Trajectory) -> Option<Steady> {
    let rows = steady_rows(experiment, trajectory);
    let values: Vec<f64> = rows.iter().map(|row| resistance(experiment, row)).collect();
    if experiment == Experiment::Sedimentation { Steady::median_of(&values) } else { Steady::of(&values) }
}

/// By how much the mean force of the second half of the steady rows exceeds that of the first, relative to
/// both; `None` for fewer than eight rows. A force that is steady has no trend.
pub fn trend(experiment: Experiment, trajectory: &Trajectory) -> Option<f64> {
    let rows = steady_rows(experiment, trajectory);
    let (early, late) = rows.split_at(rows.len() / 2);
    let [early, late] = [early, late]
        .map(|rows| rows.iter().map(|row| resistance(experiment, row)).sum::<f64>() / rows.len() as f64);
    (rows.len() >= 8).then(|| 2.0 * (late - early) / (late + early))
}

/// [`trend`], averaged over the perturbations of the lattice.
pub fn trend_over_seeds(results: &Results, experiment: Experiment, variant: Variant) -> Option<f64> {
    let seeds = results.seeds(experiment, variant);
    let trends: Vec<f64> = seeds.into_iter().filter_map(|(_, t)| trend(experiment, t)).collect();
    (!trends.is_empty()).then(|| mean(&trends))
}

/// Steady force of an experiment, averaged over the perturbations of the lattice.
pub fn steady_over_seeds(results: &Results, experiment: Experiment, variant: Variant) -> Option<Steady> {
    Steady::over(results.seeds(experiment, variant).into_iter().filter_map(|(_, t)| steady(experiment, t)))
}

/// [`friction_ratio`], averaged over the perturbations of the lattice.
pub fn friction_ratio_over_seeds(results: &Results, variant: Variant) -> Option<Steady> {
    let shears = results.seeds(Experiment::DirectShear, variant);
    Steady::over(shears.into_iter().filter_map(|(_, t)| friction_ratio(t)))
}

/// Ratio of shear force to normal force on the plane between the halves of the shear box, sum of the one over
/// sum of the other in the steady rows. The lower half carries N + W, N the force through the plane and W the
/// weight of the grains below it.
pub fn friction_ratio(trajectory: &Trajectory) -> Option<Steady> {
    let rows = steady_rows(Experiment::DirectShear, trajectory);
    let samples: Vec<[f64; 2]> = rows
        .iter()
        .filter_map(|row| Some([resistance(Experiment::DirectShear, row), -row.force[2] - row.weight_below?]))
        .collect();
    let ratio = |samples: &[[f64; 2]]| {
        let [shear, normal] = samples.iter().fold([0.0; 2], |sum, s| [sum[0] + s[0], sum[1] + s[1]]);
        shear / normal
    };
    Steady::of_blocks(&samples, ratio)
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

/// A steady force with and without a change.
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
    /// Relative change, with its standard error: of the changes of single lattices where three or more have
    /// both simulations, otherwise of the two forces.
    pub change: Steady,
    /// Lattices that have both simulations.
    pub pairs: usize,
}

impl Sensitivity {
    /// From the simulations of one experiment, by the seeds of their lattices; `None` without a lattice that
    /// has both.
    pub fn of(
        experiment: Experiment,
        variant: Variant,
        paper: &[(u64, Steady)],
        changed: &[(u64, Steady)],
    ) -> Option<Self> {
        let of_seed = |seed: u64| changed.iter().find(|(other, _)| *other == seed).map(|(_, steady)| *steady);
        let pairs: Vec<[Steady; 2]> =
            paper.iter().filter_map(|&(seed, steady)| Some([steady, of_seed(seed)?])).collect();
        let before = Steady::over(pairs.iter().map(|pair| pair[0]))?;
        let after = Steady::over(pairs.iter().map(|pair| pair[1]))?;
        let changes = pairs.iter().map(|[before, after]| Steady {
            mean: after.mean / before.mean - 1.0,
            error: before.error.hypot(after.error) / before.mean.abs(),
        });
        let change = Steady::over(changes)?;
        Some(Self { experiment, variant, paper: before, changed: after, change, pairs: pairs.len() })
    }
}

/// All changes that were simulated.
pub fn sensitivities(results: &Results) -> Vec<Sensitivity> {
    let mut found = Vec::new();
    for experiment in Experiment::ALL {
        for variant in [Variant::HalfStep, Variant::TenthTolerance, Variant::Coulomb] {
            let forces = |variant| -> Vec<(u64, Steady)> {
                let all = results.seeds(experiment, variant).into_iter();
                all.filter_map(|(seed, t)| Some((seed, steady(experiment, t)?))).collect()
            };
            found.extend(Sensitivity::of(experiment, variant, &forces(Variant::Paper), &forces(variant)));
        }
    }
    found
}
