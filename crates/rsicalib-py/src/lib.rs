//! Python bindings: conversions only.

mod apply;
mod design;
mod devices;
mod documents;
mod error;
mod experiments;
mod history;
mod mechanism;
mod monitor;
mod numbers;
mod observations;
mod options;
mod population;
mod raw;
mod tables;
mod threads;

use pyo3::PyClass;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use rsicalib::design::exchange::CRITERIA;
use rsicalib::design::identifiability::COMPLETE;
use rsicalib::design::observability::SCALINGS;
use rsicalib::design::plan::MARGIN;
use rsicalib::diagnosis::verdict::Verdict;
use rsicalib::model::UNKNOWN_THINGS;
use rsicalib::monitor::MonitorOptions;

/// The compiled core of rsicalib.
#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    let verdicts: Vec<(&str, u8)> = Verdict::ALL.iter().map(|v| (v.id(), v.exit_code())).collect();
    module.add("VERDICTS", verdicts)?;
    module.add("COMPLETE", PyTuple::new(module.py(), COMPLETE)?)?;
    module.add("UNKNOWN_THINGS", PyTuple::new(module.py(), UNKNOWN_THINGS)?)?;
    module.add("CRITERIA", PyTuple::new(module.py(), CRITERIA.map(|c| c.0))?)?;
    module.add("MARGIN", MARGIN)?;
    module.add("LARGEST", rsicalib::numerics::bounds::LARGEST)?;
    module.add("FALSE_ALARMS", MonitorOptions::default().false_alarms)?;
    module.add("SCALINGS", PyTuple::new(module.py(), SCALINGS.map(|s| s.0))?)?;
    add_class::<mechanism::PyMechanism>(module)?;
    add_class::<mechanism::PyChannel>(module)?;
    add_class::<mechanism::PyTerm>(module)?;
    add_class::<observations::PyObservations>(module)?;
    add_class::<observations::PyFit>(module)?;
    add_class::<observations::PyEvidenceSource>(module)?;
    add_class::<monitor::PyMonitor>(module)?;
    add_class::<apply::PyPlacer>(module)?;
    module.add_function(wrap_pyfunction!(documents::read_result, module)?)?;
    module.add_function(wrap_pyfunction!(documents::certify, module)?)?;
    module.add_function(wrap_pyfunction!(documents::schemas, module)?)?;
    module.add_function(wrap_pyfunction!(documents::mechanism_schema, module)?)?;
    module.add_function(wrap_pyfunction!(documents::evidence_schema, module)?)?;
    module.add_function(wrap_pyfunction!(documents::written_keys, module)?)?;
    module.add_function(wrap_pyfunction!(mechanism::terms, module)?)?;
    module.add_function(wrap_pyfunction!(mechanism::rules, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::angles_at, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::minimize, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::misclosure, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::jacobian, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::observability, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::readings_at, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::within_limits, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::means_of_samples, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::bound, module)?)?;
    module.add_function(wrap_pyfunction!(design::identifiable, module)?)?;
    module.add_function(wrap_pyfunction!(devices::calibrate_devices, module)?)?;
    module.add_function(wrap_pyfunction!(design::plan, module)?)?;
    module.add_function(wrap_pyfunction!(design::further, module)?)?;
    module.add_function(wrap_pyfunction!(design::bound_at, module)?)?;
    module.add_function(wrap_pyfunction!(design::workspace, module)?)?;
    module.add_function(wrap_pyfunction!(design::traceable, module)?)?;
    module.add_function(wrap_pyfunction!(design::needed_poses, module)?)?;
    module.add_function(wrap_pyfunction!(design::guided_done, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::rsi_angles, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::rsi_poses, module)?)?;
    module.add_function(wrap_pyfunction!(apply::declared, module)?)?;
    module.add_function(wrap_pyfunction!(apply::places, module)?)?;
    module.add_function(wrap_pyfunction!(apply::exported, module)?)?;
    module.add_function(wrap_pyfunction!(apply::calibrated_sensors, module)?)?;
    module.add_function(wrap_pyfunction!(apply::lasting, module)?)?;
    module.add_function(wrap_pyfunction!(apply::spec, module)?)?;
    module.add_function(wrap_pyfunction!(apply::compared, module)?)?;
    module.add_function(wrap_pyfunction!(apply::unit_of_key, module)?)?;
    module.add_function(wrap_pyfunction!(apply::units_of, module)?)?;
    module.add_function(wrap_pyfunction!(apply::fixture, module)?)?;
    module.add_function(wrap_pyfunction!(apply::judged_open_loop, module)?)?;
    module.add_function(wrap_pyfunction!(raw::suspects, module)?)?;
    module.add_function(wrap_pyfunction!(raw::unlabelled, module)?)?;
    module.add_function(wrap_pyfunction!(raw::still_stretches, module)?)?;
    module.add_function(wrap_pyfunction!(apply::check, module)?)?;
    module.add_function(wrap_pyfunction!(monitor::open_loops, module)?)?;
    module.add_function(wrap_pyfunction!(monitor::expects_more, module)?)?;
    module.add_function(wrap_pyfunction!(monitor::rms_misclosure, module)?)?;
    module.add_function(wrap_pyfunction!(history::history, module)?)?;
    module.add_function(wrap_pyfunction!(population::centre_of_population, module)?)?;
    module.add_function(wrap_pyfunction!(population::shares, module)?)?;
    module.add_function(wrap_pyfunction!(population::population, module)?)?;
    module.add_function(wrap_pyfunction!(population::beyond_chance, module)?)?;
    module.add_function(wrap_pyfunction!(population::summed, module)?)?;
    module.add_function(wrap_pyfunction!(population::common_shifts, module)?)?;
    module.add_function(wrap_pyfunction!(population::usual, module)?)?;
    module.add_function(wrap_pyfunction!(population::distances, module)?)?;
    module.add_function(wrap_pyfunction!(population::standing_out, module)?)?;
    module.add_function(wrap_pyfunction!(numbers::plain_numbers, module)?)?;
    Ok(())
}

/// Adds a class whose values lie where Python's allocator puts an object.
///
/// Python aligns an object to two words, whatever its fields ask for: a value of more alignment, as
/// one with vector lanes in it, lies wrong in memory, and its aligned loads end the process. Such a
/// field is boxed.
fn add_class<T: PyClass>(module: &Bound<'_, PyModule>) -> PyResult<()> {
    const { assert!(align_of::<T>() <= 2 * size_of::<usize>(), "box the field with vector lanes") };
    module.add_class::<T>()
}
