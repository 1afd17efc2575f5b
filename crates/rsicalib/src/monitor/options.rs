//! What a watch is told beside the calibration.

use crate::Error;

/// Options of a watch.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct MonitorOptions {
    /// Expected number of false alarms per sample.
    pub false_alarms: f64,
    /// What the session of the calibration says of its noise.
    pub quiet: Quiet,
}

/// Reference statistics of the misclosure: how the loops of a calibrated device close.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quiet {
    /// Degrees of freedom of the estimated noise; none where it was declared.
    pub dof: Option<f64>,
    /// Correlation of neighbouring samples.
    pub correlation: f64,
    /// Time between neighbouring samples (s), where it is known.
    pub interval: Option<f64>,
}

impl Default for Quiet {
    fn default() -> Self {
        Self { dof: None, correlation: 0.0, interval: None }
    }
}

impl Default for MonitorOptions {
    fn default() -> Self {
        Self { false_alarms: 1e-5, quiet: Quiet::default() }
    }
}

impl MonitorOptions {
    /// Refuses options of which no watch can be made.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] with what was found and what was expected.
    pub(crate) fn check(&self) -> Result<(), Error> {
        let refuse = |name, found: f64, expected: &str| Err(Error::option(name, found, expected));
        let Quiet { dof, correlation, interval } = self.quiet;
        if self.false_alarms.is_nan() || self.false_alarms <= 0.0 || self.false_alarms > 0.01 {
            return refuse("false_alarms", self.false_alarms, "a rate per sample in (0, 0.01]");
        }
        if correlation.is_nan() || correlation.abs() >= 1.0 {
            return refuse("correlation", correlation, "a number in (-1, 1)");
        }
        if let Some(bad) = dof.filter(|d| d.is_nan() || *d <= 0.0) {
            return refuse("dof", bad, "a number above zero");
        }
        if let Some(bad) = interval.filter(|s| !s.is_finite() || *s <= 0.0) {
            return refuse("interval", bad, "seconds, above zero");
        }
        Ok(())
    }
}
