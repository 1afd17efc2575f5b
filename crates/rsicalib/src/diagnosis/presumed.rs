//! Noise that was presumed of readings, beside play that is declared.
//!
//! Where closures declare their play and nobody spoke of the readings, these are presumed to have little noise, so that
//! effects show. More that is left is an effect, or that noise: its variance between poses, of all channels alike, has
//! a likelihood by (75), as has that of one channel.

use crate::diagnosis::options::LEVEL;
use crate::diagnosis::search::noise::scatter;
use crate::estimate::noise::source::Source;
use crate::estimate::{Fit, Observations};
use crate::numerics::credible_set::AS_WELL;

/// True where more is left of a fit than the presumed noise allows.
pub(crate) fn leaves_more(fit: &Fit) -> bool {
    fit.noise.source == Source::Presumed && fit.p_value.is_some_and(|p| p <= LEVEL)
}

/// True where noise of all readings explains what is left of a fit about as well as scatter of any one channel, and
/// as what else explains it by so much.
pub(crate) fn is_noise(observations: &Observations, fit: &Fit, other: f64) -> bool {
    let channels: Vec<usize> = (0..observations.mechanism.channels.len()).collect();
    let all = scatter(observations, fit, &channels);
    let best = channels.iter().map(|&c| scatter(observations, fit, &[c])).fold(other, f64::max);
    all + AS_WELL > best
}
