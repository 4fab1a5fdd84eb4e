//! The paper's claims, judged by what was measured here. All words follow from the numbers.

use super::physics::{friction_ratio_over_seeds, sensitivities};
use super::published as paper;
use super::solves::{ReuseRow, Solve, TOLERANCE};
use super::trajectory::{Experiment, Variant};
use super::{Results, TRAIN_METHODS};
use crate::plot::axis::number;

/// Whether a claim holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The measurements agree.
    Holds,
    /// They contradict.
    Fails,
    /// They cannot tell: too small, or not measured.
    Open,
}

impl Verdict {
    /// In a word or two.
    pub fn word(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::Fails => "does not hold",
            Self::Open => "not decided",
        }
    }

    fn of(holds: bool) -> Self {
        if holds { Self::Holds } else { Self::Fails }
    }
}

/// A claim with its judgement.
#[derive(Clone, Debug)]
pub struct Claim {
    /// Where the paper makes it; "this project" for goals of our own.
    pub place: &'static str,
    /// What it says.
    pub statement: String,
    /// Whether it holds.
    pub verdict: Verdict,
    /// What was measured.
    pub evidence: String,
}

/// c and p of y = c x^p by least squares in logarithms; `None` for fewer than three points or no spread.
pub fn power_law(points: &[[f64; 2]]) -> Option<[f64; 2]> {
    let logs: Vec<[f64; 2]> =
        points.iter().filter(|p| p[0] > 0.0 && p[1] > 0.0).map(|p| [p[0].ln(), p[1].ln()]).collect();
    let count = logs.len() as f64;
    let mean = |k: usize| logs.iter().map(|p| p[k]).sum::<f64>() / count;
    let (mx, my) = (mean(0), mean(1));
    let spread: f64 = logs.iter().map(|p| (p[0] - mx).powi(2)).sum();
    let slope = logs.iter().map(|p| (p[0] - mx) * (p[1] - my)).sum::<f64>() / spread;
    (logs.len() >= 3 && spread > 1e-6).then(|| [(my - slope * mx).exp(), slope])
}

/// Ratios "time of a / time of b" on problems that b solved, by contacts; where a missed the tolerance within its time
/// limit its ratio is a lower bound.
fn ratios(results: &Results, experiments: &[Experiment], a: &str, b: &str) -> Vec<Ratio> {
    let of = |method: &str| -> Vec<&Solve> {
        let wanted = |solve: &&Solve| {
            solve.method == method
                && experiments.iter().any(|experiment| experiment.scene() == solve.experiment)
        };
        results.solves.iter().filter(wanted).collect()
    };
    let mut ratios: Vec<Ratio> = of(b)
        .into_iter()
        .filter(|second| second.converged())
        .filter_map(|second| {
            let same = |first: &&Solve| {
                (&first.experiment, first.n, first.step) == (&second.experiment, second.n, second.step)
            };
            let first = of(a).into_iter().find(same)?;
            let value = first.seconds / second.seconds;
            Some(Ratio { contacts: second.contacts, value, is_bound: !first.converged() })
        })
        .collect();
    ratios.sort_by_key(|ratio| ratio.contacts);
    ratios
}

struct Ratio {
    contacts: usize,
    value: f64,
    is_bound: bool,
}

impl Ratio {
    fn text(&self) -> String {
        format!("{}{}", if self.is_bound { "at least " } else { "" }, number(self.value))
    }
}

fn of_method<'a>(results: &'a Results, method: &str) -> impl Iterator<Item = &'a Solve> + use<'a> {
    let method = method.to_string();
    results.solves.iter().filter(move |solve| solve.method == method)
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// All claims for which this reproduction has or should have figures.
pub fn judge(results: &Results) -> Vec<Claim> {
    let mut claims = vec![ranks(results)];
    claims.extend(crossover(results, "pdip+tt-cross", "the literal recipe"));
    claims.extend(crossover(results, "pdip+tt", "the best tensor train found here"));
    claims.push(others(results));
    claims.push(precompute_growth(results));
    claims.push(factorisations(results));
    claims.push(inner_iterations(results));
    claims.extend(TRAIN_METHODS.iter().filter_map(|method| reuse(results, method)));
    claims.push(persistence(results));
    claims.push(fastest(results));
    claims.extend(physical(results));
    claims
}

fn open(place: &'static str, statement: String, why: &str) -> Claim {
    Claim { place, statement, verdict: Verdict::Open, evidence: why.to_string() }
}

fn ranks(results: &Results) -> Claim {
    let statement = "At eps = 1e-2 and ranks up to 10, mean ranks of S and of its inverse are 4.6 and 4.4: the matrices \
                     are highly compressible.";
    let cell = results.ranks[0][0].as_ref().or_else(|| of_method(results, "pdip+tt-cross").last());
    let figure = |name: &str| cell.and_then(|solve| solve.figures.get(name).copied());
    let (Some(matrix), Some(inverse)) = (figure("rank_matrix"), figure("rank_inverse")) else {
        return open(
            "Table 3",
            statement.into(),
            "No ranks were measured (pdip+tt-cross is missing or was not asked for).",
        );
    };
    let error = figure("compression_error");
    let small = matrix <= 10.5 && inverse <= 10.5;
    let accurate = error.is_none_or(|error| error <= 0.1);
    let with_error = error.map_or("its compression error was not measured".to_string(), |error| {
        format!("the measured error of the compression is {}, asked for was 0.01", number(error))
    });
    Claim {
        place: "Table 3",
        statement: statement.into(),
        verdict: Verdict::of(small && accurate),
        evidence: format!(
            "Mean ranks here: {} and {}; {with_error}.{}",
            number(matrix),
            number(inverse),
            if accurate { "" } else { " Small ranks alone do not show that the matrix is compressible." }
        ),
    }
}

fn crossover(results: &Results, method: &str, words: &str) -> Option<Claim> {
    let statement = format!(
        "With {words} ({method}) a solve is faster than with ILU from about 20 000 contacts on, and 10 times faster at the \
         largest sizes."
    );
    let ratios = ratios(results, &[Experiment::Sedimentation], "pdip+ilu", method);
    let Some(last) = ratios.last() else {
        return unsolved(results, method, statement);
    };
    let share = ratios.iter().filter(|ratio| ratio.value > 1.0).count();
    let evidence = format!(
        "ILU's time over that of {method}: {} at the largest problem both were given ({} contacts); above 1 in {share} of \
         {} problems.",
        last.text(),
        last.contacts,
        ratios.len()
    );
    let large = last.contacts as f64 >= paper::CROSSOVER_CONTACTS;
    let verdict = if large { Verdict::of(last.value >= paper::FINAL_SPEEDUP / 2.0) } else { Verdict::Open };
    let evidence = if large {
        evidence
    } else {
        format!("{evidence} The claim is about more contacts than were simulated here: ask for a larger --n.")
    };
    Some(Claim { place: "Fig. 10", statement, verdict, evidence })
}

/// The judgement where a method reached the tolerance nowhere: it fails where ILU got there, otherwise nothing is decided.
fn unsolved(results: &Results, method: &str, statement: String) -> Option<Claim> {
    let tried = of_method(results, method).max_by_key(|solve| solve.contacts)?;
    let ilu = of_method(results, "pdip+ilu")
        .find(|ilu| (ilu.n, ilu.step, &ilu.experiment) == (tried.n, tried.step, &tried.experiment))?;
    let text = |solve: &Solve| match solve.residual {
        Some(residual) => format!(
            "residual {} after {} s and {} Newton iterations",
            number(residual),
            number(solve.seconds),
            solve.iterations
        ),
        None => format!("no answer within {} s", number(solve.seconds)),
    };
    let evidence = format!(
        "{method} reached the tolerance on none of its problems. On the largest ({} contacts): {}; ILU: {}{}.",
        tried.contacts,
        text(tried),
        text(ilu),
        if ilu.converged() { "" } else { ", not converged either" }
    );
    let verdict = if ilu.converged() { Verdict::Fails } else { Verdict::Open };
    Some(Claim { place: "Fig. 10", statement, verdict, evidence })
}

fn others(results: &Results) -> Claim {
    let statement =
        "In drafting and direct shear the tensor train is 5 to 10 times faster than ILU at the end."
            .to_string();
    let experiments = [Experiment::Drafting, Experiment::DirectShear];
    let literal = ratios(results, &experiments, "pdip+ilu", "pdip+tt-cross");
    let best = ratios(results, &experiments, "pdip+ilu", "pdip+tt");
    let text = |ratios: &[Ratio], method: &str| {
        ratios.last().map(|last| format!("{} for {method} at {} contacts", last.text(), last.contacts))
    };
    let found: Vec<String> =
        [text(&literal, "pdip+tt-cross"), text(&best, "pdip+tt")].into_iter().flatten().collect();
    let Some(last) = literal.last().or(best.last()) else {
        return open(
            "Fig. 15",
            statement,
            "No problem of these experiments was solved by a tensor-train method here.",
        );
    };
    let large = last.contacts as f64 >= paper::CROSSOVER_CONTACTS;
    Claim {
        place: "Fig. 15",
        statement,
        verdict: if large {
            Verdict::of(last.value >= paper::FINAL_SPEEDUP_OTHERS[0])
        } else {
            Verdict::Open
        },
        evidence: format!(
            "ILU's time over that of the tensor train: {}.{}",
            found.join("; "),
            if large { "" } else { " The problems here are smaller than the paper's." }
        ),
    }
}

fn precompute_growth(results: &Results) -> Claim {
    let statement =
        "Tensor-train precomputation takes 5 to 15 s per step and is nearly independent of the number of \
                     contacts."
            .to_string();
    let points: Vec<[f64; 2]> = of_method(results, "pdip+tt-cross")
        .filter(|solve| solve.iterations > 0)
        .map(|solve| [solve.contacts as f64, solve.precompute_seconds / solve.iterations as f64])
        .collect();
    let Some([_, exponent]) = power_law(&points) else {
        return open("Fig. 11", statement, "pdip+tt-cross was not measured on three problems.");
    };
    let ilu: Vec<[f64; 2]> = of_method(results, "pdip+ilu")
        .filter(|solve| solve.iterations > 0)
        .map(|solve| [solve.contacts as f64, solve.precompute_seconds / solve.iterations as f64])
        .collect();
    let with_ilu =
        power_law(&ilu).map_or(String::new(), |[_, p]| format!(" (for ILU the exponent is {})", number(p)));
    let range = |k: usize| {
        points.iter().fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), p| (low.min(p[k]), high.max(p[k])))
    };
    Claim {
        place: "Fig. 11",
        statement,
        verdict: Verdict::of(exponent < 0.3),
        evidence: format!(
            "Per factorisation, pdip+tt-cross takes {} to {} s between {} and {} contacts, growing like their power {}{with_ilu}.",
            number(range(1).0),
            number(range(1).1),
            number(range(0).0),
            number(range(0).1),
            number(exponent)
        ),
    }
}

fn factorisations(results: &Results) -> Claim {
    let statement = "A step takes 50 to 100 factorisations (Newton iterations).".to_string();
    let solved = results.solves.iter().filter(|s| s.method.starts_with("pdip") && s.converged());
    let counts: Vec<f64> = solved.map(|solve| solve.iterations as f64).collect();
    let Some(mean) = mean(counts.iter().copied()) else {
        return open("Sec. 4.2.1", statement, "No pdip solve reached the tolerance here.");
    };
    let most = counts.iter().copied().fold(0.0, f64::max);
    let [low, high] = paper::FACTORISATIONS;
    Claim {
        place: "Sec. 4.2.1",
        statement,
        verdict: Verdict::of(mean >= 0.5 * low && mean <= 1.5 * high),
        evidence: format!(
            "Mean {} and at most {} Newton iterations in {} converged pdip solves to residual {TOLERANCE:e} \
             (a mean between {} and {} counts as agreement).",
            number(mean),
            number(most),
            counts.len(),
            number(0.5 * low),
            number(1.5 * high)
        ),
    }
}

fn inner_iterations(results: &Results) -> Claim {
    let statement = "ILU needs up to 8 times more BICGSTAB iterations than the tensor train; without preconditioner the cap \
                     of 1000 is often reached."
        .to_string();
    let largest = |method: &str| {
        of_method(results, method).filter(|solve| solve.inner_mean > 0.0).max_by_key(|solve| solve.contacts)
    };
    let (Some(ilu), Some(train)) = (largest("pdip+ilu"), largest("pdip+tt-cross")) else {
        return open("Fig. 12", statement, "ILU and the tensor train were not both measured.");
    };
    let none = largest("pdip+none").map_or(String::new(), |none| {
        format!(
            " Without preconditioner: {} on average, {} % of the solves missed their tolerance.",
            number(none.inner_mean),
            number(100.0 * none.missed)
        )
    });
    let train_missed = if train.missed > 0.0 {
        format!(" ({} % of its linear solves missed their tolerance)", number(100.0 * train.missed))
    } else {
        String::new()
    };
    let ratio = ilu.inner_mean / train.inner_mean;
    Claim {
        place: "Fig. 12",
        statement,
        verdict: Verdict::of(ratio > 1.0 && train.missed < 0.1),
        evidence: format!(
            "At {} contacts: ILU {} iterations per Newton iteration, the literal tensor train {}{train_missed}: ratio {}.{none}",
            ilu.contacts,
            number(ilu.inner_mean),
            number(train.inner_mean),
            number(ratio)
        ),
    }
}

fn reuse(results: &Results, method: &str) -> Option<Claim> {
    let (_, rows) = results.reuse.iter().find(|(name, _)| name == method)?;
    let statement = format!("Re-use makes precomputation of a step 10 to 15 times cheaper ({method}).");
    // The first step has nothing to re-use.
    let later = rows.get(1..).unwrap_or_default();
    let factor = |pick: fn(&ReuseRow) -> [f64; 2]| {
        let [kept, fresh] =
            later.iter().fold([0.0; 2], |sum, row| [sum[0] + pick(row)[0], sum[1] + pick(row)[1]]);
        (kept > 0.0).then(|| fresh / kept)
    };
    let (Some(total), Some(first)) = (factor(|row| row.total), factor(|row| row.first)) else {
        return Some(open("Fig. 8", statement, "No precomputation was measured in consecutive steps."));
    };
    let error = |k: usize| mean(later.iter().filter_map(|row| row.error[k]));
    let errors = match (error(0), error(1)) {
        (Some(kept), Some(fresh)) => {
            format!(" Compression error {} with and {} without.", number(kept), number(fresh))
        }
        _ => String::new(),
    };
    Some(Claim {
        place: "Fig. 8",
        statement,
        verdict: Verdict::of(total >= paper::REUSE_FACTOR[0] / 2.0),
        evidence: format!(
            "Over {} consecutive steps a solver that keeps its trains from step to step needs {} times less precomputation per Newton iteration \
             than one that starts anew each step ({} times in the first Newton iteration).{errors} Hot starts between Newton \
             iterations of a step are on in both.",
            later.len(),
            number(total),
            number(first)
        ),
    })
}

fn persistence(results: &Results) -> Claim {
    let statement = "Over 90 % of the contacts persist from step to step once settled.".to_string();
    let Some(trajectory) = results.trajectory(Experiment::Sedimentation, Variant::Paper) else {
        return open("Sec. 3.3", statement, "The sedimentation was not simulated.");
    };
    let rows = &trajectory.rows[trajectory.rows.len() / 2..];
    let share = mean(rows.iter().map(|row| row.persistent)).unwrap_or(0.0);
    Claim {
        place: "Sec. 3.3",
        statement,
        verdict: Verdict::of(share >= paper::PERSISTENCE),
        evidence: format!(
            "{} % on average over the second half of the sedimentation (contacts within the envelope).",
            number(100.0 * share)
        ),
    }
}

fn fastest(results: &Results) -> Claim {
    let statement =
        "The fastest solver here takes at least 10 times less time than pdip+ilu from 20 000 contacts on.";
    let all = Experiment::ALL;
    let best = ["ipm", "auto"].map(|method| (method, ratios(results, &all, "pdip+ilu", method)));
    let found: Vec<String> = best
        .iter()
        .filter_map(|(method, ratios)| {
            let last = ratios.last()?;
            Some(format!("{method}: {} at {} contacts", last.text(), last.contacts))
        })
        .collect();
    let strongest =
        best.iter().filter_map(|(_, ratios)| ratios.last()).max_by(|a, b| a.value.total_cmp(&b.value));
    let Some(strongest) = strongest else {
        return open("this project", statement.into(), "No problem was solved by both.");
    };
    let large = strongest.contacts as f64 >= paper::CROSSOVER_CONTACTS;
    let holds = strongest.value >= 10.0;
    Claim {
        place: "this project",
        statement: statement.into(),
        verdict: if large { Verdict::of(holds) } else { Verdict::Open },
        evidence: format!(
            "Time of pdip+ilu over that of {}.{}",
            found.join("; "),
            if large { "" } else { " The problems here are smaller than the goal's." }
        ),
    }
}

fn physical(results: &Results) -> Vec<Claim> {
    let mut claims = Vec::new();
    for sensitivity in sensitivities(results).iter().filter(|s| s.variant != Variant::Coulomb) {
        let change = match sensitivity.variant {
            Variant::HalfStep => "half the time step",
            _ => "a tenth of the tolerance",
        };
        let (value, uncertainty) = (sensitivity.change(), sensitivity.uncertainty());
        let goal = 0.05;
        claims.push(Claim {
            place: "this project",
            statement: format!(
                "Steady force in {} changes by less than 5 % with {change}.",
                sensitivity.experiment.scene()
            ),
            // A change known no better than the goal decides nothing, nor does one whose own error explains the excess.
            verdict: if value.abs() - 2.0 * uncertainty > goal {
                Verdict::Fails
            } else if value.abs() <= goal && uncertainty <= goal {
                Verdict::Holds
            } else {
                Verdict::Open
            },
            evidence: format!(
                "{} N to {} N: {} %, statistical error {} %.",
                number(sensitivity.paper.mean),
                number(sensitivity.changed.mean),
                number(100.0 * value),
                number(100.0 * uncertainty)
            ),
        });
    }
    for variant in [Variant::Paper, Variant::Coulomb] {
        let Some(ratio) = friction_ratio_over_seeds(results, variant) else {
            continue;
        };
        claims.push(Claim {
            place: "this project",
            statement: format!(
                "The friction angle of the sheared sample ({} friction) is physical: 10 to 35 degrees.",
                variant.name()
            ),
            verdict: Verdict::of((10.0..=35.0).contains(&ratio.mean.atan().to_degrees())),
            evidence: format!(
                "Shear force over normal force on the lower half {} +- {}: {} degrees.",
                number(ratio.mean),
                number(ratio.error),
                number(ratio.mean.atan().to_degrees())
            ),
        });
    }
    let worst = results
        .trajectories
        .iter()
        .flat_map(|(_, t)| &t.rows)
        .map(|row| row.momentum_error)
        .fold(0.0, f64::max);
    if !results.trajectories.is_empty() {
        claims.push(Claim {
            place: "this project",
            statement: "The momentum of every body is balanced exactly in every step.".into(),
            verdict: Verdict::of(worst < 1e-9),
            evidence: format!(
                "Largest defect of Newton's second law for a free body: {} of the impulses on it.",
                number(worst)
            ),
        });
    }
    claims
}
