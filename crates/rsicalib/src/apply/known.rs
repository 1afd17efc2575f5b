//! Known poses beside readings: which rows each belongs to.

use std::ops::Range;

use crate::readings::{Table, runs_of_poses};

/// The rows that have one known pose, run by run of held poses: the samples that have the same one
/// together, and each sample by itself where an instrument has followed a pose that trembled.
///
/// Rows without a known pose are in none.
#[must_use]
pub(crate) fn rows_of_known(
    table: &Table,
    channels: usize,
    known: &[[f64; 6]],
) -> Vec<Vec<Range<usize>>> {
    let mut found = Vec::new();
    for run in runs_of_poses(table, channels) {
        let mut parts: Vec<Range<usize>> = Vec::new();
        for row in run.filter(|&row| known[row].iter().all(|v| v.is_finite())) {
            match parts.last_mut() {
                Some(part) if part.end == row && known[part.start] == known[row] => part.end += 1,
                _ => parts.push(row..row + 1),
            }
        }
        if !parts.is_empty() {
            found.push(parts);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_have_the_known_pose_of_their_own() {
        let at = |x: f64| [x, 0.0, 0.0, 0.0, 0.0, 0.0];
        let known = [at(1.0), at(1.0), at(2.0), at(2.5), at(f64::NAN), at(4.0)];
        let pose = Some(vec![1, 1, 2, 2, 3, 3]);
        let table = Table { values: vec![0.0; 6], pose, ..Table::default() };
        let found = rows_of_known(&table, 1, &known);
        let ends = |runs: &Vec<std::ops::Range<usize>>| {
            runs.iter().map(|run| [run.start, run.end]).collect::<Vec<_>>()
        };
        let found: Vec<_> = found.iter().map(ends).collect();
        assert_eq!(found, [vec![[0, 2]], vec![[2, 3], [3, 4]], vec![[5, 6]]]);
    }
}
