//! Readings moved onto the closures, and means that close as their samples do.
//!
//! A loop is curved: where the mechanism moves within a held pose, as in a trembling hand, the mean of its readings
//! closes less well than each of them. With `â` the readings of a sample moved onto the closures by (52), noise of
//! the closures aside, and `⟨a⟩` the plain mean of `n` samples, moved onto them as `⟨a⟩^`, a pose is the sample
//!
//! ```text
//! ā = ⟨a⟩^ + Σ (a_i - â_i) / n                                                         (76)
//! ```
//!
//! whose misclosure to first order is the mean of those of its samples.

use crate::Error;
use crate::estimate::fitted::Fit;
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::Observations;
use crate::estimate::settle::Room;
use crate::mechanism::Mechanism;
use crate::model::Model;
use crate::numerics::lanes::Lanes;
use crate::readings::Readings;

/// Share of the noise of closures with which readings are moved onto them: where closures say the
/// same of a pose, none at all would leave nothing to divide by.
const HARDLY: f64 = 1e-6;

/// Readings on the closures, block by block.
pub(crate) struct OnClosures<'a> {
    part: Part<'a>,
    beta: &'a [f64],
    room: Room,
    /// Block and lane of each row.
    lane_of: Vec<(usize, usize)>,
    block: Option<usize>,
    a_hat: Vec<Lanes>,
}

impl<'a> OnClosures<'a> {
    pub(crate) fn new(part: Part<'a>, beta: &'a [f64], noise: &Noise) -> Self {
        let hardly = |all: &[f64]| all.iter().map(|one| HARDLY * one).collect();
        let noise = Noise {
            sigma: noise.sigma.clone(),
            play: HARDLY * noise.play,
            seating: hardly(&noise.seating),
            measured: hardly(&noise.measured),
        };
        let room = Room::new(part.model, &noise);
        let lane_of = part.readings.lane_of_rows();
        Self { part, beta, room, lane_of, block: None, a_hat: Vec::new() }
    }

    /// `â` of a row and channel: quick where rows are asked for one after another.
    pub(crate) fn at(&mut self, row: usize, channel: usize) -> f64 {
        let (block, lane) = self.lane_of[row];
        if self.block.replace(block) != Some(block) {
            self.a_hat = self.part.start(block);
            self.room.settle(&self.part, block, self.beta, &mut self.a_hat, false);
        }
        self.a_hat[channel].0[lane]
    }

    /// `a - â` of a row and channel.
    fn off(&mut self, row: usize, channel: usize) -> f64 {
        self.part.readings.row(row)[channel] - self.at(row, channel)
    }
}

/// One sample for each held pose by (76), and the number of samples of which it is the mean.
///
/// # Errors
///
/// As [`Readings::averaged`].
pub(crate) fn means(observations: &Observations, fit: &Fit) -> Result<(Readings, Vec<f64>), Error> {
    let Observations { readings, weights, mechanism, .. } = observations;
    means_under(mechanism, (readings, weights), (&fit.model, &fit.beta), &fit.assumed())
}

/// The same of these readings under a model and its parameters.
///
/// # Errors
///
/// As [`Readings::averaged`].
pub(crate) fn means_under(
    mechanism: &Mechanism,
    (readings, weights): (&Readings, &[f64]),
    (model, beta): (&Model, &[f64]),
    noise: &Noise,
) -> Result<(Readings, Vec<f64>), Error> {
    let (plain, counts) = readings.averaged(mechanism, weights)?;
    let on = |readings| OnClosures::new(Part { model, readings, weights: None }, beta, noise);
    let (mut of_samples, mut of_means) = (on(readings), on(&plain));
    let mut values = plain.table.values.clone();
    let poses = values.chunks_exact_mut(readings.channels).zip(readings.rows_of_poses());
    for (pose, (mean, rows)) in poses.enumerate() {
        let live: Vec<usize> = rows.into_iter().filter(|&row| weights[row] > 0.0).collect();
        if live.len() < 2 {
            continue;
        }
        let mut more = vec![0.0; mean.len()];
        for (row, c) in live.iter().flat_map(|&row| (0..mean.len()).map(move |c| (row, c))) {
            more[c] += of_samples.off(row, c) / live.len() as f64;
        }
        for (c, more) in more.iter_mut().enumerate() {
            *more -= of_means.off(pose, c);
        }
        // Where a fit is far off, no readings may close the loops.
        if more.iter().all(|more| more.is_finite()) {
            for ((mean, more), channel) in mean.iter_mut().zip(more).zip(&mechanism.channels) {
                let [low, high] = channel.range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
                *mean = (*mean + more).clamp(low, high);
            }
        }
    }
    Ok((plain.with_values(mechanism, values)?, counts))
}
