//! Poses that are enough to tell which mistakes of wires are likeliest.

use std::collections::HashSet;

use crate::estimate::observations::Observations;
use crate::model::{Instance, Model};
use crate::numerics::random::Random;

/// Equations for each parameter by which mistakes are compared: a bound on time, since what is likeliest is then
/// held against all poses.
const PER_PARAMETER: usize = 5;

/// What a row says beside its numbers: its pose, its keys, and which of its columns have a number.
type Kind<'a> = (usize, Vec<&'a str>, Vec<bool>);

/// A few poses that chance chooses, each by one row of what it touches, and the terms that do not ask for the
/// way to a pose; none where all are few, or a pose has unknowns of its own.
pub(crate) fn enough(
    observations: &Observations,
    model: &Model,
) -> Option<(Observations, Vec<Instance>)> {
    if model.pose_unknowns() > 0 {
        return None;
    }
    let readings = &*observations.readings;
    let wanted = PER_PARAMETER * model.parameters;
    let mut poses = poses(observations);
    let order = Random::new(poses.len() as u64).choose(poses.len(), poses.len());
    let (mut told, mut rows) = (0, Vec::new());
    for pose in order {
        if told >= wanted {
            break;
        }
        told += poses[pose].iter().map(|&row| model.told(readings, row)).sum::<usize>();
        rows.append(&mut poses[pose]);
    }
    if told < wanted || rows.len() == readings.samples {
        return None;
    }
    rows.sort_unstable();
    let table = readings.table.some(readings.channels, &rows);
    let (mechanism, rest) = (&observations.mechanism, observations.rest.clone());
    let few = Observations::new(mechanism, table, rest, observations.options.clone()).ok()?;
    let terms = model.instances.iter().filter(|i| i.term.of_pose()).cloned().collect();
    Some((few, terms))
}

/// For each pose the first row of each kind, of rows that are not left out.
fn poses(observations: &Observations) -> Vec<Vec<usize>> {
    let readings = &*observations.readings;
    let table = &readings.table;
    let mut poses: Vec<Vec<usize>> = Vec::new();
    let mut seen: HashSet<Kind<'_>> = HashSet::new();
    for row in (0..readings.samples).filter(|&row| observations.weights[row] > 0.0) {
        let pose = readings.pose[row];
        let keys = table.keys.iter().map(|key| key[row].as_str()).collect();
        let there = table.columns.iter().map(|column| !column[row].is_nan()).collect();
        if seen.insert((pose, keys, there)) {
            poses.resize_with(poses.len().max(pose + 1), Vec::new);
            poses[pose].push(row);
        }
    }
    poses
}
