//! Open-loop calibration against known poses.
//!
//! With the platform held in poses that are known, the inverse kinematics gives
//! every joint coordinate, and each channel is a straight line of its own:
//!
//! ```text
//! min Σ_poses (k a + θ_off - θ)²                                          (13)
//! ```

use crate::Error;
use crate::apply::known::rows_of_known;
use crate::mechanism::Mechanism;
use crate::model::assembly;
use crate::readings::{Readings, Table};

/// Offset and gain of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Line {
    /// Joint coordinate at reading zero.
    pub offset: f64,
    /// Joint coordinate per reading.
    pub gain: f64,
    /// Covariance of offset and gain; none without poses to spare.
    pub covariance: Option<[[f64; 2]; 2]>,
    /// Root mean square distance of the joint coordinates from the line.
    pub residual: f64,
}

/// The lines of all channels, and how many poses they rest on.
///
/// `known` holds a pose for each row, NaN where it is not known; the samples of
/// a pose count as their mean, for its placement is one and the same error. Where the known pose differs
/// from sample to sample, so do its joint angles.
///
/// # Errors
///
/// [`Error::Shape`] unless there is a pose for each row, [`Error::TooFew`]
/// below two known poses or where a channel does not move, and as
/// [`assembly::inverse`].
pub fn fixture(
    mechanism: &Mechanism,
    table: &Table,
    known: &[[f64; 6]],
) -> Result<(Vec<Line>, usize), Error> {
    let channels = mechanism.channels.len();
    let readings = Readings::new(mechanism, table.clone())?;
    Error::same("poses", known.len(), readings.samples)?;
    let mut angles = Vec::new();
    let mut values = Vec::new();
    for parts in rows_of_known(table, channels, known) {
        let count = parts.iter().map(|rows| rows.len() as f64).sum::<f64>();
        let (mut angle, mut value) = (vec![0.0; channels], vec![0.0; channels]);
        for rows in parts {
            let found = assembly::inverse(mechanism, &known[rows.start]);
            let share = rows.len() as f64 / count;
            add(&mut angle, share, &found.map_err(|error| error.at_pose(rows.start))?);
            rows.for_each(|row| add(&mut value, 1.0 / count, readings.row(row)));
        }
        angles.push(angle);
        values.push(value);
    }
    let poses = angles.len();
    let (parameters, equations) = (2 * channels, poses * channels);
    let few = Error::TooFew { parameters, equations, poses, different: poses };
    let column = |c: usize| -> Option<Line> {
        let a: Vec<f64> = values.iter().map(|v| v[c]).collect();
        let theta: Vec<f64> = angles.iter().map(|q| q[c]).collect();
        line(&a, &theta)
    };
    let lines: Option<Vec<Line>> = (0..channels).map(column).collect();
    Ok((lines.ok_or(few)?, poses))
}

/// `sum += share · values`
fn add(sum: &mut [f64], share: f64, values: &[f64]) {
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += share * value);
}

/// Least squares of `theta` on `a`, eq. (13).
fn line(a: &[f64], theta: &[f64]) -> Option<Line> {
    let n = a.len() as f64;
    let (a0, theta0) = (a.iter().sum::<f64>() / n, theta.iter().sum::<f64>() / n);
    let moment: f64 = a.iter().map(|a| (a - a0).powi(2)).sum();
    if a.len() < 2 || moment <= 0.0 {
        return None;
    }
    let gain = a.iter().zip(theta).map(|(a, t)| (a - a0) * (t - theta0)).sum::<f64>() / moment;
    let offset = theta0 - gain * a0;
    let squares: f64 = a.iter().zip(theta).map(|(a, t)| (gain * a + offset - t).powi(2)).sum();
    let covariance = (a.len() > 2).then(|| {
        let s2 = squares / (n - 2.0);
        let (of_gain, with_offset) = (s2 / moment, -s2 * a0 / moment);
        [[s2 / n + of_gain * a0 * a0, with_offset], [with_offset, of_gain]]
    });
    Some(Line { offset, gain, covariance, residual: (squares / n).sqrt() })
}
