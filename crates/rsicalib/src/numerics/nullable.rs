//! Numbers that documents write as null where they are not known, and that are NaN in programs.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A number that is not known.
pub(crate) const fn unknown() -> f64 {
    f64::NAN
}

/// Writes a number, or null for one that is not known.
pub(crate) fn serialize<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
    value.is_finite().then_some(*value).serialize(to)
}

/// Reads a number, or null.
pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or_else(unknown))
}
