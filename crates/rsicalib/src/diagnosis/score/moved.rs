//! Scores of what moved once: the base of a chain, the tool at its end.
//!
//! Each term, chain and time is one candidate of several columns: those of a body that is
//! displaced in all samples, from one pose on. Running sums score all times, (71) and (72).

use faer::Mat;

use crate::Error;
use crate::diagnosis::score::scored::{Family, Judge, Scored};
use crate::estimate::{Fit, Implicit, Observations, Part};
use crate::mechanism::{Mechanism, Target};
use crate::model::Instance;
use crate::screening::steps::{SIDE, StepSums};
use crate::terms;
use crate::terms::targets::{provided, targets};
use crate::terms::term::{Acts, Placed, Spot, Term};

/// At most this many times are tried for one body.
const MOST_TIMES: usize = 256;

/// Equations on either side of a move for each of its columns: of fewer, a few wrong readings look
/// like a move.
const EQUATIONS: usize = 3;

/// True for a body that moved once.
#[must_use]
pub fn is_move(instance: &Instance) -> bool {
    moves_once(instance.term)
}

fn moves_once(term: &dyn Term) -> bool {
    term.placed() == Placed::AtPose && matches!(term.acts(), Acts::Geometry(_))
}

/// False where a move changes no reading, or would pass for another: a point that closes a loop is
/// no tool in a clamp, and a chain that nothing ties to its base has none.
fn meaningful(mechanism: &Mechanism, fit: &Fit, term: &dyn Term) -> bool {
    if term.moves_only(&[Spot::Tip]) {
        return !fit.model.unknown_names.is_empty();
    }
    !(term.moves_only(&[Spot::Base, Spot::Root]) && mechanism.floats())
}

/// Scores every move at a fit; `inverse` is that of its Gram matrix.
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
    let (mechanism, readings) = (&observations.mechanism, &observations.readings);
    let mut all = Vec::new();
    for term in terms::all(mechanism) {
        let tried = moves_once(term)
            && !without.iter().any(|id| id == term.info().id)
            && meaningful(mechanism, fit, term)
            && provided(term, mechanism, readings).is_ok();
        if !tried {
            continue;
        }
        for target in targets(term, mechanism) {
            all.extend(moves(observations, fit, inverse, term, target)?);
        }
    }
    let tests = all.len() as f64;
    let of = |(instance, score, width): (Instance, f64, f64)| {
        let p_value = judge.p_value(score, width);
        Scored::of(instance, Family::Moved, score, width, p_value, tests)
    };
    Ok(all.into_iter().map(of).collect())
}

/// Score and rank of the moves of one body, at each of the poses that are tried.
fn moves(
    observations: &Observations,
    fit: &Fit,
    inverse: &Mat<f64>,
    term: &'static dyn Term,
    target: Target,
) -> Result<Vec<(Instance, f64, f64)>, Error> {
    let (base, n) = (fit.model.term_parameters, fit.model.parameters);
    // Displaced before the first pose: in all samples.
    let always = Instance { term, target, place: 0 };
    let extra = always.width();
    let mut instances = fit.model.instances.clone();
    instances.push(always);
    let model = observations.model(instances)?;
    let mut beta = model.nominal();
    beta[..base].copy_from_slice(&fit.beta[..base]);
    beta[base + extra..].copy_from_slice(&fit.beta[base..]);
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
    let columns: Vec<usize> = (base..base + extra).collect();

    let readings = &observations.readings;
    let part = Part { model: &model, readings, weights: Some(&observations.weights) };
    let residuals = Implicit::new(vec![(part, fit.assumed())], &[]).residuals(&beta, true);
    let (k, size) = (residuals.equations, residuals.equations * (n + extra));
    let poses = readings.rows_of_poses();
    let counts = |row: &&usize| observations.weights[**row] > 0.0;
    let live: Vec<usize> =
        (0..poses.len()).filter(|&p| poses[p].iter().any(|row| counts(&row))).collect();
    let stride = live.len().div_ceil(MOST_TIMES).max(1);
    let side = SIDE.max((EQUATIONS * extra).div_ceil(k));
    let mut sums = StepSums::new(n + extra, extra);
    let (mut found, mut last) = (Vec::new(), None);
    for (order, &pose) in live.iter().enumerate().rev() {
        // What moved in one session has its place in that session.
        let session = readings.session_of_pose.get(pose);
        if last.replace(session).is_some_and(|later| later != session) {
            sums = StepSums::new(n + extra, extra);
        }
        for &row in poses[pose].iter().filter(counts) {
            let x = &residuals.by_parameter[row * size..(row + 1) * size];
            let r = &residuals.whitened[row * k..(row + 1) * k];
            sums.add(x, r, &columns);
        }
        let both_sides = order >= side && live.len() - order >= side;
        let instance = Instance { place: pose, ..always };
        if both_sides && order % stride == 0 && !fit.model.instances.contains(&instance) {
            let scored = sums.score(&absorbs);
            found.extend(scored.map(|s| (instance, s.score, s.rank as f64)));
        }
    }
    Ok(found)
}
