//! Raw readings by rows, poses and channels.

use std::ops::Range;

use crate::mechanism::Channel;
use crate::readings::runs_of;

/// Poses of a session: fewer, a rest pose among them, may well hold a channel still.
pub(super) const SESSION: usize = 5;

/// Raw readings of some channels.
#[derive(Debug, Clone)]
pub struct Raw<'a> {
    pub(super) channels: &'a [Channel],
    /// Row by row.
    pub(super) values: &'a [f64],
    /// The rows of each pose.
    pub(super) poses: Vec<Range<usize>>,
    /// True where poses are labelled.
    pub(super) held: bool,
}

impl<'a> Raw<'a> {
    /// Readings row by row, and the label of the pose of each row; none for a recording.
    #[must_use]
    pub fn new(channels: &'a [Channel], values: &'a [f64], labels: Option<&[i64]>) -> Self {
        let rows = values.len().checked_div(channels.len()).unwrap_or(0);
        let single = || (0..rows).map(|row| row..row + 1).collect();
        let poses = labels.map_or_else(single, runs_of);
        Self { channels, values, poses, held: labels.is_some() }
    }

    /// Number of rows.
    pub(super) fn rows(&self) -> usize {
        self.poses.last().map_or(0, |last| last.end)
    }

    /// The readings of a row.
    pub(super) fn row(&self, row: usize) -> &'a [f64] {
        self.block(&(row..row + 1))
    }

    /// The readings of some rows, row by row.
    pub(super) fn block(&self, rows: &Range<usize>) -> &'a [f64] {
        let n = self.channels.len();
        &self.values[rows.start * n..rows.end * n]
    }

    /// The readings of a channel.
    pub(super) fn column(&self, channel: usize) -> impl Iterator<Item = f64> + Clone + use<'a> {
        self.part(&(0..self.rows()), channel)
    }

    /// The readings of a channel in some rows.
    pub(super) fn part(
        &self,
        rows: &Range<usize>,
        channel: usize,
    ) -> impl Iterator<Item = f64> + Clone + use<'a> {
        self.block(rows).iter().skip(channel).step_by(self.channels.len()).copied()
    }

    /// Which channels are read in whole counts.
    pub(super) fn counts(&self) -> Vec<bool> {
        self.channels.iter().map(Channel::counts).collect()
    }

    /// How far the readings of each channel go.
    pub(super) fn spans(&self) -> Vec<f64> {
        (0..self.channels.len()).map(|c| span(self.column(c))).collect()
    }
}

/// From the lowest to the highest of these.
pub(super) fn span(values: impl Iterator<Item = f64>) -> f64 {
    let [low, high] = ends(values);
    high - low
}

/// The lowest and the highest of these.
pub(super) fn ends(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}
