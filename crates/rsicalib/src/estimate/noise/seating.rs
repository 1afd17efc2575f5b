//! Play: noise of a closure, one draw for each seating.
//!
//! A ball that is put into a cone sits somewhere near its centre, and all samples of that seating read
//! the same place. So `n` samples of one pose have misclosures with the covariance
//! `δ_st A Σ Aᵀ + Π`, and their mean `A Σ Aᵀ/n + Π`. Samples are weighed one by one, with
//!
//! ```text
//! S = A Σ Aᵀ + m Π,    m = Σ w² over the samples of the pose                           (67)
//! ```
//!
//! in (51), which is the likelihood of the mean: `n` samples of variance `A Σ Aᵀ + n Π` say as much as
//! their mean does. What samples differ by within a pose is of the readings alone; [`contrasts`]
//! whitens it so.

use std::borrow::Cow;

use faer::Mat;

use crate::estimate::noise::scatter::Groups;
use crate::estimate::objective::{Noise, Part};
use crate::estimate::residuals::Residuals;
use crate::numerics::lanes::Lanes;
use crate::numerics::symmetric::eigenvalues;
use crate::readings::Readings;

/// How many samples share the seating of each sample, `m` of (67).
#[derive(Debug, Clone)]
pub(crate) struct Seatings(Option<Vec<f64>>);

impl Seatings {
    /// Of readings under a model: one for each sample where there is no play, or no pose was held.
    pub(crate) fn of(part: &Part, noise: &Noise) -> Self {
        let Part { model, readings, weights } = *part;
        if !readings.held || noise.of_closures(model).of_seating.iter().all(|play| *play == 0.0) {
            return Self(None);
        }
        let weight = |row: usize| weights.map_or(1.0, |weights| weights[row].powi(2));
        let mut samples = vec![0.0; readings.poses()];
        (0..readings.samples).for_each(|row| samples[readings.pose[row]] += weight(row));
        // A pose of which all samples are left out has the play of one: without any, an equation that no
        // reading moves would have no variance.
        samples.iter_mut().filter(|m| **m == 0.0).for_each(|m| *m = 1.0);
        Self(Some(readings.pose.iter().map(|&pose| samples[pose]).collect()))
    }

    /// Of the samples of a block.
    #[inline(always)]
    pub(crate) fn of_block(&self, readings: &Readings, block: usize) -> Lanes {
        let rows = &readings.blocks()[block].rows;
        self.0.as_ref().map_or(Lanes::ONE, |samples| Lanes(rows.map(|row| samples[row])))
    }
}

/// Part of the largest variance of a direction below which readings hardly move it: there, what is of
/// second order, or any play that samples do not share, would be taken for noise of readings.
const UNMOVED: f64 = 1e-4;

/// Residuals whose differences within held poses are whitened by the noise `sigma` of the readings
/// alone; as they are where no play is in them.
///
/// Play moves all samples of a seating alike. With the columns `B = L⁻¹ A` of the middle sample,
/// differences have the covariance `B Σ Bᵀ = U Λ Uᵀ`, and are told by `Λ^-½ Uᵀ` in so many directions
/// as readings move. Lengths that are measured in every sample differ, too, by the variance `play` of
/// each equation, length units squared.
#[must_use]
pub fn contrasts<'a>(
    groups: &Groups,
    residuals: &'a Residuals,
    (sigma, play): (&[f64], &[f64]),
) -> Cow<'a, Residuals> {
    if !residuals.play {
        return Cow::Borrowed(residuals);
    }
    let (k, channels) = (residuals.equations, sigma.len());
    let mut own = residuals.clone();
    // Of a length in each sample, in length units: `by_closure` counts in these.
    let measured: Vec<(usize, f64)> =
        play.iter().copied().enumerate().filter(|(_, variance)| *variance > 0.0).collect();
    let all = residuals.whitened.len() / k.max(1);
    own.directions = (0..all).map(|row| residuals.directions_of(row)).collect();
    for rows in groups.rows.iter().filter(|rows| rows.len() > 1) {
        let b = residuals.by_reading_of(rows[rows.len() / 2], channels);
        let scaled = Mat::from_fn(k, channels, |e, c| b[e * channels + c] * sigma[c]);
        let read = &scaled * scaled.transpose();
        let middle = rows[rows.len() / 2];
        let drawn = Mat::from_fn(k, k, |i, j| {
            let by = |e: usize, m: usize| residuals.by_closure[(middle * k + e) * k + m];
            let own = measured.iter().map(|&(m, variance)| variance * by(i, m) * by(j, m));
            read[(i, j)] + own.sum::<f64>()
        });
        let Some((values, vectors)) = eigenvalues(drawn.as_ref()) else { continue };
        let least = UNMOVED * values.iter().copied().fold(0.0, f64::max);
        let moved: Vec<usize> = (0..k).filter(|&d| values[d] > least).collect();
        let turned = |column: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let along = |d: usize| (0..k).map(|e| vectors[(e, d)] * column(e)).sum::<f64>();
            let mut turned = vec![0.0; k];
            turned.iter_mut().zip(&moved).for_each(|(t, &d)| *t = along(d) / values[d].sqrt());
            turned
        };
        for &row in rows {
            own.directions[row] = moved.len();
            let whitened = turned(&|e| residuals.whitened[row * k + e]);
            own.whitened[row * k..(row + 1) * k].copy_from_slice(&whitened);
            for c in 0..channels {
                let at = |e: usize| (row * k + e) * channels + c;
                let column = turned(&|e| residuals.by_reading[at(e)]);
                column.iter().enumerate().for_each(|(e, value)| own.by_reading[at(e)] = *value);
            }
            for m in 0..own.by_closure.len().min(k) {
                let at = |e: usize| (row * k + e) * k + m;
                let column = turned(&|e| residuals.by_closure[at(e)]);
                column.iter().enumerate().for_each(|(e, value)| own.by_closure[at(e)] = *value);
            }
        }
    }
    (own.play, own.readings_share) = (!measured.is_empty(), share_of(&own, groups, sigma));
    Cow::Owned(own)
}

/// Share of the variance of whitened differences that is of the readings.
fn share_of(residuals: &Residuals, groups: &Groups, sigma: &[f64]) -> f64 {
    let (k, channels) = (residuals.equations, sigma.len());
    let (mut read, mut all) = (0.0, 0.0);
    for rows in groups.rows.iter().filter(|rows| rows.len() > 1) {
        let b = residuals.by_reading_of(rows[rows.len() / 2], channels);
        let own = (0..k * channels).map(|i| (b[i] * sigma[i % channels]).powi(2));
        read += own.sum::<f64>();
        all += residuals.directions_of(rows[rows.len() / 2]) as f64;
    }
    if all > 0.0 { read / all } else { 1.0 }
}
