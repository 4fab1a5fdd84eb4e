//! "Where tensor trains pay": disorder against size, coloured by the time of the best tensor-train solver
//! over that of the best other one.

use crate::Failure;
use crate::follow::{Life, Run, Sampling, TRAIN_AT_ANY_SIZE, lock};
use crate::solve::problem;
use graintrain_view::plot::svg::{Anchor, Svg};
use std::path::Path;

/// Largest displacement of a body, in radii.
const DISORDER: [f64; 4] = [0.0, 1e-3, 1e-2, 0.1];
/// Bodies.
const SIZES: [usize; 4] = [64, 216, 1000, 3375];
/// The lattice that is disturbed.
const LATTICE: &str = "cubic";
/// Tensor-train solvers. The first is `ic` where it rejects its train; a cell tells which it was.
const TRAINS: [&str; 2] = [TRAIN_AT_ANY_SIZE, "tt-schur"];
/// The others, beside the guide.
const OTHERS: [&str; 2] = ["ic", "block-jacobi"];
/// The linear solver of the interior point whose systems all others get: the fastest.
const GUIDE: &str = "cholesky";
/// Every so many systems are handed on.
const EVERY: usize = 8;
/// Newton iterations at most: twice what most lattices need.
const ITERATIONS: usize = 40;

/// One assembly.
struct Cell {
    column: usize,
    line: usize,
    contacts: usize,
    /// Time of the best train over that of the best other solver; `None` where no train solved every system.
    ratio: Option<f64>,
    captured: f64,
    /// Share of systems for which `tt` used its train.
    active: f64,
}

const HEAD: &str = "| bodies | disorder | contacts | systems | best train | s | captured energy | train in use | best other | s | ratio |\n\
    |---|---|---|---|---|---|---|---|---|---|---|\n";

impl Cell {
    /// From a line of the table.
    fn parse(line: &str) -> Option<Self> {
        let fields: Vec<&str> = line.split('|').map(str::trim).collect();
        let [_, bodies, disorder, contacts, _, _, _, captured, active, _, _, ratio, _] = fields[..] else {
            return None;
        };
        let (bodies, disorder): (usize, f64) = (bodies.parse().ok()?, disorder.parse().ok()?);
        Some(Self {
            column: SIZES.iter().position(|&size| size == bodies)?,
            line: DISORDER.iter().position(|&level| level == disorder)?,
            contacts: contacts.parse().ok()?,
            ratio: ratio.parse().ok(),
            captured: captured.parse().ok()?,
            active: active.parse().ok()?,
        })
    }
}

/// Measures the cells that are not in the table yet, appends them and draws all. A linear solver that needs
/// more than `patience` processor seconds for one system gets no others.
pub fn map(table: &Path, file: &Path, patience: f64) -> Result<(), Failure> {
    let mut text = if table.exists() { std::fs::read_to_string(table)? } else { HEAD.to_string() };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    for (column, bodies) in SIZES.iter().enumerate() {
        for (line, disorder) in DISORDER.iter().enumerate() {
            let known = text.lines().filter_map(Cell::parse).any(|c| c.column == column && c.line == line);
            if !known {
                text += &pool.install(|| measure(*bodies, *disorder, patience))?;
                std::fs::write(table, &text)?;
            }
        }
    }
    let cells: Vec<Cell> = text.lines().filter_map(Cell::parse).collect();
    std::fs::write(file, draw(&cells))?;
    Ok(())
}

/// One line of the table.
fn measure(bodies: usize, disorder: f64, patience: f64) -> Result<String, Failure> {
    let sampling = Sampling { every: EVERY, solve_every: 1, iterations: ITERATIONS, patience };
    let names: Vec<&str> = TRAINS.iter().chain(&OTHERS).copied().collect();
    let problem = problem(&format!("{LATTICE}:{bodies}:{disorder}"))?;
    let lives: Vec<(&str, Life)> = names.iter().map(|name| (*name, Life::Problem)).collect();
    let mut run = Run::new(GUIDE, &lives, sampling)?;
    run.solve(&problem, f64::INFINITY)?;
    let systems = lock(&run.tallies[0]).systems;
    let fastest = |solvers: &mut dyn Iterator<Item = usize>| {
        solvers
            .filter_map(|k| Some((k, lock(&run.tallies[k]).whole(systems)?)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let train = fastest(&mut (1..=TRAINS.len()));
    let other = fastest(&mut std::iter::once(0).chain(TRAINS.len() + 1..run.tallies.len()));
    let figure = |name: &str| lock(&run.tallies[1]).mean(name).unwrap_or(0.0);
    let name = |k: usize| if k == 0 { GUIDE } else { names[k - 1] };
    let words = |best: Option<(usize, f64)>| {
        best.map_or("- | -".to_string(), |(k, seconds)| format!("`{}` | {seconds:.2}", name(k)))
    };
    let ratio = train.zip(other).map_or("-".to_string(), |(a, b)| format!("{:.2}", a.1 / b.1));
    Ok(format!(
        "| {bodies} | {disorder} | {} | {systems} | {} | {:.3} | {:.2} | {} | {ratio} |\n",
        problem.num_contacts(),
        words(train),
        figure("train_captured_energy"),
        figure("train_active"),
        words(other),
    ))
}

/// Red above 1 (trains lose), white at 1, blue below; saturated at a factor of 4.
fn colour(ratio: f64) -> String {
    let depth = (ratio.log2() / 2.0).clamp(-1.0, 1.0);
    let fade = |d: f64| (255.0 - 175.0 * d) as u8;
    if depth > 0.0 {
        format!("rgb(255,{0},{0})", fade(depth))
    } else {
        format!("rgb({0},{0},255)", fade(-depth))
    }
}

fn draw(cells: &[Cell]) -> String {
    let (cell, left, top) = ([130.0, 56.0], 90.0, 64.0);
    let size = [left + cell[0] * SIZES.len() as f64 + 20.0, top + cell[1] * DISORDER.len() as f64 + 70.0];
    let (black, white) = ("#222222", "#ffffff");
    let mut svg = Svg::new(size[0], size[1]);
    svg.rectangle([0.0, 0.0], size, white, 1.0);
    svg.text([size[0] / 2.0, 22.0], "Where tensor trains pay", 16.0, Anchor::Middle, 0.0, black);
    let about = "time of the best train over the best other; (share of energy in a train of rank 10)";
    svg.text([size[0] / 2.0, 42.0], about, 9.0, Anchor::Middle, 0.0, black);
    let bottom = top + cell[1] * DISORDER.len() as f64;
    for (line, disorder) in DISORDER.iter().enumerate() {
        let y = top + cell[1] * (line as f64 + 0.5) + 4.0;
        svg.text([left - 10.0, y], &format!("{disorder}"), 12.0, Anchor::End, 0.0, black);
    }
    for &Cell { column, line, contacts, ratio, captured, active } in cells {
        let corner = [left + cell[0] * column as f64, top + cell[1] * line as f64];
        svg.rectangle(corner, cell, &colour(ratio.unwrap_or(f64::INFINITY)), 1.0);
        svg.frame(corner, cell, black);
        let middle = corner[0] + 0.5 * cell[0];
        let words = ratio.map_or("no solve".to_string(), |ratio| format!("{ratio:.1}"));
        let mark = if active > 0.0 { "train in use" } else { "train rejected" };
        svg.text([middle, corner[1] + 24.0], &words, 14.0, Anchor::Middle, 0.0, black);
        let note = format!("{mark} ({captured:.2})");
        svg.text([middle, corner[1] + 42.0], &note, 10.0, Anchor::Middle, 0.0, black);
        svg.text([middle, bottom + 18.0], &contacts.to_string(), 12.0, Anchor::Middle, 0.0, black);
    }
    let middle = left + 0.5 * cell[0] * SIZES.len() as f64;
    svg.text([middle, bottom + 42.0], "contacts (1)", 12.0, Anchor::Middle, 0.0, black);
    let turned = [22.0, 0.5 * (top + bottom)];
    svg.text(turned, "disorder: largest move (radii)", 12.0, Anchor::Middle, -90.0, black);
    svg.finish()
}
