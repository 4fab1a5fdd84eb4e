//! Streams and outlets as a scene asks for them.

use super::error::SceneError;
use super::measure::PlaneSpec;
use super::model::{GrainSpec, SIZES};
use super::names;
use super::reader::Reader;
use super::region::RegionSpec;
use super::table::{Spec, table};
use graintrain::load::Region;

table! {
    /// A stream of bodies.
    pub struct StreamSpec: "`[stream.NAME]`",
        at most one of ["radius", "shape", "parts"],
        at most one of ["rate", "mass_rate"],
        checked by is_stream {
        /// Bodies enter completely inside, at random positions without overlap; if there is none, the
        /// insertion is delayed
        region: Region = Table(RegionSpec::TABLE), "required",
            "{ cylinder = { base = [0, 0, 1], radius = 0.1, height = 0.1 } }";
        /// The bodies.
        #[serde(flatten)]
        grains: GrainSpec => Spec::read;
        keys of GrainSpec::TABLE;
        /// Bodies per second; delayed bodies enter later
        rate: Option<f64> = Quantity(D::RATE), "as many as fit", "\"200/s\"", Positive;
        /// Mass per second, instead of `rate`
        mass_rate: Option<f64> = Quantity(D::MASS_RATE), "as many as fit", "\"0.5 kg/s\"", Positive;
        /// Maximum number of bodies
        count: Option<u64> = Count, "no limit", "500";
        /// Maximum total mass
        mass: Option<f64> = Quantity(D::MASS), "no limit", "\"2 kg\"", Positive;
        /// When it begins; with `stage` relative to the beginning of that stage
        start: f64 = Quantity(D::TIME), "0", "\"0.1 s\"", NotNegative;
        /// When it ends, likewise
        end: Option<f64> = Quantity(D::TIME), "no limit", "\"2 s\"", Positive;
        /// Active only in the stage of this name
        stage: Option<String> = Text, "all stages", "\"fill\"" => names::stage;
        /// Seed of this stream
        seed: u64 = Count, "seed of the scene + number of the stream + 1000", "7" => seed;
        location
    }
}

table! {
    /// A way out.
    pub enum OutletSpec: "`[outlet.NAME]`" {
        /// Bodies of packings and streams leave when their centre of mass is on the side of the plane to
        /// which its normal points
        Behind(PlaneSpec): behind = Table(&BEHIND), "{ point = [0, 0, -0.1], normal = [0, 0, -1] }";
        /// They leave when it is outside the region
        Outside(Region): outside = Table(RegionSpec::TABLE), "{ box = { min = [-1, -1, -1], max = [1, 1, 1] } }";
        /// They leave when it is inside the region
        Inside(Region): inside = Table(RegionSpec::TABLE), "{ box = { min = [-1, -1, -1], max = [1, 1, 0] } }";
    }
}

table! {
    static BEHIND: "`outlet.NAME.behind`" {
        /// A point of the plane
        point = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"-10 cm\"]";
        /// Its normal, of any length
        normal = Direction, "[0, 0, -1]", "[1, 0, 0]";
    }
}

/// Most bodies of a stream; more would not fit into memory.
const MOST_BODIES: u64 = 100_000_000;

/// Seeds of streams begin so far behind that of the scene: packings have the first ones.
const SEEDS: u64 = 1000;

fn seed(reader: &Reader, key: &str) -> Result<u64, SceneError> {
    names::seed(reader, key, &reader.context.names.streams, SEEDS)
}

fn is_stream(spec: &StreamSpec, reader: &Reader) -> Result<(), SceneError> {
    reader.any_of(SIZES)?;
    let endless = spec.count.is_none() && spec.mass.is_none() && spec.end.is_none();
    if endless && spec.rate.is_none() && spec.mass_rate.is_none() {
        return Err(reader.refuse(format!(
            "nothing ends `{}`, which has no rate either: give it `rate` or `mass_rate`, or `count`, `mass` or `end`",
            reader.path
        )));
    }
    if let Some(count) = spec.count.filter(|count| *count > MOST_BODIES) {
        return Err(reader.out_of_range("count", &format!("at most {MOST_BODIES}"), count));
    }
    if let Some(end) = spec.end.filter(|end| *end <= spec.start) {
        return Err(reader.out_of_range(
            "end",
            &format!("after start ({} s)", spec.start),
            format!("{end} s"),
        ));
    }
    Ok(())
}
