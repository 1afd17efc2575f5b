//! Stretches of a recording in which nothing moves.
//!
//! A stretch is still if each channel, in every window of the least length, stays within what its own
//! noise does to as many rows in all but one of 10 000 cases, or within two steps of its converter.
//! The noise is what neighbouring rows differ by (von Neumann 1941): motion, which goes on from row to
//! row, adds little to that and much to the range.

use crate::numerics::order;
use std::ops::Range;

use crate::numerics::distributions::normal_quantile;
use crate::numerics::median::median;
use crate::readings::table::runs_of;

/// Probability with which noise alone keeps all rows of a window within the limits.
const INSIDE: f64 = 0.9999;

/// The noise of a channel is that of the quietest tenth of the windows.
const QUIET: f64 = 0.1;

/// Part of the largest reading below which a difference is rounding.
const ROUNDING: f64 = 1e-9;

/// The rows of each still stretch of at least `hold` seconds, in order; stretches do not overlap.
///
/// `values` holds the readings row by row, as many for each row of `time` (s). A gap of more than
/// `hold`, or a step back, ends a stretch, and `inside` says which rows may belong to one.
#[must_use]
pub fn still_stretches(
    values: &[f64],
    time: &[f64],
    hold: f64,
    inside: Option<&[bool]>,
) -> Vec<Range<usize>> {
    let (n, channels) = (time.len(), values.len() / time.len().max(1));
    let steps: Vec<f64> = time.windows(2).map(|both| both[1] - both[0]).collect();
    let apart = median(steps.iter().copied().filter(|step| *step > 0.0).collect());
    let rows = ((hold / apart - 1e-9).ceil() as usize).saturating_add(1).max(2);
    if apart.is_nan() || n < rows {
        return Vec::new();
    }
    let mut quiet = vec![true; n - rows + 1];
    for channel in 0..channels {
        let column: Vec<f64> = values.iter().skip(channel).step_by(channels).copied().collect();
        let (high, low) = (running(&column, rows, f64::max), running(&column, rows, f64::min));
        let limit = limit(&column, rows);
        let ends = high.iter().zip(&low);
        quiet.iter_mut().zip(ends).for_each(|(quiet, (high, low))| *quiet &= high - low <= limit);
    }
    let of_other = |row: usize| inside.is_some_and(|inside| inside[row] != inside[row - 1]);
    let is_broken = |row: usize| steps[row - 1] > hold || steps[row - 1] < 0.0 || of_other(row);
    let mut end = n; // of what goes on from a row
    for row in (0..n).rev() {
        if let Some(quiet) = quiet.get_mut(row) {
            *quiet &= row + rows <= end && inside.is_none_or(|inside| inside[row]);
        }
        end = if row > 0 && is_broken(row) { row } else { end };
    }
    let mut found: Vec<Range<usize>> = Vec::new();
    for windows in runs_of(&quiet).into_iter().filter(|run| quiet[run.start]) {
        let start = windows.start.max(found.last().map_or(0, |last| last.end));
        let end = windows.end - 1 + rows;
        if end - start >= rows {
            found.push(start..end);
        }
    }
    found
}

/// Greatest or least of so many rows, from each row on: windows of twice the width in turn.
fn running(column: &[f64], rows: usize, pick: fn(f64, f64) -> f64) -> Vec<f64> {
    let (mut out, mut width) = (column.to_vec(), 1);
    while 2 * width <= rows {
        out = out.iter().zip(&out[width..]).map(|(a, b)| pick(*a, *b)).collect();
        width *= 2;
    }
    (0..=column.len() - rows).map(|row| pick(out[row], out[row + rows - width])).collect()
}

/// Range within which a channel stays in so many rows while nothing moves.
fn limit(column: &[f64], rows: usize) -> f64 {
    let mut sums = vec![0.0];
    for both in column.windows(2) {
        sums.push(sums[sums.len() - 1] + (both[1] - both[0]).powi(2));
    }
    let pairs = (rows - 1) as f64;
    let windows = sums.iter().zip(&sums[rows - 1..]);
    let mut noise: Vec<f64> = windows.map(|(a, b)| ((b - a) / (2.0 * pairs)).sqrt()).collect();
    order::sort(&mut noise);
    let at = QUIET * (noise.len() - 1) as f64;
    let (below, above) = (noise[at.floor() as usize], noise[at.ceil() as usize]);
    let sigma = below + (above - below) * at.fract();
    let width = 2.0 * normal_quantile(1.0 - (1.0 - INSIDE) / (2.0 * rows as f64));
    (width * sigma).max(2.0 * step(column))
}

/// Smallest difference between readings of a channel: the step of its converter; 0 for none.
fn step(column: &[f64]) -> f64 {
    let mut sorted = column.to_vec();
    order::sort(&mut sorted);
    let largest = column.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let gaps = sorted.windows(2).map(|both| both[1] - both[0]);
    gaps.filter(|gap| *gap > ROUNDING * largest).reduce(f64::min).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::running;

    #[test]
    fn running_extremes_are_those_of_windows() {
        let column: Vec<f64> = (0..60_u32).map(|k| f64::from(k * k * 7919 % 101)).collect();
        for rows in [2, 3, 7, 8, 50] {
            let largest = |window: &[f64]| window.iter().copied().fold(0.0, f64::max);
            let expected: Vec<f64> = column.windows(rows).map(largest).collect();
            assert_eq!(running(&column, rows, f64::max), expected);
        }
    }
}
