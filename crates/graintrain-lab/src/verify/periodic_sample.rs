//! Samples without walls: spheres in a periodic cell that is compressed from a gas, pressed and sheared.

use super::bench::{Accuracy, Bench, add_sphere, random};
use super::{Sampling, VerifyError};
use crate::reproduce::ReproduceError;
use graintrain::cell::{Cell, Drive};
use graintrain::material::Materials;
use graintrain::math::Vec3;
use graintrain::measure::contacts::coordination;
use graintrain::measure::statistics::{Mean, mean};
use graintrain::measure::stress::{pressure, stress};
use graintrain::motion::Profile;
use graintrain::world::World;
use graintrain_ccp::{Criterion, FrictionModel};
use std::f64::consts::PI;
use std::sync::atomic::Ordering;

/// Largest radius, m; the smallest is nine tenths of it.
const RADIUS: f64 = 0.01;

/// kg/m^3.
const DENSITY: f64 = 1000.0;

/// s.
const STEP: f64 = 2e-3;

/// Volume fraction of the gas that is begun with, and of that at which the pressure takes over.
const GAS: [f64; 2] = [0.4, 0.5];

/// Of the gas, m/s.
const SPEED: f64 = 0.5;

/// At which the cell closes, 1/s: at an imposed rate, then at most.
const RATE: [f64; 2] = [1.0, 0.1];

/// Imposed on the sample, Pa. Grains are rigid, so that it sets but the inertial number, I = rate d
/// sqrt(density / pressure): 2e-4 as the sample jams.
const PRESSURE: f64 = 1e5;

/// Time under the pressure at the full rate and after the sample jams, s.
const PRESSED: f64 = 1.4;

/// Steps made to this tolerance at the end: contacts that carry nothing have what a solve leaves over, and
/// are counted at the tolerance of scenes.
const FINE: (usize, Accuracy) = (20, Accuracy { tolerance: 1e-6, criterion: Criterion::Mixed });

/// Of shear, 1/s: the inertial number is 1e-3.
const SHEAR_RATE: f64 = 0.5;

/// Shear strain before anything is averaged, and over which it is.
const SHEAR_STRAIN: [f64; 2] = [0.4, 0.6];

/// A sample under pressure.
pub struct PeriodicSample {
    world: World,
    friction: f64,
    /// Its steps.
    pub bench: Bench,
}

/// What a sheared sample comes to.
pub struct Sheared {
    /// Mean shear stress over the mean normal stress across the plane of shear.
    pub stress_ratio: Mean,
    /// Volume fraction.
    pub density: Mean,
}

impl PeriodicSample {
    /// Compresses `edge`^3 spheres from a gas, friction acting all the while, and lets them come to rest
    /// under the pressure.
    ///
    /// # Errors
    /// [`VerifyError`] of a step, or where it is stopped.
    pub fn compressed(
        friction: f64,
        edge: i32,
        sampling: &mut Sampling<'_>,
        model: FrictionModel,
    ) -> Result<Self, VerifyError> {
        (sampling.progress)(&format!("compression, friction {friction}"));
        let mut world = World::new(Vec3::ZERO, Materials::single("stuff", DENSITY, friction, 0.0)?)?;
        let mut next = random(7);
        // Of radii that are alike between 0.9 and 1 the mean cube is 0.8598.
        let pitch = 2.0 * RADIUS * (0.8598 * PI / 6.0 / GAS[0]).cbrt();
        for k in 0..edge.pow(3) {
            let place =
                Vec3::from_array([k % edge, k / edge % edge, k / edge.pow(2)].map(|i| f64::from(i) + 0.5));
            let radius = RADIUS * (0.95 + 0.05 * next());
            let jitter = 0.1 * RADIUS * Vec3::new(next(), next(), next());
            let grain = add_sphere(&mut world, radius, pitch * place + jitter)?;
            world.bodies.velocity[grain] = SPEED * Vec3::new(next(), next(), next());
        }
        let upper = Vec3::splat(pitch * f64::from(edge));
        let mut cell = Cell::new(Vec3::ZERO, upper, [true; 3])?;
        cell.drive[..3].fill(Drive::Rate(Profile::Constant(-RATE[0])));
        cell.fastest = RATE[1];
        world.set_cell(Some(cell))?;
        let bench = |accuracy| Bench::new(STEP, 0.02 * RADIUS, accuracy, model);
        let mut sample = Self { world, friction, bench: bench(Accuracy::SCENES)? };
        while sample.density() < GAS[1] {
            sample.step(sampling)?;
        }
        sample.drive(|drive| {
            drive[..3].fill(Drive::Stress(Profile::Constant(PRESSURE)));
        })?;
        let end = sample.world.time + PRESSED;
        while sample.world.time < end {
            sample.step(sampling)?;
        }
        let coarse = std::mem::replace(&mut sample.bench, bench(FINE.1)?);
        for _ in 0..FINE.0 {
            sample.step(sampling)?;
        }
        let fine = std::mem::replace(&mut sample.bench, coarse);
        sample.bench.count(&fine);
        Ok(sample)
    }

    /// Volume fraction.
    pub fn density(&self) -> f64 {
        let volume = self.world.cell().map_or(f64::NAN, Cell::volume);
        self.world.bodies.mass.iter().sum::<f64>() / DENSITY / volume
    }

    /// Loaded contacts per grain that is no rattler.
    pub fn contacts(&self) -> f64 {
        let all = vec![true; self.world.bodies.len()];
        coordination(&self.world, &all, if self.friction == 0.0 { 4 } else { 2 }).mean_without_rattlers
    }

    /// Shears the sample at a constant rate under the same normal stresses, along x in planes across y.
    ///
    /// # Errors
    /// As [`Self::compressed`].
    pub fn sheared(&mut self, sampling: &mut Sampling<'_>) -> Result<Sheared, VerifyError> {
        (sampling.progress)(&format!("shear, friction {}", self.friction));
        self.drive(|drive| drive[3] = Drive::Rate(Profile::Constant(SHEAR_RATE)))?;
        let all = vec![true; self.world.bodies.len()];
        let begin = self.world.time;
        let (mut ratios, mut densities) = (Vec::new(), Vec::new());
        loop {
            self.step(sampling)?;
            let strain = SHEAR_RATE * (self.world.time - begin);
            if strain > SHEAR_STRAIN[0] {
                let volume = self.world.cell().map_or(f64::NAN, Cell::volume);
                let now = stress(&self.world, STEP, &all, volume);
                let tensor = now.contact + now.kinetic;
                // Shear along +x that rises with y is resisted by a stress of the other sign, compression
                // being positive.
                ratios.push(-0.5 * (tensor.y_axis.x + tensor.x_axis.y) / pressure(&tensor));
                densities.push(self.density());
            }
            if strain > SHEAR_STRAIN[0] + SHEAR_STRAIN[1] {
                return Ok(Sheared { stress_ratio: mean(&ratios), density: mean(&densities) });
            }
        }
    }

    fn drive(&mut self, change: impl FnOnce(&mut [Drive; 6])) -> Result<(), VerifyError> {
        let mut cell = self.world.cell().cloned();
        if let Some(cell) = &mut cell {
            change(&mut cell.drive);
        }
        Ok(self.world.set_cell(cell)?)
    }

    fn step(&mut self, sampling: &Sampling<'_>) -> Result<(), VerifyError> {
        if sampling.stop.load(Ordering::Relaxed) {
            return Err(ReproduceError::Stopped.into());
        }
        self.bench.step(&mut self.world)?;
        Ok(())
    }
}
