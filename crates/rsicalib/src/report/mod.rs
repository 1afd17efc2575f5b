//! Results as users hold them: plain structs in the shape of the JSON, and words.

pub mod calibrated;
#[cfg(feature = "document")]
pub mod document;
pub mod result;
pub mod traced;
pub mod words;
