//! Bodies that overlap are moved apart before a run.

use graintrain::cell::{Cell, Drive};
use graintrain::collide::deepest_overlap;
use graintrain::math::Vec3;
use graintrain::motion::Motion;
use graintrain::stepper::{StepSettings, Stepper};
use graintrain::world::World;

/// Steps after which bodies that still overlap are left to the check that follows.
const STEPS: usize = 2_000;

/// Moves bodies apart until none overlaps another by more than `allowed` (m), by steps without forces and
/// velocities: what is left of those is the removal of overlap, which displaces each body by as little as
/// mends it. Prescribed bodies stay. Velocities stay as they were.
pub(super) fn relax(world: &mut World, envelope: f64, allowed: f64) {
    let is_relaxed = |world: &World| deepest_overlap(world).is_none_or(|overlap| overlap.depth <= allowed);
    if is_relaxed(world) {
        return;
    }
    let mut still = world.clone();
    (still.gravity, still.gravity_of_time) = (Vec3::ZERO, None);
    still.clear_forces();
    // An empty list fits every world.
    let _ = still.set_loads(Vec::new());
    if let Some(cell) = still.cell().cloned() {
        // One that is held takes the bodies that it had.
        let _ = still.set_cell(Some(Cell { drive: [Drive::HELD; 6], ..cell }));
    }
    still.motions.iter_mut().for_each(|motion| *motion = Motion::fixed().with_free(motion.free));
    let Ok(mut stepper) = Stepper::new(StepSettings { envelope, ..StepSettings::default() }) else { return };
    for _ in 0..STEPS {
        still.bodies.velocity.fill(Vec3::ZERO);
        still.bodies.angular_velocity.fill(Vec3::ZERO);
        if stepper.step(&mut still).is_err() || is_relaxed(&still) {
            break;
        }
    }
    world.bodies.position.clone_from(&still.bodies.position);
    world.bodies.orientation.clone_from(&still.bodies.orientation);
}
