//! The report: a table for terminals, Markdown, CSV, and one self-contained HTML page.

use super::bench::Accuracy;
use super::{Case, Definition, Measure, Outcome, Row, named};
use crate::page::begin;
use graintrain_ccp::{Criterion, SolverSpec};
use graintrain_view::plot::axis::number;
use graintrain_view::plot::svg::escape;
use std::fmt::Write as _;
use std::time::{SystemTime, UNIX_EPOCH};

/// What the head of a report says.
#[derive(Clone, Debug)]
pub struct Head {
    /// Version of the program.
    pub version: String,
    /// Day and time, UTC.
    pub date: String,
    /// Operating system, architecture, processors.
    pub machine: String,
    /// The command line.
    pub command: String,
    /// Cases that were to be measured; fewer are in a report that was written on the way.
    pub planned: usize,
}

impl Head {
    /// Of this program, machine and moment.
    pub fn now(command: String, planned: usize) -> Self {
        let processors = std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get);
        let threads = rayon::current_num_threads();
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            date: date(seconds),
            machine: format!(
                "{}, {}, {processors} processors, {threads} threads used",
                std::env::consts::OS,
                std::env::consts::ARCH
            ),
            command,
            planned,
        }
    }

    fn lines(&self, cases: &[Case]) -> Vec<(&'static str, String)> {
        let Accuracy { tolerance, criterion } = Accuracy::SCENES;
        let mut lines = vec![
            ("Version", format!("graintrain {}", self.version)),
            ("Date", self.date.clone()),
            ("Machine", self.machine.clone()),
            ("Command", self.command.clone()),
            ("Solver", SolverSpec::default().to_string()),
            (
                "Tolerance",
                format!("{}; further rows say their own", asked(Accuracy { tolerance, criterion })),
            ),
            ("Result", count(cases)),
        ];
        if cases.len() < self.planned {
            let what = format!("{} of {} cases measured so far", cases.len(), self.planned);
            lines.push(("Incomplete", what));
        }
        lines
    }
}

/// Day and time in UTC from the seconds since 1970. H. Hinnant, "chrono-compatible low-level date
/// algorithms", 2013.
fn date(seconds: u64) -> String {
    let days = seconds / 86_400 + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year + year / 4 - year / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = year + 400 * era + u64::from(month <= 2);
    let (hour, minute) = (seconds % 86_400 / 3600, seconds % 3600 / 60);
    format!("{year}-{month:02}-{day:02} {hour:02}:{minute:02} UTC")
}

/// A tolerance with what it is held against.
fn asked(accuracy: Accuracy) -> String {
    let tolerance = number(accuracy.tolerance);
    match accuracy.criterion {
        Criterion::Mixed => format!("{tolerance} (root mean square; worst contact 20 times that)"),
        Criterion::Maximum => format!("{tolerance} (worst contact)"),
    }
}

/// The same in few characters.
fn asked_short(accuracy: Accuracy) -> String {
    let tolerance = number(accuracy.tolerance);
    match accuracy.criterion {
        Criterion::Mixed => format!("{tolerance} rms"),
        Criterion::Maximum => format!("{tolerance} max"),
    }
}

/// Six digits: differences from the expected value have to show.
fn precise(value: f64) -> String {
    if value == 0.0 {
        "0".into()
    } else if (1e-3..1e5).contains(&value.abs()) {
        format!("{value:.6}")
    } else {
        format!("{value:.3e}")
    }
}

/// What a row ended with, in words.
fn verdict(row: &Row) -> String {
    match row.outcome() {
        Outcome::Passed | Outcome::LeftOut => "passed".into(),
        Outcome::Undecided => format!("undecided (+- {})", number(row.error)),
        Outcome::Failed if row.unsolved > 0 => {
            let all = if row.steps > 0 { format!(" of {}", row.steps) } else { String::new() };
            format!("FAILED ({}{all} solves did not reach their tolerance)", row.unsolved)
        }
        Outcome::Failed => "FAILED".into(),
    }
}

/// Columns of a row.
const COLUMNS: [&str; 8] =
    ["measured", "friction", "dt (s)", "tolerance", "expected", "got", "allowed", "verdict"];

fn cells(row: &Row) -> [String; 8] {
    [
        row.what.clone(),
        row.friction.map_or("none", named).into(),
        if row.step > 0.0 { number(row.step) } else { "\u{2013}".into() },
        asked_short(row.accuracy),
        precise(row.expected),
        precise(row.measured),
        number(row.allowed),
        verdict(row),
    ]
}

/// Numbers of cases and rows, and of those that did not pass.
fn count(cases: &[Case]) -> String {
    let rows = || cases.iter().flat_map(|case| &case.rows);
    let of = |outcome| cases.iter().filter(|case| case.outcome() == outcome).count();
    let rows_of = |outcome| rows().filter(|row| row.outcome() == outcome).count();
    let mut text = format!("{} cases, {} failed", cases.len(), of(Outcome::Failed));
    for (outcome, name) in [(Outcome::Undecided, "undecided"), (Outcome::LeftOut, "left out")] {
        if of(outcome) > 0 {
            let _ = write!(text, ", {} {name}", of(outcome));
        }
    }
    let _ = write!(text, "; {} rows, {} failed", rows().count(), rows_of(Outcome::Failed));
    text
}

/// A Markdown table whose columns also line up as plain text.
fn aligned<const N: usize>(header: [&str; N], body: impl Iterator<Item = [String; N]>) -> String {
    let rows: Vec<[String; N]> = std::iter::once(header.map(String::from)).chain(body).collect();
    let widths: [usize; N] =
        std::array::from_fn(|k| rows.iter().map(|row| row[k].chars().count()).max().unwrap_or(0));
    let mut text = String::new();
    for (k, row) in rows.iter().enumerate() {
        for (cell, width) in row.iter().zip(widths) {
            let cell = cell.replace('|', "\\|");
            let _ = write!(text, "| {cell:width$} ");
        }
        text.push_str("|\n");
        if k == 0 {
            text.extend(widths.map(|width| format!("|{}", "-".repeat(width + 2))));
            text.push_str("|\n");
        }
    }
    text
}

/// All rows as one table, for terminals: cases without set-up and sources.
pub fn table(cases: &[Case]) -> String {
    let header: [&str; 9] = std::array::from_fn(|k| if k == 0 { "" } else { COLUMNS[k - 1] });
    let rows = cases.iter().flat_map(|case| {
        let own = case.rows.iter().map(move |row| {
            let cells = cells(row);
            std::array::from_fn(|k| match k {
                0 => case.definition.id.to_string(),
                1 => format!("{}: {}", case.definition.title, cells[0]),
                _ => cells[k - 1].clone(),
            })
        });
        let whole = whole(case).map(|what| {
            std::array::from_fn(|k| match k {
                0 => case.definition.id.to_string(),
                1 => case.definition.title.to_string(),
                8 => what.clone(),
                _ => String::new(),
            })
        });
        own.chain(whole)
    });
    format!("{}\n{}\n", aligned(header, rows), count(cases))
}

/// What there is to say about a case as a whole.
fn whole(case: &Case) -> Option<String> {
    match (&case.trouble, case.definition.measure) {
        (Some(trouble), _) => Some(format!("FAILED: {trouble}")),
        (None, Measure::LeftOut(why)) => Some(format!("left out: {why}")),
        (None, _) => None,
    }
}

/// The word for how a case ended.
fn ended(case: &Case) -> &'static str {
    outcome_word(case.outcome())
}

fn outcome_word(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Passed => "passed",
        Outcome::LeftOut => "left out",
        Outcome::Undecided => "undecided",
        Outcome::Failed => "FAILED",
    }
}

/// What the report says about itself.
const EXPLANATION: &str = "A row passes where got differs from expected by no more than allowed and every solve reached its \
    tolerance. Rows at the tolerance of scenes (rms) are held to what that promises of the worst contact: velocities to 0.002 g dt, \
    forces to 0.002 of a weight, unless the case allows more; rows at a finer tolerance (max) to the digits of the closed form. \
    Relaxed friction is the cone complementarity problem, coulomb exact Coulomb friction.";

/// The report as Markdown.
pub fn markdown(head: &Head, cases: &[Case]) -> String {
    let mut text = String::from("# Verification\n\n");
    for (name, what) in head.lines(cases) {
        let _ = writeln!(text, "* {name}: {what}");
    }
    let _ = write!(text, "\n{EXPLANATION}\n\n");
    let overview = cases.iter().map(|case| {
        let definition = case.definition;
        [definition.id.into(), definition.title.into(), ended(case).into(), number(case.seconds)]
    });
    text.push_str(&aligned(["", "case", "verdict", "seconds"], overview));
    for case in cases {
        let definition = case.definition;
        let _ = write!(text, "\n## {} {}: {}\n\n", definition.id, definition.title, ended(case));
        let _ = write!(text, "{}\n\n", definition.setup);
        for source in definition.sources {
            let _ = writeln!(text, "Source: {source}.  ");
        }
        text.push('\n');
        if !case.rows.is_empty() {
            text.push_str(&aligned(COLUMNS, case.rows.iter().map(cells)));
        }
        if let Some(what) = whole(case) {
            let _ = writeln!(text, "{what}");
        }
    }
    text
}

/// A text as one field of CSV.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.into() }
}

/// All rows as CSV, for programs: numbers in full, nothing that differs from run to run. A case without rows
/// has one that says why.
pub fn csv(cases: &[Case]) -> String {
    let mut text = String::from(
        "id,case,measured,friction,solver,step,tolerance,criterion,expected,got,allowed,error,steps,unsolved,verdict\n",
    );
    for case in cases {
        let Definition { id, title, .. } = case.definition;
        let title = quoted(title);
        for row in &case.rows {
            let criterion = match row.accuracy.criterion {
                Criterion::Mixed => "mixed",
                Criterion::Maximum => "maximum",
            };
            let _ = writeln!(
                text,
                "{id},{title},{},{},{},{},{:e},{criterion},{:e},{:e},{:e},{:e},{},{},{}",
                quoted(&row.what),
                row.friction.map_or("none", named),
                row.solver,
                row.step,
                row.accuracy.tolerance,
                row.expected,
                row.measured,
                row.allowed,
                row.error,
                row.steps,
                row.unsolved,
                outcome_word(row.outcome()),
            );
        }
        if let Some(what) = whole(case) {
            let _ = writeln!(text, "{id},{title}{}{}", ",".repeat(13), quoted(&what));
        }
    }
    text
}

fn class(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Passed => "passed",
        Outcome::LeftOut => "left",
        Outcome::Undecided => "undecided",
        Outcome::Failed => "failed",
    }
}

/// The report as one HTML page that needs nothing else.
pub fn html(head: &Head, cases: &[Case]) -> String {
    let mut text = begin(&format!("Verification of graintrain {}", head.version)) + "<table>\n";
    for (name, what) in head.lines(cases) {
        let _ = writeln!(text, "<tr><th>{name}</th><td>{}</td></tr>", escape(&what));
    }
    let _ = write!(text, "</table>\n<p>{}</p>\n<table>\n", escape(EXPLANATION));
    text.push_str("<tr><th></th><th>case</th><th>verdict</th><th>seconds</th></tr>\n");
    for case in cases {
        let (id, title) = (case.definition.id, escape(case.definition.title));
        let _ = writeln!(
            text,
            "<tr><td><a href=\"#{id}\">{id}</a></td><td>{title}</td><td class=\"{}\">{}</td><td class=\"n\">{}</td></tr>",
            class(case.outcome()),
            ended(case),
            number(case.seconds)
        );
    }
    text.push_str("</table>\n");
    let mut last = "";
    for case in cases {
        let definition = case.definition;
        let id = definition.id;
        // Cases of one number follow each other.
        let anchor = if id == last { String::new() } else { format!(" id=\"{id}\"") };
        last = id;
        let _ = write!(
            text,
            "<h2{anchor}>{id} {}: <span class=\"{}\">{}</span></h2>\n<p>{}</p>\n",
            escape(definition.title),
            class(case.outcome()),
            ended(case),
            escape(definition.setup)
        );
        for source in definition.sources {
            let _ = writeln!(text, "<p class=\"source\">Source: {}.</p>", escape(&source.to_string()));
        }
        if !case.rows.is_empty() {
            text.push_str("<table>\n<tr>");
            text.extend(COLUMNS.map(|name| format!("<th>{name}</th>")));
            text.push_str("</tr>\n");
            for row in &case.rows {
                text.push_str("<tr>");
                for (k, cell) in cells(row).iter().enumerate() {
                    let class = if k == 7 {
                        class(row.outcome())
                    } else if k > 1 {
                        "n"
                    } else {
                        ""
                    };
                    let _ = write!(text, "<td class=\"{class}\">{}</td>", escape(cell));
                }
                text.push_str("</tr>\n");
            }
            text.push_str("</table>\n");
        }
        if let Some(what) = whole(case) {
            let _ = writeln!(text, "<p class=\"{}\">{}</p>", class(case.outcome()), escape(&what));
        }
    }
    text.push_str("</body></html>\n");
    text
}

#[cfg(test)]
mod tests {
    #[test]
    fn dates_are_those_of_the_calendar() {
        assert_eq!(super::date(0), "1970-01-01 00:00 UTC");
        assert_eq!(super::date(951_782_400), "2000-02-29 00:00 UTC");
        assert_eq!(super::date(1_795_334_400 + 3660), "2026-11-22 09:01 UTC");
    }
}
