//! What a design can tell before a reading is taken: identifiable parameters, plans, bounds.

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use pythonize::{depythonize, pythonize};
use rsicalib::Error;
use rsicalib::design::criterion::Criterion;
use rsicalib::design::further as planning_further;
use rsicalib::design::further::{Explained, FurtherOptions};
use rsicalib::design::guided::{self, Progress};
use rsicalib::design::identifiability::{self, Counting, Identifiable};
use rsicalib::design::plan as planning;
use rsicalib::design::plan::{PlanOptions, Within};
use rsicalib::design::until::until;

use crate::error::PyError;
use crate::experiments::{flat, six, vector};
use crate::mechanism::PyMechanism;
use crate::observations::PyObservations;
use crate::threads::{done, done_as_value};

/// Counts what readings of a mechanism can and cannot tell.
///
/// `terms` as users write them; the declared model where not given.
#[pyfunction]
#[pyo3(signature = (mechanism, terms=None, *, seed=0))]
pub fn identifiable<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    terms: Option<Vec<String>>,
    seed: i64,
) -> PyResult<Bound<'py, PyDict>> {
    let found: Identifiable = done(py, || {
        identifiability::identifiable(&mechanism.0, Counting::of(terms), seed.cast_unsigned())
    })?;
    let out = PyDict::new(py);
    let terms = found.terms.iter().map(|c| (c.term, c.parameters, c.alone, c.beside));
    out.set_item("model", found.model.name())?;
    out.set_item("terms", terms.collect::<Vec<_>>())?;
    out.set_item("parameters", found.parameters)?;
    out.set_item("minimal", found.minimal)?;
    out.set_item("known", found.known)?;
    out.set_item("hidden", found.hidden.iter().map(ToString::to_string).collect::<Vec<_>>())?;
    out.set_item("configurations", found.configurations)?;
    Ok(out)
}

/// Chooses poses: `poses` of shape (n, 6), `readings` of shape (n, channels), `bound`, `before`.
///
/// `beside` holds readings of poses that are visited already, of shape (m, channels).
#[pyfunction]
#[pyo3(signature = (mechanism, offsets, gains, *, poses, beside, within, noise, criterion,
                    candidates, starts, seed))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn plan<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    offsets: PyReadonlyArray1<'py, f64>,
    gains: PyReadonlyArray1<'py, f64>,
    poses: i64,
    beside: Option<PyReadonlyArray2<'py, f64>>,
    within: Option<Within>,
    noise: f64,
    criterion: &str,
    candidates: i64,
    starts: i64,
    seed: i64,
) -> PyResult<Bound<'py, PyDict>> {
    let options = PlanOptions {
        poses: count("poses", poses)?,
        beside: beside.as_ref().map(flat).unwrap_or_default(),
        within,
        criterion: Criterion::find(criterion).map_err(PyError::from)?,
        candidates: count("candidates", candidates)?,
        starts: count("starts", starts)?,
        seed: seed.cast_unsigned(),
        noise,
    };
    let (offsets, gains) = (vector(&offsets), vector(&gains));
    let found = done(py, || planning::plan(&mechanism.0, &offsets, &gains, &options))?;
    let (n, channels) = (found.poses.len(), mechanism.0.channels.len());
    let poses = PyArray1::from_iter(py, found.poses.into_iter().flatten());
    let readings = PyArray1::from_iter(py, found.readings.into_iter().flatten());
    let out = PyDict::new(py);
    out.set_item("poses", poses.reshape([n, 6])?)?;
    out.set_item("readings", readings.reshape([n, channels])?)?;
    out.set_item("bound", pythonize(py, &found.bound)?)?;
    out.set_item("before", pythonize(py, &found.before)?)?;
    Ok(out)
}

/// The Cramér-Rao bound for poses of shape (n, 6) that are to be visited.
#[pyfunction]
pub fn bound_at<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    offsets: PyReadonlyArray1<'py, f64>,
    gains: PyReadonlyArray1<'py, f64>,
    poses: PyReadonlyArray2<'py, f64>,
    noise: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let (offsets, gains, poses) = (vector(&offsets), vector(&gains), six(&poses)?);
    done_as_value(py, || planning::bound(&mechanism.0, &offsets, &gains, &poses, noise))
}

/// The box of a workspace, given or the mechanism's own: six pairs, lowest and highest.
#[pyfunction]
#[pyo3(signature = (mechanism, within=None))]
pub fn workspace(mechanism: &PyMechanism, within: Option<Within>) -> Result<Within, PyError> {
    Ok(planning::workspace(&mechanism.0, within)?)
}

/// Whether poses that touch so many unknown places are enough for a trace.
#[pyfunction]
pub fn traceable(mechanism: &PyMechanism, poses: usize, touched: usize) -> bool {
    guided::traceable(&mechanism.0, poses, touched)
}

/// Poses from which on a trace is possible; None where that depends on what is touched.
#[pyfunction]
pub fn needed_poses(mechanism: &PyMechanism) -> Option<usize> {
    guided::needed_poses(&mechanism.0)
}

/// Whether a guided session is done.
///
/// `progress` has the fields of `Progress` of the core: `poses`, `most`, `beyond`, `repeat`, `open`, `deciding`, `gain`,
/// `usable`, `p_value`, `unmended`, `checked`, `alone`.
#[pyfunction]
pub fn guided_done(progress: &Bound<'_, PyAny>) -> PyResult<bool> {
    let progress: Progress = depythonize(progress)?;
    Ok(progress.done())
}

/// An explanation: effects such as `curvature@a22`, penalised χ², probability.
type PyExplained = (Vec<String>, f64, f64);

/// Chooses poses to visit after a session, beside the readings that it has.
///
/// `left_out` are rows of the session that do not count; `off` are readings of poses that are
/// struck off, of shape (m, channels); `from_` is a reading of where the mechanism stands. With a `target` of the
/// platform's standard deviation, as few poses as reach it, and `standing`: how they stand to it.
#[pyfunction]
#[pyo3(signature = (session, rivals, *, poses, criterion=None, within=None, candidates=None,
                    left_out=None, off=None, from_=None, way=None, seed=0, target=None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn further<'py>(
    py: Python<'py>,
    session: &PyObservations,
    rivals: Vec<PyExplained>,
    poses: i64,
    criterion: Option<&str>,
    within: Option<Within>,
    candidates: Option<i64>,
    left_out: Option<Vec<usize>>,
    off: Option<PyReadonlyArray2<'py, f64>>,
    from_: Option<PyReadonlyArray1<'py, f64>>,
    way: Option<f64>,
    seed: i64,
    target: Option<f64>,
) -> PyResult<Bound<'py, PyDict>> {
    let default = FurtherOptions::default();
    let drawn = candidates.map(|value| count("candidates", value)).transpose()?;
    let options = FurtherOptions {
        poses: count("poses", poses)?,
        criterion: criterion.map(Criterion::find).transpose().map_err(PyError::from)?,
        within,
        candidates: drawn.unwrap_or(default.candidates),
        off: off.as_ref().map(flat).unwrap_or_default(),
        from: from_.as_ref().map(vector),
        way: way.unwrap_or(default.way),
        seed: seed.cast_unsigned(),
    };
    let explained = |(effects, chi2, probability)| Explained { effects, chi2, probability };
    let rivals: Vec<Explained> = rivals.into_iter().map(explained).collect();
    let mut observations = (*session.observations).clone();
    for row in left_out.unwrap_or_default() {
        if let Some(weight) = observations.weights.get_mut(row) {
            *weight = 0.0;
        }
    }
    let (found, standing) = done(py, || match target {
        Some(target) => until(&observations, &rivals, &options, target).map(|(f, s)| (f, Some(s))),
        None => planning_further::further(&observations, &rivals, &options).map(|f| (f, None)),
    })?;
    let (n, channels) = (found.waits.len(), observations.mechanism.channels.len());
    let out = PyDict::new(py);
    let with_pose = found.poses.len();
    let poses = PyArray1::from_iter(py, found.poses.into_iter().flatten());
    out.set_item("criterion", found.criterion.name())?;
    out.set_item("poses", poses.reshape([with_pose, 6])?)?;
    let readings = PyArray1::from_vec(py, found.table.values);
    out.set_item("readings", readings.reshape([n, channels])?)?;
    out.set_item("keys", found.table.keys)?;
    out.set_item("waits", found.waits)?;
    out.set_item("purposes", pythonize(py, &found.purposes)?)?;
    out.set_item("worth", found.worth)?;
    out.set_item("needed", found.needed)?;
    out.set_item("standing", standing.map(|standing| pythonize(py, &standing)).transpose()?)?;
    out.set_item("merged", found.merged.iter().map(|m| (m[0], m[1])).collect::<Vec<_>>())?;
    out.set_item("kept", found.lambda.0)?;
    out.set_item("lambda", found.lambda.1)?;
    out.set_item("forecast", pythonize(py, &found.forecast)?)?;
    out.set_item("reached", found.reached)?;
    Ok(out)
}

fn count(name: &'static str, value: i64) -> Result<usize, PyError> {
    Ok(usize::try_from(value).map_err(|_| Error::option(name, value, "at least 1"))?)
}
