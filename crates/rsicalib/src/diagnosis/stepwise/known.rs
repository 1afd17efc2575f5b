//! Fits that a search has made: looking back and looking for rivals ask for the same again.

use crate::Error;
use crate::estimate::{Fit, Noise, Observations, fit};
use crate::model::Instance;

/// Residuals that are kept, in numbers: 32 MB.
const MOST: usize = 1 << 22;

/// Fits of one session with one noise.
#[derive(Default)]
pub(crate) struct KnownFits {
    /// The noise and the weights of the fits.
    of: Option<(Noise, Vec<f64>)>,
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
        let sigma = small.options.noise.clone().unwrap_or_default();
        let of = Some((Noise { sigma, play: small.options.play }, small.weights.clone()));
        if self.of != of {
            (self.of, self.fits) = (of, Vec::new());
        }
        if let Some(known) = self.fits.iter().find(|fit| fit.model.instances == instances) {
            return Ok(known.clone());
        }
        let new = fit(small, instances, Some(from))?;
        let numbers = small.readings.samples * new.residuals.equations * small.readings.channels;
        if numbers * (self.fits.len() + 1) <= MOST {
            self.fits.push(new.clone());
        }
        Ok(new)
    }
}
