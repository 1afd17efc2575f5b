//! Cross-validation: the error on whole poses left out in blocks of time.

use crate::Error;
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::stepwise::moves::Stepwise;
use crate::estimate::{Fit, Implicit, Observations, Part, fit};

/// Folds of the cross-validation.
const FOLDS: usize = 6;

/// Error on whole poses left out in blocks of time, everything refitted without them.
#[must_use]
pub fn held_out(observations: &Observations, full: &Fit) -> Option<HeldOut> {
    let poses = observations.readings.poses();
    let rows = observations.readings.rows_of_poses();
    let (mut chi2, mut square, mut equations) = (0.0, 0.0, 0.0);
    for fold in 0..FOLDS.min(poses) {
        let out = poses * fold / FOLDS.min(poses)..poses * (fold + 1) / FOLDS.min(poses);
        let mut training = observations.clone();
        for row in out.clone().flat_map(|p| &rows[p]) {
            training.weights[*row] = 0.0;
        }
        let trained = fit(&training, full.model.instances.clone(), Some(full)).ok()?;
        let part = Part {
            model: &trained.model,
            readings: &observations.readings,
            weights: Some(&observations.weights),
        };
        // A point that was left out whole is where the others' terms touch it.
        let (mut beta, mut placed) = (trained.beta.clone(), trained.beta.clone());
        trained.model.place_unknowns(&observations.readings, &mut placed);
        for first in trained.model.untouched(&observations.readings, &training.weights) {
            beta[first..first + 3].copy_from_slice(&placed[first..first + 3]);
        }
        let problem = Implicit::at(part, full);
        let residuals = problem.residuals(&beta, false);
        let k = residuals.equations;
        for row in out.flat_map(|p| rows[p].clone()).filter(|&r| observations.weights[r] > 0.0) {
            chi2 += residuals.whitened[row * k..(row + 1) * k].iter().map(|r| r * r).sum::<f64>();
            square += residuals.lengths[row * k..(row + 1) * k].iter().map(|r| r * r).sum::<f64>();
            equations += k as f64;
        }
    }
    (equations > 0.0).then(|| HeldOut {
        chi2_per_dof: chi2 / equations,
        rms_misclosure: (square / equations).sqrt(),
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
