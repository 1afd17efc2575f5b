//! Open-loop calibration against known poses.
//!
//! With the platform held in poses that are known, the inverse kinematics gives
//! every joint coordinate, and each channel is a straight line of its own:
//!
//! ```text
//! min Σ_poses (k a + θ_off - θ)²                                          (13)
//! ```
//!
//! The samples of a pose count as their mean. What one reading is off by has two parts: what differs
//! from sample to sample, which repeats show, and what all samples of a pose share, the error of its
//! placement and what is no straight line. With `s²` the variance of the means about the line, `w²` that
//! of samples about their means, and `h` the mean over poses of one over the number of samples,
//!
//! ```text
//! sigma² = w² + max(0, s² - h w²)
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
    /// Standard deviation of one reading about the line, in readings.
    pub noise: f64,
    /// Degrees of freedom of the noise.
    pub dof: f64,
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
    // Of each sample of a pose that has several: its joint coordinates, and its readings.
    let mut repeats: Vec<Vec<(Vec<f64>, Vec<f64>)>> = Vec::new();
    for parts in rows_of_known(table, channels, known) {
        let count = parts.iter().map(|rows| rows.len() as f64).sum::<f64>();
        let (mut angle, mut value) = (vec![0.0; channels], vec![0.0; channels]);
        let mut samples = Vec::new();
        for rows in parts {
            let found = assembly::inverse(mechanism, &known[rows.start]);
            let found = found.map_err(|error| error.at_pose(rows.start))?;
            add(&mut angle, rows.len() as f64 / count, &found);
            for row in rows {
                add(&mut value, 1.0 / count, readings.row(row));
                samples.push((found.to_vec(), readings.row(row).to_vec()));
            }
        }
        repeats.push(samples);
        angles.push(angle);
        values.push(value);
    }
    let poses = angles.len();
    let (parameters, equations) = (2 * channels, poses * channels);
    let few = Error::TooFew { parameters, equations, poses, different: poses };
    let column = |c: usize| -> Option<Line> {
        let a: Vec<f64> = values.iter().map(|v| v[c]).collect();
        let theta: Vec<f64> = angles.iter().map(|q| q[c]).collect();
        let mut found = line(&a, &theta)?;
        let of = |samples: &Vec<(Vec<f64>, Vec<f64>)>| -> Vec<f64> {
            samples.iter().map(|(angle, value)| value[c] - angle[c] / found.gain).collect()
        };
        let within: Vec<Vec<f64>> = repeats.iter().map(of).collect();
        let off = found.residual / found.gain.abs();
        (found.noise, found.dof) = noise_of_one(&within, off * off * a.len() as f64);
        Some(found)
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
    let residual = (squares / n).sqrt();
    Some(Line { offset, gain, covariance, residual, noise: residual / gain.abs(), dof: n - 2.0 })
}

/// Standard deviation of one reading, and its degrees of freedom: by the samples of each pose, but for what
/// the pose itself makes them differ, and the sum of squares of the means about their line.
fn noise_of_one(poses: &[Vec<f64>], squares: f64) -> (f64, f64) {
    let n = poses.len() as f64;
    let spare = n - 2.0;
    let mut within = (0.0, 0.0);
    for samples in poses {
        let count = samples.len() as f64;
        let mean = samples.iter().sum::<f64>() / count;
        within.0 += samples.iter().map(|a| (a - mean).powi(2)).sum::<f64>();
        within.1 += count - 1.0;
    }
    let (repeats, dof) = within;
    let h = poses.iter().map(|samples| 1.0 / samples.len() as f64).sum::<f64>() / n;
    if spare <= 0.0 || dof == 0.0 {
        let (all, free) = if dof > 0.0 { (repeats, dof) } else { (squares, spare) };
        return ((all / if free > 0.0 { free } else { n }).sqrt(), free);
    }
    let (w2, s2) = (repeats / dof, squares / spare);
    if s2 <= h * w2 {
        // Nothing is shared: both tell the same.
        let free = dof + spare;
        return (((repeats + squares / h) / free).sqrt(), free);
    }
    let own = w2 * (1.0 - h);
    let variance = own + s2;
    // Satterthwaite (1946).
    let free = variance * variance / (own * own / dof + s2 * s2 / spare);
    (variance.sqrt(), free)
}
