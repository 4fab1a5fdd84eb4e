//! What docs/solvers.md says of constants is what they are.

use super::accelerated_sweeps::AcceleratedSweeps;
use super::apgd::Apgd;
use super::cascade::{FinishParameters, RaceParameters};
use super::first_order;
use super::momentum::Memory;
use super::single;
use super::start::SAMPLE;
use crate::residual::MIXED_MAXIMUM;
use graintrain_testdata::pages::{check, count};

fn memory(memory: &Memory) -> String {
    let Memory { first, longer, shorter, range: [least, most], .. } = memory;
    format!("first {first}, times {longer} or {shorter}, between {least} and {most}")
}

#[test]
fn the_page_on_solvers_has_their_constants() {
    let single = single::Parameters::default();
    let own = first_order::Parameters::default();
    let RaceParameters { turn: (share, [least, most]), gradients_first: [many, fewer], longest, .. } =
        RaceParameters::default();
    assert_eq!((share, single.rounding, single.patience), (1.0 / 12.0, 8.0, 1000));
    check(
        "solvers.md",
        &[
            format!("residual <= {MIXED_MAXIMUM} tolerance"),
            format!(
                "at least {} contacts, and a tolerance of at least {:e} ({:e} for the worst contact)",
                single.fewest_contacts, single.least_tolerance, single.least_maximum
            ),
            format!(
                "the residual of {SAMPLE} of them is evaluated first; if it is at most {} times the tolerance",
                own.near
            ),
            format!("{} for `apgd`", memory(&Apgd::default().memory)),
            format!("{} for `apgs`", memory(&AcceleratedSweeps::default().memory)),
            format!("a twelfth of the available iterations, {least} to {}", count(most)),
            format!("from {} contacts on ({} without single precision)", count(many), count(fewer)),
            format!("until none gains in a turn of {}", count(longest)),
            format!("above a residual of {}", FinishParameters::default().above),
        ],
    );
}
