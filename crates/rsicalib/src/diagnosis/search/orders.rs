//! Errors that repeat many times per turn: neighbouring orders are one candidate.

use std::f64::consts::TAU;

use crate::diagnosis::score::periodic;
use crate::diagnosis::score::scored::{Judge, Scored};
use crate::estimate::at_fit::AtFit;
use crate::estimate::{Fit, Observations};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::credible_set::AS_WELL;
use crate::terms::term::{ORDER_STEP, ORDERS, Placed};

/// True for what an order was searched for.
pub(crate) fn has_order(instance: &Instance) -> bool {
    instance.term.placed() == Placed::AtOrder
}

fn same_sensor(a: &Instance, b: &Instance) -> bool {
    (a.term.info().id, a.target) == (b.term.info().id, b.target)
}

/// True for two orders of one sensor that its readings do not tell apart: they differ by less than
/// a wave over all readings.
pub(crate) fn one_order(fit: &Fit, a: &Instance, b: &Instance) -> bool {
    let Target::Channel(channel) = a.target else { return false };
    let scale = &fit.model.scales[channel];
    let way = (scale.span[1] - scale.span[0]) * scale.turn.abs();
    let apart = ORDER_STEP * a.place.abs_diff(b.place) as f64;
    has_order(a) && same_sensor(a, b) && apart * way < TAU
}

/// True where an effect without which a fit is could as well have another order, a wave or more apart over all readings:
/// of places in two short stretches orders that differ by a wave from one to the other are alike.
pub(crate) fn is_open(
    observations: &Observations,
    without: &Fit,
    judge: &Judge,
    own: &Instance,
) -> bool {
    if !has_order(own) {
        return false;
    }
    let scores = periodic::score(&AtFit::new(observations, without), judge, &[]);
    let (near, far): (Vec<Scored>, Vec<Scored>) = scores
        .into_iter()
        .filter(|s| same_sensor(&s.instance, own))
        .partition(|s| one_order(without, &s.instance, own));
    let best = |of: &[Scored]| of.iter().map(|s| s.score).fold(0.0, f64::max);
    best(&far) + AS_WELL >= best(&near)
}

/// The place of the order that a fit has found, where that is another place.
pub(crate) fn nearest_place(fit: &Fit, instance: &Instance) -> Option<usize> {
    let at =
        fit.model.instances.iter().position(|i| i == instance).filter(|_| has_order(instance))?;
    let detune = fit.beta[fit.model.first[at] + 2];
    let place = (instance.place as f64 + detune / ORDER_STEP).round();
    let place = place.clamp(*ORDERS.start() as f64, *ORDERS.end() as f64) as usize;
    (place != instance.place).then_some(place)
}
