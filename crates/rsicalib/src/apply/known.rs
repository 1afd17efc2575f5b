//! Known poses beside readings: which rows each belongs to.

use std::ops::Range;

use crate::Error;
use crate::mechanism::Mechanism;
use crate::readings::{Table, runs_of_poses};
use crate::text::{listed, quoted};

/// Known poses, or known places of a point that a chain carries, for the error of a calibration.
#[derive(Debug, Clone)]
pub struct Known {
    /// Readings in them.
    pub table: Table,
    /// `x y z rx ry rz` [length unit, rad], row by row: NaN where nothing is known. Without an
    /// orientation it is a place.
    pub poses: Vec<[f64; 6]>,
    /// Which point the places are of, where chains carry several.
    pub point: Option<String>,
    /// Standard deviations of what is known: of a coordinate of a place [length unit], of an angle (rad);
    /// zero where it is exact.
    pub noise: [f64; 2],
    /// True where they are known up to a rigid motion of the instrument.
    pub align: bool,
    /// True where the readings say what closures touch and measure, so that their loops can be looked at.
    pub closes: bool,
}

impl Known {
    /// The same, read after a session whose clock does not tell when they were.
    pub(crate) fn after(&self, session: &Table) -> Self {
        let mut known = self.clone();
        known.table.read_after(session);
        known
    }

    /// What is known: the platform, or the number of a point among those that chains carry.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`] where there is neither, or where orientations are known of a point;
    /// [`Error::Option`] where chains carry several points, and none of them is named.
    pub(crate) fn carried(&self, mechanism: &Mechanism) -> Result<Option<usize>, Error> {
        let missing = |needs, why| Err(Error::missing(&mechanism.name, needs, why));
        if self.point.is_none() && !mechanism.platform.is_empty() {
            return Ok(None);
        }
        if self.poses.iter().flat_map(|pose| &pose[3..]).any(|v| v.is_finite()) {
            return missing("platform", "poses need the points that carry it");
        }
        let carried = mechanism.points.iter().filter(|p| p.chain.is_some());
        let names: Vec<String> = carried.map(|p| p.name.clone()).collect();
        match (&self.point, names.len()) {
            (_, 0) => missing("point on a chain", "there is nothing whose place could be told"),
            (None, 1) => Ok(Some(0)),
            (point, _) => {
                let at = names.iter().position(|name| point.as_ref() == Some(name));
                let found = || point.as_deref().map_or("none".into(), quoted);
                let expected = || format!("the point whose places are known: {}", listed(&names));
                at.map(Some).ok_or_else(|| Error::option("check_point", found(), expected()))
            }
        }
    }
}

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
        for row in run.filter(|&row| is_known(&known[row])) {
            match parts.last_mut() {
                Some(part) if part.end == row && same(&known[part.start], &known[row]) => {
                    part.end += 1
                }
                _ => parts.push(row..row + 1),
            }
        }
        if !parts.is_empty() {
            found.push(parts);
        }
    }
    found
}

/// True where a place is known, with or without an orientation.
fn is_known(pose: &[f64; 6]) -> bool {
    let turned = pose[3..].iter().filter(|v| v.is_finite()).count();
    pose[..3].iter().all(|v| v.is_finite()) && (turned == 0 || turned == 3)
}

/// True where two poses are the same, orientations that are not known included.
fn same(a: &[f64; 6], b: &[f64; 6]) -> bool {
    a.iter().zip(b).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
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
