//! The numbers of a CSV text that is nothing but numbers.

use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;

use crate::threads::work;

/// Columns of a text that is a plain table of numbers from byte `first` on; None on any doubt.
#[pyfunction]
pub fn plain_numbers<'py>(
    py: Python<'py>,
    data: &[u8],
    first: usize,
    columns: usize,
) -> PyResult<Option<Vec<Bound<'py, PyArray1<f64>>>>> {
    let Some(body) = data.get(first..) else { return Ok(None) };
    let found = work(py, || rsicalib::readings::plain::plain_numbers(body, columns))?;
    Ok(found.map(|all| all.into_iter().map(|column| column.into_pyarray(py)).collect()))
}
