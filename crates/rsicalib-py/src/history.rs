//! Results of one device over years.

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyAny;
use pythonize::pythonize;
use rsicalib::history::{Dated, forecast, series};

use crate::apply::{PyApplied, PyEstimate, PySpec, estimate_of, spec_of};
use crate::mechanism::PyMechanism;
use crate::tables::PyTable;
use crate::threads::done;

/// Day, parameters, the covariance of those that have a value, and where something has changed, as the result says.
type PyDated<'py> = (f64, Vec<PyEstimate>, Option<PyReadonlyArray2<'py, f64>>, Vec<PySpec>);

/// The last result, where the platform is looked at, and its target.
type PyLast<'py> = (PyApplied, PyTable<'py>, f64);

/// Series, effects of single sessions, and what is to come.
type PyHistory<'py> = (Bound<'py, PyAny>, Vec<String>, Option<Bound<'py, PyAny>>);

/// What the parameters of a device have done over its results, in order of their dates.
///
/// Objects with `known` (the results that know a parameter, each with its number in it) and `course`, as in
/// `history.json`, None where that cannot be told; the effects that belong to single sessions; and, with the
/// last result, when the platform's error will exceed the target: `target`, `now`, and days from then on, `day`
/// and `from_day`.
#[pyfunction]
#[pyo3(signature = (mechanism, results, last=None))]
pub fn history<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    results: Vec<PyDated<'_>>,
    last: Option<PyLast<'_>>,
) -> PyResult<PyHistory<'py>> {
    let dated = |(day, estimates, covariance, changed): PyDated<'_>| {
        let estimates = estimates.into_iter().map(estimate_of).collect();
        let covariance = covariance.map(|all| all.as_array().iter().copied().collect());
        let changed = changed.into_iter().map(spec_of).collect();
        Dated { day, estimates, covariance: covariance.unwrap_or_default(), changed }
    };
    let results: Vec<Dated> = results.into_iter().map(dated).collect();
    let last = last.map(|(applied, table, target)| (applied.into(), table.table(), target));
    let (series, passing, forecast) = done(py, || {
        let (series, passing) = series(&mechanism.0, &results)?;
        let coming = last.map(|(applied, table, target)| {
            forecast(&mechanism.0, &applied, &results, &series, table, target)
        });
        Ok::<_, rsicalib::Error>((series, passing, coming.transpose()?.flatten()))
    })?;
    let forecast = forecast.map(|forecast| pythonize(py, &forecast)).transpose()?;
    let passing = passing.iter().map(ToString::to_string).collect();
    Ok((pythonize(py, &series)?, passing, forecast))
}
