//! Where play moves joints, and what a session spreads over beside it: `T` of (168).

use crate::estimate::objective::{Noise, Play};
use crate::model::Model;
use crate::readings::Readings;

/// True where closures have play that moves joints. What another instrument measures errs by itself, and what a surface
/// leaves may be its own shape.
pub(crate) fn seats(model: &Model, noise: &Noise) -> bool {
    let Play { of_seating, of_sample } = noise.of_closures(model);
    let some = |play: &[f64]| play.iter().any(|play| *play > 0.0);
    let elsewhere = model.measures() || model.mechanism.touches_surfaces();
    some(&of_seating) && !some(&of_sample) && !elsewhere
}

/// Variance of the readings of each channel over a session.
pub(crate) fn spread(readings: &Readings) -> Vec<f64> {
    let (channels, rows) = (readings.channels, readings.samples.max(1) as f64);
    let of = |c: usize| readings.table.values.iter().skip(c).step_by(channels);
    let variance = |c: usize| of(c).map(|a| (a - readings.mean[c]).powi(2)).sum::<f64>() / rows;
    (0..channels).map(variance).collect()
}
