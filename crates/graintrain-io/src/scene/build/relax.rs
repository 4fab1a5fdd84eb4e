//! Bodies that overlap are moved apart before a run.

use graintrain::ccp::FrictionModel;
use graintrain::cell::{Cell, Drive};
use graintrain::collide::deepest_overlap;
use graintrain::math::Vec3;
use graintrain::motion::Motion;
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::World;

/// Steps after which bodies that still overlap are left to the check that follows.
const STEPS: usize = 2_000;

/// Steps within which the deepest overlap has to become less by a tenth: bodies for which there is no room
/// are left to that check, too.
const PATIENCE: usize = 50;

/// Iterations of a solve: elastic contacts alone push anything, and need not be exact for this.
const ITERATIONS: usize = 20;

/// Moves bodies apart until none overlaps another by more than `allowed` (m), by steps without forces and
/// velocities: what is left of those is the removal of overlap, which displaces each body by as little as
/// mends it. Prescribed bodies stay. Velocities stay as they were.
pub(super) fn relax(world: &mut World, envelope: f64, allowed: f64) {
    let depth = |world: &World| deepest_overlap(world).map_or(0.0, |overlap| overlap.depth);
    let (mut deepest, mut since) = (depth(world), 0);
    if deepest <= allowed {
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
    let (max_iterations, friction) = (Some(ITERATIONS), FrictionModel::Relaxed);
    let solver = SolverChoice { max_iterations, friction, ..SolverChoice::default() };
    let Ok(mut stepper) = Stepper::new(StepSettings { envelope, solver, ..StepSettings::default() }) else {
        return;
    };
    for step in 0..STEPS {
        still.bodies.velocity.fill(Vec3::ZERO);
        still.bodies.angular_velocity.fill(Vec3::ZERO);
        if stepper.step(&mut still).is_err() {
            break;
        }
        let left = depth(&still);
        if left < 0.9 * deepest {
            (deepest, since) = (left, step);
        }
        if left <= allowed || step - since > PATIENCE {
            break;
        }
    }
    world.bodies.position.clone_from(&still.bodies.position);
    world.bodies.orientation.clone_from(&still.bodies.orientation);
}
