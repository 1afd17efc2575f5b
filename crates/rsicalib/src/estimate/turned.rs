//! Starts of a mechanism with unknown frames: turned from where data put them, by steps (170), to a
//! minimum from which steps of `rx ry rz` are short.

use crate::estimate::implicit::Implicit;
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::Observations;
use crate::model::{Model, Thing};
use crate::numerics::lm;

/// The minimum next to a start; the start itself where no frame is unknown.
pub(crate) fn turned(
    observations: &Observations,
    model: &Model,
    noise: &Noise,
    start: Vec<f64>,
) -> Vec<f64> {
    if !model.unknowns.iter().any(|unknown| matches!(unknown.thing, Thing::Frame(_))) {
        return start;
    }
    let model = model.turning();
    let (readings, weights) = (&observations.readings, Some(&observations.weights[..]));
    let priors = observations.priors(&model);
    let part = Part { model: &model, readings, weights };
    let problem = Implicit::new(vec![(part, noise.clone())], &priors).coarse();
    let found = lm::minimize(&problem, &start, &observations.options.lm);
    if found.cost.is_finite() { found.x } else { start }
}
