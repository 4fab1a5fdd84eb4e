//! Means of the table over the systems of a solve.

use super::PAPER;
use super::readings::BASE;
use super::table::{Count, Row, short};

/// The rows of one solve at the paper's setting, by method.
struct Solve<'a> {
    rows: Vec<&'a Row>,
}

impl<'a> Solve<'a> {
    fn of(&self, method: &'a str) -> impl Iterator<Item = &'a Row> + '_ {
        self.rows.iter().copied().filter(move |row| row.key.method == method)
    }

    /// Mean of a figure over the systems that have it.
    fn mean(&self, figure: impl Fn(&Row) -> Option<f64>) -> String {
        let values: Vec<f64> = self.of("exact").filter_map(figure).collect();
        match values.len() {
            0 => "-".to_string(),
            count => short(Some(values.iter().sum::<f64>() / count as f64)),
        }
    }

    /// Median of a figure.
    fn median(&self, figure: impl Fn(&Row) -> Option<f64>) -> String {
        let mut values: Vec<f64> = self.of("exact").filter_map(figure).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).map_or("-".to_string(), |&value| short(Some(value)))
    }

    /// Mean iterations where the tolerance was reached, and how often it was not: within 1000 iterations,
    /// within the time limit.
    fn iterations(&self, method: &'a str) -> String {
        let counts: Vec<Option<Count>> = self.of(method).map(|row| row.figures.bicgstab).collect();
        let reached: Vec<f64> = counts
            .iter()
            .filter_map(|count| if let Some(Count::Reached(k)) = count { Some(*k as f64) } else { None })
            .collect();
        let mean = if reached.is_empty() {
            "-".to_string()
        } else {
            format!("{:.0}", reached.iter().sum::<f64>() / reached.len() as f64)
        };
        let of = |what: &str, count: usize| {
            if count > 0 { format!(" ({count} of {} {what})", counts.len()) } else { String::new() }
        };
        let unconverged = counts.iter().filter(|count| **count == Some(Count::Unconverged)).count();
        let late = counts.iter().filter(|count| count.is_none()).count();
        format!("{mean}{}{}", of("unconverged", unconverged), of("not in time", late))
    }
}

/// One line per solve: means over its measured systems at the paper's setting (1e-2, rank 10), exact pass. Of
/// a scaled error, which spreads over decades, the median.
pub fn markdown(rows: &[Row]) -> String {
    let mut text = String::from(
        "Exact pass at accuracy 1e-2 and ranks of at most 10, means over the measured Newton systems of each solve (of the scaled error the \
         median); BiCGSTAB to 1e-4.\n\n\
         | n | envelope | density | phase | start | contacts | systems | rank | error with dummies | unscaled | scaled | rank of X | X definite | X | block Jacobi | ILU(0) | IC(0) |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    let at_paper = |row: &&Row| {
        let classic = row.key.cap == 0;
        row.key.reading == BASE.name && (classic || (row.key.accuracy, row.key.cap) == PAPER)
    };
    let chosen: Vec<&Row> = rows.iter().filter(at_paper).collect();
    for rows in chosen.chunk_by(|a, b| a.case == b.case) {
        text += &line(rows);
    }
    text
}

fn line(rows: &[&Row]) -> String {
    let Row { case, solved, .. } = rows[0];
    let solve = Solve { rows: rows.to_vec() };
    let definite: Vec<bool> = solve.of("exact").filter_map(|row| row.figures.definite).collect();
    format!(
        "| {} | {} | {} | {} | {} | {} | {} {} | {} | {} | {} | {} | {} | {} of {} | {} | {} | {} | {} |\n",
        case.n,
        case.envelope,
        case.density,
        case.phase,
        case.start,
        solved.contacts,
        solved.systems,
        solved.status,
        solve.mean(|row| row.figures.rank),
        solve.mean(|row| row.figures.augmented),
        solve.mean(|row| row.figures.unscaled),
        solve.median(|row| row.figures.scaled),
        solve.mean(|row| row.figures.inverse_rank),
        definite.iter().filter(|yes| **yes).count(),
        definite.len(),
        solve.iterations("exact"),
        solve.iterations("block-jacobi"),
        solve.iterations("ilu"),
        solve.iterations("ic"),
    )
}
