//! One pass over the bodies by tasks, alone or with other ranks: the same for every precision.

use super::share::{Buffers, Share, part_of};
use super::tasks::{Tally, Totals, for_each_task};

/// Bodies per parallel task.
pub(super) const BODIES: usize = 1024;

/// Number of tasks of a pass over so many bodies.
pub(super) fn num_body_tasks(bodies: usize) -> usize {
    bodies.div_ceil(BODIES)
}

/// Does `work(first body, parts of the images, tally)` for the bodies of the images, one entry each, and adds
/// up its first sums task by task. Where there are several ranks, each does its own tasks and the bodies
/// beyond that its contacts touch.
pub(super) fn over_bodies<T: Send, const K: usize>(
    share: Option<&Share>,
    mut images: [&mut [T]; K],
    tallies: &mut [Tally],
    buffers: &mut Buffers,
    work: &(impl Fn(usize, [&mut [T]; K], &mut Tally) + Sync),
) -> f64 {
    let tasks = num_body_tasks(images[0].len());
    let tallies = &mut tallies[..tasks];
    let own = share.map_or(0..tasks, Share::tasks);
    let parts = part_of(images.each_mut().map(|image| &mut **image), &own, BODIES);
    let no_extra = &mut [] as &mut [()];
    let own_tallies = &mut tallies[own.clone()];
    for_each_task(own, BODIES, parts, no_extra, &|_| 0, own_tallies, &|task, images, _, tally| {
        work(task * BODIES, images, tally);
    });
    let Some(share) = share else { return Totals::of(tallies).sum[0] };
    for run in share.beyond() {
        let images = images.each_mut().map(|image| &mut image[run.clone()]);
        work(run.start, images, &mut Tally::default());
    }
    share.total_of_tasks(tallies, buffers)
}
