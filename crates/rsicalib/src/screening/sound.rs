//! The fit without what is wrong whatever the model lacks.
//!
//! A point or a tool that moved at one row of its run, and a placement that does not fit its siblings, may be a
//! sensor that slipped: one number explains the same rows, and which is likelier is for the price (113) to say. A search
//! sees these rows first, where their order is told. So it does four held poses or more at an end of a session.

use crate::Error;
use crate::estimate::{Fit, Observations, fit};
use crate::screening::excluded::{Cause, Excluded};
use crate::screening::placements::Damage;
use crate::screening::steps::SIDE;
use crate::screening::{converter, outliers, placements};

/// Which rows stay that do not fit their placement: the search may explain them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// None.
    Nothing,
    /// Those that something which happened once may explain.
    Once,
    /// All.
    All,
}

/// The fit without what is wrong whatever the model lacks, which is left out of the
/// session: faults of converters, single bad samples, placements.
///
/// # Errors
///
/// As [`fit`].
pub fn sound(
    observations: &mut Observations,
    before: &Fit,
    kept: Kept,
) -> Result<(Fit, Vec<Excluded>), Error> {
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
    if kept != Kept::All {
        let damage = placements::find(observations, &sound)?;
        excluded.extend(kept_in(observations, &weights, damage, kept == Kept::Once));
    }
    let clean = if excluded.len() == faulty {
        sound
    } else {
        converter::seen_by(before, fit(observations, base.clone(), Some(&sound))?)
    };
    Ok((clean, excluded))
}

/// The damage that stays left out, after rows are kept in that the search may explain; `weights` are those before
/// any was left out.
fn kept_in(
    observations: &mut Observations,
    weights: &[f64],
    damage: Vec<Damage>,
    once: bool,
) -> Vec<Excluded> {
    let ends = ends(observations, &damage);
    let once = once && observations.readings.ordered;
    let explicable = |Damage { found, .. }: &Damage| match found.cause {
        Cause::Moved { .. } | Cause::Placement { .. } => once,
        _ => found.pose.is_some_and(|pose| ends.contains(&pose)),
    };
    let (kept, out): (Vec<Damage>, Vec<Damage>) = damage.into_iter().partition(explicable);
    for row in kept.into_iter().flat_map(|damage| damage.rows) {
        observations.weights[row] = weights[row];
    }
    out.into_iter().map(|damage| damage.found).collect()
}

/// Poses at an end of a session that are left out one by one, if they are as many as must stand on either
/// side of a move.
fn ends(observations: &Observations, damage: &[Damage]) -> Vec<usize> {
    let readings = &observations.readings;
    if !readings.held || !readings.ordered {
        return Vec::new();
    }
    let rows = readings.rows_of_poses();
    let live = |pose: &usize| rows[*pose].iter().any(|row| observations.weights[*row] > 0.0);
    let alone = |pose: usize| {
        let single = |it: &Excluded| matches!(it.cause, Cause::Sample { .. });
        damage.iter().any(|it| it.found.pose == Some(pose) && single(&it.found))
    };
    let (Some(first), Some(last)) = ((0..rows.len()).find(live), (0..rows.len()).rev().find(live))
    else {
        return Vec::new();
    };
    [(0..first).collect::<Vec<_>>(), (last + 1..rows.len()).collect()]
        .into_iter()
        .map(|end| end.into_iter().filter(|pose| alone(*pose)).collect::<Vec<_>>())
        .filter(|end| end.len() >= SIDE)
        .flatten()
        .collect()
}
