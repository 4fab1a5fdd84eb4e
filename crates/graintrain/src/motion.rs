//! Functions of time, and prescribed motion: velocities, and which degrees of freedom they hold.

use crate::error::{ModelError, finite, positive};
use crate::formula::Formula;
use crate::math::{Quat, Vec3};
use graintrain_linalg::real;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A scalar function of time: a velocity (m/s or rad/s), a force, an acceleration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Profile {
    /// The same at all times.
    Constant(f64),
    /// amplitude sin(2 pi t / period + phase).
    Sinusoidal {
        /// Largest value.
        amplitude: f64,
        /// s.
        period: f64,
        /// rad.
        phase: f64,
    },
    /// Linear between samples, constant before the first and after the last.
    Table {
        /// Strictly ascending times, s.
        times: Vec<f64>,
        /// Value at each time.
        values: Vec<f64>,
    },
    /// Zero until `start`, then the profile with its time counted from there.
    Delayed {
        /// s.
        start: f64,
        /// What follows.
        profile: Box<Profile>,
    },
    /// A formula.
    Formula(Formula),
}

/// How a body moves: each of its six degrees of freedom (translation along and rotation about the world axes)
/// is either dynamic or follows a prescribed velocity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Which degrees of freedom are dynamic: x, y, z, then rotation about x, y, z.
    pub free: [bool; 6],
    /// Prescribed translation: velocity along each direction (any vector, not normalised), summed. Only
    /// components along degrees of freedom that are not free act.
    pub translation: Vec<(Vec3, Profile)>,
    /// Prescribed rotation.
    pub rotation: Option<Rotation>,
}

/// Axes in which a vector is given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axes {
    /// Those of the world.
    #[default]
    World,
    /// Those of the body, which turn with it.
    Body,
}

/// Rotation with a prescribed angular velocity about an axis of fixed direction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rotation {
    /// A point of the axis, m: in the world, where the axis stays, or from the centre of mass in body axes,
    /// with which it moves.
    pub point: Vec3,
    /// Whether the point is one of the world or of the body.
    pub of: Axes,
    /// Unit direction of the axis in the world.
    pub axis: Vec3,
    /// Angular velocity, rad/s.
    pub profile: Profile,
}

impl Profile {
    /// Value at a time.
    pub fn value(&self, time: f64) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Formula(formula) => formula.value(time),
            Self::Sinusoidal { amplitude, period, phase } => {
                amplitude * real::sin(TAU * time / period + phase)
            }
            Self::Delayed { start, .. } if time < *start => 0.0,
            Self::Delayed { start, profile } => profile.value(time - start),
            Self::Table { times, values } => {
                let next = times.partition_point(|&t| t <= time);
                match next {
                    0 => values[0],
                    n if n == times.len() => values[n - 1],
                    n => {
                        let fraction = (time - times[n - 1]) / (times[n] - times[n - 1]);
                        values[n - 1] + fraction * (values[n] - values[n - 1])
                    }
                }
            }
        }
    }

    /// Integral over [start, start + step], exact but for formulas (see [`Formula::integral`]): of a velocity
    /// the displacement, m or rad.
    pub fn integral(&self, start: f64, step: f64) -> f64 {
        match self {
            Self::Constant(value) => value * step,
            Self::Formula(formula) => formula.integral(start, step),
            Self::Sinusoidal { amplitude, period, phase } => {
                // cos a - cos b as a product, which keeps all digits for short steps.
                let rate = TAU / period;
                let middle = rate * (start + 0.5 * step) + phase;
                2.0 * amplitude / rate * real::sin(middle) * real::sin(0.5 * rate * step)
            }
            Self::Delayed { start: rest, profile } => {
                let begin = start.max(*rest);
                let moving = start + step - begin;
                if moving > 0.0 { profile.integral(begin - rest, moving) } else { 0.0 }
            }
            Self::Table { times, .. } => {
                let end = start + step;
                let inside = times.iter().copied().filter(|&t| t > start && t < end);
                let (mut sum, mut from) = (0.0, start);
                for to in inside.chain([end]) {
                    // The profile is linear on [from, to], so the trapezium is exact.
                    sum += 0.5 * (to - from) * (self.value(from) + self.value(to));
                    from = to;
                }
                sum
            }
        }
    }

    /// Mean over [start, start + step].
    pub fn mean(&self, start: f64, step: f64) -> f64 {
        match self {
            Self::Constant(value) => *value,
            other => other.integral(start, step) / step,
        }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// [`ModelError`] for a number that is not finite, a period that is not positive, or a table that is
    /// empty, of unequal lengths, or whose times do not ascend.
    pub fn validate(&self) -> Result<(), ModelError> {
        match self {
            Self::Constant(value) => finite("a constant of time", &[*value]),
            Self::Formula(formula) => formula.validate(),
            Self::Sinusoidal { amplitude, period, phase } => {
                positive("the period of a sinusoid", *period)?;
                finite("the amplitude or phase of a sinusoid", &[*amplitude, *phase])
            }
            Self::Delayed { start, profile } => {
                finite("the start of a delayed function", &[*start])?;
                profile.validate()
            }
            Self::Table { times, values } => {
                let table = |what: String| Err(ModelError::Table { what });
                if times.len() != values.len() {
                    return table(format!(
                        "a table over time has {} times but {} values",
                        times.len(),
                        values.len()
                    ));
                }
                if times.is_empty() {
                    return Err(ModelError::Empty { what: "a table over time" });
                }
                finite("a time in a table over time", times)?;
                finite("a value in a table over time", values)?;
                match times.windows(2).find(|pair| pair[0] >= pair[1]) {
                    Some(pair) => table(format!(
                        "the times of a table must ascend, but {} follows {}",
                        pair[1], pair[0]
                    )),
                    None => Ok(()),
                }
            }
        }
    }
}

impl Motion {
    /// A body that never moves.
    pub fn fixed() -> Self {
        Self { free: [false; 6], translation: Vec::new(), rotation: None }
    }

    /// A body that translates along `direction` (not normalised) with the profile's velocity and does not
    /// turn.
    pub fn translating(direction: Vec3, profile: Profile) -> Self {
        Self { translation: vec![(direction, profile)], ..Self::fixed() }
    }

    /// A body that turns about an axis through a `point` of the world, on a circle where that is not its
    /// centre; `axis` is normalised here (a zero axis is refused when the motion is added to a world).
    pub fn rotating(point: Vec3, axis: Vec3, profile: Profile) -> Self {
        let axis = axis.normalize_or_zero();
        Self { rotation: Some(Rotation { point, of: Axes::World, axis, profile }), ..Self::fixed() }
    }

    /// A body that turns about an axis through its own centre of mass, wherever that goes; `axis` is
    /// normalised as in [`Motion::rotating`].
    pub fn spinning(axis: Vec3, profile: Profile) -> Self {
        let axis = axis.normalize_or_zero();
        Self {
            rotation: Some(Rotation { point: Vec3::ZERO, of: Axes::Body, axis, profile }),
            ..Self::fixed()
        }
    }

    /// The same motion with this translation besides, as [`Motion::translating`].
    pub fn and_translating(mut self, direction: Vec3, profile: Profile) -> Self {
        self.translation.push((direction, profile));
        self
    }

    /// The same motion with these degrees of freedom dynamic: x, y, z, then rotation about x, y, z.
    pub fn with_free(self, free: [bool; 6]) -> Self {
        Self { free, ..self }
    }

    /// Whether no degree of freedom is dynamic.
    pub fn is_prescribed(&self) -> bool {
        self.free == [false; 6]
    }

    /// Mean velocity and angular velocity over [time, time + step] of a body at `position` with this
    /// orientation: displacement over step, so that positions follow the exact path, and the centre of a body
    /// that turns about a distant axis stays on its circle (it moves along the chord).
    pub fn mean_velocity(&self, position: Vec3, orientation: Quat, time: f64, step: f64) -> (Vec3, Vec3) {
        let mut displacement: Vec3 = self
            .translation
            .iter()
            .map(|(direction, profile)| *direction * profile.integral(time, step))
            .sum();
        let mut turn = Vec3::ZERO;
        if let Some(Rotation { point, of, axis, profile }) = &self.rotation {
            let angle = profile.integral(time, step);
            let from_axis = match of {
                Axes::World => position - *point,
                Axes::Body => -(orientation * *point),
            };
            let across = axis.cross(from_axis);
            let half = real::sin(0.5 * angle);
            displacement += real::sin(angle) * across + 2.0 * half * half * axis.cross(across);
            turn = angle * *axis;
        }
        (displacement / step, turn / step)
    }

    /// Checks all profiles and the axis.
    ///
    /// # Errors
    /// [`ModelError`] for the first defect.
    pub fn validate(&self) -> Result<(), ModelError> {
        for (direction, profile) in &self.translation {
            finite("a direction of a prescribed translation", &direction.to_array())?;
            profile.validate()?;
        }
        if let Some(Rotation { point, axis, profile, .. }) = &self.rotation {
            finite("the point of a rotation axis", &point.to_array())?;
            let length = axis.length();
            if (length - 1.0).abs() > 1e-9 || length.is_nan() {
                let what = "the length of a rotation axis".to_string();
                return Err(ModelError::Value { what, value: length, expected: "1" });
            }
            profile.validate()?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrals_agree_with_fine_sums_of_values() {
        let profiles = [
            Profile::Constant(0.3),
            Profile::Sinusoidal { amplitude: 2.0, period: 0.7, phase: 0.4 },
            Profile::Table { times: vec![0.1, 0.3, 0.35], values: vec![1.0, -2.0, 5.0] },
            // Without a jump at the start, which the sum would not resolve.
            Profile::Delayed {
                start: 0.21,
                profile: Box::new(Profile::Sinusoidal { amplitude: 2.0, period: 0.7, phase: 0.0 }),
            },
        ];
        for profile in profiles {
            profile.validate().unwrap();
            for (start, step) in [(0.0, 0.05), (0.05, 0.4), (0.2, 0.13), (0.34, 1.0)] {
                let cells = 200_000;
                let size = step / f64::from(cells);
                let sum: f64 =
                    (0..cells).map(|i| size * profile.value(start + size * (f64::from(i) + 0.5))).sum();
                assert!((profile.integral(start, step) - sum).abs() < 1e-9, "{profile:?}");
            }
        }
    }

    #[test]
    fn steps_add_up_to_the_exact_path() {
        let profile = Profile::Sinusoidal { amplitude: 3.0, period: 4.0, phase: 0.0 };
        let motion = Motion::rotating(Vec3::new(1.0, 0.0, 0.0), Vec3::Z, profile.clone());
        let (mut position, step) = (Vec3::new(3.0, 0.0, 0.5), 0.025);
        for i in 0..1000 {
            let (velocity, _) = motion.mean_velocity(position, Quat::IDENTITY, f64::from(i) * step, step);
            position += step * velocity;
        }
        let angle = profile.integral(0.0, 25.0);
        let exact = Vec3::new(1.0 + 2.0 * angle.cos(), 2.0 * angle.sin(), 0.5);
        assert!((position - exact).length() < 1e-12);
    }

    /// A wheel's centre goes straight whatever it turns; a crank whose axis is in the body turns about that
    /// point, which translates.
    #[test]
    fn an_axis_of_the_body_moves_with_it() {
        let speed = Profile::Constant(2.0);
        let wheel = Motion::spinning(Vec3::Y, speed.clone()).and_translating(Vec3::X, Profile::Constant(0.1));
        assert_eq!(
            wheel.mean_velocity(Vec3::ONE, Quat::from_rotation_y(1.0), 0.3, 0.01).0,
            Vec3::new(0.1, 0.0, 0.0)
        );
        let pin = Vec3::new(-0.4, 0.0, 0.0);
        let crank = Rotation { point: pin, of: Axes::Body, axis: Vec3::Z, profile: speed };
        let crank = Motion { rotation: Some(crank), ..Motion::translating(Vec3::X, Profile::Constant(0.1)) };
        let (mut position, mut orientation, step) = (Vec3::new(0.4, 0.0, 0.0), Quat::IDENTITY, 0.01);
        for _ in 0..1000 {
            let (velocity, spin) = crank.mean_velocity(position, orientation, 0.0, step);
            position += step * velocity;
            orientation = crate::math::rotation_exponential(step * spin) * orientation;
        }
        let angle: f64 = 20.0;
        let exact = Vec3::new(1.0 + 0.4 * angle.cos(), 0.4 * angle.sin(), 0.0);
        assert!((position - exact).length() < 1e-12, "{position}");
    }

    #[test]
    fn bad_profiles_are_refused() {
        let bad = [
            Profile::Constant(f64::NAN),
            Profile::Sinusoidal { amplitude: 1.0, period: 0.0, phase: 0.0 },
            Profile::Table { times: vec![], values: vec![] },
            Profile::Table { times: vec![0.0, 0.0], values: vec![1.0, 2.0] },
            Profile::Table { times: vec![0.0], values: vec![1.0, 2.0] },
        ];
        for profile in bad {
            assert!(profile.validate().is_err(), "{profile:?}");
        }
        let no_axis = Motion::rotating(Vec3::ZERO, Vec3::ZERO, Profile::Constant(1.0));
        assert!(no_axis.validate().is_err());
    }
}
