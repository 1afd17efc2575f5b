//! The verbs, as users call them.

use crate::Error;
use crate::apply::earlier::{Applied, lasting};
use crate::diagnosis::options::SearchOptions;
use crate::estimate::Observations;
use crate::estimate::directions::ParameterReport;
use crate::history::Past;
use crate::mechanism::Mechanism;
use crate::monitor::{Monitor, MonitorOptions, Quiet};
use crate::report::calibrated::{self, CalibrationReport};
use crate::report::result::Estimates;
use crate::report::trace_report::TraceReport;
use crate::report::traced;
use crate::report::update::Update;

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

/// Calibrates a later session of a device, and compares it with an earlier result: what has changed
/// between them, and whether the later result is worth to take its place. Where the options say no terms, these are
/// those of the earlier result that outlast its session.
///
/// # Errors
///
/// As [`calibrate`], and as [`Monitor::of`] for an earlier result that is compared with.
pub fn update(
    observations: &Observations,
    earlier: &impl AsRef<Estimates>,
) -> Result<(CalibrationReport, Update), Error> {
    let (applied, covariance) = earlier.as_ref().applied();
    let mut later = observations.clone();
    if later.options.terms.is_none() {
        let specs = applied.parameters.iter().map(|p| &p.spec);
        let terms = lasting(&observations.mechanism, specs)?;
        later.options.terms = Some(terms.iter().map(ToString::to_string).collect());
        later.leave_offsets_as_drawn(&later.instances()?);
    }
    let (report, calibrated) = calibrated::report(&later, None)?;
    let rms = report.fit.held_out.map(|held_out| held_out.rms_misclosure);
    let later = (&calibrated.observations, &calibrated.fit);
    let update = Update::since(&applied, Some(&covariance), later, rms)?;
    Ok((report, update))
}

impl Monitor {
    /// A watch over a mechanism under a result of [`calibrate`] or [`trace`]: what its session says of
    /// its noise takes the place of `options.quiet`.
    ///
    /// # Errors
    ///
    /// As [`Monitor::new`].
    pub fn of(
        mechanism: &Mechanism,
        found: &impl AsRef<Estimates>,
        options: &MonitorOptions,
    ) -> Result<Self, Error> {
        let found = found.as_ref();
        let (applied, covariance) = found.applied();
        let quiet = Quiet {
            dof: found.misclosure.dof,
            correlation: found.misclosure.correlation,
            interval: found.misclosure.interval_s,
        };
        let options = MonitorOptions { quiet, ..options.clone() };
        Self::new(mechanism, &applied, &covariance, &options)
    }
}

impl Past {
    /// A parameter in a result that holds from this day on; none where the result does not know it.
    #[must_use]
    pub fn of(day: f64, parameter: &ParameterReport) -> Option<Self> {
        let sd = parameter.sd.filter(|_| parameter.value.is_finite())?;
        Some(Self { day, value: parameter.value, sd })
    }
}

impl AsRef<Estimates> for CalibrationReport {
    fn as_ref(&self) -> &Estimates {
        &self.estimates
    }
}

impl AsRef<Estimates> for TraceReport {
    fn as_ref(&self) -> &Estimates {
        &self.estimates
    }
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
