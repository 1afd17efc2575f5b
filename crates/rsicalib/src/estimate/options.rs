//! How to fit.

use crate::estimate::progress::Progress;
use crate::numerics::lm;

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
    pub play: f64,
    /// True where the noise is from an earlier fit of these readings, which has judged what
    /// was declared: nothing questions it again.
    pub settled: bool,
    /// Starts to try at the most.
    pub starts: usize,
    /// A start whose χ² per degree of freedom is below this ends the search.
    pub good_start: f64,
    /// The solver.
    pub lm: lm::SolverOptions,
    /// Who is told how far the job is.
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
            settled: false,
            starts: 40,
            good_start: 50.0,
            lm: lm::SolverOptions { xtol: 1e-10, ftol: 1e-12, ..lm::SolverOptions::default() },
            progress: Progress::default(),
        }
    }
}
