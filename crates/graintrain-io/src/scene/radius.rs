//! Distributions of radii, as scenes have them, by number or by mass.

mod draw;

use super::error::SceneError;
use super::model::RadiusSpec;
use super::reader::Reader;
use super::table::{Field, Spec, table};
use super::tree::{Node, Value};
pub(crate) use draw::{draw, one};
use serde::{Deserialize, Serialize};

table! {
    /// How radii are distributed.
    #[derive(Deserialize)]
    pub enum RadiusForm: "`packing.NAME.radius`" {
        /// Uniform between two radii
        Uniform(Uniform): uniform = Table(Uniform::TABLE), "{ min = \"4 mm\", max = \"6 mm\" }";
        /// Normal, cut off at two radii
        Normal(Normal): normal = Table(Normal::TABLE),
            "{ mean = \"5 mm\", deviation = \"0.5 mm\", min = \"4 mm\", max = \"6 mm\" }";
        /// Log-normal, cut off at two radii
        Lognormal(Lognormal): lognormal = Table(Lognormal::TABLE),
            "{ median = \"5 mm\", deviation = 0.2, min = \"3 mm\", max = \"8 mm\" }";
        /// One of several radii
        Choice(OneOfSeveral): choice = Table(OneOfSeveral::TABLE),
            "{ radii = [\"4 mm\", \"8 mm\"], weights = [0.9, 0.1] }";
        /// Rosin-Rammler, cut off at two radii: cumulative mass fraction 1 - exp(-(r/size)^spread) up to
        /// radius r
        RosinRammler(RosinRammler): rosin_rammler = Table(RosinRammler::TABLE),
            "{ size = \"5 mm\", spread = 3, min = \"2 mm\", max = \"8 mm\" }";
        /// A grading curve by mass, linear in the logarithm of the opening between sieves
        Sieves(Sieves): sieves = Table(Sieves::TABLE),
            "{ openings = [\"2 mm\", \"4 mm\", \"8 mm\"], passing = [0, 0.3, 1] }";
    }
}

table! {
    /// The table of a distribution.
    pub(crate) struct RadiusTable: "`packing.NAME.radius`",
        at most one of ["uniform", "normal", "lognormal", "choice", "rosin_rammler", "sieves"],
        checked by counts_its_own {
        /// Of which form.
        #[serde(flatten)]
        form: RadiusForm => RadiusForm::read;
        keys of RadiusForm::TABLE;
        /// Whether fractions, weights, medians and means are by number of spheres, or by mass
        by: Option<Share> = Text, "\"number\"; of rosin_rammler and sieves \"mass\"", "\"mass\"";
    }
}

table! {
    /// Uniform between two radii.
    #[derive(Deserialize)]
    pub struct Uniform: "`radius.uniform`", checked by is_uniform {
        /// Smallest radius
        min: f64 = Quantity(D::LENGTH), "required", "\"4 mm\"", Positive;
        /// Largest radius
        max: f64 = Quantity(D::LENGTH), "required", "\"6 mm\"", Positive;
    }
}

table! {
    /// Normal, cut off at two radii.
    #[derive(Deserialize)]
    pub struct Normal: "`radius.normal`", checked by is_normal {
        /// Mean before the cut
        mean: f64 = Quantity(D::LENGTH), "required", "\"5 mm\"", Positive;
        /// Standard deviation before the cut
        deviation: f64 = Quantity(D::LENGTH), "required", "\"0.5 mm\"", NotNegative;
        /// Smallest radius
        min: f64 = Quantity(D::LENGTH), "required", "\"4 mm\"", Positive;
        /// Largest radius
        max: f64 = Quantity(D::LENGTH), "required", "\"6 mm\"", Positive;
    }
}

table! {
    /// Log-normal, cut off at two radii.
    #[derive(Deserialize)]
    pub struct Lognormal: "`radius.lognormal`", checked by is_lognormal {
        /// Median before the cut
        median: f64 = Quantity(D::LENGTH), "required", "\"5 mm\"", Positive;
        /// Standard deviation of the logarithm before the cut
        deviation: f64 = Quantity(D::NONE), "required", "0.2", NotNegative;
        /// Smallest radius
        min: f64 = Quantity(D::LENGTH), "required", "\"4 mm\"", Positive;
        /// Largest radius
        max: f64 = Quantity(D::LENGTH), "required", "\"6 mm\"", Positive;
    }
}

table! {
    /// One of several radii.
    #[derive(Deserialize)]
    pub struct OneOfSeveral: "`radius.choice`", checked by is_choice {
        /// The radii
        radii: Vec<f64> = List(D::LENGTH), "required", "[\"4 mm\", \"8 mm\"]", Positive;
        /// Relative frequency of each; any sum
        weights: Vec<f64> = List(D::NONE), "equal", "[0.9, 0.1]", NotNegative => weights;
    }
}

table! {
    /// Rosin and Rammler, cut off at two radii: up to radius r there is the share 1 - exp(-(r / size)^spread)
    /// of the mass.
    #[derive(Deserialize)]
    pub struct RosinRammler: "`radius.rosin_rammler`", checked by is_rosin_rammler {
        /// Radius with a cumulative mass fraction of 63.2 % before the cut
        size: f64 = Quantity(D::LENGTH), "required", "\"5 mm\"", Positive;
        /// Exponent, at most 100: the larger, the narrower
        spread: f64 = Quantity(D::NONE), "required", "3", Positive;
        /// Smallest radius
        min: f64 = Quantity(D::LENGTH), "required", "\"4 mm\"", Positive;
        /// Largest radius
        max: f64 = Quantity(D::LENGTH), "required", "\"6 mm\"", Positive;
    }
}

table! {
    /// A grading curve: shares of the mass that pass sieves, straight lines over the logarithm of the opening
    /// between them.
    #[derive(Deserialize)]
    pub struct Sieves: "`radius.sieves`", checked by is_sieves {
        /// Openings, ascending: the largest *diameters* that pass
        openings: Vec<f64> = List(D::LENGTH), "required", "[\"2 mm\", \"4 mm\", \"8 mm\"]", Positive;
        /// Mass fraction that passes each, from 0 to 1
        passing: Vec<f64> = List(D::NONE), "required", "[0, 0.3, 1]", ZeroToOne;
    }
}

/// What shares count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Share {
    Number,
    Mass,
}

impl super::table::Choice for Share {
    const NAMES: &'static [(&'static str, Self)] = &[("number", Self::Number), ("mass", Self::Mass)];
}

/// Radii of a form, shares of which are meant by number or by mass: of spheres of one density, so many of
/// which weigh as much as go with the cube of the radius less.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RadiusDistribution {
    /// The form.
    pub form: RadiusForm,
    /// Whether its shares are by mass; of forms that are by mass always, not.
    pub by_mass: bool,
}

/// Largest exponent of Rosin and Rammler: all sizes are equal to a percent.
const MOST_SPREAD: f64 = 100.0;

impl Field for RadiusSpec {
    fn given(packing: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        if !matches!(packing.get(key), Some(Node { value: Value::Table(_), .. })) {
            return packing.quantity(key).map(|radius| radius.map(Self::Single));
        }
        let RadiusTable { form, by } = RadiusTable::read(&packing.required_child(key)?)?;
        let by_mass = by == Some(Share::Mass) && !form.is_by_mass();
        Ok(Some(Self::Distribution(RadiusDistribution { form, by_mass })))
    }
}

fn counts_its_own(table: &RadiusTable, reader: &Reader) -> Result<(), SceneError> {
    if table.form.is_by_mass() && table.by == Some(Share::Number) {
        return Err(reader.out_of_range("by", &format!("\"mass\" of `{}`", reader.which()?), "number"));
    }
    Ok(())
}

fn is_uniform(&Uniform { min, max }: &Uniform, reader: &Reader) -> Result<(), SceneError> {
    is_cut(reader, [min, max])
}

fn is_normal(&Normal { mean, min, max, .. }: &Normal, reader: &Reader) -> Result<(), SceneError> {
    is_cut(reader, [min, max])?;
    is_inside(reader, "mean", mean, [min, max])
}

fn is_lognormal(&Lognormal { median, min, max, .. }: &Lognormal, reader: &Reader) -> Result<(), SceneError> {
    is_cut(reader, [min, max])?;
    is_inside(reader, "median", median, [min, max])
}

fn is_rosin_rammler(
    &RosinRammler { size, spread, min, max }: &RosinRammler,
    reader: &Reader,
) -> Result<(), SceneError> {
    is_cut(reader, [min, max])?;
    is_inside(reader, "size", size, [min, max])?;
    if spread > MOST_SPREAD {
        return Err(reader.out_of_range("spread", &format!("at most {MOST_SPREAD}"), spread));
    }
    Ok(())
}

fn is_cut(reader: &Reader, [min, max]: [f64; 2]) -> Result<(), SceneError> {
    if max < min {
        return Err(reader.out_of_range("max", &format!("at least min ({min} m)"), format!("{max} m")));
    }
    Ok(())
}

/// The cut must leave a fair part of the distribution: radii are drawn until one falls inside.
fn is_inside(reader: &Reader, key: &str, centre: f64, [min, max]: [f64; 2]) -> Result<(), SceneError> {
    if (min..=max).contains(&centre) {
        return Ok(());
    }
    let requirement = format!("between min and max ({min} m to {max} m)");
    Err(reader.out_of_range(key, &requirement, format!("{centre} m")))
}

/// Equal where they are not given.
fn weights(reader: &Reader, key: &str) -> Result<Vec<f64>, SceneError> {
    match reader.list(key)? {
        Some(weights) => Ok(weights),
        None => Ok(vec![1.0; reader.field::<Vec<f64>>("radii")?.len()]),
    }
}

fn is_choice(OneOfSeveral { radii, weights }: &OneOfSeveral, reader: &Reader) -> Result<(), SceneError> {
    if weights.len() != radii.len() || radii.is_empty() {
        let requirement = format!("as many as the radii ({}), at least one", radii.len());
        return Err(reader.out_of_range("weights", &requirement, weights.len()));
    }
    if weights.iter().sum::<f64>() <= 0.0 {
        return Err(reader.out_of_range("weights", "positive in sum", format!("{weights:?}")));
    }
    Ok(())
}

fn is_sieves(Sieves { openings, passing }: &Sieves, reader: &Reader) -> Result<(), SceneError> {
    if openings.len() < 2 || !openings.is_sorted_by(|a, b| a < b) {
        let requirement = "two or more, each larger than the one before";
        return Err(reader.out_of_range("openings", requirement, format!("{openings:?} m")));
    }
    if passing.len() != openings.len() {
        let requirement = format!("as many as the openings ({})", openings.len());
        return Err(reader.out_of_range("passing", &requirement, passing.len()));
    }
    if passing[0] != 0.0 || passing[passing.len() - 1] != 1.0 || !passing.is_sorted() {
        let requirement = "shares that begin with 0, never fall, and end with 1: the smallest and the largest size are needed";
        return Err(reader.out_of_range("passing", requirement, format!("{passing:?}")));
    }
    Ok(())
}

impl RadiusForm {
    /// Whether its shares are by mass always.
    fn is_by_mass(&self) -> bool {
        matches!(self, Self::RosinRammler(_) | Self::Sieves(_))
    }

    /// Smallest and largest radius, m.
    fn range(&self) -> [f64; 2] {
        match self {
            &Self::Uniform(Uniform { min, max })
            | &Self::Normal(Normal { min, max, .. })
            | &Self::Lognormal(Lognormal { min, max, .. })
            | &Self::RosinRammler(RosinRammler { min, max, .. }) => [min, max],
            // Sieves that hold nothing back, and those that let nothing through, bound nothing.
            Self::Sieves(Sieves { openings, passing }) => {
                let first = passing.iter().rposition(|&share| share <= 0.0).unwrap_or(0);
                let last = passing.iter().position(|&share| share >= 1.0).unwrap_or(openings.len() - 1);
                [0.5 * openings[first], 0.5 * openings[last]]
            }
            Self::Choice(OneOfSeveral { radii, weights }) => {
                let drawn = radii.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
                drawn.fold([f64::INFINITY, 0.0], |[low, high], (radius, _)| {
                    [low.min(*radius), high.max(*radius)]
                })
            }
        }
    }
}

impl RadiusDistribution {
    /// The same radius always.
    pub fn single(radius: f64) -> Self {
        let form = RadiusForm::Choice(OneOfSeveral { radii: vec![radius], weights: vec![1.0] });
        Self { form, by_mass: false }
    }

    /// Whether there are only so many radii, which bodies may share.
    pub fn is_discrete(&self) -> bool {
        matches!(self.form, RadiusForm::Choice(_))
    }

    /// Whether radii can be drawn from it.
    pub(crate) fn is_sound(&self) -> bool {
        let positive = |r: &f64| r.is_finite() && *r > 0.0;
        match &self.form {
            RadiusForm::Choice(OneOfSeveral { radii, weights }) => {
                radii.len() == weights.len() && !radii.is_empty() && radii.iter().all(positive)
            }
            RadiusForm::Sieves(Sieves { openings, passing }) => {
                openings.len() == passing.len()
                    && openings.len() >= 2
                    && openings.iter().all(positive)
                    && openings.is_sorted_by(|a, b| a < b)
                    && passing.is_sorted()
            }
            form => form.range().iter().all(positive),
        }
    }

    /// Smallest and largest radius, m.
    pub fn range(&self) -> [f64; 2] {
        self.form.range()
    }

    /// The table that a scene has for it.
    pub(crate) fn table(&self) -> RadiusTable {
        RadiusTable { form: self.form.clone(), by: self.by_mass.then_some(Share::Mass) }
    }
}
