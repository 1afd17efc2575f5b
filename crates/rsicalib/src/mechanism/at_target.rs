//! What a target is of: its channels, and their units.

use crate::mechanism::alike::{SAME, close};
use crate::mechanism::drawing::Mechanism;
use crate::mechanism::target::Target;

/// Sensors whose nominal gains differ by less than this, in parts, may be of one make.
const MAKE: f64 = 0.1;

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

    /// The unit of the coordinates of a target's joints: the unit of length where they slide. A
    /// channel of no joint has its own, but for degrees, which are kept in radians.
    #[doc(hidden)]
    #[must_use]
    pub fn coordinate_unit(&self, target: Target) -> &str {
        match target {
            Target::Channel(c) if c < self.channels.len() && !self.moves_joint(c) => {
                match &self.channels[c] {
                    _ if self.measures(c) => &self.length_unit,
                    channel if channel.is_in_degrees() => "rad",
                    channel => &channel.unit,
                }
            }
            _ if self.slides_at(target) => &self.length_unit,
            _ => "rad",
        }
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
