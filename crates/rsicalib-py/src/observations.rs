//! Sessions and fits.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyTuple};
use pythonize::pythonize;
use rsicalib::apply::earlier::Applied;
use rsicalib::design::suppose::Supposed;
use rsicalib::diagnosis::options::{Rule, SearchOptions};
use rsicalib::diagnosis::trace::Traced;
use rsicalib::estimate::directions::directions;
use rsicalib::estimate::progress::Progress;
use rsicalib::estimate::{Expected, Fit, Observations};
use rsicalib::mechanism::Mechanism;
use rsicalib::report::beside::{Beside, Touched};
use rsicalib::report::calibrated;
use rsicalib::report::evidence::gather;
use rsicalib::report::result::{Estimates, FitReport, Known, estimates};
use rsicalib::report::update::Update;

use rsicalib::report::warned::{self, Warned};
use rsicalib::screening::excluded::Excluded;
use serde::Serialize;

use crate::apply::PyApplied;
use crate::error::PyError;
use crate::mechanism::PyMechanism;
use crate::options::{PyExpected, fit_options};
use crate::tables::{PyKnown, PyTable, known_of};
use crate::threads::{done, done_as_value, work};

/// Readings of one mechanism, with what is known beside them.
#[pyclass(frozen, skip_from_py_object, name = "Session", module = "rsicalib._core")]
pub struct PyObservations {
    pub observations: Arc<Observations>,
    listener: Option<Listener>,
}

/// A Python function that is told how far a job is.
struct Listener {
    function: Arc<Py<PyAny>>,
    /// What it raised first; it is not called again then.
    raised: Arc<Mutex<Option<PyErr>>>,
}

impl Listener {
    fn new(function: Py<PyAny>) -> Self {
        Self { function: Arc::new(function), raised: Arc::default() }
    }

    fn progress(&self) -> Progress {
        let (function, raised) = (Arc::clone(&self.function), Arc::clone(&self.raised));
        Progress::heard_by(move |stage, share| {
            Python::attach(|py| {
                // Not locked while Python runs: it may let another thread of the core in.
                let first = || raised.lock().unwrap_or_else(PoisonError::into_inner);
                match function.call1(py, (stage.words(), share)) {
                    Ok(_) => ControlFlow::Continue(()),
                    Err(error) => {
                        first().get_or_insert(error);
                        ControlFlow::Break(())
                    }
                }
            })
        })
    }
}

/// A fitted model.
#[pyclass(frozen, skip_from_py_object, name = "Fit", module = "rsicalib._core")]
pub struct PyFit {
    pub observations: Arc<Observations>,
    pub fit: Arc<Fit>,
}

/// A calibration in the shape of the JSON, the fit, and the fit with what was left out.
type Calibration<'py> = (Bound<'py, PyAny>, PyFit, Option<PyFit>);

/// What is known beside the readings, as Python gives it: see [`Beside`].
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PyBeside<'py> {
    mechanism: PyRef<'py, PyMechanism>,
    declared: PyApplied,
    known: Option<PyKnown<'py>>,
    align: bool,
    whole: Option<PyTable<'py>>,
    groups: Option<Vec<String>>,
    keep: Option<Vec<String>>,
    leave: Option<Vec<String>>,
    own: bool,
}

impl From<PyBeside<'_>> for Beside {
    fn from(given: PyBeside<'_>) -> Self {
        let PyBeside { align, groups, keep, leave, own, .. } = given;
        let known = |known| known_of(known, align);
        let touched = |whole| Touched { table: PyTable::table(&whole), groups, keep, leave, own };
        Self {
            mechanism: Mechanism::clone(&given.mechanism.0),
            declared: given.declared.into(),
            known: given.known.map(known),
            touched: given.whole.map(touched),
        }
    }
}

#[pymethods]
impl PyObservations {
    /// Checks readings against a mechanism and gathers the options.
    #[new]
    #[pyo3(signature = (mechanism, table, *, rest=None, terms=None, closures=None, method=None,
                        noise=None, starts=None, max_iterations=None, xtol=None, progress=None,
                        expected=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn new(
        py: Python<'_>,
        mechanism: &PyMechanism,
        table: PyTable<'_>,
        rest: Option<PyReadonlyArray2<'_, f64>>,
        terms: Option<Vec<String>>,
        closures: Option<Vec<String>>,
        method: Option<&str>,
        noise: Option<Vec<f64>>,
        starts: Option<usize>,
        max_iterations: Option<usize>,
        xtol: Option<f64>,
        progress: Option<Py<PyAny>>,
        expected: Option<PyExpected>,
    ) -> PyResult<Self> {
        let mut options = fit_options(terms, closures, method, noise)?;
        options.starts = starts.unwrap_or(options.starts);
        options.lm.max_iterations = max_iterations.unwrap_or(options.lm.max_iterations);
        options.lm.xtol = xtol.unwrap_or(options.lm.xtol);
        options.expected = expected.map(Expected::from);
        let listener = progress.map(Listener::new);
        if let Some(listener) = &listener {
            options.progress = listener.progress();
        }
        let rest = rest.map(|r| r.as_array().iter().copied().collect());
        let table = table.table();
        let observations = done(py, || Observations::new(&mechanism.0, table, rest, options))?;
        Ok(Self { observations: Arc::new(observations), listener })
    }

    /// What reported parameters refer to: `centre` and `span` of each channel, `temperature`.
    fn reference<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize(py, &rsicalib::apply::earlier::Reference::of(&self.observations))?)
    }

    /// Terms that are no candidates here, and what they need: `{id: needs}`.
    fn lacking(&self) -> HashMap<&'static str, String> {
        rsicalib::diagnosis::lacking(&self.observations).into_iter().collect()
    }

    /// What effects would do in these poses: `supposed` as in `curvature@a22.c2=0.02`.
    fn suppose<'py>(&self, py: Python<'py>, supposed: Vec<String>) -> PyResult<Bound<'py, PyAny>> {
        let session = Arc::clone(&self.observations);
        done_as_value(py, || {
            let all: Result<Vec<Supposed>, _> =
                supposed.iter().map(|text| Supposed::parse(text)).collect();
            rsicalib::design::suppose::suppose(&session, &all?)
        })
    }

    /// Closes the loop.
    #[pyo3(signature = (beside=None, without=None, off=None, apply_all=false))]
    fn trace<'py>(
        &self,
        py: Python<'py>,
        beside: Option<PyBeside<'_>>,
        without: Option<Vec<String>>,
        off: Option<Vec<String>>,
        apply_all: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let beside = beside.map(Beside::from);
        let off: Result<Vec<Rule>, _> =
            off.unwrap_or_default().iter().map(|id| Rule::of(id)).collect();
        let off = off.map_err(PyError::from)?;
        let default = SearchOptions::default();
        let search =
            SearchOptions { apply_all, without: without.unwrap_or_default(), off, ..default };
        let session = Arc::clone(&self.observations);
        let found =
            work(py, || rsicalib::report::traced::traced(&session, &search, beside.as_ref()))?;
        self.heard()?;
        let (report, traced) = found.map_err(PyError::from)?;
        let equations = traced.last.residuals.equations;
        let known = beside.and_then(|beside| beside.known);
        let source = PyEvidenceSource { found: Found::Traced(Box::new(traced)), known };
        let found = with_source(pythonize(py, &report)?, source)?;
        found.set_item("before_residuals", by_pose(py, report.before_residuals, equations)?)?;
        found.set_item("after_residuals", by_pose(py, report.after_residuals, equations)?)?;
        Ok(found)
    }

    /// Fits the terms that the options ask for, without readings that are wrong.
    ///
    /// Returns the calibration, the fit, and the fit of all readings where any was left out.
    #[pyo3(signature = (beside=None))]
    fn calibrate<'py>(
        &self,
        py: Python<'py>,
        beside: Option<PyBeside<'_>>,
    ) -> PyResult<Calibration<'py>> {
        let observations = Arc::clone(&self.observations);
        let beside = beside.map(Beside::from);
        let found = work(py, || calibrated::report(&observations, beside.as_ref()))?;
        self.heard()?;
        let (report, calibrated) = found.map_err(PyError::from)?;
        let with = calibrated.with.map(|fit| PyFit { observations, fit: Arc::new(fit) });
        let (used, fit) = (Arc::new(calibrated.observations), Arc::new(calibrated.fit));
        let found = Found::Calibrated(Arc::clone(&used), Arc::clone(&fit), calibrated.excluded);
        let source = PyEvidenceSource { found, known: beside.and_then(|beside| beside.known) };
        let found = with_source(pythonize(py, &report)?, source)?;
        let equations = fit.residuals.equations;
        found.set_item("after_residuals", by_pose(py, report.after_residuals, equations)?)?;
        Ok((found, PyFit { observations: used, fit }, with))
    }

    /// Fits the terms that the options ask for.
    fn fit(&self, py: Python<'_>) -> PyResult<PyFit> {
        let session = Arc::clone(&self.observations);
        let fit = done(py, || session.instances().and_then(|i| rsicalib::fit(&session, i, None)))?;
        Ok(PyFit { observations: session, fit: Arc::new(fit) })
    }
}

/// A result in the shape of the JSON, with the source of its evidence beside it.
fn with_source<'py>(
    report: Bound<'py, PyAny>,
    source: PyEvidenceSource,
) -> PyResult<Bound<'py, PyAny>> {
    report.set_item("source", Bound::new(report.py(), source)?)?;
    Ok(report)
}

/// Residuals of poses as an array: shape (poses, equations).
fn by_pose<'py>(
    py: Python<'py>,
    residuals: Vec<f64>,
    equations: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let poses = residuals.len() / equations.max(1);
    let array = PyArray1::from_vec(py, residuals).reshape([poses, equations])?;
    array.readwrite().make_nonwriteable();
    Ok(array)
}

/// What evidence is gathered from.
enum Found {
    Traced(Box<Traced>),
    Calibrated(Arc<Observations>, Arc<Fit>, Vec<Excluded>),
}

/// What a report is drawn from, gathered where a report is asked for.
#[pyclass(frozen, skip_from_py_object, name = "EvidenceSource", module = "rsicalib._core")]
pub struct PyEvidenceSource {
    found: Found,
    known: Option<Known>,
}

#[pymethods]
impl PyEvidenceSource {
    /// The evidence in the shape of its schema.
    fn gather<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let known = self.known.as_ref();
        done_as_value(py, || match &self.found {
            Found::Traced(traced) => gather::of_trace(traced, known),
            Found::Calibrated(observations, fit, excluded) => {
                gather::of_calibration(observations, fit, excluded, known)
            }
        })
    }

    /// What has changed since an earlier result with the covariance of its parameters, (k, k), and
    /// whether that is worth an update where the loops close to `rms`, poses left out in turn. A trace
    /// compares with what was asked for: what it found besides may be in the earlier session, too.
    #[pyo3(signature = (applied, covariance=None, rms=None))]
    fn changes<'py>(
        &self,
        py: Python<'py>,
        applied: PyApplied,
        covariance: Option<PyReadonlyArray2<'_, f64>>,
        rms: Option<f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let covariance: Option<Vec<f64>> =
            covariance.map(|c| c.as_array().iter().copied().collect());
        let applied: Applied = applied.into();
        let since = |later: (&Observations, &Fit)| {
            Update::since(&applied, covariance.as_deref(), later, rms)
        };
        done_as_value(py, || match &self.found {
            Found::Traced(traced) => since((&traced.observations, &*traced.asked()?)),
            Found::Calibrated(observations, fit, _) => since((observations, fit)),
        })
    }

    /// A pickle does not keep it: None.
    fn __reduce__(&self, py: Python<'_>) -> PyResult<(Py<PyAny>, Py<PyAny>)> {
        let nothing = py.None().bind(py).get_type().into_any().unbind();
        Ok((nothing, PyTuple::empty(py).into_any().unbind()))
    }
}

impl PyObservations {
    /// Raises what the listener raised.
    fn heard(&self) -> PyResult<()> {
        let Some(listener) = &self.listener else { return Ok(()) };
        let raised = listener.raised.lock().unwrap_or_else(PoisonError::into_inner).take();
        raised.map_or(Ok(()), Err)
    }
}

#[derive(Serialize)]
struct FitView {
    fit: FitReport,
    warnings: Vec<Warned>,
    #[serde(flatten)]
    estimates: Estimates,
}

#[pymethods]
impl PyFit {
    /// The fit in the shape of the JSON.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let view = work(py, || {
            let directions = directions(&self.observations, &self.fit);
            FitView {
                fit: FitReport::of(&self.fit),
                warnings: warned::warnings(&self.observations, &self.fit, &self.fit),
                estimates: estimates(&self.observations, &self.fit, &directions),
            }
        })?;
        Ok(pythonize(py, &view)?)
    }

    /// What looks wrong with the readings or what is declared of them.
    #[getter]
    fn warnings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize(py, &warned::warnings(&self.observations, &self.fit, &self.fit))?)
    }

    /// Which wires are exchanged: of two channels, or the outer ones of one. None where nothing says so.
    #[getter]
    fn wires<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize(py, &warned::wires(&self.observations, &self.fit))?)
    }

    /// Error on known poses: `(poses, position rms, orientation rms)`.
    #[pyo3(signature = (known_poses, align=false))]
    fn check<'py>(
        &self,
        py: Python<'py>,
        known_poses: PyKnown<'_>,
        align: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let known = known_of(known_poses, align);
        done_as_value(py, || {
            rsicalib::apply::check::check(&self.observations, &self.fit, &known, align)
        })
    }

    /// Platform pose of every row of a table: shape (n, 6).
    fn forward<'py>(
        &self,
        py: Python<'py>,
        table: PyTable<'_>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let table = table.table();
        let poses = done(py, || {
            let beta = &self.fit.beta;
            rsicalib::apply::poses::platform_poses(&self.observations, &self.fit, beta, table)
        })?;
        let flat: Vec<f64> = poses.iter().flatten().copied().collect();
        PyArray1::from_vec(py, flat).reshape([poses.len(), 6])
    }

    /// Whitened residuals: shape (samples, equations), standard normal if the model is right.
    fn residuals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let r = &self.fit.residuals;
        PyArray1::from_slice(py, &r.whitened).reshape([r.whitened.len() / r.equations, r.equations])
    }
}
