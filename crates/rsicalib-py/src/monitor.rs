//! The watch.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyBytes};
use pythonize::pythonize;
use rsicalib::Error;
use rsicalib::monitor::closing::{Closing, Scale, closing};
use rsicalib::monitor::{Alarm, Monitor, MonitorOptions, Quiet};
use rsicalib::report::{beside, words};

use crate::apply::PyApplied;
use crate::error::PyError;
use crate::mechanism::PyMechanism;
use crate::tables::PyTable;
use crate::threads::{done, work};

/// A calibrated mechanism that is watched at work.
#[pyclass(name = "Monitor", module = "rsicalib._core")]
pub struct PyMonitor {
    // Boxed: its vector lanes ask for more than the alignment of an object of Python.
    monitor: Box<Monitor>,
    channels: usize,
}

#[pymethods]
impl PyMonitor {
    /// A watch under a result with the covariance of its parameters, (k, k).
    ///
    /// `false_alarms` per sample, at most; `dof`, `correlation` and `interval` [s] are those of the
    /// noise in the calibration.
    #[new]
    #[pyo3(signature = (mechanism, applied, covariance, *, false_alarms=None, dof=None,
                        correlation=0.0, interval=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn new(
        py: Python<'_>,
        mechanism: &PyMechanism,
        applied: PyApplied,
        covariance: PyReadonlyArray2<'_, f64>,
        false_alarms: Option<f64>,
        dof: Option<f64>,
        correlation: f64,
        interval: Option<f64>,
    ) -> PyResult<Self> {
        let covariance: Vec<f64> = covariance.as_array().iter().copied().collect();
        let mut options = MonitorOptions::default();
        options.false_alarms = false_alarms.unwrap_or(options.false_alarms);
        options.quiet = Quiet { dof, correlation, interval };
        let applied = applied.into();
        let monitor = done(py, || Monitor::new(&mechanism.0, &applied, &covariance, &options))?;
        Ok(Self { monitor: Box::new(monitor), channels: mechanism.0.channels.len() })
    }

    /// Tests one row: a reading of each channel, and its time [s]. Returns the alarms.
    #[pyo3(signature = (readings, time=None))]
    fn update<'py>(
        &mut self,
        py: Python<'py>,
        readings: PyReadonlyArray1<'_, f64>,
        time: Option<f64>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let row = readings.as_slice()?;
        Error::same("a row", row.len(), self.channels).map_err(PyError::from)?;
        let alarms = work(py, || self.monitor.update(row, time).to_vec())?;
        alarms.iter().map(|alarm| Ok(pythonize(py, alarm)?)).collect()
    }

    /// Tests many rows, shape (n, channels), with their times [s]. Returns the alarms.
    #[pyo3(signature = (readings, times=None))]
    fn update_all<'py>(
        &mut self,
        py: Python<'py>,
        readings: PyReadonlyArray2<'_, f64>,
        times: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let found = readings.as_array().ncols();
        Error::same("a row", found, self.channels).map_err(PyError::from)?;
        let values = readings.as_slice()?;
        let times = times.as_ref().map(|t| t.as_slice()).transpose()?;
        let alarms: Vec<Alarm> =
            done(py, || self.monitor.update_all(values, times).map(<[Alarm]>::to_vec))?;
        alarms.iter().map(|alarm| Ok(pythonize(py, alarm)?)).collect()
    }

    /// Rows so far, by what became of them.
    fn counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize(py, &self.monitor.counts())?)
    }

    /// All that the watch knows, beside what it was made from, as bytes.
    fn state<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.monitor.state())
    }

    /// Goes on where the watch ended whose `state` this is, one of the same mechanism and result.
    fn restore(&mut self, state: Vec<u8>) -> Result<(), PyError> {
        Ok(self.monitor.restore(state)?)
    }

    /// Noise at work over that of the calibration, and correlation of neighbouring samples.
    #[getter]
    fn noise(&self) -> (f64, f64) {
        self.monitor.noise()
    }

    /// Usual time between neighbouring rows [s].
    #[getter]
    fn interval(&self) -> Option<f64> {
        self.monitor.interval()
    }
}

/// Misclosure, that of the session, the probability of more by chance, and the same in words.
type PyOpenLoops = (f64, Option<f64>, f64, String);

/// Whether the loops of a table of readings are open under a result, beside the misclosure `own` of its own
/// session: misclosure, that of the session, the probability by chance, and the same in words; none
/// where they close, or where no row of the table tells that. Loops that close better than the noise of the result
/// lets them are told where nothing else says that the noise is as it was written.
///
/// `edited`: whether the result's numbers were edited, where that is known.
#[pyfunction]
#[pyo3(signature = (mechanism, applied, table, covariance=None, *, source, own=None, edited=None,
                    scale=1.0, dof=None, correlation=0.0))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn open_loops(
    py: Python<'_>,
    mechanism: &PyMechanism,
    applied: PyApplied,
    table: PyTable<'_>,
    covariance: Option<PyReadonlyArray2<'_, f64>>,
    source: &str,
    own: Option<f64>,
    edited: Option<bool>,
    scale: f64,
    dof: Option<f64>,
    correlation: f64,
) -> PyResult<Option<PyOpenLoops>> {
    let scale = Scale { residual: scale, dof, correlation };
    let found = closed(py, mechanism, applied, table, covariance, scale)?;
    let Some(found) = found else { return Ok(None) };
    if let Some(open) = beside::open_loops(&mechanism.0, &found, own, None) {
        let text = words::open_loops(&mechanism.0, source, &open, edited);
        return Ok(Some((open.rms_misclosure, open.own, open.p_value, text)));
    }
    // What is as it was written is only of louder readings.
    let quieter = (edited.is_none() && found.quieter()).then(|| words::quieter_loops(source));
    Ok(quieter.map(|text| (found.rms_misclosure, own, found.p_quieter, text)))
}

/// How the loops close under a result in the rows of a table that are counted, root mean square [length unit]; None
/// where something is unknown beside the terms.
#[pyfunction]
pub fn rms_misclosure(
    py: Python<'_>,
    mechanism: &PyMechanism,
    applied: PyApplied,
    table: PyTable<'_>,
    counted: Vec<bool>,
) -> PyResult<Option<f64>> {
    let (applied, table) = (applied.into(), table.table());
    done(py, || rsicalib::monitor::closing::rms_misclosure(&mechanism.0, &applied, table, &counted))
}

/// What a result expects of the misclosure of a table of readings, where that is more than `own`, that of
/// its own session, explains; none where it is not.
#[pyfunction]
#[pyo3(signature = (mechanism, applied, table, covariance=None, *, own))]
pub fn expects_more(
    py: Python<'_>,
    mechanism: &PyMechanism,
    applied: PyApplied,
    table: PyTable<'_>,
    covariance: Option<PyReadonlyArray2<'_, f64>>,
    own: f64,
) -> PyResult<Option<f64>> {
    let scale = Scale { residual: 1.0, dof: None, correlation: 0.0 };
    let found = closed(py, mechanism, applied, table, covariance, scale)?;
    Ok(found.filter(|found| found.expects_more_than(own)).map(|found| found.expected_rms))
}

fn closed(
    py: Python<'_>,
    mechanism: &PyMechanism,
    applied: PyApplied,
    table: PyTable<'_>,
    covariance: Option<PyReadonlyArray2<'_, f64>>,
    scale: Scale,
) -> PyResult<Option<Closing>> {
    let covariance: Option<Vec<f64>> = covariance.map(|c| c.as_array().iter().copied().collect());
    let (applied, readings) = (applied.into(), table.some_poses());
    done(py, || closing(&mechanism.0, &applied, covariance.as_deref(), readings, scale))
}
