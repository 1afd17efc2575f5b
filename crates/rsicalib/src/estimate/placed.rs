//! Starts: what is unknown where the data put it, and parameters from one model to another.

use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::sized::sized;
use crate::estimate::suspicion::Suspicion;
use crate::estimate::tried::Start;
use crate::estimate::turned::turned;
use crate::model::Model;

/// A start with these parameters and everything that is unknown where the data put it.
pub(super) fn placed(
    observations: &Observations,
    model: &Model,
    noise: &Noise,
    mut beta: Vec<f64>,
) -> Start {
    if model.unknowns.is_empty() && model.pose_unknowns() == 0 {
        return Start { beta, ..Start::default() };
    }
    let untold = model.place_unknowns(&observations.readings, &mut beta);
    let beta = sized(observations, model, noise, beta);
    let beta = turned(observations, model, noise, beta);
    let lost = |k: usize| Suspicion::Lost { name: model.unknowns[k].name.clone(), open: 0.0 };
    let warnings = untold.into_iter().map(lost).collect();
    Start { beta, warnings, ..Start::default() }
}

/// Parameters of the terms of one model for another; zero for terms that it has not, and what is unknown as it is drawn.
pub(super) fn carried(from: &Model, x: &[f64], to: &Model) -> Vec<f64> {
    let mut beta = to.nominal();
    for (instance, &first) in to.instances.iter().zip(&to.first) {
        if let Some(k) = from.instances.iter().position(|other| other == instance) {
            let (old, width) = (from.first[k], instance.width());
            beta[first..first + width].copy_from_slice(&x[old..old + width]);
        }
    }
    beta
}
