//! What docs/solvers.md says of constants is what they are.

use super::accelerated_sweeps;
use super::apgd;
use super::cascade::{ABOVE, GRADIENTS_FIRST, LONGEST, TURN};
use super::first_order::NEAR;
use super::momentum::Memory;
use super::packing::PER_RANGE;
use super::single::{self, FEWEST_CONTACTS, LEAST_MAXIMUM, LEAST_TOLERANCE};
use super::start::SAMPLE;
use crate::residual::MIXED_MAXIMUM;
use graintrain_testdata::pages::{check, count};

fn memory(memory: &Memory) -> String {
    let Memory { first, longer, shorter, range: [least, most], .. } = memory;
    format!("first {first}, times {longer} or {shorter}, between {least} and {most}")
}

#[test]
fn the_page_on_solvers_has_their_constants() {
    let ((share, [least, most]), [many, fewer]) = (TURN, GRADIENTS_FIRST);
    assert_eq!((share, single::ROUNDING, single::PATIENCE), (1.0 / 12.0, 8.0, 1000));
    check(
        "solvers.md",
        &[
            format!("residual <= {MIXED_MAXIMUM} tolerance"),
            format!(
                "at least {FEWEST_CONTACTS} contacts, and a tolerance of at least {LEAST_TOLERANCE:e} ({LEAST_MAXIMUM:e} for the worst contact)"
            ),
            format!(
                "the residual of {SAMPLE} of them is evaluated first; if it is at most {NEAR} times the tolerance"
            ),
            format!("{} for `apgd`", memory(&apgd::MEMORY)),
            format!("{} for `apgs`", memory(&accelerated_sweeps::MEMORY)),
            format!("a twelfth of the available iterations, {least} to {}", count(most)),
            format!("from {} contacts on ({} without single precision)", count(many), count(fewer)),
            format!("until none gains in a turn of {}", count(LONGEST)),
            format!("above a residual of {ABOVE}"),
            format!("ranges of bodies of about {} contacts", count(PER_RANGE)),
        ],
    );
}
