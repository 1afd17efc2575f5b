//! Mechanisms as TOML text.

use crate::Error;
use crate::mechanism::drawing::Mechanism;

/// Unit of readings whose gain is written per radian, and kept per degree.
const DEGREES: &str = "deg";

#[cfg(feature = "toml")]
impl Mechanism {
    /// Reads a mechanism from TOML text.
    ///
    /// Readings of a channel with `unit = "deg"` are converted to radians before its gain
    /// acts: an encoder that reads its joint in degrees has `gain = 1.0`, as one in radians.
    ///
    /// # Errors
    ///
    /// [`Error::Toml`] with line and column for text that cannot be parsed, else the errors of
    /// [`Mechanism::validate`].
    pub fn from_toml(text: &str) -> Result<Self, Error> {
        let mut mechanism: Self =
            toml::from_str(text).map_err(|e| Error::Toml(e.to_string().trim_end().into()))?;
        for channel in mechanism.channels.iter_mut().filter(|c| c.unit == DEGREES) {
            channel.gain = channel.gain.to_radians();
        }
        mechanism.validate()?;
        Ok(mechanism)
    }

    /// The mechanism as TOML text, which [`Mechanism::from_toml`] reads back.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let mut written = self.clone();
        for channel in written.channels.iter_mut().filter(|c| c.unit == DEGREES) {
            channel.gain = channel.gain.to_degrees();
        }
        toml::to_string(&written).unwrap_or_default()
    }
}
