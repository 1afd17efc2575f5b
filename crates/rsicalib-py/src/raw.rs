//! What is told of raw readings: what looks wrong, and when nothing moves.

use std::borrow::Cow;

use numpy::{Element, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyAny;
use pythonize::pythonize;
use rsicalib::Error;
use rsicalib::mechanism::Channel;
use rsicalib::readings::still;
use rsicalib::screening::raw::{self, Raw};

use crate::error::PyError;

/// What raw readings are judged by.
#[derive(FromPyObject)]
pub struct PySensor {
    unit: String,
    range: Option<(f64, f64)>,
    gain: f64,
}

impl From<PySensor> for Channel {
    fn from(PySensor { unit, range, gain }: PySensor) -> Self {
        Self { unit, range: range.map(Into::into), gain, ..Self::default() }
    }
}

/// What looks wrong in readings of shape (n, channels): the variants of `Suspect`, each as a dictionary
/// with its `kind`. Rows are counted from 0; `pose` labels each row, None for a recording.
#[pyfunction]
#[pyo3(signature = (channels, values, pose))]
pub fn suspects<'py>(
    py: Python<'py>,
    channels: Vec<PySensor>,
    values: PyReadonlyArray2<'py, f64>,
    pose: Option<PyReadonlyArray1<'py, i64>>,
) -> PyResult<Bound<'py, PyAny>> {
    each_channel(&channels, &values)?;
    each_row("pose", pose.as_ref(), &values)?;
    let (channels, pose) = (sensors(channels), pose.as_ref().map(entries));
    let found = raw::suspects(&Raw::new(&channels, &in_rows(&values), pose.as_deref()));
    Ok(pythonize(py, &found)?)
}

/// Poses that nothing numbers: a variant of `Unlabelled` as a dictionary with its `kind`, None where every
/// row is a pose of its own. `sample` numbers the sample of each row.
#[pyfunction]
#[pyo3(signature = (channels, values, pose, sample))]
pub fn unlabelled<'py>(
    py: Python<'py>,
    channels: Vec<PySensor>,
    values: PyReadonlyArray2<'py, f64>,
    pose: Option<PyReadonlyArray1<'py, i64>>,
    sample: Option<PyReadonlyArray1<'py, i64>>,
) -> PyResult<Option<Bound<'py, PyAny>>> {
    each_channel(&channels, &values)?;
    each_row("pose", pose.as_ref(), &values)?;
    each_row("sample", sample.as_ref(), &values)?;
    let (channels, pose) = (sensors(channels), pose.as_ref().map(entries));
    let (values, sample) = (in_rows(&values), sample.as_ref().map(entries));
    let found = raw::unlabelled(&Raw::new(&channels, &values, pose.as_deref()), sample.as_deref());
    Ok(found.map(|found| pythonize(py, &found)).transpose()?)
}

/// First row, and row after the last, of each stretch of a recording that is still for `hold` seconds. `values`
/// has shape (n, channels), and `inside` says which rows may belong to a stretch.
#[pyfunction]
#[pyo3(signature = (values, time, hold, inside=None))]
pub fn still_stretches(
    values: PyReadonlyArray2<'_, f64>,
    time: PyReadonlyArray1<'_, f64>,
    hold: f64,
    inside: Option<PyReadonlyArray1<'_, bool>>,
) -> PyResult<Vec<(usize, usize)>> {
    each_row("time", Some(&time), &values)?;
    each_row("inside", inside.as_ref(), &values)?;
    let (time, inside) = (entries(&time), inside.as_ref().map(entries));
    let found = still::still_stretches(&in_rows(&values), &time, hold, inside.as_deref());
    Ok(found.into_iter().map(|rows| (rows.start, rows.end)).collect())
}

/// An error where an array that is given has not one entry for each row of the readings.
fn each_row<T: Element>(
    what: &str,
    given: Option<&PyReadonlyArray1<'_, T>>,
    values: &PyReadonlyArray2<'_, f64>,
) -> PyResult<()> {
    given.map_or(Ok(()), |array| as_many(what, array.as_array().len(), values.as_array().nrows()))
}

/// An error where the readings have not one column for each channel.
fn each_channel(channels: &[PySensor], values: &PyReadonlyArray2<'_, f64>) -> PyResult<()> {
    as_many("channels", channels.len(), values.as_array().ncols())
}

fn as_many(what: &str, found: usize, expected: usize) -> PyResult<()> {
    Ok(Error::same(what, found, expected).map_err(PyError::from)?)
}

fn sensors(given: Vec<PySensor>) -> Vec<Channel> {
    given.into_iter().map(Channel::from).collect()
}

/// The entries of an array: as it holds them, where it does.
fn entries<'a, T: Element + Copy>(array: &'a PyReadonlyArray1<'_, T>) -> Cow<'a, [T]> {
    let copied = || array.as_array().iter().copied().collect();
    array.as_array().to_slice().map_or_else(copied, Cow::Borrowed)
}

/// The numbers of an array, row by row: as it holds them, where it does.
fn in_rows<'a>(values: &'a PyReadonlyArray2<'_, f64>) -> Cow<'a, [f64]> {
    let copied = || values.as_array().iter().copied().collect();
    values.as_array().to_slice().map_or_else(copied, Cow::Borrowed)
}
