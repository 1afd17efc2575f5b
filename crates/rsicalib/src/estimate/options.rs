//! How to fit.

use crate::Error;
use crate::estimate::expected::Expected;
use crate::estimate::progress::Progress;
use crate::numerics::lm;
use crate::text::brief;

/// Which objective.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Maximum likelihood, noise in the readings.
    #[default]
    ImplicitLoop,
    /// The paper's least squares, noise in the misclosure.
    Algebraic,
}

/// How to fit.
#[derive(Debug, Clone)]
pub struct FitOptions {
    /// Terms to identify; none: as the mechanism says.
    pub terms: Option<Vec<String>>,
    /// Only these closures.
    pub closures: Option<Vec<String>>,
    /// The objective.
    pub method: Method,
    /// Standard deviation of one reading of each channel, where it is known.
    pub noise: Option<Vec<f64>>,
    /// Multiplies the variance of the play that the mechanism declares.
    #[doc(hidden)]
    pub play: f64,
    /// Variance of the seating of each closure of a sample that declares none, as an earlier fit has
    /// found it, length units squared; empty where these are exact.
    #[doc(hidden)]
    pub seating: Vec<f64>,
    /// Closures whose noise is drawn for each sample, as `Observations::measured` finds them; `None`:
    /// as the readings show it.
    #[doc(hidden)]
    pub measured: Option<Vec<f64>>,
    /// What is expected of parameters before any reading, in place of the drawing's `sd`.
    #[doc(hidden)]
    pub expected: Option<Expected>,
    /// Starts to try at the most.
    pub starts: usize,
    /// A start whose χ² per degree of freedom is below this ends the search.
    pub good_start: f64,
    /// The solver.
    #[doc(hidden)]
    pub lm: lm::SolverOptions,
    /// Who is told how far the job is.
    #[doc(hidden)]
    pub progress: Progress,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            terms: None,
            closures: None,
            method: Method::default(),
            noise: None,
            play: 1.0,
            seating: Vec::new(),
            measured: None,
            expected: None,
            starts: 40,
            good_start: 50.0,
            lm: lm::SolverOptions { xtol: 1e-10, ftol: 1e-12, ..lm::SolverOptions::default() },
            progress: Progress::default(),
        }
    }
}

/// More starts than this are no better than other starting values.
const MOST_STARTS: usize = 100_000;

impl FitOptions {
    /// Checks that the options can be used for a mechanism of so many channels.
    pub(crate) fn check_for(&self, channels: usize) -> Result<(), Error> {
        self.check()?;
        match self.noise.as_ref().map(Vec::len).filter(|found| *found != channels) {
            Some(found) => {
                let expected = format!("one for each of {channels} channels");
                Err(Error::option("noise", format!("{found} numbers"), expected))
            }
            None => Ok(()),
        }
    }

    /// Checks that the options can be used.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] with the first that cannot.
    pub fn check(&self) -> Result<(), Error> {
        if self.closures.as_ref().is_some_and(Vec::is_empty) {
            return Err(Error::option("closures", "none", "at least one, or no such option"));
        }
        let unusable = |sigma: &&f64| !(sigma.is_finite() && **sigma > 0.0);
        if let Some(sigma) = self.noise.iter().flatten().find(unusable) {
            return Err(Error::option("noise", brief(*sigma), "numbers above 0"));
        }
        if !(self.play.is_finite() && self.play >= 0.0) {
            return Err(Error::option("play", brief(self.play), "a number, 0 or more"));
        }
        if !(1..=MOST_STARTS).contains(&self.starts) {
            let expected = format!("1 to {MOST_STARTS}");
            return Err(Error::option("starts", self.starts, expected));
        }
        for of in self.expected.iter().flat_map(|expected| &expected.parameters) {
            if !(of.mean.is_finite() && of.sd.is_finite() && of.sd > 0.0) {
                let found = format!("{} = {} ± {}", of.spec, of.mean, of.sd);
                return Err(Error::option("population", found, "a number and an sd above 0"));
            }
        }
        if self.lm.max_iterations == 0 {
            return Err(Error::option("max_iterations", 0, "at least 1"));
        }
        for (name, value) in [("xtol", self.lm.xtol), ("ftol", self.lm.ftol)] {
            if !(value > 0.0 && value < 1.0) {
                return Err(Error::option(name, brief(value), "a number above 0 and below 1"));
            }
        }
        Ok(())
    }
}
