//! "Where tensor trains pay": disorder against size, coloured by the time of the best tensor-train solver over that of the
//! best other one.

use crate::Failure;
use crate::solve::{Measured, measure};
use graintrain::plot::svg::{Anchor, Svg};
use std::path::Path;

/// Largest displacement of a body, in radii.
const DISORDER: [f64; 4] = [0.0, 1e-3, 1e-2, 0.1];
/// Bodies.
const SIZES: [usize; 3] = [64, 216, 1000];
/// The lattice that is disturbed.
const LATTICE: &str = "cubic";
/// Tensor-train solvers. `tt` is `ic` where it rejects its train; a cell tells which it was.
const TRAINS: [&str; 2] = ["pdip+tt", "pdip+tt-schur"];
/// The others.
const OTHERS: [&str; 3] = ["pdip+ic", "pdip+block-jacobi", "pdip+cholesky"];

/// Measures, prints and draws.
pub fn map(file: &Path, limit: f64) -> Result<(), Failure> {
    println!(
        "| bodies | disorder | contacts | best train | s | captured energy | train in use | best other | s | ratio |\n\
         |---|---|---|---|---|---|---|---|---|---|"
    );
    let mut cells = Vec::new();
    for (column, bodies) in SIZES.iter().enumerate() {
        for (line, disorder) in DISORDER.iter().enumerate() {
            let name = format!("{LATTICE}:{bodies}:{disorder}");
            let run = |solvers: &[&str]| -> Result<Vec<Measured>, Failure> {
                solvers.iter().map(|solver| measure(&name, solver, limit)).collect()
            };
            let (trains, others) = (run(&TRAINS)?, run(&OTHERS)?);
            let figure = |name: &str| trains[0].figures.get(name).copied().unwrap_or(0.0);
            let (captured, active) = (figure("train_captured_energy"), figure("train_active"));
            let (Some(train), Some(other)) = (fastest(&trains), fastest(&others)) else { continue };
            let ratio = train.seconds / other.seconds;
            println!(
                "| {bodies} | {disorder} | {} | `{}` | {:.2} | {captured:.3} | {active:.2} | `{}` | {:.2} | {ratio:.2} |",
                other.contacts, train.solver, train.seconds, other.solver, other.seconds,
            );
            cells.push((column, line, other.contacts, ratio, captured, active));
        }
    }
    std::fs::write(file, draw(&cells))?;
    Ok(())
}

fn fastest(measured: &[Measured]) -> Option<&Measured> {
    measured.iter().filter(|m| m.converged()).min_by(|a, b| a.seconds.total_cmp(&b.seconds))
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

fn draw(cells: &[(usize, usize, usize, f64, f64, f64)]) -> String {
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
    for &(column, line, contacts, ratio, captured, active) in cells {
        let corner = [left + cell[0] * column as f64, top + cell[1] * line as f64];
        svg.rectangle(corner, cell, &colour(ratio), 1.0);
        svg.frame(corner, cell, black);
        let middle = corner[0] + 0.5 * cell[0];
        let mark = if active > 0.0 { "train in use" } else { "train rejected" };
        svg.text([middle, corner[1] + 24.0], &format!("{ratio:.2}"), 14.0, Anchor::Middle, 0.0, black);
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
