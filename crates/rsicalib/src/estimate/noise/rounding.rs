//! Rounding that lasts over a pose, where channels read in steps that are unlike.
//!
//! All samples of a held pose may fall on one code: then they repeat what rounding does to the
//! reading, and repeats do not show it. Of the variance `s²/12` of the rounding of a step `s`,
//! a part `l` is the same in all `n` samples of a pose, and a part `s²/12 - l` differs from
//! sample to sample. With the noise `v` of the sensor, the mean over a pose has the variance of
//! that of `n` independent readings of
//!
//! ```text
//! v + (s²/12 - l) + n l                                                    (66)
//! ```
//!
//! Where steps are alike this is a factor on the noise of all channels, [`Groups::lasting_rounding`].

use std::borrow::Cow;

use faer::{Mat, MatRef, Side};

use crate::estimate::noise::scatter::{Groups, lasting};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::residuals::Residuals;

/// Least part of the variance of a channel's rounding that must last within a pose to be counted:
/// with less, samples read many codes and show what rounding does. Rounding of less than this part of
/// the variance that is presumed of a channel sets none apart.
const COUNTED: f64 = 0.05;

/// The same for a channel whose samples of the next code stand off no pose: noise of a third of a step. With
/// more, codes scatter nearly as a normal distribution does.
const QUIET: f64 = 0.01;

/// Noises or steps that differ by less than this part are alike.
const ALIKE: f64 = 0.01;

/// Rounding of each channel, variances in its unit; zero where it does not last.
#[derive(Debug, Clone, PartialEq)]
pub struct Rounding {
    /// Channels that read in steps of their own which are a part of their noise.
    pub coarse: Vec<bool>,
    /// `l`: what all samples of a pose share.
    pub lasting: Vec<f64>,
    /// `s²/12 - l`: what differs from sample to sample.
    pub passing: Vec<f64>,
    /// Of the readings themselves within poses: no noise of theirs is larger.
    scatter: Vec<f64>,
    /// `n`, of the usual pose.
    samples: f64,
}

impl Rounding {
    /// What lasts of the rounding of held poses; none without repeats, and where steps are alike in
    /// units of what is `presumed` of the noise.
    pub fn of(groups: &Groups, observations: &Observations, presumed: &Noise) -> Option<Self> {
        let relative = |c: usize| observations.steps[c] / presumed.sigma[c];
        let channels = observations.readings.channels;
        let alike =
            (1..channels).all(|c| (relative(c) - relative(0)).abs() <= ALIKE * relative(0).abs());
        if alike || !observations.readings.held {
            return None;
        }
        let zero = || vec![0.0; channels];
        let (mut held, mut passing, mut scatter) = (zero(), zero(), vec![f64::INFINITY; channels]);
        for c in 0..channels {
            let step = observations.steps[c];
            let Some(seen) = groups.scatter_in_steps(observations, c) else { continue };
            let share = 12.0 * lasting(seen);
            if share > COUNTED {
                held[c] = share * step * step / 12.0;
                passing[c] = step * step / 12.0 - held[c];
                scatter[c] = seen * step * step;
            }
        }
        // Numbers of any file end somewhere, and that is no noise of their channels.
        let counts = |c: usize| held[c] > 0.0 || relative(c).powi(2) / 12.0 > COUNTED;
        let coarse: Vec<bool> = (0..channels).map(|c| observations.coded(c) && counts(c)).collect();
        let any = coarse.contains(&true) && groups.rows.iter().any(|r| r.len() > 1);
        let samples = groups.usual();
        any.then_some(Self { coarse, lasting: held, passing, scatter, samples })
    }

    /// True for a channel whose rounding lasts.
    pub fn lasts(&self, channel: usize) -> bool {
        self.lasting[channel] > 0.0
    }

    /// True where the rounding of all channels lasts: their readings then scatter by less than half of
    /// a step, and nothing else tells their noise.
    pub fn all_last(&self) -> bool {
        self.lasting.iter().all(|lasting| *lasting > 0.0)
    }

    /// Variance by which the readings of a channel whose rounding lasts scatter within poses.
    pub fn scatter(&self, channel: usize) -> f64 {
        self.scatter[channel]
    }

    /// Variance of what differs from sample to sample, where the sensor's noise has the variance
    /// `noise`: not more than the readings scatter by.
    pub fn white(&self, channel: usize, noise: f64) -> f64 {
        (noise + self.passing[channel]).min(self.scatter[channel])
    }

    /// Standard deviation by which to weigh a reading whose samples differ by `white`, (66), where
    /// a mean of these varies `inflation` times as much as one of independent samples.
    pub fn weighed(&self, channel: usize, white: f64, inflation: f64) -> f64 {
        (white + self.samples * self.lasting[channel] / inflation).sqrt()
    }

    /// Share of the variance of whitened residuals that is not of channels whose rounding lasts:
    /// what repeats show once these are steadied.
    pub fn shown(&self, residuals: &Residuals, used: &Noise) -> f64 {
        let rows = residuals.by_reading.chunks_exact(self.lasting.len());
        let count = rows.len().max(1) as f64;
        let of = |row: &[f64]| -> f64 {
            let lasting = (0..row.len()).filter(|&c| self.lasts(c));
            lasting.map(|c| (row[c] * used.sigma[c]).powi(2)).sum()
        };
        1.0 - rows.map(of).sum::<f64>() / count
    }
}

/// True for a channel that reads one code, or its neighbours, in most poses, however far it is off in
/// some: which of these a sample reads is no noise.
pub fn is_quiet(groups: &Groups, observations: &Observations, channel: usize) -> bool {
    let channels = observations.readings.channels;
    let read = |row: &usize| observations.readings.table.values[row * channels + channel];
    let step = observations.steps[channel];
    let near = |rows: &&Vec<usize>| {
        rows.iter().all(|row| (read(row) - read(&rows[0])).abs() <= NEIGHBOURS * step)
    };
    let repeated = || groups.rows.iter().filter(|rows| rows.len() > 1);
    let rows: Vec<Vec<usize>> = repeated().filter(near).cloned().collect();
    if 2 * rows.len() <= repeated().count() {
        return false;
    }
    let seen = Groups { rows, order: 1 }.scatter_in_steps(observations, channel);
    seen.is_some_and(|seen| 12.0 * lasting(seen) > QUIET)
}

/// Variance that rounding gives a sample, in units of the noise, on average over channels; as large as
/// it is beside [`steadied_alike`] residuals.
pub fn of_steadied(observations: &Observations, sigma: &[f64]) -> f64 {
    let each = observations.steps.iter().zip(sigma).map(|(step, sigma)| (step / sigma).powi(2));
    each.sum::<f64>() / (12.0 * KEPT * sigma.len() as f64)
}

/// Residuals as they would be, had channels whose rounding `lasts` read their mean in all samples of
/// a pose that read no more than three neighbouring codes.
///
/// Which of them a sample reads is no noise: most poses read one code, and some read others.
pub fn steadied<'a>(
    observations: &Observations,
    rows_of_poses: &[Vec<usize>],
    residuals: &'a Residuals,
    lasts: impl Fn(usize) -> bool,
) -> Cow<'a, Residuals> {
    let (k, channels) = (residuals.equations, observations.readings.channels);
    if !(0..channels).any(&lasts) {
        return Cow::Borrowed(residuals);
    }
    let mut steady = residuals.clone();
    for c in (0..channels).filter(|&c| lasts(c)) {
        let read = |row: usize| observations.readings.table.values[row * channels + c];
        for rows in rows_of_poses.iter().filter(|rows| rows.len() > 1) {
            let mean = rows.iter().map(|&row| read(row)).sum::<f64>() / rows.len() as f64;
            let far = rows
                .iter()
                .any(|&row| (read(row) - read(rows[0])).abs() > NEIGHBOURS * observations.steps[c]);
            for &row in rows.iter().filter(|_| !far) {
                for e in row * k..(row + 1) * k {
                    steady.whitened[e] -=
                        residuals.by_reading[e * channels + c] * (read(row) - mean);
                }
            }
        }
    }
    Cow::Owned(steady)
}

/// Steadied residuals, whitened anew: without the noise of channels whose rounding `lasts`, of which
/// each has the standard deviation `sigma`, poses would differ by how much these move them. Beside
/// channels of which none lasts each keeps the variance of its rounding, and samples scatter by no more
/// than by what whitens them.
pub fn steadied_alike(
    observations: &Observations,
    rows_of_poses: &[Vec<usize>],
    residuals: &Residuals,
    sigma: &[f64],
    lasts: impl Fn(usize) -> bool,
) -> Residuals {
    let mut steady = steadied(observations, rows_of_poses, residuals, &lasts).into_owned();
    let (k, channels) = (residuals.equations, sigma.len());
    let lasting: Vec<usize> = (0..channels).filter(|&c| lasts(c)).collect();
    if lasting.is_empty() {
        return steady;
    }
    let rounding: Vec<f64> = observations.roundings().collect();
    let kept = |c: usize| match lasting.len() == channels {
        true => KEPT,
        false => (rounding[c] / (sigma[c] * sigma[c])).min(1.0),
    };
    for row in 0..observations.readings.samples {
        let a = |e: usize, c: usize| residuals.by_reading[(row * k + e) * channels + c] * sigma[c];
        let left = Mat::from_fn(k, k, |i, j| {
            let gone = lasting.iter().map(|&c| (1.0 - kept(c)) * a(i, c) * a(j, c));
            f64::from(u8::from(i == j)) - gone.sum::<f64>()
        });
        let Ok(factor) = left.llt(Side::Lower) else { continue };
        let first = row * k;
        substitute(factor.L(), &mut steady.whitened[first..first + k], 1, 0);
        let columns = &mut steady.by_reading[first * channels..(first + k) * channels];
        (0..channels).for_each(|c| substitute(factor.L(), columns, channels, c));
    }
    steady
}

/// Solves `L x = b` in place, where `b` is every so many of the values from one of them on.
fn substitute(l: MatRef<f64>, values: &mut [f64], stride: usize, from: usize) {
    for i in 0..l.nrows() {
        let known: f64 = (0..i).map(|j| l[(i, j)] * values[j * stride + from]).sum();
        let own = &mut values[i * stride + from];
        *own = (*own - known) / l[(i, i)];
    }
}

/// Share of its variance that a steadied channel keeps: over half of a step, a few thousandths of a
/// turn, derivatives change by as much, and nothing else may move a pose.
const KEPT: f64 = 1e-4;

/// Steps that three neighbouring codes are apart, and what a file's digits may add.
const NEIGHBOURS: f64 = 2.1;

#[cfg(test)]
mod tests {
    use super::Rounding;

    /// The second of two channels reads in steps of 8; four samples in a pose, sensor noise 1.
    fn rounding() -> Rounding {
        Rounding {
            coarse: vec![false, true],
            lasting: vec![0.0, 2.0],
            passing: vec![0.0, 64.0 / 12.0 - 2.0],
            scatter: vec![f64::INFINITY, 100.0],
            samples: 4.0,
        }
    }

    #[test]
    fn the_mean_of_a_pose_has_the_variance_of_independent_readings() {
        let one = rounding();
        // By hand: of four samples (1 + 10/3)/4 + 2, of independent ones a fourth of a reading's.
        let mean = one.weighed(1, one.white(1, 1.0), 1.0).powi(2) / 4.0;
        assert!((mean - (13.0 / 12.0 + 2.0)).abs() < 1e-12);
        assert!((one.weighed(0, one.white(0, 1.0), 1.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn readings_that_stand_still_have_no_noise_of_their_own() {
        let still = Rounding { scatter: vec![f64::INFINITY, 0.0], ..rounding() };
        assert!(still.white(1, 1.0).abs() < 1e-12);
    }
}
