//! Joints beyond their limits.

use crate::estimate::observations::Observations;
use crate::model::Model;
use crate::terms::term::Role;

/// Where a joint is by its offset, if no row has it within the limits that its file tells and a row has it there as drawn.
pub(crate) fn beyond_limits(
    observations: &Observations,
    model: &Model,
    beta: &[f64],
    channel: usize,
) -> Option<[f64; 2]> {
    let Observations { readings, weights, .. } = observations;
    let drawn = &observations.mechanism.channels[channel];
    let [low, high] = drawn.limits?;
    let offset = beta[model.column(Role::Offset, channel)?];
    let used = (0..readings.samples).filter(|row| weights[*row] > 0.0);
    let angles: Vec<f64> = used.map(|row| drawn.angle(readings.row(row)[channel])).collect();
    let within = |by: f64| angles.iter().any(|q| (low..=high).contains(&(q + by)));
    let ends = [f64::INFINITY, f64::NEG_INFINITY];
    let span = angles.iter().fold(ends, |[a, b], q| [a.min(q + offset), b.max(q + offset)]);
    (within(0.0) && !within(offset)).then_some(span)
}
