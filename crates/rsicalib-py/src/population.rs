//! What devices of one design share.

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyDict};
use pythonize::pythonize;
use rsicalib::diagnosis::verdict::Verdict;
use rsicalib::estimate::Expected;
use rsicalib::estimate::directions::ParameterReport;
use rsicalib::model::Spec;
use rsicalib::population::standing_out::{self as fleet, Known, Odd, Usual};
use rsicalib::population::{Candidate, Share, Shift, Summed, middles};

use crate::error::PyError;
use crate::mechanism::PyMechanism;
use crate::options::{PyExpected, fit_options};
use crate::tables::PyTable;
use crate::threads::{done, work};

/// Value and standard deviation of each parameter.
type Values = Vec<(f64, f64)>;

/// What devices share, each with the others, the device of each share, and the level of devices.
type Population<'py> = (Bound<'py, PyAny>, Vec<Values>, Vec<usize>, Option<usize>);

/// What a device tells, as Python carries it: matrices as arrays, the rest as lists.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PyShare<'py> {
    information: PyReadonlyArray2<'py, f64>,
    told: PyReadonlyArray1<'py, f64>,
    parameters: Vec<(String, String, String, String)>,
    candidates: Vec<(String, Option<String>, String, Vec<usize>)>,
}

impl From<&PyShare<'_>> for Share {
    fn from(given: &PyShare<'_>) -> Self {
        let parameter = |(term, target, name, unit): &(String, String, String, String)| {
            ParameterReport::named(term, target.clone(), name, unit.clone())
        };
        let candidate =
            |(term, target, name, columns): &(_, Option<String>, String, Vec<usize>)| {
                let spec = Spec { term: String::clone(term), target: target.clone(), place: None };
                Candidate { spec, name: name.clone(), columns: columns.clone() }
            };
        let h = given.information.as_array();
        Self {
            parameters: given.parameters.iter().map(parameter).collect(),
            information: h.iter().copied().collect(),
            told: given.told.as_array().to_vec(),
            candidates: given.candidates.iter().map(candidate).collect(),
        }
    }
}

/// Readings from which offsets of a population are counted, one per channel.
#[pyfunction]
pub fn centre_of_population(mechanism: &PyMechanism) -> Vec<f64> {
    middles(&mechanism.0)
}

/// What each device tells of `terms`, given what is expected; why not, for one that tells nothing.
#[pyfunction]
#[pyo3(signature = (mechanism, tables, rests, terms, expected, *, closures=None, noise=None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn shares<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    tables: Vec<PyTable<'py>>,
    rests: Vec<Option<PyReadonlyArray2<'py, f64>>>,
    terms: Vec<String>,
    expected: PyExpected,
    closures: Option<Vec<String>>,
    noise: Option<Vec<f64>>,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let rest = |rest: &Option<PyReadonlyArray2<'_, f64>>| {
        rest.as_ref().map(|r| r.as_array().iter().copied().collect())
    };
    let readings: Vec<_> = tables.iter().zip(&rests).map(|(t, r)| (t.table(), rest(r))).collect();
    let options = fit_options(None, closures, None, noise)?;
    let expected = Expected::from(expected);
    let mechanism = mechanism.0.clone();
    let found: Vec<Result<Share, rsicalib::Error>> = work(py, || {
        let one = |(table, rest)| {
            let expected = expected.clone();
            rsicalib::population::share(&mechanism, table, rest, &options, &terms, expected)
        };
        readings.into_iter().map(one).collect()
    })?;
    found.into_iter().map(|one| told(py, one)).collect()
}

fn told<'py>(
    py: Python<'py>,
    found: Result<Share, rsicalib::Error>,
) -> PyResult<Bound<'py, PyAny>> {
    let share = match found {
        Ok(share) => share,
        Err(error) => return Ok(error.to_string().into_pyobject(py)?.into_any()),
    };
    let out = PyDict::new(py);
    let n = share.told.len();
    let rows: Vec<Vec<f64>> = share.information.chunks(n.max(1)).map(<[f64]>::to_vec).collect();
    let parameters: Vec<_> =
        share.parameters.into_iter().map(|p| (p.term, p.target, p.name, p.unit)).collect();
    let candidates: Vec<_> = share
        .candidates
        .into_iter()
        .map(|c| (c.spec.term, c.spec.target, c.name, c.columns))
        .collect();
    out.set_item("information", PyArray2::from_vec2(py, &rows)?)?;
    out.set_item("told", PyArray1::from_vec(py, share.told))?;
    out.set_item("parameters", parameters)?;
    out.set_item("candidates", candidates)?;
    Ok(out.into_any())
}

/// The joint estimate in the shape of the JSON, and value and deviation of the parameters of each
/// device with what the others tell (corrections of the drawing, (n, 2); empty for outliers); the
/// device of each share, and the level of devices, where `levels` says for each level in which group
/// each share is.
#[pyfunction]
#[pyo3(signature = (shares, tolerances, levels=None))]
pub fn population<'py>(
    py: Python<'py>,
    shares: Vec<PyShare<'py>>,
    tolerances: Vec<f64>,
    levels: Option<Vec<Vec<usize>>>,
) -> PyResult<Population<'py>> {
    let levels = levels.unwrap_or_default();
    let shares: Vec<Share> = shares.iter().map(Share::from).collect();
    let n = tolerances.len();
    let alike = |s: &Share| s.told.len() == n && s.information.len() == n * n;
    if !shares.iter().all(alike) {
        let found = "devices with other parameters than the first";
        let expected = "the same terms of every device";
        return Err(PyError::from(rsicalib::Error::option("population", found, expected)).into());
    }
    let found = done(py, || rsicalib::population::found(&shares, &tolerances, &levels))?;
    Ok((pythonize(py, &found)?, found.with_others, found.device_of, found.level))
}

/// The tests of fit of many devices together: `{devices, chi2, dof, p_value}`, None for too few.
///
/// `devices` has a row for each: chi2, dof, p-value.
#[pyfunction]
pub fn summed<'py>(
    py: Python<'py>,
    devices: PyReadonlyArray2<'py, f64>,
) -> PyResult<Option<Bound<'py, PyAny>>> {
    let devices: Vec<_> =
        devices.as_array().rows().into_iter().map(|d| (d[0], d[1], d[2])).collect();
    let found: Option<Summed> = rsicalib::population::summed(&devices);
    Ok(found.map(|found| pythonize(py, &found)).transpose()?)
}

/// Which of some tests are beyond chance, by the probability of each, all of them counted in; None says nothing.
#[pyfunction]
pub fn beyond_chance(p_values: Vec<Option<f64>>) -> Vec<bool> {
    rsicalib::population::beyond_chance(&p_values)
}

/// Common shift of each parameter, from a row for each device (distance from the drawing, sd), by
/// parameters: `{devices, value, half, between, between_interval, p_value}`, None for too few. `levels`
/// says for each level in which group each device is; each then has `levels`, devices first.
#[pyfunction]
#[pyo3(signature = (estimates, levels=None))]
pub fn common_shifts<'py>(
    py: Python<'py>,
    estimates: PyReadonlyArray3<'py, f64>,
    levels: Option<Vec<Vec<usize>>>,
) -> PyResult<Vec<Option<Bound<'py, PyAny>>>> {
    let estimates: Vec<Vec<(f64, f64)>> = estimates
        .as_array()
        .outer_iter()
        .map(|devices| devices.rows().into_iter().map(|d| (d[0], d[1])).collect())
        .collect();
    let levels = levels.unwrap_or_default();
    let found: Vec<Option<Shift>> =
        done(py, || rsicalib::population::common_shifts(&estimates, &levels))?;
    found.iter().map(|one| Ok(one.as_ref().map(|one| pythonize(py, one)).transpose()?)).collect()
}

/// Median of a parameter over usable devices, standard deviation between them, and of one of them; how many they are.
type PyUsual = (f64, f64, f64, usize);

/// A device, how much it stands out, and the parameter with how many times worse than usual it is known.
type PyRemark = (usize, f64, Option<(usize, Option<f64>)>);

fn usual_of((median, between, within, devices): PyUsual) -> Usual {
    Usual { median, between, within, devices }
}

/// Pairs of numbers, row by row.
fn pairs(of: &PyReadonlyArray2<'_, f64>) -> Vec<(f64, f64)> {
    of.as_array().rows().into_iter().map(|row| (row[0], row[1])).collect()
}

/// Verdicts by their places in `VERDICTS`; what has no place was refused.
fn verdicts_of(places: &PyReadonlyArray1<'_, i64>) -> Vec<Option<Verdict>> {
    let verdict = |place: &i64| Verdict::ALL.get(usize::try_from(*place).ok()?).copied();
    places.as_array().iter().map(verdict).collect()
}

/// What is usual of a parameter over a fleet, (median, sd between devices, sd of one, how many), and the device that is
/// farthest from that, with its distance; None for too few. `devices` has a value and its sd in each row,
/// `verdicts` their places in `VERDICTS`, -1 for refused.
#[pyfunction]
pub fn usual(
    devices: PyReadonlyArray2<'_, f64>,
    verdicts: PyReadonlyArray1<'_, i64>,
) -> Option<(PyUsual, (usize, f64))> {
    let devices: Vec<Known> = pairs(&devices);
    let found = Usual::of(&devices, &verdicts_of(&verdicts))?;
    let usual = (found.median, found.between, found.within, found.devices);
    Some((usual, found.furthest(&devices)))
}

/// Distance of each device from what is usual, in standard deviations; NaN where it is not known.
#[pyfunction]
pub fn distances<'py>(
    py: Python<'py>,
    devices: PyReadonlyArray2<'py, f64>,
    usual: PyUsual,
) -> Bound<'py, PyArray1<f64>> {
    let usual = usual_of(usual);
    PyArray1::from_iter(py, pairs(&devices).into_iter().map(|own| usual.far(own)))
}

/// Devices that stand out, those first that need a decision: each with its size, and the parameter with how many
/// times worse than usual it is known; None where the verdict says why. `fits` has χ² and degrees of freedom,
/// `devices` gives the values of one parameter after the other, of which `usual` has what is usual.
#[pyfunction]
pub fn standing_out(
    verdicts: PyReadonlyArray1<'_, i64>,
    fits: PyReadonlyArray2<'_, f64>,
    devices: &Bound<'_, PyAny>,
    usual: Vec<PyUsual>,
) -> PyResult<Vec<PyRemark>> {
    let verdicts = verdicts_of(&verdicts);
    let mut found = fleet::by_verdict(&verdicts, &pairs(&fits));
    let numbers = verdicts.len() * usual.len();
    for (k, (devices, usual)) in devices.try_iter()?.zip(usual).enumerate() {
        let devices: Vec<Known> = pairs(&devices?.extract()?);
        found.extend(fleet::by_parameter(k, &usual_of(usual), &devices, &verdicts, numbers));
    }
    fleet::sort(&mut found, &verdicts);
    let odd = |Odd { number, weak }| (number, weak);
    Ok(found.into_iter().map(|one| (one.device, one.size, one.parameter.map(odd))).collect())
}
