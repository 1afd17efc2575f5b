//! Plain values of Python as what they describe.

use pyo3::prelude::*;
use pyo3::types::{PyBool, PyFloat, PyInt, PyList, PyMapping, PyString, PyTuple};
use rsicalib::Error;
use serde::de::DeserializeOwned;
use toml::Value;

use crate::error::PyError;

/// Dictionaries in dictionaries that a mechanism has, with room to spare.
const DEEPEST: usize = 32;

/// Plain values as what they describe; a wrong one is refused with its path. `None` in a dictionary is what is not
/// given, an array is a list.
pub fn from_values<T: DeserializeOwned>(values: &Bound<'_, PyAny>) -> Result<T, PyError> {
    Ok(rsicalib::mechanism::from_values(plain(values, "", 0)?)?)
}

fn plain(value: &Bound<'_, PyAny>, place: &str, depth: usize) -> Result<Value, Error> {
    let refused = |found: String| Error::Entry {
        place: if place.is_empty() { "top level".into() } else { place.into() },
        why: format!("found {found}, expected plain values: text, numbers, lists and dictionaries"),
    };
    let kind = || value.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
    let unreadable = |_: PyErr| refused(format!("a value of type {}", kind()));
    if depth > DEEPEST {
        return Err(refused(format!("more than {DEEPEST} values in each other")));
    }
    let item =
        |key: &str, value: &Bound<'_, PyAny>| plain(value, &format!("{place}{key}"), depth + 1);
    if value.is_instance_of::<PyBool>() {
        value.extract().map(Value::Boolean).map_err(unreadable)
    } else if value.is_instance_of::<PyInt>() {
        value.extract().map(Value::Integer).map_err(unreadable)
    } else if value.is_instance_of::<PyFloat>() {
        value.extract().map(Value::Float).map_err(unreadable)
    } else if value.is_instance_of::<PyString>() {
        value.extract().map(Value::String).map_err(unreadable)
    } else if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let items = value.try_iter().map_err(unreadable)?.enumerate();
        let items = items.map(|(k, one)| item(&format!("[{k}]"), &one.map_err(unreadable)?));
        items.collect::<Result<_, _>>().map(Value::Array)
    } else if let Ok(entries) = value.cast::<PyMapping>() {
        let mut table = toml::Table::new();
        for entry in entries.items().map_err(unreadable)?.iter() {
            let (key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) =
                entry.extract().map_err(unreadable)?;
            let key: String = key.extract().map_err(|_| refused(format!("the key {key}")))?;
            if !value.is_none() {
                let dot = if place.is_empty() { "" } else { "." };
                table.insert(key.clone(), item(&format!("{dot}{key}"), &value)?);
            }
        }
        Ok(Value::Table(table))
    } else {
        // An array, or a number of one.
        let plainer = value.call_method0("tolist").map_err(unreadable)?;
        plain(&plainer, place, depth + 1)
    }
}
