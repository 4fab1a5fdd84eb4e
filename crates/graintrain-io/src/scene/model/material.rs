//! Materials and pairs of them.

use super::super::error::SceneError;
use super::super::names;
use super::super::reader::Reader;
use super::super::schema::D;
use super::super::table::{Choice, Field, table};
use graintrain::material::{MOST_COHESION, TurningResistance};
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

impl Choice for PairRule {
    const NAMES: &'static [(&'static str, Self)] = &[
        ("minimum", Self::Minimum),
        ("maximum", Self::Maximum),
        ("mean", Self::Mean),
        ("geometric-mean", Self::GeometricMean),
    ];
}

impl PairRule {
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

/// Force per length, and force per speed.
const STIFFNESS: D = D::new(0, 1, -2, 0);
const DAMPING: D = D::new(0, 1, -1, 0);

table! {
    /// A material.
    pub struct MaterialSpec: "`[material.NAME]`", checked by check_material {
        /// Density
        density: f64 = Quantity(D::DENSITY), "1000", "\"2500 kg/m^3\"", Positive;
        /// Coefficient of friction with itself
        friction: f64 = Quantity(D::NONE), "0.25", "0.5", NotNegative;
        /// Newton's coefficient of restitution with itself, 0 to 1
        restitution: f64 = Quantity(D::NONE), "0", "0.6", ZeroToOne;
        /// Rolling friction with itself: the largest tangential moment over the normal force, a length; a
        /// number is a multiple of the effective radius R_A R_B / (R_A + R_B)
        #[serde(skip_serializing_if = "TurningResistance::is_none", serialize_with = "as_written")]
        rolling_friction: TurningResistance = RatioOrLength, "0", "0.1", NotNegative;
        /// Spinning friction with itself: the same for the moment about the normal
        #[serde(skip_serializing_if = "TurningResistance::is_none", serialize_with = "as_written")]
        spinning_friction: TurningResistance = RatioOrLength, "0", "\"0.2 mm\"", NotNegative;
        /// Normal stiffness of every contact with itself; not with restitution
        #[serde(skip_serializing_if = "is_zero")]
        stiffness: f64 = Quantity(STIFFNESS), "0: rigid", "\"100 kN/m\"", NotNegative;
        /// Normal damping of every contact with itself; only with a stiffness
        #[serde(skip_serializing_if = "is_zero")]
        damping: f64 = Quantity(DAMPING), "0", "\"20 N s/m\"", NotNegative;
        /// Attraction of two bodies of this material while they touch
        #[serde(skip_serializing_if = "is_zero")]
        cohesion: f64 = Quantity(D::FORCE), "0", "\"2 mN\"", NotNegative;
    }
}

table! {
    /// Properties of a pair of materials.
    pub struct PairSpec: "`[[pair]]`", checked by check_pair {
        /// The two materials
        materials: [String; 2] = Texts, "required", "[\"glass\", \"steel\"]";
        /// Coefficient of friction between them
        friction: Option<f64> = Quantity(D::NONE), "contact.friction_rule", "0.2", NotNegative;
        /// Coefficient of restitution between them
        restitution: Option<f64> = Quantity(D::NONE), "contact.restitution_rule", "0.4", ZeroToOne;
        /// Rolling friction between them, a multiple of the effective radius or a length
        #[serde(serialize_with = "as_written_of_pair")]
        rolling_friction: Option<TurningResistance> = RatioOrLength, "contact.friction_rule",
            "0.05", NotNegative;
        /// Spinning friction between them, a multiple of the effective radius or a length
        #[serde(serialize_with = "as_written_of_pair")]
        spinning_friction: Option<TurningResistance> = RatioOrLength, "contact.friction_rule",
            "0.02", NotNegative;
        /// Normal stiffness of every contact between them; 0: rigid
        stiffness: Option<f64> = Quantity(STIFFNESS), "both in series", "\"50 kN/m\"", NotNegative;
        /// Normal damping of every contact between them
        damping: Option<f64> = Quantity(DAMPING), "both in series", "\"10 N s/m\"", NotNegative;
        /// Attraction of two such bodies while they touch
        cohesion: Option<f64> = Quantity(D::FORCE), "the smaller of both", "\"1 mN\"", NotNegative;
        location
    }
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

/// The names of two materials.
impl Field for [String; 2] {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        let Some(names) = reader.field::<Option<Vec<String>>>(key)? else { return Ok(None) };
        let names: Self = names
            .try_into()
            .map_err(|names: Vec<String>| reader.out_of_range(key, "two names", names.len()))?;
        let known = &reader.context.names.materials;
        names.iter().try_for_each(|name| names::check(reader, key, "material", name, known))?;
        Ok(Some(names))
    }
}

fn check_material(material: &MaterialSpec, reader: &Reader) -> Result<(), SceneError> {
    let MaterialSpec { stiffness, damping, restitution, cohesion, .. } = *material;
    check_cohesion(reader, cohesion)?;
    check_elasticity(reader, stiffness, damping, restitution)
}

fn check_pair(pair: &PairSpec, reader: &Reader) -> Result<(), SceneError> {
    check_cohesion(reader, pair.cohesion.unwrap_or_default())?;
    let [damping, restitution] = [pair.damping, pair.restitution].map(Option::unwrap_or_default);
    pair.stiffness.map_or(Ok(()), |stiffness| check_elasticity(reader, stiffness, damping, restitution))
}

fn check_cohesion(reader: &Reader, force: f64) -> Result<(), SceneError> {
    if force <= MOST_COHESION {
        return Ok(());
    }
    Err(reader.out_of_range("cohesion", &format!("at most {MOST_COHESION:e} N"), format!("{force:e}")))
}

/// Damping needs a stiffness, and a stiffness rebounds by itself.
fn check_elasticity(
    reader: &Reader,
    stiffness: f64,
    damping: f64,
    restitution: f64,
) -> Result<(), SceneError> {
    if stiffness == 0.0 && damping > 0.0 {
        return Err(reader.out_of_range("damping", "0 without a `stiffness`", damping));
    }
    if stiffness > 0.0 && restitution > 0.0 {
        let requirement = "0 with a `stiffness`, which rebounds by itself: give it `damping`";
        return Err(reader.out_of_range("restitution", requirement, restitution));
    }
    Ok(())
}
