//! Settings and choices of the crate from keywords, under the names of its fields and variants.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Number, Value};

/// The first letter large: variants are found by their names in small letters too.
fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// A variant by its name.
pub fn choice<T: DeserializeOwned>(what: &str, name: &str) -> PyResult<T> {
    serde_json::from_value(Value::String(capitalised(name)))
        .map_err(|error| PyValueError::new_err(format!("{what}: {error}")))
}

fn value(what: &str, given: &Bound<'_, PyAny>) -> PyResult<Value> {
    if let Ok(text) = given.cast::<PyString>() {
        return Ok(Value::String(capitalised(&text.to_cow()?)));
    }
    if let Ok(whole) = given.extract::<u64>() {
        return Ok(Value::Number(whole.into()));
    }
    if let Ok(whole) = given.extract::<i64>() {
        return Ok(Value::Number(whole.into()));
    }
    let number: f64 =
        given.extract().map_err(|_| PyTypeError::new_err(format!("{what}: expected a number or a name")))?;
    let finite = Number::from_f64(number);
    finite
        .map(Value::Number)
        .ok_or_else(|| PyValueError::new_err(format!("{what} is {number}, expected a finite number")))
}

/// The default settings with the tolerance and the keywords given; None leaves a default.
pub fn settings<T: Default + Serialize + DeserializeOwned>(
    tolerance: f64,
    given: Option<&Bound<'_, PyDict>>,
) -> PyResult<T> {
    let fault = |what: &str, error: serde_json::Error| PyValueError::new_err(format!("{what}: {error}"));
    let mut fields: Map<String, Value> = serde_json::to_value(T::default())
        .and_then(serde_json::from_value)
        .map_err(|error| fault("settings", error))?;
    let tolerance = Number::from_f64(tolerance).ok_or_else(|| {
        PyValueError::new_err(format!("tolerance is {tolerance}, expected a finite number"))
    })?;
    fields.insert("tolerance".to_string(), Value::Number(tolerance));
    for (key, given) in given.into_iter().flatten() {
        let key: String = key.extract()?;
        if !fields.contains_key(&key) || key == "tolerance" {
            let known =
                fields.keys().filter(|key| *key != "tolerance").cloned().collect::<Vec<_>>().join(", ");
            return Err(PyTypeError::new_err(format!(
                "unexpected keyword argument '{key}'; settings are {known}"
            )));
        }
        if !given.is_none() {
            fields.insert(key.clone(), value(&key, &given)?);
            // (At once, so that the message names the keyword.)
            serde_json::from_value::<T>(Value::Object(fields.clone())).map_err(|error| fault(&key, error))?;
        }
    }
    serde_json::from_value(Value::Object(fields)).map_err(|error| fault("settings", error))
}
