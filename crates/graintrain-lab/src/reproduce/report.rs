//! What a reproduction leaves: CSV, SVG, pictures, and one self-contained HTML page.

use super::charts::{Figure, figures};
use super::claims::{Claim, Verdict, verdicts};
use super::physics::{Steady, friction_ratio_over_seeds, sensitivities, steady_over_seeds};
use super::published as paper;
use super::solves::{Problems, Solve, TOLERANCE};
use super::trajectory::{Experiment, Variant};
use super::{Progress, ReproduceError, Results, Settings, literal_method, measure};
use crate::page::begin;
use base64::Engine;
use graintrain_io::files::{make_folder, write_atomically};
use graintrain_view::plot::axis::number;
use graintrain_view::plot::svg::escape;
use graintrain_view::render::{RenderSettings, render};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What was written.
#[derive(Debug)]
pub struct Report {
    /// The HTML page.
    pub page: PathBuf,
    /// The claims and their verdicts.
    pub claims: Vec<Claim>,
    /// Methods that this build lacks.
    pub missing: Vec<String>,
    /// Lines of `cells.jsonl` that could not be read; their cells were measured again.
    pub damaged: usize,
}

/// Measures what is not yet measured and writes tables, plots, pictures and the page into `settings.out`.
///
/// # Errors
/// [`ReproduceError`]; finished cells are kept for the next call.
pub fn reproduce(
    settings: &Settings,
    stop: &Arc<AtomicBool>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Report, ReproduceError> {
    make_folder(&settings.out)?;
    let results = measure(settings, stop, progress)?;
    let claims = verdicts(&results);
    let figures = figures(&results);
    write_tables(&settings.out, &results)?;
    for figure in &figures {
        write_atomically(&settings.out.join(format!("{}.svg", figure.name)), figure.svg.as_bytes())?;
    }
    let pictures = pictures(settings, &results, stop)?;
    let page = settings.out.join("report.html");
    write_atomically(&page, html(settings, &results, &claims, &figures, &pictures).as_bytes())?;
    Ok(Report { page, claims, missing: results.missing, damaged: results.damaged })
}

fn write_tables(out: &Path, results: &Results) -> Result<(), ReproduceError> {
    let mut text = String::from(
        "experiment,n,step,contacts,method,status,iterations,residual,seconds,precompute_seconds,apply_seconds,\
         inner_iterations_mean,missed_fraction,figures\n",
    );
    for solve in &results.solves {
        let figures: Vec<String> =
            solve.figures.iter().map(|(name, value)| format!("{name}={value}")).collect();
        let _ = writeln!(
            text,
            "{},{},{},{},{},{:?},{},{},{},{},{},{},{},{}",
            solve.experiment,
            solve.n,
            solve.step,
            solve.contacts,
            solve.method,
            solve.status,
            solve.iterations,
            solve.residual.map_or(String::new(), |residual| residual.to_string()),
            solve.seconds,
            solve.precompute_seconds,
            solve.apply_seconds,
            solve.inner_mean,
            solve.unconverged,
            figures.join(" ")
        );
    }
    write_atomically(&out.join("solves.csv"), text.as_bytes())?;
    let mut text = String::from(
        "method,step,contacts,first_kept,first_anew,total_kept,total_anew,iterations_kept,iterations_anew\n",
    );
    for (method, rows) in &results.reuse {
        for row in rows {
            let ([a, b], [c, d], [e, f]) = (row.first, row.total, row.iterations);
            let _ = writeln!(text, "{method},{},{},{a},{b},{c},{d},{e},{f}", row.step, row.contacts);
        }
    }
    write_atomically(&out.join("reuse.csv"), text.as_bytes())?;
    for (cell, trajectory) in &results.trajectories {
        let mut text = String::from(
            "time,contacts,loaded,persistent,residual,solve_seconds,penetration,kinetic_energy,force_x,force_y,force_z,\
             torque_x,torque_y,torque_z,x,y,z,velocity_x,velocity_y,velocity_z,press_height,weight_below,momentum_error\n",
        );
        for row in &trajectory.rows {
            let vectors = [row.force, row.torque, row.place, row.velocity];
            let numbers: Vec<String> = vectors.iter().flatten().map(|value| value.to_string()).collect();
            let [press, below] =
                [row.press, row.weight_below].map(|value| value.map_or(String::new(), |x| x.to_string()));
            let _ = writeln!(
                text,
                "{},{},{},{},{},{},{},{},{},{press},{below},{}",
                row.time,
                row.contacts,
                row.loaded,
                row.persistent,
                row.residual,
                row.solve_seconds,
                row.penetration,
                row.kinetic_energy,
                numbers.join(","),
                row.momentum_error
            );
        }
        let seed = if cell.seed == 1 { String::new() } else { format!("-seed{}", cell.seed) };
        let name = format!("{}-n{}-{}{seed}.csv", cell.experiment.scene(), cell.n, cell.variant.name());
        write_atomically(&out.join(name), text.as_bytes())?;
    }
    Ok(())
}

/// Pictures like the paper's figures 9, 13 and 14: the last but one stored state of every experiment, in
/// which the tools move, with speeds and with forces. Captions and files.
fn pictures(
    settings: &Settings,
    results: &Results,
    stop: &Arc<AtomicBool>,
) -> Result<Vec<(String, PathBuf)>, ReproduceError> {
    let mut pictures = Vec::new();
    for (cell, trajectory) in &results.trajectories {
        if cell.variant != Variant::Paper || cell.n != settings.n || cell.seed != 1 {
            continue;
        }
        let sample = trajectory.samples.iter().rev().nth(1).or(trajectory.samples.last());
        let folder = cell.state_folder(&settings.out.join("states"), sample.copied().unwrap_or(0));
        let world = Problems::open(&folder, stop)?.into_world();
        for force_chains in [false, true] {
            let kind = if force_chains { "forces" } else { "speeds" };
            let path = settings.out.join(format!("{}-n{}-{kind}.png", cell.experiment.scene(), cell.n));
            let look = RenderSettings { force_chains, step: trajectory.step, ..RenderSettings::default() };
            let mut bytes = Vec::new();
            let encoded = render(&world, &look)?.write_png(&mut bytes);
            encoded.map_err(|error| ReproduceError::File { path: path.clone(), source: error.into() })?;
            write_atomically(&path, &bytes)?;
            let caption =
                format!("{}, n = {}, t = {} s: {kind}", cell.experiment.scene(), cell.n, number(world.time));
            pictures.push((caption, path));
        }
    }
    Ok(pictures)
}

fn html(
    settings: &Settings,
    results: &Results,
    claims: &[Claim],
    figures: &[Figure],
    pictures: &[(String, PathBuf)],
) -> String {
    let mut page = begin(&format!("The paper's experiments, run again (n = {})", settings.n));
    let counts = |verdict| claims.iter().filter(|claim| claim.verdict == verdict).count();
    let _ = write!(
        page,
        "<p>Corona, Gorsich, Jayakumar, Veerapaneni, <i>Tensor Train Accelerated Solvers for Nonsmooth Rigid Body Dynamics</i>, \
         Appl. Mech. Rev. 71(5), 2019. graintrain {}. Of {} claims {} hold, {} do not, {} cannot be decided at this size or \
         were not measured.</p>",
        env!("CARGO_PKG_VERSION"),
        claims.len(),
        counts(Verdict::Holds),
        counts(Verdict::Fails),
        counts(Verdict::Open)
    );
    let _ = write!(
        page,
        "<p>Every method solves the same contact problems, from zero impulses, on one thread, to residual {TOLERANCE:e}, for at \
         most {} s each; a time marked &ge; belongs to a solve that did not reach the tolerance. The simulations themselves are made by \
         the fastest solver.</p>",
        number(settings.limit().as_secs_f64())
    );
    if !results.missing.is_empty() {
        let _ = write!(
            page,
            "<p>This build lacks: {}. Their cells are empty.</p>",
            escape(&results.missing.join(", "))
        );
    }
    if results.solves.iter().any(|solve| solve.residual.is_none()) {
        page.push_str(
            "<p>Some solvers did not come back within four times their limit. They were left to themselves, so that times \
             measured after them in the same session are those of a machine that also did their work.</p>",
        );
    }
    if results.damaged > 0 {
        let _ = write!(
            page,
            "<p>{} lines of cells.jsonl could not be read; their cells were measured again, and the file as it was is kept as \
             cells.jsonl.damaged.</p>",
            results.damaged
        );
    }
    claim_table(&mut page, claims);
    rank_tables(&mut page, results);
    solve_table(&mut page, results);
    physics_table(&mut page, results);
    page.push_str("<h2>Figures</h2>");
    for figure in figures {
        let _ = write!(
            page,
            "<figure>{}<figcaption>{}</figcaption></figure>",
            figure.svg,
            escape(&figure.caption)
        );
    }
    page.push_str("<h2>Pictures (compare figures 9, 13, 14)</h2><div class=\"pictures\">");
    for (caption, path) in pictures {
        if let Ok(bytes) = std::fs::read(path) {
            let data = base64::engine::general_purpose::STANDARD.encode(bytes);
            let _ = write!(
                page,
                "<figure><img alt=\"{c}\" src=\"data:image/png;base64,{data}\"><figcaption>{c}</figcaption></figure>",
                c = escape(caption)
            );
        }
    }
    page.push_str("</div></body></html>\n");
    page
}

fn claim_table(page: &mut String, claims: &[Claim]) {
    page.push_str(
        "<h2>Claims</h2><table><tr><th>where</th><th>claim</th><th>verdict</th><th>measured here</th></tr>",
    );
    for claim in claims {
        let class = match claim.verdict {
            Verdict::Holds => "holds",
            Verdict::Fails => "fails",
            Verdict::Open => "open",
        };
        let _ = write!(
            page,
            "<tr><td>{}</td><td>{}</td><td class=\"{class}\">{}</td><td>{}</td></tr>",
            escape(claim.place),
            escape(&claim.statement),
            claim.verdict.word(),
            escape(&claim.evidence)
        );
    }
    page.push_str("</table>");
}

fn rank_tables(page: &mut String, results: &Results) {
    page.push_str("<h2>Tables 3 and 4: the literal recipe</h2><table><tr><th>eps</th>");
    for cap in paper::RANK_CAPS {
        let _ = write!(page, "<th>r &le; {cap}: paper</th><th>here</th><th>error here</th>");
    }
    page.push_str("</tr>");
    let cell = |row: usize, column: usize| {
        // The recipe's own setting is also measured wherever methods are compared.
        results.ranks[row][column].as_ref().or_else(|| {
            let own = literal_method(row, column);
            results.solves.iter().filter(|solve| solve.method == own).max_by_key(|solve| solve.contacts)
        })
    };
    let figure = |solve: Option<&Solve>, name: &str| {
        solve.and_then(|solve| solve.figures.get(name)).map_or("not measured".into(), |value| number(*value))
    };
    for (row, accuracy) in paper::ACCURACIES.iter().enumerate() {
        let _ = write!(page, "<tr><th>{}</th>", number(*accuracy));
        for column in 0..3 {
            let [matrix, inverse] = paper::RANKS[row][column];
            let solve = cell(row, column);
            let _ = write!(
                page,
                "<td class=\"n\">{matrix} / {inverse}</td><td class=\"n\">{} / {}</td><td class=\"n\">{}</td>",
                figure(solve, "rank_matrix"),
                figure(solve, "rank_inverse"),
                figure(solve, "compression_error")
            );
        }
        page.push_str("</tr>");
    }
    page.push_str(
        "</table><p>Mean ranks of the trains of S and S<sup>-1</sup> and the error of the compression, relative, \
         over all entries.</p><table><tr><th>eps</th>",
    );
    for cap in paper::RANK_CAPS {
        let _ = write!(page, "<th>r &le; {cap}: paper (s)</th><th>here (s)</th>");
    }
    page.push_str("</tr>");
    for (row, accuracy) in paper::ACCURACIES.iter().enumerate() {
        let _ = write!(page, "<tr><th>{}</th>", number(*accuracy));
        for column in 0..3 {
            let seconds = cell(row, column)
                .map(|solve| {
                    ["compression_seconds", "inversion_seconds"]
                        .iter()
                        .filter_map(|name| solve.figures.get(*name))
                        .sum()
                })
                .map_or("not measured".to_string(), |seconds: f64| number(seconds));
            let _ = write!(
                page,
                "<td class=\"n\">{}</td><td class=\"n\">{seconds}</td>",
                paper::SECONDS[row][column]
            );
        }
        page.push_str("</tr>");
    }
    page.push_str(
        "</table><p>Seconds of one compression and inversion. The paper's sizes: 35 939 bodies, one core, MATLAB; here: the \
         problems of the next table.</p>",
    );
}

fn solve_table(page: &mut String, results: &Results) {
    if results.solves.is_empty() {
        return;
    }
    page.push_str(
        "<h2>Every method on every problem</h2><table><tr><th>problem</th><th>contacts</th><th>method</th>\
         <th>Newton / outer iterations</th><th>inner per Newton</th><th>precompute (s)</th><th>linear solves (s)</th>\
         <th>total (s)</th><th>residual</th></tr>",
    );
    let mut last = String::new();
    for solve in &results.solves {
        let problem = format!("{}, n = {}, step {}", solve.experiment, solve.n, solve.step);
        let shown = if problem == last { "" } else { problem.as_str() };
        let bound = if solve.converged() { "" } else { "&ge; " };
        let _ = write!(
            page,
            "<tr><td>{shown}</td><td class=\"n\">{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{bound}{}</td><td class=\"n\">{}</td></tr>",
            solve.contacts,
            escape(&solve.method),
            solve.iterations,
            number(solve.inner_mean),
            number(solve.precompute_seconds),
            number(solve.apply_seconds),
            number(solve.seconds),
            solve.residual.map_or("did not come back".to_string(), number)
        );
        last = problem;
    }
    page.push_str("</table>");
}

fn physics_table(page: &mut String, results: &Results) {
    let text = |value: Option<Steady>| {
        value.map_or("&ndash;".into(), |value| {
            format!("{} &plusmn; {}", number(value.mean), number(value.error))
        })
    };
    let mut rows = String::new();
    for experiment in Experiment::ALL {
        for variant in Variant::ALL {
            let Some(trajectory) = results.trajectory(experiment, variant) else { continue };
            let sheared = experiment == Experiment::DirectShear;
            let ratio = sheared.then(|| friction_ratio_over_seeds(results, variant)).flatten();
            let penetration =
                trajectory.rows.iter().skip(trajectory.rows.len() / 2).map(|row| row.penetration);
            let change = sensitivities(results)
                .into_iter()
                .find(|found| found.experiment == experiment && found.variant == variant)
                .map_or("&ndash;".to_string(), |found| {
                    format!(
                        "{} &plusmn; {} %",
                        number(100.0 * found.change.mean),
                        number(100.0 * found.change.error)
                    )
                });
            let _ = write!(
                rows,
                "<tr><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{change}</td><td class=\"n\">{}</td>\
                 <td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
                experiment.scene(),
                variant.name(),
                text(steady_over_seeds(results, experiment, variant)),
                text(ratio),
                number(penetration.fold(0.0, f64::max)),
                number(trajectory.rows.iter().map(|row| row.residual).fold(0.0, f64::max))
            );
        }
    }
    if !rows.is_empty() {
        let _ = write!(
            page,
            "<h2>Physical outputs</h2><table><tr><th>experiment</th><th>variant</th><th>steady force (N) or torque (N m)</th>\
             <th>change</th><th>shear / normal force (1)</th><th>largest penetration, second half (m)</th>\
             <th>largest residual (1)</th></tr>{rows}</table>\
             <p>Sedimentation: median torque of the mixer over the second half. Drafting: drag of the blade; direct shear: shear force \
             on the lower half, and its ratio to the normal force on the plane between the halves; both means over the time in which \
             the tool, a third of its way behind it, moves with at least half its largest speed. Standard errors are from eight blocks \
             of the time; where three or more perturbed lattices were simulated, from their spread (<code>reproduce physics</code>: {}, \
             coulomb one), and a change is the mean over the lattices that have both simulations.</p>",
            super::SEEDS
        );
    }
}
