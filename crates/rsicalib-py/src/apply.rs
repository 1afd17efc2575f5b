//! Results applied to readings: places, groups, export, comparison, and the open loop.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyDict};
use pythonize::{depythonize, pythonize};
use rsicalib::apply::check::Check;
use rsicalib::apply::earlier::{self, Applied, Reference, Reported};
use rsicalib::apply::export::{self, Exported, Note};
use rsicalib::apply::moved::{Compared, Estimate};
use rsicalib::apply::placer::Placer;
use rsicalib::diagnosis::verdict;
use rsicalib::model::Spec;
use rsicalib::monitor::closing::OpenLoops;

use crate::error::PyError;
use crate::mechanism::PyMechanism;
use crate::tables::{PyKnown, PyTable, known_of, poses_of};
use crate::threads::{done, done_as_value};

/// Term, target and place.
pub type PySpec = (String, Option<String>, Option<String>);

pub fn spec_of((term, target, place): PySpec) -> Spec {
    Spec { term, target, place }
}

/// A result on its way to readings that it has not seen.
///
/// Each of `parameters` is ((term, target, place), name, value); `centre`, `span` and
/// `temperature` are those of the readings that they were found with.
#[derive(FromPyObject, IntoPyObject)]
#[pyo3(from_item_all)]
pub struct PyApplied {
    parameters: Vec<(PySpec, String, f64)>,
    centre: Vec<f64>,
    span: Vec<[f64; 2]>,
    temperature: Option<f64>,
    sigma: Vec<f64>,
    declared: bool,
    closures: Vec<(String, f64)>,
    own: bool,
}

impl From<PyApplied> for Applied {
    fn from(given: PyApplied) -> Self {
        let PyApplied { parameters, centre, span, temperature, sigma, declared, closures, own } =
            given;
        let reported = |(spec, name, value)| Reported { spec: spec_of(spec), name, value };
        Self {
            parameters: parameters.into_iter().map(reported).collect(),
            reference: Reference { centre, span, temperature },
            sigma,
            declared,
            closures,
            own,
        }
    }
}

impl From<Applied> for PyApplied {
    fn from(found: Applied) -> Self {
        let Applied { parameters, reference, sigma, declared, closures, own } = found;
        let Reference { centre, span, temperature } = reference;
        let given = |Reported { spec: Spec { term, target, place }, name, value }| {
            ((term, target, place), name, value)
        };
        let parameters = parameters.into_iter().map(given).collect();
        Self { parameters, centre, span, temperature, sigma, declared, closures, own }
    }
}

/// The mechanism as it is declared, as a result on its way to readings.
#[pyfunction]
pub fn declared(mechanism: &PyMechanism) -> PyApplied {
    Applied::declared(&mechanism.0).into()
}

/// Names, values, standard deviations and held rows: shapes (k), (n, k), (n, k) and (n).
type PyPlaces<'py> =
    (Vec<String>, Bound<'py, PyArray2<f64>>, Option<Bound<'py, PyArray2<f64>>>, Vec<bool>);

/// Platform poses under a result, or the points that the chains carry, row by row of a table.
///
/// Names of the columns, values of shape (n, k), and with the covariance of the parameters their
/// standard deviations; None where nothing is known of those. Last, whether a shape is held in each
/// row, beyond the readings at which it was seen.
#[pyfunction]
#[pyo3(signature = (mechanism, applied, table, covariance=None))]
pub fn places<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    applied: PyApplied,
    table: PyTable<'_>,
    covariance: Option<PyReadonlyArray2<'_, f64>>,
) -> PyResult<PyPlaces<'py>> {
    let (applied, table) = (applied.into(), table.table());
    let covariance: Option<Vec<f64>> = covariance.map(|c| c.as_array().iter().copied().collect());
    let found = done(py, || {
        rsicalib::apply::places::places(&mechanism.0, &applied, covariance.as_deref(), table)
    })?;
    let columns = found.names.len();
    let matrix = |values: Vec<f64>| {
        let rows = values.len() / columns.max(1);
        PyArray1::from_vec(py, values).reshape([rows, columns])
    };
    Ok((found.names, matrix(found.values)?, found.sd.map(matrix).transpose()?, found.beyond))
}

/// Coordinates of the joints under a result, row by row of a table [rad, or length units]: shape (n, C).
#[pyfunction]
pub fn joint_coordinates<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    applied: PyApplied,
    table: PyTable<'_>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (applied, table) = (applied.into(), table.table());
    let channels = mechanism.0.channels.len();
    let found =
        done(py, || rsicalib::apply::coordinates::coordinates(&mechanism.0, &applied, table))?;
    let rows = found.len() / channels.max(1);
    PyArray1::from_vec(py, found).reshape([rows, channels])
}

/// A mechanism under a result, which tells its place reading by reading.
#[pyclass(name = "Placer", module = "rsicalib._core")]
pub struct PyPlacer {
    // Boxed: its vector lanes ask for more than the alignment of an object of Python.
    placer: Box<Placer>,
}

#[pymethods]
impl PyPlacer {
    /// A mechanism under a result.
    #[new]
    fn new(mechanism: &PyMechanism, applied: PyApplied) -> PyResult<Self> {
        let placer = Placer::new(&mechanism.0, applied.into()).map_err(PyError::from)?;
        Ok(Self { placer: Box::new(placer) })
    }

    /// Names of the values.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.placer.names().to_vec()
    }

    /// The place of one reading, one number for each channel: shape (k,).
    fn place<'py>(
        &mut self,
        py: Python<'py>,
        reading: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let reading: Vec<f64> = reading.as_array().iter().copied().collect();
        let found = self.placer.place(&reading).map_err(PyError::from)?;
        Ok(PyArray1::from_vec(py, found))
    }
}

/// The mechanism with the parameters of a result in it, the same motions of the ends of its
/// chains as rows `{chain: row}`, and what could not be put in: objects with `kind`, `term`, `target`
/// and `text`.
#[pyfunction]
pub fn exported<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    applied: PyApplied,
) -> PyResult<(PyMechanism, Bound<'py, PyAny>, Vec<Bound<'py, PyDict>>)> {
    let applied = applied.into();
    let Exported { mechanism, tips, notes } =
        done(py, || export::exported(&mechanism.0, &applied))?;
    let tips: std::collections::BTreeMap<_, _> = tips.into_iter().collect();
    let notes = notes.iter().map(|note| noted(py, note)).collect::<PyResult<_>>()?;
    Ok((mechanism.into(), pythonize(py, &tips)?, notes))
}

fn noted<'py>(py: Python<'py>, note: &Note) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("kind", note.id())?;
    out.set_item("term", note.effect().map(|spec| spec.term.as_str()))?;
    out.set_item("target", note.target())?;
    out.set_item("text", note.to_string())?;
    Ok(out)
}

/// The mechanism with the gains and offsets that a result has found.
#[pyfunction]
pub fn calibrated_sensors(
    py: Python<'_>,
    mechanism: &PyMechanism,
    applied: PyApplied,
) -> PyResult<PyMechanism> {
    let applied = applied.into();
    Ok(done(py, || export::with_sensors(&mechanism.0, &applied))?.into())
}

/// The terms of a result that a later session is identified with: `curvature@a22`, each once.
#[pyfunction]
pub fn lasting(mechanism: &PyMechanism, specs: Vec<PySpec>) -> Result<Vec<String>, PyError> {
    let specs: Vec<Spec> = specs.into_iter().map(spec_of).collect();
    Ok(earlier::lasting(&mechanism.0, &specs)?.iter().map(ToString::to_string).collect())
}

/// The units that each parameter of a result may have, of ((term, target, place), name); empty where
/// any will do.
#[pyfunction]
pub fn units_of(
    mechanism: &PyMechanism,
    named: Vec<(PySpec, String)>,
) -> Result<Vec<Vec<String>>, PyError> {
    let own = |(spec, name): (PySpec, String)| {
        Ok(earlier::units_of(&mechanism.0, &spec_of(spec), &name)?)
    };
    named.into_iter().map(own).collect()
}

/// The unit of a parameter that a column is called after, as `gain@a11`; None where it has none, or
/// several.
#[pyfunction]
pub fn unit_of_key(mechanism: &PyMechanism, key: &str) -> Option<String> {
    earlier::unit_of_key(&mechanism.0, key)
}

/// A term at its place, as it is asked for: `curvature@a22`, `slip@a22:17`.
#[pyfunction]
#[pyo3(signature = (term, target=None, place=None))]
pub fn spec(term: String, target: Option<String>, place: Option<String>) -> String {
    Spec { term, target, place }.to_string()
}

/// Spec, name, value and standard deviation.
pub type PyEstimate = (PySpec, String, Option<f64>, Option<f64>);

pub fn estimate_of((spec, name, value, sd): PyEstimate) -> Estimate {
    Estimate { spec: spec_of(spec), name, value, sd }
}

/// Parameters that an earlier result knows, too: number among the new ones, before, after, standard
/// deviation of the difference, and whether it is beyond both uncertainties.
#[pyfunction]
pub fn compared(
    mechanism: &PyMechanism,
    earlier: Vec<PyEstimate>,
    now: Vec<PyEstimate>,
) -> Vec<(usize, f64, f64, f64, bool)> {
    let all = |given: Vec<PyEstimate>| given.into_iter().map(estimate_of).collect::<Vec<_>>();
    rsicalib::apply::moved::compared(&mechanism.0, &all(earlier), &all(now))
        .into_iter()
        .map(|Compared { parameter, before, after, sd, moved }| {
            (parameter, before, after, sd, moved)
        })
        .collect()
}

/// Error of a result on known poses, root mean square over components.
#[pyfunction]
#[pyo3(signature = (mechanism, applied, known_poses, align=false))]
pub fn check<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    applied: PyApplied,
    known_poses: PyKnown<'_>,
    align: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let (applied, known) = (applied.into(), known_of(known_poses, align));
    done_as_value(py, || earlier::check(&mechanism.0, &applied, &known, align))
}

/// The verdict on lines through so many known poses, and its reasons, by the error of the calibration
/// and of the mechanism as declared on check poses, and by their loops that are open: misclosure, that of the
/// session, probability by chance. Of no poses: nothing could begin.
#[pyfunction]
#[pyo3(signature = (poses=0, check=None, nominal=None, open_loops=None))]
pub fn judged_open_loop<'py>(
    py: Python<'py>,
    poses: usize,
    check: Option<Bound<'py, PyAny>>,
    nominal: Option<Bound<'py, PyAny>>,
    open_loops: Option<(f64, Option<f64>, f64)>,
) -> PyResult<Bound<'py, PyAny>> {
    let read = |check: Option<Bound<'py, PyAny>>| -> PyResult<Option<Check>> {
        Ok(check.map(|check| depythonize(&check)).transpose()?)
    };
    let (check, nominal) = (read(check)?, read(nominal)?);
    let open =
        open_loops.map(|(rms_misclosure, own, p_value)| OpenLoops { rms_misclosure, own, p_value });
    Ok(pythonize(py, &verdict::open_loop(poses, check, nominal, open))?)
}

/// Offset and gain of every channel from known poses, eq. (13): `(lines, poses)`.
#[pyfunction]
pub fn fixture<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    table: PyTable<'_>,
    poses: PyReadonlyArray2<'_, f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let (table, poses) = (table.table(), poses_of(&poses));
    done_as_value(py, || rsicalib::apply::fixture::fixture(&mechanism.0, &table, &poses))
}
