//! Keys of functions of time.

use super::super::model::FunctionFile;
use super::super::table::{Spec, table};

/// The tables of a function of time whose values have one dimension.
macro_rules! function_of_time {
    ($name:ident, $of:literal, $dimension:expr, $value:literal) => {
        table! {
            pub(in super::super) static $name: (concat!("Function of time: ", $of)),
                at most one of ["sinusoidal", "table", "file"] {
                /// amplitude sin(2 pi t / period + phase)
                sinusoidal = Table({
                    table! {
                        static SINUSOID: (concat!("`sinusoidal` ", $of)) {
                            /// Largest value
                            amplitude = Quantity($dimension), "required", $value;
                            /// Period
                            period = Quantity(D::TIME), "required", "\"4 s\"", Positive;
                            /// Phase
                            phase = Quantity(D::ANGLE), "0", "\"90 deg\"";
                        }
                    }
                    &SINUSOID
                }), "one of", (concat!("{ amplitude = ", $value, ", period = \"4 s\" }"));
                /// Linear between samples, constant outside
                table = Table({
                    table! {
                        static SAMPLES: (concat!("`table` ", $of)) {
                            /// Ascending times
                            times = List(D::TIME), "required", "[0, \"0.5 s\", \"1 s\"]";
                            /// Value at each time
                            values = List($dimension), "required", (concat!("[0, ", $value, ", 0]"));
                        }
                    }
                    &SAMPLES
                }), "one of", (concat!("{ times = [0, 1], values = [0, ", $value, "] }"));
                /// A table from a file
                file = Table(FunctionFile::TABLE), "one of", "{ path = \"record.csv\", value = \"value\" }";
            }
        }
    };
}

function_of_time!(SPEED, "speed", D::SPEED, "\"1 m/s\"");
function_of_time!(ANGULAR_SPEED, "angular speed", D::ANGULAR_SPEED, "\"5 rpm\"");
function_of_time!(FORCE, "force", D::FORCE, "\"2 kN\"");
function_of_time!(TORQUE, "torque", D::ENERGY, "\"3 N m\"");
function_of_time!(ACCELERATION, "acceleration", D::ACCELERATION, "\"2 m/s^2\"");
function_of_time!(PRESSURE, "pressure", D::PRESSURE, "\"10 kPa\"");
function_of_time!(RATE, "rate", D::RATE, "\"0.1/s\"");
function_of_time!(LENGTH, "length", D::LENGTH, "\"20 cm\"");
function_of_time!(ANGLE, "angle", D::ANGLE, "\"15 deg\"");
