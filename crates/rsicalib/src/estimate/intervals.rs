//! Intervals of parameters where the linear ones are not those of 95 %.
//!
//! `value ± 1.96 sd` is the interval of a parameter on which the readings depend linearly, beside noise that is
//! known. Few degrees of freedom of the noise make it wider, Student's, and where the readings bend within
//! it, its ends are those of the profile likelihood (151): of weak directions, of gains near their
//! prior, near singular poses.

use crate::estimate::conclusion::widening;
use crate::estimate::conventions;
use crate::estimate::directions::as_reported;
use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::objective::Part;
use crate::estimate::observations::{LONG, Observations};
use crate::estimate::options::Method;
use crate::estimate::significance::NORMAL_95;
use crate::model::{Model, Prior};
use crate::numerics::distributions::student_quantile;
use crate::numerics::linearization::Problem;
use crate::numerics::lm::{self, SolverOptions};
use crate::numerics::profile::{Along, OFF, ends};

/// Both tails of an interval of 95 %, the upper one cut off.
const UPPER: f64 = 0.975;

/// Ends of 95 % of each parameter as it is reported, from its value: infinite where the readings do not
/// bound it, none where they are those of `± 1.96 sd`, to 4.4 % of them.
///
/// Not looked at: points that were touched, parameters of a convention, sessions of more than
/// 8192 samples, and fits that are no maximum of the likelihood.
#[must_use]
pub fn intervals(observations: &Observations, fit: &Fit) -> Vec<Option<[f64; 2]>> {
    let none = vec![None; fit.model.parameters];
    if !is_likeliest(observations, fit) {
        return none;
    }
    let of = |problem: &Implicit| of_problem(fit, problem);
    at_noise_of(observations, fit, &fit.model, &fit.priors, of).flatten().unwrap_or(none)
}

/// True for a maximum of the likelihood of a session of which profiles are looked at.
pub(crate) fn is_likeliest(observations: &Observations, fit: &Fit) -> bool {
    let likely = fit.stands() && fit.dof >= 1.0;
    likely
        && observations.options.method == Method::ImplicitLoop
        && observations.readings.samples <= LONG
}

/// What is found of the likelihood of a session under a model of the parameters of a fit, beside the noise
/// that the fit has found, conventions held.
pub(crate) fn at_noise_of<R>(
    observations: &Observations,
    fit: &Fit,
    model: &Model,
    priors: &[Prior],
    look: impl FnOnce(&Implicit) -> R,
) -> Option<R> {
    let held = conventions::held(observations, model).ok()?;
    let (readings, weights) = (&observations.readings, Some(&observations.weights[..]));
    let mut parts = vec![(Part { model, readings, weights }, fit.assumed())];
    if let Some((model, readings)) = &held {
        parts.push((Part { model, readings, weights: None }, fit.assumed()));
    }
    let holds = fit.conventions.holds(&fit.model, &fit.beta);
    let priors = [priors, &holds].concat();
    Some(look(&Implicit::new(parts, &priors)))
}

/// Factor of the covariance beside the inverse of the Gram matrix.
pub(crate) fn wider(fit: &Fit) -> f64 {
    widening(&fit.noise, fit.p_value, fit.chi2 / fit.dof)
}

/// Of every parameter, beside what holds the likelihood; none where the fit is not at its maximum.
fn of_problem(fit: &Fit, problem: &Implicit) -> Option<Vec<Option<[f64; 2]>>> {
    let quantile = student_quantile(UPPER, dof(fit));
    let rise = quantile * quantile * wider(fit);
    // Noise that was found after the parameters has moved them by less than this.
    let options = SolverOptions { ptol: 0.25 * OFF * rise, ..SolverOptions::default() };
    let likeliest = fit.likeliest.as_ref().unwrap_or(&fit.beta);
    let least = lm::minimize(problem, likeliest, &options);
    if !quantile.is_finite() || least.iterations > 1 {
        return None;
    }
    let cost = problem.linearize(likeliest).cost;
    let (_, map) = as_reported(fit);
    let variances = &map * &fit.covariance * map.transpose();
    let n = fit.model.parameters;
    let of = |k: usize| {
        let row: Vec<f64> = (0..n).map(|i| map[(k, i)]).collect();
        let sd = variances[(k, k)].max(0.0).sqrt();
        if fit.unknowable[k] || sd == 0.0 || fit.conventions.moves(&row) {
            return None;
        }
        let along = |i: usize| (0..n).map(|j| fit.covariance[(i, j)] * row[j]).sum::<f64>();
        let slope = (0..n).map(|i| along(i) / (sd * sd)).collect();
        let half = quantile * sd;
        let found = ends(problem, likeliest, cost, &Along { row, pivot: k, slope, half }, rise);
        let [low, high] = found.unwrap_or([-half, half]);
        let same = |end: f64| (end.abs() / (NORMAL_95 * sd) - 1.0).abs() <= OFF;
        (!same(low) || !same(high)).then_some([low, high])
    };
    Some((0..n).map(|k| if k < fit.model.term_parameters { of(k) } else { None }).collect())
}

/// Degrees of freedom of the variance by which deviations are multiplied.
fn dof(fit: &Fit) -> f64 {
    let noise = fit.noise.dof_of_pose();
    match wider(fit) > fit.noise.slow {
        true => noise.min(fit.dof),
        false => noise,
    }
}
