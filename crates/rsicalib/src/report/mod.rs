//! Results as users hold them: plain structs in the shape of the JSON, and words.

pub mod calibrated;
pub mod result;
pub mod traced;
pub mod words;
