//! Verdicts on the paper's claims, by what was measured here. All words follow from the numbers.

mod physical;

use super::published as paper;
use super::solves::{ReuseRow, Solve, TOLERANCE};
use super::trajectory::{Experiment, Variant};
use super::{Results, TRAIN_METHODS};
use graintrain_view::plot::axis::number;

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

    /// Of "the value is at most `goal` in size", for a value with a standard error: a change known no better
    /// than the goal decides nothing, nor does one whose own error explains the excess.
    pub fn within(goal: f64, value: f64, error: f64) -> Self {
        if value.abs() - 2.0 * error > goal {
            Self::Fails
        } else if value.abs() <= goal && error <= goal {
            Self::Holds
        } else {
            Self::Open
        }
    }
}

/// A claim with its verdict.
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

/// Ratios "time of a / time of b" on problems that b solved, by contacts; where a did not reach the tolerance
/// within its time limit its ratio is a lower bound.
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

    /// Whether the ratio reaches a goal for problems as large as the paper's; a lower bound below the goal
    /// says nothing.
    fn reaches(&self, goal: f64) -> Verdict {
        if (self.contacts as f64) < paper::CROSSOVER_CONTACTS || (self.is_bound && self.value < goal) {
            Verdict::Open
        } else {
            Verdict::of(self.value >= goal)
        }
    }

    /// A remark on problems that are smaller than the paper's.
    fn remark(&self) -> &'static str {
        if (self.contacts as f64) < paper::CROSSOVER_CONTACTS {
            " The claim is about more contacts than were simulated here: ask for a larger --n."
        } else {
            ""
        }
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
pub fn verdicts(results: &Results) -> Vec<Claim> {
    let mut claims = vec![ranks(results)];
    for (method, words) in
        [("pdip+tt-cross", "the literal recipe"), ("pdip+tt", "the best tensor-train solver found here")]
    {
        claims.extend(crossover(results, method, words));
        claims.extend(others(results, method, words));
    }
    claims.push(precompute_growth(results));
    claims.push(factorisations(results));
    claims.push(inner_iterations(results));
    claims.extend(TRAIN_METHODS.iter().filter_map(|method| reuse(results, method)));
    claims.push(persistence(results));
    claims.push(fastest(results));
    claims.extend(physical::verdicts(results));
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
            "Mean ranks here: {} and {}; {with_error}.{}{}",
            number(matrix),
            number(inverse),
            cell.map_or(String::new(), replaced),
            if accurate { "" } else { " Small ranks alone do not show that the matrix is compressible." }
        ),
    }
}

/// Part of the Newton iterations in which no useful inverse was found; a multiple of the identity took its
/// place.
fn diverged(solve: &Solve) -> f64 {
    solve.figures.get("inversion_diverged").copied().unwrap_or(0.0)
}

/// A sentence on [`diverged`].
fn replaced(solve: &Solve) -> String {
    match diverged(solve) {
        0.0 => String::new(),
        share => format!(
            " In {} % of the Newton iterations the inversion diverged, and a multiple of the identity took the inverse's place.",
            number(100.0 * share)
        ),
    }
}

fn crossover(results: &Results, method: &str, words: &str) -> Option<Claim> {
    let statement = format!(
        "With {words} ({method}) a solve is faster than with ILU from about 20 000 contacts on, and 10 times faster at the \
         largest sizes (half of it counts as agreement)."
    );
    speed(results, "Fig. 10", statement, &[Experiment::Sedimentation], method, paper::FINAL_SPEEDUP / 2.0)
}

fn others(results: &Results, method: &str, words: &str) -> Option<Claim> {
    let statement = format!(
        "In drafting and direct shear {words} ({method}) is 5 to 10 times faster than ILU at the end."
    );
    let experiments = [Experiment::Drafting, Experiment::DirectShear];
    speed(results, "Fig. 15", statement, &experiments, method, paper::FINAL_SPEEDUP_OTHERS[0])
}

/// Whether a tensor-train method beats ILU by a factor on the largest problem it was given; `None` where it
/// was given none.
fn speed(
    results: &Results,
    place: &'static str,
    statement: String,
    experiments: &[Experiment],
    method: &str,
    goal: f64,
) -> Option<Claim> {
    let among = |solve: &&Solve| experiments.iter().any(|experiment| experiment.scene() == solve.experiment);
    let tried: Vec<&Solve> = of_method(results, method).filter(among).collect();
    let largest = *tried.iter().max_by_key(|solve| solve.contacts)?;
    let solved = tried.iter().filter(|solve| solve.converged()).count();
    let share = format!("{method} reached the tolerance on {solved} of its {} problems.", tried.len());
    if !largest.converged() {
        return unsolved(results, place, statement, largest, &share);
    }
    let ratios = ratios(results, experiments, "pdip+ilu", method);
    let last = ratios.iter().rfind(|ratio| ratio.contacts == largest.contacts)?;
    // A solver that falls back on another preconditioner says nothing of trains.
    let idle = largest.figures.get("train_active") == Some(&0.0);
    let verdict = match last.reaches(goal) {
        Verdict::Holds if idle => Verdict::Fails,
        verdict => verdict,
    };
    let evidence = format!(
        "{share} ILU's time over its own on the largest ({} contacts): {}.{}{}",
        last.contacts,
        last.text(),
        if idle { " No train was of use there: its fall-back preconditioner did the work." } else { "" },
        last.remark()
    );
    Some(Claim { place, statement, verdict, evidence })
}

/// The verdict where a method did not reach the tolerance on its largest problem: it fails where ILU got
/// there, otherwise nothing is decided.
fn unsolved(
    results: &Results,
    place: &'static str,
    statement: String,
    tried: &Solve,
    share: &str,
) -> Option<Claim> {
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
        "{share} On the largest ({} contacts): {}; ILU: {}{}.",
        tried.contacts,
        text(tried),
        text(ilu),
        if ilu.converged() { "" } else { ", not converged either" }
    );
    let verdict = if ilu.converged() { Verdict::Fails } else { Verdict::Open };
    Some(Claim { place, statement, verdict, evidence })
}

fn precompute_growth(results: &Results) -> Claim {
    let statement = "Tensor-train precomputation is nearly independent of the number of contacts (the paper's MATLAB takes 5 to \
                     15 s per step); a power below 0.3 counts as agreement."
        .to_string();
    let points = |method: &str| -> Vec<[f64; 2]> {
        of_method(results, method)
            .filter(|solve| solve.iterations > 0 && solve.experiment == Experiment::Sedimentation.scene())
            .map(|solve| [solve.contacts as f64, solve.precompute_seconds / solve.iterations as f64])
            .collect()
    };
    let train = points("pdip+tt-cross");
    let Some([_, exponent]) = power_law(&train) else {
        return open(
            "Fig. 11",
            statement,
            "pdip+tt-cross finished a Newton iteration on fewer than three problems of the sedimentation.",
        );
    };
    let with_ilu = power_law(&points("pdip+ilu"))
        .map_or(String::new(), |[_, p]| format!(" (for ILU the exponent is {})", number(p)));
    let range = |k: usize| {
        train.iter().fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), p| (low.min(p[k]), high.max(p[k])))
    };
    let (fewest, most) = range(0);
    let tells = most >= paper::CROSSOVER_CONTACTS && most >= 4.0 * fewest;
    Claim {
        place: "Fig. 11",
        statement,
        verdict: if tells { Verdict::of(exponent < 0.3) } else { Verdict::Open },
        evidence: format!(
            "Per factorisation, pdip+tt-cross takes {} to {} s between {} and {} contacts, growing like their power \
             {}{with_ilu}.{}",
            number(range(1).0),
            number(range(1).1),
            number(fewest),
            number(most),
            number(exponent),
            if tells { "" } else { " A law needs 20 000 contacts and a range of four." }
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
    let on = |method: &str, place: &Solve| {
        of_method(results, method)
            .find(|s| (&s.experiment, s.n, s.step) == (&place.experiment, place.n, place.step))
            .filter(|solve| solve.iterations > 0 && solve.inner_mean > 0.0)
    };
    let sedimentation = Experiment::Sedimentation.scene();
    let pairs = of_method(results, "pdip+tt-cross")
        .filter(|train| train.experiment == sedimentation && train.iterations > 0 && train.inner_mean > 0.0)
        .filter_map(|train| Some((train, on("pdip+ilu", train)?)));
    let Some((train, ilu)) = pairs.max_by_key(|(train, _)| train.contacts) else {
        return open(
            "Fig. 12",
            statement,
            "ILU and the tensor train did not both finish a Newton iteration on the same problem of the sedimentation.",
        );
    };
    let none = on("pdip+none", train);
    let unpreconditioned = none.map_or(String::new(), |none| {
        format!(
            " Without preconditioner: {} on average, {} % of the linear solves did not reach their tolerance.",
            number(none.inner_mean),
            number(100.0 * none.unconverged)
        )
    });
    let train_unconverged = if train.unconverged > 0.0 {
        format!(
            " ({} % of its linear solves did not reach their tolerance)",
            number(100.0 * train.unconverged)
        )
    } else {
        String::new()
    };
    let ratio = ilu.inner_mean / train.inner_mean;
    // A train that does not reach its tolerance, or has no inverse, on a small problem will not do better on
    // a large one.
    let verdict = if train.unconverged >= 0.5 || diverged(train) >= 0.5 {
        Verdict::Fails
    } else if (train.contacts as f64) < paper::CROSSOVER_CONTACTS {
        Verdict::Open
    } else {
        Verdict::of(ratio >= paper::ITERATION_RATIO / 2.0 && none.is_none_or(|none| none.unconverged > 0.0))
    };
    Claim {
        place: "Fig. 12",
        statement,
        verdict,
        evidence: format!(
            "At {} contacts: ILU {} iterations per Newton iteration, the literal tensor train {}{train_unconverged}: ratio {}.{}{unpreconditioned}",
            ilu.contacts,
            number(ilu.inner_mean),
            number(train.inner_mean),
            number(ratio),
            replaced(train)
        ),
    }
}

fn reuse(results: &Results, method: &str) -> Option<Claim> {
    let (_, rows) = results.reuse.iter().find(|(name, _)| name == method)?;
    let statement = format!(
        "Re-use between Newton iterations and steps makes precomputation 10 to 15 times cheaper ({method}; half of it counts \
         as agreement)."
    );
    // The first step has nothing to re-use.
    let later: Vec<&ReuseRow> = rows.iter().skip(1).collect();
    if later.is_empty() {
        return Some(open("Fig. 8", statement, "No precomputation was measured in consecutive steps."));
    }
    let sum = |value: fn(&ReuseRow) -> f64| later.iter().map(|row| value(row)).sum::<f64>();
    let count = |k: usize| {
        let few = later.iter().map(|row| row.iterations[k]).min().unwrap_or(0);
        let many = later.iter().map(|row| row.iterations[k]).max().unwrap_or(0);
        if few == many { few.to_string() } else { format!("{few} to {many}") }
    };
    let [nothing, in_step, all] = [sum(|row| row.first[1]), sum(|row| row.total[1]), sum(|row| row.total[0])];
    if all <= 0.0 {
        return Some(open("Fig. 8", statement, "No Newton iteration ended within the time limit."));
    }
    let error = |k: usize| mean(later.iter().filter_map(|row| row.error[k]));
    let errors = match (error(0), error(1)) {
        (Some(kept), Some(fresh)) => {
            format!(
                " Compression error {} with trains of the step before and {} without.",
                number(kept),
                number(fresh)
            )
        }
        _ => String::new(),
    };
    let idle = later.iter().all(|row| row.active[0] == Some(0.0));
    let single = later.iter().any(|row| row.iterations[0] < 2);
    let verdict = if idle || single {
        Verdict::Open
    } else {
        Verdict::of(nothing / all >= paper::REUSE_FACTOR[0] / 2.0)
    };
    Some(Claim {
        place: "Fig. 8",
        statement,
        verdict,
        evidence: format!(
            "Over {} consecutive steps ({} Newton iterations each) a precomputation from nothing takes {} times the mean one with \
             re-use between Newton iterations and steps, and {} times the mean one with re-use between Newton iterations \
             alone ({} iterations).{errors}{}{}",
            later.len(),
            count(0),
            number(nothing / all),
            number(nothing / in_step.max(f64::MIN_POSITIVE)),
            count(1),
            if idle { " No train was of use: these are precomputations of the fall-back." } else { "" },
            if single {
                " Only one Newton iteration ended within the time limit: allow more with --max-seconds."
            } else {
                ""
            }
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
    // Where the start alone reached the tolerance, a Newton method is a first-order method.
    let started = of_method(results, "ipm").all(|solve| !solve.converged() || solve.inner_mean == 0.0);
    Claim {
        place: "this project",
        statement: statement.into(),
        verdict: strongest.reaches(10.0),
        evidence: format!(
            "Time of pdip+ilu over that of {}.{}{}",
            found.join("; "),
            if started {
                " ipm made no Newton iteration: its first-order start reached the tolerance, so that both are apgd here."
            } else {
                ""
            },
            strongest.remark()
        ),
    }
}
