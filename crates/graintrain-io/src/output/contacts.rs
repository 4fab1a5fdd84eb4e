//! Frames of the contacts as lines.

use super::vtp::{CellKind, Cells, DataArray, PolyData};
use crate::body_numbers::BodyNumbers;
use graintrain::math::Vec3;
use graintrain::measure::contacts::{is_sliding, normal_and_tangential};
use graintrain::world::World;

/// The frame: one line of three points per contact, from the centre of body A through the contact point to
/// the centre of body B. Where a body has no degree of freedom (a wall), the contact point stands for its
/// centre. (OVITO drops lines of differing numbers of points.)
///
/// Cell arrays: `id1`, `id2` (numbers of bodies A and B, as in the frames of bodies), `force` (N, on A, world
/// axes, averaged over the step of length `step`), `fn` and `ft` (its normal part and the magnitude of its
/// tangential part, N), `gap` (m, before the step), `n` (unit normal from B to A), `mu`, `sliding` (1 where
/// the friction is used up). Where a pair of materials resists rolling or spinning also `moment` (N m, on A,
/// world axes, averaged over the step).
pub fn lines(world: &World, numbers: &BodyNumbers, step: f64) -> PolyData {
    let set = &world.contacts;
    let mut points = Vec::with_capacity(3 * set.contacts.len());
    let mut cells = Cells::new(CellKind::Lines);
    let movable: Vec<bool> = (0..world.bodies.len()).map(|body| !world.is_prescribed(body)).collect();
    for contact in &set.contacts {
        let end = |body: u32| {
            let body = body as usize;
            if movable[body] { world.bodies.position[body] } else { contact.point }
        };
        let first = points.len() as i64;
        let [a, b] = [contact.body_a, contact.body_b].map(|body| {
            // Beside the contact, where space repeats.
            let way = |body: usize| world.way_to(body, contact.point);
            if world.cell().is_some() && movable[body as usize] {
                contact.point - way(body as usize)
            } else {
                end(body)
            }
        });
        points.extend([a, contact.point, b]);
        cells.push(first..first + 3);
    }
    let force: Vec<Vec3> = set.impulse.iter().map(|&impulse| impulse / step).collect();
    let (normal, tangential): (Vec<f64>, Vec<f64>) =
        set.contacts.iter().zip(&force).map(|(contact, &f)| normal_and_tangential(contact, f)).unzip();
    let parts = normal.iter().zip(&tangential).zip(&set.friction);
    let sliding = parts.map(|((&normal, &tangential), &mu)| is_sliding(normal, tangential, mu));
    let number = |body: u32| numbers.number(body as usize) as i64;
    let mut cell_data = vec![
        DataArray::int64("id1", set.contacts.iter().map(|contact| number(contact.body_a)).collect()),
        DataArray::int64("id2", set.contacts.iter().map(|contact| number(contact.body_b)).collect()),
        DataArray::flags("sliding", sliding.collect::<Vec<_>>().into_iter()),
        DataArray::vector("force", force),
        DataArray::scalar("fn", normal),
        DataArray::scalar("ft", tangential),
        DataArray::scalar("gap", set.contacts.iter().map(|contact| contact.gap).collect()),
        DataArray::vector("n", set.contacts.iter().map(|contact| contact.normal)),
        DataArray::scalar("mu", set.friction.clone()),
    ];
    if !set.moment.is_empty() {
        cell_data.push(DataArray::vector("moment", set.moment.iter().map(|&moment| moment / step)));
    }
    PolyData { points, cells, point_data: Vec::new(), cell_data }
}
