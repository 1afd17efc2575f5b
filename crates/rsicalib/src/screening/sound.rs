//! The fit without what is wrong whatever the model lacks.
//!
//! Four held poses or more at an end of a session are not left out here as single ones: a sensor that
//! slipped before them explains them by one number, and which is likelier is for the price (113) to say.

use crate::Error;
use crate::estimate::{Fit, Observations, fit};
use crate::screening::excluded::{Cause, Excluded};
use crate::screening::steps::SIDE;
use crate::screening::{converter, outliers, placements};

/// The fit without what is wrong whatever the model lacks, which is left out of the
/// session: faults of converters, single bad samples, placements.
///
/// # Errors
///
/// As [`fit`].
pub fn sound(observations: &mut Observations, before: &Fit) -> Result<(Fit, Vec<Excluded>), Error> {
    let base = &before.model.instances;
    let faults = converter::faults(&observations.mechanism, &observations.readings);
    let mut excluded = converter::set_apart(observations, before, &faults);
    let sound = if excluded.is_empty() {
        before.clone()
    } else {
        converter::seen_by(before, fit(observations, base.clone(), Some(before))?)
    };
    let faulty = excluded.len();
    excluded.extend(outliers::samples(observations, &sound));
    let weights = observations.weights.clone();
    let found = placements::find(observations, &sound)?;
    excluded.extend(without_an_end(observations, &weights, found));
    let clean = if excluded.len() == faulty {
        sound
    } else {
        converter::seen_by(before, fit(observations, base.clone(), Some(&sound))?)
    };
    Ok((clean, excluded))
}

/// Poses at an end of a session that are left out one by one are looked at by the search, if they are as many
/// as must stand on either side of a move; `weights` are those before they were left out.
fn without_an_end(
    observations: &mut Observations,
    weights: &[f64],
    mut found: Vec<Excluded>,
) -> Vec<Excluded> {
    let readings = &observations.readings;
    if !readings.held || !readings.ordered {
        return found;
    }
    let rows = readings.rows_of_poses();
    let live = |pose: &usize| rows[*pose].iter().any(|row| observations.weights[*row] > 0.0);
    let alone = |pose: usize| {
        let single = |it: &Excluded| matches!(it.cause, Cause::Sample { .. });
        found.iter().any(|it| it.pose == Some(pose) && single(it))
    };
    let (Some(first), Some(last)) = ((0..rows.len()).find(live), (0..rows.len()).rev().find(live))
    else {
        return found;
    };
    let ends = [(0..first).collect::<Vec<_>>(), (last + 1..rows.len()).collect()];
    let kept: Vec<usize> = ends
        .into_iter()
        .map(|end| end.into_iter().filter(|pose| alone(*pose)).collect::<Vec<_>>())
        .filter(|end| end.len() >= SIDE)
        .flatten()
        .collect();
    for row in kept.iter().flat_map(|pose| &rows[*pose]) {
        observations.weights[*row] = weights[*row];
    }
    found.retain(|it| it.pose.is_none_or(|pose| !kept.contains(&pose)));
    found
}
