//! Sizes of spheres as scenes have them: one radius, or a distribution by number or by mass.

use super::error::SceneError;
use super::model::{RadiusDistribution, RadiusSpec};
use super::reader::Reader;
use super::table::{Field, table};
use super::tree::{Node, Value};

table! {
    pub(super) static RADIUS: "`packing.NAME.radius`",
        at most one of ["uniform", "normal", "lognormal", "choice", "rosin_rammler", "sieves"] {
        /// Uniform between two radii
        uniform = Table(&UNIFORM), "one of", "{ min = \"4 mm\", max = \"6 mm\" }";
        /// Normal, cut off at two radii
        normal = Table(&NORMAL), "one of",
            "{ mean = \"5 mm\", deviation = \"0.5 mm\", min = \"4 mm\", max = \"6 mm\" }";
        /// Log-normal, cut off at two radii
        lognormal = Table(&LOGNORMAL), "one of",
            "{ median = \"5 mm\", deviation = 0.2, min = \"3 mm\", max = \"8 mm\" }";
        /// One of several radii
        choice = Table(&CHOICE), "one of", "{ radii = [\"4 mm\", \"8 mm\"], weights = [0.9, 0.1] }";
        /// Rosin-Rammler, cut off at two radii: cumulative mass fraction 1 - exp(-(r/size)^spread) up to
        /// radius r
        rosin_rammler = Table(&ROSIN_RAMMLER), "one of",
            "{ size = \"5 mm\", spread = 3, min = \"2 mm\", max = \"8 mm\" }";
        /// A grading curve by mass, linear in the logarithm of the opening between sieves
        sieves = Table(&SIEVES), "one of",
            "{ openings = [\"2 mm\", \"4 mm\", \"8 mm\"], passing = [0, 0.3, 1] }";
        /// Whether fractions, weights, medians and means are by number of spheres, or by mass
        by = Text, "\"number\"; of rosin_rammler and sieves \"mass\"", "\"mass\"" in BY;
    }
}

table! {
    static UNIFORM: "`radius.uniform`" {
        /// Smallest radius
        min = Quantity(D::LENGTH), "required", "\"4 mm\"", Positive;
        /// Largest radius
        max = Quantity(D::LENGTH), "required", "\"6 mm\"", Positive;
    }
}

table! {
    static NORMAL: "`radius.normal`" {
        /// Mean before the cut
        mean = Quantity(D::LENGTH), "required", "\"5 mm\"", Positive;
        /// Standard deviation before the cut
        deviation = Quantity(D::LENGTH), "required", "\"0.5 mm\"", NotNegative;
        keys of UNIFORM;
    }
}

table! {
    static LOGNORMAL: "`radius.lognormal`" {
        /// Median before the cut
        median = Quantity(D::LENGTH), "required", "\"5 mm\"", Positive;
        /// Standard deviation of the logarithm before the cut
        deviation = Quantity(D::NONE), "required", "0.2", NotNegative;
        keys of UNIFORM;
    }
}

table! {
    static CHOICE: "`radius.choice`" {
        /// The radii
        radii = List(D::LENGTH), "required", "[\"4 mm\", \"8 mm\"]", Positive;
        /// Relative frequency of each; any sum
        weights = List(D::NONE), "equal", "[0.9, 0.1]", NotNegative;
    }
}

table! {
    static ROSIN_RAMMLER: "`radius.rosin_rammler`" {
        /// Radius with a cumulative mass fraction of 63.2 % before the cut
        size = Quantity(D::LENGTH), "required", "\"5 mm\"", Positive;
        /// Exponent, at most 100: the larger, the narrower
        spread = Quantity(D::NONE), "required", "3", Positive;
        keys of UNIFORM;
    }
}

table! {
    static SIEVES: "`radius.sieves`" {
        /// Openings, ascending: the largest *diameters* that pass
        openings = List(D::LENGTH), "required", "[\"2 mm\", \"4 mm\", \"8 mm\"]", Positive;
        /// Mass fraction that passes each, from 0 to 1
        passing = List(D::NONE), "required", "[0, 0.3, 1]", ZeroToOne;
    }
}

/// What distributions count, and whether that is mass.
const BY: &[(&str, bool)] = &[("number", false), ("mass", true)];

/// Largest exponent of Rosin and Rammler: all sizes are equal to a percent.
const MOST_SPREAD: f64 = 100.0;

impl Field for RadiusSpec {
    fn given(packing: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        if !matches!(packing.get(key), Some(Node { value: Value::Table(_), .. })) {
            return packing.quantity(key).map(|radius| radius.map(Self::Single));
        }
        let reader = packing.required_child(key)?;
        let (form, inner) = reader.form()?;
        let by_mass = reader.choice("by", BY)?;
        let distribution = distribution(form, &inner)?;
        Ok(Some(Self::Distribution(match (form, by_mass) {
            ("rosin_rammler" | "sieves", Some(false)) => {
                return Err(reader.out_of_range("by", &format!("\"mass\" of `{form}`"), "number"));
            }
            ("rosin_rammler" | "sieves", _) | (_, None | Some(false)) => distribution,
            _ => RadiusDistribution::ByMass(Box::new(distribution)),
        })))
    }
}

fn distribution(form: &str, inner: &Reader) -> Result<RadiusDistribution, SceneError> {
    if form == "sieves" {
        return sieves(inner);
    }
    if form == "choice" {
        let radii: Vec<f64> = inner.field("radii")?;
        let weights = inner.list("weights")?.unwrap_or_else(|| vec![1.0; radii.len()]);
        if weights.len() != radii.len() || radii.is_empty() {
            let requirement = format!("as many as the radii ({}), at least one", radii.len());
            return Err(inner.out_of_range("weights", &requirement, weights.len()));
        }
        if weights.iter().sum::<f64>() <= 0.0 {
            return Err(inner.out_of_range("weights", "positive in sum", format!("{weights:?}")));
        }
        return Ok(RadiusDistribution::Choice { radii, weights });
    }
    let min: f64 = inner.field("min")?;
    let max: f64 = inner.field("max")?;
    if max < min {
        return Err(inner.out_of_range("max", &format!("at least min ({min} m)"), format!("{max} m")));
    }
    // The cut must leave a fair part of the distribution: radii are drawn until one falls inside.
    let inside = |key: &str, centre: f64| {
        if (min..=max).contains(&centre) {
            return Ok(());
        }
        Err(inner.out_of_range(
            key,
            &format!("between min and max ({min} m to {max} m)"),
            format!("{centre} m"),
        ))
    };
    Ok(match form {
        "uniform" => RadiusDistribution::Uniform { min, max },
        "normal" => {
            let mean: f64 = inner.field("mean")?;
            inside("mean", mean)?;
            let deviation: f64 = inner.field("deviation")?;
            RadiusDistribution::Normal { mean, deviation, min, max }
        }
        "rosin_rammler" => {
            let size: f64 = inner.field("size")?;
            inside("size", size)?;
            let spread: f64 = inner.field("spread")?;
            if spread > MOST_SPREAD {
                return Err(inner.out_of_range("spread", &format!("at most {MOST_SPREAD}"), spread));
            }
            RadiusDistribution::RosinRammler { size, spread, min, max }
        }
        _ => {
            let median: f64 = inner.field("median")?;
            inside("median", median)?;
            let deviation: f64 = inner.field("deviation")?;
            RadiusDistribution::Lognormal { median, deviation, min, max }
        }
    })
}

/// A grading curve: openings are diameters, as sieves are named.
fn sieves(inner: &Reader) -> Result<RadiusDistribution, SceneError> {
    let openings: Vec<f64> = inner.field("openings")?;
    let passing: Vec<f64> = inner.field("passing")?;
    if openings.len() < 2 || !openings.is_sorted_by(|a, b| a < b) {
        let requirement = "two or more, each larger than the one before";
        return Err(inner.out_of_range("openings", requirement, format!("{openings:?} m")));
    }
    if passing.len() != openings.len() {
        let requirement = format!("as many as the openings ({})", openings.len());
        return Err(inner.out_of_range("passing", &requirement, passing.len()));
    }
    if passing[0] != 0.0 || passing[passing.len() - 1] != 1.0 || !passing.is_sorted() {
        let requirement = "shares that begin with 0, never fall, and end with 1: the smallest and the largest size are needed";
        return Err(inner.out_of_range("passing", requirement, format!("{passing:?}")));
    }
    Ok(RadiusDistribution::Sieves { openings, passing })
}
