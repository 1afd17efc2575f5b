//! Degrees where radians are meant, and the other way round: what is off by a factor of 57.3, or by
//! another one that all channels have.

use std::f64::consts::{PI, TAU};

use crate::estimate::miswired::{NEAR, OTHER_UNIT, apart};
use crate::estimate::observations::Observations;
use crate::estimate::significance::LEVEL;
use crate::estimate::suspicion::{InDegrees, Suspicion};
use crate::mechanism::Channel;
use crate::model::Model;
use crate::terms::term::Role;

/// Readings in radians span more than this many times what they can: no joint does, and
/// degrees do wherever a joint moves through a twentieth of its range.
const BEYOND: f64 = 3.0;

/// Part beyond the limits of a joint that readings may lie: limits are drawn in round numbers.
const ROUND: f64 = 1.1;

/// Degrees in a radian, where a factor is that, or radians in a degree.
#[must_use]
pub(crate) fn degrees_in(factor: f64) -> Option<f64> {
    let one = 1.0_f64.to_degrees();
    let near = |known: &f64| (factor / known).max(known / factor) < ROUND;
    [one, 1.0 / one].into_iter().find(near)
}

/// Channels whose readings, or limits, are not in the unit that is declared.
pub(crate) fn of_readings(observations: &Observations) -> Vec<Suspicion> {
    let spans = Spans { observations };
    let mut found = Vec::new();
    let mut add = |channels: Vec<usize>, of: InDegrees| {
        if !channels.is_empty() {
            found.push(Suspicion::Degrees { channels, of });
        }
    };
    add(spans.in_degrees(), InDegrees::Readings);
    add(spans.at(|c| spans.limits_are_narrow(c)), InDegrees::LimitsInRadians);
    add(spans.of_wide_limits(), InDegrees::LimitsInDegrees);
    found
}

/// What readings span, beside what their joints can move.
struct Spans<'a> {
    observations: &'a Observations,
}

impl Spans<'_> {
    fn channel(&self, c: usize) -> &Channel {
        &self.observations.mechanism.channels[c]
    }

    /// Channels of joints that turn, of which something holds.
    fn at(&self, holds: impl Fn(usize) -> bool) -> Vec<usize> {
        let mechanism = &self.observations.mechanism;
        (0..mechanism.channels.len()).filter(|&c| mechanism.turns(c) && holds(c)).collect()
    }

    /// How many times what its joint can move, a turn where that is not declared, a channel spans.
    fn times(&self, c: usize) -> f64 {
        let [low, high] = self.observations.readings.span[c];
        let allowed = self.channel(c).limits.map_or(TAU, |[low, high]| high - low);
        (high - low) * self.channel(c).gain.abs() / allowed
    }

    /// True where readings span far more than they can, and would not in degrees.
    fn fits_in_degrees(&self, c: usize) -> bool {
        self.times(c) > BEYOND && self.times(c).to_radians() <= ROUND
    }

    /// Channels in radians whose readings fit their joints as degrees, and not as they are.
    fn in_degrees(&self) -> Vec<usize> {
        let radians = self.at(|c| self.channel(c).unit == "rad");
        // An encoder that counts its turns goes beyond one; all of them as degrees do not.
        if radians.iter().any(|&c| self.times(c).to_radians() > ROUND) {
            return Vec::new();
        }
        radians.into_iter().filter(|&c| self.fits_in_degrees(c)).collect()
    }

    /// True for limits in radians of a channel in degrees.
    fn limits_are_narrow(&self, c: usize) -> bool {
        let channel = self.channel(c);
        channel.is_in_degrees() && channel.limits.is_some() && self.fits_in_degrees(c)
    }

    /// Channels with limits as in degrees, of which the readings span a part that would be all of them in degrees.
    fn of_wide_limits(&self) -> Vec<usize> {
        let narrow = |c: &usize| self.times(*c).to_degrees() <= ROUND;
        self.observations.mechanism.limits_as_in_degrees().into_iter().filter(narrow).collect()
    }
}

/// Channels whose fitted gain or offset is what is declared, degrees taken for radians.
pub(crate) fn of_fit(observations: &Observations, model: &Model, beta: &[f64]) -> Vec<Suspicion> {
    let mechanism = &observations.mechanism;
    let turning = || (0..mechanism.channels.len()).filter(|&c| mechanism.turns(c));
    let fitted = |role: Role, c: usize| model.column(role, c).map(|column| beta[column]);
    let gain = |c: usize| {
        let nominal = mechanism.channels[c].gain;
        Some((nominal + fitted(Role::Gain, c)?) / nominal)
    };
    // Offsets are defined at the centre of the readings in the model, and at zero in a file.
    let offset = |c: usize| {
        let (moved, turned) = (fitted(Role::Offset, c)?, fitted(Role::Gain, c).unwrap_or(0.0));
        Some(mechanism.channels[c].offset + moved - turned * model.scales[c].centre)
    };
    let mut found = Vec::new();
    let wrong: Vec<usize> = turning()
        .filter(|&c| gain(c).is_some_and(|ratio| degrees_in(ratio.abs()).is_some()))
        .collect();
    let ratios: Vec<(usize, f64)> =
        (0..mechanism.channels.len()).filter_map(|c| Some((c, gain(c)?))).collect();
    if !wrong.is_empty() {
        found.push(Suspicion::Degrees { channels: wrong, of: InDegrees::Gain });
    } else if let Some(times) = one_for_all(ratios.iter().map(|(_, ratio)| *ratio)) {
        let channels = ratios.into_iter().map(|(c, _)| c).collect();
        found.push(Suspicion::Gains { channels, times });
    }
    // What a convention holds stays where it is drawn, and tells nothing.
    let told = |c: &usize| {
        let moved = fitted(Role::Offset, *c);
        mechanism.channels[*c].offset != 0.0 && moved.is_some_and(|moved| moved != 0.0)
    };
    let channels: Vec<usize> = turning().filter(told).collect();
    let other = |c: usize, factor: f64| {
        let (own, found) = (mechanism.channels[c].offset, offset(c).unwrap_or_default());
        let to = own * factor;
        let near = |to: f64| apart(found, to) <= NEAR * own.abs().max(to.abs()).min(PI);
        near(to) && !near(own)
    };
    for factor in OTHER_UNIT {
        let hits: Vec<usize> = channels.iter().copied().filter(|&c| other(c, factor)).collect();
        if by_chance(hits.len(), channels.len()) <= LEVEL {
            found.push(Suspicion::Degrees { channels: hits, of: InDegrees::Offset });
        }
    }
    found
}

/// Gains are built to a part of themselves: what all of them are off by is twice at the least, and
/// [`BUILT`] is by how much they then differ from each other.
const TWICE: f64 = 2.0;

/// Factor by which gains of one kind of sensor differ.
const BUILT: f64 = 1.25;

/// The number by which gains are all multiplied; none where they are not, or are few.
fn one_for_all(ratios: impl Iterator<Item = f64>) -> Option<f64> {
    let logs: Vec<f64> = ratios.map(|ratio| ratio.abs().ln()).collect();
    let mean = logs.iter().sum::<f64>() / logs.len() as f64;
    let alike = logs.iter().all(|log| (log - mean).abs() <= BUILT.ln());
    (logs.len() >= 3 && alike && mean.abs() >= TWICE.ln()).then(|| mean.exp())
}

/// Probability that so many offsets of all are, each by chance, within [`NEAR`] of what is declared in
/// another unit: angles are anywhere in a turn. A joint that readings hardly tell stays as declared.
fn by_chance(hits: usize, all: usize) -> f64 {
    let ways = |k: usize| (0..k).map(|i| (all - i) as f64 / (i + 1) as f64).product::<f64>();
    let probability =
        |k: usize| ways(k) * NEAR.powi(k as i32) * (1.0 - NEAR).powi((all - k) as i32);
    (hits..=all).map(probability).sum()
}
