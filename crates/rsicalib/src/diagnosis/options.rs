//! How to search.

use crate::{Error, terms};

/// How to search.
#[derive(Debug, Clone)]
pub struct SearchOptions {
    /// Probability of naming anything where nothing is missing.
    pub alpha: f64,
    /// Terms that are no candidates.
    pub without: Vec<String>,
    /// Effects to add at the most.
    pub most: usize,
    /// Candidates to refit in each step.
    pub refits: usize,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self { alpha: 0.012, without: Vec::new(), most: 8, refits: 8 }
    }
}

impl SearchOptions {
    /// Checks that the options can be used.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] for numbers that cannot, [`Error::Unknown`] where there is no such term.
    pub fn check(&self) -> Result<(), Error> {
        if !(self.alpha > 0.0 && self.alpha < 1.0) {
            return Err(Error::option("alpha", self.alpha, "a probability above 0 and below 1"));
        }
        self.without.iter().try_for_each(|id| terms::find(id).map(|_| ()))
    }
}

/// Residuals above chance at this level are not explained.
pub const RESIDUAL_LEVEL: f64 = 0.001;

/// More effects than this are a less likely story than one channel, or closure, whose law
/// nobody knows.
pub const FEW_EFFECTS: usize = 2;
