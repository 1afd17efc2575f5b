//! Mistakes at first wiring in few poses, judged by all that is known beside the readings.
//!
//! From few poses almost any wiring leads to a good fit of gains and offsets that nobody knows.
//! Where gains have priors, these and a held rest pose are equations, too: a wrong wire then
//! costs χ². A mistake is named only where it is the only one that explains the poses.

use std::f64::consts::{PI, TAU};

use crate::Error;
use crate::estimate::observations::Observations;
use crate::estimate::search::{End, StartSearch, anchored};
use crate::estimate::suspicion::{Closes, InDegrees, Scaled, Suspicion};
use crate::mechanism::Mechanism;
use crate::model::Model;
use crate::readings::{Readings, Table};
use crate::terms::term::Role;

/// χ² must fall by this factor before a mistake is named.
pub(crate) const DECISIVE: f64 = 20.0;

/// The observations, and the readings that a search uses, as they would be without a mistake.
pub(crate) struct Rewired {
    /// The readings of the poses.
    pub(crate) readings: Readings,
    /// The observations, for the reading of the rest pose.
    pub(crate) observations: Observations,
}

/// Every two channels.
pub(crate) fn pairs(channels: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..channels).flat_map(move |a| (a + 1..channels).map(move |b| [a, b]))
}

impl Rewired {
    /// Every row changed by `undo`; an error where a reading is beyond its channel's range then.
    fn new(
        observations: &Observations,
        readings: &Readings,
        undo: impl Fn(&mut [f64]),
    ) -> Result<Self, Error> {
        let mut observations = observations.clone();
        let mut table = readings.table.clone();
        table.change(readings.channels, &undo);
        let readings = Readings::beside(&observations.mechanism, table, &observations.readings)?;
        if let Some(rest) = &mut observations.rest {
            undo(rest);
        }
        if let (Some((held, readings)), Some(rest)) = (&mut observations.held, &observations.rest) {
            *readings = Readings::new(held, Table { values: rest.clone(), ..Table::default() })?;
        }
        Ok(Self { readings, observations })
    }

    /// Every two columns exchanged, but those of which a reading is beyond the range of the other channel.
    pub(crate) fn every_exchange(
        observations: &Observations,
        readings: &Readings,
    ) -> impl Iterator<Item = (Self, [usize; 2])> {
        pairs(readings.channels)
            .filter_map(|pair| Some((Self::exchanged(observations, readings, pair)?, pair)))
    }

    /// Readings in every other unit, with the channels that it changes.
    pub(crate) fn every_unit(
        observations: &Observations,
        readings: &Readings,
    ) -> impl Iterator<Item = (Self, Vec<usize>, f64)> {
        OTHER_UNIT.into_iter().filter_map(|times| {
            let (rewired, channels) = Self::scaled(observations, readings, times)?;
            Some((rewired, channels, times))
        })
    }

    /// Two columns exchanged; none where a reading is beyond the range of the other channel.
    pub(crate) fn exchanged(
        observations: &Observations,
        readings: &Readings,
        [a, b]: [usize; 2],
    ) -> Option<Self> {
        Self::new(observations, readings, |row| row.swap(a, b)).ok()
    }

    /// A channel the other way round within its range, or about zero where it has none.
    pub(crate) fn mirrored(
        observations: &Observations,
        readings: &Readings,
        channel: usize,
    ) -> Option<Self> {
        let range = observations.mechanism.channels[channel].range;
        let ends = range.map_or(0.0, |[low, high]| low + high);
        Self::new(observations, readings, |row| row[channel] = ends - row[channel]).ok()
    }

    /// Every channel that reads an angle in the other unit: degrees times 57.3, or radians by it.
    pub(crate) fn scaled(
        observations: &Observations,
        readings: &Readings,
        times: f64,
    ) -> Option<(Self, Vec<usize>)> {
        let mechanism = &observations.mechanism;
        let angles = |c: &usize| {
            let channel = &mechanism.channels[*c];
            mechanism.turns(*c) && (channel.unit == "rad" || channel.is_in_degrees())
        };
        let channels: Vec<usize> = (0..mechanism.channels.len()).filter(angles).collect();
        if channels.is_empty() {
            return None;
        }
        let undo = |row: &mut [f64]| channels.iter().for_each(|&c| row[c] *= times);
        Some((Self::new(observations, readings, undo).ok()?, channels))
    }

    /// The same readings beside a mechanism whose offsets of joints that turn are in the other unit;
    /// none where no offset is declared.
    pub(crate) fn offsets(
        observations: &Observations,
        readings: &Readings,
        times: f64,
    ) -> Option<(Self, Vec<usize>)> {
        let Mechanism { channels, .. } = &observations.mechanism;
        let declared = |c: &usize| observations.mechanism.turns(*c) && channels[*c].offset != 0.0;
        let turning: Vec<usize> = (0..channels.len()).filter(declared).collect();
        let mut observations = observations.clone();
        turning.iter().for_each(|&c| observations.mechanism.channels[c].offset *= times);
        let readings = readings.clone();
        (!turning.is_empty()).then_some((Self { readings, observations }, turning))
    }
}

impl Rewired {
    /// Readings with which closing is no evidence of these, each with what its χ² counts times: of other
    /// poses, and where these are in another unit (`of_unit`) twice and half as large, by a noise that is, too.
    /// Angles times .017 hardly move: there is a plane through any points that stand nearly still, and a loop is
    /// straight along a part of its way. A loop that closes for its unit does not with another gain.
    pub(crate) fn by_chance(&self, of_unit: bool) -> impl Iterator<Item = (Self, f64)> {
        let scaled = |times: f64| {
            let (other, _) = Self::scaled(&self.observations, &self.readings, times)?;
            Some((other, times.powi(-2)))
        };
        let others = self.of_other_poses().ok().map(|others| (others, 1.0));
        let gains = [2.0, 0.5].into_iter().filter(move |_| of_unit).filter_map(scaled);
        others.into_iter().chain(gains)
    }

    /// The same with the readings of each channel from other poses.
    fn of_other_poses(&self) -> Result<Self, Error> {
        let Readings { samples, channels, pose, table: own, .. } = &self.readings;
        let mut poses: Vec<Vec<usize>> = Vec::new();
        for row in 0..*samples {
            poses.resize_with(poses.len().max(pose[row] + 1), Vec::new);
            poses[pose[row]].push(row);
        }
        let mut table = own.clone();
        for (number, rows) in poses.iter().enumerate() {
            for channel in 0..*channels {
                let away = (channel + 1) * poses.len() / (channels + 1);
                let others = poses[(number + away) % poses.len()].iter().cycle();
                for (row, other) in rows.iter().zip(others) {
                    table.values[row * channels + channel] = own.values[other * channels + channel];
                }
            }
        }
        let observations = self.observations.clone();
        let readings = Readings::beside(&observations.mechanism, table, &self.readings)?;
        Ok(Self { readings, observations })
    }
}

/// Part by which offsets in another unit may differ from what is declared: a machine is built to a
/// few hundredths of a radian, and an offset is of the size of one.
pub(crate) const NEAR: f64 = 0.05;

/// True where a fit from one set of offsets ends at offsets near them: a start elsewhere may lead to
/// any minimum, and these offsets are what it is about.
pub(crate) fn stays(model: &Model, channels: &[usize], [from, to]: [&[f64]; 2]) -> bool {
    let columns = channels.iter().filter_map(|&c| model.column(Role::Offset, c));
    columns.into_iter().all(|column| apart(from[column], to[column]) <= NEAR * PI)
}

/// Angle between two directions.
pub(crate) fn apart(a: f64, b: f64) -> f64 {
    let turn = (a - b).rem_euclid(TAU);
    turn.min(TAU - turn)
}

/// What readings in the other unit are multiplied by.
pub(crate) const OTHER_UNIT: [f64; 2] = [180.0 / PI, PI / 180.0];

/// The poses, each the mean of its samples, with the square root of their number as its weight.
struct Poses<'a> {
    search: &'a StartSearch<'a>,
    readings: Readings,
    weights: Vec<f64>,
}

impl<'a> Poses<'a> {
    fn new(search: &'a StartSearch<'a>) -> Result<Self, Error> {
        let (all, mechanism) = (&*search.readings, &search.observations.mechanism);
        let (readings, live) = match all.held {
            true => all.averaged(mechanism, &search.weights)?,
            false => (all.clone(), search.weights.clone()),
        };
        Ok(Self { search, readings, weights: live.into_iter().map(f64::sqrt).collect() })
    }

    /// χ² per equation of the best fit from a start, with the rest pose `held`.
    fn from(&self, readings: &Readings, held: Option<&(Mechanism, Readings)>, x: &[f64]) -> f64 {
        self.search.end_knowing(readings, &self.weights, held, x).score
    }

    /// The same from the rest pose and nominal gains, without a mistake.
    fn without(&self, Rewired { readings, observations }: &Rewired) -> f64 {
        let factors = vec![1.0; readings.channels];
        let start = anchored(observations, self.search.model, &factors);
        self.from(readings, observations.held.as_ref(), &start)
    }

    /// The same as it is declared, also from the best end of the search.
    fn declared(&self, best: Option<&End>) -> f64 {
        let observations = self.search.observations;
        let anchor = anchored(observations, self.search.model, &vec![1.0; self.readings.channels]);
        let starts = [Some(&anchor), best.map(|end| &end.beta)];
        let scores = starts
            .into_iter()
            .flatten()
            .map(|start| self.from(&self.readings, observations.held.as_ref(), start));
        scores.fold(f64::INFINITY, f64::min)
    }

    /// Every mistake with the readings and the χ² per equation that are left without it, the best
    /// first.
    fn mistakes(&self, declared: f64) -> Vec<(f64, Suspicion, Rewired)> {
        let (observations, readings) = (self.search.observations, &self.readings);
        let exchanged =
            Rewired::every_exchange(observations, readings).map(|(rewired, channels)| {
                let with = self.without(&rewired);
                let closes = Closes { with, declared };
                (with, Suspicion::Exchanged { channels, closes }, rewired)
            });
        let reversed = (0..readings.channels).filter_map(|c| {
            let rewired = Rewired::mirrored(observations, readings, c)?;
            let with = self.without(&rewired);
            let closes = Closes { with, declared };
            Some((with, Suspicion::Reversed { channels: vec![c], closes }, rewired))
        });
        let units = Rewired::every_unit(observations, readings);
        let scaled = units.map(|(rewired, channels, times)| {
            let with = self.without(&rewired);
            let closes = Closes { with, declared };
            let of = InDegrees::Loop { what: Scaled::Readings, times, closes };
            (with, Suspicion::Degrees { channels, of }, rewired)
        });
        let mut found: Vec<_> = exchanged.chain(reversed).chain(scaled).collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found
    }
}

/// The only mistake with which the poses agree with what is known, if they do not without one.
/// `best` is the best end of the search, where there is one.
#[must_use]
pub(crate) fn suspect(search: &StartSearch<'_>, best: Option<&End>) -> Option<Suspicion> {
    let poses = Poses::new(search).ok()?;
    let declared = poses.declared(best);
    if declared < DECISIVE {
        return None;
    }
    let mut found = poses.mistakes(declared).into_iter();
    let (score, suspicion, rewired) = found.next()?;
    let next = found.next().map_or(f64::INFINITY, |(score, ..)| score);
    let chances = rewired.by_chance(matches!(suspicion, Suspicion::Degrees { .. }));
    let by_chance = chances.map(|(other, counts)| counts * poses.without(&other));
    let by_chance = by_chance.fold(f64::INFINITY, f64::min);
    let limit = declared.min(next).min(by_chance) / DECISIVE;
    (score.max(1.0) <= limit.min(search.observations.options.good_start)).then_some(suspicion)
}
