//! What a target is of: its channels, and their units.

use crate::mechanism::alike::{MAKE, SAME, close};
use crate::mechanism::drawing::{Channel, Mechanism};
use crate::mechanism::target::Target;

impl Mechanism {
    /// The channels that a target is of, or has: all of a chain; none of a row or a closure. Of a
    /// target that chains share, those of all of them.
    #[doc(hidden)]
    #[must_use]
    pub fn channels_at(&self, target: Target) -> Vec<usize> {
        match target {
            Target::All => (0..self.channels.len()).collect(),
            Target::Channel(c) => vec![c],
            Target::Chain(chain) => self.channels_of(chain),
            Target::Row(..) | Target::Closure(_) | Target::Place(_) | Target::EachRow(..) => {
                Vec::new()
            }
            shared => self.parts(shared).into_iter().flat_map(|t| self.channels_at(t)).collect(),
        }
    }

    /// True for a target whose joint, or each of whose joints, slides.
    #[doc(hidden)]
    #[must_use]
    pub fn slides_at(&self, target: Target) -> bool {
        matches!(target, Target::Channel(_) | Target::EachJoint(..) | Target::Together(_))
            && self.channels_at(target).into_iter().all(|c| self.slides(c))
    }

    /// The unit of the coordinates of a target's joints: the unit of length where they slide. Channels
    /// of no joint have that of [`Self::coordinate_unit_of`].
    #[doc(hidden)]
    #[must_use]
    pub fn coordinate_unit(&self, target: Target) -> &str {
        let one = match target {
            Target::Channel(_) | Target::EachJoint(..) | Target::Together(_) => {
                let channels = self.channels_at(target);
                let mut units = channels.into_iter().map(|c| self.coordinate_unit_of(c));
                units.next().filter(|first| units.all(|unit| unit == *first))
            }
            _ => None,
        };
        one.unwrap_or_else(|| if self.slides_at(target) { &self.length_unit } else { "rad" })
    }

    /// The unit of the coordinate of a channel, `gain * reading + offset`: of its joint, or of the length
    /// that it reads. A channel of neither has its own, and radians where that is degrees; where closures
    /// make its coordinate equal to others, it is in their unit: counts are none of a coordinate that is an
    /// angle, a length, or what another channel reads as it is.
    fn coordinate_unit_of(&self, channel: usize) -> &str {
        let alike = self.all_equal(channel);
        let of_joint = alike.iter().find(|&&c| self.moves_joint(c) || self.measures(c));
        if let Some(&c) = of_joint {
            return if self.slides(c) { &self.length_unit } else { "rad" };
        }
        let own = || alike.iter().filter_map(|&c| self.channels.get(c));
        let is_angle = |channel: &&Channel| channel.is_in_degrees() || channel.unit == "rad";
        if own().any(|channel| is_angle(&channel)) {
            return "rad";
        }
        let read_as_it_is = own().find(|channel| !channel.counts() && channel.gain == 1.0);
        let told = read_as_it_is.or_else(|| own().find(|channel| !channel.counts()));
        told.or_else(|| own().next()).map_or("rad", |channel| &channel.unit)
    }

    /// The unit of a parameter at a target: `unit` with that of the coordinate in place of `rad`, of
    /// the channel in place of `reading`, and of lengths in place of `length`.
    #[doc(hidden)]
    #[must_use]
    pub fn unit_at(&self, target: Target, unit: &str) -> String {
        let reading = match target {
            Target::Channel(c) => self.channels[c].unit.as_str(),
            _ => "reading",
        };
        let unit = unit.replace("rad", self.coordinate_unit(target));
        unit.replace("reading", reading).replace("length", &self.length_unit)
    }

    /// Half of how far a channel goes, in readings that span so much: half of its range, or half a turn, and of a channel
    /// without a range that reads no joint, no angle and no length what they go through.
    pub(crate) fn half_range_in(&self, channel: usize, [low, high]: [f64; 2]) -> f64 {
        let own = &self.channels[channel];
        let unbounded = own.ends().is_none() && !self.slides(channel) && !self.moves_joint(channel);
        let shown = unbounded && self.coordinate_unit(Target::Channel(channel)) != "rad";
        if shown && low < high { 0.5 * (high - low) } else { own.half_range() }
    }

    /// True where the sensors of all parts of a target may be of one make: the same unit and
    /// range, and nearly the same nominal gain.
    #[doc(hidden)]
    #[must_use]
    pub fn one_make(&self, target: Target) -> bool {
        let channels = self.channels_at(target);
        let Some((first, others)) = channels.split_first() else { return false };
        let first = &self.channels[*first];
        others.iter().map(|&c| &self.channels[c]).all(|other| {
            let width = [first.half_range(), other.half_range()];
            let gains = (first.gain, other.gain);
            first.unit == other.unit
                && first.range.is_some() == other.range.is_some()
                && close(width[0], width[1], SAME)
                && close(gains.0, gains.1, MAKE)
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::closures::ClosureKind;
    use crate::mechanism::drawing::{Channel, Closure, Mechanism};
    use crate::mechanism::target::Target;

    /// Channels of no joint, each of which closures make equal to the next.
    fn row_of(channels: &[(&str, f64)]) -> Mechanism {
        let name = |i: usize| format!("c{i}");
        let channel = |(i, (unit, gain)): (usize, &(&str, f64))| Channel {
            name: name(i),
            unit: (*unit).into(),
            gain: *gain,
            ..Channel::default()
        };
        let closure = |i: usize| Closure {
            name: format!("e{i}"),
            kind: ClosureKind::Equal,
            between: [name(i), name(i + 1)],
            ..Closure::default()
        };
        Mechanism {
            length_unit: "mm".into(),
            channels: channels.iter().enumerate().map(channel).collect(),
            closures: (1..channels.len()).map(|i| closure(i - 1)).collect(),
            ..Mechanism::default()
        }
    }

    #[test]
    fn equal_coordinates_have_one_unit_and_counts_are_none_where_another_is_known() {
        let unit = |channels: &[(&str, f64)]| {
            let mechanism = row_of(channels);
            let units: Vec<_> =
                (0..channels.len()).map(|c| mechanism.unit_at(Target::Channel(c), "rad")).collect();
            assert!(units.iter().all(|unit| *unit == units[0]), "{units:?}");
            units[0].clone()
        };
        assert_eq!(unit(&[("deg", 0.017), ("count", 0.0017)]), "rad");
        // Over a channel between them, too.
        assert_eq!(unit(&[("count", 0.0017), ("count", 0.0016), ("rad", 1.0)]), "rad");
        assert_eq!(unit(&[("count", 0.05), ("percent", 1.0)]), "percent");
        assert_eq!(unit(&[("V", 20.0), ("percent", 1.0)]), "percent");
        assert_eq!(unit(&[("percent", 1.0)]), "percent");
        assert_eq!(unit(&[("count", 1.0), ("count", 1.1)]), "count");
        let gain = row_of(&[("deg", 0.017), ("count", 0.0017)]);
        assert_eq!(gain.unit_at(Target::Channel(1), "rad/reading"), "rad/count");
    }
}
