//! What a change of the model does to the platform, over the poses of a session.

use crate::Error;
use crate::apply::check::{Check, error_of};
use crate::apply::poses::{carried_points, some_poses};
use crate::apply::slopes::{Slopes, platform_slopes};
use crate::estimate::{Fit, Noise, Observations};
use crate::model::Model;
#[cfg(feature = "serde")]
use crate::numerics::nullable;

/// What an effect does to the platform pose, or, without a platform, to the points that chains carry, after
/// the best rigid motion: root mean square over components.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename = "Rms"))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct PlatformRms {
    /// Position, in units of length.
    #[cfg_attr(feature = "serde", serde(default = "nullable::unknown", with = "nullable"))]
    #[cfg_attr(feature = "document", schemars(!default, with = "Option<f64>"))]
    pub position: f64,
    /// Orientation, in radians; null of points.
    #[cfg_attr(feature = "serde", serde(default = "nullable::unknown", with = "nullable"))]
    #[cfg_attr(feature = "document", schemars(!default, with = "Option<f64>"))]
    pub orientation: f64,
}

impl PlatformRms {
    /// Of points: they have no orientation.
    #[must_use]
    pub fn of_points(position: f64) -> Self {
        Self { position, orientation: f64::NAN }
    }
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
        .then(|| some_poses(model, &observations.readings, beta, noise, stride))
}

/// How the platform moves with the parameters of a model, to first order.
pub(crate) struct Movable {
    /// Of the samples that count.
    slopes: Vec<Slopes>,
}

impl Movable {
    /// Of a long recording in some blocks; none without a platform.
    ///
    /// # Errors
    ///
    /// As [`Model::like`].
    pub(crate) fn new(
        observations: &Observations,
        model: &Model,
        beta: &[f64],
        noise: &Noise,
    ) -> Result<Option<Self>, Error> {
        let Observations { readings, mechanism, weights, .. } = observations;
        if mechanism.platform.is_empty() {
            return Ok(None);
        }
        let stride = readings.blocks().len().div_ceil(LOOKS);
        let mut slopes = platform_slopes(model, readings, beta, noise, stride)?;
        slopes.retain(|s| weights[s.row] > 0.0);
        Ok(Some(Self { slopes }))
    }

    /// What a change of these parameters does.
    pub(crate) fn by(&self, change: &[(usize, f64)]) -> PlatformRms {
        let mut squares = [0.0; 6];
        for Slopes { by_parameter, .. } in &self.slopes {
            let mut moved = [0.0; 6];
            for &(column, by) in change {
                let slope = by_parameter.column(column);
                moved.iter_mut().zip(&slope).for_each(|(moved, slope)| *moved += slope * by);
            }
            squares.iter_mut().zip(moved).for_each(|(sum, moved)| *sum += moved * moved);
        }
        let components = 3.0 * self.slopes.len().max(1) as f64;
        let rms = |of: &[f64]| (of.iter().sum::<f64>() / components).sqrt();
        PlatformRms { position: rms(&squares[..3]), orientation: rms(&squares[3..]) }
    }
}

/// Between two fits.
#[must_use]
pub fn platform_difference(observations: &Observations, a: &Fit, b: &Fit) -> Option<PlatformRms> {
    let pa = platform(observations, &a.model, &a.beta, &a.assumed())?;
    let pb = platform(observations, &b.model, &b.beta, &b.assumed())?;
    Some(difference(observations, &pa, &pb))
}

/// How far apart two fits of a session put the platform, or, without one, the points that chains
/// carry after the best rigid motion: root mean square by component [length unit]. Where points are
/// somewhere else in each pose, those that chains carry are not what is used: none.
#[must_use]
pub fn apart(observations: &Observations, a: &Fit, b: &Fit) -> Option<f64> {
    if let Some(difference) = platform_difference(observations, a, b) {
        return Some(difference.position);
    }
    if a.model.pose_unknowns() > 0 {
        return None;
    }
    let points = |fit: &Fit| carried_points(observations, fit, observations.readings.table.clone());
    let (a, b) = (points(a).ok()?, points(b).ok()?);
    let counts = |row: &usize| observations.weights[*row] > 0.0;
    let at = |p: [f64; 3]| [p[0], p[1], p[2], 0.0, 0.0, 0.0];
    let rows = (0..observations.readings.samples).filter(counts);
    let of_row = |row: usize| a.iter().zip(&b).map(move |(a, b)| (at(a[row]), at(b[row])));
    let pairs: Vec<_> = rows.flat_map(of_row).collect();
    (!pairs.is_empty()).then(|| error_of(&pairs, true).position_rms)
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
    PlatformRms { position: position_rms, orientation: orientation_rms.unwrap_or(f64::NAN) }
}
