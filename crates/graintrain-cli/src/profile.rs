//! Performance profiles (E. Dolan, J. More, Benchmarking optimization software with performance profiles,
//! Math. Program. 91, 2002).
//!
//! With t(p, s) the time of solver s on problem p (infinite where it did not converge), the performance ratio
//! is t(p, s) / min_s t(p, s), and rho_s(tau) is the fraction of problems on which the ratio of s is at most
//! tau.

use crate::solving::Record;
use graintrain_view::plot::{Axis, Chart, Series};

/// Colours of a chart; solvers beyond them repeat the colours with dashed lines.
const COLORS: usize = 8;
/// Room around a profile, so that solvers that solve all or nothing, or are always the fastest, do not lie on
/// the frame.
const MARGIN: f64 = 1.03;

/// How a solver did over all problems.
pub struct Summary {
    /// Solver.
    pub solver: String,
    /// Problems that it can treat, of those it was given.
    pub problems: usize,
    /// Problems that it cannot treat.
    pub refused: usize,
    /// Problems on which it converged.
    pub converged: usize,
    /// Problems on which it was the fastest.
    pub fastest: usize,
    /// Geometric mean of its performance ratio where it converged.
    pub mean_ratio: Option<f64>,
    /// Its performance ratios where it converged, ascending.
    ratios: Vec<f64>,
}

/// The summary of every solver, in the order of appearance.
pub fn summary(records: &[Record]) -> Vec<Summary> {
    let mut lines: Vec<Summary> = Vec::new();
    for record in records {
        let index = lines.iter().position(|line| line.solver == record.solver).unwrap_or_else(|| {
            lines.push(Summary {
                solver: record.solver.clone(),
                problems: 0,
                refused: 0,
                converged: 0,
                fastest: 0,
                mean_ratio: None,
                ratios: Vec::new(),
            });
            lines.len() - 1
        });
        let line = &mut lines[index];
        if record.status.is_none() {
            line.refused += 1;
            continue;
        }
        line.problems += 1;
        if !record.converged {
            continue;
        }
        let best = records
            .iter()
            .filter(|other| other.problem == record.problem && other.converged)
            .map(Record::cost)
            .fold(f64::INFINITY, f64::min);
        line.converged += 1;
        line.fastest += usize::from(record.cost() == best);
        line.ratios.push(if best > 0.0 { record.cost() / best } else { 1.0 });
    }
    for line in &mut lines {
        line.ratios.sort_by(f64::total_cmp);
        if !line.ratios.is_empty() {
            let mean = line.ratios.iter().map(|ratio| ratio.ln()).sum::<f64>() / line.ratios.len() as f64;
            line.mean_ratio = Some(mean.exp());
        }
    }
    lines
}

/// The performance profile as SVG.
pub fn svg(records: &[Record]) -> String {
    let lines = summary(records);
    let largest = lines.iter().flat_map(|line| line.ratios.last()).fold(2.0_f64, |m, &ratio| m.max(ratio));
    let problems = lines.iter().map(|line| line.problems + line.refused).max().unwrap_or(0);
    let title = match records.first() {
        Some(record) => {
            let friction = match record.friction {
                graintrain_ccp::FrictionModel::Relaxed => "relaxed",
                graintrain_ccp::FrictionModel::Coulomb => "Coulomb",
            };
            let plural = if problems == 1 { "" } else { "s" };
            format!(
                "Performance profile: {problems} problem{plural}, {friction}, residual {:e}",
                record.tolerance
            )
        }
        None => "Performance profile".to_string(),
    };
    let x = Axis::log("time over that of the fastest solver, tau (1)").between(1.0 / MARGIN, largest * 1.1);
    let y = Axis::linear("fraction of problems solved within tau (1)").between(1.0 - MARGIN, MARGIN);
    let mut chart = Chart::new(title, x, y).sized(760.0, 480.0);
    for (index, line) in lines.into_iter().filter(|line| line.problems > 0).enumerate() {
        let fraction = |count: usize| count as f64 / line.problems as f64;
        // From rho(1): a line that came up from zero there would hide behind the axis.
        let mut points = vec![[1.0, fraction(line.fastest)]];
        for (k, &ratio) in line.ratios.iter().enumerate().skip(line.fastest) {
            points.extend([[ratio, fraction(k)], [ratio, fraction(k + 1)]]);
        }
        points.push([largest * 1.1, fraction(line.ratios.len())]);
        let label = match line.converged {
            all if all == problems => line.solver,
            some => format!("{} ({some} of {})", line.solver, line.problems),
        };
        let series = Series::line(label, points);
        chart = chart.with(if index < COLORS { series } else { series.dashed() });
    }
    chart.to_svg()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(problem: &str, solver: &str, seconds: f64, converged: bool) -> Record {
        Record {
            problem: problem.to_string(),
            contacts: 1,
            bodies: 1,
            solver: solver.to_string(),
            friction: graintrain_ccp::FrictionModel::Relaxed,
            tolerance: 1e-4,
            status: Some(graintrain_ccp::Status::Stalled),
            interrupted: false,
            iterations: 0,
            linear_iterations: 0,
            seconds,
            cpu_seconds: None,
            threads: None,
            limited: false,
            residual: 0.0,
            residual_rms: 0.0,
            residual_relaxed: 0.0,
            residual_coulomb: 0.0,
            objective: 0.0,
            gap: None,
            converged,
            remark: None,
            notes: Vec::new(),
        }
    }

    #[test]
    fn ratios_are_relative_to_the_fastest_solver_that_converged() {
        let records = [
            record("a", "fast", 1.0, true),
            record("a", "slow", 4.0, true),
            record("b", "fast", 0.5, false),
            record("b", "slow", 3.0, true),
        ];
        let lines = summary(&records);
        assert_eq!((lines[0].converged, lines[0].fastest, lines[0].mean_ratio), (1, 1, Some(1.0)));
        assert_eq!((lines[1].converged, lines[1].fastest), (2, 1));
        assert!((lines[1].mean_ratio.unwrap() - 2.0).abs() < 1e-15);
        assert_eq!(lines[1].ratios, [1.0, 4.0]);
        assert!(svg(&records).contains("slow"));
    }

    #[test]
    fn a_profile_tells_who_missed_problems_even_where_nobody_solved_any() {
        let some = svg(&[record("a", "good", 1.0, true), record("a", "bad", 1.0, false)]);
        assert!(
            some.contains("1 problem,") && some.contains(">good<") && some.contains("bad (0 of 1)"),
            "{some}"
        );
        let none = svg(&[record("a", "bad", 1.0, false), record("b", "bad", 1.0, false)]);
        assert!(none.contains("bad (0 of 2)") && !none.contains("NaN"), "{none}");
        assert!(!svg(&[]).contains("NaN"));
    }
}
