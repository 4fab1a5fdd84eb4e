//! What pages say of a step's constants is what they are.

use graintrain::stepper::{LOOSEST, Parameters};
use graintrain_testdata::pages::{check, count};

#[test]
fn pages_have_the_constants_of_a_step() {
    let Parameters { repetition, impacts, parts, overlap } = Parameters::default();
    let (few, budget) = (&parts.few, count(parts.iterations));
    assert_eq!((few.tolerance, overlap.rings), (1e-3, 2));
    assert_eq!((overlap.accident, overlap.accident_share), (0.01, 0.2));
    check(
        "mechanics.md",
        &[
            format!(
                "Parts of up to {} contacts are solved to a thousandth of the tolerance (at most {} iterations)",
                few.contacts, few.iterations
            ),
            format!("{LOOSEST:e} (`LOOSEST`)"),
            format!(
                "is {budget}, up to {} below {} contacts",
                count(parts.most_iterations),
                count(parts.many)
            ),
            format!("up to {} times (`stepper/repetition.rs`)", repetition.rounds),
            format!("a contact within {:e} of the smaller one's size there", repetition.same_place),
            format!("larger by {:e} of the size than predicted", repetition.departure),
            format!("at more than {} a dt is an impact", impacts.resting),
            format!("up to {} passes", impacts.passes),
            format!(
                "above {:e} of the smaller body's size (or {} of the tolerance",
                overlap.trigger, overlap.trigger_per_tolerance
            ),
            format!(
                "leaves {:e}, moves bodies up to two contacts away, and removes at most {} |g| dt^2",
                overlap.kept, overlap.per_step
            ),
            format!("solved again (up to {} times)", repetition.joint_rounds),
        ],
    );
    check(
        "book/src/theory.md",
        &[
            format!("repeated, up to {} times", repetition.rounds),
            format!(
                "{budget} for a part of the contact graph, up to {} below {} contacts",
                count(parts.most_iterations),
                count(parts.many)
            ),
            format!("faster than {} A dt", impacts.resting),
        ],
    );
}
