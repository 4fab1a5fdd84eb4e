//! Functions of time.

use super::super::expression::formula_text;
use super::super::quantity::Dimension;
use super::super::table::table;
use graintrain::motion::Profile;
use serde::{Serialize, Serializer};
use std::path::PathBuf;

/// A function of time.
#[derive(Clone, Debug, PartialEq)]
pub enum FunctionSpec {
    /// As it is.
    Profile(Profile),
    /// From a file.
    File {
        /// The file.
        file: FunctionFile,
        /// Dimension of its values.
        dimension: Dimension,
    },
}

table! {
    /// A file with times and values.
    pub struct FunctionFile: "`file` of a function of time" {
        /// CSV (or columns separated by blanks) with a header line that names the columns, with units in
        /// brackets
        path: PathBuf = Text, "required", "\"record.csv\"";
        /// Column of the ascending times
        time: String = Text, "\"time\"", "\"t\"";
        /// Column of the values
        value: String = Text, "\"value\"", "\"force_z\"";
        location of path
    }
}

impl FunctionSpec {
    /// The same at all times.
    pub fn constant(value: f64) -> Self {
        Self::Profile(Profile::Constant(value))
    }
}

impl Serialize for FunctionSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        #[serde(rename_all = "snake_case")]
        enum Form<'a> {
            Sinusoidal { amplitude: f64, period: f64, phase: f64 },
            Table { times: &'a [f64], values: &'a [f64] },
            File(&'a FunctionFile),
        }
        match self {
            Self::File { file, .. } => Form::File(file).serialize(serializer),
            Self::Profile(Profile::Constant(value)) => serializer.serialize_f64(*value),
            Self::Profile(Profile::Formula(formula)) => serializer.serialize_str(&formula_text(formula)),
            Self::Profile(Profile::Sinusoidal { amplitude, period, phase }) => {
                Form::Sinusoidal { amplitude: *amplitude, period: *period, phase: *phase }
                    .serialize(serializer)
            }
            Self::Profile(Profile::Table { times, values }) => {
                Form::Table { times, values }.serialize(serializer)
            }
            // The scene delays whole motions, not functions: see `MotionSpec::start`.
            Self::Profile(Profile::Delayed { profile, .. }) => {
                Self::Profile((**profile).clone()).serialize(serializer)
            }
        }
    }
}
