//! Fits and scans that a search has made: looking back and looking for rivals ask for the same again.

use crate::Error;
use crate::diagnosis::score::scored::Scored;
use crate::estimate::{Fit, FitOptions, Noise, Observations, fit};
use crate::model::Instance;
use crate::numerics::workers;

/// Residuals that are kept, in numbers: 32 MB.
const MOST_KEPT: usize = 1 << 22;

/// The noise and the weights of a session.
type State = (Noise, Vec<f64>);

fn state_of(small: &Observations) -> State {
    let sigma = small.options.noise.clone().unwrap_or_default();
    let FitOptions { play, seating, measured, .. } = small.options.clone();
    let measured = measured.unwrap_or_default();
    (Noise { sigma, play, seating, measured }, small.weights.clone())
}

/// Fits of one session with one noise.
#[derive(Default)]
pub(crate) struct KnownFits {
    /// The noise and the weights of the fits.
    of: Option<State>,
    fits: Vec<Fit>,
}

impl KnownFits {
    /// The fit of these instances to a session, one that is known or else one that starts at
    /// another fit.
    ///
    /// # Errors
    ///
    /// As [`fit`].
    pub fn fit(
        &mut self,
        small: &Observations,
        instances: Vec<Instance>,
        from: &Fit,
    ) -> Result<Fit, Error> {
        self.are_of(small);
        if let Some(known) = self.known(&instances) {
            return Ok(known.clone());
        }
        let new = fit(small, instances, Some(from))?;
        if self.have_room(&new, 1) {
            self.fits.push(new.clone());
        }
        Ok(new)
    }

    /// Makes fits that will be asked for, all from one other fit, on all cores. What cannot be fitted
    /// says so when it is asked for.
    pub fn prepare(
        &mut self,
        small: &Observations,
        wanted: impl Iterator<Item = Vec<Instance>>,
        from: &Fit,
    ) {
        self.are_of(small);
        let new: Vec<Vec<Instance>> =
            wanted.filter(|wanted| self.known(wanted).is_none()).collect();
        if new.len() < 2 || !self.have_room(from, new.len()) {
            return;
        }
        let fits: Vec<Option<Fit>> =
            workers::map(new, |instances| fit(small, instances, Some(from)).ok());
        self.fits.extend(fits.into_iter().flatten());
    }

    /// Fits of another session or with another noise are forgotten.
    fn are_of(&mut self, small: &Observations) {
        if self.of != Some(state_of(small)) {
            (self.of, self.fits) = (Some(state_of(small)), Vec::new());
        }
    }

    fn known(&self, instances: &[Instance]) -> Option<&Fit> {
        self.fits.iter().find(|fit| fit.model.instances == instances)
    }

    /// Whether so many more fits like this one can be kept.
    fn have_room(&self, like: &Fit, more: usize) -> bool {
        let numbers = like.residuals.whitened.len() * like.model.scales.len();
        numbers * (self.fits.len() + more) <= MOST_KEPT
    }
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
