//! Gains of channels that read in degrees: written per radian in a file, kept per degree.

use crate::mechanism::drawing::Mechanism;

const DEGREES: &str = "deg";

impl Mechanism {
    /// The mechanism as it is kept, from the values that stand in a file.
    ///
    /// In a file the readings of a channel with `unit = "deg"` are converted to radians before its
    /// gain acts: an encoder that reads its joint in degrees has `gain = 1.0`, as one in radians.
    #[must_use]
    pub fn with_gains_per_degree(self) -> Self {
        self.scaled(f64::to_radians)
    }

    /// The values that stand in a file, from the mechanism as it is kept.
    #[must_use]
    pub fn with_gains_per_radian(self) -> Self {
        self.scaled(f64::to_degrees)
    }

    fn scaled(mut self, convert: fn(f64) -> f64) -> Self {
        for channel in self.channels.iter_mut().filter(|c| c.unit == DEGREES) {
            channel.gain = convert(channel.gain);
        }
        self
    }
}
