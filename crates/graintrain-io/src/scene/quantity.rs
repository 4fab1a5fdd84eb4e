//! Physical quantities: a value in SI units with its dimension, and the units that a scene may use.

use graintrain_linalg::real;
use std::fmt;

/// Exponents of length, mass, time and angle. Angles are distinguished from plain numbers, so that degrees
/// where a length belongs is an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dimension {
    length: i8,
    mass: i8,
    time: i8,
    angle: i8,
}

impl Dimension {
    /// Plain number.
    pub const NONE: Self = Self::new(0, 0, 0, 0);
    /// m
    pub const LENGTH: Self = Self::new(1, 0, 0, 0);
    /// kg
    pub const MASS: Self = Self::new(0, 1, 0, 0);
    /// s
    pub const TIME: Self = Self::new(0, 0, 1, 0);
    /// rad
    pub const ANGLE: Self = Self::new(0, 0, 0, 1);
    /// m/s
    pub const SPEED: Self = Self::new(1, 0, -1, 0);
    /// m/s^2
    pub const ACCELERATION: Self = Self::new(1, 0, -2, 0);
    /// 1/s
    pub const RATE: Self = Self::new(0, 0, -1, 0);
    /// kg/s
    pub const MASS_RATE: Self = Self::new(0, 1, -1, 0);
    /// rad/s
    pub const ANGULAR_SPEED: Self = Self::new(0, 0, -1, 1);
    /// kg/m^3
    pub const DENSITY: Self = Self::new(-3, 1, 0, 0);
    /// m^2
    pub const AREA: Self = Self::new(2, 0, 0, 0);
    /// kg m/s^2
    pub const FORCE: Self = Self::new(1, 1, -2, 0);
    /// kg/m/s^2
    pub const PRESSURE: Self = Self::new(-1, 1, -2, 0);
    /// kg m^2/s^2; of a torque as well
    pub const ENERGY: Self = Self::new(2, 1, -2, 0);
    const POWER: Self = Self::new(2, 1, -3, 0);

    pub(crate) const fn new(length: i8, mass: i8, time: i8, angle: i8) -> Self {
        Self { length, mass, time, angle }
    }

    fn exponents(self) -> [i8; 4] {
        [self.length, self.mass, self.time, self.angle]
    }

    fn from_exponents([length, mass, time, angle]: [i8; 4]) -> Self {
        Self::new(length, mass, time, angle)
    }

    fn combine(self, other: Self, f: impl Fn(i8, i8) -> Option<i8>) -> Option<Self> {
        let (a, b) = (self.exponents(), other.exponents());
        Some(Self::from_exponents([f(a[0], b[0])?, f(a[1], b[1])?, f(a[2], b[2])?, f(a[3], b[3])?]))
    }

    /// SI unit, e.g. `kg/m^3`; empty for plain numbers.
    pub fn unit(self) -> String {
        if let Some((_, unit)) = DERIVED.iter().find(|(dimension, _)| *dimension == self) {
            return (*unit).into();
        }
        let symbols = ["m", "kg", "s", "rad"].into_iter().zip(self.exponents());
        let power = |symbol: &str, exponent: i8| match exponent {
            1 => symbol.to_string(),
            exponent => format!("{symbol}^{exponent}"),
        };
        let above: Vec<String> =
            symbols.clone().filter(|(_, e)| *e > 0).map(|(symbol, e)| power(symbol, e)).collect();
        let below: Vec<String> =
            symbols.filter(|(_, e)| *e < 0).map(|(symbol, e)| power(symbol, -e)).collect();
        match (above.is_empty(), below.is_empty()) {
            (_, true) => above.join(" "),
            (true, false) => format!("1/{}", below.join("/")),
            (false, false) => format!("{}/{}", above.join(" "), below.join("/")),
        }
    }

    /// Name where it has one.
    fn name(self) -> &'static str {
        match self {
            Self::NONE => "a number without unit",
            Self::LENGTH => "a length",
            Self::AREA => "an area",
            Self::MASS => "a mass",
            Self::TIME => "a time",
            Self::ANGLE => "an angle",
            Self::SPEED => "a speed",
            Self::ACCELERATION => "an acceleration",
            Self::RATE => "a rate",
            Self::MASS_RATE => "a mass per time",
            Self::ANGULAR_SPEED => "an angular speed",
            Self::DENSITY => "a density",
            Self::FORCE => "a force",
            Self::PRESSURE => "a pressure",
            Self::ENERGY => "an energy",
            Self::POWER => "a power",
            _ => "a quantity",
        }
    }
}

/// Units that are read more easily than those that they are made of.
const DERIVED: &[(Dimension, &str)] = &[
    (Dimension::FORCE, "N"),
    (Dimension::PRESSURE, "Pa"),
    (Dimension::ENERGY, "N m"),
    (Dimension::POWER, "W"),
    (Dimension::new(0, 1, -2, 0), "N/m"),
    (Dimension::new(2, 1, -2, -1), "N m/rad"),
    (Dimension::new(2, 1, -1, -1), "N m s/rad"),
];

impl fmt::Display for Dimension {
    /// "a length (m)", "a number without unit", "a quantity (m s)".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NONE => f.write_str(self.name()),
            _ => write!(f, "{} ({})", self.name(), self.unit()),
        }
    }
}

/// A value in SI units with its dimension.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    /// Value in SI units.
    pub value: f64,
    /// Its dimension.
    pub dimension: Dimension,
}

impl Quantity {
    /// A number without unit.
    pub fn number(value: f64) -> Self {
        Self { value, dimension: Dimension::NONE }
    }

    pub(crate) fn multiply(self, other: Self) -> Result<Self, String> {
        let dimension =
            self.dimension.combine(other.dimension, i8::checked_add).ok_or_else(too_large_power)?;
        Ok(Self { value: self.value * other.value, dimension })
    }

    pub(crate) fn divide(self, other: Self) -> Result<Self, String> {
        if other.value == 0.0 {
            return Err("division by zero".into());
        }
        let dimension =
            self.dimension.combine(other.dimension, i8::checked_sub).ok_or_else(too_large_power)?;
        Ok(Self { value: self.value / other.value, dimension })
    }

    pub(crate) fn power(self, exponent: Self) -> Result<Self, String> {
        if exponent.dimension != Dimension::NONE {
            return Err(format!("an exponent must be a number without unit, got {}", exponent.dimension));
        }
        if self.dimension == Dimension::NONE {
            return Ok(Self::number(real::powf(self.value, exponent.value)));
        }
        if exponent.value.fract() != 0.0 || exponent.value.abs() > 9.0 {
            return Err(format!("the exponent of {} must be a whole number up to 9", self.dimension));
        }
        let power = exponent.value as i8;
        let dimension = self
            .dimension
            .combine(Dimension::NONE, |exponent, _| exponent.checked_mul(power))
            .ok_or_else(too_large_power)?;
        Ok(Self { value: self.value.powi(power.into()), dimension })
    }

    pub(crate) fn square_root(self) -> Result<Self, String> {
        let dimension = self
            .dimension
            .combine(Dimension::NONE, |exponent, _| (exponent % 2 == 0).then_some(exponent / 2))
            .ok_or_else(|| format!("the square root of {} has no unit", self.dimension))?;
        Ok(Self { value: self.value.sqrt(), dimension })
    }
}

fn too_large_power() -> String {
    "a unit's power is too large".into()
}

/// Units by symbol, with their value in SI.
const UNITS: &[(&str, f64, Dimension)] = &[
    ("m", 1.0, Dimension::LENGTH),
    ("km", 1e3, Dimension::LENGTH),
    ("dm", 1e-1, Dimension::LENGTH),
    ("cm", 1e-2, Dimension::LENGTH),
    ("mm", 1e-3, Dimension::LENGTH),
    ("um", 1e-6, Dimension::LENGTH),
    ("\u{b5}m", 1e-6, Dimension::LENGTH),
    ("\u{3bc}m", 1e-6, Dimension::LENGTH),
    ("nm", 1e-9, Dimension::LENGTH),
    ("kg", 1.0, Dimension::MASS),
    ("g", 1e-3, Dimension::MASS),
    ("mg", 1e-6, Dimension::MASS),
    ("t", 1e3, Dimension::MASS),
    ("s", 1.0, Dimension::TIME),
    ("ms", 1e-3, Dimension::TIME),
    ("us", 1e-6, Dimension::TIME),
    ("min", 60.0, Dimension::TIME),
    ("h", 3600.0, Dimension::TIME),
    ("rad", 1.0, Dimension::ANGLE),
    ("deg", std::f64::consts::PI / 180.0, Dimension::ANGLE),
    ("rev", std::f64::consts::TAU, Dimension::ANGLE),
    ("rpm", std::f64::consts::TAU / 60.0, Dimension::ANGULAR_SPEED),
    ("Hz", 1.0, Dimension::new(0, 0, -1, 0)),
    ("N", 1.0, Dimension::FORCE),
    ("uN", 1e-6, Dimension::FORCE),
    ("mN", 1e-3, Dimension::FORCE),
    ("kN", 1e3, Dimension::FORCE),
    ("MN", 1e6, Dimension::FORCE),
    ("Pa", 1.0, Dimension::PRESSURE),
    ("kPa", 1e3, Dimension::PRESSURE),
    ("MPa", 1e6, Dimension::PRESSURE),
    ("J", 1.0, Dimension::ENERGY),
    ("W", 1.0, Dimension::POWER),
];

/// The unit with this symbol.
pub(crate) fn unit(symbol: &str) -> Option<Quantity> {
    UNITS
        .iter()
        .find(|(name, _, _)| *name == symbol)
        .map(|&(_, value, dimension)| Quantity { value, dimension })
}

/// Symbols of all units.
pub(crate) fn unit_symbols() -> impl Iterator<Item = &'static str> {
    UNITS.iter().map(|(name, _, _)| *name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dimensions_are_named_with_their_si_unit() {
        assert_eq!(Dimension::LENGTH.to_string(), "a length (m)");
        assert_eq!(Dimension::NONE.to_string(), "a number without unit");
        assert_eq!(Dimension::DENSITY.to_string(), "a density (kg/m^3)");
        assert_eq!(Dimension::FORCE.to_string(), "a force (N)");
        assert_eq!(Dimension::new(1, 0, 1, 0).to_string(), "a quantity (m s)");
        assert_eq!(Dimension::new(-1, 0, -2, 0).to_string(), "a quantity (1/m/s^2)");
    }

    #[test]
    fn unit_symbols_are_unique() {
        let mut symbols: Vec<_> = unit_symbols().collect();
        symbols.sort_unstable();
        symbols.dedup();
        assert_eq!(symbols.len(), UNITS.len());
    }

    #[test]
    fn derived_units_agree_with_their_definition() {
        let [kg, m, s] = ["kg", "m", "s"].map(|symbol| unit(symbol).unwrap());
        let newton = kg.multiply(m).unwrap().divide(s.power(Quantity::number(2.0)).unwrap()).unwrap();
        assert_eq!(newton, unit("N").unwrap());
        let joule = newton.multiply(m).unwrap();
        assert_eq!(joule, unit("J").unwrap());
        assert_eq!(joule.divide(s).unwrap(), unit("W").unwrap());
        assert_eq!(newton.divide(m).unwrap().divide(m).unwrap(), unit("Pa").unwrap());
        assert_eq!(unit("rev").unwrap().divide(unit("min").unwrap()).unwrap(), unit("rpm").unwrap());
    }

    #[test]
    fn roots_need_even_powers() {
        let area = unit("m").unwrap().power(Quantity::number(2.0)).unwrap();
        assert_eq!(area.square_root().unwrap().dimension, Dimension::LENGTH);
        assert!(unit("m").unwrap().square_root().is_err());
    }
}
