//! Results of one device over years.

use pyo3::prelude::*;
use pyo3::types::PyAny;
use pythonize::pythonize;
use rsicalib::history::Past;

/// What a parameter has done over results of (day, value, sd), by date: as in `history.json`; None
/// where that cannot be told. `told` are the results from which on something has changed, as one of
/// them says; `tests` is how many parameters are looked at.
#[pyfunction]
pub fn course<'py>(
    py: Python<'py>,
    past: Vec<(f64, f64, f64)>,
    told: Vec<usize>,
    tests: usize,
) -> PyResult<Option<Bound<'py, PyAny>>> {
    let past: Vec<Past> =
        past.into_iter().map(|(day, value, sd)| Past { day, value, sd }).collect();
    let found = rsicalib::history::course(&past, &told, tests);
    Ok(found.map(|found| pythonize(py, &found)).transpose()?)
}
