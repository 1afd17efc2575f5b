//! Context of a sample: the direction from which each channel came to its reading, and its velocity.
//!
//! The direction of approach of a held pose is the sign of the change from the pose before. In
//! a recording, the direction is the sign of the velocity. Velocities are slopes of a local
//! parabola, so that the noise of a single reading hardly enters them.
//!
//! A file without labels of poses may be a recording, or a list of poses that were read once each.
//! Only where neighbouring rows keep to lines, [`is_motion`], slopes say anything of a row.

use crate::mechanism::{Channel, Mechanism};
use crate::readings::table::Table;

/// Changes by fewer counts than this from pose to pose have no direction.
const STANDSTILL: f64 = 3.0;

/// [`STANDSTILL`] of every channel in its unit, of readings with these spans: for an encoder, the same share of the range as
/// 3 of 4096 counts.
#[must_use]
pub(crate) fn standstills(mechanism: &Mechanism, span: &[[f64; 2]]) -> Vec<f64> {
    let of = |(channel, own): (usize, &Channel)| match own.counts() {
        true => STANDSTILL,
        false => STANDSTILL * mechanism.half_range_in(channel, span[channel]) / 2048.0,
    };
    mechanism.channels.iter().enumerate().map(of).collect()
}

/// Rows to either side in the local fit of a velocity.
const REACH: usize = 8;

/// Direction of approach of every row, one per channel: -1, 0 or 1. `still` is [`standstills`].
#[must_use]
pub fn sides(table: &Table, pose: &[usize], still: &[f64], held: bool) -> Vec<i8> {
    if held { of_poses(table, pose, still) } else { of_recording(table, still) }
}

/// Rows over which a motion is nearly a line.
pub(crate) const STRETCH: usize = 8;

/// Share of the variance of readings that may lie about lines over stretches of a motion.
/// Poses in random order have all of it there, and a motion of which a stretch is an eighth
/// of a turn has 1e-4. Half a turn in a stretch has this share: a parabola over twice as many
/// rows, which velocities are from, says nothing of their slope any more.
const NO_MOTION: f64 = 0.1;

/// True where readings keep to a line over these `stretches` of rows, as far as they go in all.
/// Rows that are poses of their own do not. `mean` and `span` are those of each channel.
pub(crate) fn is_motion(
    table: &Table,
    stretches: &[impl AsRef<[usize]>],
    mean: &[f64],
    span: &[[f64; 2]],
) -> bool {
    let channels = mean.len();
    let stretches = || stretches.iter().map(AsRef::as_ref).filter(|rows| rows.len() > 2);
    let (mut off, mut all) = (0.0, 0.0);
    for c in 0..channels {
        let [low, high] = span[c];
        if high <= low {
            continue;
        }
        let (mut within, mut free, mut about) = (0.0, 0.0, 0.0);
        for rows in stretches() {
            let mut values: Vec<f64> =
                rows.iter().map(|&r| table.values[r * channels + c]).collect();
            about += values.iter().map(|v| (v - mean[c]).powi(2)).sum::<f64>();
            detrend(&mut values, 2);
            within += values.iter().map(|v| v * v).sum::<f64>();
            free += 1.0 - 2.0 / rows.len() as f64;
        }
        off += within / free.max(1.0) * stretches().count() as f64 / (high - low).powi(2);
        all += about / (high - low).powi(2);
    }
    off < NO_MOTION * all
}

/// Takes a mean (`order` 1), or a line as well (2), from values in equal steps.
pub(crate) fn detrend(values: &mut [f64], order: usize) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let middle = 0.5 * (n - 1.0);
    let mut slope = 0.0;
    if order > 1 {
        let moment: f64 = (0..values.len()).map(|i| (i as f64 - middle).powi(2)).sum();
        slope =
            values.iter().enumerate().map(|(i, v)| (i as f64 - middle) * v).sum::<f64>() / moment;
    }
    for (i, value) in values.iter_mut().enumerate() {
        *value -= mean + slope * (i as f64 - middle);
    }
}

fn of_poses(table: &Table, pose: &[usize], still: &[f64]) -> Vec<i8> {
    let channels = still.len();
    let poses = pose.iter().max().map_or(0, |p| p + 1);
    let mut mean = vec![0.0; poses * channels];
    let mut count = vec![0.0_f64; poses];
    for (row, &p) in pose.iter().enumerate() {
        count[p] += 1.0;
        for c in 0..channels {
            mean[p * channels + c] += table.values[row * channels + c];
        }
    }
    for (k, sum) in mean.iter_mut().enumerate() {
        *sum /= count[k / channels];
    }
    let mut from = vec![0; poses * channels];
    for row in 1..pose.len() {
        let (p, before) = (pose[row], pose[row - 1]);
        if p == before || table.session_of(row) != table.session_of(row - 1) {
            continue;
        }
        for c in 0..channels {
            let change = mean[p * channels + c] - mean[before * channels + c];
            from[p * channels + c] = direction(change, still[c]) as i8;
        }
    }
    pose.iter().flat_map(|&p| from[p * channels..(p + 1) * channels].to_vec()).collect()
}

fn of_recording(table: &Table, still: &[f64]) -> Vec<i8> {
    let channels = still.len();
    let rows = table.values.len() / channels;
    let mut sides = vec![0; rows * channels];
    let mut slopes = Slopes::of(table, channels);
    for row in 0..rows {
        let reach = slopes.at(row);
        for c in 0..channels {
            // A change over the window that noise alone can make has no direction.
            let side = direction(slopes.slope[c] * reach, still[c]) as i8;
            // A channel that stands still keeps the direction of its last motion.
            let lasts = side == 0 && row > 0 && table.session_of(row) == table.session_of(row - 1);
            sides[row * channels + c] = if lasts { sides[(row - 1) * channels + c] } else { side };
        }
    }
    sides
}

/// Velocity of some rows of a recording, one per channel: readings per second, per row without a
/// time column.
#[must_use]
pub fn velocities(table: &Table, channels: usize, rows: impl Iterator<Item = usize>) -> Vec<f64> {
    let mut slopes = Slopes::of(table, channels);
    let mut found = Vec::new();
    for row in rows {
        slopes.at(row);
        found.extend_from_slice(&slopes.slope);
    }
    found
}

/// Slopes of a recording, row by row.
struct Slopes<'a> {
    table: &'a Table,
    /// The slope of each channel.
    slope: Vec<f64>,
    near: Vec<usize>,
}

impl<'a> Slopes<'a> {
    fn of(table: &'a Table, channels: usize) -> Self {
        Self { table, slope: vec![0.0; channels], near: Vec::with_capacity(2 * REACH + 1) }
    }

    /// Finds the slopes at a row; gives how long the window about it is.
    fn at(&mut self, row: usize) -> f64 {
        let Self { table, slope, near } = self;
        let channels = slope.len();
        let rows = table.values.len() / channels;
        let clock = |row: usize| table.time.as_ref().map_or(row as f64, |t| t[row]);
        near.clear();
        let window = row.saturating_sub(REACH)..(row + REACH + 1).min(rows);
        near.extend(window.filter(|&r| table.session_of(r) == table.session_of(row)));
        let weights = slope_weights(near, |r| clock(r) - clock(row));
        for (c, slope) in slope.iter_mut().enumerate() {
            let value = |r: usize| table.values[r * channels + c];
            *slope = near.iter().zip(&weights).map(|(&r, w)| w * value(r)).sum();
        }
        near.last().map_or(0.0, |&last| clock(last) - clock(near[0]))
    }
}

pub(crate) fn direction(change: f64, standstill: f64) -> f64 {
    if change.abs() < standstill { 0.0 } else { change.signum() }
}

/// Weights that give the slope at zero of a least-squares parabola.
fn slope_weights(near: &[usize], at: impl Fn(usize) -> f64) -> Vec<f64> {
    let n = near.len() as f64;
    let t: Vec<f64> = near.iter().map(|&r| at(r)).collect();
    let moment = |k: i32| t.iter().map(|t| t.powi(k)).sum::<f64>() / n;
    let (m1, m2, m3, m4) = (moment(1), moment(2), moment(3), moment(4));
    let normal = nalgebra::Matrix3::new(1.0, m1, m2, m1, m2, m3, m2, m3, m4);
    // Scaled by the spread of t, so that the matrix is near unit.
    let scale = nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::new(
        1.0,
        1.0 / m2.max(f64::MIN_POSITIVE).sqrt(),
        1.0 / m2.max(f64::MIN_POSITIVE),
    ));
    let Some(inverse) = (scale * normal * scale).try_inverse() else {
        return vec![0.0; near.len()];
    };
    let solve = scale * inverse * scale;
    t.iter().map(|t| (solve[(1, 0)] + solve[(1, 1)] * t + solve[(1, 2)] * t * t) / n).collect()
}
