//! Python bindings: conversions only.

mod apply;
mod error;
mod experiments;
mod faults;
mod linear;
mod mechanism;
mod observations;

use pyo3::prelude::*;
use rsicalib::diagnosis::verdict::Verdict;

/// The compiled core of rsicalib.
#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("WORSE", rsicalib::diagnosis::verdict::WORSE)?;
    module.add("RESIDUAL_LEVEL", rsicalib::diagnosis::options::RESIDUAL_LEVEL)?;
    let verdicts: Vec<(&str, u8)> = Verdict::ALL.iter().map(|v| (v.id(), v.exit_code())).collect();
    module.add("VERDICTS", verdicts)?;
    module.add_class::<mechanism::PyMechanism>()?;
    module.add_class::<mechanism::PyChannel>()?;
    module.add_class::<observations::PyObservations>()?;
    module.add_class::<observations::PyFit>()?;
    module.add_function(wrap_pyfunction!(mechanism::terms, module)?)?;
    module.add_function(wrap_pyfunction!(mechanism::rsi_inverse, module)?)?;
    module.add_function(wrap_pyfunction!(mechanism::rsi_forward, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::minimize, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::misclosure, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::jacobian, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::observability, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::readings_at, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::bound, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::exchange, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::rsi_angles, module)?)?;
    module.add_function(wrap_pyfunction!(experiments::rsi_poses, module)?)?;
    module.add_function(wrap_pyfunction!(apply::forward, module)?)?;
    module.add_function(wrap_pyfunction!(apply::points, module)?)?;
    module.add_function(wrap_pyfunction!(apply::fixture, module)?)?;
    module.add_function(wrap_pyfunction!(faults::faults, module)?)?;
    module.add_function(wrap_pyfunction!(linear::linearize, module)?)?;
    module.add_function(wrap_pyfunction!(apply::check, module)?)?;
    Ok(())
}
