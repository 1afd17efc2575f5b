//! How large the noise is, from the readings themselves.
//!
//! A hand that holds a pose shakes. Shaking keeps the loop closed, sensor noise
//! does not, so the noise is the scatter of the *whitened misclosure* within a
//! pose, not that of the channels. In a recording, where no pose is held, the
//! scatter about a straight line over a few neighbouring rows takes its place.
//!
//! ```text
//! s²   = Σ_p Σ_s |r_ps - r̄_p|² / ν,     ν = K Σ_p (n_p - 1)               (61)
//! ```
//!
//! Neighbouring samples may resemble each other; what that does to the mean of a pose
//! is said in `noise/correlation.rs`.

use crate::numerics::order;
use std::f64::consts::PI;

use crate::estimate::noise::correlation::correlated;
use crate::estimate::observations::Observations;
use crate::estimate::residuals::Residuals;
use crate::numerics::distributions;
use crate::readings::Readings;
use crate::readings::context::{STRETCH, detrend, is_motion};

/// Fewest rows without time that are taken for a motion: of fewer, held one after another along the
/// path of one joint, neighbours say nothing of the noise.
const UNTIMED: usize = 1000;

/// Scatter of whitened residuals within groups of rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatter {
    /// Sum of squares within the groups.
    pub within: f64,
    /// Its degrees of freedom, as if samples were independent.
    pub dof: f64,
    /// Correlation of neighbouring samples.
    pub correlation: f64,
    /// Variance of a group's mean over that of independent samples.
    pub inflation: f64,
    /// The same for what varies slowly over many groups: parameters, of a recording.
    pub slow: f64,
    /// Degrees of freedom of an inflated variance.
    pub effective: f64,
    /// Variance within a group, per degree of freedom, over that of a sample.
    pub shown: f64,
}

impl Scatter {
    /// The same of samples that do not resemble their neighbours.
    #[must_use]
    pub fn alone(self) -> Self {
        Self {
            correlation: 0.0,
            inflation: 1.0,
            slow: 1.0,
            effective: self.dof,
            shown: 1.0,
            ..self
        }
    }
}

/// Rows that repeat each other: held poses, or stretches of a recording.
#[derive(Debug, Clone)]
pub struct Groups {
    /// The rows of each.
    pub rows: Vec<Vec<usize>>,
    /// Parameters of what is removed from each: 1 a mean, 2 a line.
    pub order: usize,
}

impl Groups {
    /// The groups of these readings, of the rows in use.
    #[must_use]
    pub fn of(readings: &Readings, weights: &[f64]) -> Self {
        if readings.held {
            let mut rows = readings.rows_of_poses();
            for rows in &mut rows {
                rows.retain(|&r| weights[r] > 0.0);
            }
            return Self { rows, order: 1 };
        }
        // Stretches of a recording are means already, and what is left of them is no noise.
        if readings.merged.is_some() || (!readings.timed && readings.samples < UNTIMED) {
            return Self { rows: Vec::new(), order: 1 };
        }
        let live: Vec<usize> = (0..readings.samples).filter(|&r| weights[r] > 0.0).collect();
        let rows = live.chunks_exact(STRETCH).map(<[usize]>::to_vec).collect();
        let stretches = Self { rows, order: 2 };
        // What scatters about lines of poses of their own is whatever the model lacks.
        let moves = is_motion(&readings.table, &stretches.rows, &readings.mean, &readings.span);
        if moves { stretches } else { Self { rows: Vec::new(), order: 1 } }
    }

    /// Rows of the average group that has any in use.
    #[must_use]
    pub fn usual(&self) -> f64 {
        let used = self.rows.iter().filter(|rows| !rows.is_empty()).count();
        self.rows.iter().map(Vec::len).sum::<usize>() as f64 / used.max(1) as f64
    }

    /// Variance of the usual group over that of (61), per degree of freedom: by the median,
    /// which a few bad samples do not move.
    #[must_use]
    pub fn median_variance(&self, residuals: &Residuals) -> f64 {
        let k = residuals.equations;
        let mut left = Vec::new();
        let useful = self.rows.iter().filter(|r| r.len() > self.order);
        let mut sizes: Vec<f64> = useful
            .map(|rows| {
                let mut within = 0.0;
                for equation in 0..k {
                    left.clear();
                    left.extend(rows.iter().map(|r| residuals.whitened[r * k + equation]));
                    detrend(&mut left, self.order);
                    within += left.iter().map(|r| r * r).sum::<f64>();
                }
                let dof = (rows.len() - self.order) * residuals.directions_of(rows[0]);
                within / distributions::chi2_quantile(0.5, dof.max(1) as f64)
            })
            .collect();
        order::sort(&mut sizes);
        sizes.get(sizes.len() / 2).copied().unwrap_or(1.0)
    }

    /// Part of the variance of rounding that all samples of a held pose share: nearly all of
    /// it where the readings hardly change within a pose, none where they do.
    ///
    /// With steady noise `σ` the mean code is off by `Σ (-1)ᵏ e^(-2π²k²σ²) sin(2πkx) / πk`
    /// for a reading at `x`, in units of a code.
    #[must_use]
    pub fn lasting_rounding(&self, observations: &Observations) -> f64 {
        let Readings { channels, held, .. } = &*observations.readings;
        let whole = (0..*channels).all(|c| rounds(observations, c));
        if !held || !whole {
            return 0.0;
        }
        let (mut within, mut dof) = (0.0, 0.0);
        for channel in 0..*channels {
            let (own, free) = self.spread_in_steps(observations, channel);
            within += own;
            dof += free;
        }
        if dof == 0.0 { 0.0 } else { 12.0 * lasting(within / dof) }
    }

    /// Variance of the readings of a channel within poses, in units of its step squared; none where
    /// it reads in no steps, or where repeats are means of codes.
    #[must_use]
    pub fn scatter_in_steps(&self, observations: &Observations, channel: usize) -> Option<f64> {
        let (within, dof) = self.spread_in_steps(observations, channel);
        (dof > 0.0 && rounds(observations, channel)).then(|| within / dof)
    }

    /// Sum of squares of the readings of a channel within poses, in units of its step squared, and
    /// its degrees of freedom.
    fn spread_in_steps(&self, observations: &Observations, channel: usize) -> (f64, f64) {
        let Readings { channels, table, .. } = &*observations.readings;
        let step = observations.steps[channel];
        let (mut within, mut dof) = (0.0, 0.0);
        let mut left = Vec::new();
        for rows in self.rows.iter().filter(|r| r.len() > 1) {
            left.clear();
            left.extend(rows.iter().map(|r| table.values[r * channels + channel] / step));
            detrend(&mut left, 1);
            within += left.iter().map(|v| v * v).sum::<f64>();
            dof += (rows.len() - 1) as f64;
        }
        (within, dof)
    }

    /// The most that a whitened misclosure of readings with noise `sigma` can scatter, per degree of freedom: the sum over
    /// channels of their variance within poses, in units of that noise. Loops that are far from closed scatter by whatever
    /// settles them. Infinite where no pose was held, and where more is read with each sample than channels.
    #[must_use]
    pub fn most(&self, observations: &Observations, sigma: &[f64]) -> f64 {
        let Readings { channels, table, held, .. } = &*observations.readings;
        if !held || !observations.mechanism.value_columns().is_empty() {
            return f64::INFINITY;
        }
        let dof: usize = self.rows.iter().map(|rows| rows.len().saturating_sub(self.order)).sum();
        let mut left = Vec::new();
        let mut of_channel = |channel: usize| {
            let mut within = 0.0;
            for rows in self.rows.iter().filter(|rows| rows.len() > self.order) {
                left.clear();
                left.extend(rows.iter().map(|r| table.values[r * channels + channel]));
                detrend(&mut left, self.order);
                within += left.iter().map(|v| v * v).sum::<f64>();
            }
            within / dof.max(1) as f64 / sigma[channel].powi(2)
        };
        (0..*channels).map(&mut of_channel).sum()
    }

    /// Eq. (61): the scatter of residuals within these groups, of which a variance of
    /// `rounding` is white whatever the samples' correlation.
    #[must_use]
    pub fn scatter(&self, residuals: &Residuals, rounding: f64) -> Scatter {
        let k = residuals.equations;
        let (mut within, mut dof) = (0.0, 0.0);
        let (mut product, mut groups, mut samples) = (0.0, 0.0, 0.0);
        let mut left = Vec::new();
        for rows in self.rows.iter().filter(|r| r.len() > self.order) {
            for equation in 0..k {
                left.clear();
                left.extend(rows.iter().map(|r| residuals.whitened[r * k + equation]));
                detrend(&mut left, self.order);
                within += left.iter().map(|r| r * r).sum::<f64>();
                product += left.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
            }
            let told = residuals.directions_of(rows[0]);
            dof += ((rows.len() - self.order) * told) as f64;
            groups += told as f64;
            samples += (rows.len() * told) as f64;
        }
        let alone = Scatter {
            within,
            dof,
            correlation: 0.0,
            inflation: 1.0,
            slow: 1.0,
            effective: dof,
            shown: 1.0,
        };
        let n = (samples / groups).round() as usize;
        // Two samples less their mean are each other's opposite: nothing to be seen.
        if groups == 0.0 || n < self.order + 2 || within == 0.0 {
            return alone;
        }
        let variance = within / dof;
        let independent = -lost_product(n, self.order);
        let pairs = groups * (n - 1) as f64;
        let raw = (product / variance / groups - independent) / (n - 1) as f64;
        if raw < SURE / pairs.sqrt() {
            return Scatter { correlation: raw, ..alone };
        }
        let q = (rounding / variance).min(0.95);
        let found = correlated(product / variance / groups, n, self.order, q);
        Scatter {
            correlation: found.rho,
            inflation: found.inflation,
            slow: found.slow,
            effective: found.dof * groups,
            shown: found.shown,
            ..alone
        }
    }
}

/// True for a channel that reads in steps, and whose readings are no means of counts.
fn rounds(observations: &Observations, channel: usize) -> bool {
    let Readings { channels, table, .. } = &*observations.readings;
    let count = observations.mechanism.channels[channel].counts();
    let mut column = table.values.iter().skip(channel).step_by(*channels);
    observations.steps[channel] > 0.0 && !(count && column.any(|v| v.fract() != 0.0))
}

/// Variance of the mean code's error where codes scatter by `seen` about it.
pub(crate) fn lasting(seen: f64) -> f64 {
    let term = |k: f64, s2: f64| (-(2.0 * PI * k).powi(2) * s2).exp() / (2.0 * (PI * k).powi(2));
    let at = |s2: f64| (1..200).map(|k| term(f64::from(k), s2)).sum::<f64>();
    // Noise s2 and rounding 1/12 are what is seen and what is not.
    let (mut low, mut high) = (0.0, seen.max(1e-12));
    for _ in 0..50 {
        let s2 = 0.5 * (low + high);
        if s2 + 1.0 / 12.0 - at(s2) < seen { low = s2 } else { high = s2 }
    }
    at(0.5 * (low + high))
}

/// Correlation counts from so many of its standard deviations.
const SURE: f64 = 2.0;

/// `-E Σ e_i e_{i+1} / σ²` of independent samples from which a mean (order 1) or
/// a line (order 2) was removed: the sum of the hat matrix beside its diagonal.
fn lost_product(n: usize, order: usize) -> f64 {
    let count = n as f64;
    let mut lost = (count - 1.0) / count;
    if order > 1 {
        let x = |i: usize| i as f64 - 0.5 * (count - 1.0);
        let moment: f64 = (0..n).map(|i| x(i).powi(2)).sum();
        lost += (1..n).map(|i| x(i) * x(i - 1)).sum::<f64>() / moment;
    }
    lost
}

#[cfg(test)]
mod tests {
    use super::{Groups, lasting};

    #[test]
    fn a_pose_that_is_left_out_makes_the_others_no_smaller() {
        let groups = Groups { rows: vec![vec![0, 1], vec![], vec![4, 5]], order: 1 };
        assert_eq!(groups.usual(), 2.0);
    }

    #[test]
    fn rounding_lasts_only_where_readings_stand_still() {
        assert!((lasting(0.0) - 1.0 / 12.0).abs() < 3e-4); // 200 terms of the series
        assert!(lasting(0.25 + 1.0 / 12.0) < 1e-5);
        assert!(lasting(4.0) < 1e-60);
    }
}
