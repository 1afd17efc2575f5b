//! Results as documents: read back, and their schema.

use pyo3::prelude::*;
use pyo3::types::PyAny;
use pythonize::pythonize;
use rsicalib::report::read::{self, Document};
use rsicalib::report::schema;

mod python {
    pyo3::import_exception!(rsicalib.errors, ResultError);
}

/// A result from its JSON text, as plain values: checked against the types that made it.
#[pyfunction]
pub fn read_result<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    let read = read::read(text)
        .map_err(|e| python::ResultError::new_err((e.place, e.found, e.expected)))?;
    Ok(match read {
        Document::Calibration(result) => pythonize(py, &*result)?,
        Document::Trace(result) => pythonize(py, &*result)?,
    })
}

/// JSON Schema of each format of results, as text: what can be read.
#[pyfunction]
pub fn schemas() -> Vec<(&'static str, String)> {
    let text = |schema: schema::Schema| schema.to_value().to_string();
    schema::schemas().into_iter().map(|(format, schema)| (format, text(schema))).collect()
}

/// JSON Schema of a mechanism file, as text.
#[pyfunction]
pub fn mechanism_schema() -> String {
    rsicalib::mechanism::schema().to_value().to_string()
}

/// JSON Schema of the evidence that a report is drawn from, as text.
#[pyfunction]
pub fn evidence_schema() -> String {
    schema::evidence().to_value().to_string()
}

/// Keys of each type of a result that are always written.
#[pyfunction]
pub fn written_keys() -> Vec<(String, Vec<String>)> {
    schema::written_keys()
}
