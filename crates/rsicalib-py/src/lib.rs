//! Python bindings: conversions only.

mod error;
mod mechanism;
mod session;

use pyo3::prelude::*;

/// The compiled core of rsicalib.
#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<mechanism::PyMechanism>()?;
    module.add_class::<session::PySession>()?;
    module.add_class::<session::PyFit>()?;
    module.add_function(wrap_pyfunction!(mechanism::terms, module)?)?;
    module.add_function(wrap_pyfunction!(mechanism::rsi_inverse, module)?)?;
    module.add_function(wrap_pyfunction!(mechanism::rsi_forward, module)?)?;
    Ok(())
}
