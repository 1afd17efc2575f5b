//! One mistake: how it is undone, and what is said of it.

use std::f64::consts::PI;

use crate::estimate::miswired::rewired::Rewired;
use crate::estimate::observations::Observations;
use crate::estimate::suspicion::{Closes, InDegrees, Scaled, Suspicion};
use crate::mechanism::Mechanism;
use crate::readings::Readings;

/// What readings in the other unit are multiplied by.
pub(crate) const OTHER_UNIT: [f64; 2] = [180.0 / PI, PI / 180.0];

/// A mistake at the wires, or in what is declared.
#[derive(Debug, Clone)]
pub(super) enum Mistake {
    /// The readings of two channels are exchanged.
    Exchanged([usize; 2]),
    /// A channel reads the other way round.
    Reversed(usize),
    /// Readings of angles are in another unit: multiplied by `times`, they are in that of their channels.
    Readings { channels: Vec<usize>, times: f64 },
    /// The same of the offsets that are declared of joints that turn.
    Offsets { channels: Vec<usize>, times: f64 },
}

impl Mistake {
    /// Every two channels exchanged; of leaders with their followers, the followers: no reading tells which.
    pub(super) fn exchanges(of: &Observations) -> impl Iterator<Item = Self> + use<> {
        let channels = of.readings.channels;
        let leads: Vec<bool> = (0..channels).map(|c| of.mechanism.leads(c)).collect();
        let pair = move |a: usize| (a + 1..channels).map(move |b| [a, b]);
        let told = move |[a, b]: &[usize; 2]| !(leads[*a] && leads[*b]);
        (0..channels).flat_map(pair).filter(told).map(Self::Exchanged)
    }

    /// Every channel reversed.
    pub(super) fn reversals(of: &Observations) -> impl Iterator<Item = Self> + use<> {
        (0..of.readings.channels).map(Self::Reversed)
    }

    /// Readings in every other unit.
    pub(super) fn units(of: &Observations) -> impl Iterator<Item = Self> + use<> {
        let Mechanism { channels: all, .. } = &of.mechanism;
        let angle = |c: &usize| all[*c].unit == "rad" || all[*c].is_in_degrees();
        let channels = turning(&of.mechanism, angle);
        in_other_unit(&channels)
            .map(move |times| Self::Readings { channels: channels.clone(), times })
    }

    /// Declared offsets in every other unit.
    pub(super) fn offsets(of: &Observations) -> impl Iterator<Item = Self> + use<> {
        let channels = turning(&of.mechanism, |c| of.mechanism.channels[*c].offset != 0.0);
        in_other_unit(&channels)
            .map(move |times| Self::Offsets { channels: channels.clone(), times })
    }

    /// The session without it, of whose readings a search uses `readings`; none where a reading is beyond
    /// the range of its channel then.
    pub(super) fn undone(&self, of: &Observations, readings: &Readings) -> Option<Rewired> {
        let found = match self {
            Self::Exchanged([a, b]) => Rewired::new(of, readings, |row| row.swap(*a, *b)),
            Self::Reversed(channel) => {
                // Within its range, or about zero where it has none.
                let range = of.mechanism.channels[*channel].range;
                let ends = range.map_or(0.0, |[low, high]| low + high);
                Rewired::new(of, readings, |row| row[*channel] = ends - row[*channel])
            }
            Self::Readings { channels, times } => {
                Rewired::new(of, readings, |row| channels.iter().for_each(|&c| row[c] *= times))
            }
            Self::Offsets { channels, times } => {
                let (mut observations, readings) = (of.clone(), readings.clone());
                let declared = &mut observations.mechanism.channels;
                channels.iter().for_each(|&c| declared[c].offset *= times);
                return Some(Rewired { readings, observations });
            }
        };
        found.ok()
    }

    /// Readings with which closing is no evidence of those `without` it, each with what its χ² counts times: of
    /// other poses, and where these are in another unit twice and half as large, by a noise that is, too.
    /// Angles times .017 hardly move: there is a plane through any points that stand nearly still, and a loop is
    /// straight along a part of its way. A loop that closes for its unit does not with another gain.
    pub(super) fn by_chance(&self, without: &Rewired) -> impl Iterator<Item = (Rewired, f64)> {
        let scaled = |times: f64| {
            let Self::Readings { channels, .. } = self else { return None };
            let scaled = Self::Readings { channels: channels.clone(), times };
            let other = scaled.undone(&without.observations, &without.readings)?;
            Some((other, times.powi(-2)))
        };
        let others = without.of_other_poses().ok().map(|others| (others, 1.0));
        others.into_iter().chain([2.0, 0.5].into_iter().filter_map(scaled))
    }

    /// What is said where one of some was made, each of which closes the loop as well: of exchanges, and of reversals,
    /// that it is one of them. In a machine that is its own image in a mirror, to exchange two sensors is to
    /// reverse the third.
    pub(super) fn either(of: &[Self], closes: Closes) -> Vec<Suspicion> {
        let exchanged = |it: &Self| if let Self::Exchanged(pair) = it { Some(*pair) } else { None };
        let reversed = |it: &Self| if let Self::Reversed(c) = it { Some(*c) } else { None };
        let pairs: Vec<_> = of.iter().filter_map(exchanged).collect();
        let mut channels: Vec<usize> = of.iter().filter_map(reversed).collect();
        channels.sort_unstable();
        let mut said = Vec::new();
        if !pairs.is_empty() {
            said.push(Suspicion::Exchanged { channels: pairs, closes, late: false });
        }
        match channels[..] {
            [] => {}
            [one] => said.push(Self::Reversed(one).suspicion(closes)),
            _ => said.push(Suspicion::EitherReversed { channels, closes }),
        }
        let others = of.iter().filter(|it| exchanged(it).is_none() && reversed(it).is_none());
        said.extend(others.map(|it| it.suspicion(closes)));
        said
    }

    /// What is said of it.
    pub(super) fn suspicion(&self, closes: Closes) -> Suspicion {
        let degrees = |channels: &Vec<usize>, what, times| Suspicion::Degrees {
            channels: channels.clone(),
            of: InDegrees::Loop { what, times, closes },
        };
        match self {
            Self::Exchanged(channels) => {
                Suspicion::Exchanged { channels: vec![*channels], closes, late: false }
            }
            Self::Reversed(channel) => Suspicion::Reversed { channels: vec![*channel], closes },
            Self::Readings { channels, times } => degrees(channels, Scaled::Readings, *times),
            Self::Offsets { channels, times } => degrees(channels, Scaled::Offsets, *times),
        }
    }
}

/// Channels of joints that turn, of which something holds.
fn turning(mechanism: &Mechanism, holds: impl Fn(&usize) -> bool) -> Vec<usize> {
    let turns = |c: &usize| mechanism.turns(*c);
    (0..mechanism.channels.len()).filter(turns).filter(holds).collect()
}

/// The other units, if there are such channels.
fn in_other_unit(channels: &[usize]) -> impl Iterator<Item = f64> + use<> {
    let any = !channels.is_empty();
    OTHER_UNIT.into_iter().filter(move |_| any)
}

#[cfg(test)]
mod tests {
    use super::Mistake::{Exchanged, Reversed};
    use super::{Closes, Mistake, Suspicion};

    #[test]
    fn of_mistakes_of_one_kind_that_close_alike_each_is_said() {
        let closes = Closes { with: 1.0, declared: 900.0 };
        let said = |of: &[Mistake]| Mistake::either(of, closes);
        let exchanged =
            Suspicion::Exchanged { channels: vec![[0, 1], [2, 3]], closes, late: false };
        assert_eq!(said(&[Exchanged([0, 1]), Exchanged([2, 3])]), std::slice::from_ref(&exchanged));
        let reversed = Suspicion::EitherReversed { channels: vec![1, 4], closes };
        assert_eq!(said(&[Reversed(4), Reversed(1)]), [reversed]);
        let one = Suspicion::Reversed { channels: vec![4], closes };
        assert_eq!(said(&[Reversed(4), Exchanged([0, 1]), Exchanged([2, 3])]), [exchanged, one]);
        assert_eq!(said(&[]), []);
    }
}
