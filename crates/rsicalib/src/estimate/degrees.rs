//! Degrees where radians are meant, and the other way round: what is off by a factor of 57.3.

use std::f64::consts::TAU;

use crate::Error;
use crate::estimate::observations::Observations;
use crate::estimate::rewired::{DECISIVE, OTHER_UNIT, Rewired};
use crate::estimate::suspicion::{Closes, InDegrees, Suspicion};
use crate::mechanism::Channel;
use crate::model::Model;
use crate::terms::term::Role;

/// Readings in radians span more than this many times what they can: no joint does, and
/// degrees do wherever a joint moves through a twentieth of its range.
const BEYOND: f64 = 3.0;

/// Part beyond the limits of a joint that readings may lie: limits are drawn in round numbers.
const ROUND: f64 = 1.1;

/// Part by which offsets in another unit may differ from what is declared: a machine is built to a
/// few hundredths of a radian, and an offset is of the size of one.
const NEAR: f64 = 0.05;

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
    add(spans.at(|c| spans.limits_are_wide(c)), InDegrees::LimitsInDegrees);
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

    /// True for limits that are whole numbers of degrees, and many turns in radians, of which the
    /// joint uses a part that would be all of them in degrees.
    fn limits_are_wide(&self, c: usize) -> bool {
        let whole = |[low, high]: [f64; 2]| {
            low.fract() == 0.0 && high.fract() == 0.0 && high - low > TAU && high - low <= 720.0
        };
        self.channel(c).limits.is_some_and(whole) && self.times(c).to_degrees() <= ROUND
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
    if !wrong.is_empty() {
        found.push(Suspicion::Degrees { channels: wrong, of: InDegrees::Gain });
    }
    let declared = |c: &usize| mechanism.channels[*c].offset != 0.0 && offset(*c).is_some();
    let channels: Vec<usize> = turning().filter(declared).collect();
    let other = |c: usize, factor: f64| {
        let (own, found) = (mechanism.channels[c].offset, offset(c).unwrap_or_default());
        let near = |to: f64| apart(found, to) <= NEAR * own.abs().max(to.abs());
        near(own * factor) && !near(own)
    };
    let one = 1.0_f64.to_degrees();
    let all = |factor: f64| channels.iter().all(|&c| other(c, factor));
    if !channels.is_empty() && [one, 1.0 / one].into_iter().any(all) {
        found.push(Suspicion::Degrees { channels, of: InDegrees::Offset });
    }
    found
}

/// Readings in the other unit, where the loop closes with it and by far not as declared: `left` is χ²
/// per degree of freedom, and `refit` that of a fit of other readings.
pub(crate) fn in_other_unit(
    observations: &Observations,
    left: f64,
    refit: impl Fn(&Observations) -> Result<f64, Error>,
) -> Option<Suspicion> {
    if observations.is_long() || left.is_nan() || left < DECISIVE {
        return None;
    }
    let left_of = |Rewired { readings, observations: of }: Rewired| {
        let (table, rest) = (readings.table, of.rest.clone());
        let there = Observations::new(&of.mechanism, table, rest, of.options.clone()).ok()?;
        refit(&Observations { weights: of.weights, judged: true, ..there }).ok()
    };
    let with = |times: f64| {
        let (other, channels) = Rewired::scaled(observations, &observations.readings, times)?;
        // Only what moves less may close by chance; where no fit of other poses starts, they do not.
        let others = (times < 1.0).then(|| other.of_other_poses().ok()).flatten();
        let by_chance = others.and_then(left_of).unwrap_or(f64::INFINITY);
        let with = left_of(other)?;
        if with * DECISIVE >= left.min(by_chance) {
            return None;
        }
        let of = InDegrees::Loop { times, closes: Closes { with, declared: left } };
        Some((with, Suspicion::Degrees { channels, of }))
    };
    let found = OTHER_UNIT.into_iter().filter_map(with);
    found.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, suspicion)| suspicion)
}

/// Angle between two directions.
fn apart(a: f64, b: f64) -> f64 {
    let turn = (a - b).rem_euclid(TAU);
    turn.min(TAU - turn)
}
