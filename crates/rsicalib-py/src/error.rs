//! Core errors as Python exceptions of the same meaning.

use pyo3::prelude::*;

mod python {
    pyo3::import_exception!(rsicalib.errors, InputError);
    pyo3::import_exception!(rsicalib.errors, UndeterminedError);
}

/// Carries a core error to Python.
pub struct PyError(rsicalib::Error);

impl From<rsicalib::Error> for PyError {
    fn from(error: rsicalib::Error) -> Self {
        Self(error)
    }
}

impl From<PyError> for PyErr {
    fn from(error: PyError) -> Self {
        let message = error.0.to_string();
        match error.0 {
            rsicalib::Error::TooFew { .. } => python::UndeterminedError::new_err(message),
            _ => python::InputError::new_err(message),
        }
    }
}
