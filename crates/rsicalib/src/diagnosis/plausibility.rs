//! What is absurd beside the size of a mechanism and the ranges of its channels.
//!
//! A fit of anything gives parameters. Where noise, misclosure or an effect is out of all
//! proportion, the readings are not of this mechanism, or not in the units declared.

use crate::estimate::{Fit, Observations};
use crate::mechanism::{Channel, Mechanism, Value};
use crate::model::Instance;
use crate::terms::targets::typical;
use crate::terms::term::Acts;

/// Largest share of a channel's range, or of its limits, that noise may be.
const NOISE: f64 = 0.05;
/// Largest share of the smallest length in the loop that the misclosure may be.
const MISCLOSURE: f64 = 0.05;
/// Largest size of an effect, in its typical sizes.
const EFFECT: f64 = 30.0;
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

/// Everything absurd about a fit, effects `found` included.
#[must_use]
pub fn absurdities(observations: &Observations, fit: &Fit, found: &[Instance]) -> Vec<Absurdity> {
    let mechanism = &observations.mechanism;
    let noisy = mechanism.channels.iter().enumerate().filter_map(|(channel, declared)| {
        let (sigma, span) = (fit.noise.sigma[channel], span(declared));
        (sigma > NOISE * span).then_some(Absurdity::Noise { channel, sigma, span })
    });
    let (rms, length) = (fit.rms_misclosure, smallest_length(mechanism));
    let open = (rms > MISCLOSURE * length).then_some(Absurdity::Misclosure { rms, length });
    let effects = found.iter().filter_map(|instance| oversized(fit, mechanism, instance));
    noisy.chain(open).chain(effects).collect()
}

/// Readings between the ends of a channel's range or of its joint's limits.
fn span(channel: &Channel) -> f64 {
    let limits = channel.limits.map(|[low, high]| (high - low) / channel.gain.abs());
    limits.unwrap_or(f64::INFINITY).min(2.0 * channel.half_range())
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

/// The parameter of an effect that is beyond all proportion, if there is one.
fn oversized(fit: &Fit, mechanism: &Mechanism, instance: &Instance) -> Option<Absurdity> {
    // A compliance has no size of its own: what it does depends on the torque.
    if matches!(instance.term.acts(), Acts::Load(_)) {
        return None;
    }
    let at = fit.model.instances.iter().position(|i| i == instance)?;
    let sizes = typical(mechanism, instance.term, instance.target);
    sizes.into_iter().enumerate().find_map(|(parameter, typical)| {
        let value = fit.beta[fit.model.first[at] + parameter];
        let absurd = value.abs() > EFFECT * typical;
        absurd.then_some(Absurdity::Effect { instance: *instance, parameter, value, typical })
    })
}
