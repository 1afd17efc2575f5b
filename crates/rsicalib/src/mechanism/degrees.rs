//! Channels that read in degrees: written in degrees in a file, kept in radians.

use std::f64::consts::TAU;

use crate::mechanism::drawing::{Channel, Mechanism};

const DEGREES: &str = "deg";

impl Channel {
    /// True where a mechanism file has this channel in degrees.
    #[must_use]
    pub fn is_in_degrees(&self) -> bool {
        self.unit == DEGREES
    }
}

impl Mechanism {
    /// The mechanism as it is kept, from the values that stand in a file.
    ///
    /// In a file all of a channel with `unit = "deg"` is in degrees: an encoder that reads its
    /// joint has `gain = 1.0`, as one in radians, and `offset` and `limits` are degrees of the
    /// joint. They are kept in radians, and the gain in radians per degree; `range` and `noise`
    /// are of a reading, and stay. Of a joint that slides, `gain` is a length per radian of the
    /// reading, and `offset` and `limits` are lengths. The `noise` of two such channels that are to be equal is in
    /// degrees, too.
    #[must_use]
    pub fn from_written_units(self) -> Self {
        self.converted(f64::to_radians)
    }

    /// The values that stand in a file, from the mechanism as it is kept.
    #[must_use]
    pub fn in_written_units(self) -> Self {
        self.converted(degrees)
    }

    /// Channels of joints that turn whose limits are whole numbers and more than a turn in radians: they may be
    /// meant in degrees.
    #[must_use]
    pub fn limits_as_in_degrees(&self) -> Vec<usize> {
        let whole = |[low, high]: [f64; 2]| {
            low.fract() == 0.0 && high.fract() == 0.0 && high - low > TAU && high - low <= 720.0
        };
        let limits = |c: &usize| self.channels[*c].limits;
        let meant = |c: &usize| self.turns(*c) && limits(c).is_some_and(whole);
        (0..self.channels.len()).filter(meant).collect()
    }

    fn converted(mut self, convert: fn(f64) -> f64) -> Self {
        let slides: Vec<bool> = (0..self.channels.len()).map(|c| self.slides(c)).collect();
        let turned = |name: &String| {
            let mut channels = self.channels.iter().zip(&slides);
            channels.any(|(c, slides)| c.name == *name && c.is_in_degrees() && !slides)
        };
        for closure in self.closures.iter_mut().filter(|closure| closure.is_of_channels()) {
            if closure.between.iter().all(turned) {
                closure.noise = closure.noise.map(convert);
            }
        }
        for (channel, slides) in self.channels.iter_mut().zip(slides) {
            if !channel.is_in_degrees() {
                continue;
            }
            channel.gain = convert(channel.gain);
            if !slides {
                channel.offset = convert(channel.offset);
                channel.limits = channel.limits.map(|ends| ends.map(convert));
            }
        }
        self
    }
}

/// Units that a file writes in one way, and other ways to write them.
const UNITS: [(&str, &[&str]); 3] = [
    (DEGREES, &["degree", "degrees", "°", "º"]),
    ("rad", &["radian", "radians"]),
    ("count", &["counts"]),
];

/// The way to write a unit that is written otherwise; none of a unit that is as it should be, or of
/// one's own.
pub(super) fn unit_meant(found: &str) -> Option<&'static str> {
    let lower = found.to_lowercase();
    let other = |(unit, others): &&(&str, &[&str])| {
        *unit != found && (*unit == lower || others.contains(&lower.as_str()))
    };
    UNITS.iter().find(other).map(|(unit, _)| *unit)
}

/// An angle in degrees: the number of 15 digits that is read back as the same angle, where there
/// is one, so that what is printed is what was written.
fn degrees(radians: f64) -> f64 {
    let exact = radians.to_degrees();
    match format!("{exact:.14e}").parse::<f64>() {
        Ok(short) if short.to_radians() == radians => short,
        _ => exact,
    }
}
