//! What is absurd beside the size of a mechanism and the ranges of its channels.
//!
//! A fit of anything gives parameters. Where noise, misclosure or an effect is out of all
//! proportion, the readings are not of this mechanism, or not in the units declared.

use crate::numerics::order::Ends;
use std::f64::consts::PI;

use crate::diagnosis::curve::curve;
use crate::estimate::limits::beyond_limits;
use crate::estimate::noise::source::NOISIER;
use crate::estimate::search::ratios;
use crate::estimate::{Fit, Observations};
use crate::mechanism::{Mechanism, Target, Value};
use crate::model::Instance;
use crate::terms::targets::{largest_effect, longest};
use crate::terms::term::{Over, Role};

/// Largest share of a channel's range, or of its limits, that noise may be.
const NOISE: f64 = 0.05;
/// Largest ratio of a gain to the nominal one with which readings may be of this mechanism.
const GAIN: f64 = 2.0;
stated! {
    /// Largest share of the smallest length in the loop that the misclosure may be.
    fn largest_misclosure() -> f64 = 0.05;
}
/// A typical change of a slope, as a share of the slope.
const SLOPE: f64 = 0.02;
/// Lengths below this share of the longest are no links: an offset drawn to be small.
const LINK: f64 = 0.01;

/// Something absurd.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Absurdity {
    /// The noise of a channel.
    Noise {
        /// The channel.
        channel: usize,
        /// Standard deviation, in its unit.
        sigma: f64,
        /// Readings that its range or its limits span.
        span: f64,
    },
    /// The misclosure.
    Misclosure {
        /// Root mean square [length unit].
        rms: f64,
        /// The smallest length in the loop [length unit].
        length: f64,
    },
    /// A joint that is beyond its limits in every row, and was not as it is drawn: often a sign that is reversed, and the
    /// image of the machine in a mirror.
    Limits {
        /// The channel.
        channel: usize,
        /// Its lowest and its highest coordinate [rad, or length].
        span: [f64; 2],
    },
    /// An effect.
    Effect {
        /// The effect.
        instance: Instance,
        /// Number of its parameter.
        parameter: usize,
        /// The value, in the parameter's unit.
        value: f64,
        /// The typical size.
        typical: f64,
    },
}

impl Absurdity {
    /// True for what an effect has no part in: loops that stay open, and noise.
    #[must_use]
    pub fn is_of_readings(&self) -> bool {
        matches!(self, Self::Noise { .. } | Self::Misclosure { .. })
    }
}

/// Everything absurd about a fit, effects `found` included.
#[must_use]
pub fn absurdities(observations: &Observations, fit: &Fit, found: &[Instance]) -> Vec<Absurdity> {
    let mechanism = &observations.mechanism;
    let noisy = (0..mechanism.channels.len()).filter_map(|channel| {
        let (sigma, span) = (fit.noise.sigma[channel], span(mechanism, channel));
        (sigma > NOISE * span).then_some(Absurdity::Noise { channel, sigma, span })
    });
    let measured = smallest_measured(observations, fit);
    let (rms, length) = (fit.rms_misclosure, smallest_length(mechanism).min(measured));
    // No noise of a length is as large as the length.
    let open = (is_no_drawing_error(rms, length) && !is_declared(fit)) || rms > measured;
    let open = open.then_some(Absurdity::Misclosure { rms, length });
    let effects = found.iter().filter_map(|instance| oversized(fit, mechanism, instance));
    let beyond = (0..mechanism.channels.len()).filter_map(|channel| {
        beyond_limits(observations, &fit.model, &fit.beta, channel)
            .map(|span| Absurdity::Limits { channel, span })
    });
    noisy.chain(open).chain(beyond).chain(effects).collect()
}

/// True for a misclosure that is no error of a drawing.
pub(crate) fn is_open(mechanism: &Mechanism, rms: f64) -> bool {
    is_no_drawing_error(rms, smallest_length(mechanism))
}

fn is_no_drawing_error(rms: f64, length: f64) -> bool {
    rms > largest_misclosure() * length
}

/// True where the misclosure is what the declared noise leaves, or a few times as much: coarse sensors
/// beside a short link. Gains that have grown would make any noise leave it.
fn is_declared(fit: &Fit) -> bool {
    fit.noise.source.is_declared()
        && fit.chi2 < NOISIER * NOISIER * fit.dof
        && ratios(&fit.model, &fit.beta).all(|ratio| ratio.abs() < GAIN)
}

/// Readings between the ends of a channel's range or of its joint's limits.
fn span(mechanism: &Mechanism, channel: usize) -> f64 {
    let turns = mechanism.turns(channel);
    let channel = &mechanism.channels[channel];
    let limits = channel.limits.map(|[low, high]| (high - low) / channel.gain.abs());
    let bounded = turns || channel.ends().is_some();
    let range = if bounded { 2.0 * channel.half_range() } else { f64::INFINITY };
    limits.unwrap_or(f64::INFINITY).min(range)
}

/// The smallest length that keeps a loop open: of a link, or of a distance.
fn smallest_length(mechanism: &Mechanism) -> f64 {
    let rows = mechanism.chains.iter().flat_map(|c| &c.rows);
    let links = rows.map(|row| row.body().translation.vector.norm());
    let carried = mechanism.points.iter().filter(|p| p.chain.is_some()).filter_map(|p| p.at);
    let tips = carried.map(|at| at.iter().map(|v| v * v).sum::<f64>().sqrt());
    let distances = mechanism.closures.iter().filter_map(|c| match c.value {
        Some(Value::Known(value)) => Some(value),
        _ => None,
    });
    let lengths: Vec<f64> = links.chain(tips).chain(distances).collect();
    let longest = lengths.iter().copied().fold(0.0, f64::max);
    lengths.into_iter().filter(|l| *l > LINK * longest).fold(f64::INFINITY, f64::min)
}

/// The smallest of the lengths that channels measure, in the middle of the session.
fn smallest_measured(observations: &Observations, fit: &Fit) -> f64 {
    let mechanism = &observations.mechanism;
    let read = (0..mechanism.channels.len()).filter(|&channel| mechanism.measures(channel));
    let length = |channel: usize| {
        let offset = fit.model.column(Role::Offset, channel).map_or(0.0, |k| fit.beta[k]);
        (mechanism.channels[channel].angle(observations.readings.mean[channel]) + offset).abs()
    };
    read.map(length).fold(f64::INFINITY, f64::min)
}

/// The parameter of an effect that is beyond all proportion, if there is one.
fn oversized(fit: &Fit, mechanism: &Mechanism, instance: &Instance) -> Option<Absurdity> {
    // A compliance has no size of its own, since what it does depends on the torque; nor has a delay.
    if instance.term.is_load() || instance.term.is_late() {
        return None;
    }
    // Where no length is drawn nothing says what is large of one.
    let of_lengths = mechanism.slides_at(instance.target)
        || instance.term.info().parameters.iter().any(|p| p.unit.starts_with("length"));
    if of_lengths && longest(mechanism).is_none() {
        return None;
    }
    let at = fit.model.instances.iter().position(|i| i == instance)?;
    let first = fit.model.first[at];
    let largest = largest_correction(fit, instance, first);
    let info = instance.term.info();
    // How often a curve goes up and down makes it no larger.
    let corrects = |k: usize| info.parameters[k].unit.starts_with("rad");
    let all = largest.is_none() || !(0..info.parameters.len()).any(corrects);
    let sizes = fit.model.typical_at(instance.term, instance.target).into_iter().enumerate();
    let sizes = sizes.filter(|(k, _)| all || corrects(*k));
    let times = |&(k, typical): &(usize, f64)| fit.beta[first + k].abs() / typical;
    let (parameter, typical) = sizes.clone().greatest_by(|a| times(a))?;
    let size = match largest {
        // A free curve has small sizes of waves that are seldom large, and is as large as the first of them.
        Some(largest) => {
            let sensor = sensor(mechanism, instance.target);
            let correction = |(k, typical): (usize, f64)| match (info.parameters[k].unit, sensor) {
                ("rad/reading", Some(c)) => SLOPE * travel(mechanism, c),
                _ => typical,
            };
            largest / sizes.map(correction).fold(f64::MIN_POSITIVE, f64::max)
        }
        None => times(&(parameter, typical)),
    };
    let value = fit.beta[first + parameter];
    let effect = Absurdity::Effect { instance: *instance, parameter, value, typical };
    (size > largest_effect()).then_some(effect)
}

/// Half of what a channel can read, in radians or length units; half a turn where nothing bounds a
/// joint that turns.
fn travel(mechanism: &Mechanism, channel: usize) -> f64 {
    let half = 0.5 * span(mechanism, channel) * mechanism.channels[channel].gain.abs();
    let unbounded = !half.is_finite() && !mechanism.slides(channel);
    if unbounded { PI } else { half }
}

/// The channel that a sensor's law is of; of sensors of one make, which share it, the first.
fn sensor(mechanism: &Mechanism, target: Target) -> Option<usize> {
    match target {
        Target::Channel(_) | Target::EachJoint(..) | Target::Together(_) => {
            mechanism.channels_at(target).first().copied()
        }
        _ => None,
    }
}

/// The largest correction, in these readings, of an effect that is a curve over the reading,
/// without what a fitted offset and gain take up of it: its parameters are those of the whole
/// range, of which readings may span a part.
fn largest_correction(fit: &Fit, instance: &Instance, first: usize) -> Option<f64> {
    let channel = sensor(&fit.model.mechanism, instance.target)?;
    let curve = curve(fit, instance, first).filter(|curve| curve.over == Over::Reading)?;
    let fitted = |role: Role| {
        instance.term.role() == Role::Other && fit.model.column(role, channel).is_some()
    };
    let mean =
        |k: usize| curve.points.iter().map(|p| p[k]).sum::<f64>() / curve.points.len() as f64;
    let middle = [mean(0), if fitted(Role::Offset) { mean(1) } else { 0.0 }];
    let along = |k: usize| -> f64 {
        curve.points.iter().map(|p| (p[0] - middle[0]) * (p[k] - middle[k])).sum()
    };
    let slope = if fitted(Role::Gain) { along(1) / along(0).max(f64::MIN_POSITIVE) } else { 0.0 };
    let left = |p: &[f64; 3]| (p[1] - middle[1] - slope * (p[0] - middle[0])).abs();
    curve.points.iter().map(left).reduce(f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn travel_is_the_same_in_every_unit_of_the_readings() {
        let counts = Mechanism::rsi();
        let mut radians = counts.clone();
        for channel in &mut radians.channels {
            let ends = channel.range.map(|range| range.map(|reading| reading * channel.gain.abs()));
            (channel.gain, channel.range, channel.unit) = (1.0, ends, "rad".into());
        }
        for c in 0..counts.channels.len() {
            let (counted, read) = (travel(&counts, c), travel(&radians, c));
            assert!((counted - read).abs() < 1e-12 * read, "{counted} {read}");
            // 340° are 4096 counts, and the limits are no wider.
            assert!(read <= 170.0_f64.to_radians());
        }
        let mut free = counts;
        (free.channels[0].range, free.channels[0].limits) = (None, None);
        // Half a turn, to the rounding of a reading that is turned into an angle and back.
        assert!((travel(&free, 0) - PI).abs() < 1e-14 * PI);
    }
}
