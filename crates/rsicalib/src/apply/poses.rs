//! Platform poses and carried points under a fit.

use nalgebra::Vector3;

use crate::Error;
use crate::estimate::settle::settled;
use crate::estimate::{Fit, Noise, Observations, Part};
use crate::kinematics::rigid::rigid_fit;
use crate::mechanism::Mechanism;
use crate::model::{Model, Want, Workspace};
use crate::numerics::lanes::{Lanes, Vec3};
use crate::readings::{Readings, Table};

/// Platform pose of every row of a table, under parameters of a fit.
///
/// Each reading is first moved onto the closures, as far as its noise allows;
/// the platform is then the rigid fit to its points.
///
/// # Errors
///
/// [`Error::Missing`] without a platform, else as [`Readings::new`].
pub fn platform_poses(
    observations: &Observations,
    fit: &Fit,
    beta: &[f64],
    table: Table,
) -> Result<Vec<[f64; 6]>, Error> {
    let mechanism = &observations.mechanism;
    if mechanism.platform.is_empty() {
        let why = "poses need the points that carry it";
        return Err(Error::missing(&mechanism.name, "platform", why));
    }
    let readings = Readings::beside(mechanism, table, &observations.readings)?;
    let model = Model::like(&fit.model, mechanism, &readings)?;
    Ok(poses_of(&model, &readings, beta, &fit.noise.of_one_reading()))
}

/// An angle between half a turn back and half a turn ahead.
pub(crate) fn short_way(angle: f64) -> f64 {
    let turn = 2.0 * std::f64::consts::PI;
    (angle + 0.5 * turn).rem_euclid(turn) - 0.5 * turn
}

/// Platform poses of readings that a model already knows.
#[must_use]
pub fn poses_of(model: &Model, readings: &Readings, beta: &[f64], noise: &Noise) -> Vec<[f64; 6]> {
    let mut poses = vec![[f64::NAN; 6]; readings.samples];
    for (row, pose) in some_poses(model, readings, beta, noise, 1) {
        poses[row] = pose;
    }
    poses
}

/// Platform poses of every `stride`-th block of readings, with their rows.
#[must_use]
pub fn some_poses(
    model: &Model,
    readings: &Readings,
    beta: &[f64],
    noise: &Noise,
    stride: usize,
) -> Vec<(usize, [f64; 6])> {
    let mut poses = Vec::with_capacity(readings.samples / stride + 1);
    let mut ws = Workspace::default();
    let platform = Platform::of(&model.mechanism);
    for (block, a) in settled_blocks(model, readings, beta, noise, stride) {
        model.evaluate(readings, block, &a, beta, Want { x: false, a: false }, &mut ws);
        let points = model.points(&ws, beta);
        let meta = &readings.blocks()[block];
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            let place = |at: Vec3| Vector3::new(at[0].0[lane], at[1].0[lane], at[2].0[lane]);
            let r: Vec<Vector3<f64>> =
                platform.points.iter().filter_map(|&p| points[p].map(place)).collect();
            poses.push((row, rigid_fit(&platform.places, &r)));
        }
    }
    poses
}

/// The points of a platform.
pub(crate) struct Platform {
    /// Their numbers among the points of the mechanism.
    pub points: Vec<usize>,
    /// Where they are on the platform.
    pub places: Vec<Vector3<f64>>,
}

impl Platform {
    pub fn of(mechanism: &Mechanism) -> Self {
        let name = |p: usize| &mechanism.points[p].name;
        let points: Vec<usize> = (0..mechanism.points.len())
            .filter(|&p| mechanism.platform.contains_key(name(p)))
            .collect();
        let places = points.iter().map(|&p| Vector3::from(mechanism.platform[name(p)])).collect();
        Self { points, places }
    }
}

/// Every `stride`-th block of readings, moved onto the closures by (52).
pub(crate) fn settled_blocks<'a>(
    model: &'a Model,
    readings: &'a Readings,
    beta: &'a [f64],
    noise: &Noise,
    stride: usize,
) -> impl Iterator<Item = (usize, Vec<Lanes>)> + 'a {
    let (part, noise) = (Part { model, readings, weights: None }, noise.clone());
    let blocks = (0..readings.blocks().len()).step_by(stride);
    blocks.map(move |block| (block, settled(&part, &noise, block, beta)))
}

/// Where the chains carry their points, row by row of a table, under a fit.
///
/// One entry for each point of the mechanism that a chain carries, in order; the
/// readings as they are, in groups that the fit need not have seen.
///
/// # Errors
///
/// As [`Readings::new`].
pub fn carried_points(
    observations: &Observations,
    fit: &Fit,
    table: Table,
) -> Result<Vec<Vec<[f64; 3]>>, Error> {
    let readings = Readings::beside(&observations.mechanism, table, &observations.readings)?;
    let model = Model::like(&fit.model, &observations.mechanism, &readings)?;
    let mut beta = model.nominal();
    let terms = model.term_parameters;
    beta[..terms].copy_from_slice(&fit.beta[..terms]);
    let carried = |p: &&usize| observations.mechanism.points[**p].chain.is_some();
    let names: Vec<usize> = (0..observations.mechanism.points.len()).collect();
    let names: Vec<usize> = names.iter().filter(carried).copied().collect();
    let mut out = vec![vec![[f64::NAN; 3]; readings.samples]; names.len()];
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: false, a: false };
        model.evaluate(&readings, block, readings.raw(block), &beta, want, &mut ws);
        let points = model.points(&ws, &beta);
        for (out, &p) in out.iter_mut().zip(&names) {
            let Some(at) = points[p] else { continue };
            for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
                out[row] = at.map(|v| v.0[lane]);
            }
        }
    }
    Ok(out)
}
