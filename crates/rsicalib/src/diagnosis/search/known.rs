//! Scores at fits that a search has made: answers ask for the same again.

use crate::Error;
use crate::diagnosis::score::scored::Scored;
use crate::estimate::{Fit, FitOptions, Noise, Observations};
use crate::model::Instance;

/// The noise and the weights of a session.
type State = (Noise, Vec<f64>);

fn state_of(small: &Observations) -> State {
    let sigma = small.options.noise.clone().unwrap_or_default();
    let FitOptions { play, seating, measured, .. } = small.options.clone();
    let measured = measured.unwrap_or_default();
    (Noise { sigma, play, seating, measured }, small.weights.clone())
}

/// Scores that are kept, in numbers: of about 100 bytes each.
const MOST_SCORES: usize = 1 << 18;

/// A scan, and the fit at which it was made.
struct Scan {
    of: State,
    instances: Vec<Instance>,
    beta: Vec<f64>,
    scored: Vec<Scored>,
}

/// Scans of one session.
#[derive(Default)]
pub(crate) struct KnownScans(Vec<Scan>);

impl KnownScans {
    /// The scan of a session at a fit, one that is known or else a new one.
    ///
    /// # Errors
    ///
    /// As of the new one.
    pub fn scan(
        &mut self,
        small: &Observations,
        fit: &Fit,
        new: impl FnOnce() -> Result<Vec<Scored>, Error>,
    ) -> Result<Vec<Scored>, Error> {
        let of = state_of(small);
        let same =
            |it: &&Scan| it.of == of && it.beta == fit.beta && it.instances == fit.model.instances;
        if let Some(known) = self.0.iter().find(same) {
            return Ok(known.scored.clone());
        }
        let scored = new()?;
        let kept: usize = self.0.iter().map(|it| it.scored.len()).sum();
        if kept + scored.len() <= MOST_SCORES {
            let (instances, beta) = (fit.model.instances.clone(), fit.beta.clone());
            self.0.push(Scan { of, instances, beta, scored: scored.clone() });
        }
        Ok(scored)
    }
}
