//! Mechanisms as TOML text.

use crate::Error;
use crate::mechanism::drawing::Mechanism;
#[cfg(feature = "toml")]
use crate::text::{found_and_expected, meant_by};

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

/// Values of a file as what they describe.
///
/// # Errors
///
/// [`Error::Entry`] with the path of the entry that is wrong.
#[cfg(all(feature = "toml", feature = "document"))]
#[doc(hidden)]
pub fn from_values<T: serde::de::DeserializeOwned>(values: toml::Value) -> Result<T, Error> {
    serde_path_to_error::deserialize(values).map_err(|error| {
        let path = error.path().to_string();
        let place = if path == "." { "top level".into() } else { path };
        Error::Entry { place, why: said_of_values(error.inner().message()) }
    })
}

/// What is wrong with values, in words of a user. Names that are not known, with those that may be meant, are said
/// well enough.
#[cfg(feature = "toml")]
fn said_of_values(message: &str) -> String {
    let both = found_and_expected(message).filter(|_| message.starts_with("invalid "));
    match both {
        Some((found, expected)) => format!("found {found}, expected {expected}"),
        None => message.to_owned() + &meant_by(message),
    }
}

/// What is wrong with a text, and in which line, in one sentence.
#[cfg(feature = "toml")]
fn said(error: &toml::de::Error, text: &str) -> Error {
    let message = error.message();
    let words = said_of_values(message);
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
