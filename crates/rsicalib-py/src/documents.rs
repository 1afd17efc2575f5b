//! Results as documents: read back, and their schema.

use pyo3::prelude::*;
use pyo3::types::PyAny;
use pythonize::pythonize;
use rsicalib::apply::budget::Quantity;
use rsicalib::report::certificate::{self, Limit};
use rsicalib::report::read::{self, Document, Refused};
use rsicalib::report::schema;

use crate::mechanism::PyMechanism;
use crate::tables::PyTable;
use crate::threads::done_as_value;

mod python {
    pyo3::import_exception!(rsicalib.errors, ResultError);
}

/// A result from its JSON text, as plain values: checked against the types that made it.
#[pyfunction]
pub fn read_result<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    Ok(match read::read(text).map_err(refused)? {
        Document::Calibration(result) => pythonize(py, &*result)?,
        Document::Trace(result) => pythonize(py, &*result)?,
    })
}

fn refused(e: Refused) -> PyErr {
    python::ResultError::new_err((e.place, e.found, e.expected))
}

/// Whether the largest error of a result, given as its JSON text, is within a limit at the rows of a table:
/// an object with the keys of the core's `Certificate`.
#[pyfunction]
pub fn certify<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    result: &str,
    table: PyTable<'_>,
    orientation: bool,
    limit: f64,
    confidence: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let result = read::written(result).map_err(refused)?;
    let quantity = if orientation { Quantity::Orientation } else { Quantity::Position };
    let (table, asked) = (table.table(), Limit { quantity, limit, confidence });
    done_as_value(py, || certificate::certify(&mechanism.0, &result, table, asked))
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
