//! A model made linear about the mechanism as it is drawn, before there are readings.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rsicalib::design::linear;

use crate::error::PyError;
use crate::mechanism::PyMechanism;
use crate::observations::PyTable;

/// Misclosure of a table, and its derivatives by readings and parameters.
///
/// `f` of shape (n, equations), `a` of (n equations, channels), `x` of (n equations,
/// parameters); `links` and `apart`, the same of known distances between unknown points;
/// `parameters`, term and target of each column. Unknown points are where `unknown`, of
/// shape (points, 3), has them, else where the chains touch them.
#[pyfunction]
#[pyo3(signature = (mechanism, table, terms, unknown=None))]
pub fn linearize<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    table: PyTable<'_>,
    terms: Vec<String>,
    unknown: Option<PyReadonlyArray2<'py, f64>>,
) -> PyResult<Bound<'py, PyDict>> {
    let unknown = unknown.map(|u| u.as_array().iter().copied().collect::<Vec<f64>>());
    let table = table.table();
    let found = py
        .detach(|| linear::linearize(&mechanism.0, table, &terms, unknown.as_deref()))
        .map_err(PyError::from)?;
    let matrix = |values: Vec<f64>, columns: usize| -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = values.len() / columns.max(1);
        PyArray1::from_vec(py, values).reshape([rows, columns])
    };
    let out = PyDict::new(py);
    let parameters = found.parameters.len();
    out.set_item("f", matrix(found.f, found.equations)?)?;
    out.set_item("a", matrix(found.a, mechanism.0.channels.len())?)?;
    out.set_item("x", matrix(found.x, parameters)?)?;
    out.set_item("links", found.links)?;
    out.set_item("apart", matrix(found.apart, parameters)?)?;
    out.set_item("parameters", found.parameters)?;
    out.set_item("unknown", matrix(found.unknown, 3)?)?;
    Ok(out)
}
