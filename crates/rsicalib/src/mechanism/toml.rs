//! Mechanisms as TOML text.

use crate::Error;
use crate::mechanism::drawing::Mechanism;

#[cfg(feature = "toml")]
impl Mechanism {
    /// Reads a mechanism from TOML text.
    ///
    /// Channels in degrees: see [`Mechanism::from_written_units`].
    ///
    /// # Errors
    ///
    /// [`Error::Toml`] with line and column for text that cannot be parsed, else the errors of
    /// [`Mechanism::validate`].
    pub fn from_toml(text: &str) -> Result<Self, Error> {
        let written: Self =
            toml::from_str(text).map_err(|e| Error::Toml(e.to_string().trim_end().into()))?;
        let mechanism = written.from_written_units();
        mechanism.validate()?;
        Ok(mechanism)
    }

    /// The mechanism as TOML text, which [`Mechanism::from_toml`] reads back.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(&self.clone().in_written_units()).unwrap_or_default()
    }
}
