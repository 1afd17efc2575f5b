//! A channel that is stuck: it reads one value for longer than chance lets it, and without those rows the loop
//! closes.
//!
//! A joint that stands, or a coarse converter, may read one value as long. The loop then closes with these rows.

use std::ops::Range;

use crate::Error;
use crate::estimate::miswired::again::{Again, closing, decisive};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::suspicion::{Closes, Suspicion};
use crate::readings::repeating::Repeating;
use crate::readings::{Readings, runs_of};

/// Probability with which a session of sound readings has so long a run: whether it is a fault, the loop says.
const CHANCE: f64 = 1e-3;

/// The channel without whose run of equal readings the loop closes, and by far not with it nor without the run of
/// any other: `left` is χ² per degree of freedom by a `noise`, and `refit` a fit of other observations.
pub(crate) fn stuck(
    observations: &Observations,
    noise: &Noise,
    left: f64,
    refit: impl Fn(&Observations) -> Result<Again, Error>,
) -> Option<Suspicion> {
    let limit = closing(observations, left)?;
    let readings = &*observations.readings;
    let without = |channel: usize| {
        let rows = rare_run(readings, channel)?;
        let mut less = observations.clone();
        less.weights[rows.clone()].fill(0.0);
        let table = readings.table.clone();
        let again = Again::of(&less, (&observations.mechanism, table), noise, &refit)?;
        Some((again.left, (channel, rows)))
    };
    let found = (0..readings.channels).filter_map(without).collect();
    let (with, (channel, rows)) = decisive(found, limit)?;
    let pose = |row: usize| readings.labels[readings.pose[row]];
    Some(Suspicion::Stuck {
        channel,
        reads: readings.row(rows.start)[channel],
        rows: rows.len(),
        of: readings.samples,
        poses: readings.held.then(|| [pose(rows.start), pose(rows.end - 1)]),
        first: rows.start,
        closes: Closes { with, declared: left },
    })
}

/// The longest run of equal readings of a channel, where it is rarer than chance and another channel moves from
/// pose to pose.
fn rare_run(readings: &Readings, channel: usize) -> Option<Range<usize>> {
    let column: Vec<f64> = (0..readings.samples).map(|row| readings.row(row)[channel]).collect();
    let mut runs = runs_of(&column);
    runs.sort_by_key(Range::len);
    let longest = runs.pop()?;
    let mut others = Repeating::UNKNOWN;
    runs.iter().for_each(|run| others.end(run.len() as u64));
    let moves = |c: usize| {
        let rows = longest.clone().map(|row| readings.row(row)[c]);
        let reads: Vec<f64> = rows.collect();
        2 * runs_of(&reads).len() > longest.len()
    };
    let rare = others.chance(longest.len() as u64) < (CHANCE / readings.channels as f64).ln();
    let held = readings.pose[longest.start] == readings.pose[longest.end - 1];
    (rare && !held && (0..readings.channels).any(moves)).then_some(longest)
}
