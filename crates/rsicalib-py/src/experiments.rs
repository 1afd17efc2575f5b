//! The paper's problem with the least overhead, its derivatives and observability.

use std::borrow::Cow;

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyAny;
use pythonize::pythonize;
use rsicalib::Error;
use rsicalib::design::bound as bounds;
use rsicalib::design::observability::{Measures, Scaling};
use rsicalib::design::reach;
use rsicalib::design::within_limits::within_limits as configurations;
use rsicalib::estimate::directions::Direction;
use rsicalib::estimate::paper::Paper;
use rsicalib::mechanism::Mechanism;
use rsicalib::numerics::lm;
use rsicalib::report::words;
use serde::Serialize;

use crate::error::PyError;
use crate::mechanism::PyMechanism;
use crate::threads::{done, done_as_value};

/// Offsets, gains, `½ fᵀf`, linearisations, termination.
type Minimum<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, f64, usize, String);

/// The mechanism with only the closures named.
fn only(mechanism: &Mechanism, closures: Option<Vec<String>>) -> Result<Cow<'_, Mechanism>, Error> {
    Ok(match closures {
        Some(names) => Cow::Owned(mechanism.with_closures(&names)?),
        None => Cow::Borrowed(mechanism),
    })
}

/// Readings under the paper's model, with only the closures named.
fn paper(
    mechanism: &PyMechanism,
    counts: &[f64],
    closures: Option<Vec<String>>,
) -> Result<Paper, Error> {
    match closures {
        None => Paper::of(mechanism.layout()?, counts),
        some => Paper::new(only(&mechanism.0, some)?.as_ref(), counts),
    }
}

pub(crate) fn flat(array: &PyReadonlyArray2<'_, f64>) -> Vec<f64> {
    array.as_array().iter().copied().collect()
}

pub(crate) fn vector(array: &PyReadonlyArray1<'_, f64>) -> Vec<f64> {
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
    let mut options = lm::SolverOptions::default();
    options.xtol = xtol.unwrap_or(options.xtol);
    options.max_iterations = max_iterations.unwrap_or(options.max_iterations);
    let found =
        done(py, || paper(mechanism, &counts, closures)?.minimize(&offsets, &gains, &options))?;
    Ok((
        PyArray1::from_vec(py, found.offsets),
        PyArray1::from_vec(py, found.gains),
        found.cost,
        found.iterations,
        words::termination(found.termination).into(),
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
    let paper = paper(mechanism, &flat(&counts), closures).map_err(PyError::from)?;
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
    let paper = paper(mechanism, &flat(&counts), closures).map_err(PyError::from)?;
    let (offsets, gains) = (vector(&offsets), vector(&gains));
    let j = paper.jacobian(&offsets, &gains).map_err(PyError::from)?;
    PyArray1::from_vec(py, j).reshape([paper.equations(), 2 * offsets.len()])
}

#[derive(Serialize)]
struct ObservabilityView<'a> {
    singular_values: &'a [f64],
    measures: Measures,
    unobservable: Vec<String>,
    weak: Vec<String>,
}

/// What poses can tell of offsets and gains, under a named scaling of the columns.
#[pyfunction]
#[pyo3(signature = (mechanism, counts, offsets, gains, scaling, *, closures=None))]
pub fn observability<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    counts: PyReadonlyArray2<'py, f64>,
    offsets: PyReadonlyArray1<'py, f64>,
    gains: PyReadonlyArray1<'py, f64>,
    scaling: &str,
    closures: Option<Vec<String>>,
) -> PyResult<Bound<'py, PyAny>> {
    let scaling = Scaling::find(scaling).map_err(PyError::from)?;
    let mechanism = only(&mechanism.0, closures).map_err(PyError::from)?;
    let (counts, offsets, gains) = (flat(&counts), vector(&offsets), vector(&gains));
    let found = done(py, || {
        rsicalib::design::observability::observability(
            &mechanism, &counts, &offsets, &gains, scaling,
        )
    })?;
    let words = |all: &[Direction]| all.iter().map(words::direction).collect();
    let view = ObservabilityView {
        singular_values: &found.singular_values,
        measures: found.measures,
        unobservable: words(&found.unobservable),
        weak: words(&found.weak),
    };
    Ok(pythonize(py, &view)?)
}

/// Readings of shape (n, channels) that hold the platform at poses of shape (n, 6).
///
/// NaN in the rows out of reach, beyond a joint limit, or within `margin` of a range's end.
#[pyfunction]
pub fn readings_at<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    poses: PyReadonlyArray2<'py, f64>,
    offsets: PyReadonlyArray1<'py, f64>,
    gains: PyReadonlyArray1<'py, f64>,
    margin: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (poses, offsets, gains) = (six(&poses)?, vector(&offsets), vector(&gains));
    let channels = mechanism.0.channels.len();
    let found: Vec<Option<Vec<f64>>> = done(py, || {
        let at = |pose| reach::readings_at(&mechanism.0, pose, &offsets, &gains, margin);
        poses.iter().map(at).collect::<Result<_, _>>()
    })?;
    let nothing = vec![f64::NAN; channels];
    let rows = found.iter().flat_map(|row| row.as_ref().unwrap_or(&nothing)).copied().collect();
    PyArray1::from_vec(py, rows).reshape([poses.len(), channels])
}

/// Joint coordinates that hold the platform at poses of shape (n, 6): (n, channels) [rad, or length].
#[pyfunction]
pub fn angles_at<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    poses: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let poses = six(&poses)?;
    let channels = mechanism.0.channels.len();
    let alone = poses.len() == 1;
    let at = |(number, pose)| {
        reach::angles_at(&mechanism.0, pose)
            .map_err(|error: Error| if alone { error } else { error.at_pose(number) })
    };
    let found: Vec<Vec<f64>> =
        done(py, || poses.iter().enumerate().map(at).collect::<Result<_, _>>())?;
    PyArray1::from_vec(py, found.concat()).reshape([poses.len(), channels])
}

/// Readings of random configurations within the limits of the joints, of shape (n, channels):
/// closures between points that chains carry hold, others do not.
#[pyfunction]
#[pyo3(signature = (mechanism, count, *, seed=0))]
pub fn within_limits<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    count: usize,
    seed: i64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let channels = mechanism.0.channels.len();
    let found = done(py, || configurations(&mechanism.0, count, seed.cast_unsigned()))?;
    let rows = found.len() / channels.max(1);
    PyArray1::from_vec(py, found).reshape([rows, channels])
}

/// The Cramér-Rao bound for readings of shape (n, channels) with noise `sigma` per channel.
#[pyfunction]
#[pyo3(signature = (mechanism, counts, offsets, gains, sigma, *, closures=None))]
pub fn bound<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    counts: PyReadonlyArray2<'py, f64>,
    offsets: PyReadonlyArray1<'py, f64>,
    gains: PyReadonlyArray1<'py, f64>,
    sigma: PyReadonlyArray1<'py, f64>,
    closures: Option<Vec<String>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mechanism = only(&mechanism.0, closures).map_err(PyError::from)?;
    let (offsets, gains, sigma) = (vector(&offsets), vector(&gains), vector(&sigma));
    let counts = flat(&counts);
    done_as_value(py, || bounds::bound(&mechanism, &counts, &offsets, &gains, &sigma))
}

/// Means of samples of exact readings of shape (n, channels), with noise `sigma` [readings], rounded to
/// counts and clipped to their ranges one by one.
#[pyfunction]
pub fn means_of_samples<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    exact: PyReadonlyArray2<'py, f64>,
    sigma: f64,
    samples: usize,
    seed: u64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (shape, exact) = (exact.as_array().dim(), flat(&exact));
    let means = done(py, || {
        rsicalib::readings::sampled::means_of_samples(&mechanism.0, &exact, sigma, samples, seed)
    })?;
    PyArray1::from_vec(py, means).reshape([shape.0, shape.1])
}

/// Joint angles of the hand controller for poses of shape (n, 6): (n, 9), NaN out of reach [rad].
#[pyfunction]
pub fn rsi_angles<'py>(
    py: Python<'py>,
    poses: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let poses = six(&poses)?;
    let angles = poses
        .iter()
        .map(|p| rsicalib::mechanism::hand_controller::inverse(p).unwrap_or([[f64::NAN; 3]; 3]));
    let rows: Vec<f64> = angles.flat_map(|a| a.into_iter().flatten()).collect();
    PyArray1::from_vec(py, rows).reshape([poses.len(), 9])
}

/// Handle poses of the hand controller for angles of shape (n, 9), eqs. (2)-(5): (n, 6).
#[pyfunction]
pub fn rsi_poses<'py>(
    py: Python<'py>,
    angles: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let view = angles.as_array();
    Error::same("angles", view.ncols(), 9).map_err(PyError::from)?;
    let pose = |row: numpy::ndarray::ArrayView1<'_, f64>| {
        rsicalib::mechanism::hand_controller::forward(&std::array::from_fn(|i| {
            std::array::from_fn(|j| row[3 * i + j])
        }))
    };
    let poses: Vec<f64> = view.rows().into_iter().flat_map(pose).collect();
    PyArray1::from_vec(py, poses).reshape([view.nrows(), 6])
}

pub(crate) fn six(poses: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 6]>> {
    let view = poses.as_array();
    Error::same("a pose", view.ncols(), 6).map_err(PyError::from)?;
    Ok(view.rows().into_iter().map(|r| std::array::from_fn(|i| r[i])).collect())
}
