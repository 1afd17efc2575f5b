//! What a change does to the platform, over poses that the watch has seen.

use crate::apply::change::PlatformRms;
use crate::apply::check::{Check, error_of};
use crate::apply::poses::poses_of;
use crate::estimate::Noise;
use crate::monitor::kept::keep;
use crate::monitor::watched::Watched;
use crate::readings::{Readings, Table};

/// Rows that are kept.
const KEPT: usize = 16;

/// Some of the rows that were tested, evenly spread over the watch.
#[derive(Debug, Clone)]
pub(crate) struct Seen {
    channels: usize,
    rows: Vec<f64>,
    every: u64,
    count: u64,
}

impl Seen {
    pub(crate) fn new(channels: usize) -> Self {
        Self { channels, rows: Vec::with_capacity(KEPT * channels), every: 1, count: 0 }
    }

    /// Keeps a row if its turn has come; of too many rows every second one goes.
    pub(crate) fn see(&mut self, readings: impl Iterator<Item = f64>) {
        self.count += 1;
        if self.count < self.every {
            return;
        }
        self.count = 0;
        if self.rows.len() == KEPT * self.channels {
            for row in 0..KEPT / 2 {
                let from = 2 * row * self.channels;
                self.rows.copy_within(from..from + self.channels, row * self.channels);
            }
            self.rows.truncate(KEPT / 2 * self.channels);
            self.every *= 2;
        }
        self.rows.extend(readings);
    }

    /// Change of the platform between two sets of parameters; none without a platform.
    pub(crate) fn change(
        &self,
        watched: &Watched,
        noise: &Noise,
        before: &[f64],
        after: &[f64],
    ) -> Option<PlatformRms> {
        let model = &watched.under.model;
        if model.mechanism.platform.is_empty() {
            return None;
        }
        let poses = |beta: &[f64]| self.poses(watched, noise, beta, None);
        between(poses(before)?, poses(after)?)
    }

    /// What the noise of one sample does to the platform; none without a platform.
    pub(crate) fn noise(
        &self,
        watched: &Watched,
        noise: &Noise,
        at: &[f64],
    ) -> Option<PlatformRms> {
        if watched.under.model.mechanism.platform.is_empty() {
            return None;
        }
        let still = self.poses(watched, noise, at, None)?;
        let (mut position, mut orientation) = (0.0, 0.0);
        for channel in 0..self.channels {
            let moved = self.poses(watched, noise, at, Some(channel))?;
            let own = between(still.clone(), moved)?;
            position += own.position.powi(2);
            orientation += own.orientation.powi(2);
        }
        Some(PlatformRms { position: position.sqrt(), orientation: orientation.sqrt() })
    }

    /// Poses of the rows, with one channel moved by its standard deviation.
    fn poses(
        &self,
        watched: &Watched,
        noise: &Noise,
        at: &[f64],
        moved: Option<usize>,
    ) -> Option<Vec<[f64; 6]>> {
        let model = &watched.under.model;
        let mut values = self.rows.clone();
        if let Some(channel) = moved {
            let by = noise.sigma.get(channel).copied().unwrap_or_default();
            let most =
                model.mechanism.channels[channel].range.map_or(f64::INFINITY, |[_, high]| high);
            // Either way is as far: that one which stays in the range.
            let to = |value: f64| if value + by > most { value - by } else { value + by };
            values.iter_mut().skip(channel).step_by(self.channels).for_each(|v| *v = to(*v));
        }
        let table = Table { values, ..Table::default() };
        let readings = Readings::beside(&model.mechanism, table, &watched.under.readings).ok()?;
        Some(poses_of(model, &readings, at, noise))
    }
}

fn between(before: Vec<[f64; 6]>, after: Vec<[f64; 6]>) -> Option<PlatformRms> {
    let pairs: Vec<_> = before.into_iter().zip(after).collect();
    let Check { position_rms, orientation_rms, .. } = error_of(&pairs, false);
    Some(PlatformRms { position: position_rms, orientation: orientation_rms? })
}

keep!(Seen: rows, every, count);
