//! Options of a fit, and what is expected of its parameters, as Python gives them.

use pyo3::prelude::*;
use rsicalib::Error;
use rsicalib::estimate::{Expectation, Expected, FitOptions, Method};
use rsicalib::model::Spec;

use crate::error::PyError;

/// Options of a fit by their names in Python; what is not given is as in Rust.
pub fn fit_options(
    terms: Option<Vec<String>>,
    closures: Option<Vec<String>>,
    method: Option<&str>,
    noise: Option<Vec<f64>>,
) -> Result<FitOptions, PyError> {
    let method = match method {
        None | Some("implicit_loop") => Method::ImplicitLoop,
        Some("algebraic") => Method::Algebraic,
        Some(other) => {
            return Err(Error::option("method", other, "implicit_loop or algebraic").into());
        }
    };
    Ok(FitOptions { terms, closures, noise, method, ..FitOptions::default() })
}

/// Term, target, name, mean and standard deviation of what is expected of a parameter.
type PyExpectation = (String, Option<String>, Option<String>, f64, f64);

/// What is expected of parameters, and the readings at which offsets are meant.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PyExpected {
    centre: Vec<f64>,
    parameters: Vec<PyExpectation>,
}

impl From<PyExpected> for Expected {
    fn from(given: PyExpected) -> Self {
        let of = |(term, target, name, mean, sd)| {
            let spec = Spec { term, target, place: None };
            Expectation { spec, name, mean, sd }
        };
        let parameters = given.parameters.into_iter().map(of).collect();
        Self { centre: given.centre, parameters }
    }
}
