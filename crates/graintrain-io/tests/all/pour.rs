//! Boxes, convex hulls, clumps and capsules poured into a box: they come to rest, do not overlap, and gain no
//! energy.

use graintrain::math::Vec3;
use graintrain::world::World;
use graintrain_io::files::OutputError;
use graintrain_io::run::{Ending, Observer, Run, RunSettings, RunTotals, StepView};
use graintrain_io::scene::Scene;
use std::path::Path;

const POUR: &str = include_str!("pour.toml");

/// Smallest size in the scene, m: the radius of capsules and of the smallest balls.
const SIZE: f64 = 6e-3;

/// Energies after every step, and places one second before the end.
struct Rest {
    entered: f64,
    bodies: u64,
    energies: Vec<f64>,
    before: (u64, Vec<Vec3>),
}

fn energy(world: &World) -> f64 {
    let potential = |body: usize| 9.81 * world.bodies.mass[body] * world.bodies.position[body].z;
    let moving = (0..world.bodies.len()).filter(|&body| !world.is_prescribed(body));
    world.kinetic_energy() + moving.map(potential).sum::<f64>()
}

impl Observer for Rest {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        let given = step.totals.open_boundaries.streams.iter().map(|stream| stream.given.bodies).sum();
        if given != self.bodies {
            // What comes in brings energy.
            self.energies.clear();
            (self.bodies, self.entered) = (given, step.world.time);
        }
        self.energies.push(energy(step.world));
        if step.world.step == self.before.0 {
            self.before.1.clone_from(&step.world.bodies.position);
        }
        Ok(())
    }
}

/// A fiftieth of the 2 200 bodies of the scene, to 1e-8 with relaxed and to 1e-5 with exact friction.
#[test]
fn a_pour_of_boxes_hulls_clumps_and_capsules_rests() {
    for (friction, tolerance) in [("relaxed", "1e-8"), ("coulomb", "1e-5")] {
        pour(friction, tolerance);
    }
}

fn pour(friction: &str, tolerance: &str) {
    let part: f64 = 0.02;
    let settings =
        [("part", &part.to_string()[..]), ("solver.friction", friction), ("solver.tolerance", tolerance)];
    let settings = settings.map(|(key, value)| (key.to_string(), value.to_string()));
    let scene = Scene::parse("pour", "pour.toml", POUR, Path::new(""), &settings).unwrap();
    let simulation = scene.build().unwrap();
    let second = (1.0 / simulation.settings.step).round() as u64;
    let mut rest = Rest {
        entered: 0.0,
        bodies: 0,
        energies: Vec::new(),
        before: (simulation.steps - second, Vec::new()),
    };
    let settings = RunSettings::new(&simulation, None);
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), Default::default()).unwrap();
    assert_eq!(run.advance(&mut [&mut rest]).unwrap(), Ending::Finished);
    let (world, totals) = (&run.world, &run.totals);
    let moves = world.bodies.position.iter().zip(&rest.before.1).map(|(now, then)| (*now - *then).length());
    let mut moves: Vec<f64> = moves.map(|way| way / SIZE).collect();
    moves.sort_by(f64::total_cmp);
    let [creep, rocking] = [moves[moves.len() - 2], moves[moves.len() - 1]];
    let rises = rest.energies.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::NEG_INFINITY, f64::max);
    let overlap = totals.figures.penetration_max_over_radius;
    println!(
        "{friction}: {} bodies, all there at {:.2} s, {} contacts; creep {creep:.1e} sizes per second, overlap at most {:.2} % of a size, energy rises by \
         {rises:.1e} of {:.1e} J in a step; {} of {} steps unconverged; {:.0} s",
        rest.bodies,
        rest.entered,
        totals.figures.contacts_final,
        100.0 * overlap,
        rest.energies[0],
        totals.figures.unconverged_steps,
        world.step,
        totals.wall_seconds
    );
    assert_eq!(rest.bodies as f64, (2200.0 * part).round());
    assert_eq!((totals.figures.unconverged_steps, totals.figures.contacts_missed), (0, 0));
    // A clump of balls on two contacts that stick rocks on like a pendulum: nothing here resists rolling. One
    // may, and all others rest.
    assert!(creep < 0.02 && rocking < 0.2, "creep {creep}, {rocking}");
    assert!(overlap < 0.005, "overlap {overlap}");
    assert!(rises <= 1e-5 * rest.energies[0], "energy rises by {rises} J");
}
