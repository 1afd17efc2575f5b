//! Solutions in a mirror.
//!
//! Where distances alone tell of a point `u`, and all places `p_i` from which they are measured lie on one plane (of
//! a point that is free in two coordinates, on one line), its image beyond that plane has the same distances. With
//! `o_i = u - p_i` in the coordinates that are free, and `n` the direction in which they vary least,
//!
//! ```text
//! u' = u - 2 c n,    c = mean of n · o_i                                                 (166)
//! ```
//!
//! is that image. The fit is repeated from there; where it fits as well, both solutions are told, and the one nearer to
//! the drawing is given.

use faer::Mat;

use crate::estimate::fit::fit;
use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::objective::Part;
use crate::estimate::observations::Observations;
use crate::estimate::settle::settled;
use crate::estimate::significance::{LEVEL, NORMAL_95};
use crate::estimate::sized::told_by_distances;
use crate::estimate::suspicion::Suspicion;
use crate::model::{Thing, Want, Workspace};
use crate::numerics::distributions;
use crate::numerics::linearization::Problem;
use crate::numerics::lm;
use crate::numerics::symmetric::eigenvalues;

/// The fit, or the one in a mirror where that is nearer to the drawing, with what it says of the other.
pub(crate) fn without_mirrors(fit: Fit, observations: &Observations) -> Fit {
    let mut fit = fit;
    for number in 0..fit.model.unknowns.len() {
        if let Some(other) = image(observations, &fit, number) {
            fit = nearer(observations, fit, number, other);
        }
    }
    fit
}

/// The nearer of two solutions, which differ in where one unknown point is.
fn nearer(observations: &Observations, fit_here: Fit, number: usize, other: Vec<f64>) -> Fit {
    let far = |beta: &[f64]| {
        let off = place(&fit_here, number, beta).into_iter().zip(drawn(&fit_here, number));
        off.map(|(a, b)| (a - b).powi(2)).sum::<f64>()
    };
    let Thing::Point(point) = fit_here.model.unknowns[number].thing else { return fit_here };
    // Without a drawing neither is nearer to it.
    let is_drawn = fit_here.model.mechanism.points[point].at.is_some();
    let moves = is_drawn && far(&other) < far(&fit_here.beta);
    let from = || Fit { beta: other.clone(), adjusted: None, ..fit_here.clone() };
    let there = moves.then(|| fit(observations, fit_here.model.instances.clone(), Some(&from())));
    let (mut kept, image) = match there {
        Some(Ok(there)) if there.termination.converged() => {
            let image = place(&there, number, &fit_here.beta);
            (there, image)
        }
        _ => {
            let image = place(&fit_here, number, &other);
            (fit_here, image)
        }
    };
    let at = place(&kept, number, &kept.beta);
    let name = kept.model.unknowns[number].name.clone();
    let same = |w: &Suspicion| matches!(w, Suspicion::Mirrored { name: own, .. } if *own == name);
    kept.warnings.retain(|warning| !same(warning));
    kept.warnings.push(Suspicion::Mirrored { point, name, at, image });
    kept
}

/// Parameters at which the image of an unknown point fits as well as the point; none where it does not.
fn image(observations: &Observations, fit: &Fit, number: usize) -> Option<Vec<f64>> {
    let model = &fit.model;
    let unknown = &model.unknowns[number];
    let Thing::Point(point) = unknown.thing else { return None };
    let point = &model.mechanism.points[point];
    if !told_by_distances(&model.mechanism, &point.name) {
        return None;
    }
    let axes: Vec<usize> = (0..3).filter(|&axis| point.frees()[axis]).collect();
    let offsets = offsets(observations, fit, number, &axes);
    if offsets.len() <= axes.len() {
        return None; // on a plane by their number alone: the fit does not determine them
    }
    let count = offsets.len() as f64;
    let mean: Vec<f64> =
        (0..axes.len()).map(|i| offsets.iter().map(|o| o[i]).sum::<f64>() / count).collect();
    let scatter = Mat::from_fn(axes.len(), axes.len(), |i, j| {
        offsets.iter().map(|o| (o[i] - mean[i]) * (o[j] - mean[j])).sum::<f64>()
    });
    let (_, vectors) = eigenvalues(scatter.as_ref())?;
    let across: f64 = (0..axes.len()).map(|i| vectors[(i, 0)] * mean[i]).sum();
    let first = model.term_parameters + unknown.first;
    let mut beta = fit.beta.clone();
    for i in 0..axes.len() {
        beta[first + i] -= 2.0 * across * vectors[(i, 0)];
    }

    let (readings, weights) = (&observations.readings, Some(&observations.weights[..]));
    let part = Part { model, readings, weights };
    let problem = Implicit::new(vec![(part, fit.assumed())], &fit.priors);
    let here = problem.linearize(&fit.beta).cost;
    let found = lm::minimize(&problem, &beta, &observations.options.lm);
    let worse = 2.0 * (found.cost - here) / fit.noise.slow;
    let as_well = distributions::f_tail(worse.max(0.0), 1.0, fit.noise.dof_of_pose()) > LEVEL;
    let own = first..first + axes.len();
    let moved: f64 = own.clone().map(|k| (found.x[k] - fit.beta[k]).powi(2)).sum::<f64>().sqrt();
    let sd: f64 = own.map(|k| fit.covariance[(k, k)].max(0.0)).sum::<f64>().sqrt();
    // Beside its image by chance, a point is within what is told of it: intervals of 95 % overlap.
    let far = 2.0 * NORMAL_95 * sd;
    (found.cost.is_finite() && as_well && moved > across.abs() && moved > far).then_some(found.x)
}

/// Where an unknown point is from each place from which it is measured, in its free coordinates.
fn offsets(observations: &Observations, fit: &Fit, number: usize, axes: &[usize]) -> Vec<Vec<f64>> {
    let (model, readings) = (&fit.model, &observations.readings);
    let part = Part { model, readings, weights: None };
    let noise = fit.assumed();
    let Thing::Point(point) = model.unknowns[number].thing else { return Vec::new() };
    let name = &model.mechanism.points[point].name;
    let mut ws = Workspace::default();
    let mut found = Vec::new();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let thing = model.unknowns[number].thing;
        if !model.owned.iter().any(|o| o.thing == thing && o.numbers[meta.group] == number) {
            continue;
        }
        let a_hat = settled(&part, &noise, block, &fit.beta);
        let want = Want { x: false, a: false };
        model.evaluate(readings, block, &a_hat, &fit.beta, want, &mut ws);
        let seen = readings.columns(block);
        for closure in &model.closures {
            let between = &model.mechanism.closures[closure.number].between;
            let Some(end) = between.iter().position(|end| end == name) else { continue };
            let [here, there] = [end, 1 - end]
                .map(|end| model.end_point(&closure.ends[end], meta.group, seen, &fit.beta, &ws));
            for lane in readings.lanes(block, closure.number) {
                if observations.weights[meta.rows[lane]] > 0.0 {
                    let off = axes.iter().map(|&a| here[a].0[lane] - there[a].0[lane]);
                    found.push(off.collect());
                }
            }
        }
    }
    found
}

/// Where a fit has an unknown point at these parameters.
pub(crate) fn place(fit: &Fit, number: usize, beta: &[f64]) -> [f64; 3] {
    let mut at = drawn(fit, number);
    let unknown = &fit.model.unknowns[number];
    let Thing::Point(point) = unknown.thing else { return at };
    let free = fit.model.mechanism.points[point].frees();
    let own = &beta[fit.model.term_parameters + unknown.first..];
    let free = (0..3).filter(|&axis| free[axis]);
    free.zip(own).for_each(|(axis, value)| at[axis] = *value);
    at
}

/// Where an unknown point is drawn.
fn drawn(fit: &Fit, number: usize) -> [f64; 3] {
    match fit.model.unknowns[number].thing {
        Thing::Point(point) => fit.model.mechanism.points[point].at.unwrap_or_default(),
        _ => [0.0; 3],
    }
}
