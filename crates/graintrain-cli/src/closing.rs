//! What a run says at its end: five lines that need no manual, and the figures behind them.

use crate::progress::passed;
use graintrain_ccp::FrictionModel;
use graintrain_ccp::residual::MIXED_MAXIMUM;
use graintrain_io::output::summary::{RunStatus, Summary};
use graintrain_io::quantity::Figures;
use std::fmt::Write as _;
use std::path::Path;

/// What ran, how far, what to trust, where it is, what to do next.
pub fn lines(summary: &Summary, folder: &Path) -> String {
    let folder = folder.display();
    let (verdict, next) = match summary.status {
        RunStatus::Finished => (
            "is done",
            format!(
                "graintrain view {folder} (replay), graintrain render {folder} (picture), graintrain plot {folder} (curves)"
            ),
        ),
        RunStatus::Stopped => ("was stopped", format!("graintrain resume {folder}")),
        RunStatus::Running | RunStatus::Failed => ("ended early", format!("graintrain resume {folder}")),
    };
    // To the digits of the clock of a scene.
    let simulated: f64 = format!("{:.4}", summary.simulated_seconds).parse().unwrap_or_default();
    format!(
        "\n{} {verdict}: {} of {}, {simulated} s simulated in {}\n  At the end  {}\n  Trust       {}\n  Files       {folder}: all.pvd (ParaView, \
         OVITO), tables (steps.csv and others), all figures of the run (summary.json)\n  Next        {next}\n",
        summary.scene,
        counted(summary.steps, "step", "steps"),
        duration(summary.step),
        duration(summary.wall_seconds),
        at_the_end(summary),
        trust(summary),
    )
}

/// What there is after the last step.
fn at_the_end(summary: &Summary) -> String {
    let mut text = format!(
        "{}, {}, kinetic energy {} J",
        counted(summary.bodies as u64, "body", "bodies"),
        counted(summary.figures.contacts_final, "contact", "contacts"),
        number(summary.kinetic_energy)
    );
    if let Some(stage) = summary.stages.last() {
        let _ = write!(text, ", stage `{}`", stage.name);
    }
    for stream in &summary.streams {
        let _ = write!(text, "; {} came through `{}`", stream.bodies, stream.name);
    }
    for outlet in &summary.outlets {
        let _ = write!(text, "; {} left through `{}`", outlet.bodies, outlet.name);
    }
    text
}

/// A larger share of contacts that pressed though their bodies were apart is reported.
const APART: f64 = 1e-3;

/// A larger sum of shares of an angular momentum that were lost is reported.
const LOST: f64 = 0.01;

/// Whether what is left undone is no matter of accuracy any more: a tenth of the steps, or a tenth of a body.
fn is_wrong(summary: &Summary) -> bool {
    let Figures { unconverged_steps, penetration_max_over_radius, .. } = summary.figures;
    10 * unconverged_steps > summary.steps || penetration_max_over_radius > 0.1
}

/// Whether the answers are what was asked for, and how far from exact geometry they are.
fn trust(summary: &Summary) -> String {
    let asked = number(summary.tolerance);
    let worst = summary.figures.residual_rms_max;
    let solved = match summary.figures.unconverged_steps {
        0 => format!("every step reached its tolerance ({asked})"),
        unconverged => format!(
            "{}: {unconverged} of {} did not reach the tolerance ({asked}; {})",
            if is_wrong(summary) { "no" } else { "not fully" },
            counted(summary.steps, "step", "steps"),
            match worst > summary.tolerance {
                true => format!("{} at worst", number(worst)),
                false => "the root mean square does: the column `status` and the warning say what does not"
                    .to_string(),
            }
        ),
    };
    let met = match summary.figures.contacts_missed {
        0 => "no body passed through another".to_string(),
        pairs => passed(pairs),
    };
    let overlap = match summary.figures.penetration_max_over_radius {
        0.0 => "none overlap".to_string(),
        share => format!("the deepest overlap was {} of a radius", percent(share)),
    };
    let apart = match summary.contacts_apart_share {
        share if share > APART => {
            format!(", {} of the contacts with force pressed though their bodies were apart", percent(share))
        }
        _ => String::new(),
    };
    let lowered = match summary.figures.restitution_lowered {
        0 => String::new(),
        parts => format!(
            ", restitution was lowered in {} (shorter steps may help)",
            counted(parts, "group of impacts", "groups of impacts")
        ),
    };
    let lost = match summary.figures.momentum_lost {
        sum if sum > LOST => format!(
            ", of bodies that turned by more than 1 rad in a step {} of the angular momentum changed without a torque (shorter steps help)",
            percent(sum)
        ),
        _ => String::new(),
    };
    format!("{solved}, {met}, {overlap}{apart}{lowered}{lost}")
}

/// The figures of the run, a name and a value per line.
pub fn details(summary: &Summary) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(text, "  {name:<12} {value}");
    };
    line(
        "contacts",
        format!(
            "{} in the last step, {:.0} on average, {} at most",
            summary.figures.contacts_final, summary.figures.contacts_mean, summary.figures.contacts_max
        ),
    );
    for (name, value) in errors(summary) {
        line(name, value);
    }
    for (name, value) in events(summary) {
        line(name, value);
    }
    if let Some(bytes) = summary.peak_memory_bytes {
        line("memory", format!("{:.0} MB at most", bytes as f64 / 1e6));
    }
    let phases = &summary.phases;
    let named = [
        ("collide", phases.collide),
        ("assemble", phases.assemble),
        ("solve", phases.solve),
        ("integrate", phases.integrate),
        ("output", phases.output),
    ];
    let total: f64 = named.iter().map(|(_, seconds)| seconds).sum();
    for (name, seconds) in named {
        let share = if total > 0.0 { seconds / total } else { 0.0 };
        let bar = "#".repeat((30.0 * share).round() as usize);
        let _ = writeln!(text, "  {name:<12} {:>9}  {bar}", duration(seconds));
    }
    text
}

/// How far the steps are from exact ones.
fn errors(summary: &Summary) -> Vec<(&'static str, String)> {
    let maximum = match summary.strict_max {
        true => format!("{} for the worst contact", number(summary.tolerance)),
        false => format!(
            "{} for the mean and {} for the worst contact",
            number(summary.tolerance),
            number(MIXED_MAXIMUM * summary.tolerance)
        ),
    };
    let mut reported = vec![
        (
            "residual",
            format!(
                "mean {} in the worst step, {} at the worst contact; asked was {maximum} ({})",
                number(summary.figures.residual_rms_max),
                number(summary.figures.residual_max),
                summary.solver
            ),
        ),
        (
            "overlap",
            format!(
                "{} of the smaller body's radius in the last step, {} at most",
                percent(summary.figures.penetration_final_over_radius),
                percent(summary.figures.penetration_max_over_radius)
            ),
        ),
        (
            "closing",
            format!(
                "contacts still close at {} m/s at most, {} of the smaller body's radius per step",
                number(summary.figures.velocity_error_max),
                percent(summary.figures.overlap_per_step_max_over_radius)
            ),
        ),
        (
            "friction",
            format!(
                "outside of its cone by {} of the contact's force at most, off the slip by {} degrees at most",
                percent(summary.figures.friction_error_max),
                number(summary.figures.slip_angle_max.to_degrees())
            ),
        ),
    ];
    if summary.friction == FrictionModel::Relaxed {
        reported.push((
            "relaxation",
            "the paper's model: what slides is lifted by mu times its slip; `--friction coulomb` does not"
                .to_string(),
        ));
    }
    reported
}

/// What happened: stages, streams, outlets.
fn events(summary: &Summary) -> Vec<(&'static str, String)> {
    let mut reported = Vec::new();
    for stage in &summary.stages {
        let last = stage.last_step.map_or("the end".to_string(), |last| last.to_string());
        reported.push(("stage", format!("`{}`: steps {} to {last}", stage.name, stage.first_step + 1)));
    }
    for stream in &summary.streams {
        let waited = match stream.steps_waited {
            0 => String::new(),
            steps => format!("; in {} a body found no free place", counted(steps, "step", "steps")),
        };
        let bodies = counted(stream.bodies, "body", "bodies");
        reported.push(("stream", format!("`{}`: {bodies}, {} kg{waited}", stream.name, number(stream.mass))));
    }
    for outlet in &summary.outlets {
        let bodies = counted(outlet.bodies, "body", "bodies");
        reported.push(("outlet", format!("`{}`: {bodies}, {} kg", outlet.name, number(outlet.mass))));
    }
    reported
}

/// 1 step, 2 steps.
pub fn counted(count: u64, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// Two digits that count, with a power of ten only where a plain number has many zeros.
fn number(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        "0".to_string()
    } else if !(1e-3..1e5).contains(&size) {
        format!("{value:.0e}")
    } else if size >= 10.0 {
        format!("{value:.0}")
    } else {
        format!("{value:.1e}").parse::<f64>().unwrap_or(value).to_string()
    }
}

/// A share for people: 31 %, 0.42 %; what is too small to matter is reported as such.
fn percent(share: f64) -> String {
    match 100.0 * share {
        0.0 => "0 %".to_string(),
        small if small.abs() < 1e-3 => "less than 0.001 %".to_string(),
        value => format!("{} %", number(value)),
    }
}

/// Seconds for people: 12.3 ms, 4.56 s, 3 min 20 s, 2 h 5 min.
fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    let plain = |value: f64, unit: &str| {
        let digits: f64 = format!("{value:.2e}").parse().unwrap_or(value);
        format!("{digits} {unit}")
    };
    match whole {
        _ if seconds < 1e-3 => plain(1e6 * seconds, "us"),
        _ if seconds < 1.0 => plain(1e3 * seconds, "ms"),
        0..120 => plain(seconds, "s"),
        120..7200 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_reported_in_the_unit_that_fits() {
        let reported = [2e-5, 0.005, 0.0123, 4.561, 5.0, 200.0, 7500.0].map(duration);
        assert_eq!(reported, ["20 us", "5 ms", "12.3 ms", "4.56 s", "5 s", "3 min 20 s", "2 h 5 min"]);
    }

    /// Powers of ten only where a plain number has many zeros: "3.1e1 %" was reported.
    #[test]
    fn numbers_are_plain_where_people_read_them() {
        let reported = [0.0, 31.0, 0.31, 0.0996, 0.99, 9.96, 12345.6, 3.1e-8, 2.5e7].map(number);
        assert_eq!(reported, ["0", "31", "0.31", "0.1", "0.99", "10", "12346", "3e-8", "2e7"]);
        let reported = [0.0, 1.1e-16, 0.0042, 0.31].map(percent);
        assert_eq!(reported, ["0 %", "less than 0.001 %", "0.42 %", "31 %"]);
        assert_eq!(counted(1, "step", "steps"), "1 step");
    }
}
