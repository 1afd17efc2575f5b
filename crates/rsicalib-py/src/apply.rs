//! Results applied to readings: platform poses, and the open loop.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyAny;
use pythonize::pythonize;
use rsicalib::apply::earlier::{self, Applied, Reference, Reported, platform_poses};

use crate::error::PyError;
use crate::mechanism::PyMechanism;
use crate::observations::{PyTable, poses_of};

/// A result on its way to readings that it has not seen.
///
/// Each of `parameters` is (term@target, name, value); `centre`, `span` and
/// `temperature` are those of the readings that they were found with.
#[derive(FromPyObject)]
pub struct PyApplied {
    #[pyo3(item)]
    parameters: Vec<(String, String, f64)>,
    #[pyo3(item)]
    centre: Vec<f64>,
    #[pyo3(item)]
    span: Vec<[f64; 2]>,
    #[pyo3(item)]
    temperature: Option<f64>,
    #[pyo3(item)]
    sigma: Vec<f64>,
}

impl From<PyApplied> for Applied {
    fn from(given: PyApplied) -> Self {
        let PyApplied { parameters, centre, span, temperature, sigma } = given;
        let reported = |(term, name, value)| Reported { term, name, value };
        Self {
            parameters: parameters.into_iter().map(reported).collect(),
            reference: Reference { centre, span, temperature },
            sigma,
        }
    }
}

/// Platform pose of every row of a table under a result: shape (n, 6).
#[pyfunction]
pub fn forward<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    applied: PyApplied,
    table: PyTable<'_>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (applied, table) = (applied.into(), table.table());
    let poses =
        py.detach(|| platform_poses(&mechanism.0, &applied, table)).map_err(PyError::from)?;
    let flat: Vec<f64> = poses.iter().flatten().copied().collect();
    PyArray1::from_vec(py, flat).reshape([poses.len(), 6])
}

/// Where the chains carry their points under a result: shape (points, n, 3).
#[pyfunction]
pub fn points(
    py: Python<'_>,
    mechanism: &PyMechanism,
    applied: PyApplied,
    table: PyTable<'_>,
) -> PyResult<Vec<Vec<[f64; 3]>>> {
    let (applied, table) = (applied.into(), table.table());
    Ok(py.detach(|| earlier::points(&mechanism.0, &applied, table)).map_err(PyError::from)?)
}

/// Error of a result on known poses, root mean square over components.
#[pyfunction]
#[pyo3(signature = (mechanism, applied, table, poses, align=false))]
pub fn check<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    applied: PyApplied,
    table: PyTable<'_>,
    poses: PyReadonlyArray2<'_, f64>,
    align: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let found =
        earlier::check(&mechanism.0, &applied.into(), &table.table(), &poses_of(&poses), align);
    Ok(pythonize(py, &found.map_err(PyError::from)?)?)
}

/// Offset and gain of every channel from known poses, eq. (13): `(lines, poses)`.
#[pyfunction]
pub fn fixture<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    table: PyTable<'_>,
    poses: PyReadonlyArray2<'_, f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let found = rsicalib::apply::fixture::fixture(&mechanism.0, &table.table(), &poses_of(&poses));
    Ok(pythonize(py, &found.map_err(PyError::from)?)?)
}
