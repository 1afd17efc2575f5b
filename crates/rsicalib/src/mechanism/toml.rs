//! Mechanisms as TOML text.

use crate::Error;
use crate::mechanism::drawing::Mechanism;
#[cfg(feature = "toml")]
use crate::text::meant_by;

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
        let written: Self = toml::from_str(text).map_err(|error| said(&error, text))?;
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

/// What is wrong with a text, and in which line, in one sentence.
#[cfg(feature = "toml")]
fn said(error: &toml::de::Error, text: &str) -> Error {
    let message = error.message();
    let mut words = message.replace("invalid type: string", "found text");
    words = words.replace("invalid type: ", "found ").replace("f64", "a number");
    words += &meant_by(message);
    let before = error.span().and_then(|span| text.get(..span.start));
    let place = before.map(|before| {
        let lines: Vec<&str> = before.split('\n').collect();
        let column = 1 + lines.last().map_or(0, |last| last.chars().count());
        // The key, where the place is that of a value.
        let key = lines.last().and_then(|last| last.trim_end().strip_suffix('='));
        let key = key.and_then(|key| key.split([',', '{']).next_back()).map(str::trim);
        let key = key.map_or_else(String::new, |key| format!("{key}: "));
        format!("line {}, column {column}: {key}", lines.len())
    });
    Error::Toml(place.unwrap_or_default() + &words)
}
