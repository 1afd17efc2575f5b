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
        Self { alpha: OVERSTATED * LEVEL, without: Vec::new(), most: 8, refits: 8 }
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

/// Share of clean sessions that are called otherwise than adequate, search and judgement together;
/// and the level at which known poses, which are judged beside them, contradict a calibration.
pub const CLEAN: f64 = 0.01;

/// What is less probable than this by chance is significant: the residual, and the error on poses
/// left out in turn. A session is looked at three times, these and the search, and each look has
/// its share of [`CLEAN`].
pub const LEVEL: f64 = CLEAN / 3.0;

/// The search charges for all candidates that it looks at as if they were independent, and names
/// something in a clean session so many times less often than that sum says:
/// `python -m tests.clean`, docs/limits.md.
const OVERSTATED: f64 = 2.0;

/// More effects than this are a less likely story than one channel, or closure, whose law
/// nobody knows.
pub const FEW_EFFECTS: usize = 2;
