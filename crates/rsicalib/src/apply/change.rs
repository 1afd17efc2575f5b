//! What a change of the model does to the platform, over the poses of a session.

use nalgebra::{DVector, Matrix3, Vector3};

use crate::Error;
use crate::apply::check::{Check, error_of};
use crate::apply::poses::{carried_points, some_poses};
use crate::apply::slopes::{Slopes, carried_slopes, platform_slopes};
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

/// How the platform, or without one the points that chains carry, move with the parameters of a model, to first order.
pub(crate) struct Movable {
    /// Of the samples that count.
    slopes: Vec<Slopes>,
    /// Where these points are, sample by sample; none of a platform.
    points: Vec<Vector3<f64>>,
}

impl Movable {
    /// Of a long recording in some blocks. None where neither is there, and where points are somewhere else in each pose.
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
        let stride = readings.blocks().len().div_ceil(LOOKS);
        let carried = mechanism.points.iter().any(|point| point.chain.is_some());
        let mut slopes = if !mechanism.platform.is_empty() {
            platform_slopes(model, readings, beta, noise, stride)?
        } else if carried && model.pose_unknowns() == 0 {
            carried_slopes(model, readings, beta, stride)?
        } else {
            return Ok(None);
        };
        slopes.retain(|s| weights[s.row] > 0.0);
        let points = slopes.iter().flat_map(|s| s.points.iter().copied()).collect();
        Ok(Some(Self { slopes, points }))
    }

    /// What a change of these parameters does.
    pub(crate) fn by(&self, change: &[(usize, f64)]) -> PlatformRms {
        let moved: Vec<DVector<f64>> = self.slopes.iter().map(|s| s.moved(change)).collect();
        let points = &self.points;
        if !points.is_empty() {
            let moved = moved.iter().flat_map(|all| all.as_slice().chunks_exact(3));
            let mut moved: Vec<_> = moved.map(Vector3::from_column_slice).collect();
            remove_motion(points, &mut moved);
            let square: f64 = moved.iter().map(Vector3::norm_squared).sum();
            return PlatformRms::of_points((square / (3 * points.len()).max(1) as f64).sqrt());
        }
        let components = 3.0 * self.slopes.len().max(1) as f64;
        let rms = |of: std::ops::Range<usize>| {
            let square = |all: &DVector<f64>| of.clone().map(|i| all[i].powi(2)).sum::<f64>();
            (moved.iter().map(square).sum::<f64>() / components).sqrt()
        };
        PlatformRms { position: rms(0..3), orientation: rms(3..6) }
    }
}

/// Takes from small displacements the rigid motion that is next to them, `t + w × p`.
fn remove_motion(points: &[Vector3<f64>], moved: &mut [Vector3<f64>]) {
    let count = points.len().max(1) as f64;
    let mean = points.iter().sum::<Vector3<f64>>() / count;
    let shift = moved.iter().sum::<Vector3<f64>>() / count;
    moved.iter_mut().for_each(|by| *by -= shift);
    let (mut square, mut pull) = (Matrix3::zeros(), Vector3::zeros());
    for (at, by) in points.iter().zip(&*moved) {
        let r = at - mean;
        square += Matrix3::identity() * r.norm_squared() - r * r.transpose();
        pull += r.cross(by);
    }
    // Points of one line turn about that line without a trace.
    let turn = square.pseudo_inverse(FLAT * square.norm()).map_or(Vector3::zeros(), |i| i * pull);
    points.iter().zip(moved).for_each(|(at, by)| *by -= turn.cross(&(at - mean)));
}

/// Part of the largest moment of inertia below which there is none: rounding of points of one line.
const FLAT: f64 = 1e-12;

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
