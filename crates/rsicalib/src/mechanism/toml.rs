//! Mechanisms as TOML text.

use crate::Error;
use crate::mechanism::drawing::Mechanism;

#[cfg(feature = "toml")]
impl Mechanism {
    /// Reads a mechanism from TOML text.
    ///
    /// # Errors
    ///
    /// [`Error::Toml`] with line and column for text that cannot be parsed, else the errors of
    /// [`Mechanism::validate`].
    pub fn from_toml(text: &str) -> Result<Self, Error> {
        let mechanism: Self =
            toml::from_str(text).map_err(|e| Error::Toml(e.to_string().trim_end().into()))?;
        mechanism.validate()?;
        Ok(mechanism)
    }

    /// The mechanism as TOML text, which [`Mechanism::from_toml`] reads back.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }
}
