//! What a change of the model does to the platform, over the poses of a session.

use crate::apply::check::{Check, error_of};
use crate::apply::poses::some_poses;
use crate::estimate::{Fit, Noise, Observations};
use crate::model::Model;

/// Root mean square of what an effect does to the platform, by component.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PlatformRms {
    /// Length units.
    pub position: f64,
    /// rad.
    pub orientation: f64,
}

/// Blocks of a long recording in which the platform is looked at.
const LOOKS: usize = 16;

/// Platform poses of a fit, with their rows; none without a platform.
pub type Poses = Option<Vec<(usize, [f64; 6])>>;

/// Platform poses of a model, of a long recording in some blocks.
#[must_use]
pub fn platform(observations: &Observations, model: &Model, beta: &[f64], noise: &Noise) -> Poses {
    let stride = observations.readings.blocks().len().div_ceil(LOOKS);
    (!observations.mechanism.platform.is_empty())
        .then(|| some_poses(model, &observations.readings, beta, &noise.sigma, noise.play, stride))
}

/// Between two fits.
#[must_use]
pub fn platform_difference(observations: &Observations, a: &Fit, b: &Fit) -> Option<PlatformRms> {
    let pa = platform(observations, &a.model, &a.beta, &a.assumed())?;
    let pb = platform(observations, &b.model, &b.beta, &b.assumed())?;
    Some(difference(observations, &pa, &pb))
}

/// Between two sets of poses with their rows; rows that are left out do not count.
#[must_use]
pub fn difference(
    observations: &Observations,
    a: &[(usize, [f64; 6])],
    b: &[(usize, [f64; 6])],
) -> PlatformRms {
    let counts = |row: usize| observations.weights[row] > 0.0;
    let pairs: Vec<_> =
        a.iter().zip(b).filter(|(a, _)| counts(a.0)).map(|(a, b)| (a.1, b.1)).collect();
    let Check { position_rms, orientation_rms, .. } = error_of(&pairs, false);
    PlatformRms { position: position_rms, orientation: orientation_rms }
}
