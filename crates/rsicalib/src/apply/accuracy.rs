//! Predicted error of the platform, or of the points that chains carry.
//!
//! Closure is not accuracy: loops may close well where readings do not determine the parameters
//! that place the platform. With the covariance `C` of the parameters and the derivative `J` of
//! the positions by them, to first order by differences,
//!
//! ```text
//! E |e|² = tr(C JᵀJ),    var |e|² = 2 tr((C JᵀJ)²)                        (97)
//! ```
//!
//! to which noise of the readings adds where known poses are compared with. What the readings do not determine at all has no
//! variance in `C`: it is named among the unobservable directions, and is not in the figure.

use faer::Mat;

use crate::Error;
use crate::apply::poses::{poses_of, short_way};
use crate::estimate::{Fit, Observations};
use crate::model::{Model, Want, Workspace};
use crate::numerics::distributions;
use crate::readings::{Readings, Table, average, rows_of};

/// Predicted error, root mean square over components.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Predicted {
    /// Poses for which the error is predicted.
    pub poses: usize,
    /// Standard deviation of a coordinate of the platform's position, or of carried points, by
    /// the errors of the parameters [length unit].
    pub position_sd: f64,
    /// Standard deviation of roll, pitch and yaw (rad); null without a platform.
    pub orientation_sd: Option<f64>,
    /// Degrees of freedom of the mean square of the positions.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub dof: f64,
}

impl Predicted {
    /// Probability of a larger error of the positions than this root mean square, were the model
    /// right.
    #[must_use]
    pub fn p_value(&self, position_rms: f64) -> f64 {
        let times = (position_rms / self.position_sd.max(f64::MIN_POSITIVE)).powi(2);
        distributions::chi2_tail(times * self.dof, self.dof)
    }
}

/// The predicted error of a fit at the poses of a table, at most `most` of them, evenly spread.
///
/// Positions are those of the platform, or, without a platform, of the points that chains carry.
/// With `noisy`, the error of the readings is in it, samples of one pose averaged.
///
/// # Errors
///
/// As [`Readings::new`].
pub fn predicted(
    observations: &Observations,
    fit: &Fit,
    table: &Table,
    most: usize,
    noisy: bool,
) -> Result<Predicted, Error> {
    let channels = observations.mechanism.channels.len();
    let table_rows = table.values.len() / channels;
    let (averaged, poses) = average(table, channels);
    let count = poses.len().min(most.max(1));
    let rows: Vec<usize> = (0..count).map(|k| k * poses.len() / count).collect();
    let table = rows_of(&averaged, channels, &rows);
    let here = Places::at(observations, fit, &table, &fit.beta)?;

    let moved = |by: usize, sd: f64| {
        let mut beta = fit.beta.clone();
        beta[by] += sd;
        Places::at(observations, fit, &table, &beta).map(|there| there.less(&here))
    };
    let terms = fit.model.term_parameters;
    let sd: Vec<f64> = (0..terms).map(|i| fit.covariance[(i, i)].max(0.0).sqrt()).collect();
    let free: Vec<usize> = (0..terms).filter(|&i| sd[i] > 0.0).collect();
    let moves = free.iter().map(|&i| moved(i, sd[i])).collect::<Result<Vec<_>, _>>()?;
    let correlation = Mat::from_fn(free.len(), free.len(), |i, j| {
        fit.covariance[(free[i], free[j])] / (sd[free[i]] * sd[free[j]])
    });

    let samples = table_rows as f64 / poses.len().max(1) as f64;
    let mut by_noise = Vec::with_capacity(channels);
    for (c, sigma) in fit.noise.sigma.iter().enumerate().filter(|_| noisy) {
        let sigma = sigma / samples.sqrt();
        let mut table = table.clone();
        let [_, high] = observations.mechanism.channels[c].range.unwrap_or([0.0, f64::INFINITY]);
        for value in table.values.iter_mut().skip(c).step_by(channels) {
            *value += if *value + sigma > high { -sigma } else { sigma };
        }
        by_noise.push(Places::at(observations, fit, &table, &fit.beta)?.less(&here));
    }

    let of = |part: fn(&Places) -> &[f64]| -> Option<Square> {
        let size = part(&here).len();
        (size > 0).then(|| {
            let by_parameter: Vec<&[f64]> = moves.iter().map(part).collect();
            let by_reading: Vec<&[f64]> = by_noise.iter().map(part).collect();
            Square::of(&by_parameter, &correlation, &by_reading, size)
        })
    };
    let position = of(|places| &places.positions).unwrap_or_default();
    let orientation = of(|places| &places.angles).map(|square| square.mean.sqrt());
    let (position_sd, dof) = (position.mean.sqrt(), position.dof);
    Ok(Predicted { poses: rows.len(), position_sd, orientation_sd: orientation, dof })
}

/// Where a calibration puts things: coordinates, pose by pose.
struct Places {
    positions: Vec<f64>,
    angles: Vec<f64>,
}

impl Places {
    fn at(
        observations: &Observations,
        fit: &Fit,
        table: &Table,
        beta: &[f64],
    ) -> Result<Self, Error> {
        let mechanism = &observations.mechanism;
        let readings = Readings::beside(mechanism, table.clone(), &observations.readings)?;
        let model = Model::like(&fit.model, mechanism, &readings)?;
        // Where unknown points are is no part of where chains carry their points.
        let mut own = model.nominal();
        let terms = model.term_parameters;
        own[..terms].copy_from_slice(&beta[..terms]);
        if mechanism.platform.is_empty() || !model.unknown_names.is_empty() {
            return Ok(Self { positions: carried(&model, &readings, &own), angles: Vec::new() });
        }
        let poses = poses_of(&model, &readings, &own, &fit.noise.sigma, fit.noise.play);
        let part = |from: usize| poses.iter().flat_map(|p| p[from..from + 3].to_vec()).collect();
        Ok(Self { positions: part(0), angles: part(3) })
    }

    fn less(mut self, other: &Self) -> Self {
        self.positions.iter_mut().zip(&other.positions).for_each(|(a, b)| *a -= b);
        self.angles.iter_mut().zip(&other.angles).for_each(|(a, b)| *a = short_way(*a - b));
        self
    }
}

/// Coordinates of all points that chains carry.
fn carried(model: &Model, readings: &Readings, beta: &[f64]) -> Vec<f64> {
    let (mut out, mut ws) = (Vec::new(), Workspace::default());
    let chained = model.mechanism.points.iter().map(|p| p.chain.is_some());
    let chained: Vec<bool> = chained.collect();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: false, a: false };
        model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
        let points = model.points(&ws);
        for at in points.iter().zip(&chained).filter(|(_, own)| **own).filter_map(|(at, _)| *at) {
            out.extend((0..meta.live).flat_map(|lane| at.map(|v| v.0[lane])));
        }
    }
    out
}

/// Mean square of a coordinate, and its degrees of freedom.
#[derive(Default)]
struct Square {
    mean: f64,
    dof: f64,
}

impl Square {
    /// (97) for `size` coordinates, by parameters, and by readings that are independent.
    fn of(moves: &[&[f64]], correlation: &Mat<f64>, noisy: &[&[f64]], size: usize) -> Self {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let n = moves.len();
        let gram = Mat::from_fn(n, n, |i, j| dot(moves[i], moves[j]));
        let product = correlation * &gram;
        let (mut mean, mut squares) = (0.0, 0.0);
        for i in 0..n {
            mean += product[(i, i)];
            squares += (0..n).map(|j| product[(i, j)] * product[(j, i)]).sum::<f64>();
        }
        for k in 0..size {
            let variance: f64 = noisy.iter().map(|moved| moved[k] * moved[k]).sum();
            mean += variance;
            squares += variance * variance;
        }
        let dof = if squares > 0.0 { mean * mean / squares } else { 1.0 };
        Self { mean: mean / size as f64, dof }
    }
}
