//! Scores of a tool that slipped: one candidate of three columns for each chain and time.
//!
//! The columns are those of the tool's position, from one pose on, so running sums score
//! all times, (71) and (72). Slips of tools are looked for where damage of placements is: where
//! chains touch unknown points. Elsewhere a point at the end of a chain is no tool in a clamp.

use faer::Mat;

use crate::Error;
use crate::diagnosis::score::scored::{Family, Judge, Scored};
use crate::estimate::{Fit, Implicit, Observations, Part};
use crate::model::Instance;
use crate::screening::steps::{SIDE, StepSums};
use crate::terms::find;
use crate::terms::targets::targets;
use crate::terms::term::{Placed, Spot};

/// At most this many times are tried for a slip of one tool.
const MOST_TIMES: usize = 256;

/// True for a slip of a tool.
#[must_use]
pub fn is_slip(instance: &Instance) -> bool {
    instance.term.placed() == Placed::AtPose && instance.term.moves_only(&[Spot::Tip])
}

/// Scores slips of every tool at a fit; `inverse` is that of its Gram matrix.
///
/// # Errors
///
/// As [`Observations::model`].
pub fn score(
    observations: &Observations,
    fit: &Fit,
    judge: &Judge,
    inverse: &Mat<f64>,
    without: &[String],
) -> Result<Vec<Scored>, Error> {
    let (slip, position) = (find("tool_slip")?, find("point_position")?);
    let tried = without.iter().any(|id| id == slip.info().id);
    if fit.model.unknown_names.is_empty() || tried {
        return Ok(Vec::new());
    }
    let mut scored = Vec::new();
    let chains = targets(slip, &observations.mechanism);
    for &target in &chains {
        let tool = Instance { term: position, target, place: 0 };
        for (place, score) in slips(observations, fit, inverse, tool)? {
            let instance = Instance { term: slip, target, place };
            if !fit.model.instances.contains(&instance) {
                scored.push((instance, score));
            }
        }
    }
    let tests = scored.len() as f64;
    let width = slip.info().parameters.len() as f64;
    let of = |(instance, score): (Instance, f64)| {
        let p_value = judge.p_value(score, width);
        Scored::of(instance, Family::Slip, score, width, p_value, tests)
    };
    Ok(scored.into_iter().map(of).collect())
}

/// Score of a slip of one tool at each of the poses that are tried.
fn slips(
    observations: &Observations,
    fit: &Fit,
    inverse: &Mat<f64>,
    tool: Instance,
) -> Result<Vec<(usize, f64)>, Error> {
    let (base, n) = (fit.model.term_parameters, fit.model.parameters);
    let fitted = fit.model.instances.iter().position(|i| *i == tool);
    let extra = if fitted.is_some() { 0 } else { tool.width() };
    let mut instances = fit.model.instances.clone();
    instances.extend((extra > 0).then_some(tool));
    let model = observations.model(instances)?;
    let mut beta = model.nominal();
    beta[..base].copy_from_slice(&fit.beta[..base]);
    beta[base + extra..].copy_from_slice(&fit.beta[base..]);
    let first = fitted.map_or(base, |k| fit.model.first[k]);
    // What is not fitted absorbs nothing.
    let old = |i: usize| match i {
        i if i < base => Some(i),
        i if i < base + extra => None,
        i => Some(i - extra),
    };
    let absorbs = Mat::from_fn(n + extra, n + extra, |i, j| match (old(i), old(j)) {
        (Some(i), Some(j)) => inverse[(i, j)],
        _ => 0.0,
    });

    let readings = &observations.readings;
    let part = Part { model: &model, readings, weights: Some(&observations.weights) };
    let residuals = Implicit::new(vec![(part, fit.assumed())], &[]).residuals(&beta, true);
    let (k, size) = (residuals.equations, residuals.equations * (n + extra));
    let poses = readings.rows_of_poses();
    let counts = |row: &&usize| observations.weights[**row] > 0.0;
    let live: Vec<usize> =
        (0..poses.len()).filter(|&p| poses[p].iter().any(|row| counts(&row))).collect();
    let stride = live.len().div_ceil(MOST_TIMES).max(1);
    let mut sums = StepSums::new(n + extra);
    let mut scores = Vec::new();
    for (order, &pose) in live.iter().enumerate().rev() {
        for &row in poses[pose].iter().filter(counts) {
            let x = &residuals.by_parameter[row * size..(row + 1) * size];
            let r = &residuals.whitened[row * k..(row + 1) * k];
            sums.add(x, r, &[first, first + 1, first + 2]);
        }
        let both_sides = order >= SIDE && live.len() - order >= SIDE;
        if both_sides && order % stride == 0 {
            scores.extend(sums.score(&absorbs).map(|(score, _)| (pose, score)));
        }
    }
    Ok(scores)
}
