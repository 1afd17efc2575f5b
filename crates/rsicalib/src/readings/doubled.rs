//! Rows of a held pose that are an earlier row of that pose over again.

use std::collections::HashSet;

use crate::readings::codes;

/// Rows whose readings are those of an earlier row of their pose, to the last digit of every channel.
///
/// Noise is never the same twice: a logger has written such a row again, and it says nothing new. Only where every
/// channel reads in steps, or stands, a sensor may well read the same twice. `values` holds the readings row by row,
/// `counts` says which channels are counters, `poses` holds the rows of each pose.
#[must_use]
pub fn doubled(values: &[f64], counts: &[bool], poses: &[Vec<usize>]) -> Vec<usize> {
    let channels = counts.len();
    let bits = |row: usize| values[row * channels..][..channels].iter().map(|v| v.to_bits());
    let again = |rows: &Vec<usize>| {
        let mut seen = HashSet::new();
        let again = |row: &&usize| rows.len() > 1 && !seen.insert(bits(**row).collect::<Vec<_>>());
        rows.iter().filter(again).copied().collect::<Vec<_>>()
    };
    let mut rows: Vec<usize> = poses.iter().flat_map(again).collect();
    if rows.is_empty() || !(0..channels).any(|c| reads_finely(values, counts, poses, c)) {
        return Vec::new();
    }
    rows.sort_unstable();
    rows
}

/// True for a channel that reads in no steps, and something else in most poses.
fn reads_finely(values: &[f64], counts: &[bool], poses: &[Vec<usize>], channel: usize) -> bool {
    let read = |row: usize| values[row * counts.len() + channel];
    let first = poses.iter().filter_map(|rows| rows.first());
    let apart: HashSet<u64> = first.map(|row| read(*row).to_bits()).collect();
    2 * apart.len() > poses.len() && codes::step_of(values, counts, true, channel) == 0.0
}

#[cfg(test)]
mod tests {
    use super::doubled;

    /// Readings of 20 poses, three rows each, of which the last is the first again in every fourth pose.
    fn rows(read: impl Fn(usize) -> f64) -> (Vec<f64>, Vec<Vec<usize>>) {
        let of = |row: usize| if row % 12 == 2 { row - 2 } else { row };
        let poses = (0..20).map(|pose| (3 * pose..3 * pose + 3).collect()).collect();
        ((0..60).flat_map(|row| [read(of(row)), 1.0]).collect(), poses)
    }

    /// Numbers between 0 and 1 that follow no rule.
    fn odd(i: usize) -> f64 {
        (0.5 + 0.618_033_988_749_895 * (i * i) as f64).fract()
    }

    #[test]
    fn rows_that_are_written_again_are_found_beside_a_channel_that_stands() {
        let (values, poses) = rows(|row| (row / 3) as f64 + 0.01 * odd(row));
        assert_eq!(doubled(&values, &[false; 2], &poses), [2, 14, 26, 38, 50]);
    }

    #[test]
    fn codes_that_come_again_are_readings() {
        let (values, poses) = rows(|row| (10.0 * (row / 3) as f64 + 3.0 * odd(row)).floor());
        assert!(doubled(&values, &[true, false], &poses).is_empty());
        let (values, poses) = rows(|row| 0.1 * (10.0 * odd(row / 3) + 3.0 * odd(row)).floor());
        assert!(doubled(&values, &[false; 2], &poses).is_empty());
    }
}
