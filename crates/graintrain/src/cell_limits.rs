//! How far a periodic cell may deform, at once and altogether.
//!
//! A body in a cell has at most one image near each other body, which takes edges of more than twice its
//! size. In a step an edge may change by half, and images may move by a quarter edge: contacts are looked for
//! where a step begins and where it ends, and faster ones would pass through each other. Imposed rates beyond
//! are refused; imposed stresses are held there, as by a press with a largest speed. A step gives them a
//! tenth of that at most, by the inertia of the cell.

use crate::cell::{COMPONENTS, Cell, Drive, NAMES};
use crate::error::ModelError;
use crate::world::World;

/// Largest relative change of an edge in a step.
const STRETCH: f64 = 0.5;

/// Largest way that an image moves sideways in a step, over the edge in that direction.
const SHEAR: f64 = 0.25;

/// What the largest imposed stress may give a component from rest in a step, over the largest rate of that
/// component: with a tolerance of 1e-3, contacts are then left to approach by 5e-5 edges in a step at most.
const PUSH: f64 = 0.1;

impl Cell {
    /// Largest magnitude of a component of L in a step of this length (s), 1/s.
    fn largest_rate(&self, component: usize, step: f64) -> f64 {
        let (i, j) = COMPONENTS[component];
        if i == j { STRETCH / step } else { SHEAR * self.size[i] / self.size[j] / step }
    }

    /// Inertia of a component whose stress is imposed, kg m^2, in the step from `time`: W = M H^2 / 12 with
    /// the mass M (kg) of all bodies, or what keeps V sigma dt / W of the largest stress within [`PUSH`] of
    /// the largest rate.
    pub(crate) fn inertia(&self, component: usize, mass: f64, time: f64, step: f64) -> f64 {
        let edge = self.size[COMPONENTS[component].1];
        let stress = |drive: &Drive| match drive {
            Drive::Stress(profile) => profile.mean(time, step).abs(),
            Drive::Rate(_) => 0.0,
        };
        let push = self.drive.iter().map(stress).fold(0.0, f64::max) * self.volume() * step;
        (mass * edge * edge / 12.0).max(push / (PUSH * self.largest_rate(component, step)))
    }

    /// Checks that the rates which are imposed on the step of this length (s) that begins at `time` (s) are
    /// none that a step cannot follow.
    ///
    /// # Errors
    /// [`ModelError::Cell`] for a diagonal component that changes its edge by more than half, one of shear
    /// that moves images by more than a quarter edge.
    pub fn validate_step(&self, time: f64, step: f64) -> Result<(), ModelError> {
        for (k, rate) in self.imposed_rates(time, step).into_iter().enumerate() {
            let Some(rate) = rate.filter(|&rate| rate != 0.0) else { continue };
            let largest = self.largest_rate(k, step);
            if rate.is_nan() || rate.abs() > largest * (1.0 + 1e-12) {
                let (what, most) = if k < 3 {
                    ("changes its edge by", format!("{STRETCH} of it"))
                } else {
                    ("moves images by", format!("{SHEAR} of an edge"))
                };
                let share = rate.abs() / largest * if k < 3 { STRETCH } else { SHEAR };
                return Err(ModelError::Cell {
                    what: format!(
                        "the rate {} {what} {share:.3e} of an edge in a step of {step} s; {most} is the most: take a shorter step, or a lower rate",
                        NAMES[k]
                    ),
                });
            }
        }
        Ok(())
    }

    /// The components whose stress has brought them beyond what they may have in the step from `time`, with
    /// the rate at which they are held: beyond the largest rate of the press, or of what a step can follow.
    pub(crate) fn beyond(&self, time: f64, step: f64) -> [Option<f64>; 6] {
        std::array::from_fn(|k| {
            let Drive::Stress(profile) = &self.drive[k] else { return None };
            let (stress, rate) = (profile.mean(time, step), self.rate[k]);
            let largest = self.largest_rate(k, step);
            let presses = stress != 0.0 && stress.signum() * rate < 0.0;
            let limit = if presses { largest.min(self.fastest) } else { largest };
            (rate.abs() > limit * (1.0 + 1e-12)).then_some(rate.signum() * limit)
        })
    }

    /// The first component that moves against its stress at the largest rate which the step from `time` can
    /// follow. Contacts bear a stress, they do not return it: a cell that they throw open was not solved.
    pub(crate) fn thrown_open(&self, time: f64, step: f64) -> Option<&'static str> {
        let thrown = |&k: &usize| {
            let Drive::Stress(profile) = &self.drive[k] else { return false };
            let pull = profile.mean(time, step) * self.rate[k];
            pull > 0.0 && self.rate[k].abs() >= self.largest_rate(k, step) * (1.0 - 1e-9)
        };
        (0..6).find(thrown).map(|k| NAMES[k])
    }
}

impl World {
    /// Checks that every body is less than half of the smallest edge of the periodic cell across, as it is
    /// now.
    ///
    /// # Errors
    /// [`ModelError::Cell`] with the first body that is not.
    pub fn fits_cell(&self) -> Result<(), ModelError> {
        let Some(cell) = self.cell() else { return Ok(()) };
        let repeats = (0..3).filter(|&axis| cell.periodic[axis]);
        let Some(axis) = repeats.min_by(|&a, &b| cell.size[a].total_cmp(&cell.size[b])) else {
            return Ok(());
        };
        let half = 0.5 * cell.size[axis];
        for body in 0..self.bodies.len() {
            let across = 2.0 * self.geometries[self.bodies.geometry[body].index()].bounding_radius();
            if across.is_finite() && (half.is_nan() || across >= half) {
                return Err(ModelError::Cell {
                    what: format!(
                        "body {} fits into a ball of {across:.4} m across, which has to be less than half of the smallest edge, {half:.4} m \
                         along {}: begin with a larger cell, end its deformation or the growth of bodies sooner, or make walls of planes",
                        self.bodies.label(body),
                        ["x", "y", "z"][axis]
                    ),
                });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::motion::Profile;

    fn pressed(stress: f64, rate: f64) -> Cell {
        let mut cell = Cell::new(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), [true; 3]).unwrap();
        cell.drive[1] = Drive::Stress(Profile::Constant(stress));
        cell.rate[1] = rate;
        cell
    }

    #[test]
    fn only_what_opens_against_its_stress_is_thrown_open() {
        assert_eq!(pressed(1.0, 500.0).thrown_open(0.0, 1e-3), Some("yy"));
        assert_eq!(pressed(1.0, 499.0).thrown_open(0.0, 1e-3), None);
        assert_eq!(pressed(1.0, -500.0).thrown_open(0.0, 1e-3), None);
        assert_eq!(pressed(-1.0, 500.0).thrown_open(0.0, 1e-3), None);
    }

    /// From rest a stress changes its edge by a twentieth in a step at most, and small ones act on the mass
    /// of the bodies.
    #[test]
    fn a_stress_gives_no_more_than_its_share() {
        let step = 1e-3;
        for stress in [1e-3, 1e12] {
            let cell = pressed(stress, 0.0);
            let inertia = cell.inertia(1, 3.0, 0.0, step);
            let push = stress * cell.volume() * step / inertia;
            assert!(push * step <= 0.05 * (1.0 + 1e-12), "{push}");
            assert_eq!(inertia == 3.0 * 4.0 / 12.0, stress < 1.0);
        }
    }
}
