//! Materials and pairs of them.

use super::super::error::Location;
use graintrain::material::TurningResistance;
use serde::{Serialize, Serializer};

/// How a property of a pair follows from those of its two materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PairRule {
    /// The smaller.
    Minimum,
    /// The larger.
    Maximum,
    /// Their arithmetic mean.
    Mean,
    /// The root of their product.
    GeometricMean,
}

impl PairRule {
    pub(crate) const NAMES: &[(&str, Self)] = &[
        ("minimum", Self::Minimum),
        ("maximum", Self::Maximum),
        ("mean", Self::Mean),
        ("geometric-mean", Self::GeometricMean),
    ];

    /// The pair's property.
    pub fn combine(self, first: f64, second: f64) -> f64 {
        match self {
            Self::Minimum => first.min(second),
            Self::Maximum => first.max(second),
            Self::Mean => 0.5 * (first + second),
            Self::GeometricMean => (first * second).sqrt(),
        }
    }

    /// The pair's resistance to turning. `None` where one is a ratio and the other a length: neither says
    /// what the pair's is.
    pub fn combine_turning(
        self,
        first: TurningResistance,
        second: TurningResistance,
    ) -> Option<TurningResistance> {
        use TurningResistance::{Length, Ratio};
        match (first, second) {
            (Ratio(a), Ratio(b)) => Some(Ratio(self.combine(a, b))),
            (Length(a), Length(b)) => Some(Length(self.combine(a, b))),
            (Ratio(zero), Length(b)) | (Length(b), Ratio(zero)) if zero == 0.0 => {
                Some(Length(self.combine(b, zero)))
            }
            (Ratio(a), Length(zero)) | (Length(zero), Ratio(a)) if zero == 0.0 => {
                Some(Ratio(self.combine(a, zero)))
            }
            _ => None,
        }
    }
}

/// A material.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MaterialSpec {
    /// kg/m^3
    pub density: f64,
    /// With itself.
    pub friction: f64,
    /// With itself.
    pub restitution: f64,
    /// Resistance to rolling on itself.
    #[serde(skip_serializing_if = "TurningResistance::is_none", serialize_with = "as_written")]
    pub rolling_friction: TurningResistance,
    /// Resistance to spinning on itself.
    #[serde(skip_serializing_if = "TurningResistance::is_none", serialize_with = "as_written")]
    pub spinning_friction: TurningResistance,
    /// Of contacts with itself, N/m; zero: rigid.
    #[serde(skip_serializing_if = "is_zero")]
    pub stiffness: f64,
    /// Of contacts with itself, N s/m.
    #[serde(skip_serializing_if = "is_zero")]
    pub damping: f64,
    /// Pull on itself, N.
    #[serde(skip_serializing_if = "is_zero")]
    pub cohesion: f64,
}

/// Whether a number is left out where it is its own default.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A resistance to turning as scenes write it: a number, or a text with a length.
fn as_written<S: Serializer>(resistance: &TurningResistance, serializer: S) -> Result<S::Ok, S::Error> {
    match resistance {
        TurningResistance::Ratio(ratio) => serializer.serialize_f64(*ratio),
        TurningResistance::Length(length) => serializer.serialize_str(&format!("{length:e} m")),
    }
}

/// The same of a pair; left out where it follows the rule.
fn as_written_of_pair<S: Serializer>(
    resistance: &Option<TurningResistance>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    match resistance {
        Some(resistance) => as_written(resistance, serializer),
        None => serializer.serialize_none(),
    }
}

/// Properties of a pair of materials.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairSpec {
    /// Their names.
    pub materials: [String; 2],
    /// Coefficient of friction; `None` follows the rule.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Coefficient of restitution; `None` follows the rule.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
    /// Resistance to rolling on each other; `None` follows the rule of friction.
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "as_written_of_pair")]
    pub rolling_friction: Option<TurningResistance>,
    /// Resistance to spinning on each other; `None` follows the rule of friction.
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "as_written_of_pair")]
    pub spinning_friction: Option<TurningResistance>,
    /// Stiffness of contacts, N/m; `None` follows from both materials.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<f64>,
    /// Damping of contacts, N s/m; `None` follows from both materials.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damping: Option<f64>,
    /// Pull on each other, N; `None` is the smaller of both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cohesion: Option<f64>,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}
