use super::*;
use std::time::{Duration, Instant};

/// What each target may take here; `graintrain-fuzz` takes its time.
const SHARE: Duration = Duration::from_millis(250);

#[test]
fn seeds_are_accepted_and_altered_inputs_make_no_panic() {
    for target in TARGETS {
        let seeds = (target.seeds)();
        for (number, seed) in seeds.iter().enumerate() {
            assert!((target.run)(seed), "{} {number}: {}", target.name, String::from_utf8_lossy(seed));
        }
        let (words, start) = ((target.words)(), Instant::now());
        for number in 0..300 {
            (target.run)(&alter::altered(&seeds, &words, &mut alter::Draw::new(0, number)));
            if start.elapsed() > SHARE {
                break;
            }
        }
    }
}

#[test]
fn the_same_numbers_make_the_same_inputs() {
    let seeds = mesh::seeds();
    let made = |session, number| alter::altered(&seeds, &[], &mut alter::Draw::new(session, number));
    let distinct: std::collections::HashSet<Vec<u8>> = (0..100).map(|number| made(1, number)).collect();
    assert!(distinct.len() > 90, "{}", distinct.len());
    assert!((0..100).all(|number| made(1, number) == made(1, number)));
    assert_ne!(made(1, 3), made(2, 3));
}
