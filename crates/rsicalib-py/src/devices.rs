//! Many devices at once.

use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use pythonize::pythonize;
use rsicalib::diagnosis::options::SearchOptions;
use rsicalib::diagnosis::verdict::{Evidence, judge};
use rsicalib::estimate::progress::Progress;
use rsicalib::estimate::{FitOptions, Observations};
use rsicalib::mechanism::Mechanism;
use rsicalib::readings::Table;
use rsicalib::report::device::{DeviceOptions, DeviceReport, report};

use crate::mechanism::PyMechanism;
use crate::options::fit_options;
use crate::tables::PyTable;
use crate::threads::work;

/// Readings of one device: a table, and readings of its rest pose.
type Readings = (Table, Option<Vec<f64>>);

/// Why a device has no report.
#[derive(Default)]
struct Refused {
    verdict: Option<&'static str>,
    message: String,
    ended: bool,
}

type Outcome = Result<DeviceReport, Refused>;

/// Calibrates devices one after the other, column by column in the order of the tables.
///
/// `rests` holds readings of the rest pose, shape (n, C), or None, for each table. A device that
/// cannot be calibrated has a message and no numbers; one that takes longer than `time_limit` [s] is
/// `ended`, with its calibration where only the trace took longer.
#[pyfunction]
#[pyo3(signature = (mechanism, tables, rests, *, terms=None, closures=None, noise=None,
                    trace=true, held_out=false, time_limit=None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn calibrate_devices<'py>(
    py: Python<'py>,
    mechanism: &PyMechanism,
    tables: Vec<PyTable<'py>>,
    rests: Vec<Option<PyReadonlyArray2<'py, f64>>>,
    terms: Option<Vec<String>>,
    closures: Option<Vec<String>>,
    noise: Option<Vec<f64>>,
    trace: bool,
    held_out: bool,
    time_limit: Option<f64>,
) -> PyResult<Bound<'py, PyDict>> {
    let rest = |rest: &Option<PyReadonlyArray2<'_, f64>>| {
        rest.as_ref().map(|r| r.as_array().iter().copied().collect())
    };
    let readings: Vec<Readings> =
        tables.iter().zip(&rests).map(|(t, r)| (t.table(), rest(r))).collect();
    let fit = fit_options(terms, closures, None, noise)?;
    let options = DeviceOptions { trace: trace.then(SearchOptions::default), held_out };
    let mechanism = mechanism.0.clone();
    let limit = time_limit.map(Duration::from_secs_f64);
    let found: Vec<Outcome> = work(py, || {
        let one = |readings| {
            let progress = limit.map(until).unwrap_or_default();
            calibrate(&mechanism, readings, &FitOptions { progress, ..fit.clone() }, &options)
        };
        readings.into_iter().map(one).collect()
    })?;
    columns(py, &found, held_out)
}

/// Ends a job that takes longer than `limit` from now.
fn until(limit: Duration) -> Progress {
    let begun = Instant::now();
    Progress::heard_by(move |_, _| match begun.elapsed() < limit {
        true => ControlFlow::Continue(()),
        false => ControlFlow::Break(()),
    })
}

/// One device. A panic of the core is its own, and the others are calibrated all the same.
fn calibrate(
    mechanism: &Mechanism,
    (table, rest): Readings,
    fit: &FitOptions,
    options: &DeviceOptions,
) -> Outcome {
    let job = || report(&Observations::new(mechanism, table, rest, fit.clone())?, options);
    let defect = || Refused {
        message: "a defect of rsicalib; please report it".into(),
        ..Refused::default()
    };
    let error = match catch_unwind(AssertUnwindSafe(job)).map_err(|_| defect())? {
        Ok(report) => return Ok(report),
        Err(error) => error,
    };
    let few = matches!(error, rsicalib::Error::TooFew { .. });
    Err(Refused {
        verdict: few.then(|| judge(&Evidence::default()).verdict.id()),
        message: error.to_string(),
        ended: matches!(error, rsicalib::Error::Ended),
    })
}

fn columns<'py>(
    py: Python<'py>,
    found: &[Outcome],
    held_out: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let verdict = |one: &Outcome| one.as_ref().map_or_else(|e| e.verdict, |r| Some(r.verdict.id()));
    let message = |one: &Outcome| one.as_ref().map_or_else(|e| &e.message, |r| &r.message).clone();
    let ended = |one: &Outcome| one.as_ref().map_or_else(|e| e.ended, |r| r.ended);
    out.set_item("verdict", found.iter().map(verdict).collect::<Vec<_>>())?;
    out.set_item("message", found.iter().map(message).collect::<Vec<_>>())?;
    out.set_item("ended", found.iter().map(ended).collect::<Vec<_>>())?;
    let numbers = |name: &str, of: &dyn Fn(&DeviceReport) -> Option<f64>| {
        let of = |one: &Outcome| one.as_ref().ok().and_then(of).filter(|v| v.is_finite());
        out.set_item(name, found.iter().map(of).collect::<Vec<_>>())
    };
    numbers("chi2", &|r| r.fit.chi2)?;
    numbers("dof", &|r| r.fit.dof)?;
    numbers("p_value", &|r| r.fit.p_value)?;
    numbers("rms_misclosure", &|r| r.fit.rms_misclosure)?;
    if held_out {
        numbers("held_out_chi2_per_dof", &|r| r.fit.held_out.map(|h| h.chi2_per_dof))?;
        numbers("held_out_rms_misclosure", &|r| r.fit.held_out.map(|h| h.rms_misclosure))?;
    }
    for (name, values) in parameters(found) {
        out.set_item(&name, values.iter().map(|v| v.0).collect::<Vec<_>>())?;
        out.set_item(format!("{name}_sd"), values.iter().map(|v| v.1).collect::<Vec<_>>())?;
    }
    let steps = found.iter().map(|one| match one {
        Ok(report) => Ok(pythonize(py, &report.steps)?),
        Err(_) => Ok(pythonize(py, &[(); 0])?),
    });
    out.set_item("steps", steps.collect::<PyResult<Vec<_>>>()?)?;
    Ok(out)
}

/// Value and standard deviation of one parameter of each device.
type Values = Vec<(Option<f64>, Option<f64>)>;

/// Every parameter that any device has, in the order of the first that has it.
fn parameters(found: &[Outcome]) -> Vec<(String, Values)> {
    let mut all: Vec<(String, Values)> = Vec::new();
    for (row, report) in found.iter().enumerate() {
        for (k, p) in report.iter().flat_map(|r| &r.parameters).enumerate() {
            let spec = p.spec();
            let name =
                if p.name == p.term { spec.to_string() } else { format!("{spec}.{}", p.name) };
            // Devices have the same parameters as a rule, in the same order.
            let same = all.get(k).is_some_and(|(known, _)| *known == name);
            let at = if same { Some(k) } else { all.iter().position(|(known, _)| *known == name) };
            let at = at.unwrap_or_else(|| {
                all.push((name, vec![(None, None); found.len()]));
                all.len() - 1
            });
            all[at].1[row] = (Some(p.value).filter(|v| v.is_finite()), p.sd);
        }
    }
    all
}
