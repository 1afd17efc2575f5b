//! Starts of a mechanism whose unknown points distances alone tell: a sled on belts between anchors
//! that nobody has measured.
//!
//! A frame of half the size closes its loops far from the drawing, and what is unknown in each pose
//! has mirror solutions on the way. So the unknown points are tried where they are drawn, then on
//! drawings that are larger and smaller about the points that are known, until one start is good.

use crate::closures::kind::Given;
use crate::estimate::implicit::Implicit;
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::Observations;
use crate::mechanism::Mechanism;
use crate::model::{Model, Thing};
use crate::numerics::lm;

/// Sizes of the drawing, the nearest to 1 first.
const SIZES: [f64; 7] = [1.0, 0.75, 1.35, 0.5, 2.0, 0.35, 2.8];

/// The best of these starts, from one with everything else in its place; the same where no distance
/// tells where an unknown point is.
pub(crate) fn sized(
    observations: &Observations,
    model: &Model,
    noise: &Noise,
    start: Vec<f64>,
) -> Vec<f64> {
    let free = coordinates(model);
    if free.is_empty() {
        return start;
    }
    let centre = centre(model);
    let readings = &observations.readings;
    let part = Part { model, readings, weights: Some(&observations.weights) };
    let told = model.told_by(readings, &observations.weights);
    let good = observations.options.good_start * told as f64;
    let priors = observations.priors(model);
    let end = |beta: &[f64]| {
        let problem = Implicit::new(vec![(part, noise.clone())], &priors).coarse();
        lm::minimize(&problem, beta, &observations.options.lm)
    };
    let mut best: Option<lm::Outcome> = None;
    for size in SIZES {
        let mut beta = start.clone();
        for &(parameter, axis) in &free {
            beta[parameter] = centre[axis] + size * (beta[parameter] - centre[axis]);
        }
        let here = end(&beta);
        if here.cost.is_finite() && best.as_ref().is_none_or(|best| here.cost < best.cost) {
            best = Some(here);
        }
        if best.as_ref().is_some_and(|best| 2.0 * best.cost < good) {
            break;
        }
    }
    let Some(best) = best else { return start };
    // The whole in a mirror has the same distances.
    let mirrored = (0..3).map(|flipped| {
        let mut beta = best.x.clone();
        for &(parameter, axis) in free.iter().filter(|(_, axis)| *axis == flipped) {
            beta[parameter] = 2.0 * centre[axis] - beta[parameter];
        }
        beta
    });
    let unlike = |x: &[f64]| unlikeness(&start, x, &free, &centre);
    let mut nearest = best.x.clone();
    for beta in mirrored {
        if unlike(&beta) < unlike(&nearest) {
            let there = end(&beta);
            if there.cost <= SAME * best.cost && unlike(&there.x) < unlike(&nearest) {
                nearest = there.x;
            }
        }
    }
    nearest
}

/// Costs that differ by this factor are of one solution and its mirror.
const SAME: f64 = 1.01;

/// How far a solution is from the drawing at whatever size, in parts of itself.
fn unlikeness(drawing: &[f64], x: &[f64], free: &[(usize, usize)], centre: &[f64; 3]) -> f64 {
    let of = |all: &[f64]| -> Vec<f64> {
        free.iter().map(|&(parameter, axis)| all[parameter] - centre[axis]).collect()
    };
    let (drawn, found) = (of(drawing), of(x));
    let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
    let size = (dot(&drawn, &found) / dot(&drawn, &drawn).max(f64::MIN_POSITIVE)).max(0.0);
    let off: f64 = drawn.iter().zip(&found).map(|(d, f)| (f - size * d).powi(2)).sum();
    off / dot(&found, &found).max(f64::MIN_POSITIVE)
}

/// Parameters of the points that distances tell of, and the axis of each.
fn coordinates(model: &Model) -> Vec<(usize, usize)> {
    let mechanism = &model.mechanism;
    let mut found = Vec::new();
    for unknown in &model.unknowns {
        let Thing::Point(p) = unknown.thing else { continue };
        let point = &mechanism.points[p];
        if !told_by_distances(mechanism, &point.name) {
            continue;
        }
        let free = point.frees();
        let axes = (0..3).filter(|&axis| free[axis]);
        found.extend(
            axes.enumerate().map(|(k, axis)| (model.term_parameters + unknown.first + k, axis)),
        );
    }
    found
}

/// True for a point of which distances tell, and nothing else.
pub(crate) fn told_by_distances(mechanism: &Mechanism, name: &String) -> bool {
    let mut own = mechanism.closures.iter().filter(|c| c.between.contains(name)).peekable();
    own.peek().is_some() && own.all(|c| c.kind.facts().given == Given::Value)
}

/// The middle of the points that are fixed in the base; its origin where there is none.
fn centre(model: &Model) -> [f64; 3] {
    let fixed = model.mechanism.points.iter().filter(|p| p.chain.is_none() && !p.is_unknown());
    let fixed: Vec<[f64; 3]> = fixed.filter_map(|p| p.at).collect();
    let count = fixed.len().max(1) as f64;
    std::array::from_fn(|axis| fixed.iter().map(|at| at[axis]).sum::<f64>() / count)
}
