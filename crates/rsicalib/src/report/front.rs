//! The two verbs, as users call them.

use crate::Error;
use crate::apply::earlier::Applied;
use crate::diagnosis::options::SearchOptions;
use crate::estimate::Observations;
use crate::report::calibrated::{self, CalibrationReport};
use crate::report::traced::{self, TraceReport};

/// Estimates the parameters of the terms that are asked for, and judges what is left.
///
/// # Errors
///
/// [`Error::TooFew`] for fewer equations than parameters, else as [`Observations::new`].
pub fn calibrate(observations: &Observations) -> Result<CalibrationReport, Error> {
    Ok(calibrated::report(observations, None)?.0)
}

/// Calibrates, and searches for the effects that explain a residual above the noise.
///
/// # Errors
///
/// As [`calibrate`], and [`Error::Option`] for options that cannot be used.
pub fn trace(observations: &Observations, options: &SearchOptions) -> Result<TraceReport, Error> {
    traced::report(observations, options, None)
}

impl From<&CalibrationReport> for Applied {
    fn from(found: &CalibrationReport) -> Self {
        Self::from(&found.estimates)
    }
}

impl From<&TraceReport> for Applied {
    fn from(found: &TraceReport) -> Self {
        Self::from(&found.estimates)
    }
}
