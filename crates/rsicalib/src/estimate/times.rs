//! When something happened that has acted ever since: a slip.
//!
//! The likelihood of such a time has no derivative: its profile has a value at each pose. For a step amid
//! many readings twice its rise from the maximum is that of a random walk to both sides, so that a set
//! with
//!
//! ```text
//! 2 (c(k) - c(k̂)) <= -2 ln(1 - √0.95) s²                                  (152)
//! ```
//!
//! holds the true time in 95 % at least (Hansen, *Econometrica* 68, 2000, theorem 1); `s²` as in (151).

use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::intervals::{at_noise_of, is_likeliest, wider};
use crate::estimate::observations::Observations;
use crate::numerics::lm::{self, SolverOptions};
use crate::terms::term::{Outlasts, Placed};

/// Part of the rise that a step of a fit may leave: a time is kept rather than not.
const LEFT: f64 = 0.01;

/// First and last pose at which each instance of a fit may have begun, counted from 0; none for what is
/// not bound to a pose, and for fits of which profiles are not looked at.
#[must_use]
pub fn times(observations: &Observations, fit: &Fit) -> Vec<Option<[usize; 2]>> {
    let likely = is_likeliest(observations, fit);
    let of = |k: usize| {
        let instance = &fit.model.instances[k];
        let slips = instance.term.placed() == Placed::AtPose
            && instance.term.outlasts() == Outlasts::Value
            && !instance.is_past();
        (likely && slips).then(|| time(observations, fit, k)).flatten()
    };
    (0..fit.model.instances.len()).map(of).collect()
}

/// (152) of one instance; poses are looked at one after the other, until one is beyond.
fn time(observations: &Observations, fit: &Fit, k: usize) -> Option<[usize; 2]> {
    let rise = -2.0 * (1.0 - 0.95_f64.sqrt()).ln() * wider(fit);
    let options = SolverOptions { ptol: 0.5 * LEFT * rise, ..observations.options.lm.clone() };
    let cost = |place: usize| {
        let mut instances = fit.model.instances.clone();
        instances[k].place = place;
        let model = observations.model_after(Some(&fit.model), instances).ok()?;
        let least = |problem: &Implicit| lm::minimize(problem, &fit.beta, &options).cost;
        at_noise_of(observations, fit, &model, &fit.priors, least)
    };
    let own = fit.model.instances[k].place;
    let least = cost(own)?;
    let within = |place: &usize| cost(*place).is_some_and(|there| 2.0 * (there - least) <= rise);
    let first = (1..own).rev().take_while(within).last().unwrap_or(own);
    let last = (own + 1..observations.readings.poses()).take_while(within).last().unwrap_or(own);
    Some([first, last])
}
