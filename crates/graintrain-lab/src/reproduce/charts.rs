//! Plots in the form of the paper's figures.

use super::physics::{dilation, displacement, mean, median, resistance};
use super::solves::Solve;
use super::trajectory::{Experiment, Trajectory, Variant};
use super::{METHODS, Results, published};
use graintrain_view::plot::{Axis, Chart, Series, figure};

/// A figure: file name, caption, SVG.
pub struct Figure {
    /// Name without extension.
    pub name: &'static str,
    /// What it shows.
    pub caption: String,
    /// The drawing.
    pub svg: String,
}

/// All figures for which there are data.
pub fn figures(results: &Results) -> Vec<Figure> {
    let mut figures = Vec::new();
    let mut add = |name, caption: &str, charts: Vec<Chart>| {
        if charts.iter().any(|chart| chart.series.iter().any(|series| !series.points.is_empty())) {
            figures.push(Figure { name, caption: caption.into(), svg: figure(&charts, 2) });
        }
    };
    add(
        "fig8",
        "Figure 8: precomputation in consecutive steps, with trains kept from step to step and without.",
        vec![
            reuse(results, "First Newton iteration", |row| row.first),
            reuse(results, "Mean over the step", |row| row.total),
        ],
    );
    add(
        "fig10",
        "Figure 10: time of a solve against the number of contacts, sedimentation. Hollow: tolerance not reached, the time is where the \
         time limit ended the solve.",
        scaling(results, Experiment::Sedimentation).into(),
    );
    add(
        "fig11",
        "Figure 11: precomputation per step and per Newton iteration, sedimentation. Hollow: tolerance not reached.",
        precomputation(results),
    );
    add(
        "fig12",
        "Figure 12: inner iterations per Newton iteration, and Newton iterations, sedimentation. Hollow: tolerance not reached.",
        iterations(results),
    );
    add(
        "fig15",
        "Figure 15: time of a solve against the number of contacts, drafting (above) and direct shear (below). Hollow: tolerance not reached.",
        [Experiment::Drafting, Experiment::DirectShear]
            .into_iter()
            .flat_map(|e| scaling(results, e))
            .collect(),
    );
    add(
        "forces",
        "Force on the blade, and torque of the mixer, against time.",
        vec![
            over_time(
                results,
                Experiment::Drafting,
                "Drag of the blade, means over 0.1 s",
                "force (N)",
                mean,
            ),
            over_time(
                results,
                Experiment::Sedimentation,
                "Torque of the mixer, medians over 0.1 s",
                "torque (N m)",
                median,
            ),
        ],
    );
    add(
        "shear",
        "Direct shear: shear force and rise of the press against the displacement of the lower half.",
        shear(results),
    );
    add(
        "contacts",
        "Contacts against time, and the part of them that the step before had too.",
        vec![
            of_simulations(results, "Contacts", Axis::linear("contacts (1)"), |row| row.contacts as f64),
            of_simulations(
                results,
                "Persistence",
                Axis::linear("persistent contacts (1)").between(0.0, 1.0),
                |row| row.persistent,
            ),
        ],
    );
    figures
}

/// Seconds of precomputation against contacts, of sedimentation.
fn precomputation(results: &Results) -> Vec<Chart> {
    vec![
        by_contacts(results, Experiment::Sedimentation, "Precomputation per step", "time (s)", |solve| {
            solve.precompute_seconds
        })
        .with_band(
            "paper, tensor train: 5 to 15 s",
            published::PRECOMPUTE_SECONDS[0],
            published::PRECOMPUTE_SECONDS[1],
        ),
        by_contacts(
            results,
            Experiment::Sedimentation,
            "Precomputation per Newton iteration",
            "time (s)",
            |solve| solve.precompute_seconds / solve.iterations.max(1) as f64,
        ),
    ]
}

/// Inner iterations and Newton iterations against contacts, of sedimentation.
fn iterations(results: &Results) -> Vec<Chart> {
    vec![
        by_contacts(
            results,
            Experiment::Sedimentation,
            "Inner iterations",
            "iterations per Newton iteration (1)",
            |s| s.inner_mean,
        ),
        by_contacts(results, Experiment::Sedimentation, "Newton iterations", "iterations (1)", |solve| {
            if solve.precompute_seconds + solve.apply_seconds > 0.0 { solve.iterations as f64 } else { 0.0 }
        }),
    ]
}

fn by_contacts(
    results: &Results,
    experiment: Experiment,
    title: &str,
    ordinate: &str,
    value: impl Fn(&Solve) -> f64,
) -> Chart {
    let mut chart = Chart::new(title, Axis::log("contacts (1)"), Axis::log(ordinate)).sized(600.0, 430.0);
    for (color, method) in METHODS.iter().enumerate() {
        let points = |converged: bool| -> Vec<[f64; 2]> {
            let of_method = |solve: &&Solve| {
                solve.method == *method
                    && solve.experiment == experiment.scene()
                    && solve.converged() == converged
            };
            let found = results.solves.iter().filter(of_method);
            let mut points: Vec<[f64; 2]> =
                found.map(|solve| [solve.contacts as f64, value(solve)]).filter(|p| p[1] > 0.0).collect();
            points.sort_by(|a, b| a[0].total_cmp(&b[0]));
            points
        };
        let (solved, unconverged) = (points(true), points(false));
        let label = if solved.is_empty() { *method } else { "" };
        if !solved.is_empty() {
            chart = chart.with(Series::line(*method, solved).with_markers().in_color(color));
        }
        if !unconverged.is_empty() {
            chart = chart.with(Series::scatter(label, unconverged).hollow().in_color(color));
        }
    }
    chart
}

/// Time of the linear algebra, and the part of it that is precomputation.
fn scaling(results: &Results, experiment: Experiment) -> [Chart; 2] {
    let scene = experiment.scene();
    let share = by_contacts(
        results,
        experiment,
        &format!("Precomputation / (solve + precomputation), {scene}"),
        "fraction (1)",
        |solve| {
            solve.precompute_seconds / (solve.precompute_seconds + solve.apply_seconds).max(f64::MIN_POSITIVE)
        },
    );
    [
        by_contacts(
            results,
            experiment,
            &format!("Solve + precomputation per step, {scene}"),
            "time (s)",
            Solve::linear_seconds,
        ),
        Chart { y: Axis::linear("fraction (1)").between(0.0, 1.0), ..share },
    ]
}

fn reuse(results: &Results, title: &str, pick: impl Fn(&super::ReuseRow) -> [f64; 2]) -> Chart {
    let mut chart =
        Chart::new(title, Axis::linear("step (1)"), Axis::log("precomputation (s)")).sized(600.0, 430.0);
    for (color, (method, rows)) in results.reuse.iter().enumerate() {
        let series = |k: usize| rows.iter().map(|row| [row.step as f64, pick(row)[k]]).collect();
        chart = chart
            .with(Series::line(format!("{method}, kept"), series(0)).with_markers().in_color(color))
            .with(Series::line(format!("{method}, anew"), series(1)).with_markers().dashed().in_color(color));
    }
    chart
}

fn over_time(
    results: &Results,
    experiment: Experiment,
    title: &str,
    ordinate: &str,
    statistic: fn(&[f64]) -> f64,
) -> Chart {
    let mut chart = Chart::new(title, Axis::linear("time (s)"), Axis::linear(ordinate)).sized(600.0, 430.0);
    for (color, variant) in Variant::ALL.into_iter().enumerate() {
        if let Some(trajectory) = results.trajectory(experiment, variant) {
            let points = trajectory.rows.iter().map(|row| [row.time, resistance(experiment, row)]).collect();
            let points = smoothed(points, trajectory.step, statistic);
            chart = chart.with(Series::line(variant.name(), points).in_color(color));
        }
    }
    chart
}

/// Mean abscissa and a statistic of the ordinates in windows of 0.1 s: impacts of single grains would hide
/// the course.
fn smoothed(points: Vec<[f64; 2]>, step: f64, statistic: fn(&[f64]) -> f64) -> Vec<[f64; 2]> {
    let window = ((0.1 / step).round() as usize).max(1);
    let column = |chunk: &[[f64; 2]], k: usize| chunk.iter().map(|p| p[k]).collect::<Vec<f64>>();
    let windows = points.chunks(window);
    windows.map(|chunk| [mean(&column(chunk, 0)), statistic(&column(chunk, 1))]).collect()
}

fn shear(results: &Results) -> Vec<Chart> {
    let axis = || Axis::linear("displacement (m)");
    let mut force =
        Chart::new("Shear force on the lower half", axis(), Axis::linear("force (N)")).sized(600.0, 430.0);
    let mut rise = Chart::new("Dilation", axis(), Axis::linear("rise of the press (m)")).sized(600.0, 430.0);
    for (color, variant) in Variant::ALL.into_iter().enumerate() {
        let Some(trajectory) = results.trajectory(Experiment::DirectShear, variant) else { continue };
        force = force.with(Series::line(variant.name(), force_by_displacement(trajectory)).in_color(color));
        rise = rise.with(Series::line(variant.name(), dilation(trajectory)).in_color(color));
    }
    vec![force, rise]
}

fn force_by_displacement(trajectory: &Trajectory) -> Vec<[f64; 2]> {
    let displacement = displacement(trajectory);
    let moving = trajectory.rows.iter().zip(displacement).filter(|(row, _)| row.velocity[0].abs() > 0.0);
    let points = moving.map(|(row, x)| [x, resistance(Experiment::DirectShear, row)]).collect();
    smoothed(points, trajectory.step, mean)
}

fn of_simulations(
    results: &Results,
    title: &str,
    ordinate: Axis,
    value: impl Fn(&super::trajectory::Row) -> f64,
) -> Chart {
    let mut chart = Chart::new(title, Axis::linear("time (s)"), ordinate).sized(600.0, 430.0);
    for (color, experiment) in Experiment::ALL.into_iter().enumerate() {
        if let Some(trajectory) = results.trajectory(experiment, Variant::Paper) {
            let points = trajectory.rows.iter().map(|row| [row.time, value(row)]).collect();
            chart = chart.with(Series::line(experiment.scene(), points).in_color(color));
        }
    }
    chart
}
