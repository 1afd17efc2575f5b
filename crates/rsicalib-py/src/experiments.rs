//! The paper's problem with the least overhead, and its derivatives.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rsicalib::algebraic::Paper;
use rsicalib::{Mechanism, lm};

use crate::error::PyError;
use crate::mechanism::PyMechanism;

/// Offsets, gains, `½ fᵀf`, linearisations, termination.
type Minimum<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, f64, usize, String);

/// Readings under the paper's model, with only the closures named.
fn paper(
    mechanism: &Mechanism,
    counts: &[f64],
    closures: Option<Vec<String>>,
) -> Result<Paper, rsicalib::Error> {
    match closures {
        Some(names) => Paper::new(&mechanism.with_closures(&names)?, counts),
        None => Paper::new(mechanism, counts),
    }
}

fn flat(array: &PyReadonlyArray2<'_, f64>) -> Vec<f64> {
    array.as_array().iter().copied().collect()
}

fn vector(array: &PyReadonlyArray1<'_, f64>) -> Vec<f64> {
    array.as_array().to_vec()
}

/// Minimises `½ fᵀf` over offsets and gains from a start, eq. (11).
///
/// The paper's own problem in its own parameters: offsets at reading zero [rad], gains
/// [rad/reading]; counts of shape (n, channels). Returns offsets, gains, cost, iterations and
/// termination.
#[pyfunction]
#[pyo3(signature = (mechanism, counts, offsets0, gains0, *, closures=None, xtol=None,
                    max_iterations=None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn minimize<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    counts: PyReadonlyArray2<'py, f64>,
    offsets0: PyReadonlyArray1<'py, f64>,
    gains0: PyReadonlyArray1<'py, f64>,
    closures: Option<Vec<String>>,
    xtol: Option<f64>,
    max_iterations: Option<usize>,
) -> PyResult<Minimum<'py>> {
    let (counts, offsets, gains) = (flat(&counts), vector(&offsets0), vector(&gains0));
    let mut options = lm::Options::default();
    options.xtol = xtol.unwrap_or(options.xtol);
    options.max_iterations = max_iterations.unwrap_or(options.max_iterations);
    let found = py
        .detach(|| paper(&mechanism.0, &counts, closures)?.minimize(&offsets, &gains, &options))
        .map_err(PyError::from)?;
    Ok((
        PyArray1::from_vec(py, found.offsets),
        PyArray1::from_vec(py, found.gains),
        found.cost,
        found.iterations,
        found.termination.message().into(),
    ))
}

/// Misclosure `f` of readings of shape (n, channels), eq. (10): shape (n, equations).
#[pyfunction]
#[pyo3(signature = (mechanism, counts, offsets, gains, *, closures=None))]
pub fn misclosure<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    counts: PyReadonlyArray2<'py, f64>,
    offsets: PyReadonlyArray1<'py, f64>,
    gains: PyReadonlyArray1<'py, f64>,
    closures: Option<Vec<String>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let samples = counts.as_array().nrows();
    let paper = paper(&mechanism.0, &flat(&counts), closures).map_err(PyError::from)?;
    let f = paper.misclosure(&vector(&offsets), &vector(&gains)).map_err(PyError::from)?;
    PyArray1::from_vec(py, f).reshape([samples, paper.equations() / samples])
}

/// Derivatives of the misclosure by offsets and gains, eq. (12): shape (n equations, 2 channels).
#[pyfunction]
#[pyo3(signature = (mechanism, counts, offsets, gains, *, closures=None))]
pub fn jacobian<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    counts: PyReadonlyArray2<'py, f64>,
    offsets: PyReadonlyArray1<'py, f64>,
    gains: PyReadonlyArray1<'py, f64>,
    closures: Option<Vec<String>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let paper = paper(&mechanism.0, &flat(&counts), closures).map_err(PyError::from)?;
    let (offsets, gains) = (vector(&offsets), vector(&gains));
    let j = paper.jacobian(&offsets, &gains).map_err(PyError::from)?;
    PyArray1::from_vec(py, j).reshape([paper.equations(), 2 * offsets.len()])
}
