//! Cross-validation: the error on whole poses left out in blocks of time.

use std::ops::Range;

use rayon::prelude::*;

use crate::Error;
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::stepwise::moves::Stepwise;
use crate::diagnosis::stretches::Stretches;
use crate::estimate::{Fit, Implicit, Misfit, Noise, Observations, Part, fit};

/// Folds of the cross-validation.
const FOLDS: usize = 6;

/// Error on whole poses left out in blocks of time, everything refitted without them.
#[must_use]
pub fn held_out(observations: &Observations, full: &Fit) -> Option<HeldOut> {
    errors(observations, full, |trained, out| {
        let model = &trained.model;
        let (readings, weights) = (&observations.readings, Some(&observations.weights[..]));
        let part = Part { model, readings, weights };
        let problem = Implicit::of(part, full.assumed())
            .from(trained.adjusted_of(readings).map(<[_]>::to_vec));
        let left_out = |row: usize| out.contains(&readings.pose[row]);
        problem.misfit(&trained.beta, |row| left_out(row) && observations.weights[row] > 0.0)
    })
}

/// The same of a long recording: fitted by stretches, `small`, without some of them, and judged by
/// all rows of these.
#[must_use]
pub fn held_out_rows(
    stretches: &Stretches,
    (small, full): (&Observations, &Fit),
    (all, noise): (&Observations, &Noise),
) -> Option<HeldOut> {
    let instances = full.model.instances.iter().map(|i| stretches.in_all(i)).collect();
    let model = all.model_after(Some(&full.model), instances).ok()?;
    let (readings, weights) = (&all.readings, Some(&all.weights[..]));
    errors(small, full, |trained, out| {
        let part = Part { model: &model, readings, weights };
        let problem = Implicit::of(part, noise.clone());
        let rows = stretches.rows(&out, readings.samples);
        problem.misfit(&trained.beta, |row| rows.contains(&row) && all.weights[row] > 0.0)
    })
}

/// Error on poses left out in blocks of time: `judge` says what a fit without them leaves there.
fn errors(
    observations: &Observations,
    full: &Fit,
    judge: impl Fn(&Fit, Range<usize>) -> Misfit,
) -> Option<HeldOut> {
    let readings = &observations.readings;
    let poses = readings.poses();
    let rows = readings.rows_of_poses();
    let folds = FOLDS.min(poses);
    let without = |fold: usize| {
        let out = poses * fold / folds..poses * (fold + 1) / folds;
        let mut training = observations.clone();
        for row in out.clone().flat_map(|p| &rows[p]) {
            training.weights[*row] = 0.0;
        }
        let mut trained = fit(&training, full.model.instances.clone(), Some(full)).ok()?;
        // A point that was left out whole is where the others' terms touch it.
        let mut placed = trained.beta.clone();
        trained.model.place_unknowns(readings, &mut placed);
        for k in trained.model.untouched(readings, &training.weights) {
            trained.beta[k] = placed[k];
        }
        Some((trained, out))
    };
    let trained: Option<Vec<_>> = (0..folds).into_par_iter().map(without).collect();
    let mut all = Misfit::default();
    for (trained, out) in trained? {
        let there = judge(&trained, out);
        all.chi2 += there.chi2;
        all.square += there.square;
        all.equations += there.equations;
    }
    (all.equations > 0.0).then(|| HeldOut {
        chi2_per_dof: all.chi2 / all.equations,
        rms_misclosure: (all.square / all.equations).sqrt(),
    })
}

/// Error on poses that were left out, the terms refitted without them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct HeldOut {
    /// χ² of the poses left out, per equation.
    pub chi2_per_dof: f64,
    /// Error of their closures, length units.
    pub rms_misclosure: f64,
}

/// A session with one sample for each held pose, and the same fit of it.
///
/// # Errors
///
/// As [`fit`].
pub fn averaged(observations: &Observations, full: &Fit) -> Result<(Observations, Fit), Error> {
    let search = SearchOptions::default();
    let mut stepwise = Stepwise::new(observations, full, &search)?;
    let mut small = fit(&stepwise.small, full.model.instances.clone(), Some(full))?;
    stepwise.rescale(&mut small)?;
    Ok((stepwise.small, small))
}
