//! Errors that repeat many times per turn: neighbouring orders are one candidate.

use std::f64::consts::TAU;

use crate::estimate::Fit;
use crate::mechanism::Target;
use crate::model::Instance;
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

/// The place of the order that a fit has found, where that is another place.
pub(crate) fn nearest_place(fit: &Fit, instance: &Instance) -> Option<usize> {
    let at =
        fit.model.instances.iter().position(|i| i == instance).filter(|_| has_order(instance))?;
    let detune = fit.beta[fit.model.first[at] + 2];
    let place = (instance.place as f64 + detune / ORDER_STEP).round();
    let place = place.clamp(*ORDERS.start() as f64, *ORDERS.end() as f64) as usize;
    (place != instance.place).then_some(place)
}
