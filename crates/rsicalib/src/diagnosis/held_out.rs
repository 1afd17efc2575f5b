//! Cross-validation: the error on whole poses left out in blocks of time.
//!
//! What a block `o` adds to the least χ² is, were the model right,
//!
//! ```text
//! d_o = χ²(β̂) - χ²_o(β̂_o) ~ χ²(n_o - u_o)                                 (111)
//! ```
//!
//! with `β̂_o` and `χ²_o` of all but the block, its `n_o` equations, and `u_o` unknown coordinates of
//! what is touched in it alone. The least probable of the blocks is paid for by their number.

use std::ops::Range;

use crate::Error;
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::score::scored::Judge;
use crate::diagnosis::stretches::Stretches;
use crate::estimate::{
    Fit, Implicit, Misfit, Noise, Observations, Part, fit, place_untouched, with_conventions,
};
use crate::numerics::workers;

/// Folds of the cross-validation.
const FOLDS: usize = 6;

/// Error on whole poses left out in blocks of time, everything refitted without them.
#[must_use]
pub fn held_out(observations: &Observations, full: &Fit, judge: &Judge) -> Option<HeldOut> {
    errors(observations, full, judge, |trained, out| {
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
    judge: &Judge,
) -> Option<HeldOut> {
    let instances = full.model.instances.iter().map(|i| stretches.in_all(i)).collect();
    let model = all.model_after(Some(&full.model), instances).ok()?;
    let (readings, weights) = (&all.readings, Some(&all.weights[..]));
    errors(small, full, judge, |trained, out| {
        let part = Part { model: &model, readings, weights };
        let problem = Implicit::of(part, noise.clone());
        let rows = stretches.rows(&out, readings.samples);
        problem.misfit(&trained.beta, |row| rows.contains(&row) && all.weights[row] > 0.0)
    })
}

/// Error on poses left out in blocks of time: `misfit` says what a fit without them leaves there.
fn errors(
    observations: &Observations,
    full: &Fit,
    judge: &Judge,
    misfit: impl Fn(&Fit, Range<usize>) -> Misfit,
) -> Option<HeldOut> {
    let readings = &observations.readings;
    let poses = readings.poses();
    let rows = readings.rows_of_poses();
    let folds = FOLDS.min(poses);
    let (judge, noise) = (judge.of(full), full.assumed());
    let whole = chi2(observations, full, &noise, &observations.weights);
    // In units of what the judge takes to be left of the whole.
    let measure = judge.residual.map_or(1.0, |[total, _]| total / whole);
    let without = |fold: usize| {
        let out = poses * fold / folds..poses * (fold + 1) / folds;
        let mut training = observations.clone();
        for row in out.clone().flat_map(|p| &rows[p]) {
            training.weights[*row] = 0.0;
        }
        let mut trained = fit(&training, full.model.instances.clone(), Some(full)).ok()?;
        let left = chi2(observations, &trained, &noise, &training.weights);
        // A point that was left out whole is where the others' terms touch it.
        let untouched = place_untouched(observations, &mut trained, &training.weights, &noise);
        let told = |weights: &[f64]| full.model.told_by(readings, weights) as f64;
        let width = told(&observations.weights) - told(&training.weights) - untouched.len() as f64;
        let more = (whole - left).clamp(0.0, f64::INFINITY);
        let known = width > 0.0 && !more.is_nan();
        let p_value = known.then(|| judge.p_value(more * measure, width));
        Some((trained, out, p_value))
    };
    let trained: Option<Vec<_>> = workers::map(0..folds, without).into_iter().collect();
    let mut all = Misfit::default();
    let mut least: Option<f64> = None;
    for (trained, out, p_value) in trained? {
        least = least.into_iter().chain(p_value).reduce(f64::min);
        let there = misfit(&trained, out);
        all.chi2 += there.chi2;
        all.square += there.square;
        all.equations += there.equations;
        all.misclosures += there.misclosures;
    }
    (all.equations > 0.0).then(|| HeldOut {
        chi2_per_dof: all.chi2 / all.equations,
        rms_misclosure: (all.square / all.misclosures).sqrt(),
        p_value: least.map(|p| (folds as f64 * p).min(1.0)).filter(|p| p.is_finite()),
    })
}

/// What the rows of a session leave at a fit, priors included, with the noise of another one.
fn chi2(observations: &Observations, fitted: &Fit, noise: &Noise, weights: &[f64]) -> f64 {
    let readings = &observations.readings;
    let part = Part { model: &fitted.model, readings, weights: Some(weights) };
    let problem =
        Implicit::of(part, noise.clone()).from(fitted.adjusted_of(readings).map(<[_]>::to_vec));
    let left = problem.misfit(&fitted.beta, |row| weights[row] > 0.0).chi2;
    left + fitted.priors.iter().map(|prior| prior.off(&fitted.beta).powi(2)).sum::<f64>()
}

/// Error on poses that were left out, the terms refitted without them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct HeldOut {
    /// χ² of the poses left out, per equation.
    pub chi2_per_dof: f64,
    /// Error of their closures, in `misclosure_unit`. Of a held pose it is that of the mean of its samples, while
    /// `rms_misclosure` of the fit is of single samples.
    pub rms_misclosure: f64,
    /// Probability by chance of poses that fit so badly to the others.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub p_value: Option<f64>,
}

/// A session with one sample for each held pose, the same fit of it, and how that is judged.
///
/// # Errors
///
/// As [`fit`].
pub fn averaged(
    observations: &Observations,
    full: &Fit,
) -> Result<(Observations, Fit, Judge), Error> {
    let search = SearchOptions::default();
    let mut averaged = Averaged::new(observations, full, &search)?;
    let mut small = fit(&averaged.small, full.model.instances.clone(), Some(full))?;
    averaged.rescale(&mut small)?;
    let judge = averaged.judge(&small);
    let small = with_conventions(&averaged.small, small);
    Ok((averaged.small, small, judge))
}
